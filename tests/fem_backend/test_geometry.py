"""Gaps, normals and curvatures of the rigid bodies, and where a sphere first touches an ellipsoid."""

import numpy as np
import pytest
from scipy import optimize

from fem_backend.geometry import EllipsoidShape
from fem_backend.indenters.sphere import Sphere
from fem_backend.simulation import assembly
from fem_backend.simulation.experiment import read_settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.supports.bowl import Bowl

DIRECTION = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])
CENTRE = np.array([0.4, -0.7, 1.1])
BOWL = Bowl((6.0, 4.0, 3.5), (0.3, -0.2, 0.1), rim_z=0.5, lip=1.0)
AXES = np.array([6.0, 4.0, 3.5])


def points(kind: str) -> np.ndarray:
    """Points around a rigid body, away from the joint of its two parts (there the Hessian jumps)."""
    rng = np.random.default_rng(3)
    if kind in ("sphere", "shaft"):
        x = CENTRE + rng.normal(size=(60, 3)) * 4
        side = (x - CENTRE) @ DIRECTION
        return x[np.abs(side) > 1e-2]
    x = np.array(BOWL.centre) + AXES * rng.uniform(-1, 1, (200, 3)) * 1.3
    scaled = np.linalg.norm((x - BOWL.centre) / AXES, axis=1)
    near = x[(scaled > 0.8) & (np.abs(x[:, 2] - BOWL.rim_z) > 1e-2)]  # outside the evolute: one closest point
    return near[near[:, 2] > BOWL.rim_z] if kind == "lip" else near[near[:, 2] < BOWL.rim_z]


RIGID = {"sphere": Sphere(3.0), "shaft": Sphere(3.0, shaft=True), "bowl": BOWL, "lip": BOWL}


@pytest.mark.parametrize("kind", RIGID)
def test_normal_and_hessian_are_the_derivatives_of_the_gap(kind):
    """Central differences; their error is h²·g''' + round-off/h, some 1e-9 here."""
    rigid, x, h = RIGID[kind], points(kind), 1e-5
    assert len(x) > 20
    _, n, hessian = rigid.gap(x, CENTRE, DIRECTION)
    for k in range(3):
        e = h * np.eye(3)[k]
        (ga, na, _), (gb, nb, _) = rigid.gap(x - e, CENTRE, DIRECTION), rigid.gap(x + e, CENTRE, DIRECTION)
        np.testing.assert_allclose(n[:, k], (gb - ga) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(hessian[:, :, k], (nb - na) / (2 * h), atol=1e-7)
    if kind != "lip":
        np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(hessian, hessian.swapaxes(1, 2), atol=1e-12)


def test_gap_of_the_sphere_by_complex_step():
    """n = ∇g and ∇∇g by complex step on g(x) = |x − c| − R written out here."""
    rng = np.random.default_rng(0)
    x, c, R, h = rng.normal(size=(5, 3)) * 4, rng.normal(size=3), 3.0, 1e-30
    g, n, hessian = Sphere(R).gap(x, c)
    np.testing.assert_allclose(g, np.sqrt(((x - c) ** 2).sum(1)) - R, rtol=1e-14)
    for k in range(3):
        z = (x - c).astype(complex)
        z[:, k] += 1j * h
        r = np.sqrt((z**2).sum(1))
        np.testing.assert_allclose(n[:, k], r.imag / h, rtol=1e-13)
        np.testing.assert_allclose(hessian[:, :, k], (z / r[:, None]).imag / h, rtol=1e-12, atol=1e-14)


def test_gap_keeps_the_shape_of_the_points():
    x = points("bowl")[:24].reshape(4, 2, 3, 3)
    for rigid in RIGID.values():
        g, n, hessian = rigid.gap(x, CENTRE, DIRECTION)
        assert g.shape == (4, 2, 3) and n.shape == (4, 2, 3, 3) and hessian.shape == (4, 2, 3, 3, 3)
        np.testing.assert_array_equal(g[1, 1, 2], rigid.gap(x[1, 1, 2], CENTRE, DIRECTION)[0])


# ---------------------------------------------------------------------------------------------- shaft


def test_gap_of_the_shaft_is_the_distance_from_its_axis():
    """The body is all points within R of the half line c − s d, s ≥ 0, found by minimising over s."""
    rigid = Sphere(2.0, shaft=True)
    for x in points("shaft"):
        far = optimize.minimize_scalar(
            lambda s, x=x: np.linalg.norm(x - CENTRE + s * DIRECTION), bounds=(0.0, 60.0), options={"xatol": 1e-9}
        )
        oracle = min(far.fun, np.linalg.norm(x - CENTRE)) - rigid.R
        np.testing.assert_allclose(rigid.gap(x, CENTRE, DIRECTION)[0], oracle, atol=1e-8)


def test_joint_of_sphere_and_shaft_is_c1():
    """Gap and normal run through the joint; the curvature along the axis falls from 1/r to 0."""
    across = np.linalg.svd(DIRECTION[None])[2][1:]
    angle = np.linspace(0, 6, 7)[:, None]
    x = CENTRE + 2.7 * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
    rigid, h = Sphere(3.0, shaft=True), 1e-9
    ahead, behind = (rigid.gap(x + s * h * DIRECTION, CENTRE, DIRECTION) for s in (1.0, -1.0))
    np.testing.assert_allclose(ahead[0], behind[0], atol=1e-15)
    np.testing.assert_allclose(ahead[1], behind[1], atol=2 * h)
    jump = np.broadcast_to(np.outer(DIRECTION, DIRECTION) / 2.7, ahead[2].shape)
    np.testing.assert_allclose(ahead[2] - behind[2], jump, atol=10 * h)


def test_shaft_trails_behind():
    """Beside the shaft the gap is that of the cylinder, beside the front that of the sphere."""
    x = CENTRE + 4.0 * np.linalg.svd(DIRECTION[None])[2][1]
    for along, expected in ((-5.0, 1.0), (5.0, np.hypot(4, 5) - 3.0)):
        assert Sphere(3.0, True).gap(x + along * DIRECTION, CENTRE, DIRECTION)[0] == pytest.approx(expected, abs=1e-12)
    plain = Sphere(3.0).gap(x - 5.0 * DIRECTION, CENTRE, DIRECTION)[0]
    assert plain == pytest.approx(np.hypot(4, 5) - 3.0, abs=1e-12)


# ---------------------------------------------------------------------------------------------- bowl


def closest_on_ellipsoid(x: np.ndarray, centre: np.ndarray, axes: np.ndarray) -> float:
    """Distance from the ellipsoid by minimising over all its points, from several starts."""
    best = np.inf
    for start in np.vstack([(x - centre) / axes, np.eye(3), -np.eye(3)]):
        found = optimize.minimize(
            lambda z: ((x - centre - axes * z / np.linalg.norm(z)) ** 2).sum(), start + 1e-3, options={"gtol": 1e-11}
        )
        best = min(best, np.sqrt(found.fun))
    return best


def test_gap_of_the_bowl_is_the_distance_from_the_nearest_point():
    """Inside positive, outside negative; also deep inside, where the closest point is far."""
    rng = np.random.default_rng(5)
    x = np.vstack([points("bowl")[:12], np.array(BOWL.centre) + rng.normal(size=(6, 3)) * 0.5 - [0, 0, 1.5]])
    g, n, _ = BOWL.gap(x)
    inside = (((x - BOWL.centre) / AXES) ** 2).sum(1) < 1
    np.testing.assert_array_equal(g > 0, inside)
    assert 3 < inside.sum() < len(x) - 3
    oracle = [closest_on_ellipsoid(p, np.array(BOWL.centre), AXES) for p in x]
    np.testing.assert_allclose(np.abs(g), oracle, atol=1e-7)  # what the minimiser can do
    foot = (x - g[:, None] * n - BOWL.centre) / AXES  # following the normal by the gap ends on the surface
    np.testing.assert_allclose((foot**2).sum(1), 1.0, rtol=1e-13)


def test_round_bowl_is_a_sphere_from_inside():
    R, c = 5.0, np.array([0.2, 0.1, -0.3])
    x = c + np.random.default_rng(1).normal(size=(40, 3)) * 3
    v, r = x - c, np.linalg.norm(x - c, axis=1)
    g, n, hessian = Bowl((R, R, R), tuple(c), rim_z=100.0).gap(x)
    np.testing.assert_allclose(g, R - r, atol=1e-13)
    np.testing.assert_allclose(n, -v / r[:, None], atol=1e-13)
    outward = v / r[:, None]
    np.testing.assert_allclose(
        hessian, -(np.eye(3) - outward[:, :, None] * outward[:, None, :]) / r[:, None, None], atol=1e-12
    )


@pytest.mark.parametrize("x", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (3, 0, 0), (5.9, 0, 0), (0, 0, -3.5)])
def test_bowl_on_its_planes_of_symmetry(x):
    """No 0/0 where a coordinate is zero or the closest point is not unique."""
    g, n, hessian = Bowl(tuple(AXES), rim_z=100.0).gap(np.array(x, float))
    assert np.isfinite(hessian).all()
    np.testing.assert_allclose(np.linalg.norm(n), 1.0, rtol=1e-12)
    np.testing.assert_allclose(g, closest_on_ellipsoid(np.array(x, float), np.zeros(3), AXES), atol=1e-7)


def test_rim_lets_go():
    """Below the rim the lip does nothing; above it the gap opens C¹ until nothing touches."""
    whole = Bowl(BOWL.semi_axes, BOWL.centre, rim_z=100.0)
    below, above = points("bowl"), points("lip")
    for a, b in zip(BOWL.gap(below), whole.gap(below), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(
        BOWL.gap(above)[0] - whole.gap(above)[0], (above[:, 2] - BOWL.rim_z) ** 2 / (2 * BOWL.lip), rtol=1e-9
    )
    wall = np.array([[6.35, -0.2, BOWL.rim_z + z] for z in (-0.1, 1.0, 2.0)])  # just outside the ellipsoid
    assert np.sign(BOWL.gap(wall)[0]).tolist() == [-1, 1, 1] and np.all(whole.gap(wall)[0] < 0)
    edge = np.array([[6.2, -0.2, BOWL.rim_z]])
    up, down = (BOWL.gap(edge + s * np.array([0, 0, 1e-9])) for s in (1, -1))
    np.testing.assert_allclose(up[0], down[0], atol=1e-8)
    np.testing.assert_allclose(up[1], down[1], atol=1e-8)


# ---------------------------------------------------------------------------------------------- first contact


def brute_force(body: EllipsoidShape, R: float, through: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Least travel over all points of the ellipsoid: each is met where |y − c(s)| = R for the first time."""

    def travel(z: np.ndarray) -> float:
        v = body.semi_axes * z / np.linalg.norm(z) - through
        along = v @ d
        root = R**2 - (v - along * d) @ (v - along * d)
        return along - np.sqrt(root) if root > 0 else 1e3 - root

    z = np.random.default_rng(0).normal(size=(4000, 3))
    starts = z[np.argsort([travel(v) for v in z])[:4]]
    return through + min(optimize.minimize(travel, v, tol=1e-13, method="Nelder-Mead").fun for v in starts) * d


@pytest.mark.parametrize("seed", range(8))
def test_first_contact_is_that_of_all_points(seed):
    """An oblique way through a point off the top; the minimiser finds the travel to some 1e-7."""
    rng = np.random.default_rng(seed)
    body, R = EllipsoidShape(60.0, 35.0, 30.0), 3.0
    through = np.array([*rng.uniform(-20, 20, 2), rng.uniform(-5, 60)])
    d = np.array([*rng.uniform(-0.6, 0.6, 2), -1.0])
    found = Sphere(R).first_contact(body, through, 2.0 * d)
    d = d / np.linalg.norm(d)
    np.testing.assert_allclose(found, brute_force(body, R, through, d), atol=1e-6)
    off = found - through
    np.testing.assert_allclose(off, (off @ d) * d, atol=1e-12)  # on the line
    np.testing.assert_allclose(closest_on_ellipsoid(found, np.zeros(3), body.semi_axes), R, rtol=1e-7)


def test_first_contact_along_a_normal_and_at_the_top():
    body, R = EllipsoidShape(60.0, 35.0, 35.0), 3.0
    np.testing.assert_array_equal(Sphere(R).first_contact(body, [0, 0, 35.0], [0, 0, -1.0]), [0, 0, 38.0])
    y = body.project(np.array([[20.0, 8.0, 28.0]]))[0]
    n = y / body.semi_axes**2
    n /= np.linalg.norm(n)
    np.testing.assert_allclose(Sphere(R).first_contact(body, y, -n), y + R * n, rtol=1e-13)


@pytest.mark.parametrize("axes", [(60.0, 35.0, 35.0), (15.0, 15.0, 60.0), (20.0, 60.0, 60.0)])
def test_the_place_of_first_contact_lies_on_the_body_and_on_the_ball(axes):
    """Also where the body is curved more strongly than the ball, as at the top of one that stands on its end."""
    settings = read_settings(
        {
            "specimen": {"semi_axes": axes},
            "indenter": {"radius": 0.5 * min(axes)},
            "point": [0.35 * axes[0], 0.1 * axes[1]],
        }
    )
    placement = assembly.placement_of(settings, Knobs(mu=0.01, D1=5.8))
    x, body = placement.contact, placement.specimen
    np.testing.assert_allclose(((x / body.semi_axes) ** 2).sum(), 1.0, rtol=1e-12)
    normal = x / body.semi_axes**2
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose(placement.touch, x + settings.indenter.R * normal, rtol=1e-10)


def test_sphere_that_passes_by_is_refused():
    with pytest.raises(ValueError, match="passes by"):
        Sphere(3.0).first_contact(EllipsoidShape(60.0, 35.0, 35.0), [0.0, 38.1, 0.0], [0.0, 0.0, -1.0])
    grazing = Sphere(3.0).first_contact(EllipsoidShape(60.0, 35.0, 35.0), [0.0, 37.9, 0.0], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(np.hypot(*grazing[1:]), 38.0, rtol=1e-9)


@pytest.mark.parametrize("kind", ["sphere", "shaft", "bowl"])
def test_travel_ends_where_the_gap_is_zero(kind):
    """The rigid body moved by its travel has no gap to the point, and an instant before it had one."""
    rigid, x = RIGID[kind], points(kind)
    d = np.array([0.1, 0.05, 1.0]) / np.linalg.norm([0.1, 0.05, 1.0]) if kind == "bowl" else DIRECTION
    s = rigid.travel(x, CENTRE, d)
    meets = np.isfinite(s)
    assert 5 < meets.sum() < len(x)
    x, s = x[meets], s[meets]
    np.testing.assert_allclose(rigid.gap(x - s[:, None] * d, CENTRE, d)[0], 0.0, atol=1e-12)
    assert np.all(rigid.gap(x - (s - 1e-3)[:, None] * d, CENTRE, d)[0] > 0)


def test_hertz_radius_of_two_spheres_and_of_the_specimen():
    H = EllipsoidShape(300.0, 300.0, 300.0).mean_curvature_at_top()
    assert Sphere(3.0).effective_radius(H) == pytest.approx(1 / (1 / 3 + 1 / 300), rel=1e-15)
    # curvatures at the pole of the ellipsoid from its height z(x, 0) and z(0, y) by second differences
    a, b, c, h = 60.0, 35.0, 35.0, 1e-3
    kx = 2 * (c - c * np.sqrt(1 - (h / a) ** 2)) / h**2
    ky = 2 * (c - c * np.sqrt(1 - (h / b) ** 2)) / h**2
    H = EllipsoidShape(a, b, c).mean_curvature_at_top()
    assert Sphere(3.0).effective_radius(H) == pytest.approx(1 / (1 / 3 + (kx + ky) / 2), rel=1e-6)
