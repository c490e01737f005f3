"""Graded triangles in a polygon, well shaped where they lie; the same at every call.

Points of the outline are given; those inside repel each other until distances are as wanted (Persson & Strang 2004,
SIAM Rev. 46, 329), from a lattice thinned by a low-discrepancy sequence instead of at random.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import Delaunay, cKDTree

Size = Callable[[np.ndarray], np.ndarray]  # wanted edge length (n,) at points (n, 2)
N_REPULSION_ROUNDS = 40  # of repulsion
REST_LENGTH_RATIO = 1.2  # of the wanted length is that at rest: so that all push
MOVE_PER_FORCE = 0.2  # of the force is a move
FREE_AROUND_GIVEN_RATIO = 0.6  # wanted lengths around each given point that stay free of others
MIN_NEIGHBOUR_DISTANCE_RATIO = 0.5  # wanted lengths below which one of two neighbours is taken out
MIN_TRIANGLE_QUALITY = 1e-3  # quality below which a triangle is none
MAX_DIAGONAL_TURNS = 30  # of diagonals for one given edge
# multiples of these fill the square evenly (Roberts 2018)
EVEN_FILLING_MULTIPLES = (0.7548776662466927, 0.5698402909980532)


class NoTriangles(ValueError):
    """A polygon that was not filled with its given edges."""


def size_field(points: np.ndarray, sizes: np.ndarray, growth: float) -> Size:
    """h(x) = min_j (h_j + growth |x − x_j|) of sizes h_j (k,) mm at points x_j (k, 2) mm."""

    def size(x: np.ndarray) -> np.ndarray:
        far = np.linalg.norm(x[:, None] - points[None], axis=-1)
        return (sizes + growth * far).min(1)

    return size


def inside(polygon: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Whether points x (n, 2) lie within a closed polygon (k, 2), by the crossings of a ray."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    y = x[:, None, 1]
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return (crosses & (x[:, None, 0] < at)).sum(1) % 2 == 1


def quality(corners: np.ndarray) -> np.ndarray:
    """4√3 A/Σℓ² (m,) of triangles (m, 3, 2): 1 where equilateral, negative where turned over."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    sides = ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2).sum(1)
    return 4.0 * np.sqrt(3.0) * area / np.maximum(sides, 1e-300)


def filled(polygon: np.ndarray, lines: list[np.ndarray], size: Size) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2), first those of the polygon (k, 2), then of the `lines` inside it, and triangles (m, 3).

    Every edge of the polygon and of the lines is one of a triangle.  Raises NoTriangles where that is not so.
    """
    given = np.concatenate([polygon, *lines])
    edges = _edges(len(polygon), [len(line) for line in lines])
    movable = _seeded(polygon, given, edges, size)
    for k in range(N_REPULSION_ROUNDS):
        movable = _moved(polygon, given, movable, size)
        if k % 10 == 9:
            movable = _apart(given, movable, edges, size)
    points = np.concatenate([given, movable])
    triangles = _of(polygon, points, _with_edges(points, Delaunay(points).simplices, edges))
    used = np.unique(triangles)
    if len(used) < len(points):  # a point that no triangle holds
        new = np.full(len(points), -1)
        new[used] = np.arange(len(used))
        if (new[: len(given)] < 0).any():
            raise NoTriangles("given points are left over")
        points, triangles = points[used], new[triangles]
    return points, triangles


def _edges(corners: int, lines: list[int]) -> np.ndarray:
    """Given edges (e, 2): those of the polygon, then of the lines, whose points follow each other."""
    around = np.column_stack([np.arange(corners), np.roll(np.arange(corners), -1)])
    out, first = [around], corners
    for count in lines:
        out.append(np.column_stack([np.arange(first, first + count - 1), np.arange(first + 1, first + count)]))
        first += count
    return np.concatenate(out)


def _seeded(polygon: np.ndarray, given: np.ndarray, edges: np.ndarray, size: Size) -> np.ndarray:
    """Points of a triangular lattice, thinned to the wanted density."""
    low, high = polygon.min(0), polygon.max(0)
    least = float(size(given).min())
    least = max(least, 0.004 * float((high - low).max()))
    columns, rows = int((high[0] - low[0]) / least) + 2, int((high[1] - low[1]) / (0.866 * least)) + 2
    i, j = np.repeat(np.arange(columns), rows), np.tile(np.arange(rows), columns)
    lattice = low + np.column_stack([(i + 0.5 * (j % 2)) * least, j * 0.866 * least])
    chance = (EVEN_FILLING_MULTIPLES[0] * i + EVEN_FILLING_MULTIPLES[1] * j) % 1.0
    within = inside(polygon, lattice)
    lattice, chance = lattice[within], chance[within]
    lattice = lattice[chance < (least / size(lattice)) ** 2]
    return _apart(given, lattice, edges, size)


def _apart(given: np.ndarray, movable: np.ndarray, edges: np.ndarray, size: Size) -> np.ndarray:
    """Movable points that are not too near to given points, given edges and each other."""
    if not len(movable):
        return movable
    h = size(movable)
    keep = cKDTree(given).query(movable)[0] > FREE_AROUND_GIVEN_RATIO * h
    middle, half = given[edges].mean(1), 0.5 * np.linalg.norm(given[edges[:, 1]] - given[edges[:, 0]], axis=1)
    keep &= (np.linalg.norm(movable[:, None] - middle[None], axis=-1) > 1.05 * half).all(1)
    movable, h = movable[keep], h[keep]
    if len(movable) < 2:
        return movable
    out = np.ones(len(movable), bool)
    for a, b in sorted(cKDTree(movable).query_pairs(MIN_NEIGHBOUR_DISTANCE_RATIO * float(h.max()))):
        near = np.linalg.norm(movable[a] - movable[b]) < MIN_NEIGHBOUR_DISTANCE_RATIO * min(h[a], h[b])
        if near and out[a] and out[b]:
            out[b] = False
    return movable[out]


def _within(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Delaunay triangles (m, 3), counterclockwise, whose middle lies in the polygon."""
    return _of(polygon, points, Delaunay(points).simplices)


def _of(polygon: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Those of the triangles (m, 3) whose middle lies in the polygon, counterclockwise, without flat ones."""
    corners = points[triangles]
    triangles = triangles[inside(polygon, corners.mean(1)) & (np.abs(quality(corners)) > MIN_TRIANGLE_QUALITY)]
    turned = quality(points[triangles]) < 0.0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    return triangles


def _moved(polygon: np.ndarray, given: np.ndarray, movable: np.ndarray, size: Size) -> np.ndarray:
    """Movable points after one round of repulsion along the edges of their triangles."""
    points = np.concatenate([given, movable])
    triangles = _within(polygon, points)
    sides = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1), axis=0)
    across = points[sides[:, 0]] - points[sides[:, 1]]
    length = np.linalg.norm(across, axis=1)
    wanted = size(points[sides].mean(1))
    rest = REST_LENGTH_RATIO * wanted * np.sqrt((length**2).sum() / (wanted**2).sum())
    push = (np.maximum(rest - length, 0.0) / np.maximum(length, 1e-300))[:, None] * across
    force = np.zeros_like(points)
    np.add.at(force, sides[:, 0], push)
    np.add.at(force, sides[:, 1], -push)
    new = movable + MOVE_PER_FORCE * force[len(given) :]
    out = ~inside(polygon, new)
    new[out] = movable[out]
    return new


def _with_edges(points: np.ndarray, triangles: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) with all given edges (e, 2): diagonals that cross one are turned (Sloan 1993).

    Raises NoTriangles where that does not end.
    """
    cells = [tuple(t) for t in triangles.tolist()]
    for a, b in edges.tolist():
        for _ in range(MAX_DIAGONAL_TURNS):
            owners: dict[tuple[int, int], list[int]] = {}
            for k, t in enumerate(cells):
                for i, j in ((0, 1), (1, 2), (2, 0)):
                    owners.setdefault((min(t[i], t[j]), max(t[i], t[j])), []).append(k)
            if (min(a, b), max(a, b)) in owners:
                break
            if not _turned_one(points, cells, owners, a, b):
                raise NoTriangles("a given edge is missing")
        else:
            raise NoTriangles("a given edge is missing")
    return np.array(cells)


def _turned_one(
    points: np.ndarray, cells: list[tuple[int, ...]], owners: dict[tuple[int, int], list[int]], a: int, b: int
) -> bool:
    """Turn one diagonal that crosses the segment from a to b, in a convex pair of triangles; whether there was one."""
    for (c, d), pair in owners.items():
        if len(pair) != 2 or {a, b} & {c, d} or not _cross(points, a, b, c, d):
            continue
        e, f = (next(v for v in cells[k] if v not in (c, d)) for k in pair)
        if _cross(points, e, f, c, d):
            cells[pair[0]], cells[pair[1]] = _ordered(points, (e, f, c)), _ordered(points, (e, f, d))
            return True
    return False


def _side(points: np.ndarray, a: int, b: int, c: int) -> float:
    (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def _cross(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the segments ab and cd cross within both."""
    first = _side(points, a, b, c) * _side(points, a, b, d)
    return first < 0.0 and _side(points, c, d, a) * _side(points, c, d, b) < 0.0


def _ordered(points: np.ndarray, t: tuple[int, int, int]) -> tuple[int, int, int]:
    return t if _side(points, *t) > 0.0 else (t[0], t[2], t[1])
