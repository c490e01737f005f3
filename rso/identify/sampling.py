"""Draws of the posterior, with a flat prior inside the box: what the Gaussian approximation is checked against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rso.identify.fitting import Fit
from rso.identify.intervals import Interval, gaussian, log_volume
from rso.identify.likelihood import Misfit

ENOUGH = 300.0  # independent draws: a 5 % quantile is then within 0.13 standard deviations
AGREE = 0.15  # of the width of an interval: a larger difference of its ends is more than the scatter of the draws


@dataclass(frozen=True, eq=False)
class Draws:
    """Points X (n, d) of the unit cube, the longest autocorrelation time (steps), the number of independent draws."""

    X: np.ndarray
    tau: float
    independent: float

    @property
    def enough(self) -> bool:
        """Whether quantiles of these draws mean something."""
        return self.independent >= ENOUGH


def sample(
    misfit: Misfit, minima: Sequence[Fit], *, seed: int, walkers: int = 128, steps: int = 125, burn: int = 60
) -> Draws:
    """Ensemble MCMC of p(x | y) ∝ exp(−χ²/2) inside the unit cube.

    Walkers start as draws of the Gaussian approximations at all minima, each with its share of the probability, and
    jump between these by the whole difference of two others; one call of the model serves half of them.  If the draws
    are too few the chain goes on, up to four times as long.
    Source: ter Braak, Stat. Comput. 16 (2006) 239 (differential evolution, jumps in §2), Goodman & Weare, CAMCoS 5
    (2010) 65 (stretch), both as in emcee (Foreman-Mackey et al., PASP 125 (2013) 306).
    """
    import emcee  # 1.8 s with scipy.stats, which only this needs of it

    d = len(minima[0].x)
    walkers = max(walkers, 2 * d + 2)
    rng = np.random.default_rng([seed, 11])
    near = [gaussian(m.x, m.fisher, seed) for m in minima]
    log_mass = np.array([log_volume(m.x, m.fisher) - 0.5 * m.chi2 for m in minima])
    of = rng.choice(len(minima), walkers, p=np.exp(log_mass - logsumexp(log_mass)))
    counts = np.bincount(of, minlength=len(near))
    drawn = [X[rng.choice(len(X), n, replace=len(X) < n)] for X, n in zip(near, counts, strict=True)]
    start = np.concatenate(drawn)
    start = np.clip(start + 1e-6 * rng.standard_normal(start.shape), 1e-9, 1 - 1e-9)

    def log_probability(X: np.ndarray) -> np.ndarray:
        inside = np.all((X >= 0) & (X <= 1), axis=1)
        answer = np.full(len(X), -np.inf)
        if inside.any():
            answer[inside] = -0.5 * misfit.chi2(X[inside])
        return answer

    moves = [(emcee.moves.DEMove(), 0.6), (emcee.moves.DEMove(gamma0=1.0), 0.1), (emcee.moves.StretchMove(), 0.3)]
    sampler = emcee.EnsembleSampler(walkers, d, log_probability, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed % 2**32).get_state()
    state = sampler.run_mcmc(start, burn + steps, skip_initial_state_check=True)
    for _ in range(3):
        found = _draws(sampler, burn, walkers)
        if found.enough:
            break
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    return _draws(sampler, burn, walkers)


def _draws(sampler: object, burn: int, walkers: int) -> Draws:
    chain = sampler.get_chain(discard=burn)  # type: ignore[attr-defined]
    tau = sampler.get_autocorr_time(discard=burn, tol=0)  # type: ignore[attr-defined]
    longest = float(np.max(np.where(np.isfinite(tau), tau, len(chain))))
    return Draws(chain.reshape(-1, chain.shape[-1]), longest, len(chain) * walkers / max(longest, 1.0))


def agree(a: Interval, b: Interval) -> bool:
    """Whether two intervals have the same ends within `AGREE` of the wider one's width."""
    width = max(a.high - a.low, b.high - b.low, 1e-12)
    return max(abs(a.low - b.low), abs(a.high - b.high)) <= AGREE * width
