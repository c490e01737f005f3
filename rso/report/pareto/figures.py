"""Figures of a study with objectives: the front, the designs on it, slices of surfaces, sensitivities, convergence."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rso.report.canvas import ACCENT, GREY, HALO, INK, LIGHT, PALE, PAPER, WARM, canvas, plain_log, short, style, svg
from rso.report.layout.digits import symbol
from rso.report.pareto.reading import Found, axis_label, names, position, searched, unit_of, value_text, wide

MAX_DESIGN_LINES = 80  # designs of a front that are drawn as lines
MAX_SLICE_COLUMNS = 6  # parameters beside each other
DESIGN_COLOURS = colormaps["viridis"]


def draw(found: Found, name: str) -> str:
    """The figure of that name as SVG; ValueError for an unknown one."""
    makers = {
        "front": front,
        "designs": designs,
        "convergence": convergence,
        "slices": slices,
        "sensitivity": sensitivity,
    }
    if name not in makers:
        raise ValueError(f"no figure {name!r}; there are {', '.join(makers)}")
    with style():
        return svg(makers[name](found), name)


def front(found: Found) -> Figure:
    """Simulations, the front on the surfaces and the candidates; of one objective its value by run."""
    every = names(found)
    if len(every) == 1:
        return _progress(found)
    pairs = list(itertools.combinations(every, 2))
    if len(pairs) == 1:
        figure = canvas(3.9)
        _plane(figure.subplots(), found, *pairs[0])
    else:
        columns = 3 if len(pairs) == 3 else 2
        rows = -(-len(pairs) // columns)
        figure = canvas(2.6 * rows + 0.5)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, pair in zip(grid, pairs, strict=False):
            _plane(axes, found, *pair)
        for axes in grid[len(pairs) :]:
            axes.set_axis_off()
    handles, texts = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside upper left", ncols=5, frameon=False, fontsize=8)
    return figure


def _plane(axes: Axes, found: Found, a: str, b: str) -> None:
    kx, ky = unit_of(found, a).factor, unit_of(found, b).factor
    done = [r for r in found["runs"] if r["outputs"]]
    inside = [r for r in done if r["within_limits"]]
    outside = [r for r in done if not r["within_limits"]]
    points = found["front"]["points"] if found["front"]["feasible"] else []
    fx, fy = ([p["objectives"][n] * k for p in points] for n, k in ((a, kx), (b, ky)))
    if outside:
        axes.plot(
            [r["outputs"][a] * kx for r in outside], [r["outputs"][b] * ky for r in outside], "x", ms=3.2, mew=0.7,
            color=LIGHT, zorder=1, label="simulated, outside limits",
        )  # fmt: skip
    axes.plot(
        [r["outputs"][a] * kx for r in inside], [r["outputs"][b] * ky for r in inside], "o", ms=3.2, mfc=GREY,
        mec="none", alpha=0.6, zorder=2, label="simulated" + (", within limits" if found["constraints"] else ""),
    )  # fmt: skip
    line = "-" if len(names(found)) == 2 else "none"
    axes.plot(fx, fy, ls=line, marker=".", ms=3, lw=1.0, color=ACCENT, zorder=3, label="front")
    good = [c for c in found["candidates"] if c["simulated"]]
    axes.plot(
        [c["simulated"][a] * kx for c in good], [c["simulated"][b] * ky for c in good], "o", ms=6, mfc=PAPER, mec=WARM,
        mew=1.3, ls="none", zorder=4, label="candidates, simulated",
    )  # fmt: skip
    for c in good:
        axes.annotate(
            c["name"].split()[-1], (c["simulated"][a] * kx, c["simulated"][b] * ky), xytext=(6, 4), color=WARM,
            textcoords="offset points", fontsize=7.5, path_effects=HALO, zorder=5,
        )  # fmt: skip
    shown = [*zip(fx, fy, strict=True), *((c["simulated"][a] * kx, c["simulated"][b] * ky) for c in good)]
    rest = [(r["outputs"][a] * kx, r["outputs"][b] * ky) for r in inside]
    _scaled(axes, "x", [p[0] for p in shown], [p[0] for p in rest])
    _scaled(axes, "y", [p[1] for p in shown], [p[1] for p in rest])
    axes.set_xlabel(axis_label(found, a))
    axes.set_ylabel(axis_label(found, b))


def _scaled(axes: Axes, which: str, shown: Sequence[float], rest: Sequence[float]) -> None:
    """Limits that hold the front, and of other runs what is not far from it; a log scale where the front is wide."""
    if not shown and not rest:
        return
    core = np.array(shown or rest)
    log = wide(core.tolist(), 20.0)
    if log:
        getattr(axes, f"set_{which}scale")("log")
        plain_log(axes.xaxis if which == "x" else axes.yaxis)
        low, high = core.min() / 1.35, core.max() * 1.6
    else:
        span = float(np.ptp(core)) or abs(float(core[0])) or 1.0
        low, high = core.min() - 0.1 * span, core.max() + 0.35 * span
    getattr(axes, f"set_{which}lim")(low, high)


def _progress(found: Found) -> Figure:
    """One objective: its value in every simulation that keeps the limits, in their order, and the best so far."""
    figure = canvas(2.8)
    axes, o = figure.subplots(), found["objectives"][0]
    unit = unit_of(found, o["quantity"])
    rows = [(k, r["outputs"][o["quantity"]] * unit.factor, r["within_limits"])
            for k, r in enumerate(found["runs"], 1) if r["outputs"]]  # fmt: skip
    inside = [(k, v) for k, v, good in rows if good]
    if outside := [(k, v) for k, v, good in rows if not good]:
        axes.plot(*zip(*outside, strict=True), "x", ms=3.2, mew=0.7, color=LIGHT, label="outside limits")
    if inside:
        k, v = np.array(inside).T
        best = np.minimum.accumulate(v) if o["minimise"] else np.maximum.accumulate(v)
        axes.plot(k, v, "o", ms=3.2, mfc=GREY, mec="none", alpha=0.6, label="simulated within limits")
        axes.step(k, best, where="post", color=ACCENT, lw=1.4, label="best so far")
        if wide(v, 20.0):
            axes.set_yscale("log")
            plain_log(axes.yaxis)
    axes.set_xlabel("simulation")
    axes.set_ylabel(axis_label(found, o["quantity"]))
    axes.legend(frameon=False, fontsize=8)
    return figure


def designs(found: Found) -> Figure:
    """Parallel coordinates: every design of the front a line through its parameters and objectives."""
    parameters, objectives = searched(found), names(found)
    points = found["front"]["points"]
    keep = np.unique(np.linspace(0, len(points) - 1, min(len(points), MAX_DESIGN_LINES)).round().astype(int))
    points = [points[k] for k in keep]
    figure = canvas(3.2)
    axes = figure.subplots()
    ends = {n: _ends([p["objectives"][n] for p in points]) for n in objectives}
    count = len(parameters) + len(objectives)
    for p in points:
        y = [position(q, p["values"][q["name"]]) for q in parameters]
        y += [_share(p["objectives"][n], ends[n]) for n in objectives]
        axes.plot(range(count), y, color=DESIGN_COLOURS(0.92 * y[len(parameters)]), lw=0.9, alpha=0.75)
    for k in range(count):
        axes.axvline(k, color=GREY, lw=0.7, zorder=0)
    labels = [symbol(q["name"]) for q in parameters] + [short(n, 18) for n in objectives]
    tops = [_end(found, q, 1) for q in parameters] + [_number(found, n, ends[n][1]) for n in objectives]
    feet = [_end(found, q, 0) for q in parameters] + [_number(found, n, ends[n][0]) for n in objectives]
    for k, (top, foot) in enumerate(zip(tops, feet, strict=True)):
        axes.text(k, 1.03, top, ha="center", va="bottom", fontsize=7.5, color=GREY)
        axes.text(k, -0.03, foot, ha="center", va="top", fontsize=7.5, color=GREY)
    axes.set_xticks(range(count), [label.replace("_", "\n", 1) for label in labels])
    axes.tick_params(axis="x", length=0, pad=14)
    axes.set_yticks([])
    axes.set(xlim=(-0.4, count - 0.6), ylim=(-0.02, 1.02))
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.axvspan(len(parameters) - 0.5, count - 0.6, color=PALE, zorder=-1, lw=0)
    return figure


def _ends(values: Sequence[float]) -> tuple[float, float]:
    return min(values), max(values)


def _share(value: float, ends: tuple[float, float]) -> float:
    low, high = ends
    if low > 0 and high > 20 * low:
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low) if high > low else 0.5


def _number(found: Found, name: str, value: float) -> str:
    unit = unit_of(found, name)
    return f"{value_text(value, unit, 3)}{unit.after}"


def _end(found: Found, p: Found, end: int) -> str:
    if p["choices"]:
        return str(p["choices"][-end])
    return _number(found, p["name"], p["high"] if end else p["low"])


def convergence(found: Found) -> Figure:
    """Hypervolume by generation; beside it how far predictions were from simulations, round by round."""
    figure = canvas(2.3)
    left, right = figure.subplots(1, 2)
    h = found["front"]["hypervolume"]
    left.plot(range(1, len(h) + 1), h, color=ACCENT)
    left.set(xlabel="generation", ylabel="hypervolume (share)", ylim=(0, None))
    rounds = [(k, 100 * r["largest_difference"]) for k, r in enumerate(found["rounds"], 1) if r["largest_difference"]]
    if rounds:
        right.plot(*zip(*rounds, strict=True), "o-", color=ACCENT, ms=4)
        right.axhline(100 * found["verify"]["tolerance"], color=WARM, lw=0.9, ls=(0, (4, 2)))
        right.set_yscale("log")
        right.xaxis.set_major_locator(MaxNLocator(integer=True))
        right.set(xlabel="round of simulations", ylabel="largest difference (%)")
    else:
        right.set_axis_off()
    return figure


def slices(found: Found) -> Figure:
    """Each quantity along each parameter, the others at the first candidate."""
    cut = found["sensitivity"]["slices"]
    quantities = list(dict.fromkeys(c["quantity"] for c in cut))
    parameters = list(dict.fromkeys(c["parameter"] for c in cut))[:MAX_SLICE_COLUMNS]
    scales = {p["name"]: p["scale"] for p in searched(found)}
    figure = canvas(1.35 * len(quantities) + 0.5)
    grid = figure.subplots(len(quantities), len(parameters), squeeze=False, sharey="row")
    for i, q in enumerate(quantities):
        ky = unit_of(found, q).factor
        for j, p in enumerate(parameters):
            axes = grid[i][j]
            one = next(c for c in cut if c["quantity"] == q and c["parameter"] == p)
            y, sd = np.array(one["y"], float) * ky, np.array(one["sd"], float) * ky
            text = any(isinstance(v, str) for v in one["values"])
            x = range(len(y)) if text else np.array(one["values"], float) * unit_of(found, p).factor
            few = text or len(y) < 12
            axes.fill_between(x, y - 2 * sd, y + 2 * sd, color=ACCENT, alpha=0.18, lw=0)
            axes.plot(x, y, "o-" if few else "-", ms=3, color=ACCENT, lw=1.1)
            if text:
                axes.set_xticks(range(len(y)), [short(str(v), 9) for v in one["values"]])
            elif scales.get(p) == "log":
                axes.set_xscale("log")
                plain_log(axes.xaxis)
                axes.tick_params(axis="x", labelsize=6.5)
            else:
                axes.xaxis.set_major_locator(MaxNLocator(3))
            if i < len(quantities) - 1:
                axes.tick_params(axis="x", labelbottom=False)
            else:
                axes.set_xlabel(axis_label(found, p))
            if wide([v for c in cut if c["quantity"] == q for v in c["y"]]):
                axes.set_yscale("log")
            if j == 0:
                axes.set_ylabel(axis_label(found, q).replace(" (", "\n("), fontsize=7.5)
                if axes.get_yscale() == "linear":
                    axes.yaxis.set_major_locator(MaxNLocator(3))
    return figure


def sensitivity(found: Found) -> Figure:
    """Sobol indices of every quantity: total as a bar, first order within it, 90 % interval as a line."""
    indices = found["sensitivity"]["sobol"]
    parameters = [p["name"] for p in searched(found)]
    columns = min(len(indices), 3)
    rows = -(-len(indices) // columns)
    figure = canvas((0.22 * len(parameters) + 0.62) * rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, (text, table) in zip(grid, indices.items(), strict=False):
        y = np.arange(len(table))[::-1]
        total = np.array([np.nan if r["total"] is None else r["total"] for r in table], float)
        first = np.array([np.nan if r["first"] is None else r["first"] for r in table], float)
        ends = np.array([[np.nan if v is None else v for v in r["total_interval"]] for r in table], float)
        axes.barh(y, total, height=0.62, color=LIGHT, lw=0)
        axes.barh(y, first, height=0.62, color=ACCENT, lw=0)
        axes.hlines(y, ends[:, 0], ends[:, 1], color=INK, lw=1.0)
        axes.set_yticks(y, [symbol(p) for p in parameters])
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(0, 1.02)
        axes.set_title(short(text, 26))
    for axes in grid[len(indices) :]:
        axes.set_axis_off()
    return figure
