"""Every figure of the report as an SVG string, drawn from the results alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from rso.core.digits import interval_ends, known
from rso.report.calibration import cloud_maps, deformed, errors, turning
from rso.report.calibration.closed_forms import closed_form_figure
from rso.report.calibration.displacements import is_profile, profile_figure
from rso.report.calibration.gauss_newton import gauss_newton_figure
from rso.report.calibration.hold_panels import (
    BEST_CANDIDATE_LOOK,
    N_DRAWN_HOLD_POINTS,
    OTHER_CANDIDATE_LOOK,
    UNFITTED_BEST_LOOK,
    Resting,
    draw_creep,
    draw_resting,
    left_of,
)
from rso.report.calibration.identification import allowed, profiles
from rso.report.calibration.influence import along_figure, morris_figure, shapes_figure
from rso.report.calibration.maps import fronts, sensitivity, surfaces
from rso.report.calibration.predictive_check import prediction_of
from rso.report.calibration.verdict import how, interval_rows, likely
from rso.report.canvas import (
    ACCENT,
    FITTED_LABEL,
    GREY,
    HALO,
    INK,
    LIGHT,
    NARROW_WIDTH_INCH,
    PALE,
    PAPER,
    SD_OF_90_PERCENT,
    SHADE,
    SIMULATED_LABEL,
    WARM,
    WIDTH_INCH,
    Look,
    canvas,
    grouped_as,
    short,
    style,
    svg,
    tag,
)
from rso.report.layout.digits import Unit, channel_text, clean, largest, percent, shortest, shown
from rso.report.reading import (
    BandView,
    CandidateView,
    ParameterView,
    Results,
    at_rest,
    candidates,
    compared_models,
    curve_unit,
    drawn_at,
    experiments,
    fitted_band,
    fitted_curves,
    listed,
    number,
    on_the_way,
    outputs,
    points,
    predicted_band,
    validations,
)
from rso.report.sketch import SKETCH_PICTURE, sketch_figure

SKETCH_BESIDE_WIDTH_INCH = 4.4  # inch: the sketch beside the section
_MAX_VERIFIED_ROWS = 40  # more rows than this make a figure that nobody reads; the tables hold all
_KEY_COLUMNS = 4  # of the legend above the rows of a verification


Drawing = Callable[[Results, int, str], str]


def _validation(results: Results, k: int, name: str) -> str:
    e = experiments(results, "validate")[k]
    return profile_figure(results, e, name) if is_profile(e) else validation(results, e, name)


# what stands before the hyphen of a name → results, number behind it, name → SVG
REPORT_FIGURES: Mapping[str, Drawing] = {
    SKETCH_PICTURE: lambda results, k, name: sketch_figure(
        results, SKETCH_BESIDE_WIDTH_INCH if deformed.body(results) else WIDTH_INCH
    ),
    deformed.DEFORMED_PICTURE: lambda results, k, name: deformed.deformed_figure(results, name),
    deformed.PRESSED_PICTURE: lambda results, k, name: deformed.pressed_figure(results, name),
    turning.BODY_PICTURE: lambda results, k, name: turning.body_figure(results, name),
    turning.RELIEF_PICTURE: lambda results, k, name: turning.relief_figure(results, name),
    errors.PAIRS_PICTURE: lambda results, k, name: errors.pairs_figure(results, name),
    errors.RESIDUALS_PICTURE: lambda results, k, name: errors.residuals_figure(results, name),
    errors.BUDGET_PICTURE: lambda results, k, name: errors.budget_figure(results, name),
    "formulas": closed_form_figure,
    "determined": lambda results, k, name: determined(results, name),
    "profile": lambda results, k, name: profiles(results, name),
    "descent": lambda results, k, name: gauss_newton_figure(results, name),
    "verification": lambda results, k, name: verification(results, name),
    "curve": lambda results, k, name: curves(results, fitted_curves(results)[k], name),
    "validation": _validation,
    "surface": lambda results, k, name: surfaces(results, name),
    "sensitivity": lambda results, k, name: sensitivity(results, name),
    cloud_maps.CLOUD_PICTURE: cloud_maps.cloud_figure,
    "along": along_figure,
    "shapes": lambda results, k, name: shapes_figure(results, name),
    "morris": lambda results, k, name: morris_figure(results, name),
    "front": lambda results, k, name: fronts(results, listed(results, "searches")[k], name),
}


def draw(results: Results, name: str) -> str:
    """The figure that a :class:`~rso.report.layout.document.Picture` names; ValueError for an unknown name."""
    kind, _, index = name.partition("-")
    if kind not in REPORT_FIGURES:
        raise ValueError(f"no figure {name!r}")
    with style():
        return REPORT_FIGURES[kind](results, int(index or 0), name)


def determined(results: Results, name: str) -> str:
    """One line per parameter: the range searched, what the data allow, the most likely value."""
    rows = interval_rows(results)
    figure = canvas(0.2 + 0.55 * len(rows), NARROW_WIDTH_INCH)
    axes = figure.subplots()
    for k, (p, d) in enumerate(rows):
        y = -k
        low, high = d["interval"]
        a, b = p.share(p.low, low), p.share(p.low, high)
        good = d.get("determined") is True
        axes.plot([0, 1], [y, y], color=LIGHT, lw=1.2, solid_capstyle="butt")
        for piece in allowed(results, p, d["interval"]):
            bar = [p.share(p.low, v) for v in piece]
            axes.plot(bar, [y, y], color=ACCENT if good else LIGHT, lw=7, solid_capstyle="butt")
        axes.text(-0.12, y, p.letter, ha="right", va="center", fontsize=11)
        for x, end, ha in ((-0.012, p.low, "right"), (1.012, p.high, "left")):
            axes.text(x, y, shortest(float(f"{end * p.unit.factor:.4g}")), ha=ha, va="center", color=GREY, fontsize=8)
        axes.text(1.16, y, p.unit.label, ha="left", va="center", color=GREY)
        _scale(axes, y, p)
        word = "determined" if good else how(results, p).removeprefix("is ")
        axes.text((a + b) / 2, y + 0.24, word, ha="center", va="bottom", color=ACCENT if good else INK)
        sides = ("left", "right") if b - a > 0.2 else ("right", "left")
        for x, text, ha in zip((a, b), interval_ends(low * p.unit.factor, high * p.unit.factor), sides, strict=True):
            axes.text(x, y - 0.2, text, ha=ha, va="top", fontsize=8)
        best = likely(results, p)
        if known(best):
            axes.plot([p.share(p.low, best)], [y], "o", ms=6, mfc=PAPER, mec=INK, mew=1.2)
    axes.set(xlim=(-0.17, 1.28), ylim=(-len(rows) + 0.45, 0.62))
    axes.axis("off")
    return svg(figure, name)


def _scale(axes: Axes, y: float, p: ParameterView) -> None:
    """Ticks at 1, 2 and 5 on a logarithmic range, and the words; a linear one needs neither."""
    if not (p.log and p.low > 0):
        return
    ends = [math.log10(v * p.unit.factor) for v in (p.low, p.high)]
    decades = range(math.floor(ends[0]), math.ceil(ends[1]) + 1)
    for v in (k * 10.0**n / p.unit.factor for n in decades for k in (1, 2, 5)):
        if p.low < v < p.high:
            axes.plot([p.share(p.low, v)] * 2, [y - 0.07, y + 0.07], color=GREY, lw=0.6, zorder=1)
    axes.text(1.16, y - 0.2, "log scale", ha="left", va="top", color=GREY, fontsize=7)


def verification(results: Results, name: str) -> str:
    """Predicted − recomputed of every target, in per cent, one row per candidate."""
    rows = [(c, found) for c in candidates(results) if (found := _differences(c))][:_MAX_VERIFIED_ROWS]
    views = outputs(results)
    ids = list(dict.fromkeys(i for _, found in rows for i, _, _ in found))
    figure = canvas(0.75 + 0.19 * len(rows) + 0.17 * ((len(ids) - 1) // _KEY_COLUMNS))
    axes = figure.subplots()
    axes.axvline(0, color=GREY, lw=0.8)
    for k, (c, found) in enumerate(rows):
        colour = ACCENT if c.verified else WARM
        for i, x, bar in found:
            y = -k - 0.16 * (ids.index(i) - (len(ids) - 1) / 2)
            axes.plot([x - bar, x + bar], [y, y], color=LIGHT, lw=1.6, solid_capstyle="butt", zorder=1)
            axes.plot([x], [y], "os^Dv"[ids.index(i) % 5], ms=3.6, mfc=colour if c.verified else PAPER, mec=colour)
    labels = [short(c.label) + ("" if c.verified else ", not verified") for c, _ in rows]
    ticks = axes.set_yticks([-k for k in range(len(rows))], labels)
    for tick, (c, _) in zip(ticks, rows, strict=True):
        tick.label1.set_color(INK if c.verified else WARM)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set(ylim=(-len(rows) + 0.3, 0.7), xlabel="predicted − recomputed (%)")
    _key(axes, [(short(views[i].label if i in views else clean(i), 24), "os^Dv"[n % 5]) for n, i in enumerate(ids)])
    return svg(figure, name)


def _key(axes: Axes, entries: list[tuple[str, str]]) -> None:
    handles = [axes.plot([], [], marker, ms=3.6, color=INK, ls="none")[0] for _, marker in entries]
    axes.legend(
        handles,
        [text for text, _ in entries],
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=_KEY_COLUMNS,
        frameon=False,
        fontsize=8,
        handletextpad=0.1,
        columnspacing=1.4,
        borderaxespad=0.2,
    )


def _differences(c: CandidateView) -> list[tuple[str, float, float]]:
    """(output, predicted − recomputed, two standard deviations), the numbers in per cent of the recomputed value."""
    rows = []
    for o in c.data.get("outputs") or ():
        f, y, target = (number(o.get(k)) for k in ("predicted", "recomputed", "target"))
        if f is not None and y and target is not None:
            rows.append((o["output"], 100 * (f - y) / abs(y), 200 * (number(o.get("sd")) or 0) / abs(y)))
    return rows


def curves(results: Results, e: Mapping[str, Any], name: str) -> str:
    """Measured and simulated curve with the band of the measurement, and what is left between them; a hold beside it,
    over time."""
    unit, whole = curve_unit(results, e["name"]), e.get("measured") or {}
    m = on_the_way(whole)
    u, y = (np.array(v) for v in points(m.get("depth"), m.get("value")))
    models = compared_models(results)
    simulated = [(c, *_finely(*c.curve(e["name"]), u)) for c in models if c.curve(e["name"])[0]]
    holds = [(c, c.hold(e["name"])) for c in models if c.hold(e["name"])]
    rows = [(c, *points(h.get("since"), h.get("value")), h.get("error") or ()) for c, h in holds]
    band = fitted_band(results, e)
    rest = Resting.of(whole, rows, band)
    if not len(u) and rest is not None:
        return _creep(name, e, unit, rest)
    return _curves(name, e, unit, u, y, _sigma(m, u), simulated, rest, band)


def _creep(name: str, e: Mapping[str, Any], unit: Unit, hold: Resting) -> str:
    """Depth over time at a held force."""
    figure = canvas(4.6 if hold.simulated else 3.0)
    force = shortest(float(f"{number((e.get('creep') or {}).get('held_N')) or 0.0:.3g}"))
    fine = shown(e.get("unit", ""), largest(left_of(hold)))
    draw_creep(figure, hold, unit, fine, f"{short(clean(e['name']), 60)}: held at {force} N")
    return svg(figure, name)


def _finely(x: Sequence[float], f: Sequence[float], u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A simulated curve from contact on, as fine as it is drawn and where it was measured."""
    low = min(x[0], 0.0)
    at = np.unique(np.concatenate([np.linspace(low, x[-1], N_DRAWN_HOLD_POINTS), u[(u > low) & (u < x[-1])]]))
    return at, drawn_at(x, f, at)


def _sigma(m: Mapping[str, Any], u: np.ndarray) -> np.ndarray:
    d, s = points(m.get("depth"), m.get("sigma"))
    table = dict(zip(d, s, strict=True))
    return np.array([table.get(x, 0.0) for x in u])


def _curves(
    name: str,
    e: Mapping[str, Any],
    unit: Unit,
    u: np.ndarray,
    y: np.ndarray,
    sigma: np.ndarray,
    simulated: Sequence[tuple[CandidateView, np.ndarray, np.ndarray]],
    hold: Resting | None = None,
    band: BandView | None = None,
    word: str = FITTED_LABEL,
) -> str:
    band = None if band is None or len(band.loading.depth) < 2 else band.loading
    simulated = sorted(simulated, key=lambda row: row[0].best)
    figure = canvas(3.8 if simulated else 2.6, NARROW_WIDTH_INCH if hold is None else WIDTH_INCH)
    rows, columns = 2 if simulated else 1, 1 if hold is None else 2
    heights, widths = [2.6, 1][:rows], [1.35, 1][:columns]
    grid = figure.subplots(
        rows, columns, sharex="col", sharey="row", squeeze=False, height_ratios=heights, width_ratios=widths
    )
    axes, rest = grid[0, 0], grid[1, 0] if simulated else None
    if band is None:
        axes.fill_between(u, (y - sigma) * unit.factor, (y + sigma) * unit.factor, color=LIGHT, lw=0, alpha=0.75)
    else:
        _draw_band(axes, unit, band, simulated, word)
    dots: Look = {"marker": "o", "ls": ""} if len(u) <= 60 else {"ls": "-"}
    axes.plot(u, y * unit.factor, ms=3.2, mfc=PAPER, mec=INK, mew=0.8, color=INK, label="measured", **dots)
    for c, x, f in simulated:
        axes.plot(x, f * unit.factor, label=_series_name(c, band), **_look(c, band))
    wide = " ± σ" if sigma.any() and band is None else ""
    k = int(np.argmin(np.abs(u - 0.62 * u[-1])))
    tag(axes, u[k], y[k] * unit.factor, f"measured{wide}", offset=(-12, 9), ha="right")
    others = [c for c, _, _ in simulated if not c.best]
    if band is not None:
        k = int(np.argmin(np.abs(band.depth - 0.56 * band.depth[-1])))
        at = (band.depth[k], band.value[k] * unit.factor)
        tag(axes, *at, f"{word}, with 90 % band", colour=ACCENT, offset=(12, -9), ha="left")
    for c, x, f in simulated[-1:]:
        k = int(np.argmin(np.abs(x - 0.72 * x[-1])))
        if c.best and band is None:
            tag(axes, x[k], f[k] * unit.factor, short(c.label), colour=ACCENT, offset=(12, -9), ha="left")
    if others:
        word = f"{len(others)} other candidate{'s' if len(others) > 1 else ''} (thin)"
        axes.text(0.985, 0.04, word, transform=axes.transAxes, ha="right", color=GREY)
    axes.set_ylabel(f"{short(channel_text(e.get('channel')), 20)}{unit.bracket}")
    axes.set_title(short(clean(e["name"]), 60), color=GREY)
    axes.set_xlim(min(0.0, float(u.min())) if len(u) else 0.0, None)
    fine = unit
    if rest is None:
        axes.set_xlabel("depth (mm)")
    else:
        fine = _residuals(rest, e, u, y, sigma, simulated, band)
    if hold is not None:
        draw_resting(grid[0, 1], grid[1, 1] if rest is not None else None, hold, unit, fine)
    return svg(figure, name)


def _draw_band(
    axes: Axes, unit: Unit, band: BandView, simulated: Sequence[tuple[CandidateView, np.ndarray, np.ndarray]], word: str
) -> None:
    """What readings are expected to be, and where 90 % of them lie; as fine as the simulated curve that it rests on."""
    wide = SD_OF_90_PERCENT * band.sd
    axes.fill_between(band.depth, (band.value - wide) * unit.factor, (band.value + wide) * unit.factor, **SHADE)
    x, f = band.depth, band.value
    for _, at, model in [row for row in simulated if row[0].best and band.moved.any()]:
        inside = at <= band.depth[-1] * (1 + 1e-9)
        x, f = at[inside], band.over(at[inside], model[inside])
    axes.plot(x, f * unit.factor, label=word, **BEST_CANDIDATE_LOOK)


def _look(c: CandidateView, band: BandView | None) -> Look:
    return OTHER_CANDIDATE_LOOK if not c.best else BEST_CANDIDATE_LOOK if band is None else UNFITTED_BEST_LOOK


def _series_name(c: CandidateView, band: BandView | None = None) -> str:
    """The name of a curve for whoever points at it; all but the fitted model are shown or hidden together."""
    if not c.best:
        return f"{c.label}{grouped_as('other candidates')}"
    return c.label if band is None else SIMULATED_LABEL


def _residuals(
    axes: Axes,
    e: Mapping[str, Any],
    u: np.ndarray,
    y: np.ndarray,
    sigma: np.ndarray,
    simulated: Sequence[tuple[CandidateView, np.ndarray, np.ndarray]],
    band: BandView | None = None,
) -> Unit:
    """What is left along the depth, in the unit that is returned."""
    left = []
    for c, x, f in simulated:
        inside = ((u > 0) | (x[0] < 0)) & (u >= x[0]) & (u <= x[-1] * (1 + 1e-9))
        left.append((c, u[inside], y[inside] - np.interp(u[inside], x, f)))
    unit = shown(e.get("unit", ""), largest([float(v) for _, _, r in left for v in r]))
    if band is None:
        axes.fill_between(u, -sigma * unit.factor, sigma * unit.factor, color=LIGHT, lw=0, alpha=0.75)
    else:
        wide = SD_OF_90_PERCENT * band.sd * unit.factor
        axes.fill_between(band.depth, -wide, wide, **SHADE)
        inside = (u >= band.depth[0]) & (u <= band.depth[-1] * (1 + 1e-9))
        r = y[inside] - np.interp(u[inside], band.depth, band.value)
        axes.plot(u[inside], r * unit.factor, label=FITTED_LABEL, **BEST_CANDIDATE_LOOK)
    axes.axhline(0, color=INK, lw=0.7)
    for c, x, r in left:
        axes.plot(x, r * unit.factor, label=_series_name(c, band), **_look(c, band))
        if c.best and band is None:
            d, error = c.error(e["name"])
            if d:
                wide = np.interp(x, d, error)
                axes.fill_between(x, (r - wide) * unit.factor, (r + wide) * unit.factor, color=ACCENT, alpha=0.25, lw=0)
    axes.set(xlabel="depth (mm)", ylabel=f"measured −\n{'simulated' if band is None else 'curve'}{unit.bracket}")
    axes.yaxis.set_major_locator(MaxNLocator(5))
    return unit


def validation(results: Results, e: Mapping[str, Any], name: str) -> str:
    """Predictions of an experiment that was not used: a curve, or rows of dots where it is a single point."""
    unit = curve_unit(results, e["name"])
    rows = [v for v in validations(results, e) if v.get("predicted")]
    known_candidates = {(c.search, c.name): c for c in candidates(results)}
    found, holds = [], []
    for v in rows:
        c = known_candidates.get((clean(v.get("search")), clean(v.get("candidate"))))
        way, hold = on_the_way(v), at_rest(v)
        x, f = points(way.get("depth"), way.get("predicted"))
        if c is not None and (x or hold):
            if x:
                found.append((c, np.array(x), np.array(f)))
            times = points(hold.get("since"), hold.get("predicted"))
            holds.append((c, *times, hold.get("numerical_error") or ()))
    whole = e.get("measured") or {}
    m = on_the_way(whole)
    u, y = map(np.array, points(m.get("depth"), m.get("value")))
    band = predicted_band(e, prediction_of(results, e))
    if band is not None:
        found, holds = ([(replace(c, best=False), *row) for c, *row in rows] for rows in (found, holds))
    rest = Resting.of(whole, holds, band)
    if not len(u) and rest is not None:
        return _creep(name, e, unit, rest)
    if len(u) > 1:
        return _curves(name, e, unit, u, y, _sigma(m, u), found, rest, band, "predicted")
    rows_of_dots = [(c, float(f[-1])) for c, _, f in found]
    if (likely_one := _most_likely(results, e)) is not None:
        rows_of_dots = [likely_one, *((replace(c, best=False), f) for c, f in rows_of_dots)]
    return _dots(name, e, unit, float(y[0]), float(_sigma(m, u)[0]), rows_of_dots)


def _most_likely(results: Results, e: Mapping[str, Any]) -> tuple[CandidateView, float] | None:
    """What the most likely values predict of a test of one reading; None where nothing does."""
    v = prediction_of(results, e) or {}
    mine = [c for c in v.get("channels") or () if c.get("channel") == e.get("channel")]
    if not mine or not known((mine[0].get("predicted") or [None])[-1]):
        return None
    return CandidateView("", "most likely", 0, True, {}), float(mine[0]["predicted"][-1])


def _dots(
    name: str, e: Mapping[str, Any], unit: Unit, y: float, sigma: float, rows: list[tuple[CandidateView, float]]
) -> str:
    rows = rows[:_MAX_VERIFIED_ROWS]
    figure = canvas(0.85 + 0.19 * len(rows), NARROW_WIDTH_INCH)
    axes = figure.subplots()
    for k, alpha in ((2, 0.35), (1, 0.6)):
        axes.axvspan((y - k * sigma) * unit.factor, (y + k * sigma) * unit.factor, color=LIGHT, lw=0, alpha=alpha)
    axes.axvline(y * unit.factor, color=INK, lw=1)
    for k, (c, f) in enumerate(rows):
        axes.plot([y * unit.factor, f * unit.factor], [-k, -k], color=PALE, lw=1.2, zorder=0)
        size, colour = (5.0, ACCENT) if c.best else (4.0, GREY)
        axes.plot([f * unit.factor], [-k], "o", label=c.label, ms=size, color=colour)
        text = f"{percent(abs(f - y) / abs(y))} too {'high' if f > y else 'low'}" if y and f != y else ""
        axes.annotate(
            text,
            (f * unit.factor, -k),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            color=ACCENT if c.best else INK,
            path_effects=HALO,
        )
    axes.set_yticks([-k for k in range(len(rows))], [short(c.label) for c, _ in rows])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.margins(x=0.12)
    axes.set(ylim=(-len(rows) + 0.3, 0.7), xlabel=f"{short(channel_text(e.get('channel')), 20)}{unit.bracket}")
    words = f"measured{' ± σ, ± 2σ' if sigma else ''}"
    axes.annotate(
        words,
        (y * unit.factor, 1),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
    )
    return svg(figure, name)
