"""`rso run` of a study with [objectives]."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from rso.evaluation import Event
from rso.evaluation.store import RunStore
from rso.objectives.plan import ParetoPlan
from rso.objectives.results import pareto_data, write_pareto
from rso.objectives.runs import StudyRuns
from rso.objectives.solving import solve_study


def run_pareto(
    plan: ParetoPlan,
    store: RunStore,
    executor: Executor,
    folder: Path,
    *,
    command: str,
    jobs: int,
    watch: Callable[[Event], None] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Everything of the study; results.json and runs.csv are written into `folder`, and returned as plain data.

    Raises NoSurface where too few runs have an answer, StudyError for a design that there is not.
    """
    begun = time.perf_counter()
    found = solve_study(plan, StudyRuns(plan, store, executor, watch), say)
    found.timings["total"] = time.perf_counter() - begun
    return write_pareto(folder, pareto_data(found, command, jobs))
