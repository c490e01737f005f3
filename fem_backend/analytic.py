"""Closed forms used as oracles: they share no code with the solver."""

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


def sneddon_sphere(contact_radius: np.ndarray, radius: float, E: float, nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth h = (a/2) ln((R+a)/(R−a)) (mm) and force F (N) at contact radius a (mm) for the true sphere.

    F = E/(1 − ν²) · [(a² + R²)/2 · ln((R+a)/(R−a)) − a R].  Assumptions as Hertz without a ≪ R for the profile
    (strain still small).  Source: Sneddon 1965, eq. 6.13–6.15.
    """
    a, R = np.asarray(contact_radius), radius
    log = np.log((R + a) / (R - a))
    return 0.5 * a * log, E / (1.0 - nu**2) * (0.5 * (a**2 + R**2) * log - a * R)
