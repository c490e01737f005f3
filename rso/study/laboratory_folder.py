"""A folder as a laboratory leaves it, with `nominal.json` saying what the experimenter believes, as a study file.

The CSV files are named for what they hold: ``point_20_0`` was pressed at (20, 0) mm, ``mp_cycle_30`` is a cycle at the
top with 30 mm/min, ``mp_…`` and names with less than two numbers are force curves at the top, ``profile`` holds marks
of the surface.  See docs/data_for_a_diagnosis.md.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rso.core.default_backend import DEFAULT_BACKEND, command_line
from rso.core.inline_toml import inline
from rso.core.units import value_in_unit
from rso.data import read_measurement, recorded_speed
from rso.study.cases import DEFAULT_SPEED_MM_S
from rso.study.columns_table import ColumnsTable
from rso.study.errors import choices_text
from rso.study.laboratory_nominal import NOMINAL_FILE, Nominal, read_nominal
from rso.study.schema import Study

_NUMBER_IN_NAME = r"(-?\d+(?:\.\d+)?)"
_POINT_NAME = re.compile(
    rf"^(?:point|pt|p|pos|position|site)[_ ]?{_NUMBER_IN_NAME}[_ ]{_NUMBER_IN_NAME}$", re.IGNORECASE
)
_CYCLE_NAME = re.compile(r"^mp_cycle_(\d+(?:\.\d+)?)(?![\d.])", re.IGNORECASE)
_PLACE_NAME = re.compile(r"^(point|pt|pos|position|site)([_ -]|\d)", re.IGNORECASE)  # a name that means a place
_TOP_NAME = re.compile(r"^mp([_ -]|$)", re.IGNORECASE)  # middle point
_TEST_NUMBER = re.compile(r"^(\d+)[_ -]+(?=[^\W\d])")  # 04_site_20_0: the fourth test
READ_SUFFIXES = (".csv", ".xlsx")
LOCK_PREFIX = "~$"  # what a spreadsheet lays beside a workbook that is open


def study_of_folder(folder: Path, seed: int, beside: Path) -> str:
    """The study file for a folder; `beside` is where it will be written.  ValueError naming what is missing."""
    nominal = read_nominal(folder)
    files = sorted(
        f for f in folder.iterdir() if f.suffix.lower() in READ_SUFFIXES and not f.name.startswith(LOCK_PREFIX)
    )
    if not files:
        raise ValueError(f"{folder}: holds no CSV file")
    for f in files:
        _refuse_unclear(f)
    for name in nominal.columns_of:
        if name not in (names := [f.name for f in files]):
            raise ValueError(
                f"{folder / NOMINAL_FILE}: columns_of.{name}: there is no such file; {choices_text(name, names)}"
            )
    files.sort(key=_order([f.stem for f in files]))
    lines = [
        "[study]",
        f"title = {json.dumps('Diagnosis of ' + folder.name)}",
        f"seed = {seed}",
        "",
        "[backend]",
        f"use = {inline(DEFAULT_BACKEND)}",
        "",
        "[backend.settings]",
        *(f"{key} = {inline(table)}" for key, table in nominal.settings.items()),
        "",
        "[parameters]",
        *(f"{knob} = {inline(table)}" for knob, table in command_line().LABORATORY["parameters"].items()),
        "",
        "[diagnose]",
        "keep_ranges = false  # nobody stated them",
        "",
    ]
    lines += ["[columns]", *_columns(nominal.columns), ""] if nominal.columns.headers() else []
    before: list[str] = []
    for file in files:
        lines += [*_experiment(file, nominal, before, beside), ""]
        before = before if _is_profile(file.stem) else [*before, file.stem]
    return "\n".join(lines)


def _experiment(file: Path, nominal: Nominal, before: list[str], beside: Path) -> list[str]:
    """The lines of one experiment, tested after those `before`."""
    name, profile = file.stem, _is_profile(file.stem)
    own = nominal.columns_of.get(file.name)
    lines = [
        "[[experiments]]",
        f"name = {json.dumps(name)}",
        'role = "fit"',
        f"data = {json.dumps(os.path.relpath(file, beside))}",
    ]
    lines += [f"columns = {{ {', '.join(_columns(own))} }}"] if own is not None else []
    if profile:
        lines += ['kind = "profile"']
    elif {"Fx", "Fy"} <= set(read_measurement(file, nominal.of_file(file.name).columns()).channels):
        lines += ['channels = ["Fz", "Fx", "Fy"]']
    cycle = _CYCLE_NAME.match(_bare(name))
    settings = [f"point = {list(place_in_name(name) or (0.0, 0.0))}"]
    rate = float(cycle[1]) if cycle else nominal.rate
    if rate and not profile:
        settings += [f'speed = "{rate:g} mm/min"']
    settings += ["unload = true"] if cycle else []
    lines += [f"settings = {{ {', '.join(settings)} }}"]
    of_force = {"Fz": "force_N", "depth": "depth_mm", "gain": "repeat_gain", "correlation": "correlation_mm"}
    keys = {"uz": "profile_mm"} if profile else of_force
    stated = ", ".join(f"{k} = {nominal.noise[v]}" for k, v in keys.items() if v in nominal.noise)
    lines += [f"noise = {{ {stated} }}"] if stated else []
    return lines + ([f"after = {json.dumps(before)}"] if before and not profile else [])


def place_in_name(name: str) -> tuple[float, float] | None:
    """The point (mm) that the name of a file says, if it says one."""
    point = _POINT_NAME.match(_bare(name))
    return (float(point[1]), float(point[2])) if point else None


def may_be_a_place(name: str) -> bool:
    """Whether the name of a file seems to say a point and is not understood."""
    return place_in_name(name) is None and _PLACE_NAME.search(_bare(name)) is not None


def unread(folder: Path) -> list[str]:
    """Files of a folder that may hold readings and are not read."""
    return [
        f"{f.name} is not read: only {' and '.join(READ_SUFFIXES)} files are"
        for f in sorted(folder.iterdir())
        if f.suffix.lower() in (".txt", ".tsv", ".dat", ".asc", ".xls", ".ods")
    ]


def files_of(study: Study) -> list[dict[str, Any]]:
    """What each file of a folder's study was taken for: place (mm), role, speed (mm/min), whether a cycle."""
    found = []
    for e in study.experiments:
        m, settings = study.measurement(e.name), study.settings_of(e.name)
        force, recorded = m.kind == "force", recorded_speed(m)
        stated = value_in_unit(settings["speed"], "mm/s") if "speed" in settings else None
        speed = recorded or stated or DEFAULT_SPEED_MM_S
        returns = any(np.any(r.segment == "unloading") for r in m.repeats)
        found.append(
            {
                "file": m.path.name,
                "kind": m.kind,
                "place_mm": settings["point"],
                "role": e.role,
                "cycle": force and (returns or settings.get("unload") is True),
                "repeats": len(m.repeats),
                "speed_mm_per_min": 60.0 * speed if force else None,
                "speed_from": ("times" if recorded else "stated" if stated else "assumed") if force else None,
            }
        )
    return found


def file_line(file: Mapping[str, Any]) -> str:
    """One line about a file of :func:`files_of`."""
    x, y = file["place_mm"]
    what = "surface marks while pressed" if file["kind"] == "profile" else "a cycle" if file["cycle"] else "force curve"
    how = {"times": "by its times", "stated": "as stated", "assumed": "assumed"}.get(file["speed_from"])
    digits = 2 if file["speed_from"] == "times" else 3  # measured ones differ in the third from file to file
    speed = f"{float(format(file['speed_mm_per_min'], f'.{digits}g')):g} mm/min {how}, " if how else ""
    return f"{file['file']}: {what} at ({x:g}, {y:g}) mm, role {file['role']}, {speed}{file['repeats']} repeat(s)"


def _columns(table: ColumnsTable) -> Iterator[str]:
    """The lines of a table of columns."""
    for name, column in table:
        if column is not None:
            keys = column.model_dump(exclude_unset=True, exclude_none=True)
            yield f"{name} = {inline(keys)}"


def _refuse_unclear(file: Path) -> None:
    """ValueError for a name that seems to say where or how it was pressed in a way that is not understood."""
    name = _bare(file.stem)
    clear = _POINT_NAME.match(name) or _TOP_NAME.match(name)
    if clear or not (_PLACE_NAME.search(name) or len(re.findall(r"\d+", name)) > 1):
        return
    raise ValueError(
        f"{file}: the name does not say where it was pressed. Understood: point_X_Y (point_20_0.csv is pressed at "
        "(20, 0) mm; also pt_, pos_, site_ or P_). mp_cycle_V (mp_cycle_30.csv) is loaded and unloaded at the top "
        "with 30 mm/min. mp_ with anything else, and names with less than two numbers, are at the top; profile.csv "
        "holds surface marks. The number of the test may come first (04_site_20_0.csv)"
    )


def _bare(name: str) -> str:
    """A name without the number of the test before it."""
    return _TEST_NUMBER.sub("", name)


def _is_profile(name: str) -> bool:
    return _bare(name).lower().startswith("profile")


def _order(names: list[str]) -> Callable[[Path], tuple[float, float, str]]:
    """Key of the order of testing: the numbers before the names where every test has one of its own, else by kind."""
    numbers = {n: int(m[1]) for n in names if not _is_profile(n) and (m := _TEST_NUMBER.match(n))}
    told = len(set(numbers.values())) == sum(not _is_profile(n) for n in names)
    return lambda f: (float(numbers.get(f.stem, math.inf)), 0.0, f.stem) if told else (*_rank(f.stem), f.stem)


def _rank(name: str) -> tuple[int, float]:
    """Order of testing: loading, cycles from slow to fast, deep, other points, profile."""
    name = _bare(name)
    cycle = _CYCLE_NAME.match(name)
    if cycle:
        return 1, float(cycle[1])
    kinds = {"mp_load": 0, "mp_cycle": 1, "mp_deep": 2, "point": 3, "profile": 4}
    return next((k for stem, k in kinds.items() if name.lower().startswith(stem)), 3), 0.0
