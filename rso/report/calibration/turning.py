"""Pictures that turn: the deformed body, and a response surface over two parameters, as polygons seen from one side.

    a = x cos ψ − y sin ψ,    b = x sin ψ + y cos ψ,    (right, up, depth) = (a, b sin θ + z cos θ, b cos θ − z sin θ)

The SVG is the view at the first angles (yaw ψ, pitch θ); its data let a script draw any other.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex, to_rgb
from matplotlib.figure import Figure

from rso.core.digits import known, significant
from rso.report.calibration import deformed
from rso.report.canvas import ACCENT, INK
from rso.report.layout.digits import clean, quantity, shortest
from rso.report.layout.document import Picture, Section
from rso.report.reading import Results, grids, listed, outputs, parameters, target_output

BODY_PICTURE, RELIEF_PICTURE = "solid", "relief"
YAW_RAD, PITCH_RAD = 0.6, 0.5  # radians
HALF_PICTURE_WIDTH, PICTURE_HEIGHT = 320.0, 400.0  # half width and height of the picture
BODY_WIDTH_SHARE = 0.92  # of the half width that a body takes
FLOOR_HALF_WIDTH = 145.0  # half width of the floor under a surface
LIGHT_DIRECTION = np.array([-0.35, -0.45, 0.82])  # towards it, in the space of the body
MIN_SHADE = 0.62  # of a colour, where a face looks away from the light
RELIEF_HEIGHT_RATIO = 0.55  # height of a surface over its width
_RELIEF_COLOURS = LinearSegmentedColormap.from_list("relief", ["#eef2f1", "#99b5be", "#25586e"])
RELIEF_TONES = tuple(to_hex(c) for c in _RELIEF_COLOURS(np.linspace(0, 1, 32)))


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles (t, 3) of points (n, 3), a colour each, lines and texts in the same space."""

    points: np.ndarray
    triangles: np.ndarray
    bands: np.ndarray
    colours: Sequence[str]
    lines: Sequence[tuple[np.ndarray, bool]] = ()
    texts: Sequence[tuple[np.ndarray, str]] = ()
    shaded: bool = True


def turning_sections(results: Results) -> tuple[Section, ...]:
    """The body and the surface, what of both there is."""
    blocks = []
    found = deformed.body(results)
    if found is not None and body_solid(results) is not None:
        field = next(iter(found["units"]))
        depth = shortest(float(f"{found['frames'][-1]['travel']:.4g}"))
        said = f"The deformed body at {depth} mm, coloured by its {clean(field)}."
        blocks.append(Picture(BODY_PICTURE, said, share=1, by_hand="Drag it, or use the arrow keys."))
    if (s := _surface(results)) is not None and relief_solid(results) is not None:
        label = outputs(results)[s["output"]].label
        said = f"The response surface of {label}. Along the line the target is met, and nothing changes."
        blocks.append(Picture(RELIEF_PICTURE, said, share=1))
    return (Section("model", "The model, and what it answers", tuple(blocks)),) if blocks else ()


def body_figure(results: Results, name: str) -> str:
    """The whole body with its mirror images."""
    solid = body_solid(results)
    assert solid is not None
    return _drawn(solid, name)


def relief_figure(results: Results, name: str) -> str:
    """The response surface of the first output that has a target."""
    solid = relief_solid(results)
    assert solid is not None
    return _drawn(solid, name)


def body_solid(results: Results) -> Solid | None:
    """The surface of deformed.json, completed; None where there is none."""
    found: Any = deformed.body(results)
    try:
        surface, field = found["surface"], next(iter(found["units"]))
        x = np.asarray(surface["points"], float).reshape(-1, 3)
        t = np.asarray(surface["triangles"], int).reshape(-1, 3)
        v = np.asarray(surface["fields"][field], float).reshape(len(x))
        if not len(t) or t.min() < 0 or t.max() >= len(x) or not (np.isfinite(x).all() and np.isfinite(v).all()):
            return None
        for axis, mirrored in enumerate(surface["mirrored"]):
            if mirrored is True:
                other = x.copy()
                other[:, axis] *= -1.0
                x, t, v = np.vstack([x, other]), np.vstack([t, t[:, ::-1] + len(x)]), np.concatenate([v, v])
    except (TypeError, KeyError, ValueError, IndexError):
        return None
    limits = deformed.levels(found, field)
    tones = deformed.colours(len(limits) - 1)
    bands = np.clip(np.searchsorted(limits, v[t].mean(1), "right") - 1, 0, len(tones) - 1)
    middle = 0.5 * (x.min(0) + x.max(0))
    size = (
        BODY_WIDTH_SHARE
        * HALF_PICTURE_WIDTH
        / max(float(np.linalg.norm(np.ptp(x[:, :2], axis=0))) / 2, float(np.ptp(x[:, 2])) / 2, 1e-9)
    )
    return Solid((x - middle) * size, t, bands, tones)


def _surface(results: Results) -> Mapping[str, Any] | None:
    """The first surface over two parameters whose output has a target."""
    wanted = {target_output(t) for s in listed(results, "searches") for t in s.get("targets") or ()}
    rows = [s for s in grids(results) if (s.get("y") or {}).get("values") and len(s["y"]["values"]) > 1]
    return next((s for s in rows if s["output"] in wanted and s["output"] in outputs(results)), None)


def relief_solid(results: Results) -> Solid | None:
    """A grid of triangles over the ranges, the height the output; the line is where a target is met."""
    s = _surface(results)
    if s is None:
        return None
    Z = np.array([[np.nan if v is None else v for v in row] for row in s["mean"]], float)
    if Z.ndim != 2 or min(Z.shape) < 3 or not np.isfinite(Z).all() or not np.ptp(Z) > 0.0:
        return None
    ny, nx = Z.shape
    low, high = float(Z.min()), float(Z.max())
    wide = FLOOR_HALF_WIDTH

    def place(i: np.ndarray, j: np.ndarray, z: np.ndarray) -> np.ndarray:
        height = (z - low) / (high - low) - 0.5
        return np.stack(
            [(2 * j / (nx - 1) - 1) * wide, (2 * i / (ny - 1) - 1) * wide, 2 * RELIEF_HEIGHT_RATIO * wide * height], -1
        )

    rows, columns = np.meshgrid(np.arange(ny), np.arange(nx), indexing="ij")
    points = place(rows, columns, Z).reshape(-1, 3)
    a = (np.arange(ny - 1)[:, None] * nx + np.arange(nx - 1)).ravel()
    triangles = np.vstack([np.column_stack([a, a + 1, a + nx + 1]), np.column_stack([a, a + nx + 1, a + nx])])
    heights = np.tile(Z.ravel()[np.column_stack([a, a + 1, a + nx, a + nx + 1])].mean(1), 2)  # both halves alike
    bands = np.clip(((heights - low) / (high - low) * len(RELIEF_TONES)).astype(int), 0, len(RELIEF_TONES) - 1)
    values = [t["value"] for one in listed(results, "searches") for t in one.get("targets") or ()
              if target_output(t) == s["output"] and known(t.get("value"))]  # fmt: skip
    lines = []
    for value in list(dict.fromkeys(values))[:1]:
        level = Figure().subplots().contour(np.arange(nx), np.arange(ny), Z, [value])
        for line in level.allsegs[0]:
            if len(line) > 1:
                z = np.full(len(line), value + 0.004 * (high - low))
                lines.append((place(line[:, 1], line[:, 0], z), True))
    view = {p.name: p for p in parameters(results)}
    x, y = view.get(s["x"]["parameter"]), view.get(s["y"]["parameter"])
    o = outputs(results)[s["output"]]
    floor, out = -RELIEF_HEIGHT_RATIO * wide, 1.22 * wide
    corner = [(-wide, -wide), (wide, -wide), (wide, wide), (-wide, wide), (-wide, -wide)]
    lines.append((np.array([[*c, floor] for c in corner]), False))
    texts = [
        (np.array([0.0, -out, floor]), f"{x.letter}{x.unit.bracket}" if x else clean(s["x"]["parameter"])),
        (np.array([out, 0.0, floor]), f"{y.letter}{y.unit.bracket}" if y else clean(s["y"]["parameter"])),
        (np.array([-wide, -out, floor]), _end(x, s["x"]["values"][0])),
        (np.array([wide, -out, floor]), _end(x, s["x"]["values"][-1])),
        (np.array([out, wide, floor]), _end(y, s["y"]["values"][-1])),
        (
            np.array([-wide, wide, 1.06 * RELIEF_HEIGHT_RATIO * wide]),
            f"up to {quantity(high, o.base, 3, 1 / o.unit.factor)}",
        ),
    ]
    return Solid(points, triangles, bands, RELIEF_TONES, tuple(lines), tuple(texts), shaded=False)


def _end(p: Any, value: float) -> str:
    return significant(value * (p.unit.factor if p else 1.0), 3)


def seen_from(x: np.ndarray, yaw: float, pitch: float) -> np.ndarray:
    """Right, up and depth (n, 3) of points (n, 3)."""
    a = np.cos(yaw) * x[:, 0] - np.sin(yaw) * x[:, 1]
    b = np.sin(yaw) * x[:, 0] + np.cos(yaw) * x[:, 1]
    up = np.sin(pitch) * b + np.cos(pitch) * x[:, 2]
    return np.column_stack([a, up, np.cos(pitch) * b - np.sin(pitch) * x[:, 2]])


def normals(solid: Solid) -> np.ndarray:
    """Unit normals (t, 3) out of a body, whichever way its triangles are numbered: it lies about the origin."""
    a, b, c = (solid.points[solid.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    outward = np.where(((a + b + c) * normal).sum(1) < 0.0, -1.0, 1.0)
    return np.asarray(normal * (outward / np.where(length > 0.0, length, 1.0))[:, None])


def towards(solid: Solid) -> np.ndarray:
    """Which triangles (t,) may be seen from the first angles."""
    viewer = np.array([-np.sin(YAW_RAD) * np.cos(PITCH_RAD), -np.cos(YAW_RAD) * np.cos(PITCH_RAD), np.sin(PITCH_RAD)])
    return np.asarray(normals(solid) @ viewer > -0.5)  # a dent may look away from the middle


def shades(solid: Solid) -> np.ndarray:
    """How bright each triangle is (t,), by the angle between its normal and the light."""
    if not solid.shaded:
        return np.ones(len(solid.triangles))
    return np.round(MIN_SHADE + (1.0 - MIN_SHADE) * np.clip(normals(solid) @ LIGHT_DIRECTION, 0.0, 1.0), 2)


def _drawn(solid: Solid, name: str) -> str:
    """The polygons from far to near, then lines and texts."""
    q = seen_from(solid.points, YAW_RAD, PITCH_RAD)
    place = np.round(np.column_stack([HALF_PICTURE_WIDTH + q[:, 0], PICTURE_HEIGHT / 2 - q[:, 1]]), 1)
    order = np.argsort(-q[solid.triangles, 2].sum(1), kind="stable")
    parts, bright = ['<g fill="currentColor" stroke="currentColor" stroke-width=".6">'], shades(solid)
    a, b, c = (place[solid.triangles[:, k]] for k in range(3))
    facing = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) > 0.1  # others are lines
    facing &= bright > 0.0 if not solid.shaded else towards(solid)
    for k in order[facing[order]]:
        (x0, y0), (x1, y1), (x2, y2) = place[solid.triangles[k]]
        d = f"{x0:g},{y0:g}l{x1 - x0:.1f},{y1 - y0:.1f} {x2 - x1:.1f},{y2 - y1:.1f}"
        colour = to_hex(bright[k] * np.array(to_rgb(solid.colours[int(solid.bands[k])])))
        parts.append(f'<path color="{colour}" d="M{d}z"/>')
    parts.append("</g>")
    for line, strong in solid.lines:
        r = seen_from(line, YAW_RAD, PITCH_RAD)
        d = "L".join(f"{HALF_PICTURE_WIDTH + a:.1f},{PICTURE_HEIGHT / 2 - b:.1f}" for a, b in r[:, :2])
        look = f'stroke="{ACCENT}" stroke-width="3"' if strong else f'stroke="{INK}" stroke-width="1"'
        parts.append(f'<path d="M{d}" fill="none" {look}/>')
    for at, text in solid.texts:
        ((a, b, _),) = seen_from(at[None], YAW_RAD, PITCH_RAD)
        parts.append(
            f'<text x="{HALF_PICTURE_WIDTH + a:.1f}" y="{PICTURE_HEIGHT / 2 - b:.1f}" text-anchor="middle" '
            f'font-family="DejaVu Sans" font-size="13" fill="{INK}">{html.escape(text)}</text>'
        )
    data = {
        "kind": "turn",
        "yaw": YAW_RAD,
        "pitch": PITCH_RAD,
        "points": np.round(solid.points, 1).ravel().tolist(),
        "triangles": solid.triangles.ravel().tolist(),
        "bands": solid.bands.tolist(),
        "colours": list(solid.colours),
        "bright": bright.tolist() if solid.shaded else None,
        "lines": [{"points": np.round(line, 1).tolist(), "strong": strong} for line, strong in solid.lines],
        "texts": [{"at": np.round(at, 1).tolist(), "text": text} for at, text in solid.texts],
    }
    held = html.escape(json.dumps(data, separators=(",", ":")), quote=False)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * HALF_PICTURE_WIDTH:.0f} {PICTURE_HEIGHT:.0f}" '
        f'width="{2 * HALF_PICTURE_WIDTH:.0f}" '
        f'height="{PICTURE_HEIGHT:.0f}" id="{name}-svg"><metadata class="data">{held}</metadata>{"".join(parts)}</svg>'
    )
