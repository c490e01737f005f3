import dataclasses
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import dummy_backend as dummy
import numpy as np
import pytest

from rso.contract import Case, Programme, SimulationFailed, run_key
from rso.evaluation import (
    Crashed,
    Done,
    Evaluator,
    Failed,
    Finished,
    Planned,
    Preparing,
    Retried,
    Source,
    Task,
    WorkerDied,
    WorkerPool,
    WorkersCannotStart,
    begin_ahead,
    load_backend,
    run_all,
)
from rso.evaluation.store import RunStore

HERE = Path(__file__).parent
SOURCE = Source(use="dummy_backend:BACKEND", base=str(HERE))


class InlineExecutor(Executor):
    """Computes in `submit`; the simplest thing that is an executor."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def task(x=1.0, name="case", asked=(0.5, 1.0), lag=None, **settings):
    values = {"x": x} if lag is None else {"x": x, "lag": lag}
    return Task(values, Case(name, Programme.ramp(asked), settings))


def run(folder, tasks, executor=None, backend=dummy.BACKEND, **options):
    with RunStore(folder) as store:
        return run_all(backend, tasks, store, executor or InlineExecutor(), **options)


def bits(outcomes):
    """Everything that is a result, as text that shows every bit; times and paths are none."""
    return [
        (o.key, o.values, o.case.name, type(o).__name__, o.response.to_json() if isinstance(o, Done) else o.reason)
        for o in outcomes
    ]


# ---------------------------------------------------------------------------------------------- run_all


def test_order_of_tasks_whatever_the_order_of_completion(tmp_path):
    tasks = [task(x, sleep_s=0.2 if x == 0 else 0.0) for x in range(6)]
    with ThreadPoolExecutor(3) as pool:
        outcomes = run(tmp_path, tasks, pool)
    assert [o.values["x"] for o in outcomes] == list(range(6))
    for o in outcomes:  # the dummy's law written once more
        u = np.array([0.5, 1.0])
        np.testing.assert_array_equal(o.response.channels["Fz"], np.sin(o.values["x"]) * u / 3.0)


def test_same_bits_for_any_executor_fresh_or_stored(tmp_path):
    tasks = [task(x, do="fail" if x == 2 else "", mesh=f"fine@{tmp_path}/log") for x in range(5)]
    reference = run(tmp_path / "inline", tasks)
    assert [type(o) for o in reference] == [Done, Done, Failed, Done, Done]
    stored = run(tmp_path / "inline", tasks)
    assert bits(stored) == bits(reference)
    assert stored[0].response.info == reference[0].response.info  # not even a tuple that became a list
    executors = {
        "one": WorkerPool(1, source=SOURCE),
        "two": WorkerPool(2, source=SOURCE),
        "pickled": WorkerPool(1),
        "standard": ProcessPoolExecutor(1),
    }
    for name, executor in executors.items():
        with executor:
            assert bits(run(tmp_path / name, tasks, executor)) == bits(reference), name


def test_equal_runs_are_computed_once_and_stored_ones_not_at_all(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(1, "a", log=log), task(1.0, "b", log=log, lag=0.0), task(2, "c", log=log)]
    events = []
    outcomes = run(tmp_path, tasks, watch=events.append)
    assert [o.case.name for o in outcomes] == ["a", "b", "c"]
    assert outcomes[0].key == outcomes[1].key != outcomes[2].key
    assert events[0] == Planned(3, 2, 0)
    assert [(e.name, e.state, e.n_done, e.n_runs) for e in events[1:]] == [("a", "done", 1, 2), ("c", "done", 2, 2)]
    assert dummy.calls(log, "begin") == 2
    again = []
    assert bits(run(tmp_path, [*tasks, task(3, "d", log=log)], watch=again.append)[:3]) == bits(outcomes)
    assert again[0] == Planned(4, 3, 2)
    assert dummy.calls(log, "begin") == 3


def test_a_failure_is_a_result_and_keeps_what_it_knows(tmp_path):
    log = str(tmp_path / "log")
    with WorkerPool(1, source=SOURCE) as pool:
        (first,) = run(tmp_path, [task(do="fail", log=log)], pool)
    (second,) = run(tmp_path, [task(do="fail", log=log)])
    assert dummy.calls(log, "begin") == 1  # not tried again
    for outcome in (first, second):
        assert isinstance(outcome, Failed)
        assert (outcome.cause, outcome.reason) == ("step_limit", "too soft")
        assert outcome.history == ({"step": 1, "residual": 0.1},)
        np.testing.assert_array_equal(outcome.partial.channels["travel"], [0.5, 1.0])


def test_a_run_that_had_too_little_time_is_no_failure_and_tried_again_next_time(tmp_path):
    """A slow machine had written down for good, and learned from, that there is no answer."""
    log = str(tmp_path / "log")
    for count in (1, 2):
        (outcome,) = run(tmp_path, [task(do="late", log=log)], retries=2)
        assert isinstance(outcome, Crashed) and "time_limit: the time of the run is used up" in outcome.reason
        assert dummy.calls(log, "begin") == count  # at once it would be as slow


def test_a_crash_is_retried_now_and_next_time(tmp_path):
    log = str(tmp_path / "log")
    events = []
    (outcome,) = run(tmp_path, [task(do="crash", log=log)], retries=2, watch=events.append)
    assert isinstance(outcome, Crashed) and outcome.attempts == 3
    assert outcome.reason.startswith("ZeroDivisionError: a bug\nTraceback")
    assert [type(e) for e in events] == [Planned, Retried, Retried, Finished]
    assert dummy.calls(log, "begin") == 3
    run(tmp_path, [task(do="crash", log=log)], retries=0)
    assert dummy.calls(log, "begin") == 4
    with RunStore(tmp_path, read_only=True) as store:
        assert [(r.state, r.attempts) for r in store.rows()] == [("crashed", 4)]


def test_a_crash_that_does_not_return_is_done(tmp_path):
    (outcome,) = run(tmp_path, [task(do="crash once", log=str(tmp_path / "log"))])
    assert isinstance(outcome, Done)
    with RunStore(tmp_path, read_only=True) as store:
        assert [(r.state, r.attempts) for r in store.rows()] == [("done", 2)]


def test_an_answer_that_is_none_is_a_crash(tmp_path):
    @dataclasses.dataclass(frozen=True)
    class Silent(dummy.Dummy):
        def __call__(self, values, case):
            return {"Fz": 0.0}

    with RunStore(tmp_path) as store:
        (outcome,) = run_all(Silent(), [task()], store, InlineExecutor(), retries=0)
    assert outcome.reason.splitlines()[0] == "TypeError: dummy returned dict, must be a Response"


@pytest.mark.parametrize(("unit", "why"), [("um", "uz(3,4) in um, it must be in mm"), ("mm", ""), ("millimetre", "")])
def test_a_mark_in_another_unit_is_a_crash(tmp_path, unit, why):
    """Marks are declared nowhere: what one is compared with is in mm, and nothing converts it."""

    @dataclasses.dataclass(frozen=True)
    class Marked(dummy.Dummy):
        def __call__(self, values, case):
            r = super().__call__(values, case)
            marks = {**r.channels, "uz(3,4)": r.channels["travel"]}
            return dataclasses.replace(r, channels=marks, units={**r.units, "uz(3,4)": unit})

    with RunStore(tmp_path) as store:
        (outcome,) = run_all(Marked(), [task()], store, InlineExecutor(), retries=0)
    assert why in outcome.reason if why else isinstance(outcome, Done)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (task(2e6), r"task 'case': x = 2000000.0 1 is outside its hard bounds"),
        (Task({"x": 1.0, "z": 1.0}, task().case), "unknown parameter z; this backend has x, lag"),
        (Task({}, task().case), "no value for x"),
        (task(colour="red"), "unknown settings"),
    ],
)
def test_misuse_is_found_before_anything_runs(tmp_path, wrong, message):
    with pytest.raises(ValueError, match=message):
        run(tmp_path, [task(log=str(tmp_path / "log")), wrong])
    assert not (tmp_path / "log").exists()


def test_artefacts_are_made_once_and_enter_the_key(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(x, mesh=f"{mesh}@{log}") for mesh in ("fine", "coarse") for x in (1, 2)]
    events = []
    outcomes = run(tmp_path, tasks, watch=events.append)
    assert events[0] == Preparing(2)
    assert [o.response.info["mesh"] for o in outcomes] == ["fine", "fine", "coarse", "coarse"]
    assert len({o.key for o in outcomes}) == 4
    assert bits(run(tmp_path, tasks)) == bits(outcomes)
    assert (dummy.calls(log, "make fine"), dummy.calls(log, "make coarse")) == (1, 1)
    mesh = outcomes[0].case.artefact("mesh")
    mesh.unlink()  # made again when missing
    assert bits(run(tmp_path, tasks)) == bits(outcomes)
    assert mesh.read_text() == "fine" and dummy.calls(log, "make fine") == 2


def test_artefact_that_cannot_be_made(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(x, mesh=f"{mesh}@{log}") for mesh in ("impossible", "fine", "buggy") for x in (1, 2)]
    for n_impossible, n_buggy in ((1, 2), (1, 4)):  # a failure is not tried again, a crash is, each with one retry
        outcomes = run(tmp_path, tasks)
        assert [type(o) for o in outcomes] == [Failed, Failed, Done, Done, Crashed, Crashed]
        assert (outcomes[0].cause, outcomes[0].reason) == ("bad_geometry", "no such body")
        assert outcomes[4].reason.startswith("mesh could not be made: ZeroDivisionError: a bug in the mesher")
        assert (dummy.calls(log, "make impossible"), dummy.calls(log, "make buggy")) == (n_impossible, n_buggy)


def test_each_result_is_stored_as_it_arrives(tmp_path):
    log, seen = str(tmp_path / "log"), []

    def watch(event):
        if isinstance(event, Finished):
            with RunStore(tmp_path, read_only=True) as store:
                seen.append((dummy.calls(log, "begin"), len(store.rows())))

    run(tmp_path, [task(x, log=log) for x in range(3)], watch=watch)
    assert seen == [(1, 1), (2, 2), (3, 3)]


class Interrupted(InlineExecutor):
    """Ctrl-C while the third task is handed over; the first two have finished."""

    n = 0

    def submit(self, fn, /, *args, **kwargs):
        self.n += 1
        if self.n == 3:
            raise KeyboardInterrupt
        return super().submit(fn, *args, **kwargs)


def test_interrupt_keeps_what_is_finished(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(x, log=log) for x in range(4)]
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, tasks, Interrupted())
    events = []
    run(tmp_path, tasks, watch=events.append)
    assert events[0] == Planned(4, 4, 2)
    assert dummy.calls(log, "end") == 4


def test_interrupt_of_watch_keeps_what_arrives_together(tmp_path):
    def watch(event):
        if isinstance(event, Finished):
            time.sleep(0.3)  # meanwhile the others finish too
            raise KeyboardInterrupt

    tasks = [task(x, sleep_s=0.1) for x in range(4)]
    with ThreadPoolExecutor(4) as pool, pytest.raises(KeyboardInterrupt):
        run(tmp_path, tasks, pool, watch=watch)
    events = []
    run(tmp_path, tasks, watch=events.append)
    assert events[0] == Planned(4, 4, 4)


# ---------------------------------------------------------------------------------------------- WorkerPool


# ------------------------------------------------------------------------------------------------------ begun ahead


def test_what_was_begun_is_taken_over_not_computed_again(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(float(x), log=log, mesh=f"m{x % 2}@{log}") for x in range(4)]
    ahead = {}
    with RunStore(tmp_path / "a") as store, WorkerPool(2, source=SOURCE) as pool:
        begin_ahead(dummy.BACKEND, tasks, store, pool, ahead)
        until(lambda: all(f.done() for f in ahead.values()))
        assert dummy.calls(log, "make") == 2 and dummy.calls(log, "begin") == 0  # artefacts come first
        begin_ahead(dummy.BACKEND, tasks, store, pool, ahead)
        begin_ahead(dummy.BACKEND, tasks, store, pool, ahead)  # once more changes nothing
        until(lambda: dummy.calls(log, "end") == 4)
        found = run_all(dummy.BACKEND, tasks, store, pool, ahead=ahead)
        assert not ahead
    assert dummy.calls(log, "make") == 2 and dummy.calls(log, "begin") == 4
    alone = run(tmp_path / "b", tasks)
    assert [(o.key, o.response.to_json()) for o in found] == [(o.key, o.response.to_json()) for o in alone]


def test_executors_that_are_no_pool_begin_nothing(tmp_path):
    log, ahead = str(tmp_path / "log"), {}
    with RunStore(tmp_path / "a") as store:
        begin_ahead(dummy.BACKEND, [task(log=log)], store, InlineExecutor(), ahead)
    assert not ahead and dummy.calls(log, "begin") == 0


def test_a_crash_of_what_was_begun_is_retried(tmp_path):
    log, ahead = str(tmp_path / "log"), {}
    wanted = [task(1.0, log=log, do="crash once"), task(2.0, log=log, do="kill"), task(3.0, log=log, do="fail")]
    with RunStore(tmp_path / "a") as store, WorkerPool(2, source=SOURCE) as pool:
        begin_ahead(dummy.BACKEND, wanted, store, pool, ahead)
        found = run_all(dummy.BACKEND, wanted, store, pool, ahead=ahead)
    assert [type(o) for o in found] == [Done, Crashed, Failed] and dummy.calls(log, "begin 1 ") == 2


def test_a_run_does_not_wait_for_the_artefacts_of_others(tmp_path):
    log = str(tmp_path / "log")
    tasks = [task(1.0, log=log, mesh=f"slow@{log}"), task(2.0, log=log, mesh=f"quick@{log}")]
    with RunStore(tmp_path / "a") as store, WorkerPool(2, source=SOURCE) as pool:
        assert all(isinstance(o, Done) for o in run_all(dummy.BACKEND, tasks, store, pool))
    lines = Path(log).read_text().splitlines()
    assert lines.index("end 2") < lines.index("made slow")


def test_a_warm_pool_starts_before_its_first_task():
    with WorkerPool(2, source=SOURCE, warm=True) as pool:
        until(lambda: len(pool._alive) == min(2, os.cpu_count()))
        assert pool.submit(dummy.square, 3.0).result() == 9.0
    with WorkerPool(1, source=Source(use="no_such_module:BACKEND"), warm=True) as pool:
        with pytest.raises(WorkersCannotStart, match="no_such_module"):
            pool.submit(dummy.square, 3.0).result()


@pytest.mark.parametrize("warm", [False, True])
def test_whoever_asks_for_thousands_of_workers_gets_what_there_is_work_for(warm):
    before = threading.active_count()
    with WorkerPool(10_000, warm=warm) as pool:
        assert threading.active_count() - before <= os.cpu_count() * warm
        assert pool.submit(dummy.square, 3.0).result() == 9.0
        assert len(pool._alive) <= max(1, os.cpu_count() * warm + 1)


def test_fewer_threads_than_asked_do_the_work_and_none_is_said(monkeypatch):
    start, left = threading.Thread.start, [2]

    def limited(thread):
        if left[0] == 0:
            raise RuntimeError("can't start new thread")
        left[0] -= 1
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", limited)
    with WorkerPool(4) as pool:
        assert [f.result() for f in [pool.submit(dummy.square, float(k)) for k in range(4)]] == [0.0, 1.0, 4.0, 9.0]
    with WorkerPool(4) as pool, pytest.raises(WorkersCannotStart, match="can't start new thread"):
        pool.submit(dummy.square, 1.0)


def test_other_work_of_a_study_outlives_the_workers(tmp_path):
    with RunStore(tmp_path) as store, WorkerPool(2, source=SOURCE) as pool:
        evaluator = Evaluator(dummy.BACKEND, store, pool)
        assert evaluator.each(dummy.square, [1.0, 2.0, 3.0]) == [1.0, 4.0, 9.0]
        assert evaluator.each(dummy.die_elsewhere, [(os.getpid(), 5)]) == [5]


def until(true, seconds=60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_workers_are_pinned_and_separate():
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    with WorkerPool(2) as pool:
        assert pool.submit(dummy.environment, names).result() == dict.fromkeys(names, "1")
        pids = {f.result() for f in [pool.submit(dummy.sleep, 0.3) for _ in range(4)]}
        assert list(pool.map(dummy.square, [1.0, 2.0, 3.0])) == [1.0, 4.0, 9.0]
    assert len(pids) == 2 and os.getpid() not in pids
    assert not any(alive(pid) for pid in pids)


def test_exceptions_travel():
    with WorkerPool(1) as pool:
        with pytest.raises(SimulationFailed, match="contact: lost") as failure:
            pool.submit(dummy.fail, "lost").result()
        assert failure.value.cause == "contact" and failure.value.partial.channels["travel"] == [0.1]
        assert "in fail" in str(failure.value.__cause__)  # the worker's traceback
        with pytest.raises(RuntimeError, match="Twisted: only one"):
            pool.submit(dummy.twist).result()
        with pytest.raises(RuntimeError, match=r"SystemExit\(3\)"):
            pool.submit(dummy.leave).result()
        with pytest.raises(Exception, match="pickle"):
            pool.submit(dummy.unpicklable).result()
        assert pool.submit(dummy.square, 3.0).result() == 9.0  # after all that


def test_a_killed_worker_costs_one_run(tmp_path):
    tasks = [task(x, sleep_s=0.05, do="kill" if x == 2 else "exit" if x == 4 else "") for x in range(7)]
    with WorkerPool(2, source=SOURCE) as pool:
        outcomes = run(tmp_path, tasks, pool, retries=0)
    assert [type(o) for o in outcomes] == [Done, Done, Crashed, Done, Crashed, Done, Done]
    assert "ended by signal SIGKILL while it computed" in outcomes[2].reason
    assert "ended with exit code 7 while it computed" in outcomes[4].reason


def test_a_worker_killed_from_outside_costs_one_run(tmp_path):
    with WorkerPool(2) as pool:
        futures = [pool.submit(dummy.sleep, 0.6) for _ in range(2)]
        others = [pool.submit(dummy.square, float(i)) for i in range(5)]
        time.sleep(0.3)
        next(iter(pool._alive)).send_signal(signal.SIGKILL)
        errors = [f.exception() for f in futures]
        assert [e is None for e in errors].count(False) == 1
        assert isinstance(next(e for e in errors if e), WorkerDied)
        assert [f.result() for f in others] == [0.0, 1.0, 4.0, 9.0, 16.0]
        for process in list(pool._alive):  # killed while idle: costs nothing
            process.kill()
            process.wait()
        assert [pool.submit(dummy.square, 2.0).result() for _ in range(3)] == [4.0] * 3


def test_time_out_kills_and_respawns():
    with WorkerPool(1, timeout_s=0.5) as pool:
        before = pool.submit(dummy.sleep, 0.0).result()
        start = time.monotonic()
        with pytest.raises(WorkerDied, match=r"stopped after the time-out of 0.5 s"):
            pool.submit(dummy.sleep, 60.0).result()
        assert time.monotonic() - start < 5.0
        assert not alive(before)
        assert pool.submit(dummy.sleep, 0.0).result() != before


def test_leaving_by_an_exception_kills_what_runs():
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), WorkerPool(1) as pool:
        running, waiting = pool.submit(dummy.sleep, 60.0), pool.submit(dummy.sleep, 60.0)
        while not running.running():
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert time.monotonic() - start < 10.0
    assert isinstance(running.exception(), WorkerDied) and waiting.cancelled()
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(dummy.square, 1.0)


@pytest.mark.parametrize("use", ["no_such_module:BACKEND", "dummy_backend:NOTHING"])
def test_workers_that_cannot_start_say_so_once(tmp_path, use):
    with WorkerPool(2, source=Source(use=use, base=str(HERE))) as pool:
        with pytest.raises(WorkersCannotStart, match=r"a worker process cannot start: ValueError: backend: .*" + use):
            run(tmp_path, [task(x) for x in range(5)], pool)
        with pytest.raises(WorkersCannotStart):
            pool.submit(dummy.square, 1.0)


@pytest.mark.parametrize("n_deaths", [1, 100])
def test_workers_that_die_on_the_way(tmp_path, n_deaths):
    """One death is bad luck and costs one try; when nobody arrives, the pool gives up instead of trying forever."""
    (tmp_path / f"deadly_{n_deaths}.py").write_text(
        textwrap.dedent(
            f"""
            import os, signal
            from dummy_backend import BACKEND, calls, note
            log = {str(tmp_path / "starts")!r}
            note(log, "start")
            if calls(log, "start") <= {n_deaths}:
                os.kill(os.getpid(), signal.SIGKILL)
            """
        )
    )
    source = Source(use=f"deadly_{n_deaths}:BACKEND", base=str(tmp_path))
    with WorkerPool(1, source=source) as pool:
        if n_deaths == 1:
            assert all(isinstance(o, Done) for o in run(tmp_path, [task(x) for x in range(3)], pool))
        else:
            with pytest.raises(WorkersCannotStart, match=r"cannot start: WorkerDied: .* by signal SIGKILL"):
                run(tmp_path, [task(x) for x in range(10)], pool)
    assert dummy.calls(str(tmp_path / "starts"), "start") == min(n_deaths + 1, 3)


def test_misuse_of_the_pool():
    with pytest.raises(ValueError, match="workers = 0"):
        WorkerPool(0)
    local = type("f", (), {"__module__": "__main__"})
    with WorkerPool(1) as pool, pytest.raises(ValueError, match="__main__"):
        pool.submit(local)


def test_a_script_without_guard(tmp_path):
    """The script runs once: its workers do not import it; what lives in it is refused with a reason."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import sys
            sys.path.insert(0, {str(HERE)!r})
            import dummy_backend as dummy
            from rso.evaluation import WorkerPool
            print("once")
            class Mine:
                pass
            with WorkerPool(1) as pool:
                print(pool.submit(dummy.square, 3.0).result())
                print(pool.submit(dummy.square, Mine()).exception())
            """
        )
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    lines = done.stdout.splitlines()
    assert lines[:2] == ["once", "9.0"] and "must live in an importable module, not in __main__" in lines[2]
    assert (len(lines), done.returncode, done.stderr) == (3, 0, "")


# ---------------------------------------------------------------------------------------------- kill -9 of the parent

STUDY = f"""
import sys
sys.path.insert(0, {str(HERE)!r})
from pathlib import Path
from test_running import SOURCE, killable_tasks
from rso.evaluation import WorkerPool, run_all
from rso.evaluation.store import RunStore
folder = Path(sys.argv[1])
sys.stdin.readline()  # everything is imported: go when told
with RunStore(folder / "results") as store, WorkerPool(2, source=SOURCE) as pool:
    run_all(SOURCE.load(), killable_tasks(folder), store, pool)
"""


def killable_tasks(folder):
    log = str(folder / "log")
    return [task(x, sleep_s=0.08, log=log, mesh=f"fine@{log}", do="fail" if x == 3 else "") for x in range(16)]


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_kill_9_of_the_parent_then_resume(tmp_path):
    rng, finished = np.random.default_rng(5), 0
    for i in range(6):
        n_log = len(log_lines(tmp_path, "begin"))
        with subprocess.Popen([sys.executable, "-c", STUDY, str(tmp_path)], stdin=subprocess.DEVNULL) as parent:
            while i % 2 and parent.poll() is None and len(log_lines(tmp_path, "begin")) == n_log:
                time.sleep(0.01)  # every other time: not before it computes
            time.sleep(rng.uniform(0.0, 0.4))
            parent.kill()
        pids = {int(line.split()[2]) for line in log_lines(tmp_path, "begin")}
        deadline = time.monotonic() + 3.0
        while any(map(alive, pids)) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not any(map(alive, pids))  # no orphans
        with RunStore(tmp_path / "results") as store:
            rows = store.rows()
        assert len(rows) >= finished and not any(r.state == "crashed" for r in rows)
        finished = len(rows)
    before = {r.values["x"] for r in rows}
    n_log = len(log_lines(tmp_path, "begin"))
    again = SOURCE.load()  # as in the script: with its fingerprint
    with WorkerPool(2, source=SOURCE) as pool:
        resumed = run(tmp_path / "results", killable_tasks(tmp_path), pool, backend=again)
    repeated = {float(line.split()[1]) for line in log_lines(tmp_path, "begin")[n_log:]}
    assert repeated == set(range(16)) - before  # what was stored is not repeated, the rest is computed
    assert 0 < finished
    assert dummy.calls(str(tmp_path / "log"), "make") <= 7
    (tmp_path / "in one go").mkdir()
    reference = run(tmp_path / "in one go", killable_tasks(tmp_path), backend=again)
    assert bits(resumed) == bits(reference)


def log_lines(folder, beginning):
    path = folder / "log"
    return [li for li in path.read_text().splitlines() if li.startswith(beginning)] if path.exists() else []


def test_two_parents_at_once(tmp_path):
    command = [sys.executable, "-c", STUDY, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as first, subprocess.Popen(command, **pipes) as second:
        first.stdin.write("go\n")
        first.stdin.flush()
        while not log_lines(tmp_path, "begin"):
            time.sleep(0.01)
        _, said = second.communicate("go\n", timeout=60)
        assert second.returncode != 0
        assert f"StoreError: {tmp_path / 'results'} is in use by process {first.pid}" in said
        assert first.wait() == 0
    assert len(log_lines(tmp_path, "begin")) == 16


# ---------------------------------------------------------------------------------------------- adapters


def test_load_python_object():
    loaded = load_backend("dummy_backend:BACKEND", base=HERE)
    assert loaded == dummy.BACKEND and loaded.fingerprint and not hasattr(dummy.BACKEND, "fingerprint")
    assert SOURCE.load() == dummy.BACKEND
    assert pickle.loads(pickle.dumps(SOURCE)) == SOURCE


@pytest.mark.parametrize(
    ("use", "message"),
    [
        ("dummy_backend", "must read"),
        ("no_such_module:BACKEND", "cannot import module 'no_such_module'"),
        ("dummy_backend:NOTHING", r"module 'dummy_backend' .* has no 'NOTHING'"),
        ("dummy_backend:Dummy", "is a class"),
        ("dummy_backend:note", r"is a plain function; @rso\.model.* makes it one$"),
    ],
)
def test_load_python_object_that_is_none(use, message):
    with pytest.raises(ValueError, match=message):
        load_backend(use)


def test_load_needs_exactly_one():
    for arguments in ((None, None), ("a:B", ["c"])):
        with pytest.raises(ValueError, match="either use or command"):
            load_backend(*arguments)


PROGRAM = """
import json, subprocess, sys, time
if sys.argv[-1] == "--schema":
    print(json.dumps({
        "name": "program", "numerics": 3, "channels": {"time": "s", "travel": "mm", "Fz": "N"}, "more": [],
        "parameters": [
            {"name": "x", "description": "force", "unit": "N", "low": 0, "high": 10},
            {"name": "lag", "description": "an effect", "unit": "1", "low": 0, "high": 1, "default": 0, "neutral": 0},
        ],
    }))
    sys.exit()
request = json.load(open(sys.argv[1]))
do = request["case"]["settings"].get("do", "")
a = request["case"]["programme"]["asked_mm"]
channels = {"time": a, "travel": a, "Fz": [request["values"]["x"] + request["values"]["lag"] for _ in a]}
done = {"status": "done", "channels": channels, "units": {"time": "s", "travel": "mm", "Fz": "N"}}
failed = {"status": "failed", "cause": "contact", "reason": "lost", "history": [{"step": 1}]}
open("scratch.txt", "w").close()  # programs litter their working directory
if do == "silent":
    print("licence server not found", file=sys.stderr)
    sys.exit(4)
if do == "sleep":
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    open(request["case"]["settings"]["pid"], "w").write(str(child.pid))
    time.sleep(60)
answers = {
    "": done, "fail": failed, "fail far": {**failed, **done, "status": "failed"}, "done but 1": done,
    "nan": {**done, "channels": {**channels, "Fz": [float("nan")] * len(a)}},
    "short error": {**done, "error": {"Fz": [0.1] * (len(a) + 1)}},
    "negative error": {**done, "error": {"Fz": [-0.1] * len(a)}},
    "error of nothing": {**done, "error": {"Fq": 0.1}},
    "short gradient": {**done, "gradients": {"x": {"Fz": [1.0]}}},
    "gradient by nothing": {**done, "gradients": {"y": {"Fz": [1.0] * len(a)}}},
    "gradient of nothing": {**done, "gradients": {"x": {"Fq": [1.0] * len(a)}}},
    "huge": {**done, "channels": {**channels, "Fz": [10**400] * len(a)}},
    "strange": {"status": "perhaps"}, "cause": {**failed, "cause": "mood"}, "units": {**done, "units": {}}, "list": [],
}
odd = {"half": "{", "nested": 100_000 * "["}
open(sys.argv[2], "w").write(odd[do] if do in odd else json.dumps(answers[do]))
sys.exit(1 if do in ("fail", "done but 1") else 0)
"""


@pytest.fixture
def program(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    return [sys.executable, "program.py"]


def call(program, tmp_path, timeout_s=None, **settings):
    backend = load_backend(command=program, base=tmp_path, keep_folder=tmp_path / "work", timeout_s=timeout_s)
    return backend({"x": 2.0}, Case("c", Programme.ramp((0.5, 1.0)), settings))


def test_command_done_leaves_nothing_behind(program, tmp_path):
    response = call(program, tmp_path)
    np.testing.assert_array_equal(response.channels["Fz"], [2.0, 2.0])
    assert list((tmp_path / "work").iterdir()) == []
    assert not Path("scratch.txt").exists() and not (tmp_path / "scratch.txt").exists()


def test_command_schema(program, tmp_path):
    backend = load_backend(command=program, base=tmp_path)
    assert (backend.name, backend.numerics, backend.channels["Fz"]) == ("program", 3, "N")
    assert [p.name for p in backend.parameters] == ["x", "lag"] and backend.parameters[1].neutral == 0
    case = task().case
    assert backend.canonical({"x": 1.0, "lag": 0.0}, case) == ({"x": 1.0}, case)
    assert backend.recipes({}, case) == {}
    with pytest.raises(ValueError, match=r"x = 11.0 N is outside"):
        backend({"x": 11.0}, case)


def key_of(backend):
    return run_key(backend, {"x": 2.0}, task().case)


def test_a_command_that_was_edited_has_other_keys(program, tmp_path):
    """Every word and every file that a word names counts, however often and where it lies; nothing else does."""
    (tmp_path / "deck.inp").write_text("h = 1")
    words = [*program, "--deck", "deck.inp"]

    def key(base=tmp_path, words=words):
        return key_of(load_backend(command=words, base=base))

    before = key()
    (tmp_path / "other.inp").write_text("h = 2")
    shutil.copytree(tmp_path, tmp_path / "elsewhere")
    assert before == key() == key(tmp_path / "elsewhere")
    seen = {before, key(words=[*program, "--fast", "deck.inp"])}
    (tmp_path / "deck.inp").write_text("h = 2")
    seen.add(key())
    (tmp_path / "program.py").write_text(PROGRAM.replace('["x"] +', '["x"] -'))
    seen.add(key())
    assert len(seen) == 4


def test_an_edited_command_answers_anew(program, tmp_path):
    """The same study after an edit of its solver: no stored answer is that of the solver before."""
    found = []
    for text in (PROGRAM, PROGRAM, PROGRAM.replace('["x"] +', '["x"] * 2 +')):
        (tmp_path / "program.py").write_text(text)
        with RunStore(tmp_path / "results") as store:
            backend = load_backend(command=program, base=tmp_path)
            (outcome,) = run_all(backend, [Task({"x": 2.0}, task().case)], store, InlineExecutor())
        found.append((outcome.key, outcome.response.channels["Fz"][0]))
    assert found[0] == found[1] and [F for _, F in found] == [2.0, 2.0, 4.0]


def test_an_edited_module_has_other_keys_and_our_own_has_none(tmp_path):
    text = (HERE / "dummy_backend.py").read_text()
    for name, more in (("same_a", ""), ("same_b", ""), ("edited", "# forces twice as large")):
        (tmp_path / f"{name}.py").write_text(text + more)
    a, b, c = (load_backend(f"{name}:BACKEND", base=tmp_path) for name in ("same_a", "same_b", "edited"))
    assert key_of(a) == key_of(b) != key_of(c)
    own = load_backend("fem_backend.backend:BACKEND"), load_backend(command=[sys.executable, "-m", "fem_backend"])
    assert [getattr(it, "fingerprint", "") for it in own] == ["", ""]
    (tmp_path / "stated.py").write_text(text + "\nobject.__setattr__(BACKEND, 'fingerprint', 'v7')\n")
    assert load_backend("stated:BACKEND", base=tmp_path).fingerprint == "v7"
    (tmp_path / "slotted.py").write_text(text.replace("frozen=True", "frozen=True, slots=True"))
    with pytest.raises(ValueError, match="takes no attribute; let it have one, fingerprint"):
        load_backend("slotted:BACKEND", base=tmp_path)


def test_command_failed_keeps_its_folder(program, tmp_path):
    with pytest.raises(SimulationFailed) as failure:
        call(program, tmp_path, do="fail")
    assert (failure.value.cause, failure.value.reason) == ("contact", "lost")
    assert failure.value.partial is None and failure.value.history == ({"step": 1},)
    (folder,) = (tmp_path / "work").iterdir()
    assert {"request.json", "response.json", "stderr.txt", "scratch.txt"} <= {p.name for p in folder.iterdir()}
    assert json.loads((folder / "request.json").read_text())["values"] == {"x": 2.0, "lag": 0.0}
    with pytest.raises(SimulationFailed) as failure:
        call(program, tmp_path, do="fail far")
    np.testing.assert_array_equal(failure.value.partial.channels["travel"], [0.5, 1.0])


def test_what_a_command_answers_with_nan_fails_and_keeps_the_rest(program, tmp_path):
    with pytest.raises(SimulationFailed, match="'Fz' is nan at travel") as failure:
        call(program, tmp_path, do="nan")
    kept = failure.value.partial
    assert failure.value.cause == "not_finite"
    assert kept is None or np.isfinite(kept.channels["Fz"]).all()


@pytest.mark.parametrize(
    "text", ["Licence 4711 {trial}\n\n{}", "{}\n  {{not JSON\n", '{{"version": 3}}\n{}\nbye', "\ufeffHello\n  {}"]
)
def test_what_a_command_prints_around_its_schema_is_passed_over(tmp_path, text):
    schema = {
        "name": "s",
        "numerics": 1,
        "channels": {"time": "s"},
        "parameters": [{"name": "x", "description": "", "unit": "1", "low": 0.0, "high": 1.0}],
    }
    said = text.replace("{}", json.dumps(schema, indent=1)).replace("{{", "{").replace("}}", "}")
    (tmp_path / "said").write_text(said, encoding="utf-8")
    code = f"print(open({str(tmp_path / 'said')!r}, encoding='utf-8').read())"
    assert load_backend(command=[sys.executable, "-X", "utf8", "-c", code]).name == "s"
    (tmp_path / "said").write_text(said.replace("numerics", "numbers"), encoding="utf-8")
    with pytest.raises(ValueError, match="must print JSON with name, numerics"):
        load_backend(command=[sys.executable, "-X", "utf8", "-c", code])


@pytest.mark.parametrize(
    ("do", "message"),
    [
        ("silent", r"exit code 4, no response file; see .*licence server not found"),
        ("half", "exit code 0, response file not understood .*JSONDecodeError"),
        ("strange", "status = 'perhaps'"),
        ("cause", "unknown cause 'mood'"),
        ("units", "has no unit"),
        ("short error", r"error of 'Fz' has shape \(3,\), expected \(2,\)"),
        ("negative error", "error of 'Fz' must be finite and at least 0, got -0.1 to -0.1"),
        ("error of nothing", "error of 'Fq', which is none of its channels"),
        ("short gradient", r"gradient of 'Fz' by 'x' has shape \(1,\), expected \(2,\)"),
        ("gradient by nothing", "gradients by 'y', which is none of the knobs x, lag"),
        ("gradient of nothing", "gradient of 'Fq' by 'x': there is no such channel"),
        ("huge", "response file not understood .*too large for a number"),
        ("list", "not understood"),
        ("nested", "response file not understood .*RecursionError"),
        ("done but 1", "exit code 1, .*although status = done"),
    ],
)
def test_command_crash(program, tmp_path, do, message):
    with pytest.raises(RuntimeError, match=r"(?s)" + message):
        call(program, tmp_path, do=do)
    assert len(list((tmp_path / "work").iterdir())) == 1


def test_command_time_out_kills_its_children(program, tmp_path):
    pid_file = tmp_path / "pid"
    with pytest.raises(RuntimeError, match=r"stopped after the time-out of 1 s"):
        call(program, tmp_path, timeout_s=1.0, do="sleep", pid=str(pid_file))
    assert_dies(int(pid_file.read_text()))


def test_command_dies_with_a_killed_worker(program, tmp_path):
    """The program is not the worker's to clean up any more: its guard sees that the worker is gone."""
    pid_file = tmp_path / "pid"
    source = Source(command=tuple(program), base=str(tmp_path), keep_folder=str(tmp_path / "work"))
    sleepy = Task({"x": 1.0}, Case("c", Programme.ramp((1.0,)), {"do": "sleep", "pid": str(pid_file)}))
    with RunStore(tmp_path / "results") as store, WorkerPool(1, source=source, timeout_s=1.5) as pool:
        (outcome,) = run_all(source.load(), [sleepy], store, pool, retries=0)
    assert outcome.reason.startswith("WorkerDied: stopped after the time-out of 1.5 s")
    assert_dies(int(pid_file.read_text()))


def assert_dies(pid):
    deadline = time.monotonic() + 3.0
    while alive(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not alive(pid)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"low": "0"}, "parameter 'x': low = '0': a finite number is expected"),
        ({"high": True}, "high = True: a finite number"),
        ({"low": float("-inf")}, "low = -inf: a finite number"),
        ({"high": 10**400}, "high = 1000000000"),
        ({"low": 10}, "low = 10 must be below high = 10 N"),
        ({"default": 11}, r"default = 11 is outside \[0, 10\] N"),
        ({"neutral": -1}, r"neutral = -1 is outside \[0, 10\] N"),
        ({"typical": [1]}, r"typical = \[1\]: a finite number"),
        ({"plausible": 3}, "plausible = 3: two numbers"),
        ({"plausible": [2, 1]}, r"plausible = \[2.0, 1.0\]: two numbers are expected, from low to high"),
        ({"unit": 3}, "unit = 3: text is expected"),
        ({"name": ""}, "name = '': text is expected"),
        ({"name": "lag"}, "parameter 'lag' is there twice"),
        ({"scope": "world"}, "scope = 'world': choose from study, mounting, place, curve"),
        ({"lower": 0}, "must print JSON .*has unknown .*lower"),
    ],
)
def test_command_whose_schema_is_wrong_is_refused_by_knob_key_and_value(tmp_path, changes, message):
    x = {"name": "x", "description": "force", "unit": "N", "low": 0, "high": 10} | changes
    lag = {"name": "lag", "description": "an effect", "unit": "1", "low": 0, "high": 1}
    schema = {"name": "s", "numerics": 1, "channels": {"time": "s", "travel": "mm"}, "parameters": [x, lag]}
    (tmp_path / "schema.json").write_text(json.dumps(schema))
    with pytest.raises(ValueError, match=message):
        load_backend(command=[sys.executable, "-c", f"print(open({str(tmp_path / 'schema.json')!r}).read())"])


def test_command_with_a_full_schema_is_taken(tmp_path):
    """Negative control of the refusals."""
    x = {
        "name": "x",
        "description": "force",
        "unit": "N",
        "low": 0,
        "high": 10,
        "default": 1,
        "neutral": None,
        "typical": 2,
        "plausible": [1, 20],
        "scope": "place",
        "group": "g",
    }
    schema = {"name": "s", "numerics": 1, "channels": {"time": "s", "travel": "mm"}, "parameters": [x]}
    (tmp_path / "schema.json").write_text(json.dumps(schema))
    backend = load_backend(command=[sys.executable, "-c", f"print(open({str(tmp_path / 'schema.json')!r}).read())"])
    (parameter,) = backend.parameters
    assert parameter.plausible == (1.0, 20.0) and parameter.neutral is None and parameter.default == 1.0


def test_command_that_is_none(tmp_path):
    with pytest.raises(ValueError, match=r"program 'no_such_program' .* was not found"):
        load_backend(command=["no_such_program", "x"])
    for code in ("print('hello')", "print('{}')", "import sys; sys.exit('no licence')"):
        with pytest.raises(ValueError, match="must print JSON with name, numerics, parameters and channels"):
            load_backend(command=[sys.executable, "-c", code])
