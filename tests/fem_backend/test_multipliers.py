"""Contact without multipliers: what the penalty gives way by, taken out of the forces to first order."""

from __future__ import annotations

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation import indentation
from rso.contract import Case, Programme, SimulationFailed

VALUES = {"mu": 0.01, "D1": 10.0}
ASKED = (0.3, 0.8, 1.6, 2.4, 3.2)
SHALLOW = ASKED[:3]  # one travel of each limit below: the deep ones are those of the body that is held
SLIPPERY = {"support": {"kind": "bowl", "clearance": 1.0, "friction": 0.0}}
CASES = {  # values, settings, programme
    "held": ({}, {}, Programme.ramp(ASKED)),
    "beside the top": ({}, {"point": [20.0, 0.0]}, Programme.ramp(ASKED)),
    "slippery bowl": ({}, SLIPPERY, Programme.ramp(SHALLOW)),
    "friction": ({"friction": 0.3}, {}, Programme.ramp(SHALLOW, 0.5)),
    "relaxing": ({"prony_g": 0.4, "prony_tau": 2.0}, {}, Programme.ramp(SHALLOW, 0.5)),
}


def run(values, settings, programme, multipliers):
    own = {"mesh": {"level": "coarse"}, "derivatives": False, "multipliers": multipliers, **settings}
    return BACKEND({**VALUES, **values}, Case("c", programme, own))


DAILY = "slippery bowl", "relaxing"
LONG = [w if w in DAILY else pytest.param(w, marks=pytest.mark.verification) for w in CASES]


@pytest.mark.parametrize("what", LONG)
def test_forces_are_those_of_exact_contact(what, monkeypatch):
    """Against the same with multipliers, which share neither the correction nor the penalty's error.

    First order in what the surfaces give way by over the depth, some 1 % at 0.8 mm, and no better than the slope
    through the asked travels: 0.3 % from there on and 0.1 % from half the ball's radius.  Without the correction the
    force lacks more than twice as much (the negative control).
    """
    values, settings, programme = CASES[what]
    exact = run(values, settings, programme, True)
    added, softness = [], indentation.softness
    monkeypatch.setattr(indentation, "softness", lambda at, points: added.append(softness(at, points)) or added[-1])
    soft = run(values, settings, programme, False)
    Fz = {"soft": soft.channels["Fz"], "plain": soft.channels["Fz"] / (1.0 + added[-1])}
    off = {r: np.abs(v / exact.channels["Fz"] - 1.0) for r, v in Fz.items()}
    deep = 2.5e-3 if "prony_g" in values else 1e-3  # a body that relaxes has no potential
    assert off["soft"][1:].max() < 3e-3 and off["soft"][2:].max() < deep
    assert off["plain"][1:].max() > 2.0 * off["soft"][1:].max() and off["plain"][2:].max() > 2e-3
    assert soft.info["iterations"] < 0.8 * exact.info["iterations"]
    # what is stated besides a mesh of that level holds what is left
    assert np.all(np.abs(soft.channels["Fz"] - exact.channels["Fz"])[1:] < soft.error["Fz"][1:])


@pytest.mark.verification
def test_the_way_back_and_lateral_forces():
    there_and_back = Programme((0.0, 3.0, 6.0), (0.0, 1.5, 0.0), (0.5, 1.2))
    values, settings = {"prony_g": 0.4, "prony_tau": 2.0}, {"point": [20.0, 0.0]}
    exact, soft = (run(values, settings, there_and_back, m) for m in (True, False))
    assert len(soft.channels["Fz"]) == 4
    for c in ("Fx", "Fz"):  # of the largest force: the way back ends where nothing is left of one
        np.testing.assert_allclose(soft.channels[c], exact.channels[c], rtol=0, atol=2e-3 * exact.channels["Fz"].max())


def test_a_rest_and_the_end_of_the_way_back():
    """A hold at the deepest point parts the two ways, and at no travel there is nothing to divide by."""
    programme = Programme((0.0, 4.0, 8.0, 12.0), (0.0, 2.0, 2.0, 0.0), (0.7, 1.3, 2.0), (6.0, 12.0))
    exact, soft = (run({"prony_g": 0.3, "prony_tau": 2.0}, {}, programme, m) for m in (True, False))
    np.testing.assert_allclose(soft.channels["travel"], [0.7, 1.3, 2.0, 2.0, 1.3, 0.7, 0.0], rtol=0, atol=1e-12)
    largest = exact.channels["Fz"].max()
    np.testing.assert_allclose(soft.channels["Fz"], exact.channels["Fz"], rtol=0, atol=2e-3 * largest)


def test_it_is_part_of_the_question_where_it_is_asked_for():
    """Runs with multipliers keep the question they had, others are told apart from them."""
    case = Case("c", Programme.ramp((1.0,)), {})
    told = Case("c", Programme.ramp((1.0,)), {"multipliers": True})
    without = Case("c", Programme.ramp((1.0,)), {"multipliers": False})
    of = lambda c: BACKEND.canonical(VALUES, c)[1].settings  # noqa: E731
    assert of(case) == of(told) and "multipliers" not in of(case) and of(without)["multipliers"] is False
    with pytest.raises(ValueError, match="multipliers = 1: true or false"):
        BACKEND.check(Case("c", Programme.ramp((1.0,)), {"multipliers": 1}))


def test_similarity_stays_exact():
    case = Case(
        "c",
        Programme.ramp((0.5, 1.0)),
        {"mesh": {"mesher": "mapped", "n": 6, "slip": 0.3}, "multipliers": False, "derivatives": False},
    )
    one, other = BACKEND(VALUES, case), BACKEND({"mu": 0.03, "D1": 10.0 / 3.0}, case)
    np.testing.assert_allclose(other.channels["Fz"], 3.0 * one.channels["Fz"], rtol=1e-9)  # solver tolerance 1e-6


def test_a_run_that_fails_at_once_says_why():
    """The only travel asked for is beyond what is reached, where small strains end: there is nothing to correct."""
    mesh = {"mesher": "mapped", "n": 6, "slip": 0.3}
    settings = {"mesh": mesh, "multipliers": False, "material": {"law": "linear_elastic"}}
    with pytest.raises(SimulationFailed) as failed:
        BACKEND(VALUES, Case("c", Programme.ramp((6.0,)), settings))
    assert failed.value.cause and failed.value.partial is None
