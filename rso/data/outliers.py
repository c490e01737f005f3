"""Single readings that jump out of line: found and left out, with a note."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rso.data.files.reading import Measurement, Repeat

MIN_SPIKE_SD = 8.0  # robust standard deviations from its neighbours: no reading of its own
MAX_SPIKES_SHARE = 0.2  # of the readings: more of them are no spikes but the signal
N_NOISE_DIFFERENCES = 25  # third differences that tell the noise around a reading; a spike is in four of them
MIN_BACK_BEND_SHARE = 0.25  # of its bend: a reading that stands alone bends the line back beside it
MIN_READINGS_FOR_OUTLIERS = 12  # readings of a branch that tell anything
PRINT_ROUNDING_TOLERANCE = 0.1  # of a step: rounding in print
MAX_STEPS_PER_GAP = 5  # steps in the least gap between readings, at most
# of the range of the others: a first or last reading this far from its neighbour may be a mistake
END_OUTLIER_SHARE = 0.05


def without_spikes(measurement: Measurement) -> tuple[Measurement, list[str]]:
    """The measurement without single readings that jump out of line, and a note for each repeat that has some."""
    if measurement.kind != "force":
        return measurement, []
    repeats, notes = [], []
    for r in measurement.repeats:
        wild = _wild(r)
        if wild.any():
            depths = ", ".join(f"{v:.3g}" for v in r.depth[wild][:3]) + (", …" if wild.sum() > 3 else "")
            notes.append(f"repeat {r.label}: {wild.sum()} reading(s) out of line left out, at {depths} mm")
            r = kept(r, ~wild)
        repeats.append(r)
    return replace(measurement, repeats=tuple(repeats)), notes


def kept(r: Repeat, keep: np.ndarray) -> Repeat:
    """The readings of a repeat in a mask (n,)."""
    channels, sigma = ({c: v[keep] for c, v in part.items()} for part in (r.channels, r.sigma))
    time = None if r.time is None else r.time[keep]
    return replace(r, depth=r.depth[keep], time=time, segment=r.segment[keep], channels=channels, sigma=sigma)


def _wild(r: Repeat) -> np.ndarray:
    """Readings that stand alone: further than MIN_SPIKE_SD standard deviations from the median of the five around them.

    The deviation is a robust one, 1.48 times the median of the third differences, of the branch or of the
    `N_NOISE_DIFFERENCES` around the reading, whichever is larger, as noise may grow with the force; at least the step
    in which the sensor counts. Jumps and slopes pass, single spikes do not (Hampel 1974).  Neither is a wave of a few
    readings, nor what stands beside the first or last reading, which have a rule of their own.
    """
    wild = np.zeros(len(r.depth), bool)
    for name in ("loading", "unloading"):
        at = np.nonzero(r.segment == name)[0]
        while len(at) >= MIN_READINGS_FOR_OUTLIERS:  # again, for a spike beside a larger one
            values = [r.channels[c][at] for c in r.channels]
            out = np.any([_ends(r.depth[at], v) for v in values], axis=0)
            out &= [at[0] == 0, *[False] * (len(at) - 2), at[-1] == len(wild) - 1]
            if not out.any():  # else they would be beside others
                out = np.any([_far(v) & _alone(v) for v in values], axis=0)
            if not out.any():
                break
            wild[at[out]] = True
            at = at[~out]
    return wild if wild.mean() < MAX_SPIKES_SHARE else np.zeros(len(wild), bool)


def _far(v: np.ndarray) -> np.ndarray:
    """Readings further than MIN_SPIKE_SD standard deviations or steps of the sensor from the median of five around
    them."""
    from scipy.ndimage import median_filter  # start-up that only records need

    third = 1.48 * np.abs(np.diff(v, 3)) / math.sqrt(20.0)  # variance of a third difference
    least = max(np.median(third), 1e-4 * np.median(np.abs(v)), step_of(v))
    around = np.median(np.lib.stride_tricks.sliding_window_view(third, min(N_NOISE_DIFFERENCES, len(third))), axis=1)
    beside = np.arange(len(v)) - 0.5 * (len(v) - len(around))  # at the ends the outermost whole window counts
    scatter = np.maximum(np.interp(beside, np.arange(len(around)), around), least)
    return np.abs(v - median_filter(v, 5, mode="nearest")) > MIN_SPIKE_SD * scatter


def _alone(v: np.ndarray) -> np.ndarray:
    """Whether the line bends back by MIN_BACK_BEND_SHARE of the bend at a reading within two readings before and behind
    it."""
    bend = np.zeros(len(v) + 4)  # two more at either end
    bend[3:-3] = v[1:-1] - 0.5 * (v[:-2] + v[2:])
    back = -np.sign(bend[2:-2]) * [bend[:-4], bend[1:-3], bend[3:-1], bend[4:]]
    enough = back > MIN_BACK_BEND_SHARE * np.abs(bend[2:-2])
    before, behind = np.any(enough[:2], axis=0), np.any(enough[2:], axis=0)
    before[1] = behind[-2] = True  # nothing is known of what lies there
    return before & behind


def _ends(depth: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The first and the last reading where they are far beside their neighbours, though no farther on their way."""
    out = np.zeros(len(v), bool)
    for end, u, f in ((0, depth[::-1], v[::-1]), (-1, depth, v)):
        way, step = np.abs(np.diff(u)), np.abs(np.diff(f))
        far = step[-1] > max(END_OUTLIER_SHARE * np.ptp(f[:-1]), MIN_SPIKE_SD * step[:-1].max())
        out[end] = far and way[-1] <= 2.0 * way[:-1].max()
    return out


def step_of(values: np.ndarray) -> float:
    """Step in which a sensor counts: the largest of which all differences of readings are multiples; 0 of few readings
    or where there is none.

    Of eleven gaps between readings that are not counted one in 10⁷ sets is taken for counted.
    """
    gaps = np.diff(np.unique(values))
    if (
        len(values) < MIN_READINGS_FOR_OUTLIERS
        or len(gaps) == 0
        or (len(gaps) == len(values) - 1 and np.ptp(gaps) < PRINT_ROUNDING_TOLERANCE * gaps[0])
    ):
        return 0.0  # equal gaps of a straight line are no steps
    for parts in range(1, MAX_STEPS_PER_GAP + 1):
        multiple = parts * gaps / gaps.min()
        if np.all(np.abs(multiple - np.round(multiple)) < PRINT_ROUNDING_TOLERANCE):
            return float(gaps.min()) / parts
    return 0.0
