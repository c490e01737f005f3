"""The shipped study: its data are what its script makes, and say what the source says."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from rso.contract import Parameter
from rso.curves import Resampling, baseline
from rso.measurement import combine, read, value_at
from rso.study import load, resolve

FOLDER = Path(__file__).parents[2] / "studies" / "kidney_em2"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("kidney_em2_reconstruct", FOLDER / "reconstruct.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_makes_the_shipped_files(script, tmp_path):
    script.write(tmp_path)
    for name in ("middle_point.csv", "force_8mm.csv"):
        assert (tmp_path / name).read_bytes() == (FOLDER / "measured" / name).read_bytes()


def test_the_reconstruction_meets_the_printed_numbers():
    m = read(FOLDER / "measured" / "middle_point.csv")
    (r,) = m.repeats
    F, s = r.channels["Fz"], r.sigma["Fz"]
    assert len(F) == 40 and F[-1] == 0.546
    assert baseline(F).nrmse == pytest.approx(0.6835, abs=5e-5)  # printed digits
    # Not used in the reconstruction; a power law is off by half a per cent.
    assert np.mean(np.abs(F - F.mean())) / F.mean() == pytest.approx(0.5916, abs=0.004)
    # Negative control: Hertz's power has another ratio.
    assert abs(baseline(r.depth**1.5).nrmse - 0.6835) > 0.04
    assert any("reconstruction" in note for note in m.notes)
    assert s[-1] == 0.0005 and np.all(s > 0) and np.all(s < 0.02)


def test_every_assumption_lies_in_the_band(script):
    u, central, half = script.reconstruct()
    for family in script.FAMILIES:
        other = script.curve((family, 0.05, True, 1), u)
        assert np.all(np.abs(other - central) <= half)
    for a in [("x^p", 0.1, True, 1), ("a x^2 + (1-a) x", 0.1, False, 0)]:
        assert np.any(np.abs(script.curve(a, u) - central) > 0.7 * half)  # and the band is no wider than it must


def test_resampling_carries_the_curve(script):
    u, central, half = script.reconstruct()
    at = np.array([0.55, 1.03, 2.77])
    exact = script.curve(script.CENTRAL, at)
    # F ∝ u^1.335 is no polynomial in √u: the spline misses it by far less than the band.
    np.testing.assert_allclose(Resampling(u, central)(at), exact, rtol=0, atol=0.002 * half.min() + 1e-5)


def test_the_study_loads_and_resolves():
    study = load(FOLDER)
    mu, D1 = Parameter("mu", "shear", "MPa", 1e-6, 10.0), Parameter("D1", "volume", "1/MPa", 1e-4, 1e5)
    resolved = resolve(study, (mu, D1))
    assert [(a.name, a.low, a.high) for a in resolved.axes] == [("mu", 0.003356, 0.036765), ("D1", 1.0, 168.0)]
    assert [v.name for v in resolved.variants] == ["1P FR", "1P RR", "2P", "3P"]
    assert [[t.depth for t in v.targets] for v in resolved.variants] == [[3.9], [3.9], [2, 3.9], [2, 3, 3.9]]
    assert resolved.variants[0].axes == resolved.axes
    curve = combine(study.measurement("middle_point"), study.experiment("middle_point").noise.noise())
    assert value_at(curve, 4.0)[0] == 0.546
    assert study.experiment("force_8mm").role == "validate"
    assert study.measurement("force_8mm").repeats[0].channels["Fz"].tolist() == [1.283]
