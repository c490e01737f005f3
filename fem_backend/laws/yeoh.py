"""Yeoh: a cubic in Ī₁."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.laws.law import Derivatives, Isotropic


@dataclass(frozen=True)
class Yeoh(Isotropic):
    """W = C₁₀ x + C₂₀ x² + C₃₀ x³ + (1/D₁)(J − 1)² with x = Ī₁ − 3 and C₁₀ = μ/2.

    μ, C₂₀, C₃₀ in MPa, D₁ in 1/MPa; C₂₀ = C₃₀ = 0 is neo-Hookean.  Assumes isotropy and no rate dependence.
    Validity: large stretches of filled elastomers; C₂₀ < 0 softens at first and needs a C₃₀ > 0 large enough
    (`admissible`).  Source: Yeoh 1993; Holzapfel 2000, §6.5.
    """

    C20: float = 0.0
    C30: float = 0.0

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        x = i1 - 3.0
        return (0.5 * self.mu + (self.C20 + self.C30 * x) * x) * x + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        x, zero = i1 - 3.0, np.zeros_like(J)
        w1 = 0.5 * self.mu + (2.0 * self.C20 + 3.0 * self.C30 * x) * x
        w11 = 2.0 * self.C20 + 6.0 * self.C30 * x
        return Derivatives(w1, zero, w11, zero, zero, *self.pressure(J))
