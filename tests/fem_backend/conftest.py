"""Experiments on the reproducible mapped mesh, built once: coarse enough to be fast, not meant to be accurate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from fem_backend.backend import BACKEND, passages
from fem_backend.simulation import assembly, experiment, indentation
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver import load_steps
from fem_backend.solver.load_steps import Control, Instant, LoadPoint
from fem_backend.solver.newton import Counters, Load, System
from rso.contract import Programme

# slip 0.6 needs n >= 9: below that the straight-sided volume is more than 8 % short and the mesh is refused
MESH = {"mesher": "mapped", "n": 8, "slip": 0.5}
SMALL_MESH = {"mesher": "mapped", "n": 6, "slip": 0.3}
VALUES = {"mu": 0.01, "D1": 5.8}


@dataclass(frozen=True)
class Bench:
    """An experiment with the pieces that a test wants to hold in its hand."""

    settings: Settings
    knobs: Knobs
    placement: Placement
    model: AssembledModel

    def system(self) -> System:
        """The system that `indentation.simulate_indentation` builds."""
        return assembly.system(self.settings, self.knobs, self.placement, self.model)

    def load(self, travel: float) -> Load:
        """Indenter at a travel (mm), no multipliers."""
        return assembly.load_at(self.system(), self.placement, travel)

    def travel(self, asked: Sequence[float], control: Control) -> list[LoadPoint]:
        """Equilibria at the asked travels of an elastic body with other numerical settings."""
        system = self.system()

        def start(s: float) -> Load:
            return assembly.load_at(system, self.placement, s)

        return load_steps.follow_travel(system, start, list(asked), control, Counters())

    def solve(self, asked: Sequence[float] | Programme, gradients: Sequence[str] = (), **settings: Any) -> Result:
        """The whole run to asked travels (mm, 1 mm/s) or through a programme, with other fields of the settings."""
        programme = asked if isinstance(asked, Programme) else Programme.ramp(tuple(asked), 1.0)
        return indentation.simulate_indentation(
            replace(self.settings, **settings),
            self.knobs,
            self.placement,
            self.model,
            passages(programme),
            gradients=gradients,
        )

    def other(self, **knobs: float) -> Bench:
        """The same experiment with other knobs, on the same mesh; on the same model where the shape allows it."""
        return bench(dict(self.settings.mesh), {**vars(self.knobs), **knobs}, self.settings)


def bench(mesh: Mapping[str, Any], knobs: Mapping[str, float] = VALUES, settings: Any = None, **table: Any) -> Bench:
    """An experiment on the mesh: `table` is that of a case, unless `settings` were read already."""
    settings = experiment.read_settings({"mesh": dict(mesh), **table}) if settings is None else settings
    values = BACKEND.knobs(knobs, settings)
    placement = assembly.placement_of(settings, values)
    return Bench(settings, values, placement, assembly.model_for(settings, values, placement, None))


def instants(*asked: float) -> list[Instant]:
    """Asked travels at 1 mm/s."""
    return [Instant(s, s, True) for s in asked]


@pytest.fixture(scope="session", autouse=True)
def own_mesh_cache(tmp_path_factory):
    """Meshes made here do not go to the user's cache, and none is taken from it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def graded() -> Bench:
    return bench(MESH)


@pytest.fixture(scope="session")
def small() -> Bench:
    return bench(SMALL_MESH)


@pytest.fixture(scope="session")
def make_bench():
    """(knobs, **settings) → an experiment on the small mesh."""
    return lambda knobs=VALUES, mesh=SMALL_MESH, **table: bench(mesh, {**VALUES, **knobs}, **table)


@pytest.fixture(scope="session")
def to_two(graded):
    """The ordinary run to 1 and 2 mm."""
    return graded.solve([1.0, 2.0])


def taylor_slopes(error: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Slopes of log error over log step between neighbouring steps."""
    return np.diff(np.log(error)) / np.diff(np.log(steps))


@pytest.fixture(scope="session")
def slopes():
    return taylor_slopes
