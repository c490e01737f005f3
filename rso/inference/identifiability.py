"""How well measured curves determine the parameters: everything at once, from one misfit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.core.digits import significant, two_digits
from rso.core.distributions import chi2_cdf, chi2_ppf, chi2_sf, f_sf, student
from rso.doe import Box
from rso.inference import sloppy_directions as along
from rso.inference.autocorrelated_residuals import independent
from rso.inference.error_model import MODEL_ERROR_NAMES, shares
from rso.inference.intervals import (
    CREDIBLE_LEVEL,
    Interval,
    ProfileInterval,
    laplace,
    profile_likelihood,
    quantiles,
    standard_deviations,
)
from rso.inference.least_squares import SAME_MINIMUM_TOLERANCE, Fit, all_minima, fit_at
from rso.inference.likelihood import WEIGHTINGS, Misfit
from rso.inference.posterior_sampling import Draws, agree, sample_posterior
from rso.inference.rules import RULES, IdentificationRules
from rso.inference.sloppy_directions import Direction, per_log
from rso.inference.verdict import VERDICT_WORDS, Verdict, Word, judge_parameter, quieter, size, verdict_sentences

N_OTHER_PROFILE_STARTS = 5  # points beside the best fit from which profiles start
N_RUNS_TO_START_FROM = 8  # finished runs from which descents start
NEGLIGIBLE_MINIMUM_CHI2 = 20.0  # of χ²: a minimum that much higher holds no probability that counts
MIN_DEGREES_OF_FREEDOM = 0.5  # degrees of freedom that say whether a model fits


@dataclass(frozen=True, eq=False)
class AsStated:
    """Interval of a parameter with what is stated and shown alone, and how much of what widens it beyond is each error.

    `shares` holds (name of the error, share of the variance that usual errors add), the largest first; `story` says
    both intervals where they differ enough to be worth a word.
    """

    interval: Interval
    shares: tuple[tuple[str, float], ...]
    story: str = ""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of one parameter: best value, intervals (unit cube) by three methods, verdict, words.

    `sd_log` is the standard deviation of ln θ by the Fisher information (of θ/range where θ may not be positive);
    `mcmc` is None where no chain was run or its draws are too few; `agreement` says whether Laplace and MCMC agree.
    `as_stated` is what it would be without usual errors that nobody has stated; None where none count.
    """

    name: str
    value: float
    sd_log: float
    profile_interval: Interval
    laplace: Interval
    mcmc: Interval | None
    agreement: bool | None
    profile: ProfileInterval
    verdict: Verdict
    story: str
    reason: str
    as_stated: AsStated | None = None


@dataclass(frozen=True, eq=False)
class Determination:
    """Best fit and other minima of χ², goodness of fit, what is known of each parameter, directions.

    `scale` >= 1 is what the errors were multiplied with because the model does not fit within them (Birge's ratio);
    the χ² of `fit` is that before, the intervals are those after it.  Errors whose size is known from few readings
    widen the intervals as well, by Student's factor, which `wider` has and `scale` has not.  Where readings may
    are autocorrelated (:func:`.autocorrelated_residuals.remembering`) these are at least as large as what is left;
    there is no p-value where nobody stated them, unless that is beyond `refuted_error_ratio`.  `refuting` are the
    finished runs (their indices) that agree with the data where the model of the misfit left their values out.
    """

    misfit: Misfit
    fit: Fit
    others: tuple[Fit, ...]
    degrees: int
    p_value: float | None
    scale: float
    known: tuple[Known, ...]
    directions: tuple[Direction, ...]
    draws: Draws | None
    story: str
    wider: float = 1.0
    refuting: tuple[int, ...] = ()

    @property
    def warning(self) -> str:
        """The story where the errors had to be made larger or readings to be autocorrelated, else nothing."""
        return self.story if self.scale > 1 or any(d.memory for d in self.misfit.data) else ""

    @property
    def used(self) -> Misfit:
        """The misfit with its errors as much wider as the intervals."""
        return replace(self.misfit, scale=self.misfit.scale * self.wider)

    @property
    def fisher_of_exact_inputs(self) -> np.ndarray:
        """The Fisher information (d, d) where stated inputs are right, as wide as the intervals.

        A further test of the same specimen shows its dimensions no better, and they move fit and prediction alike.
        """
        exact = replace(self.misfit, data=tuple(v.inputs_exact for v in self.misfit.data))
        fit = fit_at(exact, self.fit.x) if any(v.inputs for v in self.misfit.data) else self.fit
        return fit.fisher / self.wider**2

    def of(self, name: str) -> Known:
        """What is known of a parameter; KeyError if there is none of this name."""
        found = {k.name: k for k in self.known}
        return found[name]


@dataclass(frozen=True, eq=False)
class Runs:
    """Finished simulations at X (m, d) of the unit cube, and the curves (m, n) that they computed at all readings."""

    X: np.ndarray
    curves: np.ndarray


@dataclass(frozen=True, eq=False)
class Profiled:
    """What a misfit says without draws: its minima, how much wider its errors are, and a profile of each parameter.

    `fit` is the best of the minima under the widened errors, `near_best` (with it) those that hold probability, `rise`
    (m,) by how much χ² of each of the `runs` is above its own.
    """

    misfit: Misfit
    minima: tuple[Fit, ...]
    degrees: int
    p_value: float | None
    scale: float
    wider: float
    used: Misfit
    fit: Fit
    near_best: tuple[Fit, ...]
    profiles: tuple[ProfileInterval, ...]
    runs: Runs
    rise: np.ndarray


def determine(
    misfit: Misfit,
    *,
    seed: int,
    near: np.ndarray | None = None,
    mcmc: bool = True,
    level: float = CREDIBLE_LEVEL,
    runs: Runs | None = None,
    stated: Box | None = None,
    rules: IdentificationRules = RULES,
) -> Determination:
    """Identify the parameters and say how well they are determined.

    Steps: all minima of χ² (also from the points `near`, (k, d)); errors widened by √(χ²/ν) where the fit is worse than
    noise explains (p < 0.01; always with the weightings that have no noise); Laplace, profile and MCMC intervals.
    Where the size of the errors was itself taken from m degrees of freedom, χ²/ν is F(ν, m), not χ²_ν/ν.  That of
    readings which are autocorrelated is not seen in how neighbours differ: unless it is stated, it is taken from what
    is left, which holds fewer degrees of freedom than ν.

    χ² of every finished one of the `runs` counts: the best are starts, and no interval leaves one out that agrees with
    the data.  Where it would have, the surrogates behind the misfit are refuted, and no parameter is determined.
    Intervals are measured against the `stated` ranges, where the misfit has wider ones.
    Source of the widening: Birge, Phys. Rev. 40 (1932) 207, eq. 9.
    """
    found = profiles_around(misfit, seed=seed, near=near, level=level, runs=runs, rules=rules)
    return determination_of(found, seed=seed, mcmc=mcmc, level=level, stated=stated, rules=rules)


def profiles_around(
    misfit: Misfit,
    *,
    seed: int,
    near: np.ndarray | None = None,
    level: float = CREDIBLE_LEVEL,
    runs: Runs | None = None,
    rules: IdentificationRules = RULES,
) -> Profiled:
    """The part of :func:`determine` that needs no draws."""
    box = misfit.model.box
    runs = runs or Runs(np.zeros((0, box.d)), np.zeros((0, misfit.n)))
    best = runs.X[np.argsort(_chi2(misfit, runs))[:N_RUNS_TO_START_FROM]]
    near = best if near is None else np.vstack([near, best])
    minima = all_minima(misfit, seed=seed, near=near)
    first = minima[0]
    ν = misfit.n - box.d
    p, scale, wider = _widening(misfit, first.chi2, ν, level, first.x, rules)
    used = replace(misfit, scale=misfit.scale * wider)
    fit = fit_at(used, first.x)
    profiles = [
        profile_likelihood(used, fit, k, _apart(used, fit, [*(m.x for m in minima[1:]), *near])) for k in range(box.d)
    ]
    near_best = [fit, *(fit_at(used, m.x) for m in minima[1:4])]
    near_best = [m for m in near_best if m.chi2 < fit.chi2 + NEGLIGIBLE_MINIMUM_CHI2]
    rise = _chi2(used, runs) - fit.chi2
    parts = (tuple(minima), ν, p, scale, wider, used, fit, tuple(near_best), tuple(profiles))
    return Profiled(misfit, *parts, runs, rise)


def determination_of(
    found: Profiled,
    *,
    seed: int,
    mcmc: bool,
    level: float = CREDIBLE_LEVEL,
    stated: Box | None = None,
    rules: IdentificationRules = RULES,
) -> Determination:
    """The rest of :func:`determine`: intervals and verdicts, with draws of the posterior where `mcmc`."""
    misfit, used, fit, profiles, runs = found.misfit, found.used, found.fit, found.profiles, found.runs
    box = misfit.model.box
    draws = sample_posterior(used, list(found.near_best), seed=seed, along=_along(profiles)) if mcmc else None
    near_by = laplace(fit, level, seed)
    drawn = quantiles(draws.X, level) if draws is not None and draws.enough else [None] * box.d
    sd = standard_deviations(fit.fisher) / per_log(box, fit.x)
    known, refuting, missed = [], set[int](), found.scale if misfit.weighting == "noise" else 1.0
    for k, name in enumerate(box.names):
        out = runs_outside_interval(profiles[k], runs.X[:, k], found.rise, level)
        refuting |= set(out)
        seen = profiles[k].with_runs(runs.X, found.rise)
        one = _known(used, fit, name, k, float(sd[k]), seen, near_by[k], drawn[k], level, missed, stated, rules)
        known.append(refuted(one, len(out)) if out else one)
    first = found.minima[0]
    return Determination(
        misfit,
        first,
        found.minima[1:],
        found.degrees,
        found.p_value,
        found.scale,
        tuple(known),
        along.directions(box, fit.x, fit.fisher),
        draws,
        _story(misfit, first, found.degrees, found.p_value, found.scale),
        found.wider,
        tuple(sorted(refuting)),
    )


def _widening(
    misfit: Misfit, chi2: float, ν: int, level: float, x: np.ndarray | None = None, rules: IdentificationRules = RULES
) -> tuple[float | None, float, float]:
    """The p-value, the scale of the errors, and by how much intervals are wider: by the scale or Student's factor."""
    p, expected = chi2_p_value(misfit, chi2, ν, x), ν - taken_up(misfit, x)
    ratio = chi2 / expected if ν > 0 and expected >= MIN_DEGREES_OF_FREEDOM else 0.0
    ρ, m = max(d.memory for d in misfit.data), misfit.freedom
    unsized = math.isfinite(m) or any(d.sized for d in misfit.data)
    left = student(max(ν * independent(ρ), 1.0), level) if ρ > 0.0 and unsized else 1.0
    if ratio > 0 and (misfit.weighting != "noise" or (p is not None and p < rules.refuted_fit_chance)):
        return p, math.sqrt(ratio), math.sqrt(ratio) * (left if misfit.weighting == "noise" else 1.0)
    if ρ == 0.0 or ν <= 0:
        return p, 1.0, student(m, level)
    scale = math.sqrt(max(ratio, 1.0))  # so few degrees of freedom hardly refute anything
    return p, scale, scale * left


def taken_up(misfit: Misfit, x: np.ndarray | None) -> float:
    """By how much χ² at x (d,) is smaller than its degrees of freedom where a test has none of the usual errors.

    E χ² = n − d − ‖(1 − J J⁺) W U‖²      with whitened slopes J and the usual parts U of the covariance
    """
    if x is None or misfit.weighting != "noise" or not any(d.usual for d in misfit.data):
        return 0.0
    columns, start = [], 0
    for d in misfit.data:
        for U in d.usual.values():
            full = np.zeros((misfit.n, U.shape[1]))
            full[start : start + len(d.value)] = U
            columns.append(full)
        start += len(d.value)
    WU, J = misfit.white(np.hstack(columns).T).T, misfit.white(misfit.model.jacobian(x).T).T
    U, S, _ = np.linalg.svd(J, full_matrices=False)
    Q = U[:, S > 1e-9 * max(float(S.max(initial=0.0)), 1e-300)]
    return float(np.sum(WU**2) - np.sum((Q.T @ WU) ** 2))


def chi2_p_value(misfit: Misfit, chi2: float, ν: int, x: np.ndarray | None = None) -> float | None:
    """Chance that noise alone leaves more than χ² with ν degrees of freedom; None where nothing shows.

    That is where ν <= 0, where errors have no stated size, where their size was taken from what is left, and where
    readings are autocorrelated by errors that nobody stated, unless χ² is beyond what `refuted_error_ratio` times these
    would leave.  Usual errors (:func:`taken_up` at x (d,)) may be there or not: it is the chance without them.
    """
    ρ = max(d.memory for d in misfit.data)
    unsized = ρ > 0 and math.isfinite(misfit.freedom) and 0 < chi2 <= RULES.refuted_error_ratio**2 * ν
    if misfit.weighting != "noise" or ν <= 0 or unsized or any(d.sized for d in misfit.data):
        return None
    left = ν - taken_up(misfit, x)
    if left < MIN_DEGREES_OF_FREEDOM:
        return None
    each = independent(ρ)
    return exceeded(chi2 * each, left * each, *_freedoms(misfit, left * each))


def _freedoms(misfit: Misfit, ν: float) -> tuple[float, float]:
    """Degrees of freedom (a, m) of F for χ²/ν: from what readings hold, and from what the size of their errors does.

    A size s² that was taken from the very readings, m of ν degrees of freedom, is no independent one.  The ratio
    s²/(χ²/ν) is independent of χ² (Basu, Sankhyā 15 (1955) 377), hence of variance (1 + 2/m)/(1 + 2/ν) − 1, and is
    taken for χ²_b/b of this variance 2/b.
    """
    known, size = 0.0, 0.0
    for d in misfit.data:
        share = len(d.value) / misfit.n
        mine = ν * share
        if d.itself and math.isfinite(d.freedom):
            size += share**2 * max((1 + 2 / d.freedom) / (1 + 2 / mine) - 1, 1e-6)
        else:
            known += share**2 * 2 / mine
            size += share**2 * 2 / d.freedom
    return (2 / known if known > 0 else math.inf), (2 / size if size > 0 else math.inf)


def lenient(misfit: Misfit, chi2: float, ν: int, p: float | None) -> str:
    """A remark where χ² is far less than the errors would leave, else nothing: it names those that are too large."""
    if p is None or p <= 1.0 - RULES.too_good_fit_chance:
        return ""
    said = f"χ² = {significant(chi2, 3)} for {ν} degrees of freedom: the readings scatter far less than "
    worst = max((shares(d.as_stated) for d in misfit.data), key=lambda s: math.hypot(*s.values()))
    of_model = {name: size for name, size in worst.items() if name in MODEL_ERROR_NAMES}
    if math.hypot(*of_model.values()) > worst["measurement"]:
        sizes = ", ".join(f"{MODEL_ERROR_NAMES[name]} {100 * size:.2g} %" for name, size in of_model.items())
        return f"{said}the simulation may be off ({sizes} of the largest reading). Intervals count these errors"
    if all(math.isfinite(d.freedom) for d in misfit.data):
        return f"{said}the errors that were taken for them; the study states none of single readings"
    return (
        f"{said}the stated errors. noise.Fz, noise.depth and a column Fz_sigma_N are independent errors of single "
        "readings. An error of a whole curve is contact, gain or calibration under noise"
    )


def exceeded(chi2: float, ν: float, *known: float) -> float:
    """Chance that noise alone leaves more than χ² where ν is expected, its size known from m: P(F(a, m) > χ²/ν).

    `known` is m, or a and m; a is ν unless given.  χ²_a where m is infinite, the reciprocal of χ²_m/m where a is.
    """
    a, m = (ν, *known)[-2:]
    if math.isinf(m):
        return float(chi2_sf(a * chi2 / ν, a)) if math.isfinite(a) else float(chi2 < ν)
    return float(f_sf(chi2 / ν, a, m)) if math.isfinite(a) else float(chi2_cdf(m * ν / chi2, m))


def _known(
    misfit: Misfit,
    fit: Fit,
    name: str,
    k: int,
    sd: float,
    p: ProfileInterval,
    near_by: Interval,
    drawn: Interval | None,
    level: float,
    scale: float,
    stated: Box | None,
    rules: IdentificationRules,
) -> Known:
    box = misfit.model.box
    interval = p.interval(level)
    leaning = tuple(box.names[j] for j in p.leaning(level))
    verdict = judge_parameter(box, k, interval, leaning, scale, stated, rules)
    if verdict.word != "determined" and scale == 1.0:  # less noise does not help a model that is wrong
        verdict = replace(verdict, noise_factor=quieter(box, k, p, level, stated))
    places = [place for d in misfit.data for place in d.places]
    text, why = verdict_sentences(
        box, k, verdict, interval, p, unit=misfit.data[0].unit, places=places, level=level, leaning=leaning, scale=scale
    )
    agreement = None if drawn is None else agree(near_by, drawn)
    return Known(name, float(fit.theta[k]), sd, interval, near_by, drawn, agreement, p, verdict, text, why)


def refuted(known: Known, count: int) -> Known:
    """The same, not called determined: so many finished runs agree with the data at values that were left out."""
    why = (
        f"{count} finished run{'s agree' if count > 1 else ' agrees'} with the data at values of {known.name} that "
        "the surrogates exclude. The surrogates are not accurate enough; more runs (verify.max_infill, [doe]) "
        "would help."
    )
    return doubt(known, "weakly", why)


def doubt(known: Known, word: Word, why: str, by: str = "by surrogates, ") -> Known:
    """What is known of a parameter, which is no more called determined but `word`, and why."""
    if known.verdict.word != "determined":
        return replace(known, reason=f"{known.reason} {why}".strip())
    story = known.story.replace(f"{VERDICT_WORDS['determined']}: ", f"{VERDICT_WORDS[word]}: {by}", 1)
    return replace(known, verdict=Verdict(word, 0, None), story=story, reason=why)


def runs_outside_interval(
    p: ProfileInterval, at: np.ndarray, rise: np.ndarray, level: float = CREDIBLE_LEVEL
) -> list[int]:
    """Indices of runs with the parameter `at` (m,) that agree with the data, χ² risen by `rise` (m,), but lie outside
    of all pieces of its interval by more than `refuting_distance_share` of its width."""
    found, limit = p.pieces(level), chi2_ppf(level, 1)
    slack = RULES.refuting_distance_share * max(found[-1].high - found[0].low, 1e-6)
    inside = np.any([(at >= i.low - slack) & (at <= i.high + slack) for i in found], axis=0)
    return [int(j) for j in np.flatnonzero(~inside & (rise <= limit))]


def _chi2(misfit: Misfit, runs: Runs) -> np.ndarray:
    """χ² (m,) of the curves of runs."""
    return np.sum(misfit.white(runs.curves - np.concatenate([d.value for d in misfit.data])) ** 2, axis=1)


def _apart(misfit: Misfit, fit: Fit, points: Sequence[np.ndarray]) -> np.ndarray:
    """At most `N_OTHER_PROFILE_STARTS` of some points (k, d), the best first, apart from each other and from the best
    fit."""
    X = np.array(points).reshape(-1, len(fit.x))
    kept = [fit.x]
    for j in np.argsort(misfit.chi2(X)) if len(X) else ():
        if (
            len(kept) <= N_OTHER_PROFILE_STARTS
            and min(float(np.abs(X[j] - v).max()) for v in kept) > SAME_MINIMUM_TOLERANCE
        ):
            kept.append(X[j])
    return np.array(kept[1:]).reshape(-1, len(fit.x))


def _along(profiles: Sequence[ProfileInterval]) -> np.ndarray:
    """Points (k, d) of all profiles at which the data allow the model."""
    return np.concatenate([p.path[p.rise <= NEGLIGIBLE_MINIMUM_CHI2] for p in profiles])


def _story(misfit: Misfit, fit: Fit, ν: int, p: float | None, scale: float) -> str:
    if misfit.weighting != "noise":
        return f"All points count equally ({misfit.weighting} errors); their size is taken from what is left over."
    if ν <= 0:
        return "There are no more points than parameters: whether the model fits cannot be said."
    text, by_rest = f"χ² = {significant(fit.chi2, 3)} for {ν} degrees of freedom", _by_what_is_left(misfit)
    if by_rest:
        return f"{by_rest} {_together(misfit, fit)}".strip()
    together = _together(misfit, fit)
    if together and (p is None or p >= RULES.refuted_fit_chance):
        larger = f" Their errors count {scale:.2g} times as large." if scale > 1.05 else ""
        return f"{text}. {together}{larger}"
    if scale > 1:
        after = f" {together}" if together else ""
        return (
            f"{text}: the model misses the data by {scale:.2g} times their errors, more than noise explains; "
            f"all intervals are widened by this factor.{after}"
        )
    if p is not None and p < RULES.undecided_fit_chance:
        return (
            f"{text}, p = {p:.2g}: whether the model fits is undecided; below {RULES.refuted_fit_chance:g} it misses "
            f"the data, from {RULES.undecided_fit_chance:g} on it agrees with them."
        )
    text += ": the model agrees with the data within their errors"
    share = max((float(np.max(d.sigma) / np.max(np.abs(d.value))) for d in misfit.data if np.any(d.value)), default=0.0)
    if share > RULES.wide_error_share:
        text += f", which are up to {two_digits(100 * share)} % of the largest value and say little"
    return f"{text}."


def _by_what_is_left(misfit: Misfit) -> str:
    """What is said of curves of which errors have the size of what is left over."""
    each = [
        f"{d.name} {size(float(d.white.max()) / student(d.sized), d.unit)} "
        f"({100 * float(d.white.max()) / student(d.sized) / (float(np.abs(d.value).max()) or 1.0):.2g} % of its "
        "largest value)"
        for d in misfit.data
        if d.sized and d.white is not None
    ]
    if not each:
        return ""
    return (
        "The noise of single readings is not stated, and the readings show none. The residual of the best fit is "
        f"taken for it, of {', of '.join(each)}. Whether the model fits is undecided; state noise.Fz."
    )


def _together(misfit: Misfit, fit: Fit) -> str:
    """What is said of curves of which neighbouring readings miss the best fit by the same."""
    predicted = np.split(misfit.model.predict(fit.x[None])[0], np.cumsum([len(d.value) for d in misfit.data])[:-1])
    each = []
    for d, said in zip(misfit.data, predicted, strict=True):
        if d.memory:
            missed = (said - d.value)[np.argsort(d.depth, kind="stable")]
            left = math.sqrt(max(float(np.mean(missed[1:] * missed[:-1])), 0.0))  # without what each has by itself
            each.append(
                f"{d.name} by {size(left, d.unit)} ({two_digits(100 * left / float(np.abs(d.value).max()))} % of its "
                "largest value)"
            )
    if not each:
        return ""
    return (
        f"The residuals are autocorrelated: those of {', of '.join(each)}, root mean square. Either the noise is "
        "autocorrelated, which the intervals allow for and noise.correlation states, or the model is wrong by that."
    )


def compare_weightings(misfit: Misfit, near: np.ndarray, *, seed: int) -> dict[str, Fit]:
    """The best fit under each weighting ('noise', 'absolute', 'relative'), side by side."""
    return {w: all_minima(replace(misfit, weighting=w, scale=1.0), seed=seed, near=near)[0] for w in WEIGHTINGS}
