"""Finite element runs until a known material is identified: python benchmarks/identify_runs.py [options]

    --truth LEVEL    mesh level of the synthetic measurement (coarse: that of the identification, no model error)
    --mu, --D1       its parameters (0.009 MPa, 20 1/MPa)
    --depth          deepest travel in mm (4)
    --start MU D1    where the descent begins (default: the middle of the ranges)
    --surfaces       count the runs of a search on response surfaces on the same data too

A ball of 3 mm is pressed into the top of the kidney phantom.  The measurement is a finite element curve with a known
(mu, D1); the study knows only the curve and the ranges of `kidney_em2`, and is run as `rso run` does it, with
`[search] method = "gauss_newton"` and `[verify] tolerance = "0.5 %"`.  The thesis behind the study made about 40 runs
by hand.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND
from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.contract import Case, Programme
from rso.evaluation import Task, run_all
from rso.evaluation.store import Done, RunStore
from rso.study.loader import load_study

SETTINGS: dict[str, Any] = {
    "specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]},
    "indenter": {"shape": "sphere", "radius": 3.0, "shaft": True},
    "support": {"kind": "fixed"},
    "material": {"law": "neo_hookean"},
}
STUDY = """
[study]
title = "Known material"
seed = 1
[backend]
use = "fem_backend.backend:BACKEND"
[backend.settings]
specimen = { shape = "ellipsoid", semi_axes = [60.0, 35.0, 35.0] }
indenter = { shape = "sphere", radius = 3.0, shaft = true }
support = { kind = "fixed" }
material = { law = "neo_hookean" }
mesh = { level = "coarse" }
[parameters]
mu = { low = 0.003356, high = 0.036765, scale = "log" }
D1 = { low = 1.0, high = 168.0, scale = "log" }
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = { Fz = "0.1 mN" }
[verify]
tolerance = "0.5 %"
[report]
html = false
pdf = false
"""
DIRECT = '[search]\nmethod = "gauss_newton"\n'
SURFACES = "[doe]\nruns = 40\nheld_out = 2\n[search]\ncandidates = 1\n"


class Inline(Executor):
    """Computes at once in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def measured(store: RunStore, level: str, truth: dict[str, float], depths: np.ndarray) -> np.ndarray:
    """Force (N) of the truth at the depths."""
    case = Case("top", Programme.ramp(tuple(map(float, depths))), {**SETTINGS, "mesh": {"level": level}})
    (outcome,) = run_all(BACKEND, [Task(truth, case)], store, Inline())
    if not isinstance(outcome, Done):
        raise RuntimeError(f"{truth}: {outcome.reason}")
    return np.asarray(outcome.response.channels["Fz"])


def studied(folder: Path, search: str) -> tuple[dict[str, Any], float]:
    """Results of the study in a folder of its own (nothing of the truth is in its store), and its CPU time (s)."""
    (folder / "study.toml").write_text(STUDY + search)
    out = folder / ("direct" if search.startswith(DIRECT) else "surfaces")
    start = time.process_time()
    with RunStore(out) as store:
        found = run_study(make_plan(load_study(folder)), store, Inline(), out, command="", jobs=1)
    return found, time.process_time() - start


def tell(found: dict[str, Any], truth: dict[str, float], F: np.ndarray, cpu: float) -> None:
    """One line: runs, largest miss of any force, errors of the parameters."""
    candidate = found["searches"][0]["candidates"][0]
    curve, values = candidate["curves"]["top"], (found["identification"] or candidate)["values"]
    miss = float(np.abs(np.array(curve["value"]) / F - 1).max()) if len(curve["value"]) == len(F) else float("nan")
    errors = ", ".join(f"{k} {100 * (values[k] / v - 1):+.2f} %" for k, v in truth.items())
    purposes = [r["purpose"] for r in found["runs"]]
    what = ", ".join(f"{purposes.count(p)} {p}" for p in dict.fromkeys(purposes))
    print(
        f"{found['counts']['fe_runs']} runs ({what}), exit code {found['exit_code']}, every force within "
        f"{100 * miss:.3f} %, errors {errors}; {cpu:.0f} s CPU",
        flush=True,
    )


def main() -> None:
    """Print every run and the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", default="coarse")
    parser.add_argument("--mu", type=float, default=0.009)
    parser.add_argument("--D1", type=float, default=20.0)
    parser.add_argument("--depth", type=float, default=4.0)
    parser.add_argument("--start", type=float, nargs=2, metavar=("MU", "D1"))
    parser.add_argument("--surfaces", action="store_true")
    options = parser.parse_args()
    depths = options.depth * np.arange(1, 9) / 8
    truth = {"mu": options.mu, "D1": options.D1}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with RunStore(folder / "truth") as store:
            F = measured(store, options.truth, truth, depths)
        rows = "".join(f"{u!r},{f!r}\n" for u, f in zip(depths.tolist(), F.tolist(), strict=True))
        (folder / "top.csv").write_text(f"depth_mm,Fz_N\n{rows}")
        print(f"truth: mu {1e3 * options.mu:g} kPa, D1 {options.D1:g} 1/MPa, level {options.truth}", flush=True)
        begin = f"start = {{ mu = {options.start[0]}, D1 = {options.start[1]} }}\n" if options.start else ""
        found, cpu = studied(folder, DIRECT + begin)
        (walk,) = found["descent"]["descents"]
        for i in walk["iterates"]:
            gap = "" if i["agreement"] is None else f", its prediction was off by {100 * i['agreement']:.3f} %"
            print(
                f"  run {i['number']}: mu {1e3 * i['values']['mu']:.4g} kPa, D1 {i['values']['D1']:.4g} 1/MPa, "
                f"chi2 {i['chi2']:.4g}{gap}",
                flush=True,
            )
        print(f"Gauss-Newton ({walk['why']}): ", end="")
        tell(found, truth, F, cpu)
        for p in (found["identification"] or {"parameters": ()})["parameters"]:
            print(f"  {p['parameter']} {p['verdict']}: {p['interval'][0]:.5g} to {p['interval'][1]:.5g}")
        if options.surfaces:
            found, cpu = studied(folder, SURFACES)
            print("response surfaces: ", end="")
            tell(found, truth, F, cpu)


if __name__ == "__main__":
    main()
