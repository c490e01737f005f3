"""Which columns of a measured file hold what: the header line, the units, the signs.

A file says it by its own header (:func:`rso.core.units.header`); what a testing machine writes instead is said for it
by a :class:`Column` for each column that is read.  Units may stand in a row of their own beneath the header.
"""

from __future__ import annotations

import csv
import functools
import itertools
import math
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import NoReturn

import numpy as np

from rso.core.units import (
    BARE_COLUMNS,
    UNITS_OF_KIND,
    bracketed,
    column_factor,
    conversion_factor,
    header,
    is_counted,
    is_of,
    is_unit,
    kind_of,
    unit_in,
    unit_or_count_factor,
    weight,
)
from rso.data.files import cantilever, header_aliases
from rso.data.files.header_words import KNOWN_COLUMN_NAMES, STRAIN_WORDS

_QUOTED_CELL = re.compile(r'"[^"]*"')
_CLOCK_TIME = re.compile(
    r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]\s*)?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d)?"
)
_DECIMAL_MARKS = str.maketrans({",": ".", "\u2212": "-", "\u2013": "-"})  # minus and en dash
_CELL_WITH_UNIT = re.compile(r"[+-]?[\d.,]*\d(?:[eE][+-]?\d+)?\s*([^\W\d_]\S*|%)")
_HEADER_SEARCH_LINES = 300  # lines in which a header of customary names is looked for
_MAX_SENSE_ROWS = 20_000  # rows whose numbers tell which way a travel counts
_MAX_HEADER_CHARACTERS, _MAX_HEADERS = 80, 200  # characters of a header and headers of a line that a message looks at
_HEADLESS_ADVICE = "; no header stands above these numbers: write one there, such as depth_mm,Fz_N"
UNIT_IN_CELL_ADVICE = "write the unit into the header, and numbers alone into the cells"
UNUSUAL_SEPARATORS = "|:"
_RENAME_ADVICE = "rename one of them, tests side by side are files of their own"
_OTHER_NAMES_ADVICE = "other names are understood with [columns] in the study file"

ZERO_AT_CONTACT = "contact"
SUBTRACTED_COLUMN = "depth.minus"  # the column that is subtracted of depth, among those that are read
IMPLAUSIBLE_FORCE_UNIT_N = 1e6  # N: no force on a soft body is told in it

Row = tuple[int, str]  # number of a line, and its text


@dataclass(frozen=True)
class Column:
    """A column of a machine's file: its header there, its unit where the file says none, whether its sign is turned.

    `zero` is what the file says where 0 is meant, as it stands there: a machine's position at contact, a tare; of
    several files one each; or ZERO_AT_CONTACT, for depth and Fz: what the record itself shows there, in each repeat.
    `unit` may be what one count is, "0.00125 mm".  `values` says of a machine's codes of its segments which are
    loading, hold or unloading, and which to skip.

        depth = ±(header − zero) − minus,    minus = ±header, or of a force ±header / stiffness = ±header · compliance
        Fz    = ±(header − zero) · stiffness of a deflection,                          `stiffness` N/mm
    """

    header: str
    unit: str | None = None
    flip: bool = False
    zero: float | tuple[float, ...] | str = 0.0
    values: Mapping[str, str] | None = None
    minus: Column | None = None
    stiffness: float | None = None
    compliance: float | None = None

    def read_as(self, name: str) -> str:
        """A known name whose kind of unit the file has where the column `name` is meant."""
        bends = self.stiffness is not None or self.compliance is not None
        if name == SUBTRACTED_COLUMN:
            return "Fz" if bends else "depth"
        return "depth" if bends and kind_of(name) == "N" else name

    def worth(self, name: str) -> float:
        """Factor from the kind that the file has to that of the column `name`, mm/N or N/mm; else 1."""
        k = self.stiffness
        return (self.compliance or (1.0 / k if k else 1.0)) if name == SUBTRACTED_COLUMN else k or 1.0


@dataclass(frozen=True)
class Head:
    """The header of a table: `at`, `unit`, `zero` and `factor` (to N, mm, s, with the sign) of each column, by name.

    `above` and `below` are how many of the rows stand above the header and where the readings begin; `notes` are the
    first cells of those above, `units` the cells of the row beneath, empty where there is none; `customary` the names
    that were taken from what machines call them, `found` those whose zero is sought in the record.
    """

    text: str
    separator: str
    cells: tuple[str, ...]
    at: Mapping[str, int]
    unit: Mapping[str, str]
    factor: Mapping[str, float]
    zero: Mapping[str, float]
    above: int
    below: int
    notes: tuple[str, ...]
    units: tuple[str, ...]
    customary: tuple[str, ...] = ()
    found: tuple[str, ...] = ()

    @property
    def unread(self) -> tuple[str, ...]:
        """Headers of the columns that are not read."""
        return tuple(cell for k, cell in enumerate(self.cells) if cell and k not in self.at.values())


def same_letters(text: str) -> str:
    """A header for comparing: Greek and micro µ, composed and decomposed umlauts, all blanks are one (NFKC)."""
    return unicodedata.normalize("NFKC", text).strip()


def columns_of_file(columns: Mapping[str, Column], k: int, n: int) -> dict[str, Column]:
    """The columns of the k-th of n files, each with its own zero; ValueError where there are not as many zeros."""
    found = {}
    for name, column in columns.items():
        zero = column.zero
        if isinstance(zero, tuple):
            if len(zero) != n:
                told = f"zero = {list(zero)} are {len(zero)} for {n} file(s)"
                raise ValueError(f"column {name!r}: {told}; give one for each, or a single number for all")
            zero = zero[k]
        found[name] = replace(column, zero=zero)
    return found


def with_less(columns: Mapping[str, Column]) -> Mapping[str, Column]:
    """The columns with that which is subtracted of depth as one of its own, SUBTRACTED_COLUMN."""
    less = columns["depth"].minus if "depth" in columns else None
    return columns if less is None else {**columns, SUBTRACTED_COLUMN: less}


def is_head(path: Path, comment: Row, rows: Sequence[Row], columns: Mapping[str, Column]) -> bool:
    """Whether a comment above rows of numbers is their header, as numpy.savetxt writes it.

    What a study does not name may be no number: a word for each segment.  ValueError where a usual name may be two
    columns.
    """
    cells, below = list(map(same_letters, _filled(comment[1]))), _filled(rows[0][1]) if rows else []
    wanted = {same_letters(column.header) for name, column in columns.items()}
    numeric = {same_letters(column.header) for name, column in columns.items() if name not in BARE_COLUMNS}
    if len(cells) < 2 or len(cells) != len(below) or not wanted <= set(cells):
        return False
    if not all(is_number(b) for cell, b in zip(cells, below, strict=True) if cell in numeric or not wanted):
        return False
    head = [comment, *rows[:2]]
    return bool(wanted) or _is_header(head, 0) or bool(_customary(path, head))


class HeaderError(ValueError):
    """That the columns of a file are not understood, so that somebody has to say what they are."""


def fail(path: Path, line: int, message: str) -> NoReturn:
    """ValueError that begins with the place."""
    raise ValueError(f"{path}:{line}: {message}")


def cells_of(row: str, separator: str) -> list[str]:
    """Cells of a line without blanks and quotes; a separator within quotes parts nothing."""
    cells = row.split(separator)
    if '"' in row:
        try:
            cells = next(csv.reader([row], delimiter=separator, skipinitialspace=True))
        except csv.Error:  # longer than any table has
            pass
    return [cell.strip().strip('"').strip() for cell in cells]


def find_head(path: Path, rows: Sequence[Row], columns: Mapping[str, Column], notes: Sequence[str] = ()) -> Head:
    """The header among the lines of a file, as the study names it or, without `columns`, as it is understood itself:
    by the known names, else by what machines customarily write.

    `notes` are comments of the file.  ValueError with what to say where a travel holds a deflection.
    """
    usual = {} if columns else _customary(path, rows, notes)
    columns = columns or usual
    k = _named(path, rows, columns) if columns else _understood(path, rows)
    line, text = rows[k]
    separator, cells, units, below = _split(rows, k)
    at: dict[str, int] = {}
    for i, cell in enumerate(cells):
        own = [n for n, c in columns.items() if same_letters(c.header) == same_letters(cell)]
        names = own if columns else [_name(cell, units[i])]
        for name in (n for n in names if n is not None):
            if name in at:
                fail(
                    path,
                    line,
                    f"{f'header {cell!r}' if columns else f'column {name!r}'} appears twice; {_RENAME_ADVICE}",
                )
            at[name] = i
    for name in at:
        if name.endswith("_sigma") and name.removesuffix("_sigma") not in at:
            fail(path, line, f"column {name!r} states an uncertainty of a column that is not there")
    factors, read_as = {}, {}
    for name, i in at.items():
        column = columns.get(name, Column(cells[i]))
        timed = (
            name == "time"
            and column.unit is None
            and unit_in(cells[i], "time") is None
            and is_clock(_cell(rows, below, separator, i))
        )
        read_as[name] = unit = (
            ""
            if name in BARE_COLUMNS
            else "s"
            if timed
            else _unit(path, line, name, column, units[i], _cell(rows, below, separator, i))
        )
        factors[name] = column_factor(column.read_as(name), unit) * (-1.0 if column.flip else 1.0) * column.worth(name)
    said = {name: columns[name].zero if name in columns else 0.0 for name in at}
    found = tuple(name for name, zero in said.items() if zero == ZERO_AT_CONTACT)
    zeros: dict[str, float] = {}
    for name, zero in said.items():
        assert not isinstance(zero, tuple)  # each file has its own one: see `columns_of_file`
        zeros[name] = 0.0 if isinstance(zero, str) else zero
    notes = tuple(cells_of(row, separator)[0] for _, row in rows[:k])
    taken = tuple(n for n in usual if _name(cells[at[n]], units[at[n]]) is None)
    return Head(text, separator, tuple(cells), at, read_as, factors, zeros, k, below, notes, tuple(units), taken, found)


def separator_of(row: str) -> str:
    """Semicolon, tab or comma: the first of them that the line has outside quotes."""
    bare = _QUOTED_CELL.sub("", row)
    return next((s for s in (";", "\t") if s in bare), ",")


def _split(rows: Sequence[Row], k: int) -> tuple[str, list[str], list[str], int]:
    """A line as a header: separator, cells, the unit that stands beneath each (or nothing), and where rows go on."""
    separator = separator_of(rows[k][1])
    cells = cells_of(rows[k][1], separator)
    if k + 1 < len(rows):
        units = [cell.strip("[]() ") for cell in cells_of(rows[k + 1][1], separator)]
        if not any(cells[len(units) :] + units[len(cells) :]):  # separators at the end of one of the two
            units = (units + [""] * len(cells))[: len(cells)]
        if len(units) == len(cells) and not any(map(is_number, units)) and any(map(is_unit, units)):
            return separator, cells, units, k + 2
    return separator, cells, [""] * len(cells), k + 1


def clock_seconds(cell: str) -> float | None:
    """A time of day, 10:02:03.5 with or without a date before it, as seconds since midnight; else None."""
    match = _CLOCK_TIME.fullmatch(cell.strip())
    return None if match is None else 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3].replace(",", "."))


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day."""
    return clock_seconds(cell) is not None


def _cell(rows: Sequence[Row], k: int, separator: str, i: int) -> str:
    """The i-th cell of the k-th of some rows, empty where there is none."""
    cells = cells_of(rows[k][1], separator) if k < len(rows) else []
    return cells[i] if i < len(cells) else ""


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal comma or point."""
    return decimal_number(cell) is not None


def decimal_number(cell: str) -> float | None:
    """The number of a cell, with a decimal comma or point and a minus as a word processor writes it; None of words."""
    try:
        return float(cell.translate(_DECIMAL_MARKS))
    except ValueError:
        return None


def unit_of_cell(cell: str) -> str:
    """The unit behind the number of a cell, "0.5 mm"; empty where there is none."""
    match = _CELL_WITH_UNIT.fullmatch(cell.translate(_DECIMAL_MARKS).strip())
    return match[1] if match and (match[1] == "%" or is_unit(match[1])) else ""


def _filled(row: str) -> list[str]:
    """Cells of a line up to the last that is not empty."""
    cells = cells_of(row, separator_of(row))
    while cells and not cells[-1]:
        cells.pop()
    return cells


@functools.lru_cache(maxsize=64)  # the first lines of a file are asked several times, and may be long
def numbers_in(row: str) -> int:
    """How many numbers a line holds that holds nothing else, 0 for another line and for a single number."""
    cells = _filled(row)
    return len(cells) if len(cells) > 1 and all(map(is_number, cells)) else 0


def _name(cell: str, beneath: str) -> str | None:
    """The known name that a header has by itself or with the unit beneath it, if any."""
    for text in (cell, f"{cell} [{beneath}]"):
        try:
            return header(text)[0]
        except ValueError:
            continue
    return None


def _names(rows: Sequence[Row], k: int) -> Iterator[tuple[str, str | None]]:
    """Cells of a line and the known names that they have.

    Separators at its end make no cells, nor does one before all others: the index that pandas writes has no header.
    """
    _, cells, units, _ = _split(rows, k)
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    first = int(len(cells) > 1 and not cells[0])
    return ((cell, _name(cell, unit)) for cell, unit in zip(cells[first:], units[first:], strict=False))


def _is_header(rows: Sequence[Row], k: int) -> bool:
    return all(name for _, name in _names(rows, k))


def _understood(path: Path, rows: Sequence[Row]) -> int:
    """The first line that is wholly an understood header; it stands above the first row of numbers."""
    best = None
    for k, (_, row) in enumerate(rows):
        if numbers_in(row):
            break
        if _is_header(rows, k):
            return k
        if best is None and any(name for _, name in itertools.islice(_names(rows, k), _MAX_HEADERS)):
            best = k
    best = _likely(rows) if best is None else best
    unknown = (cell for cell, name in _names(rows, best) if name is None)
    first = next(unknown)
    cell = next((c for c in itertools.chain([first], unknown) if not header_aliases.is_one(c)), first)
    try:
        header(cell)
    except ValueError as error:
        message = str(error)
    if header_aliases.is_one(cell) and (missing := _missing(rows, best)):
        message = missing  # what is there is understood
    headless = _HEADLESS_ADVICE if numbers_in(rows[best][1]) else _by_blanks(rows, best)
    fail(path, rows[best][0], f"{message}; {_OTHER_NAMES_ADVICE}{headless}{_of_strains(rows, best)}")


def _of_strains(rows: Sequence[Row], k: int) -> str:
    """What to say of a line whose columns are strains and stresses; empty for another."""
    _, cells, units, _ = _split(rows, k)
    cells, units = cells[:_MAX_HEADERS], units[:_MAX_HEADERS]
    strains = [c for c in cells if any(part in c.lower() for part in STRAIN_WORDS)]
    stresses = [c for c, u in zip(cells, units, strict=True) if is_of("MPa", header_aliases.header_unit(c, u, "Fz"))]
    told = [f"{c!r} is no depth: multiply it by the length that it was divided by" for c in strains[:1]]
    told += [f"{c!r} is no force: multiply it by the area that it was divided by" for c in stresses[:1]]
    return "".join(f". {t}" for t in told)


def _missing(rows: Sequence[Row], k: int) -> str:
    """Which of depth and Fz no column of a line is by a usual name; empty where both are there, or neither."""
    _, cells, units, _ = _split(rows, k)
    cells, units = cells[:_MAX_HEADERS], units[:_MAX_HEADERS]
    there = {
        name: [
            cell
            for cell, unit in zip(cells, units, strict=True)
            if _name(cell, unit) == name or header_aliases.bare_header(cell, name) in KNOWN_COLUMN_NAMES[name]
        ]
        for name in ("depth", "Fz")
    }
    lacking = [name for name, own in there.items() if not own]
    if len(lacking) != 1:
        return ""
    found = ", ".join(repr(cell[:_MAX_HEADER_CHARACTERS]) for cell in cells[:_MAX_HEADERS] if cell)
    text = f"no column is called {'a depth' if lacking == ['depth'] else 'a force'}; found are {found}"
    timed = lacking == ["depth"] and any(
        header_aliases.bare_header(c, "time") in KNOWN_COLUMN_NAMES["time"] for c in cells
    )
    return (
        f"{text}. At a steady speed the depth is that times the time: write it as a column depth_mm" if timed else text
    )


def _customary(path: Path, rows: Sequence[Row], notes: Sequence[str] = ()) -> dict[str, Column]:
    """The columns of the first line that is a header by what machines write; none where one is understood itself."""
    found: dict[str, Column] = {}
    for k, (line, row) in enumerate(rows[:_HEADER_SEARCH_LINES]):
        if numbers_in(row):
            continue  # of a table of results above the readings, perhaps
        if _is_header(rows, k):
            return {}
        separator, cells, units, below = _split(rows, k)
        if found or not 1 < len(cells) <= _MAX_HEADERS:
            continue
        try:
            known = [_name(c, u) for c, u in zip(cells, units, strict=True)]
            if bends := cantilever.bending(cells, units, known):
                numbers = _numbers(rows[below : below + _MAX_SENSE_ROWS], separator, len(cells))
                if np.isfinite(numbers[:, list(bends)]).all(axis=1).any():
                    above = [*notes, *(text for _, text in rows[:k])]
                    raise cantilever.question(f"{path}:{line}", cells, units, bends, numbers, above)
            clocks = [is_clock(_cell(rows, below, separator, i)) for i in range(len(cells))]
            at = header_aliases.named_columns(cells, units, known, clocks)
        except cantilever.Unsaid:
            raise
        except ValueError as error:
            fail(path, line, str(error))
        found = {name: Column(cells[i]) for name, i in at.items()}
        if "time" in at and (unit := header_aliases.header_unit(cells[at["time"]], units[at["time"]], "time")):
            found["time"] = Column(cells[at["time"]], unit=unit)
    return found


def _numbers(rows: Sequence[Row], separator: str, width: int) -> np.ndarray:
    """The numbers (n, width) of some rows, NaN where there is none."""

    def number(cell: str) -> float:
        return math.nan if (found := decimal_number(cell)) is None else found

    cells = [(cells_of(text, separator) + [""] * width)[:width] for _, text in rows]
    return np.array([[number(cell) for cell in row] for row in cells]).reshape(-1, width)


def _by_blanks(rows: Sequence[Row], k: int) -> str:
    """What to say of a header whose words are parted by blanks and are not as many as those of the last row."""
    for mark in UNUSUAL_SEPARATORS:
        if 0 < rows[k][1].count(mark) == rows[-1][1].count(mark) and not any(s in rows[-1][1] for s in ";\t"):
            return f"; are the columns parted by {mark!r}? Part them by semicolons or tabs"
    words, below = rows[k][1].split(), rows[-1][1].split()
    if len(words) < 2 or len(below) < 2 or len(words) == len(below) or any(s in rows[k][1] for s in ";\t,"):
        return ""
    return (
        f"; blanks part {len(words)} words of this line and {len(below)} of line {rows[-1][0]}: give each column one "
        "word in every row, or part them by semicolons"
    )


def _named(path: Path, rows: Sequence[Row], columns: Mapping[str, Column]) -> int:
    """The first line whose cells contain all headers that the study names."""
    wanted: dict[str, str] = {}
    for name, column in columns.items():
        text = same_letters(column.header)
        wanted[text] = f"{wanted[text]}, {name}" if text in wanted else name
    best, most = None, 0
    for k, row in enumerate(same_letters(row) for _, row in rows):
        if any(text in row for text in wanted):
            known = len(wanted.keys() & set(cells_of(row, separator_of(row))))
            if known == len(wanted):
                return k
            best, most = (k, known) if known > most else (best, most)
    best = _likely(rows) if best is None else best
    line, text = rows[best]
    cells = cells_of(text, separator_of(text))
    missing = {text: name for text, name in wanted.items() if text not in map(same_letters, cells)}
    first = next(iter(missing)).lower()
    shown = sorted(
        {cell[:_MAX_HEADER_CHARACTERS] for cell in cells[:_MAX_HEADERS] if cell},
        key=lambda cell: (-SequenceMatcher(None, first, cell.lower()).ratio(), cell),
    )
    each = ", ".join(f"{text!r} ({name})" for text, name in missing.items())
    headless = _HEADLESS_ADVICE if numbers_in(text) else _by_blanks(rows, best)
    own = "; by itself this header is understood: columns = {} for its experiment" if _is_header(rows, best) else ""
    fail(path, line, f"there is no header {each}; choose from {', '.join(map(repr, shown))}{own}{headless}")


def _alike(unit: str, other: str, base: str) -> bool:
    """Whether two texts are the same unit of a kind: sec and s."""
    try:
        return conversion_factor(unit, base) == conversion_factor(other, base)
    except ValueError:
        return False


def _likely(rows: Sequence[Row]) -> int:
    """The line most like a header: the first with as many cells as the first row of numbers, else the first."""
    for k, (_, row) in enumerate(rows):
        if width := numbers_in(row):
            return next((j for j in range(k) if len(_filled(rows[j][1])) == width), 0)
    return 0


def _unit(path: Path, line: int, name: str, column: Column, beneath: str, first: str) -> str:
    """The unit of a column whose first cell is `first`; ValueError unless study, header and row of units agree as far
    as they say one."""
    like = column.read_as(name)
    base = kind_of(like)
    choices = f'{UNITS_OF_KIND[base]}, or "0.00125 {base}" for what one count is{_bends(name, column)}'
    said = {"the study": column.unit, "the header": unit_in(column.header, like)}
    said["the row beneath the header"] = beneath if is_unit(beneath) else None
    # what the file calls a count is its own affair, unless it is a unit of this kind
    if column.unit is not None and is_counted(column.unit):
        for who in ("the header", "the row beneath the header"):
            if (
                (unit := said[who])
                and is_of(base, unit)
                and conversion_factor(unit, base) != unit_or_count_factor(column.unit, base)
            ):
                fail(path, line, f"column {name!r} ({column.header!r}): the study says {column.unit!r}, {who} {unit!r}")
        return column.unit
    same = (column.unit or "").lower()
    odd = {"the row beneath the header": "" if is_unit(beneath) else beneath}
    odd["the header"] = bracketed(column.header, like) or ""
    for who, unit in odd.items():
        if unit and same and unit.lower() != same and not _alike(unit.lower(), column.unit or "", base):
            fail(
                path,
                line,
                f"column {name!r} ({column.header!r}): the study says {column.unit!r}, {who} {unit!r}, "
                f"which is not a known unit; correct it in the file: {choices}",
            )
    # In capitals S is a siemens, MM no millimetre, and the MN of a machine a mN.
    units = {who: unit for who, unit in said.items() if unit and (who == "the study" or unit.lower() != same)}
    for who, unit in units.items():
        if base == "N" and (force := weight(unit)):
            if column.unit is None:
                fail(
                    path,
                    line,
                    f"column {name!r} ({column.header!r}): {unit!r} is a mass; if its weight is meant, "
                    f"say unit = {force!r} in [columns] of the study",
                )
            units[who] = force
    mega = [
        u
        for u in units.values()
        if base == "N" and is_of(base, u) and conversion_factor(u, base) >= IMPLAUSIBLE_FORCE_UNIT_N
    ]
    if mega and column.unit is None:
        fail(
            path,
            line,
            f"column {name!r} ({column.header!r}): {mega[0]!r} is a meganewton, the weight of a hundred tonnes. For "
            'millinewtons, write unit = "mN" in [columns] of the study',
        )
    if not units:
        if wrong := odd["the header"]:
            fail(
                path,
                line,
                f"column {name!r} ({column.header!r}): the header says {wrong!r}, which is not a known "
                f"unit; correct it in the file: {choices}",
            )
        if unit_of_cell(first):
            fail(
                path,
                line,
                f"column {name!r}: the header {column.header!r} says no unit, but {first[:40]!r} does; "
                f"{UNIT_IN_CELL_ADVICE}",
            )
        told = f" ({beneath!r} beneath it is not a known unit)" if beneath else ""
        fail(
            path,
            line,
            f"column {name!r}: the header {column.header!r} says no unit{told}; give unit = … in "
            f"[columns] of the study: {choices}",
        )
    said_first, known = next(iter(units)), {}
    for who, unit in units.items():
        try:
            known[who] = conversion_factor(unit, base)
        except ValueError as error:
            fail(
                path,
                line,
                f"column {name!r} ({column.header!r}): {who} says {unit!r}: {error}; choose from {choices}",
            )
        if known[who] != known[said_first]:
            one = f"{said_first} says {said[said_first]!r}"
            fail(path, line, f"column {name!r} ({column.header!r}): {one}, {who} {said[who]!r}")
    return units[said_first]


def _bends(name: str, column: Column) -> str:
    """What to say of the unit of a column that something bends under, or may."""
    if name == SUBTRACTED_COLUMN:
        force = "; with stiffness or compliance it is a force" if column.read_as(name) == "Fz" else ""
        return force or "; a force is subtracted with the stiffness or compliance of what it bends"
    return "; stiffness makes a force of a deflection" if column.stiffness is not None else ""
