"""Simulations beside the most likely point that say what uncertain inputs of a study make of its curves."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

from rso.calibration.plan import Plan
from rso.calibration.stages import Run, Runner
from rso.contract import NominalValues, Response, capability
from rso.evaluation import Done, why
from rso.inference.input_effects import InputEffect
from rso.study.resolve import UncertainInput

INPUT_RUN_DIGITS = 6  # of the values that are run: a study that goes on asks for the same runs


def learn_effects(bench: Runner, values: Mapping[str, float]) -> tuple[Runner, tuple[Run, ...], list[str]]:
    """The runner of a plan that knows what its uncertain inputs make of its curves at `values`, the runs, warnings.

    Nothing is run where the study states no such input.  An input without an answer on either side counts as exact,
    and a warning says so.
    """
    plan = bench.plan
    inputs = _of_fits(plan)
    if not inputs:
        return bench, (), []
    here = {n: float(f"{v:.{INPUT_RUN_DIGITS}g}") if n in plan.box.names else v for n, v in values.items()}
    wanted = {("", 0.0): (here, tuple(range(len(plan.cases))))}
    for i in inputs:
        wanted |= {(i.name, s): (v, _cases(plan, i)) for s in (1.0, -1.0) if (v := _beside(plan, here, i, s))}
    answers = iter(bench.evaluator.run([plan.tasks(v)[k] for v, cases in wanted.values() for k in cases]))
    runs = {
        which: Run("input", v, tuple(itertools.islice(answers, len(cases))), cases)
        for which, (v, cases) in wanted.items()
    }
    stated, effects, lost = _responses(runs["", 0.0]), list[InputEffect](), list[str]()
    for i in inputs:
        sides = [runs.get((i.name, s)) for s in (1.0, -1.0)]
        above, below = ({} if r is None else _responses(r) for r in sides)
        if all(k in stated and (k in above or k in below) for k in _cases(plan, i)):
            effects.append(_effect(i, stated, above, below))
            continue
        tried = [r for r in (*sides, runs["", 0.0]) if r is not None]
        reasons = [why(o)[1] or "" for r in tried for o in r.outcomes if not isinstance(o, Done)]
        reason = reasons[0] if reasons else "both sides lie beyond the bounds of this input"
        lost.append(f"uncertainty: {i.name} counts as exact, as it has no simulation beside it: {reason}")
    return replace(bench, plan=replace(plan, effects=tuple(effects))), tuple(runs.values()), lost


def _effect(
    i: UncertainInput, stated: Mapping[int, Response], above: Mapping[int, Response], below: Mapping[int, Response]
) -> InputEffect:
    p = i.parameter
    return InputEffect(i.name, p.name, i.experiments, p.description, p.unit, i.uncertainty, stated, above, below)


def count(plan: Plan) -> int:
    """Simulations of :func:`learn_effects` at most."""
    inputs = _of_fits(plan)
    return len(plan.cases) * bool(inputs) + 2 * sum(len(_cases(plan, i)) for i in inputs)


def _of_fits(plan: Plan) -> list[UncertainInput]:
    """Inputs of experiments that are fitted."""
    return [i for i in plan.resolved.inputs if _cases(plan, i)]


def _cases(plan: Plan, one: UncertainInput) -> tuple[int, ...]:
    """Cases that an input touches."""
    if not one.experiments:
        return tuple(range(len(plan.cases)))
    return tuple(sorted({plan.case_of[e] for e in one.experiments if e in plan.case_of}))


def _beside(plan: Plan, here: Mapping[str, float], one: UncertainInput, side: float) -> dict[str, float] | None:
    """Values with an input one standard uncertainty above or below what is stated; None beyond its hard bounds."""
    p, u = one.parameter, one.uncertainty
    offered = capability(plan.backend, NominalValues)
    first = plan.cases[_cases(plan, one)[0]].settings  # all state the same: the study was checked for it
    nominal = {} if offered is None else offered.nominal(first)
    at = here.get(p.name, nominal.get(p.name, p.default))
    assert at is not None  # the study was checked for it
    return {**here, p.name: at + side * u} if p.low <= at + side * u <= p.high else None


def _responses(run: Run) -> dict[int, Response]:
    """Responses of a run by case."""
    assert run.cases is not None
    return {k: o.response for k, o in zip(run.cases, run.outcomes, strict=True) if isinstance(o, Done)}
