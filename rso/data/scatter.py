"""What readings scatter by: noise, its change and autocorrelation along the curve, gain and contact of each test."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rso.core.correlation import of_neighbours, restored
from rso.core.distributions import chi2_ppf

MIN_READINGS_FOR_NOISE = 8  # readings of a record that tell its noise
NOISE_OVERRULE_CHANCE = 0.05  # chance of a right statement to be overruled by the readings
# share by which a stated variance may change along the curve and still say nothing of its shape
EVEN_VARIANCE_TOLERANCE = 0.1
VARYING_NOISE_CHANCE = 0.01  # chance of even noise to be taken for one that changes along the curve
# standard errors of a correlation of neighbours: one case of white noise in 160 has more
MIN_CORRELATION_STANDARD_ERRORS = 2.5
MAX_LOG_NOISE_DEGREE = 2  # of its logarithm as a polynomial, at most
FAINT_FORCE_SHARE = 0.01  # of the largest value: below it forces count as equally small


@dataclass(frozen=True, eq=False)
class White:
    """Variance (n,) of a reading's noise, known from `freedom` degrees of freedom (infinite: not estimated)."""

    variance: np.ndarray
    freedom: float


def of_record(u: np.ndarray, y: np.ndarray, smooth: np.ndarray, said: np.ndarray) -> White:
    """White noise of a record beyond the covariance `said` (n, n) of what is stated: none, unless its readings clearly
    scatter by more; none of fewer than `MIN_READINGS_FOR_NOISE` readings either.  y (n,) is what a smooth curve leaves
    of them at u.

        q_j = (a_jᵀ y)²,   E q_j = a_jᵀ C a_j       with a_j the third divided difference at four readings, ‖a_j‖ = 1

    The mean of q_j/E q_j, which is χ²_m/m for m = (tr A Aᵀ)²/tr (A Aᵀ)², says whether they do.
    """
    n = len(u)
    if n < MIN_READINGS_FOR_NOISE:
        return White(np.zeros(n), np.inf)
    four = np.lib.stride_tricks.sliding_window_view(np.arange(n), 4)
    apart = u[four][:, :, None] - u[four][:, None, :]
    weights = 1.0 / np.prod(apart + np.eye(4), axis=-1)  # zero on every parabola
    A = np.zeros((n - 3, n))
    np.put_along_axis(A, four, weights / np.linalg.norm(weights, axis=1, keepdims=True), axis=1)
    jumps = A @ y
    q, expected = jumps**2, np.einsum("ji,ik,jk->j", A, said, A)
    m = (n - 3) ** 2 / float(np.sum((A @ A.T) ** 2))
    if expected.min() > 0 and np.mean(q / expected) <= chi2_ppf(1 - NOISE_OVERRULE_CHANCE, m) / m:
        return White(np.zeros(n), np.inf)
    # White noise turns in three of four; what a curve itself leaves there is all at its beginning, and not noise.
    turns = np.mean(jumps[1:] * jumps[:-1] < 0) > 0.5
    size = _size(smooth) if turns else np.zeros(n)
    found = varying(q, size[four].mean(axis=1), size, m)
    return White(np.maximum(found.variance - np.interp(u, u[four].mean(axis=1), expected), 0.0), found.freedom)


def step_of_scale(values: np.ndarray) -> float:
    """The step of a coarse scale on whose marks readings (n,) stand, 0 where most of them are numbers of their own.

    A converter of few bits or a display of few digits: at least two readings stand on a mark, and all marks lie whole
    steps apart.
    """
    marks = np.unique(values)
    if len(marks) < 3 or 2 * len(marks) > len(values):
        return 0.0
    apart = np.diff(marks)
    step = float(np.median(apart[apart < 1.5 * apart.min()]))
    off = np.abs(apart / step - np.round(apart / step))
    return step if step > 0.0 and off.max() < 0.05 else 0.0


def of_scale(seen: White, values: np.ndarray, step: float, rise: np.ndarray) -> White:
    """Noise of means of readings `values` (m,) that stand on marks a step Δ apart: no less than what the scale leaves.

        σ² = Δ²/12 · e^{−4π²s²/Δ²} / max(1, r/Δ)

    r (n,) is the rise of the curve within a mean: readings on one mark are off alike, and their differences show
    less.  s is what readings scatter by from one to the next beyond the marks they pass: it blurs the scale (Widrow &
    Kollár, Quantization Noise, 2008, §5.2).
    """
    jumps = np.diff(values)
    passed = np.abs(float(values[-1] - values[0])) * step
    s2 = max(float(jumps @ jumps) - passed, 0.0) / (2.0 * len(jumps))
    least = step**2 / 12.0 * math.exp(-((2.0 * math.pi) ** 2) * s2 / step**2) / np.maximum(1.0, rise / step)
    return White(np.maximum(seen.variance, least), seen.freedom)


def repeat_scatter(y: np.ndarray, smooth: np.ndarray, slope: np.ndarray) -> tuple[White, np.ndarray]:
    """Noise of one of r >= 2 repeats y (r, n), as if it were white, and gain and contact (2, r) of each against their
    mean.

    Both shapes were taken out of the deviations, which leaves (r − 1)(n − 2) degrees of freedom, and of readings that
    are autocorrelated (1 − ρ²)/(1 + ρ²) of these (Bartlett, J. R. Stat. Soc. 98 (1935) 536).
    """
    r, n = y.shape
    off = y - y.mean(axis=0)
    shapes = np.stack([smooth, slope], axis=1)
    part = np.linalg.pinv(shapes) @ off.T
    rest = off.T - shapes @ part
    size, left = _size(smooth), max(n - 2, 1)
    found = varying(np.sum(rest**2, axis=1) / (r - 1) * (n / left), size, size, (r - 1) * left)
    ρ = autocorrelation(rest / np.sqrt(np.maximum(found.variance, 1e-300))[:, None], r - 1)
    return White(found.variance, max(found.freedom * (1 - ρ**2) / (1 + ρ**2), 1.0)), part


def ratio_of(y: np.ndarray, smooth: np.ndarray, slope: np.ndarray, said: np.ndarray) -> float:
    """Variance of repeats y (r, n), gain and contact taken out, over what is stated as white of a reading, `said` (n,):
    χ²_ν/ν where that is right; infinite where nothing is stated."""
    r, n = y.shape
    if said.min() <= 0.0:
        return math.inf
    root = np.sqrt(said)[:, None]
    z, weighed = (y - y.mean(axis=0)).T / root, np.stack([smooth, slope], axis=1) / root
    z = z - weighed @ (np.linalg.pinv(weighed) @ z)
    return float(np.sum(z**2)) / ((r - 1) * max(n - 2, 1))


def beyond_said(seen: White, ratio: float, said: np.ndarray) -> White:
    """What noise that is `seen` has beyond the variance `said` (n,) of what is stated of the same readings.

    None, unless the `ratio` of the two, χ²_ν/ν where what is stated is right, is clearly above 1.  Then what is stated
    to change along the curve is as much larger everywhere.
    """
    if said.min() <= 0.0 or not np.isfinite(seen.freedom):
        return White(np.maximum(seen.variance - said, 0.0), seen.freedom)
    if ratio <= chi2_ppf(1 - NOISE_OVERRULE_CHANCE, seen.freedom) / seen.freedom:
        return White(np.zeros(len(said)), np.inf)
    even = np.ptp(said) <= EVEN_VARIANCE_TOLERANCE * said.max()
    return White(np.maximum(seen.variance - said, 0.0) if even else said * (ratio - 1.0), seen.freedom)


def autocorrelation(rest: np.ndarray, independent: int = 1) -> float:
    """Correlation ρ of neighbours in deviations (n, r), as many of the r curves `independent`; 0 where it may be none.

    It counts from `MIN_CORRELATION_STANDARD_ERRORS` standard errors on; what taking out the mean and two shapes cost is
    put back.
    """
    n = len(rest)
    if n < 12:
        return 0.0
    ρ = of_neighbours(rest.T)
    return min(restored(ρ, n), 0.98) if ρ > MIN_CORRELATION_STANDARD_ERRORS / np.sqrt(n * independent) else 0.0


def varying(q: np.ndarray, t: np.ndarray, at: np.ndarray, freedom: float) -> White:
    """Variance at `at` (n,) from squares q (m,) at t (m,) that hold `freedom` degrees of freedom together.

        ln σ² = β₀ + β₁ t + β₂ t²,   ln L = −ν/2 Σ_j (ln σ_j² + q_j/σ_j²)   with ν = freedom/m

    The terms in t are let in one by one where the likelihood ratio says that even noise has them in one case of a
    hundred; each costs a degree of freedom.  Source: McCullagh & Nelder, Generalized Linear Models, 1989, §8.3.
    """
    mean, spread = float(q.mean()), float(np.ptp(t))
    even = White(np.full(len(at), mean), freedom)
    if mean == 0.0 or spread < 1e-6 or len(q) < MIN_READINGS_FOR_NOISE:
        return even

    def terms(v: np.ndarray) -> np.ndarray:
        return np.vander((v - t.mean()) / spread, MAX_LOG_NOISE_DEGREE + 1, increasing=True)

    X, ν, best = terms(t), freedom / len(q), even
    least, k = _deviance(X[:, :1], np.zeros(1), q / mean), 0
    for d in range(1, MAX_LOG_NOISE_DEGREE + 1):
        β, deviance = _gamma(X[:, : d + 1], q / mean)
        if ν * (least - deviance) > chi2_ppf(1 - VARYING_NOISE_CHANCE, d - k):
            least, k = deviance, d
            best = White(mean * np.exp(terms(at)[:, : d + 1] @ β), max(freedom - d, 1.0))
    return best


def _size(smooth: np.ndarray) -> np.ndarray:
    """ln(|ŷ| + a hundredth of its largest) (n,): noise in proportion to the force or to its slope is straight in it."""
    largest = float(np.abs(smooth).max())
    return np.log(np.abs(smooth) / largest + FAINT_FORCE_SHARE) if largest > 0 else np.zeros(len(smooth))


def _deviance(X: np.ndarray, β: np.ndarray, q: np.ndarray) -> float:
    η = np.clip(X @ β, -60.0, 60.0)
    return float(np.sum(η + q * np.exp(-η)))


def _gamma(X: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, float]:
    """β of least Σ (Xβ + q e^{−Xβ}), and that, by Fisher's scoring with halved steps; it is convex."""
    β = np.zeros(X.shape[1])
    now, inverse = _deviance(X, β, q), np.linalg.pinv(X)
    for _ in range(60):
        step = inverse @ (q * np.exp(-np.clip(X @ β, -60.0, 60.0)) - 1.0)
        while (after := _deviance(X, β + step, q)) > now and np.abs(step).max() > 1e-9:
            step *= 0.5
        if now - after < 1e-9:
            break
        β, now = β + step, after
    return β, now
