"""Instants of a programme that round-off, its origin of time or a steep ramp bring near each other."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from fem_backend.backend import BACKEND, passages
from fem_backend.simulation.schedule import instants_with_steps
from fem_backend.solver.load_steps import Instant
from rso.contract import Case, Programme, run_key

MESH = {"mesher": "mapped", "n": 8, "slip": 0.5}
VALUES = {"mu": 0.01, "D1": 5.8}
RELAXING = {"prony_g": 0.4, "prony_tau": 2.0}


def run(values, programme, **settings):
    case = Case("c", programme, {"mesh": MESH, "derivatives": False, **settings})
    return BACKEND({**VALUES, **values}, case).channels


@functools.cache  # what others are held to is simulated once
def in_one_go(multipliers):
    return run({}, Programme.ramp((1.0, 2.0, 3.0)), multipliers=multipliers)


@functools.cache
def from_zero():
    return run(RELAXING, later(0.0))


def rows(programme):
    return [(i.time, i.travel) for i in passages(programme) if i.asked]


# ------------------------------------------------------------------------------------------------- origin of time


def later(start):
    return Programme((start, start + 2.0, start + 6.0), (0.0, 1.0, 1.0), (0.5, 1.0), (start + 6.0,))


@pytest.mark.parametrize("start", [-5.0, 16.0])
def test_a_test_that_begins_later_is_the_same_test(start):
    """Sums of small whole numbers: the times are exact, so is the answer, and one test has one key."""
    one, other = from_zero(), run(RELAXING, later(start))
    np.testing.assert_array_equal(other["time"], one["time"] + start)
    for name in set(one) - {"time"}:
        np.testing.assert_array_equal(other[name], one[name])
    keys = {run_key(BACKEND, *BACKEND.canonical(VALUES | RELAXING, Case("c", later(s)))) for s in (0.0, start)}
    assert len(keys) == 1


# ------------------------------------------------------------------------------------------------- round-off


def test_a_fast_ramp_before_a_long_rest_passes_everything():
    programme = Programme((0.0, 1e-6, 1000.0), (0.0, 4.0, 4.0), (1.0, 2.0, 3.0, 3.9, 4.0), (10.0,))
    times, travels = zip(*rows(programme), strict=True)
    assert travels == (1.0, 2.0, 3.0, 3.9, 4.0, 4.0)
    np.testing.assert_allclose(times, [2.5e-7, 5e-7, 7.5e-7, 9.75e-7, 1e-6, 10.0], rtol=1e-12)


def test_an_asked_travel_that_is_the_deepest_but_for_round_off_is_passed():
    assert rows(Programme((0.0, 1.0), (0.0, 0.3), (0.1 * 3,))) == [(1.0, 0.3)]
    found = rows(Programme((0.0, 1.0), (0.0, 0.3), (0.1, 0.2, 0.1 * 3)))
    assert [s for _, s in found] == [0.1, 0.2, 0.3] and found[-1][0] == 1.0


@pytest.mark.parametrize("tiny", [1e-13, 1e-15])
@pytest.mark.parametrize("travel", [(0.0, 1.0), (0.0, 1.0, 0.0)])
def test_an_asked_travel_that_is_hardly_any_is_not_lost(travel, tiny):
    """Taken for travel 0, where nothing is asked, it had no row."""
    found = rows(Programme(tuple(range(len(travel))), travel, (tiny, 0.5, 1.0)))
    assert [s for _, s in found] == [tiny, 0.5, 1.0, 0.5, tiny][: 3 if len(travel) == 2 else 5]
    small = rows(Programme((0.0, 1.0), (0.0, 1e-11), (2e-12, 0.9e-11, 1e-11)))  # round-off is a share of the travel
    assert [s for _, s in small] == [2e-12, 0.9e-11, 1e-11]


def test_a_rest_has_steps_that_grow_with_its_time():
    """Of a body that relaxes, a ninth and a third of the time since it began; other bodies rest in one step."""
    at = [Instant(1.0, 1.0, True), Instant(10.0, 1.0, True), Instant(19.0, 1.0, True), Instant(20.0, 0.9, True)]
    np.testing.assert_allclose(
        [i.time for i in instants_with_steps(at, 1.0, True)], [1.0, 2.0, 4.0, 10.0, 19.0, 20.0], rtol=1e-12
    )
    assert [i.time for i in instants_with_steps(at, 1.0)] == [1.0, 10.0, 19.0, 20.0]
    long = instants_with_steps([Instant(1.0, 1.0, True), Instant(1.5, 1.0, True), Instant(91.0, 1.0, True)], 1.0, True)
    np.testing.assert_allclose([i.time - 1.0 for i in long], [0.0, 0.5 / 9, 0.5 / 3, 0.5, 10.0, 30.0, 90.0], rtol=1e-9)
    assert all(i.travel == 1.0 for i in long) and [i.asked for i in long[1:4]] == [False, False, True]


def test_a_fast_ramp_relaxes_in_the_rest_only():
    """Loaded in a microsecond: the force of loading is elastic, to 1e-5 of what a microsecond relaxes and round-off."""
    programme = Programme((0.0, 1e-6, 1000.0), (0.0, 0.5, 0.5), (0.25, 0.5), (10.0,))
    F = run(RELAXING, programme)["Fz"]
    elastic = run({}, Programme.ramp((0.25, 0.5)))["Fz"]
    np.testing.assert_allclose(F[:2], elastic, rtol=1e-5)
    assert len(F) == 3 and F[2] < 0.9 * F[1]


def by_travel(at):
    return {s: at["Fz"][np.abs(at["travel"] - s) < 1e-6] for s in (1.0, 2.0, 3.0)}


@pytest.mark.parametrize("multipliers", [True, False])
@pytest.mark.parametrize("apart", [1e-12, 1e-9])
def test_travels_apart_by_round_off_are_one_question(multipliers, apart):
    """Every row is there, and the others do not feel that one came twice."""
    plain = in_one_go(multipliers)
    twice = run({}, Programme.ramp((1.0, 2.0, 2.0 + apart, 3.0)), multipliers=multipliers)
    np.testing.assert_array_equal(twice["travel"], [1.0, 2.0, 2.0 + apart, 3.0])
    for s, F in by_travel(twice).items():
        np.testing.assert_allclose(F, by_travel(plain)[s][0], rtol=1e-8)


def test_moments_apart_by_round_off_all_have_a_row():
    """Of a body with memory: a moment beside an asked travel, another beside the end of a rest."""
    corners = ((0.0, 0.7, 1.4), (0.0, 1.0, 1.0), (0.5, 1.0))
    plain = run(RELAXING, Programme(*corners, (1.4,)))
    twice = run(RELAXING, Programme(*corners, (0.35 * (1 + 1e-13), 0.7 * (1 - 1e-10), 1.4 * (1 - 1e-13), 1.4)))
    np.testing.assert_allclose(twice["Fz"], plain["Fz"][[0, 0, 1, 1, 2, 2]], rtol=1e-8)
    assert np.all(np.diff(twice["time"]) > 0)


def test_an_elastic_body_has_one_curve_without_multipliers():
    programme = Programme((0.0, 1.0, 2.0, 3.0, 4.0), (0.0, 2.0, 1.5, 1.9, 0.0), (0.5, 1.5, 1.9, 2.0))
    at = run({}, programme, multipliers=False)
    once = run({}, Programme.ramp((0.5, 1.5, 1.9, 2.0)), multipliers=False)
    for s in (0.5, 1.5, 1.9):
        np.testing.assert_allclose(at["Fz"][at["travel"] == s], once["Fz"][once["travel"] == s][0], rtol=1e-12)
