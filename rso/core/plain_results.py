"""Results as strict JSON: plain data without NaN, written in one step; cells that no spreadsheet takes for formulas."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rso.contract import plain
from rso.core import disk

# What `stage` of results.json may be, in the order of a run.
RUN_STAGES = ("plan", "design", "surrogates", "sensitivity", "search", "verify", "validate")
_FORMULA_BEGINS = ("=", "+", "-", "@", "＝", "＋", "－", "＠")


def plainly(results: Mapping[str, Any]) -> dict[str, Any]:
    """The same as JSON can say it."""
    data: dict[str, Any] = _finite(plain(results))
    return data


def write_results(path: Path, results: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the file in one step, so that a reader never sees half of it; returns what was written, plain."""
    data = plainly(results)
    disk.replace(path, _lines(data))
    return data


def _lines(data: Any, inner: str = "\n ") -> str:
    """JSON with a line for each key and for each row of a table; json's own indentation takes twice as long."""
    end = inner[:-1]
    if isinstance(data, dict) and data:
        each = (f"{inner}{_line(k)}: {_lines(v, inner + ' ')}" for k, v in data.items())
        return f"{{{','.join(each)}{end}}}"
    if isinstance(data, list) and data and isinstance(data[0], dict | list):
        return f"[{','.join(inner + _line(v) for v in data)}{end}]"
    return _line(data)


def _line(data: Any) -> str:
    return json.dumps(data, ensure_ascii=False, allow_nan=False)


def written_cell(value: Any) -> Any:
    """A cell that no spreadsheet takes for a formula: text that begins like one has an apostrophe before it."""
    return f"'{value}" if isinstance(value, str) and value.lstrip().startswith(_FORMULA_BEGINS) else value


def _finite(data: Any) -> Any:
    """NaN and infinities become null: JSON has no word for them."""
    if isinstance(data, dict):
        return {k: _finite(v) for k, v in data.items()}
    if isinstance(data, list):
        return [_finite(v) for v in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
