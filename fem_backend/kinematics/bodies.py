"""A discretised body, whatever its elements: tetrahedra in space or triangles of a meridian."""

from __future__ import annotations

import numpy as np

from fem_backend.kinematics import axisymmetric, tetrahedra
from fem_backend.kinematics.axisymmetric import MeridianBody

Body = tetrahedra.Body | MeridianBody


def displacement_gradients(body: Body, u: np.ndarray) -> np.ndarray:
    """H = ∂u/∂X at the quadrature points, (m, q, 3, 3), from nodal displacements u (n, 3)."""
    if isinstance(body, tetrahedra.Body):
        return tetrahedra.displacement_gradients(body, u)
    return axisymmetric.displacement_gradients(body, u)


def shape_functions(body: Body) -> np.ndarray:
    """Shape functions (q, nodes of a cell) at the quadrature points."""
    return tetrahedra.shape_functions() if isinstance(body, tetrahedra.Body) else axisymmetric.shape_functions()
