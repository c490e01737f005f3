"""Neo-Hooke: one constant, the law to begin with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.laws.law import Derivatives, Isotropic


@dataclass(frozen=True)
class NeoHooke(Isotropic):
    """W = (μ/2)(Ī₁ − 3) + (1/D₁)(J − 1)², so K = 2/D₁.

    μ in MPa, D₁ in 1/MPa.  Assumes isotropy and no rate dependence; valid to moderate stretches (about 1.5 for
    elastomers).  Source: thesis eq. 2.5–2.6 with the isochoric Ī₁ of ANSYS; Bonet & Wood 2008, eq. 6.50.
    """

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        return 0.5 * self.mu * (i1 - 3.0) + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        zero = np.zeros_like(J)
        return Derivatives(np.full_like(J, 0.5 * self.mu), zero, zero, zero, zero, *self.pressure(J))
