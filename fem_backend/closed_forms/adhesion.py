"""Adhesion of a ball to an elastic half-space: JKR, DMT and the transition between them; small strain.

Letters: R mm the radius of the ball, w N/mm the work of adhesion, E* = E/(1 − ν²) MPa (a rigid ball), a mm the radius
of the contact, δ mm the depth, F N the force that presses, σ₀ MPa the largest attraction.  K = 4E*/3 of Maugis.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

# F and δ where a controlled travel lets go, each over its unit of JKR
JKR_FOLD_FACTORS = (-5.0 / 6.0, -3.0 / 4.0)
"""F/(π w R) and δ/(π² w² R/E*²)^(1/3) where a controlled travel ends: dδ/da = 0 at a³ = π w R²/(8 E*)."""


def plane_modulus(E: float, nu: float) -> float:
    """E* = E/(1 − ν²) (MPa)."""
    return E / (1.0 - nu**2)


def tabor(R: float, w: float, stiff: float, reach: float) -> float:
    """μ_T = (R w²/(E*² ℓ³))^(1/3), the depth by which the ball is drawn in over the range ℓ (mm) of the attraction.

    Large (above 5): JKR; small (below 0.1): DMT.  Source: Tabor 1977; Johnson & Greenwood 1997, eq. 2.
    """
    return (R * w**2 / (stiff**2 * reach**3)) ** (1.0 / 3.0)


def cohesive_zone(w: float, stiff: float, peak: float) -> float:
    """l = (π/4) E* w/σ₀² (mm): width of the annulus beside a contact where the attraction acts, w ≪ σ₀ a.

    Dugdale's (π/8)(K_I/σ₀)² with K_I² = 2 E* w of a rigid body on an elastic one.
    Source: Dugdale 1960; Maugis 1992, §4.
    """
    return 0.25 * math.pi * stiff * w / peak**2


def jkr(a: np.ndarray, R: float, w: float, stiff: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth δ = a²/R − √(2π w a/E*) (mm) and force F = 4 E* a³/(3R) − √(8π w E* a³) (N) at contact radii a (mm).

    Assumptions: a ≪ R, half-space, range of the attraction 0.  Source: Johnson, Kendall & Roberts 1971; Maugis 2000,
    eq. 4.97 and 4.105.
    """
    a = np.asarray(a, float)
    return a**2 / R - np.sqrt(2.0 * np.pi * w * a / stiff), 4.0 * stiff * a**3 / (3.0 * R) - np.sqrt(
        8.0 * np.pi * w * stiff * a**3
    )


def jkr_pull_off(R: float, w: float) -> float:
    """The least force −(3/2) π w R (N), where a controlled force lets go."""
    return -1.5 * np.pi * w * R


def jkr_jump_off(R: float, w: float, stiff: float) -> tuple[float, float]:
    """Depth −(3/4) (π² w² R/E*²)^(1/3) (mm) and force −(5/6) π w R (N) where a controlled travel lets go."""
    return JKR_FOLD_FACTORS[1] * (np.pi**2 * w**2 * R / stiff**2) ** (1.0 / 3.0), JKR_FOLD_FACTORS[0] * np.pi * w * R


def jkr_force(depth: np.ndarray, R: float, w: float, stiff: float) -> np.ndarray:
    """Force (N) of the contact that JKR has at depths (n,) mm in unloading; 0 beyond its jump-off."""
    d = np.asarray(depth, float)
    least, _ = jkr_jump_off(R, w, stiff)
    low = (np.pi * w * R**2 / (8.0 * stiff)) ** (1.0 / 3.0)  # dδ/da = 0
    top = 2.0 * np.sqrt(R * (np.maximum(d.max(initial=0.0), 0.0) - least)) + 4.0 * low
    a = low + (top - low) * np.linspace(0.0, 1.0, 4001) ** 2
    depths, forces = jkr(a, R, w, stiff)
    return np.where(d < least, 0.0, np.interp(d, depths, forces))


def dmt_force(depth: np.ndarray, R: float, w: float, stiff: float) -> np.ndarray:
    """F = (4/3) E* √R δ^{3/2} − 2π w R (N) at depths δ ≥ 0 (mm), 0 above.

    Assumptions: as JKR, but a range of the attraction far beyond what it draws up, μ_T ≪ 1.
    Source: Derjaguin, Muller & Toporov 1975; Maugis 2000, eq. 4.135.
    """
    d = np.asarray(depth, float)
    return np.where(d < 0.0, 0.0, 4.0 / 3.0 * stiff * math.sqrt(R) * np.maximum(d, 0.0) ** 1.5 - 2.0 * np.pi * w * R)


def maugis(a: np.ndarray, R: float, w: float, stiff: float, peak: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth (mm) and force (N) at contact radii a (mm) where a constant attraction σ₀ (MPa) acts over w/σ₀ (mm).

        (λA²/2)[(m² − 2) arcsec m + √(m² − 1)] + (4λ²A/3)[√(m² − 1) arcsec m − m + 1] = 1
        F̄ = A³ − λA² [√(m² − 1) + m² arcsec m],   Δ = A² − (4/3) λ A √(m² − 1)

    A = a/(πwR²/K)^(1/3), F̄ = F/(πwR), Δ = δ/(π²w²R/K²)^(1/3), λ = 2σ₀/(πwK²/R)^(1/3) = 1.16 μ_T; m a is where the
    attraction ends.  Source: Maugis 1992, eq. 6.12 to 6.16; Johnson & Greenwood 1997, eq. 9 to 11.
    """
    K = 4.0 / 3.0 * stiff
    lam = 2.0 * peak / (np.pi * w * K**2 / R) ** (1.0 / 3.0)
    A = np.atleast_1d(np.asarray(a, float)) / (np.pi * w * R**2 / K) ** (1.0 / 3.0)

    def left(m: float, one: float) -> float:
        root, angle = math.sqrt(m * m - 1.0), math.acos(1.0 / m)
        first = 0.5 * lam * one**2 * ((m * m - 2.0) * angle + root)
        return first + 4.0 / 3.0 * lam**2 * one * (root * angle - m + 1.0) - 1.0

    m = np.array([brentq(left, 1.0, _beyond(left, float(one)), args=(float(one),), xtol=1e-13) for one in A])
    root, angle = np.sqrt(m**2 - 1.0), np.arccos(1.0 / m)
    force = A**3 - lam * A**2 * (root + m**2 * angle)
    depth = A**2 - 4.0 / 3.0 * lam * A * root
    return depth * (np.pi**2 * w**2 * R / K**2) ** (1.0 / 3.0), force * np.pi * w * R


def _beyond(left, one: float) -> float:  # type: ignore[no-untyped-def]
    """A ratio m at which the left side is positive."""
    m = 2.0
    while left(m, one) < 0.0:
        m *= 2.0
    return m
