"""Lateral force at (20, 0), true friction, by mesh level with its stated error: python studies/withheld/friction.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

TRUTH = {"mu": 0.013055, "D1": 4.2477, "friction": 0.398}
DEPTH, AROUND = 4.0, 0.45  # mm
DATA = Path(__file__).parent / "measured" / "point_20_0.csv"


def main() -> None:
    """Fx at DEPTH: a parabola through the readings around it, then every level."""
    rows = np.genfromtxt(DATA, delimiter=",", names=True)
    near = np.abs(rows["depth_mm"] - DEPTH) < AROUND
    fit = np.polyfit(rows["depth_mm"][near] - DEPTH, rows["Fx_N"][near], 2)
    print(f"data      {fit[-1]:.4f} N")
    for level in ("coarse", "standard", "fine"):
        settings = {
            "material": {"law": "neo_hookean"},
            "mesh": {"level": level},
            "point": [20.0, 0.0],
            "indenter": {"radius": 3.0},
        }
        response = BACKEND(TRUTH, Case("friction", Programme.ramp((1.0, 2.0, 3.0, DEPTH), 0.5), settings))
        print(f"{level:9s} {response.channels['Fx'][-1]:.4f} N, stated to ± {response.error['Fx'][-1]:.4f}", flush=True)


if __name__ == "__main__":
    main()
