"""The unit cube in distorted quadratic tetrahedra, for tests of the element."""

from __future__ import annotations

import numpy as np
from skfem import MeshTet, MeshTet2


def box(cells: int, corners: float = 0.0, middles: float = 0.0) -> tuple[MeshTet2, np.ndarray]:
    """Unit cube; inner vertices moved by `corners`, inner mid-edge nodes by `middles` of a cell; which are inner."""
    rng = np.random.default_rng(2)
    linear = MeshTet.init_tensor(*[np.linspace(0, 1, cells + 1)] * 3)
    inner = np.all((linear.p > 1e-9) & (linear.p < 1 - 1e-9), axis=0)
    points = linear.p + corners / cells * np.where(inner, rng.uniform(-1, 1, linear.p.shape), 0.0)
    curved = MeshTet2.from_mesh(MeshTet(points, linear.t))
    nodes = curved.doflocs.copy()
    inner = np.all((nodes > 1e-9) & (nodes < 1 - 1e-9), axis=0)
    middle = inner & (np.arange(nodes.shape[1]) >= linear.nvertices)
    nodes[:, middle] += middles / cells * rng.uniform(-1, 1, (3, int(middle.sum())))
    return MeshTet2(nodes, curved.t), inner
