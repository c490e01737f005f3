"""The table noise of an experiment in study.toml."""

from __future__ import annotations

from rso.measurement import Noise
from rso.study.fields import NotNegativeForce, NotNegativeLength, Share
from rso.study.table import Table


class NoiseTable(Table):
    """[experiments.noise]: standard deviations of what its readings are off by."""

    Fz: NotNegativeForce = 0.0
    """Of each reading of Fz by itself, unless the readings show clearly more; with `correlation` of the curve."""
    Fx: NotNegativeForce | None = None
    """The same of Fx; that of Fz where it is not given."""
    Fy: NotNegativeForce | None = None
    """The same of Fy."""
    uz: NotNegativeLength = 0.0
    """The same of a displacement of the surface."""
    depth: NotNegativeLength = 0.0
    """Of the depth of each reading by itself: many readings average it out."""
    gain: Share = 0.0
    """Of all forces of the test by one factor: other tests have their own."""
    correlation: NotNegativeLength = 0.0
    """Length of travel over which errors of Fz, Fx, Fy and those of a column belong together."""
    contact: NotNegativeLength = 0.0
    """Of the depths of the whole test together: where contact was taken to begin."""
    calibration: Share = 0.0
    """Of all forces of all experiments that state it by one factor: that of their cell."""

    def noise(self) -> Noise:
        """The same as a plain dataclass."""
        return Noise(**self.model_dump())
