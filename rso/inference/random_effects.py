"""A parameter over several specimens: their mean, how much they differ, and what the next one may have.

Specimen i has its own θ_i ~ N(m, τ²), and its data say L_i(θ_i).  In place of an estimate and its standard error the
likelihood itself is used, as a profile gives it, so that a specimen whose interval is open says what it knows: with
L_i Gaussian everything is the random-effects model of meta-analysis.

    ℓ_i(m, τ) = ln ∫ L_i(θ) φ((θ − m)/τ)/τ dθ,      τ̂ = argmax ∫ exp(Σ ℓ_i(m, τ)) dm      (REML)

Sources: Viechtbauer, J. Educ. Behav. Stat. 30 (2005) 261, eq. 6 (REML); Hartung & Knapp, Stat. Med. 20 (2001) 3875,
eq. 6 (interval of the mean); Nagashima, Noma & Furukawa, Stat. Methods Med. Res. 28 (2019) 1689 (prediction);
Viechtbauer, Stat. Med. 26 (2007) 37, eq. 8 (interval of τ); Higgins & Thompson, Stat. Med. 21 (2002) 1539, eq. 9 (I²).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.optimize import brentq, minimize_scalar

from rso.core.distributions import chi2_ppf, chi2_sf, normal_ppf, t_ppf

MAX_PROFILE_ROOT = 3.0  # signed roots between which a profile is taken as it is, at every half
PROFILE_ROOTS = np.linspace(-MAX_PROFILE_ROOT, MAX_PROFILE_ROOT, 13)  # signed roots at which a profile is read
NEGLIGIBLE_ROOT = 7.5  # signed root of the deviance beyond which a likelihood is nothing: e^{−28}
# of each piece of a profile: exact to degree 15 there
LEGENDRE_NODES, LEGENDRE_WEIGHTS = np.polynomial.legendre.leggauss(8)
HERMITE_NODES, HERMITE_WEIGHTS = np.polynomial.hermite_e.hermegauss(32)  # over the population, one specimen at a time
# over the mean, ±`MEAN_RANGE_SD` of its standard deviations
MEAN_NODES, MEAN_WEIGHTS = np.polynomial.legendre.leggauss(48)
MEAN_RANGE_SD = 8.0  # standard deviations to either side: beyond them no probability counts
NO_SPREAD_RATIO = 1e-4  # of the least width of a likelihood: a τ below is none
MAX_SPREAD_RATIO = 1e3  # of the largest distance between two specimens, or of a width: τ is not looked for beyond
# parts of equal probability into which τ and the error of the mean are divided for a prediction
N_PREDICTION_PARTS = 128
N_PEAK_MEANS = 33  # means among which the likeliest of one specimen is looked for
MAX_SHARED_VARIANCE = 0.99  # of the variance of one specimen: what is its own is not known to be less than the rest
FALSE_OUTLIER_CHANCE = 0.05  # probability with which any specimen at all is called one although none is


@dataclass(frozen=True, eq=False)
class SpecimenLikelihood:
    """What the data of one specimen say: L(θ) = exp(−r(θ)²/2) with r piecewise linear, the signed root of the deviance.

    `at` (g,) increases, `root` (g,) is r there, negative below the best value.  Beyond the ends r goes on as it is
    (Gaussian tails), but at an `open` end, where the search was cut off, L stays what it is: nothing is known there.
    """

    at: np.ndarray
    root: np.ndarray
    open_low: bool = False
    open_high: bool = False

    @property
    def closed(self) -> bool:
        """Whether the data bound it on both sides."""
        return not (self.open_low or self.open_high)

    @functools.cached_property
    def slopes(self) -> np.ndarray:
        """dr/dθ between points (g − 1,)."""
        return np.diff(self.root) / np.diff(self.at)

    @functools.cached_property
    def width(self) -> float:
        """Its standard deviation where it is steepest: how fine it is."""
        return float(1.0 / self.slopes.max())

    @functools.cached_property
    def best(self) -> float:
        """The likeliest value."""
        return float(np.interp(0.0, self.root, self.at))

    @functools.cached_property
    def normal(self) -> bool:
        """Whether it is Gaussian."""
        return self.closed and bool(np.ptp(self.slopes) <= 1e-9 * self.slopes.max())

    def without(self, share: float) -> SpecimenLikelihood:
        """The same specimen without an error that makes this share of its variance, which all specimens have alike."""
        narrower = math.sqrt(1.0 - min(share, MAX_SHARED_VARIANCE))
        return SpecimenLikelihood(self.at, self.root / narrower, self.open_low, self.open_high)

    def of(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r(θ) and its slope."""
        slopes = self.slopes
        k = np.clip(np.searchsorted(self.at, theta) - 1, 0, len(slopes) - 1)
        r, slope = self.root[k] + slopes[k] * (theta - self.at[k]), slopes[k]
        for beyond, end in ((self.open_low & (theta < self.at[0]), 0), (self.open_high & (theta > self.at[-1]), -1)):
            r, slope = np.where(beyond, self.root[end], r), np.where(beyond, 0.0, slope)
        return r, slope

    def extent(self) -> tuple[float, float]:
        """From where to where L is more than nothing, or known."""
        slopes = self.slopes
        low = self.at[0] - max(NEGLIGIBLE_ROOT + self.root[0], 0.0) / slopes[0]
        high = self.at[-1] + max(NEGLIGIBLE_ROOT - self.root[-1], 0.0) / slopes[-1]
        return float(self.at[0] if self.open_low else low), float(self.at[-1] if self.open_high else high)


def gaussian_likelihood(value: float, sd: float) -> SpecimenLikelihood:
    """The likelihood of an estimate with its standard error."""
    return SpecimenLikelihood(value + sd * np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0]))


def likelihood_of_profile(
    at: np.ndarray, rise: np.ndarray, interval: tuple[float, float], bounds: tuple[bool, bool], level: float
) -> SpecimenLikelihood | None:
    """The likelihood of a profile: `rise` (g,) of χ² over its least value at `at` (g,), which increases.

    `interval` has a `level`, and where a `bounds` is true its end is that of the search.  Each side is stretched so
    that its end has the r of that level: what the interval counts beside χ² (few readings, runs that contradict) is
    then counted.  None where the data bound it on neither side.
    """
    z, best = float(normal_ppf(0.5 * (1.0 + level))), int(np.argmin(rise))
    root = np.sqrt(np.maximum(rise - rise[best], 0.0)) * np.where(np.arange(len(at)) < best, -1.0, 1.0)
    if all(bounds):
        return None
    sides = []
    for side, end, cut in ((-1.0, interval[0], bounds[0]), (1.0, interval[1], bounds[1])):
        there = abs(float(np.interp(end, at, root)))
        sides.append(None if cut or there == 0.0 or side * (end - at[best]) <= 0.0 else z / there)
    low, high = (own or next(s for s in (other, 1.0) if s) for own, other in (sides, sides[::-1]))
    root = root * np.where(root < 0.0, low, high)
    root = np.maximum.accumulate(root)  # of several pieces the outermost ends count
    ends = max(root[0], -MAX_PROFILE_ROOT), min(root[-1], MAX_PROFILE_ROOT)
    inner = PROFILE_ROOTS[(PROFILE_ROOTS > ends[0] + 0.1) & (PROFILE_ROOTS < ends[1] - 0.1)]
    levels = np.array([ends[0], *inner, ends[1]])  # a profile has points as near as its descents happen to end
    theta = np.interp(levels, root + 1e-12 * np.arange(len(root)), at)
    keep = np.concatenate([[True], np.diff(theta) > 0.0])
    if keep.sum() < 2:
        return None
    return SpecimenLikelihood(theta[keep], levels[keep], bounds[0], bounds[1])


@dataclass(frozen=True, eq=False)
class Marginal:
    """ℓ_i at means (n,): value, slope u = dℓ/dm and curvature j = −d²ℓ/dm², each (k, n)."""

    value: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray


def marginal(specimens: Sequence[SpecimenLikelihood], mean: np.ndarray, tau: float) -> Marginal:
    """ℓ_i(m, τ) of every specimen at means (n,) and its derivatives by them; with τ = 0 it is ln L_i(m)."""
    m = np.atleast_1d(np.asarray(mean, float))
    parts = np.empty((3, len(specimens), len(m)))
    normal = np.array([s.normal for s in specimens])
    if normal.any():  # in closed form
        y, sd = np.array([(s.best, s.width) for s in specimens if s.normal]).T[:, :, None]
        variance = sd**2 + tau**2
        parts[0, normal] = np.log(sd) - 0.5 * np.log(variance) - 0.5 * (y - m) ** 2 / variance
        parts[1, normal] = (y - m) / variance
        parts[2, normal] = 1.0 / variance
    for k, one in enumerate(specimens):
        if not one.normal:
            parts[:, k] = _marginal(one, m, tau)
    return Marginal(*parts)


def _marginal(one: SpecimenLikelihood, m: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if tau <= NO_SPREAD_RATIO * one.width:
        r, slope = one.of(m)
        return -0.5 * r * r, -r * slope, slope * slope
    if tau <= one.width:  # L is smooth where the Gaussian is: quadrature of the Gaussian
        away = tau * np.broadcast_to(HERMITE_NODES, (len(m), len(HERMITE_NODES)))
        log = np.log(HERMITE_WEIGHTS / np.sqrt(2 * np.pi)) - 0.5 * one.of(m[:, None] + away)[0] ** 2
    else:  # the Gaussian is smooth where L is: panels over L
        low, high = one.extent()
        edges = np.unique(np.concatenate([np.linspace(low, high, min(64, math.ceil((high - low) / one.width)) + 1)]))
        half = 0.5 * np.diff(edges)
        theta = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * LEGENDRE_NODES).ravel()
        weight = (half[:, None] * LEGENDRE_WEIGHTS).ravel()
        away = theta - m[:, None]
        log = np.log(weight / (tau * np.sqrt(2 * np.pi))) - 0.5 * (away / tau) ** 2 - 0.5 * one.of(theta)[0] ** 2
    first, second = away, away * away
    if tau > one.width:
        for open_, end, side in ((one.open_low, 0, -1.0), (one.open_high, -1, 1.0)):
            if open_:  # a flat tail: the rest of the Gaussian and its moments
                z = side * (one.at[end] - m) / tau
                mass = special.log_ndtr(-z)
                mills = np.exp(-0.5 * z * z - 0.5 * np.log(2 * np.pi) - mass)
                log = np.column_stack([log, mass - 0.5 * one.root[end] ** 2])
                first = np.column_stack([first, side * tau * mills])
                second = np.column_stack([second, tau * tau * (1.0 + z * mills)])
    top = log.max(axis=1)
    w = np.exp(log - top[:, None])
    total = w.sum(axis=1)
    e1, e2 = (w * first).sum(axis=1) / total, (w * second).sum(axis=1) / total
    curvature = (1.0 - (e2 - e1 * e1) / tau**2) / tau**2
    return top + np.log(total), e1 / tau**2, np.maximum(curvature, 0.0)


@dataclass(frozen=True)
class RandomEffects:
    """Specimens as a population: `mean` and its `interval`, `tau` and its interval, `prediction` for the next specimen.

    `q` is Cochran's Q with its p-value, `i2` the share of the variance between estimates that is between specimens.
    `used` specimens were bounded on both sides, `one_sided` on one.  None where there are too few: the interval of the
    mean and τ need two that are bounded on both sides, a prediction three.
    """

    mean: float
    sd: float
    interval: tuple[float, float] | None
    tau: float
    tau_interval: tuple[float, float] | None
    prediction: tuple[float, float] | None
    q: float
    q_p_value: float | None
    i2: float | None
    used: int
    one_sided: int


def random_effects(
    specimens: Sequence[SpecimenLikelihood], level: float = 0.9, *, shared: float = 0.0
) -> RandomEffects:
    """The population of specimens by REML, with the Hartung–Knapp interval of its mean.

    With j_i the information about m in specimen i, the variance of the mean is max(1, Q(τ)/(k − 1)) / Σ j_i, Q(τ) as in
    :func:`_scatter`: for Gaussian L_i that of Hartung & Knapp, which the 1 keeps from being less than that of known
    errors (Röver, Knapp & Friede, BMC Med. Res. Methodol. 15 (2015) 99, eq. 9).  The k in it are the specimens bounded
    on both sides; one that is bounded on one side moves the mean and τ by what it excludes.

    The likelihoods are those without errors that all specimens have alike.  Of these `shared` is the standard deviation
    of the mean, Gaussian and known: its quantile is added to that of the mean, and to each side of the prediction, in
    quadrature, as more specimens do not average it out.

    Raises ValueError without a specimen that is bounded on both sides.
    """
    closed = [s for s in specimens if s.closed]
    if not closed:
        raise ValueError("random_effects: no specimen is bounded on both sides")
    k = len(closed)
    tau = _tau(specimens) if k > 1 else 0.0
    mean, sd, _ = _mean_at(specimens, closed, tau)
    alike = float(normal_ppf(0.5 * (1.0 + level))) * shared
    interval = None
    if k > 1:
        reach = math.hypot(float(t_ppf(0.5 * (1 + level), k - 1)) * sd, alike)
        interval = (mean - reach, mean + reach)
    prediction = None
    if k > 2:
        low, high = _prediction(specimens, closed, level)
        prediction = (mean - math.hypot(mean - low, alike), mean + math.hypot(high - mean, alike))
    at_none = marginal(closed, np.array([_mode(closed, 0.0)]), 0.0)
    q, w = _scatter(closed, at_none, 0.0), at_none.curvature[:, 0]
    i2 = None
    if k > 1:
        typical = (k - 1) * w.sum() / (w.sum() ** 2 - (w**2).sum())
        i2 = float(tau**2 / (tau**2 + typical))
    p = float(chi2_sf(q, k - 1)) if k > 1 else None
    found = _tau_interval(closed, level) if k > 1 else None
    return RandomEffects(mean, sd, interval, tau, found, prediction, q, p, i2, k, len(specimens) - k)


def deleted_residuals(specimens: Sequence[SpecimenLikelihood]) -> list[tuple[float, float] | None]:
    """Of each specimen its distance from all others over its standard deviation, t, and the p-value of that.

    t_i = (y_i − m_(i)) / √(s_i² + τ_(i)² + Var m_(i)) with m and τ of the others, k − 2 degrees of freedom; y_i and s_i
    are the best value and half the width of ±1 in r.  None for one that is not bounded on both sides, and for fewer
    than four that are.
    Source: Viechtbauer & Cheung, Res. Synth. Methods 1 (2010) 112, eq. 10.
    """
    closed = [k for k, s in enumerate(specimens) if s.closed]
    found: list[tuple[float, float] | None] = [None] * len(specimens)
    if len(closed) < 4:
        return found
    y, s = (np.array(v) for v in zip(*(_gaussian_of(specimens[k]) for k in closed), strict=True))
    for n, k in enumerate(closed):
        others = np.arange(len(y)) != n
        mean, variance, tau = _of_estimates(y[others], s[others])
        t = float((y[n] - mean) / math.sqrt(s[n] ** 2 + tau**2 + variance))
        found[k] = t, float(2.0 * special.stdtr(len(closed) - 2, -abs(t)))
    return found


def _of_estimates(y: np.ndarray, s: np.ndarray) -> tuple[float, float, float]:
    """Mean, its Hartung–Knapp variance and τ of Gaussian estimates, by REML in closed form."""

    def at(tau: float) -> tuple[float, np.ndarray, np.ndarray]:
        w = 1.0 / (s**2 + tau**2)
        mean = float(w @ y / w.sum())
        return mean, w, w * (y - mean) ** 2

    def loss(tau: float) -> float:
        _, w, square = at(tau)
        return float(square.sum() - np.log(w).sum() + np.log(w.sum()))

    most = 3.0 * max(float(np.ptp(y)), float(s.max()))
    grid = np.array([0.0, *np.geomspace(1e-3 * s.min(), most, 40)])
    n = int(np.argmin([loss(t) for t in grid]))
    ends = grid[max(n - 1, 0)], grid[min(n + 1, 40)]
    tau = float(minimize_scalar(loss, bounds=ends, method="bounded", options={"xatol": 1e-9 * most}).x) if n else 0.0
    mean, w, square = at(tau)
    return mean, float(max(1.0, square.sum() / (len(y) - 1)) / w.sum()), tau


def outliers(residuals: Sequence[tuple[float, float] | None], rate: float = FALSE_OUTLIER_CHANCE) -> list[bool]:
    """Which specimens are outliers: p below `rate` over the number that was looked at (Bonferroni)."""
    count = sum(r is not None for r in residuals)
    return [r is not None and r[1] < rate / count for r in residuals]


def _gaussian_of(one: SpecimenLikelihood) -> tuple[float, float]:
    """Best value and standard deviation: half the width of ±1 in r."""
    best, low, high = (float(np.interp(v, one.root, one.at)) for v in (0.0, -1.0, 1.0))
    slopes = one.slopes
    low = one.at[0] - (1.0 + one.root[0]) / slopes[0] if one.root[0] > -1.0 else low
    high = one.at[-1] + (1.0 - one.root[-1]) / slopes[-1] if one.root[-1] < 1.0 else high
    return best, 0.5 * float(high - low)


def _scatter(closed: Sequence[SpecimenLikelihood], at: Marginal, tau: float) -> float:
    """Generalised Q(τ) at the one mean of `at`: for Gaussian L_i the weighted sum of squares about it, Σ u²/j.

    Else 2 Σ [max ℓ_i(·, τ) − ℓ_i(m, τ)], the deviance, which is the same of Gaussians.  The curvature j of a profile in
    pieces vanishes in places, and u²/j has no bounds there.
    """
    normal = np.array([s.normal for s in closed])
    u, j, value = at.slope[normal, 0], at.curvature[normal, 0], at.value[~normal, 0]
    top = np.array([_peak(s, tau) for s in closed if not s.normal])
    return float(np.sum(u**2 / j) + 2.0 * np.sum(np.maximum(top - value, 0.0)))


def _peak(one: SpecimenLikelihood, tau: float) -> float:
    """max ℓ(m, τ) over m, 0 at τ = 0: of points through the middle of L the highest, and the parabola through it."""
    if tau <= NO_SPREAD_RATIO * one.width:
        return 0.0
    low, high = (float(np.interp(r, one.root, one.at)) for r in (-1.0, 1.0))
    value = marginal([one], np.linspace(low, high, N_PEAK_MEANS), tau).value[0]
    n = int(np.clip(np.argmax(value), 1, N_PEAK_MEANS - 2))
    below, here, above = value[n - 1 : n + 2]
    bend = 2.0 * here - below - above
    return float(here + (above - below) ** 2 / (8.0 * bend)) if bend > 0.0 else float(value.max())


def _mode(specimens: Sequence[SpecimenLikelihood], tau: float) -> float:
    """The mean at which Σ ℓ_i is largest, by Newton, where its slope falls through 0."""
    best = [s.best for s in specimens]
    m, step = float(np.median(best)), 0.0
    longest = max(float(np.ptp(best)), tau, *(s.width for s in specimens))
    for _ in range(30):
        here = marginal(specimens, np.array([m]), tau)
        u, j = float(here.slope.sum()), float(here.curvature.sum())
        step = np.clip(u / j, -longest, longest) if j > 0.0 else math.copysign(longest, u)
        m += float(step)
        if abs(step) <= 1e-11 * longest:
            return m

    def slope(at: float) -> float:
        return float(marginal(specimens, np.array([at]), tau).slope.sum())

    low, high = min(best) - longest, max(best) + longest  # kinks of r, where Newton goes to and fro
    for _ in range(60):  # an open side may draw it beyond them
        if slope(low) >= 0.0 >= slope(high):
            break
        low, high, longest = low - longest * (slope(low) < 0), high + longest * (slope(high) > 0), 2.0 * longest
    return float(brentq(slope, low, high, xtol=1e-12 * longest, rtol=1e-12))


def _restricted(specimens: Sequence[SpecimenLikelihood], tau: float) -> float:
    """ln ∫ exp(Σ ℓ_i(m, τ)) dm."""
    centre = _mode(specimens, tau)
    sd = 1.0 / math.sqrt(max(float(marginal(specimens, np.array([centre]), tau).curvature.sum()), 1e-300))
    value = marginal(specimens, centre + MEAN_RANGE_SD * sd * MEAN_NODES, tau).value.sum(axis=0)
    return float(special.logsumexp(value, b=MEAN_RANGE_SD * sd * MEAN_WEIGHTS))


def _tau(specimens: Sequence[SpecimenLikelihood]) -> float:
    """τ by REML; 0 where nothing is likelier."""
    grid = _taus(specimens)
    values = [_restricted(specimens, t) for t in grid]
    n = int(np.argmax(values))
    if n == 0:
        near = minimize_scalar(lambda t: -_restricted(specimens, t), bounds=(0.0, grid[1]), method="bounded")
        return float(near.x) if -near.fun > values[0] + 1e-9 else 0.0
    ends = math.log(grid[n - 1] or 0.1 * grid[n]), math.log(grid[min(n + 1, len(grid) - 1)])
    found = minimize_scalar(
        lambda v: -_restricted(specimens, math.exp(v)), bounds=ends, method="bounded", options={"xatol": 1e-7}
    )
    return math.exp(float(found.x))


def _taus(specimens: Sequence[SpecimenLikelihood]) -> list[float]:
    """0, and values of τ from far below the widths of the likelihoods to as far as specimens lie apart."""
    best = [s.best for s in specimens]
    widths = [s.width for s in specimens]
    most = 3.0 * max(float(np.ptp(best)), *widths)
    return [0.0, *np.geomspace(1e-2 * min(widths), most, 16)]


def _mean_at(
    specimens: Sequence[SpecimenLikelihood], closed: Sequence[SpecimenLikelihood], tau: float
) -> tuple[float, float, float]:
    """The mean at this τ, its Hartung–Knapp standard error, and the generalised Q(τ)."""
    mean = _mode(specimens, tau)
    information = float(marginal(specimens, np.array([mean]), tau).curvature.sum())
    scatter = _scatter(closed, marginal(closed, np.array([mean]), tau), tau)
    excess = max(1.0, scatter / (len(closed) - 1)) if len(closed) > 1 else 1.0
    return mean, math.sqrt(excess / information), scatter if len(closed) == len(specimens) else _q_at(closed, tau)


def _prediction(
    specimens: Sequence[SpecimenLikelihood], closed: Sequence[SpecimenLikelihood], level: float
) -> tuple[float, float]:
    """Ends of the prediction interval: θ = m(τ) + τ z + sd(τ) t, with τ from its confidence distribution.

    That distribution is C(τ) = P(χ²_{k−1} ≥ Q(τ)) with the generalised Q, z is standard normal and t has k − 1 degrees
    of freedom.  With τ̂ alone it would be too narrow where specimens are few (`python benchmarks/random_effects.py`).
    """
    k, (least, most) = len(closed), _taus(specimens)[1::15]
    tau = np.array([*np.geomspace(least, most, 16), *(most * 4.0 ** np.arange(1, 5))])
    known = np.array([_mean_at(specimens, closed, t) for t in (0.0, *tau)])
    C = np.clip(np.maximum.accumulate([float(chi2_sf(q, k - 1)) for q in known[:, 2]]), 1e-12, 1.0 - 1e-12)
    share = (np.arange(N_PREDICTION_PARTS) + 0.5) / N_PREDICTION_PARTS
    # ln τ is nearly linear in the logit of C; all below C(least) is no scatter, all above the last C the largest.
    drawn = np.where(share < C[1], 0.0, np.exp(np.interp(special.logit(share), special.logit(C[1:]), np.log(tau))))
    m, sd = (np.interp(drawn, [0.0, *tau], known[:, n])[:, None] for n in (0, 1))
    centre = m + sd * t_ppf(share, k - 1)
    spread = np.maximum(drawn, NO_SPREAD_RATIO * sd[:, 0])[:, None]

    def above(x: float, tail: float) -> float:
        return float(special.ndtr((x - centre) / spread).mean()) - tail

    low, high = float((centre - 9 * spread).min()), float((centre + 9 * spread).max())
    ends = (
        brentq(above, low, high, args=(tail,), xtol=1e-9 * (high - low))
        for tail in (0.5 - 0.5 * level, 0.5 + 0.5 * level)
    )
    return next(ends), next(ends)


def _q_at(closed: Sequence[SpecimenLikelihood], tau: float) -> float:
    """Generalised Q(τ) at the mean of that τ."""
    return _scatter(closed, marginal(closed, np.array([_mode(closed, tau)]), tau), tau)


def _tau_interval(closed: Sequence[SpecimenLikelihood], level: float) -> tuple[float, float] | None:
    """Where the generalised Q(τ) lies between its quantiles of χ² with k − 1 degrees.

    None where no τ does: specimens agree better than their errors allow.
    """
    q = functools.partial(_q_at, closed)
    if q(0.0) < float(chi2_ppf(0.5 * (1 - level), len(closed) - 1)):
        return None
    ends = []
    for tail in (0.5 * (1 + level), 0.5 * (1 - level)):
        wanted = float(chi2_ppf(tail, len(closed) - 1))
        high = max(_taus(closed))
        while q(high) > wanted and high < MAX_SPREAD_RATIO * max(_taus(closed)):
            high *= 2.0
        if q(0.0) <= wanted:
            ends.append(0.0)
        else:
            ends.append(float(brentq(lambda t, w=wanted: q(t) - w, 0.0, high, xtol=1e-9 * high)))
    return ends[0], ends[1]
