"""What a study with [objectives] will run and look at.  Nothing is computed here."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso import doe
from rso.contract import Backend, Case, FreeCurves, Parameter, Programme, capability
from rso.contract.responses import ALWAYS_CHANNELS
from rso.core import disk
from rso.core.quantities import OutputQuantity, limit_in_unit
from rso.core.units import spaced
from rso.doe import Condition, Space
from rso.doe.space import distinct_runs, refusal
from rso.evaluation import Source, Task
from rso.study.errors import Problem, choices_text, study_error
from rso.study.resolve import resolve
from rso.study.schema import Study
from rso.study.sources import backend_of, source_of

CASE_NAME = "model"
MAX_DESIGN_FILE_BYTES = 16 * 1024 * 1024  # of a file of points


@dataclass(frozen=True)
class Objective:
    """A quantity that is to be small, or large where not `minimise`."""

    quantity: OutputQuantity
    unit: str
    minimise: bool

    @property
    def sign(self) -> float:
        """What its values are multiplied by to be minimised."""
        return 1.0 if self.minimise else -1.0


@dataclass(frozen=True)
class OutputLimit:
    """Limits of a quantity, in its unit; infinite where it has no such end."""

    text: str
    quantity: OutputQuantity
    unit: str
    low: float
    high: float

    def miss(self, value: float) -> float:
        """How far a value is outside, in the unit of the quantity; 0 within."""
        return max(self.low - value, value - self.high, 0.0)


@dataclass(frozen=True, eq=False)
class ParetoPlan:
    """A study with objectives against its backend: the space that is searched, what is fixed, what is read."""

    study: Study
    backend: Backend
    source: Source
    space: Space
    parameters: tuple[Parameter, ...]
    fixed: Mapping[str, float]
    case: Case
    objectives: tuple[Objective, ...]
    limits: tuple[OutputLimit, ...]
    conditions: tuple[Condition, ...]

    @property
    def seed(self) -> int:
        """Root of all random numbers."""
        return self.study.study.seed

    @property
    def quantities(self) -> tuple[OutputQuantity, ...]:
        """Everything that is read of a run, once."""
        every = [*(o.quantity for o in self.objectives), *(c.quantity for c in self.limits)]
        return tuple({q.text: q for q in every}.values())

    @property
    def units(self) -> dict[str, str]:
        """Quantity → its unit."""
        found = {o.quantity.text: o.unit for o in self.objectives}
        return found | {c.quantity.text: c.unit for c in self.limits}

    def excess(self, U: np.ndarray) -> np.ndarray:
        """By how much points (n, d) violate the conditions between parameters (n, k), at most 0 where they hold."""
        theta = dict(zip(self.space.names, self.space.values(U).T, strict=True))
        theta |= {k: np.full(len(U), v) for k, v in self.fixed.items()}
        return (
            np.stack([c.excess(theta) for c in self.conditions], axis=1) if self.conditions else np.zeros((len(U), 0))
        )

    def feasible(self, U: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points that respect the conditions between parameters."""
        return np.all(self.excess(U) <= 0.0, axis=1)

    def task(self, u: np.ndarray) -> Task:
        """The simulation of one point (d,)."""
        needs = {q.name for q in self.quantities} & set(self.backend.channels)
        return Task({**self.space.mapping(u), **self.fixed}, self.case, frozenset(needs))


def pareto_plan(study: Study, *, backend: Backend | None = None) -> ParetoPlan:
    """The plan of a study with [objectives]; StudyError for all that does not fit together.

    `backend` stands in for the one that the file names.
    """
    assert study.objectives is not None
    source = source_of(study)
    if backend is None:
        backend = backend_of(study, source)
    resolved = resolve(study, backend.parameters)
    found = resolved.space
    problems: list[Problem] = []
    given = {*resolved.fixed, *(a.name for a in resolved.axes)}
    for p in backend.parameters:
        if p.default is None and p.name not in given:
            problems.append(Problem(("parameters",), f"{p.name} has no default: state its range or value"))
    if found is None:
        problems.append(Problem(("parameters",), "nothing to search: at least one needs low and high"))
        raise study_error(study.file, study.lines, problems)
    case = Case(CASE_NAME, _programme(study), dict(study.backend.settings))
    try:
        backend.check(case)
    except ValueError as error:
        problems.append(Problem(("backend", "settings"), str(error)))
    outputs = _outputs(backend, case)
    objectives = _objectives(study, outputs, problems)
    limits = _limits(study, outputs, problems)
    conditions = _conditions(study, found, resolved.fixed, problems)
    why = refusal(study.doe.kind, study.doe.options(), found)
    if study.doe.options().get("star") == "circumscribed":
        why = "star points beyond the ranges are none of this study's: choose inscribed or face"
    problems += [Problem(("doe", "kind"), why, study.doe.kind)] if why else []
    if problems:
        raise study_error(study.file, study.lines, problems)
    axes = tuple(a.parameter for a in resolved.axes)
    return ParetoPlan(
        study, backend, source, found, axes, resolved.fixed, case, objectives, limits, conditions
    )  # fmt: skip


def _programme(study: Study) -> Programme:
    assert study.objectives is not None
    travel = study.objectives.travel
    return Programme() if travel is None else Programme.ramp(travel)


Outputs = dict[str, tuple[str, str | None, str]]


def _outputs(backend: Backend, case: Case) -> Outputs:
    """What a run answers: name → unit, abscissa (None of one number), unit of that."""
    over: tuple[str | None, str] = (None, "") if case.programme.still else ("travel", "mm")
    found: Outputs = {k: (unit, *over) for k, unit in backend.channels.items() if k not in ALWAYS_CHANNELS}
    curves = capability(backend, FreeCurves)
    return found | ({} if curves is None else {k: (u, a, v) for k, (u, a, v) in curves.free_curves().items()})


def _unit(quantity: OutputQuantity, outputs: Outputs, place: Any, problems: list[Problem]) -> str | None:
    """The unit of a quantity; None after noting a problem."""
    if quantity.name not in outputs:
        problems.append(
            Problem(place, f"the model has no output {quantity.name!r}; {choices_text(quantity.name, outputs)}")
        )
        return None
    try:
        return quantity.unit(outputs)
    except ValueError as error:
        problems.append(Problem(place, str(error)))
        return None


def _objectives(study: Study, outputs: Outputs, problems: list[Problem]) -> tuple[Objective, ...]:
    table, found = study.objectives, []
    assert table is not None
    for quantity, small in table.goals():
        key = "minimise" if small else "maximise"
        listed: Sequence[str] = table.minimise if small else table.maximise
        at = [t.strip() for t in listed].index(quantity.text)
        unit = _unit(quantity, outputs, ("objectives", key, at), problems)
        found += [] if unit is None else [Objective(quantity, unit, small)]
    return tuple(found)


def _limits(study: Study, outputs: Outputs, problems: list[Problem]) -> tuple[OutputLimit, ...]:
    table, found = study.objectives, []
    assert table is not None
    for n, limits in enumerate(table.limits()):
        place = ("objectives", "constraints", n)
        if limits.quantity.name in study.parameters and limits.quantity.name not in outputs:
            text = f"{limits.quantity.name} is a parameter: conditions between parameters stand in doe.constraints"
            problems.append(Problem(place, text, limits.text))
            continue
        unit = _unit(limits.quantity, outputs, place, problems)
        if unit is None:
            continue
        try:
            low, high = limit_in_unit(limits.low, unit, -np.inf), limit_in_unit(limits.high, unit, np.inf)
        except ValueError as error:
            problems.append(Problem(place, str(error), limits.text))
            continue
        if low > high:
            problems.append(Problem(place, f"low = {low:g} is above high = {high:g}{spaced(unit)}", limits.text))
        found.append(OutputLimit(limits.text, limits.quantity, unit, low, high))
    return tuple(found)


def _conditions(
    study: Study, space: Space, fixed: Mapping[str, float], problems: list[Problem]
) -> tuple[Condition, ...]:
    found = []
    names = [n for n, labels in zip(space.names, space.labels, strict=True) if not labels] + list(fixed)
    for n, text in enumerate(study.doe.constraints):
        try:
            found.append(doe.read_condition(text, names))
        except ValueError as error:
            problems.append(Problem(("doe", "constraints", n), str(error), text))
    return tuple(found)


def designed(plan: ParetoPlan) -> np.ndarray:
    """The points (n, d) of the design, on their levels, each another run; StudyError where there is no such design."""
    table, space = plan.study.doe, plan.space
    if table.kind == "file":
        return _from_file(plan)
    stated = "runs" in table.model_fields_set or doe.SAMPLERS[table.kind].free
    feasible = (lambda U: plan.feasible(space.snapped(U))) if plan.conditions else None
    runs = min(table.runs, int(min(space.count(), table.runs))) if stated else None
    try:
        U = doe.design(table.kind, space.d, runs, plan.seed, feasible=feasible, **table.options())
        U = _filled_up(plan, distinct_runs(space, U), len(U), feasible)
        if table.extend:
            further = doe.extend_design(table.kind, U, table.extend, plan.seed, feasible)
            U = distinct_runs(space, np.vstack([U, further]))
    except ValueError as error:
        raise study_error(plan.study.file, plan.study.lines, [Problem(("doe",), str(error))]) from error
    return U


def _filled_up(plan: ParetoPlan, U: np.ndarray, n: int, feasible: doe.Feasible | None) -> np.ndarray:
    """The design with as many different points as were asked for, as far as there are so many."""
    if len(U) >= n:
        return U
    more = plan.space.snapped(doe.sobol_sequence(plan.space.d, 4096, [plan.seed, 1]))
    more = more if feasible is None else more[np.asarray(feasible(more), bool)]
    return distinct_runs(plan.space, np.vstack([U, more]))[:n]


def held_out_points(plan: ParetoPlan, design: np.ndarray) -> np.ndarray:
    """Points (m, d) of their own that score the surfaces before any of them learns these."""
    n = plan.study.doe.held_out
    if not n:
        return np.empty((0, plan.space.d))
    U = plan.space.snapped(doe.sobol_sequence(plan.space.d, 4096, [plan.seed, 2]))
    U = distinct_runs(plan.space, U[plan.feasible(U)])
    known = {tuple(u) for u in design.round(9)}
    return np.array([u for u in U[: 64 * n] if tuple(u.round(9)) not in known][:n]).reshape(-1, plan.space.d)


def _from_file(plan: ParetoPlan) -> np.ndarray:
    """Points of a CSV whose header names the open parameters; categories by their texts."""
    name = plan.study.doe.file
    assert name is not None
    space, path = plan.space, plan.study.folder / name
    try:
        rows = list(
            csv.DictReader(
                disk.read_bytes(path, MAX_DESIGN_FILE_BYTES).decode("utf-8-sig").splitlines(), skipinitialspace=True
            )
        )
        theta = np.array([[_cell(space, n, row) for n in space.names] for row in rows]).reshape(-1, space.d)
        U = space.from_values(theta)
        if not len(U):
            raise ValueError("no points")
        if not np.allclose(space.values(U), theta, rtol=1e-9, atol=0) or not np.all(space.box.contains(theta)):
            raise ValueError("points outside the parameters' ranges, or on none of their values")
        if not np.all(plan.feasible(U)):
            raise ValueError(f"{np.sum(~plan.feasible(U))} points violate doe.constraints")
        return distinct_runs(space, U)
    except (OSError, ValueError, csv.Error) as error:
        message = f"{path.name}: {error}; a CSV with the header {','.join(space.names)}, one point a line, is expected"
        raise study_error(plan.study.file, plan.study.lines, [Problem(("doe", "file"), message)]) from error


def _cell(space: Space, name: str, row: Mapping[str, str | None]) -> float:
    j, text = space.names.index(name), (row.get(name) or "").strip()
    if not text:
        raise ValueError(f"column {name} is missing or empty")
    if space.labels[j]:
        if text not in space.labels[j]:
            raise ValueError(f"{name} = {text!r}: {choices_text(text, space.labels[j])}")
        return space.levels[j][space.labels[j].index(text)]
    return float(text)
