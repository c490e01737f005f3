"""Holds at constant force: the body creeps there, which a model driven by travel cannot express yet."""

from __future__ import annotations

import numpy as np

from rso.data import curve_shape

CONSTANT = 0.02  # of its range that a force may change while it is held
CREEPS = 0.005  # of the stroke that the depth changes in a hold at constant force, at least


def until(depth: np.ndarray, force: np.ndarray, time: np.ndarray | None, segment: np.ndarray) -> tuple[int, str] | None:
    """How many readings (n,) come before a hold at constant force, and what it is in words; None without one.

    That is a hold by its segment, or the end of loading, where the force stays while the indenter goes on.
    """
    stroke = float(np.ptp(depth))
    hold = np.nonzero(segment == "hold")[0]
    creeps = len(hold) > 5 and _drift(depth[hold]) > max(CREEPS * stroke, 6.0 * curve_shape.noise_of(depth))
    if creeps and np.ptp(force[hold]) < CONSTANT * np.ptp(force):
        return int(hold[0]), _words(depth[hold], force[hold])
    loading = np.nonzero(segment == "loading")[0]
    if len(loading) < curve_shape.FEW or len(hold):
        return None
    d, F = depth[loading], force[loading]
    found = curve_shape.creep(d, F, None if time is None else time[loading])
    if found is None:
        return None
    at = int(np.nonzero(d >= found[0])[0][0])
    return int(loading[at]) + 1, _words(d[at:], F[at:])


def _drift(depth: np.ndarray) -> float:
    """How far the last third of the readings of a hold lies beyond the first."""
    n = len(depth) // 3
    return float(np.median(depth[-n:]) - np.median(depth[:n]))


def _words(depth: np.ndarray, force: np.ndarray) -> str:
    return f"Fz stays at {np.median(force):.3g} N from {depth.min():.3g} to {depth.max():.3g} mm"
