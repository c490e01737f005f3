"""One family of fibres that stiffen the material along a direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fem_backend.compiled import compiled
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW, cauchy_green, fill_tensor
from rso.contract import knob


@dataclass(frozen=True)
class Fibre:
    """W_f = k₁/(2k₂) (exp(k₂⟨Ī₄ − 1⟩²) − 1) with Ī₄ = J^(-2/3) a·C a, only in tension; k₂ = 0: k₁/2 ⟨Ī₄ − 1⟩².

    k₁ in MPa, k₂ without unit, direction a (3,) of any length in the reference body.  Added to the isochoric part of an
    isotropic law; k₁ = 0 is no fibre.  Assumes perfectly aligned fibres that carry no compression.  The stress is
    continuous, its slope jumps by 4k₁ where the fibre begins to pull; E along it is then 3μ + 4k₁.
    Raises ValueError for a negative constant or a direction of no length.
    Source: Holzapfel, Gasser & Ogden 2000, eq. 65, one family, with the isochoric Ī₄.
    """

    @dataclass(frozen=True)
    class Knobs:
        """The numbers that a study may open."""

        fibre: float = knob(
            "fibre modulus k1",
            "MPa",
            0.0,
            1e3,
            neutral=0.0,
            group="fibre",
            typical=5e-3,
            plausible=(0.05, 3.0),
            label="fibres",
        )
        fibre_k2: float = knob("fibre stiffening exponent k2", "1", 0.0, 100.0, default=0.0, group="fibre")
        fibre_angle: float = knob(
            "fibre direction in the plane z = 0, from x",
            "deg",
            -180.0,
            180.0,
            default=0.0,
            group="fibre",
            plausible=(0.0, 90.0),
        )

    switches: ClassVar[Mapping[str, Mapping[str, float]]] = {"fibre": {"fibre": 0.0}}

    k1: float
    k2: float
    direction: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (self.k1 >= 0.0 and self.k2 >= 0.0):
            raise ValueError(f"fibre k1 = {self.k1} MPa, k2 = {self.k2}: neither may be negative")
        if len(self.direction) != 3 or not 0.0 < math.hypot(*self.direction) < math.inf:
            raise ValueError(f"fibre direction = {self.direction}: three numbers that are not all zero")

    def add(self, F: np.ndarray, J: np.ndarray, W: np.ndarray, S: np.ndarray, C: np.ndarray, tangent: bool) -> None:
        """Add energy, stress and tangent (MPa) to W (m, q), S (m, q, 6) and ℂ (m, q, 6, 6) in place."""
        a = np.array(self.direction, dtype=float)
        _add(F, J, self.k1, self.k2, a / np.linalg.norm(a), W, S, C, tangent)


@compiled()
def _add(F, jac, k1, k2, a0, W, S, C4, tangent):  # type: ignore[no-untyped-def]
    """S = 2W′ ∂Ī₄/∂C, ℂ = 4W″ ∂Ī₄/∂C⊗∂Ī₄/∂C + 4W′ ∂²Ī₄/∂C², ∂Ī₄/∂C = J^(-2/3)(A − I₄/3 C⁻¹), A = a⊗a."""
    m, n = F.shape[0], F.shape[1]
    c, ci, A, d = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    G = np.empty((3, 3))
    for k in range(6):
        A[k] = a0[VOIGT_ROW[k]] * a0[VOIGT_COLUMN[k]]
    for e in range(m):
        for q in range(n):
            J = jac[e, q]
            cauchy_green(F[e, q], J, c, ci)
            I4 = 0.0
            for k in range(6):
                I4 += (1.0 if k < 3 else 2.0) * A[k] * c[k]
            j23 = J ** (-2.0 / 3.0)
            x = j23 * I4 - 1.0
            if not x > 0.0:
                continue
            y = k2 * x * x
            grown = math.exp(y)
            W[e, q] += 0.5 * k1 * x * x * (math.expm1(y) / y if y > 0.0 else 1.0)
            w1, w2 = k1 * x * grown, k1 * (1.0 + 2.0 * y) * grown
            for k in range(6):
                d[k] = j23 * (A[k] - I4 / 3.0 * ci[k])
                S[e, q, k] += 2.0 * w1 * d[k]
            if not tangent:
                continue
            fill_tensor(ci, G)
            for k in range(6):
                i, j = VOIGT_ROW[k], VOIGT_COLUMN[k]
                for l in range(k, 6):
                    p, r = VOIGT_ROW[l], VOIGT_COLUMN[l]
                    inverse = 0.5 * (G[i, p] * G[j, r] + G[i, r] * G[j, p])
                    curve = I4 / 9.0 * ci[k] * ci[l] + I4 / 3.0 * inverse - (ci[k] * A[l] + A[k] * ci[l]) / 3.0
                    value = 4.0 * (w2 * d[k] * d[l] + w1 * j23 * curve)
                    C4[e, q, k, l] += value
                    if l > k:
                        C4[e, q, l, k] += value
