"""Travel of the indenter in steps with a predictor and cut-back, for bodies whose answer does not depend on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fem_backend.solver import mixed_newton, modified_newton, newton, rigid_motions
from fem_backend.solver.condensation import Kept
from fem_backend.solver.newton import Counters, Equilibrium, Evaluation, Known, Load, NotConverged, System

# iterations of Newton at most: on the way, and where nothing else is left to try
MAX_ITERATIONS_ON_THE_WAY, MAX_ITERATIONS_AS_LAST_RESORT = 15, 40
# of the first step: above, a step that does not go well on a meridian is halved rather than insisted on
MIN_HALVED_STEP_RATIO = 0.25
# evaluations of a step after which the next may be longer; on a meridian, most of them with old factors; where it is
# sought what touches
MAX_EASY_EVALUATIONS, MAX_EASY_STEP_EVALUATIONS, MAX_EASY_SEEKING_EVALUATIONS = 5, 9, 4
NO_KNOWN_FACTOR: Known = (None, None)  # no factor is known, old ones may be used
SEATED_RESIDUAL_FACTORS = (1.0, 10.0, 100.0)  # times the residual that is left when seated
# augmentations of a support under the weight: 1e-3 mm and less are left of what it sinks in by
N_WEIGHT_AUGMENTATIONS = 4
# factors of the grounding springs until the support carries the body
GROUNDING_SPRING_FACTORS = (1e5, 1e4, 1e3, 1e2, 1e1, 1.0)


@dataclass(frozen=True)
class Control:
    """Numerical settings of a run; lengths in mm for an indenter of 3 mm, see `scaled`.

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

    def scaled(self, length: float) -> Control:
        """Steps for an indenter of that length (mm)."""
        k = length / 3.0
        return replace(self, first=k * self.first, largest=k * self.largest, path=k * self.path)

    def soft(self) -> Control:
        """Without multipliers, and no tighter than the penalty is right."""
        return replace(self, augmentations=0, tight=self.medium)


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
class LoadPoint:
    """Equilibrium at an asked moment: time (s), travel (mm), the stages of its multipliers (the last one counts).

    `leg` counts the meshes that were remade on the way there.
    """

    time: float
    travel: float
    stages: tuple[Stage, ...]
    leg: int = 0

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
    def residual(self) -> float:
        """What may be missing in the force, as a share of it, for what is left out of balance at the worst stage.

        The residual R over the outer forces, and what it makes of the force at least: F = ∂Π/∂s, so to first order
        δF = R : du/ds of an elastic body.
        """
        force = float(np.linalg.norm(self.force))
        left = [s.equilibrium for s in self.stages]
        moved = max(abs(float((e.evaluation.residual * e.rate).sum())) for e in left)
        return max(moved / force if force else 0.0, *(e.history[-1] for e in left))

    @property
    def previous_force(self) -> np.ndarray:
        """The same before the last augmentation."""
        return self.stages[max(len(self.stages) - 2, 0)].equilibrium.evaluation.contact.force


class Stopped(ArithmeticError):
    """The run ended early: cause class, message, points reached (`reached` is the result of them), residual history.

    `last` is the last equilibrium between asked travels, u (n, 3) and its travel (mm), where the run may go on from it.
    """

    reached: Any = None
    last: tuple[np.ndarray, float] | None = None

    def __init__(
        self, cause: str, message: str, points: list[LoadPoint], history: tuple[float, ...], counters: Counters
    ) -> None:
        super().__init__(message)
        self.cause, self.points, self.history, self.counters = cause, points, history, counters


class Worn(Exception):
    """A state whose mesh is to be remade: points reached before, displacement (n, 3) and its travel (mm).

    `reached` is what a path that counts goes on from.
    """

    def __init__(self, points: list[LoadPoint], u: np.ndarray, travel: float, reached: Any = None) -> None:
        super().__init__(f"the mesh is worn at {travel:g} mm")
        self.points, self.u, self.travel, self.reached = points, u, travel, reached


Start = Callable[[float], Load]
Wear = Callable[[np.ndarray, float], bool]  # whether the mesh of u (n, 3) at a travel (mm) is to be made anew
Guess = Callable[[float], Sequence[np.ndarray] | None]  # states (n, 3) at the stages of an asked travel, or fewer
Watch = Callable[[Stage, bool], None]  # called at each stage, and whether it is the last, while its factor is alive


def find_equilibrium(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters,
    limit: int = MAX_ITERATIONS_AS_LAST_RESORT, known: Known | None = None, before: Evaluation | None = None,
) -> Equilibrium:  # fmt: skip
    """Equilibrium from u (n, 3) by Newton in `limit` iterations; an unconstrained body that is lost rolls there.

    A body that may turn does so at once, in three times as many factorisations.  On a meridian the mixed form is tried
    first; `before` is the state from which u was predicted.  Raises NotConverged.
    """
    if mixed_newton.applies(system, load):
        try:
            return mixed_newton.solve(system, u, load, tolerance, counters, known=known, before=before)
        except NotConverged as error:
            if error.cause == "time_limit" or before is not None:
                raise
            counters.fallbacks += 1
    if not rigid_motions.rolls(system):
        try:
            return newton.solve(system, u, load, tolerance, counters, limit, known)
        except NotConverged as error:
            if not system.loose or error.cause == "time_limit":
                raise
    return rigid_motions.solve(system, u, load, tolerance, counters, 3 * limit)


def find_tight(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, known: Known | Kept | None = None,
    before: Evaluation | None = None,
) -> Equilibrium:  # fmt: skip
    """As `find_equilibrium`, with the body's tangent kept where old ones may be used and the system can be condensed.

    That pays where many iterations follow each other at one place.  Raises NotConverged.
    """
    if known is not None and system.condense is not None:
        try:
            return modified_newton.solve(system, u, load, tolerance, counters, known)
        except NotConverged as error:
            if error.cause == "time_limit":
                raise
        known = NO_KNOWN_FACTOR
    assert known is None or isinstance(known, tuple)  # only a condensed system keeps something else
    return find_equilibrium(system, u, load, tolerance, counters, MAX_ITERATIONS_AS_LAST_RESORT, known, before)


def predicted_displacement(system: System, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) after a predicted step (n, 3), whose rigid part is made as one where the body may turn."""
    return (
        rigid_motions.moved_rigidly(rigid_motions.motion(system.body), u, step)
        if rigid_motions.rolls(system)
        else u + step
    )


def seat(system: System, load: Load, u: np.ndarray, control: Control, counters: Counters) -> np.ndarray:
    """Displacement (n, 3) with the grounding springs softened step by step until the contacts carry the body.

    A body that may turn is sought less tightly where it finds no rest otherwise, and counts in `counters.loose`.
    Raises Stopped.
    """
    try:
        for factor in GROUNDING_SPRING_FACTORS:
            u = find_equilibrium(system, u, replace(load, springs=factor), control.loose, counters).evaluation.u
        return _resting(system, load, u, control.seating, control, counters).evaluation.u
    except NotConverged as error:
        raise Stopped(error.cause, f"while seating: {error}", [], error.history, counters) from error


def augmented_equilibrium(
    system: System, load: Load, u: np.ndarray, control: Control, counters: Counters
) -> tuple[np.ndarray, Load]:  # fmt: skip
    """Displacement (n, 3) of a seated body, and its load, once multipliers λ ← p take what its weight sinks in by.

    Raises Stopped.
    """
    tolerance = min(control.medium, control.seating)
    try:
        at = newton.evaluate_system(system, u, load)
        for _ in range(N_WEIGHT_AUGMENTATIONS):
            load = newton.augmented(system, load, at)
            at = _resting(system, load, at.u, tolerance, control, counters).evaluation
    except NotConverged as error:
        raise Stopped(error.cause, f"while seating: {error}", [], error.history, counters) from error
    return at.u, load


def _resting(
    system: System, load: Load, u: np.ndarray, tolerance: float, control: Control, counters: Counters
) -> Equilibrium:
    """Equilibrium as tight as a body that may turn is found at all; raises NotConverged."""
    wanted = max(tolerance, control.seating) if rigid_motions.rolls(system) else tolerance
    allowed = [
        min(k * wanted, max(control.loose, wanted))
        for k in (SEATED_RESIDUAL_FACTORS if rigid_motions.rolls(system) else (1.0,))
    ]
    for allow in dict.fromkeys(allowed):
        try:
            return find_equilibrium(system, u, load, allow, counters)
        except NotConverged as error:
            if error.cause == "time_limit":
                raise
            counters.loose += 1
            lost = error
    raise lost


def follow_travel(
    system: System, start: Start, asked: Sequence[float], control: Control, counters: Counters,
    u: np.ndarray | None = None, guess: Guess | None = None, watch: Watch | None = None,
    here: float = 0.0, worn: Wear | None = None,
) -> list[LoadPoint]:  # fmt: skip
    """Equilibria of a conservative system at the `asked` travels (mm, increasing) from the state u (n, 3) at `here`.

    `start(s)` is the load at travel s without multipliers.  Between asked travels the state only has to be near: the
    answer at an asked travel does not depend on the way there, and `guess(s)` may offer states to start from.
    Raises Stopped with what was reached, and Worn after a step to a state that is `worn`.
    """
    limit = MAX_ITERATIONS_ON_THE_WAY
    system = replace(system, seeking=worn is None)  # elsewhere the steps say where a mesh is made
    u = np.zeros_like(system.body.nodes) if u is None else u
    rate, step, last = np.zeros_like(u), control.first, None
    swift = mixed_newton.applies(system, start(0.0))
    few, many = MAX_EASY_EVALUATIONS, MAX_EASY_STEP_EVALUATIONS
    if swift and system.seeking:
        few = many = MAX_EASY_SEEKING_EVALUATIONS
    amiss = np.zeros_like(u)  # of what is offered, at the travel before
    points: list[LoadPoint] = []
    for target in asked:
        offered = guess(target) if guess is not None else None
        if offered is not None:
            near = [state + amiss for state in offered]
            try:
                points.append(
                    equilibrate(system, near, start(target), target, control, counters, 0.0, watch, NO_KNOWN_FACTOR)
                )
            except NotConverged as error:
                if error.cause == "time_limit":
                    raise stopped_run(error, target, points, counters) from error
            else:
                proper(system, points[-1].stages[-1].equilibrium, here, target, points[:-1], counters)
                u, rate, here = _end(points[-1], target)
                amiss = u - offered[0]
                continue
        known: Known | Kept | None = NO_KNOWN_FACTOR
        while here < target - 1e-12:
            goal = target if here + 1.2 * step >= target else here + step
            try:
                guessed = predicted_displacement(system, u, (goal - here) * rate)
                found = find_equilibrium(
                    system,
                    guessed,
                    start(goal),
                    control.loose,
                    counters,
                    limit,
                    NO_KNOWN_FACTOR,
                    last if step > MIN_HALVED_STEP_RATIO * control.first else None,
                )
            except NotConverged as error:
                counters.cutbacks += 1
                step = 0.5 * (goal - here)
                if step < control.smallest * control.first or error.cause == "time_limit":
                    if not may_go_on(system, limit, error):
                        raise stopped_run(error, here, points, counters, u) from error
                    limit, step = MAX_ITERATIONS_AS_LAST_RESORT, control.first
                rate = rate if step > control.first / 4 else np.zeros_like(rate)
                continue
            counters.steps += 1
            proper(system, found, here, goal, points, counters)
            evaluations = len(found.history)
            step = min((goal - here) * (1.6 if evaluations <= few else 1.0), control.largest) if goal < target else step
            if swift and evaluations <= many:
                step = min(max(step, 1.6 * (goal - here)), control.largest)
            u, rate, here, last = found.evaluation.u, found.rate, goal, found.evaluation
            known = found.known
            if worn is not None and worn(u, here):
                raise Worn(points, u, here)
        try:
            starts = _starts(u, points) if swift else [u]
            points.append(
                equilibrate(system, starts, start(target), target, control, counters, 0.0, watch, known, loose=True)
            )
        except NotConverged as error:
            raise stopped_run(error, target, points, counters, u) from error
        proper(system, points[-1].stages[-1].equilibrium, here, target, points[:-1], counters)
        u, rate, here = _end(points[-1], target)
        last = points[-1].stages[0].equilibrium.evaluation
    return points


def proper(
    system: System, found: Equilibrium, here: float, goal: float, points: list[LoadPoint], counters: Counters
) -> None:
    """Raise Stopped where the displacements between two travels (mm) are beyond small strains.

    With ε = sym ∇u, a line element shrinks to nothing at 1 + ε_min ≤ 0 and the body turns over at det(I + ∇u) ≤ 0: no
    motion has such gradients, whatever its forces.
    """
    if not system.material.small_strain:
        return
    H = found.evaluation.H
    shortest = 1.0 + float(np.linalg.eigvalsh(0.5 * (H + np.swapaxes(H, -1, -2)))[..., 0].min())
    least = float(np.linalg.det(np.eye(3) + H).min())
    if min(shortest, least) <= 0.0:
        raise Stopped(
            "inadmissible", f'law = "{system.material.law.name}": small-strain kinematics end between {here:.4g} '
                            f'and {goal:.4g} mm of travel: det(I + grad u) = {least:.3g}, 1 + smallest strain = '
                            f'{shortest:.3g}. Use a law of finite strain, such as neo_hookean, or smaller depths',
            points, found.history, counters,
        )  # fmt: skip


def may_go_on(system: System, limit: int, error: NotConverged) -> bool:
    """Whether an unconstrained body that is lost after `limit` iterations may be looked for with more patience."""
    return system.loose and limit < MAX_ITERATIONS_AS_LAST_RESORT and error.cause != "time_limit"


def _starts(u: np.ndarray, points: list[LoadPoint]) -> list[np.ndarray]:
    """States (n, 3) from which to begin at u and after its multipliers, which move it about as at the point before."""
    stages = [stage.equilibrium.evaluation.u for stage in points[-1].stages] if points else []
    return [u + (moved - stages[0]) for moved in stages] or [u]


def _end(point: LoadPoint, travel: float) -> tuple[np.ndarray, np.ndarray, float]:
    """State, rate and travel to go on from: those before the multipliers, which the next step does not have."""
    first = point.stages[0].equilibrium
    return first.evaluation.u, first.rate, travel


def stopped_run(
    error: NotConverged, here: float, points: list[LoadPoint], counters: Counters, u: np.ndarray | None = None
) -> Stopped:
    """The end of a run beyond a travel `here` (mm), with the class of its cause; u (n, 3) where it may go on from."""
    kept = ("inversion", "time_limit", "instability")
    cause = error.cause if error.cause in kept else "step_limit"
    stopped = Stopped(cause, f"no equilibrium beyond {here:.4g} mm ({error})", points, error.history, counters)
    stopped.last = None if u is None else (u, here)
    return stopped


def equilibrate(
    system: System, starts: Sequence[np.ndarray], load: Load, target: float, control: Control, counters: Counters,
    time: float = 0.0, watch: Watch | None = None, known: Known | Kept | None = None, loose: bool = False,
) -> LoadPoint:  # fmt: skip
    """Tight equilibrium at an asked travel, multipliers λ ← p a fixed number of times (Uzawa); `known` as in Newton.

    Of the states `starts` (n, 3) the first is where the search begins, the others show what each stage will move.
    A body that hardly resists being turned may be left with a residual of `control.loose`, and counts in
    `counters.loose`, if nothing else is left to try (`loose`).
    Raises NotConverged.
    """
    stages: list[Stage] = []
    u = starts[0]
    for k in range(control.augmentations + 1):
        tolerance = control.tight if k == control.augmentations or known is not None else control.medium
        if mixed_newton.applies(system, load):  # what is left moves the answer by no more than its share
            tolerance = max(
                tolerance,
                mixed_newton.RESIDUAL_TOLERANCE_BEFORE_MULTIPLIERS
                if k < control.augmentations
                else mixed_newton.ASKED_RESIDUAL_TOLERANCE,
            )
        try:
            if 0 < k < len(starts):
                before, moved = stages[-1].equilibrium.evaluation, starts[k] - starts[k - 1]
                found = _found_from(system, before, moved, load, tolerance, counters, known)
            else:
                found = find_tight(system, u, load, tolerance, counters, known)
        except NotConverged as error:
            if not loose or not rigid_motions.rolls(system) or error.cause == "time_limit":
                raise
            counters.loose += 1
            found = find_equilibrium(system, u, load, control.loose, counters)
        known = found.known if known is not None else None
        stages.append(Stage(found, load))
        if watch is not None:
            watch(stages[-1], k == control.augmentations)
        found = replace(found, linear=None, known=None)  # a matrix each
        stages[-1] = Stage(found, load)
        u, load = found.evaluation.u, newton.augmented(system, load, found.evaluation)
    return LoadPoint(time, target, tuple(stages))


def _found_from(
    system: System, at: Evaluation, moved: np.ndarray, load: Load, tolerance: float, counters: Counters,
    known: Known | Kept | None,
) -> Equilibrium:  # fmt: skip
    """As `find_tight`, from a state that is likely to have `moved` (n, 3); on a meridian also from where it was."""
    if not mixed_newton.applies(system, load):
        return find_tight(system, at.u + moved, load, tolerance, counters, known)
    assert known is None or isinstance(known, tuple)
    try:
        return mixed_newton.solve(
            system, at.u + moved, load, tolerance, counters, known=known, before=at, predicted=False
        )
    except NotConverged as error:
        if error.cause == "time_limit":
            raise
    return find_tight(system, at.u, load, tolerance, counters, NO_KNOWN_FACTOR if known else None)
