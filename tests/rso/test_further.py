"""What further experiments would tell: against Gaussian theory and against data; a valley is not believed away."""

import dataclasses
import json
import re

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies
import soft_ball
from sample_studies import Inline
from scipy import stats
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from test_ladder import STUDY, climbed, curve

from rso.calibration.plan import make_plan
from rso.cli import main
from rso.doe import Box
from rso.emulation.emulator import Output, Sample
from rso.emulation.hermite import Cubic, along_one
from rso.emulation.multi_output import multi_output
from rso.evaluation.store import RunStore
from rso.inference import Model, determine, expected_sd
from rso.inference.likelihood import Misfit
from rso.next_experiment.design_results import DETERMINED_SD_LN, by_truth, design_data, design_warnings
from rso.next_experiment.study_design import run_next
from rso.optimal_design import PossibleExperiment, expected_information
from rso.report.optimal_design.report import render_next, report
from rso.study.errors import StudyError
from rso.study.loader import load_study

LINE = Box(("a", "b"), ("1", "1"), (1.0, 1.0), (3.0, 3.0), (False, False))


def linear(name, A, sigma):
    """Readings A θ with white errors."""
    A = np.asarray(A, float)
    return PossibleExperiment(name, Model(LINE, lambda X: LINE.from_unit(X) @ A.T), lambda x: sigma**2 * np.eye(len(A)))


def test_of_a_linear_model_all_three_ways_give_the_gaussian():
    """F = AᵀA/σ² in θ; far from the box's ends Fisher information and made-up data both are exact."""
    x = np.array([0.5, 0.5])
    sum_of, difference = linear("sum", [[1, 1]] * 4, 0.05), linear("difference", [[1, -1]], 0.04)
    nothing, more = expected_information(
        LINE, x, 1, [sum_of, linear("b", [[0, 1]], 0.06)], [(), (difference,)], seed=1, draws=400
    )
    exact = np.linalg.inv(4 / 0.05**2 * np.ones((2, 2)) + np.diag([0, 1 / 0.06**2]) + 3 * np.eye(2))
    half = 2.0  # ln θ counts as Δθ/θ at θ = 2; the box as a prior is 12/(3 − 1)² = 3
    assert nothing.fisher["b"] == pytest.approx(np.sqrt(exact[1, 1]) / half, rel=1e-3)
    assert nothing.expected["b"] == pytest.approx(nothing.fisher["b"], rel=0.05)
    exact = np.linalg.inv(np.linalg.inv(exact) + np.outer([1, -1], [1, -1]) / 0.04**2)
    assert more.fisher["b"] == pytest.approx(np.sqrt(exact[1, 1]) / half, rel=1e-3)
    assert more.expected["b"] == pytest.approx(more.fisher["b"], rel=0.05)
    assert nothing.coverage == pytest.approx(0.9, abs=0.06) and more.coverage == pytest.approx(0.9, abs=0.06)


def test_the_same_experiment_again_shrinks_by_the_root_of_two():
    e = linear("both", [[1, 0], [0, 1]], 0.02)
    once, twice = expected_information(
        LINE, np.array([0.5, 0.5]), 0, [e], [(), (linear("again", [[1, 0], [0, 1]], 0.02),)], seed=2
    )
    assert once.fisher["a"] / twice.fisher["a"] == pytest.approx(np.sqrt(2), rel=0.01)
    assert once.expected["a"] / twice.expected["a"] == pytest.approx(np.sqrt(2), rel=0.1)


def ball(name, depth, noise):
    """The soft ball's curve, read at depths."""
    model = soft_ball.model(depth=depth)
    return PossibleExperiment(name, model, lambda x: noise**2 * np.eye(len(depth)))


def test_what_is_promised_is_what_inference_keeps():
    """The expected sd against fits of data drawn anew, by the program that fits real data.

    Where the Gaussian holds; 12 data sets give the mean sd to about 5 %.
    """
    mu, D1, noise = 0.01, 60.0, 2e-4
    box, depth = soft_ball.BOX, np.linspace(0.2, 4.0, 20)
    x = box.to_unit(np.array([[mu, D1]]))[0]
    (row,) = expected_information(box, x, 1, [ball("top", depth, noise)], [()], seed=3, draws=100)
    rng, found = np.random.default_rng(4), []
    for _ in range(12):
        data = soft_ball.data(mu, D1, noise, rng, depth)
        d = determine(Misfit(soft_ball.model(depth=depth), (data,)), seed=1, mcmc=False)
        found.append(d.of("D1").sd_log)
    assert row.expected["D1"] == pytest.approx(np.mean(found), rel=0.15)
    assert row.fisher["D1"] == pytest.approx(row.expected["D1"], rel=0.15)


def test_a_truth_at_the_end_of_a_flat_valley_stays_undetermined():
    """Negative control: nearly incompressible, D1 does nothing to this curve; no amount of the same tells it."""
    box, depth = soft_ball.BOX, np.linspace(0.2, 4.0, 20)
    x = box.to_unit(np.array([[0.01, 1.0]]))[0]
    once, twice = expected_information(
        box, x, 1, [ball("top", depth, 3e-3)], [(), (ball("again", depth, 3e-3),)], seed=5, draws=60
    )
    assert once.expected["D1"] > DETERMINED_SD_LN and twice.expected["D1"] > DETERMINED_SD_LN
    # Fisher information does not know that the curve would show a high D1: it is twice too doubtful here.
    assert once.expected["D1"] < 0.6 * once.fisher["D1"]


def test_without_draws_only_fisher_information_is_given():
    e = linear("both", [[1, 0], [0, 1]], 0.02)
    (row,) = expected_information(LINE, np.array([0.5, 0.5]), 0, [e], [()], seed=2, draws=0)
    assert row.expected is None
    exact = expected_sd(LINE, np.array([0.5, 0.5]), np.eye(2) * 4 / 0.02**2)  # J = 2, the box's width, for all θ
    assert row.fisher == pytest.approx(exact, rel=1e-6)


# ------------------------------------------------------------------------------------------------------ a whole study


NEXT = """
[next]
truths = { D1 = [3, 10, 30] }
runs = 8
draws = 40
[[next.experiments]]
name = "deeper"
depth = 8
noise = { Fz = "0.4 mN", gain = "0.2 %" }
[[next.experiments]]
name = "softly"
noise = { Fz = "50 mN", gain = "20 %" }
"""


def study(folder, table=NEXT):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "top.csv").write_text(curve("neo", 4e-4, 0))
    (folder / "study.toml").write_text(STUDY + table)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """`rso next` on a closed form where the force is μ(1 − …): depth tells nothing of D1, as its shape has no D1."""
    path = study(tmp_path_factory.mktemp("next"))
    plan = make_plan(load_study(path))
    with RunStore(path.parent / "results") as store:
        further = run_next(plan, store, Inline())
    return further, design_data(plan, further, "test"), path


def test_every_experiment_and_pair_is_asked_at_every_truth(found):
    _, data, _ = found
    added = [tuple(r["added"]) for r in data["told"]]
    assert set(added) == {(), ("top once more",), ("deeper",), ("softly",), ("deeper", "softly")}
    assert [t["D1"] for t in data["truths"]] == pytest.approx([3, 10, 30])
    assert all(len(r["at"]) == 3 for r in data["told"])


def test_the_others_follow_the_data_along_the_valley(found):
    """Every truth gives the measured force: μ makes up for D1."""
    further, *_ = found
    misfit = further.joint[-1].determination.misfit
    assert np.ptp(misfit.chi2(further.truths)) < 1.0


def test_nothing_is_asked_of_values_that_the_data_exclude(tmp_path):
    """With D1 fixed the curve determines mu: what is expected is expected of this specimen, with no warning on it."""
    path = study(tmp_path, "[next]\nruns = 8\ndraws = 10\n")
    path.write_text(re.sub(r"(?m)^D1 = .*$", "D1 = { value = 10.0 }", path.read_text()))
    plan = make_plan(load_study(path))
    with RunStore(tmp_path / "results") as store:
        further = run_next(plan, store, Inline())
    known = further.joint[-1].determination.of("mu").profile_interval
    assert known.high - known.low < 0.2  # of the range
    assert np.all(further.rise < stats.chi2(1).ppf(0.9)) and design_warnings(further) == []


def test_what_does_not_see_a_parameter_does_not_promise_it(found):
    """In this backend the shape knows nothing of D1: the sets all leave it undetermined, and it is said."""
    _, data, _ = found
    assert all(at["expected"]["D1"] > DETERMINED_SD_LN for r in data["told"] for at in r["at"])
    assert any("would determine" in w and w.startswith("Nothing") for w in data["words"])


def test_the_existing_data_are_fitted_and_shown(found):
    _, data, _ = found
    assert [f["experiments"] for f in data["fits"]] == [["top"]]
    assert {p["name"] for p in data["fits"][0]["parameters"]} == {"mu", "D1"}


def test_what_is_expected_is_said_truth_by_truth_with_units(found):
    _, data, _ = found
    assert by_truth(["1", "3", "10"], [0.6, 0.601, 0.1], "1/MPa") == (
        "a factor of 1.8 if it is 1 or 3 1/MPa, to ±10 % if it is 10 1/MPa"
    )
    assert "D1 would be known to a factor of " in data["words"][1] and " if it is " in data["words"][1]
    texts = [b.text for s in report(data).sections for b in s.blocks if hasattr(b, "text")]
    truths = next(t for t in texts if t.startswith("Truths: "))
    assert truths.count("Pa") == 6  # of both parameters, three times
    fits = next(b for s in report(data).sections for b in s.blocks if getattr(b, "title", "") == "Fits")
    values = {row[1].text: row[2].text for row in fits.rows}
    assert values["D₁"] == "–"


def test_the_german_page_has_a_template_for_every_sentence_of_a_design(found, tmp_path):
    missing = []
    (page,) = render_next(found[1], tmp_path, pdf=False, language="de", untranslated=missing)
    assert page.name == "next.de.html"
    assert not missing, "\n".join(missing)


def test_cubics_that_are_asked_together_say_what_each_says():
    """Of x³ and 2 − x a cubic Hermite spline is exact; outputs beside each other are not mixed up."""
    x = np.linspace(0.0, 1.0, 4)
    cubics = [
        Cubic(CubicHermiteSpline(x, x**3, 3 * x**2), 0.0, 1.0),
        Cubic(CubicHermiteSpline(x, 2 - x, np.full(4, -1.0)), 0.0, 2.0),
    ]
    at = np.array([[0.1], [0.55], [0.9]])
    assert multi_output(cubics).mean(at) == pytest.approx(np.hstack([at**3, 2 - at]), abs=1e-14)


def test_page_and_command(found, tmp_path, capsys):
    _, data, path = found
    files = render_next(data, tmp_path)
    assert [f.name for f in files] == ["next.html", "next.pdf", "next.svg"]
    assert "deeper" in files[0].read_text() and files[1].read_bytes().startswith(b"%PDF")
    assert render_next(data, tmp_path / "again")[0].read_bytes() == files[0].read_bytes()
    assert main(["next", str(path), "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    assert "best next experiment" in said and "one standard deviation" in " ".join(said.split())
    written = json.loads((path.parent / "results" / "next.json").read_text())
    written["provenance"], data["provenance"] = None, None
    written["timings"], data["timings"] = None, None
    for row in [*written["experiments"], *data["experiments"]]:
        row.pop("cpu_s")
    assert written == data


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("[next]\ntruths = { C9 = [1] }", "not searched for"),
        ("[next]\ntruths = { D1 = [1000] }", "values from 2 to 40"),
        ("[next]\ntruths = { D1 = [3], mu = [1] }", "one parameter at a time"),
        ('[next]\nexperiments = [{ name = "a", noise = { gain = 0.1 } }, { name = "a" }]', "there twice"),
        ('[next]\nexperiments = [{ name = "top", noise = { gain = 0.1 } }]', "taken by an experiment"),
        ('[next]\nexperiments = [{ name = "a" }]', "without errors"),
        ('[next]\nexperiments = [{ name = "a", channels = ["Fw"], noise = { gain = 0.1 } }]', "no such channel"),
        ('[next]\nexperiments = [{ name = "a", settings = { law = "x" }, noise = { gain = 0.1 } }]', "law"),
        ('[next]\nexperiments = [{ name = "a", marks = [[0, 5]], noise = { uz = 0.1 } }]', "marks and depths"),
        ('[next]\nexperiments = [{ name = "a", depht = 3 }]', "unknown key"),
    ],
)
def test_what_is_wrong_with_the_table_is_said_with_its_place(tmp_path, table, message):
    with pytest.raises(StudyError, match=r"study\.toml:\d+: next") as caught:
        path = study(tmp_path, "\n" + table + "\n")
        plan = make_plan(load_study(path))
        with RunStore(tmp_path / "results") as store:
            run_next(plan, store, Inline())
    assert message in str(caught.value)


def test_a_measured_profile_and_the_force_are_fitted_together(tmp_path, monkeypatch):
    """Alone neither is as good as both: the force knows μ for every D1, the surface of this body D1 for every μ."""
    monkeypatch.setattr(studies.indentation_backend, "MARKED", studies.Marked(), raising=False)
    rng, c = np.random.default_rng(6), studies.MU * studies.D1
    u = np.linspace(0.05, 2.0, 40)
    F = studies.indentation_backend.force(studies.MU, studies.D1, u, studies.THICKNESS)
    F = F + 2e-4 * rng.standard_normal(len(u))
    rows = [(h, x) for h in (1.0, 2.0) for x in (-6.0, -3.0, 0.0, 3.0, 6.0)]
    uz = [studies.displacement(h, x, 2.0, c) + 0.01 * rng.standard_normal() for h, x in rows]
    top = ["depth_mm,Fz_N", *(f"{a},{b}" for a, b in zip(u, F, strict=True))]
    marks = ["depth_mm,x_mm,y_mm,uz_mm", *(f"{h},{x},2,{v}" for (h, x), v in zip(rows, uz, strict=True))]
    (tmp_path / "top.csv").write_text("\n".join(top))
    (tmp_path / "p.csv").write_text("\n".join(marks))
    (tmp_path / "study.toml").write_text(PROFILE)
    plan = make_plan(load_study(tmp_path / "study.toml"))
    with RunStore(tmp_path / "results") as store:
        further = run_next(plan, store, Inline())
    sd = {j.names: j.determination.of("D1").sd_log for j in further.joint}
    assert sd["top", "surface"] < 0.8 * min(sd[("top",)], sd[("surface",)])
    whole = further.joint[-1].determination
    for name, true in (("mu", studies.MU), ("D1", studies.D1)):
        known = whole.of(name)
        assert abs(np.log(known.value / true)) < 3 * known.sd_log
    assert whole.p_value is None or whole.p_value > 1e-3


PROFILE = """
[study]
title = "Together"
seed = 1
[backend]
use = "indentation_backend:MARKED"
settings = { thickness = 8.0 }
[parameters]
mu = { low = "6 kPa", high = "20 kPa", scale = "log" }
D1 = { low = 10, high = 150, scale = "log" }
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = { Fz = "0.2 mN", gain = "1 %" }
[[experiments]]
name = "surface"
role = "fit"
kind = "profile"
data = "p.csv"
noise = { uz = "0.01 mm" }
[next]
truths = { D1 = [60] }
runs = 12
draws = 10
"""


def test_a_cubic_through_values_and_slopes_says_how_good_it_is():
    """An exponential on eight points: what is stated holds, and halving the step makes it 16 times smaller."""
    output, errors = Output("top", "Fz", 1.0, "N"), []
    for n in (8, 15):
        x = np.linspace(0, 1, n)
        theta = np.exp(x * np.log(100.0))
        samples = [
            Sample({"D1": t}, {output.id: np.exp(-v)}, {}, {output.id: {"D1": -np.exp(-v) / (t * np.log(100.0))}})
            for v, t in zip(x, theta, strict=True)
        ]
        cubic = along_one(Box(("D1",), ("1",), (1.0,), (100.0,), (True,)), [output], samples)[output.id]
        fine = np.linspace(0, 1, 501)[:, None]
        y, sd = cubic.predict(fine)
        errors.append(np.abs(y - np.exp(-fine[:, 0])).max())
        assert errors[-1] < 3 * sd[0]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    bare = [Sample(s.values, s.outputs) for s in samples]
    assert along_one(Box(("D1",), ("1",), (1.0,), (100.0,), (True,)), [output], bare) is None


def test_data_of_the_ladder_backend_are_what_the_climb_sees(tmp_path):
    """One model behind both commands: the fit of `rso next` is the ladder's of the level that the study states."""
    path = study(tmp_path)
    plan = make_plan(load_study(path))
    with RunStore(tmp_path / "results") as store:
        further = run_next(plan, store, Inline())
    _, data = climbed(tmp_path / "ladder", "neo", 4e-4, 'levels = ["study"]')
    mine = further.joint[-1].determination.of("mu").profile_interval
    low, high = next(p["interval"] for p in data["levels"][0]["parameters"] if p["name"] == "mu")
    box = further.axes.box
    ends = box.from_unit(np.array([[mine.low, 0.5], [mine.high, 0.5]]))[:, 0]
    np.testing.assert_allclose(ends, [low, high], rtol=0.02)
    # the valley's ends by the closed form, F ~ mu (6 + mu D1) / (6 + 4 mu D1), and 0.2 % of gain beyond
    grown = [
        brentq(lambda mu, D1=D1: mu * (6 + mu * D1) / (6 + 4 * mu * D1) - 0.01 * 6.08 / 6.32, 1e-3, 0.1)
        for D1 in (2.0, 40.0)
    ]
    np.testing.assert_allclose(ends, grown, rtol=0.01)


# ------------------------------------------------------------------------------- where the model does not have it all


def bent(folder, amplitude, sigma=2e-4):
    """The layer's force with a part (N) that it does not have, and what `rso next` makes of it."""
    depth, force = np.loadtxt(studies.measured(sigma).splitlines(), delimiter=",", skiprows=1).T
    folder.mkdir()
    force = force + amplitude * np.sin(6 * depth)
    (folder / "top.csv").write_text(
        "depth_mm,Fz_N\n" + "".join(f"{d!r},{f!r}\n" for d, f in zip(depth.tolist(), force.tolist(), strict=True))
    )
    top = studies.SECTIONS["[experiments]"].replace("0.02 mN", f"{1e3 * sigma} mN")
    table = 'truths = { D1 = [20, 60] }\nexperiments = [{ name = "deeper", depth = 3, noise = { Fz = "0.2 mN" } }]'
    plan = make_plan(load_study(studies.write(folder, experiments=top, next=f"runs = 10\ndraws = 10\n{table}")))
    with RunStore(folder / "results") as store:
        further = run_next(plan, store, Inline())
    return further, design_data(plan, further, "test")


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Where the model has it all."""
    return bent(tmp_path_factory.mktemp("bent") / "right", 0.0)


def test_what_the_model_lacks_it_lacks_in_the_next_experiment_too(straight, tmp_path):
    """With a misfit of s times the errors all that is expected is s times as wide; without one nothing is said."""
    (right, plain), (wrong, data) = straight, bent(tmp_path / "wrong", 1e-3)
    s = wrong.scale
    assert right.scale == 1.0 and s == wrong.joint[-1].determination.scale > 3.0
    for a, b in zip(right.learnt, wrong.learnt, strict=True):  # the same errors are stated of every experiment
        x = wrong.truths[1]
        sizes = (np.diag(e.experiment.covariance(x)) for e in (a, b))  # what goes together is read off the record
        np.testing.assert_allclose(*sizes, rtol=1e-6, atol=1e-12)
    known = wrong.joint[-1].determination.of("D1")
    told_ = {t.added: t.fisher["D1"] for t in wrong.told[1]}
    assert told_[()] == pytest.approx(known.sd_log, rel=0.3)  # D1 = 60 is near the fit; the range counts as known
    assert told_[("deeper",)] / next(t for t in right.told[1] if t.added == ("deeper",)).fisher["D1"] > 0.8 * s
    assert not any("misses" in w for w in plain["warnings"])
    warned = next(w for w in data["warnings"] if "misses" in w)
    assert f"by {s:.2g} times the stated errors" in warned and "has to be found" in warned
    texts = [b.text for section in report(data).sections for b in section.blocks if getattr(b, "role", "") == "warning"]
    assert warned in texts


def one_record(folder, length):
    """`rso next` of one record of 100 readings whose noise of 2 mN remembers along a length (mm); white without."""
    u = np.linspace(0.02, 2.0, 100)
    C = np.exp(-np.abs(np.subtract.outer(u, u)) / length) if length else np.eye(100)
    noise = 2e-3 * np.linalg.cholesky(C) @ np.random.default_rng(2).standard_normal(100)
    F = indentation_backend.force(studies.MU, studies.D1, u, studies.THICKNESS) + noise
    folder.mkdir()
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), F.tolist(), strict=True))
    (folder / "top.csv").write_text("depth_mm,Fz_N\n" + rows)
    top = studies.SECTIONS["[experiments]"].replace('Fz = "0.02 mN", ', "")
    plan = make_plan(
        load_study(studies.write(folder, experiments=top, next="truths = { D1 = [60] }\nruns = 10\ndraws = 10"))
    )
    with RunStore(folder / "results") as store:
        return run_next(plan, store, Inline())


def test_readings_of_one_record_that_remember_each_other_do_so_once_more(tmp_path, monkeypatch):
    """Against the same record taken for white; a record that is white, the control, is left as it is."""
    knows = one_record(tmp_path / "memory", 0.1)
    assert knows.learnt[0].item.blocks[0].data.memory > 0.6
    assert one_record(tmp_path / "white", 0.0).learnt[0].item.blocks[0].data.memory == 0.0
    monkeypatch.setattr("rso.next_experiment.study_design.autocorrelated", lambda have, seed: list(have))
    blind = one_record(tmp_path / "blind", 0.1)
    again = [next(t for t in v.told[0] if t.added == ("top once more",)).fisher["mu"] for v in (knows, blind)]
    mine = [v.joint[-1].determination.of("mu").sd_log for v in (knows, blind)]
    assert again[0] > 1.3 * again[1] and mine[0] > 1.3 * mine[1]


def test_truths_that_the_data_exclude_are_said_to_be(straight):
    """D1 = 20 where 60 is true and well known; the rise is that of the misfit there."""
    further, data = straight
    d = further.joint[-1].determination
    np.testing.assert_allclose(further.rise, d.misfit.chi2(further.truths) - d.fit.chi2)
    assert further.rise[0] > 20 and further.rise[1] < 6
    against = [w for w in data["warnings"] if "speak against" in w]
    assert len(against) == 1 and "D1 = 20 1/MPa: χ² is " in against[0]
    at_end = np.array([[0.0, 0.1]]) if further.weakest else np.array([[0.1, 0.0]])
    bound = design_warnings(dataclasses.replace(further, truths=at_end, rise=np.array([50.0])))
    assert "with mu at the end of its range" in bound[0]
