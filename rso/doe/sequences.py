"""Low-discrepancy sequences."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np


def sobol_sequence(d: int, runs: int, seed: int | Sequence[int]) -> np.ndarray:
    """First `runs` points of a scrambled Sobol sequence (runs, d); balanced where runs is a power of two."""
    m = max(1, int(np.ceil(np.log2(runs))))
    return _scrambled(d, m, tuple(np.atleast_1d(seed).tolist()))[:runs].copy()


@lru_cache(maxsize=32)  # one study asks for the same points hundreds of times
def _scrambled(d: int, m: int, seed: tuple[int, ...]) -> np.ndarray:
    from scipy.stats import qmc  # half a second to import

    return qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random_base2(m)
