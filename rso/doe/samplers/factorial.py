"""Full factorial designs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from rso.doe.farthest import extend_by
from rso.doe.sampler import DesignTask, Sampler


def factorial(d: int, runs: int | None = None, levels: Sequence[int] | None = None) -> np.ndarray:
    """Every combination of `levels[j]` equidistant values per parameter (both ends included).

    Without `levels`, `runs` must be a power L^d with L >= 2, otherwise ValueError names the nearest ones.
    """
    if levels is None:
        if runs is None:
            raise ValueError("design: factorial needs runs or levels")
        L = max(2, round(runs ** (1 / d)))
        if L**d != runs:
            near = sorted({max(2, L - 1) ** d, L**d, (L + 1) ** d})
            raise ValueError(f"design: factorial of {d} parameters has levels^{d} runs, not {runs}; try one of {near}")
        levels = (L,) * d
    if len(levels) != d or min(levels) < 2:
        raise ValueError(f"design: factorial needs {d} levels >= 2, got {list(levels)}")
    if runs is not None and runs != int(np.prod(levels)):
        raise ValueError(f"design: levels {list(levels)} give {int(np.prod(levels))} runs, not {runs}")
    return np.array(list(itertools.product(*(np.linspace(0, 1, L) for L in levels))))


def points(task: DesignTask) -> np.ndarray:
    """Every combination that is feasible; ValueError where fewer than two are."""
    X = factorial(task.d, task.runs, task.options.get("levels"))
    good = np.full(len(X), True) if task.feasible is None else np.asarray(task.feasible(X), bool)
    if good.sum() < 2:
        text = f"design: {np.sum(~good)} of the {len(X)} points of factorial violate the constraints; use lhs"
        raise ValueError(text)
    return X[good]


SAMPLER = Sampler("factorial", "factorial", points, extend_by, options=("levels",))
