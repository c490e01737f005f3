"""What solid ellipsoids and spheres share, touched from above, with a cavity below if there is one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from skfem import MeshTet2

from fem_backend import closed_forms, geometry, members, meshing
from fem_backend.meshing import Mesh
from fem_backend.specimens.in_space import MAX_SIZE_TO_INDENTER, PROPOSED_PLACE_SHARE, InSpace
from fem_backend.specimens.specimen import Meshing
from rso.contract import Drawn

MAX_INDENTER_SIZE_SHARE = 0.6  # size of the indenter with its errors, over the smallest semi-axis
MAX_SEEN_OFF_TOP = 0.8  # squared distance from the top in semi-axes within which a camera from above sees a mark


@dataclass(frozen=True)
class Ellipsoidal(geometry.EllipsoidShape, InSpace):
    """(x/a)² + (y/b)² + (z/c)² ≤ 1 with the semi-axes a, b, c and those of a cavity around its lowest point (mm)."""

    cavity: tuple[float, float, float] = (15.0, 10.0, 10.0)

    makers: ClassVar[Mapping[str, Callable[[Mapping[str, Any]], Mesh]]] = {}  # those of `meshing.recipes`
    smallest_words: ClassVar[str] = "smallest semi-axis"
    rests: ClassVar[str] = "fixed"

    @property
    def fattest(self) -> float:
        """0.6 of the smallest semi-axis (mm): settings say 0.5, errors may exceed it."""
        return MAX_INDENTER_SIZE_SHARE * self.smallest

    @property
    def described(self) -> str:
        """Its semi-axes."""
        a, b, c = map(members.length_words, (self.a, self.b, self.c))
        return f"a sphere of radius {a}" if a == b == c else f"an ellipsoid with semi-axes {a}, {b} and {c}"

    def drawn(self, way: np.ndarray, wide: float) -> list[Drawn]:
        """An ellipse and its semi-axes."""
        across = float(1.0 / np.linalg.norm(way / self.semi_axes[:2]))
        turn = np.linspace(-0.5 * np.pi, 1.5 * np.pi, 121)
        ellipse = tuple(zip(*(v.tolist() for v in (across * np.cos(turn), self.c * np.sin(turn))), strict=True))
        return [
            Drawn("specimen", ellipse, self.described),
            Drawn("edge", ellipse),
            Drawn("dimension", ((0.0, 0.0), (across, 0.0)), members.length_words(across)),
            Drawn("dimension", ((0.0, -self.c), (0.0, 0.0)), members.length_words(self.c)),
        ]

    def planes(self) -> tuple[bool, bool]:
        """All three planes of its axes are planes of symmetry."""
        return True, True

    def mean_curvature(self, x: float, y: float) -> float:
        """H (1/mm) of the upper surface at (x, y) mm."""
        s = self.semi_axes
        z = s[2] * np.sqrt(1.0 - (x / s[0]) ** 2 - (y / s[1]) ** 2)
        return float(closed_forms.ellipsoid_mean_curvature(s, np.array([x, y, z])))

    @property
    def lowest(self) -> np.ndarray:
        """The pole (0, 0, −c)."""
        return np.array([0.0, 0.0, -self.c])

    def hole(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Centre (3,) and semi-axes (3,) of the cavity in mm: around the lowest point."""
        return self.lowest, np.multiply(size, self.cavity)

    def refusal(self, indenter: Any, point: tuple[float, float]) -> list[str]:
        """Indenters of 1/70 of the largest to half the smallest semi-axis are meshed, to 0.8 semi-axes off the top.

        Its meshes are fine in proportion to the indenter's length, of which `size` may be a share.
        """
        out, (key, size) = [], indenter.size
        least = self.largest / MAX_SIZE_TO_INDENTER * size / indenter.length
        if size > 0.5 * self.smallest:
            out.append(
                f"indenter.{key} = {size} mm: this specimen is meshed for indenters much smaller than it, at most "
                f"{0.5 * self.smallest:g} mm (half of its {self.smallest_words})"
            )
        if size < least:
            out.append(
                f"indenter.{key} = {size} mm: no mesh is made for so small a {indenter.noun} on this specimen. At "
                f"least {least:.3g} mm is needed (1/{self.largest / least:.3g} of its largest semi-axis); a smaller "
                "specimen is the same half-space"
            )
        if math.hypot(point[0] / self.a, point[1] / self.b) > meshing.MAX_SHARE_FROM_TOP:
            out.append(
                f"point = {list(point)} mm: "
                f"off the top by at most {meshing.MAX_SHARE_FROM_TOP:g} of the semi-axes is modelled"
            )
        return out

    def beside(self, x: float, y: float) -> str | None:
        """A mark lies within the outline from above."""
        if math.hypot(x / self.a, y / self.b) <= 1.0:
            return None
        return (
            f"profile: the mark ({x:g}, {y:g}) mm lies beside the specimen, whose semi-axes are "
            f"{self.a:g} and {self.b:g} mm"
        )

    def thickness_along(self, direction: np.ndarray) -> float:
        """2 |(a d_x, b d_y, c d_z)| mm, between the two planes that touch it across a unit vector d."""
        return 2.0 * float(np.linalg.norm(self.semi_axes * direction))

    def off_top(self, x: float, y: float) -> float:
        """(x/a)² + (y/b)²."""
        return (x / self.a) ** 2 + (y / self.b) ** 2

    def meshing(self, length: float, mesher: str, level: str, n: int, slip: float) -> Meshing:
        """The mapped mesh, a shipped one where one fits, else one that similar specimens of all sizes share."""
        if mesher == "mapped":
            h0 = 0.5 * math.pi * self.c / n * (1.0 - slip) / (1.0 + slip)
            own = (("mesher", mesher), ("n", n), ("slip", slip))
            return Meshing(meshing.mapped_recipe(self, n, slip), own, float(h0), "")
        made = (
            "reference" if level == meshing.LIMIT_LEVEL else level
        )  # its forces are extrapolated from that and a coarse one
        h0 = meshing.ALL_TEMPLATE_SIZINGS[made].h0 * (length / meshing.TEMPLATE_RADIUS_MM)
        used = (("mesher", mesher), ("level", level))
        if meshing.template_fits(self, length):
            return Meshing(meshing.template_recipe(made, self), used, h0, level)
        if level == meshing.LIMIT_LEVEL:
            raise ValueError(f"mesh.level = {level!r}: only for specimens and indenters that the shipped meshes fit")
        # similar specimens share one mesh, made for the size that levels are tuned for: the mesher knows millimetres
        axes = self.semi_axes * (meshing.TEMPLATE_RADIUS_MM / length)
        similar = geometry.EllipsoidShape(*(float(f"{v:.12g}") for v in axes))
        sizing = replace(meshing.ALL_TEMPLATE_SIZINGS[made], hmax=1.15 * similar.smallest)
        return Meshing(meshing.tetwild_recipe(similar, sizing), used, h0, level)

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """The quarter mesh of a recipe moved, scaled and mirrored to this body; raises BadMesh."""
        upright = meshing.mesher(recipe) == "tetwild"  # the shipped meshes' answers were calibrated leaning
        return meshing.assemble(mesh, meshing.nominal_body(recipe), self, point, planes, upright)

    def gathered(
        self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool], length: float
    ) -> MeshTet2:
        """The same with its nodes gathered below an indenter of a length (mm), as it is where that spoils elements."""
        own, upright = meshing.nominal_body(recipe), meshing.mesher(recipe) == "tetwild"
        try:
            return meshing.assemble(mesh, own, self, point, planes, upright, deep=length * own.c / self.c)
        except meshing.BadMesh:
            return self.quadratic(mesh, recipe, point, planes)

    def places(self) -> tuple[tuple[float, float], ...]:
        """A third of the way down both axes."""
        x, y = (float(f"{PROPOSED_PLACE_SHARE * v:.3g}") for v in (self.a, self.b))
        return (x, 0.0), (0.0, y)

    def lines(self, point: tuple[float, float], beside: float, unit: float) -> dict[str, list[list[float]]]:
        """Thirteen marks over the length and the width of the body, of which those are left that a camera sees."""
        (x, y), share = point, np.linspace(-0.5, 0.5, 13)

        def mark(*at: float) -> list[float]:
            return [float(f"{unit * round(float(v) / unit, 2):.12g}") for v in at]

        rows = {
            "surface marks along x": [mark(x + s * self.a, y + beside) for s in share],
            "surface marks along y": [mark(x + beside, y + s * self.b) for s in share],
        }
        return {words: [m for m in row if self.off_top(m[0], m[1]) < MAX_SEEN_OFF_TOP] for words, row in rows.items()}
