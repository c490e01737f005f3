"""Figures of docs/thesis_tables.md, in the style of the reports."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, NullLocator
from scipy.interpolate import CubicSpline
from scipy.spatial import ConvexHull

from rso.core.curves import Resampling
from rso.evaluation import Outcome
from rso.evaluation.store import Done
from rso.inference import fit_surface, surface_minima
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PALE, PAPER, WARM, canvas, style, tag
from studies.thesis import analysis
from studies.thesis.analysis import RANGES, Family
from studies.thesis.simulations import GRID, LINE, POINTS, PRINTED, SETS, of_set

LOOKS = {"1": (ACCENT, "-"), "3": (INK, "--"), "4": (WARM, "-")}
TARGETS = (2.0, 3.0, 3.9)


def draw(outcomes: Mapping[str, Outcome], folder: Path) -> list[str]:
    """Write every figure as PNG into a folder and return the names."""
    bowl, held = (analysis.family(outcomes, k) for k in ("bowl", "held"))
    with style():
        made = {
            "curves": curves(outcomes, bowl),
            "searches": searches(bowl),
            "errors": errors(bowl),
            "sensitivity": sensitivity(bowl, held),
            "profile": profile(outcomes),
            "points": points(outcomes),
        }
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in made.items():
            figure.savefig(folder / f"thesis_{name}.png", dpi=200, facecolor=PAPER, metadata={"Software": None})
    return [f"thesis_{name}.png" for name in made]


def curves(outcomes: Mapping[str, Outcome], bowl: Family) -> Figure:
    """Force over depth of sets 1, 3 and 4 against what was measured: 0-4 mm and 0-8 mm (figures 5.1 and 5.3)."""
    figure = canvas(3.0)
    left, right = figure.subplots(1, 2)
    depth, force = analysis.measured()
    left.plot(depth[::2], force[::2], "o", ms=3, mfc=PAPER, mec=INK, mew=0.7)
    u = np.linspace(0.05, 4.0, 120)
    for s, (colour, line) in LOOKS.items():
        left.plot(u, bowl.curve(*SETS[s], u), line, color=colour)
        o = outcomes.get(f"set {s} 8 mm bowl")
        if isinstance(o, Done):
            f = Resampling(o.response.channels["travel"], o.response.channels["Fz"])
            v = np.linspace(0.05, 8.0, 160)
            right.plot(v, f(v), line, color=colour)
            up = {"1": -8, "3": 1, "4": 8}[s]
            tag(right, 8.0, float(f(8.0)), f"set {s}", colour=colour, offset=(8, up), ha="left")
    tag(left, 1.6, float(np.interp(1.6, depth, force)), "measured\n(reconstructed)", offset=(-8, 10), ha="right")
    first, deep = PRINTED["middle_point"], PRINTED["deeper"]
    right.plot([8.0], [first["validation_Fz_N"]], "o", ms=5, mfc=PAPER, mec=INK)
    tag(right, 8.0, first["validation_Fz_N"], "measured", offset=(8, 0), ha="left")
    right.plot([8.0], [deep["set4_8mm_N"]], "D", ms=4.5, mfc=PAPER, mec=WARM)
    tag(right, 8.0, deep["set4_8mm_N"], "set 4, thesis", colour=WARM, offset=(8, -2), ha="left")
    right.set_xlim(0, 10.6)
    right.set_xticks([0, 2, 4, 6, 8])
    for axes, title in ((left, "simulated (lines), found again (dots)"), (right, "deeper: measured at 8 mm only")):
        axes.set(xlabel="depth (mm)", ylabel="Fz (N)", ylim=(0, None))
        axes.set_title(title, color=GREY)
    left.set_xlim(0, None)
    return figure


def searches(bowl: Family) -> Figure:
    """Left: force at 4 mm over the full range and where it is the measured one; right: valleys of three targets."""
    figure = canvas(3.3)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.25])
    target = PRINTED["middle_point"]["Fz_N"]
    mu, D1 = RANGES["FR"]
    M, D = np.meshgrid(np.linspace(*mu, 161), np.linspace(*D1, 161))
    lines = left.contour(
        D, M * 1e3, bowl.force(M, D, 4.0), levels=[0.25, 0.5, 0.75, 1.0, 1.25, 1.5], colors=LIGHT, linewidths=0.9
    )
    left.clabel(lines, fmt="%g N", fontsize=7, colors=GREY)
    left.contour(D, M * 1e3, bowl.force(M, D, 4.0), levels=[target], colors=ACCENT)
    rough = analysis.quadratic(bowl, RANGES["FR"], 4.0)
    left.contour(D, M * 1e3, rough(M, D), levels=[target], colors=WARM, linestyles="--")
    for d, m in _pairs("1P FR"):
        left.plot(d, m, "o", ms=4, mfc=PAPER, mec=INK)
    left.text(
        0.97,
        0.96,
        "— 0.546 N, finite elements\n- - 0.546 N, quadratic surface\n○ thesis, one point",
        transform=left.transAxes,
        ha="right",
        va="top",
        fontsize=7.5,
        bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.85, "pad": 2},
    )
    left.set(xlabel="D₁ (1/MPa)", ylabel="μ (kPa)")
    left.set_title("force at 4 mm, full range", color=GREY)
    depth, force = analysis.measured()
    d = np.linspace(1.0, 168.0, 120)
    for u, look in zip(TARGETS, (":", "--", "-"), strict=True):
        right.plot(d, bowl.valley(d, u, float(np.interp(u, depth, force))) * 1e3, look, color=ACCENT, lw=1.2)
    for name in ("RR", "2P", "3P"):
        (m0, m1), (d0, d1) = RANGES[name][0] * 1e3, RANGES[name][1]
        right.add_patch(Rectangle((d0, m0), d1 - d0, m1 - m0, fill=False, ec=GREY, lw=0.8))
        right.annotate(name, (d1, m0), xytext=(2, 2), textcoords="offset points", color=GREY, fontsize=7.5)
    for kind, marker in (("1P FR", "o"), ("1P RR", "o"), ("2P RR", "s"), ("3P", "^")):
        for x, y in _pairs(kind):
            right.plot(x, y, marker, ms=4.5, mfc=PAPER, mec=INK)
    x, y = SETS["4"][1], SETS["4"][0] * 1e3
    right.plot(x, y, "D", ms=4.5, mfc=PAPER, mec=WARM)
    tag(right, x, y, "set 4", colour=WARM, offset=(0, 9), ha="center")
    right.set(xlabel="D₁ (1/MPa)", ylabel="μ (kPa)", ylim=(5.5, 15.5), xlim=(-3, 170))
    right.text(
        0.97,
        0.04,
        "force met at  ⋯ 2 mm   - - 3 mm   — 3.9 mm",
        transform=right.transAxes,
        ha="right",
        color=ACCENT,
        fontsize=7.5,
    )
    right.set_title("what each target allows; thesis: ○ 1P  □ 2P  △ 3P", color=GREY)
    return figure


def _pairs(kind: str) -> list[tuple[float, float]]:
    return [(D1, mu * 1e-3) for mu, D1 in PRINTED["candidates"][kind]]


def errors(bowl: Family) -> Figure:
    """NRMSE over (D1, mu): the source's polynomials of degree 2 and 4, and the finite elements themselves."""
    figure = canvas(2.9)
    axes = figure.subplots(1, 3, sharey=True)
    points, values = analysis.printed_errors("nrmse")
    table = {row["degree"]: row for row in PRINTED["poly"] if row["metric"] == "nrmse"}
    M, D = np.meshgrid(np.linspace(0.0063, 0.0153, 121), np.linspace(1.0, 162.0, 121))
    grid = np.column_stack([M.ravel(), D.ravel()])
    levels = [0.02, 0.04, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4]
    for a, degree in zip(axes[:2], (2, 4), strict=True):
        surface = fit_surface(points, values, degree)
        Z = surface(grid).reshape(M.shape)
        a.contourf(D, M * 1e3, Z, levels=[-10, 0], colors=[WARM], alpha=0.25)
        lines = a.contour(D, M * 1e3, Z, levels=levels, colors=GREY, linewidths=0.6)
        a.clabel(lines, fmt="%g", fontsize=6.5)
        ring = points[ConvexHull(surface.scaled(points)).vertices]
        a.fill(ring[:, 1], ring[:, 0] * 1e3, fill=False, ec=INK, lw=0.7, ls=":")
        for m in surface_minima(surface):
            a.plot(m.theta[1], m.theta[0] * 1e3, "o", ms=5, mfc=ACCENT if m.kind == "inside" else PAPER, mec=ACCENT)
        a.plot(table[degree]["D1"], table[degree]["mu_Pa"] * 1e-3, "+", ms=8, color=INK, mew=1.2)
        a.set_title(f"polynomial of degree {degree}", color=GREY)
    u, y = analysis.measured()
    f = bowl.at(u)
    F = M[..., None] / analysis.MU * f(np.log(M * D))
    Z = np.sqrt(np.mean((F - y) ** 2, axis=-1)) / y.mean()
    lines = axes[2].contour(D, M * 1e3, Z, levels=levels, colors=GREY, linewidths=0.6)
    axes[2].clabel(lines, fmt="%g", fontsize=6.5)
    k = np.unravel_index(np.argmin(Z), Z.shape)
    axes[2].plot(D[k], M[k] * 1e3, "o", ms=5, color=ACCENT)
    axes[2].set_title("finite elements", color=GREY)
    for a in axes:
        a.plot(points[:, 1], points[:, 0] * 1e3, ".", ms=2.5, color=INK, alpha=0.6)
        a.set(xlabel="D₁ (1/MPa)", ylim=(6.3, 15.3), xlim=(0, 162))
    axes[0].set_ylabel("μ (kPa)")
    return figure


def sensitivity(bowl: Family, held: Family) -> Figure:
    """Force over D1 for some moduli, and how many times more a relative change of mu counts than one of D1."""
    figure = canvas(2.7)
    left, right = figure.subplots(1, 2)
    mu, D1 = RANGES["FR"]
    d = np.geomspace(*D1, 120)
    for m, look in ((mu[0], GREY), (0.010, ACCENT), (float(np.mean(mu)), INK), (mu[1], WARM)):
        F = bowl.force(m, d, 4.0)
        left.plot(d, F, color=look)
        tag(left, d[-1], F[-1], f"μ = {m * 1e3:.3g} kPa", colour=look, offset=(4, 0), ha="left")
    left.set(xlabel="D₁ (1/MPa)", ylabel="Fz at 4 mm (N)", xlim=(0, 235), ylim=(0, None))
    left.set_title("flattening out with D₁", color=GREY)
    x = np.geomspace(GRID[0], GRID[-1], 300)
    for curves_, look in ((held, "--"), (bowl, "-")):
        f = curves_.at(4.0)
        e = -f(np.log(x), 1) / f(np.log(x))
        right.plot(x, np.where(e > 0, (1 - e) / np.where(e > 0, e, 1), np.nan), look, color=ACCENT)
    right.axhline(4.0, color=INK, lw=0.7)
    right.set(xscale="log", yscale="log", xlabel="μ D₁", ylabel="elasticity of μ over that of D₁", ylim=(1, 300))
    right.xaxis.set_major_locator(FixedLocator([0.01, 0.1, 1.0]))
    right.yaxis.set_major_locator(FixedLocator([1, 4, 10, 100]))
    for axis in (right.xaxis, right.yaxis):
        axis.set_major_formatter(lambda v, _: f"{v:g}")
        axis.set_minor_locator(NullLocator())
    right.text(0.02, 4.3, "thesis: nearly four", transform=right.get_yaxis_transform(), fontsize=7.5)
    for name in ("FR", "RR", "2P", "3P"):
        middle = float(np.mean(RANGES[name][0]) * np.mean(RANGES[name][1]))
        right.axvline(middle, color=LIGHT, lw=0.9, zorder=0)
        right.annotate(
            name,
            (middle, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -8),
            fontsize=7.5,
            textcoords="offset points",
            ha="center",
            color=GREY,
        )
    right.set_title("— bowl  - - held; middle of each range", color=GREY)
    return figure


def profile(outcomes: Mapping[str, Outcome]) -> Figure:
    """Vertical displacement along the line 5 mm beside the x axis, at 1 to 4 mm, and all sets at 4 mm."""
    figure = canvas(2.7)
    left, right = figure.subplots(1, 2, sharey=True)
    x = np.array([-v for v in LINE[:0:-1]] + list(LINE))
    fine = np.linspace(x[0], x[-1], 241)

    def smooth(z: np.ndarray) -> np.ndarray:
        return CubicSpline(x, np.concatenate([z[:0:-1], z]))(fine)

    for depth in (1.0, 2.0, 3.0, 4.0):
        z = line(outcomes, "3", depth)
        left.plot(fine, smooth(z), color=ACCENT, lw=1.2)
        left.plot(x, np.concatenate([z[:0:-1], z]), ".", color=ACCENT, ms=3.5)
        tag(left, 0, z[0], f"{depth:g} mm", offset=(0, -7), ha="center")
    for s, (colour, look) in LOOKS.items():
        right.plot(fine, smooth(line(outcomes, s, 4.0)), look, color=colour, label=f"set {s}")
        right.plot(fine, smooth(line(outcomes, s, 4.0, "held")), look, color=colour, lw=0.6)
    right.plot([], [], color=GREY, lw=0.6, label="the same, held")
    right.plot(x, [0] * len(x), color=PALE, lw=0.8, zorder=0)
    right.legend(frameon=False, loc="lower right", fontsize=7.5)
    for axes, title in ((left, "simulated in the bowl: set 3, 1 to 4 mm"), (right, "simulated: all sets, 4 mm deep")):
        axes.set(xlabel="x (mm), y = 5 mm")
        axes.set_title(title, color=GREY)
    left.set_ylabel("displacement uz (mm)")
    return figure


def line(outcomes: Mapping[str, Outcome], name: str, depth: float, label: str = "bowl") -> np.ndarray:
    """Displacements uz (mm) of the marks along x >= 0 for a set (or the whole name of a run) at a depth of TO_4."""
    run = of_set(label, name) if name in SETS else name
    o = outcomes[run]
    assert isinstance(o, Done), run
    (k,) = np.flatnonzero(o.response.channels["travel"] == depth)
    return np.array([o.response.channels[f"uz({x:g},5)"][k] for x in LINE])


def points(outcomes: Mapping[str, Outcome]) -> Figure:
    """Force components at 4 mm of every point, pressed vertically and along the normal."""
    figure = canvas(2.7)
    axes: list[Axes] = list(figure.subplots(1, 3, sharey=True))
    names = [n for n in POINTS if isinstance(outcomes.get(f"point {n} vertical"), Done)]
    for a, channel in zip(axes, ("Fx", "Fy", "Fz"), strict=True):
        for direction, marker, colour in (("vertical", "o", ACCENT), ("normal", "^", WARM)):
            for k, name in enumerate(names):
                o = outcomes.get(f"point {name} {direction}")
                if isinstance(o, Done):
                    a.plot(1e3 * o.response.channels[channel][-1], -k, marker, ms=5, mfc=PAPER, mec=colour, mew=1.2)
        a.axvline(0, color=LIGHT, lw=0.8, zorder=0)
        a.set_xlabel(f"{channel} at 4 mm (mN)")
        a.set_yticks([-k for k in range(len(names))], [f"({POINTS[n][0]:g}, {POINTS[n][1]:g}) mm" for n in names])
        a.tick_params(axis="y", length=0)
    axes[0].set_title("○ vertical   △ along the normal", color=GREY)
    return figure
