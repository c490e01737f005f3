"""Simulations of a study with objectives, and the quantities that are read of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from rso.core.quantities import Unread
from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation import feasibility
from rso.emulation.feasibility import FeasibleRegion
from rso.evaluation import Event, Outcome, run_all
from rso.evaluation.store import Crashed, Done, Failed, RunStore
from rso.objectives.plan import ParetoPlan
from rso.optimise.targets import LIMIT_ROUNDING_SHARE

NO_SIMILARITY = Group(None, 1.0, {}, {}, "no similarity is applied")


@dataclass(frozen=True, eq=False)
class ParetoRun:
    """One simulation: its point u (d,), what became of it, and its quantities `y` by text where it has an answer."""

    purpose: str
    u: np.ndarray
    outcome: Outcome
    y: dict[str, float] | None
    reason: str | None

    @property
    def state(self) -> str:
        """done, failed or crashed; an answer in which a quantity cannot be read counts as failed."""
        if isinstance(self.outcome, Done):
            return "done" if self.y is not None else "failed"
        return "failed" if isinstance(self.outcome, Failed) else "crashed"


@dataclass(eq=False)
class StudyRuns:
    """Makes runs through the store and records all of this study, in order."""

    plan: ParetoPlan
    store: RunStore
    executor: Executor
    watch: Callable[[Event], None] | None = None
    made: list[ParetoRun] = field(default_factory=list)

    def make(self, U: np.ndarray, purpose: str) -> list[ParetoRun]:
        """The runs of points (n, d), in their order."""
        tasks = [self.plan.task(u) for u in U]
        outcomes = run_all(self.plan.backend, tasks, self.store, self.executor, watch=self.watch) if len(U) else []
        found = [self._read(purpose, u, outcome) for u, outcome in zip(U, outcomes, strict=True)]
        self.made += found
        return found

    def _read(self, purpose: str, u: np.ndarray, outcome: Outcome) -> ParetoRun:
        if isinstance(outcome, Failed):
            return ParetoRun(purpose, u, outcome, None, f"{outcome.cause}: {outcome.reason}")
        if isinstance(outcome, Crashed):
            return ParetoRun(purpose, u, outcome, None, outcome.reason.splitlines()[0])
        try:
            y = {q.text: q.read(outcome.response) for q in self.plan.quantities}
        except (Unread, ValueError) as error:
            return ParetoRun(purpose, u, outcome, None, str(error))
        return ParetoRun(purpose, u, outcome, y, None)


def data(plan: ParetoPlan, runs: Sequence[ParetoRun]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (n, d) and quantities (n,) by text of the runs that have an answer, each point once."""
    seen: dict[tuple[float, ...], ParetoRun] = {}
    for run in runs:
        if run.y is not None:
            seen.setdefault(tuple(run.u.round(9)), run)
    kept = list(seen.values())
    U = np.array([r.u for r in kept]).reshape(-1, plan.space.d)
    return U, {q.text: np.array([r.y[q.text] for r in kept if r.y is not None]) for q in plan.quantities}


def answered(plan: ParetoPlan, runs: Sequence[ParetoRun]) -> FeasibleRegion | None:
    """Where runs have an answer, learnt from those that failed; None while none has.

    Crashed runs are left out: they are no property of the point.  It is over the columns that surrogates see.
    """
    known = [r for r in runs if r.state != "crashed"]
    if all(r.state == "done" for r in known):
        return None
    space = plan.space
    names = space.feature_names()
    box = Box(names, ("1",) * len(names), (0.0,) * len(names), (1.0,) * len(names), (False,) * len(names))
    X = space.features(np.array([r.u for r in known]))
    values = [dict(zip(names, map(float, x), strict=True)) for x in X]
    return feasibility.learn_feasibility(box, NO_SIMILARITY, values, [r.state == "done" for r in known], plan.seed)


def limit_misses(plan: ParetoPlan, y: dict[str, float]) -> dict[str, float]:
    """Limits that a run does not keep, by how much in their unit; what rounding leaves is none."""
    found = {}
    for c in plan.limits:
        miss = c.miss(y[c.quantity.text])
        limit = c.high if y[c.quantity.text] > c.high else c.low
        if miss > LIMIT_ROUNDING_SHARE * abs(limit):
            found[c.text] = miss
    return found


def objectives_of(plan: ParetoPlan, y: dict[str, float]) -> np.ndarray:
    """Objectives (m,) of a run, to be minimised."""
    return np.array([o.sign * y[o.quantity.text] for o in plan.objectives])
