"""The ladder of models: how rich a model noise and data allow.  Knows no mechanics."""

from rso.model_selection.evidence import log_evidence
from rso.model_selection.goodness_of_fit import (
    FIT_CONFIDENCE,
    N_REFITTED_DATA_SETS,
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
    MIN_LOG_EVIDENCE_GAIN,
    SELECTION_RULE,
    Added,
    Judged,
    ModelLevel,
    Selection,
    SelectionStep,
    select_model,
)

__all__ = [
    "FIT_CONFIDENCE",
    "MIN_LOG_EVIDENCE_GAIN",
    "N_REFITTED_DATA_SETS",
    "SELECTION_RULE",
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
