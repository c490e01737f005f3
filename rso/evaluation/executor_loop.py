"""Jobs through an executor: each result handed on as it arrives, crashes tried again, nothing lost when interrupted."""

from __future__ import annotations

import contextlib
import queue
import traceback
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

Ahead = dict[str, Future[Any]]  # what was begun before anybody waits for it, by the key of its job


@runtime_checkable
class KeyedExecutor(Protocol):
    """An executor that keeps what it computed by the key of the job, beyond the life of this process."""

    def submit_keyed(self, key: str, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Queue one call, or take over what an earlier process had computed of it."""
        ...


@dataclass(frozen=True)
class Job:
    """A call, by the key of what it computes."""

    key: str
    name: str
    call: tuple[Any, ...]


def drive(
    executor: Executor,
    jobs: Iterable[Job],
    retries: int,
    arrived: Callable[[Job, Any, int, bool], None],
    ahead: Ahead,
) -> None:
    """Run the jobs and hand on each result as it arrives: (job, result or reason of the crash, attempt, last).

    A job that was begun already is taken over from `ahead`.
    """
    ready: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    running: dict[Future[Any], tuple[Job, int]] = {}

    def submit(job: Job, attempt: int) -> None:
        begun = ahead.pop(job.key, None) if attempt == 1 else None
        if begun is None and isinstance(executor, KeyedExecutor):
            begun = executor.submit_keyed(job.key, *job.call)
        future = begun or executor.submit(*job.call)
        running[future] = (job, attempt)
        future.add_done_callback(ready.put)

    def take(future: Future[Any]) -> None:
        job, attempt = running[future]
        if future.cancelled():  # nobody here did that
            raise BrokenExecutor(f"the executor gave up {job.name}: is its scheduler still there?")
        error = future.exception()
        if isinstance(error, BrokenExecutor):
            raise error
        if error is None:
            arrived(job, future.result(), attempt, True)
        else:
            arrived(job, _reason(error), attempt, attempt > retries)
        del running[future]
        if error is not None and attempt <= retries:
            submit(job, attempt + 1)

    try:
        for job in jobs:
            submit(job, 1)
            while not ready.empty():  # an executor that computes at once must not keep its results waiting
                take(ready.get())
        while running:
            take(ready.get())
    except BaseException:
        _rescue(running, arrived)
        raise


def _rescue(running: Mapping[Future[Any], tuple[Job, int]], arrived: Callable[[Job, Any, int, bool], None]) -> None:
    """Stop what has not begun and hand on what has finished, whatever went wrong."""
    for future in running:
        future.cancel()
    for future, (job, attempt) in running.items():
        if future.done() and not future.cancelled() and future.exception() is None:
            with contextlib.suppress(Exception, KeyboardInterrupt):  # the first error is the one to be told
                arrived(job, future.result(), attempt, True)


def _reason(error: BaseException) -> str:
    """One line, then the traceback."""
    first = f"{type(error).__name__}: {error}"
    return first + "\n" + "".join(traceback.format_exception(error))
