"""The one runner of all analyses: cases at parameters in, outcomes out, through the store.  It knows no plan."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, field
from typing import Any

from rso.contract import Backend, Case, Response
from rso.evaluation.dispatch import Event, Task, begin_ahead, run_all
from rso.evaluation.executor_loop import Ahead
from rso.evaluation.pool import WorkerDied, WorkerPool
from rso.evaluation.store import Crashed, Done, Failed, RunStore

Outcome = Done | Failed | Crashed
Watch = Callable[[Event], None]


@dataclass(frozen=True, eq=False)
class Evaluator:
    """Where simulations happen: a backend, the store, an executor and somebody who watches.

    `ahead` holds what was begun and not yet asked for, `cost` the CPU seconds of every run asked for by its key.
    """

    backend: Backend
    store: RunStore
    executor: Executor
    watch: Watch | None = None
    ahead: Ahead = field(default_factory=dict)
    cost: dict[str, float] = field(default_factory=dict)

    def run(self, tasks: Sequence[Task]) -> list[Outcome]:
        """Outcome of every task, in order; ValueError for what the backend does not know, before anything runs."""
        found = run_all(self.backend, tasks, self.store, self.executor, watch=self.watch, ahead=self.ahead)
        self.cost.update({o.key: o.cpu_s for o in found if not isinstance(o, Crashed)})
        return found

    def at(self, cases: Sequence[Case], points: Sequence[Mapping[str, float]]) -> list[tuple[Outcome, ...]]:
        """Outcomes of every case at each point of parameters, in order; no channel is asked for in particular."""
        outcomes = self.run([Task(values, case, frozenset()) for values in points for case in cases])
        return in_rows(outcomes, len(cases))

    def begin(self, tasks: Sequence[Task]) -> None:
        """Let the workers begin what will be wanted soon, while this process goes on."""
        begin_ahead(self.backend, tasks, self.store, self.executor, self.ahead)

    def each(self, fn: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """fn of every item, by the workers of a pool where there is one; what they compute is the same to the bit."""
        if not isinstance(self.executor, WorkerPool):
            return [fn(i) for i in items]
        pairs = [(self.executor.submit(fn, i), i) for i in items]
        return [_result(future, fn, i) for future, i in pairs]

    def each_now(self, fn: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """The same of what takes moments: here, where it would wait behind simulations that were begun."""
        waits = any(not future.done() for future in self.ahead.values())
        return [fn(i) for i in items] if waits else self.each(fn, items)


def in_rows(outcomes: Sequence[Outcome], length: int) -> list[tuple[Outcome, ...]]:
    """Outcomes point by point, so many of each."""
    return [tuple(outcomes[k : k + length]) for k in range(0, len(outcomes), length)]


def why(outcome: Outcome) -> tuple[str | None, str | None]:
    """Cause class and first line of the reason of a run that is not done; ("crash", …) for a crash."""
    if isinstance(outcome, Done):
        return None, None
    first = (outcome.reason.splitlines() or ["no reason given"])[0]
    return (outcome.cause if isinstance(outcome, Failed) else "crash"), first


def responses(outcomes: Sequence[Outcome]) -> tuple[Response, ...] | str:
    """The responses of runs, or the reason of the first that has none."""
    bad = [why(o)[1] or "" for o in outcomes if not isinstance(o, Done)]
    return bad[0] if bad else tuple(o.response for o in outcomes if isinstance(o, Done))


def _result(future: Future[Any], fn: Callable[[Any], Any], item: Any) -> Any:
    """What a worker returns; one that died, or ran out of the time that a simulation has, is not needed for it."""
    try:
        return future.result()
    except (WorkerDied, BrokenExecutor):
        return fn(item)
