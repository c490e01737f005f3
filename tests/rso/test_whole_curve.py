"""Whole curves as one surrogate."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rso.benchmarks import indentation
from rso.contract import plain
from rso.core.curves import Resampling
from rso.doe import Box, design, sobol_sequence
from rso.emulation import CurvePoint, WholeCurve, fit_curve, on_common_grid, refit_curve

BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.006, 10.0), (0.02, 150.0), (True, True))
DEPTHS = np.linspace(0.25, 2.0, 8)


def forces(X, at=DEPTHS):
    theta = BOX.from_unit(X)
    return indentation(at[None], theta[:, :1], theta[:, 1:], 3.0, 8.0)


@pytest.fixture(scope="module")
def curve():
    X = design("lhs", 2, 20, 0)
    return fit_curve(X, DEPTHS, forces(X), seed=0, kind="kriging")


def test_curves_that_were_not_learnt_are_predicted_within_the_band(curve):
    Q = sobol_sequence(2, 256, 9)
    mean, sd = curve.predict(Q)
    truth = forces(Q)
    assert np.sqrt(np.mean((mean / truth - 1) ** 2)) < 2e-3
    # Made to hold 95 % of left-out values of 20 curves: at least 90 % of new ones, and no band of absurd width.
    assert np.mean(np.abs(mean - truth) < 1.96 * sd) > 0.9
    assert np.median(sd / np.abs(truth)) < 0.01
    np.testing.assert_allclose(curve.mean(Q), mean, rtol=1e-12)  # another order of summation


def test_a_rough_family_of_curves_widens_the_band():
    rng = np.random.default_rng(0)
    X, Q = design("lhs", 2, 40, 1), rng.random((200, 2))

    def noisy(Z):
        return forces(Z) + 2e-3 * rng.normal(size=(len(Z), 1)) * DEPTHS

    def covered(model):
        mean, sd = model.predict(Q)
        return np.mean(np.abs(mean - truth) < 1.96 * sd)

    model, truth = fit_curve(X, DEPTHS, noisy(X), seed=0, kind="kriging", log=False), noisy(Q)
    assert 0.85 < covered(model) <= 1
    # Negative control: processes that take their hyper-parameters for known have too narrow a band.
    known = tuple(replace(a, inflate=1.0, rivals=()) for a in model.coefficients)
    assert covered(replace(model, inflate=1.0, coefficients=known)) < covered(model) - 0.03
    assert f"{100 * model.covered:.0f} %" in model.story


def test_left_out_curves_widen_the_band_where_the_coefficients_know_too_little():
    X, Q = design("lhs", 2, 40, 3), sobol_sequence(2, 256, 9)

    def jumping(Z):
        return forces(Z) * (1 + 0.3 * (np.abs(Z[:, :1] - 0.5) < 0.1))

    model = fit_curve(X, DEPTHS, jumping(X), seed=0, kind="kriging", log=False)
    mean, sd = model.predict(Q)
    error = np.abs(mean - jumping(Q))
    assert model.covered < 0.95 and model.inflate > 1 and f"widened {model.inflate:.2g} times" in model.story
    np.testing.assert_allclose(sd, model.inflate * replace(model, inflate=1.0).predict(Q)[1], rtol=1e-12)  # rounding
    assert np.mean(error < 1.96 * sd) > 0.95


def test_one_mode_is_enough_for_curves_that_are_proportional():
    X = design("lhs", 1, 10, 0)
    shape = DEPTHS**1.5
    model = fit_curve(X, DEPTHS, (1 + X) * shape, seed=0, log=False)
    assert len(model.modes) == 1
    # Linear in x: the trend of the only coefficient, exact but for rounding.
    np.testing.assert_allclose(model.mean(np.array([[0.3]]))[0], 1.3 * shape, rtol=1e-8)


def test_between_the_travels_the_curve_is_that_of_the_spline(curve):
    Q, at = sobol_sequence(2, 8, 3), np.array([0.4, 1.1, 1.9])
    mean, sd = curve.between(Q, at)
    np.testing.assert_allclose(mean, forces(Q, at), rtol=5e-3)  # spline of eight points and the surrogate
    assert sd.shape == (8, 3) and np.all(sd > 0)
    with pytest.raises(ValueError, match="beyond the last point"):
        curve.between(Q, np.array([2.5]))


def test_gradients_of_curves_are_used():
    X, Q, h = 0.001 + 0.998 * design("lhs", 2, 8, 0), sobol_sequence(2, 256, 9), 1e-6
    G = np.stack([(forces(X + h * e) - forces(X - h * e)) / (2 * h) for e in np.eye(2)], axis=1)
    errors = []
    for g in (G, None):
        model = fit_curve(X, DEPTHS, forces(X), seed=0, kind="kriging", gradients=g, log=False)
        errors.append(np.sqrt(np.mean((model.mean(Q) / forces(Q) - 1) ** 2)))
    assert errors[0] < 0.5 * errors[1]


def test_a_curve_survives_json_to_the_bit(curve):
    Q = sobol_sequence(2, 64, 3)
    copy = WholeCurve.from_dict(json.loads(json.dumps(plain(curve.to_dict()))))
    for a, b in zip(copy.predict(Q), curve.predict(Q), strict=True):
        assert np.array_equal(a, b)
    point = CurvePoint(copy, 3)
    assert np.array_equal(point.mean(Q), curve.mean(Q)[:, 3]) and point.cv == curve.cv[3]


def test_more_curves_make_it_better(curve):
    X, Q = design("lhs", 2, 40, 5), sobol_sequence(2, 256, 9)
    again = refit_curve(curve, X, forces(X), seed=0)
    errors = [np.sqrt(np.mean((m.mean(Q) / forces(Q) - 1) ** 2)) for m in (again, curve)]
    assert errors[0] < 0.3 * errors[1] and "over 40 runs" in again.story


def test_curves_with_travels_of_their_own_meet_on_a_common_grid():
    travels = [np.linspace(0.1, 2.0, 9), np.linspace(0.2, 1.8, 12)]
    grid, Y = on_common_grid(travels, [2 * u**1.5 for u in travels], 5)
    assert grid[-1] == 1.8
    np.testing.assert_allclose(np.diff(np.sqrt(grid)), np.diff(np.sqrt(grid))[0], rtol=1e-12)
    np.testing.assert_allclose(Y, np.tile(2 * grid**1.5, (2, 1)), rtol=1e-10)  # the spline is exact for Hertz
    np.testing.assert_allclose(Y[0], Resampling(travels[0], 2 * travels[0] ** 1.5)(grid), rtol=1e-12)


def test_what_is_no_curve_is_refused():
    X = design("lhs", 2, 10, 0)
    with pytest.raises(ValueError, match="whole curve: needs finite curves"):
        fit_curve(X, DEPTHS, forces(X)[:, :4], seed=0)
    with pytest.raises(ValueError, match=r"too few|points"):
        fit_curve(X[:2], DEPTHS, forces(X[:2]), seed=0)


def test_what_the_modes_leave_out_is_in_the_band():
    rng = np.random.default_rng(0)
    X, at = design("lhs", 1, 30, 0), np.linspace(0.1, 2.0, 20)
    Y = (1 + X) * at**1.5 + 0.01 * rng.normal(size=(30, 20))  # 20 directions of noise, at most 8 modes
    model = fit_curve(X, at, Y, seed=0, kind="kriging", log=False)
    assert np.all(model.truncation > 0)
    sd = model.predict(X)[1]
    assert np.all(sd >= 0.999 * model.inflate * model.truncation * model.weight)


def test_a_refit_gives_up_logarithms_that_new_curves_do_not_have():
    X = design("lhs", 2, 20, 0)
    first = fit_curve(X, DEPTHS, forces(X), seed=0, kind="polynomial", log=True)
    more = np.vstack([X, [[0.5, 0.5]]])
    Y = np.vstack([forces(X), -forces(more[-1:])])
    again = refit_curve(first, more, Y, seed=0)
    assert first.log and not again.log
    assert np.isfinite(again.mean(more)).all()
