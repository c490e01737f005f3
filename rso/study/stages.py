"""The stages of a study, one function each: design → surrogates → sensitivity → search and verify → validate."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rso import doe, search, sensitivity
from rso.curves import Metrics, Resampling, baseline, metrics
from rso.emulator import Emulator, Output, Sample, learn, relearn
from rso.running import Event, Outcome, Task, run_all
from rso.search import Choice
from rso.store import Done, Failed, RunStore
from rso.study.plan import Plan, SearchPlan, fe_design, full_design, limited, proofs
from rso.surrogates import Scores
from rso.targets import residuals, violations
from rso.verify import Candidate, Verified, agreement, verify

SIMILAR_TO = 1e-8  # relative difference up to which two runs count as the same by similarity
NOISE = 1e-4  # share of the largest output of its unit below which an output that nobody asked for is not learnt
REASONS = 3  # reasons of failed runs that are told

Watch = Callable[[Event], None]


class NothingToFit(RuntimeError):
    """Too few runs are done for a surrogate; the message says how the others ended."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Where runs happen: the store, an executor and somebody who watches."""

    plan: Plan
    store: RunStore
    executor: Executor
    watch: Watch | None = None

    def run(self, values: Sequence[Mapping[str, float]]) -> list[tuple[Outcome, ...]]:
        """Outcomes of each point, one per case, in order."""
        tasks = [task for v in values for task in self.plan.tasks(v)]
        outcomes = run_all(self.plan.backend, tasks, self.store, self.executor, watch=self.watch)
        n = len(self.plan.cases)
        return [tuple(outcomes[k * n : (k + 1) * n]) for k in range(len(values))]


@dataclass(frozen=True, eq=False)
class Run:
    """A point that was run, why, and how its cases ended."""

    purpose: str
    values: Mapping[str, float]
    outcomes: tuple[Outcome, ...]

    @property
    def done(self) -> bool:
        """Whether every case has an answer."""
        return all(isinstance(o, Done) for o in self.outcomes)


@dataclass(frozen=True, eq=False)
class Proof:
    """Similarity put to the test: a direct run against the design run scaled; None where one of them failed."""

    values: Mapping[str, float]
    direct: float | None
    similar: float | None
    relative_difference: float | None


@dataclass(frozen=True, eq=False)
class Design:
    """What was run to learn from; `asked` (runs, d) is the design of the study file in the unit cube."""

    asked: np.ndarray
    similar: bool
    story: str
    proofs: tuple[Proof, ...]
    runs: tuple[Run, ...]

    def samples(self, plan: Plan, purpose: str) -> list[Sample]:
        """Runs of one purpose that are done; without similarity those of the reduced box that lie in the study's."""
        runs = [r for r in self.runs if r.purpose == purpose and r.done]
        if not self.similar:
            runs = [r for r in runs if plan.box.contains(np.array([r.values[n] for n in plan.box.names]))]
        return [sample(plan, r.values, r.outcomes) for r in runs]


@dataclass(frozen=True, eq=False)
class Fitted:
    """Surrogates of all outputs, their errors on the last runs before these were learnt too, and the runs added."""

    emulator: Emulator
    held_out: Mapping[str, Scores]
    added: tuple[Run, ...]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Local bars and Sobol indices by output id, at the centre (d,) of the unit cube."""

    at: np.ndarray
    local: Mapping[str, tuple[sensitivity.LocalBar, ...]]
    sobol: Mapping[str, sensitivity.SobolIndices]


@dataclass(frozen=True, eq=False)
class Proposal:
    """What a search on the surrogates proposes."""

    front: search.Front
    choice: Choice


@dataclass(frozen=True, eq=False)
class Found:
    """A search that is finished and verified."""

    plan: SearchPlan
    front: search.Front
    result: Verified
    story: str
    metrics: tuple[Mapping[str, Metrics], ...]


@dataclass(frozen=True, eq=False)
class Validation:
    """One experiment kept for the end, predicted by one candidate: the search's name, its place there, its values."""

    experiment: str
    search: str
    candidate: int
    values: Mapping[str, float]
    outcome: Outcome
    depth: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    predicted: np.ndarray | None
    metrics: Metrics | None


def sample(plan: Plan, values: Mapping[str, float], outcomes: Sequence[Outcome]) -> Sample:
    """Outputs of a point whose runs are all done."""
    outputs = {}
    for output in (*plan.outputs, *plan.extras):
        outcome = outcomes[plan.case_of[output.experiment]]
        assert isinstance(outcome, Done)
        outputs[output.id] = output.read(outcome.response)
    return Sample(dict(values), outputs)


def why(outcome: Outcome) -> tuple[str | None, str | None]:
    """Cause class and first line of the reason of a run that is not done; ("crash", …) for a crash."""
    if isinstance(outcome, Done):
        return None, None
    first = (outcome.reason.splitlines() or ["no reason given"])[0]
    return (outcome.cause if isinstance(outcome, Failed) else "crash"), first


# ------------------------------------------------------------------------------------------------------ design


def run_design(bench: Bench) -> Design:
    """Run the design; with similarity first the reduced one and its proof, and without a proof the full one."""
    plan = bench.plan
    asked = full_design(plan)
    if plan.group.reference is None:
        return Design(asked, False, plan.group.why, (), _runs(bench, *fe_design(plan, False), []))
    points, held = fe_design(plan, True)
    pairs = proofs(plan, points)
    runs = _runs(bench, points, held, [direct for direct, _ in pairs])
    proved = tuple(_proof(plan, pair, runs) for pair in pairs)
    differences = [p.relative_difference for p in proved if p.relative_difference is not None]
    if differences and max(differences) <= SIMILAR_TO:
        return Design(asked, True, plan.group.why, proved, runs)
    if not any(r.done for r in runs):  # nothing says that the full design would do better
        return Design(asked, False, "not applied: no run was done", proved, runs)
    story = "not applied: none of the proof runs was done"
    if differences:
        story = f"not applied: the proof runs differ by {max(differences):.1e}, more than {SIMILAR_TO:g}; "
        story += "the backend is not similar"
    return Design(asked, False, story, proved, (*runs, *_runs(bench, *fe_design(plan, False), [])))


def _runs(bench: Bench, design: list[dict], held: list[dict], direct: list[dict]) -> tuple[Run, ...]:  # type: ignore[type-arg]
    purposes = ["design"] * len(design) + ["held_out"] * len(held) + ["proof"] * len(direct)
    points = [*design, *held, *direct]
    return tuple(Run(p, v, o) for p, v, o in zip(purposes, points, bench.run(points), strict=True))


def _proof(plan: Plan, pair: tuple[dict, dict], runs: Sequence[Run]) -> Proof:  # type: ignore[type-arg]
    """The output with the largest relative difference among those that are not noise about zero."""
    direct, similar = (next(r for r in runs if r.values == v) for v in pair)
    if not (direct.done and similar.done):
        return Proof(pair[0], None, None, None)
    ratio = pair[0][plan.group.reference] / plan.group.reference_value
    every = (*plan.outputs, *plan.extras)
    a, b = sample(plan, *_of(direct)), sample(plan, *_of(similar))
    scaled = {o.id: plan.group.expand(o.channel, b.outputs[o.id], ratio) for o in every}
    largest = _largest(plan, [a])
    difference = {
        o.id: abs(a.outputs[o.id] - scaled[o.id]) / abs(a.outputs[o.id])
        for o in every
        if abs(a.outputs[o.id]) > NOISE * largest[o.unit]
    }
    if not difference:
        return Proof(pair[0], None, None, None)
    worst = max(difference, key=lambda i: difference[i])
    return Proof(pair[0], a.outputs[worst], scaled[worst], difference[worst])


def _largest(plan: Plan, samples: Sequence[Sample]) -> dict[str, float]:
    """Largest absolute output by unit."""
    every = (*plan.outputs, *plan.extras)
    return {
        unit: max((abs(s.outputs[o.id]) for s in samples for o in every if o.unit == unit), default=0.0)
        for unit in {o.unit for o in every}
    }


def _of(run: Run) -> tuple[Mapping[str, float], tuple[Outcome, ...]]:
    return run.values, run.outcomes


# ------------------------------------------------------------------------------------------------------ surrogates


def decisive(plan: Plan) -> list[str]:
    """Ids of the outputs that a search or a metric rests on: the fitted curves and what is constrained."""
    return [o.id for o in (*plan.outputs, *map(limited, plan.constraints))]


def fit_surrogates(bench: Bench, design: Design) -> Fitted:
    """Fit all outputs; predict new runs, then learn them, until the predictions are good enough.

    The first new runs are the held-out ones.  While the error of a decisive output exceeds surrogate.tolerance,
    points are added where the design is thinnest, at most verify.max_infill of them.
    """
    plan = bench.plan
    table = plan.study.surrogate
    kind = "auto" if table.kind == "whole_curve" else table.kind  # a whole curve is one surrogate per travel
    degree = table.degree if "degree" in table.model_fields_set else None
    group = plan.group if design.similar else dataclasses.replace(plan.group, reference=None)
    learnt, new = design.samples(plan, "design"), design.samples(plan, "held_out")
    outputs = [*plan.outputs, *_worth_learning(plan, learnt)]
    added: list[Run] = []
    scores: dict[str, Scores] = {}
    try:
        emulator = learn(plan.box, group, outputs, learnt, kind=kind, degree=degree, seed=plan.seed)
        while new:
            scores = {o.id: emulator.score(o, new) for o in outputs}
            emulator = relearn(emulator, new, seed=plan.seed)
            room = min(len(new), plan.study.verify.max_infill - len(added))
            if not any(scores[i].relative_rmse > table.tolerance for i in decisive(plan)) or room < 1:
                break
            points = thinnest(plan, emulator, room)
            runs = [Run("infill", v, o) for v, o in zip(points, bench.run(points), strict=True)]
            added += runs
            new = [sample(plan, r.values, r.outcomes) for r in runs if r.done]
    except ValueError as error:
        reasons = [why(o)[1] or "" for r in design.runs for o in r.outcomes if not isinstance(o, Done)]
        shown = "; ".join(list(dict.fromkeys(reasons))[:REASONS]) or "none failed"
        done = sum(r.done for r in design.runs)
        raise NothingToFit(f"{error} ({done} of {len(design.runs)} runs done; the others: {shown})") from error
    return Fitted(emulator, scores, tuple(added))


def thinnest(plan: Plan, emulator: Emulator, count: int) -> list[dict[str, float]]:
    """Values of `count` new points that are farthest from all samples in the (reduced) box."""
    box = emulator.reduced
    if box is None:
        return []
    group = emulator.group
    known = box.to_unit(np.array([[group.reduce(s.values)[1][n] for n in box.names] for s in emulator.samples]))
    fresh = box.from_unit(doe.extend(np.clip(known, 0.0, 1.0), count, plan.seed))
    fixed = {} if group.reference is None else {group.reference: group.reference_value}
    return [{**fixed, **dict(zip(box.names, map(float, row), strict=True)), **plan.resolved.fixed} for row in fresh]


def _worth_learning(plan: Plan, samples: Sequence[Sample]) -> list[Output]:
    """Extra outputs that are constrained or vary: by symmetry a channel may be noise about zero everywhere."""
    constrained = {limited(c) for c in plan.constraints}
    largest = _largest(plan, samples)
    spread = {o: np.ptp([s.outputs[o.id] for s in samples]) if samples else 0.0 for o in plan.extras}
    return [o for o in plan.extras if o in constrained or spread[o] > NOISE * largest[o.unit]]


# ------------------------------------------------------------------------------------------------------ sensitivity


def analyse(plan: Plan, fitted: Fitted) -> Sensitivity:
    """Local bars and Sobol indices of the targets of the main search and of the extra outputs."""
    table = plan.study.sensitivity
    centre = np.full(plan.box.d, 0.5)
    emulator = fitted.emulator
    wanted = [*plan.searches[0].outputs, *(o for o in emulator.outputs if o in plan.extras)]
    samples = 2 ** max(2, round(np.log2(table.samples)))
    local, sobol = {}, {}
    for output in dict.fromkeys(wanted):

        def predict(X: np.ndarray, output: Output = output) -> np.ndarray:
            return emulator.mean(output, X)

        if table.local:
            local[output.id] = sensitivity.local(predict, centre, plan.box.names, plan.box)
        if table.sobol:
            sobol[output.id] = sensitivity.sobol(predict, plan.box.d, plan.seed, n=samples)
    return Sensitivity(centre, local, sobol)


# ------------------------------------------------------------------------------------------------------ search


def propose_all(bench: Bench, emulator: Emulator) -> list[Proposal]:
    """First proposal of every search; their candidates are run in one go, so that no worker waits for a search."""
    proposals = [propose(bench.plan, wanted, emulator) for wanted in bench.plan.searches]
    bench.run([bench.plan.values(x) for p in proposals for x in p.choice.X])
    return proposals


def find(bench: Bench, wanted: SearchPlan, emulator: Emulator, first: Proposal) -> Found:
    """Candidates, their reruns, infill and new proposals until predicted and recomputed agree."""
    plan = bench.plan
    proposals = [first]

    def again(current: Emulator) -> Choice:
        if current is not emulator:
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
            Sample(c.values, c.recomputed)
            for c in candidates
            if c.state == "done" and tuple(sorted(c.values.items())) not in known
        ]
        if not new:
            return current
        return relearn(current, new, seed=plan.seed)

    result = verify(emulator, wanted.outputs, again, rerun, enrich, plan.study.verify.max_infill)
    scores = tuple(
        {e: curve_metrics(plan, e, c.outcomes) for e in plan.case_of} if c.state == "done" else {}
        for c in result.candidates
    )
    return Found(wanted, proposals[-1].front, result, search.story(result.choice, plan.box, wanted.goals), scores)


def propose(plan: Plan, wanted: SearchPlan, emulator: Emulator) -> Proposal:
    """NSGA-II on the surrogates, and the choice of candidates from its front and the acceptable set."""
    table = plan.study.search
    constrained = [limited(c) for c in plan.constraints]

    def signed(X: np.ndarray) -> np.ndarray:
        return residuals(wanted.goals, emulator.means(wanted.outputs, X))

    def violated(X: np.ndarray) -> np.ndarray:
        return violations(plan.constraints, emulator.means(constrained, X))

    front = search.nsga2(
        lambda X: np.abs(signed(X)), plan.box.d, seed=plan.seed, constraints=violated if constrained else None,
        population=table.population + table.population % 2, generations=table.generations, low=wanted.low,
        high=wanted.high,
    )  # fmt: skip
    choice = search.choose(
        front, signed, np.array([g.sigma for g in wanted.goals]), seed=plan.seed,
        violations=violated if constrained else None, count=table.candidates, low=wanted.low, high=wanted.high,
    )  # fmt: skip
    return Proposal(front, choice)


def _candidate(
    plan: Plan, wanted: SearchPlan, emulator: Emulator, x: np.ndarray, values: Mapping[str, float],
    outcomes: tuple[Outcome, ...],
) -> Candidate:  # fmt: skip
    predicted = {}
    for output in emulator.outputs:
        mean, sd = emulator.predict(output, x[None])
        predicted[output.id] = (float(mean[0]), float(sd[0]))
    if not all(isinstance(o, Done) for o in outcomes):
        return Candidate(values, predicted, {}, outcomes, None, False)
    recomputed = sample(plan, values, outcomes).outputs
    gap = agreement(predicted, recomputed, [o.id for o in wanted.outputs])
    return Candidate(values, predicted, recomputed, outcomes, gap, gap <= plan.study.verify.tolerance)


def curve_metrics(plan: Plan, experiment: str, outcomes: Sequence[Outcome]) -> Metrics:
    """Error metrics of a run against one measured curve, at the measured depths."""
    outcome = outcomes[plan.case_of[experiment]]
    assert isinstance(outcome, Done)
    measured = plan.curves[experiment]
    simulated = outcome.response.curve(measured.channel)
    keep = (measured.depth > 0) & (measured.depth <= simulated.travel_mm[-1] + 1e-9)
    at = np.minimum(measured.depth[keep], simulated.travel_mm[-1])
    return metrics(measured.value[keep], Resampling(simulated.travel_mm, simulated.value)(at))


def mean_over_design(plan: Plan, design: Design, emulator: Emulator) -> dict[str, Metrics]:
    """Mean of each metric over the design that was asked for, from the surrogates of the curve.

    Points whose own run failed take no part.
    """
    found = {}
    failed = [r.values for r in design.runs if not r.done]
    points = np.array([x for x in design.asked if plan.values(x) not in failed])
    if not len(points):
        return {}
    for name, measured in plan.curves.items():
        if name not in plan.case_of:
            continue
        outputs = [o for o in plan.outputs if o.experiment == name and o.channel == measured.channel]
        travel = np.array([o.depth_mm for o in outputs])
        keep = (measured.depth > 0) & (measured.depth <= travel[-1] + 1e-9)
        at = np.minimum(measured.depth[keep], travel[-1])
        curves = emulator.means(outputs, points)
        each = [metrics(measured.value[keep], Resampling(travel, y)(at)) for y in curves]
        mean = {k: float(np.mean([getattr(m, k) for m in each])) for k in ("rmse", "nrmse", "mre", "mape", "rrmse")}
        found[name] = Metrics(**mean, n=each[0].n, excluded=each[0].excluded, floor=each[0].floor)
    return found


def baselines(plan: Plan) -> dict[str, Metrics]:
    """The model that predicts the mean of each fitted curve."""
    return {e: baseline(c.value[c.depth > 0]) for e, c in plan.curves.items() if e in plan.case_of and len(c.depth) > 1}


# ------------------------------------------------------------------------------------------------------ validation


def validate(bench: Bench, found: Sequence[Found], best: tuple[str, int] | None) -> list[Validation]:
    """Predict the experiments kept for the end with the candidates of the main search and the best one of all."""
    plan = bench.plan
    chosen = [(found[0].plan.name, k) for k in range(len(found[0].result.candidates))]
    chosen = list(dict.fromkeys([*chosen, *([best] if best else [])]))
    values = {f.plan.name: [c.values for c in f.result.candidates] for f in found}
    trios = [(e, name, k) for e in plan.validation for name, k in chosen]
    tasks = [Task(values[name][k], plan.validation[e]) for e, name, k in trios]
    outcomes = run_all(plan.backend, tasks, bench.store, bench.executor, watch=bench.watch) if tasks else []
    return [
        _validated(plan, e, name, k, values[name][k], outcome)
        for (e, name, k), outcome in zip(trios, outcomes, strict=True)
    ]


def _validated(
    plan: Plan, experiment: str, search: str, candidate: int, values: Mapping[str, float], outcome: Outcome
) -> Validation:
    curve = plan.curves[experiment]
    keep = curve.depth > 0
    depth, y, sigma = curve.depth[keep], curve.value[keep], curve.sigma[keep]
    predicted, scores = None, None
    if isinstance(outcome, Done):
        simulated = outcome.response.curve(curve.channel)
        predicted = np.asarray(Resampling(simulated.travel_mm, simulated.value)(depth))
        scores = metrics(y, predicted)
    return Validation(experiment, search, candidate, values, outcome, depth, y, sigma, predicted, scores)
