"""Pore flow beside theories that share nothing with it: consolidation in one dimension, both limits, similarity."""

from itertools import pairwise

import numpy as np
import pytest
from biphasic_layer import Layer, relaxation, stiffness, touching
from scipy.integrate import solve_ivp

from fem_backend.backend import BACKEND
from fem_backend.kinematics import axisymmetric, pore_pressure
from fem_backend.materials.permeability import HolmesMow
from rso.contract import Case, Programme, Segment, SimulationFailed

MU, NU = 0.01, 0.2
K = 2.0 * MU * (1.0 + NU) / (3.0 * (1.0 - 2.0 * NU))
D1 = 2.0 / K
AGGREGATE = K + 4.0 / 3.0 * MU  # modulus of confined compression, of the theory of small strains
HEIGHT, RADIUS = 2.0, 3.0
PUCK = {
    "specimen": {"shape": "cylinder", "radius": RADIUS, "height": HEIGHT},
    "indenter": {"shape": "plate", "contact": "slip"},
    "support": {"kind": "well", "base": "slip", "wall": "slip"},
    "material": {"law": "linear_elastic"},
}
SLAB = {
    "specimen": {"shape": "slab", "thickness": 6.0},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "coarse"},
}
FINER = {**SLAB, "mesh": {"level": "standard"}}
RESTS = (0.2, 2.0, 20.0)
HOLD = Programme((0.0, 0.1, 20.1), (0.0, 0.6, 0.6), (0.6,), tuple(0.1 + t for t in RESTS))


def forces(values, settings, programme=HOLD):
    return BACKEND({"mu": MU, "D1": D1, **values}, Case("a", programme, settings)).channels["Fz"]


def relaxed(tau: np.ndarray, ramp: float) -> np.ndarray:
    """σ h/(H_A d) of a layer drained at one side after a ramp of the time `ramp`; τ = D t/h² (Mow et al. 1980).

    Of the series 1 + 2 Σ exp(−n²π² τ) of a step, by Duhamel's integral.
    """
    n = np.arange(1, 400)[:, None] * np.pi

    def integral(t):
        t = np.maximum(t, 0.0)
        return t + 2.0 * ((1.0 - np.exp(-(n**2) * t)) / n**2).sum(0)

    return (integral(tau) - integral(tau - ramp)) / ramp


class TestConsolidation:
    """A puck in a well under a plate is one-dimensional (Terzaghi 1925; Mow et al. 1980)."""

    def run(self, drainage, ramp=0.2, k=0.04 / AGGREGATE):
        depth, unit = 1e-3 * HEIGHT, HEIGHT**2 * 0.01 / (0.01 * k * AGGREGATE)  # s per τ
        tau = np.array([0.05, 0.1, 0.2, 0.25, 0.3, 0.5, 1.0])
        programme = Programme((0.0, ramp * unit, unit), (0.0, depth, depth), (depth,), tuple(tau * unit))
        response = BACKEND(
            {"mu": MU, "D1": D1, "permeability": k}, Case("a", programme, {**PUCK, "drainage": drainage})
        )
        full = np.pi * RADIUS**2 * AGGREGATE * depth / HEIGHT
        return response.channels["time"] / unit, response.channels["Fz"] / full, response.error["Fz"] / full

    def test_a_ramp_and_a_rest(self):
        """Under a porous plate: 1.5 % of the largest stress, within what is stated in the mean."""
        tau, F, error = self.run({"indenter": "porous"})
        exact = relaxed(tau, 0.2)
        missed = np.abs(F - exact)
        assert missed.max() < 0.015 * exact.max()
        assert missed.mean() < error.mean()

    def test_without_a_way_out_nothing_relaxes(self):
        """A puck sealed all round keeps the force of a liquid: far more than the drained one."""
        tau, F, _ = self.run({})
        rest = F[tau >= 0.2]
        assert rest.min() > 50.0 and np.ptp(rest) < 1e-3 * rest.max()


def unconfined(tau: np.ndarray, ramp: float, n: int = 100, steps: int = 600) -> np.ndarray:
    """σ/(e E) of a cylinder between sealed, smooth plates, its side open; τ = D t/a² (Armstrong, Lai and Mow 1984).

    Finite differences in r of H (r⁻¹ (r u)′)′ = (u̇ + r ė/2)/k, H u′ + λ (u + e) = 0 at the side, e the axial strain.
    """
    lame, young = K - 2.0 / 3.0 * MU, 2.0 * MU * (1.0 + NU)
    r, h = np.linspace(0.0, 1.0, n + 1), 1.0 / n
    i = np.arange(1, n)
    A = np.zeros((n + 1, n + 1))
    A[i, i + 1], A[i, i - 1] = r[i + 1] / (r[i] + h / 2) / h**2, r[i - 1] / (r[i] - h / 2) / h**2
    A[i, i] = -r[i] * (1.0 / (r[i] + h / 2) + 1.0 / (r[i] - h / 2)) / h**2
    late = ramp + np.linspace(0.0, 1.0, steps)[1:] ** 3 * (tau.max() - ramp)
    times = np.concatenate([np.linspace(0.0, ramp, steps // 3 + 1), late])
    u, found, middle = np.zeros(n + 1), [0.0], 0.5 * (r[1:] + r[:-1])
    for before, now in pairwise(times):
        strain, old = -min(now / ramp, 1.0), -min(before / ramp, 1.0)
        M, b = np.eye(n + 1) - (now - before) * A, u - 0.5 * r * (strain - old)
        M[[0, n]], b[0], b[n] = 0.0, 0.0, -lame * strain
        M[0, 0], M[n, n - 2 :] = 1.0, np.array([0.5, -2.0, 1.5]) * AGGREGATE / h
        M[n, n] += lame
        u = np.linalg.solve(M, b)
        dilated, outside = np.diff(r * u) / h / middle, (1.5 * u[n] - 2.0 * u[n - 1] + 0.5 * u[n - 2]) / h + u[n]
        axial = AGGREGATE * strain + lame * dilated - AGGREGATE * (dilated - outside)  # p = H (div u − that outside)
        found.append(-2.0 * h * float(axial @ middle) / young)
    return np.interp(tau, times, found)


def test_unconfined_compression():
    """Radial flow out of a puck between sealed plates: 0.5 % at every moment, and within what is stated."""
    tau, ramp, depth = np.array([0.05, 0.1, 0.15, 0.25, 0.5, 1.0]), 0.1, 1e-3 * HEIGHT
    unit, k = RADIUS**2, 1.0 / AGGREGATE
    settings = {**PUCK, "support": {"kind": "plate", "friction": 0.0}}
    programme = Programme((0.0, ramp * unit, unit), (0.0, depth, depth), (depth,), tuple(tau * unit))
    response = BACKEND({"mu": MU, "D1": D1, "permeability": k}, Case("a", programme, settings))
    F = response.channels["Fz"] * HEIGHT / (np.pi * RADIUS**2 * depth * 2.0 * MU * (1.0 + NU))
    exact = unconfined(response.channels["time"] / unit, ramp)
    missed = np.abs(F / exact - 1.0)
    assert missed.max() < 0.005
    assert np.all(missed <= response.error["Fz"] / response.channels["Fz"] + 1e-3)


def stress(stretch: np.ndarray) -> np.ndarray:
    """P (MPa) of a neo-Hookean body, μ/2 (J^(−2/3) I₁ − 3) + K/2 (J − 1)², whose sides are held."""
    invariant = stretch**2 + 2.0
    return MU * stretch ** (-2.0 / 3.0) * (stretch - invariant / (3.0 * stretch)) + K * (stretch - 1.0)


def consolidated(times, depth, ramp, k, n: int = 150, closes=lambda J: 1.0) -> np.ndarray:
    """σ (MPa) under a porous plate that goes `depth` (mm) in `ramp` (s) and rests, at finite strain.

    ∂λ/∂t = ∂/∂Z (k/λ ∂P/∂Z) in the undeformed depth Z, the flux given at the top, none at the base (Gibson, England and
    Hussey 1967, Géotechnique 17, 261, with P(λ) for their stress): n cells, an implicit method of variable order.
    `closes` is k/k₀ at J = λ.
    """
    h = HEIGHT / n
    stretch, found = np.ones(n), []
    for began, ends, rate in ((0.0, ramp, depth / ramp), (ramp, float(times[-1]), 0.0)):

        def change(_, at, rate=rate):
            middle = 0.5 * (at[1:] + at[:-1])
            flux = k * closes(middle) / middle * np.diff(stress(at)) / h
            return np.diff(np.concatenate([[rate], flux, [0.0]])) / h

        mine = times[(times > began) & (times <= ends)]
        way = solve_ivp(change, (began, ends), stretch, "BDF", dense_output=True, rtol=1e-8, atol=1e-10)
        found += [np.polyval(np.polyfit((np.arange(3) + 0.5) * h, stress(way.sol(t)[:3]), 2), 0.0) for t in mine]
        stretch = way.y[:, -1]
    return -np.array(found)


def test_consolidation_at_finite_strain():
    """A layer pressed by 0.3 of its height: 1 % of the largest stress, the theory of small strains 10 % off."""
    k, depth = 1.0, 0.3 * HEIGHT
    unit = HEIGHT**2 / (k * AGGREGATE)
    ramp, tau = 0.2 * unit, np.array([0.05, 0.1, 0.2, 0.25, 0.3, 0.5, 1.0])
    settings = {**PUCK, "material": {"law": "neo_hookean"}, "drainage": {"indenter": "porous"}}
    programme = Programme((0.0, ramp, unit), (0.0, depth, depth), (depth,), tuple(tau * unit))
    response = BACKEND({"mu": MU, "D1": D1, "permeability": k}, Case("a", programme, settings))
    F = response.channels["Fz"] / (np.pi * RADIUS**2)
    exact, small = consolidated(tau * unit, depth, ramp, k), AGGREGATE * 0.3 * relaxed(tau, 0.2)
    assert np.abs(F - exact).max() < 0.01 * exact.max()
    assert np.abs(F - small).max() > 0.1 * exact.max()


def test_consolidation_with_pores_that_close():
    """k of Holmes and Mow, half of k₀ and less under the plate: 1 % of the largest stress; a constant k is 10 % off."""
    k, depth, M, alpha, solid = 1.0, 0.3 * HEIGHT, 1.0, 0.5, 0.2
    unit = HEIGHT**2 / (k * AGGREGATE)
    ramp, tau = 0.2 * unit, np.array([0.05, 0.1, 0.2, 0.25, 0.3, 0.5, 1.0])
    law = {"M": M, "alpha": alpha, "solid_fraction": solid}
    settings = {**PUCK, "material": {"law": "neo_hookean"}, "drainage": {"indenter": "porous", "holmes_mow": law}}
    programme = Programme((0.0, ramp, unit), (0.0, depth, depth), (depth,), tuple(tau * unit))
    response = BACKEND({"mu": MU, "D1": D1, "permeability": k}, Case("a", programme, settings))
    F = response.channels["Fz"] / (np.pi * RADIUS**2)

    def closes(J):
        return ((J - solid) / (1.0 - solid)) ** alpha * np.exp(0.5 * M * (J**2 - 1.0))

    exact, constant = (consolidated(tau * unit, depth, ramp, k, closes=by) for by in (closes, lambda J: 1.0))
    assert np.abs(F - exact).max() < 0.01 * exact.max()
    assert np.abs(F - constant).max() > 0.1 * exact.max()


class TestALayerUnderAFlatEnd:
    """A bonded layer under a porous flat end, with transforms alone beside it (Mak, Lai and Mow 1987)."""

    LAYER, END, DEPTH, RAMP = Layer(MU, NU, 1.0 / AGGREGATE, 6.0), 3.0, 0.006, 0.05

    def test_the_oracle_has_both_limits(self):
        """A half-space drained, 4 μ a/(1 − ν), and undrained, 8 μ a; twice the points change 2e-4."""
        end = touching(self.LAYER, 3.0, 0.003, 1e-5)
        deep = Layer(MU, NU, 1.0 / AGGREGATE, 3000.0)
        assert abs(stiffness(1e-9, deep, end).real / (4.0 * MU * end.a / (1.0 - NU)) - 1.0) < 2e-3
        assert abs(stiffness(200.0, deep, end, 3).real / (8.0 * MU * end.a) - 1.0) < 0.03
        times = 9.0 * np.array([0.1, 1.0])
        one, two = (relaxation(times, 0.45, self.LAYER, end, fine=n) for n in (1, 2))
        np.testing.assert_allclose(one, two, rtol=2e-4)

    def pressed(self, fillet, tau, **mesh):
        """The run and F/d by transforms at tau (n,) a²/D; `fillet` over the radius."""
        unit, fillet = self.END**2, fillet * self.END
        start = self.RAMP * unit
        settings = {
            "specimen": {"shape": "slab", "thickness": self.LAYER.h},
            "indenter": {"shape": "flat", "radius": self.END, "fillet": fillet},
            "support": {"kind": "bonded"},
            "drainage": {"indenter": "porous"},
            "material": {"law": "linear_elastic"},
            "mesh": mesh,
        }
        programme = Programme(
            (0.0, start, 25.0 * unit), (0.0, self.DEPTH, self.DEPTH), (self.DEPTH,), tuple(tau * unit)
        )
        values = {"mu": MU, "D1": D1, "permeability": self.LAYER.k}
        run = BACKEND(values, Case("a", programme, settings))
        end = touching(self.LAYER, self.END, fillet, self.DEPTH)
        return run, relaxation(run.channels["time"], start, self.LAYER, end), end

    def test_relaxation(self):
        """F/d from 0.05 to 20 a²/D: 1 % at every moment, 0.4 % beside its drained value, the radius of contact 1e-3.

        The stated error is that large at every moment, too, where mesh and steps err against each other.
        """
        run, exact, end = self.pressed(0.02, np.array([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0]))
        found, F = run.channels, run.channels["Fz"] / self.DEPTH
        off, said = np.abs(F - exact), run.error["Fz"] / self.DEPTH
        assert np.all(said > 0.6 * off) and np.mean(said > off) > 0.8  # an estimate: one moment of five may lie above
        np.testing.assert_allclose(F, exact, rtol=0.01)
        np.testing.assert_allclose(F / F[-1], exact / exact[-1], rtol=4e-3)
        np.testing.assert_allclose(found["contact_radius"], end.c, rtol=1e-3)
        assert F[0] > 1.5 * F[-1]  # enough is there to be missed

    @pytest.mark.verification
    @pytest.mark.parametrize("level", ["coarse", "standard", "fine"])
    @pytest.mark.parametrize("fillet", [0.02, 0.05, 0.1])
    def test_what_is_stated_where_contact_barely_reaches_the_edge(self, fillet, level):
        """0.002 R deep; printed in % of the force.  At least 0.45 of what is missed is stated at level coarse and R/10,
        elsewhere 0.6 of it."""
        run, exact, _ = self.pressed(fillet, np.array([0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0]), level=level)
        off, said = (100.0 * v / exact for v in (run.channels["Fz"] / self.DEPTH - exact, run.error["Fz"] / self.DEPTH))
        print(f"\nfillet R/{1 / fillet:g}, {level}: above theory {np.round(off, 2)}, stated {np.round(said, 2)}")
        assert np.all(said > (0.45 if fillet == 0.1 and level == "coarse" else 0.6) * np.abs(off))


class TestLiquidThatGivesWay:
    """`pore_D1`: D1 is that of the body before liquid leaves, D1 + pore_D1 that of the drained solid."""

    BEFORE, MORE = 0.3 * D1, 0.7 * D1

    def at(self, k):
        return forces({"D1": self.BEFORE, "pore_D1": self.MORE, "permeability": k}, SLAB)

    def test_limits(self):
        """For k → 0 the solid of D1, for k → ∞ that of D1 + pore_D1: two penalties of the contact apart."""
        first, last = forces({"D1": self.BEFORE}, SLAB), forces({"D1": self.BEFORE + self.MORE}, SLAB)
        np.testing.assert_allclose(self.at(1e-9), first[-1], rtol=3e-3)
        np.testing.assert_allclose(self.at(1e9), last[-1], rtol=3e-3)
        assert first[-1] > 1.1 * last[-1]

    def test_between(self):
        between = self.at(2.0)
        assert np.all(np.diff(between) < 0.0)
        assert 1.1 * self.at(1e9)[-1] < between[-1] < 0.95 * between[0] < 0.951 * self.at(1e-9)[-1]

    def test_without_permeability_it_has_no_influence(self):
        case = Case("a", HOLD, SLAB)
        kept = BACKEND.canonical({"mu": MU, "D1": D1, "pore_D1": 50.0}, case)[0]
        assert "pore_D1" not in kept
        np.testing.assert_array_equal(forces({"pore_D1": 50.0}, SLAB), forces({}, SLAB))


class TestLimits:
    def test_drained(self):
        """For k → ∞ it is the solid alone: to what the two penalties differ by, and a point at the edge of contact."""
        elastic = forces({}, FINER)
        for drainage in ("sealed", "porous"):
            flowing = forces({"permeability": 1e9}, {**FINER, "drainage": {"indenter": drainage}})
            np.testing.assert_allclose(flowing, elastic, rtol=5e-4)

    def test_undrained(self):
        """For k → 0 it is an incompressible solid, whose K/μ is 5000 here."""
        stiff = forces({"D1": 2.0 / (5000.0 * MU)}, FINER)
        for drainage in ("sealed", "porous"):
            flowing = forces({"permeability": 1e-9}, {**FINER, "drainage": {"indenter": drainage}})
            np.testing.assert_allclose(flowing, stiff, rtol=3e-3)

    def test_a_porous_support(self):
        """It drains what lies on it: nearer to the drained force at every moment."""
        drained = forces({}, SLAB)[-1]
        one, two = (
            forces({"permeability": 2.0}, {**SLAB, "drainage": {"indenter": "porous", "support": support}})
            for support in ("sealed", "porous")
        )
        assert np.all(one > two) and two[-1] > drained

    def test_between(self):
        """Forces fall from one to the other, and sooner under a porous indenter."""
        drained, stiff = forces({}, SLAB)[-1], forces({"permeability": 1e-9}, SLAB)[-1]
        sealed = forces({"permeability": 20.0}, SLAB)
        porous = forces({"permeability": 20.0}, {**SLAB, "drainage": {"indenter": "porous"}})
        assert np.all(np.diff(sealed) < 0.0) and np.all(np.diff(porous) < 0.0)
        assert stiff > sealed[0] > porous[0] and sealed[-1] > drained
        assert np.all(sealed[1:] > porous[1:])


class TestSimilarity:
    """Dimensions alone: what relaxes takes a time in proportion to R²/(k μ)."""

    def test_modulus(self):
        """Ten times the moduli and a tenth of the permeability: ten times the force, as `rso` takes for granted."""
        one = forces({"permeability": 20.0}, SLAB)
        ten = forces({"mu": 10.0 * MU, "D1": D1 / 10.0, "permeability": 2.0}, SLAB)
        np.testing.assert_allclose(ten, 10.0 * one, rtol=1e-6)

    def test_length_and_time(self):
        """Twice the lengths, four times the times: four times the force; unlike relaxation of the network."""
        double = {
            **SLAB,
            "specimen": {"shape": "slab", "thickness": 12.0},
            "indenter": {"shape": "sphere", "radius": 6},
        }
        longer = Programme((0.0, 0.4, 80.4), (0.0, 1.2, 1.2), (1.2,), tuple(4.0 * (0.1 + t) for t in RESTS))
        small, large = forces({"permeability": 20.0}, SLAB), forces({"permeability": 20.0}, double, longer)
        np.testing.assert_allclose(large, 4.0 * small, rtol=1e-6)
        network = {"prony_g": 0.3, "prony_tau": 2.0}
        assert np.abs(forces(network, double, longer) / (4.0 * forces(network, SLAB)) - 1.0).max() > 0.02


class TestWhatIsRefused:
    @pytest.mark.parametrize(
        ("values", "settings", "words"),
        [
            ({"friction": 0.2}, SLAB, "without friction"),
            ({}, {**SLAB, "specimen": {"shape": "block", "size": [20, 20, 6]}}, "bodies of revolution only"),
            ({"tilt_x": 3.0}, SLAB, "bodies of revolution only"),
        ],
    )
    def test_what_is_not_modelled(self, values, settings, words):
        with pytest.raises(SimulationFailed, match=words):
            forces({"permeability": 1.0, **values}, settings)
        assert words in BACKEND.refused({"mu": MU, "D1": D1, "permeability": 1.0, **values}, Case("a", HOLD, settings))

    def test_a_force(self):
        segments = (Segment("force", rate=0.02, to_N=0.02),)
        with pytest.raises(SimulationFailed, match="travel over time"):
            forces({"permeability": 1.0}, SLAB, Programme(segments=segments, asked_N=(0.01,)))

    @pytest.mark.parametrize("law", [{"M": -1.0}, {"solid_fraction": 1.0}, {"beta": 1.0}])
    def test_a_wrong_number_of_holmes_and_mow(self, law):
        with pytest.raises(ValueError, match=rf"drainage\.holmes_mow\.{next(iter(law))}"):
            BACKEND.check(Case("a", HOLD, {**SLAB, "drainage": {"holmes_mow": law}}))

    def test_a_wrong_word(self):
        with pytest.raises(ValueError, match=r"drainage\.indenter"):
            BACKEND.check(Case("a", HOLD, {**SLAB, "drainage": {"indenter": "open"}}))


class TestKeys:
    def test_without_pore_flow_nothing_changes(self):
        """Drainage is no part of a run without liquid; permeability 0 is none."""
        plain = BACKEND.canonical({"mu": MU, "D1": D1}, Case("a", HOLD, SLAB))
        dry = {**SLAB, "drainage": {"indenter": "porous"}}
        assert BACKEND.canonical({"mu": MU, "D1": D1, "permeability": 0.0}, Case("a", HOLD, dry)) == plain

    def test_a_constant_permeability_is_no_key(self):
        """M = alpha = 0 is k₀ whatever the solid fraction; others count, and only with liquid."""
        values = {"mu": MU, "D1": D1, "permeability": 1.0}
        plain, same, other, dry = (
            BACKEND.canonical({**values, "permeability": k}, Case("a", HOLD, {**SLAB, "drainage": {"holmes_mow": law}}))
            for law, k in (({}, 1.0), ({"solid_fraction": 0.2}, 1.0), ({"M": 2.0}, 1.0), ({"M": 2.0}, 0.0))
        )
        assert plain == same != other
        assert other[1].settings["drainage"]["holmes_mow"]["M"] == 2.0 and "drainage" not in dry[1].settings

    def test_with_pore_flow_the_times_count(self):
        values = {"mu": MU, "D1": D1, "permeability": 1.0}
        kept, case = BACKEND.canonical(values, Case("a", HOLD, {**SLAB, "drainage": {"indenter": "porous"}}))
        assert kept["permeability"] == 1.0 and case.programme == HOLD
        assert case.settings["drainage"] == {"indenter": "porous", "support": "sealed"}


def test_the_coupled_tangent():
    """Rows of pressures are the derivative of the volumes that they miss; columns of pressures are forces."""
    points, cells = square()
    body = axisymmetric.discretise(points, cells, np.zeros((len(points), 3), bool), symmetric=False)
    space = pore_pressure.porous(body)
    random = np.random.default_rng(3)
    u = 0.1 * random.normal(size=(len(points), 3)) * [1, 0, 1]
    u[points[:, 0] == 0.0, 0] = 0.0
    p, unit, storage = random.normal(size=len(space.vertices)), 1.3, 0.4
    law = HolmesMow(0.5, 2.0, 0.2)

    def flows(H):
        return [0.7 * v for v in law.relative(np.linalg.det(H + np.eye(3)))]

    def missing(u, p):
        H = axisymmetric.displacement_gradients(body, u)
        held = storage * (p[space.corners] @ axisymmetric.linear_functions().T)
        v = pore_pressure.volume_change(H, False) + held
        return pore_pressure.mass(space, H + np.eye(3), v, p, flows(H)[0])

    H = axisymmetric.displacement_gradients(body, u)
    data = pore_pressure.coupling(space, H + np.eye(3), p, *flows(H), storage, unit, False)
    rows = np.repeat(np.arange(space.pattern.size), np.diff(space.pattern.indptr))
    matrix = np.zeros((space.pattern.size,) * 2)
    matrix[rows, space.pattern.indices] = data
    step = 1e-6
    for node, axis in ((0, 2), (4, 0), (len(points) - 1, 2)):
        dof = body.free.reshape(-1, 3)[node, axis]
        if dof < 0:
            continue
        du = np.zeros_like(u)
        du[node, axis] = step
        slope = (missing(u + du, p) - missing(u - du, p)) / (2.0 * step)
        np.testing.assert_allclose(matrix[space.number, space.moved[dof]], -unit * slope, atol=1e-7)
    dp = np.eye(len(p))[1] * step
    slope = (missing(u, p + dp) - missing(u, p - dp)) / (2.0 * step)
    np.testing.assert_allclose(matrix[space.number, space.number[1]], -(unit**2) * slope, atol=1e-7)
    pull = axisymmetric.internal_force(body, H + np.eye(3), np.zeros((*body.w.shape, 6)), -p[space.corners])
    free = body.free.reshape(-1, 3) >= 0
    coupled = matrix[np.ix_(space.moved, space.number)] @ p / unit
    np.testing.assert_allclose(coupled[body.free.reshape(-1, 3)[free]], pull[free], atol=1e-9)


def square() -> tuple[np.ndarray, np.ndarray]:
    """Four triangles of a cylinder of radius and height 1."""
    from fem_backend.meshing.meridian import triangulated

    mesh = triangulated(np.array([0.0, 0.6, 1.0]), np.array([0.0, 1.0]))
    return mesh.points, mesh.cells
