"""Programs with input files: templates, readers, runs, and a study that needs no driver."""

import json
import re
import shutil
import sys
from pathlib import Path

import hertz_program
import numpy as np
import pytest

from rso.calibration.plan import make_plan
from rso.cli import main
from rso.contract import Case, Parameter, Programme, SimulationFailed, run_key
from rso.core.units import in_base
from rso.evaluation.decks import Deck, DeckOutput, Failure, load_deck, read_template
from rso.evaluation.decks.readers import NotFound, at_passages, read_output
from rso.study.errors import StudyError
from rso.study.loader import load_study

PROGRAM = Path(hertz_program.__file__)
DECK = """** a ball on a half-space
*HYPERELASTIC, NEO HOOKE
{mu / 2:.9e}, {D1}
{each asked}
*STEP
*BOUNDARY
BALLNODES, 2, 2, {-travel}
{end}
"""
MU, UNITS = 0.012, {"mu": "MPa", "D1": "1/MPa", "h": "mm"}
ASKED = (0.5, 1.0, 2.0)
CASE = Case("top", Programme.ramp(ASKED))
STUDY = """[study]
title = "Ball"
seed = 1
[backend]
template = ["job.inp"]
command = [{python}, {program}, "job"]
failed = '\\*ERROR'
[backend.outputs]
{outputs}
[parameters]
mu = {{ low = "6 kPa", high = "20 kPa" }}
D1 = {{ value = "1 1/MPa" }}
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = {{ Fz = "0.1 mN", contact = "0 mm", gain = 0, correlation = "0 mm" }}
[doe]
runs = 5
held_out = 1
[search]
candidates = 1
population = 8
generations = 4
[sensitivity]
sobol = false
[report]
html = false
pdf = false
"""
OUTPUTS = {
    "calculix": 'Fz = { file = "job.dat", reader = "calculix", set = "BALLNODES", column = "fy", factor = -1 }',
    "table": 'Fz = { file = "job.csv", column = "rf2", unit = "mN", factor = -1, at = "travel", at_column = "u2", '
    "at_factor = -1 }",
    "febio": 'Fz = { file = "job.log", reader = "febio", column = "Rz" }',
    "function": 'Fz = { file = "job.dat", reader = "reading:ball", at = "step" }',
}
READING = """
def ball(path):
    blocks = path.read_text().split("time")[1:]
    return [float(b.split()[0]) for b in blocks], [-float(b.split()[2]) for b in blocks]
"""


def template(text, known=("mu", "D1", "h"), **more):
    return read_template("job.inp", text, known, ("step", "time", "travel"), **more)


def filled(text, values=None, **more):
    return template(text, **more).filled(values or {"mu": MU, "D1": 20.0, "h": 0.3}, UNITS, {"asked": [], "corner": []})


def output(reader="table", file="job.csv", **more):
    return DeckOutput("Fz", "N", file, reader, **more)


def study(folder, outputs="calculix", deck=DECK, **changes):
    folder.mkdir(exist_ok=True)
    text = STUDY.format(python=json.dumps(sys.executable), program=json.dumps(str(PROGRAM)), outputs=OUTPUTS[outputs])
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    (folder / "study.toml").write_text(text)
    (folder / "job.inp").write_text(deck)
    (folder / "reading.py").write_text(READING)
    u = np.linspace(0.25, 2.0, 8)
    rows = "\n".join(f"{x:.9g},{hertz_program.force(MU, x):.9g}" for x in u)
    (folder / "top.csv").write_text(f"depth_mm,Fz_N\n{rows}\n")
    return folder


def backend(folder, deck=DECK, **more):
    (folder / "job.inp").write_text(deck)
    known = {
        "templates": ("job.inp",),
        "parameters": (Parameter("mu", "mu", "MPa", 1e-4, 1.0), Parameter("D1", "D1", "1/MPa", 1e-3, 1e3)),
        "ranges": ((0.006, 0.02), (1.0, 20.0)),
        "outputs": (output("calculix", "job.dat", factor=-1.0, set="BALLNODES", column="fy", at="step"),),
        "failure": Failure(r"\*ERROR"),
    } | more
    command = known.pop("command", (sys.executable, str(PROGRAM), "job"))
    return load_deck(Deck(**known), command, folder, str(folder / "kept"), known.pop("timeout_s", None))


# ------------------------------------------------------------------------------------------------------- templates


@pytest.mark.parametrize(("text", "said"), [
    ("a {mu} b", "a 0.012 b"),
    ("{mu:.6e}", "1.200000e-02"),
    ("{mu[Pa]:.1f}|{mu[kPa]}", "12000.0|12"),
    ("{D1[1/GPa]}", "20000"),
    ("{2 / D1}, {sqrt(h**2) - 0.1}", "0.1, 0.2"),
    ("{h[um]:8.1f}|", "   300.0|"),
    ("*SOLID, A={{}", None),
    ("no places, no end", "no places, no end"),
])  # fmt: skip
def test_numbers_are_filled_in_with_units_and_formats(text, said):
    if said is None:
        with pytest.raises(ValueError, match=re.escape("job.inp, line 1: {{}")):
            filled(text)
    else:
        assert filled(text) == said


def test_a_deck_with_braces_of_its_own_takes_other_delimiters():
    assert filled("set x {<<mu>>}", delimiters=("<<", ">>")) == "set x {0.012}"
    assert filled("<mat E='@3 * mu@'/>\r\n", delimiters=("@", "@")) == "<mat E='0.036'/>\r\n"


def test_blocks_are_repeated_for_each_asked_travel_and_corner():
    programme = Programme((0.0, 4.0, 6.0), (0.0, 2.0, 0.0), (1.0, 2.0))
    time, travel = programme.passages()
    rows = {
        "asked": [{"step": k, "time": t, "travel": u} for k, (t, u) in enumerate(zip(time, travel, strict=True), 1)],
        "corner": [
            {"step": k, "time": t, "travel": u} for k, (t, u) in enumerate(zip((0, 4, 6), (0, 2, 0), strict=True), 1)
        ],
    }
    text = "a\n{each corner}\n{time}, {-travel}\n{end}\n{each asked}\n{step:d}: {travel} {mu}\n{end}\nb\n"
    found = template(text).filled({"mu": MU}, UNITS, rows)
    assert found == "a\n0, -0\n4, -2\n6, -0\n1: 1 0.012\n2: 2 0.012\n3: 1 0.012\nb\n"


@pytest.mark.parametrize(("text", "words"), [
    ("x\n{nu}", "job.inp, line 2: {nu}: 'nu' is no parameter, setting or word of the programme; choose from D1, h, mu"),
    ("{mu:5s}", "'5s' is no format of a number"),
    ("{mu:}", "is no format of a number"),
    ("{travel}", "'travel' is no parameter"),
    ("{2 * (mu}", "is no expression of names"),
    ("{open(mu)}", "is no parameter"),
    ("{mu.__class__}", "'mu.__class__' is no parameter"),
    ("{3.0}", "names nothing"),
    ("{each asked}\nx", "line 1: the block {each asked} has no {end}"),
    ("{end}", "without a block"),
    ("{each step}\n{end}", "each 'step' is no block; choose from asked, corner"),
])  # fmt: skip
def test_what_no_placeholder_means_is_refused_with_its_line(text, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        template(text)


@pytest.mark.parametrize(("text", "words"), [
    ("\n{mu:.1f}", "job.inp, line 2: {mu:.1f} prints 0.0 for 0.012: give more digits"),
    ("{mu:.2f}", "prints 0.01 for 0.012"),
    ("{D1:4.3f}", "prints '20.000', which is wider than its 4 columns"),
    ("{D1:d}{h:d}", "{h:d} prints 0 for 0.3"),
    ("{mu[mm]}", "'mm' is not a unit of the kind 'MPa'"),
    ("{1 / (mu - 0.012)}", "is no finite number at mu = 0.012"),
])  # fmt: skip
def test_what_would_be_another_number_is_refused(text, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        filled(text)


@pytest.mark.parametrize(("text", "found"), [
    ("3.2 kPa", (0.0032, "MPa")), ("5 1/kPa", (5000.0, "1/MPa")), ("2 cm", (20.0, "mm")), ("60 deg", (60.0, "deg")),
    ("1 %", (0.01, "1")), ("30 mm/min", (0.5, "mm/s")), ("2 mm**4/N/s", (2.0, "mm**4/N/s")),
])  # fmt: skip
def test_units_of_texts_become_those_of_the_program(text, found):
    assert in_base(text) == (pytest.approx(found[0], rel=1e-15), found[1])


# --------------------------------------------------------------------------------------------------------- readers

FILES = {
    "job.dat": """
 total force (fx,fy,fz) for set BALLNODES and time  0.5000000E+00

        2.453407E-06 -1.932127E-05 -1.889464E-15

 forces (fx,fy,fz) for set SOME and time  0.1000000E+01

         7  1.0E+00  2.0E+00  3.0E+00
         9  1.5E+00  2.5E+00  3.5E+00

 total force (fx,fy,fz) for set BALLNODES and time  0.1000000E+01

        9.619699E-06 -5.571573E-05 -3.098822E-15

 displacements (vx,vy,vz) for set TIP and time  0.1000000E+01

         4  0.000000E+00 -5.000000E-01  0.000000E+00
""",
    "job.csv": "# a run\ntime, u2, rf2\n0,0,0\n1,-0.5,-12.5\n2,-1,-40\n",
    "blanks.txt": "  Increment   Time      RF2\n     1     1.0000  -1.5D-03\n     2     2.0000  -2.5D-03\n",
    "bare.txt": "0.5 1\n1.0 2\n2.0 4\n",
    "run.log": "t = 0.5 force: 1.5e-1 N\nnothing\nt = 1.0 force: 2.5e-1 N\n",
    "febio.log": "*Step  = 1\n*Time  = 0.1\n*Data  = Fx;Fy;Fz\n2,0,0,-0.5\n"
    "*Step  = 2\n*Time  = 0.2\n*Data  = Fx;Fy;Fz\n2,0,0,-0.7\n",
}  # fmt: skip


@pytest.fixture
def results(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(("asked", "at", "values"), [
    (output("calculix", "job.dat", set="ballnodes", column="fy"), [0.5, 1.0], [-1.932127e-05, -5.571573e-05]),
    (output("calculix", "job.dat", set="SOME", column="fz"), [1.0], [6.5]),  # summed over the nodes
    (output("calculix", "job.dat", set="TIP", column="vy", factor=-2.0), [1.0], [1.0]),
    (output(column="rf2", at_column="u2", at_factor=-1.0, factor=-1.0), [0.0, 0.5, 1.0], [0.0, 12.5, 40.0]),
    (output(column=3, at_column=1), [0.0, 1.0, 2.0], [0.0, -12.5, -40.0]),
    (output(file="blanks.txt", column="rf2", at_column="Time"), [1.0, 2.0], [-1.5e-3, -2.5e-3]),
    (output(file="bare.txt", column=2), None, [1.0, 2.0, 4.0]),
    (output("regex", "run.log", pattern=r"t = (?P<at>\S+) force: (?P<value>\S+)"), [0.5, 1.0], [0.15, 0.25]),
    (output("regex", "run.log", pattern=r"force: (\S+)"), None, [0.15, 0.25]),
    (output("febio", "febio.log", column="Fz", item=2), [0.1, 0.2], [-0.5, -0.7]),
])  # fmt: skip
def test_readers_find_values_and_what_they_belong_to(results, asked, at, values):
    found = read_output(asked, results, results)
    np.testing.assert_allclose(found[1], values, rtol=1e-14, atol=1e-15)
    assert found[0] is None if at is None else np.allclose(found[0], at)


@pytest.mark.parametrize(("asked", "words"), [
    (output("calculix", "job.dat", set="BALL", column="fy"), "there is no 'fy' for set 'BALL'; it holds total force"),
    (output("calculix", "job.dat", set="SOME", column="vx"), "there is no 'vx' for set 'SOME'"),
    (output(file="jo.csv"), "jo.csv: there is no such file after the run; there are bare.txt"),
    (output(column="RF3"), "is no column: 'RF3'; it holds time, u2, rf2"),
    (output(column=4), "is no column: 4; it holds time, u2, rf2"),
    (output("regex", "run.log", pattern="F = (.*)"), "nothing matches 'F = (.*)'; its last lines are t = 0.5"),
    (output("regex", "run.log", pattern="t = (.*)"), "finds '0.5 force: 1.5e-1 N', which is no number"),
    (output("febio", "febio.log", column="Mz"), "is no column: 'Mz'; it holds Fx, Fy, Fz"),
    (output("febio", "febio.log", column="Fz", item=3), "there is no item 3; it holds items 2"),
    (output("febio", "job.csv", column="Fz"), "no record of *Time and rows"),
])  # fmt: skip
def test_readers_say_what_a_file_does_hold(results, asked, words):
    with pytest.raises(NotFound, match=re.escape(words)):
        read_output(asked, results, results)


def test_values_belong_to_travels_by_order_step_time_or_travel():
    programme = Programme.ramp(ASKED, 0.5)
    at, F = np.array([0.2, 1.0, 1.5, 2.0, 3.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert at_passages(output(at="order"), (None, F[:3]), programme)[0].tolist() == [1, 2, 3]
    assert at_passages(output(at="step"), (at, F), programme)[0].tolist() == [2, 4, 5]
    time = np.linspace(0.0, 4.0, 81)
    found, error = at_passages(output(at="time"), (time, time**1.5), programme)
    np.testing.assert_allclose(found, (np.array(ASKED) / 0.5) ** 1.5, rtol=1e-6)  # asked moments are among the rows
    assert np.all(error < 1e-12)


def test_what_lies_between_rows_is_interpolated_and_states_its_error():
    """Of u^(3/2), whose value is known: the stated error is not below the true one, and falls as the rows' square."""
    truth = np.array(ASKED) ** 1.5
    stated = []
    for n in (7, 14, 28):
        u = np.linspace(0.0, 2.3, n + 1)
        found, error = at_passages(output(at="travel"), (u, u**1.5), Programme.ramp(ASKED))
        assert np.all(np.abs(found - truth) <= error + 1e-12)
        stated.append(error.max())
    assert stated[0] > 3.0 * stated[1] and stated[1] > 2.5 * stated[2]


@pytest.mark.parametrize(("asked", "found", "programme", "words"), [
    (output(at="travel"), ([0.6, 2.5], [1.0, 2.0]), Programme.ramp(ASKED), "begins at travel 0.6, but 0.5 is asked"),
    (output(at="time"), ([0.0, 2.0, 1.0], [1.0, 2.0, 3.0]), Programme.ramp(ASKED), "does not increase from row to row"),
    (output(at="travel"), ([0.0, 2.0], [0.0, 1.0]), Programme((0, 4, 8), (0, 2, 0), ASKED), "is for loading alone"),
    (output(at="order"), (None, [1.0] * 5), Programme.ramp(ASKED), "5 values of Fz for 3 asked travels"),
    (output(at="time"), (None, [1.0] * 3), Programme.ramp(ASKED), "needs at_column"),
])  # fmt: skip
def test_rows_that_belong_to_no_travel_are_refused(asked, found, programme, words):
    at = None if found[0] is None else np.array(found[0])
    with pytest.raises(NotFound, match=re.escape(words)):
        at_passages(asked, (at, np.array(found[1])), programme)


# ------------------------------------------------------------------------------------------------------------ runs


def test_a_run_is_the_closed_form_and_leaves_nothing(tmp_path):
    answer = backend(tmp_path)({"mu": MU, "D1": 1.0}, CASE)
    expected = [hertz_program.force(MU, u) for u in ASKED]
    np.testing.assert_allclose(answer.channels["Fz"], expected, rtol=1e-6)  # six digits in the file
    assert answer.channels["travel"].tolist() == list(ASKED) and answer.units["Fz"] == "N"
    assert list((tmp_path / "kept").iterdir()) == []


def test_a_pattern_means_no_answer_and_keeps_what_was_reached(tmp_path):
    with pytest.raises(SimulationFailed, match="increment size smaller than minimum") as failed:
        backend(tmp_path)({"mu": MU, "D1": 1.0}, Case("deep", Programme.ramp((1.0, 8.0, 9.5))))
    assert failed.value.cause == "step_limit"
    np.testing.assert_allclose(failed.value.partial.channels["travel"], [1.0, 8.0])
    (folder,) = (tmp_path / "kept").iterdir()
    assert (folder / "job.inp").exists() and "ERROR" in (folder / "stdout.txt").read_text()


@pytest.mark.parametrize(("more", "words"), [
    ({"failure": None}, "exit code 201"),  # nobody said that this line is an answer
    ({"failure": Failure("never")}, "exit code 201"),
    ({"outputs": (output("calculix", "job.dat", set="BALL", column="fy", at="step"),), "failure": Failure("never")},
     "there is no 'fy' for set 'BALL'"),
    ({"command": (sys.executable, "-c", "import sys; sys.exit('licence')")}, "licence"),
    ({"command": (sys.executable, "-c", "pass")}, "exit code 0, job.dat: there is no such file after the run"),
])  # fmt: skip
def test_anything_else_is_a_crash_in_words(tmp_path, more, words):
    with pytest.raises(RuntimeError, match=re.escape(words)):
        backend(tmp_path, **more)({"mu": MU, "D1": 1.0}, Case("deep", Programme.ramp((1.0, 9.5))))
    assert len(list((tmp_path / "kept").iterdir())) == 1


def test_a_run_that_takes_too_long_is_stopped(tmp_path):
    (tmp_path / "job.inp").write_text(DECK)
    known = backend(tmp_path)
    slow = load_deck(known.deck, (sys.executable, "-c", "import time; time.sleep(60)"), tmp_path, None, 0.5)
    with pytest.raises(RuntimeError, match=r"time-out of 0\.5 s"):
        slow({"mu": MU, "D1": 1.0}, CASE)


def test_keys_hold_the_contents_of_deck_command_and_readers_and_nothing_else(tmp_path):
    def key(deck=DECK, case=CASE, **more):
        b = backend(tmp_path, deck, **more)
        return run_key(b, *b.canonical({"mu": MU, "D1": 1.0}, case))

    first = key()
    assert first == key()
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    there = backend(moved)
    assert run_key(there, *there.canonical({"mu": MU, "D1": 1.0}, CASE)) == first
    assert key(case=Case("other name", Programme.ramp(ASKED, 3.0))) == first  # nothing in the deck knows a speed
    (tmp_path / "mesh.inc").write_text("1")
    changed = [
        key(DECK + "** a remark\n"),
        key(failure=Failure("x")),
        key(outputs=(output("calculix", "job.dat", set="BALLNODES", column="fx", at="step"),)),
        key(files=("mesh.inc",)),
        key(command=(sys.executable, str(PROGRAM), "job", "-v")),
        key(DECK + "{speed}"),
        key(DECK + "{speed}", case=Case("quick", Programme.ramp(ASKED, 3.0))),
    ]
    (tmp_path / "mesh.inc").write_text("2")
    changed += [key(files=("mesh.inc",))]
    assert len({first, *changed}) == len(changed) + 1


def test_settings_are_filled_in_and_none_is_ignored(tmp_path):
    b = backend(
        tmp_path, DECK + "{mesh.size[um]} {point[1]} {name}\n", settings=("mesh.size", "point", "name", "other")
    )
    good = {"mesh": {"size": "0.3 mm"}, "point": [1.0, 2.0], "name": "coarse"}
    b.check(Case("top", CASE.programme, good))
    lines = b.filled({"mu": MU, "D1": 1.0}, Case("top", CASE.programme, good))["job.inp"]
    assert lines[-1][1] == "300 2 coarse\n"
    with pytest.raises(ValueError, match=r"other = 3: no placeholder of job\.inp uses this setting"):
        b.check(Case("top", CASE.programme, {**good, "other": 3}))
    with pytest.raises(ValueError, match="point: a placeholder of the templates uses this setting, which has no value"):
        b.check(Case("top", CASE.programme, {"mesh": {"size": 1}, "name": "x"}))


def test_other_files_go_along_unchanged(tmp_path):
    (tmp_path / "mesh").mkdir()
    (tmp_path / "mesh" / "fine.inc").write_bytes(b"{not filled}\r\n\xff")
    code = "import pathlib, sys; sys.exit(repr(pathlib.Path('mesh/fine.inc').read_bytes()))"
    with pytest.raises(RuntimeError, match=re.escape(repr(b"{not filled}\r\n\xff"))):
        backend(tmp_path, files=("mesh/fine.inc",), command=(sys.executable, "-c", code))({"mu": MU, "D1": 1.0}, CASE)


# ----------------------------------------------------------------------------------------------------------- studies


@pytest.mark.parametrize("reader", OUTPUTS)
def test_each_reader_of_a_study_finds_the_closed_form(tmp_path, reader):
    plan = make_plan(load_study(study(tmp_path / "study", reader) / "study.toml"))
    (case,) = plan.cases
    answer = plan.backend({"mu": MU, "D1": 1.0}, case)
    expected = [hertz_program.force(MU, u) for u in case.programme.asked_mm]
    np.testing.assert_allclose(answer.channels["Fz"], expected, rtol=1e-6)


def test_a_study_of_a_deck_finds_the_modulus_that_made_its_data(tmp_path):
    """And what is there is not computed again."""
    folder = study(tmp_path / "study")
    known = []
    for _ in range(2):
        assert main(["run", str(folder), "--jobs", "1"]) == 0
        found = json.loads((folder / "results" / "results.json").read_text())
        (candidate,) = found["searches"][0]["candidates"]
        assert candidate["verified"] and candidate["values"]["mu"] == pytest.approx(MU, rel=2e-3)
        assert found["counts"]["failed"] == found["counts"]["crashed"] == 0
        known.append(found["counts"]["from_store"] / found["counts"]["done"])
    assert known == [0.0, 1.0]


def test_a_deck_that_changes_is_read_again_and_not_while_a_study_runs(tmp_path):
    folder = study(tmp_path / "study", files=("command = [", 'files = ["mesh.inc"]\ncommand = ['))
    (folder / "mesh.inc").write_text("1")
    first = make_plan(load_study(folder / "study.toml"))
    (folder / "mesh.inc").write_text("2")
    second = make_plan(load_study(folder / "study.toml"))
    assert first.backend.fingerprint != second.backend.fingerprint
    with pytest.raises(RuntimeError, match=r"mesh\.inc has changed since the study was read"):
        first.backend({"mu": MU, "D1": 1.0}, first.cases[0])
    (folder / "job.inp").write_text(DECK + "** changed\n")
    with pytest.raises(ValueError, match="files of the deck have changed since the study was read"):
        type(second.source).load.__wrapped__(second.source)  # as another process does


def test_check_shows_the_filled_deck_and_runs_nothing(tmp_path, capsys):
    command = (json.dumps(str(PROGRAM)), '"never.py"')
    folder = study(tmp_path / "study", command=command)
    (folder / "never.py").write_text("import pathlib; pathlib.Path('ran').touch()")
    assert main(["check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "input files, not run, with mu = 0.013, D1 = 1:" in said and "job.inp:3: 6.500000000e-03, 1" in said
    assert "job.inp:7: BALLNODES, 2, 2, -2" in said and not list(tmp_path.rglob("ran"))


def test_parameters_are_declared_once_with_units_of_their_values(tmp_path):
    text = 'D1 = { low = 0.5, high = 2, unit = "1/MPa", bounds = [0.1, 5], description = "compressibility" }'
    plan = make_plan(load_study(study(tmp_path / "study", fixed=('D1 = { value = "1 1/MPa" }', text)) / "study.toml"))
    mu, d1 = plan.backend.parameters
    assert (mu.unit, d1.unit, d1.description, d1.low, d1.high) == ("MPa", "1/MPa", "compressibility", 0.1, 5.0)
    assert mu.low < 0.006 / 100 and mu.high > 0.02 * 100  # a modulus may be scaled
    assert plan.group.reference == "mu"


@pytest.mark.parametrize(("old", "new", "words"), [
    ('template = ["job.inp"]', 'template = ["jib.inp"]', "jib.inp: there is no such file beside the study"),
    ('template = ["job.inp"]\n', "", "backend: outputs belongs to a program with a template"),
    ("failed = '\\*ERROR'", "failed = '('", "backend.failed.pattern = '(': is no regular expression"),
    ('reader = "calculix"', 'reader = "calculx"', "choose from table, regex, calculix, febio, or a Python function"),
    ('set = "BALLNODES", ', "", "the reader 'calculix' needs set"),
    ('column = "fy"', 'column = "fy", unit = "mm"', "'mm' is not a unit of the kind 'N'"),
    ('column = "fy"', 'column = "fy", pattern = "x"', "pattern is no key of the reader 'calculix'"),
    ('D1 = { value = "1 1/MPa" }', 'D1 = { value = "1 1/MPa" }\nnu = { value = 0.3 }', "parameter 'nu' stands nowhere"),
    ('value = "1 1/MPa"', 'value = "1 1/MPa", bounds = [2, 3]', "bounds = [2, 3] do not hold 1 to 1 1/MPa"),
    ('high = "20 kPa"', 'high = "20 mm"', "'mm' is not a unit of the kind 'MPa'"),
    ("[backend.outputs]", '[backend.settings]\nh = 3\n[backend.outputs]', "h = 3: no placeholder of job.inp uses this"),
])  # fmt: skip
def test_a_study_that_cannot_be_is_refused_with_file_line_and_key(tmp_path, old, new, words):
    folder = study(tmp_path / "study", change=(old, new))
    with pytest.raises(StudyError) as error:
        make_plan(load_study(folder / "study.toml"))
    said = "\n".join(error.value.problems)
    assert words in said and re.match(rf"{re.escape(str(folder))}/study.toml:\d+: ", said), said


def test_a_backend_that_is_no_deck_declares_its_own_parameters(tmp_path):
    folder = study(tmp_path / "study")
    text = (folder / "study.toml").read_text()
    start, end = text.index("[backend]"), text.index("[parameters]")
    text = text[:start] + '[backend]\nuse = "fem_backend.backend:BACKEND"\n' + text[end:]
    (folder / "study.toml").write_text(text.replace('low = "6 kPa"', 'low = "6 kPa", unit = "MPa"'))
    with pytest.raises(StudyError, match=r"parameters\.mu\.unit = 'MPa': belongs to a parameter of a template"):
        load_study(folder / "study.toml")


def test_a_deck_may_come_from_anywhere_the_study_lies(tmp_path):
    folder = study(tmp_path / "study")
    shutil.copytree(folder, tmp_path / "copy")
    keys = [
        run_key(p.backend, *p.backend.canonical(p.values(np.array([0.5])), p.cases[0]))
        for p in (make_plan(load_study(f / "study.toml")) for f in (folder, tmp_path / "copy"))
    ]
    assert keys[0] == keys[1]
