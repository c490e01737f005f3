"""Linear elasticity: the small-strain limit of every other law."""

from __future__ import annotations

from dataclasses import dataclass

from fem_backend.laws.law import Isotropic


@dataclass(frozen=True)
class LinearElastic(Isotropic):
    """σ = 2μ dev ε + K tr ε I with ε = sym ∇u: small strain, geometrically linear body.

    μ in MPa, K = 2/D₁ (D₁ in 1/MPa), so that it shares its knobs with the neo-Hookean law:
    E = 9Kμ/(3K + μ), ν = (3K − 2μ)/(6K + 2μ).  Validity: indentation to about 2 mm here (contact radius ≪ R is
    already violated there).  Source: thesis eq. 2.7–2.11.
    """

    small_strain = True
