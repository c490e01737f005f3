"""Table 4.1 of the source from the simulations that it prints: what its polynomials say, and where they say nothing."""

from pathlib import Path

import numpy as np
import pytest

from rso.inference import fit_surface, surface_minima

FOLDER = Path(__file__).parents[2] / "studies" / "kidney_em2" / "thesis"


def printed(name):
    """(points, errors) in MPa, 1/MPa, as printed."""
    table = np.loadtxt(FOLDER / f"{name}.csv", delimiter=",", comments="#", skiprows=4)
    return table[:, :2], table[:, 2]


def minima(name, degree):
    surface = fit_surface(*printed(name), degree)
    return surface, surface_minima(surface)


@pytest.mark.parametrize(("name", "count", "value"), [("nrmse", 38, 0.0339), ("mre", 43, 0.1098)])
def test_the_lists_are_those_of_the_source(name, count, value):
    points, errors = printed(name)
    assert len(points) == count
    # Set 1 of its table 5.1 is in both: (9999.7 Pa, 5.8 1/MPa).
    (at,) = np.flatnonzero(np.all(np.isclose(points, [0.0099997, 5.7867], rtol=1e-9), axis=1))
    assert errors[at] == value and errors.min() >= 0.995 * value


@pytest.mark.parametrize(
    ("name", "expected", "r2", "table"),
    [("nrmse", (0.01215, 107.8), 0.933, (0.0122, 108.6)), ("mre", (0.0117, 61.8), 0.927, (0.0119, 72.7))],
)
def test_degree_two(name, expected, r2, table):
    surface, found = minima(name, 2)
    (m,) = found
    # 0.5 %: the numbers to compare with are given to three or four digits.
    np.testing.assert_allclose(m.theta, expected, rtol=5e-3)
    assert m.kind == "inside" and surface.r2 == pytest.approx(r2, abs=1e-3)
    # The source's own table, from a fit with rounded coefficients: the surface is flat along the valley.
    np.testing.assert_allclose(m.theta, table, rtol=0.2)


def test_degree_four_has_several_minima_and_none_is_negative():
    _, found = minima("nrmse", 4)
    inside = [m for m in found if m.kind == "inside"]
    assert len(inside) == 1
    # The source reached (10600, 29.6) from its start; another dip lies on the edge of what was sampled.
    np.testing.assert_allclose(inside[0].theta, [0.0106, 29.6], rtol=0.12)
    others = [m for m in found if m.kind != "inside"]
    assert len(others) == 1 and others[0].kind == "boundary" and others[0].theta[1] > 130
    _, mre = minima("mre", 4)
    assert [m.kind for m in mre] == ["boundary", "boundary"]
    np.testing.assert_allclose(mre[0].theta, [0.0102, 1.1], rtol=0.1)  # the source's set 3, on the edge of its ranges
    assert all(m.error > 0 for m in (*found, *mre))


def test_between_its_bounds_and_the_samples_the_polynomial_dives_below_zero():
    """Why only the hull counts: the box of the same samples holds negative 'errors'."""
    surface, _ = minima("nrmse", 4)
    points, _ = printed("nrmse")
    t = np.linspace(0, 1, 101)
    box = np.stack(np.meshgrid(*(points.min(axis=0)[k] + t * np.ptp(points[:, k]) for k in (0, 1))), axis=-1)
    box = box.reshape(-1, 2)
    negative = box[surface(box) < 0]
    assert len(negative) and not surface.inside(negative).any()
