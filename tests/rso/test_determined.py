"""A parameter is called determined only where nothing that was computed says otherwise."""

import numpy as np
import pytest

from rso import emulation
from rso.calibration.confirmed_optimum import ConfirmedOptimum
from rso.calibration.identification_stage import doubted
from rso.core.curves import Resampling, error_between_points
from rso.doe import Box, sobol_sequence
from rso.inference import Data, Misfit, Model, Runs, determine, judge_parameter, posterior_grid
from rso.inference.intervals import Interval
from rso.inference.posterior_sampling import chain, sample_posterior
from rso.inference.verdict import size

AT = np.linspace(0.1, 1.0, 10)


def made(f, box, theta, sigma=0.01):
    """Misfit of f(θ (k, d)) (k, n) against its own exact curve at θ (d,), white errors σ."""
    y = f(np.array([theta], float))[0]
    data = Data("e", "N", np.resize(AT, len(y)), y, sigma**2 * np.eye(len(y)))
    return Misfit(Model(box, lambda X: f(box.from_unit(X))), (data,))


def box(low, high, log=False):
    d = len(low)
    return Box(tuple("abc"[:d]), ("1",) * d, tuple(map(float, low)), tuple(map(float, high)), (log,) * d)


def test_a_power_law_over_decades_is_learnt_as_its_logarithm():
    """y = a b over four decades: a plane of the logarithm, exact.  It predicts a hundred times more in a corner than
    the largest value that 20 runs have, and knows that: nothing else may be preferred to it."""
    X = sobol_sequence(3, 20, 1)
    y = 10.0 ** (4 * X[:, 0] + 3 * X[:, 1] - 2 * X[:, 2] - 3)
    model = emulation.fit_surrogate("auto", X, y, seed=1)
    assert model.log
    corner = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mean, sd = model.predict(corner)
    np.testing.assert_allclose(mean, [1e4, 1e-5], rtol=1e-9)
    assert mean[0] > 10 * y.max() and np.all(sd < 1e-6 * mean)


def test_a_logarithm_that_knows_nothing_of_a_corner_is_dropped():
    """Negative control: a curved logarithm of few points, whose own sd in the corners is as large as its mean."""
    rng = np.random.default_rng(3)
    X = 0.3 + 0.2 * rng.random((12, 2))
    y = np.exp(3 * np.sin(40 * X[:, 0]) + 2 * rng.standard_normal(12))
    log, plain = (emulation.fit_kriging(X, y, seed=0, trend=2, log=g) for g in (True, False))
    assert emulation.model_choice._tame([log, plain], y) == [plain]


SUM = box([0.0, 0.0], [1.0, 1.0])
PRODUCT = box([0.1, 0.1], [100.0, 100.0], log=True)
THREE = box([0.1, 0.1, 0.1], [10.0, 10.0, 10.0], log=True)
SIGN = box([-1.0, 0.0], [1.0, 1.0])
WAVE = box([0.0, 0.0], [1.0, 1.0])
CASES = {
    "a sum": (lambda t: (t[:, :1] + t[:, 1:2]) * AT, SUM, (0.4, 0.5), 1.0),
    "a sum with a square": (lambda t: (t[:, :1] + t[:, 1:2] ** 2) * AT, SUM, (0.65, 0.5), 1.0),
    "a product": (lambda t: t[:, :1] * t[:, 1:2] * AT**2, PRODUCT, (1.0, 3.0), 0.0),
    "a quotient": (lambda t: t[:, :1] / t[:, 1:2] * AT**2, PRODUCT, (3.0, 1.0), 0.0),
    "a product of three": (lambda t: t[:, :1] * t[:, 1:2] * t[:, 2:3] * AT**2, THREE, (1.0, 2.0, 1.5), 0.0),
    "a square": (lambda t: t[:, :1] ** 2 * AT + t[:, 1:2] * AT**2, SIGN, (0.5, 0.5), 0.0),
    "a wave": (lambda t: np.sin(12 * t[:, :1]) * AT + t[:, 1:2] * AT**2, WAVE, (0.2, 0.5), 0.0),
}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", CASES)
def test_what_the_data_do_not_tell_is_never_determined(name, seed):
    """The interval of a holds every value that some value of the others makes fit, by brute force over the box."""
    f, ranges, truth, _ = CASES[name]
    misfit = made(f, ranges, truth)
    a = determine(misfit, seed=seed, mcmc=False).known[0]
    assert a.verdict.word != "determined"
    t = np.linspace(0, 1, 401)
    X = np.random.default_rng(0).random((401, 400, ranges.d))
    X[:, :, 0] = t[:, None]
    least = misfit.chi2(X.reshape(-1, ranges.d)).reshape(401, 400).min(axis=1)
    allowed = t[least <= 2.0]  # of 2.706: random points end short of the least misfit
    inside = np.any([(allowed >= p.low - 0.003) & (allowed <= p.high + 0.003) for p in a.profile.pieces()], axis=0)
    assert len(allowed) and inside.all(), allowed[~inside]


def wrong():
    """F = a b u² that a model takes for a u² with b = 3 for ever: a seems determined, b does not."""
    f = CASES["a product"][0]
    right = made(f, PRODUCT, (1.0, 3.0))
    sure = Model(PRODUCT, lambda X: PRODUCT.from_unit(X)[:, :1] * 3.0 * AT**2)
    return f, right, Misfit(sure, right.data)


def test_a_finished_run_refutes_an_interval_that_leaves_it_out():
    f, _, misfit = wrong()
    assert determine(misfit, seed=0, mcmc=False).of("a").verdict.word == "determined"
    theta = np.array([[1.0, 3.0], [10.0, 0.3], [0.2, 15.0], [5.0, 5.0]])  # the last one is no fit
    runs = Runs(PRODUCT.to_unit(theta), f(theta))
    d = determine(misfit, seed=0, mcmc=False, runs=runs)
    a = d.of("a")
    assert a.verdict.word != "determined" and d.refuting == (1, 2)
    low, high = PRODUCT.from_unit(np.array([[a.profile_interval.low, 0.5], [a.profile_interval.high, 0.5]]))[:, 0]
    assert low <= 0.2 and high >= 10.0 and "2 finished runs agree" in a.reason
    assert len(a.profile.pieces()) == 3


def test_a_finished_run_inside_or_of_no_fit_changes_no_word():
    f, _, misfit = wrong()
    theta = np.array([[1.0, 3.0], [5.0, 5.0]])
    d = determine(misfit, seed=0, mcmc=False, runs=Runs(PRODUCT.to_unit(theta), f(theta)))
    assert d.of("a").verdict.word == "determined" and not d.refuting


def test_a_range_that_was_widened_makes_no_interval_narrow():
    """0 to 0.91 of a stated range of 0 to 1 says nothing, were it searched from -10 to 11; nor is ± 0.5 close to 0.5 of
    it.  Negative control: against the widened range alone the word is 'determined'."""
    stated, wide = box([0.0, 0.0], [1.0, 1.0]), box([-10.0, -10.0], [11.0, 11.0])
    much = Interval(*wide.to_unit(np.array([[-0.001, 0.5], [0.91, 0.5]]))[:, 0])
    assert judge_parameter(wide, 0, much).word == "determined"
    assert judge_parameter(wide, 0, much, stated=stated).word == "not"
    some = Interval(*wide.to_unit(np.array([[-0.2, 0.5], [0.2, 0.5]]))[:, 0])
    assert judge_parameter(wide, 0, some, stated=stated).word == "weakly"


def test_draws_on_cells_are_those_of_the_closed_form():
    """A Gaussian cut by the box, and a curved valley 1/3000 of the box wide whose marginal is an integral."""
    line = made(lambda t: t[:, :1] * AT + t[:, 1:2], SUM, (0.5, 0.02), 0.1)
    t = (np.arange(1000) + 0.5) / 1000
    X = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    check(line, t, np.exp(-0.5 * line.chi2(X)).reshape(1000, 1000).sum(axis=1))
    f, ranges, truth, _ = CASES["a sum with a square"]
    thin = made(f, ranges, truth, 5e-4)
    t = (np.arange(4000) + 0.5) / 4000
    check(thin, t, np.where(t < 0.9, 0.5 / np.sqrt(np.maximum(0.9 - t, 1e-9)), 0.0))  # db/da at constant a + b²


def check(misfit, t, density):
    d = determine(misfit, seed=0)
    assert d.draws.method == "cells" and d.draws.enough
    expected = np.interp([0.05, 0.5, 0.95], np.cumsum(density) / density.sum(), t)
    sd = np.sqrt(np.average((t - np.average(t, weights=density)) ** 2, weights=density))
    # quantiles of 2000 independent draws scatter by 0.05 sd; and three of that
    np.testing.assert_allclose(np.quantile(d.draws.X[:, 0], [0.05, 0.5, 0.95]), expected, atol=0.15 * sd)


def test_a_chain_says_whether_it_has_converged(monkeypatch):
    """Long enough it has more than 50 autocorrelation times; cut short it says that, and gives no interval."""
    misfit = made(lambda t: t[:, :1] * AT + t[:, 1:2], SUM, (0.5, 0.4), 0.05)
    d = determine(misfit, seed=0, mcmc=False)
    good, short = (chain(misfit, [d.fit], seed=0, most=m) for m in (4000, 250))
    assert good.steps >= 50 * good.tau and good.r_hat < 1.05 and good.enough
    assert not short.enough and "autocorrelation times" in short.doubt
    on_cells = sample_posterior(misfit, [d.fit], seed=0)
    ends = [np.quantile(v.X, [0.05, 0.95], axis=0) for v in (good, on_cells)]
    np.testing.assert_allclose(*ends, atol=0.1 * float(np.ptp(ends[0], axis=0).min()))
    monkeypatch.setattr(posterior_grid, "MAX_CELLS", dict.fromkeys((1, 2, 3), 100))
    assert sample_posterior(misfit, [d.fit], seed=0).method == "chain"


@pytest.mark.parametrize("power", [1.5, 2.0, 2.7])
def test_what_lies_between_computed_depths_is_within_what_is_stated(power):
    """Errors of the spline through ten depths of F = u + u^p at readings between them; a few per cent beyond the
    estimate are forgiven, ten times too wide an estimate is not.  Hertz alone is exact."""
    u, at = np.linspace(0.1, 1.0, 10), np.linspace(0.02, 1.0, 99)
    for knots in (u, u[[0, 3, 6, 9]]):
        off = np.abs(Resampling(knots, knots + knots**power)(at) - at - at**power)
        stated = error_between_points(knots, knots + knots**power, at)
        assert np.all(off <= 1.1 * stated + 1e-12)
        assert stated.max() <= 30 * off.max() + 1e-12
    np.testing.assert_allclose(error_between_points(u, u**1.5, at), 0.0, atol=1e-12)


@pytest.mark.parametrize(("poor", "word"), [((), "determined"), (("e:Fz@1",), "weakly")])
def test_nothing_is_determined_while_surrogates_miss_their_tolerance(poor, word):
    misfit = made(lambda t: t[:, :1] * AT + t[:, 1:2], SUM, (0.5, 0.4), 0.01)
    d = doubted(determine(misfit, seed=0, mcmc=False), ConfirmedOptimum(None, (), 0.001, 1.0, True, poor=poor))
    assert [k.verdict.word for k in d.known] == [word] * 2
    assert all(("e:Fz@1" in k.reason) == bool(poor) for k in d.known)


def test_sizes_are_in_the_unit_of_their_size():
    """From a nanoindenter to a plate on soil: a force of kN was said as 7.8e+06 mN, one of nN as 4.1e-06 mN."""
    said = [size(v, "N") for v in (7.8e3, 0.5, 4.1e-3, 4.1e-6, 4.1e-9)]
    assert said == ["7800 N", "0.5 N", "4.1 mN", "4.1 µN", "4.1 nN"]
    assert [size(v, "mm") for v in (12.0, 4.1e-3, 4.1e-6)] == ["12 mm", "4.1 µm", "4.1 nm"]
