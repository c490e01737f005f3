"""Which hypothesis: evidence of every effect, of pairs and of something unexplained, against a simulated null.

    P(H | y) ∝ π(H) ∫ p(y | θ, φ, H) p(θ, φ | H) dθ dφ

The integral is exact within the tiles of :mod:`.gaussian_mixture`.  Whether there is a gap at all is decided by the
distribution of the same statistic over data simulated from the base model through the same pipeline.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.special import logsumexp

from rso.contract import parameters_of
from rso.data import Chain
from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.gaussian_mixture import (
    Ready,
    Tiles,
    Whitening,
    log_tiles,
    mean_prediction,
    mixture_log_evidence,
    posterior,
    ready,
    whitened_draws,
    whitening,
)
from rso.discrepancy.evidence.hypotheses import Hypothesis, tiles
from rso.discrepancy.evidence.model_form_tolerance import with_tolerance
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, DiagnosisSettings, HypothesisPriors
from rso.discrepancy.evidence.shrinkage import experiment_blocks
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import Test

# of the largest plausible size of what scatters, from which its size is read
SCATTER_SIZE_SHARES = np.geomspace(0.02, 1.5, 25)
N_SURVIVING_EFFECTS = 5  # effects whose pairs are tried, and whose evidence is computed in full
N_NULL_DATA_SETS = 400  # simulated without a gap: twenty lie beyond a false alarm of 5 %


@dataclass(frozen=True, eq=False)
class Shared:
    """What all hypotheses share: library, noise, μ₀, tiles by effect names, whitening without and with a free gap.

    Of `whites` the first has no gap, then come the free gaps in all experiments, then those of each of `alone`, if any.
    """

    library: Library
    levels: Mapping[str, noise.NoiseLevel]
    modulus: float
    C: np.ndarray
    whites: tuple[Whitening, ...]
    scatter: Mapping[str, np.ndarray]
    tiles: dict[tuple[str, ...], Tiles] = field(default_factory=dict)
    alone: tuple[str, ...] = ()
    settings: DiagnosisSettings = DIAGNOSIS_SETTINGS

    def covariance(self, effects: Sequence[Effect], share: float) -> np.ndarray:
        """C (n, n), with what differs from curve to curve at a share of its largest plausible size."""
        C = self.C
        for e in effects:
            if e.family == "scatter":
                g = self.scatter[e.name] * (share * e.size.high)
                C = C + np.einsum("ti,tj->ij", g, g)
        return C

    def of(self, effects: Sequence[Effect], loose: bool = False) -> Tiles:
        """Tiles of a set of effects, made once; scatter moves no mean.

        `loose` ones allow for what another code, or nature, makes of the effect itself: see :func:`with_tolerance`.
        """
        effects = [e for e in effects if e.family != "scatter"]
        key = (*(e.name for e in effects), *(("loose",) if loose else ()))
        if key not in self.tiles:
            if loose and effects:
                own, base = self.of(effects), self.of(())
                self.tiles[key] = with_tolerance(
                    self.library, effects, own, base, self.modulus, self.settings.tolerance
                )
            else:
                self.tiles[key] = tiles(self.library, effects, self.modulus, len(effects) > 1, self.of(()))
        return self.tiles[key]


def set_up(
    library: Library, y: np.ndarray, binding: bool = False, settings: DiagnosisSettings = DIAGNOSIS_SETTINGS
) -> Shared:
    """Noise from the plan's readings, the base model fitted once to weight them, and the free competitor.

    `binding` as in :func:`noise.noise_levels`.

    The free gap is orthogonal to what a re-fit of the base model can do: K⊥ = (I − H) K (I − H)ᵀ.
    """
    levels, priors, error = (
        noise.noise_levels(library.plan, binding, settings.noise),
        settings.priors,
        settings.model_error,
    )
    modulus = np.sqrt(library.base.low * library.base.high)
    base = tiles(library, (), modulus)
    rough = np.zeros(len(y))
    for item, c, at in library.plan.rows():
        reading = levels[c if c in levels else "uz"].of(item.experiment).white
        rough[at] = reading**2 + (0.03 * np.max(np.abs(y[at]))) ** 2
    force, slope = np.zeros(len(y)), np.zeros(len(y))
    C = np.diag(rough)
    for _ in range(2):
        white = whitening(C)
        h = ready(base, white, modulus)
        force = white.L @ mean_prediction(h, white(y))
        best = posterior(h, white(y), 200, np.random.default_rng(0))
        modulus = float(np.median(best.modulus))
        base = tiles(library, (), modulus)
        slope = noise.slope_of(library, force)
        C = noise.data_covariance(library, levels, force, slope, error)
    white = whitening(C)
    h = ready(base, white, modulus)
    best_tile = int(np.argmax(np.bincount(posterior(h, white(y), 200, np.random.default_rng(0)).tile)))
    J = h.X[best_tile] @ h.Q.T
    H = white.L @ (J.T @ np.linalg.solve(J @ J.T + 1e-9 * np.eye(len(J)), J @ np.linalg.inv(white.L)))
    off, curves = np.eye(len(y)) - H, experiment_blocks(library)
    gaps = [noise.gap_covariance(library, force, *gap, error.lateral) for gap in priors.gaps]
    for gap in priors.alone if len(curves) > 1 else ():
        K = noise.gap_covariance(library, force, *gap, error.lateral)
        gaps += [K * np.outer(here, here) for _, _, rows in curves for here in [np.isin(np.arange(len(y)), rows)]]
    whites = [white, *(whitening(C + off @ K @ off.T) for K in gaps)]
    alone = tuple(name for name, *_ in curves) if len(gaps) > len(priors.gaps) else ()
    centre = base.at[best_tile][None]
    scatter = {e.name: by_test(library, e, centre, modulus) for e in library.effects if e.family == "scatter"}
    return Shared(library, levels, modulus, C, tuple(whites), scatter, {(): base}, alone, settings)


def by_test(library: Library, scatter: Effect, centre: np.ndarray, modulus: float) -> np.ndarray:
    """∂y/∂knob (tests, n): what the knob of the chain does to each test by itself."""
    p = next(p for p in parameters_of(Chain) if p.name == scatter.cause)
    assert p.plausible is not None and p.neutral is not None  # so is every knob of the chain
    away = [v - p.neutral for v in p.plausible]
    by = scatter.size.high / max(map(abs, away))  # of a plan of the usual lengths and forces 1
    low, high = (p.neutral + by * v for v in away)
    size = replace(scatter.size, name=p.name, low=low, high=high, neutral=p.neutral)
    knob = Effect(scatter.cause, scatter.description, "measurement", size)
    step = 0.05 * scatter.size.high
    ends = [predict(library, (knob,), np.append(centre, [[s * step]], axis=1), modulus)[0][0] for s in (-1.0, 1.0)]
    g = modulus * (ends[1] - ends[0]) / (2 * step)
    out = np.zeros((len(library.plan.tests), library.plan.n))
    for item, _, at in library.plan.rows():
        if isinstance(item, Test):
            out[library.plan.tests.index(item), at] = g[at]
    return out


@dataclass(frozen=True, eq=False)
class Comparison:
    """Hypotheses with log evidence and prior: the first is the base model."""

    hypotheses: tuple[Hypothesis, ...]
    log_evidence: np.ndarray
    log_prior: np.ndarray
    no_gap: float = DIAGNOSIS_SETTINGS.priors.no_gap

    @property
    def probability(self) -> np.ndarray:
        """P(H | y) with the stated prior of a gap."""
        s = self.log_evidence + self.log_prior
        return np.exp(s - logsumexp(s))

    @property
    def statistic(self) -> float:
        """ln of the Bayes factor of any gap against none."""
        s = self.log_evidence + self.log_prior
        return float(logsumexp(s[1:]) - np.log(1 - self.no_gap) - s[0] + np.log(self.no_gap))


class Evidence:
    """Evidence of single effects, with and without something unexplained, for many data sets at once."""

    def __init__(self, bench: Shared, effects: Sequence[Effect]) -> None:
        self.bench, self.effects = bench, tuple(effects)
        self._ready: dict[tuple[tuple[str, ...], int, bool], Ready] = {}

    def ready(self, effects: Sequence[Effect], white: int = 0, loose: bool = False) -> Ready:
        """A hypothesis in whitened coordinates, made once.

        `white` 0 is C, the others have a free gap; of an effect that scatters `white` is its level.
        """
        key = (tuple(e.name for e in effects), white, loose)
        if key not in self._ready:
            scatters = any(e.family == "scatter" for e in effects)
            L = (
                whitening(self.bench.covariance(effects, self.bench.settings.priors.scatter[white]))
                if scatters
                else self.bench.whites[white]
            )
            self._ready[key] = ready(self.bench.of(effects, loose), L, self.bench.modulus)
        return self._ready[key]

    def best(self, effects: Sequence[Effect], y: np.ndarray, unexplained: bool = False, loose: bool = False) -> Ready:
        """The level of scatter, or of what is unexplained, that suits y (n,) most."""
        levels = self._levels(effects, unexplained)
        return max(
            (self.ready(effects, k, loose) for k in levels), key=lambda h: mixture_log_evidence(h, h.white(y)[None])[0]
        )

    def scatter(self, effect: Effect, y: np.ndarray, level: float) -> tuple[float, float, float]:
        """Standard deviation of an effect that scatters, with the ends of its interval of probability `level`.

        From the evidence of y (n,) at shares of its largest plausible size, all alike likely before.
        """
        tiles, logs = self.bench.of((effect,)), []
        for share in SCATTER_SIZE_SHARES:
            white = whitening(self.bench.covariance((effect,), share))
            logs.append(mixture_log_evidence(ready(tiles, white, self.bench.modulus), white(y)[None])[0])
        weight = np.exp(np.array(logs) - logsumexp(logs))
        below = np.cumsum(weight) - 0.5 * weight  # in the middle of each share's part
        low, middle, high = np.exp(
            np.interp([(1 - level) / 2, 0.5, (1 + level) / 2], below, np.log(SCATTER_SIZE_SHARES))
        )
        return middle * effect.size.high, low * effect.size.high, high * effect.size.high

    def of_tests(self, effect: Effect, y: np.ndarray, sd: float) -> tuple[np.ndarray, np.ndarray]:
        """What each test has for itself (tests,) of an effect that scatters by `sd`, and its standard deviation.

        The base model is open as in its best tile, widely, so that what all tests share is the model's or their mean.
        """
        g = self.bench.scatter[effect.name]
        white = whitening(self.bench.covariance((effect,), sd / effect.size.high))
        h = ready(self.bench.of((effect,)), white, self.bench.modulus)
        w = white(y)
        X = h.X[int(np.argmax(log_tiles(h, w[None])[0]))] @ h.Q.T
        Q, _ = np.linalg.qr(X.T)
        G, r = white(g), w - mean_prediction(h, w)
        G = G - (G @ Q) @ Q.T
        shrunk = 1.0 - sd**2 * np.sum(G * G, axis=1)
        return sd**2 * (G @ r), sd * np.sqrt(np.clip(shrunk, 0.0, None))

    def _levels(self, effects: Sequence[Effect], unexplained: bool) -> range:
        if any(e.family == "scatter" for e in effects):
            return range(len(self.bench.settings.priors.scatter))
        if not unexplained:
            return range(1)
        return range(1, 1 + len(self.bench.settings.priors.gaps) if effects else len(self.bench.whites))

    def log_weights(self, effects: Sequence[Effect], unexplained: bool) -> np.ndarray:
        """ln of the prior share of every level: what is unexplained is in all experiments or, alike likely, in one."""
        n, shared = len(self._levels(effects, unexplained)), len(self.bench.settings.priors.gaps)
        if effects or not unexplained or n == shared:
            return np.full(n, -np.log(n))
        return -np.log(2.0 * np.where(np.arange(n) < shared, shared, n - shared))

    def odd(self, y: np.ndarray) -> tuple[str, float] | None:
        """The experiment that has most of what is unexplained for itself, and how probable it is that it alone has it;
        None where no experiment can be separated from others."""
        if not self.bench.alone:
            return None
        levels = map(partial(self.ready, ()), self._levels((), True))
        each = np.array([mixture_log_evidence(h, h.white(y)[None])[0] for h in levels]) + self.log_weights((), True)
        p = np.exp(each - logsumexp(each))
        priors = self.bench.settings.priors
        of_each = p[len(priors.gaps) :].reshape(len(priors.alone), -1).sum(axis=0)
        return self.bench.alone[int(np.argmax(of_each))], float(of_each.max())

    def of(
        self, effects: Sequence[Effect], Y: np.ndarray, unexplained: bool = False, loose: bool = False
    ) -> np.ndarray:
        """Log evidence (B,) of data Y (B, n)."""
        hypotheses = [self.ready(effects, k, loose) for k in self._levels(effects, unexplained)]
        each = [mixture_log_evidence(h, h.white(Y)) for h in hypotheses]
        return logsumexp(np.array(each) + self.log_weights(effects, unexplained)[:, None], axis=0)


def comparisons(
    evidence: Evidence,
    Y: np.ndarray,
    pairs: Sequence[tuple[Effect, Effect]] = (),
    partly: bool = True,
    finalists: frozenset[str] = frozenset(),
) -> list[Comparison]:
    """The contest of all hypotheses for every data set of Y (B, n); finalists, by cause, have tolerant tiles."""

    def column(h: Hypothesis) -> np.ndarray:
        return evidence.of(h.effects, Y, h.unexplained, bool(h.effects) and {e.source for e in h.effects} <= finalists)

    effects = evidence.effects
    hypotheses = [Hypothesis(()), *(Hypothesis((e,)) for e in effects), Hypothesis((), True)]
    if partly:
        hypotheses += [Hypothesis((e,), True) for e in effects if e.family != "scatter"]
    hypotheses += [Hypothesis(pair) for pair in pairs]
    table = np.array([column(h) for h in hypotheses]).T
    priors = evidence.bench.settings.priors
    prior = np.array([log_prior(h, effects, priors) for h in hypotheses])
    return [Comparison(tuple(hypotheses), row, prior, priors.no_gap) for row in table]


def log_prior(h: Hypothesis, effects: Sequence[Effect], priors: HypothesisPriors = DIAGNOSIS_SETTINGS.priors) -> float:
    """ln π(H) in a catalogue: causes of a kind share its probability, forms of a cause share that of the cause."""
    if not h.effects and not h.unexplained:
        return float(np.log(priors.no_gap))
    sources = {e.source for e in effects}
    kind, n = "unexplained", 1
    if len(h.effects) == 2:
        kind, n = "pair", len(sources) * (len(sources) - 1) // 2
    elif h.effects:
        (e,) = h.effects
        rivals = {o.source for o in effects if o.family != "scatter"} if h.unexplained else sources
        kind, n = "partly" if h.unexplained else "single", len(rivals) * sum(o.source == e.source for o in effects)
    return float(np.log(priors.of(kind) / max(n, 1)))


def survivors(contest: Comparison, count: int = N_SURVIVING_EFFECTS) -> list[Effect]:
    """Causes whose best hypothesis has the most evidence, alone or with something unexplained, in their best form."""
    best: dict[str, tuple[float, Effect]] = {}
    for h, z, p in zip(contest.hypotheses, contest.log_evidence, contest.log_prior, strict=True):
        for e in h.effects:
            if e.family == "scatter":
                continue
            best[e.name] = max(best.get(e.name, (-np.inf, e)), (z + p, e), key=lambda v: v[0])
    found: dict[str, Effect] = {}
    for _, e in sorted(best.values(), key=lambda v: -v[0]):
        found.setdefault(e.source, e)
    return list(found.values())[:count]


def pairs_of(effects: Sequence[Effect]) -> list[tuple[Effect, Effect]]:
    """All pairs."""
    return list(itertools.combinations(effects, 2))


def nulls(evidence: Evidence, y: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Data (count, n) simulated from the base model as fitted to y."""
    return simulated_data(evidence, (), y, count, seed)


def critical(null: np.ndarray, false_alarm: float = DIAGNOSIS_SETTINGS.rules.false_alarm) -> float:
    """The statistic beyond which there is a gap: p = (1 + number of `null` (n,) ≥ it) / (1 + n) ≤ `false_alarm` and
    a gap is more probable than none.  Infinite where n is too few to say so.
    """
    k = int(false_alarm * (len(null) + 1) * (1 + 1e-12))
    return max(float(np.sort(null)[-k]), 0.0) if k else np.inf


def simulated_data(
    evidence: Evidence, effects: Sequence[Effect], y: np.ndarray, count: int, seed: int, loose: bool = False
) -> np.ndarray:
    """Data (count, n) as a hypothesis fitted to y predicts them."""
    rng = np.random.default_rng(seed)
    h = evidence.best(effects, y, loose=loose)
    post = posterior(h, h.white(y), count, rng)
    return whitened_draws(h, post, rng) @ h.white.L.T
