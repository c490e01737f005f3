"""Rezoning of quadratic tetrahedra: the same elements, well shaped where the body is now instead of where it was.

Vertices move in the deformed picture to the middle of their neighbours, those of the surface along it, and are pulled
back to the undeformed body by F⁻¹; displacements are those of the old mesh at the new nodes, and the total Lagrangian
description goes on.  A vertex moves only where its elements become better in the mean, and the worst of them not worse
(smart Laplacian smoothing: Freitag 1997), so nothing turns over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from skfem import ElementTetP2, MeshTet2

from fem_backend.meshing.mesh import Mesh, with_mid_edge_nodes

N_CANDIDATE_CELLS = 60  # cells whose centres are nearest to a point, of which one holds it
MOVE_SHARE_PER_ROUND = 0.5  # of the way to the middle in a round
MAX_REVERSIONS = 12  # times that vertices are put back where elements became worse


@dataclass(frozen=True)
class Rezoned:
    """A new mesh of the undeformed body, displacements u (n, 3) mm at its nodes, mean quality of what may move.

    The quality is that in the deformed picture, before and after.
    """

    mesh: MeshTet2
    u: np.ndarray
    before: float
    after: float


def shape(x: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Quality 6√2 V/ℓ³ (m,) of straight tetrahedra, ℓ the root mean square of edges: 1 if regular, ≤ 0 inverted."""
    p = x[tets]
    volume = np.linalg.det(p[:, 1:] - p[:, :1]) / 6.0
    i, j = np.triu_indices(4, 1)
    return 6.0 * np.sqrt(2.0) * volume / np.sqrt(((p[:, i] - p[:, j]) ** 2).sum(-1).mean(1)) ** 3


def rezoned(body: Any, mesh: MeshTet2, u: np.ndarray, at: np.ndarray, reach: float, rounds: int = 8) -> Rezoned:
    """Rezoned mesh of a body or a part of it between planes of symmetry, from displacements u (n, 3) mm.

    Vertices within `reach` (mm) of the point `at` (3,) move; planes of symmetry and the rim stay.  The `body` says what
    is `on_surface` and projects onto it.
    """
    count, tets = mesh.nvertices, mesh.t.T
    nodes, cells = mesh.doflocs.T, mesh.dofs.element_dofs.T
    sign = np.sign(shape(nodes, tets))[:, None]  # some meshers count the other way
    X = nodes[:count].copy()
    x = X + u[:count]
    skin = body.on_surface(X)
    moves = (np.linalg.norm(X - at, axis=1) < reach) & ~(skin & (X[:, 2] <= 0.0))
    edges = mesh.edges[:, (mesh.edges < count).all(0)]
    outer = np.zeros(edges.shape[1], bool)
    outer[np.unique(mesh.f2e[:, mesh.boundary_facets()])] = True
    within = [X[:, k] == 0.0 for k in (0, 1)]
    near = moves[tets].any(1)
    before = float((sign[:, 0] * shape(x, tets))[near].mean())
    for _ in range(rounds):
        step = MOVE_SHARE_PER_ROUND * _pulled_back(X, x, tets, _to_the_middle(x, edges, outer, skin, within))
        step[~moves] = 0.0
        for k in (0, 1):
            step[within[k], k] = 0.0
        X, x = _accepted(body, (nodes, cells, u), X, x, step, tets, sign[:, 0], skin)
    new = with_mid_edge_nodes(body, Mesh(X, tets))
    placed = _displacements(nodes, cells, u, new.doflocs.T)
    for k in (0, 1):
        if within[k].any() and not (X[:, k] < 0.0).any():  # a plane of symmetry, not one through a whole body
            placed[new.doflocs[k] == 0.0, k] = 0.0
    return Rezoned(new, placed, before, float((sign[:, 0] * shape(x, tets))[near].mean()))


def _to_the_middle(
    x: np.ndarray, edges: np.ndarray, outer: np.ndarray, skin: np.ndarray, within: list[np.ndarray]
) -> np.ndarray:
    """From each vertex to the mean of its neighbours (n, 3); of the surface and the planes those that lie there."""
    total, number = np.zeros_like(x), np.zeros(len(x))
    for a, b in (edges, edges[::-1]):
        counts = (~skin[a] | (skin[b] & outer)) & np.all([~p[a] | p[b] for p in within], axis=0)
        np.add.at(total, a[counts], x[b[counts]])
        np.add.at(number, a[counts], 1.0)
    return np.where(number[:, None] > 0.0, total / np.maximum(number, 1.0)[:, None] - x, 0.0)


def _pulled_back(X: np.ndarray, x: np.ndarray, tets: np.ndarray, step: np.ndarray) -> np.ndarray:
    """F⁻¹ δx (n, 3), F⁻¹ of straight elements in the mean of those at a vertex, by their volume now."""
    P, p = X[tets], x[tets]
    inverse = np.swapaxes(np.linalg.solve(p[:, 1:] - p[:, :1], P[:, 1:] - P[:, :1]), 1, 2)  # ∂X/∂x
    volume = np.abs(np.linalg.det(p[:, 1:] - p[:, :1]))
    total, weight = np.zeros((len(X), 3, 3)), np.zeros(len(X))
    for k in range(4):
        np.add.at(total, tets[:, k], volume[:, None, None] * inverse)
        np.add.at(weight, tets[:, k], volume)
    return np.einsum("nij,nj->ni", total / np.maximum(weight, 1e-300)[:, None, None], step)


def _accepted(
    body: Any,
    old: tuple[np.ndarray, np.ndarray, np.ndarray],
    X: np.ndarray,
    x: np.ndarray,
    step: np.ndarray,
    tets: np.ndarray,
    sign: np.ndarray,
    skin: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices before and now after a round, those put back whose elements would have become worse."""
    was, step = np.minimum(sign * shape(x, tets), sign * shape(X, tets)), step.copy()
    for _ in range(MAX_REVERSIONS):
        new = X + step
        new[skin] = np.where(step[skin].any(1)[:, None], body.project(new[skin]), X[skin])
        moved = np.nonzero(step.any(1))[0]
        now = x.copy()
        now[moved] = new[moved] + _displacements(*old, new[moved])
        quality = np.minimum(sign * shape(now, tets), sign * shape(new, tets))
        worse = quality < np.minimum(was, _least(was, tets, len(X))[tets].min(1))
        lost = _sum(quality - was, tets, len(X)) < 0.0
        lost[np.unique(tets[worse])] = True
        if not (lost & step.any(1)).any():
            return new, now
        step[lost] = 0.0
    return X, x


def _least(quality: np.ndarray, tets: np.ndarray, count: int) -> np.ndarray:
    """The worst quality (n,) of the elements at each vertex."""
    out = np.full(count, np.inf)
    np.minimum.at(out, tets.ravel(), np.repeat(quality, 4))
    return out


def _sum(quality: np.ndarray, tets: np.ndarray, count: int) -> np.ndarray:
    """The sum (n,) over the elements at each vertex."""
    return np.bincount(tets.ravel(), np.repeat(quality, 4), count)


def _displacements(nodes: np.ndarray, cells: np.ndarray, u: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Displacements (p, 3) mm at points (p, 3) of the undeformed body; cells are located as straight-sided."""
    corner = nodes[cells[:, :4]]
    inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
    _, near = cKDTree(corner.mean(1)).query(points, min(N_CANDIDATE_CELLS, len(corner)))
    xi = np.einsum("pkij,pkj->pki", inverse[near], points[:, None] - corner[near, 0])
    b = np.concatenate([1.0 - xi.sum(-1, keepdims=True), xi], axis=-1)
    best = b.min(-1).argmax(1)
    rows = np.arange(len(points))
    N = np.stack([ElementTetP2().lbasis(b[rows, best][:, 1:].T, a)[0] for a in range(10)], axis=1)
    return np.einsum("pa,pai->pi", N, u[cells[near[rows, best]]])
