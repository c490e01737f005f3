"""How fast the indenter went, there and back, and how long it stayed."""

from __future__ import annotations

import numpy as np

from rso.data.files.reading import Measurement, Repeat

MIN_DWELL_SHARE = 0.05  # of the time of loading: a shorter rest before the way back is none
MAX_TURN_GAP_SHARE = 0.1  # of the deepest travel: branches that share less of it are not of one whole loop
MIN_LOOP_READINGS, N_LOOP_DEPTHS = 8, 400  # readings of each branch of a loop, depths of its work
N_UNLOADING_LEGS = 7  # of a way back, whose median tells its speed
# by which the speed of the way back may differ from that of the way there and count as the same
SAME_SPEED_TOLERANCE_LN = 0.15


def recorded_speed(m: Measurement) -> float | None:
    """Speed (mm/s) of loading between a fifth and nine tenths of the deepest travel, None where no times are known.

    The median over repeats; what the machine does before contact and near its turn does not count.
    """
    found = []
    for r in m.repeats if m.kind == "force" else ():
        loading = r.segment == "loading"
        if r.time is None or np.sum(loading) < 3:
            continue
        d, t = np.maximum.accumulate(r.depth[loading]), r.time[loading]
        low, high = max(0.2 * d[-1], d[0]), 0.9 * d[-1]
        start, end = np.interp((low, high), d, t)
        if end > start and high > low:
            found.append((high - low) / (end - start))
    return float(np.median(found)) if found else None


def dwell_time(r: Repeat, speed: float) -> float:
    """Time (s) between the ways there and back beyond that of moving, 0 where it is short or there are no times."""
    there, back = (np.nonzero(r.segment == s)[0] for s in ("loading", "unloading"))
    if r.time is None or len(there) < 2 or not len(back):
        return 0.0
    way = r.depth.max() / speed  # without that through air
    rest = float(r.time[back[0]] - r.time[there[-1]])
    moving = (2.0 * r.depth.max() - r.depth[there[-1]] - r.depth[back[0]]) / speed
    one = max(np.median(np.diff(r.time[v])) if len(v) > 1 else 0.0 for v in (there, back))  # from reading to reading
    rest -= max(moving, 0.0 if np.any(r.segment == "hold") else float(one))
    return rest if rest > MIN_DWELL_SHARE * way else 0.0


def unloading_pace(r: Repeat, speed: float) -> float:
    """Speed of the unloading over that of the way there, 1 where it is nearly so or not known.

    The median of `N_UNLOADING_LEGS` equal parts of the travel in its midst: a pause is in one of them.
    """
    back = r.segment == "unloading"
    if r.time is None or np.sum(back) < 3:
        return 1.0
    d, t = np.maximum.accumulate(r.depth[back][::-1]), r.time[back][::-1]
    low, high = max(0.2 * r.depth.max(), d[0]), min(0.9 * r.depth.max(), d[-1])
    leg = float(np.median(-np.diff(np.interp(np.linspace(low, high, N_UNLOADING_LEGS + 1), d, t))))
    if high <= low or leg <= 0.0:
        return 1.0
    pace = (high - low) / N_UNLOADING_LEGS / leg / speed
    return 1.0 if abs(np.log(pace)) < SAME_SPEED_TOLERANCE_LN else float(f"{pace:.3g}")


def lost_work(m: Measurement) -> float | None:
    """Share of the work of loading that unloading does not give back, 1 − ∫F du (back)/∫F du (there).

    Both over the depths that both branches have, the deepest reading of loading being the first of unloading where the
    indenter did not rest.  The median over repeats; None where one of them shares less than nine tenths of its depths,
    or pulls in unloading so that the work is negative.
    """
    shares = []
    for r in m.repeats if "Fz" in m.channels else ():
        there, back = (np.nonzero((r.segment == s) & (r.depth >= 0.0))[0] for s in ("loading", "unloading"))
        if min(len(there), len(back)) < MIN_LOOP_READINGS:
            return None
        if r.depth[back].max() < (1.0 - MAX_TURN_GAP_SHARE) * r.depth.max():
            return None
        if not np.any(r.segment == "hold"):
            back = np.append(there[np.argmax(r.depth[there])], back)
        curves = []
        for rows in (there, back):
            at = rows[np.argsort(r.depth[rows], kind="stable")]
            curves.append((r.depth[at], r.channels["Fz"][at]))
        low, high = max(u[0] for u, _ in curves), min(u[-1] for u, _ in curves)
        if high - low < (1.0 - MAX_TURN_GAP_SHARE) * float(r.depth.max()):
            return None
        grid = np.linspace(low, high, N_LOOP_DEPTHS)
        works = [float(np.trapezoid(np.interp(grid, u, F), grid)) for u, F in curves]
        if not (works[0] > 0.0 and works[1] >= 0.0):
            return None
        shares.append(1.0 - works[1] / works[0])
    return float(np.median(shares)) if shares else None
