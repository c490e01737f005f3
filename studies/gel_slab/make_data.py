"""Write the "measured" curves of this study: forces of an independent program with noise of a load cell.

    python studies/gel_slab/make_data.py

The forces are those that benchmarks/independent_axisymmetric.py printed (elements of degree 4, no code of fem_backend),
for μ = 10 kPa and D₁ = 5.8 1/MPa; between its depths F/d^(3/2) is interpolated.  Three repeats, 1 mN of noise on each
reading, a gain that scatters by 0.3 % and a contact that is found to 5 μm.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

FOLDER = Path(__file__).parent
TABLE = FOLDER.parents[1] / "tests" / "fem_backend" / "reference_axisymmetric.json"
SLABS = {"thin": "slab_2_bonded_D5.8", "thick": "slab_4_bonded_D5.8"}
DEEPEST, READINGS, REPEATS = {"thin": 3.0, "thick": 4.5}, 30, 3
NOISE, GAIN, CONTACT = 1e-3, 3e-3, 5e-3  # N, share, mm


def curve(name: str, depth: np.ndarray) -> np.ndarray:
    """Force (n,) N at depths (n,) mm within those of the table, and Hertz's power below its first."""
    case = json.loads(TABLE.read_text(encoding="utf-8"))["cases"][SLABS[name]]
    d, F = np.array(case["depth"]), np.array(case["force"])
    return CubicSpline(d, F / d**1.5)(np.maximum(depth, d[0])) * depth**1.5


def main() -> None:
    rng = np.random.default_rng(11)
    (FOLDER / "measured").mkdir(exist_ok=True)
    for name, deepest in DEEPEST.items():
        rows = ["depth_mm,Fz_N,repeat"]
        for repeat in range(1, REPEATS + 1):
            depth = np.linspace(0.75, deepest, READINGS)
            force = curve(name, depth + CONTACT * rng.standard_normal()) * (1.0 + GAIN * rng.standard_normal())
            force += NOISE * rng.standard_normal(READINGS)
            rows += [f"{d:.4f},{f:.5f},{repeat}" for d, f in zip(depth, force, strict=True)]
        (FOLDER / "measured" / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
