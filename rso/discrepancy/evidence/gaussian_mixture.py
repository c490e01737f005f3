"""Hypotheses as mixtures of local linear models: evidence, posterior and simulation without sampling or Laplace.

In tile t the data are   y = μ a_t + c_t + μ₀ D_tᵀ ξ + e,   ξ ~ N(0, diag sd²),   e ~ N(0, C),   μ flat,

or μ = μ_t where it is fixed, or μ = μ_t + μ₀ ξ_j where the coordinate j is ln μ (ξ_j is its change times μ/μ₀),

and a parameter with a range of its own has its ξ_j cut off at the ends of that,

so that the evidence of a tile is a Gaussian integral and that of a hypothesis their sum: effects at the boundary of
their range, curved valleys and several minima need no approximation but the tiles' width.

All vectors of a hypothesis lie in a space of few dimensions, span B; with L⁻¹ B = Q R everything is computed in the
coordinates R of that space, and Qᵀ takes the data there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import log_ndtr, logsumexp, ndtri_exp

MAX_TILE_DEVIATION_SD = 4.0  # standard deviations from the middle of a tile, twice the distance to the next one
COMPRESSION_TOLERANCE = 2e-5  # of the largest force: far below what readings scatter by


@dataclass(frozen=True)
class TileFactors:
    """A parameter p with a range of its own, `low` to `high` of ln p, whose coordinate is ln p + `slope` ln μ: one that
    the modulus takes along, so that its direction moves p alone."""

    slope: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Tiles:
    """A hypothesis: force parts A (T, r), displacement parts c (T, r), directions D (T, k, r), their spread sd (k,).

    `at` (T, d) are the coordinates of the tiles; `axes` (k,) says which coordinate a direction moves (−1: none), on
    `log` ones (k,) in proportion; `log_prior` (T,) sums to 1.  Vectors v (r,) stand for B v, B = `basis` (n, r), or for
    themselves where there is none.  `moduli` (T,) are those of the tiles, None where the modulus is free; the direction
    `tied` moves it too.  `kept` are directions of parameters with a range of their own.
    """

    A: np.ndarray
    c: np.ndarray
    D: np.ndarray
    sd: np.ndarray
    at: np.ndarray
    log_prior: np.ndarray
    axes: tuple[int, ...]
    log: tuple[bool, ...]
    basis: np.ndarray | None = None
    moduli: np.ndarray | None = None
    tied: int | None = None
    kept: Mapping[int, TileFactors] = field(default_factory=dict)

    def lift(self, v: np.ndarray) -> np.ndarray:
        """Vectors v (…, r) over the data (…, n)."""
        return v if self.basis is None else v @ self.basis.T

    def linear(self, X: np.ndarray, c: np.ndarray, modulus: float) -> tuple[np.ndarray, np.ndarray]:
        """Directions (T, k', r) and rest (T, r) that are left of X (T, 1 + k, r), first the force at μ₀, and c (T, r):
        a modulus that is not free is no direction, and one that is takes coordinates along."""
        X, along = X.copy(), np.zeros_like(c)
        for j, own in self.kept.items():
            along += own.slope * X[:, 1 + j]
        if self.moduli is None:
            X[:, 0] += along
            return X, c - along
        c = c + (self.moduli / modulus)[:, None] * X[:, 0]
        if self.tied is not None:
            X[:, 1 + self.tied] += X[:, 0] + along
        return X[:, 1:], c

    def spread(self, free: float, sd: np.ndarray) -> np.ndarray:
        """Variances (k',) of the directions that are left: `free` that of a free modulus over μ₀, and sd² (k,)."""
        return np.concatenate([[free] if self.moduli is None else [], sd**2])


def compressed(tiles: Tiles, blocks: Sequence[np.ndarray], also: np.ndarray, modulus: float) -> Tiles:
    """The same tiles on an orthonormal basis whose vectors each live on one of `blocks` (disjoint rows).

    No vector moves by more than COMPRESSION_TOLERANCE of the largest force part; `also` (m, n) are further vectors to
    be spanned.
    """
    T, k, n = tiles.D.shape
    parts = [tiles.A, tiles.c / modulus, (tiles.D * tiles.sd[:, None]).reshape(T * k, n), also]
    V = np.concatenate(parts)
    limit = (COMPRESSION_TOLERANCE * np.abs(tiles.A).max()) ** 2
    columns = []
    for rows in blocks:
        λ, Q = np.linalg.eigh(V[:, rows].T @ V[:, rows])
        B = np.zeros((n, int(np.sum(np.cumsum(np.maximum(λ, 0.0)) > limit))))
        B[rows] = Q[:, len(λ) - B.shape[1] :]
        columns.append(B)
    B = np.concatenate(columns, axis=1)
    return replace(tiles, A=tiles.A @ B, c=tiles.c @ B, D=tiles.D @ B, basis=B)


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
class RangeEnds:
    """Ends (T,) of the coordinate `at` of draws in tiles, where its parameter has those of its range at μ₀, and the
    spread `sd` before any data."""

    at: int
    low: np.ndarray
    high: np.ndarray
    sd: float


@dataclass(frozen=True, eq=False)
class Ready:
    """Tiles in whitened coordinates: X (T, k', q), c (T, q), S⁻¹ (T, k', k'), constants (T,), and Q (n, q).

    k' = 1 + k with a free modulus, else k.  `walls` are the ends of what is kept.
    """

    tiles: Tiles
    X: np.ndarray
    c: np.ndarray
    S_inverse: np.ndarray
    constant: np.ndarray
    scale: float
    white: Whitening
    Q: np.ndarray
    walls: tuple[RangeEnds, ...] = ()

    def middle(self, t: int) -> np.ndarray:
        """Whitened prediction (n,) in the middle of a tile, at μ₀ where the modulus is free."""
        return self.Q @ (self.c[t] + (self.X[t, 0] if self.tiles.moduli is None else 0.0))

    def state(self, tile: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Modulus over μ₀ (m,) and ξ (m, k) of draws `local` (m, k') in tiles (m,)."""
        if self.tiles.moduli is None:
            return local[:, 0], local[:, 1:]
        own = self.tiles.moduli[tile] / self.scale
        if self.tiles.tied is None:
            return own, local
        farthest = MAX_TILE_DEVIATION_SD * self.tiles.sd[self.tiles.tied]
        return own * (1.0 + np.clip(local[:, self.tiles.tied] / own, -farthest, farthest)), local


def ready(tiles: Tiles, white: Whitening, modulus: float) -> Ready:
    """Everything of a hypothesis that does not depend on the values measured; `modulus` is μ₀."""
    B = np.eye(len(tiles.A[0])) if tiles.basis is None else tiles.basis
    Q, R = np.linalg.qr(white(B.T).T)
    X = np.concatenate([(tiles.A @ R.T)[:, None], tiles.D @ R.T], axis=1) * modulus
    X, c = tiles.linear(X, tiles.c @ R.T, modulus)
    P = 1.0 / tiles.spread(1e8, tiles.sd)  # flat, but for rows that know nothing of μ
    S = X @ X.transpose(0, 2, 1) + np.diag(P)
    _, log_det = np.linalg.slogdet(S)
    constant = tiles.log_prior - 0.5 * log_det - np.sum(np.log(tiles.sd)) - 0.5 * white.log_det
    return Ready(
        tiles,
        X,
        c,
        np.linalg.inv(S),
        constant - 0.5 * len(white.rows) * np.log(2 * np.pi) + 0.5 * np.log(2 * np.pi),
        modulus,
        white,
        Q,
        _walls(tiles, modulus),
    )


def _walls(tiles: Tiles, modulus: float) -> tuple[RangeEnds, ...]:
    first, free = (modulus, 1) if tiles.moduli is None else (tiles.moduli, 0)
    found = []
    for j, own in tiles.kept.items():
        middle = tiles.at[:, tiles.axes[j]] - own.slope * np.log(first)
        found.append(RangeEnds(free + j, own.low - middle, own.high - middle, float(tiles.sd[j])))
    return tuple(found)


def _ends(h: Ready, wall: RangeEnds, mean: np.ndarray, tile: int | np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the local coordinate, which is a change times μ/μ₀, about the means (…, k') of tiles."""
    m = mean[..., 0] if h.tiles.moduli is None else h.tiles.moduli[tile] / h.scale
    return wall.low[tile] * np.maximum(m, 0.1), wall.high[tile] * np.maximum(m, 0.1)


def _log_mass(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """ln [Φ(b) − Φ(a)] for a < b, to every digit far out, too."""
    a, b = np.where(a > 0.0, -b, a), np.where(a > 0.0, -a, b)
    return log_ndtr(b) + np.log1p(-np.exp(log_ndtr(a) - log_ndtr(b)))


def _kept_share(h: Ready, mean: np.ndarray) -> np.ndarray:
    """ln of what share of each tile's Gaussian (B, T) lies within all walls, less that before any data."""
    out = np.zeros(mean.shape[:2])
    for wall in h.walls:
        low, high = _ends(h, wall, mean, slice(None))
        sd, at = np.sqrt(h.S_inverse[:, wall.at, wall.at]), mean[..., wall.at]
        out += _log_mass((low - at) / sd, (high - at) / sd) - _log_mass(low / wall.sd, high / wall.sd)
    return out


def _moved(h: Ready, t: int, mean: np.ndarray, local: np.ndarray | None = None) -> np.ndarray:
    """Draws `local` (m, k') of a tile's Gaussian of mean (k',) or (m, k'), or the mean, as they are within the walls.

    Along each wall's coordinate the distribution is cut off, quantile by quantile; the others follow by regression.
    """
    out = mean if local is None else local
    for wall in h.walls:
        S = h.S_inverse[t]
        i, sd = wall.at, np.sqrt(S[wall.at, wall.at])
        a, b = ((v - mean[..., i]) / sd for v in _ends(h, wall, mean, t))
        sign = np.where(a > 0.0, -1.0, 1.0)  # logarithms are good to the left
        a, b = np.minimum(sign * a, sign * b), np.maximum(sign * a, sign * b)
        if local is None:
            mass = _log_mass(a, b) + 0.5 * np.log(2 * np.pi)
            z, was = np.exp(-0.5 * a**2 - mass) - np.exp(-0.5 * b**2 - mass), 0.0
        else:
            was = sign * (local[:, i] - mean[..., i]) / sd
            z = ndtri_exp(np.logaddexp(log_ndtr(-was) + log_ndtr(a), log_ndtr(was) + log_ndtr(b)))
            z = np.clip(z, a, b)
        out = out + np.multiply.outer(sign * (z - was) * sd, S[:, i] / S[i, i])
    return out


def log_tiles(h: Ready, Y: np.ndarray) -> np.ndarray:
    """Log evidence (B, T) of whitened data Y (B, n) by tile, prior included."""
    T, k, q = h.X.shape
    Z = Y @ h.Q
    b = (Z @ h.X.reshape(T * k, q).T).reshape(len(Y), T, k) - np.einsum("tkq,tq->tk", h.X, h.c)
    rr = np.sum(Y**2, axis=1)[:, None] - 2.0 * Z @ h.c.T + np.sum(h.c**2, axis=1)
    mean = np.einsum("btk,tkl->btl", b, h.S_inverse, optimize=True)
    whole = h.constant - 0.5 * (rr - np.sum(mean * b, axis=2))
    return whole + _kept_share(h, mean) if h.walls else whole


def mixture_log_evidence(h: Ready, Y: np.ndarray) -> np.ndarray:
    """Log evidence (B,) of whitened data Y (B, n); the flat prior of μ / μ₀ has density 1."""
    return logsumexp(log_tiles(h, Y), axis=1)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the modulus (m,) and of the coordinates (m, d), and their tile and local coordinates.

    `strayed` (m, d): the data want a coordinate farther away than its tile knows anything of.
    """

    modulus: np.ndarray
    at: np.ndarray
    tile: np.ndarray
    local: np.ndarray
    strayed: np.ndarray


def posterior(h: Ready, y: np.ndarray, draws: int, rng: np.random.Generator) -> Posterior:
    """Draws given whitened data y (n,)."""
    logs = log_tiles(h, y[None])[0]
    weight = np.exp(logs - logsumexp(logs))
    tile = rng.choice(len(weight), size=draws, p=weight / weight.sum())
    k, z = h.X.shape[1], y @ h.Q
    local = np.empty((draws, k))
    for t in np.unique(tile):
        mine = tile == t
        mean = h.S_inverse[t] @ (h.X[t] @ (z - h.c[t]))
        root = np.linalg.cholesky(h.S_inverse[t] + 1e-14 * np.trace(h.S_inverse[t]) * np.eye(k))
        local[mine] = _moved(h, t, mean, mean + rng.standard_normal((mine.sum(), k)) @ root.T)
    return _placed(h, tile, local)


def posterior_each(h: Ready, Y: np.ndarray, rng: np.random.Generator) -> Posterior:
    """One draw given each of whitened data Y (m, n)."""
    logs = log_tiles(h, Y)
    weight = np.cumsum(np.exp(logs - logsumexp(logs, axis=1)[:, None]), axis=1)
    tile = np.minimum(np.sum(weight < rng.random((len(Y), 1)) * weight[:, -1:], axis=1), weight.shape[1] - 1)
    k, Z = h.X.shape[1], Y @ h.Q
    local = np.empty((len(Y), k))
    for t in np.unique(tile):
        mine = np.nonzero(tile == t)[0]
        mean = (Z[mine] - h.c[t]) @ h.X[t].T @ h.S_inverse[t]
        root = np.linalg.cholesky(h.S_inverse[t] + 1e-14 * np.trace(h.S_inverse[t]) * np.eye(k))
        local[mine] = _moved(h, t, mean, mean + rng.standard_normal((len(mine), k)) @ root.T)
    return _placed(h, tile, local)


def _placed(h: Ready, tile: np.ndarray, local: np.ndarray) -> Posterior:
    """Draws of local coordinates (m, k') in tiles (m,) with the coordinates that they mean."""
    at = h.tiles.at[tile].copy()
    strayed = np.zeros(at.shape, bool)
    m, moved = h.state(tile, local)
    for j, (axis, log) in enumerate(zip(h.tiles.axes, h.tiles.log, strict=True)):
        if axis < 0:
            continue
        # a tile says nothing beyond its own surroundings
        ξ, farthest = moved[:, j] / np.maximum(m, 0.1), MAX_TILE_DEVIATION_SD * h.tiles.sd[j]
        strayed[:, axis] = np.abs(ξ) >= farthest
        ξ = np.clip(ξ, -farthest, farthest)
        # the forces of a tile are linear in the size itself: s (1 + ξ), not s exp ξ, is where they stand
        floor = np.exp(-farthest)
        at[:, axis] = at[:, axis] * np.maximum(1.0 + ξ, floor) if log else at[:, axis] + ξ
        if j == h.tiles.tied:  # ln μ, to every digit: what is fixed stays so
            at[:, axis] = np.log(h.scale * m)
        elif own := h.tiles.kept.get(j):
            first = h.scale if h.tiles.moduli is None else h.tiles.moduli[tile]
            μ = h.scale * np.maximum(m, 0.1)
            at[:, axis] = own.slope * np.log(μ) + np.clip(at[:, axis] - own.slope * np.log(first), own.low, own.high)
    return Posterior(h.scale * m, at, tile, local, strayed)


def whitened_draws(h: Ready, post: Posterior, rng: np.random.Generator) -> np.ndarray:
    """Whitened data (m, n) as the draws predict them, with noise."""
    mean = (np.einsum("mk,mkq->mq", post.local, h.X[post.tile]) + h.c[post.tile]) @ h.Q.T
    return mean + rng.standard_normal(mean.shape)


def mean_prediction(h: Ready, y: np.ndarray) -> np.ndarray:
    """Posterior mean of the whitened prediction (n,) given whitened data y (n,)."""
    logs = log_tiles(h, y[None])[0]
    weight = np.exp(logs - logsumexp(logs))
    z = y @ h.Q
    out = np.zeros_like(z)
    for t in np.nonzero(weight > 1e-6)[0].tolist():
        out += weight[t] * (h.X[t].T @ _moved(h, t, h.S_inverse[t] @ (h.X[t] @ (z - h.c[t]))) + h.c[t])
    return h.Q @ out / weight[weight > 1e-6].sum()
