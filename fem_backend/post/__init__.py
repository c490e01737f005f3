"""Everything a user sees beyond the forces, from arrays: fields, pressures, probes, VTU files, pictures.

Nothing here changes a state: body, displacement, pressure go in, numbers and files come out.  `pictures` is imported by
who draws: a run that does not would start later and keep 20 MB more for it.
"""

from fem_backend.post.fields import Fields, Nodal, nodal, stress_fields, to_nodes
from fem_backend.post.pressure import pressure_at_nodes
from fem_backend.post.probes import Probes, displacements, surface_points
from fem_backend.post.vtu import write_vtu

__all__ = [
    "Fields",
    "Nodal",
    "Probes",
    "displacements",
    "nodal",
    "pressure_at_nodes",
    "stress_fields",
    "surface_points",
    "to_nodes",
    "write_vtu",
]
