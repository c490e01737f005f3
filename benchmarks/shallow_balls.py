"""Random balls hardly pressed in, beside what finer elements have: `python shallow_balls.py [--cases N] [--levels …]`.

    --cases N       how many of each level (40)
    --levels L …    coarse and standard without
    --space         in three dimensions: blocks, and slabs and pucks beside their axis or under a tilted way

Bodies, supports and laws of `meridian_gate.py`, also layers; from 0.002 to 0.3 radii; forces at four depths.  For each
level: what is off, what is stated, how many stated errors cover it, and their ratio.  Off is what differs from the
level reference; in space from standard and fine, extrapolated to elements of no size.  There a block comes first,
beside the meridian of a puck.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from meridian_gate import LAWS, MU, R, specimen

from fem_backend.backend import BACKEND
from fem_backend.meshing.grids import GRID_SIZE_FACTORS
from rso.contract import Case, Programme, SimulationFailed

SEED = 44
SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # of the deepest travel


def drawn(k: int) -> tuple[dict[str, Any], dict[str, float], float]:
    """Settings without a level, values and depth (mm) of the random case k."""
    rng = np.random.default_rng((SEED, k))
    body, thickness, supports = specimen(rng)
    if body["shape"] == "slab" and rng.integers(2):
        ratio = float(np.exp(rng.uniform(np.log(0.05), np.log(20.0))))
        body["layers"] = [{"thickness": float(rng.uniform(0.05, 0.5)) * thickness, "ratio": ratio}]
    support: dict[str, Any] = {"kind": supports[rng.integers(len(supports))]}
    if support["kind"] == "bowl":
        support |= {"clearance": float(rng.uniform(0.3, 2.0)), "friction": 0.0}
    if support["kind"] == "well":
        support |= {"radius": body["radius"] + float(rng.uniform(0.0, 0.3)), "wall": "gap"}
    law = list(LAWS)[rng.integers(4)]
    ratio = float(np.exp(rng.uniform(np.log(1.2), np.log(1e4))))
    depth = R * float(np.exp(rng.uniform(np.log(0.002), np.log(0.3))))
    table = {
        "specimen": body,
        "indenter": {"shape": "sphere", "radius": R},
        "support": support,
        "material": {"law": law},
        "derivatives": False,
    }
    return table, {"mu": MU, "D1": 2.0 / (ratio * MU), **LAWS[law]}, depth


def drawn_in_space(k: int) -> tuple[dict[str, Any], dict[str, float], float]:
    """The same of a bonded body that is no body of revolution, or not pressed as one."""
    rng = np.random.default_rng((SEED + 1, k))
    H, wide = (R * float(np.exp(rng.uniform(np.log(a), np.log(b)))) for a, b in ((0.7, 4.0), (3.0, 5.0)))
    aside = {"point": [float(rng.uniform(0.1, 0.5)) * wide, 0.0]}
    bodies: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({"shape": "block", "size": [2.0 * wide, 2.0 * wide * float(rng.uniform(0.6, 1.0)), H]}, {}),
        ({"shape": "cylinder", "radius": wide, "height": H}, aside),
        ({"shape": "slab", "thickness": H}, {"tilt": True}),
    ]
    body, more = bodies[rng.integers(3)]
    if rng.integers(3) == 0:
        ratio = float(np.exp(rng.uniform(np.log(0.05), np.log(20.0))))
        body["layers"] = [{"thickness": float(rng.uniform(0.05, 0.5)) * H, "ratio": ratio}]
    law, ratio = list(LAWS)[rng.integers(4)], float(np.exp(rng.uniform(np.log(1.2), np.log(200.0))))
    values = {"mu": MU, "D1": 2.0 / (ratio * MU), **LAWS[law]}
    if more.pop("tilt", False):
        values["tilt_y"] = float(rng.uniform(1.0, 8.0))
    depth = R * float(np.exp(rng.uniform(np.log(0.002), np.log(0.3))))
    table = {"specimen": body, "indenter": {"shape": "sphere", "radius": R}, "support": {"kind": "bonded"}, **more}
    return {**table, "material": {"law": law}, "derivatives": False}, values, depth


def forces(table: dict[str, Any], values: dict[str, float], depth: float, level: str) -> tuple[np.ndarray, ...]:
    """Force (4,) N, its stated error and CPU s of a run."""
    case = Case("ball", Programme.ramp(tuple(depth * SHARES), 1.0), {**table, "mesh": {"level": level}})
    started = time.process_time()
    found = BACKEND(*BACKEND.canonical(values, case))
    return found.channels["Fz"], found.error["Fz"], np.array(time.process_time() - started)


def of_no_size(table: dict[str, Any], values: dict[str, float], depth: float) -> np.ndarray:
    """Forces (4,) N in space for elements of no size: those of standard and fine, whose errors go as h²."""
    coarser, finer = (forces(table, values, depth, level)[0] for level in ("standard", "fine"))
    share = (GRID_SIZE_FACTORS["fine"] / GRID_SIZE_FACTORS["standard"]) ** 2
    return finer + (finer - coarser) * share / (1.0 - share)


def block_beside_puck() -> None:
    """Print what a block misses beside the meridian of a puck as wide, whose sides lie 20 contact radii away."""
    values, rest = {"mu": MU, "D1": 20.0}, {"indenter": {"radius": R}, "support": {"kind": "bonded"}}
    block = {"specimen": {"shape": "block", "size": [20.0 * R, 20.0 * R, 5.0 * R]}, "derivatives": False, **rest}
    puck = {**block, "specimen": {"shape": "cylinder", "radius": 10.0 * R, "height": 5.0 * R}}
    for share in (0.02, 0.1):
        F, error, _ = forces(block, values, share * R, "standard")
        off = abs(F[-1] / forces(puck, values, share * R, "reference")[0][-1] - 1.0)
        print(
            f"block at {share:g} R, standard: off {100 * off:.2f} %, said {100 * error[-1] / F[-1]:.2f} %", flush=True
        )


def main() -> None:
    """Print a line a case and a line a level."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--levels", nargs="+", default=["coarse", "standard"])
    parser.add_argument("--space", action="store_true")
    options = parser.parse_args()
    if options.space:
        block_beside_puck()
    off: dict[str, list[np.ndarray]] = {level: [] for level in options.levels}
    said: dict[str, list[np.ndarray]] = {level: [] for level in options.levels}
    spent: dict[str, list[float]] = {level: [] for level in options.levels}
    for k in range(options.cases):
        table, values, depth = drawn_in_space(k) if options.space else drawn(k)
        try:
            best = of_no_size(table, values, depth) if options.space else forces(table, values, depth, "reference")[0]
            for level in options.levels:
                F, error, cpu = forces(table, values, depth, level)
                off[level].append(np.abs(F / best - 1.0))
                said[level].append(error / np.abs(F))
                spent[level].append(float(cpu))
        except (ValueError, SimulationFailed) as failed:
            print(f"{k:3d} {str(failed)[:100]}")
            continue
        body = table["specimen"]
        words = f"{k:3d} {body['shape']:10s} {table['support']['kind']:6s} {depth / R:6.4f} R"
        shown = (
            f"{level} off {100 * off[level][-1][-1]:.2f} % said {100 * said[level][-1][-1]:.2f} %" for level in off
        )
        print(f"{words} {'layer ' * ('layers' in body)}{'; '.join(shown)}", flush=True)
    for level in off if any(off.values()) else ():
        a, b = np.concatenate(off[level]), np.concatenate(said[level])
        last = np.array([v[-1] for v in off[level]])
        stated = np.array([v[-1] for v in said[level]])
        print(
            f"{level}: deepest off {100 * np.median(last):.2f} % in the median, {100 * last.max():.2f} % at most, "
            f"said {100 * np.median(stated):.2f} %; stated covers {100 * np.mean(a <= b):.0f} % of {len(a)}, "
            f"{np.median(b / np.maximum(a, 1e-6)):.1f} times in the median; CPU {np.median(spent[level]):.2f} s"
        )


if __name__ == "__main__":
    main()
