"""Contact pressure, which lives at points of the facets, at the nodes."""

from __future__ import annotations

import numpy as np
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.contact.tractions import FACET_QUADRATURE_ORDER, ContactSurface


def pressure_at_nodes(surface: ContactSurface, pressure: np.ndarray, count: int) -> np.ndarray:
    """Pressure (count,) MPa at all nodes, zero off the contact: linear per facet, averaged by area, never negative."""
    X, _ = get_quadrature(RefTri, FACET_QUADRATURE_ORDER)
    at = np.column_stack([1.0 - X.sum(0), *X])
    corners = np.einsum("cq,fq->fc", np.linalg.pinv(at), pressure)
    area = surface.weights.sum(1)
    weight, out = np.zeros(count), np.zeros(count)
    for c in range(3):
        np.add.at(weight, surface.facets[:, c], area)
        np.add.at(out, surface.facets[:, c], area * corners[:, c])
    out = np.clip(out / np.where(weight > 0.0, weight, 1.0), 0.0, None)
    for k, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
        out[surface.facets[:, 3 + k]] = 0.5 * (out[surface.facets[:, i]] + out[surface.facets[:, j]])
    return out
