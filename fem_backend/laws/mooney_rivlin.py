"""Mooney–Rivlin with two constants."""

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
class MooneyRivlin(Isotropic):
    """W = C₁₀(Ī₁ − 3) + C₀₁(Ī₂ − 3) + (1/D₁)(J − 1)² with C₁₀ = μ/2 − C₀₁, so that μ = 2(C₁₀ + C₀₁).

    μ, C₀₁ in MPa, D₁ in 1/MPa; C₀₁ = 0 is neo-Hookean.  Assumes isotropy and no rate dependence.  Validity: tension
    to about 2; C₀₁ > 0 overestimates compression and equibiaxial tension when fitted to uniaxial tension alone, and
    C₀₁ < 0 or C₀₁ > μ/2 is unstable at some stretch (`admissible`).
    Source: Mooney 1940; thesis eq. 1.14 (eq. 1.15 there misses the factor 2 of μ); Holzapfel 2000, §6.5.
    """

    class Table(law.LawTable):
        """{ law = "mooney_rivlin", prony = [[g, tau in s], …] }"""

        law: Literal["mooney_rivlin"] = "mooney_rivlin"
        """See :class:`MooneyRivlin`."""

    @dataclass(frozen=True)
    class Knobs:
        """Its own constants."""

        C01: float = knob("Mooney-Rivlin C01 (C10 = mu/2 - C01)", "MPa", -1e3, 1e3, neutral=0.0, typical=1e-3)

    powers: ClassVar[Mapping[str, int]] = {"C01": 1}
    name: ClassVar[str] = "mooney_rivlin"
    rung: ClassVar[int] = 3
    level: ClassVar[Mapping[str, Any]] = {
        "name": "mooney_rivlin",
        "title": "Mooney-Rivlin",
        "description": "second invariant",
        "open": {"C01": (0.0, 0.5)},
        "extends": "neo_hooke",
    }

    C01: float = 0.0

    @property
    def polynomial(self) -> Mapping[tuple[int, int], float]:
        """Its constants (MPa)."""
        return {(1, 0): 0.5 * self.mu - self.C01, (0, 1): self.C01}

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        return (0.5 * self.mu - self.C01) * (i1 - 3.0) + self.C01 * (i2 - 3.0) + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        zero = np.zeros_like(J)
        w1, w2 = np.full_like(J, 0.5 * self.mu - self.C01), np.full_like(J, self.C01)
        return Derivatives(w1, w2, zero, zero, zero, *self.pressure(J))
