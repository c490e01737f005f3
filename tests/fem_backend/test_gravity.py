"""Weight: a column in closed form, and the sag of the specimen before it is touched."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from skfem import MeshTet, MeshTet2

from fem_backend.kinematics import tetrahedra
from fem_backend.laws import LinearElastic, Material, NeoHooke
from fem_backend.materials import zones
from fem_backend.simulation import assembly
from fem_backend.solver import direct, newton
from fem_backend.solver.newton import Counters, Load, System

L, MU, D1 = 10.0, 0.01, 5.8
LAWS = {"linear_elastic": LinearElastic, "neo_hookean": NeoHooke}


def column(law, weight: float, n: int, sign: float = -1.0) -> tuple[tetrahedra.Body, np.ndarray]:
    """A column 1 × 1 × L mm held at z = 0 that slides on its sides, under its weight (N/mm³): nodes and u (n, 3) mm."""
    mesh = MeshTet2.from_mesh(MeshTet.init_tensor(np.linspace(0, 1, 2), np.linspace(0, 1, 2), np.linspace(0, L, n + 1)))
    X = mesh.doflocs.T
    held = np.zeros(X.shape, bool)
    held[:, 0] = held[:, 1] = True  # no sideways motion: uniaxial strain
    held[:, 2] = X[:, 2] == 0.0
    body = tetrahedra.discretise(mesh, held)
    dead = weight * assembly.nodal_weight(body, np.ones_like(body.w))[:, None] * np.array([0.0, 0.0, sign])
    system = System(body, Material(law(MU, D1)), None, (), direct.solver(body.pattern, "superlu"), None, dead)
    u = np.zeros_like(X)
    for share in (0.25, 0.5, 0.75, 1.0):
        u = newton.solve(system, u, Load(None, dead=share), 1e-10, Counters()).evaluation.u
    return body, u


def nominal_stress(law: str, stretch: float) -> float:
    """dW/dλ (MPa) in uniaxial strain, F = diag(1, 1, λ), J = λ, Ī₁ = (2 + λ²) λ^(−2/3)."""
    K = 2.0 / D1
    if law == "linear_elastic":
        return (K + 4 / 3 * MU) * (stretch - 1)
    return 0.5 * MU * (2 * stretch ** (1 / 3) - 2 / 3 * (2 + stretch**2) * stretch ** (-5 / 3)) + K * (stretch - 1)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_sag_of_a_column_is_that_of_a_bar(law, sign):
    """P(λ(z)) = ±γ (L − z) integrated: u(L) = ∫ (λ − 1) dz, to 1e-5 on ten elements (error ~ h⁴).

    Linear elasticity: u(L) = ∓γ L²/(2M), quadratic in z, which quadratic elements hold exactly.
    """
    weight = 0.3 * MU  # several per cent of strain at the foot
    body, u = column(LAWS[law], weight, 10, sign)

    def stretch(z: float) -> float:
        return brentq(lambda s: nominal_stress(law, s) - sign * weight * (L - z), 0.2, 3.0, xtol=1e-14)

    exact = solve_ivp(lambda z, y: [stretch(z) - 1.0], (0.0, L), [0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    top = u[body.nodes[:, 2] == L, 2]
    np.testing.assert_allclose(top, exact, rtol=1e-9 if law == "linear_elastic" else 1e-5)
    if law == "linear_elastic":
        np.testing.assert_allclose(exact, sign * weight * L**2 / (2 * (2 / D1 + 4 / 3 * MU)), rtol=1e-8)
        M = 2 / D1 + 4 / 3 * MU
        z = body.nodes[:, 2]
        np.testing.assert_allclose(u[:, 2], sign * weight * (L * z - 0.5 * z**2) / M, atol=1e-10)
    assert np.sign(exact) == sign and abs(exact) > 0.1 * weight * L**2


def test_weight_is_that_of_the_volume(small):
    """Σ of the nodal loads is the weight of the modelled part, and its first moment that of the volume."""
    body = small.model.body
    dead = small.other(weight=1e-5).system().dead
    np.testing.assert_allclose(dead.sum(0), [0.0, 0.0, -1e-5 * body.w.sum()], rtol=1e-12, atol=1e-18)
    points = np.einsum("qa,mai->mqi", tetrahedra.shape_functions(), body.nodes[body.cells])
    centre = (body.w[..., None] * points).sum((0, 1))
    np.testing.assert_allclose(body.nodes.T @ dead[:, 2], -1e-5 * centre, rtol=1e-10, atol=1e-12)


def test_support_carries_weight_and_force(small):
    """Reaction of the held nodes = force of the indenter + weight of the whole specimen."""
    b = small.other(weight=1e-5)
    r = b.solve([0.5, 1.0])
    weight = 4 * 1e-5 * b.model.body.w.sum()
    np.testing.assert_allclose(r.reaction[:, 2], r.Fz + weight, rtol=1e-6)


def test_a_hole_weighs_nothing(small):
    """The nodal loads lack the weight of the cavity, as its place says; so does what the support carries."""
    b = small.other(weight=1e-5, cavity=2.5)
    body, hollow = b.model.body, zones.cavity(b.model.body, *b.placement.specimen.hole(b.knobs.cavity))
    missing = 1e-5 * (body.w * hollow).sum()
    full = 1e-5 * body.w.sum()
    assert missing > 0.1 * full
    np.testing.assert_allclose(b.system().dead.sum(0)[2], missing - full, rtol=1e-12)
    r = b.solve([0.5])
    np.testing.assert_allclose(r.reaction[:, 2], r.Fz + 4 * (full - missing), rtol=1e-6)


def test_specimen_sags_first_and_is_touched_later(small):
    """The depth counts from contact with the sagged body: a light one sags in proportion, the first force is small."""
    sag = {}
    for weight in (1e-7, 2e-7, 1e-5):
        b = small.other(weight=weight)
        r = b.solve([0.05, 1.0])
        sag[weight] = r.notes["sag_mm"]
        assert 0 < r.Fz[0] < 0.05 * r.Fz[1]
    assert 0 < sag[1e-7] < sag[1e-5]
    np.testing.assert_allclose(sag[2e-7] / sag[1e-7], 2.0, rtol=1e-3)
    assert small.solve([0.05]).notes["sag_mm"] == 0.0
    # ρ g c²/(2 M) of a bar of its half-height is the scale: within a factor of a few for a body that bulges
    bar = 1e-7 * 35.0**2 / (2 * 3 * 0.01)
    assert 0.2 < sag[1e-7] / bar < 2.0


def test_gravity_turns_with_the_tilt(make_bench):
    """Tilted by 5° about y the weight has a part along x of the specimen."""
    dead = make_bench({"weight": 1e-5, "tilt_y": 5.0}).system().dead.sum(0)
    tilt = np.deg2rad(5.0)
    np.testing.assert_allclose(np.abs(dead[0] / dead[2]), np.tan(tilt), rtol=1e-12)
    assert dead[1] == 0.0 and dead[2] < 0
