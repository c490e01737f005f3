"""Residual maps of a diagnosis: measured minus model over depth, experiment by experiment and channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator

from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PAPER, Look, canvas, plain_log, short
from rso.report.discrepancy.reading import Found, Panel, brief, chosen, panels
from rso.report.layout.digits import shortest

N_FIRST_PANELS, MAX_MAP_PANELS = 3, 9  # of the first figure, and of both together
NOISE_BAND_SD = 1.645  # standard deviations on each side of 90 %
DECADE_TICKS_RATIO = 20.0  # ratio of times from which decades alone are marked
# of a legend: most columns, letters in a row, those that a line and its gaps take
MAX_LEGEND_COLUMNS, LEGEND_ROW_LETTERS, LEGEND_KEY_LETTERS = 6, 116, 7
BEYOND_NOISE_TINT = "#f3dfd5"  # behind what is beyond noise


def residual_map(found: Found, more: bool = False) -> Figure:
    """Measured minus model over depth, one panel per experiment and channel: the strongest three, or those after."""
    every = panels(found)
    rows = every[N_FIRST_PANELS:MAX_MAP_PANELS] if more else every[:N_FIRST_PANELS]
    columns = min(3, len(rows))
    lines = -(-len(rows) // columns)
    figure = canvas(1.55 * lines if more else 2.15 if columns > 1 else 3.0)
    grid = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, p in zip(grid, rows, strict=False):
        _panel(axes, p)
    for axes in grid[len(rows) :]:
        axes.set_visible(False)
    for k in range(len(rows)):
        last = k + columns >= len(rows) or rows[k + columns].held  # of those over depth
        if last and not rows[k].held:
            grid[k].set_xlabel("depth (mm)")
    if not more:
        _keys(figure, found, every)
    return figure


def _keys(figure: Figure, found: Found, rows: Sequence[Panel]) -> None:
    """What colours, lines and shades mean; it stands once, above the first panels."""
    cause = chosen(found) if any(v.cause is not None for p in rows for v in p.records) else None
    unloads = any(np.any(v.branch == 1) for p in rows for v in p.records)
    strong = any(p.regions for p in rows)
    handles: list[Any] = [Line2D([], [], color=GREY, marker="o", ms=3, lw=1.3, label="base model")]
    if cause:
        text = f"with {short(brief(found, cause), 30)}"
        handles.append(Line2D([], [], color=ACCENT, marker="o", ms=3, lw=1.6, label=text))
    if unloads:
        handles.append(Line2D([], [], color=INK, lw=1.2, label="loading"))
        handles.append(
            Line2D([], [], color=INK, lw=1.2, ls=(0, (3, 1.6)), marker="o", ms=3, mfc=PAPER, label="unloading")
        )
    handles.append(Patch(color=LIGHT, alpha=0.75, lw=0, label="90 % of the noise"))
    if strong:
        handles.append(Patch(color=BEYOND_NOISE_TINT, lw=0, label="beyond noise"))
    legend(figure, handles)


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Keys above a figure, row by row, in as many columns as it has room for."""

    def wide(columns: int) -> int:
        each = [[len(h.get_label()) for h in handles[k::columns]] for k in range(min(columns, len(handles)))]
        return sum(max(v) + LEGEND_KEY_LETTERS for v in each)

    columns = next((c for c in range(MAX_LEGEND_COLUMNS, 1, -1) if wide(c) <= LEGEND_ROW_LETTERS), 1)
    by_column = [h for k in range(columns) for h in handles[k::columns]]  # as matplotlib fills them in
    figure.legend(
        handles=by_column,
        loc="outside upper left",
        ncols=columns,
        frameon=False,
        fontsize=8,
        handlelength=1.6,
        columnspacing=1.5,
        handletextpad=0.5,
        borderaxespad=0.2,
    )


def _panel(axes: Axes, p: Panel) -> None:
    f = p.unit.factor
    for _, low, high in p.regions:
        room = 0.0 if high > low else 1.1 * _half_width(p)
        axes.axvspan(low - room, high + room, color=BEYOND_NOISE_TINT, lw=0, zorder=0)
    if p.profile:
        _marks(axes, p)
        along(axes, p)
    else:
        _noise(axes, p)
        for which, colour, width in (("base", GREY, 1.3), ("cause", ACCENT, 1.6)):
            for branch in (2,) if p.held else (0, 1):
                _branch(axes, p, which, branch, colour, width)
        along(axes, p)
    axes.axhline(0, color=INK, lw=0.6, zorder=1)
    sizes = [np.abs(v).max() for r in p.records for v in (r.base, r.cause, NOISE_BAND_SD * r.sd) if v is not None]
    high = 1.08 * f * float(max(sizes))
    axes.set_ylim(-high, high)
    axes.yaxis.set_major_locator(MaxNLocator(5, symmetric=True, min_n_ticks=3))
    axes.set_title(heading(p), fontsize=8.5)
    axes.set_title(p.unit.label, loc="right", color=GREY, fontsize=8)


def heading(p: Panel) -> str:
    """What a panel shows."""
    return f"{short(p.experiment, 20)}, {short(p.channel, 6)}{', held' * p.held}"


def along(axes: Axes, p: Panel) -> None:
    """The axis of depth, of a hold that of time, of a profile the depths at which it was taken."""
    if p.profile:
        depths = _depths(p)
        shown = depths[:: -(-len(depths) // 5)]
        axes.set_xticks(shown, [shortest(float(d)) for d in shown])
    elif p.held:
        axes.set_xscale("log")
        plain_log(axes.xaxis)
        times = np.concatenate([r.depth for r in p.records])
        if times.max() > DECADE_TICKS_RATIO * times.min():
            axes.xaxis.set_major_locator(LogLocator(numticks=5))
        axes.set_xlabel("time at rest (s)")
    else:
        axes.set_xlim(0, None)
        axes.xaxis.set_major_locator(MaxNLocator(4))


def _noise(axes: Axes, p: Panel) -> None:
    """The 90 % band of a single reading, from the branch that most records have."""
    d, s = (np.concatenate([getattr(r, k)[r.branch == r.branch[0]] for r in p.records]) for k in ("depth", "sd"))
    order = np.argsort(d, kind="stable")
    d, s = d[order], s[order] * p.unit.factor * NOISE_BAND_SD
    axes.fill_between(d, -s, s, color=LIGHT, alpha=0.75, lw=0, zorder=0.5)


def _branch(axes: Axes, p: Panel, which: str, branch: int, colour: str, width: float) -> None:
    """Readings as dots, hollow where unloading, and the mean of the repeats as a line."""
    rows = [
        (r.depth[k], v[k] * p.unit.factor)
        for r in p.records
        if (v := getattr(r, which)) is not None and np.any(k := r.branch == branch)
    ]
    if not rows:
        return
    z = 3 if which == "cause" else 2
    look: Look = {"mfc": colour, "mew": 0} if branch != 1 else {"mfc": PAPER, "mec": colour, "mew": 0.6}
    for x, y in rows:
        axes.plot(x, y, "o", ms=2.0 if branch != 1 else 2.4, alpha=0.65, zorder=z, **look)
    for x, y in _trend(rows):
        axes.plot(x, y, color=colour, lw=width, ls="-" if branch != 1 else (0, (3, 1.6)), zorder=z)


def _trend(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """Mean of the repeats where they have the same number of bins, over five neighbouring bins."""
    same = len({len(x) for x, _ in rows}) == 1
    lines = [np.mean(rows, axis=0)] if same else [np.array(v) for v in rows]
    near = [
        np.abs(np.subtract.outer(i, i)) <= np.minimum(2, np.minimum(i, i[::-1]))[:, None]
        for i in (np.arange(v.shape[1]) for v in lines)
    ]
    return [v @ (k / k.sum(axis=1, keepdims=True)).T for v, k in zip(lines, near, strict=True)]


def _depths(p: Panel) -> np.ndarray:
    return np.unique(np.round(np.concatenate([r.depth for r in p.records]), 1))


def _half_width(p: Panel) -> float:
    """Half the width over which the marks of one depth are spread."""
    depths = _depths(p)
    return 0.36 * (float(np.diff(depths).min()) if len(depths) > 1 else 1.0)


def spread(p: Panel, depth: np.ndarray) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Of a profile at each depth: (depth, the marks' rows, their places): side by side in their order."""
    depths, wide = _depths(p), _half_width(p)
    nearest = depths[np.argmin(np.abs(depth[:, None] - depths), axis=1)]
    rows = [(float(d), np.nonzero(nearest == d)[0]) for d in depths]
    return [(d, k, d + np.linspace(-wide, wide, len(k))) for d, k in rows if len(k)]


def _marks(axes: Axes, p: Panel) -> None:
    wide, f = _half_width(p), p.unit.factor
    for r in p.records:
        for d, k, x in spread(p, r.depth):
            s = np.full(2, NOISE_BAND_SD * float(r.sd[k].mean()) * f)
            axes.fill_between([d - 1.1 * wide, d + 1.1 * wide], -s, s, color=LIGHT, alpha=0.75, lw=0, zorder=0.5)
            axes.plot(x, r.base[k] * f, "o", ms=2.4, color=GREY, mew=0, zorder=2)
            if r.cause is not None:
                axes.plot(x, r.cause[k] * f, "o", ms=2.4, color=ACCENT, mew=0, zorder=3)
