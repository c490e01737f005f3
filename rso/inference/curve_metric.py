"""Direct minimisation of any curve metric on an emulator, from many starts; all distinct minima are reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rso.core.curves import metrics
from rso.doe import Box, sobol_sequence
from rso.inference.least_squares import damped
from rso.inference.likelihood import Data, Model

# of the box, and how many of them, the best and the first, begin a search
N_METRIC_SAMPLE_POINTS, N_METRIC_STARTS = 512, 16
MAX_SEARCH_ROUNDS, MIN_SEARCH_MESH = 150, 1e-6  # of the search, and the mesh at which it rests (of the unit cube)
SAME_METRIC_MINIMUM_TOLERANCE = 0.01  # of the unit cube
CURVE_METRICS = ("rmse", "nrmse", "mre", "mape", "rrmse")
Score = Callable[[np.ndarray], np.ndarray]
Steps = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class MetricMinimum:
    """A minimum of a metric: x and θ (d,), and its value."""

    x: np.ndarray
    theta: np.ndarray
    value: float


def curve_score(model: Model, data: Sequence[Data], name: str, floor: float = 0.0) -> Score:
    """X (k, d) → the metric (k,) of the predicted curves against the measured ones, averaged over the curves.

    Points with |y| <= `floor` do not enter relative metrics.  ValueError for an unknown name.
    """
    if name not in CURVE_METRICS:
        raise ValueError(f"metric {name!r}; choose one of {', '.join(CURVE_METRICS)}")
    ends = np.cumsum([len(d.value) for d in data])

    def score(X: np.ndarray) -> np.ndarray:
        parts = np.split(model.predict(np.asarray(X, float)), ends[:-1], axis=1)
        each = [_metric(name, d.value, f, floor) for d, f in zip(data, parts, strict=True)]
        return np.mean(each, axis=0)

    return score


def _metric(name: str, y: np.ndarray, F: np.ndarray, floor: float) -> np.ndarray:
    """One metric (k,) of predictions F (k, n), as :func:`rso.core.curves.metrics` defines it."""
    # What has no meaning for these data has none for any prediction.
    if not np.isfinite(getattr(metrics(y, y + 1.0, floor), name)):
        return np.full(len(F), np.nan)
    if name in ("rmse", "nrmse"):
        return np.sqrt(np.mean((F - y) ** 2, axis=1)) / (abs(np.mean(y)) if name == "nrmse" else 1.0)
    used = np.abs(y) > floor
    relative = (F[:, used] - y[used]) / y[used]
    if name == "rrmse":
        return np.sqrt(np.mean(relative**2, axis=1))
    return np.mean(np.abs(relative), axis=1) * (100 if name == "mape" else 1)


def downhill(model: Model, data: Sequence[Data], name: str, floor: float = 0.0) -> Steps:
    """X (k, d) → steps (k, 3, d) that lower the metric of :func:`curve_score` to first order, with three dampings.

    Gauss–Newton steps of Σ ω r² with the weights ω whose gradient is that of the metric: 1/RMSE of a curve, for mean
    absolute errors 1/|r| (iteratively reweighted least squares: Schlossmacher, J. Am. Stat. Assoc. 68 (1973) 857).
    """
    y = np.concatenate([d.value for d in data])
    curve = np.repeat(np.arange(len(data)), [len(d.value) for d in data])
    count, mean = np.bincount(curve), np.abs(np.bincount(curve, y) / np.bincount(curve))
    used = np.abs(y) > floor
    unit = np.where(used, np.abs(y), np.inf) if name in ("mre", "mape", "rrmse") else np.where(mean > 0, mean, 1)[curve]

    def steps(X: np.ndarray) -> np.ndarray:
        J, r = model.jacobians(X), model.predict(X) - y
        scaled = np.abs(r) / unit
        if name in ("mre", "mape"):
            size = np.maximum(scaled, 1e-3 * np.median(scaled[:, used], axis=1, keepdims=True) + 1e-15)
        else:
            squares = np.stack([np.mean(scaled[:, curve == c] ** 2, axis=1) for c in range(len(count))], axis=1)
            size = np.sqrt(squares)[:, curve] + 1e-15
        root = 1.0 / (unit * np.sqrt(size * count[curve]))
        Jw, rw = J * root[:, :, None], r * root
        return np.stack([damped(Jw, rw, np.full(len(X), λ), X) for λ in (1e-6, 1e-2, 1.0)], axis=1)

    return steps


def minimise(
    score: Score, box: Box, *, seed: int, near: np.ndarray | None = None, steps: Steps | None = None
) -> tuple[MetricMinimum, ...]:
    """All distinct minima of score(X) over the unit cube of `box`, best first.

    Mesh-adaptive direct search from the best and from spread points of a Sobol sample, all starts in one call: poll
    along a random orthonormal basis and along `steps`; double the mesh on success, halve it on failure.  It needs no
    derivatives, which mean-absolute metrics lack along their kinks; `steps` carry it along narrow valleys.  Minima
    between which a straight line does not rise are one valley; searches that did not come to rest are dropped.
    Source: Audet & Dennis, SIAM J. Optim. 17 (2006) 188, with random polling directions.
    """
    rng, d = np.random.default_rng([seed, 5]), box.d
    X = sobol_sequence(d, N_METRIC_SAMPLE_POINTS, seed)
    S = score(X)
    if not np.isfinite(S).any():
        raise ValueError("minimise: the metric is finite nowhere in the box")
    order = np.argsort(np.where(np.isfinite(S), S, np.inf))
    picked = list(dict.fromkeys([*order[: N_METRIC_STARTS // 2].tolist(), *range(N_METRIC_STARTS // 2)]))
    starts = X[picked] if near is None else np.vstack([np.clip(near, 0, 1), X[picked]])
    A, V, rest = _search(score, starts, rng, steps)
    found: list[int] = []
    for k in np.argsort(V):
        if (rest[k] or not found) and not any(_one(score, A[k], A[j], V[k], V[j]) for j in found):
            found.append(int(k))
    return tuple(MetricMinimum(A[k], box.from_unit(A[k]), float(V[k])) for k in found)


def _search(
    score: Score, X: np.ndarray, rng: np.random.Generator, steps: Steps | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the starts X (k, d) end, the score there, and which of them came to rest."""
    X = X.copy()
    k, d = X.shape
    V = np.where(np.isfinite(v := score(X)), v, np.inf)
    mesh, last = np.full(k, 0.1), np.zeros((k, d))
    for _ in range(MAX_SEARCH_ROUNDS):
        on = np.flatnonzero(mesh > MIN_SEARCH_MESH)
        if not len(on):
            break
        Q = np.linalg.qr(rng.standard_normal((len(on), d, d)))[0]
        # Where it went last is tried first, twice as far.
        tries = [Q * mesh[on, None, None], -Q * mesh[on, None, None], 2 * last[on, None, :]]
        if steps is not None:
            tries.append(np.nan_to_num(steps(X[on])))
        Y = np.clip(X[on, None, :] + np.concatenate(tries, axis=1), 0, 1)
        W = score(Y.reshape(-1, d)).reshape(len(on), -1)
        W = np.where(np.isfinite(W), W, np.inf)
        best = W.argmin(axis=1)
        rows = np.arange(len(on))
        # Gains too small to be seen in any table would go on along a flat valley for ever.
        better = W[rows, best] < V[on] * (1 - 1e-6) - 1e-300
        go = on[better]
        last[on] = 0.0
        last[go] = (Y[rows, best] - X[on])[better]
        X[go], V[go] = Y[rows, best][better], W[rows, best][better]
        mesh[on] = np.where(better, np.minimum(2 * mesh[on], 0.25), 0.5 * mesh[on])
    return X, V, mesh <= MIN_SEARCH_MESH


def _one(score: Score, a: np.ndarray, b: np.ndarray, va: float, vb: float) -> bool:
    """Whether two points belong to one minimum: next to each other, or with no rise between them."""
    if np.abs(a - b).max() < SAME_METRIC_MINIMUM_TOLERANCE:
        return True
    t = np.linspace(0, 1, 21)[:, None]
    return bool(np.max(score(a + t * (b - a))) <= max(va, vb) * (1 + 1e-3))
