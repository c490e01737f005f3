"""An indentation as programs with input files know it: nodes, tetrahedra, sets, materials, a meshed rigid indenter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fem_backend.contact.tractions import Pair
from fem_backend.export.material_cards import Constants, NotWritten, card_constants
from fem_backend.indenters import INDENTERS
from fem_backend.kinematics.bodies import Body
from fem_backend.laws import LAWS
from fem_backend.simulation import assembly
from fem_backend.simulation.assembly import MISALIGNMENT_KNOBS, AssembledModel, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.knobs import knobs_class as every
from fem_backend.specimens import SPECIMENS
from rso.contract import parameters_of

N_PIECES_AROUND = 96  # flat pieces of the indenter around its axis
N_PIECES_ALONG = 60  # of its meridian within reach
MAX_MATERIALS = 20  # of different stiffness in a file; more come from a field and are not written
# corners of faces S1 to S4 of a tetrahedron of Abaqus
FACES_OF_TETRAHEDRON = ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))
SAME_NODE_TOLERANCE = 1e-9  # of a length: nodes nearer than that are one


@dataclass(frozen=True)
class SolidModel:
    """Nodes X (n, 3) mm, cells (m, 10) with their material's index (m,), and what is done to them.

    Middle nodes of cells are those of edges 01, 12, 02, 03, 13, 23, of facets (f, 6) those of 01, 12, 02; facets turn
    outward.  `fixed` (n, 3) says which displacements are held, of which the `planes` of symmetry are a part; `touching`
    are the facets that the indenter may meet, faces (f, 2) their cell and side (0 to 3).  The rigid indenter has nodes
    (k, 3) where it first touches and faces of four corners (j, 4), outward (a triangle has its last corner twice); it
    moves along `way` (3,) by travel (c,) mm at time (c,) s.  `share` is how many times the model is contained in the
    whole.  `asked` are the moments (a,) s of the asked travels.
    """

    nodes: np.ndarray
    cells: np.ndarray
    material: np.ndarray
    materials: tuple[Constants, ...]
    fixed: np.ndarray
    touching: np.ndarray
    faces: np.ndarray
    indenter: np.ndarray
    shell: np.ndarray
    way: np.ndarray
    time: np.ndarray
    travel: np.ndarray
    asked: np.ndarray
    friction: float
    share: int

    @property
    def mu(self) -> float:
        """Shear modulus (MPa) that penalties go with: that of the softest material."""
        return min(c.mu for c in self.materials)


def solid_model(
    settings: Settings,
    knobs: Knobs,
    programme: tuple[np.ndarray, np.ndarray],
    asked: np.ndarray,
    mesh: str | None = None,
) -> SolidModel:
    """The three-dimensional model of an experiment, quarters and halves where they are symmetric.

    `programme` are times (c,) s and travels (c,) mm, `asked` moments (a,) s, `mesh` the file of a mesh made before.
    Raises NotWritten for what is not written for other programs, :class:`.assembly.NotModelled` for what is no body.
    """
    _only_written(knobs, settings)
    placement = dataclasses.replace(assembly.placement_of(settings, knobs), meridian=False)
    if not placement.indenter.of_revolution:
        raise NotWritten(f"{placement.indenter.described}: only indenters of revolution are meshed for other programs")
    model = assembly.model_for(settings, knobs, placement, mesh)
    body = model.body
    system = assembly.system(settings, knobs, placement, model)
    if system.seat or system.springs is not None or system.dead is not None:
        raise NotWritten(
            f"the support {settings.support.name!r} touches or carries the specimen: only held ones are written"
        )
    if system.pressing.held is not None:
        raise NotWritten("an indenter that is glued on is not written")
    parts, which = _materials(settings, knobs, body, system.scale)
    surface = _outward(body, _touched(system.pressing))
    points, shell = revolved_surface(placement)
    return SolidModel(
        body.nodes,
        body.cells,
        which,
        parts,
        _held(settings, knobs, placement, model),
        surface,
        _sides(body.cells, surface),
        points,
        shell,
        np.asarray(placement.direction, float),
        *programme,
        asked,
        float(knobs.friction),
        assembly.multiplicity(placement),
    )


def _only_written(knobs: Knobs, settings: Settings) -> None:
    """NotWritten for an effect that no deck holds: every knob off neutral that is not of geometry, place or law."""
    members = (*SPECIMENS.members.values(), *INDENTERS.members.values(), *LAWS.members.values())
    own = {p.name for m in members if getattr(m, "Knobs", None) is not None for p in parameters_of(m.Knobs)}
    written = {"mu", "D1", "friction", "skin_thickness", *MISALIGNMENT_KNOBS, *own}
    for p in parameters_of(every()):
        if p.neutral is not None and p.name not in written and getattr(knobs, p.name) != p.neutral:
            value = getattr(knobs, p.name)
            raise NotWritten(f"{p.name} = {value:g} {p.unit} ({p.description}) is not written for other programs")
    if any(settings.specimen.laws):
        raise NotWritten("layers with a law of their own are not written for other programs")


def _materials(
    settings: Settings, knobs: Knobs, body: Body, scale: np.ndarray | None
) -> tuple[tuple[Constants, ...], np.ndarray]:
    """Different materials and which one each cell has; a cell that two share has the one at most of its points."""
    stuff = assembly.material(settings, knobs)
    if scale is None:
        return (card_constants(stuff),), np.zeros(len(body.cells), int)
    of_cell = np.median(np.asarray(scale, float), axis=1)
    values, which = np.unique(np.round(of_cell, 12), return_inverse=True)
    if len(values) > MAX_MATERIALS:
        raise NotWritten(f"a stiffness that changes from place to place ({len(values)} values) is not written")
    return tuple(card_constants(stuff, float(v)) for v in values), which


def _touched(pair: Pair) -> np.ndarray:
    return np.asarray(pair.surface.facets)


def _held(settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel) -> np.ndarray:
    """Displacements (n, 3) that symmetry and support hold."""
    X = model.body.nodes
    held = np.zeros(X.shape, bool)
    for axis in (0, 1):
        if placement.planes[axis]:
            held[:, axis] = X[:, axis] == 0.0
    support = settings.support
    return held | support.actual(knobs).held(placement.specimen, X, np.unique(model.facets))


def _outward(body: Body, facets: np.ndarray) -> np.ndarray:
    """The facets (f, 6) turned so that the right-hand normal of their corners leads out of their cell."""
    side = _sides(body.cells, facets)
    inner = body.nodes[body.cells[side[:, 0], :4]].mean(1)
    a, b, c = (body.nodes[facets[:, k]] for k in range(3))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - inner) < 0.0
    return np.where(inward[:, None], facets[:, [0, 2, 1, 5, 4, 3]], facets)


def _sides(cells: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Cell and side (f, 2) of each facet, by its corners."""
    known: dict[tuple[int, ...], tuple[int, int]] = {}
    wanted = {tuple(sorted(map(int, f[:3]))) for f in facets}
    corners = np.isin(cells[:, :4], np.unique(facets[:, :3])).sum(1) >= 3
    for cell in np.flatnonzero(corners):
        for side, corner in enumerate(FACES_OF_TETRAHEDRON):
            key = tuple(sorted(int(cells[cell, k]) for k in corner))
            if key in wanted:
                known[key] = (int(cell), side)
    return np.array([known[tuple(sorted(map(int, f[:3])))] for f in facets])


def revolved_surface(placement: Placement) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (k, 3) mm and outward faces (j, 4) of an indenter of revolution where it first touches the specimen.

    The meridian is that which it draws itself, within its reach; nodes lie on the true surface, so that the flat pieces
    between them lie inside of it by at most a (1 − cos(π/N_PIECES_AROUND)) at a distance a from the axis.
    """
    up = -np.asarray(placement.direction, float)
    first = np.cross(up, [0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    line = placement.indenter.outline(np.zeros(3), -up, np.array([first, up]))
    r, z = _lower_half(line)
    angle = 2.0 * np.pi * np.arange(N_PIECES_AROUND) / N_PIECES_AROUND
    ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    points = [z[0] * up[None], *(a * ring + b * up for a, b in zip(r[1:], z[1:], strict=True))]
    faces = [[0, 1 + (k + 1) % N_PIECES_AROUND, 1 + k, 1 + k] for k in range(N_PIECES_AROUND)]
    for row in range(len(r) - 2):
        start = 1 + row * N_PIECES_AROUND
        for k in range(N_PIECES_AROUND):
            a, b = start + k, start + (k + 1) % N_PIECES_AROUND
            faces.append([a, b, b + N_PIECES_AROUND, a + N_PIECES_AROUND])
    nodes = np.vstack(points) + placement.touch
    return nodes, _turned_out(nodes, np.array(faces), up, placement.touch)


def _lower_half(line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the axis and heights (q,) of the side that looks down, from the axis to where it is widest."""
    tip = float(line[:, 1].min())
    size = float(np.ptp(line[:, 0]))
    right = line[line[:, 0] >= -SAME_NODE_TOLERANCE * size]
    order = np.argsort(np.round(right[:, 1], 12) + 1e-6 * right[:, 0])
    right = right[order]
    widest = float(right[:, 0].max())
    end = int(np.flatnonzero(right[:, 0] >= widest - SAME_NODE_TOLERANCE * size)[0])
    kept = right[: end + 1]
    apart = np.concatenate([[True], np.linalg.norm(np.diff(kept, axis=0), axis=1) > SAME_NODE_TOLERANCE * size])
    r, z = np.maximum(kept[apart].T, [[0.0], [-np.inf]])
    if r[0] > SAME_NODE_TOLERANCE * size:
        r, z = np.concatenate([[0.0], r]), np.concatenate([[tip], z])
    return r, z


def _turned_out(nodes: np.ndarray, faces: np.ndarray, up: np.ndarray, touch: np.ndarray) -> np.ndarray:
    """Faces whose right-hand normal leads out of the body, away from a point on its axis above."""
    a, b, c = (nodes[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    high = float(((nodes - touch) @ up).max())
    inward = np.einsum("fi,fi->f", normal, a - (touch + high * up)) < 0.0
    turned = np.where(faces[:, [2]] == faces[:, [3]], faces[:, [0, 2, 1, 1]], faces[:, [0, 3, 2, 1]])
    return np.where(inward[:, None], turned, faces)


def sets_of(fixed: np.ndarray) -> Mapping[tuple[bool, bool, bool], np.ndarray]:
    """Held components → nodes (k,) of which exactly these are held."""
    held = np.flatnonzero(fixed.any(1))
    kinds: dict[tuple[bool, bool, bool], list[int]] = {}
    for node in held:
        x, y, z = map(bool, fixed[node])
        kinds.setdefault((x, y, z), []).append(int(node))
    return {kind: np.array(nodes) for kind, nodes in kinds.items()}
