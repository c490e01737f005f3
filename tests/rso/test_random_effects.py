"""Random effects of specimens: a published table, integrals done another way, coverage on simulated specimens."""

import itertools

import numpy as np
import pytest
from scipy import integrate, stats

from rso.inference.random_effects import (
    SpecimenLikelihood,
    deleted_residuals,
    gaussian_likelihood,
    likelihood_of_profile,
    marginal,
    outliers,
    random_effects,
)

# Tuberculosis with and without BCG vaccine: Colditz et al., JAMA 271 (1994) 698, as in Viechtbauer, J. Stat. Softw. 36
# (2010) no. 3, table of section 3: positive and negative, of those vaccinated and not.
BCG = np.array(
    [
        [4, 119, 11, 128], [6, 300, 29, 274], [3, 228, 11, 209], [62, 13536, 248, 12619], [33, 5036, 47, 5761],
        [180, 1361, 372, 1079], [8, 2537, 10, 619], [505, 87886, 499, 87892], [29, 7470, 45, 7232],
        [17, 1699, 65, 1600], [186, 50448, 141, 27197], [5, 2493, 3, 2338], [27, 16886, 29, 17825],
    ],
    float,
)  # fmt: skip


def log_risk_ratios():
    a, b, c, d = BCG.T
    return np.log(a / (a + b) / (c / (c + d))), np.sqrt(1 / a - 1 / (a + b) + 1 / c - 1 / (c + d))


def gaussians(y, s):
    return [gaussian_likelihood(*one) for one in zip(y, s, strict=True)]


def test_a_published_table():
    """τ², mean, I², Q and the Q-profile interval that metafor prints for these trials by REML (same paper, p. 15)."""
    found = random_effects(gaussians(*log_risk_ratios()), level=0.95)
    assert found.tau**2 == pytest.approx(0.3132, abs=5e-5)
    assert found.mean == pytest.approx(-0.7145, abs=5e-5)
    assert found.i2 == pytest.approx(0.9222, abs=5e-5)
    assert found.q == pytest.approx(152.2330, abs=5e-5)
    assert np.square(found.tau_interval) == pytest.approx([0.1197, 1.1115], abs=5e-5)
    assert found.q_p_value < 1e-4


def closed_form(y, s, tau):
    """Mean, Hartung–Knapp standard error (no less than that of known errors) at a given τ."""
    w = 1 / (s**2 + tau**2)
    mean = np.sum(w * y) / w.sum()
    return mean, np.sqrt(max(1.0, np.sum(w * (y - mean) ** 2) / (len(y) - 1)) / w.sum())


def test_intervals_by_the_formulas():
    y, s = log_risk_ratios()
    found = random_effects(gaussians(y, s), level=0.95)
    mean, se = closed_form(y, s, found.tau)
    assert found.interval == pytest.approx(mean + np.array([-1, 1]) * stats.t.ppf(0.975, 12) * se, abs=1e-6)


def test_a_prediction_by_drawing_it():
    """Draws of τ that satisfy Q(τ) = χ², of the mean given τ and of the next trial: algorithm 1 of Nagashima et al."""
    y, s = log_risk_ratios()
    rng, n = np.random.default_rng(3), 40000
    wanted = np.sort(rng.chisquare(12, n))[::-1]

    def q(tau):
        w = 1 / (s**2 + tau**2)
        return np.sum(w * (y - np.sum(w * y) / w.sum()) ** 2)

    grid = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 4000)])
    tau = np.interp(-wanted, -np.array([q(t) for t in grid]), grid)
    mean, se = np.array([closed_form(y, s, t) for t in tau]).T
    new = mean + se * rng.standard_t(12, n) + tau * rng.standard_normal(n)
    low, high = random_effects(gaussians(y, s), level=0.95).prediction
    # 4 standard errors of the share of the draws in each tail
    assert [np.mean(new < low), np.mean(new > high)] == pytest.approx([0.025, 0.025], abs=4 * np.sqrt(0.025 / n))


# ln μ of six simulated slabs at r = −3, −2.5, … 3, as `rso run` found them: D₁ is open, so they rise in kinks.
SLABS = np.array(
    [
        [-4.592, -4.577, -4.562, -4.548, -4.533, -4.515, -4.488, -4.446, -4.414, -4.376, -4.312, -4.228, -4.157],
        [-4.497, -4.482, -4.466, -4.451, -4.429, -4.413, -4.359, -4.317, -4.271, -4.218, -4.149, -4.076, -4.022],
        [-4.527, -4.512, -4.498, -4.484, -4.469, -4.456, -4.442, -4.411, -4.334, -4.279, -4.236, -4.18, -4.107],
        [-4.558, -4.544, -4.529, -4.515, -4.501, -4.486, -4.456, -4.41, -4.368, -4.317, -4.281, -4.239, -4.175],
        [-4.453, -4.438, -4.423, -4.407, -4.392, -4.366, -4.324, -4.288, -4.219, -4.174, -4.132, -4.086, -4.051],
        [-4.35, -4.333, -4.316, -4.299, -4.281, -4.209, -4.164, -4.117, -4.082, -4.042, -3.968, -3.898, -3.844],
    ]
)  # fmt: skip


def test_uneven_profiles_say_what_even_ones_say():
    """Mean, prediction, Q and interval of τ are near those of Gaussians as wide at ±1, which have closed forms.

    A profile in pieces has places where its marginal has no curvature; a Q that divides by that is without bounds.
    Tolerances: these profiles are up to three times as flat above their best value as below it.
    """
    specimens = [SpecimenLikelihood(at, np.linspace(-3.0, 3.0, 13)) for at in SLABS]
    even = random_effects(gaussians(SLABS[:, 6], 0.5 * (SLABS[:, 8] - SLABS[:, 4])))
    found = random_effects(specimens)
    assert found.q == pytest.approx(even.q, rel=0.5)
    assert found.mean == pytest.approx(even.mean, abs=0.05)
    assert found.prediction == pytest.approx(even.prediction, abs=0.2 * np.ptp(even.prediction))


def skewed(open_high=False):
    """A likelihood that is steep below and flat above its best value, or open there."""
    return SpecimenLikelihood(np.array([-0.6, 0.0, 1.0, 2.5]), np.array([-2.0, 0.0, 0.7, 1.1]), False, open_high)


NEARLY = SpecimenLikelihood(np.array([-0.1, 0.3, 0.7001]), np.array([-2.0, 0.0, 2.0]))  # not by the closed form


@pytest.mark.parametrize("one", [skewed(), skewed(True), NEARLY, gaussian_likelihood(0.3, 0.2)])
@pytest.mark.parametrize("tau", [0.02, 0.3, 3.0])
def test_a_marginal_is_its_integral(one, tau):
    """ℓ by adaptive quadrature over θ, derivatives by differences of that."""

    def likelihood(theta):
        r = np.interp(theta, one.at, one.root)
        if theta < one.at[0]:
            r = one.root[0] + (theta - one.at[0]) * (one.root[1] - one.root[0]) / (one.at[1] - one.at[0])
        if theta > one.at[-1] and not one.open_high:
            r = one.root[-1] + (theta - one.at[-1]) * (one.root[-1] - one.root[-2]) / (one.at[-1] - one.at[-2])
        return np.exp(-r * r / 2)

    def value(m):
        def inside(z):
            return likelihood(m + tau * z) * stats.norm.pdf(z)

        cuts = sorted({float(np.clip(v, -10, 10)) for v in (one.at - m) / tau} | {-10.0, -3.0, 0.0, 3.0, 10.0})
        parts = [integrate.quad(inside, a, b, epsabs=1e-13)[0] for a, b in itertools.pairwise(cuts)]
        return np.log(sum(parts))

    for m in (-0.3, 0.4, 1.7):
        got, h = marginal([one], np.array([m]), tau), 2e-3
        assert got.value[0, 0] == pytest.approx(value(m), abs=3e-3)
        assert got.slope[0, 0] == pytest.approx((value(m + h) - value(m - h)) / (2 * h), abs=0.02 / min(tau, 0.3))


def test_restricted_likelihood_by_another_integral():
    """τ with skewed and one-sided likelihoods is where a double integral on a plain grid is largest."""
    every = [skewed(), skewed(True), gaussian_likelihood(-0.5, 0.1), gaussian_likelihood(0.6, 0.15), skewed()]
    theta = np.linspace(-8, 30, 4001)  # 0.01, a twentieth of the least τ
    step, m = theta[1] - theta[0], np.linspace(-3, 3, 121)
    rows = np.array([np.exp(-0.5 * one.of(theta)[0] ** 2) for one in every])

    def restricted(tau):
        kernel = stats.norm.pdf(theta[None], m[:, None], tau)
        return np.log(np.sum(np.prod(rows @ kernel.T * step, axis=0)))

    grid = np.linspace(0.2, 1.2, 101)
    best = grid[np.argmax([restricted(t) for t in grid])]
    assert random_effects(every).tau == pytest.approx(best, abs=0.011)


def simulated(rng, k, tau):
    s = rng.uniform(0.05, 0.3, k)
    return 1.0 + tau * rng.standard_normal(k) + s * rng.standard_normal(k), s


@pytest.mark.parametrize(("k", "tau"), [(6, 0.15), pytest.param(12, 0.3, marks=pytest.mark.verification), (6, 0.0)])
def test_intervals_cover(k, tau):
    """90 % intervals of the mean and of the next specimen hold at least 90 % of the data sets, to 2.5 of their σ.

    The interval of τ does so too, and without scatter τ is mostly estimated as little and nobody is an outlier.
    """
    rng = np.random.default_rng(k)
    hits = np.zeros(3)
    small, marked, trials = 0, 0, 100
    for _ in range(trials):
        every = gaussians(*simulated(rng, k, tau))
        found = random_effects(every)
        new = 1.0 + tau * rng.standard_normal()
        span = found.tau_interval or (1.0, -1.0)
        hits += [a <= x <= b for x, (a, b) in ((1.0, found.interval), (new, found.prediction), (tau, span))]
        small += found.tau < 0.1
        marked += any(outliers(deleted_residuals(every)))
    low = 0.9 - 2.5 * np.sqrt(0.09 / trials)
    assert np.all(hits[:2] / trials > low)
    assert hits[2] / trials > low
    assert marked / trials < 0.05 + 2.5 * np.sqrt(0.0475 / trials)
    if tau == 0.0:
        assert small / trials > 0.75


@pytest.mark.parametrize("trials", [20, pytest.param(400, marks=pytest.mark.verification)])
def test_an_error_that_all_specimens_share_is_counted_once(trials):
    """One calibration error of all: counted as each specimen's own, it is averaged out and the mean too sure."""
    rng, S = np.random.default_rng(11), 0.3
    hits, spread = np.zeros(3), np.zeros(2)
    for _ in range(trials):
        y, s = simulated(rng, 8, 0.1)
        y = y + S * rng.standard_normal()
        whole = gaussians(y, np.hypot(s, S))
        every = [one.without(S**2 / (v**2 + S**2)) for one, v in zip(whole, s, strict=True)]
        found, own = random_effects(every, shared=S), random_effects(whole)
        new = 1.0 + 0.1 * rng.standard_normal()
        spans = (1.0, found.interval), (new, found.prediction), (1.0, own.interval)
        hits += [a <= x <= b for x, (a, b) in spans]
        spread += [found.tau, own.tau]
    low = 0.9 - 2.5 * np.sqrt(0.09 / trials)
    assert np.all(hits[:2] / trials > low)
    assert hits[2] / trials < low
    assert spread[1] < 0.5 * spread[0]  # and the scatter is lost in it


def test_an_outlier_is_found_and_only_it():
    rng = np.random.default_rng(5)
    y, s = simulated(rng, 10, 0.1)
    y[3] += 2.0
    assert np.flatnonzero(outliers(deleted_residuals(gaussians(y, s)))).tolist() == [3]


def test_deleted_residuals_by_leaving_out():
    y, s = log_risk_ratios()
    got = deleted_residuals(gaussians(y, s))
    for n in (0, 7):
        rest = np.arange(13) != n
        others = random_effects(gaussians(y[rest], s[rest]))
        _, se = closed_form(y[rest], s[rest], others.tau)
        t = (y[n] - others.mean) / np.sqrt(s[n] ** 2 + others.tau**2 + se**2)
        assert got[n] == pytest.approx((t, 2 * stats.t.sf(abs(t), 11)), rel=1e-4)


def test_a_one_sided_specimen_moves_what_it_excludes():
    """One known to lie above the others draws the mean up and adds scatter; one that excludes nothing does not."""
    rng = np.random.default_rng(7)
    every = gaussians(*simulated(rng, 8, 0.1))
    alone = random_effects(every)
    level = SpecimenLikelihood(np.array([-2.0, -1.5, -1.0]), np.array([-3.0, -1.5, 0.0]), False, True)
    above = SpecimenLikelihood(np.array([1.8, 1.9, 2.0]), np.array([-3.0, -1.5, 0.0]), False, True)
    with_level, with_above = random_effects([*every, level]), random_effects([*every, above])
    assert with_level.mean == pytest.approx(alone.mean, abs=1e-6) and with_level.tau == pytest.approx(
        alone.tau, abs=1e-4
    )
    assert with_above.mean > alone.mean + 0.05 and with_above.tau > 1.5 * alone.tau
    assert (with_above.used, with_above.one_sided) == (8, 1)
    assert deleted_residuals([*every, above])[-1] is None


def test_too_few_specimens():
    one = random_effects([gaussian_likelihood(1.0, 0.1)])
    assert one.mean == pytest.approx(1.0) and one.interval is None and one.tau_interval is None
    two = random_effects(gaussians([1.0, 1.1], [0.1, 0.1]))
    assert two.interval is not None and two.prediction is None
    with pytest.raises(ValueError, match="both sides"):
        random_effects([skewed(True)])


def test_specimens_more_alike_than_their_errors():
    """Then no scatter fits, and the mean is no better known than by these errors."""
    found = random_effects(gaussians(np.linspace(0.99, 1.01, 10), np.full(10, 0.5)))
    assert found.tau == 0.0 and found.tau_interval is None
    assert found.interval[1] - found.interval[0] > 2 * stats.norm.ppf(0.95) * 0.5 / np.sqrt(10) * 0.999


def test_a_profile_becomes_its_likelihood():
    """A parabola in χ² is a Gaussian; with an interval that is wider by a factor so is its likelihood."""
    at = np.linspace(-1.0, 3.0, 41)
    rise = ((at - 1.0) / 0.4) ** 2
    z = stats.norm.ppf(0.95)
    for factor in (1.0, 1.5):
        ends = 1.0 - z * 0.4 * factor, 1.0 + z * 0.4 * factor
        made = likelihood_of_profile(at, rise, ends, (False, False), 0.9)
        r = made.of(np.array([1.0 - 0.4 * factor, 1.0, 1.0 + 0.8 * factor]))[0]
        assert r == pytest.approx([-1.0, 0.0, 2.0], abs=0.02)
    assert likelihood_of_profile(at, rise, (-1.0, 3.0), (True, True), 0.9) is None
    upper = likelihood_of_profile(at[:28], rise[:28], (1.0 - z * 0.4, at[27]), (False, True), 0.9)
    assert upper.open_high and not upper.closed
    beyond = upper.of(np.array([at[27], 10.0]))
    assert beyond[0][0] == pytest.approx(beyond[0][1]) and beyond[1][1] == 0.0
