"""What dispatch and store cost: 10 000 runs that compute nothing, and a store of 100 000.

    python benchmarks/dispatch.py [runs] [stored]

Aims: at most 10 ms a run in dispatch and store; a store of 100 000 runs opens and answers in at most 1 s.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rso.contract import Case, Parameter, Programme, Response
from rso.evaluation import Source, Task, WorkerPool, run_all
from rso.evaluation.store import Done, RunStore

CHANNELS = {"time": "s", "travel": "mm", "Fx": "N", "Fy": "N", "Fz": "N"}


@dataclass(frozen=True)
class Nothing:
    """A backend that answers at once, with five channels of eight travels."""

    name: str = "nothing"
    numerics: int = 1
    parameters: tuple[Parameter, ...] = (Parameter("x", "any number", "1", -1e9, 1e9),)

    @property
    def channels(self) -> Mapping[str, str]:
        return CHANNELS

    def check(self, case: Case) -> None:
        pass

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        return dict(values), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        u = np.array(case.programme.asked_mm)
        F = np.sin(values["x"] + u)
        return Response({"time": u, "travel": u, "Fx": F, "Fy": F**2, "Fz": F**3}, CHANNELS, {"Fz": 1e-3 * F**2})


BACKEND = Nothing()
CASE = Case("case", Programme.ramp(tuple(np.linspace(0.25, 2.0, 8))), {"radius": 3.0})


def dispatch(folder: Path, runs: int) -> tuple[float, float]:
    """Milliseconds a run, computed by two workers and read back from the store."""
    tasks = [Task({"x": 1e-3 * k}, CASE, frozenset(CHANNELS)) for k in range(runs)]
    source = Source(use="dispatch:BACKEND", base=str(Path(__file__).parent))
    times = []
    with RunStore(folder) as store, WorkerPool(2, source=source) as pool:
        run_all(BACKEND, [Task({"x": -1.0}, CASE), Task({"x": -2.0}, CASE)], store, pool)  # workers have started
        for _ in range(2):
            start = time.perf_counter()
            run_all(BACKEND, tasks, store, pool)
            times.append(1e3 * (time.perf_counter() - start) / runs)
    return times[0], times[1]


def large_store(folder: Path, stored: int) -> dict[str, float]:
    """Seconds to open a store, to list it, and to get one run of it."""
    response = BACKEND({"x": 1.0}, CASE)
    with RunStore(folder) as store:
        store._db.execute("PRAGMA synchronous = OFF")  # filling is not what is measured
        for k in range(stored):
            store.put_done(Done(f"{k:064x}", {"x": float(k)}, CASE, response, 1.0, 1.0))
    times = {}
    for read_only in (False, True):
        start = time.perf_counter()
        with RunStore(folder, read_only=read_only) as store:
            times["open to read" if read_only else "open to write"] = time.perf_counter() - start
            start = time.perf_counter()
            found = store.get(f"{stored // 2:064x}")
            times["get one run"] = time.perf_counter() - start
            assert isinstance(found, Done)
            start = time.perf_counter()
            assert len(store.rows()) == stored
            times["list all runs"] = time.perf_counter() - start
    return times


def main() -> None:
    runs, stored = (int(a) for a in (sys.argv[1:] + ["10000", "100000"][len(sys.argv) - 1 :]))
    with tempfile.TemporaryDirectory() as name:
        computed, read = dispatch(Path(name) / "dispatch", runs)
        print(f"{runs} runs: {computed:.2f} ms each to dispatch, compute and store; {read:.2f} ms each from the store")
        for what, seconds in large_store(Path(name) / "large", stored).items():
            print(f"store of {stored} runs: {seconds:.3f} s to {what}")


if __name__ == "__main__":
    main()
