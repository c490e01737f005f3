import numpy as np
import pytest

from fem_backend import closed_forms


def test_moduli_of_the_incompressible_and_of_the_cork_limit():
    assert closed_forms.youngs_modulus(0.01, 1e6) == pytest.approx(0.03, rel=1e-7)
    assert closed_forms.poisson_ratio(0.01, 1e6) == pytest.approx(0.5, rel=1e-7)
    assert closed_forms.poisson_ratio(0.03, 0.02) == pytest.approx(0.0, abs=1e-16)  # K = 2μ/3
    mu, K = 0.01, 0.35
    E, nu = closed_forms.youngs_modulus(mu, K), closed_forms.poisson_ratio(mu, K)
    assert E / (2 * (1 + nu)) == pytest.approx(mu, rel=1e-14)
    assert E / (3 * (1 - 2 * nu)) == pytest.approx(K, rel=1e-12)


def test_hertz_and_sneddon_agree_for_small_contacts():
    """F_Hertz/F_Sneddon − 1 = (a/R)²/10 + O(a⁴), from the series of the logarithm: rate 2 and the coefficient."""
    x = np.array([0.2, 0.1, 0.05, 0.025])
    h, F = closed_forms.sneddon_sphere(3.0 * x, 3.0, 0.03, 0.45)
    error = closed_forms.hertz_force(h, 3.0, 0.03, 0.45) / F - 1.0
    np.testing.assert_allclose(np.diff(np.log(error)) / np.diff(np.log(x)), 2.0, atol=0.1)
    np.testing.assert_allclose(error[-1] / x[-1] ** 2, 0.1, rtol=1e-2)  # the next term is of the order x² = 6e-4


def test_force_and_depth_of_sneddon_belong_together():
    """dF/dh = 2 a E/(1 − ν²) for any axisymmetric punch (Pharr, Oliver & Brotzen 1992): F and h share one contact."""
    a, d = np.linspace(0.1, 2.5, 7), 1e-5
    h, F = (
        np.array(v) for v in zip(*(closed_forms.sneddon_sphere(a + s, 3.0, 0.03, 0.45) for s in (-d, d)), strict=True)
    )
    np.testing.assert_allclose((F[1] - F[0]) / (h[1] - h[0]), 2 * a * 0.03 / (1 - 0.45**2), rtol=1e-7)


def test_incompressible_hertz():
    """E/(1 − ν²) = 4μ: F = 16/3 μ √R h^1.5."""
    np.testing.assert_allclose(
        closed_forms.hertz_force(np.array([0.0, 0.25, 1.0]), 4.0, 0.03, 0.5),
        16 / 3 * 0.01 * 2.0 * np.array([0, 0.125, 1.0]),
    )


# ------------------------------------------------------------------------------------------- homogeneous tests

MU = 0.013
LAWS = {
    "neo_hooke": (lambda test, x: closed_forms.nominal_neo_hooke(test, x, MU), lambda a: MU / 2 * (a**2).sum(0)),
    "mooney_rivlin": (
        lambda test, x: closed_forms.nominal_mooney_rivlin(test, x, MU, 0.002),
        lambda a: (MU / 2 - 0.002) * (a**2).sum(0) + 0.002 * (a**-2).sum(0),
    ),
    "yeoh": (
        lambda test, x: closed_forms.nominal_yeoh(test, x, MU, -0.001, 0.0004),
        lambda a: np.polynomial.Polynomial([0, MU / 2, -0.001, 0.0004])((a**2).sum(0) - 3),
    ),
    "ogden": (
        lambda test, x: closed_forms.nominal_ogden(test, x, MU, (1.3, 5.0, -2.0), (0.5, 0.2, 0.3)),
        lambda a: sum(2 * s * MU / p**2 * (a**p).sum(0) for p, s in ((1.3, 0.5), (5.0, 0.2), (-2.0, 0.3))),
    ),
}
STRETCHES = {
    "uniaxial": lambda x: np.array([x, x**-0.5, x**-0.5]),
    "planar": lambda x: np.array([x, x**0, 1 / x]),
    "equibiaxial": lambda x: np.array([x, x, x**-2]),
}


@pytest.mark.parametrize("test", closed_forms.SIDE_EXPONENT)
@pytest.mark.parametrize("name", LAWS)
def test_nominal_stress_is_the_derivative_of_the_energy(name, test):
    """dW/dλ = P for one loaded pair of faces, 2P for two; complex step, exact to round-off."""
    nominal, energy = LAWS[name]
    x = np.array([0.5, 0.8, 1.0, 1.3, 2.5])
    slope = energy(STRETCHES[test](x + 1e-30j)).imag / 1e-30
    faces = 2.0 if test == "equibiaxial" else 1.0
    np.testing.assert_allclose(nominal(test, x), slope / faces, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(closed_forms.first_invariants(test, x)[0], (STRETCHES[test](x) ** 2).sum(0), rtol=1e-14)
    np.testing.assert_allclose(
        closed_forms.first_invariants(test, x)[1], (STRETCHES[test](x) ** -2.0).sum(0), rtol=1e-14
    )


@pytest.mark.parametrize(("test", "modulus"), [("uniaxial", 3.0), ("planar", 4.0), ("equibiaxial", 6.0)])
@pytest.mark.parametrize("name", LAWS)
def test_initial_moduli(name, test, modulus):
    """3μ, 4μ and 6μ: the constants of every law add up to one μ; central difference, h² = 1e-8."""
    nominal = LAWS[name][0]
    slope = (nominal(test, 1.0 + 1e-4) - nominal(test, 1.0 - 1e-4)) / 2e-4
    np.testing.assert_allclose(slope, modulus * MU, rtol=1e-6)


def test_fibres_pull_only():
    x, h = np.array([1.1, 1.4]), 1e-30j
    slope = (0.01 / (2 * 0.7) * np.exp(0.7 * ((x + h) ** 2 - 1) ** 2)).imag / 1e-30
    np.testing.assert_allclose(closed_forms.nominal_fibre(x, 0.01, 0.7), slope, rtol=1e-13)
    assert np.all(closed_forms.nominal_fibre(np.array([0.6, 1.0]), 0.01, 0.7) == 0.0)


def test_relaxation_and_softening_at_their_ends():
    np.testing.assert_allclose(closed_forms.relaxed_share([0.0, 1e9], (0.2, 0.3), (1.0, 50.0)), [1.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(closed_forms.relaxed_share(2.0, (0.2,), (4.0,)), 0.8 + 0.2 * np.exp(-0.5), rtol=1e-15)
    assert np.all(closed_forms.softening([1.0, 2.0], [1.0, 1.0], 0.5, 0.1, 0.2) == 1.0)
    # erf(1) = 0.842700792949715 (Abramowitz & Stegun 1964, table 7.1)
    np.testing.assert_allclose(closed_forms.softening(0.7, 1.0, 0.5, 0.1, 0.2), 1 - 0.5 * 0.842700792949715, rtol=1e-14)


def test_the_other_convention_of_ogden():
    """Ogden's own constants for Treloar's rubber, W = Σ (mᵢ/αᵢ)(…): shares mᵢαᵢ/Σmα of μ = ½ Σ mᵢαᵢ = 0.4225 MPa."""
    m, alpha = np.array([0.63, 0.0012, -0.01]), np.array([1.3, 5.0, -2.0])
    mu, x = 0.5 * (m * alpha).sum(), np.array([0.5, 1.5, 3.0, 7.0])
    np.testing.assert_allclose(mu, 0.4225, rtol=1e-12)
    expected = (m * (x[:, None] ** (alpha - 1) - x[:, None] ** (-alpha / 2 - 1))).sum(1)
    np.testing.assert_allclose(
        closed_forms.nominal_ogden("uniaxial", x, mu, tuple(alpha), tuple(0.5 * m * alpha / mu)), expected, rtol=1e-13
    )
