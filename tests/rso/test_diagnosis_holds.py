"""Readings of a hold: what relaxes, what the chain does meanwhile, and what they are worth."""

from __future__ import annotations

import dataclasses

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rso.data import Repeat
from rso.discrepancy import build_library, diagnose, make_test_plan
from rso.discrepancy.evidence import noise
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.test_plan import UNLOADING_BRANCH


def plan_of(truth=toy.TRUTH, hold=60.0, seed=0, **more):
    rng = np.random.default_rng(seed)
    held = toy.recorded(truth, rng, hold=hold, repeats=3, **more)
    return [toy.experiment("load", toy.recorded(truth, rng, repeats=4, **more)), toy.experiment("rest", held)]


def exact(test, values, modulus, **chain):
    """Fz (n,) of a test by the hereditary integral itself, bins read off at their mean times, which count from the
    first reading on."""
    late = test.depth[0] / test.speed - test.time[0]
    at = test.time + late
    t = np.unique(np.concatenate([np.linspace(0.0, test.peak / test.speed, 2001), at]))
    u = np.minimum(t * test.speed, test.peak)
    F = toy.along({"mu": modulus, "D1": values["D1"], **values}, t, u)[0]
    if lag := chain.get("lag"):
        F = np.interp(t - lag, t, F)
    F = F + chain.get("drift", 0.0) * (t - late)
    return np.interp(at, t, F)


@pytest.mark.parametrize("chain", [{}, {"drift": 2e-4}, {"lag": 0.7}], ids=["alone", "drift", "lag"])
@pytest.mark.parametrize("tau", [1.0, 5.0, 25.0])
def test_relaxation_in_a_hold_is_that_of_the_hereditary_integral(tau, chain):
    """No run of the library rests; the toy's integral is exact.  1 % is what the nodes in τ leave on the loading."""
    plan = make_test_plan(plan_of(white=0.0, scatter=0.0))
    names = ("g", *chain)
    chosen = {e.name: e for e in toy.effects(*names)}
    library = build_library(toy.base(), plan, tuple(chosen.values()), toy.run)
    base, modulus = library.base, 0.012
    κ = modulus * 60.0
    x = [np.log(κ), 0.3, np.log(tau), *chain.values()]
    A, c = predict(library, [chosen[n] for n in names], np.array([x]), modulus)
    got = (modulus * A + c)[0]
    test, _, at = next(r for r in library.plan.rows() if r[0].held.any())
    want = exact(test, {"D1": 60.0, "g": 0.3, "tau": tau}, modulus, **chain)
    np.testing.assert_allclose(got[at], want, rtol=0.01)
    relaxed = want[test.held][0] - want[test.held][-1]
    fall = got[at][test.held][0] - got[at][test.held][-1]
    np.testing.assert_allclose(fall, relaxed, rtol=0.03, atol=0.003 * want.max())
    assert base.modulus == "mu"


def creeping(test, c, τ, k, modulus):
    """Fz (n,) of a test whose drive goes to the peak, rests and returns, by the equations of motion themselves.

    d = u + k F(u) + z,   τ dz/dt = c F(u) − z.
    """
    values = {"mu": modulus, "D1": 60.0}
    F = lambda u: float(toy.elastic(values, np.array(max(u, 0.0)))[0])  # noqa: E731
    rest = float(test.since.max()) if test.held.any() else 0.0
    ends = np.cumsum([test.peak / test.speed, rest, test.peak / test.speed])

    def drive(t):
        return np.interp(t, [0.0, *ends], [0.0, test.peak, test.peak, 0.0])

    def pressed(t, z):
        left = lambda u: u + k * F(u) + z - drive(t)  # noqa: E731
        return brentq(left, -1.0, test.peak + 1.0, xtol=1e-12)

    def dz(t, z):
        return [(c * F(pressed(t, z[0])) - z[0]) / τ]

    step = test.peak / test.speed / 50
    way = solve_ivp(dz, (0.0, ends[-1]), [0.0], rtol=1e-8, atol=1e-10, dense_output=True, max_step=step)
    force = lambda t: F(pressed(t, float(way.sol(t)[0])))  # noqa: E731
    at = np.where(test.held, ends[0] + test.since, test.depth / test.speed)
    at = np.where(test.branch == UNLOADING_BRANCH, ends[2] - test.depth / test.speed, at)
    return np.array([force(t) for t in at])


@pytest.mark.parametrize("k", [0.0, 0.5])
@pytest.mark.parametrize("τ", [1.0, 6.0, 40.0])
def test_a_load_train_that_creeps_moves_as_its_equations_say(τ, k):
    """Loading, a hold, and the way back.  The chain takes the body's time for the drive's."""
    c, modulus = 1.5, 0.012
    rng = np.random.default_rng(0)
    own = [
        toy.experiment("load", toy.recorded(toy.TRUTH, rng)),
        toy.experiment("rest", toy.recorded(toy.TRUTH, rng, hold=30.0)),
        toy.experiment("back", toy.recorded(toy.TRUTH, rng, unload=True)),
    ]
    chosen = {e.name: e for e in toy.effects("creep", "compliance")}
    library = build_library(toy.base(), make_test_plan(own), tuple(chosen.values()), toy.run)
    names, x = (["creep", "compliance"], [c, np.log(τ), k]) if k else (["creep"], [c, np.log(τ)])
    x = [np.log(modulus * 60.0), *x]
    A, _ = predict(library, [chosen[n] for n in names], np.array([x]), modulus)
    plain, _ = predict(library, [], np.array([x[:1]]), modulus)
    matters = []
    for test, _, at in library.plan.rows():
        want, without = creeping(test, c, τ, k, modulus), modulus * plain[0, at]
        matters.append(np.abs(want - without).max() / without.max())
        np.testing.assert_allclose(modulus * A[0, at], want, rtol=0, atol=0.004 * without.max())
        if test.held.any():
            fall, found = (v[test.held][0] - v[test.held][-1] for v in (want, modulus * A[0, at]))
            np.testing.assert_allclose(found, fall, rtol=0.05, atol=0.002 * without.max())
    assert max(matters) > 0.02


@pytest.mark.parametrize("hold, pace", [(0.0, 3.0), (6.0, 1.0), (20.0, 0.4)])
@pytest.mark.parametrize("tau", [1.0, 8.0])
def test_the_way_back_knows_how_long_the_ball_rested_and_how_fast_it_goes(tau, hold, pace):
    """Against the integral over the whole way; to 1 % of the largest force.  Without either it is off by 2 %."""
    values = {"mu": 0.012, "D1": 60.0, "g": 0.4, "tau": tau}
    repeats = toy.recorded(values, np.random.default_rng(0), hold=hold, pace=pace, unload=True, white=0.0, scatter=0.0)
    plan = make_test_plan([toy.experiment("cycle", repeats)])
    (test,), (g,) = plan.tests, toy.effects("g")
    library = build_library(toy.base(), plan, (g,), toy.run)
    far, v = repeats[0].depth.max(), test.speed
    t = np.concatenate([np.linspace(0, far / v, 1001), far / v + hold + np.linspace(0, far / v / pace, 1001)])
    t, one = np.unique(t, return_index=True)
    u = np.concatenate([np.linspace(0, far, 1001), np.linspace(far, 0, 1001)])[one]
    F = toy.along(values, t, u)[0]
    back = test.branch == UNLOADING_BRANCH
    want = np.interp(-test.depth[back], -u[t >= far / v + hold], F[t >= far / v + hold])
    off = []
    for plain in (plan, dataclasses.replace(plan, tests=(dataclasses.replace(test, rest=0.0, pace=1.0),))):
        other = library if plain is plan else build_library(toy.base(), plain, (g,), toy.run)
        A, c = predict(other, [g], np.array([[np.log(0.72), 0.4, np.log(tau)]]), 0.012)
        off.append(np.abs((0.012 * A + c)[0][: test.n][back] - want).max() / F.max())
    assert off[0] < 0.01 and off[1] > 2 * off[0] and off[1] > 0.02


def test_nothing_changes_in_a_hold_of_what_does_not_relax():
    plan = make_test_plan(plan_of(white=0.0, scatter=0.0))
    (stiff,) = toy.effects("stiff")
    library = build_library(toy.base(), plan, (stiff,), toy.run)
    A, _ = predict(library, [stiff], np.array([[np.log(0.72), 0.4]]), 0.012)
    test, _, at = next(r for r in library.plan.rows() if r[0].held.any())
    held = A[0, at][test.held]
    np.testing.assert_allclose(held, held[0], rtol=1e-12)
    assert A[0, at][~test.held][-1] < held[0]  # the last bin of loading lies below the end


@pytest.mark.parametrize("name", ["compliance", "gain", "offset", "drift", "lag"])
def test_a_chain_without_an_error_changes_nothing_where_depths_scatter(name):
    """A hold lies in the midst of its depths, 5 µm beside the largest, where the force would be another by 0.2 %.

    What is left is a curve read off linearly in the depth and not in its root, 0.02 % of the largest force.
    """
    rng = np.random.default_rng(0)
    shaken = [
        dataclasses.replace(
            e,
            measurement=dataclasses.replace(
                e.measurement,
                repeats=tuple(
                    dataclasses.replace(r, depth=r.depth + 2e-3 * rng.standard_normal(len(r.depth)))
                    for r in e.measurement.repeats
                ),
            ),
        )
        for e in plan_of(white=0.0, scatter=0.0)[1:]
    ]
    plan = make_test_plan(shaken)
    (effect,) = toy.effects(name)
    library = build_library(toy.base(), plan, (effect,), toy.run)
    x = np.array([[np.log(0.72)]])
    A, b = predict(library, [], x, 0.012)
    C, d = predict(library, [effect], np.append(x, [[1e-9]], axis=1), 0.012)
    test, _, at = next(r for r in library.plan.rows() if r[0].held.any())
    assert test.peak > np.mean(test.depth[test.held]) + 3e-3
    np.testing.assert_allclose((C + d / 0.012)[0, at], (A + b / 0.012)[0, at], rtol=0, atol=3e-4 * A[0, at].max())


FEW = ("g", "stiff", "soften", "offset", "compliance", "drift")


@pytest.mark.parametrize("names", [FEW, pytest.param((), marks=pytest.mark.verification)], ids=["few", "all"])
def test_a_hold_finds_relaxation_at_one_speed(names):
    """Among few causes, and in the long verification among all.

    Size and time both; without the readings of the hold a single speed shows a stiffness, and no time at all."""
    truth = {**toy.TRUTH, "g": 0.3, "tau": 8.0}
    experiments = plan_of(truth, seed=3)
    lost = [
        dataclasses.replace(
            e,
            measurement=dataclasses.replace(
                e.measurement, repeats=tuple(dataclasses.replace(r, time=None) for r in e.measurement.repeats)
            ),
        )
        for e in experiments
    ]
    found = {}
    for name, data in (("used", experiments), ("lost", lost)):
        plan = make_test_plan(data)
        library = build_library(toy.base(), plan, toy.effects(*names), toy.run)
        found[name] = diagnose(library, 0, nulls=60)
    used, without = found["used"], found["lost"]
    assert used.verdict == "explained" and used.named == ("g",)
    low, high = used.causes[0].interval
    assert low <= 0.3 <= high and high - low < 0.1
    assert without.verdict != "explained" or without.named != ("g",)


@pytest.mark.parametrize("how", ["back alone", "a hold and back", "a hold alone"])
def test_a_repeat_without_a_way_there_breaks_nothing(how):
    """Its hold is left out with a note; every knob of the chain has an answer."""
    (whole,) = toy.recorded(toy.TRUTH, np.random.default_rng(1), unload=True)
    n = len(whole.depth)
    segment = {
        "back alone": ["unloading"] * n,
        "a hold and back": ["hold"] * 20 + ["unloading"] * (n - 20),
        "a hold alone": ["hold"] * n,
    }[how]
    depth = np.r_[np.full(20, 4.0), np.linspace(4.0, 0.1, n - 20)]
    odd = dataclasses.replace(whole, depth=depth, segment=np.array(segment))
    plan = make_test_plan([toy.experiment("a", (whole,)), toy.experiment("b", (odd,))])
    assert not any(t.held.any() for t in plan.tests)
    assert any("hold elsewhere" in note for note in plan.notes) == (how != "back alone")
    chosen = toy.effects("g", "drift")
    library = build_library(toy.base(), plan, chosen, toy.run)
    A, c = predict(library, chosen, np.array([[np.log(0.72), 0.2, 1.0, 1e-4]]), 0.012)
    assert np.all(np.isfinite(A)) and np.all(np.isfinite(c))


def test_drift_in_the_air_counts_from_the_first_reading():
    """Ten millimetres of air at 0.5 mm/s before contact: what the sensor drifts there is in the record."""
    t = np.linspace(0.0, 28.0, 561)
    u = 0.5 * t - 10.0
    F = 0.012 * np.maximum(u, 0.0) ** 1.5 + 1e-3 * t
    r = Repeat("1", u, t + 1e9, {"Fz": F}, {}, np.full(len(t), "loading"))
    plan = make_test_plan([toy.experiment("a", (r,))])
    (drift,) = toy.effects("drift")
    library = build_library(toy.base(), plan, (drift,), toy.run)
    with_, without = (
        0.012 * A[0] + c[0]
        for A, c in (
            predict(library, effects, np.array([[np.log(0.72), *size]]), 0.012)
            for effects, size in (([drift], [1e-3]), ([], []))
        )
    )
    (test,) = plan.tests
    np.testing.assert_allclose(with_ - without, 1e-3 * test.time, rtol=0, atol=2e-5)  # of 28e-3: bins, and √u tables


def test_noise_of_a_hold_is_that_of_its_end_of_loading_and_its_gap_fades_with_time():
    plan = make_test_plan(plan_of(white=0.0, scatter=0.0))
    library = build_library(toy.base(), plan, (), toy.run)
    A, _ = predict(library, [], np.array([[np.log(0.72)]]), 0.012)
    test, _, at = next(r for r in plan.rows() if r[0].held.any())
    slope = noise.slope_of(library, 0.012 * A[0])[at]
    assert np.all(slope[test.held] == slope[~test.held][-1]) and slope[test.held][0] > 0
    K = noise.gap_covariance(library, 0.012 * A[0], 0.1, 0.2)[at, at][np.ix_(test.held, test.held)]
    C = K / np.sqrt(np.outer(np.diag(K), np.diag(K)))
    assert C[0, 1] > 0.9 > 0.5 > C[0, -1]
