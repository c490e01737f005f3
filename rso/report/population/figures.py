"""Figures of many specimens: a forest plot for each parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rso.core.digits import known
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PALE, WARM, canvas, plain_log, short, style, svg
from rso.report.layout.digits import Unit, shown, symbol

Found = Mapping[str, Any]
SPECIMEN_HEIGHT_INCH = 0.17  # inch of a specimen
MAX_NAMED_SPECIMENS = 60  # specimens whose names stand beside their lines
LOGARITHMIC_AXIS_RATIO = 4.0  # ratio of the ends of an axis from which it is logarithmic


def draw(found: Found, parameter: str) -> str:
    """The forest plot of a parameter as SVG."""
    with style():
        return svg(forest(found, parameter), f"forest-{parameter}")


def forest(found: Found, parameter: str) -> Figure:
    """Each specimen with its interval, open ends as arrows, outliers marked; below the mean and what comes next."""
    p = next(p for p in found["population"] if p["parameter"] == parameter)
    rows = [
        (s["name"], block)
        for s in found["specimens"]
        for block in s["parameters"]
        if block["parameter"] == parameter and block["verdict"] != "fixed"
    ]
    unit = unit_of(p, rows)
    named = len(rows) <= MAX_NAMED_SPECIMENS
    height = min(max(1.6, SPECIMEN_HEIGHT_INCH * (len(rows) + 3) + 0.6), 14.0)
    figure = canvas(height)
    axes = figure.subplots()
    if known(p["interval"][0]):
        axes.axvspan(p["interval"][0] * unit.factor, p["interval"][1] * unit.factor, color=PALE, lw=0, zorder=0)
        axes.axvline(p["mean"] * unit.factor, color=LIGHT, lw=1.0, zorder=1)
    ends = [v * unit.factor for _, b in rows for v in (*b["interval"], b["value"]) if known(v)]
    _scale(axes, p, ends)
    for k, (_, block) in enumerate(rows):
        _row(axes, -k, block, unit)
    labels: dict[float, str] = {-k: short(name, 26) for k, (name, _) in enumerate(rows)} if named else {}
    below = -len(rows) - 0.5
    if known(p["mean"]) and known(p["interval"][0]):
        low, mean, high = (v * unit.factor for v in (p["interval"][0], p["mean"], p["interval"][1]))
        axes.fill([low, mean, high, mean], [below, below + 0.35, below, below - 0.35], color=ACCENT, lw=0)
        labels[below] = "median" if p["scale"] == "log" else "mean"
    if known(p["prediction"][0]):
        span = [v * unit.factor for v in p["prediction"]]
        axes.plot(span, [below - 1.0] * 2, color=ACCENT, lw=1.2, ls=(0, (4, 2)), label="next specimen")
        labels[below - 1.0] = "next specimen"
    axes.set_yticks(list(labels), list(labels.values()))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(below - 1.6, 0.7)
    axes.set_xlabel(f"{symbol(parameter)}{unit.bracket}")
    return figure


def unit_of(p: Found, rows: list[tuple[str, Found]]) -> Unit:
    """How values of a parameter are shown: by its mean, or by the middle specimen."""
    values = sorted(abs(b["value"]) for _, b in rows if known(b["value"]))
    size = abs(p["mean"]) if known(p["mean"]) else values[len(values) // 2] if values else None
    return shown(p["unit"], size)


def _scale(axes: Axes, p: Found, ends: list[float]) -> None:
    """A logarithmic axis where values are positive and lie far apart."""
    if p["scale"] == "log" and ends and max(ends) > LOGARITHMIC_AXIS_RATIO * min(ends) > 0:
        axes.set_xscale("log")
        plain_log(axes.xaxis)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(6))


def _row(axes: Axes, y: float, block: Found, unit: Unit) -> None:
    low, high = block["interval"]
    colour = WARM if block["outlier"] else GREY if block["bounded"] == "neither" else INK
    if known(low) and known(high):
        axes.plot([low * unit.factor, high * unit.factor], [y, y], color=colour, lw=1.2, zorder=2)
        ends = {"both": (), "upper": ((low, "<"),), "lower": ((high, ">"),), "neither": ((low, "<"), (high, ">"))}
        for x, mark in ends[block["bounded"]]:  # the range ends there, not what the data allow
            axes.plot([x * unit.factor], [y], marker=mark, ms=4.5, color=colour, ls="none", zorder=3)
    if known(block["value"]):
        mark = "D" if block["outlier"] else "o"
        face = "white" if block["bounded"] == "neither" else colour
        axes.plot([block["value"] * unit.factor], [y], mark, ms=4, mfc=face, mec=colour, mew=0.9, zorder=4)
