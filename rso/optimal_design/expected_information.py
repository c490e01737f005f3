"""What an experiment that nobody has done yet would show: by its Fisher information, and by data made up for it.

    F = Σ Jᵀ C⁻¹ J  over what exists and what is added,   sd(ln θ) = √diag (F + 12 I)⁻¹ in ln θ

is linear about one truth.  A valley that bends, or ends at a bound of the box, is not; so the same is asked of data:
readings drawn at a truth are inferred, and the spread of the posterior is averaged over the draws (preposterior
analysis).  Where the two agree the cheap one may be believed.
Source: Lindley, Ann. Math. Stat. 27 (1956) 986; Raiffa & Schlaifer, Applied Statistical Decision Theory, 1961, §4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from rso.core.distributions import normal_cdf, normal_pdf, normal_ppf
from rso.doe import Box, sobol_sequence
from rso.inference.intervals import CREDIBLE_LEVEL, profile_likelihood, standard_deviations
from rso.inference.least_squares import fit_at, levenberg_marquardt
from rso.inference.likelihood import MIN_ERROR_SHARE, Data, Misfit, Model
from rso.inference.sloppy_directions import UNIFORM_PRECISION, expected_sd, per_log

N_POINTS_ALONG, N_POINTS_ACROSS = 256, 64  # points of a posterior along the weakest parameter, and across it at each
# widths, from that of the sharpest set to the whole box, on which points along it are close enough
N_POSTERIOR_WIDTHS = 6
BOX_EDGE_SHARE = 0.01  # of the box: nearer to its end no central interval can hold a truth
ACROSS_WIDENING_RATIO = 2.5  # than the Gaussian across: data made up lie beside the truth


@dataclass(frozen=True, eq=False)
class PossibleExperiment:
    """All readings (n,) of an experiment by its `model`; the covariance (n, n) of their errors if x (d,) is true."""

    name: str
    model: Model
    covariance: Callable[[np.ndarray], np.ndarray]

    def whitening(self, x: np.ndarray) -> np.ndarray:
        """W (n, n) with Wᵀ W = C⁻¹ at x (d,)."""
        C, y = self.covariance(x), self.model.predict(x[None])[0]
        floor = MIN_ERROR_SHARE * (float(np.abs(y).max()) or 1.0)
        L = cholesky(C + floor**2 * np.eye(len(C)), lower=True)
        return solve_triangular(L, np.eye(len(C)), lower=True)

    def information(self, x: np.ndarray) -> np.ndarray:
        """Fisher information (d, d) in the unit cube at x (d,)."""
        J = self.whitening(x) @ self.model.jacobian(x)
        return J.T @ J


@dataclass(frozen=True)
class ExpectedInformation:
    """What a set of experiments shows at one truth: sd of ln θ by name.

    `alone` without what exists, `fisher` with it, `expected` the same from simulated data (root mean square),
    `coverage` the share of those whose 90 % interval of the weakest parameter holds the truth (None: not asked, or the
    truth is an end of the box).
    """

    added: tuple[str, ...]
    alone: Mapping[str, float]
    fisher: Mapping[str, float]
    expected: Mapping[str, float] | None = None
    coverage: float | None = None


def on_valley(misfit: Misfit, start: np.ndarray, parameter: int, values: np.ndarray) -> np.ndarray:
    """Points (k, d) with a parameter at given places (k,) of the unit cube and the others where the data want them."""
    X = np.repeat(start[None], len(values), axis=0)
    X[:, parameter] = values
    return levenberg_marquardt(misfit, X, np.arange(len(start)) != parameter)


def expected_information(
    box: Box,
    x: np.ndarray,
    weakest: int,
    existing: Sequence[PossibleExperiment],
    sets: Sequence[Sequence[PossibleExperiment]],
    seed: int,
    draws: int = 60,
) -> list[ExpectedInformation]:
    """What each of the sets (the empty one: nothing more) adds to what exists, if x (d,) is true.

    With `draws` = 0 by Fisher information alone.
    """
    base = sum((e.information(x) for e in existing), np.zeros((box.d, box.d)))
    every = {e.name: e for added in sets for e in added}
    info = {n: e.information(x) for n, e in every.items()}
    rows = [sum((info[e.name] for e in added), np.zeros((box.d, box.d))) for added in sets]
    names = [tuple(e.name for e in added) for added in sets]
    sds = [(expected_sd(box, x, F), expected_sd(box, x, base + F)) for F in rows]
    if not draws:
        return [ExpectedInformation(n, a, f) for n, (a, f) in zip(names, sds, strict=True)]
    sharpest = min(float(standard_deviations(base + F + UNIFORM_PRECISION * np.eye(box.d))[weakest]) for F in rows)
    X, log_q = _points(box, x, weakest, existing, base, sharpest, seed)
    rng = np.random.default_rng([seed, 21])
    one = {e.name: _chi2(e, x, X, draws, rng) for e in (*existing, *every.values())}
    start = sum((one[e.name] for e in existing), np.zeros((len(X), draws)))
    out = []
    for n, (a, f) in zip(names, sds, strict=True):
        total = start + sum((one[k] for k in n), np.zeros_like(start))
        sd, covered = _posterior(box, x, weakest, X, log_q, total)
        out.append(ExpectedInformation(n, a, f, sd, covered))
    return out


def _points(
    box: Box,
    x: np.ndarray,
    weakest: int,
    existing: Sequence[PossibleExperiment],
    fisher: np.ndarray,
    sharpest: float,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, d) that cover the posterior of what exists, and ln of their density but for a constant (n,).

    Along the weakest parameter over the whole box, the closer the nearer to the truth, so that the `sharpest` set
    (a standard deviation) is resolved too; across it Gaussian about the bottom of the valley, wider than data allow.
    """
    data = []
    for e in existing:
        y, C = e.model.predict(x[None])[0], e.covariance(x)
        data.append(Data(e.name, "", np.arange(1.0, len(y) + 1), y, C))
    model = Model(box, lambda X: np.concatenate([e.model.predict(X) for e in existing], axis=1))
    misfit = Misfit(model, tuple(data))
    valley = profile_likelihood(misfit, fit_at(misfit, x), weakest)
    others = np.arange(box.d) != weakest
    t, log_t = _along(float(x[weakest]), sharpest)
    X = np.repeat(np.stack([np.interp(t, valley.at, p) for p in valley.path.T], axis=1), N_POINTS_ACROSS, axis=0)
    X[:, weakest], log_t = np.repeat(t, N_POINTS_ACROSS), np.repeat(log_t, N_POINTS_ACROSS)
    if not others.any():
        return X, log_t
    z = sobol_sequence(int(others.sum()), N_POINTS_ALONG * N_POINTS_ACROSS, [seed, 22])
    z = normal_ppf(np.clip(z, 1e-9, 1 - 1e-9))
    part = fisher[np.ix_(others, others)] + UNIFORM_PRECISION * np.eye(int(others.sum()))
    X[:, others] += ACROSS_WIDENING_RATIO * z @ np.linalg.inv(np.linalg.cholesky(part))
    outside = np.any((X < 0) | (X > 1), axis=1)
    return np.clip(X, 0, 1), np.where(outside, np.inf, log_t - 0.5 * np.sum(z**2, axis=1))


def _along(truth: float, sharpest: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n,) of [0, 1] and ln of their density: a mixture of uniform and Gaussians of all widths about a truth."""
    widths = np.geomspace(min(2.0 * sharpest, 0.5), 0.5, N_POSTERIOR_WIDTHS)
    fine = np.unique(
        np.clip(
            np.concatenate([truth + np.outer(widths, np.linspace(-5, 5, 401)).ravel(), np.linspace(0, 1, 2001)]), 0, 1
        )
    )
    shares = [
        fine,
        *(
            (normal_cdf((fine - truth) / w) - normal_cdf(-truth / w))
            / (normal_cdf((1 - truth) / w) - normal_cdf(-truth / w))
            for w in widths
        ),
    ]
    t = np.interp((np.arange(N_POINTS_ALONG) + 0.5) / N_POINTS_ALONG, np.mean(shares, axis=0), fine)
    heights = [
        np.ones_like(t),
        *(normal_pdf((t - truth) / w) / w / (normal_cdf((1 - truth) / w) - normal_cdf(-truth / w)) for w in widths),
    ]
    return t, np.log(np.mean(heights, axis=0))


def _chi2(e: PossibleExperiment, x: np.ndarray, X: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
    """χ² (n, draws) of the points X (n, d) against data made up at x (d,)."""
    W = e.whitening(x)
    P = (e.model.predict(X) - e.model.predict(x[None])[0]) @ W.T
    E = rng.standard_normal((draws, len(W)))
    return np.sum(P**2, axis=1)[:, None] - 2 * P @ E.T + np.sum(E**2, axis=1)


def _posterior(
    box: Box, x: np.ndarray, weakest: int, X: np.ndarray, log_q: np.ndarray, chi2: np.ndarray
) -> tuple[dict[str, float], float | None]:
    """Root mean square of the posterior sd of ln θ over the data sets, and how often the interval holds the truth."""
    ln = -0.5 * chi2 - log_q[:, None]
    w = np.exp(ln - ln.max(axis=0))
    w /= w.sum(axis=0)
    mean = w.T @ X
    variance = np.maximum(w.T @ X**2 - mean**2, 0.0)
    sd = np.sqrt(variance.mean(axis=0)) / per_log(box, x)
    order = np.argsort(X[:, weakest], kind="stable")
    below = np.cumsum(w[order], axis=0)[np.searchsorted(X[order, weakest], x[weakest]).clip(0, len(X) - 1)]
    tail = 0.5 * (1 - CREDIBLE_LEVEL)
    inside = BOX_EDGE_SHARE < x[weakest] < 1 - BOX_EDGE_SHARE
    covered = float(np.mean((below > tail) & (below < 1 - tail))) if inside else None
    return {n: float(s) for n, s in zip(box.names, sd, strict=True)}, covered
