"""Pore pressure on a meridian: linear and continuous on the quadratic triangles that carry the displacements.

Displacements with a bubble and a pressure on the corners satisfy the condition of Ladyzhenskaya, Babuška and Brezzi
(it is Taylor and Hood's pair with more displacements): the undrained body, which is incompressible, does not lock.
The weak form of a step from n to n + 1, per reference volume, with v the volume change J − 1 and φ a pressure function:

    m_i = ∫ φ_i (v − v̄) dV + Δ ∫ k ∇φ_i · J C⁻¹ ∇p dV + Δ ∫ λ φ_i p dA = 0,

v̄ and Δ of the time integration, k(J) the permeability, λ a leak through an open surface.  Small strains have C = 1.
Where the liquid gives way by S (1/MPa) v is J − 1 + S p (Biot 1941, eq. 2.12, α = 1), the volume that it has lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefTri

from fem_backend.compiled import compiled
from fem_backend.kinematics.axisymmetric import (
    EDGE_QUADRATURE_ORDER,
    MERIDIAN_QUADRATURE_ORDER,
    MeridianBody,
    _quadratic_slopes,
    linear_functions,
)
from fem_backend.kinematics.numbering import Pattern

BARYCENTRIC_SLOPES = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])  # ∂φ/∂ξ of the barycentric coordinates


@dataclass(frozen=True)
class PorousMeridian:
    """A meridian with pressures at its corners.

    `vertices` (v,) are the nodes with a pressure, `corners` (m, 3) the vertices of each cell, `slopes` their gradients
    ∇φ (m, q, 3, 2) in 1/mm.  `number` (v,) numbers the pressures in the coupled matrix, `moved` (f,) the free
    displacements.  `pattern` is that of the coupled matrix, `kept` (nnz,) the places of the body's own matrix in it,
    `place` (m, 17, 17) those of a cell: its 14 displacements, then its 3 pressures.
    """

    body: MeridianBody
    vertices: np.ndarray
    corners: np.ndarray
    slopes: np.ndarray
    number: np.ndarray
    moved: np.ndarray
    pattern: Pattern
    kept: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class OpenEdges:
    """Edges (e, 2) of vertices through which liquid may leave, ∫ φ_i φ_j dA by point (e, q, 2, 2) mm², lengths (e,) mm.

    `place` (e, 2, 2) is where an edge's entries go in the coupled matrix.
    """

    ends: np.ndarray
    products: np.ndarray
    place: np.ndarray
    length: np.ndarray


def porous(body: MeridianBody) -> PorousMeridian:
    """The pressures of a meridian, whose pattern must be whole.

    Raises ValueError for a body that stores upper triangles only: flow through a deforming body has no symmetry.
    """
    if body.pattern.symmetric:
        raise ValueError("pore flow needs the whole matrix of a body, not its upper triangle")
    vertices, corners = np.unique(body.cells[:, :3], return_inverse=True)
    corners = corners.reshape(-1, 3)
    X, _ = get_quadrature(RefTri, MERIDIAN_QUADRATURE_ORDER)
    points = body.nodes[:, [0, 2]][body.cells]
    inverse = np.linalg.inv(np.einsum("mai,ajq->mqij", points[:, :6], _quadratic_slopes(X)))
    slopes = np.einsum("aj,mqji->mqai", BARYCENTRIC_SLOPES, inverse)
    moved, number = _numbers(body, vertices, corners)
    own = body.free.reshape(-1, 3)[:, [0, 2]][body.cells].reshape(len(body.cells), 14)
    dofs = np.column_stack([np.where(own >= 0, moved[own], -1), number[corners]])
    pattern = _pattern(dofs, len(moved) + len(number))
    row = np.repeat(np.arange(body.pattern.size), np.diff(body.pattern.indptr))
    kept = _at(pattern, moved[row], moved[body.pattern.indices])
    return PorousMeridian(
        body, vertices, corners, np.ascontiguousarray(slopes), number, moved, pattern, kept, pattern.find(dofs)
    )


def _numbers(body: MeridianBody, vertices: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of displacements (f,) and pressures (v,) in one matrix: a pressure comes after its node's displacements.

    The numbers of the displacements are such that little fills in; a node that is held takes the last of its cells.
    """
    free = body.free.reshape(-1, 3)
    last = free.max(1).astype(float)
    of_cells = last[body.cells].max(1)
    most = np.full(len(vertices), -1.0)
    np.maximum.at(most, corners, of_cells[:, None])
    key = np.where(last[vertices] >= 0.0, last[vertices], most) + 0.5
    keys = np.concatenate([np.arange(body.pattern.size, dtype=float), key])
    rank = np.empty(len(keys), np.int64)
    rank[np.argsort(keys, kind="stable")] = np.arange(len(keys))
    return rank[: body.pattern.size], rank[body.pattern.size :]


def _pattern(dofs: np.ndarray, size: int) -> Pattern:
    k = dofs.shape[1]
    rows, columns = np.repeat(dofs, k, axis=1).ravel(), np.tile(dofs, (1, k)).ravel()
    both = (rows >= 0) & (columns >= 0)
    stored = sparse.csr_matrix((np.ones(int(both.sum()), np.int8), (rows[both], columns[both])), shape=(size, size))
    stored.sum_duplicates()
    stored.sort_indices()
    return Pattern(stored.indptr.astype(np.int32), stored.indices.astype(np.int32), False)


def _at(pattern: Pattern, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Places in `data` of the entries (rows, columns)."""
    n = pattern.size
    row = np.repeat(np.arange(n), np.diff(pattern.indptr))
    return np.searchsorted(row * n + pattern.indices, rows * n + columns)


def open_edges(at: PorousMeridian, facets: np.ndarray) -> OpenEdges:
    """The edges (e, 3) of the outline by their two ends, with what ∫ φ_i φ_j dA is made of."""
    X, weights = get_quadrature(RefLine, EDGE_QUADRATURE_ORDER)
    phi = np.vstack([1.0 - X[0], X[0]])
    ends = np.searchsorted(at.vertices, facets[:, :2])
    a, b = (at.body.nodes[at.vertices[ends[:, k]]] for k in (0, 1))
    length = np.linalg.norm(b - a, axis=1)
    r = a[:, :1] * phi[0] + b[:, :1] * phi[1]
    products = np.einsum("iq,jq,eq->eqij", phi, phi, 2.0 * np.pi * r * length[:, None] * weights)
    return OpenEdges(ends, products, at.pattern.find(at.number[ends]), length)


def volume_change(H: np.ndarray, small: bool) -> np.ndarray:
    """v (m, q) = J − 1, or tr H where strains are small, from displacement gradients H (m, q, 3, 3)."""
    xx, xz, zx, zz, yy = H[..., 0, 0], H[..., 0, 2], H[..., 2, 0], H[..., 2, 2], H[..., 1, 1]
    if small:
        return xx + yy + zz
    flat = xx + zz + xx * zz - xz * zx  # no 1: differences of J would lose digits
    return flat + yy + flat * yy


def mass(at: PorousMeridian, F: np.ndarray, v: np.ndarray, p: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Volume of liquid (v,) mm³ that each pressure function misses, without leaks: v (m, q) − v̄, `flow` (m, q) Δ k."""
    out = np.zeros(len(at.vertices))
    _mass(at.corners, at.slopes, at.body.w, linear_functions(), F, v, p, flow, out)
    return out


@compiled()
def _mass(corners, slopes, w, phi, F, v, p, flow, out):  # type: ignore[no-untyped-def]
    m, n = w.shape
    for e in range(m):
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            flat = a * d - b * c
            gx, gz = 0.0, 0.0
            for i in range(3):
                gx += slopes[e, q, i, 0] * p[corners[e, i]]
                gz += slopes[e, q, i, 1] * p[corners[e, i]]
            qx, qz = (d * gx - c * gz) / flat, (a * gz - b * gx) / flat  # F⁻ᵀ ∇p
            for i in range(3):
                x, z = slopes[e, q, i, 0], slopes[e, q, i, 1]
                sx, sz = (d * x - c * z) / flat, (a * z - b * x) / flat
                out[corners[e, i]] += w[e, q] * (phi[q, i] * v[e, q] + flow[e, q] * flat * h * (sx * qx + sz * qz))


def coupling(
    at: PorousMeridian, F: np.ndarray, p: np.ndarray, flow: np.ndarray, closing: np.ndarray,
    storage: float, unit: float, small: bool,
) -> np.ndarray:  # fmt: skip
    """What pressures add to the coupled matrix (nnz,): rows of displacements −∂/∂p, rows of pressures −∂m/∂(u, p).

    Pressures count in `unit` (MPa) and masses times it, so that all entries are stiffnesses; `storage` is S (1/MPa),
    `flow` (m, q) Δ k and `closing` (m, q) its derivative by J.
    """
    out = np.zeros(len(at.pattern.indices))
    body, phi = at.body, linear_functions()
    _coupling(
        body.G, body.ring, body.w, phi, at.slopes, at.corners, F, p, flow, closing, storage, unit, small, at.place, out
    )
    return out


@compiled()
def _coupling(G, ring, w, phi, slopes, corners, F, p, flow, closing, storage, unit, small, place, out):  # type: ignore[no-untyped-def]
    m, n = w.shape
    block, J1 = np.empty((17, 17)), np.empty(14)
    s = np.empty((3, 2))
    for e in range(m):
        block[:, :] = 0.0
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            flat = a * d - b * c
            qx, qz = 0.0, 0.0
            for i in range(3):
                x, z = slopes[e, q, i, 0], slopes[e, q, i, 1]
                s[i, 0], s[i, 1] = (d * x - c * z) / flat, (a * z - b * x) / flat
                qx += s[i, 0] * p[corners[e, i]]
                qz += s[i, 1] * p[corners[e, i]]
            wu = w[e, q] * unit
            through, shut = wu * flow[e, q] * flat * h, wu * closing[e, q] * flat * h
            for k in range(7):
                g, z, o = G[e, q, k, 0], G[e, q, k, 1], ring[e, q, k]
                J1[2 * k] = h * (d * g - c * z) + flat * o
                J1[2 * k + 1] = h * (a * z - b * g)
                yx, yz = (d * g - c * z) / flat, (a * z - b * g) / flat
                along = yx * qx + yz * qz
                for i in range(3):
                    for r in range(2):
                        pull = wu * phi[q, i] * J1[2 * k + r]
                        block[2 * k + r, 14 + i] -= pull
                        block[14 + i, 2 * k + r] -= pull
                    if small:
                        continue
                    across, dot = yx * s[i, 0] + yz * s[i, 1], s[i, 0] * qx + s[i, 1] * qz
                    block[14 + i, 2 * k] -= shut * J1[2 * k] * dot
                    block[14 + i, 2 * k + 1] -= shut * J1[2 * k + 1] * dot
                    block[14 + i, 2 * k] -= through * ((yx + o / h) * dot - s[i, 0] * along - qx * across)
                    block[14 + i, 2 * k + 1] -= through * (yz * dot - s[i, 1] * along - qz * across)
            for i in range(3):
                for j in range(3):
                    block[14 + i, 14 + j] -= unit * through * (s[i, 0] * s[j, 0] + s[i, 1] * s[j, 1])
                    block[14 + i, 14 + j] -= unit * wu * storage * phi[q, i] * phi[q, j]
        for k in range(17):
            for l in range(17):
                if (k >= 14 or l >= 14) and place[e, k, l] >= 0:
                    out[place[e, k, l]] += block[k, l]
