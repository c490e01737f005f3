"""Is an energy acceptable over the stretches that are reached?"""

from __future__ import annotations

import numpy as np

from fem_backend.laws.law import Law

# ln λ of incompressible tests, largest entry 1
TEST_PATHS = {
    "uniaxial tension": (1.0, -0.5, -0.5),
    "uniaxial compression (equibiaxial tension)": (-1.0, 0.5, 0.5),
    "planar tension (pure shear)": (1.0, 0.0, -1.0),
}
ISOCHORIC_BASIS = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])  # basis of Σ ln λ = 0


def admissible(law: Law, stretch_max: float, count: int = 200) -> str | None:
    """None, or why the law is not acceptable where every principal stretch is between 1/stretch_max and stretch_max.

    Asked are μ > 0, D₁ > 0 and Drucker's condition of the incompressible material, dτ·d ln λ > 0 for every change
    of the principal stretches: ∂²W/∂ ln λ² positive definite on Σ ln λ = 0, at `count` points along uniaxial and planar
    tension and uniaxial compression (equibiaxial tension to √stretch_max); so each Kirchhoff stress increases.
    The nominal stress of a stable law may still have a maximum (Ogden, 0 < α < 1): that is a matter of the
    structure, not of the material.  Validity: nearly incompressible materials, without fibres, memory or softening.
    Source: Drucker 1959; Ogden 1972; the check of Abaqus ("material stability").
    """
    if not law.shear_modulus > 0.0:
        return f"initial shear modulus {law.shear_modulus:g} MPa is not positive"
    if not 0.0 < law.bulk_modulus < np.inf:
        return f"bulk modulus {law.bulk_modulus:g} MPa is not positive"
    if law.small_strain:
        return None
    size = np.linspace(0.0, np.log(stretch_max), count)
    found: list[tuple[float, str]] = []
    for name, path in TEST_PATHS.items():
        A = ISOCHORIC_BASIS @ law.hessian(size[:, None] * np.array(path)) @ ISOCHORIC_BASIS.T
        least = 0.5 * (A[:, 0, 0] + A[:, 1, 1]) - np.hypot(0.5 * (A[:, 0, 0] - A[:, 1, 1]), A[:, 0, 1])
        lost = np.flatnonzero(~(least > 0.0))
        if lost.size:
            found.append((size[lost[0]], f"{name} at a stretch of {np.exp(path[0] * size[lost[0]]):.3g}"))
    return f"stress falls with strain (Drucker) in {min(found)[1]}" if found else None
