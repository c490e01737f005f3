"""The command line `rso`: parse, call a stage, print."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Sequence

from rso.cli.arguments import parser
from rso.cli.commands import EXIT_BAD_INPUT, EXIT_BROKEN, EXIT_INTERRUPTED
from rso.cli.output import wrapped
from rso.core.printable import Printable, as_one_entry

TRACEBACK_VARIABLE = "RSO_TRACEBACK"  # environment variable: a fault of the program is raised instead of explained


def main(arguments: Sequence[str] | None = None) -> int:
    """Console script; returns the exit code.  Whatever goes wrong ends in one message, never in a traceback."""
    _open_streams()
    gc.set_threshold(50_000, 20, 20)  # else imports and figures pass their many objects again and again
    os.environ["MPLBACKEND"] = "agg"  # figures go to files; matplotlib does not start with a name that it lacks
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    out, err = Printable(sys.stdout), Printable(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        options = parser(arguments).parse_args(arguments)
        code = _guarded(lambda: options.call(options, shlex.join(["rso", *arguments])))
        return _guarded(lambda: _flushed(code))


def _open_streams() -> None:
    """Standard streams that somebody closed lead nowhere: else the next file that is opened would take their place."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # It takes the lowest number that is free; workers have it too.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without μ shows ? for it


def _flushed(code: int) -> int:
    sys.stdout.flush()
    return code


def _guarded(call: Callable[[], int]) -> int:
    """Exit code of a command; whatever it raises is explained."""
    try:
        return call()
    except KeyboardInterrupt:
        _tell("\nrso: interrupted; everything finished is stored, the same command goes on from there")
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # whoever read has read enough, as head does: no fault of the folder or the study
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _tell(
            "rso: its output was closed, so it stopped; everything finished is stored, "
            "the same command goes on from there"
        )
        return EXIT_INTERRUPTED
    except OSError as error:
        what = f"{error.filename}: " if error.filename else ""
        _tell(
            f"rso: {as_one_entry(what)}{error.strerror or error}: check that the folder is writable and the disk not "
            "full, then run again. Finished runs stay stored"
        )
        return EXIT_BROKEN
    except MemoryError:
        _tell("rso: this machine ran out of memory. Finished runs stay stored")
        return EXIT_BROKEN
    except Exception as error:
        code, text = _foreseen(error)
        if not text and os.environ.get(TRACEBACK_VARIABLE):
            raise
        _tell(text or _fault(error))
        return code


def _foreseen(error: Exception) -> tuple[int, str]:
    """Exit code and message of an error; without a message where it is a fault of the program."""
    try:
        from concurrent.futures import BrokenExecutor

        from rso.evaluation.store import StoreError
        from rso.study.errors import StudyError
    except Exception:  # not this call's doing: it is the machine that does not let the program be loaded
        why = as_one_entry(f"{type(error).__name__}: {error}")[:800]
        return EXIT_BROKEN, (
            f"rso: cannot be loaded on this machine: {why}. If compiled code cannot be written, set NUMBA_CACHE_DIR "
            "to a writable folder"
        )
    if isinstance(error, StudyError):
        return EXIT_BAD_INPUT, "\n".join(map(as_one_entry, error.problems))
    if isinstance(error, StoreError | BrokenExecutor):
        return EXIT_BROKEN, f"rso: {as_one_entry(str(error))}"
    return EXIT_BROKEN, ""


def _fault(error: Exception) -> str:
    """One sentence about an error that nobody foresaw: what, and where in the program."""
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    where = "".join(f" at {os.path.basename(f.filename)}:{f.lineno}" for f in frames)
    said = as_one_entry(f"{type(error).__name__}: {error}")
    return (
        f"rso: a fault of the program{where}: {said[:800]}. Finished runs stay stored. Please report it, with what "
        f"{TRACEBACK_VARIABLE}=1 before the command prints"
    )


def _tell(text: str) -> None:
    """A message for people, as far as somebody reads."""
    with contextlib.suppress(OSError, ValueError):
        lines = (wrapped(line, sys.stderr) for line in text.split("\n"))  # a problem each
        print("\n".join(lines), file=sys.stderr, flush=True)
