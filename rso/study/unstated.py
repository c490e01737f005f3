"""Usual errors of a whole test that nobody has stated: said where they are most of what is not known."""

from __future__ import annotations

from rso.identify import Determination, widened

MUCH = 2.0  # times as wide as with what is stated alone: then the statement is worth more than the readings


def unstated(d: Determination) -> list[str]:
    """A warning for each parameter of which the interval is at least `MUCH` times as wide with usual errors of a test.

    What it says is the sentence of the parameter itself.
    """
    wide = [known for k, known in enumerate(d.known) if widened(d, k) >= MUCH and known.reason]
    each = [known.reason[known.reason.rindex(f"{known.name} is known to") :] for known in wide
            if f"{known.name} is known to" in known.reason]  # fmt: skip
    return [f"identification: {text}" for text in each]
