"""A rigid plate that compresses the specimen from above."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator

from fem_backend import closed_forms, members
from fem_backend.indenters.indenter import INDENTERS
from fem_backend.indenters.meridian import Meridian, meridian_outline
from fem_backend.indenters.revolution import MAX_CONTACT_ELEMENT_RATIO, OfRevolution

ON_PLATE_TOLERANCE = 1e-6  # of its length: points that near to the plate lie on it
PLATE_LENGTH_RATIO = 1.0 / 3.0  # length over the smallest length of the specimen
ENDLESS_PLANE = meridian_outline([(0.0, math.inf)])  # a plate has no edge


@INDENTERS.register
@dataclass(frozen=True)
class Plate(OfRevolution):
    """Rigid plane without an end, across its way; it takes its length (mm) from the specimen.

    Contact "slip" is unilateral: frictionless, or with Coulomb's friction by the knob `friction`.  "bonded": what lies
    on the plate at first contact is glued to it, in every direction and also when it pulls; the rest may touch.
    """

    contact_kind: str = "slip"
    span: float = 3.0

    class Table(members.MemberTable):
        """{ shape = "plate", contact = "slip" }"""

        shape: Literal["plate"] = "plate"
        """A rigid plate, larger than the specimen."""
        contact: Annotated[str, BeforeValidator(members.one_of(("slip", "bonded")))] = "slip"
        """slip: the specimen slides on it, with the knob `friction`; bonded: its flat top is glued to it."""

        def build(self) -> Plate:
            """The indenter of these settings."""
            return Plate(self.contact)

    name: ClassVar[str] = "plate"
    noun: ClassVar[str] = "plate"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "plate",
            (),
            (),
            "a rigid plate, larger than the specimen",
            settings=lambda: {"indenter": {"shape": "plate", "contact": "slip"}},
            guess='it slides; or contact = "bonded"',
        ),
    )
    theory: ClassVar[str] = "Hertz"
    exponents: ClassVar[tuple[float, ...]] = (1.0, 2.0)  # uniform compression, and the first of what stiffens
    meridian: ClassVar[Meridian] = ENDLESS_PLANE
    gauges: ClassVar[Mapping[str, float]] = {}

    @property
    def described(self) -> str:
        """Whether it slides."""
        return f"a {'sliding' if self.contact_kind == 'slip' else 'bonded'} plate"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name, "contact": self.contact_kind}

    def on(self, specimen: Any) -> Plate:
        """The plate, its length a third of the smallest of the specimen.

        ValueError where it can hold nothing, and on a body without an end.
        """
        if getattr(specimen, "alike", False):
            raise ValueError(
                f'indenter.shape = "plate": it lies on all of a specimen.shape = "{specimen.name}", which has no end '
                'to the sides, so its force has none. Take specimen.shape = "cylinder" or "block", or a wall around it '
                '(support.kind = "well")'
            )
        if self.contact_kind == "bonded" and specimen.mean_curvature(0.0, 0.0) != 0.0:
            raise ValueError(
                f'indenter.contact = "bonded": a plate is glued to a flat top, that of specimen.shape = '
                f'"{specimen.name}" is curved; take "slip", with the knob friction'
            )
        return replace(self, span=PLATE_LENGTH_RATIO * float(specimen.smallest))

    def dimensions(self) -> Mapping[str, float]:
        """It has no end."""
        return {}

    def actual(self, knobs: Any, specimen: Any) -> Plate:
        """Itself: it has no size that errs."""
        return self

    @property
    def size(self) -> tuple[str, float]:
        """It has no size that must be small."""
        return "contact", self.span

    @property
    def finest(self) -> tuple[str, float]:
        """No edge."""
        return "contact", math.inf

    @property
    def length(self) -> float:
        """A third of the smallest length of the specimen (mm)."""
        return self.span

    def contact(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the specimen that it touches first."""
        return self.first_touched(specimen, touch, direction)

    def held(self, points: np.ndarray, touch: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        """Of a bonded plate the points (…, 3) of the specimen that lie on it at first contact, from its tip."""
        if self.contact_kind != "bonded":
            return None
        v = points - touch
        on = np.abs(v @ np.asarray(direction, float)) <= ON_PLATE_TOLERANCE * self.span
        if not on.any():
            raise ValueError('indenter.contact = "bonded": the top is tilted against the plate and touches it nowhere')
        return np.where(on[..., None], v, np.nan)

    def spacing(self, r: np.ndarray) -> np.ndarray:
        """Wanted element size (…) mm at distances r (…) mm from the axis: the same everywhere, 0.12 of its length."""
        return np.full(np.shape(r), MAX_CONTACT_ELEMENT_RATIO * self.span)

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Hertz's √(d/H) (mm) at depths d (mm) in a body of mean curvature H (1/mm); on a plane much more than that."""
        return np.sqrt(np.asarray(depth, float) / max(curvature, 1e-6 / self.span))

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray | None:
        """Hertz's F (N) at depths (mm) of a plane on a body of mean curvature H > 0 (1/mm), R = 1/H; None on a plane.

        Assumptions: half-space, small strain, no friction.  Source: Johnson 1985, eq. 4.23.
        """
        return closed_forms.hertz_force(depth, 1.0 / curvature, E, nu) if curvature > 0.0 else None

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """No other one."""
        return {}
