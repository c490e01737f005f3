"""Draws docs/figures/readme.png: stress in a pressed gel, and the fit: `python docs/figures/readme.py`.

The study studies/gel_slab is run for it (a minute) unless its results are there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

import rso
from fem_backend import output, post
from fem_backend.backend import BACKEND

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).with_suffix(".png")
INK, ACCENT = "#23272b", "#0b5a7d"
WIDE = 9.0  # mm to either side of the axis


def main() -> None:
    """Both panels."""
    study = rso.load(ROOT / "studies" / "gel_slab", folder=sys.argv[1] if len(sys.argv) > 1 else None)
    try:
        found = study.result
    except FileNotFoundError:
        found = study.run(progress=print)
    values = found.parameters["value"].to_dict()
    case = study.plan.cases[study.plan.case_of["thin"]]
    plt.rcParams.update({"font.size": 9, "axes.edgecolor": "#7b8085", "text.color": INK, "axes.labelcolor": INK})
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 2.9), width_ratios=[1.45, 1.0], layout="constrained")
    stress(left, figure, values, case)
    fit(right, found)
    figure.savefig(FILE, dpi=110)


def stress(axes: plt.Axes, figure: plt.Figure, values: dict[str, float], case: object) -> None:
    """Von Mises stress of the thin gel at full depth, the ball above it."""
    solved = BACKEND.solve(values, case)
    point = solved.result.points[-1]
    body = solved.on(point).system.body
    nodal = post.nodal(body, output.state_fields(solved, point))
    at = body.nodes + point.evaluation.u
    triangles = np.asarray(body.cells)[:, :3]
    kpa = 1e3 * np.asarray(nodal.von_mises)
    levels = np.linspace(0.0, float(np.percentile(kpa, 99.7)), 22)
    for side in (1.0, -1.0):
        shown = axes.tricontourf(side * at[:, 0], at[:, 2], triangles, kpa, levels=levels, cmap="viridis", extend="max")
    radius = float(case.settings["indenter"]["radius"])
    lowest = at[np.argmin(np.abs(at[:, 0]) - 1e-3 * at[:, 2]), 2]
    axes.add_patch(plt.Circle((0.0, lowest + radius), radius, color="#c9ccca", ec=INK, lw=0.8, zorder=3))
    axes.set(aspect="equal", xlim=(-WIDE, WIDE), ylim=(0.0, lowest + 1.6 * radius), xlabel="r (mm)", ylabel="z (mm)")
    axes.set_title(f"Simulated: {point.travel:.2g} mm deep", loc="left", fontsize=9)
    bar = figure.colorbar(shown, ax=axes, label="von Mises stress (kPa)", shrink=0.9)
    bar.set_ticks([round(float(t)) for t in np.linspace(levels[0], levels[-1], 4)])


def fit(axes: plt.Axes, found: rso.RunResult) -> None:
    """Readings of both gels and the best candidate."""
    curves = found.curves[found.curves["channel"] == "Fz"]
    best = curves["what"][curves["what"] != "measured"].iloc[0]
    for name, colour in (("thin", ACCENT), ("thick", "#b4481e")):
        of = curves[curves["experiment"] == name]
        m, c = of[of["what"] == "measured"], of[of["what"] == best]
        axes.plot(m["depth"], 1e3 * m["value"], "o", ms=3.2, mfc="none", color=colour, label=f"{name} gel, measured")
        axes.plot(c["depth"], 1e3 * c["value"], "-", lw=1.4, color=colour)
    axes.set(xlabel="depth (mm)", ylabel="force (mN)", xlim=(0, None), ylim=(0, None))
    p = found.parameters.loc["mu"]
    span = f"{1e3 * p['low']:.3g} to {1e3 * p['high']:.3g} kPa"
    axes.set_title(f"Identified: μ = {1e3 * p['value']:.3g} kPa ({span})", loc="left", fontsize=9)
    axes.legend(frameon=False, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
