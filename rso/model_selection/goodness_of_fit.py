"""Is a level good enough?  One test of everything that it leaves over, with one chance of a false alarm.

    S_0 = χ² of the fitted curves,   S_1, S_2, … = NRMSE of each of them     (and the same of curves kept to select)

χ² counts every reading alike, so that one smooth wave through all of them is diluted; NRMSE counts what a reader sees,
and a wave is most of it, but a small error at small forces is nothing.  A level passes only if it passes all of them.
What they are of a perfect model is simulated: B data sets with this noise and this numerical error, fitted like the
measured one.  With the measured one first, i = 0 … B,

    p_ji = #{k : S_jk >= S_ji}/(1 + B),    q_i = min_j p_ji,    p = #{i : q_i <= q_0}/(1 + B)

so that a perfect model has p < α in the share α of all data sets, however the criteria are correlated.  The limit of a
single criterion is the largest S_ji that passes; a perfect model is beyond *any* limit in the share α, and beyond a
given one in less (`share`).
Source: Westfall & Young, Resampling-Based Multiple Testing, Wiley 1993, §2.3 (min P); Beran, J. Am. Stat. Assoc. 83
(1988) 679 (balanced limits); Davison & Hinkley, Bootstrap Methods, 1997, §4.2.3 (the data set itself counts as one).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky

from rso.doe import Box
from rso.inference import Data, Fit, Misfit, Model, levenberg_marquardt, split_common_errors

FIT_CONFIDENCE = 0.95  # of the joint test: perfect models exceed its limits in one data set of twenty
N_REFITTED_DATA_SETS = 400  # simulated data sets: a p-value of 0.05 is then known to 0.01


@dataclass(frozen=True)
class GoodnessOfFit:
    """χ² of curves, the `limit` that it must stay below, the share of simulated χ² at least as large (`p_value`).

    `expected` is the mean of the simulated ones, of which there are `draws`.
    """

    chi2: float
    expected: float
    limit: float
    p_value: float
    points: int
    draws: int = N_REFITTED_DATA_SETS


@dataclass(frozen=True)
class CurveError:
    """NRMSE of one curve, the threshold that noise alone sets, the share of simulated ones at least as large."""

    name: str
    role: str
    nrmse: float
    limit: float
    p_value: float = 1.0


@dataclass(frozen=True)
class Goodness:
    """The verdict on a level: `p_value` of all criteria together, and each of them with its limit.

    A perfect model has a smaller `p_value` than 1 − `confidence` in that share of all data sets; it is beyond each
    single limit in about the `share`.
    """

    p_value: float
    share: float
    checks: tuple[GoodnessOfFit, ...]
    errors: tuple[CurveError, ...]
    confidence: float = FIT_CONFIDENCE

    @property
    def passes(self) -> bool:
        """Nothing is beyond its limit."""
        return self.p_value >= 1.0 - self.confidence


@dataclass(frozen=True, eq=False)
class Simulated:
    """Data sets of a perfect model: refitted points X (b, d), their χ² (b,), and by curve the NRMSE (b,)."""

    X: np.ndarray
    chi2: np.ndarray
    nrmse: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Left:
    """What a level leaves of some curves: `residual` f − y (n,) by `misfit`, and the same of a perfect model."""

    residual: np.ndarray
    misfit: Misfit
    simulated: Simulated
    roles: tuple[str, ...]


# ------------------------------------------------------------------------------------------------------ the verdict


def assess(parts: Sequence[Left], confidence: float = FIT_CONFIDENCE) -> Goodness:
    """χ² of each part and NRMSE of each of its curves as one test; the draws of all parts are the same data sets."""
    S = []
    for part in parts:
        S.append(np.append(np.sum(part.misfit.white(part.residual) ** 2), part.simulated.chi2))
        value = np.concatenate([v.value for v in part.misfit.data])
        reached = norms(part.misfit.data, part.residual[None], value[None])
        S += [np.append(a, s) for a, s in zip(reached, part.simulated.nrmse, strict=True)]
    p, limits, each, share = combined_p_value(np.array(S), 1.0 - confidence)
    checks, errors, row = [], [], 0
    for part in parts:
        s, chi2 = part.simulated, float(S[row][0])
        checks.append(
            GoodnessOfFit(chi2, float(s.chi2.mean()), float(limits[row]), float(each[row]), part.misfit.n, len(s.chi2))
        )
        for k, (v, role) in enumerate(zip(part.misfit.data, part.roles, strict=True), row + 1):
            errors.append(CurveError(v.name, role, float(S[k][0]), float(limits[k]), float(each[k])))
        row += 1 + len(part.roles)
    return Goodness(p, share, tuple(checks), tuple(errors), confidence)


def combined_p_value(S: np.ndarray, alpha: float) -> tuple[float, np.ndarray, np.ndarray, float]:
    """p of all criteria S (m, 1 + B) at once, their limits (m,), the p-value of each (m,), the share beyond each limit.

    Column 0 is measured, the others are simulated.  p >= α exactly where no criterion is beyond its limit.
    """
    total = S.shape[1]
    ordered = np.sort(S, axis=1)
    p = np.stack([total - np.searchsorted(row, s, side="left") for row, s in zip(ordered, S, strict=True)]) / total
    q = p.min(axis=0)
    joint = np.array([np.sum(q <= v) for v in q]) / total
    beyond = q[joint < alpha]
    share = float(beyond.max()) if len(beyond) else 0.0
    limits = np.array([row[at > share].max() for row, at in zip(S, p, strict=True)])
    return float(joint[0]), limits, p[:, 0], share


# ------------------------------------------------------------------------------------------------------ perfect models


def bootstrap_refits(misfit: Misfit, fit: Fit, seed: int, draws: int = N_REFITTED_DATA_SETS) -> Simulated:
    """Parametric bootstrap: y* = f(x̂) + ε with ε ~ N(0, C), refitted from x̂ within the box.

    Where the size of C was itself taken from m degrees of freedom it is drawn again with each data set: the errors are
    then ε/√(χ²_m/m), which is what both χ² by such a C and an NRMSE of noise that it only estimates scatter by.
    Source: Efron & Tibshirani 1993, §6.5.  All data sets are refitted at once: an axis that does not move says which.
    """
    d, rng = misfit.model.box.d, np.random.default_rng([seed, 11])
    f = misfit.model.predict(fit.x[None])[0]
    noise = _noise(misfit.data, draws, rng)
    spare = Box(
        (*misfit.model.box.names, ""),
        (*misfit.model.box.units, ""),
        (*misfit.model.box.low, 0.0),
        (*misfit.model.box.high, 1.0),
        (*misfit.model.box.log, False),
    )

    def shifted(X: np.ndarray) -> np.ndarray:
        return misfit.model.predict(X[:, :d]) - noise[np.rint(X[:, d] * (draws - 1)).astype(int)]

    start = np.column_stack([np.repeat(fit.x[None], draws, axis=0), np.arange(draws) / max(draws - 1, 1)])
    pieces = np.split(f, np.cumsum([len(v.value) for v in misfit.data])[:-1])
    perfect = tuple(replace(v, value=p) for v, p in zip(misfit.data, pieces, strict=True))
    many = replace(misfit, model=Model(spare, shifted), data=perfect)
    X = levenberg_marquardt(many, start, np.arange(d + 1) < d)
    residual = shifted(X) - f
    return Simulated(X[:, :d], np.sum(misfit.white(residual) ** 2, axis=1), norms(misfit.data, residual, f + noise))


def simulate_elsewhere(model: Model, data: Sequence[Data], fit: Fit, X: np.ndarray, seed: int) -> Simulated:
    """The same for curves that are not fitted: y* = f(x̂) + ε, predicted by the refitted points `X` (b, d)."""
    rng = np.random.default_rng([seed, 12])
    f = model.predict(fit.x[None])[0]
    misfit = Misfit(model, tuple(data))
    noise = _noise(data, len(X), rng)
    residual = model.predict(X) - f - noise
    return Simulated(X, np.sum(misfit.white(residual) ** 2, axis=1), norms(data, residual, f + noise))


def norms(data: Sequence[Data], residual: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, ...]:
    """RMSE over |mean| of each curve, from residuals (b, n) and values (b, n)."""
    ends = np.cumsum([len(v.value) for v in data])[:-1]
    pairs = zip(np.split(residual, ends, axis=1), np.split(value, ends, axis=1), strict=True)
    return tuple(np.sqrt(np.mean(r**2, axis=1)) / np.maximum(np.abs(y.mean(axis=1)), 1e-300) for r, y in pairs)


def _noise(data: Sequence[Data], draws: int, rng: np.random.Generator) -> np.ndarray:
    """Errors (draws, n) of all curves; those of which the size is known from few readings are Student's."""
    parts, (alone, V) = [], split_common_errors(data)
    for d in alone:
        n = len(d.value)
        tiny = (1e-9 * (float(np.abs(d.value).max()) or 1.0)) ** 2
        drawn = rng.standard_normal((draws, n)) @ cholesky(d.covariance + tiny * np.eye(n), lower=True).T
        if math.isfinite(d.freedom):
            drawn = drawn / np.sqrt(rng.chisquare(d.freedom, (draws, 1)) / d.freedom)
        parts.append(drawn)
    whole = np.concatenate(parts, axis=1)
    return whole + rng.standard_normal((draws, V.shape[1])) @ V.T if V.size else whole
