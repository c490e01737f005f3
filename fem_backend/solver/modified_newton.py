"""Equilibrium with a tangent of the body that is kept while that of the contact is remade.

Modified Newton for the body, Newton for the contact, and what the body's tangent lacks from secants: each step is that
of BFGS with the last pairs s = Δu, y = ΔR and the condensed tangent as first guess (Matthies & Strang 1979; Nocedal &
Wright 2006, algorithm 7.4).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable

import numpy as np

from fem_backend.materials import stress
from fem_backend.solver import newton
from fem_backend.solver.condensation import Kept, OutOfReach
from fem_backend.solver.direct import NotPositiveDefinite, Solve
from fem_backend.solver.newton import Counters, Equilibrium, Evaluation, Known, Load, NotConverged, System

MAX_KEPT_TANGENT_ITERATIONS = 60  # of an equilibrium
MAX_KEPT_TANGENT_RESIDUAL_RATIO = 0.5  # of the residual may be left by a step with a kept tangent
# relative residual at which a step that leaves more than that ends the iteration: round-off
KEPT_TANGENT_ROUND_OFF_RESIDUAL = 1e-8
CALM_CONTACT_RESIDUAL = 0.1  # relative residual below which contact hardly changes and pairs are worth remembering
N_REMEMBERED_PAIRS = 5  # pairs of change and residual that the quasi-Newton update uses
# of the residual left by two steps each, and the residual above which a new tangent pays then
SLOW_STEP_RESIDUAL_RATIO, MIN_NEW_TANGENT_RESIDUAL = 0.2, 1e-5

Pair = tuple[np.ndarray, np.ndarray]  # s, y


def solve(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, known: Known | Kept | None = None
) -> Equilibrium:
    """As :func:`fem_backend.solver.newton.solve`, for systems that can be condensed; `known` is that of a state nearby.

    Raises NotConverged.
    """
    body = system.body
    history: list[float] = []
    kept, fresh, age = known if callable(known) else None, False, 0
    pairs: deque[Pair] = deque(maxlen=N_REMEMBERED_PAIRS)
    try:
        at = newton.evaluate_system(system, u, load)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    R = newton.reduced(body, at.residual)
    while len(history) < MAX_KEPT_TANGENT_ITERATIONS:
        norm = float(np.linalg.norm(R))
        history.append(norm / at.scale if at.scale > 0 else float(norm > 0))
        if time.process_time() > counters.deadline:
            raise NotConverged("time_limit", "the time of the run is used up", tuple(history))
        slow = len(history) > 1 and history[-1] > MAX_KEPT_TANGENT_RESIDUAL_RATIO * history[-2]
        if age > 2 and MIN_NEW_TANGENT_RESIDUAL < history[-1] < CALM_CONTACT_RESIDUAL:
            slow = slow or history[-1] > SLOW_STEP_RESIDUAL_RATIO**2 * history[-3]
        found = (
            history[-1] <= tolerance
            or (slow and history[-1] < KEPT_TANGENT_ROUND_OFF_RESIDUAL)
            or (fresh and newton.at_round_off(history))
        )
        if slow and not (fresh or found):
            kept = None
        fresh = kept is None
        age = 0 if fresh else age + 1
        if fresh:
            pairs.clear()
        try:
            kept, solution, moving = _tangent(
                system, at, load, counters, kept, history[-1] < newton.MAX_CONTACT_GEOMETRY_RESIDUAL
            )
        except OutOfReach as error:
            raise NotConverged("contact", str(error), tuple(history)) from error
        solution = _corrected(solution, tuple(pairs))
        if found:
            linear = lambda v, solution=solution: newton.full(body, solution(newton.reduced(body, v)))  # noqa: E731
            return Equilibrium(at, -linear(moving), tuple(history), linear, kept)
        counters.iterations += 1
        step, before = solution(-R), (at.u, R)
        at = newton.line_search(system, at, newton.full(body, step), float(R @ step), load, counters, history)
        R = newton.reduced(body, at.residual)
        s, y = newton.reduced(body, at.u - before[0]), R - before[1]
        if history[-1] < CALM_CONTACT_RESIDUAL and s @ y > 0.0:
            pairs.append((s, y))
    raise NotConverged("contact", f"no equilibrium after {MAX_KEPT_TANGENT_ITERATIONS} iterations", tuple(history))


def _tangent(
    system: System, at: Evaluation, load: Load, counters: Counters, kept: Kept | None, geometric: bool
) -> tuple[Kept, Solve, np.ndarray]:
    """What is kept, a solution with the contact as it is now, and ∂R/∂s (n, 3)."""
    if kept is not None:
        touching, moving = newton.contact_tangent(system, at, load, geometric)
        try:
            return kept, kept(touching), moving
        except NotPositiveDefinite:
            counters.shifts += 1

    def make(body: np.ndarray, touching: np.ndarray) -> tuple[Kept, Solve]:
        assert system.condense is not None
        new = system.condense(body, touching)
        return new, new(touching)

    (kept, solution), moving = newton.factorise(system, at, load, counters, geometric, make)
    return kept, solution, moving


def _corrected(solution: Solve, pairs: Iterable[Pair]) -> Solve:
    """b → H b of BFGS by its two loops, H₀ the solution given."""
    known = [(s, y, float(s @ y)) for s, y in pairs]

    def correct(b: np.ndarray) -> np.ndarray:
        a, shares = b, []
        for s, y, sy in reversed(known):
            shares.append(float(s @ a) / sy)
            a = a - shares[-1] * y
        x = solution(a)
        for (s, y, sy), share in zip(known, reversed(shares), strict=True):
            x = x + (share - float(y @ x) / sy) * s
        return x

    return correct
