"""Second step of a study: its parameters against those that the backend declares."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from rso.contract import Parameter
from rso.core.default_backend import BACKEND_PACKAGE, DEFAULT_BACKEND
from rso.core.symbols import unit_text
from rso.core.units import people, spaced, value_in_unit
from rso.doe import Box, Space, space
from rso.study.dimensions import UncertainInput
from rso.study.errors import Problem, choices_text, study_error
from rso.study.line_numbers import Place
from rso.study.schema import ParameterTable, Study
from rso.study.search_table import TargetTable

NO_BOUND = 1e6  # of a unit: a hard bound that no study comes near is not worth a word
_MAX_LOG_RANGE_RATIO = 1e30  # ratio of the ends of a log scale; beyond it their quotient overflows sooner or later


@dataclass(frozen=True)
class Axis:
    """One parameter to be identified, with its range in the parameter's unit.

    `levels` are the values of one that has only some, `labels` the texts of a category, whose values are 0, 1, …
    """

    parameter: Parameter
    low: float
    high: float
    scale: Literal["linear", "log"]
    levels: tuple[float, ...] = ()
    labels: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name


@dataclass(frozen=True)
class Search:
    """One search: its name, its targets, and its ranges, one axis per free parameter of the study."""

    name: str
    targets: tuple[TargetTable, ...]
    axes: tuple[Axis, ...]


@dataclass(frozen=True)
class Resolved:
    """A study whose numbers have units: `axes` to be identified, `fixed` values; `variants`, `start` of the search;
    `inputs` are stated and uncertain."""

    study: Study
    axes: tuple[Axis, ...]
    fixed: Mapping[str, float]
    variants: tuple[Search, ...]
    start: Mapping[str, float]
    inputs: tuple[UncertainInput, ...] = ()

    @property
    def box(self) -> Box | None:
        """The ranges of the axes as the study states them; None where everything is fixed."""
        if not self.axes:
            return None
        columns = [(a.name, a.parameter.unit, float(a.low), float(a.high), a.scale == "log") for a in self.axes]
        return Box(*zip(*columns, strict=True))

    @property
    def space(self) -> Space | None:
        """The same with the axes that have only some values."""
        box = self.box
        return None if box is None else space(box, [a.levels for a in self.axes], [a.labels for a in self.axes])


def resolve(
    study: Study,
    parameters: tuple[Parameter, ...],
    derived: Mapping[str, str] = MappingProxyType({}),
    dimensions: Collection[str] = (),
) -> Resolved:
    """Bounds in the units of `parameters` (the backend's, and the measurement chain's if they are open).

    `derived` says of quantities that are no parameters from which they follow: "b follows from a, c".
    `dimensions` are knobs that are likely inputs of [uncertainty], named first where another is asked for.

    StudyError for unknown parameters, wrong units, values outside hard bounds, low ≥ high, a log scale that
    starts at or below 0, and variants that leave the study's range; all at once.
    """
    known = {p.name: p for p in parameters}
    problems: list[Problem] = []
    axes: dict[str, Axis] = {}
    fixed: dict[str, float] = {}
    for name, table in study.parameters.items():
        place: Place = ("parameters", name)
        if name not in known:
            if name in derived:
                text = f"{derived[name]}: state these"
            else:
                text = f"the backend has no such parameter; {choices_text(name, known, rest=parameters_page(study))}"
            problems.append(Problem(place, text))
        elif table.value is not None:
            value = _number(table.value, known[name], (*place, "value"), problems)
            if value is not None:
                fixed[name] = value
        else:
            axis = _axis(known[name], table, place, problems)
            if axis is not None:
                axes[name] = axis
    variants = []
    for n, variant in enumerate(study.search.variants):
        place = ("search", "variants", n, "ranges")
        narrowed = dict(axes)
        for name, (low, high) in variant.ranges.items():
            if name in fixed:
                problems.append(Problem((*place, name), "this parameter has a fixed value in [parameters]"))
            elif name in axes:
                narrowed[name] = _narrowed(axes[name], low, high, (*place, name), problems) or axes[name]
        variants.append(Search(variant.name, variant.targets or study.search.targets, tuple(narrowed.values())))
    start = _start(study, axes, problems)
    inputs = _inputs(study, known, dimensions, problems)
    if problems:
        raise study_error(study.file, study.lines, problems)
    return Resolved(
        study, tuple(axes.values()), MappingProxyType(fixed), tuple(variants), MappingProxyType(start), inputs
    )


def parameters_page(study: Study) -> str:
    """Where one sees all parameters of the backend of a study; empty where that is not known."""
    return f"python -m {BACKEND_PACKAGE} --schema lists them" if study.backend.use == DEFAULT_BACKEND else ""


def _inputs(
    study: Study, known: Mapping[str, Parameter], dimensions: Collection[str], problems: list[Problem]
) -> tuple[UncertainInput, ...]:
    """What [uncertainty] and experiments state of inputs, in their units; an experiment's own replaces the study's."""
    found = []
    own = {(name, e.name) for e in study.experiments for name in e.uncertainty}
    tables: list[tuple[Place, Mapping[str, Any], str]] = [(("uncertainty",), study.uncertainty, "")]
    tables += [(("experiments", n, "uncertainty"), e.uncertainty, e.name) for n, e in enumerate(study.experiments)]
    for place, table, experiment in tables:
        for name, written in table.items():
            one = _input(study, known, dimensions, name, written, (*place, name), problems)
            if one is None:
                continue
            others = tuple(e.name for e in study.experiments if (name, e.name) not in own)
            if experiment:
                found.append(UncertainInput(known[name], one, (experiment,)))
            elif others:
                found.append(UncertainInput(known[name], one, () if len(others) == len(study.experiments) else others))
    return tuple(found)


def _input(
    study: Study,
    known: Mapping[str, Parameter],
    dimensions: Collection[str],
    name: str,
    written: Any,
    place: Place,
    problems: list[Problem],
) -> float | None:
    """One standard uncertainty in the unit of its knob; None after noting a problem."""
    p = known.get(name)
    table = study.parameters.get(name)
    stated = {n for n, t in study.parameters.items() if t.value is not None}
    open_ = {n for n, t in study.parameters.items() if t.value is None}
    offered = [
        n
        for n, q in known.items()
        if (q.default is not None or n in stated) and not (q.choices or q.whole or n in open_)
    ]
    if table is not None and table.value is None:
        text = "is a parameter that is fitted: its range in [parameters] says how well it is known"
        problems.append(Problem(place, text, written))
        return None
    if p is None or name not in offered:
        hint = choices_text(name, offered, first=[*dimensions, *stated], rest=parameters_page(study))
        problems.append(Problem(place, f"no input that the study states; {hint}", written))
        return None
    try:
        u = value_in_unit(written, p.unit)
    except ValueError as error:
        problems.append(Problem(place, str(error), written))
        return None
    if not 0.0 < u <= p.high - p.low:
        problems.append(Problem(place, _expected_uncertainty(p), written))
        return None
    return u


def _expected_uncertainty(p: Parameter) -> str:
    """What a standard uncertainty may be, with one that is usual where that is declared."""
    most, text = p.high - p.low, "a standard uncertainty above 0 is expected"
    if most <= 0.0:
        return f"{p.name} has one value alone: state its bounds = [low, high] in [parameters]"
    if most < NO_BOUND:
        text += f", up to {most:g}{spaced(p.unit)}"
    if p.typical:
        label, factor = people(p.unit, p.typical)
        text += f", such as {f'{p.typical * factor:g} {unit_text(label)}'.strip()!r}"
    return f"{text} ({p.description}); without this line it counts as exact"


def _start(study: Study, axes: Mapping[str, Axis], problems: list[Problem]) -> dict[str, float]:
    """search.start in the parameters' units, inside the ranges."""
    found = {}
    for name, written in study.search.start.items():
        place: Place = ("search", "start", name)
        if name not in study.parameters:
            problems.append(Problem(place, f"no parameter of this study; {choices_text(name, study.parameters)}"))
        elif name in axes:
            a = axes[name]
            value = _number(written, a.parameter, place, problems)
            if value is not None and not a.low <= value <= a.high:
                text = f"must lie inside the range [{a.low:g}, {a.high:g}] {a.parameter.unit}"
                problems.append(Problem(place, text, written))
            elif value is not None:
                found[name] = value
        elif study.parameters[name].value is not None:
            problems.append(Problem(place, "this parameter has a fixed value in [parameters]", written))
    return found


def _number(written: Any, parameter: Parameter, place: Place, problems: list[Problem]) -> float | None:
    """A value in the parameter's unit and within its hard bounds; None after noting a problem.

    Of a category it is one of its texts.
    """
    if parameter.choices:
        if written in parameter.choices:
            return float(parameter.choices.index(written))
        problems.append(Problem(place, choices_text(str(written), parameter.choices), written))
        return None
    try:
        return parameter.check(value_in_unit(written, parameter.unit))
    except ValueError as error:
        problems.append(Problem(place, str(error), written))
        return None


def _axis(parameter: Parameter, table: ParameterTable, place: Place, problems: list[Problem]) -> Axis | None:
    if table.choices is not None or parameter.choices:
        return _category(parameter, table, place, problems)
    if table.values is not None:
        found = [_number(v, parameter, (*place, "values", n), problems) for n, v in enumerate(table.values)]
        numbers = sorted({v for v in found if v is not None})
        if None in found or len(numbers) < 2:
            return None
        if table.scale == "log" and numbers[0] <= 0:
            problems.append(Problem((*place, "values"), "a log scale needs values > 0", list(table.values)))
            return None
        return Axis(parameter, numbers[0], numbers[-1], table.scale, tuple(numbers))
    if table.whole or parameter.whole:
        return _whole(parameter, table, place, problems)
    low = _number(table.low, parameter, (*place, "low"), problems)
    high = _number(table.high, parameter, (*place, "high"), problems)
    if low is None or high is None:
        return None
    if low >= high:
        problems.append(Problem(place, f"low = {low:g} must be below high = {high:g} {parameter.unit}"))
        return None
    if table.scale == "log" and low <= 0:
        problems.append(Problem((*place, "low"), f"a log scale needs low > 0 {parameter.unit}", table.low))
        return None
    if table.scale == "log" and high > _MAX_LOG_RANGE_RATIO * low:
        text = f"a log scale from {low:g} to {high:g} {parameter.unit} spans more than {_MAX_LOG_RANGE_RATIO:g} : 1"
        problems.append(Problem((*place, "low"), text, table.low))
        return None
    return Axis(parameter, low, high, table.scale)


def _category(parameter: Parameter, table: ParameterTable, place: Place, problems: list[Problem]) -> Axis | None:
    """Texts to choose from: those of the study, or all that the backend has."""
    if not parameter.choices:
        text = f"the backend has {parameter.name} as a number in {parameter.unit}: give low and high, or values"
        problems.append(Problem((*place, "choices"), text))
        return None
    if table.choices is None:
        text = f"is a category: give choices = [...], of {', '.join(parameter.choices)}"
        problems.append(Problem((*place, "low" if table.low is not None else "values"), text))
        return None
    unknown = [(n, v) for n, v in enumerate(table.choices) if v not in parameter.choices]
    for n, v in unknown:
        problems.append(Problem((*place, "choices", n), choices_text(v, parameter.choices), v))
    if unknown:
        return None
    at = sorted(parameter.choices.index(v) for v in table.choices)
    return Axis(parameter, at[0], at[-1], "linear", tuple(map(float, at)), tuple(parameter.choices[k] for k in at))


MAX_WHOLE_NUMBERS = 10_000  # whole numbers of a range


def _whole(parameter: Parameter, table: ParameterTable, place: Place, problems: list[Problem]) -> Axis | None:
    """The whole numbers of a range."""
    ends = [_number(v, parameter, (*place, k), problems) for k, v in (("low", table.low), ("high", table.high))]
    low, high = ends
    if low is None or high is None:
        return None
    wrong = [k for k, v in (("low", low), ("high", high)) if v != round(v)]
    if wrong:
        written = table.low if wrong[0] == "low" else table.high
        problems.append(Problem((*place, wrong[0]), "a whole number is expected (whole = true)", written))
        return None
    if not low < high <= low + MAX_WHOLE_NUMBERS:
        text = f"low = {low:g} must be below high = {high:g}, by at most {MAX_WHOLE_NUMBERS}"
        problems.append(Problem(place, text))
        return None
    if table.scale == "log" and low <= 0:
        problems.append(Problem((*place, "low"), "a log scale needs low > 0", table.low))
        return None
    return Axis(parameter, low, high, table.scale, tuple(map(float, range(round(low), round(high) + 1))))


def _narrowed(axis: Axis, low: Any, high: Any, place: Place, problems: list[Problem]) -> Axis | None:
    """The axis with the range of a variant, which must lie inside."""
    ends = [_number(v, axis.parameter, (*place, n), problems) for n, v in enumerate((low, high))]
    if ends[0] is None or ends[1] is None:
        return None
    if not axis.low <= ends[0] < ends[1] <= axis.high:
        unit = axis.parameter.unit
        message = f"must lie inside the study's range [{axis.low:g}, {axis.high:g}] {unit} with low below high"
        problems.append(Problem(place, message, (low, high)))
        return None
    return Axis(axis.parameter, ends[0], ends[1], axis.scale)
