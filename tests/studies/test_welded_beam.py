"""The welded beam: its model against the published optimum and a closed form, its study as it is asked."""

from pathlib import Path

import pytest

import rso

STUDY = Path(__file__).parents[2] / "studies/welded_beam"
INCH, PSI, POUND = 25.4, 0.00689475729, 4.4482216
NAMES = ("weld_height", "weld_length", "beam_height", "beam_width")
BEST = (0.205730, 3.470489, 9.036624, 0.205730)  # inch, Coello & Montes 2002 and others: cost 1.724852


@pytest.fixture(scope="module")
def study():
    return rso.pareto(STUDY)


def test_the_published_optimum_has_its_cost_and_stands_on_its_limits(study):
    run = study.plan.backend(**{n: v * INCH for n, v in zip(NAMES, BEST, strict=True)})
    assert run["cost"] == pytest.approx(1.724852, rel=1e-5)  # of rounded values
    assert run["shear_stress"] == pytest.approx(13600 * PSI, rel=1e-4)
    assert run["bending_stress"] == pytest.approx(30000 * PSI, rel=1e-4)
    assert run["buckling_load"] == pytest.approx(6000 * POUND, rel=1e-4)


def test_the_study_asks_for_it(study):
    assert [o.quantity.text for o in study.plan.objectives] == ["cost", "deflection"]
    assert [round(c.high / PSI) for c in study.plan.limits[:2]] == [13600, 30000]
    low, high = (
        dict(zip(study.plan.space.names, v, strict=True)) for v in (study.plan.space.box.low, study.plan.space.box.high)
    )
    assert all(low[n] <= v * INCH <= high[n] for n, v in zip(NAMES, BEST, strict=True))


@pytest.mark.verification
def test_the_front_ends_at_the_published_optimum(study, tmp_path):
    found = rso.pareto(STUDY, folder=tmp_path).run(jobs=1)
    assert found.exit_code == 0 and len(found.runs) < 250
    assert found.candidates["cost"].min() == pytest.approx(1.724852, rel=2e-3)
    assert found.candidates["deflection"].min() / INCH == pytest.approx(4 * 6000 * 14**3 / (30e6 * 10**3 * 5), rel=1e-3)
