"""Designs of experiments in the unit cube, and the box that gives the cube its units.

Every design is an array `X` (n, d) with entries in [0, 1]; only :class:`Box` knows physical values.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.distance import cdist, pdist, squareform
from scipy.stats import qmc

KINDS = ("lhs", "sobol", "ccd", "box_behnken", "factorial", "osf")
Star = Literal["circumscribed", "inscribed", "face"]

# Resolution V fractions: (Box, Hunter & Hunter 2005, table 6.22): extra factor = product of these base factors.
_GENERATORS = {5: ((0, 1, 2, 3),), 6: ((0, 1, 2, 3, 4),), 7: ((0, 1, 2, 3, 4, 5),), 8: ((0, 1, 2, 3), (0, 1, 4, 5))}
# Blocks of Box & Behnken (1960), table 4: which factors sit at +-1 together.
_BLOCKS = {
    6: ((0, 1, 3), (1, 2, 4), (2, 3, 5), (0, 3, 4), (1, 4, 5), (0, 2, 5)),
    7: ((3, 4, 5), (0, 5, 6), (1, 4, 6), (0, 1, 3), (2, 3, 6), (0, 2, 4), (1, 2, 5)),
}


@dataclass(frozen=True)
class Box:
    """Ranges of the parameters: maps physical values θ (n, d) to the unit cube and back, linear or log each."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    log: tuple[bool, ...]

    def __post_init__(self) -> None:
        for name in ("names", "units", "low", "high", "log"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len({len(v) for v in (self.names, self.units, self.low, self.high, self.log)}) != 1 or not self.names:
            raise ValueError("box: names, units, low, high and log need one entry per parameter")
        for name, unit, low, high, log in zip(self.names, self.units, self.low, self.high, self.log, strict=True):
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise ValueError(f"box: {name} needs low < high, got [{low}, {high}] {unit}")
            if log and low <= 0:
                raise ValueError(f"box: {name} on a log scale needs low > 0, got [{low}, {high}] {unit}")

    @property
    def d(self) -> int:
        """Number of parameters."""
        return len(self.names)

    def from_unit(self, x: np.ndarray) -> np.ndarray:
        """θ = low + x (high − low), or low (high/low)^x on a log scale; x (..., d); 0 and 1 give the ends exactly."""
        x = self._check(x)
        low, high, log = np.array(self.low), np.array(self.high), np.array(self.log)
        ratio = np.where(log, high / np.where(log, low, 1.0), 1.0)
        theta = np.where(log, low * ratio**x, low + x * (high - low))
        return np.where(x == 0, low, np.where(x == 1, high, theta))

    def to_unit(self, theta: np.ndarray) -> np.ndarray:
        """Inverse of :meth:`from_unit`; θ (..., d). A value <= 0 on a log scale raises ValueError."""
        theta = self._check(theta)
        low, high, log = np.array(self.low), np.array(self.high), np.array(self.log)
        if np.any((theta <= 0) & log):
            bad = [
                n
                for n, b in zip(self.names, np.any((theta <= 0) & log, axis=tuple(range(theta.ndim - 1))), strict=True)
                if b
            ]
            raise ValueError(f"box: {', '.join(bad)} must be > 0 on a log scale")
        safe = np.where(log, low, 1.0)
        x = np.where(
            log,
            np.log(np.where(log, theta, 1.0) / safe) / np.log(np.where(log, high / safe, np.e)),
            (theta - low) / (high - low),
        )
        return np.where(theta == low, 0.0, np.where(theta == high, 1.0, x))

    def contains(self, theta: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
        """Mask (...,) of the θ (..., d) inside the box, up to `tolerance` of each range."""
        theta = self._check(theta)
        low, high = np.array(self.low), np.array(self.high)
        slack = tolerance * (high - low)
        return np.all((theta >= low - slack) & (theta <= high + slack), axis=-1)

    def _check(self, values: np.ndarray) -> np.ndarray:
        values = np.asarray(values, float)
        if values.shape[-1:] != (self.d,):
            raise ValueError(f"box: expected {self.d} values ({', '.join(self.names)}), got shape {values.shape}")
        return values


def design(
    kind: str,
    d: int,
    runs: int | None,
    seed: int,
    *,
    optimise: bool = True,
    star: Star = "circumscribed",
    alpha: float | None = None,
    levels: Sequence[int] | None = None,
) -> np.ndarray:
    """A design X (n, d) of the named kind in the unit cube.

    `runs` is needed by lhs, sobol and osf; the others have fixed counts: leave it None or state the right one.
    `optimise` lowers the centred discrepancy of an lhs; `star` and `alpha` belong to ccd, `levels` to factorial.

    Raises
    ------
    ValueError
        for an unknown kind or a number of runs that the kind does not have (the message says which it has).
    """
    if kind not in KINDS:
        raise ValueError(f"design: unknown kind {kind!r}; choose one of {', '.join(KINDS)}")
    if d < 1:
        raise ValueError(f"design: needs at least one parameter, got {d}")
    if kind in ("lhs", "sobol", "osf"):
        if runs is None or runs < 2:
            raise ValueError(f"design: {kind} needs runs >= 2, got {runs}")
        if kind == "lhs":
            return latin(d, runs, seed, optimise)
        return sobol(d, runs, seed) if kind == "sobol" else optimal_space_filling(d, runs, seed)
    if kind == "factorial":
        return factorial(d, runs, levels)
    X = central_composite(d, star, alpha) if kind == "ccd" else box_behnken(d)
    if runs is not None and runs != len(X):
        raise ValueError(f"design: {kind} of {d} parameters has {len(X)} runs, not {runs}; leave runs out or use lhs")
    return X


def latin(d: int, runs: int, seed: int, optimise: bool = True) -> np.ndarray:
    """Latin hypercube (runs, d): one point per row of cells; `optimise` swaps for low centred discrepancy."""
    # Never scipy's 'lloyd': it moves the points off their cells and took minutes at n = 120, d = 10.
    method = "random-cd" if optimise and d > 1 else None
    return qmc.LatinHypercube(d, optimization=method, rng=np.random.default_rng(seed)).random(runs)


def sobol(d: int, runs: int, seed: int) -> np.ndarray:
    """First `runs` points of a scrambled Sobol sequence (runs, d); balanced where runs is a power of two."""
    m = max(1, int(np.ceil(np.log2(runs))))
    return qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random_base2(m)[:runs]


def factorial(d: int, runs: int | None = None, levels: Sequence[int] | None = None) -> np.ndarray:
    """Every combination of `levels[j]` equidistant values per parameter (both ends included).

    Without `levels`, `runs` must be a power L^d with L >= 2, otherwise ValueError names the nearest ones.
    """
    if levels is None:
        if runs is None:
            raise ValueError("design: factorial needs runs or levels")
        L = max(2, round(runs ** (1 / d)))
        if L**d != runs:
            near = sorted({max(2, L - 1) ** d, L**d, (L + 1) ** d})
            raise ValueError(f"design: factorial of {d} parameters has levels^{d} runs, not {runs}; try one of {near}")
        levels = (L,) * d
    if len(levels) != d or min(levels) < 2:
        raise ValueError(f"design: factorial needs {d} levels >= 2, got {list(levels)}")
    if runs is not None and runs != int(np.prod(levels)):
        raise ValueError(f"design: levels {list(levels)} give {int(np.prod(levels))} runs, not {runs}")
    return np.array(list(itertools.product(*(np.linspace(0, 1, L) for L in levels))))


def central_composite(d: int, star: Star = "circumscribed", alpha: float | None = None) -> np.ndarray:
    """Central composite design: corners, 2d star points and one centre (a computed centre repeats exactly).

    In coded units the corners sit at ±1 and the star points at ±α. α = 1 is face-centred; the default is
    rotatable, α = F^(1/4) with F corners (Box & Hunter 1957). The ranges are hard limits here, so a design
    with α > 1 is shrunk until its star points lie on the faces: `circumscribed` and `inscribed` then name
    the same points. From 5 parameters on the corners are a resolution V fraction.
    """
    if not 2 <= d <= 8:
        raise ValueError(f"design: ccd is for 2 to 8 parameters, got {d}; use lhs, sobol or osf")
    if star not in ("circumscribed", "inscribed", "face"):
        raise ValueError(f"design: unknown star {star!r}; choose circumscribed, inscribed or face")
    corners = _corners(d)
    a = 1.0 if star == "face" else float(alpha) if alpha is not None else len(corners) ** 0.25
    if a < 1 or (star == "face" and alpha not in (None, 1, 1.0)):
        raise ValueError(f"design: ccd needs alpha >= 1 (exactly 1 where face-centred), got {alpha}")
    stars = np.vstack([a * np.eye(d), -a * np.eye(d)])
    coded = np.vstack([corners, stars, np.zeros((1, d))])
    return 0.5 + 0.5 * coded / a


def box_behnken(d: int) -> np.ndarray:
    """Box–Behnken design for 3 to 7 parameters: edge or face midpoints and one centre; no corner is run."""
    if not 3 <= d <= 7:
        raise ValueError(f"design: box_behnken is for 3 to 7 parameters, got {d}; use ccd (2 to 8), lhs or osf")
    rows = []
    for block in _BLOCKS.get(d, tuple(itertools.combinations(range(d), 2))):
        points = np.zeros((2 ** len(block), d))
        points[:, block] = list(itertools.product((-1.0, 1.0), repeat=len(block)))
        rows.append(points)
    return 0.5 + 0.5 * np.vstack([*rows, np.zeros((1, d))])


def optimal_space_filling(d: int, runs: int, seed: int, sweeps: int = 60) -> np.ndarray:
    """Latin hypercube of cell centres (runs, d) whose points were swapped apart.

    Minimises φ = Σ_{i<j} |x_i − x_j|^(−p), p = 15 (Morris & Mitchell 1995, eq. 2 to the power p) by threshold
    accepting over swaps of two entries in one column, so that the design stays Latin.
    """
    rng = np.random.default_rng(seed)
    X = (np.column_stack([rng.permutation(runs) for _ in range(d)]) + 0.5) / runs
    if d == 1 or runs < 3:
        return X
    half_p = 7.5
    D = squareform(pdist(X, "sqeuclidean"))
    np.fill_diagonal(D, np.inf)
    steps = min(sweeps * runs * d, 40_000)
    best, best_phi = X.copy(), _phi(D, half_p)
    now = best_phi
    for step in range(steps):
        j = rng.integers(d)
        a, b = rng.choice(runs, 2, replace=False)
        new_a = D[a] + (X[b, j] - X[:, j]) ** 2 - (X[a, j] - X[:, j]) ** 2
        new_b = D[b] + (X[a, j] - X[:, j]) ** 2 - (X[b, j] - X[:, j]) ** 2
        new_a[[a, b]], new_b[[a, b]] = (np.inf, D[a, b]), (D[a, b], np.inf)
        after = now + (new_a**-half_p + new_b**-half_p - D[a] ** -half_p - D[b] ** -half_p).sum()
        # A worse design is tolerated less and less: p = 15 makes 0.1 in log φ a change of < 1 % in distance.
        if after < now * (1 + 0.1 * (1 - step / steps) ** 2):
            X[[a, b], j] = X[[b, a], j]
            D[a], D[b], D[:, a], D[:, b] = new_a, new_b, new_a, new_b
            now = after
            if now < best_phi:
                best, best_phi = X.copy(), now
    return best


def extend(existing: np.ndarray, n: int, seed: int) -> np.ndarray:
    """n further points (n, d), each as far as possible from all others: max over x of min_i |x − x_i|.

    Greedy over a Sobol sample of the cube, each pick polished by a shrinking random search; deterministic.
    """
    X = np.atleast_2d(np.asarray(existing, float))
    if n < 1 or X.size == 0 or X.min() < -1e-9 or X.max() > 1 + 1e-9:
        raise ValueError(f"extend: needs n >= 1 and existing points in the unit cube, got n = {n}, shape {X.shape}")
    d = X.shape[1]
    rng = np.random.default_rng(seed)
    pool = sobol(d, 4096, seed)
    for _ in range(n):
        gap = cdist(pool, X).min(axis=1)
        x, best = pool[gap.argmax()], gap.max()
        for radius in 0.1 * 0.7 ** np.arange(25):
            tries = np.clip(x + radius * rng.uniform(-1, 1, (64, d)), 0, 1)
            gap = cdist(tries, X).min(axis=1)
            if gap.max() > best:
                x, best = tries[gap.argmax()], gap.max()
        X = np.vstack([X, x])
    return X[-n:]


def _corners(d: int) -> np.ndarray:
    extra = _GENERATORS.get(d, ())
    base = np.array(list(itertools.product((-1.0, 1.0), repeat=d - len(extra))))
    return np.column_stack([base, *(base[:, list(g)].prod(axis=1) for g in extra)])


def _phi(D: np.ndarray, half_p: float) -> float:
    return float((D**-half_p).sum() / 2)
