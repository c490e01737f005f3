"""What an indenter says of itself: its surface, how it meets a specimen, its sizes, its closed forms.

A new indenter is one file in this folder with one registered class.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fem_backend.contact.tractions import ContactSurface, Rigid
from fem_backend.members import MemberTable, OpenSet, SettingsOption

INDENTERS: OpenSet[Indenter] = OpenSet("indenter", "shape", "sphere")


class Contact(Protocol):
    """What is reported of a contact: lengths mm, areas mm², pressures MPa, of the whole specimen as it is now."""

    area: float
    radius: float
    peak: float


class Indenter(Rigid, Protocol):
    """A rigid indenter; lengths in mm, in the frame of the specimen.

    `length` is what steps, penalties, forces and errors scale with.  `noun` names it in sentences, `gauges` are its
    knobs that a measurement on the bench shows, with the standard uncertainty of that for the usual size.
    `exponents` p are those of Fz = Σ a_p u^p at small depths u, the leading one first.
    """

    name: ClassVar[str]
    noun: ClassVar[str]
    theory: ClassVar[str]
    """Whose closed form `force` is."""
    Table: ClassVar[type[MemberTable]]
    Knobs: ClassVar[type | None]
    gauges: ClassVar[Mapping[str, float]]
    options: ClassVar[tuple[SettingsOption, ...]]
    """Options of `rso new` that choose it."""
    exponents: ClassVar[tuple[float, ...]]
    of_revolution: ClassVar[bool]
    """Whether it is of revolution about its way."""

    def on(self, specimen: Any) -> Indenter:
        """Itself as settings put it on a specimen, with what it takes from that: a plate its length."""

    @property
    def length(self) -> float: ...

    def dimensions(self) -> Mapping[str, float]:
        """Own knobs that are an error of what its table states → what that states, in the knob's unit; 1 of a share."""

    @property
    def size(self) -> tuple[str, float]:
        """Key of its table and value (mm) of what must be small beside the specimen."""

    @property
    def finest(self) -> tuple[str, float]:
        """Key of its table and the radius (mm) of an edge or tip that elements must resolve; ∞ where it has none."""

    @property
    def reach(self) -> float:
        """Distance (mm) from the first contact within which facets may touch."""

    def spacing(self, r: np.ndarray) -> np.ndarray:
        """Wanted element size (…) mm, at unit fineness, on the surface at distances r (…) mm from its axis."""

    def on_edge(self, radius: np.ndarray) -> np.ndarray:
        """How far contacts of a radius (…) mm reach onto a rounded edge of it, in elements of unit fineness; else ∞."""

    @property
    def cover(self) -> float:
        """Distance (mm) from its axis up to which a camera from above sees no surface."""

    @property
    def ratio(self) -> float:
        """Its size over the usual one, which declared ranges of knobs are meant for."""

    @property
    def described(self) -> str:
        """Itself with its sizes, as a noun phrase: a ball of radius 3 mm."""

    def plain(self) -> dict[str, Any]:
        """Its table as it enters the key of a run, with all defaults written out."""

    def actual(self, knobs: Any, specimen: Any) -> Indenter:
        """Itself with the errors that knobs give it; ValueError naming knob, value and unit where nothing is left."""

    def planes(self) -> tuple[bool, bool]:
        """Whether it is symmetric about x = 0 and y = 0 when it goes down along z."""

    def swept(self, points: np.ndarray, start: np.ndarray, end: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Whether points (…, 3) lie inside of it at some place of its reference point between two (3,).

        `direction` (3,) is its way into the body, from the one to the other or back.
        """

    def first_contact(self, specimen: Any, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
        """Reference point (3,) where it first touches the undeformed specimen on the line through `through`.

        Raises ValueError where it passes by.
        """

    def contact(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the specimen about which contact grows, for the reference point `touch` (3,) on its way."""

    def held(self, points: np.ndarray, touch: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        """Places (…, 3) mm relative to the reference point at which points (…, 3) are glued to it from the first
        contact on, nan where they are free; None of an indenter that lets go of all.  Raises ValueError where it ought
        to hold and touches none.
        """

    def normal(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Unit vector (3,) out of the specimen about which its contact is reported: the axis of `patch`."""

    def patch(
        self,
        surface: ContactSurface,
        x: np.ndarray,
        pressure: np.ndarray,
        centre: np.ndarray,
        axis: np.ndarray,
        planes: tuple[bool, bool],
        attraction: np.ndarray | None,
        width: float = np.inf,
    ) -> Contact:
        """Area, radius and peak pressure from positions x (n, 3) and pressures (f, q) MPa per reference area.

        Contact is known to be hardly wider than the `width` (mm).
        """

    def outline(self, centre: np.ndarray, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Closed line (k, 2) of its cut by the plane of unit vectors `across` (2, 3) through its reference point."""

    def effective_radius(self, curvature: float) -> float:
        """Radius (mm) of the sphere that meets a half-space as it meets a specimen of mean curvature (1/mm)."""

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Radius (mm) of the contact by the same closed form; where there is none, an order of magnitude."""

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray | None:
        """Closed form of the force (N) at depths (mm), small strain; None where there is none."""

    def modulus(self, force: np.ndarray, depth: np.ndarray, curvature: float, nu: float) -> np.ndarray | None:
        """Young's modulus (MPa) by the same closed form; None where there is none."""

    def adhesive_fit(self, travel: np.ndarray, force: np.ndarray, curvature: float) -> dict[str, float]:
        """Knobs of a curve that pulls, by a closed form; nothing where there is none."""

    def strain(self, depth: np.ndarray | float) -> np.ndarray | float | None:
        """Logarithmic strain that it causes at least below itself at a depth (mm); None where that is not known."""

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """Other indenters that one would try, in words, and their settings."""
