import numpy as np
import pytest

from rso.benchmarks import indentation
from rso.contract import Parameter
from rso.core.similarity import group, stress_exponent

MU = Parameter("mu", "shear modulus", "MPa", 1e-4, 1.0)
D1 = Parameter("D1", "compressibility", "1/MPa", 0.0, 1000.0)
TAU = Parameter("tau", "relaxation time", "s", 0.01, 100.0)
SPRING = Parameter("spring", "elastic foundation", "N/mm", 0.0, 10.0)


@pytest.mark.parametrize(
    "unit,exponent",
    [
        ("MPa", 1),
        ("kPa", 1),
        ("1/MPa", -1),
        ("MPa^-1", -1),
        ("MPa**2", 2),
        ("mm", 0),
        ("1", 0),
        ("", 0),
        ("-", 0),
        ("%", 0),
        ("s", 0),
        ("1/s", 0),
        ("N", 1),
        ("N/mm", 1),
        ("N/mm^2", 1),
        ("N mm", 1),
        ("MPa*s", 1),
        ("MPa·s", 1),
        ("mm/N", -1),
        ("1/(MPa s)", -1),
        ("mm^3/(N*s)", -1),
        ("MPa/MPa", 0),
        ("mm/s", 0),
        ("N^(2)/mm", 2),
        ("t/mm^3", 1),
        ("(MPa^2)^0.5", 1),
    ],
)
def test_stress_exponent(unit, exponent):
    assert stress_exponent(unit) == exponent


@pytest.mark.parametrize("unit", ["psi", "MPa^0.5", "N/", "(MPa", "MPa)", "MPa^", "N**mm", "?"])
def test_units_that_are_no_units_are_refused(unit):
    with pytest.raises(ValueError, match="unit"):
        stress_exponent(unit)


DEPTHS = np.array([0.5, 1.0, 2.0])


def solve(values):
    return indentation(DEPTHS, values["mu"], values["D1"], thickness=20.0)


@pytest.mark.parametrize("d1", [0.0, 1e-6, 5.8, 160.0])
def test_similarity_is_exact_down_to_incompressible(d1):
    g = group((MU, D1, TAU), {"Fz": "N", "travel": "mm", "p": "kPa"})
    assert g.reference == "mu" and g.saved == 1
    rng = np.random.default_rng(0)
    for mu in 10 ** rng.uniform(-4, 0, 20):
        values = {"mu": mu, "D1": d1, "tau": 3.0}
        scale, reduced = g.reduce(values)
        assert reduced["mu"] == g.reference_value and reduced["tau"] == 3.0
        # Products and quotients of a handful of numbers.
        np.testing.assert_allclose(g.expand("Fz", solve(reduced), scale), solve(values), rtol=1e-12)
        np.testing.assert_allclose(reduced["mu"] * reduced["D1"], mu * d1, rtol=1e-12)
        assert g.expand("travel", 2.0, scale) == 2.0


def test_a_fixed_dimensional_constant_breaks_it_and_declaring_it_switches_it_off():
    def with_spring(values, k=0.05):
        return solve(values) + k * DEPTHS

    values = {"mu": 0.01, "D1": 20.0}
    wrong = group((MU, D1), {"Fz": "N"}, reference_value=0.02)
    scale, reduced = wrong.reduce(values)
    assert np.abs(wrong.expand("Fz", with_spring(reduced), scale) / with_spring(values) - 1).max() > 0.01
    honest = group((MU, D1), {"Fz": "N"}, constants={"spring": "N/mm", "radius": "mm"})
    assert honest.saved == 0 and "spring" in honest.why and "radius" not in honest.why
    scale, reduced = honest.reduce(values)
    assert scale == 1 and reduced == values
    assert np.array_equal(honest.expand("Fz", with_spring(reduced), scale), with_spring(values))
    listed = group((MU, D1, SPRING), {"Fz": "N"})
    scale, reduced = listed.reduce({**values, "spring": 0.05})
    np.testing.assert_allclose(
        listed.expand("Fz", with_spring(reduced, reduced["spring"]), scale), with_spring(values), rtol=1e-12
    )  # rounding


def test_reduced_ranges_cover_every_reduced_point():
    g = group((MU, D1, TAU), {"Fz": "N"}, reference_value=0.01)
    low, high = {"mu": 0.006, "D1": 1.0, "tau": 0.1}, {"mu": 0.015, "D1": 160.0, "tau": 10.0}
    ranges = g.reduced_range(low, high)
    assert set(ranges) == {"D1", "tau"} and ranges["tau"] == (0.1, 10.0)
    np.testing.assert_allclose(ranges["D1"], (0.6, 240.0), rtol=1e-12)  # D1·mu/0.01 at two opposite corners


def test_nothing_to_scale_out():
    g = group((TAU,), {"Fz": "N"})
    assert g.saved == 0 and "no positive modulus" in g.why
    with pytest.raises(ValueError, match="not a positive parameter"):
        group((MU, D1), {"Fz": "N"}, reference="D1")
    with pytest.raises(ValueError, match="unknown channel"):
        group((MU,), {"Fz": "N"}).expand("Fx", 1.0, 2.0)
    with pytest.raises(ValueError, match="must be positive"):
        group((MU,), {"Fz": "N"}).reduce({"mu": 0.0})
