"""The numerical error that a result states for each of its channels."""

from __future__ import annotations

import numpy as np

from fem_backend.experiment import Knobs, Settings
from fem_backend.indentation import Result

LEVEL_ERROR = {"coarse": 0.011, "standard": 0.008, "fine": 0.004, "reference": 0.002}  # of the force, deep contact
EDGE_ERROR = 0.05  # of the force, times h0²/(R·travel): few elements under a small contact


def stated(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Estimated error of each channel (k,) in its unit."""
    channels = result.channels
    level = LEVEL_ERROR.get(settings.level) or 0.03 * (12.0 / dict(settings.mesh).get("n", 12)) ** 2
    travel = np.maximum(result.travel, 1e-3 * settings.R)
    relative = level + EDGE_ERROR * settings.h0**2 / (settings.R * travel)
    size = np.sqrt(channels["Fx"] ** 2 + channels["Fy"] ** 2 + channels["Fz"] ** 2)
    out = {k: np.zeros_like(travel) for k in channels}
    for k in ("Fx", "Fy", "Fz"):
        share = np.abs(channels[k]) + 0.1 * size * (np.abs(channels[k]) > 0)
        out[k] = relative * share + 0.2 * result.contact_error * (np.abs(channels[k]) > 0)
    out["uz_max"] = out["bulge"] = 1e-3 + 0.0 * travel
    out["contact_area"] = 5 * relative * channels["contact_area"]
    out["contact_radius"] = 2.5 * relative * channels["contact_radius"]
    out["peak_pressure"] = 10 * relative * channels["peak_pressure"]
    return out
