"""Second Piola–Kirchhoff stress and tangent of any law at all quadrature points.

Voigt order 11, 22, 33, 23, 13, 12 with doubled shear strains.  For a small-strain law the deformation gradient
handed on is the identity, so that the element kernels need not know the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from fem_backend.laws import Law

VOIGT = np.array([[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]])


@dataclass(frozen=True)
class PointState:
    """What the element kernels need, (m, q, …): F used in δE, S (6) and, if asked for, ℂ (6, 6); MPa.

    `S_geometric` is the stress of the geometric stiffness (zero for small strain); `energy` is per reference volume.
    """

    F: np.ndarray
    S: np.ndarray
    S_geometric: np.ndarray
    C: np.ndarray | None
    energy: np.ndarray


class Inverted(ArithmeticError):
    """An element has J ≤ 0."""


def evaluate(law: Law, H: np.ndarray, tangent: bool) -> PointState:
    """Stress (and tangent) from displacement gradients H (m, q, 3, 3); raises Inverted if any J ≤ 0."""
    if law.small_strain:
        return _small_strain(law, H)
    F = H + np.eye(3)
    i1, i2, J = invariants(F)
    if not np.all(J > 0.0):
        raise Inverted(f"{int(np.count_nonzero(~(J > 0)))} quadrature points have J <= 0")
    d = law.derivatives(i1, i2, J)
    S, C = _isotropic(F, J, *d, tangent)
    return PointState(F, S, S, C if tangent else None, law.energy(i1, i2, J))


def _small_strain(law: Law, H: np.ndarray) -> PointState:
    """σ = λ tr ε I + 2μ ε."""
    mu, lam = law.shear_modulus, law.bulk_modulus - 2.0 / 3.0 * law.shear_modulus
    D = np.zeros((6, 6))
    D[:3, :3] = lam
    D += np.diag([2 * mu] * 3 + [mu] * 3)
    strain = np.stack(
        [H[..., i, j] + (H[..., j, i] if i != j else 0.0) for i, j in VOIGT], axis=-1
    )  # engineering shear
    S = strain @ D
    shape = H.shape[:2]
    F = np.ascontiguousarray(np.broadcast_to(np.eye(3), H.shape))
    C = np.ascontiguousarray(np.broadcast_to(D, (*shape, 6, 6)))
    return PointState(F, S, np.zeros_like(S), C, 0.5 * (S * strain).sum(-1))


@numba.njit(cache=True)
def invariants(F):  # type: ignore[no-untyped-def]
    """Ī₁, Ī₂ and J at points F (m, q, 3, 3)."""
    m, n = F.shape[0], F.shape[1]
    i1, i2, jac = np.empty((m, n)), np.empty((m, n)), np.empty((m, n))
    for e in range(m):
        for q in range(n):
            f = F[e, q]
            J = (
                f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
                - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
                + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
            )
            trace, square = 0.0, 0.0
            for i in range(3):
                for j in range(3):
                    c = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
                    square += c * c
                    if i == j:
                        trace += c
            jac[e, q] = J
            if J > 0.0:
                i1[e, q] = trace * J ** (-2.0 / 3.0)
                i2[e, q] = 0.5 * (trace * trace - square) * J ** (-4.0 / 3.0)
            else:
                i1[e, q] = np.nan
                i2[e, q] = np.nan
    return i1, i2, jac


@numba.njit(cache=True)
def _isotropic(F, jac, w1, w2, w11, w12, w22, u1, u2, tangent):  # type: ignore[no-untyped-def]
    """S = 2 ∂W/∂C and ℂ = 4 ∂²W/∂C² for W(Ī₁, Ī₂) + U(J) (Holzapfel 2000, §6.4 and 6.6, in Voigt form).

    ∂Ī₁/∂C = a = J^(-2/3)(I − I₁/3 C⁻¹), ∂Ī₂/∂C = b = J^(-4/3)(I₁ I − C − 2/3 I₂ C⁻¹), ∂J/∂C = J/2 C⁻¹.
    """
    m, n = F.shape[0], F.shape[1]
    S = np.empty((m, n, 6))
    C4 = np.empty((m, n, 6, 6) if tangent else (1, 1, 6, 6))
    row = np.array([0, 1, 2, 1, 0, 0])
    col = np.array([0, 1, 2, 2, 2, 1])
    one = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    c, ci, a, b, t = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    G = np.empty((3, 3))
    for e in range(m):
        for q in range(n):
            f, J = F[e, q], jac[e, q]
            for k in range(6):
                i, j = row[k], col[k]
                c[k] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
            J2 = J * J
            ci[0] = (c[1] * c[2] - c[3] * c[3]) / J2
            ci[1] = (c[0] * c[2] - c[4] * c[4]) / J2
            ci[2] = (c[0] * c[1] - c[5] * c[5]) / J2
            ci[3] = (c[4] * c[5] - c[0] * c[3]) / J2
            ci[4] = (c[5] * c[3] - c[1] * c[4]) / J2
            ci[5] = (c[3] * c[4] - c[2] * c[5]) / J2
            I1 = c[0] + c[1] + c[2]
            I2 = c[0] * c[1] + c[1] * c[2] + c[0] * c[2] - c[3] * c[3] - c[4] * c[4] - c[5] * c[5]
            j23 = J ** (-2.0 / 3.0)
            j43 = j23 * j23
            W1, W2, U1 = w1[e, q], w2[e, q], u1[e, q]
            for k in range(6):
                t[k] = I1 * one[k] - c[k]
                a[k] = j23 * (one[k] - I1 / 3.0 * ci[k])
                b[k] = j43 * (t[k] - 2.0 / 3.0 * I2 * ci[k])
                S[e, q, k] = 2.0 * (W1 * a[k] + W2 * b[k] + 0.5 * U1 * J * ci[k])
            if not tangent:
                continue
            G[0, 0], G[1, 1], G[2, 2] = ci[0], ci[1], ci[2]
            G[1, 2] = G[2, 1] = ci[3]
            G[0, 2] = G[2, 0] = ci[4]
            G[0, 1] = G[1, 0] = ci[5]
            aa, ab, bb, uu = w11[e, q], w12[e, q], w22[e, q], u2[e, q] * 0.25 * J2
            cc = W1 * j23 * I1 / 9.0 + W2 * j43 * 4.0 / 9.0 * I2 + 0.25 * U1 * J + uu
            gg = W1 * j23 * I1 / 3.0 + W2 * j43 * 2.0 / 3.0 * I2 - 0.5 * U1 * J
            for k in range(6):
                i, j = row[k], col[k]
                for l in range(k, 6):
                    p, r = row[l], col[l]
                    inverse = 0.5 * (G[i, p] * G[j, r] + G[i, r] * G[j, p])
                    identity = 0.0
                    if k == l:
                        identity = 1.0 if k < 3 else 0.5
                    value = 4.0 * (
                        aa * a[k] * a[l]
                        + ab * (a[k] * b[l] + b[k] * a[l])
                        + bb * b[k] * b[l]
                        + cc * ci[k] * ci[l]
                        + gg * inverse
                        - W1 * j23 / 3.0 * (ci[k] * one[l] + one[k] * ci[l])
                        + W2 * j43 * (one[k] * one[l] - identity - 2.0 / 3.0 * (ci[k] * t[l] + t[k] * ci[l]))
                    )
                    C4[e, q, k, l] = value
                    C4[e, q, l, k] = value
    return S, C4
