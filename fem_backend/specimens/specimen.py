"""What a specimen says of itself: its surface with named parts, its sizes and their errors, its mesh at a contact.

A new specimen is one file in this folder with one registered class.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from skfem import MeshTet2

from fem_backend import meshing
from fem_backend.members import MemberTable, OpenSet, SettingsOption
from fem_backend.meshing import MeridianMesh, Mesh, Size
from fem_backend.specimens.own_laws import OwnLaw
from rso.contract import Drawn


class Specimens(OpenSet):
    """Specimens by name; each brings what makes its meshes."""

    def register(self, member: Any) -> Any:
        """As for every open set; the member's makers of meshes are known from then on."""
        meshing.MAKERS.update(member.makers)
        return super().register(member)


SPECIMENS: OpenSet[Specimen] = Specimens("specimen", "shape", "ellipsoid", marks={"mended": 12})

LAYER_KNOBS = ("delta_layer", "layer_ratio")  # knobs of the uppermost layer of specimens that have layers
PLACE_KNOBS = ("offset_x", "offset_y")  # knobs of where on the specimen the indenter is
MIN_SIZE_RATIO = 0.2  # of a size with its error over that of the settings: with less hardly anything is left


@dataclass(frozen=True)
class Meshing:
    """How a specimen is meshed: recipe of the mesh, keys of the mesh table that count, element size at the contact.

    `fineness` multiplies all sizes of a meridian.
    """

    recipe: str
    used: tuple[tuple[str, Any], ...]
    h0: float
    level: str
    fineness: float = 1.0


class Specimen(Protocol):
    """A specimen; lengths in mm, in its own frame: z up, origin on its axis.

    Parts of the surface are `upper`, what an indenter may meet and a camera sees, and `lower`, what a support holds or
    carries; those with a flat base have `base` and `side` too, `parts` names all.  `smallest_words` say what its
    smallest length is; `makers` make a mesh from the data of a recipe, by the name of the mesher in it; `gauges` as of
    an indenter.
    """

    name: ClassVar[str]
    Table: ClassVar[type[MemberTable]]
    Knobs: ClassVar[type | None]
    gauges: ClassVar[Mapping[str, float]]
    options: ClassVar[tuple[SettingsOption, ...]]
    """Options of `rso new` that choose it."""
    rests: ClassVar[str]
    """The support of a new study."""
    makers: ClassVar[Mapping[str, Callable[[Mapping[str, Any]], Mesh]]]
    smallest_words: ClassVar[str]
    parts: ClassVar[tuple[str, ...]]
    of_revolution: ClassVar[bool]
    """Whether it is of revolution about z and has a mesh of its meridian."""
    alike: ClassVar[bool]
    """Whether all places (x, y) of its top are alike, so that a place and a misalignment say nothing."""
    smallest: float
    largest: float
    skin_limit: float
    """Thickness (mm) that a skin stays below."""
    fattest: float
    """Size (mm) of an indenter, with its errors, that its meshes take at most; ∞ where they take any."""

    def plain(self) -> dict[str, Any]:
        """Its table as it enters the key of a run, with all defaults written out."""

    def under(self, indenter: Any) -> Specimen:
        """Itself, if it has no end to some sides as far as it must be modelled for an indenter."""

    def actual(self, knobs: Any) -> Specimen:
        """Itself with the errors that knobs give it; ValueError naming knob, value and unit where nothing is left."""

    def absent(self) -> frozenset[str]:
        """Knobs of all specimens that say nothing of this one."""

    def planes(self) -> tuple[bool, bool]:
        """Whether it is symmetric about x = 0 and y = 0."""

    @property
    def described(self) -> str:
        """Itself with its sizes, as a noun phrase: a slab of thickness 2.3 mm."""

    def dimensions(self) -> Mapping[str, float]:
        """Own knobs that are an error of what its table states → what that states, in the knob's unit; 1 of a share."""

    def factors(self) -> Mapping[str, float]:
        """Own knobs whose declared ranges and gauges go with one of its lengths → that over the usual one."""

    @property
    def ratio(self) -> float:
        """Its size over the usual one, which other declared ranges are meant for."""

    def drawn(self, way: np.ndarray, wide: float) -> list[Drawn]:
        """Its section along the horizontal unit vector `way` (2,), to `wide` (mm) off the axis, with its sizes.

        The polygon `specimen` comes first, its points counterclockwise.
        """

    def beyond(self, length: float) -> float:
        """Share of the force that what is not modelled adds under an indenter, at a contact radius of its `length`."""

    # ------------------------------------------------------------------------------------------------- surface

    def above(self, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Point (3,) of the upper surface and outward unit normal (3,) at (x, y); ValueError beside the specimen."""

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """Whether points X (n, 3) of the surface belong to its part `upper` or `lower`."""

    def distance(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance (mm) of a point x (3,) outside, and its gradient (3,) in direction, of any length."""

    def closest(self, x: np.ndarray) -> np.ndarray:
        """Point (3,) of the surface closest to a point x (3,) outside."""

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) of points X (…, 3) to the surface, negative outside."""

    def project(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) near the surface moved onto it."""

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Whether nodes X (…, 3) lie on the surface, rather than inside or on a plane of symmetry alone."""

    def mean_curvature(self, x: float, y: float) -> float:
        """Mean curvature (1/mm) of the upper surface at (x, y)."""

    def volume(self) -> float:
        """Volume (mm³)."""

    @property
    def top(self) -> np.ndarray:
        """The highest point (3,)."""

    @property
    def lowest(self) -> np.ndarray:
        """The lowest point (3,)."""

    def hole(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Centre (3,) and semi-axes (3,) of its cavity, `size` times that of its table."""

    # -------------------------------------------------------------------------------------------- what is modelled

    def refusal(self, indenter: Any, point: tuple[float, float]) -> list[str]:
        """Why an indenter or the place (x, y) of a test is not modelled on it, in sentences."""

    def beside(self, x: float, y: float) -> str | None:
        """Why there is no mark at (x, y) to be followed: it lies beside the specimen; None where it is on top."""

    def thickness_along(self, direction: np.ndarray) -> float:
        """Its extent (mm) along a unit vector (3,), which no travel that way reaches; ∞ where it has no end."""

    def off_top(self, x: float, y: float) -> float:
        """Squared distance of (x, y) from the top over the size: elements are stretched on the way."""

    # ---------------------------------------------------------------------------------------------------- mesh

    def meshing(self, length: float, mesher: str, level: str, n: int, slip: float) -> Meshing:
        """How it is meshed for an indenter of a `length`."""

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """Quadratic mesh of itself, fine at `point`, of the part that planes of symmetry leave; raises BadMesh."""

    def meridian(self, actual: Any, spacing: Size, fineness: float, samples: int | None = ...) -> MeridianMesh:
        """Mesh of the meridian of `actual`, itself with errors of its sizes, by the grid of itself; raises BadMesh.

        `spacing` is that of the indenter, `fineness` multiplies all sizes;
        the grid is graded by sizes at so many `samples` of each interval.
        """

    def stiffness(self, X: np.ndarray) -> np.ndarray | None:
        """Factor (…) of its layers on all moduli at points X (…, 3); None where it has none."""

    @property
    def laws(self) -> tuple[OwnLaw | None, ...]:
        """Laws of its layers from the top down, None for that of the body; nothing where none has its own."""

    @property
    def ratios(self) -> tuple[float, ...]:
        """Stiffness of each layer over the rest, from the top down."""

    def layer(self, X: np.ndarray) -> np.ndarray:
        """Number (…) of the layer that points X (…, 3) lie in: 1, 2, … from the top, 0 is the rest."""

    # ------------------------------------------------------------------------------------------------- proposals

    def places(self) -> tuple[tuple[float, float], ...]:
        """Other places (x, y) at which one would test it."""

    def lines(self, point: tuple[float, float], beside: float, unit: float) -> dict[str, list[list[float]]]:
        """Rows of surface marks (x, y) by words, `beside` off the axis of a test at `point`, rounded in `unit`."""


class NotConvex(Protocol):
    """A specimen on which an indenter may touch first anywhere: it finds that itself, indenters ask it where they can.

    Newton's method on the distance, by which an indenter of a convex body goes to its first contact, passes a dent.
    """

    def first_contact(self, indenter: Any, through: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Reference point (3,) where the indenter first touches on its line: the least of `travel` over the surface."""

    def first_touched(self, indenter: Any, through: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the surface that it touches there."""


@runtime_checkable
class GradedInAdvance(Protocol):
    """A specimen whose mesh in space can be graded in advance for an indenter that goes deep."""

    def gathered(
        self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool], length: float
    ) -> MeshTet2:
        """As `quadratic`, gathered below an indenter of a `length` (mm), see `meshing.prestretched`; raises BadMesh."""


@runtime_checkable
class OfOnePlace(Protocol):
    """A specimen without a map that moves the fine elements: it has a mesh of its own for every place of a test."""

    def touched_at(self, point: tuple[float, float]) -> Specimen:
        """Itself, its mesh fine at the place (x, y) mm."""
