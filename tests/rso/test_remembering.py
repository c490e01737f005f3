"""One record whose readings remember each other, and a wrong model, which looks alike."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import sample_studies as studies
import soft_ball

from rso.calibration.readings import as_data
from rso.data import Measurement, Noise, Repeat, combine
from rso.doe import Box
from rso.inference import Data, Misfit, Model, all_minima, determine, with_autocorrelation
from rso.inference.identifiability import _widening
from rso.inference.rules import RULES

BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.005, 5.0), (0.02, 100.0), (True, True))
TRUTH = np.array([0.01, 25.0])
X = BOX.to_unit(TRUTH)
U = np.linspace(0.1, 4.0, 120)
F = soft_ball.force(*TRUTH, U)
SD, SETS = 0.002, 30
NONE = {"gain": 0.0, "contact": 0.0, "correlation": 0.0}  # of the test as a whole: said to be none
NEIGHBOURS = "The residuals are autocorrelated"


def misfit(curves, noise):
    rows = np.array(["loading"] * len(U))
    repeats = tuple(Repeat(str(k), U, None, {"Fz": y}, {}, rows) for k, y in enumerate(curves))
    d = as_data("top", "top", combine(Measurement(Path("x.csv"), "force", repeats, ()), noise), np.full(len(U), True))
    return Misfit(Model(BOX, lambda V: soft_ball.force(*BOX.from_unit(V).T[:, :, None], d.depth)), (d,))


def noise_of(length, rng):
    """Noise (n,) that remembers over a length (mm); white without."""
    if length == 0.0:
        return SD * rng.standard_normal(len(U))
    C = np.exp(-np.abs(np.subtract.outer(U, U)) / length)
    return SD * np.linalg.cholesky(C) @ rng.standard_normal(len(U))


def found(curves, noise=None, known=True):
    m = misfit(curves, noise or Noise(**NONE))
    if known:
        m = with_autocorrelation(m, all_minima(m, seed=0, near=X[None])[0].x)
    return determine(m, seed=0, near=X[None], mcmc=False)


def holds(d):
    return all(k.profile_interval.low <= x <= k.profile_interval.high for k, x in zip(d.known, X, strict=True))


@pytest.mark.parametrize(
    "length, stated", [(0.1, Noise(**NONE)), pytest.param(0.3, Noise(Fz=SD, **NONE), marks=pytest.mark.verification)]
)
def test_intervals_of_readings_that_remember_hold_the_truth(length, stated):
    """Both 90 % intervals in three of four sets at least, four standard deviations below 0.9² or more where they go
    together; as white noise, the control, they do so in half at most."""
    rng = np.random.default_rng(3)
    sets = [F + noise_of(length, rng) for _ in range(SETS)]
    after, before = ([found([y], stated, known) for y in sets] for known in (True, False))
    assert np.mean([holds(d) for d in after]) > 0.7 > 0.5 > np.mean([holds(d) for d in before])
    refuted = [d.p_value is not None and d.p_value < 0.01 for d in after]
    assert np.mean(refuted) < 0.2
    said = [d for d in after if d.p_value is None or d.p_value >= 0.01]
    assert all(NEIGHBOURS in d.story and "noise.correlation" in d.story and d.warning for d in said)


@pytest.mark.parametrize("length", [pytest.param(0.0, marks=pytest.mark.verification), 0.3])
def test_usual_errors_hold_the_truth_whether_readings_remember_or_not(length):
    """Nothing stated: both 90 % intervals in three of four sets at least, and hardly one in ten refuted."""
    rng = np.random.default_rng(3)
    every = [found([F + noise_of(length, rng)], Noise()) for _ in range(SETS)]
    assert np.mean([holds(d) for d in every]) > 0.75
    assert np.mean([d.p_value is not None and d.p_value < 0.01 for d in every]) < 0.15


def test_white_noise_is_left_alone():
    rng = np.random.default_rng(4)
    every = [found([F + noise_of(0.0, rng)]) for _ in range(SETS)]
    assert sum(bool(d.misfit.data[0].memory) for d in every) <= 2  # one case in 160
    assert all(d.warning == "" for d in every if not d.misfit.data[0].memory and d.scale == 1.0)


def test_memory_that_is_known_is_not_looked_for():
    """By repeats, or by what the study states of it; nor where the errors are far larger than what is left."""
    rng = np.random.default_rng(5)
    remembers = [F + noise_of(0.3, rng) for _ in range(3)]
    for curves, noise in (
        (remembers, Noise(**NONE)),
        (remembers[:1], Noise(correlation=0.3, Fz=SD, gain=0.0, contact=0.0)),
    ):
        assert not found(curves, noise).misfit.data[0].memory
    assert found(remembers[:1]).misfit.data[0].memory > 0.7
    assert not found(remembers[:1], Noise(Fz=200 * SD, **NONE)).misfit.data[0].memory


@pytest.mark.parametrize("stated", [Noise(**NONE), Noise(Fz=SD, **NONE)])
def test_a_wrong_model_is_not_explained_away(stated):
    """A wave of 10 % leaves residuals that go together, and more of them than three times the errors."""
    d = found([F * (1 + 0.1 * np.sin(2 * U)) + noise_of(0.0, np.random.default_rng(6))], stated)
    assert d.scale > RULES.refuted_error_ratio and d.p_value < 0.01 and "misses the data by" in d.warning
    assert all(k.verdict.word != "determined" for k in d.known)


@pytest.mark.parametrize("numerical", [0.0, 0.02])
def test_what_neighbours_miss_by_together_is_what_the_best_fit_leaves(numerical):
    """Nearly all of the residual, beside white noise of 2 mN, whatever numerical errors the model has as well."""
    y = F * (1 + 0.1 * np.sin(2 * U)) + noise_of(0.0, np.random.default_rng(6))
    m = misfit([y], Noise(Fz=SD, **NONE))
    theirs = numerical**2 * np.outer(F, F) * np.exp(-np.abs(np.subtract.outer(U, U)))
    m = dataclasses.replace(m, data=(m.data[0].plus(theirs),))
    d = determine(with_autocorrelation(m, all_minima(m, seed=0, near=X[None])[0].x), seed=0, near=X[None], mcmc=False)
    e = soft_ball.force(*d.fit.theta, U) - y
    left = np.sqrt(np.mean(e**2) - SD**2)
    said, share = map(float, re.search(r"top by ([\d.]+) mN \(([\d.]+) %", d.story).groups())
    np.testing.assert_allclose([said, share], [1e3 * left, 100 * left / y.max()], rtol=0.06)  # two digits


def test_a_small_wave_is_said_with_its_size_and_widens_the_intervals():
    y = F * (1 + 0.01 * np.sin(2 * U)) + noise_of(0.0, np.random.default_rng(7))
    d, white = found([y], Noise(Fz=SD, **NONE)), found([y], Noise(Fz=SD, **NONE), False)
    assert 0 < d.misfit.data[0].memory < 0.95 and NEIGHBOURS in d.warning and "or the model is wrong" in d.warning
    assert d.of("mu").sd_log > 1.3 * white.of("mu").sd_log


def test_the_order_of_the_readings_is_that_of_their_depths():
    y = F + noise_of(0.3, np.random.default_rng(8))
    m = misfit([y], Noise(Fz=SD, **NONE))
    (d,) = m.data
    mixed = np.random.default_rng(0).permutation(len(U))
    moved = dataclasses.replace(
        d,
        depth=d.depth[mixed],
        value=d.value[mixed],
        covariance=d.covariance[np.ix_(mixed, mixed)],
        white=d.white[mixed],
    )
    model = Model(BOX, lambda V: soft_ball.force(*BOX.from_unit(V).T[:, :, None], moved.depth))
    a, b = with_autocorrelation(m, X).data[0], with_autocorrelation(Misfit(model, (moved,)), X).data[0]
    np.testing.assert_allclose(b.covariance, a.covariance[np.ix_(mixed, mixed)], rtol=1e-12)  # rounding
    assert a.memory == pytest.approx(b.memory, rel=1e-9)


def test_a_study_says_so(tmp_path):
    u, force = np.loadtxt(studies.measured(noise=0.0).splitlines(), delimiter=",", skiprows=1).T
    wavy = force + 6e-5 * np.sin(4 * u)
    text = "depth_mm,Fz_N\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), wavy.tolist(), strict=True))
    (tmp_path / "wavy.csv").write_text(text)
    experiments = studies.SECTIONS["[experiments]"].replace("top.csv", "wavy.csv")
    results = studies.run(tmp_path, experiments=experiments, surrogate='kind = "kriging"')
    assert any(NEIGHBOURS in w and "noise.correlation" in w for w in results["warnings"])
    assert results["identification"]["scale"] > 2  # three times the stated noise is not explained away


def test_a_larger_misfit_never_makes_an_interval_narrower():
    """Through the sizes at which a p-value begins to be given and at which the model counts as refuted."""
    d = Data("top", "N", U, F, SD**2 * np.eye(len(U)), 5.0, memory=0.9)
    m = Misfit(Model(BOX, lambda V: soft_ball.force(*BOX.from_unit(V).T[:, :, None], U)), (d,))
    ν = len(U) - 2
    wider = [_widening(m, ν * ratio, ν, 0.9)[2] for ratio in np.geomspace(0.1, 100.0, 60)]
    assert np.all(np.diff(wider) >= -1e-12)
