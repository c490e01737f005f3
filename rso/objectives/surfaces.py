"""Response surfaces of quantities over ranges, levels and categories."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rso.core.polynomial_degree import MAX_POLYNOMIAL_DEGREE
from rso.doe import Space
from rso.emulation import Scores, Surrogate, fit_surrogate, multi_output, score
from rso.emulation.common import monomial_exponents

EVERY_CATEGORY = ()  # the key of a surface that holds for every category


@dataclass(frozen=True, eq=False)
class QuantitySurface:
    """One quantity y(θ) in `unit`: a surrogate for all points, or one for each combination of categories."""

    space: Space
    text: str
    unit: str
    models: Mapping[tuple[int, ...], Surrogate]
    spread: float

    def predict(self, U: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) at points (n, d) of the unit cube."""
        if EVERY_CATEGORY in self.models:
            return self.models[EVERY_CATEGORY].predict(self.space.features(U))
        X, mean, sd = self.space.features(U, categories=False), np.empty(len(U)), np.empty(len(U))
        for key, rows in _by_category(self.space, U).items():
            mean[rows], sd[rows] = self.models[key].predict(X[rows])
        return mean, sd

    def mean(self, U: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        if EVERY_CATEGORY in self.models:
            return self.models[EVERY_CATEGORY].mean(self.space.features(U))
        X, mean = self.space.features(U, categories=False), np.empty(len(U))
        for key, rows in _by_category(self.space, U).items():
            mean[rows] = self.models[key].mean(X[rows])
        return mean

    @property
    def story(self) -> str:
        """What kind it is and how well it does."""
        if EVERY_CATEGORY in self.models:
            return self.models[EVERY_CATEGORY].story
        names = [self.space.names[j] for j in self.space.categories]
        said = []
        for key, model in self.models.items():
            at = ", ".join(
                f"{n} {self.space.labels[j][k]}" for n, j, k in zip(names, self.space.categories, key, strict=True)
            )
            said.append(f"{at}: {model.story}")
        return " ".join(said)

    def score(self, U: np.ndarray, y: np.ndarray) -> Scores:
        """Errors at points that took no part in the fit."""
        return score(self.mean(U), y)

    @property
    def left_out(self) -> Scores | None:
        """Errors by cross-validation; None where surfaces are several."""
        return self.models[EVERY_CATEGORY].cv if EVERY_CATEGORY in self.models else None


@dataclass(frozen=True, eq=False)
class Surfaces:
    """All quantities together, by their texts."""

    space: Space
    each: Mapping[str, QuantitySurface]

    @cached_property
    def _together(self) -> Any:
        models = [s.models.get(EVERY_CATEGORY) for s in self.each.values()]
        return None if None in models else multi_output(models)  # type: ignore[arg-type]

    def means(self, U: np.ndarray) -> dict[str, np.ndarray]:
        """Means (n,) of all quantities."""
        if self._together is None:
            return {text: s.mean(U) for text, s in self.each.items()}
        return dict(zip(self.each, self._together.mean(self.space.features(U)).T, strict=True))


def learn_surfaces(
    space: Space,
    U: np.ndarray,
    columns: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    *,
    kind: str,
    degree: int | None,
    seed: int,
    held: tuple[np.ndarray, Mapping[str, np.ndarray]] | None = None,
) -> Surfaces:
    """Surfaces of quantities y (n,) by text over points U (n, d).

    ``auto`` chooses by cross-validation as :func:`rso.emulation.fit_surrogate` does; kriging sees each text of a
    category as a column of 0 and 1, and is what ``auto`` takes where there are categories or fewer than five levels.  A
    polynomial is fitted for each combination of categories apart.  Raises ValueError naming the quantity where there
    are too few runs, and where a polynomial's degree needs more levels than a parameter has.
    """
    apart = kind == "polynomial" and bool(space.categories)
    few = [
        n
        for n, v, t in zip(space.names, space.levels, space.labels, strict=True)
        if v and not t and len(v) <= MAX_POLYNOMIAL_DEGREE
    ]
    if kind == "polynomial" and few:
        least = min(len(rows) for rows in _by_category(space, U).values()) if apart else len(U)
        degree = _allowed(space, degree, least)
    if kind == "auto" and (space.categories or few):
        kind = "kriging"
    trends = (0,) if space.categories else (0, 1) if few else (0, 1, 2)
    found = {}
    for text, y in columns.items():
        try:
            models = {}
            for key, rows in _by_category(space, U).items() if apart else [(EVERY_CATEGORY, np.arange(len(U)))]:
                X = space.features(U[rows], categories=not apart)
                seen = None if held is None or apart else (space.features(held[0]), held[1][text])
                names = space.feature_names() if not apart else None
                models[key] = fit_surrogate(
                    kind, X, y[rows], seed=seed, share=None, degree=degree, unit=units[text], names=names, held=seen,
                    trends=trends,
                )  # fmt: skip
            if apart:
                _whole(space, models, text)
        except ValueError as error:
            raise ValueError(f"surface of {text}: {error}") from error
        spread = float(np.sqrt(12.0) * np.std(y))
        found[text] = QuantitySurface(
            space, text, units[text], models, max(spread, 1e-12 * float(np.abs(y).max()), 1e-300)
        )
    return Surfaces(space, found)


def _allowed(space: Space, degree: int | None, runs: int) -> int:
    """The degree of a polynomial over levels, of so many runs; ValueError for a stated one that they do not carry."""
    own = [(len(v) - 1, n) for n, v, t in zip(space.names, space.levels, space.labels, strict=True) if v and not t]
    most, name = min(own)
    if degree is not None and degree > most:
        text = f"surrogate.degree = {degree}: {name} has {most + 1} values, which carry degree {most}; choose kriging"
        raise ValueError(text)
    if degree is not None:
        return degree
    d = space.d - len(space.categories)
    return max([q for q in range(1, most + 1) if len(monomial_exponents(d, q)) < runs], default=1)


def _whole(space: Space, models: Mapping[tuple[int, ...], Any], text: str) -> None:
    every = itertools.product(*(range(len(space.labels[j])) for j in space.categories))
    lost = [key for key in every if key not in models]
    if lost:
        at = ", ".join(space.labels[j][k] for j, k in zip(space.categories, lost[0], strict=True))
        raise ValueError(f"no run has {at}: a polynomial is fitted for each combination of categories; choose kriging")


def _by_category(space: Space, U: np.ndarray) -> dict[tuple[int, ...], np.ndarray]:
    """Rows of points by their categories."""
    keys = space.places(U)[:, list(space.categories)]
    found: dict[tuple[int, ...], list[int]] = {}
    for row, key in enumerate(map(tuple, keys.tolist())):
        found.setdefault(key, []).append(row)
    return {key: np.array(rows) for key, rows in found.items()}


def scores(surfaces: Surfaces, U: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, Scores]:
    """Errors of all surfaces on runs that are new to them."""
    return {text: s.score(U, columns[text]) for text, s in surfaces.each.items()} if len(U) else {}


def nondominated(F: np.ndarray) -> np.ndarray:
    """Mask (n,) of the rows of F (n, m), to be minimised, that no other row is at least as good as in all."""
    keep = np.ones(len(F), bool)
    for k, f in enumerate(F):
        better = np.all(F <= f, axis=1) & np.any(F < f, axis=1)
        keep[k] = not better.any()
    return keep
