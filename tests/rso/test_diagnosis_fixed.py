"""A diagnosis with a fixed parameter: fits, simulated data and reruns all keep to it, and the report says so."""

import dataclasses
import functools
import json

import diagnosis_backend as toy
import numpy as np
import pytest

from rso import discrepancy
from rso.contract import plain
from rso.discrepancy import (
    Base,
    BaseAxis,
    Library,
    build_library,
    corrected_library,
    diagnosis_data,
    finalists,
    make_test_plan,
)
from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.cross_validation import _at
from rso.discrepancy.evidence.gaussian_mixture import (
    mean_prediction,
    mixture_log_evidence,
    posterior,
    ready,
    whitened_draws,
)
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.parameters import _pressed

MU, D1 = toy.TRUTH["mu"], toy.TRUTH["D1"]
LOW, HIGH = 0.006, 0.024
NAMES = ("stiff", "soften", "bias")


def base(mu: float | None = None, D1: float | None = None) -> Base:
    """The base model with what is given fixed, else open: mu from LOW to HIGH, D1 from 15 to 150."""
    reference = mu or (LOW * HIGH) ** 0.5
    low, high = (mu, mu) if mu else (LOW, HIGH)
    κ = BaseAxis("D1", "1/MPa", 15.0 * low, 150.0 * high, True, -1)
    own = BaseAxis("mu", "MPa", low / 1.5, high * 1.5, True, 0)
    axes = (κ,) if D1 is None else () if mu else (own,)
    fixed = {k: v for k, v in (("mu", mu), ("D1", D1)) if v is not None}
    held = {"D1": -1} if D1 else {}
    return Base(toy.BACKEND, "mu", reference, low, high, axes, fixed, {}, held=held)


def experiments(seed: int, truth=None, **chain: float):
    """Repeats, a cycle, a deep curve to be held out, of little scatter in the gain."""
    rng, body = np.random.default_rng(seed), {**toy.TRUTH, **(truth or {})}
    chain = {"scatter": 0.002, **chain}
    noise = dataclasses.replace(toy.STATED, gain=0.002)
    deep = toy.recorded(body, rng, peak=6.0, earlier=4.0, **chain)
    cycle = toy.recorded(body, rng, unload=True, earlier=4.0, **chain)
    return [
        toy.experiment("load", toy.recorded(body, rng, repeats=3, **chain), noise=noise),
        toy.experiment("cycle", cycle, noise=noise, after=("load",)),
        toy.experiment("deep", deep, noise=noise, after=("cycle",)),
    ]


@functools.cache
def tables(of: tuple[float | None, float | None]) -> Library:
    return build_library(base(*of), make_test_plan(experiments(0)), toy.effects(*NAMES), toy.run)


def library(mu: float | None = None, D1: float | None = None, seed: int = 1, truth=None) -> Library:
    return dataclasses.replace(tables((mu, D1)), plan=make_test_plan(experiments(seed, truth)))


@functools.cache
def diagnosed(mu: float | None, D1: float | None, seed: int, truth: tuple[tuple[str, float], ...]):
    own = library(mu, D1, seed, dict(truth))
    return own, discrepancy.diagnose(own, seed, nulls=60)


def diagnose(mu: float | None = None, D1: float | None = None, seed: int = 1, truth=None):
    """Library and answer, made once and not to be changed."""
    return diagnosed(mu, D1, seed, tuple((truth or {}).items()))


def width(span: tuple[float, float, float]) -> float:
    return float(np.log(span[2] / span[0]))


FIXED = {"D1": (None, D1), "mu": (MU, None), "both": (MU, D1)}


# ---- what is simulated and fitted


@pytest.mark.parametrize("value", [0.3, 60.0, 400.0])
def test_simulations_have_the_fixed_value_at_every_modulus(value):
    """All runs are at the reference modulus μ₀, where a fixed D1 is D1 μ/μ₀."""
    own, seen = base(D1=value), []
    build_library(
        own, make_test_plan(experiments(0)), toy.effects("stiff"), lambda tasks: seen.extend(tasks) or toy.run(tasks)
    )
    κ = np.array([t.values["mu"] * t.values["D1"] for t in seen])
    assert {t.values["mu"] for t in seen} == {own.reference}
    np.testing.assert_allclose([κ.min(), κ.max()], [value * LOW / 1.5, value * HIGH * 1.5], rtol=1e-9)
    x = np.linspace(*own.axes[0].ends, 7)
    at = np.array([own.values((v,))["D1"] for v in x]) * own.reference / own.moduli(x[:, None])
    np.testing.assert_allclose(at, value, rtol=1e-12)


@pytest.mark.parametrize("effects", [(), ("stiff",), ("soften", "bias")])
def test_every_draw_of_every_fit_keeps_the_fixed_value(effects):
    """And its forces are those of that value: a tile is linear, so that half its width is 0.3 % off."""
    own = library(D1=D1, truth={"stiff": 0.4})
    y = own.plan.values()
    evidence = Evidence(attribution.set_up(own, y), own.effects)
    chosen = [e for e in own.effects if e.name in effects]
    h = evidence.ready(chosen)
    post = posterior(h, h.white(y), 300, np.random.default_rng(0))
    found = [own.base.values(x[:1])["D1"] * own.base.reference / m for x, m in zip(post.at, post.modulus, strict=True)]
    np.testing.assert_allclose(found, D1, rtol=1e-12)
    assert np.ptp(post.modulus) > 0
    linear = (np.einsum("mk,mkq->mq", post.local, h.X[post.tile]) + h.c[post.tile]) @ h.Q.T @ h.white.L.T
    A, c = predict(own, chosen, post.at, evidence.bench.modulus)
    direct = post.modulus[:, None] * A + c
    off = np.sqrt(np.mean((linear - direct) ** 2)) / np.max(np.abs(direct))
    assert off < (0.003 if not chosen else 0.02)


def test_simulated_nulls_are_of_the_fixed_value():
    """Fitted with D1 open they scatter around it as the data themselves do; a wrong value would be found as such."""
    for of, right in ((D1, True), (1.0, False)):
        own, free = library(D1=of), library()
        y = own.plan.values()
        mine = Evidence(attribution.set_up(own, y), own.effects)
        other = Evidence(attribution.set_up(free, y), free.effects)
        Y = attribution.nulls(mine, y, 30, 4)
        h = other.ready(())
        posts = [posterior(h, h.white(v), 60, np.random.default_rng(k)) for k, v in enumerate(Y)]
        found = np.array([np.median(np.exp(p.at[:, 0]) / p.modulus) for p in posts])
        assert bool(0.6 * D1 < np.median(found) < 1.6 * D1) is right, found


# ---- what is found


@pytest.mark.parametrize("of", FIXED)
def test_with_the_true_value_fixed_the_cause_is_found_and_the_rest_is_known_no_worse(of):
    """Its size and the modulus too: an interval of 90 % holds the truth, widened by half on each side always."""
    truth = {"soften": 0.25}
    _, free = diagnose(truth=truth)
    _, d = diagnose(*FIXED[of], truth=truth)
    assert d.named == ("soften",) and d.verdict in ("explained", "partly")
    (size,) = (c for c in d.causes if c.effect.name == "soften")
    low, high = size.interval
    assert 1.5 * low - 0.5 * high < 0.25 < 1.5 * high - 0.5 * low
    after = d.parameters["after"]
    assert set(after) == {"mu", "D1"} - ({"mu", "D1"} if of == "both" else {of})
    for name, span in after.items():
        value = toy.TRUTH[name]
        assert span[0] / 1.02 < value < span[2] * 1.02, (name, span)
        assert width(span) <= 1.02 * width(free.parameters["after"][name])
    if of == "D1":
        assert width(after["mu"]) < 0.8 * width(free.parameters["after"]["mu"])


def test_a_wrong_value_is_a_bias_or_a_gap_and_no_error():
    """A hundredth of the true D1 misses a tenth of the force at depth."""
    _, right = diagnose(D1=D1)
    own, wrong = diagnose(D1=1.0)
    low, _, high = wrong.parameters["before"]["mu"]
    assert right.verdict == "no_gap" and right.parameters["before"]["mu"][0] < MU < right.parameters["before"]["mu"][2]
    assert wrong.verdict != "no_gap" and not low < MU < high
    assert diagnosis_data(own, wrong, (), toy.run, "toy")["words"]


def test_a_modulus_far_outside_its_range_is_said_and_no_error():
    """Three times the range is beyond all simulations with a fixed D1, and is what the fit runs up against."""
    own, d = diagnose(D1=D1, truth={"mu": 3.0 * HIGH})
    found = diagnosis_data(own, d, (), None, "toy")
    assert d.parameters["before"]["mu"][1] > HIGH
    assert any("lies outside the range of the study" in w for w in found["words"])


def test_a_cause_is_computed_anew_with_the_fixed_value():
    own, d = diagnose(D1=D1, truth={"soften": 0.25})
    picks, seen = finalists(own, d), []
    assert [e.name for e in picks] == ["soften"]
    _, check = corrected_library(own, picks, lambda tasks: seen.extend(tasks) or toy.run(tasks))
    (at,) = picks.values()
    np.testing.assert_allclose([t.values["D1"] * t.values["mu"] for t in seen], D1 * np.exp(at[0]), rtol=1e-9)
    assert check.failed == 0 and check.rms < 0.01


# ---- what is said


@pytest.mark.parametrize("of", FIXED)
def test_what_is_fixed_is_said_and_has_no_interval(of):
    own, d = diagnose(*FIXED[of], truth={"soften": 0.25})
    found = json.loads(json.dumps(plain(diagnosis_data(own, d, (), None, "toy"))))
    held = {k: toy.TRUTH[k] for k in (("mu", "D1") if of == "both" else (of,))}
    assert found["fixed"] == held and not held.keys() & found["diagnosis"]["parameters"]["after"].keys()
    (said,) = (w for w in found["words"] if w.startswith("Fixed by the study"))
    told = {"mu": f"mu = {1e3 * toy.TRUTH['mu']:.4g} kPa", "D1": f"D1 = {toy.TRUTH['D1']:.4g} MPa⁻¹"}
    assert all(told[k] in said for k in held)
    assert not any(f"{k} moves" in w for k in held for w in found["words"])


# ---- a range


def ranged(low: float, high: float, keep: bool = True) -> Library:
    """The open base with another range of D1; its simulations are those of the wide one."""
    own = library(truth={"soften": 0.25})
    (κ,) = own.base.axes
    axis = dataclasses.replace(κ, kept=(low, high) if keep else None)
    return dataclasses.replace(own, base=dataclasses.replace(own.base, axes=(axis,)))


@pytest.mark.parametrize(
    ("low", "high"),
    [(40.0, 90.0), *(pytest.param(15.0, high, marks=pytest.mark.verification) for high in (25.0, 150.0))],
)
def test_fits_keep_to_the_range_of_a_parameter_whatever_the_modulus(low, high):
    """Its product with the modulus spans four times as much, and without it they leave the range."""
    own = ranged(low, high)
    d = discrepancy.diagnose(own, 1, nulls=60)
    for post in d.posteriors.values():
        found = np.exp(post.at[:, 0]) / post.modulus
        assert low * (1 - 1e-9) <= found.min() and found.max() <= high * (1 + 1e-9)
    if low < D1 < high:
        assert d.named == ("soften",)
        span = d.parameters["after"]["D1"]
        assert span[0] < D1 < span[2]
        free = discrepancy.diagnose(ranged(low, high, keep=False), 1, nulls=60).parameters["after"]["D1"]
        assert width(span) <= 1.05 * width(free)
    free = discrepancy.diagnose(ranged(low, high, keep=False), 1, nulls=60).posteriors["none"]
    assert np.max(np.exp(free.at[:, 0]) / free.modulus) > high
    assert (d.verdict == "explained") is (low < D1 < high)  # what a range keeps out is sought elsewhere


def test_forces_of_a_fit_that_keeps_to_a_range_are_those_of_its_draws():
    """Where the modulus is not that of the tiles by a tenth and more, too: it takes the product along."""
    own = ranged(15.0, 150.0)
    evidence = Evidence(attribution.set_up(own, own.plan.values()), own.effects)
    tiles = dataclasses.replace(evidence.ready(()).tiles)
    for share in (0.85, 1.2):
        white = evidence.ready(()).white
        h = ready(tiles, white, evidence.bench.modulus)
        A, c = predict(own, (), tiles.at + np.log(share), evidence.bench.modulus)
        direct = share * evidence.bench.modulus * A + c
        linear = (share * h.X[:, 0] + h.c) @ h.Q.T @ white.L.T
        fixed = share * (evidence.bench.modulus * tiles.lift(tiles.A)) + tiles.lift(tiles.c)
        off, without = (np.max(np.abs(v - direct)) / np.max(np.abs(direct)) for v in (linear, fixed))
        assert off < 0.002 and without > 4 * off, (off, without)


def pressed(low: float, high: float, truth=None):
    """What a fit of the base model to data of D1 = 60 keeps to a range: tiles, and sums over a grid of mu and D1."""
    own = library(truth=truth)
    axis = dataclasses.replace(own.base.axes[0], kept=(low, high))
    own = dataclasses.replace(own, base=dataclasses.replace(own.base, axes=(axis,)))
    evidence = Evidence(attribution.set_up(own, own.plan.values()), own.effects)
    h = evidence.ready(())
    y = h.white(own.plan.values())
    post = posterior(h, y, 2000, np.random.default_rng(0))
    μ = np.linspace(0.95 * post.modulus.min(), 1.05 * post.modulus.max(), 300)
    D = np.exp(np.linspace(np.log(low), np.log(high), 121))
    logs = np.empty((len(μ), len(D)))
    for k, m in enumerate(μ):
        A, c = predict(own, (), np.log(m * D)[:, None], evidence.bench.modulus)
        logs[k] = -0.5 * np.sum((y - h.white(m * A + c)) ** 2, axis=1)
    return h, y, post, μ, D, logs


@pytest.mark.parametrize(
    ("low", "high", "truth"),
    [(15.0, 150.0, None), (1.0, 20.0, None), (1.0, 20.0, "stiff"), (15.0, 150.0, "soften"), (90.0, 3000.0, None)],
)
def test_a_range_is_a_wall_for_evidence_and_draws(low, high, truth):
    """Against sums over a fine grid, where the data want D1 inside the range or far beyond; mu goes with D1."""
    h, y, post, μ, D, logs = pressed(low, high, truth and {truth: {"stiff": 0.4, "soften": 0.25}[truth]})
    w = np.exp(logs - logs.max())
    cell = (μ[1] - μ[0]) / h.scale / len(D)
    direct = np.log(np.sum(w) * cell) + logs.max() - 0.5 * h.white.log_det - 0.5 * len(y) * np.log(2 * np.pi)
    assert abs(mixture_log_evidence(h, y[None])[0] - direct) < 0.9  # tiles are linear, and thinner at a wall
    own = np.exp(post.at[:, 0]) / post.modulus
    for found, at, weight in ((post.modulus, μ, w.sum(axis=1)), (own, D, w.sum(axis=0))):
        below = np.cumsum(weight) / weight.sum()
        want = np.interp([0.05, 0.5, 0.95], below, at)
        np.testing.assert_allclose(np.quantile(found, [0.05, 0.5, 0.95]), want, rtol=0.005 if at is μ else 0.04)
    left = np.sum((y - mean_prediction(h, y)) ** 2)
    assert left > -2.0 * logs.max() - 0.5 - 0.02 * left
    m = whitened_draws(h, post, np.random.default_rng(1)).mean(axis=0) - mean_prediction(h, y)
    assert np.max(np.abs(m)) < 5.0 / np.sqrt(len(post.tile)) * 1.5


@pytest.mark.parametrize(("median", "pressed"), [(15.2, True), (16.5, False), (60.0, False), (149.0, True)])
def test_a_parameter_at_the_end_of_its_range_is_said(median, pressed):
    now = {"D1": {"low": median, "median": median, "high": median}}
    said = _pressed({"parameters": {"after": now}}, {"ranges": {"D1": [15.0, 150.0]}, "units": {"D1": "1/MPa"}})
    assert len(said) == pressed and all("15 to 150 MPa⁻¹" in w for w in said)
    assert _pressed({"parameters": {"after": now}}, {}) == []


@pytest.mark.parametrize(
    ("low", "high", "pressed"), [(80.0, 149.5, True), (20.0, 149.5, False), (15.1, 40.0, True), (80.0, 130.0, False)]
)
def test_an_interval_that_ends_where_the_range_does_and_starts_in_its_far_half_is_pressed(low, high, pressed):
    """One that reaches from end to end is not: it says that the parameter is not determined."""
    now = {"D1": {"low": low, "median": (low * high) ** 0.5, "high": high}}
    said = _pressed({"parameters": {"after": now}}, {"ranges": {"D1": [15.0, 150.0]}, "units": {"D1": "1/MPa"}})
    assert len(said) == pressed


def test_a_wide_range_changes_nothing_but_the_tiles():
    """The modulus takes D1's product along in every tile: the same body, in other coordinates."""
    free, kept = (discrepancy.diagnose(ranged(15.0, 150.0, k), 1, nulls=60) for k in (False, True))
    assert kept.verdict == free.verdict and kept.named == free.named
    for k in ("mu", "D1"):
        np.testing.assert_allclose(kept.parameters["after"][k], free.parameters["after"][k], rtol=0.15)
    np.testing.assert_allclose(kept.causes[0].size, free.causes[0].size, rtol=0.05)
    np.testing.assert_allclose(kept.left, free.left, rtol=0.05)


@pytest.mark.parametrize(
    ("of", "found"), [((MU, None), {"D1": D1}), ((None, D1), {"mu": MU}), ((None, None), {"mu": MU, "D1": D1})]
)
def test_the_model_before_has_what_is_fixed_beside_what_a_run_found(of, found):
    """At the truth it leaves noise, whatever is fixed; at twice of it more; outside the library it is not known."""
    lib = library(*of)
    y = lib.plan.values()
    bench = attribution.set_up(lib, y)
    (name, *_), white = found, bench.whites[0]

    def left(values):
        f = _at(lib, values, bench.modulus)
        return None if f is None else float(np.mean(white(y - f) ** 2))

    assert left(found) < 1.25 < left({**found, name: 2.0 * found[name]})
    if of[0] or of[1]:
        assert left({**found, name: 100.0 * found[name]}) is None
