"""The ladder of models: how far to climb, from what noise and the data allow.  Knows no mechanics."""

from rso.ladder.deciding import MARGIN, RULE, Added, Climb, Judged, Level, Step, climb
from rso.ladder.evidence import log_evidence
from rso.ladder.goodness import (
    CONFIDENCE,
    DRAWS,
    Check,
    CurveError,
    Goodness,
    Left,
    Simulated,
    assess,
    simulate,
    simulate_elsewhere,
)

__all__ = [
    "CONFIDENCE",
    "DRAWS",
    "MARGIN",
    "RULE",
    "Added",
    "Check",
    "Climb",
    "CurveError",
    "Goodness",
    "Judged",
    "Left",
    "Level",
    "Simulated",
    "Step",
    "assess",
    "climb",
    "log_evidence",
    "simulate",
    "simulate_elsewhere",
]
