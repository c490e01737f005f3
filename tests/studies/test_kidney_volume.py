"""The formula for the lost volume, against finite elements."""

import pytest

from studies.kidney_em2.volume import loss, simulated

BOWL = {"kind": "bowl", "clearance": 1.0, "friction": 0.0}


def settings(support):
    return {"support": support, "mesh": {"level": "coarse"}}


@pytest.mark.parametrize(("mu", "D1"), [(0.01, 3.0), pytest.param(0.02, 30.0, marks=pytest.mark.verification)])
def test_a_body_in_a_smooth_bowl_loses_its_force_times_its_height(mu, D1):
    """2 mm deep; the height between the contacts is that of the body to 2 %."""
    force, lost = simulated(mu, D1, 2.0, settings(BOWL))
    assert lost == pytest.approx(loss(D1, force), rel=0.02)


def test_held_below_other_forces_do_work_too():
    """Negative control: the holder also pulls inwards, and the formula with the body's height is far off."""
    force, lost = simulated(0.01, 3.0, 2.0, settings({"kind": "fixed"}))
    assert lost > 1.5 * loss(3.0, force)
