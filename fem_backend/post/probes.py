"""Material points of the upper surface and how they move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import ElementTriP2

SAME_SURFACE_TOLERANCE = 1e-6  # of the height of the model: points of one surface differ by less
OUTSIDE_TRIANGLE_TOLERANCE = 1e-9  # how far out of its triangle, in its coordinates, a point may lie


@dataclass(frozen=True)
class Probes:
    """Material points: nodes (k, a) of the facet of each, its shape functions N (k, a), mirror signs (k, 3).

    Of a meridian facets are edges (a = 3) and displacements those in the half-plane of the point.
    """

    facets: np.ndarray
    N: np.ndarray
    sign: np.ndarray


def surface_points(
    nodes: np.ndarray, facets: np.ndarray, points: np.ndarray, planes: tuple[bool, bool] = (False, False)
) -> Probes:
    """Points of the upper surface, what a ray from above meets first, at reference places (x, y), `points` (k, 2) mm.

    Solves Σ N_a(ξ) (X_a, Y_a) = (x, y) on the quadratic facets (f, 6) by Newton's method, to round-off.  `planes` says
    which of x = 0, y = 0 cut the model: a point of the missing part is found at its mirror image and its displacement
    mirrored back.  Raises ValueError for a point that is not above the modelled upper surface.
    """
    points = np.atleast_2d(np.asarray(points, float))
    if facets.shape[1] == 3:
        return _on_meridian(nodes, facets, points)
    sign = np.ones((len(points), 3))
    for k in range(2):
        if planes[k]:
            sign[:, k] = np.where(points[:, k] < 0.0, -1.0, 1.0)
    folded = points * sign[:, :2]
    flat, height = nodes[facets][:, :, :2], nodes[facets][:, :, 2]
    low, high = flat.min(1), flat.max(1)
    margin = 0.1 * (high - low).max(1, keepdims=True)  # an edge may bulge beyond its three nodes
    found, N = np.empty((len(points), 6), int), np.empty((len(points), 6))
    for i, p in enumerate(folded):
        near = np.nonzero(((p >= low - margin) & (p <= high + margin)).all(1))[0]
        xi = _newton(flat[near], p)
        slack = np.minimum(xi.min(1), 1.0 - xi.sum(1)) if len(near) else np.array([-np.inf])
        on = np.nonzero(slack >= -OUTSIDE_TRIANGLE_TOLERANCE)[0]
        if not len(on):
            raise ValueError(f"the point ({points[i, 0]:g}, {points[i, 1]:g}) mm is not on the upper surface")
        z = np.einsum("ca,ca->c", _shape(xi[on])[0], height[near[on]])
        first = on[
            z >= z.max() - SAME_SURFACE_TOLERANCE * np.ptp(nodes[:, 2])
        ]  # two facets share a point on their edge
        best = int(first[np.argmax(slack[first])])
        found[i], N[i] = facets[near[best]], _shape(xi[best : best + 1])[0][0]
    return Probes(found, N, sign)


def _on_meridian(nodes: np.ndarray, edges: np.ndarray, points: np.ndarray) -> Probes:
    """Points of the top as far from the axis as `points` (k, 2): Σ N_a(t) r_a = r, the highest edge counts."""
    r, height = nodes[edges, 0], nodes[edges, 2]
    found, N = np.empty((len(points), 3), int), np.empty((len(points), 3))
    for i, at in enumerate(np.hypot(*points.T)):
        t = np.full(len(edges), 0.5)
        for _ in range(20):
            M, dM = _edge(t)
            slope = (dM * r).sum(1)
            t = np.clip(t - ((M * r).sum(1) - at) / np.where(slope == 0.0, np.inf, slope), -1.0, 2.0)
        M = _edge(t)[0]
        hit = (
            (np.abs((M * r).sum(1) - at) <= 1e-9 * r.max())
            & (t >= -OUTSIDE_TRIANGLE_TOLERANCE)
            & (t <= 1.0 + OUTSIDE_TRIANGLE_TOLERANCE)
        )
        if not hit.any():
            raise ValueError(f"the point ({points[i, 0]:g}, {points[i, 1]:g}) mm is not on the upper surface")
        best = int(np.where(hit, (M * height).sum(1), -np.inf).argmax())
        found[i], N[i] = edges[best], M[best]
    return Probes(found, N, np.ones((len(points), 3)))


def _edge(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (e, 3) of a quadratic edge, ends then middle, and their derivatives by t (e,)."""
    N = [(1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0), 4.0 * t * (1.0 - t)]
    return np.stack(N, axis=1), np.stack([4.0 * t - 3.0, 4.0 * t - 1.0, 4.0 - 8.0 * t], axis=1)


def displacements(probes: Probes, u: np.ndarray) -> np.ndarray:
    """Displacement (k, 3) mm of the probes from nodal displacements u (n, 3)."""
    return probes.sign * np.einsum("ka,kai->ki", probes.N, u[probes.facets])


def _newton(flat: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Reference coordinates (c, 2) of the plane point p (2,) in plane quadratic triangles (c, 6, 2); nan if lost."""
    xi = np.full((len(flat), 2), 1.0 / 3.0)
    for _ in range(20):
        N, dN = _shape(xi)
        residual = np.einsum("ca,cai->ci", N, flat) - p
        D = np.einsum("cak,cai->cik", dN, flat)
        det = D[:, 0, 0] * D[:, 1, 1] - D[:, 0, 1] * D[:, 1, 0]
        det = np.where(np.abs(det) > 1e-300, det, np.nan)
        back = np.stack([D[:, 1, 1] * residual[:, 0] - D[:, 0, 1] * residual[:, 1],
                         D[:, 0, 0] * residual[:, 1] - D[:, 1, 0] * residual[:, 0]], axis=1)  # fmt: skip
        xi = np.clip(xi - back / det[:, None], -2.0, 3.0)
    lost = np.abs(np.einsum("ca,cai->ci", _shape(xi)[0], flat) - p).max(1, initial=0.0) > 1e-9 * (1.0 + np.abs(p).max())
    return np.where(lost[:, None] | np.isnan(xi), -np.inf, xi)


def _shape(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions (c, 6) of a triangle and their gradients (c, 6, 2) at ξ (c, 2)."""
    values = [ElementTriP2().lbasis(xi.T, a) for a in range(6)]
    return np.stack([v[0] for v in values], axis=1), np.stack([v[1].T for v in values], axis=1)
