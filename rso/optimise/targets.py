"""Point targets and limits on outputs: objectives and violations of predicted values, and what was met in the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rso.core.units import spaced


@dataclass(frozen=True)
class Target:
    """A value to be met: one channel of one experiment at one depth (mm), with its standard deviation.

    `read`: read off noisy data, not stated; of a perfect model one in some hundreds then misses by more than 3 σ.
    `since_s` is the time in a hold at that depth, 0 on the way there.  `input_error` is what one standard uncertainty
    of each stated input moves the simulated value by, root sum of squares: what was read off has that error, too.
    """

    experiment: str
    channel: str
    depth_mm: float
    value: float
    sigma: float
    unit: str
    read: bool = False
    since_s: float = 0.0
    input_error: float = 0.0

    @property
    def uncertainty(self) -> float:
        """Standard deviation of measured less simulated value of a perfect model, in the unit of the value."""
        return math.hypot(self.sigma, self.input_error)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.sigma) and self.sigma >= 0):
            raise ValueError(
                f"{self}: needs a finite value and sigma >= 0, got {self.value} ± {self.sigma} {self.unit}"
            )

    def __str__(self) -> str:
        held = f", {self.since_s:.3g} s into the hold" if self.since_s else ""
        return f"{self.channel} of {self.experiment} at {self.depth_mm:g} mm{held}"


@dataclass(frozen=True)
class Constraint:
    """Limits on an output; leave a side open with −inf or inf."""

    experiment: str
    channel: str
    depth_mm: float
    low: float
    high: float
    unit: str

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"{self}: needs low <= high, got [{self.low}, {self.high}] {self.unit}")

    def __str__(self) -> str:
        return f"{self.channel} of {self.experiment} at {self.depth_mm:g} mm"

    @property
    def words(self) -> str:
        """' >= 1 N', ' <= 2 N' or ' within 1 to 2 N'."""
        unit = spaced(self.unit)
        if np.isfinite(self.low) and np.isfinite(self.high):
            return f" within {self.low:g} to {self.high:g}{unit}"
        return f" >= {self.low:g}{unit}" if np.isfinite(self.low) else f" <= {self.high:g}{unit}"


@dataclass(frozen=True)
class Checked:
    """A recomputed `value` against what was demanded of it; `miss` is signed and 0 within limits, in `unit`.

    `demand` says what is asked in words, `kind` whether by a target, a constraint on an output or one on parameters.
    """

    kind: Literal["target", "constraint", "condition"]
    output: str | None
    demand: str
    value: float
    miss: float
    tolerance: float
    unit: str

    @property
    def met(self) -> bool:
        """Whether the demand is met within its tolerance; NaN meets nothing."""
        return abs(self.miss) <= self.tolerance

    @property
    def size(self) -> float:
        """|miss| in tolerances; for a limit, which has none to speak of, as a share of the value or of the miss."""
        if self.kind == "target":
            return abs(self.miss) / self.tolerance
        return 0.0 if self.met else abs(self.miss) / max(abs(self.value), abs(self.miss))

    def __str__(self) -> str:
        unit = spaced(self.unit)
        if self.kind == "target":
            return f"{self.demand} is missed by {self.miss:+.3g}{unit} (tolerance {self.tolerance:.3g}{unit})"
        of = f", by {abs(self.miss):.3g}{unit}: it is {self.value:.4g}{unit}" if self.kind == "constraint" else ""
        return f"{self.demand} is violated{of}"


LIMIT_ROUNDING_SHARE = 1e-6  # of a limit: less is no violation
READ_OFF_TOLERANCE_SD = 3.0  # standard deviations by which a value read off noisy data may be missed


def against(target: Target, output: str, value: float, error: float = 0.0) -> Checked:
    """A recomputed value, of estimated numerical `error`, against a target; `output` is its id.

    A stated value is met within σ, one that was read off the data within 3 u + error: it is no more certain than that.
    u is σ with what the stated inputs may be off by.
    """
    tolerance = READ_OFF_TOLERANCE_SD * target.uncertainty + error if target.read else target.sigma
    demand = f"{target} = {target.value:.4g}{spaced(target.unit)}"
    return Checked("target", output, demand, value, value - target.value, tolerance, target.unit)


def excess_over_limits(limits: Constraint, output: str, value: float) -> Checked:
    """A recomputed value against limits; above `high` the miss is positive, below `low` negative."""
    miss = value - min(max(value, limits.low), limits.high)
    limit = limits.low if miss < 0 else limits.high
    slack = LIMIT_ROUNDING_SHARE * abs(limit) if np.isfinite(limit) else 0.0
    return Checked("constraint", output, f"{limits}{limits.words}", value, miss, slack, limits.unit)


def target_residuals(targets: Sequence[Target], outputs: np.ndarray) -> np.ndarray:
    """Signed differences y_j − value_j (n, m), in the units of the outputs (n, m)."""
    return _outputs(outputs, len(targets)) - np.array([t.value for t in targets])


def objectives(targets: Sequence[Target], outputs: np.ndarray) -> np.ndarray:
    """|y_j − value_j| (n, m), to be minimised, in the units of the outputs (n, m)."""
    return np.abs(target_residuals(targets, outputs))


def violations(constraints: Sequence[Constraint], outputs: np.ndarray) -> np.ndarray:
    """max(low_j − y_j, y_j − high_j, 0) (n, k) in the units of the outputs; 0 where respected."""
    y = _outputs(outputs, len(constraints))
    low, high = np.array([c.low for c in constraints]), np.array([c.high for c in constraints])
    return np.maximum(np.maximum(low - y, y - high), 0.0)


def _outputs(outputs: np.ndarray, m: int) -> np.ndarray:
    y = np.asarray(outputs, float)
    if y.ndim != 2 or y.shape[1] != m:
        raise ValueError(f"outputs need shape (n, {m}), one column per target or constraint, got {y.shape}")
    return y
