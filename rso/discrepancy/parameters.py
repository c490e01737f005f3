"""Parameters in sentences: over all that the data allow, and if nothing is there but what is said."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.symbols import unit_text
from rso.core.units import people

MENTIONED_WIDTH_RATIO = 1.15  # times: an interval that is said beside another is wider by this
MAX_LEFT_CHI2 = 2.0  # χ² per reading that a hypothesis leaves: beyond it its intervals of parameters are not said
RANGE_END_SHARE_LN = 0.02  # of a range, in ln: a median that near to its end is pressed against it


def parameter_sentences(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """Sentences about every parameter, open or fixed, and about ranges that are too narrow for the data."""
    own = [
        _doubtful(d, found, k)
        if is_far_from_the_data(d)
        else " ".join(filter(None, (_parameter(d, found, k), known_alone(d, found, k))))
        for k in d["parameters"]["before"]
    ]
    return own + _trusted(d, found) + _fixed(found) + _outside(d, found) + _pressed(d, found)


def is_far_from_the_data(d: Mapping[str, Any]) -> bool:
    """Whether causes are named that leave so much of the gap that their intervals of parameters mean nothing.

    These intervals are those of a right hypothesis; a wrong one is as sure of itself.
    """
    return bool(d.get("chosen")) and not d.get("odd") and (d.get("left") or 0.0) > MAX_LEFT_CHI2


def _doubtful(d: Mapping[str, Any], found: Mapping[str, Any], k: str) -> str:
    """A base parameter with and without causes that leave more than noise: values alone."""
    was, now = (_amounts(found, k, d["parameters"][when][k]["median"], digits=3) for when in ("before", "after"))
    return (
        f"{k} would be {now} with what is named, {was} without it. What is left is {d['left'] ** 0.5:.2g} times the "
        f"noise: no interval of {k} can be stated."
    )


def called(found: Mapping[str, Any], name: str) -> str:
    """What people call an effect, or several joined by +; what is not in the catalogue as it is."""
    label = {e.get("name"): e.get("label") for e in found.get("effects") or ()}
    return " + ".join(label.get(part) or part for part in name.split(" + "))


def values_with_units(values: Mapping[str, float], found: Mapping[str, Any]) -> str:
    """Parameters with their units."""
    return ", ".join(f"{k} = {_amounts(found, k, v)}" for k, v in values.items())


def _amounts(found: Mapping[str, Any], k: str, *values: float, digits: int = 4) -> str:
    """Values of a parameter in the unit of people, that of the first; the others are the ends of its interval."""
    unit, factor = people(found.get("units", {}).get(k, ""), values[0])
    first, *ends = (f"{v * factor:.{digits}g}" for v in values)
    return f"{first}{unit_suffix(unit)} (90 % {' to '.join(ends)})" if ends else f"{first}{unit_suffix(unit)}"


def _range(found: Mapping[str, Any], k: str, low: float, high: float) -> str:
    """Two ends of a parameter in the unit of people, that of the upper one."""
    unit, factor = people(found.get("units", {}).get(k, ""), high)
    return f"{low * factor:.4g} to {high * factor:.4g}{unit_suffix(unit)}"


def unit_suffix(unit: str) -> str:
    """A unit behind a number, as it is printed."""
    return f" {unit_text(unit)}".rstrip()


def _parameter(d: Mapping[str, Any], found: Mapping[str, Any], k: str) -> str:
    """A base parameter without and with what was found."""
    each = [[d["parameters"][when][k][v] for v in ("median", "low", "high")] for when in ("before", "after")]
    # digits that its interval allows, one more than those of the half-width
    digits = [3 if high - low > 0.1 * abs(mid) else 4 for mid, low, high in each]
    was, now = (_amounts(found, k, *v, digits=n) for v, n in zip(each, digits, strict=True))
    alone = _amounts(found, k, each[0][0], digits=digits[0])
    if d["verdict"] == "no_gap":
        return f"{k} is {now}."
    if d.get("odd"):
        return f"By all but {d['odd']['experiment']} {k} is {now}, with it {alone}."
    if d["verdict"] == "unexplained":
        return f"{k} is {now} beside what is unexplained, without it {alone}."
    return f"{k} stays at {now}." if was == now else f"{k} moves from {was} to {now}."


def known_alone(d: Mapping[str, Any], found: Mapping[str, Any], k: str) -> str:
    """How well a parameter is known if nothing is there but what is said, and what that leaves out; nothing where it
    leaves out nothing that counts."""
    whole, alone = (d["parameters"].get(when, {}).get(k) for when in ("after", "if_nothing_else"))
    r = (d.get("reach") or {}).get(k) or {}
    if not whole or not alone or whole["high"] - whole["low"] < MENTIONED_WIDTH_RATIO * (alone["high"] - alone["low"]):
        return ""
    by, without = r.get("by") or (), r.get("without") or alone
    if not by:
        nothing = "nothing is missing" if d["verdict"] == "no_gap" else "nothing else is there"
        widen = "effects that the data neither show nor exclude widen this"
        return f"It is {_known(found, k, alone)} if {nothing}; {widen}."
    each = " and without ".join(called(found, v) for v in by)
    them = "it" if len(by) == 1 else "them"
    return (
        f"It is {_known(found, k, without)} without {each}, else {_known(found, k, whole)}: "
        f"the data neither show nor exclude {them}."
    )


def unproved(d: Mapping[str, Any]) -> list[str]:
    """That a model without a gap need not have the right parameters, with how well they are known then."""
    alone, whole = ((d.get("parameters") or {}).get(when) or {} for when in ("if_nothing_else", "after"))
    worth = [
        k
        for k in whole
        if k in alone
        and alone[k]["low"] < alone[k]["high"]
        and whole[k]["high"] - whole[k]["low"] > MENTIONED_WIDTH_RATIO * (alone[k]["high"] - alone[k]["low"])
    ]
    each = [f"{k} {percent_of(alone[k])} if nothing is missing, else {percent_of(whole[k])}" for k in worth]
    return [f"That does not prove its parameters: known are {'; '.join(each)}."] if each else []


def percent_of(band: Mapping[str, float]) -> str:
    """Half the width of an interval over its median, in words; a factor where that is large."""
    half = 0.5 * (band["high"] - band["low"]) / max(abs(band["median"]), 1e-300)
    if half > 1.0 and band["low"] > 0.0:
        return f"to a factor of {(band['high'] / band['low']) ** 0.5:.2g}"
    return f"to {100 * half:.2g} %"


def _known(found: Mapping[str, Any], k: str, band: Mapping[str, float]) -> str:
    return f"known {percent_of(band)} ({_range(found, k, band['low'], band['high'])})"


def _trusted(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """What no indentation shows and a calibration must show, and how far it was trusted."""
    labels = {"gain": "the gain of the cell", "depth_scale": "the scale of the depth"}
    usual = {k: v["sd"] for k, v in (found.get("trusted") or {}).items() if not v["stated"] and v["sd"]}
    each = [f"{labels.get(k, called(found, k))} to {100 * v:.2g} %" for k, v in usual.items()]
    if not each:
        return []
    more = "a gain that is off by more moves the modulus by as much; noise.calibration states it"
    return [f"Trusted, as no indentation shows them and nothing is stated: {' and '.join(each)} ({more})."]


def _fixed(found: Mapping[str, Any]) -> list[str]:
    """What the study fixes, so that no fit has moved it."""
    return (
        [f"Fixed by the study, not fitted: {values_with_units(found['fixed'], found)}."] if found.get("fixed") else []
    )


def _outside(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """A modulus whose interval misses the range of the study: what stiffens a body as a whole shows in nothing else."""
    m = found.get("modulus") or {}
    now = d["parameters"]["after"].get(m.get("name"))
    if now is None or (m["low"] <= now["high"] and now["low"] <= m["high"]):
        return []
    way = "stiffer" if now["low"] > m["high"] else "softer"
    mine = _amounts(found, m["name"], *(now[k] for k in ("median", "low", "high")))
    ends = _range(found, m["name"], m["low"], m["high"])
    return [
        f"{m['name']} = {mine} lies outside the range of the study, {ends}: look at that range, or at what makes the "
        f"whole body {way}."
    ]


def _pressed(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """A parameter at the end of the range that its fits keep to: the data may want it beyond."""
    out = []
    for k, (low, high) in (found.get("ranges") or {}).items():
        now, near, middle = d["parameters"]["after"].get(k), (high / low) ** RANGE_END_SHARE_LN, (low * high) ** 0.5
        if now is None:
            continue
        up = now["median"] >= high / near or (now["high"] >= high / near and now["low"] > middle)
        if up or now["median"] <= low * near or (now["low"] <= low * near and now["high"] < middle):
            ends = _range(found, k, low, high)
            out.append(
                f"{k} is pressed against the end of its range in the study, {ends}: what data want beyond it may look "
                "like a cause."
            )
    return out
