"""Studies with objectives from Python: what `rso check` and `rso run` do, and results as tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from rso.api.executors import InProcess
from rso.api.workspace import executor
from rso.calibration.result_files import claim
from rso.contract import Backend, lacking, unfit
from rso.core import disk
from rso.evaluation.store import RunStore
from rso.objectives.pipeline import run_pareto
from rso.objectives.plan import ParetoPlan, pareto_plan
from rso.study.errors import Problem, study_error
from rso.study.loader import load_study as read_study
from rso.study.schema import Study


@dataclass(frozen=True)
class ParetoResult:
    """Results of a study with objectives: their folder, and `data`, which is results.json (docs/objectives.md).

    Values are in the units that the model declares; those of categories are their texts.
    """

    folder: Path
    data: Mapping[str, Any] = field(repr=False)

    @property
    def exit_code(self) -> int:
        """As `rso run` ends: 0 where all candidates are verified and one keeps all limits."""
        return int(self.data["exit_code"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the report warns of."""
        return tuple(self.data["warnings"])

    @property
    def front(self) -> pd.DataFrame:
        """A row per point of the front: parameters and objectives, on the surfaces or as simulated (search.method)."""
        return pd.DataFrame([{**p["values"], **p["objectives"]} for p in self.data["front"]["points"]])

    @property
    def candidates(self) -> pd.DataFrame:
        """A row per candidate that was simulated: parameters, all quantities, difference, verified, meets."""
        keys = ("difference", "verified", "meets", "state")
        rows = [
            {"candidate": c["name"], **c["values"], **(c["simulated"] or {}), **{k: c[k] for k in keys}}
            for c in self.data["candidates"]
        ]
        return pd.DataFrame(rows)

    @property
    def runs(self) -> pd.DataFrame:
        """A row per simulation: purpose, state, parameters, quantities, whether within limits and on the best front."""
        keys = ("within_limits", "best", "reason", "wall_s", "key")
        rows = [
            {
                "purpose": r["purpose"],
                "state": r["state"],
                **r["values"],
                **(r["outputs"] or {}),
                **{k: r[k] for k in keys},
            }
            for r in self.data["runs"]
        ]
        return pd.DataFrame(rows)

    @property
    def best(self) -> pd.DataFrame:
        """Those simulations that keep all limits and that no other beats in every objective."""
        table = self.runs
        return table[table["best"]].reset_index(drop=True)

    @property
    def sensitivities(self) -> pd.DataFrame:
        """A row per quantity and parameter: first-order and total Sobol index with the ends of its 90 % interval."""
        rows = [
            {"quantity": q, "parameter": r["parameter"], "first": r["first"], "total": r["total"],
             "low": r["total_interval"][0], "high": r["total_interval"][1]}
            for q, table in self.data["sensitivity"]["sobol"].items()
            for r in table
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def report(self, folder: str | Path | None = None, *, html: bool = True, pdf: bool = True) -> list[Path]:
        """Write report.html and report.pdf to a folder (that of the results without one); their paths."""
        from rso.report import render_pareto

        place = self.folder if folder is None else Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        return render_pareto(dict(self.data), place, html=html, pdf=pdf)


@dataclass(frozen=True)
class ParetoStudy:
    """A study with objectives that has been read, its model, and the folder of its results."""

    study: Study
    folder: Path
    plan: ParetoPlan
    backend: Backend | None = None

    @property
    def result(self) -> ParetoResult:
        """What `run` found last; FileNotFoundError before it has."""
        return ParetoResult(self.folder, disk.read_json(self.folder / "results.json"))

    def run(
        self, *, jobs: int | None = None, progress: Callable[[str], None] | None = None, report: bool = False
    ) -> ParetoResult:
        """Run the study, or go on with it, as `rso run` does: what has been computed is not computed again.

        `jobs` simulations at a time (default: dispatch.jobs of the study); those of a model given to :func:`pareto` run
        one after the other in this process.  `progress` is called with a line at each stage.  Raises NoSurface where
        too few runs have an answer.
        """
        claim(self.folder, self.study.file)
        count = jobs or self.study.dispatch.jobs
        with self._running(count) as pool, RunStore(self.folder) as store:
            found = run_pareto(
                self.plan, store, pool, self.folder, command="rso.ParetoStudy.run", jobs=count,
                say=progress or (lambda _: None),
            )  # fmt: skip
        result = ParetoResult(self.folder, found)
        if report:
            result.report(html=self.study.report.html, pdf=self.study.report.pdf)
        return result

    @contextmanager
    def _running(self, jobs: int) -> Iterator[Executor]:
        if self.backend is not None:
            yield InProcess()
        else:
            with executor(self.study.dispatch, jobs, self.plan.source, self.folder) as pool:
                yield pool


def pareto(
    path: str | os.PathLike[str], *, backend: Backend | None = None, folder: str | os.PathLike[str] | None = None
) -> ParetoStudy:
    """Read a study file with [objectives], or the study.toml within a folder; nothing is computed.

    `backend` stands in for the one that the file names: a model of this process, from :func:`rso.model`.  Results go to
    `folder`, by default to results/ beside the file.  Raises StudyError with everything that is wrong with the study.
    """
    study = read_study(Path(path))
    if study.objectives is None:
        text = "this study has measurements and no [objectives]: rso.load reads it"
        raise study_error(study.file, study.lines, [Problem(("experiments",), text)])
    if backend is not None and (wrong := [*lacking(backend, Backend), *unfit(backend)]):
        raise ValueError(f"backend = {backend!r}: is not a backend (rso.Backend): {'; '.join(wrong)}")
    place = study.folder / "results" if folder is None else Path(folder)
    return ParetoStudy(study, place.absolute(), pareto_plan(study, backend=backend), backend)
