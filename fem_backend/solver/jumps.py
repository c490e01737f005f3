"""JumpRecord of an attracted body under a prescribed travel: where an equilibrium ends, and what it jumps to.

A body that is attracted follows a branch of stable equilibria, K = ∂²Π/∂u² positive definite.  With f = dΠ/ds the force
at a travel s, that branch ends at a fold, where its slope

    κ = df/ds = ∂²Π/∂s² − mᵀ K⁻¹ m,   m = ∂²Π/∂u∂s,

goes to −∞ as (s − s_f)^−½, so that 1/κ² falls linearly to zero there.  A machine that controls the travel cannot stop
there: the body lets go (or is pulled in) at once.  Newton by descent of the potential finds what it comes to rest at,
as overdamped motion would.  A step whose change of force is not that of the slopes at its ends is no step along a
branch: it is halved until it is, or is as short as `least`, and then it is a jump.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fem_backend.contact import tractions
from fem_backend.solver.newton import Equilibrium, Load, System

PULL_DEVIATION_SHARE = 0.1  # of the pull that a step along a branch may be off by, with
FORCE_DEVIATION_SHARE = 0.02  # of the force: what the curvature of a long step may do
STEP_GROWTH_BY_ITERATIONS = ((4, 1.7), (6, 1.2), (9, 0.8))  # iterations of a step, and how much longer the next one is
MAX_FOLD_APPROACH_SHARE = 0.6  # of the way to the fold that a step goes at most,
FOLD_SLOPE_RATIO = 0.5  # once its slope is beyond this share of the pull over the length by which a ball is drawn up


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


@dataclass(frozen=True)
class OnBranch:
    """Force f (N), its slope κ (N/mm), potential (N mm) at a travel (mm), and whether anything touches; its `trend`
    (N/mm) since the point before, at the `middle` (mm) between.  Points of contact come and go: κ goes up and down, its
    mean is the trend."""

    travel: float
    force: float
    slope: float
    energy: float
    touches: bool
    trend: float = 0.0
    middle: float = 0.0

    def after(self, before: OnBranch | None) -> OnBranch:
        """The same with its trend since a point before."""
        if before is None or self.travel == before.travel:
            return self
        trend = (self.force - before.force) / (self.travel - before.travel)
        return replace(self, trend=trend, middle=0.5 * (self.travel + before.travel))


@dataclass
class JumpRecord:
    """What counts as one: pull (N) of the modelled part, the length (mm) by which that draws the body up, the `least`
    step (mm); and those that were found."""

    pull: float
    length: float
    least: float
    found: list[Jump] = field(default_factory=list)
    strongest: tuple[float, float] = (0.0, 0.0)
    """Least force (N) of the modelled part on the way and the travel (mm) of it."""

    def passed(self, at: OnBranch) -> None:
        """Take note of a point of the branch."""
        if at.force < self.strongest[0]:
            self.strongest = at.force, at.travel

    @property
    def shortest(self) -> float:
        """Steps up to this length (mm) are not parted again."""
        return 1.5 * self.least


def on_branch(system: System, found: Equilibrium, load: Load, travel: float) -> OnBranch:
    """Force and slope of an equilibrium: f = −F·d, κ = −Σ d·m + m·du/ds, d the way of the indenter."""
    at, pair, touch = found.evaluation, system.pressing, load.pressing
    scratch = np.zeros(len(system.body.pattern.indices))
    m = tractions.add_contact_tangent(pair, system.body.nodes + at.u, touch, at.contact, scratch)
    d = np.asarray(touch.direction, float)
    slope = -float(m.sum(0) @ d) + float((m * found.rate).sum())
    force = -float(at.contact.force @ d)
    return OnBranch(travel, force, slope, at.energy, bool((at.contact.pressure > 0.0).any()))


def is_unexplained(jumps: JumpRecord, a: OnBranch | None, b: OnBranch) -> bool:
    """Whether the change of force from a to b is more than ½(κ_a + κ_b)(s_b − s_a) explains."""
    if a is None:
        return False
    off = abs(b.force - a.force - 0.5 * (a.slope + b.slope) * (b.travel - a.travel))
    return not off <= PULL_DEVIATION_SHARE * jumps.pull + FORCE_DEVIATION_SHARE * max(abs(a.force), abs(b.force))


def at_fold(jumps: JumpRecord, at: OnBranch | None) -> bool:
    """Whether the slope is as steep as it gets near a fold."""
    return at is not None and min(at.slope, at.trend) <= -FOLD_SLOPE_RATIO * jumps.pull / jumps.length


def longest_step(jumps: JumpRecord, a: OnBranch | None, b: OnBranch) -> float:
    """The longest step (mm) on from b: a share of the way to the fold that 1/κ² points to, κ the trend at a and b."""
    if a is None or not at_fold(jumps, b) or not b.trend < a.trend < 0.0:
        return np.inf
    q, before = 1.0 / b.trend**2, 1.0 / a.trend**2
    left = abs(b.middle - a.middle) * q / (before - q) - abs(b.travel - b.middle)
    return max(MAX_FOLD_APPROACH_SHARE * left, jumps.least)


def longer(iterations: float) -> float:
    """How many times as long the next step may be: the annulus where a surface is drawn up moves by its width or so."""
    return next((k for most, k in STEP_GROWTH_BY_ITERATIONS if iterations <= most), 0.5)


def jump(time: float, a: OnBranch, b: OnBranch) -> Jump:
    """The jump from a to b; what the force did on the short way counts as work."""
    released = a.energy + 0.5 * (a.force + b.force) * (b.travel - a.travel) - b.energy
    return Jump(time, a.travel, a.force, b.force, released, b.touches and abs(b.force) > abs(a.force))
