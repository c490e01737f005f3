"""What few steps leave in the forces of a ball that sticks to a slope, beside many steps.

    python benchmarks/friction_steps.py [--friction 0.1,0.3,1] [--step 0.02]

Travels 0.2, 0.4 and 0.8 mm at (20, 0), asked for alone and among steps of that many mm; per cent of Fz, and what the
run states.  With `--old` nothing that is touched within a step sticks before the next one, as it was.
"""

from __future__ import annotations

import argparse

from fem_backend.contact import tractions  # isort: skip (pins the threads before numpy)

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

ASKED = (0.2, 0.4, 0.8)
AT = {"point": [20.0, 0.0], "mesh": {"level": "coarse"}, "derivatives": False}


def run(friction: float, asked: tuple[float, ...]) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Channels and stated errors at ASKED."""
    knobs = {"mu": 0.01, "D1": 14.0, "friction": friction}
    found = BACKEND(knobs, Case("slope", Programme.ramp(asked), AT))
    k = [int(np.argmin(np.abs(found.channels["travel"] - s))) for s in ASKED]
    return {n: v[k] for n, v in found.channels.items()}, {n: v[k] for n, v in found.error.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--friction", default="0.1,0.3,1")
    parser.add_argument("--step", type=float, default=0.02)
    parser.add_argument("--old", action="store_true")
    args = parser.parse_args()
    dense = tuple(sorted({*ASKED, *(round(float(s), 6) for s in np.arange(args.step, ASKED[-1], args.step))}))
    for friction in map(float, args.friction.split(",")):
        exact, _ = run(friction, dense)
        now = tractions.met
        tractions.met = (lambda *_: None) if args.old else now
        found, error = run(friction, ASKED)
        tractions.met = now
        for c in ("Fx", "Fz"):
            off, stated, value = (100.0 * v / exact["Fz"] for v in (found[c] - exact[c], error[c], exact[c]))
            value, off, stated = (np.round(v, 2) for v in (value, off, stated))
            print(f"friction {friction:g}  {c} {value}  off {off}  stated {stated}", flush=True)


if __name__ == "__main__":
    main()
