"""The document's section on what the curves determine: intervals by three methods, directions, further tests."""

from __future__ import annotations

import re
from collections.abc import Mapping
from statistics import NormalDist
from typing import Any

import numpy as np

from rso.core.digits import DASH, known, significant
from rso.inference.intervals import pieces
from rso.report.calibration.cloud_maps import cloud_blocks
from rso.report.calibration.derived import derived_table
from rso.report.calibration.errors import error_blocks
from rso.report.calibration.inputs import input_blocks
from rso.report.canvas import ACCENT, NARROW_WIDTH_INCH, WARM, WIDTH_INCH, canvas, parameter_axis, svg
from rso.report.layout.digits import aligned, between, channel_text, clean, percent, sentence, shortest
from rso.report.layout.document import Block, Cell, Mark, Picture, Section, Table, Text, column, missing, table, words
from rso.report.reading import ParameterView, Results, lettered, number, pair, parameters, points

_DETERMINED_WORDS: dict[str, tuple[str, Mark]] = {
    "determined": ("determined", "good"),
    "weakly": ("weakly", "warn"),
    "not": ("not determined", "warn"),
}
_INTERVAL_METHODS = (("interval", "profile"), ("laplace", "Gaussian"), ("mcmc", "MCMC"))
_MAX_PROFILE_PANELS = 4  # parameters; the table holds all


def identification_section(results: Results) -> Section:
    """Section 3: how well every parameter is determined by the measured curves, and what would determine it better."""
    title, data = "What the curves determine", results.get("identification")
    if not data:
        return Section("identification", title, (missing("Likelihood and intervals", "verify"),))
    rows = identified(results)
    blocks: list[Block] = [Text(_fit(data))]
    blocks.append(_intervals(results, data, rows))
    if (quantities := derived_table(results)) is not None:
        blocks.append(quantities)
    blocks += input_blocks(results)
    for p, d in rows:
        if d.get("reason"):
            blocks.append(Text(f"{p.letter}: {lettered(results, d['reason'])}"))
    blocks += cloud_blocks(results)
    blocks += error_blocks(results)
    blocks += [t for t in (_directions(results, data), _values(results, data)) if t is not None]
    return Section("identification", title, tuple(blocks))


def open_blocks(results: Results) -> tuple[Block, ...]:
    """The profiles of the misfit, and what one more test would add."""
    data = results.get("identification") or {}
    blocks: list[Block] = [Picture("profile", _caption(data))] if profiled(results) else []
    gains = _gains(results, data)
    return (*blocks, *((gains,) if gains is not None else ()))


def identified(results: Results) -> list[tuple[ParameterView, Mapping[str, Any]]]:
    """Open parameters with what the identification says of them."""
    data = (results.get("identification") or {}).get("parameters") or ()
    by_name = {clean(d.get("parameter")): d for d in data}
    return [(p, by_name[p.name]) for p in parameters(results, free=True) if p.name in by_name]


def allowed(results: Results, p: ParameterView, interval: Any) -> list[tuple[float, float]]:
    """What the data allow a parameter, in its base unit: the pieces of its profile; of one piece, its `interval`."""
    d = dict((q.name, d) for q, d in identified(results)).get(p.name) or {}
    whole = [(interval[0], interval[1])] if pair(interval) else []
    level, profile = number((results.get("identification") or {}).get("level")), d.get("profile") or {}
    at, rise = (np.array(v) for v in points(profile.get("values"), profile.get("rise")))
    if level is None or not 0 < level < 1 or len(at) < 2 or (p.log and at.min() <= 0):
        return whole
    found = pieces(np.log(at) if p.log else at, rise, level)
    if len(found) == 1:
        return whole
    return [(float(np.exp(a)), float(np.exp(b))) if p.log else (a, b) for a, b in found]


def spans(results: Results, p: ParameterView, interval: Any) -> str:
    """The same in words."""
    return " or ".join(between(low, high, p.unit) for low, high in allowed(results, p, interval)) or DASH


def profiled(results: Results) -> list[tuple[ParameterView, Mapping[str, Any]]]:
    """Those of which a profile can be drawn."""
    found = []
    for p, d in identified(results)[:_MAX_PROFILE_PANELS]:
        profile = d.get("profile") or {}
        if len(points(profile.get("values"), profile.get("rise"))[0]) > 1:
            found.append((p, profile))
    return found


def _fit(data: Mapping[str, Any]) -> str:
    said = [sentence(data.get("story"))]
    numbers = [f"{shortest(data['degrees'])} degrees of freedom"] if _unsaid(said[0], data.get("degrees")) else []
    numbers += [f"p = {significant(data['p_value'], 3)}"] if known(data.get("p_value")) else []
    wider = (number(data.get("scale")) or 1.0) > 1.0 and "errors count" not in said[0]
    numbers += [f"errors × {significant(data['scale'], 3)}"] if wider else []
    said += [f"{', '.join(numbers)}."] if numbers else []
    again = data.get("recomputed") or {}
    if known(again.get("agreement")) and again.get("chi2") is None:
        said.append("The most likely curve is that of a run by exact similarity.")
    elif known(again.get("agreement")):
        said.append(
            f"Recomputed with the full model, the most likely curve is off by {percent(again['agreement'])} of its "
            f"largest value{'' if again.get('verified') else ', more than it may be'}, "
            f"and its χ² is {significant(again.get('chi2'), 3)}."
        )
    curves = [
        f"{channel_text(d.get('channel'))} of {clean(d.get('experiment'))} ({shortest(d.get('points'))} points)"
        for d in data.get("data") or ()
    ]
    said += [f"Data: {', '.join(curves)}."] if curves else []
    m = data.get("mcmc") or {}
    if known(m.get("draws")):
        said.append(
            f"Posterior on a grid: {m['draws']} draws, effective sample size {significant(m.get('independent'), 3)}."
            if m.get("method") == "cells"
            else f"MCMC: {m['draws']} draws, autocorrelation time {significant(m.get('tau'), 2)} steps, effective "
            f"sample size {significant(m.get('independent'), 3)}"
            f"{'' if m.get('converged', True) else '; it has not converged, its intervals are not given'}."
        )
    return " ".join(said)


def _unsaid(story: str, x: object) -> bool:
    return known(x) and not re.search(rf"\b{shortest(x)}\b", story)


def _caption(data: Mapping[str, Any]) -> str:
    level = percent(number(data.get("level")))
    return (
        "How much worse the best fit becomes when one parameter is held and the others follow. "
        f"What lies below the dashed line is the {level} interval."
    )


def _intervals(results: Results, data: Mapping[str, Any], rows: list[tuple[ParameterView, Mapping[str, Any]]]) -> Table:
    value = [
        significant(d["value"] * p.unit.factor, d["digits"]) if known(d.get("value")) and d.get("digits") else DASH
        for p, d in rows
    ]
    columns = [
        column("", words([p.letter for p, _ in rows]), number=False),
        column("", words([p.unit.label for p, _ in rows]), number=False),
        column("most likely", words(value)),
        column("± sd", words([percent(number(d.get("sd_log"))) for _, d in rows])),
    ]
    level = percent(number(data.get("level")))
    for key, label in _INTERVAL_METHODS:
        said = []
        for p, d in rows:
            low, high = d.get(key) or (None, None)
            text = spans(results, p, (low, high)) if key == "interval" else between(low, high, p.unit)
            said.append(text.replace(p.unit.after, "") if p.unit.after else text)
        columns.append(column(label, words(said), level))
    if any(pair(d.get("as_stated")) for _, d in rows):
        stated = [(p, d.get("as_stated") or (None, None)) for p, d in rows]
        said = [between(low, high, p.unit) for p, (low, high) in stated]
        said = [t.replace(p.unit.after, "") if p.unit.after else t for t, (p, _) in zip(said, rows, strict=True)]
        columns.insert(5, column("profile, as stated", words(said), level))
    need = [f"× {significant(d['noise_factor'], 2)}" if known(d.get("noise_factor")) else DASH for _, d in rows]
    columns.append(column("noise needed", words(need)))
    state = [_DETERMINED_WORDS.get(str(d.get("verdict")), (clean(d.get("verdict")) or DASH, "")) for _, d in rows]
    columns.append(column("", tuple(Cell(t, mark=m) for t, m in state), number=False))
    apart = [p.letter for p, d in rows if d.get("agreement") is False]
    note = "± sd is that of the logarithm, from the curvature of the misfit; a value has the digits that are known. "
    note += "Profile: likelihood ratio; Gaussian: that curvature inside the range; MCMC: flat prior in the range."
    if any(pair(d.get("as_stated")) for _, d in rows):
        note += " As stated: without usual errors of a test that nobody has stated, which all others hold."
    note += f" Gaussian and MCMC differ by more than 15 % of their width for {', '.join(apart)}." if apart else ""
    return table("Parameters", columns, note)


def _directions(results: Results, data: Mapping[str, Any]) -> Table | None:
    rows = list(data.get("directions") or ())
    if not rows:
        return None
    columns = [
        column(p.letter, aligned([number((d.get("change") or {}).get(p.name)) for d in rows], 3, plus=True))
        for p in parameters(results, free=True)
    ]
    columns.append(column("known to", words([_factor(number(d.get("sd"))) for d in rows])))
    note = "Each row is a product of powers of the parameters (exponents), the best known first."
    return table("Stiff and sloppy combinations", columns, note)


def _factor(sd: float | None) -> str:
    if sd is None:
        return "not at all"
    return f"± {percent(sd)}" if sd < 0.3 else f"a factor {significant(float(np.exp(min(sd, 30.0))), 3)}"


def _gains(results: Results, data: Mapping[str, Any]) -> Table | None:
    rows = list(data.get("gains") or ())
    if not rows:
        return None
    columns = [column("One more test", words([clean(g.get("test")) for g in rows]), number=False)]
    for p in parameters(results, free=True):
        for key in ("before", "after"):
            cells = [percent(number((g.get(key) or {}).get(p.name))) for g in rows]
            columns.append(column(f"sd ln {p.letter}", words(cells), key))
    note = "Expected from the slopes of the curve; the range counts as a weak prior."
    if data.get("inputs"):
        note += " Stated dimensions count as exact here: a further test of the same specimen shows them no better."
    return table("What would help", columns, note)


def _values(results: Results, data: Mapping[str, Any]) -> Table | None:
    """Most likely values, other minima, other weightings, and the minima of every metric, side by side."""
    rows: list[tuple[str, Mapping[str, Any], float | None]] = []
    rows.append(("most likely", data.get("values") or {}, number(data.get("chi2"))))
    rows += [
        ("another minimum of χ²", m.get("values") or {}, number(m.get("chi2"))) for m in data.get("other_minima") or ()
    ]
    rows += [
        (f"errors: {clean(w.get('weighting'))}", w.get("values") or {}, None) for w in data.get("weightings") or ()
    ]
    for m in data.get("metrics") or ():
        label = f"smallest {clean(m.get('metric')).upper()}"
        for k, one in enumerate(m.get("minima") or ()):
            rows.append(
                (label if not k else f"{label}, minimum {k + 1}", one.get("values") or {}, number(one.get("value")))
            )
    if len(rows) < 2:
        return None
    columns = [column("", words([label for label, _, _ in rows]), number=False)]
    for p in parameters(results, free=True):
        values = [number(v.get(p.name)) for _, v, _ in rows]
        columns.append(
            column(p.letter, aligned([None if x is None else x * p.unit.factor for x in values]), p.unit.label)
        )
    columns.append(column("χ² or metric", words([significant(x, 3) for _, _, x in rows])))
    note = "All on the response surface. Errors in proportion to the value, or all equal, weigh the curve differently."
    return table("The same curves weighed differently", columns, note)


def profiles(results: Results, name: str) -> str:
    """Profile of the misfit along each parameter."""
    found = profiled(results)
    figure = canvas(1.9, NARROW_WIDTH_INCH if len(found) < 3 else WIDTH_INCH)
    grid = figure.subplots(1, len(found), squeeze=False, sharey="row")
    level = number((results.get("identification") or {}).get("level")) or 0.9
    limit = NormalDist().inv_cdf(0.5 * (1 + min(level, 0.9999))) ** 2
    for k, (p, profile) in enumerate(found):
        x, rise = (np.array(v) for v in points(profile.get("values"), profile.get("rise")))
        axes = grid[0, k]
        axes.plot(x * p.unit.factor, rise, color=ACCENT, label="χ² − least χ²")
        axes.axhline(limit, color=WARM, lw=0.8, ls="--")
        axes.set_ylim(0, max(4 * limit, 1.0))
        parameter_axis(axes, "x", p)
        if not k:
            axes.set_ylabel("χ² − least χ²")
            where = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
            axes.annotate(percent(level), (0, limit), xytext=(3, 2), color=WARM, fontsize=8, **where)
    return svg(figure, name)
