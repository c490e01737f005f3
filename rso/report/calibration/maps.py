"""Figures over the parameters: response surface, sensitivities, fronts and valleys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Literal, TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from rso.core.digits import known
from rso.report.calibration.drawn_runs import drawn_runs
from rso.report.canvas import (
    ACCENT,
    GREY,
    INK,
    LIGHT,
    PAPER,
    WARM,
    canvas,
    few_ticks,
    number_label,
    parameter_axis,
    short,
    svg,
)
from rso.report.layout.digits import Unit, channel_text, clean, largest, quantity, shown
from rso.report.reading import (
    CandidateView,
    OutputView,
    ParameterView,
    Results,
    at_reading,
    candidates,
    front,
    grids,
    lead_search,
    listed,
    number,
    output_rows,
    outputs,
    parameters,
    seen,
    target_output,
)

# From light to middle tone in one hue: it stays ordered in greyscale and marks stand out on all of it.
_SURFACE_COLOURS = LinearSegmentedColormap.from_list("surface", ["#fbfaf6", "#dfe7e8", "#b9ccd3", "#8fadba"])
_MAX_SURFACE_PANELS = 6  # pairs of parameters of a figure


def surfaces(results: Results, name: str) -> str:
    """Filled contours (or lines, for one parameter) of the first outputs, with runs, targets and candidates."""
    shown_ones = grids(results)[:_MAX_SURFACE_PANELS]
    by_name = {p.name: p for p in parameters(results)}
    columns = 1 if len(shown_ones) == 1 else 2
    rows = -(-len(shown_ones) // columns)
    figure = canvas((3.9 if columns == 1 else 2.9) * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for k, axes in enumerate(grid.flat):
        if k >= len(shown_ones):
            axes.axis("off")
            continue
        s = shown_ones[k]
        x, y = by_name.get(s["x"]["parameter"]), by_name.get(clean((s.get("y") or {}).get("parameter")))
        output = outputs(results).get(s["output"], OutputView(s["output"], "", clean(s["output"]), "", Unit("")))
        if x is not None and y is not None and len(s["y"]["values"]) > 1:
            _surface(axes, results, s, x, y, output)
        elif x is not None:
            _line(axes, results, s, x, output)
    return svg(figure, name, plate=True)


def _targets(results: Results, output: str) -> list[Mapping[str, Any]]:
    """The different targets that any search sets for an output."""
    every = [t for s in listed(results, "searches") for t in s.get("targets") or () if target_output(t) == output]
    return list({(t["value"], t.get("sigma")): t for t in every if known(t.get("value"))}.values())


def _surface(
    axes: Axes, results: Results, s: Mapping[str, Any], x: ParameterView, y: ParameterView, output: OutputView
) -> None:
    X, Y = np.array(s["x"]["values"]) * x.unit.factor, np.array(s["y"]["values"]) * y.unit.factor
    Z = np.array([[np.nan if v is None else v for v in row] for row in s["mean"]], float) * output.unit.factor
    levels = MaxNLocator(9).tick_values(np.nanmin(Z), np.nanmax(Z))
    axes.contourf(X, Y, Z, levels, cmap=_SURFACE_COLOURS)
    lines = axes.contour(X, Y, Z, levels, colors=GREY, linewidths=0.5)
    # Inline labels would cut the steep part of a line away, and with it what the map is for.
    labels = axes.clabel(lines, fmt=number_label(3), fontsize=7, inline=False, colors=INK)
    for label in labels or ():
        label.set_path_effects([withStroke(linewidth=2.0, foreground=PAPER)])
        label.set_clip_on(True)
    for t in _targets(results, s["output"]):
        value, sigma = t["value"] * output.unit.factor, (number(t.get("sigma")) or 0) * output.unit.factor
        if sigma:
            axes.contour(X, Y, Z, [value - sigma, value + sigma], colors=ACCENT, linewidths=0.9, linestyles="--")
        axes.contour(X, Y, Z, [value], colors=ACCENT, linewidths=1.8)
    _region(axes, results, x, y)
    _runs(axes, results, x, y)
    _marks(axes, results, x, y)
    parameter_axis(axes, "x", x)
    parameter_axis(axes, "y", y)
    for spine in axes.spines.values():
        spine.set_visible(False)
    aims = [quantity(t["value"], output.base, 3, 1 / output.unit.factor) for t in _targets(results, s["output"])]
    axes.set_title(f"{short(output.label, 26)}{output.unit.bracket}")
    if aims:
        axes.set_title(f"target {', '.join(aims)}", loc="right", color=ACCENT, fontsize=8)


def _region(axes: Axes, results: Results, x: ParameterView, y: ParameterView) -> None:
    """Hatched where runs would rather fail."""
    found = (results.get("feasible") or {}).get("map")
    if found and (found["x"]["parameter"], found["y"]["parameter"]) == (x.name, y.name):
        X, Y = np.array(found["x"]["values"]) * x.unit.factor, np.array(found["y"]["values"]) * y.unit.factor
        P = np.array(found["probability"])
        axes.contourf(X, Y, P, [-1.0, 0.5], colors="none", hatches=["////"])
        axes.contour(X, Y, P, [0.5], colors=WARM, linewidths=1.0)


class _Dots(TypedDict, total=False):
    marker: Literal["o", "x", "^"]
    s: float
    c: str
    edgecolors: str
    linewidths: float


def _runs(axes: Axes, results: Results, x: ParameterView, y: ParameterView) -> None:
    looks: dict[str, _Dots] = {
        "done": {"marker": "o", "s": 9, "c": INK, "edgecolors": PAPER, "linewidths": 0.5},
        "failed": {"marker": "x", "s": 26, "c": WARM, "linewidths": 1.5},
        "crashed": {"marker": "^", "s": 26, "c": PAPER, "edgecolors": WARM, "linewidths": 1.3},
    }
    for state, look in looks.items():
        pairs = drawn_runs(results, state, x, y)
        if pairs:
            a, b = np.array(pairs).T
            axes.scatter(a * x.unit.factor, b * y.unit.factor, zorder=4, clip_on=False, **look)


def _marks(axes: Axes, results: Results, x: ParameterView, y: ParameterView) -> None:
    """Candidates as diamonds, those of the first search with their names."""
    every = candidates(results)
    lead = lead_search(results)
    for c in every:
        if c.search != lead:
            _mark(axes, c.value(x.name), c.value(y.name), x, y, "")
    for c in every:
        if c.search == lead:
            _mark(axes, c.value(x.name), c.value(y.name), x, y, c.mark, c.best)


def _mark(
    axes: Axes, a: float | None, b: float | None, x: ParameterView, y: ParameterView, text: str, best: bool = False
) -> None:
    if a is None or b is None:
        return
    at = (a * x.unit.factor, b * y.unit.factor)
    if not text:
        axes.scatter(*at, marker="D", s=13, c=PAPER, edgecolors=INK, linewidths=0.7, zorder=5, clip_on=False)
        return
    fill, ink = (ACCENT, PAPER) if best else (PAPER, INK)
    axes.scatter(*at, marker="D", s=70, c=fill, edgecolors=ACCENT, linewidths=1.1, zorder=6, clip_on=False)
    axes.annotate(text, at, ha="center", va="center", fontsize=7, color=ink, zorder=7, annotation_clip=False)


def _line(axes: Axes, results: Results, s: Mapping[str, Any], x: ParameterView, output: OutputView) -> None:
    X = np.array(s["x"]["values"]) * x.unit.factor
    Y = np.array([np.nan if v is None else v for v in np.ravel(s["mean"])], float) * output.unit.factor
    score = next((g for g in listed(results, "surrogates") if g.get("output") == s["output"]), {})
    found = [number((score.get(k) or {}).get("rmse")) for k in ("held_out", "cross_validation")]
    band = next((b for b in found if b is not None), 0.0) * output.unit.factor
    axes.fill_between(X, Y - band, Y + band, color=LIGHT, lw=0)
    axes.plot(X, Y, color=INK, lw=1.2)
    for t in _targets(results, s["output"]):
        axes.axhline(t["value"] * output.unit.factor, color=ACCENT, lw=1.2)
        sigma = (number(t.get("sigma")) or 0) * output.unit.factor
        axes.axhspan(
            t["value"] * output.unit.factor - sigma,
            t["value"] * output.unit.factor + sigma,
            color=ACCENT,
            alpha=0.15,
            lw=0,
        )
    done = [r for r in listed(results, "runs") if known((r.get("outputs") or {}).get(s["output"]))]
    pairs = [(r["values"].get(x.name), r["outputs"][s["output"]]) for r in done]
    if pairs:
        a, b = np.array([p for p in pairs if known(p[0])]).T
        axes.plot(a * x.unit.factor, b * output.unit.factor, "o", ms=2.6, color=INK)
    for c in candidates(results):
        for o in output_rows(c, s["output"]):
            a, b = c.value(x.name), number(o.get("predicted"))
            if a is not None and b is not None:
                axes.plot([a * x.unit.factor], [b * output.unit.factor], "D", ms=3.6, mfc=PAPER, mec=ACCENT)
    parameter_axis(axes, "x", x)
    axes.set_ylabel(f"{short(output.label, 24)}{output.unit.bracket}")


def sensitivity(results: Results, name: str) -> str:
    """Above: the output from the low to the high end of each parameter. Below: Sobol indices. One column per output."""
    data, views = {k: seen(results, results["sensitivity"].get(k) or ()) for k in ("local", "sobol")}, outputs(results)
    ids = list(dict.fromkeys(b["output"] for key in ("local", "sobol") for b in data.get(key) or ()))[:4]
    names = list(dict.fromkeys(b["parameter"] for key in ("local", "sobol") for b in data.get(key) or ()))[:12]
    letters = {p.name: p.letter for p in parameters(results)}
    figure = canvas(1.1 + 0.5 * len(names))
    grid = figure.subplots(2, len(ids), squeeze=False, sharey="row")
    for column, i in enumerate(ids):
        unit = views[i].unit if i in views else Unit("")
        above, below = grid[:, column]
        for b in data.get("local") or ():
            if b["output"] == i and b["parameter"] in names and known(b.get("low")) and known(b.get("high")):
                y, ends = -names.index(b["parameter"]), np.array([b["low"], b["high"]]) * unit.factor
                above.plot(ends, [y, y], color=ACCENT, lw=5, solid_capstyle="butt", alpha=0.85)
                above.plot(ends[:1], [y], "o", ms=4.5, mfc=PAPER, mec=ACCENT)
                above.plot(ends[1:], [y], "o", ms=4.5, color=INK)
        for b in data.get("sobol") or ():
            if b["output"] == i and b["parameter"] in names:
                _index(below, -names.index(b["parameter"]), b)
        above.set_title(short(views[i].label if i in views else clean(i), 20), fontsize=8.5)
        above.set_xlabel(unit.label)
        above.xaxis.set_major_locator(MaxNLocator(3))
        below.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
        below.set_xlim(-0.04, 1.06)
        below.set_xlabel("Sobol index")
        for axes in (above, below):
            axes.set_yticks([-k for k in range(len(names))], [letters.get(n, clean(n)) for n in names])
            axes.tick_params(axis="y", length=0, labelsize=9)
            axes.set_ylim(-len(names) + 0.4, 0.6)
            axes.spines["left"].set_visible(False)
    return svg(figure, name)


def _index(axes: Axes, y: float, b: Mapping[str, Any]) -> None:
    looks = (("total", 0.14, LIGHT, GREY, PAPER), ("first", -0.14, LIGHT, ACCENT, ACCENT))
    for key, shift, line, edge, fill in looks:
        x, ends = number(b.get(key)), b.get(f"{key}_interval") or ()
        if len(ends) == 2 and all(map(known, ends)):
            axes.plot(ends, [y + shift] * 2, color=line, lw=3, solid_capstyle="butt")
        if x is not None:
            axes.plot([x], [y + shift], "o", ms=4.2, mfc=fill, mec=edge)


def fronts(results: Results, s: Mapping[str, Any], name: str) -> str:
    """The front of a search in the space of parameters, and its objectives against each other (at most three pairs)."""
    free = parameters(results, free=True)[:2]
    targets = s.get("targets") or ()
    pairs = list(combinations(range(len(targets)), 2))[:3]
    figure = canvas((2.3, 2.0, 2.5, 2.1, 2.1)[len(pairs) + (len(pairs) > 0)])
    grid = np.atleast_1d(figure.subplots(1, len(pairs) + (len(free) > 0)))
    values, F = front(s)
    mine = [c for c in candidates(results) if c.search == clean(s["name"])]
    if free:
        _valley(grid[0], s, values, F, free, mine, wide=not pairs)
    for (i, j), axes in zip(pairs, grid[len(grid) - len(pairs) :], strict=True):
        _pair(axes, targets, F, i, j, mine)
    return svg(figure, name)


def _pair(
    axes: Axes, targets: Sequence[Mapping[str, Any]], F: np.ndarray, i: int, j: int, mine: list[CandidateView]
) -> None:
    unit = shown(targets[i].get("unit", ""), largest([float(v) for v in F[:, [i, j]].ravel()]))
    axes.plot(F[:, i] * unit.factor, F[:, j] * unit.factor, "o", ms=2.6, mfc=GREY, mec="none", alpha=0.8)
    for c in mine:
        rows = [o for k in (i, j) for o in output_rows(c, target_output(targets[k]))]
        miss = [abs(o["predicted"] - o["target"]) for o in rows if known(o["predicted"]) and known(o["target"])]
        if len(miss) == 2:
            at = (miss[0] * unit.factor, miss[1] * unit.factor)
            axes.scatter([at[0]], [at[1]], marker="D", s=46, c=PAPER, edgecolors=ACCENT, linewidths=0.9, zorder=3)
            axes.annotate(c.mark, at, ha="center", va="center", fontsize=6, zorder=4)
    several = len({t.get("experiment") for t in targets}) > 1
    a, b = (
        f"|Δ{short(channel_text(t['channel']), 8)}|{' of ' + short(clean(t['experiment']), 10) if several else ''} "
        f"{at_reading(t)}{unit.bracket}"
        for t in (targets[i], targets[j])
    )
    few_ticks(axes)
    axes.set(xlabel=a, ylabel=b)
    axes.margins(0.1)


def _valley(
    axes: Axes,
    s: Mapping[str, Any],
    front_values: list[Mapping[str, Any]],
    F: np.ndarray,
    free: tuple[ParameterView, ...],
    mine: list[CandidateView],
    wide: bool,
) -> None:
    values = [[number(v.get(p.name)) for p in free] for v in front_values]
    if len(free) > 1:
        every = values + [[c.value(p.name) for p in free] for c in mine]
        P = np.array([v for v in every if None not in v], float).reshape(-1, 2)
        limits = [_around(P[:, k], p) for k, p in enumerate(free)]
        lengths = [p.share(*limit) for p, limit in zip(free, limits, strict=True)]
        i, j = (1, 0) if wide and lengths[1] > lengths[0] else (0, 1)
        x, y = free[i], free[j]
        axes.plot(P[:, i] * x.unit.factor, P[:, j] * y.unit.factor, "o", ms=2.6, mfc=GREY, mec="none", alpha=0.8)
        for c in mine:
            _mark(axes, c.value(x.name), c.value(y.name), x, y, c.mark, c.best)
        parameter_axis(axes, "x", x, *limits[i])
        parameter_axis(axes, "y", y, *limits[j])
        return
    x, target = free[0], s["targets"][0]
    unit = shown(target.get("unit", ""), largest([float(v) for v in F[:, 0]]))
    pairs = [(v[0], f) for v, f in zip(values, F[:, 0], strict=True) if v[0] is not None]
    axes.plot(
        [a * x.unit.factor for a, _ in pairs], [f * unit.factor for _, f in pairs], "o", ms=3, mfc=GREY, mec="none"
    )
    parameter_axis(axes, "x", x, *_around(np.array([a for a, _ in pairs]), x))
    if F[:, 0].max() * unit.factor < 1e-3:
        axes.set_ylim(-0.05, 1.0)  # every target is met; ticks of 1e-13 would only show rounding
    axes.set_ylabel(f"missed by{unit.bracket}")


def _around(x: np.ndarray, p: ParameterView) -> tuple[float, float]:
    """Limits a little outside the values, on the scale of the parameter."""
    if not len(x):
        return p.low, p.high
    low, high = float(x.min()), float(x.max())
    if p.log and low > 0:
        room = max((high / low) ** 0.12, 1.03)
        return low / room, high * room
    room = 0.12 * (high - low) or 0.03 * abs(high) or 1.0
    return low - room, high + room
