"""Designs of experiments in the unit cube, and the box that gives the cube its units.

Every design is an array `X` (n, d) with entries in [0, 1]; only :class:`Box` knows physical values.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rso.doe.box import Box
from rso.doe.constraints import Condition, read_condition
from rso.doe.space_filling import (
    MOST_OPTIMISED,
    Feasible,
    extend,
    extend_latin,
    latin,
    optimal_space_filling,
    sobol,
    within,
)
from rso.doe.structured import Alpha, Star, box_behnken, central_composite, factorial, star_distance

__all__ = [
    "KINDS",
    "MOST_OPTIMISED",
    "Alpha",
    "Box",
    "Condition",
    "Feasible",
    "Star",
    "box_behnken",
    "central_composite",
    "design",
    "extend",
    "extend_design",
    "extend_latin",
    "factorial",
    "latin",
    "optimal_space_filling",
    "read_condition",
    "sobol",
    "star_distance",
    "within",
]

KINDS = ("lhs", "sobol", "ccd", "box_behnken", "factorial", "osf")


def design(
    kind: str,
    d: int,
    runs: int | None,
    seed: int,
    *,
    optimise: bool = True,
    star: Star = "circumscribed",
    alpha: Alpha | None = None,
    centres: int = 1,
    levels: Sequence[int] | None = None,
    feasible: Feasible | None = None,
) -> np.ndarray:
    """A design X (n, d) of the named kind in the unit cube.

    `runs` is needed by lhs, sobol and osf; the others have fixed counts: leave it None or state the right one.
    `optimise` lowers the centred discrepancy of an lhs; `star`, `alpha` and `centres` belong to ccd, `levels` to
    factorial.
    `feasible(X)` marks the points that may be run: lhs, sobol and osf keep to these, a factorial leaves the others
    out, ccd and box_behnken must not have any.

    Raises
    ------
    ValueError
        for an unknown kind, a number of runs that the kind does not have (the message says which it has), or
        constraints that the kind cannot keep to.
    """
    if kind not in KINDS:
        raise ValueError(f"design: unknown kind {kind!r}; choose one of {', '.join(KINDS)}")
    if d < 1:
        raise ValueError(f"design: needs at least one parameter, got {d}")
    if kind in ("lhs", "sobol", "osf"):
        if runs is None or runs < 2:
            raise ValueError(f"design: {kind} needs runs >= 2, got {runs}")
        if kind == "osf" and runs > MOST_OPTIMISED:
            raise ValueError(f"design: osf is for up to {MOST_OPTIMISED} runs, got {runs}; use lhs or sobol")
        if feasible is not None:
            return within(kind, d, runs, seed, feasible, optimise)
        if kind == "lhs":
            return latin(d, runs, seed, optimise)
        return sobol(d, runs, seed) if kind == "sobol" else optimal_space_filling(d, runs, seed)
    if kind == "factorial":
        X = factorial(d, runs, levels)
    else:
        X = central_composite(d, star, alpha, centres) if kind == "ccd" else box_behnken(d)
        if runs is not None and runs != len(X):
            text = f"design: {kind} of {d} parameters has {len(X)} runs, not {runs}; leave runs out or use lhs"
            raise ValueError(text)
    if feasible is None:
        return X
    good = np.asarray(feasible(X), bool)
    if kind == "factorial" and good.sum() >= 2:
        return X[good]
    if not good.all():
        raise ValueError(f"design: {np.sum(~good)} of the {len(X)} points of {kind} violate the constraints; use lhs")
    return X


def extend_design(kind: str, existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d) for a finished design of this kind; the old points and their runs stay.

    sobol goes on with its sequence (`existing` must be its beginning), lhs fills rows of cells that are empty
    (:func:`extend_latin`), the others put points where they are thinnest (:func:`extend`).
    """
    if kind == "sobol":
        N, d = np.shape(existing)
        more = sobol(d, N + n, seed) if feasible is None else within("sobol", d, N + n, seed, feasible)
        if not np.array_equal(more[:N], existing):
            raise ValueError("extend: the existing points are not the beginning of this Sobol sequence")
        return more[N:]
    return (extend_latin if kind == "lhs" else extend)(existing, n, seed, feasible)
