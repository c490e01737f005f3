"""Figure of the reconstruction: the curve between the simulations, and printed against reconstructed norms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from trilateration import Curve, Lists, crossings

from rso.norms import TrilaterationProblem

INK, COLOURS = "#222222", {1: "#0072b2", 3: "#d55e00", 4: "#009e73"}


def draw(
    file: Path, data: Lists, final: Curve, p: TrilaterationProblem, curve: Curve, alone: tuple[np.ndarray, np.ndarray]
) -> None:
    """Write the figure; `alone` is the MRE list (43,) as predicted from the NRMSE list only, and its deviation."""
    figure = Figure(figsize=(10.5, 4.2), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    some = curve.x[::20]
    f = np.mean(p.known(p.split(some)[1]), axis=0)
    last = len(data.theta) - 5
    u, y = final.u, final.mean
    left.fill_between(u, y - 2 * final.sd, y + 2 * final.sd, color=INK, alpha=0.25, lw=0, label="twice its uncertainty")
    left.plot(u, y, color=INK, lw=1.6, label="measured curve, found again")
    for k, colour in COLOURS.items():
        left.plot(u, f[last + k], color=colour, lw=1.1, label=f"simulated, set {k}")
        for at in crossings(y[None], f[None, last + k], u)[0]:
            left.plot(at, np.interp(at, u, y), "o", color=colour, mfc="white", ms=5, zorder=4)
    left.set(xlabel="depth (mm)", ylabel="force (N)", xlim=(0, 4), ylim=(0, None))
    left.legend(frameon=False, fontsize=8, loc="upper left")
    inset = left.inset_axes((0.6, 0.07, 0.39, 0.29))
    inset.fill_between(u, -2e3 * final.sd, 2e3 * final.sd, color=INK, alpha=0.25, lw=0)
    for k, colour in COLOURS.items():
        inset.plot(u, 1e3 * (f[last + k] - y), color=colour, lw=1.0)
    inset.axhline(0.0, color=INK, lw=0.8)
    inset.set_title("simulated − measured (mN)", fontsize=7, pad=2)
    inset.tick_params(labelsize=7)
    inset.set_xlim(0, 4)
    a, b = (np.mean(q, axis=0) for q in p.predict(some, [data.nrmse, data.mre]))
    right.plot([0, 0.58], [0, 0.58], color="0.7", lw=0.8)
    right.errorbar(
        data.mre.value,
        alone[0],
        1.64 * alone[1],
        fmt="none",
        ecolor="#cc79a7",
        elinewidth=0.6,
        alpha=0.5,
        label="MRE from the NRMSE list alone (90 %)",
    )
    right.plot(data.nrmse.value, a, "o", color=COLOURS[1], ms=4, mfc="none", label="NRMSE (38)")
    right.plot(data.mre.value, b, "s", color="#cc79a7", ms=4, mfc="none", label="MRE (43)")
    right.set(xlabel="norm as printed", ylabel="norm of the curve found", xlim=(0, 0.58), ylim=(0, 0.58))
    right.legend(frameon=False, fontsize=8, loc="upper left")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, metadata={"Software": None})
