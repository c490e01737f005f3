"""What the parameters could be: averaged over the hypotheses and over what the data neither show nor exclude.

    p(θ | y) = Σ_h P(h | y) Σ_z ∫ p(θ | y − Δ(z, s), h) P(z, s | y, h) ds

Bayesian model averaging (Hoeting et al., Statist. Sci. 14 (1999) 382, eq. 1) over the hypotheses h of the contest, and
under each over subsets z of all other effects, of sizes s, that leave the prediction Δ beside it.  Before the data an
effect that another does not stand for is there with probability `present` or `seldom`, of a size that its catalogue
calls plausible; what is known of one from a calibration takes the place of both.  The model itself may be off in all
tests alike, as one program is from another (:func:`noise.other_code`), which no re-fit of the modulus sees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp, ndtri

from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.attribution import Comparison, Evidence
from rso.discrepancy.evidence.gaussian_mixture import (
    Posterior,
    Ready,
    mean_prediction,
    mixture_log_evidence,
    posterior,
    posterior_each,
    ready,
    whitening,
)
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library

N_UNSEEN_SIZE_DRAWS = 64  # draws of an effect that is added to what is said
# of what no indentation shows, and calibrations know: its uncertainty
USUAL_CALIBRATION_SD = {"gain": 0.02, "depth_scale": 0.005}
N_MARGINAL_DRAWS = 2000  # in all, over the hypotheses by their probabilities
SUBSETS_PER_DRAW, N_MORE_SUBSETS = 1, 200  # subsets of effects for each draw of a hypothesis, and besides
MIN_AVERAGED_PROBABILITY = 0.005  # probability of a hypothesis below which it is left out of the average
# least probability of what is said: the verdict may take a cause back that the contest believes
MIN_STATED_PROBABILITY = 0.5
NAMED_EFFECT_WIDTH_RATIO = 0.8  # of the width: an effect without which the interval is narrower than this is named
MAX_NAMED_EFFECTS = 3  # effects that are named
MIN_INTERVAL_DRAWS = 150  # draws that tell an interval
TAIL_FREQUENCY_RATIO = 2.0  # times as often as elsewhere: an effect stands behind an end of the interval


@dataclass(frozen=True)
class Reach:
    """A parameter (low, median, high): `whole` over all that the data allow, `alone` where nothing is there but what is
    said, `without` the effects `by` that widen it most (None where none does); and the effects behind the two ends.
    """

    whole: tuple[float, float, float]
    alone: tuple[float, float, float]
    by: tuple[str, ...] = ()
    without: tuple[float, float, float] | None = None
    low_with: str | None = None
    high_with: str | None = None


@dataclass(frozen=True, eq=False)
class Unseen:
    """An effect that may be there besides: what it adds (N_UNSEEN_SIZE_DRAWS, n), by how much more evidence each size
    has (N_UNSEEN_SIZE_DRAWS,) than its absence, ln, and the probability of its presence before any data."""

    effect: Effect
    adds: np.ndarray
    gained: np.ndarray
    prior: float

    @property
    def present(self) -> float:
        """Probability of its presence given the data, where nothing else is there besides."""
        there = self.prior * np.exp(logsumexp(self.gained) - np.log(len(self.gained)))
        return float(there / (1.0 - self.prior + there))


def draws(library: Library, p: Posterior) -> dict[str, np.ndarray]:
    """Open base parameters (m,) of the draws of a hypothesis."""
    out = {} if library.base.low == library.base.high else {library.base.modulus: p.modulus}
    for j, a in enumerate(library.base.axes):
        out[a.name] = a.physical(p.at[:, j], 1.0) * p.modulus**a.exponent
    return out


def calibrated_deviation(e: Effect) -> float | None:
    """Standard uncertainty of an effect by a calibration, as stated or else usual; None where neither is."""
    return e.known if e.known is not None else USUAL_CALIBRATION_SD.get(e.name)


def reach(
    evidence: Evidence,
    contest: Comparison,
    said: Hypothesis,
    y: np.ndarray,
    level: float,
    seed: int,
    rows: np.ndarray | None = None,
) -> dict[str, Reach]:
    """Intervals of probability `level` of every open parameter, over what the data allow and for what is `said` alone.

    With `rows` only these readings (of n) count, and the base model is what is said.
    """
    library, rng = evidence.bench.library, np.random.default_rng(seed)
    ends = [(1 - level) / 2, 0.5, (1 + level) / 2]

    def quantiles(v: np.ndarray) -> tuple[float, float, float]:
        low, mid, high = map(float, np.quantile(v, ends))
        return low, mid, high

    shares = {Hypothesis(()): 1.0} if rows is not None else _shares(contest, said)
    said = said if rows is None else Hypothesis(())
    h = _with_code(evidence, said, y, rows)
    own = posterior(h, h.white(y), N_MARGINAL_DRAWS, rng)
    alone = {k: quantiles(v) for k, v in draws(library, own).items()}
    unseen = _unseen(evidence, h, said, own, y, rng)
    number = rng.multinomial(N_MARGINAL_DRAWS, np.array(list(shares.values())))
    found = [
        _averaged(evidence, h if g == said else _with_code(evidence, g, y, rows), g, unseen, y, n, rng)
        for g, n in zip(shares, number, strict=True)
        if n
    ]
    there = {u.effect.name: np.concatenate([v[:, j] for _, v in found]) for j, u in enumerate(unseen)}
    there = {n: v for n, v in there.items() if v.any()}
    values = {k: np.concatenate([v[k] for v, _ in found]) for k in alone}
    return {k: _told(values[k], alone[k], there, quantiles) for k in alone}


def _shares(contest: Comparison, said: Hypothesis) -> dict[Hypothesis, float]:
    """Probabilities of the hypotheses that count, at least MIN_STATED_PROBABILITY of it that of what is said; they sum
    to 1.

    None has an effect that a calibration bounds: the contest knows what is plausible without one.
    """
    free = [
        (h, float(v))
        for h, v in zip(contest.hypotheses, contest.probability, strict=True)
        if all(e.known is None for e in h.effects) or _key(h) == _key(said)
    ]
    p = {h: v for h, v in free if v >= MIN_AVERAGED_PROBABILITY}
    own = next((h for h in p if _key(h) == _key(said)), said)
    mine, rest = p.pop(own, 0.0), sum(p.values())
    mine = max(mine / max(mine + rest, 1e-300), MIN_STATED_PROBABILITY) if rest else 1.0
    return {said: mine, **{h: v / rest * (1.0 - mine) for h, v in p.items()}}


def _key(h: Hypothesis) -> tuple[frozenset[str], bool]:
    """The same for the same effects in any order."""
    return frozenset(e.name for e in h.effects), h.unexplained


def _with_code(evidence: Evidence, g: Hypothesis, y: np.ndarray, rows: np.ndarray | None) -> Ready:
    """A hypothesis whose model may be off as one program is from another, on the readings `rows` (all if None)."""
    bench = evidence.bench
    h = evidence.best(g.effects, y, g.unexplained, loose=bool(g.effects))
    L = h.white.L
    force = L @ mean_prediction(h, h.white(y))
    return ready(
        h.tiles,
        whitening(L @ L.T + noise.other_code(bench.library.plan, force, bench.settings.model_error), rows),
        bench.modulus,
    )


def _unseen(
    evidence: Evidence, h: Ready, said: Hypothesis, post: Posterior, y: np.ndarray, rng: np.random.Generator
) -> list[Unseen]:
    """Every effect that moves a mean and is none of those that are said, beside these in the middle of `post`.

    Without it the data are refitted for each of N_UNSEEN_SIZE_DRAWS draws of its size; a new modulus makes another size
    of it.
    """
    library, μ, priors = evidence.bench.library, evidence.bench.modulus, evidence.bench.settings.priors
    at, m = np.mean(post.at, axis=0), float(np.mean(post.modulus))
    A0, c0 = predict(library, said.effects, at[None], μ)
    own = float(mixture_log_evidence(h, h.white(y)[None])[0])
    taken, found = {e.source for e in said.effects}, []
    places = [e.source for e in evidence.effects if e.place is not None]  # one of them has it
    for e in evidence.effects:
        sd = calibrated_deviation(e)
        if e.family == "scatter" or e.source in taken or sd == 0.0:
            continue
        size = _drawn(e, N_UNSEEN_SIZE_DRAWS, rng) if sd is None else _calibrated(e, N_UNSEEN_SIZE_DRAWS, sd)
        A, c = predict(library, (*said.effects, e), np.hstack([np.tile(at, (N_UNSEEN_SIZE_DRAWS, 1)), size]), μ)
        adds = m * (A - A0) + c - c0
        there = priors.present if e.measured else priors.seldom
        prior = 1.0 if sd is not None else there / max(places.count(e.source), 1)
        found.append(Unseen(e, adds, mixture_log_evidence(h, h.white(y - adds)) - own, prior))
    return found


def _averaged(
    evidence: Evidence,
    h: Ready,
    g: Hypothesis,
    unseen: Sequence[Unseen],
    y: np.ndarray,
    count: int,
    rng: np.random.Generator,
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Draws (count,) of the parameters under a hypothesis, and which of the unseen effects (count, k) each holds.

    Subsets are proposed from what the data say of each effect by itself and drawn again by what they say of all
    together (sampling–importance resampling, Rubin 1988).
    """
    taken, own = {e.source for e in g.effects}, {e.name for e in g.effects}
    m = SUBSETS_PER_DRAW * count + N_MORE_SUBSETS
    there, Y, log_w = np.zeros((m, len(unseen)), bool), np.tile(y, (m, 1)), np.zeros(m)
    for j, u in enumerate(unseen):
        if u.effect.source in taken:
            there[:, j] = u.effect.name in own
            continue
        there[:, j] = rng.random(m) < u.present
        mine = np.nonzero(there[:, j])[0]
        size = rng.choice(len(u.gained), size=len(mine), p=np.exp(u.gained - logsumexp(u.gained)))
        Y[mine] -= u.adds[size]
        log_w[mine] -= u.gained[size]
    log_w += mixture_log_evidence(h, h.white(Y))
    picked = rng.choice(m, size=count, p=np.exp(log_w - logsumexp(log_w)))
    return draws(evidence.bench.library, posterior_each(h, h.white(Y[picked]), rng)), there[picked]


def _told(
    values: np.ndarray,
    alone: tuple[float, float, float],
    there: Mapping[str, np.ndarray],
    quantiles: Callable[[np.ndarray], tuple[float, float, float]],
) -> Reach:
    """Which effects widen the interval of the draws (m,) most: what is named, and what stands behind its ends."""
    whole, without, left = quantiles(values), None, np.ones(len(values), bool)
    by: list[str] = []
    width = lambda v: v[2] - v[0]  # noqa: E731
    while len(by) < MAX_NAMED_EFFECTS:
        tried = {n: left & ~v for n, v in there.items() if n not in by and np.sum(left & ~v) >= MIN_INTERVAL_DRAWS}
        ends = {n: quantiles(values[v]) for n, v in tried.items()}
        best = min(ends, key=lambda n: width(ends[n]), default=None)
        if best is None or width(ends[best]) > NAMED_EFFECT_WIDTH_RATIO * width(without or whole):
            break
        without, left = ends[best], tried[best]
        by.append(best)
    behind = []
    for tail in (values < alone[0], values > alone[2]):
        often = (
            {n: np.mean(v[tail]) / max(np.mean(v), 1e-9) for n, v in there.items()}
            if tail.sum() >= MIN_INTERVAL_DRAWS
            else {}
        )
        behind.append(
            max(
                (n for n in often if often[n] > TAIL_FREQUENCY_RATIO),
                key=lambda n: np.mean(there[n][tail]),
                default=None,
            )
        )
    return Reach(whole, alone, tuple(by), without, *behind)


def _drawn(e: Effect, n: int, rng: np.random.Generator) -> np.ndarray:
    """Signed deviations (n, knobs) of an effect from its prior, one in each nth of it."""
    from scipy.stats import qmc  # half a second to import

    share = qmc.LatinHypercube(len(e.knobs), rng=rng).random(n)
    sides, (first, *shape) = e.size.ends(), share.T
    side, within = np.minimum((len(sides) * first).astype(int), len(sides) - 1), (len(sides) * first) % 1.0
    near, far = np.array(sides)[side].T
    if e.size.neutral is None:
        size = near + within * (far - near)
    else:
        size = near * (far / near) ** within
    spans = [s.ends()[0] for s in e.shape]
    return np.column_stack([size, *(low + v * (high - low) for v, (low, high) in zip(shape, spans, strict=True))])


def _calibrated(e: Effect, n: int, sd: float) -> np.ndarray:
    """Signed deviations (n, 1) of an effect of standard uncertainty `sd`, of one side where it has one."""
    sides = e.size.ends()
    share = (np.arange(n) + 0.5) / n
    if len(sides) == 1:
        return (np.sign(sides[0][1]) * sd * ndtri(0.5 + 0.5 * share))[:, None]
    return (sd * ndtri(share))[:, None]
