"""Quantiles and tails of χ², F, Student's t and the Gaussian: scipy.stats takes half a second to import for them.

Arguments are numbers or arrays; degrees of freedom need not be whole numbers.
Source: NIST Digital Library of Mathematical Functions, §8.2 (incomplete gamma) and §8.17 (incomplete beta function).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import special

Values = Any  # a number or an array of them


def chi2_cdf(x: Values, ν: Values) -> Values:
    """P(χ²_ν <= x) = P(ν/2, x/2)."""
    return special.gammainc(np.multiply(0.5, ν), 0.5 * np.maximum(x, 0.0))


def chi2_sf(x: Values, ν: Values) -> Values:
    """P(χ²_ν > x) = Q(ν/2, x/2)."""
    return special.gammaincc(np.multiply(0.5, ν), 0.5 * np.maximum(x, 0.0))


def chi2_ppf(p: Values, ν: Values) -> Values:
    """The x with P(χ²_ν <= x) = p."""
    return 2.0 * special.gammaincinv(np.multiply(0.5, ν), p)


def gamma_logsf(x: Values, k: Values) -> Values:
    """ln P(sum of k exponential variables of mean 1 > x); −∞ where that is below the smallest number."""
    with np.errstate(divide="ignore"):
        return np.log(special.gammaincc(k, np.maximum(x, 0.0)))


def gamma_ppf(p: Values, k: Values) -> Values:
    """The x with P(sum of k exponential variables of mean 1 <= x) = p."""
    return special.gammaincinv(k, p)


def f_sf(x: Values, a: Values, b: Values) -> Values:
    """P(F > x) with a and b degrees of freedom."""
    return special.fdtrc(a, b, x)


def f_ppf(p: Values, a: Values, b: Values) -> Values:
    """The x with P(F <= x) = p, with a and b degrees of freedom."""
    return special.fdtri(a, b, p)


def t_ppf(p: Values, ν: Values) -> Values:
    """The x with P(t_ν <= x) = p."""
    return special.stdtrit(ν, p)


def student(freedom: float, level: float = 0.9) -> float:
    """How much wider an interval is with errors known from so many degrees of freedom: quantile of t over normal."""
    tail = 0.5 * (1.0 + level)
    return float(t_ppf(tail, freedom) / normal_ppf(tail)) if np.isfinite(freedom) else 1.0


def normal_cdf(x: Values) -> Values:
    """Φ(x)."""
    return special.ndtr(x)


def normal_ppf(p: Values) -> Values:
    """Φ⁻¹(p)."""
    return special.ndtri(p)


def normal_pdf(x: Values) -> Values:
    """φ(x) = e^{−x²/2}/√(2π)."""
    return np.exp(-0.5 * np.square(x)) / np.sqrt(2.0 * np.pi)


def normal_logpdf(x: Values, mean: Values, sd: Values) -> Values:
    """ln φ((x − mean)/sd) − ln sd."""
    return -0.5 * np.square((x - np.asarray(mean)) / sd) - np.log(sd) - 0.5 * np.log(2.0 * np.pi)
