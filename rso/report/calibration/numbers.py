"""The results dictionary as a document: tables, captions, sentences.  Pure: no simulation, no fit, no markup."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rso.core.digits import DASH, NBSP, known
from rso.report.calibration.background import provenance, runs
from rso.report.calibration.closed_forms import closed_form_sections
from rso.report.calibration.deformed import moved_sentence
from rso.report.calibration.displacements import is_profile, profile_blocks
from rso.report.calibration.gap import gap_sections
from rso.report.calibration.gauss_newton import gauss_newton_section, gauss_newton_starts
from rso.report.calibration.identification import identification_section, open_blocks
from rso.report.calibration.influence import extrapolation
from rso.report.calibration.predictions import off, prediction_sentences, predictions
from rso.report.calibration.range_extension import range_blocks
from rso.report.calibration.responses import front_section, sensitivity_section, surface_section
from rso.report.calibration.turning import turning_sections
from rso.report.calibration.use import use_section
from rso.report.calibration.verdict import (
    determined_blocks,
    fit_sentences,
    found_sentences,
    known_sentences,
    verdict,
)
from rso.report.layout.byline import byline
from rso.report.layout.digits import Unit, aligned, clean, largest, percent, quantity, shortest, shown, signed
from rso.report.layout.document import (
    Block,
    Cell,
    Mark,
    Picture,
    Report,
    Section,
    Table,
    Text,
    column,
    missing,
    table,
    words,
)
from rso.report.notes import opening
from rso.report.reading import (
    CandidateView,
    Results,
    at_rest,
    best_candidate,
    candidates,
    compared_models,
    curve_unit,
    drawn_at,
    experiment,
    experiments,
    fitted_band,
    fitted_curves,
    fitted_model,
    lettered,
    listed,
    number,
    on_the_way,
    outputs,
    parameters,
    points,
    target_output,
    validations,
)

MAX_NOTES_CHARACTERS = 500  # characters of what a file says of itself beside its curve
MAX_OPEN_TABLE_ROWS = 3  # rows of a table that the main page has room for
# per cent between a prediction and its simulation that nobody needs to know better
NEGLIGIBLE_DIFFERENCE_PERCENT = 0.01
_METRIC_COLUMNS = (("NRMSE", "nrmse", ""), ("MRE", "mre", ""), ("MAPE", "mape", "%"), ("RRMSE", "rrmse", ""))

_MINIMA_KINDS = {
    "valley": "a valley",
    "islands": "separate solutions",
    "front": "a front of compromises",
    "single": "one solution",
}


def report(results: Results) -> Report:
    """The whole document from the documented layout of results.json; what is missing is said to be missing."""
    study = results.get("study") or {}
    fitted, chosen = (
        ", ".join(clean(e["name"]) for e in fitted_curves(results) if e.get("role") == role)
        for role in ("fit", "select")
    )
    return Report(
        clean(study.get("title")) or "Untitled study",
        (f"Parameters identified from {fitted}" if fitted else "") + (f", chosen with {chosen} too" if chosen else ""),
        byline(results),
        tuple(section for make in REPORT_SECTIONS for section in make(results)),
    )


def candidate_section(results: Results) -> Section:
    """Every candidate against the run that recomputed it, one table per search."""
    blocks: list[Block] = [Text(t) for t in found_sentences(results)]
    if any(known(o.get("recomputed")) for c in candidates(results) for o in c.data.get("outputs") or ()):
        blocks.append(Picture("verification", _verification_caption(results)))
    for s in listed(results, "searches"):
        chosen = [c for c in candidates(results) if c.search == clean(s["name"])]
        if chosen:
            blocks.append(_candidate_table(results, s, chosen))
        if s is listed(results, "searches")[0]:
            blocks += range_blocks(results)
    title = "Candidates against their own simulations"
    return Section(
        "candidates", title, tuple(blocks) if candidates(results) else (*blocks, missing("Candidates", "search"))
    )


def _verification_caption(results: Results) -> str:
    done = [c for c in candidates(results) if known(c.data.get("agreement"))]
    agree = [c.data["agreement"] for c in done]
    low, high = percent(min(agree)), percent(max(agree))
    span = low if low == high else f"{low} to {high}"
    return (
        f"For {len(done)} recomputed candidates the prediction of the worst target is off by {span}. "
        "Each mark is one target, bars are two standard deviations of the prediction."
    )


def _candidate_table(results: Results, s: Mapping[str, Any], chosen: list[CandidateView]) -> Table:
    known_outputs = outputs(results)
    rows = [(c, o) for c in chosen for o in c.data.get("outputs") or () if known(o.get("target"))]
    rows = rows or [(c, {}) for c in chosen]
    first = [k == 0 or rows[k - 1][0] is not c for k, (c, _) in enumerate(rows)]
    units = {o["output"]: known_outputs[o["output"]].unit for _, o in rows if o.get("output") in known_outputs}
    unit = next(iter(units.values()), Unit(""))
    predicted, recomputed, target = ([number(o.get(k)) for _, o in rows] for k in ("predicted", "recomputed", "target"))
    asked = {target_output(t): number(t.get("sigma")) for t in s.get("targets") or ()}
    sigma = [asked.get(o.get("output", "")) for _, o in rows]
    gap = [None if a is None or b is None else a - b for a, b in zip(predicted, recomputed, strict=True)]
    relative = [None if d is None or not b else 100 * d / abs(b) for d, b in zip(gap, recomputed, strict=True)]
    names = tuple(Cell(c.name, mark="strong" if c.best else "") if f else Cell("") for f, (c, _) in _zip(first, rows))
    columns = [column("", names, number=False)]
    for p in parameters(results, free=True):
        values = [c.value(p.name) for c, _ in rows]
        cells = aligned([None if v is None else v * p.unit.factor for v in values])
        kept = tuple(cell if f else Cell("") for f, cell in _zip(first, cells))
        columns.append(column(p.letter, kept, p.unit.label))
    labels = [known_outputs[o["output"]].label if o.get("output") in known_outputs else DASH for _, o in rows]
    columns += [
        column("Target", words(labels), number=False),
        column("wanted", _scaled(target, unit), unit.label),
        column("± σ", aligned([s and s * unit.factor for s in sigma], 3), unit.label),
        column("recomputed", _scaled(recomputed, unit), unit.label),
        column("off the prediction", words([_off(r) for r in relative])),
        column("", tuple(_state(c) if f else Cell("") for f, (c, _) in _zip(first, rows)), number=False),
    ]
    return table(_search_title(s), columns, _search_note(results, s, chosen))


def _off(relative: float | None) -> str:
    """How far a prediction was from what came out, in per cent; where that is nothing, it is only said to be so."""
    if relative is None:
        return DASH
    return (
        f"<{NBSP}{NEGLIGIBLE_DIFFERENCE_PERCENT}{NBSP}%"
        if abs(relative) < NEGLIGIBLE_DIFFERENCE_PERCENT
        else signed(relative, percent(relative / 100))
    )


def _zip(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return zip(a, b, strict=True)


def _scaled(values: Sequence[float | None], unit: Unit, digits: int = 4) -> tuple[Cell, ...]:
    return aligned([None if v is None else v * unit.factor for v in values], digits)


def _state(c: CandidateView) -> Cell:
    state = clean(c.data.get("state"))
    if c.verified:
        met = c.data.get("meets") is not False  # results of an older program do not say
        return Cell("verified", mark="good") if met else Cell("verified, but misses what is asked", mark="warn")
    if state == "done":
        return Cell("not verified", mark="warn")
    return Cell(state or DASH, mark="bad" if state in ("failed", "crashed") else "quiet")


def _search_title(s: Mapping[str, Any]) -> str:
    kind = clean(s.get("kind"))
    return f"Search {clean(s['name'])}" + (f": {_MINIMA_KINDS.get(kind, kind)}" if kind else "")


def _search_note(results: Results, s: Mapping[str, Any], chosen: list[CandidateView]) -> str:
    said = []
    ranges = s.get("ranges") or {}
    each = []
    for p in parameters(results, free=True):
        ends = ranges.get(p.name) or ()
        if len(ends) == 2 and all(map(known, ends)):
            a, b = (shortest(float(f"{x * p.unit.factor:.4g}")) for x in ends)
            each.append(f"{p.letter} {a} to {b}{p.unit.after}")
    if each:
        said.append(f"Searched: {', '.join(each)}.")
    if s.get("story"):
        said.append(lettered(results, s["story"]))
    if s.get("infill"):
        said.append(f"{s['infill']} run{'s' if s['infill'] > 1 else ''} added until predicted = recomputed.")
    every = [o for c in chosen for o in c.data.get("outputs") or () if known(o.get("target")) and o.get("recomputed")]
    error = largest([o["numerical_error"] / o["recomputed"] for o in every if known(o.get("numerical_error"))])
    if error:
        said.append(f"Estimated numerical error of the recomputed values: up to {percent(error)}.")
    letters = {p.name: p.letter for p in parameters(results)}
    bound = [(c.name, letters.get(k, clean(k))) for c in chosen for k in c.data.get("at_bound") or ()]
    said += [f"Candidate {name} lies on a bound of {k}." for name, k in bound]
    said.append(extrapolation([c.name for c in chosen if c.data.get("extrapolated") is True], len(chosen)))
    return " ".join(filter(None, said))


def curve_section(results: Results) -> Section:
    """Measured and simulated curves with error metrics."""
    blocks: list[Block] = [Text(t) for t in fit_sentences(results)]
    for k, e in enumerate(fitted_curves(results)):
        if points((e.get("measured") or {}).get("depth"), (e.get("measured") or {}).get("value"))[0]:
            blocks.append(Picture(f"curve-{k}", curve_caption(results, e)))
        if e.get("notes"):
            blocks.append(
                Text(f"{clean(e.get('file') or e['name'])}: {opening(e['notes'], MAX_NOTES_CHARACTERS)}", "note")
            )
        rows = metric_rows(results, e["name"])
        if rows:
            blocks.append(_metric_table(results, e, rows))
    if not any(isinstance(b, Picture) for b in blocks):
        blocks.append(Text("No experiment has been read.", "missing"))
    elif not any(isinstance(b, Table) for b in blocks):
        blocks.append(missing("Recomputed curves and their errors", "verify"))
    return Section("curves", "Measured and simulated", tuple(blocks))


def prediction_section(results: Results) -> Section:
    """Whether tests are predicted that were not used."""
    said = [Text(t) for t in prediction_sentences(results)]
    return Section("prediction", "Does it predict?", (*said, *_validation_blocks(results)))


def open_section(results: Results) -> Section:
    """What the data leave open, and what would decide it."""
    said = [Text(t) for t in known_sentences(results)]
    return Section(
        "open", "What is known, and what is not", (*said, *determined_blocks(results), *open_blocks(results))
    )


def curve_caption(results: Results, e: Mapping[str, Any]) -> str:
    """What the curves show: how far the best candidate is from the measurement, and where most."""
    whole, unit, best = e.get("measured") or {}, curve_unit(results, e["name"]), fitted_model(results)
    name, m = clean(e["name"]), on_the_way(whole)
    u, y = points(m.get("depth"), m.get("value"))
    x, f = best.curve(e["name"]) if best else ((), ())
    if best is not None and not u:
        return f"{name}: depth over time at a held force.{_hold_caption(whole, best.hold(e['name']), e['unit'])}"
    if best is None or not x:
        return f"{name}: {len(u)} measured points; no recomputed candidate yet."
    reached = [(a, b) for a, b in zip(u, y, strict=True) if min(x[0], 0) < a <= x[-1] * (1 + 1e-9) or a == x[0]]
    if not reached:
        return f"{name}: {len(u)} measured points; {best.label} ends before the first of them."
    band = fitted_band(results, e)
    band = None if band is None or len(band.loading.depth) < 2 else band
    if band is None:
        predicted = drawn_at(x, f, np.array([min(a, x[-1]) for a, _ in reached]))
    else:
        predicted = np.interp([a for a, _ in reached], band.loading.depth, band.loading.value)
    inside = [(a, b, float(c)) for (a, b), c in zip(reached, predicted, strict=True)]
    a, b, c = max(inside, key=lambda row: abs(row[2] - row[1]))
    label = best.label if band is None else "the fitted curve"
    text = f"{name}: {label} deviates from the measurement by at most {quantity(abs(c - b), e['unit'], 2)}"
    text += f" (at {shortest(a)} mm, where {quantity(b, e['unit'], 3, 1 / unit.factor)} was measured)."
    text += _hold_caption(whole, best.hold(e["name"]), e["unit"])
    if band is not None:
        said = moved_sentence(band)
        text += f" {said} Dashed: the simulation without that." if said else " Dashed: the simulated curve."
        return f"{text} Blue band: 90 % of such readings are expected in it."
    if points(m.get("depth"), m.get("sigma"))[0]:
        text += " Grey band: ±σ of the measurement, whose errors may go up and down together over some depth."
    if not best.search:
        text += " The most likely curve may run beside the readings: an error that moves all of them counts once."
    if any(best.error(e["name"])[1]):
        text += " Blue band of the residual: estimated numerical error of the simulation."
    return text


def _hold_caption(measured: Mapping[str, Any], hold: Mapping[str, Any], unit: str) -> str:
    """How far a candidate is from the measurement in a hold; empty without one."""
    m = at_rest(measured)
    t, y = points(m.get("since"), m.get("value"))
    found = dict(zip(*points(hold.get("since"), hold.get("value")), strict=True))
    both = [(abs(found[s] - v), s) for s, v in zip(t, y, strict=True) if s in found]
    if not both:
        return ""
    off, at = max(both)
    where = "In the hold, right," if on_the_way(measured).get("depth") else "The simulation is off"
    return f" {where} at most by {quantity(off, unit, 2)}, {shortest(float(f'{at:.2g}'))} s after it began."


def metric_rows(results: Results, name: str) -> list[tuple[str, Mark, Mapping[str, Any]]]:
    """(model, kind, metrics) for every candidate, the baseline and the mean over the runs."""
    rows: list[tuple[str, Mark, Mapping[str, Any]]] = [
        (c.label, "strong" if c.best else "", c.metrics(name)) for c in compared_models(results) if c.metrics(name)
    ]
    band = fitted_band(results, experiment(results, name))
    if band is not None and band.moved.any() and band.data.get("metrics"):
        rows = [(label, "" if mark == "strong" else mark, m) for label, mark, m in rows]
        rows.insert(0, ("fitted, with contact and gain", "strong", band.data["metrics"]))
    for key, label in (("baseline", "mean of the measured curve"), ("mean_over_runs", "mean over all design runs")):
        if (results.get(key) or {}).get(name):
            rows.append((label, "quiet", results[key][name]))
    return rows


def _metric_table(results: Results, e: Mapping[str, Any], rows: list[tuple[str, Mark, Mapping[str, Any]]]) -> Table:
    unit = shown(e.get("unit", ""), min((r for _, _, m in rows if (r := number(m.get("rmse")))), default=None))
    names = tuple(Cell(label, mark=kind) for label, kind, _ in rows)
    columns = [
        column("Model", names, number=False),
        column("RMSE", _scaled([number(m.get("rmse")) for _, _, m in rows], unit, 3), unit.label),
    ]
    for title, key, label in _METRIC_COLUMNS:
        columns.append(column(title, aligned([number(m.get(key)) for _, _, m in rows], 3), label))
    used = rows[0][2]
    note = (
        f"Over {used['n']} points; excluded from the relative norms, because too close to zero: "
        f"{used.get('excluded') or 0}. NRMSE = RMSE / mean(y), MRE = mean(|Δ/y|), MAPE = 100 MRE, "
        "RRMSE = √mean((Δ/y)²)."
        if known(used.get("n"))
        else ""
    )
    return table(f"Errors against {clean(e['name'])}", columns, note, folded=len(rows) > MAX_OPEN_TABLE_ROWS)


def _validation_blocks(results: Results) -> list[Block]:
    planned = experiments(results, "validate")
    if not planned:
        return [Text("This study keeps no test for validation: whether it predicts one is not known.", "missing")]
    rows = listed(results, "validation")
    if not rows:
        return [missing("Predictions of the validation experiments", "validate")]
    blocks: list[Block] = []
    for k, e in enumerate(planned):
        mine = validations(results, e)
        if not mine:
            continue
        if is_profile(e):
            blocks += profile_blocks(results, e, f"validation-{k}")
            continue
        m = e.get("measured") or {}
        drawn = any(points(v.get("depth"), v.get("predicted"))[0] for v in mine)
        if drawn and points(m.get("depth"), m.get("value"))[0]:
            blocks.append(Picture(f"validation-{k}", _validation_caption(results, e)))
        blocks.append(_validation_table(results, e, mine))
    return blocks


def _validation_caption(results: Results, e: Mapping[str, Any]) -> str:
    found = predictions(results, e)
    said = f": {off(found)}" if found else ""
    return f"Unused test: {clean(e['name'])}, which was not used for the fit{said}."


def _validation_table(results: Results, e: Mapping[str, Any], rows: list[Mapping[str, Any]]) -> Table:
    best, unit = best_candidate(results), curve_unit(results, e["name"])
    last = {k: [number((v.get(k) or [None])[-1]) for v in rows] for k in ("depth", "measured", "sigma", "predicted")}
    gap = [None if f is None or not y else 100 * (y - f) / abs(y) for f, y in _zip(last["predicted"], last["measured"])]
    named = None if best is None else (best.search, best.name)
    marks = [(v.get("search"), v.get("candidate")) == named for v in rows]
    label = {(c.search, c.name): c.label for c in candidates(results)}
    names = [label.get((clean(v.get("search")), clean(v.get("candidate"))), clean(v.get("candidate"))) for v in rows]
    state = [
        Cell("done")
        if v.get("state") == "done"
        else Cell(f"{clean(v.get('state'))}: {clean(v.get('cause'))}", mark="bad")
        for v in rows
    ]
    columns = [
        column("Candidate", tuple(Cell(n, mark="strong" if m else "") for n, m in _zip(names, marks)), number=False),
        column("depth", aligned(last["depth"], 2), "mm"),
        column("measured", _scaled(last["measured"], unit), unit.label),
        column("± σ", aligned([None if s is None else s * unit.factor for s in last["sigma"]], 2), unit.label),
        column("predicted", _scaled(last["predicted"], unit), unit.label),
        column("measured − predicted", aligned(gap, 3, plus=True), "%"),
    ]
    columns.append(column("NRMSE", aligned([number((v.get("metrics") or {}).get("nrmse")) for v in rows], 3)))
    columns.append(column("", tuple(state), number=False))
    reasons = [f"{n}: {clean(v['reason'])}." for n, v in _zip(names, rows) if v.get("reason")]
    many = any(len(v.get("depth") or ()) > 1 for v in rows)
    last_one = "at the end of the hold" if any((v.get("since") or [0.0])[-1] for v in rows) else "at the last depth"
    note = (f"Values are those {last_one}. " if many else "") + " ".join(reasons)
    return table(f"Unused test {clean(e['name'])}", columns, note, folded=len(rows) > MAX_OPEN_TABLE_ROWS)


def _how_found(results: Results) -> tuple[Section, ...]:
    """Response surfaces and what was done on them, or the descent that needed none."""
    if gauss_newton_starts(results):
        return (gauss_newton_section(results),)
    return surface_section(results), sensitivity_section(results), front_section(results)


def _one(make: Callable[[Results], Section]) -> Callable[[Results], tuple[Section, ...]]:
    return lambda results: (make(results),)


def _behind(make: Callable[[Results], Sequence[Section]]) -> Callable[[Results], tuple[Section, ...]]:
    """The same sections as a part of the appendix."""
    return lambda results: tuple(replace(s, appendix=True) for s in make(results))


# The order of the page: the answer, how well it fits and predicts, what is open; how it was found stands behind.
REPORT_SECTIONS: tuple[Callable[[Results], tuple[Section, ...]], ...] = (
    _one(verdict),
    _one(curve_section),
    _one(prediction_section),
    _one(open_section),
    turning_sections,
    gap_sections,
    _behind(_one(identification_section)),
    _behind(closed_form_sections),
    _behind(_one(candidate_section)),
    _behind(_how_found),
    _behind(_one(runs)),
    _behind(_one(provenance)),
    _behind(use_section),
)
