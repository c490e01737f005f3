"""Quantities that people think in (Young's modulus, Poisson's ratio, …): the first page's facts and a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import estimate
from rso.core.symbols import symbol
from rso.report.layout.digits import Unit, between, clean, percent, shown
from rso.report.layout.document import Fact, Table, column, table, words
from rso.report.reading import Results, number, pair

N_DERIVED_TILES = 2  # on the first page


def derived_rows(results: Results) -> list[Mapping[str, Any]]:
    """Entries of identification.derived that have an interval."""
    found = results.get("identification") or {}
    return [q for q in found.get("derived") or () if pair(q.get("interval"))]


def open_rows(results: Results) -> list[Mapping[str, Any]]:
    """Those of the first page that the data leave open; what a study fixes is not among them."""
    return [
        q for q in derived_rows(results)[:N_DERIVED_TILES] if q.get("known") is not True and not q.get("follows_from")
    ]


def derived_facts(results: Results) -> list[Fact]:
    """One tile for each of the first of them."""
    return [_fact(results, q) for q in derived_rows(results)[:N_DERIVED_TILES]]


def derived_sentences(results: Results) -> list[str]:
    """What the data fix, and what they leave open, in one sentence each; then what is unlikely."""
    rows = derived_rows(results)
    if not rows:
        return []
    fixed = [q for q in rows if q.get("known") is True]
    said = []
    if fixed:
        each = [
            f"{clean(q['description'])} {clean(q['letter'])} = {derived_value(q)} ({derived_span(q)})"
            for q in fixed[:1]
        ]
        said.append(f"The data fix the {each[0]}{_level(results)}.")
    said += [
        f"They leave the {clean(q['description'])} {clean(q['letter'])} between "
        f"{derived_span(q).replace(' to ', ' and ')}."
        for q in open_rows(results)
    ]
    for q in rows[:N_DERIVED_TILES]:
        if q.get("follows_from"):
            said.append(
                f"The {clean(q['description'])} {clean(q['letter'])} = {derived_value(q)} rests on {_stated(q)}."
            )
    return [*said, *(f"Look again: {clean(q['unlikely'])}." for q in rows if q.get("unlikely"))]


def derived_table(results: Results) -> Table | None:
    """All of them with their intervals and what makes an end that the data do not; None without any."""
    rows = derived_rows(results)
    if not rows:
        return None
    level = percent(number((results.get("identification") or {}).get("level")))
    columns = [
        column("", words([clean(q["letter"]) for q in rows]), number=False),
        column("", words([clean(q["description"]) for q in rows]), number=False),
        column("most likely", words([derived_value(q) for q in rows])),
        column("profile", words([derived_span(q) for q in rows]), level),
        column("ends by a range", words([_ends(q) for q in rows]), number=False),
    ]
    note = "Each has a profile interval of its own: the parameters may go wherever the data let them."
    return table("Derived quantities", columns, note)


def _fact(results: Results, q: Mapping[str, Any]) -> Fact:
    if q.get("follows_from"):
        return Fact(clean(q["letter"]), derived_value(q), f"{clean(q['description'])}; rests on {_stated(q)}")
    note = f"{clean(q['description'])}; {_level(results).strip(', ') or 'interval'}: {derived_span(q)}"
    value = derived_value(q) if q.get("known") is True else derived_span(q)
    return Fact(clean(q["letter"]), value, note, "good" if q.get("known") is True else "warn")


def _stated(q: Mapping[str, Any]) -> str:
    return f"{' and '.join(symbol(clean(n)) for n in q['follows_from'])} as stated"


def _unit(q: Mapping[str, Any]) -> Unit:
    low, high = q["interval"]
    return shown("" if q["unit"] == "1" else clean(q["unit"]), max(abs(low), abs(high)))


def derived_value(q: Mapping[str, Any]) -> str:
    """The most likely value, with the digits of its interval."""
    unit, ends = _unit(q), q["interval"]
    value, low, high = (v * unit.factor for v in (q["value"], *ends))
    return f"{estimate(value, low, high)}{unit.after}"


def derived_span(q: Mapping[str, Any]) -> str:
    """Both ends of the interval."""
    low, high = q["interval"]
    return between(low, high, _unit(q))


def _ends(q: Mapping[str, Any]) -> str:
    low, high = q.get("ends_by") or ((), ())
    each = [("lower", low), ("upper", high)]
    return "; ".join(f"{name}: the range of {', '.join(map(clean, by))}" for name, by in each if by)


def _level(results: Results) -> str:
    level = number((results.get("identification") or {}).get("level"))
    return "" if level is None else f", with {percent(level)} confidence"
