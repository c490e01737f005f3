"""A small or a large test is diagnosed like one of the usual size: lengths count by the deepest travel."""

import dataclasses
import re

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.contract import Case, Programme
from rso.data import Noise, Repeat
from rso.discrepancy import build_library, diagnose, make_test_plan, suited
from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.attribution import by_test
from rso.discrepancy.evidence.localisation import _regions
from rso.discrepancy.library.planning import framed, jobs_of_base
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.simulations import passes
from rso.discrepancy.library.test_plan import scale_of
from rso.discrepancy.proposals import proposed_tests

NAMES = ("stiff", "soften", "g", "offset", "offset_each", "compliance", "backlash", "bias")


@dataclasses.dataclass(frozen=True)
class Zoomed(toy.Toy):
    """The toy with all lengths that the indenter goes `times` as large, and the same forces."""

    name: str = "zoomed toy"
    times: float = 1.0

    def __call__(self, values, case):
        k, p = self.times, case.programme
        small = lambda v: tuple(round(x / k, 12) for x in v)  # noqa: E731
        settings = {**case.settings, "earlier": case.settings.get("earlier", 0.0) / k}
        v = {**values, "tau": values["tau"] / k} if "tau" in values else values
        r = super().__call__(
            v, Case(case.name, Programme(small(p.time_s), small(p.travel_mm), small(p.asked_mm)), settings)
        )
        goal = np.array(p.asked_mm)
        travel = goal[np.argmin(np.abs(k * r.channels["travel"][:, None] - goal), axis=1)]
        time = k * r.channels["time"]
        return dataclasses.replace(r, channels={**r.channels, "travel": travel, "time": time})


def laboratory(truth, times, **chain):
    """The usual tests, every depth and speed `times` as large."""
    found = []
    for e in toy.laboratory(truth, 0, **chain):
        zoomed = tuple(dataclasses.replace(r, depth=times * r.depth) for r in e.measurement.repeats)
        m = dataclasses.replace(e.measurement, repeats=zoomed)
        own = Noise(Fz=toy.WHITE, gain=toy.SCATTER, depth=0.002 * times)
        found.append(dataclasses.replace(e, measurement=m, speed=times * e.speed, noise=own))
    return found


def made(times, truth=toy.TRUTH, names=NAMES, **chain):
    """Library of a laboratory of that size."""
    plan = make_test_plan(laboratory(truth, times, **chain))
    largest = max(float(np.abs(t.values["Fz"]).max()) for t in plan.tests)
    effects = suited(toy.effects(*names), largest, plan.scale)
    backend = Zoomed(times=times)
    return build_library(
        dataclasses.replace(toy.base(), backend=backend), plan, effects, lambda tasks: toy.run(tasks, backend)
    )


@pytest.mark.parametrize("times", [0.01, 0.1, 10.0])
def test_all_that_is_computed_for_a_small_test_is_that_of_a_large_one(times):
    usual, other = make_test_plan(laboratory(toy.TRUTH, 1.0)), make_test_plan(laboratory(toy.TRUTH, times))
    assert usual.scale == 1.0 and other.scale == times
    close = lambda a, b: np.testing.assert_allclose(a, times * np.array(b), rtol=1e-9)  # noqa: E731
    for k, (p, q) in enumerate(zip(usual.places, other.places, strict=True)):
        close(q.deepest, p.deepest)
        close(q.peaks, p.peaks)
        close(other.reach(k), usual.reach(k))
        ways = [[(w.peak or 0.0, w.earlier) for w in passes(plan, k)] for plan in (usual, other)]
        close(ways[1], ways[0])
    for a, b in zip(*(jobs_of_base(toy.base(), p, framed(toy.base(), p)) for p in (usual, other)), strict=True):
        close(b.task.case.programme.asked_mm, a.task.case.programme.asked_mm)
    for c in ("Fx", "Fz"):
        a, b = (noise.noise_levels(p)[c] for p in (usual, other))
        close(b.contact, a.contact)
        np.testing.assert_allclose((b.white, b.gain, b.correlated), (a.white, a.gain, a.correlated), rtol=1e-9)


def test_the_usual_lengths_are_those_of_a_plan_of_four_to_six_millimetres():
    plan = make_test_plan(toy.laboratory(toy.TRUTH, 0))
    assert [p.deepest for p in plan.places] == [6.0, 4.0] and plan.places[0].peaks == (4.0,)
    assert [plan.reach(k) for k in range(2)] == [6.4, 4.4]
    found = toy.effects()
    assert [e.size for e in suited(found, 1.0, plan.scale)] == [e.size for e in found]


@pytest.mark.parametrize(
    ("deepest", "scale"),
    [
        (4.0, 1.0),
        (6.2, 1.0),
        (3.25, 1.0),
        (6.5, 2.0),
        (3.2, 0.4),
        (8.0, 2.0),
        (30.0, 4.0),
        (0.3, 0.04),
        (0.2, 0.04),
        (0.005, 0.001),
        (100.0, 20.0),
    ],
)
def test_lengths_count_by_a_round_number(deepest, scale):
    assert scale_of(deepest) == scale
    assert scale_of(deepest * 1.001) == scale


FEW = {"offset": ("stiff", "offset", "offset_each", "backlash"), "stiff": ("stiff", "g", "compliance")}


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.verification)])
@pytest.mark.parametrize(
    ("times", "truth", "chain", "cause"),
    [
        (0.1, {}, {"offset": 0.15}, "offset"),
        pytest.param(10.0, {"stiff": 0.3}, {}, "stiff", marks=pytest.mark.verification),
        pytest.param(10.0, {}, {"offset": 0.15}, "offset", marks=pytest.mark.verification),
        pytest.param(0.1, {"stiff": 0.3}, {}, "stiff", marks=pytest.mark.verification),
    ],
)
def test_the_verdict_on_a_small_or_large_test_is_that_on_the_usual_one(times, truth, chain, cause, whole):
    """Among few causes, and in the long verification among all of the above."""
    names = NAMES if whole else FEW[cause]
    usual = made(1.0, {**toy.TRUTH, **truth}, names, **chain)
    other = made(times, {**toy.TRUTH, **truth}, names, **chain)
    a, b = (diagnose(library, 0) for library in (usual, other))
    assert a.named and a.verdict == b.verdict and a.named == b.named and cause in b.named
    for name, p in a.probabilities.items():
        np.testing.assert_allclose(b.probabilities[name], p, atol=2e-3)
    (x, y) = (next(c for c in d.causes if c.effect.name == cause) for d in (a, b))
    lengths = {"offset": times, "compliance": times}.get(cause, 1.0)
    np.testing.assert_allclose(y.size, lengths * x.size, rtol=1e-2)


@pytest.mark.parametrize("times", [0.001, 10.0])
def test_candidates_go_as_deep_as_the_plan_lets_them_at_rates_that_can_be_read(times):
    usual, other = (proposed_tests(made(k)) for k in (1.0, times))
    assert len(usual) == len(other)
    for a, b in zip(usual, other, strict=True):
        for x, y in zip(a.experiments, b.experiments, strict=True):
            p, q = x.measurement.repeats[0], y.measurement.repeats[0]
            np.testing.assert_allclose(q.depth, times * p.depth, rtol=1e-9)
    assert not any("(0 mm/min" in c.words for c in other)


def test_a_contact_found_far_too_late_is_followed_where_the_test_is_deep():
    """What is plausible there, 4 mm, lies beyond what the knob is declared for."""
    found = []
    for times in (1.0, 10.0):
        library = made(times)
        own = [e for e in library.effects if e.name == "offset"]
        found.append(predict(library, own, np.array([[0.0, 0.35 * times], [0.0, 0.2 * times]]), 0.012)[0])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("times", [1.0, 10.0])
@pytest.mark.parametrize("knob", ["offset", "gain", "bias", "drift"])
def test_what_every_curve_has_for_itself_moves_it_as_it_moves_all(times, knob):
    plan = make_test_plan(laboratory(toy.TRUTH, times))
    effects = suited(toy.effects(knob, f"{knob}_each"), 1.0, plan.scale)
    backend = Zoomed(times=times)
    base = dataclasses.replace(toy.base(axes=False), backend=backend)
    library = build_library(base, plan, effects, lambda tasks: toy.run(tasks, backend))
    own, each = library.effects
    step = 0.05 * each.size.high
    low, high = (0.012 * predict(library, (own,), np.array([[s * step]]), 0.012)[0][0] for s in (-1.0, 1.0))
    moved = by_test(library, each, np.zeros((1, 0)), 0.012)
    assert np.abs(moved).max(axis=1).min() > 0.0
    np.testing.assert_allclose(moved.sum(axis=0), (high - low) / (2 * step), rtol=1e-9, atol=1e-12)


def test_a_dent_is_no_repeat_in_a_small_test_either():
    """What comes after a travel of 0.04 mm is no repeat of the first test where all of them go 0.04 mm."""
    for times in (1.0, 0.01):
        plan = make_test_plan(laboratory(toy.TRUTH, times)[:1])
        assert sorted(len(v) for v in noise._alike(plan.tests, plan.scale)) == [1, 3]


@pytest.mark.parametrize("times", [0.001, 0.01, 0.1, 1.0, 10.0])
def test_regions_are_called_by_depths_that_differ(times):
    marks = np.repeat([2.0, 4.0], 3) * times
    x = np.tile([0.0, 1.0, 2.0], 2)
    profile = Repeat("1", marks, None, {"x": x, "y": 0 * x, "uz": 0 * x}, {}, np.full(6, "loading"))
    plan = make_test_plan([*laboratory(toy.TRUTH, times), toy.experiment("marks", (profile,))])
    names = [(e, c, name) for e, c, name, _ in _regions(plan)]
    assert len(set(names)) == len(names)
    depths = [tuple(map(float, re.findall(r"[\d.]+", name))) for *_, name in names]
    assert all(v[0] < v[-1] for v in depths if len(v) == 2)
    profiles = [v[0] for v in depths if len(v) == 1]
    np.testing.assert_allclose(profiles, [2.0 * times, 4.0 * times], rtol=1e-9)
    rows = [rows for _, c, _, rows in _regions(plan) if c == "uz"]
    assert [len(v) for v in rows] == [3, 3]
