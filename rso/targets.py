"""Point targets and limits on outputs, as objectives and violations of predicted values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Target:
    """A measured value to be met: one channel of one experiment at one depth (mm), with its standard deviation."""

    experiment: str
    channel: str
    depth_mm: float
    value: float
    sigma: float
    unit: str

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.sigma) and self.sigma >= 0):
            raise ValueError(
                f"{self}: needs a finite value and sigma >= 0, got {self.value} ± {self.sigma} {self.unit}"
            )

    def __str__(self) -> str:
        return f"{self.channel} of {self.experiment} at {self.depth_mm:g} mm"


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


def residuals(targets: Sequence[Target], outputs: np.ndarray) -> np.ndarray:
    """Signed differences y_j − value_j (n, m), in the units of the outputs (n, m)."""
    return _outputs(outputs, len(targets)) - np.array([t.value for t in targets])


def objectives(targets: Sequence[Target], outputs: np.ndarray) -> np.ndarray:
    """|y_j − value_j| (n, m), to be minimised, in the units of the outputs (n, m)."""
    return np.abs(residuals(targets, outputs))


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
