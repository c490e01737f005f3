"""Parameters in sentences: what they are without and with what was found, and what could move them besides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.units import people

NEAR = 0.02  # of a range, in ln: a median that near to its end is pressed against it


def about(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """Sentences about every parameter, open or fixed, and about ranges that are too narrow for the data."""
    own = [_parameter(d, found, k) + _beyond(d, found, k) for k in d["parameters"]["before"]]
    return own + _fixed(found) + _outside(d, found) + _pressed(d, found)


def called(found: Mapping[str, Any], name: str) -> str:
    """What people call an effect, or several joined by +; what is not in the catalogue as it is."""
    label = {e.get("name"): e.get("label") for e in found.get("effects") or ()}
    return " + ".join(label.get(part) or part for part in name.split(" + "))


def values_of(values: Mapping[str, float], found: Mapping[str, Any]) -> str:
    """Parameters with their units."""
    return ", ".join(f"{k} = {_amounts(found, k, v)}" for k, v in values.items())


def _amounts(found: Mapping[str, Any], k: str, *values: float, digits: int = 4) -> str:
    """Values of a parameter in the unit of people, that of the first; the others are the ends of its interval."""
    unit, factor = people(found.get("units", {}).get(k, ""), values[0])
    first, *ends = (f"{v * factor:.{digits}g}" for v in values)
    return f"{first}{of_unit(unit)} (90 % {' to '.join(ends)})" if ends else f"{first}{of_unit(unit)}"


def _range(found: Mapping[str, Any], k: str, low: float, high: float) -> str:
    """Two ends of a parameter in the unit of people, that of the upper one."""
    unit, factor = people(found.get("units", {}).get(k, ""), high)
    return f"{low * factor:.4g} to {high * factor:.4g}{of_unit(unit)}"


def of_unit(unit: str) -> str:
    """A unit behind a number: 3.3 1/MPa would be read as another number."""
    return "" if unit in ("1", "-", "") else f" {unit[1:] if unit.startswith('1/') else unit}"


def _parameter(d: Mapping[str, Any], found: Mapping[str, Any], k: str) -> str:
    """A base parameter without and with what was found."""
    each = [[d["parameters"][when][k][v] for v in ("median", "low", "high")] for when in ("before", "after")]
    # digits that its interval allows, one more than those of the half-width
    digits = [3 if high - low > 0.1 * abs(mid) else 4 for mid, low, high in each]
    was, now = (_amounts(found, k, *v, digits=n) for v, n in zip(each, digits, strict=True))
    alone = _amounts(found, k, each[0][0], digits=digits[0])
    if d["verdict"] == "no_gap":
        return f"{k} is {now} if nothing is missing."
    if d.get("odd"):
        return f"By all but {d['odd']['experiment']} {k} is {now}, with it {alone}."
    if d["verdict"] == "unexplained":
        return f"{k} is {now} beside what is unexplained, without it {alone}."
    return f"{k} stays at {now}." if was == now else f"{k} moves from {was} to {now}."


def _beyond(d: Mapping[str, Any], found: Mapping[str, Any], k: str) -> str:
    """What effects that the data neither show nor exclude could make of a parameter."""
    r = (d.get("reach") or {}).get(k)
    if not r or not (r["low_with"] or r["high_with"]):
        return ""
    unit, factor = people(found.get("units", {}).get(k, ""), r["high"])
    with_ = {v: f" (with {called(found, r[v + '_with'])})" if r[v + "_with"] else "" for v in ("low", "high")}
    low, high = (f"{r[v] * factor:.3g}{of_unit(unit)}{more}" for v, more in with_.items())
    return f" With effects that the data neither show nor exclude it could be anything from {low} to {high}."


def _fixed(found: Mapping[str, Any]) -> list[str]:
    """What the study fixes, so that no fit has moved it."""
    return [f"Fixed by the study, not fitted: {values_of(found['fixed'], found)}."] if found.get("fixed") else []


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
        now, near, middle = d["parameters"]["after"].get(k), (high / low) ** NEAR, (low * high) ** 0.5
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
