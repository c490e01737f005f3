"""Where a surrogate extrapolates although it is inside the cube: outside the convex hull of its points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

MAX_HULL_DIMENSIONS = 5  # dimensions up to which the hull is computed; above, the box around the points


def beyond(points: np.ndarray, X: np.ndarray, tolerance: float = 1e-6) -> np.ndarray:
    """Mask (k,) of the X (k, d) outside the convex hull of `points` (n, d) by more than `tolerance`.

    In more than 5 dimensions, and where the points do not span a volume, the box around them is used instead: what
    it flags is outside the hull too, but not everything outside the hull is flagged.
    """
    P, X = np.asarray(points, float), np.asarray(X, float)
    out = ~np.all((P.min(axis=0) - tolerance <= X) & (P.max(axis=0) + tolerance >= X), axis=1)
    d = P.shape[1]
    if not 2 <= d <= MAX_HULL_DIMENSIONS or len(P) <= d:
        return out
    try:
        faces = ConvexHull(P).equations
    except QhullError:
        return out
    return out | (X @ faces[:, :-1].T + faces[:, -1] > tolerance).any(axis=1)
