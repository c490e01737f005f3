"""Means of many surrogates over one cube: what they share is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rso.emulation.common import inside, legendre
from rso.emulation.model_choice import Surrogate
from rso.emulation.polynomial import Polynomial
from rso.emulation.whole_curve import CurvePoint


@dataclass(frozen=True, eq=False)
class MultiOutput:
    """Surrogates of one cube; `exponents` (terms, d) are all terms of the polynomials, `places` those of each."""

    models: tuple[Surrogate | CurvePoint, ...]
    exponents: np.ndarray
    places: tuple[np.ndarray, ...]

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Means (n, m) at X (n, d); ValueError outside the unit cube."""
        A = legendre(inside(X, self.models[0].d), self.exponents) if len(self.exponents) else np.empty((len(X), 0))
        curves: dict[int, np.ndarray] = {}
        columns = []
        for model, place in zip(self.models, self.places, strict=True):
            if isinstance(model, Polynomial):
                columns.append(model.of_basis(A[:, place]))
            elif isinstance(model, CurvePoint):
                if id(model.curve) not in curves:
                    curves[id(model.curve)] = model.curve.mean(X)
                columns.append(curves[id(model.curve)][:, model.point])
            else:
                columns.append(model.mean(X))
        return np.stack(columns, axis=1)


def multi_output(models: Sequence[Surrogate | CurvePoint]) -> MultiOutput:
    """The surrogates with the terms that their polynomials share."""
    terms: dict[tuple[int, ...], int] = {}
    places = tuple(
        np.array([terms.setdefault(tuple(e), len(terms)) for e in m.exponents.tolist()], int)
        if isinstance(m, Polynomial)
        else np.empty(0, int)
        for m in models
    )
    return MultiOutput(tuple(models), np.array(list(terms), int), places)
