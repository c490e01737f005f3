"""Closed forms used as oracles: they share no code with the solver."""

from __future__ import annotations

import math

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


# ----------------------------------------------------------------------- homogeneous tests, incompressible, (n,)
#
# A test stretches one direction by λ and leaves λ^side to the free one: uniaxial (λ, λ^-½, λ^-½), planar (λ, 1, 1/λ),
# equibiaxial (λ, λ, λ⁻²).  Free faces carry no load, P is force per undeformed area of the stretched face (MPa).

SIDE = {"uniaxial": -0.5, "planar": -1.0, "equibiaxial": -2.0}


def first_invariants(test: str, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """I₁ and I₂ of an incompressible homogeneous test at stretches λ.

    Uniaxial λ² + 2/λ and 2λ + λ⁻²; planar 1 + λ² + λ⁻² for both; equibiaxial 2λ² + λ⁻⁴ and λ⁴ + 2λ⁻².
    Raises KeyError for a test that is none of them.
    """
    x = np.asarray(stretch, dtype=float)
    return {
        "uniaxial": (x**2 + 2 / x, 2 * x + x**-2),
        "planar": (1 + x**2 + x**-2, 1 + x**2 + x**-2),
        "equibiaxial": (2 * x**2 + x**-4, x**4 + 2 * x**-2),
    }[test]


def nominal_neo_hooke(test: str, stretch: np.ndarray, mu: float) -> np.ndarray:
    """P = μ(λ − λ^(2 side − 1)) (MPa).  Source: thesis eq. 1.14–1.33 with C₀₁ = 0; Holzapfel 2000, §6.5."""
    x = np.asarray(stretch, dtype=float)
    return mu * (x - x ** (2 * SIDE[test] - 1))


def nominal_mooney_rivlin(test: str, stretch: np.ndarray, mu: float, C01: float) -> np.ndarray:
    """P = 2(λ − λ^(2 side − 1))(C₁₀ + C₀₁ y), y = 1/λ, 1, λ² for uniaxial, planar, equibiaxial, C₁₀ = μ/2 − C₀₁ (MPa).

    Source: thesis eq. 1.14–1.33; Treloar 1975, §5.4.
    """
    x = np.asarray(stretch, dtype=float)
    y = {"uniaxial": 1 / x, "planar": np.ones_like(x), "equibiaxial": x**2}[test]
    return 2 * (x - x ** (2 * SIDE[test] - 1)) * (mu / 2 - C01 + C01 * y)


def nominal_yeoh(test: str, stretch: np.ndarray, mu: float, C20: float, C30: float) -> np.ndarray:
    """P = 2(λ − λ^(2 side − 1))(μ/2 + 2C₂₀ (I₁ − 3) + 3C₃₀ (I₁ − 3)²) (MPa).  Source: Yeoh 1993."""
    x = np.asarray(stretch, dtype=float)
    growth = first_invariants(test, x)[0] - 3
    return 2 * (x - x ** (2 * SIDE[test] - 1)) * (mu / 2 + 2 * C20 * growth + 3 * C30 * growth**2)


def nominal_ogden(test: str, stretch: np.ndarray, mu: float, alpha: tuple, share: tuple) -> np.ndarray:
    """P = Σᵢ (2μᵢ/αᵢ)(λ^(αᵢ − 1) − λ^(side αᵢ − 1)), μᵢ = shareᵢ μ (MPa).  Source: Ogden 1972; thesis eq. 1.14–1.33."""
    x = np.asarray(stretch, dtype=float)
    return sum(2 * s * mu / a * (x ** (a - 1) - x ** (SIDE[test] * a - 1)) for a, s in zip(alpha, share, strict=True))


def nominal_fibre(stretch: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """What fibres along the stretched direction add to P, 2λ k₁ x exp(k₂x²) with x = ⟨λ² − 1⟩ (MPa), in any test.

    Source: Holzapfel, Gasser & Ogden 2000, eq. 65.
    """
    x = np.asarray(stretch, dtype=float)
    pull = np.maximum(x**2 - 1, 0)
    return 2 * x * k1 * pull * np.exp(k2 * pull**2)


def relaxation(time: np.ndarray, g: tuple, tau: tuple) -> np.ndarray:
    """Share of the isochoric stress left at a time (s) after a sudden strain, 1 − Σ gᵢ (1 − exp(−t/τᵢ)).

    Source: Holzapfel 2000, §6.10; Simo & Hughes 1998, §10.2.
    """
    t = np.asarray(time, dtype=float)
    return 1 - sum((a * -np.expm1(-t / b) for a, b in zip(g, tau, strict=True)), np.zeros_like(t))


def softening(energy: np.ndarray, largest: np.ndarray, r_inverse: float, m: float, beta: float) -> np.ndarray:
    """η = 1 − (1/r) erf(⟨W_max − W⟩/(m + β W_max)) at isochoric energies W, W_max (MPa).

    Source: Ogden & Roxburgh 1999, with β as in Abaqus and ANSYS.
    """
    W, most = np.broadcast_arrays(np.asarray(energy, dtype=float), np.asarray(largest, dtype=float))
    return 1 - r_inverse * np.vectorize(math.erf)(np.maximum(most - W, 0) / (m + beta * most))
