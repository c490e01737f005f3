"""The uncertainty budget of stated dimensions, and the sentence of a study that states none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.report.calibration.derived import N_DERIVED_TILES, derived_rows
from rso.report.exact_sizes import exact_sizes
from rso.report.layout.digits import clean, percent, shown, signed
from rso.report.layout.document import Block, column, table, words
from rso.report.reading import Results, number, parameters


def input_blocks(results: Results) -> tuple[Block, ...]:
    """What uncertain dimensions move each parameter by; of those that nobody stated, that they count as exact."""
    data = results.get("identification") or {}
    rows = list(data.get("inputs") or ())
    return (*([_budget(results, rows)] if rows else []), *exact_sizes(data, others=bool(rows)))


def _budget(results: Results, rows: list[Mapping[str, Any]]) -> Block:
    views = [p for p in parameters(results) if any(p.name in r["moves"] for r in rows)]
    columns = [
        column("dimension", words([_named(r) for r in rows]), number=False),
        column("standard uncertainty", words([_size(r) for r in rows])),
    ]
    for p in views:
        columns.append(column(f"moves {p.letter} by", words([_signed(r["moves"].get(p.name)) for r in rows])))
        columns.append(column(f"of the variance of {p.letter}", words([_share(r["share"].get(p.name)) for r in rows])))
    for q in derived_rows(results)[:N_DERIVED_TILES]:
        if not q.get("follows_from"):
            moved = words([_signed(r["moves"].get(q["name"])) for r in rows])
            columns.append(column(f"moves {clean(q['letter'])} by", moved))
    note = (
        "A parameter changes by so much if a dimension is one standard uncertainty more than stated, to first order. "
        "The intervals include it."
    )
    return table("Stated dimensions", columns, note)


def _named(row: Mapping[str, Any]) -> str:
    whose = f" of {clean(row['experiment'])}" if row["experiment"] else ""
    return f"{clean(row['description'])}{whose} ({clean(row['input'])})"


def _size(row: Mapping[str, Any]) -> str:
    unit = shown("" if row["unit"] == "1" else clean(row["unit"]), row["uncertainty"])
    return f"{row['uncertainty'] * unit.factor:.3g}{unit.after}"


def _signed(value: Any) -> str:
    x = number(value)
    return "" if x is None else signed(x, percent(x))


def _share(value: Any) -> str:
    x = number(value)
    return "" if x is None else percent(x)
