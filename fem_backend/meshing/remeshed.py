"""A smooth closed surface retriangulated with edges of asked lengths: the graded input of fTetWild."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from fem_backend.meshing.closed_surface import closed
from fem_backend.meshing.mesh import BadMesh
from fem_backend.meshing.smooth_surface import SmoothSurface, vertex_normals

DENSE_EDGE_RATIO = 0.34  # of the asked length: edges of the triangulation of which vertices are chosen
# of the asked length: edges between points that keep this distance are 1.4 times as long in the mean
MIN_VERTEX_DISTANCE_RATIO = 0.72
N_CENTRING_ROUNDS = 4  # of moving each vertex to the middle of what is nearest to it
MAX_HALVING_PASSES = 16  # of halving edges: 3⁻¹ · 2¹⁶ is beyond any grading
Sizes = Callable[[np.ndarray], np.ndarray]


def remeshed_surface(surface: SmoothSurface, sizes: Sizes, fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) on the smooth surface and facets (m, 3), edges about `sizes(points)` long; `fixed` is a vertex.

    The dual of a Voronoi diagram on a dense triangulation, whose sites are moved to the centres of their cells
    (Valette and Chassery 2004).  Raises BadMesh where that is no closed surface: sizes too large for the shape.
    """
    x, facets = refined_surface(surface, lambda p: DENSE_EDGE_RATIO * sizes(p))
    x = np.vstack([x, surface.project(fixed[None])])  # joined to the nearest: a site that never moves
    first = int(np.argmin(np.linalg.norm(x[:-1] - x[-1], axis=1)))
    x[first], x = x[-1], x[:-1]
    h, normals = sizes(x), vertex_normals(x, facets)
    sites = _scattered(x, normals, MIN_VERTEX_DISTANCE_RATIO * h, first)
    graph = _metric(x, facets, h)
    weight = _areas(x, facets) / h**4  # cells of equal weight are in proportion to h, of two dimensions
    for _ in range(N_CENTRING_ROUNDS):
        cell = _cells(graph, sites)
        total = np.maximum(np.bincount(cell, weight, len(sites)), 1e-300)
        middle = np.column_stack([np.bincount(cell, weight * x[:, i], len(sites)) / total for i in range(3)])
        away = np.linalg.norm(x - middle[cell], axis=1)
        order = np.lexsort((away, cell))
        nearest = order[np.unique(cell[order], return_index=True)[1]]
        nearest[sites == first] = first
        sites = nearest
    cell = _cells(graph, sites)
    meet = cell[facets]
    three = (meet[:, 0] != meet[:, 1]) & (meet[:, 1] != meet[:, 2]) & (meet[:, 2] != meet[:, 0])
    try:
        made = closed(x[sites], meet[three])
    except ValueError as error:
        raise BadMesh(
            f"its surface with edges as short as this indenter asks {error}. Does the surface of the file "
            "cross itself, or have parts thinner than the indenter is wide?"
        ) from error
    used, inverse = np.unique(made.facets, return_inverse=True)
    return made.vertices[used], inverse.reshape(made.facets.shape)


def refined_surface(
    surface: SmoothSurface, sizes: Sizes, passes: int = MAX_HALVING_PASSES
) -> tuple[np.ndarray, np.ndarray]:
    """The facets cut until no edge is longer than `sizes(middle)`, all vertices on the smooth surface."""
    x, facets = surface.project(surface.vertices), surface.facets.copy()
    for _ in range(passes):
        edges = np.sort(np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]]), axis=1)
        ends, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = x[ends].mean(1)
        long = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1) > sizes(middle)
        if not long.any():
            break
        number = np.full(len(ends), -1)
        number[long] = len(x) + np.arange(int(long.sum()))
        x = np.vstack([x, surface.project(middle[long])])
        facets = _cut(facets, number[inverse.reshape(3, -1).T])
    return x, facets


def _cut(facets: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Facets cut at the new vertices `middle` (m, 3) of their edges 01, 12, 20, −1 where an edge stays."""
    cut = middle >= 0
    count = cut.sum(1)
    out = [facets[count == 0]]
    for k in range(3):
        turn = [k, (k + 1) % 3, (k + 2) % 3]
        one = (count == 1) & cut[:, k]
        (a, b, c), m = facets[one][:, turn].T, middle[one, k]
        out += [np.column_stack([a, m, c]), np.column_stack([m, b, c])]
        two = (count == 2) & ~cut[:, k]
        (a, b, c), p, q = facets[two][:, turn].T, middle[two, turn[1]], middle[two, turn[2]]
        out += [np.column_stack([q, p, c]), np.column_stack([a, b, p]), np.column_stack([a, p, q])]
    (a, b, c), (p, q, r) = facets[count == 3].T, middle[count == 3].T
    out += [np.column_stack(t) for t in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]
    return np.vstack(out)


def _scattered(x: np.ndarray, normals: np.ndarray, apart: np.ndarray, first: int) -> np.ndarray:
    """Vertices no two of which, on one side of a sheet, are nearer than `apart`, the finest first."""
    near = cKDTree(x).query_ball_point(x, apart)
    free, sites = np.ones(len(x), bool), []
    for k in [first, *np.argsort(apart, kind="stable").tolist()]:
        if free[k]:
            around = np.array(near[k])
            free[around[normals[around] @ normals[k] > 0.0]] = False
            sites.append(k)
    return np.array(sites)


def _metric(x: np.ndarray, facets: np.ndarray, h: np.ndarray) -> coo_matrix:
    """Edges of the triangulation with their lengths over h."""
    edges = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    length = np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1) / h[edges].mean(1)
    return coo_matrix((length, (edges[:, 0], edges[:, 1])), shape=(len(x), len(x))).tocsr()


def _cells(graph: coo_matrix, sites: np.ndarray) -> np.ndarray:
    """Number of the site (n,) that each vertex is nearest to."""
    source = dijkstra(graph, directed=True, indices=sites, min_only=True, return_predecessors=True)[2]
    number = np.zeros(graph.shape[0], int)
    number[sites] = np.arange(len(sites))
    return number[source]


def _areas(x: np.ndarray, facets: np.ndarray) -> np.ndarray:
    a, b, c = (x[facets[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(facets.ravel(), np.repeat(area, 3), len(x))
