"""Diagnoses of many laboratory folders whose truth is withheld, with one library for all that share a test plan."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

from rso import diagnosis
from rso.contract import plain
from rso.diagnosis import Library
from rso.running import Event, run_all
from rso.store import RunStore
from rso.study.diagnosing import Asked, _finite, _replace, ask, judge
from rso.study.laboratory import study_text
from rso.study.loader import load


def cases_of(folder: Path) -> list[Path]:
    """Folders below `folder`, or itself, that hold a nominal.json."""
    found = sorted(p.parent for p in folder.glob("*/nominal.json"))
    return found or ([folder] if (folder / "nominal.json").exists() else [])


def answer(
    cases: list[Path], out: Path, store: RunStore, executor: Executor, *, seed: int,
    reruns: bool = False, watch: Callable[[Event], None] | None = None, say: Callable[[str], None] = lambda _: None,
) -> Iterator[tuple[str, dict[str, Any]]]:  # fmt: skip
    """Diagnose every case that has no answer yet; yields its name and the plain data, written to `out` as it comes.

    A case that cannot be read is answered with its error, so that one bad folder does not stop the others.  `reruns`
    computes the finalist anew and simulates candidate tests; without it only the library costs simulations.
    """
    libraries: dict[str, Library] = {}
    for case in cases:
        path = out / f"{case.name}.json"
        if path.exists():
            continue
        began = time.process_time()
        try:
            asked = _asked(case, out, seed)
            library = _library(asked, libraries, store, executor, watch)
            backend = asked.base.backend
            found = judge(asked, library, partial(run_all, backend, store=store, executor=executor) if reruns else None)
            found["timings"] = {"judging_cpu": time.process_time() - began}
        except ValueError as error:
            found = {"error": str(error)}
        _replace(path, json.dumps(plain(_finite(found)), indent=1, ensure_ascii=False))
        say(f"{case.name}: {found.get('error') or found['diagnosis']['verdict']}")
        yield case.name, found


def _asked(case: Path, out: Path, seed: int) -> Asked:
    own = out / "studies" / case.name
    own.mkdir(parents=True, exist_ok=True)
    (own / "study.toml").write_text(study_text(case, seed, own), encoding="utf-8")
    return ask(load(own / "study.toml"))


def _library(asked: Asked, known: dict[str, Library], store: RunStore, executor: Executor, watch: Any) -> Library:
    """A library of the same places, effects and base, made once; the tests of each case differ."""
    from dataclasses import replace

    from rso.contract import digest

    b = asked.base
    speeds = [min(t.speed for t in asked.plan.tests), max(t.speed for t in asked.plan.tests)]
    passes = [
        sorted(
            {(t.place, round(t.earlier, 1), round(t.peak, 1) if t.branch.any() else 0.0) for t in asked.plan.tests}
        )
    ]
    key = digest([
        [[p.settings, p.deepest, p.peaks, p.marks, p.mark_depths] for p in asked.plan.places],
        [e.name for e in asked.effects], b.modulus, b.reference, [[a.name, a.low, a.high] for a in b.axes],
        dict(b.fixed), dict(b.draft), [round(v, 1) for v in speeds], [[list(p) for p in q] for q in passes],
    ])  # fmt: skip
    if key not in known:
        known[key] = diagnosis.build(b, asked.plan, asked.effects, lambda tasks: run_all(
            b.backend, tasks, store, executor, watch=watch))  # fmt: skip
    return replace(known[key], plan=asked.plan)
