"""Texts and tables of a study file that a reader would mistake: names that look alike, depths that nobody sees."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator
from typing import Any

# Letters of other scripts, and digits, that most typefaces draw as a Latin letter: of capitals, then of small ones.
_CAPITAL_LOOKALIKES = str.maketrans("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧАВЕЅІЈКМНОРСТУХԜҺӀ", "ABEZHIKMNOPTYXABESIJKMHOPCTYXWHI")
_SMALL_LOOKALIKES = str.maketrans("авеѕіјһкмнорԛстуѵԝхυαγεικνορτχωɑɡıℓ01", "abesijhkmhopqctyvwxuayeikvoptxwagilol")


def drawn(name: str) -> str:
    """What a name looks like: without case and blanks (but between digits), letters of other scripts as Latin ones."""
    text = re.sub(r"(?<!\d)\s+|\s+(?!\d)", "", unicodedata.normalize("NFKC", name))
    return text.translate(_CAPITAL_LOOKALIKES).casefold().translate(_SMALL_LOOKALIKES)


def look_alikes(names: Iterable[str]) -> Iterator[tuple[int, str, str]]:
    """Names that differ from an earlier one by nothing that is easily seen: position, name, the earlier one."""
    seen: dict[str, str] = {}
    for n, name in enumerate(names):
        earlier = seen.setdefault(drawn(name), name)
        if earlier != name:
            yield n, name, earlier


def too_deep(data: Any, most: int) -> Any:
    """The first key of plain data below which tables and arrays are nested deeper than `most`, or None."""
    for key, inner in data.items():
        level, depth = [inner], 1
        while level := [
            v for d in level if isinstance(d, dict | list) for v in (d.values() if isinstance(d, dict) else d)
        ]:
            depth += 1
            if depth > most:
                return key
    return None
