"""Negative controls: a model that is wrong in one place, and the named test that sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import physics
import pytest
import test_finite_elements

from fem_backend import geometry
from fem_backend.contact import tractions
from fem_backend.indenters.sphere import Sphere
from fem_backend.laws import NeoHooke
from fem_backend.materials import stress
from fem_backend.simulation import assembly
from fem_backend.solver.load_steps import Stopped
from fem_backend.solver.newton import NotConverged

pytestmark = pytest.mark.verification


@pytest.fixture
def turned_normal(monkeypatch):
    """Contact normal reversed: the ball pulls where it should push."""
    true = Sphere.gap

    def gap(self, x, centre, direction=geometry.NO_MOTION):
        g, n, hessian = true(self, x, centre, direction)
        return g, -n, -hessian

    monkeypatch.setattr(Sphere, "gap", gap)


def test_reversed_normal_is_seen_by_the_gap(turned_normal):
    with pytest.raises(AssertionError):
        physics.check_normals()


def test_reversed_normal_is_seen_by_complementarity(turned_normal):
    with pytest.raises((AssertionError, Stopped, NotConverged)):
        physics.check_complementarity()


def test_reversed_friction_is_seen_by_its_work(monkeypatch):
    """Friction that helps the body slide."""
    physics.check_friction_dissipates()
    true = tractions.evaluate_contact

    def helping(pair, x, touch):
        state = true(pair, x, touch)
        if pair.friction == 0.0:
            return state
        smooth = true(replace(pair, friction=0.0), x, touch)
        return replace(
            state,
            residual=2 * smooth.residual - state.residual,
            force=2 * smooth.force - state.force,
            traction=-state.traction,
        )

    monkeypatch.setattr(tractions, "evaluate_contact", helping)
    with pytest.raises(AssertionError):
        physics.check_friction_dissipates()


def test_friction_beyond_its_cone_is_seen(monkeypatch):
    """A return map that forgets one per cent."""
    true = tractions.evaluate_contact

    def slack(pair, x, touch):
        return true(replace(pair, friction=1.01 * pair.friction), x, touch)

    monkeypatch.setattr(tractions, "evaluate_contact", slack)
    with pytest.raises(AssertionError):
        physics.check_coulomb(0.05)


def test_wrong_factor_in_the_law_is_seen_by_another_code(monkeypatch):
    """The isochoric part 5 % too stiff: `test_six_effects_in_another_code[plain]` is red."""
    true = stress.evaluate_stress

    def stiffer(material, H, *rest, **more):
        law = material.law
        assert isinstance(law, NeoHooke)
        return true(replace(material, law=NeoHooke(1.05 * law.mu, law.D1)), H, *rest, **more)

    expected = np.array(test_finite_elements.OTHER["cases"]["plain"]["Fz_N"])
    np.testing.assert_allclose(test_finite_elements.forces("plain", "coarse") / expected, 1.0, atol=1.5e-2)
    monkeypatch.setattr(stress, "evaluate_stress", stiffer)
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(test_finite_elements.forces("plain", "coarse") / expected, 1.0, atol=1.5e-2)


def test_wrong_factor_in_the_stress_is_seen_by_the_energy(monkeypatch):
    """Stress 1 % off its energy: the work of the indenter is no longer what is stored."""
    true = stress.evaluate_stress

    def off(*arguments, **more):
        state = true(*arguments, **more)
        C = state.C if state.C is None else 1.01 * state.C
        geometric = state.S_geometric if state.S_geometric is None else 1.01 * state.S_geometric
        return replace(state, S=1.01 * state.S, S_geometric=geometric, C=C)

    physics.check_energy_balance(41)
    monkeypatch.setattr(stress, "evaluate_stress", off)
    with pytest.raises((AssertionError, Stopped)):
        physics.check_energy_balance(41)


def test_wrong_reference_area_is_seen_by_another_code(monkeypatch):
    """A part of the contact surface counted twice: forces on the indenter are no longer those of the body."""
    true = assembly.multiplicity
    monkeypatch.setattr(assembly, "multiplicity", lambda placement: true(placement) * 1.03)
    expected = np.array(test_finite_elements.OTHER["cases"]["plain"]["Fz_N"])
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(test_finite_elements.forces("plain", "coarse") / expected, 1.0, atol=1.5e-2)
