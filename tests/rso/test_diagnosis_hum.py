"""A periodic disturbance is found with its frequency and amplitude; scatter, a bend, a trend are none."""

import dataclasses

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import butter, lfilter

from rso.data import Repeat
from rso.discrepancy import make_test_plan
from rso.discrepancy.detectors.periodic import periodic_line


def plan_with(change, seed: int = 0, repeats: int = 5, readings: int = 60):
    rng = np.random.default_rng(seed)
    recorded = toy.recorded(toy.TRUTH, rng, readings=readings, repeats=repeats)
    new = [
        dataclasses.replace(r, channels={**r.channels, "Fz": change(r.time, r.channels["Fz"], rng)}) for r in recorded
    ]
    return make_test_plan([toy.experiment("a", tuple(new))])


def white(recorded) -> float:
    """Standard deviation of neighbouring readings' scatter."""
    return float(np.std(np.diff(recorded, 3)) / np.sqrt(20))


@pytest.mark.parametrize("cycles", [5.3, 9.0, 17.0])
def test_a_hum_of_the_size_of_the_scatter_is_found(cycles):
    seen = {}

    def swing(t, F, rng):
        period = np.ptp(t) / cycles
        seen["f"], seen["a"] = 1 / period, 1.7 * white(F)
        return F + seen["a"] * np.sin(2 * np.pi * t / period + rng.uniform(0, 6))

    found = periodic_line(plan_with(swing))
    assert found.there and found.channel == "Fz"
    # the spectrum resolves 1 / duration; five records of one size fix the amplitude to about a tenth
    np.testing.assert_allclose(found.frequency, seen["f"], atol=0.5 * seen["f"] / cycles)
    np.testing.assert_allclose(found.amplitude, seen["a"], rtol=0.35)


FILTERS = {
    "Butterworth 0.05": lambda v: lfilter(*butter(2, 0.05), v),
    "Butterworth 0.02": lambda v: lfilter(*butter(2, 0.02), v),
    "Gauss 10": lambda v: gaussian_filter1d(v, 10),
    "mean of 10": lambda v: uniform_filter1d(v, 10),
}


@pytest.mark.parametrize("how", FILTERS)
@pytest.mark.parametrize("repeats", [1, 5])
def test_what_an_amplifier_lets_pass_is_no_hum(how, repeats):
    """Filtered scatter of 300 readings towers over the median of its spectrum by decades."""
    u = np.linspace(0.0, 4.0, 301)[1:]
    for seed in range(4):
        rng, records = np.random.default_rng(seed), []
        for k in range(repeats):
            v = FILTERS[how](rng.standard_normal(2300))[2000:]
            F = 0.04 * u**1.5 + 3e-3 * v / v.std()
            records.append(Repeat(str(k), u, u / 0.5, {"Fz": F}, {}, np.full(len(u), "loading")))
        assert not periodic_line(make_test_plan([toy.experiment("a", tuple(records))])).there


def test_a_hum_is_found_beside_what_a_filter_lets_pass():
    u = np.linspace(0.0, 4.0, 301)[1:]
    rng, records = np.random.default_rng(0), []
    for k in range(5):
        v = FILTERS["Butterworth 0.05"](rng.standard_normal(2300))[2000:]
        F = 0.04 * u**1.5 + 3e-3 * v / v.std() + 3e-3 * np.sin(2 * np.pi * 3.0 * u / 0.5 + rng.uniform(0, 6))
        records.append(Repeat(str(k), u, u / 0.5, {"Fz": F}, {}, np.full(len(u), "loading")))
    found = periodic_line(make_test_plan([toy.experiment("a", tuple(records))]))
    assert found.there
    np.testing.assert_allclose(found.frequency, 3.0, atol=0.1)  # 1 / (8 s) is resolved


def coloured(t, F, rng, ρ=0.8):
    e = rng.standard_normal(len(t))
    for k in range(1, len(t)):
        e[k] = ρ * e[k - 1] + np.sqrt(1 - ρ**2) * e[k]
    return F + 0.02 * F.max() * e


@pytest.mark.parametrize("change", [lambda t, F, rng: F, coloured, lambda t, F, rng: F * (1 + 0.2 * t / t.max())])
def test_scatter_and_bends_are_no_hum(change):
    assert not any(periodic_line(plan_with(change, seed)).there for seed in range(25))


def test_too_few_readings_say_nothing():
    found = periodic_line(plan_with(lambda t, F, rng: F, readings=12))
    assert found.log10_p == 0.0 and not found.there


@pytest.mark.parametrize("clock", [lambda t: np.floor(t), lambda t: t - t, lambda t: t + 3600.0 * (t > t.mean())])
def test_a_coarse_or_broken_clock_says_nothing_and_breaks_nothing(clock):
    rng = np.random.default_rng(0)
    recorded = [dataclasses.replace(r, time=clock(r.time)) for r in toy.recorded(toy.TRUTH, rng, readings=60)]
    assert not periodic_line(make_test_plan([toy.experiment("a", tuple(recorded))])).there


def test_a_fast_recorder_is_averaged_and_a_hum_still_found():
    def swing(t, F, rng):
        return F + 1.7 * white(F) * np.sin(2 * np.pi * 7.0 * t / np.ptp(t) + rng.uniform(0, 6))

    assert periodic_line(plan_with(swing, readings=20_000, repeats=2)).there


def speeds_with(change):
    """Cycles at three speeds, `change` of travel and force put on."""
    rng = np.random.default_rng(3)
    experiments = []
    for name, v in (("slow", 0.15), ("middle", 0.5), ("fast", 1.5)):
        recorded = toy.recorded(toy.TRUTH, rng, speed=v, unload=True, repeats=2)
        new = [dataclasses.replace(r, channels={"Fz": change(r.depth, r.channels["Fz"])}) for r in recorded]
        experiments.append(toy.experiment(name, tuple(new), speed=v))
    return make_test_plan(experiments)


def test_what_is_periodic_in_travel_is_found_at_all_speeds_together():
    period = 0.45
    swing = lambda u, F: F + 1.2 * toy.WHITE * np.sin(2 * np.pi * u / period)  # noqa: E731
    found = periodic_line(speeds_with(swing))
    assert found.there and found.along == "travel"
    np.testing.assert_allclose(found.frequency, 1 / period, rtol=0.03)  # a branch is 9 periods long
    assert not periodic_line(speeds_with(lambda u, F: F)).there


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1])
def test_the_steps_of_an_encoder_are_no_hum(step):
    """Over depths that stand still the force is a saw-tooth; the control: taken as they are these are a line."""
    rng = np.random.default_rng(1)
    recorded = toy.recorded(toy.TRUTH, rng, readings=480, repeats=3)
    coarse = [dataclasses.replace(r, depth=np.round(r.depth / step) * step) for r in recorded]
    assert not periodic_line(make_test_plan([toy.experiment("a", tuple(coarse))])).there


def test_the_steps_of_an_encoder_would_be_a_hum(monkeypatch):
    recorded = toy.recorded(toy.TRUTH, np.random.default_rng(1), readings=480, repeats=3)
    coarse = [dataclasses.replace(r, depth=np.round(r.depth / 0.1) * 0.1) for r in recorded]
    monkeypatch.setattr("rso.discrepancy.detectors.periodic._levels", lambda depth: None)
    assert periodic_line(make_test_plan([toy.experiment("a", tuple(coarse))])).there


def test_without_times_a_line_over_the_travel_is_found_and_scatter_is_none():
    """A spindle of 0.4 mm a turn shows in files without a clock too."""
    u = np.linspace(0.0, 4.0, 301)[1:]
    for amplitude in (0.0, 3e-3):
        rng, records = np.random.default_rng(1), []
        for k in range(3):
            F = 0.04 * u**1.5 + 3e-3 * rng.standard_normal(300) + amplitude * np.sin(2 * np.pi * u / 0.4 + k)
            records.append(Repeat(str(k), u, None, {"Fz": F}, {}, np.full(300, "loading")))
        found = periodic_line(make_test_plan([toy.experiment("a", tuple(records))]))
        assert found.there == (amplitude > 0.0)
        if found.there:
            assert found.along == "travel"
            np.testing.assert_allclose(found.frequency, 2.5, atol=0.1)
