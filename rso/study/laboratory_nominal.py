"""`nominal.json` of a laboratory's folder: what the experimenter believes of specimen, indenter, support and noise.

A value that is not understood is refused with the choices, and so is a key that is nearly one of those below; other
keys are not used, which is said.  See docs/data_for_a_diagnosis.md.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rso.contract import finite
from rso.core import disk
from rso.core.default_backend import command_line
from rso.study.columns_table import ColumnsTable
from rso.study.errors import choices_text, problem_text, schema_problems

NOMINAL_FILE = "nominal.json"
NOISE_KEYS = ("force_N", "depth_mm", "repeat_gain", "profile_mm", "correlation_mm")
LABORATORY_WORDS = command_line().LABORATORY
LABORATORY_PARTS, LABORATORY_SUPPORTS, (ASSUMED_SUPPORT, _WHY_ASSUMED) = (
    LABORATORY_WORDS["parts"],
    LABORATORY_WORDS["supports"],
    LABORATORY_WORDS["assumed"],
)
SUPPORT_WORDS = tuple(word for kind in LABORATORY_SUPPORTS.values() for word in kind["words"])
_DENIAL_WORDS, _WORDS_BETWEEN, _SUPPORT_WORD = (
    "not|no|non|never|without|neither|nor",
    "in|on|a|the|any",
    "|".join(SUPPORT_WORDS),
)
_NEGATED_SUPPORT = re.compile(rf"\b({_DENIAL_WORDS})[ -]+(({_WORDS_BETWEEN}) +)*({_SUPPORT_WORD})\b", re.IGNORECASE)
_LOOSE_SUPPORT = re.compile(
    rf"\b(loose(ly)?|free(ly)?|{'|'.join(f'un{w}' for w in LABORATORY_SUPPORTS[ASSUMED_SUPPORT]['words'])})\b",
    re.IGNORECASE,
)
_MISSPELLED_KEY_LIKENESS = 0.7  # likeness from which an unknown key is a misspelled one
_OLDER_SUPPORT_KEYS = LABORATORY_WORDS["beside"]  # older names beside the support
MAX_NOMINAL_FILE_BYTES = 1_000_000  # far more than the words and numbers of one specimen
_STATED_UNITS = ["N, mm, MPa, s"]
_DESCRIPTIVE_KEYS = (
    "remark",
    "family",
    "frame",
    "depth",
    "force",
    "cycle_rates_mm_per_min",
    "rest_between_tests",
    "order_of_tests",
    "points_mm",
    "profile",
)  # for people: not read
_NOMINAL_KEYS = (
    *LABORATORY_PARTS,
    "support",
    "noise",
    "rate_mm_per_min",
    "units",
    "columns",
    "columns_of",
    *_OLDER_SUPPORT_KEYS,
    *_DESCRIPTIVE_KEYS,
)


@dataclass(frozen=True)
class Nominal:
    """What a nominal.json says.

    `settings` of the backend for specimen, indenter and support, lengths in mm; `rate` in mm/min, stated noise by its
    key; `assumed` says in words what was not stated; `columns` of all files as in a study, `columns_of` for single ones
    instead.
    """

    settings: Mapping[str, Mapping[str, Any]]
    noise: Mapping[str, float]
    rate: float | None
    assumed: tuple[str, ...]
    columns: ColumnsTable = field(default_factory=ColumnsTable)
    columns_of: Mapping[str, ColumnsTable] = field(default_factory=dict)

    def of_file(self, name: str) -> ColumnsTable:
        """What the columns of a file are called."""
        return self.columns_of.get(name, self.columns)


def read_nominal(folder: Path) -> Nominal:
    """Read a folder's nominal.json; ValueError naming file, key, value and choices."""
    path = folder / NOMINAL_FILE
    try:
        data = disk.read_json(path, MAX_NOMINAL_FILE_BYTES)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read ({error})") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path}: a table is expected")
    try:
        return _nominal(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _nominal(data: Mapping[str, Any]) -> Nominal:
    unused = _unknown("", data, _NOMINAL_KEYS)
    tables = {name: _table(data, name) for name in LABORATORY_PARTS}
    for name, part in LABORATORY_PARTS.items():
        unused += _unknown(f"{name}.", tables[name], (*part["sizes"], *part["granted"]))
        for key in part["granted"].keys() & tables[name].keys():
            _one_of(f"{name}.{key}", tables[name][key], part["granted"][key])
    if "units" in data:
        _one_of("units", data["units"], _STATED_UNITS)
    noise = _table(data, "noise")
    for key in noise:  # another unit of what is known
        if key not in NOISE_KEYS and key.split("_")[0] in {k.split("_")[0] for k in NOISE_KEYS}:
            raise ValueError(f"noise.{key} is unknown; {choices_text(key, NOISE_KEYS)}")
    unused += _unknown("noise.", noise, NOISE_KEYS)
    stated = {k: _number(f"noise.{k}", noise[k]) for k in NOISE_KEYS if k in noise}
    rate = _number("rate_mm_per_min", data["rate_mm_per_min"], zero=False) if "rate_mm_per_min" in data else None
    settings = {name: _part(name, tables[name]) for name in LABORATORY_PARTS}
    settings["support"], assumed = _support(data)
    assumed = (*assumed, *(f"{NOMINAL_FILE}: {key} is not used" for key in unused))
    if not stated:
        assumed = (*assumed, f"{NOMINAL_FILE} states no noise: only what repeats and readings show counts")
    columns = _columns(("columns",), data.get("columns", {}))
    columns_of = {name: _columns(("columns_of", name), v) for name, v in _table(data, "columns_of").items()}
    return Nominal(settings, stated, rate, assumed, columns, columns_of)


def _columns(place: tuple[str, ...], table: Any) -> ColumnsTable:
    """[columns] as a study has it; ValueError naming the key."""
    try:
        return ColumnsTable.model_validate(table)
    except ValidationError as error:
        raise ValueError(problem_text(schema_problems(ColumnsTable, error)[0], place)) from error


def _part(name: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """Specimen or indenter as a setting, its sizes in mm."""
    found = dict(LABORATORY_PARTS[name]["setting"])
    for key, (setting, n) in LABORATORY_PARTS[name]["sizes"].items():
        given = table.get(key) if n > 1 else [table.get(key)]
        sizes = _lengths(f"{name}.{key}", given, n)
        found[setting] = sizes if n > 1 else sizes[0]
    return found


def _support(data: Mapping[str, Any]) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """The support as a setting, from words or a table with `kind`, and what of it was not stated."""
    beside = {new: data[old] for old, new in _OLDER_SUPPORT_KEYS.items() if old in data}
    if "support" not in data:
        said = f'{NOMINAL_FILE} states no support: "{ASSUMED_SUPPORT}" is assumed, {_WHY_ASSUMED}'
        return {"kind": ASSUMED_SUPPORT}, (said, *_unused(beside))
    support = data["support"]
    table = dict(support) if isinstance(support, dict) else {"kind": support}
    kind = _kind("support.kind" if isinstance(support, dict) else "support", table.pop("kind", None))
    numbers = LABORATORY_SUPPORTS[kind]["numbers"]
    if not numbers:
        if table:
            key, value = next(iter(table.items()))
            others = " or ".join(f'"{k}"' for k, v in LABORATORY_SUPPORTS.items() if v["numbers"])
            raise ValueError(f'support.{key} = {value!r}: belongs to kind = {others}; "{kind}" has no other key')
        return {"kind": kind}, _unused(beside)
    if unknown := set(table) - set(numbers):
        key = sorted(unknown)[0]
        raise ValueError(f"support.{key} is unknown; {choices_text(key, numbers)}")
    usual = {k: v for k, (_, v) in numbers.items()}
    found = {k: _number(f"support.{k}", v) for k, v in {**usual, **beside, **table}.items()}
    assumed = [f"{k} = {v:g}" for k, v in usual.items() if k not in beside and k not in table]
    words = f"{NOMINAL_FILE} does not state all of the {kind}: {', '.join(assumed)} assumed"
    return {"kind": kind} | {numbers[k][0]: found[k] for k in numbers}, (words,) if assumed else ()


def _kind(key: str, value: Any) -> str:
    """The kind of support: words of one kind alone, none of them denied."""
    *keys, last = ("kind", *(key for kind in LABORATORY_SUPPORTS.values() for key in kind["numbers"]))
    words = f"words with one of {', '.join(SUPPORT_WORDS)}, or a table with {', '.join(keys)} and {last}"
    if not isinstance(value, str):
        raise ValueError(f"{key} = {value!r}: {words}")
    said = _NEGATED_SUPPORT.sub("", value)
    kinds = [kind for kind, its in LABORATORY_SUPPORTS.items() if _has(said, its["words"])]
    loose = _LOOSE_SUPPORT.search(said)
    if loose is not None:
        raise ValueError(f"{key} = {value!r}: {loose[0]!r} is not understood; say what is so, in {words}")
    if len(kinds) != 1:
        both = "says two kinds of support; " if kinds else ""
        raise ValueError(f"{key} = {value!r}: {both}{words}")
    return kinds[0]


def _has(text: str, words: Iterable[str]) -> bool:
    return re.search(rf"\b({'|'.join(words)})\b", text, re.IGNORECASE) is not None


def _unused(beside: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(f"{k} is not used: {LABORATORY_WORDS['without_numbers']}" for k in beside)


def _unknown(table: str, given: Iterable[str], known: Sequence[str]) -> list[str]:
    """Keys that are not used; ValueError for one that is nearly a known one which is not given."""
    given = list(given)
    unknown = [key for key in given if key not in known]
    for key in unknown:
        if difflib.get_close_matches(key, [k for k in known if k not in given], n=1, cutoff=_MISSPELLED_KEY_LIKENESS):
            raise ValueError(f"{table}{key} is unknown; {choices_text(key, known)}")
    return [f"{table}{key}" for key in unknown]


def _one_of(key: str, value: Any, choices: Sequence[Any]) -> None:
    if value not in choices:
        raise ValueError(f"{key} = {value!r} is not modelled; choose from {', '.join(map(json.dumps, choices))}")


def _table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name, {})
    if not isinstance(value, dict):
        raise ValueError(f"{name} = {value!r}: a table is expected")
    return value


def _number(key: str, value: Any, *, zero: bool = True) -> float:
    """A finite number, not negative."""
    if not finite(value):
        raise ValueError(f"{key} = {value!r}: a number is expected, in the unit of its name")
    if value < 0 or (value == 0 and not zero):
        raise ValueError(f"{key} = {value!r}: must be {'at least 0' if zero else 'positive'}")
    return float(value)


def _lengths(key: str, value: Any, n: int) -> list[float]:
    if not isinstance(value, list) or len(value) != n or not all(map(finite, value)):
        raise ValueError(f"{key} = {value!r}: {n} number(s) in mm expected")
    return [_number(key, v, zero=False) for v in value]
