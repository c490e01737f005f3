"""Executors for runs of this very process, and for runs that somebody else makes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

from rso.evaluation import Event, Planned
from rso.evaluation.dispatch import simulate

T = TypeVar("T")


class InProcess(Executor):
    """Calls at once, in this process: for models that no other process can import, such as those of a notebook."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future that has ended already."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class RunsWanted(Exception):
    """A study cannot go on without these runs: `calls` are the arguments (values, case) of each."""

    def __init__(self, calls: list[tuple[Any, Any]]) -> None:
        super().__init__(f"{len(calls)} runs are wanted")
        self.calls = calls


class Collecting(InProcess):
    """Collects the simulations of a batch and raises RunsWanted instead of making them; makes everything else.

    How many belong to a batch is known from the event that announces it (`watch`).
    """

    def __init__(self) -> None:
        self._calls: list[tuple[Any, Any]] = []
        self._wanted = 0

    def watch(self, event: Event) -> None:
        """Take note of how many runs of a batch the store lacks."""
        if isinstance(event, Planned):
            self._calls, self._wanted = [], event.n_runs - event.n_cached

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A simulation is noted, anything else is done; RunsWanted with the last one of a batch."""
        if fn is not simulate:
            return super().submit(fn, *args, **kwargs)
        _, values, case = args
        self._calls.append((values, case))
        if len(self._calls) >= self._wanted:
            raise RunsWanted(self._calls)
        return Future()
