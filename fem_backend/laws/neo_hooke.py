"""Neo-Hooke: one constant, the law to begin with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend.laws import law
from fem_backend.laws.law import LAWS, Derivatives, Isotropic


@LAWS.register
@dataclass(frozen=True)
class NeoHooke(Isotropic):
    """W = (μ/2)(Ī₁ − 3) + (1/D₁)(J − 1)², so K = 2/D₁.

    μ in MPa, D₁ in 1/MPa.  Assumes isotropy and no rate dependence; valid to moderate stretches (about 1.5 for
    elastomers).  Source: thesis eq. 2.5–2.6 with the isochoric Ī₁ of ANSYS; Bonet & Wood 2008, eq. 6.50.
    """

    class Table(law.LawTable):
        """{ law = "neo_hookean", prony = [[g, tau in s], …] }"""

        law: Literal["neo_hookean"] = "neo_hookean"
        """See :class:`NeoHooke`."""

    unconditional: ClassVar[bool] = True
    name: ClassVar[str] = "neo_hookean"
    rung: ClassVar[int] = 2
    level: ClassVar[Mapping[str, Any]] = {"name": "neo_hooke", "title": "neo-Hooke", "description": "large strain"}

    @property
    def polynomial(self) -> Mapping[tuple[int, int], float]:
        """Its constants (MPa)."""
        return {(1, 0): 0.5 * self.mu}

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        return 0.5 * self.mu * (i1 - 3.0) + self.volume_energy(J)

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        zero = np.zeros_like(J)
        return Derivatives(np.full_like(J, 0.5 * self.mu), zero, zero, zero, zero, *self.pressure(J))
