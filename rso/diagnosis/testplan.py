"""What was measured, as tests in bins: the part of a data set that does not depend on the values measured.

A test is one recorded curve (a repeat).  Readings are averaged in bins along each branch; a place is where the indenter
was pressed, with everything the backend was told about it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.ndimage import median_filter

from rso.contract import digest
from rso.measurement import Measurement, Noise, Repeat

BINS = 14  # per branch: what a smooth curve can tell
STEP = 0.25  # mm, to which the deepest travel is rounded up: data sets of one plan share their library
SPIKE = 8.0  # robust standard deviations from its neighbours: no reading of its own
MOST_SPIKES = 0.2  # of the readings: more of them are no spikes but the signal
DWELL = 0.05  # of the time of loading: after a longer hold what relaxes has done so before the way back
MARGIN = 0.4  # mm beyond the deepest record, for a contact found late
Role = Literal["fit", "select", "validate"]


@dataclass(frozen=True)
class Experiment:
    """One measured file and what is known about it; `speed` mm/s of loading, `after` the experiments before it."""

    name: str
    role: Role
    measurement: Measurement
    noise: Noise
    channels: tuple[str, ...]
    settings: Mapping[str, Any]
    speed: float
    mounting: str = "A"
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Place:
    """Settings of the backend, the deepest travel asked there, peaks of load–unload tests, and marks of profiles."""

    settings: Mapping[str, Any]
    deepest: float
    peaks: tuple[float, ...]
    marks: tuple[tuple[float, float], ...] = ()
    mark_depths: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Test:
    """One recorded test in bins: `branch` 0 loading, 1 unloading; `earlier` is the deepest travel there before.

    `age` is where it stands in the order of testing, −1/2 the first and 1/2 the last.  `depth`, `time`, `count` (n,):
    mean depth and time of the readings of a bin and their number.
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

    @property
    def n(self) -> int:
        """Bins."""
        return len(self.depth)


@dataclass(frozen=True, eq=False)
class Profile:
    """Displacements of surface marks: `depth`, `mark` (index into the marks of the place) and `value`, each (n,)."""

    experiment: int
    place: int
    channel: str
    depth: np.ndarray
    mark: np.ndarray
    value: np.ndarray


@dataclass(frozen=True, eq=False)
class TestPlan:
    """Experiments, places, tests and profiles, and the layout of the data vector: rows of each (test, channel)."""

    experiments: tuple[Experiment, ...]
    places: tuple[Place, ...]
    tests: tuple[Test, ...]
    profiles: tuple[Profile, ...]
    notes: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Length of the data vector."""
        return sum(t.n * len(t.channels) for t in self.tests) + sum(len(p.depth) for p in self.profiles)

    def rows(self) -> list[tuple[Test | Profile, str, slice]]:
        """(test or profile, channel, rows) in the order of the data vector."""
        found, at = [], 0
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


def make_plan(experiments: Sequence[Experiment]) -> TestPlan:
    """Tests in bins, places with what must be computed there.

    ValueError if no force curve is left.  Holds are left out with a note, and so is the way back after a long one: they
    carry relaxation, which the loading and unloading at other speeds shows as well.
    """
    places: list[dict[str, Any]] = []
    index: dict[str, int] = {}
    tests: list[Test] = []
    notes: list[str] = []
    experiments = [_without_spikes(e, notes) for e in experiments]

    def place_of(settings: Mapping[str, Any]) -> int:
        plain = {k: v for k, v in settings.items() if k not in ("speed", "unload", "earlier")}
        key = digest(plain)
        if key not in index:
            index[key] = len(places)
            places.append({"settings": plain, "deepest": 0.0, "peaks": set(), "marks": {}, "mark_depths": set()})
        return index[key]

    reached: dict[int, float] = {}
    order = _in_order(experiments)
    for k in order:
        e = experiments[k]
        if e.measurement.kind != "force":
            continue
        at = place_of(e.settings)
        for r in e.measurement.repeats:
            held = r.segment == "hold"
            if held.any():
                r, after = _before_hold(r)
                notes.append(f"{e.name}: {held.sum()} readings of a hold{after} are not used")
            channels = tuple(c for c in ("Fx", "Fy", "Fz") if c in r.channels and c in e.channels)
            time = r.time if r.time is not None else _times(r.depth, r.segment, e.speed)
            branches = [_binned(r, time, channels, name, k) for k, name in enumerate(("loading", "unloading"))]
            d, t, b, m, values = (_joined(branches, i, channels) for i in range(5))
            peak = float(r.depth.max())
            tests.append(Test(k, r.label, at, e.speed, peak, reached.get(at, 0.0), channels, d, t, b, m, values))
            reached[at] = max(reached.get(at, 0.0), peak)
            places[at]["deepest"] = max(places[at]["deepest"], peak)
            if np.any(b == 1):
                places[at]["peaks"].add(round(peak, 1))
    if not tests:
        raise ValueError("no force curve with fit or select readings: nothing to diagnose")
    profiles = []
    for k in order:
        e = experiments[k]
        if e.measurement.kind == "force":
            continue
        at = place_of(e.settings)
        for r in e.measurement.repeats:
            marks = places[at]["marks"]
            keys = [(float(x), float(y)) for x, y in zip(r.channels["x"], r.channels["y"], strict=True)]
            mark = np.array([marks.setdefault(m, len(marks)) for m in keys])
            for c in e.channels:
                profiles.append(Profile(k, at, c, r.depth, mark, r.channels[c]))
            places[at]["mark_depths"] |= {float(v) for v in r.depth}
            places[at]["deepest"] = max(places[at]["deepest"], float(r.depth.max()))
    made = tuple(
        Place(p["settings"], math.ceil(p["deepest"] / STEP - 0.2) * STEP, tuple(sorted(p["peaks"])), tuple(p["marks"]),
              tuple(sorted(p["mark_depths"]))) for p in places
    )  # fmt: skip
    aged = tuple(replace(t, age=k / (len(tests) - 1) - 0.5) for k, t in enumerate(tests)) if tests[1:] else tuple(tests)
    return TestPlan(tuple(experiments), made, aged, tuple(profiles), tuple(dict.fromkeys(notes)))


def _before_hold(r: Repeat) -> tuple[Repeat, str]:
    """A repeat without the way back after a hold longer than DWELL, and words for what is missing.

    A hold without times counts as long; one that is not between loading and unloading does not count.
    """
    there, back = (np.nonzero(r.segment == s)[0] for s in ("loading", "unloading"))
    if not len(there) or not len(back) or "hold" not in r.segment[there[-1] : back[0]]:
        return r, ""
    if r.time is not None and r.time[back[0]] - r.time[there[-1]] < DWELL * np.ptp(r.time[there]):
        return r, ""
    return _kept(r, r.segment != "unloading"), f" and {len(back)} of the way back after it"


def _kept(r: Repeat, keep: np.ndarray) -> Repeat:
    """The readings of a repeat in a mask (n,)."""
    parts = {k: {c: v[keep] for c, v in getattr(r, k).items()} for k in ("channels", "sigma")}
    time = None if r.time is None else r.time[keep]
    return replace(r, depth=r.depth[keep], time=time, segment=r.segment[keep], **parts)


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


def _times(depth: np.ndarray, segment: np.ndarray, speed: float) -> np.ndarray:
    """Times (s) of readings at a constant speed there and back."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.abs(np.diff(depth)), 1e-9))]) / speed


def _without_spikes(e: Experiment, notes: list[str]) -> Experiment:
    """The experiment without single readings that jump out of line, each repeat that has some with a note."""
    if e.measurement.kind != "force":
        return e
    repeats = []
    for r in e.measurement.repeats:
        wild = _wild(r)
        if wild.any():
            depths = ", ".join(f"{v:.2f}" for v in r.depth[wild][:3]) + (", …" if wild.sum() > 3 else "")
            notes.append(f"{e.name}, repeat {r.label}: {wild.sum()} reading(s) out of line left out, at {depths} mm")
            r = _kept(r, ~wild)
        repeats.append(r)
    return replace(e, measurement=replace(e.measurement, repeats=tuple(repeats)))


def _wild(r: Any) -> np.ndarray:
    """Readings that stand alone: further than SPIKE standard deviations from the median of the five around them.

    The deviation is a robust one of the branch itself, 1.48 times the median of its third differences; jumps and slopes
    pass, single spikes do not (Hampel 1974).
    """
    wild = np.zeros(len(r.depth), bool)
    for name in ("loading", "unloading"):
        at = np.nonzero(r.segment == name)[0]
        if len(at) < 12:
            continue
        for c in r.channels:
            v = r.channels[c][at]
            d = np.abs(v - median_filter(v, 5, mode="nearest"))
            scatter = 1.48 * np.median(np.abs(np.diff(v, 3))) / math.sqrt(20.0)  # variance of a third difference
            wild[at[d > SPIKE * max(scatter, 1e-4 * np.median(np.abs(v)))]] = True
    return wild if wild.mean() < MOST_SPIKES else np.zeros(len(wild), bool)


def _binned(r: Any, time: np.ndarray, channels: tuple[str, ...], segment: str, k: int) -> tuple[Any, ...]:
    """Depth, time, branch, count and values of one branch, averaged over at most BINS runs of equally many readings."""
    at = np.nonzero(r.segment == segment)[0]
    groups = [g for g in np.array_split(at, min(BINS, len(at)) or 1) if len(g)]
    mean = lambda v: np.array([v[g].mean() for g in groups])  # noqa: E731
    count = np.array([len(g) for g in groups], float)
    return mean(r.depth), mean(time), np.full(len(groups), k), count, {c: mean(r.channels[c]) for c in channels}


def _joined(branches: Sequence[tuple[Any, ...]], i: int, channels: tuple[str, ...]) -> Any:
    if i == 4:
        return {c: np.concatenate([b[4][c] for b in branches]) for c in channels}
    return np.concatenate([b[i] for b in branches])
