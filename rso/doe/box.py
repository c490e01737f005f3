"""The box that gives the unit cube its units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Box:
    """Ranges of the parameters: maps physical values θ (n, d) to the unit cube and back, linear or log each."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    log: tuple[bool, ...]

    def __post_init__(self) -> None:
        for name in ("names", "units", "low", "high", "log"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len({len(v) for v in (self.names, self.units, self.low, self.high, self.log)}) != 1 or not self.names:
            raise ValueError("box: names, units, low, high and log need one entry per parameter")
        for name, unit, low, high, log in zip(self.names, self.units, self.low, self.high, self.log, strict=True):
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise ValueError(f"box: {name} needs low < high, got [{low}, {high}] {unit}")
            if log and low <= 0:
                raise ValueError(f"box: {name} on a log scale needs low > 0, got [{low}, {high}] {unit}")

    @property
    def d(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        """Bounds (d,), which axes are logarithmic, high/low there, low there and else 1, ln(high/low) and else 1."""
        low, high, log = np.array(self.low), np.array(self.high), np.array(self.log)
        safe = np.where(log, low, 1.0)
        return low, high, log, np.where(log, high / safe, 1.0), safe, np.log(np.where(log, high / safe, np.e))

    def from_unit(self, x: np.ndarray) -> np.ndarray:
        """θ = low + x (high − low), or low (high/low)^x on a log scale; x (..., d); 0 and 1 give the ends exactly."""
        x = self._check(x)
        low, high, log, ratio, _, _ = self._arrays
        theta = np.where(log, low * ratio**x, low + x * (high - low))
        np.copyto(theta, low, where=x == 0)
        np.copyto(theta, high, where=x == 1)
        return theta

    def to_unit(self, theta: np.ndarray) -> np.ndarray:
        """Inverse of :meth:`from_unit`; θ (..., d). A value <= 0 on a log scale raises ValueError."""
        theta = self._check(theta)
        low, high, log, _, safe, width = self._arrays
        below = (theta <= 0) & log
        if below.any():
            bad = [n for n, b in zip(self.names, np.any(below, axis=tuple(range(theta.ndim - 1))), strict=True) if b]
            raise ValueError(f"box: {', '.join(bad)} must be > 0 on a log scale")
        x = np.where(log, np.log(np.where(log, theta, 1.0) / safe) / width, (theta - low) / (high - low))
        np.copyto(x, 1.0, where=theta == high)
        np.copyto(x, 0.0, where=theta == low)
        return x

    def slope(self, x: np.ndarray) -> np.ndarray:
        """dθ/dx at x (..., d) of the unit cube: high − low, or θ ln(high/low) on a log scale."""
        low, high, log = np.array(self.low), np.array(self.high), np.array(self.log)
        ratio = np.where(log, high / np.where(log, low, 1.0), 1.0)
        return np.where(log, self.from_unit(x) * np.log(ratio), high - low)

    def widened(self, factor: float) -> Box:
        """The box whose ranges are `factor` >= 1 times as wide about the same (logarithmic) middle."""
        over = 0.5 * (factor - 1)
        low, high, log = np.array(self.low), np.array(self.high), np.array(self.log)
        ratio = np.where(log, high / np.where(log, low, 1.0), 1.0) ** over
        ends = np.where(log, [low / ratio, high * ratio], [low - over * (high - low), high + over * (high - low)])
        return replace(self, low=tuple(map(float, ends[0])), high=tuple(map(float, ends[1])))

    def contains(self, theta: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
        """Mask (...,) of the θ (..., d) inside the box, up to `tolerance` of each range."""
        theta = self._check(theta)
        low, high = np.array(self.low), np.array(self.high)
        slack = tolerance * (high - low)
        return np.all((theta >= low - slack) & (theta <= high + slack), axis=-1)

    def _check(self, values: np.ndarray) -> np.ndarray:
        values = np.asarray(values, float)
        if values.shape[-1:] != (self.d,):
            raise ValueError(f"box: expected {self.d} values ({', '.join(self.names)}), got shape {values.shape}")
        return values
