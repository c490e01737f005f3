"""A rigid flat-ended cylinder, its edge rounded by a fillet."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from fem_backend import closed_forms, members
from fem_backend.indenters.indenter import INDENTERS
from fem_backend.indenters.meridian import UPRIGHT_ANGLE_RAD, Meridian, meridian_outline
from fem_backend.indenters.revolution import OfRevolution
from rso.contract import knob

# fillet over radius: elements at the edge are a third of the fillet, and the pressure there grows
MIN_FILLET_RATIO = 0.01
ADVISED_FILLET_RATIO = 0.05  # fillet over radius that a message advises
FLAT_STRAIN_SHARE = 0.8  # of the largest strain on the axis in small strain, d/(π a)


@INDENTERS.register
@dataclass(frozen=True)
class Flat(OfRevolution):
    """Rigid cylinder of radius a with a flat end and an edge fillet (mm); its reference point is the middle of the end.

    A disc of radius a − fillet, a quarter of a circle and the side, which join without a corner.
    """

    radius: float
    fillet: float

    class Table(members.MemberTable):
        """{ shape = "flat", radius = 2.0, fillet = 0.1 }"""

        shape: Literal["flat"] = "flat"
        """A rigid cylinder with a flat end."""
        radius: members.Length
        """Radius of the cylinder, mm."""
        fillet: members.Length
        """Radius of the rounded edge, mm: 0.01 to 1 of the radius."""

        @model_validator(mode="before")
        @classmethod
        def _edge(cls, value: Any) -> Any:
            """Refuses a sharp edge with a fillet that is resolved."""
            radius, fillet = value.get("radius", members.MISSING), value.get("fillet", members.MISSING)
            if radius is members.MISSING:
                raise members.refused(": missing; the radius of the cylinder is expected", "radius", radius)
            if not members.is_finite(radius) or radius <= 0.0:
                return value
            range_ = f"{1.006 * MIN_FILLET_RATIO * radius:.3g} to {radius:g} mm (0.01 to 1 of the radius)"
            range_ += f", e.g. {ADVISED_FILLET_RATIO * radius:.3g} mm"
            sharp = "a sharp edge has an infinite pressure, which no mesh resolves: give the radius of its edge"
            if fillet is members.MISSING:
                raise members.refused(f": missing; {sharp}, {range_}", "fillet", fillet)
            if members.is_finite(fillet) and 0.0 <= fillet < MIN_FILLET_RATIO * radius:
                raise members.refused(f" mm: {sharp}, {range_}", "fillet", float(fillet))
            if members.is_finite(fillet) and fillet > radius:
                raise members.refused(f" mm: larger than the radius; give {range_}", "fillet", float(fillet))
            return value

        def build(self) -> Flat:
            """The indenter of these settings."""
            return Flat(self.radius, self.fillet)

    @dataclass(frozen=True)
    class Knobs:
        """Errors of its sizes."""

        delta_punch_radius: float = knob(
            "error of the radius of the flat end",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.03,
            plausible=(-0.15, 0.15),
            label="wrong radius of the flat end",
        )
        delta_punch_fillet: float = knob(
            "error of the fillet of the flat end",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.05,
            plausible=(-0.02, 0.2),
            label="wrong fillet of the flat end",
        )

    name: ClassVar[str] = "flat"
    noun: ClassVar[str] = "flat end"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "flat",
            ("RADIUS", "[FILLET]"),
            ("mm", "mm"),
            "a flat-ended cylinder, its edge rounded",
            least=1,
            settings=lambda r, f=None: {
                "indenter": {"shape": "flat", "radius": r, "fillet": float(f"{0.05 * r:.3g}") if f is None else f}
            },
            guess="its fillet, a twentieth of the radius",
        ),
    )
    exponents: ClassVar[tuple[float, ...]] = (1.0, 2.0)  # Sneddon, and the first of what stiffens or softens
    gauges: ClassVar[Mapping[str, float]] = {"delta_punch_radius": 0.01, "delta_punch_fillet": 0.02}

    @property
    def described(self) -> str:
        """Its sizes."""
        radius, fillet = members.length_words(self.radius), members.length_words(self.fillet)
        return f"a flat end of radius {radius} (edge rounded by {fillet})"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name, "radius": self.radius, "fillet": self.fillet}

    def dimensions(self) -> Mapping[str, float]:
        """Radius and fillet."""
        return {"delta_punch_radius": self.radius, "delta_punch_fillet": self.fillet}

    def actual(self, knobs: Any, specimen: Any) -> Flat:
        """The cylinder with the errors of its sizes; ValueError where these are none of a rounded flat end."""
        radius, fillet = self.radius + knobs.delta_punch_radius, self.fillet + knobs.delta_punch_fillet
        if not 0.0 < radius <= specimen.fattest:
            raise ValueError(
                f"delta_punch_radius = {knobs.delta_punch_radius:g} mm: a flat end of {radius:g} mm, must be larger "
                f"than 0 and at most {specimen.fattest:g} mm on this specimen"
            )
        if not MIN_FILLET_RATIO * radius <= fillet <= radius:
            raise ValueError(
                f"delta_punch_fillet = {knobs.delta_punch_fillet:g} mm: a fillet of {fillet:g} mm, must be "
                f"{MIN_FILLET_RATIO * radius:.3g} to {radius:.3g} mm ({MIN_FILLET_RATIO:g} to 1 of the radius)"
            )
        return replace(self, radius=radius, fillet=fillet)

    @property
    def meridian(self) -> Meridian:
        """The disc, the fillet and the side."""
        return _meridian(self.radius, self.fillet)

    @property
    def size(self) -> tuple[str, float]:
        """Key of the table and its value (mm)."""
        return "radius", self.radius

    @property
    def finest(self) -> tuple[str, float]:
        """The fillet."""
        return "fillet", self.fillet

    @property
    def length(self) -> float:
        """The radius (mm)."""
        return self.radius

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Hertz's √(d/H) (mm) at depths d (mm) in a body of mean curvature H (1/mm), at most the radius."""
        return np.minimum(np.sqrt(np.asarray(depth, float) / max(curvature, 1e-300)), self.radius)

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray:
        """F (N) at depths d (mm) of a sharp flat end of radius a in a body of mean curvature H ≥ 0 (1/mm):

            F = 2 E* (a d − a³H/3),   E* = E/(1 − ν²),

        2 E* a d on a half-space, and Hertz's force with R = 1/H where d < a²H: only a part of the end touches.
        Assumptions: half-space, small strain, no friction, no fillet.  Source: Sneddon 1965, eq. 6.1, and the same
        integral for the paraboloid H r²/2 (see :func:`.meridian.half_space_force`).
        """
        d, a, H = np.asarray(depth, float), self.radius, max(curvature, 0.0)
        F = 2.0 * E / (1.0 - nu**2) * (a * d - a**3 * H / 3.0)
        return np.where(d < a**2 * H, closed_forms.hertz_force(d, 1.0 / H, E, nu), F) if H else F

    def strain(self, depth: np.ndarray | float) -> np.ndarray | float:
        """Logarithmic strain that it causes at least below itself at a depth d (mm): 0.8 d/(π a), at most 0.8/π.

        On the axis at the depth a below the end it is d/(π a) of an incompressible half-space in small strain, and more
        of a compressible one (Johnson 1985, §3.3, u_z below a flat end).
        """
        return FLAT_STRAIN_SHARE / math.pi * np.clip(np.asarray(depth, dtype=float) / self.radius, 0.0, 1.0)

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """Another indenter that one would try, in words, and its settings."""
        table = {"shape": self.name, "radius": 2 * self.radius, "fillet": 2 * self.fillet}
        return {f"a flat end of radius {2 * self.radius:g} mm": {"indenter": table}}


@functools.lru_cache(maxsize=64)
def _meridian(radius: float, fillet: float) -> Meridian:
    return meridian_outline([(0.0, radius - fillet), (UPRIGHT_ANGLE_RAD, fillet), (UPRIGHT_ANGLE_RAD, math.inf)])
