"""Rows of a table by what they are called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def rows_by_label(labels: Sequence[str]) -> dict[str, np.ndarray]:
    """Indices of the rows of each label, in the order in which labels come first."""
    found: dict[str, list[int]] = {}
    for k, label in enumerate(labels):
        found.setdefault(label, []).append(k)
    return {label: np.array(rows) for label, rows in found.items()}
