import numpy as np
import pytest

from fem_backend import analytic


def test_moduli_of_the_incompressible_and_of_the_cork_limit():
    assert analytic.youngs_modulus(0.01, 1e6) == pytest.approx(0.03, rel=1e-7)
    assert analytic.poisson_ratio(0.01, 1e6) == pytest.approx(0.5, rel=1e-7)
    assert analytic.poisson_ratio(0.03, 0.02) == pytest.approx(0.0, abs=1e-16)  # K = 2μ/3
    mu, K = 0.01, 0.35
    E, nu = analytic.youngs_modulus(mu, K), analytic.poisson_ratio(mu, K)
    assert E / (2 * (1 + nu)) == pytest.approx(mu, rel=1e-14)
    assert E / (3 * (1 - 2 * nu)) == pytest.approx(K, rel=1e-12)


def test_hertz_and_sneddon_agree_for_small_contacts():
    """F_Hertz/F_Sneddon − 1 = (a/R)²/10 + O(a⁴), from the series of the logarithm: rate 2 and the coefficient."""
    x = np.array([0.2, 0.1, 0.05, 0.025])
    h, F = analytic.sneddon_sphere(3.0 * x, 3.0, 0.03, 0.45)
    error = analytic.hertz_force(h, 3.0, 0.03, 0.45) / F - 1.0
    np.testing.assert_allclose(np.diff(np.log(error)) / np.diff(np.log(x)), 2.0, atol=0.1)
    np.testing.assert_allclose(error[-1] / x[-1] ** 2, 0.1, rtol=1e-2)  # the next term is of the order x² = 6e-4


def test_force_and_depth_of_sneddon_belong_together():
    """dF/dh = 2 a E/(1 − ν²) for any axisymmetric punch (Pharr, Oliver & Brotzen 1992): F and h share one contact."""
    a, d = np.linspace(0.1, 2.5, 7), 1e-5
    h, F = (np.array(v) for v in zip(*(analytic.sneddon_sphere(a + s, 3.0, 0.03, 0.45) for s in (-d, d)), strict=True))
    np.testing.assert_allclose((F[1] - F[0]) / (h[1] - h[0]), 2 * a * 0.03 / (1 - 0.45**2), rtol=1e-7)


def test_incompressible_hertz():
    """E/(1 − ν²) = 4μ: F = 16/3 μ √R h^1.5."""
    np.testing.assert_allclose(
        analytic.hertz_force(np.array([0.0, 0.25, 1.0]), 4.0, 0.03, 0.5),
        16 / 3 * 0.01 * 2.0 * np.array([0, 0.125, 1.0]),
    )
