"""What a sensor does to readings that does not show between neighbouring ones: it filters, or counts in steps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rso.core.distributions import chi2_ppf
from rso.data import Repeat, step_of
from rso.discrepancy.library.test_plan import N_HOLD_BINS, Experiment

# readings of a record that tells by itself how it was filtered
MIN_READINGS_FOR_FILTER, FILTER_TREND_DEGREE, MIN_FILTERED_CORRELATION = 200, 10, 0.5
# means of readings that tell slow noise; chance that white noise alone tells as much
N_SLOW_NOISE_BLOCKS, SLOW_NOISE_CHANCE = 3 * N_HOLD_BINS, 1e-3


def hidden_noise(experiments: Sequence[Experiment], channel: str, scatter: float) -> tuple[float, float]:
    """Noise of a bin that does not show between neighbouring readings, and its length (mm): that of a sensor that
    filters or counts in steps; zeros where there is none.

    Of dense records: deviations from a polynomial in the root of depth whose neighbours are alike (lag-1 correlation
    ρ > MIN_FILTERED_CORRELATION; length −Δu/ln ρ), or whose means of many scatter by more than white noise does
    (:func:`slow`). Of all: the step q of a coarse sensor, q/√12 exp(−2π²σ²/q²) over the travel that q takes, where σ is
    the `scatter` of readings that dithers it (Widrow & Kollár 2008).
    """
    filtered, counted, blocks = [], [], []
    for r in (r for e in experiments if e.measurement.kind == "force" for r in e.measurement.repeats):
        at = (r.segment == "loading") & (r.depth > 0.1 * r.depth.max())
        if channel not in r.channels or at.sum() < 4:
            continue
        s, v = np.sqrt(r.depth[at]), r.channels[channel][at]
        Δu, q = float(np.ptp(r.depth[at])) / len(v), _step(r, channel)
        w = float(r.depth.max()) / N_HOLD_BINS
        if q:
            own = math.sqrt(max(scatter**2 - q**2 / 12.0, 0.0))  # of the readings before they were counted
            length = q * len(v) * Δu / max(float(np.ptp(v)), q)
            whole = math.hypot(1.0, math.pi * w / length)  # of a saw-tooth the means of whole teeth are nothing
            size = q / math.sqrt(12.0) * math.exp(-2.0 * (math.pi * own / q) ** 2) / whole
            counted.append((size, length))
        if len(v) < MIN_READINGS_FOR_FILTER:
            continue
        P = np.polynomial.legendre.legvander(2.0 * (s - s.min()) / np.ptp(s) - 1.0, FILTER_TREND_DEGREE)
        rest = v - P @ np.linalg.lstsq(P, v, rcond=None)[0]
        ρ = float(rest[1:] @ rest[:-1] / max(rest @ rest, 1e-300))
        share, _ = of_bins(-Δu / math.log(ρ), w, w / Δu) if MIN_FILTERED_CORRELATION < ρ < 1.0 else (0.0, 0.0)
        filtered.append((share * float(np.std(rest)), -Δu / math.log(ρ)) if share else (0.0, 0.0))
        blocks.append((rest, Δu, w))
    size, length = np.median(filtered, axis=0).tolist() if filtered else (0.0, 0.0)
    return max((size, length), slow(blocks), max(counted, default=(0.0, 0.0)))


def slow(records: Sequence[tuple[np.ndarray, float, float]]) -> tuple[float, float]:
    """Slow noise below the white one: of a bin, and its length (mm); zeros where there is none.

    From deviations of dense records from polynomials, their step and the width of a bin (mm).  The means of m readings
    have the covariance s² ρ^|i−j| + σ²/m before the polynomial is taken from them, with σ² of white noise from third
    differences: s and ρ are those with which mean square and lag-1 product are what they are found to be, by the median
    of the records.  It counts where all mean squares together are larger than white noise makes them in one of a
    thousand cases.
    """
    found, ν, ratio = [], 0.0, 0.0
    left, side = _left(np.eye(N_SLOW_NOISE_BLOCKS))
    for rest, Δu, w in records:
        m = len(rest) // N_SLOW_NOISE_BLOCKS
        b = rest[: m * N_SLOW_NOISE_BLOCKS].reshape(N_SLOW_NOISE_BLOCKS, m).mean(axis=1)
        white = float(np.mean(np.diff(rest, 3) ** 2)) / 20.0 / m
        ν, ratio = ν + left, ratio + float(b @ b) / max(white, 1e-300)
        found.append((float(b @ b) - white * left, float(b[1:] @ b[:-1]) - white * side, m * Δu, w, Δu))
    if not found or ratio < chi2_ppf(1.0 - SLOW_NOISE_CHANCE, ν):
        return 0.0, 0.0
    V, C, block, w, Δu = np.median(found, axis=0)
    if V <= 0.0:
        return 0.0, 0.0
    each = np.linspace(0.05, math.exp(-1.0 / 3.0), 14)  # what lasts longer than a bin is no noise but a shape
    known = np.array(
        [
            _left(ρ ** np.abs(np.subtract.outer(np.arange(N_SLOW_NOISE_BLOCKS), np.arange(N_SLOW_NOISE_BLOCKS))))
            for ρ in each
        ]
    )
    k = int(np.argmin(np.abs(known[:, 1] / known[:, 0] - C / V)))
    share, reach = of_bins(-block / math.log(each[k]), w, w / Δu)
    return share * math.sqrt(V / known[k, 0]), reach


def _left(R: np.ndarray) -> tuple[float, float]:
    """Traces, on the diagonal and beside it, of what a polynomial leaves of a covariance R of blocks."""
    Q = np.linalg.qr(
        np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, N_SLOW_NOISE_BLOCKS), FILTER_TREND_DEGREE)
    )[0]
    R = R - Q @ (Q.T @ R)
    R = R - (R @ Q) @ Q.T
    return float(np.trace(R)), float(np.trace(R, 1))


def count_of(experiments: Sequence[Experiment], channel: str) -> float:
    """Largest step (N) in which readings of a channel are counted, 0 where they are not."""
    repeats = [r for e in experiments if e.measurement.kind == "force" for r in e.measurement.repeats]
    return max((_step(r, channel) for r in repeats if channel in r.channels), default=0.0)


def _step(repeat: Repeat, channel: str) -> float:
    """Step (N) in which a channel is counted: where it never moves, that of the others, which hides what it does."""
    v = repeat.channels[channel]
    return step_of(v) if np.ptp(v) > 0.0 else max(step_of(w) for w in repeat.channels.values())


def of_bins(length: float, w: float, k: float) -> tuple[float, float]:
    """Standard deviation of the mean of a bin, and its length (mm), of readings of variance 1 that are autocorrelated.

    With ρ = e^{−w/kℓ} from one to the next of the k readings in a bin of width w the variance is
    V = [k (1 − ρ²) − 2ρ (1 − ρᵏ)] / k² (1 − ρ)²; correlations rⁿ of bins, r = (S − V) / (S + V), add up to the
    variance S = (1 + ρ) / k (1 − ρ) per bin that the mean of many has.
    """
    ρ = min(math.exp(-w / (k * length)), 1.0 - 1e-6)  # beyond, V is round-off
    V = (k * (1.0 - ρ**2) - 2.0 * ρ * (1.0 - ρ**k)) / (k * (1.0 - ρ)) ** 2
    S = (1.0 + ρ) / (k * (1.0 - ρ))
    return math.sqrt(V), -w / math.log(max((S - V) / (S + V), 1e-9))
