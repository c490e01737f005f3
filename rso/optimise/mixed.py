"""The NSGA-II front over ranges, whole numbers, lists of values and categories together."""

from __future__ import annotations

import warnings

import numpy as np

from rso.doe import Space, sobol_sequence
from rso.optimise.nsga2 import Front, Function, evaluated, hypervolumes, nsga2, pymoo_evaluation


def mixed_front(
    objectives: Function,
    space: Space,
    *,
    seed: int,
    constraints: Function | None = None,
    population: int = 100,
    generations: int = 100,
    start: np.ndarray | None = None,
) -> Front:
    """Minimise objectives(U) (n, m) over a space with NSGA-II (Deb et al. 2002), operators by kind of variable.

    Ranges are crossed and mutated as real numbers, whole numbers and lists by their place in the list, categories by
    exchange and redraw (pymoo's mixed-variable mating); a space of ranges alone goes to
    :func:`~rso.optimise.nsga2.nsga2`.
    `constraints(U)` (n, k) is positive where violated.  Same arguments, same bits.
    """
    if space.continuous.all():
        return nsga2(
            objectives, space.d, seed=seed, constraints=constraints, population=population, generations=generations,
            start=start,
        )  # fmt: skip
    first = space.snapped(sobol_sequence(space.d, population, seed))
    if start is not None and len(start):
        first[: len(start)] = space.snapped(np.asarray(start, float)[:population])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # pymoo still imports scipy.spatial.ckdtree
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.mixed import MixedVariableDuplicateElimination, MixedVariableMating
        from pymoo.core.population import Population
        from pymoo.core.problem import Problem
        from pymoo.core.variable import Choice, Integer, Real
    kinds = {}
    for j, (levels, labels) in enumerate(zip(space.levels, space.labels, strict=True)):
        last = len(levels) - 1
        kinds[f"{j}"] = (
            Real(bounds=(0.0, 1.0)) if not levels
            else Choice(options=list(range(len(levels)))) if labels else Integer(bounds=(0, last))
        )  # fmt: skip
    apart = MixedVariableDuplicateElimination()
    algorithm = NSGA2(
        pop_size=population,
        sampling=Population.new(X=_apart(space, first)),
        mating=MixedVariableMating(eliminate_duplicates=apart),
        eliminate_duplicates=apart,
    )
    problem = Problem(vars=kinds, n_obj=1, n_ieq_constr=1)
    algorithm.setup(problem, termination=("n_gen", generations), seed=int(seed), verbose=False)
    static, evaluator = pymoo_evaluation()
    history: list[np.ndarray] = []
    evaluations = 0
    while algorithm.has_next():
        asked = algorithm.ask()
        if asked is None or not len(asked):  # every point of a small space has been a parent
            break
        F, G = evaluated(_points(space, asked.get("X")), objectives, constraints)
        problem.n_obj, problem.n_ieq_constr = F.shape[1], G.shape[1]
        evaluator.eval(static(problem, F=F, G=G), asked)
        algorithm.tell(infills=asked)
        evaluations += len(F)
        kept = algorithm.opt
        history.append(kept.get("F")[kept.get("CV")[:, 0] <= 0])
    U, F = _points(space, algorithm.opt.get("X")), algorithm.opt.get("F")
    U, once = np.unique(U, axis=0, return_index=True)
    F = F[once]
    order = np.lexsort(F.T[::-1])
    return Front(U[order], F[order], len(history[-1]) > 0, hypervolumes(history), evaluations)


def _apart(space: Space, U: np.ndarray) -> np.ndarray:
    """Points as pymoo has mixed variables: a table for each, ranges as numbers, levels by their place."""
    at, ranges = space.places(U), space.continuous
    rows = [
        {f"{j}": float(u[j]) if ranges[j] else int(p[j]) for j in range(space.d)} for u, p in zip(U, at, strict=True)
    ]
    return np.array(rows, dtype=object)


def _points(space: Space, rows: np.ndarray) -> np.ndarray:
    """The points (n, d) of the cube of such tables."""
    counts = [len(v) for v in space.levels]
    return np.array(
        [[row[f"{j}"] if not n else (row[f"{j}"] + 0.5) / n for j, n in enumerate(counts)] for row in rows], float
    ).reshape(-1, space.d)
