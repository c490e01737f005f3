"""What every figure shares: one style, a few colours that survive greyscale, plain numbers on axes, SVG bytes."""

from __future__ import annotations

import html
import io
import json
import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypedDict

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text as MatplotlibText
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from rso.report.reading import ParameterView

if TYPE_CHECKING:  # matplotlib 3.9 does not name the keys of its settings
    from matplotlib.typing import RcKeyType

INK, GREY, LIGHT, PALE, PAPER = "#23272b", "#7b8085", "#c9ccca", "#eceeed", "#ffffff"
STEEL = "#dfe4e7"  # of an indenter
ACCENT, WARM = "#0b5a7d", "#b4481e"
NARROW_WIDTH_INCH = 5.4  # of figures that a phone shows whole
WIDTH_INCH = 7.2  # 9 pt type becomes 15 px in a column of 860 px and 8.2 pt on A4
_GROUP_MARK = "\x1f"  # between the name of a line and that of its group
_HALO, _HALO_STYLE = "halo", f"paint-order: stroke; stroke: {PAPER}; stroke-width: 2.2; stroke-linejoin: round"
HALO: list[Stroke] = [withStroke(linewidth=2.2, foreground=PAPER)]

_FIGURE_STYLE: dict[RcKeyType, Any] = {
    "svg.hashsalt": "rso",
    "svg.fonttype": "none",
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


class Shade(TypedDict):
    """How an area is drawn."""

    color: str
    alpha: float
    lw: float


SHADE: Shade = {"color": ACCENT, "alpha": 0.16, "lw": 0.0}  # where 90 % of readings are expected
SD_OF_90_PERCENT = 1.6449  # standard deviations of a normal law that hold 90 %
FITTED_LABEL, SIMULATED_LABEL = "fitted", "simulated, as it is"


@contextmanager
def style() -> Iterator[None]:
    """Figures drawn inside look the same whatever a user's own settings are."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_FIGURE_STYLE)
        yield


def canvas(height: float, width: float = WIDTH_INCH) -> Figure:
    """An empty figure, as wide as the page, `height` in inch; the layout leaves no label outside."""
    return Figure(figsize=(width, height), layout="constrained")


def svg(figure: Figure, name: str, plate: bool = False) -> str:
    """The figure as one SVG element; its ids start with `name`, so that several fit into one page.

    What its lines and marks show goes along as data, for whoever points at them; a `plate` keeps its paper white.
    """
    shown_ones = _named(figure)
    _halos(figure)
    buffer = io.StringIO()
    # `savefig` would draw it twice, the first time only to lay it out.
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    series = [_places(figure, name, axes, artist) for name, axes, artist in shown_ones]  # now that it is laid out
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    # Comments repeat the text of labels; a page needs neither them nor the metadata.
    text = re.sub(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(rf'<g id="({_HALO}\d+)">', rf'<g id="\1" style="{_HALO_STYLE}">', text)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)
    labels = [[axes.get_xlabel(), axes.get_ylabel().replace("\n", " ")] for axes in figure.axes]
    series = [{**s, "g": f"{name}-{s['g']}"} for s in series if s["x"]]
    held = html.escape(json.dumps({"series": series, "labels": labels}, separators=(",", ":")), quote=False)
    mark = ' data-plate="1"' if plate else ""
    return re.sub(
        r"(<svg)([^>]*>)", lambda m: f'{m[1]}{mark}{m[2]}<metadata class="data">{held}</metadata>', text, count=1
    )


def _halos(figure: Figure) -> None:
    """Labels with a halo stay text: matplotlib would draw them as outlines, which nobody can search or translate."""
    for n, label in enumerate(t for t in figure.findobj(MatplotlibText) if t.get_path_effects()):
        label.set_path_effects([])
        label.set_gid(f"{_HALO}{n}")


def grouped_as(name: str) -> str:
    """What stands behind the label of a line so that it is shown or hidden with all others of that name."""
    return f"{_GROUP_MARK}{name}"


def _named(figure: Figure) -> list[tuple[str, int, Any]]:
    """Lines and marks, each with an id of its own and the number of its panel; no rules of a panel."""
    found = [
        (k, artist)
        for k, axes in enumerate(figure.axes)
        for artist in (
            *(line for line in axes.lines if line.get_transform() == axes.transData),
            *(marks for marks in axes.collections if isinstance(marks, PathCollection)),
        )
    ]
    for n, (_, artist) in enumerate(found):
        artist.set_gid(f"series{n}")
    return [(f"series{n}", k, artist) for n, (k, artist) in enumerate(found)]


def _places(figure: Figure, gid: str, k: int, artist: Any) -> dict[str, Any]:
    """Values of a line or of marks, and their places in the picture, y downwards."""
    at = artist.get_offsets() if isinstance(artist, PathCollection) else np.column_stack(artist.get_data())
    xy = np.ma.getdata(at).astype(float).reshape(-1, 2)
    xy = xy[np.isfinite(xy).all(1)]
    height, points = figure.bbox.height, 72.0 / figure.dpi
    with np.errstate(all="ignore"):
        places = figure.axes[k].transData.transform(xy)
    inside = np.isfinite(places).all(1)
    label, _, group = str(artist.get_label()).partition(_GROUP_MARK)
    label = "" if label.startswith("_") else label
    return {
        "a": k,
        "g": gid,
        "name": label,
        "group": group or label,
        "x": [float(f"{v:.5g}") for v in xy[inside, 0]],
        "y": [float(f"{v:.5g}") for v in xy[inside, 1]],
        "p": [[round(px * points, 1), round((height - py) * points, 1)] for px, py in places[inside].tolist()],
    }


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
