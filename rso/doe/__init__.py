"""Designs of experiments in the unit cube, and the box that gives the cube its units.

Every design is an array `X` (n, d) with entries in [0, 1]; only :class:`Box` knows physical values.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rso.doe.box import Box
from rso.doe.constraints import Condition, read_condition
from rso.doe.farthest import extend
from rso.doe.registry import SAMPLERS
from rso.doe.sampler import MAX_OPTIMISED_RUNS, DesignTask, Feasible, Options, Sampler
from rso.doe.samplers.box_behnken import box_behnken
from rso.doe.samplers.central_composite import central_composite, star_distance
from rso.doe.samplers.factorial import factorial
from rso.doe.samplers.latin_hypercube import extend_latin, latin, latin_within
from rso.doe.samplers.optimal_space_filling import optimal_space_filling
from rso.doe.sequences import sobol_sequence
from rso.doe.space import Space, space

__all__ = [
    "MAX_OPTIMISED_RUNS",
    "SAMPLERS",
    "Box",
    "Condition",
    "DesignTask",
    "Feasible",
    "Options",
    "Sampler",
    "Space",
    "box_behnken",
    "central_composite",
    "design",
    "extend",
    "extend_design",
    "extend_latin",
    "factorial",
    "latin",
    "latin_within",
    "optimal_space_filling",
    "read_condition",
    "sobol_sequence",
    "space",
    "star_distance",
]


def design(
    kind: str, d: int, runs: int | None, seed: int, *, feasible: Feasible | None = None, **options: Any
) -> np.ndarray:
    """A design X (n, d) of the named kind in the unit cube.

    `runs` is needed by kinds that leave it free; the others have fixed counts: leave it None or state the right one.
    `options` are those of the kind (:class:`Sampler`), others are passed over.  `feasible(X)` marks the points that
    may be run.

    Raises
    ------
    ValueError
        for an unknown kind, a number of runs that the kind does not have (the message says which it has), or
        constraints that the kind cannot keep to.
    """
    if kind not in SAMPLERS:
        raise ValueError(f"design: unknown kind {kind!r}; choose one of {', '.join(SAMPLERS)}")
    if d < 1:
        raise ValueError(f"design: needs at least one parameter, got {d}")
    mine = {k: v for k, v in options.items() if k in SAMPLERS[kind].options}
    return SAMPLERS[kind].points(DesignTask(d, runs, seed, mine, feasible))


def extend_design(kind: str, existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d) for a finished design (N, d) of this kind; the old points and their runs stay.

    A kind that is not a sampler's (points of a file) gets points where they are thinnest (:func:`extend`).
    """
    task = DesignTask(np.shape(existing)[1], None, seed, {}, feasible)
    return SAMPLERS[kind].extend(existing, n, task) if kind in SAMPLERS else extend(existing, n, seed, feasible)
