"""Frictionless contact of the curved surface with a rigid indenter by an augmented Lagrangian.

Π_c = ∫ (p² − λ²)/(2ε) dA₀ with the pressure p = ⟨λ − ε g⟩ per reference area, gap g and multiplier λ ≥ 0
(Wriggers 2006, §6.3.4).  ε is a multiple of the shear modulus per length, so that similarity stays exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import ElementTriP2, MeshTet2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from fem_backend.element import Body
from fem_backend.geometry import Sphere

ORDER = 6  # twelve points a facet


@dataclass(frozen=True)
class ContactSurface:
    """Quadratic facets (f, 6) that may touch, shape functions N (q, 6), area weights (f, q) mm², matrix places."""

    facets: np.ndarray
    N: np.ndarray
    weights: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class ContactState:
    """One evaluation: energy (N mm), nodal forces as residual (n, 3) N, force on the indenter (3,) N, p, g (f, q)."""

    energy: float
    residual: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    gap: np.ndarray


def quadratic_facets(mesh: MeshTet2, facets: np.ndarray) -> np.ndarray:
    """Nodes (f, 6) of boundary facets: three corners, then the middles of edges 01, 12, 02."""
    n = mesh.nvertices
    key = np.sort(mesh.edges, axis=0)
    key = key[0].astype(np.int64) * n + key[1]
    order = np.argsort(key)
    corners = mesh.facets[:, facets]

    def middle(i: int, j: int) -> np.ndarray:
        a, b = np.minimum(corners[i], corners[j]), np.maximum(corners[i], corners[j])
        return n + order[np.searchsorted(key[order], a.astype(np.int64) * n + b)]

    return np.stack([*corners, middle(0, 1), middle(1, 2), middle(0, 2)], axis=1)


def contact_surface(body: Body, facets: np.ndarray) -> ContactSurface:
    """Quadrature on the quadratic facets (f, 6) of the undeformed surface."""
    X, weights = get_quadrature(RefTri, ORDER)
    N, dN = (np.stack([ElementTriP2().lbasis(X, a)[k] for a in range(6)]) for k in (0, 1))
    tangent = np.einsum("fai,akq->fqki", body.nodes[facets], dN)
    area = np.linalg.norm(np.cross(tangent[:, :, 0], tangent[:, :, 1]), axis=-1)
    dofs = body.free[(3 * facets[:, :, None] + np.arange(3)).reshape(len(facets), 18)]
    return ContactSurface(facets, N.T.copy(), area * weights, body.pattern.find(dofs))


def evaluate(
    surface: ContactSurface,
    x: np.ndarray,
    indenter: Sphere,
    centre: np.ndarray,
    epsilon: np.ndarray,
    multiplier: np.ndarray,
) -> ContactState:
    """Energy, residual and force at current positions x (n, 3), indenter centre (3,), ε (f, q) MPa/mm, λ (f, q) MPa."""
    points = np.einsum("qa,fai->fqi", surface.N, x[surface.facets])
    gap, normal, _ = indenter.gap(points, centre)
    pressure = np.maximum(multiplier - epsilon * gap, 0.0)
    traction = (surface.weights * pressure)[..., None] * normal
    residual = np.zeros_like(x)
    np.add.at(residual, surface.facets, -np.einsum("qa,fqi->fai", surface.N, traction))
    energy = 0.5 * float((surface.weights * (pressure**2 - multiplier**2) / epsilon).sum())
    return ContactState(energy, residual, -traction.sum((0, 1)), pressure, gap)


def tangent(
    surface: ContactSurface,
    x: np.ndarray,
    indenter: Sphere,
    centre: np.ndarray,
    epsilon: np.ndarray,
    pressure: np.ndarray,
    direction: np.ndarray,
    data: np.ndarray,
    geometric: bool = True,
) -> np.ndarray:
    """Add the contact stiffness to `data` and return ∂R/∂s (n, 3) for an indenter moving as c + s·direction.

    k = ε n⊗n − p ∇∇g at points in contact; without `geometric` the second, negative term is left out, which keeps
    the matrix positive semi-definite at the price of slower convergence.
    """
    active = np.nonzero((pressure > 0).any(1))[0]
    facets = surface.facets[active]
    points = np.einsum("qa,fai->fqi", surface.N, x[facets])
    _, normal, hessian = indenter.gap(points, centre)
    p = pressure[active]
    stiff = np.where(p > 0, epsilon[active], 0.0)[..., None, None]
    k = stiff * normal[..., :, None] * normal[..., None, :]
    if geometric:
        k -= p[..., None, None] * hessian
    k *= surface.weights[active][..., None, None]
    block = np.einsum("qa,qb,fqij->faibj", surface.N, surface.N, k, optimize=True).reshape(len(active), 18, 18)
    place = surface.place[active]
    known = place >= 0
    np.add.at(data, place[known], block[known])
    moving = np.zeros_like(x)
    np.add.at(moving, facets, -np.einsum("qa,fqij,j->fai", surface.N, k, direction))
    return moving
