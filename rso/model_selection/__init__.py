"""The ladder of models: how far to climb, from what noise and the data allow.  Knows no mechanics."""

from rso.model_selection.evidence import log_evidence
from rso.model_selection.goodness_of_fit import (
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
from rso.model_selection.selection import MARGIN, RULE, Added, Climb, Judged, Level, Step, climb

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
