"""What a cause leaves: noise if it is the true one, something if it is not, whatever χ² says."""

import dataclasses
import functools

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.stats import binom

import rso.discrepancy.diagnosis
from rso import discrepancy
from rso.data import Repeat
from rso.discrepancy import build_library, make_test_plan
from rso.discrepancy.diagnosis import WHOLE_GAP_VERDICTS
from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.gaussian_mixture import posterior
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.residual_test import RESIDUAL_TEST_LEVEL, ResidualScore, _changes, residual_score
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS
from rso.discrepancy.evidence.verdict import pairs_of_remainder
from rso.discrepancy.library.prediction import predict

BASE = toy.base(axes=False)
TRUTH = {"mu": 0.012, "D1": 60.0 * BASE.reference / 0.012}
NAMES = ("stiff", "twin", "skin", "soften", "offset", "bias", "drift")


def experiments(seed: int, truth=None, **chain: float):
    """Repeats, a cycle, a deep curve."""
    rng, body = np.random.default_rng(seed), {**TRUTH, **(truth or {})}
    return [
        toy.experiment("load", toy.recorded(body, rng, repeats=3, **chain)),
        toy.experiment("cycle", toy.recorded(body, rng, unload=True, earlier=4.0, **chain), after=("load",)),
        toy.experiment("deep", toy.recorded(body, rng, peak=6.0, earlier=4.0, **chain), after=("cycle",)),
    ]


@functools.cache
def tables(names: tuple[str, ...]):
    return build_library(BASE, make_test_plan(experiments(0)), toy.effects(*names), toy.run)


def evidence_of(seed: int, truth, names=NAMES, **chain: float) -> tuple[Evidence, np.ndarray]:
    library = dataclasses.replace(tables(names), plan=make_test_plan(experiments(seed, truth, **chain)))
    y = library.plan.values()
    return Evidence(attribution.set_up(library, y), library.effects), y


def of(evidence: Evidence, name: str) -> Hypothesis:
    return Hypothesis(tuple(e for e in evidence.effects if e.name == name))


@pytest.mark.parametrize("name, size", [("stiff", 0.5), ("soften", 0.3)])
def test_the_true_cause_leaves_noise(name, size):
    """As rarely as it says: within what 60 data sets may do by chance."""
    evidence, y = evidence_of(1, {name: size})
    own = of(evidence, name)
    Y = attribution.simulated_data(evidence, own.effects, y, 60, 5)
    there = sum(residual_score(evidence, own, v, k).there for k, v in enumerate(Y))
    assert there <= binom.ppf(0.999, len(Y), RESIDUAL_TEST_LEVEL)


@pytest.mark.parametrize("chain", [{"bias": 0.03}, {"drift": 0.003}])
def test_a_second_effect_shows_in_what_the_first_leaves(chain):
    evidence, y = evidence_of(2, {"stiff": 0.6}, **chain)
    found = residual_score(evidence, of(evidence, "stiff"), y, 0)
    assert found.there and found.effect.name == next(iter(chain)), found
    alone, y = evidence_of(2, {"stiff": 0.6})
    assert not residual_score(alone, of(alone, "stiff"), y, 0).there


def test_what_the_cause_itself_can_move_is_no_remainder():
    """A catalogue of the cause and its look-alike alone has nothing to look for."""
    evidence, y = evidence_of(3, {"stiff": 0.6}, names=("stiff", "twin"), bias=0.03)
    found = residual_score(evidence, of(evidence, "stiff"), y, 0)
    assert found.score < 0.5 * residual_score(*_with("bias", 3), y, 0).score
    one, y = evidence_of(3, {"stiff": 0.6}, names=("stiff",), bias=0.03)
    assert (
        residual_score(one, of(one, "stiff"), y, 0).effect is None
        and not residual_score(one, of(one, "stiff"), y, 0).there
    )
    forms, y = evidence_of(3, {}, names=("lag", "lag_filter"))  # two of one cause
    assert residual_score(forms, of(forms, "lag"), y, 0).effect is None


def test_what_shows_beside_a_single_cause_is_tried_as_a_pair_with_it():
    stiff, bias, each = toy.effects("stiff", "bias", "bias_each")
    rest = ResidualScore("stiff", bias, 5.0, 3.0, (bias,))
    assert pairs_of_remainder(Hypothesis((stiff,)), rest, []) == [(stiff, bias)]
    assert pairs_of_remainder(Hypothesis((stiff,)), rest, [(bias, stiff)]) == []  # it is among them
    assert pairs_of_remainder(Hypothesis((each,)), rest, []) == []  # a scatter has no tiles to pair
    assert pairs_of_remainder(Hypothesis((stiff, bias)), rest, []) == []
    assert pairs_of_remainder(Hypothesis((stiff,)), ResidualScore("", None, 0.0, np.inf), []) == []


def _with(name: str, seed: int) -> tuple[Evidence, Hypothesis]:
    evidence, _ = evidence_of(seed, {"stiff": 0.6}, names=("stiff", "twin", name), bias=0.03)
    return evidence, of(evidence, "stiff")


@pytest.mark.parametrize("other", ["bias", "drift", "soften"])
def test_the_score_of_a_direction_is_standard_normal_under_the_cause(other):
    """One other effect, whose sizes are nearly one direction: the median of |score| is that of a standard normal."""
    evidence, y = evidence_of(4, {"stiff": 0.5}, names=("stiff", other))
    own = of(evidence, "stiff")
    scores = [
        residual_score(evidence, own, v, 0).score for v in attribution.simulated_data(evidence, own.effects, y, 300, 7)
    ]
    assert 0.58 < np.median(scores) < 0.80  # 0.674; 300 draws scatter it by 0.05, several sizes add to it
    assert 1.7 < np.quantile(scores, 0.95) < 2.4  # 1.96


def test_a_cause_that_is_not_in_the_catalogue_makes_another_one_a_part_of_it(monkeypatch):
    """A late contact taken for a skin: sure of it without a look at what the skin leaves, where χ² says nothing."""
    names = ("stiff", "bias", "skin")
    plan = make_test_plan(experiments(2, offset=0.09))
    library = dataclasses.replace(tables(names), plan=plan)
    d = discrepancy.diagnose(library, 2, nulls=100)
    assert d.remainder.there and d.left < DIAGNOSIS_SETTINGS.rules.misfit
    assert d.verdict == "partly" and "skin" in d.named, (d.verdict, d.named, d.remainder)
    monkeypatch.setattr(rso.discrepancy.diagnosis, "residual_score", lambda *_: ResidualScore("", None, 0.0, np.inf))
    blind = discrepancy.diagnose(library, 2, nulls=100)
    assert blind.verdict in WHOLE_GAP_VERDICTS and blind.named == ("skin",)


def test_a_remainder_with_an_open_parameter_and_a_profile():
    """Forces are over the modulus, displacements are not; the base's tile is that of the data."""
    base, rng = toy.base(), np.random.default_rng(8)
    body = {"mu": 0.012, "D1": 60.0, "stiff": 0.5}
    u = np.repeat((1.0, 3.0), 3)
    x, y = np.tile(np.array([(0.0, 0.0), (6.0, 0.0), (0.0, 9.0)]).T, 2)

    def plan(mark: float, bias: float):
        w = np.array([toy.mark(body, d, a, b) for d, a, b in zip(u, x, y, strict=True)], float)
        marks = Repeat("1", u, None, {"x": x, "y": y, "uz": w + mark}, {}, np.full(len(u), "loading"))
        load = toy.recorded(body, rng, repeats=3, bias=bias)
        return make_test_plan([toy.experiment("load", load), toy.experiment("profile", (marks,))])

    effects = toy.effects("stiff", "skin", "bias")
    library = build_library(base, plan(0.0, 0.0), effects, toy.run)

    def left(name: str, **wrong: float) -> ResidualScore:
        own = dataclasses.replace(library, plan=plan(**{"mark": 0.0, "bias": 0.0, **wrong}))
        evidence = Evidence(attribution.set_up(own, own.plan.values()), own.effects)
        return residual_score(evidence, of(evidence, name), own.plan.values(), 0)

    quiet, found = left("stiff"), left("stiff", bias=0.03)
    assert not quiet.there and quiet.score < 5.0  # the largest of many standard normal ones
    assert found.there and found.effect.name == "bias" and found.of == "stiff"

    # what an effect changes, as it is predicted with and without it at the base's tile nearest to the data
    evidence = Evidence(attribution.set_up(library, library.plan.values()), library.effects)
    y = library.plan.values()
    for name in ("skin", "bias"):
        (e,) = of(evidence, name).effects
        h = evidence.best((), y)
        post = posterior(h, h.white(y), 50, np.random.default_rng(0))
        tiles, all_x = evidence.ready((e,)).tiles, evidence.ready(()).tiles.at
        x = all_x[np.argmin(np.abs(all_x[:, 0] - np.median(post.at[:, 0])))]
        assert not np.array_equal(x, all_x[0])
        at, μ = tiles.at[tiles.at[:, 0] == x[0]], float(np.median(post.modulus))
        (A, c), (A0, c0) = (predict(library, k, v, evidence.bench.modulus) for k, v in (((e,), at), ((), x[None])))
        np.testing.assert_allclose(_changes(evidence, e, post), μ * (A - A0) + c - c0, rtol=0, atol=1e-4 * μ * A.max())


def test_what_shows_beside_a_cause_is_in_the_contest_and_in_the_words():
    names = ("stiff", "bias", "skin")
    library = dataclasses.replace(tables(names), plan=make_test_plan(experiments(2, offset=0.09)))
    d = discrepancy.diagnose(library, 2, nulls=100)
    found = discrepancy.diagnosis_data(library, d, (), None, "toy")
    rest = found["diagnosis"]["remainder"]
    assert rest["there"] and rest["score"] > rest["threshold"] and rest["of"] == "skin"
    like = next(e["label"] for e in found["effects"] if e["name"] == rest["looks_like"])
    said = f"What skin alone leaves is more than noise and looks most like {like}"
    assert any(said in w for w in found["words"]), found["words"]
    assert {"skin + " + rest["looks_like"], rest["looks_like"] + " + skin"} & set(d.probabilities)


def test_rivals_of_a_part_are_named_and_are_not_called_a_pair():
    """Two look-alikes, neither enough: "it takes two effects together" would be wrong."""
    names = ("stiff", "twin", "skin")
    plan = make_test_plan(experiments(0, {"stiff": 0.3, "soften": 0.08}))
    library = dataclasses.replace(tables(names), plan=plan)
    found = discrepancy.diagnosis_data(library, discrepancy.diagnose(library, 0, nulls=100), (), None, "toy")
    d = found["diagnosis"]
    assert d["verdict"] == "partly" and len(d["chosen"]) == 1 and len(d["causes"]) > 1, d["causes"]
    assert set(d["ambiguous_with"][0]) == {c["effect"] for c in d["causes"]}
    assert not any("takes two effects" in w for w in found["words"])
    assert any("which the data cannot separate" in w for w in found["words"])
