"""Equilibrium of a body under an indenter at a given place: Newton on the potential with an energy line search."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem_backend import contact, element, stress
from fem_backend.contact import ContactState, ContactSurface
from fem_backend.element import Body
from fem_backend.geometry import Sphere
from fem_backend.laws import Law
from fem_backend.linsolve import Factor, NotPositiveDefinite, Solve
from fem_backend.stress import PointState

FAR = 0.3  # relative residual above which the negative contact term is left out: it would only spoil the matrix


class NotConverged(ArithmeticError):
    """No equilibrium was found; carries the cause class and the residual history (relative)."""

    def __init__(self, cause: str, message: str, history: tuple[float, ...]) -> None:
        super().__init__(message)
        self.cause, self.history = cause, history


@dataclass(frozen=True)
class System:
    """Everything that stays the same during a run; ε (f, q) in MPa/mm at the contact points."""

    body: Body
    law: Law
    surface: ContactSurface
    indenter: Sphere
    epsilon: np.ndarray
    factor: Factor


@dataclass(frozen=True)
class Load:
    """Where the indenter's centre is (3,), the multipliers λ (f, q) MPa, the way it moves (3,).

    `raised` (f, q) multiplies the penalty of the system.
    """

    centre: np.ndarray
    multiplier: np.ndarray
    direction: np.ndarray
    raised: np.ndarray | float = 1.0


@dataclass(frozen=True)
class Evaluation:
    """Potential Π (N mm) and residual R = ∂Π/∂u (n, 3) N at a displacement u (n, 3) mm."""

    u: np.ndarray
    energy: float
    residual: np.ndarray
    contact: ContactState
    H: np.ndarray


@dataclass
class Counters:
    """Work done so far."""

    iterations: int = 0
    factorisations: int = 0
    halvings: int = 0
    shifts: int = 0
    steps: int = 0
    cutbacks: int = 0


@dataclass(frozen=True)
class Equilibrium:
    """A converged state, the residual history (relative) and du/ds (n, 3), s being the indenter's travel."""

    evaluation: Evaluation
    rate: np.ndarray
    history: tuple[float, ...] = field(default=())


def evaluate(system: System, u: np.ndarray, load: Load) -> Evaluation:
    """Potential and residual; raises stress.Inverted when an element is inside out."""
    H = element.displacement_gradients(system.body, u)
    state = stress.evaluate(system.law, H, tangent=False)
    inside = element.internal_force(system.body, state.F, state.S)
    touch = contact.evaluate(
        system.surface,
        system.body.nodes + u,
        system.indenter,
        load.centre,
        system.epsilon * load.raised,
        load.multiplier,
    )
    energy = float((system.body.w * state.energy).sum()) + touch.energy
    return Evaluation(u, energy, inside + touch.residual, touch, H)


def factorise(
    system: System, at: Evaluation, load: Load, counters: Counters, geometric: bool = True
) -> tuple[Solve, np.ndarray]:
    """Factor of the tangent at a state and ∂R/∂s (n, 3).

    A matrix that is not positive definite is retried without the negative contact term, then with a growing shift of
    its diagonal, so that Newton always gets a direction of descent.
    """
    state: PointState = stress.evaluate(system.law, at.H, tangent=True)
    bulk = element.stiffness(system.body, state.F, state.S_geometric, state.C)
    diagonal = system.body.pattern.indptr[:-1]  # the first entry of each row of an upper triangle
    shift = 0.0
    for _ in range(8):
        data = bulk.copy()
        moving = contact.tangent(
            system.surface, system.body.nodes + at.u, system.indenter, load.centre, system.epsilon * load.raised,
            at.contact.pressure, load.direction, data, geometric,
        )  # fmt: skip
        if shift:
            data[diagonal] += shift
        counters.factorisations += 1
        try:
            return system.factor(data), moving
        except NotPositiveDefinite:
            counters.shifts += 1
            if geometric:
                geometric = False
            else:
                shift = 10.0 * shift or 1e-3 * float(np.median(bulk[diagonal]))
    raise NotConverged("instability", "the tangent stays indefinite", ())


def solve(
    system: System, u: np.ndarray, load: Load, tolerance: float, counters: Counters, limit: int = 40
) -> Equilibrium:
    """Equilibrium from the start u (n, 3): |R| ≤ tolerance · |contact force|, both over free dofs.

    Raises NotConverged (instability, contact or inversion) after `limit` iterations or a failed line search.
    """
    free = system.body.free.reshape(u.shape)
    mask = free >= 0
    index = free[mask]
    history: list[float] = []

    def reduced(v: np.ndarray) -> np.ndarray:
        out = np.empty(system.body.pattern.size)
        out[index] = v[mask]
        return out

    def full(v: np.ndarray) -> np.ndarray:
        out = np.zeros_like(u)
        out[mask] = v[index]
        return out

    try:
        at = evaluate(system, u, load)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    for _ in range(limit):
        R = reduced(at.residual)
        scale = float(np.linalg.norm(at.contact.residual))
        history.append(float(np.linalg.norm(R)) / scale if scale > 0 else float(np.linalg.norm(R) > 0))
        if history[-1] > tolerance or len(history) == 1:
            factor, moving = factorise(system, at, load, counters, history[-1] < FAR)
        if history[-1] <= tolerance:  # the rate is only a predictor: the last factor is good enough
            return Equilibrium(at, full(factor(-reduced(moving))), tuple(history))
        counters.iterations += 1
        step = factor(-R)
        at = _line_search(system, at, full(step), float(R @ step), load, counters, tuple(history))
    raise NotConverged("contact", f"no equilibrium after {limit} iterations", tuple(history))


def _line_search(
    system: System, at: Evaluation, step: np.ndarray, slope: float, load: Load, counters: Counters,
    history: tuple[float, ...],
) -> Evaluation:  # fmt: skip
    """First α = 1, ½, ¼ … that lowers the potential (Armijo) or, near the solution, the residual."""
    alpha = 1.0
    norm = float(np.linalg.norm(at.residual[system.body.free.reshape(at.u.shape) >= 0]))
    inverted = False
    while alpha > 1e-4:
        try:
            trial = evaluate(system, at.u + alpha * step, load)
        except stress.Inverted:
            inverted = True
        else:
            if trial.energy <= at.energy + 1e-4 * alpha * slope:
                return trial
            if np.linalg.norm(trial.residual[system.body.free.reshape(at.u.shape) >= 0]) < 0.9 * norm:
                return trial
            if abs(slope) < 1e-13 * abs(at.energy):
                return trial  # at round-off of the energy: nothing left to gain
        alpha *= 0.5
        counters.halvings += 1
    raise NotConverged("inversion" if inverted else "instability", "the line search found no descent", history)
