"""Stated sizes of which nobody said how well they are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.report.layout.digits import clean
from rso.report.layout.document import Block, Text


def exact_sizes(found: Mapping[str, Any], others: bool = False) -> tuple[Block, ...]:
    """That the `exact_inputs` of results count as exact, `others` beside those that are stated; nothing without any."""
    names = [clean(n) for n in found.get("exact_inputs") or ()]
    if not names:
        return ()
    what = "Other stated dimensions" if others else "The stated dimensions of specimen and indenter"
    text = f"{what} count as exact. The table [uncertainty] of the study says how well they are known"
    return (Text(f"{text}: {', '.join(names)}."),)
