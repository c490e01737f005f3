"""What a stranger asks for: any body under any indenter, deep, answers at any depths; none depends on which."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, SimulationFailed

BALL = {"shape": "sphere", "radius": 3.0, "shaft": True}
SLAB = {"specimen": {"shape": "slab", "thickness": 9.0}, "support": {"kind": "bonded"}}
PUCK = {"specimen": {"shape": "cylinder", "radius": 10.0, "height": 9.0, "fillet": 0.9}}
SPHERE = {"specimen": {"shape": "sphere", "radius": 20.0}}
TIP = {"shape": "profile", "points": [[0.0, 0.0], [0.5, 0.06], [1.0, 0.25], [2.0, 1.1], [3.0, 3.0], [3.2, 6.0]]}
BODIES = {
    "flat": {**SLAB, "indenter": {"shape": "flat", "radius": 3.0, "fillet": 0.5}},
    "cone": {**SLAB, "indenter": {"shape": "cone", "half_angle": 60.0, "tip_radius": 0.6}},
    "profile": {**SLAB, "indenter": TIP},
    "layers": {
        "specimen": {"shape": "slab", "thickness": 9.0, "layers": [{"thickness": 1.0, "ratio": 4.0}]},
        "support": {"kind": "bonded"},
        "indenter": BALL,
    },
    "puck": {**PUCK, "support": {"kind": "plate"}, "indenter": BALL},
    "well": {**PUCK, "support": {"kind": "well", "radius": 10.2, "wall": "gap"}, "indenter": BALL},
    "bowl": {**SPHERE, "support": {"kind": "bowl", "clearance": 1.0, "friction": 0.0}, "indenter": BALL},
    "half_space": {"specimen": {"shape": "half_space"}, "support": {"kind": "bonded"}, "indenter": BALL},
}
VALUES = {"mu": 0.01, "D1": 4.0}


def answered(name, depths, values=VALUES):
    """Force and stated error (k,) N at depths, as far as a run comes."""
    settings = {**BODIES[name], "mesh": {"level": "coarse"}, "derivatives": False}
    try:
        found = BACKEND(values, Case("case", Programme.ramp(tuple(depths)), settings))
    except SimulationFailed as failed:
        raise AssertionError(f"{name} to {max(depths):g} mm: {failed.cause}: {failed}") from None
    return np.array(found.channels["Fz"]), np.array(found.error["Fz"])


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.verification) if n == "flat" else n for n in BODIES]
)
def test_an_answer_depends_on_no_other_depth_that_is_asked_for(name):
    """Alone, and after three others at random, 1.3 lengths of the indenter deep: within what is stated."""
    deepest = 1.3 if name == "cone" else 3.9
    rng = np.random.default_rng(list(BODIES).index(name))
    alone, error = answered(name, (deepest,))
    others = np.sort(rng.uniform(0.05, 0.95, 3)) * deepest
    among, _ = answered(name, (*others, deepest))
    assert 0.0 < alone[0] and abs(among[-1] - alone[0]) <= error[0]
    assert (np.diff(among) > 0.0).all() and error[0] < 0.1 * alone[0]
