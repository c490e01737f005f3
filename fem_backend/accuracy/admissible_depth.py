"""What is known of a run before it begins: the depth by which its law cannot be admissible any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.accuracy import error_estimate
from fem_backend.laws import LinearElastic, NeoHooke, admissible
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs

SHARE = 0.42  # of √(d/R): four fifths of Hertz's largest strain below a ball, 0.53 √(d/R)
GROWS = 0.25  # times (d/R)^(3/2): how much faster logarithmic strains grow at large depth
VERIFIED = 2.0  # of R: depth up to which runs reach more than that
SMALL = 1.2  # of R: depth by which small strains have ended for every ν (they do at 0.7 to 0.9 R, with friction to 1.1)
COUNT = 60  # depths looked at


@dataclass(frozen=True)
class End:
    """A depth (mm) by which a law is not admissible any more, and why."""

    depth: float
    why: str


def strain(depth: np.ndarray | float, R: float) -> np.ndarray | float:
    """Logarithmic strain |ln λ| that a ball of radius R (mm) causes at least below itself at a depth (mm):

    0.42 √x (1 + x^(3/2)/4), x = depth/R, at most 2.  Hertz's strain on the axis of an incompressible body is
    0.53 √x at 0.48 contact radii (Johnson 1985, eq. 3.45); runs of neo-Hookean bodies reach 1.2 to 1.4 times this at
    K/μ 1.4 to 180, x from 1/6 to 2.  Assumes a homogeneous body without fibres.
    """
    x = np.clip(np.asarray(depth, dtype=float) / R, 0.0, VERIFIED)
    return SHARE * np.sqrt(x) * (1.0 + GROWS * x**1.5)


def inadmissible(settings: Settings, knobs: Knobs, deepest: float) -> End | None:
    """The end of a law on the way to the `deepest` travel (mm); None where there is none for certain.

    Raises model.NotModelled for laws that do not combine.  Skins, holes, inclusions and fibres change what is reached
    below the ball: nothing is foretold of them.  A body that sinks on its support is indented by less than the travel.
    """
    stuff = modelling.material(settings, knobs)
    law = stuff.law
    if isinstance(law, LinearElastic | NeoHooke) or _uneven(knobs) or stuff.fibre is not None:
        return None
    R = settings.R + knobs.delta_R
    share = 1.0
    share -= error_estimate.sinking(settings, knobs)
    depths = np.linspace(0.0, deepest, COUNT)[1:]
    reached = np.exp(strain(share * depths, R))
    if admissible(law, float(reached[-1])) is None:
        return None
    k = next(k for k, stretch in enumerate(reached) if admissible(law, float(stretch)) is not None)
    why = admissible(law, float(reached[k]))
    return End(float(depths[k]), f"{why}, which is reached at {depths[k]:.3g} mm of travel or before (closed form)")


def small_strains(settings: Settings, knobs: Knobs, deepest: float) -> str | None:
    """Why a run of the linear law to the `deepest` travel (mm) will end early; None where it may not."""
    R = settings.R + knobs.delta_R
    if settings.law != "linear_elastic" or deepest <= SMALL * R:
        return None
    return (
        f'law = "linear_elastic" to {deepest:.3g} mm: small-strain kinematics end at about 0.7 to 1.1 R, here '
        f"{0.7 * R:.2g} to {1.1 * R:.2g} mm; take neo_hookean or another law of finite strain, or smaller depths"
    )


def _uneven(knobs: Knobs) -> bool:
    """Whether moduli are not the same everywhere."""
    skin = knobs.skin_ratio != 1.0 and knobs.skin_thickness > 0.0
    return skin or knobs.inclusion_ratio != 1.0 or knobs.cavity > 0.0
