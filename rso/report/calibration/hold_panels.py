"""A hold over the logarithm of time, and what candidates leave of it: force beside the loading, or creep by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from scipy.interpolate import PchipInterpolator

from rso.report.canvas import ACCENT, FITTED_LABEL, GREY, INK, LIGHT, PAPER, SD_OF_90_PERCENT, SHADE, Look, short, tag
from rso.report.layout.digits import Unit, shortest
from rso.report.reading import BandView, CandidateView, at_rest, number, points

N_DRAWN_HOLD_POINTS = 81  # points of a drawn curve
BEST_CANDIDATE_LOOK: Look = {"color": ACCENT, "lw": 1.6, "zorder": 3}
OTHER_CANDIDATE_LOOK: Look = {"color": GREY, "lw": 0.6, "zorder": 1}
UNFITTED_BEST_LOOK: Look = {"color": ACCENT, "lw": 0.8, "ls": (0, (4, 2)), "zorder": 2}


@dataclass(frozen=True, eq=False)
class Resting:
    """A hold at a depth (mm) as it is drawn: values (m,) with σ at times (m,) s; by candidate times, values, errors."""

    depth: float
    t: np.ndarray
    y: np.ndarray
    sigma: np.ndarray
    simulated: Sequence[tuple[CandidateView, np.ndarray, np.ndarray, np.ndarray]]
    band: BandView | None = None

    @staticmethod
    def of(
        measured: Mapping[str, Any],
        simulated: Sequence[tuple[CandidateView, Sequence[float], Sequence[float], Sequence[Any]]],
        band: BandView | None = None,
    ) -> Resting | None:
        """None where there are no readings of a hold."""
        m = at_rest(measured)
        t, y = (np.array(v) for v in points(m.get("since"), m.get("value", m.get("measured"))))
        if not len(t):
            return None
        s = points(m.get("since"), m.get("sigma"))[1]
        sigma = np.array(s) if len(s) == len(t) else np.zeros(len(t))
        rows = [
            (c, np.array(x), np.array(f), np.array([number(v) or 0.0 for v in e] or [0.0] * len(x)))
            for c, x, f, e in simulated
            if len(x) > 1
        ]
        held = None if band is None or len(band.hold.since) < 2 else band.hold
        return Resting(float(m["depth"][0]), t, y, sigma, sorted(rows, key=lambda row: row[0].best), held)


def draw_creep(figure: Figure, hold: Resting, unit: Unit, fine: Unit, title: str) -> None:
    """Depth over the logarithm of time while a force is held, and what candidates leave of it."""
    rows = 2 if hold.simulated else 1
    grid = figure.subplots(rows, 1, sharex="col", squeeze=False, height_ratios=[2.6, 1][:rows])
    rest = grid[1, 0] if rows == 2 else None
    draw_resting(grid[0, 0], rest, hold, unit, fine, title)
    grid[0, 0].set_ylabel(f"depth{unit.bracket}")
    if rest is not None:
        rest.set_ylabel(f"measured −\nsimulated{fine.bracket}")
        rest.yaxis.set_major_locator(MaxNLocator(5))
    k = len(hold.t) // 2
    tag(grid[0, 0], hold.t[k], hold.y[k] * unit.factor, "measured ± σ", offset=(-12, 9), ha="right")
    for c, x, f, _ in hold.simulated[-1:]:
        j = int(np.argmin(np.abs(np.log(x) - np.log(hold.t[k + len(hold.t) // 4]))))
        tag(grid[0, 0], x[j], f[j] * unit.factor, short(c.label), colour=ACCENT, offset=(12, -9), ha="left")


def left_of(hold: Resting) -> list[float]:
    """Measured less simulated at the moments of a hold, of all candidates."""
    return [float(v) for _, x, f, _ in hold.simulated for v in hold.y - np.interp(hold.t, x, f)]


def draw_resting(
    axes: Axes, rest: Axes | None, hold: Resting, unit: Unit, fine: Unit, title: str | None = None
) -> None:
    """A hold over the logarithm of time, and what is left of it."""
    t, y, s = hold.t, hold.y * unit.factor, hold.sigma * unit.factor
    band = hold.band
    if band is None:
        axes.fill_between(t, y - s, y + s, color=LIGHT, lw=0, alpha=0.75)
    else:
        at, wide = band.since, SD_OF_90_PERCENT * band.sd * unit.factor
        axes.fill_between(at, band.value * unit.factor - wide, band.value * unit.factor + wide, **SHADE)
        axes.plot(at, band.value * unit.factor, label=FITTED_LABEL, **BEST_CANDIDATE_LOOK)
    axes.plot(t, y, "o", ms=3.2, mfc=PAPER, mec=INK, mew=0.8, label="measured")
    for c, x, f, _ in hold.simulated:
        at = np.geomspace(x[0], x[-1], N_DRAWN_HOLD_POINTS)
        look = OTHER_CANDIDATE_LOOK if not c.best else BEST_CANDIDATE_LOOK if band is None else UNFITTED_BEST_LOOK
        axes.plot(at, PchipInterpolator(np.log(x), f * unit.factor)(np.log(at)), **look)
    axes.set_xscale("log")
    axes.set_title(f"held at {shortest(float(f'{hold.depth:.3g}'))} mm" if title is None else title, color=GREY)
    if rest is not None:
        s = hold.sigma * fine.factor
        if band is None:
            rest.fill_between(t, -s, s, color=LIGHT, lw=0, alpha=0.75)
        else:
            wide = SD_OF_90_PERCENT * band.sd * fine.factor
            rest.fill_between(band.since, -wide, wide, **SHADE)
            rest.plot(
                t,
                (hold.y - np.interp(t, band.since, band.value)) * fine.factor,
                label=FITTED_LABEL,
                **BEST_CANDIDATE_LOOK,
            )
        rest.axhline(0, color=INK, lw=0.7)
        for c, x, f, error in hold.simulated:
            left, wide = (hold.y - np.interp(t, x, f)) * fine.factor, np.interp(t, x, error) * fine.factor
            rest.plot(
                t,
                left,
                **(OTHER_CANDIDATE_LOOK if not c.best else BEST_CANDIDATE_LOOK if band is None else UNFITTED_BEST_LOOK),
            )
            if c.best and wide.any() and band is None:
                rest.fill_between(t, left - wide, left + wide, color=ACCENT, alpha=0.25, lw=0)
    below = axes if rest is None else rest
    _seconds(below, t)
    below.set_xlabel("time at rest (s)")


def _seconds(axes: Axes, t: np.ndarray) -> None:
    """Few ticks on the logarithm of times: at decades, and at 1, 2, 5 where these are few."""
    subs = (1.0,) if t[-1] / t[0] > 50.0 else (1.0, 2.0, 5.0)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.6g}"))
    axes.xaxis.set_minor_locator(NullLocator())
