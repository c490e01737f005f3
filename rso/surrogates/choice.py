"""Fit one surrogate per output and say why this one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rso.surrogates.common import powers
from rso.surrogates.kriging import Kriging, describe, fit_kriging
from rso.surrogates.polynomial import Polynomial, fit_polynomial
from rso.surrogates.scores import Scores, cross_validate

Surrogate = Polynomial | Kriging
KINDS = ("auto", "polynomial", "kriging")


def fit(
    kind: str,
    X: np.ndarray,
    y: np.ndarray,
    *,
    seed: int,
    noise_sd: np.ndarray | float | None = None,
    degree: int | None = None,
    log: bool | None = None,
    unit: str = "",
    names: tuple[str, ...] | None = None,
) -> Surrogate:
    """The surrogate of y (n,) over X (n, d) in the unit cube with the smallest cross-validation error in y.

    kind 'auto' compares polynomials and kriging on the same ten folds, refitted without each fold. `degree`
    fixes the degree of the polynomial (1 to 4); `log` None tries the logarithm too where y > 0. `noise_sd` is used by
    kriging alone: a polynomial estimates its own scatter. The reasons are in `story`, the scores in `cv`.

    Raises
    ------
    ValueError
        for an unknown kind, values that are not finite, or too few points for every surrogate of that kind.
    """
    if kind not in KINDS:
        raise ValueError(f"surrogate: unknown kind {kind!r}; choose one of {', '.join(KINDS)}")
    X, y = np.asarray(X, float), np.asarray(y, float)
    logs = (log,) if log is not None else (False, True) if y.size and y.min() > 0 else (False,)
    tried: list[tuple[Surrogate, Scores]] = []
    refusals = []
    if kind != "kriging":
        try:
            tried.append(_best_polynomial(X, y, degree, logs, seed))
        except ValueError as refusal:
            refusals.append(str(refusal))
    if kind != "polynomial":
        try:
            tried.append(_best_kriging(X, y, noise_sd, logs, seed))
        except ValueError as refusal:
            refusals.append(str(refusal))
    if not tried:
        raise ValueError("; ".join(refusals))
    # A tie goes to the polynomial, the simpler one.
    model, cv = min(tried, key=lambda pair: pair[1].rmse)
    others = [f"{_name(m)} had {_error(s, unit)}" for m, s in tried if m is not model] + refusals
    words = describe(model, names) if isinstance(model, Kriging) else _name(model)
    story = f"{words}: cross-validation error {_error(cv, unit)} over {len(y)} runs"
    return replace(model, cv=cv, story="; ".join([story, *others]) + ".")


def refit(model: Surrogate, X: np.ndarray, y: np.ndarray, *, seed: int) -> Surrogate:
    """The same kind of surrogate on other (usually more) data: hyper-parameters anew from the old ones, no contest.

    Its cross-validation scores are leave-one-out at fixed hyper-parameters.
    """
    if isinstance(model, Kriging):
        new: Surrogate = fit_kriging(X, y, seed=seed, trend=model.trend, log=model.log, restarts=0, start=model)
    else:
        new = fit_polynomial(X, y, log=model.log)
    return replace(new, story=f"{model.story} Fitted again to {len(y)} runs.")


def from_dict(data: Mapping[str, Any]) -> Surrogate:
    """The surrogate that `to_dict` wrote."""
    makers = {"polynomial": Polynomial.from_dict, "kriging": Kriging.from_dict}
    if data.get("kind") not in makers:
        raise ValueError(f"surrogate: unknown kind {data.get('kind')!r}; choose one of {', '.join(makers)}")
    return makers[data["kind"]](data)


def _best_polynomial(
    X: np.ndarray, y: np.ndarray, degree: int | None, logs: tuple[bool, ...], seed: int
) -> tuple[Polynomial, Scores]:
    model = min((fit_polynomial(X, y, degree=degree, log=g) for g in logs), key=lambda p: p.cv.rmse)
    try:
        cv = cross_validate(
            lambda rows: fit_polynomial(X[rows], y[rows], degree=model.degree, log=model.log), X, y, seed
        )
    except ValueError:
        cv = model.cv  # with a fold left out too few points remain: leave-one-out has the largest folds there are
    return model, cv


def _best_kriging(
    X: np.ndarray, y: np.ndarray, noise_sd: np.ndarray | float | None, logs: tuple[bool, ...], seed: int
) -> tuple[Kriging, Scores]:
    noise = np.broadcast_to(0.0 if noise_sd is None else np.asarray(noise_sd, float), y.shape)
    n, d = X.shape
    # Twice as many points as trend terms, so that the process has something left to learn from.
    trends = [q for q in (0, 1, 2) if q == 0 or n >= 2 * len(powers(d, q))]
    models = [fit_kriging(X, y, seed=seed, trend=q, log=g, noise_sd=noise) for g in logs for q in trends]
    model = min(models, key=lambda m: m.cv.rmse)

    def refit(rows: np.ndarray) -> Kriging:
        return fit_kriging(
            X[rows], y[rows], seed=seed, trend=model.trend, log=model.log, noise_sd=noise[rows], restarts=0, start=model
        )

    return model, cross_validate(refit, X, y, seed)


def _name(model: Surrogate) -> str:
    name = f"polynomial of degree {model.degree}" if isinstance(model, Polynomial) else "kriging"
    return name + (" of the logarithm" if model.log else "")


def _error(scores: Scores, unit: str) -> str:
    return f"{scores.rmse:.3g} {unit}".rstrip() + f" ({100 * scores.relative_rmse:.2g} %)"
