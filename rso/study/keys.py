"""Every table and key of a study file, with what it may be, its default and its meaning, from the models themselves."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

from rso.core.default_backend import BACKEND_PACKAGE
from rso.study.errors import choices_text
from rso.study.fields import TEXT_SCHEMA
from rso.study.schema import Study

Shape = Mapping[str, Any]  # a piece of a JSON schema
MAX_ASKED_CHARACTERS = 80  # characters of what somebody asked for that are shown
UNMENTIONED_BOUND = 1e6  # a bound that no study comes near is not worth a word

STUDY_PAGE_HEAD = f"""# The study file

A study is one TOML file. Numbers are in N, mm, MPa and s, or text with a unit of the same kind (`"3.2 kPa"`, `"1 %"`).
An unknown key is an error that names file, line and choices; `rso check` reads a study and computes nothing. `rso keys`
prints this page, `rso keys search` a part of it. Settings and parameters are the backend's: those of the one here stand
in [the finite element model](finite_elements.md), and `python -m {BACKEND_PACKAGE} --schema` prints them."""


def reference(table: str = "") -> list[str]:
    """The page, one line for each key, or the part on one table and those within; ValueError naming the choices."""
    whole = Study.model_json_schema()
    parts = list(_tables(whole, whole["$defs"]))
    names = [name for name, *_ in parts]
    inner = [name for name in names if name.endswith(f".{table}")]
    table = inner[0] if table not in names and len(inner) == 1 else table
    if table and table not in names:
        raise ValueError(
            f"there is no table {table[:MAX_ASKED_CHARACTERS]!r}; {choices_text(table[:MAX_ASKED_CHARACTERS], names)}"
        )
    lines = [] if table else STUDY_PAGE_HEAD.splitlines()
    for name, heading, shape in parts:
        if not table or name == table or name.startswith(f"{table}."):
            lines += ["", f"## {heading}", "", *_described(shape), "", *_keys(shape)]
    return lines if not table else lines[1:]


def study_schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a study file, for editors that complete and check TOML by one."""
    whole = _as_written(Study.model_json_schema())
    own = whole["$defs"]["ExperimentTable"]
    own["required"] = [key for key in own["required"] if key != "data"]  # specimens have their own
    alone = {"properties": {"experiments": {"items": {"required": ["data"]}}}}
    whole |= {"if": {"not": {"required": ["specimens"]}}, "then": alone}
    whole["properties"]["specimens"] = _or(whole["properties"]["specimens"], [TEXT_SCHEMA])
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}


def _as_written(shape: Any) -> Any:
    """A schema of what a study holds as one of what may stand in its file, such as text for a number with a unit."""
    if isinstance(shape, list):
        return [_as_written(one) for one in shape]
    if not isinstance(shape, dict):
        return shape
    inner = {key: _as_written(value) for key, value in shape.items()}
    other = [*inner.pop("or", []), *([inner["items"]] if inner.pop("alone", None) is True else [])]
    other += [TEXT_SCHEMA] if isinstance(shape.get("unit"), str) else []
    return _or(inner, other) if other else inner


def _or(shape: Shape, other: Sequence[Shape]) -> dict[str, Any]:
    around = {key: shape[key] for key in ("title", "description", "default") if key in shape}
    inner = {key: value for key, value in shape.items() if key not in around}
    return {**around, "anyOf": [inner, *other]}


def _tables(shape: Shape, known: Shape) -> Iterator[tuple[str, str, Shape]]:
    """Name, heading and shape of all tables within one, depth first; those of one kind are described once."""
    seen = {kind: "" for kind, _ in map(_table_in, shape["properties"].values()) if kind}  # these have their own place

    def within(shape: Shape, inside: str) -> Iterator[tuple[str, str, Shape]]:
        for key, value in shape["properties"].items():
            kind, how = _table_in(value)
            name = f"{inside}.{key}" if inside else key
            if kind and seen.setdefault(kind, inside) == inside:
                seen[kind] = name  # once
                heading = {"many": f"[[{name}]]", "named": f"[{name}] name = {{…}}"}.get(how, f"[{name}]")
                yield name, heading, known[kind]
                yield from within(known[kind], name)
            elif not kind and not inside and value.get("type") == "object":  # of values by name
                each = {"description": value["description"], "properties": {"NAME": value["additionalProperties"]}}
                yield name, f"[{name}]", each

    yield from within(shape, "")


def _table_in(value: Shape) -> tuple[str, str]:
    """Which table a key holds, and whether one, `many` of them or `named` ones; empty where it holds none."""
    for one in value.get("anyOf", [value]):
        while one.get("type") == "array" and "items" in one:
            if "$ref" in one["items"]:
                return _named(one["items"]), "many"
            one = one["items"]
        if "$ref" in one:
            return _named(one), "one"
        if isinstance(one.get("additionalProperties"), dict) and "$ref" in one["additionalProperties"]:
            return _named(one["additionalProperties"]), "named"
    return "", ""


def _named(value: Shape) -> str:
    return str(value["$ref"]).rsplit("/", 1)[1]


def _described(shape: Shape) -> list[str]:
    text = " ".join(shape.get("description", "").split())
    text = text.partition("]: ")[2] if text.startswith("[") else text
    return [text[:1].upper() + text[1:]] if text else []


def _keys(shape: Shape) -> Iterator[str]:
    """A line for each key; keys of which the same holds share one."""
    rows = [(key, _row(value, key in shape.get("required", ()))) for key, value in shape["properties"].items()]
    for said, same in groupby(rows, key=lambda row: row[1]):
        yield f"- {', '.join(f'`{key}`' for key, _ in same)}: {said}"


def _row(value: Shape, required: bool) -> str:
    kind, how = _table_in(value)
    default = value.get("default")
    said = {"many": "tables", "named": "tables with names"}.get(how, "a table") if kind else _allowed(value)
    if required:
        said += "; required"
    elif default not in (None, [], {}, ()) and not isinstance(default, dict):
        said += f"; default {_shown(default, value)}"
    return f"{said}. {value['description']}" if "description" in value else f"{said}."


def _allowed(value: Shape) -> str:
    """What a key may be, in words."""
    if "expected" in value:
        return str(value["expected"])
    if "anyOf" in value:
        return " or ".join(_allowed(one) for one in value["anyOf"] if one.get("type") != "null")
    if "enum" in value or "const" in value:
        return " | ".join(json.dumps(v) for v in value.get("enum", [value.get("const")]))
    kind = value.get("type")
    if kind == "array":
        return f"list of {_allowed(value['items']) if 'items' in value else 'values'}"
    if kind == "object":
        inner = value.get("additionalProperties")
        return f"table of {_allowed(inner)}" if isinstance(inner, dict) and inner else "a table"
    word = {"string": "text", "boolean": "true | false", "integer": "whole number", "number": "number"}[str(kind)]
    unit = {"1": ' or text such as "1 %"', None: ""}.get(value.get("unit"), f", {value.get('unit')}")
    return f"{word}{unit}{_bounds(value)}"


def _bounds(value: Shape) -> str:
    signs = {
        "minimum": "≥",
        "ge": "≥",
        "exclusiveMinimum": ">",
        "gt": ">",
        "maximum": "≤",
        "le": "≤",
        "exclusiveMaximum": "<",
        "lt": "<",
    }
    return "".join(
        f", {sign} {value[key]:.15g}"
        for key, sign in signs.items()
        if abs(value.get(key, UNMENTIONED_BOUND)) < UNMENTIONED_BOUND
    )


def _shown(default: Any, value: Shape) -> str:
    text = f"{default:g}" if isinstance(default, float) else json.dumps(default)
    return f"{text} {value['unit']}" if value.get("unit") not in (None, "1") else text
