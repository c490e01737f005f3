"""What a cause leaves: noise if it is the true one, something if it is not, whatever χ² says."""

import dataclasses
import functools

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.stats import binom

import rso.diagnosis.judge
from rso import diagnosis
from rso.diagnosis import attribute, build, make_plan
from rso.diagnosis.attribute import Evidence
from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.judge import MISFIT, _beside
from rso.diagnosis.judge import NAMES as NAMED
from rso.diagnosis.remainder import LEVEL, Remainder, remainder

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
    return build(BASE, make_plan(experiments(0)), toy.effects(*names), toy.run)


def evidence_of(seed: int, truth, names=NAMES, **chain: float) -> tuple[Evidence, np.ndarray]:
    library = dataclasses.replace(tables(names), plan=make_plan(experiments(seed, truth, **chain)))
    y = library.plan.values()
    return Evidence(attribute.set_up(library, y), library.effects), y


def of(evidence: Evidence, name: str) -> Hypothesis:
    return Hypothesis(tuple(e for e in evidence.effects if e.name == name))


@pytest.mark.parametrize("name, size", [("stiff", 0.5), ("soften", 0.3)])
def test_the_true_cause_leaves_noise(name, size):
    """As rarely as it says: within what 60 data sets may do by chance."""
    evidence, y = evidence_of(1, {name: size})
    own = of(evidence, name)
    Y = attribute.simulated(evidence, own.effects, y, 60, 5)
    there = sum(remainder(evidence, own, v, k).there for k, v in enumerate(Y))
    assert there <= binom.ppf(0.999, len(Y), LEVEL)


@pytest.mark.parametrize("chain", [{"bias": 0.03}, {"drift": 0.003}])
def test_a_second_effect_shows_in_what_the_first_leaves(chain):
    evidence, y = evidence_of(2, {"stiff": 0.6}, **chain)
    found = remainder(evidence, of(evidence, "stiff"), y, 0)
    assert found.there and found.effect.name == next(iter(chain)), found
    alone, y = evidence_of(2, {"stiff": 0.6})
    assert not remainder(alone, of(alone, "stiff"), y, 0).there


def test_what_the_cause_itself_can_move_is_no_remainder():
    """A catalogue of the cause and its look-alike alone has nothing to look for."""
    evidence, y = evidence_of(3, {"stiff": 0.6}, names=("stiff", "twin"), bias=0.03)
    found = remainder(evidence, of(evidence, "stiff"), y, 0)
    assert found.score < 0.5 * remainder(*_with("bias", 3), y, 0).score
    one, y = evidence_of(3, {"stiff": 0.6}, names=("stiff",), bias=0.03)
    assert remainder(one, of(one, "stiff"), y, 0).effect is None and not remainder(one, of(one, "stiff"), y, 0).there


def test_what_shows_beside_a_single_cause_is_tried_as_a_pair_with_it():
    stiff, bias, each = toy.effects("stiff", "bias", "bias_each")
    rest = Remainder(bias, 5.0, 3.0)
    assert _beside(Hypothesis((stiff,)), rest, []) == [(stiff, bias)]
    assert _beside(Hypothesis((stiff,)), rest, [(bias, stiff)]) == []  # it is among them
    assert _beside(Hypothesis((each,)), rest, []) == []  # a scatter has no tiles to pair
    assert _beside(Hypothesis((stiff, bias)), rest, []) == []
    assert _beside(Hypothesis((stiff,)), Remainder(None, 0.0, np.inf), []) == []


def _with(name: str, seed: int) -> tuple[Evidence, Hypothesis]:
    evidence, _ = evidence_of(seed, {"stiff": 0.6}, names=("stiff", "twin", name), bias=0.03)
    return evidence, of(evidence, "stiff")


@pytest.mark.parametrize("other", ["bias", "drift", "soften"])
def test_the_score_of_a_direction_is_standard_normal_under_the_cause(other):
    """One other effect, whose sizes are nearly one direction: the median of |score| is that of a standard normal."""
    evidence, y = evidence_of(4, {"stiff": 0.5}, names=("stiff", other))
    own = of(evidence, "stiff")
    scores = [remainder(evidence, own, v, 0).score for v in attribute.simulated(evidence, own.effects, y, 300, 7)]
    assert 0.58 < np.median(scores) < 0.80  # 0.674; 300 draws scatter it by 0.05, several sizes add to it
    assert 1.7 < np.quantile(scores, 0.95) < 2.4  # 1.96


def test_a_cause_that_is_not_in_the_catalogue_makes_another_one_a_part_of_it(monkeypatch):
    """A late contact taken for a skin: sure of it without a look at what the skin leaves, where χ² says nothing."""
    names = ("stiff", "bias", "skin")
    plan = make_plan(experiments(5, offset=0.06))
    library = dataclasses.replace(tables(names), plan=plan)
    d = diagnosis.diagnose(library, 5, nulls=100)
    assert d.remainder.there and d.left < MISFIT
    assert d.verdict == "partly" and "skin" in d.named, (d.verdict, d.named, d.remainder)
    monkeypatch.setattr(rso.diagnosis.judge, "remainder", lambda *_: Remainder(None, 0.0, np.inf))
    blind = diagnosis.diagnose(library, 5, nulls=100)
    assert blind.verdict in NAMED and blind.named == ("skin",)

