"""Kriging through values and gradients."""

import numpy as np
import pytest

from rso.benchmarks import branin
from rso.doe import design, sobol_sequence
from rso.emulation import fit_kriging, fit_surrogate, held_out_scores
from rso.emulation.common import legendre, legendre_slopes, monomial_exponents
from rso.emulation.kernels import KERNELS, kernel_matrix
from rso.emulation.kriging import condition
from rso.emulation.kriging_likelihood import KrigingData, restricted


def wave(X):
    """A smooth positive function and its gradient by hand."""
    a, b = 3 * X[:, 0], 2 * X[:, 1]
    y = 3 + np.sin(a) * np.cos(b) + X[:, 0]
    return y, np.column_stack([3 * np.cos(a) * np.cos(b) + 1, -2 * np.sin(a) * np.sin(b)])


@pytest.mark.parametrize("kernel", KERNELS)
def test_covariances_of_slopes_are_derivatives_of_the_correlation(kernel):
    rng = np.random.default_rng(0)
    X, Y, lengths, h = rng.random((4, 3)), rng.random((5, 3)), np.array([0.4, 0.9, 1.7]), 1e-5
    K = kernel_matrix(kernel, X, Y, lengths, left=True, right=True).reshape(4, 4, 4, 5)
    for i in range(3):
        step = h * np.eye(3)[i]
        right = (kernel_matrix(kernel, X, Y + step, lengths) - kernel_matrix(kernel, X, Y - step, lengths)) / (2 * h)
        np.testing.assert_allclose(K[0, :, 1 + i], right, atol=1e-8)  # h² times third derivatives of size 10
        ends = (kernel_matrix(kernel, X + s * step, Y, lengths, right=True).reshape(4, 4, 5) for s in (1, -1))
        a, b = ends
        np.testing.assert_allclose(K[1 + i], (a - b) / (2 * h), atol=1e-7)  # one order more


def test_slopes_of_the_trend_are_its_derivatives():
    X, h = np.random.default_rng(0).random((6, 2)), 1e-6
    for degree in (0, 1, 2, 4):
        e = monomial_exponents(2, degree)
        for j in range(2):
            step = h * np.eye(2)[j]
            difference = (legendre(X + step, e) - legendre(X - step, e)) / (2 * h)
            np.testing.assert_allclose(legendre_slopes(X, e)[:, j], difference, atol=1e-7)  # h² and rounding/h


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("slopes", [False, True])
@pytest.mark.parametrize("noisy", [False, True])
def test_the_gradient_of_the_likelihood(kernel, slopes, noisy):
    X = design("lhs", 2, 10, 0)
    y, G = wave(X)
    keep = np.full(30 if slopes else 10, True)
    keep[12:14] = keep[12:14] & (not slopes)  # two slopes unknown
    A = np.vstack(
        [legendre(X, monomial_exponents(2, 1)), *legendre_slopes(X, monomial_exponents(2, 1)).transpose(1, 0, 2)]
    )[: len(keep)][keep]
    z = np.concatenate([y, G.T.ravel()])[: len(keep)][keep]
    data = KrigingData(X, z, A, np.full(len(z), 0.05 if noisy else 0.0), keep, slopes)
    p = np.array([-1.6, -1.3, *([0.2, -0.5] if noisy else [])])  # short lengths: well conditioned
    found = restricted(p, data, kernel, noisy)[1]
    for k, step in enumerate(1e-5 * np.eye(len(p))):
        difference = (
            restricted(p + step, data, kernel, noisy)[0] - restricted(p - step, data, kernel, noisy)[0]
        ) / 2e-5
        np.testing.assert_allclose(found[k], difference, rtol=1e-5, atol=1e-6)  # h² and the condition number


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("trend", [0, 2])
@pytest.mark.parametrize("log", [False, True])
def test_values_and_gradients_are_interpolated(kernel, trend, log):
    X = design("lhs", 2, 10, 0)
    y, G = wave(X)
    model = fit_kriging(X, y, seed=0, trend=trend, kernel=kernel, log=log, gradients=G)
    mean, sd = model.predict(X)
    # The jitter of the factorisation, 1e-14 to 1e-10 of the variance, times weights of some thousands.
    np.testing.assert_allclose(mean, y, atol=1e-4)
    np.testing.assert_allclose(model.gradient(X), G, atol=1e-3)
    assert sd.max() < 1e-3
    plain = fit_kriging(X, y, seed=0, trend=trend, kernel=kernel, log=log)
    assert np.abs(plain.gradient(X) - G).max() > 10 * np.abs(model.gradient(X) - G).max()  # negative control


def test_the_gradient_of_the_prediction_is_its_derivative():
    X, Q, h = design("lhs", 2, 12, 0), 0.1 + 0.8 * sobol_sequence(2, 16, 1), 1e-4
    y, G = wave(X)
    model = fit_kriging(X, y, seed=0, gradients=G)
    for j in range(2):
        step = h * np.eye(2)[j]
        difference = (model.mean(Q + step) - model.mean(Q - step)) / (2 * h)
        np.testing.assert_allclose(model.gradient(Q)[:, j], difference, atol=1e-4)  # rounding of weights over h, h²


@pytest.mark.parametrize("seed", [0, 1])
def test_gradients_help_and_shuffled_ones_do_harm(seed):
    X, Q = design("lhs", 2, 16, seed), sobol_sequence(2, 512, 9)
    h = 1e-6
    X = 0.001 + 0.998 * X
    y, truth = branin(X), branin(Q)
    G = np.column_stack([(branin(X + h * e) - branin(X - h * e)) / (2 * h) for e in np.eye(2)])
    shuffled = np.random.default_rng(seed).permutation(G)
    errors = [held_out_scores(fit_kriging(X, y, seed=0, gradients=g), Q, truth).rmse for g in (G, None, shuffled)]
    assert errors[0] < 0.5 * errors[1] and errors[2] > 1.5 * errors[1]
    # `fit` notices.
    chosen = fit_surrogate("kriging", X, y, seed=0, gradients=G, log=False)
    assert chosen.slopes is not None and "derivatives" in chosen.story
    refused = fit_surrogate("kriging", X, y, seed=0, gradients=shuffled, log=False)
    assert refused.slopes is None and "through the derivatives had" in refused.story


def test_unknown_gradients_are_left_out():
    X = design("lhs", 2, 12, 0)
    y, G = wave(X)
    G[::2, 1] = np.nan
    G[3] = np.nan
    model = fit_kriging(X, y, seed=0, gradients=G)
    known = np.isfinite(G)
    np.testing.assert_allclose(model.gradient(X)[known], G[known], atol=1e-3)  # as above
    assert fit_kriging(X, y, seed=0, gradients=np.full_like(G, np.nan)).slopes is None
    with pytest.raises(ValueError, match="gradients need shape"):
        fit_kriging(X, y, seed=0, gradients=G[:, :1])


def test_leave_one_out_with_gradients_equals_conditioning_without_the_point():
    X = design("lhs", 2, 10, 0)
    y, G = wave(X)
    m = fit_kriging(X, y, seed=0, gradients=G, gradient_sd=0.01, noise_sd=0.001)
    errors = []
    for i in range(10):
        rows = np.arange(10) != i
        less = condition(
            X[rows],
            y[rows],
            m.noise[rows],
            1,
            m.variance,
            m.lengths,
            False,
            m.kernel,
            1.0,
            G[rows],
            m.slope_noise[rows],
        )
        errors.append(less.mean(X[[i]])[0] - y[i])
    # The identity is exact; the condition number of K eats digits.
    np.testing.assert_allclose(m.cv.rmse, np.sqrt(np.mean(np.square(errors))), rtol=1e-4)


def test_the_share_of_the_stated_error_that_is_scatter_is_found():
    rng = np.random.default_rng(0)
    X = design("lhs", 1, 60, 0)
    smooth = np.sin(4 * X[:, 0])
    stated = np.full(60, 0.1)
    for share in (0.0, 0.3, 1.0):
        y = smooth + share * stated * rng.normal(size=60)
        model = fit_kriging(X, y, seed=0, noise_sd=stated, share=None, kernel="squared_exponential")
        # 55 degrees of freedom give the share to 10 %: four of these.
        assert model.share < 0.01 if share == 0 else abs(model.share / share - 1) < 0.4
    # A systematic error that all runs share is no scatter: the surrogate still interpolates.
    chosen = fit_surrogate("kriging", X, smooth, seed=0, noise_sd=stated, share=None)
    np.testing.assert_allclose(chosen.mean(X), smooth, atol=1e-3)
