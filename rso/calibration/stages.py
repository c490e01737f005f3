"""The stages of a study, one function each: design → surrogates → sensitivity → search and verify → validate."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rso import doe
from rso.calibration.plan import Plan, fe_design, full_design, limited, proofs, reduced_feasible
from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation import Scores, feasibility
from rso.emulation.emulator import Emulator, Output, Sample, learn_emulator, reduced_box, relearn
from rso.emulation.feasibility import FeasibleRegion
from rso.evaluation import Crashed, Done, Evaluator, Outcome, in_rows, why

SIMILARITY_TOLERANCE = 1e-8  # relative difference up to which two runs count as the same by similarity
# share of the largest output of its unit below which an output that nobody asked for is not learnt
NEGLIGIBLE_OUTPUT_SHARE = 1e-4
NEW_KIND_SAMPLES_RATIO = 1.25  # times as many samples: kinds of surrogates may be chosen anew
MAX_TOLD_REASONS = 3  # reasons of failed runs that are told

Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class NothingToFit(RuntimeError):
    """Too few runs are done for a surrogate; the message says how the others ended."""


@dataclass(frozen=True, eq=False)
class Runner:
    """The points of a plan by its evaluator, and how those that were run have ended."""

    plan: Plan
    evaluator: Evaluator
    ended: list[tuple[Mapping[str, float], str]] = field(default_factory=list)

    def run(self, values: Sequence[Mapping[str, float]]) -> list[tuple[Outcome, ...]]:
        """Outcomes of each point, one per case, in order."""
        each = in_rows(self.evaluator.run([task for v in values for task in self.plan.tasks(v)]), len(self.plan.cases))
        self.ended.extend((v, _worst_state(o)) for v, o in zip(values, each, strict=True))
        return each

    def around_failures(self, similar: bool) -> Runner:
        """The same bench, whose plan also asks that runs have an answer, as far as those that ended show where."""
        region = self.region(similar)
        others = tuple(c for c in self.plan.conditions if not isinstance(c, FeasibleRegion))
        if (region is None or region.model is None) and others == self.plan.conditions:
            return self
        known = () if region is None or region.model is None else (region,)
        return replace(self, plan=replace(self.plan, conditions=(*others, *known)))

    def region(self, similar: bool) -> FeasibleRegion | None:
        """Where runs have an answer.  A crash shows nothing, and of equal points one counts."""
        plan = self.plan
        group = plan.group if similar else replace(plan.group, reference=None)
        box = reduced_box(plan.box, group)
        if box is None or not self.ended:
            return None
        inside = box.contains(np.array([[group.reduce(v)[1][n] for n in box.names] for v, _ in self.ended]))
        known = [e for e, good in zip(self.ended, inside, strict=True) if good and e[1] != "crashed"]
        found = {tuple(sorted(v.items())): (v, state) for v, state in known}
        values, states = [v for v, _ in found.values()], [s == "done" for _, s in found.values()]
        return feasibility.learn_feasibility(box, group, values, states, plan.seed)


def _worst_state(outcomes: Sequence[Outcome]) -> str:
    """'crashed' if any run crashed (it may yet have an answer), else 'failed' if any failed, else 'done'."""
    if any(isinstance(o, Crashed) for o in outcomes):
        return "crashed"
    return "done" if all(isinstance(o, Done) for o in outcomes) else "failed"


@dataclass(frozen=True, eq=False)
class Run:
    """A point that was run, why, and how its `cases` ended: those of the plan, by number, or all of them (None)."""

    purpose: str
    values: Mapping[str, float]
    outcomes: tuple[Outcome, ...]
    cases: tuple[int, ...] | None = None

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
        return [outputs_sample(plan, r.values, r.outcomes) for r in runs]


@dataclass(frozen=True, eq=False)
class FittedSurrogates:
    """Surrogates of all outputs, their errors on the last runs before these were learnt too, and the runs added."""

    emulator: Emulator
    held_out: Mapping[str, Scores]
    added: tuple[Run, ...]


def outputs_sample(plan: Plan, values: Mapping[str, float], outcomes: Sequence[Outcome]) -> Sample:
    """Outputs of a point whose runs are all done."""
    outputs, errors, gradients = {}, {}, {}
    for output in (*plan.outputs, *plan.extras):
        outcome = outcomes[plan.case_of[output.experiment]]
        assert isinstance(outcome, Done)
        outputs[output.id] = output.read(outcome.response)
        errors[output.id] = output.error(outcome.response)
        gradients[output.id] = output.gradient(outcome.response)
    return Sample(dict(values), outputs, errors, gradients)


# ------------------------------------------------------------------------------------------------------ design


def run_design(bench: Runner, known: Sequence[Mapping[str, float]] = ()) -> Design:
    """Run the design; with similarity first the reduced one and its proof, and without a proof the full one.

    Points `known` from before, that are in the store, are taken as runs of the purpose 'stored'.
    """
    design = _run_design(bench)
    mine = {tuple(r.values[n] for n in bench.plan.box.names) for r in design.runs}
    more = [v for v in known if tuple(v[n] for n in bench.plan.box.names) not in mine]
    runs = tuple(Run("stored", v, o) for v, o in zip(more, bench.run(more) if more else [], strict=True))
    return replace(design, runs=(*design.runs, *runs))


def _run_design(bench: Runner) -> Design:
    plan = bench.plan
    asked = full_design(plan)
    if plan.group.reference is None:
        return Design(asked, False, plan.group.why, (), _runs(bench, *fe_design(plan, False), []))
    points, held = fe_design(plan, True)
    pairs = proofs(plan, points)
    runs = _runs(bench, points, held, [direct for direct, _ in pairs])
    proved = tuple(_proof(plan, pair, runs) for pair in pairs)
    differences = [p.relative_difference for p in proved if p.relative_difference is not None]
    if differences and max(differences) <= SIMILARITY_TOLERANCE:
        return Design(asked, True, plan.group.why, proved, runs)
    if not any(r.done for r in runs):  # nothing says that the full design would do better
        return Design(asked, False, "not applied: no run was done", proved, runs)
    story = "not applied: none of the proof runs was done"
    if differences:
        story = f"not applied: the proof runs differ by {max(differences):.1e}, more than {SIMILARITY_TOLERANCE:g}; "
        story += "the backend is not similar"
    return Design(asked, False, story, proved, (*runs, *_runs(bench, *fe_design(plan, False), [])))


def _runs(bench: Runner, design: list[dict], held: list[dict], direct: list[dict]) -> tuple[Run, ...]:
    purposes = ["design"] * len(design) + ["held_out"] * len(held) + ["proof"] * len(direct)
    points = [*design, *held, *direct]
    return tuple(Run(p, v, o) for p, v, o in zip(purposes, points, bench.run(points), strict=True))


def _proof(plan: Plan, pair: tuple[dict, dict], runs: Sequence[Run]) -> Proof:
    """The output with the largest relative difference among those that are not noise about zero."""
    direct, similar = (next(r for r in runs if r.values == v) for v in pair)
    if not (direct.done and similar.done):
        return Proof(pair[0], None, None, None)
    ratio = pair[0][plan.group.reference] / plan.group.reference_value
    every = (*plan.outputs, *plan.extras)
    a, b = outputs_sample(plan, *_of(direct)), outputs_sample(plan, *_of(similar))
    scaled = {o.id: plan.group.expand(o.channel, b.outputs[o.id], ratio) for o in every}
    largest = _largest(plan, [a])
    difference = {
        o.id: abs(a.outputs[o.id] - scaled[o.id]) / abs(a.outputs[o.id])
        for o in every
        if abs(a.outputs[o.id]) > NEGLIGIBLE_OUTPUT_SHARE * largest[o.unit]
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
    return [o.id for o in (*plan.outputs, *map(limited, plan.constraints)) if not o.on_surface]


def tolerance_misses(
    plan: Plan, emulator: Emulator, scores: Mapping[str, Scores | None], of: Iterable[str] | None = None
) -> dict[str, float]:
    """Errors of outputs that exceed surrogate.tolerance, as shares of the spread of the output by id.

    `of` are the ids that are looked at, the decisive ones unless given.  What the runs themselves do not know, their
    stated numerical error, is no fault of a surrogate.
    """
    found = {}
    by_id = {o.id: o for o in emulator.outputs}
    for i in decisive(plan) if of is None else of:
        one = scores.get(i)
        if one is None or i not in by_id:
            continue
        share = one.rmse / emulator.spread(by_id[i])
        stated = float(np.sqrt(np.mean([s.errors.get(i, 0.0) ** 2 for s in emulator.samples])))
        if share > plan.study.surrogate.tolerance and one.rmse > stated:
            found[i] = share
    return found


def fit_surrogates(bench: Runner, design: Design) -> FittedSurrogates:
    """Fit all outputs; predict new runs, then learn them, until the predictions are good enough.

    The first new runs are the held-out ones.  While the error of a decisive output exceeds surrogate.tolerance,
    points are added where it is least sure, at most verify.max_infill of them.
    """
    plan = bench.plan
    group = plan.group if design.similar else dataclasses.replace(plan.group, reference=None)
    learnt, new = design.samples(plan, "design"), design.samples(plan, "held_out")
    learnt += design.samples(plan, "stored")
    outputs = [*plan.outputs, *_worth_learning(plan, learnt)]
    try:
        emulator = learnt_anew(plan, group, outputs, learnt, new, bench.evaluator.each)
        emulator, scores, added = refine(bench, emulator, new, plan.study.verify.max_infill, "infill")
    except ValueError as error:
        reasons = [why(o)[1] or "" for r in design.runs for o in r.outcomes if not isinstance(o, Done)]
        shown = "; ".join(list(dict.fromkeys(reasons))[:MAX_TOLD_REASONS]) or "none failed"
        done = sum(r.done for r in design.runs)
        raise NothingToFit(f"{error} ({done} of {len(design.runs)} runs done; the others: {shown})") from error
    return FittedSurrogates(emulator, scores, added)


def learnt_anew(
    plan: Plan,
    group: Group,
    outputs: Sequence[Output],
    samples: Sequence[Sample],
    held: Sequence[Sample] = (),
    each: Each = map,
) -> Emulator:
    """Emulator of the outputs as [surrogate] wants it; the data choose what it leaves open."""
    table = plan.study.surrogate
    return learn_emulator(
        plan.box, group, outputs, samples, kind=table.kind, degree=table.degree, seed=plan.seed, held=held, each=each
    )


def learn_more(bench: Runner, emulator: Emulator, new: Sequence[Sample]) -> Emulator:
    """The emulator with new samples in it, of the kinds that it has.

    Where one that a search or a metric rests on is not good enough by cross-validation, kinds are chosen again each
    time that the samples have become `NEW_KIND_SAMPLES_RATIO` times as many: what few runs chose need not suit many.
    """
    plan = bench.plan
    more = relearn(emulator, new, seed=plan.seed, each=bench.evaluator.each_now)
    good = not tolerance_misses(plan, more, {i: more.surrogates[i].cv for i in decisive(plan) if i in more.surrogates})
    before, now = (int(math.log(max(len(e.samples), 1), NEW_KIND_SAMPLES_RATIO)) for e in (emulator, more))
    if good or before == now:
        return more
    return learnt_anew(plan, more.group, more.outputs, more.samples, each=bench.evaluator.each)


def refine(
    bench: Runner, emulator: Emulator, new: list[Sample], room: int, purpose: str
) -> tuple[Emulator, dict[str, Scores], tuple[Run, ...]]:
    """Predict the `new` runs, learn them, add as many where the surrogates are least sure, and so on.

    Ends when the decisive outputs were predicted to surrogate.tolerance, or after `room` runs that were added.
    Returns the emulator, its errors on the last new runs before it learnt these, and the runs added.
    """
    plan, similar = bench.plan, emulator.group.reference is not None
    scores: dict[str, Scores] = {}
    added: list[Run] = []
    while new:
        scores = {o.id: emulator.score(o, new) for o in emulator.outputs}
        emulator = learn_more(bench, emulator, new)
        count = min(len(new), room - len(added))
        if not tolerance_misses(plan, emulator, scores) or count < 1:
            break
        points = worst(bench.around_failures(similar).plan, emulator, count)
        runs = [Run(purpose, v, o) for v, o in zip(points, bench.run(points), strict=True)]
        added += runs
        new = [outputs_sample(plan, r.values, r.outcomes) for r in runs if r.done]
    return emulator, scores, tuple(added)


def worst(plan: Plan, emulator: Emulator, count: int) -> list[dict[str, float]]:
    """Values of `count` new points where the decisive surrogates are least sure and no sample is near.

    Each maximises (sd/|mean| of the worst decisive output) × (distance to the nearest sample) over the (reduced) box.
    """
    if emulator.reduced is None:
        return []
    pool = _pool(plan, emulator.reduced)
    unsure = np.zeros(len(pool))
    for i in decisive(plan):
        mean, sd = emulator.surrogates[i].predict(pool)
        unsure = np.maximum(
            unsure, sd / np.maximum(np.abs(mean), NEGLIGIBLE_OUTPUT_SHARE * np.abs(mean).max() + 1e-300)
        )
    # The noise of a polynomial is the same everywhere: then the distance decides.
    unsure = np.where(_allowed(plan, emulator.group, emulator.reduced, pool), unsure, -1.0)
    weight = np.where(unsure >= 0, np.maximum(unsure, 1e-3 * unsure.max()) + 1e-300, -1.0)
    return _spread(plan, emulator.group, emulator.reduced, emulator.samples, pool, weight, count)


def farthest_values(plan: Plan, group: Group, samples: Sequence[Sample], count: int) -> list[dict[str, float]]:
    """Values of `count` new points of the (reduced) box, as far as possible from the samples and from each other."""
    box = reduced_box(plan.box, group)
    if box is None:
        return []
    pool = _pool(plan, box)
    weight = np.where(_allowed(plan, group, box, pool), 1.0, -1.0)
    return _spread(plan, group, box, samples, pool, weight, count)


def _pool(plan: Plan, box: Box) -> np.ndarray:
    return np.vstack([doe.sobol_sequence(box.d, 1024, plan.seed), *_ends(box.d)])


def _allowed(plan: Plan, group: Group, box: Box, pool: np.ndarray) -> np.ndarray:
    """Mask of the points that respect the conditions."""
    if not plan.conditions:
        return np.ones(len(pool), bool)
    return plan.feasible(pool) if group.reference is None else reduced_feasible(plan, box, pool)


def _spread(
    plan: Plan, group: Group, box: Box, samples: Sequence[Sample], pool: np.ndarray, weight: np.ndarray, count: int
) -> list[dict[str, float]]:
    """Values of the points of the pool that have the largest weight × distance, one after another."""
    known = box.to_unit(np.array([[group.reduce(s.values)[1][n] for n in box.names] for s in samples]))
    fresh = []
    for _ in range(count):
        gap = np.min(np.linalg.norm(pool[:, None] - known[None], axis=2), axis=1)
        x = pool[np.argmax(weight * gap)]
        known = np.vstack([known, x])
        fresh.append(x)
    fixed = {} if group.reference is None else {group.reference: group.reference_value}
    rows = box.from_unit(np.array(fresh))
    return [{**fixed, **dict(zip(box.names, map(float, row), strict=True)), **plan.resolved.fixed} for row in rows]


def _ends(d: int) -> list[np.ndarray]:
    """The corners of the cube, while they are few."""
    return [np.array(list(itertools.product((0.0, 1.0), repeat=d)))] if d <= 6 else []


def _worth_learning(plan: Plan, samples: Sequence[Sample]) -> list[Output]:
    """Extra outputs that are constrained or vary: by symmetry a channel may be noise about zero everywhere."""
    constrained = {limited(c) for c in plan.constraints}
    largest = _largest(plan, samples)
    spread = {o: np.ptp([s.outputs[o.id] for s in samples]) if samples else 0.0 for o in plan.extras}
    return [o for o in plan.extras if o in constrained or spread[o] > NEGLIGIBLE_OUTPUT_SHARE * largest[o.unit]]
