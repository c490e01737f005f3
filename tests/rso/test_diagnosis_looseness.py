"""The freedom that an effect is given: on which readings it acts and how much."""

import dataclasses

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.discrepancy import build_library, make_test_plan
from rso.discrepancy.evidence import model_form_tolerance
from rso.discrepancy.evidence.hypotheses import tiles
from rso.discrepancy.evidence.model_form_tolerance import loops, with_tolerance
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS
from rso.discrepancy.library.prediction import predict

MODULUS, TOLERANCE = 0.012, DIAGNOSIS_SETTINGS.tolerance


@pytest.fixture(scope="module")
def library():
    names = ("stiff", "soften", "clearance")
    found = build_library(toy.base(), make_test_plan(toy.laboratory(toy.TRUTH, 0)), toy.effects(*names), toy.run)
    return dataclasses.replace(found, rubbing=frozenset({"soften"}))


def own(library, name):
    base = tiles(library, (), MODULUS)
    effects = tuple(e for e in library.effects if e.name == name)
    return effects, tiles(library, effects, MODULUS, False, base), base


def back(library) -> np.ndarray:
    """Which readings (n,) are on a way back."""
    found = np.zeros(library.plan.n, bool)
    for item, _, at in library.plan.rows():
        found[at] = item.branch == 1
    return found


def test_a_loop_lives_on_the_way_back_and_is_the_widest_one_at_its_base(library):
    effects, t, _ = own(library, "soften")
    found = loops(library, effects, t, MODULUS)
    home = back(library)
    # tiles stand on a basis that is good to 2e-5 of the largest force
    limit = 4e-5 * np.abs(t.lift(t.A)).max()
    assert np.abs(found[:, ~home]).max() < limit
    # softening: weaker on the way back, but for what tables between 0.98 and 1 of the peak make of the turn
    assert found[:, home].min() < -20 * limit and found[:, home].max() < 0.1 * np.abs(found[:, home]).max()
    largest = t.at[:, 1] == t.at[:, 1].max()
    for x in np.unique(t.at[:, 0]):
        mine = t.at[:, 0] == x
        np.testing.assert_array_equal(found[mine], np.broadcast_to(found[mine & largest], found[mine].shape))


@pytest.mark.parametrize(("name", "more"), [("soften", True), ("stiff", False)])
def test_only_what_rubs_may_come_back_otherwise(library, name, more):
    effects, t, base = own(library, name)
    loose = with_tolerance(library, effects, t, base, MODULUS)
    added = loose.sd[len(t.sd) :]
    ordinary = len(with_tolerance(dataclasses.replace(library, rubbing=frozenset()), effects, t, base, MODULUS).sd)
    assert len(loose.sd) - ordinary == more
    assert not more or added[-1] == TOLERANCE.loop
    assert set(added[: len(added) - more]) == {TOLERANCE.share, TOLERANCE.lateral}


def test_an_effect_may_be_stronger_in_one_part_alone(library):
    effects, t, base = own(library, "stiff")
    loose = with_tolerance(library, effects, t, base, MODULUS)
    change = loose.lift(loose.D[:, len(t.sd) :])  # (T, parts, n)
    acts = np.abs(change).max(axis=0) > 1e-9
    assert np.all(acts.sum(axis=0) <= 1)  # no reading belongs to two parts
    whole = t.lift(t.A) - base.lift(base.A)[[int(np.argmin(np.abs(base.at[:, 0] - x))) for x in t.at[:, 0]]]
    np.testing.assert_allclose(change.sum(axis=1), whole, rtol=0, atol=4e-5 * np.abs(t.lift(t.A)).max())


def test_another_support_may_have_another_size_at_each_place(library):
    effects, t, base = own(library, "clearance")
    loose = with_tolerance(library, effects, t, base, MODULUS)
    places = sorted({item.place for item, c, _ in library.plan.rows() if c == "Fz"})
    assert set(loose.sd[len(t.sd) : -len(places)]) == {TOLERANCE.share, TOLERANCE.lateral}
    assert set(loose.sd[-len(places) :]) == {TOLERANCE.way}
    moved = loose.lift(loose.D[:, -len(places) :])  # (T, places, n)
    step = 1e-3
    further = t.at[:, 1] + (step if effects[0].size.logarithmic else step * t.at[:, 1])
    at = np.column_stack([t.at[:, 0], further, *t.at[:, 2:].T])
    ends = [predict(library, effects, x, MODULUS)[0] for x in (t.at, at)]
    force = np.zeros(library.plan.n, bool)
    for _, c, rows in library.plan.rows():
        force[rows] = c == "Fz"
    expected = ((ends[1] - ends[0]) / step)[:, force]
    # the tiles' own derivative spans a third of a tile, over which that of ln c bends
    np.testing.assert_allclose(moved.sum(axis=1)[:, force], expected, rtol=0, atol=0.1 * np.abs(expected).max())
    for k, place in enumerate(places):
        for item, _, rows in library.plan.rows():
            assert getattr(item, "place", -1) == place or np.abs(moved[:, k, rows]).max() < 1e-9


def test_another_support_is_weaker_in_proportion_and_holds_nothing_where_it_held_nothing(library):
    effects, t, base = own(library, "clearance")
    loose = with_tolerance(library, effects, t, base, MODULUS)
    places = {item.place for item, c, _ in library.plan.rows() if c == "Fz"}
    more = loose.lift(loose.D[:, len(t.sd) : len(loose.sd) - len(places)]).sum(axis=1)
    F, F0 = t.lift(t.A), base.lift(base.A)[[int(np.argmin(np.abs(base.at[:, 0] - x))) for x in t.at[:, 0]]]
    for _, c, rows in library.plan.rows():
        if c == "Fz":
            power = F[:, rows] * np.log(np.maximum(F[:, rows], 1e-300) / F0[:, rows])
            # the tiles' basis is made for forces and their differences: 1 % of the largest of these logarithms
            np.testing.assert_allclose(more[:, rows], power, rtol=0, atol=0.01 * np.abs(power).max())
    F0, F, h = np.array([2.0, 2.0, 2.0, 2.0]), np.array([1.0, 0.0, 3.0, 2.0]), 1e-6
    # one-sided difference of step 1e-6 on values of order 1
    np.testing.assert_allclose(
        model_form_tolerance._in_proportion(F, F - F0), (F * (F / F0) ** h - F) / h, rtol=0, atol=1e-5
    )
