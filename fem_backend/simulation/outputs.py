"""What is measured at a state of equilibrium: forces of the whole specimen, contact, surface, support."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from fem_backend import post
from fem_backend.contact import tractions
from fem_backend.contact.rings import ring_patch
from fem_backend.contact.tractions import Pair
from fem_backend.indenters import Contact
from fem_backend.meshing import graded_for
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.assembly import Placement
from fem_backend.simulation.experiment import Settings, profile_name
from fem_backend.simulation.initial_state import InitialState
from fem_backend.simulation.schedule import merged
from fem_backend.solver import history_steps
from fem_backend.solver.load_steps import LoadPoint
from fem_backend.solver.newton import Evaluation, Load, System

CHANNEL_UNITS = {
    "time": "s",
    "travel": "mm",
    "Fx": "N",
    "Fy": "N",
    "Fz": "N",
    "uz_max": "mm",
    "bulge": "mm",
    "contact_area": "mm^2",
    "contact_radius": "mm",
    "peak_pressure": "MPa",
    "slipping": "1",
}
FORCES = ("Fx", "Fy", "Fz")
MAX_PENALTY_CORRECTION_SHARE = 0.1  # of the force that a correction of the penalty may add


def channels(
    at: InitialState, system: System, evaluation: Evaluation, load: Load, stiffer: float = 1.0
) -> dict[str, float]:
    """Everything measured at one state, in the machine's frame, except time and travel; forces times `stiffer`."""
    placement, body = at.placement, at.model.body
    force = stiffer * whole(placement, evaluation.contact.force)
    up = -placement.down
    moved = (evaluation.u - at.seated) @ up
    touching, surface = evaluation.contact, system.pressing.surface
    centre = load.pressing.centre
    x = body.nodes + evaluation.u
    patch: Contact
    if placement.meridian:
        patch = ring_patch(surface, x, touching.pressure, touching.attraction)
    else:
        normal, planes, width = placement.normal, placement.planes, graded_for(at.settings.recipe)
        # a grid for the indenter itself says nothing of the contact, nor where the actual one is larger
        width = width if width < at.settings.indenter.length else np.inf
        patch = placement.indenter.patch(
            surface, x, touching.pressure, centre, normal, planes, touching.attraction, width
        )
    active = touching.pressure > 0
    share = (surface.weights * (active & touching.slipping)).sum() / max((surface.weights * active).sum(), 1e-300)
    out = {
        "Fx": force[0],
        "Fy": force[1],
        "Fz": force[2],
        "uz_max": -float(moved.min()),
        "bulge": float(moved.max()),
        "contact_area": patch.area,
        "contact_radius": patch.radius,
        "peak_pressure": patch.peak,
        "slipping": float(share),
    }
    if at.probes is not None:
        u = post.displacements(at.probes, evaluation.u - at.seated)
        if placement.meridian:  # displacements are those in the half-plane of each point
            beside = np.array(at.settings.profile).T - np.array(_axis(at))[:, None]
            r = np.hypot(*beside)
            along = [u[:, 0] * np.divide(v, r, out=np.zeros_like(r), where=r > 0.0) for v in beside]
            u = np.stack([*along, u[:, 2]], axis=1)
        u = u @ placement.rotation
        out |= {
            profile_name(p, axis): float(v)
            for p, row in zip(at.settings.profile, u, strict=True)
            for axis, v in zip("xyz", row, strict=True)
        }
    return out


def units(settings: Settings) -> dict[str, str]:
    """Channel → unit of everything that an experiment returns."""
    return CHANNEL_UNITS | {profile_name(p, axis): "mm" for p in settings.profile for axis in "xyz"}


def _axis(at: InitialState) -> tuple[float, float]:
    """Place (mm) of the axis of a meridian: marks of a specimen that is alike everywhere count from the indenter."""
    return at.settings.point if at.placement.specimen.alike else (0.0, 0.0)


def whole(placement: Placement, force: np.ndarray) -> np.ndarray:
    """Force (3,) N of the whole specimen in the machine's frame from that of the modelled part."""
    total = modelling.multiplicity(placement) * np.asarray(force, float)
    for axis in (0, 1):
        if placement.planes[axis]:
            total[axis] = 0.0  # the images cancel
    return placement.rotation.T @ total


def softness(at: InitialState, points: Sequence[LoadPoint]) -> np.ndarray:
    """Share (k,) of the force that contact without multipliers lacks, as all surfaces give way by p/ε:

        F = F_ε + dW/ds,   W = ½ ∫ (p − p₀)²/ε dA

    with p per area before, but p²/ε dA = p² (dA/da)/ε dA where contact acts per area now, da,
    along each way of the indenter (an elastic body has one) from the values at the asked travels s; p₀ carries the
    weight of an unconstrained body.  Of a body with a potential Π_ε = Π − W to first order in 1/ε, as Π_ε is the
    largest of Π's Lagrangian less ½ ∫ (λ − p₀)²/ε over the multipliers λ, and F = dΠ/ds; otherwise an estimate.
    Lateral forces are taken to lack the same share.
    """
    near, n = merged([p.travel for p in points]), len(points)
    s = np.array([near[p.travel] for p in points])
    W = np.zeros((n, n))  # at each travel with ε as it is at each point: it grows with the depth
    for k, pair in enumerate(at.system.pairs):
        if pair.soft:  # where the body turns, pressures move over its points
            continue
        rest = _resting(at)[k]
        taken = [p.evaluation.contacts[k].pressure - rest for p in points]
        each = [
            0.5 * pair.surface.weights * _stretch(at, pair, point) * p**2 / pair.epsilon
            for p, point in zip(taken, points, strict=True)
        ]
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
    return np.clip(rise / np.maximum(along, 1e-300), 0.0, MAX_PENALTY_CORRECTION_SHARE)


def _stretch(at: InitialState, pair: Pair, point: LoadPoint) -> np.ndarray | float:
    """Areas before over those now, dA/da (f, q), of a pair that acts per area now; else 1."""
    if not tractions.follows(pair):
        return 1.0
    return pair.surface.weights / tractions.areas(pair, at.model.body.nodes + point.evaluation.u)


def _resting(at: InitialState) -> list[np.ndarray | float]:
    """Pressures (f, q) MPa of every pair before the test: those of the seat under the weight, else none."""
    if at.carrying is None:
        return [0.0 for _ in at.system.pairs]
    x, seat = at.model.body.nodes + at.seated, history_steps.smooth(at.system).seat
    touches = at.start(0.0).seat
    return [0.0, *(tractions.evaluate_contact(p, x, touch).pressure for p, touch in zip(seat, touches, strict=True))]


def reaction(at: InitialState, evaluation: Evaluation) -> np.ndarray:
    """Force (3,) N that the support carries in the machine's frame: of the held nodes, and what touches it."""
    touched = [-state.force for state in evaluation.seat]
    if len(at.model.held) or not touched:
        fixed = at.model.body.free.reshape(-1, 3)[at.model.held] < 0  # what slides there is touched, not held
        touched.insert(0, (evaluation.residual[at.model.held] * fixed).sum(0))
    return whole(at.placement, sum(touched[1:], touched[0]))
