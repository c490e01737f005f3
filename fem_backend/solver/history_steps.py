"""A programme followed step by step, for bodies whose answer depends on the way: friction, relaxation, softening."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem_backend.contact import tractions
from fem_backend.contact.tractions import Before, Pair
from fem_backend.materials.stress import History
from fem_backend.solver import jumps as sudden
from fem_backend.solver import load_steps, rigid_motions
from fem_backend.solver.jumps import JumpRecord, OnBranch
from fem_backend.solver.load_steps import Control, Instant, LoadPoint, Start, Stopped, Wear, Worn
from fem_backend.solver.newton import Counters, Equilibrium, Load, NotConverged, System

MAX_FRICTION_PASSES = 8  # of friction limited by the pressure of the pass before, at most
FRICTION_LIMIT_TOLERANCE = 0.05  # of the force: limits that are near enough
# times the friction that a pressure allows
FRICTION_RELEASE_FACTORS = (1.0, 30.0, 15.0, 8.0, 5.0, 3.5, 2.5, 1.8, 1.4, 1.2, 1.0)
LIGHT_CONTACT_ROUND_OFF_RESIDUAL = 1e-5  # relative residual that round-off may leave of a body so hardly touched
ATTRACTION_RANGE_FACTORS = (16.0, 8.0, 4.0, 2.0)  # times the range of an attraction, from which a body is drawn in
STICKING_PRESSURE_RATIO = 1e6  # times the shear modulus: a pressure whose friction holds everything


@dataclass(frozen=True)
class Reached:
    """What a path goes on from: time (s), travel (mm), displacement and its rate per travel (n, 3), material history.

    `before` is how each pair touched at the end of the step, `pressures` (MPa) are its pressures; `branch` is where an
    attracted body is on its branch of equilibria, None before the first.
    """

    time: float
    travel: float
    u: np.ndarray
    rate: np.ndarray
    history: History | None
    before: tuple[Before, ...]
    pressures: list[np.ndarray]
    branch: OnBranch | None = None


@dataclass(frozen=True)
class Gait:
    """How a path steps: numerical settings, iterations of Newton at most, share of what is left to an instant, and the
    longest step (mm) that is likely to succeed."""

    control: Control
    limit: int = load_steps.MAX_ITERATIONS_ON_THE_WAY
    share: float = 1.0
    longest: float = np.inf

    def within(self, left: float) -> Gait:
        """Of what is left to an instant (mm), no more than the longest step."""
        return replace(self, share=min(self.share, self.longest / max(left, 1e-300)))

    def shorter(self, ds: float) -> Gait:
        """After a step of `ds` mm that failed."""
        return replace(self, share=0.5 * self.share, longest=0.5 * ds or self.longest)

    def longer(self, ds: float) -> Gait:
        """After a step of `ds` mm that succeeded."""
        return replace(self, share=1.0, longest=1.5 * max(self.longest, ds))


def follow_history(
    system: System,
    start: Start,
    instants: Sequence[Instant],
    control: Control,
    counters: Counters,
    u: np.ndarray,
    history: History | None = None,
    touching: float | None = None,
    jumps: JumpRecord | None = None,
    begin_at: float = 0.0,
    going_on: Reached | None = None,
    worn: Wear | None = None,
) -> list[LoadPoint]:
    """Equilibria at the asked instants where the way matters: friction, viscoelasticity, softening.

    Between asked instants the penalty alone keeps the bodies apart (kept multipliers would let the pressures of the
    many contact points drift apart).  At an asked instant the multipliers are a side branch: the path goes on from the
    state without them.  A step without equilibrium is halved.  Raises Stopped with what was reached.

    Friction counts from rest: the first step of a body that may turn begins with everything stuck that touches, at a
    travel `touching` (mm) where that has to be sought.  Let slip before, it would lie against a wall of its support;
    so it does where even that does not hold it.

    The path begins at the travel `begin_at` (mm).  Of an attracted body `jumps` collects what it does at once.
    It may go on from a state that was reached, `going_on`, and raises Worn at one that is `worn`.
    """
    here, first = begin_path(system, start, control, counters, u, history, touching, begin_at)
    rest, points = here.u, list[LoadPoint]()
    if jumps is not None:
        here = _attracted(system, start(begin_at), here, jumps, control, counters)
    gait = Gait(control)
    here = here if going_on is None else going_on
    for instant in instants:
        gait, began = replace(gait, share=1.0), here.time
        while here.time < instant.time:
            if worn is not None and worn(here.u, here.travel):
                raise Worn(points, here.u, here.travel, here)
            gait = gait.within(abs(instant.travel - here.travel))
            goal = instant if gait.share >= 0.9 else _between(here, instant, gait.share)
            guess = load_steps.predicted_displacement(system, here.u, (goal.travel - here.travel) * here.rate)
            guess = guess if first is None or here.time > 0.0 else first
            ds, worked = abs(goal.travel - here.travel), counters.iterations
            try:
                if jumps is not None and here.branch is None:
                    guess = _drawn_in(system, loaded(system, start, here, goal), guess, gait.control, counters)
                found, load, point = attempt(system, start, here, goal, guess, gait.control, counters, gait.limit)
            except NotConverged as error:
                counters.cutbacks += 1
                gait = gait.shorter(ds)
                lost = _lost(system, gait, here, instant, began, ds, jumps)
                if not lost and error.cause != "time_limit":
                    here = here if gait.share >= 0.3 else replace(here, rate=np.zeros_like(here.rate))
                    continue
                if not _lets_go(jumps, here, error):
                    gait = _insisting(system, gait, here, goal, error, points, counters)
                    continue
                found, load, point = _beyond(
                    system, start, rest, here, goal, gait.control, counters, jumps, points, error
                )
            now = None if jumps is None else sudden.on_branch(system, found, load, goal.travel).after(here.branch)
            jumped = jumps is not None and now is not None and sudden.is_unexplained(jumps, here.branch, now)
            if jumps is not None and now is not None and jumped:
                if ds > jumps.shortest:
                    counters.cutbacks += 1
                    gait = replace(gait, share=0.5 * gait.share, longest=0.5 * ds)
                    continue
                assert here.branch is not None
                jumps.found.append(sudden.jump(here.time, here.branch, now))
            counters.steps += 1
            load_steps.proper(system, found, here.travel, goal.travel, points, counters)
            points += [] if point is None else [light(point)]
            gait = gait.longer(ds)
            if jumps is not None and now is not None:
                jumps.passed(now)
                each = (counters.iterations - worked) / (1 + gait.control.augmentations * goal.asked)
                ahead = min(sudden.longest_step(jumps, here.branch, now), sudden.longer(each) * ds or np.inf)
                gait = replace(gait, longest=np.inf if jumped else min(gait.longest, ahead))
            here = replace(arrived(system, load, found, goal), branch=now)
    return points


def _lost(
    system: System, gait: Gait, here: Reached, instant: Instant, began: float, ds: float, jumps: JumpRecord | None
) -> bool:
    """Whether a step of `ds` mm that failed is not to be halved any more: an eighth of the way to an instant of a loose
    body, a 64th of another; of an attracted one that moves, what is as short as a jump."""
    if jumps is not None and ds > 0.0:
        return ds <= jumps.shortest
    least = 1 / 8 if system.loose else 1 / 64
    return gait.share * (instant.time - here.time) < least * (instant.time - began)


def _insisting(
    system: System,
    gait: Gait,
    here: Reached,
    goal: Instant,
    error: NotConverged,
    points: list[LoadPoint],
    counters: Counters,
) -> Gait:
    """How a step is tried that no shorter one helps: as tight as round-off lets it be, or with patience.

    Raises Stopped where neither applies.

    What is left of a residual is counted in the stated errors (`LoadPoint.residual`); the way goes on from there.
    """
    rough = rougher_control(gait.control, error) if goal.asked else None
    if rough is None and not load_steps.may_go_on(system, gait.limit, error):
        raise load_steps.stopped_run(error, here.travel, points, counters) from error
    return Gait(rough or gait.control, load_steps.MAX_ITERATIONS_AS_LAST_RESORT)


def _beyond(
    system: System,
    start: Start,
    rest: np.ndarray,
    here: Reached,
    goal: Instant,
    control: Control,
    counters: Counters,
    jumps: JumpRecord | None,
    points: list[LoadPoint],
    error: NotConverged,
) -> tuple[Equilibrium, Load, LoadPoint | None]:
    """What an attracted body comes to beyond the end of its branch.  Raises Stopped; so where it is no fold: then the
    branch goes on, and no answer is no jump."""
    if jumps is None or not sudden.at_fold(jumps, here.branch):
        raise load_steps.stopped_run(error, here.travel, points, counters) from error
    try:
        return _landed(system, start, rest, here, goal, control, counters)
    except NotConverged as worse:
        raise load_steps.stopped_run(worse, here.travel, points, counters) from worse


def rougher_control(control: Control, error: NotConverged) -> Control | None:
    """Numerical settings that ask for no more than round-off let an answer have; None where that was not the trouble.

    Of a nearly incompressible body that is hardly touched volumetric stresses are thousands of times those of contact,
    and so is the round-off of their sums: residuals stay at 1e-7 to 1e-5 of the force there.
    """
    least = 2.0 * min(error.history, default=np.inf)
    if error.cause == "time_limit" or not control.tight < least <= LIGHT_CONTACT_ROUND_OFF_RESIDUAL:
        return None
    return replace(control, tight=least, medium=max(control.medium, least))


def _attracted(
    system: System, load: Load, here: Reached, jumps: JumpRecord, control: Control, counters: Counters
) -> Reached:
    """Where a path begins beside the body: at rest under what attraction there is already."""
    if here.travel >= 0.0:
        return here
    load = _rubbing(system, replace(load, history=here.history), here)
    try:
        found = load_steps.find_equilibrium(system, here.u, load, control.between, counters)
    except NotConverged as error:
        raise load_steps.stopped_run(error, here.travel, [], counters) from error
    begun = replace(arrived(system, load, found, Instant(0.0, here.travel, False)), history=here.history)
    return replace(begun, branch=sudden.on_branch(system, found, load, here.travel))


def _drawn_in(system: System, load: Load, u: np.ndarray, control: Control, counters: Counters) -> np.ndarray:
    """Displacement (n, 3) near that under the attraction, from a long range of it on down: a long one draws gently."""
    for longer in ATTRACTION_RANGE_FACTORS:
        wide = system.each(functools.partial(_wider, longer))
        u = load_steps.find_equilibrium(wide, u, load, control.loose, counters).evaluation.u
    return u


def _wider(longer: float, pair: Pair) -> Pair:
    return pair if pair.adhesion is None else replace(pair, adhesion=pair.adhesion.over(longer))


def _landed(
    system: System, start: Start, rest: np.ndarray, here: Reached, goal: Instant, control: Control, counters: Counters
) -> tuple[Equilibrium, Load, LoadPoint | None]:
    """What a body comes to beyond the end of its branch: as at `rest` (n, 3), or drawn in; raises NotConverged."""
    patient = load_steps.MAX_ITERATIONS_AS_LAST_RESORT
    try:
        return attempt(system, start, here, goal, rest, control, counters, patient)
    except NotConverged as error:
        if error.cause == "time_limit":
            raise
        near = _drawn_in(system, loaded(system, start, here, goal), here.u, control, counters)
        return attempt(system, start, here, goal, near, control, counters, patient)


def _lets_go(jumps: JumpRecord | None, here: Reached, error: NotConverged) -> bool:
    """Whether a step that fails may be the end of a branch of an attracted body."""
    return jumps is not None and here.branch is not None and error.cause != "time_limit"


def begin_path(
    system: System,
    start: Start,
    control: Control,
    counters: Counters,
    u: np.ndarray,
    history: History | None = None,
    touching: float | None = None,
    at: float = 0.0,
) -> tuple[Reached, np.ndarray | None]:
    """Where a path begins, and the displacement (n, 3) from which its first step does where that is another.

    Raises Stopped; arguments as those of `follow_history`, `at` the travel (mm) at which it begins.
    """
    here = replace(_rest(system, start(at), u, history), travel=at)
    if touching is None:
        return here, None
    try:
        return here, _held(system, start(touching), here, touching, control, counters)
    except Stopped as error:
        if error.cause == "time_limit":
            raise
        u = load_steps.seat(smooth(system), start(touching), u, control, counters)
        return _rest(system, start(0.0), u, history), None


def attempt(
    system: System,
    start: Start,
    here: Reached,
    goal: Instant,
    guess: np.ndarray,
    control: Control,
    counters: Counters,
    limit: int,
) -> tuple[Equilibrium, Load, LoadPoint | None]:
    """One step to an instant from a displacement `guess` (n, 3): as `_step`, friction let go where need be.

    Raises NotConverged.
    """
    load = loaded(system, start, here, goal)
    try:
        return _step(system, load, guess, here, goal, control, counters, limit)
    except NotConverged as error:
        if system.loose or error.cause == "time_limit" or not any(p.friction for p in system.seat):
            raise
        guess = _let_go(system, load, guess, here, control, counters, limit)
        return _step(system, load, guess, here, goal, control, counters, limit)


def loaded(system: System, start: Start, here: Reached, goal: Instant) -> Load:
    """Load of a step from a state to an instant."""
    return _rubbing(system, replace(start(goal.travel), history=here.history, dt=goal.time - here.time), here)


def smooth(system: System) -> System:
    """The system without friction and attraction."""
    return system.each(lambda p: replace(p, friction=0.0, adhesion=None))


def _rest(system: System, load: Load, u: np.ndarray, history: History | None) -> Reached:
    """Where a path begins: nothing has moved from u (n, 3), no pair carries a traction."""
    x = system.body.nodes + u
    before = tuple(
        tractions.contact_history(p, x, touch, tractions.evaluate_contact(replace(p, friction=0.0), x, touch))
        for p, touch in zip(system.pairs, load.touches, strict=True)
    )
    return Reached(0.0, 0.0, u, np.zeros_like(u), history, before, [np.zeros_like(t.multiplier) for t in load.touches])


def _held(system: System, load: Load, here: Reached, dt: float, control: Control, counters: Counters) -> np.ndarray:
    """Displacement (n, 3) of a body at rest on its support with everything stuck that touches."""
    load = _rubbing(system, replace(load, history=here.history, dt=dt), here, _stuck(system, load))
    return load_steps.seat(system, load, here.u, control, counters)


def _between(here: Reached, instant: Instant, share: float) -> Instant:
    """A share of what is left to an instant."""
    return Instant(
        here.time + share * (instant.time - here.time), here.travel + share * (instant.travel - here.travel), False
    )


def _step(
    system: System,
    load: Load,
    guess: np.ndarray,
    here: Reached,
    goal: Instant,
    control: Control,
    counters: Counters,
    limit: int,
) -> tuple[Equilibrium, Load, LoadPoint | None]:
    """Equilibrium at the end of a step from which the path goes on, its load, and the answer where one is asked for."""
    rolls, crude = rigid_motions.rolls(system), None
    if system.loose:  # a body that may slide far: friction by the pressure before
        limits = _stuck(system, load) if rolls else here.pressures
        crude, crude_load = _rested(system, load, guess, here, limits, control, counters, limit)
        guess = crude.evaluation.u
        load = _rubbing(system, load, here, [c.pressure for c in crude.evaluation.contacts])
    if goal.asked:
        patient = limit == load_steps.MAX_ITERATIONS_AS_LAST_RESORT
        point = load_steps.equilibrate(system, [guess], load, goal.travel, control, counters, goal.time, loose=patient)
        found = point.stages[0].equilibrium
        return replace(found, rate=crude.rate) if rolls and crude is not None else found, load, point
    try:
        found = load_steps.find_equilibrium(system, guess, load, control.between, counters, limit)
        found = replace(found, rate=crude.rate) if rolls and crude is not None else found
    except NotConverged as error:
        if not rolls or crude is None or error.cause == "time_limit":
            raise
        counters.loose += 1  # a body that hardly resists is followed to 1 % of the force there
        found, load = crude, crude_load
    return replace(found, linear=None, known=None), load, None


def arrived(system: System, load: Load, found: Equilibrium, goal: Instant) -> Reached:
    """What the path goes on from after a step to an instant."""
    at = found.evaluation
    x = system.body.nodes + at.u
    before = tuple(
        tractions.contact_history(p, x, touch, c)
        for p, touch, c in zip(system.pairs, load.touches, at.contacts, strict=True)
    )
    return Reached(goal.time, goal.travel, at.u, found.rate, at.history, before, [c.pressure for c in at.contacts])


def _stuck(system: System, load: Load) -> list[np.ndarray]:
    """Pressures (MPa) by which friction holds everything that touches."""
    return [np.full_like(t.multiplier, STICKING_PRESSURE_RATIO * system.material.shear_modulus) for t in load.touches]


def _rubbing(system: System, load: Load, here: Reached, pressures: Sequence[np.ndarray] | None = None) -> Load:
    """The load with the start of the step on every pair with friction, and the pressures (MPa) that limit it."""
    touches = []
    for k, (pair, touch) in enumerate(zip(system.pairs, load.touches, strict=True)):
        before = None if pair.friction == 0.0 else here.before[k]
        if before is not None:
            before = replace(before, met=tractions.met(pair, before, touch))
        if before is not None and pressures is not None:
            before = replace(before, pressure=pressures[k])
        touches.append(replace(touch, before=before))
    return load.touching(touches)


def _let_go(
    system: System, load: Load, u: np.ndarray, here: Reached, control: Control, counters: Counters, limit: int
) -> np.ndarray:
    """Displacement (n, 3) near that with friction, from everything stuck: it is let go step by step.

    Each step limits friction by the pressures of the one before.  A base that rubs on its plate with much friction
    sticks in one ring and slips in the next, which Newton does not find from afar.
    """
    limits = _stuck(system, load)
    for k, more in enumerate(FRICTION_RELEASE_FACTORS):
        bounded = _rubbing(system, load, here, [more * p for p in limits])
        try:
            at = load_steps.find_equilibrium(system, u, bounded, control.loose, counters, limit).evaluation
        except NotConverged as error:
            if k == 0 or error.cause == "time_limit":
                raise
            break
        u, limits = at.u, [c.pressure for c in at.contacts]
    return u


def _rested(
    system: System,
    load: Load,
    u: np.ndarray,
    here: Reached,
    limits: Sequence[np.ndarray],
    control: Control,
    counters: Counters,
    limit: int,
) -> tuple[Equilibrium, Load]:
    """Equilibrium to 1 % of the force and its load, friction limited by pressures `limits` (MPa) of a solution before.

    A body that may turn is looked for again with the pressures found, from everything stuck on down, until these and
    the limits agree: what is at rest stays there where it can, and what slides does so under its own pressure.  Where
    they do not in MAX_FRICTION_PASSES, the step counts as a loose one.  The rate is that of the first of them: the next
    step begins with everything stuck again, and what it would be while sliding leads that far astray.
    """
    turns, rate = rigid_motions.rolls(system), None
    for _ in range(MAX_FRICTION_PASSES if turns else 1):
        load = _rubbing(system, load, here, limits)
        found = load_steps.find_equilibrium(system, u, load, control.loose, counters, limit)
        rate = found.rate if rate is None else rate
        found = replace(found, linear=None, known=None)  # a matrix each
        u, last, limits = found.evaluation.u, limits, [c.pressure for c in found.evaluation.contacts]
        weights = [p.surface.weights for p in system.pairs]
        off = sum(float((w * np.abs(p - q)).sum()) for w, p, q in zip(weights, limits, last, strict=True))
        if off <= FRICTION_LIMIT_TOLERANCE * sum(float((w * p).sum()) for w, p in zip(weights, limits, strict=True)):
            break
    else:
        counters.loose += turns
    assert rate is not None  # of the first pass
    return replace(found, rate=rate), load


def light(point: LoadPoint) -> LoadPoint:
    """The point without what only the next step needs of its first stages: strains and history, megabytes each."""
    stages = []
    for stage in point.stages[:-1]:
        at = replace(stage.equilibrium.evaluation, H=np.empty(0), history=None)
        stages.append(replace(stage, equilibrium=replace(stage.equilibrium, evaluation=at)))
    return replace(point, stages=(*stages, point.stages[-1]))
