"""What each parameter moves, in detail: over the depth of a curve, over its own range, and by Morris's screening."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from rso.core.digits import known, significant
from rso.report.canvas import ACCENT, GREY, HALO, INK, WARM, canvas, parameter_axis, short, svg, tag
from rso.report.layout.digits import Unit, channel_text, clean, percent, shortest, signed
from rso.report.layout.document import Block, Cell, Picture, Table, column, table, words
from rso.report.reading import Results, number, outputs, pair, parameters, seen

_PARAMETER_LOOKS = ((ACCENT, "-"), (INK, "--"), (WARM, "-."), (GREY, ":"), (ACCENT, ":"), (INK, "-."))
_MAX_INFLUENCE_PANELS = 4  # parameters, and outputs, of a figure
_MAX_INFLUENCE_CURVES = 2  # curves with more would be a book

Row = Mapping[str, Any]


def influence_blocks(results: Results) -> list[Block]:
    """Pictures and tables, as far as a study asked for them."""
    blocks: list[Block] = []
    for k, (experiment, channel) in enumerate(_curves(results)):
        blocks.append(Picture(f"along-{k}", _along_caption(results, experiment, channel)))
    if _shapes(results):
        blocks.append(Picture("shapes", _shapes_caption(results)))
    if _morris(results):
        blocks += [Picture("morris", _morris_caption(results)), _morris_table(results)]
    return blocks


def extrapolation(names: list[str], total: int) -> str:
    """Which candidates lie where no run stands for them; empty if none does."""
    if not names:
        return ""
    what = "Candidate" if len(names) == 1 else "Candidates"
    verb, its = ("lies", "its prediction is") if len(names) == 1 else ("lie", "their predictions are")
    which = "All candidates" if len(names) == total > 1 else f"{what} {', '.join(names)}"
    return (
        f"{which} {verb} outside the convex hull of the training runs: {its} an extrapolation, and only the rerun "
        "is reliable there."
    ).replace("predictions are an extrapolation", "predictions are extrapolations")


# ------------------------------------------------------------------------------------------------------ over depth


def _curves(results: Results) -> list[tuple[str, str]]:
    """(experiment, channel) of the first curves along which something is known."""
    rows = [r for r in _loading(results) if known(r.get("depth_mm"))]
    rows = [r for r in rows if known(r.get("total")) or known(r.get("elasticity"))]
    depths: dict[tuple[str, str], set[float]] = {}
    for r in rows:
        depths.setdefault((r["experiment"], r["channel"]), set()).add(r["depth_mm"])
    return [key for key, at in depths.items() if len(at) > 1][:_MAX_INFLUENCE_CURVES]


def _sensitivity(results: Results, key: str) -> list[Row]:
    return list((results.get("sensitivity") or {}).get(key) or ())


def _loading(results: Results) -> list[Row]:
    """Rows along the way there: in a hold all are at one depth."""
    return [r for r in _sensitivity(results, "along") if not r.get("since_s")]


def _over_depth(results: Results, key: tuple[str, str], field: str) -> dict[str, list[tuple[float, float, Row]]]:
    """Parameter → (depth, value, row) in order of depth, where the field is known."""
    found: dict[str, list[tuple[float, float, Row]]] = {}
    for r in _loading(results):
        u, x = number(r.get("depth_mm")), number(r.get(field))
        if (r["experiment"], r["channel"]) == key and u is not None and x is not None:
            found.setdefault(r["parameter"], []).append((u, x, r))
    return {p: sorted(rows, key=lambda row: row[0]) for p, rows in found.items()}


def _along_caption(results: Results, experiment: str, channel: str) -> str:
    letters, key = _letters(results), (experiment, channel)
    said = f"{channel_text(channel)} of {clean(experiment)} over the depth"
    total = _over_depth(results, key, "total")
    if total:
        parts = []
        for p, rows in total.items():
            (a, x, _), (b, y, _) = rows[0], rows[-1]
            shares = f"{percent(x)} of the variance at {shortest(a)} mm and {percent(y)} at {shortest(b)} mm"
            parts.append(f"{letters.get(p, clean(p))} takes part in {shares}")
        said += f": {'; '.join(parts)}. Left: total Sobol indices with their intervals."
    else:
        said += "."
    if _over_depth(results, key, "elasticity"):
        said += f" {'Right' if total else 'Shown'}: elasticity, the percentage by which the force changes for 1 % of θ."
    return said.replace("the force changes", f"{channel_text(channel)} changes")


def along_figure(results: Results, k: int, name: str) -> str:
    """Total Sobol index and elasticity of every parameter over the depth of the k-th curve."""
    key = _curves(results)[k]
    panels = [
        (f, t)
        for f, t in (("total", "total Sobol index"), ("elasticity", "d ln y / d ln θ"))
        if _over_depth(results, key, f)
    ]
    figure = canvas(2.5)
    for axes, (field, title) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        lines = _over_depth(results, key, field)
        for n, (p, rows) in enumerate(list(lines.items())[: len(_PARAMETER_LOOKS)]):
            x, y = np.array([a for a, _, _ in rows]), np.array([b for _, b, _ in rows])
            colour, line = _PARAMETER_LOOKS[n]
            if field == "total":
                found = [(r.get("total_interval"), b) for _, b, r in rows]
                ends = np.array([i if pair(i) else (b, b) for i, b in found], float)
                axes.fill_between(x, ends[:, 0], ends[:, 1], color=colour, alpha=0.14, lw=0)
            axes.plot(x, y, line, color=colour)
            at = int(0.62 * (len(x) - 1))
            tag(axes, x[at], y[at], _letters(results).get(p, clean(p)), colour=colour, offset=(0, 8), ha="center")
        if field == "total":
            axes.set_ylim(-0.04, 1.12)
        else:
            axes.axhline(0, color=GREY, lw=0.6)
            axes.margins(y=0.15)
        axes.set_title(title)
        axes.set_xlabel("depth (mm)")
        axes.set_xlim(0, None)
    return svg(figure, name)


def _letters(results: Results) -> dict[str, str]:
    return {p.name: p.letter for p in parameters(results)}


# ------------------------------------------------------------------------------------------------------ over a range


def _shapes(results: Results) -> dict[str, list[Row]]:
    """Parameter → its local curves, one per output, where both are known."""
    found: dict[str, list[Row]] = {}
    for c in seen(results, _sensitivity(results, "curves")):
        if len(c.get("x") or ()) > 2 and all(map(known, [*c["x"], *c["y"]])):
            found.setdefault(c["parameter"], []).append(c)
    ours = {p.name for p in parameters(results, free=True)}
    return {p: rows[:_MAX_INFLUENCE_PANELS] for p, rows in list(found.items())[:_MAX_INFLUENCE_PANELS] if p in ours}


def _middle(c: Row) -> float:
    return float(c["y"][len(c["y"]) // 2])


def _shapes_caption(results: Results) -> str:
    letters, parts = _letters(results), []
    for p, rows in _shapes(results).items():
        low, high = max((_change(c) for c in rows), key=lambda ends: ends[1] - ends[0])
        parts.append(f"{letters.get(p, clean(p))} {percent(low)} to {signed(high, percent(high))}")
    return (
        "One parameter at a time over its range, the others in the middle. Change of the output that moves most: "
        f"{', '.join(parts)}. A level line says that this output does not show the parameter."
    )


def _change(c: Row) -> tuple[float, float]:
    """Least and largest change against the middle, as a fraction of its size."""
    y, middle = np.array(c["y"], float), _middle(c)
    share = (y - middle) / abs(middle) if middle else 0 * y
    return float(share.min()), float(share.max())


def shapes_figure(results: Results, name: str) -> str:
    """Change of each output against its value in the middle of the range, one panel per parameter."""
    shapes, views = _shapes(results), outputs(results)
    by_name = {p.name: p for p in parameters(results)}
    figure = canvas(2.5)
    for n, (axes, (p, rows)) in enumerate(
        zip(np.atleast_1d(figure.subplots(1, len(shapes), sharey=True)), shapes.items(), strict=True)
    ):
        parameter = by_name[p]
        axes.axhline(0, color=GREY, lw=0.6)
        for k, c in enumerate(rows):
            colour, line = _PARAMETER_LOOKS[k]
            y = 100 * (np.array(c["y"], float) - _middle(c)) / (abs(_middle(c)) or 1.0)
            label = views[c["output"]].label if c["output"] in views else clean(c["output"])
            axes.plot(np.array(c["x"]) * parameter.unit.factor, y, line, color=colour, label=short(label, 24))
        parameter_axis(axes, "x", parameter)
        if n == 0:
            axes.set_ylabel("change (%)")
            axes.legend(frameon=False, fontsize=7.5, handlelength=1.8, loc="best")
    return svg(figure, name)


# ------------------------------------------------------------------------------------------------------ Morris


def _morris(results: Results) -> list[Row]:
    rows = seen(results, _sensitivity(results, "morris"))
    return [m for m in rows if known(m.get("mu_star")) and known(m.get("sigma"))]


def _units(results: Results) -> Callable[[str], Unit]:
    views = outputs(results)
    return lambda i: views[i].unit if i in views else Unit("")


def _labels(results: Results) -> Callable[[str], str]:
    views = outputs(results)
    return lambda i: views[i].label if i in views else clean(i)


def _morris_caption(results: Results) -> str:
    letters, rows, label = _letters(results), _morris(results), _labels(results)
    first = rows[0]["output"]
    mine = sorted((m for m in rows if m["output"] == first), key=lambda m: -m["mu_star"])
    order = " > ".join(f"{letters.get(m['parameter'], clean(m['parameter']))}" for m in mine)
    said = f"Morris’s screening of {label(first)}: in order of mean size, {order}. " if len(mine) > 1 else ""
    return said + (
        "To the right: how much the output changes per full range of a parameter (μ*); upwards: how much that differs "
        "from place to place (σ). Below the dashed line σ = μ* an effect is mostly the same everywhere; above it "
        "curvature or other parameters decide it."
    )


def morris_figure(results: Results, name: str) -> str:
    """σ against μ* of every parameter, one panel per output."""
    rows, unit, label, letters = _morris(results), _units(results), _labels(results), _letters(results)
    ids = list(dict.fromkeys(m["output"] for m in rows))[:_MAX_INFLUENCE_PANELS]
    figure = canvas(2.5)
    for axes, i in zip(np.atleast_1d(figure.subplots(1, len(ids))), ids, strict=True):
        mine = [m for m in rows if m["output"] == i]
        _screen(axes, mine, unit(i), letters)
        axes.set_title(short(label(i), 20), fontsize=8.5)
    return svg(figure, name)


def _screen(axes: Axes, mine: list[Row], unit: Unit, letters: Mapping[str, str]) -> None:
    x, y = (np.array([m[key] for m in mine], float) * unit.factor for key in ("mu_star", "sigma"))
    top = max(float(x.max()), float(y.max()), 1e-300)
    axes.plot([0, 1.25 * top], [0, 1.25 * top], "--", color=GREY, lw=0.7)
    axes.plot(x, y, "o", ms=4.6, color=ACCENT)
    for m, a, b in zip(mine, x, y, strict=True):
        axes.annotate(
            letters.get(m["parameter"], clean(m["parameter"])),
            (a, b),
            xytext=(5, 5),
            textcoords="offset points",
            path_effects=HALO,
        )
    axes.set(xlim=(-0.04 * top, 1.2 * top), ylim=(-0.04 * top, 1.2 * top), xlabel=f"μ*{unit.bracket}")
    axes.set_ylabel(f"σ{unit.bracket}")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(3))


def _morris_table(results: Results) -> Table:
    rows, unit, label, letters = _morris(results), _units(results), _labels(results), _letters(results)
    first = [k == 0 or rows[k - 1]["output"] != m["output"] for k, m in enumerate(rows)]
    names = [
        f"{label(m['output'])} ({unit(m['output']).label or '1'})" if f else ""
        for m, f in zip(rows, first, strict=True)
    ]

    def scaled(key: str) -> tuple[Cell, ...]:
        return words(
            [significant(None if (v := number(m.get(key))) is None else v * unit(m["output"]).factor, 3) for m in rows]
        )

    ratio = [m["sigma"] / m["mu_star"] if m["mu_star"] else None for m in rows]
    columns = [
        column("Output", tuple(Cell(n) for n in names), number=False),
        column("θ", words([letters.get(m["parameter"], clean(m["parameter"])) for m in rows]), number=False),
        column("μ", scaled("mu"), "mean"),
        column("μ*", scaled("mu_star"), "mean size"),
        column("σ", scaled("sigma"), "spread"),
        column("σ / μ*", words([significant(r, 2) for r in ratio])),
    ]
    return table("Morris’s elementary effects, per full range", columns, over(results))


def over(results: Results) -> str:
    """The ranges that sensitivities are about, in a sentence; empty where nothing shows."""
    data = results.get("sensitivity") or {}
    ranges, whose = (
        data.get("ranges") or {},
        {"stated": "stated", "searched": "widened"}.get(clean(data.get("ranges_are")), ""),
    )
    spans = [
        f"{p.letter} from {p.show(ends[0])} to {p.show(ends[1])}"
        for p in parameters(results)
        if pair(ends := ranges.get(p.name))
    ]
    return f"Over the {whose} ranges: {', '.join(spans)}." if spans else ""
