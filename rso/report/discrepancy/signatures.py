"""Signatures of a diagnosis beside its residuals: what each hypothesis adds to the base model, and what that leaves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from rso.report.canvas import ACCENT, GREY, INK, PAPER, WARM, Look, canvas, short
from rso.report.discrepancy.maps import along, heading, legend, spread
from rso.report.discrepancy.reading import Found, Panel, Signature, brief, chosen, signatures

N_SIGNATURE_ROWS = 4  # hypotheses of a figure
# the first is kept for the chosen hypothesis
SIGNATURE_COLOURS = (ACCENT, WARM, "#2f8f6f", "#c08a1e", "#8b6ba8", "#5a5f64")
SAME_LINE_TOLERANCE = 0.05  # of the largest change: repeats that differ by less are one line
UNLOADING_DASHES = (0, (3, 1.6))  # lengths in points of strokes and gaps


def signature_map(found: Found) -> Figure:
    """Left what each leading hypothesis adds to the base model, right what the base model leaves and the chosen one's
    line, one row per panel."""
    rows = signatures(found)[:N_SIGNATURE_ROWS]
    cause = chosen(found)
    colour = colours(found)
    figure = canvas(0.55 + 1.4 * len(rows))
    grid = figure.subplots(len(rows), 2, squeeze=False, sharey="row")
    for k, ((left, right), (p, own)) in enumerate(zip(grid, rows, strict=True)):
        for name in reversed(colour):
            _hypothesis(left, p, own, name, colour[name], 2.0 if name == cause else 1.2)
        _left_by_the_base(right, p)
        if cause in colour:
            _hypothesis(right, p, own, cause, colour[cause], 1.6)
        left.set_title(heading(p), fontsize=8.5)
        last = k + 1 == len(rows) or rows[k + 1][0].held
        for axes in (left, right):
            along(axes, p)
            axes.axhline(0, color=INK, lw=0.6, zorder=1)
            if last and not p.held:
                axes.set_xlabel("depth (mm)")
        left.yaxis.set_major_locator(MaxNLocator(4))
        left.set_ylabel(f"added ({p.unit.label})")
        right.set_ylabel(f"residual ({p.unit.label})")
    _keys(figure, found, rows, colour)
    return figure


def colours(found: Found) -> dict[str, str]:
    """The hypotheses that are drawn, in their order, each with its colour."""
    names = dict.fromkeys(n for _, own in signatures(found)[:N_SIGNATURE_ROWS] for s in own for n in s.added)
    free = iter(SIGNATURE_COLOURS[1:])
    return {n: SIGNATURE_COLOURS[0] if n == chosen(found) else next(free, SIGNATURE_COLOURS[-1]) for n in names}


def _keys(
    figure: Figure, found: Found, rows: Sequence[tuple[Panel, tuple[Signature, ...]]], colour: dict[str, str]
) -> None:
    """What colours, lines and dots mean."""
    handles: list[Any] = [Line2D([], [], color=c, lw=1.8, label=short(brief(found, n), 28)) for n, c in colour.items()]
    if any(np.any(s.branch == 1) for _, own in rows for s in own):
        handles.append(Line2D([], [], color=INK, lw=1.3, label="loading"))
        handles.append(
            Line2D(
                [], [], color=INK, lw=0.9, ls=UNLOADING_DASHES, marker="o", ms=3, mfc=PAPER, mew=0.6, label="unloading"
            )
        )
    handles.append(Line2D([], [], color=GREY, marker="o", ms=3.5, lw=0, mew=0, label="residual of the base model"))
    legend(figure, handles)


def _hypothesis(axes: Axes, p: Panel, own: Sequence[Signature], name: str, colour: str, width: float) -> None:
    """What one hypothesis adds: a line per branch, thin and dashed where unloading, or the marks of a profile."""
    f, z = p.unit.factor, 2.5 if width > 1.5 else 3
    rows = [(s, f * s.added[name]) for s in own if name in s.added]
    if p.profile:
        for s, v in rows:
            for _, k, x in spread(p, s.depth):
                axes.plot(x, v[k], "-o", ms=1.2 * width, mew=0, color=colour, lw=0.5 * width, zorder=z)
        return
    for branch in (2,) if p.held else (0, 1):
        look: Look = {"lw": width} if branch != 1 else {"lw": 0.65 * width, "ls": UNLOADING_DASHES}
        for x, y in _lines([(s.depth[k], v[k]) for s, v in rows if np.any(k := s.branch == branch)]):
            axes.plot(x, y, color=colour, zorder=z, **look)


def _lines(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> Iterator[np.ndarray]:
    """One line for all repeats where these agree, each its own otherwise."""
    if len({len(x) for x, _ in rows}) == 1:
        both = np.array(rows)
        if np.ptp(both[:, 1], axis=0).max() <= SAME_LINE_TOLERANCE * np.abs(both[:, 1]).max():
            both = both.mean(axis=0, keepdims=True)
        yield from both
        return
    yield from map(np.array, rows)


def _left_by_the_base(axes: Axes, p: Panel) -> None:
    """Readings minus the base model as dots, hollow where unloading."""
    f = p.unit.factor
    filled: Look = {"mfc": GREY, "mec": PAPER, "mew": 0.3}
    hollow: Look = {"mfc": PAPER, "mec": GREY, "mew": 0.7}
    for r in p.records:
        places = [(x, k) for _, k, x in spread(p, r.depth)] if p.profile else [(r.depth, slice(None))]
        for x, k in places:
            back = r.branch[k] == 1
            for some, look in ((~back, filled), (back, hollow)):
                axes.plot(x[some], f * r.base[k][some], "o", ms=3.0, zorder=4, **look)
