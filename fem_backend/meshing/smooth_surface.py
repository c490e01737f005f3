"""The smooth surface that the facets of a scan stand for: jets at its vertices, blended over the facets.

At each vertex a cubic height function is fitted to the vertices two edges around (a jet; Cazals and Pouget 2005,
section 3: position to h⁴, normal to h³).  Over a facet the signed distances f_a to the jets of its corners are blended,
f = Σ w_a f_a / Σ w_a, w = b²(3 − 2b) of the barycentric coordinates b of the closest point of the facet: at an edge the
third corner has no part in value and slope, so the zero of f has no kinks but those by which neighbouring jets differ.
A fit rather than an interpolation: scatter of the vertices is averaged over some twenty of them.  Edges and corners of
a body are rounded over two facets.  Lengths in the unit of the vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix

from fem_backend.compiled import compiled
from fem_backend.meshing.nearest_facets import FacetTree, nearest_one

JET_RIDGE_SHARE = 1e-9  # of the diagonal of the normal equations: a fit through too few points keeps to the lower terms
MAX_JET_NEIGHBOURS = 40  # neighbours of a vertex that count, the nearest
N_JETS_AT_A_TIME = 20_000  # vertices fitted at a time
MAX_STEPS_TO_SURFACE = 12  # Newton steps to the surface: two or three do
MAX_STEPS_ALONG_SURFACE = 60  # Newton steps along it: four do but where a ball would nearly fit into a hollow
MIN_CURVATURE_FACTOR = 0.3  # least 1 + d κ of a step: beyond a centre of curvature it would turn
# i, j of the terms u^i v^j of a cubic, but for the constant
JET_POWERS = np.array([(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)])


@dataclass(frozen=True)
class SmoothSurface:
    """Vertices p (n, 3) and facets (m, 3) of a closed surface, facing outwards, with a jet at every vertex.

    `frames` (n, 3, 3) have the rows t₁, t₂, n; z = c₀ + Σ c_k u^i v^j with the powers of `JET_POWERS` is the height
    over the tangent plane, `jets` (n, 10) its coefficients.
    """

    vertices: np.ndarray
    facets: np.ndarray
    frames: np.ndarray
    jets: np.ndarray
    tree: FacetTree

    @classmethod
    def through(cls, vertices: np.ndarray, facets: np.ndarray) -> SmoothSurface:
        """The smooth surface near the vertices of a closed surface."""
        frames = _frames(vertex_normals(vertices, facets))
        return cls(vertices, facets, frames, _jets(vertices, facets, frames), FacetTree.of(vertices, facets))

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        """What the compiled loops need."""
        t = self.tree
        return self.facets, self.vertices, self.frames, self.jets, t.corners, t.boxes, t.children, t.span, t.order

    @property
    def _small(self) -> float:
        """Round-off of a place (mm)."""
        return 1e-14 * float(np.abs(self.vertices).max())

    def level(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f (n,), about the signed distance, positive outside, and its gradient (n, 3) at points x (n, 3) nearby."""
        f, gradient, _ = _levels(_points(x), *self._arrays)
        return f, gradient

    def project(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) near the surface moved onto it along the gradient, x ← x − f ∇f/|∇f|²."""
        y = _points(x).copy()
        _project(y, self._small, *self._arrays)
        return y

    def normals(self, y: np.ndarray) -> np.ndarray:
        """Outward unit normals (n, 3) at points y (n, 3) of the surface."""
        gradient = self.level(y)[1]
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def curvatures(self, y: np.ndarray) -> np.ndarray:
        """Principal curvatures (n, 2) at points y (n, 3) of the surface, those of a ball positive, larger last."""
        _, gradient, hessian = _levels(_points(y), *self._arrays)
        slope = np.linalg.norm(gradient, axis=1)
        t = _frames(gradient / slope[:, None])[:, :2]
        return np.linalg.eigvalsh(np.einsum("nai,nij,nbj->nab", t, hessian, t)) / slope[:, None]

    def closest(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the surface closest to points x (n, 3) anywhere.

        From the closest point of the facets by Newton's method, y ← P(y + (I + d S)⁻¹ T(x − y)), d the distance
        outwards, S the shape operator, T the projection on the tangent plane.  Where two points of the surface are
        nearly as close, it is the one that belongs to the closer facet.
        """
        return _closest(_points(x), self._small, *self._arrays)[0]

    def depth(self, x: np.ndarray) -> np.ndarray:
        """Distance (…,) of points x (…, 3) to the surface, negative outside."""
        return -_closest(_points(x), 1e6 * self._small, *self._arrays)[1].reshape(np.shape(x)[:-1])


def _points(x: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(x, float).reshape(-1, 3)


def vertex_normals(vertices: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3) at vertices: Σ a × b/(|a|²|b|²) over the facets around, exact on a sphere (Max 1999)."""
    out = np.zeros_like(vertices)
    for k in range(3):
        here, a, b = (vertices[facets[:, (k + j) % 3]] for j in range(3))
        a, b = a - here, b - here
        size = np.einsum("fi,fi->f", a, a) * np.einsum("fi,fi->f", b, b)
        np.add.at(out, facets[:, k], np.cross(a, b) / np.maximum(size, 1e-300)[:, None])
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)


def _frames(normals: np.ndarray) -> np.ndarray:
    """Orthonormal rows t₁, t₂, n (n, 3, 3) of unit normals (n, 3) (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([first, second, normals], axis=1)


def _jets(vertices: np.ndarray, facets: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Coefficients (n, 10) of cubics fitted by least squares to the vertices two edges around, the near ones more."""
    n = len(vertices)
    edges = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    one = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    one = ((one + one.T) > 0).astype(np.int32)
    two = (one + one @ one).tolil()
    around = [np.array([k, *(j for j in row if j != k)]) for k, row in enumerate(two.rows)]
    out = np.zeros((n, 10))
    for k in range(0, n, N_JETS_AT_A_TIME):
        out[k : k + N_JETS_AT_A_TIME] = _fit(vertices, frames, around, np.arange(k, min(k + N_JETS_AT_A_TIME, n)))
    return out


def _fit(vertices: np.ndarray, frames: np.ndarray, around: list[np.ndarray], own: np.ndarray) -> np.ndarray:
    width = min(max(len(around[k]) for k in own), MAX_JET_NEIGHBOURS)
    index, there = np.zeros((len(own), width), int), np.zeros((len(own), width), bool)
    for row, k in enumerate(own):
        near = around[k]
        if len(near) > width:
            near = near[np.argsort(((vertices[near] - vertices[k]) ** 2).sum(1), kind="stable")[:width]]
        index[row, : len(near)], there[row, : len(near)] = near, True
    local = np.einsum("nai,nki->nka", frames[own], vertices[index] - vertices[own][:, None])
    r = np.linalg.norm(local, axis=-1)
    reach = np.where(there, r, 0.0).max(1)  # of the farthest: its weight is 1/e
    weight = np.where(there, np.exp(-((r / reach[:, None]) ** 2)), 0.0)
    u, v, z = np.moveaxis(local / reach[:, None, None], -1, 0)
    basis = np.stack([np.ones_like(u), *(u**i * v**j for i, j in JET_POWERS)], axis=-1)
    normal = np.einsum("nka,nk,nkb->nab", basis, weight, basis)
    trace = np.trace(normal, axis1=1, axis2=2)[:, None, None] / 10.0
    degree = np.array([0, *JET_POWERS.sum(1)])
    normal += JET_RIDGE_SHARE * trace * np.diag(10.0 ** (2.0 * np.maximum(degree - 1, 0)))
    right = np.einsum("nka,nk,nk->na", basis, weight, z)
    scaled = np.linalg.solve(normal, right[..., None])[..., 0]
    return scaled * reach[:, None] ** (1.0 - degree)


@compiled()
def _blend(x, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b):  # type: ignore[no-untyped-def]
    """f at x (3,); fills ∇f (3,) and ∇∇f (3, 3) without the small parts of ∇w, and barycentric coordinates b (3,)."""
    facet, _ = nearest_one(x, corners, boxes, children, span, order, b)
    whole, value = 0.0, 0.0
    g[:] = 0.0
    H[:, :] = 0.0
    for a in range(3):
        whole += b[a] * b[a] * (3.0 - 2.0 * b[a])
    for a in range(3):
        k = facets[facet, a]
        t, c = frames[k], jets[k]
        u = v = z = 0.0
        for i in range(3):
            away = x[i] - vertices[k, i]
            u += t[0, i] * away
            v += t[1, i] * away
            z += t[2, i] * away
        height = c[0] + (c[1] + (c[3] + c[6] * u + c[7] * v) * u + c[4] * v) * u
        height += (c[2] + (c[5] + c[8] * u + c[9] * v) * v) * v
        hu = c[1] + (2.0 * c[3] + 3.0 * c[6] * u + 2.0 * c[7] * v) * u + (c[4] + c[8] * v) * v
        hv = c[2] + (2.0 * c[5] + 3.0 * c[9] * v + 2.0 * c[8] * u) * v + (c[4] + c[7] * u) * u
        huu, huv = 2.0 * c[3] + 6.0 * c[6] * u + 2.0 * c[7] * v, c[4] + 2.0 * c[7] * u + 2.0 * c[8] * v
        hvv = 2.0 * c[5] + 2.0 * c[8] * u + 6.0 * c[9] * v
        share = b[a] * b[a] * (3.0 - 2.0 * b[a]) / whole / np.sqrt(1.0 + hu * hu + hv * hv)
        value += share * (z - height)
        for i in range(3):
            g[i] += share * (t[2, i] - hu * t[0, i] - hv * t[1, i])
            for j in range(3):
                bend = huu * t[0, i] * t[0, j] + huv * (t[0, i] * t[1, j] + t[1, i] * t[0, j]) + hvv * t[1, i] * t[1, j]
                H[i, j] -= share * bend
    return value


@compiled()
def _levels(x, facets, vertices, frames, jets, corners, boxes, children, span, order):  # type: ignore[no-untyped-def]
    f, g, H, b = np.empty(len(x)), np.empty((len(x), 3)), np.empty((len(x), 3, 3)), np.empty(3)
    for k in range(len(x)):
        f[k] = _blend(x[k], facets, vertices, frames, jets, corners, boxes, children, span, order, g[k], H[k], b)
    return f, g, H


@compiled()
def _onto(y, small, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b):  # type: ignore[no-untyped-def]
    """Move y (3,) onto the surface; g and H are those of the last step but one."""
    for _ in range(MAX_STEPS_TO_SURFACE):
        f = _blend(y, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b)
        step = f / (g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
        for i in range(3):
            y[i] -= step * g[i]
        if abs(step) <= small:
            break


@compiled()
def _project(y, small, facets, vertices, frames, jets, corners, boxes, children, span, order):  # type: ignore[no-untyped-def]
    g, H, b = np.empty(3), np.empty((3, 3)), np.empty(3)
    for k in range(len(y)):
        _onto(y[k], small, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b)


@compiled()
def _closest(x, small, facets, vertices, frames, jets, corners, boxes, children, span, order):  # type: ignore[no-untyped-def]
    """Closest points (n, 3) and signed distances (n,), positive outside."""
    out, distance = np.empty_like(x), np.empty(len(x))
    g, H, b, y, n, t, way = (
        np.empty(3),
        np.empty((3, 3)),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty((2, 3)),
        np.empty(3),
    )
    for k in range(len(x)):
        facet, _ = nearest_one(x[k], corners, boxes, children, span, order, b)
        for i in range(3):
            y[i] = 0.0
            for a in range(3):
                y[i] += b[a] * vertices[facets[facet, a], i]
        shortest = np.inf
        for _ in range(MAX_STEPS_ALONG_SURFACE):
            _onto(y, small, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b)
            _blend(y, facets, vertices, frames, jets, corners, boxes, children, span, order, g, H, b)
            slope, d, square = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]), 0.0, 0.0
            for i in range(3):
                n[i] = g[i] / slope
                way[i] = x[k, i] - y[i]
                d += n[i] * way[i]
                square += way[i] * way[i]
            if np.sqrt(square) < shortest:
                shortest, distance[k] = np.sqrt(square), np.copysign(np.sqrt(square), d)
                out[k] = y
            size = _step(n, H, slope, d, way, t, y)
            if size <= 10.0 * small:
                break
    return out, distance


@compiled()
def _step(n, H, slope, d, way, t, y):  # type: ignore[no-untyped-def]
    """Move y (3,) by (I + d S)⁻¹ T way along the tangent plane; its length.

    Stiff directions go not beyond `MIN_CURVATURE_FACTOR`.
    """
    sign = 1.0 if n[2] >= 0.0 else -1.0
    p = -1.0 / (sign + n[2])
    q = n[0] * n[1] * p
    t[0, 0], t[0, 1], t[0, 2] = 1.0 + sign * n[0] * n[0] * p, sign * q, -sign * n[0]
    t[1, 0], t[1, 1], t[1, 2] = q, sign + n[1] * n[1] * p, -n[1]
    s00 = s01 = s11 = r0 = r1 = 0.0
    for i in range(3):
        r0 += t[0, i] * way[i]
        r1 += t[1, i] * way[i]
        for j in range(3):
            s00 += t[0, i] * H[i, j] * t[0, j] / slope
            s01 += t[0, i] * H[i, j] * t[1, j] / slope
            s11 += t[1, i] * H[i, j] * t[1, j] / slope
    turn = 0.5 * np.arctan2(2.0 * s01, s00 - s11)
    c, s = np.cos(turn), np.sin(turn)
    one = max(1.0 + d * (c * c * s00 + 2.0 * c * s * s01 + s * s * s11), MIN_CURVATURE_FACTOR)
    two = max(1.0 + d * (s * s * s00 - 2.0 * c * s * s01 + c * c * s11), MIN_CURVATURE_FACTOR)
    along, across = (c * r0 + s * r1) / one, (c * r1 - s * r0) / two
    square = 0.0
    for i in range(3):
        move = (c * along - s * across) * t[0, i] + (s * along + c * across) * t[1, i]
        y[i] += move
        square += move * move
    return np.sqrt(square)
