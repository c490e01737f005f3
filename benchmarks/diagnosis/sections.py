"""The sections of the report: each takes what was scored and says its part in Markdown."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import controls
import numpy as np
from cases import Cases, Table, contested
from scores import STRONG, Scored, baselines, covered, limit, oracle, rival, share, slope

from rso.discrepancy.evidence.attribution import Evidence, Shared
from rso.discrepancy.evidence.detectable import Detectable
from rso.evaluation import WorkerPool, run_all
from rso.evaluation.adapters import Source
from rso.evaluation.store import RunStore
from rso.optimal_design.separation import DECIDED_PROBABILITY

CONTROLS = 300  # cases of a control
ABLATED = 500  # cases of an ablation
Say = Callable[[Iterable[str]], None]


def figures(s: Scored) -> list[str]:
    """One row: false alarms, detection, then of those found with one cause: top, set, size, wrong and sure, score."""
    hit = s.found & s.single
    return [
        share(s.found[s.null]),
        f"{np.mean(s.found[~s.null]):.3f}",
        f"{np.mean(s.top[hit]):.3f}",
        f"{np.mean(s.class_top[hit]):.3f}",
        f"{np.mean(s.in_set[hit]):.3f}",
        f"{np.mean(s.class_set[hit]):.3f}",
        f"{np.mean(s.sizes[hit]):.2f}",
        f"{np.mean(s.wrong[hit]):.3f}",
        f"{np.mean(s.log_score[s.single | s.null]):.2f}",
        f"{slope(s, hit, True):.2f}",
    ]


TELLS = (("below 9", -np.inf, 9.0), ("9 to 25", 9.0, 25.0), ("25 to 100", 25.0, 100.0), ("100 and more", 100.0, np.inf))
HEAD = [
    "false alarms (95 %)",
    "detected",
    "cause on top",
    "or its class",
    "in named set",
    "or its class",
    "set size",
    "wrong and sure",
    "log score",
    "slope",
]


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> list[str]:
    """A Markdown table."""
    head = list(head)
    return [
        "",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
        *("| " + " | ".join(map(str, r)) + " |" for r in rows),
        "",
    ]


def by_effect(evidence: Evidence, s: Scored, before: Sequence[Detectable], seed: int) -> list[list[object]]:
    """Effect, cases, found, limit with 50 % power as announced and as met, found at 3 × limit, on top, in set,
    interval covers, what was named besides or instead."""
    announced = {d.effect.name: d.limit for d in before}
    d, out = len(evidence.bench.library.base.axes), []
    for e in evidence.effects:
        mine = np.array([i for i in range(len(s.truth)) if len(s.truth[i]) == 1 and s.cases.effects[i][0] is e], int)
        if not len(mine):
            continue
        size = np.array([abs(s.cases.size(i, d)) for i in mine])
        found = s.found[mine]
        at = limit(size, found) if e.size.neutral is not None and len(mine) > 7 else np.nan
        clear = mine[size >= 3 * at] if np.isfinite(at) else mine[:0]
        hit = mine[found]
        wrong: dict[str, int] = {}
        for i in hit[~s.top[hit]]:
            for n in s.judged[i].named or ("unexplained",):
                if n != e.name:
                    wrong[n] = wrong.get(n, 0) + 1
        rival = max(wrong, key=lambda n: wrong[n]) if wrong else "–"
        cover = "–"
        if e.family != "scatter" and len(hit):
            cover = f"{np.mean(covered(evidence, s, hit, [(e,)] * len(hit), True, seed)[0]):.2f}"
        mean = lambda v, r: f"{np.mean(v[r]):.2f}" if len(r) else "–"  # noqa: E731
        met = f"{'< ' * bool(found.all())}{at:.3g}" if np.isfinite(at) else "–"
        said = announced.get(e.name)
        out.append(
            [
                e.name,
                len(mine),
                f"{found.mean():.2f}",
                "–" if said is None else f"{said:.3g}",
                met,
                f"{np.mean(s.found[clear]):.2f} ({len(clear)})" if len(clear) else "–",
                mean(s.top, hit),
                mean(s.in_set, hit),
                cover,
                rival,
            ]
        )
    return out


def intervals(evidence: Evidence, s: Scored, seed: int) -> list[str]:
    """Coverage of the size under the true hypothesis and under the chosen one."""
    hit = [i for i in np.nonzero(s.found & s.single)[0] if s.cases.effects[i][0].family != "scatter"]
    own = [s.cases.effects[i] for i in hit]
    chosen = [s.judged[i].chosen.effects for i in hit]
    loose, below = covered(evidence, s, hit, own, True, seed)
    tight, _ = covered(evidence, s, hit, own, False, seed)
    alone, _ = covered(evidence, s, hit, chosen, True, seed)
    same = np.array([len(c) == 1 and c[0].name == o[0].name for c, o in zip(chosen, own, strict=True)])
    return [
        "",
        f"90 % interval of the size holds the truth: under the true cause {share(loose)}, truth below it "
        f"{np.mean(below):.3f}; without looseness {share(tight)}; under the chosen cause where that is right "
        f"{share(alone[same])}, over all found {np.mean(alone):.3f}.",
        "",
    ]


def inference(say: Say, s: Scored, evidence: Evidence, seed: int) -> None:
    """False alarms, detection, causes, sizes and probabilities of all cases."""
    say(["", "## Inference", *table(["variant", *HEAD], [["as it is", *figures(s)]])])
    both = s.single | s.null
    named = np.mean(one_of_two(s))
    say(
        [
            f"Mean log score of the prior alone {np.mean(s.log_prior[both]):.2f}; slope over all hypotheses, no gap "
            f"among them, at the frequencies of these cases {slope(s, both, False):.2f}.  Causes of pairs: found "
            f"{np.mean(s.found[~both]):.2f}, one of both named in {named:.2f} of those found.",
            *intervals(evidence, s, seed),
            *reliability(s),
        ]
    )


def each_effect(say: Say, evidence: Evidence, s: Scored, before: Sequence[Detectable], seed: int) -> None:
    """The table by effect."""
    head = [
        "effect",
        "cases",
        "found",
        "limit announced",
        "limit met",
        "found at 3 × limit",
        "on top",
        "in set",
        "interval covers",
        "most often instead",
    ]
    say(
        [
            "## By effect",
            "",
            "Limits are size coordinates: deviations from neutral, of ratios their logarithm.",
            *table(head, by_effect(evidence, s, before, seed)),
        ]
    )


def without(say: Say, bench: Shared, cases: Cases, y: np.ndarray, classes, seed: int) -> None:
    """Twice the noise, and the method without one of its parts, on the same cases."""
    few = cases.picked(range(0, len(cases.Y), max(1, len(cases.Y) // ABLATED)))
    evidence = Evidence(bench, bench.library.effects)
    variants = {
        "as it is": lambda: controls.scored(evidence, y, few, classes, seed),
        "noise doubled": lambda: controls.noisier(bench, y, few, classes, seed),
        **controls.ablations(bench, y, few, classes, seed),
    }
    rows = [[name, *figures(run())] for name, run in variants.items()]
    say(["## Without a part of it", "", f"{len(few.Y)} of the cases.", *table(["variant", *HEAD], rows)])


def one_of_two(s: Scored) -> list[bool]:
    """Of pairs found: whether one of both causes is named."""
    rows = np.nonzero(s.found & ~s.single & ~s.null)[0]
    return [bool(set(s.truth[i]) & s.named[i]) for i in rows]


def reliability(s: Scored) -> list[str]:
    """Right causes by stated probability of the cause on top, of those found."""
    hit = np.nonzero(s.found & s.single)[0]
    stated = np.array([max((v for k, v in s.probability[i].items() if len(k) == 1), default=0.0) for i in hit])
    edges = [0, 0.5, 0.7, 0.9, 0.99, 1.01]
    rows = []
    for a, b in itertools.pairwise(edges):
        m = (stated >= a) & (stated < b)
        if m.any():
            rows.append([f"{a:g}–{min(b, 1):g}", m.sum(), f"{stated[m].mean():.3f}", share(s.top[hit][m])])
    return table(["probability of the cause on top", "cases", "mean", "right"], rows)


def beside(say: Say, own: Table, s: Scored) -> None:
    """Simpler rules and the oracle on the same cases."""
    rows = [i for i in np.nonzero(s.single)[0] if s.cases.effects[i][0].family != "scatter"]
    part = s.cases.picked(rows)
    found, top = s.found[rows], s.top[rows]
    rules = {"this diagnosis": top, "closest imitations known (oracle)": oracle(own, part), **baselines(own, part)}
    prior = 1 / len({e.source for e in own.effects})
    say(
        [
            "## Beside simpler rules",
            "",
            "Cause on top, of cases with one cause that is not scatter.",
            *table(
                ["rule", "found", "all"],
                [
                    *([k, f"{v[found].mean():.3f}", f"{v.mean():.3f}"] for k, v in rules.items()),
                    ["prior only", f"{prior:.3f}", f"{prior:.3f}"],
                ],
            ),
            "The rival: generalised least squares with the same covariance, the best size of every effect, BIC, and "
            f"the free gap; what is within {STRONG:g} of the best is named.",
            *table(
                ["rule", "false alarms (95 %)", "detected", "on top", "in named set", "set size", "wrong and sure"],
                [
                    ["this diagnosis", *(figures(s)[k] for k in (0, 1, 2, 4, 6, 7))],
                    ["least squares and BIC", *rival(own, s.cases).figures(s.cases)],
                ],
            ),
        ]
    )


def checks(say: Say, bench: Shared, evidence: Evidence, own: Table, s: Scored, y, threshold: float, seed: int):
    """Residuals permuted, cause taken out, cause twice, data taken away."""
    clear = [i for i in np.nonzero(s.found & s.single)[0] if s.cases.effects[i][0].family != "scatter"]
    few = clear[:: max(1, len(clear) // CONTROLS)]

    def count(v: Iterable[str]) -> list[str]:
        v = np.array(list(v))
        kinds = ("no_gap", "unexplained", "partly", "ambiguous", ("explained", "measurement"))
        return [f"{np.mean(np.isin(v, k)):.3f}" if len(v) else "–" for k in kinds] + [str(len(v))]

    verdicts = ["no gap", "unexplained", "partly", "ambiguous", "one cause, sure", "cases"]
    out, blind, told, better, tells = controls.taken_out(own, s.cases, threshold, clear, seed)
    looked_at = [controls.looked_at(evidence, evidence.effects, s.judged[i], s.cases.Y[i], seed + i) for i in clear]
    rows = [
        ["as it is", *count(looked_at)],
        ["as it is, no look at what is left", *count(s.verdict[clear])],
        ["residuals permuted", *count(controls.permuted(evidence, s.cases.picked(few), threshold, seed))],
        ["true effect not in the catalogue", *count(v for o in out.values() for v in o)],
        ["true effect not in it, no look at what is left", *count(blind)],
        ["true effect twice in it", *count(controls.with_twin(own, s.cases, threshold, clear))],
    ]
    part_of = lambda v: f"{np.mean(v):.2f}" if len(v) else "–"  # noqa: E731
    say(
        [
            "## Controls",
            *table(["cases found, one cause", *verdicts], rows),
            f"Where one wrong cause is sure ({len(told)} cases), the true one, had it been there, would have been "
            f"less than 20 times as probable as all others together in {part_of(told < np.log(20))} of them: in these "
            f"the data do not tell.  With it χ² would be smaller by less than 9 in {part_of(better < 9)}, by less than "
            f"25 in {part_of(better < 25)}: what the named one leaves is hardly there.",
            "",
            "Not in the catalogue, by how much less χ² the true cause would leave than the best of the others: below "
            "some 25 among hundreds of readings nobody sees it who does not know it.",
            *table(
                ["less χ²", *verdicts],
                [[name, *count(v for v, less in tells if low <= less < high)] for name, low, high in TELLS],
            ),
            "Not in the catalogue, by source:",
            *table(["taken out", *verdicts], [[k, *count(v)] for k, v in out.items()]),
        ]
    )
    part = s.cases.picked([i for i in np.nonzero(s.single)[0] if s.cases.effects[i][0].family != "scatter"])
    away = controls.taken_away(bench, y, part)
    full = away["everything"][0]
    rows = [
        [k, n, f"{np.mean(p):.3f}", f"{np.mean(p - full):+.3f} ± {2 * np.std(p - full) / np.sqrt(len(p)):.3f}"]
        for k, (p, n) in away.items()
    ]
    say(
        [
            "Probability of the right cause given a gap, all cases with one cause that is not scatter:",
            *table(["data", "values", "mean P", "against everything"], rows),
        ]
    )


def decisive(say: Say, evidence: Evidence, s: Scored, seed: int, folder: Path | None, jobs: int) -> None:
    """Whether the next test resolves an ambiguous set."""
    rows = np.nonzero(s.single & (s.verdict == "ambiguous"))[0]
    rows = [i for i in rows if s.cases.effects[i][0].family != "scatter"]
    if folder is None:
        found = controls.next_tests(evidence, s, rows, seed)
    else:
        backend = evidence.bench.library.base.backend
        with RunStore(folder) as runs, WorkerPool(jobs, source=Source("fem_backend.backend:BACKEND")) as pool:
            found = controls.next_tests(evidence, s, rows, seed, lambda t: run_all(backend, t, runs, pool))
    promised = found.pop("promised")
    say(
        [
            "## Next test",
            "",
            "Ambiguous sets that hold the truth; resolved: after one more test the right cause has "
            f"{DECIDED_PROBABILITY:g} of the probability within the set.  "
            f"The proposed test promised {np.mean(promised):.2f}.",
            *table(["test", "resolved"], [[k, share(v)] for k, v in found.items()]),
        ]
    )


def with_pairs(say: Say, own: Table, s: Scored, count: int) -> None:
    """Figures with pairs of survivors in the contest, beside those without, for some cases."""
    two = list(np.nonzero(s.found & ~s.single & ~s.null)[0])
    one = list(np.nonzero(s.found & s.single)[0])
    rows = [*two[: count // 2], *one[:: max(1, len(one) // max(count - count // 2, 1))][: count - count // 2]]
    if not rows:
        return
    began = time.process_time()
    part = s.cases.picked(rows)
    first = {i: s.contests[i] for i in rows}
    after = Scored(part, contested(own, rows, first, True), -np.inf, {})
    out = []
    for name, m in (("two causes", ~after.single), ("one cause", after.single)):
        if m.any():
            old = np.array(rows)[m]
            both = [(getattr(s, k)[old], getattr(after, k)[m]) for k in ("top", "in_set", "sizes", "wrong")]
            out.append([name, m.sum(), *(f"{np.mean(v):.2f}" for pair in both for v in pair)])
    cost = (time.process_time() - began) / len(rows)
    head = [f"{v}, {w} pairs" for v in ("on top", "in set", "set size", "wrong and sure") for w in ("without", "with")]
    say(["## With pairs of survivors", *table(["truth", "cases", *head], out), f"{cost:.1f} s CPU a case.", ""])
