"""The same study by run, ladder, next and diagnose: one interval, one noise, one p."""

import json
import math
import shutil

import diagnosis_backend  # noqa: F401  the study's backend
import pytest
import sample_studies as studies
import test_diagnosis_study as toy

WAYS = ("run", "ladder", "next", "diagnose")
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
    text = text[: text.index('[[experiments]]\nname = "cycle"')] + text[text.index("[diagnose]") :] + TABLES
    path = toy.write(folder, text, soften=0.0)
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
    }, read["diagnosis"]


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


def test_what_a_diagnosis_allows_for_besides_is_more(found):
    """The control: its own interval, which allows for another program, is another one, and words say why."""
    d = found[1]
    before, base = d["diagnosis"]["parameters"]["before"]["mu"], d["base_model"]["parameters"]["mu"]["interval"]
    assert apart((before["low"], before["high"]), base) > 0.05
    assert any("Fit of the base model, as in rso run" in w for w in d["words"])
