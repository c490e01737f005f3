"""Zones: right volumes and places, smooth in their numbers, exactly nothing where nothing differs."""

import numpy as np
import pytest
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend import meshing
from fem_backend.geometry import EllipsoidShape
from fem_backend.kinematics import tetrahedra
from fem_backend.materials import zones

BODY = EllipsoidShape(60.0, 35.0, 35.0)
BELOW = np.array([0.0, 0.0, 25.0])


def discretised(n, slip):
    mesh = meshing.with_mid_edge_nodes(BODY, meshing.mapped_quarter(BODY, n, slip))
    return tetrahedra.discretise(mesh, np.zeros((mesh.doflocs.shape[1], 3), bool))


@pytest.fixture(scope="module")
def body():
    return discretised(12, 0.5)


@pytest.fixture(scope="module")
def places(body):
    """Quadrature points (m, q, 3)."""
    xi = get_quadrature(RefTet, 2)[0].T
    L = np.column_stack([1.0 - xi.sum(1), xi])
    corner = L * (2.0 * L - 1.0)
    edge = [4.0 * L[:, i] * L[:, j] for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))]
    return np.einsum("qa,mai->mqi", np.column_stack([corner, *edge]), body.nodes[body.cells])


def skin_volume(t):
    """S t − M t² + 4π/3 t³ (Steiner) with S = ∫ (abc)²/h⁴ dω, M = ∫ h dω, h the support function."""
    z, wz = np.polynomial.legendre.leggauss(200)
    phi = (np.arange(400) + 0.5) / 400 * 2 * np.pi
    Z, P = np.meshgrid(z, phi, indexing="ij")
    n = np.stack([np.sqrt(1 - Z**2) * np.cos(P), np.sqrt(1 - Z**2) * np.sin(P), Z], -1)
    w = wz[:, None] * 2 * np.pi / 400
    h = np.linalg.norm(n * BODY.semi_axes, axis=-1)
    return (w * BODY.semi_axes.prod() ** 2 / h**4).sum() * t - (w * h).sum() * t**2 + 4 / 3 * np.pi * t**3


def volume(body, fraction):
    return 4.0 * (body.w * fraction).sum()


# -- amounts and places


@pytest.mark.parametrize("t", [0.2, 0.5, 1.0, 3.0])
def test_skin_has_the_volume_of_the_parallel_body(body, t):
    found = volume(body, zones.skin(body, BODY, t))
    np.testing.assert_allclose(found, skin_volume(t), rtol=1e-2 if t < 0.5 else 5e-3)  # thin against cells of 20 mm
    radial = BODY.volume() * (1.0 - (1.0 - t / BODY.c) ** 3)
    assert abs(radial / skin_volume(t) - 1.0) > 0.05  # radial scaling is another skin


@pytest.mark.parametrize("radius,height", [(5.0, 25.0), (2.0, 30.0), (10.0, 10.0)])
def test_inclusion_has_the_volume_and_the_middle_of_the_ball(body, places, radius, height):
    w = body.w * zones.inclusion(body, [0.0, 0.0, height], radius)
    np.testing.assert_allclose(
        4.0 * w.sum(), 4 / 3 * np.pi * radius**3, rtol=1e-3
    )  # N_PIECES_PER_CUT_EDGE: measured 1e-5 to 1e-4
    middle = np.einsum("mq,mqi->i", w, places) / w.sum()
    # a quarter of a ball; the rest is what clipping to [0, 1] leaves in cells of 3 mm
    np.testing.assert_allclose(middle, [3 / 8 * radius, 3 / 8 * radius, height], atol=0.05 * radius)


def test_cavity_open_below_counts_only_what_is_inside(body):
    centre, axes = np.array([0.0, 0.0, -35.0]), np.array([15.0, 15.0, 10.0])
    X = np.random.default_rng(1).uniform(-1, 1, (400_000, 3))
    inside = (np.linalg.norm(X, axis=1) < 1) & (np.linalg.norm((centre + X * axes) / BODY.semi_axes, axis=1) < 1)
    exact = inside.mean() * 8.0 * axes.prod()
    np.testing.assert_allclose(volume(body, zones.cavity(body, centre, axes)), exact, rtol=1e-2)  # 3σ of the sampling


def test_cells_wholly_in_or_out_are_exact_and_all_values_between(body, places):
    f = zones.inclusion(body, BELOW, 9.0)
    r = np.linalg.norm(body.nodes[body.cells] - BELOW, axis=-1)
    assert np.all(f[r.max(1) < 8.0] == 1.0) and np.any(r.max(1) < 8.0)
    assert np.all(f[r.min(1) > 12.0] == 0.0)
    assert f.min() >= 0.0 and f.max() <= 1.0


def test_a_plane_cut_gives_volume_and_centroid_of_the_polyhedron():
    rng = np.random.default_rng(2)
    L = rng.dirichlet(np.ones(4), 400_000)
    for v in ([-1.0, 2.0, 1.0, 0.5], [-1.0, -0.3, 1.0, 0.5], [-1.0, -2.0, -0.7, 0.5], [-1.0, 0.0, 0.0, 1.0]):
        below = L @ v < 0.0
        part, mean = zones._below(np.array(v))
        np.testing.assert_allclose(part, below.mean(), atol=3e-3)  # sampling
        np.testing.assert_allclose(mean, L[below].mean(0), atol=3e-3)


def test_a_cell_that_is_almost_full_is_almost_one():
    """Curved cells: the four points do not quite have the volume and centroid of the cell, and it must not show."""
    at = np.full((4, 4), 0.1381966011250105) + 0.4472135954999579 * np.eye(4)
    w, whole = np.array([[1.0, 1.1, 0.9, 1.05]]), np.array([[1.02, 1.0, 0.97, 1.08]])
    np.testing.assert_allclose(zones._fit(w, at, whole * (1 - 1e-9), whole), 1.0, atol=1e-6)
    np.testing.assert_allclose(zones._fit(w, at, 0.5 * whole, whole), 0.5, rtol=1e-12)
    np.testing.assert_array_equal(zones._fit(w, at, whole, whole), 1.0)


def test_depth_is_the_distance_to_the_surface():
    theta, phi = np.meshgrid(np.linspace(0.05, 3.0, 40), np.linspace(0, 6.2, 40), indexing="ij")
    foot = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1) * BODY.semi_axes
    n = foot / BODY.semi_axes**2
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    for d in (-5.0, -0.1, 0.0, 0.5, 15.0):
        np.testing.assert_allclose(zones.depth(BODY, foot - d * n), d, atol=1e-7)
    np.testing.assert_allclose(zones.depth(BODY, np.zeros(3)), 35.0, atol=1e-6)
    np.testing.assert_allclose(zones.depth(BODY, np.array([0.0, 0.0, 20.0])), 15.0, atol=1e-6)


def test_surface_faces_cover_the_upper_and_lower_surface_once(body):
    c, k = np.nonzero(zones.surface_faces(body, BODY))
    corners = body.nodes[body.cells[c][np.arange(len(c))[:, None], zones.FACES_OPPOSITE_CORNERS[k]]]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1).sum()
    step = 1e-4
    np.testing.assert_allclose(4.0 * area, skin_volume(step) / step, rtol=0.03)  # flat triangles on a curved body


# -- smoothness


@pytest.mark.parametrize(
    "zone,at",
    [
        pytest.param(lambda b, t: zones.skin(b, BODY, t), 0.5, marks=pytest.mark.verification),
        (lambda b, r: zones.inclusion(b, BELOW, r), 5.0),
        (lambda b, z: zones.inclusion(b, [0.0, 0.0, z], 5.0), 25.0),
    ],
    ids=["thickness", "radius", "depth"],
)
def test_fractions_are_smooth_when_a_number_moves_by_a_thousandth(body, places, zone, at):
    near = 1.0 / (1.0 + np.linalg.norm(places - BODY.top, axis=-1) ** 2 / 9.0)  # weighs like the strain energy
    h = 1e-3 * at
    fields = np.array([zone(body, at + k * h) for k in range(-3, 4)])
    total = (fields * body.w * near).sum((1, 2))
    first, second = np.diff(total), np.diff(total, 2)
    assert np.all(np.abs(first) > 0.0)
    # the slope itself changes by a few per cent over 0.1 % of a depth of 25 mm; a jump or a kink would be 1 or ½
    assert np.abs(second).max() < 0.03 * np.abs(first).max()


def test_control_points_that_are_just_in_or_out_are_not_smooth(body, places):
    h = 5e-3
    radius = 5.0 + h * np.arange(-3, 4)
    hard = ((np.linalg.norm(places - BELOW, axis=-1) < radius[:, None, None]) * body.w).sum((1, 2))
    assert np.abs(np.diff(hard, 2)).max() > 0.5 * np.abs(np.diff(hard)).max()


def test_a_growing_skin_only_grows_and_starts_from_nothing(body):
    volumes = [volume(body, zones.skin(body, BODY, t)) for t in (0.0, 1e-3, 0.1, 0.2, 0.4, 0.8)]
    assert volumes[0] == 0.0 and np.all(np.diff(volumes) > 0.0)
    assert volumes[1] < 2.0 * skin_volume(1e-3) + 0.01 * skin_volume(0.5)


# -- scale


def test_nothing_differs_is_none(body):
    hole = (np.array([0.0, 0.0, -35.0]), np.zeros(3))
    assert zones.modulus_factor(body, BODY) is None
    assert zones.modulus_factor(body, BODY, skin=(0.5, 1.0), inclusion=(BELOW, 5.0, 1.0), cavity=hole) is None
    assert zones.modulus_factor(body, BODY, skin=(0.0, 2.0), inclusion=(BELOW, 0.0, 3.0)) is None


def test_scale_mixes_the_zones(body):
    hole = (np.array([0.0, 0.0, -35.0]), np.array([15.0, 15.0, 10.0]))
    s = zones.modulus_factor(body, BODY, skin=(0.5, 2.0), inclusion=(BELOW, 5.0, 3.0), cavity=hole)
    skin, ball = zones.skin(body, BODY, 0.5), zones.inclusion(body, BELOW, 5.0)
    away = zones.cavity(body, *hole) == 0.0
    np.testing.assert_array_equal(s[away], (1.0 + skin + 2.0 * ball)[away])
    inside = zones.cavity(body, *hole) == 1.0
    np.testing.assert_allclose(s[inside], zones.CAVITY_STIFFNESS_RATIO, rtol=1e-12)
    assert s.min() >= zones.CAVITY_STIFFNESS_RATIO * (1 - 1e-12)
    soft = zones.modulus_factor(body, BODY, skin=(0.5, 0.5))
    assert soft.min() >= 0.5 and soft.max() == 1.0


@pytest.mark.parametrize(
    "zone,words",
    [
        ({"skin": (-0.1, 2.0)}, "thickness"),
        ({"skin": (12.0, 2.0)}, "thickness"),
        ({"skin": (0.5, 0.0)}, "ratio"),
        ({"skin": (0.5, float("nan"))}, "ratio"),
        ({"inclusion": (BELOW, -1.0, 2.0)}, "radius"),
        ({"inclusion": (BELOW, 10.0, 2.0)}, "10 mm to the surface"),
        ({"inclusion": (np.array([0.0, 0.0, 40.0]), 1.0, 2.0)}, "surface"),
        ({"inclusion": (np.array([3.0, 0.0, 20.0]), 1.0, 2.0)}, "symmetry plane x"),
        ({"inclusion": (BELOW, 9.8, 2.0), "skin": (0.5, 2.0)}, "9.5 mm"),
        ({"inclusion": (BELOW, 5.0, 2.0), "cavity": (np.array([0.0, 0.0, 15.0]), np.full(3, 5.0))}, "cavity"),
        ({"cavity": (np.array([0.0, 0.0, -40.0]), np.full(3, 8.0))}, "outside"),
        ({"cavity": (np.array([0.0, 0.0, 30.0]), np.full(3, 8.0))}, "z = 0"),
        ({"cavity": (np.array([0.0, 1.0, 0.0]), np.full(3, 8.0))}, "symmetry plane y"),
        ({"cavity": (np.zeros(3), np.array([5.0, -1.0, 5.0]))}, "negative"),
    ],
)
def test_bad_geometry_is_refused_in_words(body, zone, words):
    with pytest.raises(ValueError, match=words):
        zones.modulus_factor(body, BODY, **zone)
