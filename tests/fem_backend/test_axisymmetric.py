"""The element of a meridian, its contact per area now and the mixed Newton, against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix, triu
from scipy.sparse.linalg import spsolve
from scipy.special import iv

from fem_backend.contact import tractions
from fem_backend.contact.tractions import Pair, Touch, contact_surface
from fem_backend.indenters.sphere import Sphere
from fem_backend.kinematics import axisymmetric
from fem_backend.laws import Material
from fem_backend.laws.linear_elastic import LinearElastic
from fem_backend.laws.neo_hooke import NeoHooke
from fem_backend.materials import response
from fem_backend.meshing.meridian import triangulated
from fem_backend.solver import direct, mixed_newton, newton
from fem_backend.solver.load_steps import Control, equilibrate, follow_travel
from fem_backend.solver.newton import Counters, Load, System

MU = 0.01


def cylinder(n: int = 3, held: bool = False, inner: float = 0.0, radius: float = 1.0, height: float = 1.0, m: int = 0):
    """A puck or tube with curved, uneven cells; `held` fixes all of its boundary but the axis."""
    r, z = np.linspace(inner, radius, n + 1), np.linspace(0.0, height, (m or n) + 1)

    def bent(p: np.ndarray) -> np.ndarray:
        a, b = (p[:, 0] - inner) / (radius - inner), p[:, 1] / height
        way = 0.06 * np.sin(np.pi * a) * np.sin(np.pi * b)
        return p + np.column_stack([way * (radius - inner), -way * height])

    mesh = triangulated(r, z, bent)
    fixed = np.zeros((len(mesh.points), 3), bool)
    if held:
        fixed[np.unique(mesh.outline())] = True
    return axisymmetric.discretise(mesh.points, mesh.cells, fixed), mesh


def bumpy(body, size: float = 0.02, seed: int = 1) -> np.ndarray:
    u = size * np.random.default_rng(seed).standard_normal(body.nodes.shape)
    u[:, 1] = 0.0
    u[body.free.reshape(-1, 3)[:, 0] < 0, 0] = 0.0
    return u


def full_matrix(body, data: np.ndarray) -> csr_matrix:
    n = body.pattern.size
    upper = csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(n, n))
    return (upper + triu(upper, 1).T).tocsr()


def test_homogeneous_strain_is_exact_on_any_mesh() -> None:
    """Patch test at finite strain: inner nodes are free of force, the top carries P A in closed form (round-off)."""
    body, mesh = cylinder()
    D1, a, c = 2.0 / (30.0 * MU), 1.2, 0.6  # stretches across and along
    u = body.nodes * (np.array([a, 1.0, c]) - 1.0)
    force = response.material_response(body, Material(NeoHooke(MU, D1)), u, None, 0.0, None).force
    J, I1 = a * a * c, 2 * a * a + c * c
    P = MU * J ** (-2 / 3) * (c - I1 / (3 * c)) + 2.0 / D1 * (J - 1.0) * J / c
    top = mesh.points[:, 1] == 1.0
    assert force[top, 2].sum() == pytest.approx(P * np.pi, rel=1e-12)
    inner = np.ones(len(top), bool)
    inner[np.unique(mesh.outline())] = False
    inner[mesh.points[:, 0] == 0.0] = False
    assert np.abs(force[inner]).max() < 1e-13 * np.abs(force).max() * 10
    assert np.abs(force[~inner]).max() > 0.01 * abs(P)  # a force of zero everywhere would pass


@pytest.mark.parametrize("ratio", [2.0, 1e4])
def test_force_is_the_slope_of_the_energy_and_the_tangent_that_of_the_force(ratio: float) -> None:
    """Central differences, error h² = 1e-10 times third derivatives, which grow with K."""
    body, _ = cylinder(2)
    material = Material(NeoHooke(MU, 2.0 / (ratio * MU)))
    u, d = bumpy(body), bumpy(body, 1.0, 2)

    def at(t: float) -> response.Answer:
        return response.material_response(body, material, u + t * d, None, 0.0, None)

    h = 1e-5
    force = newton.reduced(body, at(0.0).force)
    slope = (at(h).energy - at(-h).energy) / (2 * h)
    assert slope == pytest.approx(float(force @ newton.reduced(body, d)), rel=1e-6)
    change = newton.reduced(body, at(h).force - at(-h).force) / (2 * h)
    K = full_matrix(body, response.material_tangent(body, material, at(0.0).H, None, 0.0, None))
    assert np.linalg.norm(K @ newton.reduced(body, d) - change) < 1e-6 * np.linalg.norm(change)


def test_a_rigid_motion_along_the_axis_changes_nothing() -> None:
    """Of the motions of a body of revolution only this one is rigid; to round-off of the shifted positions."""
    body, _ = cylinder()
    material = Material(NeoHooke(MU, 0.02))
    u = 0.6 * bumpy(body)
    here, there = (
        response.material_response(body, material, u + v, None, 0.0, None) for v in (0.0, np.array([0.0, 0.0, 7.0]))
    )
    assert there.energy == pytest.approx(here.energy, rel=1e-11)
    assert np.abs(there.force - here.force).max() < 1e-10 * np.abs(here.force).max()
    assert abs(here.force[:, 2].sum()) < 1e-12 * np.abs(here.force).max()  # no net force along the axis


def test_what_a_step_carries_is_the_stress_to_first_order() -> None:
    """S + ℂ : δE and p̂ + K Π δJ against stresses evaluated after a small step: an error of second order."""
    body, _ = cylinder(2)
    material = Material(NeoHooke(MU, 2.0 / (100.0 * MU)))
    u, d = bumpy(body), bumpy(body, 1.0, 2)

    def linear(v: np.ndarray) -> response.Linearised:
        return response.linearised(body, material, axisymmetric.displacement_gradients(body, v), None, 0.0, None)

    start, errors = linear(u), []
    for h in (1e-3, 5e-4):
        end, carried = linear(u + h * d), response.stresses_after_step(body, start, h * d)
        errors.append([np.abs(carried.S - end.state.S).max(), np.abs(carried.p - end.volume.p).max()])
    assert np.all(np.array(errors[0]) / np.array(errors[1]) > 3.5)  # 4 for second order, 2 if a term were missing


def test_displacements_converge_with_third_order() -> None:
    """Lamé's tube u_r = A r + B/r, small strains, its boundary held: order 3 (2.7 at least)."""
    A, B, errors = 0.01, 0.02, []
    material = Material(LinearElastic(MU, 2.0 / (50.0 * MU)))
    for n in (4, 8, 16):
        body, _ = cylinder(n, True, 0.5)
        r = body.nodes[:, 0]
        exact = np.column_stack([A * r + B / r, 0 * r, -2.0 * A * body.nodes[:, 2]])
        u = np.where(body.free.reshape(-1, 3) < 0, exact, 0.0)
        state = response.material_response(body, material, u, None, 0.0, None)
        K = full_matrix(body, response.material_tangent(body, material, state.H, None, 0.0, None))
        u = u + newton.full(body, spsolve(K.tocsc(), -newton.reduced(body, state.force)))
        errors.append(np.sqrt(((u - exact)[: -len(body.cells)] ** 2).mean()))  # but for middles of cells
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 2.7)


def squeezed(ratio: float, wide: int = 5, high: int = 1) -> float:
    """Apparent modulus over μ of a disc of a/h = 5, bonded above and below, of so many rectangles."""
    a, h, strain = 5.0, 1.0, 1e-5
    mesh = triangulated(np.linspace(0.0, a, wide + 1), np.linspace(0.0, h, high + 1))
    ends = (mesh.points[:, 1] == 0.0) | (mesh.points[:, 1] == h)
    body = axisymmetric.discretise(mesh.points, mesh.cells, np.repeat(ends[:, None], 3, 1))
    material = Material(NeoHooke(MU, 2.0 / (ratio * MU)))
    u = np.zeros_like(body.nodes)
    u[mesh.points[:, 1] == h, 2] = -strain * h
    state = response.material_response(body, material, u, None, 0.0, None)
    H0 = np.zeros_like(state.H)
    K = full_matrix(body, response.material_tangent(body, material, H0, None, 0.0, None))
    u = u + newton.full(body, spsolve(K.tocsc(), -newton.reduced(body, state.force)))
    force = -response.material_response(body, material, u, None, 0.0, None).force[mesh.points[:, 1] == h, 2].sum()
    return float(force / (np.pi * a**2 * strain * MU))


def test_a_thin_bonded_layer_does_not_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    """E = K (1 − 2 I₁(κ)/(κ I₀(κ))) + 3 μ, κ² = 12 μ a²/(K h²) (Chalhoub and Kelly 1990), right to h/a: 10 %.

    Without the projection the same mesh, one rectangle high, is several times too stiff: the negative control.
    """
    for ratio in (1e3, 1e4):
        kappa = np.sqrt(12.0 * 25.0 / ratio)
        expected = ratio * (1.0 - 2.0 * iv(1, kappa) / (kappa * iv(0, kappa))) + 3.0
        assert squeezed(ratio) == pytest.approx(expected, rel=0.1)
    monkeypatch.setattr(response, "MAX_LOCAL_BULK_RATIO", 1e9)
    response.split.cache_clear()
    try:
        assert squeezed(1e4) > 3.0 * expected
    finally:
        response.split.cache_clear()


def pressed(stiff: float = 100.0, ratio: float = 50.0, seat: float = 0.0):
    """A ball of R = 1 on a slab of thickness 1 that is held below."""
    r = np.concatenate([np.linspace(0.0, 0.8, 9), np.linspace(1.0, 5.0, 9)])
    mesh = triangulated(r, np.array([0.0, 0.35, 0.6, 0.8, 0.9, 1.0]))
    held = np.repeat((mesh.points[:, 1] == 0.0)[:, None], 3, 1)
    body = axisymmetric.discretise(mesh.points, mesh.cells, held)
    edges = mesh.outline()
    top = edges[(mesh.points[edges, 1] == 1.0).all(1) & (mesh.points[edges, 0].max(1) < 3.0)]
    surface = contact_surface(body, top)
    pair = Pair(surface, Sphere(1.0, True), np.full(surface.weights.shape, stiff * MU / 0.1))
    material = Material(NeoHooke(MU, 2.0 / (ratio * MU)))
    system = System(body, material, pair, (), direct.precise(body.pattern), least_force=1e-3 * MU)

    def start(s: float) -> Load:
        way = np.array([0.0, 0.0, -1.0])
        return Load(Touch(np.array([0.0, 0.0, 2.0]) + s * way, way, np.zeros(surface.weights.shape)))

    return system, start


def test_contact_per_area_now_has_a_potential() -> None:
    """Residual, tangent and ∂R/∂s by central differences at points that touch, multipliers included (1e-6: h²)."""
    system, start = pressed()
    body, pair, h = system.body, system.pressing, 1e-5
    load = start(0.3).pressing
    points = tractions.contact_points(pair.surface, body.nodes)
    load = Touch(load.centre, load.direction, MU * np.exp(-points[..., 0]))
    u, d = bumpy(body, 1e-3), bumpy(body, 1.0, 2)

    def at(t: float, s: float = 0.0) -> tractions.ContactState:
        touch = Touch(load.centre + s * load.direction, load.direction, load.multiplier)
        return tractions.evaluate_contact(pair, body.nodes + u + t * d, touch)

    state = at(0.0)
    assert (state.pressure > 0.0).sum() > 20
    slope = (at(h).energy - at(-h).energy) / (2 * h)
    assert slope == pytest.approx(float((state.residual * d).sum()), rel=1e-6)
    data = np.zeros(len(body.pattern.indices))
    moving = tractions.add_contact_tangent(pair, body.nodes + u, load, state, data)
    change = newton.reduced(body, at(h).residual - at(-h).residual) / (2 * h)
    assert np.linalg.norm(full_matrix(body, data) @ newton.reduced(body, d) - change) < 1e-5 * np.linalg.norm(change)
    way = (at(0.0, h).residual - at(0.0, -h).residual) / (2 * h)
    assert np.linalg.norm(newton.reduced(body, way - moving)) < 1e-5 * np.linalg.norm(newton.reduced(body, way))
    total = state.residual[:, 2].sum()  # the tension of areas closes in itself
    assert state.force[2] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("ratio", [2.0, 1e4])
def test_the_way_there_does_not_show(ratio: float) -> None:
    """Force at one depth, alone or after others, by mixed or plain Newton: 1e-6 is what residuals of 1e-8 leave."""
    system, start = pressed(ratio=ratio)
    alone = follow_travel(system, start, [0.5], Control().scaled(1.0), Counters())[-1]
    after = follow_travel(system, start, [0.1, 0.23, 0.41, 0.5], Control().scaled(1.0), Counters())[-1]
    assert after.force[2] == pytest.approx(alone.force[2], rel=1e-6)
    last = alone.stages[-1]
    u = last.equilibrium.evaluation.u + bumpy(system.body, 1e-6)
    plain = newton.solve(system, u, last.load, 1e-8, Counters())
    assert plain.evaluation.contact.force[2] == pytest.approx(alone.force[2], rel=1e-6)
    assert abs(alone.stages[0].equilibrium.evaluation.contact.force[2] / alone.force[2] - 1.0) > 1e-5  # a soft contact


def test_multipliers_begin_from_where_those_before_led() -> None:
    """The first residual with multipliers halves at least, beside that of a depth alone, in no more iterations."""
    system, start = pressed()
    depths = [0.1, 0.2, 0.3, 0.4, 0.45, 0.5]
    alone, after = (
        follow_travel(system, start, d, Control().scaled(1.0), Counters())[-1] for d in (depths[-1:], depths)
    )
    first, then = alone.stages[1].equilibrium.history, after.stages[1].equilibrium.history
    assert then[0] < 0.5 * first[0]
    assert len(then) <= len(first)
    assert after.force[2] == pytest.approx(alone.force[2], rel=1e-7)


def test_seeking_what_touches_saves_factors_and_does_not_show() -> None:
    """Forces (1e-7: residuals of 1e-8) with fewer iterations and factors than where steps say when a mesh is made."""
    system, start = pressed()
    plain, seeking = Counters(), Counters()
    control, depths = Control().scaled(1.0), [0.15, 0.3, 0.45, 0.6]
    watched = follow_travel(system, start, depths, control, plain, worn=lambda u, travel: False)
    free = follow_travel(system, start, depths, control, seeking)
    for a, b in zip(watched, free, strict=True):
        assert b.force[2] == pytest.approx(a.force[2], rel=1e-7)
    assert seeking.iterations < plain.iterations and seeking.factorisations <= plain.factorisations


@pytest.mark.parametrize("size", [0.05, 1.0])
def test_a_start_that_is_far_off_does_not_show(size: float) -> None:
    """The same force (1e-7: residuals of 1e-8) from a start with multipliers that is bent or turned inside out."""
    system, start = pressed()
    control, load = Control().scaled(1.0), start(0.3)
    u = follow_travel(system, start, [0.3], control, Counters())[-1].stages[0].equilibrium.evaluation.u
    off = u + bumpy(system.body, size)
    plain = equilibrate(system, [u], load, 0.3, control, Counters(), known=(None, None))
    found = equilibrate(system, [u, off], load, 0.3, control, Counters(), known=(None, None))
    assert found.force[2] == pytest.approx(plain.force[2], rel=1e-7)


def test_old_factors_follow_what_comes_to_touch() -> None:
    """Woodbury's formula against a new factor, with one point more and one less (round-off of its small system)."""
    system, start = pressed()
    found = mixed_newton.solve(system, np.zeros_like(system.body.nodes), start(0.1), 1e-8, Counters(), 30)
    frame = found.known[0]
    p = found.evaluation.contact.multiplier.copy()
    on = np.argwhere(p > 0.0)
    f, q = on[len(on) // 2]
    p[f, q] = 0.0
    b = np.random.default_rng(3).standard_normal(system.body.pattern.size)
    before, after = frame.solve(b, (found.evaluation.contact.multiplier,)), frame.solve(b, (p,))
    normal = tractions.contact_points(system.pressing.surface, system.body.nodes + found.evaluation.u)[f, q]
    normal = normal - start(0.1).pressing.centre
    v = np.zeros_like(system.body.nodes)
    v[system.pressing.surface.facets[f]] = system.pressing.surface.N[q][:, None] * normal
    v = newton.reduced(system.body, v)
    change = after - before
    along = frame.solve(v, (p,))
    cosine = abs(change @ along) / np.linalg.norm(change) / np.linalg.norm(along)
    assert cosine > 1.0 - 1e-4  # normals are those of the iterate that was factorised
    assert np.linalg.norm(change) > 1e-6 * np.linalg.norm(before)
