"""Profile intervals of quantities that follow from the parameters, and the constants of elasticity."""

import numpy as np
import pytest
import soft_ball
from scipy import stats
from test_identify import curve, linear

from fem_backend.adapter.derived import derived
from rso import inference
from rso.doe import Box
from rso.inference import Misfit
from rso.inference.derived import DerivedInterval, derived_interval, is_known, rests_on
from rso.inference.verdict import judge_parameter

A = np.random.default_rng(5).standard_normal((12, 3))
x0 = np.array([0.5, 0.45, 0.55])


def test_a_linear_quantity_has_the_interval_of_theory():
    """y = A x + e, e ~ N(0, σ²): q = c·x has x̂·c ± z √(cᵀ (AᵀA)⁻¹ c) σ, far from any bound."""
    σ, c = 0.02, np.array([1.0, -2.0, 0.5])
    y = A @ x0 + σ * np.random.default_rng(1).standard_normal(12)
    d = inference.determine(Misfit(linear(A), (curve(y, sigma=σ),)), seed=0, mcmc=False)
    i = derived_interval(d, lambda X: X @ c)
    best = np.linalg.lstsq(A, y, rcond=None)[0]
    half = stats.norm.ppf(0.95) * σ * np.sqrt(c @ np.linalg.solve(A.T @ A, c))
    # χ² is widened where it is large; the seed's is not
    assert d.wider == 1.0 and not i.low_by and not i.high_by
    np.testing.assert_allclose([i.low, i.high], best @ c + half * np.array([-1, 1]), rtol=1e-4)
    assert i.value == pytest.approx(best @ c, rel=1e-6)


def test_a_quantity_that_is_a_parameter_has_its_interval():
    d = inference.determine(ball(), seed=0, mcmc=False)
    box = soft_ball.BOX
    for k, known in enumerate(d.known):
        i = derived_interval(d, lambda X, k=k: box.from_unit(X)[:, k])
        X = np.full((2, 2), 0.5)
        X[:, k] = [known.profile_interval.low, known.profile_interval.high]
        # the profile interpolates √Δχ² between grid points: a few 1e-3 of the interval
        np.testing.assert_allclose([i.low, i.high], box.from_unit(X)[:, k], rtol=5e-3)


def ball(noise=0.004):
    data = soft_ball.data(0.01, 20.0, noise, np.random.default_rng(3))
    return Misfit(soft_ball.model(), (data,))


def youngs(X):
    mu, D1 = soft_ball.BOX.from_unit(X).T
    return 18.0 * mu / (6.0 + mu * D1)


def test_along_a_valley_the_ends_are_those_of_a_grid():
    """Brute force over 1000 × 1000 points of the box, which shares nothing with the search."""
    m = ball()
    d = inference.determine(m, seed=0, mcmc=False)
    i = derived_interval(d, youngs)
    g = np.linspace(0, 1, 1001)
    X = np.stack(np.meshgrid(np.linspace(0.3, 0.6, 1001), g, indexing="ij"), -1).reshape(-1, 2)
    chi2 = np.concatenate([m.chi2(part) for part in np.array_split(X, 50)])
    inside = youngs(X[chi2 <= chi2.min() + stats.chi2.ppf(0.9, 1)])
    np.testing.assert_allclose([i.low, i.high], [inside.min(), inside.max()], rtol=2e-3)
    box = soft_ball.BOX
    known = d.of("D1").profile_interval
    low, high = box.from_unit(np.array([[0.5, known.low], [0.5, known.high]]))[:, 1]
    assert high / low > 4 and i.high / i.low < 1.15 and is_known(i, scale=True)  # E is known although D1 is open


def test_an_end_that_a_range_makes_is_said():
    d = inference.determine(ball(0.02), seed=0, mcmc=False)
    i = derived_interval(d, lambda X: 2.0 / soft_ball.BOX.from_unit(X)[:, 1])
    assert i.high == pytest.approx(2.0, rel=1e-6) and i.high_by == ("D1",) and not is_known(i, scale=True)
    assert derived_interval(d, youngs).low < derived_interval(d, youngs).high


def test_elastic_constants_agree_with_uniaxial_stress():
    """By the 6 × 6 Hooke matrix of μ and λ = K − 2μ/3: E = 1/S₁₁ and ν = −S₁₂/S₁₁ of its inverse."""
    mu, D1 = 0.013, 24.0
    lam = 2.0 / D1 - 2.0 * mu / 3.0
    C = np.zeros((6, 6))
    C[:3, :3] = lam + 2.0 * mu * np.eye(3)
    C[3:, 3:] = mu * np.eye(3)
    S = np.linalg.inv(C)
    values = {"mu": np.array([mu]), "D1": np.array([D1]), "prony_g": np.array([0.2]), "prony_g2": np.array([0.3])}
    found = {q.name: float(q.of(values)[0]) for q in derived(values)}
    assert found["E"] == pytest.approx(1.0 / S[0, 0], rel=1e-12)
    assert found["nu"] == pytest.approx(-S[0, 1] / S[0, 0], rel=1e-12)
    assert found["K"] == pytest.approx(np.trace(C[:3, :3]) / 9 + (C[:3, :3].sum() - np.trace(C[:3, :3])) / 9, rel=1e-12)
    assert found["mu_infinity"] == pytest.approx(0.5 * mu, rel=1e-12)
    C[:3, :3] = 2.0 / D1 - mu / 3.0 + mu * np.eye(3)  # μ halved at the same K
    assert found["E_infinity"] == pytest.approx(1.0 / np.linalg.inv(C[:3, :3])[0, 0], rel=1e-12)


def test_what_rests_on_a_fixed_value_is_no_finding_of_the_data():
    """With D₁ fixed, ν and K are as sharp as D₁ was stated, and E follows from the data's μ; with D₁ open all do."""
    for D1 in (0.3, 3.0, 30.0):  # ν from 0.4995 to 0.45
        rests = {q.name: rests_on(q.of, {"mu": 0.01}, {"D1": D1}) for q in derived(["mu", "D1"])}
        assert rests == {"E": [], "nu": ["D1"], "K": ["D1"]}
    assert all(rests_on(q.of, {"mu": 0.01, "D1": 3.0}, {}) == [] for q in derived(["mu", "D1"]))


def test_a_modulus_and_its_multiple_have_one_verdict():
    """E = 3 μ of an incompressible body is known where μ is: both are judged by the same factor."""
    box = Box(("mu",), ("MPa",), (1e-4,), (1.0,), (True,))
    for half in (1.1, 1.3, 1.5, 1.7, 1.8, 2.5):  # the ends over the middle
        low, high = 0.01 / half, 0.01 * half
        ends = box.to_unit(np.array([[low], [high]]))[:, 0]
        verdict = judge_parameter(box, 0, inference.Interval(*ends.tolist(), False, False))
        assert is_known(DerivedInterval(0.03, 3 * low, 3 * high), scale=True) == (verdict.word == "determined")
    assert not is_known(DerivedInterval(0.33, 0.2, 0.5), scale=False)  # a Poisson ratio that may be anything


def test_without_both_constants_nothing_is_derived():
    assert derived(["mu"]) == () and [q.name for q in derived(["mu", "D1"])] == ["E", "nu", "K"]


RESULTS = {
    "identification": {
        "level": 0.9,
        "derived": [
            {"name": "E", "letter": "E", "description": "Young's modulus", "unit": "MPa", "value": 0.028035,
             "interval": [0.027128, 0.028938], "known": True, "ends_by": [[], []], "unlikely": ""},
            {"name": "nu", "letter": "ν", "description": "Poisson's ratio", "unit": "1", "value": 0.22,
             "interval": [0.1614, 0.2872], "known": False, "ends_by": [[], ["D1"]], "unlikely": "below 0.3"},
        ],
    }
}  # fmt: skip


def test_a_drained_body_may_have_any_poisson_ratio():
    """A gel whose water has left has 0.1 to 0.3; one that keeps it has not."""
    wet, drained = ({q.name: q for q in derived(names)} for names in (["mu", "D1"], ["mu", "D1", "permeability"]))
    assert wet["nu"].ordinary[0] == 0.3 and drained["nu"].ordinary == (0.0, 0.5)
    assert {drained[n].description for n in ("E", "nu", "K")} == {
        "drained Young's modulus",
        "drained Poisson's ratio",
        "drained bulk modulus",
    }


def test_the_page_says_what_is_fixed_what_is_open_and_what_is_unlikely():
    from rso.report.calibration.derived import derived_facts, derived_sentences, derived_table

    said = [s.replace("\xa0", " ") for s in derived_sentences(RESULTS)]
    assert said[0].startswith("The data fix the Young's modulus E = 28.04 kPa (27.13 to 28.94 kPa), with 90 %")
    assert said[1:] == ["They leave the Poisson's ratio ν between 0.161 and 0.287.", "Look again: below 0.3."]
    facts = derived_facts(RESULTS)
    assert [f.mark for f in facts] == ["good", "warn"] and facts[1].value == "0.161 to 0.287"
    table = derived_table(RESULTS)
    assert table is not None and table.columns[-1].title == "ends by a range"
    assert [row[-1].text for row in table.rows] == ["", "upper: the range of D1"]
    assert derived_table({}) is None and derived_facts({}) == [] == derived_sentences({})


@pytest.mark.parametrize("known", [True, False])
def test_a_value_on_the_page_lies_in_its_interval(known):
    """0.50 would be outside, and no body has it."""
    from rso.report.calibration.derived import derived_value

    nu = {"unit": "1", "value": 0.49598, "interval": [0.39405, 0.49761], "known": known}
    assert derived_value(nu) == "0.496"
    assert derived_value({**nu, "value": 0.45}) == "0.450"


def test_a_refuted_model_or_unconfirmed_surrogates_fix_nothing():
    from types import SimpleNamespace as Some

    from rso.calibration.identification_stage import is_trusted

    good = Some(verified=True, open=(), poor=())
    fits, misses = Some(scale=1.0, refuting=()), Some(scale=3.5, refuting=())
    assert (
        is_trusted(fits, good) and not is_trusted(misses, good) and not is_trusted(Some(scale=1.0, refuting=(3,)), good)
    )
    for worse in ({"verified": False}, {"open": ("D1",)}, {"poor": ("Fz",)}):
        assert not is_trusted(fits, Some(**{**vars(good), **worse}))


def test_a_value_at_an_end_has_no_more_digits_than_that_end():
    """ν = 0.49995 of 0.343 to 0.500 would claim five digits of a number that is known to two."""
    from rso.report.calibration.derived import derived_span, derived_value

    nu = {"unit": "1", "value": 0.49995, "interval": [0.3425, 0.49996], "known": True}
    assert derived_span(nu) == "0.343 to 0.500" and derived_value(nu) == "0.500"


def test_the_page_and_the_terminal_do_not_call_a_stated_value_known():
    """With D₁ stated, ν is neither known nor open: it is as stated, and heads no page."""
    from rso.cli.answer import verdict_lines
    from rso.report.calibration.derived import derived_facts, derived_sentences
    from rso.report.calibration.verdict import answers, plain_answer

    E, nu = RESULTS["identification"]["derived"]
    stated = {**nu, "value": 0.495, "interval": [0.4932, 0.4966], "ends_by": [[], []], "follows_from": ["D1"]}
    found = {"identification": {"level": 0.9, "derived": [{**stated, "unlikely": ""}, {**E, "follows_from": []}]}}
    said = [s.replace("\xa0", " ") for s in derived_sentences(found)]
    assert said[0].startswith("The data fix the Young's modulus") and "The Poisson's ratio" not in said[0]
    assert said[1:] == ["The Poisson's ratio ν = 0.4950 rests on D₁ as stated."]
    assert plain_answer(found).startswith("The Young's modulus is ")
    assert not any("ν" in f.value for f in answers(found)) and derived_facts(found)[0].mark == ""
    assert not any("ν" in text for _, text in verdict_lines(found))
