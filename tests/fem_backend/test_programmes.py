"""Travel over time: passages, returns, holds, and what of a programme can change an answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem_backend.backend import BACKEND, passages
from fem_backend.simulation import initial_state, outputs, schedule
from fem_backend.simulation.experiment import MARKS
from fem_backend.solver import history_steps
from fem_backend.solver.load_steps import Control, Instant
from rso.contract import Case, Programme, run_key

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
GRADED = {"mesher": "mapped", "n": 8, "slip": 0.5}
VALUES = {"mu": 0.01, "D1": 5.8}
RELAXING = {"prony_g": 0.4, "prony_tau": 2.0}


def run(values, programme, mesh=SMALL, **settings):
    return BACKEND({**VALUES, **values}, Case("c", programme, {"mesh": mesh, **settings}))


@pytest.mark.parametrize(
    ("values", "settings", "falls"),
    [
        ({}, {}, False),
        (RELAXING, {}, True),
        ({"prony_g2": 0.4}, {}, True),
        ({"friction": 0.3}, {}, False),
        ({}, {"material": {"law": "neo_hookean", "prony": [[0.4, 2.0]]}}, True),
    ],
    ids=["elastic", "Prony", "second term", "friction", "of the settings"],
)
def test_a_model_that_says_it_relaxes_has_a_force_that_falls_at_rest(values, settings, falls):
    """Friction depends on the way, too, and keeps its force; 0.4 of the shear stress relaxes, at least 0.05 of the
    force."""
    programme = Programme((0.0, 1.0, 26.0), (0.0, 0.5, 0.5), (0.5,), (2.0, 26.0))
    case = Case("c", programme, {"mesh": SMALL, **settings})
    kept, canonical = BACKEND.canonical({**VALUES, **values}, case)
    F = BACKEND(kept, canonical).channels["Fz"]
    assert BACKEND.relaxes({**VALUES, **values}, case.settings) is falls
    assert bool(F[-1] < 0.95 * F.max()) == falls


# ---------------------------------------------------------------------------------------------- passages


def test_passages_are_in_order_of_time_with_every_corner():
    programme = Programme((0.0, 4.0, 6.0, 8.0), (0.0, 2.0, 2.0, 0.0), (0.5, 1.0), (5.0,))
    assert passages(programme) == [
        Instant(1.0, 0.5, True),
        Instant(2.0, 1.0, True),
        Instant(4.0, 2.0, False),
        Instant(5.0, 2.0, True),
        Instant(6.0, 2.0, False),
        Instant(7.0, 1.0, True),
        Instant(7.5, 0.5, True),
        Instant(8.0, 0.0, False),
    ]


def test_a_turning_point_is_passed_once():
    programme = Programme((0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 0.5, 1.0), (0.5, 1.0))
    asked = [(i.time, i.travel) for i in passages(programme) if i.asked]
    assert asked == [(0.5, 0.5), (1.0, 1.0), (2.0, 0.5), (3.0, 1.0)]


@pytest.mark.parametrize("deepest", np.round(np.arange(0.1, 3.05, 0.1), 1))
def test_the_end_of_a_ramp_is_its_last_passage(deepest):
    """Whatever the last bit of a·t/a is: one instant, asked, at the end of the programme."""
    for speed in (0.5, 1.0, 0.3):
        programme = Programme.ramp((float(deepest),), speed)
        assert passages(programme) == [Instant(programme.time_s[-1], float(deepest), True)]


@pytest.mark.parametrize("values", [{}, {"friction": 0.3}, RELAXING], ids=["elastic", "friction", "prony"])
def test_every_passage_has_an_answer(values):
    """As many rows as the programme passes asked travels and moments, at their times and travels."""
    programme = Programme((0.0, 0.8, 1.6, 2.3), (0.0, 0.8, 0.8, 0.1), (0.3, 0.8), (1.1, 1.6, 2.3))
    r = run(values, programme)
    np.testing.assert_allclose(r.channels["time"], [0.3, 0.8, 1.1, 1.6, 2.1, 2.3], rtol=1e-12)
    np.testing.assert_allclose(r.channels["travel"], [0.3, 0.8, 0.8, 0.8, 0.3, 0.1], rtol=1e-12)
    assert all(len(c) == 6 for c in r.channels.values())


# ---------------------------------------------------------------------------------------------- returns and holds


def test_elastic_body_returns_on_its_loading_curve(graded):
    up = graded.solve(Programme((0.0, 2.0, 4.0), (0.0, 2.0, 0.0), (0.5, 1.0, 2.0)))
    np.testing.assert_array_equal(up.travel, [0.5, 1.0, 2.0, 1.0, 0.5])
    np.testing.assert_array_equal(up.Fz[[3, 4]], up.Fz[[1, 0]])


@pytest.mark.parametrize("values", [RELAXING, {"mullins": 0.5}], ids=["prony", "mullins"])
def test_memory_shows_between_loading_and_unloading(values):
    """Loading is stiffer than unloading, and the loop is open; the elastic one above is closed."""
    F = run(values, Programme((0.0, 2.0, 4.0), (0.0, 2.0, 0.0), (1.0, 1.5, 2.0)), GRADED).channels["Fz"]
    assert np.all(F[[1, 0]] > 1.02 * F[[3, 4]]), F


def test_path_of_an_elastic_law_ends_at_the_elastic_answer(graded):
    """The two drivers on one problem: `follow` (as for friction) and `travel`."""
    elastic = graded.solve([1.0, 2.0])
    at = initial_state.initial_state(graded.settings, graded.knobs, graded.placement, graded.model, elastic.counters)
    steps = schedule.instants_with_steps(passages(Programme((0.0, 2.0, 3.0), (0.0, 2.0, 1.0), (1.0, 2.0))), 0.4)
    points = history_steps.follow_history(at.system, at.start, steps, Control(), elastic.counters, at.seated)
    F = [outputs.whole(graded.placement, p.force)[2] for p in points]
    np.testing.assert_allclose(F, elastic.Fz[[0, 1, 0]], rtol=1e-6)


def test_hold_relaxes_to_the_long_time_modulus():
    """F falls monotonically in a hold, at its end to that of an elastic body with (1 − g) μ and the same K."""
    times = (1.0, 1.5, 2.5, 5.0, 10.0, 100.0)
    r = run({"prony_g": 0.4, "prony_tau": 2.0}, Programme((0.0, 1.0, 100.0), (0.0, 1.0, 1.0), (1.0,), times))
    F = r.channels["Fz"]
    np.testing.assert_allclose(r.channels["time"], times)
    assert np.all(np.diff(F) < 0)
    instant, relaxed = (run({"mu": m}, Programme.ramp((1.0,))).channels["Fz"][0] for m in (0.01, 0.006))
    assert instant > F[0] > relaxed + 0.5 * (instant - relaxed)  # half a relaxation time: not yet relaxed
    np.testing.assert_allclose(F[-1], relaxed, rtol=1e-3)  # the penalty is that of μ, not of 0.6 μ
    assert abs(F[-1] / (0.6 * instant) - 1) > 0.01  # negative control: volume does not relax


def test_force_depends_on_the_speed_only_through_the_relaxation_time():
    """Twice the speed and half the relaxation time is the same test in another clock."""
    one = run({"prony_g": 0.4, "prony_tau": 2.0}, Programme.ramp((0.5, 1.0), 1.0))
    two = run({"prony_g": 0.4, "prony_tau": 1.0}, Programme.ramp((0.5, 1.0), 2.0))
    slow = run({"prony_g": 0.4, "prony_tau": 2.0}, Programme.ramp((0.5, 1.0), 0.1))
    np.testing.assert_allclose(two.channels["Fz"], one.channels["Fz"], rtol=1e-9)
    assert np.all(slow.channels["Fz"] < 0.95 * one.channels["Fz"])  # negative control


def test_second_loading_of_a_softened_body_is_weaker_until_it_goes_deeper():
    """Mullins: below the deepest travel the second loading follows the unloading; beyond, the first loading."""
    F = run(
        {"mullins": 0.6, "mullins_m": 0.01}, Programme((0, 1, 2, 3.5), (0, 1.0, 0.5, 1.5), (0.75, 1.0, 1.5)), GRADED
    )
    once = run({"mullins": 0.6, "mullins_m": 0.01}, Programme.ramp((0.75, 1.0, 1.5)), GRADED).channels["Fz"]
    F = F.channels["Fz"]  # 0.75 1.0 | 0.75 | 0.75 1.0 1.5
    assert F[3] < 0.98 * F[0]
    # what is kept is the largest energy at the steps, without multipliers: their error is that of the path
    np.testing.assert_allclose(F[3], F[2], rtol=1e-3)
    np.testing.assert_allclose(F[[4, 5]], once[[1, 2]], rtol=1e-3)


def test_travel_before_the_test_softens():
    """`earlier` is the same as having loaded and unloaded before, but for the penalty between asked travels (0.4 %)."""
    values = {"mullins": 0.6, "mullins_m": 0.01}
    F = [run(values, Programme.ramp((1.0,)), GRADED, earlier=e).channels["Fz"][0] for e in (0.0, 1.0, 2.0)]
    assert F[2] < 0.98 * F[0] and F[1] < F[0] * (1 + 1e-6)
    cycle = run(values, Programme((0, 2, 3, 4), (0, 2.0, 0.5, 1.0), (1.0,)), GRADED).channels["Fz"][2]
    np.testing.assert_allclose(F[2], cycle, rtol=5e-3)


@pytest.mark.verification
@pytest.mark.parametrize(
    "knobs,allowed", [(RELAXING, 2e-3), ({"friction": 0.3}, 5e-3), ({"mullins": 0.5}, 1e-3)], ids=lambda v: str(v)
)
def test_answer_of_a_path_is_that_of_finer_steps(graded, knobs, allowed):
    """Steps between asked travels four times as small: the error of the path is below that of the mesh levels."""
    b = graded.other(**knobs)
    coarse = b.solve([0.5, 1.5])
    fine = b.solve([0.5, 1.5], control=replace(Control(), path=Control().path / 4))
    np.testing.assert_allclose(coarse.Fz, fine.Fz, rtol=allowed, err_msg=str(knobs))


# ---------------------------------------------------------------------------------------------- canonical form


def key(values, programme=None, **settings):
    case = Case("c", programme or Programme.ramp((0.5, 1.0)), {"mesh": SMALL, **settings})
    return run_key(BACKEND, *BACKEND.canonical({**VALUES, **values}, case))


def test_elastic_runs_at_three_speeds_are_one():
    programmes = [Programme.ramp((0.5, 1.0), v) for v in (0.1, 1.0, 7.0)]
    programmes.append(Programme((0.0, 1.0, 9.0), (0.0, 2.0, 0.0), (0.5, 1.0)))
    assert len({key({}, p) for p in programmes}) == 1
    assert len({key(RELAXING, p) for p in programmes}) == 4
    assert len({key({"friction": 0.2}, p) for p in programmes}) == 4


def test_groups_that_are_off_are_not_in_the_key():
    for off in (
        {"prony_tau": 9.0},
        {"prony_g": 0.0, "prony_tau": 9.0},
        {"mullins_m": 0.3},
        {"fibre_angle": 20.0},
        {"skin_ratio": 1.0, "skin_thickness": 2.0},
        {"inclusion_x": 3.0, "inclusion_radius": 2.0},
        {"adhesion_range": 0.5},
        {"bowl_clearance": 2.0, "bowl_friction": 0.5},
        {"skin_thickness": 0.0, "skin_ratio": 2.0},
    ):
        assert key(off) == key({}), off
    on = [
        RELAXING,
        {**RELAXING, "prony_tau": 3.0},
        {"mullins": 0.2},
        {"fibre": 1e-3},
        {"fibre": 1e-3, "fibre_angle": 5},
        {"skin_ratio": 2.0},
        {"skin_ratio": 2.0, "skin_thickness": 0.6},
        {"inclusion_ratio": 2.0},
        {"inclusion_ratio": 2.0, "inclusion_radius": 4.0},
        {"adhesion": 1e-4},
    ]
    assert len({key(v) for v in [{}, *on]}) == len(on) + 1  # negative control


def test_settings_of_what_is_off_are_not_in_the_key():
    bowl = {"support": {"kind": "bowl", "clearance": 1.0, "friction": 0.2}}
    assert key({}, earlier=2.0) == key({}) != key({"mullins": 0.3}, earlier=2.0)
    assert key({"mullins": 0.3}, earlier=2.0) != key({"mullins": 0.3})
    assert key({}, direction="normal") == key({}) != key({}, direction="normal", point=[5, 0])
    assert key({}, **bowl) == key({"bowl_clearance": 1.0, "bowl_friction": 0.2}, support={"kind": "bowl"})
    assert key({}, **bowl) != key({"bowl_clearance": 1.5}, **bowl)  # a value overrides the setting


def test_canonical_form_marks_what_rolls_and_nothing_else():
    """The mark is of bodies that may turn in a bowl and whose way counts, so that the keys of all others stay."""
    bowl = {"support": {"kind": "bowl"}}

    def mark(values, **settings):
        case = Case("c", Programme.ramp((0.5, 1.0)), {"mesh": SMALL, **settings})
        kept, plain = BACKEND.canonical({**VALUES, **values}, case)
        assert BACKEND.canonical(kept, plain) == (kept, plain)
        return plain.settings["support"].get("rolling")

    rubs, slides = {"bowl_friction": 0.2}, {"bowl_friction": 0.0}
    assert mark(rubs, **bowl, point=[5.0, 0.0]) == mark({**rubs, "offset_y": 0.1}, **bowl) == MARKS["rolling"]
    assert mark({**slides, "mullins": 0.2}, **bowl, point=[5.0, 0.0]) == MARKS["rolling"]
    assert mark(rubs, **bowl) is mark(slides, **bowl, point=[5.0, 0.0]) is None
    assert mark({"friction": 0.3}, point=[5.0, 0.0]) is mark({"offset_y": 0.1}) is None


def test_canonical_form_marks_where_the_fine_elements_go_along():
    def mark(**knobs):
        case = Case("c", Programme.ramp((0.5, 1.0)), {"mesh": SMALL})
        kept, plain = BACKEND.canonical({**VALUES, **knobs}, case)
        assert BACKEND.canonical(kept, plain) == (kept, plain)
        return plain.settings["mesh"].get("follows")

    assert {mark(**{name: 0.5}) for name in ("offset_x", "offset_y", "tilt_x", "tilt_y")} == {MARKS["follows"]}
    assert mark() is mark(offset_x=0.0) is mark(friction=0.2) is None


def test_a_key_says_that_derivatives_are_not_wanted_where_there_would_be_some():
    def mark(wanted, **knobs):
        case = Case("c", Programme.ramp((0.5, 1.0)), {"mesh": SMALL, "derivatives": wanted})
        kept, plain = BACKEND.canonical({**VALUES, **knobs}, case)
        assert BACKEND.canonical(kept, plain) == (kept, plain)
        return plain.settings.get("derivatives")

    assert mark(False) is False
    assert mark(True) is mark(False, friction=0.2) is mark(False, weight=1e-5) is None
    cases = [Case("c", Programme.ramp((0.5,)), {"derivatives": wanted}) for wanted in (False, True)]
    assert len({BACKEND.recipes(VALUES, case)["anchor"] for case in cases}) == 1  # one anchor serves both


def test_canonical_task_has_the_same_answer():
    """The programme that is stored gives the forces of the one that was asked."""
    values = {**VALUES, "skin_ratio": 1.0, "skin_thickness": 1.0, "prony_tau": 3.0}
    case = Case("c", Programme((0.0, 0.25, 1.0), (0.0, 1.0, 0.0), (0.5, 1.0)), {"mesh": SMALL})
    one, two = BACKEND(values, case), BACKEND(*BACKEND.canonical(values, case))
    np.testing.assert_array_equal(one.channels["Fz"][:2], two.channels["Fz"])


def test_asked_moments_are_in_the_key_of_a_path_only():
    programmes = [Programme((0.0, 1.0, 2.0), (0.0, 1.0, 1.0), (0.5, 1.0), moments) for moments in ((), (2.0,))]
    assert len({key(RELAXING, p) for p in programmes}) == 2


def test_elastic_answer_has_a_row_for_every_passage_that_was_asked():
    """Whoever asks an elastic body for its unloading or a hold gets the rows in canonical form too."""
    case = Case("c", Programme((0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 1.0, 0.0), (0.5, 1.0), (1.5,)), {"mesh": SMALL})
    direct = BACKEND(VALUES, case)
    canonical = BACKEND(*BACKEND.canonical(VALUES, case))
    # at an asked travel the canonical answer is known; what it says elsewhere is for the caller to spread
    np.testing.assert_array_equal(direct.channels["travel"], [0.5, 1.0, 1.0, 0.5])
    by_travel = dict(zip(canonical.channels["travel"], canonical.channels["Fz"], strict=True))
    assert [by_travel[s] for s in direct.channels["travel"]] == direct.channels["Fz"].tolist()


def test_moments_between_asked_travels_are_not_lost():
    """A moment at which an elastic body is at a travel that is not asked for: the canonical form must keep it."""
    case = Case("c", Programme((0.0, 1.0), (0.0, 1.0), (1.0,), (0.3, 1.0)), {"mesh": SMALL})
    canonical = BACKEND(*BACKEND.canonical(VALUES, case))
    np.testing.assert_allclose(canonical.channels["travel"], [0.3, 1.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "tolerance"),
    [(SMALL, 3e-3), pytest.param({"level": "coarse"}, 1.5e-3, marks=pytest.mark.verification)],
    ids=["crude", "coarse"],
)
def test_in_a_hold_forces_fall_exponentially_to_the_elastic_ones_of_what_is_left(mesh, tolerance):
    """One Prony term: F(t) = F_∞ + (F(0) − F_∞) e^{−t/τ}, F_∞ that of (1 − g) μ at the same D₁.

    Not exactly: the area of contact moves a little, the less the finer the mesh.
    """
    g, tau, way = 0.35, 3.0, 6.0
    rest = np.array([0.0, 0.5, 1.0, 3.0, 10.0, 100.0])
    asked = tuple(way + float(v) for v in rest)
    programme = Programme((0.0, way, way + 100.0), (0.0, 2.0, 2.0), (2.0,), asked)
    values = {"mu": 0.01, "D1": 5.8}
    r = BACKEND({**values, "prony_g": g, "prony_tau": tau}, Case("c", programme, {"mesh": mesh}))
    F = np.interp(asked, r.channels["time"], r.channels["Fz"])
    relaxed = BACKEND({**values, "mu": (1 - g) * 0.01}, Case("c", Programme.ramp((2.0,)), {"mesh": mesh}))
    end = relaxed.channels["Fz"][0]
    np.testing.assert_allclose(F, end + (F[0] - end) * np.exp(-rest / tau), rtol=0, atol=tolerance * F[0])
    assert F[0] - F[-1] > 0.1 * F[0]
