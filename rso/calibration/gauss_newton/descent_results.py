"""What a study with `[search] method = "gauss_newton"` writes into results.json, as in docs/results.md."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rso.calibration.gauss_newton.iteration import GaussNewtonRun
from rso.calibration.identification_stage import Identified
from rso.calibration.plan import Plan, limited
from rso.calibration.search_results import at_bound, demand, goal
from rso.calibration.search_stage import curve_metrics, demands, done_curves
from rso.calibration.stages import Design
from rso.calibration.unstated_errors import unstated
from rso.emulation.emulator import Output
from rso.evaluation.store import Done
from rso.inference import GaussNewtonFit, Iterate, lenient
from rso.optimise.targets import Checked


def design_of(plan: Plan, found: GaussNewtonRun) -> Design:
    """The runs as a design that nobody asked for."""
    similar = found.frame.group.reference is not None
    return Design(np.empty((0, plan.box.d)), similar, found.similarity, found.proofs, found.runs)


def descent_design(plan: Plan, found: GaussNewtonRun) -> dict[str, Any]:
    """design, and the parts that only response surfaces have."""
    group = found.frame.group
    similarity = {
        "applied": group.reference is not None,
        "story": found.similarity,
        "reference": group.reference,
        "runs_saved": 0,
        "proof": [dataclasses.asdict(p) for p in found.proofs],
    }
    design = {"kind": "none", "asked": 0, "points": [], "held_out": 0, "similarity": similarity}
    return {"design": design, "surrogates": [], "surfaces": [], "sensitivity": None, "mean_over_runs": {}}


def of_gauss_newton(plan: Plan, found: GaussNewtonRun) -> dict[str, Any]:
    """descent, searches (one, with one candidate), best."""
    search, confirmed, checked = plan.searches[0], found.best.confirmed, _checked(plan, found)
    met, one = all(c.met for c in checked), {"search": search.name, "candidate": f"{search.name} 1"}
    return {
        "descent": {
            "derivatives": plan.study.search.derivatives,
            "max_runs": plan.study.search.max_runs,
            "descents": [
                {
                    "start": k + 1,
                    "values": None if d.best is None else _values(plan, found, d.best.x),
                    "chi2": d.chi2,
                    "verified": d.confirmed,
                    "why": d.why,
                    "best": d is found.best,
                    "iterates": [_iterate(plan, found, i, n) for n, i in enumerate(d.iterates, 1)],
                }
                for k, d in enumerate(found.descents)
            ],
        },
        "searches": [
            {
                "name": search.name,
                "targets": [goal(g) for g in search.goals],
                "ranges": {a.name: [a.low, a.high] for a in search.axes},
                "kind": "single",
                "reachable": met,
                "story": _story(found.best),
                "front": {"values": [], "objectives": []},
                "candidates": [_candidate(plan, found, checked)],
                "infill": 0,
                "verified": confirmed,
                "met": met,
                "audit": [],
            }
        ],
        "best": one if confirmed and met else None,
        "closest": None if confirmed and met else one,
    }


def descent_warnings(plan: Plan, found: GaussNewtonRun, known: Identified | None) -> list[str]:
    """What a reader must not miss."""
    said = []
    assert found.best.best is not None
    ends = at_bound(plan.searches[0], plan, _values(plan, found, found.best.best.x))
    if ends:
        said.append(f"the best point lies at an end of the range of {', '.join(ends)}: widen it, or try more starts")
    if "not applied" in found.similarity:
        said.append(f"similarity {found.similarity}")
    lacking = found.eyes.differenced or ()
    if lacking and plan.study.search.derivatives == "backend":
        said.append(
            f"the backend gives no derivatives by {', '.join(lacking)} here: they are differences between more runs"
        )
    rivals = [d for d in found.descents if d.confirmed and d is not found.best and _apart(d, found.first)]
    if rivals:
        said.append(f"{len(rivals)} of {len(found.descents)} starts led to another minimum; see the descents")
    if known is not None:
        d = known.determination
        remarks = d.warning, lenient(d.misfit, d.fit.chi2, d.degrees, d.p_value)
        said += [f"identification: {text}" for text in remarks if text]
        said += unstated(d)
    return said


def _apart(a: GaussNewtonFit, b: GaussNewtonFit) -> bool:
    assert a.best is not None and b.best is not None
    return bool(np.abs(a.best.x - b.best.x).max() > 0.02)


def _story(best: GaussNewtonFit) -> str:
    n = len(best.iterates)
    lost = sum(i.sight is None for i in best.iterates)
    text = f"Gauss–Newton on simulations and their derivatives, {n} points" + (
        f", {lost} without answer" if lost else ""
    )
    return f"{text}: {'the last one agrees with its prediction' if best.confirmed else best.why}."


def _values(plan: Plan, found: GaussNewtonRun, x: np.ndarray) -> dict[str, float]:
    box = found.frame.box
    return {**dict(zip(box.names, map(float, box.from_unit(x)), strict=True)), **plan.resolved.fixed}


def _iterate(plan: Plan, found: GaussNewtonRun, i: Iterate, number: int) -> dict[str, Any]:
    return {
        "number": number,
        "values": _values(plan, found, i.x),
        "state": "failed" if i.sight is None else "done",
        "chi2": i.chi2,
        "expected": i.expected,
        "agreement": i.gap,
        "step": i.step,
        "radius": i.radius,
        "better": i.better,
    }


def _last(found: GaussNewtonRun) -> Iterate:
    return next(i for d in found.descents for i in d.iterates if i.sight is found.best.best)


def _candidate(plan: Plan, found: GaussNewtonRun, checked: tuple[Checked, ...]) -> dict[str, Any]:
    search, sight, goals = plan.searches[0], found.best.best, plan.searches[0].goals
    assert sight is not None
    values, last = _values(plan, found, sight.x), _last(found)
    predicted = sight.f if last.predicted is None else last.predicted
    rows = []
    for o, g in zip(search.outputs, goals, strict=True):
        outcome = found.outcomes[plan.case_of[o.experiment]]
        assert isinstance(outcome, Done)
        error = o.error(outcome.response)
        rows.append(
            {
                "output": o.id,
                "predicted": _at(found, o, predicted),
                "sd": None,
                "recomputed": o.read(outcome.response),
                "numerical_error": error,
                "target": g.value,
            }
        )
    return {
        "name": f"{search.name} 1",
        "values": values,
        "state": "done",
        "outputs": rows,
        "agreement": found.best.gap,
        "verified": found.best.confirmed,
        "worst": None,
        "meets": all(c.met for c in checked),
        "demands": [demand(c) for c in checked],
        "curves": done_curves(plan, found.outcomes),
        "metrics": {n: dataclasses.asdict(m) for n, m in curve_metrics(plan, found.outcomes).items()},
        "at_bound": at_bound(search, plan, values),
        "extrapolated": False,
    }


def _at(found: GaussNewtonRun, o: Output, curve: np.ndarray) -> float | None:
    """A curve at the travel of an output, where it was measured there."""
    parts = np.split(curve, np.cumsum([len(p.depth) for p in found.places])[:-1])
    for p, y in zip(found.places, parts, strict=True):
        if (p.experiment, p.channel) == (o.experiment, o.channel):
            since = np.zeros(len(p.depth)) if p.since is None else p.since
            k = int(np.argmin(np.where(since == o.since_s, np.abs(p.depth - o.depth_mm), np.inf)))
            return float(y[k]) if since[k] == o.since_s and abs(p.depth[k] - o.depth_mm) < 1e-6 else None
    return None


def _checked(plan: Plan, found: GaussNewtonRun) -> tuple[Checked, ...]:
    search = plan.searches[0]
    outputs, errors = {}, {}
    for o in (*search.outputs, *map(limited, plan.constraints)):
        outcome = found.outcomes[plan.case_of[o.experiment]]
        assert isinstance(outcome, Done)
        outputs[o.id], errors[o.id] = o.read(outcome.response), o.error(outcome.response)
    assert found.best.best is not None
    return demands(plan, search, found.best.best.x, outputs, errors)
