"""How much: the gap on curves that took no part in finding its cause, before, after a mere re-fit, with the cause.

    G(M) = mean over curves of (y − f_M)ᵀ C⁻¹ (y − f_M) / n,      floor: its expectation where M is true, 1

and the same as a root mean square in newtons.  C is the noise of the curve, with its gain and contact point, and what
the parameters' own uncertainty adds is left in G: a model that does not know predicts badly.  Whether a curve is missed
is asked with that uncertainty (:mod:`rso.inference.predictive_test`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.discrepancy.evidence.gaussian_mixture import Posterior
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import SurfaceProfile

N_PREDICTIVE_DRAWS = 60  # of the parameters, evenly picked from those of the posterior
N_BOOTSTRAPS = 2000  # resamples of the curves, whose quantiles are the interval


@dataclass(frozen=True)
class Gap:
    """G and root mean square (N; mm for a profile) of one held-out curve under three models.

    `change_sd` is what noise makes of before − with_cause: 2 √(δᵀ C⁻¹ δ) / n for predictions that differ by δ.  `cause`
    are the effects of the last model, chosen without this curve.  `p_values` are those of the posterior predictive
    check under each model.
    """

    curve: str
    unit: str
    before: float
    refit_only: float
    with_cause: float
    rms: tuple[float, float, float]
    change_sd: float = 0.0
    cause: tuple[str, ...] = ()
    p_values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Shrinkage:
    """Means over the held-out curves, the noise floor, the share closed with its interval, and how it was held out.

    `closed` is (before − max(with_cause, floor))/(before − floor): what is left below the floor is noise, and no share
    exceeds all.  None where before does not exceed the floor by more than twice its standard error.  `fitted` are the
    parameters of the model before, if that is the study's own answer.
    """

    curves: tuple[Gap, ...]
    before: float
    refit_only: float
    with_cause: float
    floor: float
    floor_error: float
    closed: float | None
    interval: tuple[float, float] | None
    how: str
    fitted: Mapping[str, float] | None = None


def experiment_blocks(library: Library) -> list[tuple[str, str, np.ndarray]]:
    """(name, unit, rows) of every experiment's data."""
    groups: dict[str, list[np.ndarray]] = {}
    units: dict[str, str] = {}
    for item, _, at in library.plan.rows():
        name = library.plan.experiments[item.experiment].name
        groups.setdefault(name, []).append(np.arange(at.start, at.stop))
        units[name] = "mm" if isinstance(item, SurfaceProfile) else "N"
    return [(k, units[k], np.concatenate(v)) for k, v in groups.items()]


def predicted(library: Library, effects: Sequence[Effect], post: Posterior, modulus: float) -> np.ndarray:
    """Mean prediction (n,) of the whole data vector of a library's plan from posterior draws."""
    mean: np.ndarray = predictive_draws(library, effects, post, modulus).mean(axis=0)
    return mean


def predictive_draws(library: Library, effects: Sequence[Effect], post: Posterior, modulus: float) -> np.ndarray:
    """Predictions (k, n) of the whole data vector of a library's plan by at most `N_PREDICTIVE_DRAWS` posterior
    draws."""
    draws = np.linspace(0, len(post.modulus) - 1, min(N_PREDICTIVE_DRAWS, len(post.modulus))).astype(int)
    A, c = predict(library, effects, post.at[draws], modulus)
    return post.modulus[draws, None] * A + c


def summarise(curves: Sequence[Gap], sizes: Sequence[int], how: str, seed: int) -> Shrinkage:
    """Means over curves; the interval resamples curves where there are at least two, each with other noise, and counts
    resamples with a gap.

    Of few curves the resamples alone would know a small change of all of them too well.
    """
    G = np.array([[c.before, c.refit_only, c.with_cause] for c in curves])
    means = G.mean(axis=0)
    before, refit_only, with_cause = map(float, means)
    # G of n independent readings scatters by √(2/n) around 1
    error = float(np.sqrt(np.sum([2.0 / n for n in sizes])) / len(sizes))
    closed, interval = None, None
    if means[0] - 1.0 > 2 * error:
        closed = float(_share(means[0], means[2]))
        rng = np.random.default_rng(seed)
        if len(G) < 2:
            return Shrinkage(tuple(curves), before, refit_only, with_cause, 1.0, error, closed, None, how)
        pick = rng.integers(0, len(G), (N_BOOTSTRAPS, len(G)))
        z = rng.standard_normal(pick.shape) * np.array([c.change_sd for c in curves])[pick]
        m = G[pick].mean(axis=1)
        m[:, 0] += z.mean(axis=1)  # what noise adds to before it adds to what is closed
        m = m[m[:, 0] - 1.0 > 2 * error]  # where the gap sits in one curve, resamples without it have no share
        share = _share(m[:, 0], m[:, 2])
        interval = (float(np.quantile(share, 0.05)), float(np.quantile(share, 0.95)))
    return Shrinkage(tuple(curves), before, refit_only, with_cause, 1.0, error, closed, interval, how)


def _share(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The share of what exceeds the floor of 1 before that does no longer after; at most 1."""
    return (before - np.maximum(after, 1.0)) / (before - 1.0)
