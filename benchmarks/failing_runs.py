"""What becomes of failed runs: rso beside the recipes of Dakota, MatCal and piglot: python benchmarks/failing_runs.py

    --seeds N    designs, each with its own failures (10)
    --runs N     runs of a design (40)
    --share S    share of the runs that fail (0.3)

A sphere on a bonded layer, in closed form; the force at two depths is to be met, mu and D1 are unknown.  Half of the
failures fill a corner of the box (compressible and soft: there is no answer), the others happen anywhere.

The peers are not run.  Each is its published recipe for a failed run in a line or two, fed to the same kriging, with
the same design, the same failures and the same search, so that only the recipe differs:

    leave out     (rso) a failed run is no datum; a classifier learns where runs fail, the search stays out of there
    recover       (Dakota, `failure_capture recover`) constants that the user states: here the largest, or the mean, of
                  the runs that are done
    line          (MatCal, `failure_default_field_values`) the curve linspace(-1, 1) over the depth
    zero          (piglot) a curve of zeros

Printed: medians over the seeds (and the worst seed).  `surrogate`: RMSE of the force at the deeper target over points
that have an answer, in % of its standard deviation there.  `target`: by how much the true force at the point found
misses the worse target.  `mu`, `D1`: error of the values found.  `no answer`: seeds in which the point found has none.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from rso.benchmarks import indentation
from rso.core.similarity import Group
from rso.doe import Box, design, sobol_sequence
from rso.emulation import feasibility, fit_surrogate

BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.006, 10.0), (0.02, 150.0), (True, True))
TRUE = np.array([0.012, 60.0])
DEPTHS = np.array([0.8, 2.0])  # mm
DEEPEST = 2.0
NO_GROUP = Group(None, 1.0, {}, {}, "")
CORNER = 0.15  # share of the box that has no answer


def force(X: np.ndarray) -> np.ndarray:
    """Force (n, 2) in N at the two depths for points (n, 2) of the unit cube."""
    mu, D1 = BOX.from_unit(X).T
    return indentation(DEPTHS, mu[:, None], D1[:, None], 3.0, 8.0)


def softness(X: np.ndarray) -> np.ndarray:
    """How far into the corner of compressible soft bodies a point lies."""
    return X[:, 1] - 0.5 * X[:, 0]


LIMIT = float(np.quantile(softness(sobol_sequence(2, 4096, 0)), 1 - CORNER))


@dataclass(frozen=True)
class Runs:
    """A design X (n, 2), its forces Y (n, 2) and which runs are done; Y of a failed run is never looked at."""

    X: np.ndarray
    Y: np.ndarray
    done: np.ndarray


def runs(n: int, share: float, seed: int) -> Runs:
    """A Latin hypercube of which that share has failed: the corner, and as many others as it takes."""
    X = design("lhs", 2, n, seed)
    done = softness(X) <= LIMIT
    left = np.flatnonzero(done)
    more = max(0, round(share * n) - int((~done).sum()))
    done[np.random.default_rng([seed, 1]).permutation(left)[:more]] = False
    return Runs(X, force(X), done)


def leave_out(r: Runs) -> tuple[np.ndarray, np.ndarray]:
    return r.X[r.done], r.Y[r.done]


def learnt_region(r: Runs, seed: int) -> Callable[[np.ndarray], np.ndarray]:
    """Mask of the points that are expected to have an answer."""
    values = [dict(zip(BOX.names, map(float, v), strict=True)) for v in BOX.from_unit(r.X)]
    region = feasibility.learn_feasibility(BOX, NO_GROUP, values, r.done.tolist(), seed)
    return lambda P: region.excess(dict(zip(BOX.names, BOX.from_unit(P).T, strict=True))) <= 0


def substituted(r: Runs, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return r.X, np.where(r.done[:, None], r.Y, value)


RECIPES: dict[str, Callable[[Runs], tuple[np.ndarray, np.ndarray]]] = {
    "rso: leave out": leave_out,
    "Dakota: recover, largest": lambda r: substituted(r, r.Y[r.done].max(axis=0)),
    "Dakota: recover, mean": lambda r: substituted(r, r.Y[r.done].mean(axis=0)),
    "MatCal: line": lambda r: substituted(r, np.interp(DEPTHS, np.linspace(0, DEEPEST, 20), np.linspace(-1, 1, 20))),
    "piglot: zero": lambda r: substituted(r, np.zeros(2)),
}


def found(predict: Callable[[np.ndarray], np.ndarray], good: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The point (2,) that misses the targets least on the surrogates, among those that are taken to have an answer."""
    target = force(BOX.to_unit(TRUE[None]))[0]

    def miss(X: np.ndarray) -> np.ndarray:
        return np.sum((predict(np.clip(X, 0, 1)) / target - 1) ** 2, axis=1) + 1e3 * ~good(np.clip(X, 0, 1))

    pool = sobol_sequence(2, 4096, 0)
    starts = pool[np.argsort(miss(pool))[:5]]
    exact = {"xatol": 1e-6, "fatol": 1e-14}
    ends = [minimize(lambda x: float(miss(x[None])[0]), s, method="Nelder-Mead", options=exact) for s in starts]
    return np.clip(min(ends, key=lambda e: e.fun).x, 0, 1)


def judged(name: str, r: Runs, seed: int) -> list[float]:
    """Surrogate, target, mu, D1 (all in %), and whether the point found has no answer."""
    X, Y = RECIPES[name](r)
    models = [fit_surrogate("kriging", X, y, seed=seed) for y in Y.T]
    good = learnt_region(r, seed) if RECIPES[name] is leave_out else lambda P: np.ones(len(P), bool)
    test = sobol_sequence(2, 2048, 99)
    test = test[softness(test) <= LIMIT]
    y = force(test)[:, 1]
    surrogate = np.sqrt(np.mean((models[1].predict(test)[0] - y) ** 2)) / y.std()
    x = found(lambda P: np.stack([m.predict(P)[0] for m in models], axis=1), good)
    truth = force(BOX.to_unit(TRUE[None]))[0]
    miss = np.abs(force(x[None])[0] / truth - 1).max()
    off = np.abs(BOX.from_unit(x) / TRUE - 1)
    return [100 * float(v) for v in (surrogate, miss, *off)] + [float(softness(x[None])[0] > LIMIT)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--share", type=float, default=0.3)
    options = parser.parse_args()
    start = time.process_time()
    print(
        f"{options.runs} runs, {100 * options.share:.0f} % of them failed, {options.seeds} seeds; medians (worst), in %"
    )
    print(f"{'':26}{'surrogate':>18}{'target':>18}{'mu':>18}{'D1':>18}{'no answer':>12}")
    for name in RECIPES:
        rows = np.array([judged(name, runs(options.runs, options.share, s), s) for s in range(options.seeds)])
        cells = [f"{np.median(c):.2g} ({c.max():.2g})" for c in rows.T[:4]]
        print(f"{name:26}" + "".join(f"{c:>18}" for c in cells) + f"{rows[:, 4].sum():>8.0f}/{options.seeds}")
    print(f"CPU {time.process_time() - start:.0f} s")


if __name__ == "__main__":
    main()
