"""Deep indentation in three dimensions: force, stated and true error by depth, and what element and mesh do for them.

    python benchmarks/deep_three_dimensions.py [--bodies sphere kidney slab] [--levels coarse standard]
        [--supports held bowl] [--sets 1 3 4] [--elements] [--out FILE]

A ball of 3 mm presses a sphere of 35 mm and a slab of two radii, modelled in space, to 2.7 and 1.6 R.  Their true
forces are those of the meridian (`fine`): other elements, kinematics, contact and solution, itself within 0.1 % of an
independent program of degree 4.  Others are compared with the level `fine`.
With --elements the levels are run with both elements, on both meshes, at every depth.  The file keeps runs: a second
call only prints.
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse
import dataclasses
import json
import time
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from fem_backend.accuracy import error_estimate, two_grid
from fem_backend.backend import BACKEND, passages
from fem_backend.kinematics import tetrahedra
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import experiment, indentation
from fem_backend.solver.load_steps import Stopped
from rso.contract import Programme

R = 3.0
SETS = {"1": (0.0099997, 5.8), "3": (0.0102, 1.1), "4": (0.012453, 139.3)}  # thesis, table 5.1: mu MPa, D1 1/MPa
BODIES: dict[str, dict[str, Any]] = {
    "sphere": {"specimen": {"shape": "ellipsoid", "semi_axes": [35.0, 35.0, 35.0]}},
    "kidney": {"specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}},
    "kidney beside": {"specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "point": [20.0, 0.0]},
    "slab": {"specimen": {"shape": "slab", "thickness": 2.0 * R}, "support": {"kind": "bonded"}},
    "puck beside": {
        "specimen": {"shape": "cylinder", "radius": 12.0, "height": 3.0 * R},
        "support": {"kind": "bonded"},
        "point": [4.0, 0.0],
    },
    "block beside": {
        "specimen": {"shape": "block", "size": [24.0, 20.0, 8.0]},
        "support": {"kind": "bonded"},
        "point": [4.0, 3.0],
    },
}
OF_REVOLUTION = {
    "sphere": {"specimen": {"shape": "sphere", "radius": 35.0}},
    "slab": BODIES["slab"],
}
UNSEEN = {"slab": {"fibre": 1e-9}}  # too little to change a force, enough to end the symmetry of revolution
DEPTHS: dict[str, tuple[float, ...]] = {
    "sphere": (1, 2, 3, 4, 5, 6, 7, 7.5, 8),
    "kidney": (1, 2, 3, 4, 5, 6, 7, 7.5, 8),
    "kidney beside": (2, 4, 6, 7, 8),
    "slab": (1.2, 2.4, 3.0, 3.6, 4.2, 4.5, 4.8),
    "puck beside": (2, 4, 6, 6.6, 7.2),
    "block beside": (2, 4, 5, 5.6, 6.4),
}
BOWL = {"kind": "bowl", "clearance": 1.0, "friction": 0.0}
ELEMENTS = {  # whether elements take the mean of their volume change, whether the mesh is gathered
    "points": (False, False),
    "mean": (True, False),
    "points, gathered": (False, True),
    "mean, gathered": (True, True),
}


def run(body: str, support: str, level: str, key: str, meridian: bool = False, element: str = "") -> dict[str, Any]:
    """One run as plain data; `element` forces an element and a mesh, without a second run for its error."""
    table = {**(OF_REVOLUTION if meridian else BODIES)[body], "indenter": {"radius": R}, "mesh": {"level": level}}
    table |= {"support": BOWL} if support == "bowl" else {}
    mu, D1 = SETS[key]
    settings = experiment.for_travel(experiment.read_settings(table | {"derivatives": False}), DEPTHS[body][-1])
    knobs = BACKEND.knobs({"mu": mu, "D1": D1, **({} if meridian else UNSEEN.get(body, {}))}, settings)
    placement, started = modelling.placement_of(settings, knobs), time.process_time()
    assert placement.meridian == meridian
    settings = dataclasses.replace(settings, large_strain=not meridian)
    instants, stop = passages(Programme.ramp(tuple(map(float, DEPTHS[body])), 1.0)), ""
    mean, gathered = ELEMENTS.get(element, (True, True))
    discretise = tetrahedra.discretise
    with (
        mock.patch.object(modelling, "gathers", lambda indenter: gathered),
        mock.patch.object(tetrahedra, "discretise", lambda mesh, held, sym, _: discretise(mesh, held, sym, mean)),
    ):
        modelling._model.cache_clear()
        model = modelling.model_for(settings, knobs, placement, None)
        try:
            how = indentation.simulate_indentation if element else two_grid.checked_on_coarse_mesh
            result = how(settings, knobs, placement, model, instants)
        except Stopped as stopped:
            stop, result = str(stopped), stopped.reached
    stated = error_estimate.stated_errors(settings, knobs, result)
    coarser = None if result.coarser is None else {n: v.tolist() for n, v in result.coarser.items()}
    return {
        "travel": result.travel.tolist(),
        "channels": {n: v.tolist() for n, v in result.channels.items()},
        "stated": {n: np.asarray(v).tolist() for n, v in stated.items()},
        "coarser": coarser,
        "finer": result.finer,
        "nodes": len(model.body.nodes),
        "cpu": time.process_time() - started,
        "stop": stop,
    }


class Runs:
    """Runs by name, kept in a file."""

    def __init__(self, path: Path | None) -> None:
        self.path, self.found = path, {}
        if path and path.exists():
            self.found = {k: v for line in path.read_text().splitlines() for k, v in json.loads(line).items()}

    def __call__(self, *what: Any, **how: Any) -> dict[str, Any]:
        name = json.dumps([what, how])
        if name not in self.found:
            self.found[name] = run(*what, **how)
            if self.path:
                with self.path.open("a") as file:
                    file.write(json.dumps({name: self.found[name]}) + "\n")
        return self.found[name]


def true(runs: Runs, body: str, support: str, key: str) -> dict[str, Any]:
    """The run that others are compared with."""
    if body in OF_REVOLUTION and support == "held":
        return runs(body, support, "fine", key, meridian=True)
    return runs(body, support, "fine", key)


def table(runs: Runs, o: argparse.Namespace) -> None:
    """A row per run: error in per cent at each depth, and what is stated in brackets."""
    ratio: list[float] = []
    elements = list(ELEMENTS) if o.elements else [""]
    for body in o.bodies:
        for support in o.supports if body in ("sphere", "kidney") else ["held"]:
            for key in o.sets:
                fine = true(runs, body, support, key)
                at = dict(zip(fine["travel"], fine["channels"]["Fz"], strict=True))
                print(f"\n{body}, {support}, set {key}: Fz N " + ", ".join(f"{s:g}: {F:.4f}" for s, F in at.items()))
                for level in o.levels:
                    for element in elements:
                        one = runs(body, support, level, key, element=element)
                        row = zip(one["travel"], one["channels"]["Fz"], one["stated"]["Fz"], strict=True)
                        row = [(s, 100 * (F / at[s] - 1), 100 * e / F) for s, F, e in row if s in at]
                        words = "  ".join(f"{s:g}: {a:+.2f} ({e:.2f})" for s, a, e in row)
                        name = f"{level} {element}".strip()
                        print(f"  {name}, {one['nodes']} nodes, {one['cpu']:.0f} s: {words} {one['stop'][:60]}")
                        ratio += [] if element else [e / max(abs(a), 1e-9) for _, a, e in row]
    if ratio:
        covered = 100 * np.mean(np.array(ratio) >= 1)
        print(f"\n{len(ratio)} points: {covered:.0f} % covered, stated over true {np.median(ratio):.1f} in the median")


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", default=["sphere"], choices=list(BODIES))
    parser.add_argument("--levels", nargs="+", default=["coarse", "standard"])
    parser.add_argument("--supports", nargs="+", default=["held"], choices=["held", "bowl"])
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=list(SETS))
    parser.add_argument("--elements", action="store_true")
    parser.add_argument("--out", type=Path)
    o = parser.parse_args()
    table(Runs(o.out), o)


if __name__ == "__main__":
    main()
