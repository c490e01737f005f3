"""Small commands and what a terminal shows: first steps, examples, comparison, figures, colours, nearest names."""

import copy
import io
import json
import webbrowser

import pytest
from report_fixture import complete

import rso
from rso.api.exporting import bibtex
from rso.api.run_result import RunResult
from rso.cli import doctor, main, output
from rso.cli.answer import condensed, estimate_text, interval_in_unit, number_text, verdict_lines
from rso.cli.compare import study_differences
from rso.evaluation.store import RunStore
from rso.report.calibration.use import use_section
from rso.report.picture_files import every


@pytest.fixture
def results(tmp_path):
    """A folder of results; the study beside it is text alone."""
    (tmp_path / "study.toml").write_text('[study]\ntitle = "x"\n', "utf-8")
    return written(tmp_path, complete())


MISSED = {"experiment": "force_8mm", "verdict": "no", "p_value": 1e-5, "why": None}


def missed():
    """Results with an experiment that is not predicted."""
    return {**complete(), "predictions": [MISSED]}


def written(folder, found):
    (folder / "results").mkdir(parents=True)
    (folder / "results" / "results.json").write_text(json.dumps(found), "utf-8")
    return folder


def test_rso_alone_says_the_next_three_steps(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    said = capsys.readouterr().out
    assert [line.split()[1] for line in said.splitlines()[1:4]] == ["example", "new", "run"]
    (tmp_path / "study.toml").write_text("", "utf-8")
    assert main([]) == 0
    assert [line.split()[1] for line in capsys.readouterr().out.splitlines()[1:4]] == ["check", "run", "status"]


@pytest.mark.parametrize(
    "words, near",
    [
        (["rnu", "x"], "did you mean run?"),
        (["run", "x", "--strct"], "did you mean --strict?"),
        (["simulate"], "--help"),
    ],
)
def test_a_typing_mistake_is_answered_with_the_nearest_word(capsys, words, near):
    with pytest.raises(SystemExit, match="2"):
        main(words)
    said = capsys.readouterr().err
    assert near in said and "choose from" not in said


def test_an_example_is_a_study_that_can_be_checked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["example"]) == 0
    assert "gel_slab" in capsys.readouterr().out
    assert main(["example", "gel_slab"]) == 0 and main(["status", "gel_slab"]) == 0
    assert "next: rso check gel_slab" in capsys.readouterr().out
    before = (tmp_path / "gel_slab/study.toml").read_bytes()
    assert main(["example", "gel_slab"]) == 2 and (tmp_path / "gel_slab/study.toml").read_bytes() == before
    assert main(["example", "gel_slap"]) == 2
    assert "did you mean 'gel_slab'" in capsys.readouterr().err


def test_the_answer_has_a_mark_for_what_is_known_open_and_missed():
    marks = dict((text.split()[0], mark) for mark, text in verdict_lines(missed()))
    assert marks["μ"] == "good" and marks["D₁"] == "open" and marks["force_8mm"] == "bad"
    assert list(verdict_lines({})) == []  # nothing is finished yet


@pytest.mark.parametrize("verdict, words", [("weakly", "is weakly determined: "), ("not", "is not determined: ")])
def test_what_is_open_is_called_as_in_the_report(verdict, words):
    found = missed()
    (row,) = (p for p in found["identification"]["parameters"] if p["parameter"] == "D1")
    row["verdict"] = verdict
    (line,) = (text for _, text in verdict_lines(found) if text.startswith("D₁"))
    assert words in line


def test_nothing_agrees_with_data_that_the_model_misses():
    """The terminal said of one and the same run that values agree with the data and that the model misses these."""
    found = missed()
    for scale, p, agrees in (
        (1.0, 0.5, True),
        (1.4, 0.2, True),
        (1.4, 1e-6, False),
        (1.4, None, True),
        (3.8, 0.5, False),
    ):
        found["identification"] |= {"scale": scale, "p_value": p}
        open_lines = [t for mark, t in verdict_lines(found) if mark == "open"]
        assert open_lines and all(("agrees with the data" in t) == agrees for t in open_lines)


@pytest.mark.parametrize(
    "value, span, text",
    [
        (0.0102, (0.0098, 0.0106), "10.20 kPa"),
        (0.0102, (0.0060, 0.0140), "10.2 kPa"),
        (2.5, (2.4, 2.6), "2.50 MPa"),
        (12345.0, (12300.0, 12400.0), "12345 MPa"),
        (0.49598, (0.394, 0.4976), "0.496 MPa"),  # 0.50 is not in its interval
        (0.49995, (0.3425, 0.49996), "0.500 MPa"),  # as the end of its interval
    ],
)
def test_values_have_the_digits_that_are_known(value, span, text):
    assert estimate_text(value, span, "MPa") == text


def test_numbers_have_no_exponent_where_people_write_none():
    assert [number_text(x, 3) for x in (0.0, 123456.0, 0.00012345, 1e-9)] == ["0", "123456", "0.000123", "1.00e-09"]
    assert interval_in_unit((0.0006, 0.0481), "1/MPa") == "0.000600 to 0.0481 MPa⁻¹"
    assert interval_in_unit((0.0119991, 0.0120012), "MPa") == "11.999 to 12.001 kPa"  # ends that differ look so


def test_two_runs_are_compared(results, tmp_path, capsys):
    other = copy.deepcopy(complete())
    row = next(p for p in other["identification"]["parameters"] if p["parameter"] == "mu")
    row["interval"], row["value"] = [0.02, 0.03], 0.025
    other["parameters"][0]["low"] = 0.001
    folder = written(tmp_path / "other", other)
    assert main(["compare", str(results), str(results)]) == 0
    same = capsys.readouterr().out
    assert "are the same" in same
    assert "✓ μ" in same and "? D₁" in same  # a tick is of what both determine, as elsewhere
    assert main(["compare", str(results), str(folder / "results" / "results.json")]) == 0
    said = capsys.readouterr().out
    assert "✗ μ:" in said and "do not overlap" in said and "✓ μ" not in said
    assert main(["compare", "--json", str(results), str(folder)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["disjoint"] == ["mu"] and len(told["differences"]) == 1
    assert main(["compare", str(results), str(tmp_path / "nothing")]) == 2
    assert study_differences(complete(), complete()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r["experiments"][0]["settings"].update(specimen={"shape": "slab", "thickness": 9.0}), "specimen.th"),
        (lambda r: r["experiments"][0]["settings"].clear(), "not stated"),
        (lambda r: r["experiments"][0]["measured"].update(sigma=[1.0]), "errors of the readings"),
        (lambda r: r["experiments"][0]["measured"].update(value=[1.0]), "though the files are the same"),
        (lambda r: r["backend"].update(numerics=-1), "model: "),
        (lambda r: r["provenance"].update(rso="other"), "version of rso"),
        (lambda r: r["provenance"].update(study_sha256="other"), "study files"),
    ],
)
def test_whatever_differs_between_two_runs_is_said(change, words):
    """Nobody reads that all is the same where a setting, an error or the program is another."""
    one, other = complete(), copy.deepcopy(complete())
    for r in (one, other):
        r["experiments"][0]["settings"] = {"specimen": {"shape": "slab", "thickness": 5.0}}
    change(other)
    for pair in ((one, other), (other, one)):
        said = study_differences(*pair)
        assert words in " ".join(said)


def test_a_page_is_opened_and_one_that_is_not_there_is_named(results, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(webbrowser, "open", lambda uri: asked.append(uri) or True)
    assert main(["open", str(results)]) == 2
    assert "rso run" in capsys.readouterr().err and not asked
    (results / "results/report.html").write_text("<html>", "utf-8")
    assert main(["open", str(results)]) == 0 and asked[0].endswith("results/report.html")
    assert main(["open", str(results), "--page", "diagnosis"]) == 2
    assert "rso diagnose" in capsys.readouterr().err


def test_a_figure_is_written_as_a_file(results, capsys):
    assert main(["plot", str(results)]) == 0
    assert "curve-0:" in capsys.readouterr().out
    file = results / "fit.svg"
    assert main(["plot", str(results), "curve-0", "--to", str(file)]) == 0
    assert "<svg" in file.read_text("utf-8")
    assert main(["plot", str(results), "curve-0", "--to", str(results / "fit.gif")]) == 2
    assert ".png" in capsys.readouterr().err
    assert main(["plot", str(results), "curve"]) == 2
    assert "did you mean 'curve-0'" in capsys.readouterr().err
    path = results / "results/results.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | {"schema": 99}), "utf-8")
    assert main(["plot", str(results), "curve-0", "--to", str(file)]) == 2
    assert "has schema 99" in capsys.readouterr().err


@pytest.mark.parametrize("suffix, head", [(".pdf", b"%PDF"), (".png", b"\x89PNG")])
def test_a_figure_has_the_format_of_its_ending(results, suffix, head):
    file = results / f"fit{suffix}"
    assert main(["plot", str(results), "curve-0", "--to", str(file)]) == 0
    assert file.read_bytes().startswith(head)


def test_a_machine_is_examined(monkeypatch, capsys):
    assert main(["doctor", "--fast"]) == 0
    assert "✓ numpy" in capsys.readouterr().out
    monkeypatch.setattr(doctor, "EXAMINED_LIBRARIES", ("not-there-at-all",))
    assert main(["doctor", "--fast", "--json"]) == 1
    states = {row["text"]: row["state"] for row in json.loads(capsys.readouterr().out)}
    assert states["not-there-at-all is not installed: pip install not-there-at-all"] == "bad"


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_can_complete_every_command(capsys, shell):
    pytest.importorskip("shtab")
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("diagnose", "compare", "--strict"))


class Terminal(io.StringIO):
    """A terminal of some encoding."""

    def __init__(self, encoding):
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self):
        return self._encoding

    def isatty(self):
        return True


@pytest.mark.parametrize(
    "encoding, variables, line",
    [
        ("utf-8", {"TERM": "xterm"}, "  \x1b[31m✗\x1b[0m no\n"),
        ("utf-8", {"TERM": "xterm", "NO_COLOR": "1"}, "  ✗ no\n"),
        ("utf-8", {"TERM": "dumb"}, "  ✗ no\n"),
        ("latin-1", {"NO_COLOR": "1"}, "  x no\n"),
    ],
)
def test_marks_have_colours_where_they_are_wanted(monkeypatch, encoding, variables, line):
    monkeypatch.delenv("NO_COLOR", raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    stream = Terminal(encoding)
    monkeypatch.setattr("sys.stdout", stream)
    output.marked_line("bad", "no")
    assert stream.getvalue() == line


def test_what_a_stranger_wrote_cannot_colour_a_line(monkeypatch):
    stream = Terminal("utf-8")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr("sys.stdout", stream)
    output.marked_line("good", "a\x1b[31mb")
    assert "a\\x1b[31mb" in stream.getvalue()


def test_errors_are_wrapped_at_words(monkeypatch):
    """A path that is longer than a line stays whole; everything else fits."""
    monkeypatch.setattr(output, "_columns", lambda: 40)
    path = "measured/" + "long-name-" * 6 + ".csv"
    text = f"study.toml:3: data = '{path}': is not there, choose another one of the same folder"
    lines = output.wrapped(text, Terminal("utf-8")).split("\n")
    assert all(len(line) <= 40 or path in line for line in lines) and any(path in line for line in lines)
    assert " ".join(line.strip() for line in lines) == text


def test_the_condensed_answer_is_strict_json():
    told = json.loads(json.dumps(condensed(missed()), allow_nan=False))
    assert told["parameters"]["mu"]["unit"] == "MPa" and told["predictions"][0]["experiment"] == "force_8mm"


def test_figures_and_citations_are_exported(results):
    found = RunResult(results / "results", complete())
    text = bibtex(found)
    assert "@software{rso," in text and "{deb2002," in text
    assert "conn2000" not in text and rso.__version__ in text  # no Gauss–Newton was run
    assert text.count("{") == text.count("}")
    drawn = every(complete())
    assert drawn["curve-0.svg"].startswith("<") and drawn["curve-0.pdf"].startswith(b"%PDF")


def test_a_colleagues_folder_of_results_is_read_without_its_study(results, capsys):
    """What needs the study is not proposed for it."""
    place = results / "results"
    assert main(["status", str(place)]) == 0
    said = capsys.readouterr().out
    assert "✓ μ" in said and said.splitlines()[-1] == f"  next: rso open {place}"
    assert main(["plot", str(place)]) == 0 and "curve-0" in capsys.readouterr().out


def test_the_row_that_looks_like_a_header_is_named(tmp_path, capsys):
    rows = ["Report;Gel 7", "", "Weg Traverse;Kraft 1", "um;mN", *(f"{100 * k};{k**1.5:.3f}" for k in range(20))]
    (tmp_path / "test.csv").write_text("\n".join(rows), "utf-8")
    assert (
        main(["new", str(tmp_path / "test.csv"), "--slab", "5", "--ball", "2", "--out", str(tmp_path / "s.toml")]) == 2
    )
    assert "its header seems to be line 3: 'Weg Traverse', 'Kraft 1'" in capsys.readouterr().err


def test_the_report_says_how_to_use_it():
    """Commands have the study's file; nothing is offered before there is an answer."""
    found = complete()
    rows = {cell.text for s in use_section(found) for b in s.blocks for row in b.rows for cell in row}
    file = found["study"]["file"]
    assert {f"rso export {file} --cards", f"rso next {file}", found["provenance"]["command"]} <= rows
    assert use_section({**found, "stage": "design"}) == ()


def test_damaged_results_are_called_so(tmp_path, capsys):
    """Not taken for a study that has not been run."""
    with RunStore(tmp_path / "results"):
        (tmp_path / "study.toml").write_text('title = "s"\n')
    (tmp_path / "results/results.json").write_text("{")
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "results.json: is damaged" in capsys.readouterr().err
    assert main(["status", str(tmp_path / "study.toml")]) == 0
    assert "results.json is damaged" in capsys.readouterr().out


def test_what_is_fixed_is_compared_by_its_value_alone(tmp_path, capsys):
    """Two values of D1 that were stated contradict nothing, nor do the Poisson's ratios that follow from them."""
    for name, D1, nu in (("a", 2.0, 0.495), ("b", 0.3, 0.45)):
        (tmp_path / name).mkdir()
        derived = [
            {"name": "E", "letter": "E", "unit": "MPa", "value": 0.03, "interval": [0.028, 0.032], "known": True},
            {"name": "nu", "letter": "ν", "unit": "1", "value": nu, "interval": [nu, nu], "known": False,
             "follows_from": ["D1"]},
        ]  # fmt: skip
        found = {
            "schema": 1,
            "parameters": [{"name": "D1", "unit": "1/MPa", "fixed": D1}],
            "identification": {"parameters": [], "derived": derived},
        }
        (tmp_path / name / "results.json").write_text(json.dumps(found))
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    lines = capsys.readouterr().out.split("What differs")[0].splitlines()
    assert any("E: A" in v and "overlap" in v for v in lines)
    assert any("D₁: A" in v and v.endswith("not the same") for v in lines)
    assert not any("do not overlap" in v or "no interval" in v or "ν" in v or "nu" in v for v in lines)
