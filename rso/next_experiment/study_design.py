"""What the experiments done say together, and what each one not yet done would add (`rso next`)."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from rso.calibration.plan import Plan
from rso.calibration.readings import of_emulator, record_of
from rso.calibration.stages import Runner
from rso.calibration.uncertain_inputs import learn_effects
from rso.contract import Response
from rso.core.similarity import Group
from rso.core.units import value_in_unit
from rso.emulation.emulator import Emulator, Output, Sample, learn_emulator, reduced_box
from rso.emulation.hermite import along_one
from rso.evaluation import Crashed, Done, Evaluator, Watch
from rso.evaluation.store import RunStore
from rso.inference import (
    CurvePlace,
    Data,
    Determination,
    Interval,
    Misfit,
    Model,
    all_minima,
    determine,
    emulated,
    emulated_together,
    error_covariance,
    stack,
    with_autocorrelation,
    with_model_errors,
)
from rso.inference.error_model import MODEL_ERROR_NAMES, joined_errors
from rso.model_selection import ModelLevel
from rso.model_selection.candidate_models import STUDY_LEVEL, Axes, axes_of
from rso.model_selection.simulations import level_design
from rso.next_experiment.experiments import Block, Item, block_channel, done, planned_experiment, refuse
from rso.optimal_design import ExpectedInformation, PossibleExperiment, expected_information, on_valley
from rso.optimal_design.gains import weakest as known_worst
from rso.study.errors import Problem, choices_text, study_error

MIN_RUNS_OF_EXPERIMENT = 5  # runs with an answer from which an experiment is learnt
REPEAT_SUFFIX = " once more"  # after the name of an experiment that is repeated
N_TRUTHS = 5  # values of the parameter that is known worst, unless the study names them
Near = Callable[[np.ndarray], Response]


@dataclass(frozen=True, eq=False)
class Learnt:
    """An item with its emulator; `near` is the response of the run nearest to a point x (d,) of the unit cube.

    `left_out` is the largest error over the largest value where an inner run is predicted by the others.
    """

    item: Item
    experiment: PossibleExperiment
    emulator: Emulator
    near: Near
    runs: int
    cpu_s: float
    left_out: float


@dataclass(frozen=True, eq=False)
class Joint:
    """What experiments that have been done say together."""

    names: tuple[str, ...]
    determination: Determination


@dataclass(frozen=True, eq=False)
class DesignResult:
    """Everything of `rso next`: fits of what exists; truths (k, d) in the unit cube, what each set shows at each.

    `scale` >= 1 is what all errors were multiplied with because the model misses the data, beside Student's factor
    where few readings show their size; `rise` (k,) is how far χ² of what exists lies above its least value at each
    truth, after both.
    """

    axes: Axes
    learnt: tuple[Learnt, ...]
    problems: Mapping[str, str]
    joint: tuple[Joint, ...]
    weakest: int
    truths: np.ndarray
    rise: np.ndarray
    scale: float
    told: tuple[tuple[ExpectedInformation, ...], ...]


def run_next(
    plan: Plan, store: RunStore, executor: Executor, *, watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> DesignResult:  # fmt: skip
    """Simulate what is missing, fit what has been done alone and together, and ask what the rest would add."""
    table, axes = plan.study.next, axes_of(plan, ModelLevel(STUDY_LEVEL), {})
    possible, values = asked(plan, axes)
    items = [*done(plan), *possible]
    evaluator = Evaluator(plan.backend, store, executor, watch)
    points = level_design(axes, table.runs, plan.seed)
    learnt: list[Learnt] = []
    problems: dict[str, str] = {}
    for item in items:
        say(f"{item.name}: {len(points)} runs")
        found = learn_item(plan, axes, item, points, evaluator)
        if isinstance(found, str):
            problems[item.name] = found
        else:
            learnt.append(found)
    have = [v for v in learnt if v.item.done]
    if not have:
        raise study_error(plan.study.file, plan.study.lines, [Problem(("experiments",), "; ".join(problems.values()))])
    have = autocorrelated(have, plan.seed)
    learnt = [*have, *(v for v in learnt if not v.item.done)]
    joint = fits(plan, have)
    if plan.resolved.inputs:  # what a further test of the same specimen adds is expected for exact dimensions
        told, lost = _with_inputs(plan, axes, points, evaluator, joint[-1].determination, say)
        joint, problems = fits(plan, told), {**problems, **({"uncertainty": "; ".join(lost)} if lost else {})}
    whole = joint[-1].determination
    weakest = axes.box.names.index(next(iter(values)) if values else known_worst(whole.known))
    truths = on_valley(
        whole.misfit, whole.fit.x, weakest, _places(axes, whole.known[weakest].profile_interval, weakest, values)
    )
    # What the model lacks it will lack in the next experiment too; `rso run` counts errors as wide.
    s = whole.wider
    rise = (whole.misfit.chi2(truths) - whole.fit.chi2) / s**2
    more = [with_scaled_errors(v.experiment, s) for v in learnt if not v.item.done]
    existing = [with_scaled_errors(e, s) for e in records(plan, have)]
    again = [dataclasses.replace(e, name=f"{e.name}{REPEAT_SUFFIX}") for e in existing]
    singles = [(e,) for e in (*again, *more)]
    sets = [(), *singles, *itertools.combinations(more, 2)]
    each = [
        tuple(expected_information(axes.box, x, weakest, existing, sets, plan.seed + 100 * k, table.draws))
        for k, x in enumerate(truths)
    ]
    return DesignResult(axes, tuple(learnt), problems, joint, weakest, truths, rise, whole.scale, tuple(each))


def _with_inputs(
    plan: Plan,
    axes: Axes,
    points: Sequence[Mapping[str, float]],
    evaluator: Evaluator,
    d: Determination,
    say: Callable[[str], None],
) -> tuple[list[Learnt], list[str]]:
    """What has been done, learnt again with what uncertain inputs make of it at the most likely point, and which of
    these count as exact for want of an answer."""
    say("uncertainty: simulations with the stated inputs one standard uncertainty off")
    values = {**plan.resolved.fixed, **dict(zip(axes.box.names, map(float, d.fit.theta), strict=True))}
    bench, _, lost = learn_effects(Runner(plan, evaluator), values)
    again = [learn_item(bench.plan, axes, item, points, evaluator) for item in done(bench.plan)]
    return autocorrelated([v for v in again if not isinstance(v, str)], plan.seed), lost


def records(plan: Plan, have: Sequence[Learnt]) -> list[PossibleExperiment]:
    """What has been done, the branches of one record as one test: it is repeated as a whole, and its errors of contact
    and gain are the same in both."""
    groups: dict[str, list[Learnt]] = {}
    for v in have:
        groups.setdefault(record_of(plan, v.item.name), []).append(v)
    return [_as_one(g) if len(g) > 1 else g[0].experiment for g in groups.values()]


def _as_one(branches: Sequence[Learnt]) -> PossibleExperiment:
    data = [[b.data for b in v.item.blocks if b.data is not None] for v in branches]
    common = dict.fromkeys(name for each in data for d in each for name in d.shared)
    shared = [
        [np.concatenate([d.shared.get(name, np.zeros(len(d.value))) for d in each]) for each in data] for name in common
    ]

    def covariance(x: np.ndarray) -> np.ndarray:
        C = block_diag(*(v.experiment.covariance(x) for v in branches))
        for parts in shared:
            s = np.concatenate(parts)
            C = C + np.outer(s, s) - block_diag(*(np.outer(p, p) for p in parts))
        return np.asarray(C)

    name = " and ".join(v.item.name for v in branches)
    return PossibleExperiment(name, stack([v.experiment.model for v in branches]), covariance)


def with_scaled_errors(e: PossibleExperiment, scale: float) -> PossibleExperiment:
    """An experiment with errors `scale` times as large: C scale²."""
    return dataclasses.replace(e, covariance=lambda x: scale**2 * e.covariance(x))


def asked(plan: Plan, axes: Axes) -> tuple[list[Item], dict[str, list[float]]]:
    """What `[next]` asks: experiments that might be done, and values of a parameter in its unit; before any simulation.

    StudyError with all that is wrong.
    """
    items: list[Item] = []
    problems: list[Problem] = []
    for n, e in enumerate(plan.study.next.experiments):
        try:
            items.append(planned_experiment(plan, e))
        except ValueError as error:
            problems.append(Problem(("next", "experiments", n), str(error), e.name))
    values = {name: _values(axes, name, given, problems) for name, given in plan.study.next.truths.items()}
    refuse(plan, items, problems)
    return items, values


def _values(axes: Axes, name: str, given: Sequence[Any], problems: list[Problem]) -> list[float]:
    """Values that a parameter is asked for, in its unit and its range; what is wrong is noted."""
    if name not in axes.box.names:
        problems.append(
            Problem(("next", "truths", name), f"not searched for; {choices_text(name, axes.box.names)}", name)
        )
        return []
    k = axes.box.names.index(name)
    low, high, unit = axes.box.low[k], axes.box.high[k], axes.box.units[k]
    try:
        values = [value_in_unit(v, unit) for v in given]
        if not values or not all(low <= v <= high for v in values):
            raise ValueError(f"values from {low:g} to {high:g} {unit} expected")
    except ValueError as error:
        problems.append(Problem(("next", "truths", name), str(error), list(given)))
        return []
    return values


# ------------------------------------------------------------------------------------------------------ simulations


def learn_item(
    plan: Plan, axes: Axes, item: Item, points: Sequence[Mapping[str, float]], evaluator: Evaluator
) -> Learnt | str:
    """Runs of an experiment over the (reduced) box and what is learnt from them, or why nothing is."""
    outcomes = [o for (o,) in evaluator.at([item.case], [axes.physical(p) for p in points])]
    good = [(p, o.response) for p, o in zip(points, outcomes, strict=True) if isinstance(o, Done)]
    if len(good) < min(MIN_RUNS_OF_EXPERIMENT, len(points)):
        why = next(o.reason.splitlines()[0] for o in outcomes if not isinstance(o, Done))
        return f"only {len(good)} of {len(points)} simulations have an answer; the first without: {why}"
    outputs = [
        Output(item.name, p.channel, u, b.unit, since, p.back)
        for b in item.blocks for p in b.places for u, since in _read_of(item, p)
    ]  # fmt: skip
    samples = []
    for values, response in good:
        by_axis = {o.id: axes.slopes(values, o.gradient(response)) for o in outputs}
        samples.append(Sample(dict(values), {o.id: o.read(response) for o in outputs}, {}, by_axis))
    group = _with_marks(axes.group, outputs)
    emulator, left = learnt_from(axes, group, outputs, samples, plan.seed)
    near = _nearest(axes, good)
    cost = sum(getattr(o, "cpu_s", 0.0) for o in outcomes if not isinstance(o, Crashed))
    experiment = PossibleExperiment(item.name, _model(emulator, item), lambda x: _errors(item, emulator, near, x))
    return Learnt(item, experiment, emulator, near, len(points), cost, left)


def _read_of(item: Item, place: CurvePlace) -> list[tuple[float, float]]:
    """Travel (mm) and time in the hold (s) of everything that is read of a curve."""
    asked, held, way = item.case.programme.asked_mm, place.held, item.case.programme
    if place.back:
        return [(float(f"{u:.9g}"), 0.0) for u in np.interp(way.asked_s, way.time_s, way.travel_mm)[::-1]]
    depth = asked[-1] if asked else float(place.depth[0])
    resting = [] if place.since is None else [(depth, float(s)) for s in place.since[held]]
    return [*((u, 0.0) for u in asked), *resting]


def _with_marks(group: Group, outputs: Sequence[Output]) -> Group:
    """Displacements of surface points do not scale with a modulus."""
    return dataclasses.replace(group, outputs={**group.outputs, **{o.channel: 0 for o in outputs if o.unit == "mm"}})


def learnt_from(
    axes: Axes, group: Group, outputs: Sequence[Output], samples: Sequence[Sample], seed: int
) -> tuple[Emulator, float]:
    """Emulator of all outputs, and the largest error over the largest value of a run predicted by the others.

    Along one parameter, with derivatives, a cubic through values and slopes: many outputs at no cost.
    """
    reduced = reduced_box(axes.box, group)
    curves = None if reduced is None or reduced.d > 1 else along_one(reduced, outputs, samples)
    if curves is not None:
        emulator = Emulator(axes.box, group, reduced, tuple(outputs), curves, tuple(samples))  # type: ignore[arg-type]
        return emulator, max(c.left_out for c in curves.values()) / max(c.largest for c in curves.values())
    emulator = learn_emulator(axes.box, group, outputs, samples, kind="whole_curve", seed=seed)
    if len(samples) <= MIN_RUNS_OF_EXPERIMENT:
        return emulator, 0.0
    k = len(samples) // 2
    others = [s for i, s in enumerate(samples) if i != k]
    less = learn_emulator(axes.box, group, outputs, others, kind="whole_curve", seed=seed)
    x = axes.box.to_unit(np.array([samples[k].values[n] for n in axes.box.names]))
    true = np.array([samples[k].outputs[o.id] for o in outputs])
    return emulator, float(np.abs(less.means(outputs, x[None])[0] - true).max() / np.abs(true).max())


def _nearest(axes: Axes, runs: Sequence[tuple[Mapping[str, float], Response]]) -> Near:
    """Point (d,) of the unit cube → response of the run that is nearest to it, the modulus being scaled out."""
    box, group = axes.box, axes.group

    def place(values: Mapping[str, float]) -> np.ndarray:
        return box.to_unit(np.array([group.reduce(values)[1][n] for n in box.names]))

    at = np.array([place(v) for v, _ in runs])

    def near(x: np.ndarray) -> Response:
        there = place(dict(zip(box.names, map(float, box.from_unit(x)), strict=True)))
        return runs[int(np.argmin(np.sum((at - there) ** 2, axis=1)))][1]

    return near


def _model(emulator: Emulator, item: Item) -> Model:
    return emulated_together(emulator, [p for b in item.blocks for p in b.places])


def _errors(item: Item, emulator: Emulator, near: Near, x: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of all readings where x (d,) is true: of the measurement, and of the model."""
    return np.asarray(block_diag(*(_of_block(b, emulator, near, x).covariance for b in item.blocks)))


def _of_block(b: Block, emulator: Emulator, near: Near, x: np.ndarray) -> Data:
    """What was measured, or would be where x (d,) is true, with the errors of the model there."""
    curves = [emulated(emulator, p)[0].predict(x[None])[0] for p in b.places]
    y = np.concatenate(curves)
    data = Data(b.places[0].experiment, b.unit, b.depth, y, _stated(b, curves)) if b.data is None else b.data
    each = [of_emulator(emulator, x, near(x), p, f) for p, f in zip(b.places, curves, strict=True)]
    return with_model_errors(data, joined_errors(each))


def _stated(b: Block, curves: Sequence[np.ndarray]) -> np.ndarray:
    """Covariance (n, n) of readings not yet taken, by what is stated of them."""
    y, n = np.concatenate(curves), b.noise
    slope = np.concatenate([_slope(p.depth, f) for p, f in zip(b.places, curves, strict=True)])
    return error_covariance(
        b.depth, y, slope, white=0.0 if n.correlation else n.of(block_channel(b)),
        correlated=n.of(block_channel(b)) if n.correlation else 0.0, length=n.correlation or 0.0,
        gain=math.hypot(n.gain or 0.0, n.calibration), depth_noise=n.depth, contact=n.contact or 0.0,
    )  # fmt: skip


def _slope(depth: np.ndarray, value: np.ndarray) -> np.ndarray:
    """df/du (n,), with the contact at u = 0."""
    return np.gradient(np.append(0.0, value), np.append(0.0, depth))[1:]


# ------------------------------------------------------------------------------------------------------ inference


def fits(plan: Plan, have: Sequence[Learnt]) -> tuple[Joint, ...]:
    """Each experiment alone, the first with each other, and all together (last)."""
    names = [v.item.name for v in have]
    wanted = [(n,) for n in names] + [(names[0], n) for n in names[1:]] + [tuple(names)]
    by_name = {v.item.name: v for v in have}
    out = []
    for each in dict.fromkeys(wanted):
        out.append(
            Joint(each, determine(_misfit([by_name[n] for n in each], plan.seed)[0], seed=plan.seed, mcmc=False))
        )
    return tuple(out)


def autocorrelated(have: Sequence[Learnt], seed: int) -> list[Learnt]:
    """What has been done with the memory of readings of one record, of which nobody says whether they have any; it will
    have it once more."""
    known = iter(with_autocorrelation(*_misfit(have, seed)).data)
    found = []
    for v in have:
        blocks = tuple(dataclasses.replace(b, data=next(known).without(*MODEL_ERROR_NAMES)) for b in v.item.blocks)
        item = dataclasses.replace(v.item, blocks=blocks)
        covariance = functools.partial(_errors, item, v.emulator, v.near)
        found.append(
            dataclasses.replace(v, item=item, experiment=dataclasses.replace(v.experiment, covariance=covariance))
        )
    return found


def _misfit(have: Sequence[Learnt], seed: int) -> tuple[Misfit, np.ndarray]:
    """Likelihood of what was measured with the errors of the model at the most likely point (d,), and that point."""
    data = tuple(b.data for v in have for b in v.item.blocks if b.data is not None)
    measured = Misfit(stack([v.experiment.model for v in have]), data)
    x = all_minima(measured, seed=seed)[0].x
    whole = tuple(_of_block(b, v.emulator, v.near, x) for v in have for b in v.item.blocks)
    return dataclasses.replace(measured, data=whole), x


def _places(axes: Axes, allowed: Interval, k: int, values: Mapping[str, Sequence[float]]) -> np.ndarray:
    """Places (t,) in the unit cube of the values that the parameter is asked for.

    Unless stated, over what the data allow of it, as far apart as `N_TRUTHS` of them are over its whole range: of other
    values nothing is to be expected.
    """
    given = values.get(axes.box.names[k])
    if given is None:
        low, high = max(allowed.low, 0.0), min(allowed.high, 1.0)
        n = max(math.ceil(N_TRUTHS * (high - low) - 1e-6), 1)
        return low + (high - low) * (np.arange(n) + 0.5) / n
    theta = np.tile(axes.box.from_unit(np.full((1, axes.box.d), 0.5)), (len(given), 1))
    theta[:, k] = given
    return axes.box.to_unit(theta)[:, k]
