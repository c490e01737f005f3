"""Synthetic readings of one Yeoh gel: tension by the closed form by hand, indentation by the finite element model."""

from pathlib import Path

import numpy as np

import rso
from fem_backend.closed_forms import nominal_compressible

MU, C20, D1 = 0.012, 0.0006, 20.0  # MPa, MPa, 1/MPa
HERE = Path(__file__).parent / "measured"


def pull(u):
    """Uniaxial force (N) at elongations u (mm) with free sides, J by bisection (Holzapfel 2000, eq. 6.85 to 6.91).

    P̄ = 2 (λ − λ⁻²)(μ/2 + 2 C₂₀ (I₁ − 3)) of the incompressible law at λ̄ = J^(-1/3) λ.
    """

    def incompressible(x):
        return 2 * (x - x**-2) * (MU / 2 + 2 * C20 * (x**2 + 2 / x - 3))

    return 24.0 * nominal_compressible(1 + u / 20.0, incompressible, D1)[0]


def indentation(u):
    """Force (N) of the finite element model on a finer mesh than that of the study."""
    run = rso.indent(
        u, specimen={"shape": "slab", "thickness": 8.0}, indenter={"shape": "sphere", "radius": 4.0},
        material={"law": "yeoh"}, settings={"mesh": {"level": "standard"}}, mu=MU, C20=C20, D1=D1,
    )  # fmt: skip
    return run.channels["Fz"]


def main():
    rng = np.random.default_rng(46)
    for name, force, u, sigma in (
        ("pull", pull, np.linspace(0.5, 20.0, 40), 0.002),
        ("indentation", indentation, np.linspace(0.1, 2.0, 20), 0.0002),
    ):
        values = force(u) + rng.normal(0.0, sigma, len(u))
        rows = [f"{a:.4f},{b:.6f}" for a, b in zip(u, values, strict=True)]
        (HERE / f"{name}.csv").write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n")


if __name__ == "__main__":
    main()
