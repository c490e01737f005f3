"""The thesis's method: a polynomial through the errors of simulations that are already there, and *all* its minima.

A polynomial says nothing where there are no samples (it may even promise negative errors there), so that minima are
looked for inside the convex hull of the samples only, and minima on its boundary and negative ones are shown apart.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

SAME_SURFACE_MINIMUM_TOLERANCE = 0.02  # of the samples' range: minima closer than this are one
STARTS_PER_SIDE = 24  # a side: points of a grid over the samples' range, from which descents start


@dataclass(frozen=True, eq=False)
class ErrorSurface:
    """p(θ) = Σ_k c_k z^{a_k} with z = (θ − middle)/half ∈ [−1, 1]^d: `points` (n, d), `errors` (n,), `powers` (m, d).

    `r2` = 1 − Σ(e − p)²/Σ(e − ē)²; `sd` the standard deviation of a residual; `covariance` (m, m) that of c; `hull`
    (h, d+1) the facets of the samples' convex hull in z: n·z + b <= 0 inside.
    """

    degree: int
    points: np.ndarray
    errors: np.ndarray
    middle: np.ndarray
    half: np.ndarray
    powers: np.ndarray
    coefficients: np.ndarray
    r2: float
    sd: float
    hull: np.ndarray
    covariance: np.ndarray

    def __call__(self, theta: np.ndarray) -> np.ndarray:
        """Predicted error (k,) at θ (k, d), also where nothing was sampled."""
        return _terms(self.scaled(np.atleast_2d(theta)), self.powers) @ self.coefficients

    def scaled(self, theta: np.ndarray) -> np.ndarray:
        """z (k, d) of θ (k, d)."""
        return (np.asarray(theta, float) - self.middle) / self.half

    def uncertainty(self, theta: np.ndarray) -> np.ndarray:
        """Standard deviation (k,) of the predicted error by least squares."""
        T = _terms(self.scaled(np.atleast_2d(theta)), self.powers)
        return np.sqrt(np.einsum("km,mn,kn->k", T, self.covariance, T))

    def inside(self, theta: np.ndarray) -> np.ndarray:
        """Mask (k,) of the points in the convex hull of the samples."""
        z = self.scaled(np.atleast_2d(theta))
        return np.all(z @ self.hull[:, :-1].T + self.hull[:, -1] <= 1e-9, axis=1)


@dataclass(frozen=True, eq=False)
class Minimum:
    """A local minimum θ (d,) over the hull: its error and standard deviation there, 'inside', 'boundary' or 'negative'.

    `nearest` is the distance to the nearest sample, in shares of the samples' range.
    """

    theta: np.ndarray
    error: float
    sd: float
    kind: str
    nearest: float


def fit_surface(points: np.ndarray, errors: np.ndarray, degree: int) -> ErrorSurface:
    """Full polynomial of a total degree through errors (n,) at parameters θ (n, d), by least squares.

    Raises ValueError for fewer different samples than terms, samples on a line, and what is not finite.
    """
    θ, e = np.asarray(points, float), np.asarray(errors, float)
    if θ.ndim != 2 or e.shape != (len(θ),) or not (np.all(np.isfinite(θ)) and np.all(np.isfinite(e))):
        raise ValueError(f"an error surface needs finite points (n, d) and errors (n,), got {θ.shape} and {e.shape}")
    d = θ.shape[1]
    exponents = [a for a in itertools.product(range(degree + 1), repeat=d) if sum(a) <= degree]
    powers = np.array(sorted(exponents, key=lambda a: (sum(a), a)))
    low, high = θ.min(axis=0), θ.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if degree < 1 or len(np.unique(θ, axis=0)) < len(powers) or not np.all(half > 0):
        raise ValueError(f"degree {degree} in {d} parameters needs {len(powers)} different samples, got {len(θ)}")
    z = (θ - middle) / half
    T = _terms(z, powers)
    c, _, rank, _ = np.linalg.lstsq(T, e, rcond=None)
    if rank < len(powers):
        raise ValueError(f"degree {degree}: the samples do not determine the polynomial (rank {rank} of {len(powers)})")
    left = e - T @ c
    free = max(1, len(e) - len(powers))
    variance = float(left @ left) / free
    r2 = 1 - float(left @ left) / float(np.sum((e - e.mean()) ** 2) or 1.0)
    covariance = variance * np.linalg.inv(T.T @ T)
    return ErrorSurface(degree, θ, e, middle, half, powers, c, r2, variance**0.5, _hull(z), covariance)


def surface_minima(surface: ErrorSurface) -> tuple[Minimum, ...]:
    """Every local minimum of the surface over the convex hull of its samples, the trustworthy ones first.

    'inside': the gradient vanishes; 'boundary': the error still falls towards the outside, where nothing was sampled;
    'negative': the polynomial promises less than no error.  Within a kind the smallest error comes first.
    """
    A, b = surface.hull[:, :-1], surface.hull[:, -1]
    d = A.shape[1]
    n = STARTS_PER_SIDE if d < 3 else max(3, int(STARTS_PER_SIDE ** (2 / d)))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, n)] * d), axis=-1).reshape(-1, d)
    starts = np.vstack([surface.scaled(surface.points), grid[np.all(grid @ A.T + b <= 0, axis=1)]])

    # In units of the errors' spread: tolerances of the descent are absolute.
    c = surface.coefficients / (float(np.ptp(surface.errors)) or 1.0)

    def value(z: np.ndarray) -> float:
        return float(_terms(z[None], surface.powers)[0] @ c)

    def slope(z: np.ndarray) -> np.ndarray:
        return _gradient(z, surface.powers, c)

    found: list[np.ndarray] = []
    for z in _lowest_in_neighbourhood(surface, starts):
        result = minimize(
            value,
            z,
            jac=slope,
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 300},
            constraints={"type": "ineq", "fun": lambda z: -(A @ z + b), "jac": lambda z: -A},
        )
        x = _into(result.x, A, b)
        if all(np.abs(x - y).max() > 2 * SAME_SURFACE_MINIMUM_TOLERANCE for y in found) and _is_minimum(value, x, A, b):
            found.append(x)
    minima = [_minimum(surface, x, A, b) for x in found]
    order = {"inside": 0, "boundary": 1, "negative": 2}
    return tuple(sorted(minima, key=lambda m: (order[m.kind], m.error)))


def _terms(z: np.ndarray, powers: np.ndarray) -> np.ndarray:
    return np.prod(z[:, None, :] ** powers, axis=2)


def _gradient(z: np.ndarray, powers: np.ndarray, c: np.ndarray) -> np.ndarray:
    columns = []
    for j in range(len(z)):
        lowered = powers.copy()
        lowered[:, j] = np.maximum(lowered[:, j] - 1, 0)
        columns.append(float((powers[:, j] * np.prod(z**lowered, axis=1)) @ c))
    return np.array(columns)


def _hull(z: np.ndarray) -> np.ndarray:
    if z.shape[1] == 1:
        return np.array([[1.0, -z.max()], [-1.0, z.min()]])
    try:
        return ConvexHull(z).equations
    except QhullError as error:
        raise ValueError("the samples lie on a line or a plane: they span no region to search") from error


def _lowest_in_neighbourhood(surface: ErrorSurface, starts: np.ndarray) -> np.ndarray:
    """Starts that are no higher than their eight nearest: one descent for each basin, or a few."""
    value = _terms(starts, surface.powers) @ surface.coefficients
    apart = np.linalg.norm(starts[:, None] - starts, axis=2)
    near = np.argsort(apart, axis=1)[:, 1:9]
    keep = value <= value[near].min(axis=1)
    return starts[keep][np.argsort(value[keep])]


def _into(z: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rounding may leave a point outside by 1e-10: pull it to the middle until it is in."""
    for _ in range(60):
        if np.all(A @ z + b <= 1e-10):
            break
        z = z * (1 - 1e-9)
    return z


def _is_minimum(value, z: np.ndarray, A: np.ndarray, b: np.ndarray) -> bool:  # type: ignore[no-untyped-def]
    """No point of the hull on a small circle around is lower."""
    rng = np.random.default_rng(0)
    away = rng.standard_normal((64, len(z)))
    near = z + 1e-3 * away / np.linalg.norm(away, axis=1, keepdims=True)
    near = near[np.all(near @ A.T + b <= 0, axis=1)]
    return all(value(p) >= value(z) - 1e-9 for p in near)


def _minimum(surface: ErrorSurface, z: np.ndarray, A: np.ndarray, b: np.ndarray) -> Minimum:
    theta = surface.middle + surface.half * z
    error, sd = float(surface(theta[None])[0]), float(surface.uncertainty(theta[None])[0])
    on_boundary = bool(np.any(A @ z + b > -1e-6))
    kind = "negative" if error < 0 else "boundary" if on_boundary else "inside"
    nearest = float(np.linalg.norm((surface.scaled(surface.points) - z) / 2, axis=1).min())
    return Minimum(theta, error, sd, kind, nearest)
