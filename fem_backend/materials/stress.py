"""Second Piola–Kirchhoff stress and tangent of any material at all quadrature points.

Voigt order 11, 22, 33, 23, 13, 12 with doubled shear strains.  For a small-strain law the deformation gradient
handed on is the identity, so that the element kernels need not know the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.compiled import compiled
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW, cauchy_green, fill_tensor
from fem_backend.laws import Derivatives, Law, Material
from fem_backend.materials.regions import Regions


@dataclass(frozen=True)
class History:
    """State at the end of the last converged step: S_iso (m, q, 6), h (k, m, q, 6), W_max (m, q); MPa.

    `S_iso` is the elastic isochoric stress (softened, before relaxation), `h` the overstress of each Prony term,
    `W_max` the largest isochoric energy of the elastic law so far.
    """

    S_iso: np.ndarray
    h: np.ndarray
    W_max: np.ndarray


@dataclass(frozen=True)
class PointState:
    """What the element kernels need, (m, q, …): F used in δE, S (6) and, if asked for, ℂ (6, 6); MPa.

    `S_geometric` is the stress of the geometric stiffness (zero for small strain); `energy` is per reference volume;
    `history` is the one at the end of this step if it is accepted, None for an elastic material.
    """

    F: np.ndarray
    S: np.ndarray
    S_geometric: np.ndarray
    C: np.ndarray | None
    energy: np.ndarray
    history: History | None = None


class Inverted(ArithmeticError):
    """An element has J ≤ 0, or an energy that is no finite number."""


def virgin(material: Material | Regions | Law, m: int, q: int) -> History | None:
    """History of a body that was never loaded, m elements of q points; None if the material has no memory."""
    if not (isinstance(material, Material | Regions) and material.path_dependent):
        return None
    terms = len(material.prony.g) if material.prony else 0
    return History(np.zeros((m, q, 6)), np.zeros((terms, m, q, 6)), np.zeros((m, q)))


def evaluate_stress(
    material: Material | Regions | Law,
    H: np.ndarray,
    tangent: bool,
    history: History | None = None,
    dt: float = 0.0,
    scale: np.ndarray | None = None,
) -> PointState:
    """Stress (and tangent) from displacement gradients H (m, q, 3, 3) at the end of a step of Δt = dt s.

    `history` is that of the step's start (None: never loaded); `scale` (m, q) multiplies every modulus, while histories
    stay those of the unscaled material.  S is the derivative of `energy` by the Green strain with the history held:
    for a material with memory `energy` is the potential of the step, a Φ(W) + U + H:E with a = `Prony.factor`,
    Φ of `Mullins.soften` and H what the history adds to the stress; ℂ is its second derivative, hence symmetric.
    Raises Inverted if any J ≤ 0 or any energy is not finite.
    """
    if isinstance(material, Regions):
        return _by_region(material, H, tangent, history, dt, scale)
    if not isinstance(material, Material):
        material = Material(material)
    if material.small_strain:
        return _small_strain(material, H, tangent, scale)
    law = material.law
    F = H + np.eye(3)
    i1, i2, J = invariants(F)
    _refuse(~(J > 0.0), "J <= 0")
    if material.fibre or material.path_dependent or law.principal:
        return _composed(material, F, (i1, i2, J), tangent, history, dt, scale)
    d, energy = law.derivatives(i1, i2, J), law.energy(i1, i2, J)
    if scale is not None:
        d, energy = Derivatives(*(scale * v for v in d)), scale * energy
    _refuse(~np.isfinite(energy), "no finite energy")
    S, C = _isotropic(F, J, *d, tangent)
    return PointState(F, S, S, C if tangent else None, energy)


def _by_region(
    regions: Regions, H: np.ndarray, tangent: bool, history: History | None, dt: float, scale: np.ndarray | None
) -> PointState:
    """The states of each region's cells, put together."""
    m, q = H.shape[:2]
    out: dict[str, np.ndarray] = {}
    after = history = virgin(regions, m, q) if history is None else history
    if after is not None:
        after = History(np.empty_like(after.S_iso), np.empty_like(after.h), np.empty_like(after.W_max))
    for k, material in enumerate(regions.materials):
        c = np.flatnonzero(regions.of == k)
        if not len(c):
            continue
        began = None if history is None else History(history.S_iso[c], history.h[:, c], history.W_max[c])
        part = evaluate_stress(material, H[c], tangent, began, dt, None if scale is None else scale[c])
        for name in ("F", "S", "S_geometric", "C", "energy"):
            value = getattr(part, name)
            if value is not None:
                out.setdefault(name, np.empty((m, *value.shape[1:])))[c] = value
        if after is not None and part.history is not None:
            after.S_iso[c], after.h[:, c], after.W_max[c] = part.history.S_iso, part.history.h, part.history.W_max
    return PointState(out["F"], out["S"], out["S_geometric"], out.get("C"), out["energy"], after)


def _refuse(bad: np.ndarray, why: str) -> None:
    if bad.any():
        raise Inverted(f"{int(np.count_nonzero(bad))} quadrature points have {why}")


def _composed(
    material: Material,
    F: np.ndarray,
    invariant: tuple[np.ndarray, np.ndarray, np.ndarray],
    tangent: bool,
    history: History | None,
    dt: float,
    scale: np.ndarray | None,
) -> PointState:
    """Isochoric part first, then fibres, memory and the volume on top of it."""
    law, (i1, i2, J) = material.law, invariant
    if law.principal:
        W, S, C = law.isochoric(F, J, tangent)
        U, (u1, u2) = law.volume_energy(J), law.pressure(J)
    else:
        d, zero = law.derivatives(i1, i2, J), np.zeros_like(J)
        S, C = _isotropic(F, J, *d[:5], zero, zero, tangent)
        W, U = law.energy(i1, i2, np.ones_like(J)), law.energy(np.full_like(J, 3.0), np.full_like(J, 3.0), J)
        u1, u2 = d.u1, d.u2
    if material.fibre:
        material.fibre.add(F, J, W, S, C, tangent)
    energy, factor, slope, added, now = _remember(material, W, S, history, dt)
    energy = energy + U
    _finish(F, J, S, C, energy, u1, u2, factor, slope, added, np.ones_like(J) if scale is None else scale, tangent)
    _refuse(~np.isfinite(energy), "no finite energy")
    return PointState(F, S, S, C if tangent else None, energy, now)


def _remember(
    material: Material, W: np.ndarray, S: np.ndarray, history: History | None, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, History | None]:
    """Potential Φ, factor and slope with S ↦ factor S + added, ℂ ↦ factor ℂ + slope S⊗S, and the new history.

    hᵢ ← e^{−x} hᵢ + gᵢ (1 − e^{−x})/x (S_iso − S_iso,n), x = Δt/τᵢ: what does not depend on the strain now is `added`.
    """
    if not material.path_dependent:
        return W, np.ones_like(W), np.zeros_like(W), np.zeros((1, 1, 6)), None
    if history is None:
        history = virgin(material, *W.shape)
    assert history is not None  # the material is path-dependent
    eta, slope, potential, W_max = np.ones_like(W), np.zeros_like(W), W, history.W_max
    if material.mullins:
        eta, slope, potential = material.mullins.soften(W, W_max)
        W_max = np.maximum(W, W_max)
    soft = eta[..., None] * S
    added, h, factor = np.zeros((1, 1, 6)), history.h, 1.0
    if material.prony:
        decay, weight = (v[:, None, None, None] for v in material.prony.weights(dt))
        kept = decay * h - weight * history.S_iso
        added, h, factor = kept.sum(0), kept + weight * soft, material.prony.factor(dt)
    return factor * potential, factor * eta, factor * slope, added, History(soft, h, W_max)


@compiled()
def _finish(F, jac, S, C4, energy, u1, u2, factor, slope, added, scale, tangent):  # type: ignore[no-untyped-def]
    """Turn the elastic isochoric S and ℂ in place into those of the material, and add H:E to the energy.

    S ↦ factor S + added + U′J C⁻¹, ℂ ↦ factor ℂ + slope S⊗S + (J²U″ + JU′) C⁻¹⊗C⁻¹ − 2JU′ C⁻¹⊙C⁻¹, all times scale.
    """
    m, n = F.shape[0], F.shape[1]
    c, ci, s = np.empty(6), np.empty(6), np.empty(6)
    G = np.empty((3, 3))
    some = added.shape[0] == m and added.shape[1] == n
    for e in range(m):
        for q in range(n):
            J, much, a = jac[e, q], scale[e, q], factor[e, q]
            cauchy_green(F[e, q], J, c, ci)
            p = u1[e, q] * J
            for k in range(6):
                s[k] = S[e, q, k]
                value = a * s[k] + p * ci[k]
                if some:
                    value += added[e, q, k]
                    energy[e, q] += added[e, q, k] * (0.5 * (c[k] - 1.0) if k < 3 else c[k])
                S[e, q, k] = much * value
            energy[e, q] *= much
            if not tangent:
                continue
            fill_tensor(ci, G)
            volume, steep = p + u2[e, q] * J * J, slope[e, q]
            for k in range(6):
                i, j = VOIGT_ROW[k], VOIGT_COLUMN[k]
                for l in range(k, 6):
                    o, r = VOIGT_ROW[l], VOIGT_COLUMN[l]
                    value = a * C4[e, q, k, l] + steep * s[k] * s[l] + volume * ci[k] * ci[l]
                    value -= p * (G[i, o] * G[j, r] + G[i, r] * G[j, o])
                    C4[e, q, k, l] = much * value
                    C4[e, q, l, k] = much * value


def _small_strain(material: Material, H: np.ndarray, tangent: bool, scale: np.ndarray | None) -> PointState:
    """σ = 2μ dev ε + K tr ε I."""
    mu, K = material.shear_modulus, material.bulk_modulus
    one = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    volume = K * np.outer(one, one)
    shape = mu * np.diag([2.0] * 3 + [1.0] * 3) - 2.0 / 3.0 * mu * np.outer(one, one)
    strain = np.stack(
        [H[..., i, j] + (H[..., j, i] if i != j else 0.0) for i, j in zip(VOIGT_ROW, VOIGT_COLUMN, strict=True)],
        axis=-1,
    )  # engineering shear
    S, C = strain @ (shape + volume), np.broadcast_to(shape + volume, (*H.shape[:2], 6, 6))
    energy = 0.5 * (S * strain).sum(-1)
    if scale is not None:
        energy, S, C = scale * energy, scale[..., None] * S, scale[..., None, None] * C
    _refuse(~np.isfinite(energy), "no finite energy")
    F = np.ascontiguousarray(np.broadcast_to(np.eye(3), H.shape))
    return PointState(F, S, np.zeros_like(S), np.ascontiguousarray(C) if tangent else None, energy)


@compiled()
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
                shrunk = J ** (-2.0 / 3.0)
                i1[e, q] = trace * shrunk
                i2[e, q] = 0.5 * (trace * trace - square) * shrunk * shrunk
            else:
                i1[e, q] = np.nan
                i2[e, q] = np.nan
    return i1, i2, jac


@compiled()
def _isotropic(F, jac, w1, w2, w11, w12, w22, u1, u2, tangent):  # type: ignore[no-untyped-def]
    """S = 2 ∂W/∂C and ℂ = 4 ∂²W/∂C² for W(Ī₁, Ī₂) + U(J) (Holzapfel 2000, §6.4 and 6.6, in Voigt form).

    ∂Ī₁/∂C = a = J^(-2/3)(I − I₁/3 C⁻¹), ∂Ī₂/∂C = b = J^(-4/3)(I₁ I − C − 2/3 I₂ C⁻¹), ∂J/∂C = J/2 C⁻¹.
    """
    m, n = F.shape[0], F.shape[1]
    S = np.empty((m, n, 6))
    C4 = np.empty((m, n, 6, 6) if tangent else (1, 1, 6, 6))
    one = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    c, ci, a, b, t, y = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    G = np.empty((3, 3))
    for e in range(m):
        for q in range(n):
            J = jac[e, q]
            cauchy_green(F[e, q], J, c, ci)
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
            fill_tensor(ci, G)
            w, v = 4.0 * W1 * j23, 4.0 * W2 * j43
            aa, ab, bb, uu = 4.0 * w11[e, q], 4.0 * w12[e, q], 4.0 * w22[e, q], u2[e, q] * J * J
            cc = w * I1 / 9.0 + v * 4.0 / 9.0 * I2 + U1 * J + uu
            gg = 0.5 * (w * I1 / 3.0 + v * 2.0 / 3.0 * I2) - U1 * J
            for k in range(6):
                y[k] = -w / 3.0 * one[k] - 2.0 / 3.0 * v * t[k]
            for k in range(6):
                i, j = VOIGT_ROW[k], VOIGT_COLUMN[k]
                of_a, of_b, of_ci = aa * a[k] + ab * b[k], ab * a[k] + bb * b[k], cc * ci[k] + y[k]
                for l in range(k, 6):
                    p, r = VOIGT_ROW[l], VOIGT_COLUMN[l]
                    value = of_a * a[l] + of_b * b[l] + of_ci * ci[l] + ci[k] * y[l] + v * one[k] * one[l]
                    value += gg * (G[i, p] * G[j, r] + G[i, r] * G[j, p])
                    C4[e, q, k, l] = value
                    C4[e, q, l, k] = value
                C4[e, q, k, k] -= v if k < 3 else 0.5 * v
    return S, C4
