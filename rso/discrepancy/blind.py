"""Diagnoses of many laboratory folders whose truth is withheld, with one library for all that share a test plan."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

from rso import discrepancy
from rso.calibration import result_files
from rso.contract import digest
from rso.core import disk
from rso.discrepancy import Library, TestPlan
from rso.discrepancy.study_diagnosis import Asked, ask, judge_library
from rso.evaluation import Evaluator, Watch
from rso.evaluation.store import RunStore
from rso.study.laboratory_folder import file_line, files_of, study_of_folder, unread
from rso.study.laboratory_nominal import NOMINAL_FILE, read_nominal
from rso.study.loader import load_study

# mm, of plans of the usual depth: one that ends this much earlier than another shares its library
SHARED_LIBRARY_DEPTH_MM = 2.0


def cases_of(folder: Path) -> list[Path]:
    """Folders below `folder`, or itself, that hold a nominal.json."""
    found = sorted(p.parent for p in folder.glob("*/nominal.json"))
    return found or ([folder] if (folder / "nominal.json").exists() else [])


def diagnose_cases(
    cases: list[Path],
    out: Path,
    store: RunStore,
    executor: Executor,
    *,
    seed: int,
    reruns: bool = False,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Diagnose every case that has no answer yet; yields its name and the plain data, written to `out` as it comes.

    A case that cannot be read is answered with its error, so that one bad folder does not stop the others, and tried
    again at the next call.  What the files were taken for is said before anything is computed, and kept with the
    answer.  `reruns` recomputes the finalist and simulates candidate tests; without it only the library costs
    simulations.
    """
    libraries: dict[str, Library] = {}
    read = {case: _read(case, out, seed) for case in cases}
    # of those with an answer too: a round that goes on keeps its library
    deepest = _deepest([v for v in read.values() if isinstance(v, Asked)])
    waiting = [case for case in read if not _answered(out / f"{case.name}.json")]
    taken = {case: _taken(case, asked) for case in waiting if isinstance(asked := read[case], Asked)}
    _tell(taken, say)
    for case in waiting:
        asked, path = read[case], out / f"{case.name}.json"
        began = time.process_time()
        try:
            if isinstance(asked, ValueError):
                raise asked
            asked = replace(asked, plan=_as_deep(asked.plan, deepest))
            library = _library(asked, libraries, store, executor, watch)
            backend = asked.base.backend
            found = judge_library(asked, library, Evaluator(backend, store, executor).run if reruns else None)
            found["timings"] = {"judging_cpu": time.process_time() - began}
            found["taken"] = taken[case]
        except ValueError as error:
            found = {"error": str(error)}
        result_files.write_results(path, found)
        say(f"{case.name}: {found.get('error') or found['diagnosis']['verdict']}")
        yield case.name, found


def _answered(path: Path) -> bool:
    """Whether there is an answer: an error is none, nor is what cannot be read."""
    try:
        return "error" not in disk.read_json(path)
    except (OSError, ValueError, TypeError):
        return False


def _taken(case: Path, asked: Asked) -> dict[str, Any]:
    """What the files of a case and its support were taken for, and what its nominal.json leaves to be assumed."""
    support = asked.study.backend.settings["support"]
    assumed = [*read_nominal(case).assumed, *unread(case)]
    return {"files": files_of(asked.study), "support": support, "assumed": assumed}


def _tell(taken: Mapping[Path, Mapping[str, Any]], say: Callable[[str], None]) -> None:
    """One line per file; cases that are taken alike are said once."""
    first: dict[tuple[str, ...], str] = {}
    for case, found in taken.items():
        lines = (*map(file_line, found["files"]), f"support: {json.dumps(found['support'])}", *found["assumed"])
        if lines in first:
            say(f"{case.name}: taken for the same as {first[lines]}")
            continue
        first[lines] = case.name
        for line in (f"{case.name}:", *(f"  {words}" for words in lines)):
            say(line)


def _read(case: Path, out: Path, seed: int) -> Asked | ValueError:
    try:
        return _asked(case, out, seed)
    except ValueError as error:
        if "columns" in str(error) and not str(error).startswith(str(case / NOMINAL_FILE)):
            return ValueError(
                f'{error}\n{case / NOMINAL_FILE}: says as "columns" what a study says under [columns], for all '
                'files, and as "columns_of" for one: "columns_of": {"profile.csv": {}}'
            )
        return error


def _deepest(asked: Sequence[Asked]) -> dict[str, float]:
    """Deepest travel of all cases by place."""
    found: dict[str, float] = {}
    for a in asked:
        for p in a.plan.places:
            key = digest(p.settings)
            found[key] = max(found.get(key, 0.0), p.deepest)
    return found


def _as_deep(plan: TestPlan, deepest: Mapping[str, float]) -> TestPlan:
    """The plan with places as deep as in the deepest case, so that one library serves all, where that is not far."""
    far = {digest(p.settings): deepest[digest(p.settings)] for p in plan.places}
    reach = SHARED_LIBRARY_DEPTH_MM * plan.scale
    places = [replace(p, deepest=v) if (v := far[digest(p.settings)]) <= p.deepest + reach else p for p in plan.places]
    return replace(plan, places=tuple(places))


def _asked(case: Path, out: Path, seed: int) -> Asked:
    own = out / "studies" / case.name
    disk.folder(disk.folder(out / "studies") / case.name)
    disk.replace(own / "study.toml", study_of_folder(case, seed, own))
    return ask(load_study(own / "study.toml"))


def _library(asked: Asked, known: dict[str, Library], store: RunStore, executor: Executor, watch: Any) -> Library:
    """A library of the same places, effects and base, made once; the tests of each case differ."""
    b, key = asked.base, _key(asked)
    if key not in known:
        known[key] = discrepancy.build_library(
            b, asked.plan, asked.effects, Evaluator(b.backend, store, executor, watch).run
        )
    own = {e.name: e for e in asked.effects}  # what is plausible may hang on the forces
    return replace(known[key], plan=asked.plan, effects=tuple(own[e.name] for e in known[key].effects))


def _key(asked: Asked) -> str:
    """Of cases with the same simulations: those of an effect go as far as its plausible sizes and shapes."""
    b, near = asked.base, asked.plan.near
    speeds = [min(t.speed for t in asked.plan.tests), max(t.speed for t in asked.plan.tests)]
    passes = [sorted({(t.place, near(t.earlier), near(t.peak) if t.returns else 0.0) for t in asked.plan.tests})]
    return digest(
        [
            [[p.settings, p.deepest, p.peaks, p.marks, p.mark_depths] for p in asked.plan.places],
            asked.plan.scale,
            [e.name for e in asked.effects],
            b.modulus,
            b.reference,
            [[[k.low, k.high] for k in e.knobs] for e in asked.effects if e.family == "model"],
            [[a.name, a.low, a.high] for a in b.axes],
            dict(b.fixed),
            dict(b.draft),
            dict(b.lean),
            [float(f"{v:.2g}") for v in speeds],
            [[list(p) for p in q] for q in passes],
        ]
    )
