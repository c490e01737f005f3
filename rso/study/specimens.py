"""A study of many specimens: each as a study of its own, every problem of every row at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rso.contract import digest
from rso.study.confusable_text import look_alikes
from rso.study.errors import Problem, StudyError, choices_text, study_error
from rso.study.line_numbers import Place, toml_lines
from rso.study.loader import study_of
from rso.study.schema import Study
from rso.study.specimens_table import SPECIMEN_PLACEHOLDER, SpecimenRow, rows_of_file, rows_of_tables
from rso.study.toml_text import study_source, tables_of

MAX_LISTED_SPECIMENS = 3  # specimens that a message names
ANSWER_FREE_TABLES = ("dispatch", "report", "specimens")  # tables that change no answer


@dataclass(frozen=True, eq=False)
class SpecimenStudies:
    """A study of many specimens: the study of each in the order of the file.

    By name there are notes, and what is a specimen's own besides its data, key → value; `table` is the file of them.
    """

    file: Path
    title: str
    studies: tuple[Study, ...]
    notes: Mapping[str, str]
    own: Mapping[str, Mapping[str, str]]
    table: Path | None

    @property
    def names(self) -> list[str]:
        """Names of the specimens."""
        return [s.specimen for s in self.studies]

    def study(self, name: str) -> Study:
        """The study of one specimen; StudyError naming the others."""
        found = next((s for s in self.studies if s.specimen == name), None)
        if found is None:
            raise StudyError([f"{self.file}: specimen {name!r}: {choices_text(name, self.names)}"])
        return found


def has_specimens(path: str | Path) -> bool:
    """Whether a study file is one of many specimens; StudyError where it cannot be read."""
    return "specimens" in tables_of(*study_source(path))


def load_specimens(path: str | Path) -> SpecimenStudies:
    """Read and check a study of many specimens; StudyError with all that is wrong with any of them.

    What is the same for all is said once, what concerns some with their names.
    """
    file, text = study_source(path)
    raw, lines = tables_of(file, text), toml_lines(text)
    given, table = raw.get("specimens"), None
    problems: list[Problem] = []
    said: list[str] = []
    if isinstance(given, str):
        table = file.parent / given
        rows = rows_of_file(table, said)
    elif isinstance(given, list):
        rows = rows_of_tables(given, file, lines, problems)
    else:
        text = 'expected [[specimens]], or specimens = "table.csv" above the first table'
        raise study_error(file, lines, [Problem(("specimens",), text)])
    said += _names(rows)
    if not (rows or problems or said):
        problems.append(Problem(("specimens",), "there is none"))
    problems += _unused(raw)
    studies = []
    wrong: dict[str, list[str]] = {}
    for row in rows:
        name = row.table.name
        try:
            own, places = _merged(raw, lines, row)
            mark = digest({k: v for k, v in own.items() if k not in ANSWER_FREE_TABLES})
            studies.append(study_of(file, own, places, name, mark))
        except StudyError as error:
            for line in error.problems:
                wrong.setdefault(line, []).append(name)
    own_problems = list(study_error(file, lines, problems).problems) if problems else []
    if every := [*own_problems, *said, *together(wrong, len(rows))]:
        raise StudyError(every)
    title = str(raw["study"]["title"])
    notes = {r.table.name: r.table.note for r in rows}
    return SpecimenStudies(file, title, tuple(studies), notes, {r.table.name: _own(r) for r in rows}, table)


def _own(row: SpecimenRow) -> dict[str, str]:
    """What is the specimen's own besides its data, key → value as written."""
    return {".".join(map(str, k)): str(v) for k, v in row.values.items() if k[0] not in ("name", "note", "data")}


def together(wrong: Mapping[str, Sequence[str]], count: int) -> list[str]:
    """Problems by whose they are; those of only some specimens name these."""
    found = []
    for text, names in wrong.items():
        left = f" and {len(names) - MAX_LISTED_SPECIMENS} more" if len(names) > MAX_LISTED_SPECIMENS else ""
        who = "specimen" if len(names) == 1 else "specimens"
        found.append(
            text if len(names) == count > 1 else f"{text} ({who} {', '.join(names[:MAX_LISTED_SPECIMENS])}{left})"
        )
    return found


def _unused(raw: Mapping[str, Any]) -> list[Problem]:
    """Backends that no experiment of any specimen has."""
    experiments, backends = raw.get("experiments"), raw.get("backends")
    used = {e.get("backend") for e in experiments or () if isinstance(e, dict)} if isinstance(experiments, list) else {}
    names = backends if isinstance(backends, dict) else ()
    return [Problem(("backends", n), f'no experiment has it: give one backend = "{n}"') for n in names if n not in used]


def _names(rows: Sequence[SpecimenRow]) -> list[str]:
    """What is wrong with names: they are of folders too."""
    names = [r.table.name for r in rows]
    said = [
        f"{r.at.file}:{int(r.at)}: name = {name!r}: this name is taken by an earlier specimen"
        for k, (r, name) in enumerate(zip(rows, names, strict=True))
        if name in names[:k]
    ]
    for k, name, earlier in look_alikes(names):
        if name != earlier:
            at = rows[k].at
            said.append(f"{at.file}:{int(at)}: name = {name!r}: looks like {earlier!r} and is another name")
    return said


def _merged(
    raw: Mapping[str, Any], lines: Mapping[Place, int], row: SpecimenRow
) -> tuple[dict[str, Any], dict[Place, int]]:
    """The tables of the study with what is the specimen's own, and where each key stands; StudyError."""
    own = copy.deepcopy({k: v for k, v in raw.items() if k != "specimens"})
    places: dict[Place, int] = dict(lines)
    experiments = own.get("experiments")
    experiments = experiments if isinstance(experiments, list) else []
    index = {e["name"]: n for n, e in enumerate(experiments) if isinstance(e, dict) and "name" in e}
    said: list[str] = []
    absent: list[int] = []
    for e in experiments:
        if isinstance(e, dict) and "data" in e:
            e["data"] = _named(e["data"], row.table.name)
    for path, value in row.values.items():
        if path[0] in ("name", "note"):
            continue
        spot = row.spots[path]
        if path[0] in ("data", "experiments"):
            if len(path) == 1 and len(experiments) == 1 and path[0] == "data":
                n: int | None = 0
            else:
                n = index.get(path[1]) if len(path) > 1 else None
            if n is None:
                which = repr(path[1]) if len(path) > 1 else "which of them"
                hint = choices_text(str(path[1]) if len(path) > 1 else "", index)
                said.append(f"{spot.file}:{int(spot)}: {spot.label}: no experiment {which}; {hint}")
                continue
            place: Place = ("experiments", n, "data") if path[0] == "data" else ("experiments", n, *path[2:])
            if path[0] == "data" and value == "":
                absent.append(n)
                continue
        elif path[0] == "settings":
            place = ("backend", *path)
            said += [
                f"{spot.file}:{int(spot)}: {spot.label}: experiment {e['name']!r} has settings.{path[1]} of its own, "
                f"which counts for it: say experiments.{e['name']}.{'.'.join(map(str, path))}"
                for e in experiments
                if isinstance(e, dict) and "backend" not in e and path[1] in (e.get("settings") or {})
            ]
        else:
            place = path
        if (known := raw.get(str(path[0]))) is not None and path[0] in ("backends", "parameters"):
            if len(path) > 1 and isinstance(known, dict) and path[1] not in known:
                said.append(f"{spot.file}:{int(spot)}: {spot.label}: {choices_text(str(path[1]), known)}")
                continue
        _put(own, place, value)
        places[place] = spot
    if said:
        raise StudyError(said)
    return _without(own, places, absent) if absent else (own, places)


def _named(files: Any, name: str) -> Any:
    if isinstance(files, str):
        return files.replace(SPECIMEN_PLACEHOLDER, name)
    return [_named(f, name) for f in files] if isinstance(files, list) else files


def _put(tables: dict[str, Any], place: Place, value: Any) -> None:
    """A value at a place; tables on the way there are made."""
    inner: Any = tables
    for key in place[:-1]:
        if isinstance(inner, list):
            inner = inner[key]  # type: ignore[index]
            continue
        if not isinstance(inner.get(key), dict | list):
            inner[key] = {}
        inner = inner[key]
    inner[place[-1]] = value


def _without(
    own: dict[str, Any], places: Mapping[Place, int], absent: Sequence[int]
) -> tuple[dict[str, Any], dict[Place, int]]:
    """The tables without the experiments that were not done with this specimen; backends stay, runs have their keys."""
    kept = [n for n in range(len(own["experiments"])) if n not in absent]
    own["experiments"] = [own["experiments"][n] for n in kept]
    moved: dict[Place, int] = {}
    for place, line in places.items():
        if place[0] == "experiments" and len(place) > 1:
            if place[1] in kept:
                moved[("experiments", kept.index(place[1]), *place[2:])] = line
        else:
            moved[place] = line
    return own, moved
