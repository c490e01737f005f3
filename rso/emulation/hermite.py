"""One-parameter emulators of many outputs: a cubic through the values and derivatives of a few runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from rso.doe import Box
from rso.emulation.emulator import Output, Sample

HERMITE_ORDER = 4  # of the error of a cubic Hermite spline in its step


@dataclass(frozen=True, eq=False)
class Cubic:
    """A surrogate over [0, 1]: its spline, the largest error where an inner run is left out, its largest value."""

    d: ClassVar[int] = 1
    spline: CubicHermiteSpline
    left_out: float
    largest: float

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Values (n,) at X (n, 1)."""
        return self.spline(np.asarray(X, float)[:, 0])

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviation (n,): without a run the step doubles, the error grows 2⁴-fold."""
        return self.mean(X), np.full(len(X), self.left_out / 2**HERMITE_ORDER)


def along_one(box: Box, outputs: Sequence[Output], samples: Sequence[Sample]) -> dict[str, Cubic] | None:
    """Cubics by output id over a box of one parameter; None where a run has no derivative by it."""
    (name,) = box.names
    x = np.array([box.to_unit(np.array([s.values[name]]))[0] for s in samples]).ravel()
    order = np.argsort(x)
    scale = np.array([box.slope(np.array([v]))[0] for v in x])
    out = {}
    for o in outputs:
        if any(name not in s.gradients.get(o.id, {}) for s in samples):
            return None
        y = np.array([s.outputs[o.id] for s in samples])
        dy = np.array([s.gradients[o.id][name] for s in samples]) * scale
        spline = CubicHermiteSpline(x[order], y[order], dy[order])
        out[o.id] = Cubic(spline, _left_out(x[order], y[order], dy[order]), float(np.abs(y).max()))
    return out


def _left_out(x: np.ndarray, y: np.ndarray, dy: np.ndarray) -> float:
    """Largest error at an inner point that its two neighbours predict."""
    worst = 0.0
    for k in range(1, len(x) - 1):
        ends = [k - 1, k + 1]
        worst = max(worst, abs(float(CubicHermiteSpline(x[ends], y[ends], dy[ends])(x[k])) - float(y[k])))
    return worst
