"""Runs that are in the store already and say something of this study: they join what its surrogates learn from.

They are of the same model: asked with this backend and these cases, their run keys would be those of the store.  Which
they are is noted in results.json when a study begins, so that a study that is interrupted goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.stored_runs import Values, stored_points
from rso.emulation.emulator import reduced_box
from rso.evaluation.store import RunStore

MAX_JOINED_RUNS = 200  # runs that join: kriging takes the third power of their number
INSIDE_BOX_TOLERANCE = 1e-9  # of the unit cube


@dataclass(frozen=True)
class Joined:
    """Points that were run before, within the ranges, that join; how many lie outside of them, were of another model.

    `left` is the number of those within that would be too many: those that lie farthest apart join.
    """

    points: tuple[Values, ...] = ()
    outside: int = 0
    other: int = 0
    left: int = 0

    @property
    def story(self) -> str:
        """What is in the store and what becomes of it, in one sentence; empty for an empty store."""
        said = []
        if self.points or self.outside or self.left:
            text = f"{len(self.points)} earlier runs of this model lie within the ranges and train the surrogates too"
            said.append(text + (f", those of {len(self.points) + self.left} that lie farthest apart" * bool(self.left)))
        if self.outside:
            said.append(f"{self.outside} lie outside the ranges and are not")
        if self.other:
            said.append(f"{self.other} stored runs have other settings, depths or fixed values, or another backend")
        return "; ".join(said)


def joined(plan: Plan, store: RunStore, before: Mapping[str, Any] | None) -> Joined:
    """What of the store joins; with the results of an earlier call of the same study (`before`) the same as then."""
    known = (before or {}).get("joined")
    if isinstance(known, dict):
        counts = {k: int(known.get(k) or 0) for k in ("outside", "other", "left")}
        return Joined(tuple(known.get("points") or ()), **counts)
    return find_stored_points(plan, store)


def find_stored_points(plan: Plan, store: RunStore) -> Joined:
    """Points all of whose cases are stored (done, or failed: where there is no answer is worth knowing too)."""
    known = stored_points(plan, store)
    stored = {r.key for r in store.rows() if r.state != "crashed"}
    other = len(stored - {key for point in known for key in point.keys})
    inside = [p.values for p in known if _inside(plan, p.values)]
    chosen = _apart(plan, inside)
    return Joined(tuple(chosen), len(known) - len(inside), other, len(inside) - len(chosen))


def _inside(plan: Plan, values: Values) -> bool:
    """Whether a point lies within the ranges, or by similarity stands for points that do."""
    row = np.array([values[n] for n in plan.box.names])
    reduced = reduced_box(plan.box, plan.group)
    if plan.group.reference is not None and reduced is not None and values[plan.group.reference] > 0:
        theta = plan.group.reduce({n: values[n] for n in plan.box.names})[1]
        x = reduced.to_unit(np.array([[theta[n] for n in reduced.names]]))[0]
        if np.all((x >= -INSIDE_BOX_TOLERANCE) & (x <= 1 + INSIDE_BOX_TOLERANCE)):
            return True
    within = all(lo <= v <= hi for lo, v, hi in zip(plan.box.low, row, plan.box.high, strict=True))
    return within and bool(plan.feasible(plan.box.to_unit(row[None]))[0])


def _apart(plan: Plan, points: Sequence[Values]) -> list[Values]:
    """At most `MAX_JOINED_RUNS` of the points, those that lie farthest apart, in their order."""
    if len(points) <= MAX_JOINED_RUNS:
        return list(points)
    X = plan.box.to_unit(np.array([[v[n] for n in plan.box.names] for v in points]))
    chosen = [0]
    gap = np.linalg.norm(X - X[0], axis=1)
    while len(chosen) < MAX_JOINED_RUNS:
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, np.linalg.norm(X - X[chosen[-1]], axis=1))
    return [points[k] for k in sorted(chosen)]
