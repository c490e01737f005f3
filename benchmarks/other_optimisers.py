"""Evaluations and CPU seconds to a stated accuracy, beside Optuna, OpenTURNS and Dakota's usual recipe.

    pip install -e '.[bench]'
    python benchmarks/other_optimisers.py FOLDER [--figure FILE]

runs what FOLDER/results.jsonl does not hold, prints the table and draws it.

Two problems, each with a known answer, five seeds each:

- *layer*: shear modulus and D1 of a bonded layer under a sphere from 12 forces (closed form, relative noise of 0.2 %),
  to 1 % of the modulus and 5 % of D1 from the least-squares optimum of these readings;
- *beam*: the cheapest welded beam of studies/welded_beam, to 0.1 % of the published 1.72485 within all limits.

An evaluation is a call of the model.  The others are stopped by an oracle: at the first of their points that is good
enough, which no user can see.  rso is charged with all it did until it ended by itself: verification and, of the
layer, intervals are in it.  A call of these models takes microseconds: the seconds are those of the method.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.stats import qmc

import rso
from rso.benchmarks import indentation

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "studies" / "welded_beam"))
import welded_beam  # noqa: E402

SEEDS = range(1, 6)
MOST = {"Optuna TPE": 500, "Optuna CMA-ES": 2000, "OpenTURNS EGO": 60}
DESIGN = 10  # points before EGO, and of the Latin hypercube before a local method
DEPTH = np.linspace(0.1, 1.2, 12)
RADIUS, THICKNESS, NOISE = 3.0, 6.0, 0.002
LOW, HIGH, TRUTH = np.array([6e-3, 10.0]), np.array([20e-3, 150.0]), np.array([0.012, 60.0])
NEAR = np.array([0.01, 0.05])
CHEAPEST, NEAR_CHEAPEST, SLACK = 1.72485, 1e-3, 1e-4
LIMITS = {"shear_stress": (13600.0, 1), "bending_stress": (30000.0, 1), "buckling_load": (6000.0, -1)}
BEAM_LOW, BEAM_HIGH = np.array([0.125, 0.1, 1.0, 0.125]), np.array([5.0, 10.0, 10.0, 5.0])  # inch


class Found(Exception):
    """A point that is good enough, of a method that does not know it."""


class Counted:
    """A function that counts its calls, and stops its caller where `good` says so."""

    def __init__(self, function: Callable, good: Callable, most: float = math.inf) -> None:
        self.function, self.good, self.most, self.calls, self.found = function, good, most, 0, False

    def __call__(self, x):
        if self.calls >= self.most:
            raise TimeoutError
        self.calls += 1
        x = np.asarray(x, float)
        found = self.function(x)
        if self.good(x):
            self.found = True
            raise Found
        return found


def force(x: np.ndarray) -> np.ndarray:
    """Forces (12,) N at (mu, D1)."""
    return indentation(DEPTH, x[0], x[1], RADIUS, THICKNESS)


def physical(z: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Values of a point of the unit cube, on log scales."""
    return low * (high / low) ** np.clip(z, 0.0, 1.0)


def beam_of(x: np.ndarray) -> tuple[float, np.ndarray]:
    """Cost and by how much each limit is broken, relative (4,), at lengths in inch."""
    out = welded_beam.beam.function(*(25.4 * x))
    psi, pound = welded_beam.PSI, welded_beam.POUND
    units = {"shear_stress": psi, "bending_stress": psi, "buckling_load": pound}
    broken = [sign * (out[n] / units[n] / limit - 1.0) for n, (limit, sign) in LIMITS.items()]
    return out["cost"], np.array([*broken, x[0] / x[3] - 1.0])


def penalised(x: np.ndarray) -> float:
    """log of the cost and ten times what is broken: for methods without constraints."""
    cost, broken = beam_of(x)
    return math.log(cost) + 10.0 * float(np.maximum(broken, 0.0).sum())


class Layer:
    """The readings of a seed, their least-squares optimum, and what counts as near to it."""

    dimension, low, high = 2, LOW, HIGH

    def __init__(self, seed: int) -> None:
        self.clean = force(TRUTH)
        self.y = self.clean * (1.0 + NOISE * np.random.default_rng([46, seed]).standard_normal(len(DEPTH)))
        start = np.log(TRUTH / LOW) / np.log(HIGH / LOW)
        best = least_squares(self.residuals_at, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        self.best = physical(best.x, LOW, HIGH)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        return (force(x) - self.y) / (NOISE * self.clean)

    def residuals_at(self, z: np.ndarray) -> np.ndarray:
        return self.residuals(physical(z, LOW, HIGH))

    def scalar(self, x: np.ndarray) -> float:
        return math.log1p(float(np.sum(self.residuals(x) ** 2)))

    def good(self, x: np.ndarray) -> bool:
        return bool(np.all(np.abs(x / self.best - 1.0) <= NEAR))


class Beam:
    """The cheapest beam."""

    dimension, low, high = 4, BEAM_LOW, BEAM_HIGH

    def __init__(self, seed: int) -> None:
        pass

    def scalar(self, x: np.ndarray) -> float:
        return penalised(x)

    def good(self, x: np.ndarray) -> bool:
        cost, broken = beam_of(x)
        return bool(cost <= CHEAPEST * (1 + NEAR_CHEAPEST) and broken.max() <= SLACK)


PROBLEMS = {"layer": Layer, "beam": Beam}


def optuna_with(name: str):
    """Optuna's samplers with their defaults, on log scales; TPE knows the beam's limits as constraints."""

    def run(problem, seed: int) -> int:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        limited = isinstance(problem, Beam) and name == "TPE"
        constraints = (lambda trial: trial.user_attrs["broken"]) if limited else None
        if name == "TPE":
            sampler = optuna.samplers.TPESampler(seed=seed, constraints_func=constraints)
        else:
            sampler = optuna.samplers.CmaEsSampler(seed=seed)
        counted = Counted(problem.scalar, problem.good, MOST[f"Optuna {name}"])

        def objective(trial) -> float:
            ends = zip(problem.low, problem.high, strict=True)
            x = np.array([trial.suggest_float(f"x{k}", lo, hi, log=True) for k, (lo, hi) in enumerate(ends)])
            value = counted(x)
            if limited:
                cost, broken = beam_of(x)
                trial.set_user_attr("broken", broken.tolist())
                return cost
            return value

        optuna.create_study(sampler=sampler).optimize(objective, n_trials=counted.most)
        raise TimeoutError

    return run


def openturns_ego(problem, seed: int) -> None:
    """Efficient global optimisation of OpenTURNS: Matérn 5/2 kriging of the scalar from a Latin hypercube."""
    import openturns as ot
    from openturns.experimental import EfficientGlobalOptimization

    ot.Log.Show(ot.Log.NONE)
    ot.RandomGenerator.SetSeed(seed)
    d = problem.dimension
    counted = Counted(lambda z: problem.scalar(at(z)), lambda z: problem.good(at(z)), MOST["OpenTURNS EGO"])

    def at(z):
        return physical(np.asarray(z), problem.low, problem.high)

    design = ot.Sample(qmc.LatinHypercube(d, rng=seed).random(DESIGN * d // 2).tolist())
    values = ot.Sample([[counted(z)] for z in design])
    task = ot.OptimizationProblem(ot.PythonFunction(d, 1, lambda z: [counted(z)]))
    task.setBounds(ot.Interval([0.0] * d, [1.0] * d))
    basis = ot.ConstantBasisFactory(d).build()
    fitter = ot.GaussianProcessFitter(design, values, ot.MaternModel([0.3] * d, 2.5), basis)
    fitter.run()
    process = ot.GaussianProcessRegression(fitter.getResult())
    process.run()
    ego = EfficientGlobalOptimization(task, process.getResult())
    ego.setMaximumCallsNumber(int(counted.most))
    ego.setParameterEstimationPeriod(1)
    ego.run()
    raise TimeoutError


def hypercube_and_local(problem, seed: int) -> None:
    """Dakota's usual recipe: a Latin hypercube, and from its best point a local method with forward differences.

    Least squares (NL2SOL there, scipy's trust region here) of the layer, sequential quadratic programming of the beam.
    """
    d = problem.dimension
    starts = qmc.LatinHypercube(d, rng=seed).random(DESIGN)
    if isinstance(problem, Layer):
        counted = Counted(
            lambda z: problem.residuals_at(z), lambda z: problem.good(physical(z, problem.low, problem.high))
        )
        for first in sorted(starts, key=lambda z: float(np.sum(counted(z) ** 2))):
            least_squares(counted, first, bounds=(0.0, 1.0), diff_step=1e-4)
        raise TimeoutError
    counted = Counted(lambda z: beam_of(at(z)), lambda z: problem.good(at(z)))
    last: dict[bytes, tuple[float, np.ndarray]] = {}

    def at(z):
        return physical(np.asarray(z), problem.low, problem.high)

    def known(z):
        key = np.asarray(z, float).tobytes()
        if key not in last:
            last[key] = counted(z)
        return last[key]

    def score(z):
        cost, broken = known(z)
        return math.log(cost) + 10.0 * float(np.maximum(broken, 0.0).sum())

    for first in sorted(starts, key=score):  # the next start where the local method ends elsewhere
        minimize(
            lambda z: math.log(known(z)[0]),
            first,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * d,
            constraints={"type": "ineq", "fun": lambda z: -known(z)[1]},
            options={"maxiter": 100, "ftol": 1e-9},
        )
    raise TimeoutError


LAYER_STUDY = """
[study]
title = "Layer"
seed = {seed}
[backend]
use = "layer:layer"
[parameters]
mu = {{ low = "6 kPa", high = "20 kPa", scale = "log" }}
D1 = {{ low = 10, high = 150, scale = "log" }}
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = {{ contact = 0, gain = 0, correlation = 0 }}
[sensitivity]
sobol = false
local = false
[search]
{search}
[report]
html = false
pdf = false
"""


def rso_layer(search: str):
    """`rso run` of the study; its answer is what it calls most likely."""

    def run(problem: Layer, seed: int, folder: Path) -> tuple[int, bool]:
        columns = [DEPTH, problem.y, NOISE * problem.clean]
        np.savetxt(
            folder / "top.csv", np.transpose(columns), "%.9g", ",", header="depth_mm,Fz_N,Fz_sigma_N", comments=""
        )
        (folder / "study.toml").write_text(LAYER_STUDY.format(seed=seed, search=search))
        calls = [0]

        @rso.model(parameters={"mu": (1e-4, 1.0, "MPa"), "D1": (0.0, 1000.0, "1/MPa")})
        def layer(travel, mu, D1):
            calls[0] += 1
            return indentation(travel, mu, D1, RADIUS, THICKNESS)

        result = rso.load(folder, backend=layer, folder=folder / "results").run()
        found = np.array([result.parameters["value"][n] for n in ("mu", "D1")], float)
        return calls[0], problem.good(found)

    return run


def rso_beam(search: str):
    """`rso run` of the welded beam with one objective; its answer is the cheapest simulation within all limits."""

    def run(problem: Beam, seed: int, folder: Path) -> tuple[int, bool]:
        text = (ROOT / "studies/welded_beam/study.toml").read_text()
        text = text.replace("seed  = 1976", f"seed = {seed}").replace('"cost", "deflection"', '"cost"')
        head, _, tail = text.partition("[search]")
        runs = head.replace("runs        = 80", "runs = 40")
        text = f"{runs}[search]\n{search}\n[verify]{tail.partition('[verify]')[2]}\n"
        unasked = "[sensitivity]\nsobol = false\nlocal = false\n[report]\nhtml = false\npdf = false\n"
        (folder / "study.toml").write_text(text + unasked)
        result = rso.pareto(folder / "study.toml", backend=welded_beam.beam, folder=folder / "results").run()
        names = ("weld_height", "weld_length", "beam_height", "beam_width")
        rows = result.runs[list(names)].dropna().to_numpy(float) / 25.4
        return len(result.runs), any(problem.good(x) for x in rows)

    return run


METHODS = {
    ("layer", "rso, Gauss-Newton"): rso_layer('method = "gauss_newton"\nderivatives = "differences"'),
    ("layer", "rso, response surfaces"): rso_layer("candidates = 1"),
    ("beam", "rso, response surfaces"): rso_beam("candidates = 1"),
    **{
        (problem, name): run
        for problem in PROBLEMS
        for name, run in {
            "Optuna TPE": optuna_with("TPE"),
            "Optuna CMA-ES": optuna_with("CMA-ES"),
            "OpenTURNS EGO": openturns_ego,
            "hypercube, local method": hypercube_and_local,
        }.items()
    },
}


def measure(problem: str, method: str, seed: int) -> dict:
    """Evaluations, CPU seconds of everything, and whether the accuracy was reached."""
    asked, run = PROBLEMS[problem](seed), METHODS[problem, method]
    counts: list[Counted] = []
    make = Counted.__init__

    def noted(self, *arguments, **options) -> None:
        make(self, *arguments, **options)
        counts.append(self)

    Counted.__init__ = noted  # type: ignore[method-assign]
    start = time.process_time()
    try:
        if method.startswith("rso"):
            with tempfile.TemporaryDirectory() as folder:
                calls, good = run(asked, seed, Path(folder))
        else:
            with contextlib.suppress(Found, TimeoutError, RuntimeError):  # OpenTURNS wraps the first two
                run(asked, seed)
            calls, good = counts[-1].calls, counts[-1].found
            if not good and calls < min(counts[-1].most, 100):  # an error of its own: it counts as missed
                print(f"{problem}, {method}, seed {seed}: ended after {calls} evaluations by itself", file=sys.stderr)
    finally:
        Counted.__init__ = make  # type: ignore[method-assign]
    seconds = time.process_time() - start
    return {"problem": problem, "method": method, "seed": seed, "calls": calls, "seconds": seconds, "good": good}


def table(rows: list[dict]) -> list[str]:
    """Medians over the seeds; a method that misses counts with infinity."""
    lines = ["| problem | method | reached | evaluations, median (range) | CPU seconds |", "|---|---|---|---|---|"]
    for problem, method in METHODS:
        mine = [r for r in rows if (r["problem"], r["method"]) == (problem, method)]
        if not mine:
            continue
        calls = sorted(r["calls"] if r["good"] else math.inf for r in mine)
        middle, good = statistics.median(calls), sum(r["good"] for r in mine)
        shown = "not reached" if math.isinf(middle) else f"{middle:.0f}"
        spread = f"{min(r['calls'] for r in mine)} to {max(r['calls'] for r in mine)}"
        seconds = statistics.median(r["seconds"] for r in mine)
        lines.append(f"| {problem} | {method} | {good} of {len(mine)} | {shown} ({spread}) | {seconds:.2g} |")
    return lines


def figure(rows: list[dict], file: Path) -> None:
    """Evaluations of each seed, by method; hollow where the accuracy was not reached."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
    titles = {"layer": "two parameters of a layer", "beam": "cheapest welded beam"}
    for ax, (problem, title) in zip(axes, titles.items(), strict=True):
        names = [m for p, m in METHODS if p == problem][::-1]
        for k, name in enumerate(names):
            for r in rows:
                if (r["problem"], r["method"]) == (problem, name):
                    colour = "C1" if name.startswith("rso") else "C0"
                    ax.plot(r["calls"], k, "o", color=colour, mfc=colour if r["good"] else "none")
        ax.set(xscale="log", yticks=range(len(names)), yticklabels=names, xlabel="evaluations", title=title)
        ax.grid(axis="x", alpha=0.3)
    plt.savefig(file, dpi=130)


def main() -> None:
    """Run what is missing, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--only", default="", help="a part of PROBLEM, METHOD")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    file = options.folder / "results.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    have = {(r["problem"], r["method"], r["seed"]) for r in rows}
    for problem, method in METHODS:
        for seed in SEEDS:
            if (problem, method, seed) in have or options.only not in f"{problem}, {method}":
                continue
            rows.append(measure(problem, method, seed))
            with open(file, "a") as out:
                out.write(json.dumps(rows[-1]) + "\n")
            print(rows[-1], file=sys.stderr, flush=True)
    print("\n".join(table(rows)))
    if options.figure:
        figure(rows, options.figure)


if __name__ == "__main__":
    main()
