"""The outline r ↦ h of a convex body of revolution: straight pieces and arcs that join without a corner.

r is the distance from the axis, h the height above the tip (mm).  The body is what lies above its outline, without an
end upwards.  φ is the angle of the outline from the horizontal, 0 on the axis and at most π/2; the outer normal in
(r, h) is (sin φ, −cos φ).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fem_backend.compiled import compiled
from fem_backend.geometry import kernel_arrays

STRAIGHT_PIECE, ARC_PIECE = 0.0, 1.0  # kind of a piece of the outline
UPRIGHT_ANGLE_RAD = 0.5 * math.pi  # of a cylindrical side, from the horizontal
INDENTER_WAY = (0.0, 0.0, -1.0)  # downwards, where none is given
N_GAUSS_NODES_PER_PIECE = 24  # of Gauss and Legendre on a piece: integrands are smooth or have a square root at one end
N_CONTACT_RADII = 800  # radii of contact, for the closed form


@dataclass(frozen=True, eq=False)
class Meridian:
    """Pieces (k, 8) from the axis outwards: kind, place (r, h), size, cos φ, sin φ at the start and at the end.

    The place of a straight piece is its start and its size the length; those of an arc are its centre and radius.
    The last piece is straight and has no end.
    """

    pieces: np.ndarray

    @property
    def starts(self) -> np.ndarray:
        """Distance (k,) mm from the axis where each piece starts."""
        p = self.pieces
        return p[:, 1] + np.where(p[:, 0] == ARC_PIECE, p[:, 3], 0.0) * p[:, 5]

    @property
    def widest(self) -> float:
        """Largest distance (mm) from the axis; ∞ where the last piece is not upright."""
        last = self.pieces[-1]
        return float(last[1]) if last[4] == 0.0 else math.inf

    @property
    def tightest(self) -> float:
        """The smallest radius of an arc (mm), ∞ without arcs."""
        arcs = self.pieces[self.pieces[:, 0] == ARC_PIECE, 3]
        return float(arcs.min()) if len(arcs) else math.inf

    def _piece(self, r: np.ndarray | float) -> np.ndarray:
        return np.clip(np.searchsorted(self.starts, r, side="right") - 1, 0, len(self.pieces) - 1)

    def height(self, r: np.ndarray | float) -> np.ndarray:
        """h (…) mm at distances r (…) mm from the axis, ∞ beyond the widest."""
        r = np.abs(np.asarray(r, float))
        p = self.pieces[self._piece(r)]
        beside = r - p[..., 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            straight = p[..., 2] + np.where(beside > 0.0, beside * p[..., 5] / p[..., 4], 0.0)
        arc = p[..., 2] - np.sqrt(np.maximum(p[..., 3] ** 2 - beside**2, 0.0))
        return np.where(r > self.widest, np.inf, np.where(p[..., 0] == ARC_PIECE, arc, straight))

    def slope(self, r: np.ndarray | float) -> np.ndarray:
        """dh/dr (…) at distances r (…) mm from the axis, ∞ from the widest on."""
        r = np.abs(np.asarray(r, float))
        p = self.pieces[self._piece(r)]
        beside = r - p[..., 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            arc = beside / np.sqrt(np.maximum(p[..., 3] ** 2 - beside**2, 0.0))
            straight = p[..., 5] / p[..., 4]
        return np.where(r >= self.widest, np.inf, np.where(p[..., 0] == ARC_PIECE, arc, straight))

    def caps(self, r: np.ndarray, h: np.ndarray) -> np.ndarray:
        """s (…) mm²: area over π of the surface within its points (r, h) (…) mm, 2 ∫ r dσ along the meridian."""
        ahead = self._ahead()
        k = self._piece(r)
        p = self.pieces[k]
        u, v = r - p[..., 1], h - p[..., 2]
        along = np.maximum(u * p[..., 4] + v * p[..., 5], 0.0)
        straight = along * (2.0 * p[..., 1] + along * p[..., 4])
        phi = np.arctan2(u, -v)
        arc = p[..., 1] * (phi - np.arctan2(p[..., 5], p[..., 4])) + p[..., 3] * (p[..., 4] - np.cos(phi))
        return ahead[k] + np.where(p[..., 0] == ARC_PIECE, 2.0 * p[..., 3] * arc, straight)

    def _ahead(self) -> np.ndarray:
        """s (k,) where each piece starts."""
        kind, r, _, size, c0, s0, c1, s1 = self.pieces[:-1].T
        arc = 2.0 * size * (r * (np.arctan2(s1, c1) - np.arctan2(s0, c0)) + size * (c0 - c1))
        return np.concatenate([[0.0], np.cumsum(np.where(kind == ARC_PIECE, arc, size * (2.0 * r + size * c0)))])

    def radius_of_cap(self, s: np.ndarray) -> np.ndarray:
        """Distance r (…) mm from the axis at which a cap has the area π s (…): the inverse of `caps`."""
        ahead = self._ahead()
        k = np.clip(np.searchsorted(ahead, s, side="right") - 1, 0, len(ahead) - 1)
        p, left = self.pieces[k], np.maximum(s - ahead[k], 0.0)
        size = np.where(p[..., 0] == ARC_PIECE, p[..., 3], 0.0)
        c, r0 = p[..., 4], p[..., 1]
        straight = r0 + c * left / np.maximum(r0 + np.sqrt(r0**2 + c * left), 1e-300)
        low, high = (np.arctan2(p[..., i], p[..., i - 1]) for i in (5, 7))
        first = low
        for _ in range(50):  # halving: the area grows with the angle
            phi = 0.5 * (low + high)
            more = 2.0 * size * (r0 * (phi - first) + size * (c - np.cos(phi))) > left
            low, high = np.where(more, low, phi), np.where(more, phi, high)
        return np.where(p[..., 0] == ARC_PIECE, r0 + size * np.sin(0.5 * (low + high)), straight)

    def gap(
        self, x: np.ndarray, tip: ArrayLike, direction: ArrayLike = INDENTER_WAY
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance g (…) of points x (…, 3), negative inside, n = ∇g (…, 3) and ∇∇g (…, 3, 3).

            ∇∇g = κ t⊗t + (n_r/r) e_θ⊗e_θ,   κ = 1/(ρ + g) of an arc of radius ρ, 0 of a straight piece,

        t along the meridian, e_θ around the axis, n_r/r = κ on the axis.  The `tip` (3,) is at h = 0, the axis against
        the unit vector `direction` (3,).  C¹ outside, and inside to the depth of the least radius of curvature;
        deeper inside, above a flat end, g = −h, the distance from the end.
        """
        flat, tip, direction = kernel_arrays(x, tip, direction)
        pieces = self.pieces.copy()  # that may be written to, as those of a pickled outline: one variant is compiled
        g, n, hessian = _gap(flat, tip, direction, pieces, self.starts)
        return g.reshape(x.shape[:-1]), n.reshape(x.shape), hessian.reshape(*x.shape, 3)

    def line(self, farthest: float) -> np.ndarray:
        """Points (k, 2) of the outline (r, h) mm from the axis, some `farthest` (mm) far."""
        out = [np.zeros((1, 2))]
        for kind, r, h, size, c0, s0, c1, s1 in self.pieces:
            if kind == ARC_PIECE:
                a = np.linspace(math.atan2(s0, c0), math.atan2(s1, c1), 25)[1:]
                out.append(np.column_stack([r + size * np.sin(a), h - size * np.cos(a)]))
            else:
                out.append(np.array([[r, h]]) + min(size, farthest) * np.array([[c0, s0]]))
        points = np.concatenate(out)
        return points[(points <= 2.0 * farthest).all(1)]


def meridian_outline(steps: Iterable[tuple[float, float]]) -> Meridian:
    """The meridian that begins on the axis, horizontally, and goes on by `steps` (angle φ at the end, size mm).

    A step to the angle where it begins is straight, of the length `size`; one to a larger angle an arc of that radius.
    So no joint has a corner.  Steps of no size are left out.
    """
    r, h, phi, c, s = 0.0, 0.0, 0.0, 1.0, 0.0
    pieces = []
    for angle, size in steps:
        if size <= 0.0:
            continue
        if angle == phi:
            pieces.append((STRAIGHT_PIECE, r, h, size, c, s, c, s))
            if math.isfinite(size):
                r, h = r + size * c, h + size * s
            continue
        c1, s1 = (0.0, 1.0) if angle >= UPRIGHT_ANGLE_RAD else (math.cos(angle), math.sin(angle))
        middle = r - size * s, h + size * c
        middle = (0.0 if abs(middle[0]) < 1e-15 * size else middle[0]), middle[1]
        pieces.append((ARC_PIECE, *middle, size, c, s, c1, s1))
        r, h, phi, c, s = middle[0] + size * s1, middle[1] - size * c1, angle, c1, s1
    made = np.array(pieces)
    made.setflags(write=False)
    return Meridian(made)


def half_space_force(
    meridian: Meridian, depth: ArrayLike, curvature: float, E: float, nu: float, widest: float
) -> np.ndarray:
    """F (n,) N at depths (n,) mm in an elastic half-space, by Sneddon's solution for a profile of revolution.

        g(a) = a ∫₀^{π/2} f′(a sin t) dt,   g(a) = d,   F = 2 E/(1 − ν²) ∫₀^a (d − g) dx

    f = h(r) + H r²/2 with the mean curvature H (1/mm) of the body that is pressed.  Beyond the depth g(`widest`) (mm)
    the contact radius stays `widest`.  Right to 1e-4.
    Assumptions: small strain and slope, no friction.  Source: Sneddon 1965; Popov, Heß & Willert 2019, §2.3.
    """
    d = np.atleast_1d(np.asarray(depth, float))
    a, g, below = _needed(meridian, max(curvature, 0.0), widest)
    radius = np.interp(d, g, a)
    k = np.clip(np.searchsorted(a, radius, side="right") - 1, 0, len(a) - 2)
    part = radius - a[k]
    sunk = below[k] + part * (g[k] + 0.5 * part * (g[k + 1] - g[k]) / (a[k + 1] - a[k]))
    return 2.0 * E / (1.0 - nu**2) * np.maximum(d * radius - sunk, 0.0)


def half_space_radius(meridian: Meridian, depth: ArrayLike, curvature: float, widest: float) -> np.ndarray:
    """Contact radius (n,) mm at depths (n,) mm: a of :func:`half_space_force`."""
    a, g, _ = _needed(meridian, max(curvature, 0.0), widest)
    return np.interp(np.asarray(depth, float), g, a)


@functools.lru_cache(maxsize=16)
def _needed(meridian: Meridian, curvature: float, widest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact radii a (n,) mm, depths g(a) (n,) that they need, and ∫₀^a g dx (n,)."""
    a = np.concatenate([[0.0], widest * np.geomspace(1e-5, 1.0, N_CONTACT_RADII)])
    t, w = np.polynomial.legendre.leggauss(N_GAUSS_NODES_PER_PIECE)
    starts = meridian.starts

    def needed(x: float) -> float:
        """The integral over every piece that a contact of radius x reaches."""
        ends = np.unique(np.concatenate([[0.0], np.arcsin(starts[starts < x] / x), [UPRIGHT_ANGLE_RAD]]))
        half = 0.5 * np.diff(ends)[:, None]
        r = x * np.sin(half * (t + 1.0) + ends[:-1, None])
        return float(x * ((meridian.slope(r) + curvature * r) * w * half).sum())

    g = np.array([0.0, *(needed(float(x)) for x in a[1:])])
    return a, g, np.concatenate([[0.0], np.cumsum(0.5 * (g[1:] + g[:-1]) * np.diff(a))])


@compiled()
def _away(p, r, h):  # type: ignore[no-untyped-def]
    """Distance of a point (r, h) from a piece."""
    u, v, size, c0, s0, c1, s1 = r - p[1], h - p[2], p[3], p[4], p[5], p[6], p[7]
    if p[0] == ARC_PIECE:
        if c0 * u + s0 * v >= 0.0 and c1 * u + s1 * v <= 0.0:
            return abs(np.sqrt(u * u + v * v) - size)
        return min(np.hypot(u - size * s0, v + size * c0), np.hypot(u - size * s1, v + size * c1))
    along = c0 * u + s0 * v
    return np.hypot(s0 * u - c0 * v, along - min(max(along, 0.0), size))


@compiled()
def _closest(pieces, starts, r, h):  # type: ignore[no-untyped-def]
    """The piece closest to a point (r, h): that at r, or one whose distances from the axis are near enough.

    Inside, above a flat end, it is the end, also where the side is nearer: what lies there came from below.
    """
    if h >= 0.0 and pieces[0, 0] != ARC_PIECE and len(pieces) > 1 and r <= starts[1]:
        return 0
    k = max(np.searchsorted(starts, r, side="right") - 1, 0)
    best, least = k, _away(pieces[k], r, h)
    p = k - 1
    while p >= 0 and starts[p + 1] >= r - least:
        away = _away(pieces[p], r, h)
        if away < least:
            best, least = p, away
        p -= 1
    p = k + 1
    while p < len(pieces) and starts[p] <= r + least:
        away = _away(pieces[p], r, h)
        if away < least:
            best, least = p, away
        p += 1
    return best


@compiled()
def _gap(x, tip, d, pieces, starts):  # type: ignore[no-untyped-def]
    count = len(x)
    g, n, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
    across = np.empty(3)
    for k in range(count):
        h = 0.0
        for i in range(3):
            across[i] = x[k, i] - tip[i]
            h -= across[i] * d[i]
        square = 0.0
        for i in range(3):
            across[i] += h * d[i]
            square += across[i] * across[i]
        r = np.sqrt(square)
        if r > 0.0:
            for i in range(3):
                across[i] /= r
        else:  # any direction across the axis
            low = 0
            for i in range(1, 3):
                if abs(d[i]) < abs(d[low]):
                    low = i
            for i in range(3):
                across[i] = (1.0 if i == low else 0.0) - d[low] * d[i]
            size = np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
            for i in range(3):
                across[i] /= size
        best = _closest(pieces, starts, r, h)
        u, v, size = r - pieces[best, 1], h - pieces[best, 2], pieces[best, 3]
        if pieces[best, 0] == ARC_PIECE:
            reach = max(np.sqrt(u * u + v * v), 1e-300)
            g[k], nr, nh, bend = reach - size, u / reach, v / reach, 1.0 / reach
            around = bend if pieces[best, 1] == 0.0 else nr / max(r, 1e-300)
        else:
            nr, nh = pieces[best, 5], -pieces[best, 4]
            g[k], bend = nr * u + nh * v, 0.0
            around = nr / r if nr != 0.0 and r > 0.0 else 0.0
        for i in range(3):
            n[k, i] = nr * across[i] - nh * d[i]
        for i in range(3):
            for j in range(3):
                # I = n⊗n + t⊗t + e⊗e, with t = −n_h e_r − n_r d
                t = (-nh * across[i] - nr * d[i]) * (-nh * across[j] - nr * d[j])
                e = (1.0 if i == j else 0.0) - n[k, i] * n[k, j] - t
                hessian[k, i, j] = bend * t + around * e
    return g, n, hessian
