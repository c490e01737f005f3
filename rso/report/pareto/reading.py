"""What the page needs of results.json of a study with objectives, in the units that people use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rso.core.digits import significant
from rso.report.layout.digits import Unit, clean, shown, symbol

Found = Mapping[str, Any]
Value = float | str


def names(found: Found) -> list[str]:
    """Objectives by their quantities."""
    return [o["quantity"] for o in found["objectives"]]


def searched(found: Found) -> list[Found]:
    """Parameters that were searched."""
    return [p for p in found["parameters"] if p["fixed"] is None]


def unit_of(found: Found, name: str) -> Unit:
    """How values of a parameter or quantity are shown."""
    for p in found["parameters"]:
        if p["name"] == name:
            sizes = [abs(v) for v in (p["low"], p["high"]) if v is not None]
            return shown(p["unit"], max(sizes, default=None))
    sizes = [abs(r["outputs"][name]) for r in found["runs"] if r["outputs"] and r["within_limits"]]
    return shown(found["units"][name], float(np.median(sizes)) if sizes else None)


def value_text(value: Value | None, unit: Unit, digits: int = 4) -> str:
    """A number in a unit, or the text of a category."""
    if isinstance(value, str):
        return clean(value)
    return significant(None if value is None else value * unit.factor, digits)


def axis_label(found: Found, name: str) -> str:
    """Name and unit of a parameter or quantity for an axis."""
    return f"{symbol(name)}{unit_of(found, name).bracket}"


def wide(values: Sequence[float], ratio: float = 30.0) -> bool:
    """Whether values are better seen on a logarithmic axis."""
    v = np.asarray(values, float)
    return bool(len(v) and v.min() > 0 and v.max() > ratio * v.min())


def position(p: Found, value: Value) -> float:
    """Where a value of a parameter lies between its ends, from 0 to 1."""
    if p["choices"]:
        return p["choices"].index(value) / max(len(p["choices"]) - 1, 1)
    low, high = p["low"], p["high"]
    if p["scale"] == "log":
        return float(np.log(float(value) / low) / np.log(high / low))
    return float((float(value) - low) / (high - low))
