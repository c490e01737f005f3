"""What is foreseen of relaxation: limits, an integral summed by other code, and which effects it is said of."""

import itertools

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.discrepancy.library.interpolation import nodes
from rso.discrepancy.library.relaxation import dense, expected_relaxation, is_relaxation
from rso.discrepancy.library.simulations import Pass
from rso.discrepancy.library.tables import build_library
from rso.discrepancy.library.test_plan import make_test_plan
from rso.evaluation.store import Failed

U = np.linspace(0.0, 2.0, 160) ** 2
VALUES = {"mu": 0.012, "D1": 60.0}
F = toy.elastic(VALUES, U)[0]
THERE, BACK = Pass(None, 0.0), Pass(4.0, 0.0)
FORCE = F / F[-1]


def there_and_back(g, tau, peak):
    """Relative change at U by the sum over intervals of a dense way at 1 mm/s, on the way there and on that back."""
    t = np.linspace(0.0, 2 * peak, 4001)
    u = np.minimum(t, 2 * peak - t)
    f = toy.along({**VALUES, "g": g, "tau": tau}, t, u)[0]
    return [np.interp(U, u[s], f[s]) / np.maximum(F, 1e-12) - 1 for s in (slice(2001), slice(None, 1999, -1))]


@pytest.mark.parametrize("g", [0.05, 0.3, 0.6])
@pytest.mark.parametrize("tau", [0.05, 0.4, 3.0, 40.0])
def test_the_force_is_that_of_the_hereditary_integral(g, tau):
    """To 0.4 % of the largest force: steps of the sum by other code, 1 mm of travel in 2000."""
    point = np.array([[g, np.log(tau)]])
    found = [expected_relaxation(U, F, point, way)[0] for way in (THERE, BACK)]
    for ours, theirs in zip(found, there_and_back(g, tau, 4.0), strict=True):
        np.testing.assert_allclose(ours[1:] * FORCE[1:], theirs[1:] * FORCE[1:], rtol=0, atol=4e-3)
    assert np.abs(found[0] - found[1])[80] > 0.01 * g  # the way matters


def test_what_relaxes_at_once_or_never():
    """τ → 0: the share g is lost on either way; τ → ∞: nothing is."""
    for way in (THERE, BACK):
        fast, slow = expected_relaxation(U, F, np.array([[0.4, np.log(1e-4)], [0.4, np.log(1e6)]]), way)
        np.testing.assert_allclose(fast[20:-1], -0.4, rtol=0, atol=2e-3)
        np.testing.assert_allclose(slow[20:-1], 0.0, rtol=0, atol=1e-3)


def test_contact_is_lost_on_the_way_back_and_the_turn_is_continuous():
    there, back = (expected_relaxation(U, F, np.array([[0.6, np.log(2.0)]]), way)[0] for way in (THERE, BACK))
    np.testing.assert_allclose(back[1:40], -1.0, rtol=0, atol=1e-5)  # bisection
    assert np.all(back[100:] > -0.98)
    np.testing.assert_allclose(back[-1], there[-1], rtol=0, atol=1e-9)
    assert np.all(np.diff(back[1:]) >= -1e-5)


def test_it_is_said_of_shares_that_are_lost_in_time_alone():
    assert [e.name for e in toy.effects() if is_relaxation(e)] == ["g"]


def test_dense_nodes_hold_the_computed_times_and_say_how_far_these_are_apart():
    own = nodes(next(e for e in toy.effects() if e.name == "g"), True, (0.1, 2.0))
    more = dense(own)
    assert more.fine > 1 and np.all(np.diff(more.levels[1]) <= 0.3)
    np.testing.assert_allclose(more.levels[1][:: more.fine], own.levels[1], rtol=1e-12)  # rounding
    at, beside = np.array([[0.25, 1.0]]), np.array([[0.25, 1.5]])
    np.testing.assert_allclose(more.overlap(at, beside), own.overlap(at, beside), rtol=1e-12)
    np.testing.assert_allclose(more.weights(more.points), np.eye(len(more.points)), rtol=0, atol=1e-9)


def test_tables_at_every_place_and_way_follow_it():
    """With a way back at another place too, where few nodes are computed: between these to 1 % of the largest force."""
    rng, point = np.random.default_rng(0), (10.0, 0.0)
    cycle = toy.recorded(VALUES, rng, speed=2.0, unload=True, point=point, lateral=True)
    plan = make_test_plan([*toy.laboratory(VALUES, 0), toy.experiment("more", cycle, speed=2.0, point=point)])
    library = build_library(toy.base(), plan, toy.effects("g"), toy.run)
    (e,) = library.effects
    assert [sum(way.peak is not None for way in here.passes) for here in library.places] == [1, 1]
    for here in library.places:
        f = here.base[0]
        for (i, way), (g, tau) in itertools.product(enumerate(here.passes), ((0.2, 0.7), (0.45, 2.0), (0.45, 9.0))):
            k, u = library.places.index(here), (here.u > 0) & (here.u <= (way.peak or np.inf))
            got = library.change(k, e, np.array([[g, np.log(tau)]]), 1.0)[0][0, i]
            want = expected_relaxation(here.u, f[2], np.array([[g, np.log(tau)]]), way)[0]
            for c in (0, 2):  # what a ball is pushed aside by falls as much
                off = (got[c] * f[2] - want * f[c])[u] / np.abs(f[c]).max() if f[c].any() else 0.0
                np.testing.assert_allclose(off, 0.0, rtol=0, atol=0.01)


def test_a_way_back_where_home_has_none_and_one_that_cannot_be_simulated():
    """The library is built; of a way back at another place that fails the table is what is foreseen."""
    rng = np.random.default_rng(0)
    cycle = toy.recorded(VALUES, rng, unload=True, hold=6.0, point=(10.0, 0.0), lateral=True)
    load = toy.experiment("load", toy.recorded(VALUES, rng, repeats=4))
    plan = make_test_plan([load, toy.experiment("side", cycle, point=(10.0, 0.0))])

    def run(tasks):
        away = [len(t.case.programme.time_s) > 3 for t in tasks]  # a rest
        known = iter(toy.run([t for t, a in zip(tasks, away, strict=True) if not a]))
        return [
            Failed("", t.values, t.case, "not_supported", "no rests") if a else next(known)
            for t, a in zip(tasks, away, strict=True)
        ]

    library, without = (build_library(toy.base(), plan, toy.effects("g", "soften", "stiff"), f) for f in (toy.run, run))
    assert {e.name for e in without.effects} == {"soften", "stiff", "g"} and without.failed
    g, k = next(e for e in without.effects if e.name == "g"), 1
    at = np.array([[0.4, np.log(4.0)]])
    i = next(i for i, p in enumerate(library.places[k].passes) if p.rest)
    got, want = (v.change(k, g, at, 1.0)[0][0, i, 2] for v in (without, library))
    u, force = library.places[k].u, library.places[k].base[0, 2]
    seen = (u > 0.2) & (u < 3.8)
    np.testing.assert_allclose((got * force)[seen], (want * force)[seen], rtol=0, atol=0.01 * force.max())
