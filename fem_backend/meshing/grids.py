"""Graded grids of bodies with a flat top, cut into tetrahedra; the same to the bit everywhere.

A grid is that of the quarter x ≥ 0, y ≥ 0 of a box, fine below the middle of its top.  `on_grid` moves its fine part
to any place, its planes to those of the actual body, and maps squares to discs where the body is round: the answer is
then smooth in the place and in all sizes, as the elements stay the same ones.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from skfem import MeshTet, MeshTet2

from fem_backend.meshing.meridian import graded
from fem_backend.meshing.mesh import BadMesh, Mesh
from fem_backend.meshing.placing import mirrored, scaled_jacobian

NAME = "grid"  # of the mesher in a recipe
FINENESS = {"coarse": 3.0, "standard": 2.1, "fine": 1.5, "reference": 1.1}  # factor on all sizes
NEAR = 0.12  # of the indenter's length: elements that it meets, at unit fineness
FEWEST = 12.0, 10.0  # elements from the middle to the side and from the base to the top at least, at unit fineness
GROWTH = 0.3  # of the element size per distance, from a length of the indenter on; twice that from four lengths on
NEAREST = 0.05  # of the way from the side to the middle: no place of the finest elements is nearer to the side

Form = Callable[[np.ndarray], np.ndarray]  # points (n, 3) mm of the body from those of the box
Along = Sequence[float]  # planes x, y or z (mm) that a grid must hit, from the middle or the base on


def recipe(x: Along, y: Along, z: Along, length: float, level: str) -> str:
    """Recipe of a grid that hits planes at x, y, z for an indenter of a `length`, all in mm."""
    words = {"x": list(x), "y": list(y), "z": list(z), "length": length, "fineness": FINENESS[level]}
    return json.dumps({"mesher": NAME, "version": 1, **words}, sort_keys=True)


def first_size(length: float, level: str) -> float:
    """Size (mm) of the elements that an indenter meets."""
    return NEAR * FINENESS[level] * length


def made(data: Mapping[str, Any]) -> Mesh:
    """The quarter of the box from the data of a recipe."""
    length, factor = data["length"], data["fineness"]

    def growing(far: np.ndarray) -> np.ndarray:
        return GROWTH * (np.maximum(far - length, 0.0) + np.maximum(far - 4.0 * length, 0.0))

    def along(planes: list[float]) -> np.ndarray:
        near = min(NEAR * length, planes[-1] / FEWEST[0])
        return graded(lambda x: factor * (near + growing(x)), tuple(planes))

    height = data["z"][-1]

    def up(z: np.ndarray) -> np.ndarray:
        below = height - z
        return factor * np.minimum(NEAR * length + GROWTH * below + growing(below), height / FEWEST[1])

    return cut(along(data["x"]), along(data["y"]), graded(up, tuple(data["z"])))


def cut(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Mesh:
    """A tensor grid, every box cut into six tetrahedra about its diagonal away from the origin (Kuhn 1960)."""
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = len(x), len(y), len(z)
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for order in itertools.permutations(range(3)):
        corners = [cells]
        for axis in order:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
        four = np.stack([np.ravel_multi_index(tuple(c.T), shape) for c in corners], axis=1)
        even = np.linalg.det(np.eye(3)[list(order)]) > 0.0
        tets.append(four if even else four[:, [0, 2, 1, 3]])
    return Mesh(grid, np.concatenate(tets).astype(np.int64))


def on_grid(
    mesh: Mesh,
    recipe: str,
    actual: tuple[Along, Along, Along],
    at: tuple[float, float],
    planes: tuple[bool, bool],
    form: Form | None = None,
    rounded: float = np.inf,
) -> MeshTet2:
    """Quadratic mesh of a body from the grid of a recipe, its finest elements at the place `at` (x, y) mm of the box.

    `actual` are the planes of the recipe where they are now, `planes` as of a specimen.  `form` maps the box to the
    body; edges on the sides, and on the top beyond the distance `rounded` mm from the middle, take its curvature.
    Raises BadMesh where elements are turned over.
    """
    data = json.loads(recipe)
    box, tets = mesh.vertices, mesh.tets
    for axis in (0, 1):
        if not planes[axis]:
            box, tets = mirrored(box, tets, axis)
    side, top = np.array([data["x"][-1], data["y"][-1]]), data["z"][-1]
    linear = MeshTet(np.ascontiguousarray(box.T), np.ascontiguousarray(tets.T))
    numbers = MeshTet2.from_mesh(linear)
    facets = linear.boundary_facets()
    corners = box[linear.facets[:, facets]]
    on_side = (np.abs(corners[..., :2]) == side).all(0).any(1)

    grid = np.column_stack(
        [
            *(_moved(box[:, k], data["xy"[k]], actual[k], at[k]) for k in (0, 1)),
            np.interp(box[:, 2], data["z"], actual[2]),
        ]
    )
    form = form or np.array
    far = np.abs(grid[linear.facets[:, facets], :2]).max(-1).min(0)
    curved = on_side | ((corners[..., 2] == top).all(0) & (far >= rounded * (1.0 - 1e-12)))
    points, (i, j) = form(grid), linear.edges
    middle = 0.5 * (points[i] + points[j])
    edges = np.unique(linear.f2e[:, facets[curved]])
    middle[edges] = form(0.5 * (grid[i[edges]] + grid[j[edges]]))
    out = MeshTet2(np.ascontiguousarray(np.concatenate([points, middle]).T), numbers.t)
    worst = scaled_jacobian(out)
    if worst.min() <= 0.0:
        raise BadMesh(f"{int((worst <= 0.0).sum())} tetrahedra are turned over with the contact at {at} mm")
    return out


def _moved(x: np.ndarray, nominal: Along, actual: Along, at: float) -> np.ndarray:
    """Coordinates with the middle at `at` and all but the last plane where they are: v/(1 + κ|v|), of slope 1 there.

    Planes between stay, too, if the place is within the first of them.
    """
    v = np.sign(x) * np.interp(np.abs(x), nominal, actual)
    if at == 0.0:
        return v
    inner = actual[1]
    at = float(np.clip(at, -(1.0 - NEAREST) * inner, (1.0 - NEAREST) * inner))
    room = np.where(v >= 0.0, inner - at, inner + at)
    inside = at + v / (1.0 + np.abs(v) * (1.0 / room - 1.0 / inner))
    return np.where(np.abs(v) < inner, inside, v)


def disc(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of a box on a square, mapped to the cylinder on a disc: squares become circles.

    The map of Shirley and Chiu (1997), a low distortion map between disk and square.
    """
    x, y, z = points.T
    big, small = np.maximum(np.abs(x), np.abs(y)), np.minimum(np.abs(x), np.abs(y))
    angle = 0.25 * np.pi * small / np.where(big > 0.0, big, 1.0)
    first, second = big * np.cos(angle), big * np.sin(angle)
    wide = np.abs(x) >= np.abs(y)
    return np.column_stack([np.sign(x) * np.where(wide, first, second), np.sign(y) * np.where(wide, second, first), z])
