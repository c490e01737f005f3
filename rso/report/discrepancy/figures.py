"""Every figure of a diagnosis as an SVG string, drawn from its plain data alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from rso.core.digits import fixed, known, places
from rso.discrepancy.parameters import called
from rso.report.canvas import ACCENT, GREY, HALO, INK, LIGHT, PALE, PAPER, WARM, canvas, plain_log, short, style, svg
from rso.report.discrepancy.maps import legend, residual_map
from rso.report.discrepancy.reading import (
    Found,
    amount,
    chance,
    chosen,
    core,
    label,
    parameter_bands,
    said_when,
    unit_of,
    verdict_of,
)
from rso.report.discrepancy.signatures import signature_map
from rso.report.layout.digits import clean, symbol
from rso.report.reading import listed, number
from rso.report.sketch import SKETCH_PICTURE, sketch_figure

MAX_HYPOTHESIS_BARS, MAX_HELD_OUT_CURVES = 7, 12  # of one figure
_POWER_COLOURS = LinearSegmentedColormap.from_list("power", [PALE, "#9fc3d3", ACCENT])


def draw(found: Found, name: str) -> str:
    """The figure that a :class:`~rso.report.layout.document.Picture` names; ValueError for an unknown name."""
    if name == SKETCH_PICTURE:
        with style():
            return sketch_figure(found)
    figures = {
        "residuals": residual_map,
        "residuals-more": lambda f: residual_map(f, more=True),
        "probabilities": probabilities,
        "signatures": signature_map,
        "shrinkage": shrinkage,
        "curves": held_out_curves,
        "parameters": parameters,
        "power": power,
    }
    if name not in figures:
        raise ValueError(f"no figure {name!r}")
    with style():
        return svg(figures[name](found), name)


def leading(found: Found) -> list[tuple[str, float]]:
    """Hypotheses that are worth a bar, with their probabilities."""
    rows = [(str(k), float(v)) for k, v in (found.get("probabilities") or {}).items() if known(v)]
    rows.sort(key=lambda v: -v[1])
    return [v for k, v in enumerate(rows[:MAX_HYPOTHESIS_BARS]) if k < 4 or v[1] >= 0.005]


def probabilities(found: Found) -> Figure:
    """One bar per hypothesis."""
    rows = leading(found)
    figure = canvas(0.25 + 0.27 * len(rows))
    axes = figure.subplots()
    named = set(core(found).get("ambiguous_with", [[]])[0]) if core(found).get("ambiguous_with") else set()
    for k, (name, q) in enumerate(rows):
        strong = k == 0 or name in named
        axes.barh(-k, 1.0, height=0.62, color=PALE, lw=0)
        axes.barh(-k, q, height=0.62, color=ACCENT if strong else GREY, lw=0)
        axes.text(1.015, -k, chance(q), va="center", color=ACCENT if strong else INK, fontsize=8.5)
    texts = [short(label(found, n), 56) for n, _ in rows]
    axes.set_yticks([-k for k in range(len(rows))], texts)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(0, 1.12), ylim=(-len(rows) + 0.45, 0.55), xticks=[])
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    return figure


_SHRINKAGE_STEPS = ("before", "refit_only", "with_cause")


def shrinkage(found: Found) -> Figure:
    """From the gap before to what is left, in steps."""
    s = core(found)["shrinkage"]
    before, refit, cause = (float(s[k]) for k in _SHRINKAGE_STEPS)
    floor = float(s.get("noise_floor") or 1.0)
    rows = [("before", 0.0, before, GREY), ("a re-fit alone", refit, before, LIGHT)]
    if chosen(found):
        word = "best of the catalogue" if verdict_of(found) == "unexplained" else "the cause"
        rows.append((word, cause, refit, ACCENT))
    left = cause if chosen(found) else refit
    rows.append(("what is left", 0.0, left, GREY))
    figure = canvas(0.75 + 0.25 * len(rows))
    axes = figure.subplots()
    top = max(before, refit, cause, floor)
    axes.axvline(floor, color=INK, lw=0.9, ls=(0, (4, 2)), zorder=3)
    for k, (_, low, high, colour) in enumerate(rows):
        step = 0 < k < len(rows) - 1
        text = fixed(abs(high - low), max(places(top, 3), 0))
        worse, none = low > high and text.strip("0."), not text.strip("0.")
        axes.barh(-k, high - low, left=low, height=0.58, color=WARM if worse else colour, lw=0)
        text = f"{'' if none else '+' if worse else '−'}{text}" if step else text
        axes.annotate(
            text,
            (max(low, high), -k),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            path_effects=HALO,
            color=WARM if worse else INK,
            zorder=5,
        )
        if k < len(rows) - 1:
            x = high if k == 0 else low
            axes.plot([x, x], [-k - 0.29, -k - 0.71], color=GREY, lw=0.6)
    axes.annotate(
        "noise floor",
        (floor, 0.42),
        xytext=(3, 0),
        textcoords="offset points",
        va="bottom",
        fontsize=8,
        path_effects=HALO,
    )
    axes.set_yticks([-k for k in range(len(rows))], [r[0] for r in rows])
    axes.set(xlim=(0, 1.12 * top), ylim=(0.5 - len(rows), 0.9), xlabel="G: mean of the squared misfit over its noise")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    return figure


def drawn_curves(found: Found) -> list[Mapping[str, Any]]:
    """Held-out curves whose three gaps are known."""
    curves = (core(found).get("shrinkage") or {}).get("curves") or ()
    return [c for c in curves if all(known(c.get(k)) and c[k] > 0 for k in _SHRINKAGE_STEPS)]


def held_out_curves(found: Found) -> Figure:
    """The three gaps of each held-out curve."""
    curves = drawn_curves(found)[:MAX_HELD_OUT_CURVES]
    figure = canvas(0.72 + 0.2 * len(curves))
    axes = figure.subplots()
    some = chosen(found) is not None
    for k, c in enumerate(curves):
        before, refit, cause = (float(c[v]) for v in _SHRINKAGE_STEPS)
        axes.plot([before, cause], [-k, -k], color=LIGHT, lw=1.6, solid_capstyle="butt", zorder=1)
        axes.plot([before], [-k], "o", ms=5, color=GREY, mew=0)
        axes.plot([refit], [-k], "|", ms=7, color=INK, mew=1.3)
        if some:
            axes.plot([cause], [-k], "o", ms=5, color=ACCENT, mew=0)
    axes.axvline(1.0, color=INK, lw=0.9, ls=(0, (4, 2)), zorder=0)
    values = [1.0, *(float(c[v]) for c in curves for v in _SHRINKAGE_STEPS)]
    if max(values) > 5 * min(values):
        axes.set_xscale("log")
        plain_log(axes.xaxis)
        axes.set_xlim(0.8 * min(values), 1.25 * max(values))
    else:
        room = 0.05 * max(max(values) - min(values), 0.2)
        axes.set_xlim(min(values) - room, max(values) + room)
    axes.set(ylim=(-len(curves) + 0.4, 0.6), xlabel="G of each held-out curve")
    axes.set_yticks([-k for k in range(len(curves))], [short(clean(c.get("curve")), 28) for c in curves])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    handles = [
        Line2D([], [], marker="o", ms=5, mew=0, lw=0, color=GREY, label="before"),
        Line2D([], [], marker="|", ms=7, mew=1.3, lw=0, color=INK, label="re-fitted"),
    ]
    if some:
        handles.append(Line2D([], [], marker="o", ms=5, mew=0, lw=0, color=ACCENT, label="with the cause"))
    legend(figure, handles)
    return figure


_BAND_WORDS = {"before": "without cause", "if_nothing_else": "nothing else", "after": "all allowed"}


def parameters(found: Found) -> Figure:
    """Each parameter by what it depends on: median and 90 % interval."""
    rows = parameter_bands(found)[:4]
    shown = [w for w in ("before", "if_nothing_else", "after") if w in said_when(found)]
    whens = [(w, GREY if w == shown[0] else ACCENT) for w in shown]
    figure = canvas(0.65 + 0.25 * len(whens))
    grid = figure.subplots(1, len(rows), squeeze=False)[0]
    for axes, (name, unit, bands) in zip(grid, rows, strict=True):
        use = unit_of(unit, max(b[2] for b in bands.values()))
        for k, (when, colour) in enumerate(whens):
            if b := bands.get(when):
                low, mid, high = (v * use.factor for v in b)
                axes.plot([low, high], [-k, -k], color=colour, lw=5, solid_capstyle="butt", alpha=0.45)
                axes.plot([mid], [-k], "o", ms=5.5, mfc=colour, mec=PAPER, mew=0.8)
        ends = [v for b in bands.values() for v in b]
        if min(ends) > 0 and max(ends) > 5 * min(ends):
            axes.set_xscale("log")
            plain_log(axes.xaxis)
        else:
            axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.margins(x=0.08)
        axes.set_yticks([-k for k in range(len(whens))], [_BAND_WORDS[w] for w, _ in whens])
        axes.set(ylim=(0.4 - len(whens), 0.6), xlabel=f"{symbol(name)}{use.bracket}")
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
    return figure


def power_rows(found: Found) -> list[tuple[str, list[float], Mapping[str, Any]]]:
    """(effect, power from the smallest to the largest plausible size, its entry), the most visible first."""
    seen = {clean(v.get("effect")): v for v in core(found).get("detectable") or ()}
    rows = []
    for p in listed(found, "power"):
        values = [float(q) for _, q in p.get("power") or () if known(q)]
        if values:
            rows.append((clean(p.get("effect")), values, seen.get(clean(p.get("effect")), {})))
    return sorted(rows, key=lambda v: (not v[2].get("visible"), -float(np.mean(v[1]))))


def least(values: Sequence[float]) -> str:
    """What stands before a limit where the smallest size that was simulated is seen already."""
    return "≤ " if values[0] >= 0.5 else ""


def power(found: Found) -> Figure:
    """One strip per effect: how often a gap of that size is noticed."""
    rows = [v for v in power_rows(found) if v[2].get("visible")] or power_rows(found)
    figure = canvas(0.75 + 0.185 * len(rows))
    axes = figure.subplots()
    for k, (name, values, entry) in enumerate(rows):
        n = len(values)
        for i, q in enumerate(values):
            axes.barh(-k, 1 / n, left=i / n, height=0.8, color=_POWER_COLOURS(q), edgecolor=PAPER, lw=0.8)
        limit = number(entry.get("smallest_visible"))
        word = "any" if entry.get("visible") else "invisible"
        if limit is not None:
            word = least(values) + amount(limit, entry.get("unit"), 2)
        axes.text(1.03, -k, word, va="center", fontsize=8, color=INK if entry.get("visible") else GREY)
        axes.text(
            -0.015,
            -k,
            short(clean(called(found, name)), 62),
            va="center",
            ha="right",
            fontsize=8,
            color=INK if entry.get("visible") else GREY,
        )
    axes.text(1.03, 0.95, "visible from", va="center", fontsize=8, color=GREY)
    axes.text(0.0, 0.95, "small", va="center", ha="left", fontsize=8, color=GREY)
    axes.text(1.0, 0.95, "large", va="center", ha="right", fontsize=8, color=GREY)
    axes.set(xlim=(0, 1), ylim=(-len(rows) - 0.9, 1.3))
    axes.axis("off")
    for i in range(21):
        axes.barh(-len(rows) - 0.25, 0.4 / 21, left=i * 0.4 / 21, height=0.45, color=_POWER_COLOURS(i / 20), lw=0)
    axes.text(0.42, -len(rows) - 0.25, "noticed never … always", va="center", fontsize=8, color=GREY)
    return figure
