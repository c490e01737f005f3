"""The reference of study files: complete, the page in docs/ as printed, and true to what a study accepts."""

from pathlib import Path

import pytest
import sample_studies as studies

from rso.cli import main
from rso.study.errors import StudyError
from rso.study.keys import reference
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
