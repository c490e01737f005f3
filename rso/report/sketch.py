"""What was tested, drawn: a section of each different experiment with its sizes, and the sentence that says it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Polygon
from matplotlib.textpath import text_to_path

from rso.report.canvas import ACCENT, GREY, HALO, INK, PAPER, STEEL, WARM, WIDTH_INCH, canvas, svg
from rso.report.layout.digits import clean
from rso.report.layout.document import Picture
from rso.report.reading import listed

SKETCH_PICTURE = "sketch"
MAX_SKETCH_PANELS = 3  # different experiments beside each other
MAX_SKETCH_HEIGHT_INCH, MAX_SKETCH_ROW_INCH = 2.9, 1.9  # inch: a lone row, and one of several
MIN_SKETCH_PANEL_INCH = 2.8  # inch: narrower ones stand below each other
TITLE_INCH = 0.25  # inch: the names of experiments above a panel
SPECIMEN_TINT = "#f3e3d7"  # a light tint that stays apart from white in print
LAYER_TINTS = ("#e3b897", "#d2966c", "#ecd0b8")
HATCH_POINTS, LEADER_POINTS = 9.0, 8.0  # points: strokes of what holds, lines from layers to their names
LABEL_CHARACTERS = 26  # of a line of the indenter's label
LINE_HEIGHT = 1.25  # of the size of the letters
LABEL_FONT_ROOM = 0.03  # of the width: other fonts may be wider than the one that is measured
POINTS_PER_INCH = 72.0  # letters are measured in points
ARROW: dict[str, Any] = {
    "arrowstyle": "<|-|>,head_width=0.12,head_length=0.3",
    "color": ACCENT,
    "lw": 0.7,
    "shrinkA": 0,
    "shrinkB": 0,
}

Found = Mapping[str, Any]


def sketch_blocks(found: Found) -> tuple[Picture, ...]:
    """The picture of the experiments with their sentences as its caption; none where nobody drew them."""
    drawn = _shown(found)
    if not drawn:
        return ()
    said = []
    for s in drawn:
        names = ", ".join(clean(n) for n in s.get("experiments") or ())
        words = clean(s.get("words"))
        said.append(f"{names}: {words}." if len(drawn) > 1 else f"What is modelled: {words}.")
    left_out = len(listed(found, "sketches")) - len(drawn)
    more = f" {left_out} more are not drawn." if left_out > 0 else ""
    return (Picture(SKETCH_PICTURE, f"{' '.join(said)} Section, {clean(drawn[0].get('plane'))}; to scale.{more}"),)


def sketch_figure(found: Found, wide: float = WIDTH_INCH) -> str:
    """The sections, each to its own scale and as large as its labels leave room for, as SVG `wide` inch wide."""
    drawn = _shown(found)
    columns = min(len(drawn), max(int(wide / MIN_SKETCH_PANEL_INCH), 1))
    rows = [drawn[k : k + columns] for k in range(0, len(drawn), columns)]
    each, most = wide / columns, MAX_SKETCH_HEIGHT_INCH if len(rows) == 1 else MAX_SKETCH_ROW_INCH
    above = TITLE_INCH if len(drawn) > 1 else 0.0
    scales = [[_scale(s, each, most) for s in row] for row in rows]
    windows = [
        [_window(s, scale, each) for s, scale in zip(row, found_ones, strict=True)]
        for row, found_ones in zip(rows, scales, strict=True)
    ]
    heights = [
        above + max(scale * (high - low)[1] for scale, (low, high) in zip(of_row, window, strict=True))
        for of_row, window in zip(scales, windows, strict=True)
    ]
    tall = float(sum(heights))
    figure = canvas(tall, wide)
    figure.set_layout_engine("none")
    top = tall
    for row, of_row, window, height in zip(rows, scales, windows, heights, strict=True):
        for k, (s, scale, (low, high)) in enumerate(zip(row, of_row, window, strict=True)):
            own = scale * float((high - low)[1])
            place = (k * each / wide, (top - above - own) / tall, each / wide, own / tall)
            axes = figure.add_axes(place, xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            axes.set_axis_off()
            _draw(axes, s, scale)
            if above:
                names = ", ".join(clean(n) for n in s.get("experiments") or ())
                figure.text((k + 0.5) * each / wide, (top - 0.3 * above) / tall, names, ha="center", va="top", size=8)
        top -= height
    return svg(figure, SKETCH_PICTURE)


def _shown(found: Found) -> list[Mapping[str, Any]]:
    return [s for s in listed(found, "sketches") if _parts(s, "specimen")][:MAX_SKETCH_PANELS]


def _parts(sketch: Mapping[str, Any], *roles: str) -> list[tuple[str, np.ndarray, str]]:
    """Role, points (k, 2) and text of the parts with these roles, in their order."""
    return [
        (p["role"], np.asarray(p["points"], float), clean(p.get("text")))
        for p in sketch.get("drawn") or ()
        if p.get("role") in roles and len(p.get("points") or ())
    ]


@dataclass(frozen=True)
class Label:
    """A text at a point (2,) of the section, moved from it by an offset (2,) in points."""

    text: str
    at: tuple[float, float]
    offset: tuple[float, float]
    ha: Literal["left", "center", "right"]
    va: Literal["bottom", "center", "top"]
    size: float = 8.0  # points
    colour: str = INK

    def reach(self, scale: float) -> np.ndarray:
        """Corners (2, 2) inch of the text where the section is drawn `scale` inch a unit of length."""
        lines = self.text.split("\n")
        font = FontProperties(size=self.size)
        wide = max(text_to_path.get_text_width_height_descent(line, font, False)[0] for line in lines)
        size = np.array([wide, LINE_HEIGHT * self.size * len(lines)])
        before = np.array(
            [{"left": 0.0, "center": 0.5, "right": 1.0}[self.ha], {"top": 1.0, "center": 0.5}.get(self.va, 0.0)]
        )
        corner = np.array(self.offset) - before * size
        return scale * np.array(self.at) + np.array([corner, corner + size]) / POINTS_PER_INCH


def _labels(sketch: Mapping[str, Any], scale: float) -> list[Label]:
    """The texts of a section that is drawn `scale` inch a unit of length; none of them on another where it is large."""
    line = 8.0 * LINE_HEIGHT / POINTS_PER_INCH / scale  # a line of text in units of length
    specimen = np.vstack([p for _, p, _ in _parts(sketch, "specimen")])
    left, found, lowest = float(specimen[:, 0].min()), [], np.inf
    for _, points, text in _parts(sketch, "layer"):
        lowest = min(float(points[:, 1].mean()), lowest - line)
        found.append(Label(text, (left, lowest), (-LEADER_POINTS - 2.0, 0.0), "right", "center", 7.5))
    for _, points, text in _parts(sketch, "held", "support"):
        if text:
            k = int(np.argmin(points[:, 1] + 1e-6 * np.abs(points[:, 0])))
            at = (
                float(points[:, 0].mean()) if np.ptp(points[:, 1]) == 0.0 else float(points[k, 0]),
                float(points[k, 1]),
            )
            found.append(Label(text, at, (0.0, -HATCH_POINTS - 2.0), "center", "top", 7.5, GREY))
    for _, points, text in _parts(sketch, "indenter"):
        (x0, y0), (x1, y1) = points.min(0), points.max(0)
        words = "\n".join(textwrap.wrap(text, LABEL_CHARACTERS))
        high = (words.count("\n") + 1) * line
        if y1 - y0 < 1.5 * high or x1 - x0 > 0.9 * np.ptp(specimen[:, 0]):
            found.append(Label(words, (float(x0 + x1) / 2.0, float(y1)), (0.0, 3.0), "center", "bottom"))
        else:
            found.append(Label(words, (float(x1), float(0.6 * y1 + 0.4 * y0)), (5.0, 0.0), "left", "center"))
    for _, (a, b), text in _parts(sketch, "dimension"):
        at, upright = 0.5 * (a + b), abs(b[1] - a[1]) > abs(b[0] - a[0])
        imprint = _imprint(sketch, a, b) if upright else None
        if not upright:
            found.append(Label(text, (float(at[0]), float(at[1])), (0.0, 3.0), "center", "bottom", colour=ACCENT))
        elif imprint is None or abs(b[1] - a[1]) > line:
            found.append(
                Label(text, (imprint or float(at[0]), float(at[1])), (5.0, 0.0), "left", "center", colour=ACCENT)
            )
        elif a[1] - specimen[:, 1].min() > 1.2 * line:  # below the surface, which a short arrow is too near to
            found.append(Label(text, (imprint, float(a[1])), (5.0, -2.0), "left", "top", colour=ACCENT))
    return found


def _imprint(sketch: Mapping[str, Any], a: np.ndarray, b: np.ndarray) -> float | None:
    """How far to the right the deepest indenter reaches below where it touched first, of the arrow of that depth."""
    contact = [p[0] for _, p, _ in _parts(sketch, "contact")]
    deepest = [p for _, p, _ in _parts(sketch, "deepest")]
    if not (contact and deepest) or np.abs(a - contact[0]).max() > 1e-9 * np.abs(deepest[0]).max():
        return None
    below = deepest[0][deepest[0][:, 1] <= max(a[1], b[1])]
    specimen = np.vstack([p for _, p, _ in _parts(sketch, "specimen")])
    wide = float(below[:, 0].max()) if len(below) else float(a[0])
    return wide if wide < float(specimen[:, 0].max()) else None


def _reach(sketch: Mapping[str, Any], scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners in inch of the section and its labels, drawn `scale` inch a unit of length."""
    every = scale * np.vstack(
        [p for _, p, _ in _parts(sketch, "specimen", "indenter", "deepest", "support", "held", "dimension")]
    )
    edge = HATCH_POINTS / POINTS_PER_INCH
    corners = np.vstack(
        [every.min(0) - edge, every.max(0) + 0.5 * edge, *(x.reach(scale) for x in _labels(sketch, scale))]
    )
    return corners.min(0), corners.max(0)


def _scale(sketch: Mapping[str, Any], wide: float, tall: float) -> float:
    """The largest scale (inch a unit of length) at which a section and its labels are no larger than this."""
    points = np.vstack([p for _, p, _ in _parts(sketch, "specimen", "indenter", "deepest")])
    low, high = 0.05 * wide / float(np.ptp(points[:, 0])), wide / float(np.ptp(points[:, 0]))
    for _ in range(30):
        middle = 0.5 * (low + high)
        first, last = _reach(sketch, middle)
        fits = (last - first)[0] <= (1.0 - LABEL_FONT_ROOM) * wide and (last - first)[1] <= tall
        low, high = (middle, high) if fits else (low, middle)
    return low


def _window(sketch: Mapping[str, Any], scale: float, wide: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what is shown in units of length: `wide` inch, with the section and its labels in the middle."""
    low, high = _reach(sketch, scale)
    spare = np.array([0.5 * (wide - (high - low)[0]), 0.0])
    return (low - spare) / scale, (high + spare) / scale


def _draw(axes: Axes, sketch: Mapping[str, Any], scale: float) -> None:
    """Fills, then lines, then sizes."""
    for _, points, _ in _parts(sketch, "specimen"):
        axes.add_patch(Polygon(points, closed=True, facecolor=SPECIMEN_TINT, edgecolor="none", zorder=1))
    for k, (_, points, _) in enumerate(_parts(sketch, "layer")):
        axes.add_patch(Polygon(points, closed=True, facecolor=LAYER_TINTS[k % 3], edgecolor=PAPER, lw=0.5, zorder=2))
    for _, points, _ in _parts(sketch, "indenter"):
        axes.add_patch(Polygon(points, closed=True, facecolor=STEEL, edgecolor=INK, lw=1.0, zorder=3))
    for _, points, _ in _parts(sketch, "deepest"):
        look: dict[str, Any] = {"closed": True, "fill": False, "edgecolor": ACCENT, "lw": 0.9, "ls": (0, (4, 2.5))}
        axes.add_patch(Polygon(points, zorder=4, **look))
    for _, points, _ in _parts(sketch, "edge"):
        axes.plot(*points.T, color=INK, lw=1.0, zorder=2.5, solid_capstyle="butt")
    for role, points, _ in _parts(sketch, "held", "support"):
        _hatched(axes, points, HATCH_POINTS / POINTS_PER_INCH / scale, 1.6 if role == "held" else 1.0)
    labels = _labels(sketch, scale)
    for (_, points, _), label in zip(_parts(sketch, "layer"), labels, strict=False):
        edge = (float(points[:, 0].min()), float(points[:, 1].mean()))
        reach = label.at[0] - LEADER_POINTS / POINTS_PER_INCH / scale
        axes.plot((edge[0], reach), (edge[1], label.at[1]), color=GREY, lw=0.6, zorder=2)
    for _, (a, b), _ in _parts(sketch, "dimension"):
        axes.annotate("", tuple(b), tuple(a), arrowprops=ARROW, zorder=7)
    for label in labels:
        axes.annotate(
            label.text,
            label.at,
            xytext=label.offset,
            textcoords="offset points",
            ha=label.ha,
            va=label.va,
            color=label.colour,
            fontsize=label.size,
            path_effects=HALO,
            zorder=9,
        )
    for _, points, _ in _parts(sketch, "contact"):
        axes.plot(*points.T, "o", color=WARM, ms=3.5, zorder=8)


def _hatched(axes: Axes, points: np.ndarray, size: float, width: float) -> None:
    """A line with strokes to the right of its way, as of what stands still."""
    axes.plot(*points.T, color=INK, lw=width, zorder=5, solid_capstyle="butt")
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    want = np.arange(0.5 * size, at[-1], 0.6 * size)
    line = np.column_stack([np.interp(want, at, points[:, k]) for k in (0, 1)])
    if len(line) < 2:
        return
    way = np.gradient(line, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    right = np.column_stack([way[:, 1], -way[:, 0]])
    end = line + 0.8 * size * (right - 0.6 * way)
    for a, b in zip(line, end, strict=True):
        axes.plot([a[0], b[0]], [a[1], b[1]], color=GREY, lw=0.6, zorder=4.5)
