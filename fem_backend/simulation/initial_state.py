"""One experiment set up: what is solved, at rest under its weight, and where the indenter will touch it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fem_backend import post
from fem_backend.contact import tractions
from fem_backend.materials import regions
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver import history_steps, load_steps, newton
from fem_backend.solver.load_steps import Stopped
from fem_backend.solver.newton import Counters, Load, System


@dataclass(frozen=True)
class InitialState:
    """One experiment ready to run: what it is, where, what is solved, how much later the sagged body is touched.

    `carrying`, (f, q) MPa of each pair of the seat, are the multipliers that carry the weight: without them the body
    would sink in at the datum, and rise into the ball where multipliers take that away.
    """

    settings: Settings
    knobs: Knobs
    placement: Placement
    model: AssembledModel
    system: System
    seated: np.ndarray
    lag: float
    probes: post.Probes | None = None
    carrying: tuple[np.ndarray, ...] | None = None

    def start(self, travel: float) -> Load:
        """Load at a travel (mm), without multipliers but those that carry the weight."""
        load = modelling.load_at(self.system, self.placement, travel, self.lag)
        if self.carrying is None:
            return load
        seat = tuple(replace(t, multiplier=m) for t, m in zip(load.seat, self.carrying, strict=True))
        return replace(load, seat=seat)

    @property
    def path_dependent(self) -> bool:
        """Whether the answer depends on the way: friction, relaxation, softening, adhesion (jumps), pore flow."""
        rubbing = any(p.friction for p in self.system.pairs) or self.system.pressing.adhesion is not None
        return rubbing or self.system.material.path_dependent or self.knobs.permeability > 0.0


def initial_state(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, counters: Counters
) -> InitialState:
    """Set the specimen up: gravity first, then the depth counts from contact with what it has become.

    Raises model.NotModelled, and Stopped when the specimen finds no rest.
    """
    system = modelling.system(settings, knobs, placement, model)
    probes = None
    if settings.profile:
        try:
            marks = np.array(settings.profile) - (settings.point if placement.specimen.alike else (0.0, 0.0))
            probes = post.surface_points(model.body.nodes, model.facets, marks, placement.planes)
        except ValueError as error:
            raise modelling.NotModelled("bad_geometry", f"profile: {error}") from error
    ready = InitialState(settings, knobs, placement, model, system, np.zeros_like(model.body.nodes), 0.0, probes)
    if system.dead is None:
        return ready
    away = replace(ready, lag=-5.0 * placement.indenter.length).start(0.0)
    relaxed = replace(history_steps.smooth(system), material=regions.without(system.material, "prony", "mullins"))
    u = ready.seated
    if system.loose:
        control = settings.control
        u = load_steps.seat(relaxed, away, ready.seated, control, counters)
        if not np.isfinite(_lag(ready, u)):  # it rolled over for the last per cent of its weight: as it lay before
            counters.loose += 1
            control = replace(control, seating=control.loose)
            u = load_steps.seat(relaxed, away, ready.seated, control, counters)
        if not any(pair.soft for pair in system.seat):
            u, rest = load_steps.augmented_equilibrium(relaxed, away, u, control, counters)
            ready = replace(ready, carrying=tuple(touch.multiplier for touch in rest.seat))
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


def _lag(at: InitialState, u: np.ndarray) -> float:
    """How much later (mm) a body displaced by u (n, 3) is touched; not finite if it is not."""
    pair, placement, nodes = at.system.pressing, at.placement, at.model.body.nodes
    first = [
        tractions.first_touch(pair.surface, x, pair.rigid, placement.touch, placement.direction)
        for x in (nodes, nodes + u)
    ]
    return first[1] - first[0]
