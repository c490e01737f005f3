"""Numbers read off responses: scalars, values at abscissae, maxima, integrals of curves of any sign."""

import numpy as np
import pytest

from rso.contract import FreeCurve, NotFinite, Response
from rso.core.quantities import Unread, limit_in_unit, read_limits, read_quantity

X = np.linspace(-2.0, 3.0, 501)
CURVE = FreeCurve(X, X**3 - 4.0, "MPa", "stretch", "1")
RUN = Response({"time": [0.0], "travel": [0.0], "cost": [-7.5]}, {"time": "s", "travel": "mm", "cost": "1"},
               curves={"stress": CURVE})  # fmt: skip
OUTPUTS = {"cost": ("1", None, ""), "stress": ("MPa", "stretch", "1"), "loss": ("MPa", "frequency", "1/s")}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("cost", -7.5),
        ("stress(1.0)", -3.0),
        ("stress(-1.5)", -7.375),
        ("max(stress)", 23.0),
        ("min( stress )", -12.0),
        ("max_abs(stress, -2, 1)", 12.0),
        ("integral(stress)", (3.0**4 - 2.0**4) / 4.0 - 20.0),
        ("integral(stress, 0, 2)", 4.0 - 8.0),
        ("mean(stress, 0, 2)", -2.0),
        ("argmax(stress)", 3.0),
        ("first(stress)", -12.0),
        ("last(stress, -1, 1)", -3.0),
    ],
)
def test_a_quantity_is_what_calculus_says(text, value):
    assert read_quantity(text).read(RUN) == pytest.approx(value, rel=1e-4, abs=1e-4)


def test_a_channel_over_travel_is_a_curve_too():
    travel = np.linspace(0.1, 2.0, 20)
    run = Response({"time": travel, "travel": travel, "Fz": 3.0 * travel}, {"time": "s", "travel": "mm", "Fz": "N"})
    assert read_quantity("Fz(0.55 mm)").read(run) == pytest.approx(1.65)


def test_what_a_curve_does_not_reach_is_no_number():
    for text in ("stress(3.5)", "integral(stress, -3, 0)"):
        with pytest.raises(Unread, match="from -2 to 3"):
            read_quantity(text).read(RUN)


@pytest.mark.parametrize(
    ("text", "unit"),
    [("cost", "1"), ("max(stress)", "MPa"), ("integral(stress)", "MPa"), ("integral(loss)", "MPa*1/s"),
     ("argmax(loss)", "1/s"), ("loss(3)", "MPa")],
)  # fmt: skip
def test_units(text, unit):
    assert read_quantity(text).unit(OUTPUTS) == unit


@pytest.mark.parametrize(
    ("text", "words"),
    [("stress", "is a curve over stretch"), ("max(cost)", "one number, no curve"), ("loss(3 mm)", "3 mm")],
)
def test_a_reading_that_the_output_does_not_have_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        read_quantity(text).unit(OUTPUTS)


@pytest.mark.parametrize("text", ["", "1 + cost", "max(stress, 1)", "stress()", "stress(a)", "max(stress, 2, 1)",
                                  "__import__('os')", "f(g(x))", "x" * 300])  # fmt: skip
def test_what_is_no_quantity_is_refused(text):
    with pytest.raises(ValueError):
        read_quantity(text)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("cost <= 250", None, 250.0),
        ("250 >= cost", None, 250.0),
        ("cost > -3e2", -300.0, None),
        ("0.1 <= stress(1.2) <= 0.3", 0.1, 0.3),
        ("0.3 >= max(stress, 0, 1) >= 0.1", 0.1, 0.3),
        ("max(stress) <= 250 kPa", None, "250 kPa"),
    ],
)
def test_limits(text, low, high):
    found = read_limits(text)
    assert (found.low, found.high) == (low, high)


@pytest.mark.parametrize(
    "text", ["cost", "cost == 3", "1 <= 2", "a <= b", "1 <= cost >= 0", "3 <= cost <= 1", "cost <= "]
)
def test_what_is_no_limit_is_refused(text):
    with pytest.raises(ValueError):
        read_limits(text)


def test_ends_of_limits_have_the_unit_of_the_quantity():
    assert limit_in_unit("250 kPa", "MPa", 0.0) == 0.25
    assert limit_in_unit("3.5 EUR", "EUR", 0.0) == 3.5  # a unit that no table has
    assert limit_in_unit(None, "MPa", np.inf) == np.inf
    with pytest.raises(ValueError):
        limit_in_unit("250 mm", "MPa", 0.0)


def test_a_response_keeps_its_curves_through_json():
    again = Response.from_json(RUN.to_json())
    assert np.array_equal(again.curves["stress"].value, CURVE.value) and again.curves["stress"].over == "stretch"
    assert "curves" not in Response({"time": [0.0], "travel": [0.0]}, {"time": "s", "travel": "mm"}).to_json()


def test_a_curve_that_is_none_is_refused():
    with pytest.raises(ValueError, match="must increase"):
        FreeCurve([0.0, 0.0], [1.0, 2.0])
    with pytest.raises(NotFinite):
        FreeCurve([0.0, 1.0], [1.0, np.nan])
    with pytest.raises(ValueError, match="both need"):
        FreeCurve([0.0, 1.0], [1.0])
