"""Ranges that are too narrow: what lies inside is left alone, what lies outside is found or said to be out of reach."""

import dataclasses
import itertools
import json

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies

from rso.calibration import pipeline, range_extension, stages
from rso.calibration.plan import make_plan
from rso.calibration.range_ends import RangeEnd, Stated, end_limit, ordinary
from rso.contract import knob, parameters_of
from rso.evaluation import Evaluator
from rso.evaluation.store import RunStore
from rso.report.calibration.numbers import report as document
from rso.study.loader import load_study

BOX = 'mu = {{ low = {}, high = {}, scale = "log" }}\nD1 = {{ low = {}, high = {}, scale = "log" }}'
ONE_MU = "mu = {{ low = {}, high = {} }}\nD1 = {{ value = 60 }}"
SEARCH = studies.SECTIONS["search"].replace("repair = false\n", "")
WIDE = f"{SEARCH}\nrepair_limit = 10"  # more than the one width a side that nobody has to ask for
ONE_TARGET = 'population = 20\ngenerations = 10\ntargets = [{ experiment = "top", depth = 2 }]'


@dataclasses.dataclass(frozen=True)
class Bounded:
    """Knobs of a backend that is sure of its modulus only up to 9 kPa."""

    mu: float = knob("shear modulus", "MPa", 1e-5, 0.009)
    D1: float = knob("compressibility, D1 = 2/K", "1/MPa", 0.0, 1e6, neutral=0.0)
    radius: float = knob("radius of the sphere", "mm", 0.5, 20.0, default=3.0)


class BoundedLayer(indentation_backend.Layer):
    parameters = property(lambda self: parameters_of(Bounded))


BOUNDED = BoundedLayer()


class UsualLayer(indentation_backend.Layer):
    """mu D1 is 0.72 in the measurement (studies.MU, studies.D1): an ordinary material has less, it says."""

    def ordinary(self):
        return {"sqrt(mu * D1) <= sqrt(0.5)": "a good temper", "mu * nobody < 1": "of a knob that there is not"}


USUAL = UsualLayer()


def repair(folder, **changes):
    """Design, surrogates and repair alone."""
    plan = make_plan(load_study(studies.write(folder, **{"search": SEARCH, **changes})))
    with RunStore(folder / "results") as store:
        bench = stages.Runner(plan, Evaluator(plan.backend, store, studies.Inline()))
        design = stages.run_design(bench)
        return range_extension.extend_ranges(bench, design, stages.fit_surrogates(bench, design))


def what(found):
    return [step.what for step in found.audit]


def ranges(found, name="mu"):
    return next([a.low, a.high] for a in found.bench.plan.searches[0].axes if a.name == name)


def candidates(found):
    """Values of the last candidates."""
    return [found.bench.plan.values(x) for x in found.proposal.choice.X]


def test_a_target_inside_leaves_the_ranges_untouched(tmp_path):
    """Negative control: same ranges, same runs, same answer as without repair."""
    on = studies.run(tmp_path / "on", search=SEARCH)
    off = studies.run(tmp_path / "off", search=f"{SEARCH}\nrepair = false")
    assert [a["what"] for a in on["searches"][0]["audit"]] == ["kept"] and off["searches"][0]["audit"] == []
    assert on["searches"][0]["candidates"] == off["searches"][0]["candidates"]
    assert [r["key"] for r in on["runs"]] == [r["key"] for r in off["runs"]]
    assert all([p["low"], p["high"]] == p["stated"] for p in on["parameters"])
    assert "Ranges of the main search" not in json.dumps(dataclasses.asdict(document(on)))


def test_a_modulus_outside_is_found_and_the_whole_study_follows(tmp_path):
    low, high = 0.003, 0.006
    text = f"{WIDE}\n[[search.variants]]\nname = 'same'\n[[search.variants]]\nname = 'narrow'\nranges = "
    changes = {"parameters": ONE_MU.format(low, high), "search": text + "{ mu = [0.004, 0.005] }"}
    r = studies.run(tmp_path, **changes)
    main, same, narrow = r["searches"]
    assert main["reachable"] and main["verified"] and all(not c["at_bound"] for c in main["candidates"])
    np.testing.assert_allclose(main["candidates"][0]["values"]["mu"], studies.MU, rtol=3e-3)  # the surrogate's error
    steps = [a for a in main["audit"] if a["what"] == "widened"]
    assert main["audit"][-1]["what"] == "done" and len(steps) == len(main["audit"]) - 1
    assert {(s["parameter"], s["end"], s["unit"]) for s in steps} == {("mu", "high", "MPa")}
    # Each step goes on where the last one ended, and its runs are those of the table.
    assert steps[0]["from"] == high and steps[-1]["to"] == main["ranges"]["mu"][1]
    assert all(a["to"] == b["from"] for a, b in itertools.pairwise(steps))
    assert sum(s["runs"] for s in steps) == sum(run["purpose"] == "repair" for run in r["runs"])
    # Ranges, drawings and intervals are those of the wider search, and the study file's are still told.
    (mu,) = [p for p in r["parameters"] if p["name"] == "mu"]
    assert mu["stated"] == [low, high] and [mu["low"], mu["high"]] == main["ranges"]["mu"]
    assert r["surfaces"][0]["x"]["values"][0] == mu["low"] and r["surfaces"][0]["x"]["values"][-1] == mu["high"]
    assert r["determined"]["mu"]["interval"][0] < studies.MU * 1.01
    # Variants are searched as they are written.
    assert same["ranges"]["mu"] == [low, high] and narrow["ranges"]["mu"] == [0.004, 0.005]
    assert same["audit"] == narrow["audit"] == []
    np.testing.assert_allclose(same["candidates"][0]["values"]["mu"], high, rtol=1e-6)
    told = json.dumps(dataclasses.asdict(document(r)), ensure_ascii=False)
    assert "Ranges of the main search" in told and main["audit"][-1]["why"] in told
    # A second call finds everything and changes nothing.
    again = studies.run(tmp_path, **changes)
    assert again["counts"]["from_store"] == again["counts"]["fe_runs"]
    assert studies.timeless(again) == studies.timeless(r) and again["timings"] == r["timings"]


@pytest.mark.parametrize("repaired", [True, False])
def test_targets_out_of_reach_and_values_outside_the_stated_range_are_warnings(tmp_path, repaired):
    search = WIDE if repaired else f"{SEARCH}\nrepair = false"
    r = studies.run(tmp_path, parameters=ONE_MU.format(0.003, 0.006), search=search)
    outside = [w for w in r["warnings"] if "lies outside the stated range, 0.003 to 0.006 MPa" in w]
    reach = [w for w in r["warnings"] if "not reachable" in w]
    assert (len(outside), len(reach)) == ((1, 0) if repaired else (0, 1))
    if not repaired:  # it misses the data widely and wants to go on beyond the bound
        assert "mu is not determined" in r["determined"]["mu"]["story"]


@pytest.mark.parametrize("value, beyond", [(-1.0, False), (0.5, False), (-1.001, True), (0.501, True)])
def test_a_range_may_be_negative_and_its_ends_are_inside(value, beyond):
    row = {"name": "tilt", "unit": "deg", "stated": [-1.0, 0.5]}
    assert bool(pipeline._outside({"values": {"tilt": value}}, [row])) == beyond


def test_without_repair_it_is_not_found(tmp_path):
    found = repair(tmp_path, parameters=ONE_MU.format(0.003, 0.006), search=f"{SEARCH}\nrepair = false")
    assert found.audit == () and ranges(found) == [0.003, 0.006]


def test_a_range_too_stiff_grows_downwards(tmp_path):
    found = repair(tmp_path, parameters=ONE_MU.format(0.024, 0.04))
    assert what(found)[-1] == "done" and {s.end for s in found.audit[:-1]} == {"low"}
    np.testing.assert_allclose(candidates(found)[0]["mu"], studies.MU, rtol=3e-3)


def test_two_parameters_by_similarity(tmp_path):
    found = repair(tmp_path, parameters=BOX.format(0.003, 0.006, 10, 150), search=WIDE)
    assert found.design.similar and what(found)[-1] == "done"
    values = candidates(found)[0]
    np.testing.assert_allclose([values["mu"], values["D1"]], [studies.MU, studies.D1], rtol=0.1)  # two targets, noise


def test_hard_bounds_are_said_and_not_passed(tmp_path):
    """Too soft up to its hard bound: the search must end, and no run lies beyond."""
    found = repair(
        tmp_path,
        parameters=ONE_MU.format(0.003, 0.006),
        backend='use = "test_repairing:BOUNDED"',
        search=f"{SEARCH}\nrepair_limit = 1e6",
    )
    last = found.audit[-1]
    assert last.what == "stopped" and "outside what any mu up to 0.009 MPa reaches: the best" in last.why
    assert last.why.endswith("; 0.009 MPa is the hard bound")
    assert "Fz of top at 2 mm by -0.0" in last.why
    assert ranges(found) == [0.003, 0.009] and not found.proposal.choice.reachable
    assert max(v["mu"] for v, _ in found.bench.ended) == 0.009


@pytest.mark.parametrize(
    "usual, deepest, meant",
    [
        (True, 60, False),
        (False, 150, True),
        *(pytest.param(*v, marks=pytest.mark.verification) for v in ((True, 150, True), (False, 60, False))),
    ],
)
def test_wider_ranges_keep_to_what_is_usual_unless_the_stated_ones_do_not(tmp_path, usual, deepest, meant):
    """mu D1 up to 0.36 is stated in the first, up to 0.9 in the second: whoever states that means it."""
    change = {"backend": 'use = "test_repairing:USUAL"'} if usual else {}
    found = repair(tmp_path, parameters=BOX.format(0.003, 0.006, 10, deepest), **change)
    largest = np.prod([ranges(found, n)[1] for n in ("mu", "D1")])
    assert "widened" in what(found)
    if usual and not meant:
        np.testing.assert_allclose(largest, 0.5, rtol=1e-8)  # rounding is not held against a condition
        assert all(v["mu"] * v["D1"] <= 0.5 * (1 + 1e-8) for v, _ in found.bench.ended)
        assert "is where the ranges still have a good temper all over" in found.audit[-1].why
        assert not found.bench.plan.conditions  # the ends of ranges are said to be no data, walls of χ² would not be
    else:
        assert largest > 0.5


def test_a_fixed_parameter_counts_as_its_value_and_functions_are_no_names(tmp_path):
    text = {"parameters": ONE_MU.format(0.003, 0.006), "backend": 'use = "test_repairing:USUAL"'}
    (condition,) = ordinary(make_plan(load_study(studies.write(tmp_path, **text))))
    np.testing.assert_array_equal(condition.holds({"mu": np.array([0.0083, 0.0084])}), [True, False])  # 0.5 / 60


def test_the_stated_limit_ends_it(tmp_path):
    found = repair(tmp_path, parameters=ONE_MU.format(3e-4, 6e-4), search=f"{SEARCH}\nrepair_limit = 2")
    assert what(found)[-1] == "stopped" and "search.repair_limit = 2" in found.audit[-1].why
    np.testing.assert_allclose(ranges(found), [3e-4, 1.2e-3], rtol=1e-12)  # 6e-4 and two widths
    assert len(found.audit) <= 6


@pytest.mark.parametrize(
    "low, high, scale, ends",
    [
        (3e-4, 6e-4, "linear", [3e-4, 9e-4]),
        (2e-4, 6e-4, "log", [2e-4, 1.8e-3]),
    ],
)
def test_nobody_asked_for_more_than_one_width_on_the_scale_of_the_range(tmp_path, low, high, scale, ends):
    text = f'mu = {{ low = {low}, high = {high}, scale = "{scale}" }}\nD1 = {{ value = 60 }}'
    found = repair(tmp_path, parameters=text)
    assert what(found)[-1] == "stopped" and "a width a side, the limit where" in found.audit[-1].why
    np.testing.assert_allclose(ranges(found), ends, rtol=1e-12)


@pytest.mark.parametrize("low, high", [(0.2, 1.0), (0.0, 1.0), (-1.0, -0.2), (-0.2, 1.0)])
def test_a_range_of_one_sign_keeps_it_however_wide_it_may_become(tmp_path, low, high):
    plan = make_plan(load_study(studies.write(tmp_path, search=f"{SEARCH}\nrepair_limit = 5")))
    offset = dataclasses.replace(plan.searches[0].axes[1].parameter, low=-1e3, high=1e3)
    axis = dataclasses.replace(plan.searches[0].axes[1], parameter=offset, low=low, high=high, scale="linear")
    axes = (plan.searches[0].axes[0], axis)
    found = [end_limit(plan, axes, Stated(axes, ()), RangeEnd(1, side)) for side in (0, 1)]
    widest = 5.0 * (high - low)
    np.testing.assert_allclose(
        [far for far, _ in found],
        [max(low - widest, 0.0) if low >= 0 else low - widest, min(high + widest, 0.0) if high <= 0 else high + widest],
    )
    assert ("change its sign" in found[0][1]) == (low >= 0) and ("change its sign" in found[1][1]) == (high <= 0)


def test_a_valley_goes_to_its_limit_at_once(tmp_path):
    found = repair(tmp_path, parameters=BOX.format(0.006, 0.04, 10, 60), search=f"{ONE_TARGET}\nrepair_limit = 2")
    assert found.proposal.choice.kind == "valley"
    assert {(s.parameter, s.end, s.after) for s in found.audit[:-1]} == {("D1", "low", 5), ("D1", "high", 120)}
    last = found.audit[-1].why
    assert last.startswith("every D1 down to 5 1/MPa and D1 up to 120 1/MPa agrees with the targets, along a valley; ")
    assert last.endswith("search.repair_limit = 2 ends the range at 120 1/MPa")


def test_a_valley_is_not_followed_where_the_surrogates_fail(tmp_path):
    """Quadratic polynomials do not span three decades: ranges and surrogates are those of before again."""
    quadratic = 'kind = "polynomial"\ndegree = 2'
    found = repair(tmp_path, parameters=BOX.format(0.006, 0.04, 10, 60), search=ONE_TARGET, surrogate=quadratic)
    assert set(what(found)) == {"widened", "taken back", "stopped"}
    assert "surrogates miss new runs" in found.audit[-1].why
    emulator, added = found.fitted.emulator, [r.values for r in found.fitted.added if r.purpose == "repair"]
    assert ranges(found, "D1") == [10, 60] and (emulator.box.low[1], emulator.box.high[1]) == (10, 60)
    assert len(added) == sum(s.runs for s in found.audit) and not any(s.values in added for s in emulator.samples)


@pytest.mark.parametrize(("setting", "word"), [("fail_below = 0.0239", "inversion"), ("crash_above = 0.0061", "crash")])
def test_runs_without_an_answer_bar_the_way(tmp_path, setting, word):
    low, high = (0.024, 0.04) if word == "inversion" else (0.003, 0.006)
    found = repair(
        tmp_path,
        parameters=ONE_MU.format(low, high),
        backend__settings=f"thickness = {studies.THICKNESS}\n{setting}",
    )
    assert what(found) == ["widened", "taken back", "stopped"]
    assert f" points tried has an answer. The simulation says: {word}, " in found.audit[-1].why
    assert ranges(found) == [low, high]
    assert found.bench.plan.feasible(np.linspace(0, 1, 9)[:, None]).all()  # what fails outside bars nothing inside


def test_a_failed_probe_outside_the_ranges_does_not_spoil_the_exit_code(tmp_path):
    soft = {
        "search": SEARCH,
        "parameters": ONE_MU.format(0.01205, 0.013),
        "backend__settings": f"thickness = {studies.THICKNESS}\nfail_below = 0.01204",
    }
    r = studies.run(tmp_path / "fails", **soft)
    assert [x["state"] for x in r["runs"] if x["purpose"] == "repair"] == ["failed", "failed"]
    assert r["counts"]["failed"] == 2 and r["exit_code"] == 0


def test_targets_that_contradict_each_other_move_nothing(tmp_path):
    search = (
        'population = 20\ngenerations = 10\ntargets = [{ experiment = "top", depth = 2, value = "0.1 N" }, '
        '{ experiment = "top", depth = 1, value = "0.1 N" }]'
    )
    found = repair(tmp_path, parameters=ONE_MU.format(0.001, 0.04), search=search)
    assert what(found) == ["stopped"] and "wider ones would not help" in found.audit[0].why
    assert ranges(found) == [0.001, 0.04]


@pytest.mark.parametrize("key", ["repair = 1", "repair_limit = 1.0", 'repair = "yes"', "repair_limit = -3"])
def test_bad_keys_are_refused(tmp_path, key):
    with pytest.raises(ValueError, match="repair"):
        load_study(studies.write(tmp_path, search=f"{SEARCH}\n{key}"))


@pytest.mark.parametrize("interval, said", [((0.001, 200.0), False), ((40.0, 200.0), False), ((70.0, 200.0), True)])
def test_a_value_outside_the_stated_range_is_no_fault_where_stated_ones_agree_as_well(interval, said):
    """What the data do not determine may lie anywhere: the range is not wrong, and nothing is missing."""
    from rso.calibration.pipeline import _outside

    found = {"values": {"D1": 90.0}, "parameters": [{"parameter": "D1", "interval": list(interval)}]}
    assert bool(_outside(found, [{"name": "D1", "unit": "1/MPa", "stated": [0.9, 60.0]}])) == said
