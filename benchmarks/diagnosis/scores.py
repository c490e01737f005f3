"""Figures of merit of contests whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from cases import NULL, PAIRS, Cases, Table
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import beta

from rso.discrepancy.diagnosis import CREDIBLE_LEVEL
from rso.discrepancy.evidence.attribution import Comparison, Evidence
from rso.discrepancy.evidence.gaussian_mixture import Ready, log_tiles, mean_prediction, posterior
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, VerdictRules
from rso.discrepancy.evidence.verdict import Judgement, judge_comparison
from rso.discrepancy.library.effects import Effect

DRAWS = 400
STRONG = 6.0  # of BIC: strong evidence (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773, section 3.2)
Key = tuple[str, ...]
UNEXPLAINED = ("unexplained",)


def keys(h: Hypothesis) -> Key:
    """Sources of a hypothesis, () for the base model."""
    return tuple(sorted({e.source for e in h.effects})) or (UNEXPLAINED if h.unexplained else ())


def by_key(contest: Comparison, weights: np.ndarray) -> dict[Key, float]:
    """Sum of weights (hypotheses,) by their sources."""
    out: dict[Key, float] = {}
    for h, p in zip(contest.hypotheses, weights, strict=True):
        out[keys(h)] = out.get(keys(h), 0.0) + float(p)
    return out


def interval(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Clopper–Pearson interval of a share k / n."""
    a = (1 - level) / 2
    low = 0.0 if k == 0 else float(beta.ppf(a, k, n - k + 1))
    return low, 1.0 if k == n else float(beta.ppf(1 - a, k + 1, n - k))


def share(hits: Sequence[bool]) -> str:
    """A share with its interval, as text."""
    if not len(hits):
        return "–"
    low, high = interval(int(np.sum(hits)), len(hits))
    return f"{np.mean(hits):.3f} ({low:.3f}–{high:.3f}, n {len(hits)})"


class Scored:
    """Contests, their judgement and what is right about it: arrays over the cases (B,)."""

    def __init__(
        self,
        cases: Cases,
        contests: Sequence[Comparison],
        threshold: float,
        classes: Mapping[str, frozenset[str]],
        first: Sequence[Comparison] | None = None,
        rules: VerdictRules = DIAGNOSIS_SETTINGS.rules,
    ) -> None:
        first = contests if first is None else first
        self.cases, self.contests, self.threshold = cases, contests, threshold
        B = range(len(contests))
        self.truth = [cases.truth(i) for i in B]
        self.found = np.array([c.statistic > threshold for c in first])
        self.judged: list[Judgement] = [
            judge_comparison(c, bool(g), rules) for c, g in zip(contests, self.found, strict=True)
        ]
        source = {e.name.removesuffix("_twin"): e.source for c in contests[:1] for h in c.hypotheses for e in h.effects}
        self.named = [{source[n.removesuffix("_twin")] for n in j.named} for j in self.judged]
        self.probability = [by_key(c, c.probability) for c in contests]
        self.prior = [by_key(c, np.exp(c.log_prior - logsumexp(c.log_prior))) for c in contests]
        causes = [{k: v for k, v in p.items() if k and k != UNEXPLAINED} for p in self.probability]
        best = [max(p, key=lambda k: p[k]) for p in causes]
        self.null = np.array([not t for t in self.truth])
        self.single = np.array([len(t) == 1 for t in self.truth])
        self.top = np.array([b == t for b, t in zip(best, self.truth, strict=True)])
        self.in_set = np.array([set(t) <= n for t, n in zip(self.truth, self.named, strict=True)])
        self.sizes = np.array([len(n) for n in self.named])
        wide = [classes.get(t[0], frozenset(t)) if len(t) == 1 else frozenset(t) for t in self.truth]
        self.class_top = np.array(
            [(len(b) == 1 and b[0] in w) or b == t for b, w, t in zip(best, wide, self.truth, strict=True)]
        )
        self.class_set = self.in_set | np.array([bool(n & w) for n, w in zip(self.named, wide, strict=True)])
        self.verdict = np.array([j.verdict for j in self.judged])
        self.sure = np.isin(self.verdict, ("explained", "measurement"))
        within = [bool(n) and n <= set(t) for n, t in zip(self.named, self.truth, strict=True)]
        self.wrong = self.sure & ~np.array(within)
        of = np.array([p.get(t, 0.0) for p, t in zip(self.probability, self.truth, strict=True)])
        own = np.array([p.get(t, 0.0) for p, t in zip(self.prior, self.truth, strict=True)])
        self.log_score, self.log_prior = np.log(np.maximum(of, 1e-9)), np.log(np.maximum(own, 1e-9))
        self.right = np.array(
            [p.get(t, 0.0) / max(1.0 - p[()], 1e-300) for p, t in zip(self.probability, self.truth, strict=True)]
        )


def slope(scored: Scored, rows: np.ndarray, given: bool) -> float:
    """Slope of outcome on logit P over all sources of some cases; `given` there is one cause.

    Otherwise no gap and single causes are weighted as frequent as they are among the cases.
    """
    logit, hit = [], []
    for i in np.nonzero(rows)[0]:
        p = scored.probability[i]
        if given:
            p = {k: v for k, v in p.items() if len(k) == 1 and k != UNEXPLAINED}
        else:
            often = (
                NULL / DIAGNOSIS_SETTINGS.priors.no_gap,
                (1 - NULL - PAIRS) / DIAGNOSIS_SETTINGS.priors.of("single"),
            )
            p = {k: v * often[len(k)] for k, v in p.items() if len(k) < 2 and k != UNEXPLAINED}
        total = sum(p.values())
        for k, v in p.items():
            q = np.clip(v / total, 1e-6, 1 - 1e-6)
            logit.append(np.log(q / (1 - q)))
            hit.append(k == scored.truth[i])
    return logistic(np.array(logit), np.array(hit, float))[1]


def logistic(x: np.ndarray, hit: np.ndarray, ridge: float = 0.0) -> np.ndarray:
    """(intercept, slope) of P(hit) = 1 / (1 + exp(−a − b x))."""

    def loss(w: np.ndarray) -> float:
        z = w[0] + w[1] * x
        return float(np.mean(np.logaddexp(0, z) - hit * z)) + ridge * float(w[1] ** 2)

    return minimize(loss, np.array([0.0, 1.0]), method="Nelder-Mead", options={"maxiter": 400}).x


def limit(size: np.ndarray, found: np.ndarray) -> float:
    """|Size| found with 50 % power, by logistic regression on its logarithm; NaN outside the sizes tried."""
    x = np.log(np.abs(size))
    a, b = logistic(x - x.mean(), found.astype(float), 1e-3)
    at = x.mean() - a / b if b > 0.05 else np.inf
    if x.min() <= at <= x.max():
        return float(np.exp(at))
    return float("nan") if found.mean() < 0.5 else float(np.exp(x.min()))


def value_of(e: Effect, s: np.ndarray, modulus: np.ndarray, reference: float) -> np.ndarray:
    """Values of the size knob at coordinates s, in its unit, as the verdict states them."""
    return e.size.value(s) * (modulus / (1.0 if e.family == "model" else reference)) ** e.size.exponent


def covered(
    evidence: Evidence, scored: Scored, rows: Sequence[int], effects: Sequence[Sequence[Effect]], loose: bool, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """(hit, low side) of the LEVEL interval of the size under one effect each; a wrong cause does not cover."""
    rng = np.random.default_rng(seed)
    d, hit, below = len(evidence.bench.library.base.axes), [], []
    for i, own in zip(rows, effects, strict=True):
        truth, y = scored.cases.effects[i][0], scored.cases.Y[i]
        if len(own) != 1 or own[0].size.name != truth.size.name or own[0].name != truth.name:
            hit.append(False)
            below.append(False)
            continue
        h = evidence.best(own, y, loose=loose)
        post = posterior(h, h.white(y), DRAWS, rng)
        v = value_of(own[0], post.at[:, d], post.modulus, evidence.bench.modulus)
        low, high = np.quantile(v, [(1 - CREDIBLE_LEVEL) / 2, (1 + CREDIBLE_LEVEL) / 2])
        s = np.float64(scored.cases.size(i, d))
        true = float(value_of(truth, s, scored.cases.modulus[i], evidence.bench.modulus))
        hit.append(bool(low <= true <= high))
        below.append(bool(true < low))
    return np.array(hit, bool), np.array(below, bool)


def oracle(table: Table, cases: Cases) -> np.ndarray:
    """Whether the truth is more likely than the closest imitation by any other hypothesis, all parameters known (B,).

    A rival has the parameters with which it comes nearest to the noise-free mean, at no cost, so that only noise
    confuses.  Priors and Occam's factor can do better than this where a rival must be tuned to imitate.
    """
    evidence, B = table.evidence, len(cases.Y)
    white = evidence.bench.whites[0]
    M, Y = white(cases.mean), white(cases.Y)
    own = -0.5 * np.sum((Y - M) ** 2, axis=1)
    best = np.full(B, -np.inf)
    for effects in [(), *((e,) for e in evidence.effects if e.family != "scatter")]:
        h = evidence.ready(effects)
        Z, Zm = Y @ h.Q, M @ h.Q
        for part in np.array_split(np.arange(B), max(1, -(-B // 200))):
            t = np.argmax(log_tiles(h, M[part]), axis=1)
            b = np.einsum("bkq,bq->bk", h.X[t], Zm[part] - h.c[t])
            fit = np.einsum("bk,bkq->bq", np.einsum("bkl,bl->bk", h.S_inverse[t], b), h.X[t]) + h.c[t]
            like = -0.5 * (np.sum(Y[part] ** 2, axis=1) - 2 * np.sum(Z[part] * fit, axis=1) + np.sum(fit**2, axis=1))
            mine = np.array([bool(effects) and effects[0].source in cases.truth(i) for i in part])
            best[part] = np.where(mine, best[part], np.maximum(best[part], like))
    return own > best


@dataclass(frozen=True, eq=False)
class Rival:
    """What generalised least squares with BIC say of each data set: a gap, the best cause, all causes within STRONG."""

    gap: np.ndarray
    best: tuple[str, ...]
    named: tuple[frozenset[str], ...]

    def figures(self, cases: Cases) -> list[str]:
        """False alarms; detected; of those found with one cause: on top, in the named set, its size, wrong and sure."""
        truth = [cases.truth(i) for i in range(len(self.gap))]
        null, single = np.array([not t for t in truth]), np.array([len(t) == 1 for t in truth])
        hit = np.nonzero(self.gap & single)[0]
        wrong = [len(self.named[i]) == 1 and self.named[i] != frozenset(truth[i]) for i in hit]
        return [
            share(self.gap[null]),
            f"{np.mean(self.gap[~null]):.3f}",
            f"{np.mean([self.best[i] == truth[i][0] for i in hit]):.3f}",
            f"{np.mean([truth[i][0] in self.named[i] for i in hit]):.3f}",
            f"{np.mean([len(self.named[i]) for i in hit]):.2f}",
            f"{np.mean(wrong):.3f}",
        ]


def rival(table: Table, cases: Cases) -> Rival:
    """Generalised least squares with the same covariance: the best size of every effect, judged by BIC.

    BIC = −2 ln L + k ln n, with k parameters and n readings; the free gap competes with every size it may have.  What
    is within STRONG of the best is named, unless the free gap or the base model is the best.
    """
    evidence, B, n = table.evidence, len(cases.Y), cases.Y.shape[1]
    base = 1 + len(evidence.bench.library.base.axes)
    sources = sorted({e.source for e in evidence.effects if e.family != "scatter"})
    bic = np.full((len(sources) + 2, B), np.inf)
    bic[0] = _deviance(evidence.ready(()), cases.Y) + base * np.log(n)
    for e in evidence.effects:
        if e.family != "scatter":
            k = 2 + sources.index(e.source)
            own = _deviance(evidence.ready((e,)), cases.Y) + (base + len(e.knobs)) * np.log(n)
            bic[k] = np.minimum(bic[k], own)
    for level in range(1, len(evidence.bench.whites)):
        bic[1] = np.minimum(bic[1], _deviance(evidence.ready((), level), cases.Y) + (base + 1) * np.log(n))
    first, least = np.argmin(bic, axis=0), bic.min(axis=0)
    near = bic <= least + STRONG
    named = [
        frozenset(s for s, q in zip(sources, near[2:, i], strict=True) if q)
        if first[i] > 1 and not near[1, i]
        else frozenset()
        for i in range(B)
    ]
    return Rival(first > 0, tuple(["", "", *sources][f] for f in first), tuple(named))


def _deviance(h: Ready, Y: np.ndarray) -> np.ndarray:
    """−2 ln L (B,) at the most likely parameters of any tile, without what all hypotheses share."""
    Yw = h.white(Y)
    Z, least = Yw @ h.Q, np.full(len(Y), np.inf)
    for part in np.array_split(np.arange(len(Y)), max(1, -(-len(Y) // 200))):
        t = np.argmax(log_tiles(h, Yw[part]), axis=1)
        b = np.einsum("bkq,bq->bk", h.X[t], Z[part] - h.c[t])
        fit = np.einsum("bk,bkq->bq", np.einsum("bkl,bl->bk", h.S_inverse[t], b), h.X[t]) + h.c[t]
        least[part] = np.sum(Yw[part] ** 2, axis=1) - 2 * np.sum(Z[part] * fit, axis=1) + np.sum(fit**2, axis=1)
    return least + h.white.log_det


def baselines(table: Table, cases: Cases) -> dict[str, np.ndarray]:
    """Whether simpler rules put the right cause on top, over cases with one cause that is not scatter."""
    evidence = table.evidence
    base, white = evidence.ready(()), evidence.bench.whites[0]
    d = len(evidence.bench.library.base.axes)
    effects = [e for e in evidence.effects if e.family != "scatter"]
    Yw = white(cases.Y)
    tiles = np.argmax(log_tiles(base, Yw), axis=1)
    points = 1.0 / np.sqrt(np.diag(evidence.bench.C))
    rules = ("nearest signature, no re-fit", "largest raw correlation", "AIC on points")
    best = {r: np.full((len(effects), len(Yw)), -np.inf) for r in rules}
    for t in np.unique(tiles):
        rows = np.nonzero(tiles == t)[0]
        fit = np.array([mean_prediction(base, y) for y in Yw[rows]])
        r = Yw[rows] - fit
        raw = r @ white.L.T
        J = (base.X[t] @ base.Q.T) @ white.L.T * points
        for k, e in enumerate(effects):
            h = evidence.ready((e,))
            near = np.nonzero(np.all(np.abs(h.tiles.at[:, :d] - base.tiles.at[t]) < 1e-9, axis=1))[0]
            change = (h.X[near, 0] + h.c[near]) @ h.Q.T - (base.X[t, 0] + base.c[t]) @ base.Q.T
            plain = change @ white.L.T
            best[rules[0]][k, rows] = _best(r, change)
            best[rules[1]][k, rows] = _cosine(raw, plain)
            best[rules[2]][k, rows] = _best(_off(raw * points, J), _off(plain * points, J)) - 2 * len(e.knobs)
    out = {}
    for rule, s in best.items():
        top = np.argmax(s, axis=0)
        out[rule] = np.array([(effects[b].source,) == cases.truth(i) for i, b in enumerate(top)])
    return out


def _off(v: np.ndarray, J: np.ndarray) -> np.ndarray:
    return v - (v @ J.T) @ np.linalg.solve(J @ J.T + 1e-12 * np.trace(J @ J.T) * np.eye(len(J)), J)


def _best(residual: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Largest decrease (B,) of the sum of squares by one of the changes (T, n), as it is."""
    return np.max(2 * residual @ change.T - np.sum(change**2, axis=1), axis=1)


def _cosine(residual: np.ndarray, change: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(residual, axis=1)[:, None] * np.linalg.norm(change, axis=1)
    return np.max(np.abs(residual @ change.T) / np.maximum(size, 1e-300), axis=1)
