"""How much each parameter moves an output: local bars and curves, Morris screening, Sobol indices.

`predict` maps points X (n, d) of the unit cube to outputs y (n,): the `mean` of a surrogate, or any function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rso.core.distributions import t_ppf
from rso.doe import Box

Predict = Callable[[np.ndarray], np.ndarray]
Feasible = Callable[[np.ndarray], np.ndarray]
N_REPLICATES = 8  # independent scrambles behind every index
# random errors of the surrogate for each scramble, and on how many of its points
N_RANDOM_ERRORS, N_ERROR_POINTS = 4, 256
N_ERROR_WAVES = 12  # waves in such an error


@dataclass(frozen=True)
class LocalBar:
    """What one parameter does alone: y at its low and high end, the largest change over its range, elasticity.

    `change` = max − min of y over the whole range, with the others at x0 (in the unit of y);
    `elasticity` = ∂ ln y/∂ ln θ at x0, None without a box or where y or θ is not positive.
    """

    name: str
    at_low: float
    at_high: float
    change: float
    elasticity: float | None


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """First-order and total indices (d,) with 90 % intervals (d, 2), all in [0, 1]; nan for a constant output.

    `variance` is that of y, `n` the number of base points of each scramble, `excluded` the share of the cube that
    the constraint forbids.
    """

    first: np.ndarray
    total: np.ndarray
    first_interval: np.ndarray
    total_interval: np.ndarray
    variance: float
    n: int
    excluded: float


@dataclass(frozen=True, eq=False)
class Morris:
    """Elementary effects over the cube, in y per full range: mean, mean size and standard deviation (d,)."""

    mu: np.ndarray
    mu_star: np.ndarray
    sigma: np.ndarray
    trajectories: int


def response_curve(predict: Predict, x0: np.ndarray, j: int, n: int = 41) -> tuple[np.ndarray, np.ndarray]:
    """(x_j, y), each (n,): the response to parameter j over its range with the others at x0 (d,)."""
    x0 = np.asarray(x0, float)
    if not 0 <= j < len(x0):
        raise ValueError(f"curve: parameter index must be 0 to {len(x0) - 1}, got {j}")
    X = np.tile(x0, (n, 1))
    X[:, j] = np.linspace(0, 1, n)
    return X[:, j], np.asarray(predict(X), float)


def local(predict: Predict, x0: np.ndarray, names: Sequence[str], box: Box | None = None) -> tuple[LocalBar, ...]:
    """One bar per parameter around x0 (d,) in the unit cube (see :class:`LocalBar` for the definitions)."""
    x0 = np.asarray(x0, float)
    if len(names) != len(x0) or x0.min() < 0 or x0.max() > 1:
        raise ValueError(f"local: needs one name per parameter and x0 in the unit cube, got {list(names)} and {x0}")
    bars = []
    for j, name in enumerate(names):
        _, y = response_curve(predict, x0, j)
        elasticity = None if box is None else _elasticity(predict, x0, j, box)
        bars.append(LocalBar(name, float(y[0]), float(y[-1]), float(np.ptp(y)), elasticity))
    return tuple(bars)


def _elasticity(predict: Predict, x0: np.ndarray, j: int, box: Box) -> float | None:
    # 1e-4 of the range: truncation and rounding are both far below a surrogate's own error; one-sided at a face.
    X = np.tile(x0, (2, 1))
    X[0, j], X[1, j] = max(x0[j] - 1e-4, 0.0), min(x0[j] + 1e-4, 1.0)
    y, theta = np.asarray(predict(X), float), box.from_unit(X)[:, j]
    if y.min() <= 0 or theta.min() <= 0:
        return None
    return float(np.log(y[1] / y[0]) / np.log(theta[1] / theta[0]))


def morris(
    predict: Predict, d: int, seed: int, trajectories: int = 20, levels: int = 4, constraint: Feasible | None = None
) -> Morris:
    """Elementary effects along random one-at-a-time trajectories (Morris 1991; mu* after Campolongo 2007).

    EE_j = (y(x + Δ e_j) − y(x))/Δ with Δ = levels/(2 (levels − 1)) on a grid of an even number of levels.
    `constraint(X)` (mask of feasible points) keeps the trajectories that respect it from start to end.

    Raises
    ------
    ValueError
        for fewer than 2 trajectories, an odd number of levels, or a constraint that hardly any trajectory respects.
    """
    if trajectories < 2 or levels < 2 or levels % 2:
        raise ValueError(f"morris: needs >= 2 trajectories and an even number of levels, got {trajectories}, {levels}")
    rng = np.random.default_rng(seed)
    delta = levels / (2 * (levels - 1))
    kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(1 if constraint is None else 200):
        X, sign, rank = _trajectories(d, trajectories, levels, delta, rng)
        if constraint is not None:
            good = np.asarray(constraint(X.reshape(-1, d)), bool).reshape(trajectories, d + 1).all(axis=1)
            X, sign, rank = X[good], sign[good], rank[good]
        kept.append((X, sign, rank))
        if sum(len(k[0]) for k in kept) >= trajectories:
            break
    else:
        raise ValueError("morris: the constraint leaves hardly any trajectory")
    X, sign, rank = (np.concatenate(part)[:trajectories] for part in zip(*kept, strict=True))
    y = np.asarray(predict(X.reshape(-1, d)), float).reshape(trajectories, d + 1)
    rows = np.arange(trajectories)[:, None]
    effects = (y[rows, rank + 1] - y[rows, rank]) / (sign * delta)
    return Morris(effects.mean(0), np.abs(effects).mean(0), effects.std(0, ddof=1), trajectories)


def _trajectories(
    d: int, trajectories: int, levels: int, delta: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (trajectories, d + 1, d), the sign of each parameter's step and its place in the order."""
    low = rng.integers(0, levels // 2, (trajectories, d)) / (levels - 1)
    sign = rng.choice((-1.0, 1.0), (trajectories, d))
    start = np.where(sign > 0, low, low + delta)
    order = rng.permuted(np.tile(np.arange(d), (trajectories, 1)), axis=1)
    rank = np.argsort(order, axis=1)
    steps = np.arange(d + 1)[None, :, None]
    X = start[:, None, :] + (steps > rank[:, None, :]) * sign[:, None, :] * delta
    return np.clip(X, 0, 1), sign, rank  # 1/3 + 2/3 may be one rounding above 1


def saltelli_indices(
    predict: Predict, d: int, seed: int, n: int = 2**12, constraint: Feasible | None = None, sd: Predict | None = None
) -> SobolIndices:
    """Sobol indices S_j = Var(E[y|x_j])/Var(y) and T_j = E[Var(y|x_~j)]/Var(y) of inputs uniform on the cube.

    S from pairs that share x_j and T from pairs that share all else (Janon et al. 2014, eq. 6; Jansen 1999), means
    over R = 8 independent scrambles of a Sobol sequence of n = 2^k points: R n (2d + 2) evaluations at most.
    `constraint(X)` (mask of feasible points) restricts the distribution to the uniform one on the feasible set, the
    conditional points being drawn by rejection (Kucherenko, Klymenko & Shah 2017); inputs are then dependent: ΣS may
    exceed 1.

    The intervals are Student's of the R scrambles (Owen, Monte Carlo theory, methods and examples (2013), ch. 17).
    Where `predict` is a surrogate, `sd(X)` (n,) says how far off it may be: the intervals then also hold what indices
    change by when random smooth errors of that size are added to it, y + sd g with g of unit variance, a sum of waves
    along one to three parameters with lengths from 0.2 to 1 (as Janon et al. 2014 and Marrel et al. 2009 do with
    draws of the surrogate).

    Raises
    ------
    ValueError
        if n is no power of two, or the constraint leaves less than 1 % of the cube or slices of it.
    """
    if n < 4 or n & (n - 1):
        raise ValueError(f"sobol: n must be a power of two >= 4, got {n}")
    found, moved, variances, sizes, excluded = [], [], [], [], []
    for child in np.random.SeedSequence(seed).spawn(N_REPLICATES):
        rng = np.random.default_rng(child)
        points, roles, share = _scramble(d, n, rng, constraint)
        y = np.stack([np.asarray(predict(X), float) for X in points])
        variances.append(float(np.var(y[:2])))
        sizes.append(float(np.mean(y[0] ** 2)))
        excluded.append(share)
        if variances[-1] > 0:
            found.append(_estimate(y[roles]))
            moved += [] if sd is None else _moved(points[:, :N_ERROR_POINTS], y[:, :N_ERROR_POINTS], sd, roles, rng)
    variance, lost = float(np.mean(variances)), float(np.mean(excluded))
    if len(found) < N_REPLICATES or variance <= 1e-24 * float(np.mean(sizes)):
        nan = np.full(d, np.nan)
        return SobolIndices(nan, nan, np.full((d, 2), np.nan), np.full((d, 2), np.nan), 0.0, n, lost)
    each = np.array(found)  # (R, 2, d)
    index, spread = each.mean(axis=0), each.var(axis=0, ddof=1) / N_REPLICATES
    half = t_ppf(0.95, N_REPLICATES - 1) * np.sqrt(spread)
    low, high = index - half, index + half
    if moved:
        δ = np.array(moved)
        half = t_ppf(0.95, N_REPLICATES - 1) * np.sqrt(spread + δ.var(axis=0, ddof=1))
        low = np.minimum(low, index + δ.mean(axis=0) - half)
        high = np.maximum(high, index + δ.mean(axis=0) + half)
    first, total = np.clip(index, 0.0, 1.0)
    intervals = np.clip(np.stack([low, high], axis=-1), 0.0, 1.0)
    return SobolIndices(first, total, intervals[0], intervals[1], variance, n, lost)


def _scramble(
    d: int, n: int, rng: np.random.Generator, constraint: Feasible | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Points (k, n, d), which of the k are p, q, u, v of each parameter (4, d), and the share that is not feasible."""
    A, B, excluded = _base(d, n, rng, constraint)
    j = np.arange(d)
    if constraint is None:
        mixed = np.repeat(A[None], d, axis=0)
        mixed[j, :, j] = B.T
        return np.stack([A, B, *mixed]), np.array([0 * j + 1, j + 2, 0 * j, j + 2]), excluded
    shared = [_redraw(A, j != k, rng, constraint) for k in j] + [_redraw(A, j == k, rng, constraint) for k in j]
    return np.stack([A, B, *shared]), np.array([0 * j, j + 2, 0 * j, j + 2 + d]), excluded


def _moved(
    points: np.ndarray, y: np.ndarray, sd: Predict, roles: np.ndarray, rng: np.random.Generator
) -> list[np.ndarray]:
    """What random errors of size sd change the indices by, (2, d) each, on points (k, n, d) with values y (k, n)."""
    if not np.all(y[:2].std(axis=1) > 0):
        return []
    band = np.stack([np.asarray(sd(X), float) for X in points])
    before = np.array(_estimate(y[roles]))
    return [np.array(_estimate((y + band * _error(points, rng))[roles])) - before for _ in range(N_RANDOM_ERRORS)]


def _error(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random smooth function of unit variance at points (k, n, d): Σ √(2/F) cos(ω·x + φ)."""
    d = points.shape[-1]
    # Errors of a surrogate are seldom of high order: each wave runs along few parameters.
    order = rng.integers(1, min(d, 3) + 1, N_ERROR_WAVES)
    along = rng.permuted(np.tile(np.arange(d), (N_ERROR_WAVES, 1)), axis=1) < order[:, None]
    length = np.exp(rng.uniform(np.log(0.2), 0.0, N_ERROR_WAVES))
    ω = along * rng.standard_normal((N_ERROR_WAVES, d)) / length[:, None]
    φ = rng.uniform(0, 2 * np.pi, N_ERROR_WAVES)
    return np.sqrt(2 / N_ERROR_WAVES) * np.cos(points @ ω.T + φ).sum(axis=-1)


def _estimate(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    p, q, u, v = P
    centre = ((p + q) / 2).mean(axis=-1)
    first = ((p * q).mean(axis=-1) - centre**2) / (((p**2 + q**2) / 2).mean(axis=-1) - centre**2)
    middle = ((u + v) / 2).mean(axis=-1)
    total = ((u - v) ** 2).mean(axis=-1) / 2 / (((u**2 + v**2) / 2).mean(axis=-1) - middle**2)
    return first, total


def _base(
    d: int, n: int, rng: np.random.Generator, constraint: Feasible | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Two feasible samples (n, d) and the share of the cube that is not feasible."""
    from scipy.stats import qmc  # half a second to import

    engine = qmc.Sobol(2 * d, scramble=True, rng=rng)
    if constraint is None:
        points = engine.random(n)
        return points[:, :d], points[:, d:], 0.0
    kept, drawn = [np.empty((0, d))], 0
    while sum(map(len, kept)) < 2 * n:
        points = engine.random(n).reshape(-1, d)
        drawn += len(points)
        kept.append(points[np.asarray(constraint(points), bool)])
        if drawn >= 200 * n and sum(map(len, kept)) < 0.01 * drawn:
            raise ValueError("sobol: the constraint leaves less than 1 % of the cube")
    X = np.vstack(kept)
    return X[:n], X[n : 2 * n], 1 - len(X) / drawn


def _redraw(X: np.ndarray, columns: np.ndarray, rng: np.random.Generator, constraint: Feasible) -> np.ndarray:
    """X with the marked columns drawn again, uniformly on the feasible part of each slice."""
    Y, pending = X.copy(), np.arange(len(X))
    for _ in range(2000):
        tries = X[pending]
        tries[:, columns] = rng.random((len(pending), int(columns.sum())))
        good = np.asarray(constraint(tries), bool)
        Y[pending[good]] = tries[good]
        pending = pending[~good]
        if not len(pending):
            return Y
    raise ValueError(f"sobol: {len(pending)} of {len(X)} slices of the feasible set are too thin to sample")
