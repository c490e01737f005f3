"""Whether a triangulated surface bounds one body, and its facets turned outwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

WELDING_TOLERANCE = 1e-6  # of the size: digits of a text file may part vertices that are one


@dataclass(frozen=True)
class ClosedSurface:
    """One closed surface: vertices (n, 3), facets (m, 3) seen counter-clockwise from outside, what was repaired."""

    vertices: np.ndarray
    facets: np.ndarray
    repairs: tuple[str, ...] = ()


def closed(vertices: np.ndarray, facets: np.ndarray) -> ClosedSurface:
    """The surface with its facets turned outwards; ValueError where it does not bound one body, saying why.

    Facets that name a vertex twice are left out; where edges are open, vertices that only round-off parts are one.  An
    edge has two facets: of open or shared edges it is said how many there are and where the first lies.
    """
    vertices, facets, repairs = _welded(vertices, facets)
    twice = (facets == np.roll(facets, 1, axis=1)).any(1)
    kept = facets[~twice]
    if twice.any() and not repairs:
        repairs.append(f"{int(twice.sum())} facets with two equal corners left out")
    if len(kept) < 4:
        raise ValueError(f"has {len(kept)} facets with an area: a closed surface has at least 4")
    edges = edges_of(kept)
    owner = np.tile(np.arange(len(kept)), 3)
    ends, inverse, count = np.unique(np.sort(edges, 1), axis=0, return_inverse=True, return_counts=True)
    _refuse_edges(vertices, ends, count)
    order = np.argsort(inverse.ravel(), kind="stable").reshape(-1, 2)
    one, two = owner[order].T
    alike = edges[order[:, 0], 0] == edges[order[:, 1], 0]  # neighbours run along their edge in opposite directions
    same = coo_matrix((np.ones(len(one)), (one, two)), shape=(len(kept), len(kept)))
    parts, label = connected_components(same, directed=False)
    if parts > 1:
        raise ValueError(_several(vertices, kept, label, parts))
    turned = _turned(len(kept), one, two, alike)
    if np.any(turned[one] ^ turned[two] ^ alike):
        raise ValueError("has one side only, as a Moebius strip: it has no inside")
    out = kept.copy()
    out[turned] = out[turned][:, ::-1]
    if turned.any() and not turned.all():
        repairs.append(f"{int(min(turned.sum(), (~turned).sum()))} facets turned as their neighbours are")
    if enclosed_volume(vertices, out) < 0.0:
        out = out[:, ::-1]
        if not turned.any():
            repairs.append("all facets turned: the surface was inside out")
    return ClosedSurface(vertices, np.ascontiguousarray(out), tuple(repairs))


def edges_of(facets: np.ndarray) -> np.ndarray:
    """Directed edges 01, 12, 20 (3 m, 2) of facets (m, 3)."""
    return np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])


def enclosed_volume(vertices: np.ndarray, facets: np.ndarray) -> float:
    """Σ a·(b × c)/6 over the facets: what they enclose, negative where they face inwards."""
    a, b, c = (vertices[facets[:, k]] - vertices[facets[0, 0]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def _welded(vertices: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The surface, where it has open edges with vertices joined that digits of a text file parted; what is said."""
    count = np.unique(np.sort(edges_of(facets), 1), axis=0, return_counts=True)[1]
    if not np.any(count == 1):
        return vertices, facets, []
    pairs = cKDTree(vertices).query_pairs(
        WELDING_TOLERANCE * float(np.ptp(vertices, axis=0).max()), output_type="ndarray"
    )
    if not len(pairs):
        return vertices, facets, []
    n = len(vertices)
    groups, label = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)), directed=False)
    first = np.unique(label, return_index=True)[1]
    return vertices[first], label[facets], [f"{n - groups} vertices joined that round-off had parted"]


def _areas(vertices: np.ndarray, facets: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[facets[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0


def _refuse_edges(vertices: np.ndarray, ends: np.ndarray, count: np.ndarray) -> None:
    for wrong, words in ((count == 1, "open edges, which one facet has"), (count > 2, "edges of more than two facets")):
        if wrong.any():
            at = ", ".join(f"{v:.4g}" for v in vertices[ends[wrong][0]].mean(0))
            raise ValueError(f"is not closed: {int(wrong.sum())} {words}, the first at ({at}) in the file's unit")


def _several(vertices: np.ndarray, facets: np.ndarray, label: np.ndarray, parts: int) -> str:
    area = np.bincount(label, _areas(vertices, facets), parts)
    shares = sorted((100.0 * area / area.sum()).tolist(), reverse=True)
    listed = ", ".join(f"{v:.3g} %" for v in shares[:4]) + (", …" if parts > 4 else "")
    return f"holds {parts} separate surfaces ({listed} of the area): keep the one that is the body"


def _turned(count: int, one: np.ndarray, two: np.ndarray, alike: np.ndarray) -> np.ndarray:
    """Which facets (m,) to turn so that all run as the first does, going from neighbour to neighbour."""
    rows, columns = np.concatenate([one, two]), np.concatenate([two, one])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    way = coo_matrix((np.tile(np.where(alike, 2.0, 1.0), 2), (rows, columns)), shape=(count, count)).tocsr()
    order, before = breadth_first_order(graph, 0, directed=False)
    flips = np.zeros(count, bool)
    against = np.zeros(count, bool)
    against[order[1:]] = np.asarray(way[before[order[1:]], order[1:]]).ravel() > 1.5
    for k in order[1:].tolist():
        flips[k] = flips[before[k]] ^ against[k]
    return flips
