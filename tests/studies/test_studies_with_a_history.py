"""Studies whose way matters: they load, read what their files hold, and their records are those of their programs."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from rso.calibration.plan import make_plan
from rso.study.loader import load_study

STUDIES = Path(__file__).parents[2] / "studies"


def plan(name):
    return make_plan(load_study(STUDIES / name))


def test_creep_is_read_as_creep():
    found = plan("creep")
    assert sorted(found.creeps.followed) == ["held 4 mN creep", "held 8 mN creep"]
    assert {a.name for a in found.resolved.axes} == {"mu", "prony_g", "prony_tau"}
    hold = found.creeps.followed["held 8 mN creep"]
    assert (
        hold.force == pytest.approx(8e-3, rel=0.01) and hold.grows > 0.02 and hold.lasts == pytest.approx(60.0, abs=1)
    )


def test_a_pull_off_is_compared_by_its_way_back():
    found = plan("pull_off")
    curve = found.curves["pull_off"]
    assert curve.depth.min() < 0.0 and curve.value.min() < 0.0
    assert found.study.experiment("pull_off").branch == "unloading"


def test_rests_of_both_pucks_are_compared():
    found = plan("poroelastic_gel")
    assert set(found.holds) == {"narrow", "wide"}
    assert all(hold.lasts > 80.0 for hold in found.holds.values())


@pytest.mark.verification
@pytest.mark.parametrize("radius", [2.0, 4.0])
def test_the_data_of_the_gel_do_not_hang_on_their_grid(radius):
    """Twice as many points and steps half as long: below 1e-3 of the force."""
    program = runpy.run_path(str(STUDIES / "poroelastic_gel" / "make_data.py"))
    force, times = program["force"], np.array([0.1, 0.3, 0.6, 3.0, 30.0])
    coarse = force(times, radius)
    force.__globals__.update(POINTS=400, GROWTH=1.01, FIRST=5e-4)
    np.testing.assert_allclose(coarse, force(times, radius), rtol=1e-3)
