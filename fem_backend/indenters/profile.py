"""A rigid body of revolution with a measured profile: points (r, z) of a file, joined by arcs."""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from fem_backend import members
from fem_backend.indenters.indenter import INDENTERS
from fem_backend.indenters.meridian import (
    ARC_PIECE,
    UPRIGHT_ANGLE_RAD,
    Meridian,
    half_space_force,
    half_space_radius,
    meridian_outline,
)
from fem_backend.indenters.revolution import LENGTH_IN_TIP_RADII, OfRevolution
from rso.contract import knob

PROFILE_UNITS_MM = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6}  # in mm
COLUMN_HEADER = re.compile(r"([rz])\s*[_ (\[]\s*([a-zµμ]+)\s*[)\]]?", re.IGNORECASE)
STRAIGHT_TOLERANCE_RAD = 1e-6  # difference of angles (rad) below which neighbouring chords are one straight line
MIN_CURVATURE_RADIUS_RATIO = 0.01  # least radius of curvature over the length
MAX_PROFILE_POINTS = 1000  # points: the gap looks at every arc

Points = tuple[tuple[float, float], ...]


def read_profile(file: str) -> Points:
    """Points (r, z) mm of a CSV file with a header such as `r_mm,z_mm` or `r (um); z (um)`; z of the first is 0.

    Lines that begin with # are comments.  Raises ValueError naming file, row and value.
    """
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot be read ({getattr(error, 'strerror', None) or error})") from error
    rows = [(k, line.strip()) for k, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not rows:
        raise ValueError("the file is empty: a header such as r_mm,z_mm and rows of numbers are expected")
    separator = next((s for s in (";", "\t", ",") if s in rows[0][1]), ",")
    heads = [COLUMN_HEADER.fullmatch(c.strip().strip('"')) for c in rows[0][1].split(separator)]
    found = {m[1].lower(): (i, m[2]) for i, m in enumerate(heads) if m}
    if set(found) != {"r", "z"} or any(unit not in PROFILE_UNITS_MM for _, unit in found.values()):
        raise ValueError(
            f"row {rows[0][0]}: the header {rows[0][1]!r} must name r and z with their units, such as r_mm,z_mm; "
            f"units: {', '.join(PROFILE_UNITS_MM)}"
        )
    points = []
    for k, line in rows[1:]:
        cells = [c.strip() for c in line.split(separator)]
        pair = []
        for name in ("r", "z"):
            i, unit = found[name]
            try:
                value = float(cells[i])
            except (IndexError, ValueError):
                given = repr(cells[i]) if i < len(cells) else "missing"
                raise ValueError(f"row {k}: {name} = {given}: a number in {unit} is expected") from None
            if not math.isfinite(value):
                raise ValueError(f"row {k}: {name} = {value}: a finite number in {unit} is expected")
            pair.append(value * PROFILE_UNITS_MM[unit])
        points.append((pair[0], pair[1]))
    wrong = fault(points, [k for k, _ in rows[1:]])
    if wrong:
        raise ValueError(wrong)
    return tuple((r, z - points[0][1]) for r, z in points)


def fault(points: Sequence[tuple[float, float]], rows: Sequence[int]) -> str | None:
    """What is wrong with points (r, z) mm as a convex profile from its tip outwards, with the row; None if nothing."""
    if not 3 <= len(points) <= MAX_PROFILE_POINTS:
        return f"{len(points)} points: 3 to {MAX_PROFILE_POINTS} are expected"
    if points[0][0] != 0.0:
        return f"row {rows[0]}: r = {points[0][0]:g} mm: the first point must lie on the axis, r = 0"
    angles = []
    for k in range(1, len(points)):
        dr, dz = points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]
        for name, d, i in (("r", dr, 0), ("z", dz, 1)):
            if d < 0.0:
                return (
                    f"row {rows[k]}: {name} = {points[k][i]:g} mm is less than {points[k - 1][i]:g} mm before it: a "
                    "profile goes outwards and upwards from its tip"
                )
        if dr == dz == 0.0:
            return f"row {rows[k]}: r = {points[k][0]:g} mm, z = {points[k][1]:g} mm: the same point as before it"
        angles.append(math.atan2(dz, dr))
        if k > 1 and angles[-1] < angles[-2] - STRAIGHT_TOLERANCE_RAD:
            return (
                f"row {rows[k - 1]}: z = {points[k - 1][1]:g} mm at r = {points[k - 1][0]:g} mm: the profile bends "
                f"inwards there ({math.degrees(angles[-2]):.3g} to {math.degrees(angles[-1]):.3g} degrees). It must "
                "be convex: smooth the measured points"
            )
    flat = _straight(angles)
    if flat[0] and angles[0] > STRAIGHT_TOLERANCE_RAD:
        return (
            f"row {rows[0]}: a sharp tip of {90.0 - math.degrees(angles[0]):.3g} degrees: give points of its rounding"
        )
    for k in range(1, len(angles)):
        if flat[k - 1] and flat[k] and angles[k] - angles[k - 1] > STRAIGHT_TOLERANCE_RAD:
            return (
                f"row {rows[k]}: a sharp edge at r = {points[k][0]:g} mm, of {math.degrees(angles[k - 1]):.3g} to "
                f"{math.degrees(angles[k]):.3g} degrees: give points of its rounding"
            )
    made = meridian_through(tuple(points))
    least = MIN_CURVATURE_RADIUS_RATIO * _length(made, points[-1][0])
    if made.tightest < least:
        k = int(np.argmin(np.where(made.pieces[:, 0] == ARC_PIECE, made.pieces[:, 3], np.inf)))
        near = int(np.argmin(np.abs(np.array(points)[:, 0] - made.starts[k])))
        return (
            f"row {rows[near]}: near r = {points[near][0]:g} mm the profile bends with a radius of {made.tightest:.2g} "
            f"mm: at least {least:.2g} mm is resolved"
        )
    return None


def _straight(angles: Sequence[float]) -> list[bool]:
    """Whether each chord is a part of a straight line: in line with a neighbour, or level on the axis."""
    even = [
        angles[0] <= STRAIGHT_TOLERANCE_RAD,
        *(abs(b - a) <= STRAIGHT_TOLERANCE_RAD for a, b in itertools.pairwise(angles)),
        False,
    ]
    return [even[k] or even[k + 1] for k in range(len(angles))]


@functools.lru_cache(maxsize=64)
def meridian_through(points: Points) -> Meridian:
    """The meridian through points (r, z) mm: straight where they lie in line, else two arcs from each to the next.

    The tangent at a point is that of the circle through it and its neighbours, so a circle is met exactly; arcs meet
    parallel to the chord.  Beyond the last point the outline goes on straight.
    """
    P = np.array(points)
    chord = np.diff(P, axis=0)
    psi = np.arctan2(chord[:, 1], chord[:, 0])
    size, straight = np.linalg.norm(chord, axis=1), _straight(psi.tolist())
    theta = np.zeros(len(P))
    for k in range(1, len(psi)):
        a, b = P[k - 1] - P[k + 1], P[k] - P[k + 1]  # the angle at the next point is that of tangent and chord
        theta[k] = psi[k - 1] + abs(math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b)))
        theta[k] = psi[k - 1] if straight[k - 1] else psi[k] if straight[k] else theta[k]
    last = psi[-1] if straight[-1] else 2.0 * psi[-1] - theta[-2]
    theta[-1] = min(last, UPRIGHT_ANGLE_RAD)
    steps: list[tuple[float, float]] = []
    at = 0.0
    for k in range(len(psi)):
        alpha, beta = psi[k] - theta[k], theta[k + 1] - psi[k]
        if straight[k] or min(alpha, beta) <= 0.0:
            steps.append((at, float(size[k])))
            continue
        first = size[k] / (math.sin(alpha) + math.sin(beta) * (1.0 - math.cos(alpha)) / (1.0 - math.cos(beta)))
        second = first * (1.0 - math.cos(alpha)) / (1.0 - math.cos(beta))
        at = float(theta[k + 1])
        steps += [(float(psi[k]), float(first)), (at, float(second))]
    return meridian_outline([*steps, (at, math.inf)])


def _length(meridian: Meridian, width: float) -> float:
    """The width, or ten radii of the tip where that is less (mm)."""
    first = meridian.pieces[0]
    return min(width, LENGTH_IN_TIP_RADII * float(first[3])) if first[0] == ARC_PIECE else width


@INDENTERS.register
@dataclass(frozen=True)
class MeasuredProfile(OfRevolution):
    """Rigid body of revolution through points (r, z) mm from its tip (0, 0), its reference point, outwards."""

    points: Points

    class Table(members.MemberTable):
        """{ shape = "profile", file = "tip.csv" } with the columns r and z and their units in the header"""

        shape: Literal["profile"] = "profile"
        """A rigid body of revolution with a profile of its own."""
        file: str | None = None
        """CSV file, from the working directory: r from the axis and z upwards, with units (r_mm,z_mm), tip first."""
        points: tuple[tuple[float, float], ...] | None = None
        """In place of the file: its points [r, z], mm."""

        @model_validator(mode="before")
        @classmethod
        def _read(cls, value: Any) -> Any:
            """The points of the file: what is in it counts, not where it lies."""
            file, points = value.get("file"), value.get("points")
            if file is not None and points is not None:
                raise members.refused(": points are given, too; one of the two is expected", "file", file)
            if file is None and points is None:
                words = ": missing; a CSV file with the columns r_mm,z_mm is expected"
                raise members.refused(words, "file", members.MISSING)
            if file is not None:
                if not isinstance(file, str):
                    raise members.refused(": the path of a CSV file is expected", "file", file)
                try:
                    points = read_profile(file)
                except ValueError as error:
                    raise members.refused(f": {error}", "file", file) from error
            else:
                pairs = isinstance(points, list | tuple) and all(
                    isinstance(p, list | tuple) and len(p) == 2 and all(map(members.is_finite, p)) for p in points
                )
                if not pairs:
                    raise members.refused(": a list of [r, z] in mm is expected", "points", points)
                points = tuple((float(r), float(z)) for r, z in points)
                wrong = fault(points, range(1, len(points) + 1))
                if wrong:
                    raise members.refused(f": {wrong}", "points", f"{len(points)} points")
            return {k: v for k, v in value.items() if k != "file"} | {"points": points}

        def build(self) -> MeasuredProfile:
            """The indenter of these settings."""
            assert self.points is not None  # of the file, if they were not given
            return MeasuredProfile(self.points)

    @dataclass(frozen=True)
    class Knobs:
        """The error of its scale."""

        profile_scale: float = knob(
            "size of the profile over that of its file",
            "1",
            0.2,
            5.0,
            neutral=1.0,
            typical=1.02,
            plausible=(0.93, 1.07),
            label="wrong scale of the profile",
        )

    name: ClassVar[str] = "profile"
    noun: ClassVar[str] = "tip"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "profile",
            ("FILE",),
            ("file",),
            "an indenter of revolution by its profile: a CSV with the columns r and z and their units",
            settings=lambda file: {"indenter": {"shape": "profile", "file": file}},
        ),
    )
    exponents: ClassVar[tuple[float, ...]] = (1.5, 2.5)  # of its rounded tip
    gauges: ClassVar[Mapping[str, float]] = {"profile_scale": 0.01}

    @property
    def described(self) -> str:
        """It has no sizes of its own."""
        return "a tip with a measured profile"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings: the points, wherever they come from."""
        return {"shape": self.name, "points": [list(p) for p in self.points]}

    def dimensions(self) -> Mapping[str, float]:
        """The scale of the profile."""
        return {"profile_scale": 1.0}

    def actual(self, knobs: Any, specimen: Any) -> MeasuredProfile:
        """The profile with the error of its scale."""
        k = knobs.profile_scale
        return self if k == 1.0 else replace(self, points=tuple((k * r, k * z) for r, z in self.points))

    @property
    def meridian(self) -> Meridian:
        """Arcs through the points."""
        return meridian_through(self.points)

    @property
    def size(self) -> tuple[str, float]:
        """The width of the profile (mm), as the key that says it."""
        return "file", self.length

    @property
    def finest(self) -> tuple[str, float]:
        """The smallest radius between two points."""
        return "file", self.meridian.tightest

    @property
    def length(self) -> float:
        """The width of the profile, or ten radii of its tip where that is less (mm)."""
        return _length(self.meridian, self.points[-1][0])

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray:
        """Sneddon's F (N) at depths (mm) in a body of mean curvature (1/mm): :func:`.meridian.half_space_force`."""
        return half_space_force(self.meridian, depth, curvature, E, nu, self._wide(depth))

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Sneddon's contact radius (mm) at depths (mm)."""
        return half_space_radius(self.meridian, depth, curvature, self._wide(depth))

    def _wide(self, depth: np.ndarray) -> float:
        """A radius (mm) that no contact to these depths exceeds, one of few."""
        meridian, width = self.meridian, self.points[-1][0]
        if math.isfinite(meridian.widest):
            return (1.0 - 1e-9) * meridian.widest
        far = float(np.max(depth, initial=0.0)) / float(meridian.slope(2.0 * width)) + width
        return self.length * 2.0 ** math.ceil(math.log2(far / self.length))

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """No other one."""
        return {}
