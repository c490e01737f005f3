"""Programs that are run in a folder of their own and die with whoever started them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

GUARD_SCRIPT = str(Path(__file__).with_name("guard.py"))


def run_guarded(command: Sequence[str], folder: Path, timeout_s: float | None) -> int:
    """Exit code of the command, run in `folder` with its output in files; RuntimeError when time is up."""
    with open(folder / "stdout.txt", "wb") as out, open(folder / "stderr.txt", "wb") as err:
        process = subprocess.Popen(
            (sys.executable, "-I", "-S", GUARD_SCRIPT, *command),
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=err,
            cwd=folder,
            process_group=0,
        )
    try:
        return process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{command[0]} stopped after the time-out of {timeout_s:g} s; see {folder}") from None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        assert process.stdin is not None
        process.stdin.close()


def words_of(command: tuple[str, ...], root: Path) -> tuple[str, ...]:
    """The command with the files that it names below `root` made absolute."""
    return tuple(str(root / word) if (root / word).is_file() else word for word in command)


def no_program(command: tuple[str, ...], root: Path) -> str | None:
    """Why the program of a command cannot be run, or None."""
    first, *_ = (*words_of(command, root), "")
    return None if first and shutil.which(first) else f"program {first!r} of command = {list(command)} was not found"


def end_of(file: Path, most: int = 10_000) -> str:
    """The end of a file of any length as text; empty where there is none."""
    try:
        with open(file, "rb") as f:
            f.seek(max(os.fstat(f.fileno()).st_size - most, 0))
            return f.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def tail(text: str, lines: int = 20) -> str:
    """The last lines of a text."""
    return "\n".join(text.strip().splitlines()[-lines:])
