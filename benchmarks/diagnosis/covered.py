"""How often the interval of the modulus holds the truth, and how wide it is: before and after what is unseen counts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from cases import Cases, Table, contested, draw_cases, fitted
from scipy.linalg import cholesky
from scores import share
from sections import Say
from sections import table as table_of

from rso.discrepancy.diagnosis import CREDIBLE_LEVEL, CREDIBLE_QUANTILES
from rso.discrepancy.evidence import attribution, noise
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.gaussian_mixture import posterior
from rso.discrepancy.evidence.marginal_ranges import draws, reach
from rso.discrepancy.evidence.verdict import judge_comparison
from rso.discrepancy.library.prediction import predict

DRAWS = 1000
# Planted beside what is drawn from the priors: knobs with their values, left out where there is none.
PLANTED = {
    "gain 0.9": {"gain": 0.9},
    "gain 1.03": {"gain": 1.03},
    "compliance 0.44 mm/N": {"compliance": 0.44},
    "contact 0.1 mm late": {"offset": 0.1},
    "contact 0.05 mm early": {"offset": -0.05},
    "skin half as stiff": {"skin_ratio": 0.5},
    "relaxation and friction": {"prony_g": 0.3, "friction": 0.2},
}


def planted(evidence: Evidence, force: np.ndarray, values: dict[str, float], count: int, seed: int) -> Cases | None:
    """Cases of some knobs at these values, shapes drawn from their priors; None where the catalogue lacks one."""
    bench, rng = evidence.bench, np.random.default_rng(seed)
    known = {e.name: e for e in evidence.effects}
    if not set(values) <= set(known):
        return None
    effects = tuple(known[n] for n in values)
    columns = [rng.uniform(*a.ends, count) for a in bench.library.base.axes]
    for e, v in zip(effects, values.values(), strict=True):
        neutral = e.size.neutral or 0.0
        columns += [np.full(count, np.log(v / neutral) if e.size.ratio else v - neutral)]
        columns += [rng.uniform(*s.ends()[0], count) for s in e.shape]
    X = np.array(columns).reshape(len(columns), count).T
    A, c = predict(bench.library, effects, X, bench.modulus)
    modulus = (A @ force) / np.sum(A**2, axis=1) * np.exp(0.05 * rng.standard_normal(count))
    mean = modulus[:, None] * A + c
    Y = mean + rng.standard_normal(mean.shape) @ cholesky(bench.C, lower=True).T
    return Cases(Y, mean, (effects,) * count, tuple(X), modulus)


def with_code(evidence: Evidence, cases: Cases, seed: int) -> Cases:
    """The cases as another program would have them: each off by its own draw of what programs differ by."""
    rng = np.random.default_rng(seed)
    off = []
    for mean in cases.mean:
        K = noise.other_code(evidence.bench.library.plan, mean)
        λ, Q = np.linalg.eigh(K)
        off.append(Q @ (np.sqrt(np.maximum(λ, 0.0)) * rng.standard_normal(len(λ))))
    return cases.picked(range(len(cases.Y)), cases.Y + np.array(off))


def intervals(evidence: Evidence, cases: Cases, threshold: float, seed: int) -> tuple[np.ndarray, list[str]]:
    """ln of the ends of the modulus over the truth (B, 3, 2): of what is said as it was, of that where another program
    counts, over all that the data allow; and the verdicts of the contest."""
    library, table = evidence.bench.library, Table(evidence, cases.Y)
    first = attribution.comparisons(table, np.arange(len(cases.Y)))
    rows = [i for i, c in enumerate(first) if c.statistic > threshold]
    last = dict(enumerate(first)) | dict(zip(rows, contested(table, rows, first), strict=True))
    out, verdicts = [], []
    for i, y in enumerate(cases.Y):
        judged = judge_comparison(last[i], i in rows)
        h = evidence.best(judged.chosen.effects, y, judged.chosen.unexplained, loose=bool(judged.chosen.effects))
        post = posterior(h, h.white(y), DRAWS, np.random.default_rng(seed + i))
        was = np.quantile(draws(library, post)[library.base.modulus], [CREDIBLE_QUANTILES[0], CREDIBLE_QUANTILES[-1]])
        r = reach(evidence, last[i], judged.chosen, y, CREDIBLE_LEVEL, seed + i)[library.base.modulus]
        out.append(np.log(np.array([was, r.alone[::2], r.whole[::2]]) / cases.modulus[i]))
        verdicts.append(judged.verdict)
    return np.array(out), verdicts


def row(name: str, ends: np.ndarray, verdicts: Sequence[str]) -> list[object]:
    """A row of the table: cases, those without a gap, then coverage and mean half-width in % of each interval."""
    held = (ends[:, :, 0] <= 0.0) & (ends[:, :, 1] >= 0.0)
    half = 50.0 * (ends[:, :, 1] - ends[:, :, 0]).mean(axis=0)
    return [
        name,
        len(ends),
        verdicts.count("no_gap"),
        *(v for k in range(3) for v in (share(held[:, k]), f"{half[k]:.1f}")),
    ]


HEAD = [
    "truth",
    "cases",
    "no gap",
    "held by what was said",
    "± %",
    "and another program counts",
    "± %",
    "held by all that data allow",
    "± %",
]


def coverage(evidence: Evidence, y: np.ndarray, force: np.ndarray, threshold: float, count: int, seed: int):
    """Rows of the table: cases of the priors by number of causes, then what is planted, `count` and a tenth of it."""
    drawn = with_code(evidence, draw_cases(evidence.bench, y, count, seed), seed + 1)
    ends, verdicts = intervals(evidence, drawn, threshold, seed + 2)
    causes = np.array([len(e) for e in drawn.effects])
    of = {"nothing": causes == 0, "one cause": causes == 1, "two causes": causes == 2, "all of these": causes >= 0}
    for name, m in of.items():
        if m.any():
            yield row(name, ends[m], [v for v, k in zip(verdicts, m, strict=True) if k])
    for k, (name, values) in enumerate(PLANTED.items()):
        found = planted(evidence, force, values, max(count // 10, 4), seed + 10 + k)
        if found is not None:
            yield row(name, *intervals(evidence, with_code(evidence, found, seed + 3), threshold, seed + 4))


def section(say: Say, evidence: Evidence, y: np.ndarray, threshold: float, seed: int, count: int = 150) -> None:
    """The table."""
    rows = list(coverage(evidence, y, fitted(evidence.bench, y), threshold, count, seed))
    say(
        [
            "## The interval of the modulus",
            "",
            "90 % intervals of cases that another program has made, so to say: each "
            "curve is off as programs differ.  *Held* with 95 % intervals, mean half-width in % of the modulus.",
            *table_of(HEAD, rows),
        ]
    )
