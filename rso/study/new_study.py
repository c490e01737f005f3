"""A first study file from readings: what they show is filled in, what they cannot show is marked for their owner."""

from __future__ import annotations

import csv
import io
import itertools
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from rso.contract import Backend, Given, Line, NewStudies, capability
from rso.core.default_backend import DEFAULT_BACKEND
from rso.core.digits import quantity_text
from rso.core.inline_toml import inline
from rso.core.units import COLUMN_NAMES, in_base, people
from rso.data import (
    ZERO_AT_CONTACT,
    DriftAlong,
    HeaderError,
    Measurement,
    Noise,
    Unsaid,
    combine,
    pulls_off,
    read_measurement,
    recorded_speed,
    sheet_of,
)
from rso.data.files.lines import file_text
from rso.study.columns_table import ColumnsTable
from rso.study.dimensions import dimension_errors
from rso.study.errors import choices_text
from rso.study.laboratory_folder import may_be_a_place, place_in_name
from rso.study.settings_files import paths_seen_from

GUESS_MARK = "# <-"  # behind what nobody has stated
BOTH_SIGNS_TURNED_NOTE = "pressed, as both signs were turned; a pull looks the same: else [columns] says so"
COLUMNS_HERE_ADVICE = "[columns] is said here by --column depth HEADER UNIT [flip] [zero VALUE], and so for Fz"
TOP_POINT_MM = (0.0, 0.0)  # x and y of the top of a specimen
MAX_DRIFT_OFF_SHARE = 0.7  # of a drift that it is off by, at most, where a new study subtracts it
TEST_NAME = "press"  # the experiment of a study of many specimens
SPECIMEN_SETTING = "specimen"  # the setting with its sizes


@dataclass(frozen=True)
class NewTest:
    """What the readings do not show.

    The backend's own options by name; the point (mm) that was pressed where the name of a file says none (the top
    without); whether the files fitted are repeats of one test, or each of a specimen of its own; and what columns are
    called, with the keys of [columns], where the files do not say it themselves.
    """

    given: Given
    point: tuple[float, float] | None = None
    repeats: bool = False
    columns: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    specimens: bool = False


@dataclass(frozen=True)
class _Experiment:
    name: str
    role: str
    files: tuple[str, ...]
    measurement: Measurement
    point: tuple[float, float] | None
    by_name: bool
    drift: DriftAlong | None = None


def study_text(
    file: Path, backend: Backend, test: NewTest, fitted: Sequence[str], validated: Sequence[str] = ()
) -> str:
    """The text of a study to be written at `file`, from data files given as paths from where one stands.

    ValueError where a study is at `file` already, and for data that are not there, given twice or not understood.
    """
    experiments, settings, parameters = _beginning(file, backend, test, fitted, validated)
    folder = file.absolute().parent
    lines = _head(backend, folder, f"Indentation: {experiments[0].name}", settings, parameters, test.columns)
    for e in experiments:
        data = [_beside(f, folder) for f in e.files]
        lines += [*_lines(e, e.name, _keys(e), data[0] if len(data) == 1 else data), ""]
    return "\n".join(lines).rstrip() + "\n"


def specimens_texts(file: Path, table: Path, backend: Backend, test: NewTest, fitted: Sequence[str]) -> tuple[str, str]:
    """The texts of a study of many specimens to be written at `file` and of its table beside it, a data file for each.

    What all tests have in common stands in the study, and sizes and what is a test's own in the table.  ValueError as
    of :func:`study_text`, and where the table is there already.
    """
    if table.exists():
        raise ValueError(f"{table}: is there already; --out names a study in another folder")
    experiments, settings, parameters = _beginning(file, backend, test, fitted, ())
    folder = file.absolute().parent
    keys = [_keys(e) for e in experiments]
    common = {k: v for k, v in keys[0].items() if all(own.get(k) == v for own in keys)}
    own = list(dict.fromkeys(k for each in keys for k in each if k not in common))
    shape = settings[SPECIMEN_SETTING].value if SPECIMEN_SETTING in settings else {}
    sizes = {k: v for k, v in shape.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    lines = _head(backend, folder, "Indentation of several specimens", settings, parameters, test.columns)
    lines.insert(1, f"specimens = {inline(table.name)}  {GUESS_MARK} a row for each: write its own sizes there\n")
    guessed = any(e.measurement.guessed for e in experiments)
    first = replace(experiments[0], measurement=replace(experiments[0].measurement, guessed=guessed))
    lines += _lines(first, TEST_NAME, common, None)
    text = io.StringIO()
    rows = csv.writer(text, delimiter=";", lineterminator="\n")
    columns = [f"settings.{SPECIMEN_SETTING}.{k}" for k in sizes] + [f"experiments.{TEST_NAME}.{k}" for k in own]
    rows.writerow(["name", f"data.{TEST_NAME}", *columns, "note"])
    for e, each in zip(experiments, keys, strict=True):
        cells = [inline(each[k]) if k in each else "" for k in own]
        rows.writerow([e.name, _beside(e.files[0], folder), *sizes.values(), *cells, ""])
    return "\n".join(lines).rstrip() + "\n", text.getvalue()


def _beginning(
    file: Path, backend: Backend, test: NewTest, fitted: Sequence[str], validated: Sequence[str]
) -> tuple[list[_Experiment], Mapping[str, Line], Mapping[str, Line]]:
    """Experiments, settings and parameters of a study to be written at `file`; ValueError where it cannot be."""
    if file.exists():
        raise ValueError(f"{file}: is there already; --out names another file")
    if not file.absolute().parent.is_dir():
        raise ValueError(f"{file}: there is no folder {file.parent}")
    studies = capability(backend, NewStudies)
    if studies is None:
        raise ValueError(f"the backend {backend.name!r} begins no study: write one, rso keys says what it holds")
    experiments = _experiments(test, fitted, validated)
    forces = [e for e in experiments if e.measurement.kind == "force"]
    depths = [max(float(r.depth.max()) for r in e.measurement.repeats) for e in forces]
    settings = studies.first_settings(test.given, depths)
    shown = [e for e in experiments if "Fz" in e.measurement.channels] or experiments
    asked = shown if test.specimens else shown[:1]
    return experiments, settings, _widest([_parameters(backend, studies, settings, e) for e in asked])


def _head(
    backend: Backend,
    folder: Path,
    title: str,
    settings: Mapping[str, Line],
    parameters: Mapping[str, Line],
    columns: Mapping[str, Mapping[str, Any]],
) -> list[str]:
    """The study down to its first experiment."""
    lines = [
        "# Begun by `rso new`.  Lines with <- are guesses to look at; `rso keys` says what else may stand here.",
        "[study]",
        f"title = {inline(title)}  {GUESS_MARK} for the report",
        "seed = 1",
        "",
        "[backend]",
        f"use = {inline(DEFAULT_BACKEND)}",
        "",
        "[backend.settings]",
        *(_line(key, replace(line, value=paths_seen_from(line.value, folder))) for key, line in settings.items()),
        "",
        "[parameters]",
        *(_line(k, line) for k, line in parameters.items()),
        "",
        *_uncertainty(backend, settings, parameters),
    ]
    if columns:
        lines += ["[columns]", *(f"{name} = {inline(dict(column))}" for name, column in columns.items()), ""]
    return lines


def note_on_single_tests(test: NewTest, fitted: Sequence[str]) -> str:
    """What is to be said of several files that are fitted as tests of their own at one point; else nothing."""
    found = [] if test.repeats else _experiments(test, fitted, ())
    same = {e.point: [o.files[0] for o in found if o.point == e.point] for e in found}
    said = [f"{', '.join(files)} are tests of their own at one point" for files in same.values() if len(files) > 1]
    return f"{'; '.join(said)}; repeats of one test are begun with --repeats" if said else ""


def _experiments(test: NewTest, fitted: Sequence[str], validated: Sequence[str]) -> list[_Experiment]:
    given = [*fitted, *validated]
    for k, g in enumerate(given):
        path, sheet = sheet_of(Path(g))
        if not path.is_file():
            raise ValueError(f"{g}: {'is a folder, not a file' if path.is_dir() else 'there is no such file'}")
        if (path.resolve(), sheet) in [(p.resolve(), s) for p, s in map(sheet_of, map(Path, given[:k]))]:
            raise ValueError(f"{g}: is given twice; a reading counts once")
        if not g.isprintable() or any("\ud800" <= c <= "\udfff" for c in g):
            raise ValueError(f"{g!r}: a study file cannot name this; rename it")
    names = dict(zip(given, _names(given), strict=True))
    groups = [("fit", tuple(fitted))] if test.repeats else [("fit", (f,)) for f in fitted]
    groups += [("validate", (f,)) for f in validated]
    found = []
    for role, files in groups:
        m = _read(files, test.columns)
        m, drift = _straightened(m, files, test.columns)
        if role == "fit" and m.kind == "profile":
            raise ValueError(f"{files[0]}: displacements are not fitted; give a profile behind --validate")
        point, by_name = _point(test, role, files)
        found.append(_Experiment(names[files[0]], role, files, m, point, by_name, drift))
    return found


def _point(test: NewTest, role: str, files: Sequence[str]) -> tuple[tuple[float, float] | None, bool]:
    """Where a test was done, if anything says so, and whether that is the name of its file or sheet."""
    said = set()
    for f in files:
        path, sheet = sheet_of(Path(f))
        where = place_in_name(sheet) or place_in_name(path.stem)
        if where is None and test.point is None and (may_be_a_place(sheet) or may_be_a_place(path.stem)):
            raise ValueError(f"{f}: its name does not say where it was pressed as point_20_0 does; give --point X Y")
        said.add(where)
    if len(said) > 1:
        raise ValueError(f"{', '.join(files)}: by their names they were pressed at several points, and are no repeats")
    (where,) = said
    if role == "fit" and where is not None and test.point not in (None, where):
        raise ValueError(f"{files[0]}: pressed at ({where[0]:g}, {where[1]:g}) mm by its name, elsewhere by --point")
    return where or test.point, where is not None


def _uncertainty(backend: Backend, settings: Mapping[str, Line], parameters: Mapping[str, Line]) -> list[str]:
    """[uncertainty] as a comment: nobody but its owner knows how well a dimension is known."""
    found = dimension_errors(backend, {k: line.value for k, line in settings.items()}, list(parameters))
    if not found:
        return []
    units = {p.name: p.unit for p in backend.parameters}
    each = {name: ("%", 100.0) if units[name] == "1" else people(units[name], u) for name, (_, u) in found.items()}
    return [
        "# [uncertainty]  # standard uncertainties of stated dimensions; without them intervals take these as exact",
        *(
            f'# {name} = "{u * each[name][1]:.2g} {each[name][0]}"  {GUESS_MARK} if measured with care'
            for name, (_, u) in found.items()
        ),
        "",
    ]


def _header(file: str) -> str:
    """The row that looks like a header, the last words above the first numbers, in a sentence; empty without one."""
    try:
        rows = [re.split(r"[;\t]|, *", line.strip()) for line in file_text(Path(file))[0].splitlines()]
    except ValueError:
        return ""
    number = re.compile(r"[+-]?[\d.,]*\d(?:[eE][+-]?\d+)?")
    counts = [sum(bool(number.fullmatch(cell.strip(' "'))) for cell in row) for row in rows]
    first = next((k for k, n in enumerate(counts) if n > 1), 0)
    k = first
    filled = [sum(bool(cell.strip()) for cell in row) for row in rows]
    # a header has as many cells as the row of units beneath it: pairs of a word and a value stand above it
    while k > 0 and counts[k - 1] == 0 and filled[k - 1] > 1 and (k == first or filled[k - 1] >= filled[k]):
        k -= 1
    names = [cell.strip(' "') for cell in rows[k] if cell.strip()]
    return f"its header seems to be line {k + 1}: {', '.join(map(repr, names))};\n" if 0 <= k < first else ""


def _straightened(
    m: Measurement, files: Sequence[str], columns: Mapping[str, Mapping[str, Any]]
) -> tuple[Measurement, DriftAlong | None]:
    """The measurement less a drift of Fz that its approaches show beyond doubt, and along what; itself without one."""
    lines = [r.drift.get("Fz") for r in m.repeats]
    if not lines or any(line is None or not line.is_clear or line.share_off > MAX_DRIFT_OFF_SHARE for line in lines):
        return m, None
    along: DriftAlong = "travel" if any(r.time is None for r in m.repeats) else "time"
    try:
        return _read(files, columns, along), along
    except ValueError:  # it is said to drift, and stays as it is
        return m, None


def _read(
    files: Sequence[str], columns: Mapping[str, Mapping[str, Any]], drift: DriftAlong | None = None
) -> Measurement:
    if unknown := next((name for name in columns if name not in COLUMN_NAMES), None):
        raise ValueError(f"--column {unknown}: there is no column {unknown!r}; {choices_text(unknown, COLUMN_NAMES)}")
    try:
        known = ColumnsTable(**columns).columns() if columns else {}
    except ValidationError as error:
        each = [(".".join(map(str, e["loc"])), e["msg"].removeprefix("Value error, ")) for e in error.errors()]
        raise ValueError("; ".join(f"--column {place}: {message}" for place, message in each)) from error
    try:
        return read_measurement(files if len(files) > 1 else files[0], known, drifts=drift)
    except Unsaid as error:
        words = "\n".join(f"  --column {shlex.join(_words(name, c))}" for name, c in error.columns.items())
        raise ValueError(f"{error.message}:\n{words}") from error
    except HeaderError as error:
        text = f"{error}\n{_header(files[0])}say what its columns are: --column depth HEADER mm --column Fz HEADER N, "
        raise ValueError(
            f"{text}and flip behind the unit where the machine counts with the other sign (rso keys columns)"
        ) from error
    except ValueError as error:
        if "[columns]" not in str(error):
            raise
        raise ValueError(f"{error}\n{COLUMNS_HERE_ADVICE}") from error


def _words(name: str, column: Mapping[str, Any]) -> list[str]:
    """A column as the words of --column say it, what is subtracted of it last."""
    less, told = column.get("minus"), ("stiffness", "compliance")
    said = [name] * bool(name) + [column[k] for k in ("header", "unit") if k in column]
    said += [word for k in told if k in column for word in (k, column[k])]
    said += ["flip"] * ("flip" in column) + ["contact"] * (column.get("zero") == ZERO_AT_CONTACT)
    return said if less is None else [*said, "minus", *_words("", less)]


def _line(key: str, line: Line) -> str:
    """A setting or parameter as the study says it, with what is said behind it."""
    mark = f"  {GUESS_MARK} " if line.guess else "  # " if line.remark else ""
    return f"{key} = {inline(line.value)}{mark}{line.remark}"


def _parameters(
    backend: Backend, studies: NewStudies, settings: Mapping[str, Line], force: _Experiment
) -> Mapping[str, Line]:
    """Ranges by a curve of force, without one for any record; ValueError naming its file, also where they leave the
    hard bounds of their parameters."""
    values = {key: line.value for key, line in settings.items()}
    if "Fz" not in force.measurement.channels:
        return studies.first_parameters(values, np.empty(0), np.empty(0))
    curve = combine(force.measurement, Noise())
    depth, value = curve.depth, curve.value
    if pulls_off(force.measurement):  # with what comes after the strongest pull
        r = force.measurement.repeats[0]
        rows = np.nonzero(r.segment == "unloading")[0]
        rows = rows[np.argsort(r.depth[rows], kind="stable")]
        depth, value = r.depth[rows], r.channels["Fz"][rows]
    try:
        found = studies.first_parameters({**values, "point": list(force.point or TOP_POINT_MM)}, depth, value)
    except ValueError as error:
        raise ValueError(f"{force.files[0]}: {error}") from error
    bounds = {p.name: (p.low, p.high) for p in backend.parameters}
    for name, line in found.items():
        hard = bounds.get(name)
        ends = [_number(line.value[end]) for end in ("low", "high") if end in line.value]
        if hard is not None and any(not hard[0] <= end <= hard[1] for end in ends):
            at = f"{quantity_text(float(value[-1]), 'N')} at {quantity_text(float(depth[-1]), 'mm')}"
            asked = " to ".join(str(line.value[end]) for end in ("low", "high") if end in line.value)
            raise ValueError(
                f"{force.files[0]}: {at} ask for {name} = {asked}, which no material has. Is a unit of the file wrong, "
                "or a size of the indenter or the specimen? Lengths behind options are in mm"
            )
    return found


def _number(bound: float | str) -> float:
    """A bound of a range in base units."""
    return in_base(bound)[0] if isinstance(bound, str) else bound


def _widest(found: Sequence[Mapping[str, Line]]) -> Mapping[str, Line]:
    """The least range of each parameter that holds those of all."""
    lines = {}
    for name in dict.fromkeys(name for one in found for name in one):
        given = [one[name] for one in found if name in one]
        given = [g for g in given if "low" in g.value] or given[:1]
        if "low" not in given[0].value:  # a value that is fixed
            lines[name] = given[0]
            continue
        low, high = (at((g.value[end] for g in given), key=_number) for at, end in ((min, "low"), (max, "high")))
        remark = (
            given[0].remark
            if len(given) == 1
            else f"from the lowest to the highest that each of {len(given)} files suggests"
        )
        lines[name] = replace(given[0], value={**given[0].value, "low": low, "high": high}, remark=remark)
    return lines


def _keys(e: _Experiment) -> dict[str, Any]:
    """Keys of an experiment beside its data, with dots, as its readings show them."""
    m = e.measurement
    if m.kind == "profile":
        return {"kind": "profile", "settings.point": list(e.point or TOP_POINT_MM)}
    keys: dict[str, Any] = {"branch": "unloading"} if pulls_off(m) else {}
    if e.drift is not None:
        keys["drift"] = e.drift
    if {"Fx", "Fy"} <= set(m.channels):
        keys["channels"] = ["Fz", "Fx", "Fy"]
    keys["settings.point"] = list(e.point or TOP_POINT_MM)
    if any(np.any(r.segment == "unloading") for r in m.repeats):
        keys["settings.unload"] = True
    return keys


def _lines(e: _Experiment, name: str, keys: Mapping[str, Any], data: str | list[str] | None) -> list[str]:
    """An experiment as the study says it; its data may stand elsewhere."""
    m = e.measurement
    lines = ["[[experiments]]", f"name = {inline(name)}", f'role = "{e.role}"']
    turned = f"  {GUESS_MARK} {BOTH_SIGNS_TURNED_NOTE}" * m.guessed
    lines += [f"data = {inline(data)}{turned}"] if data is not None else [turned.strip()] * m.guessed
    stuck = f"  {GUESS_MARK} Fz pulls during unloading, which shows how it sticks"
    why = {
        "branch": stuck,
        "drift": f"  {GUESS_MARK} Fz drifts in the approach: that line is subtracted, none keeps it",
    }
    lines += [f"{k} = {inline(v)}{why.get(k, '')}" for k, v in keys.items() if "." not in k]
    settings = {k.removeprefix("settings."): v for k, v in keys.items() if k.startswith("settings.")}
    whose = (
        f"  {GUESS_MARK} by the name of the file" if e.by_name else f"  {GUESS_MARK} the top" if e.point is None else ""
    )
    lines += [f"settings = {inline(settings)}{whose}"] if settings else []
    if m.kind == "force" and not recorded_speed(m):
        lines += ['# no times in the file: settings may have speed = "30 mm/min" too, if the body is history-dependent']
    unseen = [*([] if m.contact or len(e.files) > 1 else ['contact = "0.05 mm"']), 'gain = "1 %"']
    if m.kind == "force":
        lines += [
            f"# noise = {{ {', '.join(unseen)} }}  {GUESS_MARK} what a record cannot show of itself; usual figures"
        ]
    return lines


def _beside(file: str, folder: Path) -> str:
    """The path of a file, or of a sheet in it, from a folder; its own on another drive."""
    path, sheet = sheet_of(Path(file))
    try:
        there = Path(os.path.relpath(path.resolve(), folder.resolve()))
    except ValueError:
        there = path.resolve()
    return there.as_posix() + (f"#{sheet}" if sheet else "")


def _names(files: Sequence[str]) -> list[str]:
    """A name of an experiment for each file, from that of the file and the sheet, none that another file has itself."""
    parts = [sheet_of(Path(f)) for f in files]
    words = [re.sub(r"[^\w.+-]+", " ", f"{path.stem} {sheet}")[:60].strip(" .+-") or "test" for path, sheet in parts]
    names: list[str] = []
    for plain in words:
        more = (f"{plain}_{k}" for k in itertools.count(2))
        names.append(plain if plain not in names else next(n for n in more if n not in (*names, *words)))
    return names
