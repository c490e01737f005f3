"""results.json of a study with objectives, as plain data and in words (layout in docs/objectives.md)."""

from __future__ import annotations

import dataclasses
import math
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import rso
from rso.calibration.exit_codes import EXIT_FAILED_RUNS, EXIT_NOT_MET, EXIT_NOT_VERIFIED
from rso.contract import digest
from rso.core import disk, plain_results
from rso.core.plain_results import plainly, written_cell
from rso.core.units import spaced
from rso.emulation import Scores
from rso.objectives.front import knee
from rso.objectives.plan import ParetoPlan
from rso.objectives.runs import ParetoRun, limit_misses, objectives_of
from rso.objectives.solving import ParetoCandidate, ParetoOutcome
from rso.objectives.surfaces import nondominated

PARETO_SCHEMA, PARETO_KIND = 1, "pareto"  # raised when keys of the file change their meaning
RUN_COLUMNS = ("key", "purpose", "state", "within_limits", "best", "cause", "reason", "wall_s", "cpu_s")


def pareto_data(found: ParetoOutcome, command: str, jobs: int) -> dict[str, Any]:
    """Everything that the page shows, as strict JSON data."""
    plan = found.plan
    best = _best_runs(found)
    data: dict[str, Any] = {
        "schema": PARETO_SCHEMA,
        "kind": PARETO_KIND,
        "study": {
            "title": plan.study.study.title,
            "file": plan.study.file.name,
            "seed": plan.seed,
            "units": plan.study.study.units,
        },
        "backend": {"name": plan.backend.name, "numerics": plan.backend.numerics},
        "parameters": _parameters(plan),
        "objectives": [{"quantity": o.quantity.text, "unit": o.unit, "minimise": o.minimise} for o in plan.objectives],
        "constraints": [
            {"text": c.text, "quantity": c.quantity.text, "unit": c.unit, "low": c.low, "high": c.high}
            for c in plan.limits
        ],
        "conditions": [c.text for c in plan.conditions],
        "units": plan.units,
        "design": {"kind": plan.study.doe.kind, "runs": len(found.design), "held_out": len(found.held)},
        "runs": [_run(plan, r, best) for r in _distinct(found.runs)],
        "surfaces": [_surface(found, text) for text in found.surfaces.each],
        "sensitivity": _sensitivity(found),
        "front": _front(found),
        "candidates": [_candidate(plan, k, c) for k, c in enumerate(found.candidates)],
        "rounds": found.rounds,
        "verify": {"tolerance": plan.study.verify.tolerance, "max_infill": plan.study.verify.max_infill},
        "search": {
            "method": plan.study.search.method,
            "population": plan.study.search.population,
            "generations": plan.study.search.generations,
        },
        "warnings": list(found.warnings),
        "counts": _counts(found),
        "timings": dict(found.timings),
        "provenance": {
            "rso": rso.__version__,
            "python": platform.python_version(),
            "command": command,
            "study_sha256": digest(disk.read_bytes(plan.study.file).hex()),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "jobs": jobs,
        },
    }
    data["best_runs"] = [r["key"] for r in data["runs"] if r["best"]]
    data["words"] = pareto_sentences(data)
    data["exit_code"], data["exit_reason"] = pareto_exit_code(data)
    return plainly(data)


def write_pareto(folder: Path, data: dict[str, Any]) -> dict[str, Any]:
    """results.json and runs.csv in `folder`; the data."""
    plain_results.write_results(folder / "results.json", data)
    units = {p["name"]: p["unit"] for p in data["parameters"]} | data["units"]
    import pandas as pd

    rows = []
    for r in data["runs"]:
        head = {
            k: r[k] for k in ("key", "purpose", "state", "within_limits", "best", "cause", "reason", "wall_s", "cpu_s")
        }
        named = {f"{n} [{units.get(n, '1')}]": v for n, v in {**r["values"], **(r["outputs"] or {})}.items()}
        rows.append({written_cell(k): written_cell(v) for k, v in {**head, **named}.items()})
    disk.replace(folder / "runs.csv", pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))
    return data


def _distinct(runs: list[ParetoRun]) -> list[ParetoRun]:
    return list({r.outcome.key: r for r in reversed(runs)}.values())[::-1]


def _parameters(plan: ParetoPlan) -> list[dict[str, Any]]:
    space, rows = plan.space, []
    for j, p in enumerate(plan.parameters):
        low, high = space.box.low[j], space.box.high[j]
        choices = list(space.labels[j]) or None
        rows.append(
            {
                "name": p.name,
                "unit": p.unit,
                "description": p.description,
                "low": None if choices else low,
                "high": None if choices else high,
                "scale": "log" if space.box.log[j] else "linear",
                "values": None if choices or not space.levels[j] else list(space.levels[j]),
                "choices": choices,
                "fixed": None,
            }
        )
    known = {p.name: p for p in plan.backend.parameters}
    for name, value in plan.fixed.items():
        p = known[name]
        shown = p.choices[round(value)] if p.choices else value
        rows.append({"name": name, "unit": p.unit, "description": p.description, "low": None, "high": None,
                     "scale": "linear", "values": None, "choices": None, "fixed": shown})  # fmt: skip
    return rows


def _best_runs(found: ParetoOutcome) -> set[str]:
    """Keys of the runs that keep all limits and that no other such run beats in every objective."""
    good = [r for r in _distinct(found.runs) if r.y is not None and not limit_misses(found.plan, r.y)]
    good = [r for r in good if found.plan.feasible(r.u[None])[0]]
    if not good:
        return set()
    F = np.array([objectives_of(found.plan, r.y) for r in good if r.y is not None])
    return {r.outcome.key for r, keep in zip(good, nondominated(F), strict=True) if keep}


def _run(plan: ParetoPlan, r: ParetoRun, best: set[str]) -> dict[str, Any]:
    own = None if r.y is None else not limit_misses(plan, r.y)
    return {
        "key": r.outcome.key,
        "purpose": r.purpose,
        "state": r.state,
        "values": plan.space.worded(plan.space.mapping(r.u)),
        "outputs": r.y,
        "within_limits": own,
        "best": r.outcome.key in best,
        "cause": getattr(r.outcome, "cause", None),
        "reason": r.reason,
        "wall_s": getattr(r.outcome, "wall_s", None),
        "cpu_s": getattr(r.outcome, "cpu_s", None),
    }


def _scores(s: Scores | None) -> dict[str, Any] | None:
    return None if s is None else dataclasses.asdict(s)


def _surface(found: ParetoOutcome, text: str) -> dict[str, Any]:
    s = found.surfaces.each[text]
    return {
        "quantity": text,
        "unit": s.unit,
        "spread": s.spread,
        "story": s.story,
        "cross_validation": _scores(s.left_out),
        "held_out": _scores(found.held_scores.get(text)),
    }


def _sensitivity(found: ParetoOutcome) -> dict[str, Any]:
    s, names = found.sensitivities, found.plan.space.names
    sobol = {
        text: [
            {"parameter": n, "first": i.first[j], "total": i.total[j], "first_interval": list(i.first_interval[j]),
             "total_interval": list(i.total_interval[j])}
            for j, n in enumerate(names)
        ]
        for text, i in s.indices.items()
    }  # fmt: skip
    morris = {
        text: [
            {"parameter": n, "mean": m.mu[j], "mean_size": m.mu_star[j], "deviation": m.sigma[j]}
            for j, n in enumerate(names)
        ]
        for text, m in s.effects.items()
    }
    slices = [
        {"parameter": c.parameter, "quantity": c.quantity, "values": _words(found.plan, c.parameter, c.theta), "y": c.y,
         "sd": c.sd}
        for c in s.slices
    ]  # fmt: skip
    centre = found.plan.space.worded(found.plan.space.mapping(s.centre))
    return {"sobol": sobol, "morris": morris, "slices": slices, "centre": centre}


def _words(plan: ParetoPlan, name: str, theta: np.ndarray) -> list[float | str]:
    labels = plan.space.labels[plan.space.names.index(name)]
    return [plan.space.text(name, v) if labels else float(v) for v in theta]


def _front(found: ParetoOutcome) -> dict[str, Any]:
    plan, front = found.plan, found.front
    signs = [o.sign for o in plan.objectives]
    names = [o.quantity.text for o in plan.objectives]
    points = [
        {
            "values": plan.space.worded(plan.space.mapping(u)),
            "objectives": {n: s * v for n, s, v in zip(names, signs, f, strict=True)},
        }
        for u, f in zip(front.U, front.F, strict=True)
    ]
    return {
        "feasible": front.feasible,
        "points": points,
        "knee": knee(front.F) if len(front.F) and len(names) > 1 else None,
        "hypervolume": front.hypervolume,
        "evaluations": front.evaluations,
    }


def _candidate(plan: ParetoPlan, k: int, c: ParetoCandidate) -> dict[str, Any]:
    return {
        "name": f"candidate {k + 1}",
        "key": c.run.outcome.key,
        "state": c.run.state,
        "reason": c.run.reason,
        "values": plan.space.worded(plan.space.mapping(c.u)),
        "predicted": c.predicted,
        "simulated": c.run.y,
        "difference": c.difference,
        "worst": c.worst,
        "verified": c.verified,
        "misses": c.misses,
        "meets": c.run.y is not None and not c.misses,
    }


def _counts(found: ParetoOutcome) -> dict[str, int]:
    states = [r.state for r in _distinct(found.runs)]
    return {"runs": len(states), **{s: states.count(s) for s in ("done", "failed", "crashed")}}


def pareto_exit_code(data: Mapping[str, Any]) -> tuple[int, str | None]:
    """Exit code and its reason: 4 not verified, 6 no candidate keeps the limits, 3 runs without an answer, else 0."""
    bad = [c for c in data["candidates"] if not c["verified"]]
    if bad:
        c, tolerance = bad[0], 100 * data["verify"]["tolerance"]
        why = (
            f"{c['worst']} differs by {100 * c['difference']:.2g} % from its prediction" if c["worst"] else c["reason"]
        )
        count = f"{len(bad)} of {len(data['candidates'])} candidates are not verified"
        return EXIT_NOT_VERIFIED, f"{count}: of {c['name']} {why}; verify.tolerance is {tolerance:.2g} %"
    if data["candidates"] and not any(c["meets"] for c in data["candidates"]):
        c = data["candidates"][0]
        miss = next(iter(c["misses"].items()), None)
        said = f": {c['name']} misses {miss[0]} by {miss[1]:.3g}" if miss else ""
        return EXIT_NOT_MET, f"no candidate keeps all limits{said}"
    lost = [r for r in data["runs"] if r["state"] != "done"]
    if lost:
        return (
            EXIT_FAILED_RUNS,
            f"{len(lost)} of {len(data['runs'])} simulations have no answer; the first: {lost[0]['reason']}",
        )
    return 0, None


def pareto_sentences(data: Mapping[str, Any]) -> list[str]:
    """What was found, in sentences."""
    objectives, front, said = data["objectives"], data["front"], []
    runs = {r["key"]: r for r in data["runs"]}
    best = [runs[k] for k in data["best_runs"]]
    if len(objectives) == 1:
        o = objectives[0]
        word = "least" if o["minimise"] else "largest"
        if best:
            at = ", ".join(f"{k} = {_short(v)}" for k, v in best[0]["values"].items())
            value = f"{best[0]['outputs'][o['quantity']]:.6g}{spaced(o['unit'])}"
            said.append(f"The {word} {o['quantity']} that was simulated within all limits is {value}, at {at}.")
        else:
            said.append(f"No simulation keeps all limits: no {word} {o['quantity']} can be stated.")
    else:
        names = " against ".join(o["quantity"] for o in objectives)
        if not front["feasible"]:
            said.append(f"No design was found that keeps all limits: there is no front of {names}.")
        else:
            ranges = []
            for o in objectives:
                values = [p["objectives"][o["quantity"]] for p in front["points"]]
                ranges.append(f"{o['quantity']} from {min(values):.4g} to {max(values):.4g}{spaced(o['unit'])}")
            said.append(f"The front of {names} has {len(front['points'])} points: {'; '.join(ranges)}.")
            known = [r for r in best if r["outputs"]]
            said.append(f"{len(known)} simulations stand on the front of all simulations that keep the limits.")
    verified = [c for c in data["candidates"] if c["verified"]]
    meets = [c for c in verified if c["meets"]]
    worst = max((c["difference"] or 0.0 for c in data["candidates"]), default=0.0)
    if data["search"]["method"] == "simulations":
        said.append(f"Every point was simulated: {data['front']['evaluations']} of them were asked for.")
    elif data["candidates"]:
        limits = f", and {len(meets)} keep all limits" if data["constraints"] else ""
        said.append(
            f"{len(verified)} of {len(data['candidates'])} candidates agree with their simulation to "
            f"{100 * data['verify']['tolerance']:g} %{limits}; the largest difference is {100 * worst:.2g} %."
        )
    h = [v for v in front["hypervolume"] if v is not None and math.isfinite(v)]
    if len(h) >= 10 and h[-1] > 0 and len(objectives) > 1:
        n = len(h) // 5
        rise = 1 - h[-1 - n] / h[-1]
        said.append(f"Over the last {n} of {len(h)} generations the hypervolume rose by {100 * max(rise, 0):.2g} %.")
    return said


def _short(v: float | str) -> str:
    return v if isinstance(v, str) else f"{v:.5g}"
