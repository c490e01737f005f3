"""Homogeneous tests of the hyperelastic laws, relaxation and softening.

A test stretches one direction by λ and leaves λ^side to the free one: uniaxial (λ, λ^-½, λ^-½), planar (λ, 1, 1/λ),
equibiaxial (λ, λ, λ⁻²).  Free faces carry no load, P is force per undeformed area of the stretched face (MPa).
Incompressible and of shape (n,) where nothing else is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

SIDE_EXPONENT = {"uniaxial": -0.5, "planar": -1.0, "equibiaxial": -2.0}  # of λ, the stretch of the free faces


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
    return mu * (x - x ** (2 * SIDE_EXPONENT[test] - 1))


def nominal_mooney_rivlin(test: str, stretch: np.ndarray, mu: float, C01: float) -> np.ndarray:
    """P = 2(λ − λ^(2 side − 1))(C₁₀ + C₀₁ y), y = 1/λ, 1, λ² for uniaxial, planar, equibiaxial, C₁₀ = μ/2 − C₀₁ (MPa).

    Source: thesis eq. 1.14–1.33; Treloar 1975, §5.4.
    """
    x = np.asarray(stretch, dtype=float)
    y = {"uniaxial": 1 / x, "planar": np.ones_like(x), "equibiaxial": x**2}[test]
    return 2 * (x - x ** (2 * SIDE_EXPONENT[test] - 1)) * (mu / 2 - C01 + C01 * y)


def nominal_yeoh(test: str, stretch: np.ndarray, mu: float, C20: float, C30: float) -> np.ndarray:
    """P = 2(λ − λ^(2 side − 1))(μ/2 + 2C₂₀ (I₁ − 3) + 3C₃₀ (I₁ − 3)²) (MPa).  Source: Yeoh 1993."""
    x = np.asarray(stretch, dtype=float)
    growth = first_invariants(test, x)[0] - 3
    return 2 * (x - x ** (2 * SIDE_EXPONENT[test] - 1)) * (mu / 2 + 2 * C20 * growth + 3 * C30 * growth**2)


def nominal_ogden(test: str, stretch: np.ndarray, mu: float, alpha: tuple, share: tuple) -> np.ndarray:
    """P = Σᵢ (2μᵢ/αᵢ)(λ^(αᵢ − 1) − λ^(side αᵢ − 1)), μᵢ = shareᵢ μ (MPa).  Source: Ogden 1972; thesis eq. 1.14–1.33."""
    x = np.asarray(stretch, dtype=float)
    return sum(
        2 * s * mu / a * (x ** (a - 1) - x ** (SIDE_EXPONENT[test] * a - 1)) for a, s in zip(alpha, share, strict=True)
    )


def nominal_fibre(stretch: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """What fibres along the stretched direction add to P, 2λ k₁ x exp(k₂x²) with x = ⟨λ² − 1⟩ (MPa), in any test.

    Source: Holzapfel, Gasser & Ogden 2000, eq. 65.
    """
    x = np.asarray(stretch, dtype=float)
    pull = np.maximum(x**2 - 1, 0)
    return 2 * x * k1 * pull * np.exp(k2 * pull**2)


def relaxed_share(time: np.ndarray, g: tuple, tau: tuple) -> np.ndarray:
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


def nominal_compressible(
    stretch: np.ndarray, nominal: Callable[[np.ndarray], np.ndarray], D1: float
) -> tuple[np.ndarray, np.ndarray]:
    """Uniaxial P (MPa) and J of a law W̄ + (J − 1)²/D₁ at stretches λ, from its incompressible `nominal` P̄(λ̄).

    P = J^(-1/3) P̄(λ̄) with λ̄ = J^(-1/3) λ and the J of free sides, 2(J − 1)/D₁ = (λ̄/3J) P̄(λ̄).  It is what a cylinder
    between frictionless plates bears, exactly.  Raises ValueError where no J in (0, 10) fits.
    Source: Holzapfel 2000, eq. 6.85–6.91, with the energy split into isochoric and volumetric parts.
    """
    x = np.asarray(stretch, dtype=float)
    low, high = np.full_like(x, 1e-3), np.full_like(x, 10.0)

    def excess(J: np.ndarray) -> np.ndarray:
        bar = J ** (-1.0 / 3.0) * x
        return 2.0 * (J - 1.0) / D1 - bar / (3.0 * J) * nominal(bar)

    if np.any(excess(low) > 0.0) or np.any(excess(high) < 0.0):
        raise ValueError("no volume ratio between 0.001 and 10 leaves the sides free of load")
    for _ in range(60):  # bisection: each halves an interval of 10
        middle = 0.5 * (low + high)
        above = excess(middle) > 0.0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    J = 0.5 * (low + high)
    bar = J ** (-1.0 / 3.0) * x
    return J ** (-1.0 / 3.0) * nominal(bar), J
