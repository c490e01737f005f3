"""Latin hypercubes: one point in each row of cells of every parameter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rso.doe.farthest import extend, farthest
from rso.doe.sampler import MAX_OPTIMISED_RUNS, DesignTask, Feasible, Sampler, enough

MAX_SWAPS, MAX_VAIN_SWAPS = 10_000, 100  # tries at most, and those in a row that improve nothing


def latin(d: int, runs: int, seed: int, optimise: bool = True) -> np.ndarray:
    """Latin hypercube (runs, d): one point per row of cells; `optimise` swaps for low centred discrepancy.

    The same bits as `scipy.stats.qmc.LatinHypercube` with and without "random-cd", whose import takes half a second.
    """
    return _latin(d, runs, seed, optimise).copy()


@lru_cache(maxsize=8)
def _latin(d: int, runs: int, seed: int, optimise: bool) -> np.ndarray:
    rng = np.random.default_rng(seed).spawn(1)[0]
    inside = rng.uniform(size=(runs, d))
    rows = np.tile(np.arange(1, runs + 1), (d, 1))
    for row in rows:
        rng.shuffle(row)
    X = (rows.T - inside) / runs
    # The optimiser takes n² time; so many points fill the cube without it.
    return _swapped(X, rng) if optimise and d > 1 and 1 < runs <= MAX_OPTIMISED_RUNS else X


def _swapped(X: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """X (n, d) after swaps within columns that lower its centred discrepancy.

    Source: Jin, Chen & Sudjianto, J. Stat. Plan. Inference 134 (2005) 268, eqs. (19) to (26).
    """
    n, d = X.shape
    lowest, vain, pairs = _discrepancy(X), 0, _pairs(X)
    for _ in range(MAX_SWAPS):
        j, a, b = (int(rng.integers(0, high, endpoint=True)) for high in (d - 1, n - 1, n - 1))
        found = _after_swap(pairs, a, b, j, lowest)
        vain = 0 if found < lowest else vain + 1
        if vain == 0:
            X[[a, b], j], lowest = X[[b, a], j], found
            pairs.swap(a, b, j)
        elif vain == MAX_VAIN_SWAPS:
            break
    return X


def _discrepancy(X: np.ndarray) -> float:
    """Squared centred discrepancy of X (n, d).

    (13/12)^d − 2/n Σ Π (1 + |z|/2 − z²/2) + 1/n² ΣΣ Π (1 + |z|/2 + |z'|/2 − |z − z'|/2) with z = x − 1/2.
    Source: Hickernell, Math. Comp. 67 (1998) 299.
    """
    n, d = X.shape
    one, two, z = np.ones(n), np.ones((n, n)), abs(X - 0.5)
    for k in range(d):
        one *= 1 + 0.5 * z[:, k] - 0.5 * z[:, k] ** 2
        two *= 1 + 0.5 * z[:, None, k] + 0.5 * z[:, k] - 0.5 * abs(X[:, None, k] - X[:, k])
    # summed one after the other, as scipy does
    return float((13.0 / 12.0) ** d - 2.0 / n * one.cumsum()[-1] + 1.0 / n**2 * two.ravel().cumsum()[-1])


@dataclass(frozen=True)
class _Pairs:
    """What the centred discrepancy of X (n, d) consists of, kept while entries change places within a column.

    With z = |x − 1/2|: `two` (d, n, n) is 2 + z_a + z_b − |x_a − x_b| of every pair, `far` (n, d) is z, `g` and `h`
    (n,) are Π (1 + z) and Π (1 + z/2 − z²/2).
    """

    two: np.ndarray
    far: np.ndarray
    g: np.ndarray
    h: np.ndarray

    def swap(self, a: int, b: int, j: int) -> None:
        """Entries a and b of column j change places."""
        two, far = self.two[j], self.far
        two[[a, b]] = two[[b, a]]
        two[:, [a, b]] = two[:, [b, a]]
        far[[a, b], j] = far[[b, a], j]
        for i in (a, b):
            self.g[i], self.h[i] = _products(far[i])


def _pairs(X: np.ndarray) -> _Pairs:
    z = (X - 0.5).T
    far = abs(z)
    two = 2.0 + far[:, :, None] + far[:, None, :] - abs(z[:, :, None] - z[:, None, :])
    g, h = np.transpose([_products(row) for row in far.T])
    return _Pairs(two, far.T.copy(), g.copy(), h.copy())


def _products(far: np.ndarray) -> tuple[float, float]:
    near = 0.5 * far**2
    return float(np.prod(1.0 + far)), float(np.prod(1.0 + 0.5 * far - near))


def _after_swap(pairs: _Pairs, a: int, b: int, j: int, before: float) -> float:
    """Centred discrepancy once entries a and b of column j change places, from that `before`."""
    two, far, n = pairs.two, pairs.far, len(pairs.far)
    beside = 1.0 / n**2.0 * np.multiply.reduce(0.5 * two[:, (a, b)], axis=0)
    of_a, of_b = beside
    gamma = two[j, b] / two[j, a]
    far_a, far_b = float(far[a, j]), float(far[b, j])
    alpha, beta = (1 + far_b) / (1 + far_a), (2 - far_b) / (2 - far_a)
    g_a, g_b, h_a, h_b = (float(v) for v in (pairs.g[a], pairs.g[b], pairs.h[a], pairs.h[b]))
    own_a, own_b = (1.0 / n**2 * g - 2.0 / n * h for g, h in ((g_a, h_a), (g_b, h_b)))
    new_a = g_a * alpha / n**2 - 2.0 * alpha * beta * h_a / n
    new_b = g_b / (n**2 * alpha) - 2.0 * h_b / (n * alpha * beta)
    others = gamma * of_a - of_a + of_b / gamma - of_b
    others[a] = others[b] = 0.0
    return float(before + new_a - own_a + new_b - own_b + 2 * others.cumsum()[-1])


def latin_within(d: int, runs: int, seed: int, feasible: Feasible, optimise: bool = True) -> np.ndarray:
    """A Latin hypercube (runs, d) of the feasible part of the cube; ValueError where that is below 1 %.

    Entries of a column are swapped until no point is forbidden, which stays Latin (after Petelet et al., J. Stat. Plan.
    Inference 140 (2010) 2863).  A constraint that no Latin hypercube meets (x1 + x2 < 1 has the wrong means) gives
    points as far as possible from one another instead.
    """
    X = latin(d, runs, seed, optimise)
    inside = swapped_inside(X, feasible, np.random.default_rng(seed))
    return farthest(np.empty((0, d)), runs, seed, feasible) if inside is None else inside


def extend_latin(existing: np.ndarray, n: int, seed: int, feasible: Feasible | None = None) -> np.ndarray:
    """n further points (n, d) in rows of cells that the N existing ones leave empty, N + n rows to a column.

    A Latin hypercube stays one where n is a multiple of N; otherwise two old points may share a row, and only the new
    ones are sure of theirs. Pairings are improved by swaps towards a larger smallest distance; with `feasible` swaps
    first lead into the constraints, and where no swap does the points are taken by :func:`extend`.
    """
    X = np.atleast_2d(np.asarray(existing, float))
    if n < 1 or X.size == 0 or X.min() < -1e-9 or X.max() > 1 + 1e-9:
        raise ValueError(f"extend: needs n >= 1 and existing points in the unit cube, got n = {n}, shape {X.shape}")
    rng, d, rows = np.random.default_rng(seed), X.shape[1], len(X) + n
    columns = []
    for j in range(d):
        taken = np.minimum((X[:, j] * rows).astype(int), rows - 1)
        empty = np.setdiff1d(np.arange(rows), taken)
        # More rows than needed are empty where old points share one: spread the choice.
        chosen = empty[np.unique(np.linspace(0, len(empty) - 1, n).round().astype(int))]
        columns.append((rng.permutation(chosen) + rng.random(n)) / rows)
    Y = np.stack(columns, axis=1)
    if feasible is not None:
        inside = swapped_inside(Y, feasible, rng)
        if inside is None:
            return extend(X, n, seed, feasible)
        Y = inside
    best = _nearest(Y, X)
    for _ in range(min(200 * n, 10_000) if d > 1 and n > 1 and rows <= MAX_OPTIMISED_RUNS else 0):
        (a, b), j = rng.choice(n, 2, replace=False), int(rng.integers(d))
        Y[[a, b], j] = Y[[b, a], j]
        gap = _nearest(Y, X)
        if gap > best and (feasible is None or np.all(feasible(Y[[a, b]]))):
            best = gap
        else:
            Y[[a, b], j] = Y[[b, a], j]
    return Y


def swapped_inside(X: np.ndarray, feasible: Feasible, rng: np.random.Generator) -> np.ndarray | None:
    """X with entries swapped within columns so that every point is feasible, or None if that was not found."""
    X = X.copy()
    n, d = X.shape
    good = np.asarray(feasible(X), bool)
    for _ in range(20 * n if d > 1 else 1):
        bad = np.nonzero(~good)[0]
        if not len(bad):
            return X
        a, j = rng.choice(bad), rng.integers(d)
        mine, theirs = np.tile(X[a], (n, 1)), X.copy()
        mine[:, j], theirs[:, j] = X[:, j], X[a, j]
        now = np.asarray(feasible(np.vstack([mine, theirs])), bool).reshape(2, n)
        gain = now.sum(axis=0) - good - good[a]
        # A swap that changes nothing is a step too: without those the search gets stuck.
        b = rng.choice(np.nonzero(gain == max(gain.max(), 0))[0])
        X[[a, b], j] = X[[b, a], j]
        if a != b:
            good[a], good[b] = now[0, b], now[1, b]
    return None


def _nearest(Y: np.ndarray, X: np.ndarray) -> float:
    from scipy.spatial.distance import cdist, pdist

    apart = pdist(Y).min() if len(Y) > 1 else np.inf
    return float(min(apart, cdist(Y, X).min()))


def points(task: DesignTask) -> np.ndarray:
    """A Latin hypercube, spread out further where the option `optimise` says so."""
    runs, optimise = enough("lhs", task), task.options.get("optimise", True)
    if task.feasible is None:
        return latin(task.d, runs, task.seed, optimise)
    return latin_within(task.d, runs, task.seed, task.feasible, optimise)


def further(X: np.ndarray, n: int, task: DesignTask) -> np.ndarray:
    """n points in rows of cells that X (m, d) leaves empty."""
    return extend_latin(X, n, task.seed, task.feasible)


SAMPLER = Sampler("lhs", "Latin hypercube", points, further, free=True, options=("optimise",))
