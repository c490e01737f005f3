"""Deep indentation of bodies of revolution: error, stated error and cost against depth, with and without remeshing.

    python benchmarks/deep_meridian.py [NAME …] [--level LEVEL] [--remesh when_needed|never] [--fine F] [--json FILE]

    NAME         cases (or beginnings of their names), all without
    --level      mesh level of the runs (standard)
    --remesh     of the runs, both without
    --fine F     elements of the reference over those of the level fine (0.7), which is remeshed
    --json FILE  what the table shows is added there

The reference is the own solver on a much finer mesh that is made anew on the way; a held sphere stands beside four
values of an independent program of degree 4 as well.  Errors in % of the force; CPU seconds of the run with its coarser
one.  A run that ends early counts as missing at the depths beyond.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.accuracy import two_grid
from fem_backend.accuracy.error_estimate import stated_errors
from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly, indentation
from fem_backend.simulation.experiment import Settings, read_settings
from fem_backend.solver.load_steps import Instant, Stopped

R = 3.0
SETS = ((0.0099997, 5.8), (0.0099752, 5.3), (0.0102, 1.1), (0.012453, 139.3))
P4 = {
    0: {6.0: 0.9061, 7.0: 1.0249, 7.5: 1.0639, 8.0: 1.0874},
    2: {6.0: 0.92496, 7.0: 1.04489, 7.5: 1.08804, 8.0: 1.12075},
}
BALL = {"shape": "sphere", "radius": R}
SHAFT = {**BALL, "shaft": True}


@dataclass(frozen=True)
class Deep:
    """A case: settings, (mu MPa, D1 1/MPa), depths in mm, forces of an independent program by depth."""

    name: str
    settings: Mapping[str, Any]
    values: tuple[float, float]
    depths: tuple[float, ...]
    known: Mapping[float, float]


def cases() -> list[Deep]:
    """Held spheres and spheres in bowls, slabs, flat ends, a cone, layers, a half-space."""
    out, to_eight, to_twelve = [], (2.0, 4.0, 5.0, 6.0, 7.0, 7.5, 8.0), (2.0, 4.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0)
    sphere = {"specimen": {"shape": "sphere", "radius": 35.0}}
    for k, values in enumerate(SETS):
        held = {**sphere, "support": {"kind": "fixed"}}
        out.append(Deep(f"held_{k + 1}", {**held, "indenter": BALL}, values, to_eight, P4.get(k, {})))
        out.append(Deep(f"shaft_{k + 1}", {**held, "indenter": SHAFT}, values, to_twelve, {}))
    for k in range(len(SETS)):
        bowl = {**sphere, "support": {"kind": "bowl", "clearance": 1.0, "friction": 0.0}, "indenter": BALL}
        out.append(Deep(f"bowl_{k + 1}", bowl, SETS[k], to_eight, {}))
    for thick in (1.0, 2.0, 4.0):
        for ratio in (2.0, 34.0, 1000.0):
            H, values = thick * R, (0.01, 2.0 / (0.01 * ratio))
            settings = {"specimen": {"shape": "slab", "thickness": H}, "support": {"kind": "bonded"}, "indenter": SHAFT}
            depths = tuple(float(d) for d in np.array([0.2, 0.35, 0.5, 0.6, 0.7, 0.75, 0.8]) * H)
            out.append(Deep(f"slab_{thick:g}_{ratio:g}", settings, values, depths, {}))
    flat = {"shape": "flat", "radius": R, "fillet": 0.15}
    slab = {"specimen": {"shape": "slab", "thickness": 4.0 * R}, "support": {"kind": "bonded"}, "indenter": flat}
    out.append(Deep("flat", slab, SETS[0], tuple(R * d for d in (0.2, 0.4, 0.6, 0.8, 1.0)), {}))
    for fillet in (0.02, 0.05, 0.1):  # of R, which contact has only just reached
        barely = {"specimen": {"shape": "slab", "thickness": 2.0 * R}, "support": {"kind": "bonded"}}
        barely["indenter"] = {**flat, "fillet": fillet * R}
        at = tuple(R * d for d in (0.003, 0.01, 0.03, 0.06, 0.1))
        out.append(Deep(f"shallow_{fillet:g}", barely, (0.01, 2.0 / (0.01 * 34.0)), at, {}))
    thin, values, fifths = {"specimen": {"shape": "slab", "thickness": 9.0}}, (0.01, 4.0), (0.2, 0.4, 0.6, 0.8, 1.0)
    cone = {**thin, "support": {"kind": "bonded"}, "indenter": {"shape": "cone", "half_angle": 60.0, "tip_radius": 0.6}}
    out.append(Deep("cone", cone, values, tuple(1.3 * d for d in fifths), {}))
    layers = {"shape": "slab", "thickness": 9.0, "layers": [{"thickness": 1.0, "ratio": 4.0}]}
    layered = {"specimen": layers, "support": {"kind": "bonded"}, "indenter": SHAFT}
    out.append(Deep("layers", layered, values, tuple(R * d for d in fifths), {}))
    half = {"specimen": {"shape": "half_space"}, "support": {"kind": "bonded"}, "indenter": SHAFT}
    out.append(Deep("half_space", half, SETS[0], tuple(R * d for d in (0.5, 1.0, 1.5, 2.0, 2.25, 2.5)), {}))
    return out


def solved(settings: Settings, case: Deep, check: bool) -> tuple[np.ndarray, np.ndarray, float, str, tuple]:
    """Force and stated error (k,) N at the depths, nan where not reached, CPU s, how it ended and its new meshes."""
    knobs = BACKEND.knobs({"mu": case.values[0], "D1": case.values[1]}, settings)
    placement = assembly.placement_of(settings, knobs)
    model = assembly.model_for(settings, knobs, placement, None)
    started, end = time.process_time(), "done"
    try:
        how = two_grid.checked_on_coarse_mesh if check else indentation.simulate_indentation
        result = how(settings, knobs, placement, model, [Instant(d, d, True) for d in case.depths])
    except Stopped as stopped:
        end, result = f"{stopped.cause}: {stopped}", stopped.reached
    spent, missing = time.process_time() - started, np.full(len(case.depths), np.nan)
    if result is None or not len(result.travel):
        return missing, missing, spent, end, ()
    lost = indentation.doubtful(result)
    if lost:
        result, end = result.upto(lost[0]), lost[2]
    rest = missing[len(result.travel) :]
    error = stated_errors(settings, knobs, result)["Fz"]
    return np.append(result.Fz, rest), np.append(error, rest), spent, end, result.legs


def compared(case: Deep, level: str, remesh: Sequence[str], fine: float) -> dict[str, Any]:
    """The rows of one case by strategy."""
    plain = {**case.settings, "derivatives": False}
    best = replace(read_settings({**plain, "mesh": {"level": "fine", "remesh": "when_needed"}}), fineness=fine)
    exact, _, spent, end, _ = solved(best, case, False)
    print(f"{case.name}  mu {case.values[0]:g} D1 {case.values[1]:g}; reference {spent:.0f} s CPU, {end}")
    print("  depth mm          " + " ".join(f"{d:8.2f}" for d in case.depths))
    print("  reference N       " + " ".join(f"{f:8.5f}" for f in exact))
    if case.known:
        far = [100.0 * (exact[case.depths.index(d)] / f - 1.0) for d, f in case.known.items()]
        print("  reference beside the independent program, %: " + " ".join(f"{v:+.2f}" for v in far))
    out: dict[str, Any] = {"case": case.name, "depth": case.depths, "reference": exact.tolist(), "reference_cpu": spent}
    for how in remesh:
        settings = read_settings({**plain, "mesh": {"level": level, "remesh": how}})
        F, e, spent, end, legs = solved(settings, case, True)
        print(f"  {how:11s} true % " + " ".join(f"{v:+8.3f}" for v in 100.0 * (F / exact - 1.0)))
        print(f"  {'':11s} said % " + " ".join(f"{v:8.3f}" for v in 100.0 * e / F), flush=True)
        new = ", ".join(f"{s:.2f} mm {100.0 * jump:.3f} %" for s, jump in legs) or "none"
        print(f"  {'':11s} {spent:.1f} s CPU; {end}; new meshes (jump): {new}", flush=True)
        out[how] = {"force": F.tolist(), "error": e.tolist(), "cpu": spent, "end": end, "legs": legs}
    return out


def summary(rows: Sequence[Mapping[str, Any]], how: str) -> str:
    """Largest error, share of points that the stated error covers, median of stated over true, CPU, of a strategy."""
    truth = np.concatenate([np.array(r[how]["force"]) / np.array(r["reference"]) - 1.0 for r in rows])
    said = np.concatenate([np.array(r[how]["error"]) / np.array(r[how]["force"]) for r in rows])
    there = np.isfinite(truth)
    truth, said = np.abs(truth[there]), said[there]
    return (
        f"{how}: {there.sum()} of {len(there)} points reached; error at most {100.0 * truth.max():.2f} %, median "
        f"{100.0 * np.median(truth):.2f} %; below 0.5 % {100.0 * (truth < 0.005).mean():.0f} %; stated covers "
        f"{100.0 * (said >= truth).mean():.0f} %, median of stated over true "
        f"{np.median(said / np.maximum(truth, 1e-6)):.1f}; CPU {sum(r[how]['cpu'] for r in rows):.0f} s"
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--level", default="standard")
    parser.add_argument("--remesh", choices=("when_needed", "never"))
    parser.add_argument("--fine", type=float, default=0.7)
    parser.add_argument("--json")
    options = parser.parse_args()
    strategies = (options.remesh,) if options.remesh else ("when_needed", "never")
    path = Path(options.json) if options.json else None
    rows = []
    for case in cases():
        if options.names and not any(case.name.startswith(n) for n in options.names):
            continue
        rows.append(compared(case, options.level, strategies, options.fine))
        if path:
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    for how in strategies if rows else ():
        print(summary(rows, how))


if __name__ == "__main__":
    main()
