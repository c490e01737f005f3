"""Latin hypercubes: one point in each row of cells of every parameter."""

from __future__ import annotations

import numpy as np

from rso.doe.farthest import extend, farthest
from rso.doe.sampler import MOST_OPTIMISED, DesignTask, Feasible, Sampler, enough


def latin(d: int, runs: int, seed: int, optimise: bool = True) -> np.ndarray:
    """Latin hypercube (runs, d): one point per row of cells; `optimise` swaps for low centred discrepancy."""
    from scipy.stats import qmc  # half a second to import

    # Never scipy's 'lloyd': it moves the points off their cells and took minutes at n = 120, d = 10.
    # Its own optimiser takes n² time; so many points fill the cube without it.
    method = "random-cd" if optimise and d > 1 and runs <= MOST_OPTIMISED else None
    return qmc.LatinHypercube(d, optimization=method, rng=np.random.default_rng(seed)).random(runs)


def latin_within(d: int, runs: int, seed: int, feasible: Feasible, optimise: bool = True) -> np.ndarray:
    """A Latin hypercube (runs, d) of the feasible part of the cube; ValueError where that is below 1 %.

    Entries of a column are swapped until no point is forbidden, which stays Latin (after Petelet et al., J. Stat. Plan.
    Inference 140 (2010) 2863).  A constraint that no Latin hypercube meets (x1 + x2 < 1 has the wrong means) gives
    points as far as possible from one another instead.
    """
    X = latin(d, runs, seed, optimise)
    inside = swapped_inside(X, feasible, np.random.default_rng(seed))
    return farthest(np.empty((0, d)), runs, seed, feasible) if inside is None else inside


def extend_latin(existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d) in rows of cells that the N existing ones leave empty, N + n rows to a column.

    A Latin hypercube stays one where n is a multiple of N; otherwise two old points may share a row, and only the new
    ones are sure of theirs. Pairings are improved by swaps towards a larger smallest distance; with `feasible` swaps
    first lead into the constraints, and where no swap does the points are taken by :func:`extend`.
    """
    X = np.atleast_2d(np.asarray(existing, float))
    if n < 1 or X.size == 0 or X.min() < -1e-9 or X.max() > 1 + 1e-9:
        raise ValueError(f"extend: needs n >= 1 and existing points in the unit cube, got n = {n}, shape {X.shape}")
    rng, d, rows = np.random.default_rng(seed), X.shape[1], len(X) + n
    columns = []
    for j in range(d):
        taken = np.minimum((X[:, j] * rows).astype(int), rows - 1)
        empty = np.setdiff1d(np.arange(rows), taken)
        # More rows than needed are empty where old points share one: spread the choice.
        chosen = empty[np.unique(np.linspace(0, len(empty) - 1, n).round().astype(int))]
        columns.append((rng.permutation(chosen) + rng.random(n)) / rows)
    Y = np.stack(columns, axis=1)
    if feasible is not None:
        inside = swapped_inside(Y, feasible, rng)
        if inside is None:
            return extend(X, n, seed, feasible)
        Y = inside
    best = _nearest(Y, X)
    for _ in range(min(200 * n, 10_000) if d > 1 and n > 1 and rows <= MOST_OPTIMISED else 0):
        (a, b), j = rng.choice(n, 2, replace=False), int(rng.integers(d))
        Y[[a, b], j] = Y[[b, a], j]
        gap = _nearest(Y, X)
        if gap > best and (feasible is None or np.all(feasible(Y[[a, b]]))):
            best = gap
        else:
            Y[[a, b], j] = Y[[b, a], j]
    return Y


def swapped_inside(X: np.ndarray, feasible: Feasible, rng: np.random.Generator) -> np.ndarray | None:
    """X with entries swapped within columns so that every point is feasible, or None if that was not found."""
    X = X.copy()
    n, d = X.shape
    good = np.asarray(feasible(X), bool)
    for _ in range(20 * n if d > 1 else 1):
        bad = np.nonzero(~good)[0]
        if not len(bad):
            return X
        a, j = rng.choice(bad), rng.integers(d)
        mine, theirs = np.tile(X[a], (n, 1)), X.copy()
        mine[:, j], theirs[:, j] = X[:, j], X[a, j]
        now = np.asarray(feasible(np.vstack([mine, theirs])), bool).reshape(2, n)
        gain = now.sum(axis=0) - good - good[a]
        # A swap that changes nothing is a step too: without those the search gets stuck.
        b = rng.choice(np.nonzero(gain == max(gain.max(), 0))[0])
        X[[a, b], j] = X[[b, a], j]
        if a != b:
            good[a], good[b] = now[0, b], now[1, b]
    return None


def _nearest(Y: np.ndarray, X: np.ndarray) -> float:
    from scipy.spatial.distance import cdist, pdist

    apart = pdist(Y).min() if len(Y) > 1 else np.inf
    return float(min(apart, cdist(Y, X).min()))


def points(task: DesignTask) -> np.ndarray:
    """A Latin hypercube, spread out further where the option `optimise` says so."""
    runs, optimise = enough("lhs", task), task.options.get("optimise", True)
    if task.feasible is None:
        return latin(task.d, runs, task.seed, optimise)
    return latin_within(task.d, runs, task.seed, task.feasible, optimise)


def further(X: np.ndarray, n: int, task: DesignTask) -> np.ndarray:
    """n points in rows of cells that X (m, d) leaves empty."""
    return extend_latin(X, n, task.seed, task.feasible)


SAMPLER = Sampler("lhs", "Latin hypercube", points, further, free=True, options=("optimise",))
