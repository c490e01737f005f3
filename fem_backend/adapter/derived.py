"""Constants of isotropic elasticity that people think in, from the parameters of a study."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fem_backend.laws.prony import Prony
from rso.contract import DerivedQuantity

PRONY_SHARES = tuple(by_knob for knobs in Prony.switches.values() for by_knob in knobs)  # prony_g, prony_g2, …
SOFT_POISSON_RANGE = (0.3, 0.5)  # ν of gels, elastomers and soft tissues
Values = Mapping[str, np.ndarray]


def derived(given: Collection[str]) -> tuple[DerivedQuantity, ...]:
    """E, ν, K and, of a law that relaxes, the long-term μ and E, at small strain.

        ν = (3 − c)/(6 + c),   E = 2μ(1 + ν) = 18μ/(6 + c),   c = μ D₁,   K = 2/D₁
        μ∞ = (1 − Σ gᵢ) μ,     E∞ = 18μ∞/(6 + μ∞ D₁)

    The moduli μ, E are the instantaneous ones; K does not relax.  With pore flow D₁ is that of the drained body, whose
    ν may be anything.  None without μ and D₁ among the parameters `given`.
    """
    if not {"mu", "D1"} <= set(given):
        return ()
    shares = [name for name in PRONY_SHARES if name in given]
    drained = "permeability" in given
    when = "instantaneous " if shares else "drained " if drained else ""

    def long_term(v: Values) -> np.ndarray:
        return np.asarray(v["mu"] * (1.0 - sum(v[name] for name in shares)))

    found = [
        DerivedQuantity("E", "E", f"{when}Young's modulus", "MPa", lambda v: youngs_modulus_of_D1(v["mu"], v["D1"])),
        DerivedQuantity(
            "nu",
            "ν",
            f"{when}Poisson's ratio",
            "1",
            lambda v: (3.0 - v["mu"] * v["D1"]) / (6.0 + v["mu"] * v["D1"]),
            (0.0, 0.5) if drained else SOFT_POISSON_RANGE,
            "a Poisson's ratio below 0.3 is unlikely for a gel, an elastomer or soft tissue. Check the contact "
            "point, the radius and the thickness first",
        ),
        DerivedQuantity("K", "K", f"{'drained ' * drained}bulk modulus", "MPa", lambda v: 2.0 / v["D1"]),
    ]
    if shares:
        found += [
            DerivedQuantity("mu_infinity", "μ∞", "long-term shear modulus", "MPa", long_term),
            DerivedQuantity(
                "E_infinity",
                "E∞",
                "long-term Young's modulus",
                "MPa",
                lambda v: youngs_modulus_of_D1(long_term(v), v["D1"]),
            ),
        ]
    return tuple(found)


def youngs_modulus_of_D1(mu: np.ndarray, D1: np.ndarray) -> np.ndarray:
    """E = 18μ/(6 + μ D₁) (MPa) of μ (MPa) and D₁ (1/MPa)."""
    return np.asarray(18.0 * mu / (6.0 + mu * D1))
