"""Runs in a store that are of a study's model: asked with its backend and its cases, they have these very run keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from rso.calibration.plan import Plan
from rso.contract import Response, run_key
from rso.evaluation import Task
from rso.evaluation.store import Done, RunStore

Values = Mapping[str, float]


@dataclass(frozen=True)
class StoredPoint:
    """Values at which every case of a study is stored, done or failed, and the keys of these runs, one per case."""

    values: Values
    keys: tuple[str, ...]


def stored_points(plan: Plan, store: RunStore) -> list[StoredPoint]:
    """Points of the model that were run before, whatever their values, in the order of these.

    The order in which runs were stored depends on the machine and the number of jobs, and what is learnt on the order.
    """
    rows = [r for r in store.rows() if r.state != "crashed"]
    there, artefacts = {r.key for r in rows}, _Artefacts(store)
    default = {p.name: p.default if p.neutral is None else p.neutral for p in plan.backend.parameters}
    found: dict[tuple[float, ...], StoredPoint] = {}
    for row in rows:
        values = {n: row.values.get(n, default[n]) for n in plan.box.names}
        known = {n: float(v) for n, v in values.items() if v is not None}
        if len(known) < len(values):
            continue
        asked = {**known, **plan.resolved.fixed}
        place = tuple(asked[n] for n in plan.box.names)
        if place not in found:
            keys = [_key(plan, t, artefacts) for t in plan.tasks(asked)]
            if all(k in there for k in keys):
                found[place] = StoredPoint(asked, tuple(k for k in keys if k is not None))
    return [found[place] for place in sorted(found)]


def stored_responses(store: RunStore, point: StoredPoint) -> tuple[Response, ...] | None:
    """Responses of a point, one per case; None where one of its runs has no answer."""
    runs = [store.get(key) for key in point.keys]
    done = [run.response for run in runs if isinstance(run, Done)]
    return tuple(done) if len(done) == len(runs) else None


@dataclass(frozen=True, eq=False)
class _Artefacts:
    """Hashes of artefacts by recipe, each looked up once: the store reads a file for it."""

    store: RunStore
    known: dict[str, str | None] = dataclasses.field(default_factory=dict)

    def sha(self, recipe: str) -> str | None:
        if recipe not in self.known:
            self.known[recipe] = self.store.artefact(recipe)
        return self.known[recipe]


def _key(plan: Plan, task: Task, artefacts: _Artefacts) -> str | None:
    """Key of a task; None where the backend does not take it, or an artefact of it is not there."""
    try:
        values, case = plan.backend.canonical(task.values, task.case)
        shas = {n: artefacts.sha(recipe) for n, recipe in plan.backend.recipes(values, case).items()}
    except ValueError:
        return None
    if None in shas.values():
        return None
    return run_key(plan.backend, values, dataclasses.replace(case, artefacts=shas))  # type: ignore[arg-type]
