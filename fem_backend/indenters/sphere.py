"""A rigid sphere, with or without a shaft of its own radius."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from fem_backend import closed_forms, members
from fem_backend.compiled import compiled
from fem_backend.contact.tractions import ContactSurface
from fem_backend.geometry import NO_MOTION, kernel_arrays
from fem_backend.indenters.indenter import INDENTERS
from fem_backend.indenters.revolution import USUAL_LENGTH_MM, Axial
from fem_backend.indenters.spherical_patch import Patch, contact_patch
from rso.contract import knob

CONTACT_REACH_RATIO = 3.0  # facets within this times R of the first contact may touch
SPHERE_STRAIN_FACTOR = 0.42  # of √(d/R): four fifths of Hertz's largest strain below a ball, 0.53 √(d/R)
SPHERE_STRAIN_GROWTH = 0.25  # times (d/R)^(3/2): how much faster logarithmic strains grow at large depth
# wanted element sizes over R at the axis and beside it, and their growth
MIN_SPHERE_ELEMENT_RATIO, MAX_SPHERE_ELEMENT_RATIO, ELEMENT_GROWTH_BEYOND_SPHERE = 0.05, 0.12, 0.3
GUESSED_TABOR_NUMBER = 1.0  # where the range of an attraction is a guess: nearer to JKR is dearer
MAX_VERIFIED_DEPTH_RATIO = 2.0  # of R: depth up to which runs reach more than that


@INDENTERS.register
@dataclass(frozen=True)
class Sphere(Axial):
    """Rigid sphere of radius R (mm), with a shaft: continued by a cylinder of radius R opposite to `direction`.

    Its surface is the zero of the gap g(x) = |x − c| − R, beside the shaft of the distance from the axis − R; the
    joint is C¹.  Its reference point is its centre.
    """

    R: float
    shaft: bool = False

    class Table(members.MemberTable):
        """{ shape = "sphere", radius = 3.0, shaft = false }"""

        shape: Literal["sphere"] = "sphere"
        """A rigid sphere."""
        radius: members.Length = USUAL_LENGTH_MM
        """Radius, mm."""
        shaft: members.Flag = False
        """Whether a cylinder of the same radius goes on above."""

        def build(self) -> Sphere:
            """The indenter of these settings."""
            return Sphere(self.radius, self.shaft)

    @dataclass(frozen=True)
    class Knobs:
        """Knobs that exist only with a sphere."""

        delta_R: float = knob(
            "error of the indenter radius",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=0.05,
            plausible=(-0.3, 0.3),
            label="wrong ball radius",
        )

    name: ClassVar[str] = "sphere"
    noun: ClassVar[str] = "ball"
    theory: ClassVar[str] = "Hertz"
    exponents: ClassVar[tuple[float, ...]] = (1.5, 2.5)  # Hertz, and the first of what stiffens or softens
    gauges: ClassVar[Mapping[str, float]] = {"delta_R": 0.01}
    options: ClassVar[tuple[members.SettingsOption, ...]] = tuple(
        members.SettingsOption(
            name,
            ("R",),
            ("mm",),
            f"a ball of this radius on a shaft as wide{also}",
            settings=lambda R: {"indenter": {"shape": "sphere", "radius": R, "shaft": True}},
        )
        for name, also in (("ball", ""), ("radius", ", the older name of --ball"))
    )

    @property
    def described(self) -> str:
        """Its radius."""
        return f"a ball of radius {members.length_words(self.R)}"

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name, "radius": self.R, "shaft": self.shaft}

    def dimensions(self) -> Mapping[str, float]:
        """Its radius."""
        return {"delta_R": self.R}

    def actual(self, knobs: Any, specimen: Any) -> Sphere:
        """The sphere with the error of its radius; ValueError where that leaves none, or none that a mesh takes."""
        R = self.R + knobs.delta_R
        if not 0.0 < R <= specimen.fattest:
            raise ValueError(
                f"delta_R = {knobs.delta_R:g} mm: an indenter of {R:g} mm, must be larger than 0 and at most "
                f"{specimen.fattest:g} mm on this specimen"
            )
        return replace(self, R=R)

    def spacing(self, r: np.ndarray) -> np.ndarray:
        """Wanted element size (…) mm at distances r (…) mm from the axis: 0.12 r within 0.05 R and 0.12 R.

        Beyond R it grows by 0.3 of the distance.
        """
        r = np.asarray(r, float)
        fine, coarse = MIN_SPHERE_ELEMENT_RATIO * self.R, MAX_SPHERE_ELEMENT_RATIO * self.R
        return np.clip(MAX_SPHERE_ELEMENT_RATIO * r, fine, coarse) + ELEMENT_GROWTH_BEYOND_SPHERE * np.maximum(
            r - self.R, 0.0
        )

    @property
    def size(self) -> tuple[str, float]:
        """Key of the table and its value (mm)."""
        return "radius", self.R

    @property
    def finest(self) -> tuple[str, float]:
        """No edge."""
        return "radius", math.inf

    @property
    def length(self) -> float:
        """The radius (mm)."""
        return self.R

    @property
    def reach(self) -> float:
        """Distance (mm) from the first contact within which facets may touch."""
        return CONTACT_REACH_RATIO * self.R

    def gap(
        self, x: np.ndarray, centre: np.ndarray, direction: ArrayLike = NO_MOTION
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g (…), normal n = ∇g (…, 3) and Hessian ∇∇g = (I − n⊗n)/|x − c| (…, 3, 3) at points x (…, 3).

        `direction` is the unit way into the body (mm/mm); only the shaft, which trails behind, needs it.
        """
        flat, centre, direction = kernel_arrays(x, centre, direction)
        g, n, hessian = _sphere_gap(flat, centre, direction, float(self.R), self.shaft)
        return g.reshape(x.shape[:-1]), n.reshape(x.shape), hessian.reshape(*x.shape, 3)

    def travel(self, x: np.ndarray, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (…) mm, signed, the sphere goes along the unit `direction` until it first meets the points x (…, 3).

        s = d·v − √(R² − |v|² + (d·v)²) with v = x − c; ∞ for points beside its way.
        """
        v = x - centre
        along = v @ np.asarray(direction, float)
        inside = self.R**2 - ((v - along[..., None] * direction) ** 2).sum(-1)
        return np.where(inside >= 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)

    def swept(self, points: np.ndarray, start: np.ndarray, end: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Whether points (…, 3) lie inside the sphere somewhere between two centres (3,)."""
        share = np.clip((points - start) @ (end - start) / max(float((end - start) @ (end - start)), 1e-300), 0.0, 1.0)
        return np.linalg.norm(points - start - share[..., None] * (end - start), axis=-1) < self.R

    def first_contact(self, specimen: Any, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
        """Centre (3,) mm where the sphere first touches the undeformed convex specimen on its way.

        The way of the centre is the line through the point `through` (3,) along `direction` (3,), any length.  The
        distance from a convex body is convex along a line, so Newton from far away goes to the first contact without
        passing it.  Raises ValueError when the sphere passes by.
        """
        if hasattr(specimen, "first_contact"):  # not convex: it knows
            return specimen.first_contact(self, through, direction)
        origin, d = np.asarray(through, float), np.asarray(direction, float)
        d = d / np.linalg.norm(d)
        s = -(origin @ d) - 2.0 * (specimen.largest + self.R) - np.linalg.norm(origin - (origin @ d) * d)
        for _ in range(100):
            distance, N = specimen.distance(origin + s * d)
            rate = float(N @ d) / float(np.linalg.norm(N))
            if rate >= 0.0:
                break
            step = -(distance - self.R) / rate
            s += step
            if abs(step) <= 4e-16 * (abs(s) + specimen.largest):
                return origin + s * d
        raise ValueError(f"a sphere of radius {self.R} mm on the line through {origin} along {d} passes by the body")

    def contact(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the specimen that the sphere around `touch` (3,) meets first."""
        return specimen.closest(touch)

    def held(self, points: np.ndarray, touch: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        """It lets go of everything."""
        return None

    def normal(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Unit normal (3,) there, out of the specimen."""
        return (touch - self.contact(specimen, touch, direction)) / self.R

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
    ) -> Patch:
        """Contact patch: see :func:`.spherical_patch.contact_patch`."""
        return contact_patch(
            surface, x, pressure, centre, self.R, tuple(axis), planes, attraction=attraction, width=width
        )

    def outline(self, centre: np.ndarray, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Closed line (k, 2) mm of the sphere, with a piece of its shaft, in the plane of the unit vectors `across`."""
        t = np.linspace(0.0, 2.0 * np.pi, 181)
        ahead = across @ np.asarray(direction, float)
        if self.shaft and np.linalg.norm(ahead) > 0.5:
            ahead = ahead / np.linalg.norm(ahead)
            side = np.array([-ahead[1], ahead[0]])
            t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 91)
            front = np.outer(np.cos(t), ahead) + np.outer(np.sin(t), side)
            return across @ centre + self.R * np.vstack([front, front[-1] - 2.0 * ahead, front[0] - 2.0 * ahead])
        return across @ centre + self.R * np.column_stack([np.cos(t), np.sin(t)])

    def effective_radius(self, curvature: float) -> float:
        """R* (mm) where the specimen has a mean curvature H (1/mm), 1/R* = 1/R + H (Johnson 1985, eq. 4.3)."""
        return 1.0 / (1.0 / self.R + curvature)

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """Hertz's contact radius √(R* d) (mm) at depths d (mm)."""
        return np.sqrt(self.effective_radius(curvature) * np.asarray(depth, float))

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray:
        """Hertz's force (N) at depths (mm) in a specimen of mean curvature H (1/mm): half-space, small strain."""
        return closed_forms.hertz_force(depth, self.effective_radius(curvature), E, nu)

    def modulus(self, force: np.ndarray, depth: np.ndarray, curvature: float, nu: float) -> np.ndarray:
        """Young's modulus (MPa) that has these forces (N) at these depths (mm) by Hertz."""
        return closed_forms.hertz_modulus(force, depth, self.effective_radius(curvature), nu)

    def adhesive_fit(self, travel: np.ndarray, force: np.ndarray, curvature: float) -> dict[str, float]:
        """μ (MPa), w (N/mm), where contact is (mm) and a range of Tabor's parameter 1, of Fz (n,) N over travel
        (n,) mm by JKR, incompressible.

        F = 4 E* a³/(3 R) − √(8π w E* a³),   δ = a²/R − √(2π w a/E*),   E* = 4 μ.  Least squares over w/E* and the
        contact, E* in closed form, of the readings from the strongest pull on.  Small strains, a half-space (Johnson,
        Kendall and Roberts 1971); nothing where no reading pulls.
        """
        R = self.effective_radius(curvature)
        k = int(np.argmin(force))
        u, F = travel[k:], force[k:]
        if len(u) < 4 or not F[0] < 0.0 or np.ptp(u) == 0.0:
            return {}
        a, best = np.linspace(1e-3, 1.0, 400) * R, (np.inf, 0.0, 0.0, 0.0)
        for ratio in np.geomspace(1e-6, 0.3, 120) * R:
            depth, unit = (
                a**2 / R - np.sqrt(2.0 * np.pi * ratio * a),
                4.0 * a**3 / (3.0 * R) - np.sqrt(8.0 * np.pi * ratio * a**3),
            )
            low = int(np.argmin(depth))  # beyond the turn of the branch no contact is stable
            for contact in u[0] + np.linspace(-0.5, 1.0, 61) * np.ptp(u):
                f = np.interp(u - contact, depth[low:], unit[low:])
                E = float(f @ F / max(f @ f, 1e-300))
                left = float(np.sum((F - E * f) ** 2))
                if E > 0.0 and left < best[0]:
                    best = left, E, E * ratio, contact
        if not best[1] > 0.0:
            return {}
        reach = (R * (best[2] / best[1]) ** 2) ** (1.0 / 3.0) / GUESSED_TABOR_NUMBER
        return {"mu": best[1] / 4.0, "adhesion": best[2], "contact": best[3], "adhesion_range": reach}

    def strain(self, depth: np.ndarray | float) -> np.ndarray | float:
        """Logarithmic strain |ln λ| that the sphere causes at least below itself at a depth (mm):

        0.42 √x (1 + x^(3/2)/4), x = depth/R, at most 2.  Hertz's strain on the axis of an incompressible body is
        0.53 √x at 0.48 contact radii (Johnson 1985, eq. 3.45); runs of neo-Hookean bodies reach 1.2 to 1.4 times this
        at K/μ 1.4 to 180, x from 1/6 to 2.  Assumes a homogeneous body without fibres.
        """
        x = np.clip(np.asarray(depth, dtype=float) / self.R, 0.0, MAX_VERIFIED_DEPTH_RATIO)
        return SPHERE_STRAIN_FACTOR * np.sqrt(x) * (1.0 + SPHERE_STRAIN_GROWTH * x**1.5)

    def tests(self) -> dict[str, Mapping[str, Any]]:
        """Another indenter that one would try, in words, and its settings."""
        return {f"a ball of R = {2 * self.R:g} mm": {"indenter": {"shape": self.name, "radius": 2 * self.R}}}


@compiled()
def _sphere_gap(x, c, d, R, shaft):  # type: ignore[no-untyped-def]
    count = len(x)
    g, n, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
    for k in range(count):
        v0, v1, v2 = x[k, 0] - c[0], x[k, 1] - c[1], x[k, 2] - c[2]
        behind = -(v0 * d[0] + v1 * d[1] + v2 * d[2])
        beside = shaft and behind > 0.0
        if beside:  # only the part across the axis counts
            v0, v1, v2 = v0 + behind * d[0], v1 + behind * d[1], v2 + behind * d[2]
        r = max(np.sqrt(v0 * v0 + v1 * v1 + v2 * v2), 1e-300)
        g[k] = r - R
        n[k, 0], n[k, 1], n[k, 2] = v0 / r, v1 / r, v2 / r
        for i in range(3):
            for j in range(3):
                h = (1.0 if i == j else 0.0) - n[k, i] * n[k, j]
                if beside:
                    h -= d[i] * d[j]
                hessian[k, i, j] = h / r
    return g, n, hessian
