"""Linear viscoelasticity in finite strain: a Prony series on the isochoric stress."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prony:
    """S = S_vol + (1 − Σ gᵢ) S_iso + Σ hᵢ, hᵢ(t) = gᵢ ∫₀ᵗ exp(−(t − s)/τᵢ) dS_iso/ds ds.

    g without unit, τ in s.  The moduli of the elastic law are the instantaneous ones; the volume change is elastic.
    Assumes a material at rest at t = 0, one temperature and relaxation that does not depend on the strain.
    Validity: moderate strains and departures from equilibrium; the law is objective at any strain.
    Raises ValueError unless g and τ have one length, g ≥ 0, Σ g < 1 and τ > 0.
    Source: Simo 1987; Holzapfel 2000, §6.10, whose long-term moduli are here 1 − Σ g times the instantaneous ones.
    """

    g: tuple[float, ...]
    tau: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.g) != len(self.tau):
            raise ValueError(f"prony g = {self.g}, tau = {self.tau}: one time for each share")
        if not (all(g >= 0.0 for g in self.g) and math.fsum(self.g) < 1.0):
            raise ValueError(f"prony g = {self.g}: shares must not be negative and must sum to less than 1")
        if not all(tau > 0.0 for tau in self.tau):
            raise ValueError(f"prony tau = {self.tau} s: times must be positive")

    def weights(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Decay exp(−Δt/τᵢ) of hᵢ and weight gᵢ exp(−Δt/2τᵢ) of the new stress increment, (k,).

        The midpoint rule for the convolution over one step: second order in Δt, instantaneous for Δt ≪ τ, fully
        relaxed for Δt ≫ τ, never unstable (Simo & Hughes 1998, §10.3; Holzapfel 2000, §6.10).
        """
        x = dt / np.array(self.tau, dtype=float)
        return np.exp(-x), np.array(self.g, dtype=float) * np.exp(-0.5 * x)

    def factor(self, dt: float) -> float:
        """Algorithmic share 1 − Σ gᵢ + Σ gᵢ exp(−Δt/2τᵢ) of the elastic isochoric stress and tangent in one step."""
        return 1.0 - math.fsum(self.g) + float(self.weights(dt)[1].sum())
