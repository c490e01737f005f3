"""What supports share that only hold some nodes: they touch nothing and give way nowhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from fem_backend.contact.tractions import ContactSurface, Pair
from fem_backend.kinematics.bodies import Body


class Holding:
    """A support that only holds; a base class, no member.  `name` is its kind."""

    name: ClassVar[str]
    Knobs: ClassVar[type | None] = None
    lengths: ClassVar[tuple[str, ...]] = ()
    loose: ClassVar[bool] = False
    group: ClassVar[str] = ""
    seconds: ClassVar[tuple[float, float, float]] = (13.0, 5.0, 3.0)
    of_revolution: ClassVar[bool] = True
    way: ClassVar[float] = 1.8
    marks: ClassVar[tuple[str, ...]] = ()

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"kind": self.name}

    def defaults(self) -> Mapping[str, float]:
        """No knobs."""
        return {}

    def actual(self, knobs: Any) -> Holding:
        """No knob changes it."""
        return self

    def confines(self, specimen: Any) -> Any:
        """It leaves it as it is."""
        return specimen

    def offered(self, specimen: Any) -> bool:
        """It may be tried."""
        return True

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
