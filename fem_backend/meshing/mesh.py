"""A mesh of straight-sided tetrahedra, and how it is put exactly on the body it stands for."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from skfem import MeshTet, MeshTet2

from fem_backend.geometry import EllipsoidShape


class BadMesh(ValueError):
    """The mesher returned something that is not the body."""


@dataclass(frozen=True)
class Sizing:
    """Target edge length h(d) = min(h0 + growth·max(d − r0, 0), hmax) at distance d (mm) from the contact.

    The distance is taken from a point `lift` (mm) above the contact, less `lift`: the region of one size is then a lens
    that reaches farther along the surface than into the depth.
    """

    h0: float
    r0: float
    growth: float
    hmax: float
    lift: float = 0.0

    def __call__(self, d: np.ndarray | float) -> np.ndarray:
        return np.minimum(self.h0 + self.growth * np.maximum(np.asarray(d) - self.r0, 0.0), self.hmax)

    def centre(self, body: EllipsoidShape) -> np.ndarray:
        """Where distances are taken from, (3,) mm."""
        return body.top + np.array([0.0, 0.0, self.lift])

    def at(self, points: np.ndarray, body: EllipsoidShape) -> np.ndarray:
        """Target edge length at points (…, 3) of a body touched at its top."""
        return self(np.linalg.norm(points - self.centre(body), axis=-1) - self.lift)

    def scaled(self, factor: float) -> Sizing:
        """The sizing of a model that is `factor` times as large."""
        return Sizing(self.h0 * factor, self.r0 * factor, self.growth, self.hmax * factor, self.lift * factor)


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
    def from_bytes(cls, data: bytes) -> Mesh:
        """Inverse of `to_bytes`; ValueError for bytes that hold no mesh."""
        return cls(*read_arrays(io.BytesIO(data), "mesh", ("vertices", "tets")))

    @classmethod
    def from_file(cls, path: Path | str) -> Mesh:
        """Inverse of `to_bytes`; ValueError for a file that holds no mesh."""
        return cls(*read_arrays(path, "mesh", ("vertices", "tets")))


def read_arrays(path: Path | str | io.BytesIO, what: str, names: Sequence[str]) -> list[np.ndarray]:
    """Arrays by name from an npz that stands for `what`; ValueError naming both where they cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return [data[name] for name in names]
    except (OSError, ValueError, KeyError, IndexError, EOFError, zipfile.BadZipFile, zlib.error, MemoryError) as error:
        raise ValueError(f"the artefact {what!r} at {path} cannot be read: {type(error).__name__}: {error}") from error


def volumes(mesh: Mesh) -> np.ndarray:
    """Signed volumes of the straight-sided tetrahedra (mm³)."""
    p = mesh.vertices[mesh.tets]
    return np.linalg.det(p[:, 1:] - p[:, :1]) / 6.0


def merge_vertices(vertices: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identify vertices that coincide to 1e-9 and drop cells that collapse."""
    _, first, inverse = np.unique(np.round(vertices, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    cells = inverse.ravel()[cells]
    distinct = np.array([len(set(c)) == cells.shape[1] for c in cells.tolist()])
    return vertices[first], cells[distinct]


def finish(body: EllipsoidShape, points: np.ndarray, tets: np.ndarray, near: float) -> Mesh:
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


def _align_rim(body: EllipsoidShape, points: np.ndarray, curved: np.ndarray) -> None:
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


def with_mid_edge_nodes(body: EllipsoidShape, mesh: Mesh) -> MeshTet2:
    """Ten-node tetrahedra whose mid-edge nodes lie on the ellipsoid, on the symmetry planes and on the rim."""
    linear = MeshTet(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.tets.T))
    numbers = MeshTet2.from_mesh(linear)  # its nodes are averages over cells: equal to the bit they are not
    nodes = np.hstack([linear.p, 0.5 * (linear.p[:, linear.edges[0]] + linear.p[:, linear.edges[1]])])
    facets = linear.boundary_facets()
    corner = linear.facets[:, facets]
    flat = (nodes[0, corner] == 0).all(0) | (nodes[1, corner] == 0).all(0)
    edges = np.unique(linear.f2e[:, facets[~flat]])
    middle = linear.nvertices + edges
    nodes[:, middle] = body.project(nodes[:, middle].T).T
    return MeshTet2(nodes, numbers.t)
