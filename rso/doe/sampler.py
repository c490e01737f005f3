"""What a sampler is: one file of `rso.doe.samplers` with a `SAMPLER`, and nothing else anywhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MAX_OPTIMISED_RUNS = 1000  # runs up to which a design is optimised, within about a second
Feasible = Callable[[np.ndarray], np.ndarray]
Options = Mapping[str, Any]


@dataclass(frozen=True)
class DesignTask:
    """A design of d parameters that is asked for: `runs` points, or as many as the kind has where None.

    `options` are the keys of [doe] that belong to this kind alone; `feasible(X)` (n,) marks the points (n, d) of the
    unit cube that may be run, all where None.
    """

    d: int
    runs: int | None
    seed: int
    options: Options
    feasible: Feasible | None = None


@dataclass(frozen=True)
class Sampler:
    """A kind of design, by its name in `doe.kind`.

    `points(task)` gives X (n, d) in the unit cube, every point feasible; ValueError for what the kind cannot do, with
    what it can.  `free` says that the number of runs is chosen freely.  `options` are the keys of [doe] that belong to
    this kind alone.  `extend(X, n, task)` gives n further points (n, d) for a finished design; `wider(d, options)` is
    how many times as wide as the stated ranges the box is whose unit cube the points fill.
    """

    name: str
    title: str
    points: Callable[[DesignTask], np.ndarray]
    extend: Callable[[np.ndarray, int, DesignTask], np.ndarray]
    free: bool = False
    options: tuple[str, ...] = ()
    wider: Callable[[int, Options], float] = lambda d, options: 1.0


def enough(kind: str, task: DesignTask, most: int | None = None) -> int:
    """The number of runs of a kind that leaves it free; ValueError for fewer than two or more than `most`."""
    runs = task.runs
    if runs is None or runs < 2:
        raise ValueError(f"design: {kind} needs runs >= 2, got {runs}")
    if most is not None and runs > most:
        raise ValueError(f"design: {kind} is for up to {most} runs, got {runs}; use lhs or sobol")
    return runs


def design_of_fixed_size(kind: str, X: np.ndarray, task: DesignTask) -> np.ndarray:
    """A design of a kind whose number of points is fixed; ValueError for another number, or points not feasible."""
    if task.runs is not None and task.runs != len(X):
        text = f"design: {kind} of {task.d} parameters has {len(X)} runs, not {task.runs}; leave runs out or use lhs"
        raise ValueError(text)
    if task.feasible is not None and not (good := np.asarray(task.feasible(X), bool)).all():
        raise ValueError(f"design: {np.sum(~good)} of the {len(X)} points of {kind} violate the constraints; use lhs")
    return X
