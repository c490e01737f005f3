"""The drift of a force: a straight line through the readings of an approach, and how sure it goes on beyond contact.

    F(x) = b + s (x − x̄) + noise,    x the time (s) or the travel (mm) of the readings before contact

Thermal drift and a creeping cell go on with time, a tilted or flexing cable and the stray light of a laser with travel.
The line is subtracted from the whole record.  What it is off by grows away from the approach, σ_s (x − x̄), and is an
error that all readings of a record share.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rso.core.digits import quantity_text, range_text, two_digits
from rso.core.distributions import student
from rso.data.contact_point import MIN_DRIFT_STANDARD_ERRORS, MIN_READINGS_FOR_CONTACT, own_share
from rso.data.usual_errors import USUAL_CONTACT_ERROR_SHARE

DriftAlong = Literal["time", "travel"]
MIN_BEND_STANDARD_ERRORS = 3.0  # by which the slopes of the halves of an approach clearly differ
DRIFT_CHANGE_SHARE = 0.2  # of a slope: what it is off by beyond the approach, as temperatures follow no straight line
MIN_COUNTED_STANDARD_ERRORS = 2.0  # of a slope that nobody has stated, from which on it counts as an error
MIN_DRIFT_SHARE = 0.01  # of all that the force changes by: a line that goes on by less does not matter
MAX_KNOWN_DRIFT_ERROR_SHARE = 0.02  # of all: what a line may be off by at the deepest reading without a word
MAX_AIR_TO_CONTACT_SHARE = 0.5  # of the approach that is left out before a contact of which little is known


@dataclass(frozen=True)
class Baseline:
    """A line through a force (N) before contact over time (s) or travel (mm).

    `level` N at `middle`, `slope` N/s or N/mm, each with its standard error; `slope_scatter` is what readings make of
    that of the slope, beside which a drift is no straight line.  `bends`: the halves of the approach have slopes that
    clearly differ.  `subtracted` or not; where not, the line itself counts as an error, from contact at `middle` on.
    """

    along: DriftAlong
    middle: float
    level: float
    slope: float
    level_error: float
    slope_error: float
    slope_scatter: float
    bends: bool = False
    subtracted: bool = True

    def line(self, x: np.ndarray) -> np.ndarray:
        """The line (n,) N at times or travels x (n,)."""
        return self.level + self.slope * (x - self.middle)

    def errors(self, x: np.ndarray) -> np.ndarray:
        """Columns (n, 2) of U, U Uᵀ the covariance of what the line is off by at x (n,): its level and its slope."""
        return np.stack([np.full(len(x), self.level_error), self.slope_error * (x - self.middle)], axis=1)

    def moved_by(self, rest: Baseline) -> Baseline:
        """The line of readings from which this slope was taken, through what was left of them."""
        off = math.hypot(self.slope_error, rest.slope)
        return replace(self, middle=rest.middle, level=rest.level, slope=self.slope + rest.slope, slope_error=off)

    @property
    def share_off(self) -> float:
        """Standard error of the slope over the slope."""
        return self.slope_error / max(abs(self.slope), 1e-300)

    @property
    def is_clear(self) -> bool:
        """Whether the slope is no scatter beyond doubt."""
        return abs(self.slope) > MIN_DRIFT_STANDARD_ERRORS * self.slope_scatter


def drift_coordinate(along: DriftAlong, depth: np.ndarray, time: np.ndarray | None) -> np.ndarray:
    """Times or travels (n,) of readings; ValueError where there are no times."""
    if along == "travel":
        return depth
    if time is None:
        raise ValueError('drift = "time": the record has no times; choose "travel"')
    return time


def approach_readings(depth: np.ndarray, loading: np.ndarray, off: float) -> np.ndarray:
    """(n,) which readings of loading lie before contact, at depth 0, by more than that may be `off` (mm)."""
    first = float(depth[loading].min(initial=0.0))
    off = max(off, USUAL_CONTACT_ERROR_SHARE * float(depth.max()))
    return loading & (depth < max(-off, MAX_AIR_TO_CONTACT_SHARE * first))


def fitted_baseline(along: DriftAlong, x: np.ndarray, force: np.ndarray) -> Baseline:
    """The line of least squares through the readings (n,) of an approach; ValueError where they are too few.

        σ_s² = s²/(n' var x) + max((s₂ − s₁)² − σ₂₁², 0) + (0.2 s)²

    n' is how many of the n readings count, as they are autocorrelated (:func:`~rso.data.contact_point.own_share`); s₁
    and s₂ are the slopes of the two halves of the approach, σ₂₁ what scatter makes of their difference.
    """
    n = len(x)
    if n < MIN_READINGS_FOR_CONTACT or np.ptp(x) == 0.0:
        many = f"{n} {'reading' if n == 1 else 'readings'}"
        raise ValueError(
            f"drift: the approach is too short for a line, {many} before contact and {MIN_READINGS_FOR_CONTACT} are "
            'needed; drift = "none" subtracts none'
        )
    level, slope, _ = _line(x, force)
    halves = np.array_split(np.argsort(x, kind="stable"), 2)
    each = [_line(x[half], force[half]) for half in halves]
    rest = np.concatenate([r for *_, r in each])
    count = n * own_share(rest, n)
    scatter = math.sqrt(float(rest @ rest) / (n - 4)) * float(student(max(count - 4.0, 1.0)))
    error = scatter / (math.sqrt(count) * float(np.std(x)))
    apart = abs(each[1][1] - each[0][1])
    own = scatter * math.sqrt(sum(2.0 / (count * max(float(np.var(x[half])), 1e-300)) for half in halves))
    bends, bend = apart > MIN_BEND_STANDARD_ERRORS * own, math.sqrt(max(apart**2 - own**2, 0.0))
    whole = math.hypot(error, bend, DRIFT_CHANGE_SHARE * slope)
    return Baseline(along, float(x.mean()), level, slope, scatter / math.sqrt(count), whole, error, bends)


def _line(x: np.ndarray, force: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Mean (N), slope and residuals (n,) of the line of least squares."""
    t = x - x.mean()
    slope = float(t @ force) / max(float(t @ t), 1e-300)
    level = float(force.mean())
    return level, slope, force - level - slope * t


def unstated_drift(
    along: DriftAlong, x: np.ndarray, before: np.ndarray, depth: np.ndarray, force: np.ndarray
) -> Baseline | None:
    """A drift that nobody has stated, as an error from contact on: None where the readings `before` (n,) contact are
    few, or show no straight line that is hardly scatter and goes on to more than MIN_DRIFT_SHARE of the force.

    It may be a drift, which a force goes on with, or what the body does before contact, which it does not: the line is
    then its own standard deviation.
    """
    if before.sum() < MIN_READINGS_FOR_CONTACT or np.ptp(x[before]) == 0.0:
        return None
    found = fitted_baseline(along, x[before], force[before])
    pressed = depth >= 0.0
    scatters = abs(found.slope) < MIN_COUNTED_STANDARD_ERRORS * found.slope_scatter
    if found.bends or scatters or not pressed.any():
        return None
    contact = float(x[pressed][np.argmin(depth[pressed])])
    if abs(found.slope) * float(np.ptp(x[pressed])) < MIN_DRIFT_SHARE * float(np.ptp(force)):
        return None
    level = float(found.line(np.array(contact)))
    return replace(found, middle=contact, level=level, subtracted=False)


def without_baselines(
    lines: Mapping[str, Baseline], channels: Mapping[str, np.ndarray], x: np.ndarray
) -> dict[str, np.ndarray]:
    """Channels (n,) of a record less their lines."""
    return {c: v - lines[c].line(x) if c in lines else v for c, v in channels.items()}


def drift_words(channel: str, line: Baseline, x: np.ndarray, depth: np.ndarray, force: np.ndarray) -> str:
    """What to say of a line that was subtracted of the forces (n,) of a record, and of one that is not known well."""
    deepest, span = int(np.argmax(depth)), float(np.ptp(force))
    way = float(x[deepest] - line.middle)
    on, off = line.slope * way, abs(line.slope_error * way)
    slope = quantity_text(line.slope, "N/s" if line.along == "time" else "N/mm", 2)
    share = two_digits(100.0 * abs(on) / span)
    said = (
        f"a line through {channel} of the approach is subtracted, {slope}; up to the deepest reading it grows to "
        f"{range_text(on, off, 'N', '±', 2)}, {share} % of all"
    )
    if line.bends:
        return f"{said}. {channel} does not change along a straight line there, which is in that error"
    if math.sqrt(max(off**2 - (DRIFT_CHANGE_SHARE * on) ** 2, 0.0)) > MAX_KNOWN_DRIFT_ERROR_SHARE * span:
        return f"{said}. The approach is too short to know it better"
    return said
