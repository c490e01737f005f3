"""How fast the indenter went."""

from __future__ import annotations

import numpy as np

from rso.data.files.reading import Measurement


def recorded_speed(m: Measurement) -> float | None:
    """Speed (mm/s) of loading between a fifth and nine tenths of the deepest travel, None where no times are known.

    The median over repeats; what the machine does before contact and near its turn does not count.
    """
    found = []
    for r in m.repeats if m.kind == "force" else ():
        loading = r.segment == "loading"
        if r.time is None or np.sum(loading) < 3:
            continue
        d, t = np.maximum.accumulate(r.depth[loading]), r.time[loading]
        low, high = max(0.2 * d[-1], d[0]), 0.9 * d[-1]
        start, end = np.interp((low, high), d, t)
        if end > start and high > low:
            found.append((high - low) / (end - start))
    return float(np.median(found)) if found else None
