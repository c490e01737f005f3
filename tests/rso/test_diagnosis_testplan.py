"""What was measured, in bins, and what it scatters by: neither may depend on what a model says."""

import dataclasses
from pathlib import Path

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.data import Measurement, Noise, Repeat
from rso.discrepancy import make_test_plan
from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS
from rso.discrepancy.library.simulations import passes, passes_of
from rso.discrepancy.library.test_plan import N_HOLD_BINS, PLAN_DEPTH_STEP_MM

NOTHING = Noise()


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------------------------------------------- in bins


def test_bins_keep_the_means_of_every_branch():
    repeats = toy.recorded(toy.TRUTH, rng(), unload=True, lateral=True, readings=97)
    plan = make_test_plan([toy.experiment("a", repeats)])
    (test,), (r,) = plan.tests, repeats
    for k, branch in enumerate(("loading", "unloading")):
        mine, own = test.branch == k, r.segment == branch
        assert mine.sum() == N_HOLD_BINS and test.count[mine].sum() == own.sum()
        for c in ("Fx", "Fy", "Fz"):
            total = np.sum(test.count[mine] * test.values[c][mine])
            np.testing.assert_allclose(total, r.channels[c][own].sum(), rtol=1e-12)
        of_a_ball = np.sum(test.count[mine] * test.depth[mine] ** 1.5)
        np.testing.assert_allclose(of_a_ball, np.sum(r.depth[own] ** 1.5), rtol=1e-12)
        order = np.argsort(r.depth[own])
        when = np.interp(test.depth[mine], r.depth[own][order], (r.time[own] - r.time[0])[order])
        np.testing.assert_allclose(test.time[mine], when, rtol=0, atol=0.02)  # of 0.57 s a bin


@pytest.mark.parametrize("power", [1.3, 1.5, 2.0])
def test_a_bin_of_many_readings_lies_on_their_curve(power):
    """The mean force of 1500 readings is that at their depth: of a ball, and nearly so of others beyond the first."""
    u = np.linspace(0.0, 4.0, 20001)[1:]
    r = Repeat("1", u, u / 0.5, {"Fz": 0.04 * u**power}, {}, np.full(len(u), "loading"))
    (test,) = make_test_plan([toy.experiment("a", (r,))]).tests
    off = test.values["Fz"] / (0.04 * test.depth**power) - 1.0
    assert np.abs(off[1:]).max() < (1e-6 if power == 1.5 else 0.03)
    assert np.abs(off[4:]).max() < 3e-3
    np.testing.assert_allclose(off[0], 0.0, atol=1e-3 if power == 1.5 else 0.2)


def test_the_data_vector_holds_every_value_in_the_order_of_its_rows():
    plan = make_test_plan(toy.laboratory(toy.TRUTH, 0))
    y, used = plan.values(), np.zeros(plan.n, int)
    for item, c, at in plan.rows():
        np.testing.assert_array_equal(y[at], item.values[c])
        used[at] += 1
    assert len(y) == plan.n and np.all(used == 1)


def test_few_readings_are_bins_of_their_own():
    repeats = toy.recorded(toy.TRUTH, rng(), readings=9)
    (test,) = make_test_plan([toy.experiment("a", repeats)]).tests
    np.testing.assert_array_equal(test.values["Fz"], repeats[0].channels["Fz"])


def test_tests_come_in_the_order_of_testing_and_know_the_deepest_travel_before():
    second = toy.experiment("second", toy.recorded(toy.TRUTH, rng(), peak=3.0), after=("first",))
    first = toy.experiment("first", toy.recorded(toy.TRUTH, rng(), peak=5.0, repeats=2))
    elsewhere = toy.experiment("elsewhere", toy.recorded(toy.TRUTH, rng()), point=(10.0, 0.0), after=("first",))
    plan = make_test_plan([second, first, elsewhere])
    peak = {t.label + plan.experiments[t.experiment].name: t.earlier for t in plan.tests}
    assert peak["1first"] == 0.0 and peak["1elsewhere"] == 0.0
    np.testing.assert_allclose(peak["2first"], 5.0, atol=0.05)
    assert peak["1second"] == max(t.peak for t in plan.tests if plan.experiments[t.experiment].name == "first")


def test_an_experiment_that_comes_after_itself_is_refused():
    one = toy.experiment("one", toy.recorded(toy.TRUTH, rng()), after=("two",))
    two = toy.experiment("two", toy.recorded(toy.TRUTH, rng()), after=("one",))
    with pytest.raises(ValueError, match="comes after itself"):
        make_test_plan([one, two])


def test_experiments_of_equal_settings_share_a_place():
    a = toy.experiment("a", toy.recorded(toy.TRUTH, rng()), speed=0.5)
    b = toy.experiment("b", toy.recorded(toy.TRUTH, rng()), speed=0.5)
    b = dataclasses.replace(b, speed=5.0, settings={**b.settings, "speed": "5 mm/s", "unload": True})
    c = toy.experiment("c", toy.recorded(toy.TRUTH, rng()), point=(10.0, 0.0))
    plan = make_test_plan([a, b, c])
    assert [t.place for t in plan.tests] == [0, 0, 1] and len(plan.places) == 2
    assert all("speed" not in p.settings for p in plan.places)


def test_the_deepest_travel_is_rounded_so_that_data_sets_share_a_library():
    deepest = []
    for peak in (3.98, 4.0, 4.04):
        plan = make_test_plan([toy.experiment("a", toy.recorded(toy.TRUTH, rng(), peak=peak))])
        deepest.append(plan.places[0].deepest)
        assert plan.places[0].deepest % PLAN_DEPTH_STEP_MM == 0
        assert plan.places[0].deepest > peak - 0.25 * PLAN_DEPTH_STEP_MM
    assert len(set(deepest)) == 1


def test_a_hold_is_binned_along_the_logarithm_of_time():
    """All its readings count, at the depth where they were taken; its first bins are the shortest."""
    (r,) = toy.recorded(toy.TRUTH, rng(), hold=100.0)
    (t,) = make_test_plan([toy.experiment("a", (r,))]).tests
    assert t.count[t.held].sum() == np.sum(r.segment == "hold") and not t.returns
    np.testing.assert_allclose(t.since[t.held], t.time[t.held] - np.ptp(r.time[r.segment == "loading"]), rtol=1e-9)
    assert np.all(t.since[~t.held] == 0.0) and np.all(np.diff(t.count[t.held][1:]) >= 0)
    np.testing.assert_allclose(t.depth[t.held], 4.0, rtol=1e-9)


def test_time_in_a_hold_counts_from_where_the_machine_stopped_between_two_readings():
    """The last reading of a way there of 4 mm at 0.5 mm/s is left out: the machine stopped 0.1 s after the one before
    it, and rests for 10 s."""
    (r,) = toy.recorded(toy.TRUTH, rng(), hold=10.0, unload=True)
    top = int(np.argmax(r.segment != "loading")) - 1
    dropped = np.delete(np.arange(len(r.depth)), top)
    cut = dataclasses.replace(
        r,
        depth=r.depth[dropped],
        time=r.time[dropped],
        segment=r.segment[dropped],
        channels={c: v[dropped] for c, v in r.channels.items()},
    )
    (whole,), (test,) = (make_test_plan([toy.experiment("a", (v,))]).tests for v in (r, cut))
    # toy.recorded has no noise in its depths and times
    np.testing.assert_allclose(test.since[test.held], whole.since[whole.held], rtol=0.0, atol=1e-9)
    assert test.rest == pytest.approx(whole.rest, abs=1e-9)


@pytest.mark.parametrize("how", ["without times", "elsewhere"])
def test_holds_that_nobody_can_follow_are_left_out_and_said_so(how):
    (r,) = toy.recorded(toy.TRUTH, rng())
    segment = r.segment.copy()
    segment[-20:] = "hold"
    segment[-1] = "loading" if how == "elsewhere" else "hold"
    r = dataclasses.replace(r, segment=segment, time=None if how == "without times" else r.time)
    plan = make_test_plan([toy.experiment("a", (r,))])
    assert plan.tests[0].count.sum() == np.sum(segment == "loading") and not plan.tests[0].held.any()
    assert how in plan.notes[0] and f"{np.sum(segment == 'hold')} readings of a hold" in plan.notes[0]


def test_places_are_called_by_their_point_or_where_several_have_it_by_a_test():
    """Another ball at the same point, and settings of a backend that knows no points."""
    (r,) = toy.recorded(toy.TRUTH, rng())
    made = [toy.experiment("a", (r,)), toy.experiment("b", (r,), mesh="finer")]
    made.append(toy.experiment("c", (r,), point=(20.0, 2.5)))
    pointless = toy.experiment("d", (r,))
    made.append(dataclasses.replace(pointless, settings={"support": "held"}))
    labels = make_test_plan(made).labels()
    assert list(labels) == ["a", "b", "(20, 2.5)", "d"]
    assert list(labels.values()) == [p.settings for p in make_test_plan(made).places]


def test_a_tare_before_the_test_is_no_hold_in_it():
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True)
    top = int(np.argmax(r.depth)) + 1
    segment = np.array(["hold"] * 3 + ["loading"] * (top - 3) + ["unloading"] * (len(r.depth) - top))
    plan = make_test_plan([toy.experiment("a", (dataclasses.replace(r, segment=segment),))])
    assert np.any(plan.tests[0].branch == 1)


@pytest.mark.parametrize("seconds, kept", [(0.2, True), (30.0, True), (None, False)])
def test_the_way_back_after_a_hold_is_used_where_times_tell_how_long_it_was(seconds, kept):
    """What relaxes has done so in it; a dwell of 2 % of the loading is none."""
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True)
    top = int(np.argmax(r.depth)) + 1
    pause = np.linspace(0.0, seconds or 1.0, 5)[1:]
    put = lambda v: np.concatenate([v[:top], np.full(4, v[top - 1]), v[top:]])  # noqa: E731
    time = np.concatenate([r.time[:top], r.time[top - 1] + pause, r.time[top:] + pause[-1]])
    segment = np.array([*["loading"] * top, *["hold"] * 4, *["unloading"] * (len(r.depth) - top)])
    held = dataclasses.replace(
        r,
        depth=put(r.depth),
        time=None if seconds is None else time,
        segment=segment,
        channels={c: put(v) for c, v in r.channels.items()},
    )
    plan = make_test_plan([toy.experiment("a", (held,))])
    assert plan.tests[0].returns == kept and bool(plan.places[0].peaks) == kept
    assert any("unloading after a hold" in note for note in plan.notes) != kept
    assert plan.tests[0].count[plan.tests[0].held].sum() == (4 if seconds else 0)
    assert plan.tests[0].rest == pytest.approx(30.0 if seconds == 30.0 else 0.0, rel=0.01)


@pytest.mark.parametrize("pace, hold", [(1.0, 0.0), (1.05, 0.0), (3.0, 0.0), (0.4, 12.0)])
def test_rest_and_pace_of_the_way_back_are_those_of_the_record(pace, hold):
    """A speed that is nearly that of the way there is that; rest to 2 %, what the machine needs to turn is no rest."""
    repeats = toy.recorded(toy.TRUTH, rng(), unload=True, hold=hold, pace=pace)
    (test,) = make_test_plan([toy.experiment("a", repeats)]).tests
    assert test.rest == pytest.approx(hold, rel=0.02)
    assert test.pace == (1.0 if pace in (1.0, 1.05) else pytest.approx(pace, rel=0.03))


def test_a_pause_on_the_way_back_is_no_slow_way_and_air_before_contact_no_loading():
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True, hold=5.0)
    back = np.flatnonzero(r.segment == "unloading")
    paused = dataclasses.replace(r, time=r.time + 60.0 * (np.arange(len(r.time)) > back[len(back) // 2]))
    n, speed = 200, 0.5
    air = {c: np.concatenate([np.zeros(n), v]) for c, v in r.channels.items()}
    late = dataclasses.replace(
        r,
        depth=np.concatenate([np.linspace(-50.0, -0.1, n), r.depth]),
        channels=air,
        time=np.concatenate([np.linspace(0.0, 100.0, n), 100.1 + r.time]),
        segment=np.concatenate([["loading"] * n, r.segment]),
    )
    for record in (paused, late):
        (test,) = make_test_plan([toy.experiment("a", (record,), speed=speed)]).tests
        assert test.pace == 1.0 and test.rest == pytest.approx(5.0, rel=0.03)


@pytest.mark.parametrize("tared", [False, True])
def test_a_force_that_was_tared_at_contact_drifts_from_there(tared):
    """Else its drift would need an error of zero beside it, and be told as two effects."""
    (r,) = toy.recorded(toy.TRUTH, rng())
    n = 100
    late = dataclasses.replace(
        r,
        depth=np.concatenate([np.linspace(-5.0, -0.05, n), r.depth]),
        channels={c: np.concatenate([np.zeros(n), v]) for c, v in r.channels.items()},
        time=np.concatenate([np.linspace(0.0, 100.0, n), 101.0 + r.time - r.time[0]]),
        segment=np.concatenate([["loading"] * n, r.segment]),
        tared=tared,
    )
    (test,) = make_test_plan([toy.experiment("a", (late,))]).tests
    first = test.time[test.depth > 0.0][0]
    assert first == pytest.approx(0.0 if tared else 101.0, abs=1.0)  # half a bin; readings about contact lie 1 s apart


def test_rests_that_are_nearly_the_same_are_one_way():
    """Repeats of one programme rest and return as a machine can: one way there, one after an earlier test, and back."""
    programme = ((30.0, 0.8), (30.5, 0.79), (30.2, 0.82), (29.6, 0.81), (0.0, 1.0))
    every = [r for rest, pace in programme for r in toy.recorded(toy.TRUTH, rng(), unload=True, hold=rest, pace=pace)]
    plan = make_test_plan([toy.experiment("a", tuple(every))])
    assert len({(t.rest, t.pace) for t in plan.tests}) == 5
    back = [p for p in passes(plan, 0) if p.peak is not None]
    assert sorted((p.earlier > 0, p.rest > 0) for p in back) == [(False, True), (True, False), (True, True)]
    assert all(passes_of(passes(plan, 0), t)[1] != 0 for t in plan.tests)


def test_single_readings_out_of_line_are_left_out_and_said_so():
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True, readings=80)
    v = r.channels["Fz"].copy()
    v[[11, 30, 31]] += 40 * v.std(), -30 * v.std(), 1e5
    plan = make_test_plan([toy.experiment("a", (dataclasses.replace(r, channels={**r.channels, "Fz": v}),))])
    clean = make_test_plan([toy.experiment("a", (r,))])
    (note,) = plan.notes
    assert "repeat" in note and "3 reading(s) out of line" in note and clean.notes == ()
    # what is left lies within a bin's scatter of what was there before
    grid = np.linspace(0.3, 3.7, 20)
    curves = [
        np.interp(grid, t.depth[t.branch == 0], t.values["Fz"][t.branch == 0]) for p in (plan, clean) for t in p.tests
    ]
    np.testing.assert_allclose(curves[0], curves[1], rtol=0, atol=0.03 * curves[1].max())
    assert len(plan.experiments[0].measurement.repeats[0].depth) == len(r.depth) - 3  # noise is estimated without them


def test_a_jump_that_stays_is_no_spike():
    (r,) = toy.recorded(toy.TRUTH, rng(), readings=80)
    v = r.channels["Fz"].copy()
    v[40:] -= 20 * v.std()  # a slip
    assert (
        make_test_plan([toy.experiment("a", (dataclasses.replace(r, channels={**r.channels, "Fz": v}),))]).notes == ()
    )


def test_times_follow_from_the_speed_where_none_were_recorded():
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True)
    (with_time,) = make_test_plan([toy.experiment("a", (r,))]).tests
    (without,) = make_test_plan([toy.experiment("a", (dataclasses.replace(r, time=None),))]).tests
    # the turn lies between two readings, 0.1 s apart
    np.testing.assert_allclose(without.time - without.time[0], with_time.time - with_time.time[0], rtol=0, atol=0.1)


def test_a_profile_alone_is_no_diagnosis():
    u = np.array([1.0, 2.0])
    channels = {"x": np.zeros(2), "y": np.zeros(2), "uz": -u}
    r = Repeat("1", u, None, channels, {}, np.full(2, "loading"))
    with pytest.raises(ValueError, match="no force curve"):
        make_test_plan([toy.experiment("profile", (r,))])


# ------------------------------------------------------------------------------------------------------------ noise


def synthetic(
    n: int,
    seed: int,
    white: float = 2e-3,
    gain: float = 0.0,
    contact: float = 0.0,
    sd: float = 0.0,
    length: float = 1.0,
    shape=lambda u: 0.03 * u**1.5,
    readings: int = 120,
):
    """n repeats of one smooth curve with noise of known law."""
    g, repeats = rng(seed), []
    u = np.linspace(4 / readings, 4, readings)
    L = np.linalg.cholesky(sd**2 * np.exp(-np.abs(u[:, None] - u) / length) + 1e-18 * np.eye(readings))
    for k in range(n):
        F = (1 + gain * g.standard_normal()) * shape(np.maximum(u + contact * g.standard_normal(), 0.0))
        F = F + white * g.standard_normal(readings) + L @ g.standard_normal(readings)
        repeats.append(Repeat(str(k), u, u / 0.5, {"Fz": F}, {}, np.full(readings, "loading")))
    return [toy.experiment("a", tuple(repeats), noise=NOTHING)]


def level(experiments, channel: str = "Fz") -> noise.NoiseLevel:
    return noise.noise_levels(make_test_plan(experiments))[channel]


def test_white_noise_is_recovered_from_the_readings():
    found = [level(synthetic(4, k)).white for k in range(8)]
    np.testing.assert_allclose(np.mean(found), 2e-3, rtol=0.05)  # 8 · 4 · 117 third differences
    np.testing.assert_allclose(found, 2e-3, rtol=0.25)


def test_uncertainties_that_the_file_states_count_as_stated_noise():
    (e,) = synthetic(1, 0)
    (r,) = e.measurement.repeats
    told = dataclasses.replace(r, sigma={"Fz": np.full(len(r.depth), 0.02)})
    said = dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=(told,)))
    assert level([e]).white < 0.01 and abs(level([said]).white - 0.02) < 1e-12 and level([said]).source == "stated"
    tied = dataclasses.replace(said, noise=Noise(correlation=1.0))
    # bins of 0.3 mm hold nearly what readings do that remember each other over 1 mm
    assert 0.018 < level([tied]).correlated < 0.02 and level([tied]).white < 0.01


def test_white_noise_alone_is_neither_gain_nor_correlated():
    found = [level(synthetic(5, k)) for k in range(12)]
    assert np.mean([v.gain for v in found]) <= max(0.004, 1.001 * DIAGNOSIS_SETTINGS.noise.gain)
    assert sum(v.correlated > 0 for v in found) <= 2


@pytest.mark.parametrize("gain", [0.02, 0.06])
def test_scatter_of_the_gain_is_recovered(gain):
    found = [level(synthetic(16, k, gain=gain)).gain for k in range(6)]
    # a standard deviation from 15 degrees of freedom scatters by 18 %, the mean of six by 8 %
    np.testing.assert_allclose(np.mean(found), gain, rtol=0.25)


def test_scatter_of_the_contact_point_is_recovered():
    found = [level(synthetic(16, k, contact=0.08)).contact for k in range(6)]
    np.testing.assert_allclose(np.mean(found), 0.08, rtol=0.3)


def test_correlated_noise_is_recovered():
    found = [level(synthetic(24, k, white=5e-4, sd=4e-3, length=0.5)) for k in range(6)]
    # bins of 0.28 mm average some of it away, and two shapes are taken out as gain and contact
    np.testing.assert_allclose(np.mean([v.correlated for v in found]), 4e-3, rtol=0.35)
    assert 0.2 < np.mean([v.length for v in found]) < 1.2


def test_noise_does_not_know_what_a_model_would_say():
    """The same scatter on a curve that no model here follows gives the same noise: misfit is not noise."""
    plain = level(synthetic(8, 3, gain=0.03, contact=0.03))
    odd = level(synthetic(8, 3, gain=0.03, contact=0.03, shape=lambda u: 0.03 * u**1.5 * (1 + 0.3 * np.sin(u))))
    for name in ("white", "gain", "contact"):
        np.testing.assert_allclose(getattr(odd, name), getattr(plain, name), rtol=0.25)


def test_what_is_stated_is_the_least():
    (e,) = synthetic(4, 0)
    stated = dataclasses.replace(e, noise=Noise(Fz=0.01, gain=0.05, depth=0.02))
    found = level([stated])
    assert found.white >= 0.01 and found.gain >= 0.05 and found.contact >= 0.02 and found.source == "stated"


def test_softening_between_the_first_and_later_repeats_is_not_scatter():
    """A virgin test differs from those after it by an effect of the catalogue."""
    truth = {**toy.TRUTH, "soften": 0.3}
    e = toy.experiment("a", toy.recorded(truth, rng(1), repeats=5, scatter=0.0), noise=NOTHING)
    assert level([e]).gain <= DIAGNOSIS_SETTINGS.noise.gain and level([e]).contact <= DIAGNOSIS_SETTINGS.noise.contact


def test_a_few_noiseless_readings_still_have_a_covariance():
    """Nothing stated, too few readings to estimate from: the answer is humble, not an error."""
    u = np.linspace(0.5, 4, 8)
    r = Repeat("1", u, None, {"Fz": 0.03 * u**1.5}, {}, np.full(8, "loading"))
    e = toy.experiment("a", (r,), noise=NOTHING)
    assert level([e]).white > 0


def test_covariance_is_that_of_readings_with_such_noise():
    """White, correlated, gain and contact noise simulated reading by reading against the matrix, world error apart."""
    plan = make_test_plan(synthetic(2, 0))
    n, test = plan.n, plan.tests[0]
    q = noise.NoiseLevel(2e-3, 3e-3, 0.5, 0.03, 0.05, 0.01, "stated")
    F, slope = 0.03 * np.tile(test.depth, 2) ** 1.5, 0.045 * np.tile(test.depth, 2) ** 0.5
    library = type("L", (), {})()
    library.plan, library.base = plan, type("B", (), {"backend": None})()
    library.places = (type("P", (), {"u": np.array([0.0, 9.0]), "error": np.zeros((3, 2))})(),)
    C = noise.data_covariance(library, {"Fz": q}, F, slope)
    g, found = rng(5), []
    half = n // 2
    K = q.correlated**2 * np.exp(-np.abs(test.depth[:, None] - test.depth) / q.length)
    L = np.linalg.cholesky(K)
    growing = 0.015 * (np.tile(test.depth, 2) / plan.places[0].deepest) ** 8 * F
    world = np.linalg.cholesky(
        np.outer(growing, growing)
        + q.contact**2 * np.outer(slope, slope)
        + 0.005**2
        * np.outer(F, F)
        * np.exp(-0.5 * ((np.tile(test.depth, 2)[:, None] - np.tile(test.depth, 2)) / (0.35 * 4)) ** 2)
        + 1e-14 * np.eye(n)
    )
    for _ in range(20_000):
        parts = []
        for k in range(2):
            at = slice(k * half, (k + 1) * half)
            white = np.hypot(q.white, q.depth * slope[at]) / np.sqrt(test.count) * g.standard_normal(half)
            common = q.gain * F[at] * g.standard_normal() + q.contact * slope[at] * g.standard_normal()
            parts.append(white + common + L @ g.standard_normal(half))
        found.append(np.concatenate(parts) + world @ g.standard_normal(n))
    np.testing.assert_allclose(np.cov(np.array(found).T), C, rtol=0, atol=0.03 * C.max())


def test_a_path_is_not_read():
    """Experiments are data in memory: nothing is opened."""
    (e,) = synthetic(2, 0)
    gone = dataclasses.replace(e, measurement=Measurement(Path("/nowhere/at all"), "force", e.measurement.repeats, ()))
    assert level([gone]) == level([e])


@pytest.mark.parametrize("how", ["dense first", "through air", "a wait"])
def test_bins_lie_on_the_curve_however_unevenly_it_was_read(how):
    """Mean force over mean depth of a bin, against Hertz: its curvature costs 0.3 % of the largest force."""
    t = {
        "dense first": np.concatenate([np.linspace(0, 1, 2000), np.linspace(1.01, 8, 100)]),
        "through air": np.linspace(-20.0, 8.0, 1400),
        "a wait": np.linspace(-120.0, 8.0, 3000),
    }[how]
    depth = 0.5 * (np.maximum(t, 0.0) if how == "a wait" else t)
    force = 0.04 * np.maximum(depth, 0.0) ** 1.5
    r = Repeat("1", depth, t - t[0] + 1.7e9, {"Fz": force}, {}, np.full(len(t), "loading"))
    (test,) = make_test_plan([toy.experiment("a", (r,))]).tests
    pressing = test.depth > 0.01
    assert pressing.sum() >= 13 and np.sum(~pressing) <= 3
    want = 0.04 * test.depth[pressing] ** 1.5
    np.testing.assert_allclose(test.values["Fz"][pressing], want, rtol=0, atol=0.003 * force.max())
    assert test.time.min() < 130.0  # the clock of the machine says nothing


def test_a_way_back_that_has_hardly_begun_is_no_branch():
    (r,) = toy.recorded(toy.TRUTH, rng(), unload=True)
    few = int(np.argmax(r.depth)) + 6
    begun = dataclasses.replace(
        r,
        depth=r.depth[:few],
        time=r.time[:few],
        segment=r.segment[:few],
        channels={c: v[:few] for c, v in r.channels.items()},
    )
    plan = make_test_plan([toy.experiment("a", (begun,))])
    assert not plan.tests[0].returns and plan.places[0].peaks == () and "hardly begun" in plan.notes[0]
