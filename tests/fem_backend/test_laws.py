"""Derivatives of every law against the complex step: d f(x)/dx = Im f(x + ih)/h, exact to round-off for h = 1e-30."""

import numpy as np
import pytest

from fem_backend import indentation
from fem_backend.laws import LinearElastic, NeoHooke

HYPERELASTIC = [law for law in indentation.LAWS.values() if not law.small_strain]
H = 1e-30


def points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    return rng.uniform(3.0, 5.0, (4, 3)), rng.uniform(3.0, 6.0, (4, 3)), rng.uniform(0.6, 1.6, (4, 3))


def step(function, k: int) -> np.ndarray:
    """Derivative of function(i1, i2, J) by its argument k."""
    x = [v.astype(complex) for v in points()]
    x[k] = x[k] + 1j * H
    return np.broadcast_to(np.imag(function(*x)) / H, x[k].shape)


@pytest.mark.parametrize("kind", HYPERELASTIC)
def test_derivatives_are_those_of_the_energy(kind):
    law = kind(mu=0.013, D1=4.1)
    d = law.derivatives(*points())
    first = {0: d.w1, 1: d.w2, 2: d.u1}
    second = {("w1", 0): d.w11, ("w1", 1): d.w12, ("w2", 0): d.w12, ("w2", 1): d.w22, ("u1", 2): d.u2}
    for k, value in first.items():
        np.testing.assert_allclose(value, step(law.energy, k), rtol=1e-13, atol=1e-17)  # round-off
    for (name, k), value in second.items():
        expected = step(lambda *x, name=name: getattr(law.derivatives(*x), name), k)
        np.testing.assert_allclose(value, expected, rtol=1e-13, atol=1e-17)


@pytest.mark.parametrize("kind", HYPERELASTIC)
def test_volume_and_shape_do_not_mix(kind):
    """W(Ī₁, Ī₂) + U(J): the derivatives that `Derivatives` has no place for are zero."""
    law = kind(mu=0.013, D1=4.1)
    for name, k in (("w1", 2), ("w2", 2), ("u1", 0), ("u1", 1)):
        assert np.all(step(lambda *x, name=name: getattr(law.derivatives(*x), name), k) == 0.0), (name, k)


@pytest.mark.parametrize("kind", HYPERELASTIC)
def test_zero_at_rest_positive_elsewhere(kind):
    law = kind(mu=0.013, D1=4.1)
    three, one = np.full((1, 1), 3.0), np.ones((1, 1))
    assert law.energy(three, three, one).item() == 0.0
    assert np.all(law.energy(*points()) > 0.0)


@pytest.mark.parametrize("kind", [NeoHooke, LinearElastic])
def test_moduli(kind):
    law = kind(mu=0.0099997, D1=5.8)
    assert law.shear_modulus == 0.0099997
    assert law.bulk_modulus == 2.0 / 5.8
