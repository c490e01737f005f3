"""The specimen lies unconstrained in a bowl of its own shape, a clearance wider, with friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator

from fem_backend import members
from fem_backend.compiled import compiled
from fem_backend.contact.tractions import ContactSurface, Pair, contact_surface
from fem_backend.geometry import NO_MOTION, EllipsoidShape, closest_point, kernel_arrays
from fem_backend.kinematics.bodies import Body
from fem_backend.supports.support import SUPPORTS
from rso.contract import Drawn, knob

# ε R/μ; pressures are far smaller than below the indenter, a stiff one would be felt point by point
BOWL_PENALTY_RATIO = 8.0
BOWL_QUADRATURE_ORDER = 14  # 42 points on the large facets of the lower half: contact with the bowl spreads gradually
SEMI_AXIS_TO_LIP = 35.0  # vertical semi-axis over the lip of a bowl: 1 mm for the usual body
USUAL_CLEARANCE_MM, USUAL_BOWL_FRICTION = 1.0, 0.2  # mm, 1: where nobody says otherwise


@SUPPORTS.register
@dataclass(frozen=True)
class BowlSupport:
    """Unilateral contact with a rigid `Bowl`; None: the knob's default."""

    wide: float | None = None
    friction_of: float | None = None

    class Table(members.MemberTable):
        """{ kind = "bowl", clearance = 1.0, friction = 0.2 }"""

        kind: Literal["bowl"] = "bowl"
        """The specimen lies in a bowl of its own shape."""
        clearance: (
            Annotated[float, BeforeValidator(members.above(0.0, "must be positive")), members.read_in("mm")] | None
        ) = None
        """Semi-axes of the bowl minus those of the specimen, mm."""
        friction: Annotated[float, BeforeValidator(members.at_least(0.0, "must be >= 0"))] | None = None
        """Coulomb friction between bowl and specimen."""

        def build(self) -> BowlSupport:
            """The support of these settings."""
            return BowlSupport(self.clearance, self.friction)

    @dataclass(frozen=True)
    class Knobs:
        """Knobs that exist only in a bowl."""

        bowl_clearance: float = knob(
            "semi-axes of the bowl minus those of the body",
            "mm",
            1e-8,
            1e6,
            default=USUAL_CLEARANCE_MM,
            group="bowl",
            scope="mounting",
            typical=1.0,
            plausible=(0.2, 4.0),
            label="clearance of the bowl",
        )
        bowl_friction: float = knob(
            # from where it slides under most loads to where it sticks
            "Coulomb friction between bowl and body",
            "1",
            0.0,
            5.0,
            default=USUAL_BOWL_FRICTION,
            group="bowl",
            plausible=(0.1, 0.4),
            label="friction in the bowl",
        )

    name: ClassVar[str] = "bowl"
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "bowl",
            ("CLEARANCE",),
            ("mm",),
            "it lies in a bowl so much larger in each semi-axis",
            settings=lambda c: {"support": {"kind": "bowl", "clearance": c, "friction": USUAL_BOWL_FRICTION}},
            guess="its friction",
        ),
    )
    lengths: ClassVar[tuple[str, ...]] = ("bowl_clearance",)
    gauges: ClassVar[Mapping[str, float]] = {}
    loose: ClassVar[bool] = True
    variant: ClassVar[str] = "bowl"
    words: ClassVar[str] = "in a bowl"
    group: ClassVar[str] = "bowl"
    seconds: ClassVar[tuple[float, float, float]] = (51.0, 31.0, 7.0)
    of_revolution: ClassVar[bool] = True
    way: ClassVar[float] = 1.0  # its seconds hold that
    marks: ClassVar[tuple[str, ...]] = ("rolling",)

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings; clearance and friction are knobs."""
        return {"kind": self.name}

    @property
    def described(self) -> str:
        """Its clearance and friction."""
        clearance = members.length_words(USUAL_CLEARANCE_MM if self.wide is None else self.wide)
        friction = USUAL_BOWL_FRICTION if self.friction_of is None else self.friction_of
        return f"in a bowl {clearance} larger all round, friction {friction:.3g}"

    def drawn(self, specimen: Any, way: np.ndarray, wide: float) -> list[Drawn]:
        """The lower half of its ellipse."""
        room = USUAL_CLEARANCE_MM if self.wide is None else self.wide
        s = specimen.semi_axes + room
        turn = np.linspace(-np.pi, 0.0, 61)
        x, z = np.cos(turn) / np.linalg.norm(way / s[:2]), room + s[2] * np.sin(turn)
        below = z <= 0.0
        return [Drawn("support", tuple(zip(x[below].tolist(), z[below].tolist(), strict=True)), self.described)]

    def defaults(self) -> Mapping[str, float]:
        """Clearance (mm) and friction of the table."""
        given = {"bowl_clearance": self.wide, "bowl_friction": self.friction_of}
        return {k: v for k, v in given.items() if v is not None}

    def refusal(self, specimen: Any) -> str | None:
        """Only a body with semi-axes has a bowl of its own shape."""
        if isinstance(specimen, EllipsoidShape):
            return None
        return f'support.kind = "bowl" has the shape of the specimen, an ellipsoid; there is none of a {specimen.name}'

    def dimensions(self) -> Mapping[str, float]:
        """Its clearance is a knob by itself."""
        return {}

    def actual(self, knobs: Any) -> BowlSupport:
        """Knobs change its pairs alone."""
        return self

    def absent(self, specimen: Any) -> frozenset[str]:
        """All of its knobs count."""
        return frozenset()

    def confines(self, specimen: Any) -> Any:
        """It leaves it as it is."""
        return specimen

    def offered(self, specimen: Any) -> bool:
        """It may be tried."""
        return True

    def same(self, other: Any, specimen: Any) -> bool:
        """No other support is a bowl."""
        return isinstance(other, BowlSupport)

    def planes(self) -> tuple[bool, bool]:
        """As symmetric as the specimen."""
        return True, True

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """Nothing (n, 3)."""
        return np.zeros(X.shape, bool)

    def surfaces(self, specimen: Any, body: Body, facets: np.ndarray) -> tuple[ContactSurface, ...]:
        """The lower part of the specimen."""
        lower = specimen.part("lower", body.nodes[facets].mean(1))
        return (contact_surface(body, facets[lower], specimen, BOWL_QUADRATURE_ORDER),)

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
        """The bowl touches the lowest point of the specimen as it is; its lip is that of the nominal one."""
        inner, centre = tuple(specimen.semi_axes + knobs.bowl_clearance), (0.0, 0.0, knobs.bowl_clearance)
        epsilon = np.full(surfaces[0].weights.shape, BOWL_PENALTY_RATIO * mu / length)
        bowl = Bowl(inner, centre, lip=nominal.c / SEMI_AXIS_TO_LIP)
        return (Pair(surfaces[0], bowl, epsilon, knobs.bowl_friction, None, soft),)

    def friction(self, values: Mapping[str, float]) -> float:
        """Coulomb coefficient of the wall."""
        return values.get("bowl_friction", USUAL_BOWL_FRICTION)

    def holding(self) -> BowlSupport:
        """Any bowl: it holds no node."""
        return BowlSupport()

    def clearance(self, knobs: Any) -> float:
        """Room (mm) beside the specimen."""
        return knobs.bowl_clearance

    def sinking(self, specimen: Any, length: float, knobs: Any) -> float:
        """(R g/(b c))^(1/3), at most 1: clearance g, semi-axes b and c, Hertz on both sides."""
        return min((length * knobs.bowl_clearance / (specimen.b * specimen.c)) ** (1.0 / 3.0), 1.0)

    def anchored(self, knobs: Any) -> dict[str, float | None]:
        """The clearance (mm)."""
        return {"clearance": knobs.bowl_clearance}

    def from_anchor(self, words: Mapping[str, Any]) -> dict[str, float]:
        """A frictionless bowl of that clearance."""
        return {"bowl_clearance": words["clearance"], "bowl_friction": 0.0}

    def revised(self, specimen: Any) -> bool:
        """The lip of every bowl used to be 1 mm."""
        return specimen.c != SEMI_AXIS_TO_LIP


@dataclass(frozen=True)
class Bowl:
    """Rigid bowl: the body lies inside the ellipsoid of `semi_axes` (mm) around `centre`, below z = `rim_z` (mm).

    The gap is the distance from the ellipsoid, positive inside.  Above the rim the wall bends away,
    g + ⟨z − rim⟩²/(2·lip), so that a body sagging over the edge leaves it C¹; with no rim it would be held all round.
    """

    semi_axes: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rim_z: float = 0.0
    lip: float = 1.0

    @property
    def stride(self) -> float:
        """How far (mm) a step of a body that lies on it may lead, and what shows such steps from round-off: the lip."""
        return self.lip

    def gap(
        self, x: np.ndarray, centre: ArrayLike = NO_MOTION, direction: ArrayLike = NO_MOTION
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g (…), its gradient n (…, 3), which points to the body, and Hessian (…, 3, 3) at points x (…, 3).

        |n| = 1 below the rim.  The bowl stands where its own centre says: `centre` and `direction` are not used.
        Closest point y_i = s_i² x_i/(s_i² + τ), Σ (y_i/s_i)² = 1, largest root τ (Eberly 2013, §4).
        """
        flat, own, s = kernel_arrays(x, self.centre, self.semi_axes)
        g, n, hessian = _bowl_gap(flat, own, s, float(self.rim_z), float(self.lip))
        return g.reshape(x.shape[:-1]), n.reshape(x.shape), hessian.reshape(*x.shape, 3)

    def travel(self, x: np.ndarray, centre: ArrayLike, direction: np.ndarray) -> np.ndarray:
        """How far (…) mm, signed, the bowl goes along the unit `direction` until its wall first meets points x (…, 3).

        The larger root of |x − c − s d|_s = 1 in the scaled frame; ∞ for points that pass outside or above the rim.
        """
        v, d = (x - np.asarray(self.centre)) / self.semi_axes, np.asarray(direction, float) / self.semi_axes
        a, b, c = d @ d, v @ d, (v * v).sum(-1) - 1.0
        root = b * b - a * c
        s = (b + np.sqrt(np.maximum(root, 0.0))) / a
        meets = (root >= 0.0) & (x[..., 2] - s * direction[2] <= self.rim_z)
        return np.where(meets, s, np.inf)


@compiled()
def _bowl_gap(x, c, s, rim, lip):  # type: ignore[no-untyped-def]
    count = len(x)
    g, n, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
    y, v, N, A = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(count):
        for i in range(3):
            v[i] = x[k, i] - c[i]
        tau = closest_point(v, s, y)
        size, curved = 0.0, 0.0
        for i in range(3):
            N[i] = y[i] / (s[i] * s[i])
            size += N[i] * N[i]
            A[i] = 1.0 / max(1.0 + tau / (s[i] * s[i]), 1e-12)  # bounded where the closest point is not unique
            curved += A[i] * N[i] * N[i]
        size = np.sqrt(size)
        g[k] = -tau * size
        for i in range(3):
            n[k, i] = -N[i] / size
        # ∂y/∂x = A − AN⊗AN/(N·AN), ∇∇g = −(I − n⊗n) D ∂y/∂x/|N| with D = 1/s²
        for i in range(3):
            for j in range(3):
                first = (A[i] if i == j else 0.0) - A[i] * N[i] * A[j] * N[j] / curved
                hessian[k, i, j] = first / (s[i] * s[i])
        for j in range(3):
            across = 0.0
            for i in range(3):
                across += n[k, i] * hessian[k, i, j]
            for i in range(3):
                hessian[k, i, j] = -(hessian[k, i, j] - n[k, i] * across) / size
        above = x[k, 2] - rim
        if above > 0.0:
            g[k] += 0.5 * above * above / lip
            n[k, 2] += above / lip
            hessian[k, 2, 2] += 1.0 / lip
    return g, n, hessian
