"""A folder as a laboratory leaves it, with `nominal.json` saying what the experimenter believes, as a study file.

`nominal.json` holds specimen (semi_axes_mm), indenter (radius_mm), support, noise (force_N, depth_mm, repeat_gain,
profile_mm) and rates; what else it says is not used.  The CSV files are named for what they hold: ``point_20_0`` was
pressed at (20, 0) mm, every other force curve at the top, ``profile`` holds surface marks.  See
docs/reading_a_diagnosis.md.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rso.measurement import read

_POINT = re.compile(r"^point_(-?\d+(?:\.\d+)?)_(-?\d+(?:\.\d+)?)$", re.IGNORECASE)
_PLACE = re.compile(r"^(point|pt)[_ ]", re.IGNORECASE)  # a name that means a place
_NOISE = ("force_N", "depth_mm", "repeat_gain", "profile_mm")
_HELD, _BOWL = ("fixed", "held", "bonded", "glued", "clamped"), ("bowl", "platform")


def study_text(folder: Path, seed: int, beside: Path) -> str:
    """The study file for a folder; `beside` is where it will be written.  ValueError naming what is missing."""
    path = folder / "nominal.json"
    try:
        nominal = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read ({error})") from error
    if not isinstance(nominal, dict):
        raise ValueError(f"{path}: a table is expected")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() == ".csv")
    if not files:
        raise ValueError(f"{folder}: holds no CSV file")
    for f in files:
        if _PLACE.search(f.stem) and not _POINT.match(f.stem):
            raise ValueError(f"{f}: the name does not say where it was pressed; (20, 0) mm is point_20_0.csv")
    noise = _table(path, nominal, "noise")
    own = {key.split("_")[0] for key in _NOISE}
    noise = _numbers(path, "noise", {k: v for k, v in noise.items() if k.split("_")[0] in own}, _NOISE)
    order = [f.stem for f in files]
    order.sort(key=lambda n: (_rank(n), n))
    lines = [
        "[study]", f"title = {json.dumps('Diagnosis of ' + folder.name)}", f"seed = {seed}", "", "[backend]",
        'use = "fem_backend.backend:BACKEND"', "", "[backend.settings]",
        f"specimen = {{ shape = \"ellipsoid\", semi_axes = {_floats(path, nominal, 'specimen', 'semi_axes_mm', 3)} }}",
        f"indenter = {{ shape = \"sphere\", radius = {_floats(path, nominal, 'indenter', 'radius_mm', 1)[0]} }}",
        f"support = {_support(path, nominal)}", "", "[parameters]",
        'mu = { low = "5 kPa", high = "20 kPa", scale = "log" }',
        'D1 = { low = "1 1/MPa", high = "100 1/MPa", scale = "log" }',
        "",
    ]  # fmt: skip
    before: list[str] = []
    file_of = {f.stem: f for f in files}
    for name in order:
        match = _POINT.match(name)
        point = [float(v) for v in match.groups()] if match else [0.0, 0.0]
        profile = name.lower().startswith("profile")
        lines += ["[[experiments]]", f"name = {json.dumps(name)}", 'role = "fit"',
                  f"data = {json.dumps(os.path.relpath(file_of[name], beside))}"]  # fmt: skip
        lines += (
            ['kind = "profile"']
            if profile
            else ['channels = ["Fz", "Fx", "Fy"]']
            if {"Fx", "Fy"} <= set(read(file_of[name]).channels)
            else []
        )
        unload = ", unload = true" if name.lower().startswith("mp_cycle") else ""
        lines += [f"settings = {{ point = {point}{unload} }}"]
        keys = {"uz": "profile_mm"} if profile else {"Fz": "force_N", "depth": "depth_mm", "gain": "repeat_gain"}
        stated = ", ".join(f"{k} = {noise[v]}" for k, v in keys.items() if v in noise)
        lines += [f"noise = {{ {stated} }}"] if stated else []
        lines += [f"after = {json.dumps(before)}"] if before and not profile else []
        lines.append("")
        before = [*before, name] if not profile else before
    return "\n".join(lines)


def _rank(name: str) -> tuple[int, float]:
    """Order of testing: loading, cycles from slow to fast, deep, other points, profile."""
    name = name.lower()
    cycle = re.match(r"mp_cycle_(\d+)", name)
    if cycle:
        return 1, float(cycle.group(1))
    kinds = {"mp_load": 0, "mp_deep": 2, "point": 3, "profile": 4}
    return next((k for stem, k in kinds.items() if name.startswith(stem)), 3), 0.0


def _table(path: Path, nominal: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = nominal.get(name, {})
    if not isinstance(value, dict):
        raise ValueError(f"{path}: {name} = {value!r}: a table is expected")
    return value


def _floats(path: Path, nominal: Mapping[str, Any], table: str, key: str, n: int) -> list[float]:
    value = _table(path, nominal, table).get(key)
    value = [value] if n == 1 else value
    if not isinstance(value, list) or len(value) != n or not all(isinstance(v, int | float) for v in value):
        raise ValueError(f"{path}: {table}.{key} = {value!r}: {n} number(s) in mm expected")
    return [float(v) for v in value]


def _numbers(path: Path, table: str, given: Mapping[str, Any], known: Sequence[str]) -> dict[str, float]:
    """Numbers by name; ValueError for another name, and for what is no number."""
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{path}: {table}.{key} is unknown; choose from {', '.join(known)}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{path}: {table}.{key} = {value!r}: a number is expected, in the unit of its name")
    return {k: float(v) for k, v in given.items()}


def _support(path: Path, nominal: Mapping[str, Any]) -> str:
    """The support as a setting: words of which the first known one counts, or a table with `kind`."""
    support = nominal.get("support", "fixed")
    table = dict(support) if isinstance(support, dict) else {"kind": support}
    kind = str(table.pop("kind", None)).lower()
    first = {words: min((kind.find(w) for w in words if w in kind), default=len(kind)) for words in (_HELD, _BOWL)}
    if first[_HELD] == first[_BOWL]:
        raise ValueError(
            f"{path}: support = {support!r}: words with one of {', '.join((*_HELD, *_BOWL))}, or a table with kind, "
            "clearance_mm and friction"
        )
    if first[_HELD] < first[_BOWL]:
        return '{ kind = "fixed" }'
    beside = {"clearance_mm": nominal.get("clearance_mm", 1.0), "friction": nominal.get("mu_platform", 0.2)}
    found = _numbers(path, "support", {**beside, **table}, tuple(beside))
    return f'{{ kind = "bowl", clearance = {found["clearance_mm"]}, friction = {found["friction"]} }}'
