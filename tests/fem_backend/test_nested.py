"""Starting a fine run from the coarse one: the same answer, for fewer factorisations."""

import numpy as np
import pytest

from fem_backend import meshing
from fem_backend.accuracy import two_grid
from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import experiment, indentation
from fem_backend.solver.load_steps import Instant
from rso.contract import Case, Programme

VALUES = {"mu": 0.01, "D1": 5.8}


def case(level: str, asked: tuple[float, ...] = (0.4, 0.8), **settings: object) -> Case:
    return Case("nested", Programme.ramp(asked), {"mesh": {"level": level}, **settings})


def test_a_field_is_carried_from_mesh_to_mesh():
    """A quadratic field at the nodes of the standard mesh from those of the coarse one: off by the cells' curvature."""
    coarse, standard = (model(level) for level in ("coarse", "standard"))
    cells, N = two_grid.located_in_coarse(coarse, standard.body.nodes)
    np.testing.assert_allclose(N.sum(1), 1.0, rtol=1e-12)

    def field(X: np.ndarray) -> np.ndarray:
        return 0.02 * X[:, 0] * X[:, 2] - 0.01 * X[:, 1] ** 2 + X[:, 2]

    found = np.einsum("na,na->n", N, field(coarse.body.nodes)[cells])
    X = standard.body.nodes
    near = np.linalg.norm(X - [0.0, 0.0, 35.0], axis=1) < 5.0
    assert np.abs(found - field(X))[near].max() < 0.02  # mm, of values up to 35: cells of 0.8 mm are nearly straight
    assert np.abs(found - field(X)).max() < 2.0  # far away they are 20 mm long


def model(level: str) -> modelling.AssembledModel:
    settings = experiment.read_settings({"mesh": {"level": level}})
    knobs = BACKEND.knobs(VALUES, settings)
    return modelling.model_for(settings, knobs, modelling.placement_of(settings, knobs), None)


def test_the_answer_does_not_show_where_it_started(monkeypatch):
    """All channels to 1e-8 and the path itself as the control: without the coarse run it costs more factorisations."""
    quick = BACKEND(VALUES, case("fine", (0.6,)))
    monkeypatch.setattr(two_grid, "worthwhile", lambda settings, knobs: False)
    walked = BACKEND(VALUES, case("fine", (0.6,)))
    for name, value in walked.channels.items():
        np.testing.assert_allclose(quick.channels[name], value, rtol=1e-8, atol=1e-10, err_msg=name)
    assert quick.info["steps"] == 0 < walked.info["steps"]
    assert quick.info["factorisations"] < walked.info["factorisations"]


@pytest.mark.parametrize(
    ("level", "extra", "settings", "worth"),
    [
        ("fine", {}, {}, True),
        ("reference", {}, {"point": [20.0, 0.0]}, True),
        ("coarse", {}, {}, False),
        ("standard", {}, {}, False),
        ("fine", {"weight": 1e-5}, {}, False),
        ("fine", {}, {"support": {"kind": "bowl"}}, False),
        ("fine", {}, {"specimen": {"semi_axes": [30.0, 30.0, 30.0]}}, False),  # its coarse mesh would have to be made
    ],
)
def test_when_it_is_done(level, extra, settings, worth):
    read = experiment.read_settings({"mesh": {"level": level}, **settings})
    assert two_grid.worthwhile(read, BACKEND.knobs(VALUES | extra, read)) is worth


# ------------------------------------------------------------------------------------------------- extrapolation


def extrapolated(level: str, values: dict[str, float]) -> indentation.Result:
    read = experiment.read_settings({"mesh": {"level": level}})
    knobs = BACKEND.knobs(values, read)
    place = modelling.placement_of(read, knobs)
    built = modelling.model_for(read, knobs, place, None)
    return two_grid.extrapolated_result(
        read, knobs, place, built, [Instant(s, s, True) for s in (0.4, 0.8)], None, ("mu", "D1")
    )


def test_forces_are_extrapolated_and_nothing_else_is():
    """Here from the levels coarse and standard, since the arithmetic is the same; derivatives and reaction go along."""
    found = extrapolated("standard", VALUES)
    coarse, fine = (BACKEND(VALUES, case(level)) for level in ("coarse", "standard"))
    k = two_grid.HALVED_MESH_ERROR_SHARE
    for name in set(fine.channels) - {"time"}:
        expected = fine.channels[name]
        if name == "Fz":
            expected = (expected - k * coarse.channels[name]) / (1 - k)
            for knob in ("mu", "D1"):
                slope = (fine.gradients[knob][name] - k * coarse.gradients[knob][name]) / (1 - k)
                # refined to 1e-6 of the residual, from another start
                np.testing.assert_allclose(found.gradients[knob][name], slope, rtol=1e-4, err_msg=knob)
        np.testing.assert_allclose(found.channels[name], expected, rtol=1e-8, atol=1e-10, err_msg=name)
    np.testing.assert_allclose(found.reaction[:, 2], found.Fz, rtol=1e-6)
    assert np.all(np.abs(found.Fz / fine.channels["Fz"] - 1) > 1e-4)  # there is something to extrapolate


def test_extrapolated_forces_keep_similarity():
    """F(c μ, D₁/c) = c F(μ, D₁), to round-off of Newton's tolerance."""
    one, other = (extrapolated("coarse", {"mu": 0.01 * c, "D1": 5.8 / c}).Fz / c for c in (1.0, 7.3))
    np.testing.assert_allclose(other, one, rtol=1e-11)


def test_the_level_limit_is_that_of_the_two_nested_meshes():
    limit, reference = (experiment.read_settings({"mesh": {"level": level}}) for level in ("limit", "reference"))
    assert limit.recipe == reference.recipe and dict(limit.mesh) != dict(reference.mesh)  # one mesh, another key
    eight = meshing.subdivided(limit.specimen, meshing.template_mesh("coarse"), 2)
    assert len(meshing.template_mesh("reference").tets) == len(eight.tets)
    with pytest.raises(ValueError, match="shipped"):
        experiment.read_settings({"mesh": {"level": "limit"}, "specimen": {"semi_axes": [30.0, 30.0, 30.0]}})
