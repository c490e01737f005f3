"""A ball pulled off a half-space, by Tabor's parameter: finite elements beside an independent program, JKR and DMT.

python benchmarks/pull_off.py [--level standard] 0.5 1 1.5 2

Forces over π w R, travels over the one where JKR jumps off, w/(E* R) = 1e-5, K/μ = 1000, small strain.
"""

from __future__ import annotations

import argparse
import runpy
import time
from pathlib import Path

import numpy as np

from fem_backend import closed_forms
from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

HALF_SPACE = runpy.run_path(str(Path(__file__).parents[1] / "studies" / "pull_off" / "half_space.py"))
R, MU = 1.0, 0.01
STIFF = 4.0 * MU
W = 1e-5 * STIFF * R
BALL = {
    "specimen": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "radius": R},
    "material": {"law": "linear_elastic"},
}


def compared(tabor: float, level: str) -> str:
    """One row."""
    reach = (R * W**2 / (STIFF**2 * tabor**3)) ** (1.0 / 3.0)
    d, P = -closed_forms.jkr_jump_off(R, W, STIFF)[0], np.pi * W * R
    asked = np.array([-1.5, -0.9, -0.5, -0.2, 0.5, 1.0, 1.5]) * d
    programme = Programme((0.0, 1.0, 2.0), (0.0, 1.5 * d, -1.6 * d), tuple(asked))
    values = {"mu": MU, "D1": 2.0 / (1000.0 * MU), "adhesion": W, "adhesion_range": reach}
    began = time.process_time()
    r = BACKEND(values, Case("c", programme, {**BALL, "mesh": {"level": level}}))
    spent = time.process_time() - began
    theirs = HALF_SPACE["curve"](R, W, STIFF, reach, 1.6 * d, 240)
    s, F = theirs.way_back()
    back = slice(int(np.argmax(r.channels["travel"])), None)
    travel, ours, stated = (v[back] for v in (r.channels["travel"], r.channels["Fz"], r.error["Fz"]))
    on = travel > s[0]
    off = np.abs(ours - np.interp(travel, s, F))[on].max()
    jump = r.info.get("jump_off_mm")
    said = "none" if jump is None else f"{jump / d:.3f}"
    return (
        f"{tabor:5.2f} {r.info['pull_off_N'] / P:9.3f} {F.min() / P:9.3f} {said:>9} {s[0] / d:9.3f} "
        f"{off / P:9.4f} {stated[on].max() / P:9.4f} {spent:7.1f}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tabor", nargs="+", type=float)
    parser.add_argument("--level", default="standard")
    given = parser.parse_args()
    print("    μ_T  pull-off    theirs  jump-off    theirs   largest    stated   CPU s")
    for value in given.tabor:
        print(compared(value, given.level), flush=True)
    print(f"JKR {-1.5:13.3f} {'':9} {-1.0:9.3f};  DMT {-2.0:.3f}")
