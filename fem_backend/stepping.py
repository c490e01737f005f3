"""Travel of the indenter in steps with a predictor and cut-back, for elastic bodies and those with a history."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fem_backend import contact, newton, rolling
from fem_backend.contact import Before
from fem_backend.newton import Counters, Equilibrium, Evaluation, Known, Load, NotConverged, System

MOVES = 12  # on a tether, at most
PASSES = 8  # of friction limited by the pressure of the pass before, at most
AGREE = 0.05  # of the force: limits that are near enough
STUCK = 1e6  # times the shear modulus: a pressure whose friction holds everything
NOTHING = (None, None)  # no factor is known, old ones may be used
SEATING = (1e5, 1e4, 1e3, 1e2, 1e1, 1.0)  # factors of the grounding springs until the support carries the body


@dataclass(frozen=True)
class Control:
    """Numerical settings of a run; lengths in mm for R = 3 mm, see `scaled`.

    `first` and `largest` step, `path` the largest where the answer depends on the way.  Relative residuals: travelling
    (elastic `loose`, else `between`), when seated, between augmentations (`medium`) and at the end of them (`tight`).
    Augmentations of the multipliers at asked travels; smallest step as a fraction of the first; process time after
    which a run is given up (s).
    """

    first: float = 0.15
    largest: float = 0.6
    path: float = 0.34
    loose: float = 1e-2
    between: float = 1e-4
    seating: float = 1e-5
    medium: float = 1e-6
    tight: float = 1e-9
    augmentations: int = 1
    smallest: float = 0.02
    time_limit_s: float = 900.0

    def scaled(self, R: float) -> Control:
        """Steps for an indenter of radius R (mm)."""
        k = R / 3.0
        return replace(self, first=k * self.first, largest=k * self.largest, path=k * self.path)


@dataclass(frozen=True)
class Instant:
    """A moment of a programme: time (s), travel (mm), whether an answer is asked for."""

    time: float
    travel: float
    asked: bool


@dataclass(frozen=True)
class Stage:
    """One of the solutions that lead to an asked point: equilibrium and its load (multipliers of the stage before)."""

    equilibrium: Equilibrium
    load: Load


@dataclass(frozen=True)
class Point:
    """Equilibrium at an asked moment: time (s), travel (mm), the stages of its multipliers (the last one counts)."""

    time: float
    travel: float
    stages: tuple[Stage, ...]

    @property
    def evaluation(self) -> Evaluation:
        """The final state."""
        return self.stages[-1].equilibrium.evaluation

    @property
    def load(self) -> Load:
        """The final load."""
        return self.stages[-1].load

    @property
    def force(self) -> np.ndarray:
        """Force of the modelled part of the specimen on the indenter (3,) N."""
        return self.evaluation.contact.force

    @property
    def previous_force(self) -> np.ndarray:
        """The same before the last augmentation."""
        return self.stages[max(len(self.stages) - 2, 0)].equilibrium.evaluation.contact.force


class Stopped(ArithmeticError):
    """The run ended early: cause class, message, points reached (`reached` is the result of them), residual history."""

    reached: Any = None

    def __init__(
        self, cause: str, message: str, points: list[Point], history: tuple[float, ...], counters: Counters
    ) -> None:
        super().__init__(message)
        self.cause, self.points, self.history, self.counters = cause, points, history, counters


Start = Callable[[float], Load]
Guess = Callable[[float], np.ndarray | None]
Look = Callable[..., Equilibrium]
Watch = Callable[[Stage, bool], None]  # called at each stage, and whether it is the last, while its factor is alive


def find(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, limit: int = 40,
    known: Known | None = None,
) -> Equilibrium:  # fmt: skip
    """Equilibrium from u (n, 3); a body in a bowl that is lost is led there on a tether.

    Each solution on the tether is where the next one is tied to (proximal point method, Rockafellar 1976), the tether
    is loosened after success and tightened after failure, so that a body that may roll or slide far goes there in
    small moves.  Raises NotConverged.
    """
    try:
        return newton.solve(system, u, load, tolerance, counters, limit, known)
    except NotConverged as error:
        if system.springs is None or error.cause == "time_limit":
            raise
        last = error
    tether, calm, near = 1e4, 0, min(max(0.1 * tolerance, 1e-7), 1e-3)  # looser, and the last moves would not be made
    for _ in range(MOVES):
        try:
            tied = newton.solve(system, u, replace(load, tether=tether, near=u), near, counters, limit=12)
        except NotConverged as error:
            if error.cause == "time_limit" or tether > 1e8:
                raise
            tether, calm = 30.0 * tether, 0
            continue
        u, calm, tether = tied.evaluation.u, calm + 1, max(tether / 5.0, 1.0)
        if calm >= 3 and tether <= 100.0:
            try:
                return newton.solve(system, u, load, tolerance, counters, limit=12)
            except NotConverged as error:
                last, calm = error, 0
    raise last


def roll(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, limit: int = 15,
    known: Known | None = None,
) -> Equilibrium:  # fmt: skip
    """Equilibrium from u (n, 3) by Newton and, where a body in a bowl is lost, as it rolls.  Raises NotConverged."""
    try:
        return newton.solve(system, u, load, tolerance, counters, limit, known)
    except NotConverged as error:
        if system.springs is None or error.cause == "time_limit":
            raise
    return rolling.solve(system, u, load, tolerance, counters)


def brisk(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, limit: int = 40,
    known: Known | None = None,
) -> Equilibrium:  # fmt: skip
    """Equilibrium as a body rolls there, `limit` being what Newton would be granted.  Raises NotConverged."""
    return rolling.solve(system, u, load, tolerance, counters, 3 * limit)


def patient(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, limit: int = 40,
    known: Known | None = None,
) -> Equilibrium:  # fmt: skip
    """The same with the longest breath, whatever `limit` says.  Raises NotConverged."""
    return rolling.solve(system, u, load, tolerance, counters)


def way(system: System) -> Look:
    """How equilibria are looked for: a body that may turn in its bowl rolls there at once."""
    return brisk if rolling.rolls(system) else find


def ahead(system: System, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) after a predicted step (n, 3), whose rigid part is made as one where the body may turn."""
    return rolling.moved(rolling.motion(system.body), u, step) if rolling.rolls(system) else u + step


def seat(
    system: System, load: Load, u: np.ndarray, control: Control, counters: Counters, look: Look | None = None
) -> np.ndarray:
    """Displacement (n, 3) with the grounding springs softened step by step until the contacts carry the body."""
    look = look or way(system)
    for factor, tolerance in [(f, control.loose) for f in SEATING] + [(1.0, control.seating)]:
        grounded = replace(load, springs=factor)
        try:
            try:
                u = look(system, u, grounded, tolerance, counters).evaluation.u
            except NotConverged as error:
                if error.cause == "time_limit" or look in (brisk, rolling.solve):
                    raise
                u = rolling.solve(system, u, grounded, tolerance, counters).evaluation.u
        except NotConverged as error:
            raise Stopped(error.cause, f"while seating: {error}", [], error.history, counters) from error
    return u


def travel(
    system: System, start: Start, asked: Sequence[float], control: Control, counters: Counters,
    u: np.ndarray | None = None, guess: Guess | None = None, watch: Watch | None = None,
) -> list[Point]:  # fmt: skip
    """Equilibria of a conservative system at the `asked` travels (mm, increasing) from the state u (n, 3) at travel 0.

    `start(s)` is the load at travel s without multipliers.  Between asked travels the state only has to be near: the
    answer at an asked travel does not depend on the way there, and `guess(s)` may offer a state to start from.
    Raises Stopped with what was reached.
    """
    look = way(system)
    u = np.zeros_like(system.body.nodes) if u is None else u
    rate, here, step = np.zeros_like(u), 0.0, control.first
    points: list[Point] = []
    for target in asked:
        offered = guess(target) if guess is not None else None
        if offered is not None:
            try:
                points.append(
                    _settle(system, offered, start(target), target, control, counters, look, watch=watch, known=NOTHING)
                )
            except NotConverged as error:
                if error.cause == "time_limit":
                    raise _stopped(error, target, points, counters) from error
            else:
                u, rate, here = _end(points[-1], target)
                continue
        known = NOTHING
        while here < target - 1e-12:
            goal = target if here + 1.2 * step >= target else here + step
            try:
                guessed = ahead(system, u, (goal - here) * rate)
                found = look(system, guessed, start(goal), control.loose, counters, limit=15, known=NOTHING)
            except NotConverged as error:
                counters.cutbacks += 1
                step = 0.5 * (goal - here)
                if step < control.smallest * control.first or error.cause == "time_limit":
                    if not _may_roll(system, look, control, counters):
                        raise _stopped(error, here, points, counters) from error
                    look, step = roll if look is find else patient, control.first
                rate = rate if step > control.first / 4 else np.zeros_like(rate)
                continue
            counters.steps += 1
            easy = len(found.history) <= 5
            step = min((goal - here) * (1.6 if easy else 1.0), control.largest) if goal < target else step
            u, rate, here = found.evaluation.u, found.rate, goal
            known = found.known
        try:
            points.append(_settle(system, u, start(target), target, control, counters, look, watch=watch, known=known))
        except NotConverged as error:
            if not _may_roll(system, look, control, counters):
                raise _stopped(error, target, points, counters) from error
            look = roll if look is find else patient
            try:
                points.append(_settle(system, u, start(target), target, control, counters, look, 0.0, watch, NOTHING))
            except NotConverged as last:
                raise _stopped(last, target, points, counters) from last
        u, rate, here = _end(points[-1], target)
    return points


def _may_roll(system: System, look: Look, control: Control, counters: Counters) -> bool:
    """Whether a body that is lost in its bowl may go on rolling, for which it gets the time of a run once more.

    Only then: a run that comes through without has the answer that it always had.
    """
    if look not in (find, brisk) or system.springs is None:
        return False
    counters.deadline = max(counters.deadline, clock.process_time() + control.time_limit_s)
    return True


def _end(point: Point, travel: float) -> tuple[np.ndarray, np.ndarray, float]:
    """State, rate and travel to go on from: those before the multipliers, which the next step does not have."""
    first = point.stages[0].equilibrium
    return first.evaluation.u, first.rate, travel


def _stopped(error: NotConverged, here: float, points: list[Point], counters: Counters) -> Stopped:
    kept = ("inversion", "time_limit", "instability")
    cause = error.cause if error.cause in kept else "step_limit"
    return Stopped(cause, f"no equilibrium beyond {here:.4g} mm ({error})", points, error.history, counters)


def _settle(
    system: System, u: np.ndarray, load: Load, target: float, control: Control, counters: Counters, look: Look,
    time: float = 0.0, watch: Watch | None = None, known: Known | None = None,
) -> Point:  # fmt: skip
    """Tight equilibrium at an asked travel, multipliers λ ← p a fixed number of times (Uzawa); `known` as in Newton."""
    stages: list[Stage] = []
    for k in range(control.augmentations + 1):
        tolerance = control.tight if k == control.augmentations or known is not None else control.medium
        found = look(system, u, load, tolerance, counters, limit=15 if look is roll else 40, known=known)
        known = found.known if known is not None else None
        stages.append(Stage(found, load))
        if watch is not None:
            watch(stages[-1], k == control.augmentations)
        found = replace(found, linear=None, known=None)  # a matrix each
        stages[-1] = Stage(found, load)
        u, load = found.evaluation.u, newton.augmented(load, found.evaluation)
    return Point(time, target, tuple(stages))


def _light(point: Point) -> Point:
    """The point without what only the next step needs of its first stages: strains and history, megabytes each."""
    stages = []
    for stage in point.stages[:-1]:
        at = replace(stage.equilibrium.evaluation, H=np.empty(0), history=None)
        stages.append(replace(stage, equilibrium=replace(stage.equilibrium, evaluation=at)))
    return replace(point, stages=(*stages, point.stages[-1]))


def _rubbing(
    system: System, load: Load, before: Sequence[Before], pressures: Sequence[np.ndarray] | None = None
) -> Load:
    """The load with the start of the step on every pair with friction, and the pressures that limit it."""
    touches = []
    for k, (pair, touch) in enumerate(zip(system.pairs, load.touches, strict=True)):
        start = None if pair.friction == 0.0 else before[k]
        if start is not None and pressures is not None:
            start = replace(start, pressure=pressures[k])
        touches.append(replace(touch, before=start))
    return replace(load, touches=tuple(touches))


def _rested(
    system: System, load: Load, u: np.ndarray, before: Sequence[Before], limits: Sequence[np.ndarray], control: Control,
    counters: Counters, look: Look,
) -> tuple[Equilibrium, Load]:  # fmt: skip
    """Equilibrium to 1 % of the force and its load, friction limited by pressures `limits` (MPa) of a solution before.

    A body that may turn is looked for again with the pressures found, from everything stuck on down, until these and
    the limits agree: what is at rest stays there where it can, and what slides does so under its own pressure.  Where
    they do not in PASSES, the step counts as a loose one.
    """
    turns = rolling.rolls(system)
    for _ in range(PASSES if turns else 1):
        load = _rubbing(system, load, before, limits)
        found = look(system, u, load, control.loose, counters, limit=15)
        u, last, limits = found.evaluation.u, limits, [c.pressure for c in found.evaluation.contacts]
        weights = [p.surface.weights for p in system.pairs]
        off = sum(float((w * np.abs(p - q)).sum()) for w, p, q in zip(weights, limits, last, strict=True))
        if off <= AGREE * sum(float((w * p).sum()) for w, p in zip(weights, limits, strict=True)):
            break
    else:
        counters.loose += turns
    return found, load


def follow(
    system: System, start: Start, instants: Sequence[Instant], control: Control, counters: Counters,
    u: np.ndarray, history: object = None, touching: float | None = None,
) -> list[Point]:  # fmt: skip
    """Equilibria at the asked instants where the way matters: friction, viscoelasticity, softening.

    Between asked instants the penalty alone keeps the bodies apart (kept multipliers would let the pressures of the
    many contact points drift apart).  At an asked instant the multipliers are a side branch: the path goes on from the
    state without them.  A step without equilibrium is halved.  Raises Stopped with what was reached.

    Friction counts from rest: the first step of a body that may turn begins with everything stuck that touches, at a
    travel `touching` (mm) where that has to be sought.  Let slip before, it would lie against the wall of its bowl.
    """
    t, s, rate = 0.0, 0.0, np.zeros_like(u)
    x, touches = system.body.nodes + u, start(0.0).touches
    before = tuple(
        contact.remember(p, x, touch, contact.evaluate(replace(p, friction=0.0), x, touch))
        for p, touch in zip(system.pairs, touches, strict=True)
    )
    stuck = [np.full_like(touch.multiplier, STUCK * system.material.shear_modulus) for touch in touches]
    pressures = [np.zeros_like(touch.multiplier) for touch in touches]
    first = None
    if touching is not None:
        resting = _rubbing(system, replace(start(touching), history=history, dt=touching), before, stuck)
        first = seat(system, resting, u, control, counters)
    points: list[Point] = []
    look = way(system)
    for instant in instants:
        share, begin = 1.0, t  # of what is left to this instant
        while t < instant.time - 1e-12 * max(instant.time, 1.0):
            last = share >= 1.0
            goal_t = instant.time if last else t + share * (instant.time - t)
            goal_s = instant.travel if last else s + share * (instant.travel - s)
            load = start(goal_s)
            load = _rubbing(system, replace(load, history=history, dt=goal_t - t), before)
            try:
                guess = ahead(system, u, (goal_s - s) * rate) if first is None or t > 0.0 else first
                if system.springs is not None:  # a body that may roll and slide far: friction by the pressure before
                    limits = stuck if rolling.rolls(system) else pressures
                    crude, before_it = _rested(system, load, guess, before, limits, control, counters, look)
                    guess = crude.evaluation.u
                    load = _rubbing(system, load, before, [c.pressure for c in crude.evaluation.contacts])
                if last and instant.asked:
                    point = _settle(system, guess, load, goal_s, control, counters, look, goal_t)
                    found = point.stages[0].equilibrium
                else:
                    try:
                        found = look(system, guess, load, control.between, counters, limit=15)
                    except NotConverged as error:
                        if not rolling.rolls(system) or error.cause == "time_limit":
                            raise
                        counters.loose += 1  # a body that hardly resists is followed to 1 % of the force there
                        found, load = crude, before_it
                    found = replace(found, linear=None, known=None)
            except NotConverged as error:
                counters.cutbacks += 1
                share *= 0.5
                least = 1 / 64 if system.springs is None else 1 / 8
                lost = share * (instant.time - t) < least * (instant.time - begin)
                if lost or error.cause == "time_limit":
                    if not _may_roll(system, look, control, counters):
                        raise _stopped(error, s, points, counters) from error
                    look, share = patient, 1.0
                if share < 0.3:
                    rate = np.zeros_like(rate)
                continue
            counters.steps += 1
            if last and instant.asked:
                points.append(_light(point))
            share = min(1.0, 2.0 * share) if not last else share
            at = found.evaluation
            u, t, s, history, rate = at.u, goal_t, goal_s, at.history, found.rate
            x, pressures = system.body.nodes + u, [c.pressure for c in at.contacts]
            before = tuple(
                contact.remember(p, x, touch, c)
                for p, touch, c in zip(system.pairs, load.touches, at.contacts, strict=True)
            )
    return points
