"""The uncertainty budget of stated dimensions, and the sentence of a study that states none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.report.calibration.derived import N_DERIVED_TILES, derived_rows
from rso.report.exact_sizes import exact_sizes
from rso.report.layout.digits import clean, percent, shown, signed
from rso.report.layout.document import Block, column, table, words
from rso.report.reading import Results, number, parameters

MENTIONED_MOVE_RATIO = 0.5  # of the largest one: a dimension that moves that much is named
MIN_MENTIONED_MOVE = 0.02  # of a quantity: less is not worth a line of the first page, and hardly known


def input_blocks(results: Results) -> tuple[Block, ...]:
    """What uncertain dimensions move each parameter by; of those that nobody stated, that they count as exact."""
    data = results.get("identification") or {}
    rows = list(data.get("inputs") or ())
    wrong = _assumptions(results, list(data.get("assumptions") or ()))
    return (*([_budget(results, rows)] if rows else []), *exact_sizes(data, others=bool(rows)), *wrong)


def assumed(results: Results) -> list[str]:
    """What is taken for granted, a size and a setting at most, and what is known first would be without it."""
    rows, known = list((results.get("identification") or {}).get("assumptions") or ()), _known(results)
    if not known:
        return []
    (name, letter), said = known[0], []
    for what, is_size in (("stated dimensions count as exact", True), ("other settings count as right", False)):
        some = [(r, number(r["moves"].get(name)) or 0.0) for r in rows if (number(r["larger"]) is not None) is is_size]
        largest = max((abs(m) for _, m in some), default=0.0)
        if largest < MIN_MENTIONED_MOVE:
            continue
        # sizes of the specimen come first, and are known less well than those of the indenter
        row, move = next((r, m) for r, m in some if abs(m) >= MENTIONED_MOVE_RATIO * largest)
        by = f"{percent(abs(move))} {'larger' if move > 0.0 else 'smaller'}"
        if is_size:
            otherwise = f"were {_size_of(row)} {percent(row['larger'], 1)} larger than stated"
        else:
            otherwise = f"were the specimen {clean(row['description'])}{_of_experiment(row)}"
        said.append(f"{what}; {otherwise}, {letter} would be about {by}")
    return said


def _assumptions(results: Results, rows: list[Mapping[str, Any]]) -> tuple[Block, ...]:
    """What would be if it were otherwise; nothing where nothing is known to be moved."""
    known = _known(results)
    if not rows or not known:
        return ()
    columns = [column("if it were", words([_otherwise(r) for r in rows]), number=False)]
    for name, letter in known:
        columns.append(column(f"moves {letter} by", words([_signed(r["moves"].get(name)) for r in rows])))
    note = (
        "What is known would be about so much larger or smaller, by a closed form of the literature. The intervals do "
        "not include it."
    )
    exact = (results.get("identification") or {}).get("exact_inputs") or ()
    if unsaid := [clean(n) for n in exact if n.split(" of ")[0] not in {r["name"] for r in rows}]:
        note += (
            f" Of others nothing is said, as they move it by less or no closed form knows them: {', '.join(unsaid)}."
        )
    return (table("What is taken for granted", columns, note),)


def _otherwise(row: Mapping[str, Any]) -> str:
    size = number(row["larger"])
    if size is None:
        return f"{clean(row['description'])}{_of_experiment(row)} ({clean(row['name'])})"
    return f"{_size_of(row)} ({clean(row['name'])}): {percent(size, 1)} larger"


def _size_of(row: Mapping[str, Any]) -> str:
    """What a size is called by the name of its error."""
    return f"{clean(row['description']).removeprefix('error of ')}{_of_experiment(row)}"


def _known(results: Results) -> list[tuple[str, str]]:
    """Name and letter of each quantity that is known: those that follow from the parameters first."""
    derived = [q for q in derived_rows(results)[:N_DERIVED_TILES] if q.get("known") and not q.get("follows_from")]
    determined = {n for n, d in (results.get("determined") or {}).items() if d.get("determined")}
    return [
        *((q["name"], clean(q["letter"])) for q in derived),
        *((p.name, p.letter) for p in parameters(results, free=True) if p.name in determined),
    ]


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
    return f"{clean(row['description'])}{_of_experiment(row)} ({clean(row['input'])})"


def _of_experiment(row: Mapping[str, Any]) -> str:
    return f" of {clean(row['experiment'])}" if row["experiment"] else ""


def _size(row: Mapping[str, Any]) -> str:
    unit = shown("" if row["unit"] == "1" else clean(row["unit"]), row["uncertainty"])
    return f"{row['uncertainty'] * unit.factor:.3g}{unit.after}"


def _signed(value: Any) -> str:
    x = number(value)
    return "" if x is None else signed(x, percent(x))


def _share(value: Any) -> str:
    x = number(value)
    return "" if x is None else percent(x)
