"""Quadratic tetrahedra: discretisation from scikit-fem, batched kernels of our own.

Dofs and matrices are numbered as :mod:`fem_backend.kinematics.numbering` says.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from skfem import ElementTetP2, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend.compiled import compiled
from fem_backend.kinematics.numbering import Pattern, free_places, numbering, pattern_of
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW, cauchy_green, fill_tensor


@dataclass(frozen=True)
class Body:
    """A discretised body: nodes (n, 3) mm, cells (m, 10), gradients G (m, q, 10, 3) 1/mm, weights w (m, q) mm³.

    `free` (3n,) numbers the free dofs, −1 is held; `place` (m, 30, 30) is where a cell's entries go in the matrix.
    `mean` says whether elements take the mean of their volume change, see :func:`volume`.
    """

    nodes: np.ndarray
    cells: np.ndarray
    G: np.ndarray
    w: np.ndarray
    free: np.ndarray
    pattern: Pattern
    place: np.ndarray
    mean: bool = False

    @functools.cached_property
    def places(self) -> np.ndarray:
        """Places (f,) of the free dofs in the components (3n,) of a nodal field."""
        return free_places(self.free)


@dataclass(frozen=True)
class MeanVolume:
    """Mean volume change of the elements of a state: pressure p (m,) MPa, energy (N mm)."""

    p: np.ndarray
    energy: float


def discretise(mesh: MeshTet2, held: np.ndarray, symmetric: bool = True, mean: bool = False) -> Body:
    """Body from a quadratic mesh; `held` (n, 3) marks displacement components fixed at zero.

    `symmetric` stores tangents as upper triangles; friction needs both.
    """
    nodes = mesh.doflocs.T.copy()
    cells = np.ascontiguousarray(mesh.dofs.element_dofs.T).astype(np.int64)
    X, weights = get_quadrature(RefTet, 2)  # four points: no locking to K/μ = 200 (verification set)
    gradient = np.stack([ElementTetP2().lbasis(X, a)[1] for a in range(10)])  # (10, 3, q)
    jacobian = np.einsum("mai,ajq->mqij", nodes[cells], gradient)  # ∂x_i/∂ξ_j
    det = np.linalg.det(jacobian)
    if np.any(det.min(1) * det.max(1) <= 0.0):
        raise ValueError(f"{int((det.min(1) * det.max(1) <= 0).sum())} curved elements are inside out")
    G = np.einsum("ajq,mqji->mqai", gradient, np.linalg.inv(jacobian))
    free = numbering(cells, held)
    pattern = pattern_of(cells, free, symmetric)
    place = pattern.find(_dofs(cells, free))
    return Body(nodes, cells, np.ascontiguousarray(G), np.abs(det) * weights, free, pattern, place, mean)


def shape_functions() -> np.ndarray:
    """Shape functions at the quadrature points of a Body, (q, 10)."""
    X, _ = get_quadrature(RefTet, 2)
    return np.stack([ElementTetP2().lbasis(X, a)[0] for a in range(10)], axis=1)


def _dofs(cells: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Free dofs of each cell, (m, 3k), components fastest."""
    return free[(3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)]


def displacement_gradients(body: Body, u: np.ndarray) -> np.ndarray:
    """H = ∂u/∂X at the quadrature points, (m, q, 3, 3), from nodal displacements u (n, 3)."""
    return _displacement_gradients(body.cells, body.G, np.ascontiguousarray(u))


@compiled()
def _displacement_gradients(cells, G, u):  # type: ignore[no-untyped-def]
    m, n = G.shape[0], G.shape[1]
    H = np.zeros((m, n, 3, 3))
    for e in range(m):
        for q in range(n):
            for a in range(10):
                node = cells[e, a]
                for i in range(3):
                    for j in range(3):
                        H[e, q, i, j] += u[node, i] * G[e, q, a, j]
    return H


def internal_force(body: Body, F: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Nodal forces f_a = Σ w F S G_a, (n, 3) N."""
    return _internal_force(body.cells, body.G, body.w, F, S, len(body.nodes))


@compiled()
def _internal_force(cells, G, w, F, S, count):  # type: ignore[no-untyped-def]
    f = np.zeros((count, 3))
    m, n = w.shape
    for e in range(m):
        for q in range(n):
            s = S[e, q]
            for a in range(10):
                g0, g1, g2 = G[e, q, a, 0], G[e, q, a, 1], G[e, q, a, 2]
                t0 = w[e, q] * (s[0] * g0 + s[5] * g1 + s[4] * g2)
                t1 = w[e, q] * (s[5] * g0 + s[1] * g1 + s[3] * g2)
                t2 = w[e, q] * (s[4] * g0 + s[3] * g1 + s[2] * g2)
                node = cells[e, a]
                for i in range(3):
                    f[node, i] += F[e, q, i, 0] * t0 + F[e, q, i, 1] * t1 + F[e, q, i, 2] * t2
    return f


def stiffness(body: Body, F: np.ndarray, S: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Tangent Σ w (Bᵀ ℂ B + Gᵀ S G ⊗ I) as `data` of the pattern (nnz,), N/mm."""
    return _stiffness(body.G, body.w, F, S, C, body.place, len(body.pattern.indices))


@compiled(fastmath=True)
def _stiffness(G, w, F, S, C, place, nnz):  # type: ignore[no-untyped-def]
    data = np.zeros(nnz)
    m, n = w.shape
    B = np.empty((6, 30))
    CB = np.empty((6, 30))
    K = np.empty((30, 30))
    for e in range(m):
        K[:, :] = 0.0
        for q in range(n):
            f, s, wq = F[e, q], S[e, q], w[e, q]
            for a in range(10):
                g0, g1, g2 = G[e, q, a, 0], G[e, q, a, 1], G[e, q, a, 2]
                for i in range(3):
                    p = 3 * a + i
                    B[0, p] = f[i, 0] * g0
                    B[1, p] = f[i, 1] * g1
                    B[2, p] = f[i, 2] * g2
                    B[3, p] = f[i, 1] * g2 + f[i, 2] * g1
                    B[4, p] = f[i, 0] * g2 + f[i, 2] * g0
                    B[5, p] = f[i, 0] * g1 + f[i, 1] * g0
            for k in range(6):
                c0, c1, c2 = wq * C[e, q, k, 0], wq * C[e, q, k, 1], wq * C[e, q, k, 2]
                c3, c4, c5 = wq * C[e, q, k, 3], wq * C[e, q, k, 4], wq * C[e, q, k, 5]
                for p in range(30):
                    CB[k, p] = c0 * B[0, p] + c1 * B[1, p] + c2 * B[2, p] + c3 * B[3, p] + c4 * B[4, p] + c5 * B[5, p]
            for p in range(30):
                b0, b1, b2, b3, b4, b5 = B[0, p], B[1, p], B[2, p], B[3, p], B[4, p], B[5, p]
                for r in range(30):
                    K[p, r] += (
                        b0 * CB[0, r] + b1 * CB[1, r] + b2 * CB[2, r] + b3 * CB[3, r] + b4 * CB[4, r] + b5 * CB[5, r]
                    )
            for a in range(10):
                g0, g1, g2 = G[e, q, a, 0], G[e, q, a, 1], G[e, q, a, 2]
                t0 = wq * (s[0] * g0 + s[5] * g1 + s[4] * g2)
                t1 = wq * (s[5] * g0 + s[1] * g1 + s[3] * g2)
                t2 = wq * (s[4] * g0 + s[3] * g1 + s[2] * g2)
                for b in range(10):
                    v = t0 * G[e, q, b, 0] + t1 * G[e, q, b, 1] + t2 * G[e, q, b, 2]
                    K[3 * a, 3 * b] += v
                    K[3 * a + 1, 3 * b + 1] += v
                    K[3 * a + 2, 3 * b + 2] += v
        for p in range(30):
            for r in range(30):
                k = place[e, p, r]
                if k >= 0:
                    data[k] += K[p, r]
    return data


def volume(body: Body, H: np.ndarray, K: float, scale: np.ndarray | None, small: bool) -> MeanVolume:
    """Pressure and energy of the mean volume change v̄ of each element, K/2 ∫ s v̄² dV; K in MPa.

    v = J − 1, or tr H where strains are `small`; `scale` s (m, q) multiplies K.  The mean dilatation of Nagtegaal,
    Parks and Rice (1974); quadratic tetrahedra with one pressure each satisfy the inf-sup condition.
    """
    H = H if H.flags.c_contiguous else np.ascontiguousarray(H)
    return MeanVolume(*_volume(body.w, H, K, np.ones((1, 1)) if scale is None else scale, small))


@compiled()
def _volume(w, H, K, s, small):  # type: ignore[no-untyped-def]
    m, n = w.shape
    p, energy = np.zeros(m), 0.0
    one = s.shape[0] != m
    for e in range(m):
        change, whole, factor = 0.0, 0.0, 0.0
        for q in range(n):
            h = H[e, q]
            v = h[0, 0] + h[1, 1] + h[2, 2]
            if not small:  # det(I + H) − 1 without the 1: K v would be round-off
                v += h[0, 0] * h[1, 1] - h[0, 1] * h[1, 0] + h[0, 0] * h[2, 2] - h[0, 2] * h[2, 0]
                v += h[1, 1] * h[2, 2] - h[1, 2] * h[2, 1]
                v += h[0, 0] * (h[1, 1] * h[2, 2] - h[1, 2] * h[2, 1])
                v += h[0, 1] * (h[1, 2] * h[2, 0] - h[1, 0] * h[2, 2])
                v += h[0, 2] * (h[1, 0] * h[2, 1] - h[1, 1] * h[2, 0])
            change += w[e, q] * v
            whole += w[e, q]
            factor += w[e, q] * (K if one else K * s[e, q])
        p[e] = factor * change / (whole * whole)
        energy += 0.5 * p[e] * change
    return p, energy


def with_pressure(F: np.ndarray, S: np.ndarray, C: np.ndarray | None, p: np.ndarray, small: bool) -> tuple:
    """Stresses S + p J C⁻¹ (m, q, 6), and moduli ℂ + p J (C⁻¹ ⊗ C⁻¹ − 2 C⁻¹ ⊙ C⁻¹) where they are asked for."""
    return _pressed(F, S, np.zeros((0, 0, 6, 6)) if C is None else C, p, small)


@compiled()
def _pressed(F, S, C, pressure, small):  # type: ignore[no-untyped-def]
    m, n = F.shape[0], F.shape[1]
    S, C, turned = S.copy(), C.copy(), C.shape[0] == m and not small
    c, inverse, B = np.empty(6), np.empty(6), np.empty((3, 3))
    for e in range(m):
        for q in range(n):
            f = F[e, q]
            J = f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]) - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
            J += f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
            cauchy_green(f, J, c, inverse)
            fill_tensor(inverse, B)
            pull = pressure[e] * J
            for a in range(6):
                i, j = VOIGT_ROW[a], VOIGT_COLUMN[a]
                S[e, q, a] += pull * B[i, j]
                if turned:
                    for b in range(6):
                        k, l = VOIGT_ROW[b], VOIGT_COLUMN[b]
                        C[e, q, a, b] += pull * (B[i, j] * B[k, l] - B[i, k] * B[j, l] - B[i, l] * B[j, k])
    return S, C


def volume_stiffness(body: Body, F: np.ndarray, K: float, scale: np.ndarray | None, data: np.ndarray) -> None:
    """Add Σ K̄/V v̄ᵤ ⊗ v̄ᵤ to `data`, v̄ᵤ = ∫ ∂v/∂u dV of an element of volume V."""
    s = np.ones((1, 1)) if scale is None else scale
    _volume_stiffness(body.G, body.w, F, K, s, body.place, data)


@compiled()
def _volume_stiffness(G, w, F, K, s, place, data):  # type: ignore[no-untyped-def]
    m, n = w.shape
    one = s.shape[0] != m
    V, c = np.empty(30), np.empty((3, 3))
    for e in range(m):
        V[:] = 0.0
        whole, factor = 0.0, 0.0
        for q in range(n):
            f, wq = F[e, q], w[e, q]
            for i in range(3):  # cofactors: ∂J/∂F
                j, k = (i + 1) % 3, (i + 2) % 3
                for a in range(3):
                    b, d = (a + 1) % 3, (a + 2) % 3
                    c[i, a] = f[j, b] * f[k, d] - f[j, d] * f[k, b]
            for a in range(10):
                for i in range(3):
                    V[3 * a + i] += wq * (c[i, 0] * G[e, q, a, 0] + c[i, 1] * G[e, q, a, 1] + c[i, 2] * G[e, q, a, 2])
            whole += wq
            factor += wq * (K if one else K * s[e, q])
        factor /= whole * whole
        for p in range(30):
            for r in range(30):
                k = place[e, p, r]
                if k >= 0:
                    data[k] += factor * V[p] * V[r]
