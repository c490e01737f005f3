"""Section 4 of a diagnosis: how much of the gap on held-out curves closes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import DASH, NBSP, known, significant
from rso.discrepancy.parameters import called
from rso.discrepancy.wording import in_one_curve, percents
from rso.report.discrepancy.figures import drawn_curves
from rso.report.discrepancy.reading import Found, chance, chosen, core
from rso.report.layout.digits import aligned, clean, largest, percent, quantity, shown, symbol
from rso.report.layout.document import Block, Picture, Section, Table, Text, column, table, words
from rso.report.reading import listed, number, pair


def how_much(found: Found) -> Section:
    """Section 4: the gap on held-out curves before, after a re-fit, with the cause."""
    title, s = "How much of the gap is explained", core(found).get("shrinkage") or {}
    if not all(known(s.get(k)) for k in ("before", "refit_only", "with_cause")):
        return Section("how-much", title, (Text("One curve only: nothing is left to test a cause on.", "missing"),))
    how = clean(s.get("how"))
    blocks: list[Block] = []
    if known(s.get("closed")):
        text = f"{percent(s['closed'])} of what exceeds the noise floor is closed"
        text += f" (90{NBSP}%: {share_text(s.get('interval'))})" if pair(s.get("interval")) else ""
        own = " What every curve has for itself no other can predict: this share says nothing of it."
        blocks.append(
            Text(
                f"{text}, on curves that took no part in {_part(found)}: {how}."
                f"{own if each_its_own(found) else ''}{_in_one_curve(s)}"
            )
        )
    else:
        blocks.append(Text(f"No share is printed: before is not clearly above the noise floor. Held out: {how}."))
    blocks.append(
        Picture("shrinkage", "The gap G on held-out curves, in steps. G = 1 is what noise alone leaves (dashed).")
    )
    if len(drawn_curves(found)) > 1:
        blocks.append(Picture("curves", "The same for every held-out curve."))
    if fitted := s.get("fitted"):
        units = found.get("units") or {}
        each = [f"{symbol(k)} = {quantity(number(v), str(units.get(k) or ''))}" for k, v in fitted.items()]
        blocks.append(Text(f"Before: the base model as the study found it, {', '.join(each)}.", "note"))
    curves = list(s.get("curves") or ())
    if curves:
        blocks.append(_curves(found, curves, s))
    return Section("how-much", title, tuple(blocks))


def _part(found: Found) -> str:
    """What held-out curves took no part in: without those left out in turn the cause is chosen again."""
    curves = list((core(found).get("shrinkage") or {}).get("curves") or ())
    anew = chosen(found) and all("cause" in c for c in curves)
    if anew or "validate" in {e.get("role") for e in listed(found, "experiments")}:
        return "finding the cause"
    return "the fit, though in finding the cause" if chosen(found) else "the fit"


def _in_one_curve(s: Mapping[str, Any]) -> str:
    """That an interval over curves means little where one of them holds the whole gap."""
    lone = in_one_curve(s)
    if lone is None:
        return ""
    more = ", and the interval over curves says little" if pair(s.get("interval")) else ""
    return f" {chance(lone[1])} of what exceeds it is in {clean(lone[0])} alone: this is a share of one curve{more}."


def _curves(found: Found, curves: list[Mapping[str, Any]], s: Mapping[str, Any]) -> Table:
    cause = chosen(found) is not None
    names = words([clean(c.get("curve")) for c in curves])
    columns = [column("Held-out curve", names, number=False)]
    steps = [("before", "before"), ("refit_only", "re-fitted")] + [("with_cause", "with cause")] * cause
    for key, text in steps:
        columns.append(column(f"G {text}", aligned([number(c.get(key)) for c in curves], 3)))
    rms = [largest([number(v) for v in c.get("rms") or ()]) for c in curves]
    units = [shown("mm" if c.get("unit") == "mm" else "N", size) for c, size in zip(curves, rms, strict=True)]
    for k, (_, text) in enumerate(steps):
        values = [number((list(c.get("rms") or ()) + [None] * 3)[k]) for c in curves]
        scaled = [None if v is None else v * u.factor for v, u in zip(values, units, strict=True)]
        columns.append(column(f"rms {text}", aligned(scaled, 3)))
    columns.append(column("", words([u.label for u in units]), number=False))
    if cause and len({tuple(c.get("cause") or ()) for c in curves}) > 1:
        named = [clean(called(found, " + ".join(map(str, c.get("cause") or ())))) or "none" for c in curves]
        columns.append(column("cause without it", words(named), number=False))
    note = "G: mean of the squared misfit over its noise, correlations and gain included; rms: plain root mean square."
    if known(s.get("floor_error")):
        note += f" Without a gap the mean of G is 1 ± {significant(s['floor_error'], 2)}."
    return table("Curve by curve", columns, note)


def each_its_own(found: Found) -> bool:
    """Whether the leading cause is what every curve has for itself, which no other curve predicts."""
    causes = list(core(found).get("causes") or ())
    return bool(causes) and causes[0].get("family") == "scatter"


def share_text(ends: Any) -> str:
    return f"{percents(ends)}{NBSP}%".replace("-", "−") if pair(ends) else DASH
