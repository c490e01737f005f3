"""Where the library computes an effect, and cardinal weights that carry its computed changes to any size and shape."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from rso.discrepancy.library.effects import Effect, Size

CORRECTION_REACH = 0.4  # in ln size, or of the range of a variant: how far a mended point reaches
MAX_NODE_STEP_LN_TIME = 2.0  # of ln τ at most from one node to the next, where most was measured
# overlap of two points from which the later stands for both: a line through them would lead anywhere
SAME_POINT_OVERLAP = 0.9


@dataclass(frozen=True, eq=False)
class Nodes:
    """Sizes (n,) as signed deviations and shapes (n, d) of an effect, on a tensor grid `levels`; first axis is size.

    Of the shapes every `fine`-th level was computed.
    """

    levels: tuple[np.ndarray, ...]
    middle: float
    anchored: bool
    fine: int = 1

    @property
    def points(self) -> np.ndarray:
        """(n, 1 + d), shapes in their own coordinate."""
        return grid_points(self.levels)

    @property
    def middling(self) -> np.ndarray:
        """(n,) whether all shapes are those in the middle, the lower one of two."""
        middle = [v[(len(v) - 1) // 2] for v in self.levels[1:]]
        return np.all(self.points[:, 1:] == middle, axis=1)

    def weights(self, at: np.ndarray) -> np.ndarray:
        """(m, n): value at points `at` (m, 1 + d) = weights @ values at the nodes; neutral counts as a node of 0."""
        W = self._sizes(at[:, 0])
        for k, level in enumerate(self.levels[1:], 1):
            inside = np.clip(at[:, k], level.min(), level.max())
            # another support holds or lets go from one value to the next, nothing lies between
            along = piecewise(level, inside) if self.anchored else nearest_weights(level, inside)
            W = (W[:, :, None] * along[:, None, :]).reshape(len(at), -1)
        return W

    def _sizes(self, s: np.ndarray) -> np.ndarray:
        """Cardinal functions (m, n) of the size: of what is proportional to s and what saturates, x = s / (|s| + m)."""
        level = self.levels[0]
        if not self.anchored:
            return cardinal(level, s)
        if self.fine > 1:
            return piecewise(np.append(0.0, level), s)[:, 1:]
        if not math.isfinite(self.middle):
            return cardinal(np.append(0.0, level), s)[:, 1:]

        def basis(v: np.ndarray) -> np.ndarray:
            x = v / (np.abs(v) + self.middle)
            sided = level.min() < 0 < level.max()
            return np.stack([v, v * x, x, x**2] if sided else [v, x, x**2], axis=1)[:, : len(level)]

        return basis(s) @ np.linalg.inv(basis(level))

    def overlap(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(m, n): Gaussian of the distance of points a (m, 1 + d) and b (n, 1 + d), 1 where they are one.

        Sizes of an effect with a neutral value are near in ln |s| and on one side; shapes within half a step of nodes.
        """
        if self.anchored:
            logs = [np.log(np.maximum(np.abs(v[:, 0]), 1e-12)) for v in (a, b)]
            K = np.exp(-0.5 * ((logs[0][:, None] - logs[1]) / CORRECTION_REACH) ** 2)
            K = K * (np.sign(a[:, None, 0]) == np.sign(b[None, :, 0]))
        else:
            spread = np.ptp(self.levels[0]) or 1.0
            K = np.exp(-0.5 * ((a[:, None, 0] - b[None, :, 0]) / (CORRECTION_REACH * spread)) ** 2)
        for j, level in enumerate(self.levels[1:], 1):
            step = self.fine * (np.ptp(level) or 1.0) / max(len(level) - 1, 1)
            K = K * np.exp(-0.5 * ((a[:, None, j] - b[None, :, j]) / (0.5 * step)) ** 2)
        return K

    def nearness(self, at: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(m, n): weights of points (n, 1 + d), no two the SAME_POINT_OVERLAP, at `at` (m, 1 + d): 1 at its own, 0 at
        the others."""
        return self.overlap(at, points) @ np.linalg.inv(self.overlap(points, points))


def nodes(effect: Effect, primary: bool, speeds: tuple[float, float], dear: bool = False, alone: bool = False) -> Nodes:
    """The nodes of an effect at its primary place, where most was measured, or fewer elsewhere, fewest where runs are
    `dear`; where all tests are at one place, `alone`, what sits beside it looks much like what sits deeper.  What flows
    takes another time at every place: it has all of its nodes everywhere.

    `speeds` (mm/s), slowest and fastest test: a shape with the unit of time counts in travel, τ v.
    """
    size, ends = effect.size, effect.size.ends()
    primary = primary or effect.flows
    shapes = tuple(_shape_level(s, primary, speeds, alone) for s in effect.shape)
    few = not primary
    if size.neutral is None:  # a variant: all of its range, there is no neutral to lean on
        low, high = ends[0]
        level = np.array([0.5 * (low + high)]) if size.low == 0 else np.linspace(low, high, 2 if dear else 4)
        # a body slides or sticks, and where it sticks more friction changes nothing: denser where it slides
        slides = (low + np.array([0.0, 1 / 3, 1.0]) * (high - low) for low, high in (s.ends()[0] for s in effect.shape))
        return Nodes((level, *slides), math.inf, False)
    if len(ends) == 1:
        far = ends[0][1]
        # what saturates at small sizes (friction, once it sticks) does so at every place
        shares = ((0.5,) if few else (0.35, 1.0)) if shapes else (0.25, 1.0) if dear else (0.12, 0.4, 1.0)
        return Nodes((np.sort(far * np.array(shares)), *shapes), 0.5 * abs(far), True)
    low, high = ends[0][1], ends[1][1]
    if effect.place is not None:  # as far as another place is away: a parabola is not enough
        level = np.array([0.5 * low, 0.5 * high] if dear else [0.9 * low, 0.35 * low, 0.35 * high, 0.9 * high])
        return Nodes((level, *shapes), math.inf, True)
    if not size.ratio and abs(abs(low) - abs(high)) < 0.5 * abs(high):
        # a dimension, a tilt: a parabola through neutral; both signs are the same but for marks beside the plane
        return Nodes((0.7 * np.array([high] if dear else [low, high]), *shapes), math.inf, True)
    shares = (0.5,) if few else (0.35, 1.0)
    sides = [e for e in (low, high) if not few or abs(e) > 0.3 * max(abs(low), abs(high))]
    level = np.sort(np.array([e * f for e in sides for f in shares]))
    return Nodes((level, *shapes), 0.5 * max(abs(low), abs(high)), True)


def grid_points(levels: Sequence[np.ndarray]) -> np.ndarray:
    """Points (n, d) of a tensor grid; the empty one has a single point."""
    return np.array(list(itertools.product(*levels)), float).reshape(math.prod(len(v) for v in levels), len(levels))


def timed(shape: Size) -> bool:
    """Whether a shape counts relative to the duration of a test: a time, or what goes with the inverse of one."""
    return shape.neutral is None and shape.power_of_time != 0


def late(effect: Effect, speed: float) -> np.ndarray:
    """What size and shapes (1 + d,) of an effect at a speed (mm/s) gain to be those at 1 mm/s of the same travel."""
    return np.array([s.power_of_time if timed(s) else 0.0 for s in effect.knobs]) * math.log(speed)


def is_placed(shape: Size) -> bool:
    """Whether a shape is a place, to both sides of a middle: what sits beside one point sits below another."""
    return shape.low < 0 < shape.high


def _shape_level(shape: Size, primary: bool, speeds: tuple[float, float], alone: bool) -> np.ndarray:
    low, high = shape.ends()[0]
    if timed(shape):
        power = shape.power_of_time
        low, high = (v + power * math.log(speed) for v, speed in zip((low, high), speeds[::power], strict=True))
        if primary:
            return np.linspace(low, high, max(5, 1 + math.ceil((high - low) / MAX_NODE_STEP_LN_TIME)))
        return np.array([0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high])
    if is_placed(shape):
        return np.array([0.5 * (low + high)]) if alone else np.linspace(low, high, 5)
    if not primary and shape.low >= 0 and not (shape.low == 0 and shape.unit == "deg"):
        return np.array([0.5 * (low + high)])
    return np.linspace(low, high, 3 if shape.logarithmic else 2)


def tensor(levels: Sequence[np.ndarray], x: np.ndarray) -> np.ndarray:
    """Cardinal functions (m, n) of a tensor grid at x (m, d)."""
    W = np.ones((len(x), 1))
    for k, level in enumerate(levels):
        W = (W[:, :, None] * piecewise(level, x[:, k])[:, None, :]).reshape(len(x), -1)
    return W


def nearest_weights(level: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m, n): 1 at the node of a shape that is nearest to each of `at` (m,)."""
    return np.eye(len(level))[np.argmin(np.abs(at[:, None] - level), axis=1)]


def cardinal(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Lagrange's cardinal polynomials (m, n) through the nodes x."""
    W = np.ones((len(at), len(x)))
    for i in range(len(x)):
        for j in range(len(x)):
            if i != j:
                W[:, i] *= (at - x[j]) / (x[i] - x[j])
    return W


def piecewise(level: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Cardinal functions (m, n) of a shape: cubic spline through 4 or more nodes, else Lagrange."""
    if len(level) < 4:
        return cardinal(level, at)
    return CubicSpline(level, np.eye(len(level)), bc_type="natural")(at)
