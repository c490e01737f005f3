"""The ladder of models: how far to climb, from what noise and the data allow.  Knows no mechanics.

Each level is a model fitted to the same curves.  Whether it is good enough is asked of simulated data: what would a
perfect model leave, with this noise and this numerical error?  That answer is the error threshold, also in NRMSE.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import cholesky
from scipy.stats import qmc

from rso.doe import Box
from rso.identify import Data, Fit, Misfit, Model, descend

CONFIDENCE = 0.95
DRAWS = 400  # simulated data sets: a p-value of 0.05 is then known to 0.01
POINTS = 2**12  # of the integral over the parameters
MARGIN = math.log(20.0)  # of ln evidence: below 20 to 1 two levels are not told apart
RULE = (
    "A level is left only if its misfit is larger than in {share} % of the data sets that a perfect model with this "
    "noise and this numerical error would give, a level above is taken only if every parameter that it adds is "
    "determined by the data and its evidence is larger, and climbing ends at the first level taken that is good enough."
)


@dataclass(frozen=True)
class Level:
    """One model of the ladder: what it sets and opens.  Only names and numbers; their meaning is the backend's.

    `title` is its name in sentences.
    `open` maps a parameter to (low, high), `hold` to a value; both are shares of the modulus for those in `relative`
    (a stress is C = value · modulus, a compliance D = value / modulus).  `closed_form` costs no simulation; `extends`
    names the level that this one is where all its own parameters are neutral; one that `adds` is put on the level that
    holds by then instead of standing alone.
    """

    name: str
    description: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    open: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hold: Mapping[str, float] = field(default_factory=dict)
    relative: frozenset[str] = frozenset()
    closed_form: bool = False
    extends: str = ""
    adds: bool = False
    title: str = ""

    @property
    def label(self) -> str:
        """What it is called in sentences."""
        return self.title or self.name


@dataclass(frozen=True)
class Check:
    """χ² of curves against what a perfect model would leave: its `limit`, the share of simulated χ² above (`p_value`).

    `expected` is the mean of the simulated ones, of which there are `draws`.
    """

    chi2: float
    expected: float
    limit: float
    p_value: float
    points: int
    draws: int = DRAWS


@dataclass(frozen=True)
class CurveError:
    """NRMSE of one curve and the threshold that noise alone sets: what a perfect model stays below."""

    name: str
    role: str
    nrmse: float
    limit: float


@dataclass(frozen=True)
class Added:
    """A parameter that a level adds: whether the data determine it, and the sentence that says so."""

    name: str
    determined: bool
    story: str


@dataclass(frozen=True, eq=False)
class Judged:
    """What was found of one level.

    `problem` says why there is no answer, and then the rest is empty.  `onto` is the level that it was put on,
    `detail` whatever the caller keeps with it.
    """

    level: Level
    problem: str = ""
    fitted: Check | None = None
    selected: Check | None = None
    errors: tuple[CurveError, ...] = ()
    added: tuple[Added, ...] = ()
    log_evidence: float = -math.inf
    onto: str = ""
    detail: Any = None

    def adequate(self, confidence: float = CONFIDENCE) -> bool:
        """Neither the fitted curves nor those kept to select are worse than noise explains.

        With both, each is asked at half the chance of a false alarm, so that together they keep it.
        """
        tests = [t for t in (self.fitted, self.selected) if t is not None]
        return bool(tests) and all(t.p_value >= (1 - confidence) / len(tests) for t in tests)

    @property
    def undetermined(self) -> tuple[Added, ...]:
        """Parameters that it adds without the data's consent."""
        return tuple(a for a in self.added if not a.determined)


@dataclass(frozen=True)
class Step:
    """What became of a level: `adequate`, `fails`, `refused`, `no_answer`, `not_better` or `not_needed`, in words."""

    name: str
    rung: int
    verdict: str
    words: str


@dataclass(frozen=True, eq=False)
class Climb:
    """Everything fitted, a step for every level of the ladder, the level that holds and whether it is good enough.

    `rivals` are other levels of its rung that are good enough and not 20 times less likely.
    """

    judged: tuple[Judged, ...]
    steps: tuple[Step, ...]
    chosen: str | None
    adequate: bool
    rivals: tuple[str, ...]
    words: str

    def of(self, name: str) -> Judged:
        """What was found of a level; KeyError if it was not fitted."""
        return {j.level.name: j for j in self.judged}[name]


# ------------------------------------------------------------------------------------------------------ deciding


def climb(
    rungs: Sequence[Sequence[Level]], judge: Callable[[Level, Judged | None], Judged], confidence: float = CONFIDENCE
) -> Climb:
    """Climb rung by rung; `judge` fits one level, given what holds so far, and is asked only where it is needed.

    A rung is tried when what holds so far fails.  Of its levels with an answer, nothing undetermined and more evidence
    than what holds, those that are good enough end the climb and the likeliest is chosen; else the likeliest takes
    over and the next rung is tried.
    """
    judged: list[Judged] = []
    steps: list[Step] = []
    holds: Judged | None = None
    done, rivals = False, ()
    for n, rung in enumerate(rungs):
        if done:
            steps += [Step(v.name, n, "not_needed", f"{v.label} was not needed.") for v in rung]
            continue
        tried = [judge(level, holds) for level in rung]
        judged += tried
        able = [j for j in tried if not j.problem and not j.undetermined]
        better = sorted((j for j in able if _beats(j, holds)), key=lambda j: -j.log_evidence)
        good = [j for j in better if j.adequate(confidence)]
        taken = good or better
        before, holds = holds, taken[0] if taken else holds
        rivals = tuple(j.level.name for j in good[1:] if j.log_evidence > good[0].log_evidence - MARGIN)
        steps += [_step(j, n, before, holds, rivals, confidence) for j in tried]
        done = bool(good)
    label = {v.name: v.label for rung in rungs for v in rung}
    refused = [label[s.name] for s in steps if s.verdict == "refused"]
    words = _conclusion(holds, done, [label[n] for n in rivals], refused)
    name = None if holds is None else holds.level.name
    return Climb(tuple(judged), tuple(steps), name, done, rivals, words)


def _beats(j: Judged, holds: Judged | None) -> bool:
    return holds is None or j.log_evidence > holds.log_evidence


def _step(
    j: Judged, n: int, before: Judged | None, holds: Judged | None, rivals: tuple[str, ...], confidence: float
) -> Step:  # fmt: skip
    name, label = j.level.name, j.level.label
    if j.problem:
        return Step(name, n, "no_answer", f"{label} has no answer: {j.problem}")
    measured = _measured(j, confidence)
    if j.undetermined:
        fits = "It would be good enough" if j.adequate(confidence) else "It would fail too"
        why = " ".join(a.story for a in j.undetermined)
        return Step(name, n, "refused", f"{label} is refused, what it adds is not determined. {why} {fits}: {measured}")
    if before is not None and not _beats(j, before):
        state = "would be good enough" if j.adequate(confidence) else "fails too"
        return Step(name, n, "not_better", f"{label} {state} and is less likely than {before.level.label}: {measured}")
    if not j.adequate(confidence):
        return Step(name, n, "fails", f"{label} fails: {measured}")
    text = "is good enough" if holds is j else "is good enough too, and not told apart"
    if holds is not j and name not in rivals:
        text = "is good enough too, but more than 20 times less likely"
    return Step(name, n, "adequate", f"{label} {text}: {measured}")


def _measured(j: Judged, confidence: float) -> str:
    """The tests of a level in one sentence, and the error of each curve beside its threshold."""
    parts = []
    for test, what in ((j.fitted, "the fitted curves"), (j.selected, "the curves kept for selection")):
        if test is not None:
            parts.append(
                f"{what} leave χ² = {_size(test.chi2)}, a perfect model below {_size(test.limit)} in "
                f"{100 * confidence:.3g} % (p {_p(test)})"
            )
    shown = [e for e in j.errors if e.role != "validate"]
    parts += [f"NRMSE {100 * e.nrmse:.3g} % on {e.name}, threshold {100 * e.limit:.3g} %" for e in shown]
    return "; ".join(parts) + "."


def _size(x: float) -> str:
    return f"{x:.3g}" if x < 1000 else f"{float(f'{x:.3g}'):.0f}"


def _p(t: Check) -> str:
    """The smallest p-value that so many draws can give is a bound."""
    return f"= {t.p_value:.2g}" if t.p_value > 1.5 / (t.draws + 1) else f"< {t.p_value:.1g}"


def _conclusion(holds: Judged | None, done: bool, rivals: list[str], refused: list[str]) -> str:
    if holds is None:
        return "No level has an answer that the data determine."
    name = holds.level.label
    if done:
        text = f"{name} is the simplest level that these data cannot tell from the truth."
        if rivals:
            text += f" They cannot tell it from {' and '.join(rivals)} either: other data must decide."
        return text
    text = f"No level of this ladder is good enough; {name} is the best that the data support."
    if refused:
        text += f" {' and '.join(refused)} would add what the data do not determine."
    return text + " What is still missing may lie outside of the ladder: ask rso diagnose."


# ------------------------------------------------------------------------------------------------------ testing


@dataclass(frozen=True, eq=False)
class Simulated:
    """Data sets of a perfect model: refitted points X (b, d), their χ² (b,), and by curve the NRMSE (b,)."""

    X: np.ndarray
    chi2: np.ndarray
    nrmse: tuple[np.ndarray, ...]


def simulate(misfit: Misfit, fit: Fit, seed: int, draws: int = DRAWS) -> Simulated:
    """Parametric bootstrap: y* = f(x̂) + ε with ε ~ N(0, C), refitted from x̂ within the box.

    Source: Efron & Tibshirani 1993, §6.5.  All data sets are refitted at once: an axis that does not move says which.
    """
    d, rng = misfit.model.box.d, np.random.default_rng([seed, 11])
    f = misfit.model.predict(fit.x[None])[0]
    noise = np.concatenate([_noise(v, draws, rng) for v in misfit.data], axis=1)
    spare = Box((*misfit.model.box.names, ""), (*misfit.model.box.units, ""), (*misfit.model.box.low, 0.0),
                (*misfit.model.box.high, 1.0), (*misfit.model.box.log, False))  # fmt: skip

    def shifted(X: np.ndarray) -> np.ndarray:
        return misfit.model.predict(X[:, :d]) - noise[np.rint(X[:, d] * (draws - 1)).astype(int)]

    start = np.column_stack([np.repeat(fit.x[None], draws, axis=0), np.arange(draws) / max(draws - 1, 1)])
    pieces = np.split(f, np.cumsum([len(v.value) for v in misfit.data])[:-1])
    perfect = tuple(replace(v, value=p) for v, p in zip(misfit.data, pieces, strict=True))
    many = replace(misfit, model=Model(spare, shifted), data=perfect)
    X = descend(many, start, np.arange(d + 1) < d)
    residual = shifted(X) - f
    return Simulated(X[:, :d], np.sum(misfit.white(residual) ** 2, axis=1), _norms(misfit.data, residual, f + noise))


def simulate_elsewhere(model: Model, data: Sequence[Data], fit: Fit, X: np.ndarray, seed: int) -> Simulated:
    """The same for curves that are not fitted: y* = f(x̂) + ε, predicted by the refitted points `X` (b, d)."""
    rng = np.random.default_rng([seed, 12])
    f = model.predict(fit.x[None])[0]
    misfit = Misfit(model, tuple(data))
    noise = np.concatenate([_noise(v, len(X), rng) for v in data], axis=1)
    residual = model.predict(X) - f - noise
    return Simulated(X, np.sum(misfit.white(residual) ** 2, axis=1), _norms(data, residual, f + noise))


def check(residual: np.ndarray, misfit: Misfit, simulated: Simulated, confidence: float = CONFIDENCE) -> Check:
    """χ² of f − y (n,) against the simulated ones; p = (1 + those at least as large)/(1 + all)."""
    chi2 = float(np.sum(misfit.white(residual) ** 2))
    p = (1 + int(np.sum(simulated.chi2 >= chi2))) / (1 + len(simulated.chi2))
    limit = float(np.quantile(simulated.chi2, confidence))
    return Check(chi2, float(simulated.chi2.mean()), limit, p, misfit.n, len(simulated.chi2))


def curve_errors(
    data: Sequence[Data], roles: Sequence[str], residual: np.ndarray, simulated: Simulated,
    confidence: float = CONFIDENCE,
) -> tuple[CurveError, ...]:  # fmt: skip
    """NRMSE of every curve and the quantile of the simulated ones: the error threshold that noise sets."""
    reached = _norms(data, residual[None], np.concatenate([v.value for v in data])[None])
    each = zip(data, roles, reached, simulated.nrmse, strict=True)
    return tuple(CurveError(v.name, r, float(a[0]), float(np.quantile(s, confidence))) for v, r, a, s in each)


def _noise(data: Data, draws: int, rng: np.random.Generator) -> np.ndarray:
    n = len(data.value)
    tiny = (1e-9 * (float(np.abs(data.value).max()) or 1.0)) ** 2
    return rng.standard_normal((draws, n)) @ cholesky(data.covariance + tiny * np.eye(n), lower=True).T


def _norms(data: Sequence[Data], residual: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, ...]:
    """RMSE over |mean| of each curve, from residuals (b, n) and values (b, n)."""
    ends = np.cumsum([len(v.value) for v in data])[:-1]
    pairs = zip(np.split(residual, ends, axis=1), np.split(value, ends, axis=1), strict=True)
    return tuple(np.sqrt(np.mean(r**2, axis=1)) / np.maximum(np.abs(y.mean(axis=1)), 1e-300) for r, y in pairs)


# ------------------------------------------------------------------------------------------------------ evidence


def log_evidence(misfit: Misfit, fit: Fit, seed: int, points: int = POINTS) -> float:
    """ln ∫ p(y | x) dx over the unit cube, all parameters equally likely beforehand on their scale.

    Importance sampling from a Gaussian twice as wide as Laplace's, no wider than half of the cube, quasi-random; the
    Gaussian's normalisation is kept, so that levels with other covariances compare.
    Source: Kass & Raftery, J. Am. Stat. Assoc. 90 (1995) 773, §4.
    """
    d = misfit.model.box.d
    values, V = np.linalg.eigh(fit.fisher)
    sd = np.minimum(2.0 / np.sqrt(np.maximum(values, 1e-12)), 0.5)
    z = qmc.MultivariateNormalQMC(np.zeros(d), seed=np.random.default_rng([seed, 13])).random(points)
    X = fit.x + (z * sd) @ V.T
    inside = np.all((X >= 0) & (X <= 1), axis=1)
    proposal = -0.5 * np.sum(z**2, axis=1) - np.sum(np.log(sd)) - 0.5 * d * math.log(2 * math.pi)
    weights = np.full(points, -np.inf)
    weights[inside] = -0.5 * misfit.chi2(X[inside]) - proposal[inside]
    top = weights.max()
    integral = top + math.log(np.mean(np.exp(weights - top)))
    whitened = misfit.white(np.eye(misfit.n))  # rows of Wᵀ
    return float(integral + np.linalg.slogdet(whitened)[1] - 0.5 * misfit.n * math.log(2 * math.pi))
