"""Several tables in one file: the repeats of one test beneath one another, or something that is refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rso.measurement.columns import Head, Row, cells_of, fail, is_number
from rso.units import BARE_COLUMNS

HALF = 0.5  # of the longest stroke: a block that goes as far is a test of its own
START = 0.1  # of it: where all blocks begin
FEWEST = 4  # readings of such a block


def beneath(path: Path, rows: Sequence[Row], head: Head) -> tuple[list[tuple[int, list[Row]]], list[str]]:
    """Readings below a header of a file by table, each with the line of its header, and notes between them.

    A table begins where the header stands again, with its row of units if it has one.  Lines directly above it are
    notes where they hold no number in a column that is read, or begin as one above the first header does.
    """
    tables: list[tuple[int, list[Row]]] = [(rows[head.above][0], [])]
    notes: list[str] = []
    again, unit_row = _filled(head.text, head), -1
    for k, (number, row) in enumerate(rows[head.below :]):
        if k == unit_row and not _numbers(cells := _filled(row, head), head):
            _same_units(path, number, cells, head)
            continue
        if again[-1] not in row or _filled(row, head) != again:
            tables[-1][1].append((number, row))
            continue
        last, between = tables[-1][1], []
        while last and _is_note(_filled(last[-1][1], head), head):
            between.append(" ".join(filter(None, cells_of(last.pop()[1], head.separator))))
        notes += reversed(between)
        tables.append((number, []))
        unit_row = k + 1 if any(head.units) else -1
    return tables, notes


def labels_of(path: Path, tables: Sequence[tuple[int, list[Row]]], own: Sequence[str]) -> list[str]:
    """What the repeat of each row is called: by its table, or as a column `own` says, which counts through all."""
    if not own:
        return [str(k) for k, (_, rows) in enumerate(tables, 1) for _ in rows]
    at, seen = 0, dict[str, int]()
    for line, rows in tables:
        mine = dict.fromkeys(own[at : at + len(rows)])
        at += len(rows)
        for label in mine:
            if label in seen:
                fail(path, line, f"a table begins again, with the repeat {label!r} of the one above: number its column "
                     "'repeat' through all tables, or do without it, then each table is a repeat")  # fmt: skip
        seen |= dict.fromkeys(mine, line)
    return list(own)


def blocks(line: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Number of the block of each row (n,), from 1 on, where empty lines or comments part a table into repeats.

    They do where every block begins near the same depth and goes as far as the others; else all is one block.
    """
    one = np.ones(len(line), int)
    block = one + np.cumsum(np.diff(line, prepend=line[0]) > 1)
    parts = [depth[block == k] for k in range(1, block[-1] + 1)]
    if len(parts) < 2 or min(map(len, parts)) < FEWEST:
        return one
    strokes, starts = np.array([np.ptp(v) for v in parts]), np.array([v[0] for v in parts])
    longest = float(strokes.max())
    alike = strokes.min() > HALF * longest and np.ptp(starts) <= START * longest
    return block if alike and longest > 0.0 else one


def told(lines: Sequence[int], *, headed: bool) -> str:
    """The remark on a file that holds several repeats without saying so."""
    where = ", ".join(map(str, lines[:6])) + (", …" if len(lines) > 6 else "")
    what = "tables stand beneath one another" if headed else "blocks are parted by empty lines or comments"
    return (
        f"{len(lines)} {what} (from the lines {where}) and are read as repeats of one test; different tests are files "
        "of their own, a way back is told by a column 'segment'"
    )


def no_reading(path: Path, number: int, cells: Sequence[str], head: Head) -> None:
    """ValueError for a row of words where readings are expected: another table, or a line of text."""
    read = [cells[k] for name, k in head.at.items() if name not in BARE_COLUMNS and k < len(cells)]
    if any(map(str.isalpha, "".join(read))) and not any(cell[:1].isdigit() or is_number(cell) for cell in read):
        row, above = (" ".join(filter(None, v))[:80] for v in (cells, head.cells))
        fail(path, number, f"{row!r} is no reading beneath the header {above!r}; a second table is a file of its own "
             "(repeats of one test may stand beneath one another, each with the same header); begin a note with #, or "
             "delete it")  # fmt: skip


def _same_units(path: Path, number: int, cells: Sequence[str], head: Head) -> None:
    for name, k in head.at.items():
        unit = cells[k].strip("[]() ") if k < len(cells) else ""
        if unit != head.units[k]:
            fail(path, number, f"column {name!r}: {unit!r} beneath the header of this table, {head.units[k]!r} beneath "
                 "that of the first; make them files of their own")  # fmt: skip


def _filled(row: str, head: Head) -> list[str]:
    cells = cells_of(row, head.separator)
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _numbers(cells: Sequence[str], head: Head) -> int:
    """How many columns of numbers that are read hold one."""
    at = [k for name, k in head.at.items() if name not in BARE_COLUMNS]
    return sum(k < len(cells) and is_number(cells[k]) for k in at)


def _is_note(cells: Sequence[str], head: Head) -> bool:
    first = cells[0] if cells else ""
    return not _numbers(cells, head) or (first in head.notes and not is_number(first) and first != "")
