"""results.json: what every stage found, as documented in docs/results.md; written after each stage."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import os
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rso
from rso.calibration.plan import Plan
from rso.calibration.readings import measured, profile_positions
from rso.calibration.search_stage import SearchResult, Validation, baselines, mean_over_design
from rso.calibration.stages import Design, FittedSurrogates, Run
from rso.calibration.stated_settings import (
    doubts_of_sizes,
    extraordinary,
    replaced,
    uncalibrated_experiments,
    unresolved_experiments,
)
from rso.contract import plain
from rso.core import disk
from rso.data import MeasuredCurve, sheet_of
from rso.emulation import Scores
from rso.emulation.emulator import Emulator, Output
from rso.emulation.feasibility import FeasibleRegion
from rso.evaluation import Done, Outcome, why
from rso.study.cases import sketches
from rso.study.schema import Study

RUN_SCHEMA = 1  # of results.json; raised when keys change their meaning
SURFACE_POINTS_PER_SIDE = 41  # points a side of a drawn response surface
VERSIONED_PACKAGES = (
    "numpy",
    "scipy",
    "scikit-learn",
    "pymoo",
    "scikit-fem",
    "pytetwild",
    "pymetis",
    "numba",
    "pypardiso",
)


def begun_results(plan: Plan, command: str, started: str, jobs: int) -> dict[str, Any]:
    """The part that is known before anything runs."""
    study = plan.study
    return {
        "schema": RUN_SCHEMA,
        "stage": "plan",
        "study": {
            "title": study.study.title,
            "file": study.file.name,
            "seed": study.study.seed,
            "units": study.study.units,
        },
        "backend": {
            "name": plan.backend.name,
            "numerics": plan.backend.numerics,
            "settings": plain(study.written(study.backend.settings)),
        },
        "parameters": parameter_rows(plan, plan),
        "sketches": sketches(study, plan.backend),
        "experiments": [_experiment(plan, e.name) for e in study.experiments if e.name in plan.curves],
        "outputs": [_output(o) for o in (*plan.outputs, *plan.extras)],
        "verify": {"tolerance": study.verify.tolerance, "max_infill": study.verify.max_infill},
        "metric": study.search.metric,
        "baseline": {e: dataclasses.asdict(m) for e, m in baselines(plan).items()},
        "warnings": [
            *(f"{e.name}, {doubt}" for e in study.experiments for doubt in study.measurement(e.name).doubts),
            *(f"experiment {e.name!r}: {lost}" for e in study.experiments for lost in replaced(study, e.name)),
            *(
                f"{e.name}, {words}"
                for e in study.experiments
                if e.name in plan.curves
                for words in doubts_of_sizes(plan, e.name)
            ),
            *extraordinary(plan),
            *uncalibrated_experiments(plan),
            *unresolved_experiments(plan),
            *plan.of_relaxation(),
        ],
        "timings": {},
        "provenance": {
            "rso": rso.__version__,
            "python": platform.python_version(),
            "packages": _versions(),
            "command": command,
            "study_sha256": study.sha256,
            "data_sha256": data_hashes(study),
            "artefacts": {},
            "started": started,
            "finished": None,
            "cores": os.cpu_count(),
            "jobs": jobs,
            "solver": None,
        },
    }


def design_block(plan: Plan, design: Design) -> dict[str, Any]:
    """design and the runs so far."""
    table = plan.study.doe
    needed = sum(r.purpose in ("design", "held_out", "proof") for r in design.runs)
    saved = max(0, len(design.asked) + table.held_out - needed) if design.similar else 0
    return {
        "design": {
            "kind": table.kind,
            "asked": len(design.asked),
            "points": [plan.values(x) for x in design.asked],
            "held_out": table.held_out if any(r.purpose == "held_out" for r in design.runs) else 0,
            "similarity": {
                "applied": design.similar,
                "story": design.story,
                "reference": plan.group.reference if design.similar else None,
                "runs_saved": saved,
                "proof": [dataclasses.asdict(p) for p in design.proofs],
            },
        },
        "runs": [run for r in design.runs for run in _runs(plan, r)],
    }


def predictive_check_runs(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of `runs` for single cases that none of the outputs belongs to."""
    return [_row(o, r.purpose, r.values, {}) for r in runs for o in r.outcomes]


def run_rows(plan: Plan, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of `runs`."""
    return [row for r in runs for row in _runs(plan, r)]


def added_runs(plan: Plan, fitted: FittedSurrogates) -> list[dict[str, Any]]:
    """Rows of `runs` for the points that were added to make the surrogates good enough."""
    return [row for r in fitted.added for row in _runs(plan, r)]


def of_surrogates(plan: Plan, design: Design, fitted: FittedSurrogates) -> dict[str, Any]:
    """surrogates, surfaces, mean_over_runs."""
    emulator = fitted.emulator
    rows = []
    for output in emulator.outputs:
        model = emulator.surrogates.get(output.id)
        rows.append(
            {
                "output": output.id,
                "unit": output.unit,
                "kind": "exact" if model is None else model.kind,
                "story": "similarity leaves no dimension: one run says all" if model is None else model.story,
                "n": len(emulator.samples),
                "spread": emulator.spread(output),
                "cross_validation": None if model is None else _scores(model.cv),
                "held_out": _scores(fitted.held_out.get(output.id)),
            }
        )
    shown = list(dict.fromkeys([*plan.searches[0].outputs, *(o for o in emulator.outputs if o in plan.extras)]))
    return {
        "surrogates": rows,
        "surfaces": [_surface(plan, emulator, o) for o in shown],
        "mean_over_runs": {e: dataclasses.asdict(m) for e, m in mean_over_design(plan, design, emulator).items()},
    }


def of_region(plan: Plan, region: FeasibleRegion | None, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """feasible: where runs have an answer, and a map over the first two open parameters."""
    failed = {r["key"]: r["cause"] for r in runs if r["state"] == "failed"}
    shown: dict[str, Any] = {
        "failed": len(failed),
        "causes": dict(Counter(failed.values())),
        "share_infeasible": 0.0,
        "story": "",
        "map": None,
    }
    if region is not None and region.model is not None:
        shown["share_infeasible"], shown["story"] = region.share(plan.box, plan.seed), region.story()
        if plan.box.d > 1:
            x, y, X = _grid(plan)
            theta = dict(zip(plan.box.names, plan.box.from_unit(X).T, strict=True))
            shown["map"] = {
                "x": x,
                "y": y,
                "probability": region.probability(theta).reshape(SURFACE_POINTS_PER_SIDE, SURFACE_POINTS_PER_SIDE),
            }
    return {"feasible": shown}


def candidate_runs(plan: Plan, found: SearchResult) -> list[dict[str, Any]]:
    """Rows of `runs` for the infill of a search (candidates of its earlier rounds), then for its candidates."""
    last = [c.values for c in found.result.candidates]
    earlier = [Run("infill", c.values, c.outcomes) for c in found.result.earlier if c.values not in last]
    candidates = [Run("candidate", c.values, c.outcomes) for c in found.result.candidates]
    return [row for run in (*earlier, *candidates) for row in _runs(plan, run)]


def validation_runs(found: list[Validation]) -> list[dict[str, Any]]:
    """Rows of `runs` for the experiments kept for the end."""
    rows = [_row(v.outcome, "validate", v.values, {}) for v in found]
    return list({r["key"]: r for r in rows}.values())  # channels of one experiment are one run


# ------------------------------------------------------------------------------------------------------ pieces


def parameter_rows(stated: Plan, plan: Plan) -> list[dict[str, Any]]:
    """parameters, with the ranges of the study file and those that the main search came to use."""
    opened, written = ({a.name: a for a in p.resolved.axes} for p in (plan, stated))
    rows = []
    for p in plan.backend.parameters:
        axis, fixed = opened.get(p.name), plan.resolved.fixed.get(p.name)
        if axis is not None or fixed is not None:
            rows.append(
                {
                    "name": p.name,
                    "description": p.description,
                    "unit": p.unit,
                    "low": axis.low if axis else fixed,
                    "high": axis.high if axis else fixed,
                    "log": bool(axis and axis.scale == "log"),
                    "fixed": fixed,
                    "stated": [written[p.name].low, written[p.name].high] if axis else [fixed, fixed],
                }
            )
    return rows


def _experiment(plan: Plan, name: str) -> dict[str, Any]:
    e, said = plan.study.experiment(name), plan.remarks(name, inline=True)
    curve = measured(plan, name, plan.curves[name].channel)
    others = [measured(plan, name, c) for c in e.compared[1:]]
    creep = plan.creeps.followed.get(name)
    return {
        "name": name,
        "role": e.role,
        "kind": e.kind,
        **({} if creep is None else {"creep": {"held_N": creep.force, "rise_s": creep.rise, "grows_mm": creep.grows}}),
        "channel": curve.channel,
        "unit": curve.unit,
        "settings": plan.study.written(plan.study.settings_of(name)),
        "file": e.files,
        "notes": [*said, *plan.study.measurement(name).notes],
        "remarks": len(said),
        "n_repeats": curve.n_repeats,
        "measured": _measured(curve),
        "others": [{"channel": c.channel, "unit": c.unit, "measured": _measured(c)} for c in others],
    }


def _measured(c: MeasuredCurve) -> dict[str, Any]:
    place = {"depth": c.depth, "value": c.value, "sigma": c.sigma, "position": profile_positions(c.position)}
    return place if c.since is None else {**place, "since": c.since}


def _output(o: Output) -> dict[str, Any]:
    held = {"since_s": o.since_s} if o.since_s else {}
    place = {"experiment": o.experiment, "channel": o.channel, "depth_mm": o.depth_mm, "unit": o.unit}
    return {"id": o.id, **place, **held}


def _runs(plan: Plan, run: Run) -> list[dict[str, Any]]:
    rows = []
    cases = range(len(run.outcomes)) if run.cases is None else run.cases
    for k, outcome in zip(cases, run.outcomes, strict=True):
        outputs = {}
        if isinstance(outcome, Done):
            mine = [o for o in (*plan.outputs, *plan.extras) if plan.case_of[o.experiment] == k]
            outputs = {o.id: o.read(outcome.response) for o in mine}
        rows.append(_row(outcome, run.purpose, run.values, outputs))
    return rows


def _row(outcome: Outcome, purpose: str, values: Mapping[str, float], outputs: Mapping[str, float]) -> dict[str, Any]:
    cause, reason = why(outcome)
    return {
        "key": outcome.key,
        "purpose": purpose,
        "state": type(outcome).__name__.lower(),
        "values": dict(values),
        "outputs": dict(outputs),
        "cause": cause,
        "reason": reason,
        "wall_s": getattr(outcome, "wall_s", None),
        "cpu_s": getattr(outcome, "cpu_s", None),
    }


def _surface(plan: Plan, emulator: Emulator, output: Output) -> dict[str, Any]:
    """One output over the first two open parameters (or the only one), the others in the middle."""
    box, d = plan.box, plan.box.d
    x, y, X = _grid(plan)
    mean, sd = emulator.predict(output, X)
    middle = box.from_unit(np.full((1, d), 0.5))[0]
    return {
        "output": output.id,
        "unit": output.unit,
        "x": x,
        "y": y,
        "mean": mean.reshape(-1, SURFACE_POINTS_PER_SIDE),
        "sd": sd.reshape(-1, SURFACE_POINTS_PER_SIDE),
        "others": {box.names[k]: middle[k] for k in range(2, d)},
    }


def _grid(plan: Plan) -> tuple[dict[str, Any], dict[str, Any] | None, np.ndarray]:
    """Ticks of the first two open parameters and all points (n, d) of the unit cube between them, a row per y."""
    box, d = plan.box, plan.box.d
    t = np.linspace(0.0, 1.0, SURFACE_POINTS_PER_SIDE)
    X = np.full((SURFACE_POINTS_PER_SIDE if d == 1 else SURFACE_POINTS_PER_SIDE * SURFACE_POINTS_PER_SIDE, d), 0.5)
    X[:, 0] = t if d == 1 else np.tile(t, SURFACE_POINTS_PER_SIDE)
    if d > 1:
        X[:, 1] = np.repeat(t, SURFACE_POINTS_PER_SIDE)
    ticks = box.from_unit(np.tile(t[:, None], (1, d)))
    x, *y = ({"parameter": box.names[k], "values": ticks[:, k]} for k in range(min(d, 2)))
    return x, (y[0] if y else None), X


def _scores(scores: Scores | None) -> dict[str, Any] | None:
    if scores is None:
        return None
    return {k: getattr(scores, k) for k in ("rmse", "max_abs", "relative_rmse", "q2", "n")}


def _versions() -> dict[str, str]:
    found = {}
    for name in VERSIONED_PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def data_hashes(study: Study) -> dict[str, str]:
    """SHA-256 of every data file, whichever of its sheets is read."""
    return {f: _sha(sheet_of(study.folder / f)[0]) for e in study.experiments for f in e.data}


def _sha(path: Path) -> str:
    return hashlib.sha256(disk.read_bytes(path)).hexdigest()
