"""Files and folders that may come from a stranger: regular ones only, written whole and never through a link."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from pathlib import Path
from typing import Any

MAX_READ_BYTES = 512 * 1024 * 1024  # bytes; a sparse file may claim more than any disk holds
_PART_FILE = re.compile(r"\..*\.(\d+)\.part")


def replace(path: Path, content: bytes | str, *, durably: bool = False) -> Path:
    """Put `content` (text as UTF-8) in the place of a file in one step; what stood there, a link too, is not touched.

    `durably` waits until the disk has it.  Raises OSError with the name of the file.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(_new(part), "wb") as file:
            file.write(data)
            file.flush()
            if durably:
                os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, OSError):  # the temporary name says nothing to anybody
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    return path


def _new(path: Path) -> int:
    """Descriptor of a file that did not exist: whoever left one of this name left no writer behind."""
    path.unlink(missing_ok=True)
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def read_bytes(path: Path, most: int = MAX_READ_BYTES) -> bytes:
    """All bytes of a regular file; OSError for anything else (a device, a pipe) and for more than `most` bytes."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a pipe without a writer must not wait
    with open(descriptor, "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "is not a regular file", str(path))
        data = b"" if found.st_size > most else file.read(most + 1)
        if max(len(data), found.st_size) > most:
            raise OSError(errno.EFBIG, f"has more than {most / 1e6:.0f} MB", str(path))
        return data


def read_json(path: Path, most: int = MAX_READ_BYTES) -> Any:
    """Data of a JSON file; OSError as of :func:`read_bytes`, ValueError where it is none."""
    try:
        return json.loads(read_bytes(path, most).decode("utf-8-sig"))
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None


def folder(path: Path) -> Path:
    """A folder, made where it is missing; OSError where a link stands there: what it leads to is somebody else's."""
    path.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        raise OSError(errno.ELOOP, "is a symbolic link, which is not followed", str(path))
    return path


def only(path: Path) -> None:
    """OSError unless there is nothing at `path`, or a regular file that has no other name."""
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if stat.S_ISLNK(found.st_mode):
        raise OSError(errno.ELOOP, "is a symbolic link, which is not followed", str(path))
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        why = f"is one of {found.st_nlink} names of a file" if found.st_nlink > 1 else "is not a regular file"
        raise OSError(errno.EINVAL, why, str(path))


def without_leftovers(path: Path) -> None:
    """Remove the temporary files of :func:`replace` that a killed process left in a folder."""
    for part in path.glob(".*.part"):
        match = _PART_FILE.fullmatch(part.name)
        if match and not running(match[1]):
            part.unlink(missing_ok=True)


def running(process: str) -> bool:
    """Whether a process of this number lives on this machine, or may; of what is no number True."""
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except (ValueError, OverflowError, PermissionError):
        return True
    return True
