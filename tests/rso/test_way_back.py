"""The way back of a test: which readings of it count, where a model is asked, and that it tells what sticks."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sample_studies as studies
import sticky_backend

from fem_backend.backend import BACKEND as FEM
from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.core.curves import at_readings, on_the_way_back
from rso.data import Measurement, Noise, Repeat, combine, pulls_off
from rso.emulation.emulator import Output
from rso.evaluation.store import RunStore
from rso.inference import CurvePlace
from rso.inference.models import readings_matrix
from rso.report import render
from rso.study.cases import Turn, programme_back
from rso.study.loader import load_study
from rso.study.new_study import NewTest, study_text

MU, W = 0.01, 1.6e-5


def test_a_way_back_is_read_by_depth_down_to_above_contact():
    travel = np.array([0.5, 1.0, 2.0, 1.0, 0.0, -1.0])
    value = np.array([5.0, 10.0, 20.0, 8.0, -4.0, -2.0])
    depth = np.array([2.0, 1.5, 0.5, -0.5])
    np.testing.assert_allclose(at_readings(travel, travel, value, depth, back=True), [20.0, 14.0, 2.0, -3.0])
    with pytest.raises(ValueError, match="beyond the unloading"):
        on_the_way_back(travel, value, np.array([-1.1]))


def test_a_model_that_has_no_way_back_returns_on_its_way_there():
    """An elastic answer ends at the deepest travel: its loading curve, and nothing above contact."""
    u = np.linspace(0.1, 1.0, 12)
    found = on_the_way_back(u, u**1.5, np.array([-0.3, 0.0, 0.37, 1.0]))
    np.testing.assert_allclose(found, [0.0, 0.0, 0.37**1.5, 1.0], atol=1e-12)


def test_a_programme_there_and_back_asks_on_the_way_back_alone():
    p = programme_back((-0.5, 0.5, 2.0), Turn(0.5))
    assert p.travel_mm == (0.0, 2.0, -0.5) and p.asked_mm == (2.0,)
    np.testing.assert_allclose(np.interp(p.asked_s, p.time_s, p.travel_mm), [2.0, 0.5, -0.5])
    assert p.asked_s[-1] <= p.time_s[-1]


def test_values_of_a_way_back_are_linear_in_what_is_computed():
    place = CurvePlace("e", "Fz", np.array([-0.5, 0.25, 1.0]), None, True)
    outputs = [Output("e", "Fz", u, "N", 0.0, True) for u in (-1.0, 0.0, 1.0)]
    np.testing.assert_allclose(readings_matrix(outputs, place) @ [-4.0, -2.0, 6.0], [-3.0, 0.0, 6.0])
    assert all(o.id.endswith(" back") for o in outputs)


def record(noise: float = 0.0, pulls: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Depth and force there and back, of a ball that lets go 16 μm above the gel."""
    there = np.arange(-0.02, 0.0441, 0.001)
    depth = np.concatenate([there, there[-2::-1]])
    force = sticky_backend.force(MU, W if pulls else 1e-12, depth)
    force[: len(there)][there < 0.0] = 0.0
    return depth, force + np.random.default_rng(3).normal(0.0, noise, len(depth))


def measurement(depth: np.ndarray, force: np.ndarray) -> Measurement:
    segment = np.array(["loading"] * 65 + ["unloading"] * (len(depth) - 65))
    return Measurement(Path("x.csv"), "force", (Repeat("1", depth, None, {"Fz": force}, {}, segment),), ())


def test_readings_count_down_to_the_strongest_pull():
    """JKR pulls most at a travel that is not that of its jump: what comes after is left out."""
    depth, force = record()
    curve = combine(measurement(depth, force), Noise(Fz=1e-6), "Fz", "unloading")
    back = force[65:]
    assert curve.back and curve.compared.all()
    assert curve.depth[0] == pytest.approx(depth[65:][int(np.argmin(back))], abs=0.0011)
    assert curve.depth[0] < 0.0 < curve.depth[-1]


def test_without_a_pull_readings_count_from_contact_on():
    curve = combine(measurement(*record(pulls=False)), Noise(Fz=1e-6), "Fz", "unloading")
    assert curve.depth.min() > 0.0


@pytest.fixture(scope="module")
def sticking(tmp_path_factory) -> tuple[Path, dict[str, Any]]:
    """A study of modulus and work of adhesion by the way back."""
    folder = tmp_path_factory.mktemp("sticking")
    depth, force = record(1.5e-6)
    rows = [f"{0.1 * k:.1f},{u:.4f},{F:.5e}" for k, (u, F) in enumerate(zip(depth, force, strict=True))]
    (folder / "pull.csv").write_text("\n".join(["time_s,depth_mm,Fz_N", *rows]) + "\n")
    (folder / "study.toml").write_text(
        """
[study]
title = "sticking"
seed = 1
units = "N-mm-MPa-s"
[backend]
use = "sticky_backend:BACKEND"
[parameters]
mu = { low = 0.004, high = 0.03, scale = "log" }
adhesion = { low = 5e-6, high = 5e-5, scale = "log" }
[[experiments]]
name = "pull"
role = "fit"
data = "pull.csv"
branch = "unloading"
noise = { Fz = "1.5e-6 N", gain = 0, contact = "0 mm" }
[search]
method = "gauss_newton"
derivatives = "differences"
[identify]
require = ["mu", "adhesion"]
"""
    )
    plan = make_plan(load_study(folder / "study.toml"))
    with RunStore(folder / "results") as store:
        run_study(plan, store, studies.Inline(), folder / "results", command="test", jobs=1)
    return folder, studies.read(folder)


def test_modulus_and_work_of_adhesion_are_identified_by_the_way_back(sticking):
    _, results = sticking
    assert results["exit_code"] == 0
    for name, truth in (("mu", MU), ("adhesion", W)):
        found = results["determined"][name]
        assert found["determined"] and found["interval"][0] <= truth <= found["interval"][1]
        assert found["interval"][1] < 1.2 * found["interval"][0]


def test_the_report_shows_the_way_back(sticking):
    folder, results = sticking
    (candidate,) = results["searches"][0]["candidates"]
    depth = np.array(candidate["curves"]["pull"]["depth"])
    assert depth[0] < 0.0 < depth[-1] and np.all(np.diff(depth) > 0.0)
    (page,) = render(results, folder, pdf=False)
    assert "The unloading is compared" in page.read_text("utf-8")


def test_a_record_that_pulls_off_is_begun_by_its_way_back(sticking):
    """`rso new` compares the way back of a record whose way there does not pull, and guesses both knobs by JKR."""
    folder, _ = sticking
    text = study_text(folder / "new.toml", FEM, NewTest({"half-space": (), "ball": (2.0,)}), [str(folder / "pull.csv")])
    study = tomllib.loads(text)
    assert study["experiments"][0]["branch"] == "unloading"
    for name, unit, truth in (("mu", 1e-3, MU), ("adhesion", 1.0, W)):
        low, high = (unit * float(study["parameters"][name][k].split()[0]) for k in ("low", "high"))
        assert abs(np.sqrt(low * high) / truth - 1.0) < 0.2
    assert pulls_off(measurement(*record())) and not pulls_off(measurement(*record(pulls=False)))
