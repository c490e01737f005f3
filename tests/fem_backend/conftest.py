"""Models on the reproducible mapped mesh, built once: coarse enough to be fast, not meant to be accurate."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from fem_backend import indentation, meshing, stepping
from fem_backend.indentation import Model, Settings
from fem_backend.laws import Law, NeoHooke
from fem_backend.newton import Counters, Load, System
from fem_backend.stepping import Control, Point

# slip 0.6 needs n >= 9: below that the straight-sided volume is more than 8 % short and the mesh is refused
MESH = {"mesher": "mapped", "n": 8, "slip": 0.5}
SMALL_MESH = {"mesher": "mapped", "n": 6, "slip": 0.3}
LAW = NeoHooke(mu=0.01, D1=5.8)
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Bench:
    """A model with the pieces a test wants to hold in its hand."""

    settings: Settings
    model: Model

    def system(self, law: Law = LAW) -> System:
        """The system that `indentation.solve` builds."""
        body, surface = self.model.body, self.model.surface
        epsilon = indentation.penalty(surface, body, self.settings, law)
        return System(body, law, surface, self.settings.indenter, epsilon, self.model.factor)

    def load(self, travel: float) -> Load:
        """Indenter at a travel (mm), no multipliers."""
        centre = self.settings.body.top + (travel - self.settings.indenter.R) * DOWN
        return Load(centre, np.zeros(self.model.surface.weights.shape), DOWN)

    def travel(self, asked: list[float], control: Control, law: Law = LAW) -> list[Point]:
        """Equilibria at the asked travels with other numerical settings."""
        return stepping.travel(self.system(law), self.load, np.array(asked), control, Counters())


def bench(mesh: dict, **others: object) -> Bench:
    settings = indentation.read_settings({"mesh": mesh, **others})
    return Bench(settings, indentation.build(settings, meshing.make(settings.recipe)))


@dataclass(frozen=True)
class Waves:
    """A smooth displacement field that is zero on nothing in particular, u = A sin(B X) (mm)."""

    amplitude: float
    seed: int = 1
    B: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "B", np.random.default_rng(self.seed).normal(size=(3, 3)) / 20.0)

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return self.amplitude * np.sin(X @ self.B + 0.3)


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
    return bench


@pytest.fixture(scope="session")
def waves():
    return Waves


@pytest.fixture(scope="session")
def law():
    return LAW


@pytest.fixture(scope="session")
def to_two(graded):
    """The ordinary run to 1 and 2 mm."""
    return indentation.solve(graded.settings, LAW, graded.model, np.array([1.0, 2.0]))


def taylor_slopes(error: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Slopes of log error over log step between neighbouring steps."""
    return np.diff(np.log(error)) / np.diff(np.log(steps))


@pytest.fixture(scope="session")
def slopes():
    return taylor_slopes
