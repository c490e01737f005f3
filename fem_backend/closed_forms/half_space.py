"""Indentation of an elastic half-space of small strain, and constants of isotropic elasticity."""

from __future__ import annotations

import numpy as np


def youngs_modulus(mu: float, K: float) -> float:
    """E = 9Kμ/(3K + μ) (MPa)."""
    return 9.0 * K * mu / (3.0 * K + mu)


def poisson_ratio(mu: float, K: float) -> float:
    """ν = (3K − 2μ)/(6K + 2μ)."""
    return (3.0 * K - 2.0 * mu) / (6.0 * K + 2.0 * mu)


def hertz_force(depth: np.ndarray, radius: float, E: float, nu: float) -> np.ndarray:
    """F = 4/3 · E/(1 − ν²) · √R · h^{3/2} (N) for depths h (mm) of a rigid sphere of effective radius R (mm).

    Assumptions: elastic half-space, small strain, no friction, contact radius a = √(R h) ≪ R.
    Source: Johnson 1985, eq. 4.23; thesis eq. 2.3.
    """
    return 4.0 / 3.0 * E / (1.0 - nu**2) * np.sqrt(radius) * np.asarray(depth) ** 1.5


def hertz_modulus(force: np.ndarray, depth: np.ndarray, radius: float, nu: float) -> np.ndarray:
    """E = 3F(1 − ν²)/(4 √R h^{3/2}) (MPa), the inverse of :func:`hertz_force`, from forces (N) at depths h > 0 (mm).

    Source: Johnson 1985, eq. 4.23; thesis eq. 2.3.
    """
    return 0.75 * np.asarray(force) * (1.0 - nu**2) / (np.sqrt(radius) * np.asarray(depth) ** 1.5)


def ellipsoid_mean_curvature(semi_axes: np.ndarray, x: np.ndarray) -> float:
    """(κ₁ + κ₂)/2 = (a² + b² + c² − |x|²)/(2 (abc)² (x²/a⁴ + y²/b⁴ + z²/c⁴)^{3/2}) (1/mm) at x (3,) of the surface.

    Source: do Carmo 1976, §3.3, exercise 21.
    """
    s, x = np.asarray(semi_axes, dtype=float), np.asarray(x, dtype=float)
    return float((s @ s - x @ x) / (2.0 * np.prod(s) ** 2 * np.sum(x**2 / s**4) ** 1.5))


def sneddon_sphere(contact_radius: np.ndarray, radius: float, E: float, nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth h = (a/2) ln((R+a)/(R−a)) (mm) and force F (N) at contact radius a (mm) for the true sphere.

    F = E/(1 − ν²) · [(a² + R²)/2 · ln((R+a)/(R−a)) − a R].  Assumptions as Hertz without a ≪ R for the profile
    (strain still small).  Source: Sneddon 1965, eq. 6.13–6.15.
    """
    a, R = np.asarray(contact_radius), radius
    log = np.log((R + a) / (R - a))
    return 0.5 * a * log, E / (1.0 - nu**2) * (0.5 * (a**2 + R**2) * log - a * R)


def sneddon_flat(depth: np.ndarray, radius: float, E: float, nu: float) -> np.ndarray:
    """F = 2 E/(1 − ν²) · a h (N) for depths h (mm) of a rigid flat-ended cylinder of radius a (mm) with a sharp edge.

    Assumptions: elastic half-space, small strain, no friction.  Source: Sneddon 1965, §6; Johnson 1985, eq. 3.36.
    """
    return 2.0 * E / (1.0 - nu**2) * radius * np.asarray(depth, dtype=float)


def sneddon_cone(depth: np.ndarray, half_angle: float, E: float, nu: float) -> np.ndarray:
    """F = (2/π) E/(1 − ν²) · tan α h² (N) for depths h (mm) of a rigid sharp cone.

    α is the half angle from its axis (degrees).
    Assumptions: elastic half-space, no friction, small strain (α towards 90°).  Source: Sneddon 1965, §6.
    """
    return 2.0 / np.pi * E / (1.0 - nu**2) * np.tan(np.radians(half_angle)) * np.asarray(depth, dtype=float) ** 2


def neo_hookean_ball(depth: np.ndarray, radius: float, E: float) -> np.ndarray:
    """F = 16/9 · E √R h^{3/2} (1 − 0.15 h/R) (N) for depths h (mm) of a ball of radius R (mm), large strain.

    Assumptions: half-space, incompressible neo-Hookean, no friction, h ≤ R; a fit to finite elements.
    Source: Zhang, Cao, Li & Feng 2014.
    """
    h = np.asarray(depth, dtype=float)
    return 16.0 / 9.0 * E * np.sqrt(radius) * h**1.5 * (1.0 - 0.15 * h / radius)


def deep_limit(depth: np.ndarray, E: float, beta: float) -> np.ndarray:
    """F = β E D² (N) at depths D (mm) far above the radius of the indenter, which then no longer counts.

    β depends on the law and on friction, not on the shape of the tip.  Assumptions: half-space, no tear, D ≫ R.
    Source: Fakhouri, Hutchens & Crosby 2015; Shojaeifard & Bacca 2025, abstract.
    """
    return beta * E * np.asarray(depth, dtype=float) ** 2
