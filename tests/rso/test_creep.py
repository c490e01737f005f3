"""Creep at a held force in `rso run`: what is read of it, simulated, identified, and said where it is not."""

import tomllib

import creep_backend as toy
import numpy as np
import pytest
from sample_studies import Inline, read

from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.calibration.readings import curve_data, places_from_contact
from rso.contract import Segment
from rso.data import creep_curve, creep_of
from rso.data import read_measurement as read_file
from rso.data.measured_curve import Noise
from rso.discrepancy.library.test_plan import _usable
from rso.evaluation.store import RunStore
from rso.model_selection.candidate_models import axes_of, levels_of
from rso.model_selection.study_ladder import ladder_plan
from rso.next_experiment.experiments import done
from rso.study.loader import load_study

STUDY = """
[study]
title = "Creeping body"
seed = 0
[backend]
use = "creep_backend:BACKEND"
[parameters]
mu = { low = 0.004, high = 0.03, scale = "log" }
"""
RELAXING = 'g = { low = 0.05, high = 0.8 }\ntau = { low = 0.5, high = 60, scale = "log" }\n'
EXPERIMENT = """
[[experiments]]
name = "press"
role = "fit"
data = "press.csv"
noise = { Fz = "0.02 mN", depth = "0.2 um", contact = 0, gain = 0, correlation = 0 }
[report]
html = false
pdf = false
"""
DESCENT = '[search]\nmethod = "gauss_newton"\nderivatives = "differences"\n'


def written(folder, opened=RELAXING, text="", **of_record):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "press.csv").write_text(toy.record(**of_record))
    (folder / "study.toml").write_text(STUDY + opened + EXPERIMENT + text)
    return folder / "study.toml"


def ran(file):
    plan = make_plan(load_study(file))
    with RunStore(file.parent / "results") as store:
        run_study(plan, store, Inline(), file.parent / "results", command="test", jobs=1)
    return read(file.parent)


# ------------------------------------------------------------------------------------------------------- readings


@pytest.mark.parametrize("segments", [True, False], ids=["by its segments", "by its shape"])
@pytest.mark.parametrize("control", ["travel", "force"])
def test_a_hold_at_a_force_is_read_as_what_it_is(tmp_path, control, segments):
    file = tmp_path / "a.csv"
    file.write_text(toy.record(control=control, segments=segments))
    m = read_file(file)
    hold = creep_of(m, 0.1)
    assert m.repeats[0].depth.max() < 0.22 and set(m.repeats[0].segment) == {"loading"}
    assert any("are those of creep, depth over time" in d for d in m.doubts)
    assert hold.control == control and hold.force == pytest.approx(8e-3, rel=5e-3)
    came = toy.reached(8e-3, 0.1, 0.01, 0.45, 6.0)
    assert hold.rise == pytest.approx({"travel": came, "force": 4.0}[control], rel=0.02)
    curve = creep_curve(m, Noise(Fz=2e-5, depth=2e-4, gain=0.0, contact=0.0, correlation=0.0), hold)
    x = {"travel": toy.SIZE * (0.1 * came) ** 1.5, "force": toy.ramped(8e-3, 2e-3, 0.01, 0.45, 6.0)}[control]
    exact = toy.crept(hold.since, x, 8e-3, 0.01, 0.45, 6.0)
    assert np.abs(curve.value - exact).max() < (1e-3 if segments else 2e-3)
    assert curve.channel == "travel" and curve.unit == "mm" and curve.held.all()


def test_stated_noise_of_a_depth_goes_with_the_root_of_the_readings(tmp_path):
    """Over 30 records the errors at 14 moments are those stated: Σ z² within a quarter of its expectation."""
    z = []
    for seed in range(30):
        file = tmp_path / f"{seed}.csv"
        file.write_text(toy.record(seed=seed, white=5e-4, control="force"))
        m = read_file(file)
        hold = creep_of(m, 0.1)
        curve = creep_curve(m, Noise(Fz=5e-5, depth=5e-4, gain=0.0, contact=0.0, correlation=0.0), hold)
        exact = toy.crept(hold.since, toy.ramped(8e-3, 2e-3, 0.01, 0.45, 6.0), 8e-3, 0.01, 0.45, 6.0)
        z.append(((curve.value - exact) / curve.sigma)[2:])  # the first moments hold one reading each
    z = np.concatenate(z)
    assert 0.75 < np.mean(z**2) < 1.35


def test_contact_and_gain_have_the_signs_of_the_loading(tmp_path):
    """A contact found late by o makes forces larger at their depth and the depths of a hold smaller; a cell that shows
    too much by g lets a body be pressed by less: δ ~ F^{1/p} with the power p = 3/2 of a ball."""
    (tmp_path / "a.csv").write_text(toy.record())
    m = read_file(tmp_path / "a.csv")
    hold = creep_of(m, 0.1)
    curve = creep_curve(m, Noise(depth=1e-6, gain=0.02, contact=0.01, correlation=0.0), hold)
    np.testing.assert_allclose(curve.shared["contact"], -0.01)
    np.testing.assert_allclose(curve.shared["gain"], -0.02 * curve.value / 1.5, rtol=0.1)


# ---------------------------------------------------------------------------------------------------------- plans


def test_a_model_that_relaxes_is_simulated_at_the_force(tmp_path):
    plan = make_plan(load_study(written(tmp_path)))
    hold = plan.creeps.followed["press creep"]
    case = plan.cases[plan.case_of["press creep"]]
    there, rest = case.programme.segments
    assert there == Segment("travel", rate=hold.rate, to_N=hold.force) and rest.asked_s == hold.moments
    assert plan.case_of["press"] != plan.case_of["press creep"] and "press creep" not in case.settings
    place = places_from_contact(plan, "press creep", "travel")
    assert place.held.all() and len(curve_data(plan, place).value) == len(hold.since)
    assert plan.group.reference is None and "a force that is held" in plan.group.why
    answer = toy.BACKEND({"mu": 0.01, "g": 0.4, "tau": 5.0}, case)
    assert all(o.read(answer) > 0.0 for o in plan.outputs if o.channel == "travel")


def test_an_elastic_model_fits_the_loading_alone_and_says_so(tmp_path):
    plan = make_plan(load_study(written(tmp_path / "a", opened="")))
    assert not plan.creeps.followed and list(plan.case_of) == ["press"]
    said = plan.of_hold("press")
    assert "Only the loading is fitted, by a model that does not creep" in said[0]
    opened = tomllib.loads("\n".join(line.strip() for line in said[-2:]))
    assert set(opened) == {"g", "tau"}
    assert make_plan(load_study(written(tmp_path / "b", opened="\n".join(said[-2:]) + "\n"))).creeps.followed


def test_a_backend_of_travel_alone_is_said_to_be_one(tmp_path):
    file = written(tmp_path)
    file.write_text(file.read_text().replace(":BACKEND", ":TRAVEL_ALONE"))
    plan = make_plan(load_study(file))
    assert not plan.creeps.followed
    assert "The backend 'travel alone' does not understand" in plan.of_hold("press")[0]


# ------------------------------------------------------------------------------------------------- identification


def known(results):
    return {p["parameter"]: p for p in results["identification"]["parameters"]}


def test_creep_identifies_the_share_and_the_time(tmp_path):
    found = known(ran(written(tmp_path, text=DESCENT)))
    for name, true in {"mu": 0.01, "g": 0.45, "tau": 6.0}.items():
        low, high = found[name]["interval"]
        assert found[name]["verdict"] == "determined" and low <= true <= high and high - low < 0.1 * true, name


def test_a_hold_shorter_than_the_time_cannot_tell_it_and_says_so(tmp_path):
    file = written(tmp_path, lasts=1.5, white=1e-3, text=DESCENT)
    plan = make_plan(load_study(file))
    assert any("cannot determine tau beyond about 4.5 s" in line for line in plan.of_hold("press"))
    p = known(ran(file))
    assert p["tau"]["verdict"] != "determined" and p["g"]["verdict"] == "not" and p["mu"]["verdict"] == "determined"


def test_a_ladder_offers_what_creep_asks_for(tmp_path):
    """The study's model does not relax: the ladder has it with a first relaxation too, and compares both with creep."""
    plan = ladder_plan(load_study(written(tmp_path, opened="")))
    assert plan.creeps.followed
    levels = levels_of(plan)
    assert [level.name for rung in levels for level in rung] == ["study", "study+relaxation"]
    opened = levels[1][0].open
    assert opened["tau"][0] < 6.0 < opened["tau"][1]
    axes = axes_of(plan, levels[1][0], {})
    assert axes.group.reference is None and "a force that is held" in axes.group.why


def test_the_next_experiment_knows_what_creep_has_told(tmp_path):
    plan = make_plan(load_study(written(tmp_path)))
    item = next(i for i in done(plan) if i.name == "press creep")
    assert item.case.programme.forced and item.blocks[0].places[0].channel == "travel"


def test_a_diagnosis_leaves_creep_out_and_says_so(tmp_path):
    (tmp_path / "a.csv").write_text(toy.record())
    said = _usable(read_file(tmp_path / "a.csv").repeats[0])[1]
    assert len(said) == 1
    assert said[0].startswith("300 readings of creep at a held force")
