"""What must happen where the answer is known beforehand: controls, ablations, tests that decide, whole diagnoses."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from cases import TWIN, Cases, Table, contested, other_bench
from scipy.linalg import cholesky
from scipy.special import logsumexp
from scores import Scored, by_key

from rso.discrepancy import next_test, proposals
from rso.discrepancy.diagnosis import WHOLE_GAP_VERDICTS, misfit
from rso.discrepancy.evidence import attribution, hypotheses
from rso.discrepancy.evidence.attribution import Comparison, Evidence, Shared
from rso.discrepancy.evidence.gaussian_mixture import mean_prediction, posterior
from rso.discrepancy.evidence.residual_test import residual_score
from rso.discrepancy.evidence.verdict import Judgement, judge_comparison
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import SurfaceProfile, Test, TestPlan
from rso.evaluation import Task
from rso.optimal_design.separation import DECIDED_PROBABILITY

NULLS = 400
Filter = Callable[[Comparison], Comparison]
Run = Callable[[Sequence[Task]], list[Any]]


ALONE = ("explained", "measurement")  # verdicts that name one cause as sure


def threshold_of(evidence: Evidence, y: np.ndarray, seed: int, keep: Filter = lambda c: c) -> float:
    """Threshold of the statistic from the pipeline's own null, as the product has it."""
    contests = attribution.comparisons(evidence, attribution.nulls(evidence, y, NULLS, seed))
    return attribution.critical(
        np.array([keep(c).statistic for c in contests]), evidence.bench.settings.rules.false_alarm
    )


def scored(
    evidence: Evidence,
    y: np.ndarray,
    cases: Cases,
    classes,
    seed: int,
    keep: Filter = lambda c: c,
    threshold: float | None = None,
    table: Table | None = None,
) -> Scored:
    """First contest, null, second contest without pairs, judgement."""
    table = Table(evidence, cases.Y) if table is None else table
    first = [keep(c) for c in attribution.comparisons(table, np.arange(len(cases.Y)))]
    limit = threshold_of(evidence, y, seed, keep) if threshold is None else threshold
    rows = [i for i, c in enumerate(first) if c.statistic > limit]
    last = list(first)
    for i, c in zip(rows, contested(table, rows, first), strict=True):
        last[i] = keep(c)
    return Scored(cases, last, limit, classes, first, evidence.bench.settings.rules)


def only(names: Callable[[hypotheses.Hypothesis], bool]) -> Filter:
    """Contests of some hypotheses only."""

    def keep(c: Comparison) -> Comparison:
        own = [k for k, h in enumerate(c.hypotheses) if names(h)]
        return replace(
            c,
            hypotheses=tuple(c.hypotheses[k] for k in own),
            log_evidence=c.log_evidence[own],
            log_prior=c.log_prior[own],
        )

    return keep


@contextmanager
def finer_tiles():
    """Tiles of half the width in every coordinate: what exact integrals would say, nearly."""
    names = ("BASE_TILES", "SIZE_TILES", "SIZE_TILES_SIDE", "SHAPE_TILES")
    before = {n: getattr(hypotheses, n) for n in names}
    try:
        for n, v in before.items():
            setattr(hypotheses, n, {k: 2 * w for k, w in v.items()} if isinstance(v, dict) else 2 * v)
        yield
    finally:
        for n, v in before.items():
            setattr(hypotheses, n, v)


def ablations(bench: Shared, y: np.ndarray, cases: Cases, classes, seed: int) -> dict[str, Callable[[], Scored]]:
    """The same cases judged without one part of the method each, and with finer tiles."""

    def run(b: Shared, keep: Filter = lambda c: c) -> Scored:
        return scored(Evidence(b, b.library.effects), y, cases, classes, seed, keep)

    def fine() -> Scored:
        with finer_tiles():
            return run(replace(bench, tiles={(): hypotheses.tiles(bench.library, (), bench.modulus)}))

    return {
        "without projection": lambda: run(other_bench(bench, y, projected=False)),
        "without correlation of noise": lambda: run(other_bench(bench, y, correlated=False)),
        "without free competitor": lambda: run(bench, only(lambda h: not h.unexplained)),
        "with tiles half as wide": fine,
    }


def noisier(bench: Shared, y: np.ndarray, cases: Cases, classes, seed: int) -> Scored:
    """The same means with twice the noise, known to the diagnosis."""
    rng = np.random.default_rng(seed)
    Y = cases.mean + 2 * rng.standard_normal(cases.mean.shape) @ cholesky(bench.C, lower=True).T
    b = other_bench(bench, y, scale=4.0)
    return scored(Evidence(b, b.library.effects), y, cases.picked(range(len(Y)), Y), classes, seed)


def permuted(evidence: Evidence, cases: Cases, threshold: float, seed: int) -> np.ndarray:
    """Verdicts where the whitened residuals of the base model are put in random order."""
    rng = np.random.default_rng(seed)
    h = evidence.ready(())
    Yw = h.white(cases.Y)
    fit = np.array([mean_prediction(h, v) for v in Yw])
    Y = (fit + rng.permuted(Yw - fit, axis=1)) @ h.white.L.T
    null = replace(cases, Y=Y)
    return scored(evidence, cases.Y[0], null, {}, seed, threshold=threshold).verdict


def looked_at(evidence: Evidence, effects: Sequence[Effect], judged: Judgement, y: np.ndarray, seed: int) -> str:
    """The verdict after a look at what the cause leaves, with these effects in the catalogue."""
    if judged.verdict not in WHOLE_GAP_VERDICTS:
        return judged.verdict
    few = copy.copy(evidence)
    few.effects = tuple(effects)
    return "partly" if residual_score(few, judged.chosen, y, seed).there else judged.verdict


def judged_without(table: Table, source: str, threshold: float, rows: Sequence[int]) -> list[tuple[Table, Judgement]]:
    """Judgements of some rows where a source is not in the catalogue, and the table without it."""
    few = table.seen_by([e for e in table.effects if e.source != source])
    first = dict(zip(rows, attribution.comparisons(few, np.array(rows)), strict=True))
    gap = [i for i in rows if first[i].statistic > threshold]
    last = {**first, **dict(zip(gap, contested(few, gap, first), strict=True))}
    return [(few, judge_comparison(last[i], i in gap)) for i in rows]


def taken_out(
    table: Table, cases: Cases, threshold: float, rows: Sequence[int], seed: int
) -> tuple[dict[str, list[str]], list[str], np.ndarray, np.ndarray, list[tuple[str, float]]]:
    """Verdicts, by source, of cases whose cause is not in the catalogue, and without a look at what is left; of those
    where another one is sure, what somebody knows who has it in his catalogue: the ln Bayes factor of the true cause
    against all others, and how much less χ² it leaves than the one named; of all, the verdict and how much less χ² the
    true cause leaves than the best of the others alone."""
    out: dict[str, list[str]] = {}
    blind: list[str] = []
    told: list[float] = []
    better: list[float] = []
    tells: list[tuple[str, float]] = []
    for s in sorted({cases.truth(i)[0] for i in rows}):
        mine = [i for i in rows if cases.truth(i)[0] == s]
        both = judged_without(table, s, threshold, mine)
        few, judged = both[0][0], [j for _, j in both]
        blind += [j.verdict for j in judged]
        out[s] = [
            looked_at(table.evidence, few.effects, j, cases.Y[i], seed + i) for i, j in zip(mine, judged, strict=True)
        ]
        for i, v, c in zip(mine, out[s], attribution.comparisons(few, np.array(mine)), strict=True):
            alone = [k for k, h in enumerate(c.hypotheses) if len(h.effects) == 1 and not h.unexplained]
            other = c.hypotheses[max(alone, key=lambda k, c=c: c.log_evidence[k] + c.log_prior[k])].effects
            left = [
                misfit(table.evidence, hypotheses.Hypothesis(tuple(e)), cases.Y[i]) for e in (other, cases.effects[i])
            ]
            tells.append((v, len(cases.Y[i]) * (left[0] - left[1])))
        for i, v, j, c in zip(mine, out[s], judged, attribution.comparisons(table, np.array(mine)), strict=True):
            if v in ALONE:
                own = (j.chosen.effects, cases.effects[i])
                left = [misfit(table.evidence, hypotheses.Hypothesis(tuple(e)), cases.Y[i]) for e in own]
                better.append(len(cases.Y[i]) * (left[0] - left[1]))
                true = np.array([any(e.source == s for e in h.effects) for h in c.hypotheses])
                score = c.log_evidence + c.log_prior
                told.append(float(logsumexp(score[true]) - logsumexp(score[1:][~true[1:]])))
    return out, blind, np.array(told), np.array(better), tells


def with_twin(table: Table, cases: Cases, threshold: float, rows: Sequence[int]) -> list[str]:
    """Verdicts where the true effect is in the catalogue twice, under another name."""
    out = []
    for i in rows:
        e = cases.effects[i][0]
        two = table.seen_by([*table.effects, replace(e, name=e.name + TWIN, cause="")])
        first = {i: attribution.comparisons(two, np.array([i]))[0]}
        gap = first[i].statistic > threshold
        out.append(judge_comparison(contested(two, [i], first)[0] if gap else first[i], gap).verdict)
    return out


def taken_away(bench: Shared, y: np.ndarray, cases: Cases) -> dict[str, tuple[np.ndarray, int]]:
    """Probability of the right cause given a gap with parts of the data taken away, and the length of what is left."""
    plan = bench.library.plan
    effects = [e for e in bench.library.effects if e.family != "scatter"]

    def rows(keep: Callable[[Test | SurfaceProfile], np.ndarray | bool]) -> np.ndarray:
        found = [
            np.arange(at.start, at.stop)[np.broadcast_to(keep(item), (at.stop - at.start,))]
            for item, _, at in plan.rows()
        ]
        return np.concatenate(found)

    force = lambda t: isinstance(t, Test)  # noqa: E731
    primary = bench.library.primary
    parts = {
        "everything": rows(lambda t: True),
        "without the profile": rows(force),
        "without other points": rows(lambda t: t.place == primary),
        "without unloading": rows(lambda t: t.branch == 0 if force(t) else True),
        "without cycles": rows(lambda t: not force(t) or not np.any(t.branch == 1)),
        "loading at the main point only": rows(lambda t: force(t) and t.place == primary and not np.any(t.branch == 1)),
    }
    out = {}
    for name, own in parts.items():
        if len(own) < 10 or any(len(own) == n for _, n in out.values()):
            continue
        b = other_bench(bench, y, rows=own)
        table = Table(Evidence(b, effects), cases.Y)
        right = []
        for i, c in enumerate(attribution.comparisons(table, np.arange(len(cases.Y)))):
            p = by_key(c, c.probability)
            right.append(p.get(cases.truth(i), 0.0) / max(1 - p[()], 1e-300))
        out[name] = (np.array(right), len(own))
    return out


def with_values(plan: TestPlan, y: np.ndarray) -> TestPlan:
    """The plan with other values (n,)."""
    tests = {id(t): dict(t.values) for t in plan.tests}
    profiles = {}
    for item, c, at in plan.rows():
        if isinstance(item, SurfaceProfile):
            profiles[id(item)] = y[at]
        else:
            tests[id(item)][c] = y[at]
    return replace(
        plan,
        tests=tuple(replace(t, values=tests[id(t)]) for t in plan.tests),
        profiles=tuple(replace(p, value=profiles[id(p)]) for p in plan.profiles),
    )


def next_tests(
    evidence: Evidence, result: Scored, rows: Sequence[int], seed: int, run: Run | None = None
) -> dict[str, np.ndarray]:
    """Whether the proposed test, a random one, or any, leaves the right cause alone with DECIDED of the probability.

    Tests: those that the tables can predict, or with `run` can be simulated, those that show one knob by itself, and,
    at random only, once more one of the plan.  A rival predicts a new test from its posterior; the truth answers with
    noise.
    """
    rng = np.random.default_rng(seed)
    library, bench, cases = evidence.bench.library, evidence.bench, result.cases
    known = {e.name: e for e in evidence.effects if e.family != "scatter"}
    everything = {n: ((e,), None) for n, e in known.items() if e.family == "model"}
    there = {
        c.words: (c, v)
        for c in proposals.proposed_tests(library)
        if (v := next_test.candidate_library(library, c, everything, run)) is not None
    }
    plan = library.plan
    once_more = [[t for t in plan.tests if t.experiment == k] for k in sorted({t.experiment for t in plan.tests})]
    again = [replace(library, plan=replace(plan, tests=tuple(tests), profiles=())) for tests in once_more]
    gauges = next_test.gauge_tests(library, bench)
    out: dict[str, list[bool]] = {"proposed": [], "random": [], "any of the list": []}
    chances = []
    for i in rows:
        names = [n for n in result.judged[i].named if n in known]
        truth = cases.effects[i][0]
        if len(names) < 2 or truth.name not in names:
            continue
        y = cases.Y[i]
        posts = {}
        for n in names:
            h = evidence.best((known[n],), y, loose=True)
            posts[n] = ((known[n],), posterior(h, h.white(y), 400, rng))
        p = by_key(result.contests[i], result.contests[i].probability)
        prior = {n: p.get((known[n].source,), 0.0) for n in names}
        prior = {n: v / sum(prior.values()) for n, v in prior.items()}  # the truth is in the set
        pairs = [
            next_test.weighed(w, next_test.distances(v, bench, posts, c.without), prior) for w, (c, v) in there.items()
        ]
        pairs += [next_test.weighed(w, D, prior) for w, D in next_test.direct(library, bench, posts).items()]
        best = max(pairs, key=lambda t: t.information)
        chances.append(best.chance)
        pick = rng.integers(len(pairs) + len(again))

        right = np.array([known[n].source == truth.source for n in names])
        P = np.maximum([prior[n] for n in names], 1e-12)
        each = {
            t.test: _settles(
                right,
                P,
                _answer(there[t.test][1], bench, posts, cases, i, rng, there[t.test][0].without)
                if t.test in there
                else _answer_direct(t.test, gauges, bench, posts, cases, i, rng),
            )
            for t in pairs
        }
        out["proposed"].append(each[best.test])
        out["any of the list"].append(any(each.values()))
        out["random"].append(
            each[pairs[pick].test]
            if pick < len(pairs)
            else _settles(right, P, _answer(again[pick - len(pairs)], bench, posts, cases, i, rng))
        )
    return {**{k: np.array(v) for k, v in out.items()}, "promised": np.array(chances)}


def _settles(right: np.ndarray, P: np.ndarray, logs: np.ndarray) -> bool:
    """Whether what is `right` (k,) has DECIDED of the probability, from P (k,) and the densities of a new test."""
    s = np.log(P) + logs
    return bool(np.exp(s - np.logaddexp.reduce(s))[right].sum() >= DECIDED_PROBABILITY)


def _answer(
    there: Library, bench: Shared, posts, cases: Cases, i: int, rng, without: frozenset[str] = frozenset()
) -> np.ndarray:
    """Log density of a new test's data under every rival, data of the true effect."""
    acting = [e for e in cases.effects[i] if e.name not in without]
    d = len(there.base.axes)
    at = cases.at[i] if acting else cases.at[i][:d]
    A, c = predict(there, acting, at[None], bench.modulus)
    f = cases.modulus[i] * A[0] + c[0]
    C = next_test.new_tests_covariance(there, bench, f)
    y = f + cholesky(C, lower=True) @ rng.standard_normal(len(f))
    logs = []
    for effects, post in posts.values():
        F = next_test.forecast(there, bench, effects, post, without)
        S = C + np.cov(F.T)
        r = y - F.mean(axis=0)
        logs.append(-0.5 * (r @ np.linalg.solve(S, r) + np.linalg.slogdet(S)[1]))
    return np.array(logs)


def _answer_direct(words: str, gauges, bench: Shared, posts, cases: Cases, i: int, rng) -> np.ndarray:
    """The same for a test that shows knobs by themselves: each is read with the uncertainty of the test."""
    d = len(bench.library.base.axes)
    logs = np.zeros(len(posts))
    for n, (effects, post) in posts.items():
        e = effects[0]
        if gauges.get(e.size.name, ("",))[0] != words or e.size.neutral is None:
            continue
        resolution = gauges[e.size.name][1]
        off = next_test.effect_sizes(bench, effects, post, e) - e.size.neutral
        own = cases.effects[i][0].name == n
        scale = (cases.modulus[i] / (1.0 if e.family == "model" else bench.modulus)) ** e.size.exponent
        true = float(e.size.value(cases.at[i][d])) * scale - e.size.neutral if own else 0.0
        z = true + resolution * rng.standard_normal()
        for k, m in enumerate(posts):
            v = resolution**2 + (np.var(off) if m == n else 0.0)
            logs[k] += -0.5 * (z - (np.mean(off) if m == n else 0.0)) ** 2 / v - 0.5 * np.log(v)
    return logs
