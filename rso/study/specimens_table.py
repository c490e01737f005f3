"""[[specimens]] of a study, or a table of them: what each specimen has of its own."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from rso.core.units import in_base
from rso.data.files.columns import cells_of, is_number, separator_of
from rso.data.files.lines import file_text, numbered_lines
from rso.study.base_table import StudyFileTable
from rso.study.errors import Problem, choices_text, schema_problems
from rso.study.fields import TEXT_SCHEMA, Name, Settings, also, expected
from rso.study.line_numbers import LineElsewhere, Place

SPECIMEN_PLACEHOLDER = "{name}"  # in names of data files: that of the specimen
COLUMN_ROOTS = ("data", "settings", "experiments", "backends", "parameters")
MAX_SPECIMENS = 10_000  # rows of a table
_COLUMN_KEY = re.compile(r'\s*(?:"([^"]*)"|([^\s."\[\]()]+))\s*')
_HEAD_AND_UNIT = re.compile(r"(.*?)\s*\[([^\[\]]*)\]\s*")
_COMMA_THOUSANDS = re.compile(r"[-+]?\d{1,3},\d{3}")
_OPENING_BRACKETS = ("[", "{")


def _by_experiment(value: Any) -> Any:
    """Files of the only experiment stand under an empty name."""
    return value if isinstance(value, dict) else {"": value}


OwnFiles = Annotated[
    dict[str, Any],
    BeforeValidator(_by_experiment),
    expected("a file or a list of files, or a table of these by experiment"),
    also(TEXT_SCHEMA, {"type": "array", "items": TEXT_SCHEMA}),
]


class SpecimenTable(StudyFileTable):
    """[[specimens]]: one specimen of many, each fitted for itself: what it has of its own, the rest is the study's.

    `specimens = "table.csv"` above the first table names a file in their place, with a row for each.  Its columns are
    these keys with dots and, in brackets, the unit that numbers are in: settings.specimen.thickness [mm].
    """

    name: Name
    """How the specimen is called, in results and on pages; {name} in a data file of an experiment stands for it."""
    data: OwnFiles = Field(default_factory=dict)
    """Its measured files, data.press = "a.csv" for the experiment press; "" where it was not done."""
    settings: Settings = Field(default_factory=dict)
    """Settings of the backend for it, key by key: settings.specimen.thickness = 7.6."""
    experiments: Settings = Field(default_factory=dict)
    """Other keys of an experiment by its name: experiments.press.settings.indenter.radius = 3.0."""
    backends: Settings = Field(default_factory=dict)
    """Of a further backend by its name: backends.tension.settings.area = 24.3."""
    parameters: Settings = Field(default_factory=dict)
    """Of a parameter by its name: parameters.k.high = 30, or its value where it was measured."""
    note: str = ""
    """A remark, which stands in the summary."""


@dataclass(frozen=True)
class SpecimenRow:
    """A specimen as it is written down: keys and values, and where each stands; `at` is the row or the table itself."""

    table: SpecimenTable
    values: Mapping[Place, Any]
    spots: Mapping[Place, LineElsewhere]
    at: LineElsewhere


def rows_of_tables(
    raw: list[Any], file: Path, lines: Mapping[Place, int], problems: list[Problem]
) -> list[SpecimenRow]:
    """The specimens of [[specimens]]; what is wrong goes to `problems`."""
    found = []
    for n, one in enumerate(raw):
        spot = LineElsewhere(lines.get(("specimens", n), 1), file, f"specimens[{n}]")
        values = dict(_leaves(one)) if isinstance(one, dict) else {}
        spots = {
            path: LineElsewhere(
                next(lines[p] for p in _outwards(("specimens", n, *path)) if p in lines),
                file,
                f"specimens[{n}].{'.'.join(map(str, path))}",
            )
            for path in values
        }
        try:
            table = SpecimenTable.model_validate(one)
        except ValidationError as error:
            problems += [
                Problem(("specimens", n, *p.place), p.message, p.value) for p in schema_problems(SpecimenTable, error)
            ]
            continue
        found.append(SpecimenRow(table, values, spots, spot))
    return found


def rows_of_file(path: Path, problems: list[str]) -> list[SpecimenRow]:
    """The specimens of a table (CSV, text or a workbook); what is wrong goes to `problems`, with file, row, column."""
    try:
        rows = list(numbered_lines(file_text(path)[0], []))
    except ValueError as error:
        problems.append(str(error))
        return []
    if len(rows) < 2 or len(rows) > MAX_SPECIMENS:
        problems.append(f"{path}: {max(len(rows) - 1, 0)} rows of specimens; from 1 to {MAX_SPECIMENS} are expected")
        return []
    separator = separator_of(rows[0][1])
    heads = cells_of(rows[0][1], separator)
    paths: list[tuple[Place, str]] = []
    for head in heads:
        try:
            paths.append(_column(head))
        except ValueError as error:
            problems.append(f"{path}:{rows[0][0]}: column {head!r}: {error}")
    keys = [p for p, _ in paths]
    problems += [f"{path}:{rows[0][0]}: column {h!r} is there twice" for k, h in enumerate(heads) if h in heads[:k]]
    if ("name",) not in keys and len(paths) == len(heads):
        problems.append(f"{path}:{rows[0][0]}: there is no column 'name'")
    if problems:
        return []
    found = []
    for number, row in rows[1:]:
        cells = cells_of(row, separator)
        at = LineElsewhere(number, path, "row")
        if len(cells) > len(heads) and any(cells[len(heads) :]):
            problems.append(f"{path}:{number}: has {len(cells)} cells, the header {len(heads)}")
            continue
        values, spots, wrong = {}, {}, False
        for head, (place, unit), cell in zip(heads, paths, cells + [""] * len(heads), strict=False):
            if not cell and place[0] != "data":
                continue  # as the study has it
            spots[place] = LineElsewhere(number, path, f"column {head!r}", unit)
            try:
                values[place] = _cell(cell, place, unit)
            except ValueError as error:
                problems.append(f"{path}:{number}: column {head!r} = {cell!r}: {error}")
                wrong = True
        try:
            table = SpecimenTable.model_validate(_nested(values))
        except ValidationError as error:
            for p in schema_problems(SpecimenTable, error):
                own = next((spots[q] for q in _outwards(p.place) if q in spots), None)
                label = own.label if own else f"column {'.'.join(map(str, p.place))!r}"
                shown = "" if p.value is None or isinstance(p.value, dict) else f" = {p.value!r}"
                problems.append(f"{path}:{number}: {label}{shown}: {p.message}")
            continue
        if not wrong:
            found.append(SpecimenRow(table, values, spots, at))
    return found


def _column(head: str) -> tuple[Place, str]:
    """Keys and unit of a column; ValueError for what is none."""
    match = _HEAD_AND_UNIT.fullmatch(head)
    text, unit = (match[1], match[2].strip()) if match else (head, "")
    keys: list[str] = []
    at = 0
    while (found := _COLUMN_KEY.match(text, at)) is not None:
        keys.append(found[1] if found[1] is not None else found[2])
        at = found.end()
        if not text.startswith(".", at):
            break
        at += 1
    choices = ["name", "note", *(f"{root}.…" for root in COLUMN_ROOTS)]
    if at < len(text) or not keys:
        raise ValueError(
            f"keys with dots are expected, such as settings.specimen.thickness; {choices_text(head, choices)}"
        )
    root, deep = keys[0], len(keys)
    good = root in ("name", "note", "data") and deep == 1
    good |= (root in ("data", "settings") and deep > 1) or (root in COLUMN_ROOTS[2:] and deep > 2)
    if not good:
        whole = "; a setting is written out, such as settings.specimen.thickness" if deep == 1 else ""
        raise ValueError(f"no key of a specimen; {choices_text(root, choices)}{whole}")
    if unit and root in ("name", "note", "data"):
        raise ValueError("has no unit")
    return tuple(keys), unit


def _cell(cell: str, place: Place, unit: str) -> Any:
    """What a cell says: a text, files, a number with the unit of its column, or a value as TOML has it."""
    if place[0] in ("name", "note"):
        return cell
    if place[0] == "data":
        files = [f.strip() for f in cell.split(";")]
        return files[0] if len(files) == 1 else files
    if _COMMA_THOUSANDS.fullmatch(cell):
        raise ValueError("is its comma a decimal one? Write a point, or leave it out")
    if is_number(cell):
        number = cell.replace(",", ".").replace("−", "-")
        if unit:
            base = in_base(f"{number} {unit}")[0]
            return base if "settings" in place else f"{number} {unit}"  # of settings nobody knows which unit is right
        return int(number) if re.fullmatch(r"[-+]?\d+", number) else float(number)
    if unit:
        raise ValueError(f"a number in {unit} is expected")
    if cell in ("true", "false") or cell.startswith(_OPENING_BRACKETS):
        try:
            return tomllib.loads(f"v = {cell}")["v"]
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"is no value as TOML has it: {error}") from error
    return cell


def _leaves(table: Mapping[str, Any], path: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every value within tables, by its keys."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key), value


def _nested(values: Mapping[Place, Any]) -> dict[str, Any]:
    """The opposite of :func:`_leaves`; of a key that holds a value and a table the table counts."""
    found: dict[str, Any] = {}
    for path, value in values.items():
        inner: Any = found
        for key in path[:-1]:
            if not isinstance(inner.get(key), dict):
                inner[key] = {}
            inner = inner[key]
        inner[path[-1]] = value
    return found


def _outwards(place: Place) -> Iterator[Place]:
    """A place and all around it, the nearest first."""
    return (place[:n] for n in range(len(place), -1, -1))
