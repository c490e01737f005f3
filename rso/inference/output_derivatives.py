"""How simulated curves change with the parameters: by the derivatives of a run, else by runs beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rso.doe import Box
from rso.inference.models import RUN_DIFFERENCE_STEP

Look = Callable[[Sequence[np.ndarray]], Sequence[np.ndarray | str]]  # points (d,) → curves (n,), or why there is none


class NoSlopes(Exception):
    """How a curve changes with a parameter is not known; the message says why."""


def jacobian(box: Box, x: np.ndarray, f: np.ndarray, own: Mapping[str, np.ndarray], look: Look) -> np.ndarray:
    """∂f/∂x (n, d) in the unit cube at x (d,), where the curves are f (n,); NoSlopes where nothing shows it.

    `own` are the derivatives ∂f/∂θ (n,) that the run has by name; for every other parameter it is `look`-ed at a point
    beside x, towards the middle of its range, and on the other side of x where no run has an answer there.
    """
    columns = {k: own[n] * box.slope(x)[k] for k, n in enumerate(box.names) if n in own}
    why = ""
    for side in (1.0, -1.0):
        steps = {
            k: side * RUN_DIFFERENCE_STEP * (1.0 if x[k] <= 0.5 else -1.0) for k in range(box.d) if k not in columns
        }
        steps = {k: h for k, h in steps.items() if 0.0 <= x[k] + h <= 1.0}
        seen = look([x + h * np.eye(box.d)[k] for k, h in steps.items()]) if steps else []
        for (k, h), y in zip(steps.items(), seen, strict=True):
            if isinstance(y, str):
                why = y
            else:
                columns[k] = (y - f) / h
    unknown = [n for k, n in enumerate(box.names) if k not in columns]
    if unknown:
        raise NoSlopes(f"how it changes with {' and '.join(unknown)} is not known, no run beside has an answer: {why}")
    return np.stack([columns[k] for k in range(box.d)], axis=1)
