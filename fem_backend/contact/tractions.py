"""Contact of the curved surface with rigid bodies: augmented Lagrangian, Coulomb friction, adhesion.

Π_c = ∫ (p² − λ²)/(2ε) dA₀ with the pressure p = ⟨λ − ε g⟩ per reference area, gap g and multiplier λ ≥ 0
(Wriggers 2006, §6.3.4).  ε is a multiple of the shear modulus per length, so that similarity stays exact.

On meridians the same potential is per current area, ∫ (p² − λ²)/(2ε) da: per reference area, a surface of modulus μ
that is pressed by p buckles in waves shorter than p²/(με), and all its elements may be finer than that.  Attraction is
per reference area everywhere.

Friction by return mapping over a step (Wriggers 2006, §9.2): t = P(t₀ − ε_T (Δx − Δc)) cut to |t| ≤ μ_f p, P = I − n⊗n;
it has no potential and, where points slip, an unsymmetric tangent.  A point that is touched within the step sticks from
then on only: `met`.  Adhesion has a potential, Π_a = ∫ ψ(g) dA₀.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from skfem import ElementLineP2, ElementTriP2, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefTri

from fem_backend.contact import bonded, pointwise
from fem_backend.kinematics.axisymmetric import EDGE_QUADRATURE_ORDER
from fem_backend.kinematics.bodies import Body

FACET_QUADRATURE_ORDER = 6  # twelve points a facet


class Rigid(Protocol):
    """A rigid surface: where it is, and how far it still has to go.  Lengths in mm, evaluated at all points at once."""

    def gap(self, x: np.ndarray, centre: Any, direction: Any = ...) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap g (…), positive outside of it, its gradient n (…, 3) and Hessian (…, 3, 3) at points x (…, 3).

        `centre` (3,) is its reference point, `direction` (3,) its unit way into the body, zero where it stands still.
        """

    def travel(self, x: np.ndarray, centre: Any, direction: np.ndarray) -> np.ndarray:
        """How far (…), signed, it goes along the unit `direction` until it meets points x (…, 3); ∞ beside its way."""


class Curved(Protocol):
    """The true surface that quadratic facets stand for."""

    def project(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) near the surface moved onto it."""


@dataclass(frozen=True)
class ContactSurface:
    """Quadratic facets (f, k) that may touch, shape functions N (q, k), area weights (f, q) mm², matrix places.

    Triangles have k = 6 nodes; of a meridian edges with k = 3 stand for rings, their weights hold 2πr.

    `offset` (f, q, 3) mm is what the true surface lies beyond the quadratic one: a large facet that rolls in a bowl of
    nearly its own shape would otherwise feel the error of its geometry.
    """

    facets: np.ndarray
    N: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    offset: np.ndarray


@dataclass(frozen=True)
class Adhesion:
    """Attraction σ = (W/ℓ) exp(−g/ℓ) per reference area: `work` of separation W (N/mm), `range` ℓ (mm).

    Below g = 0 it goes on as (W/ℓ)(2 − exp(g/ℓ)), C¹ and bounded.
    """

    work: float
    range: float

    def over(self, longer: float) -> Adhesion:
        """The same work over so many times the range."""
        return Adhesion(self.work, longer * self.range)


@dataclass(frozen=True)
class Pair:
    """The surface and a rigid body that it may touch: ε (f, q) MPa/mm, Coulomb coefficient (1), adhesion.

    A `soft` one never gets multipliers; a `bilateral` one holds on to the surface, p = λ − ε g of either sign, and
    rubs only where it presses.  Points with a place `held` (f, q, 3) mm relative to the reference point of the rigid
    body, nan elsewhere, are glued to it: :mod:`.bonded`.
    """

    surface: ContactSurface
    rigid: Rigid
    epsilon: np.ndarray
    friction: float = 0.0
    adhesion: Adhesion | None = None
    soft: bool = False
    held: np.ndarray | None = None
    bilateral: bool = False


@dataclass(frozen=True)
class Before:
    """Start of the step: points (f, q, 3) and centre (3,) mm, tangential traction (f, q, 3) MPa, gap (f, q) mm.

    A point that was open is in touch for a share `met` (f, q) of the step; where that is not given, for −g/(g₀ − g) of
    it: a gap that closes evenly.
    With a `pressure` (f, q) MPa friction is limited by that, not by the pressure now (Tresca): such a step
    has nearly a potential, and repeated with the pressure found it tends to Coulomb's.
    """

    points: np.ndarray
    centre: np.ndarray
    traction: np.ndarray
    gap: np.ndarray
    pressure: np.ndarray | None = None
    met: np.ndarray | None = None


@dataclass(frozen=True)
class Touch:
    """Load on a pair: centre (3,) mm, unit way `direction` (3,) into the body, λ (f, q) MPa.

    A support stands still, its direction is zero.  `raised` (f, q) multiplies ε; `before` is needed with friction.
    """

    centre: np.ndarray
    direction: np.ndarray
    multiplier: np.ndarray
    raised: np.ndarray | float = 1.0
    before: Before | None = None


@dataclass(frozen=True)
class ContactState:
    """One evaluation: energy (N mm), residual (n, 3) N, force on the rigid body (3,) N; at the points (f, q) the rest.

    Pressure p (MPa, the contact alone, negative only where it is bilateral), gap g (mm), tangential traction on the
    body (f, q, 3) MPa, whether a point slips, attraction σ ≥ 0 (MPa), all per reference area.  The energy is without
    friction, which has none.  `multiplier` is what the next augmentation takes over: p, on a meridian per current area.
    """

    energy: float
    residual: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    gap: np.ndarray
    traction: np.ndarray
    slipping: np.ndarray
    attraction: np.ndarray
    multiplier: np.ndarray


def quadratic_facets(mesh: MeshTet2, facets: np.ndarray) -> np.ndarray:
    """Nodes (f, 6) of boundary facets: three corners, then the middles of edges 01, 12, 02."""
    n = mesh.nvertices
    key = np.sort(mesh.edges, axis=0)
    key = key[0].astype(np.int64) * n + key[1]
    order = np.argsort(key)
    corners = mesh.facets[:, facets]

    def middle(i: int, j: int) -> np.ndarray:
        a, b = np.minimum(corners[i], corners[j]), np.maximum(corners[i], corners[j])
        return n + order[np.searchsorted(key[order], a.astype(np.int64) * n + b)]

    return np.stack([*corners, middle(0, 1), middle(1, 2), middle(0, 2)], axis=1)


def contact_surface(
    body: Body, facets: np.ndarray, true: Curved | None = None, order: int = FACET_QUADRATURE_ORDER
) -> ContactSurface:
    """Quadrature on the quadratic facets (f, k) of the undeformed surface, which stand for the surface of `true`."""
    facets = facets.astype(np.int64)
    N, area = _along(body, facets) if facets.shape[1] == 3 else _across(body, facets, order)
    dofs = body.free[(3 * facets[:, :, None] + np.arange(3)).reshape(len(facets), 3 * facets.shape[1])]
    points = pointwise.facet_points(facets, N, body.nodes)
    offset = np.zeros_like(points)
    if true is not None:
        offset = true.project(points.reshape(-1, 3)).reshape(points.shape) - points
    return ContactSurface(facets, N, area, body.pattern.find(dofs), offset)


def _across(body: Body, facets: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """N (q, 6) and area weights (f, q) mm² of triangles."""
    X, weights = get_quadrature(RefTri, order)
    N, dN = (np.stack([ElementTriP2().lbasis(X, a)[k] for a in range(6)]) for k in (0, 1))
    tangent = np.einsum("fai,akq->fqki", body.nodes[facets], dN)
    area = np.linalg.norm(np.cross(tangent[:, :, 0], tangent[:, :, 1]), axis=-1)
    return N.T.copy(), area * weights


def _along(body: Body, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (q, 3) and area weights (f, q) mm² of edges of a meridian, 2πr ds."""
    X, weights = get_quadrature(RefLine, EDGE_QUADRATURE_ORDER)
    N, dN = (np.stack([ElementLineP2().lbasis(X, a)[k] for a in range(3)]) for k in (0, 1))
    corners = body.nodes[facets]
    length = np.linalg.norm(np.einsum("fai,aq->fqi", corners, dN[:, 0]), axis=-1)
    return N.T.copy(), 2.0 * np.pi * (corners[:, :, 0] @ N) * length * weights


def contact_points(surface: ContactSurface, x: np.ndarray) -> np.ndarray:
    """Contact points (f, q, 3) mm at nodal positions x (n, 3)."""
    return pointwise.facet_points(surface.facets, surface.N, np.ascontiguousarray(x, float)) + surface.offset


def contact_history(pair: Pair, x: np.ndarray, touch: Touch, state: ContactState) -> Before:
    """What the next step has to know of a converged one."""
    return Before(contact_points(pair.surface, x), np.array(touch.centre, float), state.traction, state.gap)


def met(pair: Pair, before: Before, touch: Touch) -> np.ndarray | None:
    """Share (f, q) of a step that points which were open spend in touch, None for a rigid body that stands still.

    s = −g/(g₀ − g) with the gap g of the start's points to the rigid body half of its way on: the surface beside a
    contact sinks by as much as the ball has still to go (Hertz: a point with the gap r²/2R* is met at travel r²/R*).
    Until then the point follows the rigid body but for `LAG_SHARE` of its way: it sticks at Δx = (1 − LAG_SHARE (1 −
    s)) Δc.  Outside a stuck circle a surface follows by (2/π) asin(a/r) (Johnson 1985, §7.2), by 1/2 in the mean of one
    that grows from nothing and by nearly all beside one that grows little.  The gap at the end of the step would show
    nothing: contact keeps it at zero.
    """
    way = np.asarray(touch.centre, float) - np.asarray(before.centre, float)
    if not way.any():
        return None
    half = pair.rigid.gap(before.points, np.asarray(before.centre, float) + 0.5 * way, touch.direction)[0]
    return np.where(half < 0.0, -half / np.maximum(np.maximum(before.gap, 0.0) - half, 1e-300), 0.0)


def follows(pair: Pair) -> bool:
    """Whether contact acts per current area: on meridians, without friction and what holds on."""
    plain = pair.friction == 0.0 and pair.held is None and not pair.bilateral
    return plain and pair.surface.facets.shape[1] == 3


def evaluate_contact(pair: Pair, x: np.ndarray, touch: Touch, known: np.ndarray | None = None) -> ContactState:
    """Energy, residual and force at current positions x (n, 3) mm.

    Of a pair that `follows`, pressures `known` to first order (f, q) MPa say which points have a pressure λ − ε g, then
    of any sign, and stand for it where the areas change.
    Raises ValueError when a pair with friction does not know the start of the step.
    """
    if follows(pair):
        return _evaluate_rings(pair, x, touch, known)
    surface = pair.surface
    points = contact_points(surface, x)
    gap, normal, _ = pair.rigid.gap(points, touch.centre, touch.direction)
    before, motion = _before(pair, touch)
    epsilon = _epsilon(pair, touch)
    residual, force, pressure, traction, slipping, attraction, energy = pointwise.evaluate_points(
        surface.facets,
        surface.N,
        surface.weights,
        len(x),
        points,
        gap if pair.held is None else np.where(bonded.glued(pair.held), np.inf, gap),  # what is glued does not touch
        normal,
        epsilon,
        _full(touch.multiplier, gap.shape),
        float(pair.friction),
        *before,
        motion,
        *_adhesion(pair),
        pair.bilateral,
    )
    if pair.held is not None:
        t = bonded.traction(pair.held, points, np.asarray(touch.centre, float), epsilon)
        energy += bonded.energy(t, epsilon, surface.weights)
        residual -= bonded.loads(surface.facets, surface.N, surface.weights, t, len(x))
        force -= np.einsum("fq,fqi->i", surface.weights, t)
        along = (t * normal).sum(-1)
        pressure, traction = pressure + np.maximum(along, 0.0), traction + t - along[..., None] * normal
    return ContactState(energy, residual, force, pressure, gap, traction, slipping, attraction, pressure)


def add_contact_tangent(
    pair: Pair, x: np.ndarray, touch: Touch, state: ContactState, data: np.ndarray, geometric: bool = True
) -> np.ndarray:
    """Add ∂R/∂x to `data` and return ∂R/∂s (n, 3) N/mm for a rigid body moving as c + s·direction.

    k = ε n⊗n − p ∇∇g − ∂t/∂x + σ′ n⊗n + σ ∇∇g at points within reach, the whole block, symmetric or not.  Without
    `geometric` all that comes from the turning of the normal and the falling attraction is left out, which keeps the
    symmetric part positive semi-definite where nothing slips, at the price of slower convergence.
    """
    if follows(pair):
        return _tangent_of_rings(pair, x, touch, state, data, geometric)
    surface, pressure, gap = pair.surface, state.pressure, state.gap
    moving = np.zeros(x.shape)
    if pair.held is not None:
        glued, epsilon = bonded.glued(pair.held), _epsilon(pair, touch)
        bonded.bond_stiffness(pair.held, surface.N, surface.weights, surface.place, epsilon, data)
        rate = np.where(
            glued[..., None], bonded.BOND_PENALTY_FACTOR * epsilon[..., None] * np.asarray(touch.direction, float), 0.0
        )
        moving -= bonded.loads(surface.facets, surface.N, surface.weights, rate, len(x))
        pressure, gap = np.where(glued, 0.0, pressure), np.where(glued, np.inf, gap)
    active = np.nonzero(((pressure > 0) | (state.attraction > 0) | pair.bilateral).any(1))[0]
    points = (
        pointwise.facet_points(surface.facets[active], surface.N, np.ascontiguousarray(x, float))
        + surface.offset[active]
    )
    _, normal, hessian = pair.rigid.gap(points, touch.centre, touch.direction)
    start, motion = _before(pair, touch)
    if pair.friction > 0.0:
        points0, traction0, gap0, bound, met = start
        start = points0[active], traction0[active], gap0[active], bound[active], met[active]
    pointwise.tangent_at_points(
        surface.facets[active],
        surface.N,
        surface.weights[active],
        surface.place[active],
        points,
        normal,
        hessian,
        gap[active],
        pressure[active],
        _epsilon(pair, touch)[active],
        float(pair.friction),
        *start,
        motion,
        *_adhesion(pair),
        pair.bilateral,
        np.asarray(touch.direction, float),
        geometric,
        data,
        moving,
    )
    return moving


@functools.cache
def _line() -> tuple[np.ndarray, np.ndarray]:
    """∂N/∂t (q, 3) and 2π times the weights (q,) of an edge."""
    X, weights = get_quadrature(RefLine, EDGE_QUADRATURE_ORDER)
    dN = np.stack([ElementLineP2().lbasis(X, a)[1][0] for a in range(3)])
    return dN.T.copy(), 2.0 * np.pi * weights


def areas(pair: Pair, x: np.ndarray) -> np.ndarray:
    """Areas now (f, q) mm² of the points of a meridian, 2πr ds, at nodal positions x (n, 3)."""
    surface, (dN, around) = pair.surface, _line()
    length = np.linalg.norm(np.einsum("qa,fai->fqi", dN, x[surface.facets]), axis=-1)
    return around * contact_points(surface, x)[..., 0] * length


def _evaluate_rings(pair: Pair, x: np.ndarray, touch: Touch, known: np.ndarray | None) -> ContactState:
    surface = pair.surface
    points = contact_points(surface, x)
    gap, normal, _ = pair.rigid.gap(points, touch.centre, touch.direction)
    p = _full(touch.multiplier, gap.shape) - _epsilon(pair, touch) * gap
    p = np.where((p if known is None else known) > 0.0, p, 0.0)
    residual, force, pressure, energy = pointwise.evaluate_rings(
        surface.facets,
        surface.N,
        *_line(),
        surface.weights,
        np.ascontiguousarray(x, float),
        points,
        normal,
        _epsilon(pair, touch),
        _full(touch.multiplier, gap.shape),
        p,
        p if known is None else known,
    )
    attraction, slipping = np.zeros(gap.shape), np.zeros(gap.shape, bool)
    if attracts(pair):
        pull, drawn, attraction, bound = pointwise.attract(
            surface.facets, surface.N, surface.weights, len(x), gap, normal, *_adhesion(pair)
        )
        residual, force, energy = residual + pull, force + drawn, energy + bound
    return ContactState(energy, residual, force, pressure, gap, np.zeros(points.shape), slipping, attraction, p)


def _tangent_of_rings(
    pair: Pair, x: np.ndarray, touch: Touch, state: ContactState, data: np.ndarray, geometric: bool
) -> np.ndarray:
    surface = pair.surface
    points = contact_points(surface, x)
    _, normal, hessian = pair.rigid.gap(points, touch.centre, touch.direction)
    moving = np.zeros(x.shape)
    pointwise.tangent_of_rings(
        surface.facets,
        surface.N,
        *_line(),
        surface.place,
        np.ascontiguousarray(x, float),
        points,
        normal,
        hessian,
        _epsilon(pair, touch),
        _full(touch.multiplier, state.gap.shape),
        state.multiplier,
        np.asarray(touch.direction, float),
        geometric,
        data,
        moving,
    )
    if attracts(pair):
        pointwise.tangent_of_attraction(
            surface.facets,
            surface.N,
            surface.weights,
            surface.place,
            state.gap,
            normal,
            hessian,
            *_adhesion(pair),
            np.asarray(touch.direction, float),
            geometric,
            data,
            moving,
        )
    return moving


def first_touch(
    surface: ContactSurface, x: np.ndarray, rigid: Rigid, centre: np.ndarray, direction: np.ndarray
) -> float:
    """How far (mm, signed) the rigid body must still go along the unit `direction` to touch the deformed surface.

    The least travel over the quadratic facets at nodal positions x (n, 3): a grid on every facet, then ever finer
    grids on the best ones, so that the answer follows the deformation without steps; ∞ when it passes by.
    """
    if surface.facets.shape[1] == 3:
        return _first_along(surface, x, rigid, centre, direction)
    i, j = np.indices((9, 9)).reshape(2, -1)[:, [k for k in range(81) if k // 9 + k % 9 <= 8]] / 8.0
    travel = rigid.travel(np.einsum("aq,fai->fqi", _quadratic(i, j), x[surface.facets]), centre, direction)
    best = np.argsort(travel.min(1), kind="stable")[:8]
    nodes, at = x[surface.facets[best]], travel[best].argmin(1)
    at, width, least = np.stack([i[at], j[at]]), 0.2, float(travel.min())
    offsets = np.indices((7, 7)).reshape(2, -1) / 3.0 - 1.0
    for _ in range(26):
        grid = np.maximum(at[:, :, None] + width * offsets[:, None, :], 0.0)
        grid /= np.maximum(grid.sum(0), 1.0)
        travel = rigid.travel(np.einsum("afq,fai->fqi", _quadratic(*grid), nodes), centre, direction)
        at = grid[:, np.arange(len(best)), travel.argmin(1)]
        width, least = 0.5 * width, min(least, float(travel.min()))
    return least


def _first_along(
    surface: ContactSurface, x: np.ndarray, rigid: Rigid, centre: np.ndarray, direction: np.ndarray
) -> float:
    """As `first_touch`, of the edges of a meridian."""
    t = np.linspace(0.0, 1.0, 9)
    travel = rigid.travel(np.einsum("aq,fai->fqi", _on_edge(t), x[surface.facets]), centre, direction)
    best = np.argsort(travel.min(1), kind="stable")[:8]
    nodes, at, width, least = x[surface.facets[best]], t[travel[best].argmin(1)], 0.2, float(travel.min())
    for _ in range(26):
        grid = np.clip(at[:, None] + width * np.linspace(-1.0, 1.0, 7), 0.0, 1.0)
        travel = rigid.travel(np.einsum("afq,fai->fqi", _on_edge(grid), nodes), centre, direction)
        at = grid[np.arange(len(best)), travel.argmin(1)]
        width, least = 0.5 * width, min(least, float(travel.min()))
    return least


def _on_edge(t: np.ndarray) -> np.ndarray:
    """Shape functions (3, …) of a quadratic edge: ends, then the middle."""
    return np.stack([(1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0), 4.0 * t * (1.0 - t)])


def _quadratic(r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Shape functions (6, …) of the quadratic triangle at (r, s)."""
    t = 1.0 - r - s
    return np.stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * t * s])


def _full(value: np.ndarray | float, shape: tuple[int, ...]) -> np.ndarray:
    value = np.asarray(value, float)
    return np.ascontiguousarray(value if value.shape == shape else np.broadcast_to(value, shape))


def _epsilon(pair: Pair, touch: Touch) -> np.ndarray:
    return _full(np.asarray(pair.epsilon, float) * touch.raised, pair.surface.weights.shape)


Five = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _before(pair: Pair, touch: Touch) -> tuple[Five, np.ndarray]:
    """Points and traction at the start of the step and how far the rigid body has gone since; empty if frictionless."""
    if not pair.friction > 0.0:
        vectors, scalars = np.empty((0, 0, 3)), np.empty((0, 0))
        return (vectors, vectors, scalars, scalars, scalars), np.zeros(3)
    if touch.before is None:
        raise ValueError("friction needs the start of the step: Touch.before is missing")
    start = touch.before
    motion = np.asarray(touch.centre, float) - np.asarray(start.centre, float)
    points, traction = np.ascontiguousarray(start.points), np.ascontiguousarray(start.traction)
    unknown = -np.ones(start.gap.shape)
    bound = unknown if start.pressure is None else pair.friction * np.maximum(start.pressure, 0.0)
    share = unknown if start.met is None else np.ascontiguousarray(start.met)
    opened = unknown if pair.bilateral else np.ascontiguousarray(start.gap)  # which never opens
    return (points, traction, opened, bound, share), motion


def attracts(pair: Pair) -> bool:
    """Whether the rigid body draws the surface to itself."""
    return pair.adhesion is not None and pair.adhesion.work > 0.0


def _adhesion(pair: Pair) -> tuple[float, float]:
    a = pair.adhesion
    return (float(a.work), float(a.range)) if a is not None and a.work > 0.0 else (0.0, 1.0)
