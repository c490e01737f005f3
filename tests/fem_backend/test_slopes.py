"""Derivatives of the channels by the material against differences of whole runs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fem_backend.backend import BACKEND, differentiable
from fem_backend.simulation import derivatives
from rso.contract import Case, Programme

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
VALUES = {"mu": 0.01, "D1": 5.8}
BOWL = {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.0}}
CASES = {  # values, settings, knobs that must come with a derivative
    "neo_hookean": ({}, {}, ("mu", "D1")),
    "linear_elastic": ({}, {"material": {"law": "linear_elastic"}}, ("mu", "D1")),
    "mooney_rivlin": ({"C01": 2e-3}, {}, ("mu", "D1", "C01")),
    "yeoh": ({"C20": 1e-3, "C30": 5e-4}, {}, ("mu", "D1", "C20", "C30")),
    "ogden": ({"alpha": 6.0}, {}, ("mu", "D1", "alpha")),
    "ogden, two terms": ({"alpha": 4.0}, {"material": {"law": "ogden", "ogden": [[-3.0, 0.3]]}}, ("mu", "D1", "alpha")),
    "fibre": ({"fibre": 5e-3, "fibre_k2": 2.0, "fibre_angle": 90.0}, {}, ("mu", "D1", "fibre", "fibre_k2")),
    "skin": ({"skin_ratio": 3.0}, {}, ("mu", "D1", "skin_ratio")),
    "inclusion": ({"inclusion_ratio": 0.2, "inclusion_depth": 8.0}, {}, ("mu", "D1", "inclusion_ratio")),
    "bowl": ({}, BOWL, ("mu", "D1")),
    "weight": ({"weight": 1e-5}, {}, ()),  # the sag before contact, where the depth counts from, is not differentiated
    "misaligned": ({"offset_x": 1.0}, {}, ("mu", "D1")),
}


def run(values, settings):
    return BACKEND({**VALUES, **values}, Case("c", Programme.ramp((0.75, 1.5)), {"mesh": SMALL, **settings}))


@pytest.mark.parametrize("what", CASES)
def test_gradients_are_differences_of_whole_runs(what):
    """Every knob, law and channel.  Central differences with 0.1 % see 1e-6 of the derivative; beyond that the stated
    ones use the last but one factor (a residual of 1e-4 and less) and contact points may change sides in between.
    """
    values, settings, knobs = CASES[what]
    r = run(values, settings)
    assert set(r.gradients) == set(knobs)  # none is better than a wrong one
    for knob in knobs:
        value = {**VALUES, **values}[knob]
        h = 1e-3 * value
        low, high = (run({**values, knob: value + s * h}, {**settings, "derivatives": False}) for s in (-1, 1))
        for name in ("Fz", "uz_max", "bulge", "peak_pressure"):
            difference = (high.channels[name] - low.channels[name]) / (2 * h)
            size = np.abs(r.channels[name]).max() / value
            np.testing.assert_allclose(
                r.gradients[knob][name], difference, rtol=1e-3, atol=2e-4 * size, err_msg=f"{knob} {name}"
            )
        assert (
            np.abs(r.gradients[knob]["Fz"]).max() * value > 1e-4 * r.channels["Fz"].max()
        )  # there is something to see


@pytest.mark.parametrize("mu", [1e-6, 0.01, 1e3])
def test_the_difference_of_a_number_that_is_zero_does_not_hang_on_the_modulus(mu):
    """α = 0 for any μ: with μ for the difference, 1e-5 μ, the derivative was round-off of a soft body, of a stiff one
    that of a distant α.  Against central differences to 1e-5 of α² / 6."""
    law = {"material": {"law": "ogden"}}
    values = {"mu": mu, "D1": 0.058 / mu}
    here = run({**values, "alpha": 0.0}, law)
    low, high = (run({**values, "alpha": a}, {**law, "derivatives": False}).channels["Fz"] for a in (-1e-2, 1e-2))
    np.testing.assert_allclose(here.gradients["alpha"]["Fz"], (high - low) / 2e-2, rtol=1e-3)


def test_gradients_are_in_the_order_of_the_passages():
    programme = Programme((0.0, 1.5, 3.0), (0.0, 1.5, 0.0), (0.75, 1.5))
    there_and_back = BACKEND(VALUES, Case("c", programme, {"mesh": SMALL}))
    once = run({}, {})
    for knob in ("mu", "D1"):
        np.testing.assert_array_equal(there_and_back.gradients[knob]["Fz"], once.gradients[knob]["Fz"][[0, 1, 0]])


@pytest.mark.parametrize("values", [{"friction": 0.3}, {"prony_g": 0.2}, {"mullins": 0.2}, {"adhesion": 1e-4}])
def test_no_derivative_is_better_than_a_wrong_one(values):
    r = run(values, {})
    assert r.gradients == {}


def test_knobs_at_neutral_have_no_derivative_and_do_not_cost_one(make_bench):
    b = make_bench()
    assert differentiable(b.settings, b.knobs) == ("mu", "D1")
    assert set(differentiable(b.settings, b.other(C20=1e-4).knobs)) == {"mu", "D1", "C20"}


def test_derivatives_change_no_answer_and_cost_no_factorisation(graded):
    with_, without = graded.solve([1.0], gradients=("mu", "D1")), graded.solve([1.0])
    for name, channel in without.channels.items():
        assert with_.channels[name].tobytes() == channel.tobytes(), name
    assert with_.counters.factorisations == without.counters.factorisations


def test_derivatives_that_are_not_wanted_are_not_there():
    """And the answer is the same to the last digit; cheap runs of a diagnosis ask for none."""
    plain, without = run({}, {}), run({}, {"derivatives": False})
    assert plain.gradients and not without.gradients
    for name, value in plain.channels.items():
        np.testing.assert_array_equal(without.channels[name], value)
    assert BACKEND.draft["derivatives"] is BACKEND.lean["derivatives"] is False


def test_multipliers_are_differentiated_too(graded, monkeypatch):
    """Negative control: with the multipliers taken as fixed numbers the derivative is far off."""
    right = graded.solve([1.5], gradients=("D1",)).gradients["D1"]["Fz"]
    call = derivatives.Slopes.__call__

    def forgetful(self, stage, last):
        self._dlambda = {}
        call(self, stage, last)

    monkeypatch.setattr(derivatives.Slopes, "__call__", forgetful)
    wrong = graded.solve([1.5], gradients=("D1",)).gradients["D1"]["Fz"]
    assert abs(wrong / right - 1) > 5e-3  # residuals of 1e-5 leave 2e-4


@pytest.mark.parametrize(
    "settings", [{}, {"point": [10.0, 0.0], "direction": "normal"}, BOWL], ids=["top", "normal", "bowl"]
)
def test_what_a_residual_makes_of_the_force_is_taken_out(settings, monkeypatch):
    """Of the force along the way of the ball, by a solver that leaves a tenth and residuals of 1e-2: the multipliers,
    off by as much, leave 1e-3 of it.  Negative control: left in, the residual does ten times that."""
    way = np.array([0.0, 0.0, 1.0])
    if "direction" in settings:
        way = np.array([10.0 / 60.0**2, 0.0, np.sqrt(1.0 - (10.0 / 60.0) ** 2) / 35.0])
        way /= np.linalg.norm(way)

    def along():
        by_D1 = run({}, settings).gradients["D1"]
        return way @ [by_D1[c] for c in ("Fx", "Fy", "Fz")]

    monkeypatch.setattr(derivatives, "DERIVATIVE_RESIDUAL_TOLERANCE", 1e-9)
    exact, call = along(), derivatives.Slopes.__call__

    def crudely(self, stage, last):
        found = stage.equilibrium
        found = dataclasses.replace(found, linear=lambda v: 0.9 * stage.equilibrium.linear(v))
        call(self, dataclasses.replace(stage, equilibrium=found), last)

    monkeypatch.setattr(derivatives.Slopes, "__call__", crudely)
    monkeypatch.setattr(derivatives, "DERIVATIVE_RESIDUAL_TOLERANCE", 1e-2)
    error = np.abs(along() / exact - 1.0).max()
    monkeypatch.setattr(derivatives, "whole", lambda placement, force: np.zeros(3))
    assert error < 1e-3 and np.abs(along() / exact - 1.0).max() > 10.0 * error


def test_mu_is_differentiated_with_the_other_moduli_whether_they_are_asked_for_or_not(graded):
    """μ ∂c/∂μ follows from the other moduli, which nobody needs to ask for; differences of whole runs are above."""
    alone, both = (graded.solve([1.5], gradients=names).gradients for names in (("mu",), ("mu", "D1")))
    assert set(alone) == {"mu"}
    for channel, value in both["mu"].items():
        np.testing.assert_array_equal(alone["mu"][channel], value)


def test_an_ogden_exponent_has_a_derivative_also_where_it_is_neutral(make_bench):
    """α = 2 is neo-Hookean, but F does not rest there: the derivative is that of its neighbours to 1e-2 of itself."""
    ogden = {"material": {"law": "ogden", "ogden": [[4.0, 0.3]]}}
    exact, near = (run({"alpha": a}, ogden).gradients for a in (2.0, 2.0 + 1e-3))
    assert set(exact) == set(near) == {"mu", "D1", "alpha"}
    np.testing.assert_allclose(exact["alpha"]["Fz"], near["alpha"]["Fz"], rtol=1e-2)
    plain = make_bench()
    assert "alpha" not in differentiable(plain.settings, plain.knobs)  # other laws have no exponent


def test_a_penalty_without_multipliers_has_no_derivatives():
    """That of what the force lacks is not known (dFz/dD1 was 1 to 6 % off); one key, wanted or not."""
    assert run({}, {"multipliers": False}).gradients == {}
    keys = {
        repr(BACKEND.canonical(VALUES, Case("c", Programme.ramp((0.75,)), {"multipliers": False, "derivatives": d})))
        for d in (False, True)
    }
    assert len(keys) == 1
