"""Tests that could be done next: other rates, ways and places, again without an effect, with more channels or marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rso.contract import FurtherTests, PreventableEffects, SurfaceMarks, capability
from rso.data import Measurement, Repeat
from rso.discrepancy.evidence import noise
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.planning import framed, planned_simulations
from rso.discrepancy.library.simulations import Base, LibraryJob, passes, passes_alike, rated, rests_at
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import Experiment, Test, TestPlan, make_test_plan

N_PROPOSED_READINGS = 20  # of a branch, and of a hold
N_PROPOSED_REPEATS = 3  # of a proposed test: what each has for itself averages out
MAX_PROPOSED_DEPTH_MM = 4.0  # mm to which a test is proposed at most, in a plan of the usual depth
SAME_TURN_MM = 0.3  # mm between turns that count as one, in such a plan
PROPOSED_HOLD_RATIO = 20.0  # of the time of loading: how long a hold is proposed to last


@dataclass(frozen=True)
class CandidateTest:
    """A test to be simulated; knobs in `without` are kept from acting in it."""

    words: str
    experiments: tuple[Experiment, ...]
    without: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Outline:
    """What of a library is known before any simulation, enough to name candidates."""

    base: Base
    plan: TestPlan
    primary: int
    effects: tuple[Effect, ...]


def planned_tests(base: Base, plan: TestPlan, effects: Sequence[Effect]) -> dict[str, tuple[list[LibraryJob], float]]:
    """Candidate test → the simulations that it takes under every effect, and the share of them under two alone.

    Those that a library shows without are left out.
    """
    outline = Outline(base, plan, framed(base, plan).primary, tuple(effects))
    modelled = [e for e in effects if e.family == "model"]
    found = {}
    for candidate in proposed_tests(outline):
        try:
            there = make_test_plan(candidate.experiments, plan.scale)
            there = replace(there, tests=tuple(test_after_plan(plan, there, t) for t in there.tests))
            if tables_cover(outline, there):
                continue
            jobs = planned_simulations(base, there, effects)  # those of the base model first
        except ValueError:
            continue
        own = (None, base.relaxing.effect.name if base.relaxing else None)
        without = sum(j.effect in own for j in jobs)
        under_all = len(jobs) - without
        each = under_all / max(len(modelled), 1)
        found[candidate.words] = jobs, (without + min(2.0 * each, under_all)) / max(len(jobs), 1)
    return found


def proposed_tests(library: Library | Outline) -> list[CandidateTest]:
    """Tests that are not in the plan yet: other rates, unloading and a hold at a known place, what the backend
    proposes."""
    plan = library.plan
    template = plan.experiments[next(t.experiment for t in plan.tests if t.place == library.primary)]
    place = plan.places[library.primary]
    speeds = [t.speed for t in plan.tests if t.place == library.primary]
    has_unload = any(t.returns for t in plan.tests if t.place == library.primary)
    has_hold = any(t.held.any() for t in plan.tests)
    most = MAX_PROPOSED_DEPTH_MM * plan.scale
    d = min(place.deepest, most)
    template = replace(template, channels=_measured(plan))  # a cell of one axis stays one
    out = []
    if not has_unload:
        out.append(CandidateTest("load and unload at the same point", (_experiment(template, d, speeds[0], True),)))
    for factor, word in ((10.0, "ten times faster"), (0.1, "ten times slower")):
        v = factor * (max(speeds) if factor > 1 else min(speeds))
        words = f"load and unload {word} ({60 * v:.3g} mm/min)"
        out.append(CandidateTest(words, (_experiment(template, d, v, True),)))
    if not (has_hold or rated(library.base, plan)):
        words = f"load at {60 * max(speeds):.3g} mm/min and hold for {PROPOSED_HOLD_RATIO:g} times as long"
        out.append(CandidateTest(words, (_experiment(template, d, max(speeds), False, rest=PROPOSED_HOLD_RATIO),)))
    backend = library.base.backend
    others, marked = capability(backend, FurtherTests), capability(backend, SurfaceMarks)
    for words, settings in others.tests(dict(place.settings)).items() if others else ():
        other = replace(template, settings={**template.settings, **settings})
        out.append(CandidateTest(words, (_experiment(other, d, speeds[0], True),)))
    tests = {t.place: t for t in plan.tests}
    for label, settings in plan.labels().items() if len(plan.places) > 1 else ():
        k = next(k for k, p in enumerate(plan.places) if p.settings == settings)
        there = next(t.experiment for t in plan.tests if t.place == k)
        own = replace(plan.experiments[there], channels=template.channels)
        again = _experiment(own, min(plan.places[k].deepest, most), speeds[0], False)
        moved = frozenset(e.name for e in library.effects if e.place == settings and len(e.size.ends()) == 2)
        if moved:
            out.append(CandidateTest(f"the test at {label} again, its place looked at", (again,), moved))
    missing = [c for c in noise.FORCE_CHANNELS if c not in template.channels]
    for label, settings in plan.labels().items() if missing else ():
        k = next(k for k, p in enumerate(plan.places) if p.settings == settings)
        there = next(t.experiment for t in plan.tests if t.place == k)
        more = replace(plan.experiments[there], channels=noise.FORCE_CHANNELS)
        again = _experiment(more, min(plan.places[k].deepest, most), speeds[0], False)
        out.append(CandidateTest(f"the test at {label} again, with {' and '.join(missing)} measured", (again,)))
    for words, marks in marked.marks(dict(place.settings)).items() if marked else ():
        if not _seen(marks, place.marks):
            load = _experiment(template, d, speeds[0], False)
            out.append(CandidateTest(words, (load, _profile(template, marks, (0.5 * d, d)))))
    without = capability(backend, PreventableEffects)
    for words, knobs in without.prevented().items() if without else ():
        each = [
            replace(plan.experiments[t.experiment], name=f"again {k}", channels=template.channels)
            for k, t in tests.items()
        ]
        every = [
            _experiment(e, min(plan.places[k].deepest, most), speeds[0], _turned(plan, k), e.name)
            for k, e in zip(tests, each, strict=True)
        ]
        out.append(CandidateTest(words, tuple(every), frozenset(knobs)))
    return out


def test_after_plan(done: TestPlan, plan: TestPlan, test: Test) -> Test:
    """A test of another plan as it is when all tests of a plan are done: last, at places that they pressed."""
    settings = plan.places[test.place].settings
    pressed = [t.peak for t in done.tests if done.places[t.place].settings == settings]
    return replace(test, age=0.5, earlier=max([test.earlier, *pressed]))


def tables_cover(library: Library | Outline, plan: TestPlan) -> bool:
    """Whether a plan can be read off the tables: its places are the library's, its turns near theirs, as are rests and
    speeds of ways back, no new marks."""
    own = _places(library, plan)
    return (
        not plan.profiles
        and own is not None
        and all(_rested(library, plan, j, k) for j, k in enumerate(own))
        and all(
            not p.peaks
            or any(abs(v - q) < SAME_TURN_MM * plan.scale for v in p.peaks for q in library.plan.places[k].peaks)
            for p, k in zip(plan.places, own, strict=True)
        )
        and all(
            way.peak is None or any(p.peak is not None and passes_alike(way, p) for p in passes(library.plan, k))
            for j, k in enumerate(own)
            for way in passes(plan, j)
        )
    )


def _rested(library: Library | Outline, plan: TestPlan, place: int, own: int) -> bool:
    """Whether the rests of what flows at a place of a plan are those of the library's `own`, or parts of them."""
    if not any(e.flows for e in library.effects):
        return True
    known = rests_at(library.plan, own)
    return all(
        any(abs(r.peak - v.peak) < SAME_TURN_MM * plan.scale and v.lasting <= r.lasting for r in known)
        for v in rests_at(plan, place)
    )


def at_library_places(library: Library, plan: TestPlan) -> TestPlan:
    """The new tests of a :func:`tables_cover` plan at the library's own places."""
    own = _places(library, plan)
    assert own is not None  # the plan is known
    tests = tuple(replace(t, place=own[t.place]) for t in plan.tests)
    return replace(library.plan, experiments=plan.experiments, tests=tests, profiles=())


def _measured(plan: TestPlan) -> tuple[str, ...]:
    """Components of the force that the laboratory can measure: those that some test has."""
    return tuple(c for c in noise.FORCE_CHANNELS if any(c in t.channels for t in plan.tests))


def _experiment(
    template: Experiment, depth: float, speed: float, unload: bool, name: str = "next test", rest: float = 0.0
) -> Experiment:
    """A test as it would be recorded in the template's channels, with no values in it; at the end held for `rest` times
    the time of loading."""
    u = np.linspace(0.0, depth, N_PROPOSED_READINGS + 1)[1:]
    way = np.concatenate([u, u[-2::-1]]) if unload else u
    segment = np.array(["loading"] * len(u) + ["unloading"] * (len(way) - len(u)))
    time = np.cumsum(np.abs(np.diff(np.concatenate([[0.0], way])))) / speed
    if rest:
        way, segment = (
            np.append(way, np.full(N_PROPOSED_READINGS, depth)),
            np.append(segment, ["hold"] * N_PROPOSED_READINGS),
        )
        time = np.append(
            time, depth / speed * (1.0 + np.geomspace(1.0 / N_PROPOSED_READINGS, rest, N_PROPOSED_READINGS))
        )
    channels = {c: np.zeros(len(way)) for c in template.channels}
    repeats = tuple(Repeat(f"{k + 1}", way, time, channels, {}, segment) for k in range(N_PROPOSED_REPEATS))
    measurement = Measurement(Path("next test"), "force", repeats, ())
    return replace(template, name=name, measurement=measurement, speed=speed, role="fit", after=())


def _profile(template: Experiment, marks: Sequence[Sequence[float]], depths: Sequence[float]) -> Experiment:
    """Displacements of surface marks at some depths, with no values in it."""
    x, y = np.tile(np.array(marks, float).T, len(depths))
    depth = np.repeat(depths, len(marks))
    repeat = Repeat("1", depth, None, {"x": x, "y": y, "uz": np.zeros(len(x))}, {}, np.full(len(x), "loading"))
    measurement = Measurement(Path("next test"), "profile", (repeat,), ())
    return replace(template, name="next profile", measurement=measurement, role="fit", channels=("uz",), after=())


def _seen(marks: Sequence[Sequence[float]], known: Sequence[Sequence[float]]) -> bool:
    """Whether every mark lies as near to a known one as to its own neighbour."""
    if not len(known):
        return False
    P, Q = np.array(marks, float), np.array(known, float)
    spacing = np.median(np.linalg.norm(np.diff(P, axis=0), axis=1))
    return bool(np.max(np.min(np.linalg.norm(P[:, None] - Q, axis=2), axis=1)) <= spacing)


def _places(library: Library | Outline, plan: TestPlan) -> list[int] | None:
    """Where the places of a plan are in the library, None unless it has all of them."""
    own = []
    for place in plan.places:
        k = next((k for k, p in enumerate(library.plan.places) if p.settings == place.settings), None)
        if k is None:
            return None
        own.append(k)
    return own


def _turned(plan: TestPlan, place: int) -> bool:
    """Whether a library of the plan knows the unloading at a place."""
    return any(p.peak is not None for p in passes(plan, place))
