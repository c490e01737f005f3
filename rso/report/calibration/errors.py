"""How sure the answer is, drawn: posterior draws in pairs, residuals against a normal law, the parts of errors."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from scipy.ndimage import gaussian_filter

from rso.report.canvas import ACCENT, GREY, INK, LIGHT, NARROW_WIDTH_INCH, PAPER, WARM, canvas, parameter_axis, svg
from rso.report.layout.digits import channel_text, clean, percent
from rso.report.layout.document import Block, Picture
from rso.report.reading import (
    ParameterView,
    Results,
    drawn_at,
    fitted_band,
    fitted_curves,
    fitted_model,
    listed,
    number,
    on_the_way,
    parameters,
    points,
)

PAIRS_PICTURE, RESIDUALS_PICTURE, BUDGET_PICTURE = "pairs", "residuals", "budget"
MIN_DENSITY_DRAWS = 200  # draws of which a density is drawn
MAX_PAIRED_PARAMETERS = 4  # the first ones, of which pairs are drawn
DENSITY_CELLS_PER_AXIS = 40  # of a density along each axis
CONTOUR_SHARES = (0.9, 0.5)  # of the draws that a contour holds
_ERROR_PART_LOOKS = {
    "measurement": ("measurement", INK),
    "numerical": ("numerical (mesh)", ACCENT),
    "interpolation": ("between computed travels", WARM),
    "emulator": ("response surface", GREY),
}
_DENSITY_COLOURS = LinearSegmentedColormap.from_list("density", [PAPER, "#8fadba", ACCENT])


def error_blocks(results: Results) -> tuple[Block, ...]:
    """Pictures of what there are numbers for."""
    blocks: list[Block] = []
    if len(_free(results)) > 1:
        inner, outer = (percent(s) for s in sorted(CONTOUR_SHARES))
        blocks.append(
            Picture(PAIRS_PICTURE, f"Draws of the posterior in pairs. The lines hold {inner} and {outer} of them.")
        )
    if _left(results):
        said = (
            "What the fit leaves of the readings, in standard deviations of a reading: over depth, and in order "
            "against a normal law. Errors that are correlated along depth make waves, no scatter."
        )
        if any(_white(results, e) is not None for e in fitted_curves(results)):
            said += " Right: whitened, so that the dots follow the line where model and errors are right."
        blocks.append(Picture(RESIDUALS_PICTURE, said))
    if _budget(results):
        blocks.append(
            Picture(BUDGET_PICTURE, "Errors that the intervals count: root mean squares over the largest reading.")
        )
    return tuple(blocks)


def _free(results: Results) -> list[tuple[ParameterView, np.ndarray]]:
    """Open parameters with their draws, of which there are enough."""
    draws = results.get("draws") or {}
    found = [(p, np.asarray(draws.get(p.name, ()), float)) for p in parameters(results, free=True)][
        :MAX_PAIRED_PARAMETERS
    ]
    whole = [
        (p, x) for p, x in found if len(x) >= MIN_DENSITY_DRAWS and np.isfinite(x).all() and (not p.log or x.min() > 0)
    ]
    return whole if len({len(x) for _, x in whole}) == 1 else []


def pairs_figure(results: Results, name: str) -> str:
    """Below the diagonal densities of two parameters, on it those of one."""
    found = _free(results)
    n = len(found)
    figure = canvas(1.5 * n + 0.3, NARROW_WIDTH_INCH if n < 4 else 7.2)
    grid = figure.subplots(n, n, squeeze=False)
    for i, (py, y) in enumerate(found):
        for j, (px, x) in enumerate(found):
            axes = grid[i, j]
            if j > i:
                axes.axis("off")
                continue
            if i == j:
                count, edges = np.histogram(_scale(px, x), DENSITY_CELLS_PER_AXIS)
                axes.stairs(count, _back(px, edges) * px.unit.factor, color=ACCENT, fill=True, alpha=0.5)
                parameter_axis(axes, "x", px, float(x.min()), float(x.max()))
                axes.set_yticks([])
                axes.spines["left"].set_visible(False)
            else:
                _density(axes, px, py, x, y)
            axes.tick_params(labelsize=7)
            if i < n - 1:
                axes.set_xlabel("")
            if j or i == 0:
                axes.set_ylabel("")
    return svg(figure, name, plate=True)


def _scale(p: ParameterView, x: np.ndarray) -> np.ndarray:
    return np.log(x) if p.log else x


def _back(p: ParameterView, x: np.ndarray) -> np.ndarray:
    return np.exp(x) if p.log else x


def _density(axes: Axes, px: ParameterView, py: ParameterView, x: np.ndarray, y: np.ndarray) -> None:
    count, a, b = np.histogram2d(_scale(px, x), _scale(py, y), DENSITY_CELLS_PER_AXIS)
    smooth = gaussian_filter(count, 1.2)
    X, Y = (_back(p, 0.5 * (e[1:] + e[:-1])) * p.unit.factor for p, e in ((px, a), (py, b)))
    axes.contourf(X, Y, smooth.T, 8, cmap=_DENSITY_COLOURS)
    order = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(order) / order.sum()
    levels = sorted({float(order[np.searchsorted(held, s)]) for s in CONTOUR_SHARES})
    axes.contour(X, Y, smooth.T, levels, colors=INK, linewidths=0.8)
    parameter_axis(axes, "x", px, float(x.min()), float(x.max()))
    parameter_axis(axes, "y", py, float(y.min()), float(y.max()))


def _white(results: Results, e: Mapping[str, Any]) -> np.ndarray | None:
    """Whitened residuals of a fitted curve; None where results do not hold them."""
    band = fitted_band(results, e)
    z = [number(v) for v in (band.data.get("white") or ())] if band else []
    return np.array(z, float) if z and None not in z else None


def _left(results: Results) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, depth and residual over σ of the fitted curves whose σ is known."""
    model, rows = fitted_model(results), []
    for e in fitted_curves(results) if model else ():
        m = on_the_way(e.get("measured") or {})
        u, y = points(m.get("depth"), m.get("value"))
        band = fitted_band(results, e)
        if band is not None and len(band.loading.depth) > 3 and len(u) > 3:
            here = band.loading
            a, b = (np.array(v) for v in zip(*((a, b) for a, b in zip(u, y, strict=True) if a > 0), strict=True))
            sd = np.maximum(np.interp(a, here.depth, here.sd), 1e-300)
            rows.append((clean(e["name"]), a, (b - np.interp(a, here.depth, here.value)) / sd))
            continue
        d, s = points(m.get("depth"), m.get("sigma"))
        x, f = model.curve(e["name"]) if model else ((), ())
        sigma = dict(zip(d, s, strict=True))
        inside = [(a, b, sigma[a]) for a, b in zip(u, y, strict=True) if x and 0 < a <= x[-1] and sigma.get(a)]
        if len(inside) > 3:
            a, b, c = np.array(inside).T
            rows.append((clean(e["name"]), a, (b - drawn_at(x, f, a)) / c))
    return rows


def residuals_figure(results: Results, name: str) -> str:
    """Residuals over depth, and sorted against the quantiles of the normal law."""
    figure = canvas(2.4, NARROW_WIDTH_INCH)
    left, right = figure.subplots(1, 2, sharey=True)
    reach = 1.0
    whitened = {clean(e["name"]): _white(results, e) for e in fitted_curves(results)}
    for k, (label, u, z) in enumerate(_left(results)):
        colour = (ACCENT, WARM, INK, GREY)[k % 4]
        left.plot(u, z, "o", ms=3, color=colour, label=label)
        white = whitened.get(label)
        z = z if white is None else white
        order = np.sort(z)
        q = [NormalDist().inv_cdf((i + 0.5) / len(z)) for i in range(len(z))]
        right.plot(q, order, "o", ms=3, color=colour, label=label)
        reach = max(reach, abs(q[0]))
    for axes in (left, right):
        axes.axhline(0, color=INK, lw=0.7)
        axes.axhspan(-2, 2, color=LIGHT, alpha=0.4, lw=0)
    right.plot([-reach, reach], [-reach, reach], color=GREY, lw=0.8, ls="--", label="normal law")
    left.set(xlabel="depth (mm)", ylabel="residual / σ")
    right.set_xlabel("normal quantile")
    return svg(figure, name)


def _budget(results: Results) -> list[tuple[str, Mapping[str, Any]]]:
    found = listed(results.get("identification") or {}, "data")
    rows = [(f"{clean(d['experiment'])} {channel_text(d.get('channel'))}", d.get("errors") or {}) for d in found]
    return [(label, e) for label, e in rows if any(number(v) for v in e.values())]


def budget_figure(results: Results, name: str) -> str:
    """One bar per part and curve, in per cent of the largest reading."""
    rows = _budget(results)
    shown_parts = list(dict.fromkeys(k for _, e in rows for k in e if number(e.get(k))))
    figure = canvas(0.75 + 0.22 * len(rows) * (len(shown_parts) + 1), NARROW_WIDTH_INCH)
    axes = figure.subplots()
    ticks, labels, y = [], [], 0.0
    for label, e in rows:
        for part in shown_parts:
            words, colour = _ERROR_PART_LOOKS.get(part, (clean(part), GREY))
            size = 100.0 * (number(e.get(part)) or 0.0)
            axes.barh([y], [size], height=0.7, color=colour)
            axes.annotate(percent(size / 100), (size, y), xytext=(4, 0), textcoords="offset points", va="center")
            ticks.append(y)
            labels.append(f"{label}: {words}" if len(rows) > 1 else words)
            y -= 1.0
        y -= 0.6
    axes.set_yticks(ticks, labels)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.margins(x=0.12)
    axes.set_xlabel("% of the largest reading")
    if len(rows) == 1:
        axes.set_title(rows[0][0], color=GREY)
    return svg(figure, name)
