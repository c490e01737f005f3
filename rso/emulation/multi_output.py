"""Means of many surrogates over one cube: what they share is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rso.emulation.common import within_ranges
from rso.emulation.kriging import Kriging, KrigingBatch
from rso.emulation.model_choice import Surrogate
from rso.emulation.polynomial import Polynomial, PolynomialBatch
from rso.emulation.whole_curve import CurvePoint


@dataclass(frozen=True, eq=False)
class MultiOutput:
    """Surrogates of one cube.

    `batches` are those that are asked together, processes or polynomials, with their places among the `models`.
    """

    models: tuple[Surrogate | CurvePoint, ...]
    batches: tuple[tuple[list[int], KrigingBatch | PolynomialBatch], ...]

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Means (n, m) at X (n, d); ValueError outside the unit cube."""
        X = within_ranges(X, self.models[0].d)
        curves: dict[int, np.ndarray] = {}
        found = np.empty((len(X), len(self.models)))
        for columns, batch in self.batches:
            found[:, columns] = batch.mean(X)
        for k, model in self._alone:
            if isinstance(model, CurvePoint):
                if id(model.curve) not in curves:
                    curves[id(model.curve)] = model.curve.mean(X)
                found[:, k] = curves[id(model.curve)][:, model.point]
            else:
                found[:, k] = model.mean(X)
        return found

    @cached_property
    def _alone(self) -> tuple[tuple[int, Surrogate | CurvePoint], ...]:
        """Models in no batch, and their places."""
        together = {k for columns, _ in self.batches for k in columns}
        return tuple((k, m) for k, m in enumerate(self.models) if k not in together)


def multi_output(models: Sequence[Surrogate | CurvePoint]) -> MultiOutput:
    """The surrogates, those asked together that share a kernel and its points, and all polynomials."""
    together: dict[tuple, list[int]] = {}
    polynomials = [k for k, m in enumerate(models) if isinstance(m, Polynomial)]
    for k, m in enumerate(models):
        if isinstance(m, Kriging):
            together.setdefault(KrigingBatch.alike(m), []).append(k)
    batches: list[tuple[list[int], KrigingBatch | PolynomialBatch]] = [
        (columns, KrigingBatch(tuple(models[k] for k in columns)))  # type: ignore[misc]
        for columns in together.values()
    ]
    if polynomials:
        batches.append((polynomials, PolynomialBatch(tuple(models[k] for k in polynomials))))  # type: ignore[misc]
    return MultiOutput(tuple(models), tuple(batches))
