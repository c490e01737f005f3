"""What people read on a terminal: lines wrapped at words, signs in colour, nothing that a stranger's text forges."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, Literal

from rso.core.printable import as_one_entry, raw_stream
from rso.core.symbols import in_letters

Mark = Literal["good", "open", "bad"]
MARK_SIGNS: dict[Mark, tuple[str, str, str]] = {  # sign, the same in ASCII, colour
    "good": ("✓", "+", "32"),
    "open": ("?", "?", "33"),
    "bad": ("✗", "x", "31"),
}
MAX_LINE_WIDTH = 100  # characters of a sentence


def coloured(stream: Any) -> bool:
    """Whether colours are wanted: on a terminal, unless NO_COLOR is set (no-color.org) or the terminal is dumb."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return not plain and bool(stream.isatty())


def say(text: object) -> None:
    """One line, whatever names are in it."""
    print(as_one_entry(str(text)))


def complain(text: object) -> None:
    """The same of an error."""
    print(wrapped(f"rso: {text}", sys.stderr), file=sys.stderr)


def lines(texts: Sequence[str]) -> None:
    """Lines, in a terminal wrapped at words."""
    print("\n".join(wrapped(text, sys.stdout) for text in texts))


def wrapped_sentences(texts: Sequence[str], names: Iterable[str] = ()) -> None:
    """Sentences below a title, each wrapped at words, with the letters of the parameters of these names."""
    width, names = min(_columns(), MAX_LINE_WIDTH), tuple(names)
    for text in texts:
        said = in_letters(text, names)
        print(textwrap.fill(said, width, initial_indent="  ", subsequent_indent="    ", break_long_words=False))


def marked_line(mark: Mark, text: str) -> None:
    """A line with its sign, coloured where that is wanted."""
    sign, ascii_sign, colour = MARK_SIGNS[mark]
    try:
        sign.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except (UnicodeEncodeError, LookupError):
        sign = ascii_sign
    body = wrapped(f"  {sign} {text}", sys.stdout)
    if coloured(sys.stdout):
        head, _, tail = body.partition(sign)
        sys.stdout.flush()
        raw_stream(sys.stdout).write(f"{head}\x1b[{colour}m{sign}\x1b[0m{tail}\n")
    else:
        print(body)


def bold(text: str) -> None:
    """A title."""
    if coloured(sys.stdout):
        sys.stdout.flush()
        raw_stream(sys.stdout).write(f"\x1b[1m{as_one_entry(text)}\x1b[0m\n")
    else:
        print(as_one_entry(text))


def wrapped(line: str, stream: Any) -> str:
    """A line in the width of the terminal, what follows further in; as it is where nobody looks at it."""
    if not stream.isatty():
        return as_one_entry(line)
    within = " " * (len(line) - len(line.lstrip()))
    return "\n".join(
        textwrap.fill(
            part.strip(),
            max(_columns(), 40),
            initial_indent=within,
            subsequent_indent=within + "  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for part in as_one_entry(line).split("\n")
    )


def say_why_ended(code: int, reason: str | None) -> int:
    """The exit code; where it is not 0 the last line of a command says why."""
    if code:
        lines([f"exit code {code}: {reason}"])
    return code


def _columns() -> int:
    return shutil.get_terminal_size().columns


def untranslated(missing: Sequence[str], language: str) -> None:
    """How many sentences of a page stay English, and one of them."""
    if missing:
        many = "1 sentence has" if len(missing) == 1 else f"{len(missing)} sentences have"
        complain(f"{many} no template in {language}, English left in place; the first: {missing[0]}")
