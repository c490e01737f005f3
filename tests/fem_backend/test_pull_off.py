"""Pull-off: negative travel, jumps and forces under attraction, beside closed forms and an independent program."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem_backend import closed_forms
from fem_backend.backend import BACKEND, passages
from fem_backend.simulation import contact_elements
from fem_backend.simulation.experiment import read_settings
from fem_backend.solver import jumps
from fem_backend.solver.jumps import JumpRecord, OnBranch
from rso.contract import Case, Programme, SimulationFailed

HALF_SPACE = runpy.run_path(str(Path(__file__).parents[2] / "studies" / "pull_off" / "half_space.py"))
R, MU = 1.0, 0.01
STIFF = 4.0 * MU  # E* of an incompressible body
VALUES = {"mu": MU, "D1": 2.0 / (1000.0 * MU)}
BALL = {
    "specimen": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "radius": R},
    "material": {"law": "linear_elastic"},
}


def attraction(tabor: float, w: float = 1e-4 * STIFF * R) -> dict[str, float]:
    """Knobs of a work of adhesion (N/mm) whose range gives a Tabor parameter."""
    return {"adhesion": w, "adhesion_range": (R * w**2 / (STIFF**2 * tabor**3)) ** (1.0 / 3.0)}


def fold(w: float) -> float:
    """How far (mm) JKR draws the body up until it jumps."""
    return -closed_forms.jkr_jump_off(R, w, STIFF)[0]


def cycle(knobs, deepest: float, high: float, asked, start: float = 0.0, level: str = "coarse"):
    programme = Programme((0.0, 1.0, 2.0), (start, deepest, -high), tuple(asked))
    return BACKEND({**VALUES, **knobs}, Case("c", programme, {**BALL, "mesh": {"level": level}}))


# ------------------------------------------------------------------------------------------------- programmes


def test_a_programme_goes_above_the_specimen():
    """Negative travels are asked for on the way back, and on the way there of a programme that begins above."""
    programme = Programme((0.0, 2.0, 6.0), (0.0, 2.0, -2.0), (-1.0, 0.0, 1.0))
    assert [(i.time, i.travel) for i in passages(programme) if i.asked] == [(1, 1), (3, 1), (4, 0), (5, -1)]
    above = Programme((0.0, 3.0, 6.0), (-1.0, 2.0, -1.0), (-0.5, 1.0))
    assert [(i.travel, i.asked) for i in passages(above)] == [
        (-1.0, False), (-0.5, True), (1.0, True), (2.0, False), (1.0, True), (-0.5, True), (-1.0, False),
    ]  # fmt: skip


@pytest.mark.parametrize("asked", [(-2.5, 1.0), (-1.0, 2.5), (1.0, -1.0), ()])
def test_travels_outside_of_a_programme_are_refused(asked):
    with pytest.raises(ValueError, match="asked_mm"):
        Programme((0.0, 2.0, 6.0), (0.0, 2.0, -2.0), asked)


def test_a_programme_that_never_goes_above_asks_for_nothing_there():
    with pytest.raises(ValueError, match=r"\(0, 2\] mm"):
        Programme((0.0, 2.0, 4.0), (0.0, 2.0, 0.0), (0.0, 1.0))


def test_a_programme_begins_at_contact_or_above():
    with pytest.raises(ValueError, match=r"above the specimen.*not at 0.1 mm"):
        BACKEND.check(Case("c", Programme((0.0, 1.0), (0.1, 1.0), (1.0,)), BALL))


def test_without_attraction_a_ball_above_the_body_feels_nothing():
    """Rows of negative travel are there, with no force, and those below are those of a ramp."""
    case = Case("c", Programme((0.0, 1.0, 2.0), (0.0, 0.2, -0.1), (-0.05, 0.1)), {**BALL, "mesh": {"level": "coarse"}})
    r = BACKEND(VALUES, case)
    np.testing.assert_array_equal(r.channels["travel"], [0.1, 0.1, -0.05])
    assert r.channels["Fz"][2] == 0.0 and r.channels["contact_radius"][2] == 0.0
    ramp = BACKEND(VALUES, Case("c", Programme.ramp((0.1, 0.2)), case.settings)).channels["Fz"]
    np.testing.assert_allclose(r.channels["Fz"][:2], ramp[0], rtol=1e-6)


# ------------------------------------------------------------------------------------------------- closed forms


def test_jkr_lets_go_where_its_branch_ends():
    """Least force −(3/2)πwR; dδ/da = 0 at the fold, by differences of the curve."""
    w = 3e-5
    a = np.linspace(1e-3, 0.5, 200_001)
    depth, force = closed_forms.jkr(a, R, w, STIFF)
    k = int(np.argmin(depth))
    d, F = closed_forms.jkr_jump_off(R, w, STIFF)
    np.testing.assert_allclose([force.min(), depth[k], force[k]], [closed_forms.jkr_pull_off(R, w), d, F], rtol=1e-4)
    np.testing.assert_allclose(closed_forms.jkr_force(depth[k + 100 :: 5000], R, w, STIFF), force[k + 100 :: 5000],
                               rtol=1e-4, atol=1e-9)  # fmt: skip
    assert closed_forms.jkr_force(np.array([1.01 * d]), R, w, STIFF)[0] == 0.0


def test_maugis_has_jkr_and_dmt_as_its_limits():
    """σ₀ → ∞ at fixed w: −3/2 and the whole curve; σ₀ → 0: −2 π w R (Maugis 1992, fig. 8)."""
    w = 3e-5
    a = np.linspace(0.1, 0.3, 9)
    depth, force = closed_forms.maugis(a, R, w, STIFF, 3e3 * w)
    near = closed_forms.jkr(a, R, w, STIFF)
    np.testing.assert_allclose(force, near[1], atol=0.02 * np.pi * w * R)
    np.testing.assert_allclose(depth, near[0], atol=0.02 * fold(w))
    small = np.linspace(1e-3, 0.15, 200)
    pulls = [closed_forms.maugis(small, R, w, STIFF, s * w)[1].min() / (np.pi * w * R) for s in (0.2, 3e3)]
    np.testing.assert_allclose(pulls, [-2.0, -1.5], atol=0.01)


def test_tabors_parameter_is_the_transition_of_maugis():
    """λ = 1.16 μ_T where σ₀ is the largest attraction of Lennard-Jones, 16 w/(9√3 z₀) (Johnson & Greenwood 1997)."""
    w, z0 = 3e-5, 2e-3
    peak, K = 16.0 * w / (9.0 * 3**0.5 * z0), 4.0 / 3.0 * STIFF
    lam = 2.0 * peak * (R / (np.pi * w * K**2)) ** (1.0 / 3.0)
    assert lam / closed_forms.tabor(R, w, STIFF, z0) == pytest.approx(1.157, abs=0.002)


# ------------------------------------------------------------------------------------------------- what is a jump


def along(*points: tuple[float, float, float]) -> list[OnBranch]:
    return [OnBranch(s, f, k, 0.0, True) for s, f, k in points]


def test_a_smooth_step_is_no_jump_and_a_drop_is_one():
    """f = −√(s − s_f): near its fold, a short step is explained by its slopes; a drop of a fifth of the pull is not."""
    here = JumpRecord(pull=1.0, length=1.0, least=1e-3)
    f, k = (lambda s: -(s**0.5), lambda s: -0.5 / s**0.5)
    a, b = along((0.04, f(0.04), k(0.04)), (0.03, f(0.03), k(0.03)))
    assert not jumps.is_unexplained(here, a, b)
    assert jumps.is_unexplained(here, a, replace(b, force=b.force + 0.2))


def test_the_fold_is_foreseen_by_the_trend():
    """1/κ² falls linearly: steps end at a share of what is left to the fold, never beyond it."""
    here, s = JumpRecord(pull=1e-3, length=1.0, least=1e-6), 0.04
    last = None
    for _ in range(12):
        now = OnBranch(s, -(s**0.5), -0.5 / s**0.5, 0.0, True).after(last)
        step = jumps.longest_step(here, last, now) if last is not None and last.trend else 0.2 * s
        assert step < s
        last, s = now, s - step
    assert s < 1e-3


# ------------------------------------------------------------------------------------------------- the whole run


@pytest.fixture(scope="module")
def between():
    """A cycle in the transition, μ_T = 1, with an independent curve of the same law."""
    knobs = attraction(1.0)
    d = fold(knobs["adhesion"])
    asked = np.array([-1.6, -0.8, -0.3, 0.5, 1.5]) * d
    theirs = HALF_SPACE["curve"](R, knobs["adhesion"], STIFF, knobs["adhesion_range"], 1.6 * d, 120)
    return knobs, d, cycle(knobs, 1.5 * d, 1.7 * d, asked), theirs


def test_forces_are_those_of_an_independent_program(between):
    """On the branch and, once it has jumped off, away from it; till then less than a tenth of the pull is stated."""
    knobs, d, r, theirs = between
    (s, F), (s_there, F_there) = theirs.way_back(), theirs.way_there()
    back = slice(int(np.argmax(r.channels["travel"])), None)
    travel, ours, stated = (v[back] for v in (r.channels["travel"], r.channels["Fz"], r.error["Fz"]))
    P = np.pi * knobs["adhesion"] * R
    expected = np.where(travel > s[0], np.interp(travel, s, F), np.interp(travel, s_there, F_there))
    assert np.all(np.abs(ours - expected) < stated + 0.01 * P)
    assert np.all(stated[travel > -d] < 0.1 * P)


def test_the_pull_off_is_noted(between):
    """Between JKR and DMT, that of the independent program within 2 %, with Tabor's parameter."""
    knobs, _, r, theirs = between
    P = np.pi * knobs["adhesion"] * R
    assert r.info["pull_off_N"] == pytest.approx(theirs.force.min(), rel=0.02)
    assert -2.0 < r.info["pull_off_N"] / P < -1.5
    d = -theirs.way_back()[0][0]
    assert r.info["jump_off_mm"] == pytest.approx(-d, rel=0.01)
    assert r.info["jump_off_before_N"] < 0.5 * r.info["pull_off_N"] < r.info["jump_off_after_N"] < 0.0
    assert r.info["jump_off_released"] > 0.0
    assert r.info["tabor"] == pytest.approx(1.0, rel=1e-3)


def test_an_elastic_body_comes_back_on_its_way(between):
    """Where nothing jumps the way back is the way there: conservative, whatever steps were taken."""
    travel, Fz = between[2].channels["travel"], between[2].channels["Fz"]
    for s in np.unique(travel[travel > 0.0]):
        each = Fz[travel == s]
        np.testing.assert_allclose(each, each[0], rtol=1e-4)


def test_a_range_that_no_grid_resolves_is_refused():
    said = r"adhesion_range = .* mm: attraction acts on .*Tabor parameter"
    with pytest.raises(SimulationFailed, match=said) as failed:
        cycle(attraction(60.0), 1e-3, 1e-3, (1e-3,))
    assert failed.value.cause == "not_supported"


def test_elements_follow_the_attraction():
    """Short ranges get finer elements, in steps of √2; a range beyond the usual elements changes nothing."""
    settings = read_settings(BALL)
    knobs = BACKEND.knobs({**VALUES, **attraction(2.0)}, settings)
    fine = contact_elements.resolved(settings, knobs, 0.01).fine
    less = contact_elements.resolved(settings, replace(knobs, adhesion_range=0.5 * knobs.adhesion_range), 0.01).fine
    assert fine is not None and less is not None
    assert (
        fine[0]
        <= contact_elements.zone(knobs) / contact_elements.N_ELEMENTS_PER_ANNULUS
        < 2**0.5 * fine[0] * (1.0 + 1e-12)
    )
    assert less[0] == pytest.approx(fine[0] / 4.0)
    none = replace(knobs, adhesion=0.0)
    assert contact_elements.resolved(settings, none, 0.5) is settings


def test_nothing_is_said_of_a_mesh_that_resolves_the_adhesion_whatever_its_level():
    from fem_backend.backend import BACKEND

    settings = {"specimen": {"shape": "half_space"}, "indenter": {"shape": "sphere", "radius": 2.0}}
    assert (
        BACKEND.resolution(settings, 0.04, ("mu", "D1"))
        and BACKEND.resolution(settings, 0.04, ("mu", "adhesion")) == {}
    )
