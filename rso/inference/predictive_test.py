"""Whether readings that took no part in a fit are predicted by it: the one posterior predictive check of all analyses.

    Σ = (F/b² + 12 I)⁻¹,   C = C_y + C_s + J Σ Jᵀ,   χ² = (y − f)ᵀ C⁻¹ (y − f),   z = fᵀ C⁻¹ (y − f) / √(fᵀ C⁻¹ f)
    p = 1 − (1 − min(P(F(n, m) > χ²/n), P(F(1, m) > z²)))²

F (d, d) is the Fisher information of the fit in the unit cube of the ranges, which count as a weak prior (12 I); b what
the fit has widened its errors by; C_y what is known of the errors of the readings y (n,), from m degrees of freedom;
C_s the error of the simulation; J (n, d) how the prediction f (n,) changes with the parameters.  Of a perfect model,
linear in the parameters, one of the two is as unlikely as the less likely one in the share p of all data sets.
z asks whether the curve is too high or too low as a whole: among the scatter of 70 readings χ² does not see a curve
that is 6 standard deviations too high, 40 % of the force.
Sources: Gelman, Meng & Stern, Stat. Sinica 6 (1996) 733; Šidák, J. Am. Stat. Assoc. 62 (1967) 626, for two tests.
For Gaussian errors the check is exact where z is a small part of χ².
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from rso.core.distributions import chi2_ppf, f_ppf
from rso.inference.identifiability import exceeded
from rso.inference.likelihood import MIN_ERROR_SHARE
from rso.inference.rules import RULES
from rso.inference.sloppy_directions import UNIFORM_PRECISION


@dataclass(frozen=True)
class PredictiveTest:
    """χ² of `points` readings, the share of perfect models that are missed by more, and `alone` that share without Σ.

    `level` is z: by how many standard deviations the readings as a whole are larger than the prediction.
    """

    chi2: float
    points: int
    p_value: float
    alone: float
    freedom: float = math.inf
    level: float = 0.0

    @property
    def missed(self) -> bool:
        """Whether noise, the simulation's error and what the fit leaves open do not explain the difference."""
        return self.p_value < RULES.missed_prediction_chance


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
    n = len(value)
    (chi2, level), bare = (
        _misses(value, predicted, C) for C in (errors if spread is None else errors + spread, errors)
    )
    return PredictiveTest(chi2, n, _share(chi2, level, n, freedom), _share(*bare, n, freedom), freedom, level)


def predictive_chi2(value: np.ndarray, predicted: np.ndarray, covariance: np.ndarray) -> float:
    """(y − f)ᵀ C⁻¹ (y − f) of readings y (n,) predicted as f (n,) with the covariance C (n, n)."""
    return _misses(value, predicted, covariance)[0]


def _misses(value: np.ndarray, predicted: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """χ² and z of readings (n,) and their prediction (n,)."""
    floor = MIN_ERROR_SHARE * (float(np.abs(value).max()) or 1.0)
    L = cholesky(covariance + floor**2 * np.eye(len(value)), lower=True)
    r, g = solve_triangular(L, np.column_stack([value - predicted, predicted]), lower=True).T
    size = float(np.linalg.norm(g))
    return float(r @ r), float(g @ r) / size if size > 0.0 else 0.0


def _share(chi2: float, level: float, points: int, freedom: float) -> float:
    """p: one reading has no level beside itself."""
    whole = exceeded(chi2, points, freedom)
    if points == 1:
        return whole
    least = min(whole, exceeded(level**2, 1, freedom))
    return -math.expm1(2.0 * math.log1p(-least)) if least < 1.0 else 1.0


def open_by(fisher: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """J Σ Jᵀ (n, n): what a fit with Fisher information F (d, d) leaves open of a prediction with slopes J (n, d)."""
    left: np.ndarray = jacobian @ np.linalg.solve(fisher + UNIFORM_PRECISION * np.eye(len(fisher)), jacobian.T)
    return left


def chi2_limit(points: int, confidence: float, freedom: float = math.inf) -> float:
    """The χ² above which p is below 1 − confidence, wherever the curve lies as a whole."""
    each = confidence if points == 1 else math.sqrt(confidence)
    if math.isinf(freedom):
        return float(chi2_ppf(each, points))
    return points * float(f_ppf(each, points, freedom))
