"""Mooney–Rivlin with two constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.laws.law import Derivatives, Isotropic


@dataclass(frozen=True)
class MooneyRivlin(Isotropic):
    """W = C₁₀(Ī₁ − 3) + C₀₁(Ī₂ − 3) + (1/D₁)(J − 1)² with C₁₀ = μ/2 − C₀₁, so that μ = 2(C₁₀ + C₀₁).

    μ, C₀₁ in MPa, D₁ in 1/MPa; C₀₁ = 0 is neo-Hookean.  Assumes isotropy and no rate dependence.  Validity: tension
    to about 2; C₀₁ > 0 overestimates compression and equibiaxial tension when fitted to uniaxial tension alone, and
    C₀₁ < 0 or C₀₁ > μ/2 is unstable at some stretch (`admissible`).
    Source: Mooney 1940; thesis eq. 1.14 (eq. 1.15 there misses the factor 2 of μ); Holzapfel 2000, §6.5.
    """

    C01: float = 0.0

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        return (0.5 * self.mu - self.C01) * (i1 - 3.0) + self.C01 * (i2 - 3.0) + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        zero = np.zeros_like(J)
        w1, w2 = np.full_like(J, 0.5 * self.mu - self.C01), np.full_like(J, self.C01)
        return Derivatives(w1, w2, zero, zero, zero, *self.pressure(J))
