"""A body becomes graded tetrahedra: fTetWild for any body, a conformal map of a subdivided ball for tests.

fTetWild gives the better elements but is not reproducible, so its mesh is an artefact: the reference specimen's are
shipped (`templates`), others are made once and stored under their hash.  The mapped mesh is the same to the bit
everywhere.  All give a `Mesh` of vertices and tetrahedra of the quarter x ≥ 0, y ≥ 0, graded towards the top;
`assemble` makes of it the quadratic mesh of any specimen, point and symmetry, `refined` cuts it for convergence checks.
Bodies of revolution touched on their axis have graded grids of their meridian, see `meridian`; bodies with a flat top
have graded grids in three dimensions, see `grids`.
"""

from fem_backend.meshing.grids import graded_for, is_grid
from fem_backend.meshing.mapped import kuhn_simplex, mapped_quarter
from fem_backend.meshing.meridian import MeridianMesh, Size, graded_coordinates, halved, triangulated
from fem_backend.meshing.mesh import BadMesh, Mesh, Sizing, read_arrays, volumes, with_mid_edge_nodes
from fem_backend.meshing.placing import MAX_SHARE_FROM_TOP, assemble, scaled_jacobian
from fem_backend.meshing.recipes import (
    LIMIT_LEVEL,
    MAKERS,
    cached,
    make_mesh,
    mapped_recipe,
    mesher,
    nominal_body,
    template_recipe,
    tetwild_recipe,
)
from fem_backend.meshing.refined import subdivided
from fem_backend.meshing.templates import (
    ALL_TEMPLATE_SIZINGS,
    CRUDE_LEVEL,
    TEMPLATE_RADIUS_MM,
    TEMPLATE_SIZINGS,
    template_fits,
    template_mesh,
)

__all__ = [
    "ALL_TEMPLATE_SIZINGS",
    "CRUDE_LEVEL",
    "LIMIT_LEVEL",
    "MAKERS",
    "MAX_SHARE_FROM_TOP",
    "TEMPLATE_RADIUS_MM",
    "TEMPLATE_SIZINGS",
    "BadMesh",
    "MeridianMesh",
    "Mesh",
    "Size",
    "Sizing",
    "assemble",
    "cached",
    "graded_coordinates",
    "graded_for",
    "halved",
    "is_grid",
    "kuhn_simplex",
    "make_mesh",
    "mapped_quarter",
    "mapped_recipe",
    "mesher",
    "nominal_body",
    "read_arrays",
    "scaled_jacobian",
    "subdivided",
    "template_fits",
    "template_mesh",
    "template_recipe",
    "tetwild_recipe",
    "triangulated",
    "volumes",
    "with_mid_edge_nodes",
]
