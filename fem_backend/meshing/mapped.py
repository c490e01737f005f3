"""The mesh that is the same to the bit everywhere: a subdivided ball, graded by a conformal map."""

from __future__ import annotations

import itertools

import numpy as np

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mesh import Mesh, finish, merge_vertices


def mapped_quarter(body: EllipsoidShape, n: int, slip: float) -> Mesh:
    """Quarter ellipsoid from two octants cut into n³ tetrahedra each, graded towards the top by a Möbius map.

    The hyperbolic translation of the unit ball x ↦ ((1 − s²)(x + s e) + |x + s e|² s e) / (1 + 2 s x·e + s²|x|²),
    e = (0, 0, 1), is conformal: it shrinks elements at the top by (1 − s)/(1 + s) and keeps every angle.
    """
    octant = kuhn_simplex(n)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    points, tets = octant
    barycentric = np.c_[n - points[:, 0], points[:, 0] - points[:, 1], points[:, 1] - points[:, 2], points[:, 2]] / n
    upper = barycentric @ corners
    vertices = np.vstack([upper, upper * [1, 1, -1]])
    vertices, tets = merge_vertices(vertices, np.vstack([tets, tets + len(upper)]))
    l1, l2 = np.abs(vertices).sum(1), np.linalg.norm(vertices, axis=1)
    ball = vertices * (l1 / np.where(l2 > 0, l2, 1.0))[:, None]
    e = np.array([0.0, 0.0, 1.0])
    y = ball + slip * e
    moved = (1 - slip**2) * y + (y**2).sum(1)[:, None] * slip * e
    ball = moved / (1 + 2 * slip * ball[:, 2] + slip**2 * (ball**2).sum(1))[:, None]
    return finish(body, ball * body.semi_axes, tets, 1e-6)


def kuhn_simplex(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points 0 ≤ x₃ ≤ x₂ ≤ x₁ ≤ n and the Kuhn tetrahedra between them (Freudenthal 1942)."""
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = (grid[:, 0] >= grid[:, 1]) & (grid[:, 1] >= grid[:, 2])
    number = np.full((n + 1,) * 3, -1)
    points = grid[inside]
    number[tuple(points.T)] = np.arange(len(points))
    cubes = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    parts = []
    for order in itertools.permutations(range(3)):
        corners = [cubes]
        for axis in order:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
        parts.append(np.stack([number[tuple(c.T)] for c in corners], 1))
    tets = np.vstack(parts)
    return points, tets[(tets >= 0).all(1)]
