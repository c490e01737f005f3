from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import sparse

from fem_backend import contact, indentation, meshing
from fem_backend.geometry import Ellipsoid, Sphere, hertz_radius
from fem_backend.stepping import Control, Stopped


@dataclass(frozen=True)
class WrongWay(Sphere):
    """Negative control: the normal points into the indenter."""

    def gap(self, x, c):
        g, n, hessian = super().gap(x, c)
        return g, -n, hessian


STEPS = 10.0 ** np.array([-1.0, -1.5, -2.0, -2.5])


@pytest.fixture(scope="module")
def pressed(graded):
    """A state in contact, off equilibrium: surface nodes waved by 0.05 mm, multipliers of the size of the pressure."""
    system, load = graded.system(), graded.load(0.8)
    X = graded.model.body.nodes
    x = X + 0.05 * np.sin(X[:, [1, 2, 0]])
    shape = graded.model.surface.weights.shape
    multiplier = 0.1 * system.epsilon * np.random.default_rng(1).uniform(0, 1, shape)
    return system, replace(load, multiplier=multiplier), x


def evaluate(system, load, x, indenter=None):
    return contact.evaluate(
        system.surface, x, indenter or system.indenter, load.centre, system.epsilon, load.multiplier
    )


def safe_direction(system, load, x) -> np.ndarray:
    """A rough direction so small that no contact point opens or closes along it (those are kinks of the tangent)."""
    v = np.random.default_rng(2).normal(size=x.shape) + np.array([0.0, 0.0, 1.0])
    at = evaluate(system, load, x)
    margin = np.abs(load.multiplier - system.epsilon * at.gap) / system.epsilon
    points = np.einsum("qa,fai->fqi", system.surface.N, v[system.surface.facets])
    return v * float((margin / np.linalg.norm(points, axis=-1)).min()) / STEPS.max() * 0.5


def test_there_is_contact_and_no_contact(pressed):
    """The suite itself: both kinds of points are present."""
    pressure = evaluate(*pressed).pressure
    assert 10 < np.count_nonzero(pressure > 0) < pressure.size - 10


def test_residual_is_the_derivative_of_the_energy(pressed, slopes):
    system, load, x = pressed
    v = safe_direction(system, load, x)

    def taylor(indenter: Sphere) -> np.ndarray:
        at = evaluate(system, load, x, indenter)
        first = float((at.residual * v).sum())
        return np.array([
            abs(evaluate(system, load, x + t * v, indenter).energy - at.energy - t * first) for t in STEPS
        ])  # fmt: skip

    np.testing.assert_allclose(slopes(taylor(system.indenter), STEPS), 2.0, atol=0.1)
    assert np.all(slopes(taylor(WrongWay(system.indenter.R)), STEPS) < 1.5)  # the wrong sign leaves O(t)


@pytest.mark.parametrize("geometric", [True, False])
def test_tangent_is_the_derivative_of_the_residual(pressed, slopes, geometric, graded):
    """With the geometric term slope 2; without it (the fallback of Newton) an O(t) error stays."""
    system, load, x = pressed
    body = system.body
    v = safe_direction(system, load, x)
    v[(body.free < 0).reshape(v.shape)] = 0.0
    at = evaluate(system, load, x)
    data = np.zeros(len(body.pattern.indices))
    contact.tangent(
        system.surface, x, system.indenter, load.centre, system.epsilon, at.pressure, load.direction, data, geometric
    )
    upper = sparse.csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(body.pattern.size,) * 2)
    K = upper + sparse.triu(upper, 1).T
    mask = body.free >= 0
    order = body.free[mask]

    def reduced(r: np.ndarray) -> np.ndarray:
        out = np.empty(body.pattern.size)
        out[order] = r.ravel()[mask]
        return out

    Kv = K @ reduced(v)
    error = np.array([
        np.linalg.norm(reduced(evaluate(system, load, x + t * v).residual - at.residual) - t * Kv) for t in STEPS
    ])  # fmt: skip
    if geometric:
        np.testing.assert_allclose(slopes(error, STEPS), 2.0, atol=0.1)
    else:
        assert np.all(slopes(error, STEPS) < 1.5)
        assert sparse.linalg.eigsh(K, 1, which="SA", return_eigenvectors=False)[0] > -1e-9 * abs(K).max()


def test_moving_the_indenter_changes_the_residual_as_predicted(pressed, slopes):
    """∂R/∂s for c + s·direction, the right-hand side of the predictor."""
    system, load, x = pressed
    load = replace(load, direction=np.array([0.3, -0.2, -0.9]))
    at = evaluate(system, load, x)
    rate = contact.tangent(
        system.surface, x, system.indenter, load.centre, system.epsilon, at.pressure, load.direction,
        np.zeros(len(system.body.pattern.indices)),
    )  # fmt: skip
    margin = (np.abs(load.multiplier - system.epsilon * at.gap) / system.epsilon).min()
    steps = 0.9 * margin * np.array([1.0, 0.3, 0.1])
    error = [
        np.linalg.norm(
            evaluate(system, replace(load, centre=load.centre + s * load.direction), x).residual
            - at.residual
            - s * rate
        )
        for s in steps
    ]
    np.testing.assert_allclose(slopes(np.array(error), steps), 2.0, atol=0.1)


def test_forces_are_in_balance(pressed):
    """What the body gets (−∂Π/∂u) the indenter gives, and the moments about its centre vanish without friction."""
    system, load, x = pressed
    at = evaluate(system, load, x)
    np.testing.assert_allclose(-at.residual.sum(0), -at.force, rtol=1e-12)
    moment = np.cross(x - load.centre, at.residual).sum(0)
    # nodes are not the contact points, but shape functions hold linear fields: Σ x_a N_a is the point
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * np.abs(at.residual).sum() * system.indenter.R)
    assert at.force[2] > 0  # the body pushes the indenter up
    assert evaluate(system, load, x, WrongWay(system.indenter.R)).force[2] < 0  # negative control


def test_pressure_is_that_of_its_definition(pressed):
    """p = ⟨λ − ε g⟩ with g = |x − c| − R at points of the quadratic surface, one by one."""
    system, load, x = pressed
    at = evaluate(system, load, x)
    s = system.surface
    for f, q in [(0, 0), (3, 5), (len(s.facets) - 1, s.N.shape[0] - 1)]:
        point = sum(s.N[q, a] * x[s.facets[f, a]] for a in range(6))
        gap = np.sqrt(((point - load.centre) ** 2).sum()) - system.indenter.R
        np.testing.assert_allclose(at.gap[f, q], gap, rtol=1e-12, atol=1e-14)
        epsilon = np.broadcast_to(system.epsilon, at.gap.shape)[f, q]
        np.testing.assert_allclose(at.pressure[f, q], max(load.multiplier[f, q] - epsilon * gap, 0.0), rtol=1e-10)


def test_augmentation_makes_contact_complementary(graded):
    """p ≥ 0, g → 0 where p > 0 and p·g → 0: every augmentation takes most of the rest away."""
    penetration, work = [], []
    for k in (0, 1, 3):
        point = graded.travel([1.0], Control(augmentations=k))[-1]
        at = point.equilibrium.evaluation.contact
        w = graded.model.surface.weights
        assert at.pressure.min() >= 0.0
        assert np.all(at.gap[at.pressure == 0] > -1e-9)  # open points do not penetrate
        penetration.append(max(-at.gap.min(), 0.0))
        work.append(abs(float((w * at.pressure * at.gap).sum())) / float((w * at.pressure).sum()))
    assert penetration[0] < 0.05 and penetration[2] < 0.3 * penetration[0], penetration  # mm of 1 mm travel
    assert work[1] < 0.5 * work[0] and work[2] < 0.2 * work[0], work


def test_body_does_not_resist_an_indenter_with_the_normal_reversed(graded):
    """Negative control of the whole chain: equilibrium under the reversed indenter is missing or pulls it in."""
    wrong = replace(graded.settings, indenter=WrongWay(graded.settings.indenter.R))
    law = graded.system().law
    try:
        force = indentation.solve(wrong, law, graded.model, np.array([0.5])).Fz[0]
    except Stopped:
        return
    assert not force > 0


# ---------------------------------------------------------------------------------------------- geometry


def test_surface_area_is_that_of_the_sphere(make_bench):
    """Weights of all curved facets of a quarter sphere add up to πr²; quadratic facets of 6 mm are exact to 1e-3."""
    ball = make_bench({"mesher": "mapped", "n": 8, "slip": 0.0}, specimen={"semi_axes": [30.0, 30.0, 30.0]})
    facets = indentation._curved_facets(meshing.quadratic(ball.settings.body, meshing.make(ball.settings.recipe)))
    whole = contact.contact_surface(ball.model.body, facets)
    np.testing.assert_allclose(whole.weights.sum(), np.pi * 30.0**2, rtol=1e-3)


def test_gap_derivatives():
    """n = ∇g and ∇∇g by complex step on g(x) = |x − c| − R written out here."""
    rng = np.random.default_rng(0)
    x, c, R, h = rng.normal(size=(5, 3)) * 4, rng.normal(size=3), 3.0, 1e-30
    g, n, hessian = Sphere(R).gap(x, c)
    np.testing.assert_allclose(g, np.sqrt(((x - c) ** 2).sum(1)) - R, rtol=1e-14)
    for k in range(3):
        z = (x - c).astype(complex)
        z[:, k] += 1j * h
        r = np.sqrt((z**2).sum(1))
        np.testing.assert_allclose(n[:, k], r.imag / h, rtol=1e-13)
        np.testing.assert_allclose(hessian[:, :, k], (z / r[:, None]).imag / h, rtol=1e-12, atol=1e-14)


def test_hertz_radius_of_two_spheres_and_of_the_specimen():
    assert hertz_radius(Ellipsoid(300.0, 300.0, 300.0), Sphere(3.0)) == pytest.approx(1 / (1 / 3 + 1 / 300), rel=1e-15)
    # curvatures at the pole of the ellipsoid from its height z(x, 0) and z(0, y) by second differences
    a, b, c, h = 60.0, 35.0, 35.0, 1e-3
    kx = 2 * (c - c * np.sqrt(1 - (h / a) ** 2)) / h**2
    ky = 2 * (c - c * np.sqrt(1 - (h / b) ** 2)) / h**2
    assert hertz_radius(Ellipsoid(a, b, c), Sphere(3.0)) == pytest.approx(1 / (1 / 3 + (kx + ky) / 2), rel=1e-6)
