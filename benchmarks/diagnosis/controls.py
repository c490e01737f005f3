"""What must happen where the answer is known beforehand: controls, ablations, tests that decide, whole diagnoses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from cases import TWIN, Cases, Table, contested, other_bench
from scipy.linalg import cholesky
from scores import Scored, by_key

from rso import diagnosis
from rso.diagnosis import attribute, hypotheses, next_test, noise
from rso.diagnosis.attribute import Bench, Contest, Evidence
from rso.diagnosis.judge import judge
from rso.diagnosis.library import Library
from rso.diagnosis.mixture import mean_prediction, posterior
from rso.diagnosis.prediction import predict
from rso.diagnosis.testplan import Profile, Test, TestPlan

NULLS = 400
Filter = Callable[[Contest], Contest]


def threshold_of(evidence: Evidence, y: np.ndarray, seed: int, keep: Filter = lambda c: c) -> float:
    """Threshold of the statistic from the pipeline's own null, as the product has it."""
    contests = attribute.contests(evidence, attribute.nulls(evidence, y, NULLS, seed))
    return max(float(np.quantile([keep(c).statistic for c in contests], 1 - attribute.FALSE_ALARM)), 0.0)


def scored(evidence: Evidence, y: np.ndarray, cases: Cases, classes, seed: int, keep: Filter = lambda c: c,
           threshold: float | None = None, table: Table | None = None) -> Scored:  # fmt: skip
    """First contest, null, second contest without pairs, judgement."""
    table = Table(evidence, cases.Y) if table is None else table
    first = [keep(c) for c in attribute.contests(table, np.arange(len(cases.Y)))]
    limit = threshold_of(evidence, y, seed, keep) if threshold is None else threshold
    rows = [i for i, c in enumerate(first) if c.statistic > limit]
    last = list(first)
    for i, c in zip(rows, contested(table, rows, first), strict=True):
        last[i] = keep(c)
    return Scored(cases, last, limit, classes, first)


def only(names: Callable[[hypotheses.Hypothesis], bool]) -> Filter:
    """Contests of some hypotheses only."""

    def keep(c: Contest) -> Contest:
        own = [k for k, h in enumerate(c.hypotheses) if names(h)]
        return Contest(tuple(c.hypotheses[k] for k in own), c.log_evidence[own], c.log_prior[own])

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


def ablations(bench: Bench, y: np.ndarray, cases: Cases, classes, seed: int) -> dict[str, Callable[[], Scored]]:
    """The same cases judged without one part of the method each, and with finer tiles."""

    def run(b: Bench, keep: Filter = lambda c: c) -> Scored:
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


def noisier(bench: Bench, y: np.ndarray, cases: Cases, classes, seed: int) -> Scored:
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


def taken_out(table: Table, cases: Cases, threshold: float, rows: Sequence[int]) -> dict[str, list[str]]:
    """Verdicts, by source, of cases whose cause is not in the catalogue."""
    out: dict[str, list[str]] = {}
    sources = sorted({cases.truth(i)[0] for i in rows})
    for s in sources:
        mine = [i for i in rows if cases.truth(i)[0] == s]
        few = table.seen_by([e for e in table.effects if e.source != s])
        first = dict(zip(mine, attribute.contests(few, np.array(mine)), strict=True))
        gap = [i for i in mine if first[i].statistic > threshold]
        last = {**first, **dict(zip(gap, contested(few, gap, first), strict=True))}
        out[s] = [judge(last[i], i in gap).verdict for i in mine]
    return out


def with_twin(table: Table, cases: Cases, threshold: float, rows: Sequence[int]) -> list[str]:
    """Verdicts where the true effect is in the catalogue twice, under another name."""
    out = []
    for i in rows:
        e = cases.effects[i][0]
        two = table.seen_by([*table.effects, replace(e, name=e.name + TWIN, cause="")])
        first = {i: attribute.contests(two, np.array([i]))[0]}
        gap = first[i].statistic > threshold
        out.append(judge(contested(two, [i], first)[0] if gap else first[i], gap).verdict)
    return out


def taken_away(bench: Bench, y: np.ndarray, cases: Cases) -> dict[str, tuple[np.ndarray, int]]:
    """Probability of the right cause given a gap with parts of the data taken away, and the length of what is left."""
    plan = bench.library.plan
    effects = [e for e in bench.library.effects if e.family != "scatter"]

    def rows(keep: Callable[[Test | Profile], np.ndarray | bool]) -> np.ndarray:
        found = [np.arange(at.start, at.stop)[np.broadcast_to(keep(item), (at.stop - at.start,))]
                 for item, _, at in plan.rows()]  # fmt: skip
        return np.concatenate(found)

    force = lambda t: isinstance(t, Test)  # noqa: E731
    primary = bench.library.primary
    parts = {
        "everything": rows(lambda t: True),
        "without the profile": rows(force),
        "without other points": rows(lambda t: t.place == primary),
        "without unloading": rows(lambda t: t.branch == 0 if force(t) else True),
        "without cycles": rows(lambda t: not force(t) or not np.any(t.branch == 1)),
        "loading at the main point only": rows(
            lambda t: force(t) and t.place == primary and not np.any(t.branch == 1)),
    }  # fmt: skip
    out = {}
    for name, own in parts.items():
        if len(own) < 10 or any(len(own) == n for _, n in out.values()):
            continue
        b = other_bench(bench, y, rows=own)
        table = Table(Evidence(b, effects), cases.Y)
        right = []
        for i, c in enumerate(attribute.contests(table, np.arange(len(cases.Y)))):
            p = by_key(c, c.probability)
            right.append(p.get(cases.truth(i), 0.0) / max(1 - p[()], 1e-300))
        out[name] = (np.array(right), len(own))
    return out


def with_values(plan: TestPlan, y: np.ndarray) -> TestPlan:
    """The plan with other values (n,)."""
    tests = {id(t): dict(t.values) for t in plan.tests}
    profiles = {}
    for item, c, at in plan.rows():
        if isinstance(item, Profile):
            profiles[id(item)] = y[at]
        else:
            tests[id(item)][c] = y[at]
    return replace(plan, tests=tuple(replace(t, values=tests[id(t)]) for t in plan.tests),
                   profiles=tuple(replace(p, value=profiles[id(p)]) for p in plan.profiles))  # fmt: skip


def whole(library: Library, cases: Cases, rows: Sequence[int], seed: int) -> tuple[list, float]:
    """Complete diagnoses of some cases, each with its own noise, null, pairs and held-out check; CPU s a case."""
    began, out = time.process_time(), []
    for i in rows:
        own = replace(library, plan=with_values(library.plan, cases.Y[i]))
        out.append(diagnosis.diagnose(own, seed))
    return out, (time.process_time() - began) / max(len(rows), 1)


def next_tests(evidence: Evidence, result: Scored, rows: Sequence[int], seed: int) -> dict[str, np.ndarray]:
    """Whether the proposed test, or a random one, leaves the right cause alone with 0.95 of the probability.

    Tests: those of the product that the tables can predict or that show one knob of the chain, and, at random only,
    once more one of the plan.  A rival predicts a new test from its posterior; the truth answers with noise.
    """
    rng = np.random.default_rng(seed)
    library, bench, cases = evidence.bench.library, evidence.bench, result.cases
    out: dict[str, list[bool]] = {"proposed": [], "random": []}
    for i in rows:
        known = {e.name: e for e in evidence.effects if e.family != "scatter"}
        names = [n for n in result.judged[i].named if n in known]
        truth = cases.effects[i][0]
        if len(names) < 2 or truth.name not in names:
            continue
        y = cases.Y[i]
        posts = {}
        for n in names:
            h = evidence.best((known[n],), y, loose=True)
            posts[n] = ((known[n],), posterior(h, h.white(y), 400, rng))
        found = next_test.next_tests(library, bench, posts, None)
        p = by_key(result.contests[i], result.contests[i].probability)
        prior = np.array([p.get((known[n].source,), 0.0) for n in names])
        pool: list = [(t.test, e) for t, e in ((t, dict(next_test._candidates(library)).get(t.test)) for t in found)]
        again = [("again", [e]) for e in library.plan.experiments if e.measurement.kind == "force"]
        for how, (words, experiments) in (
            ("proposed", pool[0]), ("random", [*pool, *again][rng.integers(len(pool) + len(again))]),
        ):  # fmt: skip
            if experiments is None:
                logs = _answer_direct(words, found, posts, cases, i, bench, rng)
            else:
                logs = _answer(library, experiments, bench, posts, cases, i, rng)
            s = np.log(np.maximum(prior, 1e-12)) + logs
            q = np.exp(s - np.logaddexp.reduce(s))
            right = sum(v for v, n in zip(q, names, strict=True) if known[n].source == truth.source)
            out[how].append(bool(right >= 0.95))
    return {k: np.array(v) for k, v in out.items()}


def _answer(library: Library, experiments, bench: Bench, posts, cases: Cases, i: int, rng) -> np.ndarray:
    """Log density of a new test's data under every rival, data of the true effect."""
    plan = diagnosis.make_plan(experiments)
    settings = plan.places[0].settings
    place = next((k for k, p in enumerate(library.plan.places) if p.settings == settings), library.primary)
    tests = tuple(replace(t, place=place) for t in plan.tests)
    there = replace(library, plan=replace(library.plan, experiments=plan.experiments, tests=tests, profiles=()))
    A, _ = predict(there, cases.effects[i], cases.at[i][None], bench.modulus)
    f = cases.modulus[i] * A[0]
    some = bench.levels.get("Fz", next(iter(bench.levels.values())))
    C = noise.covariance(there, {c: bench.levels.get(c, some) for c in noise.FORCES}, f, noise.slope_of(there, f))
    y = f + cholesky(C, lower=True) @ rng.standard_normal(len(f))
    logs = []
    for effects, post in posts.values():
        pick = np.linspace(0, len(post.modulus) - 1, next_test.DRAWS).astype(int)
        F = post.modulus[pick, None] * predict(there, effects, post.at[pick], bench.modulus)[0]
        S = C + np.cov(F.T)
        r = y - F.mean(axis=0)
        logs.append(-0.5 * (r @ np.linalg.solve(S, r) + np.linalg.slogdet(S)[1]))
    return np.array(logs)


def _answer_direct(words: str, found, posts, cases: Cases, i: int, bench: Bench, rng) -> np.ndarray:
    """The same for a test of one knob of the chain: its size as that test reads it."""
    distance = next(t.distance for t in found if t.test == words)
    d = len(bench.library.base.axes)
    asked = [n for n in posts if next_test.DIRECT.get(n) == words]
    spread = {n: float(np.std(posts[n][1].at[:, d])) for n in asked}
    mean = {n: float(np.mean(posts[n][1].at[:, d])) for n in asked}
    logs = np.zeros(len(posts))
    for n in asked:
        resolution = np.sqrt(max((mean[n] / max(distance, 1e-6)) ** 2 - spread[n] ** 2, (0.02 * mean[n]) ** 2))
        true = cases.size(i, d) if cases.effects[i][0].name == n else 0.0
        z = true + resolution * rng.standard_normal()
        for k, m in enumerate(posts):
            v = resolution**2 + (spread[n] ** 2 if m == n else 0.0)
            logs[k] += -0.5 * (z - (mean[n] if m == n else 0.0)) ** 2 / v - 0.5 * np.log(v)
    return logs
