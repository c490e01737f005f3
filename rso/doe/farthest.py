"""Points as far as possible from all others, in the unit cube or the feasible part of it."""

from __future__ import annotations

import numpy as np

from rso.doe.sampler import DesignTask, Feasible
from rso.doe.sequences import sobol_sequence

N_POOL_POINTS = 4096  # points of a Sobol sequence among which the farthest is sought first


def extend(existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d), each as far as possible from all others: max over x of min_i |x − x_i|.

    Greedy over a Sobol sample of the (feasible) cube, each pick polished by a shrinking random search; deterministic.
    """
    X = np.atleast_2d(np.asarray(existing, float))
    if n < 1 or X.size == 0 or X.min() < -1e-9 or X.max() > 1 + 1e-9:
        raise ValueError(f"extend: needs n >= 1 and existing points in the unit cube, got n = {n}, shape {X.shape}")
    return farthest(X, n, seed, feasible)


def extend_by(X: np.ndarray, n: int, task: DesignTask) -> np.ndarray:
    """The same as a sampler asks for it."""
    return extend(X, n, task.seed, task.feasible)


def pool(d: int, n: int, seed: int, feasible: Feasible | None) -> np.ndarray:
    """At least n points of a Sobol sequence that are feasible, in its order."""
    for m in range(max(1, int(np.ceil(np.log2(n)))), 21):
        points = sobol_sequence(d, 2**m, seed)
        points = points if feasible is None else points[np.asarray(feasible(points), bool)]
        if len(points) >= n:
            return points
        if 2**m >= 100 * n and len(points) < 0.01 * 2**m:
            break
    raise ValueError(f"design: the constraints leave less than 1 % of the ranges; no {n} points were found in them")


def farthest(X: np.ndarray, n: int, seed: int, feasible: Feasible | None) -> np.ndarray:
    """n points (n, d), each as far as possible from X (m, d) and from those before; X may be empty, (0, d)."""
    from scipy.spatial.distance import cdist

    d, before = X.shape[1], len(X)
    rng = np.random.default_rng(seed)
    points = pool(d, max(n, N_POOL_POINTS if feasible is None else N_POOL_POINTS // 8), seed, feasible)
    for _ in range(n):
        if not len(X):
            X = points[[np.abs(points - points.mean(axis=0)).sum(axis=1).argmin()]]
            continue
        gap = cdist(points, X).min(axis=1)
        x, best = points[gap.argmax()], gap.max()
        for radius in 0.1 * 0.7 ** np.arange(25):
            tries = np.clip(x + radius * rng.uniform(-1, 1, (64, d)), 0, 1)
            gap = cdist(tries, X).min(axis=1)
            if feasible is not None:
                gap = np.where(feasible(tries), gap, -1.0)
            if gap.max() > best:
                x, best = tries[gap.argmax()], gap.max()
        X = np.vstack([X, x])
    return X[before:]
