"""An ellipsoid: points, distances, normals, curvatures.  Lengths in mm.

Frame: x along the major axis, y along the minor one, z up, origin at the specimen's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fem_backend.compiled import compiled

NO_MOTION = (0.0, 0.0, 0.0)  # centre (mm) and direction of a rigid surface that does not move
RIM_TOLERANCE_MM = 1e-9  # distance from z = 0 that counts as on it
MAX_PLAIN_POINTS = 8  # whose depth the plain function computes sooner than the compiled one is loaded


@dataclass(frozen=True)
class EllipsoidShape:
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

    @property
    def smallest(self) -> float:
        """The smallest semi-axis (mm)."""
        return float(self.semi_axes.min())

    @property
    def largest(self) -> float:
        """The largest semi-axis (mm)."""
        return float(self.semi_axes.max())

    @property
    def skin_limit(self) -> float:
        """Half the smallest radius of curvature (mm): a skin is thinner."""
        axes = self.semi_axes
        return 0.5 * float(axes.min() ** 2 / axes.max())

    def distance(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance (mm) of a point x (3,) outside, and its gradient N (3,) in direction, of any length."""
        tau, y = self._nearest(x)
        N = y / self.semi_axes**2
        return tau * float(np.linalg.norm(N)), N

    def closest(self, x: ArrayLike) -> np.ndarray:
        """Point (3,) of the surface that is closest to a point x (3,) mm outside."""
        return self._nearest(x)[1]

    def _nearest(self, x: ArrayLike) -> tuple[float, np.ndarray]:
        """Multiplier and point of one x (3,) by the plain function: the compiled one takes 0.15 s to load."""
        y = [0.0] * 3
        tau = closest_point.py_func(np.asarray(x, float).tolist(), self.semi_axes.tolist(), y)
        return float(tau), np.array(y)

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) mm of points X (…, 3) to the surface, negative outside."""
        X = np.asarray(X, float)
        if X.size <= 3 * MAX_PLAIN_POINTS:
            return np.array([-self.distance(x)[0] for x in X.reshape(-1, 3)]).reshape(X.shape[:-1])
        return depths(self.semi_axes, np.ascontiguousarray(X.reshape(-1, 3))).reshape(X.shape[:-1])

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Whether points X (…, 3) are nodes of the surface."""
        return np.abs(((X / self.semi_axes) ** 2).sum(-1) - 1.0) < 1e-6

    def above(self, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Point (3,) of the upper surface at (x, y) mm and outward normal (3,); ValueError beside the body."""
        inside = 1.0 - (x / self.a) ** 2 - (y / self.b) ** 2
        if inside <= 0:
            raise ValueError(f"point {(x, y)} mm is not above the body")
        on = np.array([x, y, self.c * np.sqrt(inside)])
        normal = on / self.semi_axes**2
        return on, normal / np.linalg.norm(normal)

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """Whether points X (n, 3) of the surface are of its part `upper` (z ≥ 0) or `lower` (z ≤ 0), with the rim."""
        return X[:, 2] >= -RIM_TOLERANCE_MM if name == "upper" else X[:, 2] <= RIM_TOLERANCE_MM

    def project(self, x: np.ndarray) -> np.ndarray:
        """Move points (n, 3) radially in the scaled frame onto the surface; exact planes stay exact planes."""
        s = x / self.semi_axes
        return x / np.linalg.norm(s, axis=1, keepdims=True)


def kernel_arrays(x: np.ndarray, *vectors: ArrayLike) -> list[np.ndarray]:
    """Points as contiguous (n, 3) and vectors (3,), all float64, for the kernels."""
    return [np.ascontiguousarray(x, float).reshape(-1, 3), *(np.ascontiguousarray(v, float) for v in vectors)]


@compiled()
def closest_point(x, s, y):  # type: ignore[no-untyped-def]
    """Multiplier τ of x = y + τ (y/s²) with y the point of the ellipsoid closest to x; fills y (3,).

    Newton on 1 − 1/|p(τ)| with p_i = s_i x_i/(s_i² + τ): nearly linear, and monotonic from a start left of the root.
    """
    tau = -1e300
    for i in range(3):
        tau = max(tau, s[i] * (abs(x[i]) - s[i]))
    low = tau
    for _ in range(60):
        square, slope = 0.0, 0.0
        for i in range(3):
            if x[i] != 0.0:
                z = s[i] * s[i] + tau
                p = s[i] * x[i] / z
                square += p * p
                slope += p * p / z
        if square <= 0.0:
            break
        size = np.sqrt(square)
        step = (size - 1.0) * square / slope
        tau = max(tau + step, low)
        if abs(step) <= 1e-16 * s[0] * s[0]:
            break
    rest, shortest = 1.0, 0
    for i in range(3):
        if s[i] < s[shortest]:
            shortest = i
    for i in range(3):
        y[i] = 0.0 if x[i] == 0.0 else s[i] * s[i] * x[i] / (s[i] * s[i] + tau)
        rest -= (y[i] / s[i]) ** 2
    if x[shortest] == 0.0 and rest > 1e-12:  # in the middle of the ellipsoid both sides are equally close
        y[shortest] = s[shortest] * np.sqrt(rest)
    return tau


@compiled()
def depths(s, x):  # type: ignore[no-untyped-def]
    """Distance (n,) of points x (n, 3) to the ellipsoid of semi-axes s (3,), negative outside."""
    d, y = np.empty(len(x)), np.empty(3)
    for k in range(len(x)):
        tau = closest_point(x[k], s, y)
        d[k] = -tau * np.sqrt((y[0] / s[0] ** 2) ** 2 + (y[1] / s[1] ** 2) ** 2 + (y[2] / s[2] ** 2) ** 2)
    return d
