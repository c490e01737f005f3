"""Box–Behnken designs: midpoints of edges or faces and one centre."""

from __future__ import annotations

import itertools

import numpy as np

from rso.doe.farthest import extend_by
from rso.doe.sampler import DesignTask, Sampler, design_of_fixed_size

# Blocks of Box & Behnken (1960), table 4: which factors sit at +-1 together.
_FACTOR_BLOCKS = {
    6: ((0, 1, 3), (1, 2, 4), (2, 3, 5), (0, 3, 4), (1, 4, 5), (0, 2, 5)),
    7: ((3, 4, 5), (0, 5, 6), (1, 4, 6), (0, 1, 3), (2, 3, 6), (0, 2, 4), (1, 2, 5)),
}


def box_behnken(d: int) -> np.ndarray:
    """Box–Behnken design for 3 to 7 parameters: edge or face midpoints and one centre; no corner is run."""
    if not 3 <= d <= 7:
        raise ValueError(f"design: box_behnken is for 3 to 7 parameters, got {d}; use ccd (2 to 8), lhs or osf")
    rows = []
    for block in _FACTOR_BLOCKS.get(d, tuple(itertools.combinations(range(d), 2))):
        points = np.zeros((2 ** len(block), d))
        points[:, block] = list(itertools.product((-1.0, 1.0), repeat=len(block)))
        rows.append(points)
    return 0.5 + 0.5 * np.vstack([*rows, np.zeros((1, d))])


def points(task: DesignTask) -> np.ndarray:
    """The design, all of whose points must be feasible."""
    return design_of_fixed_size("box_behnken", box_behnken(task.d), task)


SAMPLER = Sampler("box_behnken", "Box-Behnken", points, extend_by)
