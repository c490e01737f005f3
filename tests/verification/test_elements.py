"""The element itself: patch tests on distorted and curved elements, and the orders that theory promises."""

from __future__ import annotations

import numpy as np
import pytest
from cube import box
from skfem import ElementTetP2, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend.kinematics import tetrahedra
from fem_backend.laws import Material, NeoHooke
from fem_backend.solver import direct, newton
from fem_backend.solver.newton import Counters, Load, System

pytestmark = pytest.mark.verification

A = np.array([[0.1, 0.2, -0.05], [0.0, -0.15, 0.1], [0.05, 0.0, 0.2]])  # a large homogeneous deformation
LAWS = {"K/mu = 2": NeoHooke(0.01, 100.0), "K/mu = 200": NeoHooke(0.01, 1.0)}


def equilibrium(mesh: MeshTet2, inner: np.ndarray, boundary: np.ndarray, law, dead=None) -> np.ndarray:
    """Displacement (n, 3) with the outer nodes where `boundary` (n, 3) puts them, from a start of its harmonic kind."""
    body = tetrahedra.discretise(mesh, ~np.repeat(inner[:, None], 3, 1))
    system = System(body, Material(law), None, (), direct.solver(body.pattern), None, dead, least_force=law.mu)
    u = np.zeros_like(boundary)
    for share in np.linspace(0.25, 1.0, 4):
        u = np.where(inner[:, None], u, share * boundary)
        u = newton.solve(system, u, Load(None, dead=share), 1e-11, Counters()).evaluation.u
    return u


@pytest.mark.parametrize("name", LAWS)
def test_patch_of_distorted_straight_elements_is_exact(record, name):
    """Boundary on x ↦ (I + A) x, inside solved for: the same map, whatever the shape of the elements."""
    mesh, inner = box(3, corners=0.25)
    exact = mesh.doflocs.T @ A.T
    u = equilibrium(mesh, inner, exact, LAWS[name])
    error = np.abs(u - exact).max() / np.abs(exact).max()
    record(f"patch test on distorted straight elements, {name}: error of u", f"{error:.0e}")
    assert inner.sum() > 100 and error < 1e-9  # the residual is 1e-11 of the forces


def test_patch_of_curved_elements_converges_with_their_curvature(record):
    """Four points do not integrate cof J ∇N of a curved element exactly: the error vanishes with the curvature."""
    kappa = np.array([0.1, 0.05, 0.025])
    error = []
    for k in kappa:
        mesh, inner = box(3, corners=0.15, middles=k)
        exact = mesh.doflocs.T @ A.T
        error.append(np.abs(equilibrium(mesh, inner, exact, LAWS["K/mu = 2"]) - exact).max() / np.abs(exact).max())
    rate = np.diff(np.log(error)) / np.diff(np.log(kappa))
    record(
        "patch test on curved elements (mid-edge nodes off by 0.1, 0.05, 0.025 h): error of u, rates",
        f"{', '.join(f'{e:.1e}' for e in error)}; {np.round(rate, 2).tolist()}",
    )
    assert np.all(rate > 0.9) and error[0] < 5e-3


# ---------------------------------------------------------------------------------------------- manufactured solution


def solution(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (…, 3) and its gradient (…, 3, 3), strains up to 30 %."""
    x, y, z = np.moveaxis(X, -1, 0)
    s, c = np.sin, np.cos
    u = 0.1 * np.stack([s(2 * y) * c(z), s(2 * z) * c(x), s(2 * x) * c(y)], -1)
    H = np.zeros((*X.shape, 3))
    H[..., 0, 1], H[..., 0, 2] = 2 * c(2 * y) * c(z), -s(2 * y) * s(z)
    H[..., 1, 2], H[..., 1, 0] = 2 * c(2 * z) * c(x), -s(2 * z) * s(x)
    H[..., 2, 0], H[..., 2, 1] = 2 * c(2 * x) * c(y), -s(2 * x) * s(y)
    return u, 0.1 * H


def first_piola(X: np.ndarray, mu: float, D1: float) -> np.ndarray:
    """P (…, 3, 3) of the neo-Hookean law at the manufactured solution, from its textbook form."""
    F = np.eye(3) + solution(X)[1]
    J = np.linalg.det(F)[..., None, None]
    i1 = (F**2).sum((-1, -2))[..., None, None]
    Fit = np.swapaxes(np.linalg.inv(F), -1, -2)
    return mu * J ** (-2 / 3) * (F - i1 / 3 * Fit) + 2 / D1 * (J - 1) * J * Fit


def body_force(X: np.ndarray, mu: float, D1: float) -> np.ndarray:
    """−Div P (…, 3) MPa/mm by central differences of sixth order: exact to about 1e-11."""
    h, out = 1e-2, np.zeros_like(X)
    for j in range(3):
        for k, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
            step = k * h * np.eye(3)[j]
            out -= w / h * (first_piola(X + step, mu, D1) - first_piola(X - step, mu, D1))[..., j]
    return out


def errors(cells: int, law: NeoHooke) -> tuple[float, float]:
    """Relative errors of u in L2 and of its gradient in L2 (H1 seminorm) on a distorted mesh."""
    mesh, inner = box(cells, corners=0.15)
    xi, w = get_quadrature(RefTet, 6)
    N, dN = (np.stack([ElementTetP2().lbasis(xi, a)[k] for a in range(10)]) for k in (0, 1))  # (10, q), (10, 3, q)
    X, cells_ = mesh.doflocs.T, mesh.dofs.element_dofs.T
    points = np.einsum("aq,mai->mqi", N, X[cells_])
    jacobian = np.einsum("mai,ajq->mqij", X[cells_], dN)
    dV = np.abs(np.linalg.det(jacobian)) * w
    G = np.einsum("ajq,mqji->mqai", dN, np.linalg.inv(jacobian))
    dead = np.zeros_like(X)
    np.add.at(dead, cells_, np.einsum("mq,aq,mqi->mai", dV, N, body_force(points, law.mu, law.D1)))
    u = equilibrium(mesh, inner, solution(X)[0], law, dead)
    exact, H = solution(points)
    e = np.einsum("aq,mai->mqi", N, u[cells_]) - exact
    eH = np.einsum("mai,mqaj->mqij", u[cells_], G) - H
    return (
        float(np.sqrt((dV[..., None] * e**2).sum() / (dV[..., None] * exact**2).sum())),
        float(np.sqrt((dV[..., None, None] * eH**2).sum() / (dV[..., None, None] * H**2).sum())),
    )


@pytest.mark.parametrize("name", LAWS)
def test_manufactured_solution_has_the_orders_of_theory(record, name):
    """u to h³ in L2 and ∇u to h²; nearly incompressible too: no locking, the constants alone grow."""
    n = np.array([3, 5, 8])
    e = np.array([errors(int(k), LAWS[name]) for k in n])
    orders = -np.diff(np.log(e), axis=0) / np.diff(np.log(n))[:, None]
    record(
        f"manufactured solution, {name}: orders of u and grad u (theory 3 and 2); errors on the finest mesh",
        f"{orders[-1, 0]:.2f} and {orders[-1, 1]:.2f}; {e[-1, 0]:.1e} and {e[-1, 1]:.1e}",
    )
    assert np.all(orders[-1] > [2.7, 1.8]), orders
    assert np.all(orders[-1] < [4.0, 3.0]), orders


def test_manufactured_solution_sees_a_wrong_law(monkeypatch):
    """Negative control: the body force of a law 1 % stiffer, and the orders are gone."""
    wrong = NeoHooke(0.0101, 100.0)
    true = body_force
    monkeypatch.setattr("test_elements.body_force", lambda X, mu, D1: true(X, wrong.mu, wrong.D1))
    e = np.array([errors(k, LAWS["K/mu = 2"]) for k in (3, 6)])
    assert np.log(e[0, 0] / e[1, 0]) / np.log(2.0) < 2.5
