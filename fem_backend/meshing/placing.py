"""One quarter mesh with its fine elements at the top becomes the mesh of any specimen, point and symmetry.

Everything but the last scaling happens in the unit ball.  Only exact transforms are used, so symmetry planes and the
rim z = 0 stay exact, and the same template gives forces that are smooth in the semi-axes and in the point.
"""

from __future__ import annotations

import math

import numpy as np
from skfem import ElementTetP2, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing import prestretched
from fem_backend.meshing.mesh import BadMesh, Mesh, with_mid_edge_nodes

MAX_SHARE_FROM_TOP = 0.8  # semi-axes from the top: beyond it the coarse far side misses more than 1 % of the volume
MIN_PROJECTIVE_SHARE = -1.0  # share of the projective map: a tower's elements fold with less
# edges of unit length from one corner, by columns
REGULAR_TETRAHEDRON = np.array(
    [[1.0, 0.5, 0.5], [0.0, math.sqrt(3) / 2, math.sqrt(3) / 6], [0.0, 0.0, math.sqrt(2 / 3)]]
)
# of MIN_SCALED_JACOBIAN: columns of gathered elements are long and thin until the body is loaded
GATHERED_QUALITY_SHARE = 0.2
# scaled Jacobian below which an element only spoils the matrix; a well made mesh has 0.15 to 0.4
MIN_SCALED_JACOBIAN = 0.05


def assemble(
    quarter: Mesh,
    nominal: EllipsoidShape,
    body: EllipsoidShape,
    point: tuple[float, float] = (0.0, 0.0),
    planes: tuple[bool, bool] = (True, True),
    upright: bool = False,
    least: float = MIN_SCALED_JACOBIAN,
    deep: float = 0.0,
) -> MeshTet2:
    """Quadratic mesh of `body` with the fine elements at `point` (x, y) mm, from a quarter mesh of `nominal`.

    `planes` says which symmetry planes (x = 0, y = 0) bound the model: both give the quarter x ≥ 0, y ≥ 0, none the
    whole body.  Nodes of the quarter come first, then their mirror images.  `upright` elements stay so under the point
    (see `moved_on_surface`), whatever the shape of the body; without it they lean by its flatness.  `deep` is the
    length (mm) of an indenter that goes deep, for which nodes are gathered (see `prestretched`).  Raises ValueError
    when a point is off a kept plane and BadMesh when it is more than MAX_SHARE_FROM_TOP semi-axes from the top or
    elements are spoilt, a scaled Jacobian below `least`.
    """
    for axis in (0, 1):
        if planes[axis] and point[axis] != 0.0:
            raise ValueError(f"point = {point} mm is not on the symmetry plane {'xy'[axis]} = 0 of the model")
    X, tets = quarter.vertices / nominal.semi_axes, quarter.tets
    if deep:
        X = prestretched.below_pole(X, nominal.semi_axes, deep)
    for axis in (0, 1):
        if not planes[axis]:
            X, tets = mirrored_mesh(X, tets, axis)
    share = (point[0] / body.a, point[1] / body.b)
    X = moved_on_surface(X, *share, nominal) if upright else translated(X, *share)
    if math.hypot(*share) > MAX_SHARE_FROM_TOP + 1e-12:
        raise BadMesh(
            f"point = {point} mm is {math.hypot(*share):.2f} semi-axes from the top, at most {MAX_SHARE_FROM_TOP}"
        )
    ball = with_mid_edge_nodes(EllipsoidShape(1.0, 1.0, 1.0), Mesh(X, tets))
    placed = MeshTet2(ball.doflocs * body.semi_axes[:, None], ball.t)
    worst, least = float(scaled_jacobian(placed).min()), GATHERED_QUALITY_SHARE * least if deep else least
    if worst < least:
        raise BadMesh(f"elements are spoilt at point = {point} mm: scaled Jacobian {worst:.3f}, at least {least}")
    return placed


def mirrored_mesh(X: np.ndarray, tets: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """The mesh and its mirror image in the plane X[axis] = 0, whose nodes are shared."""
    off = np.nonzero(X[:, axis] != 0.0)[0]
    image = np.arange(len(X))
    image[off] = len(X) + np.arange(len(off))
    mirror = np.ones(3)
    mirror[axis] = -1.0
    return np.vstack([X, X[off] * mirror]), np.vstack([tets, image[tets][:, [0, 2, 1, 3]]])


def translated(X: np.ndarray, p: float, q: float) -> np.ndarray:
    """Hyperbolic translation of the unit ball that takes its pole (0, 0, 1) to the place above (p, q).

    x ↦ ((1 − s²)(x + s t) + |x + s t|² s t) / (1 + 2 s x·t + s²|x|²), t = (p, q, 0)/√(p² + q²),
    2s/(1 + s²) = √(p² + q²): conformal, keeps z = 0 and the plane of t and z (Ahlfors 1981, Möbius transformations in
    several dimensions, section II.2).  Elements at the pole shrink by √(1 − p² − q²).  X (n, 3).  Raises BadMesh
    when (p, q) is not inside the unit circle.
    """
    r = math.sqrt(p * p + q * q)
    if not r < 1.0:
        raise BadMesh(f"the point is {r:.3f} semi-axes from the top: not on the upper surface")
    s = r / (1.0 + math.sqrt(1.0 - r * r))
    sx, sy = (s * p / r, s * q / r) if r > 0.0 else (0.0, 0.0)
    # component by component: sums in a fixed order are equal to the bit on every machine and in every mirror image
    x, y, z = X.T
    xs, ys = x + sx, y + sy
    square = (x * x + y * y) + z * z
    moved = (xs * xs + ys * ys) + z * z
    below = 1.0 + 2.0 * (sx * x + sy * y) + s * s * square
    away = 1.0 - s * s
    return np.stack([(away * xs + moved * sx) / below, (away * ys + moved * sy) / below, away * z / below], 1) + 0.0


def moved_on_surface(X: np.ndarray, p: float, q: float, body: EllipsoidShape) -> np.ndarray:
    """As `translated`, but what stands on the pole stands on the surface of `body` at the new place.

    The conformal map does so in the ball; a body's own axes shear that, a plate of a/c = 5 by 60° at p = 0.35.  The
    projective map of the ball, x ↦ (n x + (1 + x·p/(1 + n)) p)/(1 + x·p), n = √(1 − p²), is the same on the surface
    and keeps verticals under the pole upright in the ball.  So x and y take 1 − (c/a)² and 1 − (c/b)² of it, which
    turns the vertical to the normal (p/a, q/b, n/c) of the body; surface, planes and the rim are those of both.
    """
    out = translated(X, p, q)
    n, (x, y, _) = math.sqrt(1.0 - (p * p + q * q)), X.T
    along = p * x + q * y
    for k, (own, place, axis) in enumerate(((x, p, body.a), (y, q, body.b))):
        share = max(1.0 - (body.c / axis) ** 2, MIN_PROJECTIVE_SHARE)
        out[:, k] += share * ((n * own + (1.0 + along / (1.0 + n)) * place) / (1.0 + along) - out[:, k])
    return out + 0.0


def scaled_jacobian(mesh: MeshTet2) -> np.ndarray:
    """Smallest det T / (|T|/√3)³ of each quadratic element (m,), T = ∂x/∂ξ of the regular tetrahedron.

    Taken over its ten nodes and four integration points; 1 for a regular element, ≤ 0 for one that is inside out.
    """
    i, j = np.array([0, 1, 0, 0, 1, 2]), np.array([1, 2, 2, 3, 3, 3])
    xi = np.hstack([RefTet.p, 0.5 * (RefTet.p[:, i] + RefTet.p[:, j]), get_quadrature(RefTet, 2)[0]])
    gradient = np.stack([ElementTetP2().lbasis(xi, a)[1] for a in range(10)])  # (10, 3, q)
    X = mesh.doflocs.T[mesh.dofs.element_dofs.T]
    T = np.einsum("mai,ajq->mqij", X, gradient) @ np.linalg.inv(REGULAR_TETRAHEDRON)
    return (np.linalg.det(T) / (np.linalg.norm(T, axis=(2, 3)) / math.sqrt(3)) ** 3).min(1)
