"""Intervals of each parameter: the Gaussian of the Fisher information inside the box, and the profile of the misfit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.core.distributions import chi2_ppf, normal_cdf, normal_ppf
from rso.doe import sobol_sequence
from rso.inference.least_squares import Fit, levenberg_marquardt
from rso.inference.likelihood import Misfit

CREDIBLE_LEVEL = 0.9  # probability within an interval, unless another level is asked for
N_GAUSSIAN_DRAWS = 2**14  # of the Gaussian in the box: its 5 % quantile is then within 1 % of a standard deviation
# points of a profile over the whole box, and over ±4 standard deviations
N_PROFILE_POINTS, N_NEAR_PROFILE_POINTS = 33, 17
N_POINTS_OF_ONLY_PROFILE = 257  # points of the profile of an only parameter, which cost no descent
# points with the parameter at each of its values, and how many of them are starts of the others
N_PROFILE_SCAN_POINTS, N_PROFILE_SCAN_STARTS = 64, 2
N_PROFILE_SWEEPS = 2  # of each value's descent from where its neighbours' ended
N_POINTS_AT_INTERVAL_END = 9  # further ones between the last point inside an interval and the next one outside
# of χ²: values between two pieces of an interval are excluded by this much more than those at its ends
MIN_GAP_CHI2 = 1.0
INTERVAL_BOUND_TOLERANCE = 1e-9  # of the unit cube: an end this near to a bound of the box is that bound


@dataclass(frozen=True)
class Interval:
    """Ends in the unit cube, and whether they are bounds of the box rather than the data's."""

    low: float
    high: float
    at_low: bool = False
    at_high: bool = False

    @property
    def open(self) -> bool:
        """Whether a bound of the box cuts it off."""
        return self.at_low or self.at_high


def standard_deviations(fisher: np.ndarray) -> np.ndarray:
    """√diag F⁻¹ (d,), infinite along what the data say nothing about."""
    values, V = np.linalg.eigh(fisher)
    seen = values > 1e-12 * max(float(values.max(initial=0.0)), 1e-300)
    variance = (V[:, seen] ** 2 / values[seen]).sum(axis=1)
    blind = (V[:, ~seen] ** 2).sum(axis=1) > 1e-12
    return np.where(blind, np.inf, np.sqrt(variance))


def gaussian_draws(x: np.ndarray, fisher: np.ndarray, seed: int, draws: int = N_GAUSSIAN_DRAWS) -> np.ndarray:
    """Draws (n, d) of the Gaussian N(x, F⁻¹) restricted to the unit cube, quasi-random, n <= `draws`.

    Along each eigenvector of F an independent Gaussian truncated to the cube's extent there; what falls outside of the
    cube is rejected, which is exact.  ValueError if nothing is left.
    """
    d = len(x)
    sd, V, a, b = _truncated(x, fisher)
    p = sobol_sequence(d, draws, seed)
    t = sd * normal_ppf(np.clip(a + p * (b - a), 1e-300, 1 - 1e-16))
    X = x + t @ V.T
    X = X[np.all((X >= 0) & (X <= 1), axis=1)]
    if not len(X):
        raise ValueError("gaussian: no draw lies in the unit cube; the point must lie in it")
    return X


def log_volume(x: np.ndarray, fisher: np.ndarray) -> float:
    """ln ∫ exp(−½ (x' − x)ᵀ F (x' − x)) dx' over the box along the eigenvectors of F that holds the unit cube."""
    sd, _, a, b = _truncated(x, fisher)
    return float(np.sum(np.log(np.sqrt(2 * np.pi) * sd * np.maximum(b - a, 1e-300))))


def _truncated(x: np.ndarray, fisher: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations (d,), eigenvectors (d, d) of F, and Φ (d,) of the Gaussian at both ends of the cube there."""
    values, V = np.linalg.eigh(fisher)
    sd = 1.0 / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max(initial=0.0)), 1e-6)))
    low = np.minimum(V, 0.0).sum(axis=0) - V.T @ x
    high = np.maximum(V, 0.0).sum(axis=0) - V.T @ x
    return sd, V, normal_cdf(low / sd), normal_cdf(high / sd)


def laplace(fit: Fit, level: float = CREDIBLE_LEVEL, seed: int = 0) -> list[Interval]:
    """Central intervals of the Gaussian approximation (Laplace 1774) with a flat prior inside the box.

    x ± z √(F⁻¹)ᵢᵢ where all of them lie well inside; else quantiles of the Gaussian restricted to the box.
    """
    sd, tail = standard_deviations(fit.fisher), 0.5 * (1 - level)
    if np.all((fit.x - 4 * sd > 0) & (fit.x + 4 * sd < 1)):
        z = normal_ppf(1 - tail)
        return [Interval(float(a), float(b)) for a, b in zip(fit.x - z * sd, fit.x + z * sd, strict=True)]
    return quantiles(gaussian_draws(fit.x, fit.fisher, seed), level)


def quantiles(X: np.ndarray, level: float = CREDIBLE_LEVEL) -> list[Interval]:
    """Central intervals (d,) of draws X (n, d)."""
    tail = 0.5 * (1 - level)
    ends = np.quantile(X, [tail, 1 - tail], axis=0)
    return [Interval(float(a), float(b)) for a, b in ends.T]


@dataclass(frozen=True, eq=False)
class ProfileInterval:
    """Least misfit for each fixed value of one parameter.

    `at` (g,) of the unit cube, `rise` (g,) = χ² − least χ², `path` (g, d) where the others go; `change` (g,) is the
    change of the model against the best fit at the measured point where that is largest against its standard
    uncertainty `sigma` (g,), both in the unit of the data, `point` (g,) the index of that point among all.
    """

    parameter: int
    at: np.ndarray
    rise: np.ndarray
    path: np.ndarray
    change: np.ndarray
    sigma: np.ndarray
    point: np.ndarray

    def interval(self, level: float = CREDIBLE_LEVEL) -> Interval:
        """From the first to the last of all values with rise <= the quantile of χ² with one degree of freedom.

        There may be values between that the data exclude: :meth:`pieces`.
        Source: Venzon & Moolgavkar, Appl. Stat. 37 (1988) 87, eq. 1.
        """
        found = self.pieces(level)
        return Interval(found[0].low, found[-1].high, found[0].at_low, found[-1].at_high)

    def pieces(self, level: float = CREDIBLE_LEVEL) -> tuple[Interval, ...]:
        """The same values as intervals in order, apart where the rise exceeds the quantile by more than `MIN_GAP_CHI2`.

        √rise is linear between grid points; where no value is inside, the best one alone.
        """
        found = pieces(self.at, self.rise, level)
        return tuple(
            Interval(low, high, low <= INTERVAL_BOUND_TOLERANCE, high >= 1 - INTERVAL_BOUND_TOLERANCE)
            for low, high in found
        )

    def with_runs(self, X: np.ndarray, rise: np.ndarray) -> ProfileInterval:
        """The profile with simulations at X (m, d) of which χ² rises by `rise` (m,) where that is less than its own.

        A least misfit is nowhere more than that of a run: whatever surrogates say, such values are not excluded.
        """
        k = self.parameter
        lower = np.flatnonzero(rise < np.interp(X[:, k], self.at, self.rise) - 1e-9)
        if not len(lower):
            return self
        order = np.argsort(np.append(self.at, X[lower, k]), kind="stable")
        near = [int(np.argmin(np.abs(self.at - x))) for x in X[lower, k]]
        return replace(
            self,
            at=np.append(self.at, X[lower, k])[order],
            rise=np.append(self.rise, np.maximum(rise[lower], 0.0))[order],
            path=np.append(self.path, X[lower], axis=0)[order],
            change=np.append(self.change, self.change[near])[order],
            sigma=np.append(self.sigma, self.sigma[near])[order],
            point=np.append(self.point, self.point[near])[order],
        )

    def leaning(self, level: float = CREDIBLE_LEVEL) -> tuple[int, ...]:
        """Other parameters on a bound of the box just beyond an end of this interval: that bound makes the end."""
        i = self.interval(level)
        rows = [] if i.at_low else [int(np.flatnonzero(self.at < i.low)[-1])]
        rows += [] if i.at_high else [int(np.flatnonzero(self.at > i.high)[0])]
        on = np.any((self.path[rows] <= 1e-3) | (self.path[rows] >= 1 - 1e-3), axis=0)
        on[self.parameter] = False
        return tuple(int(j) for j in np.flatnonzero(on))


def pieces(at: np.ndarray, rise: np.ndarray, level: float = CREDIBLE_LEVEL) -> tuple[tuple[float, float], ...]:
    """(low, high) of all values `at` (g,), in order, where the `rise` (g,) of χ² is within its quantile."""
    limit, root, n = math.sqrt(chi2_ppf(level, 1)), np.sqrt(np.maximum(rise, 0.0)), len(at)

    def crossing(inner: int, outer: int) -> float:
        share = (limit - root[inner]) / (root[outer] - root[inner])
        return float(at[inner] + share * (at[outer] - at[inner]))

    found = []
    for first, last in stretches(rise, level):
        low = crossing(first, first - 1) if first else float(at[0])
        found.append((low, crossing(last, last + 1) if last + 1 < n else float(at[-1])))
    best = float(at[int(np.argmin(root))])
    return tuple(found) or ((best, best),)


def stretches(rise: np.ndarray, level: float = CREDIBLE_LEVEL) -> list[tuple[int, int]]:
    """First and last index of each run of values (g,) within the quantile of χ² with one degree of freedom.

    Runs with nothing between them above that quantile + `MIN_GAP_CHI2` are one: descents end short of the least misfit
    by less.
    """
    limit = chi2_ppf(level, 1)
    found: list[tuple[int, int]] = []
    for i in map(int, np.flatnonzero(rise <= limit)):
        joined = bool(found) and float(rise[found[-1][1] : i + 1].max()) <= limit + MIN_GAP_CHI2
        found[-1:] = [(found[-1][0], i)] if joined else [*found[-1:], (i, i)]
    return found


def profile_likelihood(misfit: Misfit, fit: Fit, parameter: int, also: np.ndarray | None = None) -> ProfileInterval:
    """Profile of one parameter over the whole box, finer within ±4 standard deviations of the fit.

    At each value the others start where the Gaussian approximation takes them, at the best fit itself, at the points
    `also` (k, d), at the best of a scan, and then where they end at both neighbours; the lowest counts, so that no
    branch is missed because the best fit lies on another.
    """
    k, d = parameter, len(fit.x)
    sd = standard_deviations(fit.fisher)
    points = [fit.x, *(() if also is None else also)]
    # a valley may be narrow
    at = [np.linspace(0, 1, N_PROFILE_POINTS if d > 1 else N_POINTS_OF_ONLY_PROFILE), np.array([p[k] for p in points])]
    if np.isfinite(sd[k]):
        at += [np.clip(p[k] + min(sd[k], 0.25) * np.linspace(-4, 4, N_NEAR_PROFILE_POINTS), 0, 1) for p in points[:1]]
    t = np.unique(np.round(np.concatenate(at), 12))
    starts = [np.repeat(p[None], len(t), axis=0) for p in points]
    starts.insert(0, fit.x + np.outer(t - fit.x[k], _follow(fit.fisher, k)))
    best, path = _lowest(misfit, fit, k, t, [*starts, *_scanned(misfit, k, t)])
    for _ in range(N_PROFILE_SWEEPS if d > 1 else 0):
        S, P = _lowest(misfit, fit, k, t, [np.roll(path, 1, axis=0), np.roll(path, -1, axis=0)])
        better = S < best
        best, path = np.where(better, S, best), np.where(better[:, None], P, path)
    # a valley is flat inside and steep outside: from the last point inside to the next one √rise is no line
    inside = stretches(best - min(fit.chi2, float(best.min())))
    ends = [(i, o) for first, last in inside for i, o in ((first, first - 1), (last, last + 1))]
    for i, o in [(i, o) for i, o in ends if 0 <= o < len(t)]:
        between = np.linspace(t[i], t[o], N_POINTS_AT_INTERVAL_END + 2)[1:-1]
        S, P = _lowest(
            misfit, fit, k, between, [np.repeat(path[[n]], N_POINTS_AT_INTERVAL_END, axis=0) for n in (i, o)]
        )
        t, best, path = np.append(t, between), np.append(best, S), np.append(path, P, axis=0)
    order = np.argsort(t)
    t, best, path = t[order], best[order], path[order]
    floor = min(fit.chi2, float(best.min()))
    return ProfileInterval(k, t, best - floor, path, *_changes(misfit, fit, path))


def _lowest(
    misfit: Misfit, fit: Fit, k: int, t: np.ndarray, starts: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest χ² (n,) with parameter k at t (n,), and where (n, d), from the best of some starts (n, d)."""
    d = len(fit.x)
    X = np.clip(np.concatenate(starts if d > 1 else starts[:1]), 0.0, 1.0)
    X[:, k] = np.tile(t, len(X) // len(t))
    X = levenberg_marquardt(misfit, X, np.arange(d) != k)
    S = misfit.chi2(X).reshape(-1, len(t))
    S = np.where(np.isfinite(S), S, np.inf)
    rows = np.arange(len(t))
    lowest = np.argmin(S, axis=0)
    return S[lowest, rows], X.reshape(len(S), len(t), d)[lowest, rows]


def _scanned(misfit: Misfit, k: int, t: np.ndarray) -> list[np.ndarray]:
    """`N_PROFILE_SCAN_STARTS` starts (n, d) each: the lowest of `N_PROFILE_SCAN_POINTS` points with parameter k at t
    (n,)."""
    d = misfit.model.box.d
    if d == 1:
        return []
    X = np.repeat(sobol_sequence(d, N_PROFILE_SCAN_POINTS, 0)[None], len(t), axis=0)
    X[:, :, k] = t[:, None]
    S = misfit.chi2(X.reshape(-1, d)).reshape(len(t), N_PROFILE_SCAN_POINTS)
    order = np.argsort(np.where(np.isfinite(S), S, np.inf), axis=1)[:, :N_PROFILE_SCAN_STARTS]
    return [X[np.arange(len(t)), order[:, j]] for j in range(N_PROFILE_SCAN_STARTS)]


def _follow(fisher: np.ndarray, k: int) -> np.ndarray:
    """How the others move per step of parameter k along the valley: −F₂₂⁻¹ F₂₁, and 1 for k itself."""
    free = np.arange(len(fisher)) != k
    slope = np.ones(len(fisher))
    if free.any():
        slope[free] = -np.linalg.lstsq(fisher[np.ix_(free, free)], fisher[free, k], rcond=1e-10)[0]
    return slope


def _changes(misfit: Misfit, fit: Fit, path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    moved = misfit.model.predict(path) - misfit.model.predict(fit.x[None])
    sigma = np.concatenate([d.sigma for d in misfit.data])
    sigma = np.maximum(sigma, 1e-12 * max(float(np.abs(moved).max()), 1e-300))
    worst = np.argmax(np.abs(moved) / sigma, axis=1)
    rows = np.arange(len(path))
    return moved[rows, worst], sigma[worst], worst
