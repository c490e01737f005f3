"""Zones of another stiffness on a fixed mesh: skin, inclusion, cavity as weights at the quadrature points.

A zone is φ(X) ≤ 0 in the reference configuration.  In a cell that it cuts, its volume and first moments are measured on
SPLIT³ pieces, each cut exactly by the plane through the values of φ at its corners, and given to the four quadrature
points.  Nothing is remeshed, so a response is a smooth function of thickness, place and size.  The stiffness of a cut
cell is a mixture (Voigt), so a zone smaller than the cells around it has the right amount of stiffness, smeared out.
Lengths in mm.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np
from skfem import ElementTetP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend import geometry
from fem_backend.compiled import compiled
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.kinematics.bodies import Body
from fem_backend.materials import meridian_zones
from fem_backend.materials.meridian_zones import N_PIECES_PER_CUT_EDGE


class ZoneShape(Protocol):
    """What of a specimen zones need: its surface."""

    skin_limit: float

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) mm of points X (…, 3) to the surface, negative outside."""

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Whether nodes X (…, 3) lie on the surface."""


CAVITY_STIFFNESS_RATIO = 1e-3  # stiffness ratio of a hole: see `modulus_factor`
ROUNDED_END_HALF_WIDTH = 0.02  # half width of the rounded ends of [0, 1]: keeps the fractions differentiable
# corners of the face opposite to a corner
FACES_OPPOSITE_CORNERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


def skin(body: Body, specimen: ZoneShape, thickness: float) -> np.ndarray:
    """Fraction (m, q) of each weight within `thickness` (mm) of the surface: d(X) ≤ t.

    d is the exact distance to the surface along its normal, less the distance by which the quadratic facet misses it,
    fading out linearly through the cell: so the skin of the meshed body has the asked thickness also where
    cells are large.  Raises ValueError if t < 0 or t ≥ half the smallest radius of curvature, `skin_limit`.
    """
    limit = specimen.skin_limit
    if not 0.0 <= thickness < limit:
        raise ValueError(f"skin thickness {thickness!r} mm: from 0 to {limit:.4g} mm, half the smallest radius")
    if thickness == 0.0:
        return np.zeros_like(body.w)
    if isinstance(body, MeridianBody):
        return meridian_zones.fractions(body, lambda X: depth(specimen, X) - thickness)
    faces = surface_faces(body, specimen)

    def level(cells: np.ndarray, at: np.ndarray) -> np.ndarray:
        d = depth(specimen, _points(body, cells, at))
        for k in range(4):
            outer = faces[cells, k]
            d[outer] -= _missed(body, specimen, cells[outer], at, k)
        return d - thickness

    near = depth(specimen, body.nodes)[body.cells].min(1) < thickness
    return _fractions(body, level, near, np.zeros(len(near), bool))


def inclusion(body: Body, centre: np.ndarray, radius: float) -> np.ndarray:
    """Fraction (m, q) of each weight within `radius` (mm) of `centre` (3,) mm.  ValueError if the radius is negative.

    Whether the ball fits into the specimen is checked by `modulus_factor`.
    """
    if not radius >= 0.0:
        raise ValueError(f"inclusion of radius {radius!r} mm: must not be negative")
    return _ellipsoid(body, np.asarray(centre, float), np.full(3, float(radius)))


def cavity(body: Body, centre: np.ndarray, semi_axes: np.ndarray) -> np.ndarray:
    """Fraction (m, q) of each weight inside the ellipsoid of `semi_axes` (3,) mm around `centre` (3,) mm.

    The cavity may open through the surface; only the part inside the body counts.  ValueError for negative axes.
    """
    axes = np.asarray(semi_axes, float)
    if axes.shape != (3,) or not np.all(axes >= 0.0):
        raise ValueError(f"cavity of semi-axes {semi_axes!r} mm: three numbers, none negative")
    return _ellipsoid(body, np.asarray(centre, float), axes)


def modulus_factor(
    body: Body,
    specimen: ZoneShape,
    skin: tuple[float, float] | None = None,
    inclusion: tuple[np.ndarray, float, float] | None = None,
    cavity: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray | None:
    """Factor (m, q) on all moduli, or None where nothing differs from the plain body.

    s = (1 + (r_skin − 1) f_skin + (r_incl − 1) f_incl)(1 − f_cav) + r_cav f_cav with skin = (thickness mm, ratio),
    inclusion = (centre mm, radius mm, ratio), cavity = (centre mm, semi-axes mm).

    A hole is a zone of ratio CAVITY_STIFFNESS_RATIO = 1e-3.  With a ball of 6 mm radius 9 mm under the contact that is
    1 % of the effect on the force from the limit 1e-5 (1e-2: 5 %); with a wall of 3 mm a ratio of 1e-4 finds no
    equilibrium at 4 mm of travel, where 1e-3 needs no more iterations than the plain body.  The wall cannot touch
    itself, and nodes that a support holds stay held where a cavity opens.  Raises ValueError for ratios that are not
    positive, an inclusion that is not inside the body (below the skin, off the cavity, on the symmetry planes of a part
    model), a cavity outside the body or through its upper half.
    """
    s = np.ones_like(body.w)
    changed = False
    thickness = 0.0
    if skin is not None:
        thickness, ratio = skin
        _ratio("skin", ratio)
        fraction = _skin(body, specimen, thickness)
        if thickness > 0.0 and ratio != 1.0:
            s += (ratio - 1.0) * fraction
            changed = True
        else:
            thickness = 0.0
    if inclusion is not None:
        centre, radius, ratio = np.asarray(inclusion[0], float), inclusion[1], inclusion[2]
        _ratio("inclusion", ratio)
        fraction = _inclusion(body, centre, radius)
        if radius > 0.0 and ratio != 1.0:
            _on_planes("inclusion", body, centre, np.full(3, radius))
            room = float(depth(specimen, centre)) - thickness
            if not radius < room:
                raise ValueError(
                    f"inclusion of radius {radius:g} mm at {centre.tolist()} mm: only {max(room, 0.0):.4g} mm to the "
                    "surface or its skin"
                )
            if cavity is not None and np.max(cavity[1]) > 0.0:
                _apart(centre, radius, np.asarray(cavity[0], float), np.asarray(cavity[1], float))
            s += (ratio - 1.0) * fraction
            changed = True
    if cavity is not None:
        centre, axes = np.asarray(cavity[0], float), np.asarray(cavity[1], float)
        fraction = _cavity(body, centre, axes)
        if np.all(axes > 0.0):
            _on_planes("cavity", body, centre, axes)
            _inside(specimen, centre, axes)
            s = s * (1.0 - fraction) + CAVITY_STIFFNESS_RATIO * fraction
            changed = True
    return s if changed else None


_skin, _inclusion, _cavity = skin, inclusion, cavity  # `modulus_factor` names its arguments like the functions


def depth(specimen: ZoneShape, X: np.ndarray) -> np.ndarray:
    """Distance (…,) mm of points X (…, 3) to the surface of the specimen, negative outside."""
    return specimen.depth(X)


def surface_faces(body: Body, specimen: ZoneShape) -> np.ndarray:
    """(m, 4) whether the face opposite to a cell's corner lies on the curved surface, not on a plane of symmetry."""
    faces = np.sort(body.cells[:, FACES_OPPOSITE_CORNERS], axis=-1).reshape(-1, 3)
    _, inverse, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    lone = count[inverse.ravel()] == 1
    X = body.nodes[faces]
    on = specimen.on_surface(X).all(-1)
    flat = (X == 0.0).all(1).any(-1)
    return (lone & on & ~flat).reshape(-1, 4)


def _ratio(name: str, ratio: float) -> None:
    if not (ratio > 0.0 and np.isfinite(ratio)):
        raise ValueError(f"{name}: stiffness ratio {ratio!r} must be positive")


def _on_planes(name: str, body: Body, centre: np.ndarray, axes: np.ndarray) -> None:
    """A part model mirrors its zones: one that is not centred on the plane and reaches beyond it would be two."""
    for k in range(2):
        if body.nodes[:, k].min() >= 0.0 and centre[k] != 0.0:
            raise ValueError(f"{name} at {centre.tolist()} mm: off the symmetry plane {'xy'[k]} = 0 of the model")


def _apart(centre: np.ndarray, radius: float, middle: np.ndarray, axes: np.ndarray) -> None:
    if not float(-geometry.EllipsoidShape(*axes).depth(centre - middle)) > radius:
        raise ValueError(f"inclusion of radius {radius:g} mm at {centre.tolist()} mm touches the cavity")


def _inside(specimen: ZoneShape, centre: np.ndarray, axes: np.ndarray) -> None:
    """The cavity's centre is in the body or on it, and no part of it comes out above z = 0."""
    if float(depth(specimen, centre)) < -1e-6:
        raise ValueError(f"cavity at {centre.tolist()} mm: its centre lies outside the body")
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 61), np.linspace(0, 2 * np.pi, 121), indexing="ij")
    wall = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    wall = centre + axes * wall
    upper = wall[..., 2] > 0.0
    if np.any(depth(specimen, wall[upper]) <= 0.0):
        raise ValueError(f"cavity of semi-axes {axes.tolist()} mm at {centre.tolist()} mm comes out above z = 0")


def _ellipsoid(body: Body, centre: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Fractions of a full ellipsoid; φ = r(r − 1)/|∇ r²/2| is its distance to first order, r = |(X − c)/axes|."""
    if np.any(axes == 0.0):
        return np.zeros_like(body.w)
    if isinstance(body, MeridianBody):
        return meridian_zones.fractions(body, lambda X: np.linalg.norm((X - centre) / axes, axis=-1) - 1.0)

    def level(cells: np.ndarray, at: np.ndarray) -> np.ndarray:
        s = (_points(body, cells, at) - centre) / axes
        r = np.linalg.norm(s, axis=-1)
        return r * (r - 1.0) / np.maximum(np.linalg.norm(s / axes, axis=-1), 1e-9 / axes.max())

    X = body.nodes[body.cells]
    middle = X.mean(1)
    reach = np.linalg.norm((X - middle[:, None]) / axes, axis=-1).max(1)
    r = np.linalg.norm((middle - centre) / axes, axis=-1)
    return _fractions(body, level, np.abs(r - 1.0) <= reach, r + reach < 1.0)


# ------------------------------------------------------------------------------------------------- cut cells


def _fractions(
    body: Body, level: Callable[[np.ndarray, np.ndarray], np.ndarray], near: np.ndarray, inside: np.ndarray
) -> np.ndarray:
    """Fractions (m, q); `level(cells, at)` is φ at barycentric points (k, 4); only cells `near` are looked at."""
    lattice, pieces = divided(N_PIECES_PER_CUT_EDGE)
    middles = lattice[pieces].mean(1)
    points = get_quadrature(RefTet, 2)[0]
    fraction = np.where(inside, 1.0, 0.0)[:, None] * np.ones(body.w.shape[1])
    for cells in np.array_split(np.nonzero(near)[0], max(1, int(near.sum()) // 500)):
        phi = level(cells, lattice)
        # the plane through the corners misses a curved φ: its mean error over a piece is 4/5 of that at the middle
        bend = np.ascontiguousarray(0.8 * (phi[:, pieces].mean(-1) - level(cells, middles)))
        moments, whole = _moments(
            body.nodes[body.cells[cells]], phi, bend, lattice, pieces, quadratic_shape_functions(middles)[1]
        )
        fraction[cells] = _fit(body.w[cells], barycentric(points.T), moments, whole)
    return fraction


def barycentric(xi: np.ndarray) -> np.ndarray:
    """(k, 4) from reference coordinates (k, 3)."""
    return np.column_stack([1.0 - xi.sum(1), xi])


def quadratic_shape_functions(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions (k, 10) and their gradients (k, 10, 3) at barycentric points (k, 4)."""
    values = [ElementTetP2().lbasis(at[:, 1:].T, a) for a in range(10)]
    return np.stack([v[0] for v in values], axis=1), np.stack([v[1].T for v in values], axis=1)


def _points(body: Body, cells: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Places (c, k, 3) of barycentric points (k, 4) in cells (c,)."""
    return np.einsum("ka,cai->cki", quadratic_shape_functions(at)[0], body.nodes[body.cells[cells]])


def _missed(body: Body, specimen: ZoneShape, cells: np.ndarray, at: np.ndarray, k: int) -> np.ndarray:
    """Depth of the facet opposite to corner k below the points, fading out towards that corner."""
    rest = 1.0 - at[:, k]
    foot = np.where(np.arange(4) == k, 0.0, at) / np.where(rest > 0.0, rest, 1.0)[:, None]
    foot[rest <= 0.0] = np.where(np.arange(4) == (k + 1) % 4, 1.0, 0.0)
    return rest * depth(specimen, _points(body, cells, foot))


def divided(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric points (k, 4) that divide a tetrahedron's edges into n parts, and the n³ pieces (n³, 4) between.

    The unit cubes of the sorted chain 0 ≤ x ≤ y ≤ z ≤ n, each cut into six by Kuhn, tile it.
    """
    index = {p: i for i, p in enumerate((x, y, z) for z in range(n + 1) for y in range(z + 1) for x in range(y + 1))}
    pieces = []
    for corner in index:
        for order in itertools.permutations(range(3)):
            path = [corner]
            for axis in order:
                a, b, c = path[-1]
                path.append((a + (axis == 0), b + (axis == 1), c + (axis == 2)))
            if all(p in index for p in path):
                pieces.append([index[p] for p in path])
    x, y, z = np.array(list(index), float).T / n
    return np.column_stack([1.0 - z, z - y, y - x, x]), np.array(pieces)


def _fit(w: np.ndarray, at: np.ndarray, moments: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Factors f (c, q) at the quadrature points `at` (q, 4) for barycentric moments (c, 4) of the zone and the cell.

    Σ w f λ = m where 0 ≤ f ≤ 1 allows it; otherwise f + c is cut to [0, 1] with c such that the volume Σ w f stays.
    """
    total = w.sum(1)
    volume = np.clip(moments.sum(1) / whole.sum(1), 0.0, 1.0)
    share = moments / whole.sum(1)[:, None]
    share += volume[:, None] * (w @ at / total[:, None] - whole / whole.sum(1)[:, None])  # exact for the full cell
    wanted = np.linalg.solve(at.T, share.T).T * total[:, None] / w
    low, high = -wanted.max(1) - ROUNDED_END_HALF_WIDTH, 1.0 + ROUNDED_END_HALF_WIDTH - wanted.min(1)
    for _ in range(60):
        c = 0.5 * (low + high)
        short = (w * _cut(wanted + c[:, None])).sum(1) < volume * total
        low, high = np.where(short, c, low), np.where(short, high, c)
    f = _cut(wanted + 0.5 * (low + high)[:, None])
    return np.where(volume[:, None] <= 0.0, 0.0, np.where(volume[:, None] >= 1.0, 1.0, f))


def _cut(x: np.ndarray) -> np.ndarray:
    """x cut to [0, 1] with ends rounded by parabolas, once differentiable."""
    near = np.minimum(x, 1.0 - x)
    end = np.where(
        near < -ROUNDED_END_HALF_WIDTH,
        0.0,
        np.where(
            near < ROUNDED_END_HALF_WIDTH, (near + ROUNDED_END_HALF_WIDTH) ** 2 / (4.0 * ROUNDED_END_HALF_WIDTH), near
        ),
    )
    return np.where(x < 0.5, end, 1.0 - end)


@compiled()
def _moments(X, phi, bend, lattice, pieces, dN):  # type: ignore[no-untyped-def]
    """∫ λ dV over φ < 0 and over the cell, both (c, 4) mm³, λ being the barycentric coordinates of the cell."""
    count = len(X)
    zone, whole = np.zeros((count, 4)), np.zeros((count, 4))
    for e in range(count):
        for p in range(len(pieces)):
            D = np.zeros((3, 3))
            for a in range(10):
                for i in range(3):
                    for j in range(3):
                        D[i, j] += X[e, a, i] * dN[p, a, j]
            det = (
                D[0, 0] * (D[1, 1] * D[2, 2] - D[1, 2] * D[2, 1])
                - D[0, 1] * (D[1, 0] * D[2, 2] - D[1, 2] * D[2, 0])
                + D[0, 2] * (D[1, 0] * D[2, 1] - D[1, 1] * D[2, 0])
            )
            volume = abs(det) / (6.0 * len(pieces))
            corner = lattice[pieces[p]]
            value = phi[e][pieces[p]] - bend[e, p]
            part, mean = _below(value)
            for j in range(4):
                for k in range(4):
                    whole[e, j] += 0.25 * volume * corner[k, j]
                    zone[e, j] += volume * part * mean[k] * corner[k, j]
    return zone, whole


@compiled()
def _below(v):  # type: ignore[no-untyped-def]
    """Fraction of a tetrahedron in which the linear function with corner values v (4,) is negative, and its centroid.

    One negative corner cuts off a tetrahedron with edge ratios v_a/(v_a − v_j); two leave a wedge of three tetrahedra.
    """
    order = np.argsort(v)
    negative = 0
    for k in range(4):
        if v[k] < 0.0:
            negative += 1
    if negative == 0:
        return 0.0, np.full(4, 0.25)
    if negative == 4:
        return 1.0, np.full(4, 0.25)
    if negative != 2:
        a = order[0] if negative == 1 else order[3]
        part, mean = 1.0, np.zeros(4)
        for j in range(4):
            if j != a:
                t = v[a] / (v[a] - v[j])
                part *= t
                mean[j] += 0.25 * t
                mean[a] -= 0.25 * t
        mean[a] += 1.0
        if negative == 1:
            return part, mean
        return 1.0 - part, (0.25 - part * mean) / (1.0 - part)
    wedge = np.zeros((6, 4))
    for i in range(2):
        wedge[3 * i, order[i]] = 1.0
        for j in range(2):
            t = v[order[i]] / (v[order[i]] - v[order[2 + j]])
            wedge[3 * i + 1 + j, order[i]] = 1.0 - t
            wedge[3 * i + 1 + j, order[2 + j]] = t
    part, mean = 0.0, np.zeros(4)
    for k in range(3):
        volume = abs(np.linalg.det(wedge[k : k + 4]))
        part += volume
        for i in range(4):
            mean += 0.25 * volume * wedge[k + i]
    return part, mean / part
