"""Study folders, laboratories, results and environments, damaged by a number: what strangers, disks and haste leave.

`case(n, bases, folder)` copies a good folder, spoils it and says which command to call on it.  The same number always
makes the same case.  Damage beyond that of `tests/rso/fuzzing.py` is of bytes, of structure, of values of one kind,
and of text that is not to reach a terminal.
"""

from __future__ import annotations

import io
import json
import os
import random
import re
import shutil
import sqlite3
import sys
import tomllib
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "rso"))
import fuzzing
import sample_studies as studies
from openpyxl import Workbook
from test_laboratory import NOMINAL

FORGED = "\nrso: forged"
VICTIM = "mine, and not to be touched\n"
BODY = ("--semi-axes", "60", "35", "35", "--radius", "3")
TEXTS = (
    "",
    " ",
    "\x1b[2J\x1b]0;t\x07",
    "\u202egnp.exe",
    f"a{FORGED}",
    "a\rb\x9b31m",
    "\u2028\u200b",
    "=cmd|'/c calc'!A1",
    "<script>alert(1)</script>",
    "x" * 20_000,
    "ａ",
    "nan",
    "1e999",
    "../../../etc/passwd",
    "%s{}{0.__class__}",
    "a\tb",
    "\ufeff",
    "🜁" * 30,
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    10**9,
    2**63,
    10**400,
    0.5,
    1e300,
    -1e300,
    5e-324,
    float("nan"),
    float("inf"),
    [],
    {},
    [[]],
    [None],
    [1, "a"],
    {"a": {}},
    "text",
    *TEXTS,
)


@dataclass(frozen=True)
class Case:
    """A command line for a spoilt folder, and the environment variables (None: not there) that it is called with."""

    name: str
    arguments: tuple[str, ...]
    environment: Mapping[str, str | None] = field(default_factory=dict)


# ------------------------------------------------------------------------------------------------------ bytes


def some_bytes(rng: random.Random, raw: bytes) -> bytes:
    """The bytes, cut, flipped, doubled, or with others among them."""
    at = rng.randrange(len(raw) + 1)
    to = min(len(raw), at + rng.choice((1, 4, 64, 4096)))
    match rng.randrange(8):
        case 0:
            return raw[:at]
        case 1:
            return raw[at:]
        case 2:
            changed = bytearray(raw)
            for _ in range(rng.choice((1, 3, 50))):
                changed[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
            return bytes(changed)
        case 3:
            return raw[:at] + rng.randbytes(rng.choice((1, 16, 5000))) + raw[at:]
        case 4:
            return raw[:at] + bytes(to - at) + raw[to:]
        case 5:
            return raw[:at] + rng.choice(TEXTS).encode() + raw[at:]
        case 6:
            return raw[:at] + raw[to:]
        case _:
            return rng.choice((b"", b"\0" * 5000, rng.randbytes(3000), raw + raw, b"\xff\xfe" + raw, raw[::-1]))


def spoil_bytes(rng: random.Random, file: Path) -> None:
    raw = file.read_bytes()
    for _ in range(rng.choice((1, 1, 3))):
        raw = some_bytes(rng, raw) if raw else raw
    file.write_bytes(raw)


def something_else(rng: random.Random, path: Path) -> None:
    """A folder, a link, a pipe, a device, nothing, or a file of no rights in the place of a file or folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    victim = next(p / "victim" for p in path.parents if (p / "victim").exists())
    kind = rng.randrange(9)
    fuzzing.of_other_kind(path, kind)
    match kind:
        case 5:
            path.symlink_to(victim)
        case 6:
            os.link(victim, path)
        case 7:
            path.touch(0)


FACTORS = (0, -1, 0.5, 2, 10, 1e3, 1e-3, 1e9)


def alike(rng: random.Random, value: Any, others: list[Any]) -> Any:
    """Another value of the same kind: a multiple, a text that stands elsewhere, another number of elements."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int | float):
        factor = rng.choice(FACTORS)
        return type(value)(value * factor) if abs(value) < 1e100 else -value
    if isinstance(value, str):
        match = re.fullmatch(r"([-0-9.e]+) (\S+)", value)
        if match and rng.random() < 0.6:
            unit = rng.choice((match[2], "mm", "N", "kPa", "%", "s", "1/MPa"))
            return f"{float(match[1]) * rng.choice(FACTORS):g} {unit}"
        return rng.choice([o for o in others if isinstance(o, str)] or [""])
    if isinstance(value, list):
        return rng.choice(
            (value[:1], value[1:], value[:-1], value * 2, value[::-1], [], [v for v in others if type(v) is float][:3])
        )
    items = list(value.items())
    return dict(rng.choice((items[:1], items[1:], items[:-1], items[::-1], [])))


def at(data: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        data = data[key]
    return data


# ------------------------------------------------------------------------------------------------------ studies


def study_values(rng: random.Random, folder: Path) -> None:
    """Keys and values of the study file replaced."""
    study = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))
    for _ in range(rng.choice((1, 1, 2, 4))):
        try:
            every = list(fuzzing.places(study))
            place = rng.choice(every)
            kind = rng.random()
            if kind < 0.1 and isinstance(there := at(study, place[:-1]), dict):
                there[rng.choice(TEXTS)] = there.pop(place[-1])
            elif kind < 0.6:
                others = [at(study, p) for p in every] + [key for p in every for key in p if isinstance(key, str)]
                fuzzing.put(study, place, alike(rng, at(study, place), others))
            else:
                fuzzing.put(study, place, rng.choice((*VALUES, *fuzzing.VALUES)))
        except (KeyError, IndexError, TypeError):  # the place is gone by now
            continue
    try:
        fuzzing.write(folder, study)
    except TypeError:  # something that TOML has no word for
        (folder / "study.toml").write_text("[study")


def study_file(rng: random.Random, folder: Path) -> None:
    file = folder / "study.toml"
    rng.choices((study_values, lambda r, f: spoil_bytes(r, file), lambda r, f: something_else(r, file)), (12, 6, 1))[0](
        rng, folder
    )


# ------------------------------------------------------------------------------------------------------ data


def cells(rng: random.Random, file: Path) -> None:
    """Cells, headers, rows and columns of a table of text."""
    rows = [r.split(",") for r in file.read_text(encoding="utf-8").splitlines()]
    for _ in range(rng.choice((1, 1, 2, 5))):
        k = 0 if rng.random() < 0.3 else rng.randrange(len(rows))
        j = rng.randrange(len(rows[k])) if rows[k] else 0
        match rng.randrange(14):
            case 0 | 1 | 2:
                rows[k][j : j + 1] = [str(rng.choice(VALUES))]
            case 9:
                rows = [rows[0], *rng.sample(rows[1:], min(len(rows) - 1, rng.choice((0, 1, 2, 3, 5))))]
            case 10 | 11:
                factor = rng.choice(FACTORS)
                rows[1:] = [[_times(c, factor) if i == j else c for i, c in enumerate(row)] for row in rows[1:]]
            case 12:
                rows[1:] = [row for row in rows[1:] for _ in range(2)]
            case 13:
                names = (
                    "time_s",
                    "repeat",
                    "segment",
                    "Fx_N",
                    "Fy_N",
                    "Fz_sigma_N",
                    "uz_mm",
                    "x_mm",
                    "y_mm",
                    "Fz_N",
                    "depth_mm",
                )
                extra = rng.choice(("1", "0", "loading", "nan", ""))
                rows = [[*row, rng.choice(names) if i == 0 else extra] for i, row in enumerate(rows)]
            case 3:
                rows[k][j : j + 1] = []
            case 4:
                rows[k] = rows[k] * 2
            case 5:
                rows = [rows[0], *rng.sample(rows[1:], len(rows) - 1)]
            case 6:
                rows = rows[: k + 1] or rows
            case 7:
                rows.insert(k, [rng.choice(TEXTS)] * rng.choice((1, 2, 50)))
            case 8:
                for row in rows:
                    row[j : j + 1] = [rng.choice(("7", "0", "-1e9", "1e-320"))]
    file.write_text("\n".join(map(",".join, rows)), encoding="utf-8", errors="replace")


def _times(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def data_file(rng: random.Random, folder: Path) -> None:
    file = folder / rng.choice([p.name for p in folder.glob("*.csv")])
    match rng.randrange(12):
        case 0 | 1 | 2 | 3:
            spoil_bytes(rng, file)
        case 4:
            something_else(rng, file)
        case _:
            cells(rng, file)


def workbook(rng: random.Random, folder: Path) -> None:
    """Members of the archive: damaged, gone, doubled, with other names; or the archive itself."""
    file = folder / "side.xlsx"
    match rng.randrange(8):
        case 0 | 1:
            return spoil_bytes(rng, file)
        case 2:
            return something_else(rng, file)
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for _ in range(rng.choice((1, 1, 3))):
        name = (
            rng.choice(list(members))
            if rng.random() < 0.5
            else rng.choice([n for n in members if "sheet" in n] or list(members))
        )
        match rng.randrange(9):
            case 0 | 1:
                members[name] = some_bytes(rng, members[name])
            case 2:
                del members[name]
            case 3:
                members[rng.choice((f"../{name}", "xl/media/x", name.upper()))] = members.pop(name)
            case 4:
                members[name] = b"<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'bb'><!ENTITY c '&b;&b;&b;'>]><a>&c;</a>"
            case 5:
                members[name] = members[name].replace(
                    b"<v>", rng.choice((b"<v>x", b"<v>1e999", b"<v>-", b"<w>", b"<v><v>"))
                )
            case 6:
                members[name] = members[name].replace(
                    b'r="', b'r="' + rng.choice((b"ZZZZ", b"0", b"-1", b"A9999999", b"\xc3\xa4"))
                )
            case 7:
                members[name] = members[name].replace(b"<row", rng.choice((b"<rows", b'<row s="99"', b"<row><row")))
            case 8:
                members[name] = members[name].replace(b't="', rng.choice((b't="d', b't="e', b't="', b't="s"x="')))
        if not members:
            break
    file.unlink()
    with zipfile.ZipFile(
        file, "w", rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_LZMA))
    ) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    if rng.random() < 0.1:
        spoil_bytes(rng, file)


# ------------------------------------------------------------------------------------------------------ results


def json_values(rng: random.Random, file: Path) -> None:
    """Values, keys and branches of a JSON file replaced."""
    data = json.loads(file.read_text(encoding="utf-8"))
    for _ in range(rng.choice((1, 1, 1, 3, 10))):
        here, place = data, []
        while isinstance(here, dict | list) and here and rng.random() < 0.85:
            key = rng.choice(list(here)) if isinstance(here, dict) else rng.randrange(len(here))
            place.append(key)
            here = here[key]
        if not place:
            continue
        there = data
        for key in place[:-1]:
            there = there[key]
        if isinstance(there, dict) and rng.random() < 0.3:
            there.pop(place[-1])
        elif rng.random() < 0.5:
            there[place[-1]] = alike(rng, here, list(there.values()) if isinstance(there, dict) else there)
        else:
            there[place[-1]] = rng.choice(VALUES)
    if rng.random() < 0.03:
        data = rng.choice(VALUES)
    file.write_text(json.dumps(data, ensure_ascii=rng.random() < 0.5), encoding="utf-8", errors="surrogatepass")


def npz_members(rng: random.Random, file: Path) -> None:
    """Arrays of an npz gone, of another shape or type, or objects."""
    import numpy as np

    with np.load(file) as archive:
        arrays = dict(archive)
    name = rng.choice(list(arrays))
    value = arrays[name]
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: value.ravel()[: value.size // 2],
        lambda: value[None],
        lambda: np.full(value.shape, np.nan),
        lambda: np.array("text"),
        lambda: np.array([{}], dtype=object),
        lambda: value.astype(complex),
        lambda: np.zeros((0, 3)),
        lambda: value * 1e300,
    )
    if rng.random() < 0.2:
        del arrays[name]
    else:
        arrays[name] = rng.choice(kinds)()
    buffer = io.BytesIO()
    with np.errstate(all="ignore"):
        np.savez(buffer, **arrays)
    file.write_bytes(buffer.getvalue())


def results(rng: random.Random, folder: Path) -> None:
    """Files of the results folder but for the store."""
    there = [p for p in sorted((folder / "results").iterdir()) if not p.name.startswith("runs.sq")]
    known = [p for p in there if p.suffix in (".json", ".npz")]
    file = rng.choice(known) if rng.random() < 0.75 else rng.choice(there)
    if file.is_dir() or rng.random() < 0.12:
        something_else(rng, file)
    elif file.suffix == ".json" and rng.random() < 0.75:
        json_values(rng, file)
    elif file.suffix == ".npz" and rng.random() < 0.5:
        npz_members(rng, file)
    else:
        spoil_bytes(rng, file)


STATEMENTS = (
    'UPDATE runs SET "values" = ?',
    'UPDATE runs SET "case" = ?',
    "UPDATE runs SET response = ?",
    "UPDATE runs SET wall_s = ?",
    "UPDATE runs SET name = ?",
    "UPDATE runs SET reason = ?",
    "UPDATE runs SET created = ?",
    "UPDATE runs SET attempts = ?",
    "UPDATE runs SET checksum = ?",
    "UPDATE runs SET checksum = NULL, response = ?",
    'UPDATE runs SET checksum = NULL, "values" = ?',
    'UPDATE runs SET checksum = NULL, "case" = ?',
    "UPDATE runs SET checksum = NULL, cpu_s = ?",
    "UPDATE runs SET key = key || ?",
    "UPDATE runs SET checksum = NULL, state = 'failed', cause = ?",
    "UPDATE runs SET checksum = NULL, state = 'failed', history = ?",
    "INSERT INTO crashes VALUES ('k', ?, 'r', 1, 'n', '{}')",
    "INSERT INTO crashes VALUES ('k', 'w', ?, 1, 'n', '{}')",
    "INSERT INTO crashes VALUES ('k', 'w', 'r', ?, 'n', '{}')",
    "INSERT INTO crashes VALUES ('k', 'w', 'r', 1, 'n', ?)",
    "INSERT INTO artefacts VALUES ('k', ?, 'n', 's')",
    "DELETE FROM runs WHERE 1 OR ?",
    "DROP TABLE runs",
    "DROP TABLE crashes",
    "DROP TABLE artefacts",
    "DROP INDEX crashes_key",
    "PRAGMA user_version = 7",
    "ALTER TABLE runs RENAME COLUMN cause TO other",
    "CREATE TABLE more (a)",
    "ALTER TABLE runs DROP COLUMN history",
)


def store(rng: random.Random, folder: Path) -> None:
    """The runs: bytes of the database and its log, rows and columns of it, the lock, the objects."""
    where = folder / "results"
    file = where / "runs.sqlite"
    match rng.randrange(10):
        case 0 | 1 | 2:
            spoil_bytes(rng, file)
        case 3:
            something_else(
                rng,
                where
                / rng.choice(("runs.sqlite", "runs.lock", "objects", "runs.sqlite-wal", "runs.sqlite-shm", "study")),
            )
        case 4:
            (where / f"runs.sqlite-{rng.choice(('wal', 'shm', 'journal'))}").write_bytes(
                rng.randbytes(rng.choice((1, 32, 5000)))
            )
        case _:
            value = rng.choice(
                (
                    None,
                    7,
                    -1,
                    1e300,
                    "",
                    "[]",
                    "{}",
                    "nul",
                    b"\0\1",
                    b"x" * 1000,
                    '{"a": {"b": []}}',
                    "9" * 400,
                    *TEXTS[:8],
                )
            )
            statement = rng.choice(STATEMENTS)
            if rng.random() < 0.5 and statement.startswith("UPDATE"):
                statement += " WHERE key = (SELECT min(key) FROM runs)"
            with sqlite3.connect(file) as db:
                try:
                    db.execute(statement, (value,) if "?" in statement else ())
                except sqlite3.Error:  # a column that must not be empty, a key that is there
                    db.execute("DELETE FROM runs")
            db.close()


# ------------------------------------------------------------------------------------------------------ laboratories


def laboratory(rng: random.Random, folder: Path) -> None:
    file = folder / "nominal.json"
    kind = rng.randrange(10)
    if kind < 5:
        json_values(rng, file)
    elif kind < 6:
        spoil_bytes(rng, file)
    elif kind < 7:
        something_else(rng, file)
    elif kind < 8:
        name = rng.choice(
            ("mp_", "point_1e999_0", "point_20_0", "mp_cycle_0", "mp_cycle_nan", "profile", "\x1b[2J", "mp_\udcff")
        )
        shutil.copy(folder / "mp_load.csv", folder / f"{name}.csv")
    else:
        data_file(rng, folder)


# ------------------------------------------------------------------------------------------------------ cases

HOMES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "TMPDIR", "MPLCONFIGDIR")
ENVIRONMENTS: tuple[tuple[str, tuple[str | None, ...]], ...] = (
    *((name, (None, "", "/nonexistent", "/dev/null", "/proc", "/" + "x" * 300)) for name in HOMES),
    ("COLUMNS", ("0", "-1", "", "x", "1", "999999999999")),
    ("LINES", ("0", "x")),
    ("TERM", (None, "", "dumb", "\x1b[2J")),
    ("LANG", ("C", "xx_YY", None)),
    ("LC_ALL", ("C", "POSIX", "xx")),
    ("NO_COLOR", ("1",)),
    ("TZ", ("nowhere", ":", "")),
    ("OMP_NUM_THREADS", ("0", "x", "999999")),
    ("PYTHONHASHSEED", ("7",)),
    ("PATH", (None, "", "/nonexistent")),
    ("SOURCE_DATE_EPOCH", ("x", "-1")),
    ("MPLBACKEND", ("nowhere",)),
    ("USER", (None,)),
)


def environment(rng: random.Random) -> dict[str, str | None]:
    return {name: rng.choice(values) for name, values in rng.sample(ENVIRONMENTS, rng.choice((1, 2, 4)))}


DAMAGES: dict[str, tuple[Callable[[random.Random, Path], None], int, dict[str, int]]] = {  # how often, commands
    "study": (study_file, 25, {"check": 10, "run": 3, "status": 2, "report": 1, "diagnose": 2, "ladder": 2, "next": 2}),
    "data": (data_file, 20, {"check": 9, "run": 3, "report": 1, "diagnose": 2, "ladder": 2, "next": 2, "new": 3}),
    "workbook": (workbook, 13, {"check": 12, "run": 1, "report": 1, "new": 5}),
    "results": (results, 15, {"report": 9, "status": 3, "run": 4, "diagnose": 3, "ladder": 1}),
    "store": (store, 17, {"status": 9, "run": 4, "diagnose": 3, "ladder": 1, "check": 5, "next": 1}),
    "laboratory": (laboratory, 6, {"blind": 1}),
    "environment": (
        lambda rng, folder: None,
        4,
        {"check": 4, "status": 2, "report": 2, "run": 1, "new": 1, "keys": 2, "diagnose": 1},
    ),
}


def case(n: int, bases: Path, folder: Path) -> Case:
    """The n-th case in a fresh folder, made from the good ones in `bases`."""
    rng = random.Random(f"case {n}")
    shutil.rmtree(folder, ignore_errors=True)
    name = rng.choices(list(DAMAGES), [weight for _, weight, _ in DAMAGES.values()])[0]
    damage, _, commands = DAMAGES[name]
    command = rng.choices(list(commands), list(commands.values()))[0]
    base = {"diagnose": "toy", "blind": "laboratory", "ladder": "one", "next": "one"}.get(command)
    fits = ["layer", "layer", "one"] if command == "run" else ["layer", "layer", "layer", "toy", "one"]
    base = base or ("layer" if name == "workbook" else rng.choice(fits))
    shutil.copytree(bases / base, folder / "study")
    (folder / "victim").write_text(VICTIM)
    (folder / "made").mkdir()
    damage(rng, folder / "study")
    around = environment(rng) if name == "environment" or rng.random() < 0.05 else {}
    return Case(f"{name} of {base}", _line(rng, command, name, folder), around)


def _line(rng: random.Random, command: str, damage: str, folder: Path) -> tuple[str, ...]:
    study, jobs = folder / "study", ("--jobs", "1") if rng.random() < 0.5 else ()
    if command == "keys":
        return ("keys", *rng.choice(((), ("search",), ("\x1b[2J",), (FORGED,), ("x" * 5000,))))
    if command == "new":
        data = study / ("side.xlsx" if damage == "workbook" else "top.csv")
        if not data.exists():
            data = study / "load.csv"
        return ("new", str(data), *BODY, "--out", str(folder / "made" / "study.toml"))
    if command == "blind":
        return ("blind", str(study), "--out", str(folder / "made"), *jobs)
    trust = ("--trust",) if command == "check" and rng.random() < 0.9 else ()
    fresh = ("--fresh",) if command == "run" and damage in ("results", "store") and rng.random() < 0.3 else ()
    strict = ("--strict",) if command == "run" and rng.random() < 0.2 else ()
    where = rng.choice((study, study / "study.toml"))
    more = (*(jobs if command not in ("status", "report") else ()), *trust, *fresh, *strict)
    if rng.random() < 0.06:
        made = folder / "made"
        places = (
            folder / "victim",
            made / "new",
            made / "\x1b[2J",
            made / ("x" * 300),
            f"{made}/a{FORGED}",
            "/proc/nowhere/results",
            "/dev/null",
        )
        option = "--out" if command == "report" else rng.choice(("--out", "--store"))
        more = (*more, option, str(rng.choice(places)))
    return (command, str(where), *more)


# ------------------------------------------------------------------------------------------------------ mesh caches


def cache(n: int, file: Path, other: Path) -> str:
    """The n-th damage of a mesh in the user's cache, of which `other` holds another body's: in words."""
    rng = random.Random(f"cache {n}")
    match rng.randrange(6):
        case 0 | 1:
            spoil_bytes(rng, file)
            return "bytes"
        case 2:
            something_else(rng, file)
            return "something else"
        case 3:
            shutil.copy(other, file)
            return "another body"
        case 4:
            file.chmod(0o666)
            return "open to all"
        case _:
            comment = zipfile.ZipFile(file).comment
            npz_members(rng, file)
            with zipfile.ZipFile(file, "a") as archive:
                archive.comment = comment
            return "arrays"


# ------------------------------------------------------------------------------------------------------ processes

# What only a process of its own can be given: shell that stands before or behind the command, and variables.
SHELLS = (
    "{}",
    "{} >&-",
    "{} 2>&-",
    "{} <&- >&- 2>&-",
    "{} > /dev/full",
    "{} 2> /dev/full",
    "{} | true",
    "{} | /usr/bin/head -c 100",
    "cd gone && /bin/rmdir ../gone && {}",
    "ulimit -f 0; {}",
    "ulimit -f 40; {}",
    "ulimit -n 24; {}",
    "umask 777; {}",
    "umask 0; {}",
    "ulimit -v 3000000; {}",
    "ulimit -u 1; {}",
    "ulimit -s 512; {}",
)


def process(n: int, bases: Path, folder: Path) -> tuple[str, Case]:
    """The n-th command line of a shell that is started in `folder`."""
    rng = random.Random(f"process {n}")
    shutil.rmtree(folder, ignore_errors=True)
    base = rng.choice(("layer", "one"))
    shutil.copytree(bases / base, folder / "study")
    (folder / "victim").write_text(VICTIM)
    for name in ("gone", "made"):
        (folder / name).mkdir()
    command = rng.choices(("check", "status", "report", "keys", "run", "new"), (4, 3, 3, 2, 3, 1))[0]
    line = _line(rng, command, "environment", folder)
    return SHELLS[n % len(SHELLS)], Case(f"process on {base}", line, environment(rng))


# ------------------------------------------------------------------------------------------------------ good folders

SMALL = {
    "doe": "runs = 8\nheld_out = 1",
    "sensitivity": "sobol = false\nlocal = false",
    "search": "repair = false\npopulation = 8\ngenerations = 4\ncandidates = 1\n"
    'targets = [{ experiment = "top", depth = 0.8 }, { experiment = "top", depth = 2 }]',
    "report": "html = false\npdf = false",
}
LEVELS = 'levels = [{ name = "thick", settings = { thickness = 9 } }, { name = "study" }]'
AGAIN = """truths = { mu = [0.012] }
experiments = [{ name = "again", depth = 2.0, step = 0.5, noise = { Fz = 1e-5, gain = 0.01 } }]"""
SIDE = '\n[[experiments]]\nname = "side"\nrole = "validate"\ndata = "side.xlsx"\nnoise = { Fz = "0.02 mN" }'


def layer(folder: Path) -> None:
    """A study of two parameters with a workbook and all tables."""
    studies.write(folder, **SMALL, ladder=LEVELS, next=AGAIN, experiments=studies.SECTIONS["[experiments]"] + SIDE)
    book = Workbook()
    head, *rows = studies.measured().split()
    book.active.append(head.split(","))
    for row in rows:
        book.active.append([float(c) for c in row.split(",")])
    book.save(folder / "side.xlsx")


def one(folder: Path) -> None:
    """A study of one parameter, which a ladder and the plan of further tests answer in a moment."""
    mu = 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\nD1 = { value = 60 }'
    studies.write(folder, **SMALL, parameters=mu, ladder=LEVELS, next=AGAIN)


def bench(folder: Path) -> None:
    """A laboratory's folder."""
    folder.mkdir()
    (folder / "nominal.json").write_text(json.dumps(NOMINAL))
    rows = [f"{0.1 * k:.1f},{0.04 * (0.1 * k) ** 1.5!r}" for k in range(41)]
    (folder / "mp_load.csv").write_text("depth_mm,Fz_N\n" + "\n".join(rows))
