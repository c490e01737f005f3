"""The deformed body of the model that a report draws, beside the results: deformed.json, made by one simulation more.

It depends on the run key alone; where the file has that key already nothing is simulated.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np

from rso.calibration.stages import Runner
from rso.contract import Backend, Case, DeformedBodies, DeformedBody, capability, plain
from rso.core import disk
from rso.evaluation import Source, WorkerPool
from rso.evaluation.store import Done

DEFORMED_FILE = "deformed.json"
FIELD_DIGITS = 4  # of fields; of places as many of the size of the body


def fitted_values(found: Mapping[str, Any]) -> Mapping[str, float] | None:
    """Values of the model that a report calls fitted: the most likely ones as they were run, else the best candidate's.

    `found` is what results.json holds by then; None without either.
    """
    run = ((found.get("identification") or {}).get("recomputed") or {}).get("values")
    best = found.get("best") or {}
    every = [(s["name"], c) for s in found.get("searches") or () for c in s["candidates"]]
    chosen = (c["values"] for name, c in every if (name, c["name"]) == (best.get("search"), best.get("candidate")))
    return run or next(chosen, None)


def begin_deformed(bench: Runner, found: Mapping[str, Any], folder: Path) -> Future[Any] | None:
    """Let a worker draw the first fitted experiment with the fitted values; None where nobody can, or it is there."""
    plan, values = bench.plan, fitted_values(found)
    path = folder / DEFORMED_FILE
    name = next((e.name for e in plan.study.experiments if e.role == "fit" and e.kind == "force"), None)
    if values is None or name is None or capability(plan.backend, DeformedBodies) is None:
        path.unlink(missing_ok=True)  # that of an earlier state of the study
        return None
    (outcome,) = bench.evaluator.run([t for t in plan.tasks(values) if t.case.name == name][:1])
    if not isinstance(outcome, Done) or _known(path) == outcome.key:
        return None
    target: Backend | Source = plan.backend
    if isinstance(bench.evaluator.executor, WorkerPool) and bench.evaluator.executor.source is not None:
        target = bench.evaluator.executor.source
    return bench.evaluator.executor.submit(draw_deformed, target, outcome.values, outcome.case, outcome.key, name)


def write_deformed(future: Future[Any] | None, folder: Path) -> None:
    """Wait for what was begun and put it beside the results; a picture that cannot be made is none."""
    if future is None:
        return
    try:
        text = future.result()
    except Exception:  # of somebody's backend, or of a worker that died: the numbers stand without it
        (folder / DEFORMED_FILE).unlink(missing_ok=True)
        return
    disk.replace(folder / DEFORMED_FILE, text)


def draw_deformed(backend: Backend | Source, values: Mapping[str, float], case: Case, key: str, name: str) -> str:
    """The file's text, in the process that computes it."""
    if isinstance(backend, Source):
        backend = backend.load()
    drawing = capability(backend, DeformedBodies)
    assert drawing is not None  # asked before
    return json.dumps(
        {"key": key, "experiment": name, "values": dict(values), **body_as_plain(drawing.deformed(values, case))}
    )


def body_as_plain(body: DeformedBody) -> dict[str, Any]:
    """A body as JSON holds it: as many digits as can be seen; triangles of a frame null where they are as before."""
    size = max((float(np.abs(f.points).max(initial=0.0)) for f in body.frames), default=1.0) or 1.0
    places = max(0, 4 - int(np.floor(np.log10(size))))
    frames: list[dict[str, Any]] = []
    before: np.ndarray | None = None
    for f in body.frames:
        same = before is not None and np.array_equal(before, f.triangles)
        before = f.triangles
        frames.append(
            {
                "travel": float(f.travel),
                "force": float(f.force),
                "points": np.round(f.points, places),
                "triangles": None if same else f.triangles,
                "fields": {k: _rounded(v) for k, v in f.fields.items()},
                "indenter": np.round(f.indenter, places),
                "mirrored": bool(f.mirrored),
            }
        )
    surface = body.surface and {
        **dataclasses.asdict(body.surface),
        "points": np.round(body.surface.points, places),
        "fields": {k: _rounded(v) for k, v in body.surface.fields.items()},
        "mirrored": [bool(m) for m in body.surface.mirrored],
    }
    found: dict[str, Any] = plain(
        {"plane": body.plane, "units": dict(body.units), "frames": frames, "surface": surface or None}
    )
    return found


def _rounded(v: np.ndarray) -> list[float]:
    size = float(np.abs(v).max(initial=0.0)) or 1.0
    return [round(float(x), FIELD_DIGITS - 1 - int(np.floor(np.log10(size)))) for x in v]


def _known(path: Path) -> str | None:
    """The run key of a file that is there."""
    try:
        key = disk.read_json(path)["key"]
        return key if isinstance(key, str) else None
    except (OSError, ValueError, LookupError, TypeError):
        return None
