"""Several tables in one file: the repeats of one test beneath one another, or something that is refused."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rso.contract.responses import FORCE_CHANNELS
from rso.core.digits import range_text
from rso.core.units import BARE_COLUMNS
from rso.data.files.columns import Head, Row, cells_of, fail, is_number
from rso.data.files.machine_lines import MISSING_VALUES, filled_cells, parted_from_readings
from rso.data.files.rows import rows_by_label

MIN_TEST_STROKE_SHARE = 0.5  # of the longest stroke: a block that goes as far is a test of its own
SAME_BLOCK_START_SHARE = 0.1  # of it: where all blocks begin
MIN_REPEAT_READINGS = 4  # readings of such a block
MAX_LOST_ROWS_SHARE = 0.05  # of the rows: where more lack a value the table is refused
PLACE_COLUMNS = ("depth", "x", "y")
MAX_LISTED_BLOCKS = 6  # blocks that a message lists


def tables_beneath(
    path: Path, rows: Sequence[Row], head: Head
) -> tuple[list[tuple[int, list[Row]]], list[str], list[str]]:
    """Readings below a header of a file by table, each with the line of its header, notes between them, remarks.

    A table begins where the header stands again, with its row of units if it has one.  Lines directly above it are
    notes where they hold no number in a column that is read, or begin as one above the first header does.
    """
    tables: list[tuple[int, list[Row]]] = [(rows[head.above][0], [])]
    below, notes, told = parted_from_readings(rows[head.below :], head)
    again, unit_row = filled_cells(head.text, head.separator), -1
    for k, (number, row) in enumerate(below):
        if k == unit_row and not _numbers(cells := filled_cells(row, head.separator), head):
            _same_units(path, number, cells, head)
            continue
        if again[-1] not in row or filled_cells(row, head.separator) != again:
            tables[-1][1].append((number, row))
            continue
        last, between = tables[-1][1], []
        while last and _is_note(filled_cells(last[-1][1], head.separator), head):
            between.append(" ".join(filter(None, cells_of(last.pop()[1], head.separator))))
        notes += reversed(between)
        tables = [t for t in tables if t[1]]  # a header that stands twice begins one table
        tables.append((number, []))
        unit_row = k + 1 if any(head.units) else -1
    return [t for t in tables if t[1]] or tables, notes, told


def table_block(path: Path, tables: Sequence[tuple[int, list[Row]]], number: int) -> list[tuple[int, list[Row]]]:
    """The block of that number of a file: one of several tables, or of the parts of one between lines that are none.

    A single part is given back whole.
    """
    found = list(tables)
    if len(found) < 2:
        parts: list[list[Row]] = []
        for row in found[0][1]:
            if not parts or row[0] > parts[-1][-1][0] + 1:
                parts.append([])
            parts[-1].append(row)
        if len(parts) == 1:  # of which the cycles may be named
            return found
        found = [(part[0][0], part) for part in parts]
    if number > len(found):
        raise ValueError(f"{path}: has no block {number}; it holds {len(found)}")
    return [found[number - 1]]


def without_gaps(tables: Sequence[tuple[int, list[Row]]], head: Head) -> tuple[list[tuple[int, list[Row]]], list[int]]:
    """The tables without rows in which a value is missing, where these are few and single, and the lines of those.

    Samples are lost on a bus or between two clocks.  Several in a row may be an overload, and dashes and words say
    something.
    """
    numeric = [k for name, k in head.at.items() if name not in BARE_COLUMNS]

    def lacks(row: Row) -> bool:
        cells = cells_of(row[1], head.separator)
        return len(cells) == len(head.cells) and any(cells[k].strip().lower() in MISSING_VALUES for k in numeric)

    gaps = [[lacks(row) for row in rows] for _, rows in tables]
    lost = [
        row[0] for (_, rows), gap in zip(tables, gaps, strict=True) for row, no in zip(rows, gap, strict=True) if no
    ]
    in_a_row = any(a and b for gap in gaps for a, b in itertools.pairwise(gap))
    if in_a_row or not 0 < len(lost) <= MAX_LOST_ROWS_SHARE * sum(len(rows) for _, rows in tables):
        return list(tables), []
    gone = set(lost)
    return [(at, [row for row in rows if row[0] not in gone]) for at, rows in tables], lost


def left_out_note(gaps: Sequence[int], left: int) -> list[str]:
    """What to say of rows that were left out, by their lines, beside as many as are left."""
    if not gaps:
        return []
    rows, at = ("1 row has", "line") if len(gaps) == 1 else (f"{len(gaps)} rows have", "lines")
    lines = ", ".join(map(str, gaps[:3])) + (", …" if len(gaps) > 3 else "")
    return [f"{rows} no value ({at} {lines}): left out, {left} remain"]


def labels_of(
    path: Path,
    tables: Sequence[tuple[int, list[Row]]],
    line: np.ndarray,
    columns: Mapping[str, np.ndarray],
    own: Sequence[str],
    segment: np.ndarray | None,
) -> tuple[np.ndarray, list[str]]:
    """What the repeat of each row (n,) is called, and remarks where the file does not say so by a column `own`.

    Tables beneath one another are repeats unless they go on where the one before ended; so are the blocks of a single
    table between empty lines or comments, where all begin near the same depth and go about as far.
    """
    table = np.repeat(np.arange(len(tables)), [len(rows) for _, rows in tables])
    depth, one, headers = columns.get("depth"), np.full(len(line), "1"), [at for at, _ in tables]
    if depth is None:  # which is refused later
        return one, []
    if own:
        _apart(path, table, headers, depth, own)
        return np.array(own), []
    if columns.keys().isdisjoint(FORCE_CHANNELS):
        places = np.stack([v for name, v in columns.items() if name in PLACE_COLUMNS], axis=1)
        twice = len(np.unique(places, axis=0)) < len(places)
        return ((table + 1).astype(str) if twice else one), []
    block = table if len(tables) > 1 else np.cumsum(np.diff(line, prepend=line[0]) > 1)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    parts = np.split(depth, first[1:])
    if len(parts) < 2:
        return one, []
    told = None if segment is None else np.split(segment, first[1:])
    loads = [k for k in range(len(parts)) if told is None or "loading" in told[k]]
    pressed = len(loads) == len(parts)
    if len(tables) < 2 and not pressed:
        anew = [parts[k] for k in loads]
        if len(anew) < 2 or min(map(len, anew)) < MIN_REPEAT_READINGS or not _alike(anew, MIN_TEST_STROKE_SHARE):
            return one, []
        where = _lines([int(line[first[k]]) for k in loads])
        return one, [
            f"{len(anew)} blocks start again {where} and are read as one test; a column 'repeat' separates them"
        ]
    if len(tables) < 2:
        if not (min(map(len, parts)) >= MIN_REPEAT_READINGS and _alike(parts, MIN_TEST_STROKE_SHARE)):
            return one, []
        what = "blocks are parted by empty lines or comments"
        headers = [int(line[k]) for k in first]
    else:
        what = "tables stand beneath one another"
        if not pressed or (
            not _alike(parts, SAME_BLOCK_START_SHARE) and _go_on(parts) and not _anew(columns.get("time"), block)
        ):
            return one, [f"{len(parts)} {what} {_lines(headers)} and are read as one test that goes on in each"]
        if not _alike(parts, MIN_TEST_STROKE_SHARE):
            each = ", ".join(
                f"#{k + 1} from line {headers[k]}: {len(v)} readings, depth from "
                f"{range_text(v[0], v[-1], 'mm', 'to', 4)}"
                for k, v in enumerate(parts[:MAX_LISTED_BLOCKS])
            )
            more = ", …" * (len(parts) > MAX_LISTED_BLOCKS)
            raise ValueError(
                f"{path}: {len(parts)} {what} and are no repeats of one test ({each}{more}): "
                f'name the one that is meant, as in data = "{path.name}#{len(parts)}"'
            )
    said = f"{len(parts)} {what} {_lines(headers)} and are read as repeats of one test"
    return (block + 1).astype(str), [
        f"{said}; put different tests into different files, and mark unloading in a column 'segment'"
    ]


def _apart(path: Path, table: np.ndarray, headers: Sequence[int], depth: np.ndarray, own: Sequence[str]) -> None:
    """ValueError where a label stands in two tables of which the second does not go on where the first ended."""
    for label, at in rows_by_label(own).items():
        parts = [at[table[at] == k] for k in np.unique(table[at])]
        if not _go_on([depth[part] for part in parts]):
            line = headers[table[parts[1][0]]]
            fail(
                path,
                line,
                f"a table begins again, with the repeat {label!r} of the one above. Number its column 'repeat' "
                "through all tables, or remove it: then each table is a repeat",
            )


def _alike(parts: Sequence[np.ndarray], share: float) -> bool:
    """Whether depths of all parts begin near one and go as far as a share of the longest way."""
    strokes, starts = np.array([np.ptp(v) for v in parts]), np.array([v[0] for v in parts])
    longest = float(strokes.max())
    return (
        longest > 0.0 and strokes.min() > share * longest and float(np.ptp(starts)) <= SAME_BLOCK_START_SHARE * longest
    )


def _go_on(parts: Sequence[np.ndarray]) -> bool:
    """Whether depths of each part begin where those of the one before ended."""
    stroke = float(np.ptp(np.concatenate(parts)))
    return all(abs(b[0] - a[-1]) <= SAME_BLOCK_START_SHARE * stroke for a, b in itertools.pairwise(parts))


def _anew(time: np.ndarray | None, block: np.ndarray) -> bool:
    """Whether the clock begins again in a block."""
    return time is not None and bool(np.any(np.diff(time)[np.diff(block) > 0] <= 0.0))


def _lines(lines: Sequence[int]) -> str:
    return f"(from the lines {', '.join(map(str, lines[:6]))}{', …' if len(lines) > 6 else ''})"


def no_reading(path: Path, number: int, cells: Sequence[str], head: Head) -> None:
    """ValueError for a row of words where readings are expected: another table, or a line of text."""
    read = [cells[k] for name, k in head.at.items() if name not in BARE_COLUMNS and k < len(cells)]
    if any(map(str.isalpha, "".join(read))) and not any(cell[:1].isdigit() or is_number(cell) for cell in read):
        row, above = (" ".join(filter(None, v))[:80] for v in (cells, head.cells))
        fail(
            path,
            number,
            f"{row!r} is no reading beneath the header {above!r}. Put a second table into its own file; only "
            "repeats of one test, with the same header, may follow one another. Begin a note with #, or delete it",
        )


def _same_units(path: Path, number: int, cells: Sequence[str], head: Head) -> None:
    for name, k in head.at.items():
        unit = cells[k].strip("[]() ") if k < len(cells) else ""
        if unit != head.units[k]:
            fail(
                path,
                number,
                f"column {name!r}: {unit!r} beneath the header of this table, {head.units[k]!r} beneath "
                "that of the first; make them files of their own",
            )


def _numbers(cells: Sequence[str], head: Head) -> int:
    """How many columns of numbers that are read hold one."""
    at = [k for name, k in head.at.items() if name not in BARE_COLUMNS]
    return sum(k < len(cells) and is_number(cells[k]) for k in at)


def _is_note(cells: Sequence[str], head: Head) -> bool:
    first = cells[0] if cells else ""
    return not _numbers(cells, head) or (first in head.notes and not is_number(first) and first != "")
