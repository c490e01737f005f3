"""A heavy body in a bowl: its travel counts from where it rests, and what carries it there is not counted again."""

from __future__ import annotations

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

MESH = {"mesher": "mapped", "n": 8, "slip": 0.5}
WATER = 1e-5  # N/mm³
ASKED = (0.02, 0.1, 0.5)


def pressed(values, kind="bowl", asked=ASKED, moments=(), multipliers=True):
    settings = {"mesh": MESH, "support": {"kind": kind}, "multipliers": multipliers, "derivatives": False}
    programme = Programme((0.0, 1.0, 2.0), (0.0, max(asked), 0.0), tuple(asked), moments)
    given = {"mu": 0.01, "D1": 5.8, **({"bowl_friction": 0.0} if kind == "bowl" else {}), **values}
    return BACKEND(given, Case("c", programme, settings)).channels


@pytest.mark.parametrize("multipliers", [True, False])
def test_at_no_travel_a_heavy_body_lies_where_it_was_left(multipliers):
    """Nothing has moved and nothing is pressed: to 1e-4 of the force at 0.5 mm, and 1e-3 mm (0.02 mm before).

    That is what a further augmentation still moves, as points at the rim of the bowl's contact come and go.
    """
    at = pressed({"weight": WATER}, moments=(2.0,), multipliers=multipliers)
    assert at["travel"][-1] == 0.0
    assert at["Fz"][-1] < 1e-4 * at["Fz"][2]
    assert abs(at["uz_max"][-1]) < 1e-3 and abs(at["bulge"][-1]) < 1e-3


@pytest.mark.parametrize("weight", [WATER, 10.0 * WATER])
def test_a_body_pressed_into_its_bowl_by_its_weight_is_as_good_as_held(weight):
    """Hardly touched, the ball moves a heavy body nowhere: 3 % at 0.02 mm; above, it is a little softer than held."""
    bowl, held = pressed({"weight": weight}), pressed({"weight": weight}, "fixed")
    Fz, stiff = bowl["Fz"][:3], held["Fz"][:3]
    np.testing.assert_allclose(Fz, stiff, rtol=0.03)


def test_both_drivers_count_from_the_same_rest():
    """An elastic body and one whose relaxation takes a day, by the driver that follows the way: 0.5 % at all depths."""
    slow = {"weight": WATER, "prony_g": 1e-3, "prony_tau": 1e5}
    one, other = pressed({"weight": WATER}), pressed(slow)
    np.testing.assert_allclose(other["Fz"], one["Fz"], rtol=5e-3)


def test_without_multipliers_a_heavy_body_is_as_stiff():
    """The bowl's share of the correction is of what the ball adds to the pressures of the weight, not of these.

    1.5 % on this mesh, where a weightless body has 1 %; with those of the weight it was 3 to 20 %.
    """
    exact, soft = (pressed({"weight": WATER}, asked=(*ASKED, 1.0), multipliers=m) for m in (True, False))
    np.testing.assert_allclose(soft["Fz"][1:3], exact["Fz"][1:3], rtol=1.5e-2)


@pytest.mark.parametrize("x", [0.0, 10.0])
def test_what_carries_a_heavy_body_that_may_turn_is_no_multiplier(x):
    """Those stay with points of the body, and beside the top it turns: a random one rolled away from under the ball."""
    settings = {"mesh": MESH, "support": {"kind": "bowl"}, "derivatives": False, "point": [x, 0.0]}
    values = {"mu": 0.01, "D1": 5.8, "bowl_friction": 0.0, "weight": WATER}
    (point,) = BACKEND.solve(values, Case("c", Programme.ramp((0.3,)), settings)).result.points
    ball, bowl = (touch.multiplier.any() for touch in point.load.touches)
    assert ball and bowl == (x == 0.0)
