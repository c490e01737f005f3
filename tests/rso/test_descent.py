"""Gauss–Newton on runs: the truth is found in a few, what fails is backed away from, wrong derivatives are noticed."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies
import sloped_backend

from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.cli import main
from rso.contract import Parameter
from rso.core.similarity import group
from rso.doe import Box
from rso.evaluation.store import RunStore
from rso.inference import Data, EvaluatedPoint, TangentFrame, on_runs, tangents
from rso.inference.gauss_newton import chi2_in_frame, contradiction
from rso.report import render
from rso.report.calibration.numbers import report
from rso.report.language import in_language, own_words, sentences_of
from rso.report.terminal import summary
from rso.study.errors import StudyError
from rso.study.loader import load_study

DOCS = Path(__file__).parents[2] / "docs" / "results.md"
TRUTH = {"mu": studies.MU, "D1": studies.D1}
OWN = ("compressibility, D1 = 2/K", "test", "hole", "in the hole", "slopes", "spring", "wrong", "true")
TWO = (
    studies.SECTIONS["[experiments]"]
    + '\n[[experiments]]\nname = "thin"\nrole = "fit"\ndata = "thin.csv"\nsettings = { thickness = 6 }\n'
    'noise = { Fz = "0.02 mN", contact = "0 mm", gain = 0, correlation = "0 mm" }'
)


def direct(folder: Path, settings: str = "", search: str = "", **changes: str | None) -> dict[str, Any]:
    """Results of the layer's study by Gauss–Newton; `settings` and `search` are added to these tables."""
    parts = {
        "backend": 'use = "sloped_backend:BACKEND"',
        "backend__settings": f"thickness = {studies.THICKNESS}\n{settings}",
        "search": f'method = "gauss_newton"\n{search}',
        **dict.fromkeys(("doe", "surrogate", "sensitivity")),
    }
    return studies.run(folder, **{**parts, **changes})


def points(results: dict[str, Any], descent: int = 0) -> list[dict[str, Any]]:
    return results["descent"]["descents"][descent]["iterates"]


def true_within(results: dict[str, Any]) -> None:
    for name, truth in TRUTH.items():
        low, high = results["determined"][name]["interval"]
        assert results["determined"][name]["determined"] and low <= truth <= high


@pytest.fixture(scope="module")
def known(tmp_path_factory) -> dict[str, Any]:
    """A curve with noise, and a thinner layer kept for the end."""
    folder = tmp_path_factory.mktemp("direct")
    (folder / "thin.csv").write_text(studies.measured(noise=0.0, thickness=6.0))
    return direct(folder, experiments=TWO.replace('"thin"\nrole = "fit"', '"thin"\nrole = "validate"'))


def test_the_truth_is_found_in_a_few_runs_and_confirmed(known):
    true_within(known)
    assert known["exit_code"] == 0 and known["stage"] == "validate"
    assert all("scatter far less" in w for w in known["warnings"])  # twice the noise of the data is stated
    assert len(points(known)) <= 5 and known["counts"]["fe_runs"] <= 6  # one of them for validation
    last = points(known)[-1]
    assert last["agreement"] <= known["verify"]["tolerance"] and last["better"]
    # What the file holds is what the closed form says there.
    (c,) = known["searches"][0]["candidates"]
    F = indentation_backend.force(c["values"]["mu"], c["values"]["D1"], np.array(c["curves"]["top"]["depth"]), 8.0)
    np.testing.assert_allclose(c["curves"]["top"]["value"], F, rtol=1e-12)  # the same function: rounding
    (v,) = known["validation"]
    assert v["candidate"] == c["name"] and v["metrics"]["nrmse"] < 0.01
    assert "Euler" in known["design"]["similarity"]["story"] and known["design"]["similarity"]["applied"]


def test_the_layout_is_documented(known):
    words = set(re.findall(r"[A-Za-z_0-9]+", " ".join(re.findall(r"`([^`]*)`", DOCS.read_text(encoding="utf-8")))))
    descent = known["descent"]
    (one,) = descent["descents"]
    assert {*descent, *one, *one["iterates"][0]} <= words
    assert {r["purpose"] for r in known["runs"]} <= words
    assert {"surrogates", "surfaces", "mean_over_runs", "sensitivity", "design", "searches"} <= set(known)


def test_the_intervals_are_those_of_the_derivatives(known):
    """Gaussian intervals from slopes of the closed form, with the noise that the study states."""
    h = np.linspace(0, 2, 21)[1:]
    box = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.006, 10.0), (0.020, 150.0), (True, True))
    theta = np.array([known["identification"]["values"][n] for n in box.names])

    def F(t: np.ndarray) -> np.ndarray:
        return indentation_backend.force(t[0], t[1], h, 8.0)

    J = np.stack([(F(theta * (1 + 1e-5 * e)) - F(theta * (1 - 1e-5 * e))) / 2e-5 for e in np.eye(2)], axis=1)
    s = 1e-4 * F(theta)  # the backend's stated error, over the whole curve
    sigma = np.array(known["experiments"][0]["measured"]["sigma"])[-20:]
    C = np.diag(sigma**2) + np.outer(s, s) * np.exp(-np.abs(h[:, None] - h) / 2.0)
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ np.linalg.solve(C, J))))
    for k, p in enumerate(known["identification"]["parameters"]):
        assert p["sd_log"] == pytest.approx(sd[k], rel=0.02), p["parameter"]


def test_wide_intervals_are_run_at_their_ends(tmp_path):
    """With much noise D1 is hardly known; the profile of the closed form itself says how far."""
    wide = studies.SECTIONS["[experiments]"].replace("0.02 mN", "2 mN")
    ranges = 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\nD1 = { low = 1, high = 300, scale = "log" }'
    found = direct(tmp_path, experiments=wide, parameters=ranges)
    purposes = [r["purpose"] for r in found["runs"]]
    assert 0 < purposes.count("interval") and found["counts"]["fe_runs"] <= 12
    h = np.linspace(0, 2, 21)[1:]
    y = np.array(found["experiments"][0]["measured"]["value"])[-20:]
    sigma = np.array(found["experiments"][0]["measured"]["sigma"])[-20:]
    mu, D1 = np.geomspace(0.006, 0.020, 400), np.geomspace(1, 300, 300)
    F = np.stack([indentation_backend.force(1.0, c, h, 8.0) for c in np.outer(mu, D1).ravel()]).reshape(400, 300, 20)
    chi2 = np.sum(((mu[:, None, None] * F - y) / sigma) ** 2, axis=2).min(axis=0)
    inside = D1[chi2 - chi2.min() <= 2.706]  # 90 %
    low, high = found["determined"]["D1"]["interval"]
    width = np.log(inside[-1] / inside[0])
    # The grid, and what is left of the surface between the runs: a tenth of the width.
    np.testing.assert_allclose(np.log([low, high]), np.log(inside[[0, -1]]), atol=0.1 * width)
    assert width > 0.5


def test_two_experiments_count_together(known, tmp_path):
    (tmp_path / "thin.csv").write_text(studies.measured(thickness=6.0))
    both = direct(tmp_path, experiments=TWO)
    true_within(both)
    width = {k: np.ptp(r["determined"]["D1"]["interval"]) for k, r in (("one", known), ("two", both))}
    assert width["two"] < width["one"] and len(points(both)) <= 5


def test_one_and_three_parameters(tmp_path):
    one = direct(tmp_path / "one", parameters='mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }')
    assert len(points(one)) <= 4 and one["determined"]["mu"]["interval"][0] < studies.MU
    three = studies.SECTIONS["parameters"] + "\nradius = { low = 1.5, high = 6 }"
    found = direct(tmp_path / "three", parameters=three, search='start = { D1 = 40, radius = "4 mm" }')
    # Modulus and radius have much the same effect: the curve is met, whatever it says of each.
    assert found["searches"][0]["verified"] and len(points(found)) <= 10
    assert found["identification"]["p_value"] > 0.01


def test_without_derivatives_it_says_what_to_do_or_takes_differences(tmp_path):
    with pytest.raises(StudyError, match=r"search\.method.*no derivatives of Fz of 'top' by mu.*search\.derivatives"):
        direct(tmp_path / "a", 'slopes = "none"', 'derivatives = "backend"')
    silent = direct(tmp_path / "c", 'slopes = "none"')
    assert any("gives no derivatives by mu, D1 here: they are differences" in w for w in silent["warnings"])
    found = direct(tmp_path / "b", 'slopes = "none"', 'derivatives = "differences"')
    true_within(found)
    assert silent["identification"]["values"] == found["identification"]["values"]
    assert not any("derivatives" in w for w in found["warnings"])
    purposes = [r["purpose"] for r in found["runs"]]
    # Similarity leaves one parameter: one difference a point, and one run to prove it.
    assert purposes.count("difference") == purposes.count("iterate") == len(points(found)) <= 5
    assert purposes.count("proof") == 1 and found["design"]["similarity"]["proof"][0]["relative_difference"] < 1e-8


def test_a_backend_that_is_not_similar_is_noticed(tmp_path):
    for k, extra in enumerate(('slopes = "true"', 'slopes = "none"')):
        search = 'derivatives = "differences"' if k else ""
        found = direct(tmp_path / str(k), f"spring = 0.001\n{extra}", search)
        assert not found["design"]["similarity"]["applied"] and found["searches"][0]["verified"]
        assert any("not applied" in w for w in found["warnings"])
        assert english(found) == []


def test_wrong_derivatives_confirm_nothing(tmp_path):
    for k, extra in enumerate(("", "spring = 1e-6\n")):  # with the spring similarity is out of the question
        found = direct(tmp_path / str(k), f'{extra}slopes = "wrong"')
        assert found["exit_code"] == 4 and not found["searches"][0]["verified"] and found["best"] is None
        assert found["identification"] is None and any("derivatives" in w for w in found["warnings"])
        assert english(found) == []


def test_runs_without_an_answer_are_backed_away_from(tmp_path):
    # The start itself, and everything around it.
    found = direct(tmp_path / "a", "hole = [0.010, 0.013, 20, 45]")
    true_within(found)
    assert found["exit_code"] == 3 and points(found)[0]["state"] == "failed" and points(found)[0]["chi2"] is None
    assert all(r["outputs"] == {} for r in found["runs"] if r["state"] == "failed")
    assert english(found) == []
    # The truth: nothing is claimed then.
    found = direct(tmp_path / "b", "hole = [0.0115, 0.02, 1, 150]")
    assert found["exit_code"] == 4 and "no answer" in found["descent"]["descents"][0]["why"]
    assert len(points(found)) <= 20 and found["identification"] is None
    assert english(found) == []


def test_a_bound_is_respected_and_said(tmp_path):
    ranges = studies.SECTIONS["parameters"].replace("high = 150", "high = 45")
    found = direct(tmp_path, parameters=ranges)
    (c,) = found["searches"][0]["candidates"]
    assert c["values"]["D1"] == 45.0 and c["at_bound"] == ["D1"] and found["searches"][0]["verified"]
    assert any("end of the range of D1" in w for w in found["warnings"])
    assert english(found) == []
    assert all(r["values"]["D1"] <= 45.0 for r in found["runs"])


def test_several_starts_share_their_runs(tmp_path):
    one = direct(tmp_path / "one")
    three = direct(tmp_path / "three", search="starts = 3")
    assert len(three["descent"]["descents"]) == 3
    assert three["counts"]["fe_runs"] < 3 * one["counts"]["fe_runs"]
    assert all(d["verified"] for d in three["descent"]["descents"])
    assert english(three) == []


def test_it_goes_on_from_the_store_to_the_same_bits(tmp_path):
    log = tmp_path / "log"
    log.touch()
    whole = direct(tmp_path / "whole", f'log = "{log}"')
    calls = len(log.read_text().splitlines())
    again = direct(tmp_path / "whole", f'log = "{log}"')
    assert len(log.read_text().splitlines()) == calls  # nothing was computed twice
    assert studies.timeless(again) == studies.timeless(whole)
    assert again["counts"]["from_store"] == again["counts"]["fe_runs"]


def test_interrupted_between_runs_it_ends_the_same(tmp_path, monkeypatch):
    whole = direct(tmp_path / "whole")
    real, count = sloped_backend.Sloped.__call__, [0]

    def stop(self, values, case):
        count[0] += 1
        if count[0] == 3:
            raise KeyboardInterrupt
        return real(self, values, case)

    monkeypatch.setattr(sloped_backend.Sloped, "__call__", stop)
    with pytest.raises(KeyboardInterrupt):
        direct(tmp_path / "parts")
    monkeypatch.setattr(sloped_backend.Sloped, "__call__", real)
    assert studies.timeless(direct(tmp_path / "parts")) == studies.timeless(whole)


@pytest.mark.parametrize(
    ("search", "said"),
    [
        ('targets = [{ experiment = "top", depth = 1 }]', "targets belongs to method = "),
        ("repair = false", "repair belongs to method"),
        ("start = { mu = 1 }", r"search\.start\.mu = 1: must lie inside the range \[0\.006, 0\.02\]"),
        ("start = { nu = 0.3 }", "no parameter of this study"),
        ("starts = 0", "greater than or equal to 1"),
    ],
)
def test_keys_of_the_other_method_and_starts_outside_are_refused(tmp_path, search, said):
    with pytest.raises(StudyError, match=said):
        direct(tmp_path, search=search)
    file = studies.write(tmp_path / "b", search="repair = false\nstarts = 2")  # and the other way round
    with pytest.raises(StudyError, match="starts belongs to method"):
        load_study(file)


def test_conditions_between_parameters_are_refused(tmp_path):
    with pytest.raises(StudyError, match=r"doe\.constraints.*gauss_newton"):
        direct(tmp_path, doe='constraints = ["mu * D1 < 1"]')


def test_check_and_the_end_of_a_run_describe_it(tmp_path, capsys):
    file = studies.write(
        tmp_path,
        backend='use = "sloped_backend:BACKEND"',
        backend__settings="thickness = 8.0",
        search='method = "gauss_newton"\nstarts = 2\nmax_runs = 9\nstart = { mu = "9 kPa" }',
        doe=None,
        surrogate=None,
    )
    assert main(["check", str(file), "--trust"]) == 0
    said = capsys.readouterr().out
    begins = "with the backend's derivatives, differences where it has none, from mu = 0.009 and 1 more start"
    assert f"Gauss–Newton on simulations {begins}" in said
    assert "30 at most (18 iterates, 12 ends of intervals)" in said and "design:" not in said
    assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert out.count(", χ² = ") >= 3 and "  μ = 9 kPa, D₁ = " in out  # a line for each iterate
    assert "best verified candidate (main 1)" in out and "outside what agrees" not in out
    assert out.index("most likely by the whole curves: μ = ") < out.index("best verified candidate")
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    found["determined"]["mu"]["interval"] = [1.0, 2.0]  # as where three targets pull elsewhere than whole curves
    assert "    outside what agrees with the whole curves: its μ" in summary(found)


def test_the_report_shows_every_point(known, tmp_path):
    html, _ = render(known, tmp_path)
    text = html.read_text(encoding="utf-8")
    assert "point by point" in text and "Sobol" not in text and "Response surface" not in text
    assert text.count("best so far") == sum(i["better"] for i in points(known))
    part = json.loads(json.dumps(known))
    part["descent"]["descents"][0]["iterates"] = part["descent"]["descents"][0]["iterates"][:1]
    assert len(render(part, tmp_path / "short")) == 2


def english(results: dict[str, Any]) -> list[str]:
    """Sentences of the German page that have no template; not the words that the tests' own study and backend say."""
    by = sentences_of("de", own_words(results))
    in_language(report(results), by)
    return [m for m in by.missing if m not in OWN]


def test_the_german_page_says_everything_in_german(known, tmp_path):
    missing: list[str] = []  # of figures, too
    render(known, tmp_path, pdf=False, language="de", untranslated=missing)
    assert set(missing) <= set(OWN)
    other = json.loads(json.dumps(known))
    other["descent"]["derivatives"] = "differences"
    first = other["descent"]["descents"][0]
    other["descent"]["descents"].append(
        first | {"start": 2, "best": False, "verified": False, "why": "beyond, runs have no answer"}
    )
    assert english(other) == []


# ------------------------------------------------------------------------------------------------------ without a study


def frame(similar: bool = True) -> TangentFrame:
    parameters = [
        Parameter("mu", "", "MPa", 0.003, 0.04),
        Parameter("D1", "", "1/MPa", 1.0, 170.0),
    ]
    found = group(parameters, {"Fz": "N"})
    box = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.003, 1.0), (0.04, 170.0), (True, True))
    return TangentFrame(box, found if similar else dataclasses.replace(found, reference=None), np.ones(20))


def sight(f: TangentFrame, x: np.ndarray, sign: float = 1.0) -> EvaluatedPoint:
    h, theta = np.linspace(0.1, 2, 20), f.box.from_unit(x)

    def F(t: np.ndarray) -> np.ndarray:
        return indentation_backend.force(t[0], t[1], h, 8.0)

    ends = [(F(theta * (1 + 1e-6 * e)) - F(theta * (1 - 1e-6 * e))) / 2e-6 for e in np.eye(2)]
    J = np.stack(ends, axis=1) / theta
    J[:, 1] *= sign
    return EvaluatedPoint(np.asarray(x, float), F(theta), J)


@pytest.mark.parametrize("similar", [True, False])
def test_curves_between_runs_pass_through_values_and_slopes(similar):
    f = frame(similar)
    runs = [sight(f, x) for x in np.array([[0.3, 0.4], [0.5, 0.2], [0.6, 0.7], [0.35, 0.9]])]
    for base in runs:
        model = tangents(f, runs, base)
        for r in runs:
            np.testing.assert_allclose(model.predict(r.x[None])[0], r.f, rtol=1e-6)  # jitter of the process
            step, slope = 1e-5 * np.eye(2), f.box.slope(r.x)
            J = np.stack([(model.predict((r.x + s)[None]) - model.predict((r.x - s)[None]))[0] / 2e-5 for s in step])
            np.testing.assert_allclose(J.T, r.slopes * slope, rtol=1e-4, atol=1e-5 * np.abs(r.f).max())


def test_between_close_runs_the_error_falls_with_a_high_order():
    """Halving the distance of two runs: a tangent alone has order 2, the values and slopes of both have 4."""
    f, middle = frame(), np.array([0.5, 0.5])
    errors = []
    for half in (0.1, 0.05):
        away = np.array([0.0, half])
        ends = [sight(f, middle - away), sight(f, middle + away)]
        y = sight(f, middle).f
        errors.append(
            [np.abs(tangents(f, runs, ends[0]).predict(middle[None])[0] / y - 1).max() for runs in (ends[:1], ends)]
        )
    alone, both = np.log2(np.array(errors[0]) / errors[1])
    assert 1.5 < alone < 2.5 and both > 3.5 and errors[0][1] < 0.03 * errors[0][0]


def test_the_sign_of_a_slope_is_checked_on_neighbours():
    f = frame(False)
    X = np.array([[0.5, 0.5], [0.5, 0.52]])
    assert contradiction(f, [sight(f, x) for x in X]) < 1e-3
    assert contradiction(f, [sight(f, x, -1.0) for x in X]) == pytest.approx(2.0, rel=0.01)
    assert frame().imbalance(sight(frame(), X[0])) < 1e-8 < 1e-2 < frame().imbalance(sight(frame(), X[0], -1.0))


def test_a_start_at_the_answer_needs_no_second_run():
    f = frame()
    there = sight(f, np.array([0.4, 0.6]))
    data = (Data("top", "N", np.linspace(0.1, 2, 20), there.f, 1e-10 * np.eye(20)),)
    (d,) = on_runs(
        f, lambda X: [sight(f, x) for x in X], lambda _: data, there.x[None], tolerance=0.005, most=5, seed=0
    )
    assert d.confirmed and len(d.iterates) == 1 and d.chi2 == 0.0


def test_the_first_step_is_that_of_gauss_newton_with_exact_scaling():
    """After one run ln f is a straight line in ln(mu D1): its least misfit over both is a linear problem."""
    f, start, noise = frame(), np.array([0.5, 0.5]), 1e-4
    y = sight(f, np.array([0.53, 0.54])).f
    one = sight(f, start)
    data = (Data("top", "N", np.linspace(0.1, 2, 20), y, np.diag((noise * y) ** 2)),)
    seen: list[np.ndarray] = []

    def look(X):
        seen.extend(X)
        return [sight(f, x) for x in X]

    on_runs(f, look, lambda _: data, start[None], tolerance=1e-9, most=2, seed=0)
    logs = np.log(f.box.from_unit(seen[1]) / f.box.from_unit(start))
    theta = f.box.from_unit(start)
    A = one.slopes * theta / one.f[:, None]  # relative errors: rows d ln F / d ln θ
    expected = np.linalg.lstsq(A, np.log(y / one.f), rcond=None)[0]
    # ln y against ln f where the noise is relative: the two misfits differ in the second order of what is left.
    np.testing.assert_allclose(logs, expected, atol=2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_errors_that_every_run_states_anew_do_not_lead_back_and_forth(seed):
    """An error of the whole curve whose profile is another for every run: small readings, large stated errors."""
    f, rng, u = frame(), np.random.default_rng(seed), np.linspace(0.1, 2, 20)
    truth = sight(f, np.array([0.45, 0.55])).f
    y = truth * (1.03 + 0.0045 * np.cos(9.0 * u + seed)) + 2e-4 * truth.max() * rng.standard_normal(20)

    def data_of(s):
        profile = 0.03 * y * (1.0 + 0.15 * np.cos(9.0 * u + 300.0 * s.x.sum()))
        return (Data("top", "N", u, y, np.outer(profile, profile) + (2e-4 * y.max()) ** 2 * np.eye(20)),)

    (d,) = on_runs(
        f, lambda X: [sight(f, x) for x in X], data_of, np.array([[0.5, 0.5]]), tolerance=0.005, most=20, seed=0
    )
    assert d.confirmed
    assert d.chi2 == pytest.approx(chi2_in_frame(d.data, d.best.f, f))
    assert np.isfinite(d.data[0].covariance).all() and np.linalg.eigvalsh(d.data[0].covariance).min() > 0


@pytest.mark.parametrize("similar", [True, False])
def test_random_truths_from_random_starts(similar):
    """Nearly all end at the truth; a start on the far side of a second minimum may end there, at a bound."""
    f, rng, found = frame(similar), np.random.default_rng(1), []
    for _ in range(8):
        x, start = rng.random((2, 2))
        y = sight(f, x).f
        data = (Data("top", "N", np.linspace(0.1, 2, 20), y, (1e-4 * y.max()) ** 2 * np.eye(20)),)
        (d,) = on_runs(
            f, lambda X: [sight(f, v) for v in X], lambda _, c=data: c, start[None], tolerance=0.005, most=20, seed=0
        )
        assert d.confirmed and len(d.iterates) <= 12
        found.append((len(d.iterates), np.abs(d.best.f - y).max() / y.max()))
    runs, off = np.array(found).T
    assert np.median(runs) <= 5 and np.sum(off < 1e-3) >= 7


def test_run_study_takes_its_plan(tmp_path):
    """A plan whose store holds everything runs nothing."""
    direct(tmp_path)
    plan = make_plan(load_study(tmp_path))
    with RunStore(tmp_path / "results") as store:
        found = run_study(plan, store, studies.Inline(), tmp_path / "results", command="", jobs=1)
    assert found["counts"]["from_store"] == found["counts"]["fe_runs"] > 0


def test_a_force_that_nearly_vanishes_is_not_followed_by_its_logarithm():
    """Where an unloading ends, a round-off of one run would be a power of ten of the next."""
    f = dataclasses.replace(frame(similar=False), powers=np.zeros(2))
    runs = []
    for x in (0.2, 0.45, 0.6):
        at, along = np.array([x, 0.5]), np.array([[1.0, 0.0], [-float(x < 0.5), 0.0]])
        runs.append(EvaluatedPoint(at, np.array([1.0 + x, max(0.5 - x, 1e-20)]), along / f.box.slope(at)))
    X = np.column_stack([np.linspace(0.0, 1.0, 21), np.full(21, 0.5)])
    assert np.all(np.abs(tangents(f, runs, runs[1]).predict(X)) < 10.0)
