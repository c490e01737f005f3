"""Uncertain inputs of a study beside the sizes that they are errors of: what cannot be, and what is usual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.contract import Backend, NominalValues, Parameter, PlausibleRanges, capability
from rso.core.symbols import unit_text
from rso.core.units import people
from rso.study.dimensions import UncertainInput, dimension_errors, dimensions_of_all, stated_dimensions
from rso.study.errors import Problem, choices_text
from rso.study.line_numbers import Place
from rso.study.schema import Study


def refuse_inputs(
    study: Study, backend: Backend, inputs: Sequence[UncertainInput], fixed: Mapping[str, float], opened: Sequence[str]
) -> list[Problem]:
    """Uncertain inputs that none of the experiments has that share them, of which they state several values, or that
    are as large as what they are an error of."""
    ranges = capability(backend, PlausibleRanges)
    given = [*opened, *fixed]
    offered, problems = capability(backend, NominalValues), list[Problem]()
    for i in inputs:
        name, sharing = i.parameter.name, i.experiments or tuple(e.name for e in study.experiments)
        each = {e: study.settings_of(e) for e in sharing}
        place, written = place_of_input(study, i)
        values = (
            set() if offered is None else {offered.nominal(s).get(name, i.parameter.default) for s in each.values()}
        )
        if len(values) > 1 and name not in fixed:
            text = "experiments state several values of it: give each of them its own uncertainty"
            problems.append(Problem(place, text))
        if ranges is not None and all(ranges.plausible(s, given).get(name, ()) is None for s in each.values()):
            choices = dimensions_of_all(backend, each.values(), given)
            text = f"these settings have no {i.parameter.description}; {choices_text(name, choices)}"
            problems.append(Problem(place, text))
            continue
        for e, settings in each.items():
            size = stated_size(backend, settings, fixed, i)
            if size is not None and i.uncertainty >= size:
                whose = f" in {e!r}" if len(each) > 1 else ""
                text = f"is not below the size itself, {size_words(i.parameter, size)}{whose}"
                problems.append(Problem(place, f"{text}; {usual_uncertainty(backend, settings, i, size)}", written))
                break
    return problems


def place_of_input(study: Study, one: UncertainInput) -> tuple[Place, Any]:
    """Where a study states an uncertain input, and what is written there."""
    name = one.parameter.name
    n = [e.name for e in study.experiments].index(one.experiments[0]) if one.experiments else 0
    if one.experiments and name in study.experiments[n].uncertainty:
        return ("experiments", n, "uncertainty", name), study.experiments[n].uncertainty[name]
    return ("uncertainty", name), study.uncertainty.get(name)


def stated_size(
    backend: Backend, settings: Mapping[str, Any], fixed: Mapping[str, float], one: UncertainInput
) -> float | None:
    """The size that an input is an error of, in its unit, or the value, fixed or stated, that it is itself; None of
    another."""
    name = one.parameter.name
    sizes = stated_dimensions(backend, settings)
    if sizes is not None and name in sizes:
        return sizes[name] or None  # an edge of radius 0 has no share
    offered = capability(backend, NominalValues)
    nominal = {} if offered is None else offered.nominal(settings)
    value = fixed.get(name, nominal.get(name, one.parameter.default or 0.0))
    return abs(value) if value and one.parameter.neutral is None else None


def usual_uncertainty(backend: Backend, settings: Mapping[str, Any], one: UncertainInput, size: float) -> str:
    """What the standard uncertainty of an input is where its `size` is measured, in words."""
    found = dimension_errors(backend, settings).get(one.parameter.name)
    if found is None:
        return f"a hundredth of it would be {size_words(one.parameter, 0.01 * size)}"
    return f"usual is {size_words(one.parameter, found[1])} ({found[0]})"


def size_words(p: Parameter, size: float) -> str:
    """A size in the unit that people use for it."""
    label, factor = people(p.unit, size)
    return f"{size * factor:.3g} {unit_text(label)}" if label not in ("", "1") else f"{size * factor:.3g}"
