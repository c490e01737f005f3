"""Tables whose columns are parted by blanks alone, as numpy.savetxt and many instruments write them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rso.measurement.columns import Row, is_number, numbers_in

_WORDS, _GAPS = re.compile(r'"[^"]*"|\S+'), re.compile(r"\s{2,}")
_LAST = 20  # rows that must not be parted by anything else


def width_of(rows: Sequence[Row]) -> int:
    """How many columns the rows of a file have where blanks alone part them, by its last row; 0 for other files."""
    words = rows[-1][1].split() if rows else []
    if len(words) < 2 or not all(map(is_number, words)) or any(numbers_in(text) for _, text in rows[-_LAST:]):
        return 0
    return 0 if _empty_between_tabs(rows) else len(words)


def _empty_between_tabs(rows: Sequence[Row]) -> bool:
    """Whether nothing stands between tabs of the last row where another of as many, the header, has something."""
    last = rows[-1][1].split("\t")
    empty = [k for k, cell in enumerate(last) if not cell.strip()]
    others = (text.split("\t") for _, text in rows if empty and len(last) > 1)
    return any(len(cells) == len(last) and all(cells[k].strip() for k in empty) for cells in others)


def parted(row: Row, width: int) -> Row:
    """A line with tabs between its cells where it has `width` of them: words, or what two blanks and more part.

    Another line, a note, stays as it is.
    """
    number, text = row
    for cells in (_WORDS.findall(text), _GAPS.split(text.strip())):
        if width and len(cells) == width:
            return number, "\t".join(cells)
    return row
