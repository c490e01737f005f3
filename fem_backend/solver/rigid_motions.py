"""Equilibria of a body that may roll and slide far on its support: damped Newton along rigid motions.

A Newton step that turns the body by θ stretches it by θ²/2, and in a body of 10⁵ mm³ that outweighs all that happens
at the contacts: steps stay at 0.1 mm.  So the part of a step that is a rigid motion is made as one (a retraction;
Absil, Mahony & Sepulchre 2008, §4.1).  The damping is that of Levenberg and Marquardt, by the volume, so that saddles
are left behind.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fem_backend.kinematics.bodies import Body
from fem_backend.materials import stress
from fem_backend.solver import newton
from fem_backend.solver.direct import DOUBLE_PRECISION_TOLERANCE, NotPositiveDefinite, Solve
from fem_backend.solver.newton import Counters, Equilibrium, Evaluation, Load, NotConverged, System

MAX_RIGID_MOTION_FACTORISATIONS = 120  # of an equilibrium
MIN_DAMPING_RATIO, MAX_DAMPING_RATIO = 1e-3, 1e8  # damping over μR
MAX_STEP_STRIDES = 1.0  # strides on its support that a step should not surpass by lengthening
MIN_STEP_STRIDES = 1e-10  # of that: a full step this short ends the iteration, whatever the residual of round-off is
ENERGY_ROUND_OFF_RATIO = 1e-13  # of μ times the volume: gains of energy below are round-off
MAX_LINE_SEARCH_TRIALS = 10  # states tried by a line search


@dataclass(frozen=True)
class Motion:
    """How the nodes of a body move: share of each node in the volume (n,), rigid motions that its planes allow (6,)."""

    body: Body
    share: np.ndarray
    allowed: np.ndarray


def motion(body: Body) -> Motion:
    """Shares, all positive, of sum 1; a rigid motion, translation or rotation, is allowed if it moves no held dof."""
    share = np.zeros(len(body.nodes))
    np.add.at(share, body.cells, np.repeat(body.w.sum(1)[:, None], body.cells.shape[1], axis=1))
    held = body.free.reshape(-1, 3) < 0
    fields = [np.broadcast_to(e, body.nodes.shape) for e in np.eye(3)] + [np.cross(e, body.nodes) for e in np.eye(3)]
    return Motion(body, share / share.sum(), np.array([not (np.abs(f[held]) > 1e-9).any() for f in fields]))


def moved_rigidly(how: Motion, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) mm after a step (n, 3) whose rigid part is made as a translation and a rotation.

    step = v + ω×r + rest by least squares over the volume, r = x − c; then x ← c + v + exp(ω×)(r + rest).
    """
    x = how.body.nodes + u
    if not how.allowed.any():
        return u + step
    middle = how.share @ x
    middle[~how.allowed[:3]] = 0.0  # on the planes of symmetry
    r = x - middle
    fields = [np.broadcast_to(e, r.shape) for e in np.eye(3)] + [np.cross(e, r) for e in np.eye(3)]
    basis = np.array([f for f, allowed in zip(fields, how.allowed, strict=True) if allowed])
    gram = np.einsum("ani,bni,n->ab", basis, basis, how.share)
    parts = np.zeros(6)
    parts[how.allowed] = np.linalg.solve(gram, np.einsum("ani,ni,n->a", basis, step, how.share))
    rest = step - parts[:3] - np.cross(parts[3:], r)
    out = middle + parts[:3] + Rotation.from_rotvec(parts[3:]).apply(r + rest) - how.body.nodes
    out[how.body.free.reshape(-1, 3) < 0] = 0.0
    return out


def rolls(system: System) -> bool:
    """Whether a body lies unconstrained on its support and may turn there: not both planes are planes of symmetry."""
    return system.loose and bool(motion(system.body).allowed[3:].any())


def stride(system: System) -> float:
    """The shortest stride (mm) of the surfaces that carry the body."""
    return min(pair.rigid.stride for pair in system.seat)


def solve(
    system: System,
    u: np.ndarray,
    load: Load,
    tolerance: float,
    counters: Counters,
    limit: int = MAX_RIGID_MOTION_FACTORISATIONS,
) -> Equilibrium:
    """Equilibrium from the start u (n, 3), |R| ≤ tolerance · |outer forces| or as far as round-off lets it go.

    For systems with springs, from far away and past saddles.  Raises NotConverged (instability, contact, inversion or
    time_limit).
    """
    body, history, how, left = system.body, [], motion(system.body), limit
    loose, last, diagonal = bool(how.allowed[3:].any()), None, body.pattern.diagonal
    free = body.free.reshape(-1, 3)
    mass = np.empty(body.pattern.size)
    mass[free[free >= 0]] = np.repeat(how.share[:, None], 3, axis=1)[free >= 0]
    assert system.springs is not None
    mass *= float(np.abs(system.springs).sum()) / 1e-4  # about μR
    damping, unit = 0.0, stride(system)
    try:
        at = newton.evaluate_system(system, u, load)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    while left > 0:
        g = newton.reduced(body, at.residual)
        history.append(float(np.linalg.norm(g)) / at.scale if at.scale > 0 else float(np.any(g)))
        if time.process_time() > counters.deadline:
            raise NotConverged("time_limit", "the time of the run is used up", tuple(history))
        if history[-1] <= tolerance and last is not None:  # as in Newton, the last factor is good enough
            return _found(body, at, history, *last)
        before = damping, counters.shifts
        data, factor, last = None, None, None  # a matrix each: they go before the next one comes
        data, moving = newton.system_tangent(system, at, load)
        plain, easy = data[diagonal], modes(how, at.u) if loose else None
        while True:
            left -= 1
            counters.factorisations += 1
            try:
                data[diagonal] = plain
                factor, step = _step(system, data, g, damping * mass, easy)
                break
            except NotPositiveDefinite:
                counters.shifts += 1
                # a guess that lies deep in the ball
                if len(history) == 1 and history[0] > newton.MAX_CONTACT_GEOMETRY_RESIDUAL:
                    data, moving = newton.system_tangent(system, at, load, geometric=False)
                    plain = data[diagonal]
                damping = max(5.0 * damping, MIN_DAMPING_RATIO)
                if damping > MAX_DAMPING_RATIO:
                    raise NotConverged("instability", "the tangent stays indefinite", tuple(history)) from None
        if history[-1] <= tolerance or np.abs(step).max() < MIN_STEP_STRIDES * unit:
            return _found(body, at, history, factor, moving)
        counters.iterations += 1
        found, alpha = _search(system, how, at, load, step, g, damping > 0.0, counters)
        if found is None:
            if damping > 1.0 and np.abs(step).max() < 1e-3 * MAX_STEP_STRIDES * unit:
                raise NotConverged("instability", "the line search found no descent", tuple(history))
            damping = max(10.0 * damping, MIN_DAMPING_RATIO)
            continue
        at, last = found, (factor, moving) if loose and damping == 0.0 else None
        if alpha > 2.0:
            damping /= min(alpha, 10.0)
        elif alpha < 0.3:
            damping = max(4.0 * damping, MIN_DAMPING_RATIO)
        elif before[1] == counters.shifts:  # the last damping was not found too small
            damping /= 10.0
        damping = damping if damping > 0.1 * MIN_DAMPING_RATIO else 0.0
    raise NotConverged("contact", f"no equilibrium after {limit} factorisations", tuple(history))


def modes(how: Motion, u: np.ndarray) -> np.ndarray:
    """Rigid motions of the body displaced by u (n, 3) that its planes allow, orthonormal, (f, k)."""
    x = how.body.nodes + u
    x = x - how.share @ x
    fields = [np.broadcast_to(e, x.shape) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    kept = [newton.reduced(how.body, f) for f, allowed in zip(fields, how.allowed, strict=True) if allowed]
    return np.linalg.qr(np.array(kept).T)[0]


def _found(body: Body, at: Evaluation, history: list[float], factor: Solve, moving: np.ndarray) -> Equilibrium:
    def linear(v: np.ndarray) -> np.ndarray:
        return newton.full(body, factor(newton.reduced(body, v), DOUBLE_PRECISION_TOLERANCE))

    try:
        rate = -linear(moving)
    except NotPositiveDefinite:  # a factor of the iterate before, which must now be exact: only the predictor is lost
        rate = np.zeros_like(moving)
    return Equilibrium(at, rate, tuple(history), linear, (factor, moving))


def _step(
    system: System, data: np.ndarray, g: np.ndarray, damping: np.ndarray, easy: np.ndarray | None
) -> tuple[Solve, np.ndarray]:
    """Factor of the tangent, damped in place, and −(K + D)⁻¹ g (f,); `easy` (f, k) are rigid motions.

    Raises NotPositiveDefinite, also if K is not along the step.
    """
    pattern = system.body.pattern
    data[pattern.diagonal] += damping
    factor = system.factor(data) if easy is None else system.factor(data, easy)
    step = factor(-g, DOUBLE_PRECISION_TOLERANCE)
    if not pattern.symmetric and not -float(g @ step) > max(float(damping @ step**2), 0.0):
        raise NotPositiveDefinite("no descent")  # a general factorisation does not tell
    return factor, step


def _search(
    system: System,
    how: Motion,
    at: Evaluation,
    load: Load,
    step: np.ndarray,
    g: np.ndarray,
    damped: bool,
    counters: Counters,
) -> tuple[Evaluation | None, float]:
    """State at α·step, where the work of the residual along the step has fallen, and α; None where there is none.

    −0.7 ≤ (d·R)(α)/|d·R|(0) < 0.7 by false position, with an energy that falls where there is one; damped steps, which
    are too short, are lengthened threefold and more.
    """
    slope, largest = float(g @ step), float(np.abs(step).max()) / stride(system)
    noise = ENERGY_ROUND_OFF_RATIO * system.material.shear_modulus * float(system.body.w.sum())
    rubs = any(t.before is not None for t in load.touches)
    field = newton.full(system.body, step)
    alpha, low, high, at_low, at_high = 1.0, 0.0, np.inf, slope, np.inf
    best: tuple[Evaluation | None, float] = (None, 0.0)
    for _ in range(MAX_LINE_SEARCH_TRIALS):
        try:
            trial = newton.evaluate_system(system, moved_rigidly(how, at.u, alpha * field), load)
            work = float(step @ newton.reduced(system.body, trial.residual))
            worse = not rubs and -slope * alpha > noise and trial.energy > at.energy + 1e-4 * alpha * slope
        except stress.Inverted:
            work, worse = np.inf, True
        if not worse and work < -0.7 * slope:
            best = trial, alpha
            if work > 0.7 * slope or alpha * largest > MAX_STEP_STRIDES or not damped or alpha > 1e3:
                break
        if worse or work > 0.0:
            high, at_high = alpha, work
        else:
            low, at_low = alpha, work
        if high == np.inf:
            alpha *= min(max(3.0, at_low / (slope - at_low)), 10.0) if at_low > slope else 3.0
        else:
            if best[0] is not None and low > 0.3 * high:
                break
            part = at_low / (at_low - at_high) if np.isfinite(at_high) and at_high > 0.0 else 0.3
            alpha = low + min(max(part, 0.1), 0.7) * (high - low)
        counters.halvings += 1
    return best
