"""Picture of the experiment: the specimen in its bowl under the ball, and where it is pressed and looked at.

Run from the root of the checkout: python -m studies.kidney_em2.sketch
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle

from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PALE, PAPER, WARM, WIDTH_INCH, style

A, B = 60.0, 35.0  # mm, semi-axes; height as width
R, CLEARANCE, LENGTH = 3.0, 1.0, 11.0  # mm: ball, bowl, indenter
POINTS = {"top": (0, 0), "blue point": (2.5, 2.5), "(20, 0)": (20, 0), "(0, 20)": (0, 20), "(20, 20)": (20, 20)}


def side(axes: Axes) -> None:
    """Cut along the major axis, not deformed."""
    t = np.linspace(np.pi, 2 * np.pi, 200)
    low = B + CLEARANCE
    inner = np.column_stack([(A + CLEARANCE) * np.cos(t), low * np.sin(t) + CLEARANCE])
    outer = np.column_stack([(A + 6) * np.cos(t[::-1]), (B + 6) * np.sin(t[::-1]) + CLEARANCE])
    axes.fill(*np.vstack([inner, outer]).T, color=LIGHT, lw=0)
    axes.add_patch(Ellipse((0, 0), 2 * A, 2 * B, fc="#dcebf1", ec=ACCENT, lw=1.0))
    axes.add_patch(Rectangle((-R, B + R), 2 * R, LENGTH - R, fc=PALE, ec=INK, lw=0.8))
    axes.add_patch(Circle((0, B + R), R, fc=PALE, ec=INK, lw=0.8))
    axes.annotate("", (0, B + 1.2 * LENGTH), (0, B + 2.6 * LENGTH), arrowprops={"arrowstyle": "->", "color": INK})
    axes.text(3, B + 2.0 * LENGTH, "4 mm at 30 mm/min;\nFx, Fy, Fz on the ball", fontsize=7.5, va="center")
    axes.text(-7, B + R + 3, f"ruby ball,\nR = {R:g} mm", ha="right", va="center", fontsize=7.5)
    axes.text(0, -4, "ultra-soft polyurethane\nμ, D₁ = ?", ha="center", va="center", color=ACCENT, fontsize=8.5)
    axes.text(0, -B - 13, "bowl, a little larger: how much is not said", ha="center", fontsize=7.5, color=GREY)
    axes.plot([-A, A], [-B - 21] * 2, color=GREY, lw=0.8, marker="|", ms=5)
    axes.text(0, -B - 27, "120 mm", ha="center", fontsize=7.5, color=GREY)
    axes.set(xlim=(-70, 70), ylim=(-68, 68))
    axes.set_title("from the side (x, z)", color=GREY)


def above(axes: Axes) -> None:
    """Points of the indentations and the line of the profile."""
    axes.add_patch(Ellipse((0, 0), 2 * A, 2 * B, fc="#dcebf1", ec=ACCENT, lw=1.0))
    axes.plot([-A, A], [0, 0], color=LIGHT, lw=0.7)
    axes.plot([0, 0], [-B, B], color=LIGHT, lw=0.7)
    axes.plot([-20, 20], [5, 5], color=WARM, lw=2.0, solid_capstyle="butt", zorder=2)
    axes.annotate(
        "profile u_z, 5 mm beside the axis",
        (-16, 5),
        (-62, 43),
        fontsize=7.5,
        color=WARM,
        arrowprops={"arrowstyle": "-", "color": WARM, "lw": 0.7},
    )
    for name, (x, y) in POINTS.items():
        axes.plot([x], [y], "o", ms=5, mfc=PAPER if name != "blue point" else ACCENT, mec=INK, zorder=4)
        if name == "blue point":
            axes.annotate(
                "“blue point” (2.5, 2.5)",
                (x, y),
                (9, -24),
                fontsize=7.5,
                arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.6},
                zorder=5,
            )
        elif name == "top":
            axes.annotate(
                "top, “middle point”",
                (x, y),
                (-50, -52),
                fontsize=7.5,
                arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.6},
                zorder=5,
            )
        else:
            axes.text(x + 2, y + 2, name, fontsize=7.5)
    axes.annotate("", (66, -58), (52, -58), arrowprops={"arrowstyle": "->", "color": GREY})
    axes.annotate("", (52, -44), (52, -58), arrowprops={"arrowstyle": "->", "color": GREY})
    axes.text(67, -59.5, "x", color=GREY, fontsize=8)
    axes.text(51, -42.5, "y", color=GREY, fontsize=8)
    axes.set(xlim=(-70, 72), ylim=(-68, 68))
    axes.set_title("from above (x, y)", color=GREY)


def main() -> None:
    """Write the picture."""
    with style():
        figure = Figure(figsize=(WIDTH_INCH, 3.5), dpi=150, layout="constrained", facecolor=PAPER)
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        side(left)
        above(right)
        for axes in (left, right):
            axes.set_aspect("equal")
            axes.axis("off")
        figure.savefig(
            Path(__file__).parent / "thesis" / "experiment.png", facecolor=PAPER, metadata={"Software": None}
        )


if __name__ == "__main__":
    main()
