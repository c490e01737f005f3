"""Checks of the physics of one model, as functions: the verification set and its negative controls call the same."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fem_backend.backend import passages
from fem_backend.contact import tractions
from fem_backend.indenters.sphere import Sphere
from fem_backend.materials import stress
from fem_backend.simulation import assembly, experiment, indentation, initial_state
from fem_backend.simulation.assembly import AssembledModel, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.initial_state import InitialState
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver import history_steps, load_steps
from fem_backend.solver.load_steps import Control, Instant, LoadPoint
from fem_backend.solver.newton import Counters
from rso.contract import Programme

SOFT = Knobs(mu=0.01, D1=5.8)


@dataclass(frozen=True)
class Experiment:
    """An experiment with its model."""

    settings: Settings
    knobs: Knobs
    placement: Placement
    model: AssembledModel

    def solve(self, instants: list[Instant], **settings) -> Result:
        """Result through the instants."""
        return indentation.simulate_indentation(
            replace(self.settings, **settings), self.knobs, self.placement, self.model, instants
        )

    def bench(self) -> InitialState:
        """System and loads."""
        return initial_state.initial_state(self.settings, self.knobs, self.placement, self.model, Counters())

    def path(self, instants: list[Instant], control: Control) -> list[LoadPoint]:
        """All instants with penalties alone: the states whose forces do the work."""
        at = self.bench()
        history = stress.virgin(at.system.material, *self.model.body.w.shape)
        control = replace(control, augmentations=0, between=1e-6, medium=1e-6, tight=1e-6)
        return history_steps.follow_history(at.system, at.start, instants, control, Counters(), at.seated, history)


def prepare(knobs: Knobs, level: str = "coarse", **table) -> Experiment:
    """An experiment on a level's mesh."""
    settings = experiment.read_settings({"mesh": {"level": level}, **table})
    placement = assembly.placement_of(settings, knobs)
    return Experiment(settings, knobs, placement, assembly.model_for(settings, knobs, placement, None))


def ramp(*asked: float, speed: float = 1.0) -> list[Instant]:
    """Asked travels at one speed (mm/s)."""
    return [Instant(s / speed, s, True) for s in asked]


def there_and_back(deepest: float, count: int, speed: float = 1.0) -> list[Instant]:
    """Equal steps down to the deepest travel and up again, every one asked for."""
    s = np.concatenate([np.linspace(0, deepest, count + 1)[1:], np.linspace(deepest, 0, count + 1)[1:]])
    return [Instant(float(k + 1) * deepest / count / speed, float(v), True) for k, v in enumerate(s)]


def loop_work(points: list[LoadPoint]) -> tuple[float, float]:
    """Work put in (N mm) over a programme that starts at travel 0, and that of its loading alone (trapezoidal rule)."""
    s = np.array([0.0, *[p.travel for p in points]])
    F = np.array([0.0, *[p.force[2] for p in points]])
    parts = 0.5 * (F[1:] + F[:-1]) * np.diff(s)
    return float(parts.sum()), float(parts[np.diff(s) > 0].sum())


# ---------------------------------------------------------------------------------------------- checks


def check_energy_balance(count: int = 81) -> float:
    """Work of the indenter = energy stored in body and penalty, elastic, 0 to 3 mm; returns the relative difference."""
    b = prepare(SOFT)
    at = b.bench()
    control = replace(Control(), augmentations=0, tight=1e-9)
    s = np.linspace(0.02, 3.0, count)
    points = load_steps.follow_travel(at.system, at.start, list(s), control, Counters())
    work = np.trapezoid([p.force[2] for p in points], s)
    stored = points[-1].evaluation.energy - points[0].evaluation.energy
    error = work / stored - 1
    assert abs(error) < 3e-4 * (80 / (count - 1)) ** 2, error  # of second order in the step
    return error


def check_complementarity(augmentations: int = 4) -> tuple[float, float, float]:
    """p ≥ 0, no penetration, p g = 0 at 3 mm.

    Returns the deepest penetration over R, ∫ p |g| dA over F R, and the share of |t| in p (frictionless).
    """
    b = prepare(SOFT)
    r = b.solve(ramp(3.0), control=replace(b.settings.control, augmentations=augmentations))
    at, pair = r.points[-1].evaluation.contact, b.bench().system.indenter
    outward = at.force[2]
    assert outward > 0.0, outward  # the body pushes the ball up
    assert at.pressure.min() >= 0.0 and at.pressure.max() > 0.0
    deepest = max(-float(at.gap.min()), 0.0) / b.settings.indenter.R
    product = float((pair.surface.weights * at.pressure * np.abs(at.gap)).sum()) / (outward * b.settings.indenter.R)
    # gaps by another formula: distance of the deformed points from the centre
    x = b.model.body.nodes + r.points[-1].evaluation.u
    centre = r.points[-1].load.indenter.centre
    distance = np.linalg.norm(tractions.contact_points(pair.surface, x) - centre, axis=-1) - b.settings.indenter.R
    assert distance.min() > -5e-3 * b.settings.indenter.R, distance.min()
    assert deepest < 5e-3 and product < 2e-4, (deepest, product)
    return deepest, product, float(np.abs(at.traction).max())


def check_friction_dissipates() -> float:
    """t·(Δx − Δc) ≤ 0 on the body at every point of a prescribed step: friction takes energy; returns its work."""
    b = prepare(replace(SOFT, friction=0.3))
    at = b.bench()
    first = prepare(SOFT).solve(ramp(1.0)).points[-1]  # the frictionless state is a place to start from
    pair, load = at.system.indenter, at.start(1.3)
    x0, x1 = (b.model.body.nodes + k * first.evaluation.u for k in (1.0, 1.3))
    touch0 = at.start(1.0).indenter
    before = tractions.contact_history(
        pair, x0, touch0, tractions.evaluate_contact(replace(pair, friction=0.0), x0, touch0)
    )
    state = tractions.evaluate_contact(pair, x1, replace(load.indenter, before=before))
    smooth = tractions.evaluate_contact(replace(pair, friction=0.0), x1, load.indenter)
    # the work of the residual's frictional part against the sliding of the body past the ball
    work = float(((state.residual - smooth.residual) * (x1 - x0)).sum())
    moved = float(-(state.force - smooth.force) @ (load.indenter.centre - touch0.centre))
    slid = tractions.contact_points(pair.surface, x1) - before.points - (load.indenter.centre - touch0.centre)
    at_points = (state.traction * slid).sum(-1)
    assert at_points.max() <= 1e-12 * np.abs(at_points).max(), at_points.max()
    assert work + moved > 0.0 or np.abs(at_points).max() == 0.0, (work, moved)
    assert at_points.min() < 0.0
    return float((pair.surface.weights * at_points).sum())


def check_coulomb(friction: float) -> tuple[float, float]:
    """|t| ≤ μ_f p at every point of a converged state; returns the largest |t|/(μ_f p) and the share that slips."""
    b = prepare(replace(SOFT, friction=friction))
    r = b.solve(ramp(1.0, 2.0))
    at = r.points[-1].evaluation.contact
    t, limit = np.linalg.norm(at.traction, axis=-1), friction * at.pressure
    assert np.all(t <= limit * (1 + 1e-9) + 1e-12 * at.pressure.max()), (t - limit).max()
    touching = at.pressure > 1e-3 * at.pressure.max()
    return float((t[touching] / limit[touching]).max()), float(r.channels["slipping"][-1])


def check_normals() -> None:
    """The gap grows along its normal, which points from the ball to the body: by differences of the distance."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 3)) * 5.0
    ball, centre = Sphere(3.0), np.array([0.5, -0.2, 1.0])
    g, n, _ = ball.gap(x, centre)
    moved = np.linalg.norm(x + 1e-6 * n - centre, axis=1) - 3.0
    np.testing.assert_allclose((moved - g) / 1e-6, 1.0, rtol=1e-5)


def relaxed(knobs: Knobs) -> Knobs:
    """The elastic body that is left when everything has relaxed."""
    left = 1.0 - knobs.prony_g - knobs.prony_g2 - knobs.prony_g3
    return replace(knobs, mu=left * knobs.mu, prony_g=0.0, prony_g2=0.0, prony_g3=0.0)


def programme_points(b: Experiment, programme: Programme) -> Result:
    """Result through a programme."""
    return b.solve(passages(programme))
