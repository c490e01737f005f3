"""The statistics against independent programs: dynesty, MINOS of iminuit, SALib, SMT.  None is used by the product.

Each program gets the same likelihood, function or design, and shares no code with what it judges.
"""

import dynesty
import iminuit
import numpy as np
import pytest
import soft_ball
from SALib.analyze import morris as salib_morris
from SALib.analyze import sobol as salib_sobol
from SALib.sample import morris as salib_trajectories
from SALib.sample import sobol as salib_points
from smt.surrogate_models import KRG

from rso.doe import design, sobol_sequence
from rso.emulation import sensitivity
from rso.emulation.kriging import condition
from rso.inference import Misfit, all_minima, determine
from rso.model_selection.evidence import log_evidence

# mu and D1 far from the ends, and D1 open to one end: a Gaussian, and none
CASES = {"determined": (30.0, 4e-3), "open": (5.0, 1e-2)}


def misfit_of(case):
    D1, noise = CASES[case]
    return Misfit(soft_ball.model(), (soft_ball.data(0.01, D1, noise, np.random.default_rng(4), gain=0.003),))


@pytest.mark.parametrize("case", ["determined", pytest.param("open", marks=pytest.mark.verification)])
def test_the_evidence_is_that_of_nested_sampling(case):
    """ln of the integral over the cube; dynesty states its own error, three of which (0.6 at most) are allowed.

    Source: Skilling, Bayesian Analysis 1 (2006) 833; Speagle, Mon. Not. R. Astron. Soc. 493 (2020) 3132.
    """
    misfit = misfit_of(case)
    whiten = np.linalg.slogdet(misfit.white(np.eye(misfit.n)))[1] - 0.5 * misfit.n * np.log(2 * np.pi)
    sampler = dynesty.NestedSampler(
        lambda x: -0.5 * float(misfit.chi2(x[None])[0]),
        lambda u: u,
        2,
        nlive=300,
        rstate=np.random.default_rng(5),
        sample="unif",
    )
    sampler.run_nested(dlogz=0.1, print_progress=False)
    found, off = sampler.results.logz[-1] + whiten, sampler.results.logzerr[-1]
    assert off < 0.2  # else it judges nothing
    fit = all_minima(misfit, seed=0)[0]
    assert log_evidence(misfit, fit, 0) == pytest.approx(found, abs=3 * off)


@pytest.mark.parametrize("case", CASES)
def test_ends_of_profiles_are_those_of_minos(case):
    """90 % intervals within 2 % of their width; an end that MINOS finds beyond the box is the bound of the box.

    Source: James & Roos, Comput. Phys. Commun. 10 (1975) 343.
    """
    misfit = misfit_of(case)
    known = determine(misfit, seed=0, mcmc=False)
    minuit = iminuit.Minuit(lambda x: float(misfit.chi2(np.asarray(x)[None])[0]), known.fit.x)
    minuit.errordef, minuit.limits, minuit.strategy = iminuit.Minuit.LEAST_SQUARES, (0.0, 1.0), 2
    minuit.migrad()
    minuit.minos(cl=0.9)
    assert minuit.fval == pytest.approx(known.fit.chi2, abs=1e-3)
    for k, one in enumerate(known.known):
        end, interval = minuit.merrors[k], one.profile_interval
        width = interval.high - interval.low
        low = 0.0 if end.at_lower_limit else minuit.values[k] + end.lower
        high = 1.0 if end.at_upper_limit else minuit.values[k] + end.upper
        assert (interval.at_low, interval.at_high) == (end.at_lower_limit, end.at_upper_limit)
        assert (interval.low, interval.high) == pytest.approx((low, high), abs=0.02 * width)


PROBLEM = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0.0, 1.0]] * 3}


def ishigami(X):
    """Over the unit cube; the third acts only together with the first.  Ishigami & Homma, ISUMA 1990."""
    a, b, c = (2 * np.pi * (X - 0.5)).T
    return np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


def test_sobol_indices_are_those_of_salib():
    """Both of some 2 × 10⁴ points; the standard error of either is 0.005 to 0.01."""
    X = salib_points.sample(PROBLEM, 4096, calc_second_order=False, seed=1)
    theirs = salib_sobol.analyze(PROBLEM, ishigami(X), calc_second_order=False, seed=1)
    mine = sensitivity.saltelli_indices(ishigami, 3, seed=0, n=1024)
    np.testing.assert_allclose(mine.first, theirs["S1"], atol=0.03)
    np.testing.assert_allclose(mine.total, theirs["ST"], atol=0.03)


def test_elementary_effects_are_those_of_salib():
    """2000 trajectories on the same grid of four levels: within 4 standard errors of the mean of either."""
    X = salib_trajectories.sample(PROBLEM, 2000, num_levels=4, seed=1)
    theirs = salib_morris.analyze(PROBLEM, X, ishigami(X), num_levels=4, seed=1)
    mine = sensitivity.morris(ishigami, 3, seed=0, trajectories=2000)
    off = 4 * np.hypot(mine.sigma, theirs["sigma"]) / np.sqrt(2000) + 1e-9
    assert np.all(np.abs(mine.mu - theirs["mu"]) < off)
    assert np.all(np.abs(mine.mu_star - theirs["mu_star"]) < off)
    np.testing.assert_allclose(mine.sigma, theirs["sigma"], rtol=0.1, atol=1e-9)


def test_kriging_is_that_of_smt_on_the_same_design():
    """Ordinary kriging with the same correlation lengths; standard deviations over that of the process, which SMT
    estimates: its nugget costs 1e-5 of either."""
    X, Q = design("lhs", 2, 20, 0), sobol_sequence(2, 128, 1)
    y = np.sin(3 * X[:, 0]) + X[:, 1] ** 2
    lengths = np.array([0.35, 0.5])
    mine = condition(X, y, np.zeros(20), 0, float(y.var()), lengths, False, kernel="squared_exponential")
    # SMT divides by the sample's deviation: exp(−θ (Δx/s)²) = exp(−(Δx/ℓ)²/2)
    theta = X.std(axis=0, ddof=1) ** 2 / (2 * lengths**2)
    theirs = KRG(theta0=theta.tolist(), hyper_opt="NoOp", corr="squar_exp", poly="constant", print_global=False)
    theirs.set_training_values(X, y[:, None])
    theirs.train()
    mean, sd = mine.predict(Q)
    np.testing.assert_allclose(mean, theirs.predict_values(Q)[:, 0], atol=1e-3 * np.ptp(y))
    share = np.sqrt(
        np.maximum(theirs.predict_variances(Q)[:, 0], 0.0) / float(np.squeeze(theirs.optimal_par["sigma2"]))
    )
    np.testing.assert_allclose(sd / np.sqrt(mine.variance), share, atol=2e-3)
