"""An indentation as an input file that Abaqus and CalculiX read alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fem_backend.export.material_cards import MATERIAL_NAME, abaqus
from fem_backend.export.solid_model import SolidModel, sets_of

# contact stiffness (MPa/mm) over μ: 0.1 % of the force where a contact is some millimetres wide
ABAQUS_PENALTY_PER_MM = 1000.0
INDENTER_WALL_RATIO = 0.05  # thickness of the meshed indenter over its width
STEP_INCREMENTS = (0.25, 1e-5, 0.5)  # of a step of time 1: the first, the smallest, the largest
FACE_NAMES = ("S1", "S2", "S3", "S4")  # of a tetrahedron
N_NUMBERS_PER_LINE = 16  # of nodes in a set, the most that a line may hold


def abaqus_deck(model: SolidModel, remarks: Sequence[str]) -> str:
    """The whole file: one step, of time 1, for each asked travel; the total reaction of the set TOOL stands in .dat.

    Elements C3D10; the indenter is a wall of C3D6 and C3D8 whose nodes are all moved alike, surface-to-surface contact
    with a linear pressure-overclosure.  Fz of the specimen on the indenter is minus the total of its third component,
    times :attr:`SolidModel.share`.

    Source: CalculiX 2.20 manual, Abaqus Keywords Guide: *ELEMENT (C3D10 faces), *CONTACT PAIR, *SURFACE BEHAVIOR.
    """
    n, m = len(model.nodes), len(model.cells)
    outer, inner = model.indenter, _wall(model)
    lines = [*(f"** {line}" for line in remarks), "*NODE, NSET=ALL"]
    lines += [_row(k, x) for k, x in enumerate(np.vstack([model.nodes, outer, inner]), 1)]
    for k in range(len(model.materials)):
        lines += [f"*ELEMENT, TYPE=C3D10, ELSET={MATERIAL_NAME}{k + 1}"]
        lines += [_ids(int(cell) + 1, model.cells[cell]) for cell in np.flatnonzero(model.material == k)]
    flat = model.shell[:, 2] == model.shell[:, 3]
    number = m + 1
    tool = []
    for kind, faces in (("C3D6", model.shell[flat, :3]), ("C3D8", model.shell[~flat])):
        if len(faces):
            lines += [f"*ELEMENT, TYPE={kind}, ELSET=WALL"]
        for face in faces:
            # the outer face comes last, so that the corners of the first turn inward: towards the second
            lines += [_ids(number, np.concatenate([face + n + len(outer), face + n]))]
            tool.append(f"{number}, S2")
            number += 1
    for k, nodes in enumerate(sets_of(model.fixed).values(), 1):
        lines += [f"*NSET, NSET=FIXED{k}", *_listed(nodes)]
    lines += ["*NSET, NSET=TOOL", *_listed(n + np.arange(2 * len(outer)))]
    lines += ["*SURFACE, NAME=TOP", *(f"{cell + 1}, {FACE_NAMES[side]}" for cell, side in model.faces)]
    lines += ["*SURFACE, NAME=INDENTER", *tool]
    for k, c in enumerate(model.materials, 1):
        lines += [
            *abaqus(c, f"{MATERIAL_NAME}{k}"),
            f"*SOLID SECTION, ELSET={MATERIAL_NAME}{k}, MATERIAL={MATERIAL_NAME}{k}",
        ]
    lines += ["*MATERIAL, NAME=STIFF", "*ELASTIC", f"{1000.0 * model.mu:.12g}, 0.3"]
    lines += ["*SOLID SECTION, ELSET=WALL, MATERIAL=STIFF"]
    lines += ["*SURFACE INTERACTION, NAME=SMOOTH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
    lines += [f"{ABAQUS_PENALTY_PER_MM * model.mu:.12g}"]
    if model.friction:
        lines += ["*FRICTION", f"{model.friction:.12g}, {ABAQUS_PENALTY_PER_MM * model.mu:.12g}"]
    lines += ["*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE", "TOP, INDENTER", "*BOUNDARY"]
    for k, (held, _) in enumerate(sets_of(model.fixed).items(), 1):
        lines += [f"FIXED{k}, {axis + 1}, {axis + 1}" for axis in range(3) if held[axis]]
    small = all(c.small for c in model.materials)
    first, least, most = STEP_INCREMENTS
    for travel in np.interp(model.asked, model.time, model.travel):
        lines += [f"*STEP{'' if small else ', NLGEOM'}, INC=1000", "*STATIC", f"{first}, 1.0, {least}, {most}"]
        lines += ["*BOUNDARY"]
        lines += [f"TOOL, {k + 1}, {k + 1}, {travel * model.way[k] + 0.0:.12g}" for k in range(3)]
        lines += ["*NODE PRINT, NSET=TOOL, TOTALS=YES", "RF", "*NODE FILE", "U", "*END STEP"]
    return "\n".join(lines) + "\n"


def _wall(model: SolidModel) -> np.ndarray:
    """Nodes (k, 3) behind those of the indenter, towards a point on its axis above all."""
    up = -model.way
    height = (model.indenter - model.indenter[0]) @ up
    wide = float(np.linalg.norm(np.ptp(model.indenter, axis=0)))
    middle = model.indenter[0] + (float(height.max()) + 0.1 * wide) * up
    away = middle - model.indenter
    return model.indenter + INDENTER_WALL_RATIO * wide * away / np.linalg.norm(away, axis=1)[:, None]


def _row(number: int, x: np.ndarray) -> str:
    return f"{number}, " + ", ".join(f"{v + 0.0:.12g}" for v in x)


def _ids(number: int, nodes: np.ndarray) -> str:
    return ", ".join(str(int(k)) for k in (number, *(nodes + 1)))


def _listed(nodes: np.ndarray) -> list[str]:
    """Numbers of nodes, which begin with 1 there, some to a line."""
    ids = [str(int(k) + 1) for k in nodes]
    return [", ".join(ids[k : k + N_NUMBERS_PER_LINE]) + "," for k in range(0, len(ids), N_NUMBERS_PER_LINE)]
