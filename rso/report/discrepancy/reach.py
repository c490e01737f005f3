"""How far a diagnosis reaches: its self-check, what its test plan can see, and which test would show more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import DASH, known
from rso.discrepancy.parameters import called
from rso.discrepancy.wording import MIN_NAMED_TEST_CHANCE
from rso.report.discrepancy.figures import leading, least, power_rows
from rso.report.discrepancy.reading import UNDECIDED, Found, amount, brief, core, effects_of, told
from rso.report.layout.digits import aligned, clean, percent
from rso.report.layout.document import Block, Cell, Picture, Section, Text, column, table, words
from rso.report.reading import listed, number


def how_sure(found: Found) -> Section:
    """Section 6: data simulated from the leading hypotheses, through the same contest."""
    title, rows = "How sure", listed(found, "checks")
    blocks: list[Block] = []
    if rows:
        names = [brief(found, str(c.get("hypothesis"))) for c in rows]
        columns = [column("Simulated from", words(names), number=False)]
        for key, text in (
            ("returned", "comes back as itself"),
            ("in_set", "in the named set"),
            ("no_gap", "called no gap"),
        ):
            columns.append(column(text, words([percent(number(c.get(key))) for c in rows])))
        columns.append(column("data sets", words([str(c.get("n") or DASH) for c in rows])))
        note = "Data simulated from each, at sizes that these data allow, and judged in the same way."
        blocks.append(table("Self-check", columns, note))
    else:
        blocks.append(Text("No self-check was run: there is no cause to simulate.", "plain"))
    wanted = [n for c in core(found).get("causes") or () if (n := clean(c.get("effect")))]
    wanted += [e for n, _ in leading(found) for e in effects_of(n) if e not in wanted]
    entries = {clean(v.get("effect")): v for v in core(found).get("detectable") or ()}
    mine = [(n, entries[n]) for n in list(dict.fromkeys(wanted))[:6] if n in entries]
    if mine and rows:
        columns = [
            column("Effect", words([clean(called(found, n)) for n, _ in mine]), number=False),
            column("recognised", words([_recognised(v) for _, v in mine])),
            column("can look like", tuple(_confused(found, v) for _, v in mine), number=False),
        ]
        note = "Recognised: mean probability of the effect itself where it is large enough to be noticed; –: never."
        blocks.append(table("What the leading hypotheses are mistaken for", columns, note))
    return Section("sure", title, tuple(blocks))


def _confused(found: Found, v: Mapping[str, Any]) -> Cell:
    others = ", ".join(clean(called(found, n)) for n in v.get("confused_with") or ())
    if not v.get("visible"):
        return Cell(DASH, mark="quiet")
    return Cell(others) if others else Cell("nothing else", mark="quiet")


def _recognised(v: Mapping[str, Any]) -> str:
    return percent(number(v.get("recognised"))) if v.get("visible") else DASH


def in_sight(found: Found) -> Section:
    """Section 7: what this test plan can see at all, whatever the data say."""
    title, rows = "What the plan can see", list(core(found).get("detectable") or ())
    if not rows:
        return Section("sight", title, (Text("What the plan can see was not computed.", "missing"),))
    blind = sum(not v.get("visible") for v in rows)
    text = f"Of {len(rows)} effects this plan can see {len(rows) - blind} at some plausible size"
    unseen = ", ".join(clean(called(found, v["effect"])) for v in rows if not v.get("visible"))
    blocks: list[Block] = [Text(text + (f"; {blind} stay invisible, whatever their size: {unseen}." if blind else "."))]
    rows = [v for v in rows if v.get("visible")]
    order = {n: k for k, (n, _, _) in enumerate(power_rows(found))}
    rows.sort(key=lambda v: order.get(clean(v.get("effect")), len(order)))
    before = {n: least(values) for n, values, _ in power_rows(found)}
    limit = [
        before.get(clean(v.get("effect")), "") + amount(v.get("smallest_visible"), v.get("unit"), 2)
        if known(v.get("smallest_visible"))
        else "visible"
        for v in rows
    ]
    columns = [
        column("Effect", words([clean(called(found, v["effect"])) for v in rows]), number=False),
        column("knob", words([clean(v["effect"]) for v in rows], "code"), number=False),
        column("smallest visible", words(limit)),
        column("recognised", words([_recognised(v) for v in rows])),
        column("confused with", tuple(_confused(found, v) for v in rows), number=False),
    ]
    note = "Smallest visible: noticed in half of the data sets, at most 5 % false alarms; “visible”: it has no zero."
    note += " ≤: nothing smaller was simulated." if any(t.startswith("≤") for t in limit) else ""
    if rows:
        blocks.append(table("Limits of this plan", columns, note))
    if power_rows(found):
        caption = "How often a gap is noticed, from the smallest to the largest plausible size of each effect."
        blocks.append(Picture("power", caption))
    return Section("sight", title, tuple(blocks))


def _named(test: Found) -> str:
    """A test in words, with what its forecast leans on."""
    note = clean(test["note"]) if test.get("note") else ""
    return clean(test.get("test")) + (f" ({note})" if note else "")


def _pair(found: Found, test: Found) -> str:
    return " / ".join(clean(called(found, str(n))) for n in test.get("separates") or ())


def _without_tests(found: Found) -> tuple[Block, ...]:
    """Why no test is proposed, and what a further one would show all the same."""
    verdict = told(found)
    if verdict == UNDECIDED:
        return (
            Text("Whether there is a gap at all comes first: more repeats of these tests, or less noise, decide it."),
        )
    if verdict in ("partly", "unexplained"):
        return (Text("What is left looks like nothing in the catalogue, so no further test is proposed."),)
    if verdict == "ambiguous":
        text = "No test was found that separates these causes: repeats, less noise or other channels are needed."
        return (Text(text),)
    if verdict != "no_gap":
        return (Text("One explanation is left, so no test is needed to separate causes."),)
    blocks: list[Block] = [Text("No gap was found, so there are no rival causes that a test could separate.")]
    effects = list(core(found).get("detectable") or ())
    if blind := sum(not v.get("visible") for v in effects):
        text = f"Effects may be there that do not show: {blind} of {len(effects)} at no plausible size, the others "
        blocks.append(
            Text(f"{text}where they are small. A test of another kind or with less noise shows more of them.")
        )
    elif effects:
        blocks.append(
            Text("Effects may be there that are too small to show: a test with less noise shows more of them.")
        )
    blocks.append(Text("Which test narrows the parameters is another question, which rso next answers."))
    return tuple(blocks)


def next_test(found: Found) -> Section:
    """Section 8: tests by how well they separate what is still open."""
    title, rows = "Next test", list(core(found).get("next_test") or ())
    if not rows:
        return Section("next", title, _without_tests(found))
    every, rows = rows, [t for t in rows if (number(t.get("chance")) or 0.0) >= MIN_NAMED_TEST_CHANCE]
    if not rows:
        told = f"None of {len(every)} proposed tests would separate the causes (chance below 1 %): "
        return Section("next", title, (Text(f"{told}repeats, less noise or other channels are needed."),))
    distance = [number(t.get("distance")) for t in rows]
    chance = [number(t.get("chance")) for t in rows]
    promise = [
        Cell("promises an answer", mark="good") if v is not None and v >= 0.8 else Cell("", mark="") for v in chance
    ]
    columns = [
        column("Test", words([_named(t) for t in rows]), number=False),
        column("settles it", aligned([None if v is None else 100 * v for v in chance], 2), "%"),
        column("worst pair", words([_pair(found, t) for t in rows]), number=False),
        column("D", aligned(distance, 3)),
        column("resolves", words([f"{t.get('resolves', DASH)} of {t.get('pairs', DASH)} pairs" for t in rows])),
        column("", tuple(promise), number=False),
    ]
    note = "Decides: probability that one cause has 95 % afterwards; indentations are repeated three times. "
    note += "D: distance in standard deviations of what the pair predicts for the test, after a re-fit; 4 is enough."
    if len(rows) < len(every):
        note += f" Left out because they decide nothing (chance below 1 %): {len(every) - len(rows)}."
    return Section("next", title, (table("Tests that would separate the causes", columns, note),))
