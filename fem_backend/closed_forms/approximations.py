"""Published approximations for layers on a rigid base, and for pucks between plates; small strain unless said."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ive

from fem_backend.closed_forms.half_space import hertz_force, sneddon_cone, sneddon_flat

GARCIA_COEFFICIENTS = {  # of powers 0 to 4 of x, a length of the contact over the thickness
    "ball": (1.0, 1.133, 1.497, 1.469, 0.755),
    "flat": (1.0, 1.133, 1.283, 0.598, -0.291),
    "cone": (1.0, 0.721, 0.650, 0.491, 0.225),
}
"""Coefficients of :func:`garcia`."""


def dimitriadis(
    depth: np.ndarray, radius: float, thickness: float, E: float, nu: float, base: str = "bonded"
) -> np.ndarray:
    """Hertz times 1 − (2α/π)χ + (4α²/π²)χ² − (8/π³)(α³ + (4π²/15)β)χ³ + (16α/π⁴)(α³ + (3π²/5)β)χ⁴, χ = √(R h)/t; N.

    Bonded α = −(1.2876 − 1.4678ν + 1.3442ν²)/(1 − ν), β = (0.6387 − 1.0277ν + 1.5164ν²)/(1 − ν); "slip" is their layer
    that is not bonded, α = −0.347(3 − 2ν)/(1 − ν), β = 0.056(5 − 2ν)/(1 − ν), which is stiffer than a frictionless one.
    Depth h, radius R, thickness t in mm.  Assumptions: a ball without friction, χ ≤ 1; its χ² term is that of a flat
    end, 6/7 of a ball's, so that it is 4 % low at χ = 0.5 and 11 to 30 % at χ = 1 (bonded).
    Source: Dimitriadis et al. 2002; for ν = 0.5 their eq. 12 prints χ⁴ with the other sign than the general series.
    """
    if base == "bonded":
        a = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1.0 - nu)
        b = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1.0 - nu)
    else:
        a, b = -0.347 * (3.0 - 2.0 * nu) / (1.0 - nu), 0.056 * (5.0 - 2.0 * nu) / (1.0 - nu)
    p, h = math.pi, np.asarray(depth, dtype=float)
    x = np.sqrt(radius * h) / thickness
    series = 1.0 - 2.0 * a / p * x + 4.0 * a**2 / p**2 * x**2
    series -= 8.0 / p**3 * (a**3 + 4.0 * p**2 / 15.0 * b) * x**3
    return hertz_force(h, radius, E, nu) * (series + 16.0 * a / p**4 * (a**3 + 3.0 * p**2 / 5.0 * b) * x**4)


def garcia(shape: str, depth: np.ndarray, size: float, thickness: float, E: float) -> np.ndarray:
    """F (N) of a bonded incompressible layer: half-space force times a polynomial of degree 4 in x, N.

    shape "ball", size R (mm): x = √(R h)/t, 1 + 1.133 x + 1.497 x² + 1.469 x³ + 0.755 x⁴;
    "flat", radius a (mm): x = a/t, 1 + 1.133 x + 1.283 x² + 0.598 x³ − 0.291 x⁴;
    "cone", half angle α (degrees): x = h tan α/t, 1 + 0.721 x + 0.650 x² + 0.491 x³ + 0.225 x⁴, whose first term is
    twice that of Gavara & Chadwick 2012, eq. 3, and what the integral equation gives.
    Depth h, thickness t in mm.  Assumptions: no friction, x ≤ 1.  Raises KeyError for another shape.
    Source: Garcia & Garcia 2018.
    """
    h = np.asarray(depth, dtype=float)
    if shape == "flat":
        x, half_space = np.full_like(h, size / thickness), sneddon_flat(h, size, E, 0.5)
    elif shape == "cone":
        x, half_space = h * math.tan(math.radians(size)) / thickness, sneddon_cone(h, size, E, 0.5)
    else:
        x, half_space = np.sqrt(size * h) / thickness, hertz_force(h, size, E, 0.5)
    return half_space * np.polynomial.polynomial.polyval(x, GARCIA_COEFFICIENTS[shape])


def long_ball(depth: np.ndarray, radius: float, thickness: float, E: float) -> np.ndarray:
    """F = (16/9) E √R h^{3/2}/ψ (N), ψ = (1 + 2.3ω)/(1 + 1.15ω^{1/3} + αω + βω²), ω = (R h/t²)^{3/2}; large strain.

    α = 10.05 − 0.63 √(t/R) (3.1 + t²/R²), β = 4.8 − 4.23 t²/R².  Depth h, radius R, thickness t in mm.
    Assumptions: bonded incompressible neo-Hookean layer, no friction at the ball, 0.3 ≤ R/t ≤ 12.7 and
    h/t ≤ min(0.6, R/t); a fit to finite elements.  Source: Long, Hall, Wu & Hui 2011.
    """
    h, q = np.asarray(depth, dtype=float), thickness / radius
    w = (radius * h / thickness**2) ** 1.5
    alpha, beta = 10.05 - 0.63 * math.sqrt(q) * (3.1 + q**2), 4.8 - 4.23 * q**2
    return hertz_force(h, radius, E, 0.5) * (1.0 + 1.15 * np.cbrt(w) + alpha * w + beta * w**2) / (1.0 + 2.3 * w)


def confined_ball(
    depth: np.ndarray, radius: float, thickness: float, E: float, nu: float, base: str = "bonded"
) -> np.ndarray:
    """F = π R h² M/t (N), a² = 2R h, of a thin layer under a ball; bonded and ν = 0.5 F = (2π/3) E R² h³/t³, a² = 4R h.

    M = E(1 − ν)/((1 + ν)(1 − 2ν)) bonded, M = E/(1 − ν²) on a frictionless base.  Depth h, radius R, thickness t in mm.
    Assumptions: no friction at the ball; bonded and ν near 0.5 also a/t ≫ (1 − 2ν)^(-1/2).
    Source: Johnson 1985, §5.8; Jaffar 1989 for ν = 0.5.
    """
    h = np.asarray(depth, dtype=float)
    if base == "bonded" and nu == 0.5:
        return 2.0 * math.pi / 3.0 * E * radius**2 * h**3 / thickness**3
    M = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) if base == "bonded" else E / (1.0 - nu**2)
    return math.pi * radius * h**2 * M / thickness


# ----------------------------------------------------------------------------------------- pucks between plates


def gent_lindley(depth: np.ndarray, radius: float, height: float, E: float, nu: float = 0.5) -> np.ndarray:
    """F = π R² E_a/3 · (λ⁻² − λ) (N), 1/E_a = 1/(E(1 + 2S²)) + 1/K, S = R/2H, λ = 1 − h/H: puck bonded to both plates.

    Depth h, radius R, height H in mm; K = E/(3(1 − 2ν)), no such term for ν = 0.5.  Assumptions: ν ≥ 0.49,
    compression up to about 20 %; within 12 % of linear finite elements for S from 1/8 to 4.
    Source: Gent & Lindley 1959.
    """
    S = radius / (2.0 * height)
    apparent = 1.0 / (1.0 / (E * (1.0 + 2.0 * S**2)) + 3.0 * (1.0 - 2.0 * nu) / E)
    x = 1.0 - np.asarray(depth, dtype=float) / height
    return math.pi * radius**2 * apparent / 3.0 * (x**-2 - x)


def bonded_puck(depth: np.ndarray, radius: float, height: float, E: float, nu: float) -> np.ndarray:
    """F = π R² E_a h/H (N), E_a = E + (M − E)(1 − (2/β) I₁(β)/I₀(β)), β = (R/H) √(12(1 − 2ν)), of a bonded puck.

    M = E(1 − ν)/((1 + ν)(1 − 2ν)).  Depth h, radius R, height H in mm; both plates are bonded.  ν = 0.5 is the limit
    E_a = E (1 + 2S²), S = R/2H.
    Assumptions: small strain.  Against linear finite elements, S from 1/8 to 4: within 3 % for S ≥ 0.5, 6 % below.
    Source: Chalhoub & Kelly 1990 for discs with ν near 0.5; M − E and the β of every ν, which give the tall and the
    flat limit, are this project's.
    """
    S = radius / (2.0 * height)
    if nu == 0.5:
        apparent = E * (1.0 + 2.0 * S**2)
    else:
        M, b = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)), 2.0 * S * math.sqrt(12.0 * (1.0 - 2.0 * nu))
        apparent = E + (M - E) * (1.0 - 2.0 / b * ive(1, b) / ive(0, b))
    return math.pi * radius**2 * apparent * np.asarray(depth, dtype=float) / height
