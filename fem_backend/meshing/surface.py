"""Graded closed surfaces of the quarter body, the input of fTetWild."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mesh import Sizing, merge_vertices


def quarter_surface(body: EllipsoidShape, sizing: Sizing) -> tuple[np.ndarray, np.ndarray]:
    """Graded triangulation of the upper and the lower quarter body, each closed, sharing the face z = 0.

    The shared face is there for its rim: fTetWild keeps it, so that a support can end exactly at z = 0.
    """
    curved, triangles, arc_y0, arc_x0, rim = _rings(body, sizing)
    half = arc_y0.index(rim[0])
    origin = np.zeros(3)
    axis = {+1: _segment(body.top, origin, body, sizing), -1: _segment(origin, -body.top, body, sizing)}
    spoke = {0: _segment(curved[rim[0]], origin, body, sizing), 1: _segment(curved[rim[-1]], origin, body, sizing)}
    vertices, faces = [curved], [triangles]

    def add(loop: np.ndarray, outward: np.ndarray) -> None:
        points, face = _plane_face(body, sizing, loop, outward)
        faces.append(face + sum(len(v) for v in vertices))
        vertices.append(points)

    for k, arc in ((0, arc_y0), (1, arc_x0)):
        outward = -np.eye(3)[1 - k]
        add(np.vstack([curved[arc[: half + 1]], spoke[k], origin, axis[+1][::-1]]), outward)
        add(np.vstack([curved[arc[half:]], axis[-1][::-1], origin, spoke[k][::-1]]), outward)
    for outward in (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])):
        add(np.vstack([curved[rim], spoke[1], origin, spoke[0][::-1]]), outward)
    return merge_vertices(np.vstack(vertices), np.vstack(faces))


def _segment(start: np.ndarray, end: np.ndarray, body: EllipsoidShape, sizing: Sizing) -> np.ndarray:
    """Points strictly between `start` and `end`, graded by the sizing."""
    length = float(np.linalg.norm(end - start))
    s = [0.0]
    while s[-1] < length:
        s.append(s[-1] + float(sizing.at(start + (end - start) * s[-1] / length, body)))
    along = np.array(s) / s[-1]
    return start + (end - start) * along[1:-1, None]


def _rings(body: EllipsoidShape, sizing: Sizing) -> tuple[np.ndarray, np.ndarray, list[int], list[int], list[int]]:
    """Rings of constant polar angle on the curved surface, stitched; the rim z = 0 is one of them."""
    diagonal = np.sqrt(0.5)

    def point(theta: float) -> np.ndarray:
        return body.semi_axes * [np.sin(theta) * diagonal, np.sin(theta) * diagonal, np.cos(theta)]

    steps = [0.0]
    while steps[-1] < np.pi:
        speed = float(np.linalg.norm(point(steps[-1] + np.pi / 2)))
        steps.append(steps[-1] + float(sizing.at(point(steps[-1]), body)) / speed)
    angles = np.array(steps) * np.pi / steps[-1]
    angles[np.argmin(np.abs(angles - np.pi / 2))] = np.pi / 2
    rings, index, count = [], [], 0
    for k, theta in enumerate(angles):
        pole = k in (0, len(angles) - 1)
        h = float(sizing.at(point(theta), body))
        # two chords of a large ring leave a tenth of its area out, of a body on its end a tenth of the volume
        least = 3 if body.c > max(body.a, body.b) and np.sin(theta) >= 0.5 else 2
        m = 0 if pole else max(least, round(np.sin(theta) * (body.a + body.b) / 2 * np.pi / 2 / h))
        phi = np.linspace(0, np.pi / 2, m + 1) if m else np.zeros(1)
        c, s = np.cos(phi), np.sin(phi)
        s[0], c[-1 if m else 0] = 0.0, 0.0 if m else 1.0
        flat = 0.0 if theta == np.pi / 2 else np.cos(theta)
        radial = 0.0 if pole else np.sin(theta)
        rings.append(body.semi_axes * np.c_[radial * c, radial * s, np.full(m + 1, flat)])
        index.append(list(range(count, count + m + 1)))
        count += m + 1
    triangles = [t for upper, lower in itertools.pairwise(index) for t in _stitch(upper, lower)]
    rim = index[int(np.argmin(np.abs(angles - np.pi / 2)))]
    return np.vstack(rings), np.array(triangles), [r[0] for r in index], [r[-1] for r in index], rim


def _stitch(upper: list[int], lower: list[int]) -> list[tuple[int, int, int]]:
    """Triangles between two rings of different numbers of points, oriented outwards (upper ring above)."""
    i = j = 0
    triangles = []
    while i < len(upper) - 1 or j < len(lower) - 1:
        ahead = (j + 1) * max(len(upper) - 1, 1) <= (i + 1) * max(len(lower) - 1, 1)
        if j < len(lower) - 1 and (i == len(upper) - 1 or ahead):
            triangles.append((upper[i], lower[j], lower[j + 1]))
            j += 1
        else:
            triangles.append((upper[i], lower[j], upper[i + 1]))
            i += 1
    return triangles


def _plane_face(
    body: EllipsoidShape, sizing: Sizing, loop: np.ndarray, outward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate the plane convex face inside `loop` (k, 3), graded, seen counter-clockwise along `outward`."""
    i, j = (k for k in range(3) if outward[k] == 0)
    focus = sizing.centre(body)
    top, above = focus[[i, j]], float(focus[2]) if j == 1 else 0.0  # the face z = 0 is looked at from its focus above

    def size(r: float) -> float:
        return float(sizing(np.hypot(r, above) - sizing.lift))

    flat = loop[:, [i, j]]
    start = max(sizing.lift, 0.0) if j == 2 else 0.0  # nothing of a side face is nearer
    circles, r = [], start + 0.5 * size(start)
    while r < 2.5 * body.semi_axes.max():
        h = size(r)
        m = max(3, round(2 * np.pi * r / h))
        theta = (np.arange(m) + 0.5) / m * 2 * np.pi
        circles.append(top + r * np.c_[np.cos(theta), np.sin(theta)])
        r += 0.9 * h
    cloud = np.vstack(circles)
    inside = Delaunay(flat).find_simplex(cloud) >= 0
    cloud = cloud[inside]
    full = np.zeros((len(cloud), 3))
    full[:, [i, j]] = cloud
    cloud = cloud[cKDTree(flat).query(cloud)[0] > 0.6 * sizing.at(full, body)]
    centre = flat.mean(0)
    following, preceding = np.roll(flat, -1, 0) - flat, flat - np.roll(flat, 1, 0)
    turn = following[:, 0] * preceding[:, 1] - following[:, 1] * preceding[:, 0]
    straight = np.abs(turn) < 1e-9 * np.linalg.norm(following, axis=1) * np.linalg.norm(preceding, axis=1)
    points = np.vstack([flat, cloud])
    bulged = points.copy()  # strictly convex, so that Delaunay keeps every boundary edge
    bulged[: len(flat)][straight] += 1e-4 * _bulge(flat, straight, centre)
    triangles = Delaunay(bulged).simplices
    out = np.zeros((len(points), 3))
    out[:, [i, j]] = points
    normals = np.cross(*(out[triangles[:, k]] - out[triangles[:, 0]] for k in (1, 2)))
    clockwise = normals @ outward < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return out, triangles


def _bulge(flat: np.ndarray, straight: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Outward parabola over each straight run of a convex loop, zero at its corners."""
    corners = np.nonzero(~straight)[0]
    out = np.zeros_like(flat)
    for k in np.nonzero(straight)[0]:
        after = corners[np.searchsorted(corners, k) % len(corners)]
        before = corners[np.searchsorted(corners, k) - 1]
        chord = flat[after] - flat[before]
        s = np.dot(flat[k] - flat[before], chord) / np.dot(chord, chord)
        normal = np.array([chord[1], -chord[0]])
        normal *= np.sign(np.dot(normal, flat[k] - centre)) or 1.0
        out[k] = normal * s * (1 - s)
    return out[straight]
