"""Force curves that a ladder keeps for the end, predicted by its levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.predictive_check import PredictiveCheck, predictive_check
from rso.contract import Response
from rso.evaluation import Evaluator
from rso.model_selection import Judged
from rso.model_selection.simulations import simulate_level


def validate_level(plan: Plan, evaluator: Evaluator, j: Judged) -> tuple[PredictiveCheck, ...]:
    """Each test kept for the end against what a perfect model with as uncertain parameters would leave there."""
    every = [e.name for e in plan.study.experiments if e.role == "validate" and e.kind == "force"]
    return tuple(_validated(plan, evaluator, j, name) for name in every)


def _validated(plan: Plan, evaluator: Evaluator, j: Judged, name: str) -> PredictiveCheck:
    found, first = j.detail, True

    def evaluate(points: Sequence[Mapping[str, float]]) -> list[Response | str]:
        nonlocal first
        lost, first = "its run has no answer: " if first else "", False
        answers = simulate_level(evaluator, j.level, found.axes, [plan.validation[name]], points)
        return [f"{lost}{a}" if isinstance(a, str) else a[0] for a in answers]

    def slopes(values: Mapping[str, float], known: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        by_axis: dict[str, np.ndarray] = found.axes.slopes(values, dict(known))
        return by_axis

    return predictive_check(plan, name, found.determination, found.values, evaluate, slopes)
