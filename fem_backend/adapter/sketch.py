"""A sketch of an experiment: its sentence and a section, drawn by specimen, indenter and support themselves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fem_backend.members import length_words
from fem_backend.simulation.experiment import Settings
from rso.contract import Drawn, Sketch

SKETCH_WIDTH_LENGTHS = 3.5  # lengths of the indenter to either side of the axis of a specimen without end
SKETCH_WIDTH_HEIGHTS = 1.6  # the same in heights of the specimen
SKETCH_HEIGHT_LENGTHS = 2.4  # lengths of the indenter above the contact
DRAWN_PLATE_SHARE = 0.1  # half widths: what a plate is drawn thick
N_OUTLINE_POINTS = 400  # points of an outline


def sketch(settings: Settings, depth: float) -> Sketch:
    """The vertical section through the axis of the specimen and the place of the test; ValueError beside the body."""
    specimen, indenter = settings.specimen, settings.indenter
    x, y = (0.0, 0.0) if specimen.alike else settings.point
    off = float(np.hypot(x, y))
    way = np.array([x, y]) / off if off else np.array([1.0, 0.0])
    way = way if way[0] > 0.0 or (way[0] == 0.0 and way[1] > 0.0) else -way  # x to the right, as in every figure
    on, normal = specimen.above(x, y)
    direction = -normal if settings.direction == "normal" else np.array([0.0, 0.0, -1.0])
    touch = indenter.first_contact(specimen, on, direction)
    across = np.array([[way[0], way[1], 0.0], [0.0, 0.0, 1.0]])
    wide = _half_width(settings, way)
    parts = _specimen(settings, way, wide)
    walls = _support(settings, way, wide, parts[0].points)
    contact = across @ indenter.contact(specimen, touch, direction)
    high = max(SKETCH_HEIGHT_LENGTHS * indenter.length, 0.12 * wide)
    box = np.array([[-wide, -np.inf], [wide, contact[1] + high]])
    first = _polygon(indenter.outline(touch, direction, across), box)
    deepest = []
    if depth > 0.0:
        text = f"at {length_words(depth)}, the deepest"
        deepest = [
            Drawn("deepest", _polygon(indenter.outline(touch + depth * direction, direction, across), box), text)
        ]
        end = contact + depth * (across @ direction)
        deepest.append(Drawn("dimension", (_pair(contact), _pair(end)), length_words(depth)))
    plane = "x" if abs(way[0]) == 1.0 else "y" if abs(way[1]) == 1.0 else f"({x:g}, {y:g}) mm"
    return Sketch(
        words=_words(settings, depth),
        plane=f"{plane} to the right" if len(plane) == 1 else f"through the axis and {plane}",
        drawn=(
            *parts,
            *walls,
            *deepest,
            Drawn("indenter", first, without_article(described(indenter))),
            Drawn("contact", (_pair(contact),)),
        ),
    )


def described(member: object) -> str:
    """A member with its sizes as a noun phrase; by its name where it says no more."""
    words = getattr(member, "described", "")
    return words or f"a {getattr(member, 'noun', getattr(member, 'name', '')).replace('_', ' ')}"


def without_article(words: str) -> str:
    """A noun phrase as a label."""
    return words.removeprefix("a ").removeprefix("an ")


def _words(settings: Settings, depth: float) -> str:
    """The experiment in a sentence."""
    support = _support_words(settings)
    on = f", {support}" if math.isinf(_cut(settings)) else ""
    where = "" if settings.point == (0.0, 0.0) else f", at x = {settings.point[0]:g}, y = {settings.point[1]:g} mm"
    how = ", along the normal" if settings.direction == "normal" else ""
    way = f"{where}{how}{',' if where or how else ''}"
    into = f"{described(settings.indenter)} pressed{way} into {described(settings.specimen)}{on}"
    return into + (f"; {length_words(depth)} at the deepest" if depth > 0.0 else "")


def _support_words(settings: Settings) -> str:
    """What holds or carries the specimen; a support may say it of this one."""
    support = settings.support
    on = getattr(support, "described_on", None)
    return on(settings.specimen) if on is not None else getattr(support, "described", "") or support.words


def _cut(settings: Settings) -> float:
    """Half widths of the sketch below the top from which on the specimen is cut."""
    return float(getattr(settings.specimen, "cut", math.inf))


def _half_width(settings: Settings, way: np.ndarray) -> float:
    """How far (mm) the sketch goes to either side of the axis."""
    specimen, length = settings.specimen, settings.indenter.length
    if specimen.alike:
        return max(
            SKETCH_WIDTH_LENGTHS * length,
            SKETCH_WIDTH_HEIGHTS * specimen.smallest if math.isinf(_cut(settings)) else 0.0,
        )
    points = np.array(_drawn(settings, way, np.inf)[0].points)
    return 1.05 * float(np.abs(points[:, 0]).max())


def _drawn(settings: Settings, way: np.ndarray, wide: float) -> list[Drawn]:
    """What the specimen draws of itself; one that draws nothing, its upper surface above its lowest point."""
    specimen = settings.specimen
    own = getattr(specimen, "drawn", None)
    if own is not None:
        return own(way, wide)
    reach, points = min(wide, 2.0 * specimen.largest), []
    for s in np.linspace(reach, -reach, N_OUTLINE_POINTS):
        try:
            points.append((float(s), float(specimen.above(*(s * way))[0][2])))
        except ValueError:  # beside it
            continue
    low = float(specimen.lowest[2])
    outline = ((points[-1][0], low), (points[0][0], low), *points)
    text = without_article(described(specimen))
    return [Drawn("specimen", outline, text), Drawn("edge", (*outline, outline[0]))]


def _specimen(settings: Settings, way: np.ndarray, wide: float) -> list[Drawn]:
    """The parts of the specimen, labels without an article."""
    first, *others = _drawn(settings, way, wide)
    return [Drawn(first.role, first.points, without_article(first.text)), *others]


def _support(settings: Settings, way: np.ndarray, wide: float, outline: tuple[tuple[float, float], ...]) -> list[Drawn]:
    """What of the outline is held, and walls; where there is neither, what the specimen lies on."""
    specimen, support = settings.specimen, settings.support
    if not math.isinf(_cut(settings)):  # it is held far below
        return []
    text = _support_words(settings)
    points = _dense(np.array(outline))
    space = np.column_stack([points[:, :1] * way, points[:, 1]])
    held = np.asarray(support.held(specimen, space, np.arange(len(space)))).any(axis=1)
    found = [Drawn("held", line, text) for line in _runs(points, held)]
    walls = getattr(support, "drawn", None)
    found += walls(specimen, way, wide) if walls is not None else []
    low = float(points[:, 1].min())
    if not found and low <= float(specimen.lowest[2]):
        under = points[points[:, 1] <= low + 1e-9 * (points[:, 1].max() - low)]
        ends = (float(under[:, 0].min()), low), (float(under[:, 0].max()), low)
        found = [Drawn("support", ends, text)]
    return [found[0], *(Drawn(d.role, d.points) for d in found[1:])] if found else []


def _dense(points: np.ndarray) -> np.ndarray:
    """A closed line (k, 2) with many points, its own among them."""
    closed = np.vstack([points, points[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    want = np.unique(np.concatenate([at, np.linspace(0.0, at[-1], N_OUTLINE_POINTS)]))
    return np.column_stack([np.interp(want, at, closed[:, k]) for k in (0, 1)])


def _runs(points: np.ndarray, chosen: Any) -> list[tuple[tuple[float, float], ...]]:
    """Pieces of a closed line (k, 2), its first point its last, that are chosen (k,), in its way."""
    if not chosen.any():
        return []
    start = 0 if chosen.all() else int(np.argmin(chosen))
    order = np.roll(np.arange(len(points) - 1), -start)
    runs, now = [], []
    for k in order:
        if chosen[k]:
            now.append(_pair(points[k]))
        elif now:
            runs.append(tuple(now))
            now = []
    runs += [tuple(now)] if now else []
    return [r for r in runs if len(r) > 1]


def _polygon(points: np.ndarray, box: np.ndarray) -> tuple[tuple[float, float], ...]:
    """A closed outline cut off at a box of two corners (2, 2); of a plane without thickness, a plate above it."""
    if np.ptp(points[:, 1]) <= 1e-9 * np.ptp(points[:, 0]):
        low, wide = float(points[0, 1]), float(box[1, 0])
        high = low + DRAWN_PLATE_SHARE * wide
        points = np.array([(-wide, low), (wide, low), (wide, high), (-wide, high)])
    return tuple(_pair(p) for p in np.clip(_dense(points), *box))


def _pair(point: np.ndarray) -> tuple[float, float]:
    return float(point[0]), float(point[1])
