"""What is known of a run before it begins: the depth by which its law cannot be admissible any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_backend.accuracy import error_estimate
from fem_backend.laws import LAWS, admissible
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs

# lengths of the indenter: small strains have ended there for every ν (at 0.7 to 0.9, with friction 1.1)
MAX_SMALL_STRAIN_TRAVEL_RATIO = 1.2
N_DEPTHS = 60  # depths looked at


@dataclass(frozen=True)
class LawEnd:
    """A depth (mm) by which a law is not admissible any more, and why."""

    depth: float
    why: str


def inadmissible(settings: Settings, knobs: Knobs, deepest: float) -> LawEnd | None:
    """The end of a law on the way to the `deepest` travel (mm); None where there is none for certain.

    Raises model.NotModelled for laws that do not combine.  Skins, holes, inclusions, fibres and layers with a law of
    their own change what is reached below the ball: nothing is predicted of them.  A body that sinks on its support is
    indented by less than the travel.
    """
    stuff = modelling.material(settings, knobs)
    law = stuff.law
    if law.unconditional or _uneven(knobs) or stuff.fibre is not None or any(settings.specimen.laws):
        return None
    indenter, share = modelling.placement_of(settings, knobs).indenter, 1.0
    share -= error_estimate.sinking(settings, knobs)
    depths = np.linspace(0.0, deepest, N_DEPTHS)[1:]
    strain = indenter.strain(share * depths)
    if strain is None:
        return None
    reached = np.exp(strain)
    if admissible(law, float(reached[-1])) is None:
        return None
    k = next(k for k, stretch in enumerate(reached) if admissible(law, float(stretch)) is not None)
    why = admissible(law, float(reached[k]))
    return LawEnd(float(depths[k]), f"{why}, which is reached at {depths[k]:.3g} mm of travel or before (closed form)")


def small_strains(settings: Settings, knobs: Knobs, deepest: float) -> str | None:
    """Why a run of the linear law to the `deepest` travel (mm) will end early; None where it may not."""
    R = modelling.placement_of(settings, knobs).indenter.length
    if not LAWS.members[settings.law].small_strain or deepest <= MAX_SMALL_STRAIN_TRAVEL_RATIO * R:
        return None
    return (
        f'law = "{settings.law}" to {deepest:.3g} mm: small-strain kinematics hold to about {0.7 * R:.2g} mm '
        f'({1.1 * R:.2g} mm at most) with this indenter. Use law = "{LAWS.default}", another law of finite '
        "strain, or smaller depths"
    )


def _uneven(knobs: Knobs) -> bool:
    """Whether moduli are not the same everywhere."""
    skin = knobs.skin_ratio != 1.0 and knobs.skin_thickness > 0.0
    return skin or knobs.inclusion_ratio != 1.0 or knobs.cavity > 0.0
