"""Pictures without a display: a section through the deformed body, the surface from above."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from matplotlib.tri import Triangulation

from fem_backend.kinematics.bodies import Body
from fem_backend.materials.zones import divided, quadratic_shape_functions


class Outlined(Protocol):
    """What of an indenter is drawn."""

    length: float

    def outline(self, centre: np.ndarray, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Closed line (k, 2) mm of its cut by the plane of the unit vectors `across` (2, 3) through `centre` (3,)."""

    def gap(self, x: np.ndarray, centre: Any, direction: Any = ...) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap (…), its gradient (…, 3) and Hessian (…, 3, 3) at points x (…, 3)."""


N_PIECES_PER_DRAWN_EDGE = 3  # straight pieces of a quadratic edge
COLOUR_MAP = "viridis"  # of Matplotlib: its lightness rises evenly


@dataclass(frozen=True)
class CrossSection:
    """Plane cut: triangles (t, 3, 2) mm with values (t, 3), cell borders (s, 2, 2) mm."""

    triangles: np.ndarray
    values: np.ndarray
    borders: np.ndarray


def section(
    body: Body,
    x: np.ndarray,
    values: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    split: int = N_PIECES_PER_DRAWN_EDGE,
) -> CrossSection:
    """Cut of the cells at positions x (n, 3) by the plane (x − point)·normal = 0, with nodal `values` (n,).

    Cells are divided into split³ straight pieces, each cut exactly.  Plane coordinates: see `plane_axes`.  A point on a
    border plane of the model cuts just inside of it.
    """
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    height = (x - point) @ normal
    size = float(np.ptp(x, axis=0).max())
    if height.min() > -1e-6 * size:
        height = height - 1e-6 * size
    if height.max() < 1e-6 * size:
        height = height + 1e-6 * size
    cells = body.cells[(height[body.cells].min(1) < 0.0) & (height[body.cells].max(1) > 0.0)]
    at, pieces = divided(split)
    N = quadratic_shape_functions(at)[0]
    across = plane_axes(normal)
    plan = np.einsum("ka,cai->cki", N, (x @ across.T)[cells])
    h, v = np.einsum("ka,ca->ck", N, height[cells]), np.einsum("ka,ca->ck", N, values[cells])
    whole = np.concatenate([plan, v[..., None], h[..., None]], axis=-1)  # what is interpolated along an edge
    solid = _tetrahedra(whole[:, pieces].reshape(-1, 4, 4))
    sides = [t[list(f)] for t in pieces for f in ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))]
    faces = np.array([f for f in sides if np.any(np.all(at[f] == 0.0, axis=0))])
    return CrossSection(solid[..., :2], solid[..., 2], _triangles(whole[:, faces].reshape(-1, 3, 4)))


def plane_axes(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (2, 3) to the right and up in a plane: up is z, or y when looking along z."""
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    return np.stack([np.cross(normal, up) if abs(normal[2]) < 0.9 else np.cross(up, normal), up])


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Points (k, 3) where the last of four columns (k, 4) vanishes between a and b."""
    t = a[:, 3] / (a[:, 3] - b[:, 3])
    return (a + t[:, None] * (b - a))[:, :3]


def _sorted(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (k, c, 4) that the plane divides, by rising height, and how many lie below (k,)."""
    order = np.argsort(corners[..., 3], axis=1)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    below = (corners[..., 3] < 0.0).sum(1)
    cut = (below > 0) & (below < corners.shape[1])
    return corners[cut], below[cut]


def _tetrahedra(corners: np.ndarray) -> np.ndarray:
    """Triangles (t, 3, 3) of the cut of tetrahedra (k, 4, 4)."""
    corners, below = _sorted(corners)
    out = []
    for single, others in ((0, (1, 2, 3)), (3, (0, 1, 2))):
        c = corners[below == (1 if single == 0 else 3)]
        out.append(np.stack([_between(c[:, single], c[:, j]) for j in others], axis=1))
    c = corners[below == 2]
    quad = [_between(c[:, i], c[:, j]) for i, j in ((0, 2), (0, 3), (1, 3), (1, 2))]
    out += [np.stack([quad[0], quad[1], quad[2]], axis=1), np.stack([quad[0], quad[2], quad[3]], axis=1)]
    return np.concatenate(out)


def _triangles(corners: np.ndarray) -> np.ndarray:
    """Segments (s, 2, 2) of the cut of triangles (k, 3, 4)."""
    corners, below = _sorted(corners)
    one, two = corners[below == 1], corners[below == 2]
    segments = [np.stack([_between(one[:, 0], one[:, j]) for j in (1, 2)], axis=1)]
    segments.append(np.stack([_between(two[:, 2], two[:, j]) for j in (0, 1)], axis=1))
    return np.concatenate(segments)[..., :2]


def draw_section(
    path: Path | str,
    body: Body,
    u: np.ndarray,
    values: np.ndarray,
    label: str,
    centre: np.ndarray,
    indenter: Outlined,
    direction: np.ndarray,
    normal: tuple[float, float, float] = (0.0, 1.0, 0.0),
    planes: tuple[bool, bool] = (False, False),
    title: str = "",
    contact: tuple[np.ndarray, np.ndarray] | None = None,
    peak: float | None = None,
) -> None:
    """PNG of the deformed body cut through the indenter's reference point (3,) mm: all of it, and from near.

    `values` (n,) with their `label`, e.g. "von Mises stress (MPa)"; `planes` as in `contact_patch`: a cut of a part
    model is completed by its mirror image; `contact` = positions (k, 3) mm and pressures (k,) of points in contact,
    drawn as spikes into the indenter if they lie within 0.15 of its length of the plane.  Points scatter about the mean
    over an element, whose largest value `peak` (MPa) is the one that a run answers, and the legend then says.
    """
    x = body.nodes + u
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    cut = section(body, x, values, centre, n)
    across = plane_axes(n)
    middle, radius = across @ centre, indenter.length
    outline = indenter.outline(centre, direction, across)
    mirrored = any(planes[k] and abs(across[0, k]) == 1.0 for k in range(2)) or (all(planes) and n[2] == 0.0)
    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    whole, near = figure.subplots(1, 2)
    flat = cut.triangles.reshape(-1, 2)
    window = (np.abs(cut.triangles - middle).max((1, 2)) < 3.0 * radius) if len(flat) else np.zeros(0, bool)
    shown = cut.values[window] if window.any() else cut.values
    limits = (min(0.0, float(shown.min())), float(shown.max()))
    signs = (1.0, -1.0) if mirrored else (1.0,)
    for axes in (whole, near):
        for sign in signs:
            to = np.array([sign, 1.0])
            first, second = (flat * to).T
            mesh = Triangulation(first, second, np.arange(len(flat)).reshape(-1, 3))
            image = axes.tripcolor(
                mesh, cut.values.ravel(), shading="gouraud", cmap=COLOUR_MAP, vmin=limits[0], vmax=limits[1]
            )
            axes.add_collection(LineCollection(cut.borders * to, colors="k", linewidths=0.25, alpha=0.6))
        axes.add_patch(Polygon(outline, closed=True, facecolor="0.85", edgecolor="0.3", zorder=3, alpha=0.9))
        axes.set_aspect("equal")
        axes.set_xlabel(f"{_name(across[0])} (mm)")
        axes.set_ylabel(f"{_name(across[1])} (mm)")
    if contact is not None:
        inward = -indenter.gap(contact[0], centre, direction)[1]
        _spikes(near, contact, inward, centre, radius, n, across, signs, peak)
    whole.autoscale_view()
    near.set_xlim(middle[0] - 2.5 * radius, middle[0] + 2.5 * radius)
    near.set_ylim(middle[1] - 3.0 * radius, middle[1] + 1.2 * radius)
    figure.colorbar(image, ax=near, label=label)
    figure.suptitle(title)
    figure.savefig(path, dpi=150)


def _spikes(
    axes: Any,
    contact: tuple[np.ndarray, np.ndarray],
    inward: np.ndarray,
    centre: np.ndarray,
    radius: float,
    normal: np.ndarray,
    across: np.ndarray,
    signs: tuple[float, ...],
    peak: float | None = None,
) -> None:
    """Contact pressure as lines from the surface along `inward` (k, 3), the longest half of the length `radius`."""
    points, pressure = contact
    near = (np.abs((points - centre) @ normal) < 0.15 * radius) & (pressure > 0.0)
    if not near.any():
        return
    a, way = points[near] @ across.T, inward[near] @ across.T
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    b = a + 0.5 * radius * (pressure[near] / pressure.max())[:, None] * way
    for sign in signs:
        lines = np.stack([a, b], axis=1) * np.array([sign, 1.0])
        axes.add_collection(LineCollection(lines, colors="tab:red", linewidths=1.0, zorder=4))
    at_most = pressure.max() if peak is None else peak
    mean = "" if peak is None else " as the mean of an element"
    axes.plot([], [], color="tab:red", label=f"contact pressure, at most {at_most:.3g} MPa{mean}")
    axes.legend(loc="lower right", fontsize=8)


def _name(direction: np.ndarray) -> str:
    """x, y or z where a direction is one of them."""
    k = int(np.argmax(np.abs(direction)))
    return ("" if direction[k] > 0 else "−") + "xyz"[k] if abs(direction[k]) > 1.0 - 1e-12 else "in the plane"


def draw_surface(
    path: Path | str,
    nodes: np.ndarray,
    facets: np.ndarray,
    u: np.ndarray,
    values: np.ndarray,
    label: str,
    planes: tuple[bool, bool] = (False, False),
    centre: np.ndarray | None = None,
    radius: float = 0.0,
    title: str = "",
) -> None:
    """PNG of the deformed upper surface from above, all of it and the surroundings of the indenter (centre, radius) mm.

    Quadratic facets (f, 6) with nodal `values` (n,); edges straight between nodes; a part model is completed.
    """
    upper = facets[(nodes[facets, 2] >= -1e-9).all(1)]
    x = nodes + u
    parts = upper[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)
    loops = x[upper[:, [0, 3, 1, 4, 2, 5, 0]], :2]
    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 1 if centre is None else 2, squeeze=False)[0]
    limits = (float(values[upper].min()), float(values[upper].max()))
    signs = [(a, b) for a in ((1, -1) if planes[0] else (1,)) for b in ((1, -1) if planes[1] else (1,))]
    for axes in panels:
        for sign in signs:
            to = np.array(sign, float)
            first, second = (x[:, :2] * to).T
            mesh = Triangulation(first, second, parts)
            image = axes.tripcolor(mesh, values, shading="gouraud", cmap=COLOUR_MAP, vmin=limits[0], vmax=limits[1])
            axes.add_collection(LineCollection(loops * to, colors="k", linewidths=0.25, alpha=0.6))
        axes.set_aspect("equal")
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("y (mm)")
    if centre is not None:
        panels[0].autoscale_view()
        panels[1].add_patch(Circle(tuple(centre[:2]), radius, fill=False, edgecolor="tab:red", linestyle="--"))
        panels[1].set_xlim(centre[0] - 3.0 * radius, centre[0] + 3.0 * radius)
        panels[1].set_ylim(centre[1] - 3.0 * radius, centre[1] + 3.0 * radius)
    figure.colorbar(image, ax=panels[-1], label=label)
    figure.suptitle(title)
    figure.savefig(path, dpi=150)
