"""Low-discrepancy sequences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def sobol_sequence(d: int, runs: int, seed: int | Sequence[int]) -> np.ndarray:
    """First `runs` points of a scrambled Sobol sequence (runs, d); balanced where runs is a power of two."""
    from scipy.stats import qmc  # half a second to import

    m = max(1, int(np.ceil(np.log2(runs))))
    return qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random_base2(m)[:runs]
