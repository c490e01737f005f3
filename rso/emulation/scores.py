"""How wrong a surrogate is, in the units of what it predicts: on held-out points and by cross-validation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np


class Predictor(Protocol):
    """Anything with a mean prediction."""

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Predicted y (n,) at X (n, d)."""


class Banded(Protocol):
    """Anything that says how sure it is."""

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) at X (n, d)."""


@dataclass(frozen=True)
class Scores:
    """Errors over n points: rmse and max_abs in the units of y, q2 and relative_rmse without unit.

    q2 = 1 − Σ(ŷ − y)²/Σ(y − ȳ)² (nan where y is constant); relative_rmse = rmse/√mean(y²).
    """

    rmse: float
    max_abs: float
    q2: float
    relative_rmse: float
    n: int


def score(predicted: np.ndarray, y: np.ndarray) -> Scores:
    """Scores of predictions (n,) against y (n,)."""
    y = np.asarray(y, float)
    error = np.asarray(predicted, float) - y
    rmse, spread, size = np.sqrt(np.mean(error**2)), np.sum((y - y.mean()) ** 2), np.sqrt(np.mean(y**2))
    q2 = 1 - np.sum(error**2) / spread if spread > 0 else np.nan
    return Scores(
        float(rmse), float(np.abs(error).max()), float(q2), float(rmse / size) if size > 0 else np.nan, len(y)
    )


def scaled(s: Scores, factor: float) -> Scores:
    """Scores of errors that are `factor` times as large all over; the largest that was seen stays what it is."""
    return replace(s, rmse=factor * s.rmse, relative_rmse=factor * s.relative_rmse, q2=1 - factor**2 * (1 - s.q2))


def pooled(a: Scores, b: Scores) -> Scores:
    """Scores over the points of both: mean squares weighted by their numbers; q2 is nan, its spreads differ."""
    n = a.n + b.n

    def root(x: float, y: float) -> float:
        return float(np.sqrt((a.n * x**2 + b.n * y**2) / n))

    relative = root(a.relative_rmse, b.relative_rmse)
    return Scores(root(a.rmse, b.rmse), max(a.max_abs, b.max_abs), float("nan"), relative, n)


def held_out_scores(model: Predictor, X: np.ndarray, y: np.ndarray) -> Scores:
    """Scores of a fitted model on points X (m, d), y (m,) that it has not seen."""
    return score(model.mean(np.asarray(X, float)), y)


def cross_validate(
    refit: Callable[[np.ndarray], Predictor], X: np.ndarray, y: np.ndarray, seed: int, folds: int = 10
) -> Scores:
    """Scores of predictions for each fold by a model refitted without it; `refit(rows)` fits to those rows.

    Leave-one-out where there are no more points than folds. The assignment to folds depends on n and seed only.
    """
    return score(left_out_means(refit, X, y, seed, folds), y)


def left_out_means(
    refit: Callable[[np.ndarray], Predictor], X: np.ndarray, y: np.ndarray, seed: int, folds: int = 10
) -> np.ndarray:
    """Mean (n,) for each fold by a model refitted without it, as :func:`cross_validate`."""
    predicted = np.empty(len(y))
    for part, rows in _folds(len(y), seed, folds):
        predicted[part] = refit(rows).mean(X[part])
    return predicted


def left_out_bands(
    refit: Callable[[np.ndarray], Banded], X: np.ndarray, y: np.ndarray, seed: int, folds: int = 10
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n,) for each fold by a model refitted without it, as :func:`cross_validate`."""
    mean, sd = np.empty(len(y)), np.empty(len(y))
    for part, rows in _folds(len(y), seed, folds):
        mean[part], sd[part] = refit(rows).predict(X[part])
    return mean, sd


def _folds(n: int, seed: int, folds: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Each fold of n points and the others."""
    if n < 2 or folds < 2:
        raise ValueError(f"cross-validation needs at least 2 points and 2 folds, got {n} and {folds}")
    order = np.random.default_rng(seed).permutation(n)
    for part in np.array_split(order, min(folds, n)):
        yield part, np.setdiff1d(np.arange(n), part)
