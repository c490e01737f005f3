"""Least misfit: Gauss–Newton with bounds for models that cost, many starts at once for emulators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from rso.doe import sobol_sequence
from rso.inference.likelihood import DIFFERENCE_STEP, Misfit

PARAMETER_BOUND_TOLERANCE = 1e-6  # of the unit cube: a parameter this close to a bound is on it
SAME_MINIMUM_TOLERANCE = 0.02  # of the unit cube: minima closer than this are one
N_DESCENT_SCAN_POINTS = 512  # points of the box among which descents begin
COARSE_CHI2_TOLERANCE = 1e-5  # of χ²: where descents may rest before it is known which of them matter
# of the unit cube; steps from which a slope is read at most, and how often they are chosen
MAX_SLOPE_STEP, N_SLOPE_STEP_ROUNDS = 0.05, 3
MAX_TANGENT_ERROR = 0.2  # of √χ²: what a tangent may be off by over a standard deviation
VALLEY_PASS_CHI2 = 0.1  # of χ²: minima with a lower pass between them are one valley


@dataclass(frozen=True, eq=False)
class Fit:
    """A least misfit: x and θ (d,), χ², whitened residual (n + w,), behind the data what is beyond a
    wall, and Jacobian (n, d) of the data in the unit cube.

    `at_bound` names the parameters that stopped there, `evaluations` counts evaluated points (with derivatives one).
    """

    x: np.ndarray
    theta: np.ndarray
    chi2: float
    residual: np.ndarray
    jacobian: np.ndarray
    at_bound: tuple[str, ...]
    evaluations: int
    converged: bool

    @property
    def fisher(self) -> np.ndarray:
        """JᵀJ (d, d), the Fisher information in the unit cube."""
        return self.jacobian.T @ self.jacobian


def gauss_newton(misfit: Misfit, start: np.ndarray, *, tolerance: float = 1e-10, most: int = 60) -> Fit:
    """Least misfit from one start x (d,) by a trust-region Gauss–Newton method that respects the bounds.

    Source: Branch, Coleman & Li, SIAM J. Sci. Comput. 21 (1999) 1, as scipy.optimize.least_squares.  Each iteration
    costs one value and one Jacobian; with a backend's own derivatives that is one run.
    """
    x0 = np.clip(np.asarray(start, float), PARAMETER_BOUND_TOLERANCE, 1 - PARAMETER_BOUND_TOLERANCE)
    found = least_squares(
        lambda x: misfit.residuals(x[None])[0],
        x0,
        jac=misfit.jacobian,
        bounds=(0.0, 1.0),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=most,
    )
    return fit_at(misfit, found.x, int(found.nfev), bool(found.status > 0))


def fit_at(misfit: Misfit, x: np.ndarray, evaluations: int = 0, converged: bool = True) -> Fit:
    """What the misfit is at x (d,)."""
    # An interior method stops short of a bound; on it the misfit is as good.
    x = (
        np.where(x < 1e3 * PARAMETER_BOUND_TOLERANCE, 0.0, np.where(x > 1 - 1e3 * PARAMETER_BOUND_TOLERANCE, 1.0, x))
        if np.any(_near(x))
        else x
    )
    r, box = misfit.residuals(x[None])[0], misfit.model.box
    J = slopes(misfit, x)  # of the data: a wall tells nothing of the parameters
    bound = tuple(
        n
        for n, v in zip(box.names, x, strict=True)
        if v <= PARAMETER_BOUND_TOLERANCE or v >= 1 - PARAMETER_BOUND_TOLERANCE
    )
    return Fit(x, box.from_unit(x), float(r @ r), r, J, bound, evaluations, converged)


def slopes(misfit: Misfit, x: np.ndarray) -> np.ndarray:
    """∂r/∂x (n, d) of the data at x (d,): tangents, or secants where tangents do not hold over a standard deviation.

        |J_tangent − J_secant| σ > `MAX_TANGENT_ERROR`,        J_secant over ±σ, `MAX_SLOPE_STEP` of the unit cube at
        most

    A surrogate repeats the scatter of the runs that it was made of (1e-4 of a force): over the distance of two runs
    that is a slope, and none of the body.  The information that counts is that over the width of the interval
    (as in MINUIT's HESSE: James & Roos, Comput. Phys. Commun. 10 (1975) 343, §4).
    """
    tangent = misfit.white(misfit.model.jacobian(x).T).T
    if misfit.model.derivative is not None:
        return tangent
    J = tangent
    for _ in range(N_SLOPE_STEP_ROUNDS):
        _, s, Vt = np.linalg.svd(np.vstack([J, np.eye(len(x)) / MAX_SLOPE_STEP]), full_matrices=False)
        σ = np.sqrt(np.sum((Vt / s[:, None]) ** 2, axis=0))  # also of a JᵀJ singular to round-off
        J = misfit.white(misfit.model.jacobians(x[None], step=np.maximum(σ, DIFFERENCE_STEP))[0].T).T
    off = np.linalg.norm(tangent - J, axis=0) * σ
    return np.where(off > MAX_TANGENT_ERROR, J, tangent)


def _near(x: np.ndarray) -> np.ndarray:
    return (x < 1e3 * PARAMETER_BOUND_TOLERANCE) | (x > 1 - 1e3 * PARAMETER_BOUND_TOLERANCE)


def levenberg_marquardt(
    misfit: Misfit, X: np.ndarray, free: np.ndarray | None = None, *, tolerance: float = 1e-9, steps: int = 80
) -> np.ndarray:
    """Levenberg–Marquardt from many starts X (k, d) at once, along the `free` (d,) axes; where they got to (k, d).

        (JᵀJ + λ diag JᵀJ) Δx = −Jᵀr,   λ up where χ² does not fall, down where it does

    A start rests when χ² falls by less than the share `tolerance` in a step.  Axes on a bound that the step presses
    against are held.  One call of the model serves all starts.
    Source: Marquardt, J. SIAM 11 (1963) 431, eq. 6 and 13.
    """
    X = np.clip(np.array(X, float), 0.0, 1.0)
    free = np.ones(X.shape[1], bool) if free is None else np.asarray(free, bool)
    axes = np.flatnonzero(free)
    if not len(axes):
        return X
    r = misfit.residuals(X)
    S, λ = np.sum(r**2, axis=1), np.full(len(X), 1e-3)
    active = np.isfinite(S)
    for _ in range(steps):
        k = np.flatnonzero(active)
        if not len(k):
            break
        J = misfit.jacobians(X[k], free)
        step = damped(J, r[k], λ[k], X[k][:, axes])
        tries = X[k].copy()
        tries[:, axes] = np.clip(tries[:, axes] + step, 0.0, 1.0)
        moved = np.abs(tries - X[k]).max(axis=1)
        after = misfit.residuals(tries)
        new = np.sum(after**2, axis=1)
        better = new < S[k]
        gain = S[k] - new
        done = (moved < 1e-8) | (better & (gain < tolerance * S[k]) & (λ[k] < 1e-2)) | (λ[k] > 1e8)
        b = k[better]
        X[b], r[b], S[b] = tries[better], after[better], new[better]
        λ[k] = np.where(better, np.maximum(λ[k] * 0.2, 1e-10), λ[k] * 5)
        active[k[done]] = False
    return X


def damped(J: np.ndarray, r: np.ndarray, λ: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Steps −(JᵀJ + λ diag JᵀJ)⁻¹ Jᵀr (k, f) from x (k, f), with the axes that press against a bound held."""
    g = np.einsum("knf,kn->kf", J, r)
    H = np.einsum("knf,kng->kfg", J, J)
    f = g.shape[1]
    diagonal = np.einsum("kff->kf", H)
    floor = 1e-12 * (diagonal.max(axis=1, keepdims=True) + 1e-300)
    H = H + np.eye(f) * (λ[:, None] * diagonal + floor)[:, None, :]
    held = np.zeros_like(x, bool)
    for _ in range(f + 1):
        A = np.where(held[:, :, None] | held[:, None, :], 0.0, H) + np.eye(f) * np.where(held, 1.0, 0.0)[:, None, :]
        step = -np.linalg.solve(A, np.where(held, 0.0, g)[:, :, None])[:, :, 0]
        pressing = ((x <= 0) & (step < 0)) | ((x >= 1) & (step > 0))
        if not np.any(pressing & ~held):
            break
        held |= pressing
    return np.where(held, 0.0, step)


def all_minima(misfit: Misfit, *, seed: int, starts: int = 24, near: np.ndarray | None = None) -> list[Fit]:
    """Every distinct minimum of χ² that Sobol points, and the points `near` (k, d), lead to; best first.

    A quarter of the starts are the best of `N_DESCENT_SCAN_POINTS`, a quarter are spread over the box, and half are the
    best of those that no neighbour betters: one wide basin does not take them all.  Minima closer than
    `SAME_MINIMUM_TOLERANCE`, or with a pass between them that is lower than `VALLEY_PASS_CHI2`, are one.
    """
    d = misfit.model.box.d
    sample = sobol_sequence(d, N_DESCENT_SCAN_POINTS, seed)
    score = misfit.chi2(sample)
    order = np.argsort(score)
    picked = [*order[: starts // 4], *range(starts // 4), *_basins(sample, score)[: starts // 2]]
    X = sample[list(dict.fromkeys(int(k) for k in picked))]
    if near is not None and len(near):
        X = np.vstack([np.clip(near, 0, 1), X])
    X = levenberg_marquardt(misfit, X, tolerance=COARSE_CHI2_TOLERANCE)
    S = misfit.chi2(X)
    found: list[int] = []
    for k in np.argsort(S):
        if np.isfinite(S[k]) and all(np.abs(X[k] - X[j]).max() > SAME_MINIMUM_TOLERANCE for j in found):
            found.append(int(k))
    found = [k for k in found if _is_minimum(misfit, X[k], float(S[k]))] or [int(np.argmin(S))]
    kept: list[int] = []
    for k in found:
        # The nearest first, also of those that were found to belong to another: a valley is walked in short steps.
        lower = sorted(found[: found.index(k)], key=lambda j: float(np.abs(X[j] - X[k]).max()))
        if not any(_one_valley(misfit, X[j], X[k], float(S[k])) for j in lower):
            kept.append(k)
    fine = levenberg_marquardt(misfit, X[kept])
    return sorted((fit_at(misfit, x) for x in fine), key=lambda fit: fit.chi2)


def _basins(X: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Indices of the points X (k, d) that none of their nearest neighbours betters by S (k,), best first."""
    near = cKDTree(X).query(X, k=2 * X.shape[1] + 2)[1]
    lowest = np.flatnonzero(np.all(S[:, None] <= S[near], axis=1))
    return lowest[np.argsort(S[lowest])]


def _one_valley(misfit: Misfit, a: np.ndarray, b: np.ndarray, S: float) -> bool:
    """Whether a path leads from a to b (d,) on which χ² rises above S = χ²(b) by less than anyone could show.

    Straight, or along the axis on which they are farthest apart, the others following.
    """
    k = int(np.argmax(np.abs(a - b)))
    X = a + np.linspace(0, 1, 12)[1:-1, None] * (b - a)
    free = np.arange(len(a)) != k
    # Errors of unknown size: as large as what is left over.
    unit = 1.0 if misfit.weighting == "noise" else S / max(misfit.n - len(a), 1)
    if misfit.chi2(X).max() <= S + VALLEY_PASS_CHI2 * unit:
        return True
    return bool(
        misfit.chi2(levenberg_marquardt(misfit, X, free, tolerance=COARSE_CHI2_TOLERANCE)).max()
        <= S + VALLEY_PASS_CHI2 * unit
    )


def _is_minimum(misfit: Misfit, x: np.ndarray, S: float) -> bool:
    """No neighbour within half of `SAME_MINIMUM_TOLERANCE` is clearly lower: points that stopped on a slope or a saddle
    are none."""
    d = len(x)
    away = np.vstack([np.eye(d), -np.eye(d)]) * SAME_MINIMUM_TOLERANCE / 2
    around = np.clip(x + away, 0, 1)
    return bool(np.min(misfit.chi2(around)) >= S * (1 - 1e-6) - 1e-9)
