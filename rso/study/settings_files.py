"""Files that settings of a backend name: relative to the study file as written, absolute where a backend reads them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

FILE_KEY = "file"  # of a table of settings, at any depth


def with_absolute_paths(settings: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The settings with absolute paths of files that exist in or from the study's folder; others stay as written."""

    def found(name: str) -> str:
        path = (folder / name).absolute()
        return str(path) if name and path.is_file() else name

    return _changed(settings, found)


def with_relative_paths(settings: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The settings with paths relative to the study's folder where they lie in it: results are read elsewhere, too."""
    root = folder.absolute()

    def short(name: str) -> str:
        path = Path(name)
        return path.relative_to(root).as_posix() if path.is_absolute() and path.is_relative_to(root) else name

    return _changed(settings, short)


def paths_seen_from(settings: Any, folder: Path) -> Any:
    """The settings with the paths of their files as a study in a folder finds them; their own on another drive."""

    def there(name: str) -> str:
        try:
            return Path(os.path.relpath(Path(name).resolve(), folder.resolve())).as_posix()
        except ValueError:
            return name

    return _changed(settings, there)


def named_files(settings: Mapping[str, Any]) -> list[str]:
    """Every file that the settings name."""
    return list(_names(settings))


def _names(data: Any) -> Iterator[str]:
    for key, value in data.items() if isinstance(data, Mapping) else ():
        if key == FILE_KEY and isinstance(value, str):
            yield value
        yield from _names(value)


def _changed(data: Any, change: Callable[[str], str]) -> Any:
    if not isinstance(data, Mapping):
        return data
    return {k: change(v) if k == FILE_KEY and isinstance(v, str) else _changed(v, change) for k, v in data.items()}
