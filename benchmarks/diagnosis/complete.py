"""The complete diagnosis of some cases: its verdicts beside the contest alone, and what it closes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from controls import with_values
from scores import Scored, share
from sections import Say, table
from shrunk import ENOUGH, Closed, closed, quartiles, seen_rows

from rso import discrepancy
from rso.discrepancy import Diagnosis
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.library.tables import Library

CAUSES = ("explained", "measurement", "ambiguous")


def complete(say: Say, whole: Library, s: Scored, values: np.ndarray, count: int, seed: int) -> None:
    """Complete diagnoses of some cases, each with its own noise, null, pairs, checks and validate curves."""
    rows = np.linspace(0, len(s.truth) - 1, min(count, len(s.truth))).astype(int)
    if not len(rows):
        return
    began, found, shares = time.process_time(), [], []
    for i in rows:
        own = replace(whole, plan=with_values(whole.plan, values[i]))
        found.append(discrepancy.diagnose(own, seed))
        shares += _closed(own, found[-1], s, i, values[i], seed)
    cost = (time.process_time() - began) / len(rows)
    source = {e.name: e.source for e in whole.effects}
    out = []
    for name, m in (("none", s.null[rows]), ("one cause", s.single[rows])):
        own = [(d, i) for d, i, k in zip(found, rows, m, strict=True) if k]
        if not own:
            continue
        hit = [(d, i) for d, i in own if d.verdict != "no_gap" and s.truth[i]]
        named = [set(s.truth[i]) <= {source[n] for n in d.named} for d, i in hit]
        lost = [d.verdict == "unexplained" and s.verdict[i] in CAUSES for d, i in hit]
        out.append(
            [
                name,
                len(own),
                sum(d.verdict != "no_gap" for d, _ in own),
                sum(s.found[i] for _, i in own),
                sum(named),
                sum(s.in_set[i] for _, i in hit),
                sum(lost),
                sum(
                    d.verdict in ("explained", "measurement") and set(s.truth[i]) != {source[n] for n in d.named}
                    for d, i in own
                ),
            ]
        )
    ratio = np.array([c.ratio for c in shares])
    quiet = [d.shrinkage for d, k in zip(found, s.null[rows], strict=True) if k]
    head = [
        "truth",
        "cases",
        "found",
        "found by the contest",
        "truth named",
        "named by the contest",
        "lost after the contest",
        "wrong and sure",
    ]
    text = (
        f"Of those with one cause, not scatter, {len(shares)} have a share; over what the true effect takes from G: "
        f"{quartiles(ratio)}, {ENOUGH:g} and more in {share(ratio >= ENOUGH)}.  Of those without a gap "
        f"{sum(d.closed is not None for d in quiet)} have one.  {cost:.1f} s CPU a case."
    )
    say(["## The complete diagnosis", *table(head, out), text, *_modulus(whole, s, rows, found)])


def _modulus(whole: Library, s: Scored, rows: np.ndarray, found: Sequence[Diagnosis]) -> list[str]:
    """How often the modulus lies in its interval if nothing else is there, and in that over all that the data allow."""
    name, out = whole.base.modulus, []
    for kind, m in (("none", s.null), ("one cause", s.single), ("two causes", ~s.null & ~s.single)):
        own = [(d, s.cases.modulus[i]) for d, i in zip(found, rows, strict=True) if m[i] and d.odd is None]
        if not own:
            continue
        said, reached = (
            np.array([[getattr(d.reach[name], of)[k] for k in (0, 2)] for d, _ in own]) for of in ("alone", "whole")
        )
        μ = np.array([v for _, v in own])
        held = [share((v[:, 0] <= μ) & (μ <= v[:, 1])) for v in (said, reached)]
        width = [f"{np.median(np.log(v[:, 1] / v[:, 0])):.3f}" for v in (said, reached)]
        out.append([kind, len(own), held[0], width[0], held[1], width[1]])
    head = [
        "truth",
        "cases",
        f"{name} held if nothing else is there",
        "width in ln",
        "over all that the data allow",
        "width in ln",
    ]
    return ["", *table(head, out)]


def _closed(own: Library, d: Diagnosis, s: Scored, i: int, values: np.ndarray, seed: int) -> list[Closed]:
    """What a diagnosis closes beside the true effect in its place; nothing where no share is printed."""
    effects = s.cases.effects[i]
    if d.verdict == "no_gap" or len(effects) != 1 or effects[0].family == "scatter":
        return []
    evidence, in_turn = Evidence(d.bench, own.effects), bool(seen_rows(own.plan).all())
    made = closed(own, evidence, values, Hypothesis(effects), seed, in_turn, False)
    found = Closed(d.verdict, d.chosen.effects == effects, d.shrinkage, made)
    return [found] if found.printed and found.possible else []
