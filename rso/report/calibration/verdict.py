"""The first page: what the material is, how sure that is, and what it cost, in sentences and a few large numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rso.core.digits import estimate, known
from rso.core.plain_results import RUN_STAGES
from rso.inference.rules import RULES
from rso.report.calibration.deformed import deformed_blocks, moved_sentence
from rso.report.calibration.derived import (
    derived_facts,
    derived_rows,
    derived_sentences,
    derived_span,
    derived_value,
    open_rows,
)
from rso.report.calibration.gap import gap_fact, gap_sentences
from rso.report.calibration.identification import allowed, identified, spans
from rso.report.calibration.inputs import assumed
from rso.report.calibration.predictions import prediction_fact
from rso.report.calibration.predictive_check import missed, missed_channel, prediction_of
from rso.report.layout.digits import Unit, clean, duration, percent, quantity, shortest, unit_text
from rso.report.layout.document import Answers, Block, Fact, Facts, Mark, Picture, Section, Text
from rso.report.notes import data_remarks
from rso.report.reading import (
    CandidateView,
    ParameterView,
    Results,
    about_zero,
    best_candidate,
    candidates,
    experiment,
    finished,
    fitted_band,
    fitted_model,
    lettered,
    listed,
    number,
    pair,
    parameters,
)
from rso.report.sketch import sketch_blocks


def verdict(results: Results) -> Section:
    """The first screen: one sentence, what is known, what is not, whether a prediction held, and a picture of it."""
    blocks: list[Block] = [Text(t, "missing") for t in unfinished(results)]
    if lead := plain_answer(results):
        blocks.append(Text(lead, "lead"))
    if lines := answers(results):
        blocks.append(Answers(lines))
    blocks += [*deformed_blocks(results), *_beside(results)]
    if facts := _facts(results):
        blocks.append(Facts(facts))
    blocks += data_remarks(results)
    blocks += [Text(lettered(results, w), "warning") for w in results.get("warnings") or ()]
    return Section("verdict", "Answer", tuple(blocks))


def _beside(results: Results) -> tuple[Picture, ...]:
    """The sketch, in a row with the other pictures where there are any."""
    share = 2 if deformed_blocks(results) else 0
    return tuple(replace(p, share=share) for p in sketch_blocks(results))


def plain_answer(results: Results) -> str:
    """The answer in one sentence: the quantity that people think in, else the first parameter that is determined."""
    level = number((results.get("identification") or {}).get("level"))
    sure = f", with {percent(level)} confidence between" if level is not None else ", between"
    for q in derived_rows(results):
        if q.get("known") is True:
            name = clean(q["description"])
            return f"The {name} is {derived_value(q)}{sure} {derived_span(q).replace(' to ', ' and ')}."
    for p, d in interval_rows(results):
        x, span = likely(results, p), spans(results, p, d["interval"]).replace(" to ", " and ")
        if d.get("determined") is True and x is not None:
            return f"{p.letter} is {_value(p, x, d['interval'], p.unit)}{sure} {span}."
    letters = [p.letter for p, _ in interval_rows(results)]
    return (
        f"These data determine {'no value of' if len(letters) == 1 else 'none of'} {_and(letters)}." if letters else ""
    )


def answers(results: Results) -> tuple[Fact, ...]:
    """What is known, what is not, whether a test that was not used is predicted."""
    rows, derived = interval_rows(results), derived_rows(results)
    fixed = [
        f"{clean(q['letter'])} = {derived_value(q)} ({derived_span(q)})" for q in derived if q.get("known") is True
    ]
    loose = [f"{clean(q['letter'])} ({derived_span(q)})" for q in open_rows(results)]
    for p, d in rows:
        x, span = likely(results, p), spans(results, p, d["interval"])
        if d.get("determined") is True and x is not None:
            fixed.append(f"{p.letter} = {_value(p, x, d['interval'], p.unit)} ({span})")
        elif d.get("determined") is not True:
            loose.insert(0, f"{p.letter} ({span})")
    found: list[Fact] = []
    if (times := _refuted(results)) is not None:
        by = shortest(float(f"{times:.2g}"))
        found.append(Fact("Fit", f"the model misses the data by {by} times their errors", "", "bad"))
    if doubts := clean((results.get("identification") or {}).get("doubts")):
        found.append(Fact("Fit", f"not believed: {doubts[0].lower()}{doubts[1:].partition('. ')[0]}", "", "bad"))
    if fixed:
        found.append(Fact("Known", "; ".join(fixed), "", "good"))
    found += [Fact("Assumed", text, "", "warn") for text in assumed(results)]
    if loose:
        found.append(Fact("Not known", "; ".join(loose), "", "warn"))
    found += [Fact("Look again", clean(q["unlikely"]), "", "warn") for q in derived if q.get("unlikely")]
    for f in prediction_fact(results):
        mark: Mark = "good" if f.mark == "good" else "bad" if f.value.startswith("not ") else "warn"
        found.append(Fact("Prediction", f"{f.value}: {f.note}", "", mark))
    if rows and not any(f.label == "Prediction" for f in found):
        found.append(Fact("Prediction", "no test was kept to check one", "", "warn"))
    return tuple(found)


def determined_blocks(results: Results) -> tuple[Block, ...]:
    """The bar of each parameter."""
    return (Picture("determined", _determined_caption(results)),) if interval_rows(results) else ()


def known_sentences(results: Results) -> list[str]:
    """What is known of the material, what is not, and why not."""
    said = [" ".join([*_material(results), *derived_sentences(results)]), " ".join(_reason(results))]
    return [t for t in (*said, *gap_sentences(results)) if t]


def fit_sentences(results: Results) -> list[str]:
    """How well the fitted model reproduces what it was fitted to."""
    return [t for t in (" ".join(_fit(results)),) if t]


def found_sentences(results: Results) -> list[str]:
    """What was recomputed, and what all of it cost."""
    return [t for t in (" ".join(_verification(results)), _cost(results)) if t]


def unfinished(results: Results) -> list[str]:
    """What is missing of a study that is not complete."""
    stage = results.get("stage")
    if stage == RUN_STAGES[-1]:
        return []
    if stage not in RUN_STAGES:
        return [f"This study has not finished any stage that this report knows (stage: {clean(stage) or 'none'})."]
    later = ", ".join(RUN_STAGES[RUN_STAGES.index(stage) + 1 :])
    return [f"This study is not complete. The last finished stage is “{stage}”; still to come: {later}."]


NOT_DETERMINED = "is not determined"


def interval_rows(results: Results) -> list[tuple[ParameterView, Mapping[str, Any]]]:
    """Parameters whose interval is known."""
    known_intervals = results.get("determined") or {}
    rows = [(p, known_intervals.get(p.name) or {}) for p in parameters(results, free=True)]
    return [(p, d) for p, d in rows if pair(d.get("interval")) and pair([p.low, p.high])]


def _value(p: ParameterView, x: float, interval: list[float], unit: Unit) -> str:
    low, high = (v * unit.factor for v in interval)
    return f"{estimate(x * unit.factor, low, high)}{unit.after}"


def likely(results: Results, p: ParameterView) -> float | None:
    """The most likely value; without an identification that of the best candidate."""
    found = number(((results.get("identification") or {}).get("values") or {}).get(p.name))
    best = best_candidate(results)
    return found if found is not None else best.value(p.name) if best else None


def how(results: Results, p: ParameterView) -> str:
    """How a parameter that is not determined is called."""
    verdicts = {q.name: d.get("verdict") for q, d in identified(results)}
    return "is weakly determined" if verdicts.get(p.name) == "weakly" else NOT_DETERMINED


def _also(p: ParameterView, x: float, interval: list[float]) -> str:
    base = Unit(unit_text(p.base))
    return "" if base.label == p.unit.label else f" ({_value(p, x, interval, base)})"


def _material(results: Results) -> list[str]:
    said = []
    for p, d in interval_rows(results):
        x, span = likely(results, p), spans(results, p, d["interval"])
        if d.get("determined") is True:
            if x is None:
                said.append(f"{p.letter} is determined: it lies between {span.replace(' to ', ' and ')}.")
            else:
                value = _value(p, x, d["interval"], p.unit) + _also(p, x, d["interval"])
                said.append(
                    f"{p.letter} is determined: {value}, and{_level(results)} anything from {span} is compatible with "
                    "the data."
                )
        else:
            whole = len(allowed(results, p, d["interval"])) == 1
            width = f" ({_width(p, *d['interval'])})" if whole else ""
            said.append(
                f"{p.letter} {how(results, p)}:{_level(results)} every value from {span}{width} {_agrees(results)}."
            )
    return said


def _refuted(results: Results) -> float | None:
    """By how many times their errors the model misses the data, where it does so widely."""
    scale = number((results.get("identification") or {}).get("scale"))
    return scale if scale is not None and scale > RULES.refuted_error_ratio else None


def _missed_by(results: Results) -> float | None:
    """By how many times their errors the model misses the data, where it does so widely or more than noise explains."""
    known = results.get("identification") or {}
    scale, p = number(known.get("scale")), number(known.get("p_value"))
    chance = scale is not None and scale > 1.0 and p is not None and p < RULES.refuted_fit_chance
    return scale if chance else _refuted(results)


def _agrees(results: Results) -> str:
    """What values within an interval do: agree with the data, or no better than the model does at all."""
    if (times := _missed_by(results)) is None:
        doubted = (results.get("identification") or {}).get("doubts")
        return "fits as well as any under the model, whose fit is not believed" if doubted else "agrees with the data"
    by = shortest(float(f"{times:.2g}"))
    return f"fits as well as any under the model, which misses the data by {by} times their errors"


def _width(p: ParameterView, low: float, high: float) -> str:
    """How wide an interval is: a factor where the range is searched on a logarithmic scale, else a share of it."""
    if p.log and 0 < low < high < 1.2 * low:
        return f"±{percent(0.5 * (high / low - 1.0))}"
    if p.log and low > 0:
        return f"a factor of {shortest(float(f'{high / low:.2g}'))}"
    return f"{percent(p.share(low, high))} of the range that was searched"


def _level(results: Results) -> str:
    level = number((results.get("identification") or {}).get("level"))
    return "" if level is None else f" with {percent(level)} confidence"


def _reason(results: Results) -> list[str]:
    """Why a parameter is not determined: along the valley it changes much and the targets do not."""
    open_ones = [(p, d) for p, d in interval_rows(results) if d.get("determined") is not True]
    reasons = {p.name: clean(d.get("reason")) for p, d in identified(results)}
    said = [lettered(results, reasons.get(p.name) or d.get("story")) for p, d in open_ones if d.get("story")]
    valleys = [clean(s["name"]) for s in listed(results, "searches") if s.get("kind") == "valley"]
    shown_by = [text for name in valleys for p, _ in open_ones if (text := _valley(results, name, p))]
    return [*dict.fromkeys(said), *shown_by[:1]]


def _valley(results: Results, name: str, p: ParameterView) -> str:
    """What the candidates of one search show about a parameter, or nothing."""
    chosen = [c for c in candidates(results) if c.search == name and c.data.get("state") == "done"]
    values = [v for c in chosen if known(v := c.value(p.name)) and v > 0]
    spread = _spread(chosen)
    if len(values) < 2 or spread is None:
        return ""
    return (
        f"Between the candidates of search {name}, {p.letter} goes from {p.show(min(values), 3)} to "
        f"{p.show(max(values), 3)}. Their recomputed targets still differ by at most {percent(spread)}."
    )


def _spread(chosen: list[CandidateView]) -> float | None:
    """Largest relative difference between candidates over the targets, recomputed."""
    by_output: dict[str, list[float]] = {}
    for c in chosen:
        for o in c.data.get("outputs") or ():
            if known(o.get("target")) and known(o.get("recomputed")):
                by_output.setdefault(o["output"], []).append(o["recomputed"])
    spreads = [(max(v) - min(v)) / abs(sum(v) / len(v)) for v in by_output.values() if len(v) > 1 and sum(v) != 0]
    return max(spreads, default=None)


def _verification(results: Results) -> list[str]:
    every = candidates(results)
    if not every:
        return []
    if not finished(results, "verify"):
        return [f"{len(every)} candidates were found on the response surface; none has been recomputed yet."]
    good = [c for c in every if c.verified]
    worst = max((a for c in good if known(a := c.data.get("agreement"))), default=None)
    said = [f"{len(good)} of {len(every)} candidates are verified: recomputed with the full model"]
    said[0] += f", their target values agree with the prediction within {percent(worst)}." if worst is not None else "."
    missed = [c for c in every if not c.verified and c.data.get("state") == "done"]
    if missed:
        each = ", ".join(f"{c.label} ({percent(c.data.get('agreement'))})" for c in missed)
        said.append(f"Not within the tolerance: {each}.")
    stopped = [
        f"{c.label} ({clean(c.data.get('state'))})" for c in every if c.data.get("state") in ("failed", "crashed")
    ]
    if stopped:
        said.append(f"Without an answer: {', '.join(stopped)}.")
    added = sum(s.get("infill") or 0 for s in listed(results, "searches"))
    if added:
        said.append(f"{added} run{'s were' if added > 1 else ' was'} added to the response surface on the way.")
    return said


def _none_is_best(results: Results) -> list[str]:
    """Why no candidate is called the best, and what the closest one misses."""
    every = candidates(results)
    if not any(c.verified for c in every):
        return ["No candidate is verified, so none is called the best."]
    near = results.get("closest") or {}
    closest = next((c for c in every if (c.search, c.name) == (near.get("search"), near.get("candidate"))), None)
    said = ["No verified candidate meets every target and constraint, so none is called the best."]
    misses = [d for d in (closest.data.get("demands") or () if closest else ()) if d.get("met") is False]
    if closest and misses:
        said.append(f"The closest is {closest.label}: {'; '.join(lettered(results, d.get('words')) for d in misses)}.")
    return said


def _fit(results: Results) -> list[str]:
    best, said = fitted_model(results), []
    if best is None:
        return _none_is_best(results) if finished(results, "verify") else []
    for name in best.data.get("metrics") or {}:
        m, base = best.metrics(name), (results.get("baseline") or {}).get(name) or {}
        rmse, flat = quantity(m.get("rmse"), experiment(results, name).get("unit", ""), 3), about_zero(base)
        score = f"RMSE of {rmse}" if flat else f"NRMSE of {percent(number(m.get('nrmse')))} (RMSE {rmse})"
        whose = f"The best candidate, {best.label}," if best.search else "The fitted model, the most likely one,"
        e = experiment(results, name)
        band = fitted_band(results, e)
        if band is not None and band.moved.any() and (again := band.data.get("metrics")):
            rmse = quantity(again.get("rmse"), e.get("unit", ""), 3)
            near = f"RMSE of {rmse}" if flat else f"NRMSE of {percent(number(again.get('nrmse')))} (RMSE {rmse})"
            said.append(f"The fitted curve reproduces {clean(name)} with an {near}. {moved_sentence(band)}".strip())
            whose = "The simulation by itself"
        text = f"{whose} reproduces the measured curve {clean(name)} with an {score}"
        if not flat and known(base.get("nrmse")) and known(m.get("nrmse")) and m["nrmse"] > 0:
            text += f". For scale: a flat line at the mean force has {percent(base['nrmse'])}"
        v = prediction_of(results, e) if e.get("role") == "select" else None
        if v is not None and v.get("verdict") == "no" and (name == e["experiment"] or missed_channel(e, v)):
            text += f"; that is beyond its errors: {missed(v)}"
        said.append(text + ".")
    return said


def _cost(results: Results) -> str:
    c, t = results.get("counts") or {}, results.get("timings") or {}
    if not known(c.get("fe_runs")):
        return ""
    text = f"This took {c['fe_runs']} simulations"
    details = [f"{c[k]} {word}" for k, word in (("failed", "failed"), ("crashed", "crashed")) if c.get(k)]
    text += f" ({', '.join(details)})" if details else ""
    text += f" and {duration(t['total'])} of wall time" if known(t.get("total")) else ""
    if c.get("saved_by_similarity"):
        text += f"; {c['saved_by_similarity']} of the {c.get('asked')} runs asked for were saved by exact similarity"
    text += f"; {c['from_store']} answers were in the store already" if c.get("from_store") else ""
    return text + "."


def _facts(results: Results) -> tuple[Fact, ...]:
    facts, best = [], fitted_model(results)
    sure = _level(results).removeprefix(" with ").replace(" confidence", " interval")
    for p, d in interval_rows(results)[:3]:
        span = spans(results, p, d["interval"])
        if d.get("determined") is True:
            x = likely(results, p)
            value = span if x is None else _value(p, x, d["interval"], p.unit)
            facts.append(Fact(p.letter, value, f"determined; {sure or 'compatible with the data'}: {span}", "good"))
        else:
            word = how(results, p).removeprefix("is ")
            agrees = (
                "all agree with the data" if _agrees(results) == "agrees with the data" else "the model misses the data"
            )
            note = f"{sure}: {span}, {agrees}" if sure else f"{span}; {agrees}"
            facts.append(Fact(p.letter, word, note, "warn"))
    facts += derived_facts(results)
    if any(s.get("met") is False for s in listed(results, "searches")):
        facts.append(Fact("Targets", "not met", "by no recomputed candidate, within their tolerances", "warn"))
    if best:
        for name in list(best.data.get("metrics") or {})[:1]:
            base = ((results.get("baseline") or {}).get(name) or {}).get("nrmse")
            band = fitted_band(results, experiment(results, name))
            moved = band is not None and band.moved.any()
            whose = "best candidate" if best.search else "fitted curve" if moved else "fitted model"
            nrmse = number(best.metrics(name).get("nrmse"))
            note = f"NRMSE of the {whose}; {percent(base)} for the mean of the curve"
            if moved and band is not None:
                note += f"; {percent(nrmse)} without contact shift and gain"
                nrmse = number((band.data.get("metrics") or {}).get("nrmse"))
            facts.append(Fact("Fit", percent(nrmse), note))
    facts += [*prediction_fact(results), *gap_fact(results)]
    if finished(results, "verify") and candidates(results):
        good = sum(c.verified for c in candidates(results))
        note = "candidates whose rerun is what the surrogates predicted; no check of the model"
        facts.append(Fact("Surrogates", f"{good} of {len(candidates(results))}", note))
    c, t = results.get("counts") or {}, results.get("timings") or {}
    if known(c.get("fe_runs")):
        facts.append(Fact("Cost", f"{c['fe_runs']} runs", f"simulations, {duration(t.get('total'))} of wall time"))
    return tuple(facts)


def _determined_caption(results: Results) -> str:
    rows = interval_rows(results)
    fixed = [p.letter for p, d in rows if d.get("determined") is True]
    weakly = [p.letter for p, d in rows if d.get("determined") is not True and how(results, p) != NOT_DETERMINED]
    loose = [p.letter for p, d in rows if d.get("determined") is not True and how(results, p) == NOT_DETERMINED]
    said = []
    if fixed:
        said.append(f"the data leave {_and(fixed)} only a part of the range that was searched")
    if weakly:
        said.append(f"the data narrow {_and(weakly)} down, but not to a value")
    if loose:
        said.append(f"the data leave {_and(loose)} open over half of the range and more")
    text = "; ".join(said)
    bar = f"bar: what the data allow{_level(results)}"
    return f"{text[:1].upper()}{text[1:]}. Thin line: range searched; {bar}; dot: most likely value."


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
