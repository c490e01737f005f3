"""Linear elasticity: the small-strain limit of every other law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from fem_backend.laws import law
from fem_backend.laws.law import LAWS, Isotropic


@LAWS.register
@dataclass(frozen=True)
class LinearElastic(Isotropic):
    """σ = 2μ dev ε + K tr ε I with ε = sym ∇u: small strain, geometrically linear body.

    μ in MPa, K = 2/D₁ (D₁ in 1/MPa), so that it shares its knobs with the neo-Hookean law:
    E = 9Kμ/(3K + μ), ν = (3K − 2μ)/(6K + 2μ).  Validity: indentation to about 2 mm here (contact radius ≪ R is
    already violated there).  Source: thesis eq. 2.7–2.11.
    """

    class Table(law.LawTable):
        """{ law = "linear_elastic", prony = [[g, tau in s], …] }"""

        law: Literal["linear_elastic"] = "linear_elastic"
        """See :class:`LinearElastic`."""

    unconditional: ClassVar[bool] = True  # small strains are watched on the way
    name: ClassVar[str] = "linear_elastic"
    rung: ClassVar[int] = 1
    level: ClassVar[Mapping[str, Any]] = {
        "name": "linear_elastic",
        "title": "linear elasticity",
        "description": "small strain",
        "hold": ("D1",),
    }

    small_strain = True
