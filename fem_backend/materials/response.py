"""What a body answers to a displacement, whatever its elements: energy, nodal forces, history, tangent."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from fem_backend.kinematics import axisymmetric, tetrahedra
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.kinematics.bodies import Body
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW
from fem_backend.laws import Material
from fem_backend.materials import regions, stress
from fem_backend.materials.regions import Regions, Substance
from fem_backend.materials.stress import History, PointState

MAX_LOCAL_BULK_RATIO = 20.0  # K/μ up to which quadratic triangles do not lock, see `split`
MAX_MEAN_BULK_RATIO = 5.0  # the same of tetrahedra that take the mean of their volume change


@dataclass(frozen=True)
class Answer:
    """Displacement gradients H (m, q, 3, 3), energy (N mm), nodal forces (n, 3) N, history should the step end here."""

    H: np.ndarray
    energy: float
    force: np.ndarray
    history: History | None


def material_response(
    body: Body, material: Substance, u: np.ndarray, history: History | None, dt: float, scale: np.ndarray | None
) -> Answer:
    """The answer to displacements u (n, 3) mm at the end of a step of Δt = dt s; raises stress.Inverted."""
    if isinstance(body, tetrahedra.Body):
        H = tetrahedra.displacement_gradients(body, u)
        if body.mean:
            return _mean_answer(body, material, H, history, dt, scale)
        state = stress.evaluate_stress(material, H, False, history, dt, scale)
        force = tetrahedra.internal_force(body, state.F, state.S)
        return Answer(H, float((body.w * state.energy).sum()), force, state.history)
    H = axisymmetric.displacement_gradients(body, u)
    pointwise, K, s = projected(body, material, scale)
    state = stress.evaluate_stress(pointwise, H, False, history, dt, scale)
    volume = axisymmetric.volume(body, H, K, s, material.small_strain)
    force = axisymmetric.internal_force(body, state.F, state.S, volume.p)
    return Answer(H, float((body.w * state.energy).sum()) + volume.energy, force, state.history)


def state(
    body: Body, material: Substance, H: np.ndarray, history: History | None, dt: float, scale: np.ndarray | None
) -> PointState:
    """Stress at the quadrature points, with the pressure that a meridian's elements project: S + p J C⁻¹."""
    if isinstance(body, tetrahedra.Body):
        if body.mean:
            return _mean_state(body, material, H, False, history, dt, scale)[0]
        return stress.evaluate_stress(material, H, False, history, dt, scale)
    pointwise, K, s = projected(body, material, scale)
    found = stress.evaluate_stress(pointwise, H, False, history, dt, scale)
    volume = axisymmetric.volume(body, H, K, s, material.small_strain)
    p = volume.p @ axisymmetric.linear_functions().T
    F = found.F
    pull = (p * np.linalg.det(F))[..., None, None] * np.linalg.inv(np.swapaxes(F, -1, -2) @ F)
    return replace(found, S=found.S + pull[..., VOIGT_ROW, VOIGT_COLUMN])


def material_tangent(
    body: Body, material: Substance, H: np.ndarray, history: History | None, dt: float, scale: np.ndarray | None
) -> np.ndarray:
    """Tangent of the nodal forces at displacement gradients H (m, q, 3, 3) as `data` of the pattern, N/mm."""
    if isinstance(body, tetrahedra.Body):
        if body.mean:
            state = _mean_state(body, material, H, True, history, dt, scale)[0]
        else:
            state = stress.evaluate_stress(material, H, True, history, dt, scale)
        assert state.C is not None  # which was asked for
        data = tetrahedra.stiffness(body, state.F, state.S_geometric, state.C)
        if body.mean:
            _, K, s = projected(body, material, scale, MAX_MEAN_BULK_RATIO)
            tetrahedra.volume_stiffness(body, state.F, K, s, data)
        return data
    (pointwise, K, s), small = projected(body, material, scale), material.small_strain
    state = stress.evaluate_stress(pointwise, H, True, history, dt, scale)
    volume = axisymmetric.volume(body, H, K, s, small)
    assert state.C is not None
    return axisymmetric.stiffness(body, state.F, state.S_geometric, state.C, volume.p, K, s, small)


def _mean_state(
    body: tetrahedra.Body,
    material: Substance,
    H: np.ndarray,
    moduli: bool,
    history: History | None,
    dt: float,
    scale: np.ndarray | None,
) -> tuple[PointState, tetrahedra.MeanVolume]:
    """Stress of tetrahedra that take the mean of their volume change beyond K = MAX_LOCAL_BULK_RATIO μ, and that."""
    (pointwise, K, s), small = projected(body, material, scale, MAX_MEAN_BULK_RATIO), material.small_strain
    found = stress.evaluate_stress(pointwise, H, moduli, history, dt, scale)
    volume = tetrahedra.volume(body, H, K, s, small)
    S, C = tetrahedra.with_pressure(found.F, found.S, found.C, volume.p, small)
    return replace(found, S=S, C=C if moduli else None, S_geometric=found.S_geometric if small else S), volume


def _mean_answer(
    body: tetrahedra.Body,
    material: Substance,
    H: np.ndarray,
    history: History | None,
    dt: float,
    scale: np.ndarray | None,
) -> Answer:
    state, volume = _mean_state(body, material, H, False, history, dt, scale)
    force = tetrahedra.internal_force(body, state.F, state.S)
    return Answer(H, float((body.w * state.energy).sum()) + volume.energy, force, state.history)


@dataclass(frozen=True)
class Linearised:
    """What a meridian's tangent is made of at one state: stresses and moduli at its points, projected pressure.

    K (MPa) is the bulk modulus that is projected, `scale` (m, q) what multiplies it.
    """

    state: PointState
    volume: axisymmetric.Volume
    K: float
    scale: np.ndarray | None
    small: bool


@dataclass(frozen=True)
class Turning:
    """Stresses that turn with a meridian, in the geometric part of its tangent: S (m, q, 6), p̂ (m, 3) MPa."""

    S: np.ndarray
    p: np.ndarray


def linearised(
    body: MeridianBody, material: Substance, H: np.ndarray, history: History | None, dt: float, scale: np.ndarray | None
) -> Linearised:
    """Stresses and moduli of a meridian at displacement gradients H (m, q, 3, 3)."""
    pointwise, K, s = projected(body, material, scale)
    state = stress.evaluate_stress(pointwise, H, True, history, dt, scale)
    return Linearised(state, axisymmetric.volume(body, H, K, s, material.small_strain), K, s, material.small_strain)


def meridian_stiffness(body: MeridianBody, at: Linearised, turning: Turning | None) -> np.ndarray:
    """Tangent `data` of a meridian, N/mm, with other stresses in its geometric part."""
    assert at.state.C is not None
    S, p = (at.state.S_geometric, at.volume.p) if turning is None or at.small else (turning.S, turning.p)
    return axisymmetric.stiffness(body, at.state.F, S, at.state.C, p, at.K, at.scale, at.small)


def stresses_after_step(body: MeridianBody, at: Linearised, step: np.ndarray) -> Turning:
    """Stresses to first order after a step (n, 3) mm: S + ℂ : sym(Fᵀ δH), p̂ + K Π (cof F : δH)."""
    assert at.state.C is not None
    dH = axisymmetric.displacement_gradients(body, step)
    S, p = axisymmetric.linearised_stresses(body, at.state.F, at.state.S, at.state.C, at.volume.p, dH, at.K, at.scale)
    return Turning(S, p)


def projected(
    body: Body, material: Substance, scale: np.ndarray | None, most: float | None = None
) -> tuple[Substance, float, np.ndarray | None]:
    """What acts at points, the bulk modulus (MPa) that elements project, and its factor (m, q)."""
    if not isinstance(material, Regions):
        return *split(material, MAX_LOCAL_BULK_RATIO if most is None else most), scale
    parts = [split(m, MAX_LOCAL_BULK_RATIO if most is None else most) for m in material.materials]
    K = np.array([k for _, k in parts])[material.of][:, None]
    s = K * (np.ones_like(body.w) if scale is None else scale)
    return Regions(tuple(m for m, _ in parts), material.of), 1.0, s


def modulus_at_points(body: Body, material: Substance) -> float:
    """The largest K + μ (MPa) whose stress is found from displacement gradients at the points alone, not projected."""
    of = [split(m)[0] if isinstance(body, MeridianBody) else m for m, _ in regions.region_materials(material)]
    return max(m.bulk_modulus + m.shear_modulus for m in of)


@functools.lru_cache(maxsize=64)
def split(material: Material, most: float = MAX_LOCAL_BULK_RATIO) -> tuple[Material, float]:
    """The material with a bulk modulus of at `most` that many μ, and the rest of it (MPa), which elements project.

    Only by the projection, J would be free to go up and down within an element at large strain.
    """
    K = material.bulk_modulus
    local = min(K, most * material.shear_modulus)
    return replace(material, law=replace(material.law, D1=2.0 / local)), K - local  # type: ignore[type-var]
