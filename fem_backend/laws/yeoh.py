"""Yeoh: a cubic in Ī₁."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend.laws import law
from fem_backend.laws.law import LAWS, Derivatives, Isotropic
from rso.contract import knob


@LAWS.register
@dataclass(frozen=True)
class Yeoh(Isotropic):
    """W = C₁₀ x + C₂₀ x² + C₃₀ x³ + (1/D₁)(J − 1)² with x = Ī₁ − 3 and C₁₀ = μ/2.

    μ, C₂₀, C₃₀ in MPa, D₁ in 1/MPa; C₂₀ = C₃₀ = 0 is neo-Hookean.  Assumes isotropy and no rate dependence.
    Validity: large stretches of filled elastomers; C₂₀ < 0 softens at first and needs a C₃₀ > 0 large enough
    (`admissible`).  Source: Yeoh 1993; Holzapfel 2000, §6.5.
    """

    class Table(law.LawTable):
        """{ law = "yeoh", prony = [[g, tau in s], …] }"""

        law: Literal["yeoh"] = "yeoh"
        """See :class:`Yeoh`."""

    @dataclass(frozen=True)
    class Knobs:
        """Its own constants."""

        C20: float = knob(
            "Yeoh C20, strain stiffening",
            "MPa",
            -1e3,
            1e3,
            neutral=0.0,
            group="yeoh",
            typical=4e-4,
            plausible=(0.01, 0.4),
            cause="strain stiffening",
            label="stiffening (Yeoh)",
        )
        C30: float = knob(
            "Yeoh C30, strain stiffening",
            "MPa",
            -1e3,
            1e3,
            neutral=0.0,
            group="yeoh",
            typical=5e-5,
            plausible=(0.0, 0.04),
        )

    powers: ClassVar[Mapping[str, int]] = {"C20": 1, "C30": 1}
    name: ClassVar[str] = "yeoh"
    rung: ClassVar[int] = 3
    level: ClassVar[Mapping[str, Any]] = {
        "name": "yeoh",
        "title": "Yeoh",
        "description": "first stiffening term",
        "open": {"C20": (0.0, 0.4)},
        "extends": "neo_hooke",
    }

    C20: float = 0.0
    C30: float = 0.0

    @property
    def polynomial(self) -> Mapping[tuple[int, int], float]:
        """Its constants (MPa)."""
        return {(1, 0): 0.5 * self.mu, (2, 0): self.C20, (3, 0): self.C30}

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        x = i1 - 3.0
        return (0.5 * self.mu + (self.C20 + self.C30 * x) * x) * x + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        x, zero = i1 - 3.0, np.zeros_like(J)
        w1 = 0.5 * self.mu + (2.0 * self.C20 + 3.0 * self.C30 * x) * x
        w11 = 2.0 * self.C20 + 6.0 * self.C30 * x
        return Derivatives(w1, zero, w11, zero, zero, *self.pressure(J))
