"""Results as strict JSON: plain data without NaN, written in one step; cells that no spreadsheet takes for formulas."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rso.contract import plain
from rso.core import disk

_FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")


def plainly(results: Mapping[str, Any]) -> dict[str, Any]:
    """The same as JSON can say it."""
    data: dict[str, Any] = _finite(plain(results))
    return data


def write(path: Path, results: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the file in one step, so that a reader never sees half of it; returns what was written, plain."""
    data = plainly(results)
    disk.replace(path, json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))
    return data


def written_cell(value: Any) -> Any:
    """A cell that no spreadsheet takes for a formula: text that begins like one has an apostrophe before it."""
    return f"'{value}" if isinstance(value, str) and value.lstrip().startswith(_FORMULA) else value


def _finite(data: Any) -> Any:
    """NaN and infinities become null: JSON has no word for them."""
    if isinstance(data, dict):
        return {k: _finite(v) for k, v in data.items()}
    if isinstance(data, list):
        return [_finite(v) for v in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
