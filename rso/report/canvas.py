"""What every figure shares: one style, a few colours that survive greyscale, plain numbers on axes, SVG bytes."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypedDict

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from rso.report.reading import ParameterView

if TYPE_CHECKING:  # matplotlib 3.9 does not name the keys of its settings
    from matplotlib.typing import RcKeyType

INK, GREY, LIGHT, PALE, PAPER = "#23272b", "#7b8085", "#c9ccca", "#eceeed", "#ffffff"
ACCENT, WARM = "#0b5a7d", "#b4481e"
WIDTH = 7.2  # inch: 9 pt type becomes 15 px in a column of 860 px and 8.2 pt on A4
HALO: list[Stroke] = [withStroke(linewidth=2.2, foreground=PAPER)]

_STYLE: dict[RcKeyType, Any] = {
    "svg.hashsalt": "rso",
    "svg.fonttype": "path",
    "text.parse_math": False,  # names come from people's files and may hold a dollar sign
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.4,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
}


class Look(TypedDict, total=False):
    """How a line and its marks are drawn, as matplotlib names it."""

    color: str
    lw: float
    ls: str | tuple[float, tuple[float, ...]]
    marker: str
    ms: float
    mfc: str
    mec: str
    mew: float
    zorder: float


@contextmanager
def style() -> Iterator[None]:
    """Figures drawn inside look the same whatever a user's own settings are."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def canvas(height: float) -> Figure:
    """An empty figure as wide as the page, `height` in inch; the layout leaves no label outside."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def svg(figure: Figure, name: str) -> str:
    """The figure as one SVG element; its ids start with `name`, so that several fit into one page."""
    buffer = io.StringIO()
    # `savefig` would draw it twice, the first time only to lay it out.
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    # Comments repeat the text of labels; a page needs neither them nor the metadata.
    text = re.sub(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    return re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)


def plain_log(axis: Axis) -> None:
    """Ticks of a logarithmic axis as plain numbers at 1, 2, 5."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.6g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def parameter_axis(
    axes: Axes, which: str, p: ParameterView, low: float | None = None, high: float | None = None
) -> None:
    """Scale, range (the parameter's own unless given), ticks and label of an axis, in the unit people use."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = p.low if low is None else low, p.high if high is None else high
    # Ticks at 1, 2, 5 need some room; over a short piece the logarithm is a line anyway.
    log = p.log and low > 0 and high > 5 * low
    getattr(axes, f"set_{which}scale")("log" if log else "linear")
    if math.isfinite(low) and math.isfinite(high):
        getattr(axes, f"set_{which}lim")(low * p.unit.factor, high * p.unit.factor)
    if log:
        plain_log(axis)
    else:
        axis.set_major_locator(MaxNLocator(4))
    axis.set_label_text(f"{p.letter}{p.unit.bracket}")


def few_ticks(axes: Axes, n: int = 4) -> None:
    """At most n steps on both axes."""
    axes.xaxis.set_major_locator(MaxNLocator(n))
    axes.yaxis.set_major_locator(MaxNLocator(n))


def short(text: str, length: int = 28) -> str:
    """Text that fits into a label."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def tag(axes: Axes, x: float, y: float, text: str, *, colour: str = INK, offset: tuple[float, float], ha: str) -> None:
    """A direct label beside a point of a curve, `offset` in points."""
    axes.annotate(
        text, (x, y), xytext=offset, textcoords="offset points", color=colour, ha=ha, va="center", path_effects=HALO
    )


def number_label(digits: int) -> Callable[[float], str]:
    """Formatter of contour labels."""
    return lambda v: f"{v:.{digits}g}".replace("-", "−")
