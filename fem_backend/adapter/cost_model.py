"""What a run takes, roughly: by its support, the symmetry of its model, its level and whether the way counts."""

from __future__ import annotations

from fem_backend.simulation.assembly import Placement
from fem_backend.simulation.experiment import Settings

# of the time on coarse
LEVEL_COST_FACTORS = {"coarse": 1.0, "standard": 2.6, "fine": 5.0, "reference": 9.0, "limit": 13.0}
# seconds of one on the level coarse, and how many times that where the way counts
MERIDIAN_RUN_S, HISTORY_COST_FACTOR = 0.6, 3.0


def estimated_seconds(settings: Settings, placement: Placement | None, way: bool) -> float:
    """Seconds of one thread, right to a factor of two or so; those of a whole model where nothing can be placed."""
    if placement is not None and placement.meridian:
        return MERIDIAN_RUN_S * LEVEL_COST_FACTORS.get(settings.level, 1.0) * (HISTORY_COST_FACTOR if way else 1.0)
    planes = sum(placement.planes) if placement is not None else 0
    slower = settings.support.way if way else 1.0
    return settings.support.seconds[planes] * LEVEL_COST_FACTORS.get(settings.level, 1.0) * slower
