"""Bodies and rigid surfaces: points, gaps, normals, curvatures.  Lengths in mm.

Frame: x along the major axis, y along the minor one, z up, origin at the specimen's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ellipsoid:
    """Solid ellipsoid (x/a)² + (y/b)² + (z/c)² ≤ 1 with semi-axes a, b, c (mm)."""

    a: float
    b: float
    c: float

    @property
    def semi_axes(self) -> np.ndarray:
        """(a, b, c), shape (3,)."""
        return np.array([self.a, self.b, self.c], dtype=float)

    @property
    def top(self) -> np.ndarray:
        """The pole (0, 0, c)."""
        return np.array([0.0, 0.0, self.c])

    def mean_curvature_at_top(self) -> float:
        """(κ₁ + κ₂)/2 = (c/a² + c/b²)/2 at the pole (1/mm)."""
        return 0.5 * (self.c / self.a**2 + self.c / self.b**2)

    def volume(self) -> float:
        """4/3 π a b c (mm³)."""
        return 4.0 / 3.0 * np.pi * self.a * self.b * self.c

    def project(self, x: np.ndarray) -> np.ndarray:
        """Move points (n, 3) radially in the scaled frame onto the surface; exact planes stay exact planes."""
        s = x / self.semi_axes
        return x / np.linalg.norm(s, axis=1, keepdims=True)


@dataclass(frozen=True)
class Sphere:
    """Rigid sphere of radius R (mm); its surface is the zero of the gap g(x) = |x − c| − R."""

    R: float

    def gap(self, x: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g (…), normal n = ∇g (…, 3) and Hessian ∇∇g = (I − n⊗n)/|x − c| (…, 3, 3) at points x (…, 3)."""
        d = x - c
        r = np.linalg.norm(d, axis=-1)
        n = d / r[..., None]
        hessian = (np.eye(3) - n[..., :, None] * n[..., None, :]) / r[..., None, None]
        return r - self.R, n, hessian


def hertz_radius(body: Ellipsoid, indenter: Sphere) -> float:
    """Effective radius 1/(1/R + mean curvature) of first contact at the top (Johnson 1985, eq. 4.3; mm)."""
    return 1.0 / (1.0 / indenter.R + body.mean_curvature_at_top())
