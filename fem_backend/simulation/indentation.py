"""The whole story on one page: an indentation test from its knobs, settings and programme to curves."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fem_backend.laws import admissible
from fem_backend.materials import stress
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.derivatives import Slopes
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.initial_state import InitialState, initial_state
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import FORCES, channels, reaction, softness, units, whole
from fem_backend.simulation.schedule import each, merged, one, steps, together
from fem_backend.solver import history_steps, load_steps, rigid_motions
from fem_backend.solver.load_steps import Guess, Instant, LoadPoint, Stopped, Watch
from fem_backend.solver.newton import Counters, System

FINAL = ("time_limit", "inadmissible")  # ends of a run that no other path avoids
SHORTER = 0.6  # of the steps, where a run is tried again


@dataclass(frozen=True)
class Result:
    """Channels at the asked instants, each (k,), in the units of UNITS; forces of the whole specimen on the indenter.

    `uz_max` is how far the deepest point went down since contact, `bulge` how far the highest went up (the material
    rises around the ball, the more the less compressible it is); `peak_pressure` is that of the pressure less the
    attraction, as a probe would feel it; `slipping` is the share of the contact area that slips; `reaction` (k, 3) N is
    the support's, `contact_error` (k,) N what the last augmentation or `softness` changed, `residual` (k,) the share of
    the outer forces that is out of balance; `gradients[knob][channel]` (k,); `system` is what was solved;
    `coarser` are the channels of the same run on a coarser mesh, where that was made, `finer` how many times as many
    nodes this one has.
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
    finer: float = 4.0

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
        )

    @property
    def Fz(self) -> np.ndarray:
        """Vertical force (k,) N."""
        return self.channels["Fz"]


def solve(
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
    want of an equilibrium it is tried once more from the start in shorter steps, without a guess: what is found must
    not hang on which travels are asked for.  The deeper of the two counts.
    """
    started = time.process_time()
    deadline = started + settings.control.time_limit_s
    try:
        return _attempt(settings, knobs, placement, model, instants, guess, gradients, started, deadline)
    except Stopped as stopped:
        if stopped.cause in FINAL:
            raise
        first = stopped
    control = settings.control
    shorter = {n: SHORTER * getattr(control, n) for n in ("first", "largest", "path")}
    patient = replace(settings, control=replace(control, **shorter))
    try:
        return _attempt(patient, knobs, placement, model, instants, None, gradients, started, deadline)
    except Stopped as stopped:
        raise (stopped if len(stopped.points) > len(first.points) else first) from None


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
    slopes = None if at.path_dependent else Slopes(at, gradients)
    try:
        points = along(at, instants, counters) if slopes is None else elastic(at, instants, counters, guess, slopes)
    except Stopped as stopped:
        stopped.reached = collect(at, stopped.points, counters, time.process_time() - started)
        raise
    return collect(at, points, counters, time.process_time() - started, slopes)


def unstable(result: Result) -> tuple[int, str] | None:
    """The first point where the law is not admissible over the stretches reached, and why; None where there is none.

    A body may find an equilibrium with a law whose stress falls with strain at some of its points: no answer to trust.
    """
    if result.system is None or not result.points:
        return None
    law, points = result.system.material.law, result.points
    if law.unconditional:
        return None

    def lost(point: LoadPoint) -> str | None:
        F = point.evaluation.H.reshape(-1, 3, 3) + np.eye(3)
        squares = np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)
        reached = float(np.sqrt(max(squares[:, 2].max(), 1.0 / squares[:, 0].min())))
        why = admissible(law, reached)
        return why and f"{why}, {reached:.3g} is reached at {point.travel:.4g} mm"

    if lost(max(points, key=lambda p: p.travel)) is None:
        return None
    return next(((k, why) for k, p in enumerate(points) if (why := lost(p))), None)


def along(at: InitialState, instants: Sequence[Instant], counters: Counters) -> list[LoadPoint]:
    """Points of a body for which the way counts: the programme is followed step by step."""
    control, u = at.settings.control, at.seated
    history = _earlier(at, counters)
    touching = None
    if at.system.loose and at.system.dead is None:
        if rigid_motions.rolls(at.system) and any(pair.friction for pair in at.system.seat):
            touching = 0.02 * at.placement.indenter.length
        else:
            u = load_steps.seat(
                history_steps.smooth(at.system), at.start(0.02 * at.placement.indenter.length), u, control, counters
            )
    groups = together(instants)
    way = steps([one(group) for group in groups], control.path, at.system.material.prony is not None)
    try:
        points = history_steps.follow(at.system, at.start, way, control, counters, u, history, touching)
    except Stopped as stopped:
        stopped.points = each(groups, stopped.points)
        raise
    return each(groups, points)


def elastic(
    at: InitialState,
    instants: Sequence[Instant],
    counters: Counters,
    guess: Guess | None = None,
    watch: Watch | None = None,
) -> list[LoadPoint]:
    """Points of a body that returns on its loading curve: each asked travel is solved once, every stage is watched."""
    computed = merged([i.travel for i in instants if i.asked])
    asked = list(dict.fromkeys(computed.values()))
    at = replace(at, system=modelling.condensing(at.system, at.model, at.start(0.0), at.start(asked[-1])))
    control, u = at.settings.control, at.seated
    if at.system.loose and at.system.dead is None:
        u = load_steps.seat(at.system, at.start(0.02 * at.placement.indenter.length), u, control, counters)
    try:
        found = load_steps.travel(at.system, at.start, asked, control, counters, u, guess, watch)
    except Stopped as stopped:
        reached = {p.travel: p for p in stopped.points}
        stopped.points = []
        for i in instants:  # a programme ends at its first instant without equilibrium
            if i.asked and computed[i.travel] not in reached:
                break
            if i.asked:
                stopped.points.append(replace(reached[computed[i.travel]], time=i.time, travel=i.travel))
        raise
    by_travel = {p.travel: p for p in found}
    return [replace(by_travel[computed[i.travel]], time=i.time, travel=i.travel) for i in instants if i.asked]


def _earlier(at: InitialState, counters: Counters) -> stress.History | None:
    """History of the material before the test: virgin, or softened by an earlier travel at this place."""
    body = at.model.body
    virgin = stress.virgin(at.system.material, *body.w.shape)
    if virgin is None or at.settings.earlier == 0.0 or at.system.material.mullins is None:
        return virgin
    first = replace(at.system.material, prony=None)
    system = replace(history_steps.smooth(at.system), material=first)
    deepest = at.settings.earlier
    ramp = steps([Instant(deepest, deepest, True)], at.settings.control.path)
    start = stress.virgin(first, *body.w.shape)
    point = history_steps.follow(system, at.start, ramp, at.settings.control, counters, at.seated, start)[-1]
    history = point.evaluation.history
    assert history is not None  # of a body that is followed
    return replace(virgin, W_max=history.W_max)


def collect(
    at: InitialState, points: Sequence[LoadPoint], counters: Counters, cpu_s: float, slopes: Slopes | None = None
) -> Result:
    """Result from the points reached."""
    soft = np.ones(len(points)) if at.settings.multipliers or not points else 1.0 + softness(at, points)
    rows = [channels(at, at.system, p.evaluation, p.load, k) for p, k in zip(points, soft, strict=True)]
    out = {"time": np.array([p.time for p in points]), "travel": np.array([p.travel for p in points])}
    out |= {name: np.array([r[name] for r in rows]) for name in units(at.settings) if name not in out}
    change = [
        np.linalg.norm(whole(at.placement, p.force - p.previous_force + (k - 1.0) * p.force))
        for p, k in zip(points, soft, strict=True)
    ]
    gradients = slopes.at_travels(out["travel"]) if slopes is not None else {}
    gradients = {k: {n: v * soft if n in FORCES else v for n, v in rows.items()} for k, rows in gradients.items()}
    notes = {"sag_mm": at.lag, "derivatives_cpu_s": slopes.cpu_s if slopes is not None else 0.0}
    if at.system.loose and points:
        carried = [np.abs((at.system.grounded[:, None] * p.evaluation.u).sum(0)).max() for p in points]
        forces = [float(np.linalg.norm(p.force)) for p in points]
        notes["spring_share"] = float(max(c / max(c + f, 1e-300) for c, f in zip(carried, forces, strict=True)))
    reactions = np.array([k * reaction(at, p.evaluation) for p, k in zip(points, soft, strict=True)]).reshape(-1, 3)
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
    )
