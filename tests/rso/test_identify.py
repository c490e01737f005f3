"""Likelihood, fits, intervals and verdicts, on closed forms and published fits."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import soft_ball
from scipy import stats
from scipy.optimize import approx_fprime
from scipy.stats import multivariate_normal, truncnorm

from rso import inference, optimal_design
from rso.contract import Response
from rso.core.curves import metrics
from rso.core.digits import significant
from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation.emulator import Output, Sample, learn_emulator
from rso.inference import Data, Misfit, Model, determine, least_squares
from rso.inference.intervals import Interval, pieces
from rso.inference.verdict import judge_parameter, verdict_sentences

TRUTH = (0.01, 20.0)  # mu D1 = 0.2


def linear(A, b=0.0, box=None):
    """f(x) = A θ + b over a box (the unit cube unless given)."""
    A = np.asarray(A, float)
    d = A.shape[1]
    box = box or Box([f"p{k}" for k in range(d)], ["1"] * d, [0.0] * d, [1.0] * d, [False] * d)
    return Model(box, lambda X: box.from_unit(X) @ A.T + b)


def curve(y, C=None, sigma=1.0):
    y = np.asarray(y, float)
    return Data("c", "N", np.arange(1.0, len(y) + 1), y, sigma**2 * np.eye(len(y)) if C is None else C)


def ball(noise, seed=1, **more):
    return Misfit(soft_ball.model(), (soft_ball.data(*TRUTH, noise, np.random.default_rng(seed), **more),))


# ---- likelihood


def test_the_family_has_the_sensitivities_of_the_full_model():
    h = 1e-6
    for u, expected in ((0.4, 0.030), (4.0, 0.011)):
        up, down = (soft_ball.force(0.01, 5.8 * np.exp(s), u) for s in (h, -h))
        assert -(np.log(up) - np.log(down)) / (2 * h) == pytest.approx(expected, rel=0.02)


def test_covariance_is_that_of_simulated_repeats():
    rng, r, n = np.random.default_rng(0), 3, 4000
    u = np.array([0.5, 1.0, 2.0, 4.0])
    y, slope = u**1.5, 1.5 * np.sqrt(u)
    sizes = {"white": 0.1, "correlated": 0.2, "length": 1.0, "gain": 0.03, "depth_noise": 0.04}
    s = 0.05 * y
    C = inference.error_covariance(u, y, slope, repeats=r, numerical=s, **sizes)
    L = np.linalg.cholesky(np.exp(-np.abs(u[:, None] - u)))
    one = (
        0.1 * rng.standard_normal((n, r, 4))
        + 0.2 * rng.standard_normal((n, r, 4)) @ L.T
        + 0.03 * rng.standard_normal((n, r, 1)) * y
        + 0.04 * rng.standard_normal((n, r, 4)) * slope
    )
    drawn = one.mean(axis=1) + s * rng.standard_normal((n, 1))
    # Standard error of a covariance: √((C_ii C_jj + C_ij²)/n); four of them.
    spread = np.sqrt((np.outer(np.diag(C), np.diag(C)) + C**2) / n)
    np.testing.assert_array_less(np.abs(np.cov(drawn.T) - C), 4 * spread)
    assert (
        inference.error_covariance(u, y, slope, repeats=100, numerical=s, **sizes)[3, 3] > s[3] ** 2
    )  # repeats do not help


def test_chi2_is_minus_twice_the_log_density():
    m = ball(0.003, correlated=0.002, length=1.0, gain=0.01, depth_noise=0.01)
    X = np.random.default_rng(0).random((5, 2))
    (d,) = m.data
    density = [multivariate_normal.logpdf(d.value, f, d.covariance) for f in m.model.predict(X)]
    # A floor of 1e-6 of the largest value is added to every error: about (1e-6/0.006)² relative in χ².
    np.testing.assert_allclose(np.diff(m.chi2(X)), -2 * np.diff(density), rtol=1e-6)


def test_the_gradient_is_the_derivative_of_the_misfit():
    m, x = ball(0.003), np.array([0.4, 0.6])
    numeric = approx_fprime(x, lambda x: float(m.chi2(x[None])[0]), 1e-7)
    np.testing.assert_allclose(m.gradient(x), numeric, rtol=1e-4)  # of the one-sided difference


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: curve([1.0, np.nan]), "finite"),
        (lambda: Data("c", "N", np.ones(2), np.ones(3), np.eye(2)), "do not fit"),
        (lambda: Misfit(linear([[1.0]]), (curve([1.0]),), "best"), "choose one of noise, absolute, relative"),
        (lambda: Misfit(linear([[1.0]] * 2), (curve([1, 1], -np.eye(2)),)), "not positive definite"),
        (lambda: inference.error_covariance([1.0], [1.0], [1.0], white=-1), ">= 0"),
    ],
)
def test_misuse_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()


# ---- fits


STRAIN = [
    0.0819139,
    0.166709,
    0.25396,
    0.343267,
    0.434257,
    0.526586,
    0.619941,
    0.714042,
    0.80864,
    0.903519,
    0.998495,
    1.09341,
]
STRESS = [
    0.82788577,
    1.5437247,
    2.1686152,
    2.7201819,
    3.2129833,
    3.6589498,
    4.0677999,
    4.4474142,
    4.8041608,
    5.143172,
    5.4685772,
    5.7836943,
]


@pytest.mark.parametrize(
    ("weighting", "published"),
    # Relative: printed in ANSYS's Technology Showcase 15.1.  Absolute: least squares on the same twelve points.
    [("relative", (1.338856, 0.5236214, -0.01648364)), ("absolute", (1.283033, 0.593477, -0.006902))],
)
def test_a_published_mooney_rivlin_fit_under_both_weightings(weighting, published):
    λ = 1 + np.array(STRAIN)
    I1, I2 = λ**2 + 2 / λ, 2 * λ + λ**-2
    A = 2 * (λ - λ**-2)[:, None] * np.stack([np.ones(12), 1 / λ, (I2 - 3) + (I1 - 3) / λ], axis=1)
    box = Box(["C10", "C01", "C11"], ["MPa"] * 3, [0.0, 0.0, -1.0], [3.0, 3.0, 1.0], [False] * 3)
    fit = inference.gauss_newton(Misfit(linear(A, box=box), (curve(STRESS),), weighting), np.full(3, 0.5))
    assert fit.converged and fit.at_bound == ()
    np.testing.assert_allclose(fit.theta, published, rtol=2e-4 if weighting == "absolute" else 2e-6)  # printed digits


def test_certified_standard_deviations():
    # NIST StRD Misra1a: y = b1 (1 − exp(−b2 x)), errors of equal size.
    x = np.array([77.6, 114.9, 141.1, 190.8, 239.9, 289, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760])
    y = [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.4, 75.47, 81.78]
    box = Box(["b1", "b2"], ["1", "1"], [50.0, 1e-4], [1000.0, 1e-2], [True, True])

    def predict(X):
        b = box.from_unit(X)
        return b[:, :1] * (1 - np.exp(-b[:, 1:] * x))

    found = inference.determine(Misfit(Model(box, predict), (curve(y),), "absolute"), seed=0, mcmc=False)
    np.testing.assert_allclose(found.fit.theta, [238.94212918, 5.5015643181e-4], rtol=1e-7)
    assert found.fit.chi2 == pytest.approx(0.12455138894, rel=1e-9)
    sd = np.array([k.sd_log for k in found.known]) * found.fit.theta
    np.testing.assert_allclose(sd, [2.7070075241, 7.2668688436e-6], rtol=1e-5)  # of the differences in the Jacobian


def test_a_bound_is_kept_and_named():
    misfit = Misfit(linear(np.eye(2)), (curve([0.5, 1.4]),))
    for fit in (inference.gauss_newton(misfit, np.array([0.2, 0.2])), inference.all_minima(misfit, seed=0)[0]):
        np.testing.assert_allclose(fit.x, [0.5, 1.0], atol=1e-5)
        assert fit.at_bound == ("p1",)


def test_many_starts_at_once_end_where_gauss_newton_ends():
    m = ball(0.003)
    X = inference.levenberg_marquardt(m, np.random.default_rng(0).random((12, 2)))
    one = inference.gauss_newton(m, np.array([0.5, 0.5]))
    np.testing.assert_allclose(X, np.tile(one.x, (12, 1)), atol=1e-4)


def test_two_minima_are_both_found():
    box = Box(["p"], ["1"], [-1.0], [1.0], [False])
    model = Model(box, lambda X: np.hstack([(t := box.from_unit(X)) ** 2, 0.01 * t]))
    found = inference.all_minima(Misfit(model, (curve([0.25, 0.0], sigma=0.1),)), seed=0)
    assert sorted(float(f.theta[0]) for f in found) == pytest.approx([-0.5, 0.5], abs=1e-3)


# ---- models


def test_a_backend_with_derivatives_costs_one_run_per_iteration():
    calls = {"with": 0, "without": 0}
    u = np.linspace(0.5, 4.0, 8)

    def run(kind):
        def one(values):
            calls[kind] += 1
            mu, D1, h = values["mu"], values["D1"], 1e-6
            F = soft_ball.force(mu, D1, u)
            slopes = {
                "mu": {"Fz": (soft_ball.force(mu * (1 + h), D1, u) - F) / (mu * h)},
                "D1": {"Fz": (soft_ball.force(mu, D1 * (1 + h), u) - F) / (D1 * h)},
            }
            channels = {"time": u, "travel": u, "Fz": F}
            units = {"time": "s", "travel": "mm", "Fz": "N"}
            return {"top": Response(channels, units, gradients=slopes if kind == "with" else {})}

        return one

    data = (soft_ball.data(*TRUTH, 0.003, depth=u),)
    place = inference.CurvePlace("top", "Fz", u)
    fits = {}
    for kind in calls:
        model = inference.simulated_curves(soft_ball.BOX, run(kind), [place])
        fits[kind] = inference.gauss_newton(Misfit(model, data), np.array([0.5, 0.5]), tolerance=1e-8)
    assert calls["with"] <= fits["with"].evaluations + 1 <= 15  # one more where the end point is put on a bound
    assert calls["without"] > 2 * calls["with"]
    for fit in fits.values():
        np.testing.assert_allclose(fit.theta, TRUTH, rtol=1e-3)


def test_a_curve_from_an_emulator_is_its_spline_through_the_emulated_travels():
    box, travel = soft_ball.BOX, np.linspace(0.5, 4.0, 8)
    outputs = [Output("top", "Fz", float(u), "N") for u in travel]
    X = np.random.default_rng(0).random((40, 2))
    samples = []
    for mu, D1 in box.from_unit(X):
        F = soft_ball.force(mu, D1, travel)
        samples.append(Sample({"mu": mu, "D1": D1}, {o.id: float(f) for o, f in zip(outputs, F, strict=True)}))
    emulator = learn_emulator(box, Group(None, 1.0, {}, {"Fz": 0}, ""), outputs, samples, kind="polynomial", seed=0)
    model, band = inference.emulated(emulator, inference.CurvePlace("top", "Fz", soft_ball.DEPTH))
    x = np.array([[0.4, 0.6]])
    exact = soft_ball.model().predict(x)
    np.testing.assert_allclose(model.predict(x), exact, rtol=0.05, atol=1e-3)  # the polynomials' own error
    at = [list(soft_ball.DEPTH).index(u) for u in soft_ball.DEPTH if np.min(np.abs(travel - u)) < 1e-9]
    known = emulator.means(outputs, x)[0, [int(np.argmin(np.abs(travel - soft_ball.DEPTH[k]))) for k in at]]
    np.testing.assert_allclose(model.predict(x)[0, at], known, rtol=1e-9)
    assert band(x[0]).shape == (40,) and np.all(band(x[0]) > 0)
    with pytest.raises(ValueError, match="no Fx of 'top'"):
        inference.emulated(emulator, inference.CurvePlace("top", "Fx", soft_ball.DEPTH))


# ---- intervals


def test_the_gaussian_in_the_box_is_a_truncated_normal():
    X = inference.intervals.gaussian_draws(np.array([0.2]), np.array([[1 / 0.3**2]]), seed=0)
    p = [0.05, 0.5, 0.95]
    expected = truncnorm(-0.2 / 0.3, 0.8 / 0.3, 0.2, 0.3).ppf(p)
    np.testing.assert_allclose(np.quantile(X[:, 0], p), expected, atol=1e-3)  # 16384 quasi-random points
    # A direction that nothing is known of is uniform.
    blind = inference.intervals.gaussian_draws(np.array([0.5, 0.5]), np.diag([1e4, 0.0]), seed=0)
    np.testing.assert_allclose(np.quantile(blind[:, 1], p), p, atol=2e-3)


def test_chain_profile_and_formula_agree_on_a_gaussian():
    A = np.array([[1.0, 0.9], [0.2, 1.0], [0.5, -0.3]])
    y = A @ [0.5, 0.45]
    found = inference.determine(Misfit(linear(A), (curve(y, sigma=0.04),)), seed=0)
    sd = 0.04 * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    for k, known in enumerate(found.known):
        ends = np.array(
            [
                [known.profile_interval.low, known.profile_interval.high],
                [known.laplace.low, known.laplace.high],
                [known.mcmc.low, known.mcmc.high],
            ]
        )
        expected = np.array([0.5, 0.45])[k] + 1.6449 * sd[k] * np.array([-1, 1])
        np.testing.assert_allclose(ends[:2], np.tile(expected, (2, 1)), atol=1e-3 * sd[k] + 1e-6)
        # 5 % quantiles of N independent draws scatter by 2.1 sd/√N; four of that.
        np.testing.assert_allclose(ends[2], expected, atol=4 * 2.1 * sd[k] / np.sqrt(found.draws.independent))
        assert known.agreement


def test_where_the_gaussian_fails_the_disagreement_is_noted_and_no_reason():
    box = Box(["p"], ["1"], [0.0], [1.0], [False])
    found = inference.determine(Misfit(Model(box, lambda X: X**4), (curve([0.05], sigma=0.1),)), seed=0)
    assert found.known[0].agreement is False and "Gaussian" not in found.known[0].reason


def test_draws_and_profile_hold_every_valley_that_the_data_leave():
    """Two equal valleys: each has half of the draws (to 10 %: they jump), and the profile holds both."""
    box = Box(["a", "b"], ["1", "1"], [0.0, 0.0], [1.0, 1.0], [False, False])

    def f(X):
        return np.stack([(X[:, 0] - 0.2) * (X[:, 0] - 0.79), X[:, 1] - 0.5], axis=1)

    d = inference.determine(Misfit(Model(box, f), (curve([0.0, 0.0], sigma=0.003),)), seed=0)
    assert abs(np.mean(d.draws.X[:, 0] > 0.5) - 0.5) < 0.1
    a = d.of("a")
    for interval in (a.profile_interval, a.mcmc):
        np.testing.assert_allclose([interval.low, interval.high], [0.2, 0.79], rtol=0, atol=0.02)
    assert a.agreement is False


def test_pieces_of_a_profile_are_said_one_by_one():
    """θ² = 0.09 ± 0.0125 with θ in (-1, 1): 90 % are √(0.09 ± 1.645·0.0125) either way, and nothing between."""
    box = Box(["a"], ["MPa"], [-1.0], [1.0], [False])
    d = inference.determine(Misfit(Model(box, lambda X: box.from_unit(X) ** 2), (curve([0.09], sigma=0.0125),)), seed=0)
    a = d.of("a")
    inner, outer = np.sqrt(0.09 + 1.6449 * 0.0125 * np.array([-1, 1]))
    found = [tuple(2 * np.array([i.low, i.high]) - 1) for i in a.profile.pieces()]
    np.testing.assert_allclose(found, [(-outer, -inner), (inner, outer)], atol=2e-3)
    whole = a.profile_interval
    assert (whole.low, whole.high) == (a.profile.pieces()[0].low, a.profile.pieces()[1].high)
    said = " or from ".join(f"{low:.3f} to {high:.3f}" for low, high in found).replace("-", "−")
    assert f"every value from {said} MPa agrees" in a.story
    # over the pieces it changes by no more than 1.645 σ, between them by 0.09/0.0125 = 7.2 σ
    assert "Over all these values of a the force" in a.reason
    assert float(a.reason.split("at most ")[1].split(" times")[0]) < 1.65


def test_one_valley_is_one_piece_and_a_hump_as_small_as_a_descent_s_remainder_parts_nothing():
    at = np.linspace(0, 1, 101)
    one = np.abs(at - 0.5) * 8
    assert len(pieces(at, one**2)) == 1
    floor = 2.0 + 100 * np.maximum(np.abs(at - 0.5) - 0.3, 0)
    humps = [floor + h * np.exp(-(((at - 0.5) / 0.05) ** 2)) for h in (1, 3)]
    assert [len(pieces(at, h)) for h in humps] == [1, 2]  # 2.71 is the limit: up to 3.0, and up to 5.0


def test_a_refuted_model_determines_nothing():
    """Errors that are 50 times what is stated: an interval under a model that is wrong is no answer."""
    m = ball(0.003)
    (d,) = m.data
    bent = dataclasses.replace(d, value=d.value * (1 + 0.2 * np.sin(2 * d.depth)), covariance=d.covariance / 400)
    wrong = inference.determine(Misfit(m.model, (bent,)), seed=0, mcmc=False)
    assert wrong.scale > 3.0 and {k.verdict.word for k in wrong.known} <= {"weakly", "not"}
    assert all(k.verdict.noise_factor is None for k in wrong.known)
    assert "misses the data by" in wrong.of("mu").story and "agrees" not in wrong.of("mu").story


def test_the_same_seed_gives_the_same_draws():
    a, b, c = (inference.determine(ball(0.003), seed=s).draws.X for s in (0, 0, 1))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_a_profile_follows_the_valley_and_says_what_the_curve_does_there():
    m = ball(0.06)
    fit = inference.all_minima(m, seed=0)[0]
    p = inference.profile_likelihood(m, fit, 1)
    for t, rise, x in zip(p.at[::8], p.rise[::8], p.path[::8], strict=True):
        grid = np.stack([np.linspace(0.2, 0.8, 20001), np.full(20001, t)], axis=1)
        assert rise == pytest.approx(m.chi2(grid).min() - fit.chi2, abs=2e-3) and x[1] == t
    moved = m.model.predict(p.path[-1:])[0] - m.model.predict(fit.x[None])[0]
    assert abs(p.change[-1]) == pytest.approx(np.abs(moved).max(), rel=1e-9)  # equal errors: the largest change
    assert abs(p.change).max() < 0.06 and p.interval().open


# ---- verdicts


def test_D1_is_determined_with_3_mN_and_not_with_60_mN():
    good = [inference.determine(ball(0.003, seed), seed=0, mcmc=False).of("D1") for seed in range(8)]
    sd = np.median([k.sd_log for k in good])
    assert 0.1 < sd < 0.25  # of ln D1
    assert sum(k.verdict.word == "determined" for k in good) >= 7 and "is determined" in good[1].story
    bad = [inference.determine(ball(0.06, seed), seed=0, mcmc=False).of("D1") for seed in range(8)]
    assert sum(k.verdict.word == "not" for k in bad) >= 6 and all(k.verdict.word != "determined" for k in bad)
    assert "Over the whole interval of D1 (the other parameters refitted) the force changes" in bad[0].reason
    assert "mN against 60 mN, at " in bad[0].reason
    assert all((k.verdict.noise_factor is None) == (k.value in (1.0, 168.0)) for k in bad)
    for k in bad:
        said = "an end of the range, so the noise" if k.verdict.noise_factor is None else "times less noise"
        assert said in k.reason and k.verdict.digits == 0


def test_with_the_noise_that_is_asked_for_the_value_is_determined():
    """Where the most likely values are true, in curves of their own noise; with three times that it seldom is."""
    words = {1: [], 3: []}
    for seed in range(6):
        first = inference.determine(ball(0.012, seed), seed=0, mcmc=False)
        known = first.of("D1")
        f = known.verdict.noise_factor
        assert known.verdict.word != "determined"
        assert (
            f"{significant(known.value, 2)} MPa⁻¹, is right" in known.reason
            and f"{1 / f:.2g} times less noise" in known.reason
        )
        for times, found in words.items():
            noisy = soft_ball.data(*first.fit.theta, 0.012 * f * times, np.random.default_rng(100 + seed))
            again = inference.determine(Misfit(soft_ball.model(), (noisy,)), seed=0, mcmc=False)
            found.append(again.of("D1").verdict.word)
    assert words[1].count("determined") >= 5 and words[3].count("determined") <= 2


def test_mu_is_determined_in_both_cases():
    for noise, digits in ((0.003, 3), (0.06, 2)):
        mu = inference.determine(ball(noise), seed=0, mcmc=False).of("mu")
        assert mu.verdict.word == "determined" and abs(mu.verdict.digits - digits) <= 1


@pytest.mark.parametrize(
    ("low", "high", "word"),
    [(0.45, 0.55, "determined"), (0.0, 0.08, "weakly"), (0.3, 0.7, "weakly"), (0.2, 0.8, "not"), (0.0, 1.0, "not")],
)
def test_the_word_follows_the_interval(low, high, word):
    interval = Interval(low, high, low == 0.0, high == 1.0)
    assert judge_parameter(soft_ball.BOX, 1, interval).word == word


def test_a_refuted_model_pressed_against_a_bound_determines_nothing():
    pressed = Interval(0.0, 0.08, at_low=True)
    assert [judge_parameter(soft_ball.BOX, 1, pressed, scale=s).word for s in (1.0, 2.0, 5.0)] == [
        "weakly",
        "weakly",
        "not",
    ]
    assert judge_parameter(soft_ball.BOX, 1, Interval(0.45, 0.55), scale=5.0).word == "weakly"  # it fits best there


def test_most_of_a_narrow_range_is_no_answer():
    narrow = Box(["p"], ["1"], [2.0], [4.0], [False])
    assert judge_parameter(narrow, 0, Interval(0.02, 0.98)).word == "not"
    assert judge_parameter(narrow, 0, Interval(0.3, 0.7)).word == "determined"


@pytest.mark.parametrize(
    ("low", "high", "digits"), [(9.86, 10.1, 2), (9.99, 10.01, 4), (30.0, 70.0, 1), (0.00986, 0.0101, 2)]
)
def test_digits_end_at_the_size_of_the_error(low, high, digits):
    box = Box(["p"], ["1"], [low / 10], [high * 10], [True])
    x = box.to_unit(np.array([[low], [high]]))[:, 0]
    assert judge_parameter(box, 0, Interval(*map(float, x))).digits == digits


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.011949, 0.012043, "0.011949 to 0.012043"),
        (0.011949, 0.012271, "0.01195 to 0.01227"),
        (59.9951, 60.0049, "59.995 to 60.005"),
        (0.2, 0.34, "0.200 to 0.340"),
    ],
)
def test_an_interval_is_said_with_the_digits_of_its_width(low, high, said):
    """Three digits of 0.011949 to 0.012043, 0.0119 to 0.012, end before the middle of the interval."""
    box = Box(["p"], ["1"], [low / 10], [high * 10], [True])
    interval = Interval(*map(float, box.to_unit(np.array([[low], [high]]))[:, 0]))
    verdict = judge_parameter(box, 0, interval)
    assert verdict.word == "determined"
    profile = None  # is asked only where nothing is determined
    text, _ = verdict_sentences(box, 0, verdict, interval, profile, unit="N", places=["1 mm"])
    assert f"confidence {said} (" in text


def test_a_model_that_does_not_fit_widens_the_intervals_and_says_so():
    m = ball(0.003)
    (d,) = m.data
    bent = dataclasses.replace(d, value=d.value * (1 + 0.2 * np.sin(2 * d.depth)))
    wrong, right = (inference.determine(Misfit(m.model, (v,)), seed=0, mcmc=False) for v in (bent, d))
    assert right.scale == 1.0 and "within their errors" in right.story
    assert wrong.scale == pytest.approx(np.sqrt(wrong.fit.chi2 / 38)) and wrong.scale > 2 and "widened" in wrong.story
    np.testing.assert_allclose(
        wrong.of("mu").sd_log,
        wrong.scale * inference.standard_deviations(wrong.fit.fisher)[0] * np.log(37 / 3.4),
        rtol=1e-6,
    )


@pytest.mark.parametrize("share, told", [(0.002, False), (0.3, True)])
def test_an_agreement_within_wide_errors_says_how_wide_they_are(share, told):
    (clean,) = ball(0.0).data
    sd = share * clean.value.max()
    noisy = ball(sd)
    found = inference.determine(noisy, seed=0, mcmc=False).story
    assert "within their errors" in found
    assert (f"which are up to {100 * sd / noisy.data[0].value.max():.2g} % of the largest value" in found) is told


# ---- directions and further tests


def test_directions_are_those_of_a_product():
    box = Box(["a", "b"], ["1", "1"], [1.0, 1.0], [100.0, 10.0], [True, True])
    # Only ln a + ln b is seen, with an error of 1 %.
    model = Model(box, lambda X: np.log(box.from_unit(X)).sum(axis=1, keepdims=True))
    misfit = Misfit(model, (curve([np.log(30.0)], sigma=0.01),))
    x = box.to_unit(np.array([10.0, 3.0]))
    J = misfit.jacobian(x)
    stiff, sloppy = inference.directions(box, x, J.T @ J)
    np.testing.assert_allclose(list(stiff.change.values()), [0.5**0.5] * 2, rtol=1e-6)
    assert stiff.sd == pytest.approx(0.01 / 2**0.5, rel=1e-6) and "known to ±0.71 %" in stiff.story
    assert sloppy.sd > 1e3 or not np.isfinite(sloppy.sd)


def test_a_second_measurement_of_the_same_kind_halves_the_variance():
    m = ball(0.003)
    found = inference.determine(m, seed=0, mcmc=False)
    again, more = optimal_design.gains_of_repeats(found)
    # The same experiment, asked about as `rso next` asks.
    C = m.data[0].covariance
    done = optimal_design.PossibleExperiment("top", m.model, lambda x: C)
    (asked,) = optimal_design.expected_information(m.model.box, found.fit.x, 1, [done], [[done]], seed=0, draws=0)
    for name in ("mu", "D1"):
        assert again.after[name] == pytest.approx(asked.fisher[name], rel=1e-3)
    assert more.test.startswith("ten more readings at")
    for name in ("mu", "D1"):
        # The range counts as a weak prior: 1 % of the information here.
        assert again.after[name] / again.before[name] == pytest.approx(0.5**0.5, rel=0.02)


def test_the_best_depth_is_that_of_brute_force():
    m = ball(0.003)
    fit = inference.all_minima(m, seed=0)[0]
    J = m.model.jacobian(fit.x)
    at, best = optimal_design.best_depth(soft_ball.BOX, fit.x, fit.fisher, 1, J, np.full(40, 0.003))
    prior = 12 * np.eye(2)
    sd = [np.sqrt(np.linalg.inv(fit.fisher + prior + np.outer(j, j) / 0.003**2)[1, 1]) for j in J]
    assert at == int(np.argmin(sd)) and best.after["D1"] == pytest.approx(min(sd) * np.log(168), rel=1e-6)


# ---- any metric


@pytest.mark.parametrize("name", ["rmse", "nrmse", "mre", "mape", "rrmse"])
def test_metrics_are_those_of_rso_curves_and_their_minimum_that_of_a_grid(name):
    data = soft_ball.data(*TRUTH, 0.003, np.random.default_rng(0))
    model = soft_ball.model()
    score = inference.curve_score(model, [data], name)
    X = np.random.default_rng(1).random((5, 2))
    expected = [getattr(metrics(data.value, f), name) for f in model.predict(X)]
    np.testing.assert_allclose(score(X), expected, rtol=1e-12)
    found = inference.minimise(score, soft_ball.BOX, seed=0, steps=inference.downhill(model, [data], name))
    t = np.linspace(0, 1, 401)
    grid = np.stack(np.meshgrid(t, t), axis=-1).reshape(-1, 2)
    values = score(grid)
    assert found[0].value <= values.min()
    # The grid's best lies in the same valley, one or two cells away from the path along it.
    assert score(0.5 * (found[0].x + grid[np.argmin(values)])[None])[0] <= values.min() * 1.5
    assert len(found) == 1


def test_both_minima_of_a_metric_are_reported_and_nothing_else():
    box = Box(["p", "q"], ["1", "1"], [-1.0, -1.0], [1.0, 1.0], [False, False])

    def score(X):
        p, q = box.from_unit(X).T
        return np.minimum(np.abs(p - 0.5) + np.abs(q), 0.1 + np.abs(p + 0.5) + 2 * np.abs(q - 0.2))

    found = inference.minimise(score, box, seed=0)
    np.testing.assert_allclose([m.theta for m in found], [[0.5, 0.0], [-0.5, 0.2]], atol=1e-4)


def test_a_metric_without_meaning_is_refused():
    data = curve([0.0, 0.0])
    with pytest.raises(ValueError, match="finite nowhere"):
        inference.minimise(inference.curve_score(linear([[1.0]] * 2), [data], "mre"), linear([[1.0]]).box, seed=0)
    with pytest.raises(ValueError, match="choose one of rmse"):
        inference.curve_score(linear([[1.0]] * 2), [data], "r2")


def test_what_only_the_range_of_another_parameter_limits_is_said():
    # One force: mu follows D1 to the ends of its range.
    data = soft_ball.data(*TRUTH, 1e-4, depth=np.array([0.5]))
    box = dataclasses.replace(soft_ball.BOX, low=(0.002, 1.0), high=(0.1, 1000.0))
    found = inference.determine(Misfit(soft_ball.model(box, data.depth), (data,)), seed=0, mcmc=False)
    mu, D1 = found.known
    assert D1.verdict.word == "not" and mu.verdict.word != "determined" and "as long as D1 stays in range" in mu.story
    assert not mu.profile_interval.open and mu.profile.leaning() == (1,) and D1.profile.leaning() == ()


# ---- errors that curves share


def shared(gain, n=20, sigma=0.02, names=("cell", "cell")):
    """Two curves y = a, a u with a gain each that is one error where it has one name."""
    u = np.linspace(0.1, 1.0, n)
    shapes = [np.ones(n), u]
    data = []
    for f, name in zip(shapes, names, strict=True):
        C = sigma**2 * np.eye(n) + gain**2 * np.outer(f, f)
        data.append(Data(name, "N", u, f, C, shared={name: gain * f}))
    A = np.concatenate(shapes)[:, None]
    return linear(A, box=Box(["a"], ["1"], [0.0], [2.0], [False])), tuple(data)


def test_the_misfit_of_shared_errors_is_that_of_their_whole_covariance():
    """χ² = rᵀ C⁻¹ r and ln |W| = −½ ln |C| with the blocks between the curves; without a common name they are zero."""
    model, data = shared(0.1)
    v = np.concatenate([d.shared["cell"] for d in data])
    C = 0.02**2 * np.eye(40) + np.outer(v, v)
    r = np.random.default_rng(0).standard_normal(40)
    for scale in (1.0, 3.0):
        m = Misfit(model, data, scale=scale)
        np.testing.assert_allclose(np.sum(m.white(r) ** 2), r @ np.linalg.solve(C, r) / scale**2, rtol=1e-6, atol=0)
        expected = -0.5 * np.linalg.slogdet(scale**2 * C)[1]
        np.testing.assert_allclose(np.linalg.slogdet(m.white(np.eye(40)))[1], expected, rtol=1e-6, atol=0)
    apart = Misfit(model, shared(0.1, names=("one", "other"))[1])
    blocks = sum(np.sum(v @ np.linalg.solve(d.covariance, v)) for d, v in zip(apart.data, np.split(r, 2), strict=True))
    np.testing.assert_allclose(np.sum(apart.white(r) ** 2), blocks, rtol=1e-6, atol=0)


@pytest.mark.parametrize("names, right", [(("cell", "cell"), True), (("one", "other"), False)])
def test_a_gain_common_to_all_curves_does_not_average_out(names, right):
    """One gain of 10 % for two curves: 90 % of the intervals hold the truth (± 2 % of 200), with two fewer."""
    rng, held = np.random.default_rng(1), 0
    model, data = shared(0.1, names=names)
    for _ in range(200):
        g = 0.1 * rng.standard_normal()
        found = [dataclasses.replace(d, value=d.value * (1 + g) + 0.02 * rng.standard_normal(20)) for d in data]
        fit = inference.fit_at(m := Misfit(model, tuple(found)), inference.levenberg_marquardt(m, np.array([[0.5]]))[0])
        held += abs(fit.theta[0] - 1.0) <= 1.645 * inference.standard_deviations(fit.fisher)[0] * 2.0
    assert (0.83 <= held / 200 <= 0.97) if right else held / 200 < 0.8


def test_errors_known_from_few_readings_widen_intervals_and_thresholds():
    """With 5 degrees of freedom p is that of F(38, 5) and the interval wider by t/z = 1.225."""
    m = ball(0.003)
    few = dataclasses.replace(m, data=tuple(dataclasses.replace(d, freedom=5.0) for d in m.data))
    sure, unsure = (inference.determine(v, seed=0, mcmc=False) for v in (m, few))
    assert few.freedom == 5.0 and m.freedom == np.inf
    assert unsure.p_value == pytest.approx(stats.f.sf(unsure.fit.chi2 / 38, 38, 5))
    assert unsure.of("mu").sd_log / sure.of("mu").sd_log == pytest.approx(stats.t.ppf(0.95, 5) / 1.645, rel=1e-3)


def test_errors_stated_much_larger_than_the_curves_show_are_remarked_upon():
    m = ball(0.003)
    wide = dataclasses.replace(m, scale=3.0)
    said, silent = (remark(v) for v in (wide, m))
    assert "the stated errors" in said and "contact" in said and not silent


def test_it_is_the_simulation_whose_errors_are_too_large_where_they_are_most():
    """Readings are as good as stated, a model says it may be off by ten times as much: noise.Fz is not to blame."""
    m = ball(0.003)
    loose = tuple(d.plus(100.0 * d.covariance, "numerical") for d in m.data)
    said = remark(dataclasses.replace(m, data=loose))
    assert "the simulation may be off (numerical " in said and "noise.Fz" not in said and "stated" not in said


def test_errors_that_nobody_stated_are_not_called_stated():
    m = ball(0.003)
    taken = tuple(dataclasses.replace(d.plus(8.0 * d.covariance), freedom=1e4) for d in m.data)
    said = remark(dataclasses.replace(m, data=taken))
    assert "far less than the errors that were taken for them" in said and "the stated errors" not in said


def remark(m):
    d = inference.determine(m, seed=0, mcmc=False)
    return inference.lenient(m, d.fit.chi2, d.degrees, d.p_value)


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.5, "agrees with the data"), (0.03, "is undecided; below 0.01"), (0.001, "misses the data by")],
)
def test_whether_a_model_fits_is_said_by_its_p_and_the_limits(share, said):
    """χ² set to that of which noise leaves more in a share of all data sets; between the limits nothing is claimed."""
    exact = soft_ball.data(0.01, 5.8, 1e-3)
    r = np.cos(np.arange(40) ** 2)
    misfit = Misfit(soft_ball.model(), (exact,))
    Q = np.linalg.qr(misfit.jacobian(soft_ball.BOX.to_unit(np.array([0.01, 5.8]))))[0]
    r = r - Q @ (Q.T @ r)  # nothing of it is the parameters'
    off = 1e-3 * r * np.sqrt(stats.chi2.isf(share, 38) / (r @ r))
    missed = dataclasses.replace(exact, value=exact.value + off)
    found = determine(Misfit(soft_ball.model(), (missed,)), seed=0, mcmc=False)
    assert found.p_value == pytest.approx(share, rel=0.1)
    assert said in found.story


def test_secants_of_two_parameters_that_move_very_quiet_readings_alike():
    """(JᵀJ + I/w²)⁻¹ of J = a [1 1] with a = 1e10 is w²/2 [[1, −1], [−1, 1]]; JᵀJ is singular to round-off."""
    J, steps = 1e10 * np.ones((5, 2)), []
    model = SimpleNamespace(
        derivative=None, jacobian=lambda x: J, jacobians=lambda x, step: steps.append(step) or J[None]
    )
    found = least_squares.slopes(SimpleNamespace(model=model, white=lambda v: v), np.array([0.5, 0.5]))
    np.testing.assert_allclose(found, J)
    np.testing.assert_allclose(steps, least_squares.MAX_SLOPE_STEP / np.sqrt(2.0) * np.ones((len(steps), 2)), rtol=1e-6)
