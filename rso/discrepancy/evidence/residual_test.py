"""What a cause leaves: whether any other effect shows in it, against data simulated from that cause.

    S = max_e |d_eᵀ r|,    d_e = P L⁻¹ Δ_e / |P L⁻¹ Δ_e|                                         (score test, Rao 1948)

r is what the hypothesis as fitted leaves of whitened data, Δ_e the change by another effect at one of its sizes and
shapes, P takes out what the hypothesis itself can move.  S has no table: it is the largest of many that depend on each
other, so it is compared with that of N_RESIDUAL_DATA_SETS data sets simulated from the hypothesis.  Less the fit to the
data they have what their own fits would leave, as far as the hypothesis is linear there; beyond, the comparison is a
little strict.

χ² of all readings does not see this: a cause that is not the true one, but fits best, leaves some 40 of it, while by
noise alone χ² of 650 readings scatters by 36.  What is left of an effect in no catalogue looks like something, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.gaussian_mixture import (
    Posterior,
    Ready,
    log_tiles,
    mean_prediction,
    posterior,
    whitened_draws,
)
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.library.effects import Effect

N_RESIDUAL_DATA_SETS = 200  # simulated from the cause: two lie beyond the level below
RESIDUAL_TEST_LEVEL = 0.01  # chance that nothing but the cause leaves as much
MAX_RESIDUAL_EFFECTS = 3  # effects that are named as like what is left
MIN_UNABSORBED_SHARE = 0.1  # of a change: if the hypothesis can move all but this much of it, the rest says nothing


@dataclass(frozen=True)
class ResidualScore:
    """The effect that shows most in what a hypothesis (`of`) leaves, its score, and what few simulated data reach.

    `alike` are it and the next ones beyond that threshold, `MAX_RESIDUAL_EFFECTS` at most: effects look like each
    other.
    """

    of: str
    effect: Effect | None
    score: float
    threshold: float
    alike: tuple[Effect, ...] = ()

    @property
    def there(self) -> bool:
        """Whether it is more than noise."""
        return self.score > self.threshold


def residual_score(evidence: Evidence, hypothesis: Hypothesis, y: np.ndarray, seed: int) -> ResidualScore:
    """What a hypothesis of single effects, as fitted to y (n,), leaves."""
    name, rng = Hypothesis(hypothesis.effects).name, np.random.default_rng(seed)
    h = evidence.best(hypothesis.effects, y, loose=bool(hypothesis.effects))
    post = posterior(h, h.white(y), N_RESIDUAL_DATA_SETS, rng)
    W = np.concatenate([h.white(y)[None], whitened_draws(h, post, rng)])
    r = W - mean_prediction(h, W[0])  # fits of each would differ along what is taken out of d
    sources = {e.source for e in hypothesis.effects}
    others = [e for e in evidence.effects if e.family != "scatter" and e.source not in sources]
    changes = [_changes(evidence, e, post) for e in others]
    if not changes:
        return ResidualScore(name, None, 0.0, np.inf)
    Δ = h.white(np.concatenate(changes))
    d = _projected(Δ, h, W[0])
    length, whole = (np.linalg.norm(v, axis=1) for v in (d, Δ))
    shows = np.nonzero(length > np.maximum(MIN_UNABSORBED_SHARE * whole, 1e-6))[0]
    if not len(shows):
        return ResidualScore(name, None, 0.0, np.inf)
    S = np.abs(r @ (d[shows] / length[shows, None]).T)
    owner = np.repeat(np.arange(len(others)), [len(c) for c in changes])
    threshold = float(np.quantile(S[1:].max(axis=1), 1 - RESIDUAL_TEST_LEVEL))
    best = np.array([max(S[0][owner[shows] == k], default=0.0) for k in range(len(others))])
    alike = tuple(others[k] for k in np.argsort(-best)[:MAX_RESIDUAL_EFFECTS] if best[k] > threshold)
    return ResidualScore(name, others[int(np.argmax(best))], float(best.max()), threshold, alike)


def _changes(evidence: Evidence, effect: Effect, post: Posterior) -> np.ndarray:
    """What an effect changes (m, n) at every size and shape of its tiles, at the base's tile nearest to a posterior."""
    base, h = evidence.ready(()).tiles, evidence.ready((effect,)).tiles
    d = base.at.shape[1]
    spread = np.ptp(base.at, axis=0) + 1e-12
    t = int(np.argmin(np.sum(((base.at - np.median(post.at[:, :d], axis=0)) / spread) ** 2, axis=1)))
    near = np.all(np.abs(h.at[:, :d] - base.at[t]) < 1e-9, axis=1)
    μ = float(np.median(post.modulus))
    return μ * (h.lift(h.A[near]) - base.lift(base.A[t])) + h.lift(h.c[near]) - base.lift(base.c[t])


def _projected(v: np.ndarray, h: Ready, y: np.ndarray) -> np.ndarray:
    """Whitened vectors v (m, n) less what the tile of a hypothesis that suits whitened y (n,) most can move."""
    J = h.X[int(np.argmax(log_tiles(h, y[None])[0]))] @ h.Q.T
    U, s, _ = np.linalg.svd(J.T / np.maximum(np.linalg.norm(J, axis=1), 1e-300), full_matrices=False)
    Q = U[:, s > 1e-8 * s[0]]  # the directions of a tile depend on each other
    return v - (v @ Q) @ Q.T
