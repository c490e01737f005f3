"""What is shown beyond the forces: exact for fields known in closed form, readable files, pictures that are drawn."""

import base64
import dataclasses
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from fem_backend import meshing, post
from fem_backend.contact import tractions
from fem_backend.contact.tractions import quadratic_facets
from fem_backend.geometry import EllipsoidShape
from fem_backend.indenters import spherical_patch
from fem_backend.indenters.sphere import Sphere
from fem_backend.indenters.spherical_patch import contact_patch
from fem_backend.kinematics import tetrahedra
from fem_backend.laws import LinearElastic, NeoHooke
from fem_backend.materials import stress
from fem_backend.post import pictures

BODY = EllipsoidShape(60.0, 35.0, 35.0)
BALL = EllipsoidShape(3.0, 3.0, 3.0)
LAW = NeoHooke(mu=0.01, D1=5.8)


def discretised(ellipsoid, n, slip):
    mesh = meshing.with_mid_edge_nodes(ellipsoid, meshing.mapped_quarter(ellipsoid, n, slip))
    body = tetrahedra.discretise(mesh, np.zeros((mesh.doflocs.shape[1], 3), bool))
    facets = quadratic_facets(mesh, mesh.boundary_facets())
    flat = (body.nodes[facets, 0] == 0).all(1) | (body.nodes[facets, 1] == 0).all(1)
    return body, facets[~flat]


@pytest.fixture(scope="module")
def specimen():
    return discretised(BODY, 8, 0.5)


@pytest.fixture(scope="module")
def ball():
    """A specimen of the shape of the indenter: its surface lies on a sphere, so areas are known."""
    return discretised(BALL, 12, 0.0)


def rotation(seed):
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


# -- fields


def test_fields_of_a_homogeneous_deformation(specimen):
    body, _ = specimen
    stretch = np.array([1.3, 1.1, 0.6])
    R, V = rotation(1), rotation(2)
    F = R @ V @ np.diag(stretch) @ V.T
    found = post.stress_fields(body, body.nodes @ (F - np.eye(3)).T, LAW)
    J, b = stretch.prod(), F @ F.T
    dev = b - np.trace(b) / 3.0 * np.eye(3)
    sigma = LAW.mu * J ** (-5 / 3) * dev + 2.0 / LAW.D1 * (J - 1.0) * np.eye(3)  # Bonet & Wood 2008, eq. 6.55, 6.59
    s = np.sort(np.linalg.eigvalsh(sigma))
    vm = np.sqrt(0.5 * ((s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2))
    shape = body.w.shape  # tolerances: round-off of the gradients
    np.testing.assert_allclose(found.cauchy, np.broadcast_to(sigma, (*shape, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(found.von_mises, np.full(shape, vm), rtol=1e-9)
    np.testing.assert_allclose(found.J, np.full(shape, J), rtol=1e-10)
    np.testing.assert_allclose(found.stretches, np.broadcast_to([1.3, 1.1, 0.6], (*shape, 3)), rtol=1e-9)
    smooth = post.nodal(body, found)
    np.testing.assert_allclose(smooth.von_mises, np.full(len(body.nodes), vm), rtol=1e-9)
    half = post.stress_fields(body, body.nodes @ (F - np.eye(3)).T, LAW, scale=np.full(shape, 0.5))
    np.testing.assert_allclose(half.cauchy, 0.5 * found.cauchy, rtol=1e-14)


def test_a_state_of_the_step_is_used_as_it_is(specimen):
    body, _ = specimen
    u = 0.01 * body.nodes
    state = stress.evaluate_stress(LAW, tetrahedra.displacement_gradients(body, u), False)
    np.testing.assert_array_equal(
        post.stress_fields(body, u, LAW, np.full(body.w.shape, 3.0), state).cauchy,
        post.stress_fields(body, u, LAW).cauchy,
    )


def test_small_strain_is_linear(specimen):
    body, _ = specimen
    law = LinearElastic(mu=0.01, D1=5.8)
    H = np.array([[0.02, 0.01, 0.0], [0.03, -0.01, 0.0], [0.0, 0.0, 0.005]])
    one, two = (post.stress_fields(body, k * body.nodes @ H.T, law) for k in (1.0, 2.0))
    np.testing.assert_allclose(two.cauchy, 2.0 * one.cauchy, atol=1e-14)
    np.testing.assert_allclose(two.stretches - 1.0, 2.0 * (one.stretches - 1.0), atol=1e-13)
    np.testing.assert_allclose(one.J, 1.015, rtol=1e-12)
    np.testing.assert_allclose(one.cauchy[0, 0, 0, 1], 2 * 0.01 * 0.02, rtol=1e-10)  # 2 μ ε₁₂


def test_inverted_cells_are_reported(specimen):
    body, _ = specimen
    with pytest.raises(stress.Inverted):
        post.stress_fields(body, -1.5 * body.nodes, LAW)


def test_smoothing_is_exact_for_linear_fields(specimen):
    body, _ = specimen
    g = np.array([0.3, -0.2, 0.1])
    straight = np.allclose  # curved cells map linear fields to quadratic ones: look at straight cells only
    X = body.nodes[body.cells]
    middles = 0.5 * (X[:, [0, 1, 0, 0, 1, 2]] + X[:, [1, 2, 2, 3, 3, 3]])
    curved = np.abs(X[:, 4:] - middles).max((1, 2)) > 1e-9
    inner = np.ones(len(body.nodes), bool)
    inner[body.cells[curved].ravel()] = False
    a, b = 0.1381966011250105, 0.5854101966249685  # the rule of degree 2
    L = np.full((4, 4), a) + (b - a) * np.eye(4)
    points = np.einsum("qc,mci->mqi", L, X[:, :4])
    order = np.argmin(
        np.abs(tetrahedra.get_quadrature(tetrahedra.RefTet, 2)[0].T[:, None] - L[None, :, 1:]).sum(-1), axis=1
    )
    nodes = post.to_nodes(body, (points @ g)[:, order])
    assert inner.sum() > 50
    assert straight(nodes[inner], body.nodes[inner] @ g, atol=1e-9)


# -- contact


def touched(ball, theta, k=0.05):
    """The ball's own shape under a ball of radius 3 from below: cap up to the angle θ, p = p₀ √(1 − s/s_e), outside
    a gap k (s − s_e)^{3/2} (1 + (s − s_e)/20)."""
    body, facets = ball
    surface = tractions.contact_surface(body, facets)

    def cap(x):
        return 2.0 * 9.0 * (1.0 + x[..., 2] / np.linalg.norm(x, axis=-1))

    edge = 2.0 * 9.0 * (1.0 - np.cos(theta))
    free = np.clip(cap(np.where(body.nodes == 0.0, 1e-12, body.nodes)) - edge, 0.0, None)
    x = body.nodes * (1.0 + k * free**1.5 * (1.0 + free / 20.0) / 3.0)[:, None]
    at = cap(np.einsum("qa,fai->fqi", surface.N, x[facets]))
    return surface, x, 0.02 * np.sqrt(np.clip(1.0 - at / edge, 0.0, None)), np.pi * edge


def patch(ball, theta):
    surface, x, pressure, _ = touched(ball, theta)
    return contact_patch(surface, x, pressure, np.zeros(3), 3.0, planes=(True, True))


@pytest.mark.parametrize("theta", [0.5, 0.8, 1.4])
def test_patch_of_a_cap(ball, theta):
    """Area 2πR²(1 − cos θ) and radius R sin θ of the whole, from a quarter."""
    surface, x, pressure, area = touched(ball, theta)
    found = contact_patch(surface, x, pressure, np.zeros(3), 3.0, planes=(True, True))
    np.testing.assert_allclose(found.area, area, rtol=0.03)  # the gap starts within elements of 0.4 mm
    np.testing.assert_allclose(found.radius, 3.0 * np.sin(theta), rtol=0.01)
    np.testing.assert_allclose(found.edge, found.radius, rtol=0.02)  # a circle
    np.testing.assert_allclose(found.counted_area, area, rtol=0.05)  # grain of the points
    np.testing.assert_allclose(found.counted_radius, 3.0 * np.sin(theta), rtol=0.03)
    assert np.nanmax(found.outermost) <= 3.0 * np.sin(theta) + 1e-2
    modelled = (found.directions <= np.pi / 2) | (found.directions > 6.2)
    assert np.all(np.isnan(found.outermost[~modelled])) and np.all(np.isfinite(found.outermost[modelled]))
    assert np.all(np.diff(found.points_radius) >= 0.0) and len(found.points_pressure) == (pressure > 0).sum()


def test_patch_profile_is_the_pressure(ball):
    found = patch(ball, 0.8)
    np.testing.assert_allclose(found.peak, 0.02, rtol=0.01)
    at = 2.0 * 9.0 * (1.0 - np.sqrt(1.0 - (found.profile_radius / 3.0) ** 2))
    exact = 0.02 * np.sqrt(np.clip(1.0 - at / (2.0 * 9.0 * (1.0 - np.cos(0.8))), 0.0, None))
    np.testing.assert_allclose(found.profile_pressure[:30], exact[:30], rtol=0.03)  # the edge itself is √-like
    np.testing.assert_allclose(found.profile_radius[-1], found.radius, rtol=1e-3)
    assert found.profile_pressure[-1] == 0.0


def test_the_peak_is_what_is_left_of_the_pressure_by_an_attraction(ball):
    """p − σ at the middle, below zero where the ball pulls all over; an attraction of nothing changes no bit."""
    surface, x, pressure, _ = touched(ball, 0.8)

    def peak(pull):
        return contact_patch(surface, x, pressure, np.zeros(3), 3.0, planes=(True, True), attraction=pull).peak

    plain, ones = patch(ball, 0.8).peak, np.ones_like(pressure)
    for pull in (0.005, 0.03):
        np.testing.assert_allclose(peak(pull * ones), plain - pull, rtol=0.02, atol=2e-4)  # areas have grown there
    assert peak(0.0 * ones) == peak(None) == plain


def test_fitted_area_is_smooth_where_the_counted_one_is_not(ball):
    patches = [patch(ball, theta) for theta in 0.8 + 8e-4 * np.arange(-5, 6)]
    fitted, counted = np.array([p.area for p in patches]), np.array([p.counted_area for p in patches])
    k = np.arange(len(patches))
    scatter = [np.std(y - np.polyval(np.polyfit(k, y, 2), k)) for y in (fitted, counted)]
    assert np.all(np.diff(fitted) > 0.0)
    assert scatter[0] < 1e-3 * fitted.mean()
    assert scatter[1] > 3.0 * scatter[0]  # control


def test_edge_of_a_hertz_gap():
    """u_z = [(2a² − r²) asin(a/r) + a √(r² − a²)]/(πR) outside the contact (Johnson 1985, eq. 3.42a); a is found."""
    a, R = 1.0, 3.0
    r = np.linspace(1.001, 2.5, 400)
    gap = r**2 / (2 * R) - a**2 / R + ((2 * a**2 - r**2) * np.arcsin(a / r) + a * np.sqrt(r**2 - a**2)) / (np.pi * R)
    s = 2.0 * R**2 * (1.0 - np.sqrt(1.0 - (r / R) ** 2))
    harmonics = spherical_patch._harmonics((True, True))
    angle = np.linspace(0.0, 20.0, len(r)) % (np.pi / 2)
    edge = spherical_patch._edge(s, gap, r, angle, np.ones(len(r), bool), harmonics, 0.01 * R)
    found = np.sqrt(edge[0] * (1.0 - edge[0] / (4.0 * R**2)))
    np.testing.assert_allclose(found, a, rtol=5e-3)  # the expansion ends after two terms
    np.testing.assert_allclose(edge[1], 0.0, atol=5e-3)


@pytest.mark.parametrize("planes", [(False, True), (True, False)])
def test_the_harmonics_of_a_half_model_know_its_plane(planes):
    """Directions mirrored at the plane of a half model are mirrored by θ → −θ (y = 0) or θ → π − θ (x = 0)."""
    harmonics = spherical_patch._harmonics(planes)
    theta = np.linspace(0.0, 2 * np.pi, 17)
    image = -theta if planes[1] else np.pi - theta
    np.testing.assert_allclose(harmonics(image), harmonics(theta), atol=1e-12)


def test_a_turned_patch_is_the_same(ball):
    """Nothing depends on the direction of the axis when nothing is mirrored; an unsymmetric edge is followed."""
    surface, x, pressure, _ = touched(ball, 0.8)
    R = rotation(3)
    plain = contact_patch(surface, x, pressure, np.zeros(3), 3.0)
    turned = contact_patch(surface, x @ R.T, pressure, np.zeros(3), 3.0, axis=tuple(R[:, 2]))
    np.testing.assert_allclose(turned.counted_area, plain.counted_area, rtol=1e-12)
    np.testing.assert_allclose(turned.counted_radius, plain.counted_radius, rtol=1e-12)
    np.testing.assert_allclose(turned.peak, plain.peak, rtol=0.02)  # a quarter alone leaves the harmonics loose


def test_pressure_is_per_current_area(ball):
    body, facets = ball
    surface = tractions.contact_surface(body, facets)
    pressure = np.full(surface.weights.shape, 0.01)
    found = contact_patch(surface, 2.0 * body.nodes, pressure, np.zeros(3), 6.0, planes=(True, True))
    np.testing.assert_allclose(found.largest, 0.01 / 4.0, rtol=1e-12)
    np.testing.assert_allclose(found.counted_area, 4.0 * 4.0 * np.pi * 9.0, rtol=1e-3)  # quadratic facets on a sphere


def test_no_contact_is_zero(ball):
    body, facets = ball
    surface = tractions.contact_surface(body, facets)
    found = contact_patch(surface, body.nodes, np.zeros(surface.weights.shape), np.zeros(3), 3.0)
    assert found.area == found.peak == found.radius == 0.0 and len(found.profile_radius) == 0


def test_pressure_at_nodes_is_exact_for_a_constant_and_never_negative(ball):
    body, facets = ball
    surface = tractions.contact_surface(body, facets)
    p = post.pressure_at_nodes(surface, np.full(surface.weights.shape, 0.3), len(body.nodes))
    on = np.unique(facets)
    np.testing.assert_allclose(p[on], 0.3, rtol=1e-12)
    assert np.all(np.delete(p, on) == 0.0)
    spotty = np.random.default_rng(0).random(surface.weights.shape) * (np.arange(len(facets)) % 3 == 0)[:, None]
    assert post.pressure_at_nodes(surface, spotty, len(body.nodes)).min() >= 0.0


# -- probes


def test_probes_find_the_material_points(specimen):
    body, facets = specimen
    points = np.array([[0.0, 0.0], [3.3, 1.7], [0.0, 20.0], [20.0, 0.0], [-20.0, 20.0], [12.0, -7.0], [-50.0, -5.0]])
    probes = post.surface_points(body.nodes, facets, points, planes=(True, True))
    place = probes.sign * np.einsum("ka,kai->ki", probes.N, body.nodes[probes.facets])
    np.testing.assert_allclose(place[:, :2], points, atol=1e-9)
    z = BODY.c * np.sqrt(1.0 - (points[:, 0] / BODY.a) ** 2 - (points[:, 1] / BODY.b) ** 2)
    np.testing.assert_allclose(place[:, 2], z, atol=0.3)  # the quadratic facets of a mesh this coarse


def test_probes_unfold_the_displacement(specimen):
    body, facets = specimen
    u = np.column_stack([0.1 * body.nodes[:, 0], 0.2 * body.nodes[:, 1], 0.01 * body.nodes[:, 0] - 1.0])
    points = np.array([[10.0, 5.0], [-10.0, 5.0], [10.0, -5.0], [-10.0, -5.0]])
    found = post.displacements(post.surface_points(body.nodes, facets, points, planes=(True, True)), u)
    np.testing.assert_allclose(found[:, :2], points * [0.1, 0.2], atol=1e-10)
    np.testing.assert_allclose(found[:, 2], -0.9, atol=1e-10)


def test_probes_move_continuously_with_their_place(specimen):
    body, facets = specimen
    u = np.sin(body.nodes / 7.0)
    line = np.column_stack([np.linspace(-30.0, 30.0, 1201), np.full(1201, 5.0)])
    found = post.displacements(post.surface_points(body.nodes, facets, line, planes=(True, True)), u)
    assert np.abs(np.diff(found[:, 2])).max() < 0.05  # steps of 0.05 mm; slope of the field at most about 1/3


@pytest.mark.parametrize("point", [[61.0, 0.0], [45.0, 25.0], [0.0, -36.0]])
def test_a_point_off_the_specimen_is_refused(specimen, point):
    body, facets = specimen
    with pytest.raises(ValueError, match="not on the upper surface"):
        post.surface_points(body.nodes, facets, [[0.0, 0.0], point], planes=(True, True))


def test_a_point_of_a_part_that_is_not_modelled_is_refused(specimen):
    body, facets = specimen
    with pytest.raises(ValueError, match="-10"):
        post.surface_points(body.nodes, facets, [[-10.0, 5.0]], planes=(False, True))


# -- files


def read_vtu(path):
    """Own reader of uncompressed inline VTU: name → array."""
    root = ElementTree.parse(path).getroot()
    assert root.get("header_type") == "UInt64" and root.get("byte_order") == "LittleEndian"
    out = {}
    for array in root.iter("DataArray"):
        raw = base64.b64decode(array.text)
        size = int(np.frombuffer(raw[:8], "<u8")[0])
        assert size == len(raw) - 8
        kind = {"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}[array.get("type")]
        out[array.get("Name")] = np.frombuffer(raw[8:], kind).reshape(-1, int(array.get("NumberOfComponents")))
    return out, root.find("UnstructuredGrid/Piece")


def test_vtu_round_trip(specimen, tmp_path):
    body, _ = specimen
    turned = body.cells.copy()
    turned[::2] = turned[::2][:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]  # every other cell from its other side
    u = 0.01 * body.nodes
    at = post.nodal(body, post.stress_fields(body, u, LAW))
    path = tmp_path / "step.vtu"
    post.write_vtu(
        path,
        dataclasses.replace(body, cells=turned),
        u,
        {"cauchy": at.cauchy, "J": at.J},
        {"scale": np.ones(len(body.cells))},
    )
    data, piece = read_vtu(path)
    assert int(piece.get("NumberOfPoints")) == len(body.nodes) and int(piece.get("NumberOfCells")) == len(body.cells)
    np.testing.assert_array_equal(data["Points"], body.nodes)
    np.testing.assert_array_equal(data["displacement"], u)
    np.testing.assert_array_equal(data["cauchy"], at.cauchy.reshape(-1, 9))
    cells = data["connectivity"].reshape(-1, 10)
    assert np.all(data["types"] == 24) and np.all(np.diff(data["offsets"][:, 0]) == 10)
    X = data["Points"][cells]
    volume = np.linalg.det(X[:, 1:4] - X[:, :1])
    assert np.all(volume > 0.0)  # VTK's orientation
    inner = np.abs((X[:, :4] / BODY.semi_axes) ** 2).sum(-1).max(1) < 0.9
    middles = 0.5 * (X[:, [0, 1, 2, 0, 1, 2]] + X[:, [1, 2, 0, 3, 3, 3]])  # VTK_QUADRATIC_TETRA: 01, 12, 20, 03, 13, 23
    np.testing.assert_allclose(X[inner][:, 4:], middles[inner], atol=1e-9)


def test_vtu_refuses_wrong_arrays(specimen, tmp_path):
    body, _ = specimen
    with pytest.raises(ValueError, match="J: 3 rows"):
        post.write_vtu(tmp_path / "a.vtu", body, body.nodes, {"J": np.ones(3)})
    with pytest.raises(ValueError, match="J: not finite"):
        post.write_vtu(tmp_path / "a.vtu", body, body.nodes, {"J": np.full(len(body.nodes), np.nan)})


# -- pictures


@pytest.mark.parametrize("normal", [(0, 1, 0), (1, 0, 0), (1, -1, 0), (0, 0, 1), (0.3, 0.5, 0.2)])
def test_section_has_the_area_of_the_cut_and_the_values_of_a_linear_field(specimen, normal):
    body, _ = specimen
    n = np.array(normal, float) / np.linalg.norm(normal)
    point = np.array([1.0, 2.0, 3.0]) if normal == (0.3, 0.5, 0.2) else np.zeros(3)
    g = np.array([0.3, -0.2, 0.1])
    cut = pictures.section(body, body.nodes, body.nodes @ g, point, n, split=4)
    a, b = cut.triangles[:, 1] - cut.triangles[:, 0], cut.triangles[:, 2] - cut.triangles[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    # half-plane sections of the quarter by a plane through the centre: π √(a²b²c² / (n·diag(a²,b²,c²) n)) / share
    whole = np.pi * BODY.semi_axes.prod() / np.sqrt((n**2 * BODY.semi_axes**2).sum())
    if normal in ((0, 1, 0), (1, 0, 0), (1, -1, 0)):
        np.testing.assert_allclose(area, whole / 2.0, rtol=0.02)  # straight pieces of a coarse curved mesh
    if normal == (0, 0, 1):
        np.testing.assert_allclose(area, whole / 4.0, rtol=0.02)
    across = post.pictures.plane_axes(n)
    back = cut.triangles @ across + (point @ n) * n
    np.testing.assert_allclose(cut.values, back @ g, atol=1e-3)  # a cut at a border plane is 1e-6 of the size inside


def test_section_borders_are_borders_of_cells(specimen):
    body, _ = specimen
    cut = pictures.section(body, body.nodes, body.nodes[:, 0], np.zeros(3), np.array([0.0, 1.0, 0.0]))
    length = np.linalg.norm(cut.borders[:, 1] - cut.borders[:, 0], axis=1).sum()
    faces = body.cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3)
    on = faces[(body.nodes[faces, 1] == 0.0).all(1)]
    X = body.nodes[on]
    edges = sum(np.linalg.norm(X[:, i] - X[:, j], axis=1).sum() for i, j in ((0, 1), (1, 2), (0, 2)))
    assert length > 0.95 * edges  # every edge of the plane's triangles is drawn, most of them from several cells
    assert np.all(np.isfinite(cut.borders))


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (0.5, -0.2, 1.0)])
def test_the_border_of_one_straight_cell_is_the_outline_of_its_cut(specimen, normal):
    body, _ = specimen
    X = body.nodes[body.cells]
    inner = np.nonzero((((X / BODY.semi_axes) ** 2).sum(-1) < 0.7).all(1))[0][3]
    one = dataclasses.replace(body, cells=body.cells[inner : inner + 1])
    cut = pictures.section(one, body.nodes, body.nodes[:, 2], X[inner, :4].mean(0), np.array(normal))
    length = np.linalg.norm(cut.borders[:, 1] - cut.borders[:, 0], axis=1).sum()
    np.testing.assert_allclose(length, ConvexHull(cut.borders.reshape(-1, 2)).area, rtol=1e-9)  # 2-D: its perimeter


@pytest.mark.parametrize("planes", [(True, True), (False, False)])
def test_pictures_are_drawn(specimen, tmp_path, planes):
    body, facets = specimen
    u = np.zeros_like(body.nodes)
    centre = np.array([0.0, 0.0, 37.0])
    points, p = np.array([[0.1, 0.0, 34.9], [0.5, 0.1, 34.8]]), np.array([0.01, 0.005])
    pictures.draw_section(
        tmp_path / "a.png",
        body,
        u,
        body.nodes[:, 2],
        "z (mm)",
        centre,
        Sphere(3.0),
        np.array([0.0, 0.0, -1.0]),
        planes=planes,
        contact=(points, p),
    )
    pictures.draw_surface(tmp_path / "b.png", body.nodes, facets, u, body.nodes[:, 2], "z (mm)", planes, centre, 3.0)
    pictures.draw_surface(tmp_path / "c.png", body.nodes, facets, u, body.nodes[:, 2], "z (mm)", planes)
    for name in "abc":
        assert (tmp_path / f"{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
