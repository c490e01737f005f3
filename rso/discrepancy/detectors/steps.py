"""One step of a force that stays, as of a crack, a slip, a zero that jumps: neither smooth models nor scatter make it.

Between every two readings v of a branch, loading or unloading, the step δ of

    v(u) = a + b u + c u² + δ [u > u_k]

through the `STEP_WINDOW_READINGS` readings on either side, by least squares, over its standard deviation per unit
noise; of δ with each reading left out in turn the least counts, so that no single reading makes a step.  z is that over
the robust standard deviation of all such steps of the record, autocorrelated noise included, of a usual record, or of
the steps at this place where they grow along the record, as noise in proportion to a force does: of the largest of
these.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from rso.data import Repeat, step_of
from rso.discrepancy.library.test_plan import TestPlan

STEP_WINDOW_READINGS = 6  # readings on either side
MIN_END_READINGS = 5  # of them at the ends of a record, where a contact bends too much for fewer
# z: reached by 1 % of plans of some hundred readings with the tails of Student's t₂, by 0.2 % of others
MIN_STEP_Z = 4.5
STEP_FALSE_ALARM_CHANCE = 0.005  # of normal scatter, of that many steps in all: the limit of more readings
GROWING_SCATTER_RATIO = 1.5  # times that of the first part is the scatter of the last: less is scatter of it
N_SCATTER_PARTS = 4  # of a record, that tell whether its scatter grows
MIN_STEP_DEPTH_SHARE = 0.05  # of the deepest travel: nearer to contact the indenter may snap in
# of the deepest travel below the turn: there play, friction and what relaxes bend the force of an unloading
SKIPPED_TURN_SHARE = 0.12
# of the range of the force: less is no crack, but what a parabola misses where noise is small
MIN_STEP_FORCE_SHARE = 0.005


@dataclass(frozen=True)
class ForceStep:
    """A step of a force (N), later less earlier, at a depth (mm) on a branch of an experiment, z standard deviations
    high."""

    z: float
    experiment: str
    size: float
    depth: float
    branch: str = "loading"


def force_step(plan: TestPlan) -> ForceStep | None:
    """The clearest step that stays, of Fz or of the first channel without one; None where none is clear."""
    found, scales = [], []
    for e in plan.experiments:
        if e.measurement.kind != "force" or e.role == "validate":
            continue
        stretches = [(r, *part) for r in e.measurement.repeats for part in _smooth_stretches(r)]
        for r, branch, at in stretches:
            v = r.channels["Fz" if "Fz" in r.channels else next(iter(r.channels))][at]
            later = -1.0 if branch == "unloading" else 1.0  # from there backwards: noise grows with the travel
            z, least, size, depth = step_statistics(r.depth[at][:: int(later)], v[:: int(later)])
            if len(z) > MIN_END_READINGS:
                scales.append(max(1.48 * float(np.median(np.abs(z))), step_of(v)))
                large = np.abs(size) > MIN_STEP_FORCE_SHARE * np.ptp(v)
                found.append((e.name, branch, least * large, later * size, depth, np.maximum(scales[-1], _grown(z))))
    usual = float(np.median(scales)) if scales else 0.0
    best = None
    for name, branch, least, size, depth, own in found:
        scale = np.maximum(own, usual)
        z = np.divide(least, scale, out=np.zeros_like(least), where=scale > 0.0)
        k = int(np.argmax(z))
        if best is None or z[k] > best.z:
            best = ForceStep(float(z[k]), name, float(size[k]), float(depth[k]), branch)
    limit = max(MIN_STEP_Z, -float(ndtri(STEP_FALSE_ALARM_CHANCE / max(sum(len(f[2]) for f in found), 1))))
    return best if best is not None and best.z > limit else None


def _smooth_stretches(r: Repeat) -> list[tuple[str, np.ndarray]]:
    """Branches of a record with masks (n,) of the readings in which a body that nothing happens to is smooth."""
    deepest = r.depth.max()
    inside = r.depth > MIN_STEP_DEPTH_SHARE * deepest
    turned = inside & (r.depth < (1.0 - SKIPPED_TURN_SHARE) * deepest)
    return [(k, m & (r.segment == k)) for k, m in (("loading", inside), ("unloading", turned))]


def _grown(z: np.ndarray) -> np.ndarray:
    """Robust standard deviation of the steps z (m,) along a record, which grows steadily with the travel: a line
    through those of its parts, of which one that holds a crack does not count more than the others."""
    parts = np.array_split(np.abs(z), N_SCATTER_PARTS)
    if len(z) < N_SCATTER_PARTS * STEP_WINDOW_READINGS:
        return np.zeros(len(z))
    middle = (np.arange(N_SCATTER_PARTS) + 0.5) / N_SCATTER_PARTS
    each = np.array([1.48 * np.median(part) for part in parts])
    slopes = [(b - a) / (v - u) for (u, a), (v, b) in itertools.combinations(zip(middle, each, strict=True), 2)]
    slope = float(np.median(slopes))
    if each[-1] < GROWING_SCATTER_RATIO * each[0]:
        return np.zeros(len(z))
    return np.maximum(np.median(each - slope * middle) + slope * np.linspace(0.0, 1.0, len(z)), 0.0)


def step_statistics(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """δ over its standard deviation per unit noise (m,), the least of these with one reading left out, δ and depth.

    u (n,) mm, v (n,) N.  The least is 0 where leaving one out turns its sign.
    """
    out = []
    for k in range(MIN_END_READINGS, len(u) - MIN_END_READINGS + 1):
        a, b = max(0, k - STEP_WINDOW_READINGS), min(len(u), k + STEP_WINDOW_READINGS)
        x, middle, y = u[a:b], 0.5 * (u[k - 1] + u[k]), v[a:b]
        if not np.ptp(x) > 0.0:
            continue
        t = (x - middle) / np.ptp(x)
        A = np.stack([np.ones(b - a), t, t**2, np.arange(a, b) >= k], axis=1).astype(float)
        P = np.linalg.pinv(A)
        δ, w = float(P[-1] @ y), P[-1]
        h = np.einsum("ij,ji->i", A, P)
        without = δ - w * (y - A @ (P @ y)) / np.maximum(1.0 - h, 1e-9)
        least = min(abs(δ), float(np.abs(without).min())) if np.all(np.sign(without) == np.sign(δ)) else 0.0
        per = float(np.linalg.norm(w))
        out.append((δ / per, least / per, δ, middle))
    found = np.array(out).reshape(-1, 4)
    return found[:, 0], found[:, 1], found[:, 2], found[:, 3]
