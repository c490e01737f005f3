"""What a run takes, roughly: by its support, the symmetry of its model, its level and whether the way counts."""

from __future__ import annotations

from fem_backend.simulation.assembly import Placement
from fem_backend.simulation.experiment import Settings

OF_LEVEL = {"coarse": 1.0, "standard": 2.6, "fine": 5.0, "reference": 9.0, "limit": 13.0}
MERIDIAN, WAY = 0.6, 3.0  # seconds of one on the level coarse, and how many times that where the way counts


def estimated_seconds(settings: Settings, placement: Placement | None, way: bool) -> float:
    """Seconds of one thread, right to a factor of two or so; those of a whole model where nothing can be placed."""
    if placement is not None and placement.meridian:
        return MERIDIAN * OF_LEVEL.get(settings.level, 1.0) * (WAY if way else 1.0)
    planes = sum(placement.planes) if placement is not None else 0
    slower = settings.support.way if way else 1.0
    return settings.support.seconds[planes] * OF_LEVEL.get(settings.level, 1.0) * slower
