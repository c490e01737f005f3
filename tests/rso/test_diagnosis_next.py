"""The next test: the chance that it settles the matter, and which tests are proposed."""

import dataclasses
import itertools
import types

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from rso.contract import run_key
from rso.discrepancy import build_library, make_test_plan, proposals
from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.gaussian_mixture import posterior
from rso.discrepancy.next_test import (
    RATE_OUT_OF_REACH_NOTE,
    candidate_library,
    distances,
    forecast,
    new_tests_covariance,
    next_tests,
)
from rso.discrepancy.proposals import planned_tests, proposed_tests
from rso.optimal_design.ranking import Worth, ranked
from rso.optimal_design.separation import DECIDED_PROBABILITY, as_likely, chance_to_decide


@pytest.mark.parametrize("D", [1.0, 2.5, 4.0, 7.0])
def test_the_chance_is_that_of_gaussian_readings(D):
    """Two hypotheses D standard deviations apart: draw from each, count how often it ends above DECIDED."""
    P, rng = np.array([0.7, 0.3]), np.random.default_rng(1)
    mean, settled = np.array([0.0, D]), 0.0
    for k in (0, 1):
        x = mean[k] + rng.standard_normal(200_000)
        s = np.log(P) - 0.5 * (x[:, None] - mean) ** 2
        settled += P[k] * np.mean(np.exp(s[:, k] - logsumexp(s, axis=1)) >= DECIDED_PROBABILITY)
    chance = chance_to_decide({("a", "b"): D}, {"a": 0.7, "b": 0.3})
    np.testing.assert_allclose(chance, settled, atol=4e-3)  # 200 000 draws scatter by 1e-3


def test_what_separates_nothing_settles_nothing_and_what_separates_all_does():
    P = {"a": 0.5, "b": 0.3, "c": 0.2}
    pairs = [("a", "b"), ("a", "c"), ("b", "c")]
    assert chance_to_decide(dict.fromkeys(pairs, 0.0), P) < 1e-6
    assert chance_to_decide(dict.fromkeys(pairs, 20.0), P) > 0.999
    # one that only sets a apart settles it where a is true, and no oftener
    np.testing.assert_allclose(
        chance_to_decide({("a", "b"): 20.0, ("a", "c"): 20.0, ("b", "c"): 0.0}, P), 0.5, atol=1e-6
    )


def test_the_causes_of_a_pair_do_not_settle_it_twice():
    """Both are in every hypothesis that counts, so that each has all of the probability."""
    np.testing.assert_allclose(chance_to_decide({("a", "b"): 20.0}, {"a": 1.0, "b": 0.98}), 1.0, atol=1e-6)


@pytest.mark.parametrize(("size", "sd"), [(1.0, 0.6), (0.3, 0.1), (0.05, 0.3), (1.0, 1e-3)])
def test_what_shows_a_size_by_itself_needs_no_knowledge_of_it(size, sd):
    """A gauge of resolution 0.05 and a size that is known badly: draw it, read it, compare with 0 by the densities."""
    rng, resolution = np.random.default_rng(2), 0.05
    s = size + sd * rng.standard_normal(20_000)
    D = {("a", "b"): as_likely(s, resolution)}
    spread = np.hypot(sd, resolution)
    x = s + resolution * rng.standard_normal(len(s))  # a is there
    odds = norm.logpdf(x, size, spread) - norm.logpdf(x, 0.0, resolution)
    y = resolution * rng.standard_normal(len(s))  # it is not
    against = norm.logpdf(y, 0.0, resolution) - norm.logpdf(y, size, spread)
    settled = 0.5 * np.mean(odds >= np.log(19.0)) + 0.5 * np.mean(against >= np.log(19.0))
    np.testing.assert_allclose(chance_to_decide(D, {"a": 0.5, "b": 0.5}), settled, atol=0.01)  # draws scatter by 0.004


def survivors(library, names, data):
    """Posteriors of single effects."""
    y = library.plan.values()
    bench = attribution.set_up(library, y)
    evidence = attribution.Evidence(bench, library.effects)
    own = {e.name: e for e in library.effects}
    found = {}
    for n in names:
        h = evidence.best((own[n],), y, loose=True)
        found[n] = ((own[n],), posterior(h, h.white(y), 400, np.random.default_rng(0)))
    return bench, found


def plan_of(truth, seed=0, **chain):
    """A cycle at the top and a loading curve beside it."""
    rng = np.random.default_rng(seed)
    return make_test_plan(
        [
            toy.experiment("cycle", toy.recorded(truth, rng, unload=True, **chain)),
            toy.experiment(
                "aside", toy.recorded(truth, rng, point=(10.0, 0.0), lateral=True, **chain), point=(10.0, 0.0)
            ),
        ]
    )


def lab(backend):
    """The toy's base with another backend behind it."""
    return dataclasses.replace(toy.base(axes=False), backend=backend)


def proposing(**methods):
    """The toy, offering tests of its own."""
    own = {n: getattr(toy.BACKEND, n) for n in dir(toy.BACKEND) if not n.startswith("_")}
    there = types.SimpleNamespace(**own, **methods)
    return there


def test_a_gauge_and_a_prevented_effect_are_proposed_and_the_better_comes_first():
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012, "stiff": 0.02}
    backend = proposing(
        prevented=lambda: {"again without it": ("stiff",), "again without what is not open": ("soften",)},
        gauges=lambda settings: {"stiff": ("a perfect gauge", 1e-6)},
    )
    effects = toy.effects("stiff", "soften", "bias")
    library = build_library(lab(backend), plan_of(truth), effects, toy.run)
    bench, alive = survivors(library, ("stiff", "bias"), truth)
    found = next_tests(library, bench, alive, {"stiff": 0.5, "bias": 0.5}, None)
    words = [t.test for t in found]
    assert "a perfect gauge" in words and "again without it" in words and any("a run in air" in w for w in words)
    assert "again without what is not open" not in words
    assert [t.test for t in ranked(found, lambda t: Worth(t.information, t.price))] == words
    assert max(t.information for t in found) - found[0].information <= 0.1
    assert all(b.information <= a.information + 0.1 for a, b in itertools.pairwise(found))
    assert all(0.0 <= t.chance <= 1.0 for t in found)


def test_a_laboratory_with_one_axis_is_promised_what_one_axis_tells():
    """Forecasts took lateral forces for measured: a test "again" was to settle what it had not settled before."""
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012}
    rng = np.random.default_rng(0)
    backend = proposing(
        prevented=lambda: {"again without it": ("stiff",)}, tests=lambda settings: {"another point": {"point": [5, 0]}}
    )
    for lateral in (False, True):
        side = toy.recorded(truth, rng, point=(10.0, 0.0), lateral=lateral)
        plan = make_test_plan(
            [
                toy.experiment("cycle", toy.recorded(truth, rng, unload=True)),
                toy.experiment("aside", side, point=(10.0, 0.0)),
            ]
        )
        library = build_library(lab(backend), plan, toy.effects("stiff", "bias"), toy.run)
        found = {c.words: {e.channels for e in c.experiments} for c in proposed_tests(library)}
        more = {w: v for w, v in found.items() if "measured" in w}
        every = ("Fx", "Fy", "Fz")
        assert "another point" in found and "again without it" in found
        assert set().union(*(v for w, v in found.items() if w not in more)) == {every if lateral else ("Fz",)}
        assert set(more) == (
            set()
            if lateral
            else {f"the test at {place} again, with Fx and Fy measured" for place in ("(0, 0)", "(10, 0)")}
        )
        assert all(v == {every} for v in more.values())


def test_nothing_is_proposed_where_one_cause_is_left_and_simulations_are_asked_for_only_with_a_runner():
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012}
    backend = proposing(tests=lambda settings: {"another point": {"point": [5.0, 0.0]}})
    library = build_library(lab(backend), plan_of(truth), toy.effects("stiff", "bias"), toy.run)
    bench, alive = survivors(library, ("stiff", "bias"), truth)
    assert next_tests(library, bench, {"stiff": alive["stiff"]}, {"stiff": 1.0}, None) == []
    (other,) = [c for c in proposed_tests(library) if c.words == "another point"]
    assert candidate_library(library, other, alive, None) is None
    assert candidate_library(library, other, alive, toy.run) is not None


def test_what_every_curve_has_for_itself_is_told_from_a_cause_by_the_scatter_of_new_curves():
    """A contact always noted 0.1 mm late, or anew each time: one more curve tells the less the more contacts scatter,
    as the best linear test does on simulated readings; where everything scatters no test is proposed.
    """
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012}
    library = build_library(
        toy.base(axes=False), plan_of(truth), toy.effects("offset", "offset_each", "gain_each"), toy.run
    )
    bench, alive = survivors(library, ("offset", "offset_each", "gain_each"), truth)
    (own, post), rng = alive["offset"], np.random.default_rng(0)
    late = np.column_stack([post.at[:, :-1], 0.1 + 0.005 * rng.standard_normal(len(post.at))])
    pair = {"offset": (own, dataclasses.replace(post, at=late)), "offset_each": alive["offset_each"]}
    words, D = "load and unload ten times faster (300 mm/min)", {}
    for sd in (0.02, 0.3):
        found = next_tests(library, bench, pair, dict.fromkeys(pair, 0.5), None, {"offset_each": sd})
        D[sd] = next(t.distance for t in found if t.test == words)
    assert D[0.3] < 0.3 * D[0.02]

    there = candidate_library(library, next(c for c in proposed_tests(library) if c.words == words), pair, None)
    F = {n: forecast(there, bench, *pair[n]) for n in pair}
    Δ, ((each,), post) = F["offset"].mean(0) - F["offset_each"].mean(0), pair["offset_each"]
    centre = np.median(post.at[:, : len(there.base.axes)], axis=0)[None]
    moved = 0.3 * attribution.by_test(there, each, centre, np.median(post.modulus))
    known = new_tests_covariance(there, bench, F["offset"].mean(0)) + np.cov(F["offset"].T) + np.cov(F["offset_each"].T)
    y = rng.standard_normal((4000, len(moved))) @ moved + rng.multivariate_normal(np.zeros(len(Δ)), known, 4000)
    w = np.linalg.solve(np.cov(y.T), Δ)
    np.testing.assert_allclose(D[0.3], Δ @ w / np.std(y @ w), rtol=0.05)  # 4000 draws scatter by 1 %

    both = {n: alive[n] for n in ("offset_each", "gain_each")}  # only repeats tell these, not another test
    assert next_tests(library, bench, both, dict.fromkeys(both, 0.5), None, dict.fromkeys(both, 0.1)) == []


def test_a_test_done_three_times_tells_more_than_once_but_less_than_three_tests_of_their_own(monkeypatch):
    """What each test has for itself averages out, what the model may be wrong by and a re-fit do not: D grows, by less
    than √3."""
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012, "stiff": 0.02}
    library = build_library(lab(toy.BACKEND), plan_of(truth), toy.effects("stiff", "soften"), toy.run)
    bench, alive = survivors(library, ("stiff", "soften"), truth)
    D = {}
    for times in (1, 3):
        monkeypatch.setattr(proposals, "N_PROPOSED_REPEATS", times)
        found = next_tests(library, bench, alive, {"stiff": 0.5, "soften": 0.5}, None)
        D[times] = {t.test: t.distance for t in found}
    assert D[1].keys() == D[3].keys() and len(D[1]) > 1
    pressed = [w for w in D[1] if D[3][w] != D[1][w]]  # a measurement of one knob by itself is no test
    assert pressed and all(1.0 < D[3][w] / D[1][w] < np.sqrt(3.0) for w in pressed)


def test_surface_marks_are_proposed_where_none_are_known_and_tell_a_skin_from_stiffening(monkeypatch):
    """In this body marks move less under a stiff skin, and stiffening does not show in them."""
    monkeypatch.setattr(proposals, "N_PROPOSED_REPEATS", 1)  # the marks are photographed once
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012, "skin": 1.6}
    marks = [[float(x), 5.0] for x in np.linspace(-8, 8, 9)]
    backend = proposing(marks=lambda settings: {"marks": marks})
    library = build_library(lab(backend), plan_of(truth), toy.effects("stiff", "skin"), toy.run)
    bench, alive = survivors(library, ("stiff", "skin"), truth)
    (one,) = [c for c in proposed_tests(library) if c.words == "marks"]
    assert candidate_library(library, one, alive, None) is None  # no table has them
    there = candidate_library(library, one, alive, toy.run)
    rows = np.concatenate([np.arange(at.start, at.stop) for _, c, at in there.plan.rows() if c == "uz"])
    d = np.repeat([2.0, 4.0], len(marks))
    for name, moves in (("skin", True), ("stiff", False)):
        F, post = forecast(there, bench, *alive[name]), alive[name][1]
        pick = np.linspace(0, len(post.modulus) - 1, len(F)).astype(int)
        values = {"mu": 0.012, "D1": truth["D1"]}
        skin = [float(alive["skin"][0][0].size.value(post.at[i, 0])) if moves else 1.0 for i in pick]
        places = list(zip(d, marks * 2, strict=True))
        exact = [[float(toy.mark(values | {"skin": s}, u, *m)) for u, m in places] for s in skin]
        np.testing.assert_allclose(F[:, rows], exact, atol=0.03 * np.abs(exact).max())  # between the nodes of a skin
    with_marks = distances(there, bench, alive)["stiff", "skin"]
    plain = dataclasses.replace(there, plan=dataclasses.replace(there.plan, profiles=()))
    assert with_marks > 1.5 * distances(plain, bench, alive)["stiff", "skin"]
    known = dataclasses.replace(library.plan.places[0], marks=tuple((x, 6.0) for x, _ in marks))
    plan = dataclasses.replace(library.plan, places=(known, *library.plan.places[1:]))
    assert "marks" not in [c.words for c in proposed_tests(dataclasses.replace(library, plan=plan))]


def test_what_candidates_take_is_known_before_the_library_is():
    """Of a catalogue of two effects exactly: those that are run when both are left."""
    backend = proposing(tests=lambda settings: {"another point": {"point": [5.0, 0.0]}})
    plan, effects = plan_of({"mu": 0.012, "D1": 60.0}), toy.effects("stiff", "soften", "bias")
    found = planned_tests(lab(backend), plan, effects)
    library = build_library(lab(backend), plan, effects, toy.run)
    alive = {e.name: ((e,), None) for e in effects}
    every = {c.words: c for c in proposed_tests(library)}
    for words, candidate in every.items():
        keys: set[str] = set()

        def run(tasks, keys=keys):
            keys.update(run_key(backend, *backend.canonical(t.values, t.case)) for t in tasks)
            return toy.run(tasks)

        candidate_library(library, candidate, alive, run)
        jobs, share = found.get(words, ([], 1.0))
        assert len(jobs) * share == pytest.approx(len(keys)), words
    assert "another point" in found and len(found) < len(every)


def test_a_rate_beyond_those_computed_is_said():
    """Times count by travel: 3 s in a test ten times slower as one that no run had."""
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012, "g": 0.3, "tau": 3.0}
    library = build_library(toy.base(axes=False), plan_of(truth), toy.effects("stiff", "g"), toy.run)
    bench, alive = survivors(library, ("stiff", "g"), truth)
    found = {t.test: t.note for t in next_tests(library, bench, alive, {"stiff": 0.5, "g": 0.5}, None)}
    (slower,) = [note for test, note in found.items() if "ten times slower" in test]
    assert slower == RATE_OUT_OF_REACH_NOTE
    assert not any(note for test, note in found.items() if "ten times" not in test and "hold" not in test)
    bench, alive = survivors(library, ("stiff",), truth)
    alive["twin"] = alive["stiff"]
    found = next_tests(library, bench, alive, {"stiff": 0.5, "twin": 0.5}, None)
    assert found and not any(t.note for t in found)  # nothing has a time


def test_a_mount_that_creeps_has_times_that_no_run_needs():
    """Against a body that relaxes: a test ten times slower leans on runs for the body alone, and a block tells them."""
    truth = {"mu": 0.012, "D1": 60.0 * toy.base(axes=False).reference / 0.012, "g": 0.3, "tau": 3.0}
    library = build_library(
        toy.base(axes=False), plan_of(truth), toy.effects("g", "creep", "stiff", "offset_each"), toy.run
    )
    bench, alive = survivors(library, ("g", "creep"), truth)
    found = {t.test: t for t in next_tests(library, bench, alive, {"g": 0.5, "creep": 0.5}, None)}
    assert any("rigid block" in test for test in found)
    (slower,) = [t for test, t in found.items() if "ten times slower" in test]
    assert slower.note == RATE_OUT_OF_REACH_NOTE
    bench, alive = survivors(library, ("stiff", "creep"), truth)
    found = next_tests(library, bench, alive, {"stiff": 0.5, "creep": 0.5}, None)
    assert found and not any(t.note for t in found)


def test_a_candidate_comes_after_what_was_pressed_at_its_place():
    """A body with a dent has it in the next test too, but not at a place that nobody touched."""
    plan = plan_of({"mu": 0.012, "D1": 60.0})
    library = build_library(toy.base(axes=False), plan, toy.effects("stiff", "offset", "permanent_set"), toy.run)
    everything = {e.name: ((e,), None) for e in library.effects if e.family == "model"}
    pressed = {str(library.plan.places[t.place].settings["point"]): t.peak for t in library.plan.tests}
    seen = set()
    for candidate in proposed_tests(library):
        there = candidate_library(library, candidate, everything, toy.run)
        until = dict(pressed)
        for t in there.plan.tests:
            point = str(there.plan.places[t.place].settings["point"])
            np.testing.assert_allclose(t.earlier, until.get(point, 0.0), rtol=1e-12)
            until[point] = max(until.get(point, 0.0), t.peak)  # it is done three times
            assert t.age == 0.5
            seen.add(point in pressed)
    assert True in seen


def test_a_way_back_after_a_long_rest_says_nothing_of_one_without():
    """Proposals that load and unload are simulated where all ways back so far came after a rest."""
    truth = {**toy.TRUTH, "g": 0.4, "tau": 8.0}
    held = toy.recorded(truth, np.random.default_rng(0), hold=60.0, unload=True, repeats=2)
    plan = make_test_plan([toy.experiment("a", held)])
    library = build_library(toy.base(), plan, toy.effects("g"), toy.run)
    back = [make_test_plan(c.experiments, plan.scale) for c in proposed_tests(library)]
    back = [p for p in back if any(t.returns for t in p.tests)]
    assert back and not any(proposals.tables_cover(library, p) for p in back)
    assert proposals.tables_cover(library, plan)
