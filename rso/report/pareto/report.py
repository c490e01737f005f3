"""The page of a study with objectives: what was found, the front and its designs, surfaces, sensitivities, how."""

from __future__ import annotations

from pathlib import Path

from rso.core.digits import significant
from rso.report.canvas import short
from rso.report.layout.byline import byline
from rso.report.layout.digits import clean, duration, percent, sentence, symbol, unit_text
from rso.report.layout.document import Block, Cell, Fact, Facts, Picture, Report, Section, Text, column, table, words
from rso.report.layout.page import pictures, pour
from rso.report.pareto.figures import MAX_SLICE_COLUMNS, draw
from rso.report.pareto.reading import Found, names, searched, unit_of, value_text

MAX_RUN_ROWS = 400  # rows of the folded table of runs; runs.csv has all


def render_pareto(found: Found, folder: Path, html: bool = True, pdf: bool = True) -> list[Path]:
    """Write report.html and report.pdf into `folder` from the plain data of results.json; list of files.

    The same data give the same bytes.
    """
    document = report(found)
    return pour(document, {n: draw(found, n) for n in pictures(document)}, folder, "report", html, pdf)


def summary(found: Found, quiet: bool = False) -> list[str]:
    """Lines at the end of `rso run` below the title; `quiet` leaves the answer alone."""
    counts = found["counts"]
    ended = ", ".join(f"{counts[s]} {s}" for s in ("done", "failed", "crashed"))
    lines = [f"  {w}" for w in found["words"]]
    if quiet:
        return lines
    for c in found["candidates"]:
        if c["simulated"]:
            own = ", ".join(f"{n} = {c['simulated'][n]:.5g}" for n in names(found))
            at = ", ".join(f"{k} = {v if isinstance(v, str) else f'{v:.5g}'}" for k, v in c["values"].items())
            lines.append(f"  {c['name']}: {own} at {at}")
    lines.append(f"  {counts['runs']} simulations ({ended}), {found['timings']['total']:.0f} s")
    return [*lines, *(f"  warning: {w}" for w in found["warnings"])]


def report(found: Found) -> Report:
    """The whole document."""
    heading = clean(found["study"]["title"]) or "Untitled study"
    words_ = [("least" if o["minimise"] else "largest", symbol(o["quantity"])) for o in found["objectives"]]
    subtitle = f"Which design has the {' and '.join(f'{w} {q}' for w, q in words_)}?"
    parts = (answer(found), candidates(found), *shapes(found), surfaces(found), sensitivity(found), how(found))
    return Report(heading, subtitle, byline(found), parts)


def answer(found: Found) -> Section:
    """Section 1: in words, the facts, the front."""
    said = found["words"]
    blocks: list[Block] = [Text(sentence(clean(w)), "lead" if k == 0 else "plain") for k, w in enumerate(said)]
    blocks += [Text(sentence(clean(w)), "warning") for w in found["warnings"]]
    blocks.append(Facts(_facts(found)))
    several = len(names(found)) > 1
    caption = (
        "Simulations, the front on the response surfaces, and the candidates that were simulated to prove it."
        if several
        else "The objective in every simulation, in their order, and the best so far that keeps all limits."
    )
    blocks.append(Picture("front", caption))
    return Section("answer", "Answer", tuple(blocks))


def _facts(found: Found) -> tuple[Fact, ...]:
    facts = []
    runs = {r["key"]: r for r in found["runs"]}
    best = [runs[k] for k in found["best_runs"]]
    for o in found["objectives"][:3]:
        n, unit = o["quantity"], unit_of(found, o["quantity"])
        known = [r["outputs"][n] for r in best if r["outputs"]]
        value = (min if o["minimise"] else max)(known) if known else None
        text = f"{value_text(value, unit, 5)}{unit.after}"
        note = "the best that was simulated within all limits" if known else "no simulation keeps all limits"
        facts.append(
            Fact(f"{'least' if o['minimise'] else 'largest'} {symbol(n)}", text, note, "" if known else "warn")
        )
    good = sum(c["verified"] and c["meets"] for c in found["candidates"])
    total = len(found["candidates"])
    note = f"agree with their simulation to {percent(found['verify']['tolerance'])}"
    note += " and keep all limits" if found["constraints"] else ""
    facts.append(Fact("candidates", f"{good} of {total}", note, "good" if good == total else "warn"))
    return tuple(facts)


def candidates(found: Found) -> Section:
    """Section 2: the designs that were simulated again."""
    rows = found["candidates"]
    if not rows:
        return Section("candidates", "Candidates", (Text("There are none.", "missing"),))
    columns = [column("", words([c["name"].split()[-1] for c in rows]), number=False)]
    for p in searched(found):
        unit = unit_of(found, p["name"])
        cells = words([value_text(c["values"][p["name"]], unit) for c in rows])
        columns.append(column(symbol(p["name"]), cells, unit.label, number=p["choices"] is None))
    for n in names(found):
        unit = unit_of(found, n)
        cells = words([value_text((c["simulated"] or {}).get(n), unit, 5) for c in rows])
        columns.append(column(symbol(n), cells, unit.label))
    columns.append(column("difference", words([percent(c["difference"]) for c in rows])))
    columns.append(column("limits", tuple(_kept(c) for c in rows), number=False))
    note = "As simulated. Difference: the largest between prediction and simulation of any quantity, over its value."
    blocks: list[Block] = [table("Candidates", columns, note)]
    limits = found["constraints"]
    if limits:
        own = [column("Limit", words([clean(c["text"]) for c in limits]), number=False)]
        for c in rows:
            shown = [
                value_text((c["simulated"] or {}).get(k["quantity"]), unit_of(found, k["quantity"])) for k in limits
            ]
            marks = tuple(
                Cell(t, mark="bad" if k["text"] in c["misses"] else "") for t, k in zip(shown, limits, strict=True)
            )  # fmt: skip
            own.append(column(c["name"].split()[-1], marks))
        units = [unit_of(found, k["quantity"]).label for k in limits]
        own.append(column("unit", words(units), number=False))
        blocks.append(table("Limited quantities of the candidates", own))
    return Section("candidates", "Candidates", tuple(blocks))


def _kept(c: Found) -> Cell:
    if c["state"] != "done":
        return Cell(c["state"], mark="bad")
    return Cell("kept", mark="good") if c["meets"] else Cell("not kept", mark="bad")


def shapes(found: Found) -> tuple[Section, ...]:
    """Section 3, of several objectives: the designs along the front."""
    if len(names(found)) < 2 or len(found["front"]["points"]) < 3 or not found["front"]["feasible"]:
        return ()
    caption = (
        "Each line is a design of the front, from its parameters (left) to its objectives (shaded), coloured by "
        f"{symbol(names(found)[0])}. Lines that cross between two axes trade one for the other."
    )
    return (Section("designs", "Designs along the front", (Picture("designs", caption),)),)


def surfaces(found: Found) -> Section:
    """Response surfaces: slices and scores."""
    blocks: list[Block] = []
    cut = found["sensitivity"]["slices"]
    if cut:
        left = len({c["parameter"] for c in cut}) - MAX_SLICE_COLUMNS
        more = f" {left} more parameters are in results.json." if left > 0 else ""
        caption = (
            "Each quantity along one parameter, the others as in the candidate nearest to the ideal; bands are two "
            f"standard deviations.{more}"
        )
        blocks.append(Picture("slices", caption))
    rows = found["surfaces"]
    held = [r["held_out"] for r in rows]
    columns = [
        column("Quantity", words([symbol(r["quantity"]) for r in rows]), number=False),
        column("error, cross-validation", words([_error(r, "cross_validation") for r in rows]), "of the spread"),
        column("error, held out", words([_error(r, "held_out") for r in rows]), "of the spread"),
        column("Q²", words([significant((h or {}).get("q2"), 4) for h in held]), "held out"),
        column("kind", words([short(clean(r["story"].split(":")[0]), 60) for r in rows]), number=False),
    ]
    note = (
        "Root mean square over the spread (√12 standard deviations) of the runs. Over the whole ranges: near the "
        "front, where simulations were added, surfaces are closer, as the candidates show."
    )
    blocks.append(table("Response surfaces", columns, note))
    blocks += [Text(f"{symbol(r['quantity'])}: {clean(r['story'])}", "note") for r in rows]
    return Section("surfaces", "Response surfaces", tuple(blocks))


def _error(row: Found, key: str) -> str:
    return percent(row[key]["rmse"] / row["spread"]) if row[key] and row[key]["rmse"] is not None else "–"


def sensitivity(found: Found) -> Section:
    """What moves each quantity."""
    indices, effects = found["sensitivity"]["sobol"], found["sensitivity"]["morris"]
    blocks: list[Block] = []
    if indices:
        caption = (
            "Sobol indices over the ranges: share of the variance due to a parameter alone (dark) and in all "
            "(light, with its 90 % interval)."
        )
        blocks.append(Picture("sensitivity", caption))
    for text, rows in effects.items():
        unit = unit_of(found, text)
        columns = [
            column("Parameter", words([symbol(r["parameter"]) for r in rows]), number=False),
            column("mean size", words([value_text(r["mean_size"], unit) for r in rows]), unit.label),
            column("mean", words([value_text(r["mean"], unit) for r in rows]), unit.label),
            column("deviation", words([value_text(r["deviation"], unit) for r in rows]), unit.label),
        ]
        blocks.append(table(f"Elementary effects on {symbol(text)}", columns, "Morris: change over the whole range."))
    if not blocks:
        blocks = [Text("Neither sobol nor morris is asked for in [sensitivity].", "missing")]
    return Section("sensitivity", "Sensitivity", tuple(blocks))


def how(found: Found) -> Section:
    """What was done: design, search, rounds, costs, all runs."""
    d, s, c, t = found["design"], found["search"], found["counts"], found["timings"]
    direct = s["method"] == "simulations"
    where = "on the simulations themselves" if direct else "on the response surfaces"
    text = (
        f"A design of {d['runs']} runs ({clean(d['kind'])}) and {d['held_out']} held out. NSGA-II with "
        f"{s['population']} individuals over {s['generations']} generations {where}, "
        f"{found['front']['evaluations']} evaluations."
    )
    if not direct:
        text += (
            " Its ends and points between were sharpened by SLSQP. Candidates were simulated, the simulations learnt, "
            f"and the search repeated: {len(found['rounds'])} rounds."
        )
    blocks: list[Block] = [Text(text)]
    if len(names(found)) > 1 or not direct:
        caption = (
            "Left: share of the box between the best and the worst objectives that the front dominates. Right: largest "
            "difference of a candidate from its simulation; dashed is verify.tolerance."
        )
        blocks.append(Picture("convergence", caption))
    blocks += [Text(f"Round {k}: {clean(r['words'])}.", "note") for k, r in enumerate(found["rounds"], 1)]
    cost = sum(r["cpu_s"] or 0.0 for r in found["runs"])
    blocks.append(
        Text(
            f"{c['runs']} simulations: {c['done']} done, {c['failed']} failed, {c['crashed']} crashed; "
            f"{duration(cost)} of them, {duration(t.get('total'))} in all.",
            "note",
        )
    )
    blocks.append(_runs(found))
    return Section("how", "How this was found", tuple(blocks))


def _runs(found: Found) -> Block:
    rows = found["runs"][:MAX_RUN_ROWS]
    columns = [column("purpose", words([clean(r["purpose"]) for r in rows]), number=False)]
    for p in searched(found):
        unit = unit_of(found, p["name"])
        cells = words([value_text(r["values"][p["name"]], unit) for r in rows])
        columns.append(column(symbol(p["name"]), cells, unit.label, number=p["choices"] is None))
    for text in found["units"]:
        unit = unit_of(found, text)
        cells = words([value_text((r["outputs"] or {}).get(text), unit) for r in rows])
        columns.append(column(symbol(text), cells, unit.label or unit_text(found["units"][text])))
    state = tuple(
        Cell("" if r["state"] == "done" else r["state"], mark="bad" if r["state"] != "done" else "") for r in rows
    )
    columns.append(column("state", state, number=False))
    left = len(found["runs"]) - len(rows)
    return table("All simulations", columns, f"{left} more are in runs.csv." if left > 0 else "", folded=True)
