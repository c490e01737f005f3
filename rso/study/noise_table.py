"""The table noise of an experiment in study.toml."""

from __future__ import annotations

from rso.data import Noise
from rso.study.base_table import StudyFileTable
from rso.study.fields import NotNegativeForce, NotNegativeLength, Share


class NoiseTable(StudyFileTable):
    """[experiments.noise]: standard deviations of what its readings are off by; 0 says that there is no such error."""

    Fz: NotNegativeForce = 0.0
    """Of each reading of Fz by itself, unless the readings show clearly more; with `correlation` of the curve."""
    Fx: NotNegativeForce | None = None
    """The same of Fx; that of Fz where it is not given."""
    Fy: NotNegativeForce | None = None
    """The same of Fy."""
    uz: NotNegativeLength = 0.0
    """Of each displacement of the surface along z."""
    ux: NotNegativeLength | None = None
    """The same along x; that of uz where it is not given."""
    uy: NotNegativeLength | None = None
    """The same along y."""
    surface_correlation: NotNegativeLength = 0.0
    """Length on the surface over which the noise of a point cloud is correlated, e^(−distance/length)."""
    camera: NotNegativeLength = 0.0
    """Of all displacements of one image of a point cloud along one axis: a rigid shift of the camera."""
    depth: NotNegativeLength = 0.0
    """Of the depth of each reading by itself: many readings average it out."""
    gain: Share | None = None
    """Of all forces of the test by one factor: unless stated 2 % a test, less by repeats."""
    correlation: NotNegativeLength | None = None
    """Length of travel over which errors of forces and columns are correlated; unstated: 0.2 % over half of it."""
    contact: NotNegativeLength | None = None
    """Of the depths of the whole test: where contact was taken to begin; unless stated 1 % of the deepest travel."""
    calibration: Share = 0.0
    """Of all forces of all experiments that state it by one factor: that of their cell."""

    def noise(self) -> Noise:
        """The same as a plain dataclass; a calibration, 0 too, states the gain."""
        stated = self.model_dump()
        if self.gain is None and "calibration" in self.model_fields_set:
            stated["gain"] = 0.0
        return Noise(**stated)
