"""The catalogue's sizes, and weights that carry computed changes between nodes."""

import math

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.contract import parameters_of
from rso.data import Chain
from rso.discrepancy import make_test_plan
from rso.discrepancy.library.effects import (
    DECLARED_FORCES_N,
    DECLARED_LOADING_TIMES_S,
    DECLARED_TEST_TIMES_S,
    ONE_PLACE_ERROR_RATIO,
    Effect,
    Size,
    catalogue,
    localised,
    measured_effects,
    suited,
)
from rso.discrepancy.library.interpolation import nodes, piecewise, tensor

ONE = Size("a", "one-sided", "1", 0.02, 0.5, 0.0)
TWO = Size("b", "two-sided", "mm", -0.3, 0.3, 0.0)
RATIO = Size("c", "ratio", "1", 0.2, 5.0, 1.0)
UNEVEN = Size("d", "two sides of different length", "1", 0.8, 12.0, 2.0)
VARIANT = Size("e", "variant", "mm", 0.2, 4.0, None)
SIZES = {"one": ONE, "two": TWO, "ratio": RATIO, "uneven": UNEVEN, "variant": VARIANT}
SHAPE = Size("t", "a time", "s", 0.1, 10.0, None)
ANGLE = Size("w", "an angle", "deg", 0.0, 90.0, None)


def test_ends_of_the_four_kinds():
    assert ONE.ends() == ((0.02, 0.5),)
    assert TWO.ends() == ((-0.3 / 40, -0.3), (0.3 / 40, 0.3))
    (low, high) = RATIO.ends()
    np.testing.assert_allclose([low[1], high[1]], [math.log(0.2), math.log(5.0)], rtol=1e-15)
    np.testing.assert_allclose(VARIANT.ends(), [(math.log(0.2), math.log(4.0))], rtol=1e-15)


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_values_at_the_ends_are_the_plausible_range(size):
    far = [end[1] for end in size.ends()] if size.neutral is not None else list(size.ends()[0])
    found = size.value(np.array(far))
    wanted = [v for v in (size.low, size.high) if len(far) == 2 or v == size.high]
    np.testing.assert_allclose(sorted(found), sorted(wanted), rtol=1e-14)
    if size.neutral is not None:
        assert float(size.value(0.0)) == size.neutral
        for near, end in size.ends():  # from small to large, on one side of neutral
            assert 0 < near / end < 1


def test_every_plausible_knob_of_the_backend_and_of_the_chain_is_in_the_catalogue_once():
    found = toy.effects()
    assert len({e.name for e in found}) == len(found)
    knobs = {s.name for e in found for s in e.knobs if e.family != "scatter"}
    declared = {p.name for p in (*toy.PARAMETERS, *parameters_of(Chain)) if p.plausible}
    assert knobs == declared
    own = {e.name: e for e in found}
    assert [s.name for s in own["g"].knobs] == ["g", "tau"]
    assert own["clearance"].settings == {"support": "loose"} and own["clearance"].size.neutral is None
    assert own["offset_each"].family == "scatter" and own["offset_each"].source == "offset"


def test_errors_of_the_force_channel_grow_with_the_forces():
    """A press with a cell for 100 N is not out by 50 mN at most; one for a newton is as declared."""
    found = toy.effects("stiff", "bias", "drift", "compliance", "gain", "offset")
    usual = {e.name: (e.size.low, e.size.high) for e in suited(found, 1.0)}
    assert usual == {e.name: (e.size.low, e.size.high) for e in found}
    grown = {e.name: np.array([e.size.low, e.size.high]) for e in suited(found, 50.0 * DECLARED_FORCES_N[1])}
    for name, factor in {"stiff": 1, "bias": 50, "drift": 50, "compliance": 0.02, "gain": 1, "offset": 1}.items():
        np.testing.assert_allclose(grown[name], factor * np.array(usual[name]), rtol=1e-12)


def test_errors_of_the_record_are_those_of_a_small_test():
    """Who presses by 0.3 mm and measures 1 mN has no cell that is out by 50 mN, nor a contact that is by 0.4 mm."""
    found = toy.effects(
        "stiff", "bias", "compliance", "gain", "offset", "offset_each", "backlash", "permanent_set", "nonlinearity"
    )
    few = {e.name: np.array([e.size.low, e.size.high]) for e in suited(found, 0.01 * DECLARED_FORCES_N[0], 0.1)}
    usual = {e.name: np.array([e.size.low, e.size.high]) for e in found}
    factors = {
        "stiff": 1,
        "bias": 0.01,
        "compliance": 10,
        "gain": 1,
        "offset": 0.1,
        "offset_each": 0.1,
        "backlash": 0.1,
        "permanent_set": 1,
        "nonlinearity": 100,
    }
    for name, factor in factors.items():
        np.testing.assert_allclose(few[name], factor * usual[name], rtol=1e-12)
    for force in DECLARED_FORCES_N:
        assert [e.size for e in suited(found, force)] == [e.size for e in found]


@pytest.mark.parametrize(
    ("times", "lag", "drift"),
    [
        ((2.4, 48.0), 1, 1),
        ((0.5, 1.0), 1 / 3, 5),
        ((10_800.0, 30_000.0), 540, 1 / 300),
        ((2.0, 500.0), 1, 0.2),
    ],
)
def test_errors_of_clock_and_drift_are_those_of_a_quick_or_a_slow_test(times, lag, drift):
    """Who presses within half a second has no clock that is a second late, nor sees a drift that shows in an hour, and
    what relaxes does so from the time of the quickest loading to that of the longest test."""
    found = toy.effects("stiff", "lag", "lag_filter", "drift", "drift_each", "bias", "offset")
    factors = {"stiff": 1, "lag": lag, "lag_filter": lag, "drift": drift, "drift_each": drift, "bias": 1, "offset": 1}
    for e, s in zip(found, suited(found, 1.0, 1.0, times), strict=True):
        np.testing.assert_allclose((s.size.low, s.size.high), np.multiply((e.size.low, e.size.high), factors[e.name]))
        assert factors[e.name] != 1 or s.size == e.size
    (e,), (s,) = toy.effects("g"), suited(toy.effects("g"), 1.0, 1.0, times)
    quick, long = (
        v / min(max(v, a), b)
        for v, (a, b) in zip(times, (DECLARED_LOADING_TIMES_S, DECLARED_TEST_TIMES_S), strict=True)
    )
    found = s.shape[0].low / e.shape[0].low / quick, s.shape[0].high / e.shape[0].high / long
    assert all(2**-0.5 <= v <= 2**0.5 for v in found)  # a share that is a power of two
    for near in ((1.0001 * times[0], times[1]), (times[0], 0.9999 * times[1])):
        assert suited((e,), 1.0, 1.0, near)[0].shape == s.shape


def test_times_of_a_plan_are_those_of_its_quickest_loading_and_longest_record():
    plan = make_test_plan(toy.laboratory(toy.TRUTH, 0))
    speeds = [t.peak / t.speed for t in plan.tests]
    assert plan.times == (min(speeds), max(t.time[-1] for t in plan.tests))
    assert (
        DECLARED_LOADING_TIMES_S[0] < plan.times[0] < DECLARED_LOADING_TIMES_S[1]
        and DECLARED_TEST_TIMES_S[0] < plan.times[1] < DECLARED_TEST_TIMES_S[1]
    )


def test_crosstalk_into_a_channel_that_nobody_measured_is_no_effect():
    found = toy.effects()
    names = [e.name for e in found]
    assert measured_effects(found, ("Fz", "Fx", "Fy")) == found
    assert [e.name for e in measured_effects(found, ("Fz", "Fy"))] == [n for n in names if n != "cross_x"]
    beside = ("cross_x", "cross_y", "turn", "bias_side")
    assert [e.name for e in measured_effects(found, ("Fz",))] == [n for n in names if n not in beside]


def test_what_a_place_may_have_for_itself_is_a_cause_with_a_form_at_each_of_several_places():
    found = toy.effects("shift", "tilt", "bias")
    places = {"(0, 0)": {"point": [0.0, 0.0]}, "(10, 0)": {"point": [10.0, 0.0]}}
    own = {e.name: e for e in localised(found, places)}
    assert set(own) == {"shift", "tilt", "bias", "shift at (0, 0)", "shift at (10, 0)"}
    e = own["shift at (10, 0)"]
    assert e.source == own["shift at (0, 0)"].source != own["shift"].source == "shift" and e.size.name == "shift"
    assert [e.acts(p) for p in places.values()] == [False, True]
    assert all(own["shift"].acts(p) for p in places.values())
    assert (e.size.low, e.size.high) == (-1.5 * ONE_PLACE_ERROR_RATIO, 1.5 * ONE_PLACE_ERROR_RATIO)
    assert e.measured and own["bias"].measured and not own["shift"].measured
    assert localised(found, {"(0, 0)": places["(0, 0)"]}) == found  # one place: the same as everywhere
    ratio = Effect("k", "", "model", Size("k", "", "1", 0.8, 1.25, 1.0), scope="place")
    (_, one, _) = localised((ratio,), places)
    # around neutral
    np.testing.assert_allclose(
        (one.size.low, one.size.high), (1 - 0.2 * ONE_PLACE_ERROR_RATIO, 1 + 0.25 * ONE_PLACE_ERROR_RATIO), atol=1e-12
    )
    (_, at_first, _) = localised(toy.effects("compliance"), places)
    own = toy.effects("compliance")[0].size
    assert (at_first.size.low, at_first.size.high) == (own.low, own.high)  # no position


def test_a_body_that_lies_loose_has_held_as_its_variant():
    own = {e.name: e for e in toy.effects(support="loose")}
    assert own["held"].settings == {"support": "held"} and own["held"].size.neutral is None


@pytest.mark.parametrize("primary", [True, False])
@pytest.mark.parametrize("shape", [(), (SHAPE,), (SHAPE, ANGLE)], ids=["no shape", "time", "time and angle"])
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_weights_are_cardinal_at_the_nodes_and_nothing_at_neutral(size, shape, primary):
    grid = nodes(Effect("x", "x", "model", size, shape), primary, (0.1, 2.0))
    np.testing.assert_allclose(grid.weights(grid.points), np.eye(len(grid.points)), rtol=0, atol=1e-12)
    if size.neutral is not None:
        at = grid.points.copy()
        at[:, 0] = 0.0
        np.testing.assert_allclose(grid.weights(at), 0.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("law", ["proportional", "saturating"])
@pytest.mark.parametrize("size", [ONE, TWO, RATIO, UNEVEN], ids=["one", "two", "ratio", "uneven"])
def test_weights_are_exact_for_what_is_proportional_and_for_what_saturates(size, law):
    grid = nodes(Effect("x", "x", "model", size), True, (1.0, 1.0))
    if math.isinf(grid.middle) and law == "saturating":
        pytest.skip("small changes alike on both sides are taken in proportion")
    change = (lambda s: s) if law == "proportional" else (lambda s: s / (np.abs(s) + grid.middle))
    s = np.array([v for near, far in size.ends() for v in np.linspace(near, far, 7)])
    np.testing.assert_allclose(grid.weights(s[:, None]) @ change(grid.levels[0]), change(s), rtol=0, atol=1e-12)


def test_a_share_that_relaxes_is_proportional_to_its_size():
    """Two sizes are all that an effect with shapes has: linear viscoelasticity must be exact with them."""
    grid = nodes(Effect("x", "x", "model", ONE, (SHAPE,)), True, (0.1, 2.0))
    level = grid.levels[1][2]
    at = np.array([[s, level] for s in np.linspace(0.02, 0.5, 9)])
    np.testing.assert_allclose(grid.weights(at) @ grid.points[:, 0], at[:, 0], rtol=0, atol=1e-12)


def test_a_tensor_grid_is_exact_for_its_polynomials():
    rng = np.random.default_rng(0)
    levels = (np.array([0.0, 1.0, 2.5]), np.array([-1.0, 2.0]))
    x = np.stack([rng.uniform(0, 2.5, 30), rng.uniform(-1, 2, 30)], 1)
    f = lambda a, b: 1 + a - 2 * a**2 + b * (3 - a)  # noqa: E731
    grid = np.array([f(a, b) for a in levels[0] for b in levels[1]])
    np.testing.assert_allclose(tensor(levels, x) @ grid, f(x[:, 0], x[:, 1]), rtol=0, atol=1e-12)


def test_a_shape_of_many_levels_converges_as_a_natural_spline():
    errors = []
    for n in (9, 17, 33):
        level, at = np.linspace(0, 1, n), np.linspace(0.2, 0.8, 101)
        errors.append(np.abs(piecewise(level, at) @ np.sin(3 * level) - np.sin(3 * at)).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 3.5)  # fourth order away from the ends


def test_shapes_are_held_at_the_ends_of_their_range():
    grid = nodes(Effect("x", "x", "model", ONE, (SHAPE,)), True, (0.1, 2.0))
    low, high = grid.levels[1][[0, -1]]
    np.testing.assert_array_equal(grid.weights(np.array([[0.3, high + 5]])), grid.weights(np.array([[0.3, high]])))
    np.testing.assert_array_equal(grid.weights(np.array([[0.3, low - 5]])), grid.weights(np.array([[0.3, low]])))


def test_a_body_in_another_support_slides_or_sticks_and_does_nothing_between():
    friction = Size("f", "friction of the support", "1", 0.1, 0.4, None)
    grid = nodes(Effect("x", "x", "model", VARIANT, (friction,), {"support": "bowl"}), True, (1.0, 1.0))
    size, levels = grid.levels
    held = np.where(grid.points[:, 1] > 0.26, 1.0, 0.0)
    at = np.array([[size[0], f] for f in np.linspace(0.05, 0.45, 41)])
    np.testing.assert_array_equal(np.unique((grid.weights(at) @ held).round(12)), [0.0, 1.0])
    # as a negative control: a smooth curve through the same levels is anything between
    smooth = piecewise(levels, at[:, 1].clip(0.1, 0.4)) @ (levels > 0.26)
    assert np.any((smooth > 0.3) & (smooth < 0.7))
    assert grid.middling.sum() == len(size) and len(np.unique(grid.points[grid.middling, 1])) == 1


def test_what_the_settings_of_a_support_set_are_effects_by_themselves():
    """In a bowl its clearance and its friction are errors of their own; held, friction is a shape of the bowl."""
    from fem_backend.backend import BACKEND  # the only one with two knobs of a support

    held = {e.name: e for e in catalogue(BACKEND, {}, {}, ("mu", "D1"))}
    assert [s.name for s in held["bowl_clearance"].knobs] == ["bowl_clearance", "bowl_friction"]
    assert "bowl_friction" not in held
    bowl = {"support": {"kind": "bowl", "clearance": 1.5, "friction": 0.3}}
    loose = {e.name: e for e in catalogue(BACKEND, bowl, {}, ("mu", "D1"))}
    assert (loose["bowl_clearance"].size.neutral, loose["bowl_clearance"].shape) == (1.5, ())
    assert (loose["bowl_friction"].size.neutral, loose["bowl_friction"].shape) == (0.3, ())


@pytest.mark.parametrize("axes", [(25.0, 18.0, 15.0), (20.0, 20.0, 10.0), (30.0, 30.0, 30.0)])
def test_an_inclusion_of_the_catalogue_lies_in_the_specimen(axes):
    """Depths to 30 mm were computed in a body of 30 mm from top to bottom: a third of its nodes failed."""
    from fem_backend.backend import BACKEND
    from fem_backend.geometry import EllipsoidShape
    from fem_backend.materials import zones

    settings = {"specimen": {"shape": "ellipsoid", "semi_axes": list(axes)}, "indenter": {"radius": 2.0}}
    (e,) = (e for e in catalogue(BACKEND, settings, {}, ("mu", "D1")) if e.name == "inclusion_ratio")
    radius = 5.0 * np.cbrt(np.prod(axes) / (60.0 * 35.0 * 35.0))  # in proportion to the body
    x, deep = e.shape
    assert (x.name, deep.name) == ("inclusion_x", "inclusion_depth") and deep.low < deep.high and x.low < 0.0 < x.high
    centres = np.array([[a, 0.0, axes[2] - d] for a in (x.low, 0.0, x.high) for d in np.linspace(deep.low, deep.high)])
    assert zones.depth(EllipsoidShape(*axes), centres).min() > radius


def test_an_inclusion_is_plausible_as_usual_where_it_fits_and_not_at_all_where_it_cannot():
    from fem_backend.backend import BACKEND

    usual = {p.name: p.plausible for p in BACKEND.parameters}
    own = {e.name: e for e in catalogue(BACKEND, {}, {}, ("mu", "D1"))}
    shapes = own["inclusion_ratio"].shape
    assert [(s.low, s.high) for s in shapes] == [usual[s.name] for s in shapes]
    flat = {"specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 60.0, 4.0]}, "indenter": {"radius": 1.0}}
    assert set(own) - {e.name for e in catalogue(BACKEND, flat, {}, ("mu", "D1"))} == {"inclusion_ratio"}


def test_lengths_are_plausible_in_proportion_to_body_and_ball():
    """A semi-axis of 9 mm is not 3 mm wrong, nor a body of that size pressed 10 mm beside its top."""
    from fem_backend.backend import BACKEND

    def ranges(k: float) -> dict[str, tuple[float, float]]:
        body = {"shape": "ellipsoid", "semi_axes": [60.0 * k, 35.0 * k, 35.0 * k]}
        settings = {"specimen": body, "indenter": {"radius": 3.0 * k}}
        found = catalogue(BACKEND, settings, {}, ("mu", "D1"))
        return {s.name: (s.low, s.high) for e in found for s in e.knobs if s.unit == "mm" and e.family == "model"}

    usual, declared = ranges(1.0), {p.name: p.plausible for p in BACKEND.parameters}
    names = {n for n in usual if n != "inclusion_depth"}
    assert names == {
        "delta_a",
        "delta_b",
        "delta_c",
        "delta_R",
        "skin_thickness",
        "offset_x",
        "offset_y",
        "bowl_clearance",
        "inclusion_x",
    }
    assert {n: usual[n] for n in names} == {n: declared[n] for n in names}
    for n in names:
        np.testing.assert_allclose(ranges(0.25)[n], 0.25 * np.array(usual[n]), rtol=1e-12)


LAWS = ("neo_hookean", "linear_elastic", "mooney_rivlin", "yeoh", "ogden")


@pytest.mark.parametrize(
    ("law", "opened"),
    [*((law, ()) for law in LAWS), ("neo_hookean", ("C20",)), ("neo_hookean", ("C01",)), ("neo_hookean", ("alpha",))],
)
def test_no_effect_of_the_catalogue_is_refused_beside_the_law_of_the_study(law, opened):
    """Another law was a hypothesis all the same: its runs failed, and a diagnosis ended as one with failed runs."""
    from fem_backend.backend import BACKEND
    from fem_backend.simulation import assembly
    from fem_backend.simulation.experiment import read_settings

    settings, mu = {"material": {"law": law}}, 0.01
    base = {"mu": mu, "D1": 10.0} | {k: 3.0 if k == "alpha" else 0.1 * mu for k in opened}
    found = [e for e in catalogue(BACKEND, settings, {}, ("mu", "D1", *opened)) if e.family == "model"]
    for e in found:
        far = {s.name: float(s.value(s.ends()[-1][1])) * mu**s.exponent for s in e.knobs}
        read = read_settings({**settings, **e.settings})
        assembly.material(read, BACKEND.knobs({**base, **far}, read))
    names = {e.name for e in found}
    assert {"friction", "delta_R", "skin_ratio"} <= names
    assert ({"C20", "alpha"} <= names) == (law == "neo_hookean" and not opened)


@pytest.mark.parametrize(("modulus", "seen"), [(0.01, True), (0.1, True), (3.0, False)])
def test_a_weight_is_that_of_a_body_and_no_multiple_of_its_modulus(modulus, seen):
    from fem_backend.backend import BACKEND
    from rso.discrepancy import bounded, catalogue

    settings = {
        "specimen": {"shape": "ellipsoid", "semi_axes": [30.0, 30.0, 30.0]},
        "indenter": {"shape": "sphere", "radius": 3.0},
        "support": {"kind": "fixed"},
        "point": [0.0, 0.0],
    }
    every = catalogue(BACKEND, settings, {}, ["mu", "D1"])
    kept, told = bounded(every, modulus, BACKEND.physical(), {})
    weights = [e for e in kept if e.size.name == "weight"]
    assert len(weights) == seen and bool(told) is not seen
    assert all(e.size.high * modulus <= 8.0 * 9.81e-6 * 1.001 for e in weights)
    assert [e for e in every if e.size.name != "weight"] == [e for e in kept if e.size.name != "weight"]
    assert seen or "weight is at most" in told[0]
