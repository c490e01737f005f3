"""Flow of liquid through a deforming body of revolution: displacements and pore pressure in one Newton.

    div(σ − p 1) = 0,   J̇ + Div(−k J C⁻¹ ∇p) = 0,

σ the stress of the drained solid by its own law, p the pore pressure, k(J) the permeability (mm⁴/(N s)); solid
and liquid are incompressible by themselves (Biot 1941; Mow, Kuei, Lai and Armstrong 1980, J. Biomech. Eng. 102, 73).
For k → ∞ it is the drained solid at every moment, for k → 0 an incompressible one.  Where the liquid gives way by S
(1/MPa) the first term of the balance is the rate of J − 1 + S p, and for k → 0 the bulk modulus K + 1/S.

In time by the second-order backward difference with steps of any length, a step back of first order at every corner
of the programme:

    v_n+1 − v̄ = Δ Div(k J C⁻¹ ∇p),   v̄ = ((1 + ω)² v_n − ω² v_n−1)/(1 + 2ω),   Δ = (1 + ω)/(1 + 2ω) δt,

v = J − 1 + S p and ω the ratio of this step to the one before (Hairer, Nørsett and Wanner 1993, §III.5); ω = 0 is
backward Euler.  Contact is that of :mod:`.mixed_newton`: which points touch is found from the pressures of the linear
step.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fem_backend.contact import tractions
from fem_backend.contact.bonded import glued
from fem_backend.contact.tractions import ContactState
from fem_backend.kinematics import axisymmetric, pore_pressure
from fem_backend.kinematics.pore_pressure import OpenEdges, PorousMeridian
from fem_backend.materials import response, stress
from fem_backend.materials.permeability import HolmesMow
from fem_backend.materials.stress import History
from fem_backend.solver import load_steps, newton
from fem_backend.solver.direct import Factor, NotPositiveDefinite, Solve
from fem_backend.solver.load_steps import Control, Instant, LoadPoint, Stage, Start
from fem_backend.solver.mixed_newton import MAX_RESIDUAL_GROWTH, MIN_NEWTON_STEP_SHARE, NEW_CONTACT_PRESSURE
from fem_backend.solver.newton import Counters, Equilibrium, Evaluation, Load, NotConverged, System

# k over the length of an edge, times this: what leaves through it does so as through a hundredth of it
OPEN_EDGE_LEAK_FACTOR = 100.0
SEALED_GAP_RATIO = 1e-3  # of the length of an edge: a gap that lets nothing pass
# the same beside a sealed contact: what elements there let out too early at the edge, of first order
CONTACT_EDGE_LEAK_FACTOR = 1.4
N_EDGES_BESIDE_CONTACT = 2  # edges from a sealed contact that count as beside it
MAX_SEALING_ITERATIONS = 4  # iterations after which the points that are sealed stay as they are
MAX_COUPLED_ITERATIONS = 25  # of Newton for displacements and pressures together, in a step
MIN_DRAINAGE_STEP_SHARE = 1 / 64  # of the way to an instant: a step that is given up

Pressures = tuple[np.ndarray | None, ...]  # (f, q) MPa of each pair that acts per current area, None of others


@dataclass(frozen=True)
class Pores:
    """The liquid of a body: its pressures, permeability k₀ (mm⁴/(N s)), the unit (MPa/mm) that masses count in, how
    much it gives way, S (1/MPa), and how k/k₀ `closes` with J.

    Liquid leaves through the edges `open`, and through those that `may_close`, in the order of the surface under a
    sealed indenter, where they do not touch it.
    """

    space: PorousMeridian
    permeability: float
    unit: float
    factor: Factor
    open: OpenEdges
    may_close: OpenEdges | None
    storage: float = 0.0
    closes: HolmesMow = field(default_factory=HolmesMow)


@dataclass(frozen=True)
class TimeStep:
    """v̄ (m, q) and Δ (s) of the step to solve for, and its end (s)."""

    volume: np.ndarray
    length: float
    end: float


@dataclass(frozen=True)
class CoupledState:
    """An evaluation whose residual holds the pore pressure p (v,) MPa; v (m, q) = J − 1 + S p, missing volume (v,) mm³.

    `sealed` (f, q) are the points under the indenter that let nothing pass.
    """

    at: Evaluation
    p: np.ndarray
    v: np.ndarray
    missing: np.ndarray
    sealed: np.ndarray


@dataclass(frozen=True)
class DrainagePoint:
    """What a path goes on from: moment, state, the volume change and the length (s) of the step before, rates per s."""

    time: float
    travel: float
    u: np.ndarray
    p: np.ndarray
    v: np.ndarray
    before: np.ndarray
    step: float
    du: np.ndarray
    dp: np.ndarray
    slope: float
    history: History | None


def follow_coupled(
    system: System,
    pores: Pores,
    start: Start,
    instants: Sequence[Instant],
    control: Control,
    counters: Counters,
    u: np.ndarray,
    history: History | None = None,
) -> list[LoadPoint]:
    """Equilibria at the asked instants of a body at rest at u (n, 3) with no pore pressure.

    Multipliers at an asked instant are a side branch, as in :func:`.history_steps.follow`.  A step without equilibrium
    is halved.  Raises Stopped with what was reached.
    """
    v = pore_pressure.volume_change(axisymmetric.displacement_gradients(pores.space.body, u), small(system))
    none = np.zeros(len(pores.space.vertices))
    here = DrainagePoint(0.0, 0.0, u, none, v, v, 0.0, np.zeros_like(u), none, 0.0, history)
    points: list[LoadPoint] = []
    for instant in instants:
        share, begin = 1.0, here.time
        while here.time < instant.time:
            goal = instant if share >= 0.9 else _between(here, instant, share)
            try:
                here, point = _step(system, pores, start, here, goal, control, counters)
            except NotConverged as error:
                counters.cutbacks += 1
                share *= 0.5
                lost = share * (instant.time - here.time) < MIN_DRAINAGE_STEP_SHARE * (instant.time - begin)
                if lost or error.cause == "time_limit":
                    raise load_steps.stopped_run(error, here.travel, points, counters) from error
                here = replace(here, du=np.zeros_like(here.du), dp=np.zeros_like(here.dp))
                continue
            counters.steps += 1
            share = 1.0
            points += [] if point is None else [point]
    return points


def small(system: System) -> bool:
    """Whether strains are small ones."""
    return bool(system.material.small_strain)


def _between(here: DrainagePoint, instant: Instant, share: float) -> Instant:
    moment, way = instant.time - here.time, instant.travel - here.travel
    return Instant(here.time + share * moment, here.travel + share * way, False)


def _step(
    system: System, pores: Pores, start: Start, here: DrainagePoint, goal: Instant, control: Control, counters: Counters
) -> tuple[DrainagePoint, LoadPoint | None]:
    """The state at the end of a step, without multipliers, and the answer where one is asked for."""
    dt = goal.time - here.time
    slope = (goal.travel - here.travel) / dt
    corner = abs(slope - here.slope) > 1e-9 * max(abs(slope), abs(here.slope))
    omega = 0.0 if corner or here.step == 0.0 else dt / here.step
    bar = ((1.0 + omega) ** 2 * here.v - omega**2 * here.before) / (1.0 + 2.0 * omega)
    step = TimeStep(bar, (1.0 + omega) / (1.0 + 2.0 * omega) * dt, goal.time)
    load = replace(start(goal.travel), history=here.history, dt=dt)
    ahead = 0.0 if corner else dt
    guess = here.u + ahead * here.du, here.p + ahead * here.dp
    first, residuals = solve(system, pores, *guess, load, step, control.medium, counters)
    point = None
    if goal.asked:
        point = LoadPoint(
            goal.time, goal.travel, _stages(system, pores, first, residuals, load, step, control, counters)
        )
    u = first.at.u
    reached = DrainagePoint(
        goal.time, goal.travel, u, first.p, first.v, here.v, dt, (u - here.u) / dt, (first.p - here.p) / dt, slope,
        first.at.history,
    )  # fmt: skip
    load_steps.proper(system, _found(first, residuals), here.travel, goal.travel, [], counters)
    return reached, point


def _stages(
    system: System, pores: Pores, first: CoupledState, residuals: tuple[float, ...], load: Load, step: TimeStep,
    control: Control, counters: Counters,
) -> tuple[Stage, ...]:  # fmt: skip
    """The solution of a step and those with its multipliers."""
    stages, state = [Stage(_found(first, residuals), load)], first
    for _ in range(control.augmentations):
        load = newton.augmented(system, load, state.at)
        state, residuals = solve(system, pores, state.at.u, state.p, load, step, max(control.tight, 1e-8), counters)
        stages.append(Stage(_found(state, residuals), load))
    return tuple(stages)


def _found(state: CoupledState, residuals: tuple[float, ...]) -> Equilibrium:
    return Equilibrium(state.at, np.zeros_like(state.at.u), residuals)


def solve(
    system: System, pores: Pores, u: np.ndarray, p: np.ndarray, load: Load, step: TimeStep, tolerance: float,
    counters: Counters,
) -> tuple[CoupledState, tuple[float, ...]]:  # fmt: skip
    """CoupledState at the end of a step from u (n, 3) mm and p (v,) MPa, and the history of relative residuals.

    Forces out of balance and missing volumes, these times `Pores.unit`, together are `tolerance` of the outer forces.
    Raises NotConverged.
    """
    history: list[float] = []
    try:
        here = evaluate_coupled(system, pores, u, p, load, step)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    touching = _begun(system, load, here.at)
    for _ in range(MAX_COUPLED_ITERATIONS):
        history.append(_relative(pores, here))
        if not history[-1] < MAX_RESIDUAL_GROWTH * max(history[0], 1.0):
            raise NotConverged("contact", "the residual grows", tuple(history))
        if history[-1] <= tolerance or newton.at_round_off(history, partial(newton.round_off, system, here.at)):
            return here, tuple(history)
        if time.process_time() > counters.deadline:
            raise NotConverged("time_limit", "the time of the run is used up", tuple(history))
        counters.iterations += 1
        factor = _factorise(system, pores, here, load, step, touching, counters)
        residual = here.at.residual + _held(system, here.at, load, touching)
        change = factor(-_reduced(pores, residual, here.missing))
        here, touching = _stepped(system, pores, here, load, step, touching, change, counters, history)
    raise NotConverged("contact", "no equilibrium in time", tuple(history))


def evaluate_coupled(
    system: System, pores: Pores, u: np.ndarray, p: np.ndarray, load: Load, step: TimeStep,
    sealed: np.ndarray | None = None,
) -> CoupledState:  # fmt: skip
    """Forces and volumes out of balance, with the points `sealed` (f, q) bool under the indenter, else the closed ones.

    Raises stress.Inverted when an element is inside out.
    """
    at, space = newton.evaluate_system(system, u, load), pores.space
    sealed = _sealed(system, pores, at.contacts) if sealed is None else sealed
    F = _deformation(system, at.H)
    force = axisymmetric.internal_force(space.body, F, np.zeros((*space.body.w.shape, 6)), -p[space.corners])
    v = pore_pressure.volume_change(at.H, small(system))
    if pores.storage:
        v = v + pores.storage * (p[space.corners] @ axisymmetric.linear_functions().T)
    missing = pore_pressure.mass(space, F, v - step.volume, p, _flow(pores, step, F)[0])
    for edges, through in _leaks(system, pores, step, sealed):
        np.add.at(missing, edges.ends, np.einsum("eij,ej->ei", through, p[edges.ends]))
    return CoupledState(replace(at, residual=at.residual + force), p, v, missing, sealed)


def _flow(pores: Pores, step: TimeStep, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Δ k (m, q) and its derivative by J at the points of deformation gradients F (m, q, 3, 3).

    Raises stress.Inverted where no pores are left.
    """
    flow = step.length * pores.permeability
    if pores.closes.constant:
        return np.full(F.shape[:2], flow), np.zeros(F.shape[:2])
    relative, slope = pores.closes.relative(np.linalg.det(F))
    if not (relative > 0.0).all():
        raise stress.Inverted("no pores are left at J = solid_fraction")
    return flow * relative, flow * slope


def _deformation(system: System, H: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.eye(3), H.shape).copy() if small(system) else H + np.eye(3)


def _sealed(system: System, pores: Pores, contacts: Sequence[ContactState]) -> np.ndarray:
    """Points (f, q) of the surface under the indenter through which nothing passes: it is closed or glued there.

    A gap of `SEALED_GAP_RATIO` of an edge is closed: between points that press, curved edges leave gaps of less.
    """
    if pores.may_close is None:
        return np.zeros(contacts[0].gap.shape, bool)
    held, sealed = system.pressing.held, contacts[0].gap < SEALED_GAP_RATIO * pores.may_close.length[:, None]
    return sealed if held is None else sealed | glued(held)


def _leaks(system: System, pores: Pores, step: TimeStep, sealed: np.ndarray) -> list[tuple[OpenEdges, np.ndarray]]:
    """∫ Δ λ φ_i φ_j dA (e, 2, 2) of all edges that may leak, `flow` = Δ k:

        λ = c (k/h) min(1, k M t/h²),

    of an edge of length h, 1/M = 1/(K + 4 μ/3) + S, t (s) since the body was at rest; c = OPEN_EDGE_LEAK_FACTOR,
    or CONTACT_EDGE_LEAK_FACTOR `beside` what is sealed.  An element's pressure falls over all of its depth: as long as
    what has drained is thinner than h, pressures held at zero would drain too much, and an undrained body would yield
    by a layer of elements.
    """
    stuff = system.material
    modulus = 1.0 / (1.0 / (stuff.bulk_modulus + 4.0 / 3.0 * stuff.shear_modulus) + pores.storage)
    flow, found = step.length * pores.permeability, []
    none = np.zeros((1, 1), bool)
    for edges, closed in ((pores.open, none), (pores.may_close, sealed)):
        if edges is not None:
            h = edges.length
            factor = np.where(
                _beside(edges, closed, len(pores.space.vertices)), CONTACT_EDGE_LEAK_FACTOR, OPEN_EDGE_LEAK_FACTOR
            )
            through = factor * flow / h * np.minimum(1.0, pores.permeability * modulus * step.end / h**2)
            found.append((edges, through[:, None, None] * (edges.products * ~closed[..., None, None]).sum(1)))
    return found


def _beside(edges: OpenEdges, closed: np.ndarray, vertices: int) -> np.ndarray:
    """Whether edges (e,) have closed points or lie within N_EDGES_BESIDE_CONTACT edges of one that has."""
    near = np.broadcast_to(closed.any(1), edges.length.shape)
    for _ in range(N_EDGES_BESIDE_CONTACT):
        at = np.zeros(vertices, bool)
        at[edges.ends[near]] = True
        near = at[edges.ends].any(1)
    return near


def _relative(pores: Pores, here: CoupledState) -> float:
    norm = float(np.linalg.norm(_reduced(pores, here.at.residual, here.missing)))
    return norm / here.at.scale if here.at.scale > 0 else float(norm > 0)


def _reduced(pores: Pores, residual: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Unknowns' part of forces (n, 3) and missing volumes (v,), in the order of the coupled matrix."""
    space = pores.space
    out = np.empty(space.pattern.size)
    out[space.moved] = newton.reduced(space.body, residual)
    out[space.number] = -pores.unit * missing
    return out


def _factorise(
    system: System,
    pores: Pores,
    here: CoupledState,
    load: Load,
    step: TimeStep,
    touching: Pressures,
    counters: Counters,
) -> Solve:
    """Factor of the tangent; where that is singular, without the turning of the contact."""
    body, space, at = pores.space.body, pores.space, here.at
    linearised = response.linearised(body, system.material, at.H, load.history, load.dt, system.scale)
    turning = response.Turning(linearised.state.S_geometric, linearised.volume.p - here.p[space.corners])
    bulk = response.meridian_stiffness(body, linearised, turning)
    F = _deformation(system, at.H)
    coupled = pore_pressure.coupling(space, F, here.p, *_flow(pores, step, F), pores.storage, pores.unit, small(system))
    for edges, through in _leaks(system, pores, step, here.sealed):
        np.subtract.at(coupled, edges.place, pores.unit**2 * through)
    contacts = tuple(c if p is None else replace(c, multiplier=p) for c, p in zip(at.contacts, touching, strict=True))
    for geometric in (True, False):
        data = coupled.copy()
        data[space.kept] += bulk + newton.contact_tangent(system, replace(at, contacts=contacts), load, geometric)[0]
        counters.factorisations += 1
        try:
            return pores.factor(data)
        except NotPositiveDefinite:
            counters.shifts += 1
    raise NotConverged("instability", "the tangent stays singular", ())


def _begun(system: System, load: Load, at: Evaluation) -> Pressures:
    """Pressures to begin with, of the points that overlap: their multipliers, or hardly any."""
    return tuple(
        np.where(state.multiplier > 0.0, np.maximum(touch.multiplier, NEW_CONTACT_PRESSURE), 0.0)
        if tractions.follows(pair)
        else None
        for pair, touch, state in zip(system.pairs, load.touches, at.contacts, strict=True)
    )


def _held(system: System, at: Evaluation, load: Load, touching: Pressures) -> np.ndarray:
    """What the residual lacks of pressures λ − ε g, of any sign, at just the points that count as touching."""
    out, x = np.zeros_like(at.u), system.body.nodes + at.u
    for pair, touch, state, p in zip(system.pairs, load.touches, at.contacts, touching, strict=True):
        if p is not None:
            out += tractions.evaluate_contact(pair, x, touch, p).residual - state.residual
    return out


def _stepped(
    system: System, pores: Pores, here: CoupledState, load: Load, step: TimeStep, touching: Pressures,
    change: np.ndarray, counters: Counters, history: list[float],
) -> tuple[CoupledState, Pressures]:  # fmt: skip
    """The state after a change of all unknowns, less of it where elements would turn over, and linear pressures."""
    space, alpha = pores.space, 1.0
    du = newton.full(space.body, change[space.moved])
    dp = pores.unit * change[space.number]
    while True:
        try:
            sealed = here.sealed if len(history) > MAX_SEALING_ITERATIONS else None
            new = evaluate_coupled(system, pores, here.at.u + alpha * du, here.p + alpha * dp, load, step, sealed)
            break
        except stress.Inverted as error:
            alpha *= 0.5
            counters.halvings += 1
            if alpha < MIN_NEWTON_STEP_SHARE:
                raise NotConverged("inversion", str(error), tuple(history)) from None
    pressures: list[np.ndarray | None] = []
    x = space.body.nodes + here.at.u
    for pair, touch, state, old in zip(system.pairs, load.touches, here.at.contacts, touching, strict=True):
        if old is None:
            pressures.append(None)
            continue
        normal = pair.rigid.gap(tractions.contact_points(pair.surface, x), touch.centre, touch.direction)[1]
        moved = np.einsum("qa,fai->fqi", pair.surface.N, du[pair.surface.facets])
        p = np.maximum(touch.multiplier - pair.epsilon * touch.raised * (state.gap + (normal * moved).sum(-1)), 0.0)
        pressures.append(p if alpha == 1.0 else alpha * p + (1.0 - alpha) * old)
    return new, tuple(pressures)
