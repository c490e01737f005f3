"""Strain energies and their derivatives, nothing else.  Stresses in MPa, stretches without unit.

An isotropic law is W(Ī₁, Ī₂) + U(J) with Ī₁ = J^(-2/3) tr C and Ī₂ = J^(-4/3) (tr²C − tr C²)/2.
"""

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
    """An isotropic hyperelastic law."""

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
class NeoHooke:
    """W = (μ/2)(Ī₁ − 3) + (1/D₁)(J − 1)², so K = 2/D₁.

    μ in MPa, D₁ in 1/MPa.  Assumes isotropy and no rate dependence; valid to moderate stretches (about 1.5 for
    elastomers).  Source: thesis eq. 2.5–2.6 with the isochoric Ī₁ of ANSYS; Bonet & Wood 2008, eq. 6.50.
    """

    mu: float
    D1: float
    small_strain = False

    @property
    def shear_modulus(self) -> float:
        return self.mu

    @property
    def bulk_modulus(self) -> float:
        return 2.0 / self.D1

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        return 0.5 * self.mu * (i1 - 3.0) + (J - 1.0) ** 2 / self.D1

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        zero = np.zeros_like(J)
        return Derivatives(
            np.full_like(J, 0.5 * self.mu), zero, zero, zero, zero,
            2.0 * (J - 1.0) / self.D1, np.full_like(J, 2.0 / self.D1),
        )  # fmt: skip


@dataclass(frozen=True)
class LinearElastic:
    """σ = 2μ dev ε + K tr ε I with ε = sym ∇u: small strain, geometrically linear body.

    μ in MPa, K = 2/D₁ (D₁ in 1/MPa), so that it shares its knobs with the neo-Hookean law:
    E = 9Kμ/(3K + μ), ν = (3K − 2μ)/(6K + 2μ).  Validity: indentation to about 2 mm here (contact radius ≪ R is
    already violated there).  Source: thesis eq. 2.7–2.11.
    """

    mu: float
    D1: float
    small_strain = True

    @property
    def shear_modulus(self) -> float:
        return self.mu

    @property
    def bulk_modulus(self) -> float:
        return 2.0 / self.D1
