"""The verdict in sentences, in the order a reader asks: gap, where, cause, how much, how sure, what next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.core.digits import quantity_text
from rso.core.units import people
from rso.discrepancy.evidence.noise import MAX_STATED_NOISE_RATIO
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS
from rso.discrepancy.library.test_plan import ASSUMED_TIMES_NOTE, NOT_USED_NOTE
from rso.discrepancy.parameters import called, parameter_sentences, unit_suffix, values_with_units

UNDECIDED = "undecided"  # what people are told of a verdict of no gap that is on the border
UNDECIDED_P_RATIO = 2.0  # times the false alarms: p up to which no gap is said to be undecided
MIN_CONFIRMED_SHARE = 0.5  # of the gap on curves left out: less is no confirmation
MIN_COUNTED_SHARE = -10.0  # times the gap: what is opened more widely need not be counted
# probability of no gap above which it is said beside causes that cannot be told apart
MENTIONED_NO_GAP_PROBABILITY = 0.05
MIN_NAMED_GAP_SHARE = 0.1  # share of the gap from which a place is named
MIN_NAMED_TEST_CHANCE = 0.01  # chance to settle the matter from which a test is worth naming
LARGE_MISFIT_RATIO = 1.1  # times the noise: a misfit that is said to be larger than it
ONE_CURVE_SHARE = 0.9  # share of what exceeds the floor from which a single curve is said to hold it
MIN_FITTING_PROBABILITY = 0.3  # probability from which an effect is said to fit where it is not named
# of what curves have each for itself (of the sum of squares): one that holds as much is named
NAMED_SINGLE_CURVE_SHARE = 0.7


def diagnosis_sentences(found: Mapping[str, Any]) -> list[str]:
    """Sentences from the plain data of a diagnosis; no number is computed here."""
    d = found["diagnosis"]
    out = [_gap(d, found), *_mirrored(found), *_unlike(found), *_jumps(d), *_hum(d)]
    if d["verdict"] != "no_gap":
        out += [_where(d, found), _cause(d, found) + _single(d, found) + _remainder(d, found)]
    if (closed := _shrinkage(d, found)) is not None:
        out.append(closed + _alone(d, found))
    out += parameter_sentences(d, found)
    if checks := _checks(found):
        out.append(checks)
    out += _unseen(d, found)
    out += [f"Left out of the diagnosis: {note.removesuffix(f' {NOT_USED_NOTE}')}." for note in _not_used(found)]
    out += [f"{note}." for note in found.get("notes") or [] if note.endswith(ASSUMED_TIMES_NOTE)]
    if _of_one_size(d):
        return [*out, "Next test: the same test with an indenter, or a specimen, of twice the size."]
    return out + [next_sentence(t) for t in d["next_test"][:1]]


def _of_one_size(d: Mapping[str, Any]) -> str:
    """Why a flow and a relaxation are rivals whatever their probabilities; nothing where they are not."""
    causes = d.get("causes") or []
    if not (len(causes) == 2 and any(c.get("flows") for c in causes) and d.get("ambiguous_with")):
        return ""
    return (
        " The catalogue has one relaxation time alone; several would do what the flow does in tests of one size. Under "
        "twice the size a flow takes four times as long, a relaxation as long as before."
    )


def _not_used(found: Mapping[str, Any]) -> list[str]:
    """Notes of holds and ways back that no hypothesis was compared with, each experiment once."""
    each: dict[str, str] = {}
    for note in found.get("notes") or []:
        if note.endswith(NOT_USED_NOTE):
            each.setdefault(note.split(":")[0], note)
    return list(each.values())


def next_sentence(test: Mapping[str, Any]) -> str:
    """What the best of the next tests promises; one with a chance below 1 % promises nothing and is not named."""
    if test["chance"] < MIN_NAMED_TEST_CHANCE:
        return "None of the proposed tests would separate the causes: repeats, less noise or other channels are needed."
    note = f" ({test['note']})" if test.get("note") else ""
    share = f"it separates the causes with a probability of {100 * test['chance']:.0f} %"
    if test["chance"] >= 0.5:
        return f"Next test: {test['test']}; {share}{note}."
    return f"No proposed test is likely to separate the causes; the best is {test['test']}: {share}{note}."


def _mirrored(found: Mapping[str, Any]) -> list[str]:
    """Forces with the sign opposite to that of the model: before any cause a laboratory looks at its signs."""
    rows = found.get("mirrored") or []
    if not rows:
        return []
    each = ", ".join(f"{r['channel']} in {r['experiment']} ({r['times']:+.1f} times the model's)" for r in rows)
    return [
        f"Opposite to the model in sign: {each}. Are signs of channels and places right? Forces are those "
        "of the specimen on the indenter: a slope pushes it downhill. What else is said takes the data as they stand."
    ]


def _unlike(found: Mapping[str, Any]) -> list[str]:
    """Repeats that differ by far more than stated or usual: where that counts as noise, no misfit shows what it is."""
    out = []
    for c, v in found["noise"].items():
        (g, z), (by, at) = ((v[k]["gain"], v[k]["contact_mm"]) for k in ("expected", "repeats"))
        if g and by > MAX_STATED_NOISE_RATIO * g:
            out.append(
                f"Repeats differ by {100 * by:.2g} % in {c}, {100 * g:.2g} % is stated or usual: "
                f"{_counts(v['gain'], by)} (recovery between tests, temperature, a gain that wanders)."
            )
        if z and at > MAX_STATED_NOISE_RATIO * z:
            out.append(
                f"Contact points of repeats differ by {quantity_text(at, 'mm', 2)} ({c}); "
                f"{quantity_text(z, 'mm', 2)} is usual: "
                f"{_counts(v['contact_mm'], at)} (contact taken early or late, a specimen that creeps or moves)."
            )
    return out


def _counts(taken: float, shown: float) -> str:
    """Whether what repeats show went into the noise."""
    if taken < shown:
        return "far beyond what is stated, this counts as a gap"
    return "taken for noise, this may be an effect of its own"


def _jumps(d: Mapping[str, Any]) -> list[str]:
    j = d.get("jumps") or {}
    if not j.get("sudden"):
        return []
    if c := j.get("crack"):
        stays = (
            f"The force steps by {c['size']:+.3g} N in {c['experiment']}, at {quantity_text(c['depth'], 'mm')}"
            f"{' of unloading' if c.get('branch') == 'unloading' else ''}, and stays so ({c['z']:.1f} standard "
            "deviations). A crack, a slip, a part that touches or a jump of the cell's zero does that; no smooth model "
            "has it. Where the force in air is off by as much after the test, it is the zero."
        )
        if not j.get("skewed", True):
            return [stays]
    depths = ", ".join(f"{v:.3g}" for v in j["depths"])
    return [
        f"The force jumps suddenly, most by {j['size']:+.3g} N in {j['experiment']}, at {depths} mm (skewness of "
        f"its steps: t = {j['t']:+.1f}, z = {j['z']:+.0f}). Stick–slip, a crack or a slipping grip does that; no "
        "smooth model has it."
    ]


def _hum(d: Mapping[str, Any]) -> list[str]:
    h = d.get("hum") or {}
    if not h.get("there"):
        return []
    timed = h.get("along", "time") == "time"
    unit = "Hz" if timed else "periods a mm"
    whence = "mains, a drive, or regular stick–slip" if timed else "a spindle, or stick–slip"
    return [
        f"The readings swing with {h['frequency']:.3g} {unit} (amplitude "
        f"{quantity_text(h['amplitude'], 'N', 2)} in {h['channel']}; "
        f"chance of such a line in scatter 1e{h['log10_p']:.0f}): {whence}. "
        "No material has that."
    ]


def _gap(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    p, g = d["gap"]["p_value"], d["gap"]
    if d["verdict"] != "no_gap" and not g["statistic"] > g["threshold"]:
        by = f"{g['size_over_noise']:.2f} times the noise"
        miss = f": they miss the model by {by} that they show from one to the next"
        return (
            f"No smooth gap beyond noise (p = {p:.2g}), but the readings are not smooth"
            f"{miss if g['size_over_noise'] > 1.0 else ''}."
        )
    if undecided(d):
        limit = DIAGNOSIS_SETTINGS.rules.false_alarm
        return (
            f"Undecided: a gap is called where p is at most {limit:g} and its ln Bayes factor above 0; p is "
            f"{p:.2g}, the factor {g['statistic']:.1f}. The misfit is {g['size_over_noise']:.2f} times the noise."
        )
    if d["verdict"] == "no_gap":
        return f"No gap beyond noise (p = {p:.2g}, misfit {g['size_over_noise']:.2f} times the noise)."
    sign = "<" if p < 0.005 else "="
    size = f"misfit {g['size_over_noise']:.2f} times the noise"
    if (none := nothing(found)) > MENTIONED_NO_GAP_PROBABILITY:
        large = "" if g["size_over_noise"] > LARGE_MISFIT_RATIO else ", no more than noise"
        return (
            f"A gap is possible, not shown: p {sign} {max(p, 0.005):.2g}, {size}{large}; none has {percent_text(none)}."
        )
    return f"There is a gap beyond noise (p {sign} {max(p, 0.005):.2g}, {size})."


def undecided(d: Mapping[str, Any]) -> bool:
    """Whether a verdict of no gap is one on the border.

    That is where data without a gap are as far out at most twice as often as is called a gap, or where the data make
    one at least as probable as it was before (ln Bayes factor of any gap ≥ 0).
    """
    gap = d.get("gap") or {}
    p, factor = gap.get("p_value"), gap.get("statistic")
    near = p is not None and p <= UNDECIDED_P_RATIO * DIAGNOSIS_SETTINGS.rules.false_alarm
    return d.get("verdict") == "no_gap" and (near or (factor is not None and factor >= 0.0))


def nothing(found: Mapping[str, Any]) -> float:
    """Probability of no gap beside an ambiguous verdict; 0 beside others, which a test of the null has decided."""
    ambiguous = (found.get("diagnosis") or {}).get("verdict") == "ambiguous"
    p = (found.get("probabilities") or {}).get("none")
    return float(p) if ambiguous and isinstance(p, int | float) else 0.0


def _where(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    held = {(r["experiment"], r["channel"]): r["share"] for r in d["where"] if r["share"] >= MIN_NAMED_GAP_SHARE}
    shares = [f"{100 * v:.0f} % of the gap in {e} {c}" for (e, c), v in list(held.items())[:3]]
    several = sum(len(e["channels"]) for e in found["experiments"]) > 1
    lies = f"Where: {', '.join(shares)}. " if shares and several else ""
    clear = sorted((r for r in d["where"] if r["beyond_noise"]), key=lambda r: -abs(r["z"]))[:3]
    if not clear:
        single = any(c["family"] == "scatter" for c in d["causes"][:1])
        spread = "one of single curves" if single and several else "one of shape, spread over the depth"
        return lies + f"No single region stands out; the gap is {spread}."
    percent = [f"{100 * r['amplitude']:+.1f} ± {100 * r['amplitude_sd']:.1f} %{_of(r)}" for r in clear]
    told = [f"{r['experiment']} {r['channel']} {r['region']} ({v})" for r, v in zip(clear, percent, strict=True)]
    others = f"all data but those of {d['odd']['experiment']} predict" if d.get("odd") else "all other data predict"
    return f"{lies}Compared with what {others}: {'; '.join(told)}."


def _of(region: Mapping[str, Any]) -> str:
    return " of the largest force" if region.get("of_largest") else ""


def _named(c: Mapping[str, Any]) -> str:
    label, k = people(c["unit"], c["size"])
    (low, high), other = c["interval"], c.get("otherwise")
    neutral = ""
    if other:
        neutral = f", or {k * other['low']:.3g} to {k * other['high']:.3g}: {percent_text(other['probability'])}"
    if may_be_absent(c):
        neutral += f", among them {k * c['neutral']:g}: it may be absent"
    elif c["neutral"]:
        neutral += f", absent at {k * c['neutral']:g}"
    if c["railed"]:
        neutral += (
            "; a parameter of it lies at the end of its plausible or computed range, so size and interval mean little"
        )
    size = f"{k * c['size']:.3g}{unit_suffix(label)}"
    return f"{c['effect']} = {size} (90 % {k * low:.3g} to {k * high:.3g}{neutral}){shaped(c)}"


def shaped(c: Mapping[str, Any]) -> str:
    """The knobs that shape an effect, as found: a thickness, a time, a place."""
    each = []
    for k in c.get("shape") or []:
        (low, high), (label, by) = k["interval"], people(k["unit"], k["size"])
        size = f"{by * k['size']:.3g}{unit_suffix(label)}"
        each.append(f"{k['knob']} = {size} ({by * low:.3g} to {by * high:.3g})")
    return f" with {', '.join(each)}" if each else ""


def _cause(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    causes, v = d["causes"], d["verdict"]
    if v == "unexplained":
        none = "Cause: none in the catalogue reproduces it, or none predicts curves it was not fitted to."
        return none + _fitting(found) + _odd(found)
    first = causes[0]
    text = {e["name"]: e["description"] for e in found["effects"]}
    unseen = hidden_causes(d, found)
    doubt = [", hardly to be seen here" if c.get("cause") in unseen else "" for c in causes]
    each = ", ".join(
        f"{called(found, c['effect'])} ({percent_text(c['probability'])}{more})"
        for c, more in zip(causes, doubt, strict=True)
    )
    if v == "ambiguous":
        if len(causes) == 1 and first.get("like_a_modulus"):
            return (
                f"Cause: every test has its own factor on the force, {_named(first)}, probability "
                f"{percent_text(first['probability'])}. It may come from the load cell or from the specimen (recovery "
                "between tests, temperature), which changes the modulus alike. A known weight on the cell before "
                "each test decides."
            )
        if len(causes) == 1 and first.get("like_a_body"):
            return (
                f"Cause: what carries the body gives way with time, {_named(first)}, probability "
                f"{percent_text(first['probability'])}, or the body itself does by pore flow (poroelasticity). Forces "
                "on the indenter hardly separate the two; a rigid block under the same load, for as long, does."
            )
        if len(causes) == 1 and first.get("like_a_spot"):
            return (
                f"Cause: the specimen gives way under one place, {_named(first)}, probability "
                f"{percent_text(first['probability'])}: how it sits there, or a soft inclusion. Test the same place "
                "with the specimen turned or placed again, or places around it."
            )
        if len(causes) == 1:
            return f"Cause: {text[first['effect']]}, or something that is not in the catalogue: {each}."
        whether = ", if there is a gap (chances given one)" if nothing(found) > MENTIONED_NO_GAP_PROBABILITY else ""
        return f"Cause{whether}: these data cannot separate {each}.{_of_one_size(d)}"
    if v == "partly" and d["ambiguous_with"]:
        return f"Part of the gap looks like one of these, which the data cannot separate: {each}.{_of_one_size(d)}"
    if v == "partly" and len(d["chosen"]) == 2:
        both = " and ".join(f"{text[c['effect']]} ({_named(c)})" for c in causes if c["effect"] in d["chosen"])
        return f"Cause: it takes two effects together, {both}. A pair mimics much: take it for a part of the truth."
    head = {"explained": "Cause", "measurement": "It is the measurement", "partly": "Part of it, not all, looks like"}[
        v
    ]
    each = " and ".join(_named(c) for c in causes[: 2 if v == "explained" else 1])
    alike = " A modulus that differs from test to test does the same." if first.get("like_a_modulus") else ""
    alike += " A body out of which water is pressed does nearly the same." if first.get("like_a_body") else ""
    alike += " A softer spot of the body there does nearly the same." if first.get("like_a_spot") else ""
    alike += _unconfirmed(first["effect"], found)
    among = " among what the catalogue has" if v == "partly" else ""  # what else acts is none of these
    chance = f"probability {percent_text(first['probability'])}{among}"
    return f"{head}: {text[first['effect']]}, {each}; {chance}.{alike}"


def _fitting(found: Mapping[str, Any]) -> str:
    """The effect that most of the probability fits with, and nothing was found to confirm."""
    each: dict[str, float] = {}
    for name, p in (found.get("probabilities") or {}).items():
        parts = name.split(" + ")
        for part in parts if "unexplained" not in parts else ():
            each[part] = each.get(part, 0.0) + p
    none = each.pop("none", 0.0)
    best = max(each, key=lambda k: each[k], default=None)
    if best is None or each[best] < MIN_FITTING_PROBABILITY:
        return ""
    beside = f"; no gap has {percent_text(none)}" if none > MENTIONED_NO_GAP_PROBABILITY else ""
    return (
        f" {called(found, best)} fits best ({percent_text(each[best])}) and does not predict curves left out{beside}."
    )


def _odd(found: Mapping[str, Any]) -> str:
    """The one experiment that is odd, where all others agree with the model."""
    if not found["diagnosis"].get("odd"):
        return ""
    odd, p = (found["diagnosis"]["odd"][k] for k in ("experiment", "probability"))
    points = {e["name"]: e["point"] for e in found["experiments"]}
    alike = [n for n, p in points.items() if p == points[odd] and n != odd]
    what = f"it and {', '.join(alike)} at the same point" if alike else "it: that place of the body, or that test"
    said = f" It is in {odd} alone ({percent_text(p)}), the others agree with the model."
    return f"{said} Ask what differs between {what}." if alike else f"{said} Ask what is special about {what}."


def _unconfirmed(effect: str, found: Mapping[str, Any]) -> str:
    """Where a cause acts in one experiment alone, of which the others can say nothing."""
    rows = found.get("held_out") or []
    own = [r["experiment"] for r in rows if effect not in r["gain"]]
    if not own or len(own) == len(rows):
        return ""
    return f" Only {', '.join(own)} can show it: no other experiment confirms it."


def _single(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """The one curve that has most of what every curve has for itself, where there is one."""
    out = ""
    for c in d["causes"]:
        each = c.get("each") or []
        whole = sum(v["value"] ** 2 for v in each)
        if len(each) < 2:
            continue
        first = max(each, key=lambda v: abs(v["value"]))
        if first["value"] ** 2 < NAMED_SINGLE_CURVE_SHARE * whole or abs(first["value"]) < 3.0 * first["sd"]:
            continue
        label, k = people(c["unit"], first["value"])
        curve = " ".join(v for v in (first["experiment"], first["label"]) if v)
        size = f"{k * first['value']:+.2g} ± {k * first['sd']:.1g}{unit_suffix(label)}"
        out += f" Nearly all of it ({called(found, c['effect'])}) is in one curve, {curve}: {size}."
    return out


def _remainder(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """What the likeliest cause leaves, where that is more than noise."""
    r = d.get("remainder") or {}
    if d["verdict"] == "partly" and not r.get("there") and (d.get("left") or 0.0) > LARGE_MISFIT_RATIO**2:
        return f" What is left is {d['left'] ** 0.5:.2g} times the noise."
    if not r.get("there") or d["verdict"] != "partly":
        return ""
    of, like = called(found, r["of"]), called(found, r["looks_like"] or "nothing known")
    return (
        f" What {of} alone leaves is more than noise and looks most like {like}. Its score is {r['score']:.1f}; "
        f"with {of} alone about 1 % exceed {r['threshold']:.1f}."
    )


def _shrinkage(d: Mapping[str, Any], found: Mapping[str, Any]) -> str | None:
    s = d["shrinkage"]
    if s["before"] is None or s["before"] != s["before"]:
        return "How much: one curve only, nothing is left to test a cause on."
    model = f" ({values_with_units(s['fitted'], found)}, as the study found them)" if s.get("fitted") else ""
    before, after = f"{s['before']:.2f} before{model}", f"{s['refit_only']:.2f} after a re-fit alone"
    text = f"On held-out curves, {s['how']}, the gap is {before}, {after}"
    if not d["chosen"]:  # nothing was added
        text += " (noise floor 1)"
    else:
        text += f", {s['with_cause']:.2f} with the cause (noise floor 1){_otherwise(d, found)}"
    if s["closed"] is None:
        return text + "; before is not clearly above the floor, so no share is printed."
    text += f": {100 * s['closed']:z.0f} % closed"
    most, validated = s["closed"] if s["interval"] is None else s["interval"][1], "validate" in s["how"]
    if (lone := in_one_curve(s)) is not None:
        text += f" (nearly all of it in {lone[0]} alone: no interval over curves)."
    else:
        text += " (one curve: no interval)." if s["interval"] is None else f" (90 %: {percents(s['interval'])} %)."
    if d["chosen"] and validated and most < MIN_CONFIRMED_SHARE:
        text += " What is named leaves most of the gap of curves that had no say: it is not all, or not it."
    return text


def in_one_curve(s: Mapping[str, Any]) -> tuple[str, float] | None:
    """The one of several held-out curves that holds nearly all of what exceeds the floor, and its share."""
    over = {str(c.get("curve")): max((c.get("before") or 0.0) - 1.0, 0.0) for c in s.get("curves") or ()}
    total = sum(over.values())
    if len(over) < 2 or not total > 0:
        return None
    name = max(over, key=lambda k: over[k])
    return (name, over[name] / total) if over[name] >= ONE_CURVE_SHARE * total else None


def _otherwise(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """Curves without which another cause, or none, would have been chosen."""
    chosen, curves = set(d["chosen"]), d["shrinkage"]["curves"]
    other = {
        c["curve"]: called(found, " + ".join(c["cause"])) or "none"
        for c in curves
        if set(c.get("cause", chosen)) != chosen
    }
    each = ", ".join(f"{v} without {k}" for k, v in other.items())
    return f"; the cause would be {each}" if each else ""


def _alone(d: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """What a share closed cannot say of a cause that one place, or every curve, has for itself alone."""
    if any(c["family"] == "scatter" for c in d["causes"][:1]) and len(d["shrinkage"]["curves"]) > 1:
        return " What every curve has for itself no other can predict: on curves left out the share says nothing."
    one_place = {e["name"] for e in found["effects"] if e.get("one_place")}
    if not any(c["effect"] in one_place for c in d["causes"][:1]):
        return ""
    return " What one place alone has, no other can confirm: with its tests left out the cause does nothing."


def may_be_absent(c: Mapping[str, Any]) -> bool:
    """Whether the interval of a cause holds the size at which it is absent."""
    return c.get("neutral") is not None and c["interval"][0] < c["neutral"] < c["interval"][1]


def percent_text(p: float) -> str:
    """A probability in per cent, never quite none or all."""
    return "< 1 %" if p < 0.005 else "> 99 %" if p > 0.995 else f"{100 * p:.0f} %"


def percents(interval: Sequence[float]) -> str:
    """An interval of a share in per cent, its ends no lower than MIN_COUNTED_SHARE."""
    ends = [
        f"{100 * v:z.0f}" if v > MIN_COUNTED_SHARE else f"less than {100 * MIN_COUNTED_SHARE:.0f}" for v in interval
    ]
    return " to ".join(dict.fromkeys(ends))


def _checks(found: Mapping[str, Any]) -> str | None:
    """How often data simulated from a hypothesis are judged to be of it."""
    names = ["no gap" if c["hypothesis"] == "none" else called(found, c["hypothesis"]) for c in found["checks"]]
    each = [f"{n} in {100 * c['returned']:.0f} %" for n, c in zip(names, found["checks"], strict=True)]
    said = "Self-test on data simulated with this noise, correctly recognised"
    return f"{said}: {', '.join(each)}." if each else None


def hidden_causes(d: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, str]:
    """Causes of which no form is visible at any plausible size, each with its first form."""
    source = {e["name"]: e.get("source") for e in found["effects"]}
    rows = d.get("detectable") or ()
    shown = {source[v["effect"]] for v in rows if v["visible"]}
    first = {source[v["effect"]]: v["effect"] for v in reversed(rows)}
    return {k: v for k, v in reversed(first.items()) if k not in shown}


def _unseen(d: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    blind = [called(found, name) for name in hidden_causes(d, found).values()]
    return [f"This test plan cannot detect, at any plausible size: {', '.join(blind)}."] if blind else []
