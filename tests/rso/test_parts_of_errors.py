"""One error model: its parts by name, their sum, what an analysis adds, and slopes that surrogates do not have."""

import dataclasses

import numpy as np
import pytest
import soft_ball

from rso.core.correlation import exponential, gaussian_correlation, of_neighbours, restored
from rso.inference import Data, Misfit, Model, determine, fit_at, with_model_errors
from rso.inference.error_model import (
    EMULATOR_ERROR,
    INTERPOLATION_ERROR,
    MODEL_ERROR_NAMES,
    NUMERICAL_ERROR,
    ModelErrors,
    correlated_along,
    error_covariance,
    joined_errors,
    shares,
)

DEPTH = np.linspace(0.5, 4.0, 8)


def curve(white=0.01):
    value = 0.3 * DEPTH**1.5
    return Data("top", "N", DEPTH, value, white**2 * np.eye(len(DEPTH)))


def errors(**sizes):
    each = {k: np.full(len(DEPTH), v) for k, v in sizes.items()}
    return ModelErrors(each.pop("numerical", np.zeros(len(DEPTH))), spacing=1.0, **each)


@pytest.mark.parametrize("kernel", [exponential, gaussian_correlation])
def test_a_correlated_error_has_its_size_everywhere_and_its_correlation_by_the_distance(kernel):
    """Drawn by its Cholesky factor, 40 000 curves: standard deviations within 3 %, correlation within 0.02."""
    size, length = 0.02 * (1.0 + DEPTH), 1.3
    C = correlated_along(DEPTH, size, length, kernel)
    draws = np.random.default_rng(1).standard_normal((40_000, len(DEPTH))) @ np.linalg.cholesky(C + 1e-12 * np.eye(8)).T
    np.testing.assert_allclose(draws.std(axis=0), size, rtol=0.03)
    apart = DEPTH[5] - DEPTH[2]
    expected = {"exponential": np.exp(-apart / length), "gaussian_correlation": np.exp(-0.5 * (apart / length) ** 2)}
    assert np.corrcoef(draws[:, 2], draws[:, 5])[0, 1] == pytest.approx(expected[kernel.__name__], abs=0.02)


def test_parts_are_named_add_up_and_can_be_taken_off_again():
    plain = curve()
    whole = with_model_errors(plain, errors(numerical=0.004, interpolation=0.002, emulator=0.001))
    assert set(whole.parts) == set(MODEL_ERROR_NAMES)
    np.testing.assert_allclose(whole.covariance, plain.covariance + sum(whole.parts.values()), rtol=1e-12)
    np.testing.assert_allclose(whole.without(*MODEL_ERROR_NAMES).covariance, plain.covariance, atol=1e-18)
    bare = whole.without(EMULATOR_ERROR)
    assert set(bare.parts) == {NUMERICAL_ERROR, INTERPOLATION_ERROR}
    np.testing.assert_allclose(whole.covariance - bare.covariance, whole.parts[EMULATOR_ERROR], atol=1e-18)
    assert plain.parts == {}  # what was measured is as it was


def test_what_a_model_may_be_off_by_is_of_the_whole_curve_but_for_the_spline():
    """The numerical error of the ends goes together by e^{−1}·, the spline's only between neighbouring travels."""
    whole = with_model_errors(curve(), errors(numerical=0.004, interpolation=0.004))
    ends = {n: C[0, -1] / C[0, 0] for n, C in whole.parts.items()}
    assert ends[NUMERICAL_ERROR] == pytest.approx(np.exp(-3.5 / 4.0))
    assert ends[INTERPOLATION_ERROR] == pytest.approx(np.exp(-3.5))


def test_a_part_of_size_zero_is_none():
    assert with_model_errors(curve(), errors(numerical=0.0, emulator=0.001)).parts.keys() == {EMULATOR_ERROR}


def test_shares_are_standard_deviations_over_the_largest_value():
    data = with_model_errors(curve(white=0.012), errors(numerical=0.006))
    largest = 0.3 * 4.0**1.5
    assert shares(data) == pytest.approx({"measurement": 0.012 / largest, NUMERICAL_ERROR: 0.006 / largest})


def test_rows_in_another_order_keep_their_parts():
    order = np.arange(len(DEPTH))[::-1]
    data = with_model_errors(curve(), dataclasses.replace(errors(), numerical=0.01 * DEPTH))
    turned = data.rows(order)
    np.testing.assert_allclose(turned.without(NUMERICAL_ERROR).covariance, curve().covariance, atol=1e-18)


def test_curves_of_one_block_have_the_errors_of_each():
    both = joined_errors([errors(numerical=0.01), errors(numerical=0.02, emulator=0.003)])
    np.testing.assert_array_equal(both.numerical, np.repeat([0.01, 0.02], len(DEPTH)))
    np.testing.assert_array_equal(both.emulator, np.repeat([0.0, 0.003], len(DEPTH)))
    assert both.interpolation is None


def test_a_negative_size_is_refused():
    with pytest.raises(ValueError, match="sizes must be >= 0"):
        error_covariance(DEPTH, DEPTH, DEPTH, gain=-0.01)


# ------------------------------------------------------------------------------------------- slopes of a surrogate


def scattered(size_N, period):
    """The ball's model with what a surrogate repeats of the scatter of runs: a wave of `size_N` in ln D1 of another
    phase at every reading."""
    smooth, phase = soft_ball.model(), np.random.default_rng(3).uniform(0, 2 * np.pi, len(soft_ball.DEPTH))
    share = np.linspace(0.1, 1.0, len(phase))
    return Model(
        smooth.box,
        lambda X: smooth.predict(X) + size_N * share * np.sin(2 * np.pi * X[:, 1:2] / period + phase),
    )


def test_scatter_of_a_surrogate_is_no_information():
    """0.05 mN with a period of a hundredth of the range, beside 1 mN of noise: the standard deviation of ln D1 is that
    of the smooth model within a fifth, while tangents have it four times smaller, the control."""
    noisy = soft_ball.data(0.01, 5.8, 1e-3, gain=0.002)
    x = soft_ball.BOX.to_unit(np.array([0.01, 5.8]))
    smooth, rough = (Misfit(m, (noisy,)) for m in (soft_ball.model(), scattered(5e-5, 0.01)))

    def sd(fisher):
        return float(np.sqrt(np.linalg.inv(fisher)[1, 1]))

    tangent = rough.jacobian(x)
    right = sd(fit_at(smooth, x).fisher)
    assert sd(tangent.T @ tangent) < right / 4
    assert sd(fit_at(rough, x).fisher) == pytest.approx(right, rel=0.2)


def test_a_smooth_model_keeps_its_tangents():
    noisy = soft_ball.data(0.01, 30.0, 1e-3)
    misfit = Misfit(soft_ball.model(), (noisy,))
    x = soft_ball.BOX.to_unit(np.array([0.01, 30.0]))
    np.testing.assert_allclose(fit_at(misfit, x).jacobian, misfit.jacobian(x), rtol=1e-12)


def test_the_formula_and_the_profile_agree_beside_scatter():
    """Ends of the Gaussian's interval of D1 against those of the profile, which no slope makes: to a tenth."""
    noisy = soft_ball.data(0.01, 30.0, 1e-3, gain=0.002)
    known = determine(Misfit(scattered(5e-5, 0.01), (noisy,)), seed=1, mcmc=False).of("D1")
    width = known.profile_interval.high - known.profile_interval.low
    for end in ("low", "high"):
        assert abs(getattr(known.laplace, end) - getattr(known.profile_interval, end)) < 0.1 * width


def test_the_correlation_of_neighbours_is_that_of_the_noise():
    """AR(1) of ρ = 0.6, mean taken out, curves of 100 readings: 0.6 within 0.015 once what the mean cost is put back.

    Without that it is 0.02 too small, the control.
    """
    rng = np.random.default_rng(2)
    C = 0.6 ** np.abs(np.subtract.outer(np.arange(100), np.arange(100)))
    x = rng.standard_normal((4000, 100)) @ np.linalg.cholesky(C).T
    ρ = of_neighbours(x - x.mean(axis=1, keepdims=True))
    assert restored(ρ, 100) == pytest.approx(0.6, abs=0.015) and ρ < 0.582


def test_errors_of_readings_at_one_depth_go_together_by_the_travel_there():
    """In creep all readings have the depth where the hold began; the indenter goes on, and the error changes."""
    held = Data("creep", "mm", np.full(8, 1.0), np.linspace(1.0, 2.0, 8), 1e-12 * np.eye(8))
    together = with_model_errors(held, errors(numerical=0.01)).parts[NUMERICAL_ERROR]
    assert together[0, -1] == pytest.approx(1e-4)
    C = with_model_errors(held, dataclasses.replace(errors(numerical=0.01), travel=held.value)).parts[NUMERICAL_ERROR]
    assert C[0, -1] / C[0, 0] == pytest.approx(np.exp(-0.5))
