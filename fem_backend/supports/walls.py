"""Plane and round rigid walls that a specimen with flat base and upright side rests on, sticks to or slides along."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from fem_backend.contact.tractions import ContactSurface, Pair, contact_surface
from fem_backend.geometry import NO_MOTION
from fem_backend.kinematics.bodies import Body
from fem_backend.supports.holding import Holding
from rso.contract import Drawn, knob

WALL_PENALTY_RATIO = 2e4  # ε h/μ, h the smallest size of the specimen: a base rests on few elements of a fifth of that
# of that size, by which a plane that lets go is above the base: seated, its whole base presses first
LIFTED_PLANE_SHARE = 1e-9
ON_SIDE_TOLERANCE = 1e-9  # of the half width: nodes this near the side are on its rims
BONDED, SLIP, GAP = "bonded", "slip", "gap"  # held in all directions; in the normal one; touched from one side


@dataclass(frozen=True)
class Plane:
    """The plane z = `height` (mm), rigid below the specimen."""

    height: float = 0.0
    stride: float = 1.0

    def gap(
        self, x: np.ndarray, centre: ArrayLike = NO_MOTION, direction: ArrayLike = NO_MOTION
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g = z − height, its gradient e_z and its Hessian 0 at points x (…, 3)."""
        n = np.zeros(x.shape)
        n[..., 2] = 1.0
        return x[..., 2] - self.height, n, np.zeros((*x.shape, 3))

    def travel(self, x: np.ndarray, centre: ArrayLike, direction: np.ndarray) -> np.ndarray:
        """How far (…) mm it goes along the unit `direction` to points x (…, 3); ∞ along the plane."""
        along = float(direction[2])
        return (x[..., 2] - self.height) / along if along else np.full(x.shape[:-1], np.inf)


@dataclass(frozen=True)
class Wall:
    """The cylinder of a `radius` (mm) about the z axis, rigid around the specimen."""

    radius: float
    stride: float = 1.0

    def gap(
        self, x: np.ndarray, centre: ArrayLike = NO_MOTION, direction: ArrayLike = NO_MOTION
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g = radius − r, its gradient −e_r and its Hessian −e_t⊗e_t/r at points x (…, 3)."""
        r = np.maximum(np.hypot(x[..., 0], x[..., 1]), 1e-300)
        out, across = np.zeros(x.shape), np.zeros(x.shape)
        out[..., 0], out[..., 1] = x[..., 0] / r, x[..., 1] / r
        across[..., 0], across[..., 1] = -out[..., 1], out[..., 0]
        return self.radius - r, -out, -across[..., :, None] * across[..., None, :] / r[..., None, None]

    def travel(self, x: np.ndarray, centre: ArrayLike, direction: np.ndarray) -> np.ndarray:
        """∞ (…): it goes nowhere."""
        return np.full(x.shape[:-1], np.inf)


@dataclass(frozen=True)
class Yielding:
    """The knob of a base that gives way."""

    substrate_compliance: float = knob(
        "displacement of the base per pressure on what is below it",
        "mm/MPa",
        0.0,
        1e6,
        neutral=0.0,
        scope="mounting",
        typical=1.0,
        plausible=(0.1, 20.0),
        label="substrate that yields",
    )


@dataclass(frozen=True)
class Walls(Holding):
    """Base and side of a specimen, each bonded, slipping, touched from one side or free; a base class, no member.

    `rubs` is the Coulomb coefficient of all that is not bonded, `yields` (mm/MPa) the compliance of the base: a Winkler
    foundation, p = −u_z/`yields` per undeformed area, which pulls too.  What slips without friction on a plane is held
    in its normal; with friction, or on the round wall of a model in space, a contact of both signs keeps it there by a
    penalty and multipliers.
    """

    words: ClassVar[str]
    rubs: float = 0.0
    yields: float = 0.0

    parts: ClassVar[tuple[str, ...]] = ("base",)

    @property
    def described(self) -> str:
        """Where the specimen is."""
        return self.words

    def drawn(self, specimen: Any, way: np.ndarray, wide: float) -> list[Drawn]:
        """The plane below and the wall beside the specimen, where it has them."""
        radius, height = min(self.wall(specimen), wide), specimen.height
        plane = ((-radius, 0.0), (radius, 0.0))
        found = [Drawn("support", plane, self.described)] if "base" in self.grips() else []
        if "side" in self.grips():
            found.append(Drawn("support", ((radius, 0.0), (radius, height))))
            found.append(Drawn("support", ((-radius, height), (-radius, 0.0))))
        return found

    def grips(self) -> Mapping[str, str]:
        """How it meets each part of the surface that it meets."""
        raise NotImplementedError

    def wall(self, specimen: Any) -> float:
        """Radius (mm) of the wall around a specimen."""
        return specimen.half_width

    def refusal(self, specimen: Any) -> str | None:
        """Only a specimen with the parts that it meets."""
        missing = [part for part in self.parts if part not in specimen.parts]
        if not missing:
            return None
        return f'support.kind = "{self.name}": a {specimen.name} has no flat {missing[0]}; take "fixed"'

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """Components (n, 3): all of what is bonded, the normal one of what slips; see the class."""
        held, flat = np.zeros(X.shape, bool), not X[:, 1].any()
        for part, how in self.grips().items():
            nodes, normal = surface[_nodes(specimen, part, X[surface])], _normal(part)
            if how == BONDED:
                held[nodes] = True
                if part == "base" and self.yields:
                    held[surface[specimen.part("base", X[surface])], 2] = False
            elif not self._touches(part, how, flat):
                held[nodes, normal] = True
        if not flat and BONDED not in self.grips().values():
            _pinned(held, specimen, X, surface, "side" in self.grips())
        return held

    def surfaces(self, specimen: Any, body: Body, facets: np.ndarray) -> tuple[ContactSurface, ...]:
        """What it touches: see the class."""
        middle = body.nodes[facets].mean(1)
        return tuple(
            contact_surface(body, facets[specimen.part(part, middle)], specimen)
            for part in self._touching(facets.shape[1] == 3)
        )

    def pairs(
        self,
        nominal: Any,
        specimen: Any,
        surfaces: tuple[ContactSurface, ...],
        knobs: Any,
        mu: float,
        length: float,
        soft: bool,
    ) -> tuple[Pair, ...]:
        """The plane below and the wall around the specimen as it is."""
        out: list[Pair] = []
        grips, parts = self.grips(), self._touching(surfaces[0].N.shape[1] == 3) if surfaces else []
        for surface, part in zip(surfaces, parts, strict=True):
            how, founded = grips[part], part == "base" and self.yields > 0.0
            epsilon = np.full(
                surface.weights.shape, 1.0 / self.yields if founded else WALL_PENALTY_RATIO * mu / specimen.smallest
            )
            above = LIFTED_PLANE_SHARE * specimen.smallest if how == GAP else 0.0
            rigid = Plane(above) if part == "base" else Wall(self.wall(specimen))
            rubs = 0.0 if how == BONDED else self.rubs
            out.append(Pair(surface, rigid, epsilon, rubs, None, soft or founded, bilateral=how != GAP))
        return tuple(out)

    def _touching(self, flat: bool) -> list[str]:
        """Parts that a contact keeps in place, in a `flat` model of the meridian or in space."""
        return [part for part, how in self.grips().items() if self._touches(part, how, flat)]

    def _touches(self, part: str, how: str, flat: bool) -> bool:
        """Whether a contact keeps a part in place, rather than held nodes."""
        founded = part == "base" and self.yields > 0.0
        return how == GAP or founded or (how == SLIP and (self.rubs > 0.0 or (part == "side" and not flat)))


def _normal(part: str) -> int:
    """Component of the normal on a meridian: z of the base, r of the side."""
    return 2 if part == "base" else 0


def _nodes(specimen: Any, part: str, X: np.ndarray) -> np.ndarray:
    """Which of the nodes X (n, 3) of the surface lie on a part, its rims included."""
    on = specimen.part(part, X)
    if part == "side":
        on = on | (np.hypot(X[:, 0], X[:, 1]) >= specimen.half_width * (1.0 - ON_SIDE_TOLERANCE))
    return on


def _pinned(held: np.ndarray, specimen: Any, X: np.ndarray, surface: np.ndarray, round_wall: bool) -> None:
    """Take the rigid motions in the plane from a body that slides in space: its middle stays, and does not turn.

    Planes of symmetry hold the same nodes; where the indenter drags the body along, the middle carries that.
    """
    base = surface[specimen.part("base", X[surface])]
    if not round_wall:
        held[base[np.argmin(np.hypot(X[base, 0], X[base, 1]))], :2] = True
    held[base[np.argmax(X[base, 0])], 1] = True
