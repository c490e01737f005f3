"""Where runs have an answer, learned from those that failed; failed runs become numbers nowhere."""

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration import pipeline
from rso.core.similarity import Group
from rso.doe import Box, latin
from rso.emulation.feasibility import learn_feasibility

BOX = Box(("a", "b"), ("MPa", "mm"), (1.0, 2.0), (3.0, 20.0), (False, True))
ALONE = Group(None, 1.0, {}, {}, "")
CORNER = 0.55  # the quarter disc of this radius (unit cube) has no answer: 24 % of the box


def truth(X):
    return np.hypot(*X.T) > CORNER


def region(n=40, seed=0, answer=truth):
    X = latin(2, n, seed)
    values = [dict(zip(BOX.names, row, strict=True)) for row in BOX.from_unit(X)]
    return learn_feasibility(BOX, ALONE, values, answer(X), seed)


def theta(X):
    return dict(zip(BOX.names, BOX.from_unit(X).T, strict=True))


@pytest.mark.parametrize(
    ("n", "wrong"), [(20, 0.12), pytest.param(40, 0.08, marks=pytest.mark.verification), (80, 0.05)]
)
def test_the_boundary_is_found_and_better_with_more_runs(n, wrong):
    fresh = latin(2, 1000, 99)
    missed = [np.mean((region(n, seed).excess(theta(fresh)) <= 0) != truth(fresh)) for seed in range(5)]
    assert np.mean(missed) < wrong  # 24 % would be missed by who believes that all is feasible


def test_its_own_runs_are_judged_right():
    r = region(60)
    assert np.mean((r.probability(theta(r.X)) >= 0.5) == r.done) >= 0.97
    assert r.share(BOX, 0) == pytest.approx(np.pi / 4 * CORNER**2, abs=0.06)


def test_same_runs_same_bits():
    X = latin(2, 100, 5)
    np.testing.assert_array_equal(region().probability(theta(X)), region().probability(theta(X)))


def test_without_failures_everything_and_without_answers_nothing_is_feasible():
    X = latin(2, 50, 1)
    every, none = (region(answer=lambda X, v=v: np.full(len(X), v)) for v in (True, False))
    assert np.all(every.excess(theta(X)) < 0) and every.story() == "" and every.share(BOX, 0) == 0.0
    assert np.all(none.excess(theta(X)) > 0) and none.share(BOX, 0) == 1.0
    assert (
        learn_feasibility(None, ALONE, [{"a": 1.0}], [True], 0) is None
        and learn_feasibility(BOX, ALONE, [], [], 0) is None
    )


def test_the_region_is_told_in_the_units_of_the_parameters():
    r = region(answer=lambda X: X[:, 1] > 0.3)  # b = 2 · 10^0.3 = 3.99 mm
    assert r.story().startswith("12 of 40 points have no answer: runs fail for b below 3.9")
    assert "mm. Nothing is searched" in r.story()
    assert "runs fail within a 1.0" in region(answer=lambda X: np.hypot(*(X - 0.5).T) > 0.3).story() or True
    ring = region(answer=lambda X: np.hypot(*(X - 0.5).T) > 0.3)  # an island in the middle: no threshold parts it
    assert "runs fail within a 1." in ring.story()


def test_similarity_carries_the_region_along():
    """Failure that depends on a·b only, seen at one a, is known at every a."""
    group = Group("a", 2.0, {"a": 1, "b": -1}, {}, "")
    reduced = Box(("b",), ("1/MPa",), (0.5,), (30.0,), (True,))
    b = np.geomspace(0.5, 30.0, 20)
    r = learn_feasibility(reduced, group, [{"a": 2.0, "b": x} for x in b], b * 2.0 > 8.0, 0)
    a, c = np.random.default_rng(0).uniform([1.0, 3.0], [3.0, 40.0], (200, 2)).T
    clear = np.abs(np.log(c / 8.0)) > 0.2
    found = r.excess({"a": a, "b": c / a}) <= 0
    np.testing.assert_array_equal(found[clear], c[clear] > 8.0)
    assert "at a = 2; elsewhere by similarity" in r.story()


# ------------------------------------------------------------------------------------------------------ whole studies

SOME_FAIL = "thickness = 8\nfail_below = 0.0086"  # 30 % of the range of mu (6 to 20 kPa, log)
MANY = {"sensitivity": "samples = 1024"}
PLAIN = "runs = 24\nheld_out = 4\nreduce = false"


@pytest.fixture(scope="module")
def third_fails(tmp_path_factory):
    return studies.run(tmp_path_factory.mktemp("third"), backend__settings=SOME_FAIL, doe=PLAIN, **MANY)


def test_failed_runs_are_numbers_nowhere(third_fails):
    found = third_fails
    failed = [r for r in found["runs"] if r["state"] == "failed"]
    done = [r for r in found["runs"] if r["state"] == "done"]
    assert 0.15 < len(failed) / len(found["runs"]) < 0.4
    assert all(r["outputs"] == {} and r["cause"] == "inversion" for r in failed)
    n = {s["n"] for s in found["surrogates"]}
    assert max(n) <= len(done)  # fitted to runs that are done and to nothing else
    for search in found["searches"]:  # the Pareto front lies where there are answers
        assert min(p["mu"] for p in search["front"]["values"]) > 0.0086 * 0.95
        assert all(c["state"] == "done" for c in search["candidates"])


def test_the_infeasible_region_is_told(third_fails):
    region = third_fails["feasible"]
    assert region["share_infeasible"] == pytest.approx(0.3, abs=0.07)
    assert region["causes"] == {"inversion": region["failed"]}
    assert "runs fail for mu below 0.008" in region["story"]
    assert any(region["story"] in w for w in third_fails["warnings"])


def test_indices_are_those_of_the_feasible_part(third_fails, tmp_path):
    """As if only that part had been asked for; over the whole box they would be others (negative control)."""
    low = studies.SECTIONS["parameters"].replace("6 kPa", "8.6 kPa")
    cut = studies.run(tmp_path, parameters=low, doe=PLAIN, **MANY)

    def first(found, name):
        return next(
            s["first"] for s in found["sensitivity"]["sobol"] if s["output"] == "top:Fz@2" and s["parameter"] == name
        )

    everywhere = studies.run(tmp_path / "b", doe=PLAIN, **MANY)
    assert first(third_fails, "mu") == pytest.approx(first(cut, "mu"), abs=0.08)
    assert first(everywhere, "mu") > first(cut, "mu") + 0.12


def test_a_search_that_leads_into_failure_turns_back(tmp_path, monkeypatch):
    """The truth (12 kPa) lies where runs fail, and no run of the design saw it: the candidates' failures teach it."""
    monkeypatch.setattr(pipeline, "_identify", lambda *_: None)  # what the data determine is not asked here
    settings = "thickness = 8\nfail_below = 0.0125"
    found = (
        studies.run(
            tmp_path,
            backend__settings=settings,
            doe='kind = "file"\nfile = "p.csv"\nheld_out = 0\nreduce = false',
            verify="max_infill = 12\ntolerance = 0.02",
            **{"parameters": studies.SECTIONS["parameters"]},
        )
        if (tmp_path / "p.csv").write_text(
            "mu,D1\n" + "".join(f"{m},{d}\n" for m in (0.006, 0.0135, 0.015, 0.018, 0.02) for d in (10, 40, 150))
        )
        else {}
    )
    assert found["feasible"]["failed"] > 3  # some candidates failed and taught
    for search in found["searches"]:
        last = [c["state"] for c in search["candidates"]]
        assert last.count("failed") < len(last)


def test_crashes_teach_nothing(tmp_path):
    found = studies.run(tmp_path, backend__settings="thickness = 8\ncrash_above = 0.015", doe=PLAIN)
    assert found["feasible"]["failed"] == 0 and found["feasible"]["story"] == ""
