"""Pull-off of bodies that relax, rub or are solved in space, beside limits and solvers that they must agree with."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

pytestmark = pytest.mark.verification

MU, R = 0.01, 1.0
STIFF = 4.0 * MU
W = 1e-3 * STIFF * R
UNIT = (W**2 * R / STIFF**2) ** (1.0 / 3.0)  # mm, of JKR's jump
PULL = np.pi * W * R
TABOR = 1.5
BALL = {
    "specimen": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "radius": R},
    "mesh": {"level": "coarse"},
}
VALUES = {"mu": MU, "D1": 0.2, "adhesion": W, "adhesion_range": UNIT / TABOR}
WAY = Programme((0.0, 1.0, 2.0), (0.0, 1.5 * UNIT, -1.6 * UNIT), tuple(UNIT * np.array([-0.9, -0.5, 0.5, 1.5])))


def forces(**values):
    """Forces over π w R at the asked travels, there and back."""
    return BACKEND({**VALUES, **values}, Case("a", WAY, BALL)).channels["Fz"] / PULL


def test_a_time_that_is_short_or_long_beside_the_test():
    """A body that relaxes at once is that of its long-term modulus, one that hardly relaxes that of the instant."""
    share = 0.4
    np.testing.assert_allclose(forces(prony_g=share, prony_tau=1e3), forces(), atol=2e-3)
    np.testing.assert_allclose(forces(prony_g=share, prony_tau=1e-3), forces(mu=(1.0 - share) * MU), atol=2e-2)


def test_a_time_of_the_test_holds_longer():
    """Contact that has relaxed is parted faster than it relaxes: the way back pulls by more than either limit."""
    between = forces(prony_g=0.4, prony_tau=0.5)
    assert between[2:].min() < forces()[2:].min() - 0.3


def test_friction_hardly_matters_of_an_incompressible_body():
    """Its surface moves little along a ball (Johnson 1985, §5.4)."""
    np.testing.assert_allclose(forces(friction=0.3), forces(), atol=2e-2)


@pytest.mark.parametrize("work", [4e-3, 5e-4])
def test_in_space_it_is_the_meridian_within_what_both_state(work):
    """A ball beside the axis by a micrometre is solved in space, by other elements on another mesh."""
    reach = (3.0 * work**2 / STIFF**2) ** (1.0 / 3.0)
    settings = {
        "specimen": {"shape": "cylinder", "radius": 12.0, "height": 6.0},
        "indenter": {"shape": "sphere", "radius": 3.0},
        "mesh": {"level": "coarse"},
    }
    travels = reach * np.array([-1.5, -0.9, -0.5, -0.2, 0.5, 1.0, 1.5])
    way = Programme((0.0, 1.0, 2.0), (0.0, 1.5 * reach, -1.8 * reach), tuple(travels))
    values = {"mu": MU, "D1": 5.0, "adhesion": work, "adhesion_range": reach}
    on, beside = (BACKEND({**values, **more}, Case("a", way, settings)) for more in ({}, {"offset_x": 1e-3}))
    assert beside.info["nodes"] > 3 * on.info["nodes"]
    off = np.abs(on.channels["Fz"] - beside.channels["Fz"])
    assert np.all(off < on.error["Fz"] + beside.error["Fz"])
