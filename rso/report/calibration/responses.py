"""The document's sections over the parameters: response surface, sensitivity, compromises between targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.core.digits import DASH, fixed, known, significant
from rso.report.calibration.drawn_runs import drawn_runs
from rso.report.calibration.influence import influence_blocks, over
from rso.report.layout.digits import Unit, aligned, between, clean, largest, quantity, raised, sentence, shortest, shown
from rso.report.layout.document import Block, Cell, Picture, Section, Table, Text, column, missing, table, words
from rso.report.reading import (
    OutputView,
    Results,
    drowned,
    front,
    grids,
    lead_search,
    listed,
    number,
    outputs,
    pair,
    parameters,
    seen,
)


def surface_section(results: Results) -> Section:
    """Section 5: the response surface and how well it is known."""
    blocks: list[Block] = []
    if grids(results):
        blocks.append(Picture("surface", _surface_caption(results)))
    scores = listed(results, "surrogates")
    if scores:
        blocks.append(_score_table(scores, outputs(results)))
        if any(s.get("story") for s in scores):
            blocks.append(_choice_table(scores, outputs(results)))
    blocks += _left_out(results) if grids(results) else []
    title = "Response surface"
    return Section("surface", title, tuple(blocks) or (missing("Response surfaces", "surrogates"),))


def _surface_caption(results: Results) -> str:
    text = _runs_sentence(results)
    if story := (results.get("feasible") or {}).get("story"):
        text += f" Hatched: where runs would rather fail. {clean(story)}"
    flat = not any((s.get("y") or {}).get("values") for s in grids(results))
    if listed(results, "searches"):
        text += " Accent line: where the surface meets the target, dashed ±σ." if not flat else ""
        text += f" Numbered diamonds: candidates of search {lead_search(results)}; small ones: of the others."
    if flat:
        text += " Band: the surrogate’s own error on points that it has not seen."
    others = {k: v for s in grids(results) for k, v in (s.get("others") or {}).items()}
    held = [f"{p.letter} = {p.show(others[p.name])}" for p in parameters(results) if known(others.get(p.name))]
    return text + (f" Held: {', '.join(held)}." if held else "")


def _runs_sentence(results: Results) -> str:
    """How many runs of each end the maps show, and how many lie outside of them."""
    views = {p.name: p for p in parameters(results)}
    grid = grids(results)[0]
    x, y = views.get(grid["x"]["parameter"]), views.get((grid.get("y") or {}).get("parameter") or "")
    shown_as = {"done": "done (dots)", "failed": "failed (crosses)", "crashed": "crashed (triangles)"}
    drawn = {state: len(drawn_runs(results, state, x, y)) if x else 0 for state in shown_as}
    every = [
        r.get("state") for r in listed(results, "runs") if r.get("purpose") not in ("candidate", "validate", "input")
    ]
    parts = [f"{n} {shown_as[state]}" for state, n in drawn.items() if n]
    outside = {state: every.count(state) - n for state, n in drawn.items() if every.count(state) > n}
    text = f"Runs: {', '.join(parts)}." if parts else ""
    if outside:
        each = ", ".join(f"{n} {state}" for state, n in outside.items())
        text += f" Outside of these ranges: {each}."
    return text.strip()


def _score_table(scores: list[Mapping[str, Any]], known_outputs: Mapping[str, OutputView]) -> Table:
    views = [known_outputs.get(s["output"]) for s in scores]
    labels = [v.label if v else clean(s["output"]) for v, s in _zip(views, scores)]
    sized = [
        shown(
            s.get("unit", ""),
            largest([number((s.get(k) or {}).get("max_abs")) for k in ("cross_validation", "held_out")]),
        )
        for s in scores
    ]
    columns = [
        column("Output", words(labels), number=False),
        column("surrogate", words([clean(s.get("kind")) for s in scores]), number=False),
        column("runs", words([shortest(s.get("n")) for s in scores])),
    ]
    for key, title in (("cross_validation", "cross-val."), ("held_out", "held out")):
        each = [s.get(key) or {} for s in scores]
        for field, word in (("rmse", "RMSE"), ("max_abs", "max")):
            values = [number(e.get(field)) for e in each]
            cells = aligned([None if v is None else v * u.factor for v, u in zip(values, sized, strict=True)], 3)
            columns.append(column(word, cells, title))
        columns.append(column("Q²", tuple(Cell(significant(number(e.get("q2")), 4)) for e in each), title))
    columns.insert(3, column("errors in", words([u.label for u in sized]), number=False))
    held = [(s.get("held_out") or {}).get("n") for s in scores]
    new = ", ".join(f"{n}" for n in sorted({n for n in held if known(n)}))
    note = f"Held out: {new} runs used only to test the surrogates, then added to the training set."
    return table("Errors of the surrogates", columns, note if new else "")


def _choice_table(scores: list[Mapping[str, Any]], known_outputs: Mapping[str, OutputView]) -> Table:
    """Which surrogate was taken for each output, and what the others had; the story says both."""
    views = [known_outputs.get(s["output"]) for s in scores]
    stories = [raised(sentence(s.get("story"))) for s in scores]
    taken = [story.partition(":")[0] for story in stories]
    others = [story.partition(":")[2].partition("; ")[2].partition(". ")[0] for story in stories]
    columns = [
        column("Output", words([v.label if v else clean(s["output"]) for v, s in _zip(views, scores)]), number=False),
        column("taken", words(taken), number=False),
        column("others, cross-validated", words([text.removesuffix(".") or DASH for text in others]), number=False),
    ]
    return table("Why these surrogates", columns, folded=True)


def _zip(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return zip(a, b, strict=True)


def _left_out(results: Results) -> list[Block]:
    """Outputs that are nothing but numerical error say nothing."""
    views, lost = outputs(results), drowned(results)
    each = [
        f"{views[i].label} ({quantity(value, views[i].base, 2)}, error {quantity(error, views[i].base, 2)})"
        for i, (value, error) in lost.items()
        if i in views
    ]
    said = f"Not drawn, because smaller than its own numerical error: {', '.join(each)}."
    return [Text(said, "note")] if each else []


def sensitivity_section(results: Results) -> Section:
    """Section 6: what each parameter moves."""
    data = results.get("sensitivity") or {}
    if not data:
        return Section("sensitivity", "Sensitivity", (missing("Sensitivities", "sensitivity"),))
    blocks: list[Block] = [Text(_definition(results, data))]
    if data.get("local") or data.get("sobol"):
        marks = "Above: the output at the low end of a range (open) and at the high end (filled). "
        marks += "Below: first-order (filled) and total (open) Sobol indices with their intervals."
        caption = f"{raised(sentence(data['story']))} {marks}" if data.get("story") else marks
        blocks += [Picture("sensitivity", caption), _sensitivity_table(results, data)]
    blocks += [*_left_out(results), *influence_blocks(results)]
    return Section("sensitivity", "Sensitivity", tuple(blocks))


def _definition(results: Results, data: Mapping[str, Any]) -> str:
    at = data.get("at") or {}
    point = ", ".join(f"{p.letter} = {p.show(at[p.name])}" for p in parameters(results) if known(at.get(p.name)))
    around = f" ({point})" if point else ""
    return (
        f"Local: the output at the two ends of a parameter’s range with the others held{around}; the elasticity is "
        "d ln y / d ln θ there. Sobol: share of the output’s variance over the ranges due to a parameter alone "
        "(first order) and with all others (total). The 90 % intervals include the surrogate’s error."
    )


def _sensitivity_table(results: Results, data: Mapping[str, Any]) -> Table:
    views = outputs(results)
    letters = {p.name: p.letter for p in parameters(results)}
    sobol, local = (
        {(b["output"], b["parameter"]): b for b in seen(results, data.get(k) or ())} for k in ("sobol", "local")
    )
    keys = list(dict.fromkeys([*local, *sobol]))
    first = [k == 0 or keys[k - 1][0] != key[0] for k, key in enumerate(keys)]
    unit = [views[o].unit if o in views else Unit("") for o, _ in keys]
    label = [views[o].label if o in views else clean(o) for o, _ in keys]
    label = [f"{text} ({u.label})" if u.label else text for text, u in zip(label, unit, strict=True)]

    def values(of: Mapping[Any, Any], field: str, scale: bool) -> list[float | None]:
        found = [number(of.get(k, {}).get(field)) for k in keys]
        return [v if v is None or not scale else v * u.factor for v, u in zip(found, unit, strict=True)]

    def index(field: str) -> tuple[Cell, ...]:
        return words([fixed(v, 3) if v is not None else DASH for v in values(sobol, field, False)])

    def interval(field: str) -> tuple[Cell, ...]:
        ends = [sobol.get(k, {}).get(field) or () for k in keys]
        return words([" to ".join(fixed(x, 3) for x in e) if pair(e) else DASH for e in ends], "quiet")

    columns = [
        column("Output", tuple(Cell(t) if f else Cell("") for t, f in zip(label, first, strict=True)), number=False),
        column("θ", words([letters.get(p, clean(p)) for _, p in keys]), number=False),
        column("at low", aligned(values(local, "low", True))),
        column("at high", aligned(values(local, "high", True))),
        column("change", aligned(values(local, "change", True))),
        column("elasticity", aligned(values(local, "elasticity", False), 3, plus=True)),
        column("first", index("first")),
        column("interval", interval("first_interval")),
        column("total", index("total")),
        column("interval", interval("total_interval")),
    ]
    return table("Local effects and Sobol indices", columns, over(results))


def front_section(results: Results) -> Section:
    """Section 7: the compromises between the targets, and the valley of one target."""
    blocks: list[Block] = []
    for k, s in enumerate(listed(results, "searches")):
        if len(front(s)[0]) and (parameters(results, free=True) or len(s.get("targets") or ()) > 1):
            caption = _front_caption(results, s)
            alone = len(s.get("targets") or ()) < 2 and len(front(s)[0]) == 1  # a picture of one dot tells nothing
            blocks.append(Text(caption) if alone else Picture(f"front-{k}", caption))
    title = "Compromises between the targets"
    return Section("front", title, tuple(blocks) or (missing("Pareto fronts", "search"),))


def _front_caption(results: Results, s: Mapping[str, Any]) -> str:
    values, objectives = front(s)
    targets: Sequence[Mapping[str, Any]] = s.get("targets") or ()
    what = f"Search {clean(s['name'])}: "
    if len(targets) < 2:
        spans = []
        for p in parameters(results, free=True):
            x = [v for e in values if known(v := e.get(p.name))]
            if x:
                spans.append(f"{p.letter} {between(min(x), max(x), p.unit)}")
        where = "met best at" if len(values) == 1 else f"met at {len(values)} points:"
        marks = "" if len(values) == 1 else " (dots). Diamonds: candidates"
        return f"{what}one target, {where} {', '.join(spans)}{marks}."
    unit = targets[0].get("unit", "")
    worst = float(objectives.max(axis=1).min())
    return (
        f"{what}{len(values)} compromises, as predicted; the least that one misses its worst target by is "
        f"{quantity(worst, unit, 2)}. Left: parameters; right: what each target is missed by. Diamonds: candidates, as "
        "predicted."
    )
