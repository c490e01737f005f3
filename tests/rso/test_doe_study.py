"""Designs, constraints, whole curves and sensitivities as keys of a study file."""

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration.plan import fe_design, full_design, make_plan
from rso.emulation.emulator import load_emulator
from rso.study.errors import StudyError
from rso.study.loader import load_study as load_study

PLAIN = "reduce = false\nheld_out = 0\n"


def plan_of(folder, **changes):
    return make_plan(load_study(studies.write(folder, **changes)))


def problem(folder, **changes):
    with pytest.raises(StudyError) as caught:
        plan_of(folder, **changes)
    return str(caught.value)


def test_a_finished_design_is_extended_and_its_runs_stay(tmp_path):
    for kind in ("lhs", "sobol", "osf"):
        first = full_design(plan_of(tmp_path, doe=f'{PLAIN}kind = "{kind}"\nruns = 10'))
        more = full_design(plan_of(tmp_path, doe=f'{PLAIN}kind = "{kind}"\nruns = 10\nextend = 6'))
        assert more.shape == (16, 2) and np.array_equal(more[:10], first)
    few, _ = fe_design(plan_of(tmp_path, doe="runs = 10"), True)
    many, _ = fe_design(plan_of(tmp_path, doe="runs = 10\nextend = 200"), True)
    assert len(many) > len(few) and many[: len(few)] == few


def test_constraints_between_parameters_hold_for_design_sensitivities_and_search(tmp_path):
    changes = {
        "doe": 'runs = 16\nheld_out = 3\nconstraints = ["mu * D1 <= 0.6"]',
        "sensitivity": "samples = 64\nmorris = true",
    }
    found = studies.run(tmp_path, **changes)
    products = [v["mu"] * v["D1"] for v in found["design"]["points"]]
    assert max(products) <= 0.6
    # The truth, mu D1 = 0.72, is forbidden: whatever is found stays on this side.
    assert all(c["values"]["mu"] * c["values"]["D1"] <= 0.6 * (1 + 1e-9) for c in found["searches"][0]["candidates"])
    assert 0.1 < found["sensitivity"]["excluded"] < 0.9 and "leave out" in found["sensitivity"]["story"]
    assert "the parameters are correlated" in found["sensitivity"]["story"]
    assert "independently" not in found["sensitivity"]["story"]
    learnt = [r for r in found["runs"] if r["purpose"] in ("design", "held_out")]
    assert max(r["values"]["mu"] * r["values"]["D1"] for r in learnt) <= 0.6 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("doe", "words"),
    [
        ('constraints = ["mu * E <= 1"]', "'E' is not understood"),
        ('constraints = ["mu"]', "is not an inequality"),
        ('constraints = ["mu < 1e-9"]', "less than 1 %"),
        ('kind = "lhs"\nstar = "face"', 'star belongs to kind = "ccd"'),
        ('kind = "ccd"\nalpha = "orthagonal"', "orthogonal"),
        ('kind = "lhs"\nalpha = "orthogonal"', 'alpha belongs to kind = "ccd"'),
        ('kind = "ccd"\nalpha = 1.5\nstar = "face"', "exactly 1 where face-centred"),
        ('kind = "factorial"\nruns = 9\nlevels = [2, 3]', "give 6 runs, not 9"),
        ('kind = "ccd"\nconstraints = ["mu * D1 <= 0.6"]', "of ccd violate"),
    ],
)
def test_what_a_design_cannot_do_is_said_before_anything_runs(tmp_path, doe, words):
    assert words in problem(tmp_path, doe=PLAIN + doe)


def test_a_circumscribed_design_has_its_corners_at_the_ranges_and_the_search_stays_inside(tmp_path):
    doe = PLAIN + 'kind = "ccd"\nstar = "circumscribed"'
    plan = plan_of(tmp_path, doe=doe)
    mu = sorted({round(v["mu"], 9) for v in fe_design(plan, False)[0]})
    assert mu[0] < 0.006 < mu[-1] and {0.006, 0.02} <= set(mu)
    low, high = plan.box.from_unit(np.stack([plan.searches[0].low, plan.searches[0].high]))
    np.testing.assert_allclose([low[0], high[0]], [0.006, 0.02], rtol=1e-9)  # to the cube and back
    found = studies.run(tmp_path, doe=doe)
    bars = [b for b in found["sensitivity"]["curves"] if b["parameter"] == "mu"]
    np.testing.assert_allclose([bars[0]["x"][0], bars[0]["x"][-1]], [0.006, 0.02], rtol=1e-9)
    beyond = 'mu = { low = "0.02 kPa", high = "9 MPa" }\nD1 = { low = 10, high = 150 }'
    assert "lie outside the bounds of mu" in problem(tmp_path, doe=doe, parameters=beyond)


def test_morris_and_sensitivities_along_the_curve(tmp_path):
    found = studies.run(tmp_path, sensitivity="samples = 256\nmorris = true")["sensitivity"]
    morris = {(m["output"], m["parameter"]): m for m in found["morris"]}
    local = {(b["output"], b["parameter"]): b for b in found["local"]}
    deep = next(o for o, _ in local if o.startswith("top:Fz@2"))
    # A stiffer body pushes harder, a more compressible one less.
    assert morris[deep, "mu"]["mu"] > 0 > morris[deep, "D1"]["mu"]
    along = [a for a in found["along"] if a["parameter"] == "D1"]
    assert len(along) >= 8 and [a["depth_mm"] for a in along] == sorted(a["depth_mm"] for a in along)
    # On a bonded layer compressibility matters more the deeper one presses; mu scales every force alike.
    assert abs(along[-1]["elasticity"]) > abs(along[0]["elasticity"]) and along[-1]["first"] > along[0]["first"]
    # As good as the surrogate, a polynomial of the logarithm or not: 1 %.
    mu = [a["elasticity"] for a in found["along"] if a["parameter"] == "mu"]
    d1 = [a["elasticity"] for a in along]
    np.testing.assert_allclose(np.array(mu) - np.array(d1), 1.0, rtol=0.01)  # F = mu f(mu D1)


def test_whole_curves_in_a_study_and_surrogates_on_disk(tmp_path):
    found = studies.run(tmp_path, surrogate='kind = "whole_curve"')
    kinds = {s["output"]: s["kind"] for s in found["surrogates"]}
    assert kinds["top:Fz@2"] == "whole_curve" and found["exit_code"] == 0
    best = found["searches"][0]["candidates"][0]["values"]
    np.testing.assert_allclose(best["mu"] * 1.0, studies.MU, rtol=0.1)  # the noise of the data
    story = next(s["story"] for s in found["surrogates"] if s["output"] == "top:Fz@2")
    assert "modes" in story and "95 % band" in story
    emulator = load_emulator(tmp_path / "results" / "surrogates")
    surface = next(s for s in found["surfaces"] if s["output"] == "top:Fz@2")
    output = next(o for o in emulator.outputs if o.id == "top:Fz@2")
    corner = emulator.predict(output, np.array([[0.0, 0.0]]))[0][0]
    np.testing.assert_allclose(corner, surface["mean"][0][0], rtol=1e-9)  # order of summation
    assert not any(c["extrapolated"] for c in found["searches"][0]["candidates"])
