"""Studies with objectives against fronts and optima that are known in closed form."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import rso
from rso.contract import SimulationFailed
from rso.study.errors import StudyError


@rso.model(parameters={"x": (-20.0, 20.0, "mm"), "y": (-20.0, 20.0, "mm")}, channels={"near": "mm^2", "far": "mm^2"})
def two(x, y):
    """Squares of the distances from (0, 0), times 4, and from (5, 5): Binh and Korn (1997)."""
    return {"near": 4 * x**2 + 4 * y**2, "far": (x - 5) ** 2 + (y - 5) ** 2}


HEAD = """[study]
title = "Toy"
seed = 5
[backend]
use = "nowhere:to_be_given"
[report]
pdf = false
html = false
"""
SMALL = """[doe]
runs = 16
held_out = 2
[search]
population = 40
generations = 40
candidates = 4
[sensitivity]
samples = 64
"""
QUADRATIC = '[surrogate]\nkind = "polynomial"\n'
BINH_KORN = """[parameters]
x = { low = 0, high = 5 }
y = { low = 0, high = 3 }
[objectives]
minimise = ["near", "far"]
constraints = ["far <= 45"]
"""


def study(folder: Path, text: str, model, head: str = HEAD):
    (folder / "study.toml").write_text(head + text)
    return rso.pareto(folder, backend=model)


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    return study(tmp_path_factory.mktemp("binh_korn"), BINH_KORN + SMALL + QUADRATIC, two).run()


def on_front(near):
    """x = y = t up to (3, 3); from there y stays 3 and x goes on to 5."""
    t = np.sqrt(near / 8)
    x = np.sqrt(np.maximum(near - 36, 0) / 4)
    return np.where(t <= 3, 2 * (t - 5) ** 2, (x - 5) ** 2 + 4)


def test_a_front_in_closed_form_is_found_and_proved(solved):
    assert solved.exit_code == 0 and solved.candidates["verified"].all() and solved.candidates["meets"].all()
    assert np.allclose(solved.front["far"], on_front(solved.front["near"]), rtol=1e-3, atol=1e-3)
    assert np.allclose(solved.candidates["far"], on_front(solved.candidates["near"]), rtol=1e-3, atol=1e-3)
    # The limit cuts the front at 2 (t - 5)^2 = 45, the other end is (5, 3).
    assert solved.front["far"].max() == pytest.approx(45.0, rel=1e-3)
    assert solved.front["far"].min() == pytest.approx(4.0, rel=1e-3)
    assert solved.candidates["far"].max() <= 45.0 * (1 + 1e-6)


def test_the_same_study_gives_the_same_answer_and_computes_nothing_twice(tmp_path):
    calls = []

    @rso.model(parameters={"x": (-20.0, 20.0), "y": (-20.0, 20.0)}, channels={"near": "1", "far": "1"})
    def counted(x, y):
        calls.append((x, y))
        return {"near": 4 * x**2 + 4 * y**2, "far": (x - 5) ** 2 + (y - 5) ** 2}

    text = BINH_KORN + SMALL.replace("generations = 40", "generations = 5") + QUADRATIC
    first = study(tmp_path, text, counted).run()
    n = len(calls)
    again = study(tmp_path, text, counted).run()
    assert len(calls) == n and again.data["front"] == first.data["front"]


def test_three_objectives_stand_on_their_triangle(tmp_path):
    corners = np.array([[1.0, 1.0], [4.0, 1.0], [2.0, 3.5]])

    @rso.model(parameters={"x": (0.0, 5.0), "y": (0.0, 5.0)}, channels={"a": "1", "b": "1", "c": "1"})
    def three(x, y):
        return dict(zip("abc", map(float, ((corners - [x, y]) ** 2).sum(axis=1)), strict=True))

    text = """[parameters]
x = { low = 0, high = 5 }
y = { low = 0, high = 5 }
[objectives]
minimise = ["a", "b", "c"]
"""
    found = study(tmp_path, text + SMALL + QUADRATIC, three).run()
    # Of squared distances from three points the Pareto set is their convex hull: barycentric coordinates ≥ 0.
    A = np.vstack([corners.T, np.ones(3)])
    points = np.vstack([found.front[["x", "y"]].to_numpy().T, np.ones(len(found.front))])
    weights = np.linalg.solve(A, points)
    assert weights.min() > -0.01 and len(found.front) > 20
    assert found.data["front"]["hypervolume"][-1] > 0.3


MIXED = """[parameters]
x = { low = 0.1, high = 10.0, scale = "log" }
n = { low = 1, high = 8, whole = true }
s = { values = [0.5, 1.0, 2.5, 4.0] }
kind = { choices = ["plain", "ribbed", "folded"] }
[objectives]
minimise = ["cost"]
constraints = ["strength >= 6"]
"""
GAIN = {"plain": 1.0, "ribbed": 1.6, "folded": 1.3}
PRICE = {"plain": 0.0, "ribbed": 0.9, "folded": 0.2}


def cost_of(x, n, s, kind):
    return x + 0.15 * n + 0.4 * s + PRICE[kind], GAIN[kind] * x * n**0.5 + s


@rso.model(
    parameters={"x": (0.01, 100.0), "n": rso.Parameter("n", "number of ribs", "1", 1.0, 20.0, whole=True),
                "s": (0.0, 10.0), "kind": ("plain", "ribbed", "folded")},
    channels={"cost": "1", "strength": "1"},
)  # fmt: skip
def mixed(x, n, s, kind):
    assert isinstance(n, int) and isinstance(kind, str)
    return dict(zip(("cost", "strength"), cost_of(x, n, s, kind), strict=True))


def best_by_hand():
    """Every combination, with x from the strength that is needed: its cost grows with x."""
    found = []
    for n in range(1, 9):
        for s in (0.5, 1.0, 2.5, 4.0):
            for kind in GAIN:
                x = min(max((6 - s) / (GAIN[kind] * n**0.5), 0.1), 10.0)
                cost, strength = cost_of(x, n, s, kind)
                if strength >= 6 - 1e-9:
                    found.append((cost, n, s, kind))
    return min(found)


@pytest.mark.verification  # the dozen surfaces of five rounds
def test_whole_numbers_values_and_categories_together(tmp_path):
    text = SMALL.replace("runs = 16", "runs = 40").replace("candidates = 4", "candidates = 3")
    text = text.replace("generations = 40", "generations = 20")
    found = study(tmp_path, MIXED + text, mixed).run()
    cost, n, s, kind = best_by_hand()
    best = found.best.iloc[0]
    assert best["cost"] == pytest.approx(cost, rel=0.02) and best["strength"] >= 6 * (1 - 1e-5)
    assert (best["n"], best["s"], best["kind"]) == (n, s, kind)
    assert set(found.runs["n"]) <= set(range(1, 9)) and set(found.runs["s"]) <= {0.5, 1.0, 2.5, 4.0}
    assert set(found.runs["kind"]) == set(GAIN)


def test_a_search_straight_on_simulations(tmp_path):
    text = SMALL.replace("candidates = 4", 'candidates = 1\nmethod = "simulations"')
    text = text.replace("generations = 40", "generations = 12") + '[surrogate]\nkind = "kriging"\n'
    found = study(tmp_path, MIXED + text, mixed).run()
    best = found.best.iloc[0]
    assert best["cost"] == found.data["front"]["points"][0]["objectives"]["cost"]
    assert best["cost"] < 1.2 * best_by_hand()[0] and best["strength"] >= 6 * (1 - 1e-5)
    searched = found.runs[found.runs["purpose"] == "search"]
    assert found.exit_code == 0 and 100 < len(searched) <= 40 * 12


def test_polynomials_are_fitted_for_each_category(tmp_path):
    text = MIXED.replace(', scale = "log"', "") + SMALL.replace("runs = 16", "runs = 60") + QUADRATIC
    text = text.replace("generations = 40", "generations = 2") + "[verify]\nmax_infill = 0\n"
    found = study(tmp_path, text, mixed).run()
    story = next(s["story"] for s in found.data["surfaces"] if s["quantity"] == "cost")
    assert all(f"kind {k}" in story for k in GAIN)
    held = next(s["held_out"] for s in found.data["surfaces"] if s["quantity"] == "cost")
    assert held["rmse"] < 1e-9  # the cost is linear in all numbers


def test_curves_of_any_sign_are_maximised_and_limited(tmp_path):
    @rso.model(parameters={"a": (0.0, 3.0)}, channels={}, curves={"stress": ("MPa", "stretch", "1")})
    def bent(a):
        x = np.linspace(-1.0, 1.0, 201)
        return {"stress": (x, -a * x**2 + 0.5 * a**2)}  # in the middle a²/2, at the ends a²/2 − a

    text = """[parameters]
a = { low = 0.0, high = 3.0 }
[objectives]
maximise = ["stress(0)"]
constraints = ["stress(1) <= -300 kPa", "min(stress) >= -0.45"]
"""
    found = study(tmp_path, text + SMALL.replace("candidates = 4", "candidates = 1"), bent).run()
    # a²/2 − a ≤ −0.3 between 1 ± sqrt(0.4), and a²/2 is largest at the upper end.
    assert found.best["stress(0)"][0] == pytest.approx((1 + np.sqrt(0.4)) ** 2 / 2, rel=2e-3)


def test_failed_runs_are_no_numbers_and_are_told(tmp_path):
    @rso.model(parameters={"x": (-20.0, 20.0), "y": (-20.0, 20.0)}, channels={"near": "1", "far": "1"})
    def torn(x, y):
        if x > 4.0:
            raise SimulationFailed("instability", "it buckles")
        return {"near": 4 * x**2 + 4 * y**2, "far": (x - 5) ** 2 + (y - 5) ** 2}

    found = study(tmp_path, BINH_KORN + SMALL + QUADRATIC, torn).run()
    lost = found.runs[found.runs["state"] == "failed"]
    assert len(lost) and lost["near"].isna().all() and "it buckles" in lost["reason"].iloc[0]
    assert found.exit_code == 3 and (found.candidates["state"] == "done").all()


def test_no_design_within_the_limits_is_said(tmp_path):
    found = study(tmp_path, BINH_KORN.replace("far <= 45", "far <= -1") + SMALL + QUADRATIC, two).run()
    assert found.exit_code == 6 and "No design was found" in found.data["words"][0] and found.best.empty


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('minimise = ["near", "far"]', 'minimise = ["naer"]', ["objectives.minimise[0]", "did you mean 'near'"]),
        ('minimise = ["near", "far"]', 'minimise = ["max(near)"]', ["objectives.minimise[0]", "one number"]),
        ('minimise = ["near", "far"]', "minimise = []", ["objectives", "minimise"]),
        ('"far <= 45"', '"far <= 45 N"', ["objectives.constraints[0]", "45 N"]),
        ('"far <= 45"', '"x <= 4"', ["objectives.constraints[0]", "doe.constraints"]),
        ('"far <= 45"', '"far"', ["objectives.constraints", "no constraint"]),
        ("high = 5 }", "high = 5, whole = 1 }", ["parameters.x.whole"]),
        ("low = 0, high = 5", "values = [1, 1]", ["parameters.x", "twice"]),
        ("low = 0, high = 5", 'choices = ["a", "b"]', ["parameters.x.choices", "as a number"]),
        ("low = 0, high = 5", "low = 0.5, high = 5, whole = true", ["parameters.x.low", "whole number"]),
        ("runs = 16", 'kind = "ccd"', []),
        ("[search]", '[search]\nmetric = "rmse"', ["search.metric", "study with data"]),
        ("[doe]", "[identify]\nrequire = []\n[doe]", ["identify", "study with data"]),
        ("[doe]", "[uncertainty]\nx = 0.1\n[doe]", ["uncertainty", "study with data"]),
        ("[doe]", '[surrogate]\nkind = "whole_curve"\n[doe]', ["surrogate.kind", "kriging"]),
    ],
)
def test_bad_input_is_refused_with_its_place(tmp_path, old, new, words):
    text = BINH_KORN + SMALL
    assert old in text
    if new == 'kind = "ccd"':
        new, words = 'kind = "ccd"\n', ["doe.kind", "values of its own"]
        text = text.replace("low = 0, high = 5 }", "low = 0, high = 5, whole = true }")
    with pytest.raises(StudyError) as caught:
        study(tmp_path, text.replace(old, new, 1), two)
    said = str(caught.value)
    assert re.search(r"study\.toml:\d+: ", said) and all(w in said for w in words), said


def test_a_category_is_refused_in_a_study_with_data(tmp_path):
    (tmp_path / "study.toml").write_text(HEAD + '[parameters]\nk = { choices = ["a", "b"] }\n')
    with pytest.raises(StudyError) as caught:
        rso.load(tmp_path)
    assert "parameters.k.choices" in str(caught.value) and "[[experiments]]" in str(caught.value)


def test_other_commands_refuse_a_study_with_objectives(tmp_path):
    (tmp_path / "study.toml").write_text(HEAD + BINH_KORN)
    with pytest.raises(StudyError, match="no measurements"):
        rso.load(tmp_path, backend=two)


def test_points_of_a_file_with_categories(tmp_path):
    rows = ["kind,n,x,s"] + [f"{k},{n},{x},1.0" for k in GAIN for n in (1, 4, 8) for x in (0.3, 1.0, 3.0)]
    (tmp_path / "points.csv").write_text("\n".join(rows) + "\n")
    text = MIXED + SMALL.replace("runs = 16", 'kind = "file"\nfile = "points.csv"')
    s = study(tmp_path, text, mixed)
    from rso.objectives.plan import designed

    assert len(designed(s.plan)) == 27
    (tmp_path / "points.csv").write_text("kind,n,x,s\nplane,1,1.0,1.0\n")
    with pytest.raises(StudyError, match="did you mean 'plain'"):
        designed(s.plan)


def test_the_page_shows_what_results_say(solved, tmp_path):
    files = solved.report(tmp_path / "page", pdf=False)
    text = files[0].read_text()
    for name in ("front", "designs", "convergence", "slices", "sensitivity"):
        assert f'id="{name}-' in text
    assert f"{solved.candidates['near'].iloc[1]:.4g}"[:4] in text
    assert json.loads((solved.folder / "results.json").read_text())["kind"] == "pareto"
