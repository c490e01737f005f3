"""A sketch of an experiment in plain characters, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

SKETCH_ROWS, SKETCH_COLUMNS, LEGEND_COLUMNS = 11, 46, 34  # characters of the drawing and of a line of the legend
CHARACTER_ASPECT = 2.0  # height over width of a character
ROLE_CHARACTERS = {"specimen": ".", "deepest": "+", "indenter": "#", "held": "/", "support": "/"}
LAYER_CHARACTERS = ":o=*%"  # one for each layer from the top, again from the first after the last
FILLED_ROLES = ("specimen", "layer", "deepest", "indenter")  # a later one covers an earlier one


def text_sketch(sketch: Mapping[str, Any]) -> list[str]:
    """Lines of a section with its legend, each of at most 80 characters."""
    parts = [{**p, "points": np.asarray(p["points"], float)} for p in sketch["drawn"]]
    shown = [p for p in parts if p["role"] in (*FILLED_ROLES, "held", "support")]
    if not shown:
        return []
    every = np.vstack([p["points"] for p in shown])
    low, high = every.min(0), every.max(0)
    # a row's height in mm, with a row below for what holds
    row = max((high[1] - low[1]) / (SKETCH_ROWS - 1), CHARACTER_ASPECT * (high[0] - low[0]) / (SKETCH_COLUMNS - 2))
    column = row / CHARACTER_ASPECT
    rows = max(int(np.ceil((high[1] - low[1]) / row - 1e-9)), 1)
    columns = 2 * max(int(np.ceil(0.5 * (high[0] - low[0]) / column - 0.5 - 1e-9)), 0) + 1  # one lies on the axis
    page = np.full((rows + 1, columns + 2), " ")
    x = 0.5 * (low[0] + high[0]) + (np.arange(columns + 2) - (columns + 1) // 2) * column
    z = low[1] + (rows - 0.5 - np.arange(rows + 1)) * row  # what holds lies right below
    legend: list[tuple[int, str]] = []
    layers = iter(LAYER_CHARACTERS * len(parts))
    for role in FILLED_ROLES:
        for p in (p for p in parts if p["role"] == role):
            mark = next(layers) if role == "layer" else ROLE_CHARACTERS[role]
            inside = _inside(p["points"], x, z)
            if not inside.any():  # too small for a middle of a character
                inside = _inside(_grown(p["points"], x, z), x, z)
            page[inside] = mark
            seen = np.flatnonzero(inside.any(1))
            legend.append((int(seen.mean()) if len(seen) else 0, f"{mark} {p['text']}"))
    for p in (p for p in parts if p["role"] in ("held", "support")):
        beside = _beside(p["points"], row, column)
        cells = _cells(beside, x, z)
        page[cells & (page == " ")] = ROLE_CHARACTERS[p["role"]]
        if p["text"]:
            legend.append(
                (int(np.flatnonzero(cells.any(1)).max(initial=0)), f"{ROLE_CHARACTERS[p['role']]} {p['text']}")
            )
    legend = [entry for entry in legend if entry[1][0] in page]  # what a later part covers has no mark
    lines = ["".join(line).rstrip() for line in page]
    return "\n".join(line.rstrip() for line in _with(legend, lines, columns + 2)).rstrip().split("\n")


def _with(legend: Sequence[tuple[int, str]], lines: Sequence[str], width: int) -> list[str]:
    """Lines with the entries of a legend beside them, each as near to its row as others leave."""
    out, entries = list(lines), sorted((entry for entry in legend if len(entry[1]) > 2), key=lambda e: e[0])
    at = -1
    for k, (row, text) in enumerate(entries):
        words = [text] if len(text) <= LEGEND_COLUMNS else _wrapped(text)
        at = max(at + 1, min(row, len(out) - sum(len(_wrapped(t)) for _, t in entries[k:])))
        for word in words:
            while at >= len(out):
                out.append("")
            out[at] = f"{out[at]:<{width}} {word}"
            at += 1
        at -= 1
    return out


def _wrapped(text: str) -> list[str]:
    """A text in lines of the legend."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > LEGEND_COLUMNS - 4:
            lines.append("  " + word)
        else:
            lines[-1] = f"{lines[-1]} {word}".lstrip() if len(lines) == 1 else f"{lines[-1]} {word}"
    return lines


def _inside(points: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Whether the places (z, x) of a grid lie in a polygon (k, 2): an odd number of its edges lies to their right."""
    points = points + 1e-6 * (points.mean(0) - points)  # what lies on an edge lies outside, on both sides
    a, b = points, np.roll(points, -1, axis=0)
    spans = (a[:, None, 1] > z) != (b[:, None, 1] > z)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, None, 0] + (z - a[:, None, 1]) / (b[:, None, 1] - a[:, None, 1]) * (b - a)[:, None, 0]
    odd: np.ndarray = (spans[:, :, None] & (x < at[:, :, None])).sum(0) % 2 == 1
    return odd


def _grown(points: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A polygon that holds no middle of a character, made as large as one around the nearest."""
    low, high = points.min(0), points.max(0)
    middle, size = 0.5 * (low + high), high - low
    cell = np.array([x[1] - x[0], z[0] - z[1] if len(z) > 1 else x[1] - x[0]])
    small = size < cell
    nearest = np.array([x[np.abs(x - middle[0]).argmin()], z[np.abs(z - middle[1]).argmin()]])
    factor = np.where(small, 1.02 * cell / np.maximum(size, 1e-300), 1.0)
    grown: np.ndarray = np.where(small, nearest, middle) + factor * (points - middle)
    return grown


def _dense(points: np.ndarray, n: int = 400) -> np.ndarray:
    """Many points of a line (k, 2)."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    want = np.linspace(0.0, at[-1], n)
    return np.column_stack([np.interp(want, at, points[:, k]) for k in (0, 1)])


def _beside(points: np.ndarray, row: float, column: float) -> np.ndarray:
    """Points half a character to the right of a line's way."""
    line = _dense(points)
    way = np.gradient(line, axis=0)
    right = np.column_stack([way[:, 1], -way[:, 0]])
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-300)
    moved: np.ndarray = line + 0.55 * right * np.array([column, row])
    return moved


def _cells(points: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The places (z, x) of a grid nearest to some points."""
    found = np.zeros((len(z), len(x)), bool)
    i = np.abs(points[:, 1, None] - z).argmin(1)
    j = np.abs(points[:, 0, None] - x).argmin(1)
    found[i, j] = True
    return found
