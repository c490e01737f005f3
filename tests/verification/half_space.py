"""A flat half ball of radius L under a rigid sphere: the half space of Hertz, cut where its displacement is small.

The product's own model is built and solved (`assembly.build_model`, `indentation.simulate_indentation`); only body and
mesh are put in from here: a flat surface, so that the effective radius is that of the sphere exactly, and a graded
octant that is the same everywhere.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from skfem import MeshTet, MeshTet2

from fem_backend import meshing
from fem_backend.indenters.sphere import Sphere
from fem_backend.simulation import assembly, indentation
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.load_steps import Control, Instant
from fem_backend.specimens.ellipsoid import Ellipsoid

LIFT = 1e-6  # mm: the flat surface lies just above z = 0, below which the product holds the surface


@dataclass(frozen=True)
class HalfSpace:
    """The octant x, y ≥ 0 ≥ z of the ball |x| ≤ L (mm), held on its outer sphere."""

    settings: Settings
    placement: Placement
    model: AssembledModel

    def solve(self, knobs: Knobs, depths: np.ndarray) -> Result:
        """Result at the depths (mm), reached at 1 mm/s."""
        instants = [Instant(float(d), float(d), True) for d in depths]
        return indentation.simulate_indentation(self.settings, knobs, self.placement, self.model, instants)


def half_space(
    n: int, h0: float, L: float, R: float, deepest: float, law: str = "linear_elastic", symmetric: bool = True
) -> HalfSpace:
    """n layers of elements, the first of size h0 (mm), each larger than the one before: r(s) ~ sinh(k s)."""
    points, tets = meshing.kuhn_simplex(n)
    x = np.c_[points[:, 0] - points[:, 1], points[:, 1] - points[:, 2], -points[:, 2]] / n
    layer, length = np.abs(x).sum(1), np.linalg.norm(x, axis=1)
    k = _stretch(L / (n * h0))
    x = x / np.where(length > 0, length, 1.0)[:, None] * (L * np.sinh(k * layer) / np.sinh(k))[:, None]
    x[:, 2] += LIFT
    mesh = MeshTet2.from_mesh(MeshTet(np.ascontiguousarray(x.T), np.ascontiguousarray(tets.T)))
    control = Control(first=0.3 * deepest, largest=deepest, path=0.25 * deepest, augmentations=4)
    body, down = Ellipsoid(L, L, LIFT), np.array([0.0, 0.0, -1.0])
    recipe = meshing.mapped_recipe(body, n, 0.0)  # stands for the mesh that is put in its place
    settings = Settings(body, Sphere(R), recipe=recipe, law=law, control=control)
    placement = Placement(body, Sphere(R), np.eye(3), np.array([0.0, 0.0, LIFT + R]), down, (True, True))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(meshing, "assemble", lambda *arguments: mesh)
        return HalfSpace(
            settings, placement, assembly.build_model(settings, meshing.Mesh(x, tets), body, (True, True), symmetric)
        )


def _stretch(ratio: float) -> float:
    """k with sinh(k)/k = ratio, by bisection."""
    low, high = 1e-6, 30.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sinh(middle) / middle < ratio else (low, middle)
    return low
