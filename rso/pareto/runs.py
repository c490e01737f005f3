"""Simulations of a study with objectives, and the quantities that are read of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from rso.core.quantities import Unread
from rso.evaluation import Event, Outcome, run_all
from rso.evaluation.store import Crashed, Done, Failed, RunStore
from rso.optimise.targets import ROUNDING
from rso.pareto.plan import ParetoPlan


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
class Runs:
    """Makes runs through the store and remembers all of this study, in order."""

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


def lost(plan: ParetoPlan, runs: Sequence[ParetoRun]) -> np.ndarray:
    """Points (k, d) of runs that failed: crashed ones are no property of the point."""
    return np.array([r.u for r in runs if r.state == "failed"]).reshape(-1, plan.space.d)


def misses(plan: ParetoPlan, y: dict[str, float]) -> dict[str, float]:
    """Limits that a run does not keep, by how much in their unit; what rounding leaves is none."""
    found = {}
    for c in plan.limits:
        miss = c.miss(y[c.quantity.text])
        limit = c.high if y[c.quantity.text] > c.high else c.low
        if miss > ROUNDING * abs(limit):
            found[c.text] = miss
    return found


def values_of(plan: ParetoPlan, y: dict[str, float]) -> np.ndarray:
    """Objectives (m,) of a run, to be minimised."""
    return np.array([o.sign * y[o.quantity.text] for o in plan.objectives])
