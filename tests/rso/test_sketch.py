"""The sketch of an experiment: its data, its characters in a terminal, its figure in reports."""

import dataclasses

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.path import Path as Outline
from scipy.spatial import ConvexHull

from fem_backend.backend import BACKEND
from fem_backend.members import length_words
from rso.cli.text_sketch import text_sketch
from rso.contract import plain
from rso.report import sketch as sketches
from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.discrepancy import figures as diagnosis
from rso.report.language.catalogue import sentences_of
from rso.report.layout.document import Picture
from rso.report.model_selection import figures as ladder
from rso.report.optimal_design import report as next_test
from rso.report.sketch import sketch_blocks

BALL = {"shape": "sphere", "radius": 1.0, "shaft": True}
SLAB = {"specimen": {"shape": "slab", "thickness": 2.3}, "indenter": BALL, "support": {"kind": "bonded"}}
LAYERED = [{"thickness": 0.5, "ratio": 5.0}, {"thickness": 2.0, "ratio": 2.0}]
PUCK = {**SLAB, "specimen": {"shape": "cylinder", "radius": 10.0, "height": 8.0, "layers": LAYERED}}
OFF = {"point": [20.0, 10.0], "direction": "normal"}
BOWL = {"support": {"kind": "bowl", "clearance": 2.0}}
CASES = {
    "slab": (SLAB, 0.8),
    "puck": (PUCK, 1.0),
    "half_space": ({**SLAB, "specimen": {"shape": "half_space"}}, 1.0),
    "ellipsoid": ({}, 4.0),
    "off the top": (OFF, 4.0),
    "bowl": (BOWL, 4.0),
    "small": ({**SLAB, "specimen": {"shape": "slab", "thickness": 2e-3}, "indenter": {**BALL, "radius": 1e-3}}, 3e-4),
    "thick": ({**SLAB, "specimen": {"shape": "slab", "thickness": 50.0}}, 0.5),
}


def sketched(name):
    """The sketch of a case as results hold it."""
    return plain(dataclasses.asdict(BACKEND.sketch(*CASES[name])))


def parts(sketch, role):
    return [np.array(p["points"]) for p in sketch["drawn"] if p["role"] == role]


def test_a_sentence_says_what_is_modelled():
    said = sketched("slab")["words"]
    assert said == (
        "a ball of radius 1 mm pressed into a slab of thickness 2.3 mm, bonded to a rigid base; 0.8 mm at the deepest"
    )
    assert "2 µm" in sketched("small")["words"] and "0.3 µm at the deepest" in sketched("small")["words"]
    assert "0.5 mm (5 times as stiff) and 2 mm (2 times as stiff)" in sketched("puck")["words"]
    assert "in a bowl 2 mm larger all round" in sketched("bowl")["words"]
    assert "at x = 20, y = 10 mm, along the normal" in sketched("off the top")["words"]


@pytest.mark.parametrize(
    ("specimen", "said"),
    [
        ({"shape": "slab", "thickness": 5.0}, "its base held"),
        ({"shape": "cylinder", "radius": 10.0, "height": 8.0}, "its base held"),
        ({"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "its lower half held"),
        ({"shape": "surface", "held": {"below": -2.0}}, "held below z = -2 mm"),
        ({"shape": "surface", "held": {"box": [[-9, -9, -9], [9, 9, -1]]}}, "held inside a box"),
    ],
)
def test_what_is_held_is_said_of_the_specimen(tmp_path, specimen, said):
    """The support that holds the lower part holds the base of a slab, and of a scan the region that is stated."""
    if specimen["shape"] == "surface":
        k = np.arange(200) + 0.5  # a ball of 4 mm by the hull of a Fibonacci lattice
        z, turn = 1.0 - k / 100.0, np.pi * (1.0 + np.sqrt(5.0)) * k
        x = 4.0 * np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])
        lines = [f"v {a} {b} {c}" for a, b, c in x] + [f"f {a} {b} {c}" for a, b, c in ConvexHull(x).simplices + 1]
        (tmp_path / "ball.obj").write_text("\n".join(lines) + "\n")
        specimen = {**specimen, "file": str(tmp_path / "ball.obj"), "unit": "mm"}
    settings = {"specimen": specimen, "indenter": {**BALL, "shaft": False}, "support": {"kind": "fixed"}}
    sketch = plain(dataclasses.asdict(BACKEND.sketch(settings, 0.4)))
    assert f", {said}" in sketch["words"]
    assert said in [p["text"] for p in sketch["drawn"]] or specimen["shape"] == "surface"
    assert sentences_of("de").phrase(said) != said


def test_a_slab_lies_where_it_is_and_is_held_below():
    sketch = sketched("slab")
    (body,), (held,), (ball,), (deepest,) = (parts(sketch, r) for r in ("specimen", "held", "indenter", "deepest"))
    assert (body[:, 1].min(), body[:, 1].max()) == (0.0, 2.3)
    assert np.all(held[:, 1] == 0.0) and np.ptp(held[:, 0]) == np.ptp(body[:, 0])
    assert ball[:, 1].min() == pytest.approx(2.3) and deepest[:, 1].min() == pytest.approx(1.5)
    assert np.abs(ball[:, 0]).max() == pytest.approx(1.0)
    np.testing.assert_allclose(parts(sketch, "contact")[0], [[0.0, 2.3]])
    assert sorted(p["text"] for p in sketch["drawn"] if p["role"] == "dimension") == ["0.8 mm", "2.3 mm"]


def test_layers_lie_from_the_top_down():
    first, second = parts(sketched("puck"), "layer")
    assert (first[:, 1].min(), first[:, 1].max()) == (7.5, 8.0)
    assert (second[:, 1].min(), second[:, 1].max()) == (5.5, 7.5)


@pytest.mark.parametrize("name", CASES)
def test_what_holds_lies_outside_to_the_right_of_its_way(name):
    sketch = sketched(name)
    (body,) = parts(sketch, "specimen")
    size = np.ptp(body)
    for line in [*parts(sketch, "held"), *parts(sketch, "support")]:
        way = np.diff(line, axis=0)
        right = np.column_stack([way[:, 1], -way[:, 0]]) / np.linalg.norm(way, axis=1, keepdims=True)
        beside = 0.5 * (line[1:] + line[:-1]) + 0.05 * size * right
        assert not Outline(body).contains_points(beside).any()
    assert bool(parts(sketch, "held") or parts(sketch, "support")) is (name != "half_space")


def test_a_bowl_is_larger_than_its_body_by_its_clearance():
    (wall,) = parts(sketched("bowl"), "support")
    np.testing.assert_allclose((wall[:, 0] / 62.0) ** 2 + ((wall[:, 1] - 2.0) / 37.0) ** 2, 1.0)
    assert wall[:, 1].max() <= 0.0 and wall[:, 1].min() == pytest.approx(-35.0)  # it touches the lowest point


def test_the_section_leads_through_the_place_of_the_test():
    """The contact lies on the ellipse and where the test is; the indenter goes down by its travel along the normal."""
    sketch = sketched("off the top")
    ((contact,),) = parts(sketch, "contact")
    s = np.hypot(20.0, 10.0)
    z = 35.0 * np.sqrt(1.0 - (20.0 / 60.0) ** 2 - (10.0 / 35.0) ** 2)
    np.testing.assert_allclose(contact, [s, z], rtol=1e-6)
    (body,) = parts(sketch, "specimen")
    assert np.abs(body[:, 0]).max() == pytest.approx(s / np.hypot(20.0 / 60.0, 10.0 / 35.0))


@pytest.mark.parametrize("name", CASES)
def test_in_a_terminal_it_fits_and_shows_every_part(name):
    sketch = sketched(name)
    lines = text_sketch(sketch)
    assert len(lines) <= 13 and max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert text.isascii() or "µ" in text
    assert text.count("#") > 1 and text.count(".") > 20  # one is that of the legend
    assert (" + at " in text) is (text.count("+") > 1)  # a ball of one character covers where it ends
    assert (" + at " in text) or name not in ("slab", "puck", "half_space", "small")
    assert ("/" in text) is (name != "half_space")
    words = " ".join(text.split())
    for p in sketch["drawn"]:
        if p["role"] in ("specimen", "layer", "indenter"):
            assert all(w in words for w in p["text"].split())


def test_characters_are_in_proportion():
    """The ball is 2 mm wide and the slab 2.3 mm thick; a character is twice as high as wide."""
    lines = text_sketch(sketched("slab"))
    ball = max(line.count("#") for line in lines)
    slab = sum(line.strip().startswith(".") for line in lines)
    assert slab * 2 / ball == pytest.approx(2.3 / 2.0, abs=0.25)  # a row is a seventh of the slab
    hatched = [k for k, line in enumerate(lines) if line.strip().startswith("/")]
    assert hatched == [len(lines) - 1]


def test_a_layer_thinner_than_a_row_is_seen():
    thin = {**SLAB, "specimen": {"shape": "slab", "thickness": 5.0, "layers": [{"thickness": 0.01, "ratio": 9.0}]}}
    lines = text_sketch(plain(dataclasses.asdict(BACKEND.sketch(thin, 0.5))))
    assert sum("::::" in line for line in lines) == 1
    assert len({line.find(line.strip()[:2]) for line in lines if "::::" in line or "...." in line}) == 1  # as wide


def test_only_what_is_drawn_is_shown():
    assert text_sketch({"words": "", "plane": "", "drawn": []}) == []


@pytest.mark.parametrize("many", [1, 2, 5])
def test_the_report_shows_it_on_its_first_page(many):
    results = {"stage": "plan", "sketches": [{"experiments": [f"e{k}"], **sketched("puck")} for k in range(many)]}
    first = report(results).sections[0]
    (picture,) = [b for b in first.blocks if isinstance(b, Picture)]
    assert picture.name == "sketch" and "a ball of radius 1 mm pressed into a cylinder" in picture.caption
    assert ("2 more are not drawn" in picture.caption) is (many == 5)
    svg = draw(results, "sketch")
    assert svg.startswith("<svg") and svg == draw(results, "sketch")


@pytest.mark.parametrize("draws", [ladder.draw, diagnosis.draw, next_test.draw])
def test_every_other_page_draws_it_too(draws):
    found = {"sketches": [{"experiments": ["top"], **sketched("slab")}]}
    assert sketch_blocks(found)[0].name == "sketch" and draws(found, "sketch").startswith("<svg")
    assert sketch_blocks({}) == ()


def test_results_of_an_older_program_have_no_sketch():
    assert not [b for b in report({"stage": "plan"}).sections[0].blocks if isinstance(b, Picture)]


@pytest.mark.parametrize(
    ("mm", "said"),
    [(2.3, "2.3 mm"), (0.3, "0.3 mm"), (0.05, "50 µm"), (2e-5, "20 nm"), (1500.0, "1.5 m"), (0.0, "0 mm")],
)
def test_lengths_have_the_unit_of_their_size(mm, said):
    assert length_words(mm) == said


LONG = {
    "flat end on a layer": {
        "specimen": {"shape": "slab", "thickness": 2.0, "layers": [{"thickness": 0.2, "ratio": 2.0}]},
        "indenter": {"shape": "flat", "radius": 1.5, "fillet": 0.15},
        "support": {"kind": "bonded"},
    },
    "skins": {**SLAB, "specimen": {"shape": "slab", "thickness": 12.0, "layers": [*LAYERED, *LAYERED]}},
}


@pytest.mark.parametrize("wide", [4.4, 6.3])
def test_no_label_leaves_the_picture_or_covers_another(wide, monkeypatch):
    """By matplotlib's own boxes of the drawn texts, for one section and for three beside or below each other."""
    monkeypatch.setattr(sketches, "svg", lambda figure, name: figure)
    every = [sketched(name) for name in CASES] + [
        plain(dataclasses.asdict(BACKEND.sketch(settings, 0.3))) for settings in LONG.values()
    ]
    three = [{**one, "experiments": [f"experiment {k}"]} for k, one in enumerate(every[-3:])]
    for shown in [[one] for one in every] + [three]:
        figure = sketches.sketch_figure({"sketches": shown}, wide)
        FigureCanvasAgg(figure).draw()
        texts = [t for axes in figure.axes for t in axes.texts if t.get_text()] + figure.texts
        boxes = [t.get_window_extent() for t in texts]
        for text, box in zip(texts, boxes, strict=True):
            assert box.x0 >= -1 and box.x1 <= figure.bbox.x1 + 1, text.get_text()
            assert box.y0 >= -1 and box.y1 <= figure.bbox.y1 + 1, text.get_text()
        across = sum(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
        assert across == 0, shown[0]["words"]
        for axes in figure.axes:  # a section is drawn as large as its labels allow
            body = axes.patches[0].get_window_extent()
            assert body.width > 0.3 * axes.bbox.width or body.height > 0.6 * axes.bbox.height
