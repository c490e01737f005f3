"""Lines that a machine writes among readings: marks, settings of a block, totals.  They are notes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rso.core.units import BARE_COLUMNS
from rso.data.files.columns import Head, Row, cells_of, is_number

MIN_BLOCK_READINGS = 4  # readings below a mark that begin a block
MISSING_VALUES = ("", "nan", "na", "n/a", "#n/a", "null", "none")
_DRAWN_LINE = re.compile(r"[-=*_~]{3,}")  # a line drawn beneath a header
_NUMERIC_START = re.compile(r"[\s\"']*[-+\u2212]?[.,]?\d")


def parted_from_readings(rows: Sequence[Row], head: Head) -> tuple[list[Row], list[str], list[str]]:
    """Rows below a header without a machine's own lines, those lines, and what to say of them.

    Such are, where readings begin with numbers, lines that begin with words and have more or fewer cells than the
    header, or one cell alone; they stand above the first reading, at the end, before a header, or before at least
    MIN_BLOCK_READINGS readings.  At the very end lines of words may have as many cells as the header.  Where the first
    column is read for codes or labels, a line with numbers in all others that are read is a reading, whatever else it
    lacks.
    """
    width = len(filled_cells(head.text, head.separator))
    again = filled_cells(head.text, head.separator)
    odd = [k for k, (_, text) in enumerate(rows) if not _NUMERIC_START.match(text)]
    if width < 2 or not odd or len(odd) == len(rows):
        return list(rows), [], []
    numeric = len(odd) < 0.5 * len(rows) and all(map(is_number, [c for c in [_first_reading(rows, odd, head)] if c]))
    cells = {k: filled_cells(rows[k][1], head.separator) for k in odd}
    header = {k for k in odd if cells[k] == again}
    words = {k for k in odd if k not in header and cells[k] and _is_words(cells[k][0])}
    drawn = {k for k in odd[:2] if cells[k] and all(map(_DRAWN_LINE.fullmatch, cells[k]))}
    words |= drawn
    if any(k == 0 for name, k in head.at.items() if name in BARE_COLUMNS):
        every = sum(name not in BARE_COLUMNS for name in head.at)
        words -= {k for k in words if _numbers(cells[k], head) == every}
    single = {k for k in words if len(cells[k]) == 1}
    other = {k for k in words if numeric and len(cells[k]) != width} | single | drawn
    end = len(rows)
    while end and (end - 1 in other or (numeric and end - 1 in words)):
        end -= 1
    found = {k for k in range(end, len(rows))} if end else set()
    for k in sorted(other - found):
        after = k
        while after in other:
            after += 1
        readings = all(j < len(rows) and j not in cells for j in range(after, after + MIN_BLOCK_READINGS))
        if after in header or readings or after < min(set(range(len(rows))) - cells.keys(), default=0):
            found.add(k)
    doubts = [
        f"line {rows[k][0]} ({' '.join(filter(None, cells[k]))[:40]!r}) stands beneath the readings and begins "
        "with a word: it is taken for a note"
        for k in sorted(found)
        if len(cells[k]) == width and _numbers(cells[k], head)
    ]
    notes = [" ".join(filter(None, cells[k])) for k in sorted(found)]
    return [row for k, row in enumerate(rows) if k not in found], notes, doubts


def filled_cells(row: str, separator: str) -> list[str]:
    """Cells of a line up to the last that is not empty."""
    cells = cells_of(row, separator)
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _first_reading(rows: Sequence[Row], odd: Sequence[int], head: Head) -> str:
    """The first cell of the first line that begins with a number."""
    skip = set(odd)
    return next((cells_of(text, head.separator)[0] for k, (_, text) in enumerate(rows) if k not in skip), "")


def _is_words(cell: str) -> bool:
    """Whether a cell begins with a letter and is no number, and no value that is missing."""
    first = next(filter(str.isalnum, cell), "")
    return first.isalpha() and not is_number(cell) and cell.strip().lower() not in MISSING_VALUES


def _numbers(cells: Sequence[str], head: Head) -> int:
    at = [k for name, k in head.at.items() if name not in BARE_COLUMNS]
    return sum(k < len(cells) and is_number(cells[k]) for k in at)
