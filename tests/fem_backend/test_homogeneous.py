"""Homogeneous tests as a backend: forces against closed forms by hand."""

import numpy as np
import pytest

from fem_backend import closed_forms
from fem_backend.homogeneous import BACKEND
from rso.contract import Backend, Case, Programme, lacking, run_key, unfit

U = (0.1, 0.4, 1.0, 2.5)
STIFF = 1e-5  # 1/MPa: K/μ = 2e7, J is 1 to seven digits


def force(values, u=U, **settings):
    case = Case("test", Programme.ramp(u), settings)
    BACKEND.check(case)
    return BACKEND(*BACKEND.canonical(values, case)).channels["Fz"]


def test_it_is_a_backend():
    assert not lacking(BACKEND, Backend) and not unfit(BACKEND)


@pytest.mark.parametrize("test", ["uniaxial", "planar", "equibiaxial"])
@pytest.mark.parametrize("sense", ["tension", "compression"])
def test_neo_hookean_by_hand(test, sense):
    sign = 1.0 if sense == "tension" else -1.0
    x = 1.0 + sign * np.array(U) / 10.0
    side = {"uniaxial": x**-2, "planar": x**-3, "equibiaxial": x**-5}[test]
    by_hand = sign * 0.01 * (x - side) * 25.0
    found = force({"mu": 0.01, "D1": STIFF}, test=test, sense=sense, length=10.0, area=25.0)
    np.testing.assert_allclose(found, by_hand, rtol=1e-5)


def test_confined_compression_by_hand():
    """F = diag(λ, 1, 1): P = dW/dλ of W = μ/2 (λ^(-2/3) (λ² + 2) − 3) + (λ − 1)²/D₁."""
    mu, D1 = 0.01, 20.0
    x = 1.0 - np.array(U) / 10.0
    slope = mu / 2 * (-2 / 3 * x ** (-5 / 3) * (x**2 + 2) + x ** (-2 / 3) * 2 * x) + 2 * (x - 1) / D1
    found = force({"mu": mu, "D1": D1}, test="confined", sense="compression", length=10.0, area=3.0)
    np.testing.assert_allclose(found, -3.0 * slope, rtol=1e-9)


def test_free_sides_of_a_compressible_law():
    """Against the bisection for J of the closed forms, another unknown and other stress measures."""
    x = 1.0 + np.array(U) / 5.0
    P, _ = closed_forms.nominal_compressible(
        x, lambda s: closed_forms.nominal_yeoh("uniaxial", s, 0.01, 0.002, 1e-4), 15.0
    )
    values = {"mu": 0.01, "D1": 15.0, "C20": 0.002, "C30": 1e-4}
    found = force(values, test="uniaxial", length=5.0, material={"law": "yeoh"})
    np.testing.assert_allclose(found, P, rtol=1e-9)


def test_ogden_has_its_terms():
    x = 1.0 + np.array(U) / 5.0
    P = closed_forms.nominal_ogden("planar", x, 0.01, (3.0,), (1.0,))
    found = force({"mu": 0.01, "D1": STIFF, "alpha": 3.0}, test="planar", length=5.0, material={"law": "ogden"})
    np.testing.assert_allclose(found, P, rtol=1e-4)


def test_small_strains_are_those_of_hooke():
    """σ = E ε uniaxial and M ε confined, E = 9Kμ/(3K + μ), M = K + 4μ/3."""
    mu, D1 = 0.01, 50.0
    K = 2 / D1
    u = (1e-6,)
    for test, modulus in (("uniaxial", 9 * K * mu / (3 * K + mu)), ("confined", K + 4 * mu / 3)):
        assert force({"mu": mu, "D1": D1}, u, test=test)[0] == pytest.approx(modulus * 1e-6, rel=1e-4)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"test": "uniaxal"}, "did you mean"),
        ({}, "test"),
        ({"test": "uniaxial", "lenght": 3.0}, "lenght"),
        ({"test": "uniaxial", "length": -1.0}, "positive"),
        ({"test": "uniaxial", "sense": "compression", "length": 2.0}, "leaves nothing"),
        ({"test": "uniaxial", "material": {"law": "yeo"}}, "yeoh"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        force({"mu": 0.01, "D1": 1.0}, **settings)


def test_a_run_key_holds_what_counts_alone():
    def key(values, **settings):
        return run_key(BACKEND, *BACKEND.canonical(values, Case("a", Programme.ramp(U), settings)))

    same = key({"mu": 0.01, "D1": 1.0}, test="uniaxial")
    assert same == key({"mu": 0.01, "D1": 1.0}, test="uniaxial", sense="tension", length=1.0, speed=3.0)
    assert same != key({"mu": 0.01, "D1": 1.0}, test="planar")
