"""What was measured, as tests in bins: the part of a data set that does not depend on the values measured.

A test is one recorded curve (a repeat).  Readings are averaged in bins along each branch; a place is where the indenter
was pressed, with all settings of the backend.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from rso.contract import digest
from rso.contract.responses import FORCE_CHANNELS
from rso.core.power_law import LEADING_EXPONENT
from rso.data import Measurement, Noise, Repeat, kept, without_spikes
from rso.data.force_holds import HeldForce
from rso.data.holds import N_HOLD_BINS, at_peak, edges, stop_time
from rso.data.loading_rate import dwell_time, unloading_pace

N_APPROACH_BINS = 3  # bins of the way before contact
LOADING_BRANCH, UNLOADING_BRANCH, HELD_BRANCH = range(3)  # branches of a test
# mm: lengths below are those of a plan this deep or up to twice; others have theirs in proportion
USUAL_PLAN_DEPTH_MM = 3.25
PLAN_DEPTH_STEP_MM = 0.25  # mm, to which the deepest travel is rounded up: data sets of one plan share their library
MIN_UNLOADING_SHARE = 0.1  # of the deepest travel: a way back that ends earlier is left out
NOT_USED_NOTE = "are not used"
ASSUMED_TIMES_NOTE = "as no file and no setting says it; sizes in seconds go with it"
REACH_MARGIN_MM = 0.4  # mm beyond the deepest record, for a contact found late
Role = Literal["fit", "select", "validate"]


@dataclass(frozen=True)
class Experiment:
    """One measured file and what is known about it; `speed` mm/s of loading, `after` the experiments before it.

    `power` is the exponent of force over small depths of its indenter.
    """

    name: str
    role: Role
    measurement: Measurement
    noise: Noise
    channels: tuple[str, ...]
    settings: Mapping[str, Any]
    speed: float
    mounting: str = "A"
    after: tuple[str, ...] = ()
    power: float = LEADING_EXPONENT


@dataclass(frozen=True)
class PlanPlace:
    """Settings of the backend, the deepest travel asked there, peaks of load–unload tests, and marks of profiles."""

    settings: Mapping[str, Any]
    deepest: float
    peaks: tuple[float, ...]
    marks: tuple[tuple[float, float], ...] = ()
    mark_depths: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Test:
    """One recorded test in bins: `branch` LOADING_BRANCH, UNLOADING_BRANCH or HELD_BRANCH at the deepest point;
    `earlier` is the deepest travel there before.

    `age` is where it stands in the order of testing, −1/2 the first and 1/2 the last.  `depth`, `time`, `count` (n,):
    the depth that has the mean force of the readings of a bin, when it was there (from the first reading on),
    and their number; `since` (n,) s is the time since the indenter came to rest, 0 while it moves.  Before the
    unloading it rests for `rest` s, and goes `pace` times as fast as on the way there.
    """

    experiment: int
    label: str
    place: int
    speed: float
    peak: float
    earlier: float
    channels: tuple[str, ...]
    depth: np.ndarray
    time: np.ndarray
    branch: np.ndarray
    count: np.ndarray
    values: Mapping[str, np.ndarray]
    age: float = 0.0
    since: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rest: float = 0.0
    pace: float = 1.0

    def __post_init__(self) -> None:
        if not len(self.since):
            object.__setattr__(self, "since", np.zeros(len(self.depth)))

    @property
    def n(self) -> int:
        """Bins."""
        return len(self.depth)

    @property
    def returns(self) -> bool:
        """Whether the unloading was recorded."""
        return bool(np.any(self.branch == UNLOADING_BRANCH))

    @property
    def held(self) -> np.ndarray:
        """(n,) whether the indenter rests."""
        return self.branch == HELD_BRANCH


@dataclass(frozen=True, eq=False)
class SurfaceProfile:
    """Displacements of surface marks: `depth`, `mark` (index into the marks of the place) and `value`, each (n,)."""

    experiment: int
    place: int
    channel: str
    depth: np.ndarray
    mark: np.ndarray
    value: np.ndarray


@dataclass(frozen=True, eq=False)
class TestPlan:
    """Experiments, places, tests and profiles, and the layout of the data vector: rows of each (test, channel).

    `scale` is what lengths are measured by, see :func:`scale_of`.
    """

    experiments: tuple[Experiment, ...]
    places: tuple[PlanPlace, ...]
    tests: tuple[Test, ...]
    profiles: tuple[SurfaceProfile, ...]
    notes: tuple[str, ...] = ()
    scale: float = 1.0

    @property
    def n(self) -> int:
        """Length of the data vector."""
        return sum(t.n * len(t.channels) for t in self.tests) + sum(len(p.depth) for p in self.profiles)

    def reach(self, place: int) -> float:
        """Travel (mm) to which a place is computed."""
        return self.places[place].deepest + self.scale * REACH_MARGIN_MM

    @property
    def times(self) -> tuple[float, float]:
        """The shortest time (s) of loading, and the longest that a test lasted."""
        return min(t.peak / t.speed for t in self.tests), max(float(t.time.max()) for t in self.tests)

    def near(self, travel: float) -> float:
        """A travel (mm) as a round number that others like it share."""
        return rounded_travel(travel, self.scale, 1)

    def rows(self) -> list[tuple[Test | SurfaceProfile, str, slice]]:
        """(test or profile, channel, rows) in the order of the data vector."""
        found: list[tuple[Test | SurfaceProfile, str, slice]] = []
        at = 0
        for t in self.tests:
            for c in t.channels:
                found.append((t, c, slice(at, at + t.n)))
                at += t.n
        for p in self.profiles:
            found.append((p, p.channel, slice(at, at + len(p.depth))))
            at += len(p.depth)
        return found

    def labels(self) -> dict[str, Mapping[str, Any]]:
        """Settings of every place with tests, by a name: its point where no other has it, else the first test there."""
        first = {t.place: self.experiments[t.experiment].name for t in reversed(self.tests)}
        points = {k: tuple(map(str, self.places[k].settings.get("point") or ())) for k in sorted(first)}
        own = {k: len(v) > 0 and list(points.values()).count(v) == 1 for k, v in points.items()}
        short = {k: f"({', '.join(v.removesuffix('.0') for v in p)})" for k, p in points.items()}
        return {short[k] if own[k] else first[k]: self.places[k].settings for k in points}

    def seen(self) -> TestPlan:
        """The plan without what is kept for validation; places stay."""
        keep = {k for k, e in enumerate(self.experiments) if e.role != "validate"}
        tests = tuple(t for t in self.tests if t.experiment in keep)
        profiles = tuple(p for p in self.profiles if p.experiment in keep)
        return replace(self, tests=tests, profiles=profiles)

    def values(self) -> np.ndarray:
        """The data vector (n,)."""
        parts = [o.values[c] if isinstance(o, Test) else o.value for o, c, _ in self.rows()]
        return np.concatenate(parts)


@dataclass
class _Site:
    """What gathers at a place while a plan is made; `index` is its number."""

    index: int
    settings: Mapping[str, Any]
    deepest: float = 0.0
    peaks: set[float] = field(default_factory=set)
    marks: dict[tuple[float, float], int] = field(default_factory=dict)
    mark_depths: set[float] = field(default_factory=set)

    def place(self, scale: float) -> PlanPlace:
        """The place when all is gathered."""
        step = scale * PLAN_DEPTH_STEP_MM
        deepest = rounded_travel(max(math.ceil(self.deepest / step - 0.2), 1) * step, scale, 6)
        peaks = {rounded_travel(v, scale, 1) for v in self.peaks}
        return PlanPlace(
            self.settings, deepest, tuple(sorted(peaks)), tuple(self.marks), tuple(sorted(self.mark_depths))
        )


def scale_of(deepest: float) -> float:
    """Lengths of a plan with this deepest travel (mm) over those of one of 3.25 to 6.5 mm.

    Where contact was, how travels are rounded and what counts as equally deep are shares of the travel; as round
    numbers, 1, 2 or 4 times a power of 10, so that data sets of one plan have the same.
    """
    ratio = deepest / USUAL_PLAN_DEPTH_MM
    power = 10.0 ** math.floor(math.log10(ratio))
    return float(f"{power * max(n for n in (1, 2, 4) if n * power <= ratio * (1 + 1e-12) or n == 1):.1g}")


def rounded_travel(travel: float, scale: float, digits: int) -> float:
    """A travel (mm) to so many digits after the point in units of `scale`, without the dust of the product."""
    return float(f"{round(travel / scale, digits) * scale:.12g}")


def make_test_plan(experiments: Sequence[Experiment], scale: float | None = None) -> TestPlan:
    """Tests in bins, places with what must be computed there; lengths of `scale`, or of the plan's own.

    ValueError if no force curve is left.  The unloading after a long hold is left out with a note, as it depends on all
    that relaxed before, and so is a hold without times or elsewhere than at the deepest point.
    """
    sites: dict[str, _Site] = {}
    notes: list[str] = []
    experiments = [_without_spikes(e, notes) for e in experiments]
    order = _in_order(experiments)
    tests = [t for k in order for t in _tests(k, experiments[k], sites, notes)]
    if not tests:
        raise ValueError("no force curve with fit or select readings: nothing to diagnose")
    profiles = [p for k in order for p in _profiles(k, experiments[k], sites, notes)]
    aged = tuple(replace(t, age=k / (len(tests) - 1) - 0.5) for k, t in enumerate(tests)) if tests[1:] else tuple(tests)
    scale = scale or scale_of(max(site.deepest for site in sites.values()))
    places = tuple(site.place(scale) for site in sites.values())
    return TestPlan(tuple(experiments), places, aged, tuple(profiles), tuple(dict.fromkeys(notes)), scale)


def _site(settings: Mapping[str, Any], sites: dict[str, _Site]) -> _Site:
    """Where an experiment was made: all its settings but for those of a single test."""
    plain = {k: v for k, v in settings.items() if k not in ("speed", "unload", "earlier")}
    return sites.setdefault(digest(plain), _Site(len(sites), plain))


def _tests(k: int, e: Experiment, sites: dict[str, _Site], notes: list[str]) -> Iterator[Test]:
    """The tests of force experiment k in bins, each after what was done at its place before."""
    if e.measurement.kind != "force":
        return
    site = _site(e.settings, sites)
    for r in e.measurement.repeats:
        r, without = _usable(r)
        notes += [f"{e.name}: {words} {NOT_USED_NOTE}" for words in without]
        if not len(r.depth):
            continue
        if r.depth.max() <= 0.0:
            raise ValueError(f"{e.name}: repeat {r.label!r} never gets deeper than 0 mm; depth counts from contact")
        channels = tuple(c for c in FORCE_CHANNELS if c in r.channels and c in e.channels)
        time = _times(r.depth, e.speed) if r.time is None else r.time
        time = time - (_touched(r, time) if r.tared else time[0])
        came = stop_time(r, time, e.speed)
        branches = [
            _binned(r, time, channels, b, came, e.power) for b in (LOADING_BRANCH, UNLOADING_BRANCH, HELD_BRANCH)
        ]
        d, t, b, m, values = (_joined(branches, i, channels) for i in range(5))
        peak = float(r.depth.max())
        since = np.where(b == HELD_BRANCH, t - came, 0.0)
        yield Test(
            k,
            r.label,
            site.index,
            e.speed,
            peak,
            site.deepest,
            channels,
            d,
            t,
            b,
            m,
            values,
            since=since,
            rest=dwell_time(r, e.speed),
            pace=unloading_pace(r, e.speed),
        )
        site.deepest = max(site.deepest, peak)
        if np.any(b == UNLOADING_BRANCH):
            site.peaks.add(peak)


def _profiles(k: int, e: Experiment, sites: dict[str, _Site], notes: list[str]) -> Iterator[SurfaceProfile]:
    """The profiles of experiment k; their marks and depths gather at its place."""
    if e.measurement.kind == "force":
        return
    site = _site(e.settings, sites)
    for r in e.measurement.repeats:
        if np.any(r.depth <= 0.0):
            notes.append(f"{e.name}: {np.sum(r.depth <= 0.0)} displacements at no depth are not used")
            r = kept(r, r.depth > 0.0)
        keys = [(float(x), float(y)) for x, y in zip(r.channels["x"], r.channels["y"], strict=True)]
        mark = np.array([site.marks.setdefault(m, len(site.marks)) for m in keys])
        for c in e.channels:
            yield SurfaceProfile(k, site.index, c, r.depth, mark, r.channels[c])
        site.mark_depths |= {float(v) for v in r.depth}
        site.deepest = max(site.deepest, float(r.depth.max()))


def _usable(r: Repeat) -> tuple[Repeat, list[str]]:
    """A repeat without what no model here follows, and words for what is missing.

    That is a hold without times or elsewhere than between loading and unloading, the unloading after one without times,
    and an unloading that is hardly one.
    """
    depth, back = r.depth, r.segment == "unloading"
    begun: list[str] = []
    if isinstance(r.creep, HeldForce):
        begun.append(
            f"{len(r.creep.depth)} readings of creep at a held force (forces at travels are diagnosed; rso run and rso "
            "ladder compare the creep)"
        )
    if back.any() and (np.sum(back) < 3 or depth.max() - depth[back].min() < MIN_UNLOADING_SHARE * depth.max()):
        r = kept(r, ~back)
        begun.append(f"{np.sum(back)} readings of an unloading that has hardly begun")
    back, held = (np.nonzero(r.segment == s)[0] for s in ("unloading", "hold"))
    if not len(held):
        return r, begun
    resting = at_peak(r)
    timed, without = r.time is not None, begun
    lost = held if not timed else np.setdiff1d(held, resting)
    if len(lost):
        without.append(f"{len(lost)} readings of a hold {'elsewhere' if timed else 'without times'}")
    if len(resting) and len(back) and not timed:
        lost = np.concatenate([lost, back])
        without.append(f"{len(back)} readings of the unloading after a hold")
    return kept(r, ~np.isin(np.arange(len(r.segment)), lost)), without


def _in_order(experiments: Sequence[Experiment]) -> list[int]:
    """Indices in the order of testing: an experiment comes after those it names, else as listed."""
    names = {e.name: k for k, e in enumerate(experiments)}
    done: list[int] = []

    def visit(k: int, above: tuple[int, ...]) -> None:
        if k in above:
            raise ValueError(f"experiment {experiments[k].name!r} comes after itself")
        if k not in done:
            for other in experiments[k].after:
                if other in names:
                    visit(names[other], (*above, k))
            done.append(k)

    for k in range(len(experiments)):
        visit(k, ())
    return done


def _touched(r: Repeat, time: np.ndarray) -> float:
    """When (s) loading passes the zero of its depth: a force that was tared there has drifted since then alone."""
    there = r.segment == "loading"
    return float(np.interp(0.0, np.maximum.accumulate(r.depth[there]), time[there])) if there.any() else float(time[0])


def _times(depth: np.ndarray, speed: float) -> np.ndarray:
    """Times (s) of readings at a constant speed there and back."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.abs(np.diff(depth)), 1e-9))]) / speed


def _without_spikes(e: Experiment, notes: list[str]) -> Experiment:
    """The experiment without single readings that jump out of line, with notes of these and of what is doubtful."""
    measurement, left_out = without_spikes(e.measurement)
    notes += [f"{e.name}, {words}" for words in (*e.measurement.doubts, *left_out)]
    return replace(e, measurement=measurement)


def _binned(
    r: Repeat, time: np.ndarray, channels: tuple[str, ...], branch: int, came: float, power: float
) -> tuple[Any, ...]:
    """Depth, time, branch, count and values of one branch, averaged over runs of readings: at most N_HOLD_BINS, even in
    depth, while the indenter presses, N_APPROACH_BINS before it does so, and even in the logarithm of time since it
    `came` to rest (s).
    """
    at = np.nonzero(r.segment == ("loading", "unloading", "hold")[branch])[0]
    if branch == HELD_BRANCH:
        since = time[at] - came
        groups = np.split(at, np.searchsorted(since, edges(since)))
    else:
        way = at if branch == LOADING_BRANCH else at[::-1]
        u = np.maximum.accumulate(r.depth[way]) if len(at) else r.depth[way]
        air, way = way[: np.sum(u < 0.0)], way[np.sum(u < 0.0) :]
        u = u[len(air) :]
        ends = np.linspace(0.0, u[-1], N_HOLD_BINS + 1)[1:-1] if len(way) > N_HOLD_BINS else u
        groups = [
            *np.array_split(air, min(N_APPROACH_BINS, len(air)) or 1),
            *np.split(way, np.searchsorted(u, ends, side="left")),
        ]
        groups = groups if branch == LOADING_BRANCH else groups[::-1]
    groups = [g for g in groups if len(g)]
    mean = lambda v: np.array([v[g].mean() for g in groups])  # noqa: E731
    count = np.array([len(g) for g in groups], float)
    depth = np.array([_depth_of_mean(r.depth[g], power) for g in groups])
    went = r.depth[at[-1]] - r.depth[at[0]] if len(at) else 0.0
    pace = (time[at[-1]] - time[at[0]]) / went if went and branch != HELD_BRANCH else 0.0
    times = mean(time) + pace * (depth - mean(r.depth))  # when the indenter was there
    return depth, times, np.full(len(groups), branch), count, {c: mean(r.channels[c]) for c in channels}


def _depth_of_mean(u: np.ndarray, power: float) -> float:
    """Depth (mm) that has the mean of the forces at the depths u (n,), F ~ u^power; the mean of them in the air.

    At the mean depth the force is less, in a first bin of many readings by an eighth.
    """
    return float(np.mean(np.maximum(u, 0.0) ** power) ** (1.0 / power)) if u.mean() > 0.0 else float(u.mean())


def _joined(branches: Sequence[tuple[Any, ...]], i: int, channels: tuple[str, ...]) -> Any:
    if i == 4:
        return {c: np.concatenate([b[4][c] for b in branches]) for c in channels}
    return np.concatenate([b[i] for b in branches])
