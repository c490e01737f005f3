"""Small studies on the closed-form backend: written to a folder, and run without processes."""

from __future__ import annotations

import dataclasses
import io
import json
import subprocess
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import indentation_backend
import numpy as np
import pytest

from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.cli import main
from rso.contract import Case, Response
from rso.evaluation.store import RunStore
from rso.study.loader import load_study

MU, D1, THICKNESS = 0.012, 60.0, 8.0
# Ranges stay as they are stated but in test_repairing.py.
SECTIONS = {
    "study": 'title = "Layer"\nseed = 0',
    "backend": 'use = "indentation_backend:BACKEND"',
    "backend.settings": f"thickness = {THICKNESS}",
    "parameters": 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\n'
    'D1 = { low = 10, high = 150, scale = "log" }',
    "[experiments]": 'name = "top"\nrole = "fit"\ndata = "top.csv"\n'
    'noise = { Fz = "0.02 mN", contact = "0 mm", gain = 0, correlation = "0 mm" }',
    "doe": "runs = 16\nheld_out = 3",
    "surrogate": 'kind = "polynomial"',
    "sensitivity": "samples = 64",
    "search": 'repair = false\npopulation = 20\ngenerations = 10\ntargets = [{ experiment = "top", depth = 0.8 }, '
    '{ experiment = "top", depth = 2 }]',
    "report": "html = false\npdf = false",
}
# Small enough that what is tested around a study takes the time and not the study.
QUICK = {
    "doe": "runs = 8\nheld_out = 1",
    "sensitivity": "sobol = false\nlocal = false",
    "search": f"{SECTIONS['search']}\ncandidates = 1".replace("= 20", "= 8").replace("= 10", "= 4"),
    "report": "html = false\npdf = false",
}


class Marked(indentation_backend.Layer):
    """The layer with a surface: its marks follow the indenter, the less the farther away they are."""

    def check(self, case: Case) -> None:
        super().check(dataclasses.replace(case, settings={k: v for k, v in case.settings.items() if k != "profile"}))

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        found, c = super().__call__(values, case), values["mu"] * values.get("D1", 0.0)
        marks = {
            f"uz({x:g},{y:g})": displacement(found.channels["travel"], x, y, c)
            for x, y in case.settings.get("profile", ())
        }
        for x, y in case.settings.get("profile", ()):
            for axis, place in (("x", x), ("y", y)):
                marks[f"u{axis}({x:g},{y:g})"] = sideways(found.channels["travel"], place, x, y, c)
        return dataclasses.replace(
            found, channels={**found.channels, **marks}, units={**found.units, **dict.fromkeys(marks, "mm")}
        )


def displacement(h: np.ndarray, x: float, y: float, c: float) -> np.ndarray:
    """uz (mm) of a mark at travel h (mm): one part follows the travel, one the force of a sphere; c = mu D1."""
    return -np.exp(-(x**2 + y**2) / 100) * (0.3 * h + 0.2 * c / (1 + c) * h**1.5)


def sideways(h: np.ndarray, along: float, x: float, y: float, c: float) -> np.ndarray:
    """ux or uy (mm) of a mark whose place on that axis is `along` mm: towards the indenter, the less the larger c."""
    return -0.05 * along * np.exp(-(x**2 + y**2) / 50) * h / (1 + c)


class Inline(Executor):
    """Computes at once in this process."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Here(Inline):
    """In place of rso.evaluation.WorkerPool where a command is tested and not its processes."""

    def __init__(self, jobs: int, *, source: Any = None, timeout_s: float | None = None, warm: bool = False) -> None:
        pass


def command(*arguments: object) -> subprocess.CompletedProcess:
    """The command line without any other process: exit code and what it prints."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr("rso.evaluation.WorkerPool", Here)
        patch.setenv("COLUMNS", "100")
        code = main([*map(str, arguments)])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def measured(noise: float = 1e-5, thickness: float = THICKNESS, deepest: float = 2.0, D1: float = D1) -> str:
    """A curve of 20 points of the closed form with known parameters and noise (N, one standard deviation)."""
    h = np.linspace(0, deepest, 21)[1:]
    F = indentation_backend.force(MU, D1, h, thickness) + noise * np.random.default_rng(0).standard_normal(20)
    return "depth_mm,Fz_N\n" + "".join(f"{u!r},{f!r}\n" for u, f in zip(h.tolist(), F.tolist(), strict=True))


def text(**changes: str | None) -> str:
    """study.toml with some sections replaced, added or (None) left out; `__` in a name stands for a point."""
    sections = {**SECTIONS, **{k.replace("__", "."): v for k, v in changes.items()}}
    sections = {"[experiments]" if k == "experiments" else k: v for k, v in sections.items()}
    return "\n".join(f"[{k}]\n{v}\n" for k, v in sections.items() if v is not None)


def write(folder: Path, **changes: str | None) -> Path:
    """The study file, with top.csv beside it unless there is one."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "top.csv").exists():
        (folder / "top.csv").write_text(measured())
    (folder / "study.toml").write_text(text(**changes), encoding="utf-8")
    return folder / "study.toml"


def run(folder: Path, **changes: str | None) -> dict[str, Any]:
    """Results of the study, as they stand in the file."""
    plan = make_plan(load_study(write(folder, **changes)))
    with RunStore(folder / "results") as store:
        run_study(plan, store, Inline(), folder / "results", command="test", jobs=1)
    return read(folder)


def read(folder: Path) -> dict[str, Any]:
    """results.json of a study."""
    return json.loads((folder / "results" / "results.json").read_text(encoding="utf-8"))


def timeless(results: dict[str, Any]) -> dict[str, Any]:
    """Results without what says when and how they were computed rather than what came out."""
    clean = {k: v for k, v in results.items() if k not in ("timings", "provenance")}
    clean["counts"] = {k: v for k, v in results["counts"].items() if k != "from_store"}
    clean["runs"] = [{k: v for k, v in r.items() if k not in ("wall_s", "cpu_s")} for r in results["runs"]]
    when = ("started", "finished", "command", "jobs")
    clean["provenance"] = {k: v for k, v in results["provenance"].items() if k not in when}
    return clean
