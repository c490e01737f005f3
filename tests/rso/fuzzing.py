"""Mutations of a good study folder, each with the verdict that `rso check` must give.

A mutation is a function of (rng, folder) that spoils or redecorates one file and returns the verdict: BAD (exit code
2), GOOD (exit code 0) or EITHER, where chance decides what is left of the file.
"""

from __future__ import annotations

import math
import os
import random
import shutil
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import sample_studies as studies

GOOD, BAD, EITHER = {0}, {2}, {0, 2}
Mutation = Callable[[random.Random, Path], set[int]]
HUGE = ["1e308", "-1e308", "1e999", str(2**62), str(10**25), "9" * 5000, "5e-324"]
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    3,
    10**6,
    10**9,
    2**63,
    -(2**70),
    10**400,
    0.0,
    -0.0,
    0.5,
    1e-300,
    1e300,
    math.inf,
    -math.inf,
    math.nan,
    "",
    " ",
    "0",
    "nan",
    "6 kPa",
    "6kPa",
    "-6 kPa",
    "1e9999 kPa",
    "9**9**9 mm",
    "1 %",
    "1 mm",
    "5 furlong",
    "3 degC",
    "0 N",
    "1/0 N",
    "１２ kPa",
    "mu",
    "D1",
    "top",
    "lhs",
    "sobol",
    "ccd",
    "file",
    "all",
    "local",
    "dask",
    "../../../../etc/passwd",
    "/dev/zero",
    "/",
    ".",
    "a\0b",
    "x" * 10_000,
    "\u202e\ud7ff",
    "<script>",
    "%s%n",
    [],
    [[]],
    [1, 2],
    ["mu"],
    ["a", 1],
    [[1, 2], [3]],
    {},
    {"low": 1},
    {"a": {"b": {"c": []}}},
    [{}],
    "{}",
    "true",
    "os:system",
    "json:dumps",
    "indentation_backend:BACKEND",
    "indentation_backend:",
    ":",
    "1 kPa" * 100,
)


def toml(value: Any) -> str:
    """A value as TOML text (inline)."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return {math.inf: "inf", -math.inf: "-inf"}.get(value, "nan" if math.isnan(value) else repr(value))
    if isinstance(value, int):
        return str(value)
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value)
        return f'"{escaped}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return "{" + ", ".join(f"{toml(str(k))} = {toml(v)}" for k, v in value.items()) + "}"


def document(study: dict[str, Any]) -> str:
    """A whole study as TOML; values that are None are left out."""
    lines = []
    for key, table in study.items():
        if table is None:
            continue
        if isinstance(table, dict):
            lines.append(f"[{toml(key)}]")
            lines += [f"{toml(k)} = {toml(v)}" for k, v in table.items() if v is not None]
        else:
            lines.insert(0, f"{toml(key)} = {toml(table)}")
    return "\n".join(lines) + "\n"


def base() -> dict[str, Any]:
    """The good study as data, with every table present."""
    study = tomllib.loads(studies.text(identify='require = ["mu"]', verify='tolerance = "1 %"', dispatch="jobs = 2"))
    study["search"]["variants"] = [{"name": "narrow", "ranges": {"mu": ["8 kPa", "15 kPa"]}}]
    study["search"]["constraints"] = [{"experiment": "top", "channel": "uz_max", "depth": 2, "low": -3}]
    return study


def full() -> dict[str, Any]:
    """The same with further tables: a ladder, columns, what might be done next."""
    study = base()
    columns = {"depth": {"header": "depth_mm", "zero": 0.0}, "Fz": {"header": "Fz_N", "zero": [0.0]}}
    possible = {"name": "again", "depth": 2.0, "step": 0.5, "noise": {"Fz": 1e-5, "gain": 0.01}}
    level = {"name": "other", "settings": {"thickness": 9.0}, "open": {"mu": ["6 kPa", 0.02]}}
    study["experiments"][0] |= {"settings": {"speed": 0.5, "thickness": 8.0}, "columns": columns}
    study["doe"] |= {"constraints": ["mu <= 1"]}
    more = {
        "ladder": {"levels": [level]},
        "next": {"truths": {"mu": [0.01, "9 kPa"]}, "experiments": [possible]},
        "diagnose": {"settings": {"thickness": 8.0}},
    }
    return study | more


def write(folder: Path, study: dict[str, Any]) -> None:
    (folder / "study.toml").write_text(document(study), encoding="utf-8", errors="surrogatepass")


def places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of every table, key and element."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, inner in items:
        yield (*at, key)
        yield from places(inner, (*at, key))


def put(data: Any, place: tuple[Any, ...], value: Any) -> None:
    for key in place[:-1]:
        data = data[key]
    if value is None and isinstance(data, list):
        data.pop(place[-1])
    elif value is None:
        del data[place[-1]]
    else:
        data[place[-1]] = value


# ------------------------------------------------------------------------------------------------------ study file


def another_value(rng: random.Random, folder: Path) -> set[int]:
    study = base()
    for _ in range(rng.choice((1, 1, 1, 3))):
        try:
            put(study, rng.choice(list(places(study))), rng.choice(VALUES))
        except (KeyError, IndexError, TypeError):  # the place is gone by now
            pass
    write(folder, study)
    return EITHER


def unknown_key(rng: random.Random, folder: Path) -> set[int]:
    study = base()
    tables = [p for p in places(study) if isinstance(_at(study, p), dict)] + [()]
    table = _at(study, rng.choice(tables))
    table[rng.choice(("colour", "Low", "", "ключ", "a.b", "__class__", "x" * 3000))] = rng.choice((1, "x", [], {}))
    write(folder, study)
    return BAD


def _at(data: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        data = data[key]
    return data


def no_required_key(rng: random.Random, folder: Path) -> set[int]:
    study = base()
    required = [
        ("study",),
        ("study", "title"),
        ("study", "seed"),
        ("backend",),
        ("backend", "use"),
        ("parameters",),
        ("parameters", "mu"),
        ("parameters", "mu", "low"),
        ("experiments",),
        ("experiments", 0),
        ("experiments", 0, "name"),
        ("experiments", 0, "role"),
        ("experiments", 0, "data"),
        ("search", "targets", 0, "depth"),
        ("search", "variants", 0, "name"),
    ]
    put(study, rng.choice(required), None)
    write(folder, study)
    return BAD


def wrong_value(rng: random.Random, folder: Path) -> set[int]:
    study = base()
    wrong: list[tuple[tuple[Any, ...], list[Any]]] = [
        (("study", "seed"), [-1, 1.5, "1", True, 2**63, []]),
        (("study", "title"), ["", 3, "x" * 300, []]),
        (("parameters", "mu", "low"), ["6 mm", "6", "nan kPa", math.nan, math.inf, True, "30 kPa", "-1 kPa", []]),
        (("parameters", "mu", "scale"), ["log10", 3, ""]),
        (("experiments", 0, "data"), ["no.csv", "", ".", "..", "a\0b", "/dev/zero", "~/x.csv", "x" * 5000]),
        (("experiments", 0, "role"), ["fitt", "", "validate", "select", 1]),
        (("experiments", 0, "noise", "Fz"), [-1.0, "-1 mN", "1 mm", "NaN N", math.nan, math.inf, "1e400 N"]),
        (("experiments", 0, "noise", "gain"), [1.0, "100 %", -0.1, "2"]),
        (("experiments", 0, "noise", "correlation"), [-1, "1 N"]),
        (("doe", "runs"), [0, -5, 1.5, "16", 10**9, 10**30, True]),
        (("doe", "held_out"), [-1, "3", 10**9]),
        (("doe", "kind"), ["LHS", "random", 1]),
        (("surrogate", "tolerance"), [0, 1, "-1 %", math.nan]),
        (("sensitivity", "samples"), [0, -1, 10**12]),
        (("search", "targets", 0, "depth"), [0, -1, 1e9, "1 N", "9 m", math.nan]),
        (("search", "targets", 0, "experiment"), ["tip", "", 3]),
        (("search", "population"), [3, 10**9, -1]),
        (("search", "variants", 0, "ranges"), [{"nu": [1, 2]}, {"mu": [1]}, {"mu": ["9 kPa", "8 kPa"]}, {"mu": "8"}]),
        (("identify", "require"), [["nu"], "mu", [1]]),
        (("verify", "tolerance"), [0, 5, "1 mm", -1]),
        (("verify", "max_infill"), [-1, 1.5, 10**9]),
        (("dispatch", "jobs"), [0, -1, 10**6, "2"]),
        (("dispatch", "timeout"), [0, -1, "1 mm", "0 s"]),
        (("backend", "settings"), [{"thickness": -1}, {"colour": 1}, {"thickness": math.nan}, 3]),
        (("backend", "use"), ["nowhere:BACKEND", "indentation_backend", "a b:c", "json:dumps", "os:environ"]),
    ]
    place, values = rng.choice(wrong)
    put(study, place, rng.choice(values))
    write(folder, study)
    return BAD


def study_bytes(rng: random.Random, folder: Path) -> set[int]:
    """Encodings, cuts and flips of the study file."""
    file = folder / "study.toml"
    text = document(base())
    raw = text.encode()
    cut = rng.randrange(len(raw))
    kind = rng.choice(("bom", "crlf", "utf-16", "latin-1", "cut", "flip", "noise", "zeros", "empty", "twice", "blanks"))
    content, verdict = {
        "bom": (b"\xef\xbb\xbf" + raw, GOOD),
        "crlf": (text.replace("\n", "\r\n").encode(), GOOD),
        "utf-16": (text.encode("utf-16"), BAD),
        "latin-1": (text.replace("Layer", "Schicht äöü").encode("latin-1"), BAD),
        "cut": (raw[:cut], EITHER),
        "flip": (raw[:cut] + bytes([raw[cut] ^ (1 << rng.randrange(8))]) + raw[cut + 1 :], EITHER),
        "noise": (rng.randbytes(2000), BAD),
        "zeros": (bytes(2000), BAD),
        "empty": (b"", BAD),
        "twice": (raw + raw, BAD),
        "blanks": (b"\n\n# nothing\n" + raw + b"\n\n", GOOD),
    }[kind]
    file.write_bytes(content)
    return verdict


def deep_nesting(rng: random.Random, folder: Path) -> set[int]:
    n = rng.choice((50, 500, 5000, 100_000))
    hole = rng.choice(("[" * n + "]" * n, "{a=" * n + "1" + "}" * n, ".".join("a" * n), '"' * n, "-" * n))
    line = hole if hole.startswith("a.") else f"x = {hole}"
    where = rng.choice(("\n[deep]\n", "\n[backend.settings.deep]\n", "\n[parameters.deep]\n"))
    (folder / "study.toml").write_text(document(base()) + where + line + ("=1" if line == hole else "") + "\n")
    return BAD


def bad_condition(rng: random.Random, folder: Path) -> set[int]:
    """Inequalities between parameters are text that is understood: nothing in it may run, or run for ever."""
    study = base()
    texts = (
        "",
        "mu",
        "mu <",
        "nu < 1",
        "mu < 1; import os",
        "__import__('os').system('true') < 1",
        "mu.real < 1",
        "(lambda: 1)() < mu",
        "[mu][0] < 1",
        "mu if 1 else 2",
        "mu < " + "(" * 500 + "1" + ")" * 500,
        "mu < '1'",
        "-" * 5000 + "mu < 1",
        "mu < open('/etc/passwd')",
        "mu := 1",
        "mu < 1 and 1",
        "1 < 2",
        "mu < 1j",
    )
    study["doe"]["constraints"] = [rng.choice(texts)]
    write(folder, study)
    return BAD


def long_condition(rng: random.Random, folder: Path) -> set[int]:
    study = base()
    texts = (
        "9**9**9 < mu",
        "mu**9**9**9 < 1",
        "mu * D1 <= 1e400",
        "sqrt(mu - 1) <= 1",
        "mu / 0 < 1",
        "log(-D1) > 0",
        "mu <= D1 <= 200",
        "exp(exp(D1)) > 1",
        "2**-9999 < mu",
        "mu < 10**400",
        "0 * mu < 1 < 2 < 3",
    )
    study["doe"]["constraints"] = [rng.choice(texts)]
    write(folder, study)
    return EITHER


def huge_number(rng: random.Random, folder: Path) -> set[int]:
    study = document(base())
    numbers = [i for i in range(1, len(study)) if study[i - 1] in " =[" and study[i].isdigit()]
    at = rng.choice(numbers)
    end = next(i for i in range(at, len(study)) if not (study[i].isdigit() or study[i] in ".e-"))
    (folder / "study.toml").write_text(study[:at] + rng.choice(HUGE) + study[end:])
    return EITHER


def no_file(rng: random.Random, folder: Path) -> set[int]:
    """Something else in the place of a file."""
    path = folder / rng.choice(("study.toml", "top.csv"))
    path.unlink()
    of_other_kind(path, rng.randrange(6))
    return BAD


def of_other_kind(path: Path, kind: int) -> None:
    """A folder, a loop of links, a device, a pipe or a link to nowhere, by `kind` from 0 to 4; else nothing."""
    match kind:
        case 0:
            path.mkdir()
        case 1:
            path.symlink_to(path.name)
        case 2:
            path.symlink_to("/dev/zero")
        case 3:
            os.mkfifo(path)
        case 4:
            path.symlink_to("/nowhere/at/all")


# ------------------------------------------------------------------------------------------------------ data file


def data_bytes(rng: random.Random, folder: Path) -> set[int]:
    """Encodings, separators and decorations of the measured file."""
    file = folder / "top.csv"
    text = file.read_text()
    cut = rng.randrange(len(text))
    flipped = text[:cut] + chr(ord(text[cut]) ^ (1 << rng.randrange(7))) + text[cut + 1 :]
    kind = rng.choice(
        (
            "bom",
            "crlf",
            "cr",
            "utf-16",
            "latin-1",
            "semicolon",
            "tab",
            "quotes",
            "blank",
            "cut",
            "flip",
            "noise",
            "zeros",
            "empty",
            "header",
            "note",
            "bytes",
            "other bom",
        )
    )
    content, verdict = {
        "bom": (text.encode("utf-8-sig"), GOOD),
        "crlf": (text.replace("\n", "\r\n").encode(), GOOD),
        "cr": (text.replace("\n", "\r").encode(), GOOD),
        "utf-16": (text.encode("utf-16"), GOOD),
        "other bom": (text.encode(rng.choice(("utf-16-le", "utf-16-be", "utf-32"))), BAD),
        "latin-1": (("# Prüfer: Jörg, 20 °C\n" + text).encode("latin-1"), GOOD),
        "semicolon": (text.replace(",", ";").replace(".", ",").encode(), GOOD),
        "tab": (text.replace(",", "\t").encode(), GOOD),
        "quotes": ("\n".join(",".join(f'"{c}"' for c in r.split(",")) for r in text.split()).encode(), GOOD),
        "blank": (text.replace("\n", "\n\n").encode(), GOOD),
        "note": (("# made by hand\n" * 1000 + text).encode(), GOOD),
        "cut": (text[:cut].encode(), EITHER),
        "flip": (flipped.encode(), EITHER),
        "noise": (rng.randbytes(2000), BAD),
        "zeros": (bytes(2000), BAD),
        "empty": (b"", BAD),
        "header": (text.split("\n")[0].encode(), BAD),
        "bytes": (text[:cut].encode() + b"\xff\xfe\x00" + text[cut:].encode(), BAD),
    }[kind]
    file.write_bytes(content)
    return verdict


def bad_cell(rng: random.Random, folder: Path) -> set[int]:
    rows = [r.split(",") for r in (folder / "top.csv").read_text().split()]
    cells = (
        "nan",
        "NaN",
        "inf",
        "-inf",
        "",
        " ",
        "1e400",
        "1e300",
        "-1e13",
        "much",
        "1_000",
        "0x10",
        "1.2.3",
        "١٢",
        "=1+1",
        "1;2",
        "<b>",
        "--1",
        "1e",
        "x" * 100_000,
    )
    rows[rng.randrange(1, len(rows))][rng.randrange(2)] = rng.choice(cells)
    (folder / "top.csv").write_text("\n".join(map(",".join, rows)), encoding="utf-8")
    left_out = ("", " ", "nan", "NaN")  # one row of twenty may lack a value
    return EITHER if any("١٢" in c or c in left_out for r in rows for c in r) else BAD


def bad_columns(rng: random.Random, folder: Path) -> set[int]:
    _, *rows = (folder / "top.csv").read_text().split()
    heads = (
        "depth_mm",
        "Fz_N",
        "depth_mm,depth_mm",
        "Fz_N,Fz_N",
        "depth_mm,Fz_mm",
        "depth_N,Fz_N",
        "depth,Fz",
        "1,2",
        "depth_mm,force_N",
        "depth_mm,Fz_N,Fz_N",
        "depth_mm,Fz_N,time_s",
        "depth_mm;Fz_N",
        "time_s,Fz_N",
        "depth_mm,Fz_N,",
        "depth_mm,uz_mm",
        "depth_mm,repeat",
        "segment,Fz_N",
        "depth_mm,Fx_N",
        "Fz_sigma_N,Fz_N",
        "depth_9**9**9,Fz_N",
        "x" * 50_000,
        "depth_mm,Fz_°C",
        "depth_mm,Fz_N#2",
    )
    head = rng.choice(heads)
    (folder / "top.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    return EITHER if head == "depth_mm,Fz_N," else BAD  # a separator at the end of a line is no column


def bad_rows(rng: random.Random, folder: Path) -> set[int]:
    head, *rows = (folder / "top.csv").read_text().split()
    third = [f"{r},{rng.choice(('-1', '-1e-9'))}" for r in rows]
    content = [
        [head, *rows[:5], rows[5] + ",1", *rows[6:]],  # a value too many
        [head, *rows[:5], rows[5].split(",")[0], *rows[6:]],  # one too few
        [head + ",Fz_sigma_N", *third],  # negative noise
        [head + ",segment", *(f"{r},sideways" for r in rows)],
        [head + ",time_s", *(f"{r},{k % 3}" for k, r in enumerate(rows))],  # time runs back
        [head, *rows, *rows, *rows],  # three tests in one
        [head + ",repeat", *(f"{r},{k}" for k, r in enumerate(rows))],  # one point each
        [head, *(f"-{r}" for r in rows)],  # never in contact
        [head, *(f"1.0,{k}" for k in range(20))],  # one depth only: deeper than asked
        [head, *(f"{r.split(',')[0]},0" for r in rows[:3])],  # targets are out of reach
    ]
    (folder / "top.csv").write_text("\n".join(rng.choice(content)))
    return BAD


def many_rows(rng: random.Random, folder: Path) -> set[int]:
    """Long files are read within the time, whatever they hold."""
    n = rng.choice((10_000, 60_000))
    line = rng.choice(("{u},{f}", "{u},{f},", "{u}"))
    rows = [line.format(u=2 * (k + 1) / n, f=0.3 * ((k + 1) / n) ** 1.5) for k in range(n)]
    (folder / "top.csv").write_text("depth_mm,Fz_N\n" + "\n".join(rows))
    return BAD if line == "{u}" else GOOD


def one_long_line(rng: random.Random, folder: Path) -> set[int]:
    path = folder / rng.choice(("study.toml", "top.csv"))
    path.write_text(rng.choice(("a", "1,", "[", "{", '"', "#", "=", "\t", "a.")) * 2_000_000)
    return BAD


def both(rng: random.Random, folder: Path) -> set[int]:
    another_value(rng, folder)
    rng.choice((data_bytes, bad_cell, bad_columns))(rng, folder)
    return EITHER


MUTATIONS: dict[str, tuple[Mutation, int]] = {  # and how often, in a hundred
    "another value": (another_value, 25),
    "wrong value": (wrong_value, 18),
    "unknown key": (unknown_key, 6),
    "no required key": (no_required_key, 4),
    "bytes of the study": (study_bytes, 8),
    "deep nesting": (deep_nesting, 2),
    "huge number": (huge_number, 4),
    "no file": (no_file, 3),
    "bad condition": (bad_condition, 2),
    "long condition": (long_condition, 2),
    "bytes of the data": (data_bytes, 10),
    "bad cell": (bad_cell, 6),
    "bad columns": (bad_columns, 6),
    "bad rows": (bad_rows, 4),
    "many rows": (many_rows, 1),
    "one long line": (one_long_line, 1),
    "both files": (both, 2),
}


def case(n: int, folder: Path) -> tuple[str, set[int]]:
    """The n-th mutated study, written to a fresh folder: what was done to it and the exit codes that are right."""
    rng = random.Random(n)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "top.csv").write_text(studies.measured())
    write(folder, base())
    names = list(MUTATIONS)
    name = names[n] if n < len(names) else rng.choices(names, [w for _, w in MUTATIONS.values()])[0]
    return name, MUTATIONS[name][0](rng, folder)
