"""Quarter meshes shipped with the program: the same to the bit on every machine, made by benchmarks/mesh_grading.py.

Each level is an npz of `vertices` (n, 3) mm of the reference specimen, `tets` (m, 4) and `sizing`, the words it was
made from.
"""

from __future__ import annotations

import hashlib
import io
from functools import cache
from pathlib import Path

import numpy as np

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mesh import Mesh, Sizing

TEMPLATE_BODY = EllipsoidShape(60.0, 35.0, 35.0)  # semi-axes (mm)
TEMPLATE_RADIUS_MM = 3.0  # of the indenter that the templates are graded for
# for other specimens: a similar one under a ball of `TEMPLATE_RADIUS_MM`, with hmax = 1.15 times the smallest semi-axis
TEMPLATE_SIZINGS = {
    "coarse": Sizing(0.75, 3.0, 0.65, 40.25, 1.0),
    "standard": Sizing(0.7, 2.5, 0.5, 40.25, 3.0),
    "fine": Sizing(0.52, 2.5, 0.37, 40.25, 3.0),
    "reference": Sizing(0.38, 3.0, 0.33, 40.25, 1.0),  # shipped: coarse with every tetrahedron cut into eight
}
CRUDE_LEVEL = "crude"  # no level to choose: what deep runs on coarse and standard are compared with, for their errors
# with that of the level that nobody chooses
ALL_TEMPLATE_SIZINGS = {**TEMPLATE_SIZINGS, CRUDE_LEVEL: Sizing(1.07, 3.0, 0.85, 40.25, 1.0)}


def template_mesh(level: str) -> Mesh:
    """Quarter mesh of `TEMPLATE_BODY` graded for a ball of `TEMPLATE_RADIUS_MM`; KeyError for a level not shipped."""
    if level not in ALL_TEMPLATE_SIZINGS:
        raise KeyError(f"no template {level!r}; choose from {', '.join(ALL_TEMPLATE_SIZINGS)}")
    with np.load(Path(__file__).with_name(f"{level}.npz"), allow_pickle=False) as data:
        return Mesh(data["vertices"], data["tets"].astype(np.int64))


@cache
def template_hash(level: str) -> str:
    """Hash of the numbers of a template (not of its file)."""
    mesh = template_mesh(level)
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.tets.tobytes()).hexdigest()


def template_fits(body: EllipsoidShape, radius: float, within: float = 0.15) -> bool:
    """Whether the templates, scaled to `body`, have elements of the asked size (to `within`) under this indenter."""
    scale = body.semi_axes / TEMPLATE_BODY.semi_axes / (radius / TEMPLATE_RADIUS_MM)
    return bool(np.all(np.abs(np.log(scale)) <= np.log(1.0 + within)))


def template_bytes(mesh: Mesh, sizing: str) -> bytes:
    """The file of a template."""
    out = io.BytesIO()
    np.savez_compressed(out, vertices=mesh.vertices, tets=mesh.tets.astype(np.int32), sizing=np.array(sizing))
    return out.getvalue()
