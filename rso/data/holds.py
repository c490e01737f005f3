"""Holds at constant depth: when the indenter came to rest, which readings follow, and what they are averaged to.

Times count from the moment at which the indenter stops, t = 0: a body that relaxes is followed by readings that lie
evenly in ln t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rso.core.digits import quantity_text
from rso.data.files.reading import Measurement, Repeat

N_HOLD_BINS = 14  # of a hold: what a curve of one or two relaxation times can tell
FIRST_READING_SHARE = 1e-3  # of a hold: readings before that are those of the end of loading
SAME_MOMENT_TOLERANCE = 1e-5  # of a hold: moments nearer than this are one
MAX_HOLD_TRAVEL_SHARE = 0.02  # of the depth that the indenter may move in a hold
MIN_HOLD_READINGS = 4  # readings of a hold that tell a share and a time
N_RELAXATION_TIMES = 16  # relaxation times of the curve along which readings of a bin are carried to its moment
HOLD_POWER_RANGE = 0.5, 4.0  # of force over depth, by which readings of a hold are carried to its depth
MIN_FALL_STANDARD_ERRORS = 3.0  # standard errors by which the force must fall to be said to


class AtRest:
    """Readings at rest: `since` (m,) s are their moments, those of `spans` (m, 2) s each, from the beginning on."""

    since: np.ndarray
    spans: np.ndarray

    @property
    def moments(self) -> tuple[float, ...]:
        """The times since the beginning as numbers."""
        return tuple(map(float, self.since))

    @property
    def lasts(self) -> float:
        """Time (s) from the beginning to the last reading."""
        return float(self.spans[-1, 1])


@dataclass(frozen=True, eq=False)
class Hold(AtRest):
    """A rest at the deepest point of a test, the same in all of its repeats.

    `depth` mm; `since` (m,) s are the moments after the indenter came to rest for which readings stand, those of
    `spans` (m, 2) s each; `speed` mm/s of the way there; `fall` is the share by which Fz falls from the first to the
    last of them, 0 where that may be noise.
    """

    depth: float
    since: np.ndarray
    spans: np.ndarray
    speed: float
    fall: float = 0.0


def at_peak(r: Repeat) -> np.ndarray:
    """Indices of the readings of a hold between loading and unloading."""
    there, back, held = (np.nonzero(r.segment == s)[0] for s in ("loading", "unloading", "hold"))
    last = there[-1] if len(there) else len(r.segment)  # a hold without a way there is elsewhere
    return held[(held > last) & (held < (back[0] if len(back) else len(r.segment)))]


def stop_time(r: Repeat, time: np.ndarray, speed: float) -> float:
    """When (s) the indenter came to rest, if it did: after the last reading of the way there, or between it and the
    first of the rest, by what was left to go."""
    there = np.nonzero(r.segment == "loading")[0]
    if not len(there):
        return 0.0
    came = float(time[there[-1]] + max(r.depth.max() - r.depth[there[-1]], 0.0) / speed)
    held = time[r.segment == "hold"]
    return min(came, float(held[0])) if len(held) else came


def edges(since: np.ndarray, bins: int = N_HOLD_BINS) -> np.ndarray:
    """Inner edges of bins that are even in the logarithm of the times `since` (n,) a hold began; the times themselves
    where they are few."""
    if len(since) <= bins:
        return since
    return np.geomspace(max(since[0], FIRST_READING_SHARE * since[-1]), since[-1], bins + 1)[1:-1]


def hold_of(measurement: Measurement, speed: float, deepest: float) -> Hold | str:
    """The hold of a measured test whose loading goes to `deepest` mm, or why it is not used; "" where there is none."""
    if measurement.kind != "force" or not any(np.any(r.segment == "hold") for r in measurement.repeats):
        return ""
    if any(r.time is None for r in measurement.repeats):
        return "the record has no times"
    rows = [at_peak(r) for r in measurement.repeats]
    few = sum(len(at) < MIN_HOLD_READINGS for at in rows)
    if few == len(rows):
        return f"it has fewer than {MIN_HOLD_READINGS} readings at the deepest point"
    if few:
        return f"{few} of {len(rows)} repeats do not rest at the deepest point"
    times = [_since(r, at, speed) for r, at in zip(measurement.repeats, rows, strict=True)]
    last = min(float(s[-1]) for s in times)
    first = max(float(s[s >= FIRST_READING_SHARE * last][0]) for s in times)
    if not 0.0 < first < last:
        return "its repeats share no time"
    spans = bins_between(times, first, last)
    mine = [[times_between(s, a, b) for s in times] for a, b in spans]
    filled = np.array([all(m.any() for m in each) for each in mine])
    if filled.sum() < MIN_HOLD_READINGS:
        return f"its repeats share fewer than {MIN_HOLD_READINGS} moments"
    spans = spans[filled]
    since = np.array([float(f"{times[0][times_between(times[0], a, b)].mean():.6g}") for a, b in spans])
    # a reading beside another is no moment of its own
    apart = np.diff(since, prepend=-np.inf) > SAME_MOMENT_TOLERANCE * since[-1]
    since, spans = since[apart], spans[apart]
    if len(since) < MIN_HOLD_READINGS:
        return f"it has fewer than {MIN_HOLD_READINGS} moments"
    depths = [
        np.array([r.depth[at][times_between(s, a, b)].mean() for a, b in spans])
        for r, at, s in _each(measurement, times)
    ]
    level = float(np.mean([np.median(d) for d in depths]))
    moved = max(float(np.abs(d - level).max()) for d in depths)
    if moved > MAX_HOLD_TRAVEL_SHARE * level:
        return f"the depth changes there by {100 * moved / level:.2g} %"
    if level < (1.0 - MAX_HOLD_TRAVEL_SHARE) * deepest:
        return f"it is at {quantity_text(level, 'mm')}, not at the deepest point"
    depth = deepest if level <= deepest else max(float(f"{level:.6g}"), deepest)
    found = Hold(depth, since, spans, speed)
    return Hold(depth, since, spans, speed, _fall(measurement, found))


def held(r: Repeat, hold: Hold, channel: str, power: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (m,) of a channel at the moments of a hold, squares of their stated sigma, and how many readings each has.

    Readings of a bin are averaged and carried to its moment along :func:`relaxing_curve`, and to the depth of the hold
    as F ~ u^`power`: a drive that creeps has not stopped, a repeat went a little deeper.
    """
    at = at_peak(r)
    s, y = _since(r, at, hold.speed), r.channels[channel][at]
    depth, stated = r.depth[at], r.sigma.get(channel, np.zeros(len(r.depth)))[at] ** 2
    bins = [times_between(s, a, b) for a, b in hold.spans]
    bins = [b if b.any() else np.abs(s - t) == np.abs(s - t).min() for b, t in zip(bins, hold.since, strict=True)]
    mean = lambda v: np.array([v[b].mean() for b in bins])  # noqa: E731
    power = float(np.clip(power, *HOLD_POWER_RANGE))
    value = mean(y * (hold.depth / depth) ** power)
    along = relaxing_curve([s[b] for b in bins], value)
    bias = np.array([along(s[b]).mean() for b in bins]) - along(hold.since)
    return value - bias, mean(stated), np.array([float(b.sum()) for b in bins])


def relaxing_curve(times: Sequence[np.ndarray], y: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A smooth curve c + Σ_k a_k exp(−t/τ_k), all a_k of one sign, whose means over `times` (m of (k,) s) are y (m,).

    Non-negative least squares over `N_RELAXATION_TIMES` times τ: a discrete relaxation spectrum (Baumgaertel & Winter,
    Rheol. Acta 28 (1989) 511), which neither overshoots nor rings where a polynomial does.
    """
    from scipy.optimize import nnls  # 0.1 s of start-up that only holds need

    first, last = float(np.min(times[0])), float(np.max(times[-1]))
    spectrum = np.geomspace(max(0.5 * first, 0.1 * FIRST_READING_SHARE * last), 3.0 * last, N_RELAXATION_TIMES)

    def terms(t: np.ndarray) -> np.ndarray:
        ones = np.ones((len(t), 1))
        return np.hstack([ones, -ones, np.exp(-np.asarray(t, float)[:, None] / spectrum)])

    A, size = np.array([terms(t).mean(axis=0) for t in times]), float(np.abs(y).max()) or 1.0
    (a, off), (b, other) = (nnls(A, sign * y / size) for sign in (1.0, -1.0))
    c = a * size if off <= other else -b * size
    return lambda t: terms(t) @ c


def _each(measurement: Measurement, times: list[np.ndarray]) -> list[tuple[Repeat, np.ndarray, np.ndarray]]:
    return [(r, at_peak(r), s) for r, s in zip(measurement.repeats, times, strict=True)]


def _since(r: Repeat, at: np.ndarray, speed: float) -> np.ndarray:
    """Times (n,) s of readings since the indenter came to rest."""
    assert r.time is not None
    return r.time[at] - stop_time(r, r.time, speed)


def times_between(s: np.ndarray, a: float, b: float) -> np.ndarray:
    """(n,) whether times lie from a to b."""
    return (s >= a) & (s <= b)


def bins_between(times: list[np.ndarray], first: float, last: float) -> np.ndarray:
    """Bins (m, 2) s between two times: even in ln t, or about the readings of the first repeat where they are few."""
    mine = times[0][times_between(times[0], first, last)]
    inner = (
        np.geomspace(first, last, N_HOLD_BINS + 1)[1:-1] if len(mine) > N_HOLD_BINS else np.sqrt(mine[1:] * mine[:-1])
    )
    ends = np.concatenate([[first], inner, [last]])
    return np.stack([np.append(ends[0], np.nextafter(ends[1:-1], np.inf)), ends[1:]], axis=1)


def _fall(measurement: Measurement, hold: Hold) -> float:
    """Share by which Fz falls in a hold; 0 where that may be noise."""
    if "Fz" not in measurement.channels:
        return 0.0
    y = np.mean([held(r, hold, "Fz", 1.5)[0] for r in measurement.repeats], axis=0)
    jumps = np.diff(y, 2)
    noise = float(np.sqrt(np.mean(jumps**2) / 6.0)) if len(jumps) > 2 else 0.0
    fall = float(y[0] - y[-1])
    return fall / float(y[0]) if y[0] > 0.0 and fall > MIN_FALL_STANDARD_ERRORS * noise * 2.0**0.5 else 0.0
