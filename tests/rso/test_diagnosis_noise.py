"""Noise of dense records: white, filtered, counted in steps; what bins scatter by against what is assumed."""

from __future__ import annotations

import types
from dataclasses import replace

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from rso.data import Noise, Repeat
from rso.discrepancy import build_library, make_test_plan
from rso.discrepancy.detectors import autocorrelation, sensor
from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS

N = 1601  # readings
U = np.linspace(0.0, 4.0, N)
F = 0.04 * U**1.5
HOW = {
    "white": lambda v, F: F + 3e-3 * v,
    "filtered": lambda v, F: F + 3e-3 * uniform_filter1d(v, 60) * 60**0.5,
    "steps of 20 mN": lambda v, F: np.round((F + 1e-3 * v) / 0.02) * 0.02,
}


@pytest.mark.parametrize("how", HOW)
def test_bins_scatter_as_assumed_however_the_sensor_smooths(how):
    """200 records of one test without repeats: root mean square over the assumed standard deviation of a bin.

    White: 1 within the sampling of 14 bins.  Filtered or in steps: not more than 1.5 times too small; in steps up to 10
    times too large, as a bin may happen to hold one whole step.  Taken for white, what filters is nearly twice too
    small, and steps are too small though they count for q/√12 of each reading.
    """
    rng, ratios, naive = np.random.default_rng(7), [], []
    for _ in range(40):
        v = HOW[how](rng.standard_normal(N), F)
        r = Repeat("1", U, U / 0.5, {"Fz": v}, {}, np.full(N, "loading"))
        plan = make_test_plan([toy.experiment("a", (r,), noise=Noise())])
        level = noise.noise_levels(plan)["Fz"]
        (t,) = plan.tests
        use = t.depth > 0.8
        off = t.values["Fz"] - 0.04 * t.depth**1.5
        readings = noise._white(level, t, np.zeros(t.n))
        ratios.append(np.mean(off[use] ** 2 / (readings + level.correlated**2)[use]))
        naive.append(np.mean(off[use] ** 2 / readings[use]))
    got, before = np.sqrt(np.mean(ratios)), np.sqrt(np.mean(naive))
    if how == "white":
        assert 0.8 < got < 1.2 and level.correlated == 0.0
    else:
        assert 0.1 < got < 1.5
        assert before > (1.9 if how == "filtered" else 1.1)


def remembering(rng, ρ, n, repeats, sd=3e-3):
    """Records of one test whose errors are ρ times the one before and something new, with a gain of 1 % each."""
    u = np.linspace(0.0, 4.0, n)
    e = rng.standard_normal((repeats, n))
    for k in range(1, n):
        e[:, k] = ρ * e[:, k - 1] + np.sqrt(1 - ρ**2) * e[:, k]
    F = 0.04 * u**1.5 * (1.0 + 0.01 * rng.standard_normal((repeats, 1))) + sd * e
    return tuple(Repeat(str(k), u, u / 0.5, {"Fz": v}, {}, np.full(n, "loading")) for k, v in enumerate(F))


def beside(rng, ρ, n, slope):
    """A record whose lateral forces are `slope` times Fz and noise with a memory ρ, as that of Fz."""
    e = rng.standard_normal((3, n))
    for k in range(1, n):
        e[:, k] = ρ * e[:, k - 1] + np.sqrt(1 - ρ**2) * e[:, k]
    u = np.linspace(0.0, 4.0, n)
    F = 0.04 * u**1.5 * np.array([[1.0], [slope], [slope]]) + 3e-3 * e
    return (Repeat("1", u, u / 0.5, dict(zip(("Fz", "Fx", "Fy"), F, strict=True)), {}, np.full(n, "loading")),)


@pytest.mark.parametrize("ρ", [0.0, 0.4, 0.8])
def test_what_lateral_forces_remember_shows_where_they_have_nothing_to_show(ρ):
    """Five tests of other lengths, no repeats: ρ of a reading, 25 plans, to 0.05 and 0.07 each; none of white noise.

    Negative control: lateral forces of a slope tell none, as they may be what a model lacks.
    """
    rng, found = np.random.default_rng(5), []
    for slope in 25 * [0.0] + 5 * [0.3]:
        sizes = (61, 72, 80, 91, 101)
        tests = [
            toy.experiment(f"x{n}", beside(rng, ρ, n, slope), point=(float(n), 0.0), noise=Noise(Fz=3e-3))
            for n in sizes
        ]
        length = autocorrelation.of_idle_channels(make_test_plan(tests))
        assert slope == 0.0 or length is None
        found += [] if slope else [0.0 if length is None else np.exp(-4.0 / 80 / length)]
    np.testing.assert_allclose(np.mean(found), ρ, rtol=0, atol=0.05)
    assert np.std(found) < 0.07


def test_channels_in_which_nothing_was_recorded_tell_nothing():
    still = beside(np.random.default_rng(0), 0.8, 80, 0.0)
    dead = tuple(replace(r, channels=r.channels | {"Fx": np.full(80, 0.1), "Fy": np.full(80, 0.1)}) for r in still)
    tests = [toy.experiment(f"x{k}", dead, point=(float(k), 0.0), noise=Noise(Fz=3e-3)) for k in range(9)]
    assert autocorrelation.of_idle_channels(make_test_plan(tests)) is None


def alone(rng, ρ, sizes, gap=0.0, jump=0.0, sd=3e-3):
    """Tests of one force channel without repeats; a `gap` bends the branch, a `jump` is in the middle of the first."""
    tests = []
    for n in sizes:
        e = rng.standard_normal(n)
        for k in range(1, n):
            e[k] = ρ * e[k - 1] + np.sqrt(1 - ρ**2) * e[k]
        u = np.linspace(0.02, 4.0, n)
        F = 0.04 * u**1.5 * (1.0 + gap * np.sin(u)) + sd * e - (jump if n == sizes[0] else 0.0) * (u > 2.0)
        one = (Repeat("1", u, u / 0.5, {"Fz": F}, {}, np.full(n, "loading")),)
        tests.append(toy.experiment(f"x{n}", one, point=(float(n), 0.0), noise=Noise(Fz=sd)))
    return make_test_plan(tests)


SIZES = (61, 72, 80, 91, 101)


@pytest.mark.parametrize("ρ", [0.3, 0.5, 0.8])
def test_one_channel_without_repeats_tells_what_its_readings_remember(ρ):
    """By 19 windows of a plan: ρ of a reading to 0.05 in the mean of 30 plans, also below a model that is wrong."""
    for gap in (0.0, 0.1):
        rng = np.random.default_rng(3)
        found = [autocorrelation.within_windows(alone(rng, ρ, SIZES, gap)) for _ in range(30)]
        told = [0.0 if v is None else float(np.exp(-4.0 / 80 / v)) for v in found]
        np.testing.assert_allclose(np.mean(told), ρ, rtol=0, atol=0.05)


def test_white_noise_a_wrong_model_and_a_jump_are_no_memory():
    """At most 3 of 60 plans, where two standard errors leave 2 %."""
    rng = np.random.default_rng(4)
    plans = [alone(rng, 0.0, SIZES, gap=0.1, jump=jump) for jump in (0.0, 0.1) for _ in range(30)]
    assert sum(autocorrelation.within_windows(p) is not None for p in plans) <= 3
    assert autocorrelation.within_windows(alone(rng, 0.8, (50,))) is None  # two windows tell nothing


def thrice(rng, peak, contact):
    """Three records to a depth, contact found `contact` (mm, rms) off; the first is a virgin one."""
    u, off = np.linspace(0.0, peak, 81), contact * rng.standard_normal((3, 1))
    F = 0.04 * np.maximum(u + off, 0.0) ** 1.5 + 1e-3 * rng.standard_normal((3, 81))
    return tuple(Repeat(str(k), u, u / 0.5, {"Fz": v}, {}, np.full(81, "loading")) for k, v in enumerate(F))


def test_three_repeats_at_several_places_tell_what_contacts_scatter_by():
    """Of each place two are alike, the first one met a virgin body: those of five places count together.

    Negative control: contacts that scatter as is usual show nothing.
    """
    rng, found = np.random.default_rng(3), {}
    for contact in (0.004, 0.08):
        shown = []
        for _ in range(20):
            places = [
                toy.experiment(
                    f"x{k}", thrice(rng, 4.0, contact), point=(float(3 * k), 0.0), noise=Noise(Fz=1e-3, gain=0.005)
                )
                for k in range(5)
            ]
            shown.append(noise.noise_levels(make_test_plan(places))["Fz"].shown[1])
        found[contact] = np.array(shown)
    assert np.mean(found[0.004] > 0.0) <= 0.1
    # five degrees of freedom: the variance scatters by 63 %
    assert np.mean(found[0.08] > 0.03) >= 0.9
    np.testing.assert_allclose(np.sqrt(np.mean(found[0.08] ** 2)), 0.08, rtol=0.3)


@pytest.mark.parametrize("readings", [41, 81])
@pytest.mark.parametrize("ρ", [0.4, 0.6, 0.8])
def test_bins_of_readings_that_remember_each_other_scatter_as_assumed(ρ, readings):
    """Forty plans of five records: single bins and their mean along a record against what is assumed of both.

    The memory is estimated from some 150 deviations, and a tenth of the variance stays white: within 25 % in variance
    of single bins, and 40 % of means, where the estimated length counts in proportion.
    """
    rng, single, together = np.random.default_rng(11), [], []
    for _ in range(40):
        plan = make_test_plan([toy.experiment("a", remembering(rng, ρ, readings, 5), noise=Noise(Fz=3e-3, gain=0.01))])
        level = noise.noise_levels(plan)["Fz"]
        C = noise._along(level, plan.tests[0].depth) + np.diag(noise._white(level, plan.tests[0], 0.0))
        off = np.array([t.values["Fz"] for t in plan.tests])
        off = (off - off.mean(axis=0)) * np.sqrt(5 / 4)
        off = off[:, :5]  # shallow, where the gain does not count
        single.append((np.mean(off**2), np.mean(np.diag(C)[:5])))
        together.append((np.mean(off.mean(axis=1) ** 2), np.mean(C[:5, :5])))
    for pairs, rtol in ((single, 0.25), (together, 0.4)):
        found, assumed = np.mean(pairs, axis=0)
        np.testing.assert_allclose(found, assumed, rtol=rtol)


def test_noise_that_remembers_is_not_taken_for_gain_or_contact():
    """Five records differ by what is stated: the stated values stay, but for one plan in twenty."""
    rng = np.random.default_rng(3)
    stated = Noise(Fz=3e-3, gain=0.01, depth=0.005)
    plans = [make_test_plan([toy.experiment("a", remembering(rng, 0.6, 41, 5), noise=stated)]) for _ in range(60)]
    found = [noise.noise_levels(p)["Fz"] for p in plans]
    assert np.mean([v.gain > 0.01 for v in found]) < 0.15 and np.mean([v.contact > 0.01 for v in found]) < 0.15


def test_a_gain_that_repeats_contradict_is_theirs_but_where_what_is_stated_binds():
    rng = np.random.default_rng(3)
    few = remembering(rng, 0.0, 41, 5)
    wide = tuple(
        Repeat(r.label, r.depth, r.time, {"Fz": r.channels["Fz"] * g}, {}, r.segment)
        for r, g in zip(few, (0.94, 0.97, 1.0, 1.03, 1.06), strict=True)
    )
    plans = [make_test_plan([toy.experiment("a", wide, noise=Noise(Fz=3e-3, gain=g))]) for g in (0.01, 0.02, 0.0)]
    assert all(v.gain == v.shown[0] for v in (noise.noise_levels(p)["Fz"] for p in plans))
    said, hinted, unsaid = (noise.noise_levels(p, binding=True)["Fz"] for p in plans)
    for level in (said, hinted, unsaid):
        assert 0.035 < level.shown[0] < 0.065  # standard deviation of the five is 0.047
    assert hinted.gain == hinted.shown[0] > 0.02 and unsaid.gain == unsaid.shown[0]
    assert said.gain == 0.01  # five times what is stated is no noise
    assert said.expected == unsaid.expected == (0.01, 0.01)


def test_a_stated_contact_is_that_of_each_test_and_a_calibration_is_none():
    """`contact` widens the usual 0.01 mm; what all tests have alike is not noise between them."""
    records = remembering(np.random.default_rng(3), 0.0, 41, 5)
    said = [Noise(Fz=3e-3), Noise(Fz=3e-3, contact=0.05), Noise(Fz=3e-3, calibration=0.05)]
    usual, off, cell = (noise.noise_levels(make_test_plan([toy.experiment("a", records, noise=n)]))["Fz"] for n in said)
    assert (usual.contact, off.contact) == (0.01, 0.05) and cell == usual


@pytest.mark.parametrize("largest", [0.0, 0.3, 0.7, 3.0])
def test_a_channel_that_moves_by_few_counts_scatters_by_a_count(largest):
    """Readings of a lateral force whose largest is a share of the step in which they are counted, beside one test
    that reads nothing but zero: however they stand, they are within three standard deviations of the truth."""
    rng, u, step = np.random.default_rng(3), np.linspace(0.0, 4.0, 41), 0.02
    true = {"side": largest * step * (u / 4.0) ** 1.5, "top": 0.2 * step * (u / 4.0) ** 1.5}
    tests = []
    for name, Fx in true.items():
        v = {
            c: step * np.round((F + 0.1 * step * rng.standard_normal(41)) / step)
            for c, F in (("Fx", Fx), ("Fz", 0.04 * u**1.5))
        }
        tests.append(toy.experiment(name, (Repeat("1", u, u / 0.5, v, {}, np.full(41, "loading")),), noise=Noise()))
    plan = make_test_plan(tests)
    level = noise.noise_levels(plan)["Fx"]
    for t, F in zip(plan.tests, true.values(), strict=True):
        own = level.of(t.experiment)
        off = t.values["Fx"] - np.interp(t.depth, u, F)
        sd = np.sqrt(noise._white(own, t, np.zeros(t.n)) + own.correlated**2)
        assert np.all(np.abs(off) < 3.0 * sd)
        assert np.all(sd < step)


def test_a_bin_of_readings_that_hardly_forget_is_one_of_them():
    """The limits of the formulas: readings of no memory average to 1/k, those of a very long one do not at all."""
    share, reach = sensor.of_bins(1e-3, 0.3, 4.0)
    np.testing.assert_allclose(share, 0.5, rtol=1e-9)  # ρ = e⁻⁷⁵
    assert reach < 0.02
    for length in (1e3, 1e9):
        share, reach = sensor.of_bins(length, 0.3, 4.0)
        np.testing.assert_allclose(share, 1.0, rtol=1e-3)  # round-off of V is 1e-4 there
        assert reach > 100.0


def test_a_shorter_repeat_is_no_other_gain():
    """One of five repeats that ends early is compared where it was recorded, whichever of them it is."""
    u = np.linspace(0.0, 4.0, 85)
    for short in (0, 2, 4):
        rng, repeats = np.random.default_rng(short), []
        for k in range(5):
            d = u[u <= 2.0] if k == short else u
            v = F_of(d) + 1e-3 * rng.standard_normal(len(d))
            repeats.append(Repeat(str(k), d, d / 0.5, {"Fz": v}, {}, np.full(len(d), "loading")))
        level = noise.noise_levels(make_test_plan([toy.experiment("a", tuple(repeats), noise=Noise())]))["Fz"]
        assert level.gain <= 0.02 and level.contact <= 0.03  # clamped at its last force it would be 30 %


@pytest.mark.parametrize("repeats", [1, 5])
def test_where_no_noise_is_known_a_table_is_not_taken_for_exact(repeats):
    """Four readings a record: the scatter of repeats where there are some, one per cent of the force where not."""
    rng, u = np.random.default_rng(3), np.linspace(1.0, 4.0, 4)
    noisy = [F_of(u) + 3e-3 * rng.standard_normal(4) for _ in range(repeats)]
    records = tuple(Repeat(str(k), u, u / 0.5, {"Fz": v}, {}, np.full(4, "loading")) for k, v in enumerate(noisy))
    level = noise.noise_levels(make_test_plan([toy.experiment("a", records, noise=Noise())]))["Fz"]
    if repeats == 1:
        assert level.source == "assumed"
        np.testing.assert_allclose(
            level.white, DIAGNOSIS_SETTINGS.noise.reading * records[0].channels["Fz"].max(), rtol=1e-12
        )
    else:  # sixteen numbers tell a standard deviation to a fifth; what is taken lies above it
        assert level.source == "from the readings" and 2e-3 < level.white < 7e-3


def test_few_readings_that_happen_to_agree_are_no_quiet_sensor():
    """Of 200 tables of 14 readings a tenth and not a half is louder than taken; stated noise needs no such caution."""
    rng, louder, said = np.random.default_rng(11), 0, []
    u = np.linspace(0.3, 4.0, 14)
    for _ in range(200):
        r = Repeat("1", u, u / 0.5, {"Fz": F_of(u) + 3e-3 * rng.standard_normal(14)}, {}, np.full(14, "loading"))
        louder += noise.noise_levels(make_test_plan([toy.experiment("a", (r,), noise=Noise())]))["Fz"].white < 3e-3
        said.append(noise.noise_levels(make_test_plan([toy.experiment("a", (r,), noise=Noise(Fz=3e-3))]))["Fz"].white)
    assert louder < 0.17 * 200  # 3 standard deviations of a binomial share above 0.1
    assert np.median(said) < 3.5e-3


def test_a_loud_experiment_does_not_drown_a_quiet_one():
    """Another sensor or range has its own noise, stated or not; the same sensor's experiments share theirs."""
    u = np.linspace(0.0, 4.0, 85)

    def plan_of(sds, stated):
        rng = np.random.default_rng(5)
        records = [
            Repeat("1", u, u / 0.5, {"Fz": F_of(u) + sd * rng.standard_normal(85)}, {}, np.full(85, "loading"))
            for sd in sds
        ]
        return make_test_plan(
            [
                toy.experiment(str(k), (r,), noise=Noise(Fz=sd if stated else 0.0))
                for k, (r, sd) in enumerate(zip(records, sds, strict=True))
            ]
        )

    for stated in (True, False):
        level = noise.noise_levels(plan_of((2e-4, 2e-4, 5e-3), stated))["Fz"]
        each = [level.of(k).white for k in range(3)]
        np.testing.assert_allclose(each, [2e-4, 2e-4, 5e-3], rtol=0.35)  # of 85 readings: a sixth, twice
    assert not noise.noise_levels(plan_of((2e-4, 2e-4, 2e-4), False))["Fz"].loud


def F_of(u):
    """A ball's force (N)."""
    return 0.04 * u**1.5


def test_programs_part_company_at_the_deepest_travel_or_deeper_where_the_backend_says():
    """At twice that travel the share that they differ by more is gone from the deepest readings (1/2⁸); not by less."""
    base = toy.base(axes=False)
    truth = {"mu": 0.012, "D1": 60.0 * base.reference / 0.012}
    plan = make_test_plan([toy.experiment("load", toy.recorded(truth, np.random.default_rng(0)))])
    library = build_library(base, plan, toy.effects("stiff"), toy.run)
    deepest, F = max(p.deepest for p in plan.places), plan.values()
    own = {n: getattr(base.backend, n) for n in dir(base.backend) if not n.startswith("_")}

    def share(**says):
        there = replace(library, base=replace(base, backend=types.SimpleNamespace(**own, **says)))
        return np.diag(noise._of_model(there, F, DIAGNOSIS_SETTINGS.model_error)) / F**2

    usual, deep, shallow = share(), share(deep=lambda _: 2.0 * deepest), share(deep=lambda _: 0.5 * deepest)
    u = plan.tests[0].depth / deepest
    np.testing.assert_allclose(
        usual - deep, DIAGNOSIS_SETTINGS.model_error.deep**2 * u**16 * (1.0 - 2.0**-16), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(usual, shallow)


def test_a_model_may_be_rough_by_a_thousandth_from_bin_to_bin():
    """Second differences of three bins: 0.1 % of the force at a correlation r of neighbours, R of next ones."""
    base = toy.base(axes=False)
    truth = {"mu": 0.012, "D1": 60.0 * base.reference / 0.012}
    plan = make_test_plan([toy.experiment("load", toy.recorded(truth, np.random.default_rng(0)))])
    library = build_library(base, plan, toy.effects("stiff"), toy.run)
    F, u, deepest = np.ones(plan.n), plan.tests[0].depth, max(p.deepest for p in plan.places)
    d = np.array([1.0, -2.0, 1.0])
    found = np.array(
        [d @ noise._of_model(library, F, DIAGNOSIS_SETTINGS.model_error)[k : k + 3, k : k + 3] @ d for k in range(1, 6)]
    )
    r, R = (np.exp(-0.5 * ((u[2:7] - u[1:6]) * m / (0.06 * deepest)) ** 2) for m in (1, 2))
    np.testing.assert_allclose(found, 1e-6 * (6.0 - 8.0 * r + 2.0 * R), rtol=0.2)  # what is smooth adds a little


def records(s, tau, seeds, n=2000, white=3e-3):
    """Deviations of dense records from polynomials: white noise and slow noise of time constant tau (readings)."""
    x = np.sqrt(np.linspace(0.4, 4.0, n))
    P = np.polynomial.legendre.legvander(2.0 * (x - x.min()) / np.ptp(x) - 1.0, sensor.FILTER_TREND_DEGREE)
    for seed in seeds:
        rng, a = np.random.default_rng(seed), np.exp(-1.0 / tau)
        slow = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(n + 2000))[2000:]
        v = 0.1 * x**3 + s * slow + white * rng.standard_normal(n)
        yield v - P @ np.linalg.lstsq(P, v, rcond=None)[0], 3.6 / n, 4.0 / 14


def test_white_noise_of_dense_records_is_not_slow():
    """One in a thousand is let through: of 60 sets of six none as a rule, two with a chance of 2e-3."""
    called = [sensor.slow(list(records(0.0, 20, range(6 * k, 6 * k + 6))))[0] > 0.0 for k in range(60)]
    assert sum(called) < 2


@pytest.mark.parametrize("tau", [20, 60])
def test_slow_noise_below_the_white_one_is_seen_in_dense_records(tau):
    """1 mN of slow noise beneath 3 mN of white, of which neighbouring readings show nothing (lag-1 correlation 0.1).
    What a bin has of it is known to a factor of 1.6 from six records, as the polynomial takes the most of it."""
    size, length = np.median(
        [sensor.slow(list(records(1e-3, tau, range(6 * k, 6 * k + 6)))) for k in range(20)], axis=0
    )
    share, reach = sensor.of_bins(tau * 3.6 / 2000, 4.0 / 14, 4.0 / 14 / (3.6 / 2000))
    assert 1 / 1.6 < size / (1e-3 * share) < 1.6 and 1 / 2.5 < length / reach < 2.5
