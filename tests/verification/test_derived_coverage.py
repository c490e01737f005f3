"""Profile intervals of a derived quantity hold the truth as often as they say."""

import numpy as np
import pytest
from scipy import stats

from rso import inference
from rso.doe import Box
from rso.inference import Data, Misfit, Model
from rso.inference.derived import derived_interval

pytestmark = pytest.mark.verification
A, TRUTH, SIGMA = np.random.default_rng(5).standard_normal((12, 3)), np.array([0.5, 0.45, 0.55]), 0.02


def test_coverage_is_the_level():
    """A nonlinear quantity of a linear model with known noise: 90 % of 300 intervals, within a binomial's 99 %."""
    box = Box(("a", "b", "c"), ("1",) * 3, (0.0,) * 3, (1.0,) * 3, (False,) * 3)
    model, hits = Model(box, lambda X: box.from_unit(X) @ A.T), 0
    for seed in range(300):
        y = A @ TRUTH + SIGMA * np.random.default_rng(seed).standard_normal(12)
        data = Data("c", "N", np.arange(1.0, 13.0), y, SIGMA**2 * np.eye(12))
        d = inference.determine(Misfit(model, (data,)), seed=0, mcmc=False)
        i = derived_interval(d, lambda X: np.exp(X[:, 0]) * X[:, 1])
        hits += i.low <= np.exp(TRUTH[0]) * TRUTH[1] <= i.high
    low, high = stats.binom.ppf([0.005, 0.995], 300, 0.9)
    assert low <= hits <= high
