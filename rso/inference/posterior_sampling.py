"""Draws of the posterior, with a flat prior inside the box: what the Gaussian approximation is checked against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import logsumexp

from rso.inference import posterior_grid
from rso.inference.intervals import Interval, gaussian_draws, log_volume
from rso.inference.least_squares import Fit
from rso.inference.likelihood import Misfit

MIN_INDEPENDENT_DRAWS = 300.0  # independent draws: a 5 % quantile is then within 0.13 standard deviations
# of the width of an interval: a larger difference of its ends is more than the scatter of the draws
INTERVAL_END_TOLERANCE = 0.15
# autocorrelation times that a chain must have: a shorter one does not know its own (Sokal 1997, §3)
MIN_AUTOCORRELATION_TIMES = 50.0
MAX_R_HAT = 1.05  # R-hat of ensembles that began apart, at most
MAX_PARAMETERS_ON_CELLS = 3  # parameters up to which the posterior is computed on cells
N_GRID_DRAWS = 8192  # from the cells, independent of each other


@dataclass(frozen=True, eq=False)
class Draws:
    """Points X (n, d) of the unit cube, the longest autocorrelation time (steps), the number of independent draws.

    `r_hat` is that of two ensembles, of the parameter where it is largest; None where the `method` is 'cells', whose
    draws are independent, and not 'chain'.
    """

    X: np.ndarray
    tau: float
    independent: float
    method: str = "cells"
    steps: int = 0
    r_hat: float | None = None

    @property
    def enough(self) -> bool:
        """Whether quantiles of these draws mean something."""
        return self.independent >= MIN_INDEPENDENT_DRAWS and not self.doubt

    @property
    def doubt(self) -> str:
        """Why the chain has not converged; empty if it has, or where there is none."""
        if self.r_hat is None:
            return ""
        if self.steps < MIN_AUTOCORRELATION_TIMES * self.tau:
            times = f"{self.steps / self.tau:.2g} autocorrelation times, not {MIN_AUTOCORRELATION_TIMES:.0f}"
            return f"its {self.steps} steps are {times}"
        return f"R-hat of two ensembles is {self.r_hat:.3g}, not below {MAX_R_HAT:g}" if self.r_hat > MAX_R_HAT else ""


def sample_posterior(
    misfit: Misfit, minima: Sequence[Fit], *, seed: int, along: np.ndarray | None = None, most: int = 4000
) -> Draws:
    """Draws of p(x | y) ∝ exp(−χ²/2) inside the unit cube.

    Up to `MAX_PARAMETERS_ON_CELLS` parameters on cells (:mod:`.posterior_grid`), which know the points `along` (k, d)
    of valleys; with more, or where the posterior is too thin for cells, by two ensembles of a Markov chain, until they
    are `MIN_AUTOCORRELATION_TIMES` autocorrelation times long and agree, or have made `most` steps each.
    """
    if misfit.model.box.d <= MAX_PARAMETERS_ON_CELLS:
        at = np.stack([m.x for m in minima])
        found = posterior_grid.cells(misfit, at if along is None else np.vstack([at, along]))
        if found is not None:
            X, independent = posterior_grid.draw_from_grid(misfit, found, N_GRID_DRAWS, seed)
            return Draws(X, 1.0, independent)
        most = min(most, 1000)  # so thin a posterior seldom lets a chain converge either
    return chain(misfit, minima, seed=seed, most=most)


def chain(misfit: Misfit, minima: Sequence[Fit], *, seed: int, walkers: int = 48, most: int = 4000) -> Draws:
    """The same by two ensembles of MCMC.

    Walkers start as draws of the Gaussian approximations at all minima, each with its share of the probability, and
    jump between these by the whole difference of two others; one call of the model serves half of them.
    Source: ter Braak, Stat. Comput. 16 (2006) 239 (differential evolution, jumps in §2), Goodman & Weare, CAMCoS 5
    (2010) 65 (stretch), both as in emcee (Foreman-Mackey et al., PASP 125 (2013) 306); Gelman & Rubin, Stat. Sci. 7
    (1992) 457 (R-hat).
    """
    d = len(minima[0].x)
    walkers = max(walkers, 2 * d + 2)
    both = [_ensemble(misfit, minima, walkers, seed, k) for k in range(2)]
    steps, states = 0, [start for _, start in both]
    for more in (250, 250, 500, 1000, 2000, 4000):
        if steps + more > most:
            break
        ahead = [
            sampler.run_mcmc(s, more, skip_initial_state_check=True)
            for (sampler, _), s in zip(both, states, strict=True)
        ]
        steps, states = steps + more, ahead
        found = _draws([sampler for sampler, _ in both], steps)
        if found.enough:
            break
    return found


def _ensemble(misfit: Misfit, minima: Sequence[Fit], walkers: int, seed: int, number: int) -> tuple[Any, np.ndarray]:
    """A sampler of emcee and where its walkers start."""
    import emcee  # 1.8 s with scipy.stats, which only this needs of it

    d, rng = len(minima[0].x), np.random.default_rng([seed, 11, number])
    near = [gaussian_draws(m.x, m.fisher, seed + number) for m in minima]
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
    sampler.random_state = np.random.RandomState((seed + 7919 * number) % 2**32).get_state()
    return sampler, start


def _draws(samplers: Sequence[object], steps: int) -> Draws:
    """Draws of every chain without its first quarter."""
    chains = [s.get_chain(discard=steps // 4) for s in samplers]  # type: ignore[attr-defined]
    tau = np.array([s.get_autocorr_time(discard=steps // 4, tol=0) for s in samplers])  # type: ignore[attr-defined]
    long, walkers, d = chains[0].shape
    longest = float(np.max(np.where(np.isfinite(tau), tau, long)))
    parts = [c.reshape(-1, d) for chain in chains for c in (chain[: long // 2], chain[long // 2 :])]
    independent = len(chains) * long * walkers / max(longest, 1.0)
    return Draws(np.concatenate(parts), longest, independent, "chain", long, r_hat(parts))


def r_hat(parts: Sequence[np.ndarray]) -> float:
    """√(1 + B/W), the largest of all parameters: B the variance of the means of the parts (n, d), W that within them.

    Source: Gelman & Rubin, Stat. Sci. 7 (1992) 457, eq. 20 for long chains.
    """
    means = np.stack([p.mean(axis=0) for p in parts])
    within = np.mean([p.var(axis=0, ddof=1) for p in parts], axis=0)
    return float(np.sqrt(1.0 + np.max(means.var(axis=0, ddof=1) / np.maximum(within, 1e-300))))


def agree(a: Interval, b: Interval) -> bool:
    """Whether two intervals have the same ends within `INTERVAL_END_TOLERANCE` of the wider one's width."""
    width = max(a.high - a.low, b.high - b.low, 1e-12)
    return max(abs(a.low - b.low), abs(a.high - b.high)) <= INTERVAL_END_TOLERANCE * width
