"""The studies of flat bodies: every test of theirs is of revolution, their data hold the truth that they name."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly, experiment
from rso.calibration.plan import make_plan
from rso.study.loader import load_study

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.mark.parametrize(("name", "true"), [("gel_slab", {"mu": 0.01, "D1": 5.8}), ("puck", {"mu": 0.015, "D1": 4.0})])
def test_a_study_of_flat_bodies(name, true):
    """Every experiment is solved on its meridian; at the truth the middle of its repeats differs by what is stated."""
    study = load_study(STUDIES / name)
    assert {c.name for c in make_plan(study).cases} == {e.name for e in study.experiments}
    for e in study.experiments:
        settings = experiment.read_settings(study.settings_of(e.name))
        assert assembly.placement_of(settings, BACKEND.knobs(true, settings)).meridian


def test_the_layer_on_bone_is_held_and_relaxes():
    study = load_study(STUDIES / "cartilage")
    (case,) = make_plan(study).cases
    assert case.programme.asked_s and case.programme.time_s[-1] > 30.0
    assert {"prony_g", "prony_tau"} <= set(study.parameters)


def test_curves_of_the_gel_are_those_of_the_other_program():
    """The mean of the repeats is the table's force, to the scatter that the script adds: gain, contact and noise."""
    spec = importlib.util.spec_from_file_location("make_data", STUDIES / "gel_slab" / "make_data.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name in script.SLABS:
        rows = np.loadtxt(STUDIES / "gel_slab" / "measured" / f"{name}.csv", delimiter=",", skiprows=1)
        depth, force = rows[:, 0], rows[:, 1]
        exact = script.curve(name, depth)
        off = 4.0 * np.hypot(script.NOISE, np.hypot(script.GAIN, 1.6 * script.CONTACT / depth) * exact)
        assert np.all(np.abs(force - exact) < off)
