"""Holds at constant force: where in a record they begin, and their readings, which creep along the depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rso.core.digits import quantity_text, range_text
from rso.data import curve_shape

MAX_HELD_FORCE_CHANGE_SHARE = 0.02  # of its range that a force may change while it is held
MIN_CREEP_STROKE_SHARE = 0.005  # of the stroke that the depth changes in a hold at constant force, at least
# of its speed of loading that a drive keeps, at least, where only the sensor has come to its end
MIN_KEPT_SPEED_SHARE = 0.8
HELD_FORCE_TOLERANCE = 0.05  # of the force that it may be off by in a hold that a file says to be one


@dataclass(frozen=True, eq=False)
class HeldForce:
    """Readings (m,) of a hold at constant force: time (s), depth (mm), force (N), the stated σ (mm) of the depth."""

    time: np.ndarray
    depth: np.ndarray
    force: np.ndarray
    sigma: np.ndarray


def until(depth: np.ndarray, force: np.ndarray, time: np.ndarray | None, segment: np.ndarray) -> tuple[int, str] | None:
    """How many readings (n,) come before a hold at constant force, and what it is in words; None without one.

    That is a segment of creep, a hold by its segment whose depth changes, or the end of loading, where the force stays
    while the indenter goes on.
    """
    stroke = float(np.ptp(depth))
    said = np.nonzero(segment == "creep")[0]
    if len(said):
        return int(said[0]), _words(depth[said], force[said])
    hold = np.nonzero(segment == "hold")[0]
    creeps = len(hold) > 5 and _drift(depth[hold]) > max(
        MIN_CREEP_STROKE_SHARE * stroke, 6.0 * curve_shape.noise_of(depth)
    )
    if creeps and np.ptp(force[hold]) < MAX_HELD_FORCE_CHANGE_SHARE * np.ptp(force):
        return int(hold[0]), _words(depth[hold], force[hold])
    loading = np.nonzero(segment == "loading")[0]
    if len(loading) < curve_shape.MIN_MACHINE_READINGS or len(hold):
        return None
    d, F = depth[loading], force[loading]
    found = curve_shape.creep(d, F, None if time is None else time[loading])
    if found is None:
        return None
    at = int(np.nonzero(d >= found[0])[0][0])
    return int(loading[at]) + 1, _words(d[at:], F[at:])


def hold_readings(
    first: int, depth: np.ndarray, force: np.ndarray, time: np.ndarray | None, segment: np.ndarray, sigma: np.ndarray
) -> HeldForce | str:
    """The readings of a hold at constant force from the `first` on, or why they cannot be compared with a model."""
    if time is None:
        return "the record has no times"
    kind = segment[first] if first < len(segment) else ""
    other = np.nonzero(segment[first:] != kind)[0]
    at = slice(first, first + int(other[0]) if len(other) else len(depth))
    if kind == "loading":  # as its end tells, where the force may still settle
        end = float(np.median(force[at]))
        at = slice(
            first, first + int(np.nonzero(np.abs(force[at] - end) <= HELD_FORCE_TOLERANCE * abs(end))[0][-1]) + 1
        )
    level = float(np.median(force[at])) if at.stop > at.start else 0.0
    off = float(np.abs(force[at] - level).max()) if level > 0.0 else np.inf
    if not off <= max(
        HELD_FORCE_TOLERANCE * level, 6.0 * curve_shape.noise_of(force[at]) if at.stop - at.start > 5 else 0.0
    ):
        return f"the force there is off its level of {quantity_text(level, 'N')} by up to {quantity_text(off, 'N', 2)}"
    return HeldForce(time[at], depth[at], force[at], sigma[at])


def at_its_end(depth: np.ndarray, time: np.ndarray | None, segment: np.ndarray, first: int) -> bool:
    """Whether the indenter goes on from the `first` of readings (n,) on as fast as before: no machine holds a force so.

    Under a held force a body creeps slower and slower, while a drive that pushes on against a sensor at its end keeps
    its speed to the last.  Only loading says so, with times.
    """
    rest = len(depth) - first
    if time is None or rest < 6 or first < 6 or np.any(segment != "loading"):
        return False
    before, end = slice(max(first - rest, 0), first), slice(len(depth) - rest // 2, len(depth))
    speeds = [float(np.polyfit(time[part], depth[part], 1)[0]) for part in (before, end)]
    return speeds[1] > MIN_KEPT_SPEED_SHARE * speeds[0] > 0.0


def _drift(depth: np.ndarray) -> float:
    """How far the last third of the readings of a hold lies beyond the first."""
    n = len(depth) // 3
    return float(np.median(depth[-n:]) - np.median(depth[:n]))


def _words(depth: np.ndarray, force: np.ndarray) -> str:
    return f"Fz stays at {quantity_text(np.median(force), 'N')} from {range_text(depth.min(), depth.max(), 'mm', 'to')}"
