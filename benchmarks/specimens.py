"""Specimens of other shapes and sizes: meshes made for them, forces beside Hertz's, what runs state.

    python benchmarks/specimens.py [--level coarse] [--only 0,3]

Semi-axes and ball (mm), point; unknowns, seconds of meshing, CPU seconds of the run; F/Hertz - 1 and the stated error
of F, in per cent, at 0.07, 0.1, 0.3 and 0.6 of the ball's radius.  Hertz's is a half-space's: flat bodies are stiffer.
"""

from __future__ import annotations

import argparse
import time

from fem_backend import meshing  # isort: skip (pins the threads before numpy)

import numpy as np

from fem_backend.backend import BACKEND
from fem_backend.simulation.experiment import read_settings
from rso.contract import Case, Programme, SimulationFailed

TOP = (0.0, 0.0)
SPECIMENS = (
    ((60.0, 35.0, 35.0), 3.0, TOP),
    ((30.0, 30.0, 30.0), 3.0, TOP),
    ((12.0, 10.0, 8.0), 1.0, TOP),
    ((1.0, 0.8, 0.7), 0.1, TOP),
    ((25.0, 20.0, 15.0), 6.0, TOP),
    ((50.0, 40.0, 30.0), 3.0, TOP),
    ((40.0, 40.0, 8.0), 3.0, TOP),
    ((40.0, 40.0, 8.0), 3.0, (14.0, 0.0)),
    ((80.0, 15.0, 15.0), 3.0, TOP),
    ((80.0, 15.0, 15.0), 3.0, (28.0, 0.0)),
    ((60.0, 60.0, 12.0), 1.5, TOP),
    ((15.0, 15.0, 40.0), 3.0, TOP),
)
SHARES = np.array([0.07, 0.1, 0.3, 0.6])
KNOBS = {"mu": 0.01, "D1": 10.0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--only", default=",".join(map(str, range(len(SPECIMENS)))))
    args = parser.parse_args()
    for axes, R, point in (SPECIMENS[int(k)] for k in args.only.split(",")):
        settings = {
            "specimen": {"shape": "ellipsoid", "semi_axes": list(axes)},
            "indenter": {"radius": R},
            "mesh": {"level": args.level},
            "point": list(point),
            "derivatives": False,
        }
        case = Case("specimen", Programme.ramp(tuple(float(f"{v:.6g}") for v in SHARES * R)), settings)
        named = f"{'x'.join(f'{v:g}' for v in axes)}, R = {R:g}, {point}"
        started = time.perf_counter()
        try:
            meshing.cached(read_settings(settings).recipe)
            meshed = time.perf_counter() - started
            found = BACKEND(KNOBS, case)
        except (SimulationFailed, meshing.BadMesh) as error:
            print(f"{named}: {error}", flush=True)
            continue
        F, hertz = found.channels["Fz"], BACKEND.closed_form(KNOBS, case).channels["Fz"]
        off, stated = np.round(100.0 * (F / hertz - 1.0), 1), np.round(100.0 * found.error["Fz"] / F, 1)
        cost = f"{found.info['dofs']} unknowns, {meshed:.0f} s, {found.info['cpu_s']:.1f} s"
        print(f"{named}: {cost}, {off}, stated {stated}", flush=True)


if __name__ == "__main__":
    main()
