"""Which runs a map over two parameters shows."""

from __future__ import annotations

from rso.core.digits import known
from rso.report.reading import ParameterView, Results, listed


def drawn_runs(results: Results, state: str, x: ParameterView, y: ParameterView | None) -> list[tuple[float, float]]:
    """Values of x and y (of x twice without y) of the runs that ended so and lie within the ranges of a map.

    Candidates have marks of their own.  By similarity some runs stand for the ranges without lying in them.
    """
    chosen = [
        r["values"]
        for r in listed(results, "runs")
        if r.get("state") == state and r.get("purpose") not in ("candidate", "validate", "input")
    ]
    y = y or x
    pairs = [(v[x.name], v[y.name]) for v in chosen if known(v.get(x.name)) and known(v.get(y.name))]
    return [(a, b) for a, b in pairs if _within(x, a) and _within(y, b)]


def _within(p: ParameterView, value: float) -> bool:
    room = 1e-9 * max(abs(p.low), abs(p.high))
    return not (value < p.low - room or value > p.high + room)
