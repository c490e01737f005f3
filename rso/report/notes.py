"""What data files say of themselves: comment lines as the sentences that they were before they were broken."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from rso.report.layout.digits import clean
from rso.report.layout.document import Text
from rso.report.reading import Results, listed

MAX_OPENING_CHARACTERS = 200  # characters of a file's notes that the first page has room for
MAX_DATA_REMARKS = 4  # of them
# of the longest line, if that has so many characters: such a line goes on in the next
_FULL_LINE_SHARE, _MIN_FULL_LINE_CHARACTERS = 0.7, 40
_SENTENCE_END = re.compile(r"[.!?;:][)\]”\"']*$")
_ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|cf|approx|ca|figs?|eqs?|no|vs|al|dr|st|z\.B|bzw|[A-Z])\.$", re.IGNORECASE)


def sentences(notes: Sequence[object]) -> list[str]:
    """Sentences of comment lines; a short line without an end is one of its own."""
    lines = [line for n in notes if (line := clean(n).strip())]
    longest, text = max(map(len, lines), default=0), ""
    for line, following in zip(lines, [*lines, ""][1:], strict=True):
        broken = longest >= _MIN_FULL_LINE_CHARACTERS and len(line) >= _FULL_LINE_SHARE * longest and following
        whole = _SENTENCE_END.search(line) or broken or following[:1].islower()
        text += line + (" " if whole else ". ")
    found: list[str] = []
    for piece in re.split(r"(?<=[.!?])\s+(?=[A-ZÄÖÜ0-9\"“(])", text.strip()):
        if found and _ABBREVIATION.search(found[-1]):
            found[-1] += f" {piece}"
        else:
            found.append(piece)
    return found


def opening(notes: Sequence[object], length: int = MAX_OPENING_CHARACTERS) -> str:
    """As many whole first sentences as have room, and at least one."""
    said = ""
    for s in sentences(notes):
        if said and len(said) + len(s) >= length:
            break
        said += f" {s}" if said else s
    return said


def of_file(e: Mapping[str, Any]) -> list[object]:
    """The notes that stand in the data file itself; before them come those about it."""
    return list(e.get("notes") or ())[int(e.get("remarks") or 0) :]


def data_remarks(results: Results) -> list[Text]:
    """The first sentences of every data file that says something, alike ones once."""
    said: dict[str, list[str]] = {}
    for e in listed(results, "experiments"):
        if text := opening(of_file(e)):
            said.setdefault(text, []).append(clean(e.get("file") or e["name"]))
    rows = [Text(f"{', '.join(dict.fromkeys(where))}: {text}", "remark") for text, where in said.items()]
    more = len(rows) - MAX_DATA_REMARKS
    rest = [Text(f"{more} more files have notes; see Provenance.", "remark")] if more > 0 else []
    return rows[:MAX_DATA_REMARKS] + rest
