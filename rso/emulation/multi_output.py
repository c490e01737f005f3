"""Means of many surrogates over one cube: what they share is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rso.emulation.common import legendre, within_ranges
from rso.emulation.kriging import Kriging, KrigingBatch
from rso.emulation.model_choice import Surrogate
from rso.emulation.polynomial import Polynomial
from rso.emulation.whole_curve import CurvePoint


@dataclass(frozen=True, eq=False)
class MultiOutput:
    """Surrogates of one cube.

    `exponents` (terms, d) are all terms of the polynomials, `places` those of each; `batches` are processes that are
    asked together, by their places among the `models`.
    """

    models: tuple[Surrogate | CurvePoint, ...]
    exponents: np.ndarray
    places: tuple[np.ndarray, ...]
    batches: tuple[tuple[list[int], KrigingBatch], ...]

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Means (n, m) at X (n, d); ValueError outside the unit cube."""
        X = within_ranges(X, self.models[0].d)
        A = legendre(X, self.exponents) if len(self.exponents) else np.empty((len(X), 0))
        curves: dict[int, np.ndarray] = {}
        found = np.empty((len(X), len(self.models)))
        for columns, batch in self.batches:
            found[:, columns] = batch.mean(X)
        for k, (model, place) in enumerate(zip(self.models, self.places, strict=True)):
            if isinstance(model, Polynomial):
                found[:, k] = model.of_basis(A[:, place])
            elif isinstance(model, CurvePoint):
                if id(model.curve) not in curves:
                    curves[id(model.curve)] = model.curve.mean(X)
                found[:, k] = curves[id(model.curve)][:, model.point]
            elif not isinstance(model, Kriging):
                found[:, k] = model.mean(X)
        return found


def multi_output(models: Sequence[Surrogate | CurvePoint]) -> MultiOutput:
    """The surrogates with the terms that their polynomials share."""
    terms: dict[tuple[int, ...], int] = {}
    places = tuple(
        np.array([terms.setdefault(tuple(e), len(terms)) for e in m.exponents.tolist()], int)
        if isinstance(m, Polynomial)
        else np.empty(0, int)
        for m in models
    )
    together: dict[tuple, list[int]] = {}
    for k, m in enumerate(models):
        if isinstance(m, Kriging):
            together.setdefault(KrigingBatch.alike(m), []).append(k)
    batches = tuple(
        (columns, KrigingBatch(tuple(models[k] for k in columns)))  # type: ignore[misc]
        for columns in together.values()
    )
    return MultiOutput(tuple(models), np.array(list(terms), int), places, batches)
