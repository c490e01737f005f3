"""Periodic disturbances: a line in the spectrum of the readings over time or travel, made neither by body nor scatter.

Of every branch of every record a polynomial in the root of depth is taken out.  Then, at each frequency f,

    P(f) = ½ |Π_f r|²,      S(f) = Σ_records P(f) ln 2 / median of P

with Π_f the projection on cos 2πft, sin 2πft (what a polynomial cannot do of them) and everything whitened by the
correlation of neighbouring readings, r_i − ρ r_{i−1}.  Of scatter each summand is exponential with mean 1, so that S is
a Gamma variable of the number of records (Scargle 1982).  Mains has a period in time; a spindle and the
slips of an indenter have one in travel, another frequency at every speed, so that t is either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from rso.core.correlation import of_neighbours
from rso.core.distributions import gamma_logsf, gamma_ppf
from rso.discrepancy.library.test_plan import TestPlan

# log10 of the chance of the strongest line; among some hundred frequencies scatter reaches about -6
MAX_LINE_LOG10_P = -10.0
MIN_READINGS_FOR_SPECTRUM = 24  # readings of a branch
CURVE_TREND_DEGREE = 5  # of the polynomial in the root of the depth that is taken out of a branch
MIN_CYCLES = 3.0  # fewest in a branch: less is a trend
MAX_FREQUENCY_SHARE = 0.45  # of the rate of sampling
FREQUENCIES_PER_RESOLUTION = 4  # frequencies per 1/duration
# readings of a branch: more are averaged, what is faster than their means is not looked for
MAX_SPECTRUM_READINGS = 300
NOISE_FLOOR_CYCLES = 8  # cycles in a branch over which the spectrum of scatter hardly changes
MAX_SPECTRUM_FREQUENCIES = 50_000  # frequencies, at most
FREQUENCIES_PER_BLOCK = 512  # of them at a time
MIN_SPEED_RATIO = 1.5  # ratio of the fastest to the slowest branch from which on time and travel differ
MIN_SPECTRUM_DEPTH_SHARE = 0.05  # of the deepest reading: the bend at first contact is no polynomial


Records = dict[tuple[str, str, str], list[tuple[np.ndarray, np.ndarray, np.ndarray]]]


@dataclass(frozen=True)
class PeriodicLine:
    """The strongest line: log10 of its chance, frequency, and amplitude (N) in the channel where it is largest.

    The frequency is in Hz, or in 1/mm of a line over the travel (`along` says which).
    """

    log10_p: float
    frequency: float
    amplitude: float
    channel: str
    along: str = "time"

    @property
    def there(self) -> bool:
        """Whether scatter does not make such a line."""
        return self.log10_p < MAX_LINE_LOG10_P


def periodic_line(plan: TestPlan) -> PeriodicLine:
    """The strongest line in all records of the plan, all channels and repeats together.

    Records without times are taken as sampled evenly over the travel.
    """
    untimed = _strongest(_records(plan, timed=False), "travel")
    groups = _records(plan, timed=True)
    over_time = min(_strongest(groups, "time"), untimed, key=lambda h: h.log10_p)
    speeds = {n: [np.ptp(d) / np.ptp(t) for t, d, _ in g] for n, g in groups.items()}
    if not groups or max(map(max, speeds.values())) < MIN_SPEED_RATIO * min(map(min, speeds.values())):
        return over_time  # at one speed the two are the same
    travelled = {  # at the mean speed of a branch: readings of depth scatter
        n: [(v * (t - t[0]), d, y) for v, (t, d, y) in zip(speeds[n], g, strict=True)] for n, g in groups.items()
    }
    return min(over_time, _strongest(travelled, "travel"), key=lambda h: h.log10_p)


def _records(plan: TestPlan, timed: bool) -> Records:
    """(time, depth, force) of the branches of all records that are not held back, by experiment, branch and channel.

    Of those with times or of those without, whose first coordinate is an even travel.
    """
    groups: Records = {}
    for e in plan.experiments:
        if e.measurement.kind != "force" or e.role == "validate":
            continue
        for r in e.measurement.repeats:
            for branch in ("loading", "unloading"):
                at = (r.segment == branch) & (r.depth > MIN_SPECTRUM_DEPTH_SHARE * np.max(r.depth))
                if at.sum() < MIN_READINGS_FOR_SPECTRUM or (r.time is not None) != timed:
                    continue
                level, way = _levels(r.depth[at]), np.linspace(0.0, np.ptp(r.depth[at]), at.sum())
                t, depth = (_thinned(_merged(v, level)) for v in (way if r.time is None else r.time[at], r.depth[at]))
                if not (np.all(np.diff(t) > 0.0) and np.ptp(depth) > 0.0):
                    continue  # a clock too coarse to tell frequencies
                for c, v in r.channels.items():
                    groups.setdefault((e.name, branch, c), []).append((t, depth, _thinned(_merged(v[at], level))))
    return groups


def _strongest(groups: Records, along: str) -> PeriodicLine:
    """The strongest line over the first coordinate of the records."""
    if not groups:
        return PeriodicLine(0.0, 0.0, 0.0, "")
    longest = max(float(np.ptp(t)) for g in groups.values() for t, _, _ in g)
    fastest = max(MAX_FREQUENCY_SHARE / float(np.median(np.diff(t))) for g in groups.values() for t, _, _ in g)
    f = np.arange(
        MIN_CYCLES / longest,
        fastest,
        max(1.0 / (FREQUENCIES_PER_RESOLUTION * longest), fastest / MAX_SPECTRUM_FREQUENCIES),
    )
    total, number = np.zeros(len(f)), np.zeros(len(f))
    largest: dict[str, np.ndarray] = {}
    for (_, _, c), records in groups.items():
        T = min(float(np.ptp(t)) for t, _, _ in records)
        inside = (f >= MIN_CYCLES / T) & (
            f <= MAX_FREQUENCY_SHARE / max(float(np.median(np.diff(t))) for t, _, _ in records)
        )
        if inside.sum() < 4 * FREQUENCIES_PER_RESOLUTION:
            continue
        ρ = _memory(records)
        blocks = np.split(f[inside], range(FREQUENCIES_PER_BLOCK, int(inside.sum()), FREQUENCIES_PER_BLOCK))
        each = [np.concatenate([_line(b, *r, ρ) for b in blocks], axis=1) for r in records]
        P, A = np.moveaxis(np.array(each), 1, 0)
        floor = _floor(P.mean(axis=0), NOISE_FLOOR_CYCLES / (T * (f[1] - f[0]))) / _middle(len(records))
        if not floor.all():
            continue
        total[inside] += np.sum(P, axis=0) / floor
        number[inside] += len(records)
        line = np.zeros(len(f))
        line[inside] = np.median(A, axis=0)
        largest[c] = np.maximum(largest.get(c, 0.0), line)
    if not number.any():
        return PeriodicLine(0.0, 0.0, 0.0, "")
    chance = np.where(number > 0, gamma_logsf(total, np.maximum(number, 1.0)), 0.0) / np.log(10.0)
    k = int(np.argmin(chance))
    channel = max(largest, key=lambda c: largest[c][k])
    return PeriodicLine(float(chance[k]), float(f[k]), float(largest[channel][k]), channel, along)


def _levels(depth: np.ndarray) -> np.ndarray | None:
    """Number (n,) of the step that each reading of a coarse encoder stands on, None where depths are fine.

    The force goes on while the depth stands still: over depth that is a saw-tooth, and no hum.
    """
    moved = np.diff(depth) != 0.0
    return np.concatenate([[0], np.cumsum(moved)]) if 0.0 < np.mean(moved) < 0.5 else None


def _merged(v: np.ndarray, level: np.ndarray | None) -> np.ndarray:
    """Means of the readings of each step."""
    return v if level is None else np.bincount(level, weights=v) / np.bincount(level)


def _thinned(v: np.ndarray) -> np.ndarray:
    """Means of equally many neighbours, at most MAX_SPECTRUM_READINGS of them; a rest at the end is left out."""
    k = -(-len(v) // MAX_SPECTRUM_READINGS)
    return v if k == 1 else v[: len(v) // k * k].reshape(-1, k).mean(axis=1)


def _line(f: np.ndarray, t: np.ndarray, depth: np.ndarray, v: np.ndarray, ρ: float) -> np.ndarray:
    """½ |Π_f r|² of one branch, whitened, with the polynomial taken out of both, and the amplitude (2, n_f)."""
    phase = 2.0 * np.pi * f[:, None] * (t - t[0])
    waves = _whitened(np.stack([np.cos(phase), np.sin(phase)], axis=1), ρ)  # (n_f, 2, n)
    Q, _ = np.linalg.qr(_whitened(_polynomials(depth), ρ).T)
    r = _whitened(v, ρ)
    r = r - Q @ (Q.T @ r)
    waves = waves - (waves @ Q) @ Q.T
    gram, b = waves @ waves.transpose(0, 2, 1), waves @ r
    x = np.linalg.solve(gram + 1e-9 * len(t) * np.eye(2), b[..., None])[..., 0]  # where sampling sees one phase only
    return np.stack([0.5 * np.einsum("fi,fi->f", b, x), np.hypot(x[:, 0], x[:, 1])])


def _memory(records: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """Correlation of neighbouring residuals, 0 to 0.95."""
    bases = [np.linalg.qr(_polynomials(depth).T)[0] for _, depth, _ in records]
    ρ = of_neighbours(v - Q @ (Q.T @ v) for Q, (_, _, v) in zip(bases, records, strict=True))
    n = np.mean([len(v) for _, _, v in records])
    # what taking out the polynomial costs
    return float(np.clip(ρ + (CURVE_TREND_DEGREE + 1) * (1.0 + ρ) / n, 0.0, 0.95))


def _polynomials(depth: np.ndarray) -> np.ndarray:
    """Legendre polynomials (CURVE_TREND_DEGREE + 1, n) of the root of depth."""
    s = np.sqrt(np.maximum(depth, 0.0))
    return np.polynomial.legendre.legvander(2.0 * (s - s.min()) / np.ptp(s) - 1.0, CURVE_TREND_DEGREE).T


def _whitened(v: np.ndarray, ρ: float) -> np.ndarray:
    """v_i − ρ v_{i−1} over the last axis."""
    return v[..., 1:] - ρ * v[..., :-1]


def _floor(P: np.ndarray, width: float) -> np.ndarray:
    """(n,) median of a spectrum P (n,), or that over `width` of its points about each where it is higher.

    What a filter lets pass is no line, but lies by decades above the median of all.
    """
    about = median_filter(P, min(2 * round(width / 2) + 1, len(P)), mode="nearest")
    return np.maximum(about, float(np.median(P)))


def _middle(n: int) -> float:
    """Median of the mean of n exponential variables of mean 1."""
    return float(gamma_ppf(0.5, n) / n)
