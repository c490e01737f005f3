"""The end of a study in a few lines of text, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.report.calibration.inputs import assumed
from rso.report.layout.digits import percent, quantity, symbol
from rso.report.reading import about_zero, lettered


def summary(found: Mapping[str, Any]) -> list[str]:
    """Lines at the end of `rso run`, below its verdict."""
    counts, best, lines = found["counts"], found["best"], []
    for state in found["determined"].values():
        if not state.get("determined"):  # the verdict above says all of another
            lines.append(f"  {lettered(found, state['story'])}")
    units = {p["name"]: p["unit"] for p in found["parameters"]}
    likely = (found.get("identification") or {}).get("values") or {}
    if likely:
        lines.append(f"  most likely by the whole curves: {_values(likely, units)}")
    lines += _budget(found.get("identification") or {})
    lines += [f"  {text}" for text in assumed(found)]
    if best:
        named = [(s["name"], c) for s in found["searches"] for c in s["candidates"]]
        candidate = next(c for name, c in named if (name, c["name"]) == (best["search"], best["candidate"]))
        scores = "; ".join(
            f"NRMSE {m['nrmse']:.4f} on {e}"
            for e, m in candidate["metrics"].items()
            if m["nrmse"] is not None and not about_zero((found.get("baseline") or {}).get(e) or {})
        )
        values = _values(candidate["values"], units)
        lines.append(f"  best verified candidate ({best['candidate']}) for the targets: {values}; {scores}")
        if apart := [k for k, v in candidate["values"].items() if _outside(v, found["determined"].get(k))]:
            lines.append(f"    outside what agrees with the whole curves: its {' and '.join(map(symbol, apart))}")
    elif near := found.get("closest"):
        every = [c for s in found["searches"] for c in s["candidates"] if s["name"] == near["search"]]
        candidate = next(c for c in every if c["name"] == near["candidate"])
        values = _values(candidate["values"], units)
        lines.append("  no candidate is both verified and within every target and constraint")
        lines.append(f"  the closest ({near['candidate']}): {values}")
        lines += [f"    {d['words']}" for d in candidate["demands"] if not d["met"]]
    for v in found["validation"]:
        lines.append(f"  validation {v['experiment']} with {v['candidate']}: {validated(v)}")
    for v in found.get("predictions") or ():  # results of an older program have none
        said = "open" if v["verdict"] is None else "not predicted" if v["verdict"] == "no" else "predicted"
        why = v["why"] or ("p < 0.001" if v["p_value"] < 1e-3 else f"p = {v['p_value']:.2g}")
        lines.append(f"  {v['experiment']} by the most likely values: {said} ({why})")
    ended = ", ".join(f"{counts[state]} {state}" for state in ("done", "failed", "crashed"))
    saved = f"{counts['from_store']} of them known before, {counts['saved_by_similarity']} saved by similarity"
    lines.append(f"  {counts['fe_runs']} simulations ({ended}; {saved}), {found['timings']['total']:.0f} s")
    proved = [p["relative_difference"] for p in found["design"]["similarity"]["proof"]]
    proved = [p for p in proved if p is not None]
    if proved and found["design"]["similarity"]["applied"]:
        lines.append(f"  similarity proved on {len(proved)} direct runs: largest relative difference {max(proved):.1e}")
    elif proved:
        lines.append(f"  similarity {found['design']['similarity']['story']}")
    for warning in found["warnings"]:
        lines.append(f"  warning: {lettered(found, warning)}")
    return lines


MIN_SHOWN_VARIANCE_SHARE = 0.1  # of the variance of a parameter: what contributes less is in the table of the report


def _budget(data: Mapping[str, Any]) -> list[str]:
    """Which stated dimensions make much of the variance of each parameter."""
    lines = []
    for p in data.get("parameters") or ():
        rows = [(r["share"].get(p["parameter"]) or 0.0, r) for r in data.get("inputs") or ()]
        each = [
            f"{percent(share)} from {r['input']}{f' of {of}' if (of := r['experiment']) else ''} "
            f"(±{quantity(r['uncertainty'], '' if r['unit'] == '1' else r['unit'], 3)})"
            for share, r in sorted(rows, key=lambda row: -row[0])
            if share >= MIN_SHOWN_VARIANCE_SHARE
        ]
        if each:
            lines.append(f"  of the variance of {symbol(p['parameter'])}: {', '.join(each)}")
    return lines


def _values(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    return ", ".join(f"{symbol(k)} = {quantity(v, units.get(k, ''))}" for k, v in values.items())


def _outside(value: float, state: Mapping[str, Any] | None) -> bool:
    low, high = (state or {}).get("interval") or (None, None)
    if low is None or high is None:
        return False
    return max(low - value, value - high) > 1e-9 * max(abs(low), abs(high))  # at an end is inside


def validated(v: Mapping[str, Any]) -> str:
    """How well a candidate predicts an experiment: at the deepest reading of a curve, over all marks of a profile."""
    if not v["predicted"]:
        return f"{v['state']}: {v['reason']}"
    if v["position"]:
        deepest = max(v["measured"], key=abs)
        n, rmse = v["metrics"]["n"], v["metrics"]["rmse"]
        return f"{n} readings missed by {rmse:.2g} mm (RMSE), the largest measured is {deepest:.4g} mm"
    k = max(range(len(v["depth"])), key=lambda i: v["depth"][i])
    predicted, measured = (f"{v[what][k]:.4g} {v.get('unit', '')}".strip() for what in ("predicted", "measured"))
    return f"{v.get('channel', '')} predicted {predicted}, measured {measured} at {v['depth'][k]:g} mm".strip()
