"""Validation with a surface profile: displacements of marks, measured against computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.core.digits import DASH, known
from rso.report.canvas import ACCENT, INK, LIGHT, PAPER, canvas, short, svg, tag
from rso.report.layout.digits import Unit, aligned, clean, largest, percent, quantity, shortest, shown
from rso.report.layout.document import Block, Cell, Picture, Table, column, table, words
from rso.report.reading import Results, best_candidate, candidates, number, validations

_MAX_DRAWN_DEPTHS = 8  # of a figure; the numbers are over all
_SAME_DRAWN_DEPTH_TOLERANCE = 0.03  # of the deepest: depths nearer than this are drawn as one


@dataclass(frozen=True, eq=False)
class Marks:
    """Readings of a profile that are wholly known, in mm: arrays (n,) and `place` (n, 2)."""

    depth: np.ndarray
    place: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    predicted: np.ndarray


def is_profile(e: Mapping[str, Any]) -> bool:
    """Whether an experiment is a surface profile or a point cloud, not a curve."""
    return e.get("kind") in ("profile", "surface")


def predictions(results: Results, e: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], Marks | None]]:
    """Rows of the validation with a profile, the best candidate's first; None where a run has no answer."""
    rows = validations(results, e)
    best = best_candidate(results)
    rows.sort(key=lambda v: not _is(v, best))
    return [(v, _marks(v)) for v in rows]


def profile_blocks(results: Results, e: Mapping[str, Any], picture: str) -> list[Block]:
    """The figure, if there is something to draw, and the table of a validation with a profile."""
    found = predictions(results, e)
    drawn = [(_label(results, v), m) for v, m in found if m is not None]
    blocks: list[Block] = [Picture(picture, _caption(e, *drawn[0]))] if drawn else []
    return [*blocks, _table(results, e, found)] if found else []


def profile_words(v: Mapping[str, Any]) -> str:
    """How far one candidate is off the displacements of a profile, for the first page."""
    m = _marks(v)
    if m is None:
        return ""
    rmse, nrmse = _score(v, "rmse"), percent(_score(v, "nrmse"))
    text = f": {len(m.depth)} displacements with an RMSE of {quantity(rmse, 'mm', 3)} ({nrmse} of their mean)"
    noise = _noise(m)
    return text + (f"; their own uncertainty is {quantity(noise, 'mm', 2)}" if noise else "")


def profile_figure(results: Results, e: Mapping[str, Any], name: str) -> str:
    """Displacement over the place along the profile for every depth: dots measured, lines computed."""
    m = next(m for _, m in predictions(results, e) if m is not None)
    along = int(np.ptp(m.place[:, 1]) > np.ptp(m.place[:, 0]))
    unit = shown("mm", largest([*map(float, m.measured), *map(float, m.predicted)]))
    figure = canvas(3.4)
    axes = figure.subplots()
    axes.axhline(0, color=LIGHT, lw=0.8)
    groups = _groups(m.depth)
    chosen = sorted({round(k) for k in np.linspace(0, len(groups) - 1, min(len(groups), _MAX_DRAWN_DEPTHS))})
    for k in chosen:
        rows, shade = groups[k], 0.35 + 0.65 * (k + 1) / len(groups)
        for side in np.unique(m.place[rows, 1 - along]):
            line = rows[m.place[rows, 1 - along] == side]
            line = line[np.argsort(m.place[line, along], kind="stable")]
            x = m.place[line, along]
            axes.plot(x, m.predicted[line] * unit.factor, color=ACCENT, alpha=shade, lw=1.4)
            axes.errorbar(
                x,
                m.measured[line] * unit.factor,
                m.sigma[line] * unit.factor,
                fmt="o",
                ms=3.2,
                mfc=PAPER,
                mec=INK,
                mew=0.8,
                ecolor=LIGHT,
                elinewidth=1.2,
                zorder=3,
            )
        low = rows[np.argmax(np.abs(m.predicted[rows]))]
        text = f"{shortest(float(f'{m.depth[rows].mean():.3g}'))} mm"
        tag(axes, m.place[low, along], m.predicted[low] * unit.factor, text, colour=ACCENT, offset=(9, -4), ha="left")
    axes.set(xlabel=f"{'xy'[along]} of the mark (mm)", ylabel=f"uz{unit.bracket}")
    axes.set_title(f"{short(clean(e['name']), 50)}: dots measured, lines computed", fontsize=9)
    return svg(figure, name)


def _caption(e: Mapping[str, Any], label: str, m: Marks) -> str:
    gap, k = _worst(m)
    text = f"Unused test: {clean(e['name'])}, a profile that was not used for the fit, as {label} predicts it: off by "
    text += f"at most {quantity(abs(gap), 'mm', 2)} ({_where(m, k)})."
    if m.sigma.any():
        near = int(np.sum(np.abs(m.predicted - m.measured) <= 2 * m.sigma))
        text += f" {near} of {len(m.depth)} marks lie within 2σ. Bars: ±σ."
    return text


def _table(results: Results, e: Mapping[str, Any], found: list[tuple[Mapping[str, Any], Marks | None]]) -> Table:
    best, names = best_candidate(results), [_label(results, v) for v, _ in found]
    rmse = [_score(v, "rmse") for v, _ in found]
    unit = shown("mm", largest(rmse))
    worst = [None if m is None else _worst(m) for _, m in found]
    state = [
        Cell("done") if m is not None else Cell(f"{clean(v.get('state'))}: {clean(v.get('cause'))}", mark="bad")
        for v, m in found
    ]

    def length(values: list[float | None], use: Unit, plus: bool = False) -> tuple[Cell, ...]:
        return aligned([None if x is None else x * use.factor for x in values], 3, plus=plus)

    columns = [
        column(
            "Candidate",
            tuple(Cell(n, mark="strong" if _is(v, best) else "") for n, (v, _) in zip(names, found, strict=True)),
            number=False,
        ),
        column("marks", words([str(len(m.depth)) if m is not None else DASH for _, m in found])),
        column("± σ", length([_noise(m) if m is not None else None for _, m in found], unit), unit.label),
        column("RMSE", length(rmse, unit), unit.label),
        column("NRMSE", aligned([_score(v, "nrmse") for v, _ in found], 3)),
        column("largest", length([w and w[0] for w in worst], unit, plus=True), unit.label),
        column(
            "where",
            words([_where(m, w[1]) if m is not None and w else DASH for (_, m), w in zip(found, worst, strict=True)]),
            number=False,
        ),
        column("", tuple(state), number=False),
    ]
    reasons = [f"{n}: {clean(v['reason'])}." for n, (v, _) in zip(names, found, strict=True) if v.get("reason")]
    note = "Vertical displacements (up is positive) over all marks and depths; largest: measured − predicted."
    return table(f"Unused test {clean(e['name'])}", columns, " ".join([note, *reasons]))


def _label(results: Results, v: Mapping[str, Any]) -> str:
    """The name by which the report knows the candidate of a row."""
    every = {(c.search, c.name): c.label for c in candidates(results)}
    return every.get((clean(v.get("search")), clean(v.get("candidate"))), clean(v.get("candidate")))


def _is(v: Mapping[str, Any], best: Any) -> bool:
    return best is not None and (v.get("search"), v.get("candidate")) == (best.search, best.name)


def _marks(v: Mapping[str, Any]) -> Marks | None:
    """The readings of one row of the validation that are wholly known; None if there are none."""
    keys = ("depth", "position", "measured", "sigma", "predicted")
    rows = [
        (u, *p, y, s if known(s) else 0.0, f)
        for u, p, y, s, f in zip(*(v.get(k) or () for k in keys), strict=False)
        if all(map(known, (u, y, f))) and len(p or ()) == 2 and all(map(known, p))
    ]
    if not rows:
        return None
    a = np.array(rows, float)
    return Marks(a[:, 0], a[:, 1:3], a[:, 3], a[:, 4], a[:, 5])


def _score(v: Mapping[str, Any], metric: str) -> float | None:
    return number((v.get("metrics") or {}).get(metric))


def _noise(m: Marks) -> float:
    return float(np.sqrt(np.mean(m.sigma**2)))


def _worst(m: Marks) -> tuple[float, int]:
    """Largest difference measured − predicted, and of which reading."""
    k = int(np.argmax(np.abs(m.measured - m.predicted)))
    return float(m.measured[k] - m.predicted[k]), k


def _where(m: Marks, k: int) -> str:
    x, y = (shortest(float(v)).replace("-", "−") for v in m.place[k])
    return f"({x}, {y}) at {shortest(float(m.depth[k]))} mm"


def _groups(depth: np.ndarray) -> list[np.ndarray]:
    """Rows of each depth, shallow first."""
    order = np.argsort(depth, kind="stable")
    cut = np.flatnonzero(np.diff(depth[order]) > _SAME_DRAWN_DEPTH_TOLERANCE * depth.max()) + 1
    return np.split(order, cut)
