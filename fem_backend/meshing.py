"""A body becomes graded tetrahedra: fTetWild for any body, a conformal map of a subdivided ball for tests.

fTetWild gives the better elements but is not reproducible, so its mesh is an artefact: made once, stored under
its hash.  The mapped mesh is the same to the bit everywhere.  Both give a `Mesh` of vertices and tetrahedra of
the quarter x ≥ 0, y ≥ 0; `quadratic` adds the mid-edge nodes and puts them on the true surface.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.machinery
import importlib.util
import io
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial import Delaunay, cKDTree
from skfem import MeshTet, MeshTet2

from fem_backend.geometry import Ellipsoid


class BadMesh(ValueError):
    """The mesher returned something that is not the body."""


@dataclass(frozen=True)
class Sizing:
    """Target edge length h(d) = min(h0 + growth·max(d − r0, 0), hmax) at distance d (mm) from the contact."""

    h0: float
    r0: float
    growth: float
    hmax: float

    def __call__(self, d: np.ndarray | float) -> np.ndarray:
        return np.minimum(self.h0 + self.growth * np.maximum(np.asarray(d) - self.r0, 0.0), self.hmax)


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 3) in mm and positively oriented tetrahedra (m, 4)."""

    vertices: np.ndarray
    tets: np.ndarray

    def to_bytes(self) -> bytes:
        """The mesh as an npz, equal bytes for equal meshes."""
        out = io.BytesIO()
        np.savez(out, vertices=self.vertices, tets=self.tets)
        return out.getvalue()

    @classmethod
    def from_file(cls, path: Path | str) -> Mesh:
        """Inverse of `to_bytes`."""
        with np.load(path, allow_pickle=False) as data:
            return cls(data["vertices"], data["tets"])


def volumes(mesh: Mesh) -> np.ndarray:
    """Signed volumes of the straight-sided tetrahedra (mm³)."""
    p = mesh.vertices[mesh.tets]
    return np.linalg.det(p[:, 1:] - p[:, :1]) / 6.0


# ---------------------------------------------------------------------------------------------------- recipes


def make(recipe: str) -> Mesh:
    """Mesh from its recipe (JSON with the keys mesher, semi_axes and size).

    fTetWild runs in a child process: it is native code that can crash, and it litters its working directory.
    Raises BadMesh when it fails.
    """
    data = json.loads(recipe)
    if data["mesher"] == "mapped":
        return mapped_quarter(Ellipsoid(*data["semi_axes"]), data["n"], data["slip"])
    with tempfile.TemporaryDirectory() as folder:
        child = [sys.executable, "-m", "fem_backend.meshing", recipe, "mesh.npz"]
        path = os.pathsep.join([str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path}
        try:
            done = subprocess.run(child, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
        except subprocess.TimeoutExpired:
            raise BadMesh("fTetWild took more than 600 s") from None
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise BadMesh(f"fTetWild ended with code {done.returncode}: {last}")
        return Mesh.from_file(Path(folder) / "mesh.npz")


def tetwild_recipe(body: Ellipsoid, sizing: Sizing) -> str:
    """Recipe of a graded fTetWild mesh of the quarter body."""
    return json.dumps(
        {"mesher": "tetwild", "version": 1, "semi_axes": list(body.semi_axes), "sizing": asdict(sizing)}, sort_keys=True
    )


def mapped_recipe(body: Ellipsoid, n: int, slip: float) -> str:
    """Recipe of the reproducible mapped mesh: n subdivisions, grading `slip` in [0, 1)."""
    return json.dumps(
        {"mesher": "mapped", "version": 1, "semi_axes": list(body.semi_axes), "n": n, "slip": slip}, sort_keys=True
    )


def cached(recipe: str) -> Mesh:
    """Mesh of a recipe from this user's cache, made there if missing: two studies then share one mesh."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = base / "rso-meshes" / f"{hashlib.sha256(recipe.encode()).hexdigest()}.npz"
    if not path.exists():
        mesh = make(recipe)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{os.getpid()}")
            temporary.write_bytes(mesh.to_bytes())
            try:
                os.link(temporary, path)  # the first of two racing processes wins: both then read the same mesh
            except FileExistsError:
                pass
            temporary.unlink()
        except OSError:
            return mesh  # no writable home: the caller's store keeps the artefact
    return Mesh.from_file(path)


# ---------------------------------------------------------------------------------------------------- mapped


def mapped_quarter(body: Ellipsoid, n: int, slip: float) -> Mesh:
    """Quarter ellipsoid from two octants cut into n³ tetrahedra each, graded towards the top by a Möbius map.

    The hyperbolic translation of the unit ball x ↦ ((1 − s²)(x + s e) + |x + s e|² s e) / (1 + 2 s x·e + s²|x|²),
    e = (0, 0, 1), is conformal: it shrinks elements at the top by (1 − s)/(1 + s) and keeps every angle.
    """
    octant = _kuhn_simplex(n)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    points, tets = octant
    barycentric = np.c_[n - points[:, 0], points[:, 0] - points[:, 1], points[:, 1] - points[:, 2], points[:, 2]] / n
    upper = barycentric @ corners
    vertices = np.vstack([upper, upper * [1, 1, -1]])
    vertices, tets = _merge(vertices, np.vstack([tets, tets + len(upper)]))
    l1, l2 = np.abs(vertices).sum(1), np.linalg.norm(vertices, axis=1)
    ball = vertices * (l1 / np.where(l2 > 0, l2, 1.0))[:, None]
    e = np.array([0.0, 0.0, 1.0])
    y = ball + slip * e
    moved = (1 - slip**2) * y + (y**2).sum(1)[:, None] * slip * e
    ball = moved / (1 + 2 * slip * ball[:, 2] + slip**2 * (ball**2).sum(1))[:, None]
    return _finish(body, ball * body.semi_axes, tets, 1e-6)


def _kuhn_simplex(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points 0 ≤ x₃ ≤ x₂ ≤ x₁ ≤ n and the Kuhn tetrahedra between them (Freudenthal 1942)."""
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = (grid[:, 0] >= grid[:, 1]) & (grid[:, 1] >= grid[:, 2])
    number = np.full((n + 1,) * 3, -1)
    points = grid[inside]
    number[tuple(points.T)] = np.arange(len(points))
    cubes = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    tets = []
    for order in itertools.permutations(range(3)):
        corners = [cubes]
        for axis in order:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
        tets.append(np.stack([number[tuple(c.T)] for c in corners], 1))
    tets = np.vstack(tets)
    return points, tets[(tets >= 0).all(1)]


# ---------------------------------------------------------------------------------------------------- fTetWild


def tetwild_quarter(body: Ellipsoid, sizing: Sizing) -> Mesh:
    """Quarter ellipsoid by fTetWild (Hu et al. 2020) with a background sizing field about the top.

    Raises BadMesh when the result is not the quarter body (volume off by more than 8 %, inverted elements).
    """
    vertices, faces = quarter_surface(body, sizing)
    background = _background(body, sizing)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    for attempt, epsilon in enumerate(TETWILD_EPSILON, 1):
        points, tets = _extension().tetrahedralize_mesh(
            vertices, faces.astype(np.uint32), True, True,  # optimise, keep the surface (it is graded already)
            sizing.hmax / diagonal, 0.0, epsilon, 10.0, False, 1, 80, 6, True, True, False, *background,
        )  # fmt: skip
        try:
            return _finish(body, np.asarray(points), np.asarray(tets, int), 1.5 * epsilon * diagonal)
        except BadMesh:
            if attempt == len(TETWILD_EPSILON):
                raise
    raise AssertionError("unreachable")


TETWILD_EPSILON = (1e-3, 1e-3, 5e-4, 2e-4)  # surface tolerance by the diagonal, tried in turn
TETWILD_SCALE = 0.72  # fTetWild's mean edge is 1.3 to 1.4 times what it is asked for


@functools.cache
def _extension() -> ModuleType:
    """pytetwild's compiled module alone: its package imports pyvista (600 MB) only for file conversion."""
    spec = importlib.util.find_spec("pytetwild")
    folder = Path(spec.submodule_search_locations[0])
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:
        path = folder / f"PyfTetWildWrapper{suffix}"
        if path.exists():
            module_spec = importlib.util.spec_from_file_location("PyfTetWildWrapper", path)
            module = importlib.util.module_from_spec(module_spec)
            module_spec.loader.exec_module(module)
            return module
    raise ImportError(f"pytetwild in {folder} has no compiled module for this Python; reinstall pytetwild==0.4.*")


def quarter_surface(body: Ellipsoid, sizing: Sizing) -> tuple[np.ndarray, np.ndarray]:
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
    return _merge(np.vstack(vertices), np.vstack(faces))


def _segment(start: np.ndarray, end: np.ndarray, body: Ellipsoid, sizing: Sizing) -> np.ndarray:
    """Points strictly between `start` and `end`, graded by the sizing."""
    length = float(np.linalg.norm(end - start))
    s = [0.0]
    while s[-1] < length:
        s.append(s[-1] + float(sizing(np.linalg.norm(start + (end - start) * s[-1] / length - body.top))))
    s = np.array(s) / s[-1]
    return start + (end - start) * s[1:-1, None]


def _rings(body: Ellipsoid, sizing: Sizing) -> tuple[np.ndarray, np.ndarray, list[int], list[int], list[int]]:
    """Rings of constant polar angle on the curved surface, stitched; the rim z = 0 is one of them."""
    diagonal = np.sqrt(0.5)

    def point(theta: float) -> np.ndarray:
        return body.semi_axes * [np.sin(theta) * diagonal, np.sin(theta) * diagonal, np.cos(theta)]

    angles = [0.0]
    while angles[-1] < np.pi:
        speed = np.linalg.norm(point(angles[-1] + np.pi / 2))
        angles.append(angles[-1] + float(sizing(np.linalg.norm(point(angles[-1]) - body.top))) / speed)
    angles = np.array(angles) * np.pi / angles[-1]
    angles[np.argmin(np.abs(angles - np.pi / 2))] = np.pi / 2
    rings, index, count = [], [], 0
    for k, theta in enumerate(angles):
        pole = k in (0, len(angles) - 1)
        h = float(sizing(np.linalg.norm(point(theta) - body.top)))
        m = 0 if pole else max(2, round(np.sin(theta) * (body.a + body.b) / 2 * np.pi / 2 / h))
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


def _plane_face(body: Ellipsoid, sizing: Sizing, loop: np.ndarray, outward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate the plane convex face inside `loop` (k, 3), graded, seen counter-clockwise along `outward`."""
    i, j = (k for k in range(3) if outward[k] == 0)
    top = body.top[[i, j]]
    flat = loop[:, [i, j]]
    cloud, r = [], 0.5 * float(sizing(np.linalg.norm(body.top - [0, 0, loop[0, 2]]) if j == 1 else 0.0))
    while r < 2.5 * body.semi_axes.max():
        h = float(sizing(np.hypot(r, body.c) if j == 1 else r))
        m = max(3, round(2 * np.pi * r / h))
        theta = (np.arange(m) + 0.5) / m * 2 * np.pi
        cloud.append(top + r * np.c_[np.cos(theta), np.sin(theta)])
        r += 0.9 * h
    cloud = np.vstack(cloud)
    inside = Delaunay(flat).find_simplex(cloud) >= 0
    cloud = cloud[inside]
    full = np.zeros((len(cloud), 3))
    full[:, [i, j]] = cloud
    h = sizing(np.linalg.norm(full - body.top, axis=1))
    cloud = cloud[cKDTree(flat).query(cloud)[0] > 0.6 * h]
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


def _background(body: Ellipsoid, sizing: Sizing) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A graded box of Kuhn tetrahedra around the quarter body carrying the target edge length."""

    def ticks(low: float, high: float, centre: float) -> np.ndarray:
        out = [centre]
        for end in (low, high):
            x = centre
            while x != end:
                step = max(0.5, 0.3 * abs(x - centre))
                x = max(x - step, end) if end < centre else min(x + step, end)
                out.append(x)
        return np.unique(out)

    axes = [ticks(-1.0, body.a + 1, 0.0), ticks(-1.0, body.b + 1, 0.0), ticks(-body.c - 1, body.c + 1, body.c)]
    box = MeshTet.init_tensor(*axes)
    points = box.p.T.copy()
    tets = box.t.T.astype(np.int32)
    flipped = volumes(Mesh(points, tets)) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return points, tets, TETWILD_SCALE * sizing(np.linalg.norm(points - body.top, axis=1))


# ---------------------------------------------------------------------------------------------------- finishing


def _merge(vertices: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identify vertices that coincide to 1e-9 and drop cells that collapse."""
    _, first, inverse = np.unique(np.round(vertices, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    cells = inverse.ravel()[cells]
    distinct = np.array([len(set(c)) == cells.shape[1] for c in cells.tolist()])
    return vertices[first], cells[distinct]


def _finish(body: Ellipsoid, points: np.ndarray, tets: np.ndarray, near: float) -> Mesh:
    """Orient, flatten the symmetry planes, put the surface on the ellipsoid and an edge chain on the rim z = 0."""
    points = points.copy()
    flipped = volumes(Mesh(points, tets)) < 0
    tets = tets.copy()
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    used, inverse = np.unique(tets, return_inverse=True)
    points, tets = points[used], inverse.reshape(tets.shape)
    mesh = MeshTet(np.ascontiguousarray(points.T), np.ascontiguousarray(tets.T))
    facets = mesh.facets[:, mesh.boundary_facets()].T
    corner = points[facets]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    plane = (np.abs(corner[:, :, :2]) < near).all(1) & (np.abs(normal[:, :2]) > 0.9)
    for axis in (0, 1):
        points[facets[plane[:, axis]], axis] = 0.0
    points[np.abs(points[:, 2]) < near, 2] = 0.0
    curved = facets[~plane.any(1)].T
    skin = np.unique(curved)
    points[skin] = body.project(points[skin])
    _align_rim(body, points, curved)
    points[np.argmin(np.linalg.norm(points - body.top, axis=1))] = body.top
    result = Mesh(np.ascontiguousarray(points), np.ascontiguousarray(tets.astype(np.int64)))
    v = volumes(result)
    if v.min() <= 0 or abs(v.sum() / (body.volume() / 4) - 1) > 0.08:
        raise BadMesh(f"volume {v.sum():.1f} of {body.volume() / 4:.1f} mm³, smallest element {v.min():.3g} mm³")
    return result


def _align_rim(body: Ellipsoid, points: np.ndarray, curved: np.ndarray) -> None:
    """Slide the nearer end of every surface edge that crosses z = 0 onto z = 0 along the surface."""
    edges = np.unique(np.sort(np.hstack([curved[[0, 1]], curved[[1, 2]], curved[[0, 2]]]).T, axis=1), axis=0)
    while True:
        z = points[edges, 2]
        crossing = edges[z[:, 0] * z[:, 1] < 0]
        if not len(crossing):
            return
        ends = np.unique(crossing)
        nearest = ends[np.argmin(np.abs(points[ends, 2]))]
        points[nearest, 2] = 0.0
        points[nearest] = body.project(points[None, nearest])[0]


def quadratic(body: Ellipsoid, mesh: Mesh) -> MeshTet2:
    """Ten-node tetrahedra whose mid-edge nodes lie on the ellipsoid, on the symmetry planes and on the rim."""
    linear = MeshTet(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.tets.T))
    curved = MeshTet2.from_mesh(linear)
    nodes = curved.doflocs.copy()
    facets = linear.boundary_facets()
    corner = linear.facets[:, facets]
    flat = (nodes[0, corner] == 0).all(0) | (nodes[1, corner] == 0).all(0)
    edges = np.unique(linear.f2e[:, facets[~flat]])
    middle = linear.nvertices + edges
    nodes[:, middle] = body.project(nodes[:, middle].T).T
    return MeshTet2(nodes, curved.t)


def _die_with_parent() -> None:
    """Ask Linux to kill this process when its parent dies: native code would mesh on for nobody."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    except (AttributeError, OSError):
        return  # not Linux: the time-out of the parent is all there is


if __name__ == "__main__":
    _die_with_parent()
    _recipe = json.loads(sys.argv[1])
    _mesh = tetwild_quarter(Ellipsoid(*_recipe["semi_axes"]), Sizing(**_recipe["sizing"]))
    Path(sys.argv[2]).write_bytes(_mesh.to_bytes())
