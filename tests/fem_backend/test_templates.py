import hashlib
import json

import numpy as np
import pytest
from skfem import MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend import meshing
from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing import BadMesh, templates

NOMINAL = templates.TEMPLATE_BODY


def volume(mesh: MeshTet2) -> float:
    """By the quadratic map itself; every integration point has the sign of its element."""
    w = mesh.mapping().detDF(get_quadrature(RefTet, 2)[0])
    assert (w.min(1) * w.max(1) > 0).all()
    return float(np.abs(w).sum() / 24.0)  # four points of weight 1/24


@pytest.mark.parametrize("level", templates.TEMPLATE_SIZINGS)
def test_shipped_template_is_the_quarter_ellipsoid(level):
    mesh = meshing.make_mesh(meshing.template_recipe(level))
    X = mesh.vertices
    assert mesh.tets.dtype == np.int64 and X[:, :2].min() == 0.0 and meshing.volumes(mesh).min() > 0
    for axis in (0, 1):
        assert X[X[:, axis] > 0, axis].min() > 1e-3
    assert (X[:, 2] == 0.0).sum() > 5 and np.any(np.all(X == NOMINAL.top, axis=1))
    quadratic = meshing.assemble(mesh, NOMINAL, NOMINAL)
    assert meshing.scaled_jacobian(quadratic).min() > 0.18
    np.testing.assert_allclose(volume(quadratic), NOMINAL.volume() / 4, rtol=2e-3)


def test_levels_get_finer():
    sizes = [len(meshing.template_mesh(level).tets) for level in templates.TEMPLATE_SIZINGS]
    assert sizes == sorted(sizes) and sizes[-1] > 5 * sizes[0]


FARTHEST = (20.0, 20.0)  # from the top, where the finest level is moved daily


@pytest.mark.parametrize(
    "level, point",
    [
        pytest.param(level, point, marks=pytest.mark.verification if level == "fine" and point != FARTHEST else ())
        for level in ("coarse", "standard", "fine")
        for point in ((2.5, 2.5), FARTHEST, (-20.0, 5.0), (0.0, 25.0))
    ],
)
def test_templates_stand_being_moved(level, point):
    """Quality and volume go down with the distance from the top but no element is spoilt."""
    mesh = meshing.template_mesh(level)
    for body in (NOMINAL, EllipsoidShape(66.0, 31.5, 38.5)):
        placed = meshing.assemble(mesh, NOMINAL, body, point, (False, False))
        assert meshing.scaled_jacobian(placed).min() > 0.07
        np.testing.assert_allclose(volume(placed), body.volume(), rtol=8e-3)


def test_reference_template_stands_being_moved():
    mesh = meshing.template_mesh("reference")
    for point, planes in (((20.0, 0.0), (False, True)), ((0.0, 20.0), (True, False)), ((0.0, 0.0), (True, True))):
        placed = meshing.assemble(mesh, NOMINAL, NOMINAL, point, planes)
        np.testing.assert_allclose(volume(placed), NOMINAL.volume() / 4 * 2 ** (2 - sum(planes)), rtol=1e-3)


def test_recipe_names_the_numbers():
    """A store that keeps the recipe finds out when a later version ships another mesh under the level's name."""
    recipe = json.loads(meshing.template_recipe("coarse"))
    mesh = meshing.template_mesh("coarse")
    assert recipe["sha256"] == hashlib.sha256(mesh.vertices.tobytes() + mesh.tets.tobytes()).hexdigest()
    with pytest.raises(BadMesh, match="not the one of the recipe"):
        meshing.make_mesh(json.dumps({**recipe, "sha256": "0" * 64}))
    larger = EllipsoidShape(120.0, 70.0, 70.0)
    np.testing.assert_array_equal(meshing.make_mesh(json.dumps(recipe)).vertices, mesh.vertices)
    scaled = meshing.make_mesh(meshing.template_recipe("coarse", larger)).vertices
    np.testing.assert_array_equal(scaled, 2.0 * mesh.vertices)
    with pytest.raises(KeyError, match="no template 'finest'"):
        meshing.template_recipe("finest")


def test_templates_are_not_copied_to_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh = meshing.cached(meshing.template_recipe("coarse"))
    np.testing.assert_array_equal(mesh.vertices, meshing.template_mesh("coarse").vertices)
    assert list(tmp_path.iterdir()) == []


def test_fit_of_the_templates():
    """They fit a body of the reference size and any enlargement of body and indenter together."""
    assert meshing.template_fits(NOMINAL, 3.0) and meshing.template_fits(EllipsoidShape(120.0, 70.0, 70.0), 6.0)
    assert meshing.template_fits(EllipsoidShape(66.0, 31.5, 38.5), 3.0)
    assert not meshing.template_fits(NOMINAL, 6.0)
    assert not meshing.template_fits(EllipsoidShape(35.0, 35.0, 35.0), 3.0)


# ------------------------------------------------------------------------------------------------- refined


def test_refined_mesh_is_the_same_body_in_smaller_pieces():
    coarse = meshing.mapped_quarter(NOMINAL, 6, 0.3)
    missing = []
    for n in (1, 2, 3, 4):
        fine = meshing.subdivided(NOMINAL, coarse, n)
        assert len(fine.tets) == n**3 * len(coarse.tets) and meshing.volumes(fine).min() > 0
        missing.append(1 - meshing.volumes(fine).sum() * 4 / NOMINAL.volume())
        X = fine.vertices
        assert len(np.unique(np.round(X, 9), axis=0)) == len(X), "neighbours share their points"
        facets = meshing.with_mid_edge_nodes(NOMINAL, fine)
        on = np.unique(facets.facets[:, facets.boundary_facets()])
        r = np.linalg.norm(X[on] / NOMINAL.semi_axes, axis=1)
        plane = (X[on, :2] == 0.0).any(1)
        np.testing.assert_allclose(r[~plane], 1.0, rtol=0, atol=1e-14)
        assert (X[:, 2] == 0.0).sum() >= n * 3
    slope = -np.polyfit(np.log([1, 2, 3, 4]), np.log(missing), 1)[0]
    assert 1.9 < slope < 2.1, "straight pieces miss the surface by the square of their size"


def test_refining_keeps_what_is_there():
    coarse = meshing.mapped_quarter(NOMINAL, 6, 0.3)
    old = {tuple(x) for x in np.round(coarse.vertices, 9).tolist()}
    assert old <= {tuple(x) for x in np.round(meshing.subdivided(NOMINAL, coarse, 2).vertices, 9).tolist()}
    same = meshing.subdivided(NOMINAL, coarse, 1)
    np.testing.assert_allclose(np.sort(meshing.volumes(same)), np.sort(meshing.volumes(coarse)), rtol=1e-10)
