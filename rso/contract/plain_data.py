"""Plain JSON data, its digest, and where what has a digest lies."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

_PLAIN_KINDS = (float, str, int, bool, type(None))  # most of all data, seen without asking for what they are kinds of


def plain(data: Any) -> Any:
    """Plain JSON data (dicts with string keys, lists, str, int, float, bool, None); ValueError for the rest."""
    if type(data) in _PLAIN_KINDS:
        return data
    if isinstance(data, Mapping | MappingProxyType):
        return {str(k): plain(v) for k, v in data.items()}
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    if isinstance(data, list | tuple):
        return [plain(v) for v in data]
    if isinstance(data, np.bool_ | np.integer | np.floating):
        return data.item()
    if data is None or isinstance(data, str | bool | int | float):
        return data
    raise ValueError(f"{data!r} ({type(data).__name__}) is not plain data")


def digest(data: Any) -> str:
    """SHA-256 of plain data in canonical form; 4 and 4.0 are the same number, -0.0 is 0.0."""

    def normal(x: Any) -> Any:
        kind = type(x)
        if kind is float or kind is int:
            return (float(x) + 0.0).hex()
        if kind is dict:
            return {str(k): normal(v) for k, v in x.items()}
        if kind is list or kind is tuple:
            return [normal(v) for v in x]
        if kind in _PLAIN_KINDS:
            return x
        made = plain(x)
        if isinstance(made, dict | list):
            return normal(made)
        return (float(made) + 0.0).hex() if isinstance(made, int | float) and not isinstance(made, bool) else made

    return hashlib.sha256(json.dumps(normal(data), sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def by_contents(data: Any) -> Any:
    """Plain data without `file` in every table that has the `sha256` of what is in it: where it lies is not what it is.

    So a backend whose canonical settings name a file writes its hash beside; a run of the same contents elsewhere has
    the same key.
    """
    if isinstance(data, list):
        return [by_contents(v) for v in data]
    if not isinstance(data, dict):
        return data
    return {k: by_contents(v) for k, v in data.items() if not (k == "file" and "sha256" in data)}


def object_path(folder: Path, sha: str) -> Path:
    """Where a content-addressed object lies below `folder`."""
    return folder / sha[:2] / sha
