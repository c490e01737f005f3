"""Space-filling designs: Latin hypercubes, Sobol, optimal space filling; inside constraints; extension."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.distance import cdist, pdist, squareform

MOST_OPTIMISED = 1000  # runs up to which a design is optimised, within about a second
POOL = 4096
Feasible = Callable[[np.ndarray], np.ndarray]


def latin(d: int, runs: int, seed: int, optimise: bool = True) -> np.ndarray:
    """Latin hypercube (runs, d): one point per row of cells; `optimise` swaps for low centred discrepancy."""
    from scipy.stats import qmc  # half a second to import

    # Never scipy's 'lloyd': it moves the points off their cells and took minutes at n = 120, d = 10.
    # Its own optimiser takes n² time; so many points fill the cube without it.
    method = "random-cd" if optimise and d > 1 and runs <= MOST_OPTIMISED else None
    return qmc.LatinHypercube(d, optimization=method, rng=np.random.default_rng(seed)).random(runs)


def sobol(d: int, runs: int, seed: int | Sequence[int]) -> np.ndarray:
    """First `runs` points of a scrambled Sobol sequence (runs, d); balanced where runs is a power of two."""
    from scipy.stats import qmc  # half a second to import

    m = max(1, int(np.ceil(np.log2(runs))))
    return qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random_base2(m)[:runs]


def optimal_space_filling(d: int, runs: int, seed: int, sweeps: int = 60) -> np.ndarray:
    """Latin hypercube of cell centres (runs, d) whose points were swapped apart.

    Minimises φ = Σ_{i<j} |x_i − x_j|^(−p), p = 15 (Morris & Mitchell 1995, eq. 2 to the power p) by threshold
    accepting over swaps of two entries in one column, so that the design stays Latin.
    """
    rng = np.random.default_rng(seed)
    X = (np.column_stack([rng.permutation(runs) for _ in range(d)]) + 0.5) / runs
    if d == 1 or runs < 3:
        return X
    half_p = 7.5
    D = squareform(pdist(X, "sqeuclidean"))
    np.fill_diagonal(D, np.inf)
    steps = min(sweeps * runs * d, 40_000)
    best, best_phi = X.copy(), _phi(D, half_p)
    now = best_phi
    for step in range(steps):
        j = rng.integers(d)
        a, b = rng.choice(runs, 2, replace=False)
        new_a = D[a] + (X[b, j] - X[:, j]) ** 2 - (X[a, j] - X[:, j]) ** 2
        new_b = D[b] + (X[a, j] - X[:, j]) ** 2 - (X[b, j] - X[:, j]) ** 2
        new_a[[a, b]], new_b[[a, b]] = (np.inf, D[a, b]), (D[a, b], np.inf)
        after = now + (new_a**-half_p + new_b**-half_p - D[a] ** -half_p - D[b] ** -half_p).sum()
        # A worse design is tolerated less and less: p = 15 makes 0.1 in log φ a change of < 1 % in distance.
        if after < now * (1 + 0.1 * (1 - step / steps) ** 2):
            X[[a, b], j] = X[[b, a], j]
            D[a], D[b], D[:, a], D[:, b] = new_a, new_b, new_a, new_b
            now = after
            if now < best_phi:
                best, best_phi = X.copy(), now
    return best


def extend(existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d), each as far as possible from all others: max over x of min_i |x − x_i|.

    Greedy over a Sobol sample of the (feasible) cube, each pick polished by a shrinking random search; deterministic.
    """
    X = np.atleast_2d(np.asarray(existing, float))
    if n < 1 or X.size == 0 or X.min() < -1e-9 or X.max() > 1 + 1e-9:
        raise ValueError(f"extend: needs n >= 1 and existing points in the unit cube, got n = {n}, shape {X.shape}")
    return _farthest(X, n, seed, feasible)


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
        inside = _swapped_inside(Y, feasible, rng)
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


def within(kind: str, d: int, runs: int, seed: int, feasible: Feasible, optimise: bool = True) -> np.ndarray:
    """A space-filling design (runs, d) of the feasible part of the cube; ValueError where that is below 1 %.

    sobol: the sequence without the points that are forbidden. osf: each point as far as possible from all before.
    lhs: swaps of entries in a column until no point is forbidden, which stays Latin (after Petelet et al., J. Stat.
    Plan. Inference 140 (2010) 2863); a constraint that no Latin hypercube meets (x1 + x2 < 1 has the wrong means)
    gives the osf design instead.
    """
    if kind == "lhs":
        X = latin(d, runs, seed, optimise)
        inside = _swapped_inside(X, feasible, np.random.default_rng(seed))
        if inside is not None:
            return inside
    if kind == "sobol":
        return _pool(d, runs, seed, feasible)[:runs]
    return _farthest(np.empty((0, d)), runs, seed, feasible)


def _swapped_inside(X: np.ndarray, feasible: Feasible, rng: np.random.Generator) -> np.ndarray | None:
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


def _pool(d: int, n: int, seed: int, feasible: Feasible | None) -> np.ndarray:
    """At least n points of a Sobol sequence that are feasible, in its order."""
    for m in range(max(1, int(np.ceil(np.log2(n)))), 21):
        points = sobol(d, 2**m, seed)
        points = points if feasible is None else points[np.asarray(feasible(points), bool)]
        if len(points) >= n:
            return points
        if 2**m >= 100 * n and len(points) < 0.01 * 2**m:
            break
    raise ValueError(f"design: the constraints leave less than 1 % of the ranges; no {n} points were found in them")


def _farthest(X: np.ndarray, n: int, seed: int, feasible: Feasible | None) -> np.ndarray:
    d, before = X.shape[1], len(X)
    rng = np.random.default_rng(seed)
    pool = _pool(d, max(n, POOL if feasible is None else POOL // 8), seed, feasible)
    for _ in range(n):
        if not len(X):
            X = pool[[np.abs(pool - pool.mean(axis=0)).sum(axis=1).argmin()]]
            continue
        gap = cdist(pool, X).min(axis=1)
        x, best = pool[gap.argmax()], gap.max()
        for radius in 0.1 * 0.7 ** np.arange(25):
            tries = np.clip(x + radius * rng.uniform(-1, 1, (64, d)), 0, 1)
            gap = cdist(tries, X).min(axis=1)
            if feasible is not None:
                gap = np.where(feasible(tries), gap, -1.0)
            if gap.max() > best:
                x, best = tries[gap.argmax()], gap.max()
        X = np.vstack([X, x])
    return X[before:]


def _nearest(Y: np.ndarray, X: np.ndarray) -> float:
    apart = pdist(Y).min() if len(Y) > 1 else np.inf
    return float(min(apart, cdist(Y, X).min()))


def _phi(D: np.ndarray, half_p: float) -> float:
    return float((D**-half_p).sum() / 2)
