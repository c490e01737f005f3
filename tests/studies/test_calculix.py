"""CalculiX behind a study: its mesh and deck, and with `ccx` installed the whole study."""

import dataclasses
import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rso.calibration.plan import make_plan, source_of
from rso.cli import main
from rso.contract import Case, Programme, SimulationFailed
from rso.study.loader import load_study

STUDY = Path(__file__).parents[2] / "studies" / "calculix"
needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs ccx (apt-get install calculix-ccx)")


@pytest.fixture(scope="module")
def maker():
    spec = importlib.util.spec_from_file_location("make_mesh", STUDY / "make_mesh.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def copy(tmp_path):
    """The study in a folder of its own, without results."""
    shutil.copytree(STUDY, tmp_path / "study", ignore=shutil.ignore_patterns("results*", "__pycache__"))
    return tmp_path / "study"


def test_the_mesh_is_graded_and_right_way_round(maker):
    x = maker.graded(30.0, 0.3, 1.2)
    assert (x[0], x[-1]) == (0.0, 30.0) and 0.2 < x[1] <= 0.31
    np.testing.assert_allclose(np.diff(x)[1:] / np.diff(x)[:-1], 1.2, rtol=1e-9)  # by construction
    rows = [[(float(i), float(j)) for j in range(5)] for i in range(7)]
    _, nodes, elements = maker.mesh(rows, 1, 1)
    assert len(elements) == 6 and len(nodes) == 35 - 6  # no nodes in the middle of the 8-node elements
    for corners in elements.values():
        (r0, z0), (r1, z1), (r2, z2) = (nodes[k] for k in corners[:3])
        assert (r1 - r0) * (z2 - z1) - (z1 - z0) * (r2 - r1) > 0


def test_the_mesh_beside_the_study_is_the_one_that_its_script_makes(maker):
    made = maker.included(maker.RADIUS, maker.BALL, maker.FINEST, maker.GROWTH)
    assert (STUDY / "mesh.inp").read_text() == made


@pytest.fixture
def by_hertz(tmp_path, monkeypatch):
    """A program named ccx that reads the deck and writes a .dat file as CalculiX does, with Hertz's forces."""
    place = tmp_path / "bin"
    place.mkdir()
    program = Path(__file__).parents[1] / "rso" / "hertz_program.py"
    (place / "ccx").write_text(f'#!/bin/sh\nexec "{sys.executable}" "{program}" "$2"\n')
    (place / "ccx").chmod(0o755)
    monkeypatch.setenv("PATH", f"{place}:/usr/bin:/bin")


def test_the_deck_says_constants_and_travels_and_the_reaction_is_read(copy, by_hertz):
    plan = make_plan(load_study(copy / "study.toml"))
    (case,) = plan.cases
    answer = plan.backend({"mu": 0.01, "D1": 20.0}, case)
    u = np.array(case.programme.asked_mm)
    hertz = 16.0 / 3.0 * 0.01 * np.sqrt(3.0) * u**1.5  # Johnson, Contact Mechanics, eq. 4.23 at nu = 1/2
    np.testing.assert_allclose(answer.channels["Fz"], 180.0 * hertz, rtol=1e-6)  # of the wedge of 2 degrees
    filled = {number: text for number, text, _ in plan.backend.filled({"mu": 0.01, "D1": 20.0}, case)["hemisphere.inp"]}
    assert filled[7] == "0.005, 20\n" and filled[16] == "10\n"


def test_without_ccx_check_and_run_say_so(copy, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "/nonexistent")
    assert main(["check", str(copy)]) == 2 and main(["run", str(copy), "--jobs", "1"]) == 2
    said = capsys.readouterr().err
    assert "program 'ccx' of command" in said and "was not found" in said and "Traceback" not in said


@pytest.mark.verification
@pytest.mark.parametrize("mesh", [{"mesher": "mapped", "n": 12, "slip": 0.7}, {"level": "coarse"}], ids=str)
def test_the_reference_is_that_of_the_present_finite_elements(mesh):
    """On a coarser mesh, within what that mesh and the shipped curve, of the fine one, state for their errors."""
    from fem_backend.backend import BACKEND

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


def _backend(copy):
    return make_plan(load_study(copy / "study.toml")).backend


@needs_ccx
@pytest.mark.verification
def test_similarity_holds_in_calculix_too(copy):
    """F(c mu, D1/c) = c F(mu, D1): the penalty is a multiple of mu."""
    case = Case("c", Programme.ramp((1.0,)))
    F = [_backend(copy)({"mu": 0.01 * c, "D1": 20.0 / c}, case).channels["Fz"][0] for c in (1.0, 3.0)]
    assert F[1] == pytest.approx(3.0 * F[0], rel=2e-3)  # what ccx's own tolerance leaves


@needs_ccx
@pytest.mark.verification
def test_calculix_without_an_answer_fails(copy):
    """Deeper than its elements can follow with steps of at least a twentieth."""
    deck = copy / "hemisphere.inp"
    deck.write_text(deck.read_text().replace("0.25, 1.0, 1e-4, 0.5", "0.25, 1.0, 0.05, 0.5"))
    with pytest.raises(SimulationFailed, match="increment size smaller than minimum"):
        _backend(copy)({"mu": 0.01, "D1": 20.0}, Case("c", Programme.ramp((0.5, 30.0))))


@needs_ccx
@pytest.mark.verification
def test_a_time_out_stops_ccx_and_keeps_its_folder(copy, tmp_path):
    source = dataclasses.replace(
        source_of(load_study(copy / "study.toml")), keep_folder=str(tmp_path / "kept"), timeout_s=1.5
    )
    with pytest.raises(RuntimeError, match=r"time-out of 1\.5 s"):
        source.load()({"mu": 0.01, "D1": 20.0}, Case("c", Programme.ramp((1.0, 2.0))))
    (folder,) = (tmp_path / "kept").iterdir()
    assert (folder / "hemisphere.inp").exists() and (folder / "stdout.txt").exists()
