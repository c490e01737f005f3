"""Remeshing on the way: when the mesh of a meridian is worn, the new one, and what the change of meshes does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem_backend import meshing, post
from fem_backend.contact import tractions
from fem_backend.kinematics import bodies
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.materials.stress import History
from fem_backend.remeshing import location
from fem_backend.remeshing.section import DeformedMeridian, NoMesh, rezoned
from fem_backend.remeshing.triangulation import quality
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.experiment import remeshed_from
from fem_backend.simulation.initial_state import InitialState
from fem_backend.solver import history_steps, load_steps, newton
from fem_backend.solver.history_steps import Reached
from fem_backend.solver.jumps import JumpRecord
from fem_backend.solver.load_steps import Guess, Instant, LoadPoint, Stopped, Watch, Wear, Worn
from fem_backend.solver.newton import Counters, Evaluation, NotConverged

LONGER = 3.8  # times the wanted length: an edge of the first mesh that the indenter may touch is too long
LONGER_AT_EDGES = 3.3  # the same below an indenter with an edge or a tip
AGAIN_LONGER = 1.7  # the same of later ones, which have no rows along the surface that thin out as it stretches
FINER = 0.7  # new edges over those of the first mesh: the stretch of the skin falls off fast below it
GROWTH = 0.3  # of the length of new edges per distance from the surface
AGAIN = 0.1  # lengths of the indenter after which a mesh that was not made is tried again
AROUND = 2.5  # lengths of the indenter, or contact radii: what is meshed anew around its way


@dataclass(frozen=True)
class MeshLeg:
    """A part of the way on one mesh: what is solved there, who watches, where it began (mm), by which share the force
    changed there with the mesh, and u (n, 3) there; None of the first.  `watches` says who
    watches on the next mesh."""

    at: InitialState
    watch: Watch | None
    began: float = 0.0
    jump: float = 0.0
    u: np.ndarray | None = None
    watches: Callable[[InitialState], Watch] | None = None


def allowed(at: InitialState) -> bool:
    """Whether the mesh of a run may be remade: a meridian with exact contact, no weight carried by multipliers."""
    return at.placement.meridian and at.carrying is None and np.isfinite(remeshed_from(at.settings))


def travel(
    legs: list[MeshLeg],
    asked: Sequence[float],
    counters: Counters,
    u: np.ndarray,
    guess: Guess | None = None,
) -> list[LoadPoint]:
    """As `load_steps.travel` from the first of the `legs`, to which every new mesh adds one.  Raises Stopped."""
    points: list[LoadPoint] = []
    here = since = 0.0
    control = legs[0].at.settings.control
    while True:
        leg, known = legs[-1], len(legs) - 1
        left = [s for s in asked if not points or s > points[-1].travel]
        try:
            found = load_steps.travel(
                leg.at.system, leg.at.start, left, control, counters, u, guess if known == 0 else None, leg.watch,
                here, wear(leg, since) if allowed(leg.at) else None,
            )  # fmt: skip
            return points + [replace(p, leg=known) for p in found]
        except Worn as worn:
            points += [replace(p, leg=known) for p in worn.points]
            u, here = worn.u, worn.travel
            try:
                new, u = _changed(leg, u, here, counters)
                legs.append(new)
                since = here
            except (NoMesh, NotConverged) as error:
                if isinstance(error, NotConverged) and error.cause == "time_limit":
                    raise load_steps.stopped(error, here, points, counters) from error
                since = here + AGAIN * leg.at.placement.indenter.length
        except Stopped as stopped:
            stopped.points = points + [replace(p, leg=known) for p in stopped.points]
            raise


def _changed(leg: MeshLeg, u: np.ndarray, here: float, counters: Counters) -> tuple[MeshLeg, np.ndarray]:
    """The next leg and its displacement; the force is found on both meshes.  Raises NoMesh and NotConverged."""
    at, control = leg.at, leg.at.settings.control
    old = load_steps.equilibrate(at.system, [u], at.start(here), here, control, counters)
    new, carried = renewed(at, old.stages[0].equilibrium.evaluation)
    found = load_steps.equilibrate(new.system, [carried], new.start(here), here, control, counters)
    before, after = (abs(float(p.force @ at.placement.direction)) for p in (old, found))
    watch = leg.watch if leg.watches is None else leg.watches(new)
    jump = abs(after - before) / max(before, 1e-300)
    u = found.stages[0].equilibrium.evaluation.u
    return MeshLeg(new, watch, here, jump, u, leg.watches), u


def follow(
    legs: list[MeshLeg],
    way: Sequence[Instant],
    counters: Counters,
    u: np.ndarray,
    history: History | None,
    touching: float | None,
    jumps: JumpRecord | None = None,
    begin_at: float = 0.0,
) -> list[LoadPoint]:
    """As `history_steps.follow` from the first of the `legs`, to which every new mesh adds one.  Raises Stopped.

    Only bodies without friction and attraction get new meshes: what sticks stays with its points.
    """
    points: list[LoadPoint] = []
    control, since, begin = legs[0].at.settings.control, 0.0, None
    while True:
        at, known = legs[-1].at, len(legs) - 1
        plain = allowed(at) and not any(p.friction or p.adhesion for p in at.system.pairs)
        left = [i for i in way if begin is None or i.time > begin.time]
        try:
            found = history_steps.follow(
                at.system, at.start, left, control, counters, u, history, touching, jumps, begin_at, begin,
                wear(legs[-1], since) if plain else None,
            )  # fmt: skip
            return points + [replace(p, leg=known) for p in found]
        except Worn as worn:
            points += [replace(p, leg=known) for p in worn.points]
            begin = worn.reached
            try:
                new, begin = _carried(legs[-1], begin, counters)
                legs.append(new)
                u, since = begin.u, begin.travel
            except (NoMesh, NotConverged) as error:
                if isinstance(error, NotConverged) and error.cause == "time_limit":
                    raise load_steps.stopped(error, worn.travel, points, counters) from error
                since = worn.travel + AGAIN * at.placement.indenter.length
        except Stopped as stopped:
            stopped.points = points + [replace(p, leg=known) for p in stopped.points]
            raise


def _carried(leg: MeshLeg, here: Reached, counters: Counters) -> tuple[MeshLeg, Reached]:
    """The next leg and what its path goes on from; equilibrium is found again at once, in no time.

    Histories are carried by `location.at_points`: stresses and overstresses at the quadrature points of the new mesh
    are those of the old one's cells, as linear functions.  Raises NoMesh and NotConverged.
    """
    at, control = leg.at, leg.at.settings.control
    old = newton.evaluate(at.system, here.u, replace(at.start(here.travel), history=here.history, dt=0.0))
    new, u = renewed(at, old)
    body, other = at.model.body, new.model.body
    X = location.quadrature_points(other.nodes[:, [0, 2]], other.cells, bodies.shape_functions(other))
    cell, xi = location.located(body.nodes[:, [0, 2]], body.cells, X.reshape(-1, 2))
    assert isinstance(body, MeridianBody)

    def field(values: np.ndarray) -> np.ndarray:
        return location.at_points(values, body.Q, cell, xi).reshape(*X.shape[:2], *values.shape[2:])

    history = here.history
    if history is not None:
        terms = np.array([field(h) for h in history.h]).reshape(len(history.h), *X.shape[:2], 6)
        history = History(field(history.S_iso), terms, field(history.W_max))
    load = replace(new.start(here.travel), history=history, dt=0.0)
    found = load_steps.find(new.system, u, load, control.between, counters).evaluation
    x = other.nodes + found.u
    pairs = zip(new.system.pairs, load.touches, found.contacts, strict=True)
    before = tuple(tractions.contact_history(pair, x, touch, contact) for pair, touch, contact in pairs)
    way = at.placement.direction
    first, after = (abs(float(state.contact.force @ way)) for state in (old, found))
    jump = abs(after - first) / max(first, 1e-300)
    reached = replace(
        here, u=found.u, rate=np.zeros_like(found.u), history=found.history, before=before,
        pressures=[c.pressure for c in found.contacts],
    )  # fmt: skip
    return MeshLeg(new, None, here.travel, jump, reached.u), reached


def wear(leg: MeshLeg, since: float = 0.0) -> Wear:
    """The measure of a mesh: whether a state beyond a travel `since` (mm) has outworn it.

    An edge that the indenter may touch has grown to 3.8 times the length that is wanted where it is now (3.3 below an
    edge or a tip, 1.7 of a mesh remade) and was not so long when the mesh was made; or the corners of a cell, well
    shaped in the undeformed body, have turned over.  Elements of length ℓ miss a force by about ℓ^2.5.
    """
    at, since = leg.at, max(since, remeshed_from(leg.at.settings))
    body, facets = at.model.body, at.system.pressing.surface.facets
    begun = at.seated if leg.u is None else leg.u
    first = LONGER if np.isinf(at.settings.indenter.finest[1]) else LONGER_AT_EDGES
    limit = (first if leg.u is None else AGAIN_LONGER) * np.maximum(_lengths(at, facets, body.nodes + begun), 1.0)
    upright = quality(body.nodes[:, [0, 2]][body.cells[:, :3]]) > 0.0

    def worn(u: np.ndarray, travel: float) -> bool:
        x = body.nodes + u
        if travel <= since:
            return False
        if (_lengths(at, facets, x) > limit).any():
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


def renewed(at: InitialState, state: Evaluation) -> tuple[InitialState, np.ndarray]:
    """The experiment on a new mesh, and the displacement (n, 3) carried over to it; raises NoMesh."""
    body = at.model.body
    section = _section(at, state.u)
    new = rezoned(section, _near(at, section, state), lambda x: FINER * _wanted(at, x), GROWTH)
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


def _section(at: InitialState, u: np.ndarray) -> DeformedMeridian:
    body = at.model.body
    fixed = body.free.reshape(-1, 3) < 0
    middle = body.nodes[body.cells[:, 6]]
    part = np.asarray(at.placement.specimen.layer(middle))
    return DeformedMeridian(
        body.nodes[:, [0, 2]], u[:, [0, 2]], body.cells, at.model.facets, fixed[:, 0] + 2 * fixed[:, 2], part
    )


def _near(at: InitialState, section: DeformedMeridian, state: Evaluation) -> np.ndarray:
    """Cells (m,) around the way of the indenter."""
    touched = tractions.contact_points(at.system.pressing.surface, at.model.body.nodes + state.u)
    touched = touched[state.contact.pressure > 0.0]
    radius = max(at.placement.indenter.length, float(touched[:, 0].max(initial=0.0)))
    top = float(at.placement.specimen.top[2])
    tip = float(touched[:, 2].min(initial=top))
    middle = section.x[section.cells[:, 6]]
    beside = middle[:, 1] - np.clip(middle[:, 1], tip, top)
    return np.hypot(middle[:, 0], beside) < AROUND * radius
