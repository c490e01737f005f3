"""Energy, contact, friction and relaxation: what physics says about every answer, on the coarse level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from physics import (
    SOFT,
    check_complementarity,
    check_coulomb,
    check_energy_balance,
    check_friction_dissipates,
    check_normals,
    loop_work,
    prepare,
    programme_points,
    ramp,
    relaxed,
    there_and_back,
)

from fem_backend.contact import tractions
from rso.contract import Programme

pytestmark = pytest.mark.verification
PRONY = replace(SOFT, prony_g=0.4, prony_tau=2.0)


def percent(values) -> str:
    return " ".join(f"{100 * v:+.3f}" for v in np.atleast_1d(values))


# ---------------------------------------------------------------------------------------------- energy


def test_work_of_the_indenter_is_the_energy_stored(record):
    coarse, fine = check_energy_balance(21), check_energy_balance(81)
    record(
        "work of the indenter over energy stored, 3 mm in 20 and 80 steps",
        f"{100 * coarse:+.4f} %, {100 * fine:+.4f} %",
    )
    assert abs(fine) < abs(coarse) / 4


@pytest.mark.parametrize(
    "name,knobs",
    [
        ("elastic", SOFT),
        ("friction 0.3", replace(SOFT, friction=0.3)),
        ("friction 1", replace(SOFT, friction=1.0)),
        ("Prony", PRONY),
        ("Mullins", replace(SOFT, mullins=0.4)),
    ],
)
def test_a_loop_gives_no_energy_out(record, name, knobs):
    """∮ F ds ≥ 0 down to 2 mm and up again; the elastic loop is closed but for the tolerance."""
    b = prepare(knobs)
    net, loading = loop_work(b.path(there_and_back(2.0, 24), b.settings.control))
    record(f"{name}: energy lost in a loop to 2 mm over the work of loading", f"{100 * net / loading:+.3f} %")
    if name == "elastic":
        assert abs(net) < 1e-5 * loading
    else:
        assert net > 0.0


def test_friction_takes_energy_at_every_point(record):
    work = check_friction_dissipates()
    record("work of friction on the body relative to the ball, one step from 1 to 1.3 mm", f"{work:.2e} N mm")


# ---------------------------------------------------------------------------------------------- contact


def test_contact_is_complementary(record):
    check_normals()
    found = []
    for k in (1, 4):
        deepest, product, shear = check_complementarity(k)
        found.append((deepest, product))
        record(
            f"contact at 3 mm after {k} augmentations: penetration over R, integral of p times abs(g) over F R",
            f"{deepest:.1e}, {product:.1e}",
        )
        assert shear == 0.0
    assert found[1] < found[0]


def test_force_is_that_of_the_pressure(record):
    """F = ∫ p n dA₀ from the points, and the reaction of the support."""
    b = prepare(SOFT)
    r = b.solve(ramp(1.0, 3.0))
    pair, p = b.bench().system.indenter, r.points[-1]
    x = b.model.body.nodes + p.evaluation.u
    n = tractions.contact_points(pair.surface, x) - p.load.indenter.centre
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    F = -4 * (pair.surface.weights[..., None] * p.evaluation.contact.pressure[..., None] * n).sum((0, 1))[2]
    record(
        "force over integral of the pressure, and over the reaction of the support",
        f"{r.Fz[-1] / F - 1:+.0e}, {r.Fz[-1] / r.reaction[-1, 2] - 1:+.0e}",
    )
    np.testing.assert_allclose(r.Fz[-1], F, rtol=1e-10)
    np.testing.assert_allclose(r.Fz, r.reaction[:, 2], rtol=1e-7)


# ---------------------------------------------------------------------------------------------- friction


def test_friction_tends_to_frictionless(record):
    """F(μ_f) − F(0) ~ μ_f."""
    smooth = prepare(SOFT).solve(ramp(1.0, 2.0)).Fz
    mu_f = np.array([0.02, 0.01, 1e-4])
    more = np.array([prepare(replace(SOFT, friction=float(f))).solve(ramp(1.0, 2.0)).Fz / smooth - 1 for f in mu_f])
    record("friction 0.02, 0.01, 0.0001: force over the frictionless one at 2 mm", percent(more[:, 1]) + " %")
    assert np.all(np.abs(more[2]) < 1e-4)
    assert np.all(np.abs(more[0]) < 0.02)


def test_friction_stays_below_its_limit_and_large_friction_sticks(record):
    slipping, force = [], []
    for f in (0.05, 0.3, 1.0, 5.0):
        _, share = check_coulomb(f)
        slipping.append(share)
        force.append(prepare(replace(SOFT, friction=f)).solve(ramp(2.0)).Fz[0])
    record("share of the contact that slips, friction 0.05, 0.3, 1, 5", " ".join(f"{s:.3f}" for s in slipping))
    record("force at 2 mm, friction 0.05, 0.3, 1 over 5", percent(np.array(force[:-1]) / force[-1] - 1) + " %")
    assert slipping[0] > 0.5 and slipping[-1] < 0.01  # points that have just come into contact may slip in that step
    assert np.all(np.diff(slipping) < 2e-3) and np.all(np.diff(force) > -1e-3 * force[-1])


# ---------------------------------------------------------------------------------------------- relaxation


def test_fast_is_instantaneous_and_slow_is_relaxed(record):
    fast, slow = (prepare(PRONY).solve(ramp(1.0, 2.0, speed=v)).Fz for v in (1e4, 1e-4))
    instant, at_rest = (prepare(k).solve(ramp(1.0, 2.0)).Fz for k in (replace(SOFT), relaxed(PRONY)))
    record(
        "Prony: fast test over the instantaneous body, slow test over the relaxed one, 1 and 2 mm",
        f"{percent(fast / instant - 1)} %, {percent(slow / at_rest - 1)} %",
    )
    np.testing.assert_allclose(fast, instant, rtol=1e-3)
    np.testing.assert_allclose(slow, at_rest, rtol=1e-3)
    assert np.all(instant > 1.3 * at_rest)


def test_a_hold_relaxes_as_its_prony_series(record):
    """Incompressible enough (K/μ = 200), F(t)/F(∞) in a hold follows 1 + c exp(−t/τ)."""
    knobs = replace(PRONY, D1=1.0)
    times = 1e-3 + np.array([0.0, 1.0, 2.0, 4.0, 8.0, 60.0])
    programme = Programme((0.0, 1e-3, 70.0), (0.0, 2.0, 2.0), (2.0,), tuple(times[1:]))
    F = programme_points(prepare(knobs), programme).Fz
    rest = prepare(relaxed(knobs)).solve(ramp(2.0)).Fz[0]
    record("hold after a fast ramp: F at the end over the relaxed body", percent(F[-1] / rest - 1) + " %")
    np.testing.assert_allclose(F[-1], rest, rtol=1e-3)
    decay = np.log((F[1:4] - rest) / (F[2:5] - rest)) / np.diff(times[1:5])
    record("hold: relaxation time from the force over that of the material", percent(1 / decay / 2.0 - 1) + " %")
    np.testing.assert_allclose(1 / decay, 2.0, rtol=0.05)


@pytest.mark.parametrize("speed,limit", [(1e4, 1e-3), (1e-5, 1e-3), (0.5, None)])
def test_relaxation_loses_most_in_between(record, speed, limit):
    """Loops that are fast or slow against τ lose nothing, those of its order do."""
    b = prepare(PRONY)
    net, loading = loop_work(b.path(there_and_back(1.5, 10, speed), b.settings.control))
    record(f"Prony: energy lost in a loop at {speed:g} mm/s over the work of loading", f"{100 * net / loading:+.3f} %")
    assert abs(net) < limit * loading if limit else net > 0.05 * loading
