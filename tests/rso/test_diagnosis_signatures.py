"""What hypotheses add to the base model, test by test and channel by channel, beside what the base model leaves."""

import dataclasses
import functools
import json

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.contract import plain
from rso.data import Repeat
from rso.discrepancy import Diagnosis, Library, build_library, diagnose, make_test_plan
from rso.discrepancy.diagnosis_results import (
    N_LEADING_HYPOTHESES,
    leading_hypotheses,
    residual_panels,
    signature_panels,
)
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.verdict import N_BEATEN_CAUSES

NAMES = ("stiff", "twin", "soften", "tilt", "bias", "offset_each")


def marks(truth, rng):
    """A profile along x at two depths."""
    x, depths = np.tile([6.0, 8.0, 10.0], 2), np.repeat([2.0, 4.0], 3)
    uz = [toy.mark(truth, np.array([d]), a, 0.0)[0] for a, d in zip(x, depths, strict=True)]
    channels = {"x": x, "y": 0.0 * x, "uz": np.array(uz) + 0.01 * rng.standard_normal(len(x))}
    return (Repeat("1", depths, None, channels, {}, np.full(len(x), "loading")),)


@functools.cache
def case(of: str) -> tuple[Library, Diagnosis]:
    """Repeats, a cycle, lateral forces, a hold, marks and a curve kept for validation."""
    truth, chain = {**toy.TRUTH, **PLANTED[of][0]}, PLANTED[of][1]
    rng = np.random.default_rng(3)
    plan = make_test_plan(
        [
            toy.experiment("load", toy.recorded(truth, rng, repeats=3, **chain)),
            toy.experiment("cycle", toy.recorded(truth, rng, unload=True, earlier=4.0, **chain), after=("load",)),
            toy.experiment(
                "side", toy.recorded(truth, rng, point=(10.0, 0.0), lateral=True, **chain), point=(10.0, 0.0)
            ),
            toy.experiment("rest", toy.recorded(truth, rng, hold=60.0, **chain)),
            toy.experiment("marks", marks(truth, rng)),
            toy.experiment("deep", toy.recorded(truth, rng, peak=6.0, **chain), role="validate"),
        ]
    )
    library = build_library(toy.base(axes=False), plan, toy.effects(*NAMES), toy.run)
    return library, diagnose(library, 0, nulls=60)


PLANTED = {  # what is planted in the body, in the chain
    "stiff": ({"stiff": 0.6}, {}),
    "tilt": ({"tilt": 4.0}, {}),
    "bias": ({}, {"bias": 0.02}),
    "each": ({}, {"each_offset": 0.12}),
    "nothing": ({}, {}),
}


def told(of: str):
    library, d = case(of)
    read = json.loads(json.dumps(plain([residual_panels(library.plan.seen(), d), signature_panels(library, d)])))
    return d, *read


@pytest.mark.parametrize("of", ["stiff", "tilt", "bias"])
def test_the_signature_of_the_chosen_one_is_what_it_takes_up_of_every_residual(of):
    d, left, added = told(of)
    assert of in d.chosen.name and d.chosen.name == next(iter(added[0]["added"]))
    assert len(left) == len(added) and {"rest", "marks", "side"} <= {r["experiment"] for r in added}
    for r, s in zip(left, added, strict=True):
        for key in ("experiment", "channel", "label", "depth", "since", "branch"):
            assert r.get(key) == s.get(key)
        taken = np.subtract(r["residual"]["none"], r["residual"][d.chosen.name])
        np.testing.assert_allclose(s["added"][d.chosen.name], taken, atol=1e-5 * np.abs(taken).max())
    sizes = [
        sum(len(json.dumps(v)) for r in rows for v in r[key].values())
        for rows, key in ((left, "residual"), (added, "added"))
    ]
    assert sizes[1] < 0.7 * sizes[0] * len(added[0]["added"]) / 2  # digits that nobody can see are not kept


def test_a_lateral_force_and_an_effect_of_the_chain_have_a_signature():
    d, left, added = told("tilt")
    (s,) = (s for s in added if (s["experiment"], s["channel"]) == ("side", "Fx"))
    sd = next(r["sd"] for r in left if (r["experiment"], r["channel"]) == ("side", "Fx"))
    assert np.abs(s["added"][d.chosen.name]).max() > 5 * max(sd)
    d, _, added = told("bias")
    (s,) = (s for s in added if (s["experiment"], s["channel"]) == ("cycle", "Fz"))
    first = s["added"]["bias"][0]  # where there is hardly any force, the rest of the model has no say
    assert d.causes[0].interval[0] <= first <= d.causes[0].interval[1]


def test_rivals_take_up_the_same_residual_as_they_were_fitted_to_it_too():
    d, left, added = told("stiff")
    drawn = list(added[0]["added"])
    assert d.verdict == "ambiguous" and set(d.named) == {"stiff", "twin"} == set(drawn[:2])
    assert len(drawn) == 2 + N_BEATEN_CAUSES  # beside those that lost
    for r, s in zip(left, added, strict=True):
        if (r["experiment"], r["channel"]) in (("load", "Fz"), ("cycle", "Fz")):
            gap = np.array(r["residual"]["none"])
            for name in d.named:
                assert np.linalg.norm(gap - s["added"][name]) < 0.6 * np.linalg.norm(gap)


def test_what_moves_no_mean_and_no_gap_have_no_signature():
    library, d = case("each")
    assert "offset_each" in d.named and not any("offset_each" in s["added"] for s in signature_panels(library, d))
    only = dataclasses.replace(d, posteriors={k: v for k, v in d.posteriors.items() if k in ("none", "offset_each")})
    assert signature_panels(library, only) == []
    library, d = case("nothing")
    assert d.verdict == "no_gap" and signature_panels(library, d) == []


def test_a_hypothesis_that_fell_keeps_its_signature():
    library, d = case("stiff")
    rest = Hypothesis((), True)
    fits = {"none": d.fits["none"], rest.name: d.fits["none"]}
    fallen = dataclasses.replace(
        d, chosen=rest, named=(), fits=fits, posteriors={**d.posteriors, rest.name: d.posteriors["none"]}
    )
    before, after = signature_panels(library, d), signature_panels(library, fallen)
    assert {"stiff", "twin"} < set(after[0]["added"])
    for b, a in zip(before, after, strict=True):
        assert b["added"] == a["added"]


def test_at_most_a_few_alone_and_the_pair_lead_each_with_its_effects_once():
    _, d = case("stiff")
    effects = {e.name: e for h in d.contest.hypotheses for e in h.effects if e.name in NAMES}
    pair = Hypothesis((effects["soften"], effects["bias"]))
    every = {h.name: None for h in d.contest.hypotheses if len(h.effects) < 2}
    rows = leading_hypotheses(
        dataclasses.replace(d, chosen=pair, named=("soften", "bias"), posteriors={**every, pair.name: None})
    )
    assert [h.name for h in rows[:3]] == ["soften + bias", "soften", "bias"]
    assert len(rows) == 1 + N_LEADING_HYPOTHESES == len({h.effects for h in rows})
    more = Hypothesis((effects["soften"],), True)
    rows = leading_hypotheses(dataclasses.replace(d, chosen=more, named=("soften", "stiff"), posteriors=every))
    assert [h.name for h in rows[:2]] == ["soften + unexplained", "stiff"]
    assert "soften" not in [h.name for h in rows]
