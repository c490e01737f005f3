"""Zones of another stiffness on a fixed meridian: the share of each quadrature point that lies within."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from skfem import ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.kinematics.axisymmetric import MERIDIAN_QUADRATURE_ORDER, MeridianBody

N_PIECES_PER_CUT_EDGE = 8  # pieces along an edge of a cut cell


def fractions(body: MeridianBody, level: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Fraction (m, q) of each weight with φ < 0, φ = `level` (…,) at points X (…, 3) mm.

    Cells are divided into 64 pieces, each cut exactly by the line through the values at its corners and counted with
    the nearest quadrature point: the volume is a smooth function of where the border lies.
    """
    at, pieces, owner, N = _pieces()
    X = np.einsum("pa,mai->mpi", N, body.nodes[body.cells[:, :6]])
    phi = level(X)
    part, centre = _below(phi[:, pieces])
    lambdas = np.einsum("msk,skb->msb", centre, at[pieces])
    r = np.einsum("msb,mb->ms", lambdas, body.nodes[body.cells[:, :3], 0])  # weight of a ring; straight cells suffice
    whole = np.einsum("skb,mb->ms", at[pieces] / 3.0, body.nodes[body.cells[:, :3], 0])
    inside, total = np.zeros(body.w.shape), np.zeros(body.w.shape)
    for q in range(body.w.shape[1]):
        own = owner == q
        inside[:, q], total[:, q] = (part * r)[:, own].sum(1), whole[:, own].sum(1)
    f = inside / total
    share = (part * r).sum(1) / whole.sum(1)  # of the cell: its points are given just that
    return np.clip(f * (share * body.w.sum(1) / np.maximum((f * body.w).sum(1), 1e-300))[:, None], 0.0, 1.0)


@functools.cache
def _pieces() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Barycentric points (p, 3), pieces (s, 3), the quadrature point that each belongs to (s,), N (p, 6)."""
    n = N_PIECES_PER_CUT_EDGE
    index = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(n + 1) for j in range(n + 1 - i))}
    pieces = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in index if i + j < n]
    pieces += [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in index if i + j < n - 1]
    xi = np.array(list(index), float) / n
    at = np.column_stack([1.0 - xi.sum(1), xi])
    chosen = np.array(pieces)
    points = get_quadrature(RefTri, MERIDIAN_QUADRATURE_ORDER)[0].T
    points = np.column_stack([1.0 - points.sum(1), points])
    owner = np.linalg.norm(at[chosen].mean(1)[:, None] - points, axis=-1).argmin(1)
    N = np.stack([ElementTriP2().lbasis(xi.T, a)[0] for a in range(6)], axis=1)
    return at, chosen, owner, N


def _below(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share (…) of triangles in which a linear function with corner values v (…, 3) is negative; centroid (…, 3).

    One corner on its side cuts off a triangle with the edge ratios v_a/(v_a − v_j).
    """
    negative = (v < 0.0).sum(-1)
    flipped = negative == 2
    w = np.where(flipped[..., None], -v, v)  # now the lone corner is the negative one
    lone = np.argmin(w, axis=-1)[..., None]
    wa = np.take_along_axis(w, lone, -1)
    t = np.where(np.arange(3) == lone, 1.0, wa / np.where(wa == w, 1.0, wa - w))
    part = np.prod(t, axis=-1)
    centre = np.where(np.arange(3) == lone, 0.0, t / 3.0)
    centre = np.where(np.arange(3) == lone, 1.0 - centre.sum(-1, keepdims=True), centre)
    third = np.full(3, 1.0 / 3.0)
    rest = (third - part[..., None] * centre) / np.where(part < 1.0, 1.0 - part, 1.0)[..., None]
    cut = (negative == 1) | flipped
    part = np.where(cut, np.where(flipped, 1.0 - part, part), (negative == 3).astype(float))
    centre = np.where(cut[..., None], np.where(flipped[..., None], rest, centre), third)
    return part, centre
