"""The exit code of a study, its reason, and which candidate may be called the best."""

import copy
import json

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration.exit_codes import exit_code_of
from rso.cli.checking import check_lines
from rso.contract import NotFinite, Response, SimulationFailed
from rso.core.units import spaced
from rso.evaluation.dispatch import simulate
from rso.optimise.targets import Constraint, Target, against, excess_over_limits
from rso.optimise.verification import agreement
from rso.study.errors import StudyError
from rso.study.loader import load_study

FE = {
    "verified": True,
    "meets": True,
    "state": "done",
    "name": "main 1",
    "worst": "e:Fz@1",
    "agreement": 0.2,
    "values": {"k": 1.0},
    "demands": [],
    "outputs": [{"output": "e:Fz@1", "predicted": 1.0, "recomputed": 1.25}],
}
GOOD = {
    "searches": [{"name": "main", "verified": True, "met": True, "candidates": [FE], "story": ""}],
    "closest": None,
    "verify": {"tolerance": 0.005},
    "outputs": [{"id": "e:Fz@1", "unit": "N"}],
    "determined": {"k": {"determined": True, "story": "k is open."}},
    "predictions": [{"experiment": "v", "verdict": "yes", "channels": [], "p_value": 0.5, "why": None}],
    "experiments": [{"name": "v", "role": "validate"}],
    "runs": [{"key": "1", "state": "done", "purpose": "design", "values": {}, "reason": None}],
}


def changed(**what):
    found = copy.deepcopy(GOOD)
    if what.get("unverified"):
        found["searches"][0]["verified"] = found["searches"][0]["candidates"][0]["verified"] = False
    if what.get("unmet"):
        found["searches"][0]["met"] = False
        miss = against(Target("e", "Fz", 1.0, 1.0, 0.01, "N"), "e:Fz@1", 1.25)
        found["searches"][0]["candidates"][0]["demands"] = [{"met": False, "words": str(miss)}]
    if what.get("open"):
        found["determined"]["k"]["determined"] = False
    if what.get("invalid"):
        found["predictions"][0].update(verdict="no", p_value=0.001, channels=[{"channel": "Fz", "missed": True}])
    if what.get("failed"):
        found["runs"].append({"key": "2", "state": "failed", "purpose": "design", "values": {}, "reason": "too deep"})
    return found


def test_the_first_reason_in_the_order_4_6_5_7_3_is_the_exit_code():
    everything = ["unverified", "unmet", "open", "invalid", "failed"]
    words = [
        "predicted as 1 N",
        "missed by +0.25 N (tolerance 0.01 N)",
        "k, required",
        "'v' is not predicted (Fz missed)",
        "too deep",
    ]
    for k, (code, said) in enumerate(zip([4, 6, 5, 7, 3], words, strict=True)):
        got, reason = exit_code_of(changed(**dict.fromkeys(everything[k:], True)), ["k"], strict=True)
        assert got == code and said in reason and "\n" not in reason
    assert exit_code_of(GOOD, ["k"], strict=True) == (0, None)
    assert exit_code_of(changed(invalid=True), [], strict=False) == (0, None)
    assert exit_code_of(changed(open=True), [], strict=True) == (0, None)  # nobody requires it


def test_strict_asks_for_a_verdict():
    found = copy.deepcopy(GOOD)
    found["predictions"] = []
    assert exit_code_of(found, [], strict=True)[0] == 7 and exit_code_of(found, [], strict=False)[0] == 0
    found["experiments"] = []
    assert exit_code_of(found, [], strict=True) == (0, None)


def test_runs_outside_the_ranges_or_of_before_make_no_3():
    for purpose in ("repair", "interval", "stored"):
        found = changed(failed=True)
        found["runs"][-1]["purpose"] = purpose
        assert exit_code_of(found, [], strict=False) == (0, None)


def test_a_target_of_zero_is_verified_by_its_own_size():
    """At 0.5 % a prediction may be off by a tenth of a standard deviation; large values count relatively."""
    for predicted, recomputed, good in (
        (0.0009, 0.0, True),
        (0.0011, 0.0, False),
        (-0.0009, -1e-12, True),
        (100.4, 100.0, True),
        (100.6, 100.0, False),
        (-100.6, -100.0, False),
    ):
        gap, worst = agreement({"a": (predicted, 0.0)}, {"a": recomputed}, {"a": 0.01})
        assert (gap <= 0.005) == good and worst == "a"


@pytest.mark.parametrize(("low", "high"), [(1.0, np.inf), (-np.inf, -2.0), (-1.0, 1.0), (0.0, np.inf)])
def test_limits_are_kept_to_the_rounding(low, high):
    limits = Constraint("e", "G", 1.0, low, high, "1")
    for limit, out in ((low, -1), (high, 1)):
        if np.isfinite(limit):
            assert (
                excess_over_limits(limits, "e:G@1", limit).met
                and excess_over_limits(limits, "e:G@1", limit - out * 1e-3).met
            )
            broken = excess_over_limits(limits, "e:G@1", limit + out * 1e-3)
            assert not broken.met and np.sign(broken.miss) == out and "G of e at 1 mm" in str(broken)
    assert not excess_over_limits(limits, "e:G@1", np.nan).met


def test_a_target_read_off_noisy_data_is_met_within_three_sigma_and_the_error_a_stated_one_within_one():
    stated, read = (Target("e", "Fz", 1.0, -2.0, 0.1, "N", r) for r in (False, True))
    assert against(stated, "", -2.09).met and not against(stated, "", -2.11, 1.0).met
    assert against(read, "", -2.34, 0.05).met and not against(read, "", -2.36, 0.05).met


def test_a_number_without_unit_stands_alone():
    assert spaced("1") == spaced("") == "" and spaced("N") == " N"


def test_a_response_that_is_no_number_at_one_depth_fails_and_keeps_the_others():
    channels = {"time": [1, 2, 3], "travel": [0.5, 1.0, 1.5], "Fz": [1.0, 2.0, np.nan]}
    units = {"time": "s", "travel": "mm", "Fz": "N"}

    class Backend:
        def __call__(self, values, case):
            return Response(channels, units, {"Fz": [0.1, 0.2, np.nan]})

    with pytest.raises(NotFinite, match=r"'Fz' is nan at travel 1\.5 mm"):
        Backend()({}, None)
    failed = simulate(Backend(), {}, None).result
    assert isinstance(failed, SimulationFailed) and failed.cause == "not_finite"
    np.testing.assert_array_equal(failed.partial.channels["travel"], [0.5, 1.0])
    np.testing.assert_array_equal(failed.partial.error["Fz"], [0.1, 0.2])
    with pytest.raises(ValueError, match="at least 0"):  # a wrong error at a good depth is another matter
        Response({**channels, "Fz": [1, 2, 3]}, units, {"Fz": [0.1, np.nan, 0.2]})


def test_a_design_with_too_few_runs_is_refused_by_check_with_how_many_are_needed(tmp_path):
    few = studies.write(tmp_path, doe="runs = 3\nheld_out = 0\nreduce = false")
    with pytest.raises(StudyError, match=r"doe.runs: 3 runs are too few .* at least 4 are needed"):
        check_lines(load_study(few), tmp_path / "results", True)
    enough = studies.write(tmp_path, doe="runs = 4\nheld_out = 0\nreduce = false")
    assert check_lines(load_study(enough), tmp_path / "results", True)[0].endswith("good")


def test_a_constraint_that_leaves_next_to_nothing_is_named(tmp_path):
    doe = 'runs = 8\nheld_out = 0\nreduce = false\nconstraints = ["D1 < 140", "mu * D1 < 0.0605"]'
    with pytest.raises(StudyError, match=r"'mu \* D1 < 0.0605' leaves .* %, 'D1 < 140' leaves 9\d %"):
        check_lines(load_study(studies.write(tmp_path, doe=doe)), tmp_path / "results", True)


def test_no_candidate_that_violates_a_constraint_is_the_best(tmp_path):
    limits = 'constraints = [{ experiment = "top", channel = "Fz", depth = 2, low = 1e3 }]'
    found = studies.run(tmp_path, search=studies.SECTIONS["search"] + "\n" + limits)
    assert found["exit_code"] == 6 and found["best"] is None and found["closest"]["candidate"] == "main 1"
    assert "Fz of top at 2 mm >= 1000 N is violated" in found["exit_reason"]
    broken = [d for d in found["searches"][0]["candidates"][0]["demands"] if not d["met"]]
    assert broken[-1]["kind"] == "constraint" and broken[-1]["miss"] < -900
    json.dumps(found, allow_nan=False)
