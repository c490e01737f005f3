"""Everything a user sees beyond the forces, from arrays: fields, contact patch, probes, VTU files, pictures.

Nothing here changes a state: body, displacement, pressure go in, numbers and files come out.
"""

from fem_backend.post.fields import Fields, Nodal, fields, nodal, to_nodes
from fem_backend.post.patch import Patch, contact_patch, pressure_at_nodes
from fem_backend.post.pictures import draw_section, draw_surface, section
from fem_backend.post.probes import Probes, displacements, surface_points
from fem_backend.post.vtu import write_vtu

__all__ = [
    "Fields",
    "Nodal",
    "Patch",
    "Probes",
    "contact_patch",
    "displacements",
    "draw_section",
    "draw_surface",
    "fields",
    "nodal",
    "pressure_at_nodes",
    "section",
    "surface_points",
    "to_nodes",
    "write_vtu",
]
