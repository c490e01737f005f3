"""The same study by run, ladder, next and diagnose: one interval, one noise, one p."""

import json
import math
import shutil

import diagnosis_backend  # noqa: F401  the study's backend
import numpy as np
import pytest
import sample_studies as studies
import test_diagnosis_study as toy

WAYS = ("run", "ladder", "next", "diagnose")
KEPT = """[[experiments]]
name = "kept"
role = "validate"
data = "kept.csv"
noise = { Fz = "1 mN", gain = 0.01 }
"""
TABLES = """
[doe]
runs = 12
held_out = 2
[surrogate]
kind = "whole_curve"
[sensitivity]
sobol = false
local = false
[search]
targets = [{ experiment = "load", depth = 3 }]
candidates = 1
population = 8
generations = 4
repair = false
[ladder]
levels = [{ name = "study" }]
runs = 12
[next]
truths = { D1 = [60] }
runs = 12
draws = 10
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Plain data of the four ways, and of the diagnosis alone its whole file."""
    folder = tmp_path_factory.mktemp("one")
    text = toy.STUDY
    text = text[: text.index('[[experiments]]\nname = "cycle"')] + KEPT + text[text.index("[diagnose]") :] + TABLES
    path = toy.write(folder, text, soften=0.0)
    kept = toy.toy.recorded({**toy.toy.TRUTH, "soften": 0.0}, np.random.default_rng(7), repeats=3)
    rows = [f"{r.label},{u},{t},{F}" for r in kept for u, t, F in zip(r.depth, r.time, r.channels["Fz"], strict=True)]
    (folder / "kept.csv").write_text("\n".join(["repeat,depth_mm,time_s,Fz_N", *rows]))
    for way in WAYS:
        done = studies.command(way, path)
        assert done.returncode == 0, done.stderr
    read = {n: json.loads((folder / "results" / f"{n}.json").read_text()) for n in ("results", *WAYS[1:3], "diagnosis")}
    run, level, fit = read["results"]["identification"], read["ladder"]["levels"][0], read["next"]["fits"][-1]
    base = read["diagnosis"]["base_model"]
    shutil.rmtree(folder)
    return {
        "run": (of(run["parameters"], "parameter"), run["chi2"], run["p_value"], run["data"][0]["errors"]),
        "ladder": (
            of(level["parameters"], "name"),
            level["fitted"]["chi2"],
            level["fitted"]["p_analytic"],
            level["errors"][0]["parts"],
        ),
        "next": (of(fit["parameters"], "name"), fit["chi2"], fit["p_value"], fit["errors"]["load"]),
        "diagnose": (
            {k: (v["interval"], v["sd_log"]) for k, v in base["parameters"].items()},
            base["chi2"],
            base["p_value"],
            base["errors"]["load"],
        ),
    }, read


def of(rows, name):
    return {r[name]: (r["interval"], r["sd_log"]) for r in rows}


def apart(a, b):
    """Largest distance of the ends of interval a from those of b, in ln, over the width of b."""
    return max(abs(math.log(x / y)) for x, y in zip(a, b, strict=True)) / math.log(b[1] / b[0])


@pytest.mark.parametrize(("way", "share"), [("ladder", 0.01), ("next", 0.01), ("diagnose", 0.02)])
def test_every_way_has_the_interval_the_noise_and_the_p_of_a_run(found, way, share):
    """Ends within 1 % of the width; of a diagnosis, whose library interpolates along the axes of all effects, 2 %."""
    (intervals, chi2, p, errors), (wanted, chi2_run, p_run, errors_run) = found[0][way], found[0]["run"]
    for name, (interval, sd) in wanted.items():
        assert apart(intervals[name][0], interval) < share, name
        assert intervals[name][1] == pytest.approx(sd, rel=2 * share)
    assert chi2 == pytest.approx(chi2_run, rel=0.01) and p == pytest.approx(p_run, abs=0.01)
    assert errors["measurement"] == pytest.approx(errors_run["measurement"], rel=1e-6)
    assert errors["numerical"] == pytest.approx(errors_run["numerical"], rel=0.02)


def test_a_curve_that_took_no_part_is_judged_alike(found):
    """`run` and `ladder` by the same run and its slopes; `diagnose` bins readings and has noise of its own."""
    (run,), ladder = found[1]["results"]["predictions"], found[1]["ladder"]["levels"][0]["validated"]
    (gap,) = found[1]["diagnosis"]["diagnosis"]["shrinkage"]["curves"]
    assert [v["curve"] for v in ladder] == ["kept"] == [gap["curve"]]
    assert ladder[0]["chi2"] == pytest.approx(run["chi2"], rel=0.01)
    assert ladder[0]["p_value"] == pytest.approx(run["p_value"], abs=0.01) and ladder[0]["verdict"]["passes"]
    assert min(gap["p_values"]) > 0.05


def test_what_a_diagnosis_allows_for_besides_is_more(found):
    """The control: its own interval, which allows for another program, is another one, and words say why."""
    d = found[1]["diagnosis"]
    before, base = d["diagnosis"]["parameters"]["before"]["mu"], d["base_model"]["parameters"]["mu"]["interval"]
    assert apart((before["low"], before["high"]), base) > 0.05
    assert any("Fit of the base model alone, over the ranges of the study file" in w for w in d["words"])


def test_a_fit_that_agrees_beside_a_gap_says_how_both_can_be():
    """Two sentences of one page that contradict each other leave a reader with neither."""
    from rso.discrepancy.base_model import base_model_sentence

    fit = {"p_value": 0.9, "story": "The model agrees with the data within their errors.", "parameters": {}}
    assert "the gap above may be smaller" in base_model_sentence(fit, gap=True)[0]
    for other, gap in ((fit, False), ({**fit, "p_value": 1e-3}, True), ({**fit, "p_value": None}, True)):
        assert "the gap above" not in base_model_sentence(other, gap)[0]
