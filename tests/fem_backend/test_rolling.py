"""Steps along rigid motions, and equilibria of a body that has to roll there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly, experiment, initial_state
from fem_backend.solver import direct, load_steps, newton, rigid_motions
from fem_backend.solver.load_steps import Control, Stopped
from fem_backend.solver.newton import Counters, NotConverged

SETTINGS = {
    "mesh": {"mesher": "mapped", "n": 6, "slip": 0.3},
    "support": {"kind": "bowl", "clearance": 1.0, "friction": 0.0},
}


@pytest.fixture(
    scope="module",
    params=[[10.0, 0.0], pytest.param([8.0, 4.0], marks=pytest.mark.verification)],
    ids=["half", "whole"],
)
def lying(request):
    """A body in a bowl on springs of 0.1 μR, the ball 0.3 mm deep: bench, load, equilibrium by Newton in double."""
    settings = experiment.read_settings({**SETTINGS, "point": request.param})
    knobs = BACKEND.knobs({"mu": 0.01, "D1": 20.0}, settings)
    placement = assembly.placement_of(settings, knobs)
    counters = Counters()
    at = initial_state.initial_state(
        settings, knobs, placement, assembly.model_for(settings, knobs, placement, None), counters
    )
    u, exact = at.seated, replace(at.system, factor=direct.precise(at.model.body.pattern))
    for springs in (1e5, 1e4, 1e3):
        load = replace(at.start(0.3), springs=springs)
        found = newton.solve(exact, u, load, 1e-10, counters)
        u = found.evaluation.u
    return at, load, found


def turned(at, u, angle):
    """Everything turned about y by an angle (rad), which a plane y = 0 allows."""
    return Rotation.from_rotvec([0.0, angle, 0.0]).apply(at.model.body.nodes + u) - at.model.body.nodes


def lengths(x, pairs):
    return np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)


def test_a_rigid_step_changes_no_length_and_a_plain_one_does(lying):
    at, _, found = lying
    body, u, angle = at.model.body, found.evaluation.u, 0.05
    pairs = np.random.default_rng(1).integers(len(body.nodes), size=(200, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    step = np.cross([0.0, angle, 0.0], body.nodes + u) + np.array([0.3, 0.0, -0.2])
    step[body.free.reshape(-1, 3) < 0] = 0.0
    before = lengths(body.nodes + u, pairs)
    rigid = lengths(body.nodes + rigid_motions.moved_rigidly(rigid_motions.motion(body), u, step), pairs) / before - 1.0
    plain = lengths(body.nodes + u + step, pairs) / before - 1.0
    assert np.abs(rigid).max() < 1e-12  # round-off
    assert np.abs(plain).max() > 0.3 * angle**2  # θ²/2 across the axis


def test_a_small_step_is_the_plain_one_to_second_order(lying):
    at, _, found = lying
    body, u = at.model.body, found.evaluation.u
    step = np.random.default_rng(2).normal(size=u.shape) + 0.02 * (
        body.nodes @ np.array([[0, 0, -1], [0, 0, 0], [1, 0, 0]])
    )
    step[body.free.reshape(-1, 3) < 0] = 0.0
    how = rigid_motions.motion(body)
    errors = [np.abs(rigid_motions.moved_rigidly(how, u, h * step) - u - h * step).max() for h in (1e-1, 1e-2, 1e-3)]
    assert errors[0] / errors[1] == pytest.approx(100.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(100.0, rel=0.1)


def test_planes_of_symmetry_stay(lying):
    at, _, found = lying
    body = at.model.body
    step = np.random.default_rng(3).normal(size=body.nodes.shape)
    held = body.free.reshape(-1, 3) < 0
    step[held] = 0.0
    how = rigid_motions.motion(body)
    assert how.allowed.tolist() == ([True, False, True, False, True, False] if held.any() else [True] * 6)
    assert not rigid_motions.moved_rigidly(how, found.evaluation.u, step)[held].any()


@pytest.mark.parametrize("angle", [0.0, 0.01, -0.02])
def test_a_turned_body_rolls_back(lying, angle):
    """0.02 is 1.2 mm at the ends, more than the clearance."""
    at, load, found = lying
    counters = Counters()
    again = rigid_motions.solve(at.system, turned(at, found.evaluation.u, angle), load, 1e-10, counters)
    # both are converged to 1e-10 of the outer forces, and the springs are 1e4 times softer than the contact
    np.testing.assert_allclose(again.evaluation.u, found.evaluation.u, atol=1e-5)
    np.testing.assert_allclose(again.evaluation.contact.force, found.evaluation.contact.force, rtol=1e-6, atol=1e-9)
    assert counters.factorisations < 60


def test_the_time_of_a_run_ends_it(lying):
    at, load, _ = lying
    with pytest.raises(newton.NotConverged) as caught:
        rigid_motions.solve(at.system, at.seated, load, 1e-10, Counters(deadline=0.0))
    assert caught.value.cause == "time_limit"


@pytest.fixture
def restless(monkeypatch):
    """Equilibria are found, but none tighter than 3e-5: the tolerances that were asked for."""
    asked, find = [], load_steps.find_equilibrium

    def seek(system, u, load, tolerance, counters, *more):
        asked.append(tolerance)
        if tolerance < 3e-5:
            raise NotConverged("contact", "no equilibrium after 120 factorisations", (1.0,))
        return find(system, u, load, tolerance, counters, *more)

    monkeypatch.setattr(load_steps, "find_equilibrium", seek)
    monkeypatch.setattr(
        load_steps, "GROUNDING_SPRING_FACTORS", ()
    )  # on softer springs than those of the fixture this body rolls far away
    return asked


def test_a_body_that_finds_no_tight_rest_is_seated_less_tightly_and_says_so(lying, restless):
    at, load, found = lying
    counters, control = Counters(), Control()
    u = load_steps.seat(at.system, load, found.evaluation.u, control, counters)
    assert restless == [control.seating, 10.0 * control.seating]
    assert counters.loose == 1
    here = newton.evaluate_system(at.system, u, load)
    left = np.linalg.norm(newton.reduced(at.model.body, here.residual)) / here.scale
    assert left <= 10.0 * control.seating


def test_a_body_that_cannot_turn_is_seated_tightly_or_not_at_all(lying, restless, monkeypatch):
    at, load, found = lying
    monkeypatch.setattr(rigid_motions, "rolls", lambda system: False)
    with pytest.raises(Stopped, match="while seating") as stopped:
        load_steps.seat(at.system, load, found.evaluation.u, Control(), Counters())
    assert stopped.value.cause == "contact"


def test_a_body_that_rolls_over_when_seated_tightly_stays_as_it_lay(monkeypatch):
    """Where the tight search ends with a body that the ball would miss, the loose one counts."""
    settings = experiment.read_settings({**SETTINGS, "point": [10.0, 0.0]})
    knobs = BACKEND.knobs({"mu": 0.01, "D1": 20.0, "weight": 1e-5}, settings)
    placement = assembly.placement_of(settings, knobs)
    seats, lag = [], initial_state._lag

    def seat(system, load, u, control, counters):
        seats.append(control.seating)
        return 0.1 * len(seats) * np.ones_like(u)

    monkeypatch.setattr(load_steps, "seat", seat)
    monkeypatch.setattr(initial_state, "_lag", lambda at, u: np.inf if len(seats) == 1 else lag(at, 0.0 * u))
    counters = Counters()
    at = initial_state.initial_state(
        settings, knobs, placement, assembly.model_for(settings, knobs, placement, None), counters
    )
    assert counters.loose == 1
    assert seats == [settings.control.seating, settings.control.loose]
    np.testing.assert_array_equal(at.seated, 0.2)
