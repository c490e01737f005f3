"""Tests that were not fitted, foretold by the most likely values: their uncertainty counts, and every channel does."""

import numpy as np
import pytest
import sample_studies as studies
import sideways_backend
from sideways_backend import force, sideways

from rso.report import render
from rso.report.calibration.predictions import prediction_fact, prediction_sentences
from rso.report.calibration.predictive_check import prediction_sentence
from rso.report.reading import experiment, experiments

NOISE = 0.003  # N
EXPERIMENTS = """name = "top"
role = "fit"
data = "top.csv"
noise = { Fz = "3 mN", gain = 0, contact = 0, correlation = 0 }
[[experiments]]
name = "deep"
role = "ROLE"
data = "deep.csv"
noise = { Fz = "3 mN", gain = 0, contact = 0, correlation = 0 }
"""
SIDE = """name = "top"
role = "fit"
data = "top.csv"
channels = ["Fz", "Fx"]
settings = { x = 20.0 }
noise = { Fz = "3 mN", Fx = "2 mN", gain = 0, contact = 0, correlation = 0 }
[[experiments]]
name = "side"
role = "ROLE"
data = "side.csv"
channels = ["Fz", "Fx"]
settings = { x = 30.0 }
noise = { Fz = "3 mN", Fx = "2 mN", gain = 0, contact = 0, correlation = 0 }
"""
DIRECT = {
    "backend": 'use = "sideways_backend:BACKEND"',
    "parameters": 'mu = { low = "3 kPa", high = "36 kPa", scale = "log" }\nD1 = { low = 1, high = 168, scale = "log" }',
    "search": 'method = "gauss_newton"\nderivatives = "differences"',
    **dict.fromkeys(("backend__settings", "doe", "surrogate", "sensitivity")),
}


def written(path, u, **channels):
    head = ",".join(["depth_mm", *(f"{c}_N" for c in channels)])
    rows = np.column_stack([u, *channels.values()])
    path.write_text("\n".join([head, *(",".join(f"{v!r}" for v in row) for row in rows.tolist())]) + "\n")


def deeper(
    folder,
    seed,
    c=0.0,
    role="validate",
    settings=None,
    stated='noise = { Fz = "3 mN", gain = 0, contact = 0, correlation = 0 }\n',
):
    """Fitted to 4 mm, kept to 8 mm, of a ball that stiffens by `c` per mm more than the model."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for name, deepest in (("top", 4.0), ("deep", 8.0)):
        u = np.linspace(0, deepest, 41)[1:]
        written(folder / f"{name}.csv", u, Fz=force(u, c=c) + NOISE * rng.standard_normal(40))
    more = {} if settings is None else {"backend__settings": settings}
    text = EXPERIMENTS.replace("ROLE", role).replace(
        'noise = { Fz = "3 mN", gain = 0, contact = 0, correlation = 0 }\n', stated
    )
    return studies.run(folder, experiments=text, **{**DIRECT, **more})


def sidewards(folder, factor, role="validate"):
    """A lateral force that is `factor` times the model's beside a vertical one that agrees."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, u = np.random.default_rng(1), np.linspace(0, 4, 41)[1:]
    for name, x, times in (("top", 20.0, 1.0), ("side", 30.0, factor)):
        Fx = times * sideways(u, x) + 0.002 * rng.standard_normal(40)
        written(folder / f"{name}.csv", u, Fz=force(u) + NOISE * rng.standard_normal(40), Fx=Fx)
    return studies.run(folder, experiments=SIDE.replace("ROLE", role), **DIRECT)


@pytest.fixture(scope="module")
def ten_true(tmp_path_factory):
    """Predictions of the true model from ten data sets."""
    folder = tmp_path_factory.mktemp("true")
    return [deeper(folder / str(s), s)["predictions"] for s in range(10)]


def test_a_true_model_predicts_what_it_did_not_see_and_a_wrong_one_does_not(ten_true, tmp_path):
    """The fitted values are uncertain by ten times the noise at 8 mm: without it most true ones are refused."""
    true = ten_true
    wrong = [deeper(tmp_path / f"wrong{s}", s, c=0.01)["predictions"] for s in range(3)]
    refused = sum(v["verdict"] == "no" for (v,) in true)
    # 1 in 20 at p < 0.05: more than 2 of 10 would come about once in 90 times.
    assert refused <= 2 and all(v["verdict"] == "no" for (v,) in wrong)
    assert sum(v["alone"] < 0.05 for (v,) in true) >= 6  # the parameters' share matters
    mean = np.mean([v["chi2"] for (v,) in true])
    assert mean == pytest.approx(40, abs=4 * np.sqrt(80 / 10))  # four standard errors of the mean of χ² of 40 readings


def test_the_spread_is_that_of_the_fitted_values(ten_true):
    """The parameters of 10 data sets scatter, and with them the curve at 8 mm, as much as is said of each."""
    found = [v["channels"][0] for (v,) in ten_true]
    scatter = np.std([c["predicted"][-1] for c in found], ddof=1)
    said = np.mean([c["spread"][-1] for c in found])
    assert 0.5 < scatter / said < 1.6  # χ of 9 degrees is within in 98 % of all
    assert all(c["spread"][-1] > 3 * NOISE for c in found)


def test_every_channel_counts_and_the_one_that_misses_is_named(tmp_path):
    good, bad = sidewards(tmp_path / "good", 1.0), sidewards(tmp_path / "bad", -3.0)
    (v,), (w,) = good["predictions"], bad["predictions"]
    assert v["verdict"] == "yes" and v["points"] == w["points"] == 80 and w["verdict"] == "no"
    assert [c["missed"] for c in v["channels"]] == [False, False]
    assert [(c["channel"], c["missed"]) for c in w["channels"]] == [("Fz", False), ("Fx", True)]
    assert [r["channel"] for r in bad["validation"]] == ["Fz", "Fx"] and good["exit_code"] == 0
    assert sum(r["purpose"] == "validate" for r in bad["runs"]) == 1
    (said,) = prediction_sentences(bad)
    assert said.startswith("No: side, which was not used") and "What misses is Fx." in said
    assert prediction_sentences(good)[0].startswith("Yes: side")
    assert [e["name"] for e in experiments(bad, "validate")] == ["side", "side Fx"]
    page = render(bad, tmp_path / "page", pdf=False)[0].read_text()
    assert "side Fx, which was not used for the fit" in page
    # Without an identification the candidate speaks, of either channel.
    lost = {**bad, "predictions": []}
    assert any(s.startswith("No: side Fx") for s in prediction_sentences(lost))
    assert prediction_fact(bad)[0].value == "not predicted"


def test_curves_of_every_channel_have_metrics(tmp_path):
    found = sidewards(tmp_path, -3.0, role="select")
    (c,) = found["searches"][0]["candidates"]
    assert set(c["metrics"]) == set(c["curves"]) == {"top", "top Fx", "side", "side Fx"} == set(found["baseline"])
    assert c["curves"]["side Fx"]["experiment"] == "side" and c["curves"]["side Fx"]["channel"] == "Fx"
    Fx = np.array(experiment(found, "side Fx")["measured"]["value"])
    off = 4 / 3 * np.sqrt(np.mean(Fx**2)) / abs(np.mean(Fx))  # |1 − (−3)| over 3
    assert c["metrics"]["side Fx"]["nrmse"] == pytest.approx(off, rel=0.02)
    assert c["metrics"]["top Fx"]["nrmse"] < 0.02
    assert experiment(found, "side Fx")["channel"] == "Fx" and experiment(found, "side")["channel"] == "Fz"


def test_a_curve_to_select_by_that_is_missed_is_said(tmp_path):
    stiff, true = (deeper(tmp_path / str(c), 1, c, role="select") for c in (0.03, 0.0))
    assert any("deep (role select, not fitted) is not predicted" in w for w in stiff["warnings"])
    assert not any("deep" in w for w in true["warnings"])
    assert "that is beyond its errors" in render(stiff, tmp_path / "a", pdf=False)[0].read_text()
    assert "that is beyond its errors" not in render(true, tmp_path / "b", pdf=False)[0].read_text()


def test_without_slopes_nothing_is_said_of_it(tmp_path):
    sideways_backend.BACKEND.first.clear()
    found = deeper(tmp_path, 1, settings="deaf = 5.0")
    (v,) = found["predictions"]
    assert v["verdict"] is None and "changes with mu" in v["why"] and "only the first" in v["why"]
    assert prediction_sentence(experiment(found, "deep"), v).startswith("Whether deep, which was not used for the fit")
    assert found["exit_code"] == 3  # runs failed


def test_what_would_help_begins_for_all_tests_with_what_is_known_now(tmp_path):
    """A model that misses a record of which nothing is stated: wider by the misfit and by Student's factor, as the
    readings may remember each other, in every row alike."""
    rows = deeper(tmp_path, 3, c=0.1, stated="")["identification"]["gains"]
    assert any(g["test"] == "deep, fitted too" for g in rows) and len(rows) >= 3
    for name in ("mu", "D1"):
        before = [g["before"][name] for g in rows]
        np.testing.assert_allclose(before, before[0], rtol=1e-6)  # one number, computed in two places
