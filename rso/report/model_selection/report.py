"""The report of a ladder of models: which level these data ask for, why, and how good is good enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from rso.core.digits import DASH, NBSP, known, significant
from rso.report.exact_sizes import exact_sizes
from rso.report.language import PageOptions, names_of, write_page
from rso.report.layout.byline import byline
from rso.report.layout.digits import Unit, aligned, between, clean, duration, percent, sentence, shown, symbol
from rso.report.layout.document import (
    Block,
    Cell,
    Fact,
    Facts,
    Mark,
    Picture,
    Report,
    Section,
    Table,
    Text,
    column,
    table,
    words,
)
from rso.report.model_selection.figures import Found, draw, fitted, levels, role_word, title
from rso.report.reading import listed, number, pair
from rso.report.sketch import sketch_blocks

_MODEL_VERDICTS: dict[str, Cell] = {
    "adequate": Cell("good enough", mark="good"),
    "fails": Cell("fails", mark="warn"),
    "refused": Cell("refused: not determined", mark="bad"),
    "no_answer": Cell("no answer", mark="bad"),
    "not_better": Cell("not better", mark="warn"),
    "not_needed": Cell("not needed", mark="quiet"),
}
MAX_LADDER_CURVES = 6  # that have a figure on the page


def render_ladder(found: Found, folder: Path, **options: Unpack[PageOptions]) -> list[Path]:
    """Write ladder.html and ladder.pdf into `folder` from the plain data of ladder.json; list of files.

    The same data give the same bytes.
    """
    return write_page(report(found), lambda n: draw(found, n), folder, "ladder", names_of(found), options)


def report(found: Found) -> Report:
    """The whole document, in the order in which a reader asks."""
    title = clean((found.get("study") or {}).get("title")) or "Untitled study"
    parts = (decision(found), curves(found), thresholds(found), parameters(found), how(found))
    return Report(title, "Ladder: the simplest model consistent with the data", byline(found), parts)


def decision(found: Found) -> Section:
    """Section 1: the decision, the numbers behind it, every level in a line."""
    blocks: list[Block] = [Text(sentence(found.get("words")) or "There is no decision.", "lead")]
    facts = _facts(found)
    if facts:
        blocks.append(Facts(tuple(facts)))
    blocks += sketch_blocks(found)
    blocks += [Text(sentence(w), "warning") for w in listed(found, "warnings")]
    blocks.append(_steps(found))
    return Section("decision", "Decision", tuple(blocks))


def chosen_level(found: Found) -> Mapping[str, Any] | None:
    """The level that holds."""
    return next((v for v in fitted(found) if v.get("name") == found.get("chosen")), None)


def _facts(found: Found) -> list[Fact]:
    level = chosen_level(found)
    if level is None:
        return []
    good = found.get("adequate") is True
    test, facts = level.get("fitted") or {}, []
    facts.append(
        Fact("Level", title(level), "good enough" if good else "the best, but it fails", "good" if good else "warn")
    )
    facts.append(
        Fact(
            "Misfit χ²", significant(number(test.get("chi2")), 3), f"limit {significant(number(test.get('limit')), 3)}"
        )
    )
    first = next((e for e in level.get("errors") or () if e.get("role") == "fit"), None)
    if first is not None:
        limit = percent(number(first.get("threshold")), 2)
        facts.append(Fact("NRMSE", percent(number(first.get("nrmse")), 2), f"error threshold {limit}"))
    p = (level.get("verdict") or {}).get("p_value")
    facts.append(Fact("Both as one test", f"p {p_text(p, found)}", f"fails below {_alarm(found)}"))
    facts += _unused(level)
    runs = (found.get("counts") or {}).get("runs")
    if known(runs):
        facts.append(Fact("Simulations", f"{runs}", f"{duration((found.get('timings') or {}).get('fe_cpu'))} of CPU"))
    return facts


def _unused(level: Mapping[str, Any]) -> list[Fact]:
    """The tests that took no part in the decision."""
    tests = list(level.get("validated") or ())
    if not tests:
        return []
    missed = [clean(t.get("curve")) for t in tests if t.get("verdict") and t["verdict"].get("passes") is not True]
    unknown = [clean(t.get("curve")) for t in tests if not t.get("verdict")]
    names = ", ".join(missed or unknown or [clean(t.get("curve")) for t in tests])
    value = "missed" if missed else "open" if unknown else "predicted"
    mark: Mark = "warn" if missed else "" if unknown else "good"
    return [Fact("Unused test" if len(tests) == 1 else "Unused tests", value, names, mark)]


def _alarm(found: Found) -> str:
    """Chance of a false alarm."""
    return f"{100 * (1 - (number(found.get('confidence')) or 0.95)):.3g}{NBSP}%"


def _steps(found: Found) -> Table:
    steps, by_name = listed(found, "steps"), {v.get("name"): v for v in levels(found)}
    rows = [by_name.get(s.get("level")) or {} for s in steps]
    tests = [v.get("fitted") or {} for v in rows]
    others = [v.get("selected") or {} for v in rows]
    top = max((v["log_evidence"] for v in rows if known(v.get("log_evidence"))), default=0.0)
    first: list[Mapping[str, Any]] = [
        next((e for e in v.get("errors") or () if e.get("role") == "fit"), {}) for v in rows
    ]
    strong = [Cell(title(s), mark="strong" if s.get("level") == found.get("chosen") else "") for s in steps]
    columns = [
        column("Level", tuple(strong), number=False),
        column(
            "",
            tuple(_MODEL_VERDICTS.get(clean(s.get("verdict")), Cell(clean(s.get("verdict")))) for s in steps),
            number=False,
        ),
        column("χ²", aligned([number(t.get("chi2")) for t in tests], 4)),
        column("limit", aligned([number(t.get("limit")) for t in tests], 3)),
    ]
    if any(others):
        columns += [
            column("χ²", aligned([number(t.get("chi2")) for t in others], 4), "selection"),
            column("limit", aligned([number(t.get("limit")) for t in others], 3)),
        ]
    columns += [
        column("NRMSE", aligned([_hundred(e.get("nrmse")) for e in first], 3), "%"),
        column("limit", aligned([_hundred(e.get("threshold")) for e in first], 3), "%"),
        column("p", words([p_text((v.get("verdict") or {}).get("p_value"), found) for v in rows]), "of all"),
        column(
            "ln evidence",
            words(
                [DASH if not known(v.get("log_evidence")) else significant(v["log_evidence"] - top, 3) for v in rows]
            ),
            "below best",
        ),
        column("runs", words([f"{v['runs']}" if known(v.get("runs")) else DASH for v in rows])),
    ]
    note = "χ² of the fitted curves, NRMSE of the first of them. A level passes if it is beyond no limit. "
    note += "Runs: simulations that a level was the first to need."
    return table("Every level", columns, note)


def _hundred(x: Any) -> float | None:
    return 100 * float(x) if known(x) else None


def p_text(p: Any, found: Found) -> str:
    """A bootstrap p-value; the smallest one is a bound."""
    if not known(p):
        return DASH
    least = 1.0 / (1.0 + (number(found.get("draws")) or 0.0))
    return f"<{NBSP}{significant(least, 1)}" if p <= 1.01 * least else significant(p, 2)


def curves(found: Found) -> Section:
    """Section 2: data, levels, residuals; the decision level by level in words."""
    blocks: list[Block] = []
    if fitted(found):
        names = list(dict.fromkeys(c["name"] for v in fitted(found) for c in v.get("curves") or ()))
        text = "Left: measured curve and every level at its best. Right: measured − level; grey: twice the standard "
        text += "uncertainty of measurement and computation together."
        held = any(c.get("since") for v in fitted(found) for c in v.get("curves") or ())
        text += " Below: the hold, over the time at rest." if held else ""
        for k, name in enumerate(names[:MAX_LADDER_CURVES]):
            blocks.append(Picture(f"curve-{k}", text if k == 0 else f"The same for {name}."))
    blocks += [Text(sentence(s.get("words"))) for s in listed(found, "steps") if s.get("verdict") != "not_needed"]
    return Section("curves", "Level by level", tuple(blocks) or (Text("Nothing was fitted.", "missing"),))


def thresholds(found: Found) -> Section:
    """Section 3: the error that noise alone would leave, curve by curve, beside what each level reaches."""
    rows = [(v, e) for v in fitted(found) for e in v.get("errors") or ()]
    if not rows:
        return Section("threshold", "How good is good enough", (Text("Nothing was fitted.", "missing"),))
    text = (
        "A threshold for an error norm need not be chosen. Data sets are simulated from a level's own curve with "
        "the noise of this measurement: scatter of repeats, stated and numerical errors. They are fitted like the "
        "real one; their χ² and NRMSE show what a perfect model leaves. χ² is insensitive to one smooth deviation, "
        "NRMSE to small forces; both are tested jointly. A perfect model exceeds any of the limits in "
        f"{_alarm(found)} of all data sets; a smaller error means nothing."
    )
    columns = [
        column("Level", words([title(v) for v, _ in rows]), number=False),
        column("Curve", words([clean(e.get("curve")) for _, e in rows]), number=False),
        column("", words([role_word(e.get("role")) for _, e in rows], "quiet"), number=False),
        column("NRMSE", aligned([_hundred(e.get("nrmse")) for _, e in rows], 3), "%"),
        column("threshold", aligned([_hundred(e.get("threshold")) for _, e in rows], 3), "%"),
        column("", tuple(_within(e) for _, e in rows), number=False),
    ]
    note = (
        "Curves for validation took no part in the decision."
        if any(e.get("role") == "validate" for _, e in rows)
        else ""
    )
    picture = Picture("threshold", "Error of every level (dot) and its threshold (tick: what noise alone would leave).")
    return Section("threshold", "How good is good enough", (Text(text), picture, table("Errors", columns, note)))


def _within(e: Mapping[str, Any]) -> Cell:
    if not (known(e.get("nrmse")) and known(e.get("threshold"))):
        return Cell(DASH)
    good = e["nrmse"] <= e["threshold"]
    return Cell("within noise", mark="good") if good else Cell("beyond", mark="warn")


def parameters(found: Found) -> Section:
    """Section 4: what each level says about the parameters, and whether the data determine what it adds."""
    rows = [(v, p) for v in fitted(found) for p in v.get("parameters") or ()]
    if not rows:
        return Section("parameters", "Parameters by level", (Text("Nothing was fitted.", "missing"),))
    units = [shown(clean(p.get("unit")), number(p.get("value"))) for _, p in rows]
    names = [_axis(p.get("name")) for _, p in rows]
    columns = [
        column("Level", words([title(v) for v, _ in rows]), number=False),
        column(
            "Parameter",
            words([n + (" (added)" if p.get("added") else "") for n, (_, p) in zip(names, rows, strict=True)]),
            number=False,
        ),
        column("value", words([value_text(p, u) for u, (_, p) in zip(units, rows, strict=True)])),
        column("90 % interval", words([interval_text(p, u) for u, (_, p) in zip(units, rows, strict=True)])),
        column("", tuple(_determined(p.get("verdict")) for _, p in rows), number=False),
    ]
    note = "Profile likelihood. Only what a level adds must be determined; moduli that it adds are shares of μ."
    caption = "90 % interval of every parameter by level, and its value if it is determined; pale: the range searched."
    picture = Picture("intervals", caption)
    said = table("What the data say", columns, note)
    exact = exact_sizes(found, bool(found.get("stated_inputs")))
    return Section("parameters", "Parameters by level", (picture, said, *exact))


def _axis(name: Any) -> str:
    return "/".join("·".join(symbol(n) for n in part.split("·")) for part in clean(name).split("/"))


def value_text(p: Mapping[str, Any], unit: Unit) -> str:
    """The value of a parameter with its unit; one that the data do not determine has an interval only."""
    if p.get("verdict") not in ("determined", "weakly"):
        return DASH
    return significant(_times(p.get("value"), unit.factor), 3) + unit.after


def _times(x: Any, factor: float) -> float | None:
    return float(x) * factor if known(x) else None


def interval_text(p: Mapping[str, Any], unit: Unit) -> str:
    """The interval of a parameter with its unit."""
    ends = p.get("interval")
    return between(float(ends[0]), float(ends[1]), unit, 3) if pair(ends) else DASH


def _determined(word: Any) -> Cell:
    marks = {"determined": Cell("determined", mark="good"), "weakly": Cell("weakly", mark="warn")}
    return marks.get(clean(word), Cell("not determined", mark="quiet"))


def how(found: Found) -> Section:
    """Section 5: the rule, the start, what was run."""
    blocks: list[Block] = [Text(clean(found.get("rule")))]
    blocks.append(
        Text(
            "Evidence: the likelihood averaged over the ranges of the parameters, so that a superfluous parameter "
            "costs. Misfit and evidence include the noise, gain and depth errors from repeats and statements. They "
            "also include the numerical error of the simulation and the error of the emulator."
        )
    )
    start = found.get("start") or {}
    rows: Sequence[Mapping[str, Any]] = start.get("parameters") or ()
    if rows:
        units = [shown(clean(r.get("unit")), number(r.get("value"))) for r in rows]
        own = [r.get("study") for r in rows]
        columns = [
            column("", words([symbol(clean(r.get("parameter"))) for r in rows]), number=False),
            column(
                "start",
                words(
                    [
                        significant(_times(r.get("value"), u.factor), 3) + u.after
                        for r, u in zip(rows, units, strict=True)
                    ]
                ),
            ),
            column(
                "range by closed form",
                words([between(float(r["low"]), float(r["high"]), u, 3) for r, u in zip(rows, units, strict=True)]),
            ),
            column(
                "range of the study",
                words(
                    [
                        between(float(o[0]), float(o[1]), u, 3) if pair(o) else DASH
                        for o, u in zip(own, units, strict=True)
                    ]
                ),
            ),
        ]
        which = "The ranges by closed form were searched." if start.get("used") else "The study's ranges were searched."
        blocks.append(table("Start without a simulation", columns, which))
    similar = next((clean(v.get("similarity")) for v in fitted(found) if v.get("similarity")), "")
    if similar:
        blocks.append(Text(f"Similarity: {similar}.", "note"))
    return Section("how", "How this was decided", tuple(blocks))
