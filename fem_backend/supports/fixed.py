"""The lower half of the specimen's surface is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.contact.tractions import ContactSurface, Pair
from fem_backend.kinematics.tetrahedra import Body
from fem_backend.supports.support import SUPPORTS


@SUPPORTS.register
@dataclass(frozen=True)
class Fixed:
    """u = 0 on the specimen's part `lower`."""

    class Table(members.MemberTable):
        """{ kind = "fixed" }"""

        kind: Literal["fixed"] = "fixed"
        """The lower half of the surface is held."""

        def build(self) -> Fixed:
            """The support of these settings."""
            return Fixed()

    name: ClassVar[str] = "fixed"
    Knobs: ClassVar[type | None] = None
    lengths: ClassVar[tuple[str, ...]] = ()
    loose: ClassVar[bool] = False
    variant: ClassVar[str] = "held"
    words: ClassVar[str] = "held"
    group: ClassVar[str] = ""
    seconds: ClassVar[tuple[float, float, float]] = (13.0, 5.0, 3.0)
    way: ClassVar[float] = 1.8
    marks: ClassVar[tuple[str, ...]] = ()

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"kind": self.name}

    def defaults(self) -> Mapping[str, float]:
        """No knobs."""
        return {}

    def refusal(self, specimen: Any) -> str | None:
        """Every specimen has a lower part."""
        return None

    def planes(self) -> tuple[bool, bool]:
        """As symmetric as the specimen."""
        return True, True

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """All components (n, 3) of the nodes of the part `lower`."""
        held = np.zeros(X.shape, bool)
        held[surface[specimen.part("lower", X[surface])]] = True
        return held

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

    def holding(self) -> Fixed:
        """It only holds."""
        return self

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
