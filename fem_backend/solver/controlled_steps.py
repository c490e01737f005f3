"""A programme of travel and force followed step by step: where a force is given, the travel is one more unknown.

At the end of a step the state obeys R(u, s, t) = 0 and one scalar equation,

    F(s(p), t(p)) = F*(p),

with the force F of the body along the indenter's way and an unknown p: the travel s of a given moment (force control),
the travel of a ramp whose time goes with it (an approach to a force), or the moment at which a ramp of force passes a
travel.  R = 0 is solved within, from a state that du/ds predicts, so that the bordered system

    [K  ∂R/∂s; (∂F/∂u)ᵀ  ∂F/∂s] [δu; δs] = −[R; F − F*]

is condensed to δs = −(F − F*)/F′ with the known tangent F′ = dF/ds (Batoz & Dhatt 1979, Int. J. Numer. Methods Eng. 14,
1262), after the first step with the secant of the last two.  The force is that with the multipliers of contact, as in
answers, at every step that a force decides: what is found does not depend on which moments are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fem_backend.materials.stress import History
from fem_backend.solver import history_steps, load_steps, newton
from fem_backend.solver.history_steps import LIGHT_CONTACT_ROUND_OFF_RESIDUAL, Reached
from fem_backend.solver.load_steps import Control, Instant, LoadPoint, Start, Stopped
from fem_backend.solver.newton import Counters, Equilibrium, Load, NotConverged, System

# of a force: what is left where an answer is asked for; equilibria are found to 1e-8 of it
ASKED_FORCE_TOLERANCE = 1e-7
HISTORY_FORCE_TOLERANCE = 1e-5  # the same on the way of a body with a history, whose answer hangs on it
PASSING_FORCE_TOLERANCE = 1e-2  # the same of one without
MAX_FORCE_TRIALS = 25  # travels tried for a force, at most
ELAPSED_TIME_STEP_SHARE = 0.2  # of the time since a segment began is the next step of a body that relaxes, and that
RELAXATION_TIME_STEP_SHARE = 0.02  # of its shortest relaxation time
MIN_CONTROLLED_STEP_SHARE = 1e-3  # of a step at which the way is given up
FIRST_CONTACT_EXPONENT = 1.5  # F ∝ s^1.5 (Hertz): of the force over the travel where contact begins
UNREACHED_FORCE_CAUSE = "not_supported"  # cause of a way that ends before its force is met: no other path meets it
PASSING_RESIDUAL_TOLERANCE = 1e-6  # relative residual of a step that is no answer
# times what round-off leaves of a body that is hardly touched is the share to which a force is met
ROUND_OFF_FORCE_FACTOR = 10.0
SAME_TARGET_TOLERANCE = 1e-6  # of a force or a travel asked for: where the way is at it
# of a force that is met on the way: from there on contact is exact, which adds up to that
EXACT_CONTACT_FORCE_SHARE = 0.02
TRAVEL_TIME_ROUND_OFF = 1e-12  # of a travel or a time: what round-off leaves of it


@dataclass(frozen=True)
class Leg:
    """A part of a programme: travel or (`forced`) force goes on at `rate` to `to_mm` or `to_N`, or rests for `lasts` s.

    `asked` are the moments (s) since its beginning at which answers are asked for.
    """

    forced: bool
    rate: float = 0.0
    to_mm: float | None = None
    to_N: float | None = None
    lasts: float | None = None
    asked: tuple[float, ...] = ()


@dataclass(frozen=True)
class Drive:
    """What is followed: legs, asked travels (mm) and forces (N), and the travel (mm) at which the way ends, and why."""

    legs: tuple[Leg, ...]
    asked_mm: tuple[float, ...]
    asked_N: tuple[float, ...]
    deepest: float
    why: str


@dataclass(frozen=True)
class Followed:
    """Answers in order of time, and all instants of the way.

    Of each: whether its force was given, dF/ds (N/mm), and the share of the force that is left.
    """

    points: list[LoadPoint]
    given: list[bool]
    slopes: list[float]
    left: list[float]
    way: list[Instant]


class Trial(NamedTuple):
    """A state at the end of a step: what it was solved as, its force (N), dF/ds (N/mm) by its tangent, how tightly."""

    goal: Instant
    found: Equilibrium
    load: Load
    point: LoadPoint | None
    force: float
    slope: float
    rough: float


class Renewed(NamedTuple):
    """A body on a new mesh: its system and loads, where its way goes on, the force there over that on the old mesh."""

    system: System
    start: Start
    here: Reached
    ratio: float


Renew = Callable[[Reached], Renewed | None]  # the new mesh of a state that has outworn its own


class Wanted(NamedTuple):
    """A force (N) to be met, where it is looked for first (mm), dF/ds (N/mm) as known, and when (s).

    With a `pace` (mm/s) the moment goes with the travel, `time` being that at `start` (mm).
    """

    force: float
    first: float
    slope: float
    time: float
    pace: float = 0.0
    start: float = 0.0

    def moment(self, travel: float) -> float:
        """When (s) the indenter is at a travel (mm)."""
        return self.time + ((travel - self.start) / self.pace if self.pace else 0.0)


@dataclass(frozen=True)
class Bench:
    """What every step needs: `measure` is the force (N) of the whole specimen along the way of that (3,) N of the
    modelled part, `share` of which is the whole; `tau` (s) the shortest relaxation time, ∞ without any; `renew` remakes
    meshes on the way."""

    system: System
    start: Start
    control: Control
    counters: Counters
    measure: Callable[[np.ndarray], float]
    share: float
    tau: float
    renew: Renew | None = None

    @property
    def path_dependent(self) -> bool:
        """Whether the way to an answer shows in it."""
        return self.system.material.path_dependent or any(p.friction for p in self.system.pairs)


def follow_drive(
    bench: Bench, drive: Drive, u: np.ndarray, history: History | None = None, touching: float | None = None
) -> Followed:
    """Equilibria at everything that is asked for; raises Stopped with what was reached (`reached` is a Followed)."""
    here, first = history_steps.begin_path(
        bench.system, bench.start, bench.control, bench.counters, u, history, touching
    )
    walk = _Walk(bench, drive, here, first)
    try:
        for leg in drive.legs:
            walk.along(leg)
    except NotConverged as error:
        stopped = load_steps.stopped_run(error, walk.here.travel, walk.out.points, bench.counters)
        stopped.reached = walk.out
        raise stopped from error
    except Stopped as stopped:
        stopped.points, stopped.reached = walk.out.points, walk.out
        raise
    return walk.out


class _Walk:
    """The state of the way: where it is, with which force, dF/ds (N/mm) and ds/dt (mm/s) of the last step."""

    def __init__(self, bench: Bench, drive: Drive, here: Reached, first: np.ndarray | None) -> None:
        self.bench, self.drive, self.here = bench, drive, here
        self.force, self.slope, self.pace = 0.0, 0.0, 0.0
        self.out = Followed([], [], [], [], [])
        self._first, self._aim, self._on_the_way = first, 0.0, False
        self._floor = 0.0, 0.0  # relative residual that round-off left, at a force (N)
        self._meshes = 0  # remade

    # ------------------------------------------------------------------------------------------------------- legs

    def along(self, leg: Leg) -> None:
        """Follow one leg to its end."""
        began = self.here.time
        self.pace = 0.0 if not leg.forced else self.pace
        if leg.forced:
            self._by_force(leg, began)
        elif leg.to_N is not None:
            self._until(leg, began)
        else:
            self._by_travel(leg, began)

    def _by_travel(self, leg: Leg, began: float) -> None:
        """Travel to a travel, or rest there."""
        s0 = self.here.travel
        end = s0 if leg.to_mm is None else leg.to_mm
        lasts = leg.lasts if leg.lasts is not None else abs(end - s0) / leg.rate
        at = lambda t: s0 + (end - s0) * min(t / lasts, 1.0)  # noqa: E731
        moments = {_of_end(t, lasts): (at(t), True) for t in leg.asked}
        for a in self.drive.asked_mm if end != s0 else ():
            if min(s0, end) < a < max(s0, end) or a == end:
                moments[_of_end(lasts * (a - s0) / (end - s0), lasts)] = (a, True)
        moments.setdefault(lasts, (end, False))
        for t in sorted(moments):
            s, asked = moments[t]
            self._travel_to(began, began + t, s, asked)

    def _travel_to(self, began: float, time: float, travel: float, asked: bool) -> None:
        share = 1.0
        while time - self.here.time > TRAVEL_TIME_ROUND_OFF * max(time, 1.0):
            dt, ds = time - self.here.time, travel - self.here.travel
            part = min(share, self.bench.control.path / max(abs(ds), 1e-300), self._longest(began) / dt)
            last = part >= 0.95
            here = self.here
            goal = Instant(time, travel, asked)
            if not last:
                goal = Instant(here.time + part * dt, here.travel + part * ds, False)
            try:
                trial = self._passing(goal, self.drive.asked_N)
            except NotConverged as error:
                share = self._cut(part, error)
                continue
            met = self._met(trial)
            if met is not None:
                v = (goal.travel - here.travel) / (goal.time - here.time)
                slope = (trial.force - self.force) / (goal.travel - here.travel)
                wanted = Wanted(met, here.travel + (met - self.force) / slope, slope, here.time, v, here.travel)
                self._arrive(self._solved(wanted, ASKED_FORCE_TOLERANCE), True, True)
                continue
            self._arrive(trial, asked and last, False)
            share = 1.0

    def _passing(self, goal: Instant, forces: Sequence[float]) -> Trial:
        """The end of a step of travel; contact is exact where one of the forces is near or passed."""
        self._on_the_way = False
        trial = self._tried(goal)
        low, high = sorted((self.force, trial.force))
        near = any(
            low * (1.0 - EXACT_CONTACT_FORCE_SHARE) <= f <= high * (1.0 + EXACT_CONTACT_FORCE_SHARE) for f in forces
        )
        return trial if goal.asked or not near else self._tried(replace(goal, asked=True), trial)

    def _met(self, trial: Trial) -> float | None:
        """The first asked force that a step of travel passes."""
        between = [
            f
            for f in self.drive.asked_N
            if (self.force - f) * (trial.force - f) < 0.0 and abs(self.force - f) > SAME_TARGET_TOLERANCE * abs(f)
        ]
        return min(between, key=lambda f: abs(f - self.force), default=None)

    def _until(self, leg: Leg, began: float) -> None:
        """Travel until a force is met, at most to the deepest travel."""
        assert leg.to_N is not None
        self._aim = leg.to_N
        back = leg.to_N < self.force
        v, step, share = (-leg.rate if back else leg.rate), self.bench.control.first, 1.0
        asked = list(leg.asked)
        stops = 0.0 if back else self.drive.deepest
        while True:
            here = self.here
            left = (stops - here.travel) / v * abs(v)
            if abs(left) <= TRAVEL_TIME_ROUND_OFF * max(abs(here.travel), 1.0):
                raise self._out_of_reach(leg.to_N)
            ds = float(np.clip(share * step, 0.0, abs(left))) * np.sign(v)
            t = here.time + ds / v
            due = [began + m for m in asked if here.time < began + m <= t]
            if due:
                t, ds = due[0], (due[0] - here.time) * v
            try:
                trial = self._passing(Instant(t, here.travel + ds, bool(due)), (*self.drive.asked_N, leg.to_N))
            except NotConverged as error:
                share = self._cut(share, error)
                continue
            met = self._met(trial)
            if (self.force - leg.to_N) * (trial.force - leg.to_N) <= 0.0 and self.force != trial.force:
                met = leg.to_N if met is None or abs(leg.to_N - self.force) <= abs(met - self.force) else met
            if met is not None:
                slope = (trial.force - self.force) / (trial.goal.travel - here.travel)
                ratio = max(met / trial.force, 0.0) if self.force == 0.0 and trial.force > 0.0 else None
                p = here.travel + (
                    ratio ** (1.0 / FIRST_CONTACT_EXPONENT) * ds if ratio is not None else (met - self.force) / slope
                )
                wanted = Wanted(met, p, slope, here.time, v, here.travel)
                self._arrive(self._solved(wanted, ASKED_FORCE_TOLERANCE), met in self.drive.asked_N, True)
                if met == leg.to_N:
                    return
                continue
            self._arrive(trial, bool(due), False)
            share, step = 1.0, min(1.6 * step, self.bench.control.path)

    def _by_force(self, leg: Leg, began: float) -> None:
        """Force to a force, or rest there: what is asked for and the end are met exactly, the rest is on the way."""
        F0 = self.force
        end = self._aim = F0 if leg.to_N is None else leg.to_N
        lasts = leg.lasts if leg.lasts is not None else abs(end - F0) / leg.rate
        rate = (end - F0) / lasts if leg.to_N is not None else 0.0
        moments = {_of_end(t, lasts): (F0 + rate * t, True) for t in leg.asked}
        for f in self.drive.asked_N if rate else ():
            if (min(F0, end) < f < max(F0, end) and abs(f - F0) > SAME_TARGET_TOLERANCE * abs(f)) or f == end:
                moments[_of_end((f - F0) / rate, lasts)] = (f, True)
        moments[lasts] = (end, moments.get(lasts, (end, False))[1])
        for t in sorted(moments):
            f, asked = moments[t]
            self._force_to(began, began + t, f, rate, asked)

    def _force_to(self, began: float, time: float, force: float, rate: float, asked: bool) -> None:
        share = 1.0
        while time - self.here.time > TRAVEL_TIME_ROUND_OFF * max(time, 1.0):
            here, dt = self.here, time - self.here.time
            part = min(share, self._longest(began) / dt, self._by_travel_at_most(force, dt))
            last = part >= 0.95
            t = time if last else here.time + part * dt
            f = force if last else self.force + rate * (t - here.time)
            s = here.travel + (
                (f - self.force) / self.slope if self.slope > 0.0 and rate else self.pace * (t - here.time)
            )
            try:
                if self.slope <= 0.0:
                    t, f, s = self._first_touch(time, force, rate, share)
                    last = t == time
                wanted = Wanted(f, s, self.slope, t)
                trial = self._solved(
                    wanted,
                    ASKED_FORCE_TOLERANCE
                    if last
                    else HISTORY_FORCE_TOLERANCE
                    if self.bench.path_dependent
                    else PASSING_FORCE_TOLERANCE,
                )
            except NotConverged as error:
                share = self._cut(part, error)
                continue
            met = self._met_travel(trial)
            if met is not None:
                self._at_travel(met, trial, rate)
                continue
            self._arrive(trial, asked and last, True)
            share = 1.0

    def _first_touch(self, time: float, force: float, rate: float, share: float) -> tuple[float, float, float]:
        """Moment (s), force (N) and travel (mm) to look for first, no further than a step of travel goes."""
        s = self.here.travel + share * self.bench.control.first
        tried = self._tried(Instant(time, s, False)).force
        if tried >= force or tried <= 0.0 or rate <= 0.0:
            share = (force / tried) ** (1.0 / FIRST_CONTACT_EXPONENT) if tried > force > 0.0 else 1.0
            return time, force, self.here.travel + share * (s - self.here.travel)
        return self.here.time + (tried - self.force) / rate, tried, s

    def _by_travel_at_most(self, force: float, dt: float) -> float:
        """Share of a step of force that moves the indenter by no more than a step of travel."""
        path = self.bench.control.path
        if self.slope <= 0.0:
            return 1.0
        return min(
            path * self.slope / max(abs(force - self.force), 1e-300), path / max(abs(self.pace) * dt, 1e-300), 1.0
        )

    def _met_travel(self, trial: Trial) -> float | None:
        """The first asked travel that a step of force passes."""
        a, b = self.here.travel, trial.goal.travel
        between = [s for s in self.drive.asked_mm if (a - s) * (b - s) < 0.0 and abs(a - s) > SAME_TARGET_TOLERANCE * s]
        return min(between, key=lambda s: abs(s - a), default=None)

    def _at_travel(self, travel: float, trial: Trial, rate: float) -> None:
        """The moment at which a travel is passed while the force is controlled, by bisection and false position."""
        here, F0 = self.here, self.force
        low, high = here.time, trial.goal.time
        at_low, at_high = np.inf, -np.inf
        t = low + (travel - here.travel) / (trial.goal.travel - here.travel) * (high - low)
        sign = np.sign(trial.goal.travel - here.travel)
        for _ in range(2 * MAX_FORCE_TRIALS):
            found = self._tried(Instant(t, travel, True))
            off = sign * (found.force - (F0 + rate * (t - here.time)))
            if abs(off) <= ASKED_FORCE_TOLERANCE * max(abs(found.force), 1e-300) or high - low <= 1e-9 * max(high, 1.0):
                self._arrive(found, True, True)
                return
            if off > 0.0:
                low, at_low = t, off
            else:
                high, at_high = t, off
            ends = np.isfinite(at_low) and np.isfinite(at_high)
            share = float(np.clip(at_low / (at_low - at_high), 0.05, 0.95)) if ends else 0.5
            t = low + share * (high - low)
        raise NotConverged("contact", f"no moment at which {travel:g} mm are passed", ())

    # ------------------------------------------------------------------------------------------------------- steps

    def _longest(self, began: float) -> float:
        """The longest next step (s): a body that relaxes is followed evenly in the logarithm of time."""
        if not np.isfinite(self.bench.tau):
            return np.inf
        return ELAPSED_TIME_STEP_SHARE * (self.here.time - began) + RELAXATION_TIME_STEP_SHARE * self.bench.tau

    def _tried(self, goal: Instant, near: Trial | None = None) -> Trial:
        """The state at an instant, from where the way is or from one nearby; raises NotConverged, Stopped."""
        b, here = self.bench, self.here
        if goal.travel > self.drive.deepest * (1.0 + TRAVEL_TIME_ROUND_OFF):
            raise self._out_of_reach(self._aim)
        u, rate, s = here.u, here.rate, here.travel
        if near is not None:
            u, rate, s = near.found.evaluation.u, near.found.rate, near.goal.travel
        guess = load_steps.predicted_displacement(b.system, u, (goal.travel - s) * rate)
        if self._first is not None and here.time == 0.0 and near is None:
            guess = self._first
        (found, load, point), rough = self._attempted(goal, guess)
        at, by = (found, load) if point is None else (point.stages[-1].equilibrium, point.stages[-1].load)
        force, slope = b.measure(at.evaluation.contact.force), b.share * _slope(b.system, at, by)
        return Trial(goal, found, load, point, force, slope, rough)

    def _attempted(self, goal: Instant, guess: np.ndarray) -> tuple[tuple[Equilibrium, Load, LoadPoint | None], float]:
        """One step from a guess (n, 3), and the relative residual that round-off leaves of it, 0 where it is tight.

        What round-off leaves is a share of the force that falls as that grows: it is not sought again each time.
        """
        b = self.bench
        least = (
            b.control.tight if goal.asked and not self._on_the_way else max(b.control.tight, PASSING_RESIDUAL_TOLERANCE)
        )
        floor = self._floor[0] * min(self._floor[1] / max(abs(self.force), 1e-300), 1.0) if self.force else 0.0
        for tight in dict.fromkeys((max(least, floor), LIGHT_CONTACT_ROUND_OFF_RESIDUAL)):
            control = replace(b.control, tight=tight, medium=max(b.control.medium, tight))
            limit = (
                load_steps.MAX_ITERATIONS_ON_THE_WAY
                if tight < LIGHT_CONTACT_ROUND_OFF_RESIDUAL
                else load_steps.MAX_ITERATIONS_AS_LAST_RESORT
            )
            try:
                answer = history_steps.attempt(b.system, b.start, self.here, goal, guess, control, b.counters, limit)
                return answer, tight if tight > least else 0.0
            except NotConverged as error:
                near = error.history and min(error.history) < LIGHT_CONTACT_ROUND_OFF_RESIDUAL
                if (
                    tight == LIGHT_CONTACT_ROUND_OFF_RESIDUAL
                    or error.cause == "time_limit"
                    or not (near and goal.asked)
                ):
                    raise
                self._floor = 2.0 * min(error.history), abs(self.force)
        raise AssertionError("the last of the tolerances returns or raises")

    def _solved(self, wanted: Wanted, exact: float) -> Trial:
        """The state that obeys a scalar equation, to a share of its force; raises NotConverged, Stopped."""
        self._on_the_way = exact > ASKED_FORCE_TOLERANCE
        here = self.here
        p, slope, target, most = wanted.first, wanted.slope, wanted.force, self.bench.control.largest
        near: Trial | None = None
        ends: dict[bool, tuple[float, float]] = {}  # whether F ≥ F*: (p, F − F*) nearest to the root
        for _ in range(MAX_FORCE_TRIALS):
            p = min(p, self.drive.deepest) if p > self.drive.deepest and False not in ends else p
            trial = self._tried(Instant(wanted.moment(p), p, True), near)
            off = trial.force - target
            if abs(off) <= max(exact, ROUND_OFF_FORCE_FACTOR * trial.rough) * max(abs(target), 1e-300):
                return trial
            if off < 0.0 and p >= self.drive.deepest * (1.0 - TRAVEL_TIME_ROUND_OFF):
                raise self._out_of_reach(self._aim, trial.force)
            ends[off >= 0.0] = (p, off)
            slope, near = _steepness(trial, near, slope), trial
            if trial.force <= 0.0 < target:  # not touched yet
                new = p + self.bench.control.first
            elif self.force <= 0.0 and off > 0.0 and p > here.travel:
                new = here.travel + (p - here.travel) * (target / trial.force) ** (1.0 / FIRST_CONTACT_EXPONENT)
            elif slope > 0.0:
                new = p - off / slope
            else:
                raise NotConverged("instability", "the force does not rise with the travel", ())
            if len(ends) == 2:
                low, high = sorted(v[0] for v in ends.values())
                new = new if low < new < high else 0.5 * (low + high)
            p = p + float(np.clip(new - p, -most, most))
        raise NotConverged("contact", f"no travel at which the force is {target:.6g} N", ())

    def _arrive(self, trial: Trial, asked: bool, given: bool) -> None:
        """Go on from a state."""
        b, goal, here = self.bench, trial.goal, self.here
        b.counters.steps += 1
        load_steps.proper(b.system, trial.found, here.travel, goal.travel, self.out.points, b.counters)
        if goal.time > here.time:
            self.pace = (goal.travel - here.travel) / (goal.time - here.time)
        self.here = history_steps.arrived(b.system, trial.load, trial.found, goal)
        self.force, self.slope = trial.force, trial.slope
        self.out.way.append(replace(goal, asked=asked))
        if asked:
            assert trial.point is not None  # of an instant that is asked for
            self.out.points.append(replace(history_steps.light(trial.point), leg=self._meshes))
            self.out.given.append(given)
            self.out.slopes.append(trial.slope)
            self.out.left.append(max(ASKED_FORCE_TOLERANCE, ROUND_OFF_FORCE_FACTOR * trial.rough))
        new = None if b.renew is None else b.renew(self.here)
        if new is not None:  # a force that is held is met again by the next step
            self.bench = replace(b, system=new.system, start=new.start)
            self.here, self.force = new.here, new.ratio * self.force
            self._meshes += 1

    def _cut(self, share: float, error: NotConverged) -> float:
        """The share of a step to try after one without equilibrium; raises it where that is too short."""
        self.bench.counters.cutbacks += 1
        if error.cause == "time_limit" or share < MIN_CONTROLLED_STEP_SHARE:
            raise error
        self.here = replace(self.here, rate=np.zeros_like(self.here.rate)) if share < 0.1 else self.here
        return 0.4 * share

    def _out_of_reach(self, force: float, reached: float | None = None) -> Stopped:
        """The end of a way whose force is not met."""
        reached = self.force if reached is None else reached
        text = (
            f"a force of {force:.4g} N is not met: the way ends at {self.drive.deepest:.4g} mm ({self.drive.why}), "
            f"with {reached:.4g} N"
        )
        return Stopped(UNREACHED_FORCE_CAUSE, text, self.out.points, (), self.bench.counters)


def _of_end(t: float, lasts: float) -> float:
    """A moment (s) of a leg, its end where round-off is between them."""
    return lasts if abs(t - lasts) <= 1e-9 * lasts else t


def _steepness(trial: Trial, near: Trial | None, slope: float) -> float:
    """dF/ds (N/mm) for the next trial: of the last two, else that of the tangent, else as given."""
    if near is not None and trial.goal.travel != near.goal.travel:
        secant = (trial.force - near.force) / (trial.goal.travel - near.goal.travel)
        if np.isfinite(secant) and secant > 0.0:
            return secant
    return trial.slope if trial.slope > 0.0 else slope


def _slope(system: System, at: Equilibrium, load: Load) -> float:
    """dF/ds (N/mm) of the modelled part along its way d at one moment, by the tangent: −(D − du/ds)·∂R/∂s, D = d at
    every node: contact depends on x − s d alone, so that ∂F/∂s and ∂F/∂u are ∂R/∂s up to the sign."""
    moving = newton.contact_tangent(system, at.evaluation, load)[1]
    return -float((moving * (load.pressing.direction - at.rate)).sum())
