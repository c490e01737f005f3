"""A block: a box with a flat top, its sides free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from fem_backend import members
from fem_backend.meshing import BadMesh, MeridianMesh, Size
from fem_backend.specimens.flat import ON_PLANE_TOLERANCE, FlatTopped
from fem_backend.specimens.layers import LAYERED, Layers, canonical_layers, fitting, laws_of, thicknesses_and_ratios
from fem_backend.specimens.own_laws import OwnLaw
from fem_backend.specimens.specimen import MIN_SIZE_RATIO, SPECIMENS
from rso.contract import knob

USUAL_SIZES_MM = (20.0, 20.0, 5.0)  # sizes (mm) that declared ranges of knobs are meant for
AXIS_NAMES = "x", "y", "z"  # of the three sizes


@SPECIMENS.register
@dataclass(frozen=True)
class Cuboid(FlatTopped):
    """|x| ≤ lx/2, |y| ≤ ly/2, 0 ≤ z ≤ lz (mm)."""

    lx: float
    ly: float
    lz: float
    layers: tuple[tuple[float, float], ...] = ()
    laws: tuple[OwnLaw | None, ...] = ()
    met: tuple[bool, ...] = ()

    class Table(members.MemberTable):
        """{ shape = "block", size = [20, 20, 5], layers = [{ thickness, ratio }, …] }"""

        shape: Literal["block"] = "block"
        """A block with a flat top and four sides."""
        size: members.Three = USUAL_SIZES_MM
        """Lengths along x, y and z, mm."""
        layers: Layers = ()
        """Layers from the top down; the rest has ratio 1 and the law of the table material."""

        @model_validator(mode="after")
        def _fit(self) -> Cuboid.Table:
            fitting(self.layers, self.size[2], "specimen.size[2]")
            return self

        def build(self) -> Cuboid:
            """The specimen of these settings."""
            return Cuboid(*self.size, thicknesses_and_ratios(self.layers), laws=laws_of(self.layers))

    @dataclass(frozen=True)
    class Knobs:
        """Errors of its sizes."""

        delta_lx: float = knob(
            "error of the length of the block along x",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.5, 0.5),
            label="wrong length along x",
        )
        delta_ly: float = knob(
            "error of the length of the block along y",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.5, 0.5),
            label="wrong length along y",
        )
        delta_lz: float = knob(
            "error of the height of the block",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.4, 0.4),
            label="wrong height of the block",
        )

    name: ClassVar[str] = "block"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "block",
            ("LX", "LY", "LZ"),
            ("mm", "mm", "mm"),
            "a block by its lengths along x, y and upwards, bonded to something stiff",
            settings=lambda x, y, z: {"specimen": {"shape": "block", "size": [x, y, z]}},
        ),
        LAYERED,
    )
    smallest_words: ClassVar[str] = "height or half the width"
    of_revolution: ClassVar[bool] = False
    gauges: ClassVar[Mapping[str, float]] = {"delta_lx": 0.02, "delta_ly": 0.02, "delta_lz": 0.02, "delta_layer": 0.02}

    @property
    def height(self) -> float:  # type: ignore[override]
        """The length along z (mm)."""
        return self.lz

    @property
    def half_width(self) -> float:  # type: ignore[override]
        """The distance from the axis to the nearest side (mm)."""
        return 0.5 * min(self.lx, self.ly)

    @property
    def largest(self) -> float:
        """Half the diagonal of the top or the height (mm), whichever is more."""
        return max(0.5 * float(np.hypot(self.lx, self.ly)), self.lz)

    @property
    def described(self) -> str:
        """Its lengths and layers."""
        x, y, z = map(members.length_words, (self.lx, self.ly, self.lz))
        return f"a block of {x} by {y}, {z} high{self.layers_described}"

    def extent(self, way: np.ndarray) -> float:
        """Half the length along x or y, or to the nearer side between these."""
        with np.errstate(divide="ignore"):
            return float((self.half / np.abs(way)).min())

    @property
    def half(self) -> np.ndarray:
        """Half the lengths along x and y, (2,) mm."""
        return 0.5 * np.array([self.lx, self.ly])

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        layers = canonical_layers(self.layers, self.laws)
        return {"shape": self.name, "size": [self.lx, self.ly, self.lz], "layers": layers}

    def actual(self, knobs: Any) -> Cuboid:
        """The block with the errors of its sizes, layers in proportion; ValueError where hardly anything is left."""
        was = np.array([self.lx, self.ly, self.lz])
        now = was + [getattr(knobs, f"delta_l{a}") for a in AXIS_NAMES]
        for a, one, old in zip(AXIS_NAMES, now, was, strict=True):
            if one <= MIN_SIZE_RATIO * old:
                raise ValueError(
                    f"delta_l{a} = {getattr(knobs, f'delta_l{a}'):g} mm: a block of {one:g} mm along {a}, must be "
                    f"larger than {MIN_SIZE_RATIO * old:g} mm ({MIN_SIZE_RATIO:g} of that asked for)"
                )
        k = now[2] / was[2]
        return replace(
            self, lx=float(now[0]), ly=float(now[1]), lz=float(now[2]), layers=self.changed(knobs, k), met=self.unlike
        )

    def dimensions(self) -> Mapping[str, float]:
        """Its sizes, and its layer."""
        return {
            **{f"delta_l{a}": v for a, v in zip(AXIS_NAMES, (self.lx, self.ly, self.lz), strict=True)},
            **self.uppermost(),
        }

    def factors(self) -> Mapping[str, float]:
        """Each error goes with its size."""
        sizes = zip(AXIS_NAMES, (self.lx, self.ly, self.lz), USUAL_SIZES_MM, strict=True)
        return {**{f"delta_l{a}": v / u for a, v, u in sizes}, **self.upper()}

    @property
    def ratio(self) -> float:
        """Cube root of the volume over the usual one."""
        return float((self.volume() / np.prod(USUAL_SIZES_MM)) ** (1.0 / 3.0))

    # ------------------------------------------------------------------------------------------------- surface

    def over_edge(self, x: float, y: float) -> float:
        """How far (mm) a place lies beyond the nearest edge of the top, negative on it."""
        return float((np.abs([x, y]) - self.half).max())

    def closest(self, x: np.ndarray) -> np.ndarray:
        """Nearest point of the box."""
        return np.clip(np.asarray(x, float), [*-self.half, 0.0], [*self.half, self.lz])

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) to the top or a side; the base is no skin."""
        X = np.asarray(X, float)
        return np.minimum(self.lz - X[..., 2], (self.half - np.abs(X[..., :2])).min(-1))

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Nodes of the top or a side."""
        return np.abs(self.depth(X)) < ON_PLANE_TOLERANCE * self.lz

    def volume(self) -> float:
        """lx ly lz."""
        return self.lx * self.ly * self.lz

    # ------------------------------------------------------------------------------------------------- mesh

    def grid_planes(self) -> tuple[list[float], list[float], list[float]]:
        """Middle and sides, base, interfaces and top."""
        return [0.0, 0.5 * self.lx], [0.0, 0.5 * self.ly], self.interfaces()

    def meridian(self, actual: FlatTopped, spacing: Size, fineness: float, samples: int | None = None) -> MeridianMesh:
        """None is made."""
        raise BadMesh("a block is not of revolution")
