"""Remeshing on the way: when the mesh of a meridian is worn, the new one, and what the change of meshes does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem_backend import meshing, post
from fem_backend.contact import tractions
from fem_backend.remeshing import location
from fem_backend.remeshing.section import NoMesh, Section, rezoned
from fem_backend.remeshing.triangulation import quality
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.initial_state import InitialState
from fem_backend.solver.load_steps import Wear
from fem_backend.solver.newton import Evaluation

LONGER = 1.8  # times the wanted length: an edge that the indenter may touch is too long
GROWTH = 0.3  # of the length of new edges per distance from the surface
AROUND = 2.5  # lengths of the indenter, or contact radii: what is meshed anew around its way


def allowed(at: InitialState) -> bool:
    """Whether the mesh of a run may be made anew: a meridian whose support carries no weight by multipliers."""
    return at.placement.meridian and at.carrying is None and at.settings.remesh != "never"


def wear(at: InitialState) -> Wear:
    """The measure of a mesh: whether a state has outworn it.

    An edge that the indenter may touch has grown to 1.8 times the length that is wanted where it is now, and was not so
    long before; or the corners of a cell, well shaped in the undeformed body, have turned over.
    """
    body, facets = at.model.body, at.system.pressing.surface.facets
    first = np.maximum(_lengths(at, facets, body.nodes), 1.0)
    upright = quality(body.nodes[:, [0, 2]][body.cells[:, :3]]) > 0.0

    def worn(state: Evaluation) -> bool:
        x = body.nodes + state.u
        if (_lengths(at, facets, x) > LONGER * first).any():
            return True
        return bool((quality(x[:, [0, 2]][body.cells[:, :3]])[upright] <= 0.0).any())

    return worn


def _lengths(at: InitialState, edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Lengths (f,) of edges over what is wanted where they are."""
    ends = x[edges[:, :2]]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / _wanted(at, x[edges[:, 2]][:, [0, 2]])


def _wanted(at: InitialState, x: np.ndarray) -> np.ndarray:
    """Wanted edge length (k,) mm on the surface at places now (k, 2)."""
    return at.settings.fineness * at.settings.indenter.spacing(np.maximum(x[:, 0], 0.0))


def renewed(at: InitialState, state: Evaluation, travel: float) -> tuple[InitialState, np.ndarray]:
    """The experiment on a new mesh, and the displacement (n, 3) carried over to it; raises NoMesh."""
    body = at.model.body
    section = _section(at, state.u)
    new = rezoned(section, _near(at, section, state, travel), lambda x: _wanted(at, x), GROWTH)
    try:
        model = modelling.remeshed(at.settings, at.knobs, at.placement, new)
        cell, xi = location.located(section.X, section.cells, new.points)
    except (meshing.BadMesh, location.Lost) as error:
        raise NoMesh(str(error)) from error
    u, seated = (location.at_nodes(v, body.cells, cell, xi) for v in (state.u, at.seated))
    for v in (u, seated):
        v[model.body.free.reshape(-1, 3) < 0] = 0.0
    system = modelling.system(at.settings, at.knobs, at.placement, model)
    probes = None
    if at.probes is not None:
        marks = np.array(at.settings.profile) - (at.settings.point if at.placement.specimen.alike else (0.0, 0.0))
        probes = post.surface_points(model.body.nodes, model.facets, marks, at.placement.planes)
    return replace(at, model=model, system=system, seated=seated, probes=probes), u


def _section(at: InitialState, u: np.ndarray) -> Section:
    body = at.model.body
    fixed = body.free.reshape(-1, 3) < 0
    middle = body.nodes[body.cells[:, 6]]
    ratio = at.placement.specimen.stiffness(middle)
    part = np.zeros(len(middle), int) if ratio is None else np.unique(ratio, return_inverse=True)[1]
    return Section(
        body.nodes[:, [0, 2]], u[:, [0, 2]], body.cells, at.model.facets, fixed[:, 0] + 2 * fixed[:, 2], part
    )


def _near(at: InitialState, section: Section, state: Evaluation, travel: float) -> np.ndarray:
    """Cells (m,) around the way of the indenter."""
    touched = tractions.contact_points(at.system.pressing.surface, at.model.body.nodes + state.u)
    touched = touched[state.contact.pressure > 0.0]
    radius = max(at.placement.indenter.length, float(touched[:, 0].max(initial=0.0)))
    top = float(at.placement.specimen.top[2])
    tip = float(touched[:, 2].min(initial=top))
    middle = section.x[section.cells[:, 6]]
    beside = middle[:, 1] - np.clip(middle[:, 1], tip, top)
    return np.hypot(middle[:, 0], beside) < AROUND * radius
