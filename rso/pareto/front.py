"""The front on response surfaces: NSGA-II, sharpened by gradients, and the points of it that are simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.optimise.mixed import mixed_front
from rso.optimise.nsga2 import Front
from rso.pareto.plan import ParetoPlan
from rso.pareto.surfaces import Surfaces, nondominated

SHARPENED = 24  # points of a front that a gradient method improves
NEAR = 1e-3  # of the unit cube: points this near are one run
FAILING = 0.05  # of the unit cube: how far around a run without an answer nothing is sought


@dataclass(frozen=True, eq=False)
class PredictedFront:
    """Points U (n, d) of the cube with objectives F (n, m) to be minimised, and how the search went."""

    U: np.ndarray
    F: np.ndarray
    feasible: bool
    hypervolume: np.ndarray
    evaluations: int


@dataclass(frozen=True, eq=False)
class _Problem:
    """Objectives and violations on surfaces; limits are kept at a distance `margins`, failed runs `lost` (k, d) too."""

    plan: ParetoPlan
    surfaces: Surfaces
    margins: Mapping[str, float]
    lost: np.ndarray

    def objectives(self, U: np.ndarray) -> np.ndarray:
        means = self.surfaces.means(U)
        return np.stack([o.sign * means[o.quantity.text] for o in self.plan.objectives], axis=1)

    def violations(self, U: np.ndarray) -> np.ndarray:
        """(n, k), positive where violated, limits over the spread of their quantity."""
        return -self.slack(U)

    def slack(self, U: np.ndarray) -> np.ndarray:
        """(n, k), negative where violated."""
        means, columns = self.surfaces.means(U), []
        for c in self.plan.limits:
            y, size = means[c.quantity.text], self.surfaces.each[c.quantity.text].spread
            margin = self.margins.get(c.quantity.text, 0.0)
            columns += [(c.high - margin - y) / size] if np.isfinite(c.high) else []
            columns += [(y - c.low - margin) / size] if np.isfinite(c.low) else []
        found = np.stack(columns, axis=1) if columns else np.zeros((len(U), 0))
        found = np.column_stack([found, -self.plan.excess(self.plan.space.snapped(U))])
        if len(self.lost):
            near = np.abs(U[:, None] - self.lost[None]).max(axis=2).min(axis=1)
            found = np.column_stack([found, near - FAILING])
        return found


def search(
    plan: ParetoPlan,
    surfaces: Surfaces,
    *,
    seed: int,
    start: np.ndarray,
    margins: Mapping[str, float],
    lost: np.ndarray,
) -> PredictedFront:
    """The front on surfaces: NSGA-II from `start` (k, d), then SLSQP (Kraft 1988) on ranges at fixed levels.

    The ends of the front, and some points between, are improved in one objective at a time while the others stay at
    most what they are (ε-constraint method, Haimes et al. 1971).
    """
    problem, table = _Problem(plan, surfaces, margins, lost), plan.study.search
    constrained = problem.slack(plan.space.snapped(np.full((1, plan.space.d), 0.5))).shape[1] > 0
    found: Front = mixed_front(
        problem.objectives,
        plan.space,
        seed=seed,
        constraints=problem.violations if constrained else None,
        population=table.population,
        generations=table.generations,
        start=start,
    )
    U, F = found.X, found.F
    if plan.space.continuous.any():
        U = np.vstack([U, *_sharpened(problem, U, F)])
        F = problem.objectives(U)
        good = problem.slack(U).min(axis=1, initial=np.inf) >= -1e-9 if constrained else np.ones(len(U), bool)
        if good.any():
            U, F = U[good], F[good]
        keep = nondominated(F)
        U, F = U[keep], F[keep]
        order = np.lexsort(F.T[::-1])
        U, F = U[order], F[order]
    feasible = found.feasible or bool(problem.slack(U).min(initial=np.inf) >= -1e-9)
    return PredictedFront(U, F, feasible, found.hypervolume, found.evaluations)


def _sharpened(problem: _Problem, U: np.ndarray, F: np.ndarray) -> list[np.ndarray]:
    """Points (1, d) that improve one objective of points of a front, the others held."""
    m = F.shape[1]
    starts = [(int(F[:, k].argmin()), k, False) for k in range(m)]
    if m > 1:
        rows = np.unique(np.linspace(0, len(U) - 1, SHARPENED).round().astype(int))
        starts += [(int(r), i % m, True) for i, r in enumerate(rows)]
    return [p for row, k, held in starts if (p := _improved(problem, U[row], F[row], k, held)) is not None]


def _improved(problem: _Problem, u: np.ndarray, f: np.ndarray, k: int, held: bool) -> np.ndarray | None:
    """SLSQP on the ranges from one point; None where it finds nothing better."""
    from scipy.optimize import minimize

    free = problem.plan.space.continuous
    sizes = [max(problem.surfaces.each[o.quantity.text].spread, 1e-300) for o in problem.plan.objectives]
    others = [j for j in range(len(f)) if j != k]

    def whole(x: np.ndarray) -> np.ndarray:
        point = u.copy()
        point[free] = np.clip(x, 0.0, 1.0)
        return point[None]

    def slack(x: np.ndarray) -> np.ndarray:
        point = whole(x)
        own = problem.slack(point)[0]
        if held and others:
            F = problem.objectives(point)[0]
            own = np.append(own, [(f[j] - F[j]) / sizes[j] for j in others])
        return own

    constraints = [{"type": "ineq", "fun": slack}] if len(slack(u[free])) else []
    try:
        found = minimize(
            lambda x: problem.objectives(whole(x))[0, k] / sizes[k],
            u[free],
            method="SLSQP",
            bounds=[(0.0, 1.0)] * int(free.sum()),
            constraints=constraints,
            options={"maxiter": 60, "ftol": 1e-10},
        )
    except (ValueError, np.linalg.LinAlgError):
        return None
    return whole(found.x) if np.isfinite(found.x).all() else None


def chosen(F: np.ndarray, count: int) -> list[int]:
    """Rows of a front (n, m) that stand for it: its ends, its knee, then those farthest from all chosen.

    The knee is the point nearest to the ideal one, with each objective scaled to its range on the front.
    """
    low, high = F.min(axis=0), F.max(axis=0)
    S = (F - low) / np.where(high > low, high - low, 1.0)
    picked = list(dict.fromkeys(int(k) for k in F.argmin(axis=0)))
    if F.shape[1] > 1:
        picked.insert(0, knee(F))
    picked = list(dict.fromkeys(picked))[:count]
    while len(picked) < min(count, len(F)):
        gap = np.linalg.norm(S[:, None] - S[picked][None], axis=2).min(axis=1)
        if gap.max() < NEAR:
            break
        picked.append(int(gap.argmax()))
    return picked


def knee(F: np.ndarray) -> int:
    """Row of the point of a front (n, m) that is nearest to the ideal one, objectives scaled to their ranges."""
    low, high = F.min(axis=0), F.max(axis=0)
    return int(np.linalg.norm((F - low) / np.where(high > low, high - low, 1.0), axis=1).argmin())
