"""Where and how hard a meridian is touched."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from skfem import ElementLineP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine

from fem_backend.contact.tractions import EDGE_QUADRATURE_ORDER, ContactSurface

EDGE_ZONE_SHARE = 0.3  # of the contact's radius beside its edge, whose pressures tell where that is


@dataclass(frozen=True)
class RingPatch:
    """The contact now: area (mm²) of the touched surface, radius (mm) of its edge, peak of the pressure (MPa)."""

    area: float
    radius: float
    peak: float


def ring_patch(
    surface: ContactSurface, x: np.ndarray, pressure: np.ndarray, attraction: np.ndarray | None = None
) -> RingPatch:
    """Patch from positions x (n, 3) mm and pressures (f, q) MPa per reference area of a meridian.

    At the edge of a smooth contact p² falls as r_e − r does (Johnson 1985, eq. 3.39): r_e is where the line through p²
    of the outer points vanishes, between the last point that is touched and the next one.  The peak is that of the mean
    of p − σ, σ the `attraction`, over an edge of the mesh and its current area.
    """
    dN, w = _edge_slopes()
    now = x[surface.facets]
    points = np.einsum("qa,fai->fqi", surface.N, now)
    length = np.linalg.norm(np.einsum("fai,aq->fqi", now, dN), axis=-1)
    area = 2.0 * np.pi * np.maximum(points[..., 0], 0.0) * length * w
    on = pressure > 0.0
    if not on.any():
        return RingPatch(0.0, 0.0, 0.0)
    force = pressure * surface.weights
    net = force if attraction is None else force - attraction * surface.weights
    mean = net.sum(1) / np.maximum(area.sum(1), 1e-300)
    whole = on.all(1)
    peak = float(mean[whole].max()) if whole.any() else float((net / np.maximum(area, 1e-300))[on].max())
    r, p, ring = (v.ravel() for v in (points[..., 0], force / np.maximum(area, 1e-300), area))
    order = np.argsort(r)
    r, p, ring = r[order], p[order], ring[order]
    last = int(np.nonzero(p > 0.0)[0][-1])
    outer = r[last + 1] if last + 1 < len(r) else r[last]
    near = np.nonzero((p > 0.0) & (r >= (1.0 - EDGE_ZONE_SHARE) * r[last]))[0][-12:]
    edge = 0.5 * (r[last] + outer)
    if len(near) > 3:
        slope, level = np.polyfit(r[near], p[near] ** 2, 1)
        if slope < 0.0:
            edge = float(np.clip(-level / slope, r[last], outer))
    within = np.cumsum(ring) - 0.5 * ring  # area up to each point
    return RingPatch(float(np.interp(edge, r, within)), float(edge), peak)


@functools.cache
def _edge_slopes() -> tuple[np.ndarray, np.ndarray]:
    """∂N/∂t (3, q) and weights (q,) of an edge."""
    X, w = get_quadrature(RefLine, EDGE_QUADRATURE_ORDER)
    return np.stack([ElementLineP2().lbasis(X, a)[1][0] for a in range(3)]), w
