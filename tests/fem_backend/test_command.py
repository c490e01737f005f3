"""python -m fem_backend: request in, response out, exit codes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fem_backend.__main__
from fem_backend.__main__ import main, request_schema
from fem_backend.backend import BACKEND
from rso.contract import CAUSES, Case, Programme, Response

ROOT = Path(__file__).parents[2]
REQUEST = {
    "values": {"mu": 0.01, "D1": 5.8},
    "case": {
        "name": "middle_point",
        "programme": {"time_s": [0, 8], "travel_mm": [0, 4], "asked_mm": [0.5, 1]},
        "settings": {"mesh": {"mesher": "mapped", "n": 6, "slip": 0.3}, "point": [0, 0]},
    },
}


def ask(tmp_path: Path, request: object) -> tuple[int, dict | None]:
    source, target = tmp_path / "request.json", tmp_path / "response.json"
    source.write_text(request if isinstance(request, str) else json.dumps(request))
    code = main([str(source), str(target)])
    return code, json.loads(target.read_text()) if target.exists() else None


def changed(**paths: object) -> dict:
    """The request with values at dotted paths (written with double underscores) changed."""
    out = json.loads(json.dumps(REQUEST))
    for path, value in paths.items():
        *folders, last = path.split("__")
        place = out
        for name in folders:
            place = place[name]
        place[last] = value
    return out


def test_request_and_response_from_the_shell(tmp_path):
    (tmp_path / "in.json").write_text(json.dumps(REQUEST))
    done = subprocess.run(
        [sys.executable, "-m", "fem_backend", str(tmp_path / "in.json"), str(tmp_path / "out.json")],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    answer = json.loads((tmp_path / "out.json").read_text())
    assert answer["status"] == "done"
    here = BACKEND(REQUEST["values"], Case.from_json(REQUEST["case"]))
    back = Response.from_json(answer)
    for name, channel in here.channels.items():  # the file holds every bit
        assert back.channels[name].tobytes() == channel.tobytes(), name
    np.testing.assert_allclose(answer["channels"]["time"], [1.0, 2.0], rtol=1e-15)
    assert answer["channels"]["Fz"][1] > answer["channels"]["Fz"][0] > 0


def test_brackets_without_end_are_a_bad_request(tmp_path, capsys):
    code, response = ask(tmp_path, 100_000 * "[" + 100_000 * "]")
    assert code == 2 and response is None
    assert "request.json: request: brackets are nested too deeply" in capsys.readouterr().err


def test_bad_request_from_the_shell_has_no_traceback(tmp_path):
    (tmp_path / "in.json").write_text(json.dumps(changed(case__settings__support={"kind": "glue"})))
    done = subprocess.run(
        [sys.executable, "-m", "fem_backend", str(tmp_path / "in.json"), str(tmp_path / "out.json")],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2 and not (tmp_path / "out.json").exists()
    assert "Traceback" not in done.stderr
    assert "support.kind" in done.stderr and "glue" in done.stderr and "fixed" in done.stderr


def test_a_run_loads_nothing_that_draws():
    look = "import sys, fem_backend.__main__; print('matplotlib' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True).stdout
    assert said == "False\n"


def test_schema(capsys):
    assert main(["--schema"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(json.dumps(request_schema()))
    assert (told["name"], told["numerics"]) == (BACKEND.name, BACKEND.numerics)
    assert {p["name"]: p["unit"] for p in told["parameters"]} == {p.name: p.unit for p in BACKEND.parameters}
    assert told["channels"] == dict(BACKEND.channels)
    assert set(told["request"]["values"]) == {p.name for p in BACKEND.parameters if p.default is None}
    Case.from_json(told["request"]["case"])  # the example is a case


def test_schema_describes_the_response(tmp_path):
    _, answer = ask(tmp_path, REQUEST)
    told = request_schema()["response"]
    assert set(told["channels"]) <= set(answer["channels"]) == set(BACKEND.channels)
    assert {"status", "channels", "units", "error"} <= set(answer) & set(told)


@pytest.mark.parametrize(
    "request_,word",
    [
        ("{no json", "Expecting"),
        ([1, 2], "values"),
        ({"values": {}}, "case"),
        ({**REQUEST, "more": 1}, "more"),
        (changed(values={"mu": 0.01}), "D1"),
        (changed(values__E=3.0), "'E'"),
        (changed(values__mu=-1.0), "mu"),
        (changed(values__mu="soft"), "soft"),
        (changed(case__programme={"time_s": [0, 1]}), "travel_mm"),
        (changed(case__programme__asked_mm=[5]), "asked_mm"),
        (changed(case__settings__colour="red"), "colour"),
        (changed(case__settings__specimen="cube"), "specimen"),
        (changed(case__speed=1), "speed"),
    ],
)
def test_bad_request_is_exit_code_2_and_says_why(tmp_path, capsys, request_, word):
    code, answer = ask(tmp_path, request_)
    said = capsys.readouterr().err
    assert code == 2 and answer is None
    assert word in said and "request.json" in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "place,value,words",
    [
        ("case", 5, "case = 5"),
        ("case", None, "case = None"),
        ("case", [1], "case = [1]"),
        ("values__mu", None, "'mu' (MPa) has no value"),
        ("values__mu", [1], "mu = [1]: a number"),
        ("values__mu", True, "mu = True: a number"),
        ("values__mu", "0.01", "mu = '0.01': a number"),
        ("case__programme__time_s", 5, "time_s = 5: a list of numbers"),
        ("case__programme__time_s", None, "time_s = None: a list of numbers"),
        ("case__programme__time_s", "01", "time_s = '01': a list of numbers"),
        ("case__programme__time_s", [0, [1]], "time_s[1] = [1]: a number"),
        ("case__programme__time_s", [False, True], "time_s[0] = False: a number"),
        ("case__programme__asked_mm", 0.5, "asked_mm = 0.5: a list of numbers"),
        ("case__programme__asked_s", None, "asked_s = None: a list of numbers"),
        ("case__programme__asked_s", [[1]], "asked_s[0] = [1]: a number"),
        ("case__programme", None, "case.programme"),
        ("case__settings", 5, "case.settings = 5: a table"),
        ("case__settings", [1, 2], "case.settings = [1, 2]: a table"),
        ("case__artefacts", [1], "case.artefacts = [1]: a table"),
        ("case__artefacts", {"mesh": 5}, "case.artefacts.mesh = 5: the SHA-256 of the artefact, a text"),
        ("case__objects", 5, "case.objects = 5: a text"),
        ("case__name", 5, "case.name = 5: a text"),
    ],
)
def test_a_wrong_type_is_exit_code_2_and_names_key_value_and_what_is_expected(tmp_path, capsys, place, value, words):
    code, answer = ask(tmp_path, changed(**{place: value}))
    said = capsys.readouterr().err
    assert code == 2 and answer is None and words in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "key,value,words",
    [
        ("earlier", 70.0, "earlier: travel 70 mm: less than 70 mm is expected, as far as an ellipsoid"),
        ("indenter", {"radius": 20.0}, "indenter.radius = 20.0 mm: this specimen is meshed for indenters much"),
        ("indenter", {"radius": 20.0}, "at most 17.5 mm"),
        ("indenter", {"radius": 0}, "indenter.radius = 0.0 mm: must be positive"),
        ("indenter", {"radius": 0.8}, "no mesh is made for so small a ball on this specimen. At least 0.857 mm"),
        ("material", {"prony": [[0.5, 1], [0.6, 2]]}, "material.prony = [[0.5, 1.0], [0.6, 2.0]]: g >= 0"),
        ("material", {"law": "ogden", "ogden": [[0, 0.2]]}, "material.ogden = [[0.0, 0.2]]: exponents"),
    ],
)
def test_a_setting_out_of_range_names_key_value_and_limit(tmp_path, capsys, key, value, words):
    code, answer = ask(tmp_path, changed(**{f"case__settings__{key}": value}))
    assert code == 2 and answer is None and words in capsys.readouterr().err


@pytest.mark.parametrize(
    "time,travel,asked,words",
    [
        ([0, 1], [0, float("nan")], [0.1], "travel_mm must be finite, got [0.0, nan]"),
        ([0, float("inf")], [0, 0.4], [0.1], "time_s must be finite, got [0.0, inf]"),
        ([0, 1], [0, -0.4], [0.1], "travel_mm must go down, which counts as positive, got [0.0, -0.4]"),
        ([0, 1], [0, 0.4], [0.2, 0.1], "asked_mm must increase within (0, 0.4] mm, got [0.2, 0.1]"),
        ([1, 0], [0, 0.4], [0.1], "time_s must increase, got [1.0, 0.0]"),
        ([0, 1, 2], [0, 0.4], [0.1], "time_s (3) and travel_mm (2) need the same length >= 2"),
    ],
)
def test_a_programme_that_is_none_names_its_key_and_values(time, travel, asked, words):
    with pytest.raises(ValueError) as error:
        Programme(tuple(time), tuple(travel), tuple(asked))
    assert words in str(error.value)


def test_only_a_travel_through_the_whole_specimen_is_refused():
    """How far below its thickness a body can be pressed is found by the run, not foreseen."""
    settings = {**REQUEST["case"]["settings"], "specimen": {"semi_axes": [30, 24, 18]}, "indenter": {"radius": 2.4}}

    def case(depth: float) -> Case:
        programme = {"time_s": [0, 8], "travel_mm": [0, depth], "asked_mm": [depth]}
        return Case.from_json({"name": "x", "programme": programme, "settings": settings})

    BACKEND.check(case(35.999))
    with pytest.raises(ValueError, match=r"travel_mm: travel 36 mm: less than 36 mm is expected, as far as"):
        BACKEND.check(case(36.0))


def test_values_that_are_a_list_are_a_bad_request(tmp_path):
    assert ask(tmp_path, changed(values=["mu", "D1"]))[0] == 2


def test_response_that_cannot_be_written_is_exit_code_2(tmp_path):
    (tmp_path / "request.json").write_text(json.dumps(changed(values__mu=0.011)))
    assert main([str(tmp_path / "request.json"), str(tmp_path / "missing" / "response.json")]) == 2


@pytest.mark.parametrize("where", ["response", "--vtu", "--pictures"])
def test_an_answer_without_a_place_is_refused_before_it_is_solved(tmp_path, capsys, monkeypatch, where):
    monkeypatch.setattr("fem_backend.__main__.response_to", lambda *_: pytest.fail("solved for nothing"))
    (tmp_path / "request.json").write_text(json.dumps(REQUEST))
    (tmp_path / "file").write_text("no folder")
    target = tmp_path / ("missing" if where == "response" else ".") / "out.json"
    more = [] if where == "response" else [where, str(tmp_path / "file")]
    assert main([str(tmp_path / "request.json"), str(target), *more]) == 2
    said = capsys.readouterr().err
    assert ("missing" if where == "response" else "file") in said and len(said.strip().splitlines()) == 1


def test_a_folder_in_the_place_of_the_response_is_refused_before_it_is_solved(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("fem_backend.__main__.response_to", lambda *_: pytest.fail("solved for nothing"))
    (tmp_path / "request.json").write_text(json.dumps(REQUEST))
    assert main([str(tmp_path / "request.json"), str(tmp_path)]) == 2
    assert f"{tmp_path}: a folder; the response needs the name of a file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["mesh", "anchor"])
@pytest.mark.parametrize("content", [b"", b"no npz", None], ids=["empty", "text", "missing"])
def test_an_artefact_that_cannot_be_read_is_named(tmp_path, capsys, name, content):
    sha = "ab" * 32
    path = tmp_path / sha[:2] / sha
    path.parent.mkdir()
    if content is not None:
        path.write_bytes(content)
    code, answer = ask(tmp_path, changed(case__artefacts={name: sha}, case__objects=str(tmp_path)))
    said = capsys.readouterr().err
    assert code == 2 and answer is None and len(said.strip().splitlines()) == 1
    assert f"the artefact {name!r} at {path} cannot be read" in said


def test_missing_file_and_wrong_number_of_arguments(tmp_path, capsys):
    assert main([str(tmp_path / "none.json"), str(tmp_path / "out.json")]) == 2
    assert "none.json" in capsys.readouterr().err
    for arguments in ([], ["a"], ["a", "b", "c"], ["--scheme", "x", "y"]):
        assert main(arguments) == 2
        assert "usage" in capsys.readouterr().err


def test_failed_run_is_an_answer_with_what_was_reached(tmp_path):
    """6 mm is more than small strains can follow: exit code 0, status failed, the curve so far."""
    small = {"case__settings__material": {"law": "linear_elastic"}}
    programme = {"time_s": [0, 12], "travel_mm": [0, 6], "asked_mm": [0.5, 1, 6]}
    request = changed(**small, case__programme=programme)
    code, answer = ask(tmp_path, request)
    assert code == 0 and answer["status"] == "failed"
    assert answer["cause"] in CAUSES and "mm" in answer["reason"] and answer["history"]
    assert answer["channels"]["travel"] == [0.5, 1]
    _, whole = ask(tmp_path, changed(**small))
    # another mesh, as the run was asked to go deep: the same within what both state
    off = np.abs(np.subtract(answer["channels"]["Fz"], whole["channels"]["Fz"]))
    assert np.all(off <= np.add(answer["error"]["Fz"], whole["error"]["Fz"]))
    assert answer["units"] == whole["units"] and set(answer["error"]) == set(whole["error"])


def test_failure_before_any_point_has_no_channels(tmp_path):
    code, answer = ask(tmp_path, changed(values={"mu": 1.0, "D1": 1e-3}))
    assert code == 0 and answer["status"] == "failed" and answer["cause"] == "not_supported"
    assert "channels" not in answer


def test_who_reads_the_schema_may_stop():
    call = [sys.executable, "-m", "fem_backend", "--schema"]
    with subprocess.Popen(call, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as asked:
        asked.stdout.close()  # before anything is written
        assert asked.stderr.read() == ""
    assert asked.returncode == 0


def test_compiling_solves_what_it_compiles_for(monkeypatch):
    """A body of revolution and one in space, both with an answer; a meridian has fewer unknowns."""
    solve, solved = fem_backend.__main__.response_to, []
    monkeypatch.setattr("fem_backend.__main__.response_to", lambda request: solved.append(solve(request)))
    assert main(["--compile"]) == 0
    assert [response["status"] for response in solved] == ["done", "done"]
    assert solved[0]["info"]["dofs"] < solved[1]["info"]["dofs"]
