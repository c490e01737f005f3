"""What a diagnosis of the same study has found, on the page of its results; the whole of it is on a page of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import DASH, known, significant
from rso.discrepancy.parameters import unproved
from rso.discrepancy.wording import UNDECIDED, undecided
from rso.report.discrepancy.reading import chance, sized
from rso.report.layout.digits import channel_text, clean, percent
from rso.report.layout.document import Block, Cell, Fact, Section, Table, Text, column, table, words
from rso.report.reading import Results, fitted_curves, pair

NOT_EXAMINED_NOTE = "Whether the model misses something, and what, has not been examined; “rso diagnose STUDY” does."
_MAX_GAP_REGIONS = 3  # the strongest; the page of the diagnosis has all
_GAP_VERDICTS = {
    "no_gap": ("none", "The model reproduces the measurements within their noise."),
    "explained": ("explained", "The model misses something, and the diagnosis has found its cause: {0}."),
    "ambiguous": ("several causes", "The model misses something, and these data cannot separate the causes: {0}."),
    "partly": ("partly explained", "The model misses something; {0} is part of it, not all."),
    "unexplained": ("unexplained", "The model misses something, and nothing in the catalogue explains it."),
    "measurement": ("the measurement", "Not the model but the measurement is off: {0}."),
    UNDECIDED: ("undecided", "Whether the model misses something is on the border: these data do not decide it."),
}


def diagnosed(results: Results) -> Mapping[str, Any]:
    """The block of the diagnosis, empty where there is none."""
    return results.get("diagnosis") or {}


def gap_fact(results: Results) -> list[Fact]:
    """The tile: what the gap is due to, and how much of it that closes."""
    d = diagnosed(results)
    if not d:
        return []
    v = UNDECIDED if undecided(d) else clean(d.get("verdict"))
    title, note = _GAP_VERDICTS.get(v, (v or DASH, ""))[0], _closed(d) or "see the diagnosis"
    return [Fact("Gap to reality", title, note, "good" if v in ("no_gap", "explained") else "warn")]


def gap_sentences(results: Results) -> list[str]:
    """That nothing is known of the gap, where that is so and there is something to compare."""
    return [] if diagnosed(results) or not fitted_curves(results) else [NOT_EXAMINED_NOTE]


def gap_sections(results: Results) -> tuple[Section, ...]:
    """Where the model is off and why, in short; no section without a diagnosis."""
    d = diagnosed(results)
    if not d:
        return ()
    causes = list(d.get("causes") or ())
    names = ", ".join(_name(c) for c in causes) or "no cause is named"
    v = UNDECIDED if undecided(d) else clean(d.get("verdict"))
    said = _GAP_VERDICTS.get(v, ("", v))[1].format(names)
    closed = _closed(d)
    proved = unproved(d) if d.get("verdict") == "no_gap" else []
    how_much = f"{closed[:1].upper()}{closed[1:]}." if closed else ""
    blocks: list[Block] = [Text(" ".join(filter(None, (said, *proved, how_much))))]
    if regions := _regions(d):
        blocks.append(Text(regions))
    if causes:
        blocks.append(_causes(causes))
    blocks.append(Text("How this was found, how sure it is and which test would decide:", "note", "diagnosis.html"))
    return (Section("gap", "Where the model is off", tuple(blocks)),)


def _name(c: Mapping[str, Any]) -> str:
    return channel_text(c.get("effect"))


def _closed(d: Mapping[str, Any]) -> str:
    s = d.get("shrinkage") or {}
    if not (known(s.get("closed")) and d.get("causes")):
        return ""
    held = ", ".join(clean(h) for h in s.get("held_out") or ())
    return f"the cause closes {percent(s['closed'])} of the gap on {held or 'curves that were held out'}"


def _regions(d: Mapping[str, Any]) -> str:
    """The places that are farthest off, where any is beyond noise."""
    rows = [r for r in d.get("where") or () if r.get("beyond_noise") and known(r.get("z"))][:_MAX_GAP_REGIONS]
    each = [
        f"{channel_text(r.get('channel'))} of {clean(r.get('experiment'))}, {clean(r.get('region'))} (measured "
        f"{'above' if r['z'] > 0 else 'below'} simulated, {significant(abs(r['z']), 2)} standard deviations)"
        for r in rows
    ]
    return f"Farthest off: {'; '.join(each)}." if each else ""


def _causes(causes: list[Mapping[str, Any]]) -> Table:
    sizes = [sized(c) for c in causes]
    ends = [c.get("interval") for c in causes]
    columns = [
        column("Cause", tuple(Cell(clean(c.get("description")) or _name(c)) for c in causes), number=False),
        column("probability", words([chance(c.get("probability")) for c in causes])),
        column("size", words([s[0] for s in sizes])),
        column("90 % interval", words([s[1] if pair(e) else DASH for s, e in zip(sizes, ends, strict=True)])),
        column("without it", words([s[2] for s in sizes])),
    ]
    return table("Causes", columns)
