"""Stiff and sloppy directions: which combinations of parameters a curve knows, and how well each alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.doe import Box
from rso.inference.intervals import standard_deviations

UNIFORM_PRECISION = 12.0  # 1/variance of a uniform density on [0, 1]: what the box alone says


@dataclass(frozen=True)
class Direction:
    """One eigenvector of the Fisher information in ln θ: `change` of ln θ by name (unit length), its sd, in words.

    Parameters that may be zero or negative count in shares of their range instead of ln θ.
    """

    change: Mapping[str, float]
    sd: float
    story: str


def per_log(box: Box, x: np.ndarray) -> np.ndarray:
    """dx/d ln θ (d,) at x (d,) of the unit cube; 1 (shares of the range) where the range is not positive."""
    low, high = np.array(box.low), np.array(box.high)
    positive = low > 0
    theta = box.from_unit(x)
    log = np.log(np.where(positive, high, 2.0) / np.where(positive, low, 1.0))
    linear = np.where(positive, theta / (high - low), 1.0)
    return np.where(np.array(box.log), 1.0 / log, linear)


def directions(box: Box, x: np.ndarray, fisher: np.ndarray) -> tuple[Direction, ...]:
    """Eigenvectors of S F S with S = diag(dx/d ln θ), stiffest first; F (d, d) in the unit cube at x (d,).

    Source: Gutenkunst et al., PLoS Comput. Biol. 3 (2007) e189, eq. 3 (Hessian in ln θ).
    """
    s = per_log(box, x)
    values, V = np.linalg.eigh(fisher * np.outer(s, s))
    found = []
    for k in np.argsort(-values):
        v = V[:, k] * (1.0 if V[np.argmax(np.abs(V[:, k])), k] > 0 else -1.0)
        sd = 1.0 / math.sqrt(values[k]) if values[k] > 1e-12 * max(values.max(), 1e-300) else math.inf
        change = {n: float(c) for n, c in zip(box.names, v, strict=True)}
        found.append(Direction(change, sd, _words(box, change, sd)))
    return tuple(found)


def _words(box: Box, change: Mapping[str, float], sd: float) -> str:
    """`mu^0.99 · D1^-0.12 is known to ±0.4 %`."""
    parts = [
        f"{n}^{c:.2g}" if low > 0 else f"exp({c:.2g} {n}/range)"
        for (n, c), low in zip(change.items(), box.low, strict=True)
        if abs(c) > 0.01
    ]
    known = "is not seen at all" if not math.isfinite(sd) else f"is known to {_error(sd)}"
    return f"{' · '.join(parts)} {known}"


def _error(sd: float) -> str:
    return f"±{100 * sd:.2g} %" if sd < 0.2 else f"a factor {math.exp(sd):.2g}" if sd < 20 else "no useful factor"


def expected_sd(box: Box, x: np.ndarray, fisher: np.ndarray) -> dict[str, float]:
    """sd of ln θ by name for a Fisher information (d, d) in the unit cube at x (d,), the box counted as a prior."""
    sd = standard_deviations(fisher + UNIFORM_PRECISION * np.eye(box.d)) / per_log(box, x)
    return {n: float(v) for n, v in zip(box.names, sd, strict=True)}
