"""The specimens of a study one after the other: what is finished stays, and one without an answer stops no other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor
from pathlib import Path
from typing import Any

import rso
from rso.calibration.pipeline import run_study
from rso.calibration.plan import Plan
from rso.calibration.result_files import claim
from rso.calibration.results import data_hashes
from rso.calibration.stages import NothingToFit
from rso.evaluation import Watch
from rso.evaluation.store import RunStore, StoreError
from rso.population.summary import folder_of, is_finished, specimen_results

Say = Callable[[str], None]
Pages = Callable[[dict[str, Any], Path], object]


def run_specimens(
    plans: Sequence[Plan],
    store: RunStore,
    executor: Executor,
    folder: Path,
    *,
    command: str,
    jobs: int,
    watch: Watch | None = None,
    say: Say = lambda _: None,
    strict: bool = False,
    pages: Pages = lambda found, place: None,
) -> dict[str, str]:
    """Run every specimen that is not finished, each into its own folder, on one store; why those that stopped did.

    A specimen is finished where its results are those of a whole run of the same study, data and version.  `pages` are
    written for each.  Raises StoreError, OSError and KeyboardInterrupt; what was computed stays.
    """
    stopped: dict[str, str] = {}
    for n, plan in enumerate(plans, 1):
        name = plan.study.specimen
        place = folder_of(folder, name)
        head = f"specimen {n} of {len(plans)}, {name}"
        if _done_before(plan, folder):
            say(f"{head}: finished before")
            continue
        say(head)
        try:
            place.mkdir(parents=True, exist_ok=True)
            claim(place, plan.study.file)
            found = run_study(
                plan, store, executor, place, command=command, jobs=jobs, watch=watch, say=say, strict=strict
            )
            pages(found, place)
        except (StoreError, BrokenExecutor, OSError, MemoryError):  # of the machine, not of the specimen
            raise
        except NothingToFit as error:
            stopped[name] = str(error)
        except Exception as error:  # a fault that one specimen meets must not cost the night of the others
            stopped[name] = f"a fault of the program: {type(error).__name__}: {error}"
        if name in stopped:
            say(f"  {name} stopped: {stopped[name]}")
    return stopped


def _done_before(plan: Plan, folder: Path) -> bool:
    """Whether a whole run of this very study of the specimen is there, by this version and on the same data."""
    found = specimen_results(folder, plan.study.specimen, plan.study.sha256)
    if found is None or not is_finished(found):
        return False
    made = found["provenance"]
    same = made["rso"] == rso.__version__ and made["data_sha256"] == data_hashes(plan.study)
    return bool(same and found["backend"]["numerics"] == plan.backend.numerics)
