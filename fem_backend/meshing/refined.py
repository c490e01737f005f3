"""Every tetrahedron cut into n³: the systematic family that a Richardson limit needs."""

from __future__ import annotations

import numpy as np
from skfem import MeshTet

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mapped import kuhn_simplex
from fem_backend.meshing.mesh import BadMesh, Mesh, volumes, with_mid_edge_nodes

EDGES_OF_TETRAHEDRON = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # by their corners


def subdivided(body: EllipsoidShape, mesh: Mesh, n: int) -> Mesh:
    """Mesh (mm) with every quadratic tetrahedron of the quarter `mesh` cut into n³ (Freudenthal 1942).

    New vertices lie on the quadratic elements, those of the surface on the ellipsoid; planes and rim stay exact, edges
    are 1/n as long.  Raises BadMesh when a piece of a strongly curved element is inside out.
    """
    tets = np.sort(mesh.tets, axis=1)  # one order of corners for all: neighbours cut their face alike
    points, pieces = kuhn_simplex(n)
    weight = np.c_[n - points[:, 0], points[:, 0] - points[:, 1], points[:, 1] - points[:, 2], points[:, 2]]
    linear = MeshTet(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.tets.T))
    X = with_mid_edge_nodes(body, mesh).doflocs.T
    ends = np.sort(linear.edges, axis=0)
    order = np.lexsort(ends[::-1])
    code = ends[0, order] * len(mesh.vertices) + ends[1, order]
    of_edge = [
        order[np.searchsorted(code, tets[:, i] * len(mesh.vertices) + tets[:, j])] for i, j in EDGES_OF_TETRAHEDRON
    ]
    middle = linear.nvertices + np.stack(of_edge, 1)
    b = weight / n
    corner, bubble = b * (2 * b - 1), np.stack([4 * b[:, i] * b[:, j] for i, j in EDGES_OF_TETRAHEDRON], 1)
    all_points = np.einsum("pa,mai->mpi", corner, X[tets]) + np.einsum("pa,mai->mpi", bubble, X[middle])
    # a point is known by the corners it lies between and its weights
    key = np.where(weight > 0, tets[:, None, :] * (n + 1) + weight, -1)
    key = np.sort(key, axis=2).reshape(-1, 4)
    names, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    vertices = all_points.reshape(-1, 3)[first]
    cells = number.reshape(len(tets), -1)[:, pieces].reshape(-1, 4)
    vertices = _exact(body, mesh, linear, names // (n + 1), vertices)
    way = np.outer(volumes(Mesh(mesh.vertices, tets)), volumes(Mesh(points.astype(float), pieces))).ravel()
    if np.any(volumes(Mesh(vertices, cells)) * way <= 0.0):
        raise BadMesh("a curved element cannot be cut")
    turned = volumes(Mesh(vertices, cells)) < 0
    cells[turned] = cells[turned][:, [0, 2, 1, 3]]
    return Mesh(vertices, cells)


def _exact(body: EllipsoidShape, mesh: Mesh, linear: MeshTet, corners: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Put new vertices, each between `corners` (p, 4; −1 for none), on the surface, the planes and the rim."""
    between = np.where(corners >= 0, corners, corners.max(1, keepdims=True))
    for axis in range(3):
        zero = mesh.vertices[:, axis] == 0.0
        on = zero[between].all(1)
        vertices[on, axis] = 0.0
    facets = linear.facets[:, linear.boundary_facets()].T
    flat = (mesh.vertices[facets][:, :, :2] == 0.0).all(1).any(1)
    skin = np.sort(facets[~flat], axis=1)
    a, b, c = skin.T
    parts = [np.c_[a, a, a], np.c_[b, b, b], np.c_[c, c, c], np.c_[a, a, b], np.c_[a, a, c], np.c_[b, b, c], skin]
    known = {tuple(row) for row in np.vstack(parts).tolist()}
    inside = []
    for row in between.tolist():
        distinct = sorted(set(row))
        name = (distinct[0],) * (4 - len(distinct)) + tuple(distinct[1:]) if len(distinct) < 4 else None
        inside.append(name in known)
    on = np.array(inside)
    vertices[on] = body.project(vertices[on])
    return vertices
