import dataclasses

import numpy as np
import pytest
from cube import box
from scipy import sparse
from skfem import MeshTet2

from fem_backend import geometry, meshing
from fem_backend.kinematics import tetrahedra
from fem_backend.laws import NeoHooke
from fem_backend.materials import stress

LAW = NeoHooke(0.01, 5.8)


def discretised(cells=2, corners=0.2, middles=0.0) -> tuple[tetrahedra.Body, np.ndarray]:
    mesh, inner = box(cells, corners, middles)
    return tetrahedra.discretise(mesh, np.zeros((mesh.doflocs.shape[1], 3), bool)), inner


def forces(body: tetrahedra.Body, u: np.ndarray, law=LAW) -> np.ndarray:
    state = stress.evaluate_stress(law, tetrahedra.displacement_gradients(body, u), tangent=False)
    return tetrahedra.internal_force(body, state.F, state.S)


def energy(body: tetrahedra.Body, u: np.ndarray, law=LAW) -> float:
    state = stress.evaluate_stress(law, tetrahedra.displacement_gradients(body, u), tangent=False)
    return float((body.w * state.energy).sum())


def matrix(body: tetrahedra.Body, u: np.ndarray, law=LAW) -> sparse.csr_matrix:
    """The whole symmetric tangent over free dofs."""
    state = stress.evaluate_stress(law, tetrahedra.displacement_gradients(body, u), tangent=True)
    data = tetrahedra.stiffness(body, state.F, state.S_geometric, state.C)
    upper = sparse.csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(body.pattern.size,) * 2)
    return upper + sparse.triu(upper, 1).T


A = np.array([[0.1, 0.2, -0.05], [0.0, -0.15, 0.1], [0.05, 0.0, 0.2]])  # a large homogeneous deformation


# ---------------------------------------------------------------------------------------------- patch tests


@pytest.mark.parametrize("middles", [0.0, 0.05])
def test_patch_linear_displacement_gives_constant_strain(middles):
    """Isoparametric elements hold every linear field exactly, whatever their shape."""
    body, _ = discretised(middles=middles)
    H = tetrahedra.displacement_gradients(body, body.nodes @ A.T)
    np.testing.assert_allclose(H, np.broadcast_to(A, H.shape), rtol=0, atol=1e-13)  # round-off
    kinked = body.nodes @ A.T + 1e-3 * np.abs(body.nodes - 0.4)  # negative control: no linear field
    assert np.abs(tetrahedra.displacement_gradients(body, kinked) - A).max() > 1e-4


def test_patch_inner_forces_vanish_on_straight_elements():
    body, inner = discretised()
    f = forces(body, body.nodes @ A.T)
    assert inner.sum() > 20
    np.testing.assert_allclose(f[inner], 0.0, atol=1e-15 * len(body.cells))  # of boundary forces of 1e-3
    assert np.abs(f[~inner]).max() > 1e-4
    f = forces(body, body.nodes @ A.T + 1e-3 * np.abs(body.nodes - 0.4))  # negative control
    assert np.abs(f[inner]).max() > 1e-6


def test_patch_inner_forces_on_curved_elements_are_an_error_of_the_quadrature_only():
    """∫ cof J ∇N has degree 3 and four points integrate degree 2: a curvature κ leaves forces that vanish with it.

    The rate is what counts: on bodies the curvature of an edge falls with the mesh.
    """
    kappa = np.array([0.08, 0.04, 0.02])
    error = []
    for k in kappa:
        body, inner = discretised(middles=k)
        error.append(np.abs(forces(body, body.nodes @ A.T)[inner]).max())
    assert np.all(np.diff(np.log(error)) / np.diff(np.log(kappa)) > 0.9), error


def test_rigid_motions_cost_nothing():
    body, _ = discretised(middles=0.05)
    Q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    Q *= np.linalg.det(Q)
    u = body.nodes @ Q.T - body.nodes + [1.0, -2.0, 3.0]
    np.testing.assert_allclose(forces(body, u), 0.0, atol=1e-15)  # of the order K·area·eps = 0.3·0.1·1e-16
    assert abs(energy(body, u)) < 1e-16
    assert np.abs(forces(body, 1.01 * u)).max() > 1e-5  # negative control: a stretch


def test_forces_are_in_balance():
    """Σ f = 0 and Σ x × f = 0 in the deformed place, for any displacement."""
    body, _ = discretised(middles=0.05)
    u = 0.1 * np.sin(4 * body.nodes[:, [1, 2, 0]])
    f = forces(body, u)
    size = np.abs(f).sum()
    np.testing.assert_allclose(f.sum(0), 0.0, atol=1e-14 * size)
    np.testing.assert_allclose(np.cross(body.nodes + u, f).sum(0), 0.0, atol=1e-14 * size)


# ---------------------------------------------------------------------------------------------- derivatives


def direction(body: tetrahedra.Body, size: float) -> np.ndarray:
    """A smooth field with a little noise: the work along it must not drown in the curvature of the energy."""
    return size * (np.cos(3 * body.nodes) + 0.02 * np.random.default_rng(5).normal(size=body.nodes.shape))


def test_force_is_the_derivative_of_the_energy(slopes):
    """|W(u + tv) − W(u) − t f·v| = O(t²)."""
    body, _ = discretised(middles=0.05)
    u = 0.1 * np.sin(4 * body.nodes[:, [1, 2, 0]])
    v = u  # the energy rises along u: its first derivative is no small number by chance
    steps = 10.0 ** np.array([-1.0, -1.5, -2.0, -2.5, -3.0])
    first = float((forces(body, u) * v).sum())
    error = np.array([abs(energy(body, u + t * v) - energy(body, u) - t * first) for t in steps])
    np.testing.assert_allclose(slopes(error, steps), 2.0, atol=0.1)
    wrong = np.array([abs(energy(body, u + t * v) - energy(body, u) - t * 1.01 * first) for t in steps])
    assert slopes(wrong, steps)[-1] < 1.5  # negative control: 1 % in the force is seen


def test_stiffness_is_the_derivative_of_the_force(slopes):
    """‖f(u + tv) − f(u) − t K v‖ = O(t²), also with the held dofs left out."""
    mesh, _ = box(2, 0.2, 0.05)
    held = mesh.doflocs.T == 0.0  # sliding on three planes: single components are held
    body = tetrahedra.discretise(mesh, held)
    u, v = 0.1 * np.sin(4 * body.nodes[:, [1, 2, 0]]), direction(body, 0.05)
    v[held] = 0.0
    free = body.free.reshape(held.shape)

    def reduced(x: np.ndarray) -> np.ndarray:
        out = np.empty(body.pattern.size)
        out[free[~held]] = x[~held]
        return out

    steps = 10.0 ** np.array([-2.0, -3.0, -4.0, -5.0])  # small, so that 1 % in one term of the matrix shows
    K = matrix(body, u)
    Kv = K @ reduced(v)
    error = [np.linalg.norm(reduced(forces(body, u + t * v) - forces(body, u)) - t * Kv) for t in steps]
    np.testing.assert_allclose(slopes(np.array(error), steps), 2.0, atol=0.1)
    wrong = [np.linalg.norm(reduced(forces(body, u + t * v) - forces(body, u)) - t * 1.0001 * Kv) for t in steps]
    assert slopes(np.array(wrong), steps)[-1] < 1.5  # negative control


def test_undeformed_stiffness_has_six_rigid_modes():
    body, _ = discretised(cells=1, middles=0.0)
    values = np.linalg.eigvalsh(matrix(body, np.zeros_like(body.nodes)).toarray())
    assert np.all(np.abs(values[:6]) < 1e-12 * values[-1])
    assert values[6] > 1e-6 * values[-1]  # four points: no spurious mode of zero energy in the assembled body


# ---------------------------------------------------------------------------------------------- bookkeeping


def test_volume_converges_to_that_of_the_quarter_ellipsoid():
    """|Σ w − 4/3 π abc/4| = O(h⁴): quadratic surfaces interpolate to h³, symmetric edges gain one."""
    body = geometry.EllipsoidShape(60.0, 35.0, 35.0)
    n = np.array([6, 8, 10, 12])
    error = []
    for k in n:
        mesh = meshing.with_mid_edge_nodes(body, meshing.make_mesh(meshing.mapped_recipe(body, int(k), 0.0)))
        w = tetrahedra.discretise(mesh, np.zeros((mesh.doflocs.shape[1], 3), bool)).w
        assert w.min() > 0
        error.append(abs(w.sum() / (np.pi / 3 * 60 * 35 * 35) - 1))
    assert error[0] < 2e-3, error
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate > 3.0, (rate, error)


def test_turned_over_element_is_refused():
    mesh, _ = box(1, 0.0, 0.0)
    nodes = mesh.doflocs.copy()
    edge = np.argmax(np.all(np.isclose(nodes, 0.5), axis=0))  # the middle of the diagonal, pulled through a face
    nodes[:, edge] += 2.0
    with pytest.raises(ValueError, match="inside out"):
        tetrahedra.discretise(MeshTet2(nodes, mesh.t), np.zeros((nodes.shape[1], 3), bool))


def test_free_dofs_are_numbered_once_and_held_ones_not(graded):
    body = graded.model.body
    free = body.free
    assert sorted(free[free >= 0]) == list(range(body.pattern.size))
    X = body.nodes
    held = (free < 0).reshape(-1, 3)
    lower = np.zeros(len(X), bool)
    lower[graded.model.held] = True
    np.testing.assert_array_equal(held[:, 0], (X[:, 0] == 0) | lower)
    np.testing.assert_array_equal(held[:, 1], (X[:, 1] == 0) | lower)
    np.testing.assert_array_equal(held[:, 2], lower)


def test_pattern_holds_exactly_the_pairs_of_the_cells(graded):
    body = graded.model.body
    p = body.pattern
    rows = np.repeat(np.arange(p.size), np.diff(p.indptr))
    stored = set(zip(rows.tolist(), p.indices.tolist(), strict=True))
    assert len(stored) == len(rows) and np.all(p.indices >= rows)
    wanted = set()
    for cell in body.cells:
        dofs = body.free[(3 * cell[:, None] + np.arange(3)).ravel()]
        dofs = dofs[dofs >= 0].tolist()
        wanted.update((i, j) for i in dofs for j in dofs if i <= j)
    assert stored == wanted
    np.testing.assert_array_equal(p.indices[p.indptr[:-1]], np.arange(p.size))  # newton shifts these as the diagonal


def test_find_gives_the_place_of_every_pair(graded):
    body = graded.model.body
    p = body.pattern
    rows = np.repeat(np.arange(p.size), np.diff(p.indptr))
    for e in (0, len(body.cells) // 2, len(body.cells) - 1):
        dofs = body.free[(3 * body.cells[e][:, None] + np.arange(3)).ravel()]
        for a, i in enumerate(dofs):
            for b, j in enumerate(dofs):
                k = body.place[e, a, b]
                assert k == -1 if (i < 0 or j < i) else (rows[k], p.indices[k]) == (i, j)


def test_find_refuses_pairs_without_an_element(graded):
    p = graded.model.body.pattern
    stranger = np.setdiff1d(np.arange(p.size), p.indices[p.indptr[0] : p.indptr[1]])[0]
    with pytest.raises(KeyError, match="shares no element"):
        p.find(np.array([[0, stranger]]))


def test_metis_order_fills_less_than_the_order_of_the_mesh(small):
    """The numbering is there for the fill of the factors (a permutation the wrong way round would lose it)."""
    body = small.model.body
    in_order = sparse.csc_matrix(matrix(body, np.zeros_like(body.nodes)))
    back = np.argsort(body.free[body.free >= 0])
    of_mesh = in_order[np.argsort(back)][:, np.argsort(back)]
    fills = [
        sparse.linalg.splu(
            m.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        ).L.nnz
        for m in (in_order, of_mesh)
    ]
    assert fills[0] < 0.7 * fills[1], fills


def test_frozen(graded):
    with pytest.raises(dataclasses.FrozenInstanceError):
        graded.model.body.nodes = None
