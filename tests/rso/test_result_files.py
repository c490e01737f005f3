"""The types of result files: one meaning for every key, the page and the schemas made of them, and what they refuse.

That every file which a test makes the program write has these keys and no other is checked in conftest.py.
"""

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from rso.cli import main
from rso.result_types import RESULT_FILES, NextFile, ResultBlock
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


@pytest.mark.parametrize("name", RESULT_FILES)
def test_the_schema_of_each_file_is_printed_and_has_units(name, capsys):
    assert main(["keys", name, "--schema"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == result_schema(name) and set(printed["required"]) <= set(printed["properties"])
    assert "schema_" not in printed["properties"]
    assert ("schema" in printed["properties"]) == (name != "deformed.json")  # a picture, which no program reads later
    assert '"unit"' in json.dumps(printed)


def test_a_file_that_is_none_is_refused_with_the_choices(capsys):
    assert main(["keys", "result.json"]) == 2
    assert ", ".join(RESULT_FILES) in capsys.readouterr().err


def test_a_key_too_many_one_too_few_and_a_number_that_is_none_are_refused():
    best = NextFile.model_fields["best"].annotation
    assert best.model_validate_json('{"one": ["a"], "two": null}').one == ("a",)
    for wrong in ('{"one": ["a"]}', '{"one": ["a"], "two": null, "three": null}', '{"one": 3, "two": null}'):
        with pytest.raises(ValidationError):
            best.model_validate_json(wrong)


ROOT = Path(__file__).parents[2]
OTHER_TABLES = {  # keys of what is no result block, by what holds them
    "kinds of blocks of a document": {"answers", "facts", "picture", "table"},
    "options of the page": {"html", "pdf", "language", "untranslated"},
    "what a figure holds for its readers": {"g", "labels", "said", "series", "texts", "v"},
    "the place of a section in its figure": {"tall", "wide"},
    "names of rows: timings, sensitivities to the prior, branches": {
        "doubled",
        "fe_cpu",
        "halved",
        "held",
        "library_runs",
    },
    "settings of an experiment": {"unload"},
    "a report with the body beside its results": {"deformed"},
    "language.toml, colour maps": {"decimal", "viridis"},
}


def read_keys(source: str) -> Iterator[str]:
    """Texts by which tables are read: `t["key"]` and `t.get("key")`."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
            key = node.slice
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "get":
            key = node.args[0]
        else:
            continue
        if isinstance(key, ast.Constant) and isinstance(key.value, str):
            yield key.value


def test_reports_and_answers_read_no_key_that_no_file_has():
    known = {field.alias or name for block in blocks() for name, field in block.model_fields.items()}
    allowed = known.union(*OTHER_TABLES.values())
    pages = [*(ROOT / "rso" / "report").rglob("*.py"), *(ROOT / "rso" / "cli").glob("answer.py")]
    read = {key: path.name for path in pages for key in read_keys(path.read_text("utf-8"))}
    assert {key: name for key, name in read.items() if key not in allowed} == {}
    assert set().union(*OTHER_TABLES.values()) <= set(read)  # none that nothing reads any more


def test_a_key_with_a_typing_mistake_is_seen():
    assert list(read_keys('a["nrsme"] + b.get("value") + c[0] + d.get(e)')) == ["nrsme", "value"]
