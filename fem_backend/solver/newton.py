"""Equilibrium of a body touched by rigid bodies: Newton with a line search."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from fem_backend.contact import tractions
from fem_backend.contact.tractions import ContactState, Pair, Touch
from fem_backend.kinematics.bodies import Body
from fem_backend.materials import response, stress
from fem_backend.materials.regions import Substance
from fem_backend.materials.stress import History
from fem_backend.solver.condensation import Condense, Kept
from fem_backend.solver.direct import (
    DOUBLE_PRECISION_TOLERANCE,
    SINGLE_PRECISION_TOLERANCE,
    Factor,
    NotPositiveDefinite,
    Solve,
)

# relative residual above which the negative contact term is left out: it would only spoil the matrix
MAX_CONTACT_GEOMETRY_RESIDUAL = 0.3

MAX_CHORD_RESIDUAL_RATIO = 0.1  # of the residual may be left by a step with an old factor
MAX_CHORD_START_RESIDUAL = 0.05  # relative residual below which an old factor is tried
# times the guessed round-off, and the residual that it never excuses
ROUND_OFF_FACTOR, MAX_EXCUSED_RESIDUAL = 10.0, 1e-4
# relative residual below which a step with a new factor that gains nothing has met round-off
NEWTON_ROUND_OFF_RESIDUAL = 1e-7
Make = Callable[[np.ndarray, np.ndarray], Any]
Known = tuple[Solve | None, np.ndarray | None]  # a factor and ∂R/∂s that went with it


class NotConverged(ArithmeticError):
    """No equilibrium was found; carries the cause class and the residual history (relative)."""

    def __init__(self, cause: str, message: str, history: tuple[float, ...]) -> None:
        super().__init__(message)
        self.cause, self.history = cause, history


@dataclass(frozen=True)
class System:
    """Everything that stays the same during a run.

    `indenter` and the pairs of the `seat`, which the support offers, are the surfaces that may touch rigid bodies;
    `scale` (m, q) multiplies all moduli; `dead` (n, 3) N is a dead load, `springs` (n,) N/mm ground every component of
    a node of a body that its support does not hold, `least_force` (N) is the force below which the residual is no
    longer measured relative to the load.  `seeking` saves iterations on a meridian, where the lengths of the steps
    may be others.
    """

    body: Body
    material: Substance
    indenter: Pair | None
    seat: tuple[Pair, ...]
    factor: Factor
    scale: np.ndarray | None = None
    dead: np.ndarray | None = None
    springs: np.ndarray | None = None
    least_force: float = 0.0
    condense: Condense | None = None
    seeking: bool = False

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All that may touch, in the order of `Load.touches`."""
        return (*(() if self.indenter is None else (self.indenter,)), *self.seat)

    @property
    def pressing(self) -> Pair:
        """The pair of the indenter, which a system has once something presses."""
        assert self.indenter is not None
        return self.indenter

    @property
    def grounded(self) -> np.ndarray:
        """Springs (n,) N/mm of an unconstrained body."""
        assert self.springs is not None
        return self.springs

    @property
    def loose(self) -> bool:
        """Whether the support leaves rigid motions, which contact alone takes away."""
        return self.springs is not None

    def each(self, change: Callable[[Pair], Pair]) -> System:
        """The system with every pair changed."""
        indenter = None if self.indenter is None else change(self.indenter)
        return replace(self, indenter=indenter, seat=tuple(change(p) for p in self.seat))


@dataclass(frozen=True)
class Load:
    """One load step: how each pair touches, share of the dead load, factor of the springs, history and Δt (s)."""

    indenter: Touch | None
    seat: tuple[Touch, ...] = ()
    dead: float = 1.0
    springs: float = 1.0
    history: History | None = None
    dt: float = 0.0

    @property
    def touches(self) -> tuple[Touch, ...]:
        """How every pair touches, in the order of `System.pairs`."""
        return (*(() if self.indenter is None else (self.indenter,)), *self.seat)

    @property
    def pressing(self) -> Touch:
        """How the indenter touches, of a load that presses."""
        assert self.indenter is not None
        return self.indenter

    def touching(self, touches: Iterable[Touch]) -> Load:
        """The load with other touches, in the order of `touches`."""
        new = tuple(touches)
        return (
            replace(self, indenter=None, seat=new)
            if self.indenter is None
            else replace(self, indenter=new[0], seat=new[1:])
        )

    @property
    def conservative(self) -> bool:
        """Whether one potential governs the step (all but for the turning of normals): no friction, or Tresca's."""
        return all(t.before is None or t.before.pressure is not None for t in self.touches)


@dataclass(frozen=True)
class Evaluation:
    """Potential Π (N mm), residual R = ∂Π/∂u (n, 3) N at a displacement u (n, 3) mm, `scale` of the forces (N).

    `history` is the material's history at the end of the step, should it end here.
    """

    u: np.ndarray
    energy: float
    residual: np.ndarray
    contacts: tuple[ContactState, ...]
    H: np.ndarray
    history: History | None
    scale: float

    @property
    def contact(self) -> ContactState:
        """Contact with the indenter."""
        return self.contacts[0]

    @property
    def seat(self) -> tuple[ContactState, ...]:
        """Contacts with the support."""
        return self.contacts[1:]


@dataclass
class Counters:
    """Work done so far, steps that were left less tight; `deadline` (s of process time) ends a run."""

    iterations: int = 0
    factorisations: int = 0
    halvings: int = 0
    shifts: int = 0
    steps: int = 0
    cutbacks: int = 0
    loose: int = 0
    fallbacks: int = 0
    deadline: float = np.inf


@dataclass(frozen=True)
class Equilibrium:
    """A converged state, the residual history (relative) and du/ds (n, 3) with s the indenter's travel.

    `linear` solves with the last tangent, (n, 3) → (n, 3), until the next factorisation.
    """

    evaluation: Evaluation
    rate: np.ndarray
    history: tuple[float, ...] = field(default=())
    linear: Callable[[np.ndarray], np.ndarray] | None = field(default=None, repr=False)
    known: Known | Kept | None = field(default=None, repr=False)


def evaluate_system(system: System, u: np.ndarray, load: Load) -> Evaluation:
    """Potential and residual; raises stress.Inverted when an element is inside out."""
    body = system.body
    answer = response.material_response(body, system.material, u, load.history, load.dt, system.scale)
    residual, energy = answer.force, answer.energy
    contacts, outside = contact_states(system, u, load), 0.0
    for state in contacts:
        residual += state.residual
        energy += state.energy
        outside += float((state.residual**2).sum())
    if system.dead is not None and load.dead:
        residual -= load.dead * system.dead
        energy -= load.dead * float((system.dead * u).sum())
        outside += load.dead**2 * float((system.dead**2).sum())
    if system.loose:
        pull = load.springs * system.grounded[:, None] * u
        residual += pull
        energy += 0.5 * float((pull * u).sum())
    scale = max(float(np.sqrt(outside)), system.least_force)
    return Evaluation(u, energy, residual, contacts, answer.H, answer.history, scale)


def contact_states(system: System, u: np.ndarray, load: Load) -> tuple[ContactState, ...]:
    """Contact of every pair, in the order of `System.pairs`, at a displacement u (n, 3) mm."""
    x = system.body.nodes + u
    return tuple(tractions.evaluate_contact(p, x, touch) for p, touch in zip(system.pairs, load.touches, strict=True))


def system_tangent(system: System, at: Evaluation, load: Load, geometric: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Data of the whole tangent at a state, and ∂R/∂s (n, 3)."""
    data = bulk_tangent(system, at, load)
    touching, moving = contact_tangent(system, at, load, geometric)
    data += touching
    return data, moving


def factorise(
    system: System, at: Evaluation, load: Load, counters: Counters, geometric: bool = True, make: Make | None = None
) -> tuple[Any, np.ndarray]:
    """Factor of the tangent at a state, and ∂R/∂s (n, 3); or what else to `make` of the data of body and contact.

    A matrix that is not positive definite is retried without the negative contact term, then with a growing shift of
    its diagonal, so that Newton always gets a direction of descent.
    """
    body, bulk, shift = system.body, bulk_tangent(system, at, load), 0.0
    make = make or (lambda body, touching: system.factor(body + touching))
    for _ in range(8):
        touching, moving = contact_tangent(system, at, load, geometric)
        shifted = bulk.copy() if shift else bulk  # the body, as contact is condensed to the dofs that touch
        shifted[body.pattern.diagonal] += shift
        counters.factorisations += 1
        try:
            return make(shifted, touching), moving
        except NotPositiveDefinite:
            counters.shifts += 1
            if geometric:
                geometric = False
            else:
                shift = 10.0 * shift or 1e-3 * float(np.median(bulk[body.pattern.diagonal]))
    raise NotConverged("instability", "the tangent stays indefinite", ())


def contact_tangent(
    system: System, at: Evaluation, load: Load, geometric: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Data of the tangent of all contacts, and ∂R/∂s (n, 3)."""
    data, moving = np.zeros(len(system.body.pattern.indices)), np.zeros_like(at.u)
    for pair, touch, touching in zip(system.pairs, load.touches, at.contacts, strict=True):
        moving += tractions.add_contact_tangent(pair, system.body.nodes + at.u, touch, touching, data, geometric)
    return data, moving


def bulk_tangent(system: System, at: Evaluation, load: Load) -> np.ndarray:
    """Data of the tangent of the body and its springs."""
    body = system.body
    return sprung(
        system, load, response.material_tangent(body, system.material, at.H, load.history, load.dt, system.scale)
    )


def sprung(system: System, load: Load, bulk: np.ndarray) -> np.ndarray:
    """Data of the tangent of a body with its springs added in place."""
    body = system.body
    if system.loose:
        held = body.free.reshape(-1, 3)
        springs = np.repeat(load.springs * system.grounded, 3)[(held >= 0).ravel()]
        bulk[body.pattern.diagonal[held[held >= 0]]] += springs
    return bulk


def reduced(body: Body, v: np.ndarray) -> np.ndarray:
    """Free components (f,) of a nodal field (n, 3) in the order of the matrix."""
    return v.ravel()[body.places]


def full(body: Body, v: np.ndarray) -> np.ndarray:
    """Nodal field (n, 3) from its free components (f,), zero where held."""
    out = np.zeros(body.free.shape)
    out[body.places] = v
    return out.reshape(-1, 3)


def solve(
    system: System,
    u: np.ndarray,
    load: Load,
    tolerance: float,
    counters: Counters,
    limit: int = 40,
    known: Known | None = None,
) -> Equilibrium:
    """Equilibrium from the start u (n, 3): |R| ≤ tolerance · |outer forces|, over free dofs.

    With `known`, the factor of a state nearby, and close to the solution a factor is used as long as each step with it
    leaves less than `MAX_CHORD_RESIDUAL_RATIO` of the residual (chord method: a solution costs a twentieth of a
    factorisation).  Only for bodies whose answer does not depend on the iterates.
    Raises NotConverged (instability, contact, inversion or time_limit) after `limit` factorisations or a failed line
    search.
    """
    body = system.body
    history: list[float] = []
    factor, moving = known or (None, None)
    fresh, allowed, accuracy = False, limit, DOUBLE_PRECISION_TOLERANCE if known is None else SINGLE_PRECISION_TOLERANCE
    try:
        at = evaluate_system(system, u, load)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    while limit > 0:
        R = reduced(body, at.residual)
        norm = float(np.linalg.norm(R))
        history.append(norm / at.scale if at.scale > 0 else float(norm > 0))
        if time.process_time() > counters.deadline:
            raise NotConverged("time_limit", "the time of the run is used up", tuple(history))
        found = history[-1] <= tolerance or (fresh and at_round_off(history, partial(round_off, system, at)))
        lazy = known is not None and factor is not None
        if lazy and len(history) > 1:
            lazy = (
                history[-1] < (MAX_CHORD_RESIDUAL_RATIO if not fresh else 0.3) * history[-2]
                and history[-1] < MAX_CHORD_START_RESIDUAL
            )
        if not lazy and (not found or len(history) == 1):
            factor = None  # a matrix is tens of megabytes: the old one goes first
            factor, moving = factorise(system, at, load, counters, history[-1] < MAX_CONTACT_GEOMETRY_RESIDUAL)
            limit -= 1
        assert factor is not None and moving is not None  # at least of an iteration before
        fresh = not lazy
        if found:  # rate and sensitivities: the last factor is good enough
            linear = lambda v, factor=factor: full(body, factor(reduced(body, v), accuracy))  # noqa: E731
            return Equilibrium(at, -linear(moving), tuple(history), linear, (factor, moving))
        counters.iterations += 1
        try:
            step = factor(-R, accuracy)
        except NotPositiveDefinite as error:  # some find that out here only
            raise NotConverged("instability", "the tangent is indefinite", tuple(history)) from error
        exact = load.conservative and (history[-1] > 1e-2 or not any(t.before for t in load.touches))
        search = line_search if exact else _balance
        at = search(system, at, full(body, step), float(R @ step), load, counters, history)
    raise NotConverged("contact", f"no equilibrium after {allowed} iterations with new factors", tuple(history))


def at_round_off(history: Sequence[float], noise: Callable[[], float] = lambda: 0.0) -> bool:
    """Whether a step with a new factor has gained nothing any more, after the last of the residuals `history`.

    Nearly incompressible bodies that are hardly touched end there: their volumetric stresses are 10³ times those under
    the ball, and so is the round-off of their sums.  `noise` shows that of a body, see `round_off`.
    """
    gained = len(history) < 2 or history[-1] <= 0.5 * history[-2]
    return not gained and (
        history[-1] < NEWTON_ROUND_OFF_RESIDUAL or history[-1] < min(ROUND_OFF_FACTOR * noise(), MAX_EXCUSED_RESIDUAL)
    )


def round_off(system: System, at: Evaluation) -> float:
    """Relative residual (a guess) of the round-off in stresses, δ = ε_machine (K + μ) at each point, of any sign:

        |R|² = Σ (δ w |∂N|)²

    over points and shape functions.  A half-space has elements of a hundred lengths of the indenter far from it, whose
    forces are round-off of large numbers; they are no part of what the indenter feels.
    """
    body, s = system.body, 1.0 if system.scale is None else system.scale
    modulus = response.modulus_at_points(body, system.material)
    each = (s * body.w)[..., None] * np.linalg.norm(body.G, axis=-1)
    return float(np.finfo(float).eps * modulus * np.sqrt((each**2).sum()) / at.scale)


def line_search(
    system: System,
    at: Evaluation,
    step: np.ndarray,
    slope: float,
    load: Load,
    counters: Counters,
    history: list[float],
) -> Evaluation:
    """First α = 1, ½, ¼ … that lowers the potential (Armijo) or, near the solution, the residual."""
    alpha, inverted = 1.0, False
    norm = float(np.linalg.norm(reduced(system.body, at.residual)))
    while alpha > 1e-4:
        try:
            trial = evaluate_system(system, at.u + alpha * step, load)
        except stress.Inverted:
            inverted = True
        else:
            if trial.energy <= at.energy + 1e-4 * alpha * slope:
                return trial
            if np.linalg.norm(reduced(system.body, trial.residual)) < 0.9 * norm:
                return trial
            if abs(slope) < 1e-13 * abs(at.energy):
                return trial  # at round-off of the energy: nothing left to gain
        alpha *= 0.5
        counters.halvings += 1
    raise NotConverged("inversion" if inverted else "instability", "the line search found no descent", tuple(history))


def _balance(
    system: System,
    at: Evaluation,
    step: np.ndarray,
    slope: float,
    load: Load,
    counters: Counters,
    history: list[float],
) -> Evaluation:
    """α whose residual is nearly normal to the step, |d·R(u + α d)| ≤ 0.7 |d·R(u)|, by false position.

    Friction has no potential, but along one step the work of the residual behaves like the slope of one (Crisfield
    1991, §9.2.2).
    """
    low, high, at_low, at_high = 0.0, np.inf, slope, 0.0
    alpha, best, inverted = 1.0, None, False
    d = reduced(system.body, step)
    for _ in range(8):
        try:
            trial = evaluate_system(system, at.u + alpha * step, load)
        except stress.Inverted:
            inverted = True
            high, at_high = alpha, np.inf
            alpha = 0.5 * (low + alpha)
            counters.halvings += 1
            continue
        best = trial
        work = float(d @ reduced(system.body, trial.residual))
        if abs(work) <= 0.7 * abs(slope) or (work < 0.0 and high == np.inf):
            break
        counters.halvings += 1
        if work > 0.0:
            high, at_high = alpha, work
        else:
            low, at_low = alpha, work
        share = at_low / (at_low - at_high) if np.isfinite(at_high) else 0.5
        alpha = low + min(max(share, 0.1), 0.9) * (high - low)
    if best is None:
        cause = "inversion" if inverted else "contact"
        raise NotConverged(cause, "no step without inside-out elements", tuple(history))
    return best


def augmented(system: System, load: Load, at: Evaluation) -> Load:
    """The load with multipliers λ ← p on every pair that is not soft (Uzawa)."""
    of_all = zip(system.pairs, load.touches, at.contacts, strict=True)
    return load.touching(t if p.soft else replace(t, multiplier=s.multiplier) for p, t, s in of_all)
