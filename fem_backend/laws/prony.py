"""Linear viscoelasticity in finite strain: a Prony series on the isochoric stress."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rso.contract import knob


@dataclass(frozen=True)
class Prony:
    """S = S_vol + (1 − Σ gᵢ) S_iso + Σ hᵢ, hᵢ(t) = gᵢ ∫₀ᵗ exp(−(t − s)/τᵢ) dS_iso/ds ds.

    g without unit, τ in s.  The moduli of the elastic law are the instantaneous ones; the volume change is elastic.
    Assumes a material at rest at t = 0, one temperature and relaxation that does not depend on the strain.
    Validity: moderate strains and departures from equilibrium; the law is objective at any strain.
    Raises ValueError unless g and τ have one length, g ≥ 0, Σ g < 1 and τ > 0.
    Source: Simo 1987; Holzapfel 2000, §6.10, whose long-term moduli are here 1 − Σ g times the instantaneous ones.
    """

    @dataclass(frozen=True)
    class Knobs:
        """The numbers that a study may open."""

        prony_g: float = knob(
            "relaxing share of the shear modulus, first term",
            "1",
            0.0,
            0.95,
            neutral=0.0,
            group="prony",
            typical=0.2,
            plausible=(0.03, 0.6),
            label="relaxation",
        )
        prony_tau: float = knob(
            "relaxation time, first term",
            "s",
            1e-9,
            1e9,
            default=5.0,
            group="prony",
            typical=5.0,
            plausible=(0.3, 100.0),
        )
        prony_g2: float = knob(
            "relaxing share of the shear modulus, second term", "1", 0.0, 0.95, neutral=0.0, group="prony2", typical=0.1
        )
        prony_tau2: float = knob("relaxation time, second term", "s", 1e-9, 1e9, default=50.0, group="prony2")
        prony_g3: float = knob(
            "relaxing share of the shear modulus, third term", "1", 0.0, 0.95, neutral=0.0, group="prony3", typical=0.1
        )
        prony_tau3: float = knob("relaxation time, third term", "s", 1e-9, 1e9, default=0.5, group="prony3")

    switches: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "prony": {"prony_g": 0.0},
        "prony2": {"prony_g2": 0.0},
        "prony3": {"prony_g3": 0.0},
    }

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
        """Decay exp(−x) of hᵢ and weight gᵢ (1 − exp(−x))/x of the new stress increment, x = Δt/τᵢ, (k,).

        Exact for a stress that is linear in time within the step (Taylor, Pister & Goudreau 1970): second order in Δt,
        instantaneous for Δt ≪ τ, relaxed for Δt ≫ τ, never unstable.
        """
        if not dt >= 0.0:
            raise ValueError(f"time step {dt} s: it must not be negative")
        x = dt / np.array(self.tau, dtype=float)
        mean = -np.expm1(-x) / x if dt > 0.0 else np.ones_like(x)
        return np.exp(-x), np.array(self.g, dtype=float) * mean

    def factor(self, dt: float) -> float:
        """Algorithmic share 1 − Σ gᵢ + Σ gᵢ (1 − exp(−x))/x of the elastic isochoric stress and tangent in one step."""
        return 1.0 - math.fsum(self.g) + float(self.weights(dt)[1].sum())
