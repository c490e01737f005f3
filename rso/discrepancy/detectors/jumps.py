"""Sudden jumps: what no smooth model of a curve can explain, and no scatter of readings makes.

With q_i the steps of the force from reading to reading less what is smooth in them (their running median, and a
polynomial through what that leaves where they bend), over a robust standard deviation,

    t = Σ q³ / (Σ q⁶)^½,      z = √(n/6) mean q³ / (mean q²)^(3/2)

Scatter, correlated or not, is as often up as down, so that t is about a standard normal variable however heavy its
tails are; stick–slip and slipping grips rise slowly and fall at once, or the reverse, again and again.  Of k equal
jumps t is no more than √k: few large ones show in z, whose standard deviation without jumps is 2 to 3, and a single
one that stays by itself (:mod:`rso.discrepancy.detectors.steps`).

A sensor that counts in steps s goes up by none or one from reading to reading, which is skewed: s counts as normal
scatter besides, Σ (q⁶ + 15 s⁶) and q² + s² below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from rso.data import step_of
from rso.discrepancy.detectors.steps import ForceStep, force_step
from rso.discrepancy.library.test_plan import TestPlan

JUMP_T_LIMIT = 2.9  # t; with JUMP_Z_LIMIT of scatter fewer than 0.5 % of plans reach it
JUMP_Z_LIMIT = 9.0  # z, skewness over its standard error in normal scatter
MEDIAN_WINDOW_READINGS = 9  # readings of the running median
MIN_READINGS_FOR_JUMPS = 12  # readings of a branch
UNEVEN_SPACING_SHARE = 0.25  # of a step of depth: more is another spacing
_STEP_CLIP_SD = 8.0  # no single reading decides
_SLOPE_DEGREE = 3  # of what the running median leaves of a slope that bends


@dataclass(frozen=True)
class Jumps:
    """Skewness of steps t and z, their number, experiment, size (N) and depths (mm) of the largest; one that stays."""

    t: float
    z: float
    n: int
    experiment: str
    size: float
    depths: tuple[float, ...]
    crack: ForceStep | None = None

    @property
    def skewed(self) -> bool:
        """Whether steps go up and down more unlike than scatter and a bending curve make them."""
        return abs(self.t) > JUMP_T_LIMIT or abs(self.z) > JUMP_Z_LIMIT

    @property
    def sudden(self) -> bool:
        """Whether there are jumps, or one that stays."""
        return self.skewed or self.crack is not None


def jumps(plan: TestPlan) -> Jumps:
    """Jumps of Fz, or of the first channel without one, along loading in the raw readings of all repeats."""
    raw, found = [], []
    for e in plan.experiments:
        if e.measurement.kind != "force" or e.role == "validate":
            continue
        for r in e.measurement.repeats:
            at = r.segment == "loading"
            v = r.channels["Fz" if "Fz" in r.channels else next(iter(r.channels))][at]
            if len(v) < MIN_READINGS_FOR_JUMPS or np.sum(even := _even(r.depth[at])) < MIN_READINGS_FOR_JUMPS - 1:
                continue
            q = _unsmooth(np.diff(v)[even])
            counted = step_of(v)
            scale = max(1.48 * float(np.median(np.abs(q))), counted)
            if scale == 0.0:
                continue
            raw.append((q, scale, counted))
            found += [(float(s), e.name, float(d)) for s, d in zip(q, r.depth[at][1:][even], strict=True)]
    if not raw:
        return Jumps(0.0, 0.0, 0, "", 0.0, (), force_step(plan))
    usual = float(np.median([scale for _, scale, _ in raw]))  # a record of few readings may seem quieter than it is
    q = np.concatenate([np.clip(q / max(scale, usual), -_STEP_CLIP_SD, _STEP_CLIP_SD) for q, scale, _ in raw])
    s = np.concatenate([np.full(len(q), counted / max(scale, usual)) for q, scale, counted in raw])
    t = float(np.sum(q**3) / np.sqrt(np.sum(q**6 + 15.0 * s**6)))
    z = float(np.mean(q**3) / np.mean(q**2 + s**2) ** 1.5 / np.sqrt(6.0 / len(q)))
    found.sort(key=lambda f: -f[0] * np.sign(z))
    name = found[0][1]
    largest = [f for f in found if f[1] == name][:5]
    return Jumps(t, z, len(q), name, largest[0][0], tuple(sorted(d for _, _, d in largest)), force_step(plan))


def _even(u: np.ndarray) -> np.ndarray:
    """Mask (n − 1,) of the steps of depth as long as those around them: where rows are lost the force goes on.

    All of them where depths scatter.
    """
    step = np.diff(u)
    around = median_filter(step, MEDIAN_WINDOW_READINGS, mode="nearest")
    off = np.abs(step - around)
    if np.median(off) > UNEVEN_SPACING_SHARE * max(float(np.median(step)), 0.0):
        return np.full(len(step), True)
    return off <= UNEVEN_SPACING_SHARE * np.abs(around)


def _unsmooth(step: np.ndarray) -> np.ndarray:
    """Steps (n,) less what is smooth in them, which single large ones do not move."""
    q = step - median_filter(step, MEDIAN_WINDOW_READINGS, mode="nearest")
    most = 3.0 * np.median(np.abs(q))
    P = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(q)), _SLOPE_DEGREE)
    return q - P @ np.linalg.lstsq(P, np.clip(q, -most, most), rcond=None)[0]
