"""Several tables beside one another in one file, one curve each, as spreadsheets and presses write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rso.data.files.columns import Row, cells_of, is_number, separator_of
from rso.data.files.workbook import sheet_of, sheet_without_block, title_read

BESIDE_HEADER_SEARCH_LINES = 60  # lines among which the header stands
MAX_LISTED_LABELS = 6  # labels that a message lists
_COUNT_SUFFIX = re.compile(r"\.\d+$")  # which pandas puts behind a name that stands again


def table_beside(path: Path, rows: Sequence[Row], block: int) -> tuple[list[Row], bool]:
    """The rows of table number `block` of several beside one another, and whether there are several.

    They are seen by a header whose names stand again and again in the same order, each in an own column of two and
    more.  Raises ValueError where there are several and none is named, or one that is not there.
    """
    found = next(((k, w) for k, row in enumerate(rows[:BESIDE_HEADER_SEARCH_LINES]) if (w := _period(row[1]))), None)
    if found is None:
        return list(rows), False
    k, width = found
    separator = separator_of(rows[k][1])
    above = cells_of(rows[k - 1][1], separator) if k else []
    starts = range(0, len(_names(rows[k][1])), width)
    labels = [next(filter(None, above[at : at + width]), "") for at in starts]
    if not 0 < block <= len(labels):
        file, sheet = sheet_of(path)
        inside = f"#{sheet_without_block(sheet) or title_read(file)}" if file.suffix.lower() == ".xlsx" else ""
        each = [f"{file.name}{inside}#{n}" + (f" ({v})" if v else "") for n, v in enumerate(labels, 1)]
        many = f"{', '.join(each[:MAX_LISTED_LABELS])}{', …' if len(each) > MAX_LISTED_LABELS else ''}"
        said = (
            f"there is no table {block}" if block else f"{len(labels)} tables with the same header stand side by side"
        )
        raise ValueError(
            f"{file}:{rows[k][0]}: {said}; name one: {many}. Several in a list are repeats of one test; in a table of "
            "specimens each is a row"
        )
    at = starts[block - 1]
    own = [(number, _part(text, separator, at, width)) for number, text in rows[k:]]
    own[0] = own[0][0], separator.join(_COUNT_SUFFIX.sub("", name) for name in own[0][1].split(separator))
    notes = [(rows[k - 1][0], labels[block - 1])] if labels[block - 1] else list(rows[k - 1 : k])
    return [*rows[: max(k - 1, 0)], *notes, *(row for row in own if row[1].strip(f"{separator} "))], True


def _names(text: str) -> list[str]:
    """Cells of a line without what counts them and without empty ones at its end."""
    cells = [_COUNT_SUFFIX.sub("", cell).casefold() for cell in cells_of(text, separator_of(text))]
    return cells[: max((n for n, cell in enumerate(cells, 1) if cell), default=0)]


def _period(text: str) -> int:
    """After how many columns the names of a header stand again, 0 for what is no such header."""
    cells = _names(text)
    if len(cells) < 4 or any(map(is_number, cells)):
        return 0
    for width in range(2, (len(cells) + 1) // 2 + 1):
        full = cells + [""] * (-len(cells) % width)  # a spacer behind the last table is left out
        groups = [tuple(full[at : at + width]) for at in range(0, len(full), width)]
        names = [name for name in groups[0] if name]
        if len(names) > 1 and len(set(names)) == len(names) and len(groups) > 1 and len(set(groups)) == 1:
            return width
    return 0


def _part(text: str, separator: str, at: int, width: int) -> str:
    """The cells of one table in a line."""
    cells = cells_of(text, separator)[at : at + width]
    while cells and not cells[-1]:
        cells.pop()
    return separator.join(f'"{c}"' if separator in c else c for c in cells)
