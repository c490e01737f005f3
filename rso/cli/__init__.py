"""rso new | check | run | status | diagnose | ladder | next | blind | report | keys: parse, call a stage, print."""

from __future__ import annotations

import io
import os
import shlex
import sys
from collections.abc import Sequence

from rso.cli.arguments import parser
from rso.cli.commands import EXIT_BAD_INPUT, EXIT_BROKEN, EXIT_INTERRUPTED


def main(arguments: Sequence[str] | None = None) -> int:
    """Console script; returns the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without μ shows ? for it
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(arguments)
    from concurrent.futures import BrokenExecutor

    from rso.store import StoreError
    from rso.study import StudyError

    try:
        return options.call(options, shlex.join(["rso", *arguments]))
    except KeyboardInterrupt:
        print("\nrso: interrupted; everything finished is stored, the same command goes on from there", file=sys.stderr)
        return EXIT_INTERRUPTED
    except StudyError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    except (StoreError, BrokenExecutor) as error:
        print(f"rso: {error}", file=sys.stderr)
        return EXIT_BROKEN
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing to complain about at the end
        return EXIT_BROKEN
    except OSError as error:
        what = f"{error.filename}: " if error.filename else ""
        print(
            f"rso: {what}{error.strerror or error}: check that the folder is writable and that the disk is not full, "
            "then run again; runs stored so far are kept",
            file=sys.stderr,
        )
        return EXIT_BROKEN
