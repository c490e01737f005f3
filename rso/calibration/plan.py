"""What a study will run: cases, outputs, designs.  Nothing is computed here."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from rso import doe
from rso.contract import Backend, Case, DerivedQuantities, capability
from rso.core import disk
from rso.core.digits import quantity_text
from rso.core.similarity import Group, group
from rso.data import (
    CreepHold,
    Hold,
    MeasuredCurve,
    SurfaceCloud,
    cloud_curve,
    combine,
    said_of_cloud,
    value_at,
)
from rso.doe import Box, Condition
from rso.emulation.emulator import Output, reduced_box
from rso.evaluation import Source, Task
from rso.inference import SURFACE_CHANNEL
from rso.inference.input_effects import InputEffect
from rso.optimise.targets import Constraint
from rso.optimise.targets import Target as Goal
from rso.study.cases import (
    case_for,
    cloud_case,
    cloud_channels,
    measured_clouds,
    measured_curves,
    measured_profiles,
    merge_cases,
    profile_case,
    refuse_what_is_not_modelled,
    remarks,
    travels,
)
from rso.study.creep import Creeps, creep_case, loading_experiment, said_of, with_creep
from rso.study.dimensions import dimensions_of_all
from rso.study.errors import Problem, study_error
from rso.study.holds import (
    followed,
    hold_in,
    middle,
    of_loop,
    of_unused,
    of_used,
    place_of_target,
    unseen,
    value_at_rest,
)
from rso.study.resolve import Axis, Resolved, Search, resolve
from rso.study.schema import ExperimentTable, Study
from rso.study.search_table import ConstraintTable as ConstraintTable
from rso.study.search_table import TargetTable
from rso.study.sources import backend_of, needs_data
from rso.study.sources import source_of as source_of

MAX_POINTS_FILE_BYTES = 20_000_000  # of a file of points
MIN_REDUCED_DESIGN_RUNS = 8  # runs of a reduced design
STRESS_SCALE_REASON = "not applied: a force that is held sets a scale of stress"
PROOF_MODULUS_RATIO = 1.25  # of the moduli of runs that prove similarity, where no derivatives do
N_PROOF_RUNS = 2  # direct runs that prove similarity on the study itself


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
    one of them (`validation` has those of the experiments kept for the end); `curves` are the measured ones while
    loading, also profiles, which are never fitted, and those of creep at a held force, experiments of their own
    (`creeps`).  `clouds` are point clouds, of which `curves` has one component.  `effects` are those of uncertain
    inputs on all curves, once they were simulated.
    `found` are the holds of the records, or why one is of no use, and
    `holds` those that the model follows, which are compared too.
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
    conditions: tuple[Condition, ...] = ()
    found: Mapping[str, Hold | str] = dataclasses.field(default_factory=dict)
    holds: Mapping[str, Hold] = dataclasses.field(default_factory=dict)
    creeps: Creeps = dataclasses.field(default_factory=Creeps)
    clouds: Mapping[str, SurfaceCloud] = dataclasses.field(default_factory=dict)
    effects: tuple[InputEffect, ...] = ()

    def of_hold(self, name: str, inline: bool = False) -> list[str]:
        """What there is to say of the hold of an experiment, in lines or `inline`; nothing where there is none."""
        hold = self.found.get(name, "")
        times = {a.name: (a.low, a.high) for a in self.resolved.axes if a.parameter.unit == "s"}
        creep = said_of(self.study, self.backend, self.creeps, name, times)
        if isinstance(hold, str):
            return [*([f"Its hold is not used: {hold}."] if hold else []), *creep]
        return [*(of_used(hold) if name in self.holds else of_unused(self.backend, hold, inline)), *creep]

    def remarks(self, name: str, inline: bool = False) -> list[str]:
        """What there is to say of the data of an experiment, of its holds in lines or `inline`."""
        if name in self.clouds:
            return [*self.study.measurement(name).doubts, *said_of_cloud(self.clouds[name])]
        if (hold := self.creeps.followed.get(name)) is not None:
            loading = loading_experiment(name)
            return [
                f"Depth over time while {quantity_text(hold.force, 'N')} are held, behind the loading of {loading!r}."
            ]
        held = not isinstance(self.found.get(name, ""), str)
        loop = [] if held else of_loop(self.study, self.backend, middle(self.resolved), name, inline)
        return [*remarks(self.study, name, self.of_hold(name, inline)), *loop]

    def of_relaxation(self) -> list[str]:
        """What there is to say of relaxation times that no record can show."""
        fitted = [name for name in self.case_of if self.study.experiment(name).role == "fit"]
        if any(name in self.holds or name in self.creeps.followed for name in fitted):
            return []
        return unseen(self.study, self.backend, {a.name: a for a in self.resolved.axes}, fitted)

    @property
    def seed(self) -> int:
        """Root seed."""
        return self.study.study.seed

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Physical values, fixed ones included, of one point (d,) of the unit cube."""
        theta = self.box.from_unit(np.asarray(x, float)[None])[0]
        return {**dict(zip(self.box.names, map(float, theta), strict=True)), **self.resolved.fixed}

    def excess(self, X: np.ndarray) -> np.ndarray:
        """By how much points X (n, d) of the unit cube violate each condition between parameters (n, k)."""
        theta = dict(zip(self.box.names, self.box.from_unit(np.asarray(X, float)).T, strict=True))
        columns = [c.excess(theta) for c in self.conditions]
        return np.stack(columns, axis=1) if columns else np.zeros((len(X), 0))

    def feasible(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points that respect every condition between parameters."""
        return np.all(self.excess(X) <= 0, axis=1)

    def tasks(self, values: Mapping[str, float]) -> list[Task]:
        """One task per case of the fitted experiments."""
        return [Task(values, case, self._needs(k)) for k, case in enumerate(self.cases)]

    def _needs(self, k: int) -> frozenset[str]:
        """Channels that are read from the k-th case."""
        return frozenset(o.channel for o in (*self.outputs, *self.extras) if self.case_of[o.experiment] == k)


def ends_in(axes: tuple[Axis, ...], box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Ranges of a search in the unit cube of the box."""
    low, high = (box.to_unit(np.array([[getattr(a, end) for a in axes]]))[0] for end in ("low", "high"))
    return np.clip(low, 0, 1), np.clip(high, 0, 1)


class _Asked(dict[str, np.ndarray]):
    """Values of 1 of whatever is asked, which remembers what was."""

    def __missing__(self, name: str) -> np.ndarray:
        return self.setdefault(name, np.ones(1))


def _dimensions(study: Study, backend: Backend) -> list[str]:
    """Errors of dimensions of all experiments, where the study states one."""
    if not (study.uncertainty or any(e.uncertainty for e in study.experiments)):
        return []
    return dimensions_of_all(backend, [study.settings_of(e.name) for e in study.experiments], list(study.parameters))


def derived_from(backend: Backend, settings: Mapping[str, Any]) -> dict[str, str]:
    """What the backend derives from parameters, by name: what it is and from which of them it follows."""
    offered, found = capability(backend, DerivedQuantities), {}
    if offered is not None:
        needed = [p.name for p in backend.parameters if p.default is None]
        for q in offered.derived(settings, needed):
            values = _Asked()
            q.of(values)
            found[q.name] = f"{q.description} follows from {' and '.join(values)}"
    return found


def _derived(study: Study, backend: Backend) -> dict[str, str]:
    """The same where a study names what is no parameter."""
    unknown = study.parameters.keys() - {p.name for p in backend.parameters}
    return derived_from(backend, study.backend.settings) if unknown else {}


def make_plan(
    study: Study,
    beside: Sequence[tuple[Mapping[str, float], Mapping[str, Any]]] = (),
    backend: Backend | None = None,
    shared: Mapping[str, tuple[float, ...]] = MappingProxyType({}),
) -> Plan:
    """Plan of a loaded study; StudyError for whatever its backend or its data do not allow.

    A `backend` stands in for the one that the study names.  Travels (mm) that an experiment has in common with those
    of other studies may be `shared`: with them the same values are the same simulation, whatever depth was read.
    Holds are compared where the model of the study relaxes, or one of those `beside` it: values and settings that
    replace its own.
    """
    needs_data(study)
    source = source_of(study)
    backend = backend_of(study, source) if backend is None else backend
    resolved = resolve(study, backend.parameters, _derived(study, backend), _dimensions(study, backend))
    clouds = measured_clouds(study)
    curves = {**measured_curves(study), **measured_profiles(study)}
    curves |= {n: cloud_curve(c, study.experiment(n).compared[-1]) for n, c in clouds.items()}
    refuse_what_is_not_modelled(study, backend, resolved, curves, clouds)
    forces = [e.name for e in study.experiments if e.kind == "force"]
    there = [n for n in forces if not curves[n].back]
    found = {n: hold for n in there if (hold := hold_in(study, n, curves[n]))}
    holds = followed(study, backend, middle(resolved), found, beside)
    study, creeps = with_creep(study, backend, middle(resolved), beside)
    curves |= creeps.curves
    fitted = [e for e in study.experiments if e.role != "validate" and e.kind == "force"]
    targets = study.search.targets or _default_targets(curves, fitted, holds, creeps, shared)
    main = Search("main", targets, resolved.axes)
    wanted = [main, *(dataclasses.replace(v, targets=v.targets or main.targets) for v in resolved.variants)]
    by_travel = [e.name for e in fitted if e.name not in creeps.followed]
    met = _met(study, wanted)
    asked = {
        n: tuple(sorted({*shared[n], *met[n]})) if n in shared else travels(curves[n], met[n], holds.get(n))
        for n in by_travel
    }
    cases, case_of = _cases(study, backend, fitted, asked, resolved, holds, creeps)
    on_surface = [e.name for e in study.experiments if e.kind == "surface" and e.role == "fit"]
    case_of |= {n: len(cases) + k for k, n in enumerate(on_surface)}
    cases = (*cases, *(cloud_case(study, n, clouds[n]) for n in on_surface))
    kept = [e for e in study.experiments if e.role == "validate"]
    validation = {e.name: _case_kept(study, e, curves[e.name], clouds, holds, creeps) for e in kept}
    units, box = backend.channels, _box(study, resolved)
    searches = tuple(_search(study, s, box, curves, units, holds, creeps) for s in wanted)
    constraints = tuple(_constraint(c, units) for c in study.search.constraints)
    outputs = [
        Output(e.name, channel, u, units[channel], since, e.branch == "unloading")
        for e in fitted
        for channel in e.compared
        for u, since in _readings(asked.get(e.name, ()), holds.get(e.name) or creeps.followed.get(e.name))
    ]
    outputs = list(dict.fromkeys([*outputs, *(o for s in searches for o in s.outputs)]))
    outputs += [o for n in on_surface for o in cloud_outputs(n, clouds[n])]
    extras = [*_others(backend, fitted[0], asked[fitted[0].name], main.targets), *map(limited, constraints)]
    plan = Plan(
        study,
        resolved,
        backend,
        source,
        box,
        _with_surface(_group(study, backend, resolved, box, creeps), outputs),
        cases,
        case_of,
        validation,
        curves,
        tuple(outputs),
        tuple(o for o in dict.fromkeys(extras) if o not in outputs),
        constraints,
        searches,
        _conditions(study, box),
        found,
        holds,
        creeps,
        clouds,
    )
    full_design(plan)  # whatever is wrong with the design is said now, not when runs have begun
    return plan


def _met(study: Study, searches: Sequence[Search]) -> Mapping[str, set[float]]:
    """Depths (mm) that targets and constraints name, by experiment; those of a hold are its own."""
    depths: list[TargetTable | ConstraintTable] = [*(t for s in searches for t in s.targets), *study.search.constraints]
    on_the_way = [t for t in depths if not getattr(t, "since", 0.0)]
    return {e.name: {t.depth for t in on_the_way if t.experiment == e.name} for e in study.experiments}


def _case_kept(
    study: Study,
    e: ExperimentTable,
    curve: MeasuredCurve,
    clouds: Mapping[str, SurfaceCloud],
    holds: Mapping[str, Hold],
    creeps: Creeps,
) -> Case:
    """The simulation of an experiment that is kept for validation."""
    if e.kind == "surface":
        return cloud_case(study, e.name, clouds[e.name])
    if e.kind == "profile":
        return profile_case(study, e.name, curve)
    if e.name in creeps.followed:
        return creep_case(study, e.name, creeps.followed[e.name])
    hold = holds.get(e.name)
    return case_for(study, e.name, travels(curve, set(), hold), hold)


def cloud_outputs(name: str, cloud: SurfaceCloud) -> list[Output]:
    """What is read of a simulation for a point cloud, reading by reading."""
    each = zip(cloud_channels(cloud).tolist(), cloud.depth.tolist(), strict=True)
    return [Output(name, channel, depth, "mm") for channel, depth in each]


def _with_surface(group: Group, outputs: Sequence[Output]) -> Group:
    """The similarity with the displacements of points of a surface: there is no stress in their unit."""
    marks = dict.fromkeys((SURFACE_CHANNEL, *(o.channel for o in outputs if o.on_surface)), 0)
    return dataclasses.replace(group, outputs={**group.outputs, **marks})


def _cases(
    study: Study,
    backend: Backend,
    fitted: list[ExperimentTable],
    asked: Mapping[str, tuple[float, ...]],
    resolved: Resolved,
    holds: Mapping[str, Hold],
    creeps: Creeps,
) -> tuple[tuple[Case, ...], dict[str, int]]:
    """The different simulations and which is whose; creep has one for each hold, beside those of loading."""
    cases, case_of = merge_cases(study, backend, [e for e in fitted if e.name in asked], asked, resolved, holds)
    for e in fitted:
        if e.name in creeps.followed:
            case_of[e.name] = len(cases)
            cases = (*cases, creep_case(study, e.name, creeps.followed[e.name]))
    return cases, case_of


def _readings(asked: tuple[float, ...], hold: Hold | CreepHold | None) -> list[tuple[float, float]]:
    """Travel (mm) and time in the hold (s) of everything that is read of an experiment."""
    resting = [] if hold is None else [(asked[-1] if asked else hold.depth, s) for s in hold.moments]
    return [*((u, 0.0) for u in asked), *resting]


def limited(constraint: Constraint) -> Output:
    """The output that a constraint limits."""
    return Output(constraint.experiment, constraint.channel, constraint.depth_mm, constraint.unit)


def full_design(plan: Plan) -> np.ndarray:
    """The design that the user asked for, (runs, d) in the unit cube."""
    table = plan.study.doe
    if table.kind == "file":
        assert table.file is not None
        return _extended(plan, _from_file(plan, table.file))
    # The other kinds know their number of runs; the default of `runs` is not the user's wish.
    stated = "runs" in table.model_fields_set or doe.SAMPLERS[table.kind].free
    try:
        X = _designed(plan, table.runs if stated else None)
        return _extended(plan, X)
    except ValueError as error:
        place = ("doe", "constraints") if (left := _left(plan)) else ("doe",)
        raise study_error(plan.study.file, plan.study.lines, [Problem(place, f"{error}{left}")]) from error


def _left(plan: Plan) -> str:
    """How much of the ranges each condition between parameters leaves, the least first; empty without any."""
    X = doe.sobol_sequence(plan.box.d, 2**14, plan.seed)
    theta = dict(zip(plan.box.names, plan.box.from_unit(X).T, strict=True))
    shares = sorted((float(np.mean(c.excess(theta) <= 0)), c.text) for c in plan.conditions)
    said = [f"{text!r} leaves {f'{100 * share:.2g}' if share else 'less than 0.01'} %" for share, text in shares]
    return f"; of the ranges {', '.join(said)}" if said else ""


@functools.lru_cache(maxsize=4)
def _designed(plan: Plan, runs: int | None) -> np.ndarray:
    """Asked for several times in a study, and an optimised one takes a second."""
    table = plan.study.doe
    feasible = plan.feasible if plan.conditions else None
    X = doe.design(table.kind, plan.box.d, runs, plan.seed, feasible=feasible, **table.options())
    X.flags.writeable = False
    return X


def _extended(plan: Plan, X: np.ndarray) -> np.ndarray:
    """The design and the points that were added to it later; the first ones and their runs stay as they are."""
    table = plan.study.doe
    if not table.extend:
        return X
    feasible = plan.feasible if plan.conditions else None
    return np.vstack([X, doe.extend_design(table.kind, X, table.extend, plan.seed, feasible)])


def fe_design(plan: Plan, similar: bool) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Values of the runs to fit and of those held out; with `similar` only the reduced box is sampled.

    In one dimension evenly spaced points with both ends are the stratified design; in none, one run says all.
    """
    table, full = plan.study.doe, full_design(plan)
    if not similar:
        held = _held_out(table.held_out, plan.box.d, plan.seed, plan.feasible if plan.conditions else None)
        return [plan.values(x) for x in full], [plan.values(x) for x in held]
    reduced = reduced_box(plan.box, plan.group)
    if reduced is None:
        return [_back(plan, {})], []
    feasible = functools.partial(reduced_feasible, plan, reduced) if plan.conditions else None
    asked = len(full) - table.extend
    count, total = (
        min(n, max(MIN_REDUCED_DESIGN_RUNS, math.ceil(n ** (reduced.d / plan.box.d)))) for n in (asked, len(full))
    )
    if reduced.d == 1 and feasible is None:
        X = np.linspace(0.0, 1.0, count)[:, None]
        middles = 0.5 * (X[1:] + X[:-1])
        take = np.unique(np.linspace(0, count - 2, min(table.held_out, count - 1)).round().astype(int))
        H = middles[take]
    else:
        X = doe.design("lhs", reduced.d, count, plan.seed, feasible=feasible)
        H = _held_out(table.held_out, reduced.d, plan.seed, feasible)
    if total > count:
        X = np.vstack([X, doe.extend(X, total - count, plan.seed, feasible)])
    design, left_out = (
        [_back(plan, dict(zip(reduced.names, row, strict=True))) for row in reduced.from_unit(P)] for P in (X, H)
    )
    return design, left_out


def _held_out(n: int, d: int, seed: int, feasible: doe.Feasible | None) -> np.ndarray:
    if not n:
        return np.empty((0, d))
    return doe.latin(d, n, seed + 1) if feasible is None else doe.latin_within(d, n, seed + 1, feasible)


def reduced_feasible(plan: Plan, reduced: Box, R: np.ndarray) -> np.ndarray:
    """Mask (n,) of reduced points that stand for at least one point of the study's box that respects the conditions."""
    group, box = plan.group, plan.box
    k = box.names.index(group.reference)
    scales = np.geomspace(box.low[k], box.high[k], 65) / group.reference_value
    physical = {group.reference: group.reference_value} | dict(zip(reduced.names, reduced.from_unit(R).T, strict=True))
    rows = [
        np.stack([physical[n] * s ** group.exponents.get(n, 0) * np.ones(len(R)) for n in box.names], axis=1)
        for s in scales
    ]
    theta = np.vstack(rows)
    good = box.contains(theta)
    good[good] = plan.feasible(np.clip(box.to_unit(theta[good]), 0, 1))
    return np.any(good.reshape(len(scales), len(R)), axis=0)


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
        if len(pairs) == N_PROOF_RUNS:
            break
    return pairs


def _back(plan: Plan, reduced: Mapping[str, float]) -> dict[str, float]:
    values = {k: float(v) for k, v in reduced.items()}
    assert plan.group.reference is not None  # else nothing is reduced
    return {plan.group.reference: plan.group.reference_value, **values, **plan.resolved.fixed}


def _box(study: Study, resolved: Resolved) -> Box:
    """The ranges of the open parameters; for a circumscribed design as wide as its star points lie apart."""
    axes, table = resolved.axes, study.doe
    box = Box(
        tuple(a.name for a in axes),
        tuple(a.parameter.unit for a in axes),
        tuple(a.low for a in axes),
        tuple(a.high for a in axes),
        tuple(a.scale == "log" for a in axes),
    )
    try:
        times = doe.SAMPLERS[table.kind].wider(box.d, table.options()) if table.kind in doe.SAMPLERS else 1.0
        if times == 1.0:
            return box
        wide = box.widened(times)
        for a, low, high in zip(axes, wide.low, wide.high, strict=True):
            if not a.parameter.low <= low <= high <= a.parameter.high:
                text = f"its star points, {low:g} and {high:g} {a.parameter.unit}, lie outside the bounds of {a.name}, "
                raise ValueError(f"{text}{a.parameter.low:g} to {a.parameter.high:g}: narrow the range or inscribe it")
    except ValueError as error:
        raise study_error(study.file, study.lines, [Problem(("doe", "star"), str(error), table.star)]) from error
    return wide


def _conditions(study: Study, box: Box) -> tuple[Condition, ...]:
    direct = Problem(("doe", "constraints"), 'search.method = "gauss_newton" knows only ranges')
    problems, found = [direct] * bool(study.doe.constraints and study.search.method == "gauss_newton"), []
    for n, text in enumerate(study.doe.constraints):
        try:
            found.append(doe.read_condition(text, box.names))
        except ValueError as error:
            problems.append(Problem(("doe", "constraints", n), str(error)))
    if problems:
        raise study_error(study.file, study.lines, problems)
    return tuple(found)


def _group(study: Study, backend: Backend, resolved: Resolved, box: Box, creeps: Creeps) -> Group:
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
    if creeps.followed:  # F = μ f(s) at a force that is held is no longer the same s
        return dataclasses.replace(found, reference=None, why=STRESS_SCALE_REASON)
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
    backend: Backend, experiment: ExperimentTable, asked: tuple[float, ...], targets: tuple[TargetTable, ...]
) -> list[Output]:
    """Every channel that is not compared, of the first experiment at its deepest target (or travel)."""
    names = [c for c in backend.channels if c not in ("time", "travel", *experiment.compared)]
    depth = max((t.depth for t in targets if t.experiment == experiment.name), default=asked[-1])
    return [Output(experiment.name, c, depth, backend.channels[c]) for c in names]


def _constraint(table: ConstraintTable, units: Mapping[str, str]) -> Constraint:
    low, high = -math.inf if table.low is None else table.low, math.inf if table.high is None else table.high
    return Constraint(table.experiment, table.channel, table.depth, low, high, units[table.channel])


def _default_targets(
    curves: Mapping[str, MeasuredCurve],
    fitted: list[ExperimentTable],
    holds: Mapping[str, Hold],
    creeps: Creeps,
    shared: Mapping[str, tuple[float, ...]],
) -> tuple[TargetTable, ...]:
    """Without targets: up to three points of each curve that is fitted, so that its whole shape counts, and three
    moments of its hold, even in the logarithm of time.  Of travels that are shared these are some within the curve."""
    found = []
    for e in fitted:
        if e.role == "fit":
            place = {"experiment": e.name, "channel": e.compared[0]}
            if e.name not in creeps.followed:
                u = curves[e.name].depth[curves[e.name].depth > 0]
                at = np.array([v for v in shared.get(e.name, ()) if u.min() <= v <= u.max()] or u)
                depths = {float(at[np.argmin(np.abs(at - share * u.max()))]) for share in (0.4, 0.7, 1.0)}
                found += [TargetTable.model_validate({**place, "depth": depth}) for depth in sorted(depths)]
            if (hold := holds.get(e.name) or creeps.followed.get(e.name)) is not None:
                rest = np.unique(np.linspace(0, len(hold.since) - 1, 4).round().astype(int))[1:]
                moments = [{**place, "depth": hold.depth, "since": hold.moments[k]} for k in rest]
                found += [TargetTable.model_construct(**m) for m in moments]  # creep is of no channel that one states
    return tuple(found)


def _search(
    study: Study,
    search: Search,
    box: Box,
    curves: Mapping[str, MeasuredCurve],
    units: Mapping[str, str],
    holds: Mapping[str, Hold],
    creeps: Creeps,
) -> SearchPlan:
    goals, outputs = [], []
    for t in search.targets:
        e, curve = study.experiment(t.experiment), curves[t.experiment]
        creep = creeps.followed.get(t.experiment)
        hold = creep or holds.get(t.experiment)
        if creep is None and (t.channel != curve.channel or t.since):
            curve = combine(
                study.measurement(e.name),
                study.noise_of(e.name),
                t.channel,
                e.branch,
                holds.get(t.experiment) if t.since else None,
            )
        depth, since = place_of_target(study, t, hold)
        value, sigma = value_at(curve, t.depth) if not since else value_at_rest(curve, since)
        value = value if t.value is None else t.value
        # A perfect measurement would leave nothing acceptable; neither would a target of 0 on a curve that is not.
        sigma = max(sigma, 1e-3 * (abs(value) or float(np.abs(curve.value).max())))
        if sigma == 0.0:
            text = (
                f"the target {t.channel} of {e.name!r} at {quantity_text(t.depth, 'mm', 6)} is 0 without "
                f"uncertainty: state a noise"
            )
            raise study_error(study.file, study.lines, [Problem(("search", "targets"), text)])
        goals.append(Goal(t.experiment, t.channel, depth, value, sigma, units[t.channel], t.value is None, since))
        outputs.append(Output(t.experiment, t.channel, depth, units[t.channel], since, e.branch == "unloading"))
    return SearchPlan(search.name, tuple(goals), tuple(outputs), *ends_in(search.axes, box), search.axes)


def _from_file(plan: Plan, name: str) -> np.ndarray:
    """Points from a CSV whose header names the open parameters, in their units."""
    path = plan.study.folder / name
    try:
        text = disk.read_bytes(path, MAX_POINTS_FILE_BYTES).decode("utf-8-sig")
        header = [h.strip() for h in text.splitlines()[0].split(",")]
        data = np.loadtxt(text.splitlines()[1:], delimiter=",", ndmin=2)
        theta = data[:, [header.index(n) for n in plan.box.names]]
        if not np.all(plan.box.contains(theta)):
            raise ValueError("points outside the parameters' ranges")
        X = plan.box.to_unit(theta)
        if not np.all(plan.feasible(X)):
            raise ValueError(f"{np.sum(~plan.feasible(X))} points violate doe.constraints")
        return X
    except (OSError, ValueError, IndexError) as error:
        wanted = ",".join(plan.box.names)
        message = f"{path.name}: {error}; a CSV with the header {wanted} and one point per line is expected"
        raise study_error(plan.study.file, plan.study.lines, [Problem(("doe", "file"), message)]) from error
