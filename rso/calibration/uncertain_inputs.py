"""Simulations beside the most likely point that say what uncertain inputs of a study make of its curves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rso.calibration.input_sides import SIDES, beside, inputs_of_fits, touched
from rso.calibration.plan import Plan, SearchPlan
from rso.calibration.stages import Run, Runner
from rso.calibration.stated_settings import exact_dimensions
from rso.contract import Response
from rso.evaluation import Done, why
from rso.inference.input_effects import InputEffect
from rso.study.dimensions import UncertainInput
from rso.study.input_sizes import size_words, stated_size, usual_uncertainty

INPUT_RUN_DIGITS = 6  # of the values that are run: a study that goes on asks for the same runs
LARGE_UNCERTAINTY_SHARE = 1.0 / 3.0  # of the size itself: beyond, its effect to first order is far off


def learn_effects(bench: Runner, values: Mapping[str, float]) -> tuple[Runner, tuple[Run, ...], list[str]]:
    """The runner of a plan that knows what its uncertain inputs make of its curves at `values`, the runs, warnings.

    Nothing is run where the study states no such input, of a test that does not feel it, and on a side that the
    backend refuses.  An input without an answer on either side counts as exact; one with an answer on one side has
    the effect of that one.  Warnings say both.
    """
    plan = bench.plan
    inputs = inputs_of_fits(plan)
    if not inputs:
        return bench, (), []
    here = {n: float(f"{v:.{INPUT_RUN_DIGITS}g}") if n in plan.box.names else v for n, v in values.items()}
    wanted = {("", 0.0): (here, tuple(range(len(plan.cases))))}
    refused: dict[tuple[str, float], str] = {}
    for i in inputs:
        for side in SIDES:
            tried = {k: beside(plan, here, i, side, k) for k in touched(plan, i)}
            if reasons := [reason for _, reason in tried.values() if reason is not None]:
                refused[i.name, side] = reasons[0]
            if cases := tuple(k for k, (_, reason) in tried.items() if reason is None):
                wanted[i.name, side] = (tried[cases[0]][0], cases)
    answers = iter(bench.evaluator.run([plan.tasks(v)[k] for v, cases in wanted.values() for k in cases]))
    runs = {
        which: Run("input", v, tuple(itertools.islice(answers, len(cases))), cases)
        for which, (v, cases) in wanted.items()
    }
    stated, effects, said = _responses(runs["", 0.0]), list[InputEffect](), _doubts(plan)
    for i in inputs:
        at = {side: runs.get((i.name, side)) for side in SIDES}
        above, below = ({} if r is None else _responses(r) for r in at.values())
        reasons = [refused[i.name, s] for s in SIDES if (i.name, s) in refused]
        reasons += [
            why(o)[1] or "" for r in (*at.values(), runs["", 0.0]) if r for o in r.outcomes if not isinstance(o, Done)
        ]
        if not all(k in stated and (k in above or k in below) for k in touched(plan, i)):
            reason = reasons[0] if reasons else "there is no run"
            said.append(f"uncertainty: {i.name} counts as exact, as it has no simulation beside it: {reason}")
            continue
        effects.append(_effect(i, stated, above, below))
        lone = [
            words
            for words, side in zip(SIDES.values(), (above, below), strict=True)
            if len(side) < len(touched(plan, i))
        ]
        if lone:
            said.append(f"uncertainty: {i.name} {one_sided(lone[0], reasons[0])}")
    plan = replace(plan, effects=tuple(effects), searches=tuple(_aware(plan, s, effects) for s in plan.searches))
    return replace(bench, plan=plan), tuple(runs.values()), said


def _aware(plan: Plan, search: SearchPlan, effects: Sequence[InputEffect]) -> SearchPlan:
    """A search whose targets know what the inputs, which are independent, move the simulated values by."""
    goals = []
    for goal, output in zip(search.goals, search.outputs, strict=True):
        k = plan.case_of[output.experiment]
        shifts = [e.output_shift(output, k) for e in effects if k in e.stated and (k in e.above or k in e.below)]
        goals.append(replace(goal, input_error=math.hypot(*shifts)))
    return replace(search, goals=tuple(goals))


def one_sided(words: str, reason: str) -> str:
    """That one side has no answer, and what counts in its place."""
    return f"has no simulation with one standard uncertainty {words} ({reason}): the other side alone counts"


def _effect(
    i: UncertainInput, stated: Mapping[int, Response], above: Mapping[int, Response], below: Mapping[int, Response]
) -> InputEffect:
    p = i.parameter
    return InputEffect(i.name, p.name, i.experiments, p.description, p.unit, i.uncertainty, stated, above, below)


def count(plan: Plan) -> int:
    """Simulations of :func:`learn_effects` at most."""
    inputs = inputs_of_fits(plan)
    return len(plan.cases) * bool(inputs) + 2 * sum(len(touched(plan, i)) for i in inputs)


def _responses(run: Run) -> dict[int, Response]:
    """Responses of a run by case."""
    assert run.cases is not None
    return {k: o.response for k, o in zip(run.cases, run.outcomes, strict=True) if isinstance(o, Done)}


# ------------------------------------------------------------------------------------------------- in words


def said_of_inputs(plan: Plan) -> list[str]:
    """How well stated dimensions are known, what tests share of that, and which dimensions count as exact.

    Nothing of a backend that names none.
    """
    lines = []
    middle = plan.values(np.full(plan.box.d, 0.5))
    for i in plan.resolved.inputs:
        p, sizes = i.parameter, _sizes(plan, i)
        one = p.unit != "1" and len(set(sizes.values())) == 1
        of = f" of {size_words(p, next(iter(sizes.values())))}" if one else ""
        words = "" if p.description == p.name else f", {p.description}"
        lines.append(f"  {p.name}: ±{size_words(p, i.uncertainty)}{of}{words}{_shared(plan, i)}")
        for side, words in SIDES.items():
            if reason := next((r for k in touched(plan, i) if (r := beside(plan, middle, i, side, k)[1])), None):
                lines.append(f"    {one_sided(words, reason)}")
    lines += [f"  {words}" for words in _doubts(plan)]
    if exact := exact_dimensions(plan):
        lines.append(f"  taken as exact, as [uncertainty] does not state them: {', '.join(exact)}")
    return lines


def _feeling(plan: Plan, one: UncertainInput) -> list[str]:
    """Fitted experiments that share an input and feel it."""
    cases = touched(plan, one)
    every = [e.name for e in plan.study.experiments if plan.case_of.get(e.name) in cases]
    return [e for e in every if not one.experiments or e in one.experiments]


def _shared(plan: Plan, one: UncertainInput) -> str:
    """Which of several tests feel an input, and that its error is the same in all of them."""
    names = [repr(e) for e in _feeling(plan, one)]
    if not names:
        return "; no fitted test feels it"
    if len(plan.case_of) < 2:
        return ""
    return f"; in {names[0]}" if len(names) == 1 else f"; one error in {', '.join(names[:-1])} and {names[-1]}"


def _sizes(plan: Plan, one: UncertainInput) -> dict[str, float]:
    """Stated sizes that an input is an error of, by fitted experiment that feels it."""
    every = {
        e: stated_size(plan.backend, plan.study.settings_of(e), plan.resolved.fixed, one) for e in _feeling(plan, one)
    }
    return {e: size for e, size in every.items() if size is not None}


def _doubts(plan: Plan) -> list[str]:
    """What is to be said of standard uncertainties as they are stated, whatever they make of the curves."""
    return [*_of_several_sizes(plan), *_large(plan)]


def _of_several_sizes(plan: Plan) -> list[str]:
    """Inputs that are one error in tests which state different sizes: several bodies, measured one by one or not."""
    said = []
    for i in plan.resolved.inputs:
        sizes = _sizes(plan, i)
        if len(set(sizes.values())) > 1:
            each = ", ".join(f"{size_words(i.parameter, v)} in {e!r}" for e, v in sizes.items())
            own = f'uncertainty = {{ {i.parameter.name} = "…" }}'
            said.append(
                f"uncertainty: {i.name} is one error in tests that state several sizes: {each}. Sizes measured one by "
                f"one have an error each: then write {own} under each of these experiments"
            )
    return said


def _large(plan: Plan) -> list[str]:
    """Standard uncertainties that are a large share of the size itself."""
    said = []
    for i in plan.resolved.inputs:
        sizes = _sizes(plan, i)
        e = min(sizes, key=lambda e: sizes[e], default=None)
        if e is not None and i.uncertainty > LARGE_UNCERTAINTY_SHARE * sizes[e]:
            whose = f" of {e!r}" if len(sizes) > 1 else ""
            percent, size = f"{100.0 * i.uncertainty / sizes[e]:.0f} %", size_words(i.parameter, sizes[e])
            share = f"±{size_words(i.parameter, i.uncertainty)} is {percent} of the {size}{whose}"
            usual = usual_uncertainty(plan.backend, plan.study.settings_of(e), i, sizes[e])
            said.append(f"uncertainty: {i.name}: {share}, too much for an effect to first order; {usual}")
    return said
