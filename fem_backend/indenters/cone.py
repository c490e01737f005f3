"""A rigid cone with a rounded tip, or the cone that stands for a pyramid."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from fem_backend import members
from fem_backend.indenters.indenter import INDENTERS
from fem_backend.indenters.meridian import Meridian, half_space_force, half_space_radius, meridian_outline
from fem_backend.indenters.revolution import LENGTH_IN_TIP_RADII, OfRevolution
from rso.contract import knob

MIN_HALF_ANGLE_DEG, MAX_HALF_ANGLE_DEG = 10.0, 88.0  # half angle in degrees
USUAL_TIP_RADIUS_MM = 0.05  # mm, of a cone whose tip nobody said, where no record tells a length either
TIP_RADIUS_DEPTH_SHARE = 0.05  # of the depth of the record, of a tip that nobody said
PYRAMIDS = {  # cross-section over height²; angles between axis and face, Oliver & Pharr 1992 and ISO 14577-1
    "vickers": 4.0 * math.tan(math.radians(68.0)) ** 2,
    "berkovich": 3.0 * math.sqrt(3.0) * math.tan(math.radians(65.27)) ** 2,
    "cube_corner": 3.0 * math.sqrt(3.0) * math.tan(math.radians(35.264)) ** 2,
}


def equivalent_half_angle(pyramid: str) -> float:
    """Half angle α (degrees) of the cone with the cross-section of a pyramid at every height: π tan² α = A/h².

    70.3° of Vickers and Berkovich, 42.3° of a cube corner.  Source: Oliver & Pharr 1992.
    """
    return math.degrees(math.atan(math.sqrt(PYRAMIDS[pyramid] / math.pi)))


@INDENTERS.register
@dataclass(frozen=True)
class Cone(OfRevolution):
    """Rigid cone of a half angle (degrees from the axis) with a spherical tip (mm); its reference point is its tip.

    An arc of the tip's radius and the flank, tangent to it, without an end.
    """

    half_angle: float
    tip_radius: float

    class Table(members.MemberTable):
        """{ shape = "cone", half_angle = 60, tip_radius = 0.05 }, or pyramid = "vickers" in place of half_angle"""

        shape: Literal["cone"] = "cone"
        """A rigid cone."""
        half_angle: Annotated[float, members.read_in("deg")] | None = None
        """Angle between axis and flank, degrees."""
        pyramid: Literal["vickers", "berkovich", "cube_corner"] | None = None
        """In place of half_angle, the cone of equal cross-section: vickers | berkovich | cube_corner."""
        tip_radius: members.Length
        """Radius of the rounded tip, mm."""

        @model_validator(mode="before")
        @classmethod
        def _pointed(cls, value: Any) -> Any:
            """Exactly one angle, and a tip that is rounded."""
            angle, pyramid = value.get("half_angle"), value.get("pyramid")
            tip = value.get("tip_radius", members.MISSING)
            range_ = f"{MIN_HALF_ANGLE_DEG:g} to {MAX_HALF_ANGLE_DEG:g} degrees from the axis"
            if angle is not None and pyramid is not None:
                raise members.refused(": half_angle is given, too; one of the two is expected", "pyramid", pyramid)
            if pyramid is not None and (not isinstance(pyramid, str) or pyramid not in PYRAMIDS):
                words = members.nearest_choices(str(pyramid), list(PYRAMIDS))
                raise members.refused(f" is not modelled; {words}", "pyramid", pyramid)
            if angle is None and pyramid is None:
                words = f": missing; {range_}, or pyramid = {' | '.join(PYRAMIDS)}"
                raise members.refused(words, "half_angle", members.MISSING)
            if angle is not None and (
                not members.is_finite(angle) or not MIN_HALF_ANGLE_DEG <= angle <= MAX_HALF_ANGLE_DEG
            ):
                raise members.refused(f" degrees: {range_} is expected", "half_angle", angle)
            if tip is members.MISSING or (members.is_finite(tip) and tip == 0.0):
                words = ": missing; " if tip is members.MISSING else " mm: "
                words += "a sharp tip has an infinite pressure, which no mesh resolves: give the radius of its tip"
                words += ", a tenth of the depth or less"
                raise members.refused(words, "tip_radius", tip)
            return value

        def build(self) -> Cone:
            """The indenter of these settings."""
            angle = equivalent_half_angle(self.pyramid) if self.pyramid is not None else self.half_angle
            assert angle is not None  # one of the two is there
            return Cone(angle, self.tip_radius)

    @dataclass(frozen=True)
    class Knobs:
        """Errors of its angle and of its tip."""

        delta_half_angle: float = knob(
            "error of the half angle of the cone",
            "deg",
            -30.0,
            30.0,
            neutral=0.0,
            typical=0.5,
            plausible=(-2.0, 2.0),
            label="wrong half angle of the cone",
        )
        delta_tip_radius: float = knob(
            "error of the tip radius of the cone",
            "mm",
            -10.0,
            10.0,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.15, 0.3),
            label="wrong tip radius of the cone",
        )

    name: ClassVar[str] = "cone"
    noun: ClassVar[str] = "cone"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "cone",
            ("HALF_ANGLE", "[TIP_RADIUS]"),
            ("deg", "mm"),
            "a cone, by the angle between its axis and its flank, with a rounded tip",
            least=1,
            settings=lambda a, r=USUAL_TIP_RADIUS_MM: {"indenter": {"shape": "cone", "half_angle": a, "tip_radius": r}},
            guess="the radius of its tip, nobody said it: a twentieth of the depth of the record",
            left_out=lambda given, depth: (*given, float(f"{TIP_RADIUS_DEPTH_SHARE * depth:.1g}")),
        ),
    )
    exponents: ClassVar[tuple[float, ...]] = (2.0, 3.0)  # Sneddon, and the first of what stiffens or softens
    gauges: ClassVar[Mapping[str, float]] = {"delta_half_angle": 0.2, "delta_tip_radius": 0.02}

    @property
    def described(self) -> str:
        """Its angle and its tip."""
        return f"a cone of half angle {self.half_angle:.4g}° and tip radius {members.length_words(self.tip_radius)}"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings: a pyramid is the cone that stands for it."""
        return {"shape": self.name, "half_angle": self.half_angle, "tip_radius": self.tip_radius}

    def dimensions(self) -> Mapping[str, float]:
        """Half angle and radius of the tip."""
        return {"delta_half_angle": self.half_angle, "delta_tip_radius": self.tip_radius}

    def actual(self, knobs: Any, specimen: Any) -> Cone:
        """The cone with the errors of its angle and tip; ValueError where these are none of a rounded cone."""
        angle, tip = self.half_angle + knobs.delta_half_angle, self.tip_radius + knobs.delta_tip_radius
        if not MIN_HALF_ANGLE_DEG <= angle <= MAX_HALF_ANGLE_DEG:
            raise ValueError(
                f"delta_half_angle = {knobs.delta_half_angle:g} deg: a half angle of {angle:g} degrees, must be "
                f"{MIN_HALF_ANGLE_DEG:g} to {MAX_HALF_ANGLE_DEG:g}"
            )
        if tip < 0.1 * self.tip_radius:
            raise ValueError(
                f"delta_tip_radius = {knobs.delta_tip_radius:g} mm: a tip of {tip:g} mm, must be at least "
                f"{0.1 * self.tip_radius:g} mm (0.1 of that of the settings)"
            )
        return replace(self, half_angle=angle, tip_radius=tip)

    @property
    def meridian(self) -> Meridian:
        """The tip and the flank."""
        return _meridian(self.half_angle, self.tip_radius)

    @property
    def size(self) -> tuple[str, float]:
        """Key of the table and its value (mm)."""
        return "tip_radius", self.tip_radius

    @property
    def finest(self) -> tuple[str, float]:
        """The tip."""
        return "tip_radius", self.tip_radius

    @property
    def length(self) -> float:
        """Ten radii of the tip (mm)."""
        return LENGTH_IN_TIP_RADII * self.tip_radius

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray:
        """Sneddon's F (N) at depths d (mm) with the rounded tip, in a body of mean curvature (1/mm).

        (2/π) E/(1 − ν²) tan α d² where d is much larger than the tip.  Half-space, small strain, no friction; see
        :func:`.meridian.half_space_force`.
        """
        return half_space_force(self.meridian, depth, curvature, E, nu, self._wide(depth))

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Sneddon's contact radius (mm) at depths d (mm), about (2/π) d tan α where d is much larger than the tip."""
        return half_space_radius(self.meridian, depth, curvature, self._wide(depth))

    def _wide(self, depth: np.ndarray) -> float:
        """A radius (mm) that no contact to these depths exceeds, one of few."""
        deepest = max(float(np.max(depth, initial=0.0)), self.tip_radius)
        far = deepest * math.tan(math.radians(self.half_angle)) / self.length
        return self.length * 2.0 ** math.ceil(math.log2(far) + 1.0)

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """Another indenter that one would try, in words, and its settings."""
        angle = 45.0 if self.half_angle > 57.0 else 70.0
        table = {"shape": self.name, "half_angle": angle, "tip_radius": self.tip_radius}
        return {f"a cone of half angle {angle:g} degrees": {"indenter": table}}


@functools.lru_cache(maxsize=64)
def _meridian(half_angle: float, tip_radius: float) -> Meridian:
    flank = math.radians(90.0 - half_angle)
    return meridian_outline([(flank, tip_radius), (flank, math.inf)])
