"""What a study will run: cases, outputs, designs.  Nothing is computed here."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso import doe
from rso.contract import Backend, Case, Programme, digest
from rso.doe import Box
from rso.emulator import Output, reduced_box
from rso.measurement import MeasuredCurve, combine, value_at
from rso.running import Source, Task
from rso.similarity import Group, group
from rso.study.errors import Problem, choose, study_error
from rso.study.places import Place
from rso.study.resolve import Axis, Resolved, Search, resolve
from rso.study.schema import Constraint as ConstraintTable
from rso.study.schema import ExperimentTable, Study, Target
from rso.surrogates.polynomial import HIGHEST
from rso.targets import Constraint
from rso.targets import Target as Goal

STEPS = 8  # travels at which a whole curve is computed; between them a spline that is exact for Hertz
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
    """Plan of a loaded study; StudyError for whatever its backend or its data do not allow."""
    source = Source(study.backend.use, study.backend.command, str(study.folder), None, study.backend.timeout)
    try:
        backend = source.load()
    except ValueError as error:
        raise study_error(study.file, study.lines, [Problem(("backend",), str(error))]) from error
    resolved = resolve(study, backend.parameters)
    curves = _curves(study)
    _refuse_what_is_not_modelled(study, backend, resolved, curves)
    fitted = [e for e in study.experiments if e.role != "validate"]
    main = Search("main", study.search.targets or _default_targets(curves, fitted), resolved.axes)
    wanted = [main, *(dataclasses.replace(v, targets=v.targets or main.targets) for v in resolved.variants)]
    depths = [*(t for s in wanted for t in s.targets), *study.search.constraints]
    asked = {e.name: _travels(curves[e.name], {t.depth for t in depths if t.experiment == e.name}) for e in fitted}
    cases, case_of = _merge(study, backend, fitted, asked, resolved)
    validation = {
        e.name: _case(study, e.name, _travels(curves[e.name], set())) for e in study.experiments if e.role == "validate"
    }
    units, box = backend.channels, _box(resolved.axes)
    searches = tuple(_search(study, s, box, curves, units) for s in wanted)
    constraints = tuple(_constraint(c, units) for c in study.search.constraints)
    outputs = [
        Output(e.name, channel, u, units[channel]) for e in fitted for channel in e.compared for u in asked[e.name]
    ]
    outputs = list(dict.fromkeys([*outputs, *(o for s in searches for o in s.outputs)]))
    extras = [*_others(backend, fitted[0], asked[fitted[0].name], main.targets), *map(limited, constraints)]
    plan = Plan(
        study, resolved, backend, source, box, _group(study, backend, resolved, box), cases, case_of, validation,
        curves, tuple(outputs), tuple(o for o in dict.fromkeys(extras) if o not in outputs), constraints, searches,
    )  # fmt: skip
    full_design(plan)  # whatever is wrong with the design is said now, not when runs have begun
    return plan


def limited(constraint: Constraint) -> Output:
    """The output that a constraint limits."""
    return Output(constraint.experiment, constraint.channel, constraint.depth_mm, constraint.unit)


def full_design(plan: Plan) -> np.ndarray:
    """The design that the user asked for, (runs, d) in the unit cube."""
    table = plan.study.doe
    if table.kind == "file":
        assert table.file is not None
        return _from_file(plan, table.file)
    # The other kinds know their number of runs; the default of `runs` is not the user's wish.
    stated = "runs" in table.model_fields_set or table.kind in ("lhs", "sobol", "osf")
    try:
        return doe.design(table.kind, plan.box.d, table.runs if stated else None, plan.seed)
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
    count = min(len(full), max(FEWEST, math.ceil(len(full) ** (reduced.d / plan.box.d))))
    if reduced.d == 1:
        X = np.linspace(0.0, 1.0, count)[:, None]
        middles = 0.5 * (X[1:] + X[:-1])
        take = np.unique(np.linspace(0, count - 2, min(table.held_out, count - 1)).round().astype(int))
        H = middles[take]
    else:
        X = doe.design("lhs", reduced.d, count, plan.seed)
        H = doe.latin(reduced.d, table.held_out, plan.seed + 1) if table.held_out else np.empty((0, reduced.d))
    design, held = (
        [_back(plan, dict(zip(reduced.names, row, strict=True))) for row in reduced.from_unit(P)] for P in (X, H)
    )
    return design, held


def proofs(plan: Plan, design: list[dict[str, float]]) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Pairs (direct, similar): points of the study's box and the design runs that similarity says are theirs.

    The modulus of a direct run differs from the reference by 10 %, or by a quarter of its range if that is narrow.
    """
    rng = np.random.default_rng([plan.seed, 77])
    box, group = plan.box, plan.group
    k = box.names.index(group.reference)
    apart = min(0.1, 0.25 * math.log(box.high[k] / box.low[k]))
    pairs = []
    for i in rng.permutation(len(design)):
        for _ in range(200):
            s = float(box.from_unit(rng.random((1, box.d)))[0, k]) / group.reference_value
            theta = {n: design[i][n] * s ** group.exponents.get(n, 0) for n in box.names}
            inside = all(lo <= theta[n] <= hi for n, lo, hi in zip(box.names, box.low, box.high, strict=True))
            if inside and abs(math.log(s)) > apart:
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


def _group(study: Study, backend: Backend, resolved: Resolved, box: Box) -> Group:
    """Similarity of the open parameters; any other with a stress in its unit and a value but zero stands in the way."""
    opened = [dataclasses.replace(a.parameter, low=a.low, high=a.high) for a in resolved.axes]
    bounds = {p.name: p for p in backend.parameters}
    others = [p for p in backend.parameters if p.name not in box.names]
    constants = {p.name: p.unit for p in others if resolved.fixed.get(p.name, p.default) != 0.0}
    try:
        found = group(opened, backend.channels, constants=constants)
    except ValueError as error:
        return Group(None, 1.0, {}, dict.fromkeys(backend.channels, 0), f"not applied: {error}")
    if found.reference is None:
        return found
    if not study.doe.reduce:
        return dataclasses.replace(found, reference=None, why="switched off: doe.reduce = false")
    reduced = reduced_box(box, found)
    ends = () if reduced is None else zip(reduced.names, reduced.low, reduced.high, strict=True)
    beyond = [n for n, low, high in ends if low < bounds[n].low or high > bounds[n].high]
    if beyond:
        why = f"not applied: it would run {', '.join(beyond)} outside the hard bounds of the backend"
        return dataclasses.replace(found, reference=None, why=why)
    return found


def _others(
    backend: Backend, experiment: ExperimentTable, asked: tuple[float, ...], targets: tuple[Target, ...]
) -> list[Output]:
    """Every channel that is not compared, of the first experiment at its deepest target (or travel)."""
    names = [c for c in backend.channels if c not in ("time", "travel", *experiment.compared)]
    depth = max((t.depth for t in targets if t.experiment == experiment.name), default=asked[-1])
    return [Output(experiment.name, c, depth, backend.channels[c]) for c in names]


def _constraint(table: ConstraintTable, units: Mapping[str, str]) -> Constraint:
    low, high = -math.inf if table.low is None else table.low, math.inf if table.high is None else table.high
    return Constraint(table.experiment, table.channel, table.depth, low, high, units[table.channel])


def _curves(study: Study) -> dict[str, MeasuredCurve]:
    """First compared channel of every force experiment, repeats combined."""
    curves, problems = {}, []
    for n, e in enumerate(study.experiments):
        if e.kind != "force":
            continue
        try:
            curve = combine(study.measurement(e.name), e.noise.noise(), e.compared[0])
            if not curve.depth.max() > 0:
                raise ValueError(f"no depth is positive, the largest is {curve.depth.max():g} mm")
            curves[e.name] = curve
        except ValueError as error:
            problems.append(Problem(("experiments", n, "data"), f"cannot be used: {error}", e.data))
    if problems:
        raise study_error(study.file, study.lines, problems)
    return curves


def _travels(curve: MeasuredCurve, targets: set[float]) -> tuple[float, ...]:
    """The targets, and evenly spaced travels to the deepest measured depth where no target is near."""
    deepest = float(curve.depth.max())
    steps = 1 if len(curve.depth) == 1 else STEPS
    grid = [round(deepest * k / steps, 6) for k in range(1, steps)]
    kept = {u for u in grid if all(abs(u - t) > 0.01 * deepest for t in targets)}
    if max(targets, default=0.0) < deepest:
        kept.add(deepest)  # not rounded: every measured depth must be reached
    return tuple(sorted({*kept, *targets}))


def _case(study: Study, name: str, asked: tuple[float, ...]) -> Case:
    settings = study.settings_of(name)
    return Case(name, Programme.ramp(asked), settings)


def _merge(
    study: Study, backend: Backend, fitted: list[ExperimentTable], asked: Mapping[str, tuple[float, ...]],
    resolved: Resolved,
) -> tuple[tuple[Case, ...], dict[str, int]]:  # fmt: skip
    """Experiments whose canonical settings are equal become one case that is asked for all their travels."""
    # Inside the ranges: at their ends an effect may be neutral, and then more drops out than elsewhere.
    example = {a.name: 0.5 * (a.low + a.high) for a in resolved.axes} | dict(resolved.fixed)
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
        place: Place = ("experiments", n)
        if e.kind != "force":
            problems.append(Problem((*place, "kind"), f"the backend {backend.name!r} has no profiles", e.kind))
            continue
        problems += [_no_channel(backend, (*place, "channels"), c) for c in e.compared if c not in backend.channels]
        try:
            backend.check(_case(study, e.name, _travels(curves[e.name], set())))
        except ValueError as error:
            found = Problem(_setting(study, n, str(error)), str(error))
            problems += [] if found in problems else [found]  # what all experiments share is said once
    problems += _refuse_search(study, backend)
    opened = [a.name for a in resolved.axes]
    for p in backend.parameters:
        if p.default is None and p.name not in opened and p.name not in resolved.fixed:
            text = f"the backend needs {p.name!r} ({p.description}, {p.unit}): give low and high, or value"
            problems.append(Problem(("parameters",), text))
    if "degree" in study.surrogate.model_fields_set and study.surrogate.degree > HIGHEST:
        text = f"polynomials have degrees 1 to {HIGHEST}"
        problems.append(Problem(("surrogate", "degree"), text, study.surrogate.degree))
    if problems:
        raise study_error(study.file, study.lines, problems)


def _setting(study: Study, n: int, message: str) -> Place:
    """Where the setting stands that a message of the backend names; else where the n-th experiment has its own."""
    own, words = study.experiments[n].settings, re.findall(r"\w+", message)
    for place, settings in ((("experiments", n, "settings"), own), (("backend", "settings"), study.backend.settings)):
        for key in words:
            if key in settings:
                return (*place, key)
    return ("experiments", n, "settings") if own else ("backend", "settings")


def _refuse_search(study: Study, backend: Backend) -> list[Problem]:
    """Targets and constraints on channels that the backend has, constraints on experiments that are fitted."""
    problems = []
    owners: list[tuple[Place, tuple[Target, ...]]] = [(("search",), study.search.targets)]
    owners += [(("search", "variants", n), v.targets) for n, v in enumerate(study.search.variants)]
    for place, targets in owners:
        for n, t in enumerate(targets):
            if t.channel not in backend.channels:
                problems.append(_no_channel(backend, (*place, "targets", n, "channel"), t.channel))
    for n, c in enumerate(study.search.constraints):
        place = ("search", "constraints", n)
        if c.channel not in backend.channels:
            problems.append(_no_channel(backend, (*place, "channel"), c.channel))
        if study.experiment(c.experiment).role == "validate":
            text = 'is for validation (role = "validate") and cannot be constrained'
            problems.append(Problem((*place, "experiment"), text, c.experiment))
    return problems


def _no_channel(backend: Backend, place: Place, channel: str) -> Problem:
    return Problem(
        place, f"the backend {backend.name!r} has no such channel; {choose(channel, backend.channels)}", channel
    )


def _default_targets(curves: Mapping[str, MeasuredCurve], fitted: list[ExperimentTable]) -> tuple[Target, ...]:
    """Without targets: up to three points of each curve that is fitted, so that its whole shape counts."""
    found = []
    for e in fitted:
        if e.role == "fit":
            u = curves[e.name].depth[curves[e.name].depth > 0]
            depths = {float(u[np.argmin(np.abs(u - share * u.max()))]) for share in (0.4, 0.7, 1.0)}
            found += [Target(experiment=e.name, depth=depth, channel=e.compared[0]) for depth in sorted(depths)]
    return tuple(found)


def _search(
    study: Study, search: Search, box: Box, curves: Mapping[str, MeasuredCurve], units: Mapping[str, str]
) -> SearchPlan:
    goals, outputs = [], []
    for t in search.targets:
        e, curve = study.experiment(t.experiment), curves[t.experiment]
        if t.channel != curve.channel:
            curve = combine(study.measurement(e.name), e.noise.noise(), t.channel)
        value, sigma = value_at(curve, t.depth)
        value = value if t.value is None else t.value
        sigma = max(sigma, 1e-3 * abs(value))  # a perfect measurement would leave nothing acceptable
        if sigma == 0.0:
            text = f"the target {t.channel} of {e.name!r} at {t.depth:g} mm is 0 without uncertainty: state a noise"
            raise study_error(study.file, study.lines, [Problem(("search", "targets"), text)])
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
