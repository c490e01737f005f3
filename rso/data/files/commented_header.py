"""A header in comments: "# columns: height vDeflection" with "# units: m V", as microscopes write their text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rso.data.files.columns import Row, cells_of, fail, numbers_in, separator_of

_HEADER_LABEL = re.compile(r"(column|unit)s?\s*[:=]\s*(\S.*)", re.IGNORECASE)
_HEADER_WORD = re.compile(r'"[^"]*"|[^\s,;]+')


def head_of(path: Path, comments: Sequence[Row], rows: Sequence[Row]) -> list[Row]:
    """The names behind "columns:" in the last such comment above bare numbers, as a row, and the units behind "units:".

    ValueError where they are not as many as the numbers, or other columns are named among the readings.
    """
    if not rows or not numbers_in(rows[0][1]):
        return []
    found: dict[str, tuple[int, list[str]]] = {}
    for line, text in comments:
        if (match := _HEADER_LABEL.match(text)) is None:
            continue
        words = [word.strip('"') for word in _HEADER_WORD.findall(match[2])]
        label = match[1].lower()
        if line < rows[0][0]:
            found[label] = line, words
        elif label in found and words != found[label][1]:
            fail(
                path,
                line,
                f"other {label}s are named here than in line {found[label][0]}, {' '.join(words)[:80]!r} "
                f"after {' '.join(found[label][1])[:80]!r}: make the parts files of their own",
            )
    if "column" not in found:
        return []
    separator = separator_of(rows[0][1])
    width = len(cells_of(rows[0][1].rstrip(f" {separator}"), separator))
    line, names = found["column"]
    if len(names) != width:
        fail(path, line, f"names {len(names)} columns, {' '.join(names)[:80]!r}; the rows below have {width}")
    units = found.get("unit", (0, []))
    return [(at, separator.join(words)) for at, words in (found["column"], units) if len(words) == width]
