"""What is simulated for a library: the base model and its axes, ways of the indenter, and runs at places and sizes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rso.contract import Backend, Case, Programme, Relaxation, capability
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import timed
from rso.discrepancy.library.test_plan import Test, TestPlan, rounded_travel
from rso.evaluation import Task

N_ASKED_TRAVELS = 9  # travels at which a run is asked for forces
SAME_PASS_TOLERANCE = 0.06  # by which rests and speeds of ways may differ and count as one
PASS_ROUNDING_LN = 0.05  # of ln, to which they are rounded: data sets of one plan share most of their runs
N_REST_MOMENTS = 40  # moments of a rest in tables, from FIRST_REST_MOMENT_SHARE of it on
FIRST_REST_MOMENT_SHARE = 1e-3  # of a rest, from its begin
N_ASKED_REST_MOMENTS = 14  # of a rest at which a run is asked for forces
MARK_CLEARANCE_SHARE = 0.15  # of the depth of a mark: forces are asked for there, and need not be beside it
Run = Callable[[Sequence[Task]], list[Any]]


@dataclass(frozen=True)
class BaseAxis:
    """One open parameter besides the modulus, reduced by it: ln or linear range, exponent of stress.

    `kept` is the range of the parameter itself, in its unit, that fits keep to; None: all of the axis, at any modulus.
    """

    name: str
    unit: str
    low: float
    high: float
    log: bool
    exponent: int
    kept: tuple[float, float] | None = None

    def physical(self, x: np.ndarray | float, modulus: float = 1.0) -> np.ndarray:
        """Value at coordinate x for a modulus."""
        return (np.exp(x) if self.log else np.asarray(x, float)) * modulus**self.exponent

    def coordinate(self, value: np.ndarray | float, modulus: np.ndarray | float = 1.0) -> np.ndarray:
        """The coordinate of a value, see `physical`."""
        reduced = np.asarray(value, float) / np.asarray(modulus, float) ** self.exponent
        return np.log(reduced) if self.log else reduced

    @property
    def ends(self) -> tuple[float, float]:
        """Range of the coordinate."""
        return (float(np.log(self.low)), float(np.log(self.high))) if self.log else (self.low, self.high)


@dataclass(frozen=True, eq=False)
class BaseRelaxation:
    """Relaxation that belongs to the base model: tables hold it as an effect, simulations of the base are without it.

    `values` are size and time of the `effect` where they are fixed, None where an axis of its knob's name has them.
    """

    effect: Effect
    values: tuple[float | None, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Its knobs."""
        return tuple(k.name for k in self.effect.knobs)


@dataclass(frozen=True)
class Base:
    """The base model: its modulus with a reference value, the other open parameters, and fixed values.

    Settings of many cheap runs, `draft`, and of those on the study's mesh, `lean`.  Fixed values with a stress in their
    unit, `held` with its exponent e, stay where the modulus moves, so that it needs an axis of its own, named as it is:
    at the reference modulus μ₀ they are p (μ/μ₀)^−e.  Without such an axis `low` = `high` is a modulus that is fixed.
    Axes of what is `relaxing` come last: with the values of its knobs the model is simulated without them.
    """

    backend: Backend
    modulus: str
    reference: float
    low: float
    high: float
    axes: tuple[BaseAxis, ...]
    fixed: Mapping[str, float]
    draft: Mapping[str, Any]
    lean: Mapping[str, Any] = field(default_factory=dict)
    held: Mapping[str, int] = field(default_factory=dict)
    relaxing: BaseRelaxation | None = None

    @property
    def simulated(self) -> tuple[BaseAxis, ...]:
        """The axes along which the base model is simulated: all but those of what relaxes, which come last."""
        return tuple(a for a in self.axes if self.relaxing is None or a.name not in self.relaxing.names)

    def values(self, x: Sequence[float] | np.ndarray) -> dict[str, float]:
        """Knobs at coordinates x of the axes, or of those that are simulated, at the reference modulus."""
        own = {a.name: float(a.physical(v, self.reference)) for a, v in zip(self.simulated, x, strict=False)}
        scale = own.pop(self.modulus, self.reference) / self.reference
        held = {k: self.fixed[k] * scale**-e for k, e in self.held.items()}
        without = () if self.relaxing is None else self.relaxing.names
        fixed = {k: v for k, v in self.fixed.items() if k not in without}
        return {**fixed, **held, self.modulus: self.reference, **own}

    def relaxation(self, x: np.ndarray) -> np.ndarray:
        """Coordinates (T, 2) of size and time of what is `relaxing`, at coordinates x (T, d) of the axes."""
        assert self.relaxing is not None
        out = np.empty((len(x), len(self.relaxing.values)))
        for j, (k, given) in enumerate(zip(self.relaxing.effect.knobs, self.relaxing.values, strict=True)):
            axis = next((n for n, a in enumerate(self.axes) if a.name == k.name), None)
            value = given if axis is None else self.axes[axis].physical(x[:, axis])
            assert value is not None
            out[:, j] = np.log(value) if k.neutral is None and k.logarithmic else np.asarray(value) - (k.neutral or 0.0)
        return out

    @property
    def tied(self) -> int | None:
        """Which axis is the modulus itself."""
        return next((k for k, a in enumerate(self.axes) if a.name == self.modulus), None)

    def moduli(self, x: np.ndarray) -> np.ndarray | None:
        """The modulus (T,) that belongs to coordinates x (T, d); None where it is free there."""
        if self.tied is not None:
            return np.asarray(self.axes[self.tied].physical(x[:, self.tied]))
        return np.full(len(x), self.low) if self.low == self.high else None

    @property
    def centre(self) -> tuple[float, ...]:
        """Middle of the axes that are simulated."""
        return tuple(0.5 * sum(a.ends) for a in self.simulated)


@dataclass(frozen=True)
class Pass:
    """One way of the indenter: loading (peak None) or unloading from `peak`, after an earlier travel there.

    Before unloading it rests for as long as it takes to go `rest` mm on the way there; then it goes `pace` times as
    fast.
    """

    peak: float | None
    earlier: float
    rest: float = 0.0
    pace: float = 1.0


@dataclass(frozen=True)
class Rest:
    """The indenter stays at the travel `peak`, for as long as it takes to go `lasting` mm on the way there."""

    peak: float
    lasting: float

    @property
    def moments(self) -> np.ndarray:
        """When (N_REST_MOMENTS,) in it tables hold forces, from its beginning on, in mm of the way there."""
        return np.append(0.0, self.lasting * np.geomspace(FIRST_REST_MOMENT_SHARE, 1.0, N_REST_MOMENTS - 1))


@dataclass(frozen=True, eq=False)
class LibraryJob:
    """What a task is for: place, effect (None: base), node, pass (None: loading that serves all passes).

    Rests count on after the passes.
    """

    place: int
    effect: str | None
    node: int
    passing: int | None
    task: Task
    finer: bool = False


def passes(plan: TestPlan, place: int) -> tuple[Pass, ...]:
    """The different ways at a place; travels, rests and speeds that are nearly the same count as one."""
    mine = [t for t in plan.tests if t.place == place]
    ways = [Pass(None, plan.near(t.earlier)) for t in mine]
    ways += [Pass(plan.near(t.peak), plan.near(t.earlier), *_resting(t)) for t in mine if t.returns]
    found = [Pass(None, 0.0)]
    for way in ways:
        if not any((way.peak, way.earlier) == (p.peak, p.earlier) and passes_alike(way, p) for p in found):
            found.append(way)
    return tuple(found)


def rests_at(plan: TestPlan, place: int) -> tuple[Rest, ...]:
    """The different rests at a place, each as long as the longest at its travel."""
    longest: dict[float, float] = {}
    for t in plan.tests:
        if t.place == place and t.held.any():
            peak = rounded_travel(t.peak, plan.scale, 2)
            longest[peak] = max(longest.get(peak, 0.0), _round(1.05 * float(t.since.max()) * t.speed))
    return tuple(Rest(peak, lasting) for peak, lasting in sorted(longest.items()) if lasting > 0.0)


def rest_of(every: Sequence[Rest], test: Test) -> int | None:
    """Index of the rest at the travel nearest to that of a test; None where there are none."""
    return min(range(len(every)), key=lambda k: abs(every[k].peak - test.peak), default=None)


def passes_alike(a: Pass, b: Pass) -> bool:
    """Whether the indenter rests as long and goes back as fast."""
    return (
        max(a.rest, b.rest) <= (1 + SAME_PASS_TOLERANCE) * min(a.rest, b.rest)
        and abs(np.log(a.pace / b.pace)) < SAME_PASS_TOLERANCE
    )


def passes_of(every: Sequence[Pass], test: Test) -> tuple[int, int]:
    """Indices of the loading and of the unloading pass of a test."""
    loading = nearest_pass(every, Pass(None, test.earlier))
    back = Pass(test.peak, test.earlier, *_resting(test))
    return loading, nearest_pass(every, back) if test.returns else loading


def _resting(test: Test) -> tuple[float, float]:
    """Rest in mm of the way there, and pace, as round numbers."""
    return _round(test.rest * test.speed), _round(test.pace)


def _round(v: float) -> float:
    return float(f"{np.exp(PASS_ROUNDING_LN * round(np.log(v) / PASS_ROUNDING_LN)):.4g}") if v > 0.0 else 0.0


def nearest_pass(every: Sequence[Pass], way: Pass) -> int:
    """Index of the pass of the same direction that is most alike."""

    def apart(k: int) -> float:
        travel = abs((every[k].peak or 0.0) - (way.peak or 0.0)) + abs(every[k].earlier - way.earlier)
        return travel + abs(np.log((1.0 + every[k].rest) / (1.0 + way.rest))) + abs(np.log(every[k].pace / way.pace))

    return min((k for k, p in enumerate(every) if (p.peak is None) == (way.peak is None)), key=apart)


def knobs_at(base: Base, effect: Effect, at: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Knob values of a node at the reference modulus; times as they are at 1 mm/s."""
    known = {p.name for p in base.backend.parameters}
    pairs = [(size, float(size.value(s))) for size, s in zip(effect.knobs, at, strict=True)]
    return {size.name: v * base.reference**size.exponent for size, v in pairs if size.name in known}


def task_of(
    base: Base,
    plan: TestPlan,
    k: int,
    values: Mapping[str, float],
    way: Pass | None,
    settings: Mapping[str, Any],
    finer: bool = False,
) -> Task:
    """The run at place k: loading, or to and back from the peak of a way; `finer` ones are on the study's mesh."""
    place = plan.places[k]
    data = {**place.settings, **(base.lean if finer else base.draft), **settings}
    if place.marks:
        data["profile"] = [list(m) for m in place.marks]
    deepest, to = plan.reach(k), lambda v: rounded_travel(v, plan.scale, 4)
    asked = {to(deepest * (j / N_ASKED_TRAVELS) ** 1.7) for j in range(1, N_ASKED_TRAVELS)} | {deepest}
    asked = {a for a in asked if all(abs(a - d) > MARK_CLEARANCE_SHARE * d for d in place.mark_depths)} | set(
        place.mark_depths
    )
    if way is None or way.peak is None:
        programme = Programme((0.0, deepest), (0.0, deepest), tuple(sorted(asked)))
    else:  # what relaxes does so at once after the turn
        p = way.peak
        inside = tuple(sorted({a for a in asked if a < 0.78 * p} | {to(f * p) for f in (0.8, 0.92, 0.98, 0.997)}))
        between = [0.5 * (a + b) for a, b in itertools.pairwise((0.0, *inside)) if b < 0.9 * p]
        corners = ((0.0, 0.0), (p, p), *([(p + way.rest, p)] if way.rest else []), (p + way.rest + p / way.pace, 0.0))
        home = [float(f"{corners[-1][0] - v / way.pace:.12g}") for v in between]  # where contact is lost is steep
        time, travel = zip(*corners, strict=True)
        programme = Programme(time, travel, inside, tuple(sorted(home)))
    if way is not None and way.earlier:
        data["earlier"] = way.earlier
    return _tidy(k, values, programme, data)


def _tidy(k: int, values: Mapping[str, float], programme: Programme, data: Mapping[str, Any]) -> Task:
    """The task of a place; equal nodes have equal keys."""
    return Task({name: float(f"{v:.12g}") for name, v in values.items()}, Case(f"place {k}", programme, data))


def task_of_rest(base: Base, plan: TestPlan, k: int, values: Mapping[str, float], rest: Rest, finer: bool) -> Task:
    """The run at place k that presses to the travel of a rest and stays there."""
    data = {**plan.places[k].settings, **(base.lean if finer else base.draft)}
    p = rest.peak
    asked = p + rest.lasting * np.geomspace(FIRST_REST_MOMENT_SHARE, 1.0, N_ASKED_REST_MOMENTS)
    programme = Programme((0.0, p, p + rest.lasting), (0.0, p, p), (p,), tuple(float(f"{v:.12g}") for v in asked))
    return _tidy(k, values, programme, data)


def jobs_of(
    base: Base,
    plan: TestPlan,
    k: int,
    e: Effect | None,
    n: int,
    values: Mapping[str, float],
    every: Sequence[Pass],
    finer: bool = False,
    by_rate: bool | None = None,
) -> list[LibraryJob]:
    """One loading run where the way does not matter, else one run per pass; rest and pace only where times matter.

    Last come those of rests of what flows.  `by_rate` is the answer of :func:`rated` where it is known already.
    """
    name, settings = (None, {}) if e is None else (e.name, e.settings)
    load = task_of(base, plan, k, values, None, settings, finer)
    there_and_back = task_of(base, plan, k, values, Pass(min(1.0, plan.places[k].deepest), 0.0), settings)
    programme = base.backend.canonical(there_and_back.values, there_and_back.case)[1].programme
    if programme.travel_mm[-1] == max(programme.travel_mm):
        return [LibraryJob(k, name, n, None, load)]
    jobs = []
    timely = (e is not None and any(timed(s) for s in e.shape)) or (rated(base, plan) if by_rate is None else by_rate)
    for i, way in enumerate(every):
        way = way if timely else replace(way, rest=0.0, pace=1.0)
        task = task_of(base, plan, k, values, way, settings, finer)
        if "earlier" in task.case.settings:  # what does not soften shares the virgin run
            plain = base.backend.canonical(task.values, task.case)[1].settings
            virgin = replace(task.case, settings={a: b for a, b in task.case.settings.items() if a != "earlier"})
            if plain == base.backend.canonical(task.values, virgin)[1].settings:
                task = replace(task, case=virgin)
        jobs.append(LibraryJob(k, name, n, i, task))
    for i, rest in enumerate(rests_at(plan, k) if e is not None and e.flows else ()):
        jobs.append(LibraryJob(k, name, n, len(every) + i, task_of_rest(base, plan, k, values, rest, finer)))
    return jobs


def jobs_at(
    base: Base,
    plan: TestPlan,
    k: int,
    e: Effect,
    x: Sequence[float] | np.ndarray,
    at: Sequence[float] | np.ndarray,
    ways: Sequence[Pass],
    finer: bool,
) -> list[Task]:
    """Runs of an effect at size and shapes `at`, base coordinates `x`: one, or one per pass where the way matters, and
    of what flows those of rests.

    `finer` ones are on the study's mesh.
    """
    values = {**base.values(x), **knobs_at(base, e, at)}
    return [j.task for j in jobs_of(base, plan, k, e, 0, values, ways, finer)]


def rated(base: Base, plan: TestPlan) -> bool:
    """Whether what is simulated of the base depends on the rate: it relaxes, or an effect that is on has a time."""
    task, asked = task_of(base, plan, 0, base.values(base.centre), None, {}), capability(base.backend, Relaxation)
    if asked is not None and asked.relaxes(task.values, task.case.settings):
        return True
    kept = base.backend.canonical(task.values, task.case)[0]
    on = {p.group for p in base.backend.parameters if p.group and p.neutral is not None and p.name in kept}
    return any(p.unit == "s" and p.group in on for p in base.backend.parameters)
