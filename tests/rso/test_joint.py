"""Several backends in one study: parameters of one name are one parameter, found from both tests together."""

import dataclasses

import numpy as np
import pytest

import rso
from rso.contract import Case, Programme, run_key
from rso.evaluation.joint import joint
from rso.study.errors import StudyError

DEPTHS = np.linspace(0.2, 2.0, 10)


@rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "n": (1.0, 3.0)})
def press(travel, k, n):
    return k * travel**n


@rso.model(parameters={"k": (0.2, 20.0, "N/mm"), "c": (0.0, 1.0, "N")})
def pull(travel, settings, k, c):
    return settings["springs"] * k * travel + c


BOTH = joint(press, {"pull": pull})
VALUES = {"k": 2.0, "n": 1.5, "c": 0.3}


def case(**settings):
    return Case("a", Programme.ramp(tuple(DEPTHS)), settings)


def test_each_case_is_answered_by_its_own_backend():
    assert np.allclose(BOTH(VALUES, case()).channels["Fz"], 2.0 * DEPTHS**1.5)
    assert np.allclose(BOTH(VALUES, case(backend="pull", springs=3)).channels["Fz"], 6.0 * DEPTHS + 0.3)
    with pytest.raises(ValueError, match="pull"):
        BOTH.check(case(backend="pul"))


def test_parameters_of_one_name_are_one_with_the_bounds_of_both():
    found = {p.name: p for p in BOTH.parameters}
    assert list(found) == ["k", "n", "c"] and (found["k"].low, found["k"].high) == (0.2, 10.0)
    other = dataclasses.replace(
        pull, parameters=(dataclasses.replace(pull.parameters[0], unit="N"), pull.parameters[1])
    )
    with pytest.raises(ValueError, match="parameter k"):
        joint(press, {"pull": other})


def test_a_run_is_keyed_by_its_own_parameters():
    def key(values, one):
        return run_key(BOTH, *BOTH.canonical(values, one))

    one = case(backend="pull", springs=3)
    assert key(VALUES, one) == key({**VALUES, "n": 2.0}, one) != key({**VALUES, "c": 0.1}, one)
    assert key(VALUES, case()) != key({**VALUES, "n": 2.0}, case())
    assert key(VALUES, one) != key(VALUES, case(backend="pull", springs=4))


MODULE = """import rso

@rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "n": (1.0, 3.0)})
def press(travel, k, n):
    return k * travel**n

@rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "c": (0.0, 1.0, "N")})
def pull(travel, settings, k, c):
    return settings["springs"] * k * travel + c
"""
STUDY = """[study]
title = "Two tests"
seed = 3
[backend]
use = "two_tests:press"
[backends.tension]
use = "two_tests:pull"
settings = { springs = 3 }
[parameters]
k = { low = 0.5, high = 5.0 }
n = { low = 1.0, high = 2.0 }
c = { low = 0.0, high = 1.0 }
[[experiments]]
name = "press"
role = "fit"
data = "press.csv"
noise = { Fz = "0.01 N", contact = "0 mm", gain = 0, correlation = "0 mm" }
[[experiments]]
name = "pull"
role = "fit"
backend = "tension"
data = "pull.csv"
noise = { Fz = "0.01 N", contact = "0 mm", gain = 0, correlation = "0 mm" }
[doe]
runs = 16
held_out = 1
[sensitivity]
sobol = false
[search]
repair = false
population = 12
generations = 5
candidates = 1
[dispatch]
jobs = 1
[report]
html = false
pdf = false
"""


@pytest.fixture
def two(tmp_path):
    rng = np.random.default_rng(1)
    for name, force in (("press", 2.0 * DEPTHS**1.5), ("pull", 6.0 * DEPTHS + 0.3)):
        rows = [f"{u:.3f},{f:.6f}" for u, f in zip(DEPTHS, force + rng.normal(0, 0.01, 10), strict=True)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n")
    (tmp_path / "two_tests.py").write_text(MODULE)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_both_tests_together_find_the_truth(two, here):
    found = rso.load(two).run(jobs=1)
    table = found.parameters
    assert (table["verdict"] == "determined").sum() >= 2
    for name, truth in VALUES.items():
        assert table.loc[name, "low"] <= truth <= table.loc[name, "high"]
        assert table.loc[name, "high"] - table.loc[name, "low"] < 0.1
    assert set(found.curves["experiment"]) == {"press", "pull"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('backend = "tension"', 'backend = "tensoin"', ["experiments[1].backend", "did you mean 'tension'"]),
        ('backend = "tension"', "", ["backends.tension", "no experiment"]),
        (
            'backend = "tension"',
            'backend = "tension"\nsettings = { backend = "x" }',
            ["experiments[1].settings.backend"],
        ),
        ('use = "two_tests:pull"', "", ["backends.tension", "use"]),
        ("[doe]", '[diagnose]\neffects = "all"\n[doe]', ["diagnose", "one backend"]),
    ],
)
def test_bad_input_is_refused_with_its_place(two, old, new, words):
    (two / "study.toml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(StudyError) as caught:
        rso.load(two)
    assert all(w in str(caught.value) for w in words), str(caught.value)
