"""What holds of every ordinary material by the backend's word: ranges are widened to its edge and no further."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from rso.doe import Box, Condition, read_condition, sobol
from rso.study.plan import Plan

NAME = re.compile(r"\b[A-Za-z_]\w*")
POINTS = 1024  # at which a condition is looked at besides the corners of the ranges
CORNERS = 10  # dimensions up to which all corners are


def ordinary(plan: Plan) -> tuple[Condition, ...]:
    """Conditions of the backend that hold all over the plan's ranges: ranges that break one as stated are meant."""
    said: Mapping[str, str] = getattr(plan.backend, "ordinary", dict)()
    found = []
    for text, words in said.items():
        here = NAME.sub(lambda m: repr(plan.resolved.fixed.get(m[0], m[0])).strip("'"), text)
        names = set(NAME.findall(here))
        if names and names <= set(plan.box.names):
            found.append(read_condition(here, plan.box.names, words))
    return tuple(c for c in found if not broken(c, plan.box, plan.seed))


def broken(condition: Condition, box: Box, seed: int) -> bool:
    """Whether a condition is violated somewhere in a box."""
    X = sobol(box.d, POINTS, seed)
    if box.d <= CORNERS:
        X = np.vstack([X, np.array(np.meshgrid(*[(0.0, 1.0)] * box.d)).reshape(box.d, -1).T])
    return bool(np.any(condition.excess(dict(zip(box.names, box.from_unit(X).T, strict=True))) > 0))


def added(conditions: Sequence[Condition], kept: Sequence[Condition], box: Box, seed: int) -> tuple[Condition, ...]:
    """The conditions, with those of `kept` that a wider box would break."""
    there = {c.text for c in conditions}
    return (*conditions, *(c for c in kept if c.text not in there and broken(c, box, seed)))
