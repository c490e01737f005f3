"""Finite element runs until a known material is identified: python benchmarks/identify_runs.py [options]

    --truth LEVEL    mesh level of the synthetic measurement (coarse: that of the identification, no model error)
    --mu, --D1       its parameters (0.009 MPa, 20 1/MPa)
    --depth          deepest travel in mm (4)
    --most N         give up after that many runs (20)
    --study          count the runs of a whole `rso run` on the same data too: design, proof, search, identification

A ball of 3 mm is pressed into the top of the kidney phantom.  The measurement is a finite element curve with a known
(mu, D1); the identification knows only the curve and the ranges of the study `kidney_em2`.

By similarity F = mu f(x) with x = ln(mu D1), and every run brings df/dx with it.  So after n runs ln f is known at n
places with its slope: a cubic through values and slopes of the neighbours, a line beyond the last ones.  Each step
minimises the relative misfit of the curve over (ln mu, x) on what is known (after one run the classic Gauss-Newton step
with exact scaling) and runs the model there.  It ends when that run agrees with its prediction to 0.5 % at every depth
and no further step would lower the misfit by more than a tenth of that.  The thesis behind the study made about 40 runs
by hand.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, Response
from rso.running import Task, run_all
from rso.store import Done, RunStore

RANGES = {"mu": (0.003356, 0.036765), "D1": (1.0, 168.0)}
SETTINGS: dict[str, Any] = {
    "specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]},
    "indenter": {"shape": "sphere", "radius": 3.0, "shaft": True},
    "support": {"kind": "fixed"},
    "material": {"law": "neo_hookean"},
}
TOLERANCE = 0.005  # of every force
FARTHEST = 2.0  # a step in ln(mu D1): slopes tell nothing about places farther away


class Inline(Executor):
    """Computes at once in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


Solve = Callable[[Mapping[str, float]], Response]


def solver(store: RunStore, level: str, depths: np.ndarray) -> Solve:
    """One finite element run."""
    case = Case("top", Programme.ramp(tuple(map(float, depths))), {**SETTINGS, "mesh": {"level": level}})

    def solve(values: Mapping[str, float]) -> Response:
        (outcome,) = run_all(BACKEND, [Task(values, case)], store, Inline())
        if not isinstance(outcome, Done):
            raise RuntimeError(f"{values}: {outcome.reason}")
        return outcome.response

    return solve


@dataclass(frozen=True, eq=False)
class Known:
    """What a run says: x = ln(mu D1), ln f (k,) at the depths and its slope over x (k,), with f = F/mu."""

    x: float
    y: np.ndarray
    slope: np.ndarray

    @staticmethod
    def of(values: Mapping[str, float], response: Response) -> Known:
        F = response.channels["Fz"]
        slope = values["D1"] * np.asarray(response.gradients["D1"]["Fz"]) / F  # at constant mu, d/dx = d/dln D1
        return Known(float(np.log(values["mu"] * values["D1"])), np.log(F / values["mu"]), slope)


def curve(known: list[Known], x: float) -> np.ndarray:
    """ln f (k,) at x."""
    rows = sorted(known, key=lambda k: k.x)
    end = rows[0] if x <= rows[0].x else rows[-1] if x >= rows[-1].x else None
    if end is not None:
        return end.y + end.slope * (x - end.x)
    at, y, slope = (np.array([getattr(k, name) for k in rows]) for name in ("x", "y", "slope"))
    return CubicHermiteSpline(at, y, slope, axis=0)(x)


def step(known: list[Known], F: np.ndarray, last: float) -> tuple[dict[str, float], np.ndarray]:
    """Most likely (mu, D1) within the ranges on what is known, not too far from the last run, and its curve."""
    low, high = (np.log([r[k] for r in RANGES.values()]) for k in (0, 1))

    def residual(p: np.ndarray) -> np.ndarray:
        x = last + np.clip(p.sum() - last, -FARTHEST, FARTHEST)
        return np.append(p[0] + curve(known, x) - np.log(F), 1e-3 * (p.sum() - x))

    starts = [np.clip([a, last - a], low, high) for a in np.linspace(low[0], high[0], 5)]
    best = min((least_squares(residual, s, bounds=(low, high), xtol=1e-12, ftol=1e-12) for s in starts),
               key=lambda r: r.cost)  # fmt: skip
    mu, D1 = map(float, np.exp(best.x))
    return {"mu": mu, "D1": D1}, mu * np.exp(curve(known, float(best.x.sum())))


def identify(solve: Solve, F: np.ndarray, most: int, say: Callable[[str], None]) -> tuple[dict[str, float], int, float]:
    """(mu, D1), the number of runs, and the largest relative miss of the last run."""
    values = {k: float(np.sqrt(low * high)) for k, (low, high) in RANGES.items()}
    known: list[Known] = []
    predicted = None
    for n in range(1, most + 1):
        response = solve(values)
        mine = response.channels["Fz"]
        gap = np.inf if predicted is None else float(np.abs(predicted / mine - 1).max())
        miss = float(np.abs(mine / F - 1).max())
        say(f"  run {n}: mu {1e3 * values['mu']:.4g} kPa, D1 {values['D1']:.4g} 1/MPa, misses the curve by "
            f"{100 * miss:.3f} %, its prediction by {100 * gap:.3f} %")  # fmt: skip
        known.append(Known.of(values, response))
        following, predicted = step(known, F, known[-1].x)
        gain = miss - float(np.abs(predicted / F - 1).max())
        if gap <= TOLERANCE and gain <= 0.1 * TOLERANCE:
            return values, n, miss
        values = following
    return values, most, miss


STUDY = """
[study]
title = "Known material"
seed = 1
[backend]
use = "fem_backend.backend:BACKEND"
[backend.settings]
specimen = {{ shape = "ellipsoid", semi_axes = [60.0, 35.0, 35.0] }}
indenter = {{ shape = "sphere", radius = 3.0, shaft = true }}
support = {{ kind = "fixed" }}
material = {{ law = "neo_hookean" }}
mesh = {{ level = "coarse" }}
[parameters]
mu = {{ low = 0.003356, high = 0.036765, scale = "log" }}
D1 = {{ low = 1.0, high = 168.0, scale = "log" }}
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = {{ Fz = "0.1 mN" }}
[doe]
runs = 40
held_out = 2
[search]
candidates = 1
[dispatch]
jobs = 1
[report]
html = false
pdf = false
"""


def study_runs(depths: np.ndarray, F: np.ndarray, folder: Path) -> None:
    """A whole study on the same curve."""
    from rso.study import load
    from rso.study.plan import make_plan
    from rso.study.whole import run_study

    (folder / "top.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{u!r},{f!r}\n" for u, f in zip(map(float, depths),
                                    map(float, F), strict=True)))  # fmt: skip
    (folder / "study.toml").write_text(STUDY.format())
    start = time.process_time()
    with RunStore(folder / "results") as store:
        found = run_study(make_plan(load(folder)), store, Inline(), folder / "results", command="", jobs=1)
    values, counts = found["identification"]["values"], found["counts"]
    ended = found["identification"]["recomputed"]
    print(f"rso run: {counts['fe_runs']} runs ({', '.join(sorted({r['purpose'] for r in found['runs']}))}), "
          f"mu {1e3 * values['mu']:.4g} kPa, D1 {values['D1']:.4g} 1/MPa, prediction off by "
          f"{100 * ended['agreement']:.3f} %, {time.process_time() - start:.0f} s CPU")  # fmt: skip


def main() -> None:
    """Print every run and the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", default="coarse")
    parser.add_argument("--mu", type=float, default=0.009)
    parser.add_argument("--D1", type=float, default=20.0)
    parser.add_argument("--depth", type=float, default=4.0)
    parser.add_argument("--most", type=int, default=20)
    parser.add_argument("--study", action="store_true")
    options = parser.parse_args()
    depths = options.depth * np.arange(1, 9) / 8
    truth = {"mu": options.mu, "D1": options.D1}
    with tempfile.TemporaryDirectory() as name, RunStore(Path(name) / "runs") as store:
        F = solver(store, options.truth, depths)(truth).channels["Fz"]
        print(f"truth: mu {1e3 * options.mu:g} kPa, D1 {options.D1:g} 1/MPa, level {options.truth}", flush=True)
        start, wall = time.process_time(), time.perf_counter()
        with RunStore(Path(name) / "mine") as mine:  # nothing of the truth is taken from the store
            solve = solver(mine, "coarse", depths)
            values, n, miss = identify(solve, F, options.most, lambda text: print(text, flush=True))
        cpu, wall = time.process_time() - start, time.perf_counter() - wall
        errors = ", ".join(f"{k} {100 * (v / truth[k] - 1):+.2f} %" for k, v in values.items())
        print(f"Gauss-Newton with similarity: {n} runs, every force within {100 * miss:.3f} %, errors {errors}; "
              f"{cpu:.0f} s CPU, {wall:.0f} s wall")  # fmt: skip
        if options.study:
            study_runs(depths, F, Path(name))


if __name__ == "__main__":
    main()
