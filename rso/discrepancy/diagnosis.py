"""The diagnosis of one data set: gap or not, where, which cause, how sure, how much of the gap it closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.core.distributions import chi2_ppf
from rso.discrepancy.detectors.jumps import Jumps, jumps
from rso.discrepancy.detectors.periodic import PeriodicLine, periodic_line
from rso.discrepancy.evidence import any_network, attribution, localisation, noise, shrinkage
from rso.discrepancy.evidence.attribution import Comparison, Evidence, Shared
from rso.discrepancy.evidence.checks import SelfCheck, prior_sensitivity, self_checks
from rso.discrepancy.evidence.cross_validation import (
    HeldOut,
    fit_effects,
    held_out_evidence,
    left_out_gaps,
    predicts,
    shrinkage_of,
)
from rso.discrepancy.evidence.gaussian_mixture import Posterior, mean_prediction, posterior
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.marginal_ranges import Reach, draws, reach
from rso.discrepancy.evidence.residual_test import ResidualScore, residual_score
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, DiagnosisSettings, VerdictRules
from rso.discrepancy.evidence.verdict import (
    UNEXPLAINED,
    Judgement,
    beaten,
    given_a_gap,
    judge_comparison,
    most_probable,
    pairs_of_remainder,
    singles,
)
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.tables import Library
from rso.inference.intervals import CREDIBLE_LEVEL

N_DIAGNOSIS_DRAWS = 2000  # of the parameters under each hypothesis: 200 lie beyond the ends of 90 % intervals
# low end, median and high end of an interval
CREDIBLE_QUANTILES = ((1 - CREDIBLE_LEVEL) / 2, 0.5, (1 + CREDIBLE_LEVEL) / 2)
WHOLE_GAP_VERDICTS = ("explained", "measurement", "ambiguous")  # verdicts that take causes for the whole of a gap
MIN_SIGN_DRAWS_SHARE = 0.01  # of the draws: a sign that fewer have is not worth a word
SIGN_GAP_RATIO = 0.3  # of the median deviation: where 95 % on both sides lie further out than that, nothing is between


@dataclass(frozen=True)
class Cause:
    """One effect of the verdict: probability, size with interval in its unit, and where it is absent.

    Of what scatters `each` holds (value, standard deviation) of every test; `shape` (low, median, high) of every knob
    that shapes it, in its unit.  Where the data allow both signs and nothing between, size and interval are those of
    the likelier one, and `otherwise` is (probability, low, high) of the other.
    """

    effect: Effect
    probability: float
    size: float
    interval: tuple[float, float]
    railed: bool
    each: tuple[tuple[float, float], ...] = ()
    shape: tuple[tuple[float, float, float], ...] = ()
    otherwise: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Everything that one data set says; `probabilities` are those of all hypotheses given the data.

    `odd` is the experiment that alone has what is unexplained, and how probable that is; None where none is.  `taken`
    (n,) is what gain and contact of each test, as fitted with the chosen hypothesis, add to it, `reading` (n,) the
    standard deviation of a reading without them.
    """

    verdict: str
    p_value: float
    statistic: float
    threshold: float
    size_over_noise: float
    causes: tuple[Cause, ...]
    named: tuple[str, ...]
    probabilities: Mapping[str, float]
    sensitivity: Mapping[str, Mapping[str, float]]
    where: localisation.Where
    held_out: tuple[HeldOut, ...]
    shrinkage: shrinkage.Shrinkage
    checks: tuple[SelfCheck, ...]
    parameters: Mapping[str, Mapping[str, tuple[float, float, float]]]
    reach: Mapping[str, Reach]
    bench: Shared
    contest: Comparison
    fits: Mapping[str, np.ndarray]
    posteriors: Mapping[str, Posterior]
    chosen: Hypothesis
    jumps: Jumps
    hum: PeriodicLine
    left: float
    remainder: ResidualScore | None
    odd: tuple[str, float] | None
    taken: np.ndarray
    reading: np.ndarray


def diagnose(
    whole: Library,
    seed: int,
    nulls: int = attribution.N_NULL_DATA_SETS,
    fitted: Mapping[str, float] | None = None,
    settings: DiagnosisSettings = DIAGNOSIS_SETTINGS,
) -> Diagnosis:
    """The diagnosis of the data in the library's plan; curves with role validate enter the shrinkage only.

    `fitted` are open parameters as the study found them.
    """
    library = replace(whole, plan=whole.plan.seen())
    y = library.plan.values()
    opened = _opened(library, y, nulls, seed, settings)
    evidence, bench, gap = opened.evidence, opened.evidence.bench, opened.gap
    contest, finalists, judged, rest = _contested(opened, y, seed)
    steps, line = jumps(library.plan), periodic_line(library.plan)
    judged = _restless(judged, opened, y, steps.sudden or line.there)
    rng = np.random.default_rng(seed + 1)
    posts = {"none": _posterior(evidence, (), y, rng)}
    losers = beaten(contest, judged.named) if gap else []
    for h in dict.fromkeys([judged.chosen, *singles(contest, judged.named), *losers]):
        posts[h.name] = _posterior(evidence, h.effects, y, rng, h.unexplained)
    pure = Hypothesis(judged.chosen.effects)  # of many forms of one cause it need not be among the most probable
    held = held_out_evidence(bench, y, list(dict.fromkeys([Hypothesis(()), *most_probable(contest), pure])))
    if judged.verdict in WHOLE_GAP_VERDICTS and pure.effects and not predicts(held, pure):
        judged = UNEXPLAINED  # evidence without prediction is no cause
        posts[judged.chosen.name] = _posterior(evidence, (), y, rng, True)
    judged = _whole_or_part(judged, evidence, y, posts, rest)
    # a part, by the curves that are seen: validation has no say
    if judged.verdict == "partly" and _widens(
        left_out_gaps(library, bench, evidence, y, judged.chosen, seed, anew=False)
    ):
        judged = UNEXPLAINED
        posts[judged.chosen.name] = _posterior(evidence, (), y, rng, True)
    judged = _flow_or_network(judged, evidence, y, posts, rng)
    verdict, chosen = judged.verdict, judged.chosen
    odd = evidence.odd(y) if chosen == UNEXPLAINED.chosen else None
    odd = odd if odd is not None and odd[1] > settings.rules.lone else None
    fits = {
        h.name: shrinkage.predicted(library, h.effects, posts[h.name], bench.modulus)
        for h in dict.fromkeys([Hypothesis(()), chosen])
    }
    where, taken, scatter = _readings(evidence, chosen, fits, y, seed, odd and odd[0])
    r = bench.whites[0](y - fits["none"])
    causes = _causes(evidence, contest, y, posts, verdict, judged.named)
    others = (
        None if odd is None else np.setdiff1d(np.arange(len(y)), localisation.experiment_rows(library.plan, odd[0]))
    )
    if others is not None:  # what the others say
        posts[chosen.name] = fit_effects(bench, (), others, y, rng, N_DIAGNOSIS_DRAWS)
    reached = reach(evidence, contest, chosen, y, CREDIBLE_LEVEL, seed + 7, others)
    return Diagnosis(
        verdict=verdict,
        p_value=float((1 + np.sum(opened.null >= opened.first.statistic)) / (1 + len(opened.null))),
        statistic=opened.first.statistic,
        threshold=opened.threshold,
        size_over_noise=float(np.sqrt(np.mean(r**2))),
        causes=causes,
        named=judged.named,
        probabilities=dict(zip([h.name for h in contest.hypotheses], map(float, contest.probability), strict=True)),
        sensitivity=prior_sensitivity(evidence, contest, finalists, y),
        where=where,
        held_out=held,
        shrinkage=shrinkage_of(whole, library, bench, evidence, y, chosen, seed, fitted),
        checks=()
        if verdict == "no_gap"
        else self_checks(evidence, contest, finalists, y, opened.threshold, opened.null, seed),
        parameters=_parameters(library, posts, reached),
        reach=reached,
        bench=bench,
        contest=contest,
        fits=fits,
        posteriors=posts,
        chosen=chosen,
        jumps=steps,
        hum=line,
        left=misfit(evidence, chosen, y),
        remainder=rest,
        odd=odd,
        taken=taken,
        reading=scatter,
    )


@dataclass(frozen=True, eq=False)
class _Opened:
    """The first contest, with the statistic of data simulated from the base model."""

    evidence: Evidence
    first: Comparison
    null: np.ndarray

    @property
    def threshold(self) -> float:
        """What few of these exceed; besides, a gap must be more probable than none."""
        return attribution.critical(self.null, self.evidence.bench.settings.rules.false_alarm)

    @property
    def gap(self) -> bool:
        """Whether there is one."""
        return self.first.statistic > self.threshold


def _opened(library: Library, y: np.ndarray, nulls: int, seed: int, settings: DiagnosisSettings) -> _Opened:
    """With the noise of the repeats; where that is far beyond what is stated and explains all, what is stated asks why,
    and stands where that is found."""
    opened = _first(attribution.set_up(library, y, settings=settings), y, nulls, seed)
    if opened.gap or noise.noise_levels(library.plan, True, settings.noise) == opened.evidence.bench.levels:
        return opened
    asked = _first(attribution.set_up(library, y, True, settings), y, nulls, seed)
    return asked if asked.gap else opened


def _first(bench: Shared, y: np.ndarray, nulls: int, seed: int) -> _Opened:
    evidence = Evidence(bench, bench.library.effects)
    first = attribution.comparisons(evidence, y[None])[0]
    simulated = attribution.nulls(evidence, y, nulls, seed)
    return _Opened(evidence, first, np.array([c.statistic for c in attribution.comparisons(evidence, simulated)]))


def _contested(
    opened: _Opened, y: np.ndarray, seed: int
) -> tuple[Comparison, frozenset[str], Judgement, ResidualScore | None]:
    """The contest with pairs of the survivors, also with what a cause leaves, the finalists, what it says, the rest."""
    evidence, gap = opened.evidence, opened.gap
    last = attribution.survivors(opened.first) if gap else []
    pairs, finalists = attribution.pairs_of(last), frozenset(e.source for e in last)
    contest = opened.first
    if gap:
        contest = attribution.comparisons(evidence, y[None], pairs, finalists=finalists)[0]
    judged = judge_comparison(contest, gap, evidence.bench.settings.rules)
    part = judged.verdict == "partly" and len(judged.chosen.effects) == 1
    rest = (
        residual_score(evidence, judged.chosen, y, seed + 3) if part or judged.verdict in WHOLE_GAP_VERDICTS else None
    )
    if rest is not None and rest.there:
        joined = pairs_of_remainder(judged.chosen, rest, pairs)
        finalists |= {e.source for pair in joined for e in pair}
        contest = attribution.comparisons(evidence, y[None], [*pairs, *joined], finalists=finalists)[0]
        judged = judge_comparison(contest, gap, evidence.bench.settings.rules)
    return contest, finalists, judged, rest


def _restless(judged: Judgement, opened: _Opened, y: np.ndarray, restless: bool) -> Judgement:
    """No smooth model jumps or hums: a cause explains at most the rest; a loose contact leaves nothing smooth."""
    if opened.gap and restless:
        return judged if judged.verdict == "unexplained" else replace(judged, verdict="partly")
    if not opened.gap and (
        restless or misfit(opened.evidence, judged.chosen, y) > most_left(len(y), opened.evidence.bench.settings.rules)
    ):
        return replace(judged, verdict="unexplained", chosen=UNEXPLAINED.chosen)
    return judged


def _whole_or_part(
    judged: Judgement, evidence: Evidence, y: np.ndarray, posts: Mapping[str, Posterior], rest: ResidualScore | None
) -> Judgement:
    """A cause is a part where it leaves too much, would have to be larger than is plausible, or something shows."""
    chosen = judged.chosen
    if judged.verdict not in WHOLE_GAP_VERDICTS:
        return judged
    rules = evidence.bench.settings.rules
    doubtful = misfit(evidence, chosen, y) > most_left(len(y), rules) or _beyond(chosen, posts[chosen.name], rules)
    return replace(judged, verdict="partly") if doubtful or (rest is not None and rest.there) else judged


def _flow_or_network(
    judged: Judgement, evidence: Evidence, y: np.ndarray, posts: dict[str, Posterior], rng: np.random.Generator
) -> Judgement:
    """What flows is no sure cause where a network of many relaxation times would make the same forces in these tests;
    of that the catalogue has one time alone, which may fit worse."""
    chosen, other = judged.chosen, any_network.network(evidence.bench)
    single = len(chosen.effects) == 1 and chosen.effects[0].flows
    if (
        other is None
        or not single
        or judged.verdict not in (*WHOLE_GAP_VERDICTS, "partly")
        or other.name in judged.named
    ):
        return judged
    post = posts[chosen.name]
    at, modulus = np.median(post.at, axis=0), float(np.median(post.modulus))
    if any_network.distance(evidence.bench, chosen.effects[0], at, modulus) > evidence.bench.settings.rules.apart:
        return judged
    posts[other.name] = _posterior(evidence, (other,), y, rng)
    verdict = "partly" if judged.verdict == "partly" else "ambiguous"
    return Judgement(verdict, (*judged.named, other.name), chosen)


def _readings(
    evidence: Evidence, chosen: Hypothesis, fits: Mapping[str, np.ndarray], y: np.ndarray, seed: int, odd: str | None
) -> tuple[localisation.Where, np.ndarray, np.ndarray]:
    """Where the gap lies; what gain and contact of each test add (n,); standard deviations of readings without (n,)."""
    bench = evidence.bench
    plan = bench.library.plan
    where = localisation.localise(plan, evidence.ready(()), bench.C, y, seed, odd)
    slope = noise.slope_of(bench.library, fits["none"])
    tests = noise.of_tests(plan, bench.levels, fits["none"], slope)
    taken = _of_tests(evidence, chosen, tests, y - fits[chosen.name], y)
    alone = noise.reading_variance(plan, bench.levels, slope)
    scatter = np.sqrt(np.maximum(np.diag(bench.C) - np.diag(tests), alone))  # C was made at an earlier fit
    if chosen != Hypothesis(()):
        C = noise.scatter(plan, bench.levels, fits["none"], slope)
        where = localisation.shared(where, plan, _gap_of(evidence, chosen, fits, y), C, alone)
    return where, taken, scatter


def _posterior(
    evidence: Evidence, effects: Sequence[Effect], y: np.ndarray, rng: np.random.Generator, unexplained: bool = False
) -> Posterior:
    h = evidence.best(effects, y, unexplained, loose=bool(effects))
    return posterior(h, h.white(y), N_DIAGNOSIS_DRAWS, rng)


def _causes(
    evidence: Evidence,
    contest: Comparison,
    y: np.ndarray,
    posts: Mapping[str, Posterior],
    verdict: str,
    named: Sequence[str],
) -> tuple[Cause, ...]:
    """Every named effect with its probability given a gap, and its size where it is alone or in the chosen pair."""
    if verdict in ("no_gap", "unexplained"):
        return ()
    given = given_a_gap(contest)
    found = []
    for name in named:
        holders = [
            (q, h) for h, q in zip(contest.hypotheses[1:], given, strict=True) if name in [e.name for e in h.effects]
        ]
        h = max(holders, key=lambda v: v[0])[1]
        post = posts.get(h.name)
        if post is None:
            h = next(g for _, g in holders if g.name in posts)
            post = posts[h.name]
        e = next(e for e in h.effects if e.name == name)
        probability = sum(v for v, g in holders_of(contest, given, e.source))
        if e.family == "scatter":
            size, low, high = evidence.scatter(e, y, CREDIBLE_LEVEL)
            each = tuple(zip(*(v.tolist() for v in evidence.of_tests(e, y, size)), strict=True))
            found.append(Cause(e, probability, float(size), (float(low), float(high)), False, each))
            continue
        column = _column(h, e, post)
        # sizes of the chain count against the force at μ₀, those of the model are multiples of the modulus
        scale = post.modulus / (1.0 if e.family == "model" else evidence.bench.modulus)
        values = [k.value(post.at[:, column + j]) * scale**k.exponent for j, k in enumerate(e.knobs)]
        side, levels, otherwise = _sides(e, post.at[:, column], values[0])
        (low, mid, high), *shape = (_quantiles(v[side], levels) for v in values)
        ends = [abs(v) for side in e.size.ends() for v in side]
        railed = bool(np.median(np.abs(post.at[:, column])) > 0.95 * max(ends)) and e.size.neutral is not None
        railed = railed or _strayed(e, column, post)
        found.append(Cause(e, float(probability), mid, (low, high), railed, (), tuple(shape), otherwise))
    return tuple(sorted(found, key=lambda c: -c.probability))


def _quantiles(v: np.ndarray, levels: tuple[float, float, float]) -> tuple[float, float, float]:
    low, mid, high = map(float, np.quantile(v, levels))
    return low, mid, high


def _sides(
    e: Effect, deviation: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, tuple[float, float, float], tuple[float, float, float] | None]:
    """Which draws (m,) are said, quantiles that leave CREDIBLE_LEVEL of all within, and (probability, low, high) of the
    others.

    All are said, unless signed deviations from neutral lie on both sides and next to none between.
    """
    whole = np.ones(len(deviation), bool), CREDIBLE_QUANTILES, None
    other, main = sorted((deviation < 0, deviation > 0), key=np.count_nonzero)
    if e.size.neutral is None or other.sum() < MIN_SIGN_DRAWS_SHARE * len(deviation):
        return whole
    near, middle = (sum(np.quantile(abs(deviation[s]), q) for s in (main, other)) for q in (CREDIBLE_QUANTILES[0], 0.5))
    if near < SIGN_GAP_RATIO * middle:
        return whole
    share = float(other.mean())
    within = min(CREDIBLE_LEVEL / (1 - share), 1.0) if share < 1 - CREDIBLE_LEVEL else CREDIBLE_LEVEL
    low, high = np.quantile(size[other], (CREDIBLE_QUANTILES[0], CREDIBLE_QUANTILES[-1]))
    return main, ((1 - within) / 2, 0.5, (1 + within) / 2), (share, float(low), float(high))


def holders_of(contest: Comparison, given: np.ndarray, source: str) -> list[tuple[float, Hypothesis]]:
    """Hypotheses in which a source takes part, with their probabilities given a gap."""
    pairs = zip(given, contest.hypotheses[1:], strict=True)
    return [(float(q), h) for q, h in pairs if source in {e.source for e in h.effects}]


def misfit(evidence: Evidence, h: Hypothesis, y: np.ndarray) -> float:
    """χ² per reading of what a hypothesis, as fitted, leaves: 1 or less where it holds."""
    best = evidence.best(h.effects, y, h.unexplained, loose=bool(h.effects))
    w = best.white(y)
    return float(np.mean((w - mean_prediction(best, w)) ** 2))


def most_left(n: int, rules: VerdictRules = DIAGNOSIS_SETTINGS.rules) -> float:
    """χ² per reading that a right hypothesis may leave of n readings."""
    return max(rules.misfit, float(chi2_ppf(1.0 - rules.rare, n)) / n)


def _gap_of(evidence: Evidence, h: Hypothesis, fits: Mapping[str, np.ndarray], y: np.ndarray) -> np.ndarray:
    """What a hypothesis adds to the base model (n,), each as fitted; of what has no mean, its posterior mean."""
    L = evidence.best(h.effects, y, h.unexplained, loose=bool(h.effects)).white.L
    C = L @ L.T
    return fits[h.name] - fits["none"] + (C - evidence.bench.C) @ np.linalg.solve(C, y - fits[h.name])


def _of_tests(evidence: Evidence, h: Hypothesis, tests: np.ndarray, r: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Posterior mean (n,) of what whole tests are off by, from the residual r (n,) of a hypothesis.

    `tests` (n, n) is its covariance, to which a hypothesis that scatters from curve to curve adds its own.
    """
    L = evidence.best(h.effects, y, h.unexplained, loose=bool(h.effects)).white.L
    C = L @ L.T
    own = C - evidence.bench.C if any(e.family == "scatter" for e in h.effects) else 0.0
    return (tests + own) @ np.linalg.solve(C, r)


def _beyond(h: Hypothesis, post: Posterior, rules: VerdictRules = DIAGNOSIS_SETTINGS.rules) -> bool:
    """Whether an effect would have to be larger than is plausible, or lie where nothing was computed."""
    for e in h.effects:
        if e.family == "scatter":
            continue
        column = _column(h, e, post)
        far = max(abs(v) for side in e.size.ends() for v in side)
        large = e.size.neutral is not None and np.median(np.abs(post.at[:, column])) > rules.beyond * far
        if large or _strayed(e, column, post):
            return True
    return False


def _widens(s: shrinkage.Shrinkage) -> bool:
    """Whether a cause makes the gap on curves left out larger than the base model as fitted leaves it."""
    return s.interval is not None and s.interval[1] < 0.0


def _strayed(effect: Effect, column: int, post: Posterior) -> bool:
    """Whether most draws of one of an effect's knobs lie where its tiles know nothing."""
    return bool(np.any(np.mean(post.strayed[:, column : column + len(effect.knobs)], axis=0) > 0.5))


def _column(h: Hypothesis, effect: Effect, post: Posterior) -> int:
    """Where the size of an effect stands among the coordinates of a hypothesis."""
    own = [e for e in h.effects if e.family != "scatter"]  # these have no coordinate
    column = post.at.shape[1] - sum(len(e.knobs) for e in own)
    for e in own:
        if e is effect:
            break
        column += len(e.knobs)
    return column


def _parameters(
    library: Library, posts: Mapping[str, Posterior], reached: Mapping[str, Reach]
) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Open base parameters (low, median, high): of the base model, over all that the data allow, of what is said."""
    before = {
        k: tuple(map(float, np.quantile(v, CREDIBLE_QUANTILES))) for k, v in draws(library, posts["none"]).items()
    }
    after, alone = ({k: getattr(r, of) for k, r in reached.items()} for of in ("whole", "alone"))
    return {"before": before, "after": after, "if_nothing_else": alone}
