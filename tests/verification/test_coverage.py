"""What 90 % intervals promise, on 200 synthetic data sets."""

import sys
from pathlib import Path

import numpy as np
import pytest

from rso import inference
from rso.inference import Misfit

sys.path.insert(0, str(Path(__file__).parents[1] / "rso"))
import soft_ball

pytestmark = pytest.mark.verification

TRUTH = (0.01, 20.0)
SETS = 200
METHODS = ("profile_interval", "laplace", "mcmc")


def runs(noise, **more):
    """Share (method, parameter) of intervals that hold the truth, and how often D1 got each verdict."""
    x = soft_ball.BOX.to_unit(np.array([TRUTH]))[0]
    held, words = np.zeros((3, 2)), {"determined": 0, "weakly": 0, "not": 0}
    for seed in range(SETS):
        data = soft_ball.data(*TRUTH, noise, np.random.default_rng(seed), **more)
        found = inference.determine(Misfit(soft_ball.model(), (data,)), seed=seed)
        for k, known in enumerate(found.known):
            intervals = [getattr(known, m) for m in METHODS]
            held[:, k] += [i.low <= x[k] <= i.high for i in intervals]
        words[found.of("D1").verdict.word] += 1
    return held / SETS, words


@pytest.mark.parametrize(
    "sizes",
    [{"noise": 0.003}, {"noise": 0.002, "correlated": 0.002, "length": 1.0, "gain": 0.005, "depth_noise": 0.01}],
    ids=["white", "all kinds"],
)
def test_ninety_per_cent_intervals_hold_the_truth(sizes):
    held, words = runs(**sizes)
    # 85 to 95 %: 2.4 standard errors of 200 trials either way.
    assert np.all((held >= 0.85) & (held <= 0.95)), held
    if len(sizes) == 1:
        assert words["determined"] >= 0.9 * SETS and words["not"] == 0, words


def test_with_60_mN_D1_is_never_called_determined():
    held, words = runs(0.06)
    assert words["determined"] == 0 and words["not"] >= 0.85 * SETS, words
    assert np.all(held >= 0.85), held  # the bounds of the box cut the intervals: they hold the truth more often


def test_too_small_errors_are_caught():
    """Negative control: with errors stated a third of what they are, nothing but the widening saves the coverage."""
    x = soft_ball.BOX.to_unit(np.array([TRUTH]))[0]
    plain, widened = 0, 0
    for seed in range(SETS):
        good = soft_ball.data(*TRUTH, 0.003, np.random.default_rng(seed))
        data = inference.Data("top", "N", good.depth, good.value, good.covariance / 9)
        misfit = Misfit(soft_ball.model(), (data,))
        fit = inference.all_minima(misfit, seed=seed)[0]
        i = inference.laplace(fit)[0]
        plain += i.low <= x[0] <= i.high
        w = inference.determine(misfit, seed=seed, mcmc=False).of("mu").laplace
        widened += w.low <= x[0] <= w.high
    assert plain / SETS < 0.6 and widened / SETS >= 0.85, (plain, widened)
