"""Programmes of travel and force: what of them is refused, and what the solver follows."""

from __future__ import annotations

import itertools

from fem_backend.meshing import LIMIT_LEVEL
from fem_backend.simulation.experiment import Settings
from fem_backend.solver.controlled_steps import Drive, Leg
from rso.contract import Programme, Segment

PULL_OFF_WORDS = "; a pull-off has no segments: time_s and travel_mm, which may end below 0, above the specimen"


def goals(programme: Programme) -> tuple[float, float]:
    """The largest travel (mm) and force (N) that a programme goes to, 0 where none is given."""
    travel = max((s.to_mm or 0.0 for s in programme.segments if s.to_N is None), default=0.0)
    force = max((s.to_N or 0.0 for s in programme.segments), default=0.0)
    return max(travel, *programme.travel_mm, 0.0), force


def controlled(programme: Programme) -> bool:
    """Whether a programme is followed as legs, not as travel through waypoints."""
    return bool(programme.segments) or programme.forced


def check_programme(programme: Programme, settings: Settings, deepest: float) -> None:
    """Raise ValueError for segments and asked forces that are not modelled, naming key, value, unit and bounds."""
    if settings.level == LIMIT_LEVEL:
        raise ValueError(f'mesh.level = "{LIMIT_LEVEL}": its forces are extrapolated at a travel; take "reference"')
    for k, s in enumerate(programme.segments):
        name = f"programme: segments[{k}]"
        if s.to_mm is not None and not 0.0 <= s.to_mm <= deepest:
            raise ValueError(f"{name}.to_mm = {s.to_mm:g} mm: from 0 (first contact) to {deepest:g} mm{PULL_OFF_WORDS}")
        if s.to_N is not None and s.to_N <= 0.0:
            raise ValueError(
                f"{name}.to_N = {s.to_N:g} N: a positive force; where the indenter hardly touches, its travel is "
                f'controlled (control = "travel", to_mm){PULL_OFF_WORDS}'
            )
    if any(f <= 0.0 for f in programme.asked_N):
        raise ValueError(f"programme: asked_N = {list(programme.asked_N)} N: positive forces")
    if any(s > deepest for s in programme.asked_mm):
        raise ValueError(f"programme: asked_mm = {list(programme.asked_mm)} mm: at most {deepest:g} mm")


def driven(programme: Programme, deepest: float, why: str) -> Drive:
    """What the solver follows: legs from first contact, at most to the `deepest` travel (mm)."""
    legs = [_leg(s) for s in programme.segments] or _waypoints(programme)
    return Drive(_with_moments(tuple(legs), programme), programme.asked_mm, programme.asked_N, deepest, why)


def _leg(s: Segment) -> Leg:
    return Leg(s.control == "force", s.rate or 0.0, s.to_mm, s.to_N, s.hold_s, s.asked_s)


def _waypoints(programme: Programme) -> list[Leg]:
    legs = []
    points = zip(programme.time_s, programme.travel_mm, strict=True)
    for (t0, s0), (t1, s1) in itertools.pairwise(points):
        legs.append(Leg(False, abs(s1 - s0) / (t1 - t0), to_mm=s1) if s1 != s0 else Leg(False, lasts=t1 - t0))
    return legs


def _with_moments(legs: tuple[Leg, ...], programme: Programme) -> tuple[Leg, ...]:
    """Moments since the programme's start handed to the legs in which they lie."""
    if not programme.asked_s:
        return legs
    origin = programme.time_s[0] if programme.time_s else 0.0
    moments, begins, at, out = [m - origin for m in programme.asked_s], 0.0, {False: 0.0, True: 0.0}, []
    for leg in legs:
        end = leg.to_N if leg.forced else leg.to_mm
        lasts = leg.lasts if leg.lasts is not None else abs((end or 0.0) - at[leg.forced]) / leg.rate
        last = begins + lasts
        slack = 1e-12 * max(last, 1.0)
        mine = [min(m - begins, lasts) for m in moments if begins + slack < m <= last + slack]
        out.append(Leg(leg.forced, leg.rate, leg.to_mm, leg.to_N, leg.lasts, tuple(sorted({*leg.asked, *mine}))))
        begins, at[leg.forced] = last, at[leg.forced] if end is None else end
    return tuple(out)
