"""A flat half ball of radius L under a rigid sphere: the half space of Hertz, cut where its displacement is small.

It shares the elements, the contact and the solver with the product, not its bodies or meshers: the surface is flat, so
the effective radius is that of the sphere exactly, and the mesh is a graded octant that is the same everywhere.
"""

from dataclasses import dataclass

import numpy as np
from skfem import MeshTet, MeshTet2

from fem_backend import contact, element, linsolve, meshing, stepping
from fem_backend.geometry import Sphere
from fem_backend.newton import Counters, Load, System
from fem_backend.stepping import Control

DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class HalfSpace:
    """Discretised octant x, y ≥ 0 ≥ z of the ball |x| ≤ L (mm), the contact surface about its centre, the solver."""

    body: element.Body
    surface: contact.ContactSurface
    factor: linsolve.Factor

    def force(self, law, R: float, depths: np.ndarray) -> np.ndarray:
        """Forces (N) of the whole half space on a sphere of radius R (mm) at the depths (mm)."""
        epsilon = np.full(self.surface.weights.shape, 900.0 * law.shear_modulus / R)
        system = System(self.body, law, self.surface, Sphere(R), epsilon, self.factor)
        nothing = np.zeros(self.surface.weights.shape)
        control = Control(first=depths[0], largest=0.5 * depths[-1], augmentations=4)
        points = stepping.travel(
            system, lambda s: Load((s - R) * DOWN, nothing, DOWN), np.asarray(depths), control, Counters()
        )
        return np.array([4.0 * p.force[2] for p in points])


def half_space(n: int, h0: float, L: float, reach: float) -> HalfSpace:
    """n layers of elements, the first of size h0 (mm), each larger than the one before: r(s) ~ sinh(k s)."""
    points, tets = meshing._kuhn_simplex(n)
    x = np.c_[points[:, 0] - points[:, 1], points[:, 1] - points[:, 2], -points[:, 2]] / n
    layer, length = np.abs(x).sum(1), np.linalg.norm(x, axis=1)
    k = _stretch(L / (n * h0))
    x = x / np.where(length > 0, length, 1.0)[:, None] * (L * np.sinh(k * layer) / np.sinh(k))[:, None]
    mesh = MeshTet2.from_mesh(MeshTet(np.ascontiguousarray(x.T), np.ascontiguousarray(tets.T)))
    X = mesh.doflocs.T
    held = X == 0.0
    held[:, 2] = False
    facets = contact.quadratic_facets(mesh, mesh.boundary_facets())
    plane = (X[facets] == 0.0).all(1)
    held[np.unique(facets[~plane.any(1)])] = True  # the outer sphere
    body = element.discretise(mesh, held)
    near = plane[:, 2] & (np.linalg.norm(X[facets], axis=2).min(1) < reach)
    return HalfSpace(body, contact.contact_surface(body, facets[near]), linsolve.symmetric_solver(body.pattern))


def _stretch(ratio: float) -> float:
    """k with sinh(k)/k = ratio, by bisection."""
    low, high = 1e-6, 30.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sinh(middle) / middle < ratio else (low, middle)
    return low
