"""How much of the gap the chosen cause closes where nothing was fitted, beside what the true one would close."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from cases import Cases
from checked import Checked, spread
from controls import with_values
from scipy.linalg import cholesky
from scipy.stats import norm
from scores import Scored, share
from sections import Say, table

from rso.discrepancy.evidence import attribution, noise, shrinkage
from rso.discrepancy.evidence.attribution import Comparison, Evidence
from rso.discrepancy.evidence.cross_validation import left_out_gaps, shrinkage_of
from rso.discrepancy.evidence.gaussian_mixture import posterior
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.shrinkage import Shrinkage
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import TestPlan

ENOUGH = 0.9  # of what the true effect closes
LEFT_OUT = 100  # cases in which experiments are left out in turn
BOOTSTRAPS = 2000
TRIALS = 400


@dataclass(frozen=True)
class Closed:
    """What one case's chosen hypothesis leaves of the gap on held-out curves, and what the true one leaves."""

    verdict: str
    same: bool
    chosen: Shrinkage
    true: Shrinkage

    @property
    def printed(self) -> bool:
        """Whether the gap before is clear enough for a share."""
        return self.true.closed is not None

    @property
    def possible(self) -> bool:
        """Whether the true effect takes anything from it."""
        return self.true.before > self.true.with_cause

    @property
    def achievable(self) -> float:
        """Share of the gap above the floor that the true effect closes."""
        return (self.true.before - self.true.with_cause) / (self.true.before - self.true.floor)

    @property
    def ratio(self) -> float:
        """What the chosen one closes over what the true one closes."""
        return (self.chosen.before - self.chosen.with_cause) / (self.true.before - self.true.with_cause)


def seen_rows(plan: TestPlan) -> np.ndarray:
    """(n,) whether a row of a plan's data vector is that of an experiment which is not kept for validation."""
    out = np.zeros(plan.n, bool)
    for item, _, at in plan.rows():
        out[at] = plan.experiments[item.experiment].role != "validate"
    return out


def covariance(whole: Library, evidence: Evidence, y: np.ndarray) -> np.ndarray:
    """C (N, N) of the data vector of the whole plan at the base model as fitted to what is seen, y (n,)."""
    h = evidence.best((), y)
    post = posterior(h, h.white(y), 2000, np.random.default_rng(0))
    force = shrinkage.predicted(whole, (), post, evidence.bench.modulus)
    levels = {**noise.noise_levels(whole.plan), **evidence.bench.levels}
    return noise.data_covariance(whole, levels, force, noise.slope_of(whole, force))


def means(whole: Library, evidence: Evidence, cases: Cases, rng: np.random.Generator) -> np.ndarray:
    """Noise-free values (B, N) of the whole plan, each test with its own draw of what scatters."""
    groups: dict[tuple, list[int]] = {}
    for i, effects in enumerate(cases.effects):
        groups.setdefault(effects, []).append(i)
    out = np.empty((len(cases.Y), whole.plan.n))
    d = len(whole.base.axes)
    for effects, rows in groups.items():
        A, c = predict(whole, effects, np.array([cases.at[i] for i in rows]), evidence.bench.modulus)
        out[rows] = cases.modulus[rows, None] * A + c
        if effects and effects[0].family == "scatter":
            for i in rows:
                g = attribution.by_test(whole, effects[0], cases.at[i][None, :d], evidence.bench.modulus)
                out[i] += cases.at[i][d] * rng.standard_normal(len(g)) @ g
    return out


def everywhere(whole: Library, evidence: Evidence, y: np.ndarray, cases: Cases, seed: int) -> np.ndarray:
    """Values (B, N) of the whole plan: those of the cases where they are seen, and how cause and noise go on beyond.

    The noise of curves that are kept is drawn given that of the others: contact and errors of the model are shared.
    """
    rng, seen = np.random.default_rng(seed), seen_rows(whole.plan)
    if seen.all():
        return cases.Y
    C = covariance(whole, evidence, y)
    cross = C[np.ix_(seen, ~seen)]
    gain = np.linalg.solve(C[np.ix_(seen, seen)], cross)
    root = cholesky(C[np.ix_(~seen, ~seen)] - cross.T @ gain, lower=True)
    out = means(whole, evidence, cases, rng)
    own = (cases.Y - cases.mean) @ gain + rng.standard_normal((len(out), len(root))) @ root.T
    out[:, ~seen] += own
    out[:, seen] = cases.Y
    return out


def closed(
    whole: Library,
    evidence: Evidence,
    values: np.ndarray,
    hypothesis: Hypothesis,
    seed: int,
    in_turn: bool = False,
    anew: bool = True,
) -> Shrinkage:
    """The product's shrinkage for values (N,) of the whole plan; `in_turn` experiments that are seen are left out, and
    the hypothesis is chosen `anew` without them."""
    plan = with_values(whole.plan, values)
    own = replace(whole, plan=plan)
    library, y = replace(own, plan=plan.seen()), values[seen_rows(plan)]
    if in_turn:
        return left_out_gaps(library, evidence.bench, evidence, y, hypothesis, seed, anew)
    return shrinkage_of(own, library, evidence.bench, evidence, y, hypothesis, seed)


def best_cause(contest: Comparison) -> Hypothesis:
    """The most probable single cause, as if there had to be one."""
    score = contest.log_evidence + contest.log_prior
    own = [k for k, h in enumerate(contest.hypotheses) if len(h.effects) == 1 and not h.unexplained]
    return contest.hypotheses[max(own, key=lambda k: score[k])]


def differences(s: Shrinkage, seed: int) -> np.ndarray:
    """What the cause takes from G before, and from that of the re-fit, then whether each interval contains none."""
    G = np.array([[c.before - c.with_cause, c.refit_only - c.with_cause] for c in s.curves])
    return np.concatenate([G.mean(axis=0), _holds(G, seed)])


def _holds(G: np.ndarray, seed: int) -> np.ndarray:
    """Whether the 90 % interval of the mean over resampled rows of G (curves, k) contains 0."""
    pick = np.random.default_rng(seed).integers(0, len(G), (BOOTSTRAPS, len(G)))
    low, high = np.quantile(G[pick].mean(axis=1), [0.05, 0.95], axis=0)
    return (low <= 0) & (high >= 0)


def quartiles(v: Sequence[float]) -> str:
    """Median and quartiles as text."""
    v = np.array(v)
    return f"{np.median(v):.3f} ({np.quantile(v, 0.25):.3f}–{np.quantile(v, 0.75):.3f})" if len(v) else "–"


def summary(found: Sequence[Closed]) -> list[list[str]]:
    """Rows of all cases with a share, of those by verdict, and of those where the chosen one is not the true one."""

    def row(words: str, own: Sequence[Closed]) -> list[str]:
        ratio = np.array([c.ratio for c in own])
        return [
            words,
            str(len(own)),
            quartiles([c.chosen.closed for c in own]),
            quartiles([c.achievable for c in own]),
            quartiles(ratio),
            share(ratio >= ENOUGH),
        ]

    kinds = [
        k
        for k in ("explained", "measurement", "ambiguous", "partly", "unexplained")
        if any(c.verdict == k for c in found)
    ]
    return [
        row("all", found),
        *(row(f"verdict {k}", [c for c in found if c.verdict == k]) for k in kinds),
        row("another cause chosen, or none", [c for c in found if not c.same]),
    ]


HEAD = ["cases", "with a share", "share closed: median (quartiles)", "by the true effect", "ratio", "ratio ≥ 0.9"]


def one_cause(
    whole: Library,
    evidence: Evidence,
    s: Scored,
    values: np.ndarray,
    rows: Sequence[int],
    look: Callable[[int], Checked],
    seed: int,
    in_turn: bool,
) -> list[Closed]:
    """What is closed of cases found."""
    out = []
    for i in rows:
        c, truth = look(i), Hypothesis(s.cases.effects[i])
        true = closed(whole, evidence, values[i], truth, seed + i, in_turn, False)
        same = c.chosen.effects == truth.effects
        chosen = true if same and not in_turn else closed(whole, evidence, values[i], c.chosen, seed + i, in_turn)
        out.append(Closed(c.verdict, same, chosen, true))
    return out


def left_over(found: Sequence[Closed]) -> str:
    """How the cases are counted, and how often more than noise is left, whether a share is printed or not."""
    printed = sum(c.printed for c in found)
    idle = sum(c.printed and not c.possible for c in found)

    def clear(of: Callable[[Closed], Shrinkage], beside: str) -> str:
        over = [of(c).with_cause - getattr(of(c), beside) > 2 * of(c).floor_error for c in found]
        return share(over)

    return (
        f"{len(found)} cases found, {printed} with a share, in {idle} of which the true effect takes nothing.  Whether "
        "printed or not, G is above the floor by more than twice its standard error in "
        f"{clear(lambda c: c.chosen, 'floor')} with the hypothesis that stands and in "
        f"{clear(lambda c: c.true, 'floor')} with the true effect, and by so much above G before in "
        f"{clear(lambda c: c.chosen, 'before')} and {clear(lambda c: c.true, 'before')}."
    )


def no_cause(
    whole: Library, evidence: Evidence, s: Scored, values: np.ndarray, rows: Sequence[int], seed: int, in_turn: bool
) -> str:
    """What is printed of cases without a gap, and what a cause would close that is forced on them."""
    if not len(rows):
        return "No case without a gap."
    printed, forced, moved = [], [], []
    for i in rows:
        printed.append(closed(whole, evidence, values[i], s.judged[i].chosen, seed + i, in_turn))
        forced.append(closed(whole, evidence, values[i], best_cause(s.contests[i]), seed + i, in_turn, False))
        moved.append(differences(forced[-1], seed + i))
    moved, there = np.array(moved), [c.closed is not None for c in printed]
    holds = lambda v: share([c.interval[0] <= 0 <= c.interval[1] for c in v if c.interval is not None])  # noqa: E731
    curves, closes = len(forced[0].curves), [c.closed for c in printed if c.closed is not None]
    between = f", of {min(closes):.2f} to {max(closes):.2f}," if closes else ""
    return (
        f"{len(rows)} cases without a gap: as judged, {share(there)} print a share{between} where the noise of G "
        f"alone would have it in {norm.sf(2):.3f}; its interval contains 0 in {holds(printed)} of these, and with the "
        f"most probable single cause forced on them in {holds(forced)}.  Whether a share is printed or not, that "
        f"cause takes from G before (median, quartiles, in units of the floor) {quartiles(moved[:, 0])}, and beyond "
        f"what a re-fit alone takes {quartiles(moved[:, 1])}; the 90 % interval over resampled curves contains 0 in "
        f"{share(moved[:, 2] > 0)} and {share(moved[:, 3] > 0)}.  Of {curves} independent curves whose G goes up and "
        f"down alike it would in {nominal(curves):.2f}."
    )


def nominal(curves: int) -> float:
    """How often an interval over so many resampled curves contains 0 where each by itself is symmetric about 0."""
    rng = np.random.default_rng(0)
    return float(np.mean([_holds(rng.standard_normal((curves, 1)), k)[0] for k in range(TRIALS)]))


def shrinkages(
    say: Say,
    whole: Library,
    evidence: Evidence,
    s: Scored,
    values: np.ndarray,
    look: Callable[[int], Checked],
    seed: int,
) -> None:
    """Shares closed on the validate curves, and with experiments left out in turn."""
    hit = [i for i in np.nonzero(s.found & s.single)[0] if s.cases.effects[i][0].family != "scatter"]
    null = np.nonzero(s.null)[0]
    text = (
        "Of cases found that have one cause, not scatter: what the hypothesis takes from G on held-out curves "
        "that stands after the contest, a look at what is left and the held-out check, over what the true effect "
        "takes that is put in its place (*ratio*; 1 by definition where that is the one chosen).  Only where G "
        "before is above the floor by more than twice its standard error, as else no share is printed; "
        '"unexplained" counts with what a re-fit takes.  Where experiments are left out in turn, the cause is '
        "chosen anew without each, the true effect is not."
    )
    say(["## How much closes", "", text])
    names = [e.name for e in whole.plan.experiments if e.role == "validate"]
    ways = {False: f"Validate curves ({', '.join(names)})", True: "Each experiment that is seen left out in turn"}
    for in_turn in [k for k in ways if k or names]:
        rows, still = (spread(v, LEFT_OUT if in_turn else len(v)) for v in (hit, null))
        found = one_cause(whole, evidence, s, values, rows, look, seed, in_turn)
        shares = [c for c in found if c.printed and c.possible]
        quiet = no_cause(whole, evidence, s, values, still, seed, in_turn)
        say(["", f"### {ways[in_turn]}", "", left_over(found), *table(HEAD, summary(shares)), quiet, ""])
