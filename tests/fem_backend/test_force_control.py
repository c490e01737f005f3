"""Programmes that a force controls: the same equilibria as by travel, creep, approaches to a force, and refusals."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, Segment, SimulationFailed

SLAB = {
    "specimen": {"shape": "slab", "thickness": 20.0},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "coarse"},
}
IN_SPACE = {"mesh": {"mesher": "mapped", "n": 6, "slip": 0.3}}
ELASTIC = {"mu": 0.01, "D1": 5.8}
RELAXES = {**ELASTIC, "prony_g": 0.4, "prony_tau": 5.0}


def run(values, settings, *segments, **asked):
    return BACKEND(values, Case("case", Programme(segments=segments, **asked), settings))


def press(force, rate=0.05):
    return Segment("force", rate=rate, to_N=force)


def rest(seconds, *asked):
    return Segment("force", hold_s=seconds, asked_s=asked)


# -------------------------------------------------------------------------------------------------- the same body


@pytest.mark.parametrize(("settings", "depths"), [(SLAB, (0.3, 0.8, 1.5)), (IN_SPACE, (0.5, 1.0))])
def test_an_elastic_body_has_one_curve_whatever_is_controlled(settings, depths):
    """Equilibria of one potential: what is left is the share 1e-7 to which a force is met."""
    by_travel = BACKEND(ELASTIC, Case("travel", Programme.ramp(depths), settings))
    F = by_travel.channels["Fz"]
    by_force = run(ELASTIC, settings, press(F[-1]), asked_N=tuple(F))
    np.testing.assert_allclose(by_force.channels["Fz"], F, rtol=2e-7)
    np.testing.assert_allclose(by_force.channels["travel"], depths, rtol=5e-7)
    for name in ("contact_radius", "uz_max"):
        np.testing.assert_allclose(by_force.channels[name], by_travel.channels[name], rtol=1e-6)


def test_what_is_found_does_not_hang_on_which_forces_are_asked_for():
    few = run(ELASTIC, SLAB, press(0.1), asked_N=(0.1,))
    many = run(ELASTIC, SLAB, press(0.1), asked_N=(0.004, 0.01, 0.03, 0.05, 0.0999, 0.1))
    np.testing.assert_allclose(many.channels["travel"][-1], few.channels["travel"][-1], rtol=5e-7)


@pytest.mark.parametrize(
    "more",
    [
        {"prony_g": 0.4, "prony_tau": 5.0},
        pytest.param({"friction": 0.3}, marks=pytest.mark.verification),
        pytest.param({"mullins": 0.5}, marks=pytest.mark.verification),
    ],
    ids=["relaxes", "rubs", "softens"],
)
def test_travel_found_by_force_returns_the_force_when_it_is_replayed(more):
    """The force that was asked for comes back by the existing stepping in travel, through the same moments.

    Travel is straight between them there, on a way that is bent, and steps are others: 1e-3 with so many moments.
    """
    values = {**ELASTIC, **more}
    forces, moments = tuple(0.005 * k for k in range(1, 21)), (0.1, 0.25, 0.5, 1.0, 1.7, 3.0, 5.0, 8.0)
    found = run(values, SLAB, press(0.1), rest(8.0, *moments), asked_N=forces)
    t, s = found.channels["time"], found.channels["travel"]
    again = Programme((0.0, *t), (0.0, *s), (), tuple(t))
    replayed = BACKEND(values, Case("again", again, SLAB))
    np.testing.assert_allclose(replayed.channels["Fz"][20:], 0.1, rtol=1e-3)
    np.testing.assert_allclose(replayed.channels["Fz"][3:20], forces[3:], rtol=2e-3)


# ----------------------------------------------------------------------------------------------------------- creep


def test_creep_goes_from_the_instantaneous_to_the_long_term_modulus():
    """A ramp of τ/500 meets the elastic body of μ, 25 retardation times later that of (1 − g) μ (0.2 %: the ramp and
    what ten steps a decade leave); K stays."""
    g = 0.4
    found = run(
        {**ELASTIC, "prony_g": g, "prony_tau": 50.0}, SLAB, press(0.05, 0.5), rest(2000.0, 2000.0), asked_N=(0.05,)
    )
    ends = [
        run({"mu": mu, "D1": 5.8}, SLAB, press(0.05), asked_N=(0.05,)).channels["travel"][0] for mu in (0.01, 0.006)
    ]
    np.testing.assert_allclose(found.channels["travel"], ends, rtol=2e-3)


def test_creep_does_not_hang_on_which_moments_are_asked_for():
    """The steps of a rest are even in the logarithm of time: what others are between moves the travel by 1e-4."""
    few, many = (run(RELAXES, SLAB, press(0.1), rest(6.0, *m)) for m in ((6.0,), (0.1, 0.5, 2.0, 4.0, 6.0)))
    np.testing.assert_allclose(many.channels["travel"][-1], few.channels["travel"][-1], rtol=3e-4)


def test_a_rest_at_a_force_does_not_move_an_elastic_body():
    found = run(ELASTIC, SLAB, press(0.1), rest(20.0, 1.0, 20.0), asked_N=(0.1,))
    np.testing.assert_allclose(found.channels["travel"], found.channels["travel"][0], rtol=1e-6)


# ------------------------------------------------------------------------------------------------------- segments


def test_a_programme_of_travel_and_force():
    """An approach to a preload, cycles between two forces, a rest and a release by travel, each as asked for."""
    found = run(
        RELAXES,
        SLAB,
        Segment("travel", rate=0.5, to_N=0.01),
        Segment("force", hold_s=2.0, asked_s=(2.0,)),
        press(0.06),
        Segment("force", rate=0.05, to_N=0.03),
        press(0.08),
        rest(4.0, 1.0, 4.0),
        Segment("travel", rate=1.0, to_mm=0.2),
        Segment("travel", hold_s=3.0, asked_s=(1.0, 3.0)),
        asked_N=(0.01, 0.03, 0.05, 0.08),
    )
    t, s, F = (found.channels[n] for n in ("time", "travel", "Fz"))
    assert np.all(np.diff(t) > 0.0)
    want = [0.01, 0.01, 0.03, 0.05, 0.05, 0.03, 0.05, 0.08, 0.08, 0.08, 0.05, 0.03]
    np.testing.assert_allclose(F[: len(want)], want, rtol=1e-6)
    assert t[0] == pytest.approx(s[0] / 0.5) and t[1] == pytest.approx(t[0] + 2.0)
    assert s[4] > 0.0 and t[3] - t[2] == pytest.approx(0.02 / 0.05)
    assert s[9] > s[8] > s[7]  # it creeps
    np.testing.assert_allclose(s[-2:], 0.2)
    assert 0.0 <= F[-2] <= F[-1] < 0.01  # and recovers at rest


def test_forces_passed_by_travel_and_travels_passed_by_force():
    """Both ways to ask of the other quantity give points of one curve of an elastic body."""
    by_travel = run(ELASTIC, SLAB, Segment("travel", rate=0.5, to_mm=1.0), asked_mm=(0.5, 1.0), asked_N=(0.02, 0.05))
    s, F = by_travel.channels["travel"], by_travel.channels["Fz"]
    np.testing.assert_allclose(F[[0, 2]], (0.02, 0.05), rtol=1e-6)
    np.testing.assert_allclose(s[[1, 3]], (0.5, 1.0))
    by_force = run(ELASTIC, SLAB, press(0.06), asked_mm=(0.5,), asked_N=(0.02, 0.05))
    np.testing.assert_allclose(by_force.channels["Fz"][1], F[np.argmin(np.abs(s - 0.5))], rtol=1e-6)
    np.testing.assert_allclose(by_force.channels["time"], by_force.channels["Fz"] / 0.05, rtol=1e-6)
    waypoints = Programme((0.0, 2.0), (0.0, 1.0), (0.5, 1.0), (), (0.02, 0.05))
    same = BACKEND(ELASTIC, Case("case", waypoints, SLAB))
    np.testing.assert_allclose(same.channels["Fz"], F, rtol=1e-6)
    np.testing.assert_allclose(same.channels["time"], 2.0 * s, rtol=1e-6)


# ------------------------------------------------------------------------------------------------ errors and ends


def test_the_error_of_a_travel_is_that_of_the_force_over_the_stiffness():
    """A coarser mesh misses the travel by what the standard one states and that is a few per cent."""
    fine = {**SLAB, "mesh": {"level": "fine"}}
    found, better = (run(ELASTIC, s, press(0.1), asked_N=(0.05, 0.1)) for s in (SLAB, fine))
    off = np.abs(found.channels["travel"] - better.channels["travel"])
    assert np.all(off <= found.error["travel"]) and np.all(found.error["travel"] < 0.04 * found.channels["travel"])
    assert np.all(found.error["Fz"] <= 1e-6 * found.channels["Fz"])


def test_a_force_out_of_reach_ends_with_a_reason_and_what_was_reached():
    thin = {**SLAB, "specimen": {"shape": "slab", "thickness": 2.0}}
    with pytest.raises(SimulationFailed, match="a force of 50 N is not met") as stopped:
        run(ELASTIC, thin, press(50.0, 1.0), asked_N=(0.05, 50.0))
    assert stopped.value.partial.channels["Fz"] == pytest.approx([0.05], rel=1e-6)


@pytest.mark.parametrize(
    ("segments", "asked", "why"),
    [
        ((Segment("force", rate=1.0, to_N=-0.1), press(0.1)), {}, r"segments\[0\].to_N = -0.1 N: a positive force"),
        ((Segment("travel", rate=1.0, to_mm=25.0),), {}, r"segments\[0\].to_mm = 25 mm: from 0"),
        ((press(0.1),), {"asked_mm": (25.0,)}, "asked_mm = .*at most"),
    ],
)
def test_what_is_not_modelled_is_refused(segments, asked, why):
    with pytest.raises(ValueError, match=why):
        run(ELASTIC, SLAB, *segments, **{"asked_N": (0.05,), **asked})
