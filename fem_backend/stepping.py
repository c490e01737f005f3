"""Travel of the indenter in steps: tangent predictor, automatic cut-back, multipliers at the asked travels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fem_backend.newton import Counters, Equilibrium, Load, NotConverged, System, solve


@dataclass(frozen=True)
class Control:
    """Numerical settings of a run.

    `first` and `largest` step (mm); relative residual while travelling, between augmentations and at the end of them;
    augmentations of the multipliers at asked travels; smallest step as a fraction of the first.
    """

    first: float = 0.15
    largest: float = 0.6
    loose: float = 1e-2
    medium: float = 1e-6
    tight: float = 1e-9
    augmentations: int = 1
    smallest: float = 0.02


@dataclass(frozen=True)
class Point:
    """Equilibrium at an asked travel (mm); `previous_force` is the indenter force before the last augmentation (N)."""

    travel: float
    equilibrium: Equilibrium
    previous_force: np.ndarray
    load: Load

    @property
    def force(self) -> np.ndarray:
        """Force of the modelled part of the specimen on the indenter (3,) N."""
        return self.equilibrium.evaluation.contact.force


class Stopped(ArithmeticError):
    """The run ended early: cause class, message, what was reached, residual history."""

    def __init__(
        self, cause: str, message: str, points: list[Point], history: tuple[float, ...], counters: Counters
    ) -> None:
        super().__init__(message)
        self.cause, self.points, self.history, self.counters = cause, points, history, counters


def travel(
    system: System, start: Callable[[float], Load], asked: np.ndarray, control: Control, counters: Counters
) -> list[Point]:
    """Equilibria at the `asked` travels (mm, increasing); `start(s)` is the load at travel s without multipliers.

    Between asked travels the state only has to be near: the body is elastic, so the answer at an asked travel does
    not depend on the way there.  Raises Stopped with what was reached.
    """
    u, rate, here = np.zeros_like(system.body.nodes), np.zeros_like(system.body.nodes), 0.0
    step, points = control.first, []
    for target in asked:
        while here < target - 1e-12:
            goal = target if here + 1.2 * step >= target else here + step
            try:
                found = solve(system, u + (goal - here) * rate, start(goal), control.loose, counters, limit=15)
            except NotConverged as error:
                counters.cutbacks += 1
                step = 0.5 * (goal - here)
                if step < control.smallest * control.first:
                    cause = error.cause if error.cause == "inversion" else "step_limit"
                    message = f"no equilibrium beyond {here:.4g} mm ({error})"
                    raise Stopped(cause, message, points, error.history, counters) from error
                rate = rate if step > control.first / 4 else np.zeros_like(rate)
                continue
            counters.steps += 1
            easy = len(found.history) <= 5
            step = min((goal - here) * (1.6 if easy else 1.0), control.largest) if goal < target else step
            u, rate, here = found.evaluation.u, found.rate, goal
        points.append(_settle(system, u, start(target), target, control, counters, points))
        u, rate = points[-1].equilibrium.evaluation.u, points[-1].equilibrium.rate
    return points


def _settle(
    system: System, u: np.ndarray, load: Load, target: float, control: Control, counters: Counters, points: list[Point]
) -> Point:
    """Tight equilibrium at an asked travel, multipliers λ ← p a fixed number of times (Uzawa)."""
    try:
        found = solve(system, u, load, control.medium if control.augmentations else control.tight, counters)
        previous = found.evaluation.contact.force
        for k in range(control.augmentations):
            load = replace(load, multiplier=found.evaluation.contact.pressure)
            previous = found.evaluation.contact.force
            last = k == control.augmentations - 1
            found = solve(system, found.evaluation.u, load, control.tight if last else control.medium, counters)
    except NotConverged as error:
        raise Stopped(error.cause, f"at {target:.4g} mm: {error}", points, error.history, counters) from error
    return Point(target, found, previous, load)
