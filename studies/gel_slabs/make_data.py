"""Synthetic readings of eight gel slabs from two moulds: one material whose specimens scatter.

    python studies/gel_slabs/make_data.py

ln μ and ln D₁ of each slab are drawn about those of the material.  Forces are those of the finite element model on a
finer mesh than that of the study, with a gain, a contact and noise of each test.  The truth is printed.
"""

from pathlib import Path

import numpy as np

import rso

MU, D1 = 0.012, 8.0  # MPa, 1/MPa: medians of the material
SCATTER = {"mu": 0.12, "D1": 0.25}  # standard deviations of ln μ and ln D₁ between slabs
SLABS = {"A1": 2.5, "A2": 2.5, "A3": 2.5, "A4": 2.5, "B1": 8.0, "B2": 8.0, "B3": 8.0, "B4": 8.0}  # thickness, mm
NOISE, GAIN, CONTACT = 5e-4, 0.005, 0.008  # N, share, mm: standard deviations
HERE = Path(__file__).parent / "measured"


def truths(rng):
    """μ (MPa) and D₁ (1/MPa) of each slab by name."""
    return {
        name: (MU * np.exp(SCATTER["mu"] * rng.standard_normal()), D1 * np.exp(SCATTER["D1"] * rng.standard_normal()))
        for name in SLABS
    }


def force(depth, thickness, mu, d1):
    """Force (n,) N at depths (n,) mm of the finite element model."""
    run = rso.indent(
        depth, specimen={"shape": "slab", "thickness": thickness}, indenter={"shape": "sphere", "radius": 4.0},
        material={"law": "neo_hookean"}, support={"kind": "bonded"}, settings={"mesh": {"level": "standard"}},
        mu=mu, D1=d1,
    )  # fmt: skip
    return run.channels["Fz"]


def main():
    rng = np.random.default_rng(118)
    HERE.mkdir(exist_ok=True)
    table = ["name;settings.specimen.thickness [mm];note"]
    for name, (mu, d1) in truths(rng).items():
        deepest = 0.35 * SLABS[name] * (1.0 - 0.1 * rng.random())  # nobody presses all specimens as deep
        depth = np.linspace(deepest / 20, deepest, 20)
        found = force(depth + CONTACT * rng.standard_normal(), SLABS[name], mu, d1)
        found = found * (1.0 + GAIN * rng.standard_normal()) + NOISE * rng.standard_normal(len(depth))
        rows = [f"{a:.4f},{b:.6f}" for a, b in zip(depth, found, strict=True)]
        (HERE / f"{name}.csv").write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n", encoding="utf-8")
        table.append(f"{name};{SLABS[name]:g};mould {name[0]}")
        print(f"{name}: μ = {1000 * mu:.2f} kPa, D₁ = {d1:.2f} 1/MPa")
    (HERE.parent / "specimens.csv").write_text("\n".join(table) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
