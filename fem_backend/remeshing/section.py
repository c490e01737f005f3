"""A new mesh of the deformed meridian around an indenter, its nodes pulled back to where they were before.

The part of the body around the indenter is retriangulated where it lies now; every new node is then traced back by
the old mesh to its place in the undeformed body (rezoning).  What follows goes on in total Lagrangian form: laws,
histories, marks and derivatives know nothing of it.  The rest of the mesh stays, node by node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fem_backend.meshing import MeridianMesh
from fem_backend.remeshing import location
from fem_backend.remeshing.triangulation import NoTriangles, filled, size_field

MAX_CORNER_COSINE = 0.9  # cosine of the turn of an outline that is a corner, and stays
ON_AXIS_TOLERANCE = 1e-12  # of the largest coordinate: a radius that is none
# of the height of the body above the lowest point: no element is larger; of the wanted
MAX_EDGE_PER_HEIGHT, MIN_THIN_EDGE_SHARE = 0.35, 0.05
# times the volume before or after: a triangle of which the map of the old mesh is not nearly linear
MAX_VOLUME_CHANGE_RATIO = 6.0
MAX_MESHING_TRIES = 5  # with smaller triangles where the map is bent
RETRIED_EDGE_RATIO = 0.6  # of the edge length there
EDGES_OF_TRIANGLE = ((0, 1, 3), (1, 2, 4), (0, 2, 5))  # corners and the node between them


class NoMesh(ValueError):
    """A deformed section of which no new mesh was made, and why."""


@dataclass(frozen=True)
class DeformedMeridian:
    """A deformed meridian: nodes X (n, 2) = (r, z) mm and u (n, 2) mm, cells (m, 7), outline edges (f, 3).

    `held` (n,) says by a number which components of a node are held, `part` (m,) which layer a cell is of: an edge
    between two parts stays an edge.
    """

    X: np.ndarray
    u: np.ndarray
    cells: np.ndarray
    outline: np.ndarray
    held: np.ndarray
    part: np.ndarray

    @property
    def x(self) -> np.ndarray:
        """Places (n, 2) mm now."""
        return self.X + self.u


@dataclass(frozen=True)
class EdgeChain:
    """Edges (e, 3) that follow each other, ends and middle; `fixed` keeps them as they are."""

    edges: np.ndarray
    fixed: bool


@dataclass(frozen=True)
class Cut:
    """A chain in new edges: places now and before of its points (k, 2), and of the middles between them (k − 1, 2)."""

    x: np.ndarray
    X: np.ndarray
    middles: np.ndarray


def rezoned(
    section: DeformedMeridian, near: np.ndarray, wanted: Callable[[np.ndarray], np.ndarray], growth: float
) -> MeridianMesh:
    """A mesh of the undeformed body whose cells are well shaped now; those of `near` (m,) are replaced.

    `wanted` is the edge length (k,) mm on the outline at places now (k, 2), `growth` that per distance from there.
    Raises NoMesh.
    """
    loop = _loop(section.cells[near])
    chains, lines = _chains(section, near, loop), _interfaces(section, near)
    places, sizes = _sizes(section, [*chains, *lines], wanted)
    for _ in range(MAX_MESHING_TRIES):
        size = size_field(places, sizes, growth)
        cut = [_cut(section, chain, size) for chain in chains]
        inner = [_cut(section, chain, size).x[1:-1] for chain in lines]
        try:
            points, triangles = filled(np.concatenate([c.x[:-1] for c in cut]), inner, size)
            before = _before(section, cut, points)
        except (NoTriangles, location.Lost) as error:
            raise NoMesh(str(error)) from error
        bent = _bent(before[triangles], points[triangles])
        if not bent.any():
            return _joined(section, near, cut, before, triangles)
        corners = points[triangles[bent]]
        places = np.concatenate([places, corners.mean(1)])
        sizes = np.concatenate([sizes, RETRIED_EDGE_RATIO * size(corners.mean(1))])
    raise NoMesh(f"{int(bent.sum())} triangles would be turned over before")


def _loop(cells: np.ndarray) -> np.ndarray:
    """Edges (e, 3) around cells, counterclockwise: start, end, middle.  Raises NoMesh unless it is one loop."""
    edges = np.concatenate([cells[:, [0, 1, 3]], cells[:, [1, 2, 4]], cells[:, [2, 0, 5]]])
    _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
    single = edges[first[count == 1]]
    following = {int(e[0]): e for e in single}
    if len(following) != len(single):
        raise NoMesh("the part to be remeshed meets itself")
    out = [single[0]]
    while int(out[-1][1]) != int(out[0][0]):
        out.append(following[int(out[-1][1])])
    if len(out) != len(single):
        raise NoMesh("the part to be remeshed has holes")
    return np.array(out)


def _chains(section: DeformedMeridian, near: np.ndarray, loop: np.ndarray) -> list[EdgeChain]:
    """The loop in chains: what is cut from the rest stays; outline and axis are free between corners."""
    outline = set(section.outline[:, 2].tolist())
    X, kinds = section.X, []
    for a, b, middle in loop:
        if int(middle) in outline:
            kinds.append((1, int(section.held[middle])))
        elif X[a, 0] == 0.0 and X[b, 0] == 0.0:
            kinds.append((2, 0))
        else:
            kinds.append((0, 0))
    way = X[loop[:, 1]] - X[loop[:, 0]]
    way = way / np.linalg.norm(way, axis=1)[:, None]
    meets = _meeting(section, near)
    breaks = [
        k
        for k in range(len(loop))
        if kinds[k] != kinds[k - 1]
        or way[k] @ way[k - 1] < MAX_CORNER_COSINE
        or int(loop[k][0]) in meets
        or kinds[k][0] == 0
    ]
    if not breaks:
        raise NoMesh("the part to be remeshed has no corner")
    return [
        EdgeChain(np.roll(loop, -k, axis=0)[: (following - k) % len(loop) or len(loop)], kinds[k][0] == 0)
        for k, following in zip(breaks, [*breaks[1:], breaks[0]], strict=True)
    ]


def _between(section: DeformedMeridian, near: np.ndarray) -> np.ndarray:
    """Edges (e, 3) between cells of two parts, both of them to be replaced."""
    cells, part = section.cells[near], section.part[near]
    edges = np.concatenate([cells[:, list(e)] for e in EDGES_OF_TRIANGLE])
    owner = np.tile(part, 3)
    order = np.argsort(edges[:, 2], kind="stable")
    edges, owner = edges[order], owner[order]
    same = np.nonzero((edges[1:, 2] == edges[:-1, 2]) & (owner[1:] != owner[:-1]))[0]
    return edges[same]


def _meeting(section: DeformedMeridian, near: np.ndarray) -> set[int]:
    """Nodes where such edges end on the loop: they stay."""
    edges = _between(section, near)
    if not len(edges):
        return set()
    nodes, count = np.unique(edges[:, :2], return_counts=True)
    return set(nodes[count == 1].tolist())


def _interfaces(section: DeformedMeridian, near: np.ndarray) -> list[EdgeChain]:
    """Chains of edges between two parts, each from one of its ends to the other."""
    left = [(int(a), int(b), int(c)) for a, b, c in _between(section, near)]
    at: dict[int, list[tuple[int, int, int]]] = {}
    for e in left:
        at.setdefault(e[0], []).append(e)
        at.setdefault(e[1], []).append(e)
    out: list[EdgeChain] = []
    seen: set[int] = set()
    for start in sorted(n for n, es in at.items() if len(es) == 1):
        here, chain = start, []
        while True:
            following = [e for e in at[here] if e[2] not in seen]
            if not following:
                break
            a, b, middle = following[0]
            seen.add(middle)
            there = b if a == here else a
            chain.append((here, there, middle))
            here = there
        if chain:
            out.append(EdgeChain(np.array(chain), False))
    return out


def _sizes(
    section: DeformedMeridian, chains: list[EdgeChain], wanted: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Places (k, 2) on chains and the edge lengths (k,) there: as they are where they stay, `wanted` on the outline."""
    places, sizes, free = [], [], []
    outline = set(section.outline[:, 2].tolist())
    for chain in chains:
        for a, b, middle in chain.edges:
            length = float(np.linalg.norm(section.x[b] - section.x[a]))
            if chain.fixed:
                places.append(section.x[[a, b, middle]])
                sizes.append(np.full(3, length))
            elif int(middle) in outline:
                count = max(int(np.ceil(length / float(wanted(section.x[[middle]])[0]))), 1)
                x = _quadratic(np.linspace(0.0, 1.0, 2 * count + 1)) @ section.x[[a, b, middle]]
                free.append(x)
    if free:
        x = np.concatenate(free)
        h, lowest = wanted(x), float(section.x[:, 1].min())
        above = np.where(np.abs(x[:, None, 0] - x[None, :, 0]) <= h[:, None], x[None, :, 1], -np.inf).max(1)
        places.append(x)
        sizes.append(np.minimum(h, np.maximum(MAX_EDGE_PER_HEIGHT * (above - lowest), MIN_THIN_EDGE_SHARE * h)))
    return np.concatenate(places), np.concatenate(sizes)


def _quadratic(t: np.ndarray) -> np.ndarray:
    """Shape functions (k, 3) of an edge: ends, then the middle."""
    return np.column_stack([(1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0), 4.0 * t * (1.0 - t)])


def _cut(section: DeformedMeridian, chain: EdgeChain, size: Callable[[np.ndarray], np.ndarray]) -> Cut:
    """A chain in edges of the wanted size now, at equal shares of ∫ ds/h."""
    X, x, edges = section.X, section.x, chain.edges
    if chain.fixed:
        nodes = [*edges[:, 0], edges[-1, 1]]
        return Cut(x[nodes], X[nodes], X[edges[:, 2]])
    fine = np.linspace(0.0, 1.0, 33)
    way = np.concatenate([k + fine[:-1] for k in range(len(edges))] + [np.array([float(len(edges))])])
    now, before = _on(x, edges, way), _on(X, edges, way)
    steps = np.linalg.norm(np.diff(now, axis=0), axis=1)
    total = np.concatenate([[0.0], np.cumsum(steps / size(0.5 * (now[1:] + now[:-1])))])
    count = max(int(np.ceil(total[-1] - 1e-9)), 1)
    s = np.interp(np.linspace(0.0, total[-1], count + 1), total, way)
    s[-1] = way[-1]
    back = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(before, axis=0), axis=1))])
    ends = np.interp(s, way, back)
    half = np.interp(0.5 * (ends[1:] + ends[:-1]), back, way)  # halfway before, so that edges stay even
    out = Cut(_on(x, edges, s), _on(X, edges, s), _on(X, edges, half))
    first, last = int(edges[0, 0]), int(edges[-1, 1])
    out.x[[0, -1]], out.X[[0, -1]] = x[[first, last]], X[[first, last]]
    return out


def _on(nodes: np.ndarray, edges: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Places (k, 2) on a chain of edges, `way` (k,) counts edges from its start."""
    k = np.minimum(way.astype(int), len(edges) - 1)
    return np.einsum("ka,kai->ki", _quadratic(way - k), nodes[edges[k]])


def _before(section: DeformedMeridian, cut: list[Cut], points: np.ndarray) -> np.ndarray:
    """Where points (n, 2) now, those of the loop first, were before; raises Lost."""
    given = np.concatenate([c.X[:-1] for c in cut])
    cell, xi = location.located(section.x, section.cells, points[len(given) :])
    out = np.concatenate([given, location.at_nodes(section.X, section.cells, cell, xi)])
    out[np.abs(out[:, 0]) < ON_AXIS_TOLERANCE * np.abs(out).max(), 0] = 0.0
    return out


def _bent(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Which triangles (m, 3, 2) change their volume beyond what the material does, or turn over, before and now."""
    ring = before[..., 0].mean(1) * _areas(before) / (now[..., 0].mean(1) * _areas(now))
    return (ring < 1.0 / MAX_VOLUME_CHANGE_RATIO) | (ring > MAX_VOLUME_CHANGE_RATIO)


def _areas(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _joined(
    section: DeformedMeridian, near: np.ndarray, cut: list[Cut], vertices: np.ndarray, triangles: np.ndarray
) -> MeridianMesh:
    """The mesh of the undeformed body from the triangles of its part, and the rest as it is."""
    count = sum(len(c.middles) for c in cut)
    curved = {}
    first = 0
    for c in cut:
        for k, place in enumerate(c.middles):
            a, b = (first + k) % count, (first + k + 1) % count
            curved[min(a, b), max(a, b)] = place
        first += len(c.middles)
    kept = section.cells[~near][:, :6]
    new, places = _quadratic_cells(vertices, triangles, curved)
    return _merged(section.X, kept, places, new)


def _quadratic_cells(
    vertices: np.ndarray, triangles: np.ndarray, curved: dict[tuple[int, int], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Cells (m, 6) and their nodes (n, 2): middles halfway, on the outline where it bends."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]]), axis=1)
    unique, inverse = np.unique(sides, axis=0, return_inverse=True)
    middles = vertices[unique].mean(1)
    for k, (a, b) in enumerate(unique.tolist()):
        if (a, b) in curved:
            middles[k] = curved[a, b]
    number = len(vertices) + inverse.reshape(3, -1).T
    return np.concatenate([triangles, number], axis=1), np.concatenate([vertices, middles])


def _merged(X: np.ndarray, kept: np.ndarray, places: np.ndarray, new: np.ndarray) -> MeridianMesh:
    """Cells that stay and new ones in one mesh; nodes in the same place are one."""
    old = np.unique(kept)
    shared = {(float(r), float(z)): k for k, (r, z) in enumerate(X[old])}
    number, points = np.empty(len(places), int), list(X[old])
    for k, (r, z) in enumerate(places.tolist()):
        at = shared.get((r, z))
        number[k] = len(points) if at is None else at
        if at is None:
            points.append(np.array([r, z]))
    renumbered = np.full(len(X), -1)
    renumbered[old] = np.arange(len(old))
    cells = np.concatenate([renumbered[kept], number[new]])
    nodes = np.array(points)
    share = np.array([-1.0, -1.0, -1.0, 4.0, 4.0, 4.0]) / 9.0
    middle = np.einsum("a,mai->mi", share, nodes[cells])
    cells = np.column_stack([cells, len(nodes) + np.arange(len(cells))])
    return MeridianMesh(np.concatenate([nodes, middle]), cells.astype(np.int64))
