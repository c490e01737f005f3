"""Periodic disturbances: a line in the spectrum of the readings over time, which neither body nor scatter makes.

Of every branch of every record a polynomial in the root of depth is taken out.  Then, at each frequency f,

    P(f) = ½ |Π_f r|²,      S(f) = Σ_records P(f) ln 2 / median of P

with Π_f the projection on cos 2πft, sin 2πft (what a polynomial cannot do of them) and everything whitened by the
correlation of neighbouring readings, r_i − ρ r_{i−1}.  Of scatter each summand is exponential with mean 1, so that S is
a Gamma variable of the number of records (Scargle 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import gamma

from rso.diagnosis.testplan import TestPlan

SURE = -10.0  # log10 of the chance of the strongest line; among some hundred frequencies scatter reaches about -6
FEWEST = 24  # readings of a branch
DEGREE = 5
CYCLES = 3.0  # fewest in a branch: less is a trend
FASTEST = 0.45  # of the rate of sampling
FINE = 4  # frequencies per 1/duration
SHALLOW = 0.05  # of the deepest reading: the bend at first contact is no polynomial


@dataclass(frozen=True)
class Hum:
    """The strongest line: log10 of its chance, frequency (Hz), and amplitude (N) in the channel where it is largest."""

    log10_p: float
    frequency: float
    amplitude: float
    channel: str

    @property
    def there(self) -> bool:
        """Whether scatter does not make such a line."""
        return self.log10_p < SURE


def hum(plan: TestPlan) -> Hum:
    """The strongest line in all records of the plan, all channels and repeats together."""
    groups: dict[tuple[str, str, str], list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    for e in plan.experiments:
        if e.measurement.kind != "force" or e.role == "validate":
            continue
        for r in e.measurement.repeats:
            for branch in ("loading", "unloading"):
                at = (r.segment == branch) & (r.depth > SHALLOW * np.max(r.depth))
                if at.sum() < FEWEST or r.time is None or np.ptp(r.time[at]) <= 0.0:
                    continue
                for c, v in r.channels.items():
                    groups.setdefault((e.name, branch, c), []).append((r.time[at], r.depth[at], v[at]))
    if not groups:
        return Hum(0.0, 0.0, 0.0, "")
    longest = max(float(np.ptp(t)) for g in groups.values() for t, _, _ in g)
    fastest = max(FASTEST / float(np.median(np.diff(t))) for g in groups.values() for t, _, _ in g)
    f = np.arange(CYCLES / longest, fastest, 1.0 / (FINE * longest))
    total, number = np.zeros(len(f)), np.zeros(len(f))
    largest: dict[str, np.ndarray] = {}
    for (_, _, c), records in groups.items():
        T = min(float(np.ptp(t)) for t, _, _ in records)
        inside = (f >= CYCLES / T) & (f <= FASTEST / max(float(np.median(np.diff(t))) for t, _, _ in records))
        if inside.sum() < 4 * FINE:
            continue
        ρ = _memory(records)
        P, A = np.moveaxis(np.array([_line(f[inside], *r, ρ) for r in records]), 1, 0)
        floor = float(np.median(P.mean(axis=0))) / _middle(len(records))
        if floor <= 0.0:
            continue
        total[inside] += np.sum(P, axis=0) / floor
        number[inside] += len(records)
        line = np.zeros(len(f))
        line[inside] = np.median(A, axis=0)
        largest[c] = np.maximum(largest.get(c, 0.0), line)
    if not number.any():
        return Hum(0.0, 0.0, 0.0, "")
    chance = np.where(number > 0, gamma.logsf(total, np.maximum(number, 1.0)), 0.0) / np.log(10.0)
    k = int(np.argmin(chance))
    channel = max(largest, key=lambda c: largest[c][k])
    return Hum(float(chance[k]), float(f[k]), float(largest[channel][k]), channel)


def _line(f: np.ndarray, t: np.ndarray, depth: np.ndarray, v: np.ndarray, ρ: float) -> tuple[np.ndarray, np.ndarray]:
    """½ |Π_f r|² (n_f,) of one branch, whitened, with the polynomial taken out of both, and the amplitude (n_f,)."""
    phase = 2.0 * np.pi * f[:, None] * (t - t[0])
    waves = _whitened(np.stack([np.cos(phase), np.sin(phase)], axis=1), ρ)  # (n_f, 2, n)
    Q, _ = np.linalg.qr(_whitened(_polynomials(depth), ρ).T)
    r = _whitened(v, ρ)
    r = r - Q @ (Q.T @ r)
    waves = waves - (waves @ Q) @ Q.T
    gram, b = waves @ waves.transpose(0, 2, 1), waves @ r
    x = np.linalg.solve(gram, b[..., None])[..., 0]
    return 0.5 * np.einsum("fi,fi->f", b, x), np.hypot(x[:, 0], x[:, 1])


def _memory(records: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """Correlation of neighbouring residuals, 0 to 0.95."""
    product = power = 0.0
    for _, depth, v in records:
        Q, _ = np.linalg.qr(_polynomials(depth).T)
        r = v - Q @ (Q.T @ v)
        product += float(r[1:] @ r[:-1])
        power += float(r @ r)
    n = np.mean([len(v) for _, _, v in records])
    ρ = product / power if power else 0.0
    return float(np.clip(ρ + (DEGREE + 1) * (1.0 + ρ) / n, 0.0, 0.95))  # what taking out the polynomial costs


def _polynomials(depth: np.ndarray) -> np.ndarray:
    """Legendre polynomials (DEGREE + 1, n) of the root of depth."""
    s = np.sqrt(np.maximum(depth, 0.0))
    return np.polynomial.legendre.legvander(2.0 * (s - s.min()) / np.ptp(s) - 1.0, DEGREE).T


def _whitened(v: np.ndarray, ρ: float) -> np.ndarray:
    """v_i − ρ v_{i−1} over the last axis."""
    return v[..., 1:] - ρ * v[..., :-1]


def _middle(n: int) -> float:
    """Median of the mean of n exponential variables of mean 1."""
    return float(gamma.median(n) / n)
