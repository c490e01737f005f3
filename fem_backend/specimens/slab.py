"""A slab that is wide beside its thickness and what presses on it: a gel in a dish, a layer on a stiff base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from pydantic import model_validator
from skfem import MeshTet2

from fem_backend import members
from fem_backend.meshing import BadMesh, Mesh
from fem_backend.specimens.flat import FlatTopped
from fem_backend.specimens.layers import LAYERED, Layers, canonical_layers, fitting, laws_of, thicknesses_and_ratios
from fem_backend.specimens.own_laws import OwnLaw
from fem_backend.specimens.specimen import MIN_SIZE_RATIO, SPECIMENS
from rso.contract import knob

USUAL_THICKNESS_MM = 5.0  # thickness (mm) that declared ranges of knobs are meant for
# thicknesses and lengths of the indenter from the axis that are modelled: see `Slab`
WIDTH_IN_THICKNESSES, WIDTH_IN_LENGTHS = 20.0, 8.0
SOLID_WIDTH_IN_THICKNESSES, SOLID_WIDTH_IN_LENGTHS = 4.0, 4.0  # the same of a model in three dimensions


@SPECIMENS.register
@dataclass(frozen=True)
class Slab(FlatTopped):
    """0 ≤ z ≤ thickness (mm), without end to the sides; all its places are alike.

    The model ends 20 thicknesses and 8 lengths of the indenter, `around` (mm), from the axis: on a bonded base what
    is beyond has no share (the field decays exponentially), on a sliding one a share of the square of the ratio.
    In a well it ends at the radius of that, `wide` (mm), and its places are no longer alike.
    """

    thickness: float
    layers: tuple[tuple[float, float], ...] = ()
    around: float = 0.0
    wide: float = 0.0
    laws: tuple[OwnLaw | None, ...] = ()
    met: tuple[bool, ...] = ()

    class Table(members.MemberTable):
        """{ shape = "slab", thickness = 2.3, layers = [{ thickness = 0.3, ratio = 5.0 }, …] }"""

        shape: Literal["slab"] = "slab"
        """A slab, wide beside its thickness and the indenter."""
        thickness: members.Length = USUAL_THICKNESS_MM
        """Thickness, mm."""
        layers: Layers = ()
        """Layers from the top down; the rest has ratio 1 and the law of the table material."""

        @model_validator(mode="after")
        def _fit(self) -> Slab.Table:
            fitting(self.layers, self.thickness, "specimen.thickness")
            return self

        def build(self) -> Slab:
            """The specimen of these settings."""
            return Slab(self.thickness, thicknesses_and_ratios(self.layers), laws=laws_of(self.layers))

    @dataclass(frozen=True)
    class Knobs:
        """Errors of its sizes."""

        delta_thickness: float = knob(
            "error of the thickness of the slab",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.4, 0.4),
            label="wrong thickness",
        )

    name: ClassVar[str] = "slab"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "slab",
            ("THICKNESS",),
            ("mm",),
            "a slab, wide beside its thickness, bonded to something stiff",
            settings=lambda t: {"specimen": {"shape": "slab", "thickness": t}},
        ),
        LAYERED,
    )
    gauges: ClassVar[Mapping[str, float]] = {"delta_thickness": 0.02, "delta_layer": 0.02}

    @property
    def alike(self) -> bool:  # type: ignore[override]
        """Whether it has no end to the sides."""
        return not self.walled

    @property
    def walled(self) -> bool:  # type: ignore[override]
        """Whether it ends at a wall."""
        return self.wide > 0.0

    @property
    def height(self) -> float:  # type: ignore[override]
        """The thickness (mm)."""
        return self.thickness

    @property
    def half_width(self) -> float:  # type: ignore[override]
        """How far the model reaches (mm)."""
        return self.wide or WIDTH_IN_THICKNESSES * self.thickness + self.around

    def under(self, indenter: Any) -> Slab:
        """Wide enough for an indenter."""
        return replace(self, around=WIDTH_IN_LENGTHS * indenter.length)

    def grid_planes(self) -> tuple[list[float], list[float], list[float]]:
        """Those of a square that reaches 4 thicknesses and 4 lengths of the indenter from its middle."""
        reach = [
            0.0,
            SOLID_WIDTH_IN_THICKNESSES * self.thickness + SOLID_WIDTH_IN_LENGTHS / WIDTH_IN_LENGTHS * self.around,
        ]
        return reach, reach, self.interfaces()

    def within(self, radius: float) -> Slab:
        """As wide as a well."""
        return replace(self, wide=radius)

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """As of every flat specimen; BadMesh in a well, which is round."""
        if self.walled:
            raise BadMesh("a slab in a well is modelled on its axis only; beside it take a cylinder as wide")
        return super().quadratic(mesh, recipe, point, planes)

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        layers = canonical_layers(self.layers, self.laws)
        return {"shape": self.name, "thickness": self.thickness, "layers": layers}

    def actual(self, knobs: Any) -> Slab:
        """The slab with the error of its thickness, layers in proportion; ValueError where hardly any is left."""
        thickness = self.thickness + knobs.delta_thickness
        if thickness <= MIN_SIZE_RATIO * self.thickness:
            raise ValueError(
                f"delta_thickness = {knobs.delta_thickness:g} mm: a slab of {thickness:g} mm, must be thicker than "
                f"{MIN_SIZE_RATIO * self.thickness:g} mm ({MIN_SIZE_RATIO:g} of that asked for)"
            )
        return replace(
            self, thickness=thickness, layers=self.changed(knobs, thickness / self.thickness), met=self.unlike
        )

    @property
    def described(self) -> str:
        """Its thickness and layers."""
        return f"a slab of thickness {members.length_words(self.thickness)}{self.layers_described}"

    def dimensions(self) -> Mapping[str, float]:
        """Its thickness, and its layer."""
        return {"delta_thickness": self.thickness, **self.uppermost()}

    def factors(self) -> Mapping[str, float]:
        """The error goes with the thickness."""
        return {"delta_thickness": self.ratio, **self.upper()}

    @property
    def ratio(self) -> float:
        """The thickness over the usual one."""
        return self.thickness / USUAL_THICKNESS_MM
