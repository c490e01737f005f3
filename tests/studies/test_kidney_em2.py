"""The shipped study: its data say what the source prints."""

from pathlib import Path

import numpy as np
import pytest

from rso.contract import Parameter
from rso.core.curves import baseline
from rso.data import combine, read_measurement, value_at
from rso.study.loader import load_study
from rso.study.resolve import resolve

FOLDER = Path(__file__).parents[2] / "studies" / "kidney_em2"


@pytest.fixture(scope="module")
def curve():
    m = read_measurement(FOLDER / "measured" / "middle_point.csv")
    (r,) = m.repeats
    return r.depth, r.channels["Fz"], r.sigma["Fz"], m.notes


def test_the_curve_meets_the_printed_numbers(curve):
    u, F, s, notes = curve
    np.testing.assert_allclose(u, np.arange(1, 41) / 10, atol=1e-12)
    assert F[-1] == pytest.approx(0.546, abs=0.0005)  # the last printed digit
    # Norms of the constant mean; the file averages over curves on two grids, of which each meets its own norm.
    assert baseline(F).nrmse == pytest.approx(0.6835, abs=0.003)
    assert np.mean(np.abs(F - F.mean())) / F.mean() == pytest.approx(0.5916, abs=0.003)
    # Negative control: Hertz's power has other ones.
    assert abs(baseline(u**1.5).nrmse - 0.6835) > 0.04
    assert any("NOT A RECORD" in note for note in notes)
    assert np.all(np.diff(F) > 0) and np.all(s >= 0.0005) and np.all(s < 0.006)


def test_the_curve_starts_steeper_than_hertz_and_ends_as_a_soft_body(curve):
    # In words in the source: steeper at first than every simulated curve, all of which start as u^1.5.
    u, F, _, _ = curve
    slope = np.gradient(np.log(F), np.log(u))
    assert slope[1:4].mean() < 1.2 and 1.2 < slope[15:].mean() < 1.8


def test_another_curve_through_the_same_force_misses_the_print(curve):
    # Negative control: what the two baselines alone would allow, a power law, is not this curve.
    u, F, s, _ = curve
    assert np.max(np.abs(0.546 * (u / 4) ** 1.335 - F) / s) > 4


def test_the_study_loads_and_resolves():
    study = load_study(FOLDER)
    mu, D1 = Parameter("mu", "shear", "MPa", 1e-6, 10.0), Parameter("D1", "volume", "1/MPa", 1e-4, 1e5)
    resolved = resolve(study, (mu, D1))
    assert [(a.name, a.low, a.high) for a in resolved.axes] == [("mu", 0.003356, 0.036765), ("D1", 1.0, 168.0)]
    assert [v.name for v in resolved.variants] == ["1P FR", "1P RR", "2P", "3P"]
    assert [[t.depth for t in v.targets] for v in resolved.variants] == [[3.9], [3.9], [2, 3.9], [2, 3, 3.9]]
    assert resolved.variants[0].axes == resolved.axes
    curve = combine(study.measurement("middle_point"), study.experiment("middle_point").noise.noise())
    assert value_at(curve, 4.0)[0] == pytest.approx(0.546, abs=0.0005)
    assert study.experiment("force_8mm").role == "validate"
    assert study.measurement("force_8mm").repeats[0].channels["Fz"].tolist() == [1.283]
