"""What all convex bodies of revolution with a tip share: gap, way to the specimen, contact patch, outline.

A member derives from `OfRevolution` and says its `meridian`, its `length` and its settings.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from fem_backend.contact.tractions import ContactSurface
from fem_backend.indenters.meridian import ARC_PIECE, INDENTER_WAY, Meridian
from fem_backend.indenters.spherical_patch import EDGE_GAP_RATIO, Cap, Patch, patch_on

USUAL_LENGTH_MM = 3.0  # length (mm) that declared ranges of knobs are meant for
ARC_ELEMENT_RATIO = 1.0 / 3.0  # element size over a radius of curvature
MAX_CONTACT_ELEMENT_RATIO = 0.12  # element size over the length, at the contact
ELEMENT_GROWTH_BESIDE_BEND = 0.25  # element size over the distance from where the surface bends
# of the radius of a tip: the least element size there; finer ones turn over below deep, compressible tips
MIN_TIP_ELEMENT_RATIO = 0.2
# of a tip in the length of an indenter that is not narrower: a cone has no other size
LENGTH_IN_TIP_RADII = 10.0
SEARCH_GRID = (
    np.indices((5, 5)).reshape(2, -1).T / 2.0 - 1.0
)  # lines beside the axis, in half widths of what is searched


class Axial:
    """A rigid body of revolution about its way, of one length that all else scales with."""

    of_revolution: ClassVar[bool] = True

    @property
    def length(self) -> float:
        """What steps, penalties, forces and errors scale with (mm)."""
        raise NotImplementedError

    def on(self, specimen: Any) -> Self:
        """Itself: it takes no size from the specimen."""
        return self

    @property
    def cover(self) -> float:
        """Distance (mm) from the axis up to which a camera from above sees no surface."""
        return 5.0 / 3.0 * self.length

    @property
    def ratio(self) -> float:
        """Its length over the usual one."""
        return self.length / USUAL_LENGTH_MM

    def on_edge(self, radius: np.ndarray) -> np.ndarray:
        """It has no edge: ∞ (…)."""
        return np.full_like(radius, np.inf)

    def planes(self) -> tuple[bool, bool]:
        """It is of revolution about its path."""
        return True, True


class OfRevolution(Axial):
    """A convex rigid body of revolution about its way; its reference point is its tip, the lowest on the axis."""

    theory: ClassVar[str] = "Sneddon"
    Knobs: ClassVar[type | None] = None
    gauges: ClassVar[Mapping[str, float]] = {}

    @property
    def meridian(self) -> Meridian:
        """Its outline."""
        raise NotImplementedError

    @property
    def reach(self) -> float:
        """Distance (mm) from the first contact within which facets may touch: three times its radius, if it has one."""
        return 3.0 * self.meridian.widest

    def spacing(self, r: np.ndarray) -> np.ndarray:
        """Wanted element size (…) mm, at unit fineness, on the surface at distances r (…) mm from the axis.

        0.12 of the length, finer where the surface bends: a third of an arc's radius, growing by a quarter of the
        distance from it.  Below a rounded tip, whose contact begins with nothing, at most the larger of 0.12 r and 0.2
        of its radius.
        """
        r = np.asarray(r, float)
        h = MAX_CONTACT_ELEMENT_RATIO * self.length + ELEMENT_GROWTH_BESIDE_BEND * np.maximum(r - self.length, 0.0)
        starts = [*self.meridian.starts, math.inf]
        for k, (kind, _, _, size, *_) in enumerate(self.meridian.pieces):
            if kind == ARC_PIECE:
                beside = np.maximum(np.maximum(starts[k] - r, r - starts[k + 1]), 0.0)
                h = np.minimum(h, ARC_ELEMENT_RATIO * size + ELEMENT_GROWTH_BESIDE_BEND * beside)
                if starts[k] == 0.0:
                    h = np.minimum(h, np.maximum(MAX_CONTACT_ELEMENT_RATIO * r, MIN_TIP_ELEMENT_RATIO * size))
        return h

    def on_edge(self, radius: np.ndarray) -> np.ndarray:
        """How far contacts of a radius (…) mm reach onto a rounded edge, in elements of unit fineness there.

        (a − r_k)/h of the arc from r_k > 0 that is less than an element away; ∞ where none is.
        """
        a, starts = np.asarray(radius, float), [*self.meridian.starts, math.inf]
        out = np.full_like(a, np.inf)
        for k, (kind, _, _, size, *_) in enumerate(self.meridian.pieces):
            if kind == ARC_PIECE and starts[k] > 0.0:
                h = ARC_ELEMENT_RATIO * size
                there = (a > starts[k] - h) & (a < starts[k + 1] + h)
                out = np.where(there, np.maximum(a - starts[k], 0.0) / h, out)
        return out

    def gap(
        self, x: np.ndarray, centre: ArrayLike, direction: ArrayLike = INDENTER_WAY
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance g (…), n = ∇g (…, 3), ∇∇g (…, 3, 3) at points x (…, 3): see :meth:`.Meridian.gap`."""
        return self.meridian.gap(x, centre, direction)

    def travel(self, x: np.ndarray, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (…) mm, signed, it goes along its unit `direction` until it meets points x (…, 3): s = h(r) + d·v.

        v = x − c; ∞ for points beside its way.
        """
        v = x - np.asarray(centre, float)
        along = v @ np.asarray(direction, float)
        return along + self.meridian.height(np.linalg.norm(v - along[..., None] * direction, axis=-1))

    def swept(self, points: np.ndarray, start: np.ndarray, end: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Whether points (…, 3) lie inside somewhere between two places of the tip (3,): inside at the lower of them.

        It has no end upwards, so what it holds higher up it holds there, too.
        """
        lower = start if (start - end) @ direction > 0.0 else end
        return self.travel(points, lower, direction) < 0.0

    def first_contact(self, specimen: Any, through: ArrayLike, direction: ArrayLike) -> np.ndarray:
        """Tip (3,) mm where it first touches the undeformed convex specimen on the line through `through` (3,).

        Over all lines along its way at y (2,) mm beside the axis, the least of h(|y|) + σ(y), with σ where the line
        enters the specimen: convex in y.  Raises ValueError where it passes by.
        """
        if hasattr(specimen, "first_contact"):  # not convex: it knows
            return specimen.first_contact(self, through, direction)
        origin, d = np.asarray(through, float), np.asarray(direction, float)
        d = d / np.linalg.norm(d)
        return _meeting(self, specimen, tuple(origin.tolist()), tuple(d.tolist()))[0].copy()

    def contact(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the specimen on the axis, about which the contact grows; the first one where that misses it.

        Where a flat end is tilted its edge touches first, but the whole end soon after.
        """
        tip, d = np.asarray(touch, float), np.asarray(direction, float)
        convex = not hasattr(specimen, "first_contact")
        at = _entry(specimen, tip[None], d)[0] if convex else _traced(specimen, tip, d, self.length)
        if np.isfinite(at):
            return tip + at * d
        return self.first_touched(specimen, touch, direction)

    def first_touched(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Point (3,) of the specimen that it touches first, with the tip at `touch` (3,)."""
        if hasattr(specimen, "first_touched"):  # not convex: it knows
            return specimen.first_touched(self, touch, direction)
        return _meeting(self, specimen, tuple(map(float, touch)), tuple(map(float, direction)))[1].copy()

    def held(self, points: np.ndarray, touch: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        """It lets go of everything."""
        return None

    def normal(self, specimen: Any, touch: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Its axis (3,), out of the specimen."""
        return -np.asarray(direction, float)

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
        """Contact patch, see :func:`.spherical_patch.patch_on`; `axis` (3,) is its own, out of the specimen.

        The edge is found from gaps of 0.06 of the length, or of the distance of the outermost touching point from the
        axis where that is less.
        """
        meridian, up = self.meridian, np.asarray(axis, float)

        def seen(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            g, n, _ = meridian.gap(d, np.zeros(3), -up)
            d = d - g[..., None] * n
            h = d @ up
            return g, meridian.caps(np.linalg.norm(d - h[..., None] * up, axis=-1), h)

        v = np.einsum("qa,fai->fqi", surface.N, x[surface.facets])[pressure > 0.0] - centre
        beside = np.linalg.norm(v - (v @ up)[:, None] * up, axis=-1)
        near = EDGE_GAP_RATIO * min(self.length, max(float(beside.max(initial=0.0)), 1e-3 * self.length))
        rounded = bool(meridian.pieces[0, 0] == ARC_PIECE)
        cap = Cap(seen, meridian.radius_of_cap, near, rounded)
        return patch_on(surface, x, pressure, centre, cap, up, planes, attraction=attraction)

    def outline(self, centre: np.ndarray, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Closed line (k, 2) mm of its cut by a plane through its axis, of the unit vectors `across` (2, 3).

        Upwards it is cut off where it is three times as high, or wide, as its length.
        """
        up = -(across @ np.asarray(direction, float))
        up /= max(float(np.linalg.norm(up)), 1e-300)
        r, h = self.meridian.line(3.0 * self.length).T
        right = r[:, None] * np.array([up[1], -up[0]]) + h[:, None] * up
        left = -r[:, None] * np.array([up[1], -up[0]]) + h[:, None] * up
        return across @ centre + np.concatenate([right, left[::-1]])

    def effective_radius(self, curvature: float) -> float:
        """R* (mm) of a sphere of its length that meets a specimen of mean curvature H (1/mm): 1/R* = 1/L + H.

        No sphere meets a half-space as it does: an order of magnitude for errors.
        """
        return 1.0 / (1.0 / self.length + curvature)

    def contact_radius(self, depth: np.ndarray, curvature: float) -> np.ndarray:
        """An order of magnitude, √(R* d) (mm) at depths d (mm)."""
        return np.sqrt(self.effective_radius(curvature) * np.asarray(depth, float))

    def force(self, depth: np.ndarray, curvature: float, E: float, nu: float) -> np.ndarray | None:
        """No closed form."""
        return None

    def modulus(self, force: np.ndarray, depth: np.ndarray, curvature: float, nu: float) -> np.ndarray | None:
        """Young's modulus (MPa) that has these forces (N) at these depths (mm) by the closed form, if there is one."""
        unit = self.force(np.asarray(depth, float), curvature, 1.0, nu)
        return None if unit is None else np.asarray(force, float) / unit

    def adhesive_fit(self, travel: np.ndarray, force: np.ndarray, curvature: float) -> dict[str, float]:
        """Nothing: there is no closed form with adhesion."""
        return {}

    def strain(self, depth: np.ndarray | float) -> np.ndarray | float | None:
        """Not known."""
        return None


@functools.lru_cache(maxsize=256)
def _meeting(
    indenter: OfRevolution, specimen: Any, through: tuple[float, ...], direction: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Tip (3,) at the first contact and the point (3,) that is touched; ValueError where it passes by.

    A grid of 5 × 5 lines beside the axis goes to its best one, and is halved where that is the middle or beside it:
    of a convex function nothing is lost.  Where the middle one is as good as its surroundings on both sides, it is it.
    """
    d = np.array(direction)
    origin = np.array(through) - (np.array(through) @ d) * d
    across = np.linalg.svd(d[None])[2][1:]
    scale = 2.0 * specimen.largest + float(np.linalg.norm(origin))
    width = min(indenter.meridian.widest, 2.0 * scale)

    def way(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        entry = _entry(specimen, origin + y @ across, d)
        return entry + indenter.meridian.height(np.linalg.norm(y, axis=-1)), entry

    def found(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        total, entry = (v[0] for v in way(y[None]))
        return origin + total * d, origin + y @ across + entry * d

    ring = 1e-3 * width * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    total = way(ring)[0]
    if np.isfinite(total[0]):
        even = np.abs(total[1::2] - total[2::2]) <= 4e-15 * scale
        if np.all(even | ~np.isfinite(total[1::2])) and np.all(total >= total[0]):
            return found(np.zeros(2))
    middle, window = np.zeros(2), width
    if not np.isfinite(total[0]):  # begin above the specimen
        middle = -(across @ origin)
        middle *= min(1.0, 0.999 * indenter.meridian.widest / max(float(np.linalg.norm(middle)), 1e-300))
    while window > 1e-9 * width:
        grid = middle + window * SEARCH_GRID
        total = way(grid)[0]
        k = int(np.argmin(np.where(SEARCH_GRID.any(1), total, total - 1e-16 * scale)))
        if not np.isfinite(total[k]):
            if window < 1e-3 * width:
                break
            window *= 0.5
            continue
        inner = np.abs(SEARCH_GRID[k]).max() < 1.0
        window, middle = (0.5 * window if inner else window), grid[k]
    if not np.isfinite(way(middle[None])[0][0]):
        line = f"the line through {list(through)} along {list(direction)}"
        raise ValueError(f"a {indenter.noun} on {line} passes by the body")  # type: ignore[attr-defined]
    return found(middle)


def _entry(specimen: Any, points: np.ndarray, d: np.ndarray) -> np.ndarray:
    """How far (n,) mm along d (3,) lines through points (n, 3) enter a convex specimen; ∞ where they miss it.

    Steps of the secant of the distance, which is convex along a line: they never pass the specimen.
    """
    d = np.asarray(d, float)
    far = -(points @ d) - 4.0 * specimen.largest - np.linalg.norm(points - (points @ d)[:, None] * d, axis=1)
    s = far.copy()
    distance, slope = -specimen.depth(points + s[:, None] * d), np.full(len(s), -1.0)
    least, out = 4e-16 * (np.abs(far) + specimen.largest), np.full(len(s), np.inf)
    left = np.arange(len(s))  # lines that are neither at the specimen nor known to miss it
    for _ in range(100):
        step = -distance / slope
        ends = (distance <= least) | (step <= 1e-16 * np.abs(far[left]))
        out[left[ends]] = (s + step)[ends]
        left, s, distance, step, least = (v[~ends] for v in (left, s, distance, step, least))
        if not len(left):
            break
        s = s + step
        now = -specimen.depth(points[left] + s[:, None] * d)
        slope = (now - distance) / step
        on = slope < 0.0
        left, s, distance, slope, least = (v[on] for v in (left, s, now, slope, least))
        if not len(left):
            break
    return out


def _traced(specimen: Any, tip: np.ndarray, d: np.ndarray, most: float) -> float:
    """How far (mm) along d (3,) a specimen of any shape begins behind a point outside (3,); ∞ beyond `most` (mm).

    Steps as long as the distance, which no surface lies within.
    """
    s, least = 0.0, 1e-9 * most
    for _ in range(200):
        gap = -float(specimen.depth((tip + s * d)[None])[0])
        s += max(gap, 0.0)
        if gap <= least or s > most:
            break
    return s if s <= most else np.inf
