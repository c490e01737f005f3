"""Pull-off in full: JKR with a shorter and shorter range, DMT with a long one, jumps, and steps of any length."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem_backend import closed_forms
from fem_backend.backend import BACKEND, passages
from fem_backend.simulation import assembly, contact_elements, indentation
from fem_backend.simulation.experiment import read_settings
from rso.contract import Case, Programme

pytestmark = pytest.mark.verification

HALF_SPACE = runpy.run_path(str(Path(__file__).parents[2] / "studies" / "pull_off" / "half_space.py"))
R, MU, W = 1.0, 0.01, 4e-6
STIFF, P = 4.0 * MU, np.pi * W * R
FOLD = -closed_forms.jkr_jump_off(R, W, STIFF)[0]
BALL = {
    "specimen": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "radius": R},
    "material": {"law": "linear_elastic"},
    "mesh": {"level": "coarse"},
}


def values(tabor: float) -> dict[str, float]:
    reach = (R * W**2 / (STIFF**2 * tabor**3)) ** (1.0 / 3.0)
    return {"mu": MU, "D1": 2.0 / (1000.0 * MU), "adhesion": W, "adhesion_range": reach}


def pulled(tabor: float):
    programme = Programme((0.0, 1.0, 2.0), (0.0, FOLD, -1.6 * FOLD), tuple(np.array([-1.6, -0.5, 0.5]) * FOLD))
    return BACKEND(values(tabor), Case("c", programme, BALL)).info


def test_a_shorter_range_comes_nearer_to_jkr():
    """Pull-off over π w R and travel of the jump over JKR's: 11 and 5 % off at μ_T = 1 and 2, both falling."""
    found = [pulled(t) for t in (1.0, 2.0)]
    pulls = np.array([f["pull_off_N"] / P + 1.5 for f in found])
    assert np.all(pulls < 0.0) and abs(pulls[1]) < 0.6 * abs(pulls[0]) and abs(pulls[1]) < 0.1
    assert abs(found[1]["jump_off_mm"] / FOLD + 1.0) < 0.08
    assert abs(found[1]["jump_off_before_N"] / P + 5.0 / 6.0) < abs(found[0]["jump_off_before_N"] / P + 5.0 / 6.0)


def test_a_long_range_is_that_of_dmt():
    """Near −2 π w R, within 1 % of the independent program, which has −1.96 at μ_T = 0.1; and nothing jumps."""
    info, v = pulled(0.1), values(0.1)
    theirs = HALF_SPACE["curve"](R, W, STIFF, v["adhesion_range"], 0.6 * FOLD, 160, 1.0).force.min()
    assert info["pull_off_N"] == pytest.approx(theirs, rel=0.01)
    assert info["pull_off_N"] / P == pytest.approx(-2.0, abs=0.06)
    assert "jump_off_mm" not in info


def test_a_ball_is_pulled_in_where_an_independent_program_says():
    v = values(2.0)
    programme = Programme((0.0, 1.0), (-2.0 * FOLD, 0.5 * FOLD), (0.5 * FOLD,))
    info = BACKEND(v, Case("c", programme, BALL)).info
    s, F = HALF_SPACE["curve"](R, W, STIFF, v["adhesion_range"], FOLD, 240).way_there()
    assert info["jump_in_mm"] == pytest.approx(s[-1], rel=0.01)
    assert info["jump_in_before_N"] == pytest.approx(F[-1], rel=0.05)
    assert info["jump_in_released"] > 0.0


def test_jumps_do_not_hang_on_the_steps():
    """Steps of a third of the length let go within half a per cent of the travel."""
    settings, programme = read_settings(BALL), Programme((0.0, 1.0, 2.0), (0.0, FOLD, -1.6 * FOLD), (0.5 * FOLD,))
    knobs = BACKEND.knobs(values(1.0), settings)
    settings = contact_elements.resolved(settings, knobs, FOLD)
    place = assembly.placement_of(settings, knobs)
    model = assembly.model_for(settings, knobs, place, None)
    instants = [*passages(programme)[:-1], replace(passages(programme)[-1], asked=True)]
    at = []
    for shorter in (1.0, 1.0 / 3.0):
        control = replace(settings.control, path=shorter * 0.5 * FOLD)
        at.append(
            indentation.simulate_indentation(replace(settings, control=control), knobs, place, model, instants).notes
        )
    assert at[1]["jump_off_mm"] == pytest.approx(at[0]["jump_off_mm"], rel=0.005)
    assert at[1]["pull_off_N"] == pytest.approx(at[0]["pull_off_N"], rel=0.005)
