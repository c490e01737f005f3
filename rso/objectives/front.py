"""The front on response surfaces: NSGA-II, sharpened by gradients, and the points of it that are simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.doe import Space
from rso.emulation.feasibility import FeasibleRegion
from rso.objectives.plan import ParetoPlan
from rso.objectives.surfaces import Surfaces, nondominated
from rso.optimise.mixed import mixed_front
from rso.optimise.nsga2 import Front

SHARPENED_POINTS_PER_OBJECTIVE = 20  # points of a front, for each objective, that a gradient method improves
MAX_LEVEL_CHANGES = 20  # from one neighbour to the next better one
SAME_RUN_DISTANCE = 1e-3  # of the unit cube: points this near are one run


@dataclass(frozen=True, eq=False)
class PredictedFront:
    """Points U (n, d) of the cube with objectives F (n, m) to be minimised, and how the search went.

    `others` (k, d) are, of one objective, the best points at other levels, nearly as good first.
    """

    U: np.ndarray
    F: np.ndarray
    feasible: bool
    hypervolume: np.ndarray
    evaluations: int
    others: np.ndarray


@dataclass(frozen=True, eq=False)
class _Problem:
    """Objectives and violations on surfaces; limits are kept at a distance `margins`, runs are expected in `region`."""

    plan: ParetoPlan
    surfaces: Surfaces
    margins: Mapping[str, float]
    region: FeasibleRegion | None
    optimism: float = 0.0  # standard deviations by which everything may be better than it is predicted

    def objectives(self, U: np.ndarray) -> np.ndarray:
        means, sd = self._predicted(U)
        signs = [(o.quantity.text, o.sign) for o in self.plan.objectives]
        return np.stack([s * means[t] - self.optimism * sd[t] for t, s in signs], axis=1)

    def _predicted(self, U: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        if not self.optimism:
            return self.surfaces.means(U), dict.fromkeys(self.surfaces.each, 0.0)
        both = {t: s.predict(U) for t, s in self.surfaces.each.items()}
        return {t: b[0] for t, b in both.items()}, {t: b[1] for t, b in both.items()}

    def violations(self, U: np.ndarray) -> np.ndarray:
        """(n, k), positive where violated, limits over the spread of their quantity."""
        return -self.slack(U)

    def slack(self, U: np.ndarray) -> np.ndarray:
        """(n, k), negative where violated."""
        (means, sd), columns = self._predicted(U), []
        for c in self.plan.limits:
            y, size = means[c.quantity.text], self.surfaces.each[c.quantity.text].spread
            margin = self.margins.get(c.quantity.text, 0.0) - self.optimism * sd[c.quantity.text]
            columns += [(c.high - margin - y) / size] if np.isfinite(c.high) else []
            columns += [(y - c.low - margin) / size] if np.isfinite(c.low) else []
        found = np.stack(columns, axis=1) if columns else np.zeros((len(U), 0))
        found = np.column_stack([found, -self.plan.excess(self.plan.space.snapped(U))])
        if self.region is not None:
            seen = dict(zip(self.region.box.names, self.plan.space.features(U).T, strict=True))
            found = np.column_stack([found, -self.region.excess(seen)])
        return found


def search(
    plan: ParetoPlan,
    surfaces: Surfaces,
    *,
    seed: int,
    start: np.ndarray,
    margins: Mapping[str, float],
    region: FeasibleRegion | None,
    optimism: float = 0.0,
) -> PredictedFront:
    """The front on surfaces: NSGA-II from `start` (k, d), then SLSQP (Kraft 1988) on ranges at fixed levels.

    The ends of the front, and some points between, are improved in one objective at a time while the others stay at
    most what they are (ε-constraint method, Haimes et al. 1971).  With `optimism` k every quantity counts as k standard
    deviations better than it is predicted: what may still be found (lower confidence bound, Cox & John 1997).
    """
    problem, table = _Problem(plan, surfaces, margins, region, optimism), plan.study.search
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
        U = _sharpened(problem, U, F)
        F = problem.objectives(U)
        good = problem.slack(U).min(axis=1, initial=np.inf) >= -1e-9
        if good.any():
            U, F = U[good], F[good]
        keep = nondominated(F)
        U, F = U[keep], F[keep]
        _, once = np.unique(F.round(12), axis=0, return_index=True)
        U, F = U[once], F[once]
        order = np.lexsort(F.T[::-1])
        U, F = U[order], F[order]
    others = np.empty((0, plan.space.d))
    if F.shape[1] == 1 and not plan.space.continuous.all():
        best, *rest = _by_levels(problem, U[0])
        U, others = best[None], np.array(rest).reshape(-1, plan.space.d)
        F = problem.objectives(U)
    feasible = found.feasible or bool(problem.slack(U).min(initial=np.inf) >= -1e-9)
    return PredictedFront(U, F, feasible, found.hypervolume, found.evaluations, others)


def _by_levels(problem: _Problem, u: np.ndarray) -> list[np.ndarray]:
    """The best points at different levels, from one point (d,) by changing one level at a time while that helps.

    At each set of levels the ranges are improved by SLSQP.
    """
    space = problem.plan.space
    known: dict[tuple[int, ...], tuple[bool, float, np.ndarray]] = {}

    def rated(point: np.ndarray) -> tuple[bool, float, np.ndarray]:
        key = tuple(space.places(point[None])[0])
        if key not in known:
            f = problem.objectives(point[None])[0]
            found = _improved(problem, point, f, 0, False) if space.continuous.any() else point
            lacking = bool(problem.slack(found[None]).min(initial=np.inf) < -1e-9)
            known[key] = (lacking, float(problem.objectives(found[None])[0, 0]), found)
        return known[key]

    best = rated(u)
    for _ in range(MAX_LEVEL_CHANGES):
        around = [rated(v) for v in _neighbours(space, best[2])]
        now = min([best, *around], key=lambda r: r[:2])
        if now is best:
            break
        best = now
    return [r[2] for r in sorted(known.values(), key=lambda r: r[:2])]


def _neighbours(space: Space, u: np.ndarray) -> list[np.ndarray]:
    """Points that differ in one level: the next ones of an order, any other text of a category."""
    at, found = space.places(u[None])[0], []
    for j, levels in enumerate(space.levels):
        every = range(len(levels)) if space.labels[j] else (at[j] - 1, at[j] + 1)
        for k in every:
            if levels and 0 <= k < len(levels) and k != at[j]:
                point = u.copy()
                point[j] = (k + 0.5) / len(levels)
                found.append(point)
    return found


def _sharpened(problem: _Problem, U: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Points of a front, at most as many as are SHARPENED_POINTS_PER_OBJECTIVE for each objective, each improved in one
    objective.

    The ends are improved in their own; an end that is the least of one objective is then the best in the next.
    """
    m = F.shape[1]
    found = []
    for k in range(m):
        row = int(F[:, k].argmin())
        end = _improved(problem, U[row], F[row], k, False)
        if m > 1:
            end = _improved(problem, end, problem.objectives(end[None])[0], (k + 1) % m, True)
        found.append(end)
    if m > 1:
        rows = np.unique(np.linspace(0, len(U) - 1, SHARPENED_POINTS_PER_OBJECTIVE * m).round().astype(int))
        found += [_improved(problem, U[r], F[r], i % m, True) for i, r in enumerate(rows)]
    return np.array(found)


def _improved(problem: _Problem, u: np.ndarray, f: np.ndarray, k: int, held: bool) -> np.ndarray:
    """SLSQP on the ranges from one point u (d,) in objective k, the others `held`; u itself where nothing is better."""
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
    except ValueError:
        return u
    if not np.isfinite(found.x).all():
        return u
    better = problem.objectives(whole(found.x))[0, k] < f[k]
    before, after = (slack(x).min(initial=0.0) for x in (u[free], found.x))
    return whole(found.x)[0] if (better and after >= -1e-9) or after > before else u


def representative_rows(F: np.ndarray, count: int) -> list[int]:
    """Rows of a front (n, m) that stand for it, by objectives: its ends, its knee, those farthest from all chosen.

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
        if gap.max() < SAME_RUN_DISTANCE:
            break
        picked.append(int(gap.argmax()))
    return sorted(picked, key=lambda k: tuple(F[k]))


def knee(F: np.ndarray) -> int:
    """Row of the point of a front (n, m) that is nearest to the ideal one, objectives scaled to their ranges."""
    low, high = F.min(axis=0), F.max(axis=0)
    return int(np.linalg.norm((F - low) / np.where(high > low, high - low, 1.0), axis=1).argmin())
