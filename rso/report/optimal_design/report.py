"""The report of what further experiments would show: the answer, every experiment and pair, what has been done."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rso.core import disk
from rso.core.digits import DASH, known, significant
from rso.core.symbols import in_letters
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PAPER, WARM, canvas, plain_log, short, style, svg
from rso.report.exact_sizes import exact_sizes
from rso.report.language import PageOptions, names_of, write_page
from rso.report.layout.byline import byline
from rso.report.layout.digits import clean, duration, quantity, sentence, shown, symbol
from rso.report.layout.document import Block, Cell, Picture, Report, Section, Table, Text, column, table, words
from rso.report.layout.page import pictures
from rso.report.model_selection.report import interval_text, value_text
from rso.report.reading import listed, number
from rso.report.sketch import SKETCH_PICTURE, sketch_blocks, sketch_figure

Found = Mapping[str, Any]
MAX_PAIR_ROWS = 12  # pairs in the table
TRUTH_SHADES = ("#9ecae1", "#6baed6", "#3182bd", "#0b5a7d", "#08306b", "#4a1486", "#7a0177")


def render_next(found: Found, folder: Path, **options: Unpack[PageOptions]) -> list[Path]:
    """Write next.html, next.pdf and next.svg into `folder` from the plain data of next.json; list of files.

    The same data give the same bytes. In another `language` the pages alone are written, as next.de.html.
    """
    document = report(found)
    drawn = functools.cache(lambda n: draw(found, n))
    files = write_page(document, drawn, folder, "next", names_of(found), options)
    if "sizes" in pictures(document) and options.get("language", "en") == "en":
        path = folder / "next.svg"
        # On its own it needs a ground: readers' pages may be dark.
        head, rest = drawn("sizes").split(">", 1)
        ground = f'{head}><rect width="100%" height="100%" fill="{PAPER}"/>'
        files.append(disk.replace(path, ground + rest))
    return files


def report(found: Found) -> Report:
    """The whole document."""
    heading = clean((found.get("study") or {}).get("title")) or "Untitled study"
    parts = (answer(found), two(found), exists(found), how(found))
    return Report(heading, f"Which experiment would constrain {_focus(found)} best?", byline(found), parts)


def _focus(found: Found) -> str:
    return symbol(clean(found.get("focus")))


def _unit(found: Found) -> str:
    rows = [p for p in listed(found, "parameters") if p.get("name") == found.get("focus")]
    return shown(clean(rows[0].get("unit"))).after if rows else ""


def _truths(found: Found) -> list[float]:
    return [float(t[found["focus"]]) for t in listed(found, "truths")]


def rows_of(found: Found, size: int) -> list[Mapping[str, Any]]:
    """Sets of so many added experiments, best first."""
    return [r for r in listed(found, "told") if len(r.get("added") or ()) == size]


def size_at(found: Found, row: Mapping[str, Any], which: str = "expected") -> list[float]:
    """sd of ln θ of the weakest parameter, truth by truth; `expected`: of simulated data where there are some."""
    out = []
    for at in row.get("at") or ():
        values = at.get(which) or at.get("fisher") or {}
        out.append(float(values.get(found["focus"]) or math.nan))
    return out


def answer(found: Found) -> Section:
    """Section 1: in words, every experiment in a line, the picture."""
    now, *more = listed_words(found) or [""]
    said = [*more[:1], now, *more[1:]]
    names = [clean(p.get("name")) for p in listed(found, "parameters")]
    said = [sentence(in_letters(w, names)) for w in said if w]
    blocks: list[Block] = [Text(w, "plain" if k or not more else "lead") for k, w in enumerate(said)]
    blocks += sketch_blocks(found)
    rows = [*rows_of(found, 0), *rows_of(found, 1)]
    titles = [r["added"][0] if r.get("added") else "only what has been done" for r in rows]
    blocks.append(
        Picture(
            "sizes",
            f"Expected uncertainty of {_focus(found)} after each experiment, for different true values. Filled: "
            "simulated data; ring: Fisher information; left of the line it would be determined.",
        )
    )
    blocks.append(_table(found, "Each experiment", rows, titles))
    blocks += exact_sizes(found, bool(found.get("stated_inputs")))
    blocks[1:1] = [Text(sentence(in_letters(clean(w), names)), "warning") for w in found.get("warnings") or ()]
    for name, why in (found.get("problems") or {}).items():
        blocks.append(Text(sentence(f"{name} has no answer: {why}"), "warning"))
    return Section("answer", "Answer", tuple(blocks))


def listed_words(found: Found) -> list[str]:
    """The sentences of the answer, the one about the best experiment second."""
    return [clean(w) for w in found.get("words") or ()]


def _table(found: Found, title: str, rows: Sequence[Mapping[str, Any]], titles: Sequence[str]) -> Table:
    enough, unit = number(found.get("enough")) or 0.34, _unit(found)
    columns = [column("Added", words([short(clean(t), 44) for t in titles]), number=False)]
    for k, truth in enumerate(_truths(found)):
        cells = []
        for r in rows:
            sd = size_at(found, r)[k]
            cells.append(Cell(factor(sd), mark="good" if sd <= enough else ""))
        heading = f"if {_focus(found)} = {significant(truth, 3)}" if k == 0 else significant(truth, 3)
        columns.append(column(heading, tuple(cells), unit.strip()))
    note = (
        "One standard deviation after all tests so far and the added one, from simulated data; a factor either "
        "way, or per cent. "
    )
    note += "Marked with a dot: a 90 % interval would be a value, within a factor of 1.75 either way."
    return table(title, columns, note)


def factor(sd: float | None) -> str:
    """sd of ln θ as people say it."""
    if not known(sd):
        return DASH
    return f"{100 * sd:.2g} %" if sd < 0.2 else f"× {math.exp(sd):.2f}"


def two(found: Found) -> Section:
    """Section 2: pairs."""
    rows = rows_of(found, 2)[:MAX_PAIR_ROWS]
    if not rows:
        return Section("two", "Two experiments", (Text("No two experiments were asked about.", "missing"),))
    titles = [" + ".join(r["added"]) for r in rows]
    return Section("two", "Two experiments", (_table(found, "The best pairs", rows, titles),))


def alone(found: Found) -> list[Table]:
    """What each experiment would show by itself, and what of the other parameters."""
    rows = [r for r in rows_of(found, 1) if not r["added"][0].endswith("once more")]
    truths, unit, out = _truths(found), _unit(found).strip(), []
    asked = [("alone", found["focus"], f"{_focus(found)} from one experiment alone")]
    asked += [
        ("expected", p["name"], f"{symbol(p['name'])}, with what has been done")
        for p in listed(found, "parameters")
        if p["name"] != found["focus"]
    ]
    for which, name, title in asked:
        columns = [column("Experiment", words([r["added"][0] for r in rows]), number=False)]
        for k, truth in enumerate(truths):
            cells = words([factor(number((r["at"][k].get(which) or r["at"][k]["fisher"]).get(name))) for r in rows])
            head = f"if {_focus(found)} = {significant(truth, 3)}" if k == 0 else significant(truth, 3)
            columns.append(column(head, cells, unit))
        note = "By Fisher information, the range of the study counted as known." if which == "alone" else ""
        out.append(table(title, columns, note, folded=True))
    return out


def exists(found: Found) -> Section:
    """Section 3: what the experiments done say, each alone and together."""
    rows = [(f, p) for f in listed(found, "fits") for p in f.get("parameters") or ()]
    units = {p["name"]: clean(p.get("unit")) for p in listed(found, "parameters")}
    shapes = [shown(units.get(p["name"], ""), number(p.get("value"))) for _, p in rows]
    columns = [
        column("Fitted together", words([" + ".join(f.get("experiments") or ()) for f, _ in rows]), number=False),
        column("", words([symbol(p["name"]) for _, p in rows]), number=False),
        column("value", words([value_text(p, u) for u, (_, p) in zip(shapes, rows, strict=True)])),
        column("90 % interval", words([interval_text(p, u) for u, (_, p) in zip(shapes, rows, strict=True)])),
        column("", tuple(_word(p.get("verdict")) for _, p in rows), number=False),
        column("χ² / ν", words([f"{significant(number(f.get('chi2')), 3)} / {f.get('degrees')}" for f, _ in rows])),
    ]
    note = "Profile likelihood; where the misfit is more than noise explains, intervals are widened by it."
    return Section("done", "What has been done", (table("Fits", columns, note),))


def _word(word: Any) -> Cell:
    marks = {"determined": Cell("determined", mark="good"), "weakly": Cell("weakly", mark="warn")}
    return marks.get(clean(word), Cell("not determined", mark="quiet"))


def how(found: Found) -> Section:
    """Section 4: method and cost."""
    units = {p["name"]: clean(p.get("unit")) for p in listed(found, "parameters")}
    truths = [
        ", ".join(f"{symbol(k)} = {quantity(float(v), units.get(k, ''), 3)}" for k, v in t.items())
        for t in listed(found, "truths")
    ]
    text = (
        "Each experiment is simulated over the whole range and emulated with its derivatives. At every assumed "
        f"true value, data of all experiments are simulated {found.get('draws')} times with stated, numerical and "
        "emulator errors. They are inferred together with the tests done so far, and the spread of the posterior "
        "is averaged. Fisher information gives the same at no cost where the problem is linear. Sensor gain and "
        "numerical error are drawn for every experiment. The model is assumed to be right: an unknown support or "
        "another law is in no number here. An interval that ends at an end of the searched range is limited by "
        "that range, not by the data."
    )
    rows = listed(found, "experiments")
    columns = [
        column("Experiment", words([clean(r.get("name")) for r in rows]), number=False),
        column("", words([clean(r.get("words")) or ("done" if r.get("done") else "") for r in rows]), number=False),
        column("channels", words([", ".join(r.get("channels") or ()) for r in rows]), number=False),
        column("readings", words([f"{r.get('readings')}" for r in rows])),
        column("runs", words([f"{r.get('runs')}" for r in rows])),
        column("CPU", words([duration(number(r.get("cpu_s"))) for r in rows])),
        column("left out", words([f"{100 * float(r.get('left_out') or 0):.1g} %" for r in rows])),
    ]
    note = "Left out: an inner run predicted by its neighbours, over the largest value."
    return Section(
        "how",
        "How this was found",
        (
            Text(text),
            Text(f"Truths: {'; '.join(truths)}.", "note"),
            table("Experiments", columns, note),
            *alone(found),
        ),
    )


def draw(found: Found, name: str) -> str:
    """The figure of that name; ValueError for an unknown one."""
    if name not in ("sizes", SKETCH_PICTURE):
        raise ValueError(f"no figure {name!r}")
    with style():
        if name == SKETCH_PICTURE:
            return sketch_figure(found)
        return svg(sizes(found), name)


def sizes(found: Found) -> Figure:
    """One row per experiment, one mark per truth: how well the weakest parameter would be known."""
    rows = [*rows_of(found, 0), *rows_of(found, 1), *rows_of(found, 2)[:3]]
    figure = canvas(1.0 + 0.27 * len(rows))
    axes, truths = figure.subplots(), _truths(found)
    shades = [TRUTH_SHADES[round(k * (len(TRUTH_SHADES) - 1) / max(len(truths) - 1, 1))] for k in range(len(truths))]
    enough = number(found.get("enough")) or 0.34
    every = [v for r in rows for w in ("expected", "fisher") for v in size_at(found, r, w) if v > 0]
    low, high = 0.7 * min([*every, enough]), 1.3 * max([*every, enough])
    axes.axvspan(low, enough, color="#e9f1ee", lw=0, zorder=0)
    axes.axvline(enough, color=GREY, lw=0.8, zorder=1)
    y = 0.0
    ticks: list[float] = []
    labels: list[str] = []
    for r in rows:
        size = len(r["added"])
        y -= 1.0 if not ticks or size == len(rows[len(ticks) - 1]["added"]) else 1.5
        full, rings = size_at(found, r), size_at(found, r, "fisher")
        axes.plot([min(full), max(full)], [y, y], color=LIGHT, lw=1.2, zorder=1)
        for k, shade in enumerate(shades):
            axes.plot([rings[k]], [y], "o", ms=6.5, mfc="none", mec=shade, mew=0.8, zorder=2)
            axes.plot([full[k]], [y], "o", ms=4.6, mfc=shade, mec=PAPER, mew=0.4, zorder=3)
        ticks.append(y)
        labels.append(short(" + ".join(r["added"]), 40) if size else "only what has been done")
    axes.set_yticks(ticks, labels)
    best = [tuple(v) for v in ((found.get("best") or {}).get("one"), (found.get("best") or {}).get("two")) if v]
    for tick, r in zip(axes.get_yticklabels(), rows, strict=True):
        chosen = tuple(r["added"]) in best
        tick.set_color(ACCENT if chosen else INK)
        tick.set_fontweight("bold" if chosen else "normal")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xscale("log")
    axes.set(xlim=(low, high), ylim=(y - 0.8, -0.3))
    plain_log(axes.xaxis)
    focus = _focus(found)
    axes.set_xlabel(f"standard deviation of ln {focus}  (0.1: ±10 %, 0.7: a factor 2)")
    for side, text, colour in (("right", "determined", GREY), ("left", "not determined", WARM)):
        offset = (-4 if side == "right" else 4, 0)
        axes.annotate(
            text,
            (enough, -0.35),
            xytext=offset,
            textcoords="offset points",
            ha=side,
            va="bottom",
            fontsize=7.5,
            color=colour,
        )
    handles = [Line2D([], [], ls="none", marker="o", ms=5, mfc=c, mec=PAPER) for c in shades]
    texts = [f"{significant(t, 3)}".rstrip("0").rstrip(".") if t < 1 else f"{t:.3g}" for t in truths]
    figure.legend(
        handles,
        texts,
        title=f"true {focus}{shown(_raw_unit(found)).bracket}",
        loc="outside right upper",
        frameon=False,
        fontsize=8,
        title_fontsize=8,
    )
    return figure


def _raw_unit(found: Found) -> str:
    rows = [p for p in listed(found, "parameters") if p.get("name") == found.get("focus")]
    return clean(rows[0].get("unit")) if rows else ""
