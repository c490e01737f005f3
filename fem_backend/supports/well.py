"""The specimen sits in a round rigid well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, model_validator

from fem_backend import members
from fem_backend.supports.support import SUPPORTS
from fem_backend.supports.walls import BONDED, GAP, ON_SIDE_TOLERANCE, SLIP, Walls
from rso.contract import knob

MIN_WELL_RATIO = 0.2  # of the radius over that of the settings


@SUPPORTS.register
@dataclass(frozen=True)
class Well(Walls):
    """A well of `radius` (mm), as deep as the specimen is high; 0: as wide as the specimen.

    `base` is bonded or slips, `side` is bonded, slips (u_r = 0), or is touched once it has crossed the gap that the
    radius leaves.  A slab is as wide as its well.  Coulomb friction counts wherever it may slide.
    `off` (mm) is the error of the radius.
    """

    radius: float = 0.0
    base: str = BONDED
    side: str = SLIP
    off: float = 0.0

    class Table(members.MemberTable):
        """{ kind = "well", radius = 3.2, base = "bonded" | "slip", wall = "bonded" | "slip" | "gap", friction = 0 }"""

        kind: Literal["well"] = "well"
        """The specimen sits in a round rigid well."""
        radius: members.Length | None = None
        """Radius of the well, mm; that of the specimen where it is left out."""
        base: Annotated[str, BeforeValidator(members.one_of((BONDED, SLIP)))] = BONDED
        """bonded, or slip: it stays in its plane."""
        wall: Annotated[str, BeforeValidator(members.one_of((BONDED, SLIP, GAP)))] = SLIP
        """bonded, slip: it stays on the wall, or gap: it may come off, and touches where there is room before."""
        friction: Annotated[float, BeforeValidator(members.at_least(0.0, "must be >= 0"))] = 0.0
        """Coulomb friction wherever it may slide."""

        @model_validator(mode="after")
        def _slides(self) -> Well.Table:
            if self.friction and self.base == self.wall == BONDED:
                raise members.refused(': nothing slides where base and wall are "bonded"', "friction", self.friction)
            return self

        def build(self) -> Well:
            """The support of these settings."""
            return Well(self.friction, 0.0, self.radius or 0.0, self.base, self.wall)

    @dataclass(frozen=True)
    class Knobs:
        """Knobs that exist only in a well."""

        well_friction: float = knob(
            "Coulomb friction between well and specimen",
            "1",
            0.0,
            100.0,
            default=0.0,
            group="well",
            scope="mounting",
            typical=0.3,
            plausible=(0.05, 1.0),
            label="friction in the well",
        )
        delta_well: float = knob(
            "error of the radius of the well",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            scope="mounting",
            typical=0.05,
            plausible=(-0.3, 0.3),
            label="wrong radius of the well",
        )

    name: ClassVar[str] = "well"
    parts: ClassVar[tuple[str, ...]] = ("base", "side")
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "well",
            ("RADIUS", "DEPTH"),
            ("mm", "mm"),
            "a well filled by the specimen, bonded to its bottom and free to slide along its wall",
            settings=lambda r, d: {
                "specimen": {"shape": "slab", "thickness": d},
                "support": {"kind": "well", "radius": r, "base": BONDED, "wall": SLIP},
            },
            guess="what holds it at the base and at the wall",
        ),
    )
    variant: ClassVar[str] = "well"
    words: ClassVar[str] = "in a well"
    group: ClassVar[str] = "well"
    lengths: ClassVar[tuple[str, ...]] = ("delta_well",)
    gauges: ClassVar[Mapping[str, float]] = {"delta_well": 0.02}

    @property
    def described(self) -> str:
        """Its radius and how it holds base and side."""
        radius = f" of radius {members.length_words(self.radius)}" if self.radius else ""
        words = {BONDED: "bonded", SLIP: "sliding", GAP: "free to leave it"}
        return f"in a well{radius} (base {words[self.base]}, wall {words[self.side]})"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings; the friction is a knob."""
        return {"kind": self.name, "radius": self.radius or None, "base": self.base, "wall": self.side}

    def defaults(self) -> Mapping[str, float]:
        """The friction of the table."""
        return {"well_friction": self.rubs}

    def grips(self) -> Mapping[str, str]:
        """As the table says."""
        return {"base": self.base, "side": self.side}

    def wall(self, specimen: Any) -> float:
        """The radius of the well, or that of the specimen which fills it."""
        if self.radius and self.side == GAP:
            return self.radius + self.off
        return specimen.within(self.radius + self.off).half_width if self.radius else specimen.half_width

    def dimensions(self) -> Mapping[str, float]:
        """Its radius, where it is not that of the specimen."""
        return {"delta_well": self.radius} if self.radius else {}

    def actual(self, knobs: Any) -> Well:
        """The friction, and the error of its radius; ValueError where hardly any of that is left."""
        if self.radius and self.radius + knobs.delta_well <= MIN_WELL_RATIO * self.radius:
            raise ValueError(
                f"delta_well = {knobs.delta_well:g} mm: a well of radius {self.radius + knobs.delta_well:g} mm, must "
                f"be larger than {MIN_WELL_RATIO * self.radius:g} mm ({MIN_WELL_RATIO:g} of that asked for)"
            )
        return replace(self, rubs=knobs.well_friction, off=knobs.delta_well if self.radius else 0.0)

    def absent(self, specimen: Any) -> frozenset[str]:
        """The error of a radius that is that of the specimen, which has one of its own."""
        means = bool(self.radius) and (self.side == GAP or self._cast(specimen))
        return frozenset() if means else frozenset(("delta_well",))

    def _cast(self, specimen: Any) -> bool:
        """Whether a specimen is as wide as any well."""
        return specimen.within(2.0 * self.radius).half_width != specimen.within(self.radius).half_width

    def confines(self, specimen: Any) -> Any:
        """A slab as wide as the well, a fine grid at a wall that touches."""
        if self.refusal(specimen):
            return specimen
        if (
            self.off
            and self.side == GAP
            and not self._cast(specimen)
            and specimen.half_width > self.wall(specimen) * (1.0 + ON_SIDE_TOLERANCE)
        ):
            raise ValueError(
                f"delta_well = {self.off:g} mm: the specimen, of radius {specimen.half_width:g} mm, is wider than a "
                f"well of {self.wall(specimen):g} mm"
            )
        own_width = not specimen.alike and not (self.off and self._cast(specimen))
        room = own_width and self.wall(specimen) > specimen.half_width * (1.0 + ON_SIDE_TOLERANCE)
        return specimen if room else specimen.within(self.wall(specimen))

    def offered(self, specimen: Any) -> bool:
        """Nobody is unaware of a well."""
        return False

    def refusal(self, specimen: Any) -> str | None:
        """Only a round specimen with a side that fits."""
        said = super().refusal(specimen)
        if said:
            return said
        if not specimen.of_revolution or specimen.within(self.radius or specimen.half_width) is None:
            return f'support.kind = "well" is round and as wide as what it holds; a {specimen.name} is not'
        if not self.radius and specimen.alike:
            return f"support.radius: a {specimen.name} has no width of its own; say the radius of the well, mm"
        if not self.radius:
            return None
        own = specimen.within(self.radius).half_width
        if own > self.radius * (1.0 + ON_SIDE_TOLERANCE):
            return f"support.radius = {self.radius:g} mm: the specimen, of radius {own:g} mm, is wider than the well"
        if own < self.radius * (1.0 - ON_SIDE_TOLERANCE) and self.side != GAP:
            return (
                f"support.radius = {self.radius:g} mm: wall = {self.side!r} touches the specimen, whose radius is "
                f'{own:g} mm; leave the radius out, or take wall = "gap"'
            )
        return None

    def friction(self, values: Mapping[str, float]) -> float:
        """Coulomb coefficient of the well, if anything slides."""
        return 0.0 if self.base == self.side == BONDED else values.get("well_friction", self.rubs)

    def holding(self) -> Well:
        """Whether it rubs decides what it holds, not how much; how wide it is the specimen says."""
        return replace(self, rubs=float(self.rubs > 0.0), off=0.0)
