"""Figures of a ladder as SVG strings, drawn from its plain data alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from rso.core.digits import known
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PALE, PAPER, WARM, Look, canvas, plain_log, short, style, svg
from rso.report.layout.digits import Unit, channel_text, clean, largest, shown, symbol
from rso.report.reading import at_rest, listed, on_the_way, pair, points
from rso.report.sketch import SKETCH_PICTURE, sketch_figure

Found = Mapping[str, Any]
LADDER_LINE_COLOURS = (GREY, "#8b6ba8", WARM, "#2f8f6f", "#b08a2e", "#5b7f95", "#a04f6d")
# strokes and gaps in points
LADDER_LINE_DASHES = tuple(
    (0, v) for v in ((1.2, 1.2), (5, 1.4, 1.2, 1.4), (5, 1.6), (3, 1), (7, 2), (2, 2), (4, 1, 1, 1))
)
MAX_DOTTED_READINGS = 400  # readings that are drawn as dots


def levels(found: Found) -> list[Mapping[str, Any]]:
    """Every level that was tried, in order."""
    return list(listed(found, "levels"))


def fitted(found: Found) -> list[Mapping[str, Any]]:
    """Levels with an answer."""
    return [v for v in levels(found) if v.get("curves")]


def title(level: Mapping[str, Any]) -> str:
    """What a level is called."""
    return clean(level.get("title") or level.get("name") or level.get("level"))


def role_word(role: Any) -> str:
    """A role as it is read."""
    return {"fit": "fitted", "select": "selection", "validate": "validation"}.get(clean(role), clean(role))


def looks(found: Found) -> dict[str, Look]:
    """Colour and dash by level; the one that holds is drawn through and in front."""
    out: dict[str, Look] = {}
    k = 0
    for v in fitted(found):
        if v.get("name") == found.get("chosen"):
            out[v["name"]] = {"color": ACCENT, "ls": "-", "lw": 1.8, "zorder": 4}
        else:
            out[v["name"]] = {
                "color": LADDER_LINE_COLOURS[k % len(LADDER_LINE_COLOURS)],
                "ls": LADDER_LINE_DASHES[k % len(LADDER_LINE_DASHES)],
                "lw": 1.2,
                "zorder": 3,
            }
            k += 1
    return out


def draw(found: Found, name: str) -> str:
    """The figure that a :class:`~rso.report.layout.document.Picture` names; ValueError for an unknown name."""
    kind, _, index = name.partition("-")
    with style():
        if kind == SKETCH_PICTURE:
            return sketch_figure(found)
        if kind == "curve":
            return svg(curve(found, int(index or 0)), name)
        if kind == "threshold":
            return svg(threshold(found), name)
        if kind == "intervals":
            return svg(intervals(found), name)
    raise ValueError(f"no figure {name!r}")


def curve(found: Found, k: int) -> Figure:
    """Data and levels, and what every level leaves against the band of the noise."""
    names = list(dict.fromkeys(c["name"] for v in fitted(found) for c in v["curves"]))
    rows = [(v["name"], c) for v in fitted(found) for c in v["curves"] if c["name"] == names[k]]
    holds = next((c for n, c in rows if n == found.get("chosen")), rows[-1][1])
    rest = at_rest(holds).get("since") or []
    way = bool(on_the_way(holds).get("depth")) or not rest  # creep has none: its loading is an experiment of its own
    figure = canvas(5.4 if rest and way else 2.9)
    grid = figure.subplots(2 if rest and way else 1, 2, squeeze=False)
    if way:
        _panels(found, grid[0], [(n, on_the_way(c)) for n, c in rows], on_the_way(holds), "depth")
    if rest:
        _panels(found, grid[-1], [(n, at_rest(c)) for n, c in rows], at_rest(holds), "since", not way)
    grid[0, 0].set_title(short(clean(names[k]), 40), color=GREY)
    if rest:
        for axes in grid[-1]:
            axes.set_xscale("log")
            axes.set_xlabel("time at rest (s)")
            axes.xaxis.set_major_locator(LogLocator(numticks=8))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.6g}"))
            axes.xaxis.set_minor_locator(NullLocator())
    return figure


def _panels(
    found: Found,
    pair_of: Sequence[Axes],
    rows: list[tuple[str, Mapping[str, Any]]],
    holds: Mapping[str, Any],
    along: str,
    alone: bool = False,
) -> None:
    """Data and levels, and what each leaves, of loading along the `depth` or of a hold along the time `since`.

    A hold that stands `alone` has the legend."""
    left, right = pair_of
    u, y = (np.array(v) for v in points(holds.get(along), holds.get("measured")))
    unit = shown(clean(holds.get("unit")), largest(list(map(float, y))))
    fine = shown(clean(holds.get("unit")), largest([float(s) for s in holds.get("sigma") or ()]))
    look = looks(found)
    marks: Look = {"ls": "none", "marker": "o", "ms": 2.6, "mfc": PAPER, "mec": INK, "mew": 0.7, "zorder": 2}
    left.plot(u[:MAX_DOTTED_READINGS], y[:MAX_DOTTED_READINGS] * unit.factor, **marks)
    at, sigma = points(holds.get(along), holds.get("sigma"))
    s = np.interp(u, at, sigma)
    right.fill_between(u, -2 * s * fine.factor, 2 * s * fine.factor, color=LIGHT, lw=0, alpha=0.75)
    right.axhline(0, color=INK, lw=0.7)
    for name, c in rows:
        x, f = (np.array(v) for v in points(c.get(along), c.get("predicted")))
        at, measured = points(c.get(along), c.get("measured"))
        m = np.interp(x, at, measured)
        left.plot(x, f * unit.factor, **look[name])
        right.plot(x, (m - f) * fine.factor, **look[name])
    handles = [Line2D([], [], **marks)] + [Line2D([], [], **look[n]) for n, _ in rows]
    titles = {v["name"]: title(v) for v in fitted(found)}
    texts = ["measured", *(short(titles[n], 24) for n, _ in rows)]
    if along == "depth" or alone:
        left.legend(handles, texts, frameon=False, fontsize=8, loc="upper left", handlelength=2.4, borderaxespad=0.1)
    right.set_title("what a level leaves", color=GREY)
    left.set_ylabel(f"{channel_text(holds.get('channel'))}{unit.bracket}")
    right.set_ylabel(f"measured − level{fine.bracket}")
    if along == "depth":
        for axes in (left, right):
            axes.set(xlabel="depth (mm)", xlim=(0, None))
    _clip(right, rows, s * fine.factor, fine)
    for axes in (left, right):
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_locator(MaxNLocator(5))


def _clip(axes: Axes, rows: list[tuple[str, Mapping[str, Any]]], s: np.ndarray, unit: Unit) -> None:
    """Levels far off would flatten the rest: the axis ends at the larger of eight sigma and the second-worst level."""
    sizes = []
    for _, c in rows:
        f, m = np.array(c.get("predicted") or [0.0], float), np.array(c.get("measured") or [0.0], float)
        sizes.append(float(np.abs(f - m).max()) * unit.factor if len(f) == len(m) else 0.0)
    top = 1.08 * max(3.0 * float(s.max(initial=0.0)), min(max(sizes), 8.0 * float(s.max(initial=0.0))))
    if top > 0:
        axes.set_ylim(-top, top)


def threshold(found: Found) -> Figure:
    """One row per curve and level: a tick at what noise alone would leave, a dot where the level is."""
    rows = [(v["name"], e) for v in fitted(found) for e in v.get("errors") or ()]
    rows = [(n, e) for n, e in rows if known(e.get("nrmse")) and known(e.get("threshold"))]
    titles = {v["name"]: title(v) for v in fitted(found)}
    order = list(dict.fromkeys(e["curve"] for _, e in rows))
    rows.sort(key=lambda row: order.index(row[1]["curve"]))
    figure = canvas(0.7 + 0.24 * len(rows) + 0.12 * len(order))
    axes = figure.subplots()
    y, ticks, labels = 0.0, [], []
    for curve_name in order:
        mine = [(n, e) for n, e in rows if e["curve"] == curve_name]
        for k, (n, e) in enumerate(mine):
            value, limit = 100 * float(e["nrmse"]), 100 * float(e["threshold"])
            good = value <= limit
            axes.plot([value, limit], [y, y], color=LIGHT, lw=1.2, zorder=1)
            axes.plot([limit], [y], "|", ms=11, mew=2.2, color=ACCENT if n == found.get("chosen") else INK, zorder=2)
            axes.plot(
                [value], [y], "o", ms=5, mfc=ACCENT if good else PAPER, mec=ACCENT if good else WARM, mew=1.3, zorder=3
            )
            ticks.append(y)
            text = titles[n]
            labels.append(f"{short(curve_name, 24)} ({role_word(e.get('role'))})   {text}" if k == 0 else text)
            y -= 1.0
        y -= 0.5
    axes.set_yticks(ticks, labels)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set(ylim=(y + 0.8, 0.7), xlabel="NRMSE (%)")
    sizes = [100 * float(e[k]) for _, e in rows for k in ("nrmse", "threshold")]
    if min(sizes) > 0 and max(sizes) > 12 * min(sizes):
        axes.set_xscale("log")
        axes.set_xlim(0.6 * min(sizes), 1.5 * max(sizes))
        plain_log(axes.xaxis)
    else:
        axes.set_xlim(0, 1.08 * max(sizes))
    return figure


def intervals(found: Found) -> Figure:
    """One panel per parameter, one row per level: range searched, interval, value."""
    rows = [(v["name"], p) for v in fitted(found) for p in v.get("parameters") or () if pair(p.get("interval"))]
    titles = {v["name"]: title(v) for v in fitted(found)}
    names = list(dict.fromkeys(p["name"] for _, p in rows))
    each = [[(n, p) for n, p in rows if p["name"] == name] for name in names]
    figure = canvas(0.45 + sum(0.5 + 0.22 * len(m) for m in each))
    grid = figure.subplots(len(each), 1, squeeze=False, height_ratios=[1.6 + len(m) for m in each])[:, 0]
    for axes, name, mine in zip(grid, names, each, strict=True):
        unit = shown(clean(mine[0][1].get("unit")), float(mine[0][1]["value"]))
        low, high = (f(float(p["range"][k]) for _, p in mine) for k, f in ((0, min), (1, max)))
        if low > 0 and high > 4 * low:
            axes.set_xscale("log")
            plain_log(axes.xaxis)
        for k, (_, p) in enumerate(mine):
            a, b = (float(v) * unit.factor for v in p["range"])
            c, d = (float(v) * unit.factor for v in p["interval"])
            good = p.get("verdict") == "determined"
            axes.plot([a, b], [-k, -k], color=PALE, lw=5, solid_capstyle="butt")
            axes.plot([c, d], [-k, -k], color=ACCENT if good else GREY, lw=5, solid_capstyle="butt")
            if p.get("verdict") in ("determined", "weakly"):
                axes.plot([float(p["value"]) * unit.factor], [-k], "o", ms=4, mfc=PAPER, mec=INK, mew=1.0)
        ticks = axes.set_yticks([-k for k in range(len(mine))], [short(titles[n], 24) for n, _ in mine])
        for tick, (n, _) in zip(ticks, mine, strict=True):
            tick.label1.set_color(ACCENT if n == found.get("chosen") else INK)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set(ylim=(-len(mine) + 0.4, 0.6))
        text = "/".join("·".join(symbol(s) for s in part.split("·")) for part in clean(name).split("/"))
        axes.set_title(f"{text}{unit.bracket}")
    return figure
