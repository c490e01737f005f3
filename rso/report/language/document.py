"""A report in another language: the same document, every text of it by its template."""

from __future__ import annotations

import re
from dataclasses import replace

from rso.report.language.catalogue import Catalogue
from rso.report.layout.document import (
    Answers,
    Block,
    Cell,
    Fact,
    Facts,
    Picture,
    Report,
    Section,
    Table,
    TableColumn,
    Text,
)

_NUMERIC_CELL = re.compile(r"[\d\s.,;:±×⁻⁰¹²³⁴⁵⁶⁷⁸⁹−+<>≤≥()%·/–-]*$")


def in_language(report: Report, by: Catalogue) -> Report:
    """The document in the language of a catalogue; what is a person's own (title, names, files) stays."""
    return Report(
        report.title,
        report.subtitle if report.subtitle in by.kept else by.text(report.subtitle) if report.subtitle else "",
        by.text(report.byline) if report.byline else "",
        tuple(_section(s, by) for s in report.sections),
    )


def _section(s: Section, by: Catalogue) -> Section:
    return replace(s, title=by.text(s.title), blocks=tuple(_block(b, by) for b in s.blocks))


def _block(b: Block, by: Catalogue) -> Block:
    if isinstance(b, Text):
        return b if b.role == "note" or b.role == "remark" else replace(b, text=by.text(b.text))
    if isinstance(b, Picture):
        return replace(
            b, caption=by.text(b.caption) if b.caption else "", by_hand=by.text(b.by_hand) if b.by_hand else ""
        )
    if isinstance(b, Facts | Answers):
        return replace(b, facts=tuple(_fact(f, by) for f in b.facts))
    return _table(b, by)


def _fact(f: Fact, by: Catalogue) -> Fact:
    label, value, note = (by.text(t) if t else "" for t in (f.label, f.value, f.note))
    return replace(f, label=label, value=value, note=note)


def _table(t: Table, by: Catalogue) -> Table:
    columns = tuple(_column(c, by) for c in t.columns)
    rows = tuple(tuple(_cell(c, by) for c in row) for row in t.rows)
    return replace(
        t, title=by.text(t.title) if t.title else "", columns=columns, rows=rows, note=by.text(t.note) if t.note else ""
    )


def _column(c: TableColumn, by: Catalogue) -> TableColumn:
    return replace(c, title=by.text(c.title) if c.title else "", unit=by.text(c.unit) if c.unit else "")


def _cell(c: Cell, by: Catalogue) -> Cell:
    if c.mark == "code" or not c.text:
        return c
    text = by.numbers(c.text) if _NUMERIC_CELL.match(c.text) else by.text(c.text)
    return replace(c, text=text, pad=c.pad.replace(".", by.comma))
