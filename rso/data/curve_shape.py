"""What a record looks like: rests, ways back, jumps, its onset, the power that it follows; numbers, no judgement."""

from __future__ import annotations

import math

import numpy as np

from rso.data.contact_point import CLEAR, LATE, MOST

FEW = 8  # readings: less is a table by hand, of which only order, sign and tare are looked at
FEWEST = 4  # readings that tell these
SLIPPED = 5.0  # times what the others say: a reading of a table by hand that may be mistyped
EDGE = 0.05  # of the readings of loading: what counts as its start and its end
POWERS = np.linspace(0.9, 2.5, 33)  # of curves that begin at contact, from a flat punch to a stiffening body
MARKED = 50.0  # times all other readings: no force and no depth
STUCK = 10  # readings at the deepest point that make a rest, where no times are known
JITTER = 0.05  # of the stroke: a way back by less is jitter
STILL = 0.0025  # of the stroke: less is a rest at one depth
PAUSE = 0.1  # of the time of loading: a rest on the way this long is remarked upon
BESIDE = 8.0  # times the steps beside it: a step that is none of theirs
FALL = 0.1  # of its range that a force of loading may fall before the deepest point
FLAT = 5  # equal largest readings in a row: a sensor at its end


def placeholder_readings(values: np.ndarray) -> np.ndarray:
    """Indices of a few readings of the same size, MARKED times that of any other: 9999 or −9999 where nothing was."""
    size = np.abs(values)
    far = np.nonzero(size == size.max())[0]
    others = np.delete(size, far)
    return far if len(far) < len(others) and size.max() > MARKED * others.max() > 0.0 else far[:0]


def while_moving(far: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Those of the steps `far` (n,) before and after which the indenter moves: others begin or end a rest."""
    least = 0.25 * float(np.ptp(depth)) / len(depth)
    moves = [
        min(abs(depth[k] - depth[k - 3]), abs(depth[k + 4] - depth[k + 1])) > 3.0 * least for k in np.nonzero(far)[0]
    ]
    found = far.copy()
    found[far] = moves
    return found


def isolated_steps(size: np.ndarray, times: float = BESIDE) -> np.ndarray:
    """Which of the steps (n,) are so many times larger than the three on either side; none at the ends.

    Nor those of a coarse scale, on whose marks readings stand for a while: there all steps that are any are alike.
    """
    found = np.zeros(len(size), bool)
    if len(size) > 6 and size.any():
        beside = np.delete(np.lib.stride_tricks.sliding_window_view(size, 7), 3, axis=1)
        found[3:-3] = size[3:-3] > times * np.maximum(beside.max(axis=1), np.median(size[size > 0.0]))
    return found


def slipped(depth: np.ndarray, force: np.ndarray) -> int | None:
    """The one reading of a few whose force is SLIPPED times too large or small for the power of the depth that all
    others follow closely, if there is one: a decimal point that has slipped in its force or its depth."""
    pressed = np.nonzero((depth > 0.0) & (force > 0.0))[0]
    if len(pressed) < FEWEST:
        return None
    x, y = np.log(depth[pressed]), np.log(force[pressed])
    found = []
    for k in range(len(x)):
        u, v = np.delete(x, k), np.delete(y, k)
        if np.ptp(u) == 0.0:
            continue
        p, a = np.polyfit(u, v, 1)
        away, rest = abs(y[k] - a - p * x[k]), float(np.max(np.abs(v - a - p * u)))
        if POWERS[0] <= p <= POWERS[-1] and away > max(math.log(SLIPPED), 8.0 * rest):
            found.append(int(pressed[k]))
    return found[0] if len(found) == 1 else None


def back(depth: np.ndarray) -> float:
    """By how much the indenter, once in contact, goes back before its deepest point; 0 where that may be jitter."""
    there = np.maximum(depth[: int(np.argmax(depth)) + 1], 0.0)
    back = float(np.max(np.maximum.accumulate(there) - there))
    return back if back > max(JITTER * float(np.ptp(np.maximum(depth, 0.0))), 12.0 * noise_of(depth)) else 0.0


def rest(depth: np.ndarray) -> int:
    """How many readings lie at the deepest point where that may be a rest, else 0; times would show."""
    stroke = float(np.ptp(depth))
    width = max(0.005 * stroke, 12.0 * noise_of(depth))
    near = int(np.sum(depth > depth.max() - width))
    passing = 2.0 * len(depth) * width / stroke  # there and back
    return near if near > max(STUCK, 0.1 * len(depth), 3.0 * passing) else 0


def rest_on_the_way(depth: np.ndarray, time: np.ndarray) -> tuple[float, float] | None:
    """Duration (s) and depth (mm) of the longest rest before the deepest point; None where the way has no long one."""
    way = np.maximum.accumulate(depth[: int(np.argmax(depth)) + 1])
    levels = np.linspace(max(EDGE * way[-1], way[0]), (1.0 - EDGE) * way[-1], MOST)
    passing = np.diff(np.interp(levels, way, time[: len(way)]))
    k = int(np.argmax(passing))
    long = max(PAUSE * (time[len(way) - 1] - time[0]), 20.0 * float(np.median(passing)))
    return (float(passing[k]), float(levels[k])) if passing[k] > long else None


def noise_of(values: np.ndarray) -> float:
    """Standard deviation of readings that else change steadily, from their third differences; 0 where too few."""
    return 1.5 * float(np.median(np.abs(np.diff(values, 3)))) / 20**0.5 if len(values) > 12 else 0.0


def force_onset(depth: np.ndarray, force: np.ndarray) -> tuple[float, float, float] | None:
    """Depth from which the force rises (mm), its level at the start and its scatter (N); None where too few show it.

    Least squares of F = b + a (u − c)^p up to half of the largest force, for all c ≥ 0 and p of POWERS; c is 0 unless
    χ² falls by more than CLEAR with another.  The level is what the start has beyond a (u − c)^p.
    """
    order = np.argsort(depth, kind="stable")
    blocks = np.array_split(order, min(len(order), MOST))
    u, F = (np.array([v[b].mean() for b in blocks]) for v in (depth, force))
    low, high = (float(np.median(v)) for v in (F[:3], F[-3:]))
    n = int(np.sum(F < 0.5 * (low + high)))  # a count: a reading out of line moves it by one
    if n < 6 or u[n - 1] <= 0.0:
        return None
    near = u[:n] <= max(EDGE * float(depth.max()), float(u[0]))
    u, F = u[:n], F[:n]
    c = np.linspace(0.0, 0.9, 91) * u[-1]
    shape = (np.maximum(u - c[:, None], 0.0) / u[-1])[:, None] ** POWERS[:, None]  # (c, p, n)
    away, rise = shape - shape.mean(axis=2, keepdims=True), F - F.mean()
    a = away @ rise / np.sum(away**2, axis=2)
    left = np.where(a > 0.0, rise @ rise - a * (away @ rise), np.inf)
    i, j = divmod(int(np.argmin(left)), left.shape[1])
    if not np.isfinite(left[0]).any():
        return None
    variance = max(float(left[i, j]) / (n - 4), (1e-3 * float(np.ptp(force))) ** 2)
    if left[0].min() - left[i, j] < CLEAR * variance:
        i, j = 0, int(np.argmin(left[0]))
    level = float(np.median((F - a[i, j] * shape[i, j])[near]))
    return float(c[i]), level, math.sqrt(variance)


def flat_top(depth: np.ndarray, force: np.ndarray, stroke: float) -> int:
    """How many readings in a row have the largest force while the indenter moves by EDGE of its stroke; 0 if few."""
    at = np.nonzero(force == force.max())[0]
    run = max(np.split(at, np.nonzero(np.diff(at) > 1)[0] + 1), key=len)
    return len(run) if len(run) >= FLAT and np.ptp(depth[run]) > EDGE * stroke else 0


def before_contact(depth: np.ndarray, force: np.ndarray) -> float | None:
    """By how much (N) the force has grown where the depth says contact, None where it has not or nothing is before."""
    if depth.min() > -EDGE * depth.max():
        return None
    before, near = force[depth < 0.0], np.argsort(np.abs(depth), kind="stable")[:3]
    start = float(np.median(before[: max(3, len(before) // 10)]))
    grown = float(np.median(force[near])) - start
    return grown if grown > max(LATE * float(np.ptp(force)), 8.0 * noise_of(force)) else None


def loading_power(depth: np.ndarray, force: np.ndarray) -> float | None:
    """The power of the depth that the force of loading follows closely, None where it follows none."""
    pressed = (depth > 2.0 * EDGE * depth.max()) & (force > 0.0)
    if np.sum(pressed) < max(FEW, 0.6 * len(depth)) or np.ptp(depth[pressed]) == 0.0:
        return None
    x, y = np.log(depth[pressed]), np.log(force[pressed])
    p, a = np.polyfit(x, y, 1)
    return float(p) if np.std(y - a - p * x) < 0.1 else None


def padding(depth: np.ndarray, force: np.ndarray | None, stroke: float) -> int:
    """How many readings at the end are all the same, after a jump to them; 0 where there are none."""
    other = depth != depth[-1] if force is None else (depth != depth[-1]) | (force != force[-1])
    last = int(np.nonzero(other)[0][-1])
    n, jump = len(depth) - 1 - last, abs(float(depth[last] - depth[-1]))
    usual = float(np.median(np.abs(np.diff(depth[: last + 1])))) if last else 0.0
    return n if n >= 3 and jump > max(2.0 * EDGE * stroke, 8.0 * usual) else 0


def creep(depth: np.ndarray, force: np.ndarray, time: np.ndarray | None = None) -> tuple[float, float] | None:
    """Depth (mm) from which on loading stays at its last force, and that force (N); None where that is no long way.

    Within 1 % or the noise; a force that grows as depth^0.9 and more is there on a share of its travel of that / 0.9.
    Where times are known a long time is one too: a stiff body creeps little under the force that it is held with.
    """
    end, width = float(np.median(force[-3:])), max(0.01 * float(np.ptp(force)), 6.0 * noise_of(force))
    away = np.nonzero(np.abs(force - end) > width)[0]
    if end <= width or not len(away) or away[-1] + 1 == len(force):
        return None
    first, most = float(depth[away[-1] + 1]), float(depth.max())
    usual = most * width / (0.9 * end)
    far = most - first > EDGE * float(np.ptp(depth)) + 2.0 * usual
    if time is not None:
        long = time[-1] - time[away[-1] + 1] > (PAUSE + 2.0 * width / end) * (time[-1] - time[0])
        far |= bool(long) and most - first > 2.0 * STILL * float(np.ptp(depth))
    return (first, end) if far else None


def fall(force: np.ndarray) -> tuple[int, float] | None:
    """Index of the largest force of loading and the last one (N) where it fell by FALL of its range, else None."""
    calm = np.r_[force[0], np.median([force[:-2], force[1:-1], force[2:]], axis=0), force[-1]]  # without spikes
    top, low = int(np.argmax(calm)), float(calm[-1])
    return (top, low) if calm[top] - low > max(FALL * float(np.ptp(calm)), 8.0 * noise_of(force)) else None
