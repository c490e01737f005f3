"""The report of a diagnosis: gap or not, where, which cause, how much, how sure, what next.  Computes no model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack

from rso.core.digits import DASH, NBSP, known, significant
from rso.core.symbols import in_letters
from rso.discrepancy.parameters import called, is_far_from_the_data, known_alone, unproved
from rso.discrepancy.wording import (
    MENTIONED_NO_GAP_PROBABILITY,
    UNDECIDED,
    in_one_curve,
    may_be_absent,
    nothing,
    shaped,
    undecided,
)
from rso.report.canvas import short
from rso.report.discrepancy.background import background
from rso.report.discrepancy.figures import draw, leading
from rso.report.discrepancy.maps import MAX_MAP_PANELS, N_FIRST_PANELS
from rso.report.discrepancy.reach import how_sure, in_sight, next_test
from rso.report.discrepancy.reading import (
    Found,
    band,
    brief,
    chance,
    chosen,
    core,
    descriptions,
    effects_of,
    interval,
    p_text,
    panels,
    parameter_bands,
    said_when,
    signatures,
    sized,
    told,
    unit_of,
    verdict_of,
)
from rso.report.discrepancy.shrinkage import each_its_own, how_much, share_text
from rso.report.discrepancy.signatures import N_SIGNATURE_ROWS, colours
from rso.report.language import PageOptions, names_of, write_page
from rso.report.layout.byline import byline
from rso.report.layout.digits import aligned, clean, percent, quantity, symbol
from rso.report.layout.document import (
    Block,
    Cell,
    Fact,
    Facts,
    Mark,
    Picture,
    Report,
    Section,
    Table,
    Text,
    column,
    table,
    words,
)
from rso.report.reading import listed, number, pair
from rso.report.sketch import sketch_blocks

MIN_NAMED_CAUSES_PROBABILITY = 0.9  # probability of all named causes below which it is said that others hold the rest

_DIAGNOSIS_VERDICTS = {
    "no_gap": ("No gap", "The model reproduces these measurements within their noise."),
    "explained": ("Explained", "The model misses something, and this explains it: {0}."),
    "ambiguous": ("Ambiguous", "The model misses something, and these data cannot separate the causes: {0}."),
    "partly": ("Partly explained", "The model misses something, and {0} is part of it, not all."),
    "unexplained": ("Unexplained", "The model misses something, and nothing in the catalogue explains it."),
    "measurement": ("The measurement", "Not the model but the measurement is off: {0}."),
    UNDECIDED: ("Undecided", "Whether the model misses something is on the border: these data do not decide it."),
}


def render_diagnosis(found: Found, folder: Path, **options: Unpack[PageOptions]) -> list[Path]:
    """Write diagnosis.html and diagnosis.pdf into `folder` from the plain data of a diagnosis; list of files.

    The same data give the same bytes. What a diagnosis does not hold is said to be missing.
    """
    return write_page(report(found), lambda n: draw(found, n), folder, "diagnosis", names_of(found), options)


def report(found: Found) -> Report:
    """The whole document, in the order in which a reader asks."""
    return Report(
        clean(found.get("title")) or "Untitled study",
        "Diagnosis: where model and measurement differ, why, and by how much",
        byline(found),
        (
            verdict(found),
            where(found),
            which(found),
            how_much(found),
            parameters(found),
            how_sure(found),
            in_sight(found),
            next_test(found),
            background(found),
        ),
    )


def verdict(found: Found) -> Section:
    """Section 1: the verdict in one sentence, the numbers behind it, and the story."""
    d = core(found)
    text = _DIAGNOSIS_VERDICTS.get(told(found), ("", ""))[1]
    names = [descriptions(found).get(c, c) for c in map(lambda c: clean(c.get("effect")), d.get("causes") or ())]
    if d.get("ambiguous_with"):
        named = _listing(names if names[1:] else [*names, _other(d)], "or")
    else:
        together = set(effects_of(chosen(found) or "")) >= {clean(c.get("effect")) for c in d.get("causes") or ()}
        named = _listing(names if together else names[:1], "and")
    if nothing(found) > MENTIONED_NO_GAP_PROBABILITY:
        text = text.replace("misses", "may miss")
    lead = text.format(named) + _not_settled(found) if text else "There is no verdict."
    lead += "".join(f" {_in_letters(found, v)}" for v in unproved(core(found))) if verdict_of(found) == "no_gap" else ""
    if d.get("odd"):
        odd = clean(d["odd"].get("experiment"))
        lead = f"{odd} does not agree with the other experiments, and nothing in the catalogue explains it."
    blocks: list[Block] = [Text(lead, "lead" if text else "missing")]
    blocks.append(Facts(tuple(_facts(found))))
    blocks += sketch_blocks(found)
    blocks += [Text(_in_letters(found, clean(w))) for w in listed(found, "words")]
    return Section("verdict", "Verdict", tuple(blocks))


def _in_letters(found: Found, text: str) -> str:
    """A sentence with minus signs, and with the letters of the base parameters for their names."""
    names = [*(name for name, _, _ in parameter_bands(found)), *(found.get("fixed") or {})]
    return re.sub(r"(?<![\w.])-(?=\d)", "−", in_letters(text, names))


def _other(d: Mapping[str, Any]) -> str:
    """What a single cause cannot be separated from."""
    if any(c.get("like_a_modulus") for c in d.get("causes") or ()):
        return "a specimen that is stiffer in one test than in another"
    if any(c.get("like_a_body") for c in d.get("causes") or ()):
        return "a body that itself yields with time, as one out of which water is pressed"
    if any(c.get("like_a_spot") for c in d.get("causes") or ()):
        return "a softer spot of the body there"
    return "something that is not in the catalogue"


def _not_settled(found: Found) -> str:
    """What an ambiguous verdict leaves beside the causes that it names: the many that are not, and no gap at all."""
    causes = core(found).get("causes") or ()
    held = [q for c in causes if (q := number(c.get("probability"))) is not None]
    if verdict_of(found) != "ambiguous" or not held or len(held) < len(causes):
        return ""
    total, text = sum(held), ""
    if total < MIN_NAMED_CAUSES_PROBABILITY:
        text += f" Given a gap, these hold {chance(total)} of the probability; the rest is spread over what is less "
        text += "likely."
    if nothing(found) > MENTIONED_NO_GAP_PROBABILITY:
        text += f" That there is no gap at all has {chance(nothing(found))}."
    return text


def _listing(names: list[str], word: str) -> str:
    """Descriptions may hold commas, so that semicolons part them."""
    *first, last = names or ["see below"]
    return f"{'; '.join(first)}; {word} {last}" if first else last


def _facts(found: Found) -> list[Fact]:
    d = core(found)
    g, s, v = d.get("gap") or {}, d.get("shrinkage") or {}, verdict_of(found)
    mark: Mark = "good" if told(found) in ("no_gap", "explained", "measurement") else "warn"
    facts = [
        Fact("Verdict", _DIAGNOSIS_VERDICTS.get(told(found), (clean(v) or DASH, ""))[0], _policy(d), mark),
        Fact("p-value of “no gap”", p_text(g.get("p_value")), "rare below 0.05"),
        Fact(
            "Misfit over noise", significant(number(g.get("size_over_noise")), 3), "root mean square; 1 is noise alone"
        ),
    ]
    if nothing(found) > MENTIONED_NO_GAP_PROBABILITY:
        facts.insert(1, Fact("No gap at all", chance(nothing(found)), "of the probability"))
    causes = list(d.get("causes") or ())
    if causes:
        c, given = causes[0], ", given a gap" if nothing(found) > MENTIONED_NO_GAP_PROBABILITY else ""
        among = " in the catalogue" if d.get("verdict") == "partly" else ""
        note = f"probability {chance(c.get('probability'))}{among}{given}"
        note += "; may be absent" if pair(c.get("interval")) and may_be_absent(c) else ""
        facts.append(Fact("Leading cause", short(clean(called(found, str(c.get("effect")))), 26), note))
    if known(s.get("closed")) and not each_its_own(found):
        low_high = f"; 90{NBSP}%: {share_text(s.get('interval'))}" if pair(s.get("interval")) else ""
        lone = in_one_curve(s)
        over = f"nearly all in {clean(lone[0])} alone" if lone else f"on held-out curves{low_high}"
        facts.append(Fact("Gap closed", percent(s["closed"]), over))
    if len(facts) > 3 and (check := _check_of(found)):
        facts.append(Fact("Recognised in trials", percent(check), "of simulated data sets with this cause"))
    return facts + _parameter_facts(found)


def _parameter_facts(found: Found) -> list[Fact]:
    """The base parameters over all that the data allow."""
    each = [(name, unit, bands.get("after", bands.get("before"))) for name, unit, bands in parameter_bands(found)]
    rows = [(name, interval(b, unit)) for name, unit, b in each if b]
    if is_far_from_the_data(core(found)):
        return [Fact(symbol(name), value, "no interval: more is left than noise", "warn") for name, (value, _) in rows]
    return [Fact(symbol(name), value, f"90{NBSP}%: {ends}") for name, (value, ends) in rows]


_VERDICT_POLICY = {
    "no_gap": "nothing beyond noise",
    "explained": "probability 95 % or more",
    "ambiguous": "no cause reaches 95 %",
    "partly": "a cause, and something more",
    "unexplained": "none in the catalogue",
    "measurement": "test or chain, not the specimen",
    UNDECIDED: "neither shown nor excluded",
}

_EITHER_SOURCES = {
    "like_a_modulus": "load cell or specimen",
    "like_a_body": "load train or specimen",
    "like_a_spot": "its seat or the specimen",
}


def _policy(d: Mapping[str, Any]) -> str:
    causes = list(d.get("causes") or ())
    lone = causes[0] if d.get("verdict") == "ambiguous" and len(causes) == 1 else {}
    for like, either in _EITHER_SOURCES.items():
        if lone.get(like):
            return either
    return _VERDICT_POLICY.get(UNDECIDED if undecided(d) else clean(d.get("verdict")), "")


def _check_of(found: Found) -> float | None:
    checks = [c for c in listed(found, "checks") if effects_of(str(c.get("hypothesis")))]
    return number(checks[0].get("returned")) if checks else None


def where(found: Found) -> Section:
    """Section 2: residual maps, and the regions by how far they are off what all others predict."""
    blocks: list[Block] = []
    shown_panels = panels(found)
    if shown_panels:
        blocks.append(Picture("residuals", _residual_caption(found)))
    if len(shown_panels) > N_FIRST_PANELS:
        left = len(shown_panels) - MAX_MAP_PANELS
        caption = f"{left} more panels, weaker than these, are not drawn." if left > 0 else ""
        blocks.append(Picture("residuals-more", f"The next panels, drawn in the same way. {caption}".strip()))
    rows = list(core(found).get("where") or ())
    if rows:
        blocks.append(_regions(found, rows))
    if not any(r.get("beyond_noise") for r in rows):
        text = "No single region stands out beyond noise."
        spread = "one of shape, spread over the curves" if not each_its_own(found) else "one of single curves"
        text += f" The gap is {spread}." if verdict_of(found) not in ("no_gap", "") else ""
        blocks.insert(0, Text(text))
    return Section("where", "Where the gap lies", tuple(blocks) or (Text("There are no residuals.", "missing"),))


def _residual_caption(found: Found) -> str:
    cause = chosen(found)
    text = "Measured minus model, each model fitted to all curves at once; the strongest region comes first. "
    text += "Dots are readings averaged in bins, lines their mean over five neighbouring bins, and over the repeats "
    text += "where these have as many. Gain and contact point of each curve, as fitted with the cause where there "
    text += "is one, are taken out; the band is what a reading scatters by and a model may be off by."
    if cause and verdict_of(found) == "unexplained":
        text += f" Blue: the best of the catalogue ({brief(found, cause)}), which did not hold."
    if any(p.profile for p in panels(found)[:MAX_MAP_PANELS]):
        text += " Profiles: one dot per surface mark at each depth."
    return text


def _regions(found: Found, rows: list[Mapping[str, Any]]) -> Table:
    amplitude = [None if not known(r.get("amplitude")) else 100 * r["amplitude"] for r in rows]
    error = [None if not known(r.get("amplitude_sd")) else 100 * r["amplitude_sd"] for r in rows]
    states = [
        Cell("beyond noise", mark="warn") if r.get("beyond_noise") else Cell("within", mark="quiet") for r in rows
    ]
    columns = [
        column("Experiment", words([clean(r.get("experiment")) for r in rows]), number=False),
        column("Channel", words([clean(r.get("channel")) for r in rows]), number=False),
        column("Region", words([clean(r.get("region")) for r in rows]), number=False),
        column("z", aligned([number(r.get("z")) for r in rows], 3, plus=True)),
        column("off by", aligned(amplitude, 3, plus=True), "%"),
        column("± sd", aligned(error, 2), "%"),
        column("of the gap", words(_shares(rows)), "%"),
        column("", tuple(states), number=False),
    ]
    odd = f", those of {clean(core(found)['odd'].get('experiment'))} left out" if core(found).get("odd") else ""
    note = f"Each region against what the base model predicts when it is fitted to all other data{odd}; + is measured "
    note += "above, in shares of the prediction"
    largest = ", ".join(dict.fromkeys(clean(r.get("channel")) for r in rows if r.get("of_largest")))
    note += f" ({largest}, where it vanishes: of the largest force). " if largest else ". "
    note += "Of the gap: what the region's channel holds of the difference between the chosen and the base model."
    if known(core(found).get("where_threshold")):
        limit = significant(core(found)["where_threshold"], 3)
        note += (
            f" Beyond noise: |z| above {limit}, which the largest of all regions passes in 5 % of data without a gap."
        )
    return table("Regions", columns, note)


def _shares(rows: list[Mapping[str, Any]]) -> list[str]:
    """The share of the gap that a channel of an experiment holds, at its first region alone."""
    seen: set[tuple[object, object]] = set()
    out = []
    for r in rows:
        key = (r.get("experiment"), r.get("channel"))
        out.append("" if key in seen else f"{100 * r['share']:.0f}" if r.get("share") else DASH)
        seen.add(key)
    return out


def which(found: Found) -> Section:
    """Section 3: the hypotheses by probability, what they rest on, and their signatures."""
    blocks: list[Block] = []
    if verdict_of(found) == "no_gap":
        blocks.append(Text("There is no gap beyond noise, so no cause is named."))
    if leading(found):
        blocks.append(Picture("probabilities", _bars_caption(found)))
    causes = list(core(found).get("causes") or ())
    if causes:
        blocks.append(_causes(found, causes))
    elif verdict_of(found) != "no_gap":
        blocks.append(Text("No cause of the catalogue is named."))
    if verdict_of(found) != "no_gap":
        blocks += [t for t in (_sensitivity(found), _held_out(found)) if t is not None]
    if signatures(found):
        blocks.append(Picture("signatures", _signature_caption(found)))
    return Section("which", "Which cause", tuple(blocks))


def _bars_caption(found: Found) -> str:
    text = "Probability of each hypothesis, given these data and the catalogue, no gap among them."
    left = len(found.get("probabilities") or {}) - len(leading(found))
    return text + (f" The {left} after these are smaller still." if left > 0 else "")


def _causes(found: Found, causes: list[Mapping[str, Any]]) -> Table:
    railed = [clean(called(found, str(c.get("effect")))) for c in causes if c.get("railed")]
    columns = [
        column("Effect", words([clean(called(found, str(c.get("effect")))) for c in causes], "strong"), number=False),
        column("What it is", words([clean(c.get("description")) for c in causes]), number=False),
        column("knob", words([clean(c.get("effect")) for c in causes], "code"), number=False),
        column("probability", words([chance(c.get("probability")) for c in causes])),
        column("size", words([sized(c)[0] for c in causes])),
        column("90 % interval", words([sized(c)[1] for c in causes])),
        column("absent at", words([sized(c)[2] for c in causes])),
    ]
    note = "Probability, given a gap, of all hypotheses that hold the effect; size: median where it is the cause."
    note += f" At the end of what is plausible or was computed: {', '.join(railed)}." if railed else ""
    shapes = [f"{clean(called(found, str(c.get('effect'))))}{clean(said)}" for c in causes if (said := shaped(c))]
    note += f" Shapes, median and 90 %: {'; '.join(shapes)}." if shapes else ""
    note += "".join(_other_sign(found, c) for c in causes)
    return table("Named causes", columns, note)


def _other_sign(found: Found, cause: Mapping[str, Any]) -> str:
    """That the data allow the effect with the other sign too, and nothing between."""
    other = cause.get("otherwise")
    if not other:
        return ""
    name, (low, high) = clean(called(found, str(cause.get("effect")))), (number(other.get(k)) for k in ("low", "high"))
    between = "" if low is None or high is None else f", {interval((low, low, high), cause.get('unit'))[1]}"
    return f" {name[:1].upper()}{name[1:]} with the other sign{between}: {chance(other.get('probability'))}."


def _sensitivity(found: Found) -> Table | None:
    data = found.get("sensitivity") or {}
    given = found.get("probabilities") or {}
    names = list(dict.fromkeys(str(k) for w in ("halved", "doubled") for k in data.get(w) or {}))[:6]
    if not names:
        return None
    asked = [number(given.get(n)) for n in names]
    rest = [number(given.get(f"{n} + unexplained")) if effects_of(n) else None for n in names]
    both = [None if a is None and b is None else (a or 0.0) + (b or 0.0) for a, b in zip(asked, rest, strict=True)]
    columns = [column("Hypothesis", words([brief(found, n) for n in names]), number=False)]
    columns += [
        column("halved", words([chance((data.get("halved") or {}).get(n)) for n in names])),
        column("as stated", words([chance(v) for v in both], "strong")),
        column("doubled", words([chance((data.get("doubled") or {}).get(n)) for n in names])),
    ]
    note = "Probability when the plausible sizes span half or twice the range; –: not among the first five."
    return table("Sensitivity to the prior", columns, note)


def _held_out(found: Found) -> Table | None:
    rows = [h for h in listed(found, "held_out") if h.get("gain")]
    if not rows:
        return None
    names = [n for n in dict.fromkeys(str(k) for h in rows for k in h["gain"]) if effects_of(n)]
    if not names:
        return None
    columns = [column("Experiment", words([*[clean(h.get("experiment")) for h in rows], "all together"]), number=False)]
    for n in names:
        values = [number(h["gain"].get(n)) for h in rows]
        sure = [v for v in values if v is not None]
        total = sum(sure) if len(sure) == len(values) else None
        cells = aligned([*values, total], 3, plus=True)
        last = Cell(cells[-1].text, cells[-1].pad, "strong")
        columns.append(column(brief(found, n), (*cells[:-1], last)))
    note = (
        "Each experiment is predicted from all the others. The number is the log predictive density relative to "
        "the base model. Above 0 the effect predicts better than the base model; +3 is 20 to 1."
    )
    return table("Does it predict what it was not fitted to?", columns, note)


def _signature_caption(found: Found) -> str:
    rows, names, cause = signatures(found), list(colours(found)), chosen(found)
    each = "each hypothesis adds" if len(names) > 1 else f"{brief(found, names[0])} adds"
    lost = [
        brief(found, n)
        for n in names
        if n not in {clean(c.get("effect")) for c in core(found).get("causes") or ()} and n != cause
    ]
    text = f"Left: what {each} to the base model"
    text += f" ({' and '.join(lost)}: not named, for comparison)" if lost and cause else ""
    text += ". Each is fitted to all curves with all its parameters, and so is the "
    text += "base model, so that heights compare and not shapes alone. Right, on the same scale: what the base model "
    if cause in names:
        text += f"leaves (dots), and what {brief(found, cause)} adds (line). Where they part, noise or a remainder "
        text += "is left."
    elif cause:
        text += f"leaves. What {brief(found, cause)} does to each curve for itself has no mean, and so no line."
    else:
        text += "leaves. None of these hypotheses held."
    return text + (
        f" The first {N_SIGNATURE_ROWS} of {len(rows)} panels are drawn." if len(rows) > N_SIGNATURE_ROWS else ""
    )


def parameters(found: Found) -> Section:
    """Section 5: the base parameters without and with the cause."""
    title, rows = "Parameters", parameter_bands(found)
    if not rows:
        return Section("parameters", title, (Text("There are no fitted parameters.", "missing"), *_held(found)))
    blocks: list[Block] = []
    blocks.append(Picture("parameters", "Median and 90 % interval, fitted to all fit and select curves at once."))
    data, columns = core(found).get("parameters") or {}, []
    columns.append(column("", words([symbol(name) for name, _, _ in rows]), number=False))
    for when, said in said_when(found).items():
        each = [band((data.get(when) or {}).get(name)) for name, _, _ in rows]
        cells = [interval(b, u) if b else (DASH, DASH) for b, (_, u, _) in zip(each, rows, strict=True)]
        columns.append(column(said, words([c[0] for c in cells])))
        columns.append(column("90 % interval", words([c[1] for c in cells])))
    note = "" if all(unit_of(u).label for _, u, _ in rows) else "In the units of the study: N, mm, MPa, s. "
    note += "All that the data allow: every hypothesis by its probability, effects that the data neither show nor "
    note += "exclude, 1 % by which one program differs from another."
    blocks.append(table("Parameters", columns, note))
    blocks += [Text(_in_letters(found, text)) for name, _, _ in rows if (text := known_alone(core(found), found, name))]
    return Section("parameters", title, (*blocks, *_held(found)))


def _held(found: Found) -> list[Text]:
    """What the study fixes has a value and no interval."""
    units, held = found.get("units") or {}, found.get("fixed") or {}
    each = [f"{symbol(k)} = {quantity(number(v), str(units.get(k) or ''))}" for k, v in held.items()]
    return [Text(f"Fixed by the study, not fitted: {', '.join(each)}.", "note")] if each else []
