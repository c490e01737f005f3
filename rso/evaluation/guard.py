"""Runs a command and kills it with all its children when whoever started this script is gone.

Started by path as the leader of a process group, its standard input being a pipe that only the caller holds open:
end of file means that the caller is dead, even by ``kill -9``.  Imports nothing of rso, so that it starts in 20 ms.
"""

import os
import signal
import subprocess
import sys
import threading


def _watch() -> None:
    os.read(0, 1)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    threading.Thread(target=_watch, daemon=True).start()
    code = subprocess.call(sys.argv[1:], stdin=subprocess.DEVNULL)
    os._exit(code if code >= 0 else 128 - code)
