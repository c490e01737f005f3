"""The base of the specimen lies on a plate, along which it slides with or without friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from fem_backend import members
from fem_backend.supports.support import SUPPORTS
from fem_backend.supports.walls import GAP, SLIP, Walls, Yielding
from rso.contract import knob


@SUPPORTS.register
@dataclass(frozen=True)
class SupportingPlate(Walls):
    """The base stays in the plane of the plate, as weight and suction hold a gel, or may lift off where it is `loose`.

    Coulomb: |t| ≤ f p with the pressure p on the plate, none where it would lift off.  f = 0 slips, f → ∞ is bonded
    wherever it presses.
    """

    loose: bool = False  # type: ignore[misc]

    class Table(members.MemberTable):
        """{ kind = "plate", friction = 0.0, lift = false }"""

        kind: Literal["plate"] = "plate"
        """The base lies on a rigid plate."""
        friction: Annotated[float, BeforeValidator(members.at_least(0.0, "must be >= 0"))] = 0.0
        """Coulomb friction between plate and specimen; 0 slips."""
        lift: members.Flag = False
        """Whether the base may lift off; otherwise it stays in its plane."""

        def build(self) -> SupportingPlate:
            """The support of these settings."""
            return SupportingPlate(self.friction, loose=self.lift)

    @dataclass(frozen=True)
    class Knobs(Yielding):
        """Knobs that exist only on a plate."""

        plate_friction: float = knob(
            "Coulomb friction between plate and specimen",
            "1",
            0.0,
            100.0,
            default=0.0,
            group="plate",
            scope="mounting",
            typical=0.3,
            plausible=(0.05, 1.0),
            label="friction on the plate",
        )

    name: ClassVar[str] = "plate"
    variant: ClassVar[str] = "plate"
    words: ClassVar[str] = "on a plate, where it slides"
    group: ClassVar[str] = "plate"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings; the friction is a knob."""
        return {"kind": self.name, "lift": self.loose}

    def defaults(self) -> Mapping[str, float]:
        """The friction of the table."""
        return {"plate_friction": self.rubs}

    def grips(self) -> Mapping[str, str]:
        """Its base slips, or is touched from above only."""
        return {"base": GAP if self.loose else SLIP}

    def actual(self, knobs: Any) -> SupportingPlate:
        """The friction, and the compliance of its substrate."""
        return replace(self, rubs=knobs.plate_friction, yields=knobs.substrate_compliance)

    def friction(self, values: Mapping[str, float]) -> float:
        """Coulomb coefficient of the plate."""
        return values.get("plate_friction", self.rubs)

    def holding(self) -> SupportingPlate:
        """Whether it rubs or yields decides what it holds, not how much."""
        return replace(self, rubs=float(self.rubs > 0.0), yields=float(self.yields > 0.0))
