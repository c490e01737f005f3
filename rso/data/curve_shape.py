"""What a record looks like: rests, ways back, jumps, its onset, the power that it follows; numbers, no judgement."""

from __future__ import annotations

import math

import numpy as np

from rso.data.contact_point import LATE_CONTACT_SHARE, MAX_CONTACT_READINGS, MIN_CHI2_FALL

MIN_MACHINE_READINGS = 8  # readings: less is a table by hand, of which only order, sign and tare are looked at
MIN_HAND_READINGS = 4  # readings that tell these
MISTYPED_READING_RATIO = 5.0  # times what the others say: a reading of a table by hand that may be mistyped
CURVE_EDGE_SHARE = 0.05  # of the readings of loading: what counts as its start and its end
CONTACT_POWERS = np.linspace(0.9, 2.5, 33)  # of curves that begin at contact, from a flat punch to a stiffening body
PLACEHOLDER_RATIO = 50.0  # times all other readings: no force and no depth
MIN_REST_READINGS = 10  # readings at the deepest point that make a rest, where no times are known
JITTER_STROKE_SHARE = 0.05  # of the stroke: a way back by less is jitter
REST_STROKE_SHARE = 0.0025  # of the stroke: less is a rest at one depth
LONG_PAUSE_SHARE = 0.1  # of the time of loading: a rest on the way this long is remarked upon
ISOLATED_STEP_RATIO = 8.0  # times the steps beside it: a step that is none of theirs
MAX_FORCE_FALL_SHARE = 0.1  # of its range that a force of loading may fall before the deepest point
# Steps of the scale, and share of the range: a force that scatters by more is constant nowhere
MIN_MUTE_SCATTER_STEPS, MIN_MUTE_SCATTER_SHARE = 3.0, 1e-3
MAX_STEPS_IN_A_GAP = 6  # of a display: the least gap between two values is so many of them
# Readings of a block and blocks that tell two curves; of the range of the force, how far these are apart
TWO_CURVES_BLOCK, MIN_TWO_CURVES_BLOCKS, MIN_TWO_CURVES_SHARE = 10, 3, 0.02
MAX_TWO_CURVES_KURTOSIS = 1.4  # of residuals of two curves: 1, of a sine 1.5
MIN_SATURATED_READINGS = 5  # equal largest readings in a row: a sensor at its end


def placeholder_readings(values: np.ndarray) -> np.ndarray:
    """Indices of a few readings of the same size, PLACEHOLDER_RATIO times that of any other: 9999 or −9999 where
    nothing was."""
    size = np.abs(values)
    far = np.nonzero(size == size.max())[0]
    others = np.delete(size, far)
    return far if len(far) < len(others) and size.max() > PLACEHOLDER_RATIO * others.max() > 0.0 else far[:0]


def while_moving(far: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Those of the steps `far` (n,) before and after which the indenter moves: others begin or end a rest."""
    least = 0.25 * float(np.ptp(depth)) / len(depth)
    moves = [
        min(abs(depth[k] - depth[k - 3]), abs(depth[k + 4] - depth[k + 1])) > 3.0 * least for k in np.nonzero(far)[0]
    ]
    found = far.copy()
    found[far] = moves
    return found


def isolated_steps(size: np.ndarray, times: float = ISOLATED_STEP_RATIO) -> np.ndarray:
    """Which of the steps (n,) are so many times larger than the three on either side; none at the ends.

    Nor those of a coarse scale, on whose marks readings stand for a while: there all steps that are any are alike.
    """
    found = np.zeros(len(size), bool)
    if len(size) > 6 and size.any():
        beside = np.delete(np.lib.stride_tricks.sliding_window_view(size, 7), 3, axis=1)
        found[3:-3] = size[3:-3] > times * np.maximum(beside.max(axis=1), np.median(size[size > 0.0]))
    return found


def slipped(depth: np.ndarray, force: np.ndarray) -> int | None:
    """The one reading of a few whose force is MISTYPED_READING_RATIO times too large or small for the power of the
    depth that all others follow closely, if there is one: a decimal point that has slipped in its force or its
    depth."""
    pressed = np.nonzero((depth > 0.0) & (force > 0.0))[0]
    if len(pressed) < MIN_HAND_READINGS:
        return None
    x, y = np.log(depth[pressed]), np.log(force[pressed])
    found = []
    for k in range(len(x)):
        u, v = np.delete(x, k), np.delete(y, k)
        if np.ptp(u) == 0.0:
            continue
        p, a = np.polyfit(u, v, 1)
        away, rest = abs(y[k] - a - p * x[k]), float(np.max(np.abs(v - a - p * u)))
        if CONTACT_POWERS[0] <= p <= CONTACT_POWERS[-1] and away > max(math.log(MISTYPED_READING_RATIO), 8.0 * rest):
            found.append(int(pressed[k]))
    return found[0] if len(found) == 1 else None


def back(depth: np.ndarray) -> float:
    """By how much the indenter, once in contact, goes back before its deepest point; 0 where that may be jitter."""
    there = np.maximum(depth[: int(np.argmax(depth)) + 1], 0.0)
    back = float(np.max(np.maximum.accumulate(there) - there))
    return (
        back if back > max(JITTER_STROKE_SHARE * float(np.ptp(np.maximum(depth, 0.0))), 12.0 * noise_of(depth)) else 0.0
    )


def rest(depth: np.ndarray) -> int:
    """How many readings lie at the deepest point where that may be a rest, else 0; times would show."""
    stroke = float(np.ptp(depth))
    width = max(0.005 * stroke, 12.0 * noise_of(depth))
    near = int(np.sum(depth > depth.max() - width))
    passing = 2.0 * len(depth) * width / stroke  # there and back
    return near if near > max(MIN_REST_READINGS, 0.1 * len(depth), 3.0 * passing) else 0


def rest_on_the_way(depth: np.ndarray, time: np.ndarray) -> tuple[float, float] | None:
    """Duration (s) and depth (mm) of the longest rest before the deepest point; None where the way has no long one."""
    way = np.maximum.accumulate(depth[: int(np.argmax(depth)) + 1])
    levels = np.linspace(
        max(CURVE_EDGE_SHARE * way[-1], way[0]), (1.0 - CURVE_EDGE_SHARE) * way[-1], MAX_CONTACT_READINGS
    )
    passing = np.diff(np.interp(levels, way, time[: len(way)]))
    k = int(np.argmax(passing))
    long = max(LONG_PAUSE_SHARE * (time[len(way) - 1] - time[0]), 20.0 * float(np.median(passing)))
    return (float(passing[k]), float(levels[k])) if passing[k] > long else None


def noise_of(values: np.ndarray) -> float:
    """Standard deviation of readings that else change steadily, from their third differences; 0 where too few."""
    return 1.5 * float(np.median(np.abs(np.diff(values, 3)))) / 20**0.5 if len(values) > 12 else 0.0


def force_onset(depth: np.ndarray, force: np.ndarray) -> tuple[float, float, float] | None:
    """Depth from which the force rises (mm), its level at the start and its scatter (N); None where too few show it.

    Least squares of F = b + a (u − c)^p up to half of the largest force, for all c ≥ 0 and p of CONTACT_POWERS; c is 0
    unless χ² falls by more than MIN_CHI2_FALL with another.  The level is what the start has beyond a (u − c)^p.
    """
    order = np.argsort(depth, kind="stable")
    blocks = np.array_split(order, min(len(order), MAX_CONTACT_READINGS))
    u, F = (np.array([v[b].mean() for b in blocks]) for v in (depth, force))
    low, high = (float(np.median(v)) for v in (F[:3], F[-3:]))
    n = int(np.sum(F < 0.5 * (low + high)))  # a count: a reading out of line moves it by one
    if n < 6 or u[n - 1] <= 0.0:
        return None
    near = u[:n] <= max(CURVE_EDGE_SHARE * float(depth.max()), float(u[0]))
    u, F = u[:n], F[:n]
    c = np.linspace(0.0, 0.9, 91) * u[-1]
    shape = (np.maximum(u - c[:, None], 0.0) / u[-1])[:, None] ** CONTACT_POWERS[:, None]  # (c, p, n)
    away, rise = shape - shape.mean(axis=2, keepdims=True), F - F.mean()
    a = away @ rise / np.sum(away**2, axis=2)
    left = np.where(a > 0.0, rise @ rise - a * (away @ rise), np.inf)
    i, j = divmod(int(np.argmin(left)), left.shape[1])
    if not np.isfinite(left[0]).any():
        return None
    variance = max(float(left[i, j]) / (n - 4), (1e-3 * float(np.ptp(force))) ** 2)
    if left[0].min() - left[i, j] < MIN_CHI2_FALL * variance:
        i, j = 0, int(np.argmin(left[0]))
    level = float(np.median((F - a[i, j] * shape[i, j])[near]))
    return float(c[i]), level, math.sqrt(variance)


def flat_top(depth: np.ndarray, force: np.ndarray, stroke: float) -> int:
    """How many readings in a row have the largest force while the indenter moves by CURVE_EDGE_SHARE of its stroke; 0
    if few."""
    at = np.nonzero(force == force.max())[0]
    run = max(np.split(at, np.nonzero(np.diff(at) > 1)[0] + 1), key=len)
    return len(run) if len(run) >= MIN_SATURATED_READINGS and np.ptp(depth[run]) > CURVE_EDGE_SHARE * stroke else 0


def before_contact(depth: np.ndarray, force: np.ndarray) -> float | None:
    """By how much (N) the force has grown where the depth says contact, None where it has not or nothing is before."""
    if depth.min() > -CURVE_EDGE_SHARE * depth.max():
        return None
    before, near = force[depth < 0.0], np.argsort(np.abs(depth), kind="stable")[:3]
    start = float(np.median(before[: max(3, len(before) // 10)]))
    grown = float(np.median(force[near])) - start
    return grown if grown > max(LATE_CONTACT_SHARE * float(np.ptp(force)), 8.0 * noise_of(force)) else None


def returned(depth: np.ndarray, force: np.ndarray, segment: np.ndarray) -> float:
    """By how much the force is larger in unloading than in loading at the same depths, on the mean over depths that
    both have, as a share of its range; 0 where they have few in common."""
    ways = []
    for name in ("loading", "unloading"):
        at = np.nonzero(segment == name)[0]
        at = at[np.argsort(depth[at], kind="stable")]
        ways.append((depth[at], force[at]))
    if min(len(d) for d, _ in ways) < MIN_MACHINE_READINGS:
        return 0.0
    low, high = max(d[0] for d, _ in ways), min(d[-1] for d, _ in ways)
    if high - low < 0.5 * float(np.ptp(depth)):
        return 0.0
    u = np.linspace(low, high, MAX_CONTACT_READINGS)
    there, back = (np.interp(u, d, F) for d, F in ways)
    return float(np.mean(back - there)) / float(np.ptp(force))


def mute_until(depth: np.ndarray, force: np.ndarray) -> float | None:
    """Depth (mm) up to which a force (n,) that scatters further on has one and the same value; None without such a
    start."""
    order = np.argsort(depth, kind="stable")
    u, F = depth[order], force[order]
    n = int(np.argmax(F != F[0])) if np.ptp(F) > 0.0 else 0
    if not MIN_SATURATED_READINGS <= n < len(F) - 12:
        return None
    apart = np.diff(np.unique(F))
    # a display of few digits; a force that rises by several of its steps a reading hardly shows one
    tried = float(apart.min()) / np.arange(1.0, MAX_STEPS_IN_A_GAP + 1.0)
    on_marks = [step for step in tried if np.all(np.abs(apart / step - np.round(apart / step)) < 0.05)]
    step = on_marks[0] if on_marks else 0.0
    least = max(MIN_MUTE_SCATTER_STEPS * step, MIN_MUTE_SCATTER_SHARE * float(np.ptp(F)))
    return float(u[n - 1]) if noise_of(F[n:]) > least else None


def two_curves(depth: np.ndarray, force: np.ndarray) -> float:
    """How far apart (N) two curves are between which the readings (n,) change, sorted by depth; 0 where there is one.

    About lines through TWO_CURVES_BLOCK readings each, residuals of two curves have one size: Σr⁴ n / (Σr²)² is 1,
    that of a sine 1.5, that of noise 3.
    """
    order = np.argsort(depth, kind="stable")
    n = len(order) // TWO_CURVES_BLOCK
    if n < MIN_TWO_CURVES_BLOCKS:
        return 0.0
    blocks = order[: n * TWO_CURVES_BLOCK].reshape(n, TWO_CURVES_BLOCK)
    u, F = depth[blocks], force[blocks]
    x, y = u - u.mean(axis=1, keepdims=True), F - F.mean(axis=1, keepdims=True)
    slope = np.sum(x * y, axis=1) / np.maximum(np.sum(x * x, axis=1), 1e-300)
    left = y - slope[:, None] * x
    size = np.mean(left**2, axis=1)
    far = size > (0.5 * MIN_TWO_CURVES_SHARE * float(np.ptp(force))) ** 2
    if np.sum(far) < MIN_TWO_CURVES_BLOCKS:
        return 0.0
    shape = float(np.mean(np.mean(left[far] ** 4, axis=1) / size[far] ** 2))
    return 2.0 * float(np.sqrt(np.max(size))) if shape < MAX_TWO_CURVES_KURTOSIS else 0.0


def loading_power(depth: np.ndarray, force: np.ndarray) -> float | None:
    """The power of the depth that the force of loading follows closely, None where it follows none."""
    pressed = (depth > 2.0 * CURVE_EDGE_SHARE * depth.max()) & (force > 0.0)
    if np.sum(pressed) < max(MIN_MACHINE_READINGS, 0.6 * len(depth)) or np.ptp(depth[pressed]) == 0.0:
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
    return n if n >= 3 and jump > max(2.0 * CURVE_EDGE_SHARE * stroke, 8.0 * usual) else 0


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
    far = most - first > CURVE_EDGE_SHARE * float(np.ptp(depth)) + 2.0 * usual
    if time is not None:
        long = time[-1] - time[away[-1] + 1] > (LONG_PAUSE_SHARE + 2.0 * width / end) * (time[-1] - time[0])
        far |= bool(long) and most - first > 2.0 * REST_STROKE_SHARE * float(np.ptp(depth))
    return (first, end) if far else None


def fall(force: np.ndarray) -> tuple[int, float] | None:
    """Index of the largest force of loading and the last one (N) where it fell by MAX_FORCE_FALL_SHARE of its range,
    else None."""
    calm = np.r_[force[0], np.median([force[:-2], force[1:-1], force[2:]], axis=0), force[-1]]  # without spikes
    top, low = int(np.argmax(calm)), float(calm[-1])
    return (
        (top, low) if calm[top] - low > max(MAX_FORCE_FALL_SHARE * float(np.ptp(calm)), 8.0 * noise_of(force)) else None
    )
