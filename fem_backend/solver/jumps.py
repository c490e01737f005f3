"""Jumps of an attracted body under a prescribed travel: where an equilibrium ends, and what it jumps to.

A body that is attracted follows a branch of stable equilibria, K = ∂²Π/∂u² positive definite.  With f = dΠ/ds the force
at a travel s, that branch ends at a fold, where its slope

    κ = df/ds = ∂²Π/∂s² − mᵀ K⁻¹ m,   m = ∂²Π/∂u∂s,

goes to −∞ as (s − s_f)^−½, so that 1/κ² falls linearly to zero there.  A machine that controls the travel cannot stop
there: the body lets go (or is pulled in) at once.  Newton by descent of the potential finds what it comes to rest at,
as overdamped motion would.  A step whose change of force is not that of the slopes at its ends is no step along a
branch: it is halved until it is, or is as short as `least`, and then it is a jump.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem_backend.contact import tractions
from fem_backend.solver.newton import Equilibrium, Load, System

SMOOTH = 0.1  # of the pull that a step along a branch may be off by, with
CURVED = 0.02  # of the force: what the curvature of a long step may do
NEARER = 0.5  # of the way to the fold that a step goes at most


@dataclass(frozen=True)
class Jump:
    """From a travel (mm) at a time (s) with a force `before` (N) to one `after`, of the modelled part along the way of
    the indenter; `released` is the energy (N mm) lost, of a body without history; `pulled_in`: to a contact."""

    time: float
    travel: float
    before: float
    after: float
    released: float
    pulled_in: bool


@dataclass
class Jumps:
    """What counts as one: pull (N) of the modelled part, the `least` step (mm); and those that were found."""

    pull: float
    least: float
    found: list[Jump] = field(default_factory=list)

    @property
    def shortest(self) -> float:
        """Steps up to this length (mm) are not parted again."""
        return 1.5 * self.least


@dataclass(frozen=True)
class OnBranch:
    """Force f (N), its slope κ (N/mm) and potential (N mm) at a travel (mm); whether anything touches."""

    travel: float
    force: float
    slope: float
    energy: float
    touches: bool


def on_branch(system: System, found: Equilibrium, load: Load, travel: float) -> OnBranch:
    """Force and slope of an equilibrium: f = −F·d, κ = −Σ d·m + m·du/ds, d the way of the indenter."""
    at, pair, touch = found.evaluation, system.pressing, load.pressing
    scratch = np.zeros(len(system.body.pattern.indices))
    m = tractions.tangent(pair, system.body.nodes + at.u, touch, at.contact, scratch)
    d = np.asarray(touch.direction, float)
    slope = -float(m.sum(0) @ d) + float((m * found.rate).sum())
    force = -float(at.contact.force @ d)
    return OnBranch(travel, force, slope, at.energy, bool((at.contact.pressure > 0.0).any()))


def unexplained(jumps: Jumps, a: OnBranch, b: OnBranch) -> bool:
    """Whether the change of force from a to b is more than ½(κ_a + κ_b)(s_b − s_a) explains."""
    off = abs(b.force - a.force - 0.5 * (a.slope + b.slope) * (b.travel - a.travel))
    return not off <= SMOOTH * jumps.pull + CURVED * max(abs(a.force), abs(b.force))


def longest(jumps: Jumps, a: OnBranch | None, b: OnBranch) -> float:
    """The longest step (mm) on from b: half of the way to the fold that 1/κ² at a and b points to."""
    if a is None or b.slope >= 0.0 or a.slope >= 0.0 or abs(b.slope) <= abs(a.slope):
        return np.inf
    q, before = 1.0 / b.slope**2, 1.0 / a.slope**2
    return max(NEARER * abs(b.travel - a.travel) * q / (before - q), jumps.least)


def jump(time: float, a: OnBranch, b: OnBranch) -> Jump:
    """The jump from a to b; what the force did on the short way counts as work."""
    released = a.energy + 0.5 * (a.force + b.force) * (b.travel - a.travel) - b.energy
    return Jump(time, a.travel, a.force, b.force, released, b.touches and abs(b.force) > abs(a.force))
