"""results.json: what every stage found, as documented in docs/results.md; written after each stage."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import math
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rso
from rso.contract import plain
from rso.emulator import Emulator, Output
from rso.running import Outcome
from rso.store import Done
from rso.study.plan import Plan, SearchPlan
from rso.study.searching import Found, Validation, baselines, mean_over_design
from rso.study.stages import Design, Fitted, Run, Sensitivity, why
from rso.surrogates import Scores

SCHEMA = 1
GRID = 41  # points a side of a drawn response surface
DETERMINED = 0.15  # half-width of the acceptable range, as a share of its middle, up to which a value is determined
PACKAGES = ("numpy", "scipy", "scikit-learn", "pymoo", "scikit-fem", "pytetwild", "pymetis", "numba", "pypardiso")


def write(path: Path, results: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the file in one step, so that a reader never sees half of it; returns what was written, plain."""
    data: dict[str, Any] = _finite(plain(results))
    temporary = path.with_suffix(".tmp")
    temporary.write_text(json.dumps(data, indent=1, allow_nan=False), encoding="utf-8")
    os.replace(temporary, path)
    return data


def write_runs(path: Path, found: Mapping[str, Any]) -> None:
    """All runs as a table: state, values with units, outputs; empty cells where a run has no answer."""
    units = {p["name"]: p["unit"] for p in found["parameters"]}
    rows = [
        {k: r[k] for k in ("key", "purpose", "state", "cause", "reason", "wall_s", "cpu_s")}
        | {f"{n} [{units.get(n, '')}]": v for n, v in r["values"].items()}
        | r["outputs"]
        for r in found["runs"]
    ]
    pd.DataFrame(rows).to_csv(path, index=False)


def begin(plan: Plan, command: str, started: str, jobs: int) -> dict[str, Any]:
    """The part that is known before anything runs."""
    study = plan.study
    return {
        "schema": SCHEMA,
        "stage": "plan",
        "study": {
            "title": study.study.title, "file": study.file.name, "seed": study.study.seed, "units": study.study.units,
        },
        "backend": {
            "name": plan.backend.name, "numerics": plan.backend.numerics, "settings": plain(study.backend.settings),
        },
        "parameters": _parameters(plan),
        "experiments": [_experiment(plan, e.name) for e in study.experiments if e.name in plan.curves],
        "outputs": [_output(o) for o in (*plan.outputs, *plan.extras)],
        "verify": {"tolerance": study.verify.tolerance, "max_infill": study.verify.max_infill},
        "metric": study.search.metric,
        "baseline": {e: dataclasses.asdict(m) for e, m in baselines(plan).items()},
        "warnings": [],
        "timings": {},
        "provenance": {
            "rso": rso.__version__,
            "python": platform.python_version(),
            "packages": _versions(),
            "command": command,
            "study_sha256": _sha(study.file),
            "data_sha256": {e.data: _sha(study.folder / e.data) for e in study.experiments},
            "artefacts": {},
            "started": started,
            "finished": None,
            "cores": os.cpu_count(),
            "jobs": jobs,
            "solver": None,
        },
    }  # fmt: skip


def of_design(plan: Plan, design: Design) -> dict[str, Any]:
    """design and the runs so far."""
    table = plan.study.doe
    needed = sum(r.purpose in ("design", "held_out", "proof") for r in design.runs)
    saved = max(0, len(design.asked) + table.held_out - needed) if design.similar else 0
    return {
        "design": {
            "kind": table.kind,
            "asked": len(design.asked),
            "points": [plan.values(x) for x in design.asked],
            "held_out": sum(r.purpose == "held_out" for r in design.runs),
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


def added_runs(plan: Plan, fitted: Fitted) -> list[dict[str, Any]]:
    """Rows of `runs` for the points that were added to make the surrogates good enough."""
    return [row for r in fitted.added for row in _runs(plan, r)]


def of_surrogates(plan: Plan, design: Design, fitted: Fitted) -> dict[str, Any]:
    """surrogates, surfaces, mean_over_runs."""
    emulator = fitted.emulator
    rows = []
    for output in emulator.outputs:
        model = emulator.surrogates.get(output.id)
        rows.append(
            {
                "output": output.id,
                "unit": output.unit,
                "kind": "exact" if model is None else type(model).__name__.lower(),
                "story": "similarity leaves no dimension: one run says all" if model is None else model.story,
                "n": len(emulator.samples),
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


def of_sensitivity(plan: Plan, found: Sensitivity) -> dict[str, Any]:
    """sensitivity."""
    local = [
        {"output": o, "parameter": b.name, "low": b.at_low, "high": b.at_high, "change": b.change,
         "elasticity": b.elasticity}
        for o, bars in found.local.items()
        for b in bars
    ]  # fmt: skip
    sobol = [
        {"output": o, "parameter": n, "first": s.first[k], "first_interval": s.first_interval[k],
         "total": s.total[k], "total_interval": s.total_interval[k]}
        for o, s in found.sobol.items()
        for k, n in enumerate(plan.box.names)
    ]  # fmt: skip
    logs = [n for n, log in zip(plan.box.names, plan.box.log, strict=True) if log]
    story = (
        "Local: one parameter goes over its range, the others stay in the middle of theirs; elasticity is "
        "d ln y / d ln theta there. Sobol: shares of the variance when all parameters vary independently and "
        f"uniformly over their ranges{' (in the logarithm of ' + ', '.join(logs) + ')' if logs else ''}."
    )
    return {"sensitivity": {"at": plan.values(found.at), "local": local, "sobol": sobol, "story": story}}


def of_searches(plan: Plan, found: list[Found]) -> dict[str, Any]:
    """searches, best, determined; the runs of candidates are added to `runs` by the caller."""
    first = best(plan, found)
    return {
        "searches": [_search(plan, f) for f in found],
        "best": None if first is None else {"search": first[0], "candidate": f"{first[0]} {first[1] + 1}"},
        "determined": determined(plan, found[0]) if found else {},
    }


def candidate_runs(plan: Plan, found: Found) -> list[dict[str, Any]]:
    """Rows of `runs` for the infill of a search (candidates of its earlier rounds), then for its candidates."""
    last = [c.values for c in found.result.candidates]
    earlier = [Run("infill", c.values, c.outcomes) for c in found.result.earlier if c.values not in last]
    candidates = [Run("candidate", c.values, c.outcomes) for c in found.result.candidates]
    return [row for run in (*earlier, *candidates) for row in _runs(plan, run)]


def validation_runs(found: list[Validation]) -> list[dict[str, Any]]:
    """Rows of `runs` for the experiments kept for the end."""
    return [_row(v.outcome, "validate", v.values, {}) for v in found]


def of_validation(plan: Plan, found: list[Validation]) -> dict[str, Any]:
    """validation."""
    rows = []
    for v in found:
        cause, reason = why(v.outcome)
        rows.append(
            {
                "experiment": v.experiment, "search": v.search, "candidate": f"{v.search} {v.candidate + 1}",
                "state": type(v.outcome).__name__.lower(), "cause": cause, "reason": reason, "depth": v.depth,
                "measured": v.measured, "sigma": v.sigma, "predicted": [] if v.predicted is None else v.predicted,
                "metrics": None if v.metrics is None else dataclasses.asdict(v.metrics),
            }
        )  # fmt: skip
    return {"validation": rows}


def best(plan: Plan, found: list[Found]) -> tuple[str, int] | None:
    """Search and place of the verified candidate with the smallest study metric, averaged over the fitted curves."""
    metric = plan.study.search.metric
    scored = [
        (float(np.mean([getattr(m, metric) for m in scores.values()])), f.plan.name, k)
        for f in found
        for k, (c, scores) in enumerate(zip(f.result.candidates, f.metrics, strict=True))
        if c.verified and scores
    ]
    scored = [s for s in scored if math.isfinite(s[0])]
    if not scored:
        return None
    _, name, k = min(scored)
    return name, k


def determined(plan: Plan, main: Found) -> dict[str, Any]:
    """Which parameters the targets of the main search determine: the range that hits all of them within noise."""
    choice, search = main.result.choice, main.plan
    lowest, highest = choice.lowest, choice.highest
    if not choice.reachable:
        return {
            n: {
                "determined": False,
                "interval": [None, None],
                "story": "The targets are not reachable in these ranges.",
            }
            for n in plan.box.names
        }
    low, high = plan.box.from_unit(np.stack([lowest, highest]))
    result = {}
    for k, (name, unit) in enumerate(zip(plan.box.names, plan.box.units, strict=True)):
        a, b = float(low[k]), float(high[k])
        margin = 0.02 * (search.high[k] - search.low[k])
        ends = [
            word
            for word, gap in (("lower", lowest[k] - search.low[k]), ("upper", search.high[k] - highest[k]))
            if gap < margin
        ]
        half = (b - a) / (b + a) if a + b > 0 else math.inf
        good = half <= DETERMINED and not ends
        text = f"Every value from {a:.3g} to {b:.3g} {unit} hits all targets within their uncertainty"
        if ends:
            text += f"; the range goes to the {' and the '.join(ends)} bound of the search"
        text += f" (±{100 * half:.0f} %)." if good else ": the data do not determine it."
        result[name] = {"determined": bool(good), "interval": [a, b], "story": text}
    return result


# ------------------------------------------------------------------------------------------------------ pieces


def _parameters(plan: Plan) -> list[dict[str, Any]]:
    opened = {a.name: a for a in plan.resolved.axes}
    rows = []
    for p in plan.backend.parameters:
        axis, fixed = opened.get(p.name), plan.resolved.fixed.get(p.name)
        if axis is not None or fixed is not None:
            rows.append(
                {
                    "name": p.name, "description": p.description, "unit": p.unit,
                    "low": axis.low if axis else fixed, "high": axis.high if axis else fixed,
                    "log": bool(axis and axis.scale == "log"), "fixed": fixed,
                }
            )  # fmt: skip
    return rows


def _experiment(plan: Plan, name: str) -> dict[str, Any]:
    e, curve = plan.study.experiment(name), plan.curves[name]
    return {
        "name": name, "role": e.role, "channel": curve.channel, "unit": curve.unit,
        "settings": plan.study.settings_of(name), "file": e.data, "notes": list(plan.study.measurement(name).notes),
        "n_repeats": curve.n_repeats,
        "measured": {"depth": curve.depth, "value": curve.value, "sigma": curve.sigma},
    }  # fmt: skip


def _output(o: Output) -> dict[str, Any]:
    return {"id": o.id, "experiment": o.experiment, "channel": o.channel, "depth_mm": o.depth_mm, "unit": o.unit}


def _runs(plan: Plan, run: Run) -> list[dict[str, Any]]:
    rows = []
    for k, outcome in enumerate(run.outcomes):
        outputs = {}
        if isinstance(outcome, Done):
            mine = [o for o in (*plan.outputs, *plan.extras) if plan.case_of[o.experiment] == k]
            outputs = {o.id: o.read(outcome.response) for o in mine}
        rows.append(_row(outcome, run.purpose, run.values, outputs))
    return rows


def _row(outcome: Outcome, purpose: str, values: Mapping[str, float], outputs: Mapping[str, float]) -> dict[str, Any]:
    cause, reason = why(outcome)
    return {
        "key": outcome.key, "purpose": purpose, "state": type(outcome).__name__.lower(), "values": dict(values),
        "outputs": dict(outputs), "cause": cause, "reason": reason, "wall_s": getattr(outcome, "wall_s", None),
        "cpu_s": getattr(outcome, "cpu_s", None),
    }  # fmt: skip


def _surface(plan: Plan, emulator: Emulator, output: Output) -> dict[str, Any]:
    """One output over the first two open parameters (or the only one), the others in the middle."""
    box, d = plan.box, plan.box.d
    t = np.linspace(0.0, 1.0, GRID)
    X = np.full((GRID if d == 1 else GRID * GRID, d), 0.5)
    X[:, 0] = t if d == 1 else np.tile(t, GRID)
    if d > 1:
        X[:, 1] = np.repeat(t, GRID)
    mean, sd = emulator.predict(output, X)
    ticks = box.from_unit(np.tile(t[:, None], (1, d)))
    middle = box.from_unit(np.full((1, d), 0.5))[0]
    return {
        "output": output.id,
        "unit": output.unit,
        "x": {"parameter": box.names[0], "values": ticks[:, 0]},
        "y": {"parameter": box.names[1], "values": ticks[:, 1]} if d > 1 else None,
        "mean": mean.reshape(-1, GRID),
        "sd": sd.reshape(-1, GRID),
        "others": {box.names[k]: middle[k] for k in range(2, d)},
    }


def _search(plan: Plan, found: Found) -> dict[str, Any]:
    choice, front = found.result.choice, found.front
    return {
        "name": found.plan.name,
        "targets": [dataclasses.asdict(g) for g in found.plan.goals],
        "ranges": {a.name: [a.low, a.high] for a in found.plan.axes},
        "kind": choice.kind,
        "reachable": choice.reachable,
        "story": found.story,
        "front": {"values": [plan.values(x) for x in front.X], "objectives": front.F},
        "candidates": [_candidate(plan, found, k) for k in range(len(found.result.candidates))],
        "infill": found.result.infill,
        "verified": found.result.verified,
    }


def _candidate(plan: Plan, found: Found, k: int) -> dict[str, Any]:
    c, goals = found.result.candidates[k], {o.id: g for o, g in zip(found.plan.outputs, found.plan.goals, strict=True)}
    emulator = found.result.emulator
    errors = {}
    curves = {}
    if c.state == "done":
        for name, index in plan.case_of.items():
            curve = c.outcomes[index].response.curve(plan.curves[name].channel)
            curves[name] = {
                "channel": curve.channel, "depth": curve.travel_mm, "value": curve.value, "error": curve.error,
            }  # fmt: skip
            for o in emulator.outputs:
                if o.experiment == name:
                    full = c.outcomes[index].response.curve(o.channel)
                    errors[o.id] = float(np.interp(o.depth_mm, full.travel_mm, full.error))
    shown = list(dict.fromkeys([*found.plan.outputs, *(o for o in emulator.outputs if o in plan.extras)]))
    return {
        "name": f"{found.plan.name} {k + 1}",
        "values": dict(c.values),
        "state": c.state,
        "outputs": [
            {
                "output": o.id, "predicted": c.predicted[o.id][0], "sd": c.predicted[o.id][1],
                "recomputed": c.recomputed.get(o.id), "numerical_error": errors.get(o.id),
                "target": goals[o.id].value if o.id in goals else None,
            }
            for o in shown
        ],
        "agreement": c.agreement,
        "verified": c.verified,
        "curves": curves,
        "metrics": {e: dataclasses.asdict(m) for e, m in found.metrics[k].items()},
        "at_bound": at_bound(found.plan, plan, c.values),
    }  # fmt: skip


def at_bound(search: SearchPlan, plan: Plan, values: Mapping[str, float]) -> list[str]:
    """Parameters within 1 % of the width of the search's range of one of its ends."""
    x = plan.box.to_unit(np.array([[values[n] for n in plan.box.names]]))[0]
    width = np.maximum(search.high - search.low, 1e-12)
    near = np.minimum(np.abs(x - search.low), np.abs(search.high - x)) < 0.01 * width
    return [n for n, close in zip(plan.box.names, near, strict=True) if close]


def _scores(scores: Scores | None) -> dict[str, Any] | None:
    if scores is None:
        return None
    return {k: getattr(scores, k) for k in ("rmse", "max_abs", "relative_rmse", "q2", "n")}


def _versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _finite(data: Any) -> Any:
    """NaN and infinities become null: JSON has no word for them."""
    if isinstance(data, dict):
        return {k: _finite(v) for k, v in data.items()}
    if isinstance(data, list):
        return [_finite(v) for v in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
