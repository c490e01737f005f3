"""Small helpers of the tables: numbers out of outcomes, Markdown out of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rso.evaluation import Outcome
from rso.evaluation.store import Done, Failed

Outcomes = Mapping[str, Outcome]


def value(outcomes: Outcomes, name: str, channel: str, depth: float) -> float:
    """One channel of a run at one asked depth (mm); NaN if the run did not get there."""
    o = outcomes.get(name)
    response = o.response if isinstance(o, Done) else o.partial if isinstance(o, Failed) else None
    if response is None:
        return float("nan")
    at = np.flatnonzero(np.abs(response.channels["travel"] - depth) < 1e-9)
    return float(response.channels[channel][at[0]]) if len(at) else float("nan")


def curve(outcomes: Outcomes, name: str, channel: str = "Fz") -> tuple[np.ndarray, np.ndarray]:
    """Travel (n,) mm and channel (n,) of a run; what it reached if it failed."""
    o = outcomes.get(name)
    response = o.response if isinstance(o, Done) else o.partial if isinstance(o, Failed) else None
    if response is None:
        return np.empty(0), np.empty(0)
    return response.channels["travel"], response.channels[channel]


def num(x: float, digits: int = 3) -> str:
    """A number for a reader: fixed decimals, a proper minus, a dash for what is not known."""
    return "–" if not np.isfinite(x) else f"{x + 0.0:.{digits}f}".replace("-", "−")


def per_cent(x: float, digits: int = 1) -> str:
    """A signed share in per cent."""
    return "–" if not np.isfinite(x) else f"{100 * x:+.{digits}f} %".replace("-", "−")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column is left, numbers are wherever Markdown puts them."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(r) + " |" for r in rows)])


def yes(holds: bool | None) -> str:
    """A statement of the source, checked; None is not known."""
    return "–" if holds is None else "yes" if holds else "**no**"
