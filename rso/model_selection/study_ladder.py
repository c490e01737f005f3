"""The ladder of a study: every level fitted to the same curves, as far up as noise and the data ask for."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from rso import model_selection
from rso.calibration.plan import Plan, make_plan
from rso.calibration.predictive_check import LIKELIEST_VALUE_DIGITS, PredictiveCheck
from rso.calibration.readings import (
    curve_data,
    curve_outputs,
    force_curves,
    measured,
    numerical,
    of_emulator,
    of_response,
    places_from_contact,
)
from rso.calibration.stages import Runner
from rso.calibration.uncertain_inputs import learn_effects
from rso.contract import ClosedFormStart, Response, capability
from rso.emulation.emulator import Emulator, Sample, learn_emulator, relearn
from rso.evaluation import Evaluator, Watch
from rso.evaluation.store import RunStore
from rso.inference import (
    CurvePlace,
    Data,
    Determination,
    Known,
    Misfit,
    all_minima,
    determine,
    emulated_together,
    resample,
    with_autocorrelation,
    with_model_errors,
)
from rso.inference.rules import RULES
from rso.inference.verdict import physical
from rso.model_selection import Added, Judged, Left, ModelLevel, Selection
from rso.model_selection.candidate_models import Axes, axes_of, cases_of_levels, levels_of
from rso.model_selection.held_out import validate_level
from rso.model_selection.simulations import LadderUnanswered, level_design, prove, sampled, simulate_level
from rso.study.schema import Study

MIN_RUNS_OF_LEVEL = 4  # runs with an answer from which a level is learnt
MAX_LEVEL_OPTIMUM_RUNS = 6  # runs of the most likely point, at most
MAX_EMULATOR_CHI2 = 0.5  # of χ²: what the emulator may be off by at the most likely point


@dataclass(frozen=True, eq=False)
class FittedLevel:
    """A level at its best: axes, emulator, what the curves say, curves kept to select, the recomputed responses.

    `agreement` is the largest difference of predicted and recomputed curves over their largest value, `settled` says
    whether that is no matter beside the errors, `errors` are the numerical ones (n,) at fitted and selecting places.
    """

    axes: Axes
    emulator: Emulator
    determination: Determination
    places: tuple[CurvePlace, ...]
    roles: tuple[str, ...]
    data: tuple[Data, ...]
    predicted: tuple[np.ndarray, ...]
    errors: tuple[np.ndarray, ...]
    simulated: model_selection.Simulated
    agreement: float
    settled: bool
    runs: int
    cpu_s: float
    lost: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Values of the axes."""
        return dict(zip(self.axes.box.names, map(float, self.determination.fit.theta), strict=True))


@dataclass(frozen=True, eq=False)
class LadderFit:
    """The selection, the rungs, the start by closed form (None if the backend has none), validation by level."""

    rungs: tuple[tuple[ModelLevel, ...], ...]
    climb: Selection
    start: Mapping[str, tuple[float, float, float]] | None
    validation: Mapping[str, tuple[PredictiveCheck, ...]]
    cost: Mapping[str, float]
    seconds: float


def ladder_plan(study: Study) -> Plan:
    """Plan of a study for its ladder; with count_validation its validation curves become curves to select with.

    Where one of its levels relaxes, every level is compared with the holds of the records too.
    """
    if study.ladder.count_validation:
        roles = {"validate": "select"}
        every = [
            e.model_copy(update={"role": roles.get(e.role, e.role)}) if e.kind == "force" else e
            for e in study.experiments
        ]
        study = study.model_copy(update={"experiments": tuple(every)})
    plan = make_plan(study)
    return make_plan(study, cases_of_levels(plan, levels_of(plan))) if plan.found or plan.creeps.found else plan


def run_ladder(
    plan: Plan,
    store: RunStore,
    executor: Executor,
    *,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> LadderFit:
    """Run the ladder of a study; the curves for validation are used only after the selection."""
    began, evaluator = time.perf_counter(), Evaluator(plan.backend, store, executor, watch)
    table = plan.study.ladder
    rungs, start = levels_of(plan), starting(plan)
    ranges = {k: (v[0], v[2]) for k, v in (start or {}).items()} if table.ranges == "start" else {}
    known: dict[str, FittedLevel] = {}

    def judge(level: ModelLevel, holds: Judged | None) -> Judged:
        onto = holds.level if level.adds and holds is not None else None
        if onto is not None and onto.closed_form:
            return Judged(level, f"it cannot be put on the closed form {onto.name}", onto=onto.name)
        whole = level if onto is None else put_on(level, onto)
        say(f"level {level.name}" + (f" on {onto.name}" if onto is not None else ""))
        try:
            found = fit_level(plan, evaluator, whole, ranges, known.get(whole.extends))
        except LadderUnanswered as error:
            return Judged(level, str(error), onto=onto.name if onto else "")
        known[level.name] = found
        return judged(plan, level, whole, found, onto.name if onto else "")

    climb = model_selection.select_model(rungs, judge)
    checked = {}
    for j in climb.judged:
        if not j.problem and plan.validation:
            checked[j.level.name] = validate_level(plan, evaluator, j)
    return LadderFit(rungs, climb, start, checked, evaluator.cost, time.perf_counter() - began)


def starting(plan: Plan) -> Mapping[str, tuple[float, float, float]] | None:
    """Ranges and values by the backend's closed form from the first curve that is fitted; None where it has none."""
    name, channel = force_curves(plan, "fit")[0]
    form = capability(plan.backend, ClosedFormStart)
    if channel != "Fz" or form is None:
        return None
    curve = measured(plan, name, channel)
    keep = (curve.depth > 0) & ~curve.held
    try:
        return form.start(plan.cases[plan.case_of[name]], curve.depth[keep], curve.value[keep])
    except ValueError:
        return None


def put_on(level: ModelLevel, onto: ModelLevel) -> ModelLevel:
    """An effect on the level that holds."""
    merged = replace(
        onto,
        name=level.name,
        title=level.title,
        description=level.description,
        settings={**onto.settings, **level.settings},
        open={**onto.open, **level.open},
        hold={k: v for k, v in onto.hold.items() if k not in level.open},
        relative=onto.relative | level.relative,
        extends="" if level.settings else onto.name,
    )
    return merged


# ------------------------------------------------------------------------------------------------------ one level


def fit_level(
    plan: Plan,
    evaluator: Evaluator,
    level: ModelLevel,
    ranges: Mapping[str, tuple[float, float]],
    below: FittedLevel | None,
) -> FittedLevel:
    """Design, emulator, most likely point recomputed until it holds, what the curves determine; NoAnswer if it cannot.

    `below` is the level that this one is at neutral: its runs are learnt too.
    """
    seed = plan.seed
    axes, before = axes_of(plan, level, ranges), set(evaluator.cost)
    inherited = neutral(plan, axes, level, below)
    points = level_design(axes, plan.study.ladder.runs, seed, len(inherited))
    answers = simulate_level(evaluator, level, axes, plan.cases, points)
    samples = [sampled(plan, axes, p, a) for p, a in zip(points, answers, strict=True) if not isinstance(a, str)]
    last = next((a for a in answers if not isinstance(a, str)), None)
    if last is None or len(samples) < min(MIN_RUNS_OF_LEVEL, len(points)):
        why = next((a for a in answers if isinstance(a, str)), "")
        raise LadderUnanswered(
            f"only {len(samples)} of {len(points)} simulations have an answer; the first without: {why}"
        )
    if not level.closed_form:
        prove(plan, evaluator, level, axes, samples[0])
    samples += inherited
    lost: list[str] = []
    try:
        emulator, last, gap, x, sure = confirm_level(plan, evaluator, level, axes, learnt(plan, axes, samples), last)
        if plan.resolved.inputs and not level.closed_form:
            plan, lost = with_level_effects(plan, evaluator, level, axes.physical(_point(axes, x)))
            emulator, last, gap, x, sure = confirm_level(plan, evaluator, level, axes, emulator, last)
        misfit = likelihood(plan, emulator, last, "fit", x)
        d = determine(misfit, seed=seed, near=x[None], mcmc=False)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise LadderUnanswered(str(error)) from error
    return replace(_finished(plan, evaluator, axes, emulator, d, last, gap, sure, before), lost=tuple(lost))


def with_level_effects(
    plan: Plan, evaluator: Evaluator, level: ModelLevel, values: Mapping[str, float]
) -> tuple[Plan, list[str]]:
    """The plan with what uncertain inputs make of its curves under a level, and which of them count as exact for want
    of an answer; an input that the level fits is none."""
    resolved = replace(plan.resolved, inputs=tuple(i for i in plan.resolved.inputs if i.parameter.name not in values))
    cases = tuple(replace(c, settings={**c.settings, **level.settings}) for c in plan.cases)
    found, _, lost = learn_effects(Runner(replace(plan, resolved=resolved, cases=cases), evaluator), values)
    return replace(plan, effects=found.plan.effects), lost


def _point(axes: Axes, x: np.ndarray) -> dict[str, float]:
    theta = axes.box.from_unit(x[None])[0]
    return dict(zip(axes.box.names, map(float, theta), strict=True))


def learnt(plan: Plan, axes: Axes, samples: Sequence[Sample], kind: str = "") -> Emulator:
    """Emulator of the compared curves, of a `kind`.

    Without one it is that of [surrogate], whole curves where it leaves the choice.
    """
    table = plan.study.surrogate
    kind = kind or ("whole_curve" if table.kind == "auto" else table.kind)
    return learn_emulator(
        axes.box, axes.group, curve_outputs(plan), samples, kind=kind, degree=table.degree, seed=plan.seed
    )


def confirm_level(
    plan: Plan, evaluator: Evaluator, level: ModelLevel, axes: Axes, emulator: Emulator, last: tuple[Response, ...]
) -> tuple[Emulator, tuple[Response, ...], float, np.ndarray, bool]:
    """The most likely point recomputed and learnt until the difference is no matter.

    Emulator, last run, by how much of the largest value it was off, the point, and whether that was no matter: less
    than half a unit of χ², whatever share that is of a small lateral force.  What still misses after half of the
    rounds is learnt as whole curves: a polynomial of few terms comes no nearer by one more run.
    """
    x = None
    for done in range(MAX_LEVEL_OPTIMUM_RUNS):
        misfit = likelihood(plan, emulator, last, "fit")
        fit = all_minima(misfit, seed=plan.seed, near=None if x is None else x[None])[0]
        if emulator.reduced is None:  # similarity, which was proved, knows every run already
            return emulator, last, 0.0, fit.x, True
        # Rounded, so that a ladder that is climbed again asks for the same runs.
        theta = [float(f"{v:.{LIKELIEST_VALUE_DIGITS}g}") for v in fit.theta]
        x = np.clip(axes.box.to_unit(np.array(theta)), 0.0, 1.0)
        values = dict(zip(axes.box.names, theta, strict=True))
        (answer,) = simulate_level(evaluator, level, axes, plan.cases, [values])
        if isinstance(answer, str):
            raise LadderUnanswered(f"the most likely point has no answer: {answer}")
        last, (gap, off) = answer, _gap(plan, misfit, x, answer)
        if off > 1e-6:  # the same point twice would tell nothing
            more = sampled(plan, axes, values, answer)
            if done + 1 == MAX_LEVEL_OPTIMUM_RUNS // 2 and off > MAX_EMULATOR_CHI2:
                emulator = learnt(plan, axes, [*emulator.samples, more], "whole_curve")
            else:
                emulator = relearn(emulator, [more], seed=plan.seed)
        if off <= MAX_EMULATOR_CHI2:
            return emulator, last, gap, x, True
    assert x is not None  # of the last round
    return emulator, last, gap, x, False


def _finished(
    plan: Plan,
    evaluator: Evaluator,
    axes: Axes,
    emulator: Emulator,
    d: Determination,
    last: tuple[Response, ...],
    gap: float,
    sure: bool,
    before: set[str],
) -> FittedLevel:
    fit = d.fit
    pairs = [(r, *pair) for r in ("fit", "select") for pair in force_curves(plan, r)]
    places = tuple(places_from_contact(plan, name, channel) for _, name, channel in pairs)
    errors = tuple(numerical(last[plan.case_of[p.experiment]], p, curve_data(plan, p).value) for p in places)
    misfits = [likelihood(plan, emulator, last, r, fit.x) for r in ("fit", "select") if force_curves(plan, r)]
    data = tuple(v for m in misfits for v in m.data)
    flat = np.concatenate([m.model.predict(fit.x[None])[0] for m in misfits])
    predicted = tuple(np.split(flat, np.cumsum([len(v.value) for v in data])[:-1]))
    simulated = model_selection.bootstrap_refits(d.misfit, fit, plan.seed, plan.study.ladder.draws)
    mine = set(evaluator.cost) - before
    return FittedLevel(
        axes,
        emulator,
        d,
        places,
        tuple(r for r, *_ in pairs),
        data,
        predicted,
        errors,
        simulated,
        gap,
        sure,
        len(mine),
        sum(evaluator.cost[k] for k in mine),
    )


def judged(plan: Plan, level: ModelLevel, whole: ModelLevel, found: FittedLevel, onto: str) -> Judged:
    """The verdict, evidence and what the level adds."""
    d, share, seed = found.determination, plan.study.ladder.confidence, plan.seed
    k = found.roles.count("fit")
    other = found.data[k:]
    residual = [f - v.value for f, v in zip(found.predicted, found.data, strict=True)]
    parts = [Left(np.concatenate(residual[:k]), d.misfit, found.simulated, found.roles[:k])]
    if other:
        model = emulated_together(found.emulator, found.places[k:])
        elsewhere = model_selection.simulate_elsewhere(model, other, d.fit, found.simulated.X, seed)
        parts.append(Left(np.concatenate(residual[k:]), Misfit(model, other), elsewhere, found.roles[k:]))
    axis_of = {knob: axis for axis, knob in found.axes.knob.items()}
    known = {v.name: v for v in d.known}
    neutral_of = {p.name: p.neutral for p in plan.backend.parameters}
    added = tuple(
        Added(
            axis_of[n],
            known[axis_of[n]].verdict.word == "determined",
            f"{known[axis_of[n]].story} {known[axis_of[n]].reason}".strip(),
            _shown(known[axis_of[n]], found.axes, neutral_of.get(n)),
        )
        for n in level.open
    )
    evidence = model_selection.log_evidence(d.misfit, d.fit, seed)
    goodness = model_selection.assess(parts, share)
    excused = None if goodness.passes else if_autocorrelated(plan, found, parts[1:])
    return Judged(replace(whole, extends=level.extends), "", goodness, added, evidence, onto, found, excused)


def if_autocorrelated(plan: Plan, found: FittedLevel, elsewhere: Sequence[Left]) -> model_selection.Goodness | None:
    """How good a level is if readings that count as white by default are autocorrelated as what it leaves does.

    The size of such errors is not seen in how neighbours differ: where nobody has stated it, it is what is left.
    """
    white, near = found.determination.misfit, found.determination.fit.x
    misfit = with_autocorrelation(white, near)
    if not any(v.memory for v in misfit.data):
        return None
    fit = all_minima(misfit, seed=plan.seed, near=near[None])[0]
    if math.isfinite(misfit.freedom):
        larger = max(fit.chi2 / max(misfit.n - misfit.model.box.d, 1), 1.0)
        if larger > RULES.refuted_error_ratio**2:
            return None
        misfit = replace(misfit, data=tuple(v.plus((larger - 1.0) * v.covariance) for v in misfit.data))
    simulated = model_selection.bootstrap_refits(misfit, fit, plan.seed, plan.study.ladder.draws)
    residual = misfit.model.predict(fit.x[None])[0] - np.concatenate([v.value for v in misfit.data])
    part = Left(residual, misfit, simulated, found.roles[: found.roles.count("fit")])
    return model_selection.assess([part, *elsewhere], plan.study.ladder.confidence)


def _shown(known: Known, axes: Axes, absent: float | None) -> bool:
    """Whether the interval of a parameter ends, by the data and not at a bound, before the value where it is absent."""
    i = known.profile_interval
    low, high = physical(axes.box, axes.box.names.index(known.name), i)
    return absent is not None and ((absent < low and not i.at_low) or (absent > high and not i.at_high))


def neutral(plan: Plan, axes: Axes, level: ModelLevel, below: FittedLevel | None) -> list[Sample]:
    """Runs of the level below as runs of this one, where its parameters are neutral; none where that is outside."""
    off = {p.name: p.neutral for p in plan.backend.parameters}
    if below is None or axes.group.reference != below.axes.group.reference or level.closed_form:
        return []
    values = {}
    for axis, low, high in zip(axes.box.names, axes.box.low, axes.box.high, strict=True):
        if axis not in below.axes.box.names:
            v = off.get(axes.knob[axis])
            if v is None or not low <= v <= high or (axes.power.get(axes.knob[axis]) and v != 0.0):
                return []
            values[axis] = float(v)
    return [replace(s, values={**s.values, **values}) for s in below.emulator.samples]


# ------------------------------------------------------------------------------------------------------ curves


def likelihood(
    plan: Plan, emulator: Emulator, answer: tuple[Response, ...], role: str, x: np.ndarray | None = None
) -> Misfit:
    """Misfit of the curves of a role: errors of the measurement, and those of the model at x (d,), where `answer` is
    near (:mod:`rso.inference.error_model`).

    Without x, while a run of the most likely point is looked for, the emulator is taken for right.
    """
    places, data = [], []
    for name, channel in force_curves(plan, role):
        place = places_from_contact(plan, name, channel)
        d, run = curve_data(plan, place), answer[plan.case_of[name]]
        errors = of_response(run, place, d.value) if x is None else of_emulator(emulator, x, run, place, d.value)
        places.append(place)
        data.append(with_model_errors(d, errors))
    return Misfit(emulated_together(emulator, places), tuple(data))


def _gap(plan: Plan, misfit: Misfit, x: np.ndarray, answer: tuple[Response, ...]) -> tuple[float, float]:
    """Difference of the predicted and the recomputed curves: over the largest value of each, and in units of χ²."""
    places = [places_from_contact(plan, name, channel) for name, channel in force_curves(plan, "fit")]
    curves = [resample(answer[plan.case_of[p.experiment]], p, "") for p in places]
    whole = misfit.model.predict(x[None])[0]
    off = float(np.sum(misfit.white(whole - np.concatenate(curves)) ** 2))
    f = np.split(whole, np.cumsum([len(c) for c in curves])[:-1])
    top = max(float(np.abs(c).max()) for c in curves)
    sizes = [max(float(np.abs(c).max()), 1e-4 * top) for c in curves]  # by symmetry a lateral force may be zero
    return max(float(np.abs(a - b).max()) / s for a, b, s in zip(f, curves, sizes, strict=True)), off
