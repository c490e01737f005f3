"""Where points lie in a mesh of a meridian, undeformed or deformed, and the fields of one mesh at places of another."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fem_backend.kinematics.axisymmetric import basis

N_CANDIDATE_TRIANGLES = 24  # cells whose middles are nearest
N_LOCATING_STEPS = 12  # of Newton's method in a curved cell
MAX_OUTSIDE_CELL = 0.15  # how far out of its cell, in its coordinates, a point may lie: next to a curved outline


class Lost(ValueError):
    """A point that lies in no cell."""


def located(points: np.ndarray, cells: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell (k,) and local coordinates (k, 2) of places x (k, 2) in cells (m, 7) with nodes at `points` (n, 2) mm.

    Solves Σ N_a(ξ) x_a = x with the cell's own functions, bubble included.  Raises Lost.
    """
    middle = points[cells[:, :3]].mean(1)
    count = min(N_CANDIDATE_TRIANGLES, len(cells))
    near = cKDTree(middle).query(x, count)[1].reshape(len(x), count)
    cell, xi, slack = _best_of(points, cells, near, x)
    low, high = points[cells].min(1), points[cells].max(1)
    margin = MAX_OUTSIDE_CELL * (high - low)
    for k in np.nonzero(slack < 0.0)[0]:  # of long thin cells the nearest middle may be that of many another
        around = np.nonzero(((low - margin <= x[k]) & (x[k] <= high + margin)).all(1))[0]
        if len(around):
            best, at, inside = _best_of(points, cells, around[None], x[k : k + 1])
            if inside[0] > slack[k]:
                cell[k], xi[k], slack[k] = best[0], at[0], inside[0]
    if (slack < -MAX_OUTSIDE_CELL).any():
        raise Lost(f"{int((slack < -MAX_OUTSIDE_CELL).sum())} of {len(x)} places lie in no cell")
    return cell, xi


def _best_of(
    points: np.ndarray, cells: np.ndarray, near: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of the cells `near` (k, c) each place x (k, 2) is deepest in, ξ (k, 2) there, and the least barycentric
    coordinate (k,): −∞ where Newton's method ends in none."""
    nodes = points[cells[near]]  # (k, c, 7, 2)
    xi = np.full((*near.shape, 2), 1.0 / 3.0)
    for _ in range(N_LOCATING_STEPS):
        N, dN = (v.reshape(*v.shape[:-1], *near.shape) for v in basis(xi.reshape(-1, 2).T))
        residual = np.einsum("akc,kcai->kci", N, nodes) - x[:, None]
        D = np.einsum("ajkc,kcai->kcij", dN, nodes)
        det = D[..., 0, 0] * D[..., 1, 1] - D[..., 0, 1] * D[..., 1, 0]
        det = np.where(np.abs(det) > 1e-300, det, np.nan)
        step = np.stack(
            [
                D[..., 1, 1] * residual[..., 0] - D[..., 0, 1] * residual[..., 1],
                D[..., 0, 0] * residual[..., 1] - D[..., 1, 0] * residual[..., 0],
            ],
            axis=-1,
        )
        xi = np.clip(xi - np.nan_to_num(step / det[..., None]), -0.5, 1.5)
    N = basis(xi.reshape(-1, 2).T)[0].reshape(7, *near.shape)
    off = np.linalg.norm(np.einsum("akc,kcai->kci", N, nodes) - x[:, None], axis=-1)
    size = np.linalg.norm(np.ptp(nodes[:, :, :3], axis=2), axis=-1)
    slack = np.minimum(xi.min(-1), 1.0 - xi.sum(-1))
    slack = np.where(off <= 1e-8 * size, slack, -np.inf)
    best = slack.argmax(1)
    rows = np.arange(len(x))
    return near[rows, best], xi[rows, best], slack[rows, best]


def at_nodes(field: np.ndarray, cells: np.ndarray, cell: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """A nodal field (n, d) at local coordinates ξ (k, 2) of cells (k,)."""
    return np.einsum("ak,kad->kd", basis(xi.T)[0], field[cells[cell]])


def at_points(field: np.ndarray, Q: np.ndarray, cell: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """A field at quadrature points (m, q, …) at local coordinates ξ (k, 2) of cells (k,).

    The linear function of each cell that is nearest to it in the square mean, Q = M⁻¹ φ w of the body (m, 3, q), cut to
    the range of the cell's points: no new extreme arises.
    """
    values = field.reshape(*field.shape[:2], -1)
    linear = np.einsum("miq,mqd->mid", Q, values)
    phi = np.column_stack([1.0 - xi.sum(1), xi])
    out = np.einsum("ki,kid->kd", phi, linear[cell])
    out = np.clip(out, values[cell].min(1), values[cell].max(1))
    return out.reshape(len(cell), *field.shape[2:])


def quadrature_points(points: np.ndarray, cells: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Places (m, q, 2) mm of the quadrature points of cells, `shape` (q, 7) their shape functions there."""
    return np.einsum("qa,mai->mqi", shape, points[cells])
