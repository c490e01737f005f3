"""What the kidney asks about and what its twin fits together: the backend models all of it."""

from pathlib import Path

import numpy as np
import pytest

from rso.calibration.plan import make_plan
from rso.next_experiment.experiments import done, planned_experiment, refuse
from rso.study.loader import load_study

KIDNEY = Path(__file__).parents[2] / "studies" / "kidney_em2"


@pytest.mark.parametrize("folder", [KIDNEY, KIDNEY / "twin"])
def test_every_experiment_is_modelled(folder):
    plan = make_plan(load_study(folder))
    items = [*done(plan), *(planned_experiment(plan, e) for e in plan.study.next.experiments)]
    refuse(plan, items)
    for item in items:
        deepest = max(float(b.depth.max()) for b in item.blocks)
        assert deepest <= max(item.case.programme.asked_mm) * (1 + 1e-9)  # every reading lies on the computed curve


def test_the_wide_profile_holds_the_narrow_one():
    plan = make_plan(load_study(KIDNEY))
    items = {e.name: planned_experiment(plan, e) for e in plan.study.next.experiments}
    near, far = ({p.channel for p in items[n].blocks[0].places} for n in ("profile", "wide profile"))
    assert near < far and len(near) == 9


def test_the_twin_s_profile_is_read_mark_by_mark():
    plan = make_plan(load_study(KIDNEY / "twin"))
    (block,) = next(i for i in done(plan) if i.name == "profile").blocks
    assert block.data is not None and len(block.data.value) == len(block.depth) == 52
    at_the_ball = next(p for p in block.places if p.channel == "uz(0,5)")
    k = list(block.places).index(at_the_ball)
    rows = slice(4 * k, 4 * k + 4)
    np.testing.assert_allclose(block.data.depth[rows], [1, 2, 3, 4], atol=1e-9)
    assert np.all(np.diff(block.data.value[rows]) < 0)  # it goes down under the ball
