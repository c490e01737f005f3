"""Many specimens in one study: what is each one's own, what all share, what they are together, and what is refused."""

import json

import numpy as np
import pytest

import rso
from rso.cli import main
from rso.evaluation.store import RunStore
from rso.inference.random_effects import likelihood_of_profile
from rso.population.plans import specimen_plans
from rso.population.summary import CALIBRATION, _moves_alike, _without, folder_of, population_words
from rso.report import render_specimens
from rso.report.language.catalogue import sentences_of
from rso.result_types import RESULT_FILES
from rso.study.errors import StudyError
from rso.study.specimens import load_specimens

CALLS = []


@rso.model(parameters={"k": (0.1, 100.0, "MPa"), "n": (1.0, 3.0)})
def spring(travel, settings, k, n):
    CALLS.append((k, n, settings["area"]))
    if k > 90.0:
        raise rso.SimulationFailed("step_limit", "too stiff")
    return settings["area"] * k * travel**n


STUDY = """{specimens}
[study]
title = "Springs"
seed = 3
[backend]
use = "nowhere:spring"
[backend.settings]
area = 2.0
[parameters]
k = {{ low = 0.5, high = 20.0, scale = "log" }}
n = {{ value = 1.5 }}
[[experiments]]
name = "press"
role = "fit"
data = "{{name}}.csv"
noise = {{ Fz = "0.02 N", contact = "0 mm", gain = 0, correlation = "0 mm" }}
{more}
[doe]
runs = 6
held_out = 1
[surrogate]
kind = "polynomial"
[sensitivity]
sobol = false
local = false
[search]
repair = false
population = 8
generations = 3
candidates = 1
[report]
html = false
pdf = false
"""
TRUTH = {"a": (2.0, 3.0), "b": (2.0, 3.3), "c": (4.0, 2.8)}  # area, k


def measured(folder, name, area, k, deepest=2.0, seed=0):
    u = np.linspace(deepest / 16, deepest, 16)
    force = area * k * u**1.5 + np.random.default_rng(seed).normal(0, 0.02, 16)
    rows = [f"{x:.5f},{f:.6f}" for x, f in zip(u, force, strict=True)]
    (folder / f"{name}.csv").write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n")


@pytest.fixture
def springs(tmp_path):
    """A study of three specimens of two geometries, pressed about as deep."""
    for n, (name, (area, k)) in enumerate(TRUTH.items()):
        measured(tmp_path, name, area, k, 2.0 - 0.1 * n, n)
    write(tmp_path, "name,settings.area\na,\nb,2\nc,4.0\n")
    return tmp_path


def write(folder, table, more="", specimens='specimens = "table.csv"'):
    (folder / "table.csv").write_text(table)
    (folder / "study.toml").write_text(STUDY.format(specimens=specimens, more=more))


def problems(folder):
    with pytest.raises(StudyError) as caught:
        rso.specimens(folder, backend=spring)
    return caught.value.problems


def test_specimens_are_fitted_and_summarised(springs):
    """Values are near the truth, a second specimen of one geometry has no design of its own, results are as typed."""
    CALLS.clear()
    study = rso.specimens(springs, backend=spring)
    found = study.run()
    table = found.specimens.set_index("specimen")
    k = table[table["parameter"] == "k"]
    for name, (_, truth) in TRUTH.items():
        half = (k.loc[name, "high"] - k.loc[name, "low"]) / 2
        assert abs(k.loc[name, "value"] - truth) < 2 * half < 0.1  # twice that of a 90 % interval: one in a thousand
        assert k.loc[name, "bounded"] == "both" and k.loc[name, "verdict"] == "determined"
    new = {s["name"]: s["new_runs"] for s in found.data["specimens"]}
    assert new["b"] <= 2 < new["a"] and new["c"] > 2  # the candidate and the most likely point of b itself
    assert len(CALLS) == found.data["counts"]["runs"] == sum(new.values())
    assert found.exit_code == 0 and found.population.loc["k", "both_sides"] == 3
    mean = found.population.loc["k"]
    assert mean["interval low"] < np.exp(np.mean(np.log([3.0, 3.3, 2.8]))) < mean["interval high"]
    text = (springs / "results" / "specimens.json").read_text()
    RESULT_FILES["specimens.json"].model_validate_json(text)
    assert (springs / "results" / "specimens.csv").read_text().startswith("specimen,state,settings.area,k [MPa],")

    CALLS.clear()
    said = []
    again = study.run(progress=said.append)
    assert not CALLS and sum("finished before" in line for line in said) == 3
    drop = ("provenance",)
    assert {k: v for k, v in again.data.items() if k not in drop} == {
        k: v for k, v in found.data.items() if k not in drop
    }
    assert study.study("b").result.parameters.loc["k", "value"] == pytest.approx(k.loc["b", "value"])

    measured(springs, "d", 2.0, 2.9, 1.95, 9)  # a further row: the others stay as they are
    write(springs, "name,settings.area\na,\nb,2\nc,4.0\nd,2.0\n")
    kept = (folder_of(springs / "results", "a") / "results.json").read_bytes()
    more = rso.specimens(springs, backend=spring).run()
    assert more.data["counts"]["done"] == 4 and len(CALLS) <= 2
    assert (folder_of(springs / "results", "a") / "results.json").read_bytes() == kept


def test_one_calibration_of_all_specimens_is_not_averaged_out(springs):
    """5 % of all forces are 5 % of all k: ± 1.645 of that at least, and the specimens scatter as they do without."""
    free = rso.specimens(springs, backend=spring).run().data["population"][0]
    text = (springs / "study.toml").read_text()
    (springs / "study.toml").write_text(text.replace("gain = 0,", 'gain = 0, calibration = "5 %",'))
    found = rso.specimens(springs, backend=spring).run().data
    both = found["population"][0]
    assert both["shared"] == pytest.approx(0.05, rel=0.03) and free["shared"] == 0.0
    half, own = (0.5 * np.log(p["interval"][1] / p["interval"][0]) for p in (both, free))
    assert half == pytest.approx(np.hypot(own, 1.645 * 0.05), rel=0.03)
    assert both["tau"] == pytest.approx(free["tau"], rel=0.1)
    assert "share" in both["words"] and not any("no interval" in w for w in found["warnings"])
    render_specimens(found, springs, pdf=False, language="de", untranslated=(missing := []))
    assert missing == ["area"]


@pytest.mark.parametrize(
    ("outliers", "refuted", "without", "said"),
    [
        ([], [], None, ""),
        (["b"], [], (3.0, 2.0, 4.0), "Specimen b lies far from the others. Without it the median is 3 N (2 to 4)."),
        (["b"], ["b"], (3.0, 2.0, 4.0), "Specimen b lies far from the others. Without it the median is 3 N (2 to 4)."),
        (["b", "c"], [], None, "Specimens b, c lie far from the others. Without them too few are left."),
        ([], ["a"], (3.0, 2.0, 4.0), "The model misses the data of a. Without it the median is 3 N (2 to 4)."),
        (
            ["b"], ["a"], (3.0, None, None),
            "Specimen b lies far from the others. The model misses the data of a. Without them too few are left.",
        ),
    ],
)  # fmt: skip
def test_what_is_said_of_specimens_that_may_not_belong(outliers, refuted, without, said):
    block = {
        "parameter": "k", "unit": "N", "scale": "log", "mean": 5.0, "interval": (4.0, 6.0), "tau": 0.1,
        "tau_interval": (0.05, 0.3), "q_p_value": 0.001, "prediction": (3.0, 7.0), "both_sides": 6,
        "shared": 0.0, "outliers": outliers, "refuted": refuted, "without_doubtful": without or (None, None, None),
    }  # fmt: skip
    words = population_words(block)
    assert words.endswith(said or "between 3 and 7 N.") and (bool(said) or "ithout" not in words)
    german = sentences_of("de", frozenset({"k"}))
    german.text(words)
    assert not german.missing


def test_the_mean_without_some_is_that_of_the_others():
    def known(m):
        at = np.linspace(m - 1, m + 1, 41)
        return likelihood_of_profile(at, 100 * (at - m) ** 2, (m - 0.16, m + 0.16), (False, False), 0.9)

    ones = {"a": known(0.0), "b": known(0.1), "c": known(2.0)}
    of_two = _without({n: ones[n] for n in "abc"}, {"c"}, False, 0.0)
    assert of_two[0] == pytest.approx(0.05, abs=0.01) and of_two[1] < 0.05 < of_two[2]
    assert _without(ones, (), False, 0.0) == (None, None, None)
    assert _without(ones, {"a", "b", "c"}, False, 0.0) == (None, None, None)


@pytest.mark.verification
@pytest.mark.parametrize("spoil", ["outlier", "refuted", "none"])
def test_the_answer_names_specimens_that_may_not_belong_and_says_the_mean_without_them(springs, spoil):
    """One of six is thrice as stiff, or its record breaks off; the words alone, as `rso status` prints them, say so."""
    truth = np.random.default_rng(5).normal(3.0, 0.15, 6)
    for n, k in enumerate(truth):
        measured(springs, f"s{n}", 2.0, 3.0 * k if spoil == "outlier" and n == 5 else k, 2.0, n)
    if spoil == "refuted":
        rows = [r.split(",") for r in (springs / "s5.csv").read_text().splitlines()]
        broken = [[u, f if k < 9 else "0.01"] for k, (u, f) in enumerate(rows)]
        (springs / "s5.csv").write_text("\n".join(map(",".join, broken)) + "\n")
    write(springs, "name\n" + "\n".join(f"s{n}" for n in range(6)) + "\n")
    found = rso.specimens(springs, backend=spring).run()
    block, said = found.data["population"][0], " ".join(found.words)
    RESULT_FILES["specimens.json"].model_validate_json((springs / "results" / "specimens.json").read_text())
    assert ("s5" in said) == (spoil != "none")
    assert ("Without it the median" in said) == (spoil != "none")
    if spoil == "none":
        assert block["without_doubtful"] == [None, None, None] and not block["refuted"]
        return
    _, low, high = block["without_doubtful"]
    assert low < np.exp(np.mean(np.log(truth[:5]))) < high
    assert spoil == "refuted" or high - low < block["interval"][1] - block["interval"][0]
    assert block["refuted"] == (["s5"] if spoil == "refuted" else [])
    missing = []
    render_specimens(found.data, springs, pdf=False, language="de", untranslated=missing)
    assert not [w for w in missing if "s5" in w or "ithout" in w]


def test_results_that_do_not_keep_the_calibration_say_nothing_of_it():
    """Those of an older program: they neither count as unmoved nor as known."""
    kept = {"values": {"k": 3.0}, "inputs": [], "calibration": {"moves": {"k": -0.03}, "share": {"k": 0.4}}}
    old = {k: v for k, v in kept.items() if k != "calibration"}
    none = {**kept, "calibration": None}
    moves, share = _moves_alike(kept, "k", (CALIBRATION,), True)
    assert moves[CALIBRATION] == pytest.approx(np.log(0.97)) and share == 0.4
    assert _moves_alike(old, "k", (CALIBRATION,), True) == ({}, 0.0)
    assert _moves_alike(none, "k", (CALIBRATION,), True) == ({CALIBRATION: 0.0}, 0.0)


def test_specimens_that_agree_too_well_have_no_scatter_in_words():
    block = {
        "parameter": "k", "unit": "N", "scale": "log", "mean": 5.0, "interval": (4.0, 6.0), "tau": 1e-4,
        "tau_interval": (None, None), "q_p_value": 0.999, "prediction": (3.0, 7.0), "both_sides": 6,
        "shared": 0.03, "outliers": [], "refuted": [], "without_doubtful": (None, None, None),
    }  # fmt: skip
    words = population_words(block)
    assert "no larger than their errors." in words and "±3 %, one standard deviation" in words


def test_the_german_summary_has_a_template_for_every_sentence(springs):
    """With an outlier, one without an answer and an interval that is open on one side."""
    write(springs, "name,settings.area,parameters.k.low,parameters.k.high\na,,,\nb,,91,99\nc,4,,\n")
    data, missing = rso.specimens(springs, backend=spring).run().data, []
    (page,) = render_specimens(data, springs, pdf=False, language="de", untranslated=missing)
    assert page.name == "specimens.de.html"
    assert missing == ["area"]  # a setting of this backend alone


def test_one_without_an_answer_stops_no_other(springs):
    """Its reason is in the summary, exit code 3, and the mean is of the others."""
    write(springs, "name,settings.area,parameters.k.low,parameters.k.high\na,,,\nb,,91,99\nc,4,,\n")
    found = rso.specimens(springs, backend=spring).run()
    states = {s["name"]: s["state"] for s in found.data["specimens"]}
    assert states == {"a": "done", "b": "stopped", "c": "done"}
    assert found.exit_code == 3 and "too stiff" in found.data["exit_reason"]
    assert found.population.loc["k", "both_sides"] == 2
    assert any("b" in w and "too stiff" in w for w in found.warnings)


def test_what_is_the_specimens_own(springs):
    """Settings merge key by key, units are converted, empty cells leave what the study says, a test may be absent."""
    more = """[[experiments]]
name = "again"
role = "select"
data = "a.csv"
settings = { area = 7.0 }
"""
    table = (
        "name;data.press;data.again;experiments.press.noise.Fz [mN];parameters.k.high [kPa];"
        "settings.plate.size [cm];note\n"
        "one;a.csv; b.csv ;5;;2,5;first\n"
        "two;b.csv;;;30000;;\n"
    )
    write(springs, table, more)
    one, two = load_specimens(springs).studies
    assert one.settings_of("press") == {"area": 2.0, "plate": {"size": 25.0}}
    assert one.experiment("again").data == ("b.csv",) and [e.name for e in two.experiments] == ["press"]
    assert one.experiment("press").noise.Fz == pytest.approx(0.005)
    assert two.parameters["k"].high == "30000 kPa" and one.parameters["k"].high == 20.0
    assert (one.study.title, one.specimen) == ("Springs: one", "one")
    assert load_specimens(springs).notes == {"one": "first", "two": ""}


def test_tables_of_the_file_say_the_same_as_a_table(springs):
    tables = """[[specimens]]
name = "a"
[[specimens]]
name = "b"
settings.area = 2
[[specimens]]
name = "c"
settings.area = 4.0
"""
    by_table = load_specimens(springs).studies
    (springs / "study.toml").write_text(STUDY.format(specimens="", more="") + tables)
    by_file = load_specimens(springs).studies
    assert [s.sha256 for s in by_file] == [s.sha256 for s in by_table]
    assert [s.settings_of("press") for s in by_file] == [s.settings_of("press") for s in by_table]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("name,settings.area\na,1\na,2\n", ["table.csv:3", "'a'", "taken"]),
        ("name,settings.area\na,1\nA,2\n", ["table.csv:3", "looks like 'a'"]),
        ("name,seting.area\na,1\n", ["table.csv:1", "seting.area", "settings"]),
        ("name,area\na,1\n", ["table.csv:1", "'area'", "such as settings.specimen.thickness"]),
        ("name,settings.area\n,1\n", ["table.csv:2", "column 'name'", "is missing"]),
        ("settings.area\n1\n", ["table.csv:1", "no column 'name'"]),
        ("name,settings.area [mn]\na,x\n", ["table.csv:2", "settings.area [mn]", "'x'", "a number in mn"]),
        ("name,settings.area\na,1,2\n", ["table.csv:2", "3 cells"]),
        ('name,settings.area\na,"1,234"\n', ["table.csv:2", "comma"]),
        ("name,data.pres\na,a.csv\n", ["table.csv:2", "data.pres", "did you mean 'press'"]),
        ("name,data.press\na,q.csv\n", ["table.csv:2", "column 'data.press'", "q.csv", "there is no such file"]),
        ("name,parameters.kk.low\na,1\n", ["table.csv:2", "parameters.kk.low", "choose from k, n"]),
        ("name,parameters.k.low\na,50\n", ["study.toml", "low = 50 must be below high = 20", "specimen a"]),
        ("name,experiments.press.noise.Fz [mm]\na,1\n", ["table.csv:2", "experiments.press.noise.Fz", "mm"]),
        ("name\n.x\n", ["table.csv:2", "expected is a name"]),
        ("name,settings.area\n", ["table.csv", "0 rows"]),
    ],
)
def test_bad_tables_are_refused_with_file_row_and_column(springs, table, said):
    write(springs, table)
    text = "\n".join(problems(springs))
    assert all(part in text for part in said), text


@pytest.mark.parametrize(
    ("head", "cell", "said"),
    [
        ("thickness", "five", "'five'"),
        ("thickness", "-5", "must be positive"),
        ("thicknes", "5", "did you mean 'thickness'"),
    ],
)
def test_what_the_backend_refuses_of_a_row_is_said_of_its_cell(springs, head, cell, said):
    """The line of the study file holds another value, which is right."""
    write(springs, f"name,settings.specimen.{head}\na,6.0\nb,{cell}\n")
    text = (springs / "study.toml").read_text().replace("area = 2.0", 'specimen = { shape = "slab", thickness = 8.0 }')
    text = text.replace("nowhere:spring", "fem_backend.backend:BACKEND")
    text = text.replace("k = { low = 0.5, high = 20.0", "mu = { low = 0.005, high = 0.02")
    (springs / "study.toml").write_text(text.replace("n = { value = 1.5 }", "D1 = { value = 5.8 }"))
    with pytest.raises(StudyError) as caught:
        rso.specimens(springs)
    wrong = next(line for line in caught.value.problems if "specimen b" in line or head == "thicknes")
    place = f"table.csv:{2 if head == 'thicknes' else 3}: column 'settings.specimen.{head}'"
    assert place in wrong and said in wrong, wrong


@pytest.mark.parametrize(
    ("head", "cell", "said"),
    [
        ("settings.specimen.thickness [kPa]", "6000", "'kPa' is no unit of it: specimen.thickness is in mm"),
        ("settings.indenter.radius [s]", "3", "'s' is no unit of it: indenter.radius is in mm"),
        ("settings.specimen.thickness [%]", "600", "'%' is no unit of it: specimen.thickness is in mm"),
        ("settings.support.friction [mm]", "0.2", "'mm' is no unit of it: support.friction is a pure number"),
        ("experiments.press.settings.speed [kPa]", "6", "'kPa' is no unit of it: speed is in mm/s"),
        ("settings.specimen.thickness [um]", "6000", ""),
        ("settings.support.friction [%]", "20", ""),
    ],
)
def test_a_setting_in_a_unit_of_another_kind_is_refused(springs, head, cell, said):
    """A number with a unit was one of whatever that is a unit of: 6000 kPa a thickness of 6 mm."""
    write(springs, f"name,{head}\na,{cell}\n")
    text = (springs / "study.toml").read_text()
    body = 'specimen = { shape = "slab", thickness = 8.0 }\nindenter = { shape = "sphere", radius = 3.0 }\n'
    text = text.replace(
        "area = 2.0", f'{body}support = {{ kind = "well", radius = 9.0, base = "slip", wall = "slip" }}'
    )
    text = text.replace("nowhere:spring", "fem_backend.backend:BACKEND")
    text = text.replace("k = { low = 0.5, high = 20.0", "mu = { low = 0.005, high = 0.02")
    (springs / "study.toml").write_text(text.replace("n = { value = 1.5 }", "D1 = { value = 5.8 }"))
    if not said:
        assert rso.specimens(springs)
        return
    with pytest.raises(StudyError) as caught:
        rso.specimens(springs)
    assert f"table.csv:2: column {head!r}" in str(caught.value) and said in str(caught.value)


def test_a_check_says_whose_sizes_are_uncertain_and_which_count_as_exact(springs, capsys):
    write(
        springs, "name,experiments.press.uncertainty.delta_thickness [um],settings.specimen.thickness\na,60,6\nb,,5\n"
    )
    text = (springs / "study.toml").read_text()
    body = 'specimen = { shape = "slab", thickness = 8.0 }\nindenter = { shape = "sphere", radius = 3.0 }'
    text = text.replace("area = 2.0", body + '\nsupport = { kind = "bonded" }')
    text = text.replace("nowhere:spring", "fem_backend.backend:BACKEND")
    text = text.replace("k = { low = 0.5, high = 20.0", "mu = { low = 0.005, high = 0.02")
    (springs / "study.toml").write_text(text.replace("n = { value = 1.5 }", "D1 = { value = 5.8 }"))
    assert main(["check", str(springs / "study.toml")]) == 0
    said = capsys.readouterr().out
    assert "delta_thickness: ±60 µm of 6 mm, error of the thickness of the slab (a)" in said
    exact = [line for line in said.splitlines() if "taken as exact" in line]
    assert [
        line.endswith(end) for line, end in zip(exact, ("delta_R (a)", "delta_thickness, delta_R (b)"), strict=True)
    ]


def test_all_problems_of_all_rows_at_once(springs):
    """Each row has its own; what is wrong with the study itself is said once."""
    write(springs, "name,data.press,settings.area\na,x.csv,1\nb,y.csv,2\nc,c.csv,3\n")
    text = (springs / "study.toml").read_text().replace("runs = 6", "runs = 0")
    (springs / "study.toml").write_text(text)
    said = problems(springs)
    assert sum("doe.runs" in line for line in said) == 1
    assert any("table.csv:2" in line and "x.csv" in line for line in said)
    assert any("table.csv:3" in line and "y.csv" in line for line in said)
    assert not any("table.csv:4" in line for line in said)


def test_a_setting_that_would_not_count_is_refused(springs):
    """An experiment with the same setting of its own would go on with that."""
    text = (springs / "study.toml").read_text().replace('role = "fit"', 'role = "fit"\nsettings = { area = 9.0 }')
    (springs / "study.toml").write_text(text)
    assert any("experiments.press.settings.area" in line for line in problems(springs))


def test_only_specimens_alike_share_travels(springs):
    """Of one geometry and pressed to at least 0.8 of the deepest; another geometry or depth has its own."""
    for n, (name, deepest) in enumerate({"a": 2.0, "b": 1.7, "c": 1.0, "d": 2.0}.items()):
        measured(springs, name, 2.0, 3.0, deepest, n)
    write(springs, "name,settings.area\na,2\nb,2\nc,2\nd,4\n")
    plans = specimen_plans(load_specimens(springs), spring)
    a, b, c, d = (p.cases[0].programme.asked_mm for p in plans)
    assert a == b and max(a) == pytest.approx(2.0) and max(c) == pytest.approx(1.0)
    assert d != c and max(d) == pytest.approx(2.0)
    assert all(g.value == pytest.approx(6.0 * g.depth_mm**1.5, abs=0.1) for g in plans[1].searches[0].goals)


def test_other_commands_ask_which(springs):
    with pytest.raises(StudyError, match="many specimens"):
        rso.load(springs)
    with pytest.raises(StudyError, match="choose from a, b, c"):
        rso.specimens(springs, backend=spring).study("x")


def test_runs_stay_when_a_run_is_interrupted(springs):
    """A specimen that was finished before an interruption is not run again, and its simulations serve the next one."""
    study = rso.specimens(springs, backend=spring)

    def stop(line):
        if line.startswith("specimen 2"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.run(progress=stop)
    with RunStore(springs / "results", read_only=True) as store:
        before = len(store.rows())
    CALLS.clear()
    said = []
    study.run(progress=said.append)
    assert "specimen 1 of 3, a: finished before" in said and before >= 3
    assert json.loads((springs / "results" / "specimens.json").read_text())["counts"]["done"] == 3
