"""Text of strangers on a terminal: what would move its cursor, colour it or forge a line is shown, not obeyed."""

from __future__ import annotations

import re
import unicodedata
from typing import Any, TextIO

_KEPT_CONTROLS = frozenset("\n\t")
# controls, marks of direction, lone surrogates, line ends
_UNSEEN_CATEGORIES = frozenset(("Cc", "Cf", "Cs", "Co", "Zl", "Zp"))


def printable(text: str) -> str:
    """The text with every character that is not seen written out (\\x1b, \\u202e), but for line ends and tabs."""
    if text.isprintable():
        return text
    return "".join(_shown(c) for c in text)


def _shown(c: str) -> str:
    if c.isprintable() or c in _KEPT_CONTROLS or unicodedata.category(c) not in _UNSEEN_CATEGORIES:
        return c
    return f"\\x{ord(c):02x}" if ord(c) < 256 else f"\\u{ord(c):04x}" if ord(c) < 65536 else f"\\U{ord(c):08x}"


def as_one_entry(text: str) -> str:
    """The text as one entry of a list: what follows a line end in it is set in, so that it passes for no other line."""
    return re.sub(r"\n(?=[^\s])", "\n    ", printable(text))


def raw_stream(stream: Any) -> Any:
    """The stream below a :class:`Printable`, for our own live line."""
    return stream.stream if isinstance(stream, Printable) else stream


class Printable:
    """A text stream of which only what is written differs: :func:`printable`."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write the text, its unseen characters written out."""
        self.stream.write(printable(text))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each of the lines."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)
