"""The answer of a run in a few lines: what is known, what is not, whether tests that were not fitted are predicted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rso.cli.output import Mark
from rso.core.digits import estimate, interval_ends
from rso.core.symbols import symbol, unit_text
from rso.core.units import people

MAX_DERIVED_LINES = 2  # quantities that follow from the parameters, as many as on the first page of a report


def verdict_lines(found: Mapping[str, Any]) -> Iterator[tuple[Mark, str]]:
    """A mark and a line for each parameter, derived quantity and experiment that was not fitted, by results.json."""
    known = found.get("identification") or {}
    rows = {p["parameter"]: p for p in known.get("parameters") or ()}
    doubts = str(known.get("doubts") or "")
    agrees = "fits as well as any" if doubts or _is_refuted(known) else "agrees with the data"
    if doubts:
        yield "bad", f"the fit is not believed: {doubts[0].lower()}{doubts[1:].partition('. ')[0]}"
    for p in found.get("parameters") or ():
        row = rows.get(p["name"])
        if p.get("fixed") is None and row is not None:
            determined = row.get("verdict") == "determined"
            yield _quantity(symbol(p["name"]), row, p.get("unit", ""), determined, agrees)
    for q in list(known.get("derived") or ())[:MAX_DERIVED_LINES]:
        yield from _follows(q, agrees)
    for q in known.get("derived") or ():
        if q.get("unlikely"):
            yield "open", f"look again: {q['unlikely']}"
    for v in found.get("predictions") or ():
        yield _prediction(v)
    if found.get("exit_code") == 4:
        yield "bad", "a rerun of a candidate disagrees with its prediction"
    if found.get("exit_code") == 6:
        yield "bad", "no candidate meets every target and constraint"


def _is_refuted(known: Mapping[str, Any]) -> bool:
    """Whether the model misses the data widely, or by more than noise explains: no value agrees with them then."""
    scale, p = known.get("scale"), known.get("p_value")
    if scale is None or scale <= 1.0:
        return False
    from rso.inference.rules import RULES  # what its package imports takes longer than all else of `rso status`

    return scale > RULES.refuted_error_ratio or (p is not None and p < RULES.refuted_fit_chance)


def condensed(found: Mapping[str, Any]) -> dict[str, Any]:
    """The same as data, for programs: the keys that `--json` prints, in base units (mm, N, MPa, s)."""
    known = found.get("identification") or {}
    rows = {p["parameter"]: p for p in known.get("parameters") or ()}
    parameters = {}
    for p in found.get("parameters") or ():
        row = rows.get(p["name"], {})
        value = row.get("value") if p.get("fixed") is None else p["fixed"]
        verdict = row.get("verdict", "not") if p.get("fixed") is None else "fixed"
        interval = row.get("interval")
        parameters[p["name"]] = {"value": value, "unit": p["unit"], "interval": interval, "verdict": verdict}
    derived = {
        q["name"]: {
            "value": q["value"],
            "unit": q["unit"],
            "interval": q["interval"],
            "known": q.get("known") is True,
            "follows_from": list(q.get("follows_from") or ()),
        }
        for q in known.get("derived") or ()
    }
    keys = ("experiment", "verdict", "p_value")
    return {
        "title": (found.get("study") or {}).get("title"),
        "stage": found.get("stage"),
        "exit_code": found.get("exit_code"),
        "exit_reason": found.get("exit_reason"),
        "level": known.get("level"),
        "parameters": parameters,
        "derived": derived,
        "predictions": [{k: v.get(k) for k in keys} for v in found.get("predictions") or ()],
        "counts": found.get("counts"),
        "warnings": list(found.get("warnings") or ()),
    }


def _follows(q: Mapping[str, Any], agrees: str) -> Iterator[tuple[Mark, str]]:
    """A line of a quantity that follows from the parameters; none where it follows from what the study fixes."""
    span, unit = q.get("interval"), q.get("unit", "")
    if q.get("follows_from"):
        return
    if q.get("known") is True or not span or None in span:
        yield _quantity(q["letter"], q, unit, q.get("known") is True, agrees)
    else:
        yield "open", f"{q['letter']} from {interval_in_unit(span, unit)} {agrees}"


def _quantity(name: str, row: Mapping[str, Any], unit: str, determined: bool, agrees: str) -> tuple[Mark, str]:
    span = row.get("interval")
    if not span or None in span:
        return "open", f"{name} has no interval"
    if determined:
        return "good", f"{name} = {estimate_text(row['value'], span, unit)} ({interval_in_unit(span, unit)})"
    known = "weakly" if row.get("verdict") == "weakly" else "not"
    return "open", f"{name} is {known} determined: {interval_in_unit(span, unit)} {agrees}"


def _prediction(v: Mapping[str, Any]) -> tuple[Mark, str]:
    p = v.get("p_value")
    why = v.get("why") or (f"p {'< 0.001' if p < 1e-3 else f'= {p:.2g}'}" if p is not None else "")
    behind = f" ({why})" if why else ""
    if v.get("verdict") is None:
        return "open", f"whether {v['experiment']} is predicted is undecided{behind}"
    if v["verdict"] == "no":
        return "bad", f"{v['experiment']} is not predicted{behind}"
    return "good", f"{v['experiment']} is predicted{behind}"


def estimate_text(value: float, span: tuple[float, float], unit: str) -> str:
    """A value in the unit that people use, with the digits of its interval."""
    label, factor = people(unit, max(map(abs, span)))
    low, high = (end * factor for end in span)
    return f"{estimate(value * factor, low, high)}{_behind(label)}"


def interval_in_unit(span: tuple[float, float], unit: str) -> str:
    """An interval in the unit that people use."""
    label, factor = people(unit, max(map(abs, span)))
    low, high = interval_ends(span[0] * factor, span[1] * factor)
    return f"{low} to {high}{_behind(label)}"


def number_text(x: float, digits: int) -> str:
    """A number with so many significant digits and no exponent between 10⁻⁴ and 10⁶."""
    if x == 0 or not math.isfinite(x):
        return f"{x:g}"
    size = int(f"{abs(x):.{digits - 1}e}".split("e")[1])
    return f"{x:.{max(digits - 1 - size, 0)}f}" if -5 < size < 6 else f"{x:.{digits - 1}e}"


def _behind(label: str) -> str:
    unit = unit_text(label)
    return f" {unit}" if unit else ""
