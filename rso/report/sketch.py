"""What was tested, drawn: a section of each different experiment with its sizes, and the sentence that says it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from rso.report.canvas import ACCENT, GREY, HALO, INK, PAPER, STEEL, WARM, WIDTH_INCH, canvas, svg
from rso.report.layout.digits import clean
from rso.report.layout.document import Picture
from rso.report.reading import listed

SKETCH_PICTURE = "sketch"
MAX_SKETCH_PANELS = 3  # different experiments beside each other
MAX_SKETCH_HEIGHT_INCH, MIN_SKETCH_HEIGHT_INCH = 2.9, 1.1  # inch
SPECIMEN_TINT = "#f3e3d7"  # a light tint that stays apart from white in print
LAYER_TINTS = ("#e3b897", "#d2966c", "#ecd0b8")
LAYER_LABEL_SHARE = 0.36  # of the width: names of layers
HATCH_SHARE = 0.03  # of the width: strokes of what holds

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
    """The sections side by side, each to its own scale, as SVG `wide` inch wide."""
    drawn = _shown(found)
    spans = [_window(s) for s in drawn]
    shape = [float((high - low)[1] / (high - low)[0]) for low, high in spans]
    each = wide / len(drawn)
    figure = canvas(min(max(max(each * r for r in shape), MIN_SKETCH_HEIGHT_INCH), MAX_SKETCH_HEIGHT_INCH), wide)
    for axes, s, (low, high) in zip(np.atleast_1d(figure.subplots(1, len(drawn))), drawn, spans, strict=True):
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        _draw(axes, s, float((high - low)[0]))
        if len(drawn) > 1:
            axes.set_title(", ".join(clean(n) for n in s.get("experiments") or ()), fontsize=8)
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


def _window(sketch: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what is shown, with room for hatching and labels."""
    every = np.vstack([p for _, p, _ in _parts(sketch, "specimen", "indenter", "deepest", "support", "dimension")])
    low, high = every.min(0), every.max(0)
    wide = float((high - low)[0])
    beside = LAYER_LABEL_SHARE if _parts(sketch, "layer") else 0.06  # names of layers stand beside them
    return low - wide * np.array([beside, 2.2 * HATCH_SHARE]), high + wide * np.array([0.16, 0.02])


def _draw(axes: Axes, sketch: Mapping[str, Any], wide: float) -> None:
    """Fills, then lines, then sizes."""
    for _, points, _ in _parts(sketch, "specimen"):
        axes.add_patch(Polygon(points, closed=True, facecolor=SPECIMEN_TINT, edgecolor="none", zorder=1))
    left = min(float(p[:, 0].min()) for _, p, _ in _parts(sketch, "specimen"))
    lowest = np.inf
    for k, (_, points, text) in enumerate(_parts(sketch, "layer")):
        axes.add_patch(Polygon(points, closed=True, facecolor=LAYER_TINTS[k % 3], edgecolor=PAPER, lw=0.5, zorder=2))
        lowest = min(float(points[:, 1].mean()), lowest - 0.045 * wide)
        axes.annotate(text, (left - 0.02 * wide, lowest), va="center", ha="right", fontsize=7.5)
    for _, points, _ in _parts(sketch, "indenter"):
        axes.add_patch(Polygon(points, closed=True, facecolor=STEEL, edgecolor=INK, lw=1.0, zorder=3))
    for _, points, _ in _parts(sketch, "deepest"):
        look: dict[str, Any] = {"closed": True, "fill": False, "edgecolor": ACCENT, "lw": 0.9, "ls": (0, (4, 2.5))}
        axes.add_patch(Polygon(points, zorder=4, **look))
    for _, points, _ in _parts(sketch, "edge"):
        axes.plot(*points.T, color=INK, lw=1.0, zorder=2.5, solid_capstyle="butt")
    for role, points, text in _parts(sketch, "held", "support"):
        _hatched(axes, points, HATCH_SHARE * wide, 1.6 if role == "held" else 1.0)
        if text:
            k = int(np.argmin(points[:, 1] + 1e-6 * np.abs(points[:, 0])))
            at = float(points[k, 0]), float(points[k, 1]) - 1.25 * HATCH_SHARE * wide
            axes.annotate(text, at, ha="center", va="top", fontsize=7.5, color=GREY, path_effects=HALO, zorder=9)
    for _, points, text in _parts(sketch, "indenter"):
        at = float(points[:, 0].max()), float(0.7 * points[:, 1].max() + 0.3 * points[:, 1].min())
        axes.annotate(text, at, xytext=(5, 0), textcoords="offset points", va="center", ha="left", fontsize=8)
    for _, (a, b), text in _parts(sketch, "dimension"):
        _dimension(axes, a, b, text)
    for _, points, _ in _parts(sketch, "contact"):
        axes.plot(*points.T, "o", color=WARM, ms=3.5, zorder=8)


def _dimension(axes: Axes, a: np.ndarray, b: np.ndarray, text: str) -> None:
    """An arrow with two heads and its text beside it."""
    arrow = {
        "arrowstyle": "<|-|>,head_width=0.12,head_length=0.3",
        "color": ACCENT,
        "lw": 0.7,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", tuple(b), tuple(a), arrowprops=arrow, zorder=7)
    upright = abs(b[1] - a[1]) > abs(b[0] - a[0])
    axes.annotate(
        text,
        tuple(0.5 * (a + b)),
        xytext=(5, 0) if upright else (0, 4),
        textcoords="offset points",
        ha="left" if upright else "center",
        va="center" if upright else "bottom",
        color=ACCENT,
        fontsize=8,
        path_effects=HALO,
        zorder=9,
    )


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
