"""What every law is: W(Ī₁, Ī₂) + U(J) with Ī₁ = J^(-2/3) tr C and Ī₂ = J^(-4/3) (tr²C − tr C²)/2, U = (J − 1)²/D₁."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np


class Derivatives(NamedTuple):
    """W₁ = ∂W/∂Ī₁, W₂, W₁₁, W₁₂, W₂₂, U′ = dU/dJ and U″ at points (…); MPa."""

    w1: np.ndarray
    w2: np.ndarray
    w11: np.ndarray
    w12: np.ndarray
    w22: np.ndarray
    u1: np.ndarray
    u2: np.ndarray


class Law(Protocol):
    """An isotropic hyperelastic law of the two isochoric invariants."""

    small_strain: bool

    @property
    def shear_modulus(self) -> float:
        """Initial shear modulus μ (MPa); every penalty is a multiple of it."""

    @property
    def bulk_modulus(self) -> float:
        """Initial bulk modulus K (MPa)."""

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Strain energy per reference volume (MPa)."""

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        """First and second derivatives of the energy."""


@dataclass(frozen=True)
class Isotropic:
    """The two constants that all laws share: initial shear modulus μ (MPa) and D₁ (1/MPa), K = 2/D₁."""

    mu: float
    D1: float
    small_strain = False

    @property
    def shear_modulus(self) -> float:
        return self.mu

    @property
    def bulk_modulus(self) -> float:
        return 2.0 / self.D1

    def volume_energy(self, J: np.ndarray) -> np.ndarray:
        """U = (J − 1)²/D₁ (MPa)."""
        return (J - 1.0) ** 2 / self.D1

    def pressure(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """U′ = 2(J − 1)/D₁ and U″ = 2/D₁ (MPa)."""
        return 2.0 * (J - 1.0) / self.D1, np.full_like(J, 2.0 / self.D1)
