"""What a contest says: the verdict, the causes that it names, and which hypotheses lead or lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rso.discrepancy.evidence.attribution import Comparison
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.residual_test import ResidualScore
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, VerdictRules
from rso.discrepancy.library.effects import Effect

N_BEATEN_CAUSES = 2  # causes not named whose fits are kept


@dataclass(frozen=True)
class Judgement:
    """The verdict, the effects it names, and the hypothesis that stands for it."""

    verdict: str
    named: tuple[str, ...]
    chosen: Hypothesis


UNEXPLAINED = Judgement("unexplained", (), Hypothesis((), True))


def judge_comparison(contest: Comparison, gap: bool, rules: VerdictRules = DIAGNOSIS_SETTINGS.rules) -> Judgement:
    """What a contest says; `gap` is the decision of the null's statistic.

    Forms of one cause count together.  A cause is sure when it takes part in hypotheses that hold `sure` of the
    probability given a gap; otherwise causes are named until their hypotheses hold `cover` of what has a cause.
    A pair is never more than a part, and what cell and specimen can both do is said of neither.
    """
    if not gap:
        return Judgement("no_gap", (), Hypothesis(()))
    given, hypotheses = given_a_gap(contest), contest.hypotheses[1:]
    sets: dict[tuple[str, ...], float] = {}
    marginal: dict[str, float] = {}
    partly: dict[tuple[str, ...], float] = {}
    form: dict[str, tuple[float, Effect]] = {}
    best_of: dict[tuple[str, ...], tuple[float, Hypothesis]] = {}
    nothing = 0.0
    for h, q in zip(hypotheses, map(float, given), strict=True):
        key = tuple(sorted({e.source for e in h.effects}))
        if not key:
            nothing += q
            continue
        sets[key] = sets.get(key, 0.0) + q
        partly[key] = partly.get(key, 0.0) + q * h.unexplained
        best_of[key] = max(best_of.get(key, (-1.0, h)), (q, h), key=lambda v: v[0])
        for e in h.effects:
            form[e.source] = max(form.get(e.source, (-1.0, e)), (q, e), key=lambda v: v[0])
        for source in key:
            marginal[source] = marginal.get(source, 0.0) + q
    order = sorted(sets, key=lambda k: -sets[k])
    if not order or nothing > sets[order[0]]:
        return UNEXPLAINED
    best, chosen = order[0], best_of[order[0]][1]
    named: list[str] = []
    reached = 0.0
    for key in order:
        if key == best or all(marginal[v] > rules.worth_naming for v in key):
            named += [v for v in key if v not in named]
        reached += sets[key] / (1.0 - nothing)
        if reached >= rules.cover or len(named) >= rules.most:
            break
    names = tuple(form[v][1].name for v in sorted(named, key=lambda v: -marginal[v]))
    # two effects together mimic much that is in no catalogue: they are named, not taken for the whole truth
    if partly[best] > 0.5 * sets[best] or len(best) > 1:
        return Judgement("partly", names, chosen)
    if min(marginal[v] for v in best) < rules.sure:
        return Judgement("ambiguous", names, chosen)
    own = tuple(e.name for e in chosen.effects)
    if any(e.like_a_modulus or e.like_a_body or e.like_a_spot for e in chosen.effects):
        return Judgement("ambiguous", own, chosen)
    measured = all(e.measured for e in chosen.effects)
    return Judgement("measurement" if measured else "explained", own, chosen)


def pairs_of_remainder(
    chosen: Hypothesis, rest: ResidualScore, pairs: Sequence[tuple[Effect, Effect]]
) -> list[tuple[Effect, Effect]]:
    """Pairs of a single cause and what shows in its remainder, as far as they are not among the pairs."""
    if len(chosen.effects) != 1 or chosen.effects[0].family == "scatter":
        return []
    known = [set(p) for p in pairs]
    return [(chosen.effects[0], e) for e in rest.alike if {chosen.effects[0], e} not in known]


def given_a_gap(contest: Comparison) -> np.ndarray:
    """Probabilities of all hypotheses but the first, given that it is not the first."""
    s = contest.log_evidence + contest.log_prior
    return np.exp(s[1:] - logsumexp(s[1:]))


def most_probable(contest: Comparison, count: int = 3) -> list[Hypothesis]:
    """The most probable hypotheses that have effects, without what is unexplained."""
    s = contest.log_evidence + contest.log_prior
    found: list[Hypothesis] = []
    for i in np.argsort(-s):
        h = Hypothesis(contest.hypotheses[i].effects)
        if h.effects and h not in found:
            found.append(h)
    return found[:count]


def singles(contest: Comparison, named: Sequence[str]) -> list[Hypothesis]:
    """Each named effect alone, all forms of it that are named."""
    return [h for h in contest.hypotheses if len(h.effects) == 1 and not h.unexplained and h.effects[0].name in named]


def beaten(contest: Comparison, named: Sequence[str]) -> list[Hypothesis]:
    """The most probable single hypotheses of causes that are not named, and move a mean: what lost, to look at."""
    s = contest.log_evidence + contest.log_prior
    known = {e.name: e.source for h in contest.hypotheses for e in h.effects}
    taken, found = {known[n] for n in named}, []
    for i in np.argsort(-s):
        h = contest.hypotheses[i]
        if len(h.effects) == 1 and not h.unexplained and h.effects[0].family != "scatter":
            if h.effects[0].source not in taken:
                found.append(h)
                taken.add(h.effects[0].source)
    return found[:N_BEATEN_CAUSES]
