"""Records whose depth counts from a preload: where the body was touched before, found from the shape of the force.

A machine that goes on to a small force P, the preload, and takes its travel there for 0 leaves out the first part of
the curve.  With the force of the body F(u) = Σ_p a_p (u − c)^p, F(0) = P, the contact lies at c < 0.
"""

from __future__ import annotations

import math

import numpy as np

from rso.core.digits import quantity_text
from rso.core.power_law import POWER_LAW_FAMILIES
from rso.data.contact_point import (
    CONTACT_BIAS_SHARE,
    CONTACT_FORCE_SHARES,
    MIN_READINGS_FOR_CONTACT,
    N_CONTACT_CANDIDATES,
    Onset,
    means,
)

MAX_WAYS_BEFORE_PRELOAD = 3.0  # ways of loading before the preload at which contact is looked for
PRELOAD_FORCE_TOLERANCE = 0.3  # of the preload by which the force at the zero of depth may be off, of it or of nothing
N_GROWTH_PLACES = 30  # places of the way at which it is looked whether the force grows
MIN_READING_SD_SHARE = 1e-3  # of the range of the force: no reading is known better


def tared(depth: np.ndarray, force: np.ndarray, preload: float) -> bool:
    """Whether the force (n,) N of a loading curve counts from the preload (N), too; ValueError where from neither."""
    u, F = depth - depth[0], force
    near = u <= max(0.02 * float(u.max()), float(np.sort(u)[min(2, len(u) - 1)]))
    start = float(np.median(F[near]))
    slack = PRELOAD_FORCE_TOLERANCE * preload + 0.01 * float(np.ptp(F))
    if abs(start) <= min(abs(start - preload), slack):
        return True
    if abs(start - preload) <= slack:
        return False
    raise ValueError(
        f"preload = {quantity_text(preload, 'N')}: Fz is {quantity_text(start, 'N')} where the depth begins to "
        f"grow, neither that nor 0. Is its "
        "unit right, and does the depth count from it?"
    )


def contact(depth: np.ndarray, force: np.ndarray, preload: float) -> Onset:
    """The contact (mm, before the first reading) of a loading curve that begins at a preload (N), force not tared.

    Average and deviation over the families of :mod:`rso.core.power_law` and over contacts, with weights
    π exp(−χ²/2 − k ln n/2); the bias is by how much half of the force says another, or that of two powers.  ValueError
    where too few readings show it.
    """
    order = np.argsort(depth, kind="stable")
    u, F = means(depth[order], force[order])
    whole, half = (_averaged(u, F, share) for share in CONTACT_FORCE_SHARES)
    if whole is None:
        raise ValueError(
            f"preload = {quantity_text(preload, 'N')}: fewer than {MIN_READINGS_FOR_CONTACT} readings show the "
            f"contact before it"
        )
    c, variance, way = whole
    bias = CONTACT_BIAS_SHARE * (way - c)
    if half is not None:
        bias = math.hypot(bias, math.sqrt(max((c - half[0]) ** 2 - variance - half[1], 0.0)))
    return Onset(float(u[0]) + c, math.sqrt(variance), bias)


def _averaged(u: np.ndarray, F: np.ndarray, share: float) -> tuple[float, float, float] | None:
    """Contact (mm from the first reading, negative), its variance, and the way (mm) that tells it."""
    high = float(np.median(F[-3:]))
    n = int(np.sum(F < float(F[0]) + share * (high - float(F[0]))))
    if n < MIN_READINGS_FOR_CONTACT or u[n - 1] <= u[0]:
        return None
    way = float(u[n - 1] - u[0])
    t, F = (u[:n] - u[0]) / way, F[:n]
    c = -MAX_WAYS_BEFORE_PRELOAD * np.linspace(0.0, 1.0, N_CONTACT_CANDIDATES) ** 2
    every: list[tuple[float, int, np.ndarray]] = []
    for prior, family in POWER_LAW_FAMILIES:
        for powers in family:
            if n > len(powers) + 2:
                every.append((prior / len(family), len(powers), _squares(t, F, c, powers)))
    if not any(np.isfinite(left).any() for *_, left in every):
        return None
    least = (MIN_READING_SD_SHARE * float(np.ptp(F))) ** 2
    variance = max(min(float(left.min()) / max(n - 1 - k, 1) for _, k, left in every), least)
    loss = np.stack([left / variance + k * math.log(n) - 2.0 * math.log(p) for p, k, left in every])
    weight = np.exp(-0.5 * (loss - loss.min())) * np.gradient(-c)
    weight /= weight.sum()
    each = weight.sum(axis=0)
    mean = float(each @ c)
    at = int(np.argmin(np.abs(c - mean)))
    step = float(np.gradient(-c)[at])
    return way * mean, way**2 * (float(each @ (c - mean) ** 2) + step**2 / 12.0), way


def _squares(t: np.ndarray, F: np.ndarray, c: np.ndarray, powers: tuple[float, ...]) -> np.ndarray:
    """Squares left (m,) of F = Σ_p a_p (t − c)^p for contacts c (m,), infinite where no body is pressed so: its force
    grows all the way from contact on."""
    left = np.full(len(c), np.inf)
    for k, at in enumerate(c):
        A = np.stack([(t - at) ** p for p in powers], axis=1)
        a = np.linalg.lstsq(A, F, rcond=None)[0]
        way = np.linspace(0.0, float(t[-1]) - at, N_GROWTH_PLACES)[1:]
        grows = sum(p * v * way ** (p - 1.0) for p, v in zip(powers, a, strict=True))
        if a[0] > 0.0 and np.all(grows > 0.0):
            left[k] = float(np.sum((F - A @ a) ** 2))
    return left
