"""Creep: the depth over time while a force is held, averaged over repeats, with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.core.digits import range_text
from rso.core.power_law import LEADING_EXPONENT
from rso.data.files.reading import Measurement, Repeat
from rso.data.force_holds import HeldForce
from rso.data.holds import (
    FIRST_READING_SHARE,
    MIN_HOLD_READINGS,
    SAME_MOMENT_TOLERANCE,
    AtRest,
    bins_between,
    relaxing_curve,
    times_between,
)
from rso.data.measured_curve import MeasuredCurve, Noise
from rso.data.scatter import of_record

SAME_HELD_FORCE_TOLERANCE = 0.05  # of the force by which repeats may be held at others
MIN_GROWTH_STANDARD_ERRORS = 3.0  # standard errors by which the depth must grow to be said to
# of the share of a straight line in time that the other quantity leaves: that one was controlled
CONTROLLED_NONLINEARITY_RATIO = 0.5


@dataclass(frozen=True, eq=False)
class CreepHold(AtRest):
    """A hold at a force (N), the same in all repeats of a test: how the indenter came there and what is read of it.

    `depth` mm is that at its first moment, `since` (m,) s are the moments since the force was reached, of readings in
    `spans` (m, 2) s; the way there took `rise` s and was controlled by `control` at `rate` (mm/s or N/s); `grows` (mm)
    is by how much the depth grows over the hold, 0 where that may be noise.
    """

    force: float
    depth: float
    since: np.ndarray
    spans: np.ndarray
    rise: float
    control: str
    rate: float
    grows: float = 0.0


def creep_of(measurement: Measurement, speed: float) -> CreepHold | str:
    """The hold at a force that ends the loading of a test at `speed` (mm/s), or why it is of no use; "" without one."""
    if measurement.kind != "force" or not any(r.creep for r in measurement.repeats):
        return ""
    held = [r.creep for r in measurement.repeats]
    found = [h for h in held if isinstance(h, HeldForce)]
    if len(found) < len(held):
        why = next((h for h in held if isinstance(h, str) and h), "")
        return why or f"{len(held) - len(found)} of {len(held)} repeats are not held at a force"
    levels = [float(np.median(h.force)) for h in found]
    force = float(f"{np.mean(levels):.6g}")
    if max(abs(v - force) for v in levels) > SAME_HELD_FORCE_TOLERANCE * force:
        return f"its repeats are held at {range_text(min(levels), max(levels), 'N', 'to')}"
    times = [_since(r, h, force) for r, h in zip(measurement.repeats, found, strict=True)]
    if min(len(t) for t in times) < MIN_HOLD_READINGS:
        return f"it has fewer than {MIN_HOLD_READINGS} readings"
    last = min(float(t[-1]) for t in times)
    if last <= 0.0:
        return "its repeats share no time"
    first = max((float(t[t >= FIRST_READING_SHARE * last][0]) for t in times), default=0.0)
    if not 0.0 < first < last:
        return "its repeats share no time"
    spans = bins_between(times, first, last)
    spans = spans[[all(times_between(t, a, b).any() for t in times) for a, b in spans]]
    since = np.array([float(f"{times[0][times_between(times[0], a, b)].mean():.6g}") for a, b in spans])
    apart = np.diff(since, prepend=-np.inf) > SAME_MOMENT_TOLERANCE * last
    since, spans = since[apart], spans[apart]
    if len(since) < MIN_HOLD_READINGS:
        return f"its repeats share fewer than {MIN_HOLD_READINGS} moments"
    rises = [_rise(r, h, force) for r, h in zip(measurement.repeats, found, strict=True)]
    rise = float(f"{np.median(rises):.4g}")
    control = "force" if all(_by_force(r) for r in measurement.repeats) else "travel"
    rate = force / rise if control == "force" else speed
    depths = np.mean([_binned(t, h.depth, spans, since)[0] for t, h in zip(times, found, strict=True)], axis=0)
    hold = CreepHold(force, float(f"{depths[0]:.6g}"), since, spans, rise, control, rate)
    return replace(hold, grows=_growth(depths))


def creep_curve(measurement: Measurement, noise: Noise, hold: CreepHold) -> MeasuredCurve:
    """Depth (m,) mm at the moments of a hold at a force, the mean of the repeats, as a curve of the channel `travel`.

        C = κ w² / r + d²/m + o² 1 1ᵀ + (g² + k² + f²/F²) y' y'ᵀ,   y' = F du/dF = y/p

    White noise w of readings about a smooth curve, stated noise d of a depth over the m readings of each moment,
    a contact found late (o) and a force that is off by a share, of one test (gain g) and of all (calibration k): the
    depth is then what another force makes of it, with the power p of the force over the depth at the end of loading;
    f is what the mean of the force readings is off by.
    Signs are those of :func:`~rso.data.repeats.combine`: a contact or a gain is one error of loading and hold.
    What nobody states is of the usual size, as there; repeats show what they differ by from each other.
    """
    times = [_since(r, _held(r), hold.force) for r in measurement.repeats]
    rows = [_binned(t, _held(r).depth, hold.spans, hold.since) for t, r in zip(times, measurement.repeats, strict=True)]
    y, counts = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    r, n = y.shape
    mean = y.mean(axis=0)
    smooth = relaxing_curve(list(hold.since[:, None]), mean)(hold.since)
    stated = np.array(
        [np.interp(hold.since, t, _held(q).sigma) for t, q in zip(times, measurement.repeats, strict=True)]
    )
    said = np.mean((noise.depth**2 + stated**2) / counts, axis=0) / r
    seen = of_record(np.log(hold.since), mean - smooth, smooth, np.diag(said))
    power = np.median([_power(q, hold.force) for q in measurement.repeats])
    shapes = {"gain": -mean / power, "contact": -np.ones(n), "calibration": -mean / power}
    sizes = noise.of_test(float(max(q.depth.max() for q in measurement.repeats)))
    shared, usual = {}, {}
    for name, shape in shapes.items():
        size = getattr(sizes, name)
        if name == "contact" and r > 1:  # what the repeats show of it: their mean is off by a share of that
            size = max(size, float(np.std(y.mean(axis=1), ddof=1)) / math.sqrt(r))
        if size > 0.0:
            shared[name] = size * shape
            if name in noise.unstated:
                usual[name] = shared[name][:, None]
    C = np.diag(seen.variance + said) + sum((np.outer(s, s) for s in shared.values()), np.zeros((n, n)))
    level = np.mean([_level_error(_held(q), noise) ** 2 for q in measurement.repeats]) ** 0.5 / math.sqrt(r)
    shared["force level"] = level / hold.force * shapes["gain"]
    C = C + np.outer(shared["force level"], shared["force level"])
    untold = r == 1 and not noise.correlation
    return MeasuredCurve(
        "travel",
        "mm",
        np.full(n, hold.depth),
        mean,
        np.sqrt(np.diag(C)),
        r,
        C,
        freedom=seen.freedom,
        shared=shared,
        white=np.sqrt(seen.variance + said) if untold else None,
        usual=usual,
        since=hold.since,
    )


def _level_error(held: HeldForce, noise: Noise) -> float:
    """Standard error (N) of the mean force of a hold: of white noise as stated, or as readings show if that is more."""
    seen = float(np.std(np.diff(held.force))) / math.sqrt(2.0) if len(held.force) > 2 else 0.0
    return max(noise.Fz, seen) / math.sqrt(len(held.force))


def _held(r: Repeat) -> HeldForce:
    assert isinstance(r.creep, HeldForce)
    return r.creep


def _loading(r: Repeat) -> np.ndarray:
    return np.nonzero((r.segment == "loading") & (r.depth > 0.0))[0]


def _reached(r: Repeat, held: HeldForce, force: float) -> float:
    """When (s) the force was reached: by what was left to go after the last reading of loading, at its rate."""
    at = _loading(r)[-8:]
    assert r.time is not None
    t, F = r.time[at], r.channels["Fz"][at]
    if len(at) < 2:
        return float(held.time[0])
    rate = float(np.polyfit(t, F, 1)[0])
    left = max(force - float(F[-1]), 0.0) / rate if rate > 0.0 else 0.0
    return min(float(t[-1]) + left, float(held.time[0]))


def _since(r: Repeat, held: HeldForce, force: float) -> np.ndarray:
    return held.time - _reached(r, held, force)


def _rise(r: Repeat, held: HeldForce, force: float) -> float:
    """Time (s) from contact to the force."""
    at = _loading(r)
    assert r.time is not None
    if len(at) < 2:
        return max(_reached(r, held, force) - float(r.time[0]), 1e-3)
    driven = r.channels["Fz"] if _by_force(r) else r.depth  # what grows evenly tells when it began
    rate, start = np.polyfit(r.time[at], driven[at], 1)
    began = -float(start) / float(rate) if rate > 0.0 else float(r.time[0])
    return _reached(r, held, force) - min(began, float(r.time[at[0]]))


def _by_force(r: Repeat) -> bool:
    """Whether loading was a ramp of force rather than of travel: a line over time leaves less of it."""
    at = _loading(r)
    assert r.time is not None
    if len(at) < 5:
        return False
    left = []
    for v in (r.channels["Fz"][at], r.depth[at]):
        line = np.polyval(np.polyfit(r.time[at], v, 1), r.time[at])
        left.append(float(np.std(v - line)) / max(float(np.ptp(v)), 1e-300))
    return left[0] < CONTROLLED_NONLINEARITY_RATIO * left[1]


def _power(r: Repeat, force: float) -> float:
    """d ln F/d ln u at the end of loading."""
    at = _loading(r)
    u, F = r.depth[at], r.channels["Fz"][at]
    near = (F > 0.3 * force) & (u > 0.0)
    if near.sum() < 3:
        return LEADING_EXPONENT
    return float(np.clip(np.polyfit(np.log(u[near]), np.log(F[near]), 1)[0], 0.5, 4.0))


def _binned(t: np.ndarray, depth: np.ndarray, spans: np.ndarray, since: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (m,) at the moments, means of the readings of each bin carried to it along a smooth curve, and counts."""
    bins = [times_between(t, a, b) for a, b in spans]
    value = np.array([depth[b].mean() for b in bins])
    along = relaxing_curve([t[b] for b in bins], value)
    bias = np.array([along(t[b]).mean() for b in bins]) - along(since)
    return value - bias, np.array([float(b.sum()) for b in bins])


def _growth(depth: Sequence[float] | np.ndarray) -> float:
    """By how much (mm) the depths of a hold grow; 0 where that may be noise."""
    jumps = np.diff(depth, 2)
    noise = float(np.sqrt(np.mean(jumps**2) / 6.0)) if len(jumps) > 2 else 0.0
    grows = float(depth[-1] - depth[0])
    return grows if grows > MIN_GROWTH_STANDARD_ERRORS * noise * 2.0**0.5 else 0.0
