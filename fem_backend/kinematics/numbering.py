"""Numbers of the free dofs and the sparse pattern of their matrices.

Displacement dof 3·node + component; free dofs are numbered in METIS order, so every factorisation finds a fill-reducing
order; matrices are stored in CSR with a pattern built once, symmetric ones as their upper triangle.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pymetis
from scipy import sparse

from fem_backend.compiled import compiled


@dataclass(frozen=True)
class Pattern:
    """CSR pattern of the free dofs: `indptr` (f + 1,), `indices` (nnz,); only the upper triangle if `symmetric`."""

    indptr: np.ndarray
    indices: np.ndarray
    symmetric: bool = True

    @property
    def size(self) -> int:
        return len(self.indptr) - 1

    @functools.cached_property
    def diagonal(self) -> np.ndarray:
        """Places of the diagonal in `data`, (f,)."""
        if self.symmetric:
            return self.indptr[:-1]  # the first entry of each row
        row = np.repeat(np.arange(self.size), np.diff(self.indptr))
        return np.nonzero(self.indices == row)[0]

    @functools.cached_property
    def from_one(self) -> tuple[np.ndarray, np.ndarray]:
        """`indptr` and `indices` counted from one, int32."""
        return self.indptr.astype(np.int32) + 1, self.indices.astype(np.int32) + 1

    def find(self, dofs: np.ndarray) -> np.ndarray:
        """Place in `data` of every pair of the free dofs (b, d), −1 where one is held or not stored by symmetry.

        Returns (b, d, d) int32; a pair that the pattern does not hold raises KeyError.
        """
        place = _find(self.indptr, self.indices, np.ascontiguousarray(dofs), self.symmetric)
        if np.any(place == -2):
            raise KeyError("a pair of dofs shares no element")
        return place


@compiled()
def _find(indptr, indices, dofs, symmetric):  # type: ignore[no-untyped-def]
    count, d = dofs.shape
    place = np.full((count, d, d), -1, np.int32)
    for e in range(count):
        for p in range(d):
            i = dofs[e, p]
            if i < 0:
                continue
            for r in range(d):
                j = dofs[e, r]
                if j < 0 or (symmetric and j < i):
                    continue
                low, high = indptr[i], indptr[i + 1]
                while low < high:
                    middle = (low + high) // 2
                    if indices[middle] < j:
                        low = middle + 1
                    else:
                        high = middle
                place[e, p, r] = low if low < indptr[i + 1] and indices[low] == j else -2
    return place


def _graph(cells: np.ndarray, n: int) -> sparse.csr_matrix:
    """Node graph: 1 where two nodes share a cell (and on the diagonal)."""
    k = cells.shape[1]
    rows, cols = np.repeat(cells, k, axis=1).ravel(), np.tile(cells, (1, k)).ravel()
    graph = sparse.csr_matrix((np.ones(len(rows), np.int32), (rows, cols)), shape=(n, n))
    graph.sum_duplicates()
    return graph


def numbering(cells: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Number the free dofs in METIS nested-dissection order of the node graph."""
    graph = _graph(cells, len(held))
    graph.setdiag(0)
    graph.eliminate_zeros()
    places, _ = pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(graph.indptr, graph.indices))
    order = np.asarray(places)
    mask = ~held[order]
    free = np.full(held.shape, -1, dtype=np.int64)
    free[order] = np.where(mask, np.cumsum(mask.ravel()).reshape(mask.shape) - 1, -1)
    return free.ravel()


def free_places(free: np.ndarray) -> np.ndarray:
    """Places (f,) of the free dofs in the components (3n,) of a nodal field, in the order of their numbers."""
    return np.argsort(free, kind="stable")[np.count_nonzero(free < 0) :]


def pattern_of(cells: np.ndarray, free: np.ndarray, symmetric: bool) -> Pattern:
    """CSR pattern of all pairs of free dofs that share a cell."""
    graph = _graph(cells, len(free) // 3)
    graph.data[:] = 1
    pairs = sparse.kron(graph, np.ones((3, 3), np.int8), format="coo")
    rows, cols = free[pairs.row], free[pairs.col]
    keep = (rows >= 0) & (cols >= (rows if symmetric else 0))
    f = int(free.max()) + 1
    stored = sparse.csr_matrix((np.ones(int(keep.sum()), np.int8), (rows[keep], cols[keep])), shape=(f, f))
    stored.sort_indices()
    return Pattern(stored.indptr.astype(np.int32), stored.indices.astype(np.int32), symmetric)
