"""Write the "measured" curves of this study: fine runs of this project's finite elements with noise.

    python studies/puck/make_data.py

A puck of μ = 15 kPa and D₁ = 4 1/MPa, bonded below: compressed by a plate that slides, and pressed by a ball.  Mesh
level reference; the study itself takes standard.  Two repeats, a noise of 0.3 % of the largest force, a gain that
scatters by 0.3 %.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

FOLDER = Path(__file__).parent
PUCK = {
    "specimen": {"shape": "cylinder", "radius": 10.0, "height": 8.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "reference"},
    "derivatives": False,
}
TESTS = {
    "compression": ({"shape": "plate", "contact": "slip"}, 1.6),
    "indentation": ({"shape": "sphere", "radius": 3.0}, 2.4),
}
TRUE = {"mu": 0.015, "D1": 4.0}
READINGS, REPEATS, NOISE, GAIN = 24, 2, 3e-3, 3e-3


def main() -> None:
    rng = np.random.default_rng(5)
    (FOLDER / "measured").mkdir(exist_ok=True)
    for name, (indenter, deepest) in TESTS.items():
        depth = np.linspace(deepest / READINGS, deepest, READINGS)
        case = Case(name, Programme.ramp(tuple(depth)), {**PUCK, "indenter": indenter})
        exact = BACKEND(TRUE, case).channels["Fz"]
        rows = ["depth_mm,Fz_N,repeat"]
        for repeat in range(1, REPEATS + 1):
            force = exact * (1.0 + GAIN * rng.standard_normal()) + NOISE * exact.max() * rng.standard_normal(READINGS)
            rows += [f"{d:.4f},{f:.5f},{repeat}" for d, f in zip(depth, force, strict=True)]
        (FOLDER / "measured" / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
