"""From the design to the front: surfaces, search, simulations of its candidates until both agree."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rso.emulation import Scores
from rso.emulation.feasibility import FeasibleRegion
from rso.objectives.front import SAME_RUN_DISTANCE, PredictedFront, knee, representative_rows, search
from rso.objectives.plan import ParetoPlan, designed, held_out_points
from rso.objectives.runs import ParetoRun, StudyRuns, answered, data, limit_misses, objectives_of
from rso.objectives.sensitivity import Sensitivities, sensitivities
from rso.objectives.surfaces import Surfaces, learn_surfaces, nondominated, scores
from rso.optimise.mixed import mixed_front
from rso.study.errors import Problem, study_error

SIZE_FLOOR_SHARE = 0.01  # of the spread of a quantity: below this size differences are measured against it
MIN_LIMIT_DISTANCE_SHARE = 2e-4  # of a quantity: a distance to its limit that is not worth another run
OPTIMISM_SD = 2.0  # standard deviations by which everything may be better than predicted, where surfaces are explored
# share of the hypervolume that the last fifth of the generations may add and count as converged
MAX_CONVERGED_RISE_SHARE = 0.005
Say = Callable[[str], None]


class NoSurface(ValueError):
    """Too few runs have an answer for a surface, or none has."""


@dataclass(frozen=True, eq=False)
class ParetoCandidate:
    """A point of the front and its simulation: predicted quantities, whether both agree, which limits are not kept."""

    u: np.ndarray
    predicted: dict[str, float] | None
    run: ParetoRun
    difference: float | None
    worst: str | None
    verified: bool
    misses: dict[str, float]


@dataclass(eq=False)
class ParetoOutcome:
    """All that a study with objectives has found."""

    plan: ParetoPlan
    design: np.ndarray
    held: np.ndarray
    runs: list[ParetoRun]
    surfaces: Surfaces
    held_scores: dict[str, Scores]
    front: PredictedFront
    candidates: list[ParetoCandidate]
    rounds: list[dict[str, Any]]
    sensitivities: Sensitivities
    timings: dict[str, float]
    warnings: list[str] = field(default_factory=list)


def solve_study(plan: ParetoPlan, runs: StudyRuns, say: Say) -> ParetoOutcome:
    """The whole way from the design to verified candidates."""
    clock = time.perf_counter()
    timings: dict[str, float] = {}

    def took(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        timings[stage] = timings.get(stage, 0.0) + now - clock
        clock = now

    design = designed(plan)
    held = held_out_points(plan, design)
    say("design")
    made = runs.make(design, "design")
    kept = runs.make(held, "held out")
    took("design")
    say("surfaces")
    surfaces, held_scores = _surfaces(plan, made, kept)
    took("surfaces")
    direct = plan.study.search.method == "simulations"
    say("search on simulations" if direct else "search on surfaces")
    if direct:
        front, candidates, rounds = _directly(plan, runs)
    else:
        surfaces, front, candidates, rounds = _on_surfaces(plan, runs, surfaces, say)
    took("search")
    say("sensitivity")
    sensitive = sensitivities(plan, surfaces, _centre(plan, candidates))
    took("sensitivity")
    found = ParetoOutcome(
        plan, design, held, runs.made, surfaces, held_scores, front, candidates, rounds, sensitive, timings
    )  # fmt: skip
    found.warnings += _warnings(found)
    return found


def _surfaces(plan: ParetoPlan, made: list[ParetoRun], kept: list[ParetoRun]) -> tuple[Surfaces, dict[str, Scores]]:
    """Surfaces of the design scored on the runs held out, then of all."""
    before = _learnt(plan, made)
    H, seen = data(plan, kept)
    found = scores(before, H, seen)
    return (_learnt(plan, [*made, *kept]) if len(H) else before), found


def _learnt(plan: ParetoPlan, runs: list[ParetoRun]) -> Surfaces:
    U, columns = data(plan, runs)
    reasons = [r.reason for r in runs if r.reason]
    if not len(U):
        raise NoSurface(f"no run has an answer; the first: {reasons[0] if reasons else 'there are none'}")
    table = plan.study.surrogate
    try:
        return learn_surfaces(plan.space, U, columns, plan.units, kind=table.kind, degree=table.degree, seed=plan.seed)
    except ValueError as error:
        if "surrogate.degree" in str(error):
            raise study_error(
                plan.study.file, plan.study.lines, [Problem(("surrogate", "degree"), str(error))]
            ) from error  # fmt: skip
        said = f"; {len(reasons)} runs have no answer, the first: {reasons[0]}" if reasons else ""
        raise NoSurface(f"{error}{said}") from error


Found = tuple[Surfaces, PredictedFront, list[ParetoCandidate], list[dict[str, Any]]]


def _on_surfaces(plan: ParetoPlan, runs: StudyRuns, surfaces: Surfaces, say: Say) -> Found:
    """Search, simulate candidates, learn them, search again: until all agree or verify.max_infill runs are used."""
    tolerance, left = plan.study.verify.tolerance, plan.study.verify.max_infill
    rounds: list[dict[str, Any]] = []
    margins: dict[str, float] = {}
    while True:
        start = _start(plan, runs.made)
        region = answered(plan, runs.made)
        front = search(plan, surfaces, seed=plan.seed + len(rounds), start=start, margins=margins, region=region)
        count = plan.study.search.candidates
        picked = np.vstack([front.U[representative_rows(front.F, count)], front.others[: count - 1]])
        made = runs.make(picked, "candidate")
        candidates = [_judged(plan, surfaces, u, run) for u, run in zip(picked, made, strict=True)]
        rounds.append(_round(plan, candidates))
        say(f"  round {len(rounds)}: {rounds[-1]['words']}")
        now = _margins(plan, surfaces, candidates, tolerance)
        # Candidates that stand farther from a limit than predictions are off by now can come nearer.
        worth = {t: max(5.0 * m, MIN_LIMIT_DISTANCE_SHARE * _size_of(surfaces, candidates, t)) for t, m in now.items()}
        loose = any(margins.get(t, 0.0) > least for t, least in worth.items())
        good = all(c.verified and not c.misses for c in candidates) and not (loose and left > 0)
        new = _new(runs, candidates, left)
        if left > 0 and good and len(plan.objectives) == 1:
            new = _explored(plan, runs, surfaces, region)
            say(
                "  a better design may be elsewhere: it is simulated" if new else "  no better design is to be expected"
            )
        elif good:
            new = []
        if not new or left <= 0:
            return surfaces, front, candidates, rounds
        left -= len(new)
        margins = now
        surfaces = _learnt(plan, runs.made)


def _explored(plan: ParetoPlan, runs: StudyRuns, surfaces: Surfaces, region: FeasibleRegion | None) -> list[ParetoRun]:
    """The run of one objective that may be better than all so far, as far as the surfaces do not know; empty if none.

    It is better where the objective and all limits are two standard deviations better than predicted.
    """
    best = [objectives_of(plan, r.y)[0] for r in runs.made if r.y is not None and not limit_misses(plan, r.y)]
    start = _start(plan, runs.made)
    front = search(plan, surfaces, seed=plan.seed, start=start, margins={}, region=region, optimism=OPTIMISM_SD)
    known = np.array([r.u for r in runs.made])
    gain = plan.study.verify.tolerance * max(abs(min(best)), 1e-300) if best else 0.0
    new = np.abs(known - front.U[0]).max(axis=1).min() > SAME_RUN_DISTANCE
    if not front.feasible or not new or (best and front.F[0, 0] > min(best) - gain):
        return []
    return runs.make(front.U[:1], "exploration")


def _new(runs: StudyRuns, candidates: list[ParetoCandidate], left: int) -> list[ParetoRun]:
    """Candidates' runs that tell the surfaces something: not at a place that is known already."""
    mine = {id(c.run) for c in candidates}
    known = np.array([r.u for r in runs.made if id(r) not in mine])
    apart = [c.run for c in candidates if np.abs(known - c.u).max(axis=1).min() > 1e-7]
    return apart[: max(left, 0)]


def _judged(plan: ParetoPlan, surfaces: Surfaces, u: np.ndarray, run: ParetoRun) -> ParetoCandidate:
    """A candidate against its simulation: differences over |simulated|, or 1 % of the spread where that is more."""
    predicted = {text: float(y[0]) for text, y in surfaces.means(u[None]).items()}
    if run.y is None:
        return ParetoCandidate(u, predicted, run, None, None, False, {})
    sizes = {t: max(abs(v), SIZE_FLOOR_SHARE * surfaces.each[t].spread) for t, v in run.y.items()}
    gaps = {t: abs(predicted[t] - v) / sizes[t] for t, v in run.y.items()}
    worst = max(gaps, key=lambda t: gaps[t])
    verified = gaps[worst] <= plan.study.verify.tolerance
    return ParetoCandidate(u, predicted, run, gaps[worst], worst, verified, limit_misses(plan, run.y))


def _margins(
    plan: ParetoPlan, surfaces: Surfaces, candidates: list[ParetoCandidate], tolerance: float
) -> dict[str, float]:
    """How far the next search stays from a limit: what predictions were off by, at most the tolerance."""
    found = {}
    for c in plan.limits:
        text = c.quantity.text
        pairs = [(k.predicted[text], k.run.y[text]) for k in candidates if k.predicted and k.run.y]
        if pairs:
            most = tolerance * _size_of(surfaces, candidates, text)
            found[text] = min(max(abs(a - b) for a, b in pairs), most)
    return found


def _size_of(surfaces: Surfaces, candidates: list[ParetoCandidate], text: str) -> float:
    """What differences of a quantity are measured by: its value at the first candidate with an answer."""
    value = next((abs(c.run.y[text]) for c in candidates if c.run.y), 0.0)
    return max(value, SIZE_FLOOR_SHARE * surfaces.each[text].spread)


def _round(plan: ParetoPlan, candidates: list[ParetoCandidate]) -> dict[str, Any]:
    known = [c for c in candidates if c.difference is not None]
    worst = max(known, key=lambda c: c.difference or 0.0) if known else None
    verified, kept = sum(c.verified for c in candidates), sum(not c.misses and c.run.y is not None for c in candidates)
    words = f"{verified} of {len(candidates)} candidates agree with their simulation"
    words += f", {kept} keep all limits" if plan.limits else ""
    if worst is not None:
        words += f"; the largest difference is {100 * (worst.difference or 0):.2g} % ({worst.worst})"
    return {
        "candidates": len(candidates),
        "verified": verified,
        "within_limits": kept,
        "largest_difference": None if worst is None else worst.difference,
        "words": words,
    }


def _start(plan: ParetoPlan, made: list[ParetoRun]) -> np.ndarray:
    """The best runs so far, which the population begins with."""
    good = [r for r in made if r.y is not None and not limit_misses(plan, r.y)]
    if not good:
        return np.empty((0, plan.space.d))
    F = np.array([objectives_of(plan, r.y) for r in good if r.y is not None])
    keep = nondominated(F)
    return np.array([r.u for r, k in zip(good, keep, strict=True) if k])[: plan.study.search.population // 2]


def _directly(plan: ParetoPlan, runs: StudyRuns) -> tuple[PredictedFront, list[ParetoCandidate], list[dict[str, Any]]]:
    """NSGA-II of which every individual is a simulation."""
    known: dict[tuple[float, ...], ParetoRun] = {tuple(r.u.round(12)): r for r in runs.made}

    def made(U: np.ndarray) -> list[ParetoRun]:
        keys = [tuple(u.round(12)) for u in U]
        new = [k for k, key in enumerate(keys) if key not in known]
        for k, run in zip(new, runs.make(U[new], "search"), strict=True):
            known[keys[k]] = run
        return [known[key] for key in keys]

    def objectives(U: np.ndarray) -> np.ndarray:
        return np.array([[np.nan] * len(plan.objectives) if r.y is None else objectives_of(plan, r.y) for r in made(U)])

    def violations(U: np.ndarray) -> np.ndarray:
        rows = []
        for r in made(U):
            own = [np.nan] * len(plan.limits)
            if r.y is not None:
                own = [c.miss(r.y[c.quantity.text]) / _size(c.low, c.high) for c in plan.limits]
            rows.append(own)
        return np.column_stack([np.array(rows).reshape(len(U), -1), np.maximum(plan.excess(U), 0.0)])

    table = plan.study.search
    constrained = bool(plan.limits or plan.conditions)
    found = mixed_front(
        objectives,
        plan.space,
        seed=plan.seed,
        constraints=violations if constrained else None,
        population=table.population,
        generations=table.generations,
        start=_start(plan, runs.made),
    )
    front = PredictedFront(found.X, found.F, found.feasible, found.hypervolume, found.evaluations, found.X[:0])
    picked = [found.X[k] for k in representative_rows(found.F, table.candidates)]
    candidates = []
    for u, run in zip(picked, made(np.array(picked)), strict=True):
        out = {} if run.y is None else limit_misses(plan, run.y)
        candidates.append(ParetoCandidate(u, None, run, 0.0, None, run.y is not None, out))
    return front, candidates, [_round(plan, candidates)]


def _size(low: float, high: float) -> float:
    """What violations of a limit are measured by."""
    return max([abs(v) for v in (low, high) if np.isfinite(v)] + [0.0]) or 1.0


def _centre(plan: ParetoPlan, candidates: list[ParetoCandidate]) -> np.ndarray:
    """The point about which one parameter at a time is shown: the candidate with an answer nearest to the ideal."""
    good = [(c.u, objectives_of(plan, c.run.y)) for c in candidates if c.run.y is not None]
    if not good:
        return plan.space.snapped(np.full((1, plan.space.d), 0.5))[0]
    return good[knee(np.array([f for _, f in good]))][0]


def _warnings(found: ParetoOutcome) -> list[str]:
    plan, said = found.plan, []
    limit = plan.study.surrogate.tolerance
    poor = {
        t: s.rmse / found.surfaces.each[t].spread
        for t, s in found.held_scores.items()
        if s.rmse > limit * found.surfaces.each[t].spread
    }
    if poor:
        worst = max(poor, key=lambda t: poor[t])
        said.append(
            f"{len(poor)} of {len(found.held_scores)} surfaces missed surrogate.tolerance = {100 * limit:g} % of the "
            f"spread of their quantity on {found.held_scores[worst].n} held-out runs; worst was {worst} with "
            f"{100 * poor[worst]:.2g} %"
        )
    region = answered(plan, found.runs)
    if region is not None and plan.study.search.method != "simulations":
        said.append(region.story())
    if not found.front.feasible:
        said.append("no point was found that keeps all limits; the points shown violate them least")
    h = found.front.hypervolume
    if len(h) >= 10 and h[-1] > 0 and (rise := 1.0 - h[-1 - len(h) // 5] / h[-1]) > MAX_CONVERGED_RISE_SHARE:
        said.append(
            f"the hypervolume still rose by {100 * rise:.2g} % over the last {len(h) // 5} generations: more of them "
            "(search.generations) may find a better front"
        )
    return said
