"""Flat specimens in three dimensions: their grids, and what their forces must have in common."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from skfem import MeshTet

from fem_backend.backend import BACKEND
from fem_backend.kinematics import tetrahedra
from fem_backend.meshing import BadMesh, grids, make_mesh, volumes
from fem_backend.meshing.placing import scaled_jacobian
from fem_backend.simulation import assembly, experiment
from fem_backend.specimens.block import Cuboid
from fem_backend.specimens.cylinder import Cylinder
from fem_backend.specimens.half_space import MODELLED_LENGTHS, MODELLED_LENGTHS_IN_SPACE, HalfSpace
from fem_backend.specimens.slab import Slab
from rso.contract import Case, Programme, SimulationFailed

QUARTER, WHOLE = (True, True), (False, False)
SIDE = np.array([0.0, 0.3, 0.7, 1.5]), np.array([0.0, 0.5, 0.8, 1.2]), np.array([0.0, 0.4, 0.9, 1.0])
ON = {"indenter": {"shape": "sphere", "radius": 3.0}, "support": {"kind": "bonded"}, "derivatives": False}
SLAB = {"shape": "slab", "thickness": 6.0}
PUCK = {"shape": "cylinder", "radius": 10.0, "height": 6.0}
BLOCK = {"shape": "block", "size": [20.0, 16.0, 6.0]}


@pytest.fixture
def crude(monkeypatch):
    """The level coarse with elements of nearly twice the size: quick, and as symmetric as the others."""
    monkeypatch.setitem(grids.GRID_SIZE_FACTORS, "coarse", 4.0)
    experiment._read_again.cache_clear()
    yield
    experiment._read_again.cache_clear()


def solve(specimen: dict, values: dict | None = None, depth: float = 0.5, **table):
    """A run and its forces (3,) N at a depth (mm); K/μ = 20."""
    settings = {"specimen": specimen, "mesh": {"level": "coarse"}, **ON, **table}
    case = Case("flat", Programme.ramp((depth,), 1.0), settings)
    solved = BACKEND.solve({"mu": 0.01, "D1": 10.0, **(values or {})}, case)
    return solved, np.array([solved.result.channels[n][0] for n in ("Fx", "Fy", "Fz")])


def mesh_of(specimen, point=(0.0, 0.0), planes=QUARTER, level="coarse"):
    """Its quadratic mesh for a ball of 3 mm."""
    recipe = specimen.meshing(3.0, "tetwild", level, 0, 0.0).recipe
    return specimen.quadratic(make_mesh(recipe), recipe, point, planes)


def volume(mesh) -> float:
    """Volume (mm³) of curved elements by the quadrature of the solver, which refuses those inside out."""
    return float(tetrahedra.discretise(mesh, np.zeros(mesh.doflocs.T.shape, bool)).w.sum())


def single(tets: np.ndarray) -> int:
    """How many facets belong to one tetrahedron only."""
    facets = np.sort(np.concatenate([np.delete(tets, k, axis=1) for k in range(4)]), axis=1)
    return int((np.unique(facets, axis=0, return_counts=True)[1] == 1).sum())


# ------------------------------------------------------------------------------------------------------------ grids


@pytest.mark.parametrize("edges", ["", "upright", "all"])
@pytest.mark.parametrize("count", [3, 4])
def test_a_cut_grid_fills_its_box_and_fits_together(edges, count):
    """Every facet inside has two tetrahedra: single ones are two for each of the rectangles outside."""
    x, y, z = (v[:count] for v in SIDE)
    mesh = grids.cut(x, y, z, edges)
    assert volumes(mesh).min() > 0.0
    assert volumes(mesh).sum() == pytest.approx(x[-1] * y[-1] * z[-1], rel=1e-13)
    assert single(mesh.tets) == 2 * 6 * (count - 1) ** 2


def test_boxes_that_are_all_cut_alike_do_not_fit():
    """The control: without alternating corners facets inside have diagonals that cross."""
    cells = np.array(list(itertools.product(range(2), repeat=3)))
    tets = grids._placed(cells, grids._five(True))
    tets = np.ravel_multi_index(tuple(tets.transpose(2, 0, 1)), (3, 3, 3))
    assert single(tets) > 2 * 6 * 2**2


def test_diagonals_meet_the_edges_that_a_map_makes_smooth():
    """No facet has all its corners on the two faces of such an edge but on none of them alone."""
    n = len(SIDE[0]) - 1
    for edges, flat in (("", True), ("all", False)):
        mesh = grids.cut(*(np.arange(n + 1.0),) * 3, edges)
        out = mesh.vertices == n  # on x = n, y = n, z = n
        facets = np.concatenate([np.delete(mesh.tets, k, axis=1) for k in range(4)])
        across = [(out[facets][..., [i, j]].any(-1)).all(1) & ~out[facets].all(1).any(1) for i, j in ((0, 1), (0, 2))]
        assert any(a.any() for a in across) is flat


@pytest.mark.parametrize(
    "specimen",
    [
        pytest.param(Slab(6.0, ((0.5, 5.0), (1.0, 2.0)), 24.0), id="slab"),
        pytest.param(Cylinder(10.0, 5.0, 0.0, ((0.5, 5.0),)), id="cylinder"),
        pytest.param(Cuboid(20.0, 16.0, 5.0, ((0.5, 5.0),)), id="block"),
    ],
)
def test_no_element_lies_in_two_layers(specimen):
    mesh = mesh_of(specimen)
    z = mesh.doflocs[2][mesh.t[:4]]
    for height in specimen.planes_of_layers()[1:-1]:
        assert np.isclose(z, height, rtol=1e-12).any()
        assert not ((z.min(0) < height * (1 - 1e-9)) & (z.max(0) > height * (1 + 1e-9))).any()


@pytest.mark.parametrize("point,planes", [((0.0, 0.0), QUARTER), ((4.0, 0.0), (False, True)), ((-3.0, 5.0), WHOLE)])
def test_a_round_mesh_has_the_volume_of_the_cylinder(point, planes):
    """π r² h to 5e-4 on the coarsest mesh, which has arcs of 10 to 50°, and a node where the contact is."""
    mesh = mesh_of(Cylinder(10.0, 5.0), point, planes)
    assert 2 ** sum(planes) * volume(mesh) == pytest.approx(np.pi * 500.0, rel=5e-4)
    away = np.linalg.norm(mesh.doflocs.T - [*point, 5.0], axis=1)
    assert away.min() < 1e-12
    assert np.hypot(*mesh.doflocs[:2]).max() == pytest.approx(10.0, rel=1e-12)


@pytest.mark.parametrize(("radius", "height", "fillet"), [(5.0, 10.0, 2.4), (3.0, 10.0, 1.4), (4.0, 3.0, 1.4)])
def test_a_wide_rounding_turns_no_element_over_beside_the_axis(radius, height, fillet):
    """Curves of edges that would turn their cells over are taken back; the volume is that of the body to 1 %."""
    mesh = mesh_of(Cylinder(radius, height, fillet), (1.0, 0.0), (False, True))
    assert scaled_jacobian(mesh).min() > 0.0
    share = 1.0 - np.pi / 4.0  # of a square of the rounding that is taken away, about a circle by Pappus
    exact = np.pi * radius**2 * height - 2.0 * np.pi * (radius - fillet + fillet / (6.0 * share)) * share * fillet**2
    assert 2.0 * volume(mesh) == pytest.approx(exact, rel=0.01)


def test_a_rounded_edge_takes_away_what_it_should():
    """By Pappus: (1 − π/4) f² less, its centroid (1 − 1/(6 (1 − π/4))·…) from the side; one element across to 3 %."""
    R, h, f = 10.0, 5.0, 1.0
    square, quarter = f * f * 2 * np.pi * (R - f / 2), np.pi / 4 * f * f * 2 * np.pi * (R - f + 4 * f / (3 * np.pi))
    taken = np.pi * R * R * h - 4.0 * volume(mesh_of(Cylinder(R, h, f)))
    assert taken == pytest.approx(square - quarter, rel=0.03)


def test_the_same_elements_at_every_place_and_size():
    """The answer is smooth in the place and in errors of sizes: elements keep their corners, nodes move a little."""
    recipe = Cuboid(20.0, 16.0, 5.0).meshing(3.0, "tetwild", "coarse", 0, 0.0).recipe
    quarter = make_mesh(recipe)
    first = Cuboid(20.0, 16.0, 5.0).quadratic(quarter, recipe, (2.0, 1.0), WHOLE)
    other = Cuboid(20.01, 16.0, 5.0).quadratic(quarter, recipe, (2.01, 1.0), WHOLE)
    assert (first.t == other.t).all()
    assert 0.0 < np.abs(first.doflocs - other.doflocs).max() < 0.03


def test_a_place_at_the_very_edge_still_has_a_mesh():
    for specimen, point in ((Cuboid(20.0, 16.0, 5.0), (10.0, 8.0)), (Cylinder(10.0, 5.0), (0.0, -10.0))):
        mesh = mesh_of(specimen, point, WHOLE)
        assert volume(mesh) == pytest.approx(specimen.volume(), rel=1e-2)


def test_elements_that_turn_over_are_refused():
    """A wide rounding between thin layers, its grid drawn to one side."""
    with pytest.raises(BadMesh, match="turned over"):
        mesh_of(Cylinder(10.0, 5.0, 2.0, ((0.3, 2.0),)), (0.0, 7.9), (True, False))


def test_a_half_space_is_held_below_and_nowhere_else():
    specimen = HalfSpace(3000.0)
    mesh = mesh_of(specimen)
    X = mesh.doflocs.T
    base = specimen.part("base", X)
    assert np.ptp(X[base, 2]) == 0.0
    assert X[base, 2].max() == pytest.approx(3000.0 * (1.0 - MODELLED_LENGTHS_IN_SPACE / MODELLED_LENGTHS))
    assert specimen.part("upper", X)[X[:, 2] == 3000.0].all()


def test_recipes_are_cut_from_their_words():
    """The recipe holds all that the mesh depends on: it is kept under the hash of that."""
    recipe = Slab(6.0, (), 24.0).meshing(3.0, "tetwild", "coarse", 0, 0.0).recipe
    words = json.loads(recipe)
    assert words["mesher"] == grids.GRID_MESHER and words["z"] == [0.0, 6.0] and words["x"][-1] == 4 * 6.0 + 4 * 3.0
    a, b = make_mesh(recipe), make_mesh(recipe)
    assert a.to_bytes() == b.to_bytes()


# ------------------------------------------------------------------------------------------------------------ forces


def test_quarter_half_and_whole_are_one_slab(crude):
    """To the tolerance of equilibrium, 1e-9 of the forces."""
    _, quarter = solve(SLAB, {"fibre": 1e-6})
    solved, half = solve(
        SLAB, {"fibre": 1e-6, "inclusion_ratio": 1.0 + 1e-12, "inclusion_radius": 1.0, "inclusion_x": 1}
    )
    assert solved.placement.planes == (False, True)
    np.testing.assert_allclose(half, quarter, rtol=1e-7, atol=1e-8)


def test_a_block_turned_by_a_quarter_turn_has_turned_forces(crude):
    _, (Fx, Fy, Fz) = solve(BLOCK, point=[8.0, 6.0])
    _, turned = solve({**BLOCK, "size": [16.0, 20.0, 6.0]}, point=[-6.0, 8.0])
    np.testing.assert_allclose(turned, [-Fy, Fx, Fz], rtol=1e-7, atol=1e-9)
    assert Fx > 1e-3 * Fz and Fy > 1e-3 * Fz  # the side at the edge gives way


def test_places_at_one_distance_from_the_axis_of_a_puck_are_alike(crude):
    """The half model on an axis and the whole one elsewhere are the same grid, turned."""
    _, (F, _, Fz) = solve(PUCK, point=[5.0, 0.0])
    solved, there = solve(PUCK, point=[3.0, -4.0])
    assert solved.placement.planes == WHOLE
    np.testing.assert_allclose(there, [0.6 * F, -0.8 * F, Fz], rtol=1e-7, atol=1e-9)


def test_a_place_says_nothing_on_a_slab(crude):
    """All places are alike: also beside a tilt, about which it turns in its top."""
    a, first = solve(SLAB, {"tilt_x": 2.0})
    b, other = solve(SLAB, {"tilt_x": 2.0, "offset_x": 1.0}, point=[30.0, -7.0])
    np.testing.assert_array_equal(first, other)
    # the ball on its way through the middle of the top first touches R tan(tilt) beside it
    assert np.abs(a.placement.contact - [0.0, 3.0 * np.tan(np.deg2rad(2.0)), 6.0]).max() < 1e-12
    assert a.placement.planes == b.placement.planes == (True, False)


def test_a_tilted_slab_pushes_along_its_normal(crude):
    """Without friction and far from all edges the force is normal to the surface, and that of the depth along it.

    To 0.4 % of the force on these crude elements; it is turned by 3°, 5 % of it.
    """
    angle = np.deg2rad(3.0)
    solved, F = solve(SLAB, {"tilt_x": 3.0})
    along = solved.placement.rotation @ F
    _, upright = solve(SLAB, {"fibre": 1e-9}, depth=0.5 * np.cos(angle))
    assert abs(F[1]) > 0.04 * F[2]
    assert abs(along[1]) < 4e-3 * along[2]
    assert along[2] == pytest.approx(upright[2], rel=5e-3)


def test_a_wide_block_is_a_slab(crude):
    """Of the slab's own width they are the same problem, through the specimen's own geometry each."""
    _, slab = solve(SLAB, {"fibre": 1e-9})
    _, block = solve({"shape": "block", "size": [72.0, 72.0, 6.0]})
    np.testing.assert_allclose(block, slab, rtol=1e-6, atol=1e-9)
    _, narrow = solve({"shape": "block", "size": [11.0, 11.0, 6.0]})
    assert narrow[2] < 0.99 * slab[2]


def test_errors_of_sizes_act(crude):
    """The mesh of the nominal block takes the sizes of the actual one; a thicker one is softer, a wider one stiffer."""
    small = {**BLOCK, "size": [11.0, 11.0, 6.0]}
    _, (_, _, F) = solve(small)
    solved, (_, _, thick) = solve(small, {"delta_lz": 1.0})
    other, (_, _, wide) = solve(small, {"delta_lx": 3.0})
    assert solved.model.body.nodes.max(0) == pytest.approx([5.5, 5.5, 7.0])
    assert other.model.body.nodes.max(0) == pytest.approx([7.0, 5.5, 6.0])
    assert thick < 0.99 * F and wide > 1.002 * F


@pytest.mark.parametrize(
    "specimen,values",
    [
        pytest.param(PUCK, {"tilt_y": 3.0}, id="tilt of a puck"),
        pytest.param({**PUCK, "fillet": 1.0}, {"offset_x": 2.0}, id="puck with rounded edge"),
        pytest.param(SLAB, {"fibre": 0.01}, id="fibres"),
        pytest.param(BLOCK, {"inclusion_ratio": 3.0, "inclusion_radius": 1.5, "inclusion_x": 2.0}, id="inclusion"),
        pytest.param(SLAB, {"skin_ratio": 3.0, "skin_thickness": 0.5, "tilt_x": 1.0}, id="skin"),
        pytest.param({**BLOCK, "layers": [{"thickness": 1.0, "ratio": 5.0}]}, {}, id="layers"),
        pytest.param({"shape": "half_space"}, {"tilt_x": 1.0}, id="half-space"),
    ],
)
def test_what_breaks_the_revolution_runs(crude, specimen, values):
    solved, (_, _, F) = solve(specimen, values)
    assert not solved.placement.meridian and np.isfinite(F) and F > 0.0
    assert BACKEND.response(solved).error["Fz"][0] > 0.0


def test_stated_errors_know_which_mesh_was_used(crude):
    """The meridian has much finer elements: where a contact is smaller than half of one, that has to be said."""
    shares = []
    for values in ({}, {"fibre": 1e-9}):
        solved, (_, _, F) = solve(SLAB, values, depth=0.05)
        shares.append(BACKEND.response(solved).error["Fz"][0] / F)
    assert shares[1] > 2.0 * shares[0]


# ------------------------------------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize(
    "table,words",
    [
        ({"specimen": {**BLOCK, "size": [20.0, 0.0, 5.0]}}, "specimen.size"),
        ({"specimen": {**BLOCK, "layers": [{"thickness": 7.0, "ratio": 2.0}]}}, "specimen.layers"),
        ({"specimen": BLOCK, "point": [0.0, 9.0]}, "1 mm beside the flat top"),
        ({"specimen": BLOCK, "profile": [[12.0, 0.0]]}, "2 mm beside the flat top"),
        ({"specimen": PUCK, "point": [8.0, 8.0]}, "beside the flat top"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(table, words):
    with pytest.raises(ValueError, match=words.replace("[", r"\[")):
        experiment.read_settings({**ON, **table})


def test_a_block_without_size_is_refused_by_its_knob():
    with pytest.raises(SimulationFailed, match="delta_ly"):
        solve(BLOCK, {"delta_ly": -15.0})


def test_a_block_is_never_taken_for_a_body_of_revolution():
    settings = experiment.read_settings({**ON, "specimen": {**BLOCK, "size": [20.0, 20.0, 6.0]}})
    knobs = BACKEND.knobs({"mu": 0.01, "D1": 10.0}, settings)
    assert not assembly.placement_of(settings, knobs).meridian


def test_distances_of_a_block_are_those_of_its_surface():
    """Against the nearest of many points of its faces; to their spacing."""
    block = Cuboid(4.0, 6.0, 3.0)
    a = np.linspace(-1.0, 1.0, 61)
    faces = [np.insert(np.array(list(itertools.product(a, a))), k, s, axis=1) for k in range(3) for s in (-1.0, 1.0)]
    points = np.concatenate(faces) * [2.0, 3.0, 1.5] + [0.0, 0.0, 1.5]
    for x in ([0.5, 0.2, 5.0], [4.0, 1.0, 4.0], [-3.0, -4.0, 1.0], [2.5, -3.5, 3.5]):
        assert block.distance(np.array(x))[0] == pytest.approx(np.linalg.norm(points - x, axis=1).min(), abs=0.01)
    inside = np.array([0.3, -2.4, 2.0])
    assert float(block.depth(inside)) == pytest.approx(0.6)


def test_meshes_have_their_fine_elements_below_the_contact():
    """Mean length of the edges within a length of the indenter: a third of those far from it at most."""
    mesh = mesh_of(Cuboid(60.0, 60.0, 8.0), (10.0, -5.0), WHOLE)
    linear = MeshTet(mesh.doflocs[:, : mesh.t[:4].max() + 1], mesh.t[:4])
    ends = linear.p[:, linear.edges]
    length, at = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=0), ends.mean(1).T
    away = np.linalg.norm(at - [10.0, -5.0, 8.0], axis=1)
    assert length[away < 3.0].mean() < length[away > 20.0].mean() / 3.0
