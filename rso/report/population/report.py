"""The page of many specimens: the answer, a forest plot for each parameter, all specimens, how it was computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack
from urllib.parse import quote

from rso.core.digits import DASH, known, significant
from rso.report.language import PageOptions, names_of, write_page
from rso.report.layout.byline import byline
from rso.report.layout.digits import Unit, between, clean, percent, sentence, symbol
from rso.report.layout.document import Block, Cell, Fact, Facts, Picture, Report, Section, Text, column, table, words
from rso.report.population.figures import draw, unit_of

Found = Mapping[str, Any]
POPULATION_METHOD = (
    "Each specimen is fitted for itself, and its profile likelihood of a parameter is kept. Between specimens ln θ is "
    "normal, or θ where its range holds 0. The standard deviation τ of that is found by restricted maximum likelihood "
    "(Viechtbauer 2005), with these likelihoods in place of Gaussian ones.",
    "The interval of the mean is that of Hartung and Knapp (2001), no narrower than known errors allow (Röver 2015). "
    "That of τ is where Cochran's Q lies between its quantiles (Viechtbauer 2007). The next specimen is predicted by "
    "Student's t with two degrees of freedom less than specimens (Higgins 2009).",
    "An outlier lies so far from the mean of all others that p < 0.05 over the number of specimens. Its distance is "
    "taken over its own error, the scatter and the error of that mean (Viechtbauer & Cheung 2010). Outliers are marked "
    "and not left out.",
    "An arrow is an end of the range that was searched: the data do not bound the parameter there. Such a specimen "
    "counts by its likelihood, which is level beyond that end. One that is bounded nowhere is left out.",
)


def render_specimens(found: Found, folder: Path, **options: Unpack[PageOptions]) -> list[Path]:
    """Write specimens.html and specimens.pdf into `folder` from the plain data of specimens.json; list of files."""
    return write_page(
        report(found), lambda n: draw(found, n.removeprefix("forest-")), folder, "specimens", names_of(found), options
    )


def report(found: Found) -> Report:
    """The whole document."""
    heading = clean(found["study"]["title"]) or "Untitled study"
    count = found["counts"]["specimens"]
    parts = (answer(found), forests(found), every(found), how(found))
    return Report(
        heading, f"{count} specimens, each fitted for itself, and what they are together", byline(found), parts
    )


def answer(found: Found) -> Section:
    """In words, the facts, the numbers of the population."""
    blocks: list[Block] = [Text(sentence(w), "lead" if k == 0 else "plain") for k, w in enumerate(found["words"])]
    blocks += [Text(_begun(sentence(clean(w))), "warning") for w in found["warnings"]]
    c = found["counts"]
    good = c["done"] == c["specimens"]
    facts = [Fact("specimens", f"{c['done']} of {c['specimens']}", "have an answer", "good" if good else "warn")]
    marked = {n for p in found["population"] for n in p["outliers"]}
    facts.append(Fact("outliers", str(len(marked)), ", ".join(sorted(marked)[:4]) or "none", "warn" if marked else ""))
    facts.append(Fact("simulations", str(c["runs"]), "different ones, which specimens share"))
    blocks.append(Facts(tuple(facts)))
    blocks.append(_population(found))
    return Section("answer", "Answer", tuple(blocks))


def _begun(text: str) -> str:
    """A sentence; the letter of a parameter at its head stays as it is."""
    first = text[:1] if ":" in text.split(" ")[0] else text[:1].upper()
    return f"{first}{text[1:]}{'' if text.endswith('.') else '.'}"


def _population(found: Found) -> Block:
    rows = found["population"]
    units = [_unit(found, p) for p in rows]
    columns = [
        column("", words([symbol(p["parameter"]) for p in rows]), number=False),
        column("median or mean", words([_number(p["mean"], u) for p, u in zip(rows, units, strict=True)])),
        column("90 % interval", words([_between(p["interval"], u) for p, u in zip(rows, units, strict=True)])),
        column("next specimen", words([_between(p["prediction"], u) for p, u in zip(rows, units, strict=True)])),
        column("scatter τ", words([_tau(p, u) for p, u in zip(rows, units, strict=True)])),
        column("I²", words([percent(p["i2"]) for p in rows])),
        column("p of Q", words([significant(p["q_p_value"], 2) for p in rows])),
        column("specimens", words([_used(p) for p in rows]), "two-sided + one-sided"),
        column("unit", words([u.label for u in units]), number=False),
    ]
    note = (
        "On a log scale the median, and τ as a share: 10 % is a factor 1.1. I² is the share of the variance between "
        "estimates that is between specimens. A small p of Q says that these differ by more than their errors."
    )
    return table("Parameters over all specimens", columns, note)


def _unit(found: Found, p: Found) -> Unit:
    rows = [(s["name"], b) for s in found["specimens"] for b in s["parameters"] if b["parameter"] == p["parameter"]]
    return unit_of(p, rows)


def _number(x: float | None, unit: Unit, digits: int = 3) -> str:
    return significant(x * unit.factor, digits) if known(x) else DASH


def _between(span: Any, unit: Unit) -> str:
    return between(span[0], span[1], Unit("", unit.factor))


def _tau(p: Found, unit: Unit) -> str:
    if not known(p["tau"]):
        return DASH
    low, high = p["tau_interval"]
    if p["scale"] == "log":
        body = percent(_share(p["tau"]))
        ends = f"{percent(_share(low))} to {percent(_share(high))}" if known(high) else ""
    else:
        body, ends = _number(p["tau"], unit), _between((low, high), unit) if known(high) else ""
    return f"{body} ({ends})" if ends else body


def _share(tau: float) -> float:
    return math.expm1(min(tau, 50.0))


def _used(p: Found) -> str:
    return f"{p['both_sides']} + {p['one_side']}"


def forests(found: Found) -> Section:
    """A forest plot for each parameter."""
    blocks: list[Block] = []
    for p in found["population"]:
        what = "median" if p["scale"] == "log" else "mean"
        caption = (
            f"{symbol(p['parameter'])} of each specimen with its 90 % interval. The lozenge is the {what} with its "
            "interval, dashed is where the next specimen is expected. Diamonds are outliers, arrows ends of the range."
        )
        blocks.append(Picture(f"forest-{p['parameter']}", caption))
    return Section("forest", "Specimen by specimen", tuple(blocks))


def every(found: Found) -> Section:
    """All specimens with links to their pages."""
    rows = found["specimens"]
    own = list(dict.fromkeys(k for s in rows for k in s["own"]))
    links = tuple(
        Cell(clean(s["name"]), link=f"{quote(s['folder'])}/report.html" if s["state"] == "done" else "") for s in rows
    )
    columns = [column("Specimen", links, number=False)]
    for key in own:
        columns.append(column(clean(key.rpartition(".")[2]), words([clean(s["own"].get(key, "")) for s in rows])))
    for p in found["population"]:
        unit = _unit(found, p)
        blocks = [next((b for b in s["parameters"] if b["parameter"] == p["parameter"]), None) for s in rows]
        columns.append(column(symbol(p["parameter"]), tuple(_cell(b, unit) for b in blocks), unit.label))
        columns.append(column("90 %", words([_between(b["interval"], unit) if b else DASH for b in blocks])))
    columns.append(column("p", words([significant(s["p_value"], 2) for s in rows]), "of the fit"))
    columns.append(column("runs", words([f"{s['runs']} ({s['new_runs']})" for s in rows]), "(new)"))
    columns.append(column("state", tuple(_state(s) for s in rows), number=False))
    if any(s["note"] for s in rows):
        columns.append(column("note", words([clean(s["note"]) for s in rows]), number=False))
    note = "The name leads to the page of the specimen. In brackets: simulations that no specimen above had computed."
    return Section("specimens", "All specimens", (table("Specimens", columns, note),))


def _cell(block: Found | None, unit: Unit) -> Cell:
    if block is None:
        return Cell(DASH)
    return Cell(_number(block["value"], unit, 4), mark="warn" if block["outlier"] else "")


def _state(s: Found) -> Cell:
    if s["state"] != "done":
        return Cell(f"{s['state']}: {clean(s['reason'])}" if s["reason"] else s["state"], mark="bad")
    code = s["exit_code"]
    return Cell("done", mark="good") if not code else Cell(f"done, exit code {code}", mark="warn")


def how(found: Found) -> Section:
    """The model, its intervals, the rule for outliers."""
    return Section("how", "How this was computed", tuple(Text(t, "note") for t in POPULATION_METHOD))
