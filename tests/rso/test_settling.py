"""What an identification says near walls, where surrogates are poor, and where simulations do not confirm them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration import confirmed_optimum, identification_stage, readings
from rso.calibration.confirmed_optimum import ConfirmedOptimum
from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation.emulator import Output, Sample, learn_emulator
from rso.inference import Data, Misfit, Model, determine

BOX = Box(("a", "b"), ("", ""), (0.0, 0.0), (1.0, 1.0), (False, False))
AT = np.linspace(0.1, 1.0, 10)


def line(wall=None):
    """y = a + b u at u, truth (0.4, 0.5), without noise; σ = 0.1."""
    data = Data("line", "N", AT, 0.4 + 0.5 * AT, 0.1**2 * np.eye(len(AT)))
    return Misfit(Model(BOX, lambda X: X[:, :1] + X[:, 1:] * AT), (data,), wall=wall)


def ends(misfit, k):
    i = determine(misfit, seed=0, mcmc=False).known[k].profile_interval
    return np.array([i.low, i.high])


def brute(misfit, k, allowed):
    """Ends by a grid of 400² points."""
    t = (np.arange(400) + 0.5) / 400
    X = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    S = np.where(allowed(X), misfit.chi2(X), np.inf).reshape(400, 400).min(axis=1 - k)
    return t[S <= S.min() + 2.7055][[0, -1]]


@pytest.mark.parametrize("most", [0.45, 0.35])
def test_intervals_end_at_a_wall(most):
    """a ≤ 0.45 cuts the interval, a ≤ 0.35 leaves the best fit beyond it too; b follows.  A grid is 1/400 wide.
    Negative control: without the wall the ends of a are far off."""
    walled = line(lambda X: X[:, :1] - most)
    for k in (0, 1):
        exact = brute(line(), k, lambda X: X[:, 0] <= most)
        np.testing.assert_allclose(ends(walled, k), exact, atol=6e-3)
    assert ends(line(), 0)[1] > most + 0.05
    assert determine(walled, seed=0, mcmc=False).fit.x[0] <= most + 1e-3


def test_draws_stay_within_a_wall():
    draws = determine(line(lambda X: X[:, :1] - 0.4), seed=0).draws
    assert draws.X[:, 0].max() < 0.4 + 1e-3


def test_a_wall_that_is_kept_changes_nothing():
    plain, walled = (determine(line(w), seed=0, mcmc=False) for w in (None, lambda X: X[:, :1] - 2.0))
    np.testing.assert_allclose(walled.fit.x, plain.fit.x, atol=1e-9)
    np.testing.assert_array_equal(walled.fit.jacobian, plain.fit.jacobian)


@pytest.mark.parametrize("tolerance, poor", [(0.02, True), (0.2, False)])
def test_what_a_surrogate_may_miss_is_a_share_of_the_spread_whatever_the_level(monkeypatch, tolerance, poor):
    """A parabola of spread 1 on a level of 1e5 by a straight line: 7 % of the spread, 1e-6 of the level."""
    box, out = Box(("x",), ("",), (0.0,), (1.0,), (False,)), Output("e", "Fz", 1.0, "N")
    samples = [Sample({"x": x}, {out.id: 1e5 + x**2}) for x in np.linspace(0.0, 1.0, 9)]
    emulator = learn_emulator(
        box, Group(None, 1.0, {}, {"Fz": 0}, ""), [out], samples, kind="polynomial", seed=0, degree=1
    )
    monkeypatch.setattr(confirmed_optimum, "_fitted", lambda plan: [("e", "Fz")])
    plan = SimpleNamespace(study=SimpleNamespace(surrogate=SimpleNamespace(tolerance=tolerance)))
    assert bool(confirmed_optimum._poor(plan, emulator)) is poor


@pytest.mark.parametrize(
    ("settled", "word", "why"),
    [
        (ConfirmedOptimum(None, (), 0.001, 1.0, True), "determined", ""),
        (ConfirmedOptimum(None, (), 0.001, 1.0, True, ("a = 0.1",)), "weakly", "well enough to exclude"),
        (ConfirmedOptimum(None, (), 0.1, 1.0, False), "not", "do not confirm"),
        (ConfirmedOptimum(None, (), None, None, False), "not", "has no answer"),
        (ConfirmedOptimum(None, (), 0.001, 1.0, True, chi2_bare=900.0, p_bare=1e-9), "weakly", "hides a misfit"),
        (ConfirmedOptimum(None, (), 0.001, 1.0, True, chi2_bare=1.0, p_bare=0.5), "determined", ""),
    ],
)
def test_nothing_is_determined_that_simulations_do_not_confirm(settled, word, why):
    d = determine(dataclasses.replace(line(), scale=0.1), seed=0, mcmc=False)
    assert [k.verdict.word for k in d.known] == ["determined"] * 2
    for k in identification_stage.doubted(d, settled).known:
        assert k.verdict.word == word and why in k.reason
        assert k.story.startswith(
            f"{k.name} is {word.replace('weakly', 'weakly determined').replace('not', 'not determined')}"
        )


def test_conditions_between_parameters_hold_for_what_is_identified(tmp_path):
    """What the data like best, mu D1 = 0.5, is not allowed: the most likely values lie where 0.4 is reached, to 1e-3
    of the range of mu D1, and are run there."""
    (tmp_path / "top.csv").write_text(studies.measured(noise=1e-3))
    noise = studies.SECTIONS["[experiments]"].replace("0.02 mN", "1 mN")
    found = studies.run(tmp_path, experiments=noise, doe='runs = 16\nheld_out = 0\nconstraints = ["mu*D1 <= 0.4"]')
    values = found["identification"]["values"]
    assert values["mu"] * values["D1"] == pytest.approx(0.4, abs=3e-3)
    last = [r for r in found["runs"] if r["purpose"] == "identified"][-1]
    assert last["values"] == pytest.approx(values, rel=0.02)


def test_where_surrogates_are_good_nothing_more_is_run(tmp_path):
    (tmp_path / "top.csv").write_text(studies.measured(noise=5e-3))
    noise = studies.SECTIONS["[experiments]"].replace("0.02 mN", "5 mN")
    found = studies.run(tmp_path, experiments=noise, doe="runs = 8\nheld_out = 0", surrogate='kind = "kriging"')
    assert not [r for r in found["runs"] if r["purpose"] == "interval"]


def test_what_poor_surrogates_cannot_exclude_is_run(tmp_path, monkeypatch):
    """A surrogate that says it may be off by ten times the noise: points are run, and if that does not help nothing is
    called determined."""
    (tmp_path / "top.csv").write_text(studies.measured(noise=1e-3))
    noise = studies.SECTIONS["[experiments]"].replace("0.02 mN", "1 mN")
    known = confirmed_optimum.spread_of

    def unsure(emulator, place, X):
        sd, R = known(emulator, place, X)
        return sd + 0.01, R

    monkeypatch.setattr(confirmed_optimum, "spread_of", unsure)
    found = studies.run(tmp_path, experiments=noise, doe="runs = 8\nheld_out = 0")
    assert (
        0
        < len([r for r in found["runs"] if r["purpose"] == "interval"])
        <= confirmed_optimum.MAX_INTERVAL_END_ROUNDS * 4
    )
    assert any("not accurate enough for these data" in w and "cannot exclude" in w for w in found["warnings"])
    assert not any(v["determined"] for v in found["determined"].values())


@pytest.mark.parametrize("band_N", [0.0, 0.02])
def test_a_misfit_that_only_surrogates_could_explain_is_no_fit(tmp_path, monkeypatch, band_N):
    """A wave of five times the noise: refuted where surrogates are sure; where they say that they may be off by more
    than it the recomputed curve tells that the readings themselves are missed, and nothing is determined."""
    u, force = np.loadtxt(studies.measured(noise=0.0).splitlines(), delimiter=",", skiprows=1).T
    wavy = force + 5e-3 * np.sin(6 * u)
    text = "depth_mm,Fz_N\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), wavy.tolist(), strict=True))
    (tmp_path / "top.csv").write_text(text)
    noise = studies.SECTIONS["[experiments]"].replace("0.02 mN", "1 mN")
    known = confirmed_optimum.emulated

    def unsure(emulator, place):
        model, band = known(emulator, place)
        return model, lambda x: band(x) + band_N * np.sin(6 * place.depth)

    for room in (confirmed_optimum, readings):
        monkeypatch.setattr(room, "emulated", unsure)
    found = studies.run(tmp_path, experiments=noise, doe="runs = 8\nheld_out = 0", surrogate='kind = "kriging"')
    known, again = found["identification"], found["identification"]["recomputed"]
    assert again["p_value_bare"] < 1e-3
    if band_N:
        assert known["p_value"] is None and "Whether the model fits is undecided" in known["story"]
        assert any("hether the model fits is undecided" in w for w in found["warnings"])
        assert again["chi2"] < 0.3 * again["chi2_bare"]
        assert not any(v["determined"] for v in found["determined"].values())
    else:
        assert known["p_value"] < 1e-3 and "misses the data" in known["story"]
