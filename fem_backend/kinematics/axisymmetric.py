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
from fem_backend.kinematics.numbering import Pattern, numbering, pattern_of

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
    B, CB = np.empty((4, 14)), np.empty((4, 14))
    block = np.empty((14, 14))
    J1, V = np.empty(14), np.empty((n, 14))  # cof F : ∂H at a point, and at all of them projected
    one = s.shape[0] != m
    row = np.array([0, 1, 2, 4])
    for e in range(m):
        block[:, :] = 0.0
        V[:, :] = 0.0
        for q in range(n):
            a, b, c, d, h = F[e, q, 0, 0], F[e, q, 0, 2], F[e, q, 2, 0], F[e, q, 2, 2], F[e, q, 1, 1]
            wq, flat = w[e, q], a * d - b * c
            p = hat[e, 0] * phi[q, 0] + hat[e, 1] * phi[q, 1] + hat[e, 2] * phi[q, 2]
            for k in range(7):
                g, z, o = G[e, q, k, 0], G[e, q, k, 1], ring[e, q, k]
                B[0, 2 * k], B[0, 2 * k + 1] = a * g, c * g
                B[1, 2 * k], B[1, 2 * k + 1] = h * o, 0.0
                B[2, 2 * k], B[2, 2 * k + 1] = b * z, d * z
                B[3, 2 * k], B[3, 2 * k + 1] = a * z + b * g, c * z + d * g
                J1[2 * k] = h * (d * g - c * z) + flat * o
                J1[2 * k + 1] = h * (a * z - b * g)
            for t in range(n):  # Q_i(q) φ_i(t): what a volume change here is there
                share = Q[e, 0, q] * phi[t, 0] + Q[e, 1, q] * phi[t, 1] + Q[e, 2, q] * phi[t, 2]
                for k in range(14):
                    V[t, k] += share * J1[k]
            for i in range(4):
                c0, c1 = wq * C[e, q, row[i], 0], wq * C[e, q, row[i], 1]
                c2, c3 = wq * C[e, q, row[i], 2], wq * C[e, q, row[i], 4]
                for k in range(14):
                    CB[i, k] = c0 * B[0, k] + c1 * B[1, k] + c2 * B[2, k] + c3 * B[3, k]
            for k in range(14):
                b0, b1, b2, b3 = B[0, k], B[1, k], B[2, k], B[3, k]
                for l in range(k, 14):
                    block[k, l] += b0 * CB[0, l] + b1 * CB[1, l] + b2 * CB[2, l] + b3 * CB[3, l]
            if small:
                continue
            s0, s1, s2, s4, pw = wq * S[e, q, 0], wq * S[e, q, 1], wq * S[e, q, 2], wq * S[e, q, 4], wq * p
            for k in range(7):
                g, z, o = G[e, q, k, 0], G[e, q, k, 1], ring[e, q, k]
                t0, t1 = s0 * g + s4 * z, s4 * g + s2 * z
                bent, tilt = pw * (d * g - c * z), pw * (a * z - b * g)
                for l in range(k, 7):
                    gl, zl, ol = G[e, q, l, 0], G[e, q, l, 1], ring[e, q, l]
                    v = t0 * gl + t1 * zl
                    cross = pw * h * (g * zl - z * gl)
                    block[2 * k, 2 * l] += v + s1 * o * ol + bent * ol + pw * o * (d * gl - c * zl)
                    block[2 * k + 1, 2 * l + 1] += v
                    block[2 * k, 2 * l + 1] += cross + pw * o * (a * zl - b * gl)
                    if l > k:
                        block[2 * k + 1, 2 * l] += -cross + tilt * ol
        for q in range(n):
            factor = w[e, q] * (K if one else K * s[e, q])
            for k in range(14):
                vk = factor * V[q, k]
                for l in range(k, 14):
                    block[k, l] += vk * V[q, l]
        for k in range(14):
            for l in range(k):
                block[k, l] = block[l, k]
        for k in range(14):
            for l in range(14):
                if place[e, k, l] >= 0:
                    data[place[e, k, l]] += block[k, l]
    return data
