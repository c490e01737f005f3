"""Optimal space filling: a Latin hypercube whose points were swapped apart."""

from __future__ import annotations

import numpy as np

from rso.doe.farthest import extend_by, farthest
from rso.doe.sampler import MAX_OPTIMISED_RUNS, DesignTask, Sampler, enough


def optimal_space_filling(d: int, runs: int, seed: int, sweeps: int = 60) -> np.ndarray:
    """Latin hypercube of cell centres (runs, d) whose points were swapped apart.

    Minimises φ = Σ_{i<j} |x_i − x_j|^(−p), p = 15 (Morris & Mitchell 1995, eq. 2 to the power p) by threshold
    accepting over swaps of two entries in one column, so that the design stays Latin.
    """
    from scipy.spatial.distance import pdist, squareform

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


def points(task: DesignTask) -> np.ndarray:
    """The design; inside constraints each point is as far as possible from all before."""
    runs = enough("osf", task, MAX_OPTIMISED_RUNS)
    if task.feasible is None:
        return optimal_space_filling(task.d, runs, task.seed)
    return farthest(np.empty((0, task.d)), runs, task.seed, task.feasible)


def _phi(D: np.ndarray, half_p: float) -> float:
    return float((D**-half_p).sum() / 2)


SAMPLER = Sampler("osf", "optimal space filling", points, extend_by, free=True)
