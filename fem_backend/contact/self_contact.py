"""Whether the surface of a deformed meridian has met itself, which contact with rigid bodies does not know of."""

from __future__ import annotations

import numpy as np
from skfem import ElementLineP2

N_PIECES_PER_EDGE = 4  # straight pieces that a curved edge counts as


def met_itself(x: np.ndarray, edges: np.ndarray) -> bool:
    """Whether edges (f, 3), ends then middle, at nodal positions x (n, 3) mm of a meridian cross each other.

    Each edge counts as four straight pieces; edges that share a node may not cross either, pieces that do are no pair.
    """
    t = np.linspace(0.0, 1.0, N_PIECES_PER_EDGE + 1)
    N = np.stack([ElementLineP2().lbasis(t[None], a)[0] for a in range(3)])
    points = np.einsum("aq,fai->fqi", N, x[:, [0, 2]][edges])
    a, b = points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)
    low, high = np.minimum(a, b), np.maximum(a, b)
    near = (low[:, None] <= high[None]).all(-1) & (low[None] <= high[:, None]).all(-1)
    i, j = np.nonzero(np.triu(near, 1))

    def side(p: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
        return (q - p)[:, 0] * (s - p)[:, 1] - (q - p)[:, 1] * (s - p)[:, 0]

    first = side(a[i], b[i], a[j]) * side(a[i], b[i], b[j])
    second = side(a[j], b[j], a[i]) * side(a[j], b[j], b[i])
    size = np.linalg.norm(b - a, axis=1)
    least = 1e-9 * (size[i] * size[j]) ** 2  # ends that two pieces share lie on both but for round-off
    return bool(((first < -least) & (second < -least)).any())
