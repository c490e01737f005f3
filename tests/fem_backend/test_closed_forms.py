"""Closed forms of indentation: limits, published values, and other numerical methods as oracles."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, MeshTri, condense, solve

from fem_backend import closed_forms
from fem_backend.closed_forms import layer

E, R = 0.03, 3.0
TABLE = json.loads(Path(__file__).with_name("reference_axisymmetric.json").read_text(encoding="utf-8"))["cases"]


# ---------------------------------------------------------------------------------------------- other methods


def spectral_compliance(k, nu, base):
    """L(k) by Chebyshev collocation of the equations of equilibrium through the thickness, at one wave number.

    u_x = U(z) sin kx, u_z = W(z) cos kx; a surface pressure cos kx; surface displacement over (1 − ν)/(μ k).
    """
    n = 40
    z = np.cos(np.pi * np.arange(n + 1) / n)
    c = np.where(np.arange(n + 1) % n == 0, 2.0, 1.0) * (-1.0) ** np.arange(n + 1)
    X = z[:, None] - z[None, :]
    D = np.outer(c, 1 / c) / (X + np.eye(n + 1))
    D = 2.0 * (D - np.diag(D.sum(1)))  # on 0 ≤ z ≤ 1, the first point on top
    ratio, I = 2.0 * nu / (1.0 - 2.0 * nu), np.eye(n + 1)  # λ/μ
    wide = ratio + 2.0
    A = np.block([[D @ D - wide * k**2 * I, -(ratio + 1.0) * k * D], [(ratio + 1.0) * k * D, wide * D @ D - k**2 * I]])
    b, m = np.zeros(2 * n + 2), n + 1
    shear, normal = np.hstack([D, -k * I]), np.hstack([ratio * k * I, wide * D])
    A[0], A[m], b[m] = shear[0], normal[0], -1.0
    A[n] = np.hstack([I, 0 * I])[n] if base == "bonded" else shear[n]
    A[m + n] = np.hstack([0 * I, I])[n]
    return -np.linalg.solve(A, b)[m] * k / (1.0 - nu)


@BilinearForm
def stiffness(u, v, w):
    """Linear elasticity about the axis, E = 1, per radian."""
    r = w.x[0]
    lame, mu = w.nu / ((1 + w.nu) * (1 - 2 * w.nu)), 0.5 / (1 + w.nu)
    a, b = ([f.grad[0, 0], f.grad[1, 1], f[0] / r, f.grad[0, 1] + f.grad[1, 0]] for f in (u, v))
    normal = sum(x * y for x, y in zip(a[:3], b[:3], strict=True))
    return r * (lame * sum(a[:3]) * sum(b[:3]) + 2 * mu * normal + mu * a[3] * b[3])


def pressed(r, z, nu, base, pushed, moved, hold=False):
    """Force per E of a cylinder of nodes r × z whose top at radii `pushed` moves down by `moved`(r): P2 elements."""
    m = MeshTri.init_tensor(r, z)
    basis = Basis(m, ElementVector(ElementTriP2()), intorder=5)
    K = stiffness.assemble(basis, nu=nu).tocsr()
    x, parts = basis.doflocs, np.arange(basis.N) % 2  # two components at each vertex and at each middle of an edge
    ur, uz = np.flatnonzero(parts == 0), np.flatnonzero(parts == 1)
    top, low = np.flatnonzero(x[1] > z[-1] - 1e-9), np.flatnonzero(x[1] < 1e-9)
    under = np.intersect1d(top[x[0, top] <= pushed + 1e-9], uz)
    fixed = [np.intersect1d(np.flatnonzero(x[0] < 1e-9), ur), np.intersect1d(low, uz), under]
    if base == "bonded":
        fixed.append(np.intersect1d(low, ur))
    if hold:
        fixed.append(np.intersect1d(top, ur))
    u = np.zeros(basis.N)
    u[under] = -moved(x[0, under])
    u = solve(*condense(K, np.zeros(basis.N), x=u, D=np.unique(np.concatenate(fixed))))
    return -2 * np.pi * (K @ u)[under].sum()


# --------------------------------------------------------------------------------------------- integral equation


@pytest.mark.parametrize("base", ["bonded", "slip"])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_compliance_of_a_layer_by_collocation(base, nu):
    k = np.array([0.05, 0.3, 1.0, 3.0, 8.0])
    other = [spectral_compliance(x, nu, base) for x in k]
    np.testing.assert_allclose(closed_forms.layer_compliance(k, nu, base), other, rtol=1e-6)  # round-off of D²


def test_compliance_knows_its_bases():
    with pytest.raises(ValueError, match='"glued"'):
        closed_forms.layer_compliance(np.ones(1), 0.5, "glued")


# Hayes, Keer, Herrmann & Mockros 1972, table 1: flat end, bonded; rows a/t, columns ν = 0.30 … 0.50.  The paper itself
# was not at hand: these are the values as they go round.  Theirs are lower, by 0.1 % at a/t = 0.6, 0.3 % at 1 and 0.9 %
# at 2 for ν = 0.5; collocation and finite elements below side with the integral equation as it is solved here.
HAYES = {
    0.2: (1.207, 1.218, 1.232, 1.252, 1.281),
    0.4: (1.472, 1.502, 1.542, 1.599, 1.683),
    0.6: (1.784, 1.839, 1.917, 2.031, 2.211),
    0.8: (2.124, 2.211, 2.337, 2.532, 2.855),
    1.0: (2.480, 2.603, 2.789, 3.085, 3.609),
    1.5: (3.400, 3.629, 3.996, 4.638, 5.970),
    2.0: (4.336, 4.685, 5.271, 6.380, 9.069),
}


def test_flat_end_against_the_table_of_hayes():
    for ratio, row in HAYES.items():
        own = [closed_forms.hayes_kappa([ratio], nu)[0][0] for nu in (0.3, 0.35, 0.4, 0.45, 0.5)]
        np.testing.assert_allclose(own, row, rtol=0.0005 if ratio < 0.5 else 0.01, atol=5e-4)


@pytest.mark.parametrize("shape, first", [("flat", 1.0), ("ball", 2.0 / 3.0)])
def test_kappa_of_a_thick_layer(shape, first):
    kappa, chi = closed_forms.hayes_kappa([1e-5], 0.4, shape=shape)
    assert kappa[0] == pytest.approx(first, rel=5e-5)  # what is left is of the order of a/t
    assert chi[0] == pytest.approx(0.0 if shape == "flat" else 1.0, abs=5e-5)
    with pytest.raises(ValueError, match='"cone"'):
        closed_forms.hayes_kappa([1.0], 0.4, shape="cone")


@pytest.mark.parametrize("base", ["bonded", "slip"])
def test_ball_on_a_layer_by_finite_elements(base):
    nu, a, t = 0.45, 1.0, 1.0  # contact as wide as the layer is thick
    (h,), (reduced,) = closed_forms.layer_contact([a], closed_forms.paraboloid(1.0), t, nu, base)
    near = a * np.sin(0.5 * np.pi * np.linspace(0, 1, 17))  # fine towards the rim
    r = np.concatenate([near, a + np.geomspace(0.005, 6.0 if base == "bonded" else 20.0, 56)])
    z = 1.0 - np.linspace(1, 0, 15) ** 1.5
    F = pressed(r, z, nu, base, a, lambda x: h - 0.5 * x**2)
    assert reduced / (1 - nu**2) == pytest.approx(F, rel=1e-3)  # twice what a halved mesh and width change
    half_space = closed_forms.hertz_force(h, 1.0, 1.0, nu)
    assert abs(half_space / F - 1) > 0.3  # the layer is felt


PROFILES = {
    "paraboloid": (closed_forms.paraboloid(R), lambda r: r / R, 2.0),
    "ball": (closed_forms.ball(R), lambda r: r / np.sqrt(R**2 - r**2), 2.9),
    "cone": (closed_forms.cone(60.0), lambda r: 1 / np.tan(np.pi / 3), 2.0),
    "cone, below the tip": (
        closed_forms.cone(60.0, 1.0),
        lambda r: r / np.sqrt(1 - r**2) if r < 0.5 else 1 / np.tan(np.pi / 3),
        2.0,
    ),
    "rounded": (
        closed_forms.rounded_flat(2.0, 0.5),
        lambda r: (r - 1.5) / np.sqrt(0.25 - (r - 1.5) ** 2) if r > 1.5 else 0.0,
        1.98,
    ),
}


@pytest.mark.parametrize("name", PROFILES)
def test_transforms_of_profiles_by_quadrature(name):
    profile, slope, most = PROFILES[name]
    for s in np.array([0.2, 0.45, 0.6, 1.0]) * most:
        jumps = [np.arcsin(min(x / s, 1.0)) for x in (0.5, 1.5)]
        by = s * quad(lambda q, s=s: slope(s * np.sin(q)), 0, np.pi / 2, points=jumps, limit=200)[0]  # r = s sin q
        assert profile.transform(np.array([s]))[0] == pytest.approx(by, rel=1e-6, abs=1e-9)


def test_half_space_is_hertz_and_sneddon():
    h, nu = np.array([0.0, 0.1, 1.0, 2.0]), 0.45
    own = closed_forms.layer_force(h, closed_forms.paraboloid(R), None, E, nu)
    np.testing.assert_allclose(own, closed_forms.hertz_force(h, R, E, nu), rtol=1e-11)
    own = closed_forms.layer_force(h, closed_forms.cone(60.0), None, E, nu)
    np.testing.assert_allclose(own, closed_forms.sneddon_cone(h, 60.0, E, nu), rtol=1e-11)
    own = closed_forms.layer_force(h, closed_forms.flat(2.0), None, E, nu)
    np.testing.assert_allclose(own, closed_forms.sneddon_flat(h, 2.0, E, nu), rtol=1e-11)
    depth, force = closed_forms.sneddon_sphere(np.array([0.3, 1.0, 2.5]), R, E, nu)
    np.testing.assert_allclose(closed_forms.layer_force(depth, closed_forms.ball(R), None, E, nu), force, rtol=1e-10)


@pytest.mark.parametrize("base", ["bonded", "slip"])
def test_depth_is_inverted(base):
    # error of the polynomials over the contact radius: a tip or a fillet has a jump of curvature in it
    for profile, most, error in (
        (closed_forms.ball(R), 2.0, 1e-9),
        (closed_forms.cone(60.0, 0.2), 2.0, 1e-4),
        (closed_forms.rounded_flat(2.0, 0.4), 1.95, 1e-4),
    ):
        a = np.linspace(0.81, 1.0, 7) * most
        depth, reduced = closed_forms.layer_contact(a, profile, 4.0, 0.48, base)
        own = closed_forms.layer_force(depth, profile, 4.0, E, 0.48, base)
        np.testing.assert_allclose(own, reduced * E / (1 - 0.48**2), rtol=error)


def test_a_small_fillet_or_tip_is_a_sharp_one():
    h = np.array([0.5, 1.0])
    sharp = closed_forms.layer_force(h, closed_forms.flat(2.0), 5.0, E, 0.45)
    for rho in (0.1, 0.01):
        rounded = closed_forms.layer_force(h, closed_forms.rounded_flat(2.0, rho), 5.0, E, 0.45)
        assert np.all((rounded < sharp) & (rounded > sharp * (1 - 0.5 * rho)))
    sharp = closed_forms.layer_force(h, closed_forms.cone(60.0), 5.0, E, 0.45)
    blunt = closed_forms.layer_force(h, closed_forms.cone(60.0, 0.01), 5.0, E, 0.45)
    assert np.all((blunt > sharp) & (blunt < 1.02 * sharp))  # the rounded cone is fatter at the same depth


def test_thinner_is_stiffer_and_sliding_softer():
    h = np.array([0.1, 0.5, 1.0])
    for profile in (closed_forms.ball(R), closed_forms.flat(2.0), closed_forms.cone(60.0)):
        by = {
            b: [closed_forms.layer_force(h, profile, t, E, 0.48, b) for t in (2, 4, 8, 1e4)] for b in ("bonded", "slip")
        }
        for rows in by.values():
            assert np.all(np.diff(rows, axis=0) < 0)
        assert np.all(np.array(by["bonded"][:3]) > np.array(by["slip"][:3]))
        np.testing.assert_allclose(by["bonded"][3], closed_forms.layer_force(h, profile, None, E, 0.48), rtol=1e-3)


@pytest.mark.parametrize(
    "base, nu, t, near", [("bonded", 0.3, 0.02, 1e-3), ("slip", 0.5, 0.05, 1e-3), ("bonded", 0.5, 0.02, 0.03)]
)
def test_thin_layers_are_confined(base, nu, t, near):
    h, big = 0.3 * t, 20.0
    exact = closed_forms.layer_force(np.array([h]), closed_forms.paraboloid(big), t, E, nu, base)[0]
    assert closed_forms.confined_ball(h, big, t, E, nu, base) == pytest.approx(exact, rel=near)
    thick = closed_forms.layer_force(np.array([h]), closed_forms.paraboloid(big), 200 * t, E, nu, base)[0]
    assert closed_forms.confined_ball(h, big, t, E, nu, base) > 3 * thick


# -------------------------------------------------------------------------------------------- approximations


@pytest.mark.parametrize(
    "shape, profile, size",
    [
        ("ball", closed_forms.paraboloid(R), R),
        ("flat", closed_forms.flat(1.0), 1.0),
        ("cone", closed_forms.cone(60.0), 60.0),
    ],
)
def test_garcia_against_the_integral_equation(shape, profile, size):
    for t in (8.0, 3.0):
        h = np.array([0.02, 0.2, 0.5])
        exact = closed_forms.layer_force(h, profile, t, E, 0.5)
        np.testing.assert_allclose(closed_forms.garcia(shape, h, size, t, E), exact, rtol=4e-3)  # their first terms


def test_dimitriadis_is_good_for_small_contacts_alone():
    t, x = 6.0, np.array([0.05, 0.2, 1.0])
    h = (x * t) ** 2 / R
    off = (
        closed_forms.dimitriadis(h, R, t, E, 0.5) / closed_forms.layer_force(h, closed_forms.paraboloid(R), t, E, 0.5)
        - 1
    )
    assert abs(off[0]) < 1e-3 and abs(off[1]) < 0.02  # 0.005 of it is the fit of α, the rest the missing 1/6 of χ²
    assert -0.4 < off[2] < -0.2
    slip = closed_forms.dimitriadis(h[:2], R, t, E, 0.5, "slip")
    exact = closed_forms.layer_force(h[:2], closed_forms.paraboloid(R), t, E, 0.5, "slip")
    assert np.all(slip > exact)  # what they call not bonded is not free of friction
    assert np.all(slip < closed_forms.dimitriadis(h[:2], R, t, E, 0.5))


def reference(name):
    case = TABLE[name]
    return np.array(case["depth"]), np.array(case["force"]), case


@pytest.mark.parametrize("ratio", [2.0, 1.0, 0.7])
def test_long_against_finite_elements(ratio):
    h, F, case = reference(f"slab_{ratio:g}_bonded_K1e4")
    own = closed_forms.long_ball(h, R, ratio * R, 3 * case["mu"])
    np.testing.assert_allclose(own, F, rtol=0.03)  # they claim a few per cent for the fit
    assert np.all(abs(closed_forms.hertz_force(h, R, 3 * case["mu"], 0.5) / F - 1) > 0.15)


def test_integral_equation_against_finite_elements():
    for name, case in TABLE.items():
        if case["indenter"][0] != "ball" or not name.startswith("slab"):
            continue
        young = closed_forms.youngs_modulus(case["mu"], 2 / case["D1"])
        nu = closed_forms.poisson_ratio(case["mu"], 2 / case["D1"])
        h, F = case["depth"][0], case["force"][0]
        own = closed_forms.layer_force(np.array([h]), closed_forms.ball(R), case["height"], young, nu, case["base"])[0]
        assert own == pytest.approx(F, rel=0.15 * h / R)  # large strain: it softens by about that
        if case["height"] > 2 * R:
            continue  # bonded or not is a smaller matter there than large strain
        wrong = {"bonded": "slip", "slip": "bonded"}[case["base"]]
        other = closed_forms.layer_force(np.array([h]), closed_forms.ball(R), case["height"], young, nu, wrong)[0]
        assert abs(other / F - 1) > abs(own / F - 1)


def test_neo_hookean_half_space_against_finite_elements():
    h, F, case = reference("half_space_D5.8")
    nu = closed_forms.poisson_ratio(case["mu"], 2 / case["D1"])
    young = closed_forms.youngs_modulus(case["mu"], 2 / case["D1"]) / (1 - nu**2) * 0.75  # as far as Hertz knows
    shallow = h <= R
    own = closed_forms.neo_hookean_ball(h[shallow], R, young)
    np.testing.assert_allclose(own, F[shallow], rtol=0.02)  # a fit, and ν = 0.486
    assert abs(closed_forms.hertz_force(R, R, young, 0.5) / F[shallow][-1] - 1) > 0.1


# -------------------------------------------------------------------------------------------------- compression


def test_compressible_cylinder_has_the_least_energy():
    mu, D1, C20 = 0.01, 5.8, 0.02

    def energy(axial, lateral):
        J = axial * lateral**2
        growth = J ** (-2 / 3) * (axial**2 + 2 * lateral**2) - 3
        return mu / 2 * growth + C20 * growth**2 + (J - 1) ** 2 / D1

    x, d = np.array([0.6, 0.9, 1.3]), 1e-4
    P, J = closed_forms.nominal_compressible(x, lambda y: closed_forms.nominal_yeoh("uniaxial", y, mu, C20, 0.0), D1)
    for stretch, stress, volume in zip(x, P, J, strict=True):
        best = [
            minimize_scalar(lambda q, s=s: energy(s, q), bounds=(0.5, 1.6), method="bounded", options={"xatol": 1e-10})
            for s in (stretch - d, stretch, stretch + d)
        ]
        assert stress == pytest.approx((best[2].fun - best[0].fun) / (2 * d), rel=1e-6)
        assert volume == pytest.approx(stretch * best[1].x ** 2, rel=1e-6)


def test_compressible_cylinder_in_its_limits():
    mu = 0.01
    law = lambda y: closed_forms.nominal_neo_hooke("uniaxial", y, mu)  # noqa: E731
    P, J = closed_forms.nominal_compressible(np.array([0.7, 1.4]), law, 1e-6)
    np.testing.assert_allclose(P, law(np.array([0.7, 1.4])), rtol=1e-6)
    np.testing.assert_allclose(J, 1.0, atol=1e-7)
    P, _ = closed_forms.nominal_compressible(np.array([1 - 1e-5]), law, 5.8)
    assert P[0] == pytest.approx(-1e-5 * closed_forms.youngs_modulus(mu, 2 / 5.8), rel=1e-4)


@pytest.mark.parametrize("nu", [0.2, 0.45, 0.49])
@pytest.mark.parametrize("S", [0.25, 1.0, 4.0])
def test_bonded_puck_by_finite_elements(S, nu):
    H = 1.0
    radius = 2 * S * H
    r = radius * np.sin(0.5 * np.pi * np.linspace(0, 1, 25))
    z = 0.5 * H * (1 - np.cos(np.pi * np.linspace(0, 1, 15)))
    F = pressed(r, z, nu, "bonded", radius, lambda x: np.full_like(x, 1e-4), hold=True)
    assert closed_forms.bonded_puck(1e-4, radius, H, 1.0, nu) == pytest.approx(F, rel=0.03 if S >= 0.5 else 0.06)
    lindley = closed_forms.gent_lindley(1e-4, radius, H, 1.0, nu) / F - 1
    assert (abs(lindley) < 0.12) if nu == 0.49 else (abs(lindley) > 0.03)  # it is for nearly incompressible ones
    assert F > 1.01 * np.pi * radius**2 * 1e-4 / H


def test_bonded_puck_in_its_limits():
    a, b = (closed_forms.bonded_puck(0.1, 5.0, 1.0, E, nu) for nu in (0.5, 0.5 - 1e-7))
    assert a == pytest.approx(b, rel=1e-4)
    assert a == pytest.approx(closed_forms.gent_lindley(1e-9, 5.0, 1.0, E) * 1e8, rel=1e-6)
    wide, tall = (closed_forms.bonded_puck(0.1, x, 1.0, E, 0.4) / (np.pi * x**2 * 0.1) for x in (1e4, 1e-3))
    assert wide == pytest.approx(E * 0.6 / (1.4 * 0.2), rel=1e-3) and tall == pytest.approx(E, rel=1e-3)


# ------------------------------------------------------------------------------------------------ what applies


def test_formulas_of_a_ball_on_a_slab():
    found = closed_forms.formulas("sphere", E, 0.4995, radius=R, thickness=2 * R)
    names = [f.name for f in found]
    assert names[0] == "Hertz" and names[-1].startswith("Hayes") and len(set(names)) == len(names)
    by = {f.name: f for f in found}
    h = np.array([0.1, 0.3])
    for f in found:
        assert np.all(np.isfinite(f.force(h))) and f.force(h).shape == h.shape
    assert "base adds" in by["Hertz"].valid(0.1)
    assert by[names[-1]].valid(0.1) is None and "small" in by[names[-1]].valid(1.5)
    assert by["Long et al., neo-Hookean layer"].valid(1.5) is None
    assert "Long et al., neo-Hookean layer" not in [
        f.name for f in closed_forms.formulas("sphere", E, 0.4, radius=R, thickness=6.0)
    ]
    # where two say that they hold, they agree
    valid = [f for f in found if f.valid(0.2) is None]
    forces = [float(f.force(np.array([0.2]))[0]) for f in valid]
    assert len(valid) >= 3 and max(forces) / min(forces) < 1.05


@pytest.mark.parametrize(
    "shape, sizes", [("sphere", {"radius": R}), ("flat", {"radius": 2.0}), ("cone", {"half_angle": 60.0})]
)
def test_hertz_is_enough_for_a_thick_specimen(shape, sizes):
    for t in (None, 1e4):
        simple, *_, exact = closed_forms.formulas(shape, E, 0.45, thickness=t, **sizes)
        assert simple.valid(0.05) is None and exact.valid(0.05) is None
        assert simple.force(np.array([0.05])) == pytest.approx(exact.force(np.array([0.05])), rel=0.01)
    assert closed_forms.formulas(shape, E, 0.45, thickness=3.0, **sizes)[0].valid(0.05) is not None or shape == "cone"


def test_formulas_refuse_what_they_do_not_know():
    with pytest.raises(ValueError, match='"pyramid"'):
        closed_forms.formulas("pyramid", E, 0.5)
    with pytest.raises(ValueError, match='"glued"'):
        closed_forms.formulas("sphere", E, 0.5, radius=R, base="glued")


def test_too_thin_for_hertz():
    factor = closed_forms.thickness_factor(np.array([0.0, 0.01, 0.1]), 2.0, 0.5)
    assert factor[0] == 1.0 and np.all(np.diff(factor) > 0)
    # first term of the series: 1 + (2/π) ∫(1 − L) dk √(h/R) R/t, the integral by another quadrature
    first = 2 / np.pi * quad(lambda k: 1 - float(layer.layer_compliance(np.array([k]), 0.5, "bonded")[0]), 1e-9, 40)[0]
    x = 1e-4**0.5 / 2
    small = closed_forms.thickness_factor(np.array([1e-4]), 2.0, 0.5)[0]
    assert small - 1 - first * x == pytest.approx(7 / 6 * (first * x) ** 2, rel=0.05)
