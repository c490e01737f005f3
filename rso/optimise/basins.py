"""Where a function may have minima: the lowest of many points in their neighbourhood, each followed a little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from rso.doe import sobol_sequence

Score = Callable[[np.ndarray], np.ndarray]
LOG2_SCANNED_POINTS = 14  # log2 of the points looked at in four dimensions or more; fewer in fewer
MAX_BASIN_PARAMETERS = 8  # beyond, no sample sees what is narrow
SCORED_POINTS_PER_BLOCK = 2048  # points at a time: a surrogate needs memory for each
MAX_FOLLOWED_BASINS = 32  # basins that are followed
N_STEP_ROUNDS, TRIES_PER_ROUND = 8, 16  # of smaller and smaller random steps, and steps a round


def basins(score: Score, d: int, seed: int) -> np.ndarray:
    """Points (k, d) of the unit cube, k <= 32, lowest first, each from another basin of score(X) (n,).

    A point of a Sobol sample begins a basin where none of its 2d + 1 nearest neighbours is lower (Rinnooy Kan & Timmer,
    Math. Program. 39 (1987) 27, with a number of neighbours in place of their critical distance); the lowest of them
    then go down by random steps that shrink by half each round, from half the distance of the neighbours. With 2^14
    points an optimum is seen in four dimensions whose flanks reach 0.06 far. Values that are not finite count as high.
    Beyond eight parameters no sample sees what is narrow: no points then.
    """
    if d > MAX_BASIN_PARAMETERS:
        return np.empty((0, d))
    X = sobol_sequence(d, 2 ** min(LOG2_SCANNED_POINTS, 6 + 2 * d), seed)

    def finite(points: np.ndarray) -> np.ndarray:
        parts = [
            np.asarray(score(points[k : k + SCORED_POINTS_PER_BLOCK]), float)
            for k in range(0, len(points), SCORED_POINTS_PER_BLOCK)
        ]
        values = np.concatenate(parts)
        return np.where(np.isfinite(values), values, np.inf)

    value = finite(X)
    near, index = cKDTree(X).query(X, k=2 * d + 2)
    lowest = np.flatnonzero((value <= value[index[:, 1:]].min(axis=1)) & np.isfinite(value))
    lowest = lowest[np.argsort(value[lowest], kind="stable")][:MAX_FOLLOWED_BASINS]
    if not len(lowest):
        return np.empty((0, d))
    P, best, step = X[lowest], value[lowest], 0.5 * near[lowest, 1:].mean(axis=1)
    rng = np.random.default_rng([seed, 5])
    for _ in range(N_STEP_ROUNDS):
        moves = rng.standard_normal((len(P), TRIES_PER_ROUND, d)) * (step / np.sqrt(d))[:, None, None]
        tries = np.clip(P[:, None] + moves, 0.0, 1.0)
        found = finite(tries.reshape(-1, d)).reshape(len(P), TRIES_PER_ROUND)
        k = found.argmin(axis=1)
        rows = np.arange(len(P))
        better = found[rows, k] < best
        P[better], best[better] = tries[rows, k][better], found[rows, k][better]
        step = np.where(better, step, 0.5 * step)
    return P[np.argsort(best, kind="stable")]
