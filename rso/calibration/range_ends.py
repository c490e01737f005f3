"""The ends of the ranges of a search, and how far each may be moved.

What holds of every ordinary material by the backend's word, and all over the ranges that a study states, holds all over
wider ones too.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.calibration.plan import Plan
from rso.contract import OrdinaryMaterials, capability
from rso.doe import Condition, read_condition
from rso.doe.constraints import EXPRESSION_FUNCTIONS
from rso.study.resolve import Axis

RANGE_GROWTH_SHARE = 0.5  # of its width by which a range grows at a time, on its scale
PARAMETER_NAME = re.compile(r"\b[A-Za-z_]\w*")
CONDITION_TOLERANCE = 1e-9  # by which rounding may break a condition
N_BISECTIONS = 40  # of the step of an end: then it is known to 1e-12 of it


@dataclass(frozen=True)
class RangeEnd:
    """The low (side 0) or high (side 1) end of the range of parameter j."""

    j: int
    side: int

    @property
    def word(self) -> str:
        """What it is called."""
        return ("low", "high")[self.side]

    def of(self, axes: Sequence[Axis]) -> float:
        """Where it is."""
        return (axes[self.j].low, axes[self.j].high)[self.side]


@dataclass(frozen=True, eq=False)
class Stated:
    """The ranges as the study states them, and what holds of every ordinary material all over them."""

    axes: tuple[Axis, ...]
    ordinary: tuple[Condition, ...]


def end_limit(plan: Plan, axes: Sequence[Axis], stated: Stated, e: RangeEnd) -> tuple[float, str]:
    """How far an end may go while the others stay where they are, and what ends it there, in words."""
    axis, before, side = axes[e.j], stated.axes[e.j], e.side
    told, hard = plan.study.search.repair_limit, (axis.parameter.low, axis.parameter.high)[side]
    words = ""
    # The modulus that similarity scales out must stay positive.
    if axis.scale == "log" or (axis.name == plan.group.reference and side == 0):
        factor = before.high / before.low if told is None and before.low > 0 else told or 1.0
        far = before.low / factor if side == 0 else before.high * factor
    else:
        width = (1.0 if told is None else told) * (before.high - before.low)
        far = before.low - width if side == 0 else before.high + width
        if before.low * before.high >= 0 and far * (before.low + before.high) < 0:
            far, words = 0.0, "is where the parameter would change its sign: who means that states it"
    beyond = hard >= far if side == 0 else hard <= far
    far, words = (hard, "is the hard bound") if beyond else (far, words)
    return _kept(axes, stated.ordinary, e, far) or (far, words)


def _kept(axes: Sequence[Axis], conditions: Sequence[Condition], e: RangeEnd, far: float) -> tuple[float, str] | None:
    """The place nearest to `far` where an end breaks no condition, and which one is next; None where `far` does not."""
    what = broken(conditions, with_ends(axes, {e: far}))
    if not what:
        return None
    good, bad = e.of(axes), far
    for _ in range(N_BISECTIONS):
        middle = float(np.sqrt(good * bad)) if axes[e.j].scale == "log" else 0.5 * (good + bad)
        good, bad = (good, middle) if broken(conditions, with_ends(axes, {e: middle})) else (middle, bad)
    return good, f"is where the ranges still have {what} all over: who means more states more"


def room(axes: Sequence[Axis], stated: Stated, e: RangeEnd, plan: Plan) -> bool:
    """Whether an end may still be moved."""
    far, _ = end_limit(plan, axes, stated, e)
    now = e.of(axes)
    return now > far * (1 + 1e-9) if e.side == 0 and far > 0 else abs(far - now) > 1e-9 * max(abs(far), abs(now))


def moved_to(plan: Plan, axes: Sequence[Axis], stated: Stated, e: RangeEnd, share: float, whole: bool) -> float:
    """Where an end goes next: to its limit where the `whole` way is wanted, else a `share` of a step."""
    far, _ = end_limit(plan, axes, stated, e)
    if whole:
        return far
    axis = axes[e.j]
    out = -1 if e.side == 0 else 1
    now = (axis.low, axis.high)[e.side]
    if axis.scale == "log":
        to = now * (axis.high / axis.low) ** (out * RANGE_GROWTH_SHARE * share)
    else:
        to = now + out * RANGE_GROWTH_SHARE * share * (axis.high - axis.low)
    return max(to, far) if e.side == 0 else min(to, far)


def with_ends(axes: Sequence[Axis], wider: Mapping[RangeEnd, float]) -> tuple[Axis, ...]:
    """The axes with some ends moved."""
    changed = list(axes)
    for e, to in wider.items():
        changed[e.j] = replace(changed[e.j], low=to) if e.side == 0 else replace(changed[e.j], high=to)
    return tuple(changed)


def ordinary(plan: Plan) -> tuple[Condition, ...]:
    """Conditions of the backend that hold all over the plan's ranges: ranges that break one as stated are meant."""
    conditions = capability(plan.backend, OrdinaryMaterials)
    said = conditions.ordinary() if conditions else {}
    fixed, axes = plan.resolved.fixed, plan.searches[0].axes
    found = []
    for text, words in said.items():
        here = PARAMETER_NAME.sub(lambda m: f"({fixed[m[0]]!r})" if m[0] in fixed else m[0], text)
        names = set(PARAMETER_NAME.findall(here)) - EXPRESSION_FUNCTIONS.keys()
        if names and names <= {a.name for a in axes}:
            found.append(read_condition(here, [a.name for a in axes], words))
    return tuple(c for c in found if not broken([c], axes))


def broken(conditions: Sequence[Condition], axes: Sequence[Axis]) -> str:
    """What is said of the first condition that a corner of the ranges violates; empty where none does."""
    corners = np.array(list(itertools.product(*((a.low, a.high) for a in axes))))
    theta = dict(zip([a.name for a in axes], corners.T, strict=True))
    return next((c.words or c.text for c in conditions if np.any(c.excess(theta) > CONDITION_TOLERANCE)), "")
