"""Noise of dense records: white, filtered, counted in steps; what bins scatter by against what is assumed."""

from __future__ import annotations

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from rso.diagnosis import make_plan, noise
from rso.measurement import Noise, Repeat

N = 1601  # readings
U = np.linspace(0.0, 4.0, N)
F = 0.04 * U**1.5
HOW = {
    "white": lambda v, F: F + 3e-3 * v,
    "filtered": lambda v, F: F + 3e-3 * uniform_filter1d(v, 60) * 60**0.5,
    "steps of 20 mN": lambda v, F: np.round((F + 1e-3 * v) / 0.02) * 0.02,
}


@pytest.mark.parametrize("how", HOW)
def test_bins_scatter_as_assumed_however_the_sensor_smooths(how):
    """200 records of one test without repeats: root mean square over the assumed standard deviation of a bin.

    White: 1 within the sampling of 14 bins.  Filtered or in steps: not more than 1.5 times too small; in steps up to 10
    times too large, as a bin may happen to hold one whole step.  Taken for white, both are twice and more too small.
    """
    rng, ratios, naive = np.random.default_rng(7), [], []
    for _ in range(40):
        v = HOW[how](rng.standard_normal(N), F)
        r = Repeat("1", U, U / 0.5, {"Fz": v}, {}, np.full(N, "loading"))
        plan = make_plan([toy.experiment("a", (r,), noise=Noise())])
        level = noise.levels(plan)["Fz"]
        (t,) = plan.tests
        use = t.depth > 0.8
        off = t.values["Fz"] - 0.04 * t.depth**1.5
        readings = noise._white(level, t, np.zeros(t.n))
        ratios.append(np.mean(off[use] ** 2 / (readings + level.correlated**2)[use]))
        naive.append(np.mean(off[use] ** 2 / readings[use]))
    got, before = np.sqrt(np.mean(ratios)), np.sqrt(np.mean(naive))
    if how == "white":
        assert 0.8 < got < 1.2 and level.correlated == 0.0
    else:
        assert 0.1 < got < 1.5
        assert before > 2.0
