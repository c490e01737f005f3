"""How well a diagnosis is calibrated for the test plan of a study, on cases simulated by its library.

    python benchmarks/diagnosis.py STUDY [--cases 1200]

Draws hypotheses from the prior, sizes from their plausible ranges, data from the noise of the plan, and sends each
through the contest.  Printed: false alarms, detection, cause on top, named set, calibration slope, log score, beside
simple baselines and ablations.  The cases share library and noise with the diagnosis: this checks the inference, not
the model of the world (for that see benchmarks/blind).  Needs the runs of `rso diagnose STUDY` in its store.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from rso import diagnosis
from rso.diagnosis import attribute
from rso.diagnosis.attribute import Evidence
from rso.diagnosis.judge import judge, seen
from rso.diagnosis.mixture import Ready
from rso.running import WorkerPool, run_all
from rso.store import RunStore
from rso.study import load
from rso.study.diagnosing import ask
from rso.study.plan import source_of


def draw(h: Ready, centre: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Unwhitened mean (n,) of a case of hypothesis h near the base coordinates, and its size coordinate."""
    d = len(centre)
    near = np.nonzero(np.all(np.abs(h.tiles.at[:, :d] - centre) < 1e-9, axis=1))[0]
    t = rng.choice(near)
    local = np.concatenate([[1.0], np.sqrt(3.0) * h.tiles.sd * rng.uniform(-1, 1, len(h.tiles.sd))])
    mean = h.white.L @ (local @ h.X[t] + h.c[t])
    size = h.tiles.at[t, d] if h.tiles.at.shape[1] > d else np.nan
    for j, (axis, log) in enumerate(zip(h.tiles.axes, h.tiles.log, strict=True)):
        if axis == d:
            size = size * np.exp(local[1 + j]) if log else size + local[1 + j]
    return mean, float(size)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--cases", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    study = load(options.study)
    asked = ask(study)
    with RunStore(study.folder / "results") as store, WorkerPool(2, source=source_of(study)) as pool:
        library = diagnosis.build(asked.base, asked.plan, asked.effects,
                                  lambda tasks: run_all(asked.base.backend, tasks, store, pool))  # fmt: skip
    library = replace(library, plan=seen(library.plan))
    y = library.plan.values()
    evidence = Evidence(attribute.set_up(library, y), library.effects)
    rng = np.random.default_rng(options.seed)
    cases, truths = simulate(evidence, y, options.cases, rng)
    null = np.array([c.statistic for c in attribute.contests(evidence, attribute.nulls(evidence, y, 400, 1))])
    threshold = float(np.quantile(null, 1 - attribute.FALSE_ALARM))
    began = time.process_time()
    contests = attribute.contests(evidence, cases)
    print(f"{len(cases)} cases of {len(evidence.effects)} effects, {time.process_time() - began:.0f} s CPU")
    table(evidence, contests, truths, threshold)
    calibration(contests, truths)
    baselines(evidence, cases, truths, y)


def simulate(evidence: Evidence, y: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, list[str]]:
    """Cases (count, n), and the source of each ('none' for half of them)."""
    base = evidence.ready(())
    centre = base.tiles.at[int(np.argmax(diagnosis_weights(base, y)))]
    effects = [e for e in evidence.effects if e.family != "scatter"]
    L, out, truths = base.white.L, [], []
    for _ in range(count):
        if rng.random() < 0.3:
            mean, name = draw(base, centre, rng)[0], "none"
        else:
            e = effects[rng.integers(len(effects))]
            mean, name = draw(evidence.ready((e,)), centre, rng)[0], e.source
        out.append(mean + L @ rng.standard_normal(len(y)))
        truths.append(name)
    return np.array(out), truths


def diagnosis_weights(h: Ready, y: np.ndarray) -> np.ndarray:
    """Log weight (T,) of the tiles of a hypothesis given data."""
    from rso.diagnosis.mixture import log_tiles

    return log_tiles(h, h.white(y)[None])[0]


def by_source(contest: attribute.Contest) -> dict[str, float]:
    """Probability by source; 'none' and 'unexplained' among them."""
    out: dict[str, float] = {}
    for h, p in zip(contest.hypotheses, contest.probability, strict=True):
        key = h.effects[0].source if h.effects else ("unexplained" if h.unexplained else "none")
        out[key] = out.get(key, 0.0) + float(p)
    return out


def table(evidence: Evidence, contests, truths: list[str], threshold: float) -> None:
    """False alarms, detection, cause on top, named set: all, and by effect."""
    source = {e.name: e.source for e in evidence.effects}
    rows: dict[str, list[tuple[bool, bool, bool, int]]] = {}
    for c, truth in zip(contests, truths, strict=True):
        gap = c.statistic > threshold
        names = {source[n] for n in judge(c, gap).named}
        p = {k: v for k, v in by_source(c).items() if k not in ("none", "unexplained")}
        rows.setdefault(truth, []).append((gap, gap and max(p, key=p.get) == truth, truth in names, len(names)))
    found = [r for t, v in rows.items() if t != "none" for r in v if r[0]]
    alarms = [r[0] for r in rows.get("none", [])]
    print(f"false alarms {np.mean(alarms) if alarms else np.nan:.3f} (nominal {attribute.FALSE_ALARM})")
    print(f"of those found: cause on top {np.mean([r[1] for r in found]):.3f}, in the named set "
          f"{np.mean([r[2] for r in found]):.3f}, mean set size {np.mean([r[3] for r in found]):.2f}")  # fmt: skip
    print(f"{'effect':18} {'n':>4} {'found':>6} {'on top':>7} {'in set':>7}")
    for t, v in sorted(rows.items()):
        hit = [r for r in v if r[0]]
        share = [np.mean([r[i] for r in hit]) if hit else np.nan for i in (1, 2)]
        print(f"{t:18} {len(v):4d} {np.mean([r[0] for r in v]):6.2f} {share[0]:7.2f} {share[1]:7.2f}")


def calibration(contests, truths: list[str]) -> None:
    """Slope of the outcome on logit P (1 is calibrated), and the mean log score beside the prior's."""
    logit, hit, score, prior = [], [], [], []
    for c, truth in zip(contests, truths, strict=True):
        p = by_source(c)
        first = {k: 0.0 for k in p}
        for h, v in zip(c.hypotheses, np.exp(c.log_prior - logsumexp(c.log_prior)), strict=True):
            key = h.effects[0].source if h.effects else ("unexplained" if h.unexplained else "none")
            first[key] += float(v)
        score.append(np.log(max(p.get(truth, 0.0), 1e-9)))
        prior.append(np.log(max(first.get(truth, 0.0), 1e-9)))
        for k, v in p.items():
            q = np.clip(v, 1e-6, 1 - 1e-6)
            logit.append(np.log(q / (1 - q)))
            hit.append(k == truth)
    x, t = np.array(logit), np.array(hit, float)

    def loss(w: np.ndarray) -> float:
        z = w[0] + w[1] * x
        return float(np.mean(np.logaddexp(0, z) - t * z))

    slope = minimize(loss, np.array([0.0, 1.0]), method="Nelder-Mead").x[1]
    print(f"calibration slope {slope:.2f}; mean log score {np.mean(score):.2f} (prior alone {np.mean(prior):.2f})")


def baselines(evidence: Evidence, cases: np.ndarray, truths: list[str], y: np.ndarray) -> None:
    """Cause on top by simpler rules, over all cases that have one."""
    has = [i for i, t in enumerate(truths) if t != "none"]
    Y, names = cases[has], [truths[i] for i in has]
    base = evidence.ready(())
    white = base.white
    t = int(np.argmax(diagnosis_weights(base, y)))
    J = base.X[t]
    residual = white(Y) - base.c[t]
    raw = Y - white.L @ (J[0] + base.c[t])
    effects = [e for e in evidence.effects if e.family != "scatter"]
    scores: dict[str, list[np.ndarray]] = {"full": [], "AIC on points": [], "raw residual": [], "no re-fit": []}
    points = 1.0 / np.sqrt(np.diag(evidence.bench.C))
    for e in effects:
        h = evidence.ready((e,))
        same = np.abs(h.tiles.at[:, : base.tiles.at.shape[1]] - base.tiles.at[t]) < 1e-9
        near = np.nonzero(np.all(same, axis=1))[0]
        change = (h.X[near, 0] + h.c[near]) - (J[0] + base.c[t])
        scores["full"].append(evidence.of((e,), Y))
        scores["no re-fit"].append(_best(residual - J[0], change))
        plain = (white.L @ change.T).T
        scores["raw residual"].append(_cosine(raw, plain))
        scores["AIC on points"].append(_best(_off(raw * points, (white.L @ J.T).T * points),
                                             _off(plain * points, (white.L @ J.T).T * points)))  # fmt: skip
    print("cause on top among cases with one, whether found or not:")
    for rule, s in scores.items():
        best = np.argmax(np.array(s), axis=0)
        print(f"  {rule:16} {np.mean([effects[b].source == n for b, n in zip(best, names, strict=True)]):.3f}")
    print(f"  {'prior only':16} {1 / len({e.source for e in effects}):.3f}")


def _off(v: np.ndarray, J: np.ndarray) -> np.ndarray:
    return v - (v @ J.T) @ np.linalg.solve(J @ J.T, J)


def _best(residual: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Largest decrease (B,) of the sum of squares by one of the changes (T, n), as it is."""
    return np.max(2 * residual @ change.T - np.sum(change**2, axis=1), axis=1)


def _cosine(residual: np.ndarray, change: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(residual, axis=1)[:, None] * np.linalg.norm(change, axis=1)
    return np.max(np.abs(residual @ change.T) / np.maximum(size, 1e-300), axis=1)


if __name__ == "__main__":
    main()
