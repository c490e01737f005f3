"""Indentation of an elastic layer on a rigid base: the integral equation of Lebedev & Ufliand and Hayes et al., solved.

A layer of thickness t, bonded to its base or sliding on it, is touched without friction by a rigid body of revolution.
Small strain, otherwise exact: a Fredholm equation of the second kind on the contact 0 ≤ s ≤ a,

    φ(s) − (2/π) ∫₀ᵃ φ(τ) ∫₀^∞ (1 − L(kt)) cos(ks) cos(kτ) dk dτ = h w₁(s) − w₂(s),    F = 2E/(1 − ν²) ∫₀ᵃ φ ds,

with w₁ = 1 and w₂ the Abel transform of the profile; a smooth profile touches up to where φ(a) = 0.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.polynomial.chebyshev import Chebyshev

N_CHEBYSHEV_NODES = 40  # contact radii that are solved for
"""Chebyshev nodes of depth and force over the contact radius; δ and F are smooth in it."""
MAX_WAVENUMBER = 24.0  # wave number times the thickness
"""1 − L falls as k² exp(−2k): nothing is left beyond."""


@functools.lru_cache(maxsize=256)
def _gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of Gauss and Legendre on (0, 1); an eigenvalue problem each time, so kept."""
    x, g = legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * g


def layer_compliance(k: np.ndarray, nu: float, base: str) -> np.ndarray:
    """L(k) at wave numbers k > 0 times the thickness: surface displacement over that of a half-space, same pressure.

    Bonded: (2q sinh 2k − 4k)/(2q cosh 2k + q² + 1 + 4k²), q = 3 − 4ν.  Slip (u_z = 0, no shear):
    (cosh 2k − 1)/(sinh 2k + 2k).  Raises ValueError for another base.
    Source: Hayes et al. 1972; Lebedev & Ufliand 1958.
    """
    k = np.asarray(k, dtype=float)
    if base == "slip":
        return (np.cosh(2 * k) - 1.0) / (np.sinh(2 * k) + 2 * k)
    if base != "bonded":
        raise ValueError(f'base "{base}" is neither "bonded" nor "slip"')
    q = 3.0 - 4.0 * nu
    return (2 * q * np.sinh(2 * k) - 4 * k) / (2 * q * np.cosh(2 * k) + q * q + 1.0 + 4 * k * k)


# --------------------------------------------------------------------------------------------------- profiles


@dataclass(frozen=True)
class Profile:
    """A rigid body of revolution by the transform of its profile f(r) (mm), up to a contact radius `limit` (mm).

    `transform` maps s (n,) to w₂(s) = s ∫₀ˢ f′(r)/√(s² − r²) dr (mm).  `edge` is the radius of a sharp edge, at which
    the contact stays; None where it grows with the depth.  `start` is where it begins, and with a `wall` the contact
    stays at the limit once it is there.
    """

    transform: Callable[[np.ndarray], np.ndarray]
    limit: float
    edge: float | None = None
    start: float = 0.0
    wall: bool = False


def paraboloid(radius: float) -> Profile:
    """f = r²/2R, w₂ = s²/R: the ball of Hertz and of Hayes et al. 1972."""
    return Profile(lambda s: s**2 / radius, np.inf)


def ball(radius: float) -> Profile:
    """f = R − √(R² − r²), w₂ = (s/2) ln((R + s)/(R − s)): the sphere of Sneddon 1965, eq. 6.13."""
    return Profile(lambda s: 0.5 * s * np.log((radius + s) / (radius - s)), 0.999 * radius)


def flat(radius: float) -> Profile:
    """Flat-ended cylinder with a sharp edge, w₂ = 0."""
    return Profile(np.zeros_like, radius, radius)


def cone(half_angle: float, tip_radius: float = 0.0) -> Profile:
    """Cone of half angle α (degrees) from its axis, rounded by a sphere of `tip_radius` ρ, tangent at b = ρ cos α.

    w₂ = (π/2) s cot α without a tip, else that of a ball up to b, then
    s [ln((ρ + s)/(ρ sin α + √(s² − b²))) + cot α arccos(b/s)].
    Source: Sneddon 1965, §6; Briscoe, Sebastian & Adams 1994 for the tip.
    """
    a = np.radians(half_angle)
    b = tip_radius * np.cos(a)

    def transform(s: np.ndarray) -> np.ndarray:
        out = np.maximum(s, b if b > 0.0 else 0.0)  # on the flank
        if not b:
            return 0.5 * np.pi * s / np.tan(a)
        flank = np.log((tip_radius + out) / (tip_radius * np.sin(a) + np.sqrt(out**2 - b**2)))
        flank = out * (flank + np.arccos(b / out) / np.tan(a))
        tip = np.minimum(s, b)
        return np.where(s > b, flank, 0.5 * tip * np.log((tip_radius + tip) / (tip_radius - tip)))

    return Profile(transform, np.inf)


def rounded_flat(radius: float, fillet: float) -> Profile:
    """Flat-ended cylinder whose edge is rounded by a `fillet` ρ: flat to c = radius − ρ, then f = ρ − √(ρ² − (r − c)²).

    w₂ by quadrature; the contact ends short of the radius.  Source: Ciavarella, Hills & Monno 1998 for half-spaces.
    """
    c = radius - fillet
    x, g = _gauss(48)

    def transform(s: np.ndarray) -> np.ndarray:
        far = np.maximum(s, c)[..., None]
        r = far - (far - c) * x**2  # takes the root at r = s away
        slope = (r - c) / np.sqrt(fillet**2 - (r - c) ** 2)
        return np.where(s > c, (far * slope * 2.0 * np.sqrt(far - c) / np.sqrt(far + r)) @ g, 0.0)

    return Profile(transform, radius - 1e-4 * fillet, start=c, wall=True)


# --------------------------------------------------------------------------------------------------- solution


def layer_contact(
    contact_radius: np.ndarray | Sequence[float],
    profile: Profile,
    thickness: float | None,
    nu: float,
    base: str = "bonded",
) -> tuple[np.ndarray, np.ndarray]:
    """Depth h (n,) mm and F (1 − ν²)/E (n,) mm² at contact radii a (n,) mm of a body without an edge.

    `thickness` t (mm) is None for a half-space.  Good to 1e-8 for a/t up to 30.  Source: see the module.
    """
    rows = [_solved(a, profile, thickness, nu, base) for a in np.atleast_1d(np.asarray(contact_radius, dtype=float))]
    (sums, ends) = (np.array([r[i] for r in rows]) for i in (0, 1))
    depth = ends[:, 1] / ends[:, 0]
    return depth, 2.0 * (depth * sums[:, 0] - sums[:, 1])


def _solved(a: float, profile: Profile, t: float | None, nu: float, base: str) -> tuple[np.ndarray, np.ndarray]:
    """∫φ ds (2,) and φ(a) (2,) of the right sides 1 and w₂."""
    ratio = 0.0 if t is None else a / t
    s, g = _gauss(40 + 6 * math.ceil(ratio))
    if profile.edge is None:  # φ may turn sharply where a profile has a corner: more points towards the rim
        s, g = 1.0 - (1.0 - s) ** 2, g * 2.0 * (1.0 - s)
    right = np.stack([np.ones_like(s), profile.transform(a * s)], axis=-1)
    end = np.array([1.0, profile.transform(np.array([a]))[0]])
    if t is None:
        return a * (g @ right), end
    k, v = (MAX_WAVENUMBER * x for x in _gauss(160 + 12 * math.ceil(ratio)))
    D = 2.0 / np.pi * (1.0 - layer_compliance(k, nu, base)) * v
    C = np.cos(np.outer(s * ratio, k))
    phi = np.linalg.solve(np.eye(len(s)) - (C * D) @ C.T * (g * ratio), right)
    return a * (g @ phi), end + (np.cos(ratio * k) * D) @ C.T @ (phi * (g * ratio)[:, None])


def layer_force(
    depth: np.ndarray, profile: Profile, thickness: float | None, E: float, nu: float, base: str = "bonded"
) -> np.ndarray:
    """Force F (N) at depths h ≥ 0 (mm), any shape, of a rigid body on an elastic layer of thickness t (mm).

    NaN where the contact would pass the profile's limit.  Assumptions: small strain, no friction; a layer that slides
    cannot leave its base.  `thickness` None is the half-space.  Source: Hayes et al. 1972; see the module.
    """
    h = np.asarray(depth, dtype=float)
    modulus = E / (1.0 - nu**2)
    if profile.edge is not None:
        sums, _ = _solved(profile.edge, profile, thickness, nu, base)
        return 2.0 * modulus * (h * sums[0] - sums[1])
    most = float(h.max(initial=0.0))
    low, high = profile.start, min(profile.limit, profile.start + 1e-3 * (thickness or 1.0))
    while high < profile.limit and layer_contact([high], profile, thickness, nu, base)[0][0] < most:
        low, high = high, min(1.5 * high, profile.limit)
    for _ in range(8):  # no farther than needed: polynomials dislike the end of a ball
        middle = 0.5 * (low + high)
        deep = layer_contact([middle], profile, thickness, nu, base)[0][0] >= most
        low, high = (low, middle) if deep else (middle, high)
    # depth and force are smooth in the root of w₂, which is the depth in a half-space
    end = np.sqrt(profile.transform(np.array([high]))[0])
    nodes = 0.5 * end * (1.0 - np.cos(np.pi * (np.arange(N_CHEBYSHEV_NODES) + 0.5) / N_CHEBYSHEV_NODES))
    inner, outer = np.full(N_CHEBYSHEV_NODES, profile.start), np.full(N_CHEBYSHEV_NODES, high)
    for _ in range(52):
        middle = 0.5 * (inner + outer)
        far = np.sqrt(profile.transform(middle)) > nodes
        inner, outer = np.where(far, inner, middle), np.where(far, middle, outer)
    both = layer_contact(0.5 * (inner + outer), profile, thickness, nu, base)
    at, force = (Chebyshev.fit(nodes, y, N_CHEBYSHEV_NODES - 1, domain=[0.0, end]) for y in both)
    left, right = np.zeros_like(h), np.full_like(h, end)
    for _ in range(52):
        y = 0.5 * (left + right)
        deep = at(y) > h
        left, right = np.where(deep, left, y), np.where(deep, y, right)
    beyond = np.nan
    if profile.wall:
        sums, _ = _solved(profile.limit, profile, thickness, nu, base)
        beyond = 2.0 * (h * sums[0] - sums[1])
    reduced = np.where(h <= at(end) * (1.0 + 1e-9), force(0.5 * (left + right)), beyond)
    return modulus * np.where(h > 0.0, reduced, 0.0)


def hayes_kappa(
    contact_over_thickness: np.ndarray | Sequence[float], nu: float, base: str = "bonded", shape: str = "flat"
) -> tuple[np.ndarray, np.ndarray]:
    """κ = F(1 − ν)/(4 μ a h) and χ = a²/(R h) at ratios a/t of a flat-ended cylinder or a ball; χ is 0 for a flat end.

    κ → 1 (flat) or 2/3 (ball), χ → 1 for a thick layer.  Raises ValueError for another shape.
    Source: Hayes et al. 1972, tables 1 and 2.
    """
    ratio = np.atleast_1d(np.asarray(contact_over_thickness, dtype=float))
    if shape == "flat":
        sums = np.array([_solved(x, flat(x), 1.0, nu, base)[0][0] for x in ratio])
        return sums / ratio, np.zeros_like(ratio)
    if shape != "ball":
        raise ValueError(f'shape "{shape}" is neither "flat" nor "ball"')
    depth, force = layer_contact(ratio, paraboloid(1.0), 1.0, nu, base)
    return 0.5 * force / (ratio * depth), ratio**2 / depth
