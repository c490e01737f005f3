"""Polynomials through the errors of simulations, and all minima where there are samples."""

import numpy as np
import pytest

from rso.inference import fit_surface, surface_minima

RNG = np.random.default_rng(0)
X = RNG.random((60, 2)) * [0.02, 150.0]


def test_a_parabola_is_recovered_with_its_minimum():
    e = 0.1 + ((X[:, 0] - 0.012) / 0.004) ** 2 + ((X[:, 1] - 40) / 60) ** 2
    for degree in (2, 4):
        surface = fit_surface(X, e, degree)
        (m,) = surface_minima(surface)
        np.testing.assert_allclose(m.theta, [0.012, 40.0], rtol=1e-5)
        assert m.kind == "inside" and m.error == pytest.approx(0.1, abs=1e-9) and surface.r2 > 1 - 1e-12
    assert surface(np.array([[0.012, 40.0]]))[0] == pytest.approx(0.1, abs=1e-9)


def test_every_minimum_is_found():
    z = X / [0.01, 75.0] - 1
    e = 0.5 + (z[:, 0] ** 2 - 0.25) ** 2 + 0.5 * z[:, 1] ** 2 + 0.02 * z[:, 0]
    surface = fit_surface(X, e, 4)
    inside = [m for m in surface_minima(surface) if m.kind == "inside"]
    assert len(inside) == 2 and inside[0].theta[0] < inside[1].theta[0] and inside[0].error < inside[1].error
    # Oracle: local minima of a fine grid of the function itself.
    t = np.linspace(-0.95, 0.95, 381)
    f = 0.5 + (t**2 - 0.25) ** 2 + 0.02 * t
    low = t[1:-1][(f[1:-1] < f[:-2]) & (f[1:-1] < f[2:])]
    np.testing.assert_allclose([m.theta[0] for m in inside], 0.01 * (low + 1), atol=0.01 * 0.006)  # a cell and a bit


def test_minima_on_the_boundary_are_told_apart():
    kinds = [m.kind for m in surface_minima(fit_surface(X, 1 + X[:, 0] / 0.02, 2))]
    assert kinds and set(kinds) == {"boundary"}


def test_a_negative_error_is_never_a_result():
    e = ((X[:, 0] - 0.01) / 0.01) ** 2 + ((X[:, 1] - 75) / 75) ** 2 - 0.05
    found = surface_minima(fit_surface(X, e, 2))
    assert [m.kind for m in found] == ["negative"] and found[0].error < 0


def test_nothing_outside_of_the_samples_is_searched():
    # Samples on a ring sector; the parabola's minimum lies where there are none.
    keep = (X[:, 0] < 0.01) | (X[:, 1] < 75)
    P = X[keep]
    e = 0.1 + ((P[:, 0] - 0.019) / 0.01) ** 2 + ((P[:, 1] - 145) / 75) ** 2
    surface = fit_surface(P, e, 2)
    found = surface_minima(surface)
    assert all(m.kind == "boundary" for m in found) and np.all(surface.inside([m.theta for m in found]))
    assert not surface.inside([[0.019, 145.0]])[0]


def test_one_parameter_and_three():
    (m,) = surface_minima(fit_surface(X[:, :1], 0.1 + (X[:, 0] - 0.01) ** 2, 2))
    assert m.theta[0] == pytest.approx(0.01, rel=1e-4)
    P = RNG.random((80, 3))
    (m,) = surface_minima(fit_surface(P, 0.2 + np.sum((P - [0.4, 0.5, 0.6]) ** 2, axis=1), 2))
    np.testing.assert_allclose(m.theta, [0.4, 0.5, 0.6], atol=1e-5)


@pytest.mark.parametrize(
    ("points", "errors", "degree", "words"),
    [
        (X[:5], np.ones(5), 2, "needs 6 different samples"),
        (np.repeat(X[:3], 4, axis=0), np.ones(12), 2, "needs 6 different samples"),
        (np.stack([X[:, 0], 3 * X[:, 0]], axis=1), np.ones(60), 2, "do not determine"),
        (X, np.full(60, np.nan), 2, "finite"),
    ],
)
def test_too_little_is_refused(points, errors, degree, words):
    with pytest.raises(ValueError, match=words):
        fit_surface(points, errors, degree)
