"""Rigid indenters: distance, normal and curvature of their surface, first contact, files, closed forms, real runs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.contact import tractions
from fem_backend.indenters import INDENTERS, meridian
from fem_backend.indenters.cone import Cone, equivalent_half_angle
from fem_backend.indenters.flat import Flat
from fem_backend.indenters.meridian import UPRIGHT_ANGLE_RAD, Meridian, meridian_outline
from fem_backend.indenters.plate import Plate
from fem_backend.indenters.profile import MeasuredProfile
from fem_backend.indenters.sphere import Sphere
from fem_backend.simulation import experiment
from fem_backend.simulation.knobs import knobs_class
from fem_backend.specimens import SPECIMENS
from rso.contract import Case, Programme, run_key

DOWN = np.array([0.0, 0.0, -1.0])
BOWL = tuple((3.0 * math.sin(t), 3.0 - 3.0 * math.cos(t)) for t in (0.0, 0.1, 0.3, 0.4, 0.6, 0.7, 1.0, 1.2))  # of 3 mm
MEASURED = ((0.0, 0.0), (0.2, 0.0), (0.5, 0.02), (0.8, 0.11), (1.0, 0.24), (1.2, 0.5), (1.3, 0.8), (1.4, 1.1))
SHAPES = {
    "flat": Flat(2.0, 0.3),
    "hemisphere with a shaft": Flat(1.0, 1.0),
    "cone": Cone(60.0, 0.2),
    "slim cone": Cone(20.0, 0.5),
    "profile": MeasuredProfile(MEASURED),
    "plate": Plate(),
}


def turned(seed: int) -> np.ndarray:
    """A unit vector in any direction."""
    v = np.random.default_rng(seed).normal(size=3)
    return v / np.linalg.norm(v)


def sampled(shape, far: float = 6.0) -> np.ndarray:
    """The outline (k, 2) of a shape, densely and evenly, from `height` alone and its upright side."""
    widest = min(shape.meridian.widest, far)
    t = np.linspace(0.0, 0.5 * np.pi, 60001)
    r = widest * np.sin(t)
    curve = np.column_stack([r, shape.meridian.height(r)])
    if shape.meridian.widest < far:
        up = np.linspace(curve[-1, 1], far, 20001)
        curve = np.concatenate([curve, np.column_stack([np.full_like(up, widest), up])])
    return curve[curve[:, 1] < 2.0 * far]


def near(shape, direction: np.ndarray, tip: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) about a shape, and their (r, h)."""
    rng = np.random.default_rng(seed)
    r, h, a = rng.uniform(0.0, 2.5, 300), rng.uniform(-1.0, 2.0, 300), rng.uniform(0.0, 2.0 * np.pi, 300)
    across = np.linalg.svd(direction[None])[2][1:]
    x = tip + (r * np.cos(a))[:, None] * across[0] + (r * np.sin(a))[:, None] * across[1] - h[:, None] * direction
    return x, np.column_stack([r, h])


# ---------------------------------------------------------------------------------------------------- the gap


@pytest.mark.parametrize("name", SHAPES)
def test_the_gap_is_the_signed_distance(name):
    """Against the least distance to a densely sampled outline; its points are 1e-4 mm apart, beside 1e-2 mm at most
    where it is steep: sampling errs by less than 1e-4 mm beyond a distance of 1e-2 mm."""
    shape, d, tip = SHAPES[name], turned(1), np.array([0.3, -0.2, 0.5])
    x, at = near(shape, d, tip)
    curve = sampled(shape)
    brute = np.min(np.hypot(at[:, :1] - curve[:, 0], at[:, 1:] - curve[:, 1]), axis=1)
    inside = at[:, 1] > shape.meridian.height(at[:, 0])
    end = inside & (at[:, 0] < {"flat": 1.7, "profile": 0.2}.get(name, 0.0))
    brute[end] = at[end, 1]  # what is inside above a flat end came from there
    g = shape.gap(x, tip, d)[0]
    np.testing.assert_allclose(g, np.where(inside, -brute, brute), atol=2e-4)
    assert (inside.any() and not inside.all()) and np.array_equal(g < 0.0, inside)


@pytest.mark.parametrize("name", SHAPES)
def test_normal_and_hessian_are_derivatives_of_the_gap(name):
    """Central differences of 1e-6 mm are right to 1e-8; beside a joint, where curvature jumps, the Hessian is not
    compared, nor inside deeper than the least radius, where the closest point jumps."""
    shape, d, tip, e = SHAPES[name], turned(2), np.array([1.0, 2.0, 3.0]), 1e-6
    x, _ = near(shape, d, tip, 3)
    g, n, hessian = shape.gap(x, tip, d)
    keep = g > -0.8 * min(shape.meridian.tightest, 1.0)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-14)
    size = np.maximum(np.abs(hessian).max((1, 2)), 1.0)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", hessian, n) / size[:, None], 0.0, atol=1e-12)
    assert keep.sum() > 150
    smooth = keep.copy()
    for step in e * np.eye(3):
        high, low = (shape.gap(x + s * step, tip, d) for s in (1.0, -1.0))
        i = int(np.argmax(step))
        np.testing.assert_allclose(((high[0] - low[0]) / (2.0 * e))[keep], n[keep, i], atol=2e-8)
        error = np.abs((high[1] - low[1]) / (2.0 * e) - hessian[:, :, i]).max(1)
        smooth &= error <= 1e-7 * size**2
    assert smooth.sum() >= keep.sum() - 2  # of 300 points one or two may lie within 1e-6 mm of a joint


@pytest.mark.parametrize("name", SHAPES)
def test_the_axis_is_no_exception(name):
    """On the axis normal and Hessian are the limits from beside it, and finite."""
    shape, d = SHAPES[name], turned(4)
    across = np.linalg.svd(d[None])[2][1]
    heights = np.array([-0.7, -0.1, 0.05])[:, None]
    on, beside = (shape.gap(-heights * d + r * across, np.zeros(3), d) for r in (0.0, 1e-9))
    for a, b in zip(on, beside, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)
    np.testing.assert_allclose(on[1], np.broadcast_to(d, (3, 3)), atol=1e-15)


@pytest.mark.parametrize("name", SHAPES)
def test_joints_have_no_corner(name):
    """Normals on both sides of every joint, 1e-9 mm apart, differ by no more than curvature times that."""
    shape = SHAPES[name]
    for r in shape.meridian.starts[1:]:
        h = float(shape.meridian.height(r * (1.0 - 1e-12)))
        points = np.array([[r + s, 0.0, h + t] for s in (-1e-9, 1e-9) for t in (-1e-9, 1e-9)])
        n = shape.gap(points, np.zeros(3), DOWN)[1]
        assert np.ptp(n, axis=0).max() < 1e-9 * 10.0 / shape.meridian.tightest


def test_a_corner_would_be_seen():
    """The control of the test above: two straight pieces that meet at an angle."""
    made = np.array([[0.0, 0, 0, 1.0, 1, 0, 1, 0], [0.0, 1.0, 0, np.inf, 0.6, 0.8, 0.6, 0.8]])
    points = np.array([[1.0 - 1e-9, 0.0, -1e-9], [1.0 + 1e-9, 0.0, 1e-12]])
    assert np.ptp(Meridian(made).gap(points, np.zeros(3), DOWN)[1], axis=0).max() > 0.5


def test_a_hemisphere_with_a_shaft_is_the_sphere_with_one():
    """Two codes of one body: `Flat` with a fillet of its radius about its tip, `Sphere` about its centre."""
    d, x = turned(5), np.random.default_rng(6).normal(size=(400, 3)) * 2.0
    for a, b in zip(Flat(1.0, 1.0).gap(x, d, d), Sphere(1.0, True).gap(x, np.zeros(3), d), strict=True):
        keep = (x**2).sum(-1) > 0.01
        np.testing.assert_allclose(a[keep], b[keep], atol=1e-12)


def test_a_meridian_plane_is_enough_for_a_body_of_revolution():
    """Points (r, 0, z): the normal stays in the plane, and the Hessian around the axis is n_r/r."""
    rng = np.random.default_rng(7)
    for shape in SHAPES.values():
        x = np.column_stack([rng.uniform(0.1, 2.5, 50), np.zeros(50), rng.uniform(-1.0, 0.0, 50)])
        _, n, hessian = shape.gap(x, np.zeros(3), DOWN)
        assert np.all(n[:, 1] == 0.0) and np.abs(hessian[:, 1, [0, 2]]).max() == 0.0
        np.testing.assert_allclose(hessian[:, 1, 1], n[:, 0] / x[:, 0], atol=1e-14)


# ------------------------------------------------------------------------------------------ the way to a specimen


@pytest.mark.parametrize("name", SHAPES)
def test_travel_leads_to_the_surface(name):
    """After its travel the gap is zero, and just before it is positive; ∞ for points beside the way."""
    shape, d, tip = SHAPES[name], turned(8), np.array([0.1, 0.2, -0.3])
    x, at = near(shape, d, tip, 9)
    s = shape.travel(x, tip, d)
    hit = np.isfinite(s)
    assert np.array_equal(hit, at[:, 0] <= shape.meridian.widest) and hit.any()
    at_last = np.array([shape.gap(p[None], tip + v * d, d)[0][0] for p, v in zip(x[hit], s[hit], strict=True)])
    before = np.array([shape.gap(p[None], tip + (v - 1e-3) * d, d)[0][0] for p, v in zip(x[hit], s[hit], strict=True)])
    np.testing.assert_allclose(at_last, 0.0, atol=1e-12)
    assert np.all(before > 0.0)


@pytest.mark.parametrize("name", SHAPES)
def test_swept_is_what_lies_inside_on_the_way(name):
    """Against the gap at 200 places of the tip, forwards and back; points within a step of the edge are left out."""
    shape, d = SHAPES[name], turned(10)
    x, _ = near(shape, d, np.zeros(3), 11)
    start, end = -0.3 * d, 0.6 * d
    least = np.min([shape.gap(x, start + t * (end - start), d)[0] for t in np.linspace(0.0, 1.0, 201)], axis=0)
    clear = np.abs(least) > 0.005
    for ends in ((start, end), (end, start)):
        assert np.array_equal(shape.swept(x, *ends, d)[clear], least[clear] < 0.0)
    assert np.array_equal(shape.swept(x, end, end, d), shape.travel(x, end, d) < 0.0)


PLACES = [((0.0, 0.0), (0.0, 0.0, -1.0)), ((20.0, 5.0), (0.0, 0.0, -1.0)), ((-10.0, 8.0), (0.15, -0.1, -1.0))]


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize(("point", "way"), PLACES)
def test_first_contact_is_the_first_of_all_points_of_the_specimen(name, point, way):
    """Against the travel to 200 000 points of an ellipsoid, half of them dense about the one that is touched: none is
    nearer than round-off of 50 mm, and the nearest is as near as points 1e-2 mm apart let it be."""
    shape, d = SHAPES[name], np.array(way) / np.linalg.norm(way)
    body, rng = SPECIMENS.read({}), np.random.default_rng(12)
    tip = shape.first_contact(body, np.array([*point, 40.0]), way)
    touched = shape.first_touched(body, tip, d)
    np.testing.assert_allclose(shape.travel(touched[None], tip, d), 0.0, atol=1e-12)
    np.testing.assert_allclose((touched**2 / body.semi_axes**2).sum(), 1.0, atol=1e-13)
    everywhere = body.project(rng.normal(size=(100000, 3)) * body.semi_axes)
    close = body.project(touched + rng.normal(size=(100000, 3)) * rng.choice([0.01, 0.1, 1.0], 100000)[:, None])
    left = shape.travel(np.concatenate([everywhere, close]), tip, d)
    assert -1e-12 < left.min() < 1e-5
    line = np.array([*point, 40.0]) - tip
    np.testing.assert_allclose(line - (line @ d) * d, 0.0, atol=1e-12)


def test_a_tilted_flat_end_touches_with_its_edge():
    """The fillet's circle meets the ellipsoid's top from aside, and contact is about the axis all the same."""
    flat, body, d = Flat(2.0, 0.1), SPECIMENS.read({}), np.array([math.sin(0.1), 0.0, -math.cos(0.1)])
    tip = flat.first_contact(body, np.zeros(3), d)
    assert 1.8 < np.linalg.norm(np.cross(flat.first_touched(body, tip, d) - tip, d)) < 2.0
    on = flat.contact(body, tip, d)
    assert np.linalg.norm(np.cross(on - tip, d)) < 1e-12 and abs((on**2 / body.semi_axes**2).sum() - 1.0) < 1e-13


def test_what_passes_by_is_said():
    with pytest.raises(ValueError, match=r"a flat end on the line through \[63.0, 0.0, 0.0\] .* passes by the body"):
        Flat(2.0, 0.1).first_contact(SPECIMENS.read({}), [63.0, 0.0, 0.0], DOWN)
    assert np.isfinite(Flat(4.0, 0.1).first_contact(SPECIMENS.read({}), [63.0, 0.0, 0.0], DOWN)).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_area_of_a_cap_is_that_of_a_surface_of_revolution(name):
    """By quadrature of 2π r dσ along the sampled outline; the distance from the axis is its inverse."""
    shape = SHAPES[name]
    curve = sampled(shape, 3.0)
    length = np.hypot(*np.diff(curve, axis=0).T)
    area = np.concatenate([[0.0], np.cumsum(2.0 * 0.5 * (curve[1:, 0] + curve[:-1, 0]) * length)])
    some = slice(1, None, 997)
    np.testing.assert_allclose(shape.meridian.caps(*curve[some].T), area[some], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(shape.meridian.radius_of_cap(area[some]), curve[some, 0], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_the_drawn_outline_is_the_surface(name):
    """Every point of the cut lies on the surface, on both sides of the axis, and a flat end has its side."""
    shape, tip, d = SHAPES[name], np.array([1.0, 0.5, 2.0]), np.array([0.6, 0.0, -0.8])
    drawn = shape.outline(tip, d, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    points = np.column_stack([drawn[:, 0], np.full(len(drawn), 0.5), drawn[:, 1]])
    np.testing.assert_allclose(shape.gap(points, tip, d)[0], 0.0, atol=1e-12)
    beside, up = (points - tip) @ [0.8, 0.0, 0.6], -(points - tip) @ d
    assert beside.min() == pytest.approx(-beside.max()) and beside.max() > 0.4
    assert up.max() > 2.0 * shape.length or name not in ("flat", "slim cone")


def test_elements_are_small_where_a_surface_bends():
    """A third of the fillet at the edge, and growing from there; at a tip as at a ball, whose contact begins with a
    point; never needlessly fine at the axis; as the unit."""
    r = np.linspace(0.0, 6.0, 400)
    flat = Flat(2.0, 0.1).spacing(r)
    assert abs(r[np.argmin(flat)] - 1.95) < 0.06 and flat.min() == pytest.approx(0.1 / 3.0) and flat[0] == 0.24
    cone, ball = Cone(60.0, 0.05).spacing(r), Sphere(3.0).spacing(r)
    assert np.argmin(cone) == 0 and np.all(np.diff(cone) >= 0.0) and cone[0] == pytest.approx(0.2 * 0.05)
    assert (cone <= np.maximum(0.12 * r, 0.01) + 1e-12).all()
    assert (
        ball[0] == pytest.approx(0.15) and ball[199] == pytest.approx(0.36, abs=1e-3) and np.all(np.diff(ball) >= 0.0)
    )
    assert np.ptp(Plate().spacing(r)) == 0.0
    for shape, larger in ((Flat(2.0, 0.1), Flat(2e-3, 1e-4)), (Cone(60.0, 0.05), Cone(60.0, 5e-5))):
        np.testing.assert_allclose(larger.spacing(1e-3 * r), 1e-3 * shape.spacing(r), rtol=1e-12)


# -------------------------------------------------------------------------------------------------- closed forms


def test_how_far_contact_reaches_onto_an_edge():
    """In thirds of the radius of the fillet; on the disc, which has no edge, on balls and cones, nothing."""
    flat = Flat(2.0, 0.3)
    np.testing.assert_allclose(
        flat.on_edge(np.array([1.0, 1.65, 1.7, 1.8, 2.0])), [np.inf, 0.0, 0.0, 1.0, 3.0], atol=1e-9
    )
    for shape in (Sphere(3.0), Cone(60.0, 0.2)):
        assert np.all(np.isinf(shape.on_edge(np.array([0.0, 0.1, 1.0]))))


def test_forces_on_a_half_space():
    """Sneddon's flat end and cone, and for a ball of revolution his sphere and, shallow, Hertz: to the 2e-4 of sums."""
    E, nu, d = 0.03, 0.4, np.array([0.01, 0.2, 1.0])
    star = E / (1.0 - nu**2)
    np.testing.assert_allclose(Flat(2.0, 0.1).force(d, 0.0, E, nu), 2.0 * star * 2.0 * d, rtol=1e-14)
    sharp = 2.0 / math.pi * star * math.tan(math.radians(60.0)) * d**2
    np.testing.assert_allclose(Cone(60.0, 1e-6).force(d, 0.0, E, nu), sharp, rtol=3e-4)
    assert np.all(Cone(60.0, 0.1).force(d, 0.0, E, nu) > sharp)  # a blunt tip meets more
    a, R = np.array([0.05, 0.7, 2.0]), 3.0
    log = np.log((R + a) / (R - a))
    ball = meridian_outline([(UPRIGHT_ANGLE_RAD, R), (UPRIGHT_ANGLE_RAD, math.inf)])
    found = meridian.half_space_force(ball, 0.5 * a * log, 0.0, E, nu, 2.9)
    np.testing.assert_allclose(found, star * (0.5 * (a**2 + R**2) * log - a * R), rtol=3e-4)
    assert np.all(np.abs(found / (star * a**3)) > 0.4)  # not zero over zero


def test_forces_on_a_curved_body():
    """A plane and a flat end on a ball of 50 mm are Hertz's until the edge is reached, then the flat end is stiffer by
    nothing at first and by 2 E* a in the end; the cone has no more force than on a plane."""
    E, nu, H = 1.0, 0.5, 1.0 / 50.0
    d = np.linspace(0.0, 0.3, 301)
    flat, plate = Flat(2.0, 0.1).force(d, H, E, nu), Plate().force(d, H, E, nu)
    reached = d < 4.0 * H
    np.testing.assert_allclose(flat[reached], plate[reached], rtol=1e-12)
    assert np.all(np.diff(flat, 2) > -1e-9) and np.all(flat[~reached] <= plate[~reached])
    np.testing.assert_allclose(np.diff(flat)[-1] / np.diff(d)[-1], 2.0 * E / 0.75 * 2.0, rtol=1e-9)
    assert np.all(Cone(60.0, 0.1).force(d[1:], H, E, nu) < Cone(60.0, 0.1).force(d[1:], 0.0, E, nu))
    assert Plate().force(d, 0.0, E, nu) is None and Plate().modulus(d, d, 0.0, nu) is None


@pytest.mark.parametrize("name", [n for n in SHAPES if "flat" not in n and "plate" not in n and "shaft" not in n])
def test_stiffness_is_that_of_the_contact_radius(name):
    """dF/dd = 2 E* a of every profile of revolution on a half-space (Sneddon 1965; Pharr, Oliver & Brotzen 1992)."""
    d, e = np.array([0.05, 0.3, 0.9]), 1e-3
    high, low = (SHAPES[name].force(d * (1.0 + s), 0.0, 1.0, 0.0) for s in (e, -e))
    np.testing.assert_allclose((high - low) / (2.0 * e * d), 2.0 * SHAPES[name].contact_radius(d, 0.0), rtol=1e-3)


def test_contact_radii():
    d = np.array([0.1, 0.5])
    assert np.all(Flat(2.0, 0.1).contact_radius(d, 0.0) == 2.0) and Flat(2.0, 0.1).contact_radius(d, 0.1)[0] == 1.0
    np.testing.assert_allclose(Cone(60.0, 1e-5).contact_radius(d, 0.0), 2 / math.pi * math.sqrt(3.0) * d, rtol=1e-3)
    np.testing.assert_allclose(Sphere(3.0).contact_radius(d, 1 / 6), np.sqrt(2.0 * d), rtol=1e-14)


@pytest.mark.parametrize("name", [n for n in SHAPES if n != "plate"])
def test_the_modulus_is_the_inverse_of_the_force(name):
    d = np.array([0.1, 0.5])
    F = SHAPES[name].force(d, 0.01, 0.02, 0.45)
    np.testing.assert_allclose(SHAPES[name].modulus(F, d, 0.01, 0.45), 0.02, rtol=1e-12)
    low, high = SHAPES[name].force(np.array([1e-5, 2e-5]), 0.0, 0.02, 0.45)
    assert high / low > 1.0


def test_pyramids_have_the_cross_section_of_their_cone():
    """70.3 degrees of Vickers and Berkovich and 42.3 of a cube corner, the literature's three digits."""
    found = {name: equivalent_half_angle(name) for name in ("vickers", "berkovich", "cube_corner")}
    assert found == pytest.approx({"vickers": 70.3, "berkovich": 70.3, "cube_corner": 42.28}, abs=0.04)
    table = {"shape": "cone", "pyramid": "vickers", "tip_radius": 0.1}
    assert INDENTERS.read(table).plain()["half_angle"] == found["vickers"]


# ------------------------------------------------------------------------------------------------- measured profiles


def written(folder, text: str) -> str:
    file = folder / "tip.csv"
    file.write_text(text, encoding="utf-8")
    return str(file)


def test_points_of_a_circle_give_the_circle():
    """Arcs through points of a sphere are that sphere: gap, normal and curvature to round-off."""
    x = np.random.default_rng(13).uniform(-1.5, 1.5, (200, 3)) - [0.0, 0.0, 1.5]
    found, ball = MeasuredProfile(BOWL).gap(x, np.zeros(3), DOWN), Sphere(3.0).gap(x, np.array([0.0, 0.0, 3.0]), DOWN)
    for a, b in zip(found, ball, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11)


def test_a_profile_goes_through_its_points_and_is_convex():
    made = MeasuredProfile(MEASURED).meridian
    r, z = np.array(MEASURED).T
    np.testing.assert_allclose(made.height(r), z, atol=1e-12)
    fine = made.height(np.linspace(0.0, 1.6, 4001))
    assert np.all(np.diff(fine, 2) > -1e-12) and np.all(np.diff(fine) >= 0.0)
    assert np.all(made.height(np.linspace(0.0, 0.2, 5)) == 0.0)  # level points are a flat end
    np.testing.assert_allclose(made.slope(np.array([1.35, 3.0])), 3.0, rtol=1e-9)  # in line, and straight on


def test_a_profile_from_a_file(tmp_path):
    """Units of the header, any height of the tip, comments; the key holds the points, not the path."""
    rows = "\n".join(f"{1e3 * r:.12g};{1e3 * z + 40.0:.12g}" for r, z in MEASURED)
    file = written(tmp_path, f"# tip 7\nr (um);z (um)\n{rows}\n")
    read = INDENTERS.read({"shape": "profile", "file": file})
    np.testing.assert_allclose(read.points, MEASURED, atol=1e-12)
    case = Case("a", Programme.ramp((0.1,)), {"indenter": {"shape": "profile", "file": file}})
    values, canonical = BACKEND.canonical({"mu": 0.01, "D1": 5.0}, case)
    assert "tip.csv" not in json.dumps(canonical.settings) and len(canonical.settings["indenter"]["points"]) == 8
    key = run_key(BACKEND, values, canonical)
    (tmp_path / "tip.csv").unlink()
    assert run_key(BACKEND, *BACKEND.canonical(values, canonical)) == key
    assert experiment.read_settings(canonical.settings).indenter == read


HEAD = "r_mm,z_mm\n"
WRONG = [
    ("", "the file is empty"),
    ("r,z\n0,0\n", "row 1: the header 'r,z' must name r and z with their units"),
    ("r_furlong,z_mm\n0,0\n", "row 1: the header 'r_furlong,z_mm' must name r and z with their units"),
    (HEAD + "0,0\n1,x\n2,1\n", "row 3: z = 'x': a number in mm is expected"),
    (HEAD + "0,0\n1\n2,1\n", "row 3: z = missing: a number in mm"),
    (HEAD + "0,0\n1,nan\n2,1\n", "row 3: z = nan: a finite number"),
    (HEAD + "0,0\n1,0.1\n", "2 points: 3 to 1000 are expected"),
    (HEAD + "0.1,0\n1,0.1\n2,1\n", "row 2: r = 0.1 mm: the first point must lie on the axis"),
    (HEAD + "0,0\n1,0.1\n0.9,1\n", "row 4: r = 0.9 mm is less than 1 mm before it"),
    (HEAD + "0,0\n1,0.1\n2,0.05\n", "row 4: z = 0.05 mm is less than 0.1 mm before it"),
    (HEAD + "0,0\n1,0.1\n1,0.1\n", "row 4: r = 1 mm, z = 0.1 mm: the same point"),
    (HEAD + "0,0\n1,0.2\n2,0.3\n", "row 3: z = 0.2 mm at r = 1 mm: the profile bends inwards there (11.3 to 5.71"),
    (HEAD + "0,0\n1,1\n2,2\n", "row 2: a sharp tip of 45 degrees"),
    (HEAD + "0,0\n1,0\n1,1\n1,2\n", "row 3: a sharp edge at r = 1 mm, of 0 to 90 degrees"),
    (
        HEAD + "0,0\n1,0\n1.001,0.001\n1.001,1\n1.001,2\n",
        "the profile bends with a radius of 0.001 mm: at least 0.01 mm",
    ),
]


@pytest.mark.parametrize(("text", "said"), WRONG)
def test_a_wrong_file_is_refused_with_file_row_and_value(tmp_path, text, said):
    file = written(tmp_path, text)
    with pytest.raises(ValueError) as refused:
        INDENTERS.read({"shape": "profile", "file": file})
    assert str(refused.value).startswith(f"indenter.file = {file!r}: ") and said in str(refused.value)


# ------------------------------------------------------------------------------------------------ settings and knobs


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"shape": "flat"}, "indenter.radius: missing; the radius of the cylinder is expected"),
        ({"shape": "flat", "radius": 2.0}, "indenter.fillet: missing; a sharp edge .* e.g. 0.1 mm"),
        ({"shape": "flat", "radius": 2.0, "fillet": 0}, "indenter.fillet = 0.0 mm: a sharp edge .* 0.0201 to 2 mm"),
        ({"shape": "flat", "radius": 2.0, "fillet": 0.01}, "indenter.fillet = 0.01 mm: a sharp edge"),
        ({"shape": "flat", "radius": 2.0, "fillet": 2.1}, "indenter.fillet = 2.1 mm: larger than the radius"),
        ({"shape": "flat", "radius": 2.0, "fillet": "0.1"}, "indenter.fillet = '0.1': .* lengths are in mm"),
        ({"shape": "flat", "radius": -2.0, "fillet": 0.1}, "indenter.radius = -2.0 mm: must be positive"),
        ({"shape": "cone", "tip_radius": 0.1}, "indenter.half_angle: missing; 10 to 88 degrees .* vickers"),
        ({"shape": "cone", "half_angle": 60, "tip_radius": 0}, "indenter.tip_radius = 0 mm: a sharp tip"),
        ({"shape": "cone", "half_angle": 60}, "indenter.tip_radius: missing; a sharp tip"),
        ({"shape": "cone", "half_angle": 95, "tip_radius": 0.1}, "indenter.half_angle = 95 degrees: 10 to 88"),
        ({"shape": "cone", "pyramid": "viker", "tip_radius": 0.1}, "pyramid = 'viker' .* did you mean 'vickers'"),
        ({"shape": "cone", "pyramid": "vickers", "half_angle": 60, "tip_radius": 0.1}, "half_angle is given, too"),
        ({"shape": "plate", "contact": "glue"}, "indenter.contact = 'glue' is not modelled; choose from slip, bonded"),
        ({"shape": "profile"}, "indenter.file: missing; a CSV file"),
        ({"shape": "profile", "file": "none.csv"}, "indenter.file = 'none.csv': cannot be read"),
        ({"shape": "profile", "points": [[0, 0], [1, 2, 3]]}, r"indenter.points = .*: a list of \[r, z\]"),
        ({"shape": "flat", "radius": 2.0, "fillet": 0.1, "shaft": True}, "indenter.shaft = True: unknown"),
        ({"radius": 2.0, "fillet": 0.1}, "indenter.shape is missing: fillet belongs to flat; .* that of 'sphere'"),
    ],
)  # fmt: skip
def test_wrong_settings_say_key_value_and_what_is_expected(table, said):
    with pytest.raises(ValueError, match=said):
        INDENTERS.read(table)


@pytest.mark.parametrize("name", SHAPES)
def test_the_canonical_table_is_read_again(name):
    assert INDENTERS.read(SHAPES[name].plain()) == SHAPES[name]
    assert INDENTERS.read(json.loads(json.dumps(SHAPES[name].plain()))) == SHAPES[name]


def knobs(**values: float):
    return replace(knobs_class()(mu=0.01, D1=5.0), **values)


def test_knobs_change_what_they_name():
    body = SPECIMENS.read({})
    assert Flat(2.0, 0.1).actual(knobs(delta_punch_radius=0.1, delta_punch_fillet=0.05), body) == Flat(2.1, 0.1 + 0.05)
    assert Cone(60.0, 0.1).actual(knobs(delta_half_angle=-1.0, delta_tip_radius=0.02), None) == Cone(59.0, 0.1 + 0.02)
    scaled = MeasuredProfile(BOWL).actual(knobs(profile_scale=1.1), None)
    np.testing.assert_allclose(scaled.points, 1.1 * np.array(BOWL), rtol=1e-14)
    for shape in SHAPES.values():
        assert shape.actual(knobs(), body) == shape


@pytest.mark.parametrize(
    ("shape", "values", "said"),
    [
        (Flat(2.0, 0.1), {"delta_punch_radius": -2.0}, "delta_punch_radius = -2 mm: a flat end of 0 mm"),
        (Flat(2.0, 0.1), {"delta_punch_fillet": -0.1}, "delta_punch_fillet = -0.1 mm: a fillet of 0 mm, must be 0.02"),
        (Cone(60.0, 0.1), {"delta_half_angle": 29.0}, "delta_half_angle = 29 deg: a half angle of 89 degrees"),
        (Cone(60.0, 0.1), {"delta_tip_radius": -0.1}, "delta_tip_radius = -0.1 mm: a tip of 0 mm"),
        (Sphere(3.0), {"delta_R": -3.0}, "delta_R = -3 mm: an indenter of 0 mm"),
    ],
)
def test_errors_that_leave_no_indenter_are_refused(shape, values, said):
    with pytest.raises(ValueError, match=said):
        shape.actual(knobs(**values), SPECIMENS.read({}))


def test_what_limits_the_size_of_an_indenter_is_the_specimen():
    """A specimen whose meshes take any lets a ball be larger than itself; those of the ellipsoid do not."""
    body = SPECIMENS.read({})
    assert Sphere(3.0).actual(knobs(delta_R=90.0), SimpleNamespace(fattest=math.inf)) == Sphere(93.0)
    assert Sphere(3.0).actual(knobs(delta_R=18.0), body) == Sphere(21.0)
    for shape, values in ((Sphere(3.0), {"delta_R": 18.1}), (Flat(3.0, 1.0), {"delta_punch_radius": 18.1})):
        with pytest.raises(ValueError, match=r"of 21\.1 mm, must be larger than 0 and at most 21 mm on this specimen"):
            shape.actual(knobs(**values), body)
    with pytest.raises(ValueError, match=r"indenter\.radius = 20\.0 mm: this specimen is meshed for"):
        BACKEND.check(Case("a", Programme.ramp((1.0,)), {"indenter": {"radius": 20.0}}))


def test_an_edge_that_elements_do_not_resolve_is_refused_with_one_that_they_do():
    """What is said to be resolved is taken, and so is the same edge on a finer mesh."""
    table = {"shape": "flat", "radius": 3.0, "fillet": 0.2}
    with pytest.raises(ValueError, match=r"indenter\.fillet: elements of 0\.75 mm .* at least 0\.264 mm") as refused:
        experiment.read_settings({"indenter": table, "mesh": {"level": "coarse"}})
    least = float(str(refused.value).split("at least ")[1].split(" mm")[0])
    experiment.read_settings({"indenter": {**table, "fillet": least}, "mesh": {"level": "coarse"}})
    experiment.read_settings({"indenter": table, "mesh": {"level": "fine"}})


def test_plausible_errors_go_with_the_size_and_angles_do_not():
    for length, table in ((3.0, {"tip_radius": 0.3}), (1.5, {"tip_radius": 0.15})):
        settings = {"indenter": {"shape": "cone", "half_angle": 60, **table}}
        found = BACKEND.plausible(settings)
        tip = found.get("delta_tip_radius", (-0.15, 0.3))
        assert tip == pytest.approx((-0.05 * length, 0.1 * length))
        assert found.get("delta_half_angle", "as declared") == "as declared" and found["delta_R"] is None
        assert BACKEND.gauges(settings)["delta_half_angle"][1] == 0.2
    assert BACKEND.exponents({"indenter": {"shape": "flat", "radius": 2.0, "fillet": 0.3}})[0] == 1.0


# ----------------------------------------------------------------------------------------------------- glued points


def glue(seed: int = 0):
    """A pair with glued and free points on two triangles, positions, and a load."""
    rng = np.random.default_rng(seed)
    X, _ = tractions.get_quadrature(tractions.RefTri, tractions.FACET_QUADRATURE_ORDER)
    N = np.stack([tractions.ElementTriP2().lbasis(X, a)[0] for a in range(6)]).T.copy()
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    facets = np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 6, 7, 8]])
    flat = np.concatenate([corners, [[0.5, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 0.5]]])
    nodes = np.column_stack([flat, np.zeros(9)])
    weights = np.full((2, len(N)), 0.5 / len(N))
    place = np.array(
        [[[27 * (3 * a + i) + 3 * b + j for b in f for j in range(3)] for a in f for i in range(3)] for f in facets],
        np.int32,  # as patterns have them: another type would be compiled anew
    )
    surface = tractions.ContactSurface(facets, N, weights, place, np.zeros((2, len(N), 3)))
    points = tractions.contact_points(surface, nodes)
    held = np.where(rng.uniform(size=(2, len(N), 1)) < 0.5, points, np.nan)
    pair = tractions.Pair(surface, Plate("bonded"), np.full(weights.shape, 3.0), soft=True, held=held)
    x = nodes + 0.01 * rng.normal(size=nodes.shape)
    return pair, x, tractions.Touch(np.array([0.0, 0.0, -0.02]), DOWN, np.zeros(weights.shape))


def test_glue_has_a_potential():
    """Residual, tangent and the rate along the way are derivatives of the energy, and forces balance."""
    pair, x, touch = glue()
    at, e = tractions.evaluate_contact(pair, x, touch), 1e-6
    data = np.zeros(27 * 27)
    rate = tractions.add_contact_tangent(pair, x, touch, at, data)
    K = data.reshape(27, 27)
    for k in range(27):
        step = np.zeros(27)
        step[k] = e
        high, low = (tractions.evaluate_contact(pair, x + s * step.reshape(9, 3), touch) for s in (1.0, -1.0))
        assert (high.energy - low.energy) / (2 * e) == pytest.approx(at.residual.ravel()[k], abs=1e-6)
        np.testing.assert_allclose((high.residual - low.residual).ravel() / (2 * e), K[:, k], atol=1e-5)
    further = [replace(touch, centre=touch.centre + s * e * DOWN) for s in (1.0, -1.0)]
    high, low = (tractions.evaluate_contact(pair, x, t).residual for t in further)
    np.testing.assert_allclose((high - low) / (2 * e), rate, atol=1e-5)
    np.testing.assert_allclose(at.residual.sum(0), at.force, atol=1e-12)
    assert np.abs(K - K.T).max() < 1e-9 and np.linalg.eigvalsh(K).min() > -1e-9


def test_glue_pulls_and_contact_does_not():
    pair, x, touch = glue()
    up = replace(touch, centre=np.array([0.1, 0.0, 0.5]))
    pulled = tractions.evaluate_contact(pair, x, up)
    assert (
        pulled.force[2] < 0.0
        and pulled.force[0] < 0.0
        and np.all(pulled.pressure[~np.isfinite(pair.held[..., 0])] == 0)
    )
    assert np.all(tractions.evaluate_contact(replace(pair, held=None), x, up).force == 0.0)


# ----------------------------------------------------------------------------------------------------------- runs


def solved(indenter: dict, asked: tuple[float, ...], **settings):
    table = {"mesh": {"level": "coarse"}, "indenter": indenter, **settings}
    return BACKEND({"mu": 0.01, "D1": 5.0}, Case("run", Programme.ramp(asked), table))


def test_a_hemisphere_with_a_shaft_has_the_force_of_the_ball_with_one():
    """The same surface by two codes and two reference points on the same mesh; the loads' tolerance is 1e-9."""
    flat = solved({"shape": "flat", "radius": 3.0, "fillet": 3.0}, (0.5, 1.0))
    ball = solved({"shape": "sphere", "radius": 3.0, "shaft": True}, (0.5, 1.0))
    np.testing.assert_allclose(flat.channels["Fz"], ball.channels["Fz"], rtol=1e-6)
    for name in ("mu", "D1"):
        np.testing.assert_allclose(flat.gradients[name]["Fz"], ball.gradients[name]["Fz"], rtol=1e-4)


def test_a_profile_of_a_ball_has_the_force_of_the_ball():
    points = [[p, q] for p, q in BOWL]
    found = solved({"shape": "profile", "points": points}, (0.5,)).channels["Fz"]
    np.testing.assert_allclose(found, solved({"radius": 3.0}, (0.5,)).channels["Fz"], rtol=1e-4)


def test_flat_end_and_cone_grow_as_they_should():
    """d by the flat end once all of it touches, about d² by the cone; support gives the force back; exact signs."""
    flat = solved({"shape": "flat", "radius": 3.0, "fillet": 0.5}, (0.5, 1.0, 1.5))
    F = flat.channels["Fz"]
    assert abs((F[2] - F[1]) / (F[1] - F[0]) - 1.0) < 0.05
    E, nu = 9 * 0.4 * 0.01 / (3 * 0.4 + 0.01), (3 * 0.4 - 0.02) / (6 * 0.4 + 0.02)
    assert (F[1] - F[0]) / 0.5 == pytest.approx(2.0 * E / (1 - nu**2) * 3.0, rel=0.1)  # a coarse mesh, a body of 35 mm
    cone = solved({"shape": "cone", "half_angle": 60, "tip_radius": 0.3}, (1.0, 2.0))
    assert 2.0**1.7 < cone.channels["Fz"][1] / cone.channels["Fz"][0] < 2.0**2.1
    assert 0.8 * 2.2 < cone.channels["contact_radius"][1] < 1.2 * 2.2  # Sneddon: (2/π) d tan α
    for run in (flat, cone):
        np.testing.assert_allclose(run.info["reaction_Fz"], run.channels["Fz"], rtol=1e-6)
        assert np.all(run.channels["Fx"] == 0.0) and np.all(run.error["Fz"] > 0.0)


def test_a_bonded_plate_needs_a_flat_top():
    with pytest.raises(ValueError, match=r'indenter\.contact = "bonded": .* specimen.shape = "ellipsoid" is curved'):
        experiment.read_settings({"indenter": {"shape": "plate", "contact": "bonded"}})
    plate, points = Plate("bonded", 1.0), np.array([[1.0, 2.0, 0.0], [0.0, 0.0, -0.1]])
    held = plate.held(points, np.zeros(3), DOWN)
    assert np.array_equal(held[0], points[0]) and np.isnan(held[1]).all()
    with pytest.raises(ValueError, match="touches it nowhere"):
        plate.held(points[1:], np.zeros(3), DOWN)
    assert Plate("slip").held(points, np.zeros(3), DOWN) is None
