"""The point of a triangulated surface that is closest to a point, and where it crosses itself: a tree of boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.compiled import compiled

MAX_FACETS_PER_BOX = 8  # facets in the smallest boxes


@dataclass(frozen=True)
class FacetTree:
    """Boxes (k, 2, 3) around facets: children (k, 2), or −1 and the facets `order[start:end]` (k, 2) of a leaf."""

    corners: np.ndarray
    boxes: np.ndarray
    children: np.ndarray
    span: np.ndarray
    order: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, facets: np.ndarray) -> FacetTree:
        """The tree of a surface, cut at the median along the longest side of each box."""
        corners = np.ascontiguousarray(vertices[facets], float)
        order, middle = np.arange(len(facets)), corners.mean(1)
        boxes: list[list[np.ndarray]] = []
        children: list[list[int]] = []
        span: list[list[int]] = []
        ways = [(0, len(facets), -1, 0)]
        while ways:
            start, end, parent, side = ways.pop()
            own = order[start:end]
            if parent >= 0:
                children[parent][side] = len(boxes)
            k = len(boxes)
            boxes.append([corners[own].min((0, 1)), corners[own].max((0, 1))])
            children.append([-1, -1])
            span.append([start, end])
            if end - start <= MAX_FACETS_PER_BOX:
                continue
            axis = int(np.argmax(np.ptp(middle[own], axis=0)))
            half = (end - start) // 2
            order[start:end] = own[np.argpartition(middle[own, axis], half)]
            ways += [(start, start + half, k, 0), (start + half, end, k, 1)]
        return cls(corners, np.array(boxes), np.array(children), np.array(span), order)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Facet (n,), barycentric coordinates (n, 3) and squared distance (n,) of the closest point of the surface."""
        x = np.ascontiguousarray(points, float).reshape(-1, 3)
        return _nearest(x, self.corners, self.boxes, self.children, self.span, self.order)

    def crossings(self, edges: np.ndarray, facets: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        """Points (k, 3), one of each edge (m, 2) that passes through a facet with which it shares no vertex.

        Edges that only touch a facet are none of them: of the five volumes of the edge with the facet's plane and sides
        none is zero.  Source: Möller & Trumbore, J. Graphics Tools 2 (1997) 21, in the signed volumes of its section 2.
        """
        at = np.full((len(edges), 3), np.nan)
        corners = np.ascontiguousarray(facets, np.int64)
        _crossings(
            np.ascontiguousarray(edges, np.int64),
            np.ascontiguousarray(vertices, float),
            corners,
            self.corners,
            self.boxes,
            self.children,
            self.span,
            self.order,
            at,
        )
        return at[np.isfinite(at[:, 0])]


@compiled()
def _crossings(edges, vertices, facets, corners, boxes, children, span, order, at):  # type: ignore[no-untyped-def]
    """Fills `at` (m, 3) with the point where an edge (m, 2) passes through a facet; the rest is left."""
    stack = np.empty(128, np.int64)
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        p, q = vertices[i], vertices[j]
        top, found = 1, False
        stack[0] = 0
        while top > 0 and not found:
            top -= 1
            node = stack[top]
            apart = False
            for k in range(3):
                apart |= max(p[k], q[k]) < boxes[node, 0, k] or min(p[k], q[k]) > boxes[node, 1, k]
            if apart:
                continue
            if children[node, 0] >= 0:
                stack[top], stack[top + 1] = children[node, 0], children[node, 1]
                top += 2
                continue
            for m in range(span[node, 0], span[node, 1]):
                f = order[m]
                g = facets[f]
                if g[0] == i or g[1] == i or g[2] == i or g[0] == j or g[1] == j or g[2] == j:
                    continue
                a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
                below, above = _volume(a, b, c, p), _volume(a, b, c, q)
                u, v, w = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
                if below * above < 0.0 and ((u > 0.0 and v > 0.0 and w > 0.0) or (u < 0.0 and v < 0.0 and w < 0.0)):
                    at[e] = p + below / (below - above) * (q - p)
                    found = True
                    break


@compiled()
def _volume(a, b, c, d):  # type: ignore[no-untyped-def]
    """(b − a) × (c − a) · (d − a), six times the volume of a tetrahedron."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    u, v, w = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return (y * w - z * v) * (d[0] - a[0]) + (z * u - x * w) * (d[1] - a[1]) + (x * v - y * u) * (d[2] - a[2])


@compiled()
def _nearest(x, corners, boxes, children, span, order):  # type: ignore[no-untyped-def]
    n = len(x)
    facet, weight, square = np.empty(n, np.int64), np.empty((n, 3)), np.empty(n)
    for k in range(n):
        facet[k], square[k] = nearest_one(x[k], corners, boxes, children, span, order, weight[k])
    return facet, weight, square


@compiled()
def nearest_one(x, corners, boxes, children, span, order, weight):  # type: ignore[no-untyped-def]
    """Facet and squared distance of the closest point to x (3,); fills its barycentric `weight` (3,)."""
    stack, bound, w = np.empty(128, np.int64), np.empty(128), np.empty(3)
    best, top, facet = np.inf, 1, -1
    stack[0], bound[0] = 0, 0.0
    while top > 0:
        top -= 1
        if bound[top] >= best:
            continue
        node = stack[top]
        if children[node, 0] < 0:
            for m in range(span[node, 0], span[node, 1]):
                f = order[m]
                d = _on_facet(x, corners[f], w)
                if d < best:
                    best, facet = d, f
                    weight[0], weight[1], weight[2] = w[0], w[1], w[2]
            continue
        a, b = children[node, 0], children[node, 1]
        da, db = _to_box(x, boxes[a]), _to_box(x, boxes[b])
        if da < db:  # the nearer is looked at first
            a, b, da, db = b, a, db, da
        if da < best:
            stack[top], bound[top] = a, da
            top += 1
        if db < best:
            stack[top], bound[top] = b, db
            top += 1
    return facet, best


@compiled()
def _to_box(x, box):  # type: ignore[no-untyped-def]
    d = 0.0
    for i in range(3):
        out = max(box[0, i] - x[i], 0.0, x[i] - box[1, i])
        d += out * out
    return d


@compiled()
def _on_facet(x, c, w):  # type: ignore[no-untyped-def]
    """Squared distance of x (3,) to the triangle c (3, 3); fills the barycentric w (Ericson 2005, section 5.1.5)."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for i in range(3):
        ab, ac = c[1, i] - c[0, i], c[2, i] - c[0, i]
        d1 += ab * (x[i] - c[0, i])
        d2 += ac * (x[i] - c[0, i])
        d3 += ab * (x[i] - c[1, i])
        d4 += ac * (x[i] - c[1, i])
        d5 += ab * (x[i] - c[2, i])
        d6 += ac * (x[i] - c[2, i])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, u = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, u = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, u = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, u = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, u = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        u = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - u
    else:
        v, u = vb / (va + vb + vc), vc / (va + vb + vc)
    w[0], w[1], w[2] = 1.0 - v - u, v, u
    square = 0.0
    for i in range(3):
        out = x[i] - (w[0] * c[0, i] + w[1] * c[1, i] + w[2] * c[2, i])
        square += out * out
    return square
