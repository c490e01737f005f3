"""Whether runs on a meridian end well: random slabs under a ball, bonded, of four laws: `python meridian_gate.py [N]`.

Thickness 0.5 to 10 R, K/μ 2 to 10⁴, down to 1.5 R or 0.7 of the thickness, levels coarse and standard, 20 depths.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fem_backend.simulation import assembly, indentation
from fem_backend.simulation.experiment import read_settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.load_steps import Instant, Stopped

R, MU, SEED = 3.0, 0.01, 43
LAWS: dict[str, Mapping[str, Any]] = {
    "neo_hookean": {},
    "mooney_rivlin": {"C01": 0.002},
    "yeoh": {"C20": 0.001, "C30": 0.0002},
    "ogden": {"alpha": 4.0},
}


def case(thickness: float, ratio: float, law: str, level: str, solver: str = "auto") -> tuple[Any, ...]:
    """Settings, knobs, placement and model of a bonded slab under a ball; lengths in mm."""
    settings = read_settings(
        {
            "specimen": {"shape": "slab", "thickness": thickness},
            "indenter": {"shape": "sphere", "radius": R, "shaft": True},
            "support": {"kind": "bonded"},
            "material": {"law": law},
            "mesh": {"level": level},
            "solver": solver,
        }
    )
    knobs = Knobs(mu=MU, D1=2.0 / (ratio * MU), **LAWS[law])
    placement = assembly.place(settings, knobs)
    return settings, knobs, placement, assembly.model_for(settings, knobs, placement, None)


def main(count: int) -> None:
    """Print a line a case and how many ended well."""
    rng, done, spent = np.random.default_rng(SEED), 0, []
    for k in range(count):
        thickness = R * float(np.exp(rng.uniform(np.log(0.5), np.log(10.0))))
        ratio = float(np.exp(rng.uniform(np.log(2.0), np.log(1e4))))
        law, level = list(LAWS)[rng.integers(4)], ("coarse", "standard")[rng.integers(2)]
        deepest = min(1.5 * R, 0.7 * thickness)
        words = f"{k:3d} H/R {thickness / R:5.2f} K/mu {ratio:7.0f} {law:13s} {level:8s}"
        started = time.process_time()
        try:
            ready = case(thickness, ratio, law, level)
            started = time.process_time()
            instants = [Instant(d, d, True) for d in np.linspace(deepest / 20, deepest, 20)]
            found = indentation.solve(*ready, instants)
        except (Stopped, ValueError) as error:
            print(f"{words} {time.process_time() - started:6.2f} s  {error}", flush=True)
            continue
        done += 1
        spent.append(time.process_time() - started)
        c = found.counters
        print(
            f"{words} {spent[-1]:6.2f} s  {c.factorisations} factorisations, {c.iterations} iterations, "
            f"{c.shifts} shifts, {c.cutbacks} cut, {c.fallbacks} plain",
            flush=True,
        )
    print(f"{done} of {count} ended well; CPU s: median {np.median(spent):.2f}, most {max(spent):.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
