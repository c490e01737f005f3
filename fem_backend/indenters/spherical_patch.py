"""Where and how hard a body touches a ball, or another rigid surface of revolution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from skfem import ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.contact.tractions import FACET_QUADRATURE_ORDER, ContactSurface

N_PROFILE_RADII = 41  # radii of the smoothed profile
EDGE_GAP_RATIO = 0.06  # gap, in radii of the ball, whose surroundings the edge is found from
MAX_EDGE_GAPS = 12.0  # of these gaps: what is further off has no say


@dataclass(frozen=True)
class Patch:
    """The contact of the whole specimen in the current configuration; lengths mm, areas mm², pressures MPa.

    Counted, with the grain of the points: `counted_area` of the points in contact, `counted_radius` from its projection
    along the axis, `outermost` (k,) distance from the axis in each of k sectors (nan where nothing touches or nothing
    is modelled), `largest` pressure at a point, `points_radius` and `points_pressure` (p,).
    Fitted, smooth in travel and material (see `contact_patch`): `area`, `radius` (mean over directions), `edge` (k,)
    radius at the angles `directions` (k,), `peak` normal traction, `profile_radius` and `profile_pressure` (41,).
    """

    area: float
    radius: float
    edge: np.ndarray
    peak: float
    profile_radius: np.ndarray
    profile_pressure: np.ndarray
    directions: np.ndarray
    counted_area: float
    counted_radius: float
    outermost: np.ndarray
    largest: float
    points_radius: np.ndarray
    points_pressure: np.ndarray


def contact_patch(
    surface: ContactSurface,
    x: np.ndarray,
    pressure: np.ndarray,
    centre: np.ndarray,
    radius: float,
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
    planes: tuple[bool, bool] = (False, False),
    sectors: int = 16,
    attraction: np.ndarray | None = None,
    width: float = np.inf,
) -> Patch:
    """Contact patch from positions x (n, 3), pressure (f, q) MPa per reference area, the ball's centre (3,) and radius.

    `axis` points from the contact to the centre; `planes` says which of x = 0, y = 0 cut the model, whose missing parts
    are counted in.  s = 2R²(1 − cos α) is the area over π of the cap up to the angle α from the axis.
    The edge: outside a smooth contact the gap opens as g ∝ (s − s_e)^{3/2} (Johnson 1985, eq. 3.42a expanded), so
    s = s_e(θ) + c₁ g^{2/3} + c₂ g^{4/3} + c₃ g² is fitted to the free points around g = 0.06 R, with the harmonics of θ
    that symmetry allows; then area = ½ ∮ s_e dθ.  Gaps are displacements and far smoother than pressures at points.
    Beside a contact hardly wider than w, the `width`, gaps are smaller: 0.06 w²/R.
    Measured against a finer mesh (R = 3 mm, level standard): area 1 % to 2 mm of travel, 5 % at 4 mm; coarse 18 %,
    where surface elements have stretched to the width of the ball.
    The profile: p = √(1 − ξ) Σ c_k ξᵏ, ξ = s/s_e, k ≤ 3, fitted to force per current area; Hertz is c₀ alone.
    The peak is that of p − σ, what a probe would feel, with an `attraction` (f, q) MPa per reference area that is
    fitted by σ = Σ d_k ξᵏ; below zero where the ball pulls all over.
    Valid for a ball that sticks to nothing; the edge needs two or three elements across the contact.  Without contact
    all is zero.
    """
    up = np.asarray(axis, float) / np.linalg.norm(axis)

    def seen(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        distance = np.linalg.norm(d, axis=-1)
        return distance - radius, 2.0 * radius**2 * (1.0 + d @ up / distance)

    near = EDGE_GAP_RATIO * radius * min(width / radius, 1.0) ** 2
    cap = Cap(seen, lambda s: _plan(s, radius), near)
    return patch_on(surface, x, pressure, centre, cap, up, planes, sectors, attraction)


@dataclass(frozen=True)
class Cap:
    """A rigid surface of revolution about its reference point: what a contact on it is measured by.

    `seen` takes places d (…, 3) mm from the reference point to the gap (…) mm and the area over π s (…) mm² of the cap
    below them, `plan` takes s to the distance (…) mm from the axis; `near` is the gap (mm) whose surroundings the edge
    is found from; `rounded` says whether pressures vanish at the edge, as on a smooth surface, or are largest there.
    """

    seen: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    plan: Callable[[np.ndarray], np.ndarray]
    near: float
    rounded: bool = True


def patch_on(
    surface: ContactSurface,
    x: np.ndarray,
    pressure: np.ndarray,
    centre: np.ndarray,
    cap: Cap,
    up: np.ndarray,
    planes: tuple[bool, bool],
    sectors: int = 16,
    attraction: np.ndarray | None = None,
) -> Patch:
    """The contact patch of :func:`contact_patch` on another surface of revolution, about the unit axis `up` (3,).

    Where it is not rounded, area and radius are those counted, and the peak is the largest pressure at a point.
    """
    X, w = get_quadrature(RefTri, FACET_QUADRATURE_ORDER)
    dN = np.stack([ElementTriP2().lbasis(X, a)[1] for a in range(6)])
    d = np.einsum("qa,fai->fqi", surface.N, x[surface.facets]) - centre
    beside = ((cap.seen(d)[0] < MAX_EDGE_GAPS * cap.near) | (pressure > 0.0)).any(1)
    d, pressure, weights = d[beside], pressure[beside], surface.weights[beside]
    tangent = np.einsum("fai,akq->fqki", x[surface.facets[beside]], dN)
    vector = np.cross(tangent[:, :, 0], tangent[:, :, 1]) * w[:, None]
    area = np.linalg.norm(vector, axis=-1)
    on = pressure > 0.0
    theta = 2.0 * np.pi * np.arange(sectors) / sectors
    if not on.any():
        no, none = np.zeros(0), np.full(sectors, np.nan)
        return Patch(0.0, 0.0, none, 0.0, no, no, theta, 0.0, 0.0, none, 0.0, no, no)
    current = pressure[on] * weights[on] / area[on]
    east = np.array([1.0, 0.0, 0.0]) - up[0] * up if abs(up[0]) < 0.9 else np.cross([0.0, 1.0, 0.0], up)
    east /= np.linalg.norm(east)
    a, b = d @ east, d @ np.cross(up, east)
    r, angle = np.hypot(a, b), np.arctan2(b, a)
    gap, s = cap.seen(d)
    harmonics = _harmonics(planes)
    edge = _edge(s, gap, area, angle, ~on, harmonics, cap.near)
    if edge is None:  # nothing free near by
        edge = np.eye(1, harmonics(theta).shape[1])[0] * s[on].max()
    rim = np.maximum(harmonics(theta) @ edge, 0.0)
    at, xi = s[on] / np.maximum(harmonics(angle[on]) @ edge, 1e-300), np.linspace(0.0, 1.0, N_PROFILE_RADII) ** 2
    smooth = np.sqrt(1.0 - xi) * np.polynomial.polynomial.polyval(xi, _profile(at, current, area[on], 0.5))
    net = smooth
    if attraction is not None and attraction.any():
        pull = attraction[beside][on] * weights[on] / area[on]
        net = smooth - np.polynomial.polynomial.polyval(xi, _profile(at, pull, area[on], 0.0))
    sector = np.round(angle[on] / (2.0 * np.pi / sectors)).astype(int) % sectors
    outermost = np.full(sectors, -np.inf)
    np.maximum.at(outermost, sector, r[on])
    order, copies = np.argsort(r[on]), 2 ** sum(planes)
    counted_area = copies * float(area[on].sum())
    counted_radius = float(np.sqrt(copies * np.abs(vector[on] @ up).sum() / np.pi))
    return Patch(
        area=float(np.pi * rim.mean()) if cap.rounded else counted_area,
        radius=float(cap.plan(rim).mean()) if cap.rounded else counted_radius,
        edge=cap.plan(rim),
        peak=float(net.max()) if cap.rounded else float(current.max()),
        profile_radius=cap.plan(xi * rim.mean()),
        profile_pressure=smooth,
        directions=theta,
        counted_area=counted_area,
        counted_radius=counted_radius,
        outermost=np.where(np.isfinite(outermost), outermost, np.nan),
        largest=float(current.max()),
        points_radius=r[on][order],
        points_pressure=current[order],
    )


def _plan(s: np.ndarray, R: float) -> np.ndarray:
    """Distance R sin α from the axis."""
    return np.sqrt(np.clip(s * (1.0 - s / (4.0 * R**2)), 0.0, None))


def _harmonics(planes: tuple[bool, bool]) -> Callable[[np.ndarray], np.ndarray]:
    """Columns 1, cos 2θ and, where no plane forbids them, cos θ, sin θ, sin 2θ."""

    def columns(a: np.ndarray) -> np.ndarray:
        out = [np.ones_like(a), np.cos(2 * a)]
        if not planes[0]:
            out.append(np.cos(a))
        if not planes[1]:
            out.append(np.sin(a))
        if not any(planes):
            out.append(np.sin(2 * a))
        return np.stack(out, axis=-1)

    return columns


def _edge(
    s: np.ndarray,
    gap: np.ndarray,
    area: np.ndarray,
    angle: np.ndarray,
    free: np.ndarray,
    harmonics: Callable[[np.ndarray], np.ndarray],
    near: float,
) -> np.ndarray | None:
    """Coefficients of s_e(θ); a point's weight goes to zero with its gap, so that none comes or goes with a jump."""
    use = free & (gap > 0.0) & (gap < MAX_EDGE_GAPS * near)
    columns = harmonics(angle[use])
    if use.sum() < 2 * (columns.shape[1] + 3):
        return None
    v = gap[use] / near
    t = v ** (2.0 / 3.0)
    root = np.sqrt(area[use] * v * np.exp(-v))
    A = np.column_stack([columns, t, t**2, t**3])
    return np.linalg.lstsq(A * root[:, None], s[use] * root, rcond=None)[0][: columns.shape[1]]


def _profile(xi: np.ndarray, pressure: np.ndarray, area: np.ndarray, power: float) -> np.ndarray:
    """Coefficients c (4,) of p = (1 − ξ)^power Σ c_k ξᵏ by least squares over the area; fewer points, fewer of them."""
    inside = xi < 1.0
    terms = int(np.clip(inside.sum() // 10, 1, 4))
    x = xi[inside]
    A = ((1.0 - x) ** power)[:, None] * x[:, None] ** np.arange(terms)
    root = np.sqrt(area[inside])
    return np.pad(np.linalg.lstsq(A * root[:, None], pressure[inside] * root, rcond=None)[0], (0, 4 - terms))
