"""Many cases, one library: also when a round goes on after an interruption."""

import json
from dataclasses import dataclass

import pytest

from rso.study import blind


@dataclass(frozen=True)
class Place:
    settings: dict
    deepest: float


@dataclass(frozen=True)
class Plan:
    places: tuple[Place, ...]


@dataclass(frozen=True)
class Base:
    backend: None = None


@dataclass(frozen=True)
class Case:
    plan: Plan
    base: Base


DEEPEST = {"case_1": 5.5, "case_2": 6.2, "case_3": 5.0, "case_4": 3.0}


@pytest.fixture
def libraries(monkeypatch):
    """Depths of the plans that a library was asked for, by case in order."""
    asked = []
    monkeypatch.setattr(blind, "Asked", Case)

    def read(case, out, seed):
        return Case(Plan((Place({"at": 0}, DEEPEST[case.name]),)), Base())

    monkeypatch.setattr(blind, "_read", read)
    monkeypatch.setattr(blind, "_library", lambda one, *rest: asked.append(one.plan.places[0].deepest))
    monkeypatch.setattr(blind, "judge", lambda one, library, rerun: {"diagnosis": {"verdict": "no_gap"}})
    return asked


def test_plans_share_the_depth_of_the_deepest_within_reach(libraries, tmp_path):
    assert len(list(blind.answer([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0))) == 4
    assert libraries == [6.2, 6.2, 6.2, 3.0]  # the last ends more than 2 mm before: its own


def test_a_round_that_goes_on_keeps_its_library_and_its_answers(libraries, tmp_path):
    """The deepest case has its answer already; the others still share the library that was made for it."""
    (tmp_path / "case_2.json").write_text(json.dumps({"kept": True}))
    names = [name for name, _ in blind.answer([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0)]
    assert [n if isinstance(n, str) else n.name for n in names] == ["case_1", "case_3", "case_4"]
    assert libraries == [6.2, 6.2, 3.0]
    assert json.loads((tmp_path / "case_2.json").read_text()) == {"kept": True}


def test_a_case_that_cannot_be_read_stops_no_other(libraries, tmp_path, monkeypatch):
    read = blind._read
    bad = ValueError("case_1: no depth")
    monkeypatch.setattr(blind, "_read", lambda case, out, seed: bad if case.name == "case_1" else read(case, out, seed))
    found = [answer for _, answer in blind.answer([tmp_path / n for n in DEEPEST], tmp_path, None, None, seed=0)]
    assert found[0] == {"error": "case_1: no depth"}
    assert all("diagnosis" in answer for answer in found[1:])
