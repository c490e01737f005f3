"""Stress and stretch at the quadrature points, and smoothed to the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend.kinematics import axisymmetric
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.kinematics.bodies import Body, displacement_gradients
from fem_backend.kinematics.voigt import VOIGT_PLACE
from fem_backend.materials import stress
from fem_backend.materials.stress import PointState

# corners on both sides of mid-edge nodes 4 to 9
MIDDLES_OF_TETRAHEDRON = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])


@dataclass(frozen=True)
class Fields:
    """At the quadrature points: F (m, q, 3, 3), J (m, q), Cauchy stress (m, q, 3, 3) MPa, von Mises (m, q) MPa,
    principal stretches (m, q, 3), the largest first."""

    F: np.ndarray
    J: np.ndarray
    cauchy: np.ndarray
    von_mises: np.ndarray
    stretches: np.ndarray


@dataclass(frozen=True)
class Nodal:
    """Smoothed to the nodes: J (n,), Cauchy stress (n, 3, 3) MPa, von Mises of it (n,) MPa, stretches (n, 3)."""

    J: np.ndarray
    cauchy: np.ndarray
    von_mises: np.ndarray
    stretches: np.ndarray


def stress_fields(
    body: Body, u: np.ndarray, material: Any, scale: np.ndarray | None = None, state: PointState | None = None
) -> Fields:
    """σ = F S Fᵀ/J, σ_vM = √(3/2 dev σ : dev σ), stretches = √eig(FᵀF) from displacements u (n, 3) mm.

    `material` is what `stress.evaluate_stress` takes; `scale` (m, q) multiplies its stress.  A path-dependent material
    needs the `state` of the step, whose stress is taken as it is.  For small strain σ = S, J = 1 + tr ε and the
    stretches are 1 + eig(ε).  Raises stress.Inverted if any J ≤ 0.  Source: Holzapfel 2000, eq. 3.65, 2.124.
    """
    H = displacement_gradients(body, u)
    F = H + np.eye(3)
    stretches: np.ndarray
    if state is None:
        S = stress.evaluate_stress(material, H, False).S[..., VOIGT_PLACE]
        S = S if scale is None else S * scale[..., None, None]
    else:
        S = state.S[..., VOIGT_PLACE]
    if material.small_strain:
        strain = 0.5 * (H + np.swapaxes(H, -1, -2))
        J, cauchy = 1.0 + np.trace(strain, axis1=-2, axis2=-1), S
        stretches = 1.0 + np.linalg.eigvalsh(strain)[..., ::-1]
    else:
        J = np.linalg.det(F)
        cauchy = F @ S @ np.swapaxes(F, -1, -2) / J[..., None, None]
        stretches = np.linalg.svd(F, compute_uv=False)
    return Fields(F, J, cauchy, von_mises(cauchy), stretches)


def von_mises(cauchy: np.ndarray) -> np.ndarray:
    """√(3/2 s : s), s = dev σ, for stresses (…, 3, 3)."""
    s = cauchy - np.trace(cauchy, axis1=-2, axis2=-1)[..., None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * (s * s).sum((-2, -1)))


def to_nodes(body: Body, values: np.ndarray) -> np.ndarray:
    """Nodal values (n, …) of a field (m, q, …) at the quadrature points.

    In each cell the linear field through the points is taken to the corners, where cells are averaged by volume; a
    mid-edge node has the mean of its ends.  Linear fields are exact.  Across a jump of stiffness the stress is smeared
    over one row of cells.
    """
    if isinstance(body, MeridianBody):
        at, middles = axisymmetric.linear_functions(), np.array(axisymmetric.MIDDLES_OF_TRIANGLE)
    else:
        xi = get_quadrature(RefTet, 2)[0].T
        at, middles = np.column_stack([1.0 - xi.sum(1), xi]), MIDDLES_OF_TETRAHEDRON
    corners = np.einsum("cq,mq...->mc...", np.linalg.pinv(at), values)
    volume = body.w.sum(1)
    count = len(body.nodes)
    weight = np.zeros(count)
    out = np.zeros((count, *values.shape[2:]))
    for c in range(at.shape[1]):
        np.add.at(weight, body.cells[:, c], volume)
        np.add.at(out, body.cells[:, c], corners[:, c] * volume.reshape(-1, *[1] * (values.ndim - 2)))
    used = weight > 0.0
    out[used] /= weight[used].reshape(-1, *[1] * (values.ndim - 2))
    for k, (i, j) in enumerate(middles):
        out[body.cells[:, at.shape[1] + k]] = 0.5 * (out[body.cells[:, i]] + out[body.cells[:, j]])
    if isinstance(body, MeridianBody):
        out[body.cells[:, 6]] = out[body.cells[:, :3]].mean(1)
    return out


def nodal(body: Body, at_points: Fields) -> Nodal:
    """Smoothed fields; von Mises is taken of the smoothed stress, so that it is never negative."""
    cauchy = to_nodes(body, at_points.cauchy)
    return Nodal(to_nodes(body, at_points.J), cauchy, von_mises(cauchy), to_nodes(body, at_points.stretches))
