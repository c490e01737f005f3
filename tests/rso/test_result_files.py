"""The types of result files: one meaning for every key, the page and the schemas made of them, and what they refuse.

That every file which a test makes the program write has these keys and no other is checked in conftest.py.
"""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from rso.cli import main
from rso.result_types import FILES, NextFile, ResultBlock
from rso.result_types.reference import page, result_schema

PAGE = Path(__file__).parents[2] / "docs" / "results.md"


def blocks(kind=ResultBlock):
    return [b for sub in kind.__subclasses__() for b in (sub, *blocks(sub))]


def test_the_page_in_docs_is_what_the_command_prints(capsys):
    assert main(["keys", "results"]) == 0
    assert capsys.readouterr().out == PAGE.read_text(encoding="utf-8")  # else: rso keys results > docs/results.md


def test_every_key_has_a_meaning_and_stands_in_the_page():
    lines = page()
    for block in blocks():
        assert block.__doc__ and block.model_config["extra"] == "forbid" and block.model_config["frozen"]
        for name, field in block.model_fields.items():
            assert field.description, f"{block.__name__}.{name}"
            rows = [r for r in lines if r.startswith(f"| `{field.alias or name}") and field.description in r]
            assert rows, f"{block.__name__}.{name}"
    headings = [line for line in lines if line.startswith("##")]
    assert len(headings) > 100


@pytest.mark.parametrize("name", FILES)
def test_the_schema_of_each_file_is_printed_and_has_units(name, capsys):
    assert main(["keys", name, "--schema"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == result_schema(name) and set(printed["required"]) <= set(printed["properties"])
    assert "schema" in printed["properties"] and "schema_" not in printed["properties"]
    assert '"unit"' in json.dumps(printed)


def test_a_file_that_is_none_is_refused_with_the_choices(capsys):
    assert main(["keys", "result.json"]) == 2
    assert "results.json, ladder.json, next.json, specimens.json, diagnosis.json" in capsys.readouterr().err


def test_a_key_too_many_one_too_few_and_a_number_that_is_none_are_refused():
    best = NextFile.model_fields["best"].annotation
    assert best.model_validate_json('{"one": ["a"], "two": null}').one == ("a",)
    for wrong in ('{"one": ["a"]}', '{"one": ["a"], "two": null, "three": null}', '{"one": 3, "two": null}'):
        with pytest.raises(ValidationError):
            best.model_validate_json(wrong)
