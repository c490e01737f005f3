"""A body within a scanned surface, an organ say: held in a region, touched anywhere from above."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, model_validator
from skfem import MeshTet2

from fem_backend import members, meshing
from fem_backend.meshing import Mesh, scans
from fem_backend.specimens.in_space import HALF_SIZE_TO_CAVITY, MAX_SIZE_TO_INDENTER, PROPOSED_PLACE_SHARE, InSpace
from fem_backend.specimens.specimen import SPECIMENS, Meshing
from rso.contract import Drawn, knob

SURFACE_UNITS_MM = {"nm": 1e-6, "um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}  # mm
USUAL_HALF_EXTENTS_MM = (60.0, 35.0, 35.0)  # half extents (mm) of the body that declared ranges of knobs are meant for
MIN_UPWARD_NORMAL = 0.2  # upward part of the normal: the indenter glides off steeper places
# of half the smallest extent: so near to a second surface a scan is held where nobody says otherwise
HELD_WITHIN_SHARE = 0.01
ON_SURFACE_TOLERANCE = 1e-6  # of the size: nodes this near lie on the surface
# points along a facet, facets looked at closely, halvings of the grid there
N_GRID_ALONG_FACET, N_CANDIDATE_FACETS, N_GRID_HALVINGS = 8, 8, 40


class HeldTable(members.MemberTable):
    """held: the region of the surface that a support holds, by one of a height, a box or a second surface."""

    below: Annotated[float, BeforeValidator(members.finite_number), members.read_in("mm")] | None = None
    """All of the surface up to this z, mm."""
    box: Annotated[Any, BeforeValidator(lambda v: _box(v))] | None = None
    """[[x0, y0, z0], [x1, y1, z1]], mm: all of the surface inside of it."""
    file: str | None = None
    """A second closed surface (STL, PLY or OBJ, of the same unit): all that is inside of it or near."""
    within: members.Length | None = None
    """With a second surface: how near, mm."""
    sha256: str | None = None
    """Hash of the second surface, which the backend writes: a file that has changed is refused."""

    @model_validator(mode="before")
    @classmethod
    def _one(cls, value: Any) -> Any:
        ways = ("below", "box", "file")
        if not isinstance(value, Mapping) or sum(value.get(k) is not None for k in ways) != 1:
            raise members.refused(f": a table with one of {', '.join(ways)} is expected")
        for key in value:
            if key not in cls.model_fields:
                raise members.refused(
                    f": unknown; {members.nearest_choices(key, list(cls.model_fields))}", key, value[key]
                )
        if "file" not in value and value.get("within") is not None:
            raise members.refused(": only a second surface, file, has it", "within", value["within"])
        return value


def _box(value: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise members.refused(": [[x0, y0, z0], [x1, y1, z1]] in mm is expected")
    low, high = (members.numbers(3)(v) for v in value)
    if any(a >= b for a, b in zip(low, high, strict=True)):
        raise members.refused(" mm: each of the first corner must be less than that of the second")
    return low, high


@SPECIMENS.register
@dataclass(frozen=True)
class Surface(InSpace):
    """The body inside a closed triangulated surface, in the frame of its file, z up.

    What counts is the smooth surface that the facets stand for (:mod:`fem_backend.meshing.smooth_surface`).  `sha256`
    is the hash of the numbers in mm: where the file lies is not what the body is.  `held` is the region of the part
    `lower`; `place` that of the test, about which the mesh is fine; `size` multiplies all lengths about the middle.
    """

    sha256: str
    held: tuple[tuple[str, Any], ...]
    file: str = field(compare=False)
    unit: str = "mm"
    place: tuple[float, float] = (0.0, 0.0)
    size: float = 1.0

    class Table(members.MemberTable):
        """{ shape = "surface", file = "kidney.stl", unit = "mm", held = { below = -5.0 } }"""

        shape: Literal["surface"]
        """The body inside a closed surface, in the frame of its file, z up."""
        file: str
        """STL, PLY or OBJ; a relative path is that from the study file."""
        unit: Annotated[str, BeforeValidator(members.one_of(SURFACE_UNITS_MM))]
        """Unit of the file's numbers: nm | um | mm | cm | m | in."""
        held: HeldTable | None = None
        """What a support holds, mm; the lower half where it says nothing."""
        sha256: str | None = None
        """Hash of the surface, which the backend writes: a file that has changed is refused."""

        @model_validator(mode="after")
        def _readable(self) -> Surface.Table:
            """Both files hold what is asked for; the region holds some of the surface and not all."""
            body = _read("file", self.file, SURFACE_UNITS_MM[self.unit], self.sha256)
            if self.held is not None and self.held.file is not None:
                _read("held.file", self.held.file, SURFACE_UNITS_MM[self.unit], self.held.sha256)
            below = scans.held_level(_region(self, body), body.vertices) <= 0.0
            if below.all() or not below.any():
                z = f"z from {body.low[2]:.4g} to {body.high[2]:.4g} mm"
                words = "all" if below.all() else "nothing"
                given = None if self.held is None else self.held.model_dump(exclude_none=True)
                raise members.refused(f": holds {words} of the surface ({z})", "held", given)
            return self

        def build(self) -> Surface:
            """The specimen of these settings."""
            body = scans.scan(_path(self.file), SURFACE_UNITS_MM[self.unit])
            return Surface(body.sha256, tuple(_region(self, body).items()), _path(self.file), self.unit)

    @dataclass(frozen=True)
    class Knobs:
        """The error of its size."""

        delta_scan: float = knob(
            "error of the size of the scanned surface, as a share",
            "1",
            -0.5,
            1.0,
            neutral=0.0,
            typical=0.02,
            plausible=(-0.05, 0.05),
            label="wrong size of the scan",
        )

    name: ClassVar[str] = "surface"
    rests: ClassVar[str] = "fixed"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "surface",
            ("FILE", "[UNIT]"),
            ("file", "text"),
            "a body inside a closed surface, STL, PLY or OBJ, and the unit of its numbers",
            least=1,
            settings=lambda file, unit="mm": {"specimen": {"shape": "surface", "file": file, "unit": unit}},
            guess="the unit of its numbers; held = { below = … } says which region is held, else the lower half",
        ),
    )
    gauges: ClassVar[Mapping[str, float]] = {"delta_scan": 0.002}
    makers: ClassVar[Mapping[str, Callable[[Mapping[str, Any]], Mesh]]] = {scans.SCAN_MESHER: scans.make_scan_mesh}
    smallest_words: ClassVar[str] = "half the smallest extent"

    @property
    def scan(self) -> scans.Scan:
        """The surface with its smooth surface; ValueError where the file has changed since."""
        found = scans.scan(self.file, SURFACE_UNITS_MM[self.unit])
        if found.sha256 != self.sha256:
            raise ValueError(f"specimen.file = {self.file!r}: has changed since the run was set up")
        return found

    @property
    def region(self) -> dict[str, Any]:
        """The held region as :func:`.scans.held_level` takes it."""
        return dict(self.held)

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings; `file` beside `sha256` is no part of a key."""
        region = {k: v for k, v in self.held if k != "scale"}
        if "box" in region:
            region["box"] = [list(v) for v in region["box"]]
        return {"shape": self.name, "file": self.file, "unit": self.unit, "held": region, "sha256": self.sha256}

    def actual(self, knobs: Any) -> Surface:
        """The body with the error of its size."""
        return replace(self, size=1.0 + knobs.delta_scan)

    def planes(self) -> tuple[bool, bool]:
        """No scan is symmetric."""
        return False, False

    def dimensions(self) -> Mapping[str, float]:
        """The scale of the scan."""
        return {"delta_scan": 1.0}

    def factors(self) -> Mapping[str, float]:
        """The error of the size is a share."""
        return {}

    @property
    def ratio(self) -> float:
        """Cube root of the product of the extents over that of the usual ones."""
        return float(np.prod(self.half / np.array(USUAL_HALF_EXTENTS_MM))) ** (1.0 / 3.0)

    # ------------------------------------------------------------------------------------------------- surface

    @property
    def middle(self) -> np.ndarray:
        """Middle (3,) mm of the smallest box around it."""
        return 0.5 * (self.scan.low + self.scan.high)

    @property
    def half(self) -> np.ndarray:
        """Half the extents (3,) mm."""
        return 0.5 * self.size * (self.scan.high - self.scan.low)

    @property
    def held_words(self) -> str:
        """Which region a support holds."""
        held = dict(self.held)
        if "below" in held:
            return f"held below z = {held['below']:.4g} mm"
        return "held inside a box" if "box" in held else f"held beside {Path(held['file']).name}"

    @property
    def described(self) -> str:
        """Its extents."""
        x, y, z = (members.length_words(2.0 * float(v)) for v in self.half)
        return f"a scanned body of {x} by {y} by {z}"

    def drawn(self, way: np.ndarray, wide: float) -> list[Drawn]:
        """The cut of its facets by the plane, in the order of their angles about the middle of the cut."""
        x = self._out(self.scan.vertices)
        off = x[:, :2] @ np.array([-way[1], way[0]])
        edges = np.concatenate([self.scan.facets[:, [i, (i + 1) % 3]] for i in range(3)])
        a, b = edges[(off[edges[:, 0]] < 0.0) != (off[edges[:, 1]] < 0.0)].T
        if not len(a):
            raise ValueError(
                "the vertical plane through the axis of the frame and the place of the test misses the surface"
            )
        share = (off[a] / (off[a] - off[b]))[:, None]
        cut = x[a] + share * (x[b] - x[a])
        points = np.column_stack([cut[:, :2] @ way, cut[:, 2]])
        d = points - 0.5 * (points.min(0) + points.max(0))
        points = points[np.argsort(np.arctan2(d[:, 1], d[:, 0]))]
        outline = tuple((float(s), float(z)) for s, z in points)
        low, high = points.min(0), points.max(0)
        beside = float(high[0] + 0.04 * (high - low)[0])
        height = Drawn(
            "dimension",
            ((beside, float(low[1])), (beside, float(high[1]))),
            members.length_words(float((high - low)[1])),
        )
        return [Drawn("specimen", outline, self.described), Drawn("edge", (*outline, outline[0])), height]

    @property
    def smallest(self) -> float:
        """Half the smallest extent (mm)."""
        return float(self.half.min())

    @property
    def largest(self) -> float:
        """Half the largest extent (mm)."""
        return float(self.half.max())

    @property
    def skin_limit(self) -> float:
        """Half the smallest radius of curvature (mm) but for the sharpest hundredth of the vertices."""
        sharp = float(np.quantile(self.scan.curvature[:, 1], 0.99))
        return min(0.5 * self.size / max(sharp, 1e-300), 0.5 * self.smallest)

    def _in(self, x: np.ndarray) -> np.ndarray:
        """Points in the scan of points in the body, whose size may be in error."""
        x = np.asarray(x, float)
        return x if self.size == 1.0 else (x - self.middle) / self.size + self.middle

    def _out(self, x: np.ndarray) -> np.ndarray:
        return x if self.size == 1.0 else (x - self.middle) * self.size + self.middle

    def above(self, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Where a ray from above at (x, y) mm meets the surface first, and the outward normal (3,) there."""
        at = self._in(np.array([x, y, self.middle[2]]))
        smooth = self.scan.smooth
        corners = smooth.tree.corners
        a, b, c = (corners[:, k, :2] for k in range(3))
        e, f, p = b - a, c - a, at[:2] - a
        area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
        up = area > 0.0  # facets that face upwards
        corners, e, f, p, area = corners[up], e[up], f[up], p[up], area[up]
        v = (p[:, 0] * f[:, 1] - p[:, 1] * f[:, 0]) / area
        w = (e[:, 0] * p[:, 1] - e[:, 1] * p[:, 0]) / area
        met = (v >= -1e-12) & (w >= -1e-12) & (v + w <= 1.0 + 1e-12)
        if not met.any():
            raise ValueError(f"point {(x, y)} mm is not above the body")
        z = np.einsum("na,na->n", np.column_stack([1.0 - v - w, v, w]), corners[:, :, 2])[met]
        on = np.array([[at[0], at[1], z.max()]])
        for _ in range(20):
            f, gradient = smooth.level(on)
            if abs(gradient[0, 2]) < 1e-3:
                raise ValueError(f"point {(x, y)} mm is on an upright part of the surface")
            step = float(f[0] / gradient[0, 2])
            on[0, 2] -= step
            if abs(step) <= 1e-13 * self.largest:
                break
        return self._out(on)[0], smooth.normals(on)[0]

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """Whether points X (n, 3) of the surface are of its part `lower`, what is held, or `upper`, with the rim."""
        phi = scans.held_level(self.region, self._in(X))
        return phi >= -self._rim if name == "upper" else phi <= self._rim

    @property
    def _rim(self) -> float:
        return 10.0 * scans.ON_RIM_TOLERANCE * float(np.abs(self.scan.vertices).max())

    def distance(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance (mm) of a point x (3,) outside and the unit normal N (3,) that is its gradient."""
        y = self.closest(x)
        away = np.asarray(x, float) - y
        N = self.scan.smooth.normals(self._in(y)[None])[0]
        d = float(np.linalg.norm(away))
        return math.copysign(d, float(away @ N)), away / d if d > 1e-6 * self.largest and away @ N > 0.0 else N

    def closest(self, x: ArrayLike) -> np.ndarray:
        """Point (3,) of the surface that is closest to a point x (3,) mm."""
        return self._out(self.scan.smooth.closest(self._in(np.asarray(x, float))[None]))[0]

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) mm of points X (…, 3) to the surface, negative outside."""
        return self.size * self.scan.smooth.depth(self._in(X))

    def project(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) near the surface moved onto it."""
        return self._out(self.scan.smooth.project(self._in(x)))

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Whether nodes X (…, 3) lie on the surface."""
        flat = self._in(X).reshape(-1, 3)
        f, gradient = self.scan.smooth.level(flat)
        on = np.abs(f) <= ON_SURFACE_TOLERANCE * self.largest * np.linalg.norm(gradient, axis=1)
        return on.reshape(np.shape(X)[:-1])

    def mean_curvature(self, x: float, y: float) -> float:
        """H (1/mm) of the surface above (x, y) mm."""
        on = self._in(self.above(x, y)[0])
        return float(self.scan.smooth.curvatures(on[None]).mean()) / self.size

    def volume(self) -> float:
        """Volume (mm³)."""
        return self.scan.volume * self.size**3

    @property
    def top(self) -> np.ndarray:
        """The highest vertex (3,), on the surface."""
        v = self.scan.vertices
        return self.project(self._out(v[np.argmax(v[:, 2])][None]))[0]

    @property
    def lowest(self) -> np.ndarray:
        """The lowest vertex (3,), on the surface."""
        v = self.scan.vertices
        return self.project(self._out(v[np.argmin(v[:, 2])][None]))[0]

    def hole(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Centre (3,) and semi-axes (3,) mm of the cavity: around the lowest point."""
        return self.lowest, size * self.half / np.array(HALF_SIZE_TO_CAVITY)

    def first_contact(self, indenter: Any, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
        """Reference point (3,) mm where an indenter first touches on its way, of any shape on any surface.

        The way is the line through `through` (3,) along `direction` (3,); s = min over the surface of the travel until
        it meets a point: on a grid on every facet about the way, then on ever finer grids on the best of them, on the
        smooth surface.  Raises ValueError where the indenter passes by.
        """
        line = tuple(map(float, through)), tuple(map(float, direction))  # type: ignore[arg-type]
        return np.array(_first_contact(self, indenter, *line)[0])

    def first_touched(self, indenter: Any, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
        """Point (3,) mm of the surface that it touches there; see :meth:`first_contact`."""
        line = tuple(map(float, through)), tuple(map(float, direction))  # type: ignore[arg-type]
        return np.array(_first_contact(self, indenter, *line)[1])

    # -------------------------------------------------------------------------------------------- what is modelled

    def refusal(self, indenter: Any, point: tuple[float, float]) -> list[str]:
        """Indenters of 1/70 of half its length to half of its half thickness, on its upper side, off what is held."""
        out, (key, size) = [], indenter.size
        if size > 0.5 * self.smallest:
            out.append(
                f"indenter.{key} = {size} mm: only indenters up to {0.5 * self.smallest:.4g} mm are modelled (half "
                f"of {self.smallest_words}). The surface measures {self._extents} with specimen.unit = "
                f"{self.unit!r}: is that its unit?"
            )
        if size < self.largest / MAX_SIZE_TO_INDENTER:
            out.append(
                f"indenter.{key} = {size} mm: no mesh is made for so small a {indenter.noun} on this specimen. "
                f"At least {self.largest / MAX_SIZE_TO_INDENTER:.3g} mm is needed "
                f"(1/{MAX_SIZE_TO_INDENTER} of half its length). "
                f"The surface measures {self._extents} with specimen.unit = {self.unit!r}: is that its unit?"
            )
        try:
            on, normal = self.above(*point)
        except ValueError as error:
            reach = " and ".join(f"{n} from {a:.4g} to {b:.4g} mm" for n, a, b in self._outline)
            return [*out, f"point = {list(point)} mm: {str(error).split(' mm ')[-1]}, which has {reach}"]
        if normal[2] < MIN_UPWARD_NORMAL:
            steep = math.degrees(math.acos(max(float(normal[2]), 0.0)))
            out.append(
                f"point = {list(point)} mm: the surface is {steep:.0f} degrees steep there, at most "
                f"{math.degrees(math.acos(MIN_UPWARD_NORMAL)):.0f} are modelled"
            )
        if self.part("lower", on[None])[0]:
            out.append(f"point = {list(point)} mm: lies in the region that is held")
        return out

    @property
    def _extents(self) -> str:
        return " x ".join(f"{2.0 * v:.4g}" for v in self.half) + " mm"

    @property
    def _outline(self) -> list[tuple[str, float, float]]:
        low, high = self._out(self.scan.low), self._out(self.scan.high)
        return [(n, float(low[k]), float(high[k])) for k, n in enumerate("xy")]

    def beside(self, x: float, y: float) -> str | None:
        """A mark lies within the outline from above."""
        try:
            self.above(x, y)
        except ValueError:
            return f"profile: the mark ({x:g}, {y:g}) mm does not lie on the upper side of the specimen"
        return None

    def thickness_along(self, direction: np.ndarray) -> float:
        """Σ |d_i| extent_i (mm) of its box, which is as thick as itself or thicker."""
        return 2.0 * float(np.abs(direction) @ self.half)

    def off_top(self, x: float, y: float) -> float:
        """The mesh is made for the place of the test: nothing is stretched on the way."""
        return 0.0

    # ---------------------------------------------------------------------------------------------------- mesh

    def touched_at(self, point: tuple[float, float]) -> Surface:
        """The specimen with its mesh fine at the place (x, y) mm of a test."""
        return replace(self, place=point)

    def meshing(self, length: float, mesher: str, level: str, n: int, slip: float) -> Meshing:
        """A mesh of its own for each place and size of the indenter, by fTetWild."""
        if mesher != "tetwild":
            raise ValueError(f"mesh.mesher = {mesher!r}: a scanned surface is meshed by tetwild alone")
        if level not in meshing.ALL_TEMPLATE_SIZINGS:
            known = ", ".join(meshing.TEMPLATE_SIZINGS)
            raise ValueError(f"mesh.level = {level!r}: not for a scanned surface; choose from {known}")
        sizing = replace(
            meshing.ALL_TEMPLATE_SIZINGS[level].scaled(length / meshing.TEMPLATE_RADIUS_MM), hmax=1.15 * self.smallest
        )
        on, _ = self.above(*self.place)
        recipe = scans.scan_recipe(self.file, SURFACE_UNITS_MM[self.unit], self.sha256, self.region, on, sizing)
        return Meshing(recipe, (("mesher", mesher), ("level", level)), sizing.h0, level)

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """The mesh of the recipe, fine elements at `point`, edges curved, in the size of the body; raises BadMesh."""
        smooth, place = self.scan.smooth, np.array(scans.fine_place(recipe))
        to = self._in(self.above(*point)[0])
        if np.linalg.norm(to - place) > ON_SURFACE_TOLERANCE * self.largest:
            mesh = scans.carried_mesh(smooth, self.region, mesh, place, to)
        made = scans.quadratic_on_scan(smooth, self.region, mesh)
        worst = float(meshing.scaled_jacobian(made).min())
        if worst <= 0.0:
            raise meshing.BadMesh(f"elements are spoilt: scaled Jacobian {worst:.3f}")
        return MeshTet2(np.ascontiguousarray(self._out(made.doflocs.T).T), made.t)

    # ------------------------------------------------------------------------------------------------- proposals

    def places(self) -> tuple[tuple[float, float], ...]:
        """A third of the way to both ends and sides, where the surface faces upwards."""
        found = []
        for k, sign in ((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0)):
            at = self.middle.copy()
            at[k] += sign * PROPOSED_PLACE_SHARE * self.half[k]
            x, y = (float(f"{v:.3g}") for v in at[:2])
            try:
                on, normal = self.above(x, y)
            except ValueError:
                continue
            if normal[2] > 0.6 and not self.part("lower", on[None])[0]:
                found.append((x, y))
        return tuple(found[:2])

    def lines(self, point: tuple[float, float], beside: float, unit: float) -> dict[str, list[list[float]]]:
        """Thirteen marks over the length and the width, of which those are left that lie on the upper side."""
        (x, y), share = point, np.linspace(-0.5, 0.5, 13)

        def mark(*at: float) -> list[float]:
            return [float(f"{unit * round(float(v) / unit, 2):.12g}") for v in at]

        rows = {
            "surface marks along x": [mark(x + s * self.half[0], y + beside) for s in share],
            "surface marks along y": [mark(x + beside, y + s * self.half[1]) for s in share],
        }
        return {words: [m for m in row if self._seen(*m)] for words, row in rows.items()}

    def _seen(self, x: float, y: float) -> bool:
        try:
            on, normal = self.above(x, y)
        except ValueError:
            return False
        return bool(normal[2] > 0.4 and not self.part("lower", on[None])[0])


def _path(file: str) -> str:
    return os.path.abspath(os.path.expanduser(file))


def _read(key: str, file: str, scale: float, sha256: str | None) -> scans.Scan:
    """The scan in a file; refused with the reason."""
    try:
        body = scans.scan(_path(file), scale)
    except ValueError as error:
        text = str(error)
        raise members.refused(f": {text}" if text[:5] == "there" else f": the surface {text}", key, file) from error
    if sha256 is not None and sha256 != body.sha256:
        raise members.refused(f": has changed since the run was set up, its SHA-256 is {body.sha256}", key, file)
    return body


def _region(table: Surface.Table, body: scans.Scan) -> dict[str, Any]:
    """The held region with what is left out written out: the lower half, the hash of a second surface."""
    held = table.held
    if held is None:
        return {"below": float(f"{0.5 * (body.low[2] + body.high[2]):.12g}")}
    if held.file is None:
        return {"below": held.below} if held.below is not None else {"box": held.box}
    near = HELD_WITHIN_SHARE * 0.5 * float((body.high - body.low).min())
    other = scans.scan(_path(held.file), SURFACE_UNITS_MM[table.unit])
    return {
        "file": _path(held.file),
        "scale": SURFACE_UNITS_MM[table.unit],
        "sha256": other.sha256,
        "within": near if held.within is None else held.within,
    }


@functools.lru_cache(maxsize=256)
def _first_contact(
    body: Surface, indenter: Any, through: tuple[float, ...], direction: tuple[float, ...]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Reference point and point touched, see :meth:`Surface.first_contact`; a study asks for the same again."""
    origin, d = np.array(through), np.array(direction) / np.linalg.norm(direction)
    corners = body._out(body.scan.smooth.tree.corners)
    away = 4.0 * (body.largest + indenter.length) + float(np.linalg.norm(origin - body.middle))
    start = origin - ((origin - body.middle) @ d + away) * d
    grid = (
        np.array([(i, j) for i in range(N_GRID_ALONG_FACET + 1) for j in range(N_GRID_ALONG_FACET + 1 - i)])
        / N_GRID_ALONG_FACET
    )
    weights = np.column_stack([1.0 - grid.sum(1), grid])
    flat = np.einsum("qa,fai->fqi", weights, corners)
    travel = indenter.travel(flat, start, d).min(1)
    span = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max()
    near = np.nonzero(travel <= travel.min() + span)[0]
    if not len(near) or not np.isfinite(travel.min()):
        raise ValueError(
            f"an indenter of {indenter.length:g} mm on the line through {origin} along {d} passes by the body"
        )
    on = body.project(flat[near].reshape(-1, 3)).reshape(len(near), -1, 3)
    travel = indenter.travel(on, start, d)
    best = np.argsort(travel.min(1), kind="stable")[:N_CANDIDATE_FACETS]
    at, nodes, least = weights[travel[best].argmin(1), 1:], corners[near[best]], float(travel.min())
    touched = on.reshape(-1, 3)[travel.argmin()]
    offsets, width = np.indices((7, 7)).reshape(2, -1).T / 3.0 - 1.0, 2.0 / N_GRID_ALONG_FACET
    for _ in range(N_GRID_HALVINGS):
        finer = np.maximum(at[:, None] + width * offsets, 0.0)
        finer /= np.maximum(finer.sum(-1, keepdims=True), 1.0)
        points = np.einsum("fqa,fai->fqi", np.concatenate([1.0 - finer.sum(-1, keepdims=True), finer], axis=-1), nodes)
        on = body.project(points.reshape(-1, 3))
        travel = indenter.travel(on.reshape(points.shape), start, d)
        at = finer[np.arange(len(best)), travel.argmin(1)]
        if travel.min() < least:
            least, touched = float(travel.min()), on[travel.argmin()]
        width *= 0.6
    return tuple((start + least * d).tolist()), tuple(touched.tolist())
