"""What a run takes, roughly: by its support, the symmetry of its model, its level and whether the way counts."""

from __future__ import annotations

from fem_backend.simulation import assembly
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs

SECONDS = {"fixed": (13.0, 5.0, 3.0), "bowl": (51.0, 31.0, 7.0)}  # with 0, 1, 2 planes, coarse, as measured
OF_LEVEL = {"coarse": 1.0, "standard": 2.6, "fine": 5.0, "reference": 9.0, "limit": 13.0}
WAY = 1.8  # times as much where friction or memory makes the way count; a bowl's seconds hold it


def seconds(settings: Settings, knobs: Knobs, way: bool) -> float:
    """Seconds of one thread, right to a factor of two or so; those of a whole model where there is no telling."""
    try:
        planes = sum(assembly.place(settings, knobs).planes)
    except assembly.NotModelled:
        planes = 0
    slower = WAY if way and settings.support != "bowl" else 1.0
    return SECONDS[settings.support][planes] * OF_LEVEL.get(settings.level, 1.0) * slower
