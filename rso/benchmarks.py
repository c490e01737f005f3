"""Problems with exact answers, in the unit cube: for tests, for the documentation and for comparisons."""

from __future__ import annotations

import numpy as np

from rso.doe import Box

# Ishigami & Homma 1990 with a = 7, b = 0.1; variance terms written out in `ishigami_indices`.
ISHIGAMI_A, ISHIGAMI_B = 7.0, 0.1
BRANIN_MINIMUM = 0.39788735772973816  # = 5/(4π), at (x1, x2) = (−π, 12.275), (π, 2.275), (3π, 2.475)
# Area that the front dominates up to the reference point (1.1, 1.1): 1.1² − ∫₀¹ f2 df1.
ZDT1_HYPERVOLUME = 1.1**2 - 1 / 3
ZDT2_HYPERVOLUME = 1.1**2 - 2 / 3  # the same, whose f2 = 1 − f1²

BOREHOLE = Box(
    ("rw", "r", "Tu", "Hu", "Tl", "Hl", "L", "Kw"),
    ("m", "m", "m2/yr", "m", "m2/yr", "m", "m", "m/yr"),
    (0.05, 100.0, 63070.0, 990.0, 63.1, 700.0, 1120.0, 9855.0),
    (0.15, 50000.0, 115600.0, 1110.0, 116.0, 820.0, 1680.0, 12045.0),
    (False,) * 8,
)


def ishigami(X: np.ndarray) -> np.ndarray:
    """sin x1 + a sin² x2 + b x3⁴ sin x1 with x = π(2X − 1); X (n, 3)."""
    x = np.pi * (2 * np.asarray(X, float) - 1)
    return np.sin(x[:, 0]) + ISHIGAMI_A * np.sin(x[:, 1]) ** 2 + ISHIGAMI_B * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_indices() -> tuple[np.ndarray, np.ndarray]:
    """Exact first-order and total Sobol indices (3,) of :func:`ishigami`.

    V1 = ½(1 + bπ⁴/5)², V2 = a²/8, V13 = b²π⁸(1/18 − 1/50), V = V1 + V2 + V13 (Homma & Saltelli 1996).
    """
    a, b = ISHIGAMI_A, ISHIGAMI_B
    v1, v2, v13 = 0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    v = v1 + v2 + v13
    return np.array([v1, v2, 0.0]) / v, np.array([v1 + v13, v2, v13]) / v


def sobol_g(X: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Sobol's g-function Π_j (|4 x_j − 2| + a_j)/(1 + a_j); X (n, d), a (d,)."""
    a = np.asarray(a, float)
    return np.prod((np.abs(4 * np.asarray(X, float) - 2) + a) / (1 + a), axis=1)


def sobol_g_indices(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact first-order and total indices (d,): V_j = 1/(3(1 + a_j)²), V = Π(1 + V_j) − 1.

    S_j = V_j/V, T_j = V_j Π_{k≠j}(1 + V_k)/V (Saltelli & Sobol 1995).
    """
    v = 1 / (3 * (1 + np.asarray(a, float)) ** 2)
    total = np.prod(1 + v) - 1
    return v / total, v * np.prod(1 + v) / (1 + v) / total


def branin(X: np.ndarray) -> np.ndarray:
    """Branin's function of x1 = 15 X1 − 5, x2 = 15 X2; three minima of 5/(4π) (Dixon & Szegö 1978)."""
    x1, x2 = 15 * np.asarray(X, float)[:, 0] - 5, 15 * np.asarray(X, float)[:, 1]
    return (x2 - 5.1 / (4 * np.pi**2) * x1**2 + 5 / np.pi * x1 - 6) ** 2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(x1) + 10


def borehole(X: np.ndarray) -> np.ndarray:
    """Flow through a borehole in m³/yr (Worley 1987); X (n, 8) in the cube of BOREHOLE."""
    rw, r, Tu, Hu, Tl, Hl, L, Kw = BOREHOLE.from_unit(X).T
    logarithm = np.log(r / rw)
    return 2 * np.pi * Tu * (Hu - Hl) / (logarithm * (1 + 2 * L * Tu / (logarithm * rw**2 * Kw) + Tu / Tl))


def zdt1(X: np.ndarray) -> np.ndarray:
    """Objectives (n, 2) of ZDT1; front f2 = 1 − √f1 at X2 = ... = Xd = 0 (Zitzler, Deb & Thiele 2000, eq. 7)."""
    f1, g = _zdt(X)
    return np.column_stack([f1, g * (1 - np.sqrt(f1 / g))])


def zdt2(X: np.ndarray) -> np.ndarray:
    """Objectives (n, 2) of ZDT2; front f2 = 1 − f1² (Zitzler, Deb & Thiele 2000, eq. 8)."""
    f1, g = _zdt(X)
    return np.column_stack([f1, g * (1 - (f1 / g) ** 2)])


def zdt3(X: np.ndarray) -> np.ndarray:
    """Objectives (n, 2) of ZDT3; the front is five pieces of f2 = 1 − √f1 − f1 sin 10πf1 (same source, eq. 9)."""
    f1, g = _zdt(X)
    return np.column_stack([f1, g * (1 - np.sqrt(f1 / g) - f1 / g * np.sin(10 * np.pi * f1))])


def zdt3_hypervolume(n: int = 2**20) -> float:
    """Area that the front of ZDT3 dominates up to (1.1, 1.1): ∫ 1.1 − min_{s ≤ f1} f2(s) df1, by n midpoints (1e-6)."""
    f1 = 1.1 * (np.arange(n) + 0.5) / n
    f2 = np.where(f1 <= 1, 1 - np.sqrt(f1) - f1 * np.sin(10 * np.pi * f1), np.inf)
    return float(np.mean(1.1 - np.minimum(np.minimum.accumulate(f2), 1.1)) * 1.1)


def mooney_rivlin3(strain: np.ndarray, stress: np.ndarray, weighting: str) -> tuple[np.ndarray, float]:
    """Least-squares (C10, C01, C11) of uniaxial tension and the sum of squares that it leaves.

    W = C10 (I1 − 3) + C01 (I2 − 3) + C11 (I1 − 3)(I2 − 3), incompressible: nominal stress
    P = 2 (λ − λ⁻²) [C10 + C11 (I2 − 3) + (C01 + C11 (I1 − 3))/λ] with λ = 1 + strain, linear in the constants.
    `weighting` 'absolute' minimises Σ(P̂ − P)², 'relative' Σ((P̂ − P)/P)². Stress (n,) and constants share a unit.
    """
    if weighting not in ("absolute", "relative"):
        raise ValueError(f"mooney_rivlin3: unknown weighting {weighting!r}; choose absolute or relative")
    lam, P = 1 + np.asarray(strain, float), np.asarray(stress, float)
    I1, I2 = lam**2 + 2 / lam, 2 * lam + lam**-2
    A = 2 * (lam - lam**-2)[:, None] * np.column_stack([np.ones_like(lam), 1 / lam, I2 - 3 + (I1 - 3) / lam])
    w = 1 / P if weighting == "relative" else np.ones_like(P)
    C = np.linalg.lstsq(A * w[:, None], P * w, rcond=None)[0]
    return C, float(np.sum(((A @ C - P) * w) ** 2))


def _zdt(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    X = np.asarray(X, float)
    return X[:, 0], 1 + 9 * X[:, 1:].mean(axis=1)


def indentation(
    h: np.ndarray, mu: np.ndarray, D1: np.ndarray, radius: float = 3.0, thickness: float | None = None
) -> np.ndarray:
    """Force (N) of a rigid sphere (mm) pressed by h (mm) into an elastic half space or a bonded layer.

    F = 4/3 E* √R h^(3/2) ψ(χ, ν),  E* = E/(1 − ν²) = 4μ (6 + μD1)/(6 + 4μD1),  K = 2/D1,  χ = √(Rh)/thickness,

    with mu in MPa, D1 in 1/MPa (0: incompressible); arguments broadcast. ψ = 1 for a half space; the layer's
    ψ is the fourth-order series of Dimitriadis et al. (Biophys. J. 82, 2002, 2798) for a bonded layer, in
    which ν enters differently at each depth, so that forces at several depths determine mu and D1. (Its last
    coefficient at ν = 1/2 is −0.0975; their incompressible special case prints +0.0975.)

    Assumptions: small strain, frictionless, h << R, and h << thickness for the layer. Stress scales out
    exactly: F(h; s μ, D1/s) = s F(h; μ, D1).
    """
    h, mu, D1 = (np.asarray(v, float) for v in (h, mu, D1))
    c = mu * D1
    modulus = 4 * mu * (6 + c) / (6 + 4 * c)
    force = 4 / 3 * modulus * np.sqrt(radius) * h**1.5
    if thickness is None:
        return force
    nu = (3 - c) / (6 + c)
    a = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1 - nu)
    b = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1 - nu)
    x = np.sqrt(radius * h) / thickness
    series = (
        1
        - 2 * a / np.pi * x
        + 4 * a**2 / np.pi**2 * x**2
        - 8 / np.pi**3 * (a**3 + 4 * np.pi**2 / 15 * b) * x**3
        + 16 * a / np.pi**4 * (a**3 + 3 * np.pi**2 / 5 * b) * x**4
    )
    return force * series
