"""What may be otherwise than a study says: plausible ranges, other supports, and tests and gauges that would show."""

from __future__ import annotations

import functools
from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from fem_backend.indenters import INDENTERS
from fem_backend.laws import ADDITIONS, LAWS
from fem_backend.simulation.experiment import Settings, on_axis
from fem_backend.simulation.knobs import knobs_class
from fem_backend.specimens import SPECIMENS
from fem_backend.supports import SUPPORTS

# lengths like it
SPECIMEN_LENGTH_KNOBS = ("offset_x", "offset_y", "inclusion_radius", "inclusion_depth", "inclusion_x")
INDENTER_LENGTH_KNOBS = ("skin_thickness", "adhesion", "adhesion_range")  # knobs that go with its length

POSE_UNCERTAINTY = {"offset_x": 0.1, "offset_y": 0.1, "tilt_x": 0.1, "tilt_y": 0.1}  # uncertainties, mm and degrees
BALANCE_UNCERTAINTY = {"weight": 2e-7}  # of a body that is weighed, N/mm³
PREVENTED_EFFECTS = {
    "all points again with a lubricated indenter": ("friction",),
    "all points again under water, which takes the adhesion away": ("adhesion",),
}
PLAUSIBLE_SKIN_SHARE = 0.9  # of the thickest skin that a specimen can have: one that is plausible
# lengths of the indenter: travel by which elements below are so distorted that programs part company
DISTORTED_TRAVEL_RATIO = 2.0
Range = tuple[float, float] | None


def plausible(own: Settings, given: Collection[str], declared: Mapping[str, Any]) -> dict[str, Range]:
    """Knob → its plausible range where the usual one does not suit these settings, None where none does.

    Lengths are plausible in proportion to what they belong to.  An inclusion stays as far from the lower side as it
    does from the upper one, and inside wherever it sits.  Laws do not combine: beside that of the settings, or of knobs
    that are `given` a value, there is no other; nor are there knobs of other specimens and indenters, nor effects of
    other supports.
    """
    knobs = {name: LAWS.own(name) for name in LAWS.members}
    law = next((name for name, mine in knobs.items() if not mine.isdisjoint(given)), own.law)
    others = [k for name, mine in knobs.items() for k in mine if law not in (LAWS.default, name)]
    if LAWS.members[law].small_strain:  # no stretch to relax, soften or stiffen with
        others += [next(iter(next(iter(each.switches.values())))) for each in ADDITIONS]
    others += SPECIMENS.of_others(own.specimen.name) | INDENTERS.of_others(own.indenter.name)
    others += own.specimen.absent() | own.support.absent(own.specimen)
    others += [k for k in SUPPORTS.of_others(own.support.name) if declared[k].neutral is not None]
    others += [] if _may_drain(own, given) else ["pore_D1"]
    return {**_lengths(own, declared), **_skin(own, declared), **_inclusion(own, declared), **dict.fromkeys(others)}


def _may_drain(own: Settings, given: Collection[str]) -> bool:
    """Whether pore flow may be a cause: a solver has it, and the study has no flow of its own.

    Layers differ in all moduli, and the liquid in them would have one.
    """
    held = not own.support.loose and not own.support.friction({})
    plain = not {"permeability", "friction", "adhesion"}.intersection(given) and not own.specimen.ratios
    return on_axis(own) and held and plain


def gauges(own: Settings) -> dict[str, tuple[str, float]]:
    """Measurements on the bench, as fine for a small body as for a large one: one takes another gauge."""
    by, noun = _factors(own), own.indenter.noun
    bench = f"specimen and {noun} on the bench: callipers, a micrometer, a balance"
    aligned = f"ink on the {noun} and a level on the holder"
    fine = {k: (bench, v) for k, v in {**own.specimen.gauges, **own.indenter.gauges}.items()}
    carrier = f"the {own.support.name} on the bench: callipers, a bore gauge"
    fine |= {k: (carrier, v) for k, v in own.support.gauges.items()}
    fine |= {k: (aligned, v) for k, v in POSE_UNCERTAINTY.items()} | {
        k: (bench, v) for k, v in BALANCE_UNCERTAINTY.items()
    }
    return {name: (words, by.get(name, 1.0) * value) for name, (words, value) in fine.items()}


def dimensions(own: Settings) -> dict[str, float]:
    """Knob → the stated size that it is an error of, in the knob's unit; 1 where it is a share of what is stated."""
    there = {**own.specimen.dimensions(), **own.indenter.dimensions(), **own.support.dimensions()}
    absent = own.specimen.absent() | own.support.absent(own.specimen)
    return {name: float(v) for name, v in there.items() if name not in absent}


def usual(own: Settings) -> dict[str, float]:
    """Knob → its default where the declared one belongs to another size of body or indenter."""
    return dict(_usual(own, knobs_class()))


@functools.lru_cache(maxsize=256)
def _usual(own: Settings, knobs: type) -> dict[str, float]:
    declared = {f.name: f.default for f in fields(knobs)}
    return {name: k * declared[name] for name, k in _factors(own).items() if declared[name]}


def _factors(own: Settings) -> dict[str, float]:
    """What knobs that hold a length belong to, over its usual size, where that is another."""
    of_it = (*(k for support in SUPPORTS.members.values() for k in support.lengths), *SPECIMEN_LENGTH_KNOBS)
    factors = {**own.specimen.factors(), **dict.fromkeys(of_it, own.specimen.ratio)}
    lengths = {f.name for f in fields(knobs_class()) if f.metadata["parameter"].unit == "mm"}  # not angles or shares
    factors |= dict.fromkeys((*lengths.intersection(own.indenter.gauges), *INDENTER_LENGTH_KNOBS), own.indenter.ratio)
    return {name: k for name, k in factors.items() if abs(k - 1.0) > 1e-9}


def _lengths(own: Settings, declared: Mapping[str, Any]) -> dict[str, Range]:
    """What grows with specimen or indenter: errors of dimensions and places, a skin, a clearance, an adhesion."""
    mine = {name: k for name, k in _factors(own).items() if declared[name].plausible}
    return {name: tuple(k * v for v in declared[name].plausible) for name, k in mine.items()}


def _skin(own: Settings, declared: Mapping[str, Any]) -> dict[str, Range]:
    """A skin no thicker than the specimen can have, where the indenter's share would be: a thin layer under a ball."""
    low, high = (_factors(own).get("skin_thickness", 1.0) * v for v in declared["skin_thickness"].plausible)
    most = PLAUSIBLE_SKIN_SHARE * own.specimen.skin_limit
    return {"skin_thickness": (low * most / high, most)} if high > most else {}


def _inclusion(own: Settings, declared: Mapping[str, Any]) -> dict[str, Range]:
    body, k = own.specimen, _factors(own).get("inclusion_radius", 1.0)
    high, low, across = (k * v for v in (*declared["inclusion_depth"].plausible, declared["inclusion_x"].plausible[1]))
    top = float(body.top[2])
    low, radius = min(low, top - float(body.lowest[2]) - high), k * declared["inclusion_radius"].default

    def inside(x: float) -> bool:
        at = np.array([[x, 0.0, top - d] for d in (high, low)])
        return low >= high and float(body.depth(at).min()) > radius

    x = next((float(x) for x in across * np.linspace(1.0, 0.1, 10) if inside(x)), None)
    if x is None:
        return {"inclusion_ratio": None}
    return {"inclusion_depth": (high, low), "inclusion_x": (-x, x)}


def tests(own: Settings) -> dict[str, Mapping[str, Any]]:
    """Further tests of the same specimen, in words, and the settings that they replace."""
    places = {f"the point ({x:g}, {y:g}) mm": {"point": [x, y]} for x, y in own.specimen.places()}
    return {**own.indenter.tests(), **places}


def camera_marks(own: Settings) -> dict[str, list[list[float]]]:
    """Surface marks that a camera could follow during a test, in words, and their places (x, y) in mm."""
    lines = own.specimen.lines(own.point, own.indenter.cover, own.indenter.ratio)
    return {words: line for words, line in lines.items() if len(line) > 5}


def variants(own: Settings) -> dict[str, Mapping[str, Any]]:
    """Other supports than that of the settings: what replaces them and the group of knobs that belongs to it.

    One that makes the same model of this specimen is left out: a flat one that is held is bonded to a stiff base.
    """
    found = {}
    for name, other in SUPPORTS.members.items():
        usual = SUPPORTS.read({"kind": name})
        tried = name != own.support.name and usual.refusal(own.specimen) is None and usual.offered(own.specimen)
        if tried and not own.support.same(usual, own.specimen):
            words = f"{other.words} instead of {own.support.words}"
            found[other.variant] = {"settings": {"support": {"kind": name}}, "group": other.group, "description": words}
    return found
