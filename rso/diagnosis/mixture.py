"""Hypotheses as mixtures of local linear models: evidence, posterior and simulation without sampling or Laplace.

In tile t the data are   y = μ a_t + c_t + μ₀ D_tᵀ ξ + e,   ξ ~ N(0, diag sd²),   e ~ N(0, C),   μ flat,

so that the evidence of a tile is a Gaussian integral and that of a hypothesis their sum: effects at the boundary of
their range, curved valleys and several minima need no approximation but the tiles' width.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import logsumexp


@dataclass(frozen=True, eq=False)
class Tiles:
    """A hypothesis: force parts A (T, n), displacement parts c (T, n), directions D (T, k, n), their spread sd (k,).

    `at` (T, d) are the coordinates of the tiles; `axes` (k,) says which coordinate a direction moves (−1: none), on
    `log` ones (k,) in proportion; `log_prior` (T,) sums to 1.
    """

    A: np.ndarray
    c: np.ndarray
    D: np.ndarray
    sd: np.ndarray
    at: np.ndarray
    log_prior: np.ndarray
    axes: tuple[int, ...]
    log: tuple[bool, ...]


@dataclass(frozen=True, eq=False)
class Whitening:
    """L of C = L Lᵀ and log |C| over the chosen `rows` of the data vector."""

    L: np.ndarray
    rows: np.ndarray

    def __call__(self, v: np.ndarray) -> np.ndarray:
        """L⁻¹ v over the last axis of v (…, n)."""
        flat = v[..., self.rows].reshape(-1, len(self.rows))
        return solve_triangular(self.L, flat.T, lower=True, check_finite=False).T.reshape(*v.shape[:-1], len(self.rows))

    @property
    def log_det(self) -> float:
        """log |C|."""
        return 2.0 * float(np.sum(np.log(np.diag(self.L))))


def whitening(C: np.ndarray, rows: np.ndarray | None = None) -> Whitening:
    """Cholesky factor of C, or of its chosen rows."""
    rows = np.arange(len(C)) if rows is None else np.asarray(rows)
    return Whitening(cholesky(C[np.ix_(rows, rows)], lower=True, check_finite=False), rows)


@dataclass(frozen=True, eq=False)
class Ready:
    """Tiles in whitened coordinates: X (T, 1 + k, n), W c (T, n), S⁻¹ (T, 1 + k, 1 + k) and constants (T,)."""

    tiles: Tiles
    X: np.ndarray
    c: np.ndarray
    S_inverse: np.ndarray
    constant: np.ndarray
    scale: float
    white: Whitening


def ready(tiles: Tiles, white: Whitening, modulus: float) -> Ready:
    """Everything of a hypothesis that does not depend on the values measured; `modulus` is μ₀."""
    X = np.concatenate([white(tiles.A)[:, None] * modulus, white(tiles.D) * modulus], axis=1)
    P = np.concatenate([[1e-8], tiles.sd**-2])  # flat, but for rows that know nothing of μ
    S = X @ X.transpose(0, 2, 1) + np.diag(P)
    _, log_det = np.linalg.slogdet(S)
    constant = tiles.log_prior - 0.5 * log_det - np.sum(np.log(tiles.sd)) - 0.5 * white.log_det
    return Ready(tiles, X, white(tiles.c), np.linalg.inv(S), constant - 0.5 * len(white.rows) * np.log(2 * np.pi)
                 + 0.5 * np.log(2 * np.pi), modulus, white)  # fmt: skip


def log_tiles(h: Ready, Y: np.ndarray) -> np.ndarray:
    """Log evidence (B, T) of whitened data Y (B, n) by tile, prior included."""
    T, k, n = h.X.shape
    b = (Y @ h.X.reshape(T * k, n).T).reshape(len(Y), T, k) - np.einsum("tkn,tn->tk", h.X, h.c)
    rr = np.sum(Y**2, axis=1)[:, None] - 2.0 * Y @ h.c.T + np.sum(h.c**2, axis=1)
    return h.constant - 0.5 * (rr - np.einsum("btk,tkl,btl->bt", b, h.S_inverse, b))


def log_evidence(h: Ready, Y: np.ndarray) -> np.ndarray:
    """Log evidence (B,) of whitened data Y (B, n); the flat prior of μ / μ₀ has density 1."""
    return logsumexp(log_tiles(h, Y), axis=1)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the modulus (m,) and of the coordinates (m, d), and their tile and local coordinates."""

    modulus: np.ndarray
    at: np.ndarray
    tile: np.ndarray
    local: np.ndarray


def posterior(h: Ready, y: np.ndarray, draws: int, rng: np.random.Generator) -> Posterior:
    """Draws given whitened data y (n,)."""
    logs = log_tiles(h, y[None])[0]
    weight = np.exp(logs - logsumexp(logs))
    tile = rng.choice(len(weight), size=draws, p=weight / weight.sum())
    k = h.X.shape[1]
    local = np.empty((draws, k))
    for t in np.unique(tile):
        mine = tile == t
        mean = h.S_inverse[t] @ (h.X[t] @ (y - h.c[t]))
        root = np.linalg.cholesky(h.S_inverse[t] + 1e-14 * np.trace(h.S_inverse[t]) * np.eye(k))
        local[mine] = mean + rng.standard_normal((mine.sum(), k)) @ root.T
    at = h.tiles.at[tile].copy()
    for j, (axis, log) in enumerate(zip(h.tiles.axes, h.tiles.log, strict=True)):
        if axis < 0:
            continue
        # a tile says nothing beyond its own surroundings
        ξ = np.clip(local[:, 1 + j] / np.maximum(local[:, 0], 0.1), -4 * h.tiles.sd[j], 4 * h.tiles.sd[j])
        at[:, axis] = at[:, axis] * np.exp(ξ) if log else at[:, axis] + ξ
    return Posterior(h.scale * local[:, 0], at, tile, local)


def simulate(h: Ready, post: Posterior, rng: np.random.Generator) -> np.ndarray:
    """Whitened data (m, n) as the draws predict them, with noise."""
    mean = np.einsum("mk,mkn->mn", post.local, h.X[post.tile]) + h.c[post.tile]
    return mean + rng.standard_normal(mean.shape)


def mean_prediction(h: Ready, y: np.ndarray) -> np.ndarray:
    """Posterior mean of the whitened prediction (n,) given whitened data y (n,)."""
    logs = log_tiles(h, y[None])[0]
    weight = np.exp(logs - logsumexp(logs))
    out = np.zeros_like(y)
    for t in np.nonzero(weight > 1e-6)[0]:
        out += weight[t] * (h.X[t].T @ (h.S_inverse[t] @ (h.X[t] @ (y - h.c[t]))) + h.c[t])
    return out / weight[weight > 1e-6].sum()
