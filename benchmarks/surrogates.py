"""The response-surface engine beside exact answers and two peers: python benchmarks/surrogates.py [options]

    --peers PYTHON   an interpreter that has smt and openturns; without it a throw-away environment is made (pip)
    --no-peers       print without the peers
    --seeds N        designs per problem (10)
    --many           only kriging of many runs: CPU time and error of one output

Sections: Sobol indices against exact ones; what 90 % bands of kriging hold; kriging against SMT and OpenTURNS on
identical designs; kriging through gradients against GEKPLS; hypervolume of NSGA-II on ZDT1 to 3; the three-term
Mooney–Rivlin fit of the Ansys guide.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rso import benchmarks
from rso.doe import Box, design, sobol_sequence
from rso.emulation import fit_surrogate, sensitivity
from rso.optimise import nsga2

HERE = Path(__file__).parent
SHEET = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.006, 10.0), (0.02, 150.0), (True, True))
Function = Callable[[np.ndarray], np.ndarray]


def layer(X: np.ndarray) -> np.ndarray:
    """Force (N) at 2 mm on a bonded layer of 8 mm."""
    mu, D1 = SHEET.from_unit(X).T
    return benchmarks.indentation(2.0, mu, D1, 3.0, 8.0)


@dataclass(frozen=True)
class Problem:
    """A function of the unit cube and how many points to learn it from."""

    name: str
    f: Function
    d: int
    runs: int


VALUES = (
    Problem("Branin", benchmarks.branin, 2, 20),
    Problem("Branin", benchmarks.branin, 2, 40),
    Problem("Borehole", benchmarks.borehole, 8, 80),
)
BANDS = (
    Problem("Layer", layer, 2, 20),
    Problem("Branin", benchmarks.branin, 2, 20),
    Problem("Branin", benchmarks.branin, 2, 80),
    Problem("Ishigami", benchmarks.ishigami, 3, 30),
    Problem("Ishigami", benchmarks.ishigami, 3, 60),
    Problem("Borehole", benchmarks.borehole, 8, 80),
)
FEW = (  # one dimension, what similarity leaves of (mu, D1), and as few runs as a study makes
    Problem("Softening", lambda X: benchmarks.indentation(1.0, 1.0, 10 ** (3 * X[:, 0] - 1.5)), 1, 8),
    Problem("Rough", lambda X: FEW[0].f(X) * (1 + 3e-3 * np.sin(9e3 * X[:, 0])), 1, 8),
    Problem("Kink", lambda X: 1 + 0.3 * X[:, 0] + 0.2 * np.maximum(X[:, 0] - 0.63, 0), 1, 8),
)
GRADIENTS = (
    Problem("Branin", benchmarks.branin, 2, 12),
    Problem("Borehole", benchmarks.borehole, 8, 20),
    Problem("Layer", layer, 2, 6),
)


def gradient(f: Function, X: np.ndarray, h: float = 1e-5) -> np.ndarray:
    """∂f/∂x (n, d) by central differences, one-sided to second order at the faces of the cube."""
    G = np.empty_like(X)
    for j in range(X.shape[1]):
        step = h * np.eye(X.shape[1])[j]
        s = np.where(X[:, [j]] + h > 1, -1.0, 1.0)
        edge = (X[:, j] - h < 0) | (X[:, j] + h > 1)
        a, b = f(np.clip(X - step, 0, 1)), f(np.clip(X + step, 0, 1))
        one = s[:, 0] * (-3 * f(X) + 4 * f(X + s * step) - f(X + 2 * s * step)) / (2 * h)
        G[:, j] = np.where(edge, one, (b - a) / (2 * h))
    return G


def error(predicted: np.ndarray, y: np.ndarray) -> float:
    """RMSE over the standard deviation of what is predicted."""
    return float(np.sqrt(np.mean((predicted - y) ** 2)) / np.std(y))


def indices(n: int = 2**13) -> list[str]:
    """Ishigami and the g-function of eight parameters."""
    a = np.array([0, 1, 4.5, 9, 99, 99, 99, 99])
    lines = [f"Sobol indices, {n} base points: largest error (largest standard error of the bootstrap)"]
    for name, f, d, exact in (
        ("Ishigami", benchmarks.ishigami, 3, benchmarks.ishigami_indices()),
        ("Sobol-G", lambda X: benchmarks.sobol_g(X, a), 8, benchmarks.sobol_g_indices(a)),
    ):
        r = sensitivity.saltelli_indices(f, d, 0, n=n)
        for words, found, interval, truth in (
            ("first", r.first, r.first_interval, exact[0]),
            ("total", r.total, r.total_interval, exact[1]),
        ):
            se = np.ptp(interval, axis=1).max() / (2 * 1.645)
            lines.append(f"  {name:9s} {words}  {np.abs(found - truth).max():.4f}  ({se:.4f})")
    return lines


def bands(problems: tuple[Problem, ...], seeds: int, points: int = 512) -> tuple[list[str], np.ndarray]:
    """Share of new values within the 90 % band and its interval score, (problem, design, (plain, widened), 2).

    The score is 2 q sd + (2/0.1) max(|error| − q sd, 0) with q = 1.645 over the sd of the values: the smaller, the
    better (Gneiting & Raftery, J. Am. Stat. Assoc. 102 (2007) 359, eq. 43); "plain" is one process alone.
    """
    found = np.empty((len(problems), seeds, 2, 2))
    lines = [f"90 % bands of kriging, {seeds} designs: share of new values within, plain -> widened; interval score"]
    for i, p in enumerate(problems):
        for seed in range(seeds):
            X, Q = design("lhs", p.d, p.runs, 500 + seed), sobol_sequence(p.d, points, seed)
            model, y = fit_surrogate("kriging", X, p.f(X), seed=0), p.f(Q)
            for k, m in enumerate((replace(model, inflate=1.0, rivals=()), model)):
                mean, sd = m.predict(Q)
                over = np.abs(mean - y) - 1.645 * sd
                found[i, seed, k] = np.mean(over < 0), np.mean(3.29 * sd + 20 * np.maximum(over, 0)) / np.std(y)
        share, width = found[i, :, :, 0].mean(axis=0), np.exp(np.log(found[i, :, :, 1]).mean(axis=0))
        label = f"{p.name}, d = {p.d}, {p.runs} runs"
        lines.append(f"  {label:26s} {share[0]:.2f} -> {share[1]:.2f}; {width[0]:.3g} -> {width[1]:.3g}")
    share, score = found[..., 0].mean(axis=(0, 1)), np.exp(np.log(found[..., 1]).mean(axis=(0, 1)))
    lines.append(f"  {'all':26s} {share[0]:.3f} -> {share[1]:.3f}; × {score[1] / score[0]:.3f}")
    return lines, found


def many(points: int = 4096) -> list[str]:
    """CPU time (s) of kriging an output of many runs, and its error over the deviation of new values."""
    lines = ["Kriging of many runs: CPU time of one output, error over the deviation of new values"]
    for f, name, d, runs in ((benchmarks.borehole, "borehole", 8, 500), (benchmarks.branin, "Branin", 2, 300)):
        X, Q = design("lhs", d, runs, 0), sobol_sequence(d, points, 9)
        began = time.process_time()
        model, y = fit_surrogate("kriging", X, f(X), seed=0), f(Q)
        spent = time.process_time() - began
        lines.append(f"  {name}, d = {d}, {runs} runs: {spent:.3g} s, {np.std(model.mean(Q) - y) / np.std(y):.2g}")
    return lines


def compare(
    title: str, problems: tuple[Problem, ...], seeds: int, python: str | None, slopes: bool, points: int = 2048
) -> tuple[list[str], dict[str, dict[str, list[float]]]]:
    """Errors by problem and model over designs that are the same for all models."""
    arrays, keys, found = {}, [], {}
    for p in problems:
        label = f"{p.name}, d = {p.d}, {p.runs} runs"
        found[label] = {}
        for seed in range(seeds):
            X, Q = design("lhs", p.d, p.runs, seed), sobol_sequence(p.d, points, 999)
            k = len(keys)
            keys.append((label, p.f(Q)))
            arrays |= {f"X{k}": X, f"y{k}": p.f(X), f"Q{k}": Q} | ({f"G{k}": gradient(p.f, X)} if slopes else {})
            for name, cpu, predicted in ours(p, X, Q, seed, arrays[f"G{k}"] if slopes else None):
                found[label].setdefault(name, []).append(error(predicted, p.f(Q)))
                found[label].setdefault(f"{name}|cpu", []).append(cpu)
    if python is not None:
        for name, predicted in peers(python, arrays).items():
            k, model, *cpu = name.split("|")
            label, y = keys[int(k)]
            value = float(predicted) if cpu else error(predicted, y)
            found[label].setdefault("|".join([model, *cpu]), []).append(value)
    lines = [f"{title}: RMSE/sd over {seeds} designs, median (worst), CPU seconds"]
    for label, models in found.items():
        lines.append(f"  {label}")
        names = [m for m in models if not m.endswith("|cpu")]
        for m in sorted(names, key=lambda m: np.median(models[m])):
            cpu = np.median(models[f"{m}|cpu"])
            lines.append(f"    {m:26s} {np.median(models[m]):.2e}  ({np.max(models[m]):.2e})  {cpu:.2f}")
    return lines, found


def ours(p: Problem, X: np.ndarray, Q: np.ndarray, seed: int, G: np.ndarray | None) -> Iterator[tuple]:
    """Name, CPU seconds and predictions of the surrogates of rso."""
    y = p.f(X)
    more = design("lhs", p.d, 2 * p.runs, seed)
    jobs: dict[str, Callable[[], object]] = {"rso kriging": lambda: fit_surrogate("kriging", X, y, seed=0)}
    if G is None:
        jobs["rso auto"] = lambda: fit_surrogate("auto", X, y, seed=0)
    else:
        jobs["rso kriging, gradients"] = lambda: fit_surrogate("kriging", X, y, seed=0, gradients=G)
        jobs["rso kriging, twice the runs"] = lambda: fit_surrogate("kriging", more, p.f(more), seed=0)
    for name, job in jobs.items():
        start = time.process_time()
        model = job()
        yield name, time.process_time() - start, model.mean(Q)


def peers(python: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Predictions of benchmarks/peers.py under another interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "problems.npz", Path(folder) / "predictions.npz"
        np.savez(source, **arrays)
        subprocess.run([python, str(HERE / "peers.py"), str(source), str(target)], check=True)
        with np.load(target, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}


@contextlib.contextmanager
def peer_python(given: str | None) -> Iterator[str]:
    """The interpreter that was given, or that of an environment which is deleted afterwards."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = str(Path(folder) / "bin" / "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", "smt==2.15.0", "openturns==1.27.post1"], check=True)
        yield python


def hypervolumes(population: int = 100, generations: int = 250) -> list[str]:
    """ZDT1 to 3 with 30 parameters, the setting of Deb et al. 2002."""
    from pymoo.indicators.hv import Hypervolume

    lines = [f"NSGA-II, {population} points, {generations} generations, d = 30: hypervolume to (1.1, 1.1) of exact"]
    exact = (benchmarks.ZDT1_HYPERVOLUME, benchmarks.ZDT2_HYPERVOLUME, benchmarks.zdt3_hypervolume())
    for k, (f, truth) in enumerate(zip((benchmarks.zdt1, benchmarks.zdt2, benchmarks.zdt3), exact, strict=True)):
        found = [
            Hypervolume(ref_point=np.array([1.1, 1.1]))(
                nsga2(f, 30, seed=s, population=population, generations=generations).F
            )
            for s in range(3)
        ]
        lines.append(f"  ZDT{k + 1}  {np.mean(found):.4f} ± {np.std(found):.4f} of {truth:.4f}")
    return lines


def rubber() -> list[str]:
    """Both weightings of the published fit."""
    strain, stress = np.loadtxt(HERE / "data" / "ansys_mr3_uniaxial.csv", delimiter=",", skiprows=4).T
    lines = ["Three-term Mooney–Rivlin, uniaxial: published 1.338856, 0.5236214, -0.01648364"]
    for weighting in ("relative", "absolute"):
        C, left = benchmarks.mooney_rivlin3(strain, stress, weighting)
        lines.append(f"  {weighting}  {C[0]:.6f}, {C[1]:.7f}, {C[2]:.8f}; sum of squares {left:.5g}")
    return lines


def main(arguments: list[str]) -> int:
    """Print every section."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers")
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--many", action="store_true")
    given = parser.parse_args(arguments)

    def show(lines: list[str]) -> None:
        print("\n".join(lines), flush=True)

    if given.many:
        show(many())
        return 0
    show(indices())
    show(bands(BANDS, given.seeds)[0])
    show(bands(FEW, given.seeds)[0])
    with contextlib.nullcontext(None) if given.no_peers else peer_python(given.peers) as python:
        show(compare("Kriging", VALUES, given.seeds, python, False)[0])
        show(compare("Kriging through gradients", GRADIENTS, given.seeds, python, True)[0])
    show(hypervolumes())
    show(rubber())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
