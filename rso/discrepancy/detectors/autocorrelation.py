"""How far readings are autocorrelated: from repeats, idle channels or short windows of a curve; never from a misfit."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.optimize import brentq

from rso.contract.responses import FORCE_CHANNELS
from rso.core.correlation import of_neighbours, restored
from rso.data import step_of
from rso.discrepancy.detectors.sensor import MIN_READINGS_FOR_FILTER
from rso.discrepancy.library.test_plan import TestPlan

AUTOCORRELATION_WINDOW_READINGS = 20  # readings of a record that tells its memory
MIN_IDLE_RECORDS = 8  # of idle channels that tell it together
MIN_CURVE_WINDOWS = 3  # of curves, each of AUTOCORRELATION_WINDOW_READINGS readings, that do
MAX_WINDOW_VARIANCE_RATIO = 4.0  # times the usual variance: a window with more than noise in it
MIN_NEIGHBOUR_CORRELATION = 0.15  # correlation of neighbours there that counts


def autocorrelation_length(plan: TestPlan) -> float | None:
    """Length (mm) over which readings are autocorrelated, None where nothing shows that they do."""
    return length_over_repeats(plan) or of_idle_channels(plan) or within_windows(plan)


def length_over_repeats(plan: TestPlan) -> float | None:
    """Length (mm) over which the readings of all channels are autocorrelated, from repeats; None if they do not.

    Lag-1 correlation ρ of deviations from the mean of repeats, gain and contact taken out; length = −Δu / ln ρ.  It
    counts where it exceeds twice its standard error: a small one changes little.
    """
    count, steps, deviations = 0.0, [], list[np.ndarray]()
    for e in plan.experiments:
        repeats = [r for r in e.measurement.repeats if e.measurement.kind == "force"]
        for c in FORCE_CHANNELS:
            curves = [r.channels[c][r.segment == "loading"] for r in repeats if c in r.channels]
            if len(curves) < 4 or len({len(v) for v in curves}) > 1 or len(curves[0]) < 12:
                continue
            Y = np.array(curves[1:])  # the first may be a virgin one
            mean = Y.mean(axis=0)
            B = np.stack([mean, np.gradient(mean), np.ones(len(mean))], axis=1)
            D = Y - mean
            D = D - D @ np.linalg.pinv(B).T @ B.T
            deviations += list(D)
            count += D.size * (len(Y) - 1) / len(Y)
            steps.append(float(np.median(np.abs(np.diff(repeats[0].depth)))))
            readings = len(mean)
    ρ = of_neighbours(deviations)
    if count < 40 or ρ < 2.0 / np.sqrt(count):
        return None
    return -float(np.median(steps)) / float(np.log(min(restored(ρ, readings), 0.98)))


def of_idle_channels(plan: TestPlan) -> float | None:
    """The same length from lateral forces that have nothing to show: none but noise about a cubic in the depth.

    No gap of the model is in them, and they need neither repeats nor equal depths.  ρ is that of which AR(1) noise, the
    cubic taken out, has the lag-1 correlation of all records together; it counts from `MIN_NEIGHBOUR_CORRELATION` on,
    of `MIN_IDLE_RECORDS`.
    """
    found: list[tuple[float, float, int, float]] = []
    for r in (r for e in plan.experiments if e.measurement.kind == "force" for r in e.measurement.repeats):
        for c, branch in itertools.product(("Fx", "Fy"), ("loading", "unloading")):
            at = r.segment == branch
            if c not in r.channels or at.sum() < AUTOCORRELATION_WINDOW_READINGS:
                continue
            u, v = r.depth[at], r.channels[c][at]
            D = v - _cubic(len(v)) @ (_cubic(len(v)).T @ v)
            if np.ptp(v - D) < np.ptp(D) and step_of(r.channels[c]) < np.std(D):
                found.append((float(D[1:] @ D[:-1]), float(D @ D), len(v), float(np.ptp(u)) / len(v)))
    if len(found) < MIN_IDLE_RECORDS:
        return None
    product, power, n, Δu = (np.array(v) for v in zip(*found, strict=True))
    seen, count = float(np.sum(product / power * n) / n.sum()), int(np.median(n))
    return _length(seen, count, float(np.median(Δu)), 0.0)


def within_windows(plan: TestPlan) -> float | None:
    """The same length from windows of `AUTOCORRELATION_WINDOW_READINGS` readings of the curves themselves, a cubic in
    the depth taken out of each.

    Where a model is wrong, it is so over a large share of a branch, which a cubic follows in a window.  A jump is no
    memory: windows that scatter more than `MAX_WINDOW_VARIANCE_RATIO` times what is usual do not count.  ρ counts
    beyond `MIN_NEIGHBOUR_CORRELATION` and two standard errors.  For records of `MIN_READINGS_FOR_FILTER` readings and
    more there is `sensor.hidden_noise`. Assumption: what lasts for some readings only is noise, but in a few windows.
    """
    found: list[tuple[float, float, float]] = []
    for r in (r for e in plan.experiments if e.measurement.kind == "force" for r in e.measurement.repeats):
        for c, branch in itertools.product(FORCE_CHANNELS, ("loading", "unloading")):
            if c not in r.channels:
                continue
            at = np.flatnonzero((r.segment == branch) & (r.depth > 0.0))
            if len(at) >= MIN_READINGS_FOR_FILTER:
                continue
            for k in range(len(at) // AUTOCORRELATION_WINDOW_READINGS):
                u, v = (
                    x[at[k * AUTOCORRELATION_WINDOW_READINGS : (k + 1) * AUTOCORRELATION_WINDOW_READINGS]]
                    for x in (r.depth, r.channels[c])
                )
                D = v - _cubic(AUTOCORRELATION_WINDOW_READINGS) @ (_cubic(AUTOCORRELATION_WINDOW_READINGS).T @ v)
                if step_of(r.channels[c]) < np.std(D):
                    found.append(
                        (float(D[1:] @ D[:-1]), float(D @ D), float(np.ptp(u)) / AUTOCORRELATION_WINDOW_READINGS)
                    )
    if len(found) < MIN_CURVE_WINDOWS:
        return None
    product, power, Δu = np.array(found).T
    alike = power <= MAX_WINDOW_VARIANCE_RATIO * np.median(power)
    seen = float(product[alike].sum() / power[alike].sum())
    return _length(
        seen,
        AUTOCORRELATION_WINDOW_READINGS,
        float(np.median(Δu)),
        2.0 / math.sqrt(AUTOCORRELATION_WINDOW_READINGS * alike.sum()),
    )


def _length(seen: float, count: int, Δu: float, error: float) -> float | None:
    """−Δu / ln ρ of AR(1) noise whose `count` readings, a cubic taken out, have a lag-1 correlation as `seen`.

    None below what `MIN_NEIGHBOUR_CORRELATION` shows, or less than `error` above what white noise does.
    """
    Q = _cubic(count)

    def expected(ρ: float) -> float:
        R = ρ ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
        R = R - Q @ (Q.T @ R)
        R = R - (R @ Q) @ Q.T
        return float(np.trace(R, 1) / np.trace(R))

    if seen < max(expected(MIN_NEIGHBOUR_CORRELATION), expected(0.0) + error):
        return None
    ρ = brentq(lambda v: expected(v) - min(seen, expected(0.98)), 0.0, 0.98)
    return -Δu / math.log(ρ)


def _cubic(n: int) -> np.ndarray:
    """Orthonormal cubic polynomials (n, 4) of the number of a reading."""
    return np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), 4))[0]
