"""Nested plain data with arrays on disk: a JSON file that can be read by eye and an NPZ file; never a pickle."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rso.core import disk

ARRAY_MARK = "array in npz"


def save_arrays(stem: Path, data: Mapping[str, Any]) -> None:
    """Write `stem`.json and `stem`.npz, each in one step; arrays of `data` are named in the first, held in the second.

    Raises ValueError for anything that is neither plain data nor an array of numbers.
    """
    arrays: dict[str, np.ndarray] = {}

    def pack(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            if value.dtype.kind not in "fiub":
                raise ValueError(f"an array of {value.dtype} cannot be saved")
            name = f"a{len(arrays)}"
            arrays[name] = value
            return {ARRAY_MARK: name}
        if isinstance(value, Mapping):
            return {str(k): pack(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [pack(v) for v in value]
        if isinstance(value, np.bool_ | np.integer | np.floating):
            return value.item()
        if value is None or isinstance(value, str | bool | int | float):
            return value
        raise ValueError(f"{value!r} ({type(value).__name__}) cannot be saved")

    text = json.dumps(pack(data), indent=1)
    packed = io.BytesIO()
    np.savez(packed, **arrays)  # type: ignore[arg-type]  # no array is called allow_pickle
    disk.replace(stem.with_name(f"{stem.name}.npz"), packed.getvalue())
    disk.replace(stem.with_name(f"{stem.name}.json"), text)


def load_arrays(stem: Path) -> dict[str, Any]:
    """What :func:`save_arrays` wrote; OSError or ValueError if it cannot be read. Nothing in the files is executed."""
    raw = disk.read_bytes(stem.with_name(stem.name + ".npz"))
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as file:
            if sum(part.file_size for part in file.infolist()) > 2 * len(raw) + 10_000:  # it is written unpacked
                raise ValueError(f"{stem.name}.npz unpacks to more than was packed")
        with np.load(io.BytesIO(raw), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, MemoryError) as error:
        raise ValueError(f"{stem.name}.npz cannot be read: {error}") from error

    def unpack(value: Any) -> Any:
        if isinstance(value, dict):
            if set(value) == {ARRAY_MARK}:
                if value[ARRAY_MARK] not in arrays:
                    raise ValueError(f"{stem.name}.npz has no array {value[ARRAY_MARK]!r}: the two files do not match")
                return arrays[value[ARRAY_MARK]]
            return {k: unpack(v) for k, v in value.items()}
        return [unpack(v) for v in value] if isinstance(value, list) else value

    return unpack(disk.read_json(stem.with_name(stem.name + ".json")))
