"""Write the "measured" record of this study: a fine run of this project's finite elements with noise.

    python studies/cartilage/make_data.py

A layer of 2 mm on bone, a superficial zone of 0.2 mm twice as stiff, μ = 0.5 MPa (instantaneous), D₁ = 0.4 1/MPa, of
which 0.45 relaxes within τ = 8 s: a flat end of 1.5 mm is pressed 0.3 mm deep in 1 s and held for 40 s.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

FOLDER = Path(__file__).parent
LAYER = {
    "specimen": {"shape": "slab", "thickness": 2.0, "layers": [{"thickness": 0.2, "ratio": 2.0}]},
    "indenter": {"shape": "flat", "radius": 1.5, "fillet": 0.15},
    "support": {"kind": "bonded"},
    "mesh": {"level": "fine"},
    "derivatives": False,
}
TRUE = {"mu": 0.5, "D1": 0.4, "prony_g": 0.45, "prony_tau": 8.0}
DEEPEST, RAMP, HOLD, REPEATS, NOISE, GAIN = 0.3, 1.0, 40.0, 2, 2e-3, 3e-3


def main() -> None:
    rng = np.random.default_rng(7)
    (FOLDER / "measured").mkdir(exist_ok=True)
    held = RAMP + np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 30.0, 35.0, HOLD])
    time = np.concatenate([np.linspace(0.0, RAMP, 13)[1:], held])
    depth = np.minimum(DEEPEST * time / RAMP, DEEPEST)
    programme = Programme((0.0, RAMP, RAMP + HOLD), (0.0, DEEPEST, DEEPEST), (DEEPEST,), tuple(time))
    answer = BACKEND(TRUE, Case("held", programme, LAYER))
    exact = np.interp(time, answer.channels["time"], answer.channels["Fz"])
    rows = ["time_s,depth_mm,Fz_N,repeat"]
    for repeat in range(1, REPEATS + 1):
        force = exact * (1.0 + GAIN * rng.standard_normal()) + NOISE * exact.max() * rng.standard_normal(len(time))
        rows += [f"{t:.3f},{d:.5f},{f:.5f},{repeat}" for t, d, f in zip(time, depth, force, strict=True)]
    (FOLDER / "measured" / "held.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
