"""An uncertain input one standard uncertainty above and below what is stated: which tests feel it, what is refused."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rso.calibration.plan import Plan
from rso.contract import NominalValues, Refusals, capability
from rso.study.dimensions import MISREAD_SETTING_ERRORS, UncertainInput
from rso.study.input_sizes import size_words

SIDES = {1.0: "more", -1.0: "less"}  # a standard uncertainty above and below


def inputs_of_fits(plan: Plan) -> list[UncertainInput]:
    """Inputs that any fitted experiment feels."""
    return [i for i in plan.resolved.inputs if touched(plan, i)]


def touched(plan: Plan, one: UncertainInput) -> tuple[int, ...]:
    """Cases that share an input and feel it: the key of their run has its value, which is dropped without influence."""
    every = sharing(plan, one)
    middle = plan.values(np.full(plan.box.d, 0.5))
    return tuple(k for k in every if _felt(plan, one, k, middle))


def sharing(plan: Plan, one: UncertainInput) -> tuple[int, ...]:
    """Cases of the experiments that share an input, whether or not they feel it."""
    if not one.experiments:
        return tuple(range(len(plan.cases)))
    return tuple(sorted({plan.case_of[e] for e in one.experiments if e in plan.case_of}))


def beside(
    plan: Plan, here: Mapping[str, float], one: UncertainInput, side: float, k: int
) -> tuple[dict[str, float], str | None]:
    """Values with an input one standard uncertainty to a side of what is stated, and why case `k` refuses them."""
    p, at = one.parameter, _stated(plan, here, one, k)
    values = {**here, p.name: at + side * one.uncertainty}
    if not p.low <= values[p.name] <= p.high:
        bounds = f"[{p.low:g}, {p.high:g}] {p.unit}"
        return values, f"{p.name} = {size_words(p, values[p.name])} lies beyond its bounds, {bounds}"
    try:
        plan.backend.canonical(values, plan.cases[k])
    except MISREAD_SETTING_ERRORS as error:
        return values, str(error)
    offered = capability(plan.backend, Refusals)
    return values, None if offered is None else offered.refused(values, plan.cases[k])


def _stated(plan: Plan, here: Mapping[str, float], one: UncertainInput, k: int) -> float:
    offered, p = capability(plan.backend, NominalValues), one.parameter
    nominal = {} if offered is None else offered.nominal(plan.cases[k].settings)
    at = here.get(p.name, nominal.get(p.name, p.default))
    assert at is not None  # the study was checked for it
    return at


def _felt(plan: Plan, one: UncertainInput, k: int, here: Mapping[str, float]) -> bool:
    """Whether the key of a run has the value; what its bounds refuse is told by the values that they do not."""
    at, name, found = _stated(plan, here, one, k), one.parameter.name, []
    for side in (0.0, *SIDES):
        try:
            found.append(plan.backend.canonical({**here, name: at + side * one.uncertainty}, plan.cases[k]))
        except MISREAD_SETTING_ERRORS:
            continue
    return len(found) < 2 or any(f != found[0] for f in found)
