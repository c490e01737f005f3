"""The base of the specimen is bonded to something rigid, or to something that yields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from fem_backend import members
from fem_backend.supports.support import SUPPORTS
from fem_backend.supports.walls import BONDED, Walls, Yielding


@SUPPORTS.register
@dataclass(frozen=True)
class Bonded(Walls):
    """u = 0 on the specimen's part `base`; on a substrate that yields p = −u_z/compliance there."""

    class Table(members.MemberTable):
        """{ kind = "bonded" }"""

        kind: Literal["bonded"] = "bonded"
        """The base is bonded to something rigid."""

        def build(self) -> Bonded:
            """The support of these settings."""
            return Bonded()

    Knobs: ClassVar[type | None] = Yielding
    name: ClassVar[str] = "bonded"
    variant: ClassVar[str] = "bonded"
    words: ClassVar[str] = "bonded to a stiff base"

    @property
    def described(self) -> str:
        """Which part of the surface it holds."""
        return "bonded to a rigid base"

    def grips(self) -> Mapping[str, str]:
        """Its base is bonded."""
        return {"base": BONDED}

    def actual(self, knobs: Any) -> Bonded:
        """The compliance of its substrate."""
        return replace(self, yields=knobs.substrate_compliance)

    def holding(self) -> Bonded:
        """It only holds."""
        return self
