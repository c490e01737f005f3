"""The ladder that the backend offers, its closed form and its start."""

import numpy as np
import pytest

from fem_backend import closed_forms
from fem_backend.adapter.model_hierarchy import HELD_D1_MU, SIMPLE_MODEL_POISSON
from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

SETTINGS = {"specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "indenter": {"radius": 3.0}}
ASKED = (0.5, 1.0, 2.0, 4.0)


def case(**more):
    return Case("x", Programme.ramp(ASKED), {**SETTINGS, **more})


def test_the_modulus_by_hertz_is_that_of_the_source():
    """EM I: 0.4218 N at 3.8 mm with R = 3 and nu = 0.49 gives E = 0.0187 MPa."""
    assert closed_forms.hertz_modulus(0.4218, 3.8, 3.0, 0.49) == pytest.approx(0.0187, abs=5e-5)


def test_mean_curvature_of_an_ellipsoid():
    """A sphere's is 1/R everywhere; at the ends of the axes it is the mean of the ellipses' (p/q² and p/r²)."""
    at = 7.0 * np.array([0.6, 0.0, 0.8])
    assert closed_forms.ellipsoid_mean_curvature(np.full(3, 7.0), at) == pytest.approx(1 / 7)
    a, b, c = s = np.array([60.0, 35.0, 20.0])
    assert closed_forms.ellipsoid_mean_curvature(s, [0, 0, c]) == pytest.approx((c / a**2 + c / b**2) / 2)
    assert closed_forms.ellipsoid_mean_curvature(s, [a, 0, 0]) == pytest.approx((a / b**2 + a / c**2) / 2)


def test_closed_form_at_the_top():
    """R = 2.84 mm effective, E and nu from mu and D1; no lateral force, no numerical error."""
    mu, D1 = 0.01, 4.0
    found = BACKEND.closed_form({"mu": mu, "D1": D1}, case())
    K = 2 / D1
    E, nu = 9 * K * mu / (3 * K + mu), (3 * K - 2 * mu) / (6 * K + 2 * mu)
    R = 1 / (1 / 3 + 0.5 * (35 / 60**2 + 35 / 35**2))
    np.testing.assert_allclose(
        found.channels["Fz"], 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * np.array(ASKED) ** 1.5, rtol=1e-12
    )  # rounding
    assert not found.channels["Fx"].any() and not found.error and pytest.approx(2.84, abs=0.01) == R


def test_off_the_top_a_vertical_push_is_weaker_and_leans_up_the_slope():
    top, off, normal = (
        BACKEND.closed_form({"mu": 0.01, "D1": 4.0}, case(**s)).channels
        for s in ({}, {"point": [0.0, 12.0]}, {"point": [0.0, 12.0], "direction": "normal"})
    )
    assert np.all(off["Fz"] < top["Fz"]) and np.all(off["Fy"] > 0)
    n = np.array([12 / 35**2, np.sqrt(35**2 - 12**2) / 35**2])
    np.testing.assert_allclose(off["Fy"] / off["Fz"], n[0] / n[1], rtol=1e-12)
    assert np.all(normal["Fz"] > off["Fz"])


@pytest.mark.parametrize(
    ("knobs", "settings"),
    [
        ({"delta_R": 0.6}, {"indenter": {"radius": 3.6}}),
        ({"delta_a": 5.0, "delta_b": -3.0, "delta_c": 2.0}, {"specimen": {"semi_axes": [65.0, 32.0, 37.0]}}),
        ({"offset_x": 8.0, "offset_y": 3.0}, {"point": [10.0, 3.0]}),
    ],
)
def test_closed_form_at_a_ball_a_body_or_a_place_that_is_not_as_stated(knobs, settings):
    stated = case(point=[2.0, 0.0])
    true = Case("x", stated.programme, {**stated.settings, **settings})
    values = {"mu": 0.01, "D1": 4.0}
    found, expected, without = (
        BACKEND.closed_form(v, c).channels for v, c in (({**values, **knobs}, stated), (values, true), (values, stated))
    )
    for channel in ("Fx", "Fy", "Fz"):
        np.testing.assert_allclose(found[channel], expected[channel], rtol=1e-12)
    assert not np.allclose(found["Fz"], without["Fz"], rtol=1e-3)


def test_closed_form_of_no_ball_is_refused():
    with pytest.raises(ValueError, match=r"delta_R = -4 mm.*of -1 mm"):
        BACKEND.closed_form({"mu": 0.01, "D1": 4.0, "delta_R": -4.0}, case())


def test_closed_form_agrees_with_finite_elements_at_small_depth():
    """At 0.3 mm the neo-Hookean body is Hertz's but for the held half (+3 %), the mesh (2 %) and a/R = 0.3."""
    small = Case("x", Programme.ramp((0.3,)), {**SETTINGS, "mesh": {"level": "coarse"}})
    values = {"mu": 0.01, "D1": 4.0}
    closed, computed = BACKEND.closed_form(values, small), BACKEND(values, small)
    assert computed.channels["Fz"][-1] / closed.channels["Fz"][-1] == pytest.approx(1.0, abs=0.08)


def test_the_start_finds_what_the_closed_form_was_made_with():
    mu = 0.008
    F = BACKEND.closed_form({"mu": mu, "D1": HELD_D1_MU / mu}, case()).channels["Fz"]
    found = BACKEND.start(case(), np.array(ASKED), F)
    low, value, high = found["mu"]
    assert value == pytest.approx(mu, rel=1e-12) and low == pytest.approx(mu / 1.5) and high == pytest.approx(1.5 * mu)
    D1 = found["D1"]
    assert D1[0] < D1[1] < D1[2]
    assert closed_forms.poisson_ratio(mu, 2 / D1[1]) == pytest.approx(SIMPLE_MODEL_POISSON)


def test_the_start_of_the_source():
    """EM I: E = 0.0187 MPa of a half-space, so mu = 0.0067 MPa and D1 = 6; here the body curves away under the ball."""
    h = np.linspace(0.1, 3.8, 38)
    F = 4 / 3 * 0.0187 / (1 - 0.49**2) * np.sqrt(3.0) * h**1.5
    found = BACKEND.start(case(), h, F)
    assert found["mu"][1] == pytest.approx(0.0187 / 2.98 * np.sqrt(3 / 2.84), rel=2e-3)
    assert found["D1"][1] == pytest.approx(6.3, abs=0.3)
    with pytest.raises(ValueError, match="pushes"):
        BACKEND.start(case(), h, -F)


def test_every_level_is_modelled_and_names_what_there_is():
    rungs = BACKEND.levels({**SETTINGS, "material": {"law": "neo_hookean", "prony": [[0.1, 2.0]]}})
    assert [[v["name"] for v in rung] for rung in rungs] == [
        ["hertz"],
        ["linear_elastic"],
        ["neo_hooke"],
        ["mooney_rivlin", "yeoh", "ogden"],
    ]
    known = {p.name: p for p in BACKEND.parameters}
    for level in (v for rung in rungs for v in rung):
        BACKEND.check(case(**level.get("settings", {})))
        if "settings" in level:
            assert level["settings"]["material"]["prony"] == [[0.1, 2.0]]
        for k, (low, high) in level.get("open", {}).items():
            assert low <= known[k].neutral < high
        assert level.get("extends", "neo_hooke") == "neo_hooke"


@pytest.mark.parametrize(
    "settings", [{}, {"point": [20.0, 0.0]}, {"point": [35.0, 5.0]}, {"point": [35.0, 5.0], "direction": "normal"}]
)
def test_hertz_gives_back_the_modulus_of_its_own_force_on_a_slope_too(settings):
    """Taken as normal to the surface a vertical force on a slope told too small a modulus."""
    case = Case("c", Programme.ramp((0.1, 0.2, 0.4)), settings)
    F = BACKEND.closed_form({"mu": 0.0123, "D1": 1e-6}, case).channels["Fz"]  # incompressible, nearly
    np.testing.assert_allclose(BACKEND.hertz(settings, np.array([0.1, 0.2, 0.4]), F)["mu"], 0.0123, rtol=1e-6)
