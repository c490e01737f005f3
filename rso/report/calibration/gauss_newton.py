"""The document's section on Gauss–Newton: every point that was run, what was expected of it, and what came out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.ticker import FuncFormatter

from rso.core.digits import DASH, known, significant
from rso.report.canvas import ACCENT, GREY, PAPER, WARM, canvas, plain_log, svg
from rso.report.layout.digits import aligned, clean, percent, shortest
from rso.report.layout.document import Block, Cell, Picture, Section, Table, Text, column, table, words
from rso.report.reading import Results, number, parameters


def gauss_newton_starts(results: Results) -> list[Mapping[str, Any]]:
    """Every descent; none where response surfaces were searched."""
    return list((results.get("descent") or {}).get("descents") or ())


def gauss_newton_section(results: Results) -> Section:
    """How the parameters were found straight on simulations."""
    every = gauss_newton_starts(results)
    data = results.get("descent") or {}
    whose = "differences between runs" if data.get("derivatives") == "differences" else "the backend's derivatives"
    lead = (
        "No response surface was built. Each iterate minimises the misfit predicted from all runs so far and "
        f"{whose}, near the best run; the full model is then run there. The iteration ends when a run agrees with "
        "its prediction and no step would gain more."
    )
    blocks: list[Block] = [Text(lead)]
    if any(len(d.get("iterates") or ()) > 1 for d in every):
        blocks.append(Picture("descent", _caption(results, every)))
    blocks += [_table(results, d, len(every)) for d in every]
    return Section("descent", "Gauss–Newton, point by point", tuple(blocks))


def _caption(results: Results, every: list[Mapping[str, Any]]) -> str:
    best = next((d for d in every if d.get("best")), every[0])
    walk = best.get("iterates") or ()
    last = number(walk[-1].get("agreement")) if walk else None
    end = "" if last is None else f"; its last run is {percent(last)} of the curve off its prediction"
    limit = percent(number((results.get("verify") or {}).get("tolerance")))
    return (
        f"The best descent took {len(walk)} points{end}. Left: misfit of every run (filled) and what was expected of "
        f"it (open). Right: how far the run was from its prediction; dashed: the tolerance of {limit}."
    )


def _table(results: Results, d: Mapping[str, Any], count: int) -> Table:
    walk = list(d.get("iterates") or ())
    columns = [column("Run", words([shortest(i.get("number")) for i in walk]))]
    for p in parameters(results, free=True):
        values = [number((i.get("values") or {}).get(p.name)) for i in walk]
        columns.append(
            column(p.letter, aligned([None if v is None else v * p.unit.factor for v in values]), p.unit.label)
        )
    columns += [
        column("expected", words([significant(number(i.get("expected")), 3) for i in walk]), "χ²"),
        column("found", words([significant(number(i.get("chi2")), 3) for i in walk]), "χ²"),
        column("off its prediction", words([percent(number(i.get("agreement"))) for i in walk])),
        column("step", words([percent(number(i.get("step"))) for i in walk]), "of the range"),
        column("", tuple(_word(i) for i in walk), number=False),
    ]
    title = "Every point" if count == 1 else f"Start {shortest(d.get('start'))}{', the best' if d.get('best') else ''}"
    end = "confirmed" if d.get("verified") else f"not confirmed: {clean(d.get('why')) or DASH}"
    note = f"It ended {end}. A step is the largest change of a parameter after similarity."
    return table(title, columns, note)


def _word(i: Mapping[str, Any]) -> Cell:
    if i.get("state") != "done":
        return Cell("no answer", mark="bad")
    return Cell("best so far", mark="good") if i.get("better") else Cell("not better", mark="quiet")


def gauss_newton_figure(results: Results, name: str) -> str:
    """Misfit, and how far each run was from its prediction, over the runs of every descent."""
    figure = canvas(2.2)
    left, right = figure.subplots(1, 2)
    tolerance = number((results.get("verify") or {}).get("tolerance"))
    for d in gauss_newton_starts(results):
        colour = ACCENT if d.get("best") else GREY
        walk = [i for i in d.get("iterates") or () if known(i.get("number"))]
        marks = (left, "expected", 1, False), (left, "chi2", 1, True), (right, "agreement", 100, True)
        for axes, key, factor, full in marks:
            rows = [(i["number"], factor * i[key]) for i in walk if known(i.get(key)) and i[key] > 0]
            if rows:
                x, y = zip(*rows, strict=True)
                axes.plot(x, y, marker="o", ls="-" if full else "", ms=4, color=colour, mfc=colour if full else PAPER)
    for axes, label in ((left, "χ²"), (right, "off its prediction (%)")):
        axes.set(xlabel="run", ylabel=label, yscale="log")
        axes.xaxis.get_major_locator().set_params(integer=True)
        low, high = axes.get_ylim()
        if high / low < 1e3:
            plain_log(axes.yaxis)
        else:
            axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.6g}"))
    if tolerance:
        right.axhline(100 * tolerance, color=WARM, lw=0.8, ls="--")
    return svg(figure, name)
