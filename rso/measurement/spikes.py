"""Single readings that jump out of line: found and left out, with a note."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from rso.measurement.reading import Measurement, Repeat

SPIKE = 8.0  # robust standard deviations from its neighbours: no reading of its own
MOST_SPIKES = 0.2  # of the readings: more of them are no spikes but the signal


def without_spikes(measurement: Measurement) -> tuple[Measurement, list[str]]:
    """The measurement without single readings that jump out of line, and a note for each repeat that has some."""
    if measurement.kind != "force":
        return measurement, []
    repeats, notes = [], []
    for r in measurement.repeats:
        wild = _wild(r)
        if wild.any():
            depths = ", ".join(f"{v:.2f}" for v in r.depth[wild][:3]) + (", …" if wild.sum() > 3 else "")
            notes.append(f"repeat {r.label}: {wild.sum()} reading(s) out of line left out, at {depths} mm")
            r = kept(r, ~wild)
        repeats.append(r)
    return replace(measurement, repeats=tuple(repeats)), notes


def kept(r: Repeat, keep: np.ndarray) -> Repeat:
    """The readings of a repeat in a mask (n,)."""
    parts = {k: {c: v[keep] for c, v in getattr(r, k).items()} for k in ("channels", "sigma")}
    time = None if r.time is None else r.time[keep]
    return replace(r, depth=r.depth[keep], time=time, segment=r.segment[keep], **parts)


def _wild(r: Repeat) -> np.ndarray:
    """Readings that stand alone: further than SPIKE standard deviations from the median of the five around them.

    The deviation is a robust one of the branch itself, 1.48 times the median of its third differences, and at least the
    step in which the sensor counts; jumps and slopes pass, single spikes do not (Hampel 1974).
    """
    wild = np.zeros(len(r.depth), bool)
    for name in ("loading", "unloading"):
        at = np.nonzero(r.segment == name)[0]
        if len(at) < 12:
            continue
        for c in r.channels:
            v = r.channels[c][at]
            d = np.abs(v - median_filter(v, 5, mode="nearest"))
            scatter = 1.48 * np.median(np.abs(np.diff(v, 3))) / math.sqrt(20.0)  # variance of a third difference
            wild[at[d > SPIKE * max(scatter, 1e-4 * np.median(np.abs(v)), step_of(v))]] = True
    return wild if wild.mean() < MOST_SPIKES else np.zeros(len(wild), bool)


def step_of(values: np.ndarray) -> float:
    """Step in which a sensor counts: the smallest difference of neighbours where most of them are equal, else 0."""
    steps = np.abs(np.diff(values))
    moves = steps[steps > 0]
    return float(moves.min()) if len(moves) and np.median(steps) == 0.0 else 0.0
