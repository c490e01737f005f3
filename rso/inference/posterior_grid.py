"""The posterior of up to three parameters on cells that are divided until the misfit hardly changes within one."""

from __future__ import annotations

import itertools

import numpy as np

from rso.inference.likelihood import DIFFERENCE_STEP, Misfit

FIRST_CELLS_PER_AXIS = {1: 256, 2: 24, 3: 10}  # cells an axis to begin with
MAX_CELL_CHANGE = 2.0  # change of √χ² over a cell, the axes together, up to which it is not divided
MIN_DIVIDED_CHANGE_SHARE = 0.5  # share of the largest change over a cell that an axis must have to be divided
PREDICTED_CHANGE_MARGIN_RATIO = 1.5  # times the change that derivatives foretell: the model is no plane
NEGLIGIBLE_CELL_CHI2 = 16.0  # of χ² above the least: a cell that cannot come lower is dropped
MAX_CELLS = {1: 60_000, 2: 150_000, 3: 100_000}  # cells that are looked at; where these do not do, a chain must try
MIN_CELL_HALF_WIDTH = 2.0**-22  # half-width of a cell that is not divided further
CELLS_PER_CHUNK = 4096  # whose misfits are computed at a time: bounds the memory


def cells(misfit: Misfit, through: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Centres (m, d), half-widths (m, d) and χ² (m,) of cells of the unit cube that hold all of the posterior.

    A cell with residual r and derivatives J_j at its centre is divided, along the axes that matter, while
    √Σ_j (2 w_j |J_j|)² > `MAX_CELL_CHANGE`, and dropped where |r| − `PREDICTED_CHANGE_MARGIN_RATIO` Σ_j w_j |J_j| is
    too large to count; those with one of the points `through` (k, d) are kept whatever it says, so that no narrow
    valley is lost between coarse cells. None where more than `MAX_CELLS` of them would be needed.
    """
    d = misfit.model.box.d
    n = FIRST_CELLS_PER_AXIS[d]
    C = (np.stack(np.meshgrid(*[np.arange(n)] * d, indexing="ij"), axis=-1).reshape(-1, d) + 0.5) / n
    W = np.full_like(C, 0.5 / n)
    least, seen, kept = np.inf, 0, []
    if len(through):
        least = float(np.min(misfit.chi2(through)))
    while len(C):
        seen += len(C)
        if seen > MAX_CELLS[d]:
            return None
        S, slope = _looked_at(misfit, C)
        least = min(least, float(S.min()))
        change = slope * W
        may = (
            np.maximum(np.sqrt(S) - PREDICTED_CHANGE_MARGIN_RATIO * change.sum(axis=1), 0.0) ** 2 - least
            < NEGLIGIBLE_CELL_CHI2
        )
        may |= _holding(C, W, through)
        C, W, S, change = C[may], W[may], S[may], change[may]
        fine = (np.linalg.norm(2 * change, axis=1) <= MAX_CELL_CHANGE) | (W.max(axis=1) <= MIN_CELL_HALF_WIDTH)
        kept.append((C[fine], W[fine], S[fine]))
        C, W = _divided(C[~fine], W[~fine], change[~fine])
    C, W, S = (np.concatenate(v) for v in zip(*kept, strict=True))
    near = S - least < NEGLIGIBLE_CELL_CHI2
    return C[near], W[near], S[near]


def draw_from_grid(
    misfit: Misfit, found: tuple[np.ndarray, np.ndarray, np.ndarray], n: int, seed: int
) -> tuple[np.ndarray, float]:
    """Draws (n, d) of the posterior, and how many independent ones they are as good as, (Σ w)²/Σ w² (Kish 1965).

    Points uniform in cells, these in proportion to their mass, count e^{−(χ² − χ²(centre))/2} (Rubin 1988: sampling,
    importance, resampling).
    """
    C, W, S = found
    rng = np.random.default_rng([seed, 13])
    mass = np.exp(-0.5 * (S - S.min())) * np.prod(W, axis=1)
    cell = np.searchsorted(np.cumsum(mass) / mass.sum(), (np.arange(n) + rng.random(n)) / n).clip(0, len(mass) - 1)
    X = np.clip(C[cell] + W[cell] * rng.uniform(-1, 1, (n, C.shape[1])), 0.0, 1.0)
    weight = np.exp(np.clip(-0.5 * (_chi2(misfit, X) - S[cell]), -700.0, 50.0))
    p = np.cumsum(weight) / weight.sum()
    again = np.searchsorted(p, (np.arange(n) + rng.random()) / n).clip(0, n - 1)
    return X[rng.permutation(again)], float(weight.sum() ** 2 / np.sum(weight**2))


def _chi2(misfit: Misfit, X: np.ndarray) -> np.ndarray:
    return np.concatenate([misfit.chi2(X[k : k + CELLS_PER_CHUNK]) for k in range(0, len(X), CELLS_PER_CHUNK)])


def _looked_at(misfit: Misfit, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """χ² (m,) and the size |J_j| (m, d) of its residuals' derivatives, of the data alone, at C (m, d)."""
    S, slope, y = [], [], np.concatenate([d.value for d in misfit.data])
    for k in range(0, len(C), CELLS_PER_CHUNK):
        X = C[k : k + CELLS_PER_CHUNK]
        f0 = misfit.model.predict(X)
        r = misfit.white(f0 - y)
        S.append(np.sum(r**2, axis=1) + np.sum(misfit.beyond(X) ** 2, axis=1))
        each = []
        for j in range(X.shape[1]):
            moved = X.copy()
            moved[:, j] += np.where(X[:, j] < 0.5, DIFFERENCE_STEP, -DIFFERENCE_STEP)
            each.append(np.linalg.norm(misfit.white(misfit.model.predict(moved) - f0), axis=1) / DIFFERENCE_STEP)
        slope.append(np.stack(each, axis=1))
    return np.concatenate(S), np.concatenate(slope)


def _holding(C: np.ndarray, W: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Mask (m,) of the cells that hold one of the points (k, d)."""
    found = np.zeros(len(C), bool)
    for x in points:
        found |= np.all(np.abs(C - x) <= W * (1 + 1e-9), axis=1)
    return found


def _divided(C: np.ndarray, W: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Halves of the cells along every axis that matters."""
    if not len(C):
        return C, W
    along = change >= MIN_DIVIDED_CHANGE_SHARE * change.max(axis=1, keepdims=True)
    parts = []
    for signs in itertools.product((-1, 1), repeat=C.shape[1]):
        s = np.array(signs)
        mine = np.all(along | (s > 0), axis=1)  # an axis that is not divided has one half only
        half = np.where(along, 0.5 * W, W)[mine]
        parts.append((C[mine] + np.where(along[mine], s * half, 0.0), half))
    return np.concatenate([c for c, _ in parts]), np.concatenate([w for _, w in parts])
