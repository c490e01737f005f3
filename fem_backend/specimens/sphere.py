"""A solid sphere: an ellipsoid of one radius, touched on its axis a body of revolution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.meshing import MeridianMesh, Size, graded_coordinates, halved, triangulated
from fem_backend.specimens.ellipsoidal import Ellipsoidal
from fem_backend.specimens.flat import DEPTH_ELEMENT_GROWTH, MERIDIAN_SIZE_FACTORS
from fem_backend.specimens.specimen import MIN_SIZE_RATIO, SPECIMENS, Meshing
from rso.contract import knob

USUAL_SPHERE_RADIUS_MM = 35.0  # radius (mm) that declared ranges of knobs are meant for
MIN_ELEMENTS_ACROSS_RADIUS = 6.0  # elements from the centre to the surface at least, at unit fineness


@SPECIMENS.register
@dataclass(frozen=True)
class SolidSphere(Ellipsoidal):
    """x² + y² + z² ≤ radius² (mm), its origin at the centre."""

    class Table(members.MemberTable):
        """{ shape = "sphere", radius = 35 }"""

        shape: Literal["sphere"] = "sphere"
        """A solid sphere, its origin at the centre."""
        radius: members.Length = USUAL_SPHERE_RADIUS_MM
        """Radius, mm."""

        def build(self) -> SolidSphere:
            """The specimen of these settings."""
            return SolidSphere(self.radius, self.radius, self.radius, (self.radius / 4.0,) * 3)

    @dataclass(frozen=True)
    class Knobs:
        """The error of its radius."""

        delta_sphere: float = knob(
            "error of the radius of the specimen",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=1.0,
            plausible=(-3.0, 3.0),
            label="wrong radius of the specimen",
        )

    name: ClassVar[str] = "sphere"
    gauges: ClassVar[Mapping[str, float]] = {"delta_sphere": 0.1}
    smallest_words: ClassVar[str] = "radius"
    of_revolution: ClassVar[bool] = True
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "sphere",
            ("RADIUS",),
            ("mm",),
            "a solid sphere as the specimen",
            settings=lambda r: {"specimen": {"shape": "sphere", "radius": r}},
        ),
    )

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name, "radius": self.a}

    def actual(self, knobs: Any) -> SolidSphere:
        """The sphere with the error of its radius; ValueError where hardly any is left."""
        radius = self.a + knobs.delta_sphere
        if radius <= MIN_SIZE_RATIO * self.a:
            raise ValueError(
                f"delta_sphere = {knobs.delta_sphere:g} mm: a sphere of {radius:g} mm, must be larger than "
                f"{MIN_SIZE_RATIO * self.a:g} mm ({MIN_SIZE_RATIO:g} of that asked for)"
            )
        return replace(self, a=radius, b=radius, c=radius)

    def dimensions(self) -> Mapping[str, float]:
        """Its radius."""
        return {"delta_sphere": self.a}

    def factors(self) -> Mapping[str, float]:
        """The error goes with the radius."""
        return {"delta_sphere": self.a / USUAL_SPHERE_RADIUS_MM}

    @property
    def ratio(self) -> float:
        """The radius over the usual one."""
        return self.a / USUAL_SPHERE_RADIUS_MM

    def meshing(self, length: float, mesher: str, level: str, n: int, slip: float) -> Meshing:
        """Those of an ellipsoid in space; of its meridian the level gives the fineness."""
        return replace(super().meshing(length, mesher, level, n, slip), fineness=MERIDIAN_SIZE_FACTORS.get(level, 1.0))

    def meridian(self, actual: Ellipsoidal, spacing: Size, fineness: float, samples: int | None = None) -> MeridianMesh:
        """A graded grid of the half square |z| ≤ r ≤ 1, mapped to the half disc; its rim z = 0 is a row of nodes."""
        R = self.a
        near = float(spacing(np.linspace(0.0, R, 2001)).min())
        largest = R / MIN_ELEMENTS_ACROSS_RADIUS

        def across(x: np.ndarray) -> np.ndarray:  # π/4 of the way along the arc
            return fineness * np.minimum(spacing(0.25 * np.pi * x), largest) * 4.0 / np.pi

        def down(z: np.ndarray) -> np.ndarray:
            return fineness * np.minimum(near + DEPTH_ELEMENT_GROWTH * (R - z), largest)

        r, z = graded_coordinates(across, (0.0, R), samples), graded_coordinates(down, (-R, 0.0, R), samples)
        return triangulated(r, z, lambda points: halved(points / R) * actual.a)
