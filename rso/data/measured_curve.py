"""A measured curve with its uncertainty, and what the experimenter states of errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from rso.data import usual_errors


@dataclass(frozen=True)
class Noise:
    """Standard uncertainties stated by the experimenter.

    `Fx`, `Fy`, `Fz` N and `ux`, `uy`, `uz` mm (x and y are as z unless given), `depth` mm, of each reading by
    itself (white); `contact` mm, by which the depths of a whole test are off together; `gain`, relative, of all forces
    of a test; `calibration`, relative, of all forces of all tests: that of their cell.  `correlation` mm: length over
    which the force noise, then that of the mean of repeats, and what a column such as Fz_sigma_N states, is correlated
    along the depth, exp(−|Δu|/correlation), 0 = white.

    `gain`, `contact` and `correlation` are None where nobody states them: then what is usual counts
    (:mod:`~rso.data.usual_errors`), as far as repeats do not show it; 0 says that there is none.  A stated calibration
    states the gain as well.  `surface_correlation` mm: length over which the noise of displacements is correlated on
    the surface; `camera` mm: by which all displacements of one image along one axis are off together.
    """

    Fz: float = 0.0
    Fx: float | None = None
    Fy: float | None = None
    uz: float = 0.0
    depth: float = 0.0
    gain: float | None = None
    correlation: float | None = None
    contact: float | None = None
    calibration: float = 0.0
    ux: float | None = None
    uy: float | None = None
    surface_correlation: float = 0.0
    camera: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"noise: {f.name} = {value} must be finite and >= 0")

    def of(self, channel: str) -> float:
        """Additive standard uncertainty of one channel."""
        if channel in ("ux", "uy", "uz"):
            sideways = {"ux": self.ux, "uy": self.uy}.get(channel)
            return self.uz if sideways is None else sideways
        own = {"Fx": self.Fx, "Fy": self.Fy, "Fz": self.Fz}[channel]
        return self.Fz if own is None else own

    @property
    def unstated(self) -> tuple[str, ...]:
        """Which of "gain", "contact" and "correlation" nobody has stated."""
        gain = self.gain is None and self.calibration == 0.0
        said = {"gain": not gain, "contact": self.contact is not None, "correlation": self.correlation is not None}
        return tuple(name for name, stated in said.items() if not stated)

    @property
    def stated(self) -> StatedNoise:
        """The same with 0 where nothing is stated."""
        return StatedNoise(
            Fz=self.Fz,
            Fx=self.Fx,
            Fy=self.Fy,
            uz=self.uz,
            depth=self.depth,
            gain=self.gain or 0.0,
            correlation=self.correlation or 0.0,
            contact=self.contact or 0.0,
            calibration=self.calibration,
            ux=self.ux,
            uy=self.uy,
            surface_correlation=self.surface_correlation,
            camera=self.camera,
        )

    def of_test(self, deepest: float) -> StatedNoise:
        """The same with what is usual of one test to the depth `deepest` (mm) where nothing is stated."""
        each = {"gain": usual_errors.USUAL_GAIN_ERROR, "contact": usual_errors.USUAL_CONTACT_ERROR_SHARE * deepest}
        return replace(self.stated, **{n: v for n, v in each.items() if n in self.unstated})


@dataclass(frozen=True)
class StatedNoise(Noise):
    """Noise of which nothing is left open."""

    gain: float = 0.0
    correlation: float = 0.0
    contact: float = 0.0


@dataclass(frozen=True, eq=False)
class MeasuredCurve:
    """Mean of the repeats of one channel: arrays (n,), `covariance` (n, n), `sigma` = √diag(covariance).

    `position` (n, 2) holds x, y in mm for a profile and is None for a force curve.  The size of the errors is known
    from `freedom` degrees of freedom, as far as it was taken from the readings; infinite where all of it is stated.
    `shared` holds the parts s (n,) of C, s sᵀ each, that other curves have with the same sign: what is named alike in
    curves of one test, and "calibration" in those of all tests, is one error.  `white` is the standard deviation (n,)
    of what counts as white because one record alone does not show and nothing is stated; None where it is known.
    `usual` holds the parts U (n, q) of C, U Uᵀ each, that nobody has stated and the readings do not show.
    `since` (n,) s is the time since the indenter came to rest, 0 for readings of loading; None without those of a hold.
    `back`: the readings are those of the unloading.
    """

    channel: str
    unit: str
    depth: np.ndarray
    value: np.ndarray
    sigma: np.ndarray
    n_repeats: int
    covariance: np.ndarray
    position: np.ndarray | None = None
    freedom: float = math.inf
    shared: Mapping[str, np.ndarray] = field(default_factory=dict)
    white: np.ndarray | None = None
    usual: Mapping[str, np.ndarray] = field(default_factory=dict)
    since: np.ndarray | None = None
    back: bool = False

    @property
    def compared(self) -> np.ndarray:
        """(n,) whether a reading is compared: from contact on, in unloading also above it."""
        return np.ones(len(self.depth), bool) if self.back else self.depth > 0.0

    @property
    def held(self) -> np.ndarray:
        """(n,) whether a reading is one of the hold."""
        return np.zeros(len(self.depth), bool) if self.since is None else self.since > 0.0
