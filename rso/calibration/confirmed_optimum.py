"""What measured curves are compared with: the likelihood on an emulator, confirmed by runs where it counts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from rso.calibration.finished_runs import runs_with_curves
from rso.calibration.plan import Plan
from rso.calibration.readings import (
    as_data,
    cloud_data,
    cloud_place,
    curve_place,
    measured,
    of_emulator,
    record_of,
    with_input_errors,
)
from rso.calibration.search_stage import SearchResult
from rso.calibration.stages import (
    NEGLIGIBLE_OUTPUT_SHARE,
    Run,
    Runner,
    learn_more,
    learnt_anew,
    outputs_sample,
    tolerance_misses,
)
from rso.core.distributions import chi2_ppf
from rso.core.units import spaced
from rso.doe import Box, sobol_sequence
from rso.emulation.emulator import Emulator, relearn
from rso.evaluation import Outcome, Task
from rso.evaluation.store import Done
from rso.inference import (
    CurvePlace,
    Data,
    Determination,
    Fit,
    Misfit,
    Model,
    Profiled,
    Runs,
    all_minima,
    chi2_p_value,
    determination_of,
    emulated,
    emulated_together,
    profiles_around,
    resample,
    spread_of,
    with_autocorrelation,
    with_model_errors,
)
from rso.inference.error_model import EMULATOR_ERROR
from rso.inference.intervals import CREDIBLE_LEVEL
from rso.inference.rules import RULES
from rso.study.resolve import resolve

MAX_OPTIMUM_RUNS = 4  # runs of the most likely point between two rounds of the ends of intervals, at most
MAX_INTERVAL_END_ROUNDS = 3  # rounds of runs at the ends of intervals, at most
RUN_NEARBY_DISTANCE = 0.05  # of the unit cube: points so close to a run need none
# points of the ranges that are looked at; standard deviations that surrogates may be off by
N_DOUBTED_POINTS, MAX_SURROGATE_ERROR_SD = 2**11, 2.0
# of χ² in the same units: at the most likely point what the surrogates may be off by is at most 1 of it
MAX_SURROGATE_CHI2 = 2.0
# of χ² in units of its least value per degree of freedom: what prediction and run may differ by
MAX_PREDICTION_GAP_CHI2 = 0.5


@dataclass(frozen=True, eq=False)
class ConfirmedFit:
    """Likelihood of the fitted curves on an emulator, where they were measured, and starts (k, d) in the ranges.

    The errors of `bare` are those of `misfit` without what the surrogates may be off by.
    """

    misfit: Misfit
    bare: Misfit
    places: tuple[CurvePlace, ...]
    near: np.ndarray

    def with_profiles(self, plan: Plan, runs: Runs) -> Profiled:
        """What the curves say, finished runs heard, without draws."""
        return profiles_around(self.misfit, seed=plan.seed, near=self.near, runs=runs)


@dataclass(frozen=True, eq=False)
class ConfirmedOptimum:
    """The most likely point, recomputed: the runs made for it, the emulator that knows them, how far it was off.

    `agreement` is the largest difference of predicted and recomputed curves over their largest value, `chi2` the
    misfit of the recomputed ones; both are None where the last run has no answer.  `verified` says whether the
    difference is within verify.tolerance and does not count beside the errors of the data.  `open` are points, in
    words, at which the surrogates still do not know whether the data allow them, `poor` fitted outputs whose surrogates
    miss surrogate.tolerance by cross-validation, with all runs in them.  `chi2_bare` and `p_bare` are the
    misfit of the recomputed curves without what the surrogates may be off by, and its p-value; None where the
    simulations are exact by similarity or nothing shows.  `known` is what the `emulator` makes of the curves, once that
    was asked.
    """

    emulator: Emulator
    runs: tuple[Run, ...]
    agreement: float | None
    chi2: float | None
    verified: bool
    open: tuple[str, ...] = ()
    poor: tuple[str, ...] = ()
    chi2_bare: float | None = None
    p_bare: float | None = None
    known: tuple[ConfirmedFit, Profiled] | None = None


def evidence(plan: Plan, emulator: Emulator, found: Sequence[SearchResult]) -> ConfirmedFit:
    """Likelihood of every fitted curve in the ranges of the main search.

    Errors: those of the measurement, and of the model at the best fit (:mod:`rso.inference.error_model`).
    Readings of one record are autocorrelated where what the best fit leaves does and nothing is stated of that.
    ValueError where the data or their errors allow no likelihood.
    """
    return _evidence(plan, emulator, tuple(found))


@functools.lru_cache(maxsize=2)
def _evidence(plan: Plan, emulator: Emulator, found: tuple[SearchResult, ...]) -> ConfirmedFit:
    """Asked for by each step that may change the emulator."""
    box, near = searched_ranges(plan), _start(plan, found)
    places, curves = (list(v) for v in zip(*fitted_readings(plan), strict=True))
    model = _within(plan, box, emulated_together(emulator, places))
    plain = Misfit(model, tuple(curves), wall=_wall(plan, box))
    first = all_minima(plain, seed=plan.seed, near=near)[0]
    there = _wide(plan, first.x[None])[0]
    data = [_with_model(plan, found, emulator, there, p, d) for p, d in zip(places, curves, strict=True)]
    each = [data, [d.without(EMULATOR_ERROR) for d in data]]
    misfit, bare = (with_autocorrelation(replace(plain, data=tuple(v)), first.x) for v in each)
    return ConfirmedFit(misfit, bare, tuple(places), np.vstack([first.x[None], near]))


def most_likely_values(plan: Plan, emulator: Emulator, found: Sequence[SearchResult]) -> dict[str, float]:
    """Values of the most likely point by an emulator, fixed ones included."""
    now = evidence(plan, emulator, found)
    best = all_minima(now.misfit, seed=plan.seed, near=now.near)[0]
    return plan.values(_wide(plan, best.x[None])[0])


def confirm_optimum(
    bench: Runner, emulator: Emulator, found: Sequence[SearchResult], meanwhile: Sequence[Task] = ()
) -> ConfirmedOptimum:
    """Recompute the most likely point and learn it, until prediction and simulation agree, then where surrogates do not
    know enough (:func:`_unsure`), and look for all again, `MAX_INTERVAL_END_ROUNDS` times at most.

    Workers that are free begin what will be wanted later, `meanwhile`.
    """
    if emulator.reduced is None:  # exact: similarity knows every run already
        return ConfirmedOptimum(emulator, (), 0.0, None, True)
    similar, runs = emulator.group.reference is not None, list[Run]()
    for k in range(MAX_INTERVAL_END_ROUNDS + 1):
        now = _most_likely(bench, emulator, found, meanwhile)
        emulator, runs = now.emulator, [*runs, *now.runs]
        if not now.verified:
            break
        plan = bench.around_failures(similar).plan
        emulator, known, unsure = _unsure(bench, plan, emulator, found, runs)
        if not unsure or k == MAX_INTERVAL_END_ROUNDS:
            names = tuple(name for name, _ in unsure)
            poor = _poor(plan, emulator)
            return replace(now, emulator=emulator, runs=tuple(runs), open=names, poor=poor, known=known)
        values = [plan.values(x) for _, x in unsure]
        new = [Run("interval", v, o) for v, o in zip(values, bench.run(values), strict=True)]
        runs += new
        learnt = [outputs_sample(plan, r.values, r.outcomes) for r in new if r.done]
        if not learnt:
            names = tuple(name for name, _ in unsure)
            return replace(now, emulator=emulator, runs=tuple(runs), open=names, poor=_poor(plan, emulator))
        emulator = learn_more(bench, emulator, learnt)
    return replace(now, runs=tuple(runs))


def _most_likely(
    bench: Runner, emulator: Emulator, found: Sequence[SearchResult], meanwhile: Sequence[Task]
) -> ConfirmedOptimum:
    """The most likely point, run and learnt until prediction and simulation agree, `MAX_OPTIMUM_RUNS` times at most."""
    runs: list[Run] = []
    last = ConfirmedOptimum(emulator, (), None, None, False)
    for k in range(MAX_OPTIMUM_RUNS):
        plan = bench.around_failures(emulator.group.reference is not None).plan  # which the last run may have changed
        now = evidence(plan, emulator, found)
        best = all_minima(now.misfit, seed=plan.seed, near=now.near)[0]
        values = plan.values(_wide(plan, best.x[None])[0])
        bench.evaluator.begin(plan.tasks(values))  # before those, which may need artefacts
        bench.evaluator.begin(meanwhile)
        (outcomes,) = bench.run([values])
        bench.evaluator.begin(meanwhile)  # whose artefacts may be there by now
        runs.append(Run("identified", values, outcomes))
        if not runs[-1].done:
            continue
        curves = [_recomputed(plan, outcomes, p) for p in now.places]
        whole = now.misfit.model.predict(best.x[None])[0]
        predicted = np.split(whole, np.cumsum([len(c) for c in curves])[:-1])
        sizes = np.array([np.abs(y).max() for y in curves])
        readings = np.concatenate([d.value for d in now.misfit.data])
        # by symmetry a lateral force may be zero, or noise about it; a model may answer nothing but zero
        sizes = np.maximum(sizes, NEGLIGIBLE_OUTPUT_SHARE * max(sizes.max(), np.abs(readings).max()))
        gap = max(float(np.abs(f - y).max() / s) for f, y, s in zip(predicted, curves, sizes, strict=True))
        left = np.concatenate(curves) - readings
        chi2, bare = (float(np.sum(m.white(left) ** 2)) for m in (now.misfit, now.bare))
        off = float(np.sum(now.misfit.white(np.concatenate(curves) - whole) ** 2))
        verified = gap <= plan.study.verify.tolerance and off <= MAX_PREDICTION_GAP_CHI2 * _least(now, best)
        ν = now.misfit.n - len(best.x)
        p, p_bare = (chi2_p_value(m, v, ν, best.x) for m, v in ((now.misfit, chi2), (now.bare, bare)))
        last = ConfirmedOptimum(emulator, (), gap, chi2, verified, chi2_bare=bare, p_bare=p_bare)
        hidden = covered(p, p_bare) and bare > RULES.refuted_error_ratio**2 * ν
        if (verified and not hidden) or k == MAX_OPTIMUM_RUNS - 1:
            break
        emulator = learn_more(bench, emulator, [outputs_sample(plan, values, outcomes)])
    if not runs[-1].done and not last.verified:
        return ConfirmedOptimum(emulator, tuple(runs), None, None, False)
    return replace(last, emulator=emulator, runs=tuple(runs))


def covered(p: float | None, p_bare: float | None) -> bool:
    """Whether a model agrees with the data only because of what the surrogates may be off by."""
    return (p is None or p >= RULES.refuted_fit_chance) and p_bare is not None and p_bare < RULES.refuted_fit_chance


def _least(now: ConfirmedFit, best: Fit) -> float:
    """Least χ² per degree of freedom, at least 1."""
    return max(1.0, best.chi2 / max(now.misfit.n - len(best.x), 1))


def _poor(plan: Plan, emulator: Emulator) -> tuple[str, ...]:
    """Ids of the fitted outputs whose surrogates miss surrogate.tolerance by cross-validation."""
    fitted = set(_fitted(plan))
    mine = [o.id for o in emulator.outputs if (o.experiment, o.channel) in fitted]
    return tuple(tolerance_misses(plan, emulator, {i: m.cv for i in mine if (m := emulator.surrogates.get(i))}, mine))


def _heard(
    bench: Runner, plan: Plan, emulator: Emulator, found: Sequence[SearchResult]
) -> tuple[Emulator, ConfirmedFit, Profiled, Determination]:
    """The emulator that has learnt every finished run that refutes it, what it says, and what is determined then.

    A run that agrees with the data outside of an interval is learnt where that is new; where it is not, kinds of
    surrogates are chosen again.
    """
    for again in (True, False):
        now = evidence(plan, emulator, found)
        runs, new = runs_with_curves(plan, emulator, bench.evaluator.store, now.misfit, now.places)
        seen = now.with_profiles(plan, runs)
        d = determination_of(seen, seed=plan.seed, mcmc=False, stated=stated_ranges(plan))
        if not d.refuting or not again:
            break
        more = relearn(emulator, new, seed=plan.seed, each=bench.evaluator.each_now) if new else emulator
        emulator = learnt_anew(plan, more.group, more.outputs, more.samples, each=bench.evaluator.each)
    return emulator, now, seen, d


def _unsure(
    bench: Runner, plan: Plan, emulator: Emulator, found: Sequence[SearchResult], runs: Sequence[Run]
) -> tuple[Emulator, tuple[ConfirmedFit, Profiled], list[tuple[str, np.ndarray]]]:
    """The emulator, all finished runs heard, what it makes of the curves, and points (d,) of the plan's box, named.

    It does not know whether the data allow these.

    Ends of intervals, the other parameters following, where what the surrogates may be off by counts beside the errors
    of the data, among them that at the most likely point; and points of the ranges that they exclude, but not beyond
    `MAX_SURROGATE_ERROR_SD` times their own standard deviation.  None of them is near one of the `runs` or of the
    others.
    """
    emulator, now, seen, d = _heard(bench, plan, emulator, found)
    box, least = now.misfit.model.box, _least(now, d.fit)
    bands = [emulated(emulator, p)[1] for p in now.places]
    ends = []
    for k, known in enumerate(d.known):
        i, p = known.profile_interval, known.profile
        for at in (i.low, i.high):
            x = np.array([np.interp(at, p.at, p.path[:, j]) for j in range(box.d)])
            x[k] = at
            off = np.concatenate([band(_wide(plan, x[None])[0]) for band in bands])
            if float(np.sum(now.misfit.white(off) ** 2)) > MAX_SURROGATE_CHI2 * least:
                ends.append((f"the end of an interval, {_named(box, x)}", x))
    limit = d.fit.chi2 + least * chi2_ppf(CREDIBLE_LEVEL, 1)
    X = sobol_sequence(box.d, N_DOUBTED_POINTS, plan.seed)
    X = X[(now.misfit.chi2(X) > limit) & (now.misfit.beyond(X).sum(axis=1) == 0.0)]
    hopeful = _hopeful(plan, emulator, now, X)
    open_ = np.argsort(hopeful)[: np.count_nonzero(hopeful <= limit)]
    each = [*ends, *((f"what they cannot exclude, {_named(box, X[j])}", X[j]) for j in open_)]
    taken = [plan.box.to_unit(np.array([r.values[n] for n in plan.box.names])) for r in runs]
    kept: list[tuple[str, np.ndarray]] = []
    for name, x in each:
        there = _wide(plan, x[None])[0]
        if len(kept) < 2 * box.d and min(np.abs(there - t).max() for t in taken) >= RUN_NEARBY_DISTANCE:
            taken.append(there)
            kept.append((name, there))
    return emulator, (now, seen), kept


def _hopeful(plan: Plan, emulator: Emulator, now: ConfirmedFit, X: np.ndarray) -> np.ndarray:
    """χ² (k,) at X (k, d) with the covariance C + R S² Rᵀ, S = diag(MAX_SURROGATE_ERROR_SD s), s the surrogates'
    deviations there:

    |r|² − bᵀ (1 + S Vᵀ V S)⁻¹ b with W whitening by C, r = W (f − y), V = W R, b = S Vᵀ r (Woodbury).
    """
    each = [spread_of(emulator, place, _wide(plan, X)) for place in now.places]
    S = MAX_SURROGATE_ERROR_SD * np.hstack([s for s, _ in each])
    V = now.misfit.white(block_diag(*(R for _, R in each)).T).T
    r = now.misfit.residuals(X)[:, : len(V)]
    b = S * (r @ V)
    inside = np.eye(S.shape[1]) + S[:, :, None] * (V.T @ V) * S[:, None, :]
    return np.sum(r**2, axis=1) - np.einsum("ki,ki->k", b, np.linalg.solve(inside, b[:, :, None])[:, :, 0])


def _named(box: Box, x: np.ndarray) -> str:
    each = zip(box.names, box.from_unit(x), box.units, strict=True)
    return ", ".join(f"{n} = {v:.3g}{spaced(u)}".rstrip() for n, v, u in each)


def _wall(plan: Plan, box: Box) -> Callable[[np.ndarray], np.ndarray] | None:
    """By how much points (k, d) of the ranges break each condition between parameters, and the one that a run has an
    answer, over what it varies by in the ranges (k, w); None where there are no conditions."""
    if not plan.conditions:
        return None
    span = np.ptp(plan.excess(_wide(plan, sobol_sequence(box.d, 256, plan.seed))), axis=0)
    return lambda X: plan.excess(_wide(plan, X)) / np.where(span > 0.0, span, 1.0)


# ------------------------------------------------------------------------------------------------------ pieces


def fitted_readings(plan: Plan) -> list[tuple[CurvePlace, Data]]:
    """Where the fitted curves were measured, as deep as they are simulated, and their values with their errors; point
    clouds behind them."""
    found, fitted = [], _fitted(plan)
    for name, channel in fitted:
        curve = measured(plan, name, channel)
        deepest = max(o.depth_mm for o in plan.outputs if (o.experiment, o.channel) == (name, channel))
        keep = curve.compared & (curve.depth <= deepest * (1 + 1e-9))
        label = name if len({c for e, c in fitted if e == name}) == 1 else f"{name} {channel}"
        place = curve_place(name, curve, keep, deepest)
        found.append((place, as_data(label, record_of(plan, name), curve, keep)))
    found += [(cloud_place(plan, n), cloud_data(plan, n)) for n in plan.clouds if n in plan.case_of]
    return [(place, with_input_errors(plan, place, data)) for place, data in found]


def searched_ranges(plan: Plan) -> Box:
    """The ranges of the study file; the plan's own box may be wider, for a design that reaches beyond them."""
    main = plan.searches[0]
    low, high = plan.box.from_unit(np.stack([main.low, main.high]))
    return Box(plan.box.names, plan.box.units, tuple(map(float, low)), tuple(map(float, high)), plan.box.log)


def stated_ranges(plan: Plan) -> Box:
    """The ranges of the study file, whatever the search came to use."""
    axes = resolve(plan.study, plan.backend.parameters).axes
    return Box(plan.box.names, plan.box.units, tuple(a.low for a in axes), tuple(a.high for a in axes), plan.box.log)


def _wide(plan: Plan, X: np.ndarray) -> np.ndarray:
    """From the unit cube of the ranges to that of the plan's box."""
    main = plan.searches[0]
    return np.clip(main.low + X * (main.high - main.low), 0.0, 1.0)


def _within(plan: Plan, box: Box, model: Model) -> Model:
    return Model(box, lambda X: model.predict(_wide(plan, X)))


def _start(plan: Plan, found: Sequence[SearchResult]) -> np.ndarray:
    """Candidates (k, d) of all searches in the unit cube of the ranges."""
    main, box = plan.searches[0], plan.box
    values = [c.values for f in found for c in f.result.candidates]
    X = box.to_unit(np.array([[v[n] for n in box.names] for v in values]).reshape(-1, box.d))
    return np.clip((X - main.low) / np.maximum(main.high - main.low, 1e-12), 0.0, 1.0)


def _fitted(plan: Plan) -> list[tuple[str, str]]:
    """(experiment, channel) of the curves with role "fit"; where there are none, of all not kept for the end."""
    every = [e for e in plan.study.experiments if e.name in plan.case_of and e.kind == "force"]
    mine = [e for e in every if e.role == "fit"] or every
    return [(e.name, c) for e in mine for c in e.compared]


def _with_model(
    plan: Plan, found: Sequence[SearchResult], emulator: Emulator, x: np.ndarray, place: CurvePlace, data: Data
) -> Data:
    """A measured curve with the errors of the model at x (d,), those of the first candidate that was recomputed.

    As they stand in its response; without one no numerical error is known.
    """
    done = (c.outcomes[plan.case_of[place.experiment]] for f in found for c in f.result.candidates)
    outcome = next((o for o in done if isinstance(o, Done)), None)
    response = None if outcome is None else outcome.response
    return with_model_errors(data, of_emulator(emulator, x, response, place, data.value))


def _recomputed(plan: Plan, outcomes: Sequence[Outcome], place: CurvePlace) -> np.ndarray:
    """The simulated curve (n,) at the measured depths."""
    outcome = outcomes[plan.case_of[place.experiment]]
    assert isinstance(outcome, Done)
    return resample(outcome.response, place, "")
