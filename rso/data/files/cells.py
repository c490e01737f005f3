"""The cells of one row of a table: as many as its header has, numbers, words for segments; ValueError for all else."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rso.core.units import kind_of
from rso.data.branches import SEGMENTS, SKIP_SEGMENT
from rso.data.files import tables
from rso.data.files.columns import (
    UNIT_IN_CELL_ADVICE,
    Head,
    Row,
    cells_of,
    clock_seconds,
    decimal_number,
    fail,
    is_number,
    unit_of_cell,
)

_SEPARATOR_NAMES = {";": "semicolons", "\t": "tabs", ",": "commas"}
_MAX_CELL_NUMBER = 1e12  # in any unit: beyond it stand marks of loggers
_MAX_CELL_TIME = 1e19  # of a cell of times: nanoseconds since 1970 are 1.7e18
_MAX_PLAUSIBLE = {"mm": 1e4, "N": 1e6}  # ten metres, a hundred tonnes: no indenter, but a unit misread
_GROUPED_DIGITS = re.compile(r"[+-]?\d{1,3}(?:[\s'’.,]\d{3})+(?:[.,]\d*)?")
_AMBIGUOUS_THOUSANDS, _WHOLE_NUMBER = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}"), re.compile(r"[+-]?\d+")


def row_of(path: Path, number: int, row: str, head: Head) -> list[str]:
    """The cells of a row, as many as the header has; separators at the end of either make no cell."""
    cells = cells_of(row, head.separator)
    while len(cells) > len(head.cells) and not cells[-1]:
        cells.pop()
    if not any(head.cells[len(cells) :]):
        cells += [""] * (len(head.cells) - len(cells))
    if len(cells) == len(head.cells) - 1 and head.cells[-1] == "Comment" in head.unread:
        return cells  # LabVIEW leaves the last cell away where there is no comment
    if len(cells) != len(head.cells):
        words = len(row.split()) if head.separator == "\t" not in row else 0  # a line of a table parted by blanks
        n = words if words not in (0, len(head.cells)) else len(cells)
        halved = head.separator == "," and n == 2 * len(head.cells) and all(map(str.isdigit, "".join(cells[1::2])))
        comma = "are these decimal commas? part the columns by semicolons, or write points; else " if halved else ""
        if (other := _other_separator(row, head)) is not None:
            told = f"the header {head.text!r} is parted by {_SEPARATOR_NAMES[head.separator]}, this row by"
            fail(path, number, f"{told} {_SEPARATOR_NAMES[other]}: {row.strip()[:60]!r}; part both alike")
        fail(
            path,
            number,
            f"{n} values in a table of {len(head.cells)} columns ({head.text!r}): {row.strip()[:60]!r}; "
            f"{comma}delete what is no reading, or begin its line with #. A second table belongs into its own file, "
            "unless it has the same header",
        )
    if not head.cells[-1] and cells[-1]:
        fail(path, number, f"{cells[-1][:40]!r} stands beneath no header ({head.text!r})")
    return cells


def _other_separator(row: str, head: Head) -> str | None:
    """What parts a row into as many numbers as the header has cells, where that is not what parts the header."""
    for separator in _SEPARATOR_NAMES:
        cells = cells_of(row, separator)
        if separator != head.separator and len(cells) == len(head.cells) and all(map(is_number, cells)):
            return separator
    return None


def require_plausible(path: Path, line: Sequence[int], name: str, column: np.ndarray, unit: str) -> None:
    """ValueError where a length or force is larger than any of a test; `unit` is the one it was read in."""
    base = kind_of(name)
    if base in _MAX_PLAUSIBLE and (beyond := np.abs(column) > _MAX_PLAUSIBLE[base]).any():
        k = int(np.argmax(beyond))
        told = f"{column[k]:g} {base} is larger than in any test ({_MAX_PLAUSIBLE[base]:g} {base}); read as {unit!r}"
        fail(path, line[k], f"column {name!r}: {told}; another unit is said with [columns] in the study file")


def counters(head: Head, columns: Sequence[int], cells: Sequence[str]) -> list[int]:
    """Which of the columns are not read and hold a number in this row."""
    return [k for k in columns if k not in head.at.values() and k < len(cells) and is_number(cells[k])]


def no_summary(path: Path, number: int, cells: Sequence[str], head: Head, counting: Sequence[int]) -> None:
    """ValueError where a word stands in a column that had a number in every row above: Max beneath the readings."""
    for k in counting:
        # Only letters: overflows are dashes, and thousands may be parted where nothing is read.
        if k < len(cells) and any(map(str.isalpha, cells[k])) and not is_number(cells[k]):
            told = f"{cells[k][:40]!r} beneath numbers, as in a row of a summary; delete the row"
            fail(path, number, f"column {head.cells[k]!r}: {told}")


def no_thousands(path: Path, rows: Sequence[Row], head: Head) -> None:
    """ValueError where a comma or point may part thousands and not decimals: 1,250 after 750 or 0, or 1.250,5.

    Between commas a point alone parts decimals.
    """
    numeric = {k: name for name, k in head.at.items() if name not in ("repeat", "segment")}
    marks: dict[str, tuple[int, str]] = {}
    thousands: dict[int, tuple[int, str]] = {}
    whole, other = dict[int, str](), set[int]()
    for number, row in rows:
        cells = cells_of(row, head.separator)
        for k in numeric if len(cells) >= len(head.cells) - 1 else ():
            cell = cells[k] if k < len(cells) else ""
            if ("," in cell) != ("." in cell):  # both in one is no number at all
                marks.setdefault("," if "," in cell else ".", (number, cell))
            if _AMBIGUOUS_THOUSANDS.fullmatch(cell):
                thousands.setdefault(k, (number, cell))
            elif "," in cell or "." in cell:
                other.add(k)
            elif _WHOLE_NUMBER.fullmatch(cell):
                whole.setdefault(k, cell)
    if len(marks) == 2 and thousands:
        (line, one), (_, two) = (marks[m] for m in ".,")
        fail(path, line, f"{one!r} has a point, {two!r} a comma: one of them parts thousands; write 1250, not 1,250")
    either = {k: v for k, v in thousands.items() if head.separator != "," or "," in v[1]}
    if doubtful := {k: v for k, v in either.items() if k in whole and k not in other}:
        k, (line, cell) = next(iter(doubtful.items()))
        # Whoever prints three decimals prints them of 0 and 50 too.
        told = f"{cell!r} beside {whole[k]!r} is a thousand or a decimal; write 1250 or 1.2500"
        fail(path, line, f"column {numeric[k]!r}: {told}")
    if either and not other:  # 10,000 to 16,000 beside whole numbers, and no cell of the table has other decimals
        k, (line, cell) = next(iter(either.items()))
        told = (
            f"{cell!r} is a thousand or a decimal, and no other number of the table shows which; write "
            f"{cell[:-4]}{cell[-3:]} or"
        )
        fail(path, line, f"column {numeric[k]!r}: {told} {cell}0")


def cell_number(path: Path, line: int, name: str, cells: Sequence[str], head: Head) -> float:
    """One cell as a finite float; a comma that is left in it is a decimal one, between commas in quotes."""
    cell = cells[head.at[name]]
    if name == "time" and head.unit[name] == "s" and (clock := clock_seconds(cell)) is not None:
        return clock
    value = math.nan if (found := decimal_number(cell)) is None else found
    # float() also reads 1_000 as a number, which nobody means in a table.
    if not math.isfinite(value) or "_" in cell:
        tables.no_reading(path, line, cells, head)
        fail(path, line, f"column {name!r}: {cell[:40]!r} is not a finite number{_hint(name, cell)}")
    most = _MAX_CELL_TIME if name == "time" else _MAX_CELL_NUMBER
    if abs(value) > most:
        large = f"is larger than anything measured ({most:g}); "
        large += "a mark for an overload or a gap? Delete such rows"
        fail(path, line, f"column {name!r}: {cell[:40]!r} {large}")
    if value < 0 and name.endswith("_sigma"):
        fail(path, line, f"column {name!r}: {cell[:40]!r} is negative, a standard uncertainty is not")
    return value


def _hint(name: str, cell: str) -> str:
    """What to do about a cell that is no number."""
    if ":" in cell and name == "time":
        return " and no time of day as 10:00:03.5; write seconds, or leave the column out and state settings.speed"
    if unit_of_cell(cell):
        return f"; {UNIT_IN_CELL_ADVICE}"
    if _GROUPED_DIGITS.fullmatch(cell):
        return "; write thousands without a mark between them"
    nothing = cell.lower() == "nan" or cell.startswith("#") or not any(map(str.isdigit, cell))
    return "; delete the row if nothing was measured there" if nothing else ""


def segment_words(path: Path, line: Sequence[int] | np.ndarray, text: list[str]) -> np.ndarray:
    for number, value in zip(line, text, strict=True):
        if value not in SEGMENTS:
            cell = value[:40]
            fail(
                path,
                number,
                f"column 'segment': {cell!r} is none of {', '.join(SEGMENTS)}; what a machine's codes "
                f'mean is said with [columns] in the study: values = {{ "{cell}" = "loading", … }}',
            )
    return np.array(text)


def segments_of(path: Path, rows: Sequence[Row], head: Head, codes: Mapping[str, str]) -> dict[int, str]:
    """Line → what its segment is by the study's `codes`, or SKIP_SEGMENT: that of the line above where a cell is empty.

    Nanoindenters and merged cells of spreadsheets name a segment where it begins.  An empty cell that has a code of
    its own is that.
    """
    found: dict[int, str] = {}
    last = ""
    for row in rows:
        at, cells = head.at["segment"], cells_of(row[1], head.separator)
        empty = last and at < len(cells) and not cells[at].strip() and "" not in codes
        last = found[row[0]] = last if empty else _segment_code(path, row, head, codes)
    return found


def _segment_code(path: Path, row: Row, head: Head, codes: Mapping[str, str]) -> str:
    """What a row's segment is by the study's `codes`, or SKIP_SEGMENT; 1 and 1.0 are the same code."""
    number, text = row
    at, cells = head.at["segment"], cells_of(text, head.separator)
    cell = cells[at] if at < len(cells) else ""
    found = next((own for own in codes if own == cell or _same_number(own, cell)), None)
    if found is None:
        known = ", ".join(map(repr, codes))
        fail(
            path,
            number,
            f"column 'segment' ({head.cells[at]!r}): {cell[:40]!r} is none of {known}; say in its "
            f"values what it is: {', '.join(SEGMENTS)} or {SKIP_SEGMENT}",
        )
    return codes[found]


def _same_number(a: str, b: str) -> bool:
    return is_number(a) and decimal_number(a) == decimal_number(b)
