"""Newton for bodies of revolution with stresses and contact pressures as unknowns of their own.

A step that is right to first order leaves strains wrong to second, and K or ε times that is a large stress: it spoils
the next tangent, which turns stresses with the body.  So the stresses in that part of the tangent are carried along by
the linear step itself, S + ℂ : δE, p̂ + K Π δJ and λ − ε (g + n·δx), and are not evaluated again (the mixed Newton of
Magisano, Leonetti & Garcea 2017, Int. J. Numer. Methods Eng. 109, 1237; condensed, so that only the tangent changes).
Which points touch is found from the same linear pressures (primal-dual active set; Hintermüller, Ito & Kunisch 2002).
What is found is an equilibrium of the same residual as that of :mod:`fem_backend.solver.newton`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fem_backend.contact import tractions
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.materials import response, stress
from fem_backend.solver import newton
from fem_backend.solver.direct import DOUBLE_PRECISION_TOLERANCE, NotPositiveDefinite, Solve
from fem_backend.solver.newton import Counters, Equilibrium, Evaluation, Known, Load, NotConverged, System

# relative residual before multipliers, of which the answer keeps a thousandth: its differences must show
RESIDUAL_TOLERANCE_BEFORE_MULTIPLIERS = 1e-6
ASKED_RESIDUAL_TOLERANCE = 1e-8  # relative residual at an asked travel
# of the residual may be left by a step with an old factor, and of a system that is `seeking`
MAX_MIXED_CHORD_RESIDUAL_RATIO, MAX_SEEKING_CHORD_RESIDUAL_RATIO = 0.3, 0.1
MAX_CONTACT_SEARCHES = 8  # solutions by which the points are sought that touch after a step
MIN_NEWTON_STEP_SHARE = 1e-3  # share of a step at which turned-over elements are given up
NEW_CONTACT_PRESSURE = 1e-300  # pressure of points that have come to touch: they count as active
# relative residual below which an old factor is tried, and below which the first step is made with one that is known
MAX_MIXED_CHORD_START_RESIDUAL, MAX_FIRST_CHORD_RESIDUAL = 0.1, 1.0
MAX_FACTOR_AGE = 8  # steps with one factor
# relative residual below which none gained in four iterations ends the search; errors state what is left
STAGNANT_RESIDUAL = 1e-6
MAX_RESIDUAL_GROWTH = 1e4  # relative residual that grows beyond this will not come back

Pressures = tuple[np.ndarray, ...]  # (f, q) MPa of each pair


@dataclass(frozen=True)
class Carried:
    """What turns with the body: stresses at its points and in its cells, None as evaluated; pressures of contact."""

    body: response.Turning | None
    contact: Pressures


def applies(system: System, load: Load) -> bool:
    """Whether all that touches has a potential of pressure alone, on a meridian."""
    return (
        isinstance(system.body, MeridianBody)
        and all(tractions.follows(p) for p in system.pairs)
        and not any(t.before for t in load.touches)
    )


def solve(
    system: System,
    u: np.ndarray,
    load: Load,
    tolerance: float,
    counters: Counters,
    limit: int = 15,
    known: Known | None = None,
    before: Evaluation | None = None,
    predicted: bool = True,
) -> Equilibrium:
    """As :func:`fem_backend.solver.newton.solve`, for systems that this `applies` to.

    `before` is a state nearby.  The start u (n, 3) was `predicted` by its tangent, which carries its stresses there; or
    else moved as another state was, and its stresses are as good as any.  Raises NotConverged.
    """
    body = _meridian(system)
    history: list[float] = []
    frame = known[0] if known is not None and isinstance(known[0], Frame) else None
    try:
        at = newton.evaluate_system(system, u, load)
    except stress.Inverted as error:
        raise NotConverged("inversion", str(error), ()) from None
    carried = Carried(None, _begun(load, at, frame is not None))
    if before is not None:
        origin = response.linearised(body, system.material, before.H, load.history, load.dt, system.scale)
        moved = u - before.u if predicted else np.zeros_like(u)
        carried = Carried(response.stresses_after_step(body, origin, moved), _expected(before, at))
    fresh, age = False, 0
    ratio = MAX_SEEKING_CHORD_RESIDUAL_RATIO if system.seeking else MAX_MIXED_CHORD_RESIDUAL_RATIO
    attracted = any(tractions.attracts(p) for p in system.pairs)  # equilibria may be unstable: the last tangent tells
    sizes: list[float] = []
    if time.process_time() > counters.deadline:
        raise NotConverged("time_limit", "the time of the run is used up", ())
    while limit > 0:
        history.append(_relative(body, at))
        if not history[-1] < MAX_RESIDUAL_GROWTH * max(history[0], 1.0):
            raise NotConverged("contact", "the residual grows", tuple(history))
        found = history[-1] <= tolerance or _flat(history)
        found = found or (fresh and newton.at_round_off(history, partial(newton.round_off, system, at)))
        near = MAX_MIXED_CHORD_START_RESIDUAL if sizes else MAX_FIRST_CHORD_RESIDUAL
        lazy = frame is not None and age < MAX_FACTOR_AGE and history[-1] < near
        lazy = lazy and (len(sizes) < 2 or sizes[-1] < ratio * sizes[-2])
        if found and frame is not None and (fresh or not attracted):
            linear = frame.exactly(carried.contact)
            moving = newton.contact_tangent(system, at, load)[1]
            return Equilibrium(at, -linear(moving), tuple(history), linear, (frame, moving))
        if not lazy:
            strict = before is not None or (found and attracted)
            frame, linearised = _factorise(system, at, load, carried, counters, strict)
            limit -= 1
        assert frame is not None
        fresh, age = not lazy, age + 1 if lazy else 0
        if found:
            continue
        counters.iterations += 1
        step, pressures = _linear_step(system, frame, at, load, carried.contact)
        sizes.append(float(np.linalg.norm(step)))
        at, carried = _stepped(
            system, at, load, carried, step, pressures, linearised if fresh else None, counters, history
        )
    raise NotConverged("contact", "no equilibrium in time", tuple(history))


def _meridian(system: System) -> MeridianBody:
    assert isinstance(system.body, MeridianBody)
    return system.body


class Frame:
    """Factor of a tangent, whose contact may then change at a few points: (K + V W Vᵀ)⁻¹ by Woodbury's formula.

    `vectors` holds of each pair normals n (f, q, 3) and stiffness ε a (f, q) N/mm at the state of the factor, `active`
    the points (f, q) that counted there.
    """

    def __init__(self, system: System, factor: Solve, normals: list[np.ndarray], stiff: list[np.ndarray],
                 active: list[np.ndarray]) -> None:  # fmt: skip
        self._system, self._factor = system, factor
        self._normals, self._stiff, self._active = normals, stiff, active
        self._known: dict[tuple[int, int, int], tuple[np.ndarray, np.ndarray]] = {}

    def __call__(self, b: np.ndarray, accuracy: float = DOUBLE_PRECISION_TOLERANCE) -> np.ndarray:
        """x (f,) of the matrix as it was factorised."""
        return self._factor(b, accuracy)

    def solve(self, b: np.ndarray, contact: Pressures) -> np.ndarray:
        """x (f,) of the matrix whose contact is at the points of positive pressure."""
        y = self._factor(b, DOUBLE_PRECISION_TOLERANCE)
        V, Z, W = [], [], []
        for k, p in enumerate(contact):
            now = p > 0.0
            for f, q in zip(*np.nonzero(now != self._active[k]), strict=True):
                v, z = self._of(k, int(f), int(q))
                V.append(v)
                Z.append(z)
                W.append(self._stiff[k][f, q] if now[f, q] else -self._stiff[k][f, q])
        if not V:
            return y
        v, z = np.array(V), np.array(Z)
        return y - z.T @ np.linalg.solve(np.diag(1.0 / np.array(W)) + v @ z.T, v @ y)

    def _of(self, k: int, f: int, q: int) -> tuple[np.ndarray, np.ndarray]:
        if (k, f, q) not in self._known:
            surface, body = self._system.pairs[k].surface, self._system.body
            v = np.zeros_like(body.nodes)
            v[surface.facets[f]] = surface.N[q][:, None] * self._normals[k][f, q]
            one = newton.reduced(body, v)
            self._known[k, f, q] = one, self._factor(one, DOUBLE_PRECISION_TOLERANCE)
        return self._known[k, f, q]

    def exactly(self, contact: Pressures) -> Callable[[np.ndarray], np.ndarray]:
        """Of nodal fields (n, 3), with the contact at these points."""
        body = self._system.body
        return lambda v: newton.full(body, self.solve(newton.reduced(body, v), contact))


def _flat(history: list[float]) -> bool:
    """Whether four residuals in a row, small enough, have gained nothing: round-off of a large body hardly touched."""
    last = history[-4:]
    return len(last) == 4 and max(last) < STAGNANT_RESIDUAL and min(last) > 0.5 * max(last)


def _relative(body: MeridianBody, at: Evaluation) -> float:
    norm = float(np.linalg.norm(newton.reduced(body, at.residual)))
    return norm / at.scale if at.scale > 0 else float(norm > 0)


def _expected(before: Evaluation, at: Evaluation) -> Pressures:
    """Pressures of a predicted state: as before where it touched, the rest touches where it has come to overlap."""
    pairs = zip(before.contacts, at.contacts, strict=True)
    return tuple(
        np.where(b.multiplier > 0.0, b.multiplier, np.where(a.multiplier > 0.0, NEW_CONTACT_PRESSURE, 0.0))
        for b, a in pairs
    )


def _begun(load: Load, at: Evaluation, near: bool) -> Pressures:
    """Pressures to begin with: the multipliers where there are any, those of a start that lies `near`, else hardly any.

    What an overlap shows from far away is far too large, and so is λ + p = 2 p where multipliers are new.
    """

    def of(multiplier: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        known = pressure if near and not multiplier.any() else np.maximum(multiplier, NEW_CONTACT_PRESSURE)
        return np.where(pressure > 0.0, known, 0.0)

    return tuple(of(t.multiplier, a.multiplier) for t, a in zip(load.touches, at.contacts, strict=True))


def _normals(system: System, k: int, at: Evaluation, load: Load) -> np.ndarray:
    pair, touch = system.pairs[k], load.touches[k]
    points = tractions.contact_points(pair.surface, system.body.nodes + at.u)
    return pair.rigid.gap(points, touch.centre, touch.direction)[1]


def _held(system: System, at: Evaluation, load: Load, contact: Pressures) -> np.ndarray:
    """What the residual lacks of pressures λ − ε g, of any sign, at just the points that count as touching."""
    out, x = np.zeros_like(at.u), system.body.nodes + at.u
    for pair, touch, state, p in zip(system.pairs, load.touches, at.contacts, contact, strict=True):
        out += tractions.evaluate_contact(pair, x, touch, p).residual - state.residual
    return out


def _linear_step(
    system: System, frame: Frame, at: Evaluation, load: Load, contact: Pressures
) -> tuple[np.ndarray, Pressures]:
    """Step (n, 3) of the tangent where just the points of positive pressure touch, and the pressures after it.

    Those are ⟨λ − ε (g + n·δx)⟩.  A system that is `seeking` finds which points touch after the step: what overlaps
    before it may be pressed down by what is beside it.
    """
    normals = [_normals(system, k, at, load) for k in range(len(system.pairs))]
    for _ in range(MAX_CONTACT_SEARCHES if system.seeking else 1):
        R = newton.reduced(system.body, at.residual + _held(system, at, load, contact))
        step = newton.full(system.body, frame.solve(-R, contact))
        before, contact = contact, _pressures_after(system, at, load, normals, step)
        if all(np.array_equal(b > 0.0, p > 0.0) for b, p in zip(before, contact, strict=True)):
            break
    return step, contact


def _pressures_after(
    system: System, at: Evaluation, load: Load, normals: list[np.ndarray], step: np.ndarray
) -> Pressures:
    out = []
    for pair, touch, state, n in zip(system.pairs, load.touches, at.contacts, normals, strict=True):
        moved = np.einsum("qa,fai->fqi", pair.surface.N, step[pair.surface.facets])
        gap = state.gap + (n * moved).sum(-1)
        out.append(np.maximum(touch.multiplier - pair.epsilon * touch.raised * gap, 0.0))
    return tuple(out)


def _stepped(
    system: System,
    at: Evaluation,
    load: Load,
    carried: Carried,
    step: np.ndarray,
    pressures: Pressures,
    linearised: response.Linearised | None,
    counters: Counters,
    history: list[float],
) -> tuple[Evaluation, Carried]:
    """The state after a step, shortened where elements would turn over, and what is carried there."""
    alpha = 1.0
    while True:
        try:
            new = newton.evaluate_system(system, at.u + alpha * step, load)
            break
        except stress.Inverted as error:
            alpha *= 0.5
            counters.halvings += 1
            if alpha < MIN_NEWTON_STEP_SHARE:
                raise NotConverged("inversion", str(error), tuple(history)) from None
    if alpha < 1.0:
        pressures = tuple(alpha * p + (1.0 - alpha) * old for p, old in zip(pressures, carried.contact, strict=True))
    turning = None if linearised is None else response.stresses_after_step(_meridian(system), linearised, alpha * step)
    return new, Carried(turning, pressures)


def _factorise(
    system: System, at: Evaluation, load: Load, carried: Carried, counters: Counters, predicted: bool
) -> tuple[Frame, response.Linearised]:
    """Factor of the tangent with what is carried; where it is not definite, first without its contact's turning."""
    body, shift, geometric = _meridian(system), 0.0, True
    linearised = response.linearised(body, system.material, at.H, load.history, load.dt, system.scale)
    bulk = response.meridian_stiffness(body, linearised, carried.body)
    bulk = newton.sprung(system, load, bulk)
    contacts = tuple(replace(c, multiplier=p) for c, p in zip(at.contacts, carried.contact, strict=True))
    touching = replace(at, contacts=contacts)
    for _ in range(8):
        data = bulk + newton.contact_tangent(system, touching, load, geometric)[0]
        data[body.pattern.diagonal] += shift
        counters.factorisations += 1
        try:
            factor = system.factor(data)
            normals = [_normals(system, k, at, load) for k in range(len(system.pairs))]
            stiff = [
                p.epsilon * t.raised * tractions.areas(p, body.nodes + at.u)
                for p, t in zip(system.pairs, load.touches, strict=True)
            ]
            return Frame(system, factor, normals, stiff, [p > 0.0 for p in carried.contact]), linearised
        except NotPositiveDefinite:
            counters.shifts += 1
            if geometric:
                geometric = False
            elif predicted:
                raise NotConverged("instability", "the tangent is indefinite after this step", ()) from None
            else:
                shift = 10.0 * shift or 1e-3 * float(np.median(bulk[body.pattern.diagonal]))
    raise NotConverged("instability", "the tangent stays indefinite", ())
