"""About how long simulations take: by what the backend says of each, set right by those that are in the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rso.contract import Backend, Case, CostModel, capability, digest, plain
from rso.evaluation import Task
from rso.evaluation.store import Done, Failed, RunStore, StoreError

UNKNOWN_SIMULATION_S = 10.0  # s of a simulation of which nothing is known


@dataclass(frozen=True, eq=False)
class Pace:
    """Seconds of one run over what its backend says of it, `known` from how many runs; `walls` s of each of those."""

    backend: Backend
    ratio: float
    known: int = 0
    walls: Mapping[str, float] = field(default_factory=dict)

    @property
    def basis(self) -> str:
        """Where the seconds are from, in words."""
        if self.known:
            return "as measured in this study"
        kind = ", by the kind of model" if capability(self.backend, CostModel) else ""
        return f"a guess, nothing was run yet{kind}"

    def seconds(self, tasks: Iterable[Task]) -> float:
        """Wall time of tasks, one after the other."""
        return self.ratio * sum(_cost(self.backend, *_canonical(self.backend, t)) for t in tasks)

    def stored(self, task: Task) -> bool:
        """Whether a task has been run, its mesh apart."""
        return _sign(*_canonical(self.backend, task)) in self.walls


def pace(backend: Backend, folder: Path) -> Pace:
    """The pace of a backend by the runs that are stored in a folder, if any."""
    walls: dict[str, float] = {}
    wall = cost = 0.0
    for run in _runs(folder):
        walls[_sign(run.values, run.case)] = run.wall_s
        if run.wall_s:
            wall += run.wall_s
            cost += _cost(backend, run.values, run.case)
    if not cost:
        return Pace(backend, 1.0, 0, walls)
    return Pace(backend, wall / cost, sum(map(bool, walls.values())), walls)


def _runs(folder: Path) -> list[Done | Failed]:
    try:
        with RunStore(folder, read_only=True) as store:
            found = [store.get(r.key) for r in store.rows() if r.state != "crashed"]
    except StoreError:
        return []
    return [run for run in found if run is not None]


def _cost(backend: Backend, values: Mapping[str, float], case: Case) -> float:
    """What the backend says that a run takes (s), or a guess where it does not or where the run is none of its own."""
    costs = capability(backend, CostModel)
    try:
        return float(costs.cost(values, case)) if costs is not None else UNKNOWN_SIMULATION_S
    except (ValueError, TypeError, KeyError):
        return UNKNOWN_SIMULATION_S


def _canonical(backend: Backend, task: Task) -> tuple[Mapping[str, float], Case]:
    return backend.canonical(task.values, task.case)


def _sign(values: Mapping[str, float], case: Case) -> str:
    """Equal for equal runs, whatever their meshes are called."""
    return digest([plain(dict(values)), replace(case, name="", artefacts={}, objects=None).to_json()])
