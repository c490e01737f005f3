"""What supports share that only hold some nodes: they touch nothing and give way nowhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from fem_backend.contact.tractions import ContactSurface, Pair
from fem_backend.kinematics.bodies import Body
from fem_backend.members import SettingsOption
from rso.contract import Drawn

N_COMPARED_POINTS = 200  # points of the surface by which two supports are compared


class Holding:
    """A support that only holds; a base class, no member.  `name` is its kind."""

    name: ClassVar[str]
    Knobs: ClassVar[type | None] = None
    options: ClassVar[tuple[SettingsOption, ...]] = ()
    lengths: ClassVar[tuple[str, ...]] = ()
    gauges: ClassVar[Mapping[str, float]] = {}
    loose: ClassVar[bool] = False
    group: ClassVar[str] = ""
    seconds: ClassVar[tuple[float, float, float]] = (13.0, 5.0, 3.0)
    of_revolution: ClassVar[bool] = True
    way: ClassVar[float] = 1.8
    marks: ClassVar[tuple[str, ...]] = ()

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"kind": self.name}

    def drawn(self, specimen: Any, way: np.ndarray, wide: float) -> list[Drawn]:
        """No walls."""
        return []

    def defaults(self) -> Mapping[str, float]:
        """No knobs."""
        return {}

    def dimensions(self) -> Mapping[str, float]:
        """It has no sizes."""
        return {}

    def actual(self, knobs: Any) -> Holding:
        """No knob changes it."""
        return self

    def absent(self, specimen: Any) -> frozenset[str]:
        """All of its knobs count."""
        return frozenset()

    def confines(self, specimen: Any) -> Any:
        """It leaves it as it is."""
        return specimen

    def offered(self, specimen: Any) -> bool:
        """It may be tried."""
        return True

    def same(self, other: Any, specimen: Any) -> bool:
        """Whether the other only holds, too, and the same: compared at points all around the specimen."""
        if not isinstance(other, Holding) or self.group or other.group:
            return False  # what has knobs of its own does more
        X = _around(specimen)
        every = np.arange(len(X))
        mine, its = self.held(specimen, X, every), other.held(specimen, X, every)
        return np.array_equal(mine, its) and bool(mine.any())  # what holds none of them cannot be told

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """Which displacement components (n, 3) of nodes X (n, 3) it holds: a member says."""
        raise NotImplementedError

    def planes(self) -> tuple[bool, bool]:
        """As symmetric as the specimen."""
        return True, True

    def surfaces(self, specimen: Any, body: Body, facets: np.ndarray) -> tuple[ContactSurface, ...]:
        """It touches nothing."""
        return ()

    def pairs(
        self,
        nominal: Any,
        specimen: Any,
        surfaces: tuple[ContactSurface, ...],
        knobs: Any,
        mu: float,
        length: float,
        soft: bool,
    ) -> tuple[Pair, ...]:
        """It touches nothing."""
        return ()

    def friction(self, values: Mapping[str, float]) -> float:
        """Nothing slides."""
        return 0.0

    def clearance(self, knobs: Any) -> float:
        """No room."""
        return 0.0

    def sinking(self, specimen: Any, length: float, knobs: Any) -> float:
        """It does not give way."""
        return 0.0

    def anchored(self, knobs: Any) -> dict[str, float | None]:
        """Nothing of it varies."""
        return {"clearance": None}

    def from_anchor(self, words: Mapping[str, Any]) -> dict[str, float]:
        """No knobs."""
        return {}

    def revised(self, specimen: Any) -> bool:
        """Answers are as they were."""
        return False


def _around(specimen: Any) -> np.ndarray:
    """Points (n, 3) mm of the surface: the lowest, and those nearest to a Fibonacci lattice on a sphere around."""
    k = np.arange(N_COMPARED_POINTS) + 0.5
    z, turn = 1.0 - 2.0 * k / N_COMPARED_POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z**2)
    directions = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    middle = 0.5 * (specimen.top + specimen.lowest)
    return np.array([specimen.lowest, *(specimen.closest(middle + 2.0 * specimen.largest * d) for d in directions)])
