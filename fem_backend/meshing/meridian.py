"""Meshes of a meridian (r, z): graded grids, cut into triangles of seven nodes; the same to the bit everywhere."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fem_backend.meshing.mesh import BadMesh

Size = Callable[[np.ndarray], np.ndarray]  # wanted element size (n,) mm at places (n,) mm
Shape = Callable[[np.ndarray], np.ndarray]  # points (n, 2) mm of the body from those of the grid
N_SIZE_SAMPLES = 400  # places per interval at which a size is integrated


@dataclass(frozen=True)
class MeridianMesh:
    """Nodes (n, 2) = (r, z) mm and cells (m, 7): corners, middles of the edges 01, 12 and 02, and of the cell."""

    points: np.ndarray
    cells: np.ndarray

    def outline(self) -> np.ndarray:
        """Edges (f, 3) of the boundary off the axis: ends, then the middle."""
        edges = np.concatenate([self.cells[:, [0, 1, 3]], self.cells[:, [1, 2, 4]], self.cells[:, [0, 2, 5]]])
        _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
        single = edges[first[count == 1]]
        return single[~(self.points[single, 0] == 0.0).all(1)]


def graded_coordinates(size: Size, places: tuple[float, ...], samples: int | None = None) -> np.ndarray:
    """Coordinates from the first to the last of `places` (mm, increasing), with each of them among these.

    Between two places ∫ dx/size elements, rounded up, at equal shares of the integral over `samples` places.
    """
    samples = samples or N_SIZE_SAMPLES
    out: list[np.ndarray] = [np.array([places[0]])]
    for a, b in itertools.pairwise(places):
        x = np.linspace(a, b, samples + 1)
        density = 1.0 / size(0.5 * (x[1:] + x[:-1]))
        total = np.concatenate([[0.0], np.cumsum(density)]) * (b - a) / samples
        n = max(int(np.ceil(total[-1] - 1e-9)), 1)
        inside = np.interp(np.linspace(0.0, 1.0, n + 1)[1:], total / total[-1], x)
        inside[-1] = b
        out.append(inside)
    return np.concatenate(out)


def triangulated(r: np.ndarray, z: np.ndarray, shape: Shape | None = None) -> MeridianMesh:
    """The grid of r (i,) and z (j,) mm, both increasing, each rectangle cut in two; `shape` maps its points.

    Only edges of the outline are curved: a shape may have kinks inside.  The diagonals alternate, and turn at the
    outer corners so that no triangle has both of its free sides there.  Raises BadMesh where the shape turns a triangle
    over.
    """
    i, j = (k.ravel() for k in np.meshgrid(np.arange(len(r) - 1), np.arange(len(z) - 1), indexing="ij"))
    up = (i + j) % 2 == 0
    last = i == len(r) - 2
    up = np.where(last & (j == len(z) - 2), True, np.where(last & (j == 0), False, up))

    def corner(di: int, dj: int) -> np.ndarray:
        return np.column_stack([2 * (i + di), 2 * (j + dj)])

    sw, se, nw, ne = corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)
    pick = up[:, None]
    first = np.stack([sw, se, np.where(pick, ne, nw)], axis=1)
    second = np.stack([np.where(pick, sw, se), ne, nw], axis=1)
    corners = np.concatenate([first, second]).reshape(-1, 3, 2)  # in half steps of the grid
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))[:, [0, 1, 2]]
    lattice = np.concatenate([corners, middles.astype(int)], axis=1)
    width = 2 * len(z) - 1
    used, cells = np.unique(lattice[..., 0] * width + lattice[..., 1], return_inverse=True)
    cells = cells.reshape(-1, 6)
    grid = np.column_stack([_halves(r)[used // width], _halves(z)[used % width]])
    points = grid if shape is None else _straight(shape(grid), cells)
    middle = np.einsum("a,mai->mi", np.array([-1.0, -1.0, -1.0, 4.0, 4.0, 4.0]) / 9.0, points[cells])
    cells = np.column_stack([cells, len(points) + np.arange(len(cells))])
    points = np.concatenate([points, middle])
    a, b, c = (points[cells[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    if area.min() <= 0.0:
        raise BadMesh(f"{int((area <= 0.0).sum())} triangles of the meridian are turned over")
    return MeridianMesh(points, cells.astype(np.int64))


def _straight(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Points (n, 2) with the middle of every inner edge of the cells (m, 6) halfway between its ends."""
    edges = np.concatenate([cells[:, [0, 1, 3]], cells[:, [1, 2, 4]], cells[:, [0, 2, 5]]])
    _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
    inner = edges[first[count == 2]]
    points = points.copy()
    points[inner[:, 2]] = 0.5 * (points[inner[:, 0]] + points[inner[:, 1]])
    return points


def halved(points: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the rectangle 0 ≤ r ≤ 1, |z| ≤ 1 in the half disc of radius 1.

    Squares around the centre become circles of the same size, angles along them in proportion (Shirley and Chiu 1997).
    """
    a, b = points[:, 0], np.abs(points[:, 1])
    big, small = np.maximum(a, b), np.minimum(a, b)
    angle = 0.25 * np.pi * small / np.where(big > 0.0, big, 1.0)
    first, second = big * np.cos(angle), big * np.sin(angle)
    return np.column_stack(
        [np.where(a >= b, first, second), np.copysign(np.where(a >= b, second, first), points[:, 1])]
    )


def _halves(x: np.ndarray) -> np.ndarray:
    """Coordinates with the middles between them, (2n − 1,)."""
    out = np.empty(2 * len(x) - 1)
    out[::2], out[1::2] = x, 0.5 * (x[1:] + x[:-1])
    return out
