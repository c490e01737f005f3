"""Bodies and rigid surfaces: points, gaps, normals, curvatures.  Lengths in mm.

Frame: x along the major axis, y along the minor one, z up, origin at the specimen's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike

STILL = (0.0, 0.0, 0.0)
RIM = 1e-9  # mm from z = 0 that count as on it


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

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """Whether points X (n, 3) of the surface are of its part `upper` (z ≥ 0) or `lower` (z ≤ 0), with the rim."""
        return X[:, 2] >= -RIM if name == "upper" else X[:, 2] <= RIM

    def project(self, x: np.ndarray) -> np.ndarray:
        """Move points (n, 3) radially in the scaled frame onto the surface; exact planes stay exact planes."""
        s = x / self.semi_axes
        return x / np.linalg.norm(s, axis=1, keepdims=True)


@dataclass(frozen=True)
class Sphere:
    """Rigid sphere of radius R (mm), with a shaft: continued by a cylinder of radius R opposite to `direction`.

    Its surface is the zero of the gap g(x) = |x − c| − R, beside the shaft of the distance from the axis − R; the
    joint is C¹.
    """

    R: float
    shaft: bool = False

    def gap(
        self, x: np.ndarray, centre: np.ndarray, direction: ArrayLike = STILL
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g (…), normal n = ∇g (…, 3) and Hessian ∇∇g = (I − n⊗n)/|x − c| (…, 3, 3) at points x (…, 3).

        `direction` is the unit way into the body (mm/mm); only the shaft, which trails behind, needs it.
        """
        flat, centre, direction = arrays(x, centre, direction)
        g, n, hessian = _sphere_gap(flat, centre, direction, float(self.R), self.shaft)
        return g.reshape(x.shape[:-1]), n.reshape(x.shape), hessian.reshape(*x.shape, 3)

    def travel(self, x: np.ndarray, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (…) mm, signed, the sphere goes along the unit `direction` until it first meets the points x (…, 3).

        s = d·v − √(R² − |v|² + (d·v)²) with v = x − c; ∞ for points beside its way.
        """
        v = x - centre
        along = v @ np.asarray(direction, float)
        inside = self.R**2 - ((v - along[..., None] * direction) ** 2).sum(-1)
        return np.where(inside >= 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)


def arrays(x: np.ndarray, *vectors: ArrayLike) -> list[np.ndarray]:
    """Points as contiguous (n, 3) and vectors (3,), all float64, for the kernels."""
    return [np.ascontiguousarray(x, float).reshape(-1, 3), *(np.ascontiguousarray(v, float) for v in vectors)]


@numba.njit(cache=True)
def _sphere_gap(x, c, d, R, shaft):  # type: ignore[no-untyped-def]
    count = len(x)
    g, n, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
    for k in range(count):
        v0, v1, v2 = x[k, 0] - c[0], x[k, 1] - c[1], x[k, 2] - c[2]
        behind = -(v0 * d[0] + v1 * d[1] + v2 * d[2])
        beside = shaft and behind > 0.0
        if beside:  # only the part across the axis counts
            v0, v1, v2 = v0 + behind * d[0], v1 + behind * d[1], v2 + behind * d[2]
        r = max(np.sqrt(v0 * v0 + v1 * v1 + v2 * v2), 1e-300)
        g[k] = r - R
        n[k, 0], n[k, 1], n[k, 2] = v0 / r, v1 / r, v2 / r
        for i in range(3):
            for j in range(3):
                h = (1.0 if i == j else 0.0) - n[k, i] * n[k, j]
                if beside:
                    h -= d[i] * d[j]
                hessian[k, i, j] = h / r
    return g, n, hessian


@numba.njit(cache=True)
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


@numba.njit(cache=True)
def depths(s, x):  # type: ignore[no-untyped-def]
    """Distance (n,) of points x (n, 3) to the ellipsoid of semi-axes s (3,), negative outside."""
    d, y = np.empty(len(x)), np.empty(3)
    for k in range(len(x)):
        tau = closest_point(x[k], s, y)
        d[k] = -tau * np.sqrt((y[0] / s[0] ** 2) ** 2 + (y[1] / s[1] ** 2) ** 2 + (y[2] / s[2] ** 2) ** 2)
    return d


def first_contact(body: Ellipsoid, R: float, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
    """Centre (3,) mm of a sphere of radius R where it first touches the undeformed body on its way.

    The way of the centre is the line through the point `through` (3,) along `direction` (3,), any length.  The distance
    from a convex body is convex along a line, so Newton from far away goes to the first contact without passing it.
    Raises ValueError when the sphere passes by.
    """
    origin, d = np.asarray(through, float), np.asarray(direction, float)
    d = d / np.linalg.norm(d)
    axes, y = body.semi_axes, np.empty(3)
    s = -(origin @ d) - 2.0 * (float(axes.max()) + R) - np.linalg.norm(origin - (origin @ d) * d)
    for _ in range(100):
        centre = origin + s * d
        tau = closest_point(centre, axes, y)
        N = y / axes**2
        size = float(np.linalg.norm(N))
        rate = float(N @ d) / size
        if rate >= 0.0:
            break
        step = -(tau * size - R) / rate
        s += step
        if abs(step) <= 4e-16 * (abs(s) + float(axes.max())):
            return origin + s * d
    raise ValueError(f"a sphere of radius {R} mm on the line through {origin} along {d} passes by the body")


def closest(body: Ellipsoid, x: ArrayLike) -> np.ndarray:
    """Point (3,) of the surface that is closest to a point x (3,) mm outside of the body."""
    y = np.empty(3)
    closest_point(np.ascontiguousarray(x, float), body.semi_axes, y)
    return y


def hertz_radius(body: Ellipsoid, indenter: Sphere) -> float:
    """Effective radius 1/(1/R + mean curvature) of first contact at the top (Johnson 1985, eq. 4.3; mm)."""
    return 1.0 / (1.0 / indenter.R + body.mean_curvature_at_top())
