"""Equilibrium: convergence, energy, honesty about failure."""

from dataclasses import replace

import numpy as np
import pytest

from fem_backend.contact import tractions
from fem_backend.simulation import indentation, initial_state
from fem_backend.solver import newton
from fem_backend.solver.load_steps import Control, Stopped
from fem_backend.solver.newton import Counters, NotConverged
from rso.contract import CAUSES

PENALTY_ONLY = Control(augmentations=0)


# ---------------------------------------------------------------------------------------------- convergence


@pytest.mark.parametrize("start", [0.7, 0.8, 0.9])
def test_last_iterations_converge_quadratically(graded, start):
    """r_{k+1} ≤ C r_k² over the last three residuals above round-off, from a start without predictor.

    C is 0.01 to 0.3 here; a fixed rate of 0.05 would need C = 500 at r = 1e-4.
    """
    u = graded.travel([start], PENALTY_ONLY)[0].evaluation.u
    history = newton.solve(graded.system(), u, graded.load(1.0), 1e-10, Counters()).history
    r = np.array([h for h in history if h > 1e-11][-3:])
    assert r[0] < 0.2 and np.all(r[1:] < 2.0 * r[:-1] ** 2), history


def test_wrong_tangent_is_seen_in_the_rate(graded, monkeypatch):
    """Negative control of the test above: with 5 % off in the contact stiffness the rate is linear."""
    system, load = graded.system(), graded.load(1.0)
    start = graded.travel([0.95], PENALTY_ONLY)[0].stages[-1].equilibrium
    u = start.evaluation.u + 0.05 * start.rate
    right = newton.solve(system, u, load, 1e-10, Counters()).history
    true = tractions.add_contact_tangent

    def wrong(pair, *rest):
        return true(replace(pair, epsilon=1.05 * pair.epsilon), *rest)

    monkeypatch.setattr(tractions, "add_contact_tangent", wrong)
    history = newton.solve(system, u, load, 1e-10, Counters()).history
    assert len(history) > len(right) + 2
    r = np.array([h for h in history if h > 1e-11][-3:])
    assert not np.all(r[1:] < 2.0 * r[:-1] ** 2), history


def test_rate_is_the_derivative_of_the_equilibrium(graded):
    """du/ds of the predictor against the difference of two equilibria."""
    system, h = graded.system(), 1e-4
    near = graded.travel([0.99], PENALTY_ONLY)[0].evaluation.u
    at = newton.solve(system, near, graded.load(1.0), 1e-9, Counters())
    u = [newton.solve(system, at.evaluation.u, graded.load(1.0 + s), 1e-11, Counters()).evaluation.u for s in (-h, h)]
    difference = (u[1] - u[0]) / (2 * h)
    # the rate is taken with the factor of the last but one iteration, where the residual was 5e-7
    assert np.abs(at.rate - difference).max() < 1e-5
    assert np.abs(at.rate).max() > 0.5  # the surface under the ball moves nearly as the ball


def test_old_factors_lead_to_the_same_equilibrium(graded):
    """The chord method takes fewer factorisations to the same displacement."""
    system, near = graded.system(), graded.travel([0.9], PENALTY_ONLY)[0].evaluation.u
    full, lazy = Counters(), Counters()
    u = newton.solve(system, near, graded.load(1.0), 1e-11, full).evaluation.u
    v = newton.solve(system, near, graded.load(1.0), 1e-11, lazy, known=(None, None)).evaluation.u
    np.testing.assert_allclose(v, u, rtol=0, atol=1e-9)  # mm; the residuals are 1e-11 of the force
    assert lazy.factorisations < full.factorisations


@pytest.mark.parametrize("law", ["neo_hookean", "linear_elastic"])
def test_force_on_the_indenter_is_the_reaction_of_the_support(graded, law):
    r = graded.solve([0.4, 0.8], law=law)
    assert np.all(r.Fz > 0)
    np.testing.assert_allclose(r.reaction[:, 2], r.Fz, rtol=1e-6)  # the tolerance of the residual is 1e-9


def test_run_to_two_is_in_balance_and_monotonic(to_two):
    np.testing.assert_allclose(to_two.reaction[:, 2], to_two.Fz, rtol=1e-6)
    assert 0 < to_two.Fz[0] < to_two.Fz[1]
    deepest = to_two.channels["uz_max"]
    assert np.all(deepest < 1.1 * to_two.travel) and np.all(deepest > 0.5 * to_two.travel)


# -------------------------------------------------------------------------------------- what an answer depends on


def test_answer_does_not_depend_on_the_way(graded, to_two):
    """F at 2 mm asked alone and among others: Newton is converged so far that the start does not show."""
    alone = graded.solve([2.0])
    among = graded.solve([0.3, 0.71, 1.0, 1.9, 2.0])
    np.testing.assert_allclose([alone.Fz[-1], among.Fz[-1]], to_two.Fz[-1], rtol=1e-7)
    np.testing.assert_allclose(among.Fz[2], to_two.Fz[0], rtol=1e-7)


def test_answer_does_not_depend_on_the_step_control(graded, to_two):
    r = graded.solve([1.0, 2.0], control=Control(first=0.07, largest=0.35, loose=1e-3))
    np.testing.assert_allclose(r.Fz, to_two.Fz, rtol=1e-7)


def test_loose_tolerance_shows(graded, to_two):
    """Negative control of both: with a tolerance of 1e-3 the way would be seen at 1e-7."""
    r = graded.solve([0.3, 0.71, 1.0, 1.9, 2.0], control=Control(loose=3e-2, medium=1e-2, tight=1e-2))
    assert abs(r.Fz[-1] / to_two.Fz[-1] - 1) > 1e-7


def test_second_run_has_the_same_bits(graded, to_two):
    again = graded.solve([1.0, 2.0])
    for name, channel in to_two.channels.items():
        assert again.channels[name].tobytes() == channel.tobytes(), name
    assert again.reaction.tobytes() == to_two.reaction.tobytes()
    assert again.contact_error.tobytes() == to_two.contact_error.tobytes()
    assert replace(again.counters, deadline=0.0) == replace(to_two.counters, deadline=0.0)


def test_solvers_give_the_same_answer(make_bench):
    pytest.importorskip("pypardiso")
    results = [make_bench(solver=solver).solve([1.0]).Fz for solver in ("superlu", "pardiso")]
    np.testing.assert_allclose(results[0], results[1], rtol=1e-8)


# ---------------------------------------------------------------------------------------------- energy


def test_work_of_the_indenter_is_the_energy_stored(small):
    """∫ F ds = W + Π_c (contact by penalty alone, so that nothing is put in by multipliers).

    By the trapezoidal rule, of second order although contact points that switch leave kinks in dF/ds.
    """
    error = []
    for count in (9, 33):
        s = np.linspace(0.5, 1.5, count)
        points = small.travel(list(s), replace(PENALTY_ONLY, medium=1e-9))
        E = np.array([p.evaluation.energy for p in points])
        work = np.trapezoid([p.force[2] for p in points], s)
        error.append(abs(work / (E[-1] - E[0]) - 1))
    assert error[0] < 2e-3 and error[1] < error[0] / 8, error  # four times the points: a sixteenth of the error
    assert abs(1.01 * work / (E[-1] - E[0]) - 1) > 100 * error[1]  # negative control


def test_energy_is_the_strain_energy_and_that_of_the_contact(graded):
    """The potential from its definition, with invariants by numpy."""
    point = graded.travel([1.0], PENALTY_ONLY)[0]
    pair, law = graded.system().indenter, graded.system().material.law
    at, body, w = point.evaluation, graded.model.body, pair.surface.weights
    F = at.H + np.eye(3)
    J = np.linalg.det(F)
    i1 = np.einsum("mqij,mqij->mq", F, F) * J ** (-2 / 3)
    strain = float((body.w * (0.5 * law.mu * (i1 - 3) + (J - 1) ** 2 / law.D1)).sum())
    touch = float((w * 0.5 * pair.epsilon * np.minimum(at.contact.gap, 0.0) ** 2).sum())
    np.testing.assert_allclose(at.energy, strain + touch, rtol=1e-10)
    assert 0 < touch < 0.05 * strain  # the penalty is stiff


# ---------------------------------------------------------------------------------------------- failure


@pytest.mark.verification  # daily by the backend: test_failures.py
def test_too_deep_is_stopped_with_a_cause_and_what_was_reached(small):
    with pytest.raises(Stopped) as stopped:
        small.solve([1.0, 30.0])
    failure = stopped.value
    assert failure.cause in CAUSES
    assert [p.travel for p in failure.points] == [1.0]
    assert failure.counters.cutbacks > 0 and failure.history
    assert "mm" in str(failure)
    at = initial_state.initial_state(small.settings, small.knobs, small.placement, small.model, Counters())
    reached = indentation.collect(at, failure.points, failure.counters, 0.0)
    # the points reached are answers like any other
    np.testing.assert_allclose(reached.Fz, small.solve([1.0]).Fz, rtol=1e-12)


def test_no_iterations_no_equilibrium(graded):
    with pytest.raises(NotConverged, match="2 iterations") as stopped:
        newton.solve(graded.system(), np.zeros_like(graded.model.body.nodes), graded.load(0.5), 1e-9, Counters(), 2)
    assert stopped.value.cause in CAUSES and len(stopped.value.history) == 2


def test_inverted_start_is_an_inversion(graded):
    u = np.zeros_like(graded.model.body.nodes)
    u[:, 2] = -2.0 * graded.model.body.nodes[:, 2]  # the mirror image
    with pytest.raises(NotConverged) as stopped:
        newton.solve(graded.system(), u, graded.load(0.5), 1e-9, Counters())
    assert stopped.value.cause == "inversion"


def test_step_limit_keeps_the_history(graded, monkeypatch):
    """A solver that never converges ends in a step limit after the cut-backs that the control allows, not in a loop."""
    calls = []

    def never(*arguments, **more):
        calls.append(1)
        raise NotConverged("contact", "no", (1.0, 0.5))

    monkeypatch.setattr(newton, "solve", never)
    with pytest.raises(Stopped) as stopped:
        graded.travel([1.0], Control(first=0.16, smallest=0.1))
    assert stopped.value.cause == "step_limit" and stopped.value.history == (1.0, 0.5)
    assert stopped.value.points == [] and len(calls) == 4  # 0.16, 0.08, 0.04, 0.02; 0.01 < 0.016
