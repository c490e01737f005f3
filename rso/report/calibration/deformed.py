"""The first picture: a section through the deformed body in colour, and the curve that leads there, as own SVG.

Both are whole without scripts: the deepest frame, and the whole curve.  `data` is what a script needs to go through the
frames with the same levels and colours.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from rso.core.digits import NBSP
from rso.report.canvas import ACCENT, GREY, INK, LIGHT, PAPER, SD_OF_90_PERCENT, SIMULATED_LABEL, STEEL
from rso.report.layout.digits import Unit, channel_text, clean, percent, quantity, shortest, shown
from rso.report.layout.document import Picture
from rso.report.reading import (
    BandView,
    Results,
    curve_unit,
    drawn_at,
    experiment,
    fitted_band,
    fitted_model,
    number,
    on_the_way,
    points,
)

DEFORMED_PICTURE, PRESSED_PICTURE = "deformed", "pressed"
BAND_COLOURS = (
    "#f7f0e4",
    "#f8e0bd",
    "#f5c88f",
    "#efa968",
    "#e48750",
    "#d06145",
    "#b3413f",
    "#8e2a3f",
    "#67193b",
    "#420d30",
)
SCALE_BAR_COLOUR = "#24282c"  # on the lightest band, whatever the theme
LETTER_WIDTH, MIN_LABEL_SIZE = 0.6, 8  # a letter over the size of its text; the smallest size that is read
MAX_SECTION_WIDTH, MAX_SECTION_HEIGHT = 620.0, 400.0  # of the picture, its text being 13 of it
COLOUR_SCALE_WIDTH = 92.0  # of it, for the scale of colours
SURPRISING_SD = 2.0  # standard deviations of a contact shift or gain before the fit
MIN_SAID_INPUT_SD = 0.2  # standard uncertainties: a stated input that the fit moves by less is not worth a word
SECTION_REACH_RATIO = 2.2  # half widths of the indenter or depths that are shown to either side
MAX_SECTION_ASPECT = 0.68  # of its width


def deformed_blocks(results: Results) -> tuple[Picture, ...]:
    """The section and the curve beside it; none where nobody drew a body."""
    found = body(results)
    if found is None:
        return ()
    last, field = found["frames"][-1], next(iter(found["units"]))
    name = clean(found["experiment"])
    largest = quantity(float(np.max(last["fields"][field])), clean(found["units"][field]), 3)
    depth = shortest(float(f"{last['travel']:.4g}"))
    caption = (
        f"The fitted model at the deepest reading of {name}, {depth} mm: {clean(field)}, at most {largest}. "
        f"Section, {clean(found['plane'])}."
    )
    blocks = (Picture(DEFORMED_PICTURE, caption, share=3),)
    if pressed_data(results) is None:
        return blocks
    beside = f"Measured {name} and fitted model; the ring is the depth of the section."
    band = fitted_band(results, experiment(results, name))
    if band is not None:
        beside = f"Measured {name} and what was fitted, with its 90 % band; the ring is the depth of the section."
        if said := moved_sentence(band):
            beside += f" {said} Dashed: the simulation without that."
    elif (model := fitted_model(results)) is not None and not model.search:
        beside += " The curve may run beside the readings: an error that moves all of them counts once."
    return (*blocks, Picture(PRESSED_PICTURE, beside, share=2))


def moved_sentence(band: BandView) -> str:
    """Which contact shift and gain the fit has found, in words; empty where it has none."""
    contact, gain = number(band.data.get("contact")), number(band.data.get("gain"))
    expected = band.data.get("expected") or {}
    said = []
    if contact:
        way = "deeper" if contact > 0 else "less deep"
        usual = _usual(expected, "contact", "mm", contact)
        said.append(f"contact {quantity(abs(contact), 'mm', 2)} {way} than recorded{usual}")
    if gain:
        said.append(f"force {percent(abs(gain))} too {'high' if gain > 0 else 'low'}{_usual(expected, 'gain', '')}")
    every = (band.data.get("inputs") or {}).items()  # of a test of its own its name stands ahead
    inputs = {clean(n.rpartition(": ")[2]): x for n, v in every if (x := number(v)) is not None}
    said += [_moved_input(name, x) for name, x in inputs.items() if abs(x) >= MIN_SAID_INPUT_SD]
    if not said:
        return ""
    return " ".join([f"Fitted with it: {'; '.join(said)}.", *_surprises(contact, gain, expected, inputs)])


def _moved_input(name: str, x: float) -> str:
    """By how many standard uncertainties a stated input is moved, in words."""
    count, way = shortest(float(f"{abs(x):.1g}")), "more" if x > 0 else "less"
    if count == "1":
        return f"{name} one standard uncertainty {way} than stated"
    return f"{name} {count} standard uncertainties {way} than stated"


def _surprises(
    contact: float | None, gain: float | None, expected: Mapping[str, Any], inputs: Mapping[str, float]
) -> list[str]:
    """A shift, gain or stated input that is far beyond what was expected: it may stand for something else."""
    named = (("contact", "contact shift", contact), ("gain", "gain", gain))
    sizes = [(words, abs(size or 0.0) / (number(expected.get(key)) or math.inf)) for key, words, size in named]
    sizes += [(name, abs(x)) for name, x in inputs.items()]
    return [
        f"The {words} is {shortest(float(f'{times:.2g}'))} times what was expected: check it, or the model."
        for words, times in sizes
        if times > SURPRISING_SD
    ]


def _usual(expected: Mapping[str, Any], key: str, unit: str, size: float | None = None) -> str:
    """What was expected of it before the fit, in the same unit."""
    sd = number(expected.get(key))
    return "" if not sd else f" (expected ±{NBSP}{quantity(sd, unit, 2, size) if unit else percent(sd)})"


def body(results: Results) -> Mapping[str, Any] | None:
    """What deformed.json holds, its arrays as such; None where it is not there or not whole."""
    found: Any = results.get(DEFORMED_PICTURE) or {}
    try:
        triangles: Any = None
        frames = []
        for f in found["frames"]:
            triangles = triangles if f["triangles"] is None else np.asarray(f["triangles"], int).reshape(-1, 3)
            at = np.asarray(f["points"], float).reshape(-1, 2)
            fields = {k: np.asarray(f["fields"][k], float).reshape(len(at)) for k in found["units"]}
            outline = np.asarray(f["indenter"], float).reshape(-1, 2)
            whole = all(np.isfinite(v).all() for v in (at, outline, *fields.values()))
            if not whole or not len(triangles) or triangles.min() < 0 or triangles.max() >= len(at):
                return None
            one = {"travel": float(f["travel"]), "force": float(f["force"]), "mirrored": f["mirrored"] is True}
            frames.append({**one, "points": at, "triangles": triangles, "fields": fields, "indenter": outline})
        return {**found, "frames": frames} if frames and found["units"] else None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        return None


# ---------------------------------------------------------------------------------------------------- the section


def window(found: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """Left, right, low and high ends (mm) of what is shown: the surroundings of the indenter, no more than the body."""
    last = found["frames"][-1]
    every = np.vstack([f["points"] for f in found["frames"]])
    tip = last["indenter"][np.argmin(last["indenter"][:, 1])]
    depth = last["travel"]
    reach = SECTION_REACH_RATIO * max(min(float(np.ptp(last["indenter"][:, 0])) / 2, 4 * depth), 1.6 * depth)
    mirrored = last["mirrored"]
    left = -float(every[:, 0].max()) if mirrored else float(every[:, 0].min())
    x0, x1 = max(tip[0] - reach, left), min(tip[0] + reach, float(every[:, 0].max()))
    top = max(float(found["frames"][0]["indenter"][:, 1].min()) + depth, float(every[:, 1].max()))
    high = top + 0.14 * reach
    low = max(high - MAX_SECTION_ASPECT * (x1 - x0), float(every[:, 1].min()) - 0.05 * reach)
    return x0, x1, low, high


def levels(found: Mapping[str, Any], field: str) -> np.ndarray:
    """Limits of the bands in the base unit, of all frames together."""
    unit = shown_unit(found, field)
    v = np.concatenate([f["fields"][field] for f in found["frames"]]) * unit.factor
    low, high = min(0.0, float(v.min())), float(v.max())
    ticks = MaxNLocator(len(BAND_COLOURS)).tick_values(low, high if high > low else low + 1.0)
    first = max(int(np.searchsorted(ticks, low, "right")) - 1, 0)
    last = int(np.searchsorted(ticks, high, "left"))
    return np.asarray(ticks[first : last + 1]) / unit.factor


def shown_unit(found: Mapping[str, Any], field: str) -> Unit:
    """The unit people use for a field."""
    size = max(float(np.abs(f["fields"][field]).max(initial=0.0)) for f in found["frames"])
    return shown(clean(found["units"][field]), size)


def colours(n: int) -> list[str]:
    """Colours of n bands from light to dark."""
    return [BAND_COLOURS[round(k * (len(BAND_COLOURS) - 1) / max(n - 1, 1))] for k in range(n)]


def superlevel(at: np.ndarray, triangles: np.ndarray, v: np.ndarray, level: float) -> list[np.ndarray]:
    """Polygons (k, 2) of the part of each triangle where the linear field is at least `level`."""
    out = []
    for t in triangles[(v[triangles] >= level).any(1)]:
        polygon = []
        for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0])):
            if v[a] >= level:
                polygon.append(at[a])
            if (v[a] >= level) != (v[b] >= level):
                s = (level - v[a]) / (v[b] - v[a])
                polygon.append(at[a] + s * (at[b] - at[a]))
        out.append(np.array(polygon))
    return out


def turned(at: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles, all the same way round: within one path they then leave no seams."""
    a, b, c = (at[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return np.where((area < 0)[:, None], triangles[:, ::-1], triangles)


def outline(triangles: np.ndarray) -> list[list[int]]:
    """Closed lines of points around the triangles, which stand the same way round."""
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {(int(a), int(b)) for a, b in edges}
    after: dict[int, list[int]] = {}
    for a, b in sorted(e for e in there if e[::-1] not in there):
        after.setdefault(a, []).append(b)
    lines = []
    while after:
        line = [next(iter(after))]
        while line[-1] in after:
            ways = after[line[-1]]
            line.append(ways.pop())
            if not ways:
                del after[line[-2]]
        lines.append(line[:-1] if line[0] == line[-1] else line)
    return lines


def _path(polygons: Sequence[np.ndarray], closed: str = "Z") -> str:
    each = ("L".join(f"{x:.1f},{y:.1f}" for x, y in p) for p in polygons)
    return "".join(f"M{line}{closed}" for line in each)


def deformed_figure(results: Results, name: str) -> str:
    """The deepest frame: bands of the first field, the body's outline, the indenter, the scale of colours."""
    found = body(results)
    assert found is not None  # there is no picture without
    x0, x1, low, high = window(found)
    scale = min((MAX_SECTION_WIDTH - COLOUR_SCALE_WIDTH) / (x1 - x0), MAX_SECTION_HEIGHT / (high - low))
    tall = scale * (high - low)
    field = next(iter(found["units"]))
    place = {"scale": scale, "x": x0, "high": high, "tall": tall, "wide": scale * (x1 - x0)}
    last = found["frames"][-1]
    parts = [
        f'<clipPath id="{name}-window"><rect width="{place["wide"]:.1f}" height="{tall:.1f}"/></clipPath>',
        f'<g clip-path="url(#{name}-window)">',
    ]
    limits = levels(found, field)
    tones = colours(len(limits) - 1)
    at = to_picture(last["points"], place)
    mirror = to_picture(last["points"] * [-1.0, 1.0], place) if last["mirrored"] else None
    sides = [s for s in (at, mirror) if s is not None]
    triangles = [turned(s, last["triangles"]) for s in sides]
    for k, tone in enumerate(tones):
        if k == 0:
            polygons = [s[line] for s, t in zip(sides, triangles, strict=True) for line in outline(t)]
        else:
            v = last["fields"][field]
            polygons = [p for s, t in zip(sides, triangles, strict=True) for p in superlevel(s, t, v, limits[k])]
        parts.append(f'<path class="band" data-k="{k}" fill="{tone}" d="{_path(polygons)}"/>')
    around = [s[line] for s, t in zip(sides, triangles, strict=True) for line in outline(t)]
    cut = [_without_axis(line, place) for line in around] if mirror is not None else around
    edge = _path([p for p in cut if len(p) > 1], "" if mirror is not None else "Z")
    parts.append(f'<path class="edge" fill="none" stroke="{INK}" stroke-width="1.3" d="{edge}"/>')
    steel = _path([to_picture(last["indenter"], place)])
    parts.append(f'<path class="indenter" fill="{STEEL}" stroke="{INK}" stroke-width="1.3" d="{steel}"/>')
    parts += ["</g>", *_scale_bar(place), *_colour_bar(found, field, limits, tones, place)]
    return _svg(name, place["wide"] + COLOUR_SCALE_WIDTH, tall, parts, script_data(found, place))


def _without_axis(line: np.ndarray, place: Mapping[str, float]) -> np.ndarray:
    """A closed outline as an open line without its piece on the axis, where the mirror image begins."""
    on = np.abs(line[:, 0] + place["x"] * place["scale"]) < 1e-6 * place["wide"]
    if not on.any() or on.all():
        return np.vstack([line, line[:1]])
    start = int(np.nonzero(on & ~np.roll(on, -1))[0][0])
    rolled, again = np.roll(line, -start, axis=0), np.nonzero(np.roll(on, -start)[1:])[0]
    if not len(again):  # it meets the axis in a point
        return np.vstack([rolled, rolled[:1]])
    return np.asarray(rolled[: int(again[0]) + 2])


def to_picture(at: np.ndarray, place: Mapping[str, float]) -> np.ndarray:
    """Places (n, 2) mm in the units of the picture, y downwards."""
    return np.column_stack([(at[:, 0] - place["x"]) * place["scale"], (place["high"] - at[:, 1]) * place["scale"]])


def _scale_bar(place: Mapping[str, float]) -> list[str]:
    """A length in mm below."""
    room = 0.22 * place["wide"] / place["scale"]
    size = 10.0 ** math.floor(math.log10(room))
    mm = next(k * size for k in (5, 2, 1) if k * size <= room)
    y, x = place["tall"] - 24, 10
    return [
        f'<path stroke="{SCALE_BAR_COLOUR}" stroke-width="2" fill="none" d="M{x},{y:.1f}h{mm * place["scale"]:.1f}"/>',
        _text(x + mm * place["scale"] / 2, y - 6, f"{shortest(mm)} mm", anchor="middle", colour=SCALE_BAR_COLOUR),
    ]


def _colour_bar(
    found: Mapping[str, Any], field: str, limits: np.ndarray, tones: Sequence[str], place: Mapping[str, float]
) -> list[str]:
    unit, n = shown_unit(found, field), len(tones)
    x, top, height = place["wide"] + 18, 12.0, place["tall"] - 26.0
    turn = f' transform="rotate(-90 {x + 64:.1f} 0) translate({-place["tall"] / 2:.1f} 0)"'
    label = f"{clean(field)} ({unit.label})"
    size = min(13, max(MIN_LABEL_SIZE, int(place["tall"] / (LETTER_WIDTH * len(label)))))  # a thin section is low
    parts = [_text(x + 64, 0, label, anchor="middle", size=size, extra=turn)]
    for k, tone in enumerate(tones):
        y = top + height * (1 - (k + 1) / n)
        parts.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="16" height="{height / n + 0.4:.1f}" fill="{tone}"/>')
    every = max(1, -(-(n + 1) // 7))
    for k in range(0, n + 1, every):
        y = top + height * (1 - k / n)
        parts.append(_text(x + 22, y + 4.5, shortest(float(f"{limits[k] * unit.factor:.4g}")), anchor="start", size=12))
    return [f'<g class="bar">{"".join(parts)}</g>']


def _text(x: float, y: float, text: str, *, anchor: str, size: int = 13, colour: str = INK, extra: str = "") -> str:
    said = html.escape(text)
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-family="DejaVu Sans" font-size="{size}" '
        f'fill="{colour}"{extra}>{said}</text>'
    )


def _svg(name: str, wide: float, tall: float, parts: Sequence[str], data: Mapping[str, Any]) -> str:
    held = html.escape(json.dumps(data, separators=(",", ":")), quote=False)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.0f} {tall:.0f}" width="{wide:.0f}" '
        f'height="{tall:.0f}" id="{name}-svg"><metadata class="data">{held}</metadata>{"".join(parts)}</svg>'
    )


def script_data(found: Mapping[str, Any], place: Mapping[str, float]) -> dict[str, Any]:
    """Frames in the units of the picture, bands of every field, and labels."""
    frames, before = [], None
    for f in found["frames"]:
        at = to_picture(f["points"], place)
        same = before is not None and np.array_equal(before, f["triangles"])
        before = f["triangles"]
        frames.append(
            {
                "u": f["travel"],
                "f": f["force"],
                "x": np.round(at, 1).ravel().tolist(),
                "t": None if same else turned(at, f["triangles"]).ravel().tolist(),
                "v": {k: [float(f"{x:.3g}") for x in v] for k, v in f["fields"].items()},
                "i": np.round(to_picture(f["indenter"], place), 1).ravel().tolist(),
            }
        )
    fields = {}
    for k in found["units"]:
        limits, unit = levels(found, k), shown_unit(found, k)
        labels = [shortest(float(f"{v * unit.factor:.4g}")) for v in limits]
        tones = colours(len(limits) - 1)
        fields[k] = {"levels": limits.tolist(), "labels": labels, "colours": tones, "unit": unit.label}
    axis = -place["x"] * place["scale"] if found["frames"][-1]["mirrored"] else None
    return {"kind": "deformed", "frames": frames, "fields": fields, "axis": axis, "place": dict(place)}


# ------------------------------------------------------------------------------------------------------ the curve


def pressed_data(results: Results) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Depth and force of the measured curve, and of the fitted model from contact on, whose experiment is drawn."""
    found, model = results.get(DEFORMED_PICTURE) or {}, fitted_model(results)
    name = clean(found.get("experiment"))
    e = experiment(results, name)
    m = on_the_way(e.get("measured") or {})
    u, y = points(m.get("depth"), m.get("value"))
    x, f = model.curve(name) if model else ((), ())
    if len(u) < 2 or len(x) < 2:
        return None
    at = np.linspace(min(x[0], 0.0), x[-1], 80)
    return np.array(u), np.array(y), at, drawn_at(x, f, at)


def pressed_band(results: Results) -> BandView | None:
    """What was fitted to the curve that is drawn; None where results do not hold it."""
    name = clean((results.get(DEFORMED_PICTURE) or {}).get("experiment"))
    band = fitted_band(results, experiment(results, name))
    return None if band is None or len(band.loading.depth) < 2 else band.loading


def pressed_figure(results: Results, name: str) -> str:
    """Measured dots, the fitted line, and a ring where the section is."""
    found, data = body(results), pressed_data(results)
    assert found is not None and data is not None
    u, y, x, plain = data
    band = pressed_band(results)
    f = plain if band is None else band.over(x, plain)
    e = experiment(results, clean(found["experiment"]))
    unit = curve_unit(results, clean(found["experiment"]))
    wide, tall, left, below = 440.0, 290.0, 62.0, 44.0
    every = np.concatenate([y, f, plain])
    low, high = min(0.0, float(every.min())), 1.04 * float(every.max())
    first, end = min(0.0, float(u.min())), 1.03 * max(float(u.max()), float(x.max()))
    a, b = (wide - left - 8) / (end - first), (tall - below - 26) / (high - low)

    def at(depth: Any, force: Any) -> np.ndarray:
        return np.column_stack([left + a * (np.asarray(depth) - first), tall - below - b * (np.asarray(force) - low)])

    parts = [f'<path fill="none" stroke="{GREY}" d="M{left},22V{tall - below:.1f}H{wide - 8:.1f}"/>']
    for v in MaxNLocator(5).tick_values(first, end):
        if first <= v <= end:
            ((px, _),) = at([v], [low])
            parts.append(_text(px, tall - below + 18, shortest(float(f"{v:.4g}")), anchor="middle", size=12))
    ticks = MaxNLocator(5).tick_values(low * unit.factor, high * unit.factor)
    for v in ticks:
        if low * unit.factor <= v <= high * unit.factor:
            ((_, py),) = at([first], [v / unit.factor])
            parts.append(f'<path stroke="{LIGHT}" d="M{left},{py:.1f}H{wide - 8:.1f}"/>')
            parts.append(_text(left - 8, py + 4, shortest(float(f"{v:.4g}")), anchor="end", size=12))
    parts.append(_text((left + wide) / 2, tall - 8, "depth (mm)", anchor="middle"))
    parts.append(_text(4, 14, f"{channel_text(e.get('channel'))} ({unit.label})", anchor="start"))
    shown_ones = at(u, y)[:: max(1, len(u) // 60)]
    if band is not None:
        half = SD_OF_90_PERCENT * band.sd
        upper, lower = at(band.depth, band.value + half), at(band.depth, np.maximum(band.value - half, low))
        around = _path([np.vstack([upper, lower[::-1]])])
        parts.append(f'<path class="area" fill="{ACCENT}" fill-opacity="0.16" d="{around}"/>')
        dashed = 'stroke-width="1.1" stroke-dasharray="6 3"'
        parts.append(f'<path fill="none" stroke="{ACCENT}" {dashed} d="{_path([at(x, plain)], "")}"/>')
    parts += [f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="{PAPER}" stroke="{INK}"/>' for px, py in shown_ones]
    parts.append(f'<path fill="none" stroke="{ACCENT}" stroke-width="2.2" d="{_path([at(x, f)], "")}"/>')
    line = at(x, f)
    k = int(0.62 * len(line))
    word = "fitted model" if band is None else "fitted"
    parts.append(_text(line[k][0] + 10, line[k][1] + 20, word, anchor="start", colour=ACCENT))
    k = int(0.5 * len(u))
    mx, my = at(u, y)[k]
    parts.append(_text(mx - 10, my - 12, "measured", anchor="end"))
    last = found["frames"][-1]
    ((rx, ry),) = at([last["travel"]], [float(np.interp(last["travel"], x, f))])
    parts.append(
        f'<circle class="dot" cx="{rx:.1f}" cy="{ry:.1f}" r="7" fill="none" stroke="{ACCENT}" stroke-width="3"/>'
    )
    travels = [fr["travel"] for fr in found["frames"]]
    dots = at(travels, np.interp(travels, x, f))
    values = [quantity(float(np.interp(t, x, f)), e.get("unit", ""), 3, 1 / unit.factor) for t in travels]
    series = [
        {"name": "measured", "x": u.tolist(), "y": (y * unit.factor).tolist(), "p": np.round(at(u, y), 1).tolist()},
        {"name": word, "x": x.tolist(), "y": (f * unit.factor).tolist(), "p": np.round(line, 1).tolist()},
    ]
    if band is not None:
        y_plain, p = (plain * unit.factor).tolist(), np.round(at(x, plain), 1).tolist()
        series.append({"name": SIMULATED_LABEL, "x": x.tolist(), "y": y_plain, "p": p})
    labels = ["depth (mm)", f"{channel_text(e.get('channel'))} ({unit.label})"]
    held = {"kind": "pressed", "dots": np.round(dots, 1).tolist(), "said": values, "series": series, "labels": [labels]}
    return _svg(name, wide, tall, parts, held)
