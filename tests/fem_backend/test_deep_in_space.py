"""Deep indentation in three dimensions: the element of large strain, the gathered mesh, errors by a second mesh."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from skfem import MeshTet, MeshTet2

from fem_backend import meshing
from fem_backend.backend import BACKEND
from fem_backend.kinematics import tetrahedra
from fem_backend.laws import Material, NeoHooke
from fem_backend.materials import response
from fem_backend.meshing import prestretched
from fem_backend.remeshing import tetrahedra as rezoning
from fem_backend.simulation import assembly, contact_elements, experiment, indentation
from fem_backend.simulation.initial_state import initial_state
from fem_backend.solver import load_steps
from fem_backend.solver.load_steps import Instant
from fem_backend.solver.newton import Counters
from rso.contract import Case, Programme

SPHERE = {"shape": "ellipsoid", "semi_axes": [35.0, 35.0, 35.0]}  # in space: only shape = "sphere" has a meridian
P4 = {6.0: 0.9061, 7.0: 1.0249, 7.5: 1.0639, 8.0: 1.0874}  # N, by elements of degree 4 on a meridian, another program
SOFT = {"mu": 0.0099997, "D1": 5.8}


def case(asked, level="coarse", **more):
    settings = {"specimen": SPHERE, "mesh": {"level": level}, "derivatives": False, **more}
    return Case("deep", Programme.ramp(tuple(asked)), settings)


# ------------------------------------------------------------------------------------------------------------ element


def cube(mean: bool, n: int = 2) -> tetrahedra.Body:
    """A unit cube of quadratic tetrahedra, free."""
    mesh = MeshTet2.from_mesh(MeshTet.init_tensor(*[np.linspace(0.0, 1.0, n + 1)] * 3))
    return tetrahedra.discretise(mesh, np.zeros((mesh.doflocs.shape[1], 3), bool), False, mean)


def matrix(body: tetrahedra.Body, data: np.ndarray) -> np.ndarray:
    out = np.zeros((body.pattern.size,) * 2)
    rows = np.repeat(np.arange(body.pattern.size), np.diff(body.pattern.indptr))
    out[rows, body.pattern.indices] = data
    return out


@pytest.mark.parametrize("K_over_mu", [3.0, 500.0])
def test_force_and_tangent_are_derivatives_of_the_energy(K_over_mu):
    """Central differences along two fields; below K = 5 μ nothing is averaged."""
    body, material = cube(True), Material(NeoHooke(0.01, 200.0 / K_over_mu))
    rng = np.random.default_rng(3)
    u, v = (k * rng.normal(size=body.nodes.shape) for k in (0.03, 1.0))
    scale = rng.uniform(0.5, 2.0, body.w.shape)

    def at(x):
        return response.material_response(body, material, x, None, 0.0, scale)

    e = 1e-5
    assert (at(u + e * v).energy - at(u - e * v).energy) / (2 * e) == pytest.approx((at(u).force * v).sum(), rel=1e-6)
    free = body.free.reshape(-1, 3)
    order = np.empty(body.pattern.size, int)
    order[free.ravel()] = np.arange(free.size)
    K = matrix(body, response.material_tangent(body, material, at(u).H, None, 0.0, scale))
    slope = ((at(u + e * v).force - at(u - e * v).force) / (2 * e)).ravel()[order]
    assert K @ v.ravel()[order] == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())
    stress = response.state(body, material, at(u).H, None, 0.0, scale)
    assert tetrahedra.internal_force(body, stress.F, stress.S) == pytest.approx(at(u).force, abs=1e-12)


def test_a_mean_of_what_is_everywhere_the_same_changes_nothing():
    """Homogeneous deformation: both elements have the same energy, forces and stresses."""
    material = Material(NeoHooke(0.01, 0.4))
    H = np.array([[0.2, 0.1, 0.0], [0.0, -0.3, 0.05], [0.1, 0.0, 0.15]])
    mean, plain = cube(True), cube(False)
    a, b = (response.material_response(body, material, body.nodes @ H.T, None, 0.0, None) for body in (mean, plain))
    assert a.energy == pytest.approx(b.energy, rel=1e-12) and a.force == pytest.approx(b.force, abs=1e-14)


def test_bending_does_not_lock_where_volume_is_hardly_changed():
    """A field whose volume change is zero in the mean of each element costs no volumetric energy; pointwise it does."""
    material = Material(NeoHooke(0.01, 2e-4))  # K/μ = 1e6
    mean, plain = cube(True, 1), cube(False, 1)
    rng = np.random.default_rng(0)
    J = np.zeros((len(mean.cells), mean.nodes.size))  # of small strains: the mean of tr ∇u of each element
    for e, nodes in enumerate(mean.cells):
        row = np.einsum("q,qai->ai", mean.w[e], mean.G[e])
        np.add.at(J[e], (3 * nodes[:, None] + np.arange(3)).ravel(), row.ravel())
    x = rng.normal(size=mean.nodes.size)
    x -= np.linalg.lstsq(J, J @ x, rcond=None)[0]
    u = 1e-4 * x.reshape(-1, 3)
    a, b = (response.material_response(body, material, u, None, 0.0, None).energy for body in (mean, plain))
    assert a < 1e-3 * b


# --------------------------------------------------------------------------------------------------------------- mesh


@pytest.mark.parametrize("semi_axes", [(60.0, 35.0, 35.0), (12.0, 9.0, 7.0)])
def test_a_gathered_ball_keeps_surface_rim_and_planes(semi_axes):
    """Nodes stay on what they were on, none trade places, and those below the contact come nearer to the axis."""
    mesh = meshing.template_mesh("coarse")
    X = mesh.vertices / np.array([60.0, 35.0, 35.0])
    out = prestretched.below_pole(X, np.array(semi_axes), 3.0)
    skin = np.abs((X**2).sum(1) - 1.0) < 1e-12
    assert (out[skin] ** 2).sum(1) == pytest.approx(1.0, abs=1e-12)
    for k in range(3):
        assert np.all(out[X[:, k] == 0.0, k] == 0.0) and np.all(out[:, k] * X[:, k] >= 0.0)
    volumes = [meshing.volumes(meshing.Mesh(x, mesh.tets)) for x in (X, out)]
    assert np.all(volumes[1] > 0.0) and volumes[1].sum() == pytest.approx(volumes[0].sum(), rel=0.02)
    r = np.hypot(*(X[:, :2] * semi_axes[:2]).T)
    below = skin & (X[:, 2] > 0.0) & (r > 0.0) & (r < 1.5)
    assert below.any() and np.all(np.hypot(*out[below, :2].T) < 0.75 * np.hypot(*X[below, :2].T))


def test_only_indenters_that_dig_in_at_their_axis_gather_the_mesh():
    """A flat end is sharpest at its edge, a plate nowhere."""
    puck = {"specimen": {"shape": "cylinder", "radius": 9.0, "height": 6.0}, "support": {"kind": "bonded"}}
    tables = {"sphere": {"radius": 3.0}, "cone": {"half_angle": 60.0, "tip_radius": 0.2}, "plate": {}}
    tables |= {"flat": {"radius": 2.0, "fillet": 0.2}}
    found = {}
    for shape, table in tables.items():
        read = experiment.read_settings({**puck, "indenter": {"shape": shape, **table}})
        found[shape] = contact_elements.gathers(read.indenter)
    assert found == {"sphere": True, "cone": True, "plate": False, "flat": False}


# -------------------------------------------------------------------------------------------------------------- depth


def mark(asked, **more):
    return BACKEND.canonical(SOFT, case(asked, **more))[1].settings["mesh"].get("large_strain")


def test_shallow_runs_and_meridians_keep_their_keys():
    """Two lengths deep the element is the old one; a flat specimen is deep from 0.6 of its thickness on."""
    assert mark([2.0, 6.0]) is None and mark([2.0, 6.1]) == 1
    assert mark([8.0], specimen={"shape": "sphere", "radius": 35.0}) is None
    assert mark([8.0], level="limit", specimen={"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}) is None
    slab = {"specimen": {"shape": "block", "size": [20.0, 20.0, 4.0]}, "support": {"kind": "bonded"}}
    assert mark([2.4], **slab) is None and mark([2.5], **slab) == 1
    again = BACKEND.canonical(SOFT, case([8.0]))
    assert BACKEND.canonical(again[0], again[1]) == again  # canonical settings are read again


@pytest.mark.verification
def test_a_held_sphere_in_space_is_that_of_another_program_to_eight_millimetres():
    """2.7 R deep, of a level that missed 1.2 to 5.2 % there: within 1.7 % and within what is stated, at most 6 %.

    Both meshes are made here, no two alike: the fewer nodes part them, the more is stated."""
    answer = BACKEND(SOFT, case(P4))
    off, force = answer.channels["Fz"] - list(P4.values()), np.array(list(P4.values()))
    assert np.all(np.abs(off) <= 0.017 * force)
    assert np.all(np.abs(off) <= answer.error["Fz"]) and np.all(answer.error["Fz"] <= 0.06 * force)


@pytest.mark.verification
def test_without_a_second_mesh_errors_are_those_of_the_level():
    """Where the coarser run ends early nothing is compared, and what distorted elements add is stated as before."""
    solved = BACKEND.solve(SOFT, case([3.0, 7.0]))
    alone = dataclasses.replace(solved.result, coarser=None)
    one, other = (BACKEND.response(dataclasses.replace(solved, result=r)).error["Fz"] for r in (solved.result, alone))
    assert other[1] / solved.result.Fz[1] > 0.02 > one[1] / solved.result.Fz[1]


@pytest.mark.verification
def test_derivatives_of_a_deep_run_are_those_of_its_element():
    """dF/dD1 beside a difference of two runs: the projected part of the volume change is in both."""
    asked = [4.0, 6.5]
    settings = {"derivatives": True}
    found = BACKEND({"mu": 0.01, "D1": 1.0}, case(asked, **settings))
    high, low = (BACKEND({"mu": 0.01, "D1": d}, case(asked)).channels["Fz"] for d in (1.02, 0.98))
    assert found.gradients["D1"]["Fz"] == pytest.approx((high - low) / 0.04, rel=0.03)


# ----------------------------------------------------------------------------------------------------------- rezoning


def test_a_rezoned_mesh_has_the_same_force_and_better_elements():
    """Set 1, ungathered, 5 mm deep: the force jumps by less than 0.3 %, nothing turns over, a mark stays."""
    settings = experiment.read_settings({"mesh": {"level": "coarse"}, "derivatives": False, "profile": [[4.0, 1.0]]})
    knobs = BACKEND.knobs(SOFT, settings)
    placement = assembly.placement_of(settings, knobs)
    model = assembly.model_for(settings, knobs, placement, None)
    before = indentation.simulate_indentation(settings, knobs, placement, model, [Instant(5.0, 5.0, True)])
    state = before.points[0].evaluation.u
    made = rezoning.rezoned(placement.specimen, model.mesh, state, placement.contact, 9.0)
    assert made.after > made.before > 0.0
    now = MeshTet2(np.ascontiguousarray(made.mesh.doflocs + made.u.T), made.mesh.t)
    assert min(meshing.scaled_jacobian(m).min() for m in (made.mesh, now)) > 0.0
    new = assembly.rezoned_model(settings, knobs, placement, made.mesh)
    assert np.abs(new.body.nodes - model.body.nodes).max() > 0.2
    assert new.body.w.sum() == pytest.approx(model.body.w.sum(), rel=1e-3)
    counters = Counters()
    at = initial_state(settings, knobs, placement, new, counters)
    point = load_steps.equilibrate(at.system, [made.u], at.start(5.0), 5.0, settings.control, counters)
    after = indentation.collect(at, [point], counters, 0.0)
    assert np.abs(after.Fz[0] / before.Fz[0] - 1.0) < 0.003
    mark = "uz(4,1)"
    assert after.channels[mark][0] == pytest.approx(before.channels[mark][0], abs=0.01)
    far = np.linalg.norm(new.body.nodes - placement.contact, axis=1) > 25.0
    assert new.body.nodes[far] == pytest.approx(model.body.nodes[far], abs=1e-9)


def test_a_state_of_the_first_order_is_carried_over_exactly():
    """A homogeneous deformation: displacements at the new nodes are those of the field, whatever has moved."""
    mesh = assembly.model_for(
        settings := experiment.read_settings({"mesh": {"level": "coarse"}}),
        knobs := BACKEND.knobs(SOFT, settings),
        placement := assembly.placement_of(settings, knobs),
        None,
    ).mesh
    H = np.diag([0.3, 0.2, -0.4])
    made = rezoning.rezoned(placement.specimen, mesh, mesh.doflocs.T @ H, placement.contact, 9.0, rounds=2)
    inside = ~placement.specimen.on_surface(made.mesh.doflocs.T)  # curved edges are located as straight ones
    assert made.u[inside] == pytest.approx((made.mesh.doflocs.T @ H)[inside], abs=3e-3)
    assert np.abs(made.mesh.doflocs - mesh.doflocs).max() > 0.1
