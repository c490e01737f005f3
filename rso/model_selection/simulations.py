"""The simulations of a ladder: the design of a level, its runs, the proof of similarity, what is learnt from a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rso import doe
from rso.calibration.plan import PROOF_MODULUS_RATIO, Plan
from rso.calibration.readings import curve_outputs
from rso.contract import Case, ClosedForm, Response, capability
from rso.emulation.emulator import Sample, reduced_box
from rso.evaluation import Evaluator, responses
from rso.model_selection import ModelLevel
from rso.model_selection.candidate_models import Axes

RUNS_BY_PARAMETERS = {0: 1, 1: 8, 2: 16, 3: 30}  # of a level by the number of parameters that similarity leaves
MIN_NEW_RUNS_SHARE = 0.5  # of these, however many are known from the level below
LEVEL_SIMILARITY_TOLERANCE = 1e-6  # of the largest value: how well the proof run must agree with similarity
RUNS_PER_PARAMETER = 12  # for every parameter beyond


class LadderUnanswered(Exception):
    """A level cannot be fitted; the message says why."""


def simulate_level(
    evaluator: Evaluator, level: ModelLevel, axes: Axes, cases: Sequence[Case], points: Sequence[Mapping[str, float]]
) -> list[tuple[Response, ...] | str]:
    """By point, the response of every case, or why one has none; LadderUnanswered for a level that is not modelled."""
    here = [replace(c, settings={**c.settings, **level.settings}) for c in cases]
    values = [axes.physical(p) for p in points]
    if level.closed_form:
        if any(c.programme.forced for c in here):
            raise LadderUnanswered("its closed form follows travel alone, and creep at a held force is compared")
        form = capability(evaluator.backend, ClosedForm)
        if form is None:
            raise LadderUnanswered("the backend has no closed_form, which this level needs")
        return [tuple(form.closed_form(v, c) for c in here) for v in values]
    try:
        return [responses(outcomes) for outcomes in evaluator.at(here, values)]
    except ValueError as error:  # nothing was run
        raise LadderUnanswered(f"the backend does not model it: {error}") from error


def level_design(axes: Axes, runs: int | None, seed: int, inherited: int = 0) -> list[dict[str, float]]:
    """Points to learn a level from: along one parameter evenly spaced, else a Latin hypercube, of the reduced box.

    Runs that are `inherited` from the level below need not be made, up to half of them.
    """
    box = reduced_box(axes.box, axes.group)
    reference = {} if axes.group.reference is None else {axes.group.reference: axes.group.reference_value}
    if box is None:
        return [reference]
    usual = RUNS_BY_PARAMETERS.get(box.d, RUNS_PER_PARAMETER * box.d)
    n = runs or max(usual - inherited, round(MIN_NEW_RUNS_SHARE * usual))
    X = np.linspace(0, 1, n)[:, None] if box.d == 1 else doe.design("lhs", box.d, n, seed)
    return [reference | dict(zip(box.names, map(float, row), strict=True)) for row in box.from_unit(X)]


def sampled(plan: Plan, axes: Axes, values: Mapping[str, float], answer: tuple[Response, ...]) -> Sample:
    """What is learnt from a run: outputs and their derivatives by axis.

    Numerical errors are not: they are common to all runs on one mesh, no scatter about a smooth surface, and the
    likelihood has them already.
    """
    outputs, gradients = {}, {}
    for o in curve_outputs(plan):
        response = answer[plan.case_of[o.experiment]]
        outputs[o.id] = o.read(response)
        gradients[o.id] = axes.slopes(values, o.gradient(response))
    return Sample(dict(values), outputs, {}, gradients)


def prove(plan: Plan, evaluator: Evaluator, level: ModelLevel, axes: Axes, known: Sample) -> None:
    """One run of a design again at another modulus: NoAnswer where similarity does not predict it."""
    group = axes.group
    if group.reference is None:
        return
    other = {k: v * PROOF_MODULUS_RATIO ** group.exponents.get(k, 0) for k, v in known.values.items()}
    (answer,) = simulate_level(evaluator, level, axes, plan.cases, [other])
    if isinstance(answer, str):
        raise LadderUnanswered(f"the run that was to prove similarity has no answer: {answer}")
    found = sampled(plan, axes, other, answer).outputs
    expected = {o.id: group.expand(o.channel, known.outputs[o.id], PROOF_MODULUS_RATIO) for o in curve_outputs(plan)}
    off = max(abs(found[i] - y) for i, y in expected.items()) / max(abs(y) for y in expected.values())
    if off > LEVEL_SIMILARITY_TOLERANCE:
        text = f"similarity is off by {100 * off:.2g} % where the modulus is {PROOF_MODULUS_RATIO:g} times as large"
        raise LadderUnanswered(f"{text}: the model holds a stress that no parameter declares; set doe.reduce = false")
