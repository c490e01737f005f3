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

from fem_backend.meshing.meridian import graded_coordinates
from fem_backend.meshing.mesh import BadMesh, Mesh, volumes
from fem_backend.meshing.placing import mirrored_mesh, scaled_jacobian
from fem_backend.meshing.templates import CRUDE_LEVEL

GRID_MESHER = "grid"  # of the mesher in a recipe
# factor on all sizes
GRID_SIZE_FACTORS = {"coarse": 2.2, "standard": 1.7, "fine": 1.25, "reference": 0.9, CRUDE_LEVEL: 3.0}
# of the indenter's length: elements up to FINEST_REACH_RATIO of it from the middle, at unit fineness
FINEST_SIZE_RATIO = 0.15
FINEST_REACH_RATIO = 1.2  # lengths of the indenter from the middle, up to which they are that small
# growth of the elements per distance, from there on and from the top on
SIZE_GROWTH_BESIDE, SIZE_GROWTH_BELOW = 0.4, 0.2
SLOW_GROWTH_DEPTH_RATIO = 6.0  # lengths of the indenter below the top from which they grow as fast as beside it
MIN_GRID_ELEMENTS = 10.0, 8.0  # elements from the middle to the side and from the base to the top at least
MAX_EDGE_HALVINGS = 8  # halvings of the curve of edges in cells that it would turn over
# of the way from the side to the middle: no place of the finest elements is nearer to the side
MIN_SIDE_DISTANCE_SHARE = 0.05

Form = Callable[[np.ndarray], np.ndarray]  # points (n, 3) mm of the body from those of the box
Along = Sequence[float]  # planes x, y or z (mm) that a grid must hit, from the middle or the base on


def grid_recipe(x: Along, y: Along, z: Along, length: float, level: str, edges: str = "") -> str:
    """Recipe of a grid that hits planes at x, y, z for an indenter of a `length`, all in mm; `edges` as of `cut`."""
    words = {
        "x": list(x),
        "y": list(y),
        "z": list(z),
        "length": length,
        "fineness": GRID_SIZE_FACTORS[level],
        "edges": edges,
    }
    return json.dumps({"mesher": GRID_MESHER, "version": 1, **words}, sort_keys=True)


def is_grid(recipe: str) -> bool:
    """Whether a recipe is that of a grid."""
    return bool(recipe) and json.loads(recipe).get("mesher") == GRID_MESHER


def graded_for(recipe: str) -> float:
    """Length (mm) of the indenter that the grid of a recipe is graded for; infinite where it is that of no grid."""
    return float(json.loads(recipe)["length"]) if is_grid(recipe) else np.inf


def first_size(length: float, level: str) -> float:
    """Size (mm) of the elements that an indenter of a `length` meets, where the body is not small beside it."""
    return FINEST_SIZE_RATIO * GRID_SIZE_FACTORS[level] * length


def made_grid(data: Mapping[str, Any]) -> Mesh:
    """The quarter of the box from the data of a recipe."""
    length, factor = data["length"], data["fineness"]

    def along(planes: list[float]) -> np.ndarray:
        near = min(FINEST_SIZE_RATIO * length, planes[-1] / MIN_GRID_ELEMENTS[0])
        return graded_coordinates(
            lambda x: factor * (near + SIZE_GROWTH_BESIDE * np.maximum(x - FINEST_REACH_RATIO * length, 0.0)),
            tuple(planes),
        )

    def up(z: np.ndarray) -> np.ndarray:
        below, height = data["z"][-1] - z, data["z"][-1] - data["z"][0]
        size = (
            FINEST_SIZE_RATIO * length
            + SIZE_GROWTH_BELOW * below
            + (SIZE_GROWTH_BESIDE - SIZE_GROWTH_BELOW) * np.maximum(below - SLOW_GROWTH_DEPTH_RATIO * length, 0.0)
        )
        return factor * np.minimum(size, height / MIN_GRID_ELEMENTS[1])

    return cut(along(data["x"]), along(data["y"]), graded_coordinates(up, tuple(data["z"])), data["edges"])


def cut(x: np.ndarray, y: np.ndarray, z: np.ndarray, edges: str = "") -> Mesh:
    """A tensor grid, every box cut into five tetrahedra: they lock half as much as the usual six.

    All diagonals join points whose indices, counted from the top of the axis, have an even sum.  A map may make one
    smooth face of the two at an edge: there diagonals must meet the edge.  `edges` is "upright" for the boxes on the
    plane of the upright one, "all" for those below the upper edges as well.
    """
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = np.array([len(x), len(y), len(z)])
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    even = (cells.sum(1) + shape[2] - 1) % 2 == 0
    last = cells == shape - 2
    across = np.full(len(cells), -1)  # the axis that prisms lie along, 3 for all of them
    if edges:
        across[cells[:, 0] == cells[:, 1]] = 2
    if edges == "all":
        across[last[:, 2] & last[:, 0]], across[last[:, 2] & last[:, 1]] = 1, 0
        across[last.all(1)] = 3
    parts = []
    for parity in (True, False):
        at = even == parity
        parts.append(_placed(cells[at & (across < 0)], _five(parity)))
        parts += [_placed(cells[at & (across == axis)], _prisms(parity, axis)) for axis in range(3)]
    parts.append(_placed(cells[across == 3], _six()))
    tets = np.ravel_multi_index(tuple(np.concatenate(parts).transpose(2, 0, 1)), tuple(shape))
    mesh = Mesh(grid, tets.astype(np.int64))
    turned = volumes(mesh) < 0.0
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    return Mesh(grid, tets.astype(np.int64))


def _placed(cells: np.ndarray, tets: list[list[tuple[int, ...]]]) -> np.ndarray:
    """Indices (m, 4, 3) of the corners of the tetrahedra of cells (n, 3)."""
    return (cells[:, None, None] + np.array(tets)).reshape(-1, 4, 3)


def _five(even: bool) -> list[list[tuple[int, ...]]]:
    """A box whose diagonals meet at the corner (0, 0, 0) or at (1, 0, 0)."""
    inner: list[tuple[int, ...]] = [(0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1)]
    tets = [inner, *([(1 - a, 1 - b, 1 - c), *(v for v in inner if v != (a, b, c))] for a, b, c in inner)]
    return tets if even else [[(1 - a, b, c) for a, b, c in tet] for tet in tets]


def _prisms(even: bool, axis: int) -> list[list[tuple[int, ...]]]:
    """A box cut along the plane through (0, 0) and (1, 1) of the axes across; other diagonals as in `_five`."""
    low, high = (0, 1) if even else (1, 0)
    tets = []
    for corner in ((1, 0), (0, 1)):
        apex, near, far = (*corner, high), (0, 0), (1, 1)
        tets.append([(*corner, low), (*near, low), (*far, low), apex])
        tets += [[(*near, low), (*far, low), (*far, high), apex], [(*near, low), (*far, high), (*near, high), apex]]
    return [[tuple(np.roll(v, axis - 2)) for v in tet] for tet in tets]


def _six() -> list[list[tuple[int, ...]]]:
    """A box cut about its diagonal from (0, 0, 0) (Kuhn 1960)."""
    steps = [np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0) for order in itertools.permutations(range(3))]
    return [[(0, 0, 0), *map(tuple, step)] for step in steps]


def on_grid(
    mesh: Mesh,
    recipe: str,
    actual: tuple[Along, Along, Along],
    at: tuple[float, float],
    planes: tuple[bool, bool],
    form: Form | None = None,
    round_from: float = np.inf,
) -> MeshTet2:
    """Quadratic mesh of a body from the grid of a recipe, its finest elements at the place `at` (x, y) mm of the box.

    `actual` are the planes of the recipe where they are now, `planes` as of a specimen.  `form` maps the box to the
    body; edges farther from its axis than `round_from` (mm, in the larger of x and y) take the curvature of that.
    Raises BadMesh where elements are turned over.
    """
    data = json.loads(recipe)
    box, tets = mesh.vertices, mesh.tets
    for axis in (0, 1):
        if not planes[axis]:
            box, tets = mirrored_mesh(box, tets, axis)
    linear = MeshTet(np.ascontiguousarray(box.T), np.ascontiguousarray(tets.T))
    numbers = MeshTet2.from_mesh(linear)
    grid = np.column_stack(
        [
            *(_moved(box[:, k], data["xy"[k]], actual[k], at[k]) for k in (0, 1)),
            np.interp(box[:, 2], data["z"], actual[2]),
        ]
    )
    points, (i, j) = grid if form is None else form(grid), linear.edges
    middle = 0.5 * (points[i] + points[j])
    if form is not None:
        between = 0.5 * (grid[i] + grid[j])
        curved = np.minimum.reduce([np.abs(v[:, :2]).max(1) for v in (grid[i], grid[j], between)]) >= round_from
        middle[curved] = form(between[curved])
    straight = 0.5 * (points[i] + points[j])
    out, worst = _quadratic(points, middle, numbers)
    # an edge may take more of a curve than its cells have
    for _ in range(MAX_EDGE_HALVINGS if (worst <= 0.0).any() else 0):
        bent = np.unique(linear.t2e[:, worst <= 0.0])
        middle[bent] = 0.5 * (middle[bent] + straight[bent])
        out, worst = _quadratic(points, middle, numbers)
        if worst.min() > 0.0:
            break
    if worst.min() <= 0.0:
        raise BadMesh(f"{int((worst <= 0.0).sum())} tetrahedra are turned over with the contact at {at} mm")
    return out


def _quadratic(points: np.ndarray, middle: np.ndarray, numbers: MeshTet2) -> tuple[MeshTet2, np.ndarray]:
    """The mesh with these corners and middles of edges, and how far each of its cells is from being turned over."""
    out = MeshTet2(np.ascontiguousarray(np.concatenate([points, middle]).T), numbers.t)
    return out, scaled_jacobian(out)


def _moved(x: np.ndarray, nominal: Along, actual: Along, at: float) -> np.ndarray:
    """Coordinates with the middle at `at` and all but the last plane where they are: v/(1 + κ|v|), of slope 1 there.

    Planes between stay, too, if the place is within the first of them.
    """
    v = np.sign(x) * np.interp(np.abs(x), nominal, actual)
    if at == 0.0:
        return v
    inner = actual[1]
    at = float(np.clip(at, -(1.0 - MIN_SIDE_DISTANCE_SHARE) * inner, (1.0 - MIN_SIDE_DISTANCE_SHARE) * inner))
    room = np.where(v >= 0.0, inner - at, inner + at)
    inside = at + v / (1.0 + np.abs(v) * (1.0 / room - 1.0 / inner))
    return np.where(np.abs(v) < inner, inside, v)


def disc(points: np.ndarray, radius: float) -> np.ndarray:
    """Points (n, 3) of a box on a square, mapped to the cylinder on a disc: from `radius` on squares are circles.

    x ↦ x + min(|x|∞/radius, 1) (c(x) − x) with c the low distortion map of Shirley and Chiu (1997): smooth in the
    middle, where elements stay as they are.
    """
    x, y, z = points.T
    big, small = np.maximum(np.abs(x), np.abs(y)), np.minimum(np.abs(x), np.abs(y))
    angle = 0.25 * np.pi * small / np.where(big > 0.0, big, 1.0)
    wide = np.abs(x) >= np.abs(y)
    share = np.minimum(big / radius, 1.0)
    first, second = big + share * (big * np.cos(angle) - big), small + share * (big * np.sin(angle) - small)
    return np.column_stack([np.sign(x) * np.where(wide, first, second), np.sign(y) * np.where(wide, second, first), z])
