"""The first picture of a report: geometry of the coloured section, its file, and what a broken file does."""

import copy
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from report_fixture import complete, deformed, draws

from rso.calibration.deformed_body import begin_deformed, body_as_plain, draw_deformed, fitted_values, write_deformed
from rso.contract import DeformedBody, DeformedFrame
from rso.report.calibration import turning
from rso.report.calibration.deformed import _without_axis, body, levels, outline, superlevel, turned
from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.calibration.report import with_files
from rso.report.layout.document import Picture

NEW = {"deformed", "pressed", "solid", "relief", "pairs"}


def area(polygon):
    x, y = np.asarray(polygon).T
    return 0.5 * float(np.abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def with_body(**changes):
    return {**complete(), "deformed": {**deformed(), **changes}, "draws": draws()}


def names(results):
    return [b.name for s in report(results).sections for b in s.blocks if isinstance(b, Picture)]


def test_a_band_covers_where_a_linear_field_is_at_least_its_level():
    at = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])
    triangles = turned(at, np.array([[0, 1, 2], [1, 2, 3]]))
    v = at[:, 0]  # f = x on a square of side 2
    for level in (-1.0, 0.5, 1.0, 1.7, 3.0):
        covered = sum(area(p) for p in superlevel(at, triangles, v, level))
        assert covered == pytest.approx(2.0 * np.clip(2.0 - level, 0.0, 2.0))
    (line,) = outline(triangles)
    assert area(at[line]) == pytest.approx(4.0) and len(line) == 4  # no edge inside
    assert len(outline(turned(at, np.array([[0, 1, 2]])))[0]) == 3


def test_pictures_are_there_with_a_body_and_only_then():
    assert NEW <= set(names(with_body())) and not NEW - {"relief"} & set(names(complete()))
    for name in NEW:
        assert draw(with_body(), name).startswith("<svg"), name
    moved = with_body()
    moved["deformed"]["frames"][-1]["points"][40][1] -= 1.0
    assert draw(moved, "deformed") != draw(with_body(), "deformed")


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.pop("frames"),
        lambda d: d.update(units=None),
        lambda d: d["frames"][0].update(triangles=[[0, 1, 10**9]]),
        lambda d: d["frames"][0].update(triangles=None),
        lambda d: d["frames"][2].update(points=[[1.0]]),
        lambda d: d["frames"][1]["fields"].update(stress=["<script>"] * 81),
        lambda d: d["frames"][1].update(indenter=[[float("nan"), 0.0]]),
    ],
)
def test_a_broken_file_is_no_picture_and_no_error(spoil):
    results = with_body()
    spoil(results["deformed"])
    assert body(results) is None and not {"deformed", "pressed", "solid"} & set(names(results))


def test_names_in_the_file_stay_text():
    nasty = "<script>alert(1)</script>"
    results = with_body(plane=nasty, units={nasty: "MPa"})
    for f in [*results["deformed"]["frames"], results["deformed"]["surface"]]:
        f["fields"] = {nasty: f["fields"]["stress"]}
    assert body(results) is not None
    assert "<script" not in draw(results, "deformed") + draw(results, "solid") + draw(results, "pressed")


def test_bands_are_round_numbers_over_all_frames():
    found = body(with_body())
    limits = 1e3 * levels(found, "stress")
    largest = max(float(f["fields"]["stress"].max()) for f in found["frames"])
    assert limits[0] == 0.0 and limits[-2] < 1e3 * largest <= limits[-1]
    steps = np.diff(limits)
    np.testing.assert_allclose(steps, steps[0])
    assert float(f"{steps[0]:.2g}") == pytest.approx(steps[0])


def test_the_caption_says_the_largest_value_of_the_picture():
    results = with_body()
    caption = next(
        b.caption for s in report(results).sections for b in s.blocks if getattr(b, "name", "") == "deformed"
    )
    largest = 1e3 * max(results["deformed"]["frames"][-1]["fields"]["stress"])
    (said,) = re.findall(r"at most ([\d.]+)\skPa", caption)
    assert float(said) == pytest.approx(largest, rel=0.01)


def test_turning_keeps_lengths_and_the_view_from_above_is_the_plan():
    x = np.random.default_rng(3).normal(size=(20, 3))
    for yaw, pitch in ((0.3, 0.2), (2.0, 1.1)):
        q = turning.seen_from(x, yaw, pitch)
        np.testing.assert_allclose((q**2).sum(1), (x**2).sum(1))
    np.testing.assert_allclose(turning.seen_from(x, 0.0, np.pi / 2)[:, :2], x[:, :2], atol=1e-12)


def test_a_body_is_completed_by_its_mirror_images():
    solid = turning.body_solid(with_body())
    np.testing.assert_allclose(np.sort(solid.points[:, 0]), np.sort(-solid.points[:, 0]), atol=1e-9)
    assert len(solid.triangles) == 2 * len(deformed()["surface"]["triangles"])
    wide, _, tall = np.ptp(solid.points, axis=0)
    assert wide == pytest.approx(2.0 * tall)  # 12 mm to either side, 12 mm high


def test_what_is_called_fitted_is_the_most_likely_run_else_the_best_candidate():
    results = complete()
    best = fitted_values(results)
    assert best == next(
        c["values"]
        for s in results["searches"]
        for c in s["candidates"]
        if (s["name"], c["name"]) == (results["best"]["search"], results["best"]["candidate"])
    )
    results["identification"]["recomputed"] = {"values": {"mu": 0.0107, "D1": 20.0}}
    assert fitted_values(results) == {"mu": 0.0107, "D1": 20.0}
    assert fitted_values({}) is None


def test_the_main_figure_and_the_headline_are_of_one_model():
    results = complete()
    first = draw(results, "curve-0")
    best = next(c for s in results["searches"] for c in s["candidates"] if c["name"] == results["best"]["candidate"])
    curves = copy.deepcopy(best["curves"])
    curves["middle_point"]["value"] = [0.9 * v for v in curves["middle_point"]["value"]]
    metrics = {"middle_point": {**best["metrics"]["middle_point"], "nrmse": 0.123}}
    results["identification"]["recomputed"] |= {"values": best["values"], "curves": curves, "metrics": metrics}
    assert draw(results, "curve-0") != first
    facts = [f for b in report(results).sections[0].blocks if hasattr(b, "facts") for f in b.facts]
    assert next(f for f in facts if f.label == "Fit").value.replace("\xa0", " ") == "12 %"


def frame(u, points):
    return DeformedFrame(u, u, points, np.array([[0, 1, 2]]), {"s": np.array([1.23456, 0.0, -2.0])}, points)


class Drawing:
    """What a backend with the capability has, and nothing else."""

    def __init__(self, why=None):
        self.why = why

    def deformed(self, values, case):
        if self.why:
            raise self.why
        points = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 1.23456789]])
        return DeformedBody("x to the right", {"s": "MPa"}, (frame(1.0, points), frame(2.0, points)))


def test_the_file_has_the_digits_that_can_be_seen_and_triangles_once(tmp_path):
    text = draw_deformed(Drawing(), {"mu": 1.0}, None, "key", "top")
    data = json.loads(text)
    assert data["key"] == "key" and data["experiment"] == "top" and data["surface"] is None
    assert data["frames"][0]["triangles"] == [[0, 1, 2]] and data["frames"][1]["triangles"] is None
    assert data["frames"][0]["points"][2] == [0.0, 1.235] and data["frames"][0]["fields"]["s"] == [1.235, 0.0, -2.0]
    assert body({"deformed": data})["frames"][1]["triangles"].tolist() == [[0, 1, 2]]


def test_a_picture_that_cannot_be_made_leaves_none_of_an_earlier_state(tmp_path):
    path = tmp_path / "deformed.json"
    path.write_text("{}")
    failed = SimpleNamespace(result=lambda: draw_deformed(Drawing(RuntimeError("no")), {}, None, "k", "top"))
    write_deformed(failed, tmp_path)
    assert not path.exists()
    done = SimpleNamespace(result=lambda: draw_deformed(Drawing(), {}, None, "k", "top"))
    write_deformed(done, tmp_path)
    assert json.loads(path.read_text())["key"] == "k"
    bench = SimpleNamespace(plan=SimpleNamespace(backend=object(), study=SimpleNamespace(experiments=[])))
    assert begin_deformed(bench, {}, tmp_path) is None and not path.exists()  # a backend that cannot


def test_nothing_but_points_is_rounded():
    points = np.array([[0.0, 0.0], [1e4, 0.0], [0.0, 1.0]])
    plainly = body_as_plain(DeformedBody("x", {"s": "MPa"}, (frame(0.123456789, points),)))
    assert plainly["frames"][0]["travel"] == 0.123456789


def test_a_report_reads_what_lies_in_its_folder(tmp_path):
    (tmp_path / "deformed.json").write_text(json.dumps(deformed()))
    rows = zip(*draws().values(), strict=True)
    (tmp_path / "posterior.csv").write_text("mu,D1\n" + "".join(f"{a},{b}\n" for a, b in rows))
    assert set(names(with_files(complete(), tmp_path))) >= NEW
    (tmp_path / "deformed.json").write_text("no JSON")
    (tmp_path / "posterior.csv").write_text("mu,D1\n1,x\n")
    assert with_files(complete(), tmp_path) == complete()


def test_an_outline_that_meets_the_axis_in_a_point_stays_closed():
    place = {"scale": 1.0, "x": 0.0, "high": 1.0, "tall": 1.0, "wide": 2.0}
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    half = _without_axis(square, place)
    assert len(half) == 4 and {tuple(half[0]), tuple(half[-1])} == {(0.0, 0.0), (0.0, 1.0)}  # open along the axis
    tip = np.array([[0.0, 0.5], [1.0, 0.0], [1.0, 1.0]])
    np.testing.assert_array_equal(_without_axis(tip, place), [*tip, tip[0]])
