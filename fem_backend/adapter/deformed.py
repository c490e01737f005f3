"""The deformed body of a run in colour: vertical sections through the contact, and the surface in the last state.

A body of revolution is its meridian, a part model its border on the plane of symmetry; the section of a whole model
is that of the undeformed body, whose points are followed: all three are made of the same material in every frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fem_backend import post
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.kinematics.bodies import Body
from fem_backend.materials import response
from fem_backend.simulation.assembly import Placement
from fem_backend.simulation.initial_state import InitialState
from fem_backend.solver.load_steps import LoadPoint
from rso.contract import DeformedBody, DeformedFrame, DeformedSurface

MAX_FRAMES = 10  # of the loading
FIELD_UNITS = {"von Mises stress": "MPa", "pressure": "MPa"}  # of what is drawn in colour
HALF_TURN_ANGLES_RAD = np.linspace(0.0, np.pi, 19)  # where a meridian stands in the surface of its body, one half of it
MIN_STRAIGHT_EDGES = 40  # so many edges of a meridian and more are drawn as one straight piece each
TRIANGLE_PIECES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # pieces of a quadratic triangle


def state_fields(on: InitialState, point: LoadPoint) -> post.Fields:
    """Stress and stretch at the quadrature points of one state, with the history that led there."""
    system, load = on.system, point.load
    H = point.evaluation.H
    state = response.state(system.body, system.material, H, load.history, load.dt, system.scale)
    return post.stress_fields(system.body, point.evaluation.u, system.material, state=state)


def deformed(
    placement: Placement, points: Sequence[LoadPoint], on: Sequence[InitialState], force: np.ndarray
) -> DeformedBody:
    """Sections of the loading, the way to the deepest of the `points`, solved `on` their meshes; `force` (k,) N."""
    across = 0 if placement.meridian or placement.planes[1] or not placement.planes[0] else 1
    axes = np.eye(3)[[across, 2]]
    frames = []
    for k in _loading([p.travel for p in points]):
        at, body, u = points[k], on[k].system.body, points[k].evaluation.u
        nodal = _nodal(on[k], at)
        nodes, triangles = _section(body, placement, across)
        touch = at.load.pressing
        frames.append(
            DeformedFrame(
                travel=float(at.travel),
                force=float(force[k]),
                points=(nodes @ (body.nodes + u)) @ axes.T,
                triangles=triangles,
                fields={name: nodes @ v for name, v in nodal.items()},
                indenter=np.asarray(placement.indenter.outline(touch.centre, touch.direction, axes), float),
                mirrored=placement.meridian or bool(placement.planes[across]),
            )
        )
    surface = _surface(placement, points[k], on[k]) if frames else None
    return DeformedBody(f"{'xy'[across]} to the right", FIELD_UNITS, tuple(frames), surface)


def _loading(travels: Sequence[float]) -> list[int]:
    """At most `MAX_FRAMES` points on the way to the deepest one, that one the last, about evenly spaced."""
    way = [k for k in range(len(travels)) if travels[k] > max([0.0, *travels[:k]])]
    if len(way) <= MAX_FRAMES:
        return way
    s = np.array(travels)[way]
    wanted = np.linspace(0.0, s[-1], MAX_FRAMES + 1)[1:]
    return [way[k] for k in sorted({int(np.argmin(np.abs(s - w))) for w in wanted})]


def _nodal(on: InitialState, point: LoadPoint) -> dict[str, np.ndarray]:
    """The fields of `FIELD_UNITS` at the nodes (n,)."""
    nodal = post.nodal(on.system.body, state_fields(on, point))
    return {"von Mises stress": nodal.von_mises, "pressure": -np.trace(nodal.cauchy, axis1=-2, axis2=-1) / 3.0}


class _Rows:
    """Points as weighted nodes: `rows @ x` of arrays x (n, …) over the nodes."""

    def __init__(self, first: np.ndarray, second: np.ndarray, share: np.ndarray) -> None:
        self._first, self._second, self._share = first, second, share

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        t = self._share.reshape(-1, *[1] * (x.ndim - 1))
        return np.asarray((1.0 - t) * x[self._first] + t * x[self._second])


def _nodes(chosen: np.ndarray) -> _Rows:
    return _Rows(chosen, chosen, np.zeros(len(chosen)))


def _section(body: Body, placement: Placement, across: int) -> tuple[_Rows, np.ndarray]:
    """Points of the section by nodes, and triangles of them."""
    if isinstance(body, MeridianBody):
        return _kept(body.cells[:, TRIANGLE_PIECES].reshape(-1, 3))
    other = 1 - across
    if placement.planes[other]:
        return _kept(_border(body, other)[:, TRIANGLE_PIECES].reshape(-1, 3))
    return _cut(body, body.nodes[:, other] - placement.contact[other])


def _border(body: Body, axis: int) -> np.ndarray:
    """Quadratic triangles (f, 6) of the cells' faces in the plane of symmetry: corners, middles of 01, 12, 20."""
    corners, middles = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)), {}
    for k, (a, b) in enumerate(((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))):
        middles[a, b] = middles[b, a] = 4 + k
    faces = [[*c, middles[c[0], c[1]], middles[c[1], c[2]], middles[c[2], c[0]]] for c in corners]
    every = body.cells[:, faces].reshape(-1, 6)
    return np.asarray(every[(body.nodes[every, axis] == 0.0).all(1)])


def _kept(triangles: np.ndarray) -> tuple[_Rows, np.ndarray]:
    """The nodes that triangles use, and the triangles in their numbers."""
    used, inverse = np.unique(triangles, return_inverse=True)
    return _nodes(used), inverse.reshape(-1, 3)


def _cut(body: Body, height: np.ndarray) -> tuple[_Rows, np.ndarray]:
    """The plane `height` (n,) = 0 through the straight tetrahedra between the corners of the undeformed body."""
    height = np.where(np.abs(height) < 1e-9 * np.ptp(height), 1e-9 * np.ptp(height), height)
    cells = body.cells[:, :4]
    cells = cells[(height[cells].min(1) < 0.0) & (height[cells].max(1) > 0.0)]
    edges: list[tuple[int, int]] = []
    number: dict[tuple[int, int], int] = {}
    triangles = []
    for cell in cells:
        low, high = [n for n in cell if height[n] < 0.0], [n for n in cell if height[n] > 0.0]
        ring = [(a, b) for a in low for b in high]
        if len(ring) == 4:
            ring = [ring[0], ring[1], ring[3], ring[2]]
        here = []
        for edge in ring:
            if edge not in number:
                number[edge] = len(edges)
                edges.append(edge)
            here.append(number[edge])
        triangles += [(here[0], here[k], here[k + 1]) for k in range(1, len(here) - 1)]
    first, second = np.array(edges, int).reshape(-1, 2).T
    share = height[first] / (height[first] - height[second])
    return _Rows(first, second, share), np.array(triangles, int).reshape(-1, 3)


def _surface(placement: Placement, point: LoadPoint, on: InitialState) -> DeformedSurface:
    """The surface of the body; of a meridian that of its half in space, y ≥ 0."""
    body, u = on.system.body, point.evaluation.u
    x, nodal = body.nodes + u, _nodal(on, point)
    facets = on.model.facets
    if not isinstance(body, MeridianBody):
        rows, triangles = _kept(facets[:, TRIANGLE_PIECES].reshape(-1, 3))
        return DeformedSurface(rows @ x, triangles, {k: rows @ v for k, v in nodal.items()}, placement.planes)
    halves = np.vstack([facets[:, [0, 2]], facets[:, [2, 1]]])  # the middle of an edge is its third node
    pairs = halves if len(facets) < MIN_STRAIGHT_EDGES else facets[:, :2]
    used, inverse = np.unique(pairs, return_inverse=True)
    pairs, many, n = inverse.reshape(-1, 2), len(HALF_TURN_ANGLES_RAD), len(used)
    r, z = x[used, 0], x[used, 2]
    ring = np.stack(
        [np.outer(np.cos(HALF_TURN_ANGLES_RAD), r), np.outer(np.sin(HALF_TURN_ANGLES_RAD), r), np.tile(z, (many, 1))],
        axis=-1,
    )
    a, b = pairs.T
    turns = n * np.arange(many - 1)[:, None]
    quads = [
        np.stack([turns + a, turns + b, turns + n + b], -1),
        np.stack([turns + a, turns + n + b, turns + n + a], -1),
    ]
    spread = {k: np.tile(v[used], many) for k, v in nodal.items()}
    return DeformedSurface(ring.reshape(-1, 3), np.concatenate(quads).reshape(-1, 3), spread, (False, True))
