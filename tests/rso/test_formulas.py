"""Closed forms of the literature beside simulations: what the backend offers, and what the report says of them."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme
from rso.report.calibration.closed_forms import closed_form_sections
from rso.report.calibration.figures import draw
from rso.report.layout.document import Table, Text

DEPTH = (0.01, 0.05, 0.4)
BALL = {"shape": "sphere", "radius": 1.0}
BONDED = {"kind": "bonded"}
VALUES = {"mu": 0.01, "D1": 0.02}  # ν = 0.49995


def formulas(specimen, **more):
    settings = {"specimen": specimen, "indenter": BALL, "support": BONDED, **more}
    return {f.name: f for f in BACKEND.formulas(VALUES, Case("c", Programme.ramp(DEPTH, 0.5), settings))}


def hertz(R):
    """F = 16/3 μ √R d^1.5, incompressible, by hand."""
    return 16.0 / 3.0 * 0.01 * R**0.5 * np.array(DEPTH) ** 1.5


def test_a_half_space_has_hertz_as_far_as_strains_are_small():
    found = formulas({"shape": "half_space"})["Hertz"]
    np.testing.assert_allclose(found.force, hertz(1.0), rtol=3e-4)  # ν is not quite 1/2
    assert found.invalid[0] == found.invalid[1] == "" and "strains are not small" in found.invalid[2]


def test_on_a_thin_slab_hertz_does_not_hold_and_the_base_adds():
    found = formulas({"shape": "slab", "thickness": 2.0})
    assert "thin" in found["Hertz"].invalid[1]
    exact = list(found.values())[-1]
    assert exact.invalid[1] == "" and np.all(exact.force > found["Hertz"].force)
    thick = formulas({"shape": "slab", "thickness": 200.0})
    np.testing.assert_allclose(
        list(thick.values())[-1].force[:2], hertz(1.0)[:2], rtol=0.02
    )  # the ball is no paraboloid


def test_an_ellipsoid_is_met_as_its_curvature_says():
    ellipsoid = {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}
    found = formulas(ellipsoid, support={"kind": "fixed"})["Hertz"]
    np.testing.assert_allclose(found.force, hertz(1 / (1 + 0.5 * (35 / 60**2 + 1 / 35))), rtol=3e-4)


@pytest.mark.parametrize(
    ("specimen", "why"),
    [
        ({"shape": "slab", "thickness": 5.0, "layers": [{"thickness": 0.3, "ratio": 5.0}]}, "has layers"),
        ({"shape": "cylinder", "radius": 2.5, "height": 5.0}, "times as wide as it is high"),
    ],
)
def test_what_no_formula_knows_is_said_of_each(specimen, why):
    assert all(why in text for f in formulas(specimen).values() for text in f.invalid)


def test_a_material_that_relaxes_has_no_formula():
    found = formulas({"shape": "slab", "thickness": 5.0}, material={"prony": [[0.3, 2.0]]})
    assert all("relaxes" in text for f in found.values() for text in f.invalid)
    assert not any("relaxes" in text for f in formulas({"shape": "half_space"}).values() for text in f.invalid)


def row(simulated):
    """Results with three formulas: one far off, one near, one that is near at first."""
    depth = [0.1, 0.2, 0.3, 0.4]
    forms = {"Far": [0.5, 0.5, 0.5, 0.5], "Near": [1.01, 1.02, 1.01, 0.99], "Early": [1.01, 1.04, 1.3, None]}
    return {
        "experiment": "top",
        "depth": depth,
        "simulated": simulated,
        "error": [0.01 * v for v in simulated],
        "formulas": [
            {
                "name": name,
                "source": "somebody 1900",
                "force": [None if k is None else k * v for k, v in zip(share, simulated, strict=True)],
                "invalid": ["", "too deep", "too deep", "too deep"] if name == "Early" else [""] * 4,
                "modulus": 2.0 if name == "Far" else 1.0,
            }
            for name, share in forms.items()
        ],
    }


def section(*keep):
    one = row([0.1, 0.3, 0.6, 1.0])
    one["formulas"] = [f for f in one["formulas"] if f["name"] in keep]
    results = {"formulas": [one]}
    (found,) = closed_form_sections(results)
    assert draw(results, "formulas-0").startswith("<svg")
    return " ".join(b.text for b in found.blocks if isinstance(b, Text)), next(
        b for b in found.blocks if isinstance(b, Table)
    )


def test_the_report_says_which_formula_is_enough():
    text, table = section("Far", "Near", "Early")
    assert "Far is 50.0\N{NO-BREAK SPACE}% below the simulated force" in text and "2.00\N{NO-BREAK SPACE}times" in text
    assert "Near is enough for these data" in text
    assert [r[0].text for r in table.rows] == ["Far", "Near", "Early"]
    assert table.rows[2][3].text == "–" and "then too deep" in table.rows[2][5].text


def test_the_report_says_how_far_a_formula_leads_where_none_is_enough():
    text, _ = section("Far", "Early")
    assert "Early is to 0.20\N{NO-BREAK SPACE}mm" in text
    text, _ = section("Far")
    assert "No formula is within 5" in text


def test_without_formulas_there_is_no_section():
    assert closed_form_sections({}) == closed_form_sections({"formulas": []}) == ()


@pytest.mark.parametrize(
    ("more", "values", "why"),
    [
        ({"support": {"kind": "plate", "friction": 0.6}}, {}, "rubs"),
        ({"support": {"kind": "plate"}}, {"substrate_compliance": 1.0}, "yields"),
        ({}, {"permeability": 0.1, "pore_D1": 0.1}, "pores"),
        ({}, {"adhesion": 1e-5, "adhesion_range": 0.01}, "attract"),
        ({"support": {"kind": "plate"}}, {}, ""),
    ],
)
def test_what_no_formula_knows_is_said(more, values, why):
    settings = {"specimen": {"shape": "slab", "thickness": 5.0}, "indenter": {"shape": "sphere", "radius": 3.0}, **more}
    found = BACKEND.formulas({**VALUES, **values}, Case("c", Programme.ramp((0.01,), 0.5), settings))
    (hayes,) = (f for f in found if f.name.startswith("Hayes"))
    assert why in hayes.invalid[0] and bool(hayes.invalid[0]) is bool(why)
