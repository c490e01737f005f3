"""The stages of a study, one function each: design → surrogates → sensitivity → search and verify → validate."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rso import doe, sensitivity
from rso.emulator import Emulator, Output, Sample, learn, relearn
from rso.running import Event, Outcome, run_all
from rso.store import Done, Failed, RunStore
from rso.study.plan import Plan, fe_design, full_design, limited, proofs
from rso.surrogates import Scores

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
