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
from rso.study.columns_table import ColumnsTable
from rso.study.errors import choose, in_words, schema_problems

FILE = "nominal.json"
NOISE = ("force_N", "depth_mm", "repeat_gain", "profile_mm", "correlation_mm")
HELD, BOWL = ("fixed", "held", "bonded", "glued", "clamped"), ("bowl", "platform")
_DENIAL, _BETWEEN, _WORD = "not|no|non|never|without|neither|nor", "in|on|a|the|any", "|".join((*HELD, *BOWL))
_NEGATED = re.compile(rf"\b({_DENIAL})[ -]+(({_BETWEEN}) +)*({_WORD})\b", re.IGNORECASE)
_LOOSE = re.compile(rf"\b(loose(ly)?|free(ly)?|{'|'.join(f'un{w}' for w in HELD)})\b", re.IGNORECASE)
_NEARLY = 0.7  # likeness from which an unknown key is a misspelled one
_SPECIMEN = {"shape": ["ellipsoid"]}  # what the model takes for granted, and may be said
_INDENTER = {"shape": ["sphere"], "rigid": [True], "full_sphere": [True], "direction": [[0, 0, -1]], "friction": [0]}
_BOWL = {"clearance_mm": 1.0, "friction": 0.2}
_BESIDE = {"clearance_mm": "clearance_mm", "mu_platform": "friction"}  # older names beside the support
MOST = 1_000_000  # bytes
_UNITS = ["N, mm, MPa, s"]
_WORDS = (  # for people: not read
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
)
_KEYS = (
    "specimen",
    "indenter",
    "support",
    "noise",
    "rate_mm_per_min",
    "units",
    "columns",
    "columns_of",
    *_BESIDE,
    *_WORDS,
)


@dataclass(frozen=True)
class Nominal:
    """What a nominal.json says.

    Semi-axes and radius in mm, `rate` in mm/min, the support as a setting in TOML, stated noise by its key; `assumed`
    says in words what was not stated; `columns` of all files as in a study, `columns_of` for single ones instead.
    """

    semi_axes: tuple[float, ...]
    radius: float
    support: str
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
    path = folder / FILE
    try:
        data = disk.read_json(path, MOST)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read ({error})") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path}: a table is expected")
    try:
        return _nominal(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _nominal(data: Mapping[str, Any]) -> Nominal:
    unused = _unknown("", data, _KEYS)
    specimen, indenter = (_table(data, name) for name in ("specimen", "indenter"))
    for name, table, fixed, size in (
        ("specimen.", specimen, _SPECIMEN, "semi_axes_mm"),
        ("indenter.", indenter, _INDENTER, "radius_mm"),
    ):
        unused += _unknown(name, table, (size, *fixed))
        for key in fixed.keys() & table.keys():
            _one_of(f"{name}{key}", table[key], fixed[key])
    if "units" in data:
        _one_of("units", data["units"], _UNITS)
    noise = _table(data, "noise")
    for key in noise:  # another unit of what is known
        if key not in NOISE and key.split("_")[0] in {k.split("_")[0] for k in NOISE}:
            raise ValueError(f"noise.{key} is unknown; {choose(key, NOISE)}")
    unused += _unknown("noise.", noise, NOISE)
    stated = {k: _number(f"noise.{k}", noise[k]) for k in NOISE if k in noise}
    rate = _number("rate_mm_per_min", data["rate_mm_per_min"], zero=False) if "rate_mm_per_min" in data else None
    axes = tuple(_lengths("specimen.semi_axes_mm", specimen.get("semi_axes_mm"), 3))
    radius = _lengths("indenter.radius_mm", [indenter.get("radius_mm")], 1)[0]
    support, assumed = _support(data)
    assumed = (*assumed, *(f"{FILE}: {key} is not used" for key in unused))
    if not stated:
        assumed = (*assumed, f"{FILE} states no noise: only what repeats and readings show counts")
    columns = _columns(("columns",), data.get("columns", {}))
    columns_of = {name: _columns(("columns_of", name), v) for name, v in _table(data, "columns_of").items()}
    return Nominal(axes, radius, support, stated, rate, assumed, columns, columns_of)


def _columns(place: tuple[str, ...], table: Any) -> ColumnsTable:
    """[columns] as a study has it; ValueError naming the key."""
    try:
        return ColumnsTable.model_validate(table)
    except ValidationError as error:
        raise ValueError(in_words(schema_problems(ColumnsTable, error)[0], place)) from error


def _support(data: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """The support as a setting, from words or a table with `kind`, and what of it was not stated."""
    beside = {new: data[old] for old, new in _BESIDE.items() if old in data}
    if "support" not in data:
        said = f'{FILE} states no support: "fixed" is assumed, the lower half held'
        return '{ kind = "fixed" }', (said, *_unused(beside))
    support = data["support"]
    table = dict(support) if isinstance(support, dict) else {"kind": support}
    kind = _kind("support.kind" if isinstance(support, dict) else "support", table.pop("kind", None))
    if kind == "fixed":
        if table:
            key, value = next(iter(table.items()))
            raise ValueError(f'support.{key} = {value!r}: belongs to kind = "bowl"; "fixed" has no other key')
        return '{ kind = "fixed" }', _unused(beside)
    if unknown := set(table) - set(_BOWL):
        key = sorted(unknown)[0]
        raise ValueError(f"support.{key} is unknown; {choose(key, _BOWL)}")
    found = {k: _number(f"support.{k}", v) for k, v in {**_BOWL, **beside, **table}.items()}
    assumed = [f"{k} = {v:g}" for k, v in _BOWL.items() if k not in beside and k not in table]
    words = f"{FILE} does not state all of the bowl: {', '.join(assumed)} assumed"
    setting = f'{{ kind = "bowl", clearance = {found["clearance_mm"]}, friction = {found["friction"]} }}'
    return setting, (words,) if assumed else ()


def _kind(key: str, value: Any) -> str:
    """Held or in a bowl: words of one of the two kinds alone, none of them denied."""
    words = f"words with one of {', '.join((*HELD, *BOWL))}, or a table with kind, clearance_mm and friction"
    if not isinstance(value, str):
        raise ValueError(f"{key} = {value!r}: {words}")
    said = _NEGATED.sub("", value)
    kinds = [kind for kind, names in (("fixed", HELD), ("bowl", BOWL)) if _has(said, names)]
    loose = _LOOSE.search(said)
    if loose is not None:
        raise ValueError(f"{key} = {value!r}: {loose[0]!r} is not understood; say what is so, in {words}")
    if len(kinds) != 1:
        both = "says two kinds of support; " if kinds else ""
        raise ValueError(f"{key} = {value!r}: {both}{words}")
    return kinds[0]


def _has(text: str, words: Iterable[str]) -> bool:
    return re.search(rf"\b({'|'.join(words)})\b", text, re.IGNORECASE) is not None


def _unused(beside: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(f"{k} is not used: the specimen is held" for k in beside)


def _unknown(table: str, given: Iterable[str], known: Sequence[str]) -> list[str]:
    """Keys that are not used; ValueError for one that is nearly a known one which is not given."""
    given = list(given)
    unknown = [key for key in given if key not in known]
    for key in unknown:
        if difflib.get_close_matches(key, [k for k in known if k not in given], n=1, cutoff=_NEARLY):
            raise ValueError(f"{table}{key} is unknown; {choose(key, known)}")
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
