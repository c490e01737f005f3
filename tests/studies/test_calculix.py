"""CalculiX behind a study: the driver's deck and parser, and with `ccx` installed the whole study."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rso.cli import main

STUDY = Path(__file__).parents[2] / "studies" / "calculix"
needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs ccx (apt-get install calculix-ccx)")
LONG = pytest.mark.verification  # fTetWild makes a mesh of its own for this body, the mapped one is as fine


@pytest.fixture(scope="module")
def driver():
    spec = importlib.util.spec_from_file_location("ccx_indentation", STUDY / "ccx_indentation.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def copy(tmp_path):
    """The study in a folder of its own, without results."""
    shutil.copytree(STUDY, tmp_path / "study", ignore=shutil.ignore_patterns("results*", "__pycache__"))
    return tmp_path / "study"


def test_the_mesh_is_graded_and_right_way_round(driver):
    x = driver.graded(30.0, 0.3, 1.2)
    assert (x[0], x[-1]) == (0.0, 30.0) and 0.2 < x[1] <= 0.31
    np.testing.assert_allclose(np.diff(x)[1:] / np.diff(x)[:-1], 1.2, rtol=1e-9)  # by construction
    rows = [[(float(i), float(j)) for j in range(5)] for i in range(7)]
    _, nodes, elements = driver.mesh(rows, 1, 1)
    assert len(elements) == 6 and len(nodes) == 35 - 6  # no nodes in the middle of the 8-node elements
    for corners in elements.values():
        (r0, z0), (r1, z1), (r2, z2) = (nodes[k] for k in corners[:3])
        assert (r1 - r0) * (z2 - z1) - (z1 - z0) * (r2 - r1) > 0


def test_the_forces_are_read_from_what_ccx_prints(driver):
    text = """
 total force (fx,fy,fz) for set BALLNODES and time  0.5000000E+00

        1.0E-04 -2.0E-04 -1.3E-14

 total force (fx,fy,fz) for set BALLNODES and time  0.1000000E+01

        1.0E-04 -4.0E-04 -1.3E-14
"""
    assert driver.forces(text) == [(0.5, -2e-4), (1.0, -4e-4)]


def test_the_schema_is_one(copy):
    from rso.evaluation import load_backend

    backend = load_backend(command=[sys.executable, "ccx_indentation.py"], base=copy)
    assert [p.name for p in backend.parameters] == ["mu", "D1"] and backend.channels["Fz"] == "N"


def test_without_ccx_runs_crash_in_words(copy, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent) + ":/nonexistent")
    text = (copy / "study.toml").read_text()
    (copy / "study.toml").write_text(text.replace('"python3"', json.dumps(sys.executable)))
    assert main(["run", str(copy), "--jobs", "1"]) == 3
    said = capsys.readouterr()
    assert "no run is done" in said.out and "the program ccx is not on the PATH" in said.out
    assert "Traceback" not in said.out + said.err
    kept = list((copy / "results" / "kept").iterdir())
    assert kept and all((folder / "request.json").exists() for folder in kept)


@pytest.mark.parametrize(
    "mesh", [{"mesher": "mapped", "n": 12, "slip": 0.7}, pytest.param({"level": "coarse"}, marks=LONG)], ids=str
)
def test_the_reference_is_that_of_the_present_finite_elements(mesh):
    """On a coarser mesh, within what that mesh and the shipped curve, of the fine one, state for their errors."""
    from fem_backend.backend import BACKEND
    from rso.contract import Case, Programme

    depth, F = np.loadtxt(STUDY / "measured" / "hemisphere.csv", delimiter=",", comments="#", skiprows=4).T
    settings = {
        "specimen": {"shape": "ellipsoid", "semi_axes": [35.0, 35.0, 35.0]},
        "indenter": {"shape": "sphere", "radius": 3.0},
        "support": {"kind": "fixed"},
        "material": {"law": "neo_hookean"},
        "mesh": mesh,
    }
    answer = BACKEND({"mu": 0.010, "D1": 20.0}, Case("top", Programme.ramp(tuple(map(float, depth))), settings))
    of_both = np.hypot(answer.error["Fz"], 0.004 * F)  # 0.4 % is in the file's head; meshes differ between processors
    assert np.all(np.abs(answer.channels["Fz"] - F) < of_both)
    # and that says something: 0.5 mm is half an edge of the coarse ones, of which no two by fTetWild are alike
    assert np.all(answer.error["Fz"] < 0.05 * F)


@needs_ccx
@pytest.mark.verification
def test_calculix_finds_the_same_modulus(copy):
    command = [sys.executable, "-m", "rso.cli", "run", str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((copy / "results" / "results.json").read_text())
    assert found["counts"]["failed"] == found["counts"]["crashed"] == 0
    (candidate,) = found["searches"][0]["candidates"]
    assert candidate["verified"] and candidate["values"]["mu"] == pytest.approx(0.010, rel=0.02)
    assert candidate["metrics"]["top"]["nrmse"] < 0.02
    assert list((copy / "results" / "kept").iterdir()) == []  # folders of runs that are done are removed


@needs_ccx
@pytest.mark.verification
def test_similarity_holds_in_calculix_too(copy, driver, tmp_path, monkeypatch):
    """F(c mu, D1/c) = c F(mu, D1): the penalty is a multiple of mu."""
    case = {"settings": {"h": 0.6, "growth": 1.4}, "programme": {"asked_mm": [1.0]}}
    F = []
    for c in (1.0, 3.0):
        (tmp_path / str(c)).mkdir()
        monkeypatch.chdir(tmp_path / str(c))
        answer = driver.solve({"mu": 0.01 * c, "D1": 20.0 / c}, case)
        F.append(answer["channels"]["Fz"][0])
    assert F[1] == pytest.approx(3.0 * F[0], rel=2e-3)  # what ccx's own tolerance leaves


@needs_ccx
@pytest.mark.verification
def test_a_time_out_stops_ccx_and_keeps_its_folder(copy, tmp_path):
    from rso.contract import Case, Programme
    from rso.evaluation import load_backend

    backend = load_backend(
        command=[sys.executable, "ccx_indentation.py"], base=copy, keep_folder=tmp_path / "kept", timeout_s=1.5
    )
    with pytest.raises(RuntimeError, match=r"time-out of 1\.5 s"):
        backend({"mu": 0.01, "D1": 20.0}, Case("c", Programme.ramp((1.0, 2.0)), {"h": 0.1, "growth": 1.05}))
    (folder,) = (tmp_path / "kept").iterdir()
    assert (folder / "job.inp").exists() and (folder / "ccx.log").exists()
