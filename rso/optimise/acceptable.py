"""The acceptable set of a target: moving points onto it, and growing it to its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rso.optimise.nsga2 import Function

MAX_APPROACH_STEPS = 12  # of Gauss–Newton: what has not arrived by then stays where it got to
N_GROWTH_ROUNDS = 8  # in each of which points beyond the outermost ones are tried


@dataclass(frozen=True, eq=False)
class Goal:
    """{x in [low, high]: |r_j(x)| <= tolerance_j, violations(x) = 0}, with r = predicted − target (n, m)."""

    residuals: Function
    violations: Function | None
    tolerance: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def judge(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """r (n, m), score max_j |r_j|/tolerance_j (n,) and worst violation (n,), 0 where respected."""
        r = np.asarray(self.residuals(X), float).reshape(len(X), -1)
        return r, np.abs(r / self.tolerance).max(axis=1), self.violation(X).max(axis=1, initial=0.0)

    def violation(self, X: np.ndarray) -> np.ndarray:
        """Violations (n, k), none negative."""
        if self.violations is None:
            return np.zeros((len(X), 0))
        return np.maximum(np.asarray(self.violations(X), float).reshape(len(X), -1), 0.0)


def approach(X: np.ndarray, goal: Goal, aim: float) -> np.ndarray:
    """X moved by shortest damped Gauss–Newton steps until |r_j| <= aim·tolerance_j and nothing is violated.

    Points without a finite value are dropped; points that do not arrive stay where they got to.
    """
    scale = float(np.nanmax(goal.violation(X), initial=0.0)) or 1.0

    def excess(points: np.ndarray) -> np.ndarray:
        r = np.asarray(goal.residuals(points), float) / goal.tolerance
        # Violations count in units of the worst start, times a hundred tolerances; 5 % past the limit.
        return np.column_stack([r - np.clip(r, -aim, aim), goal.violation(points) / scale * 105.0])

    X = X[np.isfinite(excess(X)).all(axis=1)]
    g = excess(X)
    for _ in range(MAX_APPROACH_STEPS):
        moving = np.flatnonzero((g**2).sum(axis=1) > 1e-24)
        if not len(moving):
            break
        step = shortest_steps(X[moving], g[moving], excess, goal.low, goal.high)
        for damping in (1.0, 0.5, 0.25, 0.1):
            tries = np.clip(X[moving] + damping * step, goal.low, goal.high)
            after = excess(tries)
            better = (after**2).sum(axis=1) < (g[moving] ** 2).sum(axis=1)
            X[moving[better]], g[moving[better]] = tries[better], after[better]
            moving, step = moving[~better], step[~better]
            if not len(moving):
                break
    return X


def grow(X: np.ndarray, goal: Goal, aim: float, rng: np.random.Generator) -> np.ndarray:
    """Further points of the set beyond its outermost ones along each axis: thin ends escape any first sample."""
    found = [X]
    for _ in range(N_GROWTH_ROUNDS):
        X = np.vstack(found)
        _, score, violation = goal.judge(X)
        A = X[(score <= 1) & (violation <= 0)]
        if not len(A):
            break
        ends = A[np.concatenate([A.argmin(axis=0), A.argmax(axis=0)])]
        tries = np.repeat(ends, 24, axis=0)
        tries = tries + rng.normal(0, 0.05, tries.shape) * (goal.high - goal.low)
        found.append(approach(np.clip(tries, goal.low, goal.high), goal, aim))
    return np.vstack(found)


def shortest_steps(X: np.ndarray, g: np.ndarray, excess: Function, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Shortest Gauss–Newton steps (n, d), at most 0.3 long, that do not press against the faces of the box."""
    n, d = X.shape
    J = np.zeros((n, g.shape[1], d))
    for j in np.flatnonzero(high > low):
        e = 1e-5 * (high[j] - low[j])
        moved = X.copy()
        moved[:, j] += np.where(X[:, j] + e > high[j], -e, e)
        J[:, :, j] = (excess(moved) - g) / (moved[:, j] - X[:, j])[:, None]
    J = np.nan_to_num(J, posinf=0.0, neginf=0.0)
    step = np.zeros((n, d))
    blocked = np.zeros((n, d), bool)
    for _ in range(2):
        step = -np.einsum("njm,nm->nj", np.linalg.pinv(np.where(blocked[:, None, :], 0.0, J), rcond=1e-6), g)
        blocked |= ((X <= low) & (step < 0)) | ((X >= high) & (step > 0))
    step[blocked] = 0.0
    return step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / 0.3)
