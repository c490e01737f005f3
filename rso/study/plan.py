"""What a study will run: cases, outputs, designs.  Nothing is computed here."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso import doe
from rso.contract import Backend, Case, Programme, digest
from rso.doe import Box
from rso.emulator import Output, reduced_box
from rso.measurement import MeasuredCurve, combine, value_at
from rso.running import Source, Task
from rso.similarity import Group, group
from rso.study.errors import Problem, study_error
from rso.study.resolve import Axis, Resolved, Search, resolve
from rso.study.schema import ExperimentTable, Study, Target
from rso.targets import Constraint
from rso.targets import Target as Goal

STEPS = 8  # travels at which a whole curve is computed; the interpolation between them is exact for Hertz
FEWEST = 8  # runs of a reduced design
PROOFS = 2  # direct runs that prove similarity on the study itself


@dataclass(frozen=True, eq=False)
class SearchPlan:
    """One search in numbers: targets with values, constraints, bounds (d,) in the unit cube of the study's box."""

    name: str
    goals: tuple[Goal, ...]
    outputs: tuple[Output, ...]
    low: np.ndarray
    high: np.ndarray
    axes: tuple[Axis, ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that follows from the study file and the backend's declarations.

    `cases` are the different simulations behind the experiments that are fitted, `case_of` maps an experiment to
    one of them (`validation` has those of the experiments kept for the end); `curves` are the measured ones.
    """

    study: Study
    resolved: Resolved
    backend: Backend
    source: Source
    box: Box
    group: Group
    cases: tuple[Case, ...]
    case_of: Mapping[str, int]
    validation: Mapping[str, Case]
    curves: Mapping[str, MeasuredCurve]
    outputs: tuple[Output, ...]
    extras: tuple[Output, ...]
    constraints: tuple[Constraint, ...]
    searches: tuple[SearchPlan, ...]

    @property
    def seed(self) -> int:
        """Root seed."""
        return self.study.study.seed

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Physical values, fixed ones included, of one point (d,) of the unit cube."""
        theta = self.box.from_unit(np.asarray(x, float)[None])[0]
        return {**dict(zip(self.box.names, map(float, theta), strict=True)), **self.resolved.fixed}

    def tasks(self, values: Mapping[str, float]) -> list[Task]:
        """One task per case of the fitted experiments."""
        return [Task(values, case) for case in self.cases]


def make_plan(study: Study) -> Plan:
    """Plan of a loaded study; StudyError for whatever its backend does not know."""
    source = Source(
        study.backend.use,
        study.backend.command,
        str(study.folder),
        None,
        study.backend.timeout,
    )
    try:
        backend = source.load()
    except ValueError as error:
        raise study_error(study.file, study.lines, [Problem(("backend",), str(error))]) from error
    resolved = resolve(study, backend.parameters)
    if not resolved.axes:
        raise study_error(study.file, study.lines, [Problem(("parameters",), "no parameter is open: nothing to find")])
    box = _box(resolved.axes)
    curves = {
        e.name: combine(study.measurement(e.name), e.noise.noise(), e.compared[0])
        for e in study.experiments
        if e.kind == "force"
    }
    _refuse_what_is_not_modelled(study, backend, resolved, curves)
    fitted = [e for e in study.experiments if e.role != "validate"]
    asked = {e.name: _travels(curves[e.name], _target_depths(study, e.name)) for e in fitted}
    cases, case_of = _merge(study, backend, fitted, asked, resolved)
    validation = {
        e.name: _case(study, e.name, _travels(curves[e.name], ())) for e in study.experiments if e.role == "validate"
    }
    units = backend.channels
    outputs = tuple(
        Output(e.name, channel, u, units[channel]) for e in fitted for channel in e.compared for u in asked[e.name]
    )
    deepest = fitted[0].name
    others = [c for c in units if c not in ("time", "travel", *fitted[0].compared)]
    extras = tuple(Output(deepest, c, max(_target_depths(study, deepest) or asked[deepest]), units[c]) for c in others)
    constraints = tuple(
        Constraint(
            c.experiment, c.channel, c.depth, -math.inf if c.low is None else c.low,
            math.inf if c.high is None else c.high, units[c.channel],
        )
        for c in study.search.constraints
    )  # fmt: skip
    limited = [Output(c.experiment, c.channel, c.depth_mm, c.unit) for c in constraints]
    extras = tuple(dict.fromkeys([*extras, *(o for o in limited if o not in outputs)]))
    main = Search("main", study.search.targets or _default_targets(curves, fitted), resolved.axes)
    searches = tuple(_search(s, box, curves, units) for s in (main, *resolved.variants))
    return Plan(
        study, resolved, backend, source, box, _group(study, backend, resolved), cases, case_of, validation, curves,
        outputs, extras, constraints, searches,
    )  # fmt: skip


def full_design(plan: Plan) -> np.ndarray:
    """The design that the user asked for, (runs, d) in the unit cube."""
    table = plan.study.doe
    if table.kind == "file":
        assert table.file is not None
        return _from_file(plan, table.file)
    try:
        return doe.design(table.kind, plan.box.d, table.runs, plan.seed)
    except ValueError as error:
        raise study_error(plan.study.file, plan.study.lines, [Problem(("doe",), str(error))]) from error


def fe_design(plan: Plan, similar: bool) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Values of the runs to fit and of those held out; with `similar` only the reduced box is sampled.

    In one dimension evenly spaced points with both ends are the stratified design; in none, one run says all.
    """
    table, group, full = plan.study.doe, plan.group, full_design(plan)
    if not similar:
        held = doe.latin(plan.box.d, table.held_out, plan.seed + 1) if table.held_out else np.empty((0, plan.box.d))
        return [plan.values(x) for x in full], [plan.values(x) for x in held]
    reduced = reduced_box(plan.box, group)
    if reduced is None:
        return [_back(plan, {})], []
    count = max(FEWEST, math.ceil(len(full) ** (reduced.d / plan.box.d)))
    if reduced.d == 1:
        X = np.linspace(0.0, 1.0, count)[:, None]
        middles = 0.5 * (X[1:] + X[:-1])
        take = np.unique(np.linspace(0, count - 2, min(table.held_out, count - 1)).round().astype(int))
        H = middles[take]
    else:
        X = doe.design("lhs", reduced.d, count, plan.seed)
        H = doe.latin(reduced.d, table.held_out, plan.seed + 1) if table.held_out else np.empty((0, reduced.d))
    return tuple([_back(plan, dict(zip(reduced.names, row, strict=True))) for row in reduced.from_unit(P)] for P in (X, H))  # type: ignore[return-value]


def proofs(plan: Plan, design: list[dict[str, float]]) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Pairs (direct, similar): points of the study's box and the design runs that similarity says are theirs."""
    rng = np.random.default_rng([plan.seed, 77])
    reference = plan.group.reference
    k = plan.box.names.index(reference)
    pairs = []
    for i in rng.permutation(len(design)):
        for _ in range(200):
            s = float(plan.box.from_unit(rng.random((1, plan.box.d)))[0, k]) / plan.group.reference_value
            theta = {n: design[i][n] * s ** plan.group.exponents.get(n, 0) for n in plan.box.names}
            inside = all(lo <= theta[n] <= hi for n, lo, hi in zip(plan.box.names, plan.box.low, plan.box.high, strict=True))
            if inside and abs(math.log(s)) > 0.1:
                pairs.append(({**theta, **plan.resolved.fixed}, design[i]))
                break
        if len(pairs) == PROOFS:
            break
    return pairs


def _back(plan: Plan, reduced: Mapping[str, float]) -> dict[str, float]:
    values = {k: float(v) for k, v in reduced.items()}
    return {plan.group.reference: plan.group.reference_value, **values, **plan.resolved.fixed}


def _box(axes: tuple[Axis, ...]) -> Box:
    return Box(
        tuple(a.name for a in axes),
        tuple(a.parameter.unit for a in axes),
        tuple(a.low for a in axes),
        tuple(a.high for a in axes),
        tuple(a.scale == "log" for a in axes),
    )


def _group(study: Study, backend: Backend, resolved: Resolved) -> Group:
    """Similarity of the open parameters; a fixed one with a stress in its unit stands in the way."""
    opened = [dataclasses.replace(a.parameter, low=a.low, high=a.high) for a in resolved.axes]
    units = {p.name: p.unit for p in backend.parameters}
    constants = {n: units[n] for n, v in resolved.fixed.items() if v != 0.0}
    if not study.doe.reduce:
        return dataclasses.replace(group(opened, backend.channels), reference=None, why="switched off: doe.reduce = false")
    return group(opened, backend.channels, constants=constants)


def _target_depths(study: Study, name: str) -> tuple[float, ...]:
    tables = [*study.search.targets, *study.search.constraints, *(t for v in study.search.variants for t in v.targets)]
    return tuple(sorted({t.depth for t in tables if t.experiment == name}))


def _travels(curve: MeasuredCurve, targets: tuple[float, ...]) -> tuple[float, ...]:
    """Evenly spaced travels to the deepest measured depth, and the targets; a single measured point is itself."""
    deepest = float(curve.depth.max())
    grid = [deepest] if len(curve.depth) == 1 else [round(deepest * k / STEPS, 6) for k in range(1, STEPS + 1)]
    return tuple(sorted({*grid, *targets}))


def _case(study: Study, name: str, asked: tuple[float, ...]) -> Case:
    settings = study.settings_of(name)
    return Case(name, Programme.ramp(asked), settings)


def _merge(
    study: Study, backend: Backend, fitted: list[ExperimentTable], asked: dict[str, tuple[float, ...]], resolved: Resolved
) -> tuple[tuple[Case, ...], dict[str, int]]:
    """Experiments whose canonical settings are equal become one case that is asked for all their travels."""
    example = {a.name: a.low for a in resolved.axes} | dict(resolved.fixed)
    cases: list[Case] = []
    index: dict[str, int] = {}
    case_of: dict[str, int] = {}
    for e in fitted:
        case = _case(study, e.name, asked[e.name])
        same = digest(backend.canonical(example, case)[1].settings)
        if same in index:
            k = index[same]
            union = tuple(sorted({*cases[k].programme.asked_mm, *asked[e.name]}))
            cases[k] = dataclasses.replace(cases[k], programme=Programme.ramp(union))
        else:
            k = index[same] = len(cases)
            cases.append(case)
        case_of[e.name] = k
    return tuple(cases), case_of


def _refuse_what_is_not_modelled(
    study: Study, backend: Backend, resolved: Resolved, curves: Mapping[str, MeasuredCurve]
) -> None:
    problems = []
    for n, e in enumerate(study.experiments):
        place: tuple[Any, ...] = ("experiments", n)
        if e.kind != "force":
            problems.append(Problem((*place, "kind"), f"the backend {backend.name!r} has no profiles", e.kind))
            continue
        for channel in e.compared:
            if channel not in backend.channels:
                known = ", ".join(backend.channels)
                problems.append(Problem((*place, "channels"), f"the backend has no such channel; choose from {known}", channel))
        try:
            backend.check(_case(study, e.name, _travels(curves[e.name], _target_depths(study, e.name))))
        except ValueError as error:
            problems.append(Problem((*place, "settings") if e.settings else ("backend", "settings"), str(error)))
    for n, c in enumerate(study.search.constraints):
        if c.channel not in backend.channels:
            known = ", ".join(backend.channels)
            problems.append(Problem(("search", "constraints", n, "channel"), f"choose from {known}", c.channel))
    given = {*(a.name for a in resolved.axes), *resolved.fixed}
    for p in backend.parameters:
        if p.default is None and p.name not in given:
            text = f"the backend needs {p.name!r} ({p.description}, {p.unit}): give low and high, or value"
            problems.append(Problem(("parameters",), text))
    for n, name in enumerate(study.identify.require):
        if name not in {a.name for a in resolved.axes}:
            opened = ", ".join(a.name for a in resolved.axes)
            problems.append(Problem(("identify", "require", n), f"not an open parameter; choose from {opened}", name))
    if problems:
        raise study_error(study.file, study.lines, problems)


def _default_targets(curves: Mapping[str, MeasuredCurve], fitted: list[ExperimentTable]) -> tuple[Target, ...]:
    """Without targets: three points of each fitted curve, so that its whole shape counts."""
    found = []
    for e in fitted:
        u = curves[e.name].depth
        for share in (0.4, 0.7, 1.0) if len(u) > 2 else (1.0,):
            depth = float(u[np.argmin(np.abs(u - share * u.max()))])
            found.append(Target(experiment=e.name, depth=depth, channel=e.compared[0]))
    return tuple(found)


def _search(search: Search, box: Box, curves: Mapping[str, MeasuredCurve], units: Mapping[str, str]) -> SearchPlan:
    goals, outputs = [], []
    for t in search.targets:
        value, sigma = value_at(curves[t.experiment], t.depth)
        value = value if t.value is None else t.value
        sigma = max(sigma, 1e-3 * abs(value))  # a perfect measurement would leave nothing acceptable
        goals.append(Goal(t.experiment, t.channel, t.depth, value, sigma, units[t.channel]))
        outputs.append(Output(t.experiment, t.channel, t.depth, units[t.channel]))
    low, high = (box.to_unit(np.array([[getattr(a, end) for a in search.axes]]))[0] for end in ("low", "high"))
    return SearchPlan(search.name, tuple(goals), tuple(outputs), np.clip(low, 0, 1), np.clip(high, 0, 1), search.axes)


def _from_file(plan: Plan, name: str) -> np.ndarray:
    """Points from a CSV whose header names the open parameters, in their units."""
    path = plan.study.folder / name
    try:
        text = path.read_text(encoding="utf-8")
        header = [h.strip() for h in text.splitlines()[0].split(",")]
        data = np.loadtxt(text.splitlines()[1:], delimiter=",", ndmin=2)
        theta = data[:, [header.index(n) for n in plan.box.names]]
        if not np.all(plan.box.contains(theta)):
            raise ValueError("points outside the parameters' ranges")
        return plan.box.to_unit(theta)
    except (OSError, ValueError, IndexError) as error:
        wanted = ",".join(plan.box.names)
        message = f"{path.name}: {error}; a CSV with the header {wanted} and one point per line is expected"
        raise study_error(plan.study.file, plan.study.lines, [Problem(("doe", "file"), message)]) from error
