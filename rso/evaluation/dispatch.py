"""`run_all`: from tasks to outcomes through the store, with any executor."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rso.contract import (
    Backend,
    Case,
    NotFinite,
    Response,
    SimulationFailed,
    beyond_control,
    digest,
    plain,
    run_key,
)
from rso.core.units import CHANNEL_UNITS, same
from rso.evaluation.adapters import Source, check_values
from rso.evaluation.executor_loop import Ahead, Job, drive
from rso.evaluation.pool import WorkerPool
from rso.evaluation.store import Crashed, Done, Failed, RunStore

Outcome = Done | Failed | Crashed


@dataclass(frozen=True)
class Task:
    """One simulation that is wanted: a value per knob, a case, and the channels without which it is of no use."""

    values: Mapping[str, float]
    case: Case
    needs: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Preparing:
    """Artefacts (meshes) are about to be made."""

    n_artefacts: int


@dataclass(frozen=True)
class Planned:
    """`n_tasks` tasks are `n_runs` different runs, of which `n_cached` are in the store."""

    n_tasks: int
    n_runs: int
    n_cached: int


@dataclass(frozen=True)
class Retried:
    """A run (or an artefact) crashed and is tried again."""

    name: str
    reason: str


@dataclass(frozen=True)
class Finished:
    """A run has ended; `n_done` of `n_runs` are now known."""

    key: str
    name: str
    state: Literal["done", "failed", "crashed"]
    wall_s: float
    n_done: int
    n_runs: int


Event = Preparing | Planned | Retried | Finished


@dataclass(frozen=True)
class _Plan:
    """A task in canonical form with its key; `lost` says that an artefact it needs could not be made."""

    name: str
    values: Mapping[str, float]
    case: Case
    recipes: Mapping[str, str]
    needs: frozenset[str]
    key: str = ""
    lost: SimulationFailed | str | None = None


@dataclass(frozen=True)
class Ended:
    """What comes back from a worker: a result or a failure, and what it cost."""

    result: Any
    wall_s: float
    cpu_s: float


def run_all(
    backend: Backend,
    tasks: Sequence[Task],
    store: RunStore,
    executor: Executor,
    *,
    retries: int = 1,
    watch: Callable[[Event], None] | None = None,
    ahead: Ahead | None = None,
) -> list[Outcome]:
    """Outcome of every task, in the order of the tasks; only what the store does not hold is computed.

    Equal runs (equal `run_key` after ``backend.canonical``) are computed once.  Each result is stored as it
    arrives, so that an interruption loses nothing that had finished.  A run that crashes is tried `retries` times
    more, then reported as Crashed; it is tried again in the next call.  An outcome holds the canonical values and
    case (with artefacts) of its task.  `watch` is called in this thread.

    What :func:`begin_ahead` has begun is in `ahead`; and runs of a pool that have their artefacts do not wait for those
    of others.  Only what was begun so and has not been taken over may be computed again after an interruption.

    A backend that gives up for lack of time counts as crashed: on another machine, or another day, it has an answer.
    A response that lacks what its task needs (channels, asked travels) or has another unit than the backend declares
    is a crash.  A stored one that lacks something, from a time when the backend did not return it, is computed again
    and replaced.

    In an executor with a `source` (pool, Dask, SLURM) the backend is the one loaded there; other executors get
    `backend` itself, which must then be picklable if they are made of processes.

    Raises ValueError for a task that the backend does not know (before anything runs), StoreError,
    and BrokenExecutor if the executor can run nothing.
    """
    tell = watch or (lambda _: None)
    target: Backend | Source = getattr(executor, "source", None) or backend
    ahead = {} if ahead is None else ahead
    plans = _prepare([_plan(backend, t) for t in tasks], backend, target, store, executor, retries, tell, ahead)
    book = _open(plans, backend, store, tell)
    tell(Planned(len(plans), len(book.runs), len(book.outcomes)))
    missing = [p for p in book.runs.values() if p.key not in book.outcomes]
    for p in missing:
        if p.lost is not None:
            book.settle(_outcome(p, p.lost, attempts=retries + 1), 0.0)
    jobs = [Job(p.key, p.case.name, (simulate, target, p.values, p.case)) for p in missing if p.lost is None]
    drive(executor, jobs, retries, book.arrived, ahead)
    return [dataclasses.replace(book.outcomes[p.key], values=p.values, case=p.case) for p in plans]


@dataclass(frozen=True, eq=False)
class _Book:
    """The different runs behind some tasks, what each must hold, and the outcomes so far.

    `poor` are stored answers that lack something: they are computed again and replaced.
    """

    backend: Backend
    store: RunStore
    tell: Callable[[Event], None]
    runs: Mapping[str, _Plan]
    needs: Mapping[str, frozenset[str]]
    outcomes: dict[str, Outcome]
    poor: frozenset[str]

    def settle(self, outcome: Outcome, wall_s: float) -> None:
        """Store what has become of a run for good, and announce it."""
        key, case = outcome.key, outcome.case
        if isinstance(outcome, Done) and (lack := _lacking(outcome.response, case, self.needs[key], self.backend)):
            outcome = Crashed(key, outcome.values, case, lack)
        _put(self.store, outcome, replace=key in self.poor)
        self.outcomes[key] = outcome
        state = type(outcome).__name__.lower()
        self.tell(Finished(key, case.name, state, wall_s, len(self.outcomes), len(self.runs)))  # type: ignore[arg-type]

    def arrived(self, job: Job, result: Ended | str, attempt: int, last: bool) -> None:
        """Take one result; a crash that is tried again is stored too, for whoever interrupts."""
        outcome = _outcome(self.runs[job.key], result, attempt)
        if last:
            self.settle(outcome, result.wall_s if isinstance(result, Ended) else 0.0)
        else:
            _put(self.store, outcome)
            self.tell(Retried(job.name, outcome.reason))  # type: ignore[union-attr]


def _open(plans: Sequence[_Plan], backend: Backend, store: RunStore, tell: Callable[[Event], None]) -> _Book:
    """The book with what the store knows already."""
    first = {p.key: p for p in reversed(plans)}  # of equal runs the first task gives the name
    runs = {p.key: first[p.key] for p in plans}
    needs: dict[str, frozenset[str]] = {}
    for p in plans:
        needs[p.key] = needs.get(p.key, frozenset()) | p.needs
    outcomes: dict[str, Outcome] = {}
    poor = set()
    for k in runs:
        found = store.get(k)
        if isinstance(found, Done) and _lacking(found.response, found.case, needs[k], backend):
            poor.add(k)
        elif found is not None:
            outcomes[k] = found
    return _Book(backend, store, tell, runs, needs, outcomes, frozenset(poor))


def simulate(backend: Backend | Source, values: Mapping[str, float], case: Case) -> Ended:
    """One run in the process that computes it; a failure comes back as a result, with its cost."""
    if isinstance(backend, Source):
        backend = backend.load()
    wall, cpu = time.perf_counter(), _cpu_s()
    try:
        response = backend(values, case)
        if not isinstance(response, Response):
            raise TypeError(f"{backend.name} returned {type(response).__name__}, must be a Response")
        result: Any = Response.from_json(response.to_json())  # the same whether fresh or read from the store
    except SimulationFailed as failure:
        partial = None if failure.partial is None else Response.from_json(failure.partial.to_json())
        result = SimulationFailed(failure.cause, failure.reason, partial, tuple(plain(failure.history)))
    except NotFinite as wrong:
        result = wrong.failure()
    return Ended(result, time.perf_counter() - wall, _cpu_s() - cpu)


def make_artefact(backend: Backend | Source, recipe: str) -> Ended:
    """One artefact, made in the process that computes it."""
    if isinstance(backend, Source):
        backend = backend.load()
    wall, cpu = time.perf_counter(), _cpu_s()
    try:
        result: Any = bytes(backend.make(recipe))
    except SimulationFailed as failure:
        result = SimulationFailed(failure.cause, failure.reason)
    return Ended(result, time.perf_counter() - wall, _cpu_s() - cpu)


def _cpu_s() -> float:
    """CPU time (s) of this process, all its threads and its finished children."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _plan(backend: Backend, task: Task) -> _Plan:
    try:
        check_values(backend.parameters, task.values)
        if (why := beyond_control(backend, task.case)) is not None:
            raise ValueError(why)
        backend.check(task.case)
        values, case = backend.canonical(task.values, task.case)
    except ValueError as error:
        raise ValueError(f"task {task.case.name!r}: {error}") from error
    case = dataclasses.replace(case, name=task.case.name)
    return _Plan(task.case.name, values, case, backend.recipes(values, case), task.needs)


def _prepare(
    plans: list[_Plan],
    backend: Backend,
    target: Backend | Source,
    store: RunStore,
    executor: Executor,
    retries: int,
    tell: Callable[[Event], None],
    ahead: Ahead,
) -> list[_Plan]:
    """The plans with artefacts and keys; artefacts that the store lacks are made, each once."""
    known: dict[str, str | SimulationFailed | _Lost] = {}
    names: dict[str, str] = {}
    for plan in plans:
        for name, recipe in plan.recipes.items():
            names.setdefault(recipe, name)
    for recipe in names:
        if (sha := store.artefact(recipe)) is not None:
            known[recipe] = sha
    wanted: dict[str, None] = {}
    for plan in plans:
        lacking = [recipe for recipe in plan.recipes.values() if recipe not in known]
        if lacking and store.get(_with_artefacts(plan, backend, store, known).key) is None:
            wanted.update(dict.fromkeys(lacking))

    def arrived(job: Job, result: Ended | str, _: int, last: bool) -> None:
        if isinstance(result, str):
            known[job.key] = _Lost(f"{job.name} could not be made: {result}")
            if not last:
                tell(Retried(job.name, result))
        elif isinstance(result.result, SimulationFailed):
            known[job.key] = result.result
        else:
            known[job.key] = store.put_artefact(job.name, job.key, result.result)
            _go(plans, backend, target, store, executor, known, ahead)

    if wanted:
        tell(Preparing(len(wanted)))
        drive(executor, [Job(r, names[r], (make_artefact, target, r)) for r in wanted], retries, arrived, ahead)
    return [_with_artefacts(plan, backend, store, known) for plan in plans]


def begin_ahead(backend: Backend, tasks: Sequence[Task], store: RunStore, executor: Executor, ahead: Ahead) -> None:
    """Let a pool begin tasks that will be wanted soon, their artefacts first; nothing is waited for or announced.

    To be called again when artefacts may be there; other executors than pools begin nothing.  :func:`run_all` with the
    same `ahead` takes the results over.
    """
    if not isinstance(executor, WorkerPool):
        return
    target: Backend | Source = backend if executor.source is None else executor.source
    plans = [_plan(backend, t) for t in tasks]
    known: dict[str, str | SimulationFailed | _Lost] = {}
    for recipe, name in {recipe: name for p in plans for name, recipe in p.recipes.items()}.items():
        if (sha := store.artefact(recipe)) is not None:
            known[recipe] = sha
        elif recipe not in ahead:
            ahead[recipe] = executor.submit(make_artefact, target, recipe)
        elif ahead[recipe].done() and ahead[recipe].exception() is None:
            made = ahead[recipe].result().result
            if not isinstance(made, SimulationFailed):
                known[recipe] = store.put_artefact(name, recipe, made)
                del ahead[recipe]
    _go(plans, backend, target, store, executor, known, ahead)


def _go(
    plans: Sequence[_Plan],
    backend: Backend,
    target: Backend | Source,
    store: RunStore,
    executor: Executor,
    known: Mapping[str, str | SimulationFailed | _Lost],
    ahead: Ahead,
) -> None:
    """Begin those runs of a pool that have all their artefacts and are not known."""
    if not isinstance(executor, WorkerPool):
        return
    for plan in plans:
        if all(isinstance(known.get(r), str) for r in plan.recipes.values()):
            keyed = _with_artefacts(plan, backend, store, known)
            if keyed.key not in ahead and store.get(keyed.key) is None:
                ahead[keyed.key] = executor.submit(simulate, target, keyed.values, keyed.case)


@dataclass(frozen=True)
class _Lost:
    reason: str


def _with_artefacts(
    plan: _Plan, backend: Backend, store: RunStore, known: Mapping[str, str | SimulationFailed | _Lost]
) -> _Plan:
    """The plan with its artefacts and key; for an artefact that does not exist the hash of its recipe stands in."""
    shas, lost = {}, None
    for name, recipe in plan.recipes.items():
        found = known.get(recipe)
        shas[name] = found if isinstance(found, str) else f"recipe {digest(recipe)}"
        if lost is None and found is not None and not isinstance(found, str):
            lost = found.reason if isinstance(found, _Lost) else found
    objects = str(store.objects) if shas else None
    case = dataclasses.replace(plan.case, artefacts=shas, objects=objects)
    return dataclasses.replace(plan, case=case, key=run_key(backend, plan.values, case), lost=lost)


def _outcome(plan: _Plan, result: Ended | SimulationFailed | str, attempts: int) -> Outcome:
    """What has become of a plan: an answer, a failure, or the reason of a crash."""
    head = (plan.key, plan.values, plan.case)
    if isinstance(result, str):
        return Crashed(*head, result, attempts)
    ended = result if isinstance(result, Ended) else Ended(result, 0.0, 0.0)
    if isinstance(ended.result, Response):
        return Done(*head, ended.result, ended.wall_s, ended.cpu_s)
    f = ended.result
    if f.cause == "time_limit":  # says how fast this machine is, not what the answer hangs on
        return Crashed(*head, f"{f.cause}: {f.reason}", attempts)
    return Failed(*head, f.cause, f.reason, f.partial, tuple(f.history), ended.wall_s, ended.cpu_s)


def _lacking(response: Response, case: Case, needs: frozenset[str], backend: Backend) -> str | None:
    """What stands between a response and its use, in words; None if nothing does."""
    if missing := sorted(needs - set(response.channels)):
        held = sorted(response.channels)
        return f"the response lacks {', '.join(missing)}, which {backend.name} declares; it holds {', '.join(held)}"
    for channel, unit in response.units.items():
        if backend.channels.get(channel, unit) != unit:
            return f"the response has {channel} in {unit}, {backend.name} declares {backend.channels[channel]}"
        wanted = CHANNEL_UNITS.get(channel.partition("(")[0], unit)  # "uz(3,4)" is a mark's, declared by nobody
        if channel not in backend.channels and not same(unit, wanted):
            return f"the response has {channel} in {unit}, it must be in {wanted}"
    travel, time = response.channels["travel"], response.channels["time"]
    asked = np.asarray(() if case.programme.forced else case.programme.asked_mm)  # a force may not reach a travel
    if not len(travel) or np.any(np.abs(travel[:, None] - asked).min(axis=0) > 1e-9):
        return f"the response holds travels {travel.tolist()} mm, asked were {asked.tolist()} mm"
    moments = np.asarray(case.programme.asked_s)
    if len(moments) and np.any(np.abs(time[:, None] - moments).min(axis=0) > 1e-6 * np.abs(time).max()):
        return f"the response holds times {time.tolist()} s, asked were {moments.tolist()} s"
    own = sum(len(s.asked_s) for s in case.programme.segments)
    if len(time) < own:
        return f"the response holds {len(time)} instants, the segments ask for {own} moments"
    return None


def _put(store: RunStore, outcome: Outcome, *, replace: bool = False) -> None:
    if isinstance(outcome, Done):
        store.put_done(outcome, replace=replace)
    elif isinstance(outcome, Failed):
        store.put_failed(outcome)
    else:
        store.put_crashed(outcome)
