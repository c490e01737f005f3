"""What may be otherwise than a study says: plausible ranges, other supports, and tests and gauges that would tell."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from fem_backend.materials import zones
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.supports import SUPPORTS

LAW_KNOBS = {"mooney_rivlin": {"C01"}, "yeoh": {"C20", "C30"}, "ogden": {"alpha"}}  # each law's own
WITHOUT_STRETCH = ["prony_g", "mullins", "fibre"]  # what small strains do not have
USUAL = (60.0, 35.0, 35.0), 3.0  # semi-axes and ball radius (mm) that the declared ranges are meant for
OF_THE_BODY = ("bowl_clearance", "offset_x", "offset_y", "inclusion_radius", "inclusion_depth", "inclusion_x")
OF_THE_BALL = ("delta_R", "skin_thickness", "adhesion", "adhesion_range")
BENCH = "specimen and ball on the bench: callipers, a micrometer, a balance"
ALIGNED = "ink on the ball and a level on the holder"
GAUGES = {
    "delta_a": (BENCH, 0.1), "delta_b": (BENCH, 0.1), "delta_c": (BENCH, 0.1), "delta_R": (BENCH, 0.01),
    "offset_x": (ALIGNED, 0.1), "offset_y": (ALIGNED, 0.1), "tilt_x": (ALIGNED, 0.1), "tilt_y": (ALIGNED, 0.1),
    "weight": (BENCH, 2e-7),
}  # fmt: skip
PREVENTED = {
    "all points again with a lubricated ball": ("friction",),
    "all points again under water, which takes the adhesion away": ("adhesion",),
}
DEEP = 2.0  # of R: travel by which elements under the ball are so distorted that programs part company
Range = tuple[float, float] | None


def plausible(own: Settings, given: Collection[str], known: Mapping[str, Any]) -> dict[str, Range]:
    """Knob → its plausible range where the usual one does not suit these settings, None where none does.

    Lengths are plausible in proportion to what they belong to.  An inclusion stays as far from the lower side as it
    does from the upper one, and inside wherever it sits.  Laws do not combine: beside that of the settings, or of knobs
    that are `given` a value, there is no other.
    """
    law = next((name for name, knobs in LAW_KNOBS.items() if not knobs.isdisjoint(given)), own.law)
    others = [k for name, knobs in LAW_KNOBS.items() for k in knobs if law not in ("neo_hookean", name)]
    others += WITHOUT_STRETCH if law == "linear_elastic" else []
    return {**_lengths(own, known), **_inclusion(own, known), **dict.fromkeys(others)}


def gauges(own: Settings) -> dict[str, tuple[str, float]]:
    """Measurements on the bench, as fine for a small body as for a large one: one takes another gauge."""
    by = _factors(own)
    return {name: (words, by.get(name, 1.0) * fine) for name, (words, fine) in GAUGES.items()}


def usual(own: Settings) -> dict[str, float]:
    """Knob → its default where the declared one belongs to another size of body or ball."""
    declared = {f.name: f.default for f in fields(Knobs)}
    return {name: k * declared[name] for name, k in _factors(own).items() if declared[name]}


def _factors(own: Settings) -> dict[str, float]:
    """What knobs that hold a length belong to, over its USUAL size, where that is another."""
    axes, R = np.array(USUAL[0]), USUAL[1]
    a, b, c = (float(v) for v in own.body.semi_axes / axes)
    factors = {"delta_a": a, "delta_b": b, "delta_c": c}
    factors |= dict.fromkeys(OF_THE_BODY, (a * b * c) ** (1.0 / 3.0)) | dict.fromkeys(OF_THE_BALL, own.R / R)
    return {name: k for name, k in factors.items() if abs(k - 1.0) > 1e-9}


def _lengths(own: Settings, known: Mapping[str, Any]) -> dict[str, Range]:
    """What grows with the body or the ball: errors of dimensions and places, a skin, a clearance, an adhesion."""
    mine = {name: k for name, k in _factors(own).items() if known[name].plausible}
    return {name: tuple(k * v for v in known[name].plausible) for name, k in mine.items()}


def _inclusion(own: Settings, known: Mapping[str, Any]) -> dict[str, Range]:
    body, k = own.body, _factors(own).get("inclusion_radius", 1.0)
    high, low, across = (k * v for v in (*known["inclusion_depth"].plausible, known["inclusion_x"].plausible[1]))
    low, radius = min(low, 2.0 * body.c - high), k * known["inclusion_radius"].default

    def inside(x: float) -> bool:
        at = np.array([[x, 0.0, body.c - d] for d in (high, low)])
        return low >= high and float(zones.depth(body, at).min()) > radius

    x = next((float(x) for x in across * np.linspace(1.0, 0.1, 10) if inside(x)), None)
    if x is None:
        return {"inclusion_ratio": None}
    return {"inclusion_depth": (high, low), "inclusion_x": (-x, x)}


def tests(own: Settings) -> dict[str, Mapping[str, Any]]:
    """Further tests of the same specimen, in words, and the settings that they replace."""
    x, y = (float(f"{0.35 * v:.3g}") for v in (own.body.a, own.body.b))
    return {
        f"a ball of R = {2 * own.R:g} mm": {"indenter": {"shape": "sphere", "radius": 2 * own.R}},
        f"the point ({x:g}, 0) mm": {"point": [x, 0.0]},
        f"the point (0, {y:g}) mm": {"point": [0.0, y]},
    }


def marks(own: Settings) -> dict[str, list[list[float]]]:
    """Surface marks that a camera could follow during a test, in words, and their places (x, y) in mm."""
    (x, y), (a, b), beside = own.point, (own.body.a, own.body.b), 5.0 / 3.0 * own.R  # the ball hides what is nearer
    unit, share = own.R / USUAL[1], np.linspace(-0.5, 0.5, 13)

    def mark(*at: float) -> list[float]:
        return [float(f"{unit * round(float(v) / unit, 2):.12g}") for v in at]

    lines = {
        "surface marks along x": [mark(x + s * a, y + beside) for s in share],
        "surface marks along y": [mark(x + beside, y + s * b) for s in share],
    }
    on_top = lambda m: (m[0] / a) ** 2 + (m[1] / b) ** 2 < 0.8  # noqa: E731 - what a camera sees from above
    seen = {words: [m for m in line if on_top(m)] for words, line in lines.items()}
    return {words: line for words, line in seen.items() if len(line) > 5}


def variants(own: Settings) -> dict[str, Mapping[str, Any]]:
    """Other supports than that of the settings: what replaces them and the group of knobs that belongs to it."""
    found = {}
    for name, other in SUPPORTS.members.items():
        if name != own.support.name and other().refusal(own.body) is None:
            words = f"{other.words} instead of {own.support.words}"
            found[other.variant] = {"settings": {"support": {"kind": name}}, "group": other.group, "description": words}
    return found
