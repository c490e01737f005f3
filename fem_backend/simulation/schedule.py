"""Moments of a programme: which are computed once, and the steps between them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem_backend.solver.load_steps import Instant, LoadPoint

REST_STEP_RATIO = 3.0  # times as long as the step before it is a step of a rest
FIRST_DRAINAGE_STEP_SHARE = 0.02  # of the time between two corners of a programme: the first step of a body that drains
DRAINAGE_STEP_GROWTH = 0.2  # of the time since a corner: each step of one
SAME_INSTANT_TOLERANCE = 1e-9  # of the largest: instants and travels nearer than that are computed once


def merged_instants(instants: Sequence[Instant]) -> list[list[Instant]]:
    """Instants in order of time, those within round-off of each other in time and travel side by side."""
    time, travel = (
        SAME_INSTANT_TOLERANCE * max((abs(v) for v in of), default=0.0)
        for of in ([i.time for i in instants], [i.travel for i in instants])
    )
    groups: list[list[Instant]] = []
    for i in instants:
        first = groups[-1][0] if groups else None
        if first is not None and i.time - first.time <= time and abs(i.travel - first.travel) <= travel:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def one_instant(group: Sequence[Instant]) -> Instant:
    """What is computed for instants within round-off of each other: the first that is asked for, or else the first."""
    return next((i for i in group if i.asked), group[0])


def each(groups: Sequence[Sequence[Instant]], points: Sequence[LoadPoint]) -> list[LoadPoint]:
    """A point for every asked instant from one for every group, as many as there are."""
    asked = [[i for i in group if i.asked] for group in groups]
    return [
        replace(point, time=i.time, travel=i.travel)
        for group, point in zip([g for g in asked if g], points, strict=False)
        for i in group
    ]


def merged(travels: Sequence[float]) -> dict[float, float]:
    """Each travel (mm) and the least of those within round-off of it, in increasing order."""
    out: dict[float, float] = {}
    near = SAME_INSTANT_TOLERANCE * max(map(abs, travels), default=0.0)
    for s in sorted(set(travels)):
        least = next(reversed(out.values()), s)
        out[s] = least if s - least <= near else s
    return out


def instants_with_steps(
    instants: Sequence[Instant], largest: float, relaxes: bool = False, begin_at: float = 0.0
) -> list[Instant]:
    """The instants up to the last asked one and, between them, equal steps no larger than `largest` (mm of travel).

    The way begins at the travel `begin_at` (mm).
    What `relaxes` does so in a rest, too: see `rest_times`.
    """
    last = max((k for k, i in enumerate(instants) if i.asked), default=-1)
    still = SAME_INSTANT_TOLERANCE * max((abs(i.travel) for i in instants), default=0.0)
    out: list[Instant] = []
    t, s, began = 0.0, begin_at, 0.0
    for i in instants[: last + 1]:
        count = max(1, int(np.ceil(abs(i.travel - s) / largest - 1e-9)))
        for k in range(1, count):
            out.append(Instant(t + (i.time - t) * k / count, s + (i.travel - s) * k / count, False))
        if abs(i.travel - s) > still:
            began = i.time
        elif relaxes:
            out += [Instant(began + since, s, False) for since in rest_times(t - began, i.time - began)]
        out.append(i)
        t, s = i.time, i.travel
    return out


def flowing(instants: Sequence[Instant], largest: float, pace: float) -> list[Instant]:
    """The instants up to the last asked one and, between them, steps that grow with the time since the last corner.

    A body drains as √t after every change of the rate: steps are `DRAINAGE_STEP_GROWTH` times `pace` of the time since
    then, from a share `FIRST_DRAINAGE_STEP_SHARE` of the time to the next corner or a third of that to the first
    instant, and no longer than `largest` mm of travel times the pace.
    """
    last = max((k for k, i in enumerate(instants) if i.asked), default=-1)
    path = [Instant(0.0, 0.0, False), *instants[: last + 1]]
    slopes = [(b.travel - a.travel) / (b.time - a.time) for a, b in itertools.pairwise(path)]
    near = SAME_INSTANT_TOLERANCE * max((abs(v) for v in slopes), default=0.0)
    corners = [0, *(k for k in range(1, len(slopes)) if abs(slopes[k] - slopes[k - 1]) > near), len(slopes)]
    out: list[Instant] = []
    for a, b in itertools.pairwise(corners):
        began, rate = path[a], slopes[a]
        first = pace * min(
            FIRST_DRAINAGE_STEP_SHARE * (path[b].time - began.time), (path[a + 1].time - began.time) / 3.0
        )
        most = pace * largest / abs(rate) if abs(rate) > near else np.inf
        since = 0.0
        for goal in path[a + 1 : b + 1]:
            until = goal.time - began.time
            for moment in _growing(since, until, first, pace * DRAINAGE_STEP_GROWTH, most):
                out.append(Instant(began.time + moment, began.travel + rate * moment, False))
            out.append(goal)
            since = until
    return out


def _growing(since: float, until: float, first: float, share: float, most: float) -> list[float]:
    """Times (s) between two others, each later by a share of itself, at least by `first` and at most by `most`."""
    times = [since]
    while times[-1] < until:
        times.append(times[-1] + min(max(first, share * times[-1]), most))
    stretch = (until - since) / (times[-1] - since)  # so that the last one is reached
    return [since + stretch * (v - since) for v in times[1:-1]]


def rest_times(since: float, until: float) -> list[float]:
    """Times (s) since a rest began that part it between two others: a third of `until` and a ninth, if so long."""
    return [v for v in (until / REST_STEP_RATIO**2, until / REST_STEP_RATIO) if v > since]
