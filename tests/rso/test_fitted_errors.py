"""The fitted curve: the model's, moved by the contact point and gain that the fit has estimated with it."""

import numpy as np
import pytest

from rso.doe import Box
from rso.inference import Data, Misfit, Model, curves_as_fitted, determine

DEPTH = np.linspace(0.1, 4.0, 25)
BOX = Box(("k",), ("N",), (0.05,), (0.15,), (False,))
NOISE, CONTACT, GAIN = 0.004, 0.08, 0.03


def force(k, depth):
    return k * depth**1.5


def model():
    return Model(BOX, lambda X: force(BOX.from_unit(X)[:, :1], DEPTH))


def data(value, contact=CONTACT, gain=GAIN, noise=NOISE):
    slope = 1.5 * 0.1 * DEPTH**0.5
    shared = {"test: contact": contact * slope, "test: gain": gain * force(0.1, DEPTH)}
    shared = {n: s for n, s in shared.items() if s.any()}
    C = noise**2 * np.eye(len(DEPTH)) + sum((np.outer(s, s) for s in shared.values()), np.zeros((25, 25)))
    return Data("test", "N", DEPTH, value, C, shared=shared)


def fit(value, **errors):
    d = determine(Misfit(model(), (data(value, **errors),)), seed=1, mcmc=False)
    return d, curves_as_fitted(d)[0]


def test_the_fitted_curve_is_the_conditional_mean_of_the_readings_without_their_own_noise():
    """E[g | y] = K (K + C₀)⁻¹ y, K = τ² J Jᵀ + S Sᵀ: the same by Gaussian conditioning with τ = 1, a wide prior."""
    rng = np.random.default_rng(3)
    y = force(0.1, DEPTH + 0.05) * 1.02 + NOISE * rng.standard_normal(25)
    d, found = fit(y)
    J, S = DEPTH**1.5, np.array(list(data(y).shared.values())).T
    K, C0 = np.outer(J, J) + S @ S.T, NOISE**2 * np.eye(25)
    gain = K @ np.linalg.inv(K + C0)
    assert d.wider == 1.0
    assert found.fitted == pytest.approx(gain @ y, abs=2e-5)
    assert found.sd**2 == pytest.approx(np.diag(gain @ C0), rel=1e-3)  # K − K (K + C₀)⁻¹ K, without its rounding
    assert found.reading_sd**2 == pytest.approx(found.sd**2 + NOISE**2, rel=1e-6)


def test_a_contact_point_and_a_gain_are_found_with_their_sign():
    # At a known modulus: else gain and modulus are one.
    known = Box(("k",), ("N",), (0.0999,), (0.1001,), (False,))
    y = force(0.1, DEPTH + 0.1) * 0.97
    close = Misfit(Model(known, lambda X: force(known.from_unit(X)[:, :1], DEPTH)), (data(y, noise=1e-3),))
    (found,) = curves_as_fitted(determine(close, seed=1, mcmc=False))
    assert found.contact == pytest.approx(0.1, rel=0.1)
    assert found.gain == pytest.approx(-0.03, rel=0.15)
    assert found.expected["contact"] == pytest.approx(CONTACT, rel=0.02)
    assert found.expected["gain"] == pytest.approx(GAIN, rel=0.03)
    assert np.sqrt(np.mean((found.fitted - y) ** 2)) < 0.2 * np.sqrt(np.mean((found.predicted - y) ** 2))


def test_without_such_errors_the_fitted_curve_is_the_predicted_one():
    y = force(0.1, DEPTH + 0.1)
    _, found = fit(y, contact=0.0, gain=0.0)
    assert np.array_equal(found.fitted, found.predicted)
    assert found.contact is None and found.gain is None and not found.expected


def test_nine_readings_in_ten_lie_within_the_band():
    rng, inside = np.random.default_rng(7), []
    for _ in range(60):
        true = force(0.1, DEPTH) + CONTACT * rng.standard_normal() * 0.15 * DEPTH**0.5
        true = true + GAIN * rng.standard_normal() * force(0.1, DEPTH)
        first, again = (true + NOISE * rng.standard_normal(25) for _ in range(2))
        d, found = fit(first)
        inside.append(np.abs(again - found.fitted) <= 1.645 * found.reading_sd / d.wider)
    assert np.mean(inside) == pytest.approx(0.9, abs=0.03)  # 1500 readings of 60 tests: ±0.015


def test_whitened_residuals_are_white_where_the_errors_are_right():
    rng, every = np.random.default_rng(11), []
    for _ in range(40):
        true = force(0.1, DEPTH) * (1 + GAIN * rng.standard_normal())
        true = true + CONTACT * rng.standard_normal() * 0.15 * DEPTH**0.5
        d, found = fit(true + NOISE * rng.standard_normal(25))
        every.append(found.white * d.wider)
    z = np.array(every)
    assert np.mean(z**2) == pytest.approx(24 / 25, abs=0.12)
    assert abs(np.mean(z[:, 1:] * z[:, :-1])) < 0.1


def test_a_weighting_without_errors_has_no_fitted_curve():
    d = determine(Misfit(model(), (data(force(0.1, DEPTH)),), "relative"), seed=1, mcmc=False)
    assert curves_as_fitted(d) == ()


def test_curves_of_one_test_are_moved_together():
    """Two channels with one gain: the noisy one is moved by what the good one shows."""
    rng = np.random.default_rng(5)
    known = Box(("k",), ("N",), (0.0999,), (0.1001,), (False,))
    y = 1.05 * force(0.1, DEPTH)
    parts = []
    for size, noise in ((1.0, 1e-4), (0.2, 0.02)):
        s = 0.05 * size * force(0.1, DEPTH)
        C = noise**2 * np.eye(25) + np.outer(s, s)
        value = size * y + noise * rng.standard_normal(25)
        parts.append(Data(f"c{size}", "N", DEPTH, value, C, shared={"test: gain": s}))
    both = Model(known, lambda X: np.hstack([s * force(known.from_unit(X)[:, :1], DEPTH) for s in (1.0, 0.2)]))
    first, second = curves_as_fitted(determine(Misfit(both, tuple(parts)), seed=1, mcmc=False))
    assert first.gain == pytest.approx(0.05, rel=0.05)
    assert second.gain == pytest.approx(first.gain, rel=0.02)
