"""Sobol sequences."""

from __future__ import annotations

import numpy as np

from rso.doe.farthest import pool
from rso.doe.sampler import DesignTask, Sampler, enough
from rso.doe.sequences import sobol_sequence


def points(task: DesignTask) -> np.ndarray:
    """The first `runs` points of a scrambled Sobol sequence, without those that are forbidden."""
    runs = enough("sobol", task)
    if task.feasible is None:
        return sobol_sequence(task.d, runs, task.seed)
    return pool(task.d, runs, task.seed, task.feasible)[:runs]


def further(X: np.ndarray, n: int, task: DesignTask) -> np.ndarray:
    """The next n points of the sequence whose beginning X (m, d) is; ValueError where it is not."""
    N, d = np.shape(X)
    more = points(DesignTask(d, N + n, task.seed, {}, task.feasible))
    if not np.array_equal(more[:N], X):
        raise ValueError("extend: the existing points are not the beginning of this Sobol sequence")
    return more[N:]


SAMPLER = Sampler("sobol", "Sobol", points, further, free=True)
