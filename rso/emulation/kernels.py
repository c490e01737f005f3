"""Correlation functions of scaled distance, their derivatives, and the covariance of values and slopes.

A correlation is k(x, y) = g(s) with s = Σ_j (x_j − y_j)²/ℓ_j². In the scaled differences Δ_j = (x_j − y_j)/ℓ_j

    ∂k/∂y_j = −2 g′ Δ_j/ℓ_j,   ∂k/∂x_i = 2 g′ Δ_i/ℓ_i,   ∂²k/∂x_i∂y_j = −(4 g″ Δ_i Δ_j + 2 g′ δ_ij)/(ℓ_i ℓ_j)

are the covariances of values with slopes and of slopes with slopes (Rasmussen & Williams 2006, eq. 9.1).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

KERNELS = ("matern52", "squared_exponential")
KERNEL_WORDS = {"matern52": "Matérn 5/2", "squared_exponential": "squared exponential"}


def kernel_derivatives(kernel: str, s: np.ndarray, order: int = 3) -> tuple[np.ndarray, ...]:
    """g and its derivatives in s up to `order` <= 3; g‴ of Matérn is regularised at 0, where a factor s² meets it.

    Matérn 5/2: g = (1 + q + q²/3) e^(−q), q = √(5 s) (Rasmussen & Williams 2006, eq. 4.17); squared exponential:
    g = e^(−s/2) (eq. 4.9).
    """
    if kernel == "squared_exponential":
        g = np.exp(-0.5 * s)
        return (g, *((-0.5) ** k * g for k in range(1, order + 1)))
    q = np.sqrt(5 * s)
    e = np.exp(-q)
    found = [(1 + q + q**2 / 3) * e]
    if order > 0:
        found.append(-5 / 6 * (1 + q) * e)
    if order > 1:
        found += [25 / 12 * e, -125 / 24 * e / np.maximum(q, 1e-6)][: order - 1]
    return tuple(found)


def squares(X: np.ndarray) -> np.ndarray:
    """(x_j − y_j)² (d, n, n) of all pairs of points X (n, d)."""
    return (X.T[:, :, None] - X.T[:, None, :]) ** 2


def scaled_differences(X: np.ndarray, Y: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Δ (d, n, m) with Δ_j = (x_j − y_j)/ℓ_j."""
    # Term by term: |x|² + |y|² − 2xy loses the digits that a nearly interpolating process needs.
    return (X.T[:, :, None] - Y.T[:, None, :]) / np.asarray(lengths)[:, None, None]


def matern(X: np.ndarray, Y: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Matérn 5/2 correlation (n, m) of points X (n, d) and Y (m, d)."""
    return kernel_matrix("matern52", X, Y, lengths)


def kernel_matrix(
    kernel: str, X: np.ndarray, Y: np.ndarray, lengths: np.ndarray, *, left: bool = False, right: bool = False
) -> np.ndarray:
    """Correlation of values at X (n, d) with values at Y (m, d); with `left`/`right` also of the slopes there.

    Rows are [k; ∂k/∂x_1; …; ∂k/∂x_d], each n, columns likewise with y: shape (n, m) up to ((1 + d) n, (1 + d) m).
    """
    if not (left or right):
        return kernel_derivatives(kernel, cdist(X / lengths, Y / lengths, "sqeuclidean"), 0)[0]
    D = scaled_differences(X, Y, lengths)
    d, n, m = D.shape
    g, g1, g2 = kernel_derivatives(kernel, D[0] ** 2 if d == 1 else np.sum(D**2, axis=0), 2)
    rows, columns = 1 + d * left, 1 + d * right
    K = np.empty((rows, n, columns, m))
    K[0, :, 0] = g
    slope = 2 * g1 * D / np.asarray(lengths)[:, None, None]
    if left:
        K[1:, :, 0] = slope
    if right:
        K[0, :, 1:] = -slope.transpose(1, 0, 2)
    if left and right:
        for i in range(d):
            K[1 + i, :, 1:] = (-4 * g2 * D[i] * D).transpose(1, 0, 2)
            K[1 + i, :, 1 + i] -= 2 * g1
            K[1 + i, :, 1:] /= lengths[i] * np.asarray(lengths)[None, :, None]
    return K.reshape(rows * n, columns * m)


def covariances(kernel: str, X: np.ndarray, Y: np.ndarray, lengths: np.ndarray, right: bool) -> np.ndarray:
    """:func:`kernel_matrix` with each of m lengths (m, d), of values at X: (m, n, N) or (m, n, (1 + d) N)."""
    scale = lengths.T[:, :, None, None]
    x, y = X.T[:, None, :, None], Y.T[:, None, None, :]
    D = (x - y) / scale if right else x / scale - y / scale  # (d, m, n, N), rounded as `kernel_matrix` does
    g, *slope = kernel_derivatives(kernel, np.sum(D**2, axis=0), int(right))
    if not right:
        return g
    return np.concatenate([g, *(-2 * slope[0] * D[j] / lengths[:, j, None, None] for j in range(len(D)))], axis=-1)


def length_slopes(kernel: str, X: np.ndarray, lengths: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Σ_ab W_ab ∂K_ab/∂ ln ℓ_m (d,) for K = covariance(X, X) with all slopes; W symmetric, of K's shape."""
    D = scaled_differences(X, X, lengths)
    d, n, _ = D.shape
    D2 = D**2
    _, g1, g2, g3 = kernel_derivatives(kernel, D2[0] if d == 1 else np.sum(D2, axis=0))
    V, rows = W.reshape(1 + d, n, 1 + d, n), D2.reshape(d, -1)

    def along(w: np.ndarray) -> np.ndarray:  # as np.tensordot over both points, whose checks outweigh so small sums
        return rows @ w.ravel()

    out = -2 * along(V[0, :, 0] * g1)
    for j in range(d):
        # Value with slope, counted twice for the two orders: K = −2 g′ Δ_j/ℓ_j.
        w = 2 * V[0, :, 1 + j] / lengths[j]
        out += 4 * along(w * g2 * D[j])
        out[j] += 4 * ((w * g1).ravel() @ D[j].ravel())
        for i in range(d):
            w = V[1 + i, :, 1 + j] / (lengths[i] * lengths[j])
            both, wg2 = D[i] * D[j], w * g2
            out += 8 * along(w * g3 * both)
            once = 8 * (wg2.ravel() @ both.ravel())
            out[i] += once
            out[j] += once
            if i == j:
                out += 4 * along(wg2)
                out[i] += 4 * (w.ravel() @ g1.ravel())
    return out
