"""Reading a measured CSV file.  Whatever is wrong is a ValueError naming file, line, column, value and choices.

Header: names with units (:func:`rso.units.header`).  Separator: semicolon, tab or comma, whichever the header
has first in this order; with the first two a decimal comma is understood.  Lines that start with '#' are notes.
"""

from __future__ import annotations

import io
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np

from rso.measurement import plausible
from rso.units import column_factor, header

MAX_BYTES = 200_000_000
SEGMENTS = ("loading", "hold", "unloading")
FORCES = ("Fx", "Fy", "Fz")
DISPLACEMENTS = ("ux", "uy", "uz")
# A return by less than this share of the stroke is jitter at the end, not unloading; a second turn by more
# than the other share means several tests in one.
_JITTER, _SECOND_TURN = 0.05, 0.2
# At rest: this near the deepest level, as a share of the stroke, for this many times as long as passing by takes.
_REST, _LONG = 0.0025, 4.0
_AWAY = 0.05  # of the readings of a rest may lie outside it
_LARGEST = 1e12
_THOUSANDS, _HUNDREDS = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}"), re.compile(r"[+-]?[1-9]\d{2}")


@dataclass(frozen=True, eq=False)
class Repeat:
    """One test as recorded: arrays (n,) in N, mm, s.

    `channels` holds forces (kind force) or x, y and displacements (kind profile); `sigma` the stated standard
    uncertainty of each reading where the file has such a column; `segment` one of loading, hold, unloading.
    """

    label: str
    depth: np.ndarray
    time: np.ndarray | None
    channels: Mapping[str, np.ndarray]
    sigma: Mapping[str, np.ndarray]
    segment: np.ndarray


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measured file: its repeats, its notes (comment lines without '#') and what is doubtful about it."""

    path: Path
    kind: Literal["force", "profile"]
    repeats: tuple[Repeat, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels (without x and y)."""
        return tuple(k for k in self.repeats[0].channels if k not in ("x", "y"))


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns by name in base units, the label of each row's repeat and segment, and where each row stood."""

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: np.ndarray
    segments: np.ndarray | None
    line: np.ndarray
    notes: tuple[str, ...]


def read(path: str | Path) -> Measurement:
    """Read one measured file; ValueError for everything that is not a clean table of finite numbers."""
    table = _table(Path(path))
    kind = _kind(table)
    order = dict.fromkeys(table.labels.tolist())
    repeats = tuple(_repeat(table, kind, label) for label in order)
    doubts: list[str] = []
    for r in repeats if kind == "force" else ():
        lines, force = table.line[table.labels == r.label], r.channels.get("Fz")
        given = table.segments is not None
        doubts += plausible.check(Path(path), r.label, r.depth, r.segment, force, r.time, lines, not given)
    plausible.alike(Path(path), [(r.label, r.depth, r.channels["Fz"]) for r in repeats if "Fz" in r.channels])
    for repeat in repeats:
        if len(repeat.depth) == 1 and len(table.line) > 1 and kind == "force":
            raise ValueError(f"{path}: repeat {repeat.label!r} has too few points (1) to be a curve")
    return Measurement(Path(path), kind, repeats, table.notes, tuple(doubts))


def _fail(path: Path, line: int, message: str) -> NoReturn:
    raise ValueError(f"{path}:{line}: {message}")


def _text(path: Path) -> str:
    """Contents as text: UTF-8 with or without mark, else Latin-1."""
    try:
        if not path.is_file():
            raise ValueError(f"{path}: there is no such file" if not path.exists() else f"{path}: is not a file")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ValueError(f"{path}: {size / 1e6:.0f} MB is more than the {MAX_BYTES / 1e6:.0f} MB that are read")
        raw = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from error
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError(f"{path}: is UTF-16 text; save it as UTF-8 (utf-8, utf-8-sig and latin-1 are understood)")
    if b"\0" in raw:
        raise ValueError(f"{path}: is not a text file (it holds zero bytes); a CSV file is expected")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _table(path: Path) -> _Table:
    """The file as columns."""
    notes: list[str] = []
    rows = _lines(_text(path), notes)
    try:
        top, head = next(rows)
    except StopIteration:
        raise ValueError(f"{path}: holds no header line such as depth_mm,Fz_N") from None
    separator = next((s for s in (";", "\t") if s in head), ",")
    names, factors = _headers(path, top, head, separator)
    rows = list(rows)
    if separator != ",":
        _no_thousands(path, rows, separator, names)
    columns = [array("d") for _ in names]
    text = {name: list[str]() for name in names if name in ("repeat", "segment")}
    line = array("q")
    for number, row in rows:
        cells = row.split(separator)
        if len(cells) != len(names):
            _fail(path, number, f"{len(cells)} values in a table of {len(names)} columns ({head!r})")
        line.append(number)
        for name, column, cell in zip(names, columns, cells, strict=True):
            if name in text:
                text[name].append(cell.strip().strip('"'))
            else:
                column.append(_number(path, number, name, cell, decimal_comma=separator != ","))
    if not line:
        raise ValueError(f"{path}: too few points: there is no row of numbers below the header")
    arrays = {n: np.array(c) * f for n, c, f in zip(names, columns, factors, strict=True) if n not in text}
    segments = _segment_column(path, line, text["segment"]) if "segment" in text else None
    labels = np.array(text.get("repeat", ["1"] * len(line)))
    return _Table(path, arrays, labels, segments, np.array(line), tuple(notes))


def _no_thousands(path: Path, rows: Sequence[tuple[int, str]], separator: str, names: Sequence[str]) -> None:
    """ValueError where a comma or point may part thousands and not decimals: 1,250 after 750, or 1.250,5."""
    numeric = [k for k, name in enumerate(names) if name not in ("repeat", "segment")]
    marks: dict[str, tuple[int, str]] = {}
    thousands: dict[int, tuple[int, str]] = {}
    whole, other = set[int](), set[int]()
    for number, row in rows:
        cells = row.split(separator)
        for k in numeric if len(cells) == len(names) else ():
            cell = cells[k].strip().strip('"')
            if ("," in cell) != ("." in cell):  # both in one is no number at all
                marks.setdefault("," if "," in cell else ".", (number, cell))
            if _THOUSANDS.fullmatch(cell):
                thousands.setdefault(k, (number, cell))
            elif "," in cell or "." in cell:
                other.add(k)
            elif _HUNDREDS.fullmatch(cell):
                whole.add(k)
    if len(marks) == 2 and thousands:
        (line, one), (_, two) = (marks[m] for m in ".,")
        _fail(path, line, f"{one!r} has a point, {two!r} a comma: one of them parts thousands; write 1250, not 1,250")
    if doubtful := {k: v for k, v in thousands.items() if k in whole and k not in other}:
        k, (line, cell) = next(iter(doubtful.items()))
        _fail(path, line, f"column {names[k]!r}: {cell!r} beside whole hundreds is a thousand or a decimal; write 1250")


def _lines(text: str, notes: list[str]) -> Iterator[tuple[int, str]]:
    """Numbered lines that hold data; comments go to `notes`."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        row = line.strip("\r\n")
        if row.lstrip().startswith("#"):
            notes.append(row.lstrip()[1:].strip())
        elif row.strip():
            yield number, row


def _headers(path: Path, line: int, head: str, separator: str) -> tuple[list[str], list[float]]:
    """Names and factors to base units of all columns."""
    names, factors = [], []
    for cell in head.split(separator):
        try:
            name, unit = header(cell.strip().strip('"'))
        except ValueError as error:
            _fail(path, line, str(error))
        if name in names:
            _fail(path, line, f"column {name!r} appears twice")
        names.append(name)
        factors.append(column_factor(name, unit))
    for name in names:
        if name.endswith("_sigma") and name.removesuffix("_sigma") not in names:
            _fail(path, line, f"column {name!r} states an uncertainty of a column that is not there")
    return names, factors


def _number(path: Path, line: int, name: str, cell: str, decimal_comma: bool) -> float:
    """One cell as a finite float."""
    text = cell.strip().strip('"')
    try:
        value = float(text.replace(",", ".") if decimal_comma else text)
    except ValueError:
        value = math.nan
    # float() also reads 1_000 as a number, which nobody means in a table.
    if not math.isfinite(value) or "_" in text:
        _fail(path, line, f"column {name!r}: {text[:40]!r} is not a finite number")
    if abs(value) > _LARGEST:
        _fail(path, line, f"column {name!r}: {text[:40]!r} is larger than anything measured ({_LARGEST:g})")
    if value < 0 and name.endswith("_sigma"):
        _fail(path, line, f"column {name!r}: {text[:40]!r} is negative, a standard uncertainty is not")
    return value


def _segment_column(path: Path, line: array[int], text: list[str]) -> np.ndarray:
    for number, value in zip(line, text, strict=True):
        if value not in SEGMENTS:
            _fail(path, number, f"column 'segment': {value[:40]!r} is none of {', '.join(SEGMENTS)}")
    return np.array(text)


def _kind(table: _Table) -> Literal["force", "profile"]:
    """Force curve or surface profile, by the columns present."""
    names = [n for n in table.columns if not n.endswith("_sigma")]
    forces = [n for n in names if n in FORCES]
    surface = [n for n in names if n in DISPLACEMENTS]
    found = f"; found are {', '.join(names)}"
    if "depth" not in names:
        raise ValueError(f"{table.path}: column depth_mm is missing{found}")
    if bool(forces) == bool(surface):
        raise ValueError(
            f"{table.path}: either forces (Fz_N, Fx_N, Fy_N) or a profile (x_mm, y_mm, uz_mm) is expected{found}"
        )
    if surface and not {"x", "y"} <= set(names):
        raise ValueError(f"{table.path}: a profile needs the columns x_mm and y_mm{found}")
    if forces and {"x", "y"} & set(names):
        raise ValueError(f"{table.path}: x_mm and y_mm belong to a profile; a force curve's place is a setting{found}")
    return "profile" if surface else "force"


def _repeat(table: _Table, kind: str, label: str) -> Repeat:
    """The rows of one repeat, checked."""
    rows = table.labels == label
    data = {name: column[rows] for name, column in table.columns.items()}
    depth, time = data.pop("depth"), data.pop("time", None)
    if kind == "force" and time is not None and np.any(np.diff(time) <= 0):
        k = int(np.argmax(np.diff(time) <= 0)) + 1
        hint = "" if len(set(table.labels.tolist())) > 1 else "; several tests in one file need a column 'repeat'"
        hint += "; a clock this coarse says nothing, leave its column out" if time[k] == time[k - 1] else ""
        _fail(
            table.path,
            int(table.line[rows][k]),
            f"column 'time': {time[k]:g} s does not follow {time[k - 1]:g} s{hint}",
        )
    if table.segments is not None:
        segment = table.segments[rows]
    elif kind == "profile":
        segment = np.full(len(depth), "loading")
    else:
        segment = _segments(table.path, label, depth, time)
    channels = {k: v for k, v in data.items() if not k.endswith("_sigma")}
    sigma = {k.removesuffix("_sigma"): v for k, v in data.items() if k.endswith("_sigma")}
    return Repeat(label, depth, time, channels, sigma, segment)


def _segments(path: Path, label: str, depth: np.ndarray, time: np.ndarray | None) -> np.ndarray:
    """Loading up to the deepest point, unloading after it; where times are known a rest there is a hold."""
    stroke = float(np.ptp(depth))
    k = int(np.argmax(depth))
    before, after = depth[: k + 1], depth[k:]
    backwards = np.max(np.maximum.accumulate(before) - before)
    forwards = np.max(after - np.minimum.accumulate(after))
    if max(backwards, forwards) > _SECOND_TURN * stroke:
        raise ValueError(
            f"{path}: repeat {label!r} turns back more than once within {stroke:g} mm; "
            f"add a column 'repeat', or 'segment' with {', '.join(SEGMENTS)}"
        )
    segment = np.full(len(depth), "loading", dtype="<U9")
    if depth[k] - after.min() > _JITTER * stroke:
        segment[k + 1 :] = "unloading"
    if time is not None:
        segment[_at_rest(depth, time)] = "hold"
    return segment


def _at_rest(depth: np.ndarray, time: np.ndarray) -> slice:
    """Readings of a rest at the deepest point: there for _LONG times as long as the way just before and after it takes.

    There is within a share of the stroke or the noise; just before and after is from there to four times as far below.
    """
    noise = plausible.noise_of(depth)
    top = float(depth.max())
    on_the_way = depth[: int(np.argmax(depth > 0.95 * top))]
    steps = np.abs(np.diff(on_the_way))
    coarse = len(steps) > 0 and np.median(steps) == 0.0  # an encoder, on whose steps readings stand even on the way
    step = float(steps[steps > 0].min(initial=np.inf)) if coarse else 0.0
    width = max(_REST * (top - max(float(depth.min()), 0.0)), 6.0 * noise, 1.5 * step * np.isfinite(step))
    level = float(np.median(depth[depth >= top - width]))
    there = np.nonzero(depth >= level - width)[0]
    below = np.nonzero(depth < level - 4.0 * width)[0]
    before, after = below[below < there[0]], below[below > there[-1]]
    if len(there) < 2 or not len(before):
        return slice(0, 0)
    if np.mean(depth[there[0] : there[-1] + 1] < level - width) > _AWAY:
        return slice(0, 0)  # it went up in between
    beside = _between(time, depth, int(before[-1]), int(there[0]), level, width)
    beside += _between(time, depth, int(after[0]), int(there[-1]), level, width) if len(after) else beside
    if time[there[-1]] - time[there[0]] <= _LONG * max(beside, 2.0 * float(np.median(np.diff(time)))):
        return slice(0, 0)
    arrived = there[depth[there] >= level][0]  # which still belongs to loading
    return slice(int(arrived) + 1, int(there[-1]) + 1)


def _between(time: np.ndarray, depth: np.ndarray, far: int, near: int, level: float, width: float) -> float:
    """Time from four widths below the level to one, along the readings from `far` to `near` in either direction."""
    at = np.arange(far, near + 1) if near > far else np.arange(far, near - 1, -1)
    ends = np.interp([level - 4.0 * width, level - width], np.maximum.accumulate(depth[at]), time[at])
    return float(abs(ends[1] - ends[0]))
