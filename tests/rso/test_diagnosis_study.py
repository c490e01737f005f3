"""`rso diagnose` on a small study: exit code, strict JSON, nothing computed twice, broken studies named."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import diagnosis_backend as toy
import numpy as np
import pytest
import sample_studies as studies

from rso.calibration.plan import make_plan
from rso.discrepancy.study_diagnosis import _fitted, ask
from rso.study.errors import StudyError
from rso.study.loader import load_study

HERE = Path(__file__).parent
STUDY = """
[study]
title = "Toy"
seed = 3
[backend]
use = "diagnosis_backend:BACKEND"
[backend.settings]
log = "LOG"
[parameters]
mu = { low = "6 kPa", high = "24 kPa", scale = "log" }
D1 = { low = "15 1/MPa", high = "150 1/MPa", scale = "log" }
[[experiments]]
name = "load"
role = "fit"
data = "load.csv"
noise = { Fz = "1 mN", gain = 0.01 }
[[experiments]]
name = "cycle"
role = "fit"
data = "cycle.csv"
noise = { Fz = "1 mN", gain = 0.01 }
after = ["load"]
[diagnose]
effects = ["stiff", "soften"]
[dispatch]
jobs = 1
[report]
html = false
pdf = false
"""


def write(folder: Path, text: str = STUDY, soften: float = 0.3) -> Path:
    rng, truth = np.random.default_rng(0), {**toy.TRUTH, "soften": soften}
    folder.mkdir(parents=True, exist_ok=True)
    for name, k in (("load", {"repeats": 3}), ("cycle", {"unload": True, "earlier": 4.0})):
        lines = ["repeat,depth_mm,time_s,Fz_N"]
        for r in toy.recorded(truth, rng, **k):
            rows = zip(r.depth, r.time, r.channels["Fz"], strict=True)
            lines += [
                f"{r.label},{d!r},{t!r},{f!r}" for d, t, f in ((float(a), float(b), float(c)) for a, b, c in rows)
            ]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    path = folder / "study.toml"
    path.write_text(text.replace("LOG", str(folder / "log")), encoding="utf-8")
    return path


rso = studies.command


def process(*arguments: object) -> subprocess.CompletedProcess:
    """The same in a process of its own, with its worker."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "COLUMNS": "100", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "rso.cli", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)


FIXED_D1 = STUDY.replace('D1 = { low = "15 1/MPa", high = "150 1/MPa", scale = "log" }', 'D1 = { value = "40 1/MPa" }')
FIXED_MU = STUDY.replace('mu = { low = "6 kPa", high = "24 kPa", scale = "log" }', 'mu = { value = "11 kPa" }')


def test_what_a_calibration_knows_is_read_with_its_unit(tmp_path):
    """By [diagnose] known, and of the gain by the cell of the experiments; what is not understood is named."""
    known = 'effects = "all"\nknown = { compliance = "20 um/N", stiff = 0 }'
    text = STUDY.replace('effects = ["stiff", "soften"]', known)
    stated = text.replace("gain = 0.01 }", 'gain = 0.01, calibration = "0.5 %" }')
    found = {e.name: e.known for e in ask(load_study(write(tmp_path, stated))).effects}
    assert (found["compliance"], found["stiff"], found["gain"], found["offset"]) == (0.02, 0.0, 0.005, None)
    assert {e.name: e.known for e in ask(load_study(write(tmp_path, text))).effects}["gain"] is None
    for wrong, said in (("grip = 1", "no such effect"), ('gain = "2 mm"', "gain"), ("gain = -0.1", "at least 0")):
        with pytest.raises(StudyError, match=said) as error:
            ask(load_study(write(tmp_path, text.replace("stiff = 0", wrong))))
        assert "known" in str(error.value)


@pytest.mark.parametrize(
    ("text", "d1", "fitted"),
    [
        (STUDY, 40.0, {"mu": 0.011, "D1": 40.0}),
        (FIXED_D1, 40.0, {"mu": 0.011}),
        (FIXED_D1, 60.0, None),
        (FIXED_MU, 40.0, {"D1": 40.0}),
    ],
)
def test_what_a_run_fixed_must_be_fixed_alike_and_is_not_what_it_found(tmp_path, text, d1, fitted):
    """The open ones, in the order of the study whatever the hashes of strings."""
    asked = ask(load_study(write(tmp_path / "toy", text)))
    best = {"name": "search 1", "values": {"mu": 0.011, "D1": d1}}
    found = {"backend": {"settings": dict(asked.study.backend.settings)}}
    found["best"] = {"search": "s", "candidate": "search 1"}
    found["searches"] = [{"name": "s", "candidates": [best]}]
    (tmp_path / "results.json").write_text(json.dumps(found))
    own = _fitted(asked, tmp_path)
    assert own == fitted and list(own or ()) == list(fitted or ())


def test_a_speed_that_nobody_stated_is_said_to_be_assumed(tmp_path):
    """Sizes in seconds rest on it: files without times must say so, those with times or a stated speed must not."""
    timed = ask(load_study(write(tmp_path / "timed")))
    file = write(tmp_path / "bare")
    for name in ("load", "cycle"):
        table = [line.split(",") for line in (tmp_path / "bare" / f"{name}.csv").read_text().splitlines()]
        at = table[0].index("time_s")
        (tmp_path / "bare" / f"{name}.csv").write_text("\n".join(",".join(r[:at] + r[at + 1 :]) for r in table) + "\n")
    bare = ask(load_study(file))
    file.write_text(file.read_text().replace('name = "load"', 'name = "load"\nsettings = { speed = "12 mm/min" }'))
    half = ask(load_study(file))
    said = [[n for n in a.plan.notes if "assumed" in n] for a in (timed, bare, half)]
    assert said[0] == [] and len(said[1]) == len(said[2]) == 1
    assert "30 mm/min is assumed for load, cycle" in said[1][0] and "assumed for cycle," in said[2][0]


@pytest.mark.parametrize("wrong", [None, "settings", "candidate", "values"])
def test_parameters_that_a_run_found_are_the_model_before(tmp_path, wrong):
    """The best candidate of the same model; of another model, or of other parameters, it says nothing."""
    asked = ask(load_study(write(tmp_path / "toy")))
    best = {"name": "search 2", "values": {"mu": 0.011, "D1": 40.0}}
    search = {"name": "search", "candidates": [{"name": "search 1", "values": {"mu": 0.02, "D1": 20.0}}, best]}
    found = {
        "backend": {"settings": dict(asked.study.backend.settings)},
        "searches": [search],
        "best": {"search": "search", "candidate": "search 2"},
    }
    if wrong == "settings":
        found["backend"]["settings"]["law"] = "yeoh"
    if wrong == "candidate":
        best["name"] = "search 3"
    if wrong == "values":
        best["values"]["compliance"] = 0.1
    assert _fitted(asked, tmp_path) is None
    (tmp_path / "results.json").write_text(json.dumps(found))
    assert _fitted(asked, tmp_path) == ({"mu": 0.011, "D1": 40.0} if wrong is None else None)


def constant(name: str) -> float:
    raise AssertionError(f"{name} is no JSON")


def strict(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=constant)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy")
    done = process("diagnose", write(folder))
    assert done.returncode == 0, done.stderr
    assert "gap" in done.stdout and "Traceback" not in done.stderr
    return folder


def test_the_answer_is_strict_json(folder):
    (path,) = folder.rglob("diagnosis.json")
    found = strict(path)
    d = found["diagnosis"]
    assert d["verdict"] in ("explained", "partly") and d["causes"][0]["effect"] == "soften"
    low, high = d["causes"][0]["interval"]  # nine of ten such intervals hold the truth: their triple always
    assert 2.0 * low - high < 0.3 < 2.0 * high - low
    first, *_ = found["rerun"]
    assert first["effects"] == ["soften"] and first["failed"] == 0 and found["failed_runs"] == []
    assert first["largest"] < 0.03  # interpolation of the library at the size found
    limits = {v["effect"]: v["smallest_visible"] for v in d["detectable"]}
    assert limits["soften"] is not None and 0.0 < limits["soften"] < 0.3


def test_a_second_call_computes_nothing_and_says_the_same(folder):
    (path,) = folder.rglob("diagnosis.json")
    before, runs = strict(path), (folder / "log").read_text().count("run")
    assert rso("diagnose", folder / "study.toml").returncode == 0
    assert (folder / "log").read_text().count("run") == runs
    after = strict(path)
    for found in (before, after):
        found.pop("timings"), found.pop("command"), found["provenance"].pop("finished")
    assert before == after


def test_effects_of_channels_that_were_not_measured_are_no_effects_of_the_study(tmp_path):
    names = {
        e.name for e in ask(load_study(write(tmp_path, STUDY.replace('effects = ["stiff", "soften"]', "")))).effects
    }
    assert "gain" in names and not names & {"cross_x", "cross_y"}


RANGE = {
    "mu": 'mu = { low = "6 kPa", high = "24 kPa", scale = "log" }',
    "D1": 'D1 = { low = "15 1/MPa", high = "150 1/MPa", scale = "log" }',
}
VALUE = {"mu": 'mu = { value = "12 kPa" }', "D1": "D1 = { value = 60.0 }"}


def fixing(*names: str) -> str:
    """The study with some parameters fixed at the truth."""
    text = STUDY
    for k in names:
        assert RANGE[k] in text
        text = text.replace(RANGE[k], VALUE[k])
    return text


@pytest.mark.parametrize(
    ("names", "axes"),
    [((), {"D1": (0.09, 3.6)}), (("D1",), {"mu": (0.004, 0.036)}), (("mu",), {"D1": (0.18, 1.8)})],
)
def test_axes_of_simulations_are_what_is_open(tmp_path, names, axes):
    """An open D1 over 1/mu, as ever; mu itself, half as far again on each side, where D1 is fixed."""
    asked = ask(load_study(write(tmp_path, fixing(*names))))
    base = asked.base
    assert [a.name for a in base.axes] == list(axes) and base.modulus == "mu"
    for a in base.axes:
        np.testing.assert_allclose((a.low, a.high), axes[a.name], rtol=1e-12)
    assert (base.low == base.high == base.reference == 0.012) is ("mu" in names)
    assert {a.name: a.kept for a in base.axes if a.kept} == ({} if "D1" in names else {"D1": (15.0, 150.0)})
    loose = fixing(*names).replace("[diagnose]\n", "[diagnose]\nkeep_ranges = false\n")
    assert not any(a.kept for a in ask(load_study(write(tmp_path / "loose", loose))).base.axes)
    assert dict(base.held) == ({"D1": -1} if "D1" in names else {})
    assert not {"mu", "D1"} & {e.size.name for e in asked.effects}


@pytest.mark.parametrize("scale", ["", ', scale = "log"'])
def test_a_narrow_range_is_kept_too(tmp_path, scale):
    """Of mu and D1 by which their product spans less than four times."""
    text = STUDY.replace(RANGE["mu"], 'mu = { low = "10 kPa", high = "14 kPa" }')
    text = text.replace(RANGE["D1"], f'D1 = {{ low = "50 1/MPa", high = "75 1/MPa"{scale} }}')
    (a,) = ask(load_study(write(tmp_path, text))).base.axes
    assert a.kept == (50.0, 75.0) and a.log
    np.testing.assert_allclose((a.low, a.high), (0.5, 1.05), rtol=1e-12)
    loose = text.replace("[diagnose]\n", "[diagnose]\nkeep_ranges = false\n")
    (a,) = ask(load_study(write(tmp_path / "loose", loose))).base.axes
    assert a.kept is None and a.log is bool(scale)


def test_whatever_is_fixed_with_a_stress_in_its_unit_moves_over_the_modulus_and_is_no_effect(tmp_path):
    """A weight beside D1, of finite elements: one axis for both; what is fixed at neutral stays an effect."""
    own = Path(__file__).parents[2] / "studies" / "withheld"
    text = (own / "study.toml").read_text(encoding="utf-8").replace("measured/", f"{own}/measured/")
    (old,) = re.findall(r"^D1 = .*$", text, re.M)
    new = 'D1 = { value = "4 1/MPa" }\nweight = { value = 1e-5 }\nC20 = { value = 0.0 }\nfriction = { value = 0.1 }'
    (tmp_path / "study.toml").write_text(text.replace(old, new), encoding="utf-8")
    asked = ask(load_study(tmp_path / "study.toml"))
    names = {e.size.name for e in asked.effects}
    assert [a.name for a in asked.base.axes] == ["mu"] and "weight" not in names and {"C20", "friction"} <= names
    values = asked.base.values((np.log(0.02),))
    assert values["mu"] == asked.base.reference == 0.01
    np.testing.assert_allclose([values["D1"], values["weight"]], [8.0, 0.5e-5], rtol=1e-12)
    assert values["friction"] == 0.1 and values["C20"] == 0.0


def test_a_study_that_fixes_all_is_refused_with_what_to_write(tmp_path):
    with pytest.raises(StudyError, match=r"study\.toml:9: parameters: .*at least one parameter needs low and high"):
        ask(load_study(write(tmp_path, fixing("mu", "D1"))))


def test_a_study_with_a_fixed_parameter_is_diagnosed_and_says_so(tmp_path):
    text = fixing("D1").replace("html = false", "html = true")
    done = rso("diagnose", write(tmp_path, text))
    assert done.returncode == 0, done.stderr
    (path,) = tmp_path.rglob("diagnosis.json")
    found = strict(path)
    assert found["fixed"] == {"D1": 60.0} and list(found["diagnosis"]["parameters"]["after"]) == ["mu"]
    assert found["diagnosis"]["causes"][0]["effect"] == "soften"
    said = "Fixed by the study, not fitted: D₁ = 60 MPa⁻¹."
    (page,) = tmp_path.rglob("diagnosis.html")
    assert said in done.stdout and said in page.read_text(encoding="utf-8")


BROKEN = {
    "not measured": ('effects = ["stiff", "soften"]', 'effects = ["stiff", "cross_x"]', "measured are Fz"),
    "no such effect": ('effects = ["stiff", "soften"]', 'effects = ["stif"]', "diagnose.effects"),
    "wrong key": ("[diagnose]\n", "[diagnose]\neffect = 3\n", "diagnose.effect"),
    "no modulus": ('mu = { low = "6 kPa", high = "24 kPa", scale = "log" }', "", "stress"),
    "unknown setting": ("[backend.settings]", "[backend.settings]\ncolour = 3", "colour"),
    "no data": ('data = "load.csv"', 'data = "lode.csv"', "lode.csv"),
    "comes after itself": ('after = ["load"]', 'after = ["cycle"]', "cycle"),
    "nothing to fit": ('role = "fit"', 'role = "validate"', "fit"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_study_is_refused_with_file_and_key(tmp_path, case):
    old, new, message = BROKEN[case]
    assert old in STUDY
    path = write(tmp_path, STUDY.replace(old, new))
    with pytest.raises(StudyError) as error:
        ask(load_study(path))
    assert "study.toml" in str(error.value) and message in str(error.value)


@pytest.mark.parametrize("most,words", [(3.9, "travel 4"), (4.2, "computes to 4.4 mm, beyond the deepest reading")])
def test_a_test_too_deep_for_the_backend_is_named_before_anything_is_computed(tmp_path, monkeypatch, most, words):
    """The data of the deepest test, not the settings; also where only the way beyond its readings is too deep."""

    def check(self, case):
        if max(case.programme.travel_mm) > most:
            raise ValueError(f"travel {max(case.programme.travel_mm):g} mm: at most {most:g} mm")

    monkeypatch.setattr(type(toy.BACKEND), "check", check)
    monkeypatch.syspath_prepend(str(HERE))
    with pytest.raises(StudyError) as found:
        ask(load_study(write(tmp_path)))
    assert words in str(found.value) and "experiments[0].data" in str(found.value)


def test_the_command_refuses_with_the_exit_code_of_bad_input(tmp_path):
    old, new, message = BROKEN["no such effect"]
    done = rso("diagnose", write(tmp_path, STUDY.replace(old, new)))
    assert done.returncode == 2 and message in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("diagnosis.json"))


def test_failed_runs_show_in_the_exit_code_and_are_said(tmp_path):
    text = STUDY.replace("[backend.settings]", '[backend.settings]\nfail = "stiff"')
    done = rso("diagnose", write(tmp_path, text, soften=0.0))
    assert done.returncode not in (0, 2) and "Traceback" not in done.stderr
    (path,) = tmp_path.rglob("diagnosis.json")
    assert any("stiff" in line for line in strict(path)["failed_runs"])
    assert "failed simulation, its neighbours stand for it: stiff" in " ".join(done.stdout.split())


def test_check_says_how_large_the_library_will_be(folder, tmp_path):
    """At most, and here exactly: this backend does not say what a run costs."""
    done = rso("check", "--trust", folder / "study.toml", "--out", tmp_path / "new")
    assert done.returncode == 0, done.stderr
    (found,) = re.findall(r"rso diagnose: 2 effects; a library of (\d+) simulations at most", done.stdout)
    (path,) = folder.rglob("diagnosis.json")
    runs = strict(path)["timings"]["library_runs"]
    assert int(found) == runs
    many = r"(1 simulation|[02-9]\d* simulations|1\d+ simulations)"
    assert re.search(rf"is simulated again: about {many}, .* (s|min)", done.stdout)
    done = rso("check", "--trust", folder / "study.toml")
    assert f"a library of {runs} simulations at most, of which {runs} are there, 0 s" in done.stdout


def test_the_page_of_a_diagnosis_is_written_again(folder, tmp_path):
    (path,) = folder.rglob("diagnosis.json")
    (tmp_path / "diagnosis.json").write_bytes(path.read_bytes())
    done = rso("report", folder / "study.toml", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / f"diagnosis.{kind}") for kind in ("html", "pdf")]
    (tmp_path / "diagnosis.json").write_text('{"schema": 0}')
    done = rso("report", folder / "study.toml", "--out", tmp_path)
    assert done.returncode == 2 and "expected 1" in done.stderr and "rso diagnose" in done.stderr


def test_check_of_a_study_whose_diagnosis_cannot_be(tmp_path):
    """An error where the study asks for one, a remark where it does not."""
    old, new, message = BROKEN["no such effect"]
    done = rso("check", "--trust", write(tmp_path / "asked", STUDY.replace(old, new)))
    assert done.returncode == 2 and message in done.stderr
    silent = STUDY.replace('[diagnose]\neffects = ["stiff", "soften"]\n', "")
    more = "[parameters]\nstiff = { low = 0.0, high = 1.0 }\ntwin = { low = 0.0, high = 1.0 }"
    silent = silent.replace("[parameters]", more)
    done = rso("check", "--trust", write(tmp_path / "silent", silent))
    assert done.returncode == 0, done.stderr
    assert "rso diagnose: not with this study: line " in done.stdout and "at most two open" in done.stdout


def test_a_record_of_minutes_has_a_lag_and_a_drift_of_minutes(tmp_path):
    """The same readings, sixty times as slow."""
    text = STUDY.replace('effects = ["stiff", "soften"]', 'effects = ["lag", "drift", "stiff"]')
    found = []
    for unit in ("s", "min"):
        path = write(tmp_path / unit, text)
        for data in path.parent.glob("*.csv"):
            data.write_text(data.read_text().replace("time_s", f"time_{unit}"))
        asked = ask(load_study(path))
        found.append({e.name: e.size.high for e in asked.effects} | {"times": asked.plan.times})
    (quick, longest), (slow, last) = (f["times"] for f in found)
    assert 1.5 < quick < 20.0 < slow and 5.0 < longest < 100.0 < last
    np.testing.assert_allclose(found[1]["lag"], found[0]["lag"] * slow / 20.0)
    np.testing.assert_allclose(found[1]["drift"], found[0]["drift"] * 100.0 / last)
    assert found[1]["stiff"] == found[0]["stiff"]


def test_a_backend_that_is_none_is_said_as_by_a_run(tmp_path):
    """The same sentence, at the same line, and the word backend once."""
    file = write(tmp_path)
    file.write_text(re.sub(r'use = "[^"]*"', 'use = "nowhere:MODEL"', file.read_text()))
    said = []
    for refused in (ask, make_plan):
        with pytest.raises(StudyError) as error:
            refused(load_study(file))
        said.append(error.value.problems)
    assert said[0] == said[1] and "backend: " not in said[0][0] and "'nowhere'" in said[0][0]
