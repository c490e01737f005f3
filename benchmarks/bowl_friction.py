"""A body in a bowl, pressed off its top, beside measurements of it: python benchmarks/bowl_friction.py FOLDER [options]

    FOLDER           with point_2.5_2.5.csv, point_20_0.csv (depth_mm, Fx_N, Fz_N) and truth.json: material (mu, D1) and
                     model (clearance, mu_platform)
    --level LEVEL    of the mesh (coarse)
    --friction MU    of the bowl instead of the true one; 0: it slips from the start

Prints forces of this model and of the measurement, interpolated, with the difference of Fz at the deepest travel.
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse
import json
import time
from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

TRAVELS = (0.25, 0.7, 1.3, 1.9, 2.8, 3.4, 3.9)


def main() -> None:
    """Both points."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--friction", type=float)
    options = parser.parse_args()
    truth = json.loads((options.folder / "truth.json").read_text(encoding="utf-8"))
    friction = truth["model"]["mu_platform"] if options.friction is None else options.friction
    support = {"kind": "bowl", "clearance": truth["model"]["clearance"], "friction": friction}
    values = {k: truth["material"][k] for k in ("mu", "D1")}
    for x, y in ((2.5, 2.5), (20.0, 0.0)):
        data = np.genfromtxt(options.folder / f"point_{x:g}_{y:g}.csv", delimiter=",", names=True)
        started = time.process_time()
        settings = {"mesh": {"level": options.level}, "point": [x, y], "support": support}
        F = BACKEND(values, Case("bowl", Programme.ramp(TRAVELS, 0.5), settings)).channels
        print(f"({x:g}, {y:g}), friction {friction:g}, {time.process_time() - started:.0f} CPU s")
        print("  travel mm     ", *(f"{u:8.2f}" for u in TRAVELS))
        for c in ("Fx", "Fz"):
            measured = np.interp(TRAVELS, data["depth_mm"], data[f"{c}_N"])
            print(f"  {c} N here     ", *(f"{v:8.4f}" for v in F[c]))
            print(f"  {c} N measured ", *(f"{v:8.4f}" for v in measured))
        print(f"  Fz at {TRAVELS[-1]:g} mm: {100 * (F['Fz'][-1] / measured[-1] - 1):+.1f} %")


if __name__ == "__main__":
    main()
