"""Templates of input files: placeholders such as ``{mu:.6e}`` for numbers, and blocks that are repeated.

A placeholder holds an expression of names (parameters, settings, the programme of travel), read as data and never
executed, and behind a colon how the number is printed.  A line that holds nothing but ``{each asked}`` or
``{each corner}`` begins a block, one with ``{end}`` ends it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from rso.core.units import conversion_factor
from rso.doe.constraints import EXPRESSION_FUNCTIONS, read_expression

DELIMITERS = ("{", "}")
NUMBER_FORMAT = re.compile(r"[<>=^]?[+ -]?0?(?P<width>\d{0,2})(?:\.\d{1,2})?[eEfFgGd]?")
DEFAULT_FORMAT = ".12g"  # how a number is printed where nothing is said
# share of a number that its print may be off by: more would be another simulation than the key says
MAX_PRINT_ERROR_SHARE = 1e-3
BLOCK_KINDS = ("asked", "corner")
_NAME_IN_EXPRESSION = re.compile(r"(?<![\w.])([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\[([^\[\]]*)\])?")
Row = Mapping[str, float]


@dataclass(frozen=True)
class Placeholder:
    """One placeholder: its line, its text, its expression, names with their units or indices, and its format."""

    line: int
    text: str
    expression: str
    names: tuple[tuple[str, str], ...]
    format: str

    def filled(self, values: Mapping[str, Any], units: Mapping[str, str]) -> str:
        """The number or text that stands there; ValueError naming line, placeholder and value."""
        try:
            found = [_value(values[name], index, units.get(name, "")) for name, index in self.names]
        except ValueError as error:
            raise ValueError(f"line {self.line}: {self.text}: {error}") from None
        if len(found) == 1 and isinstance(found[0], str):
            return self._of_text(found[0])
        if any(isinstance(v, str) for v in found):
            name = next(n for (n, _), v in zip(self.names, found, strict=True) if isinstance(v, str))
            raise ValueError(f"line {self.line}: {self.text}: {name} is text, with which nothing can be computed")
        symbols = {f"v{k}": np.asarray(v, float) for k, v in enumerate(found)}
        with np.errstate(all="ignore"):
            number = float(read_expression(self.expression, tuple(symbols))(symbols))
        if not math.isfinite(number):
            shown = ", ".join(f"{n} = {v:g}" for (n, _), v in zip(self.names, found, strict=True))
            raise ValueError(f"line {self.line}: {self.text} is no finite number at {shown}")
        return self._printed(number)

    def _of_text(self, text: str) -> str:
        if self.expression != "v0" or self.format != DEFAULT_FORMAT:
            raise ValueError(
                f"line {self.line}: {self.text}: a text ({text!r}) is filled in as it is, without a format"
            )
        return text

    def _printed(self, number: float) -> str:
        """A number in its format; ValueError where it does not fit or is rounded to another one."""
        whole = self.format.endswith("d")
        text = format(round(number) if whole else number, self.format)
        width = NUMBER_FORMAT.fullmatch(self.format)["width"]  # type: ignore[index]  # checked when read
        if width and len(text) > int(width):
            raise ValueError(f"line {self.line}: {self.text} prints {text!r}, which is wider than its {width} columns")
        if abs(float(text) - number) > MAX_PRINT_ERROR_SHARE * abs(number):
            raise ValueError(f"line {self.line}: {self.text} prints {text.strip()} for {number:.6g}: give more digits")
        return text


Line = tuple[str | Placeholder, ...]


@dataclass(frozen=True)
class Template:
    """A template: its name, its lines of texts and placeholders, and the block of each line ("" for none)."""

    name: str
    lines: tuple[Line, ...]
    blocks: tuple[tuple[int, str], ...]

    @property
    def names(self) -> set[str]:
        """Names that its placeholders use."""
        return {name for line in self.lines for part in line if isinstance(part, Placeholder) for name, _ in part.names}

    def placeholders(self) -> Iterator[tuple[Placeholder, str]]:
        """Each placeholder and the block that it stands in."""
        for line, (_, block) in zip(self.lines, self.blocks, strict=True):
            yield from ((part, block) for part in line if isinstance(part, Placeholder))

    def filled(self, values: Mapping[str, Any], units: Mapping[str, str], rows: Mapping[str, Sequence[Row]]) -> str:
        """The whole deck with `values`, in `units`; `rows` are the values of each repetition of a block."""
        return "".join(text for _, text, _ in self.written(values, units, rows))

    def written(
        self, values: Mapping[str, Any], units: Mapping[str, str], rows: Mapping[str, Sequence[Row]]
    ) -> Iterator[tuple[int, str, bool]]:
        """Number of the line in the template where it holds a placeholder, the line, and whether it does.

        Raises ValueError as :meth:`Placeholder.filled`, with the name of the template.
        """
        every = zip(self.lines, self.blocks, strict=True)
        for (_, block), group in groupby(every, key=lambda pair: pair[1]):
            numbered = [line for line, _ in group]
            for row in rows[block] if block else ({},):
                for line in numbered:
                    try:
                        parts = [p if isinstance(p, str) else p.filled({**values, **row}, units) for p in line]
                    except ValueError as error:
                        raise ValueError(f"{self.name}, {error}") from None
                    number = next((p.line for p in line if isinstance(p, Placeholder)), 0)
                    yield number, "".join(parts), number > 0


def read_template(
    name: str, text: str, known: Collection[str], inner: Collection[str], delimiters: tuple[str, str] = DELIMITERS
) -> Template:
    """The template of a file; placeholders may use names that are `known`, and those in blocks the `inner` ones too.

    Raises ValueError, naming file, line, placeholder and choices, for what is no such name, expression, unit or format.
    """
    left, right = delimiters
    pattern = re.compile(f"{re.escape(left)}(.*?){re.escape(right)}")
    lines: list[Line] = []
    blocks: list[tuple[int, str]] = []
    block, opened = "", 0
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        where = f"{name}, line {number}"
        order = _order(line.strip(), left, right)
        if order is not None:
            if (order == "end") == (block == ""):
                raise ValueError(f"{where}: {line.strip()} " + ("within a block" if block else "without a block"))
            if order != "end" and order not in BLOCK_KINDS:
                raise ValueError(f"{where}: each {order!r} is no block; choose from {', '.join(BLOCK_KINDS)}")
            block, opened = ("", opened) if order == "end" else (order, number)
            continue
        parts: list[str | Placeholder] = []
        at = 0
        for found in pattern.finditer(line):
            place = _place(where, number, found[0], found[1], {*known, *(inner if block else ())}, delimiters)
            parts += [line[at : found.start()], place]
            at = found.end()
        lines.append((*(p for p in parts if p != ""), line[at:]))
        blocks.append((opened if block else 0, block))
    if block:
        raise ValueError(f"{name}, line {opened}: the block {left}each {block}{right} has no {left}end{right}")
    return Template(name, tuple(lines), tuple(blocks))


def _order(line: str, left: str, right: str) -> str | None:
    """What a line orders that holds nothing else: "end", or the name of a block; None for any other."""
    if not (line.startswith(left) and line.endswith(right)):
        return None
    words = line.removeprefix(left).removesuffix(right).split()
    return words[-1] if words == ["end"] or (len(words) == 2 and words[0] == "each") else None


def _place(where: str, line: int, text: str, inside: str, known: set[str], delimiters: tuple[str, str]) -> Placeholder:
    expression, colon, form = (part.strip() for part in inside.partition(":"))
    names: list[tuple[str, str]] = []

    def symbol(match: re.Match[str]) -> str:
        if match[1] in EXPRESSION_FUNCTIONS and match[2] is None:
            return match[1]
        names.append((match[1], (match[2] or "").strip()))
        return f"v{len(names) - 1}"

    written = _NAME_IN_EXPRESSION.sub(symbol, expression)
    unknown = [name for name, _ in names if name not in known]
    if unknown or not names:
        what = f"{unknown[0]!r} is no parameter, setting or word of the programme" if unknown else "names nothing"
        hint = (
            "" if delimiters != DELIMITERS else "; a deck with braces of its own takes other ones, backend.delimiters"
        )
        raise ValueError(f"{where}: {text}: {what}; choose from {', '.join(sorted(known))}{hint}")
    if colon and (not form or NUMBER_FORMAT.fullmatch(form) is None):
        raise ValueError(f"{where}: {text}: {form!r} is no format of a number, such as .6e, 10.4f or d")
    try:
        read_expression(written, [f"v{k}" for k in range(len(names))])
    except ValueError:
        known_words = f"numbers, + - * / ** ( ), {', '.join(EXPRESSION_FUNCTIONS)}"
        raise ValueError(f"{where}: {text}: is no expression of names, {known_words}") from None
    return Placeholder(line, text, written, tuple(names), form or DEFAULT_FORMAT)


def _value(value: Any, index: str, unit: str) -> float | str:
    """A value by its index in a list, or in another unit; ValueError naming what does not fit."""
    if not index:
        if isinstance(value, list | tuple):
            raise ValueError(f"a list of {len(value)} is filled in one by one, as in name[0]")
        return value if isinstance(value, str) else float(value)
    if isinstance(value, list | tuple):
        if not index.isdigit() or int(index) >= len(value):
            raise ValueError(f"[{index}] is none of the {len(value)} entries, 0 to {len(value) - 1}")
        return float(value[int(index)])
    if isinstance(value, str):
        raise ValueError(f"{value!r} has no [{index}]")
    return float(value) / float(conversion_factor(index, unit or "1"))
