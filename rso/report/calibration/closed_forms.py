"""What the formulas of the literature would have said: how far they are from the simulations, and where they hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter, MaxNLocator

from rso.core.digits import DASH, NBSP, fixed, known, significant
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, WARM, canvas, svg
from rso.report.layout.digits import clean, shown
from rso.report.layout.document import Block, Cell, Picture, Section, Text, column, table, words
from rso.report.reading import Results, experiment, listed

CLOSE_FORMULA_TOLERANCE = 0.05  # of the force: a formula this near is as good as most tests
MAX_DRAWN_FORMULA_ERROR = 0.6  # of the force: the figure shows no more
TABLED_DEPTH_SHARES = (0.25, 0.5, 1.0)  # of the deepest reading
_FORMULA_COLOURS = (ACCENT, WARM, INK, GREY, "#5f8f3e", "#8a5a9c", "#b59a2c")


def closed_form_sections(results: Results) -> tuple[Section, ...]:
    """The section on closed forms; none where there are none or nobody compared them."""
    rows = _rows(results)
    if not rows:
        return ()
    blocks: list[Block] = []
    for k, row in enumerate(rows):
        blocks.append(Text(_sentence(row), "lead" if k == 0 else "plain"))
        blocks.append(Picture(f"formulas-{k}", _caption(row)))
        blocks.append(_table(results, row))
    return (Section("formulas", "What the simple formula would have said", tuple(blocks)),)


def closed_form_figure(results: Results, k: int, name: str) -> str:
    """Each formula over the simulation, full where it holds, dashed where it does not."""
    row = _rows(results)[k]
    depth, simulated = np.asarray(row["depth"], float), np.asarray(row["simulated"], float)
    unit = shown("mm", float(depth.max()))
    figure = canvas(2.6)
    axes = figure.subplots()
    axes.axhspan(-100 * CLOSE_FORMULA_TOLERANCE, 100 * CLOSE_FORMULA_TOLERANCE, color=LIGHT, alpha=0.5, lw=0)
    axes.axhline(0.0, color=GREY, lw=0.8)
    x = depth * unit.factor
    if (own := _own_error(row)) is not None:
        axes.plot(x, 100.0 * own, x, -100.0 * own, color=GREY, lw=0.8, ls=":")
    for f, colour in zip(row["formulas"], _FORMULA_COLOURS * 3, strict=False):
        off = 100.0 * (_force(f) / simulated - 1.0)
        off[np.abs(off) > 100.0 * MAX_DRAWN_FORMULA_ERROR] = np.nan
        if not np.isfinite(off).any():
            continue
        holds = np.array([not why for why in f["invalid"]])
        axes.plot(x, off, color=colour, lw=1.0, ls=(0, (3, 2)))
        axes.plot(x, np.where(holds, off, np.nan), color=colour, lw=2.2, marker="o", ms=2.5, label=clean(f["name"]))
    axes.set_xlabel(f"depth{unit.bracket}")
    axes.set_ylabel("force over the simulation")
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:+.0f}{NBSP}%".replace("-", "−").replace("+0", "0")))
    axes.margins(x=0.02)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    return svg(figure, name)


def _rows(results: Results) -> list[Mapping[str, Any]]:
    return [r for r in listed(results, "formulas") if r.get("formulas") and r.get("depth")]


def _force(f: Mapping[str, Any]) -> np.ndarray:
    return np.array([v if known(v) else np.nan for v in f["force"]], float)


def _off(row: Mapping[str, Any], f: Mapping[str, Any]) -> np.ndarray:
    """Force over the simulated one minus 1 (n,)."""
    off: np.ndarray = _force(f) / np.asarray(row["simulated"], float) - 1.0
    return off


def _own_error(row: Mapping[str, Any]) -> np.ndarray | None:
    """Estimated numerical error of the simulation over its force (n,); None where it states none."""
    if not row.get("error"):
        return None
    return np.array([v if known(v) else np.nan for v in row["error"]], float) / np.asarray(row["simulated"], float)


def _near(row: Mapping[str, Any], f: Mapping[str, Any]) -> float:
    """Depth (mm) up to which a formula is within CLOSE_FORMULA_TOLERANCE of the simulation, 0 where it never is."""
    within = np.abs(np.nan_to_num(_off(row, f), nan=np.inf)) <= CLOSE_FORMULA_TOLERANCE
    count = len(within) if within.all() else int(np.argmin(within))
    return float(row["depth"][count - 1]) if count else 0.0


def _sentence(row: Mapping[str, Any]) -> str:
    """When the simple formula is enough."""
    name, deepest, first = clean(row["experiment"]), float(row["depth"][-1]), row["formulas"][0]
    off, said = float(_off(row, first)[-1]), f"{name}: {clean(first['name'])} has no force at {_length(deepest)}"
    if np.isfinite(off):
        where = "above" if off > 0.0 else "below"
        size = _percent(abs(off)).lstrip("+")
        said = f"{name}: at {_length(deepest)}, {clean(first['name'])} is {size} {where} the simulated force"
    if known(first.get("modulus")):
        said += f"; from these readings it would give {_times(first['modulus'])} the modulus"
    band = f"within {100 * CLOSE_FORMULA_TOLERANCE:.0f}{NBSP}% of the simulation"
    best = max(row["formulas"], key=lambda f: _near(row, f))  # the first, that is the simplest, of equals
    near = _near(row, best)
    if near >= deepest * (1.0 - 1e-9):
        return f"{said}. {clean(best['name'])} is enough for these data: {band} to the deepest reading."
    if not near:
        return f"{said}. No formula is {band} from the first depth on."
    return f"{said}. No formula is {band} to the deepest reading; {clean(best['name'])} is to {_length(near)}."


def _caption(row: Mapping[str, Any]) -> str:
    own = "" if _own_error(row) is None else " Dotted: the estimated numerical error of the simulation itself."
    band = f"±{100 * CLOSE_FORMULA_TOLERANCE:.0f}{NBSP}%"
    return (
        f"{clean(row['experiment'])}: force of each formula over that of the best candidate, at its parameters. Full "
        f"where the formula claims to hold, dashed where it does not; the band is {band}. "
        f"Beyond ±{100 * MAX_DRAWN_FORMULA_ERROR:.0f}{NBSP}% nothing is drawn.{own}"
    )


def _table(results: Results, row: Mapping[str, Any]) -> Block:
    """One line per formula."""
    depth = np.asarray(row["depth"], float)
    at = [int(np.argmin(np.abs(depth - s * depth[-1]))) for s in TABLED_DEPTH_SHARES]
    forms = row["formulas"]
    columns = [
        column("Formula", words([clean(f["name"]) for f in forms]), number=False),
        *(
            column(f"at {_length(float(depth[k]))}", tuple(Cell(_percent(float(_off(row, f)[k]))) for f in forms))
            for k in at
        ),
        column("modulus", words([_times(f["modulus"]) if known(f.get("modulus")) else DASH for f in forms])),
        column("holds", words([_holds(row, f) for f in forms]), number=False),
        column("source", words([clean(f["source"]) for f in forms]), number=False),
    ]
    unit = experiment(results, row["experiment"]).get("unit", "N")
    note = (
        f"Columns by depth: force ({clean(unit)}) over the simulated one, less 1. Modulus: that of the formula over "
        "that of the best candidate, at the same Poisson ratio."
    )
    return table(f"Formulas for {clean(row['experiment'])}", columns, note)


def _holds(row: Mapping[str, Any], f: Mapping[str, Any]) -> str:
    """Where a formula claims to hold, and why not beyond."""
    holds = [not why for why in f["invalid"]]
    if all(holds):
        return "to the deepest reading"
    if not any(holds):
        return f"not here: {clean(f['invalid'][0])}"
    last = len(holds) - 1 - holds[::-1].index(True)
    first = holds.index(True)
    if last == len(holds) - 1:
        return f"from {_length(float(row['depth'][first]))}"
    return f"to {_length(float(row['depth'][last]))}; then {clean(f['invalid'][last + 1])}"


def _length(mm: float) -> str:
    unit = shown("mm", mm)
    return f"{significant(mm * unit.factor, 2)}{unit.after}"


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return DASH
    if share >= 1.0:
        return f"×{NBSP}{significant(1.0 + share, 2)}"
    return f"{'+' if share > 0 else ''}{fixed(100.0 * share, 1)}{NBSP}%"


def _times(ratio: float) -> str:
    return f"{fixed(ratio, 2)}{NBSP}times"
