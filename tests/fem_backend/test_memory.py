"""Every law with every combination of fibre, Prony series and Mullins softening; then what memory means by itself."""

import dataclasses
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.integrate import quad

from fem_backend import closed_forms
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW
from fem_backend.laws import Fibre, LinearElastic, Material, MooneyRivlin, Mullins, NeoHooke, Ogden, Prony, Yeoh
from fem_backend.materials import stress

MU, D1 = 0.01, 5.8
SHAPE = (2, 3)  # elements, points
G, TAU = (0.2, 0.15, 0.1), (0.05, 0.6, 8.0)
BASE = {
    "neo_hooke": NeoHooke(MU, D1),
    "mooney_rivlin": MooneyRivlin(MU, D1, 0.0013),
    "yeoh": Yeoh(MU, D1, 0.0004, 0.0003),
    "ogden": Ogden(MU, D1, (1.3, 5.0, -2.0), (0.5, 0.2, 0.3)),
    "linear": LinearElastic(MU, D1),
}
FIBRE, PRONY, MULLINS = Fibre(0.004, 0.9, (1.0, 2.0, -0.5)), Prony(G, TAU), Mullins(0.45, 0.0004, 0.1)
MATERIALS = {
    "-".join([name, *(type(part).__name__.lower() for part in parts if part)]): Material(law, *parts)
    for (name, law), *parts in product(BASE.items(), (None, FIBRE), (None, PRONY), (None, MULLINS))
    if not (law.small_strain and any(parts))
}
MEMORY = {name: material for name, material in MATERIALS.items() if material.path_dependent}
every_material = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
every_memory = pytest.mark.parametrize("material", MEMORY.values(), ids=MEMORY)


def gradients(seed: int, size: float = 0.2) -> np.ndarray:
    return size * np.random.default_rng(seed).normal(size=(*SHAPE, 3, 3))


PAST = [(1.5 * gradients(0, 0.15), 0.3), (1.4 * gradients(0, 0.15) + gradients(1, 0.01), 0.2)]  # (H, Δt)


def lived(material: Material, past=PAST) -> stress.History | None:
    """History after some steps: loaded further than `gradients(0)`, so that softened points are among what follows."""
    history = None
    for H, dt in past:
        history = stress.evaluate_stress(material, H, False, history, dt).history
    return history


def strain(material: Material, H: np.ndarray) -> np.ndarray:
    """Green (or small) strain with doubled shears, (m, q, 6)."""
    product_ = 0.0 if material.small_strain else np.einsum("mqki,mqkj->mqij", H, H)
    E = 0.5 * (H + np.swapaxes(H, -1, -2) + product_)
    return np.stack([E[..., i, j] * (1 if i == j else 2) for i, j in zip(VOIGT_ROW, VOIGT_COLUMN, strict=True)], -1)


def rotations(seed: int) -> np.ndarray:
    Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(*SHAPE, 3, 3)))[0]
    return Q * np.linalg.det(Q)[..., None, None]


# ------------------------------------------------------------------------------------------- all combinations


@every_material
def test_potential_stress_and_tangent_belong_together(material, slopes):
    """With the history held, W(E + dE) = W + S:dE + O(2) and S(E + dE) = S + ℂ:dE + O(2), ℂ symmetric."""
    history, H, dH, steps = lived(material), gradients(0), gradients(7, 1.0), np.array([1e-2, 1e-3, 1e-4])

    def at(H, tangent=False):
        return stress.evaluate_stress(material, H, tangent, history, 0.4, scale=np.full(SHAPE, 1.7))

    here, energy, stresses = at(H, True), [], []
    np.testing.assert_allclose(here.C, np.swapaxes(here.C, -1, -2), rtol=1e-15, atol=1e-18)
    for h in steps:
        there, dE = at(H + h * dH), strain(material, H + h * dH) - strain(material, H)
        energy.append(np.abs(there.energy - here.energy - (here.S * dE).sum(-1)).max())
        stresses.append(np.abs(there.S - here.S - np.einsum("mqij,mqj->mqi", here.C, dE)).max())
    np.testing.assert_allclose(slopes(np.array(energy), steps), 2.0, atol=0.1)
    if material.small_strain and not material.mullins:
        assert max(stresses) < 1e-15  # linear: exact
    else:
        np.testing.assert_allclose(slopes(np.array(stresses), steps), 2.0, atol=0.2)


@every_material
def test_the_observer_may_turn(material):
    """Another rotation of the body at every step: S, ℂ, energy and history stay (the small-strain law left out)."""
    if material.small_strain:
        return
    turned = [(rotations(k) @ (H + np.eye(3)) - np.eye(3), dt) for k, (H, dt) in enumerate(PAST)]
    H, dt = gradients(0), 0.4
    one = stress.evaluate_stress(material, H, True, lived(material), dt)
    other = stress.evaluate_stress(
        material, rotations(9) @ (H + np.eye(3)) - np.eye(3), True, lived(material, turned), dt
    )
    for name in ("S", "C", "energy"):  # round-off of terms of the size K = 0.34 MPa
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-11, atol=1e-14)
    if material.path_dependent:
        for name in ("S_iso", "h", "W_max"):
            np.testing.assert_allclose(getattr(one.history, name), getattr(other.history, name), rtol=1e-11, atol=1e-14)


def scaled(material: Material, s: float) -> Material:
    """Every constant with the unit MPa times s."""
    units = {"mu": 1, "D1": -1, "C01": 1, "C20": 1, "C30": 1, "k1": 1, "m": 1}

    def part(thing):
        if thing is None:
            return None
        names = [f.name for f in dataclasses.fields(thing) if f.name in units]
        return dataclasses.replace(thing, **{n: getattr(thing, n) * s ** units[n] for n in names})

    return Material(*(part(getattr(material, f.name)) for f in dataclasses.fields(material)))


@every_material
def test_stresses_scale_with_the_moduli(material):
    """Similarity, and `scale` as the same thing with a history that is not scaled; s = 8, so bit for bit."""
    H, other, full = gradients(0), scaled(material, 8.0), np.full(SHAPE, 8.0)
    plain = stress.evaluate_stress(material, H, True, lived(material), 0.4)
    large = stress.evaluate_stress(other, H, True, lived(other), 0.4)
    again = stress.evaluate_stress(material, H, True, lived(material), 0.4, scale=full)
    for name in ("S", "S_geometric", "C", "energy"):
        np.testing.assert_array_equal(8.0 * getattr(plain, name), getattr(large, name))
        np.testing.assert_array_equal(8.0 * getattr(plain, name), getattr(again, name))
    if material.path_dependent:
        for name in ("S_iso", "h", "W_max"):
            np.testing.assert_array_equal(8.0 * getattr(plain.history, name), getattr(large.history, name))
            np.testing.assert_array_equal(getattr(plain.history, name), getattr(again.history, name))


@pytest.mark.parametrize("material", [m for m in MATERIALS.values() if not m.small_strain])
def test_without_effect_it_is_the_elastic_law(material):
    """g = 0 and 1/r = 0 with a history, and Prony in no time: the law (and fibre) alone, to round-off of K."""
    elastic = stress.evaluate_stress(Material(material.law, material.fibre), gradients(0), True)
    idle = dataclasses.replace(material, prony=Prony((0.0, 0.0), (1.0, 3.0)), mullins=Mullins(0.0, 0.001, 0.2))
    nothing = dataclasses.replace(material, prony=Prony((), ()), mullins=None)
    sudden = dataclasses.replace(material, mullins=None)
    for other, history in ((idle, lived(idle)), (nothing, lived(nothing)), (sudden, None)):
        at = stress.evaluate_stress(other, gradients(0), True, history, 0.0 if other is sudden else 0.4)
        for name in ("S", "C", "energy"):
            np.testing.assert_allclose(getattr(at, name), getattr(elastic, name), rtol=1e-13, atol=1e-15)


@every_memory
def test_a_history_is_not_written_to(material):
    history = lived(material)
    before = dataclasses.replace(history, **{k: v.copy() for k, v in vars(history).items()})
    new = stress.evaluate_stress(material, gradients(0), True, history, 0.4).history
    for name in ("S_iso", "h", "W_max"):
        np.testing.assert_array_equal(getattr(history, name), getattr(before, name))
        assert getattr(new, name).shape == getattr(history, name).shape
        assert getattr(stress.virgin(material, *SHAPE), name).shape == getattr(history, name).shape


@every_memory
def test_the_past_matters(material):
    """The step of the tests above relaxes or softens: what they say of memory is said of more than nothing."""
    old, young = (stress.evaluate_stress(material, gradients(0), False, h, 0.4) for h in (lived(material), None))
    assert np.abs(old.S - young.S).max() > 0.02 * np.abs(young.history.S_iso).max()
    if material.mullins and not material.prony:
        assert np.all(old.history.W_max >= young.history.W_max) and np.any(old.history.W_max > young.history.W_max)


@every_memory
def test_a_step_of_no_time_and_no_strain_changes_nothing(material):
    """The new history holds all of the state: S, and the history itself, are found again from it (round-off of K)."""
    at = stress.evaluate_stress(material, gradients(0), False, lived(material), 0.4)
    again = stress.evaluate_stress(material, gradients(0), False, at.history, 0.0)
    np.testing.assert_allclose(again.S, at.S, rtol=1e-13, atol=1e-16)
    for name in ("S_iso", "h", "W_max"):
        np.testing.assert_allclose(getattr(again.history, name), getattr(at.history, name), rtol=1e-12, atol=1e-17)


def test_elastic_materials_have_no_history():
    for thing in (BASE["neo_hooke"], Material(BASE["ogden"], FIBRE)):
        assert stress.virgin(thing, *SHAPE) is None
        assert stress.evaluate_stress(thing, gradients(0), True).history is None


# ------------------------------------------------------------------------------------------------------ Prony


def uniaxial(stretch: float) -> np.ndarray:
    """J = 1: no pressure, what is left of S is isochoric."""
    return np.broadcast_to(np.diag([stretch, stretch**-0.5, stretch**-0.5]) - np.eye(3), (1, 1, 3, 3))


def axial(stretch: float) -> float:
    """S₁₁ of the incompressible neo-Hookean body without pressure, μ(1 − I₁/(3λ²)), and its slope."""
    return MU * (1 - (stretch**2 + 2 / stretch) / (3 * stretch**2))


def axial_slope(stretch: float) -> float:
    return MU * 2 * stretch**-4


def ramp(material: Material, to: float, time: float, count: int) -> np.ndarray:
    """S₁₁ at the ends of equal steps of a ramp of the stretch."""
    history, found = None, []
    for stretch in np.linspace(1.0, to, count + 1)[1:]:
        at = stress.evaluate_stress(material, uniaxial(stretch), False, history, time / count)
        history = at.history
        found.append(at.S[0, 0, 0])
    return np.array(found)


VISCOUS = Material(NeoHooke(MU, D1), prony=PRONY)


def test_relaxation_after_a_sudden_stretch():
    """S(t) = g(t) S(0) at any instants: a constant strain is carried on exactly, however long the steps."""
    first = stress.evaluate_stress(VISCOUS, uniaxial(0.7), False, None, 0.0)
    np.testing.assert_allclose(first.S[0, 0, 0], axial(0.7), rtol=1e-12)
    history, t = first.history, 0.0
    for dt in (0.001, 0.03, 0.5, 2.0, 40.0):
        at = stress.evaluate_stress(VISCOUS, uniaxial(0.7), False, history, dt)
        history, t = at.history, t + dt
        np.testing.assert_allclose(at.S[0, 0, 0], axial(0.7) * closed_forms.relaxed_share(t, G, TAU), rtol=1e-12)


@pytest.mark.parametrize("to", [0.6, 1.5])
def test_a_ramp_is_the_convolution_integral(to, slopes):
    """S(T) = (1 − Σg) S + Σ gᵢ∫exp(−(T − t)/τᵢ) dS, by quadrature; the error is of second order in the step."""
    T = 1.0
    rate = (to - 1.0) / T
    exact = (1 - sum(G)) * axial(to) + sum(
        g * quad(lambda t, tau=tau: np.exp((t - T) / tau) * axial_slope(1 + rate * t) * rate, 0, T, epsabs=1e-14)[0]
        for g, tau in zip(G, TAU, strict=True)
    )
    count = np.array([64, 128, 256, 512])
    error = np.array([abs(ramp(VISCOUS, to, T, n)[-1] / exact - 1.0) for n in count])
    np.testing.assert_allclose(slopes(error, 1.0 / count), 2.0, atol=0.1)
    assert error[-1] < 1e-4
    assert abs(ramp(Material(NeoHooke(MU, D1)), to, T, 4)[-1] / exact - 1.0) > 0.05  # negative control: no relaxation


def test_very_fast_and_very_slow():
    """Instantaneous and long-term stress; the distance from the first is of first order in T/τ."""
    fast, slow = np.array([1e-4, 1e-5]), np.array([1e4, 1e5])
    short = np.array([ramp(VISCOUS, 0.7, T, 20)[-1] / axial(0.7) - 1.0 for T in fast])
    np.testing.assert_allclose(np.log10(short[0] / short[1]), 1.0, atol=0.05)
    assert np.abs(short).max() < 1e-3
    long = np.array([ramp(VISCOUS, 0.7, T, 20)[-1] / axial(0.7) / (1 - sum(G)) - 1.0 for T in slow])
    assert np.abs(long).max() < 1e-3


def test_terms_with_one_time_are_one_term():
    one = Material(NeoHooke(MU, D1), prony=Prony((0.3,), (0.7,)))
    three = Material(NeoHooke(MU, D1), prony=Prony((0.1, 0.15, 0.05), (0.7, 0.7, 0.7)))
    np.testing.assert_allclose(ramp(one, 0.6, 1.0, 9), ramp(three, 0.6, 1.0, 9), rtol=1e-13)


def test_the_volume_does_not_relax():
    H = np.broadcast_to(0.1 * np.eye(3), (1, 1, 3, 3))
    first = stress.evaluate_stress(VISCOUS, H, False)
    later = stress.evaluate_stress(VISCOUS, H, False, first.history, 100.0)
    np.testing.assert_allclose(first.S, later.S, rtol=1e-13, atol=1e-16)
    assert np.abs(first.S[..., :3]).min() > 0.01


def test_a_closed_cycle_costs_work():
    """∮ S:dE > 0, nearly nothing when very fast or very slow, most in between."""

    def work(time: float) -> float:
        history, total, old, E_old = None, 0.0, np.zeros(6), np.zeros(6)
        for stretch in 1.0 - 0.3 * np.sin(np.linspace(0.0, np.pi, 81))[1:]:
            at = stress.evaluate_stress(VISCOUS, uniaxial(stretch), False, history, time / 80)
            E = strain(VISCOUS, uniaxial(stretch))[0, 0]
            total += 0.5 * (at.S[0, 0] + old) @ (E - E_old)
            history, old, E_old = at.history, at.S[0, 0], E
        return total

    fast, middle, slow = work(1e-4), work(1.0), work(1e5)
    assert middle > 0.0 and abs(fast) < 0.02 * middle and abs(slow) < 0.02 * middle


# ---------------------------------------------------------------------------------------------------- Mullins


def travel(material: Material, stretches) -> tuple[np.ndarray, stress.History]:
    history, found = None, []
    for stretch in stretches:
        at = stress.evaluate_stress(material, uniaxial(stretch), False, history, 0.1)
        history = at.history
        found.append(at.S[0, 0, 0])
    return np.array(found), history


SOFT = Material(NeoHooke(MU, D1), mullins=MULLINS)


def energy(stretch: np.ndarray) -> np.ndarray:
    return MU / 2 * (stretch**2 + 2 / stretch - 3)


def test_primary_unloading_and_reloading_path():
    """Up: the elastic law. Down: η times it, by the formula. Up again: the path down, and beyond W_max the law."""
    up, down = np.linspace(1.0, 1.6, 13), np.linspace(1.6, 1.0, 13)
    further = np.linspace(1.65, 1.9, 6)
    S, history = travel(SOFT, [*up, *down[1:], *up[1:], *further])
    first, back, again, last = np.split(S, [13, 25, 37])
    np.testing.assert_allclose(first, axial(up), rtol=1e-12, atol=1e-15)
    eta = closed_forms.softening(energy(down[1:]), energy(1.6), MULLINS.r_inverse, MULLINS.m, MULLINS.beta)
    np.testing.assert_allclose(back, eta * axial(down[1:]), rtol=1e-11, atol=1e-15)
    assert np.all(back[:-1] < 0.999 * axial(down[1:-1]))  # softer on the way down
    np.testing.assert_allclose(again[:-1], back[-2::-1], rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(last, axial(further), rtol=1e-12)
    np.testing.assert_allclose(history.W_max, energy(1.9), rtol=1e-11)


def test_softening_of_the_way_down_does_not_depend_on_the_steps():
    coarse, _ = travel(SOFT, [1.6, 1.2])
    fine, _ = travel(SOFT, [*np.linspace(1.0, 1.6, 50), *np.linspace(1.6, 1.2, 50)])
    np.testing.assert_allclose(coarse[-1], fine[-1], rtol=1e-13)


def test_the_fibre_softens_too():
    pulled = Material(NeoHooke(MU, D1), Fibre(0.01, 0.5, (1, 0, 0)))
    both = dataclasses.replace(pulled, mullins=MULLINS)
    elastic, S = travel(pulled, [1.3])[0][-1], travel(both, [1.5, 1.3])[0][-1]
    fibre = lambda x: 0.01 / (2 * 0.5) * np.expm1(0.5 * (x**2 - 1) ** 2)  # noqa: E731
    W = [energy(x) + fibre(x) for x in (1.3, 1.5)]
    np.testing.assert_allclose(
        S, elastic * closed_forms.softening(*W, MULLINS.r_inverse, MULLINS.m, MULLINS.beta), rtol=1e-11
    )


def test_what_is_softened_relaxes():
    """Mullins first, then the convolution: after a long hold (1 − Σg) η S."""
    both = Material(NeoHooke(MU, D1), prony=PRONY, mullins=MULLINS)
    _, history = travel(both, [1.5, 1.3])
    at = stress.evaluate_stress(both, uniaxial(1.3), False, history, 1e4)
    soft = travel(SOFT, [1.5, 1.3])[0][-1]
    np.testing.assert_allclose(at.S[0, 0, 0], (1 - sum(G)) * soft, rtol=1e-11)


def test_potential_of_the_softened_path_is_continuous():
    """Φ and η where W passes W_max: no jump (the slope of η has one, as the law says)."""
    most = np.array([0.002])
    near = [MULLINS.soften(most * (1 + d), most) for d in (-1e-9, 0.0, 1e-9)]
    for one, other in pairwise(near):
        np.testing.assert_allclose(one[0], other[0], rtol=1e-8)
        np.testing.assert_allclose(one[2], other[2], rtol=1e-8)
    assert near[0][1] > 0.0 and near[1][1] == 0.0
