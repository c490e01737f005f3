"""The posterior predictive check: right as often as it says, with errors that are stated and with estimated ones."""

import math

import numpy as np
import pytest
from scipy import stats

from rso.inference.predictive_test import chi2_limit, open_by, predictive_test

N, SETS = 12, 4000


def rate(freedom, use_spread=True, use_freedom=True):
    """Share of p < 0.05 over data sets of a line fitted to 6 readings and asked about 12 others, their noise of unit
    size or estimated from some degrees of freedom."""
    rng = np.random.default_rng(1)
    A = np.column_stack([np.ones(6), np.linspace(0, 0.4, 6)])
    J = np.column_stack([np.ones(N), np.linspace(0.5, 1.0, N)])
    fisher, found = 50.0 * A.T @ A, []
    for _ in range(SETS):
        x = np.linalg.solve(fisher, 50.0 * A.T @ (math.sqrt(1 / 50.0) * rng.standard_normal(6)))
        s = 1.0 if math.isinf(freedom) else math.sqrt(rng.chisquare(freedom) / freedom)
        y, f = 0.1 * rng.standard_normal(N), J @ x
        # Σ of the box is a weak prior: the information of the fit outweighs it here.
        left = open_by(1e2 * fisher, J) * 1e2 if use_spread else None
        p = predictive_test(y, f, (0.1 * s) ** 2 * np.eye(N), left, freedom if use_freedom else math.inf).p_value
        found.append(p < 0.05)
    return np.mean(found)


def test_a_perfect_model_is_refused_as_often_as_is_said():
    """Standard error of the share: 0.0034; the prior of the box takes up less than that."""
    assert rate(math.inf) == pytest.approx(0.05, abs=0.012)
    assert rate(math.inf, use_spread=False) > 0.5


def test_errors_known_from_few_readings_refuse_no_more_often():
    """Without Student's degrees of freedom a perfect model is refused several times as often; the spread of the
    parameters is stated, so that the share lies below 0.05, not at it."""
    assert rate(6) < 0.06 < 0.12 < rate(6, use_freedom=False)


def test_the_limit_is_where_the_p_value_is_the_false_alarm():
    for freedom, law in ((math.inf, stats.chi2(N)), (7.0, None)):
        top = chi2_limit(N, 0.95, freedom)
        each = math.sqrt(0.95)  # two tests, of χ² and of the level, are below it together in 5 %
        expected = law.ppf(each) if law else N * stats.f(N, 7).ppf(each)
        assert top == pytest.approx(expected, rel=1e-9)
        y = np.zeros(N)
        y[0] = math.sqrt(top)
        test = predictive_test(y, np.zeros(N), np.eye(N), None, freedom)
        assert test.p_value == pytest.approx(0.05, rel=1e-3) == test.alone and test.chi2 == pytest.approx(top, rel=1e-6)


def test_a_curve_that_is_too_high_as_a_whole_is_missed_among_any_number_of_readings():
    """70 readings with white noise of 1 % and an unknown gain of 5 %: 30 % too high is 6 standard deviations.

    Its χ² is larger by 36, which three times the scatter of χ²₇₀ is; where noise is overstated it vanished.
    """
    rng, f = np.random.default_rng(2), np.linspace(0.05, 1.0, 70) ** 1.5
    C = 0.01**2 * np.eye(70) + 0.05**2 * np.outer(f, f)
    for overstated in (1.0, 1.3):
        for _ in range(20):
            y = 1.3 * f + 0.01 / overstated * rng.standard_normal(70)
            test = predictive_test(y, f, C, None, 30.0)
            assert test.missed and test.level == pytest.approx(6.0, abs=0.3)
    assert not predictive_test(0.95 * f + 0.01 * rng.standard_normal(70), f, C).missed


def test_one_reading_is_tested_once():
    test = predictive_test(np.array([3.0]), np.array([1.0]), np.eye(1))
    assert test.p_value == pytest.approx(2 * stats.norm.sf(2.0)) and test.level == pytest.approx(2.0)
