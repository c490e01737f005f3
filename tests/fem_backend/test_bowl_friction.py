"""A body in a bowl that is pressed beside its top: friction keeps it where it rests, and without it tips to the wall.

Statics of two rigid bodies (no code shared): the ball pushes along the surface's normal, by β = c² x / (a² z) off the
vertical; the bowl, touched below the ball, answers along its own normal, by x / R₂ to the other side, R₂ = A²/C its
radius of curvature.  So friction above β + x/R₂ = 0.048 at x = 2.5 mm holds the body, which then turns by less than a
hundredth of a degree; below, it slides until wall and ball face each other.
"""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

A, C, X, CLEARANCE = 60.0, 35.0, 2.5, 1.75
SLOPE = C**2 * X / (A**2 * C * np.sqrt(1.0 - (X / A) ** 2))
NEEDED = SLOPE + X * (C + CLEARANCE) / (A + CLEARANCE) ** 2


def pressed(friction: float, x: float = X, depths: tuple[float, ...] = (0.35, 0.7)):
    settings = {
        "mesh": {"level": "coarse"},
        "point": [x, 0.0],
        "derivatives": False,
        "support": {"kind": "bowl", "clearance": CLEARANCE, "friction": friction},
    }
    solved = BACKEND.solve({"mu": 0.01, "D1": 6.0}, Case("beside the top", Programme.ramp(depths), settings))
    u, X0 = solved.result.points[-1].evaluation.u, solved.system.body.nodes
    r, v = X0 - X0.mean(0), u - u.mean(0)
    turned = np.degrees((v[:, 0] @ r[:, 2] - v[:, 2] @ r[:, 0]) / np.sum(r[:, [0, 2]] ** 2))
    channels = solved.result.channels
    return turned, channels["Fx"] / channels["Fz"], channels["Fz"]


@pytest.mark.parametrize("friction", [2.0 * NEEDED, pytest.param(0.5, marks=pytest.mark.verification)])
def test_friction_holds_the_body(friction):
    turned, ratio, _ = pressed(friction)
    assert abs(turned) < 0.03
    # the ball is 3 mm wide and touches up-slope of its axis; the body gives way: a fifth
    np.testing.assert_allclose(ratio, SLOPE, rtol=0.2)


@pytest.mark.verification
def test_without_friction_it_tips():
    turned, ratio, _ = pressed(0.0)
    assert turned > 0.5 and np.all(ratio > 1.4 * SLOPE)


@pytest.mark.verification
@pytest.mark.parametrize("below", [False, True])
def test_friction_little_above_what_is_needed_holds_as_well_as_much(below):
    """Far from the top 0.26 is needed; friction must not be limited by a pressure that is still to come.

    That less of it, `below`, does not hold takes as long as both that do; what slides is followed daily at 0.1.
    """
    x = 20.0
    slope = C**2 * x / (A**2 * C * np.sqrt(1.0 - (x / A) ** 2))
    needed = slope + (x - 2.0 * C * slope) * (C + CLEARANCE) / (A + CLEARANCE) ** 2  # the bowl answers below the slant
    assert 0.24 < needed < 0.28
    some, much = (pressed(f, x, (0.4,))[2][0] for f in (1.3 * needed, 3.0 * needed))
    np.testing.assert_allclose(some, much, rtol=0.05)  # both hold; which points creep at the rim of the contact differs
    assert not below or pressed(0.7 * needed, x, (0.4,))[2][0] < 0.5 * much


@pytest.mark.verification
def test_a_body_that_slides_is_followed_in_the_steps_asked_for():
    """At (20, 0) friction of 0.1 does not hold: it slides and rolls until wall and ball face each other.

    A predictor that takes the sliding end of the last step for the start of the next, where everything is stuck, leads
    the ball millimetres into the body: three failed steps on this way.
    """
    settings = {
        "mesh": {"level": "coarse"},
        "point": [20.0, 0.0],
        "multipliers": False,
        "support": {"kind": "bowl", "clearance": 1.5, "friction": 0.1},
    }
    found = BACKEND({"mu": 0.01, "D1": 10.0}, Case("slides", Programme.ramp((0.1, 0.34, 0.68)), settings))
    assert found.info["cutbacks"] == 0 and found.info["steps"] == 3 and found.info["loose"] == 0
    assert found.channels["Fz"][-1] < 0.01  # where held it is 0.07 N
