"""Stress and tangent against an oracle of its own: the energy as a function of C, differentiated by complex step."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from fem_backend import closed_forms
from fem_backend.laws import Derivatives, Fibre, LinearElastic, Material, MooneyRivlin, NeoHooke, Ogden, Yeoh
from fem_backend.materials import stress

PAIRS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


@dataclass(frozen=True)
class Polynomial:
    """W = Σ c_ij (Ī₁ − 3)^i (Ī₂ − 3)^j + (J − 1)²/D₁ + d (J − 1)⁴ with i + j ≤ 2: every derivative is alive."""

    c10: float = 0.003
    c01: float = 0.002
    c20: float = 0.0007
    c11: float = 0.0011
    c02: float = 0.0005
    D1: float = 5.8
    d: float = 0.05
    small_strain = False
    principal = False

    @property
    def shear_modulus(self):
        return 2.0 * (self.c10 + self.c01)

    @property
    def bulk_modulus(self):
        return 2.0 / self.D1

    def energy(self, i1, i2, J):
        x, y, v = i1 - 3.0, i2 - 3.0, J - 1.0
        shape = self.c10 * x + self.c01 * y + self.c20 * x**2 + self.c11 * x * y + self.c02 * y**2
        return shape + v**2 / self.D1 + self.d * v**4

    def derivatives(self, i1, i2, J):
        x, y, v, one = i1 - 3.0, i2 - 3.0, J - 1.0, np.ones_like(J)
        return Derivatives(
            self.c10 + 2 * self.c20 * x + self.c11 * y,
            self.c01 + self.c11 * x + 2 * self.c02 * y,
            2 * self.c20 * one,
            self.c11 * one,
            2 * self.c02 * one,
            2 * v / self.D1 + 4 * self.d * v**3,
            2 / self.D1 + 12 * self.d * v**2,
        )


FIBRE = Fibre(0.004, 0.9, (1.0, 2.0, -0.5))
OGDEN = Ogden(0.01, 5.8, (1.3, 5.0, -2.0), (0.5, 0.2, 0.3))
LAWS = {
    "neo_hooke": NeoHooke(0.01, 5.8),
    "mooney_rivlin": MooneyRivlin(0.01, 5.8, 0.0013),
    "yeoh": Yeoh(0.01, 5.8, -0.0004, 0.0003),
    "ogden": OGDEN,
    "every_derivative": Polynomial(),
    "neo_hooke_fibre": Material(NeoHooke(0.01, 5.8), FIBRE),
    "ogden_fibre": Material(OGDEN, FIBRE),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
SHAPED = {k: v for k, v in LAWS.items() if "fibre" not in k}  # a fibre has no tangent at rest: it pulls or not


def gradients(count: int = 4, size: float = 0.25, seed: int = 0) -> np.ndarray:
    """Displacement gradients (1, count, 3, 3) with J well above 0."""
    H = size * np.random.default_rng(seed).normal(size=(1, count, 3, 3))
    assert np.linalg.det(H + np.eye(3)).min() > 0.2
    return H


def energy_of_C(law, C: np.ndarray) -> complex:
    """W from C (3, 3), written once more from the definitions of Ī₁, Ī₂, Ī₄, J; analytic, so C may be complex."""
    J2 = np.einsum("ijk,i,j,k->", LEVI_CIVITA, C[0], C[1], C[2])
    isochoric = C * J2 ** (-1 / 3)
    if isinstance(law, Material):
        a = np.array(law.fibre.direction) / np.linalg.norm(law.fibre.direction)
        stretched = np.einsum("i,ij,j->", a, isochoric, a) - 1.0
        pulls = law.fibre.k1 / (2 * law.fibre.k2) * (np.exp(law.fibre.k2 * stretched**2) - 1.0)
        return energy_of_C(law.law, C) + (pulls if stretched.real > 0.0 else 0.0)
    if isinstance(law, Ogden):
        powers = sum(
            2 * s * law.mu / p**2 * (trace_of_power(isochoric, p / 2) - 3.0)
            for p, s in zip(law.alpha, law.share, strict=True)
        )
        return powers + (np.sqrt(J2) - 1.0) ** 2 / law.D1
    trace = np.einsum("ii->", C)
    second = 0.5 * (trace**2 - np.einsum("ij,ji->", C, C))
    return law.energy(trace * J2 ** (-1 / 3), second * J2 ** (-2 / 3), np.sqrt(J2))


def trace_of_power(C: np.ndarray, p: float) -> complex:
    """tr Cᵖ by the binomial series about c I, the same for every c: equal eigenvalues are nothing special."""
    c = np.linalg.eigvalsh(C.real)[[0, 2]].mean()  # converges as ((λ₃ − λ₁)/(λ₃ + λ₁))ᵏ
    X, term, total, k = C / c - np.eye(3), np.eye(3), 3.0, 0
    while np.abs(term).max() > 1e-18:
        k += 1
        term = term @ X * ((p - k + 1) / k)
        total = total + term[0, 0] + term[1, 1] + term[2, 2]
    return total * c**p


LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    LEVI_CIVITA[_i, _j, _k], LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0


def unit_strain(k: int) -> np.ndarray:
    """dC (3, 3) for a unit of the k-th Voigt strain (doubled shear): C = 1 + 2E."""
    dC = np.zeros((3, 3))
    i, j = PAIRS[k]
    dC[i, j] += 1.0
    dC[j, i] += 1.0
    return dC


def stress_of_C(law, C: np.ndarray) -> np.ndarray:
    h = 1e-30
    return np.array([energy_of_C(law, C + 1j * h * unit_strain(k)).imag / h for k in range(6)])


@every_law
def test_stress_is_the_derivative_of_the_energy(law):
    H = gradients()
    at = stress.evaluate_stress(law, H, tangent=True)
    for q in range(H.shape[1]):
        F = H[0, q] + np.eye(3)
        np.testing.assert_allclose(at.F[0, q], F, rtol=1e-15)
        # the complex step is exact: round-off of terms of the size K
        np.testing.assert_allclose(at.S[0, q], stress_of_C(law, F.T @ F), rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(at.energy[0, q], energy_of_C(law, F.T @ F), rtol=1e-11)


@every_law
def test_tangent_is_the_derivative_of_the_stress(law):
    H, h = gradients(), 1e-5
    at = stress.evaluate_stress(law, H, tangent=True)
    for q in range(H.shape[1]):
        F = H[0, q] + np.eye(3)
        C = F.T @ F
        columns = [
            (stress_of_C(law, C + h * unit_strain(k)) - stress_of_C(law, C - h * unit_strain(k))) / (2 * h)
            for k in range(6)
        ]
        # central difference: h² = 1e-10 times fourth derivatives of order 10 to 100 of the size of C
        scale = np.abs(at.C[0, q]).max()
        np.testing.assert_allclose(at.C[0, q], np.array(columns).T, rtol=0, atol=1e-7 * scale)
        np.testing.assert_array_equal(at.C[0, q], at.C[0, q].T)


@every_law
def test_rotation_of_the_body_changes_nothing(law):
    H = gradients()
    Q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    Q *= np.linalg.det(Q)
    turned = np.einsum("ij,mqjk->mqik", Q, H + np.eye(3)) - np.eye(3)
    a, b = stress.evaluate_stress(law, H, True), stress.evaluate_stress(law, turned, True)
    for one, other in ((a.S, b.S), (a.C, b.C), (a.energy, b.energy)):  # round-off relative to the size of K
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)
    mirrored = np.einsum("ij,mqjk->mqik", Q * [1, 1, 1.1], H + np.eye(3)) - np.eye(3)  # negative control: no rotation
    assert np.abs(stress.evaluate_stress(law, mirrored, True).S - a.S).max() > 1e-3 * np.abs(a.S).max()


@pytest.mark.parametrize("law", [*SHAPED.values(), LinearElastic(0.01, 5.8)], ids=[*SHAPED, "linear_elastic"])
def test_at_rest(law):
    """No stress, no energy, and the small-strain moduli λ + 2μ, λ, μ."""
    at = stress.evaluate_stress(law, np.zeros((2, 3, 3, 3)), tangent=True)
    assert np.abs(at.S).max() < 1e-17 and np.abs(at.energy).max() < 1e-17
    mu, lam = law.shear_modulus, law.bulk_modulus - 2 / 3 * law.shear_modulus
    D = np.diag([2 * mu] * 3 + [mu] * 3)
    D[:3, :3] += lam
    np.testing.assert_allclose(at.C, np.broadcast_to(D, at.C.shape), rtol=1e-14, atol=1e-16)


@pytest.mark.parametrize("law", SHAPED.values(), ids=SHAPED)
def test_small_strains_become_linear_elasticity(law):
    """|S − σ_linear| = O(ε²): slope 2 over three decades."""
    linear = LinearElastic(law.shear_modulus, 2.0 / law.bulk_modulus)
    H, t = gradients(3), np.array([1e-2, 1e-3, 1e-4])
    error = [
        np.abs(stress.evaluate_stress(law, e * H, False).S - stress.evaluate_stress(linear, e * H, False).S).max()
        for e in t
    ]
    np.testing.assert_allclose(np.diff(np.log10(error)), -2.0, atol=0.1)


def test_linear_elastic_stress_and_energy():
    """σ = 2μ dev ε + K tr ε I from the tensor definition; only the symmetric part of ∇u counts."""
    law, H = LinearElastic(0.02, 3.0), gradients()
    at = stress.evaluate_stress(law, H, tangent=True)
    strain = 0.5 * (H + np.swapaxes(H, -1, -2))
    trace = np.einsum("mqii->mq", strain)[..., None, None] * np.eye(3)
    sigma = 2 * 0.02 * (strain - trace / 3) + 2 / 3.0 * trace
    voigt = np.stack([sigma[..., i, j] for i, j in PAIRS], -1)
    np.testing.assert_allclose(at.S, voigt, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(at.energy, 0.5 * np.einsum("mqij,mqij->mq", sigma, strain), rtol=1e-13)
    assert np.all(at.S_geometric == 0.0) and np.all(at.F == np.eye(3))


@pytest.mark.parametrize("stretch", [0.5, 0.8, 1.3, 2.0])
def test_uniaxial_stretch_of_a_nearly_incompressible_body(stretch):
    """P = μ(λ − λ⁻²) for J = 1; with K/μ = 2e6 the difference is of the order μ/K."""
    law = NeoHooke(mu=0.01, D1=1e-4)

    def at(side: float) -> np.ndarray:
        H = np.diag([stretch - 1.0, side - 1.0, side - 1.0])[None, None]
        return stress.evaluate_stress(law, H, tangent=False).S[0, 0]

    side = brentq(lambda s: at(s)[1], 0.99 / np.sqrt(stretch), 1.01 / np.sqrt(stretch), xtol=1e-15, rtol=1e-14)
    nominal = stretch * at(side)[0]
    np.testing.assert_allclose(nominal, 0.01 * (stretch - stretch**-2), rtol=2e-5)


def test_inverted_points_are_refused_and_counted():
    H = np.zeros((2, 3, 3, 3))
    H[0, 1] = np.diag([-2.0, 0.0, 0.0])
    H[1, 2] = np.diag([-1.0, 0.0, 0.0])  # flat: J = 0
    with pytest.raises(stress.Inverted, match="2 quadrature points"):
        stress.evaluate_stress(NeoHooke(0.01, 5.8), H, tangent=True)
    H[0, 0] = np.nan
    with pytest.raises(stress.Inverted, match="3 quadrature points"):
        stress.evaluate_stress(NeoHooke(0.01, 5.8), H, tangent=True)


def test_energies_that_overflow_are_refused():
    law = Material(NeoHooke(0.01, 5.8), Fibre(0.01, 50.0, (1, 0, 0)))
    H = np.zeros((1, 2, 3, 3))
    H[0, 1] = np.diag([2.0, -0.4, -0.4])
    with pytest.raises(stress.Inverted, match="1 quadrature points have no finite energy"):
        stress.evaluate_stress(law, H, tangent=True)


# ------------------------------------------------------------------------------------ principal directions


def with_eigenvalues(stretch: np.ndarray, seed: int = 5) -> np.ndarray:
    """Displacement gradient (1, 1, 3, 3) with these principal stretches in skew directions."""
    Q, R = (np.linalg.qr(np.random.default_rng(seed + k).normal(size=(3, 3)))[0] for k in range(2))
    R *= np.linalg.det(R) * np.linalg.det(Q)
    return (R @ Q @ np.diag(stretch) @ Q.T - np.eye(3))[None, None]


@dataclass(frozen=True)
class PowerSums:
    """Ogden with α = 4, 6, −2 through the invariants: Σλ̄⁴ = Ī₁² − 2Ī₂, Σλ̄⁶ = Ī₁³ − 3Ī₁Ī₂ + 3, Σλ̄⁻² = Ī₂ (Newton)."""

    a: float = 2 * 0.004 / 16
    b: float = 2 * 0.003 / 36
    c: float = 2 * 0.003 / 4
    D1: float = 5.8
    small_strain = False
    principal = False
    shear_modulus = 0.01
    bulk_modulus = 2 / 5.8

    def energy(self, i1, i2, J):
        fourth, sixth = i1**2 - 2 * i2 - 3, i1**3 - 3 * i1 * i2
        return self.a * fourth + self.b * sixth + self.c * (i2 - 3) + (J - 1) ** 2 / self.D1

    def derivatives(self, i1, i2, J):
        one = np.ones_like(J)
        return Derivatives(
            2 * self.a * i1 + self.b * (3 * i1**2 - 3 * i2),
            -2 * self.a - 3 * self.b * i1 + self.c,
            2 * self.a + 6 * self.b * i1,
            -3 * self.b * one,
            0 * one,
            2 * (J - 1) / self.D1,
            2 / self.D1 * one,
        )


@pytest.mark.parametrize("base", [[1.0, 1.0, 1.0], [1.2, 1.2, 0.7], [0.8, 1.3, 0.8], [0.6, 1.0, 1.7]])
@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-6, 1e-4, 1e-2])
def test_equal_and_nearly_equal_stretches(base, gap):
    """No loss of digits however near two or three stretches are: an even Ogden law is one of the invariants."""
    H = with_eigenvalues(np.array(base) * (1 + gap * np.array([1.0, -0.3, 0.6])))
    ogden = Ogden(0.01, 5.8, (4.0, 6.0, -2.0), (0.4, 0.3, 0.3))
    one, other = (stress.evaluate_stress(law, H, tangent=True) for law in (ogden, PowerSums()))
    # round-off of terms of the size K = 0.34 MPa times the conditioning of J^(-2/3), a few units in the 15th digit
    np.testing.assert_allclose(one.S, other.S, rtol=0, atol=5e-15)
    np.testing.assert_allclose(one.C, other.C, rtol=0, atol=2e-14)
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-11, atol=1e-16)


@pytest.mark.parametrize("alpha", [0.0, 1e-9, 1e-6, 1e-3, 0.1])
def test_a_small_exponent_is_hencky(alpha):
    """W = μ Σ ln²λ̄ + O(α), S = 2μ Σ ln λ̄ₐ/λₐ² Nₐ⊗Nₐ + O(α), and ℂ the difference of S; nothing breaks at α = 0."""
    stretch = np.array([0.7, 1.05, 1.3])
    H = with_eigenvalues(stretch)
    law = Ogden(0.01, 1e9, (alpha,), (1.0,))
    at, e = stress.evaluate_stress(law, H, True), np.log(stretch) - np.log(stretch).mean()
    size, N = np.linalg.eigh((H[0, 0] + np.eye(3)).T @ (H[0, 0] + np.eye(3)))
    S = N @ np.diag(2 * 0.01 * e / size) @ N.T
    np.testing.assert_allclose(at.energy, 0.01 * (e**2).sum(), rtol=0.1 * alpha + 1e-8)  # 1/D₁ = 1e-9 MPa is left
    np.testing.assert_allclose(at.S[0, 0], [S[i, j] for i, j in PAIRS], rtol=0, atol=0.01 * alpha + 1e-9)
    dH, h = gradients(1)[:, :1], 1e-6
    F, dF = H[0, 0] + np.eye(3), dH[0, 0]
    rate = 0.5 * (dF.T @ F + F.T @ dF)
    dE = np.array([rate[i, j] * (1 if i == j else 2) for i, j in PAIRS])
    difference = (stress.evaluate_stress(law, H + h * dH, False).S - stress.evaluate_stress(law, H - h * dH, False).S)[
        0, 0
    ] / (2 * h)
    np.testing.assert_allclose(at.C[0, 0] @ dE, difference, rtol=0, atol=1e-10)  # h² and round-off/h, of 0.01


def test_energies_of_small_strains_keep_their_digits():
    """W → μ ε:ε of the deviator at strains of 1e-7, where 3 − 3 has no digit left."""
    e = 1e-7 * np.array([1.0, 0.2, -1.2])
    at = stress.evaluate_stress(Ogden(0.01, 1e9, (3.0, -2.0), (0.5, 0.5)), np.diag(np.expm1(e))[None, None], False)
    np.testing.assert_allclose(at.energy, 0.01 * (e**2).sum(), rtol=1e-6)  # rounding of F, and ε itself


# --------------------------------------------------------------------------------------------- nested laws


@pytest.mark.parametrize(
    ("law", "limit"),
    [
        (MooneyRivlin(0.01, 5.8, 0.0), NeoHooke(0.01, 5.8)),
        (Yeoh(0.01, 5.8, 0.0, 0.0), NeoHooke(0.01, 5.8)),
        (Ogden(0.01, 5.8, (2.0,), (1.0,)), NeoHooke(0.01, 5.8)),
        (Ogden(0.01, 5.8, (2.0, 5.0), (1.0, 0.0)), NeoHooke(0.01, 5.8)),
        (Ogden(0.01, 5.8, (2.0, -2.0), (0.6, 0.4)), MooneyRivlin(0.01, 5.8, 0.4 * 0.01 / 2)),
        (Material(NeoHooke(0.01, 5.8), Fibre(0.0, 3.0, (1, 1, 0))), NeoHooke(0.01, 5.8)),
        (Material(OGDEN, Fibre(0.004, 0.0, (1, 1, 0))), Material(OGDEN, Fibre(0.004, 1e-15, (2, 2, 0)))),
    ],
    ids=["mooney_rivlin", "yeoh", "ogden", "ogden_share", "ogden_mooney", "fibre_k1", "fibre_k2"],
)
def test_a_law_at_neutral_is_the_simpler_law(law, limit):
    """To round-off of terms of the size K = 0.34 MPa."""
    H = gradients(60, 0.2)
    one, other = stress.evaluate_stress(law, H, True), stress.evaluate_stress(limit, H, True)
    np.testing.assert_allclose(one.S, other.S, rtol=0, atol=3e-15)
    np.testing.assert_allclose(one.C, other.C, rtol=0, atol=2e-14)
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-12, atol=1e-16)


# ------------------------------------------------------------------------------------------- closed forms

CLOSED = {
    "neo_hooke": (NeoHooke(0.01, 5.8), lambda test, x: closed_forms.nominal_neo_hooke(test, x, 0.01)),
    "mooney_rivlin": (
        MooneyRivlin(0.01, 5.8, 0.0013),
        lambda test, x: closed_forms.nominal_mooney_rivlin(test, x, 0.01, 0.0013),
    ),
    "yeoh": (
        Yeoh(0.01, 5.8, -0.0004, 0.0003),
        lambda test, x: closed_forms.nominal_yeoh(test, x, 0.01, -0.0004, 0.0003),
    ),
    "ogden": (OGDEN, lambda test, x: closed_forms.nominal_ogden(test, x, 0.01, (1.3, 5.0, -2.0), (0.5, 0.2, 0.3))),
    "fibre": (
        Material(NeoHooke(0.01, 5.8), Fibre(0.003, 0.2, (3, 0, 0))),
        lambda test, x: closed_forms.nominal_neo_hooke(test, x, 0.01) + closed_forms.nominal_fibre(x, 0.003, 0.2),
    ),
}


@pytest.mark.parametrize("test", closed_forms.SIDE_EXPONENT)
@pytest.mark.parametrize(("law", "closed"), CLOSED.values(), ids=CLOSED)
def test_homogeneous_tests(law, closed, test):
    """P₁ = (σ₁ − σ₃)/λ₁ at J = 1: the pressure of the incompressible body is what frees the third face."""
    x = np.array([0.5, 0.8, 0.99, 1.0, 1.3, 2.0, 2.6])
    stretch = {"uniaxial": [x, x**-0.5, x**-0.5], "planar": [x, x**0, 1 / x], "equibiaxial": [x, x, x**-2]}[test]
    H = np.stack(stretch, -1)[None, :, :, None] * np.eye(3) - np.eye(3)
    S = stress.evaluate_stress(law, H, tangent=False).S[0]
    P = (S[:, 0] * x**2 - S[:, 2] * stretch[2] ** 2) / x
    np.testing.assert_allclose(P, closed(test, x), rtol=1e-12, atol=1e-15)  # round-off of J = 1 times K


# ------------------------------------------------------------------------------------------------- scale


@every_law
def test_scale_multiplies_every_modulus(law):
    H, scale = gradients(), np.array([[1.0, 2.0, 0.25, 8.0]])
    plain, scaled = stress.evaluate_stress(law, H, True), stress.evaluate_stress(law, H, True, scale=scale)
    for one, other in ((plain.S, scaled.S), (plain.C, scaled.C), (plain.energy, scaled.energy)):
        # powers of two: not a bit changes
        np.testing.assert_array_equal(one * scale.reshape(scale.shape + (1,) * (one.ndim - 2)), other)
