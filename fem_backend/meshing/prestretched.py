"""A mesh graded in advance for a deep indentation: gathered towards the axis of the indenter, stretched along it.

Two lengths deep, the column below a ball is wider by 2 and shorter by 4, three lengths deep by 3.5 and 10: elements
that are well shaped before are flat then, too few across the column and too many along its skin.  So nodes are moved
the other way before the body is loaded, by a smooth map that keeps the surface, the planes of symmetry and the base.
It is the same for all depths: what it gains it gains from two lengths on, and loses nothing before.
"""

from __future__ import annotations

import numpy as np

GATHERED_DISTANCE_SHARE = 0.6  # of its distance from the axis is what a node below the contact has left
# lengths of the indenter, beside the axis and below the surface, over which that fades
GATHERED_RADIUS_RATIO, GATHERED_DEPTH_RATIO = 4.0 / 3.0, 2.7
DEPTH_STRETCH = 2.0  # times as deep lies what is next to the surface, on the axis
STRETCHED_RADIUS_RATIO, STRETCHED_DEPTH_RATIO = 2.0, 2.0  # lengths over which that fades


def lowered(depth: np.ndarray, rest: np.ndarray, r: np.ndarray, room: np.ndarray, length: float) -> np.ndarray:
    """Depths (n,) mm of nodes at `depth` below the surface and r mm beside the axis, stretched along it:

        d ↦ d (1 + (q − 1) w e^{−r²/4L²} (e^{−d/2L} − e^{−D/2L})/(1 − e^{−D/2L})),   0 ≤ d ≤ D

    q = 2, L the `length`; D = `rest` is how deep a plane lies that stays; w = `room` falls to 0 where nothing moves.
    One-to-one, as its slope is at least 1 − (q − 1) w (D/2L)/(e^{D/2L} − 1).
    """
    end = np.exp(-rest / (STRETCHED_DEPTH_RATIO * length))
    fade = (np.exp(-depth / (STRETCHED_DEPTH_RATIO * length)) - end) / np.maximum(1.0 - end, 1e-12)
    share = np.where((depth >= 0.0) & (depth < rest), fade, 0.0) * np.exp(
        -((r / (STRETCHED_RADIUS_RATIO * length)) ** 2)
    )
    return depth * (1.0 + (DEPTH_STRETCH - 1.0) * share * room)


def gathered(depth: np.ndarray, r: np.ndarray, room: np.ndarray, length: float) -> np.ndarray:
    """Factor (n,) on the distance r (mm) from the axis: 1 − (1 − k) w e^{−(r/1.33 L)²} e^{−(d/2.7 L)²}, k = 0.6.

    One-to-one, as the slope of r by it is at least k.
    """
    fade = np.exp(
        -((r / (GATHERED_RADIUS_RATIO * length)) ** 2) - (np.maximum(depth, 0.0) / (GATHERED_DEPTH_RATIO * length)) ** 2
    )
    return 1.0 - (1.0 - GATHERED_DISTANCE_SHARE) * room * fade


def below_pole(X: np.ndarray, semi_axes: np.ndarray, length: float) -> np.ndarray:
    """Nodes X (n, 3) of the unit ball that stands for a body of semi-axes a, b, c (mm), gathered below its pole.

    Surface, rim z = 0 and the planes x = 0, y = 0 stay where they are.
    """
    a, b, c = semi_axes
    flat = np.maximum(1.0 - X[:, 0] ** 2 - X[:, 1] ** 2, 0.0)
    above = np.sqrt(flat)
    r, room, rest = np.hypot(a * X[:, 0], b * X[:, 1]), flat**2, c * above
    depth = lowered(rest - c * X[:, 2], rest, r, room, length)
    out = X.copy()
    out[:, :2] *= gathered(depth, r, room, length)[:, None]
    new = np.sqrt(np.maximum(1.0 - out[:, 0] ** 2 - out[:, 1] ** 2, 0.0))
    inside = above > 1e-9
    out[inside, 2] = (1.0 - depth[inside] / rest[inside]) * new[inside]
    out[X[:, 2] == 0.0, 2] = 0.0
    return out
