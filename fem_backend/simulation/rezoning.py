"""Remeshing on the way: when the mesh of a meridian is worn, the new one, and what the change of meshes does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.spatial import cKDTree

from fem_backend import meshing, post
from fem_backend.contact import tractions
from fem_backend.kinematics import bodies
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.materials.stress import History
from fem_backend.remeshing import location
from fem_backend.remeshing.section import DeformedMeridian, NoMesh, rezoned
from fem_backend.remeshing.triangulation import quality
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import contact_elements
from fem_backend.simulation.experiment import remeshed_from, watched_from
from fem_backend.simulation.initial_state import InitialState
from fem_backend.solver import history_steps, load_steps, newton
from fem_backend.solver.controlled_steps import Renew, Renewed
from fem_backend.solver.history_steps import Reached
from fem_backend.solver.jumps import JumpRecord
from fem_backend.solver.load_steps import Guess, Instant, LoadPoint, Stopped, Watch, Wear, Worn
from fem_backend.solver.newton import Counters, Evaluation, NotConverged

# times the wanted length: an edge of the first mesh that a smooth indenter may touch is too long
MAX_FIRST_EDGE_RATIO = 3.3
# the same of later ones, without rows along the surface that thin out, and of all below an edge
MAX_LATER_EDGE_RATIO = 2.2
NEW_EDGE_RATIO = 0.5  # new edges over those of the first mesh: the stretch of the skin falls off fast below it
NEW_EDGE_RATIO_BELOW_EDGES = 0.7  # the same below an indenter with an edge or a tip
TRIED_EDGE_FACTORS = (1.0, 0.8)  # times that length: meshes that are tried, as equilibrium may not be found on one
NEW_EDGE_GROWTH = 0.3  # of the length of new edges per distance from the surface
REMESHING_RETRY_TRAVEL_RATIO = 0.1  # lengths of the indenter after which a mesh that was not made is tried again
# lengths of the indenter that a mesh has served at least, where an equilibrium is lost on it
MIN_MESH_TRAVEL_RATIO = 0.02
N_CONTACT_NEIGHBOURS = 6  # points of contact of the old mesh among which those beside a new one are
T = TypeVar("T")
REZONED_RADIUS_RATIO = 2.5  # lengths of the indenter, or contact radii: what is meshed anew around its way


@dataclass(frozen=True)
class MeshLeg:
    """A part of the way on one mesh: what is solved there, who watches, where it began (mm), by which share the force
    changed there with the mesh, and u (n, 3) there; None of the first.  `watches` says who watches on the next mesh,
    `outworn` (mm) from which travel on it was outworn and kept, as none was made."""

    at: InitialState
    watch: Watch | None
    began: float = 0.0
    jump: float = 0.0
    u: np.ndarray | None = None
    watches: Callable[[InitialState], Watch] | None = None
    outworn: float = np.inf


def may_rezone(at: InitialState) -> bool:
    """Whether the mesh of a run may be remade: a meridian with exact contact, no weight carried by multipliers."""
    return at.placement.meridian and at.carrying is None and np.isfinite(remeshed_from(at.settings))


def renewable(at: InitialState) -> bool:
    """Whether that of a run whose way counts may be: what attracts stays with its points."""
    return may_rezone(at) and not any(p.adhesion for p in at.system.pairs)


def follow_travel_rezoned(
    legs: list[MeshLeg],
    asked: Sequence[float],
    counters: Counters,
    u: np.ndarray,
    guess: Guess | None = None,
) -> list[LoadPoint]:
    """As `load_steps.follow_travel` from the first of the `legs`, to which every new mesh adds one.  Raises Stopped."""
    points: list[LoadPoint] = []
    here = since = 0.0
    control = legs[0].at.settings.control
    while True:
        leg, known = legs[-1], len(legs) - 1
        left = [s for s in asked if not points or s > points[-1].travel]
        try:
            found = load_steps.follow_travel(
                leg.at.system, leg.at.start, left, control, counters, u, guess if known == 0 else None, leg.watch,
                here, _watching(legs, since, asked[-1]) if asked else None,
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
                    raise load_steps.stopped_run(error, here, points, counters) from error
                since = _kept(legs, here)
        except Stopped as stopped:
            points = stopped.points = points + [replace(p, leg=known) for p in stopped.points]
            final = stopped.cause in ("time_limit", "instability")  # what a body does is no fault of its mesh
            if stopped.last is None or final or not _served(leg, stopped.last[1]):
                raise
            u, here = stopped.last
            try:
                new, u = _rescued(leg, u, here, counters)
            except (NoMesh, NotConverged):
                raise stopped from None
            legs.append(new)
            since = here


def _watching(legs: list[MeshLeg], since: float, last: float) -> Wear | None:
    """What looks at the mesh on the way to a travel `last` (mm); None where that ends before it is looked at."""
    leg = legs[-1]
    if last <= watched_from(leg.at.settings):
        return None
    return wear(leg, since) if may_rezone(leg.at) else _noting(legs)


def _served(leg: MeshLeg, here: float) -> bool:
    """Whether a mesh has gone some way before a travel (mm), so that on a new one a run may find what it lost."""
    least = max(leg.began, watched_from(leg.at.settings))
    return may_rezone(leg.at) and here > least + MIN_MESH_TRAVEL_RATIO * leg.at.placement.indenter.length


def _kept(legs: list[MeshLeg], here: float) -> float:
    """Take note that a mesh outworn at a travel (mm) is kept; the travel from which a new one is tried again."""
    legs[-1] = replace(legs[-1], outworn=min(legs[-1].outworn, here))
    return here + REMESHING_RETRY_TRAVEL_RATIO * legs[-1].at.placement.indenter.length


def _noting(legs: list[MeshLeg]) -> Wear | None:
    """What takes note of where a mesh is outworn that is never remade; None where that is not known."""
    if not legs[-1].at.placement.meridian or legs[-1].at.carrying is not None:
        return None
    worn = wear(legs[-1])

    def note(u: np.ndarray, travel: float) -> bool:
        if travel < legs[-1].outworn and worn(u, travel):
            _kept(legs, travel)
        return False

    return note


def note_worn(legs: list[MeshLeg], points: Sequence[LoadPoint]) -> None:
    """Take note of it by the `points` alone, of a way that is followed elsewhere."""
    note = _noting(legs)
    for point in points:
        if note is not None:
            note(point.evaluation.u, point.travel)


def _changed(
    leg: MeshLeg, u: np.ndarray, here: float, counters: Counters, tight: bool = True
) -> tuple[MeshLeg, np.ndarray]:
    """The next leg and its displacement; the force is found on both meshes, of the old one as it is on the way unless
    `tight`.  Raises NoMesh and NotConverged."""
    at, control = leg.at, leg.at.settings.control
    if tight:
        old = load_steps.equilibrate(at.system, [u], at.start(here), here, control, counters)
    else:
        loosely = load_steps.find_equilibrium(at.system, u, at.start(here), control.loose, counters)
        old = LoadPoint(0.0, here, (load_steps.Stage(loosely, at.start(here)),))

    def on_mesh(size: float) -> tuple[InitialState, LoadPoint]:
        new, carried = renewed(at, old.stages[0].equilibrium.evaluation, size)
        return new, load_steps.equilibrate(new.system, [carried], new.start(here), here, control, counters)

    new, found = _first_of_sizes(on_mesh)
    before, after = (abs(float(p.force @ at.placement.direction)) for p in (old, found))
    watch = leg.watch if leg.watches is None else leg.watches(new)
    jump = abs(after - before) / max(before, 1e-300)
    u = found.stages[0].equilibrium.evaluation.u
    return MeshLeg(new, watch, here, jump, u, leg.watches), u


def _rescued(leg: MeshLeg, u: np.ndarray, here: float, counters: Counters) -> tuple[MeshLeg, np.ndarray]:
    """As `_changed` where a run has lost its equilibrium: its old mesh may have none but that of the way there."""
    try:
        return _changed(leg, u, here, counters)
    except (NoMesh, NotConverged) as error:
        if isinstance(error, NotConverged) and error.cause == "time_limit":
            raise
        return _changed(leg, u, here, counters, tight=False)


def _first_of_sizes(on_mesh: Callable[[float], T]) -> T:
    """What is found on the first of `TRIED_EDGE_FACTORS` whose mesh has an equilibrium; raises what the last does."""
    for size in TRIED_EDGE_FACTORS[:-1]:
        try:
            return on_mesh(size)
        except NoMesh:
            continue
        except NotConverged as error:
            if error.cause == "time_limit":
                raise
    return on_mesh(TRIED_EDGE_FACTORS[-1])


def follow_rezoned(
    legs: list[MeshLeg],
    way: Sequence[Instant],
    counters: Counters,
    u: np.ndarray,
    history: History | None,
    touching: float | None,
    jumps: JumpRecord | None = None,
    begin_at: float = 0.0,
) -> list[LoadPoint]:
    """As `history_steps.follow_history` from the first of the `legs`; every new mesh adds one.  Raises Stopped."""
    points: list[LoadPoint] = []
    control, since, begin = legs[0].at.settings.control, 0.0, None
    while True:
        at, known = legs[-1].at, len(legs) - 1
        left = [i for i in way if begin is None or i.time > begin.time]
        try:
            found = history_steps.follow_history(
                at.system, at.start, left, control, counters, u, history, touching, jumps, begin_at, begin,
                wear(legs[-1], since) if renewable(at) else _noting(legs),
            )  # fmt: skip
            return points + [replace(p, leg=known) for p in found]
        except Worn as worn:
            points += [replace(p, leg=known) for p in worn.points]
            try:
                begin, since, _ = _renewed_at(legs, worn.reached, counters)
                u = begin.u
            except NotConverged as error:
                raise load_steps.stopped_run(error, worn.travel, points, counters) from error
        except Stopped as stopped:
            stopped.points = points + [replace(p, leg=known) for p in stopped.points]
            raise


def renewals(legs: list[MeshLeg], counters: Counters) -> Renew | None:
    """What remakes the mesh on a way that is followed elsewhere, and takes note of it in `legs`; None where none may
    be made."""
    since, note = 0.0, None if renewable(legs[-1].at) else _noting(legs)
    if note is None and not renewable(legs[-1].at):
        return None

    def renew(here: Reached) -> Renewed | None:
        nonlocal since
        if not (note or wear(legs[-1], since))(here.u, here.travel):
            return None
        known = len(legs)
        new, since, ratio = _renewed_at(legs, here, counters)
        at = legs[-1].at
        return Renewed(at.system, at.start, new, ratio) if len(legs) > known else None

    return renew


def _renewed_at(legs: list[MeshLeg], here: Reached, counters: Counters) -> tuple[Reached, float, float]:
    """Where a path goes on, on a new mesh if one is made; the travel (mm) before which it is not looked at again, and
    the force there over that before.  Raises NotConverged where time is up."""
    try:
        new, reached, ratio = _carried(legs[-1], here, counters)
    except (NoMesh, NotConverged) as error:
        if isinstance(error, NotConverged) and error.cause == "time_limit":
            raise
        return here, _kept(legs, here.travel), 1.0
    legs.append(new)
    return reached, here.travel, ratio


def _carried(leg: MeshLeg, here: Reached, counters: Counters) -> tuple[MeshLeg, Reached, float]:
    """The next leg, what its path goes on from, and its force over that before.

    Histories are carried by `location.at_points`: stresses and overstresses at the quadrature points of the new mesh
    are those of the old one's cells, as linear functions; friction by `rubbing`.  Equilibrium is found again at once,
    in no time: nothing slips but what the new mesh lets slip.  Raises NoMesh and NotConverged.
    """
    return _first_of_sizes(lambda size: _carried_to(size, leg, here, counters))


def _carried_to(size: float, leg: MeshLeg, here: Reached, counters: Counters) -> tuple[MeshLeg, Reached, float]:
    at, goal = leg.at, Instant(here.time, here.travel, False)
    old = newton.evaluate_system(at.system, here.u, history_steps.loaded(at.system, at.start, here, goal))
    new, u = renewed(at, old, size)
    body, other = at.model.body, new.model.body
    X = location.quadrature_points(other.nodes[:, [0, 2]], other.cells, bodies.shape_functions(other))
    try:
        cell, xi = location.located(body.nodes[:, [0, 2]], body.cells, X.reshape(-1, 2))
    except location.Lost as error:
        raise NoMesh(str(error)) from error
    assert isinstance(body, MeridianBody)

    def field(values: np.ndarray) -> np.ndarray:
        return location.at_points(values, body.Q, cell, xi).reshape(*X.shape[:2], *values.shape[2:])

    history = here.history
    if history is not None:
        terms = np.array([field(h) for h in history.h]).reshape(len(history.h), *X.shape[:2], 6)
        history = History(field(history.S_iso), terms, field(history.W_max))
    rubbed = [rubbing(at, new, u, here, k) for k in range(len(at.system.pairs))]
    begun = replace(
        here, u=u, rate=np.zeros_like(u), history=history,
        before=tuple(b for b, _ in rubbed), pressures=[p for _, p in rubbed],
    )  # fmt: skip
    control, patient = at.settings.control, load_steps.MAX_ITERATIONS_AS_LAST_RESORT
    found, load, _ = history_steps.attempt(new.system, new.start, begun, goal, u, control, counters, patient)
    reached = history_steps.arrived(new.system, load, found, goal)
    way = at.placement.direction
    first, after = (abs(float(state.contact.force @ way)) for state in (old, found.evaluation))
    ratio = after / max(first, 1e-300)
    return MeshLeg(new, None, here.travel, abs(ratio - 1.0), reached.u), replace(reached, rate=begun.rate), ratio


def rubbing(
    at: InitialState, new: InitialState, u: np.ndarray, here: Reached, k: int
) -> tuple[tractions.Before, np.ndarray]:
    """How pair k touches at points of the new mesh with u (n, 3), and its pressures (f, q) MPa.

    Tractions and pressures are per undeformed area, so fields on the undeformed surface: linear between the nearest
    point of the old mesh there and the next on the other side.
    """
    old, pair, before = at.system.pairs[k], new.system.pairs[k], here.before[k]
    X = tractions.contact_points(old.surface, at.model.body.nodes).reshape(-1, 3)
    places = tractions.contact_points(pair.surface, new.model.body.nodes)
    near = cKDTree(X).query(places.reshape(-1, 3), min(N_CONTACT_NEIGHBOURS, len(X)))[1]
    way, off = X[near[:, 1:]] - X[near[:, :1]], places.reshape(-1, 1, 3) - X[near[:, :1]]
    shares = (off * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-300)
    rows, other = np.arange(len(near)), (shares > 0.0).argmax(1)
    a, b, share = near[:, 0], near[rows, 1 + other], np.clip(shares[rows, other], 0.0, 1.0)[:, None]

    def field(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(X), -1)
        return ((1.0 - share) * flat[a] + share * flat[b]).reshape(*places.shape[:2], *values.shape[2:])

    points = tractions.contact_points(pair.surface, new.model.body.nodes + u)
    touch = new.start(here.travel).touches[k]
    gap = pair.rigid.gap(points, before.centre, touch.direction)[0]
    return tractions.Before(points, before.centre, field(before.traction), gap), field(here.pressures[k])


def wear(leg: MeshLeg, since: float = 0.0) -> Wear:
    """The measure of a mesh: whether a state beyond a travel `since` (mm) has outworn it.

    An edge that the indenter may touch has grown to 2.2 times the length that is wanted where it is now (3.3 times of
    the first mesh below a smooth indenter) and was not so long when the mesh was made; or the corners of a cell,
    well shaped in the undeformed body, have turned over.  Elements of length ℓ miss a force by about ℓ^2.5.
    """
    at, since = leg.at, max(since, watched_from(leg.at.settings))
    body, facets = at.model.body, at.system.pressing.surface.facets
    begun = at.seated if leg.u is None else leg.u
    longer = MAX_FIRST_EDGE_RATIO if leg.u is None and _smooth(at) else MAX_LATER_EDGE_RATIO
    limit = longer * np.maximum(_lengths(at, facets, body.nodes + begun), 1.0)
    upright = quality(body.nodes[:, [0, 2]][body.cells[:, :3]]) > 0.0

    def worn(u: np.ndarray, travel: float) -> bool:
        x = body.nodes + u
        if travel <= since:
            return False
        if (_lengths(at, facets, x) > limit).any():
            return True
        return bool((quality(x[:, [0, 2]][body.cells[:, :3]])[upright] <= 0.0).any())

    return worn


def _smooth(at: InitialState) -> bool:
    return bool(np.isinf(at.settings.indenter.finest[1]))


def _lengths(at: InitialState, edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Lengths (f,) of edges over what is wanted where they are."""
    ends = x[edges[:, :2]]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / _wanted(at, x[edges[:, 2]][:, [0, 2]])


def _wanted(at: InitialState, x: np.ndarray) -> np.ndarray:
    """Wanted edge length (k,) mm on the surface at places now (k, 2)."""
    return at.settings.fineness * contact_elements.spacing(at.settings)(np.maximum(x[:, 0], 0.0))


def renewed(at: InitialState, state: Evaluation, size: float = 1.0) -> tuple[InitialState, np.ndarray]:
    """The experiment on a new mesh, its edges `size` times as long as usual, and the displacement (n, 3) carried over
    to it; raises NoMesh."""
    body = at.model.body
    section = _section(at, state.u)
    finer = size * (NEW_EDGE_RATIO if _smooth(at) else NEW_EDGE_RATIO_BELOW_EDGES)
    new = rezoned(section, _near(at, section, state), lambda x: finer * _wanted(at, x), NEW_EDGE_GROWTH)
    try:
        model = modelling.remeshed_model(at.settings, at.knobs, at.placement, new)
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
    return np.hypot(middle[:, 0], beside) < REZONED_RADIUS_RATIO * radius
