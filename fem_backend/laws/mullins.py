"""Softening by the largest energy reached so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import erf

from rso.contract import knob


@dataclass(frozen=True)
class Mullins:
    """S = S_vol + η S_iso, η = 1 − (1/r) erf((W_max − W)/(m + β W_max)), W the isochoric energy of the elastic law.

    r_inverse = 1/r (0: no softening, below 1) and β without unit, m in MPa.  η = 1 while W is the largest energy so
    far (the primary path); unloading and reloading follow one softer path up to W_max.  Assumes softening that needs no
    time, does not recover and is the same in all directions; no permanent set.  Validity: repeated loading of filled
    elastomers after the first cycle.  Raises ValueError unless 0 ≤ 1/r < 1, β ≥ 0 and m > 0.
    Source: Ogden & Roxburgh 1999 (β = 0 there; β as in Abaqus and ANSYS).
    """

    @dataclass(frozen=True)
    class Knobs:
        """The numbers that a study may open."""

        mullins: float = knob(
            "largest Mullins softening, 1/r of Ogden-Roxburgh",
            "1",
            0.0,
            0.95,
            neutral=0.0,
            group="mullins",
            typical=0.2,
            plausible=(0.03, 0.6),
            label="Mullins softening",
        )
        mullins_m: float = knob(
            "energy scale m of the softening over mu",
            "1",
            1e-4,
            1e3,
            default=0.1,
            group="mullins",
            plausible=(0.02, 0.5),
        )
        mullins_beta: float = knob("energy slope beta of the softening", "1", 0.0, 10.0, default=0.5, group="mullins")

    switches: ClassVar[Mapping[str, Mapping[str, float]]] = {"mullins": {"mullins": 0.0}}

    r_inverse: float
    m: float
    beta: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.r_inverse < 1.0:
            raise ValueError(f"mullins r_inverse = {self.r_inverse}: between 0 and 1")
        if not (self.m > 0.0 and self.beta >= 0.0):
            raise ValueError(f"mullins m = {self.m} MPa, beta = {self.beta}: m positive, beta not negative")

    def soften(self, W: np.ndarray, W_max: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """η, dη/dW (1/MPa) and Φ = ∫₀ᵂ η dW (MPa) at energies W after a largest W_max (both (m, q), MPa).

        With s = m + β W_max, z = ⟨W_max − W⟩/s, G = ∫ erf: Φ = W − (s/r)[G(W_max/s) − G(z)].  It is the potential of
        the softened stress as long as W_max of the last step stays, and beyond (z = 0).
        """
        s = self.m + self.beta * W_max
        z = np.maximum(W_max - W, 0.0) / s
        eta = 1.0 - self.r_inverse * erf(z)
        slope = np.where(z > 0.0, self.r_inverse * 2.0 / np.sqrt(np.pi) * np.exp(-z * z) / s, 0.0)
        return eta, slope, W - self.r_inverse * s * (_integral(W_max / s) - _integral(z))


def _integral(z: np.ndarray) -> np.ndarray:
    """∫₀ᶻ erf = z erf z + (exp(−z²) − 1)/√π."""
    return z * erf(z) + np.expm1(-z * z) / np.sqrt(np.pi)
