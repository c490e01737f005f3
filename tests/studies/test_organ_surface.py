"""The organ of the study: its file is what the script writes, the backend models its tests, the data fit the model."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from fem_backend.meshing.closed_surface import closed, enclosed_volume
from fem_backend.meshing.surface_files import read_surface
from fem_backend.simulation import experiment
from rso.calibration.plan import make_plan
from rso.study.loader import load_study

FOLDER = Path(__file__).parents[2] / "studies" / "organ_surface"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("make_surface", FOLDER / "make_surface.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_file_is_what_the_script_writes(script, tmp_path):
    script.write_stl(tmp_path / "kidney.stl", *script.kidney(13))
    found, kept = (read_surface(folder / "kidney.stl") for folder in (tmp_path, FOLDER))
    assert np.array_equal(found[1], kept[1])
    np.testing.assert_allclose(found[0], kept[0], atol=1e-4)  # single precision, and exp of other machines


def test_the_organ_is_one_closed_body_with_a_hollow(script):
    body = closed(*read_surface(FOLDER / "kidney.stl"))
    assert body.repairs == () and len(body.facets) == 3380
    assert 0.11e6 < enclosed_volume(body.vertices, body.facets) < 0.14e6  # mm³: kidneys have 100 to 200 ml
    hilum = body.vertices[np.abs(body.vertices[:, 0]) < 5.0]
    poles = body.vertices[np.abs(body.vertices[:, 0]) > 25.0]
    assert hilum[:, 1].max() + 5.0 < poles[:, 1].max()


def test_the_backend_models_every_test(script):
    """Their places are those of the script, and the smooth surface of 3 380 facets is the formula to 0.02 mm."""
    study = load_study(FOLDER)
    plan = make_plan(study)
    assert {c.name for c in plan.cases} == {e.name for e in study.experiments if e.role == "fit"}
    for name, where in script.TESTS.items():
        settings = study.settings_of(name)
        assert settings["point"] == where["point"] and settings.get("direction") == where.get("direction")
        specimen = experiment.read_settings(settings).specimen
        fine = script.kidney(64)[0]
        on, normal = specimen.above(*where["point"])
        near = fine[np.linalg.norm(fine - on, axis=1) < 2.0]
        assert len(near) > 10
        assert np.abs(specimen.depth(near)).max() < 0.02
        assert normal[2] > 0.9
