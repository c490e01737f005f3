"""The ladder of models: how rich a model noise and data allow.  Knows no mechanics."""

from rso.model_selection.evidence import log_evidence
from rso.model_selection.goodness_of_fit import (
    CONFIDENCE,
    DRAWS,
    CurveError,
    Goodness,
    GoodnessOfFit,
    Left,
    Simulated,
    assess,
    bootstrap_refits,
    simulate_elsewhere,
)
from rso.model_selection.selection import (
    MARGIN,
    RULE,
    Added,
    Judged,
    ModelLevel,
    Selection,
    SelectionStep,
    select_model,
)

__all__ = [
    "CONFIDENCE",
    "DRAWS",
    "MARGIN",
    "RULE",
    "Added",
    "CurveError",
    "Goodness",
    "GoodnessOfFit",
    "Judged",
    "Left",
    "ModelLevel",
    "Selection",
    "SelectionStep",
    "Simulated",
    "assess",
    "bootstrap_refits",
    "log_evidence",
    "select_model",
    "simulate_elsewhere",
]
