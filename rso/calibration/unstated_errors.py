"""Usual errors of a whole test that nobody has stated: said where they are most of what is not known."""

from __future__ import annotations

from rso.inference import Determination, elsewhere, widening

MUCH_WIDER_RATIO = 2.0  # times as wide as with what is stated alone: then the statement is worth more than the readings


def unstated(d: Determination) -> list[str]:
    """A warning for each parameter of which usual errors of a test make another interval, or one `MUCH_WIDER_RATIO`
    times as wide.

    What it says is the sentence of the parameter itself.
    """
    said = []
    for n, known in enumerate(d.known):
        own = known.as_stated
        if own is not None and (widening(d, n) >= MUCH_WIDER_RATIO or elsewhere(own.interval, known.profile_interval)):
            said.append(f"identification: {own.story}")
    return said
