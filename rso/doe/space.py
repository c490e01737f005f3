"""Parameters that are not all numbers of a range: whole numbers, lists of values and categories beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.doe.box import Box

CONTINUOUS_DESIGNS = ("ccd", "box_behnken")  # designs that stand at ends and middles of ranges
TOO_FEW_POINTS_MESSAGE = "a design of {n} different points was asked for, and only {m} of them exist"


@dataclass(frozen=True)
class Space:
    """Axes of a search: `box` holds the ranges; `levels` the values of an axis that has only some, () of a range.

    `labels` are the texts of a category, whose values in `box` and `levels` are their numbers 0, 1, …  A point of the
    unit cube u means the level floor(L u) of L on such an axis: each has the same share of the cube.
    """

    box: Box
    levels: tuple[tuple[float, ...], ...]
    labels: tuple[tuple[str, ...], ...]

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.box.d

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return self.box.names

    @property
    def continuous(self) -> np.ndarray:
        """Mask (d,) of the axes that are ranges."""
        return np.array([not v for v in self.levels])

    @property
    def categories(self) -> tuple[int, ...]:
        """Axes without an order."""
        return tuple(j for j, v in enumerate(self.labels) if v)

    def places(self, U: np.ndarray) -> np.ndarray:
        """Which level (n, d) a point of the unit cube is on; 0 on ranges."""
        counts = np.array([max(len(v), 1) for v in self.levels])
        return np.minimum((np.asarray(U, float) * counts).astype(int), counts - 1)

    def snapped(self, U: np.ndarray) -> np.ndarray:
        """The points (n, d) with levels in the middle of their share of the cube: one point for each set of values."""
        U = np.asarray(U, float)
        counts = np.array([max(len(v), 1) for v in self.levels])
        return np.where(self.continuous, U, (self.places(U) + 0.5) / counts)

    def values(self, U: np.ndarray) -> np.ndarray:
        """θ (n, d): values in their units, numbers of categories."""
        theta = self.box.from_unit(np.asarray(U, float))
        at = self.places(U)
        for j, levels in enumerate(self.levels):
            if levels:
                theta[..., j] = np.array(levels)[at[..., j]]
        return theta

    def from_values(self, theta: np.ndarray) -> np.ndarray:
        """Points (n, d) of the cube from values; the nearest level where a value is none."""
        theta = np.asarray(theta, float)
        U = self.box.to_unit(theta)
        for j, levels in enumerate(self.levels):
            if levels:
                at = np.abs(theta[..., j, None] - np.array(levels)).argmin(axis=-1)
                U[..., j] = (at + 0.5) / len(levels)
        return U

    def mapping(self, u: np.ndarray) -> dict[str, float]:
        """Values of one point (d,) by name."""
        return dict(zip(self.names, map(float, self.values(np.asarray(u)[None])[0]), strict=True))

    def features(self, U: np.ndarray, categories: bool = True) -> np.ndarray:
        """What a surrogate sees (n, p): ranges and ordered levels in [0, 1], a category of L texts as L − 1 columns.

        Each is 1 where the category has that text, all are 0 for the first; `categories` False leaves them out.
        """
        scaled = self.box.to_unit(self.values(U))
        at, columns = self.places(U), []
        for j in range(self.d):
            if not self.labels[j]:
                columns.append(scaled[:, j])
            elif categories:
                columns += [(at[:, j] == k).astype(float) for k in range(1, len(self.labels[j]))]
        return np.column_stack(columns) if columns else np.empty((len(U), 0))

    def feature_names(self) -> tuple[str, ...]:
        """Names of the columns of :meth:`features`."""
        found: list[str] = []
        for name, labels in zip(self.names, self.labels, strict=True):
            found += [f"{name} is {v}" for v in labels[1:]] if labels else [name]
        return tuple(found)

    def text(self, name: str, value: float) -> str:
        """A value as people write it, without its unit: the text of a category."""
        j = self.names.index(name)
        return self.labels[j][self.levels[j].index(value)] if self.labels[j] else f"{value:.6g}"

    def worded(self, values: Mapping[str, float]) -> dict[str, float | str]:
        """Values with the texts of categories."""
        return {k: self.text(k, v) if k in self.names and self.labels[self.names.index(k)] else v
                for k, v in values.items()}  # fmt: skip

    def count(self) -> float:
        """How many different points there are, infinite where an axis is a range."""
        return float("inf") if self.continuous.any() else float(np.prod([len(v) for v in self.levels]))


def space(box: Box, levels: Sequence[Sequence[float]], labels: Sequence[Sequence[str]]) -> Space:
    """A space; ValueError where levels are fewer than two, not increasing, or leave the box."""
    for name, own, low, high in zip(box.names, levels, box.low, box.high, strict=True):
        if own and (len(own) < 2 or list(own) != sorted(set(own)) or own[0] != low or own[-1] != high):
            raise ValueError(f"space: {name} needs at least two increasing levels from {low} to {high}, got {own}")
    return Space(box, tuple(map(tuple, levels)), tuple(map(tuple, labels)))


def refusal(kind: str, options: Mapping[str, Any], space: Space) -> str | None:
    """Why a kind of design cannot be of this space, with what can; None where it can."""
    several = [n for n, v in zip(space.names, space.levels, strict=True) if v]
    if several and kind in CONTINUOUS_DESIGNS:
        why = f"{kind} stands at the ends and middles of ranges, and {several[0]} has values of its own"
        return f"{why}; use lhs, sobol, osf or factorial"
    if several and kind == "factorial":
        wanted = [len(v) or None for v in space.levels]
        given = options.get("levels")
        if given is None or any(w is not None and w != g for w, g in zip(wanted, given, strict=False)):
            shown = ", ".join("any" if w is None else str(w) for w in wanted)
            return f"factorial needs levels = [{shown}]: as many as each parameter has values"
    return None


def distinct_runs(space: Space, U: np.ndarray) -> np.ndarray:
    """The points (m, d) of a design that are different runs, in their order, on their levels."""
    snapped = space.snapped(U)
    _, first = np.unique(snapped.round(12), axis=0, return_index=True)
    return snapped[np.sort(first)]
