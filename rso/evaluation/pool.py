"""A pool of worker processes in which ``kill -9`` of one costs one run.

Each worker is a fresh interpreter with a private pipe and one manager thread in the parent: nothing is shared
between workers, so nothing can be left locked or half written.  Workers are started by ``python -c`` and not by
`multiprocessing`: their environment is given (threads pinned before numpy is imported), and the caller's script is
not imported again, so it needs no ``if __name__ == "__main__"`` guard.  In return, functions and classes that
travel must live in an importable module, not in ``__main__``; this is said where it is violated.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from rso.evaluation.adapters import Source

T = TypeVar("T")

_WORKER_ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "PYTHONHASHSEED": "0",  # the order of sets of strings is then the same in every worker
}
# The folder that it is started in, which may be a stranger's, is no place for modules: -P, and sys.path comes first.
_WORKER_PROGRAM = """
import sys
sys.path[:] = sys.argv[2:]
from rso.evaluation.pool import serve
serve(int(sys.argv[1]))
"""
_CALL_NUMBER_BYTES = 8  # bytes of the number of a call, which its answer repeats
_numbers = itertools.count(1)
_MAX_BAD_STARTS = 3  # one may be bad luck (memory), three in turn are not


class WorkerDied(Exception):
    """The worker process ended while it computed: killed from outside, out of memory, or out of time."""


class WorkersCannotStart(BrokenExecutor):
    """No worker can be started (the backend cannot be loaded there); the pool is of no further use."""


@dataclass(frozen=True)
class _Worker:
    process: subprocess.Popen[bytes]
    pipe: Connection


class WorkerPool(Executor):
    """`workers` persistent processes behind the interface of `concurrent.futures`.

    `source` is loaded once in each worker when it starts, which is when it gets its first task, or at once where `warm`
    (as many as the machine has processors).  There are never more workers than tasks.  A task that takes longer than
    `timeout_s` (wall, s) is stopped by killing its worker; its future gets WorkerDied, the next task a new worker.
    Leaving the ``with`` block by an exception kills what still runs.  Workers exit when the parent dies (compiled code
    that never releases the interpreter's lock delays this until it returns).

    Raises ValueError for `workers` < 1.  Futures get WorkersCannotStart if a worker cannot start.
    """

    def __init__(
        self,
        workers: int,
        *,
        source: Source | None = None,
        timeout_s: float | None = None,
        start_timeout_s: float = 300.0,
        warm: bool = False,
    ) -> None:
        if workers < 1:
            raise ValueError(f"workers = {workers}, must be at least 1")
        self.source = source
        self._timeout_s, self._start_timeout_s, self._warm = timeout_s, start_timeout_s, warm
        self._tasks: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._closed = self._killed = False
        self._broken: WorkersCannotStart | None = None
        self._bad_starts = 0
        self._alive: set[subprocess.Popen[bytes]] = set()
        self._workers = workers
        self._threads: list[threading.Thread] = []
        if warm:
            for _ in range(min(workers, os.cpu_count() or 1)):
                self._one_more()

    @property
    def broken(self) -> bool:
        """Whether its workers cannot start or it was shut down: it is of no further use."""
        return self._broken is not None or self._closed

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Queue one call; ValueError if `fn` lives in ``__main__``, RuntimeError after shutdown."""
        if getattr(fn, "__module__", None) == "__main__":
            raise ValueError(f"{fn!r} lives in __main__, which workers do not import: move it to a module")
        payload = pickle.dumps((fn, args, kwargs))
        with self._lock:
            if self._broken is not None:
                raise self._broken
            if self._closed:
                raise RuntimeError("the pool is shut down: no new tasks")
            if len(self._threads) < self._workers:
                self._one_more()
            future: Future[T] = Future()
            self._tasks.put((future, payload))
            return future

    def _one_more(self) -> None:
        """One more manager thread; WorkersCannotStart where the machine gives the first none."""
        thread = threading.Thread(target=self._manage, daemon=True)
        try:
            thread.start()
        except RuntimeError as error:  # no more threads are allowed: those that there are do the work
            if not self._threads:
                raise WorkersCannotStart(f"no thread for a worker can be started ({error})") from error
            self._workers = len(self._threads)
            return
        self._threads.append(thread)

    def kill_workers(self) -> None:
        """Kill every worker now and start none again; running tasks get WorkerDied, waiting ones are cancelled."""
        with self._lock:
            self._closed = self._killed = True
            for process in self._alive:
                _kill(process)
        self.shutdown(cancel_futures=True)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks; finish (or cancel) the waiting ones, then end the workers."""
        with self._lock:
            self._closed = True
        if cancel_futures:
            with contextlib.suppress(queue.Empty):
                while True:
                    if (item := self._tasks.get_nowait()) is not None:
                        item[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.kill_workers()

    def _manage(self) -> None:
        """Life of one manager thread: it owns one worker at a time."""
        worker = None
        if self._warm:
            with contextlib.suppress(Exception):  # the first task will try again, and say why it cannot be
                worker = self._start()
        while (item := self._tasks.get()) is not None:
            future, payload = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if worker is None or worker.process.poll() is not None:
                    self._end(worker)
                    worker = None  # should the start fail, there is none
                    worker = self._start()
                ok, value = _ask(worker, payload, self._timeout_s)
            except Exception as error:
                ok, value = False, error
            if ok:
                future.set_result(value)
            else:
                future.set_exception(value)
        self._end(worker)

    def _start(self) -> _Worker:
        """A worker that has loaded the backend.

        Raises WorkersCannotStart, and marks the pool broken, if the backend cannot be loaded or several workers in
        turn die on the way; WorkerDied if one does.
        """
        here, there = Pipe()
        with self._lock:
            if self._broken is not None or self._killed:
                raise self._broken or WorkerDied("the pool was stopped")
            process = subprocess.Popen(
                (sys.executable, "-P", "-c", _WORKER_PROGRAM, str(there.fileno()), *sys.path),
                env={**os.environ, **_WORKER_ENVIRONMENT},
                stdin=subprocess.DEVNULL,
                pass_fds=(there.fileno(),),
                process_group=0,  # Ctrl-C is for the parent; and a worker is killed with its own children
            )
            self._alive.add(process)
        there.close()
        worker = _Worker(process, here)
        start_up = pickle.dumps((_start_up, (self.source,), {}))
        try:
            ok, error = _ask(worker, start_up, self._start_timeout_s)
        except WorkerDied as death:
            ok, error = False, death
        with self._lock:
            self._bad_starts = 0 if ok else self._bad_starts + 1
        if ok:
            return worker
        self._end(worker)
        if self._killed or (isinstance(error, WorkerDied) and self._bad_starts < _MAX_BAD_STARTS):
            raise error
        why = f"{type(error).__name__}: {error}"
        with self._lock:
            self._broken = self._broken or WorkersCannotStart(f"a worker process cannot start: {why}")
        raise self._broken

    def _end(self, worker: _Worker | None) -> None:
        if worker is None:
            return
        worker.pipe.close()  # end of file: the worker exits
        try:
            worker.process.wait(5.0)
        except subprocess.TimeoutExpired:
            _kill(worker.process)
            worker.process.wait()
        with contextlib.suppress(ProcessLookupError, PermissionError):  # and what it has left behind
            os.killpg(worker.process.pid, signal.SIGKILL)
        with self._lock:
            self._alive.discard(worker.process)


def _ask(worker: _Worker, payload: bytes, timeout_s: float | None) -> tuple[bool, Any]:
    """Send one task and wait for its result; WorkerDied if none can come any more."""
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    number = next(_numbers).to_bytes(_CALL_NUMBER_BYTES, "big")
    try:
        worker.pipe.send_bytes(number + payload)
        while not worker.pipe.poll(1.0 if deadline is None else max(0.0, min(1.0, deadline - time.monotonic()))):
            # a process that the worker left behind may hold the pipe open
            if worker.process.poll() is not None and not worker.pipe.poll(0):
                raise EOFError
            if deadline is not None and time.monotonic() >= deadline:
                _kill(worker.process)
                worker.process.wait()
                raise WorkerDied(f"stopped after the time-out of {timeout_s:g} s")
        answer = worker.pipe.recv_bytes()
        # somebody else writes into its pipe: nothing that follows can be trusted
        if answer[:_CALL_NUMBER_BYTES] != number:
            _kill(worker.process)
            worker.process.wait()
            raise WorkerDied("the worker process answered another call: does the backend make copies of its process?")
        ok, value, trace = pickle.loads(answer[_CALL_NUMBER_BYTES:])
    except (EOFError, OSError):
        _kill(worker.process)
        raise WorkerDied(f"the worker process ended {_how(worker.process.wait())} while it computed") from None
    if not ok:
        value.__cause__ = RuntimeError(f"in the worker:\n{trace}")
    return ok, value


def _kill(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _how(code: int) -> str:
    return f"by signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"


def serve(descriptor: int) -> None:
    """Main function of a worker: answer calls until the pipe closes, which also happens when the parent dies.

    A copy of this process that a backend makes (fork) and lets return ends here: it has no task, and its answer would
    be taken for that of the next one.
    """
    pipe, home = Connection(descriptor), os.getpid()
    os.set_inheritable(pipe.fileno(), False)
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def receive() -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                tasks.put(pipe.recv_bytes())
        os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    while True:
        answer = _answer(tasks.get())
        if os.getpid() != home:
            os._exit(1)
        if sys.stdout is not None:  # a parent without one has workers without one
            sys.stdout.flush()
        with contextlib.suppress(OSError):  # the parent is gone: the other thread ends this process
            pipe.send_bytes(answer)


def _answer(payload: bytes) -> bytes:
    """The number of one call, and pickled (ok, result or exception, traceback); never raises."""
    number, call = payload[:_CALL_NUMBER_BYTES], payload[_CALL_NUMBER_BYTES:]
    try:
        fn, args, kwargs = pickle.loads(call)
    except Exception as error:
        hint = "functions and classes that travel must live in an importable module, not in __main__"
        return number + pickle.dumps((False, RuntimeError(f"the worker cannot read the task ({error}): {hint}"), ""))
    try:
        return number + pickle.dumps((True, fn(*args, **kwargs), ""))
    except BaseException as error:  # even sys.exit() in a backend must not take the worker along
        trace = traceback.format_exc()
        try:
            answer = pickle.dumps((False, error if isinstance(error, Exception) else RuntimeError(repr(error)), trace))
            pickle.loads(answer)
            return number + answer
        except Exception:  # not every exception survives the journey; its text does
            return number + pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {_text_of(error)}"), trace))


def _text_of(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # its own __str__ fails
        return "(it has no text)"


def _start_up(source: Source | None) -> None:
    if source is not None:
        source.load()
