"""Finalists recomputed at their found sizes: how far the library's interpolation was off, and the library mended.

At the found parameters κ̂ and size and shapes φ̂ of an effect the change of the force is what new simulations say, on
the study's own, finer mesh where that is not too costly; around them the difference to the library fades out with a
Gaussian weight,

    δ(φ) ← δ(φ) + w(φ) [δ_FE(κ̂, φ̂) − δ(φ̂)],      w(φ̂) = 1,

so that the total force at (κ̂, φ̂) is the simulated one, errors of the base tables included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.contract.responses import FORCE_CHANNELS
from rso.core.curves import Resampling
from rso.discrepancy.diagnosis import Diagnosis
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import SAME_POINT_OVERLAP, late, timed
from rso.discrepancy.library.planning import framed
from rso.discrepancy.library.relaxation import foreseen, is_relaxation
from rso.discrepancy.library.responses import changed, marks_of, rested
from rso.discrepancy.library.simulations import Base, jobs_at, passes
from rso.discrepancy.library.tables import EXPENSIVE_UNKNOWNS_RATIO, Library
from rso.discrepancy.library.test_plan import TestPlan
from rso.evaluation import Task
from rso.evaluation.store import Done

MIN_RERUN_PROBABILITY = 0.05  # probability of a cause below which it is not computed anew
MAX_RERUN_EFFECTS = 3  # effects per round
LIBRARY_TOLERANCE = 0.003  # of Fz: a deviation below which the library is good enough
MIN_CHECKED_DEPTH_SHARE = 0.15  # of the deepest travel: before that a relative deviation says nothing


@dataclass(frozen=True)
class RerunCheck:
    """Runs, failed ones, largest and root mean square deviation of the library from them over Fz."""

    runs: int
    failed: int
    largest: float | None
    rms: float | None
    effects: tuple[str, ...]


def finalists(library: Library, found: Diagnosis) -> dict[Effect, np.ndarray]:
    """Effects of the model that the verdict names, with the median of the coordinates (κ, size, shapes) of each."""
    picks: dict[Effect, np.ndarray] = {}
    d = len(library.base.axes)
    worth = {c.effect.name for c in found.causes if c.probability >= MIN_RERUN_PROBABILITY}
    known = {e.name: e for e in library.effects}
    hypotheses = {found.chosen.name: found.chosen.effects, **{n: (known[n],) for n in found.named if n in known}}
    for name, effects in hypotheses.items():
        if name not in found.posteriors:
            continue
        at, column = np.median(found.posteriors[name].at, axis=0), d
        for e in effects:
            own = at[column : column + len(e.knobs)]
            column += len(e.knobs)
            if e.family == "model" and e.name in worth and e not in picks:
                picks[e] = np.concatenate([at[:d], own])
    return dict(list(picks.items())[:MAX_RERUN_EFFECTS])


def corrected_library(
    library: Library, picks: Mapping[Effect, np.ndarray], run: Callable[[Sequence[Task]], list[Any]]
) -> tuple[Library, RerunCheck]:
    """The library with every effect of `picks` as computed at its coordinates (d + 1 + shapes,).

    Every place, way of the indenter and, where an effect has a time, every speed is computed.  A failed run mends
    nothing; it is counted.
    """
    d = len(library.base.axes)
    wanted = []
    for e, at in picks.items():
        for k, here in enumerate(library.places):
            if not e.acts(library.plan.places[k].settings):
                continue
            for v in _speeds(library.plan, library.slowest, e, k):
                finer, point = not _dear(library, k), at[d:] + late(e, v)
                tasks = jobs_at(library.base, library.plan, k, e, at[:d], point, here.passes, finer)
                wanted.append((e, at, k, v, point, tasks))
    every = [t for *_, tasks in wanted for t in tasks]
    outcomes = iter(run(every) if every else [])
    off, failed = [], 0
    for e, at, k, v, point, tasks in wanted:
        mine = [next(outcomes) for _ in tasks]
        here, place = library.places[k], library.plan.places[k]
        forces = library.forces(k, at[None, :d])[0].T
        base = Resampling(here.u[1:], forces[1:])
        ahead = foreseen(here.u, forces, point[None], here.passes)[0] if is_relaxation(e) else None
        change, lost = changed(here.passes, here.u, place, library.base.reference, mine, base, ahead)
        failed += sum(not isinstance(o, Done) for o in mine)
        resting, without = rested(here.rests if e.flows else (), library.base.reference, mine[len(here.passes) :], base)
        if lost or without:
            continue
        change = change - here.ways - (0.0 if _dear(library, k) else here.mesh)
        was, marks = library.change(k, e, at[None, d:], v)
        off.append((change - was[0])[:, :, here.u > MIN_CHECKED_DEPTH_SHARE * here.u[-1]])
        more = np.zeros(0)
        if isinstance(mine[0], Done):
            more = marks_of(mine[0].response, place) - library.marks(k, at[None, :d])[0] - marks[0]
        if e.flows:
            resting = resting - _of_mesh(library, k) - library.rested(k, e, at[None, d:], v)[0]
        library = _with(library, e, k, point, change - was[0], more, resting)
    names = tuple(e.name for e in picks)
    if not off:
        return library, RerunCheck(len(every), failed, None, None, names)
    largest = max(float(np.abs(v).max()) for v in off)
    z = np.concatenate([v[:, FORCE_CHANNELS.index("Fz")].ravel() for v in off])
    return library, RerunCheck(len(every), failed, largest, float(np.sqrt(np.mean(z**2))), names)


def planned_rerun(base: Base, plan: TestPlan, effects: Sequence[Effect]) -> tuple[list[Task], float]:
    """Simulations that recompute every effect in the middle of its sizes, and how many of them are one effect's."""
    modelled, slowest = [e for e in effects if e.family == "model"], framed(base, plan).speeds[0]
    tasks: list[Task] = []
    for e in modelled:
        at = [0.5 * sum(s.ends()[-1]) for s in e.knobs]
        for k, place in enumerate(plan.places):
            for _ in _speeds(plan, slowest, e, k) if e.acts(place.settings) else ():
                tasks += jobs_at(base, plan, k, e, base.centre, at, passes(plan, k), True)
    return tasks, len(tasks) / max(len(modelled), 1)


def _dear(library: Library, place: int) -> bool:
    return library.places[place].unknowns > EXPENSIVE_UNKNOWNS_RATIO * library.places[library.primary].unknowns


def _speeds(plan: TestPlan, slowest: float, effect: Effect, place: int) -> list[float]:
    """Speeds at a place that matter to an effect, to two digits; the slowest of all where nothing was pressed."""
    speeds = sorted({float(f"{t.speed:.2g}") for t in plan.tests if t.place == place}) or [slowest]
    return speeds if any(timed(s) for s in effect.shape) else speeds[:1]


def _of_mesh(library: Library, k: int) -> np.ndarray:
    """What the study's mesh changes at the travels of rests (n_rest, 3, 1); 0 where a rerun is on the library's."""
    here = library.places[k]
    peaks = np.array([r.peak for r in here.rests])
    mesh = np.zeros_like(here.mesh) if _dear(library, k) else here.mesh
    return np.stack([np.interp(np.sqrt(peaks), np.sqrt(here.u), c) for c in mesh], axis=1)[:, :, None]


def _with(
    library: Library,
    e: Effect,
    k: int,
    point: np.ndarray,
    change: np.ndarray,
    marks: np.ndarray,
    rests: np.ndarray,
) -> Library:
    """The library with one more row in the table of an effect at a place: what the tables lack at `point`."""
    here = library.places[k]
    table, before = here.effects[e.name], library.mended.get((e.name, k))
    marks = marks if len(marks) else np.zeros(table.marks.shape[1])
    points, old, old_marks, old_rests = point[None], table.change, table.marks, table.rests
    if before is not None:  # rows count from the nodes: at its own point no other row has a weight
        nodes = library.places[library.home(e)].effects[e.name].nodes
        near, n = nodes.nearness(point[None], before)[0], len(old) - len(before)
        change, marks = change + np.tensordot(near, old[n:], axes=1), marks + near @ old_marks[n:]
        rests = rests if old_rests is None else rests + np.tensordot(near, old_rests[n:], axes=1)
        apart = nodes.overlap(point[None], before)[0] < SAME_POINT_OVERLAP
        points = np.concatenate([before[apart], points])
        old, old_marks = (np.concatenate([v[:n], v[n:][apart]]) for v in (old, old_marks))
        old_rests = None if old_rests is None else np.concatenate([old_rests[:n], old_rests[n:][apart]])
    more = replace(
        table,
        change=np.concatenate([old, change[None]]),
        marks=np.concatenate([old_marks, marks[None]]),
        rests=None if old_rests is None else np.concatenate([old_rests, rests[None]]),
    )
    places = list(library.places)
    places[k] = replace(here, effects={**here.effects, e.name: more})
    return replace(library, places=tuple(places), mended={**library.mended, (e.name, k): points})
