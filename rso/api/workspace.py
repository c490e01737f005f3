"""A study file and the folder of its results: what `rso check`, `rso run` and their like do, from Python."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rso.api.executors import Collecting, InProcess, RunsWanted
from rso.api.exporting import check_formats, export
from rso.api.importing import read_runs, runs_of_table
from rso.api.run_result import RunResult
from rso.calibration.pipeline import run_study
from rso.calibration.plan import Plan, make_plan
from rso.calibration.result_files import claim, finished_results
from rso.calibration.results import RUN_SCHEMA
from rso.contract import Backend, Case, Response, SimulationFailed, lacking, run_key, unfit
from rso.evaluation import executor
from rso.evaluation.store import Done, Failed, RunStore
from rso.study.loader import load_study as read_study
from rso.study.schema import Study

Say = Callable[[str], None]
NotedRun = tuple[Mapping[str, float], Case]


@dataclass(frozen=True)
class AskedRun:
    """A simulation that a study wants made: `values` by parameter, and the case, whose travels (mm) are `travel`."""

    key: str
    values: Mapping[str, float]
    case: Case

    @property
    def travel(self) -> np.ndarray:
        """Asked travels (n,) mm."""
        return np.array(self.case.programme.asked_mm)

    @property
    def settings(self) -> Mapping[str, Any]:
        """Settings of the experiment, as the study states them."""
        return self.case.settings


@dataclass(frozen=True)
class Workspace:
    """A study that has been read, its model, and the folder of its results; what is computed there stays there.

    Simulations lie in that folder, or in the `store` that the specimens of one study share.
    """

    study: Study
    folder: Path
    plan: Plan
    backend: Backend | None = None
    store: Path | None = None

    @property
    def result(self) -> RunResult:
        """What `run` found last; FileNotFoundError before it has, ValueError for what another version has left."""
        return RunResult(self.folder, finished_results(self.folder / "results.json", RUN_SCHEMA))

    def run(self, *, jobs: int | None = None, progress: Say | None = None, report: bool = False) -> RunResult:
        """Run the study, or go on with it, as `rso run` does: what has been computed is not computed again.

        `jobs` simulations at a time (default: dispatch.jobs of the study); those of a model given to :func:`load` run
        one after the other in this process.  `progress` is called with a line at each stage.  `report` writes the pages
        that the study asks for.  Raises NothingToFit where too few runs have an answer, StoreError where the folder
        cannot be used.
        """
        with self._running(jobs) as executor, self._store() as store:
            found = run_study(
                self.plan,
                store,
                executor,
                self.folder,
                command="rso.Workspace.run",
                jobs=jobs or self.study.dispatch.jobs,
                say=progress or (lambda _: None),
            )
        result = RunResult(self.folder, found)
        if report:
            result.report(html=self.study.report.html, pdf=self.study.report.pdf)
        return result

    def export(
        self,
        folder: str | os.PathLike[str],
        *formats: str,
        candidate: int | None = None,
        experiment: str | None = None,
    ) -> list[Path]:
        """Write what :meth:`run` found for others, as `rso export` does; the files.

        `formats` are those of tables (csv, parquet, arviz) and those of the backend.  They are written for the most
        likely values or those of a `candidate` (from 1), and for an `experiment`.  Raises ValueError naming the
        choices, and for what a format cannot say; FileNotFoundError before the study has been run.
        """
        check_formats(self.plan, formats)
        return export(self.plan, self.result, Path(folder), formats, candidate=candidate, experiment=experiment)

    def ask(self, n: int | None = None) -> list[AskedRun]:
        """The simulations without which the study cannot go on, at most `n`; none where it is finished.

        They come in batches, as they do in :meth:`run`: the design first, then what the surrogates lack, the
        candidates, the held-out experiments.  Each batch needs the answers to the one before, see :meth:`tell`.
        """
        collecting = Collecting()
        with self._store() as store:
            try:
                run_study(
                    self.plan,
                    store,
                    collecting,
                    self.folder,
                    command="rso.Workspace.ask",
                    jobs=1,
                    watch=collecting.watch,
                )
            except RunsWanted as wanted:
                calls = wanted.calls if n is None else wanted.calls[:n]
                return [AskedRun(run_key(self.plan.backend, values, case), values, case) for values, case in calls]
        return []

    def tell(self, answers: Sequence[tuple[AskedRun, Response | Mapping[str, Any] | SimulationFailed]]) -> None:
        """Store the answers to runs of :meth:`ask`.

        An answer is a mapping of channels to numbers (n,) at the asked travels, in the units that the backend declares.
        It may also be a whole :class:`rso.Response`, or a :class:`rso.SimulationFailed` for a run that has no answer.
        Raises ValueError for an answer without a channel that the study reads, or of another length; nothing is stored
        then.
        """
        rows = [self._answered(run, answer) for run, answer in answers]
        with self._store() as store:
            for row in rows:
                if isinstance(row, Done):
                    store.put_done(row)
                else:
                    store.put_failed(row)

    def import_runs(self, table: pd.DataFrame | str | os.PathLike[str]) -> int:
        """Store runs that were made elsewhere, given as a table or its file; how many simulations that makes.

        A row is a point of a curve: see :mod:`rso.api.importing`.  A study uses those whose values its design asks for:
        with ``[doe] kind = "file"`` and ``reduce = false`` the points of the same table.  Nothing is stored where a row
        is wrong (ValueError).
        """
        rows = runs_of_table(self.plan, table if isinstance(table, pd.DataFrame) else read_runs(Path(table)))
        with self._store() as store:
            for row in rows:
                store.put_done(row)
        return len(rows)

    def _answered(self, run: AskedRun, answer: Response | Mapping[str, Any] | SimulationFailed) -> Done | Failed:
        head = (run.key, run.values, run.case)
        if isinstance(answer, SimulationFailed):
            return Failed(*head, answer.cause, answer.reason, answer.partial, tuple(answer.history), 0.0, 0.0)
        units = dict(self.plan.backend.channels)
        if not isinstance(answer, Response):
            if unknown := sorted(set(answer) - set(units)):
                choices = ", ".join(units)
                raise ValueError(f"{run.case.name}: channel {unknown[0]!r} is not declared; the backend has {choices}")
            travel = run.travel
            ramp = np.interp(travel, run.case.programme.travel_mm[:2], run.case.programme.time_s[:2])
            answer = Response({"time": ramp, "travel": travel, **answer}, units)
        if lost := sorted(_read(self.plan, run.case) - set(answer.channels)):
            raise ValueError(f"{run.case.name}: the answer lacks {', '.join(lost)}, which the study reads")
        return Done(*head, answer, 0.0, 0.0)

    @contextmanager
    def _store(self) -> Iterator[RunStore]:
        claim(self.folder, self.study.file)
        with RunStore(self.store or self.folder) as store:
            yield store

    @contextmanager
    def _running(self, jobs: int | None) -> Iterator[Executor]:
        with ExitStack() as stack:
            if self.backend is not None:
                yield InProcess()
            else:
                count = jobs or self.study.dispatch.jobs
                yield stack.enter_context(executor(self.study.dispatch, count, self.plan.source, self.folder))


def load(
    path: str | os.PathLike[str], *, backend: Backend | None = None, folder: str | os.PathLike[str] | None = None
) -> Workspace:
    """Read a study file, or the study.toml within a folder, and its data; nothing is computed.

    `backend` stands in for the one that the file names: a model of this process, from :func:`rso.model` or any other
    object of :class:`rso.Backend`.  Results go to `folder`, by default to results/ beside the file, as of `rso run`.
    Raises StudyError with everything that is wrong with the study.
    """
    study = read_study(Path(path))
    if backend is not None and (wrong := [*lacking(backend, Backend), *unfit(backend)]):
        raise ValueError(f"backend = {backend!r}: is not a backend (rso.Backend): {'; '.join(wrong)}")
    place = study.folder / "results" if folder is None else Path(folder)
    return Workspace(study, place.absolute(), make_plan(study, backend=backend), backend)


def _read(plan: Plan, case: Case) -> set[str]:
    """Channels that a study reads of a case."""
    names = {e for e, k in plan.case_of.items() if plan.cases[k].name == case.name}
    names |= {e for e, c in plan.validation.items() if c.name == case.name}
    fitted = {o.channel for o in itertools.chain(plan.outputs, plan.extras) if o.experiment in names}
    held = {c for e in plan.study.experiments if e.name in names and e.kind == "force" for c in e.compared}
    return fitted | held
