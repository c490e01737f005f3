"""Branches of a test whose file does not say them: loading, a hold at the deepest point, unloading."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rso.core.digits import quantity_text, range_text
from rso.data import curve_shape, plausibility

SEGMENTS = ("loading", "hold", "creep", "unloading")
SKIP_SEGMENT = "skip"  # what a study calls a segment of a file that is not of the test: an approach, a preload
_SECOND_TURN_SHARE = 0.2  # of the stroke: a second turn by more means several tests in one
_MAX_LEAPS_SHARE, _MIN_LEAPING = 0.25, 12  # of the steps that go so far, and readings that show it: rows in no order
_SAME_START_SHARE = 0.1  # of the stroke: where the cycles of a record begin
_MAX_LISTED_CYCLES = 8  # cycles that a message lists
# At rest: this near the deepest level, as a share of the stroke, for this many times as long as passing by takes.
_REST_DEPTH_SHARE, _REST_DURATION_RATIO = 0.0025, 4.0
_ARRIVAL_DEPTH_SHARE = 0.0005  # of the deepest level: this near it a machine has arrived
_MAX_AWAY_SHARE = 0.05  # of the readings of a rest may lie outside it


def segments(path: Path, label: str, depth: np.ndarray, time: np.ndarray | None) -> np.ndarray:
    """Loading up to the deepest point, unloading after it; where times are known a rest there is a hold."""
    stroke = float(np.ptp(depth))
    k = int(np.argmax(depth))
    after = depth[k:]
    leaps = np.abs(np.diff(depth)) > _SECOND_TURN_SHARE * stroke
    if len(depth) > _MIN_LEAPING and np.mean(leaps) > _MAX_LEAPS_SHARE and not _cycles_in_words(path, depth):
        raise ValueError(
            f"{path}: repeat {label!r}: column 'depth' leaps to and fro by more than "
            f"{quantity_text(_SECOND_TURN_SHARE * stroke, 'mm', 2)} from row to row: the rows stand in no order. Sort "
            "them by time, those of one loading by depth"
        )
    if _turned(depth) > _SECOND_TURN_SHARE * stroke:
        below = -float(depth.min()) > float(depth.max())
        sign = f"; column 'depth' is mostly negative: {plausibility.TURN_SIGN_ADVICE}" if below else ""
        if not below and _turned(-depth) <= _SECOND_TURN_SHARE * stroke:
            sign = (
                f"; or column 'depth', which falls from {range_text(depth[0], depth.min(), 'mm', 'to', 6)} and "
                f"comes back, is a "
                f"height: {plausibility.TURN_SIGN_ADVICE} and {plausibility.SUBTRACT_ZERO_ADVICE}"
            )
        raise ValueError(
            f"{path}: repeat {label!r} turns back more than once within "
            f"{quantity_text(stroke, 'mm', 6)}{_cycles_in_words(path, depth)}. "
            "Add a column 'repeat', or name the one that counts the tests: repeat = { header = … } in [columns] of the "
            f"study. Or add 'segment' with {', '.join(SEGMENTS)}{sign}"
        )
    segment = np.full(len(depth), "loading", dtype="<U9")
    if depth[k] - after.min() > curve_shape.JITTER_STROKE_SHARE * stroke:
        segment[k + 1 :] = "unloading"
    if time is not None:
        segment[_at_rest(depth, time)] = "hold"
    return segment


def cycles(depth: np.ndarray) -> list[slice]:
    """The tests of a record (n,) that goes down and up several times, each from where it turned upwards to the next.

    A turn counts that is longer than `_SECOND_TURN_SHARE` of the stroke.  Empty where there are less than two, or where
    one begins elsewhere than the record: that one is no test from contact on.
    """
    least = _SECOND_TURN_SHARE * float(np.ptp(depth))
    falling, extreme, starts = False, 0, [0]
    for k, u in enumerate(depth):
        if (u < depth[extreme]) == falling and u != depth[extreme]:
            extreme = k  # it goes on
        elif abs(u - depth[extreme]) > least:
            starts += [extreme] * falling
            falling, extreme = not falling, k
    ends = [*starts[1:], len(depth)]
    alike = np.ptp(depth[starts]) <= _SAME_START_SHARE * float(np.ptp(depth))
    return [slice(a, b) for a, b in zip(starts, ends, strict=True)] if len(starts) > 1 and alike else []


def cycle_rows(path: Path, number: int, depth: np.ndarray) -> slice:
    """The rows of the cycle that a file's name asks for; ValueError where there is none of that number."""
    found = cycles(depth)
    if not found and number == 1:
        return slice(None)
    if number > len(found):
        many = f"{len(found)} cycles" if found else "1"
        raise ValueError(f"{path}: has no block {number}; it holds {many}")
    return found[number - 1]


def _cycles_in_words(path: Path, depth: np.ndarray) -> str:
    """How a record's cycles are named, where it has some."""
    found = [(n, float(depth[part].max())) for n, part in enumerate(cycles(depth), 1)]
    if not found:
        return ""
    each = ", ".join(f"{path.name}#{n} to {quantity_text(peak, 'mm', 4)}" for n, peak in found[:_MAX_LISTED_CYCLES])
    return f": {len(found)} cycles. Name the one that is meant: {each}{', …' * (len(found) > _MAX_LISTED_CYCLES)}"


def _turned(depth: np.ndarray) -> float:
    """The longest way (mm) against that of one loading and one unloading."""
    k = int(np.argmax(depth))
    before, after = depth[: k + 1], depth[k:]
    backwards = np.max(np.maximum.accumulate(before) - before)
    return float(max(backwards, np.max(after - np.minimum.accumulate(after))))


def _at_rest(depth: np.ndarray, time: np.ndarray) -> slice:
    """Readings of a rest at the deepest point: there for _REST_DURATION_RATIO times as long as the way just before and
    after it takes.

    There is within a share of the stroke or the noise; just before and after is from there to four times as far below.
    """
    noise = curve_shape.noise_of(depth)
    top = float(depth.max())
    on_the_way = depth[: int(np.argmax(depth > 0.95 * top))]
    steps = np.abs(np.diff(on_the_way))
    coarse = len(steps) > 0 and np.median(steps) == 0.0  # an encoder, on whose steps readings stand even on the way
    step = float(steps[steps > 0].min()) if coarse and steps.any() else 0.0
    width = max(_REST_DEPTH_SHARE * (top - max(float(depth.min()), 0.0)), 6.0 * noise, 1.5 * step)
    level = float(np.median(depth[depth >= top - width]))
    there = np.nonzero(depth >= level - width)[0]
    below = np.nonzero(depth < level - 4.0 * width)[0]
    before, after = below[below < there[0]], below[below > there[-1]]
    if len(there) < 2 or not len(before):
        return slice(0, 0)
    if np.mean(depth[there[0] : there[-1] + 1] < level - width) > _MAX_AWAY_SHARE:
        return slice(0, 0)  # it went up in between
    beside = _between(time, depth, int(before[-1]), int(there[0]), level, width)
    beside += _between(time, depth, int(after[0]), int(there[-1]), level, width) if len(after) else beside
    if time[there[-1]] - time[there[0]] <= _REST_DURATION_RATIO * max(beside, 2.0 * float(np.median(np.diff(time)))):
        return slice(0, 0)
    near = max(_ARRIVAL_DEPTH_SHARE * top, 3.0 * float(np.median(np.abs(depth[there] - level))))
    arrived = int(there[depth[there] >= level - near][0])
    waited = time[arrived] - _arrival(time[:arrived], depth[:arrived], level)
    late = waited > 0.5 * float(np.median(np.diff(time)))  # it had come to rest before: the body relaxes already
    return slice(arrived + (not late), int(there[-1]) + 1)


def _arrival(time: np.ndarray, depth: np.ndarray, level: float) -> float:
    """When a level is reached from the last of the readings at the speed of the way, which the machine's brake ends;
    infinite where these do not show it."""
    start, end = (int(np.argmax(depth >= share * level)) for share in (0.5, 0.9))
    if end <= start or not time[end] > time[start]:
        return np.inf
    return float(time[-1] + (level - depth[-1]) * (time[end] - time[start]) / (depth[end] - depth[start]))


def _between(time: np.ndarray, depth: np.ndarray, far: int, near: int, level: float, width: float) -> float:
    """Time from four widths below the level to one, along the readings from `far` to `near` in either direction."""
    at = np.arange(far, near + 1) if near > far else np.arange(far, near - 1, -1)
    ends = np.interp([level - 4.0 * width, level - width], np.maximum.accumulate(depth[at]), time[at])
    return float(abs(ends[1] - ends[0]))
