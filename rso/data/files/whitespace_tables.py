"""Tables whose columns are parted by blanks alone, as numpy.savetxt and many instruments write them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from rso.data.files.columns import Row, is_number, numbers_in

_QUOTED_OR_BARE_WORD, _WIDE_GAP = re.compile(r'"[^"]*"|\S+'), re.compile(r"\s{2,}")
_GAP_BUT_BEFORE_UNIT = re.compile(r"(?<!/)\s+(?![(\[/])")  # blanks but those before a unit
_N_LAST_ROWS = 20  # rows that must not be parted by anything else
_MIN_ROWS_WITH_WORDS, _MAX_SAMPLED_ROWS = 3, 1000  # rows that make a table with words in it, and that tell one


def width_of(rows: Sequence[Row]) -> int:
    """How many columns the rows of a file have where blanks alone part them, 0 for other files.

    By its last row, where that holds numbers alone; else most rows have numbers and words, LOAD, in the same places.
    """
    words = rows[-1][1].split() if rows else []
    if len(words) < 2 or not all(map(is_number, words)):
        return _width_of_most(rows)
    if any(numbers_in(text) for _, text in rows[-_N_LAST_ROWS:]):
        return 0
    return 0 if _empty_between_tabs(rows) else len(words)


def _width_of_most(rows: Sequence[Row]) -> int:
    """The number of words of most rows where at least two of them are numbers, and nothing else parts any."""
    rows = rows[:: 1 + len(rows) // _MAX_SAMPLED_ROWS]
    shapes = Counter(
        tuple(map(is_number, _QUOTED_OR_BARE_WORD.findall(text))) for _, text in rows if not _otherwise_parted(text)
    )
    shape, n = shapes.most_common(1)[0] if shapes else ((), 0)
    return len(shape) if sum(shape) >= 2 and n >= max(_MIN_ROWS_WITH_WORDS, len(rows) // 2) else 0


def _otherwise_parted(text: str) -> bool:
    """Whether semicolons, tabs or commas beside blanks or between numbers part a line."""
    return ";" in text or "\t" in text or numbers_in(text) > 0 or any(w.strip(",") != w for w in text.split())


def _empty_between_tabs(rows: Sequence[Row]) -> bool:
    """Whether nothing stands between tabs of the last row where another of as many, the header, has something."""
    last = rows[-1][1].split("\t")
    empty = [k for k, cell in enumerate(last) if not cell.strip()]
    others = (text.split("\t") for _, text in rows if empty and len(last) > 1)
    return any(len(cells) == len(last) and all(cells[k].strip() for k in empty) for cells in others)


def parted(row: Row, width: int) -> Row:
    """A line with tabs between its cells where it has `width` of them: words, those with a unit behind as one, or what
    two blanks and more part.

    Another line, a note, stays as it is.
    """
    number, text = row
    for cells in (
        _QUOTED_OR_BARE_WORD.findall(text),
        _WIDE_GAP.split(text.strip()),
        _GAP_BUT_BEFORE_UNIT.split(text.strip()),
    ):
        if width and len(cells) == width:
            return number, "\t".join(cells)
    return row
