"""Studies of many specimens from Python: what `rso run` does with them, and results as tables."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from rso.api.executors import InProcess
from rso.api.workspace import Workspace, executor
from rso.calibration.plan import Plan, source_of
from rso.calibration.result_files import claim, finished_results
from rso.contract import Backend, lacking, unfit
from rso.evaluation.store import RunStore
from rso.population.plans import specimen_plans
from rso.population.running import run_specimens
from rso.population.summary import (
    SPECIMENS_FILE,
    SPECIMENS_SCHEMA,
    folder_of,
    population_rows,
    population_summary,
    write_summary,
)
from rso.report import render, render_specimens
from rso.study.specimens import SpecimenStudies, load_specimens


@dataclass(frozen=True)
class SpecimensResult:
    """Results of many specimens: the folder that holds them, and `data`, which is specimens.json (docs/results.md)."""

    folder: Path
    data: dict[str, Any] = field(repr=False)

    @property
    def exit_code(self) -> int:
        """As `rso run` ends: 0 where every specimen has an answer that is verified."""
        return int(self.data["exit_code"])

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence or two for each parameter."""
        return tuple(self.data["words"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the summary warns of."""
        return tuple(self.data["warnings"])

    @property
    def specimens(self) -> pd.DataFrame:
        """A row per specimen and parameter: value, unit, ends `low` and `high` of its interval, verdict, outlier, …

        Numbers are NaN where a specimen has no answer; `bounded` says which ends are the data's.
        """
        keys = ("parameter", "value", "unit", "verdict", "bounded", "outlier")
        rows = []
        for s in self.data["specimens"]:
            head = {"specimen": s["name"], "state": s["state"]}
            for p in s["parameters"] or [{**dict.fromkeys(keys), "interval": (None, None)}]:
                low, high = p["interval"]
                rows.append({**head, **{k: p[k] for k in keys}, "low": low, "high": high})
        return pd.DataFrame(rows).astype({"value": float, "low": float, "high": float})

    @property
    def population(self) -> pd.DataFrame:
        """A row per parameter over all specimens: mean, τ, I², Q, with ends of intervals and of the prediction."""
        return pd.DataFrame(population_rows(self.data)).set_index("parameter")

    def report(self, folder: str | Path | None = None, *, html: bool = True, pdf: bool = True) -> list[Path]:
        """Write specimens.html and specimens.pdf to a folder (that of the results without one); their paths."""
        place = self.folder if folder is None else Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        return render_specimens(self.data, place, html=html, pdf=pdf)


@dataclass(frozen=True)
class SpecimensStudy:
    """A study of many specimens that has been read, their plans, and the folder of the results."""

    found: SpecimenStudies
    folder: Path
    plans: tuple[Plan, ...]
    backend: Backend | None = None

    @property
    def names(self) -> list[str]:
        """Names of the specimens."""
        return self.found.names

    @property
    def result(self) -> SpecimensResult:
        """What `run` found last; FileNotFoundError before it has, ValueError for what another version has left."""
        return SpecimensResult(self.folder, finished_results(self.folder / SPECIMENS_FILE, SPECIMENS_SCHEMA))

    def study(self, name: str) -> Workspace:
        """The study of one specimen, whose results lie in a folder of its own; StudyError naming the others."""
        study = self.found.study(name)
        plan = next(p for p in self.plans if p.study.specimen == name)
        return Workspace(study, folder_of(self.folder, name), plan, self.backend, self.folder)

    def run(
        self, *, jobs: int | None = None, progress: Callable[[str], None] | None = None, report: bool = False
    ) -> SpecimensResult:
        """Run the specimens that are not finished, as `rso run` does; a specimen without an answer stops no other.

        `jobs` simulations at a time (default: dispatch.jobs of the study); those of a model given to :func:`specimens`
        run one after the other in this process.  `report` writes a page for each and the summary.
        """
        first, say, command = self.found.studies[0], progress or (lambda _: None), "rso.SpecimensStudy.run"
        count = jobs or first.dispatch.jobs
        claim(self.folder, self.found.file)
        with ExitStack() as stack:
            pool: Any = InProcess()
            if self.backend is None:
                pool = stack.enter_context(executor(first.dispatch, count, source_of(first), self.folder))
            store = stack.enter_context(RunStore(self.folder))
            stopped = run_specimens(
                self.plans, store, pool, self.folder, command=command, jobs=count, say=say,
                pages=lambda one, place: render(one, place, html=True, pdf=first.report.pdf) if report else None,
            )  # fmt: skip
        data = population_summary(self.plans, self.folder, stopped, self.found.own, self.found.notes, command)
        write_summary(self.folder, data)
        result = SpecimensResult(self.folder, data)
        if report:
            result.report(html=first.report.html, pdf=first.report.pdf)
        return result


def specimens(
    path: str | os.PathLike[str], *, backend: Backend | None = None, folder: str | os.PathLike[str] | None = None
) -> SpecimensStudy:
    """Read a study file with [[specimens]] or a table of them, and all data; nothing is computed.

    `backend` stands in for the one that the file names: a model of this process, from :func:`rso.model`.  Results go to
    `folder`, by default to results/ beside the file.  Raises StudyError with all that is wrong with any specimen.
    """
    found = load_specimens(Path(path))
    if backend is not None and (wrong := [*lacking(backend, Backend), *unfit(backend)]):
        raise ValueError(f"backend = {backend!r}: is not a backend (rso.Backend): {'; '.join(wrong)}")
    place = found.file.parent / "results" if folder is None else Path(folder)
    return SpecimensStudy(found, place.absolute(), tuple(specimen_plans(found, backend)), backend)
