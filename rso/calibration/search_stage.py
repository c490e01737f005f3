"""Search, verification and validation of a study: from surrogates to candidates that were rerun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso import optimise
from rso.calibration.held_out import HeldOutReadings, held_out_readings, task
from rso.calibration.plan import Plan, SearchPlan, limited
from rso.calibration.readings import compared_curves, curve_place
from rso.calibration.stages import Design, Runner, learn_more, outputs_sample
from rso.contract import Curve
from rso.core.curves import CREEP_CHANNEL, Metrics, baseline, first_loading, hold_rows, metrics, way_back
from rso.data import MeasuredCurve
from rso.emulation.emulator import Emulator
from rso.emulation.feasibility import FeasibleRegion
from rso.evaluation import Outcome, Task
from rso.evaluation.store import Done
from rso.inference import outputs_of, readings_of, resample
from rso.optimise import Choice
from rso.optimise.targets import Checked, against, excess_over_limits, target_residuals, violations
from rso.optimise.verification import Candidate, Verified, agreement, verify


@dataclass(frozen=True, eq=False)
class Proposal:
    """What a search on the surrogates proposes."""

    front: optimise.Front
    choice: Choice


@dataclass(frozen=True, eq=False)
class SearchResult:
    """A search that is finished and verified."""

    plan: SearchPlan
    front: optimise.Front
    result: Verified
    story: str
    metrics: tuple[Mapping[str, Metrics], ...]


@dataclass(frozen=True, eq=False)
class Validation:
    """A channel of an experiment kept for the end, predicted by one candidate: its search, its place there, its values.

    `predicted` and its numerical `error` are (n,) over the readings that were `kept`, None without an answer.
    """

    kept: HeldOutReadings
    search: str
    candidate: int
    values: Mapping[str, float]
    outcome: Outcome
    predicted: np.ndarray | None
    error: np.ndarray | None
    metrics: Metrics | None


# ------------------------------------------------------------------------------------------------------ search


def propose_all(bench: Runner, emulator: Emulator, first: Proposal | None = None) -> list[Proposal]:
    """First proposal of every search; their candidates are run in one go, while the next searches are still at work.

    `first` is that of the main search on this emulator where it is known already.
    """
    proposals: list[Proposal] = []
    for wanted in bench.plan.searches:
        first, found = None, first or propose(bench.plan, wanted, emulator)
        proposals.append(found)
        begin_candidates(bench, found)
    bench.run([bench.plan.values(x) for p in proposals for x in p.choice.X])
    return proposals


def begin_candidates(bench: Runner, found: Proposal) -> None:
    """Let the workers begin the runs of what is proposed."""
    bench.evaluator.begin([task for x in found.choice.X for task in bench.plan.tasks(bench.plan.values(x))])


def find_candidates(bench: Runner, wanted: SearchPlan, emulator: Emulator, first: Proposal) -> SearchResult:
    """Candidates, their reruns, infill and new proposals until predicted and recomputed agree."""
    plan = bench.plan
    proposals = [first]
    failed: list[Mapping[str, float]] = []

    def again(current: Emulator) -> Choice:
        nonlocal plan
        if current is not emulator:
            plan = bench.around_failures(emulator.group.reference is not None).plan
            proposals.append(propose(plan, wanted, current))
        return proposals[-1].choice

    def rerun(current: Emulator, choice: Choice) -> list[Candidate]:
        points = [plan.values(x) for x in choice.X]
        return [
            _candidate(plan, wanted, current, x, v, outcomes)
            for x, v, outcomes in zip(choice.X, points, bench.run(points), strict=True)
        ]

    def enrich(current: Emulator, candidates: list[Candidate]) -> Emulator:
        known = {tuple(sorted(s.values.items())) for s in current.samples}
        new = [
            outputs_sample(plan, c.values, c.outcomes)
            for c in candidates
            if c.state == "done" and tuple(sorted(c.values.items())) not in known
        ]
        lost = [c.values for c in candidates if c.state == "failed" and c.values not in failed]
        failed.extend(lost)
        if not new:
            return replace(current) if lost else current
        return learn_more(bench, current, new)

    result = verify(emulator, wanted.outputs, again, rerun, enrich, plan.study.verify.max_infill)
    scores = tuple(curve_metrics(plan, c.outcomes) if c.state == "done" else {} for c in result.candidates)
    return SearchResult(
        wanted, proposals[-1].front, result, optimise.choice_sentences(result.choice, plan.box, wanted.goals), scores
    )


def propose(plan: Plan, wanted: SearchPlan, emulator: Emulator) -> Proposal:
    """NSGA-II on the surrogates, and the choice of candidates from its front and the acceptable set."""
    table = plan.study.search
    constrained = [limited(c) for c in plan.constraints]

    def signed(X: np.ndarray) -> np.ndarray:
        return target_residuals(wanted.goals, emulator.means(wanted.outputs, X))

    def violated(X: np.ndarray) -> np.ndarray:
        outputs = violations(plan.constraints, emulator.means(constrained, X)) if constrained else np.empty((len(X), 0))
        return np.column_stack([outputs, plan.excess(X)])

    limits = violated if constrained or plan.conditions else None

    front = optimise.nsga2(
        lambda X: np.abs(signed(X)),
        plan.box.d,
        seed=plan.seed,
        constraints=limits,
        population=table.population,
        generations=table.generations,
        low=wanted.low,
        high=wanted.high,
    )
    choice = optimise.choose_candidates(
        front,
        signed,
        np.array([g.uncertainty if g.read else g.sigma for g in wanted.goals]),
        seed=plan.seed,
        violations=limits,
        count=table.candidates,
        low=wanted.low,
        high=wanted.high,
    )
    return Proposal(front, choice)


def _candidate(
    plan: Plan,
    wanted: SearchPlan,
    emulator: Emulator,
    x: np.ndarray,
    values: Mapping[str, float],
    outcomes: tuple[Outcome, ...],
) -> Candidate:
    predicted = {}
    for output in emulator.outputs:
        mean, sd = emulator.predict(output, x[None])
        predicted[output.id] = (float(mean[0]), float(sd[0]))
    if not all(isinstance(o, Done) for o in outcomes):
        return Candidate(values, predicted, {}, outcomes, None, False)
    known = outputs_sample(plan, values, outcomes)
    recomputed = known.outputs
    sigma = {o.id: g.sigma for o, g in zip(wanted.outputs, wanted.goals, strict=True)}
    gap, worst = agreement(predicted, recomputed, sigma)
    good = gap <= plan.study.verify.tolerance
    checked = demands(plan, wanted, x, recomputed, known.errors)
    return Candidate(values, predicted, recomputed, outcomes, gap, good, worst, checked)


def demands(
    plan: Plan, wanted: SearchPlan, x: np.ndarray, outputs: Mapping[str, float], errors: Mapping[str, float]
) -> tuple[Checked, ...]:
    """Recomputed outputs by id, with numerical errors, of a point x (d,) of the unit cube against what is demanded."""
    pairs = zip(wanted.outputs, wanted.goals, strict=True)
    targets = [against(g, o.id, outputs[o.id], errors.get(o.id, 0.0)) for o, g in pairs]
    limits = [excess_over_limits(c, limited(c).id, outputs[limited(c).id]) for c in plan.constraints]
    theta = dict(zip(plan.box.names, plan.box.from_unit(x[None]).T, strict=True))
    stated = [c for c in plan.conditions if not isinstance(c, FeasibleRegion)]
    excess = [max(float(c.excess(theta)[0]), 0.0) for c in stated]
    rules = [Checked("condition", None, c.text, e, e, 0.0, "") for c, e in zip(stated, excess, strict=True)]
    return (*targets, *limits, *rules)


def curves_of_runs(plan: Plan, outcomes: Sequence[Outcome]) -> dict[str, tuple[str, MeasuredCurve, Curve]]:
    """Label → experiment, measured and simulated curve of every compared channel in runs that are done."""
    found = {}
    for name, (experiment, curve) in compared_curves(plan).items():
        outcome = outcomes[plan.case_of[experiment]]
        assert isinstance(outcome, Done)
        found[name] = experiment, curve, outcome.response.curve(curve.channel)
    return found


def done_curves(plan: Plan, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Every compared curve in runs that are done: loading over depth, and its hold over time where it has one."""
    found = {}
    for name, (experiment, record, curve) in curves_of_runs(plan, outcomes).items():
        loading = first_loading(curve.travel_mm) & (curve.channel != CREEP_CHANNEL)
        if record.back and len(back := way_back(curve.travel_mm)) > 1:
            loading = back[::-1]
        found[name] = {
            "experiment": experiment,
            "channel": curve.channel,
            "depth": curve.travel_mm[loading],
            "value": curve.value[loading],
            "error": curve.error[loading],
        }
        if record.since is not None:
            outcome = outcomes[plan.case_of[experiment]]
            assert isinstance(outcome, Done)
            since, depth = record.since[record.held], float(record.depth[record.held][0])
            at = hold_rows(curve.channel, outcome.response.channels["time"], curve.travel_mm, depth, since)
            found[name]["hold"] = {"since": since, "value": curve.value[at], "error": curve.error[at]}
    return found


def curve_metrics(plan: Plan, outcomes: Sequence[Outcome]) -> dict[str, Metrics]:
    """Error metrics of runs that are done against every compared curve, at the measured depths."""
    found = {}
    for name, (experiment, curve, simulated) in curves_of_runs(plan, outcomes).items():
        outcome = outcomes[plan.case_of[experiment]]
        assert isinstance(outcome, Done)
        deepest = float(simulated.travel_mm.max())
        keep = curve.compared & (curve.depth <= deepest + 1e-9)
        found[name] = metrics(
            curve.value[keep], resample(outcome.response, curve_place(experiment, curve, keep, deepest), "")
        )
    return found


def mean_over_design(plan: Plan, design: Design, emulator: Emulator) -> dict[str, Metrics]:
    """Mean of each metric over the design that was asked for, from the surrogates of the curve.

    Points whose own run failed, or would rather fail, take no part.
    """
    found = {}
    failed = np.array([[r.values[n] for n in plan.box.names] for r in design.runs if not r.done])
    theta = plan.box.from_unit(design.asked)
    lost = np.array([len(failed) > 0 and np.isclose(t, failed, rtol=1e-9, atol=0).all(axis=1).any() for t in theta])
    points = design.asked[~lost]
    points = points[plan.feasible(points)] if len(points) else points
    if not len(points):
        return {}
    for name, (experiment, measured) in compared_curves(plan).items():
        outputs = [o for o in plan.outputs if o.experiment == experiment and o.channel == measured.channel]
        deepest = max(o.depth_mm for o in outputs)
        keep = measured.compared & (measured.depth <= deepest + 1e-9)
        place = curve_place(experiment, measured, keep, deepest)
        outputs = outputs_of(outputs, place)
        curves = emulator.means(outputs, points)
        each = [metrics(measured.value[keep], readings_of(outputs, y, place)) for y in curves]
        mean = {k: float(np.mean([getattr(m, k) for m in each])) for k in ("rmse", "nrmse", "mre", "mape", "rrmse")}
        found[name] = Metrics(**mean, n=each[0].n, excluded=each[0].excluded, floor=each[0].floor)
    return found


def baselines(plan: Plan) -> dict[str, Metrics]:
    """The model that predicts the mean of each fitted curve."""
    return {n: baseline(c.value[c.compared]) for n, (_, c) in compared_curves(plan).items() if len(c.depth) > 1}


# ------------------------------------------------------------------------------------------------------ validation


Chosen = tuple[str, int, Mapping[str, float]]  # a search, a place among its candidates, its values


def chosen_candidates(found: Sequence[SearchResult], best: tuple[str, int] | None) -> list[Chosen]:
    """The candidates of the main search and the best one of all."""
    places = [(found[0].plan.name, k) for k in range(len(found[0].result.candidates))]
    values = {f.plan.name: [c.values for c in f.result.candidates] for f in found}
    return [(name, k, values[name][k]) for name, k in dict.fromkeys([*places, *([best] if best else [])])]


def validate_candidates(bench: Runner, those: Sequence[Chosen]) -> list[Validation]:
    """Predict every compared channel of the experiments kept for the end with the chosen candidates."""
    plan, tasks = bench.plan, validation_tasks(bench.plan, those)
    pairs = [(e, c) for e in plan.validation for c in those]
    outcomes = bench.evaluator.run(tasks) if tasks else []
    return [_validated(k, *c, o) for (e, c), o in zip(pairs, outcomes, strict=True) for k in held_out_readings(plan, e)]


def validation_tasks(plan: Plan, those: Sequence[Chosen]) -> list[Task]:
    """The simulations of the experiments kept for the end; they may be made before anybody looks at them."""
    return [task(plan, e, v) for e in plan.validation for _, _, v in those]


def _validated(
    k: HeldOutReadings, search: str, candidate: int, values: Mapping[str, float], outcome: Outcome
) -> Validation:
    predicted = k.read(outcome.response) if isinstance(outcome, Done) else None
    error = k.error(outcome.response) if isinstance(outcome, Done) else None
    scores = None if predicted is None else metrics(k.value, predicted)
    return Validation(k, search, candidate, values, outcome, predicted, error, scores)
