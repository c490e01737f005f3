"""Quadratic triangles of a meridian: bodies of revolution by their half-plane (r, z), volume change projected.

A meridian is embedded in space as x = (r, 0, z) with u = (u_r, 0, u_z), so that laws, contact, steps and outputs are
those of three dimensions: F has the in-plane part and F_yy = 1 + u_r/r, and weights hold 2πr.

The element is that of Crouzeix and Raviart (1973): quadratic with a cubic bubble, pressure linear and discontinuous.
Of U = K v²/2, v the volume change J − 1, the part is taken that the element's linear functions see,

    Π = ∫ W_iso dV + K/2 ∫ s (Πv)² dV,    Πv = Σ φ_i M⁻¹_ij ∫ φ_j v dV,

which is the three-field principle with pressure and dilatation eliminated cell by cell (Simo, Taylor and Pister 1985).
It does not lock for K/μ → ∞ and its tangent stays that of the displacements alone.  s multiplies all moduli.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from skfem import ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.compiled import compiled
from fem_backend.kinematics.numbering import Pattern, free_places, numbering, pattern_of

MERIDIAN_QUADRATURE_ORDER = 4  # six points: exact for the quadratic strains of the bubble
EDGE_QUADRATURE_ORDER = 11  # six Gauss points an edge, where contact says which of them are open to a liquid
MIDDLES_OF_TRIANGLE = ((0, 1), (1, 2), (0, 2))  # corners on both sides of mid-edge nodes 3 to 5


@dataclass(frozen=True)
class MeridianBody:
    """A discretised meridian: nodes (n, 3) mm with y = 0, cells (m, 7), gradients G (m, q, 7, 2) by (r, z) in 1/mm,
    ring (m, q, 7) = N_a/r in 1/mm, weights w (m, q) = 2πr dA in mm³, projection Q (m, 3, q) = M⁻¹ φ w.

    `free` (3n,) numbers the free dofs, −1 is held (all of y); `place` (m, 14, 14) is where a cell's entries go.
    The seventh node is the middle of a cell.
    """

    nodes: np.ndarray
    cells: np.ndarray
    G: np.ndarray
    ring: np.ndarray
    w: np.ndarray
    Q: np.ndarray
    free: np.ndarray
    pattern: Pattern
    place: np.ndarray

    @functools.cached_property
    def places(self) -> np.ndarray:
        """Places (f,) of the free dofs in the components (3n,) of a nodal field."""
        return free_places(self.free)


@dataclass(frozen=True)
class Volume:
    """Projected volume change of a state: coefficients p̂ (m, 3) MPa of the pressure, energy (N mm)."""

    p: np.ndarray
    energy: float


@functools.cache
def shape_functions() -> np.ndarray:
    """Shape functions at the quadrature points of a MeridianBody, (q, 7)."""
    return basis(get_quadrature(RefTri, MERIDIAN_QUADRATURE_ORDER)[0])[0].T.copy()


def basis(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (7, p) and ∂N/∂ξ (7, 2, p) at points (2, p): quadratic ones less their share of the bubble 27 λ₁λ₂λ₃."""
    N = np.stack([ElementTriP2().lbasis(X, a)[0] for a in range(6)])
    dN = np.stack([ElementTriP2().lbasis(X, a)[1] for a in range(6)])
    x, y = X
    bubble = 27.0 * x * y * (1.0 - x - y)
    slope = 27.0 * np.stack([y * (1.0 - 2.0 * x - y), x * (1.0 - x - 2.0 * y)])
    share = np.array([-1.0, -1.0, -1.0, 4.0, 4.0, 4.0]) / 9.0  # of the quadratic ones at the middle
    N = np.vstack([N - share[:, None] * bubble, bubble[None]])
    dN = np.concatenate([dN - share[:, None, None] * slope, slope[None]])
    return N, dN


@functools.cache
def linear_functions() -> np.ndarray:
    """Pressure functions φ (q, 3) at the quadrature points: the barycentric coordinates."""
    x, y = get_quadrature(RefTri, MERIDIAN_QUADRATURE_ORDER)[0]
    return np.column_stack([1.0 - x - y, x, y])


def discretise(points: np.ndarray, cells: np.ndarray, held: np.ndarray, symmetric: bool = True) -> MeridianBody:
    """MeridianBody from nodes (n, 2) = (r, z) mm and cells (m, 7); `held` (n, 3) marks components fixed at zero.

    On the axis u_r = 0 is held by itself.  `symmetric` stores tangents as upper triangles; friction needs both.
    Raises ValueError for cells that are inside out or lie beyond the axis.
    """
    X, weights = get_quadrature(RefTri, MERIDIAN_QUADRATURE_ORDER)
    N, dN = basis(X)
    corners = points[cells]
    jacobian = np.einsum("mai,ajq->mqij", corners[:, :6], _quadratic_slopes(X))  # the geometry has no bubble
    det = np.linalg.det(jacobian)
    if np.any(det <= 0.0):
        raise ValueError(f"{int((det <= 0.0).any(1).sum())} curved elements are inside out")
    r = np.einsum("ma,aq->mq", corners[:, :6, 0], _quadratic_values(X))
    if np.any(r <= 0.0):
        raise ValueError("elements lie beyond the axis")
    G = np.einsum("ajq,mqji->mqai", dN, np.linalg.inv(jacobian))
    w = 2.0 * np.pi * r * det * weights
    phi = linear_functions()
    mass = np.einsum("mq,qi,qj->mij", w, phi, phi)
    Q = np.einsum("mij,qj,mq->miq", np.linalg.inv(mass), phi, w)
    nodes = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    held = held.copy()
    held[:, 1] = True
    held[points[:, 0] == 0.0, 0] = True
    free = numbering(cells, held)
    pattern = pattern_of(cells, free, symmetric)
    dofs = free.reshape(-1, 3)[:, [0, 2]][cells].reshape(len(cells), 14)
    return MeridianBody(
        nodes,
        cells,
        np.ascontiguousarray(G),
        np.ascontiguousarray(N.T[None] / r[:, :, None]),
        w,
        np.ascontiguousarray(Q),
        free,
        pattern,
        pattern.find(dofs),
    )


def _quadratic_values(X: np.ndarray) -> np.ndarray:
    return np.stack([ElementTriP2().lbasis(X, a)[0] for a in range(6)])


def _quadratic_slopes(X: np.ndarray) -> np.ndarray:
    return np.stack([ElementTriP2().lbasis(X, a)[1] for a in range(6)])


def displacement_gradients(body: MeridianBody, u: np.ndarray) -> np.ndarray:
    """H = ∂u/∂X at the quadrature points, (m, q, 3, 3), from nodal displacements u (n, 3); H_yy = u_r/r."""
    return _displacement_gradients(body.cells, body.G, body.ring, u)


@compiled()
def _displacement_gradients(cells, G, ring, u):  # type: ignore[no-untyped-def]
    m, n = ring.shape[0], ring.shape[1]
    H = np.zeros((m, n, 3, 3))
    for e in range(m):
        for q in range(n):
            xx, xz, zx, zz, yy = 0.0, 0.0, 0.0, 0.0, 0.0
            for a in range(7):
                r, z = u[cells[e, a], 0], u[cells[e, a], 2]
                g, h = G[e, q, a, 0], G[e, q, a, 1]
                xx += r * g
                xz += r * h
                zx += z * g
                zz += z * h
                yy += r * ring[e, q, a]
            H[e, q, 0, 0], H[e, q, 0, 2], H[e, q, 2, 0], H[e, q, 2, 2], H[e, q, 1, 1] = xx, xz, zx, zz, yy
    return H


def volume(body: MeridianBody, H: np.ndarray, K: float, scale: np.ndarray | None, small: bool) -> Volume:
    """Pressure and energy of the projected volume change of displacement gradients H (m, q, 3, 3); K in MPa.

    v = J − 1, or tr H where strains are `small`; `scale` (m, q) multiplies K.
    """
    s = np.ones((1, 1)) if scale is None else scale
    p, energy = _volume(body.Q, body.w, linear_functions(), H, K, s, small)
    return Volume(p, energy)


@compiled()
def _volume(Q, w, phi, H, K, s, small):  # type: ignore[no-untyped-def]
    m, n = w.shape
    out, energy = np.zeros((m, 3)), 0.0
    one = s.shape[0] != m
    hat = np.empty(3)
    for e in range(m):
        hat[:] = 0.0
        for q in range(n):
            h = H[e, q]
            if small:
                v = h[0, 0] + h[1, 1] + h[2, 2]
            else:
                flat = h[0, 0] + h[2, 2] + h[0, 0] * h[2, 2] - h[0, 2] * h[2, 0]  # no 1: K v would be round-off
                v = flat + h[1, 1] + flat * h[1, 1]
            for i in range(3):
                hat[i] += Q[e, i, q] * v
        for q in range(n):
            mean = hat[0] * phi[q, 0] + hat[1] * phi[q, 1] + hat[2] * phi[q, 2]
            factor = K if one else K * s[e, q]
            energy += 0.5 * w[e, q] * factor * mean * mean
            for i in range(3):
                out[e, i] += Q[e, i, q] * factor * mean
    return out, energy


def linearised_stresses(
    body: MeridianBody,
    F: np.ndarray,
    S: np.ndarray,
    C: np.ndarray,
    p: np.ndarray,
    dH: np.ndarray,
    K: float,
    scale: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Stresses S (m, q, 6) and pressures p̂ (m, 3) MPa to first order after a change δH (m, q, 3, 3) of gradients."""
    s = np.ones((1, 1)) if scale is None else scale
    return _carried(body.Q, linear_functions(), F, S, C, p, dH, K, s)


@compiled()
def _carried(Q, phi, F, S, C, p, dH, K, s):  # type: ignore[no-untyped-def]
    m, n = F.shape[0], F.shape[1]
    one = s.shape[0] != m
    out, hat, dv = S.copy(), p.copy(), np.empty(3)
    for e in range(m):
        dv[:] = 0.0
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            xx, xz, zx, zz, yy = dH[e, q, 0, 0], dH[e, q, 0, 2], dH[e, q, 2, 0], dH[e, q, 2, 2], dH[e, q, 1, 1]
            e0, e1, e2 = a * xx + c * zx, h * yy, b * xz + d * zz
            e4 = a * xz + b * xx + c * zz + d * zx
            for k in (0, 1, 2, 4):
                out[e, q, k] += C[e, q, k, 0] * e0 + C[e, q, k, 1] * e1 + C[e, q, k, 2] * e2 + C[e, q, k, 4] * e4
            v = h * (d * xx - c * xz - b * zx + a * zz) + (a * d - b * c) * yy
            for i in range(3):
                dv[i] += Q[e, i, q] * v
        for q in range(n):
            change = (K if one else K * s[e, q]) * (dv[0] * phi[q, 0] + dv[1] * phi[q, 1] + dv[2] * phi[q, 2])
            for i in range(3):
                hat[e, i] += Q[e, i, q] * change
    return out, hat


def internal_force(body: MeridianBody, F: np.ndarray, S: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Nodal forces f_a = Σ w (F S + p cof F) : ∂H/∂u_a, (n, 3) N, p̂ (m, 3) MPa the pressures of `volume`."""
    return _internal_force(body.cells, body.G, body.ring, body.w, linear_functions(), F, S, p, len(body.nodes))


@compiled()
def _internal_force(cells, G, ring, w, phi, F, S, hat, count):  # type: ignore[no-untyped-def]
    f = np.zeros((count, 3))
    m, n = w.shape
    for e in range(m):
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            s, wq = S[e, q], w[e, q]
            p = hat[e, 0] * phi[q, 0] + hat[e, 1] * phi[q, 1] + hat[e, 2] * phi[q, 2]
            xx = wq * (a * s[0] + b * s[4] + p * h * d)
            xz = wq * (a * s[4] + b * s[2] - p * h * c)
            zx = wq * (c * s[0] + d * s[4] - p * h * b)
            zz = wq * (c * s[4] + d * s[2] + p * h * a)
            yy = wq * (h * s[1] + p * (a * d - b * c))
            for k in range(7):
                node = cells[e, k]
                f[node, 0] += xx * G[e, q, k, 0] + xz * G[e, q, k, 1] + yy * ring[e, q, k]
                f[node, 2] += zx * G[e, q, k, 0] + zz * G[e, q, k, 1]
    return f


def stiffness(
    body: MeridianBody,
    F: np.ndarray,
    S: np.ndarray,
    C: np.ndarray,
    p: np.ndarray,
    K: float,
    scale: np.ndarray | None,
    small: bool,
) -> np.ndarray:
    """Tangent Σ w (Bᵀ ℂ B + Gᵀ S G + p ∂²J) + bᵀ K M⁻¹ M_s M⁻¹ b as `data` of the pattern (nnz,), N/mm.

    b_i = ∫ φ_i cof F : ∂H/∂u dV.  Small strains have no geometric part: S and p do not count.
    """
    s = np.ones((1, 1)) if scale is None else scale
    nnz = len(body.pattern.indices)
    phi = linear_functions()
    return _stiffness(body.G, body.ring, body.w, body.Q, phi, F, S, C, p, K, s, small, body.place, nnz)


@compiled(fastmath=True)
def _stiffness(G, ring, w, Q, phi, F, S, C, hat, K, s, small, place, nnz):  # type: ignore[no-untyped-def]
    data = np.zeros(nnz)
    m, n = w.shape
    # A is the second derivative of a point's energy by H_rr, H_rz, H_zr, H_zz, H_yy; J1 is cof F : ∂H there, v is b
    A, block = np.empty((5, 5)), np.empty((14, 14))
    J1, v, Mv = np.empty(14), np.empty((3, 14)), np.empty((3, 14))
    one = s.shape[0] != m
    for e in range(m):
        block[:, :] = 0.0
        v[:, :] = 0.0
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            flat = a * d - b * c
            _moduli(A, a, b, c, d, h, C[e, q], w[e, q])
            if not small:
                p = hat[e, 0] * phi[q, 0] + hat[e, 1] * phi[q, 1] + hat[e, 2] * phi[q, 2]
                _turning(A, a, b, c, d, h, S[e, q], p, w[e, q])
            for l in range(7):
                g, z, o = G[e, q, l, 0], G[e, q, l, 1], ring[e, q, l]
                r0, z0 = A[0, 0] * g + A[0, 1] * z + A[0, 4] * o, A[0, 2] * g + A[0, 3] * z
                r1, z1 = A[1, 0] * g + A[1, 1] * z + A[1, 4] * o, A[1, 2] * g + A[1, 3] * z
                r2, z2 = A[2, 0] * g + A[2, 1] * z + A[2, 4] * o, A[2, 2] * g + A[2, 3] * z
                r3, z3 = A[3, 0] * g + A[3, 1] * z + A[3, 4] * o, A[3, 2] * g + A[3, 3] * z
                r4, z4 = A[4, 0] * g + A[4, 1] * z + A[4, 4] * o, A[4, 2] * g + A[4, 3] * z
                J1[2 * l] = h * (d * g - c * z) + flat * o
                J1[2 * l + 1] = h * (a * z - b * g)
                for k in range(l + 1):
                    g, z, o = G[e, q, k, 0], G[e, q, k, 1], ring[e, q, k]
                    block[2 * k, 2 * l] += g * r0 + z * r1 + o * r4
                    block[2 * k, 2 * l + 1] += g * z0 + z * z1 + o * z4
                    block[2 * k + 1, 2 * l] += g * r2 + z * r3
                    block[2 * k + 1, 2 * l + 1] += g * z2 + z * z3
            for i in range(3):
                for l in range(14):
                    v[i, l] += Q[e, i, q] * J1[l]
        for i in range(3):
            Mv[i, :] = 0.0
            for j in range(3):
                mass = 0.0
                for q in range(n):
                    mass += w[e, q] * (K if one else K * s[e, q]) * phi[q, i] * phi[q, j]
                for l in range(14):
                    Mv[i, l] += mass * v[j, l]
        for k in range(14):
            for l in range(k, 14):
                block[k, l] += v[0, k] * Mv[0, l] + v[1, k] * Mv[1, l] + v[2, k] * Mv[2, l]
            for l in range(k):
                block[k, l] = block[l, k]
        for k in range(14):
            for l in range(14):
                if place[e, k, l] >= 0:
                    data[place[e, k, l]] += block[k, l]
    return data


@compiled(fastmath=True)
def _moduli(A, a, b, c, d, h, C, w):  # type: ignore[no-untyped-def]
    """Fill A (5, 5) with w Lᵀ ℂ L, L the derivative of Green's strain by H."""
    of_L = ((0, 0, a, 4, b), (1, 2, b, 4, a), (2, 0, c, 4, d), (3, 2, d, 4, c), (4, 1, h, 1, 0.0))
    for j, first, x, second, y in of_L:  # a column of L and its entries
        t0, t1 = w * (C[0, first] * x + C[0, second] * y), w * (C[1, first] * x + C[1, second] * y)
        t2, t4 = w * (C[2, first] * x + C[2, second] * y), w * (C[4, first] * x + C[4, second] * y)
        A[0, j], A[1, j] = a * t0 + b * t4, b * t2 + a * t4
        A[2, j], A[3, j] = c * t0 + d * t4, d * t2 + c * t4
        A[4, j] = h * t1


@compiled(fastmath=True)
def _turning(A, a, b, c, d, h, S, p, w):  # type: ignore[no-untyped-def]
    """Add w (S : HᵀH + p ∂²J) to A (5, 5)."""
    s0, s1, s2, s4, p = w * S[0], w * S[1], w * S[2], w * S[4], w * p
    A[0, 0] += s0
    A[2, 2] += s0
    A[1, 1] += s2
    A[3, 3] += s2
    A[4, 4] += s1
    for i, j, value in (
        (0, 1, s4), (2, 3, s4), (0, 3, p * h), (1, 2, -p * h), (0, 4, p * d), (1, 4, -p * c), (2, 4, -p * b),
        (3, 4, p * a),
    ):  # fmt: skip
        A[i, j] += value
        A[j, i] += value
