"""The audit of ranges that were widened because the search pressed against them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import DASH, known, significant
from rso.report.layout.digits import clean, shortest
from rso.report.layout.document import Block, Cell, Text, column, table, words
from rso.report.reading import ParameterView, Results, lettered, listed, parameters

_EXTENSION_WORDS = {"widened": "widened", "taken back": "taken back", "done": "done", "stopped": "stopped"}


def range_blocks(results: Results) -> list[Block]:
    """A table of every step and how it ended, where there was anything to do."""
    rows = [a for s in listed(results, "searches")[:1] for a in s.get("audit") or ()]
    moved = [a for a in rows if a.get("parameter")]
    last = rows[-1] if rows else {}
    end = {"done": "In the end ", "stopped": "It stopped there: "}.get(clean(last.get("what")), "")
    if not moved:
        why = lettered(results, f"Ranges of the main search: {clean(last.get('why'))}.")
        return [Text(why)] if last.get("what") == "stopped" else []
    views = {p.name: p for p in parameters(results)}
    rounds = [a.get("round") for a in moved]
    first = [
        k == 0 or (a.get("round"), a.get("why")) != (moved[k - 1].get("round"), moved[k - 1].get("why"))
        for k, a in enumerate(moved)
    ]
    columns = [
        column("Round", words([shortest(r) if f else "" for r, f in zip(rounds, first, strict=True)])),
        column("what", tuple(_word(a) for a in moved), number=False),
        column("θ", words([_letter(views, a) for a in moved]), number=False),
        column("end", words([clean(a.get("end")) for a in moved]), number=False),
        column("from", words([_value(views, a, "from") for a in moved])),
        column("to", words([_value(views, a, "to") for a in moved])),
        column("runs", words([shortest(a["runs"]) if a.get("runs") else "" for a in moved]), "added"),
        column(
            "why",
            words([lettered(results, a.get("why")) if f else "" for a, f in zip(moved, first, strict=True)]),
            number=False,
        ),
    ]
    note = lettered(results, f"{end}{clean(last['why'])}.") if end else ""
    return [table("Ranges of the main search: what was widened, and why", columns, note)]


def _word(a: Mapping[str, Any]) -> Cell:
    return Cell(_EXTENSION_WORDS.get(a["what"], clean(a["what"])), mark="warn" if a["what"] == "taken back" else "")


def _letter(views: Mapping[str, ParameterView], a: Mapping[str, Any]) -> str:
    return views[a["parameter"]].letter if a["parameter"] in views else clean(a["parameter"])


def _value(views: Mapping[str, ParameterView], a: Mapping[str, Any], key: str) -> str:
    x = a.get(key)
    if not known(x):
        return DASH
    p = views.get(a["parameter"])
    return p.show(x) if p is not None else significant(x)
