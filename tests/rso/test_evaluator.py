"""The one runner: outcomes of cases at points in order, each simulated once, its cost, and why one has no answer."""

import os
from concurrent.futures import Future
from pathlib import Path

import dummy_backend as dummy
import sample_studies as studies

from rso.contract import Case, Programme
from rso.evaluation import Done, Evaluator, Failed, WorkerPool, in_rows, responses, why
from rso.evaluation.store import RunStore


def case(name, asked, log=""):
    return Case(name, Programme.ramp(asked), {"log": str(log)} if log else {})


def test_outcomes_are_by_point_and_case_and_known_ones_are_not_computed_again(tmp_path: Path):
    points = [{"x": 1.0}, {"x": 2.0}, {"x": 1.0}]
    cases = [case("short", (1.0, 2.0), tmp_path / "log"), case("long", (1.0, 3.0), tmp_path / "log")]
    with RunStore(tmp_path) as store:
        evaluator = Evaluator(dummy.BACKEND, store, studies.Inline())
        found = evaluator.at(cases, points)
        assert [len(row) for row in found] == [2, 2, 2]
        assert [[o.case.name for o in row] for row in found] == [["short", "long"]] * 3
        assert found[0][0].key == found[2][0].key != found[1][0].key
        assert set(evaluator.cost) == {o.key for row in found for o in row} and len(evaluator.cost) == 4
        again = Evaluator(dummy.BACKEND, store, studies.Inline())
        assert dummy.calls(tmp_path / "log", "begin") == 4
        assert [o.key for o in again.at(cases, points)[1]] == [o.key for o in found[1]]
        assert dummy.calls(tmp_path / "log", "begin") == 4
        assert not isinstance(answers := responses(found[0]), str)
        assert len(answers) == 2


def test_what_takes_moments_does_not_wait_behind_simulations(tmp_path: Path):
    begun: Future[None] = Future()
    with RunStore(tmp_path) as store, WorkerPool(1) as pool:
        evaluator = Evaluator(dummy.BACKEND, store, pool, ahead={"key": begun})
        assert evaluator.each_now(_process, [1, 2]) == [os.getpid()] * 2
        begun.set_result(None)
        (there,) = set(evaluator.each_now(_process, [1, 2]))
        assert there == evaluator.each(_process, [1])[0] != os.getpid()


def _process(_: int) -> int:
    return os.getpid()


def test_a_run_without_an_answer_says_why_and_is_no_number():
    failed = Failed("k", {}, case("a", (1.0,)), "instability", "buckled\nat 1 mm", 0.0, 0.0)
    assert why(failed) == ("instability", "buckled") and responses([failed]) == "buckled"
    assert in_rows(list(range(6)), 3) == [(0, 1, 2), (3, 4, 5)] and not isinstance(failed, Done)
