"""Coverage of 90 % intervals where nobody has stated the errors of a test, and p-values of the true model."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from rso.calibration.readings import as_data
from rso.data import Measurement, Noise, Repeat, combine
from rso.doe import Box
from rso.inference import Misfit, Model, gauss_newton, standard_deviations, with_autocorrelation
from rso.inference.identifiability import _widening

pytestmark = pytest.mark.verification
SETS = 200
BOX = Box(("E",), ("MPa",), (0.01,), (0.1,), (True,))
X = BOX.to_unit(np.array([[0.03]]))[0]
NONE = {"gain": 0.0, "contact": 0.0, "correlation": 0.0}


def force(E, u):
    """A ball of 3 mm on a half-space of modulus E, incompressible, in N (Hertz 1881)."""
    return 16 / 9 * E * 3.0**0.5 * np.maximum(u, 0.0) ** 1.5


def one(seed, n=50, r=1, noise=None, white=0.003, correlated=0.0, gain=0.0, contact=0.0):
    """Whether the interval holds the truth, its width in ln E, p (NaN: none)."""
    rng, u = np.random.default_rng(seed), np.linspace(4.0 / n, 4.0, n)
    L = np.linalg.cholesky(np.exp(-np.abs(np.subtract.outer(u, u)) / 2.0) + 1e-10 * np.eye(n))
    curves = [
        (1 + gain * rng.standard_normal()) * force(0.03, u + contact * rng.standard_normal())
        + white * rng.standard_normal(n)
        + correlated * L @ rng.standard_normal(n)
        for _ in range(r)
    ]
    rows = np.array(["loading"] * n)
    repeats = tuple(Repeat(str(k), u, None, {"Fz": y}, {}, rows) for k, y in enumerate(curves))
    d = as_data("top", "top", combine(Measurement(Path("x.csv"), "force", repeats, ()), noise or Noise()), u > 0)
    m = Misfit(Model(BOX, lambda V: force(BOX.from_unit(V)[:, :1], d.depth)), (d,))
    m = with_autocorrelation(m, gauss_newton(m, X).x)
    fit = gauss_newton(m, X)
    p, _, wider = _widening(m, fit.chi2, n - 1, 0.9, fit.x)
    half = ndtri(0.95) * wider * standard_deviations(fit.fisher)[0]
    return abs(fit.x[0] - X[0]) <= half, 2 * half * np.log(10.0), np.nan if p is None else p


def many(**more):
    held, width, p = np.array([one(seed, **more) for seed in range(SETS)], float).T
    return held.mean(), width.mean(), p


@pytest.mark.parametrize("n", [50, 200])
@pytest.mark.parametrize("more", [{"contact": 0.03}, {"gain": 0.02}, {"correlated": 0.003, "white": 0.001}])
def test_what_nobody_stated_is_in_the_interval(n, more):
    """0.90 ± 0.02 where errors are of the usual size, more where they are smaller; without them far too few."""
    assert many(n=n, **more)[0] >= 0.85
    if "correlated" not in more:
        assert many(n=n, noise=Noise(**NONE), **more)[0] < 0.8  # negative control: stated to be nothing


@pytest.mark.parametrize("r", [3, 5])
def test_errors_that_go_together_over_half_the_travel_are_seen_in_repeats(r):
    assert many(r=r, correlated=0.003, white=0.001)[0] >= 0.85


def test_what_is_stated_is_held_by_nine_of_ten():
    for key, more in (("contact", 0.03), ("gain", 0.02)):
        held = many(noise=Noise(Fz=0.003, **{**NONE, key: more}), **{key: more})[0]
        assert 0.84 <= held <= 0.96


def test_more_records_never_widen_the_interval():
    width = [many(r=r, gain=0.01, contact=0.02)[1] for r in (1, 2, 3, 5)]
    assert np.all(np.diff(width) < 0.0)


def test_five_readings_of_which_nothing_is_stated_refute_nothing():
    held, _, p = many(n=5, noise=Noise(**NONE))
    assert 0.84 <= held <= 0.97 and np.isnan(p).all()


@pytest.mark.parametrize("n", [12, 50, 200])
def test_p_values_of_the_true_model_are_even(n):
    """Noise known from the very readings; 0.05 ± 0.015 of 200."""
    p = many(n=n, noise=Noise(**NONE))[2]
    p = p[np.isfinite(p)]
    assert 0.01 <= np.mean(p < 0.05) <= 0.12 and 0.4 <= np.mean(p < 0.5) <= 0.6
