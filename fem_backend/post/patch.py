"""Where and how hard a body touches a ball."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.contact import ORDER, ContactSurface


@dataclass(frozen=True)
class Patch:
    """The contact of the whole specimen in the current configuration; lengths mm, areas mm², pressures MPa.

    `area` of the points in contact and `projected` along the axis, `peak` pressure (force per current area);
    `radius` = √(projected/π) and `outermost` (k,), the largest distance from the axis in each of k sectors (nan where
    nothing touches or nothing is modelled), both grained by the distance of the points.  `edge_area`, `edge_radius`
    (mean over directions) and `edge` (k,) are free of that grain: see `contact_patch`.  `profile_radius` (p,),
    `profile_pressure` (p,): the points in contact by their distance from the axis.
    """

    area: float
    projected: float
    radius: float
    outermost: np.ndarray
    directions: np.ndarray
    edge_area: float
    edge_radius: float
    edge: np.ndarray
    peak: float
    profile_radius: np.ndarray
    profile_pressure: np.ndarray


def contact_patch(
    surface: ContactSurface,
    x: np.ndarray,
    pressure: np.ndarray,
    centre: np.ndarray,
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
    planes: tuple[bool, bool] = (False, False),
    sectors: int = 16,
) -> Patch:
    """Contact patch from positions x (n, 3), pressure (f, q) MPa per reference area, the ball's centre (3,).

    `axis` points from the contact to the centre; `planes` says which of x = 0, y = 0 cut the model, whose missing parts
    are counted in.  Near its edge a smooth contact has p² = A(θ) − B s, linear in s = |x − x_pole|² (Johnson 1985,
    eq. 4.24), the pole being the ball's lowest point; a least-squares fit with the harmonics that symmetry allows
    gives the edge s = A/B.  s is the cap's area over π, so edge_area = ½ ∮ s dθ holds at any depth.  Adhesive contacts
    have another edge: there only the points count.  Without contact all is zero.
    """
    X, w = get_quadrature(RefTri, ORDER)
    dN = np.stack([ElementTriP2().lbasis(X, a)[1] for a in range(6)])
    points = np.einsum("qa,fai->fqi", surface.N, x[surface.facets])
    tangent = np.einsum("fai,akq->fqki", x[surface.facets], dN)
    vector = np.cross(tangent[:, :, 0], tangent[:, :, 1]) * w[:, None]
    area = np.linalg.norm(vector, axis=-1)
    on = pressure > 0.0
    copies = 2 ** sum(planes)
    theta = 2.0 * np.pi * np.arange(sectors) / sectors
    if not on.any():
        none = np.full(sectors, np.nan)
        return Patch(0.0, 0.0, 0.0, none, theta, 0.0, 0.0, none, 0.0, np.zeros(0), np.zeros(0))
    current = pressure[on] * surface.weights[on] / area[on]
    up = np.asarray(axis, float) / np.linalg.norm(axis)
    d = points[on] - centre
    east = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross(up, [1.0, 0.0, 0.0])
    east /= np.linalg.norm(east)
    plan = np.stack([d @ east, d @ np.cross(up, east)], axis=-1)
    r, angle = np.linalg.norm(plan, axis=-1), np.arctan2(plan[:, 1], plan[:, 0])
    sector = np.round(angle / (2.0 * np.pi / sectors)).astype(int) % sectors
    outermost = np.full(sectors, -np.inf)
    np.maximum.at(outermost, sector, r)
    outermost = np.where(np.isfinite(outermost), outermost, np.nan)
    R = float(np.average(np.linalg.norm(d, axis=-1), weights=area[on]))
    s = _edge((d + R * up), current, area[on], angle, theta, planes)
    edge = np.sqrt(np.clip(s * (1.0 - s / (4.0 * R**2)), 0.0, None))
    projected = copies * float(np.abs(vector[on] @ up).sum())
    order = np.argsort(r)
    return Patch(
        area=copies * float(area[on].sum()),
        projected=projected,
        radius=float(np.sqrt(projected / np.pi)),
        outermost=outermost,
        directions=theta,
        edge_area=float(np.pi * s.mean()),
        edge_radius=float(edge.mean()),
        edge=edge,
        peak=float(current.max()),
        profile_radius=r[order],
        profile_pressure=current[order],
    )


def _edge(
    chord: np.ndarray,
    pressure: np.ndarray,
    area: np.ndarray,
    angle: np.ndarray,
    theta: np.ndarray,
    planes: tuple[bool, bool],
) -> np.ndarray:
    """s = A/B at the angles `theta`; points of small but not vanishing pressure count most: none enters with a jump."""

    def harmonics(a: np.ndarray) -> np.ndarray:
        columns = [np.ones_like(a), np.cos(2 * a)]
        if not planes[0]:
            columns.append(np.cos(a))
        if not planes[1]:
            columns.append(np.sin(a))
        if not any(planes):
            columns.append(np.sin(2 * a))
        return np.column_stack(columns)

    square, s = (pressure / pressure.max()) ** 2, (chord**2).sum(-1)
    root = np.sqrt(area * square * np.exp(-4.0 * square))
    columns = harmonics(angle)
    if len(square) < 2 * columns.shape[1] + 2:
        return np.full(len(theta), s.max())
    fit = np.linalg.lstsq(np.column_stack([columns, -s]) * root[:, None], square * root, rcond=None)[0]
    return harmonics(theta) @ fit[:-1] / fit[-1] if fit[-1] > 0.0 else np.full(len(theta), s.max())


def pressure_at_nodes(surface: ContactSurface, pressure: np.ndarray, count: int) -> np.ndarray:
    """Pressure (count,) MPa at all nodes, zero off the contact: linear per facet, averaged by area, never negative."""
    X, _ = get_quadrature(RefTri, ORDER)
    at = np.column_stack([1.0 - X.sum(0), *X])
    corners = np.einsum("cq,fq->fc", np.linalg.pinv(at), pressure)
    area = surface.weights.sum(1)
    weight, out = np.zeros(count), np.zeros(count)
    for c in range(3):
        np.add.at(weight, surface.facets[:, c], area)
        np.add.at(out, surface.facets[:, c], area * corners[:, c])
    out = np.clip(out / np.where(weight > 0.0, weight, 1.0), 0.0, None)
    for k, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
        out[surface.facets[:, 3 + k]] = 0.5 * (out[surface.facets[:, i]] + out[surface.facets[:, j]])
    return out
