"""The tables of the thesis: what was copied from it, and a whole page from a backend that is a formula."""

import dataclasses
import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from rso.contract import Case, Response

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def study():
    """The modules of studies/thesis, by name."""
    sys.path.insert(0, str(ROOT))
    try:
        names = ("simulations", "analysis", "figures", "identification", "rows", "tables", "validation")
        yield {n: importlib.import_module(f"studies.thesis.{n}") for n in names}
    finally:
        sys.path.remove(str(ROOT))


def formula(mu, D1, u):
    """A force (N) with the similarity and roughly the size of the real one."""
    return 52.0 * mu * (u / 4.0) ** 1.35 / (1 + 0.25 * np.log1p(3 * mu * D1))


@pytest.fixture(scope="module")
def outcomes(study, tmp_path_factory):
    """Every planned simulation, answered by the formula and kept in a store; calling again computes nothing."""
    sim = study["simulations"]
    calls = []

    @dataclasses.dataclass(frozen=True)
    class Formula(sim.HalfModel):
        name: str = "formula"

        def recipes(self, values, case):
            return {}

        def __call__(self, values, case: Case) -> Response:
            calls.append(case.name)
            u = np.array(case.programme.asked_mm)
            F = formula(values["mu"], values["D1"], u)
            x, y = case.settings["point"]
            channels = {
                "time": u,
                "travel": u,
                "Fz": F,
                "Fx": F * 35 * x / 60**2,
                "Fy": F * y / 35,
                "bulge": 0.1 * u,
                "contact_radius": np.sqrt(3 * u),
                "Fy_half": 0.1 * F,
            }
            softer = 1 + 0.1 * values["mu"] * values["D1"]
            for a, b in case.settings["profile"]:
                channels[f"uz({a:g},{b:g})"] = -0.5 * softer * u * np.exp(-a / 8)
            units = {k: self.channels.get(k, "mm") for k in channels}
            return Response(channels, units, error={"Fz": 0.01 * F}, info={"nodes": 1})

    folder = tmp_path_factory.mktemp("thesis") / "simulations"
    sim.compute(folder, many=Formula(), single=Formula())
    first = len(calls)
    sim.compute(folder, many=Formula(), single=Formula())
    assert len(calls) == first
    return sim.stored(folder)


# ------------------------------------------------------------------------------------------- what was copied


def test_the_copied_numbers_keep_the_relations_of_the_source(study):
    printed = study["simulations"].PRINTED
    first = printed["em1"]
    # Equation 3.1 with the first experiment, then equations 2.10, 2.11 and 2.9 with its rounded E = 0.02.
    E = 3 * first["middle_N"] * (1 - 0.49**2) / (4 * np.sqrt(3.0) * first["depth_mm"] ** 1.5)
    assert E == pytest.approx(first["E_Hertz_MPa"], abs=5e-5)
    assert 0.02 / (2 * 1.49) == pytest.approx(first["mu_MPa"], abs=5e-5)
    assert 2 / (0.02 / (3 * (1 - 2 * 0.49))) == pytest.approx(first["D1"], rel=1e-9)
    # The full range from E = 10 to 100 kPa and nu = 0.36 to 0.49.
    full = printed["ranges"]["FR"]
    assert full["mu_Pa"] == [round(1e4 / (2 * 1.49)), round(1e5 / (2 * 1.36))]
    np.testing.assert_allclose(full["D1"], [6 * 0.02 / 0.1, 6 * 0.28 / 0.01], atol=0.3)


def test_candidates_lie_in_their_ranges(study):
    printed = study["simulations"].PRINTED
    for name, box in (("1P FR", "FR"), ("1P RR", "RR"), ("2P RR", "2P"), ("3P", "3P")):
        for mu, D1 in printed["candidates"][name]:
            assert printed["ranges"][box]["mu_Pa"][0] <= mu <= printed["ranges"][box]["mu_Pa"][1]
            assert printed["ranges"][box]["D1"][0] <= D1 <= printed["ranges"][box]["D1"][1]
    assert printed["ranges"]["2P"]["mu_Pa"][1] - printed["candidates"]["2P RR"][0][0] < 1  # on the bound


def test_norms_are_possible_and_the_printed_means_are_not(study):
    printed, analysis = study["simulations"].PRINTED, study["analysis"]
    for row in printed["sets"].values():
        assert row["mre"] <= row["rrmse"]  # for any curve
    assert printed["means"]["rrmse"]["mean"] < printed["means"]["mre"]["mean"]
    for name in ("nrmse", "mre"):
        _, values = analysis.printed_errors(name)
        assert abs(values.mean() - printed["means"][name]["mean"]) > 0.02
        assert printed["sets"]["1"][name] in values  # set 1 is in both lists, set 3 in none
        assert printed["sets"]["3"][name] not in values


# ------------------------------------------------------------------------------------------- what is computed


def test_a_family_is_the_formula_it_came_from(study, outcomes):
    f = study["analysis"].family(outcomes, "bowl")
    D1 = np.array([1.0, 20.0, 150.0])
    # 1e-4: a cubic spline in ln x through a dozen points of a smooth function.
    np.testing.assert_allclose(f.force(0.012, D1, 3.0), formula(0.012, D1, 3.0), rtol=1e-3)
    mu = f.valley(D1, 4.0, 0.546)
    np.testing.assert_allclose(f.force(mu, D1, 4.0), 0.546, rtol=1e-9)
    assert np.all(np.diff(mu) > 0) and np.isnan(f.valley(np.array([1e5]), 4.0, 0.546)).all()
    a, b = f.slope(0.01, 30.0, 4.0)
    h = 1e-4
    by_D1 = np.log(formula(0.01, 30 * (1 + h), 4.0) / formula(0.01, 30 * (1 - h), 4.0)) / (2 * h)
    assert a - b == 1.0 and b == pytest.approx(by_D1, rel=0.02) and b < 0
    assert f.left_out() < 0.01


def test_ratios_of_sensitivity(study, outcomes):
    analysis = study["analysis"]
    f = analysis.family(outcomes, "held")
    box = (np.array([0.008, 0.012]), np.array([10.0, 60.0]))
    s = analysis.sensitivity(f, box, 4.0)
    by_mu = formula(0.012, 35.0, 4.0) - formula(0.008, 35.0, 4.0)
    by_D1 = formula(0.01, 10.0, 4.0) - formula(0.01, 60.0, 4.0)
    assert s.change == pytest.approx(by_mu / by_D1, rel=0.01)
    x = analysis.elasticity_of_four(f, 4.0)
    a, b = f.slope(0.01, x / 0.01, 4.0) if np.isfinite(x) else (4.0, -1.0)
    assert a / -b == pytest.approx(4.0, rel=0.02)


def test_a_quadratic_surface_is_exact_for_what_is_quadratic(study):
    analysis = study["analysis"]

    class Parabola:
        def force(self, mu, D1, u):
            return 1 + 3 * mu - 0.01 * D1 + 2 * mu * D1 + 5 * mu**2

    box = (np.array([0.003, 0.03]), np.array([1.0, 160.0]))
    M, D = np.array([0.004, 0.02]), np.array([30.0, 140.0])
    np.testing.assert_allclose(analysis.quadratic(Parabola(), box, 4.0)(M, D), Parabola().force(M, D, 4.0), rtol=1e-9)


def test_the_page_is_whole(study, outcomes, tmp_path):
    candidate = {"values": {"mu": 0.01, "D1": 5.0}, "state": "done", "metrics": {"middle_point": {"nrmse": 0.02}}}
    searches = [{"name": "3P", "kind": "valley", "reachable": True, "candidates": [candidate]}]
    page = study["tables"].page(outcomes, {"searches": searches, "counts": {"fe_runs": 7}})
    assert "10000 / 5 (0.020)" in page and "(7 more)" in page
    assert "nan" not in page.lower().replace("finance", "") and "{{" not in page
    for line in re.findall(r"(?:^\|.*\|\n)+", page, re.MULTILINE):
        widths = {row.count("|") for row in line.strip().split("\n")}
        assert len(widths) == 1, line
    named = set(re.findall(r"\(figures/([\w.]+)\)", page))
    assert named == set(study["figures"].draw(outcomes, tmp_path)) == {p.name for p in tmp_path.iterdir()}
    assert "Runs without an answer here: none" in page
    assert study["tables"].page(outcomes, None).count("–") > page.count("–")


def test_a_run_that_is_missing_leaves_a_dash(study, outcomes):
    fewer = {k: v for k, v in outcomes.items() if k not in ("point blue normal", "level reference held")}
    page = study["tables"].page(fewer, None)
    assert "nan" not in page.lower()
    row = next(r for r in page.split("\n") if r.startswith("| held, along the normal"))
    assert row.count("–") == 5


def test_the_shipped_page_names_its_figures():
    text = (ROOT / "docs" / "thesis_tables.md").read_text(encoding="utf-8")
    assert "python -m studies.thesis.tables" in text
    for name in re.findall(r"\(figures/([\w.]+)\)", text):
        assert (ROOT / "docs" / "figures" / name).stat().st_size > 10_000


@pytest.mark.verification
def test_the_side_force_of_half_a_ball_is_that_of_hertz(study, tmp_path):
    """Pressure p0 sqrt(1 - r^2/a^2) on a ball of radius R pushes each half sideways with 3 a / (16 R) of the force."""
    sim = study["simulations"]
    u = 0.4
    task = sim.task("half", 0.01, 1.0, (u,), sim.HELD)
    response = sim.MODEL(task.values, task.case)
    assert isinstance(response, Response)
    ratio = response.channels["Fy_half"][0] / response.channels["Fz"][0]
    # 6 %: a few elements across the contact, and a / R = 0.37 is no longer small.
    assert -ratio == pytest.approx(3 * np.sqrt(3.0 * u) / (16 * 3.0), rel=0.06)
