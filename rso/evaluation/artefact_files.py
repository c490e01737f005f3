"""Artefacts of cases on their way to other machines: files by hash, in a folder that nobody else may write to."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from rso.contract import Case, object_path
from rso.core import disk


def artefacts_by_hash(case: Case) -> Mapping[str, Path]:
    """Artefacts of a case that exist, by hash."""
    found = {sha: case.artefact(name) for name, sha in case.artefacts.items()}
    return {sha: path for sha, path in found.items() if path is not None and path.is_file()}


def keep_artefact(folder: Path, sha: str, content: bytes) -> None:
    """Store a file under its hash, whole or not at all; somebody else may be storing it too.

    Raises PermissionError where others may write to the folder.
    """
    own_folder(folder)
    path = object_path(folder, sha)
    if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == sha:
        return
    disk.replace(disk.folder(path.parent) / path.name, content)


def own_folder(folder: Path) -> Path:
    """A folder of this user alone, made where it is missing; PermissionError where it is not."""
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()  # before anything in it is believed: its name is known to everybody on the machine
    if stat.S_ISLNK(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{folder} is a link, belongs to somebody else or others may write to it: remove it")
    return folder
