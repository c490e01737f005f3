"""Units at the door: exact conversion, and a refusal that says what was expected."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.core import units
from rso.core.symbols import unit_text
from rso.core.units import (
    BARE_COLUMNS,
    COLUMN_UNITS,
    UNIT_LADDERS,
    column_factor,
    header,
    people,
    unit_in,
    value_in_unit,
)


@pytest.mark.parametrize(
    ("written", "unit", "value"),
    [
        ("3.2 kPa", "MPa", 0.0032),
        ("3356 Pa", "MPa", 0.003356),
        ("1 N/mm^2", "MPa", 1.0),
        ("1 N/mm²", "MPa", 1.0),
        ("1 %", "1", 0.01),
        ("1 1/MPa", "1/MPa", 1.0),
        ("0.0058 1/kPa", "1/MPa", 5.8),
        ("30 mm/min", "mm/s", 0.5),
        ("20 um", "mm", 0.02),
        ("20 µm", "mm", 0.02),
        ("-1.5e-3 m", "mm", -1.5),
        ("2mN", "N", 0.002),
        ("0.2 um/mN", "mm/N", 0.2),
        (5, "MPa", 5.0),
        (np.float64(0.25), "mm", 0.25),
    ],
)
def test_quantities_convert_exactly(written, unit, value):
    # Equality to the bit: "3.2 kPa" and the bare 0.0032 must give the same run key.
    assert value_in_unit(written, unit) == value
    assert type(value_in_unit(written, unit)) is float


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        ("3.2", "MPa"),
        ("kPa", "MPa"),
        ("3.2 mm", "MPa"),
        ("3.2 kPaa", "MPa"),
        ("3,2 kPa", "MPa"),
        ("nan MPa", "MPa"),
        ("inf MPa", "MPa"),
        ("1e400 MPa", "MPa"),
        ("1e999 MPa", "MPa"),
        ("1_0 MPa", "MPa"),
        ("5 deg", "1"),
        ("20 °C", "K"),
        ("", "mm"),
        ("9 mm**9**9**9", "mm"),
        ("9 9**9**9**9 mm", "mm"),
        ("1 __import__", "mm"),
        ("1 %%", "1"),
        ("1" * 100 + " mm", "mm"),
        (True, "MPa"),
        (None, "MPa"),
        ([1.0], "MPa"),
        (float("nan"), "MPa"),
        (float("inf"), "MPa"),
        (10**400, "MPa"),
    ],
)
def test_refusals_name_value_unit_and_an_example(written, unit):
    with pytest.raises(ValueError) as caught:
        value_in_unit(written, unit)
    text = str(caught.value)
    assert str(written)[:20] in text
    assert "for example" in text
    assert ("pure number" if unit == "1" else f"in {unit}") in text


def test_every_column_in_its_base_unit_has_factor_one():
    for name, unit in COLUMN_UNITS.items():
        assert header(f"{name}_{unit}") == (name, unit)
        assert column_factor(name, unit) == 1.0
        assert header(f"{name}_sigma_{unit}") == (f"{name}_sigma", unit)
    for name in BARE_COLUMNS:
        assert header(name) == (name, "")


@pytest.mark.parametrize(
    ("text", "name", "factor"),
    [("Fz_mN", "Fz", 1e-3), ("depth_um", "depth", 1e-3), ("time_ms", "time", 1e-3), ("time_min", "time", 60.0)],
)
def test_columns_in_other_units(text, name, factor):
    assert header(text)[0] == name
    assert column_factor(*header(text)) == factor


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("depth [mm]", "depth", "mm"),
        ("Depth (um)", "depth", "um"),
        (" FZ/kN ", "Fz", "kN"),
        ("fz_sigma [mN]", "Fz_sigma", "mN"),
        ("X [ mm ]", "x", "mm"),
        ("Repeat", "repeat", ""),
    ],
)
def test_headers_with_the_unit_in_brackets_or_after_a_slash(text, name, unit):
    assert header(text) == (name, unit)


@pytest.mark.parametrize("text", ["Weg [mm]x", "repeat (s)", "depth [N]", "depth [mm] (s)", "depth (1)", "depth []"])
def test_other_headers_are_no_such(text):
    with pytest.raises(ValueError, match="understood are depth_mm") as caught:
        header(text)
    assert str(caught.value).startswith(("unknown column ", "column ")[text in ("depth [N]", "depth (1)", "depth []")])


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("Weg [mm]", "mm"),
        ("Load (filtered) (kN)", "kN"),
        ("a/b / N", "N"),
        ("Kraft_mN", "mN"),
        ("Load (s)", "s"),
        ("Kraft [kN] (gefiltert)", "kN"),
        ("Kraft [kN] gefiltert", "kN"),
        ("Kraft / kN (gefiltert)", "kN"),
        ("Kraft_kN (gefiltert)", "kN"),
        ("Force (g) (filtered)", "g"),
        ("Kraft [KN]", "KN"),
        ("Load (A) (filtered)", None),
        ("F(t) (filtered)", None),
        ("Load_g", None),
        ("Load (Cell 1)", None),
        ("Load (1)", None),
        ("Load/Unload", None),
        ("Load_A", None),
        ("Load_1", None),
        ("Load", None),
    ],
)
def test_the_unit_that_any_header_says(text, unit):
    assert unit_in(text, "Fz") == unit


@pytest.mark.parametrize("text", ["Fz", "force_N", "depth_N", "depth_", "", "Fz_kNN", "repeat_1", "_mm", "fz_N"])
def test_unknown_columns_are_answered_with_the_list(text):
    with pytest.raises(ValueError, match="understood are depth_mm") as caught:
        header(text)
    assert repr(text) in str(caught.value)


def test_units_without_pint_are_those_of_pint():
    for unit, (scale, kind) in units._PLAIN_UNITS.items():
        assert units._by_pint(unit) == (scale, kind), unit


@pytest.mark.parametrize("unit", sorted({p.unit for p in BACKEND.parameters} | set(UNIT_LADDERS)))
def test_a_value_copied_from_a_report_is_read_back(unit):
    """Reports print MPa⁻¹ and mm⁴/N/s, in the unit that people use for the size."""
    for size in (1e-9, 1e-3, 1.0, 200.0):
        label, factor = people(unit, size)
        number, said = f"{size * factor:.6g}", unit_text(label)
        assert value_in_unit(f"{number} {said}" if said else float(number), unit) == pytest.approx(size, rel=1e-5)


@pytest.mark.parametrize("written", ["3 m⁴/(N·s)", "3 m^4/(N s)", "3 m^4/(N*s)", "3 m⁴ N⁻¹ s⁻¹", "3 m^4/N/s"])
def test_a_divisor_may_stand_in_brackets(written):
    assert value_in_unit(written, "m^4/N/s") == 3.0


@pytest.mark.parametrize("written", ["3 m/(s", "3 ⁻¹", "3 9⁹⁹⁹", "3 m⁻", "3 m/(s/N)"])
def test_what_is_no_unit_stays_refused(written):
    with pytest.raises(ValueError, match="is not a"):
        value_in_unit(written, "m/s")


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [("Load cell 50 kN", "Fz", None), ("Force 2 g", "Fz", None), ("Time a", "time", None), ("Kraft PN", "Fz", None),
     ("Force mN", "Fz", "mN"), ("Travel - mm", "depth", "mm"), ("Force gf", "Fz", "gf")],
)  # fmt: skip
def test_behind_a_blank_only_customary_units_and_no_capacity_count(header, name, unit):
    assert unit_in(header, name) == unit
