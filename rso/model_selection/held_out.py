"""Force curves that a ladder keeps for the end, predicted by its levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso import model_selection
from rso.calibration.readings import curve_data, error_at, placed
from rso.contract import Response
from rso.inference import CurvePlace, Misfit, Model, correlated_along, resample
from rso.inference.output_derivatives import NoSlopes, jacobian
from rso.model_selection import Goodness, Judged, Left
from rso.model_selection.simulations import LadderRunner
from rso.study.schema import ExperimentTable


@dataclass(frozen=True, eq=False)
class Unused:
    """A curve that took no part: what a level leaves of it, or `why` nobody can say whether that is too much."""

    curve: str
    goodness: Goodness | None
    why: str = ""


def validate(bench: LadderRunner, j: Judged) -> tuple[Unused, ...]:
    """Each curve kept for the end against what a perfect model with as uncertain parameters would leave there."""
    every = [e for e in bench.plan.study.experiments if e.role == "validate" and e.kind == "force"]
    return tuple(u for e in every for u in _validated(bench, j, e))


def _validated(bench: LadderRunner, j: Judged, e: ExperimentTable) -> list[Unused]:
    plan, found, case = bench.plan, j.detail, bench.plan.validation[e.name]
    places = [placed(plan, e.name, channel) for channel in e.compared]
    data = [curve_data(plan, p) for p in places]
    box, x = found.axes.box, found.determination.fit.x

    def look(points: Sequence[np.ndarray]) -> list[np.ndarray | str]:
        values = [dict(zip(box.names, map(float, box.from_unit(p)), strict=True)) for p in points]
        return [
            a if isinstance(a, str) else _curves(a[0], places) for a in bench.run(j.level, found.axes, [case], values)
        ]

    (answer,) = bench.run(j.level, found.axes, [case], [found.values])
    if isinstance(answer, str):
        return [Unused(d.name, None, f"its run has no answer: {answer}") for d in data]
    response = answer[0]
    try:
        J = jacobian(box, x, _curves(response, places), _own(found, response, places), look)
    except NoSlopes as error:
        return [Unused(d.name, None, str(error)) for d in data]
    out, rows = [], np.cumsum([len(p.depth) for p in places])[:-1]
    for place, d, part in zip(places, data, np.split(J, rows), strict=True):
        f = resample(response, place, "")
        d = d.plus(correlated_along(d.depth, error_at(response, place), float(place.depth.max())))
        model = Model(box, lambda X, f=f, J=part: f + (X - x) @ J.T)  # type: ignore[misc]
        apart = model_selection.simulate_elsewhere(model, (d,), found.determination.fit, found.simulated.X, plan.seed)
        left = Left(f - d.value, Misfit(model, (d,)), apart, ("validate",))
        out.append(Unused(d.name, model_selection.assess([left], plan.study.ladder.confidence)))
    return out


def _curves(response: Response, places: Sequence[CurvePlace]) -> np.ndarray:
    return np.concatenate([resample(response, p, "") for p in places])


def _own(found: Any, response: Response, places: Sequence[CurvePlace]) -> dict[str, np.ndarray]:
    """Derivatives by axis of all curves together, as far as the run has them of each."""
    known = [k for k, g in response.gradients.items() if all(p.channel in g for p in places)]
    by_knob = {k: np.concatenate([resample(response, p, k) for p in places]) for k in known}
    own: dict[str, np.ndarray] = found.axes.slopes(found.values, by_knob)
    return own
