"""Many cases, one library: also when a round goes on after an interruption."""

import json
from dataclasses import dataclass, replace

import diagnosis_backend as toy
import pytest

from rso.cli import main
from rso.discrepancy import blind, make_test_plan


@dataclass(frozen=True)
class Place:
    settings: dict
    deepest: float


@dataclass(frozen=True)
class Plan:
    places: tuple[Place, ...]
    scale: float = 1.0


@dataclass(frozen=True)
class Base:
    backend: None = None


@dataclass(frozen=True)
class Case:
    plan: Plan
    base: Base


@dataclass(frozen=True)
class Library:
    plan: object
    effects: tuple


DEEPEST = {"case_1": 5.5, "case_2": 6.2, "case_3": 5.0, "case_4": 3.0}


@pytest.fixture
def libraries(monkeypatch):
    """Depths of the plans that a library was asked for, by case in order."""
    asked = []
    monkeypatch.setattr(blind, "Asked", Case)

    def read(case, out, seed):
        return Case(Plan((Place({"at": 0}, DEEPEST[case.name]),)), Base())

    monkeypatch.setattr(blind, "_read", read)
    monkeypatch.setattr(blind, "_taken", lambda case, one: {"files": [], "support": {}, "assumed": []})
    monkeypatch.setattr(blind, "_library", lambda one, *rest: asked.append(one.plan.places[0].deepest))
    monkeypatch.setattr(blind, "judge_library", lambda one, library, rerun: {"diagnosis": {"verdict": "no_gap"}})
    return asked


def test_plans_share_the_depth_of_the_deepest_within_reach(libraries, tmp_path):
    assert len(list(blind.diagnose_cases([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0))) == 4
    assert libraries == [6.2, 6.2, 6.2, 3.0]  # the last ends more than 2 mm before: its own


@pytest.mark.parametrize("times, made", [(1.001, 1), (4.0, 2)])
def test_a_library_serves_tests_at_its_own_speeds(monkeypatch, times, made):
    """Slow ones too, at 0.6 and 2.4 mm/min."""
    built = []
    monkeypatch.setattr(
        blind.discrepancy, "build_library", lambda base, plan, *_: built.append(plan) or Library(plan, ())
    )
    known = {}
    for v in (0.01, 0.01 * times):
        plan = make_test_plan([replace(e, speed=v) for e in toy.laboratory(toy.TRUTH, 0)])
        blind._library(blind.Asked(None, toy.base(), plan, ()), known, None, None, None)
    assert len(built) == made


def test_a_round_that_goes_on_keeps_its_library_and_its_answers(libraries, tmp_path):
    """The deepest case has its answer already; the others still share the library that was made for it."""
    (tmp_path / "case_2.json").write_text(json.dumps({"kept": True}))
    names = [name for name, _ in blind.diagnose_cases([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0)]
    assert [n if isinstance(n, str) else n.name for n in names] == ["case_1", "case_3", "case_4"]
    assert libraries == [6.2, 6.2, 3.0]
    assert json.loads((tmp_path / "case_2.json").read_text()) == {"kept": True}


def test_a_case_that_cannot_be_read_stops_no_other(libraries, tmp_path, monkeypatch):
    read = blind._read
    bad = ValueError("case_1: no depth")
    monkeypatch.setattr(blind, "_read", lambda case, out, seed: bad if case.name == "case_1" else read(case, out, seed))
    found = [
        answer for _, answer in blind.diagnose_cases([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0)
    ]
    assert found[0] == {"error": "case_1: no depth"}
    assert all("diagnosis" in answer for answer in found[1:])


def test_an_error_is_no_answer_and_is_tried_again(libraries, tmp_path):
    cases = [tmp_path / "case_1", tmp_path / "case_2"]
    (tmp_path / "case_1.json").write_text(json.dumps({"error": "case_1: no depth"}))
    (tmp_path / "case_2.json").write_text('{"diagnosis": {"ver')  # cut off
    assert [name for name, _ in blind.diagnose_cases(cases, tmp_path, None, None, seed=0)] == ["case_1", "case_2"]
    assert json.loads((tmp_path / "case_1.json").read_text())["diagnosis"] == {"verdict": "no_gap"}
    assert not list(blind.diagnose_cases(cases, tmp_path, None, None, seed=0))


def test_the_exit_code_stays_while_a_case_has_an_error(tmp_path, capsys):
    (tmp_path / "case_1").mkdir()
    (tmp_path / "case_1" / "nominal.json").write_text('{"weight_N": 3}')
    for _ in range(2):
        assert main(["blind", str(tmp_path), "--out", str(tmp_path / "answers")]) == 2
        assert "specimen.semi_axes_mm = None" in capsys.readouterr().out
    (tmp_path / "answers" / "case_1.json").write_text('{"diagnosis": {}}')
    assert main(["blind", str(tmp_path), "--out", str(tmp_path / "answers")]) == 0


def test_what_files_were_taken_for_is_said_at_the_first_reading_and_kept(libraries, tmp_path, monkeypatch):
    file = {
        "file": "top.csv",
        "kind": "force",
        "place_mm": [0.0, 0.0],
        "role": "fit",
        "cycle": False,
        "repeats": 2,
        "speed_mm_per_min": 30.0,
        "speed_from": "assumed",
    }
    taken = {"files": [file], "support": {"kind": "fixed"}, "assumed": ["nominal.json states no support"]}
    monkeypatch.setattr(blind, "_taken", lambda case, one: taken)
    said: list[str] = []
    cases = [tmp_path / "case_1", tmp_path / "case_2"]
    found = list(blind.diagnose_cases(cases, tmp_path, None, None, seed=0, say=said.append))
    assert said[:5] == [
        "case_1:",
        "  top.csv: force curve at (0, 0) mm, role fit, 30 mm/min assumed, 2 repeat(s)",
        '  support: {"kind": "fixed"}',
        "  nominal.json states no support",
        "case_2: taken for the same as case_1",
    ]
    assert all(data["taken"] == taken for _, data in found)
    assert json.loads((tmp_path / "case_2.json").read_text())["taken"]["files"] == [file]


def test_a_library_serves_cases_of_its_own_ranges_only():
    """A case held for 3000 s beside one of 8 s had its relaxation times cut off at 100 s, by what lay in the folder."""
    plan = make_test_plan(toy.laboratory(toy.TRUTH, 0))
    (e,) = toy.effects("stiff")
    wider = replace(e, size=replace(e.size, high=2.0 * e.size.high))
    (bias,) = toy.effects("bias")  # of the chain: nothing is computed for it
    keys = [
        blind._key(blind.Asked(None, toy.base(), plan, effects))
        for effects in ((e, bias), (wider, bias), (e, replace(bias, size=replace(bias.size, high=9.0))))
    ]
    assert keys[0] != keys[1] and keys[0] == keys[2]
