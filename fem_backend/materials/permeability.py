"""Permeability that changes as the pores close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class HolmesMow:
    """k/k₀ = ((J − φ)/(1 − φ))^α exp(M (J² − 1)/2) of an isotropic body, φ the share of solid before deformation.

    Constant with M = α = 0.  Source: Holmes and Mow 1990, J. Biomech. 23, 1145, eq. 21, with J for their λ.
    """

    M: float = 0.0
    alpha: float = 0.0
    solid_fraction: float = 0.0

    @property
    def constant(self) -> bool:
        """Whether it is k₀ at every J."""
        return self.M == 0.0 and self.alpha == 0.0

    def relative(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """k/k₀ and its derivative by J, at J (…); 0 where no pores are left, J ≤ φ."""
        left = J - self.solid_fraction
        share = np.where(left > 0.0, left, 1.0) / (1.0 - self.solid_fraction)
        k = np.where(left > 0.0, share**self.alpha * np.exp(0.5 * self.M * (J**2 - 1.0)), 0.0)
        return k, k * (self.alpha / np.where(left > 0.0, left, 1.0) + self.M * J)
