"""Curves over travel: resampling, windows and the error metrics of the literature.  Arrays in, arrays out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

CLOSE_POINTS_RATIO = 0.5  # of the gaps beside it: a smaller one is between two points of which one says what both do
# Beyond the last computed travel by this share of it is round-off, not extrapolation.
_ROUND_OFF_TRAVEL_SHARE = 1e-9
CREEP_CHANNEL = "travel"  # the channel that is read over the time of a hold at a force


@dataclass(frozen=True, eq=False)
class Resampling:
    """A monotonic loading curve that starts at (0, 0), as a cubic spline in s = √u with dF/ds = 0 at contact.

        F(u) = Σ_k c_k (√u − s_i)^k   on [s_i, s_{i+1}],   F(u ≤ 0) = 0

    `travel` (n,) mm, increasing and positive; `value` (n,) or (n, m) for m curves over the same travel.  The
    spline is exact for F = a u + b u^{3/2}, cubic in s, as under a smooth rounded tip.  It is linear in `value`.
    A single point is taken as F ∝ u^{3/2}.

    Raises ValueError for anything else, and for a travel beyond the last point: nothing is extrapolated.
    Assumption: F rises more slowly than √u at contact (every smooth indenter; a flat punch too).
    """

    travel: np.ndarray
    value: np.ndarray

    def __post_init__(self) -> None:
        u, y = np.array(self.travel, float), np.array(self.value, float)
        if u.ndim != 1 or len(u) == 0 or y.ndim not in (1, 2) or len(y) != len(u):
            raise ValueError(f"a curve needs travel (n,) and value (n,) or (n, m), got {u.shape} and {y.shape}")
        if not (np.all(np.isfinite(u)) and np.all(np.isfinite(y))):
            raise ValueError("a curve needs finite travel and value")
        if u[0] <= 0 or np.any(np.diff(u) <= 0):
            raise ValueError(f"travel must increase and be positive ((0, 0) is implied), got {u.tolist()[:10]} mm")
        object.__setattr__(self, "travel", u)
        object.__setattr__(self, "value", y)

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline  # 0.3 s, which commands that compute nothing do without

        s = np.sqrt(np.concatenate([[0.0], self.travel]))
        y = np.concatenate([np.zeros_like(self.value[:1]), self.value])
        flat = np.zeros_like(y[0])
        # With one point the missing condition is F ∝ u^{3/2}: no curvature in s at contact.
        end = "not-a-knot" if len(s) > 2 else (1, 3 * y[-1] / s[-1])
        return CubicSpline(s, y, bc_type=((1, flat), end))

    def _root(self, at: np.ndarray | float) -> np.ndarray:
        u = np.asarray(at, float)
        last = self.travel[-1]
        if not np.all(u <= last * (1 + _ROUND_OFF_TRAVEL_SHARE)):
            raise ValueError(f"travel {np.max(u):g} mm lies beyond the last point of the curve, {last:g} mm")
        return np.sqrt(np.clip(u, 0.0, last))

    def __call__(self, at: np.ndarray | float) -> np.ndarray:
        """Value at travel `at` (mm), any shape; 0 before contact."""
        return self._spline(self._root(at))

    def slope(self, at: np.ndarray | float) -> np.ndarray:
        """dF/du at travel `at` (value per mm): F'(s) / 2s, with the limit F''(0)/2 at contact and 0 before it."""
        u, s = np.asarray(at, float), self._root(at)
        tiny = s < 1e-6 * np.sqrt(self.travel[-1])
        more = tuple(range(s.ndim, s.ndim + self.value.ndim - 1))
        steep, limit = self._spline(s, 1), self._spline(0.0, 2) / 2
        inside = steep / np.expand_dims(2 * np.where(tiny, 1.0, s), more)
        slope = np.where(np.expand_dims(tiny, more), limit, inside)
        return np.where(np.expand_dims(u < 0, more), 0.0, slope)


def first_loading(travel: np.ndarray) -> np.ndarray:
    """Mask (n,) of the points of a response that belong to a :class:`Resampling`: pressed deeper than ever before.

    Programs of others also print the moment of contact, a hold or the unloading.
    """
    u = np.asarray(travel, float)
    return np.concatenate([[True], np.diff(np.maximum.accumulate(u)) > 0])[: len(u)] & (u > 0)


def loading(travel: np.ndarray, value: np.ndarray) -> Resampling:
    """The loading curve in the points (n,) of a response, whatever else it holds; ValueError where it has none."""
    mine = first_loading(travel)
    return Resampling(np.asarray(travel, float)[mine], np.asarray(value, float)[mine])


def way_back(travel: np.ndarray) -> np.ndarray:
    """Rows (m,) of a response from its deepest travel on, the deepest first; only that one where it ends there."""
    u = np.asarray(travel, float)
    return np.arange(int(np.argmax(u)), len(u))


def on_the_way_back(travel: np.ndarray, value: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Values (n,) of a response at depths (n,) mm of its unloading, straight between computed travels.

    A response that ends at its deepest travel is that of a model that returns on its way there, and feels nothing above
    contact.  ValueError for depths beyond the unloading.
    """
    rows, u, y = way_back(travel), np.asarray(travel, float), np.asarray(value, float)
    if len(rows) == 1:
        found = np.zeros(len(depth))
        found[depth > 0.0] = loading(u, y)(depth[depth > 0.0])
        return found
    s, f = u[rows][::-1], y[rows][::-1]
    if depth.min() < s[0] - _ROUND_OFF_TRAVEL_SHARE * s[-1] or depth.max() > s[-1] * (1.0 + _ROUND_OFF_TRAVEL_SHARE):
        raise ValueError(
            f"depths {depth.min():g} to {depth.max():g} mm lie beyond the unloading, {s[0]:g} to {s[-1]:g} mm"
        )
    return np.interp(depth, s, f)


def rests(time: np.ndarray, travel: np.ndarray, depth: float, since: np.ndarray) -> np.ndarray:
    """Rows of a response over time (m,) s that lie `since` (n,) s after the indenter came to rest at a depth (mm).

    A response that ends when the indenter comes is that of a model to which the rest makes no difference: its
    canonical case has none, and the force stays.  KeyError where it goes on without such a moment.
    """
    t, u, s = (np.asarray(v, float) for v in (time, travel, since))
    there = np.nonzero(np.abs(u - depth) < 1e-9)[0]
    if not len(there):
        raise KeyError(f"the response holds travels {u.tolist()} mm, and not {depth:g} mm, where the indenter rests")
    came = int(there[0])
    if came == len(t) - 1:
        return np.full(s.shape, came)
    moment = t[came] + s
    at = np.argmin(np.abs(moment[:, None] - t), axis=1)
    off = (np.abs(t[at] - moment) > 1e-9 * np.abs(t).max()) | (np.abs(u[at] - depth) > 1e-9)
    if off.any():
        lost = ", ".join(f"{v:g}" for v in s[off])
        raise KeyError(f"the response has no force {lost} s after the indenter came to rest at {depth:g} mm")
    return at


def hold_rows(channel: str, time: np.ndarray, travel: np.ndarray, depth: float, since: np.ndarray) -> np.ndarray:
    """Rows of a response over time (m,) s that lie `since` (n,) s after a hold began, at a depth (mm) or of
    CREEP_CHANNEL."""
    return creep_rows(time, since) if channel == CREEP_CHANNEL else rests(time, travel, depth, since)


def creep_rows(time: np.ndarray, since: np.ndarray) -> np.ndarray:
    """Rows of a response over time (m,) s that lie `since` (n,) s after its force was reached, at its first moment.

    KeyError where it has no such moment.
    """
    t, s = np.asarray(time, float), np.asarray(since, float)
    at = np.argmin(np.abs(t[0] + s[:, None] - t), axis=1)
    off = np.abs(t[at] - t[0] - s) > 1e-6 * np.abs(t).max()
    if off.any():
        raise KeyError(
            f"the response has no travel {', '.join(f'{v:g}' for v in s[off])} s after its force was reached"
        )
    return at


def at_readings(
    time: np.ndarray,
    travel: np.ndarray,
    value: np.ndarray,
    depth: np.ndarray,
    since: np.ndarray | None = None,
    back: bool = False,
    channel: str = "",
) -> np.ndarray:
    """Values of a response at readings (n,): of loading by depth (mm), of a hold by the time `since` it began (s).

    `since` is 0 on the way there, None where no reading is one of a hold; readings of a hold are all at its depth, but
    for those of the `channel` CREEP_CHANNEL, which are of a hold at a force.  `back`: all are readings of the
    unloading.
    """
    if channel == CREEP_CHANNEL and since is not None:
        return np.asarray(value)[creep_rows(time, since)]
    if back:
        return on_the_way_back(travel, value, depth)
    there = loading(travel, value)
    if since is None or not since.any():
        return there(depth)
    held, found = since > 0.0, np.empty(len(depth))
    found[~held] = there(depth[~held])
    found[held] = np.asarray(value)[rests(time, travel, float(depth[held][0]), since[held])]
    return found


def error_between_points(travel: np.ndarray, value: np.ndarray, at: np.ndarray) -> np.ndarray:
    """How far a :class:`Resampling` of value (n,) at travel (n,) mm may be off at `at` (m,).

    It is the largest difference of its interval from a spline of degree five in s = √u, which leaves one of two points
    out that are close beside their neighbours: through both it would swing by what each of them is off.  Before the
    first point, which is far from contact in s, that spline has an end and swings likewise.  There it is compared with
    those that go on beyond contact as even and as odd functions of s, the farther of them, too: the nearer counts.
    Where there are fewer than five points, from the curve through every second one, whose error is at least four times
    as large.  0 at computed points, for a single one, and before contact.
    """
    u, y = np.asarray(travel, float), np.asarray(value, float)
    knots = np.append(0.0, u)
    fine = np.unique(np.concatenate([a + (b - a) * np.linspace(0.0, 1.0, 9) for a, b in itertools.pairwise(knots)]))
    if len(u) >= 5:
        from scipy.interpolate import make_interp_spline

        apart, curve = _apart(np.sqrt(knots)), Resampling(u, y)(fine)
        s, F, first = np.sqrt(knots)[apart], np.append(0.0, y)[apart], fine <= u[0]
        off = np.abs(make_interp_spline(s, F, k=5)(np.sqrt(fine)) - curve)
        beyond = np.append(-s[:0:-1], s), np.column_stack([np.append(sign * F[:0:-1], F) for sign in (1.0, -1.0)])
        across = np.abs(make_interp_spline(*beyond, k=5)(np.sqrt(fine[first])) - curve[first][:, None]).max()
        off[first] = np.minimum(off[first], across)
    elif len(u) > 1:
        rest = slice((len(u) - 1) % 2, None, 2)
        off = np.abs(Resampling(u[rest], y[rest])(fine) - Resampling(u, y)(fine)) / 4
    else:
        return np.zeros(np.shape(at))
    largest = [float(off[(fine >= a) & (fine <= b)].max()) for a, b in itertools.pairwise(knots)]
    where = np.clip(np.searchsorted(knots, at, side="left") - 1, 0, len(largest) - 1)
    at = np.asarray(at, float)
    computed = np.min(np.abs(np.subtract.outer(at, knots)), axis=-1) <= _ROUND_OFF_TRAVEL_SHARE * knots[-1]
    return np.where((at > 0.0) & ~computed, np.array(largest)[where], 0.0)


def _apart(s: np.ndarray) -> np.ndarray:
    """Mask (n,) of knots without one of each pair that is close beside its neighbours; the ends, and six, stay."""
    apart = np.ones(len(s), bool)
    while apart.sum() > 6:
        kept = np.nonzero(apart)[0]
        gap = np.diff(s[kept])
        beside = np.minimum(np.append(gap[1:], math.inf), np.append(math.inf, gap[:-1]))
        close = gap[1:] / beside[1:]  # contact is no computed point
        if not len(close) or close.min() >= CLOSE_POINTS_RATIO:
            break
        k = 1 + int(np.argmin(close))
        apart[kept[k if k + 2 == len(kept) else k + 1]] = False
    return apart


def rows_at(at: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """y(at) (T, n) row by row, linear between increasing x and constant beyond; at (n,) or (T, n), x (m,) or (T, m)."""
    # copies, as views that may not be written to are other types, and each mixture would be compiled by itself
    own = [np.array(np.broadcast_to(v, (len(y), np.shape(v)[-1])), float, order="C") for v in (at, x, y)]
    return _compiled()(*own)


@cache
def _compiled() -> Callable[..., np.ndarray]:
    import numba  # a second to import, and only curves of many rows need it

    return numba.njit(cache=True)(_rows_at)


def _rows_at(at: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    out = np.empty(at.shape)
    last = x.shape[1] - 1
    for t in range(at.shape[0]):
        for j in range(at.shape[1]):
            v = at[t, j]
            low, high = 0, last
            while high - low > 1:
                mid = (low + high) // 2
                if x[t, mid] <= v:
                    low = mid
                else:
                    high = mid
            if v >= x[t, last]:
                out[t, j] = y[t, last]
            elif v <= x[t, low]:
                out[t, j] = y[t, low]
            else:
                share = (v - x[t, low]) / (x[t, high] - x[t, low])
                out[t, j] = y[t, low] + share * (y[t, high] - y[t, low])
    return out


def depth_window(travel: np.ndarray, value: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Points with low ≤ travel ≤ high (mm); ValueError if none is left."""
    u = np.asarray(travel, float)
    keep = (u >= low) & (u <= high)
    if not keep.any():
        reach = f"[{u.min():g}, {u.max():g}] mm" if u.size else "nothing"
        raise ValueError(f"no point of the curve lies in [{low:g}, {high:g}] mm; it spans {reach}")
    return u[keep], np.asarray(value, float)[keep]


@dataclass(frozen=True)
class Metrics:
    """Error norms of a prediction against `n` measured values; those that have no meaning are NaN.

    RMSE = √mean(Δ²) in the unit of y, NRMSE = RMSE / |mean(y)|, MRE = mean|Δ/y|, MAPE = 100 MRE,
    RRMSE = √mean((Δ/y)²); Δ = prediction − measurement.  `excluded` points with |y| ≤ `floor` do not enter
    MRE, MAPE and RRMSE.
    """

    rmse: float
    nrmse: float
    mre: float
    mape: float
    rrmse: float
    n: int
    excluded: int
    floor: float


def metrics(measured: np.ndarray, predicted: np.ndarray, floor: float = 0.0) -> Metrics:
    """Error norms of `predicted` (n,) against `measured` (n,); `floor` in the unit of the channel.

    NRMSE is NaN when |mean(y)| ≤ `floor`, the relative norms when every point is excluded.  ValueError for
    shapes that differ, no points, NaN or a negative floor.
    """
    y, f = np.asarray(measured, float), np.asarray(predicted, float)
    if y.shape != f.shape or y.ndim != 1 or y.size == 0:
        raise ValueError(f"metrics need two arrays of the same length >= 1, got shapes {y.shape} and {f.shape}")
    if not (np.all(np.isfinite(y)) and np.all(np.isfinite(f))):
        raise ValueError("metrics need finite values")
    if not floor >= 0:
        raise ValueError(f"floor = {floor} must be >= 0")
    Δ = f - y
    used = np.abs(y) > floor
    relative = Δ[used] / y[used]
    rmse, mean = float(np.sqrt(np.mean(Δ**2))), abs(float(np.mean(y)))
    mre = float(np.mean(np.abs(relative))) if used.any() else np.nan
    rrmse = float(np.sqrt(np.mean(relative**2))) if used.any() else np.nan
    nrmse = rmse / mean if mean > floor else np.nan
    return Metrics(rmse, nrmse, mre, 100 * mre, rrmse, y.size, int(np.sum(~used)), floor)


def baseline(measured: np.ndarray, floor: float = 0.0) -> Metrics:
    """Metrics of the model that predicts mean(y) everywhere: what a prediction must beat.

    Its NRMSE is the standard deviation (divisor n) over the mean.  Some authors print mean|y − ȳ|/ȳ as its
    MRE; here MRE keeps its definition.
    """
    y = np.asarray(measured, float)
    return metrics(y, np.full(y.shape, np.mean(y) if y.size else np.nan), floor)
