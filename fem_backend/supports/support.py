"""What a support says of itself: what it holds, what it touches, which rigid motions it leaves.

A new support is one file in this folder with one registered class.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

import numpy as np

from fem_backend.contact.tractions import ContactSurface, Pair
from fem_backend.kinematics.bodies import Body
from fem_backend.members import MemberTable, OpenSet, SettingsOption
from rso.contract import Drawn

SUPPORTS: OpenSet[Support] = OpenSet("support", "kind", "fixed", marks={"rolling": 3})


class Support(Protocol):
    """A support of the specimen; lengths in mm, moduli in MPa, frame of the specimen.

    `loose` says whether it leaves rigid motions, which contact alone takes away: such a body is seated before the test
    and found with grounding springs.  `words` complete "… instead of …" and `variant` names it where it is an
    alternative; `group` is that of its knobs, of which
    `lengths` go with the size of the specimen.  `seconds` are those of a coarse elastic run with 0, 1, 2 planes of
    symmetry, and `way` how many times as long one takes where the way counts.
    """

    name: ClassVar[str]
    Table: ClassVar[type[MemberTable]]
    Knobs: ClassVar[type | None]
    options: ClassVar[tuple[SettingsOption, ...]]
    """Options of `rso new` that choose it."""
    lengths: ClassVar[tuple[str, ...]]
    gauges: ClassVar[Mapping[str, float]]
    """As of an indenter, for the usual size of specimen."""
    loose: ClassVar[bool]
    variant: ClassVar[str]
    words: ClassVar[str]
    group: ClassVar[str]
    seconds: ClassVar[tuple[float, float, float]]
    way: ClassVar[float]
    of_revolution: ClassVar[bool]
    """Whether it is of revolution about z where the specimen is."""

    def plain(self) -> dict[str, Any]:
        """Its table as far as it enters the key of a run: what sets a knob is among the values."""

    @property
    def described(self) -> str:
        """What it does to a specimen, behind a comma: in a bowl 1 mm larger all round."""

    def drawn(self, specimen: Any, way: np.ndarray, wide: float) -> list[Drawn]:
        """Walls that the specimen may touch, in its section along `way` (2,), to `wide` (mm) off the axis.

        They are lines of the role `support`, solid to the right of their way; what is held is found by `held`.
        """

    def defaults(self) -> Mapping[str, float]:
        """Knobs that its table sets."""

    def dimensions(self) -> Mapping[str, float]:
        """Own knobs that are an error of what its table states → what that states, in the knob's unit."""

    def actual(self, knobs: Any) -> Support:
        """Itself with what knobs make of it: its friction decides whether nodes are held or touched."""

    def absent(self, specimen: Any) -> frozenset[str]:
        """Those of its own knobs that say nothing with this specimen."""

    def confines(self, specimen: Any) -> Any:
        """The specimen as wide as it leaves it; as it is where it cannot carry it."""

    def offered(self, specimen: Any) -> bool:
        """Whether a diagnosis may try it with its defaults, as what no other one is already."""

    def refusal(self, specimen: Any) -> str | None:
        """Why it cannot carry this specimen; None where it can."""

    def same(self, other: Support, specimen: Any) -> bool:
        """Whether another support, which carries this specimen too, makes the same model of it under another name."""

    def planes(self) -> tuple[bool, bool]:
        """Whether it is symmetric about x = 0 and y = 0."""

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """Which displacement components (n, 3) it holds, of nodes X (n, 3); `surface` (k,) are those of the surface."""

    def surfaces(self, specimen: Any, body: Body, facets: np.ndarray) -> tuple[ContactSurface, ...]:
        """Surfaces, of the facets (f, 6), that it may touch."""

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
        """Contact pairs on these surfaces of the specimen as it is, `nominal` as the settings say.

        `mu` (MPa) and the `length` (mm) of the indenter scale penalties; `soft` pairs never get multipliers.
        """

    def friction(self, values: Mapping[str, float]) -> float:
        """Its coefficient of friction among values by knob, the default where there is none."""

    def holding(self) -> Support:
        """Itself as far as it enters `held`: specimens that are held alike share a model."""

    def clearance(self, knobs: Any) -> float:
        """Room (mm) between it and the undeformed specimen; 0 where there is none."""

    def sinking(self, specimen: Any, length: float, knobs: Any) -> float:
        """Share of the travel of an indenter of a `length` by which a weightless specimen gives way as a whole."""

    def anchored(self, knobs: Any) -> dict[str, float | None]:
        """What of it a warm start depends on, by word."""

    def from_anchor(self, words: Mapping[str, Any]) -> dict[str, float]:
        """Knobs of a frictionless warm start from `anchored`."""

    def revised(self, specimen: Any) -> bool:
        """Whether answers with it have changed since the first numerics."""
