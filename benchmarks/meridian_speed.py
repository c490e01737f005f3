"""CPU time and error of a ball on a bonded slab, solved on its meridian: `python meridian_speed.py [superlu]`.

R = 3 mm to 1.5 R, neo-Hookean, 20 depths, slabs of 2 and 4 R, K/μ of 2 to 10⁴, by element sizes.  Errors are those of
the force against a mesh several times finer, at the worst of the depths compared; one thread, a second run of each.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from meridian_gate import R, case

from fem_backend.simulation import assembly, indentation
from fem_backend.solver.load_steps import Instant

DEPTHS = np.linspace(0.075, 1.5, 20) * R
COMPARED = [0, 4, 9, 19]
FINENESS, REFERENCE = (1.0, 1.4, 2.0), 0.6


def run(thickness: float, ratio: float, fineness: float, depths: np.ndarray, solver: str):
    """Force (k,) N, CPU of the solve (s), dofs and counters."""
    settings, knobs, placement, _ = case(thickness, ratio, "neo_hookean", "standard", solver)
    settings = replace(settings, fineness=fineness)
    model = assembly.model_for(settings, knobs, placement, None)
    started = time.process_time()
    found = indentation.simulate_indentation(settings, knobs, placement, model, [Instant(d, d, True) for d in depths])
    return found.Fz, time.process_time() - started, model.body.pattern.size, found.counters


def main(solver: str) -> None:
    """Print the table."""
    print("H/R    K/mu  size  dofs  CPU s  error %  factorisations iterations")
    for thickness in (2.0 * R, 4.0 * R):
        for ratio in (2.0, 50.0, 1e4):
            exact = run(thickness, ratio, REFERENCE, DEPTHS[COMPARED], solver)[0]
            for fineness in FINENESS:
                run(thickness, ratio, fineness, DEPTHS[:2], solver)  # compiles and analyses
                F, spent, dofs, c = run(thickness, ratio, fineness, DEPTHS, solver)
                error = 100.0 * np.abs(F[COMPARED] / exact - 1.0).max()
                print(
                    f"{thickness / R:3.0f} {ratio:7.0f}  {fineness:4.1f} {dofs:5d} {spent:6.2f} {error:8.3f}"
                    f"  {c.factorisations:6d} {c.iterations:10d}",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "auto")
