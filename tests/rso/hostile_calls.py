"""Calls that misbehave in a worker process, for tests of what the parent makes of them."""

import os
import pickle
import stat
import time
from multiprocessing.connection import Connection


def fork_and_return(x: int) -> int:
    """Both copies go on."""
    os.fork()
    return x


def fork_and_fail(x: int) -> int:
    if os.fork() == 0:
        raise ZeroDivisionError("in the copy")
    return x


def same(x: int) -> int:
    time.sleep(0.02)
    return x


def answer_for_another(x: int) -> int:
    """Writes an answer of its own into every pipe that it has, before the worker gives the true one."""
    for number in range(3, 64):
        try:
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                pipe = Connection(os.dup(number))
                pipe.send_bytes(bytes(8) + pickle.dumps((True, -1, "")))
                pipe.close()
        except OSError:
            continue
    return x


def leave_a_copy(file: str) -> int:
    """A copy goes on sleeping."""
    if os.fork() == 0:
        with open(file, "w") as f:
            f.write(str(os.getpid()))
        time.sleep(60)
    return 1
