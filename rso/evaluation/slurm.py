"""Runs as job arrays of SLURM through `submitit`: calls go out in a common folder, answers come back there.

Optional (extra `slurm`).  Each answer is a JSON file under the key of its run, written by the job as soon as it has it:
it outlives the job, and this process.  What an earlier process did not live to store is taken over by the next.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import functools
import importlib.util
import json
import math
import queue
import shutil
import threading
import time
import traceback
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rso.contract import Case, Response, SimulationFailed, digest, plain
from rso.core import disk
from rso.evaluation.adapters import Source
from rso.evaluation.artefact_files import artefacts_by_hash, keep_artefact, own_folder
from rso.evaluation.dispatch import Ended
from rso.evaluation.guarded_process import end_of, tail
from rso.evaluation.pool import WorkerDied, WorkerPool, WorkersCannotStart

GATHERING_S = 0.25  # calls that come within this time of each other become one array
POLLING_S = 0.25  # between two looks at jobs and their answers
MAX_ARRAY_ELEMENTS = 1000  # SLURM's default MaxArraySize is 1001
LATE_ANSWER_S = 60.0  # a network disk may show what a job has written after SLURM says that it ended
LOST_ANSWER_S = 5.0  # the same for a job that did not end by itself
N_LOG_LINES = 12  # of a job's error log, in the reason of what it lost


@dataclass(frozen=True)
class ArraySettings:
    """What each job asks SLURM for: minutes, GB, the words of sbatch; and how many runs it does one after another.

    `here` makes processes of this machine of them, to try a study where SLURM is not.
    """

    minutes: float = 60.0
    memory_gb: float | None = None
    runs_per_job: int = 1
    partition: str | None = None
    account: str | None = None
    qos: str | None = None
    setup: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    here: bool = False


@dataclass
class _Element:
    """A job that was handed in, what it is to compute, and since when it is gone (s), if it is."""

    job: Any
    calls: dict[str, Future[Any]]
    gone: float | None = None


class SlurmExecutor(Executor):
    """Job arrays behind the interface of `concurrent.futures`.

    Calls are those of :func:`rso.evaluation.dispatch.run_all` (they return an Ended).  A run that crashes or runs out
    of `timeout_s` (wall, s) costs itself; a job that dies costs the runs that it had not answered: their futures get
    WorkerDied with the state that SLURM names and the end of the job's log.  Leaving the ``with`` block by an exception
    cancels all jobs; answers that came stay for the next process.
    """

    def __init__(
        self,
        folder: Path,
        source: Source,
        timeout_s: float | None,
        settings: ArraySettings,
        jobs: int,
    ) -> None:
        self.source = source
        self._folder, self._timeout_s = folder, timeout_s
        self._settings, self._most = settings, jobs
        self._array: Any = None  # made with the first call: until then the folder is nobody's
        self._asked: queue.SimpleQueue[tuple[str, Future[Any], tuple[Any, ...]] | None] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._taken: list[Path] = []
        self._session = folder / f"jobs-{uuid.uuid4().hex[:12]}"
        self._closed, self._clean = False, True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue one call whose answer nobody will ask for again."""
        return self.submit_keyed(uuid.uuid4().hex, functools.partial(fn, **kwargs) if kwargs else fn, *args)

    def submit_keyed(self, key: str, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Queue one call; an answer that an earlier process did not live to take is taken instead."""
        if self._closed:
            raise RuntimeError("the executor is shut down: no new jobs")
        future: Future[Any] = Future()
        name = digest([getattr(fn, "__name__", "call"), key])
        if not self._take(name, future, old=True):
            self._asked.put((name, future, (fn, *map(self._there, args))))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Hand in no more; with `cancel_futures` what runs is cancelled."""
        if not self._closed:
            self._closed = True
            if cancel_futures:
                self._stop.set()
            self._asked.put(None)
        if wait:
            self._thread.join()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._clean = self._clean and kind is None
        self.shutdown(cancel_futures=kind is not None)

    def forget(self) -> None:
        """Remove the answers that were taken over, when they are stored, and what jobs have left that went well."""
        for path in self._taken:
            path.unlink(missing_ok=True)
        if self._clean:
            shutil.rmtree(self._session, ignore_errors=True)

    def _there(self, argument: Any) -> Any:
        """An argument as the jobs see it: files of a case lie in the common folder."""
        if not isinstance(argument, Case) or not argument.artefacts:
            return argument
        objects = own_folder(disk.folder(self._folder)) / "objects"
        for sha, path in artefacts_by_hash(argument).items():
            keep_artefact(objects, sha, path.read_bytes())
        return dataclasses.replace(argument, objects=str(objects))

    def _serve(self) -> None:
        """Life of the one thread: gathers calls into arrays, takes answers, notices jobs that are gone."""
        backlog: list[tuple[str, Future[Any], tuple[Any, ...]]] = []
        running: list[_Element] = []
        more = True
        while (more or backlog or running) and not self._stop.is_set():
            more = self._gather(backlog, wait_s=POLLING_S) and more
            # an array is held back by SLURM itself, processes of this machine by nobody else
            room = self._most - len(running) if self._settings.here else MAX_ARRAY_ELEMENTS
            if backlog and room > 0:
                most = room * self._settings.runs_per_job
                running += self._hand_in(backlog[:most])
                del backlog[:most]
            running = [e for e in running if not self._ended(e)]
        for element in running:
            with contextlib.suppress(Exception):  # it may have ended by now
                element.job.cancel(check=False)
        for element in running:
            for name, future in element.calls.items():
                self._take(name, future) or future.cancel()
        for _, future, _ in backlog:
            future.cancel()

    def _gather(self, backlog: list[Any], wait_s: float) -> bool:
        """Calls that are waiting, and those that follow closely; whether there may come more."""
        try:
            while (item := self._asked.get(timeout=wait_s)) is not None:
                backlog.append(item)
                wait_s = GATHERING_S
            return False
        except queue.Empty:
            return True

    def _hand_in(self, calls: Sequence[tuple[str, Future[Any], tuple[Any, ...]]]) -> list[_Element]:
        """One array; where it is refused, the futures say why."""
        step = self._settings.runs_per_job
        shares = [calls[k : k + step] for k in range(0, len(calls), step)]
        place = str(self._folder / "answers")
        work = [functools.partial(_compute, self.source, self._timeout_s, place, _named(share)) for share in shares]
        try:
            self._array = self._array or self._opened()
            jobs = self._array.submit_array(work)
        except Exception as error:  # whatever the command sbatch says
            broken = WorkersCannotStart(f"SLURM takes no jobs: {type(error).__name__}: {error}")
            for _, future, _ in calls:
                _settle(future, broken)
            return []
        return [_Element(j, {n: f for n, f, _ in s}) for j, s in zip(jobs, shares, strict=True)]

    def _opened(self) -> Any:
        """Submitit's executor in a folder of this session: its calls are pickled, and only ours are read."""
        import submitit

        for place in (self._folder, self._folder / "answers", self._session):
            own_folder(disk.folder(place.parent) / place.name)
        array = (submitit.LocalExecutor if self._settings.here else submitit.SlurmExecutor)(self._session)
        array.update_parameters(**_parameters(self._settings, self._most))
        return array

    def _ended(self, element: _Element) -> bool:
        """Whether all calls of a job have their answer, or will have none."""
        element.calls = {n: f for n, f in element.calls.items() if not self._take(n, f)}
        if not element.calls:
            return True
        if element.gone is None:
            if element.job.done():
                element.gone = time.monotonic()
            return False
        state = str(element.job.state)
        late = LATE_ANSWER_S if state in ("COMPLETED", "COMPLETING") else LOST_ANSWER_S
        if time.monotonic() - element.gone < late:
            return False
        self._clean = False
        log = element.job.paths.stderr
        what = f"job {element.job.job_id} ended ({state}) before it had an answer of this run; its log is {log}"
        for future in element.calls.values():
            _settle(future, WorkerDied(f"{what}\n{tail(end_of(log), N_LOG_LINES)}"))
        return True

    def _take(self, name: str, future: Future[Any], *, old: bool = False) -> bool:
        """Give a future its answer if there is one; that of a crash is removed, and an `old` one does not count."""
        path = self._folder / "answers" / f"{name}.json"
        try:
            answer = decoded(disk.read_json(path))
        except FileNotFoundError:
            return False
        except (OSError, ValueError, KeyError, TypeError):  # not one of ours: computed again
            path.unlink(missing_ok=True)
            return False
        if isinstance(answer, Exception):
            self._clean = False
            path.unlink(missing_ok=True)
            if old:
                return False
        else:
            self._taken.append(path)
        _settle(future, answer)
        return True


def _named(calls: Sequence[tuple[str, Future[Any], tuple[Any, ...]]]) -> list[tuple[str, tuple[Any, ...]]]:
    return [(name, call) for name, _, call in calls]


def _settle(future: Future[Any], answer: Any) -> None:
    """Result or exception of a future that nobody has cancelled."""
    if not future.set_running_or_notify_cancel():
        return
    if isinstance(answer, Exception):
        future.set_exception(answer)
    else:
        future.set_result(answer)


def _compute(
    source: Source, timeout_s: float | None, answers: str, calls: Sequence[tuple[str, tuple[Any, ...]]]
) -> None:
    """In a job: each call in a process apart, one after another, its answer written when it is there."""
    from submitit.core.utils import UncompletedJobError

    with WorkerPool(1, source=source, timeout_s=timeout_s) as pool:
        for name, (fn, *args) in calls:
            path = Path(answers) / f"{name}.json"
            if path.exists():  # a job of an earlier process was faster
                continue
            try:
                answer = encoded(pool.submit(fn, *args).result())
            except UncompletedJobError:  # the job's own time is over: no run is to blame, and none to begin
                raise
            except Exception as error:
                kind = "broken" if isinstance(error, WorkersCannotStart) else "crashed"
                text = "".join(traceback.format_exception(error))
                answer = {"state": kind, "reason": f"{type(error).__name__}: {error}\n{text}"}
            disk.replace(path, json.dumps(answer))


def encoded(ended: Ended) -> dict[str, Any]:
    """What a worker returned, as data of JSON; doubles keep their bits.  TypeError for anything but an Ended."""
    if not isinstance(ended, Ended):
        raise TypeError(f"a job of SLURM answers runs and artefacts, not {type(ended).__name__}")
    cost, found = {"wall_s": ended.wall_s, "cpu_s": ended.cpu_s}, ended.result
    if isinstance(found, Response):
        return {"state": "done", "response": found.to_json(), **cost}
    if isinstance(found, SimulationFailed):
        partial = None if found.partial is None else found.partial.to_json()
        head = {"state": "failed", "cause": found.cause, "reason": found.reason}
        return {**head, "partial": partial, "history": plain(found.history), **cost}
    return {"state": "made", "content": base64.b64encode(found).decode(), **cost}


def decoded(data: Mapping[str, Any]) -> Ended | Exception:
    """The inverse of :func:`encoded`, and the reason of a crash; ValueError, KeyError or TypeError for other data."""
    state = data["state"]
    if state == "crashed":
        return WorkerDied(str(data["reason"]))
    if state == "broken":
        return WorkersCannotStart(str(data["reason"]))
    result: Any
    if state == "done":
        result = Response.from_json(data["response"])
    elif state == "failed":
        partial = None if data["partial"] is None else Response.from_json(data["partial"])
        result = SimulationFailed(data["cause"], data["reason"], partial, tuple(data["history"]))
    elif state == "made":
        result = base64.b64decode(data["content"], validate=True)
    else:
        raise ValueError(f"unknown state {state!r}")
    return Ended(result, float(data["wall_s"]), float(data["cpu_s"]))


@contextmanager
def open_slurm(
    folder: Path, jobs: int, settings: ArraySettings, source: Source, timeout_s: float | None = None
) -> Iterator[SlurmExecutor]:
    """Executor of job arrays with at most `jobs` elements of each at a time; calls and answers lie in `folder`.

    WorkersCannotStart where submitit is not installed or there is no SLURM; where sbatch refuses, futures get it.
    """
    if importlib.util.find_spec("submitit") is None:
        raise WorkersCannotStart("engine = 'slurm' needs submitit: pip install 'rso[slurm]'")
    if not settings.here and shutil.which("sbatch") is None:
        raise WorkersCannotStart(
            "engine = 'slurm': there is no command sbatch here; slurm.here = true tries it without"
        )
    with SlurmExecutor(folder, source, timeout_s, settings, jobs) as executor:
        yield executor
    executor.forget()


def _parameters(settings: ArraySettings, jobs: int) -> dict[str, Any]:
    """Words of submitit's executors."""
    if settings.here:
        return {"timeout_min": settings.minutes, "setup": list(settings.setup), "signal_delay_s": 5}
    words = {
        "time": math.ceil(settings.minutes),
        "partition": settings.partition,
        "account": settings.account,
        "qos": settings.qos,
        "mem": None if settings.memory_gb is None else f"{max(1, round(settings.memory_gb * 1024))}M",
        "setup": list(settings.setup) or None,
        "additional_parameters": dict(settings.options) or None,
    }
    own_words = {"job_name": "rso", "cpus_per_task": 1, "array_parallelism": jobs}
    return {**own_words, **{k: v for k, v in words.items() if v is not None}}
