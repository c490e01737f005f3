"""The reference of study files: complete, the page in docs/ as printed, and true to what a study accepts."""

import copy
import tomllib
from pathlib import Path

import jsonschema
import pytest
import sample_studies as studies

from rso.cli import main
from rso.study.errors import StudyError
from rso.study.keys import reference, study_schema
from rso.study.loader import load_study
from rso.study.schema import Study

PAGE = Path(__file__).parents[2] / "docs" / "study_file.md"
DEFS = Study.model_json_schema()["$defs"]


def test_the_page_in_docs_is_what_the_command_prints(capsys):
    assert main(["keys"]) == 0
    assert capsys.readouterr().out == PAGE.read_text(encoding="utf-8")  # else: rso keys > docs/study_file.md


@pytest.mark.parametrize("name", sorted(n for n in DEFS if n != "ColumnsTable"))
def test_every_key_has_its_meaning(name):
    lines = "\n".join(reference())
    for key, value in DEFS[name]["properties"].items():
        assert value.get("description"), f"{name}.{key} says nothing"
        assert f"`{key}`" in lines


def test_every_table_of_a_study_has_a_heading():
    headings = {line.removeprefix("## ").strip("[]").split("]")[0] for line in reference() if line.startswith("## ")}
    assert headings >= set(Study.model_fields)


def test_bounds_units_and_defaults_are_those_that_hold(tmp_path):
    said = next(line for line in reference("verify") if line.startswith("- `tolerance`"))
    assert "> 0, < 1; default 0.005" in said
    assert "- `timeout`: number, s, > 0." in "\n".join(reference("dispatch"))
    for value, fine in (("0.5", True), ("1.0", False), ("0.0", False)):
        path = studies.write(tmp_path, verify=f"tolerance = {value}")
        if fine:
            assert load_study(path).verify.tolerance == 0.5
        else:
            with pytest.raises(StudyError, match="tolerance"):
                load_study(path)


def test_a_table_alone_and_one_that_is_not_there(capsys):
    assert main(["keys", "search"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("## [search]") and "## [[search.targets]]" in out and "[doe]" not in out
    assert main(["keys", "serach"]) == 2
    assert "did you mean 'search'" in capsys.readouterr().err


STUDIES = sorted(p for p in (Path(__file__).parents[2] / "studies").rglob("*.toml") if "[study]" in p.read_text())


@pytest.fixture(scope="module")
def editor():
    """What an editor does with the schema."""
    jsonschema.Draft202012Validator.check_schema(study_schema())
    return jsonschema.Draft202012Validator(study_schema())


@pytest.mark.parametrize("file", STUDIES, ids=lambda p: str(p.relative_to(p.parents[1])))
def test_an_editor_finds_nothing_wrong_with_a_study_that_runs(editor, file):
    assert [e.message for e in editor.iter_errors(tomllib.loads(file.read_text(encoding="utf-8")))] == []


@pytest.mark.parametrize(
    "place, value, word",
    [
        (("experiments", 0, "rolle"), "fit", "rolle"),
        (("experiments", 0, "role"), "fitted", "fitted"),
        (("experiments", 0, "data"), 3, "3"),
        (("experiments", 0, "data"), None, "data"),
        (("experiments", 0, "noise", "Fz"), [1.0], "1.0"),
        (("specimens",), 3, "3"),
        (("ladder", "levels"), [[3]], "3"),
    ],
)
def test_an_editor_marks_what_no_study_may_say(editor, place, value, word):
    study = copy.deepcopy(tomllib.loads(STUDIES[0].read_text(encoding="utf-8")))
    inner = study
    for key in place[:-1]:
        inner = inner[key] if isinstance(inner, list) else inner.setdefault(key, {})
    if value is None:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    assert any(word in e.message for e in editor.iter_errors(study))
