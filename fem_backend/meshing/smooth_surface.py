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

from fem_backend.meshing.nearest_facets import FacetTree

RIDGE = 1e-9  # of the diagonal of the normal equations: a fit through too few points keeps to the lower terms
MOST = 40  # neighbours of a vertex that count, the nearest
CHUNK = 20_000  # vertices fitted or points moved at a time
TURNS = 12  # Newton steps to the surface: two or three do
POWERS = np.array([(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)])


@dataclass(frozen=True)
class SmoothSurface:
    """Vertices p (n, 3) and facets (m, 3) of a closed surface, facing outwards, with a jet at every vertex.

    `frames` (n, 3, 3) have the rows t₁, t₂, n; z = c₀ + Σ c_k u^i v^j with the powers of `POWERS` is the height over
    the tangent plane, `jets` (n, 10) its coefficients.
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

    def level(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f (n,), about the signed distance, positive outside, and its gradient (n, 3) at points x (n, 3) nearby."""
        f, gradient, _ = self._blend(x, False)
        return f, gradient

    def project(self, x: np.ndarray) -> np.ndarray:
        """Points (n, 3) near the surface moved onto it along the gradient, x ← x − f ∇f/|∇f|²."""
        y = np.array(x, float)
        left = np.arange(len(y))
        small = 1e-14 * float(np.abs(self.vertices).max())
        for _ in range(TURNS):
            f, gradient = self.level(y[left])
            step = f / np.einsum("ni,ni->n", gradient, gradient)
            y[left] -= step[:, None] * gradient
            left = left[np.abs(step) > small]
            if not len(left):
                break
        return y

    def normals(self, y: np.ndarray) -> np.ndarray:
        """Outward unit normals (n, 3) at points y (n, 3) of the surface."""
        gradient = self.level(y)[1]
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def curvatures(self, y: np.ndarray) -> np.ndarray:
        """Principal curvatures (n, 2) at points y (n, 3) of the surface, those of a ball positive, larger last."""
        _, gradient, hessian = self._blend(y, True)
        slope = np.linalg.norm(gradient, axis=1)
        t = _frames(gradient / slope[:, None])[:, :2]
        return np.linalg.eigvalsh(np.einsum("nai,nij,nbj->nab", t, hessian, t)) / slope[:, None]

    def closest(self, x: np.ndarray, turns: int = 30) -> np.ndarray:
        """Points (n, 3) of the surface closest to points x (n, 3) anywhere.

        From the closest point of the facets by Newton's method, y ← P(y + (I + d S)⁻¹ T(x − y)), d the distance
        outwards, S the shape operator, T the projection on the tangent plane.  Where two points of the surface are
        nearly as close, it is the one that belongs to the closer facet.
        """
        x = np.asarray(x, float)
        facet, weight, _ = self.tree.nearest(x)
        y = self.project(np.einsum("na,nai->ni", weight, self.vertices[self.facets[facet]]))
        best, shortest = y.copy(), np.linalg.norm(x - y, axis=1)
        left = np.arange(len(x))
        small = 1e-13 * float(np.abs(self.vertices).max())
        for _ in range(turns):
            _, gradient, hessian = self._blend(y[left], True)
            slope = np.linalg.norm(gradient, axis=1)
            frame = _frames(gradient / slope[:, None])
            t, way = frame[:, :2], x[left] - y[left]
            d = np.einsum("ni,ni->n", frame[:, 2], way)
            S = np.einsum("nai,nij,nbj->nab", t, hessian, t) / slope[:, None, None]
            values, vectors = np.linalg.eigh(S)
            stiff = np.maximum(1.0 + d[:, None] * values, 0.3)  # inside, beyond a centre of curvature, it would turn
            along = np.einsum("nba,nbi,ni->na", vectors, t, way) / stiff
            step = np.einsum("nba,nbi,na->ni", vectors, t, along)
            y[left] = self.project(y[left] + step)
            now = np.linalg.norm(x[left] - y[left], axis=1)
            nearer = now < shortest[left]
            best[left[nearer]], shortest[left[nearer]] = y[left[nearer]], now[nearer]
            left = left[np.linalg.norm(step, axis=1) > small]
            if not len(left):
                break
        return best

    def depth(self, x: np.ndarray, turns: int = 4) -> np.ndarray:
        """Distance (…,) of points x (…, 3) to the surface, negative outside."""
        flat = np.asarray(x, float).reshape(-1, 3)
        out = np.empty(len(flat))
        for part in np.array_split(np.arange(len(flat)), max(1, len(flat) // CHUNK)):
            y = self.closest(flat[part], turns)
            away = flat[part] - y
            out[part] = -np.copysign(np.linalg.norm(away, axis=1), np.einsum("ni,ni->n", away, self.normals(y)))
        return out.reshape(np.shape(x)[:-1])

    def _blend(self, x: np.ndarray, second: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f, ∇f and, where asked for, ∇∇f (else empty) without the small parts of ∇w, at points x (n, 3)."""
        x = np.asarray(x, float)
        facet, b, _ = self.tree.nearest(x)
        w = b * b * (3.0 - 2.0 * b)
        w = w / w.sum(1, keepdims=True)
        f, gradient = np.zeros(len(x)), np.zeros((len(x), 3))
        hessian = np.zeros((len(x), 3, 3)) if second else np.empty(0)
        for a in range(3):
            k = self.facets[facet, a]
            frame, c = self.frames[k], self.jets[k]
            u, v, z = np.einsum("nai,ni->an", frame, x - self.vertices[k])
            height = c[:, 0] + c[:, 1] * u + c[:, 2] * v + c[:, 3] * u * u + c[:, 4] * u * v + c[:, 5] * v * v
            height += ((c[:, 6] * u + c[:, 7] * v) * u + c[:, 8] * v * v) * u + c[:, 9] * v**3
            hu = c[:, 1] + 2 * c[:, 3] * u + c[:, 4] * v + 3 * c[:, 6] * u * u + 2 * c[:, 7] * u * v + c[:, 8] * v * v
            hv = c[:, 2] + c[:, 4] * u + 2 * c[:, 5] * v + c[:, 7] * u * u + 2 * c[:, 8] * u * v + 3 * c[:, 9] * v * v
            share = w[:, a] / np.sqrt(1.0 + hu * hu + hv * hv)
            f += share * (z - height)
            gradient += share[:, None] * (frame[:, 2] - hu[:, None] * frame[:, 0] - hv[:, None] * frame[:, 1])
            if second:
                huu, huv = 2 * c[:, 3] + 6 * c[:, 6] * u + 2 * c[:, 7] * v, c[:, 4] + 2 * c[:, 7] * u + 2 * c[:, 8] * v
                bend = np.stack([huu, huv, huv, 2 * c[:, 5] + 2 * c[:, 8] * u + 6 * c[:, 9] * v], 1).reshape(-1, 2, 2)
                hessian -= share[:, None, None] * np.einsum("nai,nab,nbj->nij", frame[:, :2], bend, frame[:, :2])
        return f, gradient, hessian


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
    for k in range(0, n, CHUNK):
        out[k : k + CHUNK] = _fit(vertices, frames, around, np.arange(k, min(k + CHUNK, n)))
    return out


def _fit(vertices: np.ndarray, frames: np.ndarray, around: list[np.ndarray], own: np.ndarray) -> np.ndarray:
    width = min(max(len(around[k]) for k in own), MOST)
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
    basis = np.stack([np.ones_like(u), *(u**i * v**j for i, j in POWERS)], axis=-1)
    normal = np.einsum("nka,nk,nkb->nab", basis, weight, basis)
    trace = np.trace(normal, axis1=1, axis2=2)[:, None, None] / 10.0
    degree = np.array([0, *POWERS.sum(1)])
    normal += RIDGE * trace * np.diag(10.0 ** (2.0 * np.maximum(degree - 1, 0)))
    right = np.einsum("nka,nk,nk->na", basis, weight, z)
    scaled = np.linalg.solve(normal, right[..., None])[..., 0]
    return scaled * reach[:, None] ** (1.0 - degree)
