"""Scanned surfaces: read, checked and known by their contents; where one is held; its mesh for one place of contact.

Run as a module it meshes one recipe: fTetWild is native code that can crash.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from skfem import ElementTetP2, MeshTet, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from fem_backend.meshing.closed_surface import closed, edges_of, enclosed_volume
from fem_backend.meshing.mesh import BadMesh, Mesh, Sizing, volumes
from fem_backend.meshing.placing import MIN_SCALED_JACOBIAN, REGULAR_TETRAHEDRON, scaled_jacobian
from fem_backend.meshing.recipes import in_child
from fem_backend.meshing.remeshed import refined_surface, remeshed_surface
from fem_backend.meshing.smooth_surface import SmoothSurface
from fem_backend.meshing.surface_files import read_surface
from fem_backend.meshing.tetwild import TETWILD_SCALE, die_with_parent, tetrahedra

SCAN_MESHER = "scan"
SCAN_TETWILD_EPSILON = (1e-3, 5e-4, 1e-3, 2e-4)  # surface tolerance by the diagonal, tried in turn
# of the smallest radius of curvature of humps and of hollows: no edge is longer
MAX_EDGE_PER_HUMP_RADIUS, MAX_EDGE_PER_HOLLOW_RADIUS = 0.8, 0.5
MIN_EDGE_PER_SCAN_EDGE = 2.0  # of the scan's own edges: curvature of its scatter asks for nothing shorter
# of the volume: what large curved elements may miss, beyond it the surface does not bound the body
SCAN_VOLUME_TOLERANCE = 0.03
MIN_RIM_SCALED_JACOBIAN = 0.15  # scaled Jacobian that elements at the rim of the held region keep
ON_RIM_TOLERANCE = 1e-9  # of the size: what lies this near to the edge of the held region lies on it


@dataclass(frozen=True)
class Scan:
    """A closed surface in mm, its smooth surface and what was repaired; `sha256` is that of its numbers in mm."""

    sha256: str
    vertices: np.ndarray
    facets: np.ndarray
    smooth: SmoothSurface
    repairs: tuple[str, ...]

    @property
    def low(self) -> np.ndarray:
        """Smallest coordinates (3,) mm."""
        return self.vertices.min(0)

    @property
    def high(self) -> np.ndarray:
        """Largest coordinates (3,) mm."""
        return self.vertices.max(0)

    @functools.cached_property
    def volume(self) -> float:
        """Volume (mm³): that of facets halved on the smooth surface, of which a third of the gain is added again."""
        x, f = refined_surface(self.smooth, lambda p: np.zeros(len(p)), passes=1)
        flat, finer = enclosed_volume(self.smooth.project(self.vertices), self.facets), enclosed_volume(x, f)
        return finer + (finer - flat) / 3.0

    @functools.cached_property
    def crossings(self) -> np.ndarray:
        """Points (k, 3) mm where an edge of the scan passes through one of its facets."""
        edges = np.unique(np.sort(edges_of(self.facets), 1), axis=0)
        return self.smooth.tree.crossings(edges, self.facets, self.vertices)

    def doubts(self) -> str:
        """Why a mesh of it may have failed: where it crosses itself, or what to look for."""
        if not len(self.crossings):
            return "is the surface thinner somewhere than its facets are long?"
        at = ", ".join(f"{v:.4g}" for v in self.crossings[0])
        return f"the surface crosses itself at {len(self.crossings)} of its edges, the first at ({at}) mm"

    @functools.cached_property
    def spacing(self) -> np.ndarray:
        """Mean length (n,) mm of the edges at each vertex."""
        f, total, count = self.facets, np.zeros(len(self.vertices)), np.bincount(self.facets.ravel())
        for k in range(3):
            a, b = f[:, k], f[:, (k + 1) % 3]
            np.add.at(total, a, np.linalg.norm(self.vertices[a] - self.vertices[b], axis=1))
        return total / np.maximum(count, 1)

    @functools.cached_property
    def curvature(self) -> np.ndarray:
        """Principal curvatures (n, 2) 1/mm near the vertices, those of a ball positive, larger last."""
        return self.smooth.curvatures(self.smooth.project(self.vertices))


def scan(file: str, scale: float) -> Scan:
    """The scan in a file whose unit is `scale` mm; read again when the file has changed.

    ValueError, without the name of the file, where it holds no closed surface of one body.
    """
    try:
        found = os.stat(file)
    except OSError:
        return _scan(file, scale, 0, 0)  # what is wrong says the reader
    return _scan(file, scale, found.st_mtime_ns, found.st_size)


@functools.lru_cache(maxsize=8)
def _scan(file: str, scale: float, changed: int, size: int) -> Scan:
    whole = closed(*read_surface(file))
    for repair in whole.repairs:
        print(f"  {file}: {repair}", file=sys.stderr, flush=True)
    vertices = whole.vertices * scale
    if not float(np.ptp(vertices, axis=0).min()) > 0.0:
        raise ValueError("is flat: it encloses no volume")
    sha = hashlib.sha256(vertices.tobytes() + whole.facets.astype(np.int64).tobytes()).hexdigest()
    body = Scan(sha, vertices, whole.facets, SmoothSurface.through(vertices, whole.facets), whole.repairs)
    if len(body.crossings):
        print(f"  {file}: {body.doubts()}; meshes may fail there", file=sys.stderr, flush=True)
    return body


# ----------------------------------------------------------------------------------------------- the held region


def held_level(held: Mapping[str, Any], x: np.ndarray) -> np.ndarray:
    """φ (n,) mm at points x (n, 3): where it is not positive, the surface is held.

    `below`: z less that; `box`: the largest excess over its sides; `file`: distance to a second surface, negative
    inside of it, less `within`.
    """
    x = np.asarray(x, float)
    if "below" in held:
        return x[:, 2] - held["below"]
    if "box" in held:
        low, high = np.asarray(held["box"], float)
        return np.maximum(low - x, x - high).max(1)
    other = scan(held["file"], held["scale"])
    return -other.smooth.depth(x) - held["within"]


def onto_rim(smooth: SmoothSurface, held: Mapping[str, Any], x: np.ndarray) -> np.ndarray:
    """Points (n, 3) near it moved onto the edge of the held region on the surface, f = φ = 0; nan where there is none.

    Gauss–Newton with the gradient of f and differences of φ, the shortest way in each step.
    """
    y, size = np.array(x, float), float(np.abs(smooth.vertices).max())
    h = 1e-6 * size
    for _ in range(12):
        f, gradient = smooth.level(y)
        phi = held_level(held, y)
        slope = [(held_level(held, y + h * e) - held_level(held, y - h * e)) / (2.0 * h) for e in np.eye(3)]
        J = np.stack([gradient, np.stack(slope, axis=1)], axis=1)
        gram = np.einsum("nai,nbi->nab", J, J)
        gram += 1e-12 * np.eye(2)  # where the surface runs along the edge nothing is found
        y -= np.einsum("nai,na->ni", J, np.linalg.solve(gram, np.stack([f, phi], axis=1)[..., None])[..., 0])
    y[np.abs(held_level(held, y)) > ON_RIM_TOLERANCE * size] = np.nan
    return y


# -------------------------------------------------------------------------------------------------------- the mesh


def scan_recipe(
    file: str, scale: float, sha256: str, held: Mapping[str, Any], place: np.ndarray, sizing: Sizing
) -> str:
    """Recipe of the mesh of a scan, fine about the `place` (3,) mm of its surface.

    Where the files lie (`file`) is no part of what it names (`recipes.identity`): the contents are, `sha256`.
    """
    return json.dumps(
        {
            "mesher": SCAN_MESHER,
            "version": 1,
            "file": file,
            "scale": scale,
            "sha256": sha256,
            "held": dict(held),
            "place": [float(f"{v:.12g}") for v in place.tolist()],
            "sizing": asdict(sizing),
        },
        sort_keys=True,
    )


def fine_place(recipe: str) -> list[float]:
    """The place (3,) mm of the surface about which the mesh of a recipe is fine."""
    return list(json.loads(recipe)["place"])


def make_scan_mesh(data: Mapping[str, Any]) -> Mesh:
    """The mesh of a recipe, made in a child process; raises BadMesh."""
    return in_child("fem_backend.meshing.scans", json.dumps(data), "a scanned surface")


def graded_tetrahedra(data: Mapping[str, Any]) -> Mesh:
    """Tetrahedra of the smooth body of a recipe by fTetWild, boundary vertices on the surface; raises BadMesh.

    Its surface is remade with edges as long as the sizing asks, at most 0.8 of the smallest radius of curvature.
    """
    try:
        body = scan(data["file"], data["scale"])
    except ValueError as error:
        raise BadMesh(f"{data['file']} {error}") from error
    if body.sha256 != data["sha256"]:
        raise BadMesh(f"{data['file']} has changed since the run was set up: its contents are {body.sha256[:12]}…")
    sizing, smooth = Sizing(**data["sizing"]), body.smooth
    place = smooth.project(np.array([data["place"]]))[0]
    centre = place + sizing.lift * smooth.normals(place[None])[0]
    hollow, hump = np.clip(-body.curvature[:, 0], 1e-300, None), np.clip(body.curvature[:, 1], 1e-300, None)
    bend = np.maximum(
        np.minimum(MAX_EDGE_PER_HUMP_RADIUS / hump, MAX_EDGE_PER_HOLLOW_RADIUS / hollow),
        MIN_EDGE_PER_SCAN_EDGE * body.spacing,
    )

    def sizes(x: np.ndarray) -> np.ndarray:
        return sizing(np.linalg.norm(x - centre, axis=-1) - sizing.lift)

    def along(x: np.ndarray) -> np.ndarray:
        facet, weight, _ = smooth.tree.nearest(x)
        round_ = np.einsum("na,na->n", weight, bend[smooth.facets[facet]])
        return np.minimum(sizes(x), np.maximum(round_, sizing.h0))

    vertices, facets = remeshed_surface(smooth, along, place)
    best, most, refused = None, -np.inf, BadMesh("fTetWild was not asked")
    background = _background(vertices, place, sizing.h0, sizes)
    for epsilon in SCAN_TETWILD_EPSILON:
        try:
            points, tets = tetrahedra(vertices, facets, sizing.hmax, epsilon, background)
            mesh = finished_mesh(body, data["held"], points, tets, place)
            sound = scan_quality(body, quadratic_on_scan(smooth, data["held"], mesh))
        except BadMesh as error:
            refused = error
            continue
        if sound >= MIN_SCALED_JACOBIAN:
            return mesh
        if sound > most:
            best, most = mesh, sound
    if best is None or most <= 0.0:
        raise refused
    return best


def _background(
    vertices: np.ndarray, place: np.ndarray, h0: float, sizes: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box of Kuhn tetrahedra around the surface, graded about the place, that carries the asked edge length."""

    def ticks(low: float, high: float, centre: float) -> np.ndarray:
        out = [centre]
        for end in (low, high):
            x = centre
            while x != end:
                step = max(0.7 * h0, 0.3 * abs(x - centre))
                x = max(x - step, end) if end < centre else min(x + step, end)
                out.append(x)
        return np.unique(out)

    low, high = vertices.min(0) - h0, vertices.max(0) + h0
    box = MeshTet.init_tensor(*(ticks(low[k], high[k], place[k]) for k in range(3)))
    points, tets = box.p.T.copy(), box.t.T.astype(np.int32)
    flipped = volumes(Mesh(points, tets)) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return points, tets, TETWILD_SCALE * sizes(points)


def finished_mesh(body: Scan, held: Mapping[str, Any], points: np.ndarray, tets: np.ndarray, place: np.ndarray) -> Mesh:
    """Oriented, boundary vertices on the smooth surface, one at the place and an edge chain on the held region's rim.

    Raises BadMesh where that turns an element inside out.
    """
    used, inverse = np.unique(tets, return_inverse=True)
    points, tets = points[used].copy(), inverse.reshape(tets.shape).astype(np.int64)
    flipped = volumes(Mesh(points, tets)) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    skin = _boundary(points, tets)
    nodes = np.unique(skin)
    points[nodes] = body.smooth.project(points[nodes])
    points[nodes[np.argmin(np.linalg.norm(points[nodes] - place, axis=1))]] = place
    _align(body.smooth, held, points, tets, skin)
    made = Mesh(np.ascontiguousarray(points), np.ascontiguousarray(tets))
    v = volumes(made)
    if v.min() <= 0.0:
        raise BadMesh(f"an element of {v.min():.3g} mm³: {body.doubts()}")
    return made


def scan_quality(body: Scan, made: MeshTet2) -> float:
    """Smallest scaled Jacobian of a curved mesh; raises BadMesh where its volume is not that of the scan."""
    at = np.stack([ElementTetP2().lbasis(get_quadrature(RefTet, 3)[0], a)[1] for a in range(10)])
    X = made.doflocs.T[made.dofs.element_dofs.T]
    inside = float((np.linalg.det(np.einsum("mai,ajq->mqij", X, at)) @ get_quadrature(RefTet, 3)[1]).sum())
    if abs(inside / body.volume - 1.0) > SCAN_VOLUME_TOLERANCE:
        raise BadMesh(f"a volume of {inside:.4g} mm³ in a surface of {body.volume:.4g} mm³: {body.doubts()}")
    return float(scaled_jacobian(made).min())


def carried_mesh(smooth: SmoothSurface, held: Mapping[str, Any], mesh: Mesh, place: np.ndarray, to: np.ndarray) -> Mesh:
    """The mesh with its fine elements taken from the `place` (3,) of its recipe `to` (3,) one beside it.

    X + (1 − (r/D)²)² (to − place) at distance r < D of the place, D that of the nearest held vertex: so a misaligned
    indenter meets the same elements, and nothing moves where a support is.  Raises BadMesh where it is too far.
    """
    nodes = np.unique(_boundary(mesh.vertices, mesh.tets))
    below = nodes[held_level(held, mesh.vertices[nodes]) <= ON_RIM_TOLERANCE * float(np.abs(smooth.vertices).max())]
    reach = float(np.linalg.norm(mesh.vertices[below] - place, axis=1).min())
    r = np.linalg.norm(mesh.vertices - place, axis=1) / reach
    points = mesh.vertices + (np.maximum(1.0 - r * r, 0.0) ** 2)[:, None] * (to - place)
    moving = nodes[r[nodes] < 1.0]
    points[moving] = smooth.project(points[moving])
    worst = float(straight(points, mesh.tets).min())
    if worst < MIN_SCALED_JACOBIAN:
        far = float(np.linalg.norm(to - place))
        raise BadMesh(f"elements are spoilt {far:.3g} mm from the place that they were made for: {worst:.3f}")
    return Mesh(points, mesh.tets)


def _boundary(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    linear = MeshTet(np.ascontiguousarray(points.T), np.ascontiguousarray(tets.T))
    return linear.facets[:, linear.boundary_facets()].T


def _align(
    smooth: SmoothSurface, held: Mapping[str, Any], points: np.ndarray, tets: np.ndarray, skin: np.ndarray
) -> None:
    """Slide the nearer end of every surface edge that crosses the rim onto it along the surface, where elements allow.

    An edge that is left alone has an end on each side: there the held region ends within an element.
    """
    edges = np.unique(np.sort(np.concatenate([skin[:, [0, 1]], skin[:, [1, 2]], skin[:, [2, 0]]]), axis=1), axis=0)
    nodes, small = np.unique(skin), ON_RIM_TOLERANCE * float(np.abs(smooth.vertices).max())
    phi, tried = np.zeros(len(points)), np.zeros(len(points), bool)
    phi[nodes] = held_level(held, points[nodes])
    phi[np.abs(phi) <= small] = 0.0
    ends = np.unique(edges[phi[edges[:, 0]] * phi[edges[:, 1]] < 0.0])
    rim = np.full((len(points), 3), np.nan)
    rim[ends] = onto_rim(smooth, held, points[ends])
    while True:
        ends = np.unique(edges[phi[edges[:, 0]] * phi[edges[:, 1]] < 0.0])
        ends = ends[~tried[ends]]
        if not len(ends):
            return
        k = ends[np.argmin(np.abs(phi[ends]))]
        tried[k] = True
        around, before = tets[(tets == k).any(1)], points[k].copy()
        points[k] = rim[k]
        if np.all(np.isfinite(rim[k])) and straight(points, around).min() >= MIN_RIM_SCALED_JACOBIAN:
            phi[k] = 0.0
        else:
            points[k] = before


def straight(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Scaled Jacobian (m,) of straight-sided elements, as :func:`.placing.scaled_jacobian`."""
    T = np.swapaxes(points[tets[:, 1:]] - points[tets[:, :1]], 1, 2) @ np.linalg.inv(REGULAR_TETRAHEDRON)
    return np.linalg.det(T) / (np.linalg.norm(T, axis=(1, 2)) / np.sqrt(3.0)) ** 3


def quadratic_on_scan(smooth: SmoothSurface, held: Mapping[str, Any], mesh: Mesh) -> MeshTet2:
    """Ten-node tetrahedra whose boundary mid-edge nodes lie on the smooth surface, between two of the rim on that.

    Where that spoils an element (a scaled Jacobian below `MIN_RIM_SCALED_JACOBIAN`), large ones at a dent, its edges
    keep to the surface without the rim, or bend half as much, or a quarter, or not at all.
    """
    linear = MeshTet(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.tets.T))
    numbers = MeshTet2.from_mesh(linear).t  # its nodes are averages over cells: equal to the bit they are not
    nodes = np.hstack([linear.p, 0.5 * (linear.p[:, linear.edges[0]] + linear.p[:, linear.edges[1]])]).T
    edges = np.unique(linear.f2e[:, linear.boundary_facets()])
    middle = linear.nvertices + edges
    flat = nodes[middle]
    on = smooth.project(flat)
    ways = [on.copy(), on, 0.5 * (flat + on), 0.75 * flat + 0.25 * on, flat]
    small = ON_RIM_TOLERANCE * float(np.abs(smooth.vertices).max())
    ends = linear.p.T[linear.edges[:, edges].T.ravel()]
    rim = np.nonzero((np.abs(held_level(held, ends)) <= small).reshape(-1, 2).all(1))[0]
    if len(rim):
        moved = onto_rim(smooth, held, on[rim])
        found = np.isfinite(moved).all(1) & (
            np.linalg.norm(moved - on[rim], axis=1) < 0.5 * _chord(linear, middle[rim])
        )
        ways[0][rim[found]] = moved[found]
    way = np.zeros(len(middle), int)
    while True:
        nodes[middle] = np.choose(way[:, None], ways)
        made = MeshTet2(np.ascontiguousarray(nodes.T), numbers)
        bad = made.dofs.element_dofs[:, scaled_jacobian(made) < MIN_RIM_SCALED_JACOBIAN]
        spoilt = np.isin(middle, bad) & (way < len(ways) - 1)
        if not spoilt.any():
            return made
        way[spoilt] += 1


def _chord(linear: MeshTet, middle: np.ndarray) -> np.ndarray:
    ends = linear.edges[:, middle - linear.nvertices]
    return np.linalg.norm(linear.p[:, ends[0]] - linear.p[:, ends[1]], axis=0)


if __name__ == "__main__":
    die_with_parent()
    Path(sys.argv[2]).write_bytes(graded_tetrahedra(json.loads(sys.argv[1])).to_bytes())
