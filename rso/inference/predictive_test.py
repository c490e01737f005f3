"""Whether readings that took no part in a fit are predicted by it: the one posterior predictive check of all analyses.

    Σ = (F/b² + 12 I)⁻¹,   C = C_y + C_s + J Σ Jᵀ,   χ² = (y − f)ᵀ C⁻¹ (y − f),   p = P(F(n, m) > χ²/n)

F (d, d) is the Fisher information of the fit in the unit cube of the ranges, which count as a weak prior (12 I); b what
the fit has widened its errors by; C_y what is known of the errors of the readings y (n,), from m degrees of freedom;
C_s the error of the simulation; J (n, d) how the prediction f (n,) changes with the parameters.  Of a perfect model,
linear in the parameters, χ² is larger than measured in the share p of all data sets.
Source: Gelman, Meng & Stern, Stat. Sinica 6 (1996) 733; for Gaussian errors the check is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from rso.core.distributions import chi2_ppf, f_ppf
from rso.inference.identifiability import exceeded
from rso.inference.likelihood import SMALLEST
from rso.inference.sloppy_directions import UNIFORM

UNLIKELY = 0.05  # a perfect model is said to miss in this share of data sets


@dataclass(frozen=True)
class PredictiveTest:
    """χ² of `points` readings, the share of perfect models that leave more, and `alone` that share without Σ."""

    chi2: float
    points: int
    p_value: float
    alone: float
    freedom: float = math.inf

    @property
    def missed(self) -> bool:
        """Whether noise, the simulation's error and what the fit leaves open do not explain the difference."""
        return self.p_value < UNLIKELY


def predictive_test(
    value: np.ndarray,
    predicted: np.ndarray,
    errors: np.ndarray,
    spread: np.ndarray | None = None,
    freedom: float = math.inf,
) -> PredictiveTest:
    """Readings y (n,) against their prediction f (n,), with the covariance (n, n) of the errors of both.

    `spread` (n, n) is what the fit leaves open of f, J Σ Jᵀ; None: nothing.  The size of the errors is known from
    `freedom` degrees of freedom.  LinAlgError where a covariance is not positive definite.
    """
    n, alone = len(value), predictive_chi2(value, predicted, errors)
    chi2 = alone if spread is None else predictive_chi2(value, predicted, errors + spread)
    return PredictiveTest(chi2, n, exceeded(chi2, n, freedom), exceeded(alone, n, freedom), freedom)


def predictive_chi2(value: np.ndarray, predicted: np.ndarray, covariance: np.ndarray) -> float:
    """(y − f)ᵀ C⁻¹ (y − f) of readings y (n,) predicted as f (n,) with the covariance C (n, n)."""
    floor = SMALLEST * (float(np.abs(value).max()) or 1.0)
    L = cholesky(covariance + floor**2 * np.eye(len(value)), lower=True)
    r = solve_triangular(L, value - predicted, lower=True)
    return float(r @ r)


def open_by(fisher: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """J Σ Jᵀ (n, n): what a fit with Fisher information F (d, d) leaves open of a prediction with slopes J (n, d)."""
    left: np.ndarray = jacobian @ np.linalg.solve(fisher + UNIFORM * np.eye(len(fisher)), jacobian.T)
    return left


def chi2_limit(points: int, confidence: float, freedom: float = math.inf) -> float:
    """The χ² that a perfect model stays below with this confidence."""
    if math.isinf(freedom):
        return float(chi2_ppf(confidence, points))
    return points * float(f_ppf(confidence, points, freedom))
