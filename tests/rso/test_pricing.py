"""What simulations take, before they are run: as the backend says, set right by those that are in the store."""

import dataclasses
import types

import diagnosis_backend as toy
import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.calibration.cost_model import UNKNOWN_SIMULATION_S, pace
from rso.contract import Case, Programme
from rso.discrepancy import build_library, corrected_library, make_test_plan, planned_rerun
from rso.evaluation import Task
from rso.evaluation.store import RunStore

SLOW, FAST = ({"mu": 0.01, "stiff": s} for s in (0.5, 0.1))
CASE = Case("a", Programme.ramp((1.0, 2.0)), {"point": [0.0, 0.0]})


def priced():
    """The toy, whose stiff runs take longer."""
    own = {n: getattr(toy.BACKEND, n) for n in dir(toy.BACKEND) if not n.startswith("_")}
    return types.SimpleNamespace(**own, cost=lambda values, case: 100.0 * values["stiff"])


def stored(folder, *values, wall=3.0):
    """A store with runs that took as long."""
    with RunStore(folder) as store:
        for v in values:
            (run,) = toy.run([Task(v, CASE)])
            store.put_done(
                dataclasses.replace(
                    run, wall_s=wall, case=dataclasses.replace(run.case, name="another", artefacts={"mesh": "0" * 64})
                )
            )


def test_a_backend_that_says_nothing_takes_a_guess_until_something_ran(tmp_path):
    known = pace(toy.BACKEND, tmp_path / "none")
    assert known.seconds([Task(SLOW, CASE), Task(FAST, CASE)]) == 2 * UNKNOWN_SIMULATION_S and "guess" in known.basis
    stored(tmp_path, SLOW)
    known = pace(toy.BACKEND, tmp_path)
    assert known.seconds([Task(SLOW, CASE), Task(FAST, CASE)]) == pytest.approx(6.0) and "measured" in known.basis


def test_runs_of_one_kind_tell_what_those_of_another_take(tmp_path):
    known = pace(priced(), tmp_path / "none")
    assert known.seconds([Task(SLOW, CASE), Task(FAST, CASE)]) == pytest.approx(60.0) and "kind" in known.basis
    stored(tmp_path, FAST)  # 3 s instead of the 10 that its backend says
    assert pace(priced(), tmp_path).seconds([Task(SLOW, CASE)]) == pytest.approx(15.0)


def test_what_was_run_is_there_whatever_its_mesh_is_called(tmp_path):
    stored(tmp_path, FAST)
    known = pace(toy.BACKEND, tmp_path)
    assert known.stored(Task(FAST, CASE)) and not known.stored(Task(SLOW, CASE))
    assert known.stored(Task({**FAST, "twin": 0.0}, CASE))  # in its canonical form


@pytest.mark.parametrize("support", ["fixed", "bowl"])
def test_finite_elements_say_that_what_has_less_symmetry_takes_longer(support):
    def cost(point, level="coarse", **knobs):
        settings = {"support": {"kind": support}, "point": point, "mesh": {"level": level}}
        return BACKEND.cost({"mu": 0.01, "D1": 5.0, **knobs}, Case("x", Programme.ramp((1.0,)), settings))

    top, aside, anywhere = (cost(p) for p in ([0, 0], [10, 0], [10, 5]))
    assert 1.0 < top < aside < anywhere < 120.0
    assert cost([0, 0], "fine") > cost([0, 0], "standard") > top
    assert cost([0, 0], delta_R=-5.0) >= anywhere  # no answer to be had
    if support == "fixed":
        assert cost([0, 0], prony_g=0.3) > top
    else:
        assert top > 2 * BACKEND.cost(
            {"mu": 0.01, "D1": 5.0}, dataclasses.replace(CASE, settings={"mesh": {"level": "coarse"}})
        )


def test_computing_a_cause_anew_takes_as_many_runs_as_said():
    effects = toy.effects("stiff", "g", "bias")
    plan = make_test_plan(toy.laboratory(toy.TRUTH, 0))
    tasks, each = planned_rerun(toy.base(), plan, effects)
    library = build_library(toy.base(), plan, effects, toy.run)
    at = {"stiff": [0.0, 0.3], "g": [0.0, 0.2, np.log(3.0)]}
    runs = [corrected_library(library, {e: np.array(at[e.name])}, toy.run)[1].runs for e in effects if e.name in at]
    assert len(tasks) == sum(runs) and each == pytest.approx(np.mean(runs))
