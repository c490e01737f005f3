"""The whole story on one page: an indentation test from its knobs, settings and programme to curves."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fem_backend import contact, following, newton, post, rolling, stepping, stress
from fem_backend import model as modelling
from fem_backend.experiment import Knobs, Settings
from fem_backend.laws import Material
from fem_backend.model import Model, Placement
from fem_backend.newton import Counters, Evaluation, Load, System
from fem_backend.stepping import Guess, Instant, Point, Stopped

UNITS = {
    "time": "s", "travel": "mm", "Fx": "N", "Fy": "N", "Fz": "N", "uz_max": "mm", "bulge": "mm",
    "contact_area": "mm^2", "contact_radius": "mm", "peak_pressure": "MPa", "slipping": "1",
}  # fmt: skip
FORCES = ("Fx", "Fy", "Fz")
MATERIAL_KNOBS = ("mu", "D1", "C01", "C20", "C30", "alpha", "fibre", "fibre_k2", "skin_ratio", "inclusion_ratio")
SOFTEST = 0.1  # of the force that a correction of the penalty may add
SAME = 1e-9  # of the largest: instants and travels nearer than that are computed once
DIFFERENCE = 1e-5  # of a knob: truncation and round-off (K/μ = 10³) alike
REFINED, REFINEMENTS = 1e-5, 10  # of a derivative's residual, and how often at most
STRESSES = ("N", "MPa")  # units of what grows with all moduli
ZONE_KNOBS = ("skin_ratio", "inclusion_ratio")
POWERS = {"D1": -1, "C01": 1, "C20": 1, "C30": 1, "fibre": 1}  # of a stress in the knobs that have one, besides mu


@dataclass(frozen=True)
class Result:
    """Channels at the asked instants, each (k,), in the units of UNITS; forces of the whole specimen on the indenter.

    `uz_max` is how far the deepest point went down since contact, `bulge` how far the highest went up (the material
    rises around the ball, the more the less compressible it is); `slipping` is the share of the contact area that
    slips; `reaction` (k, 3) N is the support's, `contact_error` (k,) N what the last augmentation or `softness`
    changed, `residual` (k,) the share of the outer forces that is out of balance; `gradients[knob][channel]` (k,);
    `system` is what was solved.
    """

    channels: Mapping[str, np.ndarray]
    reaction: np.ndarray
    contact_error: np.ndarray
    residual: np.ndarray
    counters: Counters
    cpu_s: float
    points: tuple[Point, ...] = field(default=(), repr=False)
    gradients: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    notes: Mapping[str, float] = field(default_factory=dict)
    system: System | None = field(default=None, repr=False)

    @property
    def travel(self) -> np.ndarray:
        """Travel (k,) mm."""
        return self.channels["travel"]

    @property
    def Fz(self) -> np.ndarray:
        """Vertical force (k,) N."""
        return self.channels["Fz"]


@dataclass(frozen=True)
class Bench:
    """One experiment ready to run: what it is, where, what is solved, how much later the sagged body is touched.

    `carrying` (f, q) MPa are the multipliers by which a bowl carries the weight: without them the body would sink in at
    the datum, and rise into the ball where multipliers take that away.
    """

    settings: Settings
    knobs: Knobs
    placement: Placement
    model: Model
    system: System
    seated: np.ndarray
    lag: float
    probes: post.Probes | None = None
    carrying: np.ndarray | None = None

    def start(self, travel: float) -> Load:
        """Load at a travel (mm), without multipliers but those that carry the weight."""
        load = modelling.load(self.system, self.placement, travel, self.lag)
        if self.carrying is None:
            return load
        return replace(load, touches=(load.touches[0], replace(load.touches[1], multiplier=self.carrying)))

    @property
    def path_dependent(self) -> bool:
        """Whether the answer depends on the way: friction, relaxation, softening, adhesion (jumps)."""
        rubbing = any(p.friction for p in self.system.pairs) or self.system.pairs[0].adhesion is not None
        return rubbing or self.system.material.path_dependent


def bench(settings: Settings, knobs: Knobs, placement: Placement, model: Model, counters: Counters) -> Bench:
    """Set the specimen up: gravity first, then the depth counts from contact with what it has become.

    Raises model.NotModelled, and Stopped when the specimen finds no rest.
    """
    system = modelling.system(settings, knobs, placement, model)
    probes = None
    if settings.profile:
        try:
            probes = post.surface_points(model.body.nodes, model.facets, np.array(settings.profile), placement.planes)
        except ValueError as error:
            raise modelling.NotModelled("bad_geometry", f"profile: {error}") from error
    ready = Bench(settings, knobs, placement, model, system, np.zeros_like(model.body.nodes), 0.0, probes)
    if system.dead is None:
        return ready
    away = replace(ready, lag=-5.0 * placement.R).start(0.0)
    relaxed = replace(following.smooth(system), material=Material(system.material.law, system.material.fibre))
    u = ready.seated
    if system.springs is not None:
        control = settings.control
        u = stepping.seat(relaxed, away, ready.seated, control, counters)
        if not np.isfinite(_lag(ready, u)):  # it rolled over for the last per cent of its weight: as it lay before
            counters.loose += 1
            control = replace(control, seating=control.loose)
            u = stepping.seat(relaxed, away, ready.seated, control, counters)
        if not system.pairs[1].soft:
            u, rest = stepping.carried(relaxed, away, u, control, counters)
            ready = replace(ready, carrying=rest.touches[1].multiplier)
    else:
        for share in (0.25, 0.5, 0.75, 1.0):
            try:
                u = newton.solve(relaxed, u, replace(away, dead=share), settings.control.medium, counters).evaluation.u
            except newton.NotConverged as error:
                raise Stopped(error.cause, f"sagging: {error}", [], error.history, counters) from error
    lag = _lag(ready, u)
    if not np.isfinite(lag):
        raise Stopped("instability", "the specimen comes to lie where the indenter passes by", [], (), counters)
    return replace(ready, seated=u, lag=lag)


def _lag(at: Bench, u: np.ndarray) -> float:
    """How much later (mm) a body displaced by u (n, 3) is touched; not finite if it is not."""
    pair, placement, nodes = at.system.pairs[0], at.placement, at.model.body.nodes
    first = [
        contact.first_touch(pair.surface, x, pair.rigid, placement.touch, placement.direction)
        for x in (nodes, nodes + u)
    ]
    return first[1] - first[0]


def solve(
    settings: Settings, knobs: Knobs, placement: Placement, model: Model, instants: Sequence[Instant],
    guess: Guess | None = None, gradients: Sequence[str] = (),
) -> Result:  # fmt: skip
    """Curves at the asked instants of a programme; raises Stopped with the result so far, and model.NotModelled.

    `guess(s)` may offer a state (n, 3) to start from at travel s; `gradients` names material knobs.
    """
    started = time.process_time()
    counters = Counters(deadline=started + settings.control.time_limit_s)
    at = bench(settings, knobs, placement, model, counters)
    slopes = None if at.path_dependent else Slopes(at, gradients)
    try:
        points = along(at, instants, counters) if slopes is None else elastic(at, instants, counters, guess, slopes)
    except Stopped as stopped:
        stopped.reached = collect(at, stopped.points, counters, time.process_time() - started)
        raise
    return collect(at, points, counters, time.process_time() - started, slopes)


def along(at: Bench, instants: Sequence[Instant], counters: Counters) -> list[Point]:
    """Points of a body for which the way counts: the programme is followed step by step."""
    control, u = at.settings.control, at.seated
    history = _earlier(at, counters)
    touching = None
    if at.system.springs is not None and at.system.dead is None:
        if rolling.rolls(at.system) and at.system.pairs[1].friction:
            touching = 0.02 * at.placement.R
        else:
            u = stepping.seat(following.smooth(at.system), at.start(0.02 * at.placement.R), u, control, counters)
    groups = together(instants)
    way = steps([_one(group) for group in groups], control.path)
    try:
        points = following.follow(at.system, at.start, way, control, counters, u, history, touching)
    except Stopped as stopped:
        stopped.points = _each(groups, stopped.points)
        raise
    return _each(groups, points)


def together(instants: Sequence[Instant]) -> list[list[Instant]]:
    """Instants in order of time, those within round-off of each other in time and travel side by side."""
    time, travel = (SAME * max((abs(v) for v in of), default=0.0)
                    for of in ([i.time for i in instants], [i.travel for i in instants]))  # fmt: skip
    groups: list[list[Instant]] = []
    for i in instants:
        first = groups[-1][0] if groups else None
        if first is not None and i.time - first.time <= time and abs(i.travel - first.travel) <= travel:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _one(group: Sequence[Instant]) -> Instant:
    """What is computed for instants within round-off of each other: the first that is asked for, or else the first."""
    return next((i for i in group if i.asked), group[0])


def _each(groups: Sequence[Sequence[Instant]], points: Sequence[Point]) -> list[Point]:
    """A point for every asked instant from one for every group, as many as there are."""
    asked = [[i for i in group if i.asked] for group in groups]
    return [
        replace(point, time=i.time, travel=i.travel)
        for group, point in zip([g for g in asked if g], points, strict=False) for i in group
    ]  # fmt: skip


def merged(travels: Sequence[float]) -> dict[float, float]:
    """Each travel (mm) and the least of those within round-off of it, in increasing order."""
    out, near = {}, SAME * max(travels, default=0.0)
    for s in sorted(set(travels)):
        least = next(reversed(out.values()), s)
        out[s] = least if s - least <= near else s
    return out


def elastic(
    at: Bench, instants: Sequence[Instant], counters: Counters, guess: Guess | None = None,
    slopes: Slopes | None = None,
) -> list[Point]:  # fmt: skip
    """Points of a body that returns on its loading curve: each asked travel is solved once."""
    computed = merged([i.travel for i in instants if i.asked])
    asked = list(dict.fromkeys(computed.values()))
    at = replace(at, system=modelling.condensing(at.system, at.model, at.start(0.0), at.start(asked[-1])))
    control, u = at.settings.control, at.seated
    if at.system.springs is not None and at.system.dead is None:
        u = stepping.seat(at.system, at.start(0.02 * at.placement.R), u, control, counters)
    try:
        found = stepping.travel(at.system, at.start, asked, control, counters, u, guess, slopes)
    except Stopped as stopped:
        reached = {p.travel: p for p in stopped.points}
        stopped.points = []
        for i in instants:  # a programme ends at its first instant without equilibrium
            if i.asked and computed[i.travel] not in reached:
                break
            if i.asked:
                stopped.points.append(replace(reached[computed[i.travel]], time=i.time, travel=i.travel))
        raise
    by_travel = {p.travel: p for p in found}
    return [replace(by_travel[computed[i.travel]], time=i.time, travel=i.travel) for i in instants if i.asked]


def _earlier(at: Bench, counters: Counters) -> stress.History | None:
    """History of the material before the test: virgin, or softened by an earlier travel at this place."""
    body = at.model.body
    virgin = stress.virgin(at.system.material, *body.w.shape)
    if virgin is None or at.settings.earlier == 0.0 or at.system.material.mullins is None:
        return virgin
    first = replace(at.system.material, prony=None)
    system = replace(following.smooth(at.system), material=first)
    deepest = at.settings.earlier
    ramp = steps([Instant(deepest, deepest, True)], at.settings.control.path)
    start = stress.virgin(first, *body.w.shape)
    point = following.follow(system, at.start, ramp, at.settings.control, counters, at.seated, start)[-1]
    return replace(virgin, W_max=point.evaluation.history.W_max)


def steps(instants: Sequence[Instant], largest: float) -> list[Instant]:
    """The instants up to the last asked one and, between them, equal steps no larger than `largest` (mm of travel)."""
    last = max((k for k, i in enumerate(instants) if i.asked), default=-1)
    out: list[Instant] = []
    t, s = 0.0, 0.0
    for i in instants[: last + 1]:
        count = max(1, int(np.ceil(abs(i.travel - s) / largest - 1e-9)))
        for k in range(1, count):
            out.append(Instant(t + (i.time - t) * k / count, s + (i.travel - s) * k / count, False))
        out.append(i)
        t, s = i.time, i.travel
    return out


# --------------------------------------------------------------------------------------------------- channels


def channels(at: Bench, system: System, evaluation: Evaluation, load: Load, stiffer: float = 1.0) -> dict[str, float]:
    """Everything measured at one state, in the machine's frame, except time and travel; forces times `stiffer`."""
    placement, body = at.placement, at.model.body
    force = stiffer * whole(placement, evaluation.contact.force)
    up = -placement.down
    moved = (evaluation.u - at.seated) @ up
    touching, surface = evaluation.contact, system.pairs[0].surface
    centre = load.touches[0].centre
    axis = (placement.touch - placement.contact) / placement.R
    patch = post.contact_patch(
        surface, body.nodes + evaluation.u, touching.pressure, centre, placement.R, axis, placement.planes
    )
    active = touching.pressure > 0
    share = (surface.weights * (active & touching.slipping)).sum() / max((surface.weights * active).sum(), 1e-300)
    out = {
        "Fx": force[0], "Fy": force[1], "Fz": force[2],
        "uz_max": -float(moved.min()), "bulge": float(moved.max()),
        "contact_area": patch.area, "contact_radius": patch.radius, "peak_pressure": patch.peak,
        "slipping": float(share),
    }  # fmt: skip
    if at.probes is not None:
        uz = post.displacements(at.probes, evaluation.u - at.seated) @ up
        out |= {profile_name(p): float(v) for p, v in zip(at.settings.profile, uz, strict=True)}
    return out


def profile_name(place: tuple[float, float]) -> str:
    """Channel of the vertical displacement (mm, up) of the surface point above the reference place (x, y) mm."""
    return f"uz({place[0]:g},{place[1]:g})"


def units(settings: Settings) -> dict[str, str]:
    """Channel → unit of everything that an experiment returns."""
    return UNITS | {profile_name(p): "mm" for p in settings.profile}


def whole(placement: Placement, force: np.ndarray) -> np.ndarray:
    """Force (3,) N of the whole specimen in the machine's frame from that of the modelled part."""
    total = modelling.multiplicity(placement) * np.asarray(force, float)
    for axis in (0, 1):
        if placement.planes[axis]:
            total[axis] = 0.0  # the images cancel
    return placement.rotation.T @ total


def collect(
    at: Bench, points: Sequence[Point], counters: Counters, cpu_s: float, slopes: Slopes | None = None
) -> Result:
    """Result from the points reached."""
    soft = np.ones(len(points)) if at.settings.multipliers or not points else 1.0 + softness(at, points)
    rows = [channels(at, at.system, p.evaluation, p.load, k) for p, k in zip(points, soft, strict=True)]
    out = {"time": np.array([p.time for p in points]), "travel": np.array([p.travel for p in points])}
    out |= {name: np.array([r[name] for r in rows]) for name in units(at.settings) if name not in out}
    change = [np.linalg.norm(whole(at.placement, p.force - p.previous_force + (k - 1.0) * p.force))
              for p, k in zip(points, soft, strict=True)]  # fmt: skip
    gradients = slopes.at_travels(out["travel"]) if slopes is not None else {}
    gradients = {k: {n: v * soft if n in FORCES else v for n, v in rows.items()} for k, rows in gradients.items()}
    notes = {"sag_mm": at.lag, "derivatives_cpu_s": slopes.cpu_s if slopes is not None else 0.0}
    if at.system.springs is not None and points:
        carried = [np.abs((at.system.springs[:, None] * p.evaluation.u).sum(0)).max() for p in points]
        forces = [float(np.linalg.norm(p.force)) for p in points]
        notes["spring_share"] = float(max(c / max(c + f, 1e-300) for c, f in zip(carried, forces, strict=True)))
    reactions = np.array([k * reaction(at, p.evaluation) for p, k in zip(points, soft, strict=True)]).reshape(-1, 3)
    return Result(out, reactions, np.array(change), np.array([p.residual for p in points]), counters, cpu_s,
                  tuple(points), gradients, notes, at.system)  # fmt: skip


def softness(at: Bench, points: Sequence[Point]) -> np.ndarray:
    """Share (k,) of the force that contact without multipliers lacks, as all surfaces give way by p/ε:

        F = F_ε + dW/ds,   W = ½ ∫ (p − p₀)²/ε dA

    along each way of the indenter (an elastic body has one) from the values at the asked travels s; p₀ carries the
    weight in a bowl.  Of a body with a potential Π_ε = Π − W to first order in 1/ε, as Π_ε is the largest of Π's
    Lagrangian less ½ ∫ (λ − p₀)²/ε over the multipliers λ, and F = dΠ/ds; otherwise an estimate.  Lateral forces are
    taken to lack the same share.
    """
    near, n = merged([p.travel for p in points]), len(points)
    s = np.array([near[p.travel] for p in points])
    W = np.zeros((n, n))  # at each travel with ε as it is at each point: it grows with the depth
    for k, pair in enumerate(at.system.pairs):
        if pair.soft:  # where the body turns, pressures move over its points
            continue
        rest = _resting(at)[k]
        taken = [p.evaluation.contacts[k].pressure - rest for p in points]
        each = [0.5 * pair.surface.weights * p**2 / pair.epsilon for p in taken]
        raised = [np.broadcast_to(p.load.touches[k].raised, pair.epsilon.shape) for p in points]
        W += np.einsum("jfq,kfq->jk", each, 1.0 / np.array(raised))
    moves = np.nonzero(np.diff(s))[0]  # from each of these points to the next; at rest nothing moves
    turns = [int(k) for j, k in itertools.pairwise(moves) if (s[k + 1] - s[k]) * (s[j + 1] - s[j]) < 0.0]
    turns = turns if at.path_dependent else []
    rise = np.zeros(n)
    for a, b in reversed(list(itertools.pairwise([0, *turns, n - 1]))):  # a turn belongs to the way there
        way = np.arange(a, b + 1)[s[a : b + 1] > 0.0]
        at_s, first = np.unique(s[way], return_index=True)  # at rest the first instant counts
        h = W[way[first]] / at_s[:, None] ** 2  # smooth, as p ~ s^½ on an area ~ s
        slope = 2.0 * h
        if len(at_s) > 1:
            slope = slope + at_s[:, None] * np.gradient(h, at_s, axis=0, edge_order=min(2, len(at_s) - 1))
        rise[way] = [s[k] * np.interp(s[k], at_s, slope[:, k]) for k in way]
    along = np.array([np.abs(p.force @ at.placement.direction) for p in points])
    return np.clip(rise / np.maximum(along, 1e-300), 0.0, SOFTEST)


def _resting(at: Bench) -> list[np.ndarray | float]:
    """Pressures (f, q) MPa of every pair before the test: those of a bowl under the weight, else none."""
    if at.carrying is None:
        return [0.0 for _ in at.system.pairs]
    pair, touch = following.smooth(at.system).pairs[1], at.start(0.0).touches[1]
    return [0.0, contact.evaluate(pair, at.model.body.nodes + at.seated, touch).pressure]


def reaction(at: Bench, evaluation: Evaluation) -> np.ndarray:
    """Force (3,) N that the support carries in the machine's frame: of the held nodes, or on the bowl."""
    if len(evaluation.contacts) > 1:
        return whole(at.placement, -evaluation.contacts[1].force)
    return whole(at.placement, (evaluation.residual - evaluation.contact.residual)[at.model.held].sum(0))


# --------------------------------------------------------------------------------------------------- derivatives


class Slopes:
    """d(channel)/d(knob) at converged points by direct differentiation, also through the multipliers.

    K du/dθ = −∂R/∂θ − ∂R/∂λ dλ/dθ at each stage, with the last factor of that stage and iterative refinement; every
    derivative along (u, θ, λ) is a forward difference of the residual or of the channels, which costs no factorisation.
    Refinement starts at the derivative of the stage before.  μ is not differentiated: all moduli grown alike change no
    displacement, so a channel c of the dimension stressⁿ has μ ∂c/∂μ = n c − Σ p θ ∂c/∂θ over the knobs θ of the
    dimension stressᵖ (Euler's identity).
    """

    def __init__(self, at: Bench, names: Sequence[str]) -> None:
        self.at, self.names = at, tuple(names)
        self.rows: dict[str, dict[float, dict[str, float]]] = {name: {} for name in names}
        self._powers = {n: p for n, p in POWERS.items() if getattr(at.knobs, n)} if "mu" in names else {}
        self._ends: dict[str, tuple[float, System]] = {}
        for name in dict.fromkeys([n for n in names if n != "mu"] + list(self._powers)):
            value = getattr(at.knobs, name)
            h = DIFFERENCE * (abs(value) or at.system.material.shear_modulus)
            end = replace(at.knobs, **{name: value + h})
            high = modelling.system(at.settings, end, at.placement, at.model, at.system)
            if name in ZONE_KNOBS:
                scale = modelling.stiffening(at.settings, end, at.placement, at.model.body)
                high = high if scale is None else replace(high, scale=scale)
            self._ends[name] = h, high
        self._dlambda: dict[str, list[np.ndarray]] = {}
        self._known: dict[str, tuple[np.ndarray, float]] = {}  # du/dθ, |∂R/∂θ| of the stage before
        self.cpu_s = 0.0

    def __call__(self, stage: stepping.Stage, last: bool) -> None:
        """Differentiate one stage; the derivatives of its pressures are those of the next stage's multipliers."""
        at, body, started = stage.equilibrium.evaluation, self.at.system.body, time.process_time()
        here = channels(self.at, self.at.system, at, stage.load) if last else {}
        rows: dict[str, dict[str, float]] = {}
        for name, (h, high) in self._ends.items():
            du, first = self._known.get(name, (np.zeros_like(at.u), 0.0))
            dlambda = self._dlambda.pop(name, None)
            if dlambda is None or not any(t.multiplier.any() for t in stage.load.touches):
                # a first stage; what is kept may be of an attempt that broke off
                dlambda = [np.zeros_like(t.multiplier) for t in stage.load.touches]
                du, first = np.zeros_like(at.u), 0.0
            touches = tuple(
                replace(t, multiplier=t.multiplier + h * d) for t, d in zip(stage.load.touches, dlambda, strict=True)
            )
            load, left = replace(stage.load, touches=touches), np.inf
            for _ in range(REFINEMENTS):  # the factor may be of an earlier iterate
                end = newton.evaluate(high, at.u + h * du, load)
                change = (end.residual - at.residual) / h
                before, left = left, float(np.linalg.norm(newton.reduced(body, change)))
                first = first or left
                if left <= REFINED * first or left > 0.9 * before:
                    break
                du = du - stage.equilibrium.linear(change)
            self._known[name] = du, first
            if last:
                there = channels(self.at, high, end, stage.load)
                rows[name] = {c: (v - here[c]) / h for c, v in there.items()}
            else:
                self._dlambda[name] = [
                    (b.pressure - a.pressure) / h for a, b in zip(at.contacts, end.contacts, strict=True)
                ]
        if last:
            rows |= {"mu": self._similar(here, rows)} if "mu" in self.names else {}
            for name in self.names:
                self.rows[name][travel_of(self.at, stage.load)] = rows[name]
        self.cpu_s += time.process_time() - started

    def _similar(self, here: Mapping[str, float], rows: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
        """∂c/∂μ of every channel c from its value and its derivatives by the other moduli."""
        knobs, unit = self.at.knobs, units(self.at.settings)

        def others(c: str) -> float:
            return sum(p * getattr(knobs, n) * rows[n][c] for n, p in self._powers.items())

        return {c: (float(unit[c] in STRESSES) * v - others(c)) / knobs.mu for c, v in here.items()}

    def at_travels(self, travels: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
        """Gradients (k,) in the order of the points."""
        out: dict[str, dict[str, np.ndarray]] = {}
        for name, rows in self.rows.items():
            known = np.array(list(rows))
            chosen = [rows[known[np.argmin(np.abs(known - s))]] for s in travels] if rows else []
            out[name] = {c: np.array([r[c] for r in chosen]) for c in chosen[0]} if chosen else {}
        return out


def travel_of(at: Bench, load: Load) -> float:
    """Travel (mm) of the indenter in a load."""
    return float((load.touches[0].centre - at.placement.touch) @ at.placement.direction) - at.lag
