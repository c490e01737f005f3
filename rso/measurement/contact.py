"""Where a record touches the body: contact by the shape of the force, and what it is uncertain by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

POWERS = (1.5, 2.5)  # of the travel of a ball: Hertz's, and the first of what stiffens or softens
UP_TO = 0.7  # of the largest force: what tells the contact
BIAS = 0.005  # of the travel pressed up to there by which two powers miss a soft ellipsoid's contact
SURE = 2.0  # standard deviations after the first reading
MOST = 200  # means of readings that tell the shape of a curve
STEPS = 181  # places of contact that are tried
FURTHEST = 0.95  # of the way
FEWEST = 6  # readings up to there
BEFORE = 3  # readings in air, at least, that show that there was an approach


@dataclass(frozen=True)
class Onset:
    """Where the force rises: depth and its standard deviation (mm)."""

    depth: float
    deviation: float


def onset(depth: np.ndarray, force: np.ndarray) -> Onset | None:
    """The contact of a loading curve (n,) in mm and N that begins in air; None where too few readings tell it.

    Least squares of F = b + Σ_p a_p (u − c)^p, p of POWERS, up to UP_TO of the largest force, for c from the first
    reading on; c is the mean, its deviation (with BIAS) the standard deviation, of exp(−χ²/2) over c.
    Valid for a ball on a smooth body without adhesion (Hertz 1881 and what stiffens or softens beyond).
    """
    order = np.argsort(depth, kind="stable")
    blocks = np.array_split(order, min(len(order), MOST))
    u, F = (np.array([v[b].mean() for b in blocks]) for v in (depth, force))
    low, high = (float(np.median(v)) for v in (F[:3], F[-3:]))
    n = int(np.sum(F < low + UP_TO * (high - low)))  # a count: a reading out of line moves it by one
    if n < FEWEST or u[n - 1] <= u[0]:
        return None
    first, way = float(u[0]), float(u[n - 1] - u[0])
    t, F = (u[:n] - first) / way, F[:n]
    c = np.linspace(0.0, FURTHEST, STEPS)
    left = np.full(STEPS, np.inf)
    for k in range(STEPS):
        x = np.maximum(t - c[k], 0.0)
        A = np.stack([np.ones(n), *(x**p for p in POWERS)], axis=1)
        a = np.linalg.lstsq(A, F, rcond=None)[0]
        if a[1] > 0.0 and sum(a[1:]) > 0.0:
            left[k] = float(np.sum((F - A @ a) ** 2))
    k = int(np.argmin(left))
    if not np.isfinite(left[k]):
        return None
    variance = max(float(left[k]) / max(n - 2 - len(POWERS), 1), (1e-3 * float(np.ptp(force))) ** 2)
    weight = np.exp(-0.5 * (left - left[k]) / variance)
    mean = float(weight @ c / weight.sum())
    spread = float(weight @ (c - mean) ** 2 / weight.sum())
    deviation = math.sqrt(spread + (c[1] - c[0]) ** 2 / 12.0 + (BIAS * (1.0 - mean)) ** 2)
    return Onset(first + way * mean, way * deviation)


def approached(depth: np.ndarray, force: np.ndarray) -> Onset:
    """The contact of a loading curve that begins in air; ValueError where it does not show one."""
    found = onset(depth, force) if len(depth) >= FEWEST else None
    if found is None:
        raise ValueError("too few readings before half of the largest force to tell the contact")
    before = int(np.sum(depth < found.depth))
    if before < BEFORE or found.depth - float(depth.min()) < SURE * found.deviation:
        where = f"{found.depth:.3g} ± {found.deviation:.2g} mm"
        raise ValueError(f"no approach is seen: {before} reading(s) before {where}, where the force begins to rise")
    return found


def zeroed(
    depth: np.ndarray, channels: Mapping[str, np.ndarray], loading: np.ndarray, names: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], Onset]:
    """Depth (n,) and channels of one repeat with the columns `names`, depth or Fz, 0 at contact; and where that was.

    ValueError where loading, where `loading` (n,), does not show an approach.
    """
    if "Fz" not in channels:
        raise ValueError("Fz tells it, which is not there")
    found = approached(depth[loading], channels["Fz"][loading])
    air = loading & (depth < found.depth - found.deviation)
    own = dict(channels)
    if "Fz" in names:
        own["Fz"] = own["Fz"] - float(np.median(own["Fz"][air]))
    return depth - found.depth if "depth" in names else depth, own, found
