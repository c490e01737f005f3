"""The NSGA-II front of any vectorised objectives over a box inside the unit cube."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.doe import sobol_sequence
from rso.optimise.basins import basins

Function = Callable[[np.ndarray], np.ndarray]
WORST_OBJECTIVE = 1e30  # of a point without a finite value: worse than any violation


@dataclass(frozen=True, eq=False)
class Front:
    """Non-dominated points X (n, d) with objectives F (n, m), sorted by F.

    `feasible` is False if no point met the constraints: X is then the least violating one. `hypervolume`
    (generations,) is the share of the box between the best and the worst feasible objectives ever kept that
    the front dominates (0 while nothing is feasible): level at the end means converged.
    """

    X: np.ndarray
    F: np.ndarray
    feasible: bool
    hypervolume: np.ndarray
    evaluations: int


def nsga2(
    objectives: Function,
    d: int,
    *,
    seed: int,
    constraints: Function | None = None,
    population: int = 100,
    generations: int = 100,
    start: np.ndarray | None = None,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
) -> Front:
    """Minimise objectives(X) (n, m) over [low, high] in the unit cube with NSGA-II (Deb et al. 2002).

    A quarter of the first population are the basins of the sum of the objectives, each over its mean, and of its
    violations (:func:`~rso.optimise.basins.basins`): what is narrow no population finds by chance.
    `constraints(X)` (n, k) is positive where violated; `start` (k, d) enters the first population. Points with a value
    that is not finite count as infeasible. Same arguments, same bits.

    Raises
    ------
    ValueError
        for bounds that leave the cube or are crossed, or an odd or tiny population.
    """
    low, high, free = bounds(d, low, high)
    if population < 4 or population % 2 or generations < 1:
        raise ValueError(f"nsga2: needs an even population >= 4 and a generation, got {population}, {generations}")
    if not free.any():
        F, G = evaluated(low[None], objectives, constraints)
        return Front(low[None], F, bool(G.max() <= 0), np.zeros(1), 1)
    score = _one(objectives, constraints, into_box(sobol_sequence(int(free.sum()), 256, seed), low, high, free))
    narrow = basins(lambda U: score(into_box(U, low, high, free)), int(free.sum()), seed)[: population // 4]
    first = _start(d, population, seed, start, low, high, free, narrow)
    algorithm, problem = _algorithm(int(free.sum()), population, generations, seed, first)
    static, evaluator = pymoo_evaluation()
    history = []
    while algorithm.has_next():
        asked = algorithm.ask()
        F, G = evaluated(into_box(asked.get("X"), low, high, free), objectives, constraints)
        # Known once the first points are computed.
        problem.n_obj, problem.n_ieq_constr = F.shape[1], G.shape[1]
        evaluator.eval(static(problem, F=F, G=G), asked)
        algorithm.tell(infills=asked)
        kept = algorithm.opt
        history.append(kept.get("F")[kept.get("CV")[:, 0] <= 0])
    feasible = len(history[-1]) > 0
    X, F = into_box(algorithm.opt.get("X"), low, high, free), algorithm.opt.get("F")
    X, once = np.unique(X, axis=0, return_index=True)
    F = F[once]
    order = np.lexsort(F.T[::-1])
    return Front(X[order], F[order], feasible, hypervolumes(history), population * len(history))


def bounds(d: int, low: np.ndarray | None, high: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds (d,) with their defaults and the mask of the parameters that are free between them."""
    low = np.zeros(d) if low is None else np.asarray(low, float)
    high = np.ones(d) if high is None else np.asarray(high, float)
    if low.shape != (d,) or high.shape != (d,) or low.min() < 0 or high.max() > 1 or np.any(low > high):
        raise ValueError(f"search: needs 0 <= low <= high <= 1 for {d} parameters, got {low} and {high}")
    return low, high, high > low


def into_box(U: np.ndarray, low: np.ndarray, high: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Points of the box from points (n, free) of its own unit cube; fixed parameters stay fixed."""
    X = np.tile(low, (len(U), 1))
    X[:, free] = np.clip(low[free] + U * (high - low)[free], low[free], high[free])
    return X


def _one(objectives: Function, constraints: Function | None, X: np.ndarray) -> Function:
    """One number for each point: objectives over their mean size at X (n, d), and violations over theirs, added up."""
    F, G = evaluated(X, objectives, constraints)
    good = G[:, -1] == 0
    sizes = [np.abs(V[good]).mean(axis=0) if good.any() else np.ones(V.shape[1]) for V in (F, G[:, :-1])]
    a, b = (np.where(s > 0, s, 1.0) for s in sizes)

    def score(points: np.ndarray) -> np.ndarray:
        F, G = evaluated(points, objectives, constraints)
        # A violation counts more than any objective.
        total = (F / a).sum(axis=1) + 100 * (G[:, :-1] / b).sum(axis=1)
        return np.where(G[:, -1] > 0, np.inf, total)

    return score


def _start(
    d: int,
    population: int,
    seed: int,
    start: np.ndarray | None,
    low: np.ndarray,
    high: np.ndarray,
    free: np.ndarray,
    narrow: np.ndarray,
) -> np.ndarray:
    U = sobol_sequence(int(free.sum()), population, seed)
    U[len(U) - len(narrow) :] = narrow
    if start is not None:
        given = np.atleast_2d(np.asarray(start, float))
        if given.shape[1] != d:
            raise ValueError(f"nsga2: start needs shape (k, {d}), got {given.shape}")
        given = np.clip((given - low)[:, free] / (high - low)[free], 0, 1)[:population]
        U[: len(given)] = given
    return U


def evaluated(X: np.ndarray, objectives: Function, constraints: Function | None) -> tuple[np.ndarray, np.ndarray]:
    """Objectives (n, m) and violations (n, k + 1) at X, the last of those for what is no number."""
    F = np.asarray(objectives(X), float)
    F = F[:, None] if F.ndim == 1 else F
    G = np.zeros((len(X), 0)) if constraints is None else np.asarray(constraints(X), float).reshape(len(X), -1)
    bad = ~(np.isfinite(F).all(axis=1) & np.isfinite(G).all(axis=1))
    # pymoo sorts NaN without a word: such a point is infeasible, worse than any violation, never on a front.
    F, G = np.where(bad[:, None], WORST_OBJECTIVE, F), np.where(bad[:, None], WORST_OBJECTIVE, G)
    return F, np.column_stack([np.maximum(G, 0.0), np.where(bad, WORST_OBJECTIVE, 0.0)])


def _algorithm(d: int, population: int, generations: int, seed: int, start: np.ndarray) -> tuple[Any, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # pymoo still imports scipy.spatial.ckdtree
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
    problem = Problem(n_var=d, n_obj=1, n_ieq_constr=1, xl=np.zeros(d), xu=np.ones(d))
    algorithm = NSGA2(pop_size=population, sampling=start)
    algorithm.setup(problem, termination=("n_gen", generations), seed=int(seed), verbose=False)
    return algorithm, problem


def pymoo_evaluation() -> tuple[Any, Any]:
    """What hands pymoo values that were computed outside."""
    from pymoo.core.evaluator import Evaluator
    from pymoo.problems.static import StaticProblem

    return StaticProblem, Evaluator()


def hypervolumes(history: list[np.ndarray]) -> np.ndarray:
    """Hypervolume (generations,) of feasible objectives by generation, as :class:`Front` has it."""
    from pymoo.indicators.hv import Hypervolume

    kept = [F for F in history if len(F)]
    if not kept:
        return np.zeros(len(history))
    everything = np.vstack(kept)
    best, worst = everything.min(axis=0), everything.max(axis=0)
    size = np.where(worst > best, worst - best, 1.0)
    indicator = Hypervolume(ref_point=np.full(len(best), 1.1))
    return np.array([indicator((F - best) / size) / 1.1 ** len(best) if len(F) else 0.0 for F in history])
