"""The whole story on one page: an indentation test from its knobs, settings and programme to curves."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fem_backend import closed_forms
from fem_backend.contact import self_contact
from fem_backend.laws import admissible
from fem_backend.materials import regions, stress
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import rezoning
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.derivatives import Slopes
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.initial_state import InitialState, initial_state
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import FORCES, channels, reaction, softness, units, whole
from fem_backend.simulation.pore_flow import pores_of
from fem_backend.simulation.rezoning import MeshLeg
from fem_backend.simulation.schedule import each, flowing, instants_with_steps, merged, merged_instants, one_instant
from fem_backend.solver import biphasic, history_steps, load_steps, rigid_motions
from fem_backend.solver.jumps import JumpRecord
from fem_backend.solver.load_steps import Guess, Instant, LoadPoint, Stopped, Watch
from fem_backend.solver.newton import Counters, System

FINAL_CAUSES = ("time_limit", "inadmissible")  # ends of a run that no other path avoids
JUMP_LENGTH_TOLERANCE = 2e-3  # of the length by which a ball is drawn up: where a jump is found
SECOND_ATTEMPT_STEP_RATIO = 0.6  # of the steps, where a run is tried again


@dataclass(frozen=True)
class Result:
    """Channels at the asked instants, each (k,), in the units of UNITS; forces of the whole specimen on the indenter.

    `uz_max` is how far the deepest point went down since contact, `bulge` how far the highest went up (the material
    rises around the ball, the more the less compressible it is); `peak_pressure` is that of the pressure less the
    attraction, as a probe would feel it; `slipping` is the share of the contact area that slips; `reaction` (k, 3) N is
    the support's, `contact_error` (k,) N what the last augmentation or `softness` changed, `residual` (k,) the share of
    the outer forces that is out of balance; `gradients[knob][channel]` (k,); `system` is what was solved;
    `coarser` are the channels of the same run on a coarser mesh, where that was made, `unchecked` says how errors are
    found where that ended early, `finer` how many times as many nodes this one has; `on` says with what each point was
    solved, `legs` at which travels (mm) the mesh was remade, and the share that the force changed by.
    `outworn` (k,) mm says from which travel on the mesh of each point was outworn and kept; ∞ without.
    `given` (k,) says at which instants the force was given and the travel found, `slopes` (k,) N/mm are dF/ds, `left`
    the share of the force that is not met there; None without any.
    """

    channels: Mapping[str, np.ndarray]
    reaction: np.ndarray
    contact_error: np.ndarray
    residual: np.ndarray
    counters: Counters
    cpu_s: float
    points: tuple[LoadPoint, ...] = field(default=(), repr=False)
    gradients: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    notes: Mapping[str, float] = field(default_factory=dict)
    system: System | None = field(default=None, repr=False)
    coarser: Mapping[str, np.ndarray] | None = None
    unchecked: str = ""
    finer: float = 4.0
    on: tuple[InitialState, ...] = field(default=(), repr=False)
    legs: tuple[tuple[float, float], ...] = ()
    outworn: np.ndarray | None = None
    given: np.ndarray | None = None
    slopes: np.ndarray | None = None
    left: np.ndarray | None = None

    @property
    def travel(self) -> np.ndarray:
        """Travel (k,) mm."""
        return self.channels["travel"]

    def upto(self, k: int) -> Result:
        """The first k instants."""
        rows = {knob: {n: v[:k] for n, v in row.items()} for knob, row in self.gradients.items()}
        return replace(
            self,
            channels={n: v[:k] for n, v in self.channels.items()},
            reaction=self.reaction[:k],
            gradients=rows,
            coarser=None if self.coarser is None else {n: v[:k] for n, v in self.coarser.items()},
            contact_error=self.contact_error[:k],
            residual=self.residual[:k],
            points=self.points[:k],
            on=self.on[:k],
            outworn=None if self.outworn is None else self.outworn[:k],
            given=None if self.given is None else self.given[:k],
            slopes=None if self.slopes is None else self.slopes[:k],
            left=None if self.left is None else self.left[:k],
        )

    @property
    def Fz(self) -> np.ndarray:
        """Vertical force (k,) N."""
        return self.channels["Fz"]


def simulate_indentation(
    settings: Settings,
    knobs: Knobs,
    placement: Placement,
    model: AssembledModel,
    instants: Sequence[Instant],
    guess: Guess | None = None,
    gradients: Sequence[str] = (),
) -> Result:
    """Curves at the asked instants of a programme; raises Stopped with the result so far, and model.NotModelled.

    `guess(s)` may offer states to start from at travel s; `gradients` names material knobs.  Where it ends early for
    want of an equilibrium it is tried once more from the start, as `again` says, without a guess: what is found must
    not depend on which travels are asked for.  The deeper of the two counts.
    """
    started = time.process_time()
    deadline = started + settings.control.time_limit_s
    try:
        return _attempt(settings, knobs, placement, model, instants, guess, gradients, started, deadline)
    except Stopped as stopped:
        if stopped.cause in FINAL_CAUSES:
            raise
        first = stopped
    patient = again(settings, first.reached)
    try:
        return _attempt(patient, knobs, placement, model, instants, None, gradients, started, deadline)
    except Stopped as stopped:
        raise (stopped if len(stopped.points) > len(first.points) else first) from None


def again(settings: Settings, reached: Result | None) -> Settings:
    """The settings of a second attempt after what was `reached`: shorter steps, or with friction no new meshes.

    During unloading what sticks and what slips is not always found on a new mesh.
    """
    if reached is not None and reached.legs and reached.system is not None:
        if any(pair.friction for pair in reached.system.pairs):
            return replace(settings, remesh="never")
    control = settings.control
    shorter = {n: SECOND_ATTEMPT_STEP_RATIO * getattr(control, n) for n in ("first", "largest", "path")}
    return replace(settings, control=replace(control, **shorter))


def _attempt(
    settings: Settings,
    knobs: Knobs,
    placement: Placement,
    model: AssembledModel,
    instants: Sequence[Instant],
    guess: Guess | None,
    gradients: Sequence[str],
    started: float,
    deadline: float,
) -> Result:
    """Curves by one path; raises Stopped with the result so far."""
    counters = Counters(deadline=deadline)
    at = initial_state(settings, knobs, placement, model, counters)
    above = any(i.asked and i.travel <= 0.0 for i in instants)  # where nothing touches, nothing is differentiated
    slopes, jumps = None if at.path_dependent else Slopes(at, () if above else gradients), jumps_of(at)
    legs: list[MeshLeg] = []
    try:
        if slopes is None:
            points = path_points(at, instants, counters, legs, jumps)
        else:
            points = elastic(at, instants, counters, guess, slopes, legs)
    except Stopped as stopped:
        stopped.reached = collect(at, stopped.points, counters, time.process_time() - started, None, legs, jumps)
        raise
    return collect(at, points, counters, time.process_time() - started, slopes, legs, jumps)


def unstable(result: Result) -> tuple[int, str] | None:
    """The first point where the law is not admissible over the stretches reached, and why; None where there is none.

    A body may find an equilibrium with a law whose stress falls with strain at some of its points: no answer to trust.
    """
    if result.system is None or not result.points:
        return None
    parts, points = regions.region_materials(result.system.material), result.points
    if all(material.law.unconditional for material, _ in parts):
        return None

    def lost(point: LoadPoint) -> str | None:
        for material, cells in parts:
            F = point.evaluation.H[cells].reshape(-1, 3, 3) + np.eye(3)
            squares = np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)
            reached = float(np.sqrt(max(squares[:, 2].max(), 1.0 / squares[:, 0].min())))
            why = None if material.law.unconditional else admissible(material.law, reached)
            if why:
                return f"{why}, {reached:.3g} is reached at {point.travel:.4g} mm"
        return None

    if lost(max(points, key=lambda p: p.travel)) is None:
        return None
    return next(((k, why) for k, p in enumerate(points) if (why := lost(p))), None)


def jumps_of(at: InitialState) -> JumpRecord | None:
    """What counts as a jump of a body that is attracted; None of another.

    Pull and length of JKR's fold for the indenter's effective radius R, 2πwR and (w²R/E*²)^(1/3), E* = 4μ.
    """
    attracting = at.system.pressing.adhesion
    if attracting is None:
        return None
    R = at.placement.indenter.effective_radius(0.0)
    stiff = 4.0 * at.system.material.shear_modulus
    pull = 2.0 * np.pi * attracting.work * R / modelling.multiplicity(at.placement)
    length = (attracting.work**2 * R / stiff**2) ** (1.0 / 3.0)
    return JumpRecord(pull, length, JUMP_LENGTH_TOLERANCE * length)


def _begin_at(instants: Sequence[Instant]) -> float:
    """Travel (mm) at which a programme begins: 0, or that of an instant at the time 0."""
    return instants[0].travel if instants and instants[0].time == 0.0 else 0.0


def folded(result: Result) -> tuple[int, str] | None:
    """The first point at which the surface of a meridian has met itself, and why that is no answer; None without one.

    The wall of a crater may close over an indenter, or fold: its contact with itself is not modelled.
    """
    for k, (point, on) in enumerate(zip(result.points, result.on, strict=False)):
        x = on.model.body.nodes + point.evaluation.u
        if on.placement.meridian and self_contact.met_itself(x, on.model.facets):
            return k, f"the surface meets itself at or before {point.travel:.4g} mm: that contact is not modelled"
    return None


def doubtful(result: Result) -> tuple[int, str, str] | None:
    """The first point from which on a result is no answer, the class of its cause, and why; None where all are."""
    found = [(*end, cause) for end, cause in ((unstable(result), "inadmissible"), (folded(result), "contact")) if end]
    if not found:
        return None
    k, why, cause = min(found)
    return k, cause, why


def path_points(
    at: InitialState,
    instants: Sequence[Instant],
    counters: Counters,
    legs: list[MeshLeg] | None = None,
    jumps: JumpRecord | None = None,
) -> list[LoadPoint]:
    """Points of a body for which the way counts: the programme is followed step by step.

    `legs` takes up the meshes, `jumps` what an attracted body does at once.
    """
    u, history, touching = begun(at, counters)
    control = at.settings.control
    groups, begin_at = merged_instants(instants), _begin_at(instants)
    legs = [] if legs is None else legs
    legs.append(MeshLeg(at, None))
    if at.knobs.permeability:
        points = _draining(at, groups, counters, history)
        rezoning.note_worn(legs, points)
        return points
    way = instants_with_steps(
        [one_instant(group) for group in groups], control.path, at.system.material.prony is not None, begin_at
    )
    try:
        points = rezoning.follow_rezoned(legs, way, counters, u, history, touching, jumps, begin_at)
    except Stopped as stopped:
        stopped.points = each(groups, stopped.points)
        raise
    return each(groups, points)


def _draining(
    at: InitialState, groups: Sequence[Sequence[Instant]], counters: Counters, history: stress.History | None
) -> list[LoadPoint]:
    """Points of a body with liquid in its pores, at rest and without pore pressure before the test."""
    settings, system = at.settings, at.system
    way = flowing([one_instant(group) for group in groups], settings.control.path, settings.fineness)
    try:
        points = biphasic.follow_coupled(
            system, pores_of(at), at.start, way, settings.control, counters, at.seated, history
        )
    except Stopped as stopped:
        stopped.points = each(groups, stopped.points)
        raise
    return each(groups, points)


def begun(at: InitialState, counters: Counters) -> tuple[np.ndarray, stress.History | None, float | None]:
    """Displacement (n, 3) and history from which a programme is followed, and the travel (mm) at which a body that may
    turn is sought at rest, None of another."""
    u, history, first = at.seated, _earlier(at, counters), 0.02 * at.placement.indenter.length
    if not at.system.loose or at.system.dead is not None:
        return u, history, None
    if rigid_motions.rolls(at.system) and any(pair.friction for pair in at.system.seat):
        return u, history, first
    smooth = history_steps.smooth(at.system)
    return load_steps.seat(smooth, at.start(first), u, at.settings.control, counters), history, None


def elastic(
    at: InitialState,
    instants: Sequence[Instant],
    counters: Counters,
    guess: Guess | None = None,
    watch: Watch | None = None,
    legs: list[MeshLeg] | None = None,
) -> list[LoadPoint]:
    """Points of a body that returns on its loading curve: each asked travel is solved once, every stage is watched.

    `legs` takes up the meshes on the way.
    """
    above = sorted({i.travel for i in instants if i.asked and i.travel <= 0.0}, reverse=True)
    computed = merged([i.travel for i in instants if i.asked and i.travel > 0.0])
    asked = list(dict.fromkeys(computed.values()))
    drawn = _above(at, above, counters) if above else []
    computed |= {s: s for s in above}
    if asked:
        at = replace(at, system=modelling.condensing(at.system, at.model, at.start(0.0), at.start(asked[-1])))
    control, u = at.settings.control, at.seated
    if at.system.loose and at.system.dead is None:
        u = load_steps.seat(at.system, at.start(0.02 * at.placement.indenter.length), u, control, counters)
    try:
        legs = [] if legs is None else legs
        legs.append(MeshLeg(at, watch, watches=watch.on if isinstance(watch, Slopes) else None))
        found = rezoning.follow_travel_rezoned(legs, asked, counters, u, guess)
    except Stopped as stopped:
        reached = {p.travel: p for p in [*stopped.points, *drawn]}
        stopped.points = []
        for i in instants:  # a programme ends at its first instant without equilibrium
            if i.asked and computed[i.travel] not in reached:
                break
            if i.asked:
                stopped.points.append(replace(reached[computed[i.travel]], time=i.time, travel=i.travel))
        raise
    by_travel = {p.travel: p for p in [*found, *drawn]}
    return [replace(by_travel[computed[i.travel]], time=i.time, travel=i.travel) for i in instants if i.asked]


def _above(at: InitialState, travels: Sequence[float], counters: Counters) -> list[LoadPoint]:
    """Points of an elastic body at travels (mm, falling from 0) at which the indenter is above it."""
    way = instants_with_steps([Instant(float(k + 1), s, True) for k, s in enumerate(travels)], at.settings.control.path)
    return history_steps.follow_history(at.system, at.start, way, at.settings.control, counters, at.seated)


def _earlier(at: InitialState, counters: Counters) -> stress.History | None:
    """History of the material before the test: virgin, or softened by an earlier travel at this place."""
    body = at.model.body
    virgin = stress.virgin(at.system.material, *body.w.shape)
    if virgin is None or at.settings.earlier == 0.0 or at.system.material.mullins is None:
        return virgin
    first = regions.without(at.system.material, "prony")
    system = replace(history_steps.smooth(at.system), material=first)
    deepest = at.settings.earlier
    ramp = instants_with_steps([Instant(deepest, deepest, True)], at.settings.control.path)
    start = stress.virgin(first, *body.w.shape)
    point = history_steps.follow_history(system, at.start, ramp, at.settings.control, counters, at.seated, start)[-1]
    history = point.evaluation.history
    assert history is not None  # of a body that is followed
    return replace(virgin, W_max=history.W_max)


def of_jumps(at: InitialState, jumps: JumpRecord) -> dict[str, float]:
    """Notes of a body that is attracted: Tabor's parameter, its jumps, and the strongest pull on the way.

    Forces (N) are along the way of the indenter and those of the whole specimen; energies N mm.
    """
    attracting, many = at.system.pressing.adhesion, modelling.multiplicity(at.placement)
    assert attracting is not None
    R, stuff = at.placement.indenter.effective_radius(0.0), at.system.material
    stiff = closed_forms.plane_modulus(
        closed_forms.youngs_modulus(stuff.shear_modulus, stuff.bulk_modulus),
        closed_forms.poisson_ratio(stuff.shear_modulus, stuff.bulk_modulus),
    )
    out = {"tabor": closed_forms.tabor(R, attracting.work, stiff, attracting.range)}
    for name, mine in (
        ("jump_in", [j for j in jumps.found if j.pulled_in]),
        ("jump_off", [j for j in jumps.found if not j.pulled_in]),
    ):
        for j in mine[-1:]:
            out |= {f"{name}_mm": j.travel, f"{name}_s": j.time, f"{name}_released": many * j.released}
            out |= {f"{name}_before_N": many * j.before, f"{name}_after_N": many * j.after}
    force, travel = jumps.strongest
    return out | {"pull_off_N": many * force, "pull_off_mm": travel}


def collect(
    at: InitialState,
    points: Sequence[LoadPoint],
    counters: Counters,
    cpu_s: float,
    slopes: Slopes | None = None,
    legs: Sequence[MeshLeg] = (),
    jumps: JumpRecord | None = None,
) -> Result:
    """Result from the points reached, each on the mesh of its leg."""
    on = [legs[p.leg].at if legs else at for p in points]
    soft = np.ones(len(points)) if at.settings.multipliers or not points else 1.0 + softness(at, points)
    rows = [channels(a, a.system, p.evaluation, p.load, k) for a, p, k in zip(on, points, soft, strict=True)]
    out = {"time": np.array([p.time for p in points]), "travel": np.array([p.travel for p in points])}
    out |= {name: np.array([r[name] for r in rows]) for name in units(at.settings) if name not in out}
    change = [
        np.linalg.norm(whole(at.placement, p.force - p.previous_force + (k - 1.0) * p.force))
        for p, k in zip(points, soft, strict=True)
    ]
    gradients = slopes.at_travels(out["travel"]) if slopes is not None else {}
    gradients = {k: {n: v * soft if n in FORCES else v for n, v in rows.items()} for k, rows in gradients.items()}
    notes = {"sag_mm": at.lag, "derivatives_cpu_s": slopes.cpu_s if slopes is not None else 0.0}
    notes |= {} if jumps is None else of_jumps(at, jumps)
    if len(legs) > 1:
        notes |= {"meshes": float(len(legs)), "largest_jump": max(leg.jump for leg in legs)}
    outworn = np.array([legs[p.leg].outworn if legs else np.inf for p in points])
    if (outworn < np.inf).any():
        notes["outworn_mm"] = float(outworn.min())
    if at.system.loose and points:
        carried = [
            np.abs((a.system.grounded[:, None] * p.evaluation.u).sum(0)).max() for a, p in zip(on, points, strict=True)
        ]
        forces = [float(np.linalg.norm(p.force)) for p in points]
        notes["spring_share"] = float(max(c / max(c + f, 1e-300) for c, f in zip(carried, forces, strict=True)))
    reactions = np.array([k * reaction(a, p.evaluation) for a, p, k in zip(on, points, soft, strict=True)])
    reactions = reactions.reshape(-1, 3)
    return Result(
        out,
        reactions,
        np.array(change),
        np.array([p.residual for p in points]),
        counters,
        cpu_s,
        tuple(points),
        gradients,
        notes,
        at.system,
        on=tuple(on),
        legs=tuple((leg.began, leg.jump) for leg in legs[1:]),
        outworn=outworn,
    )
