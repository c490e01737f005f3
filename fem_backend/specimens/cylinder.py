"""A puck: an upright cylinder with a rounded upper edge."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator
from skfem import MeshTet2

from fem_backend import members
from fem_backend.meshing import Mesh, grids, halved
from fem_backend.specimens.flat import ON_PLANE_TOLERANCE, FlatTopped
from fem_backend.specimens.layers import LAYERED, Layers, canonical_layers, fitting, laws_of, thicknesses_and_ratios
from fem_backend.specimens.own_laws import OwnLaw
from fem_backend.specimens.specimen import MIN_SIZE_RATIO, SPECIMENS
from rso.contract import knob

USUAL_RADIUS_HEIGHT_MM = (10.0, 5.0)  # radius and height (mm) that declared ranges of knobs are meant for


@SPECIMENS.register
@dataclass(frozen=True)
class Cylinder(FlatTopped):
    """x² + y² ≤ radius², 0 ≤ z ≤ height (mm), its upper edge rounded by `fillet` (mm)."""

    radius: float
    tall: float
    fillet: float = 0.0
    layers: tuple[tuple[float, float], ...] = ()
    walled: bool = False
    laws: tuple[OwnLaw | None, ...] = ()
    met: tuple[bool, ...] = ()

    class Table(members.MemberTable):
        """{ shape = "cylinder", radius = 10, height = 5, fillet = 0, layers = [{ thickness, ratio }, …] }"""

        shape: Literal["cylinder"] = "cylinder"
        """An upright cylinder, a puck."""
        radius: members.Length = USUAL_RADIUS_HEIGHT_MM[0]
        """Radius, mm."""
        height: members.Length = USUAL_RADIUS_HEIGHT_MM[1]
        """Height, mm."""
        fillet: Annotated[
            float,
            BeforeValidator(members.at_least(0.0, "the radius of the upper edge, at least 0")),
            members.read_in("mm"),
        ] = 0.0
        """Radius of the rounded upper edge, mm."""
        layers: Layers = ()
        """Layers from the top down; the rest has ratio 1 and the law of the table material."""

        @model_validator(mode="after")
        def _fit(self) -> Cylinder.Table:
            fitting(self.layers, self.height, "specimen.height")
            if self.fillet >= 0.5 * min(self.radius, self.height):
                raise members.refused(" mm: less than half of the radius and of the height", "fillet", self.fillet)
            return self

        def build(self) -> Cylinder:
            """The specimen of these settings."""
            return Cylinder(
                self.radius, self.height, self.fillet, thicknesses_and_ratios(self.layers), laws=laws_of(self.layers)
            )

    @dataclass(frozen=True)
    class Knobs:
        """Errors of its sizes."""

        delta_radius: float = knob(
            "error of the radius of the cylinder",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.5, 0.5),
            label="wrong radius of the specimen",
        )
        delta_height: float = knob(
            "error of the height of the cylinder",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.4, 0.4),
            label="wrong height",
        )

    name: ClassVar[str] = "cylinder"
    smallest_words: ClassVar[str] = "height"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "puck",
            ("RADIUS", "HEIGHT"),
            ("mm", "mm"),
            "an upright cylinder, bonded to something stiff",
            settings=lambda r, h: {"specimen": {"shape": "cylinder", "radius": r, "height": h}},
        ),
        LAYERED,
    )
    gauges: ClassVar[Mapping[str, float]] = {"delta_radius": 0.02, "delta_height": 0.02, "delta_layer": 0.02}

    @property
    def height(self) -> float:  # type: ignore[override]
        """The height (mm)."""
        return self.tall

    @property
    def half_width(self) -> float:  # type: ignore[override]
        """The radius (mm)."""
        return self.radius

    @property
    def edge(self) -> float:  # type: ignore[override]
        """The radius of the upper edge (mm)."""
        return self.fillet

    def within(self, radius: float) -> Cylinder:
        """Its grid is finer at a wall."""
        return replace(self, walled=True)

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        layers = canonical_layers(self.layers, self.laws)
        sizes = {"radius": self.radius, "height": self.tall, "fillet": self.fillet}
        return {"shape": self.name, **sizes, "layers": layers}

    def actual(self, knobs: Any) -> Cylinder:
        """The cylinder with the errors of its sizes, layers and edge in proportion."""
        radius, tall = self.radius + knobs.delta_radius, self.tall + knobs.delta_height
        for name, now, was in (("delta_radius", radius, self.radius), ("delta_height", tall, self.tall)):
            if now <= MIN_SIZE_RATIO * was:
                raise ValueError(
                    f"{name} = {getattr(knobs, name):g} mm: a cylinder of {now:g} mm, must be larger than "
                    f"{MIN_SIZE_RATIO * was:g} mm ({MIN_SIZE_RATIO:g} of that asked for)"
                )
        k = tall / self.tall
        fillet = self.fillet * min(k, radius / self.radius)
        return replace(self, radius=radius, tall=tall, fillet=fillet, layers=self.changed(knobs, k), met=self.unlike)

    @property
    def described(self) -> str:
        """Its sizes and layers."""
        radius, height = members.length_words(self.radius), members.length_words(self.tall)
        return f"a cylinder of radius {radius} and height {height}{self.layers_described}"

    def dimensions(self) -> Mapping[str, float]:
        """Radius and height, and its layer."""
        return {"delta_radius": self.radius, "delta_height": self.tall, **self.uppermost()}

    def factors(self) -> Mapping[str, float]:
        """Each error goes with its size."""
        own = {
            "delta_radius": self.radius / USUAL_RADIUS_HEIGHT_MM[0],
            "delta_height": self.tall / USUAL_RADIUS_HEIGHT_MM[1],
        }
        return {**own, **self.upper()}

    @property
    def ratio(self) -> float:
        """Cube root of the volume over the usual one."""
        return ((self.radius / USUAL_RADIUS_HEIGHT_MM[0]) ** 2 * self.tall / USUAL_RADIUS_HEIGHT_MM[1]) ** (1.0 / 3.0)

    def rings(self) -> list[float]:
        """Axis, where the rounding begins, side."""
        return [0.0, *([self.radius - self.fillet] if self.fillet else []), self.radius]

    def interfaces(self) -> list[float]:
        """Those of the layers, and where the rounding begins."""
        return sorted({*self.planes_of_layers(), self.tall - self.fillet})

    @property
    def grid_edges(self) -> str:  # type: ignore[override]
        """The map to a disc makes one face of the sides, and the rounded edge of side and top."""
        return "all" if self.fillet else "upright"

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """The grid of a recipe on a disc, turned so that the point lies on one of its axes; raises BadMesh.

        The rounded edge has the curvature of quadratic elements, one of them across it at least.
        """
        turn = 0.0 if any(planes) else math.atan2(point[1], point[0])
        at = point if any(planes) else (math.hypot(*point), 0.0)
        beyond = (self.radius - self.fillet) * (1.0 - ON_PLANE_TOLERANCE)
        made = grids.on_grid(mesh, recipe, self.grid_planes(), at, planes, self.on_disc, beyond)
        if turn == 0.0:
            return made
        c, s = math.cos(turn), math.sin(turn)
        x, y, z = made.doflocs
        return MeshTet2(np.stack([c * x - s * y, s * x + c * y, z]), made.t)

    def on_disc(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the box of the grid, moved into the body."""
        x, y, z = grids.disc(points, self.radius - self.fillet).T
        r = np.hypot(x, y)
        wide, up = self.rounded(np.column_stack([r, z])).T
        k = wide / np.where(r > 0.0, r, 1.0)
        return np.column_stack([k * x, k * y, up])

    def rounded(self, points: np.ndarray) -> np.ndarray:
        """The square of the corner becomes the quarter of a disc."""
        f = self.fillet
        if not f:
            return points
        r0, z0 = self.radius - f, self.tall - f
        a, b = (points[:, 0] - r0) / f, (points[:, 1] - z0) / f
        corner = (a > 0.0) & (b > 0.0)
        out = points.copy()
        out[corner] = [r0, z0] + f * halved(np.column_stack([a[corner], b[corner]]))
        return out
