"""The command line as people use it: exit codes, messages, progress, interruptions."""

import fcntl
import io
import json
import os
import pty
import random
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
import sample_studies as studies

import rso
from rso.calibration import plan
from rso.cli import main, progress
from rso.evaluation import Finished, Planned
from rso.study.laboratory_nominal import NOISE_KEYS, SUPPORT_WORDS, read_nominal

HERE = Path(__file__).parent
TOP = studies.SECTIONS["[experiments]"]
SEARCH = studies.SECTIONS["search"]
PARAMETERS = studies.SECTIONS["parameters"]
MU, D1 = PARAMETERS.split("\n")
FULL = "runs = 24\nheld_out = 2\nreduce = false"
# One parameter, of which some runs fail: what is shown of 26 runs, and no more work than that.
FAILING = studies.QUICK | {"doe": FULL, "parameters": MU + "\nD1 = { value = 60 }", "verify": "max_infill = 0"}


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "rso.cli", *map(str, arguments)]


def environment() -> dict[str, str]:
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, "COLUMNS": "80", "TERM": "xterm"}


# ------------------------------------------------------------------------------------------------------ bad input


def experiments(*more: str, first: str = TOP) -> dict[str, str]:
    return {"experiments": "\n[[experiments]]\n".join([first, *more])}


def targets(text: str) -> dict[str, str]:
    return {"search": f"targets = [{text}]"}


IN_MN = """import indentation_backend
class Milli(indentation_backend.Layer):
    channels = {"time": "s", "travel": "mm", "Fz": "mN", "Fx": "newton", "uz_max": "m"}
BACKEND = Milli()
"""

BROKEN = {  # changes of the study file, other files, what the message must hold
    "unknown table": ({"serach": "population = 20"}, {}, "serach: unknown key; did you mean 'search'"),
    "unknown key": ({"doe": "run = 16"}, {}, "doe.run = 16: unknown key; did you mean 'runs'"),
    "wrong type": ({"doe": 'runs = "16"'}, {}, "doe.runs = '16'"),
    "negative seed": ({"study": 'title = "x"\nseed = -1'}, {}, "study.seed = -1"),
    "no title": ({"study": "seed = 1"}, {}, "study.title: is missing"),
    "tolerance of 5": ({"verify": "tolerance = 5"}, {}, "verify.tolerance = 5"),
    "a thousand points of Sobol": (
        {"sensitivity": "samples = 1000"},
        {},
        "samples = 1000: points of a Sobol sequence come in powers of two, at least 4: take 512 or 1024",
    ),
    "one point of Sobol": ({"sensitivity": "samples = 1"}, {}, "at least 4: take 4"),
    "five individuals": ({"search": "population = 5"}, {}, "search.population = 5: individuals mate in pairs"),
    "no workers": ({"dispatch": "jobs = 0"}, {}, "dispatch.jobs = 0"),
    "wrong unit": ({"parameters": MU.replace("6 kPa", "6 mm") + "\n" + D1}, {}, "parameters.mu.low = '6 mm'"),
    "no unit": ({"parameters": MU.replace("6 kPa", "6") + "\n" + D1}, {}, "text without a unit"),
    "low above high": ({"parameters": MU.replace("6 kPa", "60 kPa") + "\n" + D1}, {}, "must be below high"),
    "beyond hard bounds": ({"parameters": MU.replace("20 kPa", "20 GPa") + "\n" + D1}, {}, "outside its hard bounds"),
    "log of zero": ({"parameters": MU + "\n" + D1.replace("10,", "0,")}, {}, "a log scale needs low > 0"),
    "half a range": ({"parameters": MU + "\nD1 = { low = 10 }"}, {}, "parameters.D1: low and high must be given"),
    "a fixed one with a range": (
        {"parameters": MU + "\nD1 = { value = 60, low = 10, high = 150 }"},
        {},
        "parameters.D1: value fixes it, and low belongs to a range to search",
    ),
    "a fixed one with a scale": (
        {"parameters": MU + '\nD1 = { value = 60, scale = "log" }'},
        {},
        "value fixes it, and scale belongs",
    ),
    "unknown parameter": ({"parameters": PARAMETERS + "\nnu = { value = 0.4 }"}, {}, "parameters.nu: the backend has"),
    "nothing open": ({"parameters": "mu = { value = 0.01 }"}, {}, "parameters: nothing to identify"),
    "needed parameter": ({"parameters": D1}, {}, "the backend needs 'mu' (shear modulus, MPa)"),
    "no backend": ({"backend": None, "backend__settings": None}, {}, "backend: is missing"),
    "no such module": ({"backend": 'use = "nowhere:BACKEND"'}, {}, "cannot import module 'nowhere'"),
    "no such object": ({"backend": 'use = "indentation_backend:FRONTEND"'}, {}, "has no 'FRONTEND'"),
    "no backend at all": ({"backend": 'use = "json:dumps"'}, {}, "backend.use: 'json:dumps' is not a backend"),
    "a plain function": ({"backend": 'use = "json:dumps"'}, {}, "is a plain function; @rso.model("),
    "no such program": ({"backend": 'command = ["no-such-solver"]'}, {}, "program 'no-such-solver'"),
    "program and module": (
        {"backend": 'use = "indentation_backend:BACKEND"\ncommand = ["ls"]'},
        {},
        "give either use =",
    ),
    "unknown setting": (
        {"backend__settings": 'law = "yeoh"'},
        {},
        "study.toml:9: backend.settings.law: unknown settings ['law']",
    ),
    "bad setting": (
        experiments(first=TOP + "\nsettings = { thickness = -1 }"),
        {},
        "experiments[0].settings.thickness: thickness",
    ),
    "no such data": (experiments(first=TOP.replace("top.csv", "tip.csv")), {}, "tip.csv"),
    "wrong column": ({}, {"top.csv": "depth_mm,power_N\n1,2\n"}, "top.csv:1: unknown column 'power_N'"),
    "wrong unit of a column": ({}, {"top.csv": "depth_mm,Fz_mm\n1,2\n"}, "Fz_mm"),
    "NaN in the data": ({}, {"top.csv": "depth_mm,Fz_N\n1,0.1\n2,nan\n"}, "top.csv:3: column 'Fz': 'nan'"),
    "text in the data": ({}, {"top.csv": "depth_mm,Fz_N\n1,0.1\n2,much\n"}, "top.csv:3: column 'Fz': 'much'"),
    "no data": ({}, {"top.csv": ""}, "top.csv"),
    "no contact": ({"search": None}, {"top.csv": "depth_mm,Fz_N\n-2,0\n-1,0\n"}, "no depth is positive"),
    "repeats apart": (
        {"search": None},
        {"top.csv": "depth_mm,Fz_N,repeat\n1,.1,a\n2,.2,a\n3,.3,b\n4,.4,b\n"},
        "share no range",
    ),
    "depths in metres said to be micrometres": (
        {"search": None},
        {"top.csv": "depth_um,Fz_N\n0.001,.1\n0.002,.2\n0.004,.4\n"},
        "the largest depth is 4e-06 mm: is column 'depth' in the unit that it is read in?",
    ),
    "depths to four nanometres": (
        {"search": None},
        {"top.csv": "depth_nm,Fz_N\n0,0\n1,.1\n2,.2\n4,.4\n"},
        "Choose from mm, um",
    ),
    "no such channel": (experiments(first=TOP + '\nchannels = ["Fq"]'), {}, "top.csv has no such channel"),
    "channel that is not modelled": (
        experiments(first=TOP + '\nchannels = ["Fy"]') | {"search": None},
        {"top.csv": "depth_mm,Fy_N\n1,.1\n2,.2\n"},
        "the backend 'layer' has no such channel",
    ),
    "forces in another unit": (
        {"backend": 'use = "layer_in_mN:BACKEND"'},
        {"layer_in_mN.py": IN_MN},
        "use: the backend 'layer' declares channel 'Fz' in mN; choose N",
    ),
    "target that is not modelled": (
        targets('{ experiment = "top", depth = 1, channel = "Fy" }'),
        {"top.csv": "depth_mm,Fz_N,Fy_N\n1,.1,.1\n2,.2,.2\n"},
        "search.targets[0].channel = 'Fy'",
    ),
    "target too deep": (targets('{ experiment = "top", depth = 4 }'), {}, "4 mm is outside the measured range"),
    "target elsewhere": (targets('{ experiment = "tip", depth = 1 }'), {}, "unknown experiment; did you mean 'top'"),
    "target of zero": (
        targets('{ experiment = "top", depth = 2, value = 0 }') | experiments(first=TOP.split("\nnoise")[0]),
        {"top.csv": "depth_mm,Fz_N\n1,0\n2,0\n"},
        "without uncertainty",
    ),
    "target to validate": (
        experiments('name = "end"\nrole = "validate"\ndata = "end.csv"') | targets('{ experiment = "end", depth = 1 }'),
        {"end.csv": "depth_mm,Fz_N\n1,.1\n2,.3\n"},
        "cannot be a target",
    ),
    "constraint to validate": (
        experiments('name = "end"\nrole = "validate"\ndata = "end.csv"')
        | {"search": 'constraints = [{ experiment = "end", channel = "Fz", depth = 1, low = 0 }]'},
        {"end.csv": "depth_mm,Fz_N\n1,.1\n2,.3\n"},
        "cannot be constrained",
    ),
    "constraint on nothing": (
        {"search": 'constraints = [{ experiment = "top", channel = "ux_max", depth = 1, low = 0 }]'},
        {},
        "did you mean 'uz_max'",
    ),
    "variant outside": (
        {"[search__variants]": 'name = "wide"\nranges = { mu = ["1 kPa", "9 kPa"] }'},
        {},
        "must lie inside",
    ),
    "variant called as the search": ({"[search__variants]": 'name = "main"'}, {}, "is taken by the search itself"),
    "required but fixed": ({"identify": 'require = ["radius"]'}, {}, "identify.require[0] = 'radius'"),
    "two of one name": (experiments(TOP), {}, "this name is taken"),
    "unknown role": (experiments(first=TOP.replace('"fit"', '"fitt"')), {}, "did you mean 'fit'"),
    "nothing to fit": (experiments(first=TOP.replace('"fit"', '"select"')), {}, 'needs role = "fit"'),
    "profile": (
        experiments('name = "p"\nrole = "fit"\nkind = "profile"\ndata = "p.csv"'),
        {"p.csv": "depth_mm,x_mm,y_mm,uz_mm\n1,0,5,-.1\n"},
        "has no profiles",
    ),
    "wrong number of runs": ({"doe": 'kind = "ccd"\nruns = 12'}, {}, "ccd of 2 parameters has 9 runs, not 12"),
    "too few parameters": ({"doe": 'kind = "box_behnken"'}, {}, "box_behnken is for 3 to 7"),
    "no factorial": ({"doe": 'kind = "factorial"\nruns = 10'}, {}, "try one of [4, 9, 16]"),
    "no points": ({"doe": 'kind = "file"\nfile = "p.csv"'}, {}, "doe.file = 'p.csv': there is no such file"),
    "points of others": ({"doe": 'kind = "file"\nfile = "p.csv"'}, {"p.csv": "mu,nu\n0.01,0.3\n"}, "p.csv"),
    "points outside": (
        {"doe": 'kind = "file"\nfile = "p.csv"'},
        {"p.csv": "mu,D1\n0.01,1000\n"},
        "outside the parameters' ranges",
    ),
    "degree of 7": ({"surrogate": "degree = 7"}, {}, "surrogate.degree = 7: should be less than or equal to 4"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_studies_are_answered_with_file_line_and_key(tmp_path, capsys, name):
    changes, files, message = BROKEN[name]
    path = studies.write(tmp_path, **changes)
    for file, content in files.items():
        (tmp_path / file).write_text(content)
    assert main(["run", str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and "Traceback" not in said.err
    assert message in said.err
    for line in said.err.splitlines():
        assert re.match(rf"{re.escape(str(path))}:\d+: ", line)
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("encoding", ["latin-1", "ascii", "cp1252"])
def test_a_terminal_that_lacks_letters_shows_the_rest(tmp_path, monkeypatch, encoding):
    path = studies.write(tmp_path, study='title = "Σ μ – Niere"\nseed = 0')
    if encoding != "ascii":
        terminal = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
        monkeypatch.setattr(sys, "stdout", terminal)
        assert main(["check", "--trust", str(path)]) == 0
        terminal.flush()
        assert b"  ? " in terminal.buffer.getvalue()
        return
    here = Path(__file__)
    where = os.pathsep.join(map(str, (here.parents[2], here.parent)))
    environment = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONPATH": where}
    call = [sys.executable, "-m", "rso.cli", "check", "--trust", str(path)]
    done = subprocess.run(call, env=environment, capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"") and b"  ? " in done.stdout


def test_every_problem_is_said_at_once(tmp_path, capsys):
    assert main(["check", "--trust", str(studies.write(tmp_path, doe="run = 16", study="seed = 1"))]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2


@pytest.mark.parametrize("content", [b"[study\n", b"\xff\xfe", b"a = 1\na = 2\n"], ids=["syntax", "bytes", "twice"])
def test_files_that_are_no_toml(tmp_path, capsys, content):
    (tmp_path / "study.toml").write_bytes(content)
    assert main(["run", str(tmp_path)]) == 2
    assert re.match(r".*study\.toml:\d+: ", capsys.readouterr().err)


def test_a_study_that_is_not_there(tmp_path, capsys):
    assert main(["run", str(tmp_path / "stuby.toml")]) == 2
    assert "there is no such study file" in capsys.readouterr().err

    with pytest.raises(SystemExit, match="2"):
        main(["simulate", "study.toml"])


def test_a_folder_of_results_without_its_study_is_shown_by_open(tmp_path, capsys):
    (tmp_path / "results.json").write_text("{}")
    assert main(["report", str(tmp_path)]) == 2
    assert f"rso open {tmp_path}" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("jobs", ["0", "-1", "many", "０", "10001", "9" * 5000])
@pytest.mark.parametrize("command", ["check", "run", "diagnose", "ladder", "blind"])
def test_a_number_of_jobs_that_is_none(tmp_path, capsys, command, jobs):
    with pytest.raises(SystemExit, match="2"):
        main([command, str(tmp_path), "--jobs", jobs])
    said = capsys.readouterr().err
    assert "--jobs" in said and "from 1 to 10000" in said and len(said) < 1500


# ------------------------------------------------------------------------------------------------------ check, status


def test_check_says_what_would_run_and_computes_nothing(tmp_path, capsys):
    path = studies.write(tmp_path, backend__settings=f"thickness = 8\nlog = {str(tmp_path / 'calls')!r}")
    before = sorted(tmp_path.iterdir())
    assert main(["check", "--trust", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"{path}: good" in said and "2 → 1 dimensions" in said
    assert "20 at most (8 design, 3 held out, 2 proof, 3 candidates, 4 identification)" in said
    assert sorted(tmp_path.iterdir()) == before


def test_times_of_a_check_are_those_with_as_many_jobs(tmp_path, capsys):
    path = str(studies.write(tmp_path))
    times = {}
    for jobs in ([], ["--jobs", "1"], ["--jobs", "8"]):
        assert main(["check", "--trust", path, *jobs]) == 0
        (said,) = re.findall(r"about ([\d.]+) (s|min) with (\d+) job", capsys.readouterr().out)
        times[int(said[2])] = float(said[0]) * {"s": 1, "min": 60}[said[1]]
    assert set(times) == {1, 2, 8}
    assert times[1] == pytest.approx(2 * times[2], abs=12) and times[1] == pytest.approx(8 * times[8], abs=30)


def test_help_names_the_exit_codes(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    said = capsys.readouterr().out
    assert all(word in said for word in ("check", "run", "status", "report", "130"))


def test_the_package_runs_as_a_module():
    said = subprocess.run([sys.executable, "-m", "rso", "--version"], capture_output=True, text=True, check=True).stdout
    assert said == f"rso {rso.__version__}\n"


def test_the_example_of_a_folder_is_one_that_is_read(tmp_path, capsys):
    """That of `rso blind --help` and that of the documentation."""
    with pytest.raises(SystemExit, match="0"):
        main(["blind", "--help"])
    said = capsys.readouterr().out
    page = (HERE.parents[1] / "docs" / "data_for_a_diagnosis.md").read_text(encoding="utf-8")
    for text in (said, page):
        (tmp_path / "nominal.json").write_text(text[text.index("{") : text.rindex("}") + 1])
        found = read_nominal(tmp_path)
        assert found.settings["indenter"]["radius"] == 3.0 and found.rate == 30.0 and found.assumed == ()
        for word in ("mp_load.csv", "mp_cycle_30.csv", "point_20_0.csv", "profile.csv", "5 to 20 kPa", "remark"):
            assert word in text
    for words in (*SUPPORT_WORDS, *NOISE_KEYS):
        assert words in page


def test_a_whole_study_with_its_report(tmp_path, capsys, here):
    path = str(studies.write(tmp_path, **studies.QUICK | {"report": "html = true\npdf = true"}))
    assert main(["status", path]) == 0 and "not started" in capsys.readouterr().out
    assert main(["report", path]) == 2
    said = capsys.readouterr().err
    assert "is not there; run the study first" in said and "Errno" not in said
    assert main(["run", path, "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    assert "✓ μ = " in said
    done = re.search(r"(\d+) simulations \(\1 done, 0 failed, 0 crashed", said)[1]
    results = tmp_path / "results"
    assert b"<html" in (results / "report.html").read_bytes()[:500]
    assert (results / "report.pdf").read_bytes().startswith(b"%PDF")
    assert main(["status", path]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^  ✓ μ = [\d.]+ kPa \([\d.]+ to [\d.]+ kPa\)$", said, re.MULTILINE)
    assert f"  simulations, done: {done}, failed: 0, crashed: 0\n" in said and str(results / "report.html") in said
    assert said.splitlines()[-1].startswith("  next: rso ")
    assert main(["status", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["parameters"]["mu"]["verdict"] == "determined" and told["runs"]["done"] == int(done)
    page = (results / "report.html").read_bytes()
    (results / "report.html").unlink()
    assert main(["report", path]) == 0
    assert (results / "report.html").read_bytes() == page
    assert "of other data" not in capsys.readouterr().err
    measured, table = tmp_path / "top.csv", (tmp_path / "top.csv").read_text()
    measured.write_text(table + "# a remark\n")
    assert main(["report", path]) == 0 and "since then top.csv changed, came or went" in capsys.readouterr().err
    measured.write_text(table)
    assert main(["check", "--trust", path]) == 0 and "as measured in this study" in capsys.readouterr().out
    # Moved aside, not deleted.
    studies.write(tmp_path, **studies.QUICK)
    assert main(["run", path, "--jobs", "1", "--fresh"]) == 0
    (aside,) = tmp_path.glob("results-*")
    assert (aside / "results.json").exists() and studies.read(tmp_path)["counts"]["from_store"] == 0


HERTZ = """
import json, sys
if sys.argv[1] == "--schema":
    open("schema.log", "a").write("asked\\n")
    mu = {"name": "mu", "description": "shear modulus", "unit": "MPa", "low": 1e-5, "high": 10}
    units = {"time": "s", "travel": "mm", "Fz": "N"}
    print(json.dumps({"name": "hertz", "numerics": 1, "parameters": [mu], "channels": units}))
    sys.exit()
request = json.load(open(sys.argv[1]))
h = request["case"]["programme"]["asked_mm"]
F = [16 / 3 * request["values"]["mu"] * 3**0.5 * u**1.5 for u in h]
answer = {"status": "done", "channels": {"time": h, "travel": h, "Fz": F},
          "units": {"time": "s", "travel": "mm", "Fz": "N"}}
json.dump(answer, open(sys.argv[2], "w"))
"""


def test_a_program_started_before_the_old_results_are_moved_runs_in_the_new_folder(tmp_path, monkeypatch):
    """Workers start while the plan is made, and may have loaded the program long before the folder is another."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hertz.py").write_text(HERTZ)
    path = str(
        studies.write(
            tmp_path,
            backend=f'command = ["{sys.executable}", "hertz.py"]',
            backend__settings=None,
            parameters=MU,
            doe="runs = 6\nheld_out = 1",
        )
    )
    assert main(["run", path, "--jobs", "1"]) in (0, 4, 6)
    log, real = tmp_path / "schema.log", plan.make_plan
    log.write_text("")
    plan.Source.load.cache_clear()

    def slow(study):
        made, end = real(study), time.monotonic() + 60
        while len(log.read_text().splitlines()) < 2 and time.monotonic() < end:
            time.sleep(0.02)
        time.sleep(0.5)  # the worker has asked for the schema as well, and has it by now
        return made

    monkeypatch.setattr(plan, "make_plan", slow)
    assert main(["run", path, "--jobs", "1", "--fresh"]) in (0, 4, 6)
    counts = studies.read(tmp_path)["counts"]
    assert counts["done"] == counts["fe_runs"] > 0 and counts["from_store"] == 0
    assert len(list(tmp_path.glob("results-*"))) == 1


def test_fresh_moves_results_and_nothing_else(tmp_path, capsys, here):
    """Neither the folder of the study or its data, nor one of somebody else."""
    path = studies.write(tmp_path / "mine")
    foreign, other = tmp_path / "foreign", studies.write(tmp_path / "other", **studies.QUICK)
    foreign.mkdir()
    (foreign / "letter.txt").write_text("keep me")
    assert main(["run", str(other), "--jobs", "1"]) == 0
    capsys.readouterr()
    for out, why in (
        (path.parent, f"holds {path}, from which the study is read"),
        (tmp_path, f"holds {path}, from which the study is read"),
        (foreign, "is no folder of results: it has neither runs.sqlite nor the note 'study'"),
        (other.parent / "results", f"holds the results of another study, {other}"),
    ):
        before = sorted(tmp_path.rglob("*"))
        assert main(["run", str(path), "--jobs", "1", "--out", str(out), "--fresh"]) == 2
        said = capsys.readouterr().err
        assert f"--fresh moves no folder but that of this study's results: {out} {why}" in said
        assert sorted(tmp_path.rglob("*")) == before
    away = tmp_path / "away"  # data that lie in the folder of results
    away.mkdir()
    (away / "top.csv").write_text(studies.measured())
    (away / "study").write_text("../mine/study.toml\n")
    studies.write(tmp_path / "mine", **experiments(first=TOP.replace("top.csv", "../away/top.csv")))
    assert main(["run", str(path), "--jobs", "1", "--out", str(away), "--fresh"]) == 2
    assert "top.csv, from which the study is read" in capsys.readouterr().err


def test_studies_share_simulations_and_not_results(tmp_path, capsys, here):
    """A folder of results belongs to one study file; the simulations of another may serve it through --store."""
    one, other = (str(studies.write(tmp_path / name, **studies.QUICK)) for name in ("one", "other"))
    kept = tmp_path / "one" / "results"
    assert main(["run", one, "--jobs", "1"]) == 0
    before = (kept / "results.json").read_bytes()
    capsys.readouterr()
    assert main(["run", other, "--jobs", "1", "--out", str(kept)]) == 2
    said = capsys.readouterr().err
    assert f"{kept} holds the results of another study, {one}" in said and f"--store {kept}" in said
    assert (kept / "results.json").read_bytes() == before
    assert main(["check", "--trust", other, "--store", str(kept)]) == 0
    assert "as measured in this study" in capsys.readouterr().out
    assert main(["run", other, "--jobs", "1", "--store", str(kept)]) == 0
    counts, before = (studies.read(tmp_path / name)["counts"] for name in ("other", "one"))
    # it learns from all of them, so its candidates may lie a little beside those of the first: they are its own runs
    assert counts["from_store"] == before["fe_runs"] and counts["fe_runs"] - counts["from_store"] <= 5
    assert not (tmp_path / "other/results/runs.sqlite").exists()
    done = f"done: {counts['fe_runs']}"
    assert main(["status", other, "--store", str(kept)]) == 0 and done in capsys.readouterr().out
    # moved together they still belong together; a study that is gone owns nothing
    (tmp_path / "one").rename(tmp_path / "moved")
    assert main(["run", str(tmp_path / "moved/study.toml"), "--jobs", "1"]) == 0
    (tmp_path / "moved/study.toml").rename(tmp_path / "moved/renamed.toml")
    assert main(["run", str(tmp_path / "moved/renamed.toml"), "--jobs", "1"]) == 0


def test_failures_and_crashes_end_with_3_and_a_message(tmp_path, capsys):
    some = "thickness = 8\nfail_below = 0.007\ncrash_above = 0.018"
    path = str(studies.write(tmp_path, **FAILING, backend__settings=some))
    assert main(["run", path, "--jobs", "2"]) == 3
    said = capsys.readouterr()
    assert re.search(r"\([1-9]\d* done, [1-9]\d* failed, [1-9]\d* crashed", said.out) and said.err == ""
    found = studies.read(tmp_path)
    assert found["exit_code"] == 3 and {r["state"] for r in found["runs"]} == {"done", "failed", "crashed"}
    main(["status", path])
    assert re.search(r"  failed \w{12} \(μ = .*\): too soft", capsys.readouterr().out)
    every = studies.write(tmp_path / "b", backend__settings="thickness = 8\ncrash_above = 0.001")
    assert main(["run", str(every), "--jobs", "2"]) == 3
    said = capsys.readouterr()
    assert "stopped: no run is done" in said.out and "ZeroDivisionError: a bug" in said.out
    assert "Traceback" not in said.out + said.err


# ------------------------------------------------------------------------------------------------------ again, killed


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Results with one job, of the study that is interrupted below."""
    folder = tmp_path_factory.mktemp("reference")
    assert main(["run", str(studies.write(folder, **studies.QUICK)), "--jobs", "1"]) == 0
    return studies.timeless(studies.read(folder))


def test_two_jobs_give_the_same_results_as_one(tmp_path, reference):
    path = str(studies.write(tmp_path, **studies.QUICK))
    assert main(["run", path, "--jobs", "2"]) == 0
    assert studies.timeless(studies.read(tmp_path)) == reference
    assert main(["run", path, "--jobs", "2"]) == 0
    again = studies.read(tmp_path)
    assert again["counts"]["from_store"] == again["counts"]["fe_runs"]
    assert studies.timeless(again) == reference


def _hears_control_c() -> None:
    """A test run in the background of a shell inherits that SIGINT is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def begun(folder: Path, jobs: int = 2) -> subprocess.Popen:
    """`rso run` in a process of its own, once a first simulation was asked for."""
    log = folder / "calls"
    had = len(log.read_text().splitlines()) if log.exists() else 0
    process = subprocess.Popen(
        command("run", folder, "--jobs", jobs),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=_hears_control_c,
    )
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None:
        if log.exists() and len(log.read_text().splitlines()) > had:
            break
        time.sleep(0.01)
    return process


def sleepy(folder: Path, seconds: float) -> None:
    settings = f"thickness = 8\nsleep_s = {seconds}\nlog = {str(folder / 'calls')!r}"
    studies.write(folder, backend__settings=settings, **studies.QUICK)


def test_killed_at_random_moments_and_resumed_it_ends_the_same(tmp_path, reference):
    sleepy(tmp_path, 0.15)
    moments = random.Random(0)
    ended = []
    for _ in range(3):
        process = begun(tmp_path)
        time.sleep(moments.uniform(0.0, 0.35))
        process.kill()
        process.communicate()
        ended.append(process.returncode)
    assert ended == [-signal.SIGKILL] * 3  # it was killed, not too late
    done = subprocess.run(command("run", tmp_path, "--jobs", 2), env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = studies.read(tmp_path)
    assert 0 < found["counts"]["from_store"]
    # Only what ran at the moment of a death was begun twice: at most two simulations each time.
    calls = (tmp_path / "calls").read_text().splitlines()
    assert len(set(calls)) == found["counts"]["fe_runs"] and len(calls) <= len(set(calls)) + 2 * 2 * 3
    without = ("backend", "provenance", "experiments")  # hold the settings, which enter the keys
    assert _bare(studies.timeless(found), without) == _bare(reference, without)


def _bare(results: dict, without: tuple[str, ...]) -> dict:
    kept = {k: v for k, v in results.items() if k not in without}
    return {**kept, "runs": [{k: v for k, v in r.items() if k != "key"} for r in results["runs"]]}


def test_control_c_says_that_it_can_go_on(tmp_path):
    sleepy(tmp_path, 0.3)
    process = begun(tmp_path)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"interrupted" in err and b"goes on from there" in err and b"Traceback" not in out + err
    assert studies.read(tmp_path)["stage"] == "plan"
    status = subprocess.run(command("status", tmp_path), env=environment(), capture_output=True, text=True)
    assert status.returncode == 0 and "last finished stage: plan" in status.stdout and "crashed: 0" in status.stdout


# ------------------------------------------------------------------------------------------------------ progress


SOME_FAIL = "thickness = 8\nfail_below = 0.007"


def test_progress_on_a_terminal_shows_counts_and_does_not_wrap(tmp_path):
    studies.write(tmp_path, **FAILING, backend__settings=SOME_FAIL + "\nsleep_s = 0.02")
    parent, child = pty.openpty()
    fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    process = subprocess.Popen(command("run", tmp_path, "--jobs", 2), env=environment(), stdout=child, stderr=child)
    os.close(child)
    shown = b""
    while True:
        try:
            part = os.read(parent, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(parent)
    assert process.wait() == 3
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())
    bars = [line for line in re.split(r"[\r\n]+", text) if "/26" in line]
    assert any(re.search(r"[1-9]\d* failed.* [1-9]\d*/26", line) for line in bars)
    assert max(map(len, bars)) <= 80
    assert max(map(len, re.split(r"[\r\n]+", text))) <= 80 and re.search(r"\n    \S", text)  # hanging, at words
    assert "design: training runs of the surrogates" in text


def test_without_a_terminal_there_are_plain_lines(tmp_path, capsys):
    studies.write(tmp_path, **FAILING, backend__settings=SOME_FAIL)
    assert main(["run", str(tmp_path), "--jobs", "1"]) == 3
    said = capsys.readouterr().out
    assert "\x1b" not in said and "  26 simulations\n" in said
    assert re.search(r"^  26/26 \(\d+ done, \d+ failed\)$", said, re.MULTILINE)


def test_what_is_left_is_told_by_the_pace_and_not_by_runs_that_began_before(monkeypatch, capsys):
    """Runs begin while meshes of others are made: the first may end as soon as all are planned."""
    clock = iter([0.0, 100.0, 121.0, 142.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    shown = progress.Progress()
    shown.watch(Planned(4, 4, 0))
    for n in (1, 2, 3):
        shown.watch(Finished("key", "top", "done", 20.0, n, 4))
    said = capsys.readouterr().out.splitlines()
    pace = ["  1/4 (1 done)", "  2/4 (2 done), about 42 s left", "  3/4 (3 done), about 21 s left"]
    assert said == ["  4 simulations", *pace]


def test_the_results_are_strict_json(tmp_path):
    """The other tests read them with a parser that lets NaN pass."""

    def refuse(word: str) -> float:
        raise AssertionError(word)

    studies.run(tmp_path, doe="runs = 8\nheld_out = 0")
    text = (tmp_path / "results" / "results.json").read_text(encoding="utf-8")
    json.loads(text, parse_constant=refuse)


def test_a_command_that_computes_nothing_waits_for_no_surfaces_and_no_optimisers(tmp_path):
    """`rso status` takes a third longer with scipy.optimize, and twice as long with the backend."""
    file = studies.write(tmp_path)
    needless = {"scipy.optimize", "scipy.interpolate", "rso.emulation", "fem_backend.backend", "matplotlib", "pandas"}
    code = (
        f"import sys; from rso.cli import main; main(['status', {str(file)!r}]); "
        f"print(sorted({needless!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "not started" in done.stdout


@pytest.mark.verification
def test_a_run_waits_for_no_tables(tmp_path):
    """Each of these takes as long to import as the first simulations of a slab."""
    needless = {"pandas", "rso.api"}
    file = studies.write(tmp_path, **studies.QUICK)
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from rso.cli import main; "
        f"main(['run', {str(file)!r}, '--quiet', '--jobs', '1']); print(sorted({needless!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "results" / "runs.csv").exists()


def test_report_writes_the_kinds_of_pages_that_the_study_asks_for(tmp_path, capsys):
    studies.run(tmp_path, **{**studies.QUICK, "report": "html = true\npdf = false"})
    assert main(["report", str(tmp_path / "study.toml")]) == 0
    names = {Path(line).name for line in capsys.readouterr().out.splitlines()}
    assert "report.html" in names and "report.pdf" not in names
    assert not (tmp_path / "results" / "report.pdf").exists()
