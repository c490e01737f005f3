"""What a report is made of, whatever it is printed on: sections of sentences, tables and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Mark = Literal["", "good", "bad", "warn", "strong", "quiet", "code"]


@dataclass(frozen=True)
class Cell:
    """Text of a table cell; `pad` is invisible text behind it that keeps decimal points in line; `link` is a page."""

    text: str
    pad: str = ""
    mark: Mark = ""
    link: str = ""


@dataclass(frozen=True)
class TableColumn:
    """Heading of a column, with a second line for its unit or group; numbers stand to the right."""

    title: str
    unit: str = ""
    number: bool = True


@dataclass(frozen=True)
class Table:
    """Rows of cells under columns; `folded` tables are long and start closed where a page can do that."""

    title: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    folded: bool = False
    kind: Literal["table"] = "table"


@dataclass(frozen=True)
class Picture:
    """A figure by name, with a caption that states its finding; those with a `share` of the width stand in a row.

    `by_hand` is what a reader can do with it on a screen, which paper does not say.
    """

    name: str
    caption: str
    share: int = 0
    by_hand: str = ""
    kind: Literal["picture"] = "picture"


@dataclass(frozen=True)
class Text:
    """A paragraph; `role` says how it is set; `link` is a page beside this one that it ends with."""

    text: str
    role: Literal["plain", "lead", "heading", "missing", "warning", "remark", "note"] = "plain"
    link: str = ""
    kind: Literal["text"] = "text"


@dataclass(frozen=True)
class Fact:
    """One thing to take away: what, how much, and what it means."""

    label: str
    value: str
    note: str
    mark: Mark = ""


@dataclass(frozen=True)
class Facts:
    """The few things to take away."""

    facts: tuple[Fact, ...]
    kind: Literal["facts"] = "facts"


@dataclass(frozen=True)
class Answers:
    """The lines of the first screen: what is known, what is not, whether a prediction held."""

    facts: tuple[Fact, ...]
    kind: Literal["answers"] = "answers"


Block = Table | Picture | Text | Facts | Answers


@dataclass(frozen=True)
class Section:
    """A numbered section; those of the `appendix` stand behind all others, closed where a page can do that."""

    id: str
    title: str
    blocks: tuple[Block, ...]
    appendix: bool = False


@dataclass(frozen=True)
class Report:
    """The whole document."""

    title: str
    subtitle: str
    byline: str
    sections: tuple[Section, ...]


def column(
    title: str, cells: tuple[Cell, ...], unit: str = "", number: bool = True
) -> tuple[TableColumn, tuple[Cell, ...]]:
    """A heading and the cells below it, for :func:`table`."""
    return TableColumn(title, unit, number), cells


def words(texts: list[str], mark: Mark = "") -> tuple[Cell, ...]:
    """Cells of plain text."""
    return tuple(Cell(t, mark=mark) for t in texts)


def table(
    title: str, columns: list[tuple[TableColumn, tuple[Cell, ...]]], note: str = "", folded: bool = False
) -> Table:
    """A table from its columns, all of the same length."""
    rows = tuple(zip(*(cells for _, cells in columns), strict=True))
    return Table(title, tuple(heading for heading, _ in columns), rows, note, folded)


def missing(what: str, stage: str) -> Text:
    """A section that cannot be written yet."""
    return Text(f"{what} are not there yet: the stage “{stage}” has not finished.", "missing")
